"""Proof of limits at every instant, of continuity at breaks, and of the wanted states at the ends.

**Limits** are on rates, accelerations, jerk, joint angles, torque and momentum, and on wheels (`wheels`).
Every limited quantity has components ``f`` that must stay within ``-limit`` and ``+limit``; angles of joints
count from the middle of their range, half of which is their limit. The margin of a component is
``1 - |f| / limit``, so that a peak over its limit is one minus the least margin. Of the length of a vector,
which is not smooth where it is zero, the square is sampled, and the margin is that of its root.

**Joins.** The samples of an interval include both of its ends, so the last of one and the first of the next
are the values left and right of the same instant.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.certificate import bounds, inertia, series, tube, wheels
from jaxplan.certificate.bounds import LEBESGUE, Evidence, Layout, Minima, Rows
from jaxplan.certificate.claims import EndState
from jaxplan.certificate.motion import DEGREE, Samples
from jaxplan.certificate.series import ROUNDING
from jaxplan.model.limits import Limit, limits
from jaxplan.model.robust import Robust
from jaxplan.model.spacecraft import Spacecraft

# Largest jump at a break and largest distance from a wanted state: rad, rad/s, rad/s^2, rad/s^3.
TOLERANCE = 1e-8
_PLATFORM = ("attitude", "angular_velocity", "angular_acceleration", "angular_jerk")
_JOINTS = ("joints", "joint_rates", "joint_accelerations", "joint_jerks")
_OF_JOINT = ("", "the rate of ", "the acceleration of ", "the jerk of ")
_UNITS = ("rad", "rad/s", "rad/s^2", "rad/s^3")


def tolerance(margin: np.ndarray) -> np.ndarray:
    """How close a bound must come to the least margin met: a twentieth of it, from 1e-10 to 5e-7."""
    return np.clip(np.abs(margin) / 20, 1e-10, 5e-7)


@dataclass(frozen=True, eq=False)
class Limited:
    """Samples of a limited quantity, in SI units: c components at m instants of each of n intervals.

    Attributes:
        limit: the limit, which gives names and unit.
        values: (c, n, m) samples less the centre of the range; of a length its square, so are the next two.
        left_out: (c, n) or (n,), bound of the error of the polynomials through the samples.
        rounding: (c, n) or (n,), size of the samples' rounding errors.
        bound: (c,) the limit of each component, positive.
    """

    limit: Limit
    values: np.ndarray
    left_out: np.ndarray
    rounding: np.ndarray
    bound: np.ndarray

    @property
    def name(self) -> str:
        """Its key in the certificate."""
        return self.limit.quantity.name

    @property
    def scale(self) -> np.ndarray:
        """(c,) the value of the samples at the limit: the bound, or its square for a length."""
        return self.bound**2 if self.limit.quantity.of_length else self.bound


def quantities(
    spacecraft: Spacecraft,
    evidence: Evidence,
    robust: Robust | None = None,
    claimed: frozenset[str] | None = None,
) -> list[Limited]:
    """Samples of the quantities that the spacecraft limits, in the order of the certificate.

    Their bounds are what errors and reserve leave of the limits. Those whose names are not `claimed` are left
    out; None for none of them.
    """
    found = []
    for limit in limits(spacecraft):
        if claimed is not None and limit.quantity.name not in claimed:
            continue
        values, left_out, rounding = _SAMPLED[limit.quantity.name](evidence, spacecraft)
        if limit.quantity.of_wheels:
            bound = wheels.bounds(spacecraft, limit.quantity.name)
        else:
            bound = np.full(len(limit.owners), np.asarray(limit.quantity.given(spacecraft), np.float64))
        if limit.quantity.centre is not None:
            values = values - np.asarray(limit.quantity.centre(spacecraft), np.float64)[:, None, None]
        bound = tube.left(robust, limit.quantity.name, bound)
        found.append(Limited(limit, values, left_out, rounding, bound))
    return found


_Sampled = Sequence[np.ndarray]  # values, what is left out, and rounding


def _spin(evidence: Evidence, derivative: int) -> _Sampled:
    """The angular velocity, body axes, or its derivative of order `derivative` (0 the velocity itself)."""
    return [part.spin[derivative] for part in (evidence.samples, evidence.left_out, evidence.rounding)]


def _square(evidence: Evidence, derivative: int) -> _Sampled:
    """Samples of the squared norm of the angular velocity, or of a derivative of it, with error bounds.

    Args:
        evidence: samples and bounds of the motion.
        derivative: order of the derivative; 0 for the angular velocity itself.

    Returns:
        Values, bound of the truncation error, and bound of the rounding error.
    """
    values, _, rounding = _spin(evidence, derivative)
    size = evidence.majorants.spin
    for _ in range(derivative):
        size = series.slope(size)
    unit = evidence.on.half ** (derivative + 1)
    left_out = 2.0 ** (1 - DEGREE) * series.product("n,n->n", size, size)[DEGREE + 1] / unit**2
    return np.sum(values * values, axis=0)[None], left_out, 2 * size[0] / unit * rounding


def _joints(evidence: Evidence, derivative: int, some: slice = slice(None)) -> _Sampled:
    """Joint angles, rad, or their derivative of order `derivative` (0 the angles); `some` selects joints."""
    parts = evidence.samples, evidence.left_out, evidence.rounding
    return [part.joints[derivative, some] for part in parts]


def _torque(evidence: Evidence, spacecraft: Spacecraft) -> _Sampled:
    """The torque ``L' + w x L``, N m, body axes."""
    momentum, _, of_momentum = inertia.momentum(evidence, spacecraft)
    change, left_out, rounding = inertia.change(evidence, spacecraft)
    torque = change + np.cross(evidence.samples.spin[0], momentum, axis=0)
    speed, half = evidence.majorants.spin, evidence.on.half
    carried = inertia.majorant(evidence.majorants, spacecraft)
    crossed = series.product("n,n->n", speed, carried)[DEGREE + 1] / half**2
    rounding = rounding + speed[0] / half * of_momentum + carried[0] / half * evidence.rounding.spin[0]
    return torque, left_out + 2.0 ** (1 - DEGREE) * crossed, rounding


# The certificate's own formula for every quantity; a limit on another one cannot be proved.
_SAMPLED: dict[str, Callable[[Evidence, Spacecraft], _Sampled]] = {
    "angular_velocity": lambda evidence, _: _spin(evidence, 0),
    "angular_acceleration": lambda evidence, _: _spin(evidence, 1),
    "angular_velocity_norm": lambda evidence, _: _square(evidence, 0),
    "angular_acceleration_norm": lambda evidence, _: _square(evidence, 1),
    "joint_rates": lambda evidence, _: _joints(evidence, 1),
    "joint_accelerations": lambda evidence, _: _joints(evidence, 2),
    "yaw": lambda evidence, craft: _joints(evidence, 0, slice(None, len(craft.terminals))),
    "pitch": lambda evidence, craft: _joints(
        evidence, 0, slice(len(craft.terminals), 2 * len(craft.terminals))
    ),
    "drive": lambda evidence, craft: _joints(evidence, 0, slice(2 * len(craft.terminals), None)),
    "torque": _torque,
    "wheel_momentum": inertia.momentum,
    "jerk": lambda evidence, _: _spin(evidence, 2),
    "wheel_torques": wheels.torques,
    "wheel_momenta": wheels.momenta,
}


def prove(limited: Sequence[Limited], evidence: Evidence) -> Minima:
    """Bound the least of ``1 - |f| / limit`` over all time.

    Returns:
        The minima, a clause each for the components of all quantities in turn, trajectory by trajectory; none
        where no quantity is limited.
    """
    if not limited:
        return Minima.of(0)
    on, limit = evidence.on, np.concatenate([q.scale for q in limited])[:, None]
    ratio = np.concatenate([q.values for q in limited]) / limit[..., None]
    error = [np.broadcast_to(q.left_out + LEBESGUE * q.rounding, q.values.shape[:2]) for q in limited]
    conversion = ROUNDING * bounds.growth(DEGREE) * np.abs(ratio).max(axis=2)
    coefficients = bounds.to_rows(ratio.reshape(-1, DEGREE + 1))
    components, owner = len(limit), np.arange(len(on.begins) - 1)[:, None]
    every = np.ones(owner.size * components, dtype=bool)
    quantity = np.repeat(np.arange(len(limited)), [len(q.values) for q in limited])
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
    squared = np.concatenate([np.full(len(q.values), q.limit.quantity.of_length) for q in limited])

    def margin(value: np.ndarray, kind: np.ndarray) -> np.ndarray:
        if not squared.any():
            return value
        return np.where(squared[kind % components], 1 - np.sqrt(np.maximum(1 - value, 0)), value)

    minima = Minima.of(len(every))
    bounds.minimise(rows, layout, minima, margin, tolerance)
    return minima


def peaks(limited: Sequence[Limited], minima: Minima) -> dict[str, tuple[float, float]]:
    """Upper bound of the largest ``|f| / limit`` of each quantity, by name, and the time of it, s.

    `minima` are those of one trajectory.
    """
    found, begin = {}, 0
    for quantity in limited:
        own = slice(begin, begin + len(quantity.bound))
        begin, time = own.stop, minima.time[own][minima.seen[own].argmin()]
        found[quantity.name] = 1 - float(minima.bound[own].min()), float(time)
    return found


def faults(
    limited: Sequence[Limited],
    minima: Minima,
    allowance: float,
    times: np.ndarray,
    intervals: slice = slice(None),
) -> Iterator[str]:
    """Yield a sentence for each component that is not proved to keep its limit.

    Args:
        limited: the quantities.
        minima: those of one trajectory.
        allowance: the share of the limit by which it may be passed.
        times: (n, m) s, of the samples in its n intervals.
        intervals: which these are among those of `limited`.
    """
    components = [
        (one.limit.quantity, owner, limit, one, place)
        for one in limited
        for place, (owner, limit) in enumerate(zip(one.limit.owners, one.bound, strict=True))
    ]
    for number in np.flatnonzero(~(minima.bound >= -allowance)).tolist():
        quantity, owner, limit, one, place = components[number]
        bound, seen, time = minima.bound[number], minima.seen[number], minima.time[number]
        if one.limit.centre is not None:
            side = np.copysign(limit, _at(one.values[place, intervals], times, time))
            seen_broken = seen < -allowance
            reached = one.limit.centre[place] + side * (1 - np.array([seen, bound, 0]))
            yield _of_range(f"{_single(quantity.name)} of {owner}", reached, side > 0, time, seen_broken)
            continue
        of_devices = quantity.of_joints or quantity.of_wheels
        name = f"{_words(quantity.name)} about {owner}"
        if of_devices:
            name = f"{_single(quantity.name)} of {'the ' * owner.startswith('array across')}{owner}"
        if quantity.of_length:
            name = f"the length of the {_words(quantity.name.removesuffix('_norm'))}"
        if seen < -allowance:
            value = f"{quantity.in_unit(limit * (1 - seen)):.6g} {quantity.unit}"
            yield f"{name} reaches {value}, {_share(1 - seen)} of its limit, at t = {time:.6g} s"
        else:
            met = f"{_share(1 - seen)} of it was met at t = {time:.6g} s, the bound is {_share(1 - bound)}"
            yield f"{name} is not proved to keep its limit: {met}"


def _at(values: np.ndarray, times: np.ndarray, time: float) -> float:
    """The value at a time, s, of polynomials through values (n, m) at Chebyshev extrema, times (n, m) s."""
    own = max(int(np.searchsorted(times[:, 0], time, side="right")) - 1, 0)
    apart = time - times[own]
    nearest = int(np.argmin(np.abs(apart)))
    if apart[nearest] == 0:
        return float(values[own, nearest])
    weights = np.where(np.arange(len(apart)) % 2, -1.0, 1.0) / apart  # barycentric
    weights[[0, -1]] /= 2
    return float(weights @ values[own] / weights.sum())


def _of_range(name: str, angles: np.ndarray, upper: bool, time: float, met: bool) -> str:
    """A sentence on an angle that is not proved to stay within its range.

    Args:
        name: of the angle.
        angles: (3,) rad, the one met farthest out, the bound that was proved, and the end of the range.
        upper: whether that is the upper end.
        time: s, when it was met.
        met: whether the one met is beyond the end, and not the bound alone.
    """
    reached, bound, end = np.rad2deg(angles).tolist()
    apart = abs((reached if met else bound) - end)
    places = int(np.clip(2 - np.floor(np.log10(apart)), 2, 12)) if 0 < apart < np.inf else 2
    reached, bound, end = (f"{own:.{places}f}".rstrip("0").rstrip(".") for own in (reached, bound, end))
    most = f"of at {'most' if upper else 'least'} {end} deg"
    if met:
        return f"{name} reaches {reached} deg, {most}, at t = {time:.6g} s"
    seen = f"{reached} deg was met at t = {time:.6g} s, {most}, and the bound is {bound} deg"
    return f"{name} is not proved to stay in its range: {seen}"


def _share(value: float) -> str:
    """Text of a share of a limit, with three digits of its difference from one, or two places."""
    apart = abs(value - 1)
    places = 2 if not 0 < apart < 1 else 2 + max(0, int(np.ceil(-np.log10(apart))))
    return f"{value:.{min(places, 15)}f}".rstrip("0").rstrip(".") if np.isfinite(value) else f"{value}"


def _single(name: str) -> str:
    """Words for the name of a quantity of joints or wheels, of one of them: "joint rate"."""
    return "wheel momentum" if name == "wheel_momenta" else _words(name).removesuffix("s")


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angle (...) rad between attitudes (3, 3, ...), exact when small.

    The norm of their difference is ``sqrt(8) sin(angle / 2)``.
    """
    distance = np.linalg.norm((first - second).reshape(9, *first.shape[2:]), axis=0)
    return 2 * np.arcsin(np.minimum(distance / np.sqrt(8), 1))


def jumps(samples: Samples) -> dict[str, np.ndarray]:
    """Jumps (n, c) of c components from each of n intervals to the next, by the names of `Certificate.jumps`.

    The last one is from the last interval to the first, so that there are two at least (see `motion`).
    """
    turn = _apart(samples.attitude[..., -1], np.roll(samples.attitude[..., 0], -1, axis=-1))
    found = {_PLATFORM[0]: turn[:, None]}
    for names, curves in ((_PLATFORM[1:], samples.spin), (_JOINTS, samples.joints)):
        steps = np.abs(curves[..., -1] - np.roll(curves[..., 0], -1, axis=-1))
        found |= dict(zip(names, np.swapaxes(steps, 1, 2), strict=True))
    return found


def jump_faults(
    found: dict[str, np.ndarray],
    times: np.ndarray,
    smoothness: int,
    jerk_limited: bool,
    joint_names: Sequence[str],
    continuous: int = 1,
) -> Iterator[str]:
    """Yield a message for each quantity that is discontinuous although it must be continuous.

    Args:
        found: by name of a quantity its jumps (k, c) at the breaks, a column a component.
        times: (k,) s, of the breaks.
        smoothness: number of derivatives that the trajectory claims to be continuous.
        jerk_limited: whether the spacecraft limits the platform's jerk: its attitude must then have two
            continuous derivatives, whatever `continuous` says.
        joint_names: one a joint.
        continuous: number of derivatives that must be continuous whatever the trajectory claims.
    """
    for name, steps in found.items():
        of_platform = name in _PLATFORM
        order = (_PLATFORM if of_platform else _JOINTS).index(name)
        needed = max(smoothness, 2 if jerk_limited and of_platform else continuous)
        if order <= needed and not (steps <= TOLERANCE).all():
            worst, component = divmod(int(np.argmax(steps)), steps.shape[1])
            size = f"{steps[worst, component]:.3g} {_UNITS[order]}"
            if of_platform:
                where = f"{_words(name)} of the platform"
            else:
                where = f"{_OF_JOINT[order]}{joint_names[component]}"
            yield f"there is a jump of {size} in {where} at t = {times[worst]:.6g} s"


def end_faults(samples: Samples, name: str, end: EndState, instant: tuple[int, int]) -> Iterator[str]:
    """Yield a sentence for each part of a wanted state that the trajectory misses.

    Args:
        samples: of the motion.
        name: of the state, for the sentences.
        end: the wanted state.
        instant: number of the interval, and of the sample there, at which it must be.
    """
    at = (..., *instant)
    velocity = 0.0 if end.angular_velocity is None else end.angular_velocity
    rates = 0.0 if end.joint_rates is None else end.joint_rates
    misses = {
        "rad in attitude": _apart(samples.attitude[at], np.asarray(end.attitude)),
        "rad/s in angular velocity": np.abs(samples.spin[0][at] - velocity),
        "rad in joints": np.abs(samples.joints[0][at] - end.joints),
        "rad/s in joint rates": np.abs(samples.joints[1][at] - rates),
    }
    for part, miss in misses.items():
        if not (miss <= TOLERANCE).all():
            yield f"the {name} is missed by {np.max(miss):.3g} {part}"


def _words(name: str) -> str:
    """A name with spaces for underscores."""
    return name.replace("_", " ")
