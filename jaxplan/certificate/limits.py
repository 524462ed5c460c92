"""Limits of rate, acceleration, jerk, torque and momentum at every instant, and what happens at joins.

Limits on rates, accelerations, joint angles and torque as bounds on polynomials, proved over all time.

Every limited quantity has components ``f`` that must stay within ``-limit`` and ``+limit``. The margin of a
component is ``1 - |f| / limit``, so that a peak over its limit is one minus the least margin.

What holds at single instants: no jumps at breaks, the wanted states at both ends.

The samples of an interval include both of its ends, so the last of one and the first of the next are
the values left and right of the same instant.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxplan.certificate import bounds, series
from jaxplan.certificate.bounds import LEBESGUE, Evidence, Layout, Minima, Rows
from jaxplan.certificate.claims import EndState
from jaxplan.certificate.motion import DEGREE, Samples
from jaxplan.certificate.series import ROUNDING
from jaxplan.model.limits import Limit, limits

if TYPE_CHECKING:
    from jaxplan.model.spacecraft import Spacecraft


def tolerance(margin: np.ndarray) -> np.ndarray:
    """How close a bound comes to the largest ratio met: a twentieth of the margin, from 1e-10 to 5e-7."""
    return np.clip(np.abs(margin) / 20, 1e-10, 5e-7)


@dataclass(frozen=True, eq=False)
class Limited:
    """What a limit is on, sampled.

    Attributes:
        of: the limit, which gives names and unit.
        values: (c, n, m) samples on the intervals.
        left_out: (c, n) or (n,), how far the polynomials through the samples may be off.
        rounding: likewise, size of the samples' rounding errors.
        limit: (c,) positive.
    """

    of: Limit
    values: np.ndarray
    left_out: np.ndarray
    rounding: np.ndarray
    limit: np.ndarray

    @property
    def name(self) -> str:
        """Its key in the report."""
        return self.of.quantity.name

    @property
    def components(self) -> tuple[str, ...]:
        """(c,) names, such as "about x" or "of terminal-1 yaw"."""
        preposition = "of" if self.of.quantity.of_joints else "about"
        return tuple(f"{preposition} {owner}" for owner in self.of.owners)


def quantities(spacecraft: "Spacecraft", evidence: Evidence) -> list[Limited]:
    """All that the spacecraft limits, in the order of the report."""
    return [
        Limited(
            limit,
            *_SAMPLED[limit.quantity.name](evidence, spacecraft),
            np.full(len(limit.owners), np.asarray(limit.quantity.given(spacecraft), np.float64)),
        )
        for limit in limits(spacecraft)
    ]


_Sampled = tuple[np.ndarray, np.ndarray, np.ndarray]  # values, what is left out, and rounding


def _spin(evidence: Evidence, derivative: int) -> _Sampled:
    """The angular velocity or a derivative of it, body axes."""
    of = evidence.samples.spin, evidence.left_out.spin, evidence.rounding.spin
    values, left_out, rounding = (array[derivative] for array in of)
    return values, left_out, rounding


def _joints(evidence: Evidence, derivative: int, part: slice = slice(None)) -> _Sampled:
    """Joint angles or a derivative of them, of all or of some joints."""
    of = evidence.samples.joints, evidence.left_out.joints, evidence.rounding.joints
    values, left_out, rounding = (array[derivative][part] for array in of)
    return values, left_out, rounding


def _momentum(evidence: Evidence, spacecraft: "Spacecraft") -> _Sampled:
    """``J w``, body axes."""
    velocity, left_out, rounding = _spin(evidence, 0)
    inertia, size = _inertia(spacecraft)
    return np.einsum("ij,jnm->inm", inertia, velocity), size * left_out, size * rounding


def _torque(evidence: Evidence, spacecraft: "Spacecraft") -> _Sampled:
    """``J w' + w x J w``, body axes."""
    velocity, (momentum, _, of_momentum) = evidence.samples.spin[0], _momentum(evidence, spacecraft)
    acceleration, left_out, rounding = _spin(evidence, 1)
    inertia, size = _inertia(spacecraft)
    torque = np.einsum("ij,jnm->inm", inertia, acceleration) + np.cross(velocity, momentum, axis=0)
    speed, half = evidence.majorants.spin, evidence.on.half
    square = series.product("n,n->n", speed, speed)[DEGREE + 1] / half**2
    left_out = size * left_out + size * 2.0 ** (1 - DEGREE) * square
    return torque, left_out, size * rounding + 2 * speed[0] / half * of_momentum


def _inertia(spacecraft: "Spacecraft") -> tuple[np.ndarray, np.floating[Any]]:
    """The inertia, and the most by which it makes a vector longer."""
    inertia = np.asarray(spacecraft.inertia, np.float64)
    return inertia, np.linalg.norm(inertia, 2)


# The certificate's own writing of every quantity; a limit on another one cannot be proved.
_SAMPLED: dict[str, Callable[[Evidence, "Spacecraft"], _Sampled]] = {
    "angular_velocity": lambda evidence, _: _spin(evidence, 0),
    "angular_acceleration": lambda evidence, _: _spin(evidence, 1),
    "joint_rates": lambda evidence, _: _joints(evidence, 1),
    "joint_accelerations": lambda evidence, _: _joints(evidence, 2),
    "yaw": lambda evidence, craft: _joints(evidence, 0, slice(None, len(craft.terminals))),
    "pitch": lambda evidence, craft: _joints(evidence, 0, slice(len(craft.terminals), None)),
    "torque": _torque,
    "wheel_momentum": _momentum,
    "jerk": lambda evidence, _: _spin(evidence, 2),
}


def prove(limited: list[Limited], evidence: Evidence) -> Minima:
    """Bounds the least of ``1 - |f| / limit`` over all time.

    Returns:
        For the components of all quantities in turn, trajectory by trajectory.
    """
    on, limit = evidence.on, np.concatenate([q.limit for q in limited])[:, None]
    ratio = np.concatenate([q.values for q in limited]) / limit[..., None]
    largest = np.abs(ratio).max(axis=2)
    error = [np.broadcast_to(q.left_out + LEBESGUE * q.rounding, q.values.shape[:2]) for q in limited]
    conversion = ROUNDING * bounds.growth(DEGREE) * largest
    coefficients = bounds.to_rows(ratio.reshape(-1, DEGREE + 1))
    components, trajectories = len(limit), len(on.begins) - 1
    every = np.ones(trajectories * components, dtype=bool)
    quantity = np.repeat(np.arange(len(limited)), [len(q.components) for q in limited])
    owner = np.arange(trajectories)[:, None]
    layout = Layout(
        opens_entry=every,
        opens_clause=every,
        quantity=(len(limited) * owner + quantity).ravel(),
        owner=np.repeat(owner, components),
    )
    rows = Rows(
        coefficients=np.concatenate([1 - coefficients, 1 + coefficients], axis=1),
        error=np.tile((np.concatenate(error) / limit + conversion).ravel(), 2),
        kind=np.tile((np.arange(components)[:, None] + components * on.trajectory).ravel(), 2),
        low=np.tile(on.low, 2 * components),
        high=np.tile(on.high, 2 * components),
    )
    minima = Minima.of(len(every))
    bounds.minimise(rows, layout, minima, lambda value, _: value, tolerance)
    return minima


def peaks(limited: list[Limited], minima: Minima) -> dict[str, float]:
    """Upper bounds of the largest ``|f| / limit`` of each quantity."""
    return {q.name: 1 - float(np.min(minima.bound[part])) for q, part in _parts(limited)}


def peak_times(limited: list[Limited], minima: Minima) -> dict[str, float]:
    """When each quantity is largest, s."""
    return {q.name: float(minima.time[part][np.argmin(minima.seen[part])]) for q, part in _parts(limited)}


def faults(limited: list[Limited], minima: Minima, allowance: float) -> Iterator[str]:
    """A sentence for each component that is not proved to stay within its limit and the allowance."""
    for quantity, part in _parts(limited):
        kind = quantity.of.quantity
        for component, limit, bound, seen, time in zip(
            quantity.components,
            quantity.limit,
            minima.bound[part],
            minima.seen[part],
            minima.time[part],
            strict=True,
        ):
            if bound >= -allowance:
                continue
            name = f"{quantity.name.replace('_', ' ')} {component}"
            if seen < -allowance:
                reached = f"{kind.in_unit(limit * (1 - seen)):.6g} {kind.unit}, {1 - seen:.8g} of its limit,"
                yield f"{name} reaches {reached} at t = {time:.6g} s"
            else:
                met = f"{1 - seen:.8g} of it was met at t = {time:.6g} s, the bound is {1 - bound:.8g}"
                yield f"{name} is not proved to keep its limit: {met}"


def _parts(limited: list[Limited]) -> Iterator[tuple[Limited, slice]]:
    """The quantities with the places of their components among all."""
    begin = 0
    for quantity in limited:
        yield quantity, slice(begin, begin + len(quantity.components))
        begin += len(quantity.components)


# Largest jump at a break and largest distance from a wanted state: rad, rad/s, rad/s^2, rad/s^3.
TOLERANCE = 1e-8
_PLATFORM = ("attitude", "angular_velocity", "angular_acceleration", "angular_jerk")
_JOINTS = ("joints", "joint_rates", "joint_accelerations", "joint_jerks")


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angle between attitudes (3, 3, ...), rad, exact when small: the norm is ``sqrt(8) sin(angle / 2)``."""
    distance = np.linalg.norm((first - second).reshape(9, *first.shape[2:]), axis=0)
    return 2 * np.arcsin(np.minimum(distance / np.sqrt(8), 1))


def jumps(samples: Samples) -> dict[str, np.ndarray]:
    """Jumps by the names and units of `Certificate.jumps`, (n,) each: from every interval to the next.

    From the last one it is to the first, so that there are two at least (see `motion`).
    """
    found = {_PLATFORM[0]: _apart(samples.attitude[..., -1], np.roll(samples.attitude[..., 0], -1, axis=-1))}
    for names, curves in ((_PLATFORM[1:], samples.spin), (_JOINTS, samples.joints)):
        steps = np.abs(curves[..., -1] - np.roll(curves[..., 0], -1, axis=-1)).max(axis=1, initial=0)
        found |= dict(zip(names, steps, strict=True))
    return found


def jump_faults(
    found: dict[str, np.ndarray], times: np.ndarray, smoothness: int, jerk_limited: bool
) -> Iterator[str]:
    """A sentence for each quantity that jumps though it must not.

    Args:
        found: (k,) each, the jumps of a trajectory.
        times: (k,) s, when they are.
        smoothness: number of derivatives that the trajectory claims to be continuous; rates must be anyway.
        jerk_limited: whether the spacecraft limits the jerk, so that the angular acceleration must not jump.
    """
    for name, steps in found.items():
        order = (_PLATFORM if name in _PLATFORM else _JOINTS).index(name)
        needed = max(smoothness, 2 if jerk_limited and name in _PLATFORM else 1)
        if order <= needed and not np.all(steps <= TOLERANCE):
            worst = int(np.argmax(steps))
            unit = "rad" + ("", "/s", "/s^2", "/s^3")[order]
            time = times[worst]
            yield f"there is a jump of {steps[worst]:.3g} {unit} in {_words(name)} at t = {time:.6g} s"


def end_faults(samples: Samples, name: str, end: EndState, instant: tuple[int, int]) -> Iterator[str]:
    """A sentence for each part of a wanted state that the trajectory misses.

    Args:
        samples: of the motion.
        name: of the state, for the sentences.
        end: the wanted state.
        instant: its interval, and its number there.
    """
    at = (..., *instant)
    rest = np.zeros(3), np.zeros(samples.joints.shape[1])
    wanted_spin = rest[0] if end.angular_velocity is None else end.angular_velocity
    wanted_rates = rest[1] if end.joint_rates is None else end.joint_rates
    misses = {
        "attitude": (_apart(samples.attitude[at], np.asarray(end.attitude)), "rad"),
        "angular_velocity": (np.abs(samples.spin[0][at] - wanted_spin), "rad/s"),
        "joints": (np.abs(samples.joints[0][at] - end.joints), "rad"),
        "joint_rates": (np.abs(samples.joints[1][at] - wanted_rates), "rad/s"),
    }
    for part, (miss, unit) in misses.items():
        if not np.all(miss <= TOLERANCE):
            yield f"the {name} is missed by {np.max(miss):.3g} {unit} in {_words(part)}"


def _words(name: str) -> str:
    return name.replace("_", " ")
