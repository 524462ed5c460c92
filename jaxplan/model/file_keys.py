"""How attributes of a scenario are written in files: key, range and meaning, stated where each is declared.

Each field of the model's dataclasses has ``metadata=key(...)``; one with a default is declared by `keyed`.
Readers, writers, messages and the manual (`jaxplan.schema`) are derived from that, and from the type and the
default of the field.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

_UNITS = {
    "_deg_s3": "deg/s³",
    "_deg_s2": "deg/s²",
    "_deg_s": "deg/s",
    "_deg": "deg",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_kg_m2": "kg m²",
    "_km_s": "km/s",
    "_km": "km",
    "_m": "m",
    "_nms": "N m s",
    "_nm": "N m",
    "_s": "s",
}


@dataclass(frozen=True)
class Key:
    """How a field of a dataclass is written in files, and what the manual says about it.

    Attributes:
        name: key in files, with its unit; empty if files do not hold the attribute under one key.
        meaning: one line for the manual.
        range: range of its numbers in the unit of the file, in mathematical notation such as "(0, 180]".
        kind: kind of its value, where the type of the field does not tell; a name that the schema knows.
        words: words that files may have instead of a number, each with the value it stands for.
        options: texts that are allowed; empty if any text is.
        required: whether it, or what may be given instead of it, must be given although the field has a
            default.
        instead_of: name of the attribute instead of which it may be given.
        always: whether it is written to files at its default, too, because a later version may have another
            default.
    """

    name: str
    meaning: str = ""
    range: str = ""
    kind: str = ""
    words: Mapping[str, Any] = field(default_factory=dict)
    options: Collection[str] = ()
    required: bool = False
    instead_of: str = ""
    always: bool = False

    @property
    def unit(self) -> str:
        """The unit in which the key's name ends; empty if there is none."""
        return unit_of(self.name)


def unit_of(name: str) -> str:
    """Return the unit in which a key's name ends, such as "deg/s²" for "x_deg_s2"; empty if there is none."""
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")


def key(
    name: str, meaning: str = "", range: str = "", *, static: bool = False, **more: Any
) -> dict[str, Any]:
    """Make the metadata of a dataclass field.

    Args:
        name: key in files.
        meaning: one line for the manual.
        range: range of its numbers, as in `Key`.
        static: whether JAX takes it for structure of the tree instead of a leaf.
        more: other attributes of `Key`.
    """
    return {"static": static, "key": Key(name, meaning, range, **more)}


def keyed(default: Any, name: str, meaning: str = "", range: str = "", **more: Any) -> Any:
    """Make a dataclass field with a default; its metadata is what `key` makes of the other arguments."""
    return field(default=default, metadata=key(name, meaning, range, **more))
