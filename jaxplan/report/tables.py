"""Tables of a report: what was asked for, and what was found.

What was asked for are the spacecraft with its limits, the zones, and the two ends of the manoeuvre. What was
found are path, trajectory, and what the certificate proves of it: its peaks are upper bounds and its margins
lower bounds over all time, not samples. A margin is positive where a zone is kept; a peak is the ratio of a
quantity to its limit.

Texts are in degrees and seconds. Directions are azimuth and elevation, as on the unfolded sphere: of zones
and targets in the inertial frame, of instruments and mountings in body axes. Functions that make a table
return it as HTML.
"""

from itertools import combinations
from typing import Any

import numpy as np

from jaxplan.certificate import Certificate, ProvedMargin
from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import azimuth_elevation, separation
from jaxplan.model.directions import as_path
from jaxplan.model.duration_bound import excess
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.limits import Limit, limits, timed_limits
from jaxplan.model.scenario import Scenario, paths
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.stages import matrix_of
from jaxplan.model.wheels import PSEUDO_INVERSE
from jaxplan.model.zones import JointBound, KeepIn, KeepOut, Mask, Zone
from jaxplan.planner import Plan
from jaxplan.report.markup import NONE, Markup, degrees, facts, join, number, share, table, tag

_STEP_NAMES = {"decompose": "goal", "search": "path", "compile": "compiling", "total": "in all"}
_DIRECTION_TITLES = ("Azimuth|deg", "Elevation|deg")
_ANGLE_TITLES = ("azimuth|deg", "elevation|deg")


_INERTIA_UNIT = "kg m\N{SUPERSCRIPT TWO}"
_TERMINAL_STAGES = {"yaw": "yaw_inertia", "pitch": "pitch_inertia"}


def spacecraft_tables(craft: Spacecraft) -> Markup:
    """Tables of the platform's limits, and of the devices with their mountings and limits."""
    parts = [facts(_platform_facts(craft), "Platform, limits of each body axis")]
    frames = craft.gimbals.frames
    if craft.wheels:
        rows = [
            [
                one.name,
                *_format_direction(one.axis),
                *(f"{x:.6g}" for x in (one.torque, one.momentum, one.stored)),
            ]
            for one in craft.wheels
        ]
        titles = ["Wheel", *(f"Axis {angle}" for angle in _ANGLE_TITLES), "Torque|N m", "Momentum|N m s"]
        allocated = "by the pseudo-inverse" if craft.allocation == PSEUDO_INVERSE else "by their envelope"
        caption = f"Reaction wheels, axes in body axes; allocation {allocated}"
        parts.append(table([*titles, "Stored at the start|N m s"], rows, caption))
    if craft.terminals:
        rows = [
            [one.name, *_format_direction(frame[:, 0]), *_format_direction(frame[:, 2])]
            for one, frame in zip(craft.terminals, frames, strict=False)
        ]
        titles = [
            "Terminal",
            *(f"{what} {angle}" for what in ("Boresight", "Yaw axis") for angle in _ANGLE_TITLES),
        ]
        parts.append(table(titles, rows, "Terminals, how they are mounted; body axes, at zero angles"))
    if craft.drives:
        rows = [
            [one.name, *_format_direction(one.boresight), *_format_direction(one.axis)]
            for one in craft.drives
        ]
        titles = ["Drive", *(f"{what} {angle}" for what in ("Boresight", "Axis") for angle in _ANGLE_TITLES)]
        parts.append(table(titles, rows, "Drives, how they are mounted; body axes, at zero angle"))
    if craft.joint_count:
        limits_of = zip(
            craft.joint_names,
            craft.joint_ranges,
            craft.joint_rate_limits,
            craft.joint_acceleration_limits,
            strict=True,
        )
        rows = [
            [name, *(degrees(end) for end in ends), degrees(rate), degrees(acceleration)]
            for name, ends, rate, acceleration in limits_of
        ]
        titles = ["Joint", "Least|deg", "Largest|deg", "Rate|deg/s", "Acceleration|deg/s\N{SUPERSCRIPT TWO}"]
        parts.append(table(titles, rows, "Limits of the joints"))
    stages = [
        (f"{device.name} {part}".rstrip(), getattr(device, name))
        for devices, names in ((craft.terminals, _TERMINAL_STAGES), (craft.drives, {"": "inertia"}))
        for device in devices
        for part, name in names.items()
    ]
    turned = [(name, matrix_of(inertia)) for name, inertia in stages if inertia is not None]
    if turned:
        skew = any(np.any(_inertia_products(matrix)) for _, matrix in turned)
        rows = [
            [
                name,
                *(f"{x:.6g}" for x in (*np.diagonal(matrix), *(_inertia_products(matrix) if skew else ()))),
            ]
            for name, matrix in turned
        ]
        axes = ("boresight", "left", "axis")
        titles = ["What turns", *(f"About {axis}|{_INERTIA_UNIT}" for axis in axes)]
        titles += [f"{a}, {b}|{_INERTIA_UNIT}" for a, b in combinations(axes, 2)] if skew else []
        what = "moments and products" if skew else "moments"
        parts.append(
            table(titles, rows, f"Gimbals that push back, {what} about the devices' axes at zero angles")
        )
    if craft.instruments:
        rows = [[one.name, *_format_direction(one.boresight)] for one in craft.instruments]
        caption = "Instruments, fixed to the body; boresights in body axes"
        parts.append(table(["Instrument", *_DIRECTION_TITLES], rows, caption))
    fields = [one for one in craft.devices if one.field_of_view is not None]
    if fields:
        rows = [[one.name, *(degrees(angle) for angle in np.asarray(one.field_of_view))] for one in fields]
        titles = ["Field of view of", "Across its up|deg", "Along its up|deg"]
        parts.append(table(titles, rows, "Rectangular fields of view, full angles"))
    return join(parts)


def _platform_facts(craft: Spacecraft) -> list[tuple[str, str]]:
    """The platform's limits and moments of inertia as (label, value with unit)."""
    rows = [
        (
            limit.quantity.label,
            f"{_format_distinct(limit.quantity.in_unit(limit.bound))} {limit.quantity.printed_unit}",
        )
        for limit in limits(craft)
        if not (limit.quantity.of_joints or limit.quantity.of_wheels)
    ]
    if (inertia := craft.whole_inertia) is not None:
        rows.append(("Moments of inertia", f"{_format_list(np.diagonal(inertia), 4)} {_INERTIA_UNIT}"))
        if np.any(_inertia_products(inertia)):
            label = "Products of inertia xy, xz, yz, as in the matrix"
            rows.append((label, f"{_format_list(_inertia_products(inertia), 4)} {_INERTIA_UNIT}"))
    return rows


def _inertia_products(inertia: np.ndarray) -> np.ndarray:
    """The entries (3,) above the diagonal of an inertia (3, 3): xy, xz and yz."""
    return np.asarray(inertia)[np.triu_indices(3, 1)]


def _format_distinct(values: Any) -> str:
    """Text of numbers: a single one if all are the same, otherwise the different ones in ascending order."""
    given = np.unique(values)
    return f"{given[0]:.6g}" if len(given) == 1 else ", ".join(f"{value:.6g}" for value in values)


def _format_list(values: Any, digits: int) -> str:
    """Text of numbers, separated by commas, with `digits` digits after the point."""
    return ",\N{NO-BREAK SPACE} ".join(number(float(value), digits) for value in values)


def _format_direction(vector: Any) -> tuple[str, str]:
    """Texts of the azimuth and elevation (deg) of a vector (3,)."""
    azimuth, elevation = azimuth_elevation(np.asarray(vector, float))
    return degrees(azimuth), degrees(elevation)


def kind_of(zone: Zone) -> str:
    """Text of a zone's kind, such as "keep-out, moving", with the group that it belongs to."""
    if isinstance(zone, Mask):
        return "mask"
    words = ["joint bound" if isinstance(zone, JointBound) else "keep-out" if zone.side > 0 else "keep-in"]
    if isinstance(zone, KeepOut | KeepIn) and zone.of_field:
        words = ["outside the field of view" if zone.side > 0 else "inside the field of view"]
    words += ["moving"] * zone.moves
    words += [] if zone.any_of is None else [f"any of {zone.any_of}"]
    words += [] if zone.entry is None else [f"with all of {zone.entry}"]
    return ", ".join(words)


def _axis_cells(zone: Zone) -> tuple[str, str, str, str]:
    """Cells of a zone in the table of zones: its axis, then azimuth, elevation and half angle in deg.

    Dashes stand for angles that it does not have. The first cell of a mask lists its corners, that of a joint
    bound the inequality.
    """
    if isinstance(zone, Mask):
        corners = ", ".join(f"({', '.join(degrees(part) for part in corner)})" for corner in zone.corners)
        return f"yaw and pitch within {corners} deg", NONE, NONE, NONE
    if isinstance(zone, JointBound):
        yaw, pitch = (float(weight) for weight in zone.normal)
        sign = "+" if pitch >= 0 else "\N{MINUS SIGN}"
        weighted = f"{number(yaw, 3)} yaw {sign} {number(abs(pitch), 3)} pitch"
        return f"{weighted}, at least {degrees(zone.least)} deg", NONE, NONE, NONE
    half_angle = degrees(zone.half_angle)
    if zone.axis_device is not None:
        return f"boresight of {zone.axis_device}", NONE, NONE, half_angle
    if zone.axis_body is not None:
        return "body axis", *_format_direction(zone.axis_body), half_angle
    return "inertial axis", *_format_direction(zone.axis_at()), half_angle


def _bound_names(zone: Zone) -> str:
    """Text that lists the devices and vectors that a zone binds."""
    if isinstance(zone, JointBound | Mask):
        return zone.device
    of = [f"{vector.to or 'body'} {_format_list(vector.along, 3)}" for vector in zone.vectors]
    return "all devices" if zone.binds_all else ", ".join([*zone.devices, *of])


def zones_table(scenario: Scenario) -> Markup:
    """Table of the zones; it says so if there are none."""
    if not scenario.zones:
        return facts([("Zones", "none: devices may look anywhere")], "Zones")
    titles = ["Zone", "Kind", "About", *_DIRECTION_TITLES, "Half angle|deg", "Binds"]
    rows = [[zone.name, kind_of(zone), *_axis_cells(zone), _bound_names(zone)] for zone in scenario.zones]
    return table(titles, rows, "Zones; axes that move as they are at first")


def motion_table(plan: Plan) -> Markup:
    """Table of the zones and targets that move during the manoeuvre; empty if nothing moves."""
    goal = plan.goal
    moving = list(paths(plan.scenario))
    if not moving:
        return join(())
    last = goal.time if goal is not None else min(float(path.times[-1]) for _, path in moving)
    titles = [
        *("What moves", "Azimuth at first|deg", "Elevation at first|deg"),
        *(f"Azimuth after {last:.2f} s|deg", "Elevation then|deg", "Turns at most at|deg/s"),
    ]
    rows = []
    for what, path in moving:
        name = f"{what}, {path.target}" if path.target else what
        ends = *_format_direction(path.at(0.0)), *_format_direction(path.at(last))
        rows.append([name, *ends, degrees(path.largest_rate(0.0, last), 4)])
    return table(titles, rows, "Zones and targets that move, inertial")


def tube_table(scenario: Scenario) -> Markup:
    """Table of the errors and reserves that the plan allows for (`robust`); empty if there are none."""
    robust = scenario.robust
    if robust is None:
        return join(())
    rows = [
        ("Attitude, about any axis", f"{degrees(robust.attitude_error, 3)} deg"),
        ("Each joint", f"{degrees(robust.joint_error, 3)} deg"),
        ("Torque kept back", f"{robust.torque_reserve:g} % of each limit"),
        ("Wheel momentum kept back", f"{robust.momentum_reserve:g} % of each limit"),
        ("Margins and peaks below", "of what these leave"),
    ]
    return facts(rows, "Errors that the plan bears")


def ends_tables(plan: Plan) -> Markup:
    """Tables of start and goal: attitudes, joints, the targets and wishes asked for, and devices held."""
    scenario, goal = plan.scenario, plan.goal
    attitudes = {"Start": scenario.start.attitude} | ({} if goal is None else {"Goal": goal.attitude})
    rows = [
        (f"{name}, quaternion w x y z", _format_list(quaternion.from_matrix(matrix), 6))
        for name, matrix in attitudes.items()
    ]
    if goal is not None:
        turn = f"{degrees(goal.slew_angle, 3)} deg, {number(goal.slew_angle, 4)} rad"
        rows.append(("Platform turns by", turn))
    parts = [facts(rows, "Attitude, body to inertial")]
    if scenario.spacecraft.joint_count:
        parts.append(_joints_table(plan))
    asked = scenario.goal
    if not isinstance(asked, GivenState) and len(asked.directions):
        then = asked.at(0.0 if goal is None else goal.time)
        called = [as_path(direction).target or NONE for direction in asked.directions]
        each = zip(asked.names(scenario.spacecraft), called, then.directions, strict=True)
        targets = [[name, target, *_format_direction(direction)] for name, target, direction in each]
        when = f", after {number(goal.time)} s" if goal is not None and asked.moves else ""
        parts.append(
            table(["Device", "Target", *_DIRECTION_TITLES], targets, f"Targets asked for, inertial{when}")
        )
    if not isinstance(asked, GivenState) and asked.prefer:
        parts.append(_wishes_table(plan, asked))
    if not isinstance(asked, GivenState) and asked.hold:
        parts.append(facts([("Devices", ", ".join(asked.hold))], "Devices that keep their joints"))
    return join(parts)


def _wishes_table(plan: Plan, asked: Targets) -> Markup:
    """Table of the directions that devices without a target prefer, and how far from them they end."""
    craft, goal, rows = plan.scenario.spacecraft, plan.goal, []
    for wish in asked.prefer:
        direction, apart = as_path(wish.direction).at(0.0 if goal is None else goal.time), NONE
        if goal is not None:
            looks = craft.boresights(goal.attitude, goal.joints)[craft.device_names.index(wish.device)]
            apart = degrees(float(separation(looks, direction)), 4)
        rows.append(
            [wish.device, as_path(wish.direction).target or NONE, *_format_direction(direction), apart]
        )
    titles = ["Device", "Target", *_DIRECTION_TITLES, "Off it at the goal|deg"]
    return table(titles, rows, "What devices without a target prefer, the first before the second; inertial")


def _joints_table(plan: Plan) -> Markup:
    """Table of the joint angles at start and goal, with their ranges."""
    craft, start = plan.scenario.spacecraft, plan.scenario.start.joints
    rows = []
    for i, name in enumerate(craft.joint_names):
        end = [NONE, NONE]
        if plan.goal is not None:
            end = [degrees(plan.goal.joints[i]), degrees(plan.goal.joints[i] - start[i])]
        rows.append([name, degrees(start[i]), *end, *(degrees(bound) for bound in craft.joint_ranges[i])])
    titles = ["Joint", "Start|deg", "Goal|deg", "Change|deg", "Least|deg", "Largest|deg"]
    return table(titles, rows, "Joints")


def path_table(plan: Plan) -> Markup:
    """Table of the search, and of the path if one was found; the plan must have reached the search."""
    assert plan.search is not None
    settings = plan.scenario.search
    rows = [
        ("Planner", f"{settings.method}, seed {settings.seed}"),
        ("Expansions", f"{plan.search.expansions} of at most {settings.max_expansions}"),
    ]
    if plan.path is not None:
        edges = plan.path.edges
        rows += [
            ("Length", f"{number(plan.path.length)} steps"),
            ("Edges", str(edges)),
            ("Interior nodes", str(max(edges - 1, 0))),
        ]
    return facts(rows, "How it was found")


def trajectory_table(plan: Plan) -> Markup:
    """Table of the trajectory's method, duration and smoothness; the plan must have one."""
    trajectory, bound = plan.trajectory, plan.duration_bound
    assert trajectory is not None
    asked = plan.scenario.trajectory.duration
    rows = [
        ("Method", trajectory.method),
        ("Duration", f"{number(trajectory.duration, 3)} s"),
        ("Asked for", f'"{asked}"' if isinstance(asked, str) else f"{asked:g} s"),
    ]
    if bound is not None:
        above = excess(trajectory.duration, bound)
        there = " to this goal" if plan.goal_chosen else ""
        rows.append((f"No motion{there} is quicker than", f"{number(bound, 3)} s"))
        rows.append(("By the limits of", f"{plan.duration_bound_name}; zones are not counted"))
        if above is not None:
            rows.append(("Above that", f"{share(above)} %"))
    rows.append(("Continuous derivatives", str(trajectory.smoothness)))
    if plan.ok and plan.message:
        rows.append(("Note", plan.message))
    return facts(rows, "Method and duration")


def highest_peak(certificate: Certificate, craft: Spacecraft) -> tuple[str, str]:
    """Find the quantity that comes closest to its limit.

    Ranges of joints count only if nothing else is limited: a joint may rest at an end of its range, which
    is no load. The table of peaks has them.

    Returns:
        Name of the quantity, and its proved peak in percent of its limit, as texts.
    """
    timed = {limit.quantity.name for group in timed_limits(craft) for limit in group}
    names = [name for name in certificate.peaks if name in timed] or list(certificate.peaks)
    name = max(names, key=lambda name: certificate.peaks[name])
    return _find_limit(name, craft)[0].lower(), share(certificate.peaks[name])


def peaks_table(certificate: Certificate, craft: Spacecraft) -> Markup:
    """Table of the proved peaks beside their limits."""
    titles = ["Quantity", "Largest, at most|", "Limit|", "Unit", "Share|%", "", "At|s"]
    rows = []
    ranges = {limit.quantity.name: limit for limit in limits(craft) if limit.quantity.power == 0}
    for name, peak in certificate.peaks.items():
        label, unit, bounds = _find_limit(name, craft)
        largest, limit = NONE, NONE
        if name in ranges:
            label, limit = f"{label}, of the way to an end of their range", _format_range(ranges[name])
        elif len(bounds):
            ends = [number(float(end), 3) for end in (np.min(bounds), np.max(bounds))]
            if np.ptp(bounds) <= 1e-12 * np.max(bounds):
                largest, limit = number(peak * float(bounds[0]), 3), number(float(bounds[0]), 3)
            else:
                limit = " to ".join(ends)
        time = number(certificate.peak_times.get(name))
        rows.append([label, largest, limit, unit, share(peak), _ratio_bar(peak), time])
    return table(titles, rows, "Peaks over all time, as proved")


def _format_range(limit: Limit) -> str:
    """Text of the range (deg) that a kind of joint angle has; a dash where joints have different ranges."""
    middle = 0.0 if limit.centre is None else limit.centre
    ends = np.unique(np.round(np.rad2deg([middle - limit.bound, middle + limit.bound]), 9), axis=1)
    return " to ".join(number(float(end), 3) for end in ends[:, 0]) if ends.shape[1] == 1 else NONE


def _find_limit(name: str, craft: Spacecraft) -> tuple[str, str, np.ndarray]:
    """Look up the limit of a peak.

    Args:
        name: of the peak in the certificate.
        craft: the spacecraft, with the limits.

    Returns:
        Label, unit, and the limits (c,) of its c components in this unit; without a limit the unit is empty
        and c is 0.
    """
    for limit in limits(craft):
        if limit.quantity.name == name:
            return limit.quantity.label, limit.quantity.printed_unit, limit.quantity.in_unit(limit.bound)
    return name.replace("_", " "), "", np.zeros(0)


def _ratio_bar(peak: float) -> Markup:
    """HTML of a bar whose length shows a ratio to a limit; above 1 it is full and has another colour."""
    beyond = not peak <= 1 + 1e-9
    width = f"width:{100 if beyond else 100 * peak:.1f}%"
    fill = tag("span", class_="fill over" if beyond else "fill", style=width)
    return tag("span", fill, class_="bar", aria_hidden="true")


def margins_table(margins: tuple[ProvedMargin, ...], plan: Plan) -> Markup:
    """Table of the proved margins by zone and device, the smallest first and highlighted."""
    zones = {zone.name: zone for zone in plan.scenario.zones}
    rows = []
    for margin in sorted(margins, key=lambda margin: margin.bound):
        group = "" if len(margin.zones) == 1 else f" of {', '.join(margin.zones)}"
        what = f"{margin.zone}{group}", kind_of(zones[margin.zone]), margin.device
        rows.append([*what, degrees(margin.bound, 3), number(margin.time)])
    titles = ["Zone", "Kind", "Device", "Margin, at least|deg", "Smallest at|s"]
    return table(titles, rows, "Margins over all time, as proved", marked=0)


def faults_list(certificate: Certificate) -> Markup:
    """List of what the certificate could not prove; empty if all is proved."""
    if not certificate.faults:
        return join(())
    return tag("ul", *(tag("li", fault) for fault in certificate.faults), class_="faults")


def timings_table(plan: Plan) -> Markup:
    """Table of the computation time of each step of planning."""
    rows = [[_STEP_NAMES.get(name, name), number(seconds, 3)] for name, seconds in plan.timings.items()]
    return table(["Step", "Time|s"], rows, "Time spent planning")
