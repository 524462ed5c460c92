"""Names of a package that are loaded when they are first used, so that importing it is quick."""

import sys
from collections.abc import Callable, Mapping
from pkgutil import resolve_name
from typing import Any


def late(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Make the ``__getattr__`` of a package.

    Args:
        package: its ``__name__``.
        homes: by the names that it gives, where each is: "module:name", or a module.

    Returns:
        A function that loads a name and leaves it in the package; an AttributeError for any other.
    """

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = resolve_name(homes[name])
        setattr(sys.modules[package], name, value)
        return value

    return load
