"""A decorator for what follows from an object that does not change: computed once, when first needed."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import jax

T = TypeVar("T")


def made_once(make: Callable[[Any], T]) -> Callable[[Any], T]:
    """Decorate a method without arguments so that its result is computed once and kept in the object.

    It is kept under the method's name with an underscore in front. A result that holds a JAX array is not
    kept, since it may belong to a trace.

    Args:
        make: the method, whose result depends only on the object's attributes.
    """
    name = f"_{make.__name__}"

    @wraps(make)
    def kept(owner: Any) -> T:
        known: dict[str, T] = owner.__dict__
        if name in known:
            return known[name]
        answer = make(owner)
        if not any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(answer)):
            known[name] = answer
        return answer

    return kept
