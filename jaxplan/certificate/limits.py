"""Proof of limits at every instant, of continuity at breaks, and of the wanted states at the ends.

**Limits** are on rates, accelerations, jerk, joint angles, torque and momentum, and on wheels (`wheels`).
Every limited quantity has components ``f`` that must stay between ``-limit`` and ``+limit``. Joint angles are
measured from the middle of their range, and half of the range is their limit. The *margin* of a component is
``1 - |f| / limit``, dimensionless and positive within the limit; the *peak* of a quantity is one minus its
least margin. The length of a vector is not smooth where it is zero, so its square is sampled; the margin is
still that of the length.

**Joins.** The samples of an interval include both of its ends. So the last sample of one interval and the
first of the next are the values just before and just after the same instant.
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
_PLATFORM_QUANTITIES = ("attitude", "angular_velocity", "angular_acceleration", "angular_jerk")
_JOINT_QUANTITIES = ("joints", "joint_rates", "joint_accelerations", "joint_jerks")
_JOINT_PREFIXES = ("", "the rate of ", "the acceleration of ", "the jerk of ")
_DERIVATIVE_UNITS = ("rad", "rad/s", "rad/s^2", "rad/s^3")


def tolerance(margin: np.ndarray) -> np.ndarray:
    """Return how close a bound must come to the least margin met: a twentieth of that, from 1e-10 to 5e-7."""
    return np.clip(np.abs(margin) / 20, 1e-10, 5e-7)


@dataclass(frozen=True, eq=False)
class Limited:
    """Samples of a limited quantity, in SI units: c components at m instants of each of n intervals.

    For the length of a vector, values, left_out and rounding are those of its square.

    Attributes:
        limit: the limit, with the quantity's name and unit.
        values: (c, n, m) samples, from which the centre of the range has been subtracted.
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
        """Name of the quantity, its key in the certificate."""
        return self.limit.quantity.name

    @property
    def scale(self) -> np.ndarray:
        """(c,) largest value that `values` may have: the bound, or its square for the length of a vector."""
        return self.bound**2 if self.limit.quantity.of_length else self.bound


def quantities(
    spacecraft: Spacecraft,
    evidence: Evidence,
    robust: Robust | None = None,
    claimed: frozenset[str] | None = None,
) -> list[Limited]:
    """Sample the quantities that a spacecraft limits, in the order of `jaxplan.model.limits.QUANTITIES`.

    Args:
        spacecraft: whose limits are meant.
        evidence: samples of the motion with error bounds.
        robust: errors and reserves that are taken off the limits; None for none.
        claimed: names of the quantities to take; None for all that are limited.
    """
    found = []
    for limit in limits(spacecraft):
        if claimed is not None and limit.quantity.name not in claimed:
            continue
        values, left_out, rounding = _SAMPLERS[limit.quantity.name](evidence, spacecraft)
        if limit.quantity.of_wheels:
            bound = wheels.bounds(spacecraft, limit.quantity.name)
        else:
            bound = np.full(len(limit.owners), np.asarray(limit.quantity.given(spacecraft), np.float64))
        if limit.quantity.centre is not None:
            values = values - np.asarray(limit.quantity.centre(spacecraft), np.float64)[:, None, None]
        bound = tube.left(robust, limit.quantity.name, bound)
        found.append(Limited(limit, values, left_out, rounding, bound))
    return found


# Samples, bound of the interpolation error, size of the rounding error.
_SamplesWithErrors = Sequence[np.ndarray]


def _sample_spin(evidence: Evidence, derivative: int) -> _SamplesWithErrors:
    """Angular velocity in body axes (`derivative` 0), or its derivative of that order, with error bounds."""
    return [part.spin[derivative] for part in (evidence.samples, evidence.left_out, evidence.rounding)]


def _sample_squared_spin(evidence: Evidence, derivative: int) -> _SamplesWithErrors:
    """Squared norm of the angular velocity (`derivative` 0), or of its derivative of that order.

    Returns:
        Samples (1, n, m); bound of the interpolation error (n,); size of the rounding error (n,).
    """
    values, _, rounding = _sample_spin(evidence, derivative)
    size = evidence.majorants.spin
    for _ in range(derivative):
        size = series.slope(size)
    unit = evidence.on.half ** (derivative + 1)
    left_out = 2.0 ** (1 - DEGREE) * series.product("n,n->n", size, size)[DEGREE + 1] / unit**2
    return np.sum(values * values, axis=0)[None], left_out, 2 * size[0] / unit * rounding


def _sample_joints(evidence: Evidence, derivative: int, some: slice = slice(None)) -> _SamplesWithErrors:
    """Angles of `some` joints, rad (`derivative` 0), or their derivative of that order, with error bounds."""
    parts = evidence.samples, evidence.left_out, evidence.rounding
    return [part.joints[derivative, some] for part in parts]


def _sample_torque(evidence: Evidence, spacecraft: Spacecraft) -> _SamplesWithErrors:
    """Torque ``L' + w x L`` in body axes, N m, with error bounds."""
    momentum, _, of_momentum = inertia.momentum(evidence, spacecraft)
    change, left_out, rounding = inertia.change(evidence, spacecraft)
    torque = change + inertia.cross(evidence.samples.spin[0], momentum)
    speed, half = evidence.majorants.spin, evidence.on.half
    carried = inertia.majorant(evidence.majorants, spacecraft)
    crossed = series.product("n,n->n", speed, carried)[DEGREE + 1] / half**2
    rounding = rounding + speed[0] / half * of_momentum + carried[0] / half * evidence.rounding.spin[0]
    return torque, left_out + 2.0 ** (1 - DEGREE) * crossed, rounding


# How the certificate samples each quantity; a limit on any other could not be proved.
_SAMPLERS: dict[str, Callable[[Evidence, Spacecraft], _SamplesWithErrors]] = {
    "angular_velocity": lambda evidence, _: _sample_spin(evidence, 0),
    "angular_acceleration": lambda evidence, _: _sample_spin(evidence, 1),
    "angular_velocity_norm": lambda evidence, _: _sample_squared_spin(evidence, 0),
    "angular_acceleration_norm": lambda evidence, _: _sample_squared_spin(evidence, 1),
    "joint_rates": lambda evidence, _: _sample_joints(evidence, 1),
    "joint_accelerations": lambda evidence, _: _sample_joints(evidence, 2),
    "yaw": lambda evidence, craft: _sample_joints(evidence, 0, slice(None, len(craft.terminals))),
    "pitch": lambda evidence, craft: _sample_joints(
        evidence, 0, slice(len(craft.terminals), 2 * len(craft.terminals))
    ),
    "drive": lambda evidence, craft: _sample_joints(evidence, 0, slice(2 * len(craft.terminals), None)),
    "torque": _sample_torque,
    "wheel_momentum": inertia.momentum,
    "jerk": lambda evidence, _: _sample_spin(evidence, 2),
    "wheel_torques": wheels.torques,
    "wheel_momenta": wheels.momenta,
}


def prove(limited: Sequence[Limited], evidence: Evidence) -> Minima:
    """Bound the least margin ``1 - |f| / limit`` of every component over all time.

    Returns:
        Minima with a clause for each component, all quantities of the first trajectory first, then those of
        the next. Empty where no quantity is limited.
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
    """Return, by name, an upper bound of each quantity's largest ``|f| / limit`` and its time, s.

    Args:
        limited: the quantities.
        minima: those of a single trajectory.
    """
    found, begin = {}, 0
    for quantity in limited:
        own = slice(begin, begin + len(quantity.bound))
        begin, time = own.stop, minima.time[own][np.argmin(minima.seen[own])]
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
        minima: those of a single trajectory.
        allowance: fraction of the limit by which it may be exceeded.
        times: (n, m) s, times of the samples in the trajectory's n intervals.
        intervals: where these intervals are among those of `limited`.
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
            side = np.copysign(limit, _interpolate_at(one.values[place, intervals], times, time))
            seen_broken = seen < -allowance
            reached = one.limit.centre[place] + side * (1 - np.array([seen, bound, 0]))
            yield _range_fault(
                f"{_singular_name(quantity.name)} of {owner}", reached, side > 0, time, seen_broken
            )
            continue
        of_devices = quantity.of_joints or quantity.of_wheels
        name = f"{_to_words(quantity.name)} about {owner}"
        if of_devices:
            name = f"{_singular_name(quantity.name)} of {'the ' * owner.startswith('array across')}{owner}"
        if quantity.of_length:
            name = f"the length of the {_to_words(quantity.name.removesuffix('_norm'))}"
        if seen < -allowance:
            value = f"{quantity.in_unit(limit * (1 - seen)):.6g} {quantity.unit}"
            yield f"{name} reaches {value}, {_format_share(1 - seen)} of its limit, at t = {time:.6g} s"
        else:
            met = (
                f"{_format_share(1 - seen)} of it was met at t = {time:.6g} s, "
                f"the bound is {_format_share(1 - bound)}"
            )
            yield f"{name} is not proved to keep its limit: {met}"


def _interpolate_at(values: np.ndarray, times: np.ndarray, time: float) -> float:
    """Interpolate values (n, m), given at Chebyshev extrema of n intervals, times (n, m) s, at one time."""
    own = max(int(np.searchsorted(times[:, 0], time, side="right")) - 1, 0)
    apart = time - times[own]
    nearest = int(np.argmin(np.abs(apart)))
    if apart[nearest] == 0:
        return float(values[own, nearest])
    weights = np.where(np.arange(len(apart)) % 2, -1.0, 1.0) / apart  # barycentric
    weights[[0, -1]] /= 2
    return float(weights @ values[own] / weights.sum())


def _range_fault(name: str, angles: np.ndarray, upper: bool, time: float, met: bool) -> str:
    """Return a sentence on an angle that is not proved to stay within its range.

    Args:
        name: name of the angle.
        angles: (3,) rad: the angle met nearest to or farthest beyond the end of the range, the bound that was
            proved, and that end.
        upper: whether it is the upper end.
        time: s, when that angle was met.
        met: whether the angle met is itself beyond the end; else only the bound is.
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


def _format_share(value: float) -> str:
    """Format a value over its limit, with enough digits to show how it differs from one."""
    apart = abs(value - 1)
    places = 2 if not 0 < apart < 1 else 2 + max(0, int(np.ceil(-np.log10(apart))))
    return f"{value:.{min(places, 15)}f}".rstrip("0").rstrip(".") if np.isfinite(value) else f"{value}"


def _singular_name(name: str) -> str:
    """Turn the name of a quantity of joints or wheels into words for a single one, as in "joint rate"."""
    return "wheel momentum" if name == "wheel_momenta" else _to_words(name).removesuffix("s")


def _angle_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the angles (...) rad between attitudes (3, 3, ...), accurate also when small.

    The norm of the difference of two rotation matrices is ``sqrt(8) sin(angle / 2)``.
    """
    distance = np.linalg.norm((first - second).reshape(9, *first.shape[2:]), axis=0)
    return 2 * np.arcsin(np.minimum(distance / np.sqrt(8), 1))


def jumps(samples: Samples) -> dict[str, np.ndarray]:
    """Return absolute jumps (n, c) of c components from each of n intervals to the next.

    The keys are those of `Certificate.jumps`; the attitude's jump is an angle. The last row is from the last
    interval to the first and has no meaning; with it there are two rows at least (see `motion`).
    """
    turn = _angle_between(samples.attitude[..., -1], np.roll(samples.attitude[..., 0], -1, axis=-1))
    found = {_PLATFORM_QUANTITIES[0]: turn[:, None]}
    for names, curves in ((_PLATFORM_QUANTITIES[1:], samples.spin), (_JOINT_QUANTITIES, samples.joints)):
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
    """Yield a sentence for each quantity that has a jump although it must be continuous.

    Args:
        found: for each name of a quantity its jumps (k, c) at k breaks, a column for each component.
        times: (k,) s, times of the breaks.
        smoothness: number of derivatives that the trajectory claims to be continuous.
        jerk_limited: whether the spacecraft limits the platform's jerk: its attitude must then have two
            continuous derivatives, whatever `continuous` says.
        joint_names: a name for each joint.
        continuous: number of derivatives that must be continuous whatever the trajectory claims.
    """
    for name, steps in found.items():
        of_platform = name in _PLATFORM_QUANTITIES
        order = (_PLATFORM_QUANTITIES if of_platform else _JOINT_QUANTITIES).index(name)
        needed = max(smoothness, 2 if jerk_limited and of_platform else continuous)
        if order <= needed and not (steps <= TOLERANCE).all():
            worst, component = divmod(int(np.argmax(steps)), steps.shape[1])
            size = f"{steps[worst, component]:.3g} {_DERIVATIVE_UNITS[order]}"
            if of_platform:
                where = f"{_to_words(name)} of the platform"
            else:
                where = f"{_JOINT_PREFIXES[order]}{joint_names[component]}"
            yield f"there is a jump of {size} in {where} at t = {times[worst]:.6g} s"


def end_faults(samples: Samples, name: str, end: EndState, instant: tuple[int, int]) -> Iterator[str]:
    """Yield a sentence for each part of a wanted state that the trajectory misses by more than `TOLERANCE`.

    Args:
        samples: samples of the motion.
        name: name of the state, such as "goal", for the sentences.
        end: the wanted state.
        instant: index of the interval, and of the sample in it, at which the state is wanted.
    """
    at = (..., *instant)
    velocity = 0.0 if end.angular_velocity is None else end.angular_velocity
    rates = 0.0 if end.joint_rates is None else end.joint_rates
    misses = {
        "rad in attitude": _angle_between(samples.attitude[at], np.asarray(end.attitude)),
        "rad/s in angular velocity": np.abs(samples.spin[0][at] - velocity),
        "rad in joints": np.abs(samples.joints[0][at] - end.joints),
        "rad/s in joint rates": np.abs(samples.joints[1][at] - rates),
    }
    for part, miss in misses.items():
        if not (miss <= TOLERANCE).all():
            yield f"the {name} is missed by {np.max(miss):.3g} {part}"


def _to_words(name: str) -> str:
    """Replace underscores in a name by blanks."""
    return name.replace("_", " ")
