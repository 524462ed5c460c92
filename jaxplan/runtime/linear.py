"""Linear maps with a compiled kernel for each direction, for derivatives outside `jax.jit`.

What JAX makes of a jitted function when it differentiates it outside `jax.jit` is traced and compiled anew in
every process, without the options of `jaxplan.runtime.jit.quick_jit`. A rule of `jax.custom_jvp` may call
kernels instead, but what it returns for tangents must be something that JAX can transpose. `linear_map` makes
such functions.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxplan.runtime.jit import is_traced

Arrays = Sequence[Any]
Map = Callable[[Any, Arrays], Sequence[Array]]


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
