"""Single steps of a plan as calls: goals of a scenario, the fit along a path, and plans from their results.

Step 1 returns the goal that is given, or those that are found; where something moves, a goal is for one time,
the end of the manoeuvre. Step 3 returns the trajectory along a path. A certificate settles the plan.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate
from jaxplan.goal import decompose, descend_once, tracking_rates
from jaxplan.goal.rates import least_rates
from jaxplan.model.goals import LEAST_TIME, GivenState, Targets
from jaxplan.model.limits import longest
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario, SearchSettings, moves
from jaxplan.model.status import Status
from jaxplan.planner import messages, remedies
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.validity import breaches, hidden_targets
from jaxplan.runtime.precompile import Task
from jaxplan.search import Scene
from jaxplan.trajectory import Fit, FitQuery, Trajectory, fit_batch

_SHARES = np.linspace(1.0, 0.0, 9)  # of the straight motion of its joints, at which a device may stop
_MOST_TURNS = 4  # between two angles of a range of 720 deg to either side


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
    """A request for a search.

    Attributes:
        scene: where to search.
        settings: of the search.
    """

    scene: Scene
    settings: SearchSettings


def find_goals(
    scenario: Scenario, time: float | None = None, told: Callable[[Goal], object] | None = None
) -> tuple[Goal, ...] | Plan:
    """Find the goals to try, the best one first, or a failed plan that says why there is none.

    Args:
        scenario: the problem.
        time: s, when the manoeuvre ends; it matters only where something moves, and must be given there.
        told: as of `decompose`; not called where something moves.
    """
    end, wanted = 0.0 if time is None else time, scenario.search.max_goals
    asked, start = scenario.asked, scenario.start.attitude
    unseen = hidden_targets(scenario, end)
    if unseen:
        message = messages.hidden(scenario, unseen, end)
        return Plan(scenario=scenario, status=Status.INVALID_GOAL, message=message)
    if isinstance(asked, GivenState):
        candidates: tuple[Goal, ...] = (_given(asked, start),)
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
        candidates = tuple(_arriving(scenario, goal, end) for goal in candidates)
    broken = [_broken(scenario, goal, end) for goal in candidates]
    valid = tuple(goal for goal, faults in zip(candidates, broken, strict=True) if not faults)
    if not valid:
        message = "; ".join(broken[0]) + messages.when(scenario, end)
        return Plan(scenario=scenario, status=Status.INVALID_GOAL, message=message, goal=candidates[0])
    return valid[:wanted]


def soonest_task(scenario: Scenario, time: float | None) -> Task | None:
    """A task that compiles what finds goals of the least time; None where none are looked for.

    Args:
        scenario: the problem.
        time: s, as of `find_goals`.
    """
    asked, end = scenario.asked, 0.0 if time is None else time
    if isinstance(asked, GivenState) or asked.criterion != LEAST_TIME:
        return None
    start = scenario.start
    problem = scenario.usable, start.attitude, asked.at(end), scenario.constraints.at(end)
    return partial(descend_once, *problem, start_joints=start.joints)


def other_turns(scenario: Scenario, goal: Goal, device: int) -> list[Goal]:
    """Goals at which the yaw or angle of a device is whole turns away, the nearest first.

    Args:
        scenario: whose goal is targets; of any other goal, and of one that moves, there are none.
        goal: one that meets all targets and constraints.
        device: number of a gimbal.
    """
    if isinstance(scenario.goal, GivenState) or moves(scenario):
        return []
    craft, found = scenario.usable, list[Goal]()
    joint = craft.gimbals.yaws[device]
    for turns in range(-_MOST_TURNS, _MOST_TURNS + 1):
        joints = np.array(goal.joints)
        joints[joint] += 2 * np.pi * turns
        other = replace(goal, joints=joints)
        if turns and not _broken(scenario, other, 0.0):
            found.append(other)
    return sorted(found, key=lambda one: abs(one.joints[joint] - scenario.start.joints[joint]))


def goals_within(scenario: Scenario, reach: Mapping[int, np.ndarray]) -> list[Goal]:
    """Goals at which the joints of devices are within narrower ranges, nearest first.

    Args:
        scenario: whose goal is targets; of any other goal, and of one that moves, there are none.
        reach: by numbers of gimbals (o, 2) rad, ranges of the joints.
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
    """Goals without the wishes of a device, or without any where it has none, nearest first.

    Args:
        scenario: whose goal has wishes; of any other goal, and of one that moves, there are none.
        device: number of a sight.
    """
    asked, names = scenario.goal, scenario.usable.device_names
    if isinstance(asked, GivenState) or moves(scenario) or not asked.prefer:
        return []
    others = tuple(wish for wish in asked.prefer if wish.device not in names[device : device + 1])
    left = others if len(others) < len(asked.prefer) else ()
    found = find_goals(replace(scenario, goal=replace(asked, prefer=left)))
    return [] if isinstance(found, Plan) else list(found)


def other_ends(scenario: Scenario, goal: Goal, device: int, last: np.ndarray) -> list[Goal]:
    """The goal at which a device without a target stops the farthest on its way and breaks nothing, if any.

    Args:
        scenario: where something moves there is none.
        goal: one that meets all targets and constraints.
        device: number of a gimbal.
        last: (o,) rad, joints of the device as far as they can go.
    """
    joints, own = np.array(goal.joints), scenario.usable.gimbals.joints_of(device)
    first = scenario.start.joints[own]
    for share in _SHARES if not moves(scenario) else ():
        joints[own] = first + share * (last - first)
        other = replace(goal, joints=joints)
        if not _broken(scenario, other, 0.0):
            return [other]
    return []


def _broken(scenario: Scenario, goal: Goal, time: float) -> tuple[str, ...]:
    """A phrase for each limit or constraint that a goal breaks when it is reached at a time, s."""
    rates = end_rates(scenario, goal)
    return breaches(scenario, goal.attitude, goal.joints, *rates, arriving=True, time=time)


def _arriving(scenario: Scenario, goal: Goal, time: float) -> Goal:
    """A goal with its time and the rates with which the manoeuvre ends there.

    Args:
        scenario: in which something moves.
        goal: without time and rates.
        time: s, when the manoeuvre ends.
    """
    asked = scenario.asked
    if isinstance(asked, GivenState) or not asked.moves:
        rates = asked.angular_velocity, asked.joint_rates
    elif asked.prefer or asked.criterion == LEAST_TIME:  # `tracking_rates` follows the least rotation alone
        rates = least_rates(scenario.usable, asked, goal, asked.rates(time))
    else:
        rates = tracking_rates(goal, **pursuit(scenario, asked, time))
    return replace(goal, time=time, angular_velocity=rates[0], joint_rates=rates[1])


def pursuit(scenario: Scenario, targets: Targets, time: Any) -> dict[str, Any]:
    """Arguments of `tracking_rates` and `goal_in_time`, by name, for a goal with moving targets.

    Args:
        scenario: the problem.
        targets: of its goal.
        time: s, when the manoeuvre ends; it may be traced.
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


def _given(state: GivenState, attitude: np.ndarray) -> Goal:
    """The goal of a given state, for a start attitude (3, 3), body to inertial."""
    slew = float(so3.distance(attitude, state.attitude))
    return Goal(attitude=state.attitude, joints=np.asarray(state.joints, float), slew_angle=slew)


def largest_slew(scenario: Scenario) -> float:
    """Bound of the platform's rotation, equations (5) and (6), rad.

    Within limits of each body axis the rate's length is at most the diagonal of their box, sqrt(3) times a
    limit that all axes share. A duration that is not a number bounds nothing but half a turn.
    """
    duration = scenario.trajectory.duration
    if isinstance(duration, str):
        return float(np.pi)
    return float(min(np.pi, longest(scenario.usable, 1) * duration))


def wanted_fit(scenario: Scenario, path: Path, goal: Goal, near: Trajectory | None = None) -> FitQuery:
    """The request for a fit along a path to a goal, by the scenario's method; near a trajectory if given."""
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
    """Fit the trajectory of a scenario along a path to a goal; near another trajectory if given."""
    return fit_batch([wanted_fit(scenario, path, goal, near)])[0]


def fitted_plan(so_far: Plan, fitted: Fit) -> Plan:
    """A plan with status, message and trajectory of step 3, not yet certified."""
    message, robust = fitted.note if fitted.status is Status.OK else fitted.message, so_far.scenario.robust
    if fitted.full_wheels and robust is not None and robust.momentum_reserve:
        reserve = f"[robust] momentum_reserve_percent = {robust.momentum_reserve:g}"
        message = f"{message}, or lower {reserve}, which is taken off what they hold at most"
    return replace(so_far, status=fitted.status, message=message, trajectory=fitted.trajectory)


def judged(so_far: Plan, certificate: Certificate) -> Plan:
    """A plan with a certificate on its trajectory; an OK one that is not certified becomes UNCERTIFIED."""
    so_far = replace(so_far, certificate=certificate)
    if so_far.status in (Status.OK, Status.UNCERTIFIED) and not certificate.certified:
        motion = so_far.trajectory
        message = remedies.uncertified(
            certificate, so_far.scenario, 0.0 if motion is None else motion.duration
        )
        return replace(so_far, status=Status.UNCERTIFIED, message=message)
    return so_far
