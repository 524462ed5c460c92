"""The momentum of a spacecraft with moving stages and its derivative, computed anew for the certificate.

A *stage* is a part of a terminal or drive that joints turn and that has an inertia of its own. With the
angular velocity ``w`` in body axes, the momentum of the whole, in body axes, and its derivative there are

    L = J_0 w + sum I_k (w + g_k),    L' = J_0 w' + sum g_k x I_k (w + g_k) + I_k (w' + g_k' + w x g_k)

with sums over all stages. ``I_k`` is the inertia of stage k about its own centre of mass, and ``g_k`` its
angular velocity relative to the body, both in body axes. ``J_0`` is the inertia ``J`` of the whole less all
``I_k`` with joints at zero. With yaw ``y``, pitch ``p``, the yaw axis ``u``, and the pitch axis ``e`` (which
the yaw turns; at zero angles it is opposite to the direction on the left),

    g = y' u + p' e,    g' = y'' u + p'' e + p' y' u x e,    I = C I_0 C^T,    C = exp(y u^) exp(p e_0^).

For a stage that does not pitch, such as a drive, ``p`` is zero.

**Between samples.** The momentum of a stage has the majorant (see `bounds` and `series`)

    |I_0| exp(2 (y + p)) (s + y' + p' exp(y)),

where ``s`` is the majorant of ``w``, and ``y`` and ``p`` are those of the angles without constant terms,
since ``C`` has the majorant ``exp(y + p)`` and ``e`` the majorant ``exp(y)``. The majorant of ``L'`` is its
derivative. What errors of the angles and of ``w`` do to the momentum follows from the same majorant to first
order.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from jaxplan.certificate import series
from jaxplan.certificate.bounds import NEGLIGIBLE, Evidence, Majorants
from jaxplan.certificate.motion import DEGREE, Intervals, Mountings, Samples
from jaxplan.certificate.series import ROUNDING
from jaxplan.model.spacecraft import Spacecraft

_INTERPOLATION_FACTOR = 2.0 ** (1 - DEGREE)  # of interpolation errors, see `bounds`
T = TypeVar("T")
Sampled = Sequence[np.ndarray]  # samples, bound of the interpolation error, size of the rounding error


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """A moving part of a terminal or drive that has an inertia of its own, and the joints that turn it.

    Attributes:
        axes: (3, 3) unit vectors in body axes as rows, at zero angles: boresight, left, yaw axis.
        inertia: (3, 3) kg m^2, about its own centre of mass, along these axes.
        yaw: index of the joint that turns it about the yaw axis.
        pitch: index of the joint that pitches it; None if none does.
    """

    axes: np.ndarray
    inertia: np.ndarray
    yaw: int
    pitch: int | None

    @property
    def at_zero(self) -> np.ndarray:
        """(3, 3) kg m^2, its inertia in body axes at zero joint angles."""
        return self.axes.T @ self.inertia @ self.axes

    @cached_property
    def size(self) -> float:
        """Spectral norm of its inertia, kg m^2: the largest factor by which it lengthens a vector."""
        return float(np.linalg.norm(self.inertia, 2))


def stages(craft: Spacecraft) -> list[Stage]:
    """Return the stages of a spacecraft: the parts with an inertia of their own."""
    axes, count = Mountings.of(craft).axes, len(craft.terminals)
    found = []
    for number, terminal in enumerate(craft.terminals):
        for given, pitch in ((terminal.yaw_inertia, None), (terminal.pitch_inertia, count + number)):
            if given is not None:
                found.append(Stage(axes=axes[number], inertia=matrix(given), yaw=number, pitch=pitch))
    for number, drive in enumerate(craft.drives, count):
        if drive.inertia is not None:
            found.append(
                Stage(axes=axes[number], inertia=matrix(drive.inertia), yaw=count + number, pitch=None)
            )
    return found


def matrix(given: np.ndarray) -> np.ndarray:
    """Return an inertia as a matrix (3, 3); it is given as one or by three principal moments (3,)."""
    own = np.asarray(given, np.float64)
    return np.diag(own) if own.shape == (3,) else own


def left(craft: Spacecraft) -> np.ndarray:
    """Return the inertia (3, 3) kg m^2, ``J_0``, of the whole less all stages at zero angles."""
    inertia = matrix(np.asarray(craft.inertia, np.float64))
    for stage in stages(craft):
        inertia = inertia - stage.at_zero
    return inertia


def fixed(craft: Spacecraft) -> tuple[np.ndarray, float]:
    """Return ``J_0`` (3, 3) kg m^2, the inertia of what no joint turns, and its spectral norm."""
    inertia = left(craft)
    return inertia, float(np.linalg.norm(inertia, 2))


def numbers(craft: Spacecraft) -> np.ndarray:
    """Return axes, inertia, and yaw and pitch indices (-1 for no pitch) of all s stages as rows (s, 20)."""
    rows = [
        [*one.axes.ravel(), *one.inertia.ravel(), one.yaw, -1 if one.pitch is None else one.pitch]
        for one in stages(craft)
    ]
    return np.array(rows, np.float64).reshape(-1, 20)


def momentum(evidence: Evidence, craft: Spacecraft) -> Sampled:
    """Return the momentum ``L`` (3, n, m) N m s, body axes, with error bounds.

    Returns:
        Samples; bound of the interpolation error (n,); size of the rounding error (n,).
    """
    return _momentum_and_change(evidence, craft)[0]


def change(evidence: Evidence, craft: Spacecraft) -> Sampled:
    """Return the derivative ``L'`` (3, n, m) N m, body axes, with error bounds as of `momentum`."""
    return _momentum_and_change(evidence, craft)[1]


def _momentum_and_change(evidence: Evidence, craft: Spacecraft) -> tuple[Sampled, Sampled]:
    """Return the results of `momentum` and `change`; they are computed once and kept in `evidence`."""
    return _compute_once(
        evidence, "_momentum_and_change", craft, lambda: _compute_momentum_and_change(evidence, craft)
    )


def _compute_momentum_and_change(evidence: Evidence, craft: Spacecraft) -> tuple[Sampled, Sampled]:
    """Compute the results of `momentum` and `change`."""
    inertia, size = fixed(craft)
    spin, joints, half = evidence.samples.spin, evidence.samples.joints, evidence.on.half
    values = [np.einsum("ij,jnm->inm", inertia, spin[order]) for order in range(2)]
    every = _known_stages(evidence.majorants, craft)
    for stage in every:
        for order, carried in enumerate(_stage_momentum_and_change(stage, spin, joints)):
            values[order] = values[order] + carried
    of_stages, error = _stage_majorants(evidence.majorants, craft), _stage_rounding(evidence, every)
    left_out, rounding = [], []
    for order, own in enumerate((of_stages, series.slope(of_stages))):
        unit = half ** (order + 1)
        beyond = _INTERPOLATION_FACTOR * np.sum(own[DEGREE + 1], axis=0) / unit
        left_out.append(size * evidence.left_out.spin[order] + beyond)
        rounding.append(size * evidence.rounding.spin[order] + np.sum(error[order], axis=0) / unit)
    first, second = zip(values, left_out, rounding, strict=True)
    return first, second


def at_starts(samples: Samples, first: np.ndarray, craft: Spacecraft) -> np.ndarray:
    """Return the momentum ``L`` (3, k) N m s, body axes, at the starts of intervals `first` (k,)."""
    found = np.sum(fixed(craft)[0][:, :, None] * samples.spin[0][:, first, 0], axis=1)
    spin, joints = samples.spin[:, :, first, :1], samples.joints[:, :, first, :1]
    for stage in stages(craft):
        found = found + _stage_momentum(stage, spin, joints)[..., 0]
    return found


def majorant(majorants: Majorants, craft: Spacecraft) -> np.ndarray:
    """Return the majorant (orders, n), N m s^2, of the momentum ``L`` times the half widths of intervals."""
    found = fixed(craft)[1] * majorants.spin
    if not _known_stages(majorants, craft):
        return found  # in all its orders; those of stages are fewer
    of_stages = _stage_majorants(majorants, craft)
    return np.asarray(found[: len(of_stages)] + np.sum(of_stages, axis=1))


def excess(craft: Spacecraft, least: tuple[float, float], on: Intervals, majorants: Majorants) -> np.ndarray:
    """Return how many times as large as wanted the interpolation errors of the stages' momenta are, (n,).

    Args:
        craft: the spacecraft.
        least: the least limits of momentum, N m s, and of torque, N m.
        on: n intervals.
        majorants: those of the motion on them.
    """
    own, half = _stage_majorants(majorants, craft), on.half
    crossed = series.product("n,sn->sn", majorants.spin, own)[DEGREE + 1]
    torque = series.slope(own)[DEGREE + 1] + crossed
    found = np.zeros(len(half))
    for limit, left_out in zip(least, (own[DEGREE + 1] / half, torque / half**2), strict=True):
        largest = np.max(left_out, axis=0, initial=0.0)
        found = np.maximum(found, _INTERPOLATION_FACTOR * largest / (NEGLIGIBLE * limit))
    return np.nan_to_num(found, nan=np.inf)


def _stage_axes(stage: Stage, joints: np.ndarray) -> np.ndarray:
    """Return a stage's axes (3, axis, n, m) in body axes at joint angles (J, n, m) rad; components first."""
    ahead, left, up = (axis[:, None, None] for axis in stage.axes)
    cosine, sine = np.cos(joints[stage.yaw]), np.sin(joints[stage.yaw])
    level, aside = cosine * ahead + sine * left, cosine * left - sine * ahead
    if stage.pitch is None:
        return np.stack([level, aside, np.broadcast_to(up, level.shape)], axis=1)
    cosine, sine = np.cos(joints[stage.pitch]), np.sin(joints[stage.pitch])
    return np.stack([cosine * level + sine * up, aside, cosine * up - sine * level], axis=1)


def _stage_rate(stage: Stage, at: np.ndarray, joints: np.ndarray, order: int) -> np.ndarray:
    """Return ``y' u + p' e`` (`order` 1) or ``y'' u + p'' e`` (`order` 2) of a stage, (3, n, m), body axes.

    Args:
        stage: the stage.
        at: its axes as `_stage_axes` returns them.
        joints: (derivatives, J, n, m) joint angles and their derivatives.
        order: order of the derivatives to take.
    """
    found = joints[order, stage.yaw] * stage.axes[2][:, None, None]
    return found if stage.pitch is None else found - joints[order, stage.pitch] * at[:, 1]


def _times_inertia(stage: Stage, at: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Multiply vectors (3, n, m) in body axes by a stage's inertia ``I_k``; `at` is from `_stage_axes`."""
    own = np.einsum("ianm,inm->anm", at, vector)
    return np.einsum("ianm,anm->inm", at, np.einsum("ab,bnm->anm", stage.inertia, own))


def _stage_momentum(stage: Stage, spin: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Return the momentum (3, n, m) N m s, body axes, that a stage adds to ``L`` at samples of a motion."""
    at = _stage_axes(stage, joints[0])
    return _times_inertia(stage, at, spin[0] + _stage_rate(stage, at, joints, 1))


def _stage_momentum_and_change(
    stage: Stage, spin: np.ndarray, joints: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return `_stage_momentum` and what the stage adds to the derivative ``L'``, (3, n, m) N m."""
    at = _stage_axes(stage, joints[0])
    rate, driven = _stage_rate(stage, at, joints, 1), spin[1] + _stage_rate(stage, at, joints, 2)
    if stage.pitch is not None:  # the pitch axis is opposite to the left, which yaws
        across = cross(at[:, 1], stage.axes[2][:, None, None])
        driven = driven + joints[1, stage.yaw] * joints[1, stage.pitch] * across
    driven = driven + cross(spin[0], rate)
    momentum = _times_inertia(stage, at, spin[0] + rate)
    return momentum, cross(rate, momentum) + _times_inertia(stage, at, driven)


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return vector products (3, ...) of vectors (3, ...), components first; quicker than numpy's own."""
    (a, b, c), (x, y, z) = first, second
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x])


def _of_joints(values: np.ndarray, every: Sequence[Stage]) -> tuple[np.ndarray, np.ndarray]:
    """Pick from values (orders, J, n) of joints those of s stages' yaws and pitches, each (orders, s, n).

    Of a stage without pitch the latter are zero.
    """
    yaw = values[:, [one.yaw for one in every]]
    pitch = values[:, [-1 if one.pitch is None else one.pitch for one in every]]
    pitch[:, [one.pitch is None for one in every]] = 0
    return yaw, pitch


def _angle_majorants(majorants: Majorants, every: Sequence[Stage]) -> tuple[np.ndarray, np.ndarray]:
    """Return majorants (orders, s, n) of stages' yaws and pitches, rad, less constant terms."""
    yaw, pitch = _of_joints(majorants.joints, every)
    yaw[0] = pitch[0] = 0
    return yaw, pitch


def _sizes(every: Sequence[Stage]) -> np.ndarray:
    """Return the sizes (s, 1) of stages, kg m^2."""
    return np.array([one.size for one in every]).reshape(-1, 1)


def _known_stages(majorants: Majorants, craft: Spacecraft) -> list[Stage]:
    """Return the stages; they are made once for each certificate and kept in `majorants`.

    Not longer, since what a spacecraft holds may be changed in place.
    """
    return _compute_once(majorants, "_stages", craft, lambda: stages(craft))


def _stage_majorants(majorants: Majorants, craft: Spacecraft) -> np.ndarray:
    """Return majorants (orders, s, n), N m s^2, of stages' momenta times the half widths of intervals.

    They are computed once and kept in `majorants`.
    """
    every = _known_stages(majorants, craft)
    return _compute_once(majorants, "_of_stages", craft, lambda: _make_stage_majorants(majorants, every))


def _make_stage_majorants(majorants: Majorants, every: Sequence[Stage]) -> np.ndarray:
    """Compute the result of `_stage_majorants`."""
    yaw, pitch = _angle_majorants(majorants, every)
    swung = series.product("sn,sn->sn", series.slope(pitch), series.exponential(yaw))
    spinning = majorants.spin[: len(swung), None] + series.slope(yaw) + swung
    return _sizes(every) * series.product("sn,sn->sn", series.exponential(2 * (yaw + pitch)), spinning)


def _stage_rounding(evidence: Evidence, every: Sequence[Stage]) -> np.ndarray:
    """Return sizes (2, s, n) of rounding errors of stages' parts of h L and of h^2 L', h the half widths."""
    bounds, half = evidence.majorants, evidence.on.half
    yaw, pitch = (own[:3] for own in _angle_majorants(bounds, every))
    unit = half ** np.arange(3)[:, None] / np.array([1, 1, 2])[:, None]
    off_yaw, off_pitch = _of_joints(evidence.rounding.joints[:3] * unit[:, None], every)
    off_spin = evidence.rounding.spin[:2] * half ** np.arange(1, 3)[:, None]
    turning, about = series.exponential(2 * (yaw + pitch)), series.exponential(yaw)
    swung = series.product("sn,sn->sn", series.slope(pitch), about)
    spinning = bounds.spin[:2, None] + series.slope(yaw) + swung
    swung_off = series.product("sn,sn->sn", series.slope(off_pitch), about)
    off = off_spin[:, None] + series.slope(off_yaw) + swung_off
    off += series.product("sn,sn->sn", swung, off_yaw)
    off += series.product("sn,sn->sn", 2 * (off_yaw + off_pitch), spinning) + ROUNDING * spinning
    return _sizes(every) * series.product("sn,sn->sn", turning, off)


def _compute_once(owner: object, name: str, craft: Spacecraft, make: Callable[[], T]) -> T:
    """Return the result of `make`, kept in the owner's attribute `name` for later calls with this craft."""
    known: dict[str, tuple[Spacecraft, T]] = vars(owner)
    if name not in known or known[name][0] is not craft:
        known[name] = craft, make()
    return known[name][1]
