"""Zones and masks as a table of rows (`jaxplan.model.constraints`).

A zone becomes one row, with three exceptions: a zone about a boresight becomes a row for each direction that
it binds; a zone outside of fields of view becomes a constraint of five entries for each device; and a mask
becomes a constraint with an entry for each edge. The row of an axis that moves has NaN for its axis, so that
it counts as broken if somebody forgets about the motion; `Constraints.at` gives the rows as they are at an
instant.

If a plan must tolerate errors (`jaxplan.model.robust`), half angles and joint bounds are tightened by the
loss of margin. A cone then becomes a row for each kind of device, since all of a kind have the same loss, and
a mask has further entries for the sides of its bounding box, without which a sharp corner would grow by more
than the errors.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from jaxplan.model import outlines
from jaxplan.model.bound_sights import Bound
from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints
from jaxplan.model.directions import DirectionPath
from jaxplan.model.gimbals import stacked
from jaxplan.model.robust import Robust
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import JointBound, KeepIn, KeepOut, Mask, Turns, Zone, masks
from jaxplan.runtime.batching import padded_count

_NAN_AXIS = np.full(3, np.nan)  # the axis of a row whose axis moves


_PADDING_AXIS = np.array([0.0, 0.0, 1.0])


MOST_WAYS = 64
"""Most `_Alternatives` of a group's entry: five to the power of the fields of view that it keeps clear."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Row:
    """One row of `Constraints`, with the numbers of the sights that it binds.

    The defaults are those of padding.
    """

    zone: int = -1
    axis: Any = field(default_factory=_PADDING_AXIS.copy)
    half_angle: Any = 0.5
    bound: Sequence[int] = ()
    frame: int = INERTIAL
    side: float = 1.0
    partner: int = 0
    path: DirectionPath | None = None


_Alternatives = list[list[_Row]]  # alternatives, of which one must hold; of that all rows


def tabulate(
    keep_out: Sequence[KeepOut],
    keep_in: Sequence[KeepIn],
    spacecraft: Spacecraft,
    *,
    joint_bounds: Sequence[JointBound] = (),
    turns: Turns | None = None,
    robust: Robust | None = None,
) -> Constraints:
    """Make the padded rows of zones and of the spacecraft's masks, in the order in which they are given.

    Args:
        keep_out: cones to stay out of.
        keep_in: cones to stay in.
        spacecraft: the spacecraft whose devices they bind.
        joint_bounds: half-planes of terminals' joint angles to stay in.
        turns: for each mask the whole turns of the yaw by which it is repeated; None to take them from the
            ranges.
        robust: errors for which all of them must hold; None for none.

    Raises:
        ValueError: if a zone has no axis or several, binds nothing, names a device that does not exist or
            names one twice, or needs joints or a field of view that a device does not have.
    """
    zones: list[Zone] = [*keep_out, *keep_in, *joint_bounds, *masks(spacecraft, turns)]
    sights = bound_by(zones, spacecraft)
    rows, entry, group = _collect_rows(zones, sights, robust)
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


def _collect_rows(
    zones: Sequence[Zone], sights: Bound, robust: Robust | None
) -> tuple[list[_Row], list[int], list[int]]:
    """Collect all rows of zones, with the entry and the constraint to which each belongs.

    Returns:
        The rows in the order of their zones; for each the number of the first row of its entry; and for each
        the number of the first row of its constraint. Numbers count from zero.

    Raises:
        ValueError: if an entry of a group has more than `MOST_WAYS` alternatives.
    """
    asked = [list(_zone_conditions(number, zone, sights, robust)) for number, zone in enumerate(zones)]
    found: list[tuple[_Row, Any, Any]] = []  # each with a key of its constraint and of its entry
    groups: dict[str, dict[Any, list[_Alternatives]]] = {}
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
                raise ValueError(f"group {name}: {_too_many_message(each)}")
            for way, parts in enumerate(product(*each)):
                found += [(row, name, (name, own_entry, way)) for part in parts for row in part]
    found.sort(key=lambda one: one[0].zone)
    first: dict[Any, int] = {}
    entry = [first.setdefault(("entry", own), number) for number, (_, _, own) in enumerate(found)]
    group = [first.setdefault(("constraint", of), number) for number, (_, of, _) in enumerate(found)]
    return [row for row, *_ in found], entry, group


def _too_many_message(each: Sequence[_Alternatives]) -> str:
    """Return the message that an entry has too many alternatives."""
    ways = math.prod(map(len, each))
    return f"an entry of it may hold in {ways} ways, {MOST_WAYS} at most: bind fewer fields of view by it"


def _zone_conditions(
    number: int, zone: Zone, sights: Bound, robust: Robust | None
) -> Iterator[_Alternatives]:
    """Yield all conditions of a zone, which must all hold, each as a list of alternatives, one of which must.

    An alternative is a list of rows, all of which must hold.

    Args:
        number: number of the zone.
        zone: the zone as it is stated.
        sights: the sights that zones bind.
        robust: errors for which it must hold; None for none.

    Raises:
        ValueError: if it has no axis or several, or what it binds is wrong.
    """
    if isinstance(zone, JointBound):
        device = sights.terminal(zone, "device", zone.device)
        yield [[_joint_row(number, zone.normal, zone.least, device, robust)]]
        return
    if isinstance(zone, Mask):
        device = sights.terminal(zone, "device", zone.device)
        normals, least = outlines.half_planes(zone.corners, box=robust is not None)
        for turn in zone.turns:
            beyond = least + 2 * np.pi * turn * normals[:, 0]
            yield [[_joint_row(number, *edge, device, robust)] for edge in zip(normals, beyond, strict=True)]
        return
    given = [key for key in ("direction", "axis_body", "axis_device") if getattr(zone, key) is not None]
    if len(given) != 1:
        what = " and ".join(given) or "no axis"
        raise ValueError(f"zone {zone.name} has {what}: give one of direction, axis_body and axis_device")
    if zone.of_field:
        for device in sights.fields(zone):
            yield from _field_conditions(number, zone, device, sights, robust)
    else:
        for row in _cone_rows(number, zone, sights.bound(zone), sights, robust):
            yield [[row]]


def _joint_row(number: int, normal: Any, least: Any, device: int, robust: Robust | None) -> _Row:
    """Make the row ``normal . (yaw, pitch) >= least`` (rad) of a zone.

    Args:
        number: number of the zone.
        normal: (2,) of length one.
        least: rad.
        device: number of the terminal.
        robust: errors for which it must hold, by which `least` is raised; None for none.
    """
    axis = stacked([normal[0], normal[1], 0.0])
    if robust is not None:
        least = least + robust.loss_of_joints(normal)
    return _Row(zone=number, axis=axis, half_angle=least, bound=[device], frame=JOINTS)


def _field_conditions(
    number: int, zone: KeepOut | KeepIn, device: int, sights: Bound, robust: Robust | None
) -> Iterator[_Alternatives]:
    """Yield what a zone asks of the field of view of one device, as alternatives of rows.

    For a keep-out the axis must be outside of the field: beyond one of its four edges, or farther from the
    boresight than the corners. For a keep-in it must be within all four edges, which are four conditions
    without alternatives. An axis that is beyond an edge by ``m`` is at most ``90 deg - m`` from the outward
    normal of that edge. Behind the device that may be so for no edge, which is why the fifth alternative is
    needed.

    Args:
        number: number of the zone.
        zone: the zone as it is stated.
        device: number of the device.
        sights: the sights that zones bind.
        robust: errors for which it must hold; None for none.
    """
    edges, away = sights.edges(device), zone.half_angle
    about = partial(_cone_rows, number, zone, sights=sights, robust=robust)
    if zone.side < 0:
        for edge in edges:
            yield [list(about([edge], side=1.0, half_angle=np.pi / 2 + away))]
        return
    corner = outlines.corner_angle(sights.craft.devices[device].field_of_view)
    beyond = [list(about([edge], side=-1.0, half_angle=np.pi / 2 - away)) for edge in edges]
    yield [*beyond, list(about([device], half_angle=corner + away))]


def _cone_rows(
    number: int,
    zone: KeepOut | KeepIn,
    bound: Sequence[int],
    sights: Bound,
    robust: Robust | None,
    *,
    side: float | None = None,
    half_angle: Any = None,
) -> Iterator[_Row]:
    """Yield the rows about the axis of a zone for some sights: one, or one for each sight about a boresight.

    Args:
        number: number of the zone.
        zone: the zone as it is stated.
        bound: numbers of the sights.
        sights: the sights that zones bind.
        robust: errors for which it must hold; there is then a row for each kind of device. None for none.
        side: +1 to stay out, -1 to stay in; None for that of the zone.
        half_angle: rad; None for that of the zone.

    Raises:
        ValueError: if the axis is the boresight of a device that does not exist, or of one that the zone
            binds.
    """
    way = zone.side if side is None else side
    angle = zone.half_angle if half_angle is None else half_angle
    cone = partial(_Row, zone=number, side=way)
    if zone.axis_device is None:
        where: dict[str, Any] = {"axis": zone.axis_body, "frame": BODY}
        if zone.path is not None:
            moving = zone.path.moves
            where = {
                "axis": _NAN_AXIS if moving else zone.path.samples[0],
                "path": zone.path if moving else None,
            }
        inertial = zone.path is not None
        for alike in [bound] if robust is None else sights.alike(bound):
            own = angle
            if robust is not None:
                own = angle + way * robust.loss(sights.carrier(alike[0]), None, inertial=inertial)
            yield cone(half_angle=own, bound=alike, **where)
    else:
        partner = sights.device(zone, "axis_device", str(zone.axis_device))
        if zone.axis_device in zone.devices:
            raise ValueError(
                f"zone {zone.name}: devices: {zone.axis_device!r} is its axis, which it cannot bind"
            )
        for sight in bound:
            own = angle
            if robust is not None:
                pair = sights.carrier(sight), sights.carrier(partner)
                own = angle + way * robust.loss(*pair, inertial=False)
            yield cone(half_angle=own, bound=[sight], frame=SIGHT, partner=partner)


def bound_by(zones: Sequence[Zone], spacecraft: Spacecraft) -> Bound:
    """Return the sights that the cones among some zones bind on a spacecraft."""
    return Bound([zone for zone in zones if isinstance(zone, KeepOut | KeepIn)], spacecraft)
