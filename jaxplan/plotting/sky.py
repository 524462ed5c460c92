"""The sphere of directions with zones and boresights from start to goal: a flat map, two discs, or a globe.

One drawing serves all projections of `jaxplan.plotting.projections` (the paper's Figures 7 and 12 are flat
maps). Directions are unit vectors in inertial axes, or in the local orbital frame, whose half spheres about
nadir and the zenith are two discs: on a flat map the Earth would be a band across all of it. A *track* is the
curve of a direction over time, a *wish* a direction that a device prefers, a *day* the motion of a timeline.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from jaxplan.planner import Plan
from jaxplan.plotting.day import DayPlan
from jaxplan.plotting.frames import INERTIAL, Inertial, Orbital, draw_discs, frame_of
from jaxplan.plotting.joint_map import field_outlines
from jaxplan.plotting.projections import FlatMap, GlobeView, Projection, TwoDiscs, circle, grid_lines
from jaxplan.plotting.style import (
    GREY,
    SMALL,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Look,
    device_entries,
    device_style,
    expect_plan,
    expect_view,
    legend_beside,
    motion,
    note,
    panels,
    plain,
    tidy,
)
from jaxplan.plotting.tracks import END_MARK, START_MARK, boresight_tracks, draw_tubes, end_marks
from jaxplan.plotting.zones import (
    NOTHING,
    Cone,
    draw_line,
    draw_way,
    draw_zone,
    name_zones,
    zone_entries,
    zone_outline,
    zone_tracks,
    zones_at,
)
from jaxplan.runtime.arguments import number
from jaxplan.sky import Satellite
from jaxplan.timeline.record import TimelinePlan

SPHERE_SIZE, DISCS_SIZE, GLOBE_SIZE = (WIDTH, 4.1), (WIDTH, 3.5), (WIDTH, 6.0)  # inches
_LEGEND_ROWS = 24  # most entries in a column of the legend, which is then not higher than the map
_NOW_MARK: Look = {"marker": "o", "markersize": 7, "linestyle": "none", "markeredgewidth": 0.8}
_NODE_MARK: Look = {"marker": ".", "markersize": 4.5, "linestyle": "none"}
_LAST_EDGE_LINE: Look = {"linewidth": 0.9, "alpha": 0.55, "zorder": 1.6}  # of a moving zone at its last place
_FIELD_LINE: Look = {"linewidth": 1.0, "zorder": 3.1}  # outline of a field of view
TRACK: Look = {"linewidth": 1.8, "zorder": 3}  # of a boresight
BETWEEN: Look = {"linewidth": 0.75, "alpha": 0.55, "zorder": 2.8}  # on a day, while no target is followed
MOST_BETWEEN = 24  # spans of following targets, beyond which a device's thin tracks between are not drawn
FOLLOWED: Look = {"linewidth": 2.6, "solid_capstyle": "round", "zorder": 3}
_POLE_DISTANCE = np.deg2rad(0.5)  # rad: distance from a pole within which the end of a track counts as at it


def sphere(
    plan: Plan | TimelinePlan,
    ax: Canvas = None,
    *,
    at: float | None = None,
    frame: str = "inertial",
    observer: Satellite | None = None,
    legend: bool = True,
) -> Axes:
    """Draw the zones and the track of every device's boresight on the unfolded sphere.

    Keep-out zones are hatched with a solid outline, keep-in zones have a dashed one, or a dotted one if they
    are of a group of which any one has to hold; the small print under a zone's name says which devices it
    binds, if not all, and its group. A zone that moves is drawn at its first place, with the track of its
    axis and, fainter, its edge at its last place. Where the scenario allows for errors, dotted lines bound
    how far they may move each boresight. Targets that are given by names of devices are marked, and so are
    directions that devices without a target prefer ("wish"). A plan that failed is drawn as far as it got:
    the path instead of the trajectory, start and goal without a path, and the targets where no goal was
    found. On a timeline's plan a device that follows many targets has no track between them.

    Args:
        plan: a plan of any status, also one of a timeline.
        ax: axes, a figure to put them in, or None for a new one.
        at: s, when zones are drawn, with a dot where each device points then; None for the start, no dots.
        frame: "inertial" for the unfolded sphere, or "orbital" for two discs in the local orbital frame
            (`jaxplan.sky.local_axes`): the half sphere about nadir, with the Earth's limb as it is at first,
            and that about the zenith, both with ahead up. What stands still in space moves in it.
        observer: the spacecraft's orbit, needed for the orbital frame, since a plan does not hold it.
        legend: whether to name devices and marks beside the map.

    Returns:
        The axes: azimuth and elevation, deg; for the discs angles from their middles, deg, where nadir is at
        (-104, 0) and the zenith at (104, 0).

    Raises:
        TypeError: if it is no plan, or the observer no orbit.
        ValueError: if more than one axes is given, the instant is not within the plan's trajectory, there is
            no such frame, or its orbit, epoch or trajectory is not known.

    Example:
        >>> jp.plot.sphere(plan, frame="orbital", observer=jp.load_observer("scene.toml"))
    """
    plan = expect_plan(plan)
    _expect_instant(plan, at)
    own = frame_of(plan, frame, observer)
    (axes,) = panels(ax, 1, DISCS_SIZE if isinstance(own, Orbital) else SPHERE_SIZE)
    if isinstance(own, Orbital):
        limb = draw_discs(axes, own)
        _draw_plan(axes, plan, TwoDiscs(), legend, at, own, limb)
        return axes
    tidy(axes)
    axes.spines[["top", "right"]].set_visible(True)
    # A strip around the map, so that a mark at a pole or at the meridian is whole.
    axes.set(xlim=(-186, 186), ylim=(-96, 96), xticks=range(-180, 181, 60), yticks=range(-90, 91, 30))
    axes.patch.set_facecolor("0.94")
    axes.add_artist(Rectangle((-180, -90), 360, 180, facecolor="white", edgecolor="0.6", zorder=0.5))
    axes.set_xlabel("inertial azimuth (deg)", fontsize=TEXT)
    axes.set_ylabel("inertial elevation (deg)", fontsize=TEXT)
    _draw_plan(axes, plan, FlatMap(), legend, at, own)
    if not plan.scenario.spacecraft.device_names:
        note(axes, "no devices")
    return axes


def globe(
    plan: Plan | TimelinePlan,
    ax: Canvas = None,
    *,
    view: tuple[float, float] | None = None,
    at: float | None = None,
    frame: str = "inertial",
    observer: Satellite | None = None,
    legend: bool = True,
) -> Axes:
    """Draw the zones and the track of every device's boresight on a globe, the sphere seen from outside.

    Lines and marks are those of `sphere`; the far side is pale. A failed plan is drawn as far as it got.

    Args:
        plan: a plan of any status, also one of a timeline.
        ax: axes, a figure to put them in, or None for a new one.
        view: azimuth and elevation of the eye in the frame, deg; None for one with most tracks in front.
        at: s, an instant, as of `sphere`.
        frame: "inertial" or "orbital", as of `sphere`; in the latter the zenith is up.
        observer: the spacecraft's orbit, as of `sphere`.
        legend: whether to name devices and marks beside the globe.

    Returns:
        The axes: right and up in the picture, in radii of the sphere.

    Raises:
        TypeError: if it is no plan, or the observer no orbit.
        ValueError: as `sphere`, and if the view is not two angles.
    """
    plan = expect_plan(plan)
    _expect_instant(plan, at)
    own = frame_of(plan, frame, observer)
    (axes,) = panels(ax, 1, GLOBE_SIZE)
    seen = view_of(plan, view, own)
    draw_ball(axes, seen)
    _draw_plan(axes, plan, seen, legend, at, own)
    return axes


def view_of(plan: Plan, angles: tuple[float, float] | None, frame: Inertial = INERTIAL) -> GlobeView:
    """Return the view from azimuth and elevation of the eye, deg; for None one facing most tracks."""
    if angles is not None:
        expect_view(angles)
        return frame.view(*np.deg2rad(angles))
    tracks = boresight_tracks(plan, frame)
    points = [mark.directions for mark in end_marks(plan)] if tracks is None else [tracks.reshape(-1, 3)]
    return frame.facing(np.concatenate([np.zeros((1, 3)), *points]))  # there may be no devices


def draw_ball(axes: Axes, view: GlobeView) -> None:
    """Draw the empty globe with a grid of 30 deg, and a caption that says from where it is seen."""
    axes.set_aspect("equal", anchor="E")  # else the layout counts space beside it as the legend's room
    axes.set(xlim=(-1.06, 1.06), ylim=(-1.06, 1.06))
    axes.set_axis_off()
    axes.add_artist(Circle((0, 0), 1, facecolor="white", edgecolor="0.6", linewidth=1, zorder=0.5))
    for line in grid_lines():
        draw_line(axes, view, line, {"color": "0.85", "linewidth": 0.5, "zorder": 0.7})
    text = f"{view.words}; grid of 30 deg"
    axes.text(0, -1.1, text, fontsize=SMALL, color=GREY, ha="center", va="top")


def _expect_instant(plan: Plan, at: float | None) -> None:
    """Raise a ValueError if an instant, s, is not within the plan's trajectory; None is always accepted."""
    if at is None:
        return
    time, trajectory = number("at", at, "a number of s"), plan.trajectory
    if trajectory is None or not 0 <= time <= trajectory.duration:
        known = (
            "there is no trajectory" if trajectory is None else f"must lie in [0, {trajectory.duration:g}] s"
        )
        raise ValueError(f"at = {at}: {known}")


def _draw_plan(
    axes: Axes,
    plan: Plan,
    projection: Projection,
    legend: bool,
    at: float | None,
    frame: Inertial,
    further: Entries | None = None,
) -> None:
    """Draw all that a projection shows of a plan, with its title and legend.

    Zones are drawn at the instant `at`, s, or for None at the start; `further` are more legend entries.
    """
    scenario, craft = plan.scenario, plan.scenario.spacecraft
    zones = zones_at(scenario, 0.0 if at is None else at, frame=frame)
    draw_zones(axes, plan, projection, zones, last=at is None, frame=frame)
    entries = device_entries(craft.device_names)
    tracks, tubes = boresight_tracks(plan, frame), Entries()
    if tracks is not None:
        left_out = crowded(plan)
        for device, track in enumerate(np.moveaxis(tracks, 1, 0)):
            look = {**(BETWEEN if followed(plan) else TRACK), **device_style(device)}
            if device not in left_out:
                draw_line(axes, projection, track, look)
        entries += _draw_followed_parts(axes, projection, plan, tracks)
        tubes = draw_tubes(axes, projection, scenario, tracks)
    if plan.path is not None and craft.device_names:
        nodes = np.asarray(craft.boresights(plan.path.attitudes, plan.path.joints))
        if frame.moves:  # there each node is drawn as at the time when it is passed
            passed = np.asarray(plan.trajectory.node_times if plan.trajectory is not None else ())
            nodes = frame.seen(nodes, passed) if len(passed) == len(nodes) else nodes[:0]
        for device, points in enumerate(np.moveaxis(nodes, 1, 0)):
            look = {"color": device_style(device)["color"], "zorder": 3.2, **_NODE_MARK}
            if isinstance(projection, FlatMap):  # the azimuth of a pole is arbitrary
                points = points[np.abs(points[:, 2]) < np.cos(_POLE_DISTANCE)]
            _draw_points(axes, projection, points, look)
        entries.append((Line2D([], [], color=GREY, **_NODE_MARK), "node of the path"))
    if at is not None:
        entries += _draw_instant(axes, plan, projection, at, frame)
    ends = draw_ends(axes, plan, projection, frame)
    entries += [*ends, *_draw_fields(axes, plan, projection, frame), *tubes]
    if legend:
        legend_beside(axes, [*entries, *zone_entries(scenario, frame), *(further or ())], rows=_LEGEND_ROWS)


def followed(plan: Plan) -> tuple[tuple[int, float, float], ...]:
    """Return when devices follow targets on a day, as of `DayPlan.followed`; () for any other plan."""
    return plan.followed if isinstance(plan, DayPlan) else ()


def _draw_followed_parts(axes: Axes, projection: Projection, plan: Plan, tracks: np.ndarray) -> Entries:
    """Draw bold the parts of tracks (k, D, 3) on which devices follow targets; returns the legend entries."""
    spans = followed(plan)
    if not spans:
        return []
    times = motion(plan).times
    for device, start, end in spans:
        within = (times >= start) & (times <= end)
        look = {**FOLLOWED, "color": device_style(device)["color"]}
        draw_line(axes, projection, tracks[within, device], look)
    return followed_entry(plan)


def followed_entry(plan: Plan) -> Entries:
    """Return the legend entries for bold tracks and for tracks that are left out; none unless it is a day."""
    bold: Look = {**FOLLOWED, "color": GREY}
    entries: Entries = [(Line2D([], [], **bold), "while it follows a target")] if followed(plan) else []
    if left_out := crowded(plan):
        names = plan.scenario.spacecraft.device_names
        whose = (
            "" if len(left_out) == len(names) else f"of {', '.join(names[device] for device in left_out)} "
        )
        entries.append((Line2D([], [], linestyle="none"), f"ways {whose}between targets\nare left out"))
    return entries


def crowded(plan: Plan) -> list[int]:
    """Return the devices that follow targets so often that their tracks between them are not drawn."""
    devices = [device for device, *_ in followed(plan)]
    return [device for device in sorted(set(devices)) if devices.count(device) > MOST_BETWEEN]


def _draw_fields(axes: Axes, plan: Plan, projection: Projection, frame: Inertial) -> Entries:
    """Draw the outlines of fields of view at start and goal; returns their legend entry, if there are any."""
    states: list[tuple[Any, float]] = [(plan.scenario.start, 0.0)]
    states += [] if plan.goal is None else [(plan.goal, frame.end(plan))]
    drawn = False
    for state, time in states:
        there = frame.attitude(state.attitude, time)
        for device, line in field_outlines(plan.scenario, there, state.joints):
            draw_line(axes, projection, line, {"color": device_style(device)["color"], **_FIELD_LINE})
            drawn = True
    return [(Line2D([], [], color=GREY, **_FIELD_LINE), "field of view")] if drawn else []


def _draw_instant(axes: Axes, plan: Plan, projection: Projection, at: float, frame: Inertial) -> Entries:
    """Mark where each device points at an instant, s; returns the legend entry, with UTC if known."""
    assert plan.trajectory is not None
    state = plan.trajectory.sample(at)
    looks = np.asarray(plan.scenario.spacecraft.boresights(frame.attitude(state.attitude, at), state.joints))
    for device, point in enumerate(looks):
        own = {"color": device_style(device)["color"], "markeredgecolor": "white", "zorder": 4.4, **_NOW_MARK}
        _draw_points(axes, projection, point[None], own)
    when = f"at {at:.6g} s"
    if plan.scenario.epoch is not None:
        stamp = plan.scenario.epoch.astype("datetime64[ms]") + np.timedelta64(round(1e3 * at), "ms")
        when = f"at {np.datetime_as_string(stamp, unit='s').replace('T', ' ')} UTC"
    return [(Line2D([], [], color=GREY, **_NOW_MARK), f"{when},\nas the zones are")]


def draw_zones(
    axes: Axes,
    plan: Plan,
    projection: Projection,
    zones: Sequence[Cone],
    *,
    last: bool = True,
    frame: Inertial = INERTIAL,
) -> None:
    """Draw zones with their names, the tracks of those that move, and the plan's title.

    With `last` moving zones also get a fainter edge at their last places.
    """
    for zone in zones:
        draw_zone(axes, projection, zone)
    ways = zone_tracks(plan, frame)
    for there, track in ways:
        look = zone_outline(there)
        if last:
            draw_line(axes, projection, circle(there.axis_at(), there.half_angle), look | _LAST_EDGE_LINE)
        draw_way(axes, projection, there, track)
    tracks, craft = boresight_tracks(plan, frame), plan.scenario.spacecraft
    drawn = [NOTHING if tracks is None else tracks.reshape(-1, 3), *(track for _, track in ways)]
    ends = [NOTHING, *(mark.directions for mark in end_marks(plan, frame))]
    name_zones(axes, projection, zones, craft.device_names, *map(np.concatenate, (drawn, ends)))
    outcome = "" if plan.ok else f": {plan.status.name}"
    plain(axes.set_title(f"{plan.scenario.name}{outcome}{frame.words}", fontsize=TEXT + 1, loc="left"))


def _draw_points(axes: Axes, projection: Projection, directions: np.ndarray, look: Look) -> None:
    """Draw marks of one look at directions (k, 3); a look without opacity gets that of the projection."""
    flat, opacity = projection.project(directions), projection.opacity(directions)
    for alpha in np.unique(opacity):
        axes.plot(*flat[opacity == alpha].T, **{"alpha": alpha, **look})


def draw_ends(
    axes: Axes, plan: Plan, projection: Projection, frame: Inertial = INERTIAL, **fading: float
) -> Entries:
    """Mark boresights at start and goal, targets and preferred directions (wishes); returns legend entries.

    Args:
        axes: to draw on.
        plan: of any status.
        projection: of the axes.
        frame: axes in which directions are drawn.
        **fading: perhaps ``alpha``, which replaces the projection's opacity.
    """
    marks = end_marks(plan, frame)
    tracks = boresight_tracks(plan, frame)
    for look, _, devices, directions in marks:
        star = look is START_MARK  # drawn in front of the others
        for device, point in zip(devices, directions, strict=True):
            if isinstance(projection, FlatMap) and (star or look is END_MARK) and tracks is not None:
                point = _move_off_pole(point, tracks[:: 1 if star else -1, device])
            colour = device_style(device)["color"]
            edge = "white" if star else colour
            own = {"color": colour, "markeredgecolor": edge, "zorder": 4.2 if star else 4, **look, **fading}
            _draw_points(axes, projection, point[None], own)
    return [(Line2D([], [], color=GREY, **mark.look), mark.name) for mark in marks]


def _move_off_pole(point: np.ndarray, track: np.ndarray) -> np.ndarray:
    """Move an end of a track off a pole of the flat map, where the azimuth is arbitrary, along the track.

    Args:
        point: (3,) unit vector, the end; returned as it is unless at a pole.
        track: (k, 3) from that end on.
    """
    if abs(point[2]) < np.cos(_POLE_DISTANCE):
        return point
    off = np.flatnonzero(np.abs(track[:, 2]) < np.cos(2 * _POLE_DISTANCE))
    if not len(off):
        return point
    across = track[off[0], :2] / np.linalg.norm(track[off[0], :2])
    return np.array([*(np.sin(_POLE_DISTANCE) * across), np.copysign(np.cos(_POLE_DISTANCE), point[2])])
