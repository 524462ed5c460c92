"""Messages that say why no attitude lets devices point at their targets.

They describe the best attitude there is, see `Decomposition`, with angles in degrees; or what holds of all of
them, such as that a target lies in a zone that its own device must keep out of.
"""

from itertools import combinations

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.goal.aims import AZIMUTH, goal_ranges
from jaxplan.model.goals import Targets
from jaxplan.model.outlines import corner_angle
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut

_AS_BAD = 0.5  # share of the worst excess from which on others are named, too: often several are as bad


def apart(craft: Spacecraft, asked: Targets) -> str | None:
    """Text on two instruments that cannot both see their targets: the angles between boresights and targets.

    They differ by more than the tolerance allows; None where those of no two instruments do.
    """
    first, names = craft.gimbals.count, craft.device_names
    fixed = [(place, number) for place, number in enumerate(asked.numbers(craft)) if number >= first]
    for (i, one), (j, other) in combinations(fixed, 2):
        boresights = craft.fixed_boresights[[one - first, other - first]]
        between, targets = separation(*boresights), separation(asked.directions[i], asked.directions[j])
        if abs(between - targets) > 2 * asked.tolerance:
            return (
                f"{names[one]} and {names[other]} are {np.rad2deg(between):.6g} deg apart, their targets "
                f"{np.rad2deg(targets):.6g} deg"
            )
    return None


def in_own_zone(scenario: Scenario, asked: Targets, time: float) -> str | None:
    """Text on devices whose targets lie where a zone that binds the same device lets them not point.

    That holds at every attitude. A zone that counts from a field of view is broken for certain by an axis
    that is as near to the boresight, which is in the field, or so far away that no corner reaches it.

    Args:
        scenario: whose spacecraft and zones count; zones of groups do not.
        asked: targets, wherever they are.
        time: s, at which targets and zones are looked at.

    Returns:
        A phrase for each device and zone; None where there is none.
    """
    craft = scenario.spacecraft
    cones: tuple[KeepOut | KeepIn, ...] = (*scenario.keep_out, *scenario.keep_in)
    zones = [zone for zone in cones if zone.is_inertial and zone.any_of is None]
    found = []
    for name, path in zip(asked.names(craft), asked.paths, strict=True):
        for zone in zones:
            if zone.of_field and not zone.devices:
                bound = craft.devices[craft.device_names.index(name)].field_of_view is not None
            else:
                bound = zone.binds_all or name in zone.devices
            if bound:
                deep = _depth(craft, name, zone, float(separation(path.at(time), zone.axis_at(time))))
                if deep > asked.tolerance:
                    called = f", {path.target}" * bool(path.target)
                    side = "outside keep-in" if isinstance(zone, KeepIn) else "inside keep-out"
                    where = f"{np.rad2deg(deep):.4g} deg {side} zone {zone.name}"
                    found.append(f"{name} is {where} at every attitude that points it at its target{called}")
    return "; ".join(found) or None


def _depth(craft: Spacecraft, name: str, zone: KeepOut | KeepIn, away: float) -> float:
    """How deep, rad, the boresight of a device is at least where a zone lets it not be; negative if clear.

    `away` is the angle, rad, from its target to the axis of the zone.
    """
    if isinstance(zone, KeepOut):
        return float(zone.half_angle) - away
    if not zone.of_field:
        return away - float(zone.half_angle)
    return away - float(corner_angle(craft.devices[craft.device_names.index(name)].field_of_view))


def off(craft: Spacecraft, asked: Targets, excesses: np.ndarray) -> str:
    """Text on the devices that miss their targets most: joints beyond limits, boresights off their targets.

    Args:
        craft: with the devices.
        asked: their targets, at an instant.
        excesses: (n, 2) rad, `Decomposition.aim_excesses`.
    """
    told: dict[str, str] = {}
    gimbals, ranges = craft.gimbals, goal_ranges(craft, asked)
    bad = np.argwhere(excesses >= _AS_BAD * np.max(excesses)).tolist()
    for place, angle in bad:
        device, by = asked.numbers(craft)[place], np.rad2deg(excesses[place, angle])
        if device < len(craft.terminals) or (device < gimbals.count and angle == AZIMUTH):
            joint = (gimbals.yaws if angle == AZIMUTH else gimbals.pitches)[device]
            told[craft.joint_names[joint]] = f"{by:.4g} deg beyond {_limits(ranges[joint])}"
        else:  # an angle in the axes of its boresight: with the other one it makes up the distance
            by = np.rad2deg(np.linalg.norm(np.maximum(excesses[place], 0)))
            told[craft.device_names[device]] = f"{by:.4g} deg off its target"
    each = [f"{name} is {what}" for name, what in told.items()]
    return " and ".join(", ".join(each).rsplit(", ", 1))


def _limits(ends: np.ndarray) -> str:
    """Text for a joint's range (2,) rad, in degrees."""
    low, high = np.rad2deg(ends)
    return f"its limit of {high:.6g} deg" if low == -high else f"its range of {low:.6g} to {high:.6g} deg"
