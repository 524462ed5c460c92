"""Pointing constraints as users state them: cones to stay out of or in, and bounds of joint angles.

A cone stands about an axis that is inertial, still or moving (`DirectionPath`), fixed in the body, or the
boresight of another device. It binds devices, and further vectors that are fixed to the body or to a
terminal's moving part. Zones that share a group, ``any_of``, form one constraint, which holds while one of
its entries does: each zone is an entry of its own unless several name the same one.

`tabulate` makes rows of them, see `jaxplan.model.constraints`. A zone is a row, but one about a boresight,
which is a row for each direction that it binds. The row of an axis that moves has NaN for an axis, so that
where somebody forgets about that it counts as broken; `Constraints.at` gives the rows as they are at an
instant.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import jax
import numpy as np

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
    half_angle: float = field(metadata=key("half_angle_deg", "from the axis to the edge", "(0, 180)"))
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
        """The inertial axis over time; None where it has none."""
        return None if self.direction is None else as_path(self.direction)

    @property
    def moves(self) -> bool:
        """Whether its axis is inertial and moves."""
        return isinstance(self.direction, DirectionPath) and self.direction.moves

    @property
    def is_inertial(self) -> bool:
        """Whether its axis is inertial, so that it has a place on the sky."""
        return self.axis_body is None and self.axis_device is None

    def axis_at(self, time: float = 0.0) -> np.ndarray:
        """(3,) inertial axis at an instant, s; of one that stands still, at any."""
        if self.path is None:
            raise ValueError(f"zone {self.name} has no inertial axis")
        axis: np.ndarray = self.path.at(time)
        return axis


_SHOWN = ("half_angle deg", "direction", "axis_body", "axis_device", "devices", "vectors", "any_of", "entry")


@shown(*_SHOWN)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class KeepOut(_Cone):
    """A cone that no direction which it binds may enter.

    Attributes:
        name: unique among all zones.
        direction: (3,) unit vector of the axis, inertial; or its path, of an axis that moves. One of this,
            `axis_body` and `axis_device` is given.
        half_angle: rad, in (0, pi).
        axis_body: (3,) unit vector of an axis that is fixed in the body.
        axis_device: name of the device whose boresight is the axis.
        devices: names of the devices it binds; empty for all, of an inertial axis without vectors.
        vectors: further vectors that it binds.
        any_of: name of its group, None for a zone that must hold by itself.
        entry: name of its entry in the group; zones of the same one must hold together. None for a zone
            that is an entry by itself.
    """

    side: ClassVar[float] = 1.0


@shown(*_SHOWN)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class KeepIn(_Cone):
    """A cone that no direction which it binds may leave.

    Attributes:
        name: unique among all zones.
        direction: (3,) unit vector of the axis, inertial; or its path, of an axis that moves. One of this,
            `axis_body` and `axis_device` is given.
        half_angle: rad, in (0, pi).
        axis_body: (3,) unit vector of an axis that is fixed in the body.
        axis_device: name of the device whose boresight is the axis.
        devices: names of the devices it binds, at least one unless there are vectors.
        vectors: further vectors that it binds.
        any_of: name of its group, None for a zone that must hold by itself.
        entry: name of its entry in the group; zones of the same one must hold together. None for a zone
            that is an entry by itself.
    """

    side: ClassVar[float] = -1.0

    devices: tuple[str, ...] = keyed(
        (), "devices", "which it binds, each by itself; these or vectors", kind="devices", static=True
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


Zone = KeepOut | KeepIn | JointBound
"""A pointing constraint, or a member of one, as it is stated."""


_NOWHERE = np.full(3, np.nan)  # the axis of a row whose axis moves
_PADDING_AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Row:
    """One row of `Constraints`."""

    zone: int = -1
    axis: Any = field(default_factory=_PADDING_AXIS.copy)
    half_angle: Any = 0.5
    bound: Sequence[int] = ()
    frame: int = INERTIAL
    side: float = 1.0
    partner: int = 0
    path: DirectionPath | None = None


def tabulate(
    keep_out: Sequence[KeepOut],
    keep_in: Sequence[KeepIn],
    spacecraft: Spacecraft,
    *,
    joint_bounds: Sequence[JointBound] = (),
) -> Constraints:
    """The zones as padded rows, in the order in which they are given.

    Args:
        keep_out: zones to stay out of.
        keep_in: zones to stay in.
        spacecraft: whose devices they bind.
        joint_bounds: of terminals.

    Raises:
        ValueError: if a zone has no axis or several, binds nothing, names a device that there is not or one
            twice, or needs joints of a device without.
    """
    zones: list[Zone] = [*keep_out, *keep_in, *joint_bounds]
    further = [vector for zone in zones if not isinstance(zone, JointBound) for vector in zone.vectors]
    still = [vector for vector in further if vector.to is None]
    moved = [vector for vector in further if vector.to is not None]
    sights = _Sights(spacecraft, [*still, *moved])
    rows = [row for number, zone in enumerate(zones) for row in _rows(number, zone, sights)]
    size = padded_count(len(rows))
    entry, group = _numbered([zones[row.zone] for row in rows])
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
        body=stacked([vector.along for vector in still]).reshape(-1, 3),
        carrier=np.array([sights.devices.index(str(vector.to)) for vector in moved], int),
        carried=stacked([vector.along for vector in moved]).reshape(-1, 3),
        paths=paths if any(path is not None for path in paths) else (),
        inner=any(row.frame != INERTIAL for row in rows),
        nested=len(set(entry)) < len(entry),
    )


def _numbered(zones: Sequence[Zone]) -> tuple[list[int], list[int]]:
    """Entry and constraint of each row by its zone, each by the number of its first row.

    Rows of a zone without a group are constraints by themselves: all must hold anyway.
    """
    first: dict[tuple[Any, ...], int] = {}
    entry, group = [], []
    for row, zone in enumerate(zones):
        whole = (row,) if zone.any_of is None else ("any of", zone.any_of)
        own = (row,) if zone.any_of is None else ("entry", zone.any_of, zone.entry or id(zone))
        group.append(first.setdefault(whole, row))
        entry.append(first.setdefault(own, row))
    return entry, group


class _Sights:
    """Sights by number; it finds those of a zone, and raises for names that are wrong."""

    def __init__(self, spacecraft: Spacecraft, vectors: list[FixedVector]) -> None:
        self.devices, self.terminals = spacecraft.device_names, len(spacecraft.terminals)
        self.gimbals = self.terminals + len(spacecraft.drives)
        self._vectors = {id(vector): len(self.devices) + i for i, vector in enumerate(vectors)}
        self.count = len(self.devices) + len(vectors)

    def device(self, zone: Zone, key: str, name: str) -> int:
        """The number of a device, by its name."""
        if name not in self.devices:
            known = ", ".join(self.devices) or "the spacecraft has none"
            raise ValueError(f"zone {zone.name}: {key}: there is no {name!r}, only {known}")
        return self.devices.index(name)

    def terminal(self, zone: Zone, key: str, name: str) -> int:
        """The number of a device that must be a terminal."""
        number = self.device(zone, key, name)
        if number >= self.terminals:
            raise ValueError(f"zone {zone.name}: {key}: {name!r} is no terminal")
        return number

    def gimbal(self, zone: Zone, key: str, name: str) -> int:
        """The number of a device that must have joints."""
        number = self.device(zone, key, name)
        if number >= self.gimbals:
            raise ValueError(f"zone {zone.name}: {key}: {name!r} has no joints")
        return number

    def bound(self, zone: KeepOut | KeepIn) -> list[int]:
        """The numbers of all sights that a cone binds."""
        given: object = zone.devices  # whatever its type says
        if isinstance(given, str):
            raise ValueError(f"zone {zone.name}: devices = {given!r}: must be a tuple of names")
        for vector in zone.vectors:
            if vector.to is not None:
                self.gimbal(zone, "vectors", vector.to)
        names = zone.devices
        if binds_all(zone):
            names = self.devices
        elif not names and not zone.vectors:
            raise ValueError(f"zone {zone.name}: devices: must name what it binds, at least one")
        numbers = [self.device(zone, "devices", name) for name in names]
        for place, name in enumerate(names):
            if name in names[:place]:
                raise ValueError(f"zone {zone.name}: devices: {name!r} is named twice")
        return numbers + [self._vectors[id(vector)] for vector in zone.vectors]


def binds_all(zone: KeepOut | KeepIn) -> bool:
    """Whether a cone binds all devices since it names none, as only inertial ones to stay out of may."""
    return zone.side > 0 and zone.is_inertial and not zone.devices and not zone.vectors


def _rows(number: int, zone: Zone, sights: _Sights) -> Iterator[_Row]:
    """The rows of a zone."""
    if isinstance(zone, JointBound):
        bound = [sights.terminal(zone, "device", zone.device)]
        axis = stacked([zone.normal[0], zone.normal[1], 0.0])
        yield _Row(zone=number, axis=axis, half_angle=zone.least, bound=bound, frame=JOINTS)
        return
    given = [key for key in ("direction", "axis_body", "axis_device") if getattr(zone, key) is not None]
    if len(given) != 1:
        what = " and ".join(given) or "no axis"
        raise ValueError(f"zone {zone.name} has {what}: give one of direction, axis_body and axis_device")
    bound, cone = sights.bound(zone), partial(_Row, zone=number, half_angle=zone.half_angle, side=zone.side)
    if zone.path is not None:
        moving = zone.path.moves
        yield cone(
            axis=_NOWHERE if moving else zone.path.samples[0], path=zone.path if moving else None, bound=bound
        )
    elif zone.axis_body is not None:
        yield cone(axis=zone.axis_body, bound=bound, frame=BODY)
    else:
        partner = sights.device(zone, "axis_device", str(zone.axis_device))
        if partner in bound:
            raise ValueError(
                f"zone {zone.name}: devices: {zone.axis_device!r} is its axis, which it cannot bind"
            )
        for sight in bound:
            yield cone(bound=[sight], frame=SIGHT, partner=partner)


def sight_names(device_names: Sequence[str], rows: Constraints) -> list[str]:
    """Names of the directions that constraints bind: devices by name, others by their vector."""
    moved = [
        f"direction {_numbers(v)} of {device_names[of]}"
        for of, v in zip(rows.carrier, rows.carried, strict=True)
    ]
    return [*device_names, *map(body_axis_name, rows.body), *moved]


def body_axis_name(axis: np.ndarray) -> str:
    """What an axis (3,) of the body is called."""
    return f"axis {_numbers(axis)} of the body"


def _numbers(vector: np.ndarray) -> str:
    return f"({', '.join(f'{part:.3g}' for part in vector)})"
