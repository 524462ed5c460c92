"""Pointing constraints as users state them, and their tabulation: cones to stay out of or in, joint bounds.

A cone stands about an axis that is inertial, still or moving (`DirectionPath`), fixed in the body, or the
boresight of another device. It binds devices, and further vectors that are fixed to the body or to a
terminal's moving part. Zones that share a group, ``any_of``, form one constraint, which holds while one of
its entries does: each zone is an entry of its own unless several name the same one.

A cone to stay out of may count from the edge of a device's field of view instead of from its boresight, and
one to stay in ask for a place inside the field. Masks are no zones of a scenario but of its terminals; they
hold as zones do (`masks`).

`tabulate` makes rows of them, see `jaxplan.model.constraints`. A zone is a row, but one about a boresight,
which is a row for each direction that it binds, one outside fields of view, which is a constraint of five
entries for each device, and a mask, which is one of an entry for each edge. The row of an axis that moves has
NaN for an axis, so that where somebody forgets about that it counts as broken; `Constraints.at` gives the
rows as they are at an instant.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Any, ClassVar

import jax
import numpy as np

from jaxplan.model import outlines
from jaxplan.model.bound import Bound
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.gimbals import stacked
from jaxplan.model.keys import key, keyed
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.display import shown

_NAME = key("name", "unique among the zones", static=True)
_GROUP = key("any_of", "name of a group, of which one entry must hold at every instant", static=True)
_ENTRY = key("entry", "of its group; zones of the same one must hold together", static=True)


@shown("to", "along")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class FixedVector:
    """A direction beside the boresights that a zone binds, such as the normal of a panel.

    Attributes:
        along: (3,) unit vector: of the body in body axes; of a device with joints along its boresight, to the
            left of it and upward, as these turn with yaw and pitch.
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
    """Attributes that both kinds of cone have."""

    side: ClassVar[float]

    name: str = field(metadata=_NAME)
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
    any_of: str | None = field(default=None, metadata=_GROUP)
    entry: str | None = field(default=None, metadata=_ENTRY)

    @property
    def path(self) -> DirectionPath | None:
        """The inertial axis over time; None where the axis is not inertial."""
        return None if self.direction is None else as_path(self.direction)

    @property
    def moves(self) -> bool:
        """Whether its axis is inertial and moves."""
        return isinstance(self.direction, DirectionPath) and self.direction.moves

    @property
    def is_inertial(self) -> bool:
        """Whether its axis is inertial, so that it has a place on the sky."""
        return self.axis_body is None and self.axis_device is None

    @property
    def binds_all(self) -> bool:
        """Whether it binds all devices since it names none, as only inertial ones to stay out of may."""
        return self.side > 0 and self.is_inertial and not self.devices and not self.vectors

    @property
    def of_field(self) -> bool:
        """Whether it counts from the edges of fields of view."""
        return getattr(self, "outside" if self.side > 0 else "inside") is not None

    def axis_at(self, time: float = 0.0) -> np.ndarray:
        """The inertial axis (3,) at an instant, s; raises ValueError where the axis is not inertial."""
        if self.path is None:
            raise ValueError(f"zone {self.name} has no inertial axis")
        axis: np.ndarray = self.path.at(time)
        return axis


_SHOWN = ("half_angle deg", "direction", "axis_body", "axis_device", "devices", "vectors", "any_of", "entry")
FIELD_OF_VIEW = "field_of_view"
"""What a zone may be outside or inside of."""


@shown(*_SHOWN, "outside")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class KeepOut(_Cone):
    """A cone that no direction which it binds may enter.

    Attributes:
        name: unique among all zones.
        direction: (3,) unit vector of the axis, inertial; or its path, of an axis that moves. One of this,
            `axis_body` and `axis_device` is given.
        half_angle: rad, in (0, pi); outside a field of view in [0, pi / 2), the distance from the field.
        axis_body: (3,) unit vector of an axis that is fixed in the body.
        axis_device: name of the device whose boresight is the axis.
        devices: names of the devices it binds; empty for all, of an inertial axis without vectors.
        vectors: further vectors that it binds.
        any_of: name of its group, None for a zone that must hold by itself.
        entry: name of its entry in the group; zones of the same one must hold together. None for a zone
            that is an entry by itself.
        outside: "field_of_view" to keep the axis away from the rectangular field of each device it binds,
            by default all that have one.
    """

    side: ClassVar[float] = 1.0

    outside: str | None = keyed(
        None,
        "outside",
        "of what half_angle_deg is the distance: of each device's field instead of its boresight",
        options=(FIELD_OF_VIEW,),
        static=True,
    )


@shown(*_SHOWN, "inside")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class KeepIn(_Cone):
    """A cone that no direction which it binds may leave.

    Attributes:
        name: unique among all zones.
        direction: (3,) unit vector of the axis, inertial; or its path, of an axis that moves. One of this,
            `axis_body` and `axis_device` is given.
        half_angle: rad, in (0, pi); inside a field of view in [0, pi / 2), the distance from its edges.
        axis_body: (3,) unit vector of an axis that is fixed in the body.
        axis_device: name of the device whose boresight is the axis.
        devices: names of the devices it binds, at least one unless there are vectors.
        vectors: further vectors that it binds.
        any_of: name of its group, None for a zone that must hold by itself.
        entry: name of its entry in the group; zones of the same one must hold together. None for a zone
            that is an entry by itself.
        inside: "field_of_view" to keep the axis in the rectangular field of each device it binds.
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
    """A half-plane of joint angles that a terminal must stay in, ``normal . (yaw, pitch) >= least``.

    A convex polygon that they must not enter is a group of these, one for each of its edges.

    Attributes:
        name: unique among all zones.
        device: name of the terminal.
        normal: (2,) of length one.
        least: rad.
        any_of: name of its group, None for a bound that must hold by itself.
        entry: name of its entry in the group, as of a zone.
    """

    name: str = field(metadata=_NAME)
    device: str = field(metadata=key("device", "whose joints it bounds", kind="terminal", static=True))
    normal: np.ndarray = field(metadata=key("normal", "weights of yaw and pitch", kind="plane unit vector"))
    least: float = field(metadata=key("least_deg", "of the weighted sum", "[-1000, 1000]"))
    any_of: str | None = field(default=None, metadata=_GROUP)
    entry: str | None = field(default=None, metadata=_ENTRY)

    path: ClassVar[None] = None
    moves: ClassVar[bool] = False
    is_inertial: ClassVar[bool] = False


@shown("device", "corners deg", "turns")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Mask:
    """A convex polygon of yaw and pitch that a terminal must not enter, as its spacecraft has it.

    Attributes:
        name: after the terminal, such as "mask 1 of antenna".
        device: name of the terminal.
        corners: (k, 2) rad.
        turns: whole turns of yaw after which it is met again.
    """

    name: str = field(metadata={"static": True})
    device: str = field(metadata={"static": True})
    corners: np.ndarray
    turns: tuple[int, ...] = field(metadata={"static": True})

    any_of: ClassVar[None] = None
    entry: ClassVar[None] = None
    path: ClassVar[None] = None
    moves: ClassVar[bool] = False
    is_inertial: ClassVar[bool] = False


Zone = KeepOut | KeepIn | JointBound | Mask
"""A pointing constraint, or a member of one, as it is stated."""

Turns = tuple[tuple[int, ...], ...]
"""Whole turns after which each mask of a spacecraft is met again."""


def masks(spacecraft: Spacecraft, turns: Turns | None = None) -> tuple[Mask, ...]:
    """The masks of all terminals.

    Args:
        spacecraft: whose terminals they are of.
        turns: of each mask; None for those that reach into the yaw's range.
    """
    found: list[Mask] = []
    for terminal in spacecraft.terminals:
        for number, corners in enumerate(terminal.mask):
            low, high = terminal.ranges[0]
            own = outlines.turns(corners, low, high) if turns is None else turns[len(found)]
            name = f"mask {number + 1} of {terminal.name}"
            found.append(Mask(name=name, device=terminal.name, corners=corners, turns=own))
    return tuple(found)


_NOWHERE = np.full(3, np.nan)  # the axis of a row whose axis moves
_PADDING_AXIS = np.array([0.0, 0.0, 1.0])
MOST_WAYS = 64
"""Most alternatives of a group's entry (`_Ways`): five to the power of the fields of view it keeps clear."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Row:
    """One row of `Constraints`, with the numbers of the sights that it binds; by default padding."""

    zone: int = -1
    axis: Any = field(default_factory=_PADDING_AXIS.copy)
    half_angle: Any = 0.5
    bound: Sequence[int] = ()
    frame: int = INERTIAL
    side: float = 1.0
    partner: int = 0
    path: DirectionPath | None = None


_Ways = list[list[_Row]]  # alternatives, of which one must hold, with all of its rows


def tabulate(
    keep_out: Sequence[KeepOut],
    keep_in: Sequence[KeepIn],
    spacecraft: Spacecraft,
    *,
    joint_bounds: Sequence[JointBound] = (),
    turns: Turns | None = None,
) -> Constraints:
    """The zones and the spacecraft's masks as padded rows, in the order in which they are given.

    Args:
        keep_out: zones to stay out of.
        keep_in: zones to stay in.
        spacecraft: whose devices they bind.
        joint_bounds: of terminals.
        turns: whole turns after which each mask is met again; None to have `masks` find them.

    Raises:
        ValueError: if a zone has no axis or several, binds nothing, names a device that there is not or one
            twice, or needs joints or a field of view of a device without.
    """
    zones: list[Zone] = [*keep_out, *keep_in, *joint_bounds, *masks(spacecraft, turns)]
    sights = bound_by(zones, spacecraft)
    rows, entry, group = _numbered(zones, sights)
    size = padded_count(len(rows))
    padding = range(len(rows), size)
    rows += [_Row() for _ in padding]
    paths = tuple(row.path for row in rows)
    bound = np.zeros((size, sights.count), dtype=bool)
    for number, row in enumerate(rows):
        bound[number, list(row.bound)] = True
    return Constraints(
        axis=stacked([row.axis for row in rows]).reshape(-1, 3),
        frame=np.array([row.frame for row in rows], int),
        partner=np.array([row.partner for row in rows], int),
        half_angle=stacked([row.half_angle for row in rows]),
        side=np.array([row.side for row in rows], float),
        bound=bound,
        entry=np.array([*entry, *padding], int),
        group=np.array([*group, *padding], int),
        zone=np.array([row.zone for row in rows], int),
        body=stacked([vector for vector, _ in sights.body]).reshape(-1, 3),
        carrier=np.array([carrier for *_, carrier in sights.carried], int),
        carried=stacked([vector for vector, *_ in sights.carried]).reshape(-1, 3),
        paths=paths if any(path is not None for path in paths) else (),
        inner=any(row.frame != INERTIAL for row in rows),
        nested=len(set(entry)) < len(entry),
    )


def _numbered(zones: Sequence[Zone], sights: Bound) -> tuple[list[_Row], list[int], list[int]]:
    """All rows of zones, and for each the first row of its entry and the first row of its constraint.

    Rows are in the order of their zones, and numbered from zero.

    Raises:
        ValueError: if an entry of a group has more than `MOST_WAYS` alternatives.
    """
    asked = [list(_asked(number, zone, sights)) for number, zone in enumerate(zones)]
    found: list[tuple[_Row, Any, Any]] = []  # each with names of its constraint and its entry
    groups: dict[str, dict[Any, list[_Ways]]] = {}
    for number, (zone, each) in enumerate(zip(zones, asked, strict=True)):
        if zone.any_of is None:
            for place, ways in enumerate(each):
                of = (number, place)
                found += [(row, of, (of, way)) for way, own in enumerate(ways) for row in own]
        else:
            groups.setdefault(zone.any_of, {}).setdefault(zone.entry or number, []).extend(each)
    for name, entries in groups.items():
        for own_entry, each in entries.items():
            if math.prod(map(len, each)) > MOST_WAYS:
                raise ValueError(f"group {name}: {_too_many(each)}")
            for way, parts in enumerate(product(*each)):
                found += [(row, name, (name, own_entry, way)) for part in parts for row in part]
    found.sort(key=lambda one: one[0].zone)
    first: dict[Any, int] = {}
    entry = [first.setdefault(("entry", own), number) for number, (_, _, own) in enumerate(found)]
    group = [first.setdefault(("constraint", of), number) for number, (_, of, _) in enumerate(found)]
    return [row for row, *_ in found], entry, group


def _too_many(each: Sequence[_Ways]) -> str:
    """The message that an entry has too many alternatives."""
    ways = math.prod(map(len, each))
    return f"an entry of it may hold in {ways} ways, {MOST_WAYS} at most: bind fewer fields of view by it"


def _asked(number: int, zone: Zone, sights: Bound) -> Iterator[_Ways]:
    """Yield all conditions of a zone, which must all hold, each as its alternatives.

    Args:
        number: of the zone.
        zone: as it is stated.
        sights: that zones bind.

    Raises:
        ValueError: if it has no axis or several, or what it binds is wrong.
    """
    if isinstance(zone, JointBound):
        yield [[_joint_row(number, zone.normal, zone.least, sights.terminal(zone, "device", zone.device))]]
        return
    if isinstance(zone, Mask):
        device = sights.terminal(zone, "device", zone.device)
        normals, least = outlines.half_planes(zone.corners)
        for turn in zone.turns:
            beyond = least + 2 * np.pi * turn * normals[:, 0]
            yield [[_joint_row(number, *edge, device)] for edge in zip(normals, beyond, strict=True)]
        return
    given = [key for key in ("direction", "axis_body", "axis_device") if getattr(zone, key) is not None]
    if len(given) != 1:
        what = " and ".join(given) or "no axis"
        raise ValueError(f"zone {zone.name} has {what}: give one of direction, axis_body and axis_device")
    if zone.of_field:
        for device in sights.fields(zone):
            yield from _of_field(number, zone, device, sights)
    else:
        for row in _cones(number, zone, sights.bound(zone), sights):
            yield [[row]]


def _joint_row(number: int, normal: Any, least: Any, device: int) -> _Row:
    """The row ``normal . (yaw, pitch) >= least`` (rad) of zone `number` for a terminal's number."""
    axis = stacked([normal[0], normal[1], 0.0])
    return _Row(zone=number, axis=axis, half_angle=least, bound=[device], frame=JOINTS)


def _of_field(number: int, zone: KeepOut | KeepIn, device: int, sights: Bound) -> Iterator[_Ways]:
    """Yield what a zone asks of the field of view of a device, as alternatives.

    Its axis must be outside the field (one of five), or within all of its edges (four with one alternative).
    An axis beyond an edge by ``m`` is at most ``90 deg - m`` from the edge's outward normal. Behind the
    device that may hold for none, so there it is enough to be farther from the boresight than the corners.
    """
    edges = sights.edges(device)

    if zone.side < 0:
        for edge in edges:
            yield [
                list(_cones(number, zone, [edge], sights, side=1.0, half_angle=np.pi / 2 + zone.half_angle))
            ]
        return
    corner = outlines.corner_angle(sights.craft.devices[device].field_of_view)
    beyond = [
        list(_cones(number, zone, [edge], sights, side=-1.0, half_angle=np.pi / 2 - zone.half_angle))
        for edge in edges
    ]
    yield [*beyond, list(_cones(number, zone, [device], sights, half_angle=corner + zone.half_angle))]


def _cones(
    number: int, zone: KeepOut | KeepIn, bound: Sequence[int], sights: Bound, **other: Any
) -> Iterator[_Row]:
    """Yield the rows about the axis of a zone for some sights; one, or one a sight about a boresight.

    Args:
        number: of the zone.
        zone: as it is stated.
        bound: numbers of the sights.
        sights: that zones bind.
        other: `side` or `half_angle` where they are not the zone's.

    Raises:
        ValueError: if the axis is the boresight of no device, or of one that the zone binds.
    """
    cone = partial(_Row, **{"zone": number, "half_angle": zone.half_angle, "side": zone.side} | other)
    if zone.path is not None:
        moving = zone.path.moves
        yield cone(
            axis=_NOWHERE if moving else zone.path.samples[0], path=zone.path if moving else None, bound=bound
        )
    elif zone.axis_body is not None:
        yield cone(axis=zone.axis_body, bound=bound, frame=BODY)
    else:
        partner = sights.device(zone, "axis_device", str(zone.axis_device))
        if zone.axis_device in zone.devices:
            raise ValueError(
                f"zone {zone.name}: devices: {zone.axis_device!r} is its axis, which it cannot bind"
            )
        for sight in bound:
            yield cone(bound=[sight], frame=SIGHT, partner=partner)


def bound_by(zones: Sequence[Zone], spacecraft: Spacecraft) -> Bound:
    """The sights that zones bind on a spacecraft."""
    return Bound([zone for zone in zones if isinstance(zone, KeepOut | KeepIn)], spacecraft)
