"""Pointing constraints as users state them: cones to stay out of or in, bounds of joints, masks.

A *zone* is a cone about an axis that is inertial, still or moving (`DirectionPath`), fixed in the body, or
the boresight of another device. It *binds* directions, which must stay out of the cone or in it: boresights
of devices, and further vectors that are fixed to the body or to the moving part of a device. Zones that name
the same group, ``any_of``, form one constraint, which holds while at least one of its *entries* does. Each
zone is an entry of its own, unless several name the same ``entry``; these must then hold together.

A keep-out cone may be measured from the edge of a device's field of view instead of from its boresight, and a
keep-in cone may ask for its axis to be inside the field of view. *Masks* are polygons of yaw and pitch that
a terminal must not enter. They are stated with the terminals, not with the zones of a scenario, but hold as
zones do (`masks`).

`jaxplan.model.tabulation` turns zones and masks into arrays.
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import jax
import numpy as np

from jaxplan.model import outlines
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.display import shown

_NAME_KEY = key("name", "unique among the zones", static=True)
_GROUP_KEY = key("any_of", "name of a group, of which one entry must hold at every instant", static=True)
_ENTRY_KEY = key("entry", "of its group; zones of the same one must hold together", static=True)


@shown("to", "along")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class FixedVector:
    """A direction other than a boresight that a zone binds, such as the normal of a panel.

    Attributes:
        along: (3,) unit vector. If it is fixed to the body, in body axes; if to a device with joints, as
            components along its boresight, to its left and upward, which turn with its joints.
        to: name of the device to whose moving part it is fixed; None for the body.
    """

    along: np.ndarray = field(
        metadata=key(
            "along",
            "in body axes; of a device with joints along its boresight, to the left of it and upward",
            kind="unit vector",
        )
    )
    to: str | None = keyed(
        None, "to", "whose moving part it is fixed to; the body if absent", kind="gimbal", static=True
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cone:
    """The attributes that keep-out and keep-in cones share; `KeepOut` and `KeepIn` describe them.

    The class attribute `side` is +1 for cones to stay out of and -1 for cones to stay in.
    """

    side: ClassVar[float]

    name: str = field(metadata=_NAME_KEY)
    direction: np.ndarray | DirectionPath | None = keyed(
        None, "direction", "axis of the cone, inertial, or a name of [sky]", kind="axis", required=True
    )
    axis_body: np.ndarray | None = keyed(
        None, "axis_body", "axis fixed in the body", kind="unit vector", instead_of="direction"
    )
    axis_device: str | None = keyed(
        None, "axis_device", "whose boresight is the axis", kind="device", instead_of="direction", static=True
    )
    half_angle: float = field(
        metadata=key(
            "half_angle_deg",
            "from the axis to the edge; with a field of view from the axis to that, from 0 to below 90",
            "(0, 180)",
            kind="half angle",
        )
    )
    devices: tuple[str, ...] = keyed(
        (),
        "devices",
        "which it binds; all if neither these nor vectors are given",
        kind="devices",
        static=True,
    )
    vectors: tuple[FixedVector, ...] = keyed((), "vector", "further directions that it binds")
    lasts: float = keyed(
        math.inf,
        "lasts_s",
        "for how long from the start on it is known; a motion that takes longer is refused",
        "(0, 1e7]",
        words={"always": math.inf},
    )
    any_of: str | None = field(default=None, metadata=_GROUP_KEY)
    entry: str | None = field(default=None, metadata=_ENTRY_KEY)

    @property
    def path(self) -> DirectionPath | None:
        """The axis as a path over time; None where the axis is not inertial."""
        return None if self.direction is None else as_path(self.direction)

    @property
    def moves(self) -> bool:
        """Whether the axis is inertial and changes with time."""
        return isinstance(self.direction, DirectionPath) and self.direction.moves

    @property
    def is_inertial(self) -> bool:
        """Whether the axis is inertial, rather than fixed in the body or the boresight of a device."""
        return self.axis_body is None and self.axis_device is None

    @property
    def binds_all(self) -> bool:
        """Whether it binds all devices: an inertial keep-out cone that names no devices and no vectors."""
        return self.side > 0 and self.is_inertial and not self.devices and not self.vectors

    @property
    def of_field(self) -> bool:
        """Whether it is measured from the edges of fields of view instead of from boresights."""
        return getattr(self, "outside" if self.side > 0 else "inside") is not None

    def axis_at(self, time: float = 0.0) -> np.ndarray:
        """Return the inertial axis (3,) at a time, s.

        Raises:
            ValueError: if the axis is not inertial.
        """
        if self.path is None:
            raise ValueError(f"zone {self.name} has no inertial axis")
        axis: np.ndarray = self.path.at(time)
        return axis


_SHOWN_ATTRIBUTES = (
    *("half_angle deg", "direction", "axis_body", "axis_device", "devices", "vectors", "lasts s"),
    *("any_of", "entry"),
)
FIELD_OF_VIEW = "field_of_view"
"""What a zone may be outside or inside of."""


@shown(*_SHOWN_ATTRIBUTES, "outside")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class KeepOut(_Cone):
    """A cone that the directions which it binds must not enter.

    Attributes:
        name: name, unique among all zones.
        direction: (3,) unit vector of the axis, inertial; or its path, of an axis that moves. Exactly one of
            this, `axis_body` and `axis_device` is given.
        half_angle: rad, in (0, pi). With `outside` the least angle between the axis and the field of view, in
            [0, pi / 2).
        axis_body: (3,) unit vector of an axis that is fixed in the body, body axes.
        axis_device: name of the device whose boresight is the axis.
        devices: names of the devices that it binds; empty for all if the axis is inertial and there are no
            `vectors`.
        vectors: further vectors that it binds.
        lasts: s from the start, for how long the zone is valid; longer motions are refused. A zone about a
            body that is taken to stand still is widened only by that body's motion in this time.
        any_of: name of its group; None for a zone that must hold by itself.
        entry: name of its entry in the group; zones of the same entry must hold together. None for a zone
            that is an entry by itself.
        outside: "field_of_view" to keep the axis out of the rectangular field of view of each device that it
            binds, by default of all that have one; None to measure from boresights.
    """

    side: ClassVar[float] = 1.0

    outside: str | None = keyed(
        None,
        "outside",
        "of what half_angle_deg is the distance: of each device's field instead of its boresight",
        options=(FIELD_OF_VIEW,),
        static=True,
    )


@shown(*_SHOWN_ATTRIBUTES, "inside")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class KeepIn(_Cone):
    """A cone that the directions which it binds must not leave.

    Attributes:
        name: name, unique among all zones.
        direction: (3,) unit vector of the axis, inertial; or its path, of an axis that moves. Exactly one of
            this, `axis_body` and `axis_device` is given.
        half_angle: rad, in (0, pi). With `inside` the least angle between the axis and the edges of the field
            of view that it is in, in [0, pi / 2).
        axis_body: (3,) unit vector of an axis that is fixed in the body, body axes.
        axis_device: name of the device whose boresight is the axis.
        devices: names of the devices that it binds; at least one unless there are `vectors`.
        vectors: further vectors that it binds.
        lasts: s from the start, for how long the zone is valid; longer motions are refused.
        any_of: name of its group; None for a zone that must hold by itself.
        entry: name of its entry in the group; zones of the same entry must hold together. None for a zone
            that is an entry by itself.
        inside: "field_of_view" to keep the axis in the rectangular field of view of each device that it
            binds; None to measure from boresights.
    """

    side: ClassVar[float] = -1.0

    devices: tuple[str, ...] = keyed(
        (), "devices", "which it binds, each by itself; these or vectors", kind="devices", static=True
    )
    inside: str | None = keyed(
        None,
        "inside",
        "where the axis must be, half_angle_deg or more from its edges: in each device's field",
        options=(FIELD_OF_VIEW,),
        static=True,
    )


@shown("device", "normal", "least deg", "any_of", "entry")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class JointBound:
    """A half-plane in which the joint angles of a terminal must stay: ``normal . (yaw, pitch) >= least``.

    A group of these, one for each edge, keeps the angles out of a convex polygon.

    Attributes:
        name: name, unique among all zones.
        device: name of the terminal.
        normal: (2,) weights of yaw and pitch, of length one.
        least: rad, least value of the weighted sum.
        any_of: name of its group; None for a bound that must hold by itself.
        entry: name of its entry in the group, as for `KeepOut`.
    """

    name: str = field(metadata=_NAME_KEY)
    device: str = field(metadata=key("device", "whose joints it bounds", kind="terminal", static=True))
    normal: np.ndarray = field(metadata=key("normal", "weights of yaw and pitch", kind="plane unit vector"))
    least: float = field(metadata=key("least_deg", "of the weighted sum", "[-1000, 1000]"))
    any_of: str | None = field(default=None, metadata=_GROUP_KEY)
    entry: str | None = field(default=None, metadata=_ENTRY_KEY)

    path: ClassVar[None] = None
    moves: ClassVar[bool] = False
    lasts: ClassVar[float] = math.inf
    is_inertial: ClassVar[bool] = False


@shown("device", "corners deg", "turns")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Mask:
    """A convex polygon of yaw and pitch that a terminal must not enter, made by `masks` from its spacecraft.

    Attributes:
        name: name after the terminal, such as "mask 1 of antenna".
        device: name of the terminal.
        corners: (k, 2) rad, yaw and pitch of each corner, in order around the polygon.
        turns: numbers of whole turns of the yaw by which the polygon is repeated, such as (-1, 0).
    """

    name: str = field(metadata={"static": True})
    device: str = field(metadata={"static": True})
    corners: np.ndarray
    turns: tuple[int, ...] = field(metadata={"static": True})

    any_of: ClassVar[None] = None
    entry: ClassVar[None] = None
    path: ClassVar[None] = None
    moves: ClassVar[bool] = False
    lasts: ClassVar[float] = math.inf
    is_inertial: ClassVar[bool] = False


Zone = KeepOut | KeepIn | JointBound | Mask
"""A pointing constraint, or a member of one, as it is stated."""

Turns = tuple[tuple[int, ...], ...]
"""Whole turns after which each mask of a spacecraft is met again."""


def masks(spacecraft: Spacecraft, turns: Turns | None = None) -> tuple[Mask, ...]:
    """Collect the masks of all terminals.

    Args:
        spacecraft: the spacecraft that carries the terminals.
        turns: for each mask the whole turns of the yaw by which it is repeated; None for those at which it
            reaches into the range of the yaw.
    """
    found: list[Mask] = []
    for terminal in spacecraft.terminals:
        for number, corners in enumerate(terminal.mask):
            low, high = terminal.ranges[0]
            own = outlines.turns(corners, low, high) if turns is None else turns[len(found)]
            name = f"mask {number + 1} of {terminal.name}"
            found.append(Mask(name=name, device=terminal.name, corners=corners, turns=own))
    return tuple(found)
