"""How the goal of a plan follows its scenario, or why it has no derivative that is known.

A goal can be followed if it is the optimum of step 1 that `jaxplan.goal.derivative` differentiates. Whether
it is that optimum is checked here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import jax
import numpy as np

from jaxplan import so3
from jaxplan.goal.derivative import differentiable_goal
from jaxplan.goal.free_devices import MadeWay, settled
from jaxplan.goal.pairs import cleared
from jaxplan.goal.problem import GoalProblem, Wished, leaves_open
from jaxplan.model.constraints import Constraints
from jaxplan.model.goals import LEAST_ROTATION, LEAST_TIME, GivenState, Targets
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario, moves
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.jit import quick_jit

_OPTIMUM_TOLERANCE = 1e-6  # rad, largest distance of a plan's goal from the optimum whose derivative is taken
_BOUND_DOUBT = (
    "its goal leans on a bound of joints, a vector that these turn, "
    "or what a device without a target can reach"
)
AS_A_STATE = "give the goal as a state"
"""Advice that helps wherever a goal has no slopes; timelines put it in words of their own."""
_WISH_DOUBT = f"its goal leans on what a device prefers: leave the wish out, or {AS_A_STATE}"
_HALF_TURN_DOUBT = (
    f"its goal is half a turn away, where the least rotation turns one way or the other: {AS_A_STATE}"
)
_HALF_TURN_ROUNDING = 1e-6  # rad; a slew that is less than that short of half a turn counts as one
_MET_WISH_DISTANCE = 2e-6  # rad; a wish as near is met: step 1 leaves it less than this to give others room
_TOLERANCE_WITH_WISHES = 1e-5  # rad, as `_OPTIMUM_TOLERANCE`, where wishes are met no better than that


def _unmet_wish_doubt(devices: Sequence[str]) -> str:
    """Return the doubt about a goal that comes near what some devices prefer, but does not reach it."""
    whose = " and ".join(dict.fromkeys(devices))
    return (
        f"its goal is as near as can be to what {whose} would look at, and does not reach it: leave the wish "
        f"out, or {AS_A_STATE}"
    )


@cache
def _compiled_optimum(met: tuple[int, ...]) -> Callable[..., Goal]:
    """Return the compiled `differentiable_goal` for goals that meet the wishes in given places.

    `met` holds these places in `Targets.prefer`.
    """
    return quick_jit(partial(differentiable_goal, met=met))


@dataclass(frozen=True, kw_only=True)
class Followed:
    """How a goal follows its scenario.

    Attributes:
        moves: how devices without a target made way at the goal.
        met: places in `Targets.prefer` of the wishes that the goal meets.
        criterion: the criterion of which the goal is an optimum; None for a goal that is given as a state,
            and where there are doubts.
        doubts: reasons why the goal is not the optimum that `differentiable_goal` takes it for; empty if it
            is.
    """

    moves: tuple[MadeWay, ...] = ()
    met: tuple[int, ...] = ()
    criterion: str | None = None
    doubts: tuple[str, ...] = ()


def followed_by(scenario: Scenario, goal: Goal) -> Followed:
    """Tell how the goal of a plan follows its scenario, or why it does not (`Followed.doubts`).

    Args:
        scenario: that of the plan.
        goal: that of the plan.
    """
    asked, craft, rows = scenario.asked, scenario.usable, scenario.constraints.at(goal.time)
    if isinstance(asked, GivenState):
        return Followed()
    place = Goal(attitude=goal.attitude, joints=goal.joints, slew_angle=goal.slew_angle)
    soonest = asked.criterion == LEAST_TIME
    targets, start = asked.at(goal.time), scenario.start
    problem = GoalProblem.of(craft, start.attitude, targets, rows, start.joints)
    if targets.clearance:
        problem = replace(problem, rows=cleared(problem.rows, problem.pairs, targets.clearance))
    problem = replace(problem, wishes=tuple(Wished.all_of(craft, targets, problem.ranges)))
    joints = np.clip(problem.joints(goal.attitude), *problem.ranges.T)
    joints, made = settled(problem, goal.attitude, joints)
    doubts = []
    fixed = craft.device_names[len(craft.device_names) - len(craft.instruments) :]
    rolls = len(set(targets.names(craft)).intersection(fixed)) < 2  # two instruments fix the attitude
    if not soonest and rolls and goal.slew_angle > np.pi - _HALF_TURN_ROUNDING:
        doubts.append(_HALF_TURN_DOUBT)
    if any(move.ties for move in made):
        doubts.append(
            "where a device without a target makes way at the goal several things are as near, and which of "
            "them it will lean on depends on the way the scenario changes"
        )
    elif np.max(np.abs(joints - goal.joints), initial=0.0) > _OPTIMUM_TOLERANCE:
        doubts.append(_BOUND_DOUBT)
    if moves(scenario) and not scenario.trajectory.timed:
        if targets.prefer:
            doubts.append(_WISH_DOUBT)
        return Followed(doubts=tuple(doubts))  # a given duration takes another goal
    if soonest and (asked.moves or targets.prefer or made):
        doubts.append(least_time_doubt(asked))
    if doubts:
        return Followed(doubts=tuple(doubts))
    if not soonest and not targets.prefer and not leaves_open(problem):
        return Followed(moves=made, criterion=asked.criterion)
    met = () if asked.moves else _met_wishes(problem, goal.attitude)  # else rates would be of another goal
    within = _TOLERANCE_WITH_WISHES if met else _OPTIMUM_TOLERANCE
    for criterion in dict.fromkeys((asked.criterion, LEAST_ROTATION)):
        wanted = replace(targets, criterion=criterion)
        with jax.enable_x64(True):
            optimum = _compiled_optimum(met)(
                place, craft, start.attitude, wanted, rows, start_joints=start.joints
            )
        if float(so3.distance(goal.attitude, np.asarray(optimum.attitude))) <= within:
            return Followed(moves=made, met=met, criterion=criterion)
    if soonest:
        doubts = ['its goal is no smooth optimum of the time: set goal.criterion = "least_rotation"']
    short = [one.device for place, one in enumerate(targets.prefer) if place not in met]
    reason = _unmet_wish_doubt(short) if short else _WISH_DOUBT if met else _BOUND_DOUBT
    return Followed(doubts=tuple(doubts or [reason]))


def least_time_doubt(asked: Targets) -> str:
    """Return the reason why a goal of least time is not followed.

    Its targets move, or it has wishes or devices that make way.
    """
    why = "targets that move" if asked.moves else "wishes, or with devices that make way"
    return f'its goal is one of least time with {why}: set goal.criterion = "least_rotation"'


def with_wishes_met(
    goal: Goal,
    craft: Spacecraft,
    start_attitude: np.ndarray,
    targets: Targets,
    rows: Constraints,
    start_joints: np.ndarray,
) -> Goal:
    """Move a goal of step 1 slightly, to where the wishes that it nearly meets are met exactly.

    Step 1 leaves wishes a little room, so that its goals are no smooth function of what they depend on. Where
    no wish is met, or the optimum is farther away than that room, the goal itself is returned.

    Args:
        goal: the goal that step 1 found.
        craft: the spacecraft.
        start_attitude: (3, 3) body to inertial.
        targets: the targets at an instant.
        rows: the constraints then.
        start_joints: (J,) rad, joints at the start.
    """
    problem = GoalProblem.of(craft, start_attitude, targets, rows, start_joints)
    if targets.clearance:
        problem = replace(problem, rows=cleared(problem.rows, problem.pairs, targets.clearance))
    problem = replace(problem, wishes=tuple(Wished.all_of(craft, targets, problem.ranges)))
    if not (met := _met_wishes(problem, goal.attitude)):
        return goal
    wanted = replace(targets, criterion=LEAST_ROTATION)
    with jax.enable_x64(True):
        optimum = _compiled_optimum(met)(goal, craft, start_attitude, wanted, rows, start_joints=start_joints)
    attitude = np.asarray(optimum.attitude)
    if not float(so3.distance(goal.attitude, attitude)) <= _TOLERANCE_WITH_WISHES:
        return goal
    joints, _ = settled(problem, attitude, np.clip(problem.joints(attitude), *problem.ranges.T))
    return replace(goal, attitude=attitude, joints=joints, slew_angle=float(optimum.slew_angle))


def _met_wishes(problem: GoalProblem, attitude: np.ndarray) -> tuple[int, ...]:
    """Return the places of the wishes that are met at an attitude (3, 3), body to inertial."""
    near = [wish.distance(attitude) <= _MET_WISH_DISTANCE for wish in problem.wishes]
    return tuple(np.flatnonzero(near).tolist())
