"""Properties of trajectories on a grid that no optimiser has seen, in numpy and scipy alone.

Every comparison is one that a NaN fails.
"""

import numpy as np
from numpy.polynomial import legendre
from reference import (
    angle,
    assert_each,
    attitudes_of,
    in_body,
    joints_of,
    own_joints,
    seen,
    spin_of,
    stated_margins,
    zone_margins,
)
from scipy.spatial.transform import Rotation

from jaxplan.model.goals import GivenState

SHARE = 1 + 1e-6  # of a limit
ALLOWANCE = 1e-9  # rad, the certificate's


def instants(trajectory, count=3001):
    """Times off all round fractions of the duration, and both ends."""
    inner = (np.arange(count) + 0.37) / count
    return trajectory.duration * np.concatenate([[0.0], inner, [1.0]])


NEAREST_TO_POLE = np.deg2rad(0.1)  # of a pitch, as the manual says
BACKWARD = np.array([25 / 12, -4, 3, -4 / 3, 1 / 4])  # weights of the values at 0, -h ... -4 h
STEP = 1e-3  # s
SLIP = 1e-6  # rad/s
AIM = 1e-8  # rad, to which a terminal meets its target, and states are met, also in rad/s


def joint_limits(craft):
    """Ranges (J, 2), and limits of rates and accelerations (J,) of all joints, from what devices say."""
    rows = {"yaw": [], "pitch": [], "angle": []}
    for one in craft.terminals:
        for joint, limit, ends in (
            ("yaw", one.yaw_limit, one.yaw_range),
            ("pitch", one.pitch_limit, one.pitch_range),
        ):
            first, last = (-limit, limit) if ends is None else ends
            if joint == "pitch":
                steepest = np.pi / 2 - NEAREST_TO_POLE
                first, last = max(first, -steepest), min(last, steepest)
            own = [getattr(one, f"{joint}_{kind}_limit") for kind in ("rate", "acceleration")]
            shared = one.rate_limit, one.acceleration_limit
            limits = [both if each is None else each for each, both in zip(own, shared, strict=True)]
            rows[joint].append((first, last, *limits))
    for one in craft.drives:
        rows["angle"].append((*one.range, one.rate_limit, one.acceleration_limit))
    table = np.array([row for joint in rows.values() for row in joint], float).reshape(-1, 4)
    return table[:, :2], table[:, 2], table[:, 3]


def breaches(plan, count=3001):
    """What a trajectory breaks of all that its scenario states, in words; empty if nothing."""
    return [*_broken(plan, count), *_ends_missed(plan)]


def _broken(plan, count):
    """Limits and constraints, at instants."""
    scenario, trajectory = plan.scenario, plan.trajectory
    for name, share in shares(trajectory, scenario.spacecraft, count).items():
        worst = np.max(np.abs(share), initial=0.0)
        if not worst <= SHARE + (1e-4 if name == "jerk" else 0):
            yield f"{name} is {worst:.9f} of its limit"
    time = instants(trajectory, count)
    for name, margin in stated_margins(scenario, trajectory, time).items():
        if not np.min(margin) >= -ALLOWANCE:
            deep, when = -np.rad2deg(np.min(margin)), time[np.argmin(margin)]
            yield f"{name} is broken by {deep:.3g} deg at {when:g} s"


def _ends_missed(plan):
    """Start and goal."""
    scenario, trajectory, goal = plan.scenario, plan.trajectory, plan.scenario.goal
    attitudes = attitudes_of(trajectory, trajectory.duration * np.array([0.0, 1.0]))
    joints, rates = joints_of(trajectory, trajectory.duration * np.array([0.0, 1.0]), orders=2)
    given = {"start": (0, scenario.start)} | ({"goal": (1, goal)} if isinstance(goal, GivenState) else {})
    for name, (at, state) in given.items():
        turn = Rotation.from_rotvec(state.rotation_vector).inv() * Rotation.from_matrix(attitudes[at])
        off = np.max([turn.magnitude(), *np.abs(joints[at] - state.joints)])
        if not off <= AIM:
            yield f"the {name} is missed by {np.rad2deg(off):.3g} deg"
        if not np.max(np.abs(rates[at] - state.joint_rates), initial=0.0) <= AIM:
            yield f"the {name}'s joint rates are missed"
    if isinstance(goal, GivenState):
        return
    craft = scenario.spacecraft
    for name, path in zip(goal.devices or [one.name for one in craft.terminals], goal.paths, strict=True):
        # the beam follows its target at the end: two backward differences agree with the target's own
        times = trajectory.duration - STEP * np.arange(5.0)
        beams = _beams(trajectory, craft, name, times)
        targets = seen(path, times) if path.moves else np.tile(path.samples[0], (5, 1))
        exact = name in [one.name for one in craft.terminals]
        off = angle(beams[0], targets[0])
        if not off <= (AIM if exact else goal.tolerance + AIM):
            yield f"{name} misses its target by {np.rad2deg(off):.3g} deg"
        slip = np.linalg.norm(BACKWARD @ (beams - targets)) / STEP
        if path.moves and not slip <= SLIP:
            yield f"{name} leaves its target at {np.rad2deg(slip):.3g} deg/s"
    for name in goal.hold:
        own = own_joints(craft, name)
        off = np.max(np.abs(joints[1, own] - joints[0, own]), initial=0.0)
        if not off <= AIM:
            yield f"{name} is not held, but moved by {np.rad2deg(off):.3g} deg"


def _beams(trajectory, craft, name, times):
    """(k, 3) inertial directions of a device."""
    own = in_body(craft, name, joints_of(trajectory, times, orders=1)[0])
    return np.einsum("kij,kj->ki", attitudes_of(trajectory, times), own)


def shares(trajectory, craft, count=3001):
    """Values over their limits, by name: (k, axes) each."""
    t = instants(trajectory, count)
    rate, acceleration, jerk = spin_of(trajectory, t)
    angles, joint_rates, joint_accelerations = joints_of(trajectory, t)
    ranges, rate_limits, acceleration_limits = joint_limits(craft)
    found = {
        "rate": rate / craft.rate_limit,
        "acceleration": acceleration / craft.acceleration_limit,
        "range": (angles - ranges.mean(axis=1)) / (np.ptp(ranges, axis=1) / 2),
        "joint rate": joint_rates / rate_limits,
        "joint acceleration": joint_accelerations / acceleration_limits,
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
