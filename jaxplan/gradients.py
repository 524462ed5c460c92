"""The trajectory of a plan with derivatives for ``jax.grad`` and ``jax.jit``.

    >>> trajectory = jp.differentiable(plan)
    >>> slopes = jax.grad(lambda scenario: jp.measures.effort(trajectory(scenario)))(plan.scenario)

It is `replan` of what `hold` returns (`jaxplan.derivatives`), by compiled kernels of its own where plain
numbers are differentiated, and as any other function of JAX within `jax.jit`.

All is computed in 64 bits, since an optimum of 32 bits has no slopes worth the name. Where JAX itself is set
to 32 bits, as it is by default, `differentiable` exports the function once from within 64 bits, and what a
trace sees of it are numbers of 32 bits: values and slopes are then good to some seven digits.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import export

from jaxplan.derivatives import Held, hold, own_arrays, replan
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.planner import Plan
from jaxplan.planner.proving import prove
from jaxplan.planner.steps import judged
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import is_traced, quick_jit
from jaxplan.runtime.linear import linear_map
from jaxplan.trajectory import Trajectory

# Kernels for all plans of equal shapes. A gradient is asked for seldom, and need not be the quickest.
_replan = quick_jit(replan, level=0)


def _is_real(leaf: Any) -> bool:
    """Whether a number of a scenario can be differentiated: floating-point ones."""
    return bool(jnp.issubdtype(jnp.result_type(leaf), jnp.floating))


def _real(scenario: Scenario) -> list[Any]:
    """The numbers of a scenario that can be differentiated, leaves of its tree in order."""
    return list(filter(_is_real, jax.tree.leaves(scenario)))


def _replan_by(held: Held, scenario: Scenario, numbers: list[Any]) -> Trajectory:
    """`replan` as a function of the scenario's `_real` numbers."""
    left = iter(numbers)
    own = jax.tree.map(lambda leaf: next(left) if _is_real(leaf) else leaf, scenario)
    return replan(held, own)


@partial(quick_jit, level=0)
def _with_slopes(
    held: Held, scenario: Scenario, cotangents: Trajectory, wanted: bool
) -> tuple[Trajectory, list[Any]]:
    """A scenario's trajectory and, if `wanted`, the product of cotangents with its derivatives, else zeros.

    One kernel serves both ways of a gradient, since most of it is the same. On the way back it computes the
    trajectory once more: with what could be passed on instead, the functions that JAX makes of it, the kernel
    could not be kept for other processes.
    """
    numbers = _real(scenario)
    found, pull_back = jax.vjp(partial(_replan_by, held, scenario), numbers)
    slopes = jax.lax.cond(
        wanted, lambda own: pull_back(own)[0], lambda _: list(map(jnp.zeros_like, numbers)), cotangents
    )
    return found, slopes


@partial(quick_jit, level=0)
def _along(held: Held, scenario: Scenario, way: list[Any]) -> Trajectory:
    """The derivative of a scenario's trajectory along tangents `way` of its `_real` numbers."""
    along: Trajectory = jax.jvp(partial(_replan_by, held, scenario), (_real(scenario),), (way,))[1]
    return along


def _plain(tree: Any) -> Any:
    """A tree with its numbers as arrays of numpy, but for tracers, so that one kernel serves all callers."""
    return jax.tree.map(lambda leaf: leaf if isinstance(leaf, jax.core.Tracer) else np.asarray(leaf), tree)


def _value(held: Held, scenario: Scenario) -> Trajectory:
    """A scenario's trajectory, by the kernel that computes its derivatives, too."""
    nothing = jax.tree.map(np.zeros_like, held.trajectory)
    return _with_slopes(*_plain((held, scenario, nothing)), False)[0]


def _pulled(held: Held, scenario: Scenario, cotangents: Trajectory) -> list[Any]:
    """The product of cotangents with the trajectory's derivatives by the scenario's `_real` numbers."""
    return _with_slopes(*_plain((held, scenario, cotangents)), True)[1]


def _forward(own: tuple[Held, Scenario], way: Any) -> list[Any]:
    """Leaves of `_along`, as `linear_map` takes them."""
    return jax.tree.leaves(_along(*_plain((*own, list(way)))))


def _backward(own: tuple[Held, Scenario], answers: Any) -> list[Any]:
    """`_pulled` of cotangents given as leaves of a trajectory, the transpose of `_forward`."""
    return _pulled(*own, jax.tree.unflatten(jax.tree.structure(own[0].trajectory), answers))


_slopes = linear_map("slopes of a plan", _forward, _backward)


def differentiable(plan: Plan) -> "Differentiable":
    """The trajectory of a plan as a function of its scenario.

    What a planner chooses has no derivative and is held fixed, see `jaxplan.derivatives`: the goal among the
    local minima of step 1, the corners of the path and when each is passed, and which limits, zones
    and nodes bind. A plan that is made anew chooses all of these again.

    Args:
        plan: an OK one, in a given duration, or from rest to rest the shortest one or one stretched to the
            limits; where targets or zones move, in a given duration.

    Returns:
        A function of a scenario like that of the plan, see `Differentiable`.

    Raises:
        TypeError: if it is no plan.
        ValueError: as of `hold`, if there is no trajectory that can be followed.

    Example:
        >>> slopes = jax.grad(lambda s: jp.measures.effort(jp.differentiable(plan)(s)))(plan.scenario)
        >>> slopes.trajectory.duration  # rad^2/s^4
    """
    return Differentiable(plan, hold(plan))


@shown("plan.scenario.name", "plan.trajectory.duration s", "held")
class Differentiable:
    """A pure function from scenarios to trajectories that composes with ``jit``, ``grad`` and ``vmap``.

    Within ``jax.enable_x64(True)`` also with ``jvp`` and ``jacfwd``, and all numbers have 64 bits. Called
    with plain numbers it answers in 64 bits, too. Of a traced scenario of 32 bits trajectory and slopes have
    32. Numbers that cannot be differentiated, such as seeds, are no inputs of ``grad``: they are held.

    Attributes:
        plan: to whose trajectory it belongs.
        held: what is held fixed of it.
        optimum: the plan at the optimum whose slopes the function has.
    """

    def __init__(self, plan: Plan, held: Held) -> None:
        self.plan, self.held = plan, held
        self._known: dict[Any, Callable[[Scenario], Trajectory]] = {}
        self._wide = _in_64_bits(held)

    @cached_property
    def optimum(self) -> Plan:
        """The plan with the trajectory that the function has at its scenario, and a certificate of that.

        A plan may end some thousandths of its energy above the optimum, which is enough to fly. Slopes are
        those of the optimum; with ``trajectory.optimal`` the plan is at it already. It touches limits at the
        places that a fit looks at, so what lies between may break one by a little; then it is UNCERTIFIED.
        """
        plan, goal = self.plan, self.held.goal
        trajectory = self(plan.scenario)
        return judged(
            replace(plan, trajectory=trajectory, status=Status.OK), prove(plan.scenario, goal, trajectory)
        )

    def __call__(self, scenario: Scenario) -> Trajectory:
        """The trajectory of a scenario near that of the plan; nothing is checked.

        Args:
            scenario: with as many devices and zones, and the same choices, as that of the plan.
        """
        expect("scenario", scenario, Scenario, "plan.scenario is the plan's own")
        if not is_traced(scenario):
            with jax.enable_x64(True):
                found: Trajectory = jax.tree.map(np.asarray, _replan(self.held, own_arrays(scenario)))
            return found
        if jax.config.jax_enable_x64:  # type: ignore[attr-defined]
            return self._wide(scenario)
        narrow: Scenario = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), scenario)
        kind = jax.tree.structure(narrow), tuple(leaf.shape for leaf in jax.tree.leaves(narrow))
        if kind not in self._known:
            wide = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, np.float64), narrow)
            self._known[kind] = _in_32_bits(self.held, wide)
        return self._known[kind](narrow)


def _in_64_bits(held: Held) -> Callable[[Scenario], Trajectory]:
    """`replan` as a function of arrays of 64 bits, by kernels where plain numbers are differentiated."""
    wide: Any = jax.custom_jvp(partial(_replan, held))

    def follow(own: tuple[Scenario], ways: tuple[Scenario]) -> tuple[Trajectory, Trajectory]:
        if is_traced(own):
            traced: tuple[Trajectory, Trajectory] = jax.jvp(partial(_replan, held), own, ways)
            return traced
        (scenario,) = own
        found = _value(held, scenario)
        way = [
            way
            for way, leaf in zip(*map(jax.tree.leaves, (ways[0], scenario)), strict=True)
            if _is_real(leaf)
        ]
        answers, tree = jax.tree.flatten(found)
        return found, jax.tree.unflatten(tree, _slopes((held, scenario), way, answers))

    wide.defjvp(follow)
    followed: Callable[[Scenario], Trajectory] = wide
    return followed


def _in_32_bits(held: Held, wide: Scenario) -> Callable[[Scenario], Trajectory]:
    """`replan` as a function of arrays of 32 bits, computed in 64.

    Plain numbers go to kernels. What is traced where JAX is set to 32 bits may not be traced anew by it, so
    for these both the function and its product with cotangents are exported, once they are needed: what is
    called is compiled as it is.

    Args:
        held: of the plan.
        wide: a scenario of the shapes that it is to be called with, and types of 64 bits.
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

    # What is exported knows of no batch.
    value: Callable[[Scenario], Trajectory] = jax.custom_batching.sequential_vmap(wide_value)
    product: Callable[..., Scenario] = jax.custom_batching.sequential_vmap(wide_product)

    def forward(scenario: Scenario) -> tuple[Trajectory, Scenario]:
        if is_traced(scenario):
            return value(scenario), scenario
        with jax.enable_x64(True):
            return _cast(_value(held, _cast(scenario, jnp.float64)), jnp.float32), scenario

    def backward(scenario: Scenario, cotangents: Trajectory) -> tuple[Scenario]:
        if is_traced((scenario, cotangents)):
            return (product(scenario, cotangents),)
        with jax.enable_x64(True):
            own, ways = _cast((scenario, cotangents), jnp.float64)
            slopes = _cast(_pulled(held, own, ways), jnp.float32)
            return (jax.tree.unflatten(jax.tree.structure(scenario), slopes),)

    narrow: Any = jax.custom_vjp(lambda scenario: value(scenario))
    narrow.defvjp(forward, backward)
    followed: Callable[[Scenario], Trajectory] = narrow
    return followed


def _cast(tree: Any, dtype: Any) -> Any:
    """A tree with all its leaves converted to a dtype, traced or not."""

    def cast(leaf: Any) -> Any:
        if isinstance(leaf, jax.core.Tracer):
            return jax.lax.convert_element_type(leaf, dtype)
        return np.asarray(leaf, dtype)  # without a kernel

    return jax.tree.map(cast, tree)
