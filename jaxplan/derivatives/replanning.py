"""The trajectory of a scenario near a plan, as a pure function that JAX differentiates.

`replan` has two halves: the end of the manoeuvre (`end_of`), and the trajectory to it (`motion_to`).
"""

from dataclasses import is_dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.derivatives.held import Held, expect_known_time, rates_at
from jaxplan.goal.derivative import differentiable_goal, goal_in_time
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import resplined
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario, moves
from jaxplan.planner.steps import pursuit
from jaxplan.runtime.arguments import expect
from jaxplan.trajectory import REFITS, Trajectory, by_name


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
        return make_end(asked.attitude, asked.joints, rates_at(scenario, asked))
    asked = replace(asked, criterion=held.criterion)
    time: Any = jnp.asarray(scenario.trajectory.duration if moves(scenario) else 0.0)
    place = _without_rates(held.goal)
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
        return make_end(goal.attitude, goal.joints, rates_at(scenario, asked))
    goal = goal_in_time(place, **pursuit(scenario, asked, time), moves=held.moves)
    return make_end(goal.attitude, goal.joints, (goal.angular_velocity, goal.joint_rates))


def held_end(held: Held, scenario: Scenario) -> End | None:
    """Return the held goal as the end of a scenario with the same goal as the plan's.

    The scenario may differ only in what no goal depends on. The result is None where targets or zones move,
    since the goal then depends on the duration.
    """
    if moves(scenario):
        return None
    return make_end(held.goal.attitude, held.goal.joints, rates_at(scenario, scenario.asked))


def make_end(attitude: ArrayLike, joints: ArrayLike, rates: tuple[ArrayLike, ArrayLike]) -> End:
    """Make an `End` of an attitude, joints (J,) rad, and rates, rad/s, of body axes (3,) and joints (J,)."""
    return End(
        attitude=jnp.asarray(attitude),
        joints=jnp.asarray(joints),
        rates=jnp.concatenate([*map(jnp.asarray, rates)]),
    )


def _without_rates(goal: Goal) -> Goal:
    """Return a copy of a goal without its time and rates."""
    return Goal(attitude=goal.attitude, joints=goal.joints, slew_angle=goal.slew_angle)


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
    at_start = jnp.concatenate([*map(jnp.asarray, rates_at(scenario, scenario.start))])
    # A time that follows from the motion is one from rest to rest: with a rate it would be another motion.
    rates = jnp.stack([at_start, end.rates]) * (1.0 if scenario.trajectory.timed else 0.0)
    refit: Any = by_name(REFITS, scenario.trajectory.method)
    trajectory: Trajectory = refit(held.fit, path, craft, scenario.trajectory, rows, rates)
    return trajectory


def of_arrays(scenario: Scenario) -> Scenario:
    """Return the scenario as a differentiable function takes it; its numbers may be traced.

    JAX arrays stand in place of lists of numbers, and slopes of paths follow from their samples and times.
    """

    def is_numbers(value: object) -> bool:
        return 1 <= _depth(value) <= 2  # deeper lists hold arrays, such as masks

    arrays: Scenario = jax.tree.map(
        lambda leaf: jnp.asarray(leaf, float) if is_numbers(leaf) else leaf, scenario, is_leaf=is_numbers
    )
    return resplined(arrays)


def _depth(value: object) -> int:
    """Return how deep lists of numbers are nested; 0 for what is none, or empty, or has other objects."""
    if not isinstance(value, list | tuple) or not len(value) or any(map(is_dataclass, value)):
        return 0
    return 1 + max(_depth(one) or np.ndim(one) for one in value)
