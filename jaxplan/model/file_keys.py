"""How attributes of a scenario are written in files: key, range and meaning, stated where each is declared.

The dataclasses of the model give each field ``metadata=key(...)``, one with a default is `keyed`. Readers,
writers, messages and the manual (`jaxplan.schema`) follow from that and from the field's type and default.
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
    """How a dataclass field is written in files, and what the manual says of it.

    Attributes:
        name: key in files, with the unit; empty for an attribute that files hold in other ways only.
        meaning: one line for the manual.
        range: of its numbers, in the file's unit, as mathematics writes it, such as "(0, 180]".
        kind: what its value is, where the field's type does not tell; a name that the schema knows.
        words: words that files may have instead of a number, and what the model holds for them.
        options: the texts that are allowed; empty where any is.
        required: whether it, or what may be given instead, must be given though the field has a default.
        instead_of: the attribute in whose place it may be given.
        always: whether files have it at its default too, because a later version may have another.
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
        """The unit that the key's name ends in; empty if there is none."""
        return unit_of(self.name)


def unit_of(name: str) -> str:
    """The unit that a key's name ends in, such as "deg/s²" of "x_deg_s2"; empty if there is none."""
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")


def key(
    name: str, meaning: str = "", range: str = "", *, static: bool = False, **more: Any
) -> dict[str, Any]:
    """The metadata of a dataclass field.

    Args:
        name: key in files.
        meaning: one line for the manual.
        range: of its numbers, as of `Key`.
        static: whether it is no leaf to JAX but part of the tree's structure.
        more: other attributes of `Key`.
    """
    return {"static": static, "key": Key(name, meaning, range, **more)}


def keyed(default: Any, name: str, meaning: str = "", range: str = "", **more: Any) -> Any:
    """A dataclass field with a default and the metadata of `key`, whose other arguments follow."""
    return field(default=default, metadata=key(name, meaning, range, **more))
