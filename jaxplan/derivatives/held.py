"""What is held fixed of a plan while its scenario changes: the choices that a planner makes.

These are the goal and what is active there (`jaxplan.goal.followed_goal`), the corners of the path, and which
limits, zones and nodes bind in the trajectory (`jaxplan.trajectory.active_set`).

Some scenarios and plans have no derivatives. All reasons why are told at once; those that depend on the fit
of a plan are found when it is held.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import jax
import numpy as np

from jaxplan.goal.followed_goal import AS_A_STATE, Followed, followed_by, least_time_doubt
from jaxplan.goal.free_devices import MadeWay
from jaxplan.model.goals import LEAST_TIME, Targets
from jaxplan.model.path import Goal, Leads, Path, leads_of
from jaxplan.model.scenario import Scenario, moves
from jaxplan.model.zones import Turns, masks
from jaxplan.planner import Plan
from jaxplan.planner.record import end_rates
from jaxplan.planner.steps import wanted_fit
from jaxplan.planner.wheel_room import leans_on_wheels
from jaxplan.runtime.arguments import expect, show
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import clear_if_full
from jaxplan.runtime.workers import one_thread
from jaxplan.trajectory import Fit, Trajectory, fit_batch
from jaxplan.trajectory.active_set import FitRecord, nearer_optima
from jaxplan.trajectory.node_times import FEWEST_NODES, padded, passed_nodes
from jaxplan.trajectory.sqp import NearOptimum

A_PLAN = "jp.plan makes one of a scenario"
_NEEDS_TIME = (
    "has targets or zones that move: derivatives and tuning then know given durations only: set "
    "trajectory.duration_s to a number, or hold what moves at an instant"
)
_WHEEL_DOUBT = f"its goal leans on what a wheel may hold there: {AS_A_STATE}"

Tree = TypeVar("Tree")


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
        trajectory: that of the fit; only the shapes of its arrays count, which are those of
            `jaxplan.derivatives.replan`.
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
    expect("plan", plan, Plan, A_PLAN)
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
        known: a fit of each plan, as `jaxplan.planner.entry_points.plan_with_fits` returns them, where
            None stands for one still to be made; None to make all.
    """
    clear_if_full()
    with one_thread():
        ways = [checked_plan(plan) for plan in plans]
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
            held = held_of(plan, path, goal, followed, fitted, nodes, nearer.get(number))
        yield held


def checked_plan(plan: Plan) -> tuple[Plan, Path, Goal, Followed]:
    """Return an OK plan with its scenario's arrays copied, its path, its goal, and how the goal is followed.

    Raises:
        ValueError: if the plan is not OK, or has no derivatives, with all reasons that can be told before its
            fit is made again.
    """
    scenario, goal = plan.scenario, plan.goal
    if not plan.ok or plan.path is None or goal is None:
        raise ValueError(f"the plan of {scenario.name} ended as {plan.status.name}: only an OK one is held")
    reasons = reasons_of_scenario(scenario, end_rates(scenario, goal))
    followed = follow_goal(scenario, goal)
    refuse(scenario.name, [*reasons, *followed.doubts])
    return replace(plan, scenario=own_arrays(scenario)), plan.path, goal, followed


def follow_goal(scenario: Scenario, goal: Goal) -> Followed:
    """Tell how the goal of a plan follows its scenario, or why not, by `followed_by` and what wheels hold."""
    followed = followed_by(scenario, goal)
    doubts = (_WHEEL_DOUBT,) if leans_on_wheels(scenario, goal) else ()
    return replace(followed, doubts=(*followed.doubts, *doubts))


def held_of(
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
    refuse(plan.scenario.name, followed.doubts)
    origin, curve = fitted.origin, fitted.trajectory
    if origin is None or curve is None:
        raise ValueError(f"the plan of {plan.scenario.name} does not move, so nothing of it can be followed")
    ends = (*rates_at(plan.scenario, plan.scenario.start), *end_rates(plan.scenario, goal))
    at_speed = any(np.any(rate) for rate in ends)
    path, _ = passed_nodes(path, at_speed=at_speed, every=False)  # as the fit did
    attitudes, joints = padded(path.attitudes, nodes), padded(path.joints, nodes)
    held = Held(
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
    return own_arrays(held)  # a goal that is given as a state is made of the scenario's own arrays


def own_arrays(tree: Tree) -> Tree:
    """Return a tree, such as a scenario, with its numpy arrays copied.

    While JAX differentiates in 32 bits with respect to numpy arrays, it treats these very array objects as
    32-bit ones, even in calls of code that was compiled for 64 bits; copies are not affected.
    """
    copied: Tree = jax.tree.map(lambda leaf: leaf.copy() if isinstance(leaf, np.ndarray) else leaf, tree)
    return copied


def expect_followable(scenario: Scenario) -> None:
    """Raise a ValueError for a scenario none of whose plans can have derivatives.

    Reasons that depend on the plan itself are found by `hold`.
    """
    asked = scenario.asked
    targets = asked if isinstance(asked, Targets) else None
    end = () if targets is not None and targets.moves else rates_at(scenario, asked)
    reasons = reasons_of_scenario(scenario, end)
    if targets is not None and targets.criterion == LEAST_TIME and (targets.moves or targets.prefer):
        reasons.append(least_time_doubt(targets))
    refuse(scenario.name, reasons)


def reasons_of_scenario(scenario: Scenario, end: Sequence[Any]) -> list[str]:
    """Return the reasons why plans of a scenario have no derivatives, as far as the scenario alone tells.

    `end` holds the angular velocity (3,) and joint rates (J,) rad/s at the goal.
    """
    if needs_time(scenario):
        return [f"its scene {_NEEDS_TIME}"]
    ends = (*rates_at(scenario, scenario.start), *end)
    if not scenario.trajectory.timed and any(np.any(rate) for rate in ends):
        return ["it is a shortest motion with rates at its ends: set trajectory.duration_s to a number"]
    return []


def refuse(name: str, reasons: Sequence[str]) -> None:
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


def needs_time(scenario: Scenario) -> bool:
    """Tell whether a target or zone moves and no duration is given; the duration then depends on the goal."""
    return moves(scenario) and not scenario.trajectory.timed


def expect_known_time(scenario: Scenario) -> None:
    """Raise a ValueError where a target or zone moves and no duration is given."""
    if needs_time(scenario):
        raise ValueError(f"{scenario.name} {_NEEDS_TIME}")


def expect_same_devices(own: Scenario, other: Scenario) -> None:
    """Raise a ValueError if a scenario has other devices than that of a plan, `own`, by their names."""
    names, others = (one.spacecraft.device_names for one in (own, other))
    if others != names:
        told = ", ".join(others) or "none", ", ".join(names) or "none"
        raise ValueError("scenario has the devices {}: must have those of the plan, {}".format(*told))


def expect_alike(own: Scenario, other: Scenario) -> None:
    """Raise a ValueError if a scenario has other devices than that of a plan, `own`, or not as many zones."""
    expect_same_devices(own, other)
    for kind in ("keep_out", "keep_in", "joint_bounds"):
        zones, others = (getattr(one, kind) for one in (own, other))
        if len(others) != len(zones):
            told = (", ".join(zone.name for zone in each) or "none" for each in (others, zones))
            raise ValueError(
                "scenario has {} {}: must have as many as the plan, which has {}".format(kind, *told)
            )


def rates_at(scenario: Scenario, end: Any) -> tuple[Any, Any]:
    """Return the angular velocity (3,) and joint rates (J,) rad/s of a start or goal, with zeros for None."""
    given, counts = (end.angular_velocity, end.joint_rates), (3, scenario.spacecraft.joint_count)
    velocity, rates = (
        np.zeros(count) if own is None else own for own, count in zip(given, counts, strict=True)
    )
    return velocity, rates
