"""What is done when it is first needed: names of a package imported, values of an object computed."""

import sys
from collections.abc import Callable, Mapping
from functools import wraps
from pkgutil import resolve_name
from typing import Any, TypeVar

import jax

from jaxplan.runtime.garbage import uncollected

T = TypeVar("T")


def late(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package, which imports names when they are first used.

    Args:
        package: its ``__name__``.
        homes: where each such name comes from: "module:name", or a module.

    Returns:
        A function that imports the value of a name, sets it in the package and returns it; it raises an
        AttributeError for a name that is not in `homes`.
    """

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        with uncollected():
            value = resolve_name(homes[name])
        setattr(sys.modules[package], name, value)
        return value

    return load


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
