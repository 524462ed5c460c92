"""Decorators by which measures of a trajectory accept plans, and run as one compiled kernel each.

Outside of what JAX traces, a measure and its gradient are a compiled kernel each: otherwise `jax.grad` would
compile one for each of the hundreds of operations that they take. A plan may be given in place of its
trajectory; then its own spacecraft and zones are used where none are given.

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
from jaxplan.runtime.jit import is_traced, quick_jit
from jaxplan.runtime.linear import linear_map
from jaxplan.trajectory.curve import Trajectory

Given = ParamSpec("Given")
Out = TypeVar("Out")

_MEASURES: dict[str, Callable[..., Array]] = {}  # the undecorated functions by name
_OF_ARRAYS: set[str] = set()  # names of the measures whose value is an array, not a single number

# Arguments that a plan's scene supplies: their classes, and functions that get them from the scene.
_OF_SCENES: dict[str, tuple[type, Callable[[Any], Any]]] = {
    "craft": (Spacecraft, lambda scene: scene.spacecraft),
    "cones": (Constraints, lambda scene: scene.constraints),
}

Chosen = tuple[tuple[str, Any], ...]  # names and values of the arguments that are not numbers


def _measured(name: str, chosen: Chosen, given: dict[str, Any]) -> Array:
    """Call the measure of this name with its arguments `given` and those that are not numbers, `chosen`."""
    return _MEASURES[name](**given, **dict(chosen))


def _measured_with_slopes(name: str, chosen: Chosen, given: dict[str, Any]) -> tuple[Array, Any]:
    """Return `_measured` and its gradient in the numbers, a tree like `given`."""
    return jax.value_and_grad(partial(_measured, name, chosen), allow_int=True)(given)


def _is_real(leaf: Any) -> bool:
    """Whether a leaf of the arguments can be differentiated, as floating-point numbers can."""
    return bool(jnp.issubdtype(jnp.result_type(leaf), jnp.floating))


def _by_numbers(name: str, chosen: Chosen, given: dict[str, Any]) -> tuple[Callable[..., Array], list[Any]]:
    """Return `_measured` as a function of a list of its differentiable numbers, and that list."""

    def measured(numbers: list[Any]) -> Array:
        left = iter(numbers)
        own = jax.tree.map(lambda leaf: next(left) if _is_real(leaf) else leaf, given)
        return _measured(name, chosen, own)

    return measured, list(filter(_is_real, jax.tree.leaves(given)))


@partial(quick_jit, level=0, static_argnums=(0, 1))
def _pushed(name: str, chosen: Chosen, given: dict[str, Any], way: list[Any]) -> Array:
    """Derivative of a measure along a tangent `way` of its numbers, see `_by_numbers`."""
    measured, numbers = _by_numbers(name, chosen, given)
    return jax.jvp(measured, (numbers,), (way,))[1]


@partial(quick_jit, level=0, static_argnums=(0, 1))
def _pulled(name: str, chosen: Chosen, given: dict[str, Any], cotangents: Array) -> list[Any]:
    """Multiply cotangents by a measure's derivatives in its numbers, see `_by_numbers`."""
    measured, numbers = _by_numbers(name, chosen, given)
    (slopes,) = jax.vjp(measured, numbers)[1](cotangents)
    return list(slopes)


@cache
def _slopes(name: str, chosen: Chosen) -> Callable[..., list[Array]]:
    """Make the derivative of a measure that is an array, as a linear map of tangents of its numbers."""
    return linear_map(
        f"slopes of {name}",
        lambda given, way: [_pushed(name, chosen, given, list(way))],
        lambda given, cotangents: _pulled(name, chosen, given, *cotangents),
    )


_value = quick_jit(_measured, level=0, static_argnums=(0, 1))
_value_with_slopes = quick_jit(_measured_with_slopes, level=0, static_argnums=(0, 1))
_followed = jax.custom_jvp(_measured, nondiff_argnums=(0, 1))


@_followed.defjvp
def _follow(name: str, chosen: Chosen, own: tuple[Any], ways: tuple[Any]) -> tuple[Array, Array]:
    """Derivative rule of `_followed` for tangents `ways`: outside traces it uses compiled kernels.

    Returns:
        The measure's value and its derivative along the tangents.
    """
    if is_traced(own):
        return jax.jvp(partial(_measured, name, chosen), own, ways)
    if name in _OF_ARRAYS:  # gradients of all entries would be too much if one number is made of them
        found, leaves = _value(name, chosen, *own), map(jax.tree.leaves, (own, ways))
        way = [way for leaf, way in zip(*leaves, strict=True) if _is_real(leaf)]
        return found, _slopes(name, chosen)(*own, way, [found])[0]
    found, slopes = _value_with_slopes(name, chosen, *own)
    return found, _along(slopes, *ways)


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
        _MEASURES[name] = measure
        if of_arrays:
            _OF_ARRAYS.add(name)

        @wraps(measure)
        def run(*args: Given.args, **kwargs: Given.kwargs) -> Array:
            bound = parameters.bind(*args, **kwargs)
            bound.apply_defaults()
            given = dict(bound.arguments)
            chosen = tuple((choice, given.pop(choice)) for choice in choices)
            if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(given)):
                return (_followed if is_traced(given) else _value)(name, chosen, given)
            with jax.enable_x64(True):
                return np.asarray(_value(name, chosen, given))[()]  # type: ignore[return-value]

        return run

    return decorate


@jax.jit
def _along(slopes: Any, ways: Any) -> Array:
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
    wanted = [name for name in _OF_SCENES if name in parameters.parameters]

    @wraps(measure)
    def called(*args: Any, **kwargs: Any) -> Out:
        given = dict(parameters.bind_partial(*args, **kwargs).arguments)
        plan = given.get("trajectory")
        if plan is not None and not isinstance(plan, Trajectory):
            given["trajectory"] = _trajectory_of(plan)
            scene = getattr(plan, "scenario", getattr(plan, "scene", None))
            for name in wanted:
                given.setdefault(name, _OF_SCENES[name][1](scene))
        for name in wanted:
            if name in given:
                kind = _OF_SCENES[name][0]
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
