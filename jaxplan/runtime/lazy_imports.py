"""Names of a package that are imported when they are first used, so that importing the package is quick."""

import sys
from collections.abc import Callable, Mapping
from pkgutil import resolve_name
from typing import Any

from jaxplan.runtime.garbage import uncollected


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
        module, _, within = homes[name].partition(":")
        with uncollected():
            value = resolve_name(f"{module}:{within}")  # without a colon it hides errors of the import
        setattr(sys.modules[package], name, value)
        return value

    return load
