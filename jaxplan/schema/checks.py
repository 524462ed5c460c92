"""Checks of what must go together in a scenario, beyond what each value must be by itself.

The checks get the scenario as it was read, in which `WRONG` stands for a value whose fault was noted before.
They note their faults at a `Place`, by the keys of a file.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxplan.model.devices import NEAREST_TO_POLE
from jaxplan.model.directions import DirectionPath
from jaxplan.model.equality import same
from jaxplan.model.scenario import MINIMUM, STRETCHED, Scenario
from jaxplan.model.wheel_reach import shared_out
from jaxplan.model.wheels import FLAT, MINIMAX, PSEUDO_INVERSE
from jaxplan.schema.arrays import PerAxis
from jaxplan.schema.faults import WRONG, Place, is_wrong
from jaxplan.schema.inertias import NO_BODY
from jaxplan.schema.value_kinds import NUMBER, shortest_degrees

MOST_ZONES = 1000  # number of zones of a scenario; more are refused before they are read
ZONES = {"keep_out": "keep_out", "keep_in": "keep_in", "joint_bound": "joint_bounds"}
"""Keys of a file under which pointing constraints stand, and their attributes."""
# Keys of rates at start and goal, and their attributes.
RATES = {"angular_velocity_rad_s": "angular_velocity", "joint_rates_rad_s": "joint_rates"}
AGAINST = 0.01  # fraction of its limit by which the fullest wheel may hold more than it has to
_DEVICE_ATTRIBUTES = {"terminal": "terminals", "drive": "drives", "instrument": "instruments"}
SQUARE = 1e-3  # by which the cosine of a right angle may differ from zero; `Mount.squared` makes it exact
APART = np.deg2rad(
    1.0
)  # rad, least angle between a drive's boresight and its axis, which it would not move on


def check_count(zones: Sequence[Any], root: Place) -> bool:
    """Note a fault if there are more zones than a scene may have, so that they are not read.

    Args:
        zones: the rows of each sort of zone, or whatever was given for them.
        root: the place of the scenario.

    Returns:
        True if the number is allowed.
    """
    count = sum(len(rows) for rows in zones if isinstance(rows, list | tuple))
    if count > MOST_ZONES:
        root.fault(f"{count} zones, more than the {MOST_ZONES} that are allowed")
    return count <= MOST_ZONES


def placed(rows: Any, place: Place) -> list[tuple[Place, Any]]:
    """Return the entries of a tuple that could be read, each after its place; none if it is no tuple."""
    entries = rows if isinstance(rows, tuple) else ()
    return [(place[i], row) for i, row in enumerate(entries) if row is not WRONG]


def check_parts(scenario: Scenario, root: Place) -> None:
    """Note faults where zones, goal limits and durations do not go together with the rest of a scenario.

    Args:
        scenario: the scenario as it was read.
        root: its place.
    """
    zones = {key: placed(getattr(scenario, name), root[key]) for key, name in ZONES.items()}
    check_unique([row for rows in zones.values() for row in rows])
    for key, rows in zones.items():
        for place, zone in rows:
            _check_zone(key, zone, place)
    _check_goal_limits(scenario, root)
    _check_duration(scenario, root)


def check_mount(mount: Any, place: Place) -> None:
    """Note a fault if the boresight of a mount is not at right angles to its yaw axis."""
    axis, boresight = mount.yaw_axis, mount.boresight
    if axis is WRONG or boresight is WRONG:
        return
    cosine = float(np.dot(axis, boresight))
    if not abs(cosine) <= SQUARE:
        angle = np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))
        place["boresight"].fault(
            f"must be at right angles to yaw_axis, the angle is {angle:.6g} deg", boresight.tolist()
        )


def check_terminal(terminal: Any, place: Place) -> None:
    """Note faults of a terminal: missing limits of rate or acceleration, and an empty range of pitch.

    Limits may be given for each joint or for both; pitch is kept `NEAREST_TO_POLE`, rad, away from 90 deg.
    """
    for quantity, unit in (("rate", "deg_s"), ("acceleration", "deg_s2")):
        key = f"{quantity}_limit_{unit}"
        both = getattr(terminal, f"{quantity}_limit")
        own = [getattr(terminal, f"{axis}_{quantity}_limit") for axis in ("yaw", "pitch")]
        if both is None and any(limit is None for limit in own):
            names = " and ".join(
                place[f"{axis}_{key}"].path.removeprefix(f"{place.path}.") for axis in ("yaw", "pitch")
            )
            place[key].fault(f"missing (or {names}), must be a number")
    pitch = terminal.pitch_range
    steepest = np.pi / 2 - NEAREST_TO_POLE
    if isinstance(pitch, np.ndarray) and not max(pitch[0], -steepest) < min(pitch[1], steepest):
        kept = f"must leave a range, of which {np.rad2deg(NEAREST_TO_POLE):g} deg are kept from 90"
        place["pitch_range_deg"].fault(kept, [shown(float(end), place) for end in pitch])


def shown(angle: Any, place: Place) -> Any:
    """Return a value for a message: an angle in rad as degrees if a file is read; else as it is."""
    return angle if place.reading.python or not isinstance(angle, float) else shortest_degrees(angle)


def check_drive(drive: Any, place: Place) -> None:
    """Note a fault if the boresight of a drive is less than `APART` off its axis."""
    axis, boresight = drive.axis, drive.boresight
    if axis is WRONG or boresight is WRONG:
        return
    off = float(np.arctan2(np.linalg.norm(np.cross(axis, boresight)), abs(np.dot(axis, boresight))))
    if not off >= APART:
        place["boresight"].fault(
            f"must be at least 1 deg off the axis, about which it turns; it is {np.rad2deg(off):.3g} deg off",
            boresight.tolist(),
        )


def check_wheel(wheel: Any, place: Place) -> None:
    """Note a fault if a wheel holds more momentum at the start than its limit."""
    stored, most = wheel.stored, wheel.momentum
    if WRONG not in (stored, most) and abs(stored) > most:
        place["stored_nms"].fault(f"must be at most {place['momentum_nms'].told(most)} either way", stored)


def _check_wheels(craft: Any, place: Place) -> None:
    """Note faults of wheels: too few, axes in a plane, equal names, or limits that do not go with wheels."""
    wheels, here = craft.wheels, place["wheel"]
    if wheels is WRONG:
        return
    if not wheels:
        if craft.allocation not in (WRONG, PSEUDO_INVERSE):
            reason = f"is how wheels share out torque, and there is no {here.path}"
            place["allocation"].fault(reason, craft.allocation)
        return
    check_unique(placed(wheels, here))
    axes = [wheel.axis for wheel in wheels if wheel is not WRONG]
    if len(wheels) < 3:
        here.fault(
            f"{len(wheels)} of them, must be three or more, so that they turn the body about any axis: about "
            "one that they miss, torque would have to be exactly zero at every instant, which is not proved"
        )
    elif len(axes) == len(wheels) and not any(axis is WRONG for axis in axes):
        sizes = np.linalg.svd(np.array(axes), compute_uv=False)
        if not sizes[-1] >= FLAT:
            here.fault(
                "their axes must not lie in one plane, or nearly so, across which they give no torque (least "
                f"singular value {sizes[-1]:.2g}, must be at least {FLAT:g})"
            )
        elif craft.allocation == MINIMAX:
            _check_sharing(wheels, place)
    if craft.inertia is None:
        here.fault(f"needs {place['inertia_kg_m2'].path}")
    for key, limit in (
        ("torque_limit_nm", craft.torque_limit),
        ("wheel_momentum_limit_nms", craft.wheel_momentum_limit),
    ):
        if limit is not None and limit is not WRONG:
            own = "torque_nm" if key == "torque_limit_nm" else "momentum_nms"
            place[key].fault(
                f"cannot stand beside {here.path}, where each has its own, such as {here[0][own].path}: it "
                "is for thrusters, or for wheels along the body axes that hold nothing at the start"
            )


# Least fraction of the whole inertia that must be left without stages; less is rounding.
_MIN_INERTIA_SHARE = 1e-9
_STAGE_INERTIAS = {
    "terminal": {"yaw_inertia_kg_m2": "yaw_inertia", "pitch_inertia_kg_m2": "pitch_inertia"},
    "drive": {"inertia_kg_m2": "inertia"},
}


def _check_stages(craft: Any, place: Place) -> None:
    """Note a fault if moving parts have inertias but the whole has none, or no body could have the rest.

    The rest, without moving parts, counts them as masses where their axes cross, and so must be the inertia
    of a body.
    """
    given = [
        (there[key], getattr(device, name))
        for kind, keys in _STAGE_INERTIAS.items()
        for there, device in placed(getattr(craft, f"{kind}s"), place[kind])
        for key, name in keys.items()
    ]
    given = [(there, inertia) for there, inertia in given if inertia is not None]
    if not given or craft.inertia is WRONG or any(inertia is WRONG for _, inertia in given):
        return
    if craft.inertia is None:
        for there, _ in given:
            there.fault(f"needs {place['inertia_kg_m2'].path}, that of the whole spacecraft, joints at zero")
        return
    if is_wrong(craft.terminals) or is_wrong(craft.drives):
        return  # noted before; how devices are mounted may not be known
    with np.errstate(invalid="ignore", divide="ignore"):
        fixed = craft.fixed_inertia
    if not np.all(np.isfinite(fixed)):
        return  # as for a drive that points along its axis, which is noted elsewhere
    left = np.linalg.eigvalsh(fixed)
    rounding = _MIN_INERTIA_SHARE * np.linalg.norm(craft.whole_inertia, 2)
    names = ", ".join(there.path for there, _ in given)
    whole = "is of the whole spacecraft with joints at zero, so"
    if not left[0] > rounding:
        complaint = (
            f"{whole} it must be more than what its stages have together; without {names} a least moment of "
            f"{left[0]:.6g} is left"
        )
    elif not left[2] <= left[0] + left[1] + rounding:
        moments = ", ".join(f"{own:.6g}" for own in left)
        complaint = f"{whole} what is left without {names} must have {NO_BODY}; it has {moments}"
    else:
        return
    place["inertia_kg_m2"].fault(complaint, np.asarray(craft.inertia).tolist())


def _check_sharing(wheels: Any, place: Place) -> None:
    """Note a fault if wheels' momenta at the start work against each other, which the envelope ignores."""
    numbers = [(wheel.momentum, wheel.stored) for wheel in wheels]
    if any(value is WRONG for pair in numbers for value in pair):
        return
    axes = np.array([wheel.axis for wheel in wheels])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    limit, stored = np.array(numbers, float).T
    least = shared_out(axes, limit, stored @ axes)
    fullest, needed = np.max(np.abs(stored) / limit), np.max(np.abs(least) / limit)
    if fullest > needed + AGAINST:
        place["allocation"].fault(
            f"shares out so that the fullest wheel has the least, {100 * needed:.3g} % of its momentum_nms "
            f"for what they hold together, and by stored_nms one has {100 * fullest:.3g} %: they hold "
            f'momentum against each other, which is for "{PSEUDO_INVERSE}" to count; or give them '
            f"stored_nms {', '.join(f'{own:.6g}' for own in least.round(9) + 0.0)}",
            MINIMAX,
        )


def check_spacecraft(craft: Any, place: Place) -> None:
    """Note faults: equal names, those of wheels and inertias, and torque limits without an inertia.

    Names, numbers and ranges of devices, to which start, goal and zones refer, are stored in
    ``place.reading``.
    """
    reading = place.reading
    _check_wheels(craft, place)
    _check_stages(craft, place)
    check_unique(
        [row for key, name in _DEVICE_ATTRIBUTES.items() for row in placed(getattr(craft, name), place[key])]
    )
    names = {key: _device_names(getattr(craft, name)) for key, name in _DEVICE_ATTRIBUTES.items()}
    terminals, drives, others = names["terminal"], names["drive"], reading.terminals
    if terminals is not None and others not in (None, len(terminals)):
        place["terminal"].fault(f"must be as many as start and goal are for, {others}, not {len(terminals)}")
    elif terminals is not None:
        reading.names["terminal"] = terminals
        reading.sizes["terminal"] = len(terminals)
        reading.names["gimbal"] = None if drives is None else terminals + drives
        if drives is not None:
            reading.sizes |= {"drive": len(drives), "joint": 2 * len(terminals) + len(drives)}
            reading.ranges = _joint_ranges(craft)
        each = names.values()
        reading.names["device"] = None if None in each else tuple(name for own in each for name in own or ())
    for key, limit in (
        ("torque_limit_nm", craft.torque_limit),
        ("wheel_momentum_limit_nms", craft.wheel_momentum_limit),
    ):
        if limit is not None and limit is not WRONG and craft.inertia is None:
            told = PerAxis(NUMBER).write(limit)
            place[key].fault(f"needs {place['inertia_kg_m2'].path}", told)


def _joint_ranges(craft: Any) -> np.ndarray | None:
    """Return the ranges of a spacecraft's joints, (number of joints, 2) rad; None if some have faults.

    Its terminals and drives were read, but for some of their attributes.
    """
    parts = ("yaw_limit", "yaw_range", "pitch_limit", "pitch_range")
    if any(getattr(one, part) is WRONG for one in craft.terminals for part in parts):
        return None
    if any(
        own[0] is None and own[1] is None
        for one in craft.terminals
        for own in ((one.yaw_limit, one.yaw_range), (one.pitch_limit, one.pitch_range))
    ):
        return None
    return None if any(drive.range is WRONG for drive in craft.drives) else craft.joint_ranges


def _device_names(devices: Any) -> tuple[str, ...] | None:
    """Return the names of devices; None if one of them has a fault."""
    if devices is WRONG or any(one is WRONG or one.name is WRONG for one in devices):
        return None
    return tuple(one.name for one in devices)


def check_unique(rows: Sequence[tuple[Place, Any]]) -> None:
    """Note a fault for each row that has the name of an earlier one.

    Args:
        rows: the rows that could be read, each after its place.
    """
    first: dict[str, Place] = {}
    for place, row in rows:
        if row.name in first:
            place["name"].fault(f"the same as {first[row.name]['name'].path}", row.name)
        elif row.name is not WRONG:
            first[row.name] = place


def _check_zone(key: str, zone: Any, place: Place) -> None:
    """Note a fault if a zone binds nothing or its own axis, or if it has an entry but no group.

    Args:
        key: key of `ZONES` under which it stands.
        zone: the zone.
        place: its place.
    """
    if key != "joint_bound":
        aside = zone.direction is None and not zone.is_inertial  # with two axes that was noted
        if (key == "keep_in" or aside) and zone.devices == () and zone.vectors == ():
            place["devices"].fault("missing (or vector), must be an array of names of devices")
        axis, bound = zone.axis_device, zone.devices
        if isinstance(axis, str) and bound is not WRONG and axis in bound:
            complaint = "is the axis, so it must not be among the devices that are bound"
            place["axis_device"].fault(complaint, axis)
    if zone.entry not in (None, WRONG) and zone.any_of is None:
        place["entry"].fault("needs any_of, the name of its group", zone.entry)


def check_targets(goal: Any, place: Place) -> None:
    """Note faults of a goal: holds or wishes of devices with targets, equal wishes, rates if targets move."""
    names = place.reading.names
    aimed = () if goal.devices is WRONG else goal.devices or names.get("terminal") or ()
    for i, name in enumerate(goal.hold if goal.hold is not WRONG else ()):
        if name is not WRONG and name in aimed:
            place["hold"][i].fault("has a target, so it cannot keep its joints", name)
        elif name is not WRONG and names.get("gimbal") is not None and name not in names["gimbal"]:  # type: ignore[operator]
            place["hold"][i].fault("has no joints to keep", name)
    told: list[tuple[Place, Any]] = []
    for here, wish in placed(goal.prefer, place["prefer"]):
        if wish.device is WRONG:
            continue
        twin = next((there for there, other in told if same(other, wish)), None)
        if twin is not None:
            here["device"].fault(f"the same wish, with its direction, as {twin.path}", wish.device)
            continue
        if wish.direction is not WRONG:
            told.append((here, wish))
        if wish.device in aimed:
            here["device"].fault("has a target, which it meets", wish.device)
        elif goal.hold is not WRONG and wish.device in goal.hold:
            here["device"].fault("keeps its joints, by hold", wish.device)
    if not isinstance(goal.directions, tuple):
        return
    for key, name in RATES.items():
        rates = getattr(goal, name)
        if rates is not None and rates is not WRONG and (np.any(rates) or np.any(np.signbit(rates))):
            place[key].fault("follows from the targets, of which some move; leave it out", rates.tolist())


def _check_goal_limits(scenario: Scenario, root: Place) -> None:
    """Note a fault if a limit of yaw or pitch at the goal is wider than a terminal's own."""
    for name in ("yaw_limit", "pitch_limit"):
        limit, key = getattr(scenario.goal, name, None), f"{name}_deg"
        if not isinstance(limit, float):
            continue
        terminals = getattr(scenario.spacecraft, "terminals", ())
        for place, terminal in placed(terminals, root["spacecraft"]["terminal"]):
            own = getattr(terminal, name)
            if own is not WRONG and own is not None and limit > own:
                goal, there = root["goal"][key], place[key]
                if not root.reading.python:
                    limit, own = shortest_degrees(limit), shortest_degrees(own)
                goal.fault(f"must not exceed {there.told(own)}", limit)
                break


def _check_duration(scenario: Scenario, root: Place) -> None:
    """Note what the paper's method cannot do: the shortest duration, or stretching with rates at the ends."""
    settings = scenario.trajectory
    if getattr(settings, "method", "") != "paper" or not isinstance(settings.duration, str):
        return
    place = root["trajectory"]["duration_s"]
    if settings.duration == MINIMUM:
        place.fault('only trajectory.method = "global" has it', settings.duration)
        return
    moving = [
        root[table][key].path
        for table in ("start", "goal")
        for key, name in RATES.items()
        if isinstance(rates := getattr(getattr(scenario, table), name, None), np.ndarray) and np.any(rates)
    ]
    if moving:
        complaint = f"must be a number of seconds, since stretching the time would change {', '.join(moving)}"
        place.fault(complaint, str(STRETCHED))


def check_paths(scenario: Scenario, root: Place) -> None:
    """Note a fault for each moving direction and each zone that is not known for the whole duration.

    For the paper's method, also note a duration that is no number if any direction moves.
    """
    settings = scenario.trajectory
    zones = [one for key in ("keep_out", "keep_in") for one in placed(getattr(scenario, key), root[key])]
    paths = [
        (zone.direction, place["direction"] if root.reading.python else place)
        for place, zone in zones
        if _is_moving(zone.direction)
    ]
    targets = placed(getattr(scenario.goal, "directions", ()), root["goal"]["targets"])
    paths += [(target, place) for place, target in targets if _is_moving(target)]
    duration = getattr(settings, "duration", STRETCHED)
    if paths and getattr(settings, "method", "") == "paper" and isinstance(duration, str):
        complaint = 'must be a number of seconds with trajectory.method = "paper", since something moves'
        root["trajectory"]["duration_s"].fault(complaint, duration)
    asked = root["trajectory"]["duration_s"].path
    for place, zone in zones:
        if WRONG is not zone.lasts and isinstance(duration, float) and not duration <= zone.lasts:
            place["lasts_s"].fault(f"must reach {asked} = {duration:g}", zone.lasts)
    for path, place in paths:
        first, last = path.times[0], path.times[-1]
        if isinstance(duration, float) and not path.covers(duration):
            place["times_s"].fault(f"must reach {asked} = {duration:g}, ends at {last:g}")
        elif not path.covers(0.0):
            place["times_s"].fault(f"must reach from the start, 0, on, lies in [{first:g}, {last:g}]")


def _is_moving(axis: Any) -> bool:
    """Tell whether a direction is a path that does not stand still."""
    return isinstance(axis, DirectionPath) and axis.moves
