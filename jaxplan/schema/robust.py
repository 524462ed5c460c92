"""Check that errors which a plan must tolerate (`jaxplan.model.robust`) leave something of zones and ranges.

As in `checks`, faults are noted by the keys of a file.
"""

from typing import Any

import numpy as np

from jaxplan.model.bound_sights import Bound
from jaxplan.model.outlines import corner_angle
from jaxplan.model.robust import Robust
from jaxplan.model.scenario import Scenario
from jaxplan.model.tabulation import bound_by
from jaxplan.schema.checks import ZONES, shown
from jaxplan.schema.faults import Place

_MIN_ANGLE_LEFT = 1e-9  # rad, that must be left


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
