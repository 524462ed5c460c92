"""Measures of a trajectory that can be differentiated: peaks, effort, margins, and the stretch to the limits.

Extremes are over continuous time: about the highest of many samples, samples are taken at ever finer spacing.
The time of the extreme, as a share of the duration, is held, so derivatives are those of the quantity at that
time (the envelope theorem); where two peaks are equally high it is that of one of them. A peak narrower than
the samples may be missed: that a trajectory is safe is for the certificate to say, not for these numbers.

A trajectory of numpy arrays gives numbers of 64 bits, whatever JAX is set to; one of JAX arrays, traced or
not, gives numbers of their precision.

A plan may stand for its trajectory, also that of a timeline; then its own spacecraft and zones are meant
where none are told.
"""

from collections.abc import Callable
from functools import cache, partial, wraps
from inspect import signature
from typing import Any, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import arrays
from jaxplan.model.constraints import Constraints, constraint_margins, state_margins
from jaxplan.model.limits import timed_limits
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheel_shares import wheel_loads
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.jit import is_traced, quick_jit
from jaxplan.runtime.linear import linear_map
from jaxplan.trajectory.curve import Samples, Trajectory, evaluate, total_momentum
from jaxplan.trajectory.peaks import SAFETY
from jaxplan.trajectory.spectrum import expect_frequencies, magnitude, transform

Quantity = Callable[[Samples], Array]
Given = ParamSpec("Given")
Out = TypeVar("Out")

_EACH, _ALL = 12, 600  # least numbers of samples on a piece and on a trajectory
_GAUSS = 12  # samples on a piece for an integral
_LOOKS = 4  # rounds of samples: the first over the whole trajectory, the next about the extreme, ever finer


_MEASURES: dict[str, Callable[..., Array]] = {}  # the undecorated functions by name
_OF_ARRAYS: set[str] = set()  # names of those that are no single number

# Arguments that a plan's scene has: their classes, and functions that find them.
_OF_SCENES: dict[str, tuple[type, Callable[[Any], Any]]] = {
    "craft": (Spacecraft, lambda scene: scene.spacecraft),
    "cones": (Constraints, lambda scene: scene.constraints),
}

Chosen = tuple[tuple[str, Any], ...]  # names and values of arguments that are no numbers


def _measured(name: str, chosen: Chosen, given: dict[str, Any]) -> Array:
    """The measure of this name, of its arguments that are no numbers and of those that are."""
    return _MEASURES[name](**given, **dict(chosen))


def _measured_with_slopes(name: str, chosen: Chosen, given: dict[str, Any]) -> tuple[Array, Any]:
    """`_measured` and its gradient in the numbers, a tree like `given`."""
    return jax.value_and_grad(partial(_measured, name, chosen), allow_int=True)(given)


def _is_real(leaf: Any) -> bool:
    """Whether a number can be differentiated: floating-point ones."""
    return bool(jnp.issubdtype(jnp.result_type(leaf), jnp.floating))


def _by_numbers(name: str, chosen: Chosen, given: dict[str, Any]) -> tuple[Callable[..., Array], list[Any]]:
    """`_measured` as a function of those numbers that can be differentiated, and these, leaves in order."""

    def measured(numbers: list[Any]) -> Array:
        left = iter(numbers)
        own = jax.tree.map(lambda leaf: next(left) if _is_real(leaf) else leaf, given)
        return _measured(name, chosen, own)

    return measured, list(filter(_is_real, jax.tree.leaves(given)))


@partial(quick_jit, level=0, static_argnums=(0, 1))
def _pushed(name: str, chosen: Chosen, given: dict[str, Any], way: list[Any]) -> Array:
    """The derivative of a measure along tangents `way` of its numbers, see `_by_numbers`."""
    measured, numbers = _by_numbers(name, chosen, given)
    return jax.jvp(measured, (numbers,), (way,))[1]


@partial(quick_jit, level=0, static_argnums=(0, 1))
def _pulled(name: str, chosen: Chosen, given: dict[str, Any], cotangents: Array) -> list[Any]:
    """The product of cotangents with a measure's derivatives by its numbers, see `_by_numbers`."""
    measured, numbers = _by_numbers(name, chosen, given)
    (slopes,) = jax.vjp(measured, numbers)[1](cotangents)
    return list(slopes)


@cache
def _slopes(name: str, chosen: Chosen) -> Callable[..., list[Array]]:
    """The derivative of a measure that is an array, as a linear map of tangents of its numbers."""
    return linear_map(
        f"slopes of {name}",
        lambda given, way: [_pushed(name, chosen, given, list(way))],
        lambda given, cotangents: _pulled(name, chosen, given, *cotangents),
    )


_value = quick_jit(_measured, level=0, static_argnums=(0, 1))
_value_with_slopes = quick_jit(_measured_with_slopes, level=0, static_argnums=(0, 1))
_followed = jax.custom_jvp(_measured, nondiff_argnums=(0, 1))


@_followed.defjvp
def _follow(name: str, chosen: Chosen, own: tuple[Any], ways: tuple[Any]) -> tuple[Array, Array]:
    """The rule of `_followed` for tangents `ways`: outside traces by the kernel for value and gradient."""
    if is_traced(own):
        return jax.jvp(partial(_measured, name, chosen), own, ways)
    if name in _OF_ARRAYS:  # a gradient of each entry would be much for one number that is made of them
        found, leaves = _value(name, chosen, *own), map(jax.tree.leaves, (own, ways))
        way = [way for leaf, way in zip(*leaves, strict=True) if _is_real(leaf)]
        return found, _slopes(name, chosen)(*own, way, [found])[0]
    found, slopes = _value_with_slopes(name, chosen, *own)
    return found, _along(slopes, *ways)


def _at_once(
    *choices: str, of_arrays: bool = False
) -> Callable[[Callable[Given, Array]], Callable[Given, Array]]:
    """Make a decorator that runs a measure, and its gradient, as one jitted kernel each outside traces.

    Otherwise `jax.grad` would compile a kernel for each of the hundreds of operations that they take.

    Args:
        choices: names of the arguments that are no numbers.
        of_arrays: whether the measure is an array and no single number.
    """

    def decorate(measure: Callable[Given, Array]) -> Callable[Given, Array]:
        name, parameters = measure.__name__, signature(measure)
        _MEASURES[name] = measure
        if of_arrays:
            _OF_ARRAYS.add(name)

        @wraps(measure)
        def at_once(*args: Given.args, **kwargs: Given.kwargs) -> Array:
            bound = parameters.bind(*args, **kwargs)
            bound.apply_defaults()
            given = dict(bound.arguments)
            chosen = tuple((choice, given.pop(choice)) for choice in choices)
            if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(given)):
                return (_followed if is_traced(given) else _value)(name, chosen, given)
            with jax.enable_x64(True):
                return np.asarray(_value(name, chosen, given))[()]  # type: ignore[return-value]

        return at_once

    return decorate


@jax.jit
def _along(slopes: Any, ways: Any) -> Array:
    """Derivative along a change `ways` of all numbers of a tree, from the gradient `slopes` in them."""
    pairs = zip(jax.tree.leaves(slopes), jax.tree.leaves(ways), strict=True)
    return sum(
        (jnp.sum(slope * way) for slope, way in pairs if slope.dtype != jax.dtypes.float0), jnp.zeros(())
    )


def _of_plans(measure: Callable[..., Out]) -> Callable[..., Out]:
    """Make a measure of a trajectory, its first argument, one of a plan, too.

    Of a plan ``craft`` and ``cones`` may be left out.
    """
    parameters = signature(measure)
    wanted = [name for name in _OF_SCENES if name in parameters.parameters]

    @wraps(measure)
    def of_plans(*args: Any, **kwargs: Any) -> Out:
        given = dict(parameters.bind_partial(*args, **kwargs).arguments)
        plan = given.get("trajectory")
        if plan is not None and not isinstance(plan, Trajectory):
            given["trajectory"] = _trajectory_of(plan)
            scene = getattr(plan, "scenario", getattr(plan, "scene", None))
            for name in wanted:
                given.setdefault(name, _OF_SCENES[name][1](scene))
        for name in wanted:
            if name in given:
                kind = _OF_SCENES[name][0]
                hint = f"of a plan {name} may be left out, and what comes after is told by its name"
                expect(name, given[name], kind, hint)
        return measure(**given)

    return of_plans


def _trajectory_of(plan: object) -> Trajectory:
    """The trajectory of a plan.

    Raises:
        TypeError: if it is none.
        ValueError: if the plan has no trajectory.
    """
    found = getattr(plan, "trajectory", plan)
    if found is None:
        ending = getattr(getattr(plan, "status", None), "name", "without one")
        raise ValueError(f"trajectory: the plan has none, it ended as {ending}")
    if isinstance(found, Trajectory):
        return found
    return expect("trajectory", plan, Trajectory, "a plan may stand for its own")


def time_factors(samples: Samples, craft: Spacecraft, total: Array | None = None) -> Array:
    """Factors on the duration at which the limit that a motion uses most would just be kept.

    Args:
        samples: at (k,) times.
        craft: its limits.
        total: (3,) N m s, total momentum in inertial axes; None without wheels.

    Returns:
        (k,): magnitudes over limits, each to one over the power of the time scaling by which it falls; the
        largest of all components of all limits. NaN where one of them is NaN, infinite where slowing down
        does not help.
    """
    motion = samples.kinematics(craft, total)
    factors = [limit.time_factors(motion) for group in timed_limits(craft) for limit in group]
    return _largest_of(jnp.moveaxis(jnp.concatenate(factors), 0, -1))


def torque(samples: Samples, craft: Spacecraft, total: Array | None = None) -> Array:
    """What actuators give, (k, 3) N m in body axes: ``J omega' + omega x J omega``, or that of wheels.

    Args:
        samples: at (k,) times.
        craft: its inertia.
        total: (3,) N m s, total momentum ``H`` of a spacecraft with wheels in inertial axes, so that it is
            ``J omega' + omega x (R^T H)``; None without.
    """
    return jnp.moveaxis(jnp.asarray(samples.kinematics(craft, total).torque), 0, -1)


@_of_plans
def largest(trajectory: Trajectory, quantity: Quantity) -> Array:
    """Largest value of a quantity over all time.

    Args:
        trajectory: its arrays may be traced.
        quantity: from samples at times (k,) or () to values of that shape.

    Returns:
        A number; NaN where one of the values looked at is NaN.
    """
    held = jax.lax.stop_gradient(trajectory)
    first = _times(held)
    count = len(first)
    shares = (jnp.arange(count) - count // 2) / (count // 2)  # of the window, whose middle is the best so far

    def look(_: int, state: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        times, spacing, _earlier, sound = state
        values = quantity(evaluate(held, times))
        best = times[jnp.argmax(values)]
        near = jnp.clip(best + 2 * spacing * shares, 0, duration(held))
        return near, 2 * spacing / (count // 2), best, sound & ~jnp.any(jnp.isnan(values))

    state = first, jnp.max(jnp.diff(jnp.sort(first))), first[0], jnp.array(True)
    _, _, best, sound = jax.lax.fori_loop(0, _LOOKS, look, state)
    # As a share of the duration it is held, for a peak at a break moves with it.
    moving = best + (duration(trajectory) - duration(held)) * (best / duration(held))
    return jnp.where(sound, quantity(evaluate(trajectory, moving)), jnp.nan)


@_of_plans
@_at_once("field")
def peak(trajectory: Trajectory, field: str) -> Array:
    """Largest magnitude of any component of a field of `Samples` over all time.

    Args:
        trajectory: its arrays may be traced.
        field: such as "angular_acceleration" or "joint_rates".

    Returns:
        In the field's unit, such as rad/s^2; zero where there is no component.
    """
    return largest(trajectory, lambda samples: _largest_of(jnp.abs(getattr(samples, field))))


@_of_plans
@_at_once("field", "power")
def power_mean(trajectory: Trajectory, field: str, power: int = 16) -> Array:
    """Smooth stand-in for `peak`: the power mean of a field over time and components.

    Args:
        trajectory: its arrays may be traced.
        field: as of `peak`.
        power: even; the larger it is, the nearer the mean is to the peak, from below.

    Returns:
        In the field's unit.
    """

    def scaled(samples: Samples) -> Array:
        return jnp.mean((getattr(samples, field) / largest_held) ** power, axis=-1)

    largest_held = jax.lax.stop_gradient(peak(trajectory, field))
    mean = integral(trajectory, scaled) / duration(trajectory)
    return largest_held * mean ** (1 / power)


@_of_plans
def integral(trajectory: Trajectory, quantity: Quantity) -> Array:
    """Integral of a quantity over time, by Gauss' rule on every piece.

    Args:
        trajectory: its arrays may be traced.
        quantity: from samples at (k,) times to (k,) values.

    Returns:
        In the quantity's unit times s.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS)
    breaks = _breaks(trajectory)
    half = jnp.diff(breaks)[:, None] / 2
    times = breaks[:-1, None] + half * (nodes + 1)
    return jnp.sum((half * weights).ravel() * quantity(evaluate(trajectory, times.ravel())))


@_of_plans
@_at_once()
def effort(trajectory: Trajectory) -> Array:
    """Integral of the squared accelerations of platform and joints over time, rad^2/s^3."""
    return _squares(trajectory, "angular_acceleration", "joint_accelerations")


@_of_plans
@_at_once()
def roughness(trajectory: Trajectory) -> Array:
    """Integral of the squared jerks of platform and joints over time, rad^2/s^5."""
    return _squares(trajectory, "angular_jerk", "joint_jerks")


def _squares(trajectory: Trajectory, *names: str) -> Array:
    """Integral over time of the squares of two fields of `Samples`, summed over components."""

    def squares(samples: Samples) -> Array:
        one, other = (jnp.sum(jnp.asarray(getattr(samples, name)) ** 2, axis=-1) for name in names)
        return one + other

    return integral(trajectory, squares)


@_of_plans
def duration(trajectory: Trajectory) -> Array:
    """Time from start to goal, s."""
    last: Array = arrays(trajectory.breaks)[1][-1]
    return last


@_of_plans
@_at_once()
def least_margin(trajectory: Trajectory, craft: Spacecraft, cones: Constraints) -> Array:
    """Smallest margin of any device to any zone over all time, rad; infinite without zones.

    Args:
        trajectory: its arrays may be traced.
        craft: its mountings and boresights.
        cones: the zones, none of which moves.

    Raises:
        ValueError: if one moves.
    """
    if cones.paths:
        raise ValueError("cones: zones that move have no margin here; plan.certificate has it")

    sights = cones.sights(craft.gimbals, craft.fixed_boresights)

    def short(samples: Samples) -> Array:
        margins = constraint_margins(cones, state_margins(cones, sights, samples.attitude, samples.joints))
        least = jnp.min(margins, axis=-1, initial=jnp.inf)
        return -jnp.where(jnp.any(jnp.isnan(margins), axis=-1), jnp.nan, least)

    return -largest(trajectory, short)


@_of_plans
@_at_once()
def peak_torque(trajectory: Trajectory, craft: Spacecraft) -> Array:
    """Largest component of the torque on the platform over all time, N m, body axes; it needs the inertia."""
    total = total_momentum(trajectory, craft)
    return largest(trajectory, lambda samples: _largest_of(jnp.abs(torque(samples, craft, total))))


SPECTRA = ("torque", "wheel_torques", "angular_acceleration")
"""Names of quantities whose spectrum `torque_spectrum` tells."""


@_of_plans
def torque_spectrum(
    trajectory: Trajectory, craft: Spacecraft, frequencies: ArrayLike, of: str | None = None
) -> Array:
    """Amplitudes of the Fourier transform of the torque over the whole manoeuvre, exact at any frequency.

    A mode of frequency f without damping that was at rest swings afterwards with that amplitude over 2 pi f,
    times the mode's gain. Before and after the manoeuvre the torque counts as zero. See
    `jaxplan.trajectory.spectrum`.

    Args:
        trajectory: its arrays may be traced.
        craft: its inertia and wheels.
        frequencies: () or (f,) Hz, zero or more; they may be traced, and then their values are not checked.
        of: one of `SPECTRA`; None for torque, and without an inertia for the angular acceleration.

    Returns:
        (f, c) N m s, ``|integral of tau exp(-2 pi i f t) dt|`` by body axes or by wheels, (1, c) at a single
        number; of the angular acceleration rad/s. Where one is zero its derivative is given as zero.

    Raises:
        ValueError: if there is no such quantity, or the spacecraft has no inertia, or no wheels, for it; or
            a frequency is negative or no finite number.
    """
    asked = expect_frequencies(frequencies)
    name = of or ("angular_acceleration" if craft.inertia is None else "torque")
    if name not in SPECTRA:
        raise ValueError(f"of = {of!r}: must be one of {', '.join(SPECTRA)}")
    if name != "angular_acceleration" and craft.inertia is None:
        raise ValueError(f"of = {of!r}: needs spacecraft.inertia_kg_m2, which is not set")
    if name == "wheel_torques" and craft.wheel_array is None:
        raise ValueError(f"of = {of!r}: the spacecraft has no wheels")
    return _spectrum(trajectory, craft, asked, name)


@_at_once("name", of_arrays=True)
def _spectrum(trajectory: Trajectory, craft: Spacecraft, frequencies: Array, name: str) -> Array:
    """`torque_spectrum` of the quantity of a name at frequencies (f,), when these are known to be there."""
    total = total_momentum(trajectory, craft)

    def values(times: Array) -> Array:
        samples = evaluate(trajectory, times)
        if name == "angular_acceleration":
            return jnp.asarray(samples.angular_acceleration)
        return jnp.moveaxis(jnp.asarray(getattr(samples.kinematics(craft, total), name)), 0, -1)

    return magnitude(transform(values, _breaks(trajectory), jnp.asarray(frequencies)))


@_of_plans
def wheel_torques(trajectory: Trajectory, craft: Spacecraft, t: ArrayLike) -> np.ndarray:
    """Torques that wheels give the platform, about their axes.

    Args:
        trajectory: of numpy arrays.
        craft: its wheels and inertia.
        t: () or (k,) s.

    Returns:
        (n,) or (k, n) N m, one a wheel; with the allocation "minimax" by the sharing out whose largest share
            of a limit is least.

    Raises:
        ValueError: if there are no wheels, or a time lies outside.
    """
    return np.moveaxis(_of_wheels(trajectory, craft, t)[0], 0, -1)


@_of_plans
def wheel_momenta(trajectory: Trajectory, craft: Spacecraft, t: ArrayLike) -> np.ndarray:
    """Momenta that wheels hold, (n,) or (k, n) N m s; arguments and errors as of `wheel_torques`.

    Those at the end are what the wheels store at the start of the next manoeuvre.
    """
    return np.moveaxis(_of_wheels(trajectory, craft, t)[1], 0, -1)


def _of_wheels(trajectory: Trajectory, craft: Spacecraft, t: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Torques and momenta of the wheels, (n,) or (n, k)."""
    if craft.wheel_array is None:
        raise ValueError("the spacecraft has no wheels; give it spacecraft.wheels")
    return wheel_loads(trajectory.sample(t).kinematics(craft, total_momentum(trajectory, craft)), craft)


@_of_plans
@_at_once()
def stretch(trajectory: Trajectory, craft: Spacecraft) -> Array:
    """Factor on time at which the first limit is just met; infinite where slowing down does not help."""
    total = total_momentum(trajectory, craft)
    return largest(trajectory, lambda samples: time_factors(samples, craft, total))


@_of_plans
def to_limits(trajectory: Trajectory, craft: Spacecraft) -> Trajectory:
    """The same motion scaled to the shortest time in which it keeps all limits, plus a millionth."""
    factor: Any = stretch(trajectory, craft) * SAFETY
    return trajectory.scaled(factor)


def _largest_of(magnitudes: Array) -> Array:
    """Maximum over the last axis, zero where that is empty; unlike `jnp.max` it is NaN where an entry is."""
    sound = jnp.all(magnitudes >= 0, axis=-1)
    return jnp.where(sound, jnp.max(magnitudes, axis=-1, initial=0.0), jnp.nan)


def _breaks(trajectory: Trajectory) -> Array:
    """The breaks of platform and joints together, ascending, s."""
    return jnp.sort(jnp.concatenate([jnp.asarray(trajectory.breaks), jnp.asarray(trajectory.joint_breaks)]))


def _times(trajectory: Trajectory) -> Array:
    """Times (k,), s, of the first samples: many on every piece, and each break from both sides."""
    breaks = _breaks(trajectory)
    each = max(_EACH, -(-_ALL // (len(breaks) - 1)))
    steps = jnp.arange(each) / each
    inner = breaks[:-1, None] + jnp.diff(breaks)[:, None] * steps
    return jnp.concatenate([inner.ravel(), breaks[-1:], jnp.nextafter(breaks[1:], breaks[0])])
