"""The trajectory of a plan with derivatives for ``jax.grad`` and ``jax.jit``.

    >>> trajectory = jp.differentiable(plan)
    >>> slopes = jax.grad(lambda scenario: jp.measures.effort(trajectory(scenario)))(plan.scenario)

The function is `replan` of what `hold` returns (`jaxplan.derivatives`). Where plain numbers are
differentiated it runs compiled kernels of its own, and within `jax.jit` it is traced as any other function of
JAX. The kernels are two, compiled side by side: one finds where the manoeuvre ends, with the derivatives of
that; the other finds the trajectory that ends there, and its derivatives by the chain rule.

All is computed in 64 bits, since 32 bits leave the slopes of an optimum no accuracy. Where JAX itself is set
to 32 bits, as it is by default, `differentiable` exports the function once from within 64 bits, and what a
trace sees are its numbers rounded to 32 bits: values and slopes are then good to some seven digits.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import Any
from weakref import WeakSet

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, export
from jax.flatten_util import ravel_pytree

from jaxplan import so3
from jaxplan.derivatives import (
    End,
    Held,
    end_of,
    expect_alike,
    hold,
    motion_to,
    of_arrays,
    own_arrays,
    replan,
)
from jaxplan.model.nameless import nameless
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.planner import Plan
from jaxplan.planner.entry_points import as_filed
from jaxplan.planner.proving import prove
from jaxplan.planner.steps import judged
from jaxplan.runtime.ahead import Task, side_by_side
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.differentiation import linear_map, once_differentiable
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import is_traced, quick_jit, to_numpy
from jaxplan.trajectory import Trajectory

Reached = tuple[End, Any]  # with derivatives (E, N) of its E numbers by the N `_float_leaves` of a scenario

# Kernels for all plans of equal shapes. A gradient is asked for seldom, and need not be the quickest.
_replan_jit = quick_jit(replan, level=0)


def _is_float(leaf: Any) -> bool:
    """Tell whether a number of a scenario can be differentiated, which holds for floating-point ones."""
    return bool(jnp.issubdtype(jnp.result_type(leaf), jnp.floating))


def _float_leaves(scenario: Scenario) -> list[Any]:
    """Return the numbers of a scenario that can be differentiated, as leaves of its tree in order."""
    return list(filter(_is_float, jax.tree.leaves(scenario)))


def _with_numbers(scenario: Scenario, numbers: list[Any]) -> Scenario:
    """Return a scenario with other `_float_leaves`."""
    left = iter(numbers)
    changed: Scenario = jax.tree.map(lambda leaf: next(left) if _is_float(leaf) else leaf, scenario)
    return changed


def _replan_from_numbers(held: Held, scenario: Scenario, numbers: list[Any]) -> Trajectory:
    """Compute `replan` as a function of the differentiable numbers of a scenario (see `_float_leaves`)."""
    return replan(held, _with_numbers(scenario, numbers))


@partial(quick_jit, level=0)
def _end_with_slopes(held: Held, scenario: Scenario) -> Reached:
    """Return where a manoeuvre ends, and the derivatives (E, N) of that by a scenario's numbers.

    These are the E numbers of the `End`, by the N `_float_leaves` of the scenario.
    """

    def end(numbers: list[Any]) -> tuple[Array, End]:
        own = of_arrays(_with_numbers(scenario, numbers))
        found = end_of(held, own, own.rows(held.turns))
        return ravel_pytree(found)[0], found

    flat, pull_back, found = jax.vjp(end, _float_leaves(scenario), has_aux=True)
    (rows,) = jax.vmap(pull_back)(jnp.eye(len(flat), dtype=flat.dtype))
    return found, jnp.concatenate([row.reshape(len(flat), -1) for row in rows], axis=1)


@partial(quick_jit, level=0)
def _trajectory_with_slopes(
    reached: Reached, held: Held, scenario: Scenario, cotangents: Trajectory, wanted: bool
) -> tuple[Trajectory, list[Any]]:
    """Return a scenario's trajectory and, if `wanted`, the product of cotangents with its derivatives.

    One kernel serves the forward and the backward pass of a gradient, since most of it is the same. The
    backward pass computes the trajectory once more: if it were handed the intermediate results instead, which
    are functions that JAX makes, the kernel could not be kept for other processes.

    Args:
        reached: where the manoeuvre ends, with derivatives, as `_end_with_slopes` returns it for the
            scenario.
        held: what is held fixed of the plan.
        scenario: a scenario near that of the plan.
        cotangents: of the trajectory.
        wanted: whether the product is computed; if not, zeros stand in its place.

    Returns:
        The trajectory, and an array for each of the scenario's differentiable numbers (see `_float_leaves`).
    """
    numbers, (end, end_slopes) = _float_leaves(scenario), reached

    def motion(end: End, numbers: list[Any]) -> Trajectory:
        own = of_arrays(_with_numbers(scenario, numbers))
        return motion_to(end, held, own, own.rows(held.turns))

    found, pull_back = jax.vjp(motion, end, numbers)

    def product(cotangents: Trajectory) -> list[Any]:
        of_end, own = pull_back(cotangents)
        by_end = ravel_pytree(numbers)[1](ravel_pytree(of_end)[0] @ end_slopes)
        return [one + other for one, other in zip(own, by_end, strict=True)]

    nothing = list(map(jnp.zeros_like, numbers))
    return found, jax.lax.cond(wanted, product, lambda _: nothing, cotangents)


@partial(quick_jit, level=0)
def _trajectory_jvp(held: Held, scenario: Scenario, way: list[Any]) -> Trajectory:
    """Return the derivative of a trajectory along tangents of its scenario's differentiable numbers.

    `way` holds these tangents, in the order of `_float_leaves`.
    """
    along: Trajectory = jax.jvp(
        partial(_replan_from_numbers, held, scenario), (_float_leaves(scenario),), (way,)
    )[1]
    return along


def _given(held: Held, scenario: Scenario) -> tuple[Held, Scenario]:
    """Return what kernels take: arrays of numpy, and a scenario without what splits them for nothing."""
    plain: tuple[Held, Scenario] = to_numpy((held, nameless(scenario)))
    return plain


def _given_motion(held: Held, scenario: Scenario) -> tuple[Held, Scenario]:
    """Return `_given` without how the goal was chosen, on which the motion to it does not depend."""
    return _given(replace(held, moves=(), met=(), criterion=None), scenario)


_compiled_for: WeakSet[Held] = WeakSet()  # those whose kernels have been compiled


def _find_end(held: Held, scenario: Scenario) -> Reached:
    """Find by a kernel where a scenario's manoeuvre ends; the first call for `held` compiles both kernels."""
    if held not in _compiled_for:
        side_by_side(_compilation_tasks(held, scenario), lambda: None)
        _compiled_for.add(held)
    found: Reached = to_numpy(_end_with_slopes(*_given(held, scenario)))
    return found


def _trajectory_value(held: Held, scenario: Scenario, reached: Reached) -> Trajectory:
    """Return a scenario's trajectory to its known end, by the kernel that also computes its derivatives."""
    nothing = jax.tree.map(np.zeros_like, held.trajectory)
    return _trajectory_with_slopes(reached, *_given_motion(held, scenario), nothing, False)[0]


def _compilation_tasks(held: Held, scenario: Scenario) -> list[Task]:
    """Return tasks to run in threads, which compile the kernels of `_find_end` and `_trajectory_vjp`."""
    own = _given(held, scenario)
    joints = np.asarray(held.goal.joints, float)
    end = End(np.asarray(held.goal.attitude, float), joints, np.zeros(3 + len(joints)))
    count = sum(map(np.size, _float_leaves(scenario)))
    slopes = np.zeros((sum(map(np.size, end)), count))
    nothing = jax.tree.map(np.zeros_like, own[0].trajectory)

    def wide(kernel: Callable[..., Any], *given: Any) -> None:
        with jax.enable_x64(True):
            kernel(*given)

    return [
        partial(wide, _trajectory_with_slopes, (end, slopes), *_given_motion(held, scenario), nothing, False),
        partial(wide, _end_with_slopes, *own),
    ]


def _trajectory_vjp(held: Held, scenario: Scenario, reached: Reached, cotangents: Trajectory) -> list[Any]:
    """Return cotangents times a trajectory's derivatives by its scenario's differentiable numbers.

    The products are in the order of `_float_leaves`.
    """
    reached, cotangents = to_numpy((reached, cotangents))
    return _trajectory_with_slopes(reached, *_given_motion(held, scenario), cotangents, True)[1]


def _forward(own: tuple[Held, Scenario, Reached], way: Any) -> list[Any]:
    """Return the leaves of the derivative of the trajectory along tangents `way`, for `linear_map`."""
    held, scenario, _ = own
    return jax.tree.leaves(_trajectory_jvp(*_given(held, scenario), to_numpy(list(way))))


def _backward(own: tuple[Held, Scenario, Reached], answers: Any) -> list[Any]:
    """Return cotangents, as leaves of a trajectory, times its derivatives: the transpose of `_forward`."""
    return _trajectory_vjp(*own, jax.tree.unflatten(jax.tree.structure(own[0].trajectory), answers))


_slopes_map = linear_map("slopes of a plan", _forward, _backward)


def differentiable(plan: Plan) -> "Differentiable":
    """Return the trajectory of a plan as a differentiable function of its scenario.

    What a planner chooses has no derivative and is held fixed, see `jaxplan.derivatives`: which local minimum
    of step 1 the goal is, the corners of the path and when each is passed, and which limits, zones and nodes
    bind. A plan that is made anew chooses all of these again.

    Args:
        plan: an OK plan in a given duration; where nothing moves and both ends are at rest, also the shortest
            one or one stretched to the limits.

    Returns:
        A function of a scenario like that of the plan, see `Differentiable`.

    Raises:
        TypeError: if it is no plan.
        ValueError: as for `hold`, if there is no trajectory that can be followed.

    Example:
        >>> slopes = jax.grad(lambda s: jp.measures.effort(jp.differentiable(plan)(s)))(plan.scenario)
        >>> slopes.trajectory.duration  # rad^2/s^4
    """
    return Differentiable(plan, hold(plan))


@shown("plan.scenario.name", "plan.trajectory.duration s", "held")
class Differentiable:
    """Pure function from a scenario to a trajectory near that of a plan, with derivatives.

    It composes with ``jit``, ``grad`` and ``vmap``, and within ``jax.enable_x64(True)`` also with ``jvp`` and
    ``jacfwd``; all numbers then have 64 bits. Called with plain numbers it returns 64 bits, too. For a traced
    scenario of 32 bits, trajectory and slopes have 32. Numbers that cannot be differentiated, such as seeds,
    are held fixed by ``grad``.

    Attributes:
        plan: the plan to whose trajectory it belongs.
        held: what is held fixed of the plan.
        optimum: the plan at the optimum whose slopes the function has.
    """

    def __init__(self, plan: Plan, held: Held) -> None:
        self.plan, self.held = plan, held
        self._functions_32_bits: dict[Any, Callable[[Scenario], Trajectory]] = {}
        self._function_64_bits = _replan_in_64_bits(held)

    @cached_property
    def optimum(self) -> Plan:
        """The plan with the trajectory that the function returns at its scenario, and a certificate of that.

        The energy of a plan may be some thousandths above the optimum, which is good enough to fly. Slopes
        are those of the optimum; with ``trajectory.optimal`` the plan is at it already. The optimum touches
        limits at the times that a fit checks, so it may break one slightly in between; its status is then
        UNCERTIFIED.
        """
        plan, scenario = self.plan, own_arrays(self.plan.scenario)
        with jax.enable_x64(True):
            reached = _find_end(self.held, scenario)
            trajectory = jax.tree.map(np.asarray, _trajectory_value(self.held, scenario, reached))
        # Step 1 may leave the goal some 1e-8 rad off the optimum.
        goal = _goal_at(self.held.goal, scenario, jax.tree.map(np.asarray, reached[0]))
        return judged(
            replace(plan, goal=goal, trajectory=trajectory, status=Status.OK),
            prove(plan.scenario, goal, trajectory),
        )

    def __call__(self, scenario: Scenario) -> Trajectory:
        """Return the trajectory of a scenario near that of the plan; whether it is safe is not checked.

        Args:
            scenario: with the same devices, as many zones, and the same choices as that of the plan. One of
                plain numbers is taken in as `jp.plan` does: lists may stand for arrays.

        Raises:
            TypeError: if it is not a Scenario.
            ScenarioError: for plain numbers that a scenario file may not have, and wrong types or shapes.
            ValueError: for other devices, or more or fewer zones; the message names them.
        """
        expect("scenario", scenario, Scenario, "plan.scenario is the plan's own")
        traced = is_traced(scenario)
        if not traced:
            scenario = as_filed("scenario", scenario)
        expect_alike(self.plan.scenario, scenario)
        if not traced:
            with jax.enable_x64(True):
                own = own_arrays(scenario)
                found = _trajectory_value(self.held, own, _find_end(self.held, own))
            return jax.tree.map(np.asarray, found)  # type: ignore[no-any-return]
        if jax.config.jax_enable_x64:  # type: ignore[attr-defined]
            return self._function_64_bits(scenario)
        narrow: Scenario = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), scenario)
        kind = jax.tree.structure(narrow), tuple(leaf.shape for leaf in jax.tree.leaves(narrow))
        if kind not in self._functions_32_bits:
            wide = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, np.float64), narrow)
            self._functions_32_bits[kind] = _replan_in_32_bits(self.held, wide)
        return self._functions_32_bits[kind](narrow)


def _goal_at(held: Goal, scenario: Scenario, end: End) -> Goal:
    """Return a held goal moved to where a scenario's manoeuvre ends; rates only where the goal has them."""
    turned = float(so3.distance(scenario.start.attitude, end.attitude))
    goal = replace(held, attitude=end.attitude, joints=end.joints, slew_angle=turned)
    if held.angular_velocity is None:
        return goal
    return replace(goal, angular_velocity=end.rates[:3], joint_rates=end.rates[3:])


def _replan_in_64_bits(held: Held) -> Callable[[Scenario], Trajectory]:
    """Return `replan` as a function of 64-bit scenarios; kernels compute derivatives at plain numbers."""
    wide: Any = jax.custom_jvp(partial(_replan_jit, held))

    def follow(own: tuple[Scenario], ways: tuple[Scenario]) -> tuple[Trajectory, Trajectory]:
        if is_traced(own):
            traced: tuple[Trajectory, Trajectory] = jax.jvp(partial(_replan_jit, held), own, ways)
            return traced
        (scenario,) = own
        reached = _find_end(held, scenario)
        found = _trajectory_value(held, scenario, reached)
        way = [
            way
            for way, leaf in zip(*map(jax.tree.leaves, (ways[0], scenario)), strict=True)
            if _is_float(leaf)
        ]
        answers, tree = jax.tree.flatten(found)
        return found, jax.tree.unflatten(tree, _slopes_map((held, scenario, reached), way, answers))

    wide.defjvp(follow)
    followed: Callable[[Scenario], Trajectory] = wide
    return followed


def _replan_in_32_bits(held: Held, wide: Scenario) -> Callable[[Scenario], Trajectory]:
    """Return `replan` as a function of 32-bit scenarios, computed in 64 bits.

    Plain numbers go to kernels. What is traced while JAX is set to 32 bits cannot be traced again in 64, so
    for traced numbers both the function and its product with cotangents are exported when first needed, and
    the exported code is called.

    Args:
        held: what is held fixed of the plan.
        wide: a scenario with the shapes that the function will be called with, and types of 64 bits.
    """

    @cache
    def exported() -> tuple[Callable[..., Any], Callable[..., Any]]:
        function = partial(replan, held)

        def product(scenario: Scenario, cotangents: Trajectory) -> Scenario:
            (found,) = jax.vjp(function, scenario)[1](cotangents)
            return found

        value = export.export(jax.jit(function))(wide)
        answers = jax.eval_shape(function, wide)
        return value.call, export.export(jax.jit(product))(wide, answers).call

    def wide_value(scenario: Scenario) -> Trajectory:
        with jax.enable_x64(True):
            return _cast(exported()[0](_cast(scenario, jnp.float64)), jnp.float32)

    def wide_product(scenario: Scenario, cotangents: Trajectory) -> Scenario:
        with jax.enable_x64(True):
            given = _cast((scenario, cotangents), jnp.float64)
            return _cast(exported()[1](*given), jnp.float32)

    # Exported functions cannot be batched, so the calls of a batch are made one after the other.
    value: Callable[[Scenario], Trajectory] = once_differentiable(
        jax.custom_batching.sequential_vmap(wide_value)
    )
    product: Callable[..., Scenario] = once_differentiable(jax.custom_batching.sequential_vmap(wide_product))

    def forward(scenario: Scenario) -> tuple[Trajectory, Scenario]:
        if is_traced(scenario):
            return value(scenario), scenario
        with jax.enable_x64(True):
            own = _cast(scenario, jnp.float64)
            return _cast(_trajectory_value(held, own, _find_end(held, own)), jnp.float32), scenario

    def backward(scenario: Scenario, cotangents: Trajectory) -> tuple[Scenario]:
        if is_traced((scenario, cotangents)):
            return (product(scenario, cotangents),)
        with jax.enable_x64(True):
            own, ways = _cast((scenario, cotangents), jnp.float64)
            slopes = _cast(_trajectory_vjp(held, own, _find_end(held, own), ways), jnp.float32)
            return (jax.tree.unflatten(jax.tree.structure(scenario), slopes),)

    narrow: Any = jax.custom_vjp(lambda scenario: value(scenario))
    narrow.defvjp(forward, backward)
    followed: Callable[[Scenario], Trajectory] = narrow
    return followed


def _cast(tree: Any, dtype: Any) -> Any:
    """Return a tree with all its leaves, traced or not, converted to a dtype."""

    def cast(leaf: Any) -> Any:
        if isinstance(leaf, jax.core.Tracer):
            return jax.lax.convert_element_type(leaf, dtype)
        return np.asarray(leaf, dtype)  # numpy converts without compiling a kernel

    return jax.tree.map(cast, tree)
