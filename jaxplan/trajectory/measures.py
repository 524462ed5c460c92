"""Numbers of a trajectory that can be differentiated: peaks, effort, margins, and the stretch to the limits.

Extremes are over continuous time: the highest of many samples is followed by ever finer ones about it. Its
time, as a share of the duration, is held, so derivatives are those of the quantity at that time (the envelope
theorem); where two peaks are equally high it is that of one of them.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.spacecraft import Spacecraft
from jaxplan.trajectory.curve import Samples, Trajectory, evaluate
from jaxplan.trajectory.scaling import SAFETY
from jaxplan.zones import Cones, constraint_margins, device_margins

Quantity = Callable[[Samples], Array]

_EACH, _ALL = 12, 600  # samples on a piece, and at least on a trajectory
_GAUSS = 12  # likewise of an integral
_FINER, _LOOKS = 17, 8  # samples about an extreme, each look eight times as fine


def shares_of_limits(samples: Samples, craft: Spacecraft) -> tuple[Array, np.ndarray]:
    """What a motion takes of each limit.

    Args:
        samples: at (k,) times.
        craft: its limits.

    Returns:
        Magnitudes (k, Q) over limits: of the platform's rate, acceleration, jerk, torque and momentum, as far
        as they are limited, then of the joints' rates and accelerations; and (Q,) powers of the time scaling
        by which each falls.
    """
    rate, acceleration = jnp.asarray(samples.angular_velocity), jnp.asarray(samples.angular_acceleration)
    found: list[tuple[Array, Any, int]] = [
        (rate, craft.rate_limit, 1),
        (acceleration, craft.acceleration_limit, 2),
    ]
    if craft.jerk_limit is not None:
        found.append((jnp.asarray(samples.angular_jerk), craft.jerk_limit, 3))
    if craft.inertia is not None:
        momentum = rate @ jnp.asarray(craft.inertia).T
        if craft.torque_limit is not None:
            found.append((torque(samples, craft), craft.torque_limit, 2))
        if craft.wheel_momentum_limit is not None:
            found.append((momentum, craft.wheel_momentum_limit, 1))
    found.append((jnp.asarray(samples.joint_rates), craft.joint_rate_limits, 1))
    found.append((jnp.asarray(samples.joint_accelerations), craft.joint_acceleration_limits, 2))
    shares = [jnp.abs(values) / limit for values, limit, _ in found]
    powers = [np.full(values.shape[-1], power) for values, _, power in found]
    return jnp.concatenate(shares, axis=-1), np.concatenate(powers)


def torque(samples: Samples, craft: Spacecraft) -> Array:
    """``J omega' + omega x J omega``, (k, 3) N m in body axes."""
    inertia, rate = jnp.asarray(craft.inertia), jnp.asarray(samples.angular_velocity)
    return jnp.asarray(samples.angular_acceleration) @ inertia.T + jnp.cross(rate, rate @ inertia.T)


def largest(trajectory: Trajectory, quantity: Quantity) -> Array:
    """Largest values over all time.

    Args:
        trajectory: its arrays may be traced.
        quantity: of samples at (k,) times, (k, Q) values.

    Returns:
        (Q,).
    """
    held = jax.lax.stop_gradient(trajectory)
    times = _times(held)
    values = quantity(evaluate(held, times))
    best = times[jnp.argmax(values, axis=0)]  # (Q,)
    width = jnp.max(jnp.diff(jnp.sort(times)))
    steps = jnp.linspace(-1, 1, _FINER)

    def closer(look: int, best: Array) -> Array:
        reach = 2 * width / (_FINER // 2) ** look
        near = jnp.clip(best[:, None] + reach * steps, 0, jnp.asarray(held.breaks)[-1])  # (Q, F)
        near = near.at[:, _FINER // 2].set(best)
        own = quantity(evaluate(held, near.ravel())).reshape(*near.shape, -1)
        own = jnp.einsum("qfq->qf", own)
        return jnp.take_along_axis(near, jnp.argmax(own, axis=1)[:, None], axis=1)[:, 0]

    best = jax.lax.fori_loop(0, _LOOKS, closer, best)
    # As shares of the duration they are held, for a peak at a break moves with it.
    moving = best + (duration(trajectory) - duration(held)) * (best / duration(held))
    return jnp.diagonal(quantity(evaluate(trajectory, moving)))


def peak(trajectory: Trajectory, field: str) -> Array:
    """Largest magnitude of any component of a field of `Samples` over all time.

    Args:
        trajectory: its arrays may be traced.
        field: such as "angular_acceleration" or "joint_rates".

    Returns:
        In the field's unit, such as rad/s^2; zero where there is no component.
    """
    if not np.shape(getattr(evaluate(jax.lax.stop_gradient(trajectory), 0.0), field))[-1]:
        return jnp.zeros(())
    return jnp.max(largest(trajectory, lambda samples: jnp.abs(getattr(samples, field))))


def power_mean(trajectory: Trajectory, field: str, power: int = 16) -> Array:
    """Smooth stand-in for `peak`: the mean over time and components of a power, and its root.

    Args:
        trajectory: its arrays may be traced.
        field: as of `peak`.
        power: even; the larger, the nearer to the peak, from below.

    Returns:
        In the field's unit.
    """

    def scaled(samples: Samples) -> Array:
        return jnp.mean((getattr(samples, field) / largest_held) ** power, axis=-1)

    largest_held = jax.lax.stop_gradient(peak(trajectory, field))
    mean = integral(trajectory, scaled) / duration(trajectory)
    return largest_held * mean ** (1 / power)


def integral(trajectory: Trajectory, quantity: Quantity) -> Array:
    """Integral over time, by Gauss' rule on every piece.

    Args:
        trajectory: its arrays may be traced.
        quantity: of samples at (k,) times, (k,) values.

    Returns:
        In the quantity's unit times s.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS)
    breaks = jnp.sort(jnp.concatenate([jnp.asarray(trajectory.breaks), jnp.asarray(trajectory.joint_breaks)]))
    half = jnp.diff(breaks)[:, None] / 2
    times = breaks[:-1, None] + half * (nodes + 1)
    return jnp.sum((half * weights).ravel() * quantity(evaluate(trajectory, times.ravel())))


def effort(trajectory: Trajectory) -> Array:
    """Integral of the squared accelerations of platform and joints over time, rad^2/s^3."""

    def squares(samples: Samples) -> Array:
        return jnp.sum(jnp.asarray(samples.angular_acceleration) ** 2, axis=-1) + jnp.sum(
            jnp.asarray(samples.joint_accelerations) ** 2, axis=-1
        )

    return integral(trajectory, squares)


def roughness(trajectory: Trajectory) -> Array:
    """Integral of the squared jerks of platform and joints over time, rad^2/s^5."""

    def squares(samples: Samples) -> Array:
        return jnp.sum(jnp.asarray(samples.angular_jerk) ** 2, axis=-1) + jnp.sum(
            jnp.asarray(samples.joint_jerks) ** 2, axis=-1
        )

    return integral(trajectory, squares)


def duration(trajectory: Trajectory) -> Array:
    """From start to goal, s."""
    return jnp.asarray(trajectory.breaks)[-1]


def least_margin(trajectory: Trajectory, craft: Spacecraft, cones: Cones) -> Array:
    """Smallest margin of any device to any zone over all time, rad; infinite without zones.

    Args:
        trajectory: its arrays may be traced.
        craft: its mountings and boresights.
        cones: the zones.
    """

    def short(samples: Samples) -> Array:
        margins = constraint_margins(
            cones, device_margins(cones, craft.boresights(samples.attitude, samples.joints))
        )
        return -jnp.min(margins, axis=-1, initial=jnp.inf, keepdims=True)

    return -largest(trajectory, short)[0]


def peak_torque(trajectory: Trajectory, craft: Spacecraft) -> Array:
    """Largest component of the torque on the platform over all time, N m, body axes; it needs the inertia."""
    return jnp.max(largest(trajectory, lambda samples: jnp.abs(torque(samples, craft))))


def stretch(trajectory: Trajectory, craft: Spacecraft) -> Array:
    """Factor on time at which the first limit is just met."""
    powers: list[np.ndarray] = []

    def shares(samples: Samples) -> Array:
        found, own = shares_of_limits(samples, craft)
        powers[:] = [own]
        return found

    peaks = largest(trajectory, shares)
    return jnp.max(peaks ** (1 / powers[0]))


def to_limits(trajectory: Trajectory, craft: Spacecraft) -> Trajectory:
    """The same motion in the time in which it just keeps all limits."""
    factor: Any = stretch(trajectory, craft) * SAFETY
    return trajectory.scaled(factor)


def _times(trajectory: Trajectory) -> Array:
    """Many times, breaks from both sides among them."""
    breaks = jnp.sort(jnp.concatenate([jnp.asarray(trajectory.breaks), jnp.asarray(trajectory.joint_breaks)]))
    each = max(_EACH, -(-_ALL // (len(breaks) - 1)))
    steps = jnp.arange(each) / each
    inner = breaks[:-1, None] + jnp.diff(breaks)[:, None] * steps
    return jnp.concatenate([inner.ravel(), breaks[-1:], jnp.nextafter(breaks[1:], breaks[0])])
