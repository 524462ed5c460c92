"""Functions with derivatives of their own: linear maps outside `jax.jit`, and roots of equations.

**Linear maps** have a compiled kernel (`jaxplan.runtime.jit`) for each direction. What JAX makes of a jitted
function when it differentiates it outside `jax.jit` is traced and compiled anew in every process, without the
options of `jaxplan.runtime.jit.quick_jit`. A rule of `jax.custom_jvp` may call kernels instead, but what it
returns for tangents must be something that JAX can transpose. `linear_map` makes such functions.

**Roots of equations** are differentiable functions of their inputs, by the implicit function theorem. Where
``F(z; inputs) = 0`` and the matrix ``K = dF / dz`` has an inverse, ``dz = -K^-1 (dF / d inputs)``. The goals
of planning step 1 and the trajectories of step 3 are such roots of their optimality conditions, with the set
of active constraints held fixed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NoReturn

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxplan.runtime.jit import is_traced

Arrays = Sequence[Any]
Map = Callable[[Any, Arrays], Sequence[Array]]


def linear_map(name: str, forward: Map, backward: Map) -> Callable[[Any, Arrays, Any], list[Array]]:
    """Make a linear map that JAX can transpose, batch and jit.

    Args:
        name: name of the map in traces and messages.
        forward: (tree, vector) -> image: the map. The tree is any pytree that the map depends on; vector and
            image are sequences of arrays.
        backward: (tree, image) -> vector: the transpose of the map.

    Returns:
        (tree, vector, like) -> image: the map, where `like` has arrays of the image's shapes and dtypes. A
        derivative with respect to the tree raises a NotImplementedError.
    """
    primitive = Primitive(name)
    primitive.multiple_results = True

    def apply(*args: Any, tree: Any, **_: Any) -> Sequence[Array]:
        count = tree.num_leaves
        return forward(tree.unflatten(args[:count]), args[count:])

    def transpose(answers: Arrays, *args: Any, tree: Any, **_: Any) -> list[Any]:
        count = tree.num_leaves
        found = backward(tree.unflatten(args[:count]), [ad.instantiate_zeros(one) for one in answers])
        return [None] * count + list(found)

    def differentiate(args: Arrays, ways: Arrays, *, tree: Any, shapes: Any) -> tuple[Any, Any]:
        count = tree.num_leaves
        if not all(type(way) is ad.Zero for way in ways[:count]):
            raise NotImplementedError(f"{name} cannot be differentiated in what it depends on")
        along = (*args[:count], *map(ad.instantiate_zeros, ways[count:]))
        return tuple(primitive.bind(*own, tree=tree, shapes=shapes) for own in (args, along))

    def batch(args: Arrays, axes: Any, **told: Any) -> tuple[Any, Any]:
        answers = jax.vmap(lambda *own: apply(*own, **told), in_axes=tuple(axes))(*args)
        return answers, [0] * len(answers)

    primitive.def_impl(apply)
    primitive.def_abstract_eval(lambda *_, shapes, **__: list(shapes))
    ad.primitive_transposes[primitive] = transpose
    ad.primitive_jvps[primitive] = differentiate
    batching.primitive_batchers[primitive] = batch
    mlir.register_lowering(primitive, mlir.lower_fun(apply, multiple_results=True))

    def mapped(fixed: Any, vector: Arrays, like: Any) -> list[Array]:
        leaves, tree = jax.tree.flatten(fixed) if is_traced(fixed) else ([], _LeaflessTree(fixed))
        shapes = tuple(jax.core.ShapedArray(jnp.shape(one), jnp.result_type(one)) for one in like)
        found: list[Array] = primitive.bind(*leaves, *vector, tree=tree, shapes=shapes)
        return found

    return mapped


class _LeaflessTree:
    """A tree of plain numbers that poses as the structure of a tree without leaves.

    If its numbers were arguments of a primitive, they would pass through each of JAX's transformations.
    """

    num_leaves = 0

    def __init__(self, tree: Any) -> None:
        self.tree = tree

    def unflatten(self, _: Arrays) -> Any:
        """Return the tree with its own numbers."""
        return self.tree


@dataclass(frozen=True, kw_only=True)
class Equations:
    """Equations ``F(z; inputs) = 0`` for n unknowns z, and how to solve them.

    `residual` and `linearise` take (inputs, z). The object is hashed by its functions, so make it only once.

    Attributes:
        residual: computes ``F`` (n,), to be differentiated in the inputs.
        linearise: computes ``F`` (n,) and factors of ``K`` near a root, a pytree of arrays.
        solve: from such factors and a vector ``v`` (n,) computes ``K^-1 v``.
        steps: the most steps of Newton's method before the last one.
        tolerance: if all components of the residual are within it, the step from there is the last.
        again: whether derivatives may be differentiated again; if not, that raises an error.
    """

    residual: Callable[[Any, Array], Array]
    linearise: Callable[[Any, Array], tuple[Array, Any]]
    solve: Callable[[Any, Array], Array]
    steps: int
    tolerance: float
    again: bool = False


def implicit_root(equations: Equations, inputs: Any, guess: Array) -> Array:
    """Return the root near a guess, differentiable in the inputs in forward and reverse mode.

    Args:
        equations: those to solve.
        inputs: all that they depend on, a pytree.
        guess: (n,) where Newton's method starts; without influence on the derivative.

    Returns:
        (n,) ``z`` after the last step; whether it is a root is not checked.
    """
    return _root_and_factors(equations, inputs, guess)[0]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _root_and_factors(equations: Equations, inputs: Any, guess: Array) -> tuple[Array, Any]:
    """Return the root (n,), and the factors of the last step; arguments as `implicit_root`."""
    linearise = jax.jit(lambda *own: equations.linearise(*own))  # so that it is traced once in a call

    def ahead(at: tuple[Any, ...]) -> tuple[Any, ...]:
        count, _, z, _ = at
        left, factors = linearise(inputs, z)
        last = jnp.all(jnp.abs(left) <= equations.tolerance) | (count == equations.steps)
        return count + 1, last, z - equations.solve(factors, left), factors

    _, shapes = jax.eval_shape(linearise, inputs, guess)
    none = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
    *_, z, factors = jax.lax.while_loop(
        lambda at: ~at[1], ahead, (jnp.array(0), jnp.array(False), guess, none)
    )
    return z, factors


@_root_and_factors.defjvp
def _root_tangents(
    equations: Equations, primals: tuple[Any, Array], tangents: tuple[Any, Any]
) -> tuple[Any, Any]:
    """Return values and tangents of `_root_and_factors`, by the implicit function theorem.

    The tangents of factors are zero.
    """
    z, factors = _root_and_factors(equations, *primals)
    inputs = primals[0]
    if equations.again:
        _, own = equations.linearise(inputs, z)
    else:  # factors are constants, and so is what follows from them
        inputs, own = _first_derivatives_only(inputs), factors
    _, left = jax.jvp(lambda inputs: equations.residual(inputs, z), (inputs,), (tangents[0],))
    return (z, factors), (-equations.solve(own, left), jax.tree.map(_zero_tangent, factors))


def _zero_tangent(value: Array) -> Any:
    """Return the zero tangent of an array, in the type that JAX requires."""
    if jnp.issubdtype(value.dtype, jnp.floating):
        return jnp.zeros_like(value)
    return np.zeros(value.shape, jax.dtypes.float0)


@jax.custom_jvp
def _not_differentiable(value: Any) -> Any:
    """Return the value unchanged; differentiating it raises an error."""
    return value


@_not_differentiable.defjvp
def _raise_on_derivative(*_: Any) -> NoReturn:
    raise NotImplementedError(
        "plans have first derivatives only, since what binds is held: take differences of those"
    )


def once_differentiable(rule: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that a rule for derivatives calls, which raises an error if it is differentiated."""
    found: Any = jax.custom_jvp(rule)
    found.defjvp(_raise_on_derivative)
    return lambda *own: found(*own)


def _first_derivatives_only(tree: Any) -> Any:
    """Return a tree of equal numbers whose derivatives raise an error, for use within a rule for tangents."""
    return jax.tree.map(
        lambda leaf: (
            _not_differentiable(leaf) if jnp.issubdtype(jnp.result_type(leaf), jnp.floating) else leaf
        ),
        tree,
    )
