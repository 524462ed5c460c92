"""Trajectories against numerical integration: of the attitude's kinematics, and of a rigid body under torque.

A trajectory says its rates and accelerations besides its attitudes. The torque that it asks of a body,
``J alpha + omega x J omega``, is fed to Euler's equations, which know nothing else of it; what the body does
then has to be the trajectory. Classical Runge-Kutta of order four, in numpy.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from jaxplan.trajectory import Trajectory

TOLERANCE = 1e-8  # rad and rad/s, of the integration in so many steps; it falls with their fourth power
STEPS = 3000


def errors(trajectory: Trajectory, inertia: np.ndarray, steps: int = STEPS) -> dict[str, float]:
    """Largest differences between a trajectory and what integration makes of its derivatives.

    Args:
        trajectory: any.
        inertia: (3, 3) kg m^2.
        steps: of the integration, about; they end at the breaks, where higher derivatives jump.

    Returns:
        rad of the attitude by kinematics, by dynamics, and of the joints; rad/s of the angular velocity.
    """
    breaks = np.unique(np.concatenate([trajectory.breaks, trajectory.joint_breaks]))
    share = np.diff(breaks) / trajectory.duration
    counts = np.ceil(steps * share).astype(int)
    ends = np.repeat(np.diff(breaks) / counts, counts)
    whole = np.minimum(np.concatenate([[0.0], np.cumsum(ends)]), trajectory.duration)
    times = np.insert((whole[:-1] + whole[1:]) / 2, np.arange(len(ends)), whole[:-1])
    samples = trajectory.sample(np.append(times, whole[-1]))
    spin, bend = samples.angular_velocity, samples.angular_acceleration
    torque = bend @ inertia.T + np.cross(spin, spin @ inertia.T)
    first = np.roll(Rotation.from_matrix(samples.attitude[0]).as_quat(), 1)
    kinematic = runge_kutta(first, ends, lambda q, k: half_product(q, spin[k]))
    inverse = np.linalg.inv(inertia)

    def body(state: np.ndarray, k: int) -> np.ndarray:
        rate = state[4:]
        return np.concatenate(
            [half_product(state[:4], rate), inverse @ (torque[k] - cross(rate, inertia @ rate))]
        )

    dynamic = runge_kutta(np.concatenate([first, spin[0]]), ends, body)
    own = Rotation.from_matrix(samples.attitude[::2])
    rates, accelerations = samples.joint_rates, samples.joint_accelerations
    return {
        "attitude by kinematics": apart(own, kinematic),
        "attitude by dynamics": apart(own, dynamic[:, :4]),
        "angular velocity by dynamics": float(np.max(np.abs(dynamic[:, 4:] - spin[::2]))),
        "joints": simpson(samples.joints, rates, ends),
        "joint rates": simpson(rates, accelerations, ends),
    }


def runge_kutta(
    state: np.ndarray, steps: np.ndarray, slope: Callable[[np.ndarray, int], np.ndarray]
) -> np.ndarray:
    """States (steps + 1, n); the slope is of a state and of a time's number, two to a step."""
    states = [state]
    for number, step in enumerate(steps.tolist()):
        k = 2 * number
        one = slope(state, k)
        two = slope(state + step / 2 * one, k + 1)
        three = slope(state + step / 2 * two, k + 1)
        four = slope(state + step * three, k + 2)
        state = state + step / 6 * (one + 2 * two + 2 * three + four)
        states.append(state)
    return np.array(states)


def half_product(q: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """``q * (0, rate) / 2``, the derivative of a quaternion (w x y z) by the rate in body axes."""
    w, x, y, z = q.tolist()
    a, b, c = rate.tolist()
    return (
        np.array(
            [-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a]
        )
        / 2
    )


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    a, b, c = first.tolist()
    x, y, z = second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def apart(own: Rotation, quaternions: np.ndarray) -> float:
    return float(np.max((own.inv() * Rotation.from_quat(quaternions, scalar_first=True)).magnitude()))


def simpson(values: np.ndarray, slopes: np.ndarray, steps: np.ndarray) -> float:
    """Largest difference between values (2k + 1, n) and the integral of their slopes."""
    parts = steps[:, None] / 6 * (slopes[:-2:2] + 4 * slopes[1:-1:2] + slopes[2::2])
    integral = values[0] + np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(parts, axis=0)])
    return float(np.max(np.abs(integral - values[::2]), initial=0.0))


def random_inertia(seed: int) -> np.ndarray:
    """(3, 3) of a body: no principal moment exceeds the sum of the two others."""
    rng = np.random.default_rng(seed)
    masses = 10.0 ** rng.uniform(0, 2, 3)
    turn = Rotation.random(rng=rng).as_matrix()
    return turn @ np.diag(masses.sum() - masses) @ turn.T
