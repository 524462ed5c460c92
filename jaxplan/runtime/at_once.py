"""Functions of numbers that run, with their gradients, as one compiled kernel each.

Outside of what JAX traces, `jax.grad` would compile a kernel for each of the hundreds of operations that a
function takes. Those that `at_once` decorates are a kernel, and their gradient another: measures of a
trajectory, and the bounds and optima that slopes of days are made of.

In this module *numbers* are the leaves of a function's arguments that can be differentiated, and a *way* is a
tangent, that is, a direction in which they change.
"""

from collections.abc import Callable
from functools import cache, partial, wraps
from inspect import signature
from typing import Any, ParamSpec

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.runtime.differentiation import linear_map
from jaxplan.runtime.jit import is_traced, quick_jit, to_numpy

Given = ParamSpec("Given")

_FUNCTIONS: dict[str, Callable[..., Array]] = {}  # the undecorated functions by name
_ARRAY_FUNCTIONS: set[str] = set()  # names of the functions whose value is an array, not a single number

Chosen = tuple[tuple[str, Any], ...]  # names and values of the arguments that are not numbers


def _call(name: str, chosen: Chosen, given: dict[str, Any]) -> Array:
    """Call the function of this name with its arguments `given` and those that are not numbers, `chosen`."""
    return _FUNCTIONS[name](**given, **dict(chosen))


def _value_and_gradient(name: str, chosen: Chosen, given: dict[str, Any]) -> tuple[Array, Any]:
    """Return `_call` and its gradient in the numbers, a tree like `given`."""
    return jax.value_and_grad(partial(_call, name, chosen), allow_int=True)(given)


def _is_differentiable(leaf: Any) -> bool:
    """Tell whether a leaf of the arguments can be differentiated, as floating-point numbers can."""
    return bool(jnp.issubdtype(jnp.result_type(leaf), jnp.floating))


def _as_function_of_numbers(
    name: str, chosen: Chosen, given: dict[str, Any]
) -> tuple[Callable[..., Array], list[Any]]:
    """Return `_call` as a function of a list of its differentiable numbers, and that list."""

    def measured(numbers: list[Any]) -> Array:
        left = iter(numbers)
        own = jax.tree.map(lambda leaf: next(left) if _is_differentiable(leaf) else leaf, given)
        return _call(name, chosen, own)

    return measured, list(filter(_is_differentiable, jax.tree.leaves(given)))


@partial(quick_jit, level=0, static_argnums=(0, 1))
def _push_forward(name: str, chosen: Chosen, given: dict[str, Any], way: list[Any]) -> Array:
    """Derivative of a function along a tangent `way` of its numbers, see `_as_function_of_numbers`."""
    measured, numbers = _as_function_of_numbers(name, chosen, given)
    return jax.jvp(measured, (numbers,), (way,))[1]


@partial(quick_jit, level=0, static_argnums=(0, 1))
def _pull_back(name: str, chosen: Chosen, given: dict[str, Any], cotangents: Array) -> list[Any]:
    """Multiply cotangents by a function's derivatives in its numbers, see `_as_function_of_numbers`."""
    measured, numbers = _as_function_of_numbers(name, chosen, given)
    (slopes,) = jax.vjp(measured, numbers)[1](cotangents)
    return list(slopes)


@cache
def _derivative_map(name: str, chosen: Chosen) -> Callable[..., list[Array]]:
    """Make the derivative of a function that is an array, as a linear map of tangents of its numbers."""
    return linear_map(
        f"slopes of {name}",
        lambda given, way: [_push_forward(name, chosen, given, list(way))],
        lambda given, cotangents: _pull_back(name, chosen, given, *cotangents),
    )


_jitted_value = quick_jit(_call, level=0, static_argnums=(0, 1))
_jitted_value_and_gradient = quick_jit(_value_and_gradient, level=0, static_argnums=(0, 1))
_differentiable_value = jax.custom_jvp(_call, nondiff_argnums=(0, 1))


@_differentiable_value.defjvp
def _jvp_rule(name: str, chosen: Chosen, own: tuple[Any], ways: tuple[Any]) -> tuple[Array, Array]:
    """Derivative rule of `_differentiable_value` for tangents `ways`, by compiled kernels outside traces.

    Returns:
        The function's value and its derivative along the tangents.
    """
    if is_traced(own):
        return jax.jvp(partial(_call, name, chosen), own, ways)
    own = to_numpy(own)
    if name in _ARRAY_FUNCTIONS:  # gradients of all entries would be too much if one number is made of them
        found, leaves = _jitted_value(name, chosen, *own), map(jax.tree.leaves, (own, ways))
        way = [way for leaf, way in zip(*leaves, strict=True) if _is_differentiable(leaf)]
        return found, _derivative_map(name, chosen)(*own, way, [found])[0]
    found, slopes = _jitted_value_and_gradient(name, chosen, *own)
    return found, _directional_derivative(slopes, *ways)


def at_once(
    *choices: str, of_arrays: bool = False
) -> Callable[[Callable[Given, Array]], Callable[Given, Array]]:
    """Make a decorator that runs a function, and its gradient, as one jitted kernel each outside traces.

    A function of numpy arrays is computed in 64 bits and returned as a numpy number or array.

    Args:
        choices: names of the arguments that are not numbers; they must be hashable.
        of_arrays: whether the value is an array rather than a single number.
    """

    def decorate(function: Callable[Given, Array]) -> Callable[Given, Array]:
        name, parameters = function.__name__, signature(function)
        if _FUNCTIONS.setdefault(name, function).__module__ != function.__module__:
            raise ValueError(f"{function.__module__}.{name}: there is another function of this name")
        _FUNCTIONS[name] = function
        if of_arrays:
            _ARRAY_FUNCTIONS.add(name)

        @wraps(function)
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
