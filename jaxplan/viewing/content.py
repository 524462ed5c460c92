"""The data of a viewer's page: the motion's polynomials, the spacecraft, zones, trails and curves.

Everything is plain numbers and texts for JSON. Matrices are lists of rows; directions are unit vectors,
inertial or in body axes; angles are in radians, but in curves in degrees or in percent of limits. A device's
own axes have its boresight as z and its left as y (`jaxplan.exporting.sampled`); the page computes them from
the joint angles that the polynomials give.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jaxplan.exporting.flight import Flight, Segment
from jaxplan.exporting.pieces import described
from jaxplan.exporting.sampled import field_in_own_axes, instrument_frames
from jaxplan.geometry.vectors import min_of_numbers, pointing
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import Targets
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut, masks
from jaxplan.planner import Plan
from jaxplan.plotting.margin_panels import margins_over_time
from jaxplan.plotting.spacecraft_parts import feet
from jaxplan.plotting.style import AXIS_STYLES, COLOURS, KEEP_IN, KEEP_OUT, Motion, motion
from jaxplan.timeline.record import TimelinePlan

_DRAWN_DECIMALS = 6  # decimals of directions and curves that are drawn
_MOTION_DECIMALS = 10  # decimals of the coefficients of the motion, rad
_TRACK_POINTS = 400  # points of the track of a moving zone's axis
_MASK_POINTS = 12  # points on each edge of a mask


def content(plan: Plan | TimelinePlan) -> dict[str, Any]:
    """Return the data that the page shows of a plan with a trajectory, as a dict for JSON.

    "trails" are the inertial directions of each device's boresight at "times_s", which "charts" share; "eye"
    is the direction from which the page looks at first.
    """
    scene, trajectory = plan.scenario, plan.trajectory
    assert trajectory is not None
    craft, moves = scene.spacecraft, motion(plan)
    parts = plan.segments if isinstance(plan, TimelinePlan) else ()
    flight = Flight(
        name=scene.name,
        spacecraft=craft,
        trajectory=trajectory,
        start=scene.epoch,
        segments=tuple(Segment(name=p.name, kind=p.kind, start=p.start, end=p.end) for p in parts),
    )
    start = moves.boresights[0] if len(craft.device_names) else np.zeros((0, 3))
    epoch = scene.epoch
    return {
        "name": scene.name,
        "status": _describe_status(plan, trajectory.duration),
        "epoch_ms": None if epoch is None else int(epoch.astype("datetime64[ms]").astype(int)),
        "motion": _describe_motion(flight),
        "devices": list(_describe_devices(craft)),
        "zones": [_describe_zone(zone, craft) for zone in _cones(scene)],
        "tracks": list(_describe_tracks(scene, trajectory.duration)),
        "targets": list(_describe_targets(scene, plan, trajectory.duration)),
        "trails": [
            _to_rounded_lists(moves.boresights[:, number]) for number in range(len(craft.device_names))
        ],
        "times_s": _to_rounded_lists(moves.times),
        "charts": [
            chart
            for chart in (_margin_chart(scene, moves), _rate_chart(craft, moves), _joint_chart(craft, moves))
            if chart
        ],
        "eye": _to_rounded_lists(_choose_eye(start)),
    }


def _cones(scene: Scenario) -> tuple[KeepOut | KeepIn, ...]:
    """Return the zones of a scene that are cones, which are all but bounds of joints and masks."""
    return (*scene.keep_out, *scene.keep_in)


def _to_rounded_lists(values: Any) -> Any:
    """Return numbers as nested lists, rounded to `_DRAWN_DECIMALS` decimals for drawing."""
    return np.round(np.asarray(values, float), _DRAWN_DECIMALS).tolist()


def _describe_motion(flight: Flight) -> dict[str, Any]:
    """Return the motion's polynomials, as `jaxplan.exporting.pieces.described`, with rounded coefficients.

    Rounding keeps the data of a day small and changes angles by less than 1e-9 rad in all.
    """
    held = described(flight, flight.name)
    for part in ("platform", "joints"):
        powers = np.asarray(held[part]["powers_rad"], float)
        held[part] = held[part] | {"powers_rad": np.round(powers, _MOTION_DECIMALS).tolist()}
    return held


def _describe_status(plan: Plan | TimelinePlan, duration: float) -> str:
    """Return a line of text with status, duration (s), and certificate of a plan."""
    proof = plan.certificate
    told = [plan.status.name, f"{duration:.2f} s"]
    if proof is not None and proof.certified and proof.min_margin is not None:
        told.append(f"certified, smallest margin {np.rad2deg(proof.min_margin):.2f} deg")
    elif proof is not None:
        told.append("certified" if proof.certified else "not certified")
    return ", ".join(told)


def _describe_devices(craft: Spacecraft) -> Iterator[dict[str, Any]]:
    """Yield for each device, in order, a dict with all that the page draws of it.

    "foot" is in body axes, where the platform is a cube with half edges of 1. "frame" (3, 3) turns into body
    axes: for an instrument its own axes, else its mount axes, which for a terminal are boresight, left and
    yaw axis at zero angles. "yaw" and "pitch" are indices of joints, None where there is none; "tilt" is in
    rad. "field" holds unit vectors to the corners of the field of view in the device's own axes, None without
    one, "masks" unit vectors along outlines in body axes.
    """
    places, gimbals = feet(craft), craft.gimbals
    fixed = instrument_frames(craft.fixed_boresights)
    every = masks(craft, tuple((0,) for terminal in craft.terminals for _ in terminal.mask))
    for number, device in enumerate(craft.devices):
        moving = number < gimbals.count
        terminal = number < len(craft.terminals)
        frame = gimbals.frames[number] if moving else fixed[number - gimbals.count]
        corners = field_in_own_axes(device, None if moving else fixed[number - gimbals.count])
        kind = "terminal" if terminal else "drive" if moving else "instrument"
        yield {
            "name": device.name,
            "kind": kind,
            "colour": COLOURS[number % len(COLOURS)],
            "foot": _to_rounded_lists(places[number]),
            "frame": np.asarray(frame, float).tolist(),
            "yaw": int(gimbals.yaws[number]) if moving else None,
            "pitch": len(craft.terminals) + number if terminal else None,
            "tilt": float(gimbals.tilts[number - len(craft.terminals)]) if kind == "drive" else 0.0,
            "field": None if corners is None else _to_rounded_lists(corners),
            "masks": [
                {
                    "name": mask.name,
                    "points": _to_rounded_lists(_mask_edge(mask.corners) @ np.asarray(frame).T),
                }
                for mask in every
                if mask.device == device.name
            ],
        }


def _mask_edge(corners: np.ndarray) -> np.ndarray:
    """Return directions (k, 3) along the edges of a mask with corners (yaw, pitch) in rad, in mount axes."""
    ends = np.asarray(corners, float)
    share = np.linspace(0, 1, _MASK_POINTS, endpoint=False)[:, None]
    points = np.concatenate(
        [begin + share * (end - begin) for begin, end in zip(ends, np.roll(ends, -1, axis=0), strict=True)]
    )
    return np.asarray(pointing(points[:, 0], points[:, 1]))


def _describe_zone(zone: KeepOut | KeepIn, craft: Spacecraft) -> dict[str, Any]:
    """Return a dict with all that the page draws of a zone.

    "side" is 1 for keep-out and -1 for keep-in, "told" a text for people, and "on" what the axis is fixed to:
    "inertial" with its "path" over time, "body" with its "axis", or "device" with the index of the device.
    """
    wide = f"{np.rad2deg(zone.half_angle):.3g} deg"
    if zone.of_field:
        wide = f"{wide} {'from' if zone.side > 0 else 'inside'} fields of view"
    bound = "all devices" if zone.binds_all else ", ".join(zone.devices)
    others = f"{len(zone.vectors)} more" if zone.vectors else ""
    group = f"; one of the group {zone.any_of}" if zone.any_of else ""
    told = (
        f"keep {'out' if zone.side > 0 else 'in'}, {wide}, for {' and '.join(filter(None, [bound, others]))}"
    )
    found: dict[str, Any] = {
        "name": zone.name,
        "side": zone.side,
        "half_angle": float(zone.half_angle) or 1e-3,
        "colour": KEEP_OUT if zone.side > 0 else KEEP_IN,
        "told": told + group,
        "on": "inertial",
    }
    if zone.axis_body is not None:
        return found | {"on": "body", "axis": _to_rounded_lists(zone.axis_body)}
    if zone.axis_device is not None:
        return found | {"on": "device", "device": craft.device_names.index(zone.axis_device)}
    return found | {"path": _describe_path(zone.path)}


def _describe_path(path: DirectionPath | None) -> dict[str, Any]:
    """Return times, samples and slopes of a direction for cubic interpolation; one each if it is fixed."""
    assert path is not None
    if not path.moves:
        return {
            "times_s": [0.0],
            "samples": [np.asarray(path.at(0.0), float).tolist()],
            "slopes": [[0.0] * 3],
        }
    parts = {"times_s": path.times, "samples": path.samples, "slopes": path.slopes}
    return {name: np.asarray(part, float).tolist() for name, part in parts.items()}


def _describe_tracks(scene: Scenario, duration: float) -> Iterator[dict[str, Any]]:
    """Yield the tracks of the axes of moving zones, inertial, with the colours of the zones."""
    for zone in _cones(scene):
        path = zone.path
        if path is not None and path.moves:
            times = np.linspace(0, min(duration, float(path.times[-1])), _TRACK_POINTS)
            yield {
                "points": _to_rounded_lists(path.at(times)),
                "colour": KEEP_OUT if zone.side > 0 else KEEP_IN,
            }


def _describe_targets(
    scene: Scenario, plan: Plan | TimelinePlan, duration: float
) -> Iterator[dict[str, Any]]:
    """Yield the targets of a single manoeuvre, inertial, where they are when it ends; none for a timeline."""
    asked = scene.goal
    if isinstance(plan, TimelinePlan) or not isinstance(asked, Targets):
        return
    names = scene.spacecraft.device_names
    there = asked.at(duration).directions
    for name, direction in zip(asked.names(scene.spacecraft), there, strict=True):
        yield {
            "name": name,
            "direction": _to_rounded_lists(direction),
            "colour": COLOURS[names.index(name) % len(COLOURS)],
        }


def _chart_curve(
    name: str, colour: str, values: np.ndarray, unit: str, places: int, **more: Any
) -> dict[str, Any]:
    """Return a curve of a chart; values (k,) that are not finite become gaps (None).

    `places` is the number of decimals with which the page writes values, `more` are further keys.
    """
    told = [value if np.isfinite(value) else None for value in _to_rounded_lists(values)]
    return {"name": name, "colour": colour, "values": told, "unit": unit, "places": places} | more


def _margin_chart(scene: Scenario, moves: Motion) -> dict[str, Any] | None:
    """Return the chart of the smallest margin of each device, deg; None if no zone binds any."""
    of_devices: dict[int, list[np.ndarray]] = {}
    for margin in margins_over_time(scene, moves):
        of_devices.setdefault(margin.device, []).append(margin.values)
    if not of_devices:
        return None
    names = scene.sight_names
    lines = [
        _chart_curve(names[device], COLOURS[device % len(COLOURS)], np.rad2deg(min_of_numbers(own)), "deg", 2)
        for device, own in sorted(of_devices.items())
    ]
    return {"title": "smallest margin to zones, deg", "floor": 0.0, "limit": 0.0, "lines": lines}


def _rate_chart(craft: Spacecraft, moves: Motion) -> dict[str, Any]:
    """Return the chart of the magnitudes of rates, in percent of their limits."""
    limits = np.broadcast_to(np.asarray(craft.rate_limit, float), (3,))
    lines = [
        _rate_curve(f"platform {axis}", str(style["color"]), values, limit)
        for axis, style, values, limit in zip(
            "xyz", AXIS_STYLES, np.asarray(moves.values.angular_velocity).T, limits, strict=True
        )
    ]
    rates = np.asarray(moves.values.joint_rates).T
    for name, colour, dashes, values, limit in zip(
        craft.joint_names, *_joint_looks(craft), rates, craft.joint_rate_limits, strict=True
    ):
        lines.append(_rate_curve(name, colour, values, float(limit), dashes=dashes))
    return {"title": "rates, percent of their limits", "floor": 0.0, "limit": 100.0, "lines": lines}


def _rate_curve(
    name: str, colour: str, values: np.ndarray, limit: float, dashes: bool = False
) -> dict[str, Any]:
    """Return the curve of the magnitude of a rate, values (k,) rad/s, in percent of its limit, rad/s.

    The limit in deg/s is added as "scale", by which the page writes the rate itself.
    """
    scale = float(np.rad2deg(limit))
    shown = colour if colour != "black" else "#7f8b99"  # visible on light and dark backgrounds
    return _chart_curve(name, shown, 100 * np.abs(values) / limit, "deg/s", 2, scale=scale, dashes=dashes)


def _joint_chart(craft: Spacecraft, moves: Motion) -> dict[str, Any] | None:
    """Return the chart of joint angles, deg; None without joints."""
    if not craft.joint_count:
        return None
    angles = np.rad2deg(np.asarray(moves.values.joints).T)
    lines = [
        _chart_curve(name, colour, values, "deg", 1, dashes=dashes)
        for name, colour, dashes, values in zip(craft.joint_names, *_joint_looks(craft), angles, strict=True)
    ]
    return {"title": "joints, deg", "floor": None, "limit": None, "lines": lines}


def _joint_looks(craft: Spacecraft) -> tuple[Sequence[str], Sequence[bool]]:
    """Return for each joint the colour of its device, and whether its curve is dashed (for pitches)."""
    count = len(craft.terminals)
    owners = [*range(count), *range(count), *range(count, count + len(craft.drives))]
    dashes = [count <= joint < 2 * count for joint in range(craft.joint_count)]
    return [COLOURS[owner % len(COLOURS)] for owner in owners], dashes


def _choose_eye(boresights: np.ndarray) -> np.ndarray:
    """Return the inertial unit vector toward the eye of the first view, given boresights (D, 3) at the start.

    It is on the side to which most of the boresights point, and a little above.
    """
    mean = np.sum(boresights, axis=0) if len(boresights) else np.zeros(3)
    flat = np.array([mean[0], mean[1], 0.0])
    length = np.linalg.norm(flat)
    ahead = flat / length if length > 0.2 else np.array([0.6, -0.8, 0.0])
    aside = np.array([-ahead[1], ahead[0], 0.0])
    found = 0.8 * ahead + 0.45 * aside + np.array([0.0, 0.0, 0.5])
    return np.asarray(found / np.linalg.norm(found))
