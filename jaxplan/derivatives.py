"""A plan as a function of its scenario, and the choices that are held fixed in it.

What a planner chooses has no derivative and is held fixed (`hold`): which local minimum of step 1 the goal is
and which limits and zones are active there, the corners of the path, and which limits, zones and nodes bind
in step 3. All else follows the scenario (`replan`): the first and last node are its start and its goal, nodes
on straight motions next to these move with them (`jaxplan.model.moving_nodes`), in the global method nodes
are passed at the times that the pace along the path gives, and the trajectory is the optimum of step 3. Where
targets or zones move, in a given duration, the goal and its rates are those at the end time. Where a choice
is about to change, the derivative is that of the side that is held. After tuning, plan again: another path
may have become better.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.goal.derivative import differentiable_goal, goal_in_time
from jaxplan.goal.followed_goal import Followed, followed_by, least_time_doubt
from jaxplan.goal.free_devices import MadeWay
from jaxplan.model.constraints import Constraints
from jaxplan.model.goals import LEAST_TIME, GivenState, Targets
from jaxplan.model.moving_nodes import Leads, leads_of
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario, moves
from jaxplan.model.zones import Turns, masks
from jaxplan.planner import Plan
from jaxplan.planner.clock import Clock
from jaxplan.planner.proving import prove
from jaxplan.planner.record import end_rates
from jaxplan.planner.runs import as_filed
from jaxplan.planner.steps import find_goals, fit, fitted_plan, judged, pursuit, wanted_fit
from jaxplan.runtime.arguments import expect, show
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import clear_if_full
from jaxplan.runtime.workers import one_thread
from jaxplan.trajectory import REFITS, Fit, Trajectory, by_name, fit_batch
from jaxplan.trajectory.active_set import FitRecord, nearer_optima
from jaxplan.trajectory.schedule import FEWEST_NODES, padded, passed_nodes
from jaxplan.trajectory.sqp import NearOptimum

_NEEDS_TIME = (
    "has targets or zones that move: derivatives and tuning then know given durations only: set "
    "trajectory.duration_s to a number (it has no slopes itself then), or hold what moves at an instant"
)
_A_PLAN = "jp.plan makes one of a scenario"


@shown("goal.slew_angle deg", "last", "attitudes", "joints deg", "fit")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """What is held fixed of a plan. Holds whose arrays have the same shapes can be stacked.

    A path has m + 1 nodes after padding; n terminals and d drives have 2n + d joints.

    Attributes:
        goal: where the manoeuvre ends.
        moves: how devices without a target make way at the goal (`jaxplan.goal.free_devices`).
        met: places in `Targets.prefer` of the wishes that the goal meets.
        attitudes: (m + 1, 3, 3) of the nodes, body to inertial, padded with the last one.
        joints: (m + 1, 2n + d) rad, of the nodes, padded likewise.
        last: number of the last node before the padding.
        leads: which nodes move with the start and the goal, and how.
        fit: the choices that the fit of step 3 made, as its method holds them.
        trajectory: that of the fit; only the shapes of its arrays count, which are those of `replan`.
        turns: for each mask of the spacecraft, by which numbers of whole turns of the yaw it is repeated
            within the yaw's range.
        criterion: the criterion of which the goal is an optimum; None for a goal given as a state. It may be
            the least rotation where the least time is asked for, since a goal of least rotation may be the
            soonest.
    """

    goal: Goal
    moves: tuple[MadeWay, ...]
    attitudes: np.ndarray
    joints: np.ndarray
    last: np.ndarray
    leads: Leads
    fit: Any
    trajectory: Trajectory
    turns: Turns = field(default=(), metadata={"static": True})
    criterion: str | None = field(default=None, metadata={"static": True})
    met: tuple[int, ...] = field(default=(), metadata={"static": True})


def hold(plan: Plan, *, nodes: int = FEWEST_NODES) -> Held:
    """Return what stays fixed of a plan while its scenario changes.

    A new fit of the plan's path tells what is active.

    Args:
        plan: an OK plan with a trajectory in a given duration; where neither targets nor zones move also the
            shortest one, or one whose time was stretched to the limits.
        nodes: the smallest number that the nodes of the path are padded to. A power of two that has room for
            the longest of several paths gives all of them the same shapes, so that they compile once.

    Raises:
        TypeError: if it is no plan.
        ValueError: if `nodes` is no positive integer, or the plan has no trajectory that can be followed: it
            failed, its path has no length, it is a shortest motion with rates at its ends, a target or a zone
            moves and the duration is not given, another limit is about to bind, its goal depends on what a
            device prefers or on what step 1 leaves open (`jaxplan.goal.problem.leaves_open`), or a device
            without a target is stopped by two things at once.
    """
    expect("plan", plan, Plan, _A_PLAN)
    if type(nodes) is not int or nodes < 1:
        raise ValueError(f"nodes = {show(nodes)}: must be a whole number of at least 1")
    return next(hold_each([plan], nodes=nodes))


def hold_each(
    plans: Sequence[Plan], *, nodes: int, known: Sequence[Fit | None] | None = None
) -> Iterator[Held]:
    """Yield what `hold` returns for each plan; the fits of all plans are made together, which is quicker.

    Args:
        plans: the plans to hold.
        nodes: the smallest number of nodes after padding, as in `hold`.
        known: a fit of each plan, as `plan_with_fits` returns them, where None stands for one still to be
            made; None to make all.
    """
    clear_if_full()
    with one_thread():
        ways = [_followable(plan) for plan in plans]
        fits: dict[int, Fit | None] = dict(enumerate(known or [None] * len(ways)))
        missing = [number for number, fit in fits.items() if fit is None]
        wanted = [
            wanted_fit(plan.scenario, path, goal, plan.trajectory)
            for plan, path, goal, _ in (ways[number] for number in missing)
        ]
        fits |= zip(missing, fit_batch(wanted), strict=True)
        origins = {n: fit.origin for n, fit in fits.items() if fit and isinstance(fit.origin, FitRecord)}
        nearer = dict(zip(origins, nearer_optima(list(origins.values())), strict=True))
    for number, (plan, path, goal, followed) in enumerate(ways):
        fitted = fits[number]
        assert fitted is not None
        with one_thread():
            held = _held(plan, path, goal, followed, fitted, nodes, nearer.get(number))
        yield held


def _followable(plan: Plan) -> tuple[Plan, Path, Goal, Followed]:
    """Return an OK plan with its scenario's arrays copied, its path, its goal, and how the goal is followed.

    Raises:
        ValueError: if the plan is not OK, or has no derivatives, with all reasons that can be told before its
            fit is made again.
    """
    scenario, goal = plan.scenario, plan.goal
    if not plan.ok or plan.path is None or goal is None:
        raise ValueError(f"the plan of {scenario.name} ended as {plan.status.name}: only an OK one is held")
    reasons = _told_by(scenario, end_rates(scenario, goal))
    followed = followed_by(scenario, goal)
    _refuse(scenario.name, [*reasons, *followed.doubts])
    return replace(plan, scenario=own_arrays(scenario)), plan.path, goal, followed


def _told_by(scenario: Scenario, end: Sequence[Any]) -> list[str]:
    """Return the reasons why plans of a scenario have no derivatives, as far as the scenario alone tells.

    `end` holds the angular velocity (3,) and joint rates (J,) rad/s at the goal.
    """
    if _needs_time(scenario):
        return [f"its scene {_NEEDS_TIME}"]
    ends = (*_rates(scenario, scenario.start), *end)
    if not scenario.trajectory.timed and any(np.any(rate) for rate in ends):
        return ["it is a shortest motion with rates at its ends: set trajectory.duration_s to a number"]
    return []


def expect_followable(scenario: Scenario) -> None:
    """Raise a ValueError for a scenario none of whose plans can have derivatives.

    Reasons that depend on the plan itself are found by `hold`.
    """
    asked = scenario.asked
    targets = asked if isinstance(asked, Targets) else None
    end = () if targets is not None and targets.moves else _rates(scenario, asked)
    reasons = _told_by(scenario, end)
    if targets is not None and targets.criterion == LEAST_TIME and (targets.moves or targets.prefer):
        reasons.append(least_time_doubt(targets))
    _refuse(scenario.name, reasons)


def _refuse(name: str, reasons: Sequence[str]) -> None:
    """Raise a ValueError that lists the reasons why a plan has no derivatives, unless there are none."""
    if len(reasons) == 1:
        raise ValueError(f"the plan of {name} has no derivatives: {reasons[0]}")
    if reasons:
        numbered = "\n".join(f"  {number}. {reason}" for number, reason in enumerate(reasons, 1))
        raise ValueError(
            f"the plan of {name} has no derivatives, for {len(reasons)} reasons:\n{numbered}\n"
            "A goal that is given as a state, plan.goal.state, and a trajectory.duration_s some per cent "
            "above that of the plan do without all of them"
        )


def own_arrays(scenario: Scenario) -> Scenario:
    """Return the scenario with its numpy arrays copied.

    While JAX differentiates in 32 bits with respect to numpy arrays, it treats these very array objects as
    32-bit ones, even in calls of code that was compiled for 64 bits; copies are not affected.
    """
    copied: Scenario = jax.tree.map(
        lambda leaf: leaf.copy() if isinstance(leaf, np.ndarray) else leaf, scenario
    )
    return copied


def _held(
    plan: Plan,
    path: Path,
    goal: Goal,
    followed: Followed,
    fitted: Fit,
    nodes: int,
    nearer: NearOptimum | None = None,
) -> Held:
    """Return what derivatives hold fixed of an OK plan, given its path, goal and fit.

    Args:
        plan: the plan.
        path: its path.
        goal: its goal.
        followed: how the goal follows the scenario.
        fitted: a fit of the path.
        nodes: the smallest number of nodes after padding.
        nearer: a solution nearer the optimum than the fit; None to look for one now.

    Raises:
        ValueError: if the plan does not move, or its goal is no optimum whose derivative is known.
    """
    _refuse(plan.scenario.name, followed.doubts)
    origin, curve = fitted.origin, fitted.trajectory
    if origin is None or curve is None:
        raise ValueError(f"the plan of {plan.scenario.name} does not move, so nothing of it can be followed")
    ends = (*_rates(plan.scenario, plan.scenario.start), *end_rates(plan.scenario, goal))
    at_speed = any(np.any(rate) for rate in ends)
    path, _ = passed_nodes(path, at_speed=at_speed, every=False)  # as the fit did
    attitudes, joints = padded(path.attitudes, nodes), padded(path.joints, nodes)
    return Held(
        goal=goal,
        moves=followed.moves,
        attitudes=attitudes,
        joints=joints,
        last=np.array(len(path.attitudes) - 1),
        leads=leads_of(attitudes, joints, len(path.attitudes)),
        fit=origin.hold(nodes) if nearer is None else origin.hold(nodes, nearer),
        turns=tuple(mask.turns for mask in masks(plan.scenario.spacecraft)),
        criterion=followed.criterion,
        met=followed.met,
        trajectory=replace(curve, node_times=padded(curve.node_times, nodes)),
    )


def replan(held: Held, scenario: Scenario) -> Trajectory:
    """Compute the trajectory of a scenario near that of a plan, as a pure function of the scenario.

    It composes with ``jit``, ``vmap``, ``grad`` and ``jacfwd``, and must be called within
    ``jax.enable_x64(True)``. Every number of the scenario is an input, and must be a float for ``grad`` to
    return its derivative. First derivatives are exact; there are no second ones. At the plan's own scenario
    the result is the optimum near the plan's trajectory, which is that trajectory itself if
    ``trajectory.optimal`` is set.

    Args:
        held: what is held fixed of the plan, from `hold`.
        scenario: with as many devices and zones, and the same choices, as that of the plan.

    Returns:
        The trajectory. Nothing is checked: to know whether it is safe, plan the scenario.
    """
    expect("held", held, Held, "jp.hold makes one of a plan")
    return replan_to(None, held, expect("scenario", scenario, Scenario, "plan.scenario is the plan's own"))


def replan_to(end: "End | None", held: Held, scenario: Scenario) -> Trajectory:
    """Compute `replan` to a given end, which then has no derivative; None for the end that `end_of` finds."""
    scenario = of_arrays(scenario)
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise ValueError("replan needs numbers of 64 bits: call it within jax.enable_x64(True)")
    expect_known_time(scenario)
    rows = scenario.rows(held.turns)
    return motion_to(end_of(held, scenario, rows) if end is None else end, held, scenario, rows)


class End(NamedTuple):
    """Where a manoeuvre ends, as JAX arrays; J is the number of joints.

    Attributes:
        attitude: (3, 3) body to inertial.
        joints: (J,) rad.
        rates: (3 + J,) rad/s, the angular velocity in body axes, then the joint rates.
    """

    attitude: Any
    joints: Any
    rates: Any


def end_of(held: Held, scenario: Scenario, rows: Constraints) -> End:
    """Return the goal of a scenario near the held one, at the end time of the scenario, with its rates.

    This is the first half of `replan`; `motion_to` is the other.

    Args:
        held: what is held fixed of the plan.
        scenario: the scenario, as `of_arrays` returns it.
        rows: its constraints, from `Scenario.rows`.
    """
    asked = scenario.asked
    if isinstance(asked, GivenState):
        return _end(asked.attitude, asked.joints, _rates(scenario, asked))
    asked = replace(asked, criterion=held.criterion)
    time: Any = jnp.asarray(scenario.trajectory.duration if moves(scenario) else 0.0)
    place = _place(held.goal)
    if not asked.moves:
        craft, start, then = scenario.usable, scenario.start, rows.at(time)
        goal: Any = differentiable_goal(
            place,
            craft,
            start.attitude,
            asked,
            then,
            start_joints=start.joints,
            moves=held.moves,
            met=held.met,
        )
        return _end(goal.attitude, goal.joints, _rates(scenario, asked))
    goal = goal_in_time(place, **pursuit(scenario, asked, time), moves=held.moves)
    return _end(goal.attitude, goal.joints, (goal.angular_velocity, goal.joint_rates))


def held_end(held: Held, scenario: Scenario) -> End | None:
    """Return the held goal as the end of a scenario with the same goal as the plan's.

    The scenario may differ only in what no goal depends on. The result is None where targets or zones move,
    since the goal then depends on the duration.
    """
    if moves(scenario):
        return None
    return _end(held.goal.attitude, held.goal.joints, _rates(scenario, scenario.asked))


def _end(attitude: ArrayLike, joints: ArrayLike, rates: tuple[ArrayLike, ArrayLike]) -> End:
    """Make an `End` of an attitude, joints (J,) rad, and rates, rad/s, of body axes (3,) and joints (J,)."""
    return End(
        attitude=jnp.asarray(attitude),
        joints=jnp.asarray(joints),
        rates=jnp.concatenate([*map(jnp.asarray, rates)]),
    )


def motion_to(end: End, held: Held, scenario: Scenario, rows: Constraints) -> Trajectory:
    """Return the trajectory of a scenario to a given end; the other arguments are those of `end_of`."""
    craft = scenario.usable
    number = jnp.arange(len(held.attitudes))
    first, last = number == 0, number >= held.last

    def nodes(start: Any, between: np.ndarray, end: Any) -> Any:
        shape = (-1, *[1] * (between.ndim - 1))
        return jnp.where(first.reshape(shape), start, jnp.where(last.reshape(shape), end, between))

    attitudes, angles = held.leads.nodes(
        nodes(scenario.start.attitude, held.attitudes, end.attitude),
        nodes(jnp.asarray(scenario.start.joints), held.joints, end.joints),
    )
    path = Path(attitudes=attitudes, joints=angles, edge_costs=np.zeros(0))
    at_start = jnp.concatenate([*map(jnp.asarray, _rates(scenario, scenario.start))])
    # A time that follows from the motion is one from rest to rest: with a rate it would be another motion.
    rates = jnp.stack([at_start, end.rates]) * (1.0 if scenario.trajectory.timed else 0.0)
    refit: Any = by_name(REFITS, scenario.trajectory.method)
    trajectory: Trajectory = refit(held.fit, path, craft, scenario.trajectory, rows, rates)
    return trajectory


def _place(goal: Goal) -> Goal:
    """Return a copy of a goal without its time and rates."""
    return Goal(attitude=goal.attitude, joints=goal.joints, slew_angle=goal.slew_angle)


@one_thread()
def follow(plan: Plan, scenario: Scenario) -> Plan:
    """Plan a scenario near another plan, without a search, along a path with the same corners.

    Args:
        plan: a plan with a path.
        scenario: a scenario with the same devices.

    Returns:
        A plan with a certificate of its own, or with a status that says why there is none. If the scenario
        has several goals, the one nearest to that of the other plan is taken. A shortest motion is looked for
        near that of the other plan, with breaks at the same places where these are at switches.

    Raises:
        TypeError: if the arguments are no plan and no scenario.
        ValueError: for a scenario that `plan` refuses, for one with other devices, or if the plan has no
            path.
    """
    expect("plan", plan, Plan, _A_PLAN)
    filed = as_filed("scenario", scenario)
    before, now = plan.scenario.spacecraft.device_names, filed.spacecraft.device_names
    if before != now:
        named = (", ".join(names) or "none" for names in (now, before))
        raise ValueError("scenario has the devices {}: must have those of the plan, {}".format(*named))
    return _followed(plan, filed, plan.trajectory)[0]


@one_thread()
def follow_and_hold(plan: Plan, scenario: Scenario, *, nodes: int = FEWEST_NODES) -> tuple[Plan, Held | None]:
    """`follow` a plan to a scenario and `hold` the result, with a single fit for both.

    Returns:
        The new plan, and what is held of it; None for the latter where the plan failed or cannot be held.
    """
    followed, fitted = _followed(plan, scenario)
    path, goal = followed.path, followed.goal
    if not followed.ok or fitted is None or path is None or goal is None:
        return followed, None
    try:
        return followed, _held(followed, path, goal, followed_by(scenario, goal), fitted, nodes)
    except ValueError:  # nothing moves, or a row is about to bind
        return followed, None


def _followed(plan: Plan, scenario: Scenario, near: Trajectory | None = None) -> tuple[Plan, Fit | None]:
    """Plan a scenario near another plan, see `follow`, and return the plan with its fit, None without one.

    Args:
        plan: a plan with a path.
        scenario: the scenario to be planned.
        near: a trajectory near which a shortest motion is looked for, on its breaks; None for anywhere.

    Raises:
        ValueError: if the plan has no path, or something moves and the duration is not given.
    """
    if plan.path is None or plan.goal is None:
        raise ValueError(f"the plan of {plan.scenario.name} has no path, it ended as {plan.status.name}")
    expect_known_time(scenario)
    clear_if_full()
    clock = Clock(np.inf)
    duration = scenario.trajectory.duration
    goals = find_goals(scenario, None if isinstance(duration, str) else float(duration))
    if isinstance(goals, Plan):
        return goals, None
    earlier = plan.goal.attitude
    goal = min(goals, key=lambda one: float(np.linalg.norm(one.attitude - earlier)))
    attitudes, joints = plan.path.attitudes.copy(), plan.path.joints.copy()
    attitudes[0], attitudes[-1] = scenario.start.attitude, goal.attitude
    joints[0], joints[-1] = scenario.start.joints, goal.joints
    attitudes, joints = leads_of(plan.path.attitudes, plan.path.joints).nodes(attitudes, joints)
    path = replace(plan.path, attitudes=attitudes, joints=joints)
    with clock.step("trajectory"):
        fitted = fit(scenario, path, goal, near)
    while True:
        followed = fitted_plan(replace(plan, scenario=scenario, goal=goal, path=path), fitted)
        if followed.trajectory is None:
            return followed, fitted
        with clock.step("certificate"):
            certificate = prove(scenario, goal, followed.trajectory)
        if certificate.certified or fitted.spare is None:
            return judged(followed, certificate), fitted
        fitted = fitted.spare


def of_arrays(scenario: Scenario) -> Scenario:
    """Return the scenario with JAX arrays in place of its lists of numbers, some of which may be traced."""

    def is_vector(value: object) -> bool:
        if not isinstance(value, list | tuple) or not len(value) or any(map(is_dataclass, value)):
            return False
        return max(map(np.ndim, value)) < 2  # deeper lists hold arrays, such as masks

    arrays: Scenario = jax.tree.map(
        lambda leaf: jnp.asarray(leaf, float) if is_vector(leaf) else leaf, scenario, is_leaf=is_vector
    )
    return arrays


def _rates(scenario: Scenario, end: Any) -> tuple[Any, Any]:
    """Return the angular velocity (3,) and joint rates (J,) rad/s of a start or goal, with zeros for None."""
    given, counts = (end.angular_velocity, end.joint_rates), (3, scenario.spacecraft.joint_count)
    velocity, rates = (
        np.zeros(count) if own is None else own for own, count in zip(given, counts, strict=True)
    )
    return velocity, rates


def _needs_time(scenario: Scenario) -> bool:
    """Tell whether a target or zone moves and no duration is given; the duration then depends on the goal."""
    return moves(scenario) and not scenario.trajectory.timed


def expect_known_time(scenario: Scenario) -> None:
    """Raise a ValueError where a target or zone moves and no duration is given."""
    if _needs_time(scenario):
        raise ValueError(f"{scenario.name} {_NEEDS_TIME}")
