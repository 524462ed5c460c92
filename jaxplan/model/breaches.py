"""Messages on pointing constraints that a state breaks, or that targets break at any attitude.

Angles in messages are in degrees.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.model.bound_sights import body_axis_name
from jaxplan.model.constraints import (
    INERTIAL,
    JOINTS,
    SIGHT,
    Constraints,
    best_entries,
    chosen_entries,
    state_margins,
)
from jaxplan.model.goals import Targets
from jaxplan.model.outlines import corner_angle
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut, Mask, Zone

ROUNDING = 1e-9
"""rad, or share of a rate, by which a limit may be passed and not be broken, as in the certificate."""


def constraint_breaches(
    rows: Constraints,
    spacecraft: Spacecraft,
    attitude: np.ndarray,
    joints: np.ndarray,
    zones: Sequence[Zone],
    called: Sequence[str],
) -> Iterator[str]:
    """Yield a phrase for every pointing constraint that a state breaks by more than `ROUNDING`.

    Args:
        rows: the constraints, at an instant.
        spacecraft: the spacecraft whose devices they bind.
        attitude: (3, 3) body to inertial.
        joints: (2n + d,) rad.
        zones: the zone of each row, padding left out.
        called: names of the sights.

    Yields:
        Such as "antenna is 2.5 deg inside keep-out zone sun": for the best entry of the constraint the sight
        of its worst row that is worst, and by how much that breaks it.
    """
    sights = rows.sights(spacecraft.gimbals, spacecraft.fixed_boresights)
    table = state_margins(rows, sights, np.asarray(attitude), np.asarray(joints))
    worst = np.min(table, axis=-1, initial=np.inf)
    leaders = np.flatnonzero(~(best_entries(rows, worst) >= -ROUNDING))
    if not len(leaders):
        return
    beams = [f"the beam of {name}" for name in spacecraft.device_names]
    axes = [*beams, *called[len(beams) :]]
    chosen = chosen_entries(rows, worst)
    for leader in leaders:
        row = int(np.argmin(np.where(rows.entry == chosen[leader], worst, np.inf)))
        sight = int(np.argmin(table[row]))
        zone = zones[row]
        name = zone.name if zone.any_of is None else f"{zone.name}, the nearest of group {zone.any_of}"
        overlap = f"{np.rad2deg(-worst[row]):.4g} deg"
        yield f"{called[sight]} is {overlap} {_describe_breach(rows, row, zone, name, axes)}"


def _describe_breach(rows: Constraints, row: int, zone: Zone, name: str, axes: Sequence[str]) -> str:
    """Return the end of a sentence on a sight that breaks a row, such as "inside keep-out zone sun".

    Args:
        rows: the constraints.
        row: number of the row.
        zone: the zone to which the row belongs.
        name: the name by which the sentence calls the zone.
        axes: names of the sights as axes of cones, one for each sight.
    """
    if rows.frame[row] == JOINTS:
        return f"{'inside' if isinstance(zone, Mask) else 'beyond joint bound'} {name}"
    inside = isinstance(zone, KeepIn)
    side = "outside keep-in" if inside else "inside keep-out"
    if isinstance(zone, KeepOut | KeepIn) and zone.of_field:
        side = "short of keep-in" if inside else "too close to keep-out"
    if rows.frame[row] == INERTIAL:
        return f"{side} zone {name}"
    if rows.frame[row] == SIGHT:
        return f"{side} cone {name}, about {axes[rows.partner[row]]}"
    return f"{side} cone {name}, about {body_axis_name(rows.axis[row])}"


def in_own_zone(
    craft: Spacecraft, cones: Sequence[KeepOut | KeepIn], asked: Targets, time: float
) -> str | None:
    """Say which devices cannot point at their targets at any attitude, as zones that bind them forbid it.

    Only inertial zones outside of groups are looked at. A zone that is measured from a field of view counts
    only where it is broken for certain: if it is a keep-out, where its axis is so near to the boresight,
    which is in the field; if it is a keep-in, where the axis is farther away than the corners of the field.

    Args:
        craft: the spacecraft whose devices have the targets.
        cones: zones.
        asked: targets, which may move.
        time: s, at which targets and zones are looked at.

    Returns:
        A phrase for each such device and zone, joined by "; "; None if there is none.
    """
    zones = [zone for zone in cones if zone.is_inertial and zone.any_of is None]
    found = []
    for name, path in zip(asked.names(craft), asked.paths, strict=True):
        for zone in zones:
            if zone.of_field and not zone.devices:
                bound = craft.devices[craft.device_names.index(name)].field_of_view is not None
            else:
                bound = zone.binds_all or name in zone.devices
            if bound:
                deep = _breach_depth(craft, name, zone, float(separation(path.at(time), zone.axis_at(time))))
                if deep > asked.tolerance:
                    called = f", {path.target}" * bool(path.target)
                    side = "outside keep-in" if isinstance(zone, KeepIn) else "inside keep-out"
                    where = f"{np.rad2deg(deep):.4g} deg {side} zone {zone.name}"
                    found.append(f"{name} is {where} at every attitude that points it at its target{called}")
    return "; ".join(found) or None


def _breach_depth(craft: Spacecraft, name: str, zone: KeepOut | KeepIn, away: float) -> float:
    """Return by how much, rad, a boresight that points at its target breaks a zone at least.

    Args:
        craft: the spacecraft.
        name: name of the device.
        zone: an inertial zone that binds it.
        away: rad, angle from the target to the axis of the zone.

    Returns:
        rad; negative where the zone may be kept.
    """
    if isinstance(zone, KeepOut):
        return float(zone.half_angle) - away
    if not zone.of_field:
        return away - float(zone.half_angle)
    return away - float(corner_angle(craft.devices[craft.device_names.index(name)].field_of_view))
