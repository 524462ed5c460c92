"""A plan as a function of its scenario, for ``jax.grad`` and ``jax.jit`` at any precision of JAX.

    >>> trajectory = jp.differentiable(plan)
    >>> slopes = jax.grad(lambda scenario: jp.measures.effort(trajectory(scenario)))(plan.scenario)

All is computed in 64 bits, since an optimum of 32 bits has no slopes worth the name. Where JAX itself is
set to 32 bits, as it is by default, the function is exported once from within 64 bits, and what a trace sees
of it are numbers of 32 bits: values and slopes are then good to some seven digits.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import export

from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.planner import Plan
from jaxplan.planner.proof import prove
from jaxplan.planner.steps import judged
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.display import shown
from jaxplan.sensitivity import Held, hold, replan
from jaxplan.trajectory import Trajectory

Numbers = tuple[Any, ...]

_replan = jax.jit(replan)  # compiled once for all plans of equal shapes


def differentiable(plan: Plan) -> "Differentiable":
    """The trajectory of a plan as a function of its scenario.

    What a planner chooses has no derivative and is held fixed, see `jaxplan.sensitivity`: the goal among the
    local minima of step 1, the interior nodes of the path and when each is passed, and which limits, zones
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
        self._known: dict[Any, tuple[Callable[..., Numbers], Any]] = {}

    @cached_property
    def optimum(self) -> Plan:
        """The plan with the trajectory that the function has at its scenario, and a certificate of that.

        A plan ends a thousandth of its energy or less above the optimum, which is enough to fly. Slopes are
        those of the optimum. It leans on limits at the places that a fit looks at, so what lies between may
        break one by a little; then it is UNCERTIFIED.
        """
        plan, goal = self.plan, self.plan.goal
        assert goal is not None, "only a plan with a goal is held"
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
        leaves, tree = jax.tree.flatten(scenario)
        if not any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            with jax.enable_x64(True):
                found: Trajectory = jax.tree.map(np.asarray, _replan(self.held, scenario))
            return found
        if jax.config.jax_enable_x64:  # type: ignore[attr-defined]
            return _replan(self.held, scenario)
        shapes = tuple(np.shape(leaf) for leaf in leaves)
        if (tree, shapes) not in self._known:
            self._known[tree, shapes] = _in_32_bits(
                lambda *own: replan(self.held, jax.tree.unflatten(tree, own)), shapes
            )
        function, made = self._known[tree, shapes]
        given = [jnp.asarray(leaf, jnp.float32) for leaf in leaves]
        answer: Trajectory = jax.tree.unflatten(made, function(*given))
        return answer


def _in_32_bits(
    function: Callable[..., Any], shapes: Sequence[tuple[int, ...]]
) -> tuple[Callable[..., Numbers], Any]:
    """A function of arrays of 64 bits as one of 32 bits, computed in 64, and the tree of its answers.

    Neither may be traced anew by JAX where it is set to 32 bits, so both the function and its product with
    cotangents are exported: what is called is compiled as it is.
    """
    with jax.enable_x64(True):
        given = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in shapes]
        answers, made = jax.tree.flatten(jax.eval_shape(function, *given))

        def leaves(*own: Any) -> Numbers:
            return tuple(jax.tree.leaves(function(*own)))

        def pulled(own: Numbers, cotangents: Numbers) -> Numbers:
            return tuple(jax.vjp(leaves, *own)[1](cotangents))

        value = export.export(jax.jit(leaves))(*given)
        slope = export.export(jax.jit(pulled))(tuple(given), tuple(answers))

    def at(*own: Any) -> Numbers:
        with jax.enable_x64(True):
            return _cast(value.call(*_cast(own, jnp.float64)), jnp.float32)

    def back(own: Numbers, cotangents: Numbers) -> Numbers:
        with jax.enable_x64(True):
            found = slope.call(_cast(own, jnp.float64), _cast(cotangents, jnp.float64))
            return _cast(found, jnp.float32)

    one_by_one: Any = jax.custom_batching.sequential_vmap(at)  # what is exported knows of no batch
    narrow: Any = jax.custom_vjp(lambda *own: one_by_one(*own))
    narrow.defvjp(lambda *own: (one_by_one(*own), own), jax.custom_batching.sequential_vmap(back))
    return narrow, made


def _cast(values: Sequence[Any], dtype: Any) -> Numbers:
    return tuple(jax.lax.convert_element_type(value, dtype) for value in values)
