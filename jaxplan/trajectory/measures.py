"""Measures of a trajectory that can be differentiated: peaks, effort, margins, and the stretch to the limits.

Extremes are over continuous time: about the highest of many samples, further samples are taken at ever finer
spacing. The time of the extreme, as a fraction of the duration, is held fixed, so derivatives are those of
the quantity at that time (the envelope theorem); where two peaks are equally high it is that of one of them.
A peak narrower than the spacing of the samples may be missed: whether a trajectory is safe is for the
certificate to say, not for these numbers.

A trajectory of numpy arrays gives numbers of 64 bits, whatever JAX is set to; one of JAX arrays, traced or
not, gives numbers of their precision.

A plan may be given in place of its trajectory, also the plan of a timeline; then its own spacecraft and zones
are used where none are given.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import arrays, max_along, min_along
from jaxplan.model.constraints import Constraints, constraint_margins, state_margins
from jaxplan.model.limits import timed_limits
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheel_reach import wheel_loads
from jaxplan.runtime.arguments import expect, show
from jaxplan.runtime.at_once import at_once
from jaxplan.trajectory.curve import Samples, Trajectory, evaluate, platform, polynomial, total_momentum
from jaxplan.trajectory.peaks import SAFETY
from jaxplan.trajectory.plan_measures import of_plans
from jaxplan.trajectory.spectrum import expect_frequencies, magnitude, transform

Quantity = Callable[[Samples], Array]

_PIECE_SAMPLES, _TOTAL_SAMPLES = 12, 600  # least number on each piece, and about that on a whole trajectory
_GAUSS_NODES = 16  # nodes of Gauss' rule on each piece; on the paper's long ones effort is good to 5e-11
_SAMPLING_ROUNDS = 4  # rounds of samples: the first over the whole trajectory, the others about the extreme


def time_factors(samples: Samples, craft: Spacecraft, total: Array | None = None) -> Array:
    """Factors on the duration with which the limit that a motion uses most would just be kept.

    Args:
        samples: at (k,) times.
        craft: its limits.
        total: (3,) N m s, total momentum in inertial axes, see `total_momentum`; None without wheels.

    Returns:
        (k,) for each time the largest factor of all components of all limits: magnitude over limit, to one
        over the power of the time scaling by which it falls. NaN where one of them is NaN, infinite where
        slowing down does not help.

    Raises:
        TypeError: if these are no samples, or no spacecraft.
    """
    _expect_samples(samples, craft)
    motion = samples.kinematics(craft, total)
    factors = [limit.time_factors(motion) for group in timed_limits(craft) for limit in group]
    return _max_or_nan(jnp.moveaxis(jnp.concatenate(factors), 0, -1))


def torque(samples: Samples, craft: Spacecraft, total: Array | None = None) -> Array:
    """Torque (k, 3) N m of the actuators on the platform, body axes: ``J omega' + omega x J omega``.

    Args:
        samples: at (k,) times.
        craft: its inertia, which must be set.
        total: (3,) N m s, total momentum ``H`` of a spacecraft with wheels in inertial axes, with which the
            torque is that of the wheels, ``J omega' + omega x (R^T H)``; None without wheels.

    Raises:
        TypeError: if these are no samples, as ``plan.trajectory.sample`` returns them, or no spacecraft.
        ValueError: if the spacecraft's inertia is not set.
    """
    _expect_samples(samples, craft)
    _expect_inertia(craft)
    return jnp.moveaxis(jnp.asarray(samples.kinematics(craft, total).torque), 0, -1)


def _expect_samples(samples: object, craft: object) -> None:
    """Raise a TypeError unless these are samples of a trajectory and a spacecraft."""
    expect("samples", samples, Samples, "plan.trajectory.sample(t) returns them")
    expect("craft", craft, Spacecraft, "scenario.spacecraft is one")


def _expect_inertia(craft: Spacecraft) -> None:
    """Raise a ValueError if a spacecraft has no inertia."""
    if craft.inertia is None:
        raise ValueError("craft: the torque needs spacecraft.inertia_kg_m2, which is not set")


@of_plans
def largest(trajectory: Trajectory, quantity: Quantity) -> Array:
    """Largest value of a quantity over all time.

    Args:
        trajectory: or a plan; its arrays may be traced.
        quantity: function from samples at times (k,) or () to values of that shape.

    Returns:
        A number; NaN where one of the values looked at is NaN.
    """
    held = jax.lax.stop_gradient(trajectory)
    first = _first_sample_times(held)
    count = len(first)
    shares = (jnp.arange(count) - count // 2) / (count // 2)  # of the window, whose middle is the best so far

    def look(_: int, state: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        times, spacing, _earlier, sound = state
        values = quantity(evaluate(held, times))
        best = times[jnp.argmax(values)]
        near = jnp.clip(best + 2 * spacing * shares, 0, duration(held))
        return near, 2 * spacing / (count // 2), best, sound & ~jnp.any(jnp.isnan(values))

    state = first, jnp.max(jnp.diff(jnp.sort(first))), first[0], jnp.array(True)
    _, _, best, sound = jax.lax.fori_loop(0, _SAMPLING_ROUNDS, look, state)
    # The fraction of the duration is held, and not the time, since a peak at a break moves with the break.
    whole = duration(held)
    share = jnp.where(whole > 0, best / jnp.where(whole > 0, whole, 1), 0)
    moving = best + (duration(trajectory) - whole) * share
    return jnp.where(sound, quantity(evaluate(trajectory, moving)), jnp.nan)


@of_plans
@at_once("field")
def peak(trajectory: Trajectory, field: str) -> Array:
    """Largest magnitude of any component of a field of `Samples` over all time.

    Args:
        trajectory: or a plan; its arrays may be traced.
        field: name such as "angular_acceleration" or "joint_rates".

    Returns:
        A number in the field's unit, such as rad/s^2; zero where there is no component.

    Raises:
        ValueError: if there is no such field.
    """
    _expect_field(field)
    return largest(trajectory, lambda samples: _max_or_nan(jnp.abs(getattr(samples, field))))


@of_plans
@at_once("field", "power")
def power_mean(trajectory: Trajectory, field: str, power: int = 16) -> Array:
    """Smooth substitute for `peak`: the power mean of a field over time and components.

    Args:
        trajectory: or a plan; its arrays may be traced.
        field: as in `peak`.
        power: even; the larger it is, the nearer the mean is to the peak, from below.

    Returns:
        A number in the field's unit; zero where nothing moves or there is no component.

    Raises:
        ValueError: if there is no such field, or the power is no even number of at least 2.
    """
    _expect_field(field)
    if type(power) is not int or power < 2 or power % 2:
        raise ValueError(f"power = {show(power)}: must be an even number of at least 2")
    largest_held = jax.lax.stop_gradient(peak(trajectory, field))
    moves = largest_held != 0  # which also holds for NaN
    scale = jnp.where(moves, largest_held, 1)

    def scaled(samples: Samples) -> Array:
        values = getattr(samples, field)
        return jnp.sum((values / scale) ** power, axis=-1) / max(values.shape[-1], 1)

    whole = duration(trajectory)
    mean = integral(trajectory, scaled) / jnp.where(whole > 0, whole, 1)
    return jnp.where(moves, scale * jnp.where(moves, mean, 1) ** (1 / power), 0)


def _expect_field(field: str) -> None:
    """Raise a ValueError for what is no name of a vector in `Samples`."""
    names = [each.name for each in fields(Samples) if each.name != "attitude"]
    if field not in names:
        raise ValueError(f"field = {show(field)}: must be one of {', '.join(names)}")


@of_plans
def integral(trajectory: Trajectory, quantity: Quantity) -> Array:
    """Integral of a quantity over time, by Gauss' rule on every piece.

    Args:
        trajectory: or a plan; its arrays may be traced.
        quantity: function from samples at (k,) times to (k,) values.

    Returns:
        A number in the quantity's unit times s.
    """
    times, weights = _gauss_nodes(_all_breaks(trajectory))
    return jnp.sum(weights.ravel() * quantity(evaluate(trajectory, times.ravel())))


def _gauss_nodes(breaks: Array) -> tuple[Array, Array]:
    """Return times (N, nodes) and weights (N, nodes), in s, of Gauss' rule on each of N pieces."""
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS_NODES)
    half = jnp.diff(breaks)[:, None] / 2
    return breaks[:-1, None] + half * (nodes + 1), half * weights


@of_plans
@at_once()
def effort(trajectory: Trajectory) -> Array:
    """Integral of the squared accelerations of platform and joints over time, rad^2/s^3."""
    return _integrate_squares(trajectory, 2)


@of_plans
@at_once()
def roughness(trajectory: Trajectory) -> Array:
    """Integral of the squared jerks of platform and joints over time, rad^2/s^5."""
    return _integrate_squares(trajectory, 3)


def _integrate_squares(trajectory: Trajectory, order: int) -> Array:
    """Integral over time of the squares of time derivatives of platform and joints, summed over components.

    Each is integrated on its own pieces, so none has to be looked up, which makes a small kernel.

    Args:
        trajectory: its arrays may be traced.
        order: 2 for accelerations, 3 for jerks.
    """
    pieces, ends = trajectory.platform_pieces, jnp.asarray(trajectory.joint_breaks)
    times, weights = _gauss_nodes(jnp.asarray(trajectory.breaks))
    of_platform = platform(jax.tree.map(lambda part: jnp.asarray(part)[:, None], pieces), times, order)[order]
    joint_times, joint_weights = _gauss_nodes(ends)
    on = jnp.asarray(trajectory.joint_coefficients)[:, None], ends[:-1, None], ends[1:, None]
    of_joints = polynomial(*on, joint_times)[order]
    return jnp.sum(weights[..., None] * of_platform**2) + jnp.sum(joint_weights[..., None] * of_joints**2)


@of_plans
def duration(trajectory: Trajectory) -> Array:
    """Time from start to goal in s; unlike `Trajectory.duration` it can be traced."""
    last: Array = arrays(trajectory.breaks)[1][-1]
    return last


@of_plans
@at_once()
def least_margin(trajectory: Trajectory, craft: Spacecraft, cones: Constraints) -> Array:
    """Smallest margin of any device to any zone over all time, rad; negative if a zone is broken.

    It is infinite without zones.

    Args:
        trajectory: or a plan; its arrays may be traced.
        craft: its mountings and boresights.
        cones: the zones, none of which may move.

    Raises:
        ValueError: if a zone moves.
    """
    if cones.paths:
        raise ValueError(
            "a zone moves, so that the smallest margin is no function of the trajectory alone; "
            "plan.certificate.min_margin has it"
        )

    sights = cones.sights(craft.gimbals, craft.fixed_boresights)

    def short(samples: Samples) -> Array:
        margins = constraint_margins(cones, state_margins(cones, sights, samples.attitude, samples.joints))
        least = min_along(margins, -1)
        return -jnp.where(jnp.any(jnp.isnan(margins), axis=-1), jnp.nan, least)

    return -largest(trajectory, short)


@of_plans
@at_once()
def peak_torque(trajectory: Trajectory, craft: Spacecraft) -> Array:
    """Largest component of the torque on the platform over all time, N m, body axes.

    See `torque`.

    Raises:
        ValueError: if the spacecraft's inertia is not set.
    """
    _expect_inertia(craft)
    total = total_momentum(trajectory, craft)
    return largest(trajectory, lambda samples: _max_or_nan(jnp.abs(torque(samples, craft, total))))


SPECTRA = ("torque", "wheel_torques", "angular_acceleration")
"""Names of quantities whose spectrum `torque_spectrum` tells."""


@of_plans
def torque_spectrum(
    trajectory: Trajectory, craft: Spacecraft, frequencies: ArrayLike, of: str | None = None
) -> Array:
    """Amplitudes of the Fourier transform of the torque over the whole manoeuvre, exact at any frequency.

    An undamped mode of frequency f that was at rest swings afterwards with that amplitude over 2 pi f, times
    the mode's gain. Before and after the manoeuvre the torque counts as zero. See
    `jaxplan.trajectory.spectrum`.

    Args:
        trajectory: or a plan; its arrays may be traced.
        craft: its inertia and wheels.
        frequencies: () or (f,) Hz, zero or more; they may be traced, and then their values are not checked.
        of: one of `SPECTRA`; None for torque or, without an inertia, for the angular acceleration.

    Returns:
        (f, c) N m s, ``|integral of tau exp(-2 pi i f t) dt|`` for each body axis or each wheel, (1, c) for a
        single frequency; of the angular acceleration in rad/s. Where one is zero its derivative is given as
        zero.

    Raises:
        ValueError: if there is no such quantity, or the spacecraft lacks the inertia or the wheels for it; or
            a frequency is negative or not a finite number.
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


@at_once("name", of_arrays=True)
def _spectrum(trajectory: Trajectory, craft: Spacecraft, frequencies: Array, name: str) -> Array:
    """Do the same as `torque_spectrum` for the quantity of a name, when all arguments have been checked."""
    total = total_momentum(trajectory, craft)

    def values(times: Array) -> Array:
        samples = evaluate(trajectory, times)
        if name == "angular_acceleration":
            return jnp.asarray(samples.angular_acceleration)
        return jnp.moveaxis(jnp.asarray(getattr(samples.kinematics(craft, total), name)), 0, -1)

    return magnitude(transform(values, _all_breaks(trajectory), jnp.asarray(frequencies)))


@of_plans
def wheel_torques(trajectory: Trajectory, craft: Spacecraft, t: ArrayLike) -> np.ndarray:
    """Torques that wheels exert on the platform, about their axes.

    Args:
        trajectory: or a plan; of numpy arrays.
        craft: its wheels and inertia.
        t: () or (k,) s.

    Returns:
        (n,) or (k, n) N m, one for each of the n wheels. With the allocation "minimax" the torque is
        distributed such that the largest fraction of a wheel's limit is least.

    Raises:
        ValueError: if there are no wheels, or a time lies outside the trajectory.
    """
    return np.moveaxis(_wheel_torques_and_momenta(trajectory, craft, t)[0], 0, -1)


@of_plans
def wheel_momenta(trajectory: Trajectory, craft: Spacecraft, t: ArrayLike) -> np.ndarray:
    """Momenta in N m s that the n wheels hold about their axes, (n,) or, for k times, (k, n).

    Those at the end are what the wheels store at the start of the next manoeuvre. Arguments and errors are
    those of `wheel_torques`.
    """
    return np.moveaxis(_wheel_torques_and_momenta(trajectory, craft, t)[1], 0, -1)


def _wheel_torques_and_momenta(
    trajectory: Trajectory, craft: Spacecraft, t: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Torques (N m) and momenta (N m s) of the n wheels, (n,) for a single time or (n, k) for k times.

    Raises:
        ValueError: if there are no wheels.
    """
    if craft.wheel_array is None:
        raise ValueError("the spacecraft has no wheels; give it spacecraft.wheels")
    return wheel_loads(trajectory.sample(t).kinematics(craft, total_momentum(trajectory, craft)), craft)


@of_plans
@at_once()
def stretch(trajectory: Trajectory, craft: Spacecraft) -> Array:
    """Least factor on time with which all limits are kept; infinite where slowing down does not help."""
    total = total_momentum(trajectory, craft)
    return largest(trajectory, lambda samples: time_factors(samples, craft, total))


@of_plans
def to_limits(trajectory: Trajectory, craft: Spacecraft) -> Trajectory:
    """Return the same motion scaled to the shortest time in which it keeps all limits, plus a millionth."""
    factor: Any = stretch(trajectory, craft) * SAFETY
    return trajectory.scaled(factor)


def _max_or_nan(magnitudes: Array) -> Array:
    """Maximum over the last axis, zero where that is empty; unlike `jnp.max` it is NaN where an entry is.

    Entries are magnitudes, zero or more.
    """
    sound = jnp.all(magnitudes >= 0, axis=-1)
    return jnp.where(sound, jnp.maximum(max_along(magnitudes, -1), 0.0), jnp.nan)


def _all_breaks(trajectory: Trajectory) -> Array:
    """The breaks of platform and joints together, ascending, in s; common ones are listed twice."""
    return jnp.sort(jnp.concatenate([jnp.asarray(trajectory.breaks), jnp.asarray(trajectory.joint_breaks)]))


def _first_sample_times(trajectory: Trajectory) -> Array:
    """Times (k,) in s of the first samples: many on every piece, and each break from both sides."""
    breaks = _all_breaks(trajectory)
    each = max(_PIECE_SAMPLES, -(-_TOTAL_SAMPLES // (len(breaks) - 1)))
    steps = jnp.arange(each) / each
    inner = breaks[:-1, None] + jnp.diff(breaks)[:, None] * steps
    return jnp.concatenate([inner.ravel(), breaks[-1:], jnp.nextafter(breaks[1:], breaks[0])])
