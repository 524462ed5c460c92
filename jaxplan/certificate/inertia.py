"""The momentum of a spacecraft and its derivative, computed anew for the certificate.

Seen from the body, with its angular velocity ``w`` (body axes), the momentum of the whole is

    L = J_0 w + sum I_k (w + g_k),    L' = J_0 w' + sum g_k x I_k (w + g_k) + I_k (w' + g_k' + w x g_k)

over the *stages* of terminals and drives that have an inertia: ``I_k``, about the stage's own centre of mass,
and its angular velocity ``g_k`` relative to the body, in body axes. ``J_0`` is the inertia ``J`` of the whole
less all ``I_k`` with joints at zero. With ``u`` the yaw axis, ``e`` the pitch axis (opposite to the left at
zero angles, and turned by the yaw), and yaw and pitch ``y`` and ``p``,

    g = y' u + p' e,    g' = y'' u + p'' e + p' y' u x e,    I = C I_0 C^T,    C = exp(y u^) exp(p e_0^),

where a stage that does not pitch, such as a drive, has no ``p``.

**Between samples.** The momentum of a stage has the majorant (see `bounds` and `series`)

    |I_0| exp(2 (y + p)) (s + y' + p' exp(y)),    s of w, y and p of the angles without constant terms,

since ``C`` has the majorant ``exp(y + p)`` and ``e`` the majorant ``exp(y)``; that of ``L'`` is its
derivative. How errors of the angles and of ``w`` move it follows from the same majorant, to first order.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from jaxplan.certificate import series
from jaxplan.certificate.bounds import NEGLIGIBLE, Evidence, Majorants
from jaxplan.certificate.motion import DEGREE, Intervals, Mountings, Samples
from jaxplan.certificate.series import ROUNDING
from jaxplan.model.spacecraft import Spacecraft

_FACTOR = 2.0 ** (1 - DEGREE)  # of what polynomials through samples leave out
T = TypeVar("T")
Sampled = Sequence[np.ndarray]  # values, what is left out, and rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """A moving part of a terminal or drive that has an inertia of its own, and the joints that turn it.

    Attributes:
        axes: (3, 3) unit vectors in body axes, rows: boresight, left and yaw axis at zero angles.
        inertia: (3, 3) kg m^2, along these axes.
        yaw: number of the joint that yaws it.
        pitch: number of the joint that lifts it; None for none.
    """

    axes: np.ndarray
    inertia: np.ndarray
    yaw: int
    pitch: int | None

    @property
    def at_zero(self) -> np.ndarray:
        """(3, 3) kg m^2 in body axes, at zero angles."""
        return self.axes.T @ self.inertia @ self.axes

    @property
    def size(self) -> float:
        """The most by which its inertia makes a vector longer, kg m^2."""
        return float(np.linalg.norm(self.inertia, 2))


def stages(craft: Spacecraft) -> Iterator[Stage]:
    """Yield the stages that have an inertia."""
    axes, count = Mountings.of(craft).axes, len(craft.terminals)
    for number, terminal in enumerate(craft.terminals):
        for given, pitch in ((terminal.yaw_inertia, None), (terminal.pitch_inertia, count + number)):
            if given is not None:
                yield Stage(axes=axes[number], inertia=matrix(given), yaw=number, pitch=pitch)
    for number, drive in enumerate(craft.drives, count):
        if drive.inertia is not None:
            yield Stage(axes=axes[number], inertia=matrix(drive.inertia), yaw=count + number, pitch=None)


def matrix(given: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of an inertia that is given as one, or by three moments."""
    own = np.asarray(given, np.float64)
    return np.diag(own) if own.shape == (3,) else own


def left(craft: Spacecraft) -> np.ndarray:
    """The inertia (3, 3) kg m^2 that no joint turns."""
    inertia = matrix(np.asarray(craft.inertia, np.float64))
    for stage in stages(craft):
        inertia = inertia - stage.at_zero
    return inertia


def fixed(craft: Spacecraft) -> tuple[np.ndarray, float]:
    """The inertia (3, 3) kg m^2 that no joint turns, and the most by which it makes a vector longer."""
    inertia = left(craft)
    return inertia, float(np.linalg.norm(inertia, 2))


def numbers(craft: Spacecraft) -> np.ndarray:
    """All numbers of the stages, and which joints turn them, (s, 20)."""
    rows = [
        [*one.axes.ravel(), *one.inertia.ravel(), one.yaw, -1 if one.pitch is None else one.pitch]
        for one in stages(craft)
    ]
    return np.array(rows, np.float64).reshape(-1, 20)


def momentum(evidence: Evidence, craft: Spacecraft) -> Sampled:
    """The momentum ``L`` (3, n, m) N m s, body axes, what is left out of it (n,), and rounding (n,)."""
    return _both(evidence, craft)[0]


def change(evidence: Evidence, craft: Spacecraft) -> Sampled:
    """The derivative ``L'`` (3, n, m) N m, body axes, what is left out of it (n,), and rounding (n,)."""
    return _both(evidence, craft)[1]


def _both(evidence: Evidence, craft: Spacecraft) -> tuple[Sampled, Sampled]:
    """The momentum and its derivative, see `momentum` and `change`; made once for torque and momentum."""
    return _once(evidence, "_momentum_and_change", craft, lambda: _sampled(evidence, craft))


def _sampled(evidence: Evidence, craft: Spacecraft) -> tuple[Sampled, Sampled]:
    """The momentum and its derivative, made anew."""
    inertia, size = fixed(craft)
    spin, joints, half = evidence.samples.spin, evidence.samples.joints, evidence.on.half
    values = [np.einsum("ij,jnm->inm", inertia, spin[order]) for order in range(2)]
    left_out = [size * evidence.left_out.spin[order] for order in range(2)]
    rounding = [size * evidence.rounding.spin[order] for order in range(2)]
    for stage, own in zip(stages(craft), _majorants(evidence.majorants, craft), strict=True):
        error, series_of = _error(evidence, stage), (own, series.slope(own))
        for order, carried in enumerate(_carried_and_change(stage, spin, joints)):
            values[order] = values[order] + carried
            unit = half ** (order + 1)
            left_out[order] = left_out[order] + _FACTOR * series_of[order][DEGREE + 1] / unit
            rounding[order] = rounding[order] + error[order] / unit
    first, second = zip(values, left_out, rounding, strict=True)
    return first, second


def at_starts(samples: Samples, first: np.ndarray, craft: Spacecraft) -> np.ndarray:
    """The momentum ``L`` (3, k) N m s, body axes, at the starts of intervals by number (k,)."""
    found = np.sum(fixed(craft)[0][:, :, None] * samples.spin[0][:, first, 0], axis=1)
    spin, joints = samples.spin[:, :, first, :1], samples.joints[:, :, first, :1]
    for stage in stages(craft):
        found = found + _carried(stage, spin, joints)[..., 0]
    return found


def majorant(majorants: Majorants, craft: Spacecraft) -> np.ndarray:
    """Majorant (orders, n) of the momentum ``L`` times the half widths, N m s^2."""
    found = fixed(craft)[1] * majorants.spin
    for own in _majorants(majorants, craft):
        found = found[: len(own)] + own
    return found


def excess(craft: Spacecraft, least: tuple[float, float], on: Intervals, majorants: Majorants) -> np.ndarray:
    """How many times as large as wanted is what is left out of what stages carry, (n,).

    Args:
        craft: the spacecraft.
        least: the least limits of momentum, N m s, and of torque, N m.
        on: intervals.
        majorants: of the motion on them.
    """
    found, half = np.zeros(len(on.half)), on.half
    for own in _majorants(majorants, craft):
        crossed = series.product("n,n->n", majorants.spin, own)[DEGREE + 1]
        torque = series.slope(own)[DEGREE + 1] + crossed
        for limit, left_out in zip(least, (own[DEGREE + 1] / half, torque / half**2), strict=True):
            found = np.maximum(found, _FACTOR * left_out / (NEGLIGIBLE * limit))
    return np.nan_to_num(found, nan=np.inf)


def _turned(stage: Stage, joints: np.ndarray) -> np.ndarray:
    """A stage's axes (3, axis, n, m) in body axes, at joints (J, n, m) rad."""
    ahead, left, up = (axis[:, None, None] for axis in stage.axes)
    cosine, sine = np.cos(joints[stage.yaw]), np.sin(joints[stage.yaw])
    level, aside = cosine * ahead + sine * left, cosine * left - sine * ahead
    if stage.pitch is None:
        return np.stack([level, aside, np.broadcast_to(up, level.shape)], axis=1)
    cosine, sine = np.cos(joints[stage.pitch]), np.sin(joints[stage.pitch])
    return np.stack([cosine * level + sine * up, aside, cosine * up - sine * level], axis=1)


def _rate(stage: Stage, at: np.ndarray, joints: np.ndarray, order: int) -> np.ndarray:
    """Joint rates (`order` 1) or accelerations (2) about a stage's axes of rotation, summed, (3, n, m)."""
    found = joints[order, stage.yaw] * stage.axes[2][:, None, None]
    return found if stage.pitch is None else found - joints[order, stage.pitch] * at[:, 1]


def _times_inertia(stage: Stage, at: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """``I_k`` times vectors (3, n, m)."""
    own = np.einsum("ianm,inm->anm", at, vector)
    return np.einsum("ianm,anm->inm", at, np.einsum("ab,bnm->anm", stage.inertia, own))


def _carried(stage: Stage, spin: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """The momentum (3, n, m) N m s that a stage adds to that of the whole, ``L``, at samples of a motion."""
    at = _turned(stage, joints[0])
    return _times_inertia(stage, at, spin[0] + _rate(stage, at, joints, 1))


def _carried_and_change(stage: Stage, spin: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute what `_carried` does, and the torque (3, n, m) N m that it adds to the derivative ``L'``."""
    at = _turned(stage, joints[0])
    rate, driven = _rate(stage, at, joints, 1), spin[1] + _rate(stage, at, joints, 2)
    if stage.pitch is not None:  # the pitch axis is opposite to the left, which yaws
        across = np.cross(at[:, 1], stage.axes[2][:, None, None], axis=0)
        driven = driven + joints[1, stage.yaw] * joints[1, stage.pitch] * across
    driven = driven + np.cross(spin[0], rate, axis=0)
    momentum = _times_inertia(stage, at, spin[0] + rate)
    return momentum, np.cross(rate, momentum, axis=0) + _times_inertia(stage, at, driven)


def _angles(majorants: Majorants, stage: Stage) -> tuple[np.ndarray, np.ndarray]:
    """Majorants (orders, n) of a stage's yaw and pitch, rad, without their constant terms."""
    yaw = majorants.joints[:, stage.yaw].copy()
    pitch = np.zeros_like(yaw) if stage.pitch is None else majorants.joints[:, stage.pitch].copy()
    yaw[0] = pitch[0] = 0
    return yaw, pitch


def _majorants(majorants: Majorants, craft: Spacecraft) -> list[np.ndarray]:
    """`_majorant` of every stage, made once for all quantities."""
    return _once(majorants, "_of_stages", craft, lambda: [_majorant(majorants, own) for own in stages(craft)])


def _once(owner: object, name: str, craft: Spacecraft, make: Callable[[], T]) -> T:
    """Make what follows from an unchanging owner and a spacecraft once, and keep it in the owner."""
    known: dict[str, tuple[Spacecraft, T]] = vars(owner)
    if name not in known or known[name][0] is not craft:
        known[name] = craft, make()
    return known[name][1]


def _majorant(majorants: Majorants, stage: Stage) -> np.ndarray:
    """Majorant (orders, n) of what a stage carries times the half widths, N m s^2."""
    yaw, pitch = _angles(majorants, stage)
    swung = series.product("n,n->n", series.slope(pitch), series.exponential(yaw))
    spinning = majorants.spin[: len(swung)] + series.slope(yaw) + swung
    return stage.size * series.product("n,n->n", series.exponential(2 * (yaw + pitch)), spinning)


def _error(evidence: Evidence, stage: Stage) -> np.ndarray:
    """Sizes (2, n) of rounding errors of what a stage adds to h L and to h^2 L', h the half widths."""
    bounds, half = evidence.majorants, evidence.on.half
    yaw, pitch = (own[:3] for own in _angles(bounds, stage))
    unit = half ** np.arange(3)[:, None] / np.array([1, 1, 2])[:, None]
    off_yaw = evidence.rounding.joints[:, stage.yaw] * unit
    off_pitch = 0 * off_yaw if stage.pitch is None else evidence.rounding.joints[:, stage.pitch] * unit
    off_spin = evidence.rounding.spin[:2] * half ** np.arange(1, 3)[:, None]
    turning, about = series.exponential(2 * (yaw + pitch)), series.exponential(yaw)
    swung = series.product("n,n->n", series.slope(pitch), about)
    spinning = bounds.spin[:2] + series.slope(yaw) + swung
    off = off_spin + series.slope(off_yaw) + series.product("n,n->n", series.slope(off_pitch), about)
    off += series.product("n,n->n", swung, off_yaw)
    off += series.product("n,n->n", 2 * (off_yaw + off_pitch), spinning) + ROUNDING * spinning
    return stage.size * series.product("n,n->n", turning, off)
