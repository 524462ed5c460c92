"""The single steps of a plan as functions: find goals, fit along a path, and record the results in a plan.

Step 1 returns the given goal, or those that are found; where something moves, a goal is for one time, the end
of the manoeuvre. Step 2, the path search, is in `jaxplan.search`. Step 3 returns the trajectory along a path.
A certificate settles the plan.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate
from jaxplan.goal import decompose, descend_once, tracking_rates
from jaxplan.goal.pointing_start import least_rates
from jaxplan.model.goals import LEAST_TIME, GivenState, Targets
from jaxplan.model.limits import longest
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario, SearchSettings, moves
from jaxplan.model.status import Status
from jaxplan.planner import messages, remedies
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.validity import breaches, hidden_targets
from jaxplan.planner.wheel_room import overfull, total_at_start, with_wheel_room
from jaxplan.runtime.ahead import Task
from jaxplan.search import Scene
from jaxplan.trajectory import Fit, FitQuery, Trajectory, fit_batch

_STOP_SHARES = np.linspace(1.0, 0.0, 9)  # fractions of its joints' straight motion at which a device may stop
_MAX_TURNS = 4  # whole turns between two angles in a range of 720 deg to either side


@dataclass(frozen=True, slots=True, eq=False)
class GoalQuery:
    """A request for goals, see `find_goals`.

    Attributes:
        scenario: the problem.
        time: s, when the manoeuvre ends; None where nothing moves.
    """

    scenario: Scenario
    time: float | None


@dataclass(frozen=True, slots=True, eq=False)
class SearchQuery:
    """A request for a path search.

    Attributes:
        scene: the search problem.
        settings: those of the search.
    """

    scene: Scene
    settings: SearchSettings


def find_goals(
    scenario: Scenario, time: float | None = None, told: Callable[[Goal], object] | None = None
) -> tuple[Goal, ...] | Plan:
    """Find the goals to try, the best one first; or return a failed plan that says why there is none.

    Where nothing moves, and a wheel would be overfull at the best goal, goals at which none is are preferred.

    Args:
        scenario: the problem.
        time: s, when the manoeuvre ends; required where something moves, and ignored elsewhere.
        told: called with the goal of least rotation as soon as that is found, before goals of least time are
            sought; never called where something moves. None for no call.
    """
    found, craft = _find_goals(scenario, time, told), scenario.usable
    if isinstance(found, Plan) or isinstance(scenario.asked, GivenState) or moves(scenario):
        return found
    total = total_at_start(scenario)
    if not overfull(craft, total, found[0].attitude):
        return found
    for roomy in with_wheel_room(scenario, total):
        others = _find_goals(roomy, time)
        if not isinstance(others, Plan):
            return (*others, *(goal for goal in found if not overfull(craft, total, goal.attitude)))
    return found


def _find_goals(
    scenario: Scenario, time: float | None, told: Callable[[Goal], object] | None = None
) -> tuple[Goal, ...] | Plan:
    """Find the goals as `find_goals` does, with its arguments, whatever wheels hold there."""
    end, wanted = 0.0 if time is None else time, scenario.search.max_goals
    asked, start = scenario.asked, scenario.start.attitude
    unseen = hidden_targets(scenario, end)
    if unseen:
        message = messages.hidden(scenario, unseen, end)
        return Plan(scenario=scenario, status=Status.INVALID_GOAL, message=message)
    if isinstance(asked, GivenState):
        candidates: tuple[Goal, ...] = (_goal_of_state(asked, start),)
    else:
        rows, most = scenario.constraints.at(end), largest_slew(scenario)
        found = decompose(
            scenario.usable,
            start,
            asked.at(end),
            rows,
            start_joints=scenario.start.joints,
            max_slew=most,
            max_goals=wanted,
            seed=scenario.search.seed,
            told=None if moves(scenario) else told,
        )
        if not found.goals:
            message = messages.unreachable(scenario, rows, found, most, end) + messages.when(scenario, end)
            return Plan(scenario=scenario, status=Status.GOAL_UNREACHABLE, message=message)
        candidates = found.goals
    if moves(scenario):
        candidates = tuple(_add_arrival_rates(scenario, goal, end) for goal in candidates)
    broken = [_goal_breaches(scenario, goal, end) for goal in candidates]
    valid = tuple(goal for goal, faults in zip(candidates, broken, strict=True) if not faults)
    if not valid:
        message = "; ".join(broken[0]) + messages.when(scenario, end)
        return Plan(scenario=scenario, status=Status.INVALID_GOAL, message=message, goal=candidates[0])
    return valid[:wanted]


def soonest_task(scenario: Scenario, time: float | None) -> Task | None:
    """Return a task that compiles the search for goals of least time; None where none are looked for.

    Args:
        scenario: the problem.
        time: s, when the manoeuvre ends; None where nothing moves.
    """
    asked, end = scenario.asked, 0.0 if time is None else time
    if isinstance(asked, GivenState) or asked.criterion != LEAST_TIME:
        return None
    start = scenario.start
    problem = scenario.usable, start.attitude, asked.at(end), scenario.constraints.at(end)
    return partial(descend_once, *problem, start_joints=start.joints)


def tracking_task(scenario: Scenario, time: float | None) -> Task | None:
    """Return a task that compiles the rates at goals that follow moving targets; None where none are needed.

    Arguments are those of `soonest_task`.
    """
    if time is None or not _tracks_by_least_rotation(scenario):
        return None
    start = scenario.start
    goal = Goal(attitude=np.asarray(start.attitude), joints=np.asarray(start.joints), slew_angle=0.0)
    return partial(_add_arrival_rates, scenario, goal, time)


def other_turns(scenario: Scenario, goal: Goal, device: int) -> list[Goal]:
    """Return goals at which the yaw or angle of one device is whole turns away, the nearest first.

    Goals that break a limit or zone are left out.

    Args:
        scenario: the problem; if its goal is a given state, or something moves, there are none.
        goal: a goal that meets all targets and constraints.
        device: index of the gimbal: terminals, then drives.
    """
    if isinstance(scenario.goal, GivenState) or moves(scenario):
        return []
    craft, found = scenario.usable, list[Goal]()
    joint = craft.gimbals.yaws[device]
    for turns in range(-_MAX_TURNS, _MAX_TURNS + 1):
        joints = np.array(goal.joints)
        joints[joint] += 2 * np.pi * turns
        other = replace(goal, joints=joints)
        if turns and not _goal_breaches(scenario, other, 0.0):
            found.append(other)
    return sorted(found, key=lambda one: abs(one.joints[joint] - scenario.start.joints[joint]))


def goals_within(scenario: Scenario, reach: Mapping[int, np.ndarray]) -> list[Goal]:
    """Find goals at which the joints of some devices are within narrower ranges, best first.

    Args:
        scenario: the problem; if its goal is a given state, or something moves, there are none.
        reach: ranges (o, 2), rad, of the o joints of a device (yaw and pitch, or one angle), by its gimbal's
            index.
    """
    if isinstance(scenario.goal, GivenState) or moves(scenario):
        return []
    stated = scenario.spacecraft
    terminals, drives = list(stated.terminals), list(stated.drives)
    error = 0.0 if scenario.robust is None else scenario.robust.joint_error  # of which the reach knows
    for device, left in reach.items():
        ranges = left + np.array([-error, error])
        if device < len(terminals):
            yaw, pitch = ranges
            own: dict[str, Any] = {"yaw_limit": None, "yaw_range": yaw, "pitch_limit": None}
            terminals[device] = replace(terminals[device], **own, pitch_range=pitch)
        else:
            drives[device - len(terminals)] = replace(drives[device - len(terminals)], range=ranges[0])
    craft = replace(stated, terminals=tuple(terminals), drives=tuple(drives))
    found = find_goals(replace(scenario, spacecraft=craft))
    return [] if isinstance(found, Plan) else list(found)


def goals_unwished(scenario: Scenario, device: int) -> list[Goal]:
    """Find goals without the wishes of a device, or without any wishes if it has none, best first.

    Args:
        scenario: the problem; without wishes, or where something moves, there are none.
        device: index of a sight, devices first.
    """
    asked, names = scenario.goal, scenario.usable.device_names
    if isinstance(asked, GivenState) or moves(scenario) or not asked.prefer:
        return []
    others = tuple(wish for wish in asked.prefer if wish.device not in names[device : device + 1])
    left = others if len(others) < len(asked.prefer) else ()
    found = find_goals(replace(scenario, goal=replace(asked, prefer=left)))
    return [] if isinstance(found, Plan) else list(found)


def other_ends(scenario: Scenario, goal: Goal, device: int, last: np.ndarray) -> list[Goal]:
    """Find a goal at which a device without a target stops as far on its way as it may without a breach.

    Args:
        scenario: the problem; where something moves the result is empty.
        goal: a goal that meets all targets and constraints.
        device: index of the gimbal.
        last: (o,) rad, the farthest joint angles of the device on its way.

    Returns:
        That goal alone, or nothing if the device breaks a limit or zone everywhere on its way.
    """
    joints, own = np.array(goal.joints), scenario.usable.gimbals.joints_of(device)
    first = scenario.start.joints[own]
    for share in _STOP_SHARES if not moves(scenario) else ():
        joints[own] = first + share * (last - first)
        other = replace(goal, joints=joints)
        if not _goal_breaches(scenario, other, 0.0):
            return [other]
    return []


def _goal_breaches(scenario: Scenario, goal: Goal, time: float) -> tuple[str, ...]:
    """Return a phrase for each limit or constraint that a goal breaks if it is reached at `time` s."""
    rates = end_rates(scenario, goal)
    return breaches(scenario, goal.attitude, goal.joints, *rates, arriving=True, time=time)


def _add_arrival_rates(scenario: Scenario, goal: Goal, time: float) -> Goal:
    """Return a goal with its time and the rates that the platform and joints must have then.

    Args:
        scenario: a problem in which something moves.
        goal: a goal without time and rates.
        time: s, when the manoeuvre ends.
    """
    asked = scenario.asked
    if isinstance(asked, GivenState) or not asked.moves:
        rates = asked.angular_velocity, asked.joint_rates
    elif _tracks_by_least_rotation(scenario):
        rates = tracking_rates(goal, **pursuit(scenario, asked, time))
    else:
        rates = least_rates(scenario.usable, asked, goal, asked.rates(time))
    return replace(goal, time=time, angular_velocity=rates[0], joint_rates=rates[1])


def _tracks_by_least_rotation(scenario: Scenario) -> bool:
    """Tell whether goals follow targets that move, by the least rotation and without wishes."""
    asked = scenario.asked
    if isinstance(asked, GivenState) or not asked.moves:
        return False
    return not asked.prefer and asked.criterion != LEAST_TIME


def pursuit(scenario: Scenario, targets: Targets, time: Any) -> dict[str, Any]:
    """Return the arguments of `tracking_rates` and `goal_in_time`, by name, for a goal with moving targets.

    Args:
        scenario: the problem.
        targets: its goal.
        time: s, when the manoeuvre ends; it may be a traced JAX value.
    """
    rows = scenario.constraints
    return {
        "spacecraft": scenario.usable,
        "start_attitude": scenario.start.attitude,
        "start_joints": scenario.start.joints,
        "targets": targets.at(time),
        "cones": rows.at(time),
        "target_rates": targets.rates(time),
        "axis_rates": rows.axis_rates(time),
    }


def _goal_of_state(state: GivenState, attitude: np.ndarray) -> Goal:
    """Return the goal of a given state; `attitude` (3, 3), body to inertial, is that of the start."""
    slew = float(so3.distance(attitude, state.attitude))
    return Goal(attitude=state.attitude, joints=np.asarray(state.joints, float), slew_angle=slew)


def largest_slew(scenario: Scenario) -> float:
    """Return an upper bound of the platform's rotation in the given duration, rad: equations (5) and (6).

    With a rate limit for each body axis, the rate's norm is at most the diagonal of their box, sqrt(3) times
    the limit if all axes share one. If the duration is to be found, the bound is pi.
    """
    duration = scenario.trajectory.duration
    if isinstance(duration, str):
        return float(np.pi)
    return float(min(np.pi, longest(scenario.usable, 1) * duration))


def wanted_fit(scenario: Scenario, path: Path, goal: Goal, near: Trajectory | None = None) -> FitQuery:
    """Return the request for a fit along `path` to `goal`, with the scenario's settings.

    `near` is a trajectory near which the shortest motion is sought; None to look for the best.
    """
    start, end = scenario.start, end_rates(scenario, goal)
    return FitQuery(
        path=path,
        spacecraft=scenario.usable,
        settings=scenario.trajectory,
        cones=scenario.constraints,
        start_angular_velocity=start.angular_velocity,
        start_joint_rates=start.joint_rates,
        end_angular_velocity=end[0],
        end_joint_rates=end[1],
        horizon=goal.time,
        near=near,
    )


def fit(scenario: Scenario, path: Path, goal: Goal, near: Trajectory | None = None) -> Fit:
    """Fit the trajectory of a scenario along `path` to `goal`; `near` is as of `wanted_fit`."""
    return fit_batch([wanted_fit(scenario, path, goal, near)])[0]


def fitted_plan(so_far: Plan, fitted: Fit) -> Plan:
    """Return a plan with the status, message and trajectory of a fit, not yet certified."""
    message, robust = fitted.note if fitted.status is Status.OK else fitted.message, so_far.scenario.robust
    reserves = {"momentum": robust.momentum_reserve, "torque": robust.torque_reserve} if robust else {}
    if reserve := reserves.get(fitted.short_of, 0.0):
        told = f"[robust] {fitted.short_of}_reserve_percent = {reserve:g}"
        whole = "what they hold at most" if fitted.short_of == "momentum" else "that limit"
        message = f"{message}, or lower {told}, which is taken off {whole}"
    scenario, asked = so_far.scenario, so_far.scenario.asked
    chosen = moves(scenario) and isinstance(asked, Targets) and asked.criterion != LEAST_TIME
    if fitted.short_of == "momentum" and chosen:  # where nothing moves goals without full wheels were tried
        message = f'{message}, or set goal.criterion = "{LEAST_TIME}" for other goals'
    return replace(so_far, status=fitted.status, message=message, trajectory=fitted.trajectory)


def judged(so_far: Plan, certificate: Certificate) -> Plan:
    """Return a plan with the certificate of its trajectory.

    If the certificate does not certify it, the status OK becomes UNCERTIFIED, with advice as the message.
    """
    so_far = replace(so_far, certificate=certificate)
    if so_far.status in (Status.OK, Status.UNCERTIFIED) and not certificate.certified:
        motion = so_far.trajectory
        message = remedies.uncertified(
            certificate, so_far.scenario, 0.0 if motion is None else motion.duration
        )
        return replace(so_far, status=Status.UNCERTIFIED, message=message)
    return so_far
