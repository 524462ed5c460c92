"""Decorators by which measures of a trajectory accept plans, and run as one compiled kernel each.

Outside of what JAX traces, a measure and its gradient are a compiled kernel each: otherwise `jax.grad` would
compile one for each of the hundreds of operations that they take. A plan may be given in place of its
trajectory; then its own spacecraft and zones are used where none are given. Other functions of numbers run in
the same way, such as the bounds and optima that slopes of days are made of.

In this module *numbers* are the leaves of a measure's arguments that can be differentiated, and a *way* is a
tangent, that is, a direction in which they change.
"""

from collections.abc import Callable
from functools import cache, partial, wraps
from inspect import signature
from typing import Any, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.model.constraints import Constraints
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.differentiation import linear_map
from jaxplan.runtime.jit import is_traced, quick_jit, to_numpy
from jaxplan.trajectory.curve import Trajectory

Given = ParamSpec("Given")
Out = TypeVar("Out")

_MEASURES: dict[str, Callable[..., Array]] = {}  # the undecorated functions by name
_ARRAY_MEASURES: set[str] = set()  # names of the measures whose value is an array, not a single number

# Arguments that a plan's scene supplies: their classes, and functions that get them from the scene.
_SCENE_ARGUMENTS: dict[str, tuple[type, Callable[[Any], Any]]] = {
    "craft": (Spacecraft, lambda scene: scene.spacecraft),
    "cones": (Constraints, lambda scene: scene.constraints),
}

Chosen = tuple[tuple[str, Any], ...]  # names and values of the arguments that are not numbers


def _call_measure(name: str, chosen: Chosen, given: dict[str, Any]) -> Array:
    """Call the measure of this name with its arguments `given` and those that are not numbers, `chosen`."""
    return _MEASURES[name](**given, **dict(chosen))


def _value_and_gradient(name: str, chosen: Chosen, given: dict[str, Any]) -> tuple[Array, Any]:
    """Return `_call_measure` and its gradient in the numbers, a tree like `given`."""
    return jax.value_and_grad(partial(_call_measure, name, chosen), allow_int=True)(given)


def _is_differentiable(leaf: Any) -> bool:
    """Tell whether a leaf of the arguments can be differentiated, as floating-point numbers can."""
    return bool(jnp.issubdtype(jnp.result_type(leaf), jnp.floating))


def _as_function_of_numbers(
    name: str, chosen: Chosen, given: dict[str, Any]
) -> tuple[Callable[..., Array], list[Any]]:
    """Return `_call_measure` as a function of a list of its differentiable numbers, and that list."""

    def measured(numbers: list[Any]) -> Array:
        left = iter(numbers)
        own = jax.tree.map(lambda leaf: next(left) if _is_differentiable(leaf) else leaf, given)
        return _call_measure(name, chosen, own)

    return measured, list(filter(_is_differentiable, jax.tree.leaves(given)))


@partial(quick_jit, level=0, static_argnums=(0, 1))
def _push_forward(name: str, chosen: Chosen, given: dict[str, Any], way: list[Any]) -> Array:
    """Derivative of a measure along a tangent `way` of its numbers, see `_as_function_of_numbers`."""
    measured, numbers = _as_function_of_numbers(name, chosen, given)
    return jax.jvp(measured, (numbers,), (way,))[1]


@partial(quick_jit, level=0, static_argnums=(0, 1))
def _pull_back(name: str, chosen: Chosen, given: dict[str, Any], cotangents: Array) -> list[Any]:
    """Multiply cotangents by a measure's derivatives in its numbers, see `_as_function_of_numbers`."""
    measured, numbers = _as_function_of_numbers(name, chosen, given)
    (slopes,) = jax.vjp(measured, numbers)[1](cotangents)
    return list(slopes)


@cache
def _derivative_map(name: str, chosen: Chosen) -> Callable[..., list[Array]]:
    """Make the derivative of a measure that is an array, as a linear map of tangents of its numbers."""
    return linear_map(
        f"slopes of {name}",
        lambda given, way: [_push_forward(name, chosen, given, list(way))],
        lambda given, cotangents: _pull_back(name, chosen, given, *cotangents),
    )


_jitted_value = quick_jit(_call_measure, level=0, static_argnums=(0, 1))
_jitted_value_and_gradient = quick_jit(_value_and_gradient, level=0, static_argnums=(0, 1))
_differentiable_value = jax.custom_jvp(_call_measure, nondiff_argnums=(0, 1))


@_differentiable_value.defjvp
def _jvp_rule(name: str, chosen: Chosen, own: tuple[Any], ways: tuple[Any]) -> tuple[Array, Array]:
    """Derivative rule of `_differentiable_value` for tangents `ways`, by compiled kernels outside traces.

    Returns:
        The measure's value and its derivative along the tangents.
    """
    if is_traced(own):
        return jax.jvp(partial(_call_measure, name, chosen), own, ways)
    own = to_numpy(own)
    if name in _ARRAY_MEASURES:  # gradients of all entries would be too much if one number is made of them
        found, leaves = _jitted_value(name, chosen, *own), map(jax.tree.leaves, (own, ways))
        way = [way for leaf, way in zip(*leaves, strict=True) if _is_differentiable(leaf)]
        return found, _derivative_map(name, chosen)(*own, way, [found])[0]
    found, slopes = _jitted_value_and_gradient(name, chosen, *own)
    return found, _directional_derivative(slopes, *ways)


def at_once(
    *choices: str, of_arrays: bool = False
) -> Callable[[Callable[Given, Array]], Callable[Given, Array]]:
    """Make a decorator that runs a measure, and its gradient, as one jitted kernel each outside traces.

    A measure of numpy arrays is computed in 64 bits and returned as a numpy number or array.

    Args:
        choices: names of the arguments that are not numbers; they must be hashable.
        of_arrays: whether the measure is an array rather than a single number.
    """

    def decorate(measure: Callable[Given, Array]) -> Callable[Given, Array]:
        name, parameters = measure.__name__, signature(measure)
        if _MEASURES.setdefault(name, measure).__module__ != measure.__module__:
            raise ValueError(f"{measure.__module__}.{name}: there is another measure of this name")
        _MEASURES[name] = measure
        if of_arrays:
            _ARRAY_MEASURES.add(name)

        @wraps(measure)
        def run(*args: Given.args, **kwargs: Given.kwargs) -> Array:
            bound = parameters.bind(*args, **kwargs)
            bound.apply_defaults()
            given = dict(bound.arguments)
            chosen = tuple((choice, given.pop(choice)) for choice in choices)
            if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(given)):
                if is_traced(given):
                    return _differentiable_value(name, chosen, given)
                return _jitted_value(name, chosen, to_numpy(given))
            with jax.enable_x64(True):
                return np.asarray(_jitted_value(name, chosen, to_numpy(given)))[()]  # type: ignore[return-value]

        return run

    return decorate


@jax.jit
def _directional_derivative(slopes: Any, ways: Any) -> Array:
    """Derivative along a tangent `ways` of all numbers of a tree, from the gradient `slopes` in them."""
    pairs = zip(jax.tree.leaves(slopes), jax.tree.leaves(ways), strict=True)
    return sum(
        (jnp.sum(slope * way) for slope, way in pairs if slope.dtype != jax.dtypes.float0), jnp.zeros(())
    )


def of_plans(measure: Callable[..., Out]) -> Callable[..., Out]:
    """Make a measure of a trajectory, its first argument, accept a plan in place of the trajectory.

    With a plan the arguments ``craft`` and ``cones`` may be left out; those of the plan are then used.
    """
    parameters = signature(measure)
    wanted = [name for name in _SCENE_ARGUMENTS if name in parameters.parameters]

    @wraps(measure)
    def called(*args: Any, **kwargs: Any) -> Out:
        given = dict(parameters.bind_partial(*args, **kwargs).arguments)
        plan = given.get("trajectory")
        if plan is not None and not isinstance(plan, Trajectory):
            given["trajectory"] = _trajectory_of(plan)
            scene = getattr(plan, "scenario", getattr(plan, "scene", None))
            for name in wanted:
                given.setdefault(name, _SCENE_ARGUMENTS[name][1](scene))
        for name in wanted:
            if name in given:
                kind = _SCENE_ARGUMENTS[name][0]
                hint = f"of a plan {name} may be left out, and what comes after is told by its name"
                expect(name, given[name], kind, hint)
        return measure(**given)

    return called


def _trajectory_of(plan: object) -> Trajectory:
    """Return the trajectory of a plan, or the argument itself if it is a trajectory.

    Raises:
        TypeError: if it is neither.
        ValueError: if the plan has no trajectory.
    """
    found = getattr(plan, "trajectory", plan)
    if found is None:
        ending = getattr(getattr(plan, "status", None), "name", "without one")
        raise ValueError(f"trajectory: the plan has none, it ended as {ending}")
    if isinstance(found, Trajectory):
        return found
    return expect("trajectory", plan, Trajectory, "a plan may stand for its own")
