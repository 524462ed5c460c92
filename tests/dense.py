"""Properties of trajectories on a grid that no optimiser has seen, in numpy and scipy alone.

Every comparison is one that a NaN fails.
"""

import numpy as np
from numpy.polynomial import legendre
from reference import assert_each, attitudes_of, joints_of, spin_of, zone_margins
from scipy.spatial.transform import Rotation

SHARE = 1 + 1e-6  # of a limit
ALLOWANCE = 1e-9  # rad, the certificate's


def instants(trajectory, count=3001):
    """Times off all round fractions of the duration, and both ends."""
    inner = (np.arange(count) + 0.37) / count
    return trajectory.duration * np.concatenate([[0.0], inner, [1.0]])


def shares(trajectory, craft, count=3001):
    """Values over their limits, by name: (k, axes) each."""
    t = instants(trajectory, count)
    rate, acceleration, jerk = spin_of(trajectory, t)
    angles, joint_rates, joint_accelerations = joints_of(trajectory, t)
    found = {
        "rate": rate / craft.rate_limit,
        "acceleration": acceleration / craft.acceleration_limit,
        "range": (angles - craft.joint_ranges.mean(axis=1)) / (np.ptp(craft.joint_ranges, axis=1) / 2),
        "joint rate": joint_rates / craft.joint_rate_limits,
        "joint acceleration": joint_accelerations / craft.joint_acceleration_limits,
    }
    if craft.inertia is not None:
        momentum = rate @ np.asarray(craft.inertia).T
        torque = acceleration @ np.asarray(craft.inertia).T + np.cross(rate, momentum)
        if craft.torque_limit is not None:
            found["torque"] = torque / craft.torque_limit
        if craft.wheel_momentum_limit is not None:
            found["momentum"] = momentum / craft.wheel_momentum_limit
    if craft.rate_norm_limit is not None:
        found["rate length"] = np.linalg.norm(rate, axis=1, keepdims=True) / craft.rate_norm_limit
    if craft.acceleration_norm_limit is not None:
        lengths = np.linalg.norm(acceleration, axis=1, keepdims=True)
        found["acceleration length"] = lengths / craft.acceleration_norm_limit
    if craft.jerk_limit is not None:
        found["jerk"] = jerk / craft.jerk_limit
    return found


def assert_kept(trajectory, craft, zones=(), count=3001):
    """All limits and zones; groups of keep-in zones by the one that holds best."""
    for name, share in shares(trajectory, craft, count).items():
        # Differences of attitudes lose digits in the higher derivatives.
        assert_each(np.abs(share), "<=", SHARE + (1e-4 if name == "jerk" else 0), name)
    if not zones:
        return
    margins = zone_margins(trajectory, craft, zones, instants(trajectory, count))
    groups = {}
    for zone, margin in zip(zones, margins, strict=True):
        groups.setdefault(getattr(zone, "any_of", None) or zone.name, []).append(margin)
    for name, rows in groups.items():
        assert_each(np.max(rows, axis=0), ">=", -ALLOWANCE, name)


def node_errors(trajectory, path):
    """(m + 1, 1 + 2n) rad: rotation between curve and nodes, and difference of each joint."""
    t = trajectory.node_times
    own, nodes = Rotation.from_matrix(attitudes_of(trajectory, t)), Rotation.from_matrix(path.attitudes)
    return np.column_stack(
        [(nodes.inv() * own).magnitude(), np.abs(joints_of(trajectory, t)[0] - path.joints)]
    )


def jumps(trajectory, derivatives):
    """(derivatives,) largest jumps of b, joints and their derivatives at joins, over the largest values.

    All pieces are in the same chart, so a jump of b's derivatives is one of the motion's.
    """
    np.testing.assert_array_equal(np.ptp(trajectory.chart_attitude, axis=0), 0)
    np.testing.assert_array_equal(np.ptp(trajectory.chart_start), 0)
    found = []
    half = np.diff(trajectory.breaks)[:, None] / 2
    coefficients = np.concatenate([trajectory.coefficients, trajectory.joint_coefficients], axis=2)
    for d in range(derivatives):
        own = legendre.legder(coefficients, d, axis=1) if d else coefficients
        left, right = (
            np.einsum("kjc,j->kc", own, legendre.legvander([x], own.shape[1] - 1)[0]) for x in (-1, 1)
        )
        left, right = left / half**d, right / half**d
        found.append(np.abs(right[:-1] - left[1:]).max() / np.abs(right).max())
    return np.array(found)


def end_states(trajectory):
    """(2, 2, 3 + 2n) rates and accelerations at start and end."""
    t = trajectory.duration * np.array([0.0, 1.0])
    spin, joints = spin_of(trajectory, t)[:2], joints_of(trajectory, t)[1:]
    return np.concatenate([spin, joints], axis=2)
