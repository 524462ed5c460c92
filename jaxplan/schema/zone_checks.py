"""Checks of fields of view, of zones, and of what errors that a plan must tolerate leave of zones and ranges.

Fields of view are checked with the zones that are measured from them. The errors are those of the table
``[robust]`` (`jaxplan.model.robust`); the *tube* about a plan holds all states that are off it by no more. As
in `jaxplan.schema.checks`, `WRONG` stands for a value whose fault was noted, and faults are noted by the keys
of a file.
"""

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxplan.model.bound_sights import Bound
from jaxplan.model.outlines import EDGES, corner_angle
from jaxplan.model.robust import Robust
from jaxplan.model.scenario import Scenario
from jaxplan.model.tabulation import MOST_WAYS, bound_by
from jaxplan.schema.arrays import UNIT_TOLERANCE
from jaxplan.schema.checks import ZONES, placed, shown
from jaxplan.schema.faults import WRONG, Place
from jaxplan.schema.sky import Followed
from jaxplan.schema.value_kinds import shortest_degrees

_MIN_ANGLE_LEFT = 1e-9  # rad, that must be left
_CONE_KEYS = ("keep_out", "keep_in")


def check_field(device: Any, place: Place, boresight: np.ndarray | None = None) -> None:
    """Note a fault if field of view and `up` are not given together, or `up` is not across the boresight.

    Args:
        device: an instrument or a terminal.
        place: its place.
        boresight: (3,) in the axes of `up`, if these are the device's own; `up` may then be left out. None
            for the device's `boresight` in body axes.
    """
    up, given = device.up, device.field_of_view
    if up is None and given is not None and boresight is None:
        place["up"].fault("missing, must be a unit vector of 3 numbers, since there is a field of view")
    if up is not None and given is None:
        place["field_of_view_deg"].fault("missing, must be 2 numbers, since up is given")
    forward = device.boresight if boresight is None else boresight
    if up is None or up is WRONG or forward is WRONG:
        return
    cosine = float(np.dot(up, forward))
    if abs(cosine) > UNIT_TOLERANCE:
        angle = np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))
        complaint = f"must be at right angles to the boresight, is {angle:.6g} deg from it"
        place["up"].fault(complaint, np.asarray(up).tolist())


def check_zones(scenario: Scenario, root: Place) -> None:
    """Note faults of zones: impossible demands on fields of view, and half angles of zero in other zones.

    Args:
        scenario: the scenario as it was read, after names were replaced by directions.
        root: its place.
    """
    craft = scenario.spacecraft
    devices = [
        one for name in ("terminals", "instruments") for _, one in placed(getattr(craft, name, ()), root)
    ]
    fields = {one.name: one.field_of_view for one in devices if one.field_of_view is not None}
    for place, zone in _placed_cones(scenario, root):
        if not zone.of_field:
            _check_half_angle(zone, place)
        else:
            _check_distance(zone, fields, place)
            _check_devices(zone, fields, place)
    _check_groups(scenario, len(fields), root)


def _placed_cones(scenario: Scenario, root: Place) -> Iterator[tuple[Place, Any]]:
    """Yield the keep-out and keep-in zones that could be read, each after its place."""
    for key in _CONE_KEYS:
        yield from placed(getattr(scenario, key), root[key])


def _check_half_angle(zone: Any, place: Place) -> None:
    """Note a fault if the half angle of a zone without field of view is zero.

    That of a zone about a body may not be known yet, and is not looked at.
    """
    if zone.half_angle == 0 and not isinstance(zone.direction, Followed):
        python = place.reading.python
        place["half_angle_deg"].fault(f"must lie in (0, {np.pi if python else 180:g})", 0.0 if python else 0)


def _check_distance(zone: Any, fields: dict[str, Any], place: Place) -> None:
    """Note a fault if a zone's distance from a field's edges is 90 deg or more, or leaves nothing of a field.

    Args:
        zone: a zone that is measured from fields of view.
        fields: (2,) rad, full angles of the fields of view, by names of their devices.
        place: place of the zone.
    """
    distance = zone.half_angle
    if not isinstance(distance, float):
        return
    most, why = np.pi / 2, "for more take a cone about the boresight, without a field of view"
    for name in zone.devices if zone.side < 0 and zone.devices is not WRONG else ():
        angles = fields.get(name)
        if isinstance(angles, np.ndarray) and np.min(angles) / 2 < most:
            most, why = float(np.min(angles)) / 2, f"{name} sees no farther to either side"
    if distance >= most:
        told = (distance, most) if place.reading.python else map(shortest_degrees, (distance, most))
        given, limit = told
        place["half_angle_deg"].fault(f"must be below {limit:.6g}: {why}", given)


def _check_devices(zone: Any, fields: dict[str, Any], place: Place) -> None:
    """Note a fault for each device or vector without field of view that a zone of fields binds.

    Arguments are as for `_check_distance`.
    """
    where = place["outside" if zone.side > 0 else "inside"]
    if zone.vectors not in ((), WRONG):
        where.fault("is of fields of view, which vectors do not have")
    if zone.devices is WRONG:
        return
    if zone.binds_all and not fields:
        where.fault("needs a device with field_of_view_deg")
    for number, name in enumerate(zone.devices):
        if name is not WRONG and name not in fields and name in (place.reading.names.get("device") or ()):
            place["devices"][number].fault("has no field_of_view_deg, from which to count", name)


def _check_groups(scenario: Scenario, fields: int, root: Place) -> None:
    """Note a fault for each group with an entry that keeps too many fields of view clear.

    With n fields such an entry has 5 ** n alternatives, of which `MOST_WAYS` are allowed.

    Args:
        scenario: the scenario as it was read.
        fields: number of devices with a field of view.
        root: the scenario's place.
    """
    kept: dict[tuple[Any, Any], int] = defaultdict(int)
    places: dict[tuple[Any, Any], Place] = {}
    for place, zone in _placed_cones(scenario, root):
        if zone.side > 0 and zone.of_field and zone.any_of not in (None, WRONG) and zone.devices is not WRONG:
            entry = zone.any_of, zone.entry or zone.name
            kept[entry] += len(zone.devices) or fields
            places.setdefault(entry, place)
    for entry, count in kept.items():
        ways = (len(EDGES) + 1) ** count
        if ways > MOST_WAYS:
            complaint = f"has an entry that keeps {count} fields of view clear, which may hold in {ways} ways"
            places[entry]["any_of"].fault(f"{complaint}, {MOST_WAYS} at most", entry[0])


def check_robust(scenario: Scenario, root: Place) -> None:
    """Note a fault where the tube about a plan leaves nothing of a zone or of a range of a joint.

    Args:
        scenario: the scenario as it was read; if faults were noted before, it is not checked.
        root: its place.
    """
    robust = scenario.robust
    if root.reading.faults or robust is None:
        return
    craft, error = scenario.spacecraft, root["robust"]["joint_error_deg"]
    for name, (low, high) in zip(craft.joint_names, craft.joint_ranges, strict=True):
        if not high - low - 2 * robust.joint_error >= _MIN_ANGLE_LEFT:
            most = shown(float(high - low) / 2, error)
            error.fault(
                f"must be below {most:.6g}, half of the range of {name}", shown(robust.joint_error, error)
            )
            return
    try:
        sights = bound_by(scenario.zones, craft)
        for key in ("keep_out", "keep_in"):
            for number, zone in enumerate(getattr(scenario, ZONES[key])):
                _check_zone(zone, robust, sights, root[key][number]["half_angle_deg"])
    except ValueError:  # what a zone binds is wrong, which other checks note
        return


def _check_zone(zone: Any, robust: Robust, sights: Bound, place: Place) -> None:
    """Note a fault if the tube leaves nothing of a cone for a device that it binds.

    Args:
        zone: the zone.
        robust: the errors.
        sights: the directions that zones bind.
        place: place of the zone's half angle.
    """
    other = None if zone.axis_device is None else sights.device(zone, "axis_device", zone.axis_device)
    axis = None if other is None else sights.carrier(other)
    for number in sights.fields(zone) if zone.of_field else sights.bound(zone):
        lost = robust.loss(sights.carrier(number), axis, inertial=zone.path is not None)
        least, widest = 0.0, np.pi
        if zone.of_field:
            field: Any = sights.craft.devices[number].field_of_view
            widest = min(np.pi / 2, np.pi - corner_angle(field)) if zone.side > 0 else np.min(field) / 2
            least = -np.inf
        if not least < zone.half_angle < widest:  # wrong by itself, which other checks note
            return
        narrowed = zone.side < 0 and not zone.of_field
        least, most = (lost, np.inf) if narrowed else (-np.inf, float(widest - lost))
        tube, name = robust.words, sights.names[number]
        value, amount = shown(float(zone.half_angle), place), shown(float(lost), place)
        if not zone.half_angle - least >= _MIN_ANGLE_LEFT:
            place.fault(f"must be above {amount:.6g}, which {tube} takes off it for {name}", value)
            return
        if not most - zone.half_angle >= _MIN_ANGLE_LEFT:
            end = f"must be below {shown(most, place):.6g}" if most > 0 else "cannot be kept"
            place.fault(f"{end}, since {tube} adds {amount:.6g} to it for {name}", value)
            return
