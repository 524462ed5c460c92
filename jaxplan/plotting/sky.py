"""The sphere of directions with zones, boresights and their ends, as a flat map and as a globe.

One drawing serves both projections of `jaxplan.plotting.projections` (the paper's Figures 7 and 12 are flat
maps). Directions are inertial unit vectors.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Rectangle

from jaxplan import so3
from jaxplan.geometry.vectors import separation
from jaxplan.model.directions import as_path
from jaxplan.model.path import Path
from jaxplan.model.scenario import GivenState, Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner import Plan
from jaxplan.plotting.joint_map import field_outlines
from jaxplan.plotting.projections import FlatMap, GlobeView, Projection, circle, grid_lines
from jaxplan.plotting.style import (
    GREY,
    HALO,
    KEEP_IN,
    KEEP_OUT,
    SMALL,
    TEXT,
    Canvas,
    Entries,
    Entry,
    Labels,
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

Cone = KeepOut | KeepIn

SPHERE_SIZE, GLOBE_SIZE = (11.0, 4.9), (8.2, 6.4)  # inches
# The square is open, and the star fits into it, so that both show where a device does not move.
_START: Look = {"marker": "*", "markersize": 12, "linestyle": "none", "markeredgewidth": 0.5}
_END: Look = {
    "marker": "s",
    "markersize": 12,
    "linestyle": "none",
    "fillstyle": "none",
    "markeredgewidth": 1.8,
}
_TARGET: Look = {"marker": "x", "markersize": 8, "linestyle": "none", "markeredgewidth": 2}
_WISH: Look = {
    "marker": "D",
    "markersize": 7,
    "linestyle": "none",
    "fillstyle": "none",
    "markeredgewidth": 1.1,
}
_NODE: Look = {"marker": ".", "markersize": 4.5, "linestyle": "none"}
_EDGE: Look = {"linewidth": 1.1, "zorder": 1.6}  # of a zone
_FAINT: Look = {"linewidth": 0.9, "alpha": 0.55, "zorder": 1.6}  # of one that moves, where it is at last
_FIELD: Look = {"linewidth": 1.0, "zorder": 3.1}  # of view
_ZONE_WAY: Look = {"linewidth": 1.1, "zorder": 1.7}
_WAY = 33  # points of the way of a zone's axis
_CROWD = 20  # zones, beyond which their names get smaller and go without the devices they bind
# Where a zone's name may stand, the best first: shares of the zone's half width and half height.
_SPOTS = np.array([(across, up) for across in (0, 0.6, -0.6, 1.2, -1.2) for up in (0, 0.5, -0.5, 0.8, -0.8)])
_INSIDE = 0.9  # of a zone's half angle, within which the middle of its name stands
_NOTHING = np.zeros((0, 3))


def sphere(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> Axes:
    """The zones and the way of every device's boresight on the unfolded sphere.

    Keep-out zones are hatched with a solid outline, keep-in zones have a dashed one, or a dotted one if they
    are of a group of which any one holds; the small print under a zone's name says which devices it binds if
    not all, and its group. One that moves is drawn where it is at first, with the way of its axis and,
    fainter, its edge at last. Targets that devices have by their names are marked, and what devices without
    a target would rather point at as wishes. A plan that failed is drawn as far as it came: the path instead
    of the trajectory, start and goal without a path, and the targets where no goal was found.

    Args:
        plan: of any status.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name devices and marks beside the map.

    Returns:
        The axes: inertial azimuth against elevation, deg.

    Raises:
        TypeError: if it is no plan.
        ValueError: if more than one axes is given.
    """
    expect_plan(plan)
    (axes,) = panels(ax, 1, SPHERE_SIZE)
    tidy(axes)
    axes.spines[["top", "right"]].set_visible(True)
    # A strip around the map, so that a mark at a pole or at the meridian is whole.
    axes.set(xlim=(-186, 186), ylim=(-96, 96), xticks=range(-180, 181, 60), yticks=range(-90, 91, 30))
    axes.patch.set_facecolor("0.94")
    axes.add_artist(Rectangle((-180, -90), 360, 180, facecolor="white", edgecolor="0.6", zorder=0.5))
    axes.set_xlabel("inertial azimuth (deg)", fontsize=TEXT)
    axes.set_ylabel("inertial elevation (deg)", fontsize=TEXT)
    _draw_plan(axes, plan, FlatMap(), legend)
    if not plan.scenario.spacecraft.device_names:
        note(axes, "no devices")
    return axes


def globe(
    plan: Plan,
    ax: Canvas = None,
    *,
    view: tuple[float, float] | None = None,
    legend: bool = True,
) -> Axes:
    """The zones and the way of every device's boresight on the sphere of directions, seen in space.

    The looks are those of the unfolded sphere; what is on the far side is pale. A plan that failed is drawn
    as far as it came.

    Args:
        plan: of any status.
        ax: axes, a figure to put them in, or None for a new one.
        view: inertial azimuth and elevation of the eye, deg; None for where most of the ways are in front.
        legend: whether to name devices and marks beside the globe.

    Returns:
        The axes: to the right and up in the picture, in radii.

    Raises:
        TypeError: if it is no plan.
        ValueError: if more than one axes is given.
    """
    expect_plan(plan)
    (axes,) = panels(ax, 1, GLOBE_SIZE)
    seen = view_of(plan, view)
    draw_ball(axes, seen)
    _draw_plan(axes, plan, seen, legend)
    return axes


def view_of(plan: Plan, angles: tuple[float, float] | None) -> GlobeView:
    """The view that was asked for, deg, or the one with most of the ways in front."""
    if angles is not None:
        expect_view(angles)
        return GlobeView.from_angles(*np.deg2rad(angles))
    ways = boresight_ways(plan)
    points = [mark.directions for mark in end_marks(plan)] if ways is None else [ways.reshape(-1, 3)]
    return GlobeView.facing(np.concatenate([np.zeros((1, 3)), *points]))  # there may be no devices


def draw_ball(axes: Axes, view: GlobeView) -> None:
    """Draw the empty globe with a grid, and a caption that says from where it is seen."""
    axes.set_aspect("equal")
    axes.set(xlim=(-1.06, 1.06), ylim=(-1.06, 1.06))
    axes.set_axis_off()
    axes.add_artist(Circle((0, 0), 1, facecolor="white", edgecolor="0.6", linewidth=1, zorder=0.5))
    for line in grid_lines():
        draw_line(axes, view, line, {"color": "0.85", "linewidth": 0.5, "zorder": 0.7})
    text = f"{view.words}; grid of 30 deg"
    axes.text(0, -1.1, text, fontsize=SMALL, color=GREY, ha="center", va="top")


def _draw_plan(axes: Axes, plan: Plan, projection: Projection, legend: bool) -> None:
    """Draw all that a projection shows of a plan, with title and legend."""
    scenario, craft = plan.scenario, plan.scenario.spacecraft
    draw_zones(axes, plan, projection, zones_at(scenario, 0.0))
    entries = device_entries(craft.device_names)
    ways = boresight_ways(plan)
    if ways is not None:
        for device, way in enumerate(np.moveaxis(ways, 1, 0)):
            draw_line(axes, projection, way, {"linewidth": 1.8, "zorder": 3, **device_style(device)})
    if plan.path is not None and craft.device_names:
        nodes = craft.boresights(plan.path.attitudes, plan.path.joints)
        for device, points in enumerate(np.moveaxis(nodes, 1, 0)):
            look = {"color": device_style(device)["color"], "zorder": 3.2, **_NODE}
            _draw_points(axes, projection, points, look)
        entries.append((Line2D([], [], color=GREY, **_NODE), "node of the path"))
    entries += [*draw_ends(axes, plan, projection), *_draw_fields(axes, plan, projection)]
    if legend:
        legend_beside(axes, [*entries, *zone_entries(scenario)])


def _draw_fields(axes: Axes, plan: Plan, projection: Projection) -> Entries:
    """Draw the outlines of fields of view at start and goal; returns their legend entry, if there are any."""
    states = [state for state in (plan.scenario.start, plan.goal) if state is not None]
    drawn = False
    for state in states:
        for device, line in field_outlines(plan.scenario, state.attitude, state.joints):
            draw_line(axes, projection, line, {"color": device_style(device)["color"], **_FIELD})
            drawn = True
    return [(Line2D([], [], color=GREY, **_FIELD), "field of view")] if drawn else []


def draw_zones(axes: Axes, plan: Plan, projection: Projection, zones: Sequence[Cone]) -> None:
    """Draw zones with their names, the ways of those that move, and the plan's title."""
    for zone in zones:
        draw_zone(axes, projection, zone)
    for last, way in zone_ways(plan):
        look = zone_outline(last)
        draw_line(axes, projection, circle(last.axis_at(), last.half_angle), look | _FAINT)
        draw_line(axes, projection, way, {"color": look["color"], **_ZONE_WAY})
    ways, craft = boresight_ways(plan), plan.scenario.spacecraft
    drawn = [_NOTHING] if ways is None else [ways.reshape(-1, 3)]
    ends = [_NOTHING, *(mark.directions for mark in end_marks(plan))]
    name_zones(axes, projection, zones, craft.device_names, *map(np.concatenate, (drawn, ends)))
    outcome = "" if plan.ok else f": {plan.status.name}"
    plain(axes.set_title(f"{plan.scenario.name}{outcome}", fontsize=TEXT + 1, loc="left"))


def draw_line(axes: Axes, projection: Projection, line: np.ndarray, look: Look) -> list[Line2D]:
    """Draw a line (k, 3) on the sphere, in the parts into which the projection cuts it."""
    drawn = []
    for flat, alpha in projection.parts(line):
        faded = look if alpha == 1 else {**look, "alpha": alpha * look.get("alpha", 1)}
        drawn += axes.plot(*flat.T, **faded)
    return drawn


def _draw_points(axes: Axes, projection: Projection, directions: np.ndarray, look: Look) -> None:
    """Draw marks at directions (k, 3)."""
    flat, opacity = projection.project(directions), projection.opacity(directions)
    for alpha in np.unique(opacity):
        axes.plot(*flat[opacity == alpha].T, **{"alpha": alpha, **look})


def draw_ends(axes: Axes, plan: Plan, projection: Projection, **fading: float) -> Entries:
    """Mark start and goal of every device, targets and wishes; returns legend entries.

    Args:
        axes: where to.
        plan: of any status.
        projection: of the axes.
        **fading: perhaps ``alpha``, instead of the projection's opacity.
    """
    marks = end_marks(plan)
    for look, _, devices, directions in marks:
        star = look is _START  # it stands before the others
        for device, point in zip(devices, directions, strict=True):
            colour = device_style(device)["color"]
            edge = "white" if star else colour
            own = {"color": colour, "markeredgecolor": edge, "zorder": 4.2 if star else 4, **look, **fading}
            _draw_points(axes, projection, point[None], own)
    return [(Line2D([], [], color=GREY, **mark.look), mark.name) for mark in marks]


def draw_zone(axes: Axes, projection: Projection, zone: Cone) -> list[Artist]:
    """Draw a zone with its edge: hatched for keep-out, hardly filled if it binds no device."""
    axis, drawn = zone.axis_at(), list[Artist]()
    fill = _zone_fill(zone)
    limb = Circle((0, 0), 1, transform=axes.transData) if isinstance(projection, GlobeView) else None
    for across, upward, directions, strength in projection.sheets(axis, zone.half_angle):
        inside = directions @ axis - np.cos(zone.half_angle)
        if not np.any(inside > 0):
            continue
        *colour, alpha = to_rgba(fill["facecolor"])
        look: Look = {
            "colors": [(*colour, strength * alpha)],
            "hatches": [fill.get("hatch") if strength >= 1 else None],
        }
        area = axes.contourf(across, upward, inside, levels=[0, 3], zorder=1, **look)
        area.set(clip_path=limb, edgecolor=fill["edgecolor"], linewidth=0)
        drawn.append(area)
    return drawn + draw_line(axes, projection, circle(axis, zone.half_angle), zone_outline(zone) | _EDGE)


def zone_outline(zone: Cone) -> Look:
    """Colour and line of a zone's edge: dashed for keep-in, dotted for one of a group."""
    inside = isinstance(zone, KeepIn)
    style = (0, (1, 1.5)) if zone.any_of is not None else (0, (5, 2.5)) if inside else "-"
    return {"color": KEEP_IN if inside else KEEP_OUT, "linestyle": style}


def _zone_fill(zone: Cone) -> Look:
    colour = KEEP_IN if isinstance(zone, KeepIn) else KEEP_OUT
    if not _binds_devices(zone):
        return {"facecolor": to_rgba(colour, 0.03), "edgecolor": "none"}
    if isinstance(zone, KeepIn):
        return {"facecolor": to_rgba(KEEP_IN, 0.10), "edgecolor": "none"}
    return {"facecolor": to_rgba(KEEP_OUT, 0.09), "edgecolor": to_rgba(KEEP_OUT, 0.22), "hatch": "///"}


def _binds_devices(zone: Cone) -> bool:
    """True if a zone binds a device, False if it binds only other vectors."""
    return zone.binds_all or bool(zone.devices)


def name_zones(
    axes: Axes,
    projection: Projection,
    zones: Sequence[Cone],
    devices: Sequence[str] = (),
    ways: np.ndarray = _NOTHING,
    ends: np.ndarray = _NOTHING,
) -> list[Artist]:
    """Write each zone's name in it, or above or below if a boresight must stay in.

    Args:
        axes: where to.
        projection: of the axes.
        zones: that are named; few ones on the flat map with what they bind, if that is not all devices.
        devices: names of all devices.
        ways: (k, 3), what is drawn, which names should not cover.
        ends: (m, 3), starts and goals, which names cover only where there is no other place.
    """
    crowded = len(zones) > _CROWD
    marks = [(spot, np.full(2, projection.mark)) for spot in projection.project(ends)]
    labels, texts = Labels(projection.project(ways), marks), list[Artist]()
    # What is in front first, and of that the smallest, as it has the least room; of equals as they come.
    for zone in sorted(zones, key=lambda zone: (-projection.opacity(zone.axis_at()), zone.half_angle)):
        near = projection.opacity(zone.axis_at()) == 1
        told = [] if crowded or isinstance(projection, GlobeView) else [*_bound(zone, devices), *_group(zone)]
        spot = None
        for lines in ([zone.name, *told], [zone.name]):
            size = projection.letter * (max(map(len, lines)), len(lines))
            spot = labels.place(_places(projection, zone, size), size, must=lines == [zone.name])
            if spot is not None:
                break
        assert spot is not None
        text = axes.text(
            float(spot[0]),
            float(spot[1]),
            "\n".join(lines),
            color=zone_outline(zone)["color"],
            alpha=None if near else 0.5,
            fontsize=SMALL - 1.5 * crowded,
            zorder=1.8,
            **(HALO if near else {**HALO, "path_effects": []}),
        )
        texts.append(plain(text))
    return texts


def _places(projection: Projection, zone: Cone, size: np.ndarray) -> list[np.ndarray]:
    """Where in the picture a zone's name may stand; the best comes first, and the last is always there.

    That is over and under a keep-in zone, since its inside is where the ways are, and else in the zone. Of
    one that is more than half the sphere the outside is the smaller part, so its name stays inside, too.
    """
    axis, angle = zone.axis_at(), zone.half_angle
    centre, extent = projection.project(axis), projection.extent(axis, angle)
    away = extent[1] + size[1] / 2 + projection.gap
    above = [(0.0, away), (0.0, -away)] if isinstance(zone, KeepIn) and angle <= np.pi / 2 else []
    wanted = centre + np.array([*above, *(_SPOTS * extent)])
    spots = projection.fit(wanted, size)
    apart = separation(projection.directions(spots, axis), axis)
    fits = np.where(np.arange(len(spots)) < len(above), apart >= angle, apart < _INSIDE * angle)
    moved = spots[:, 1] != wanted[:, 1]  # up or down: these come last
    order = np.argsort(moved, kind="stable")
    return [*spots[order][fits[order]], *projection.fit(centre[None], size)]


def _bound(zone: Cone, names: Sequence[str]) -> list[str]:
    """Lines that say which devices and vectors a zone binds; none if these are all devices and no vector."""
    bound = [name for name in names if zone.binds_all or name in zone.devices]
    others = [name for name in names if name not in bound]
    lines = []
    if len(bound) == 1 and others:
        lines.append(f"for {bound[0]}")
    elif bound and others:
        lines.append(f"not {others[0]}" if len(others) == 1 else f"for {len(bound)} of {len(names)}")
    if zone.vectors:
        carriers = {vector.to or "the body" for vector in zone.vectors}
        whose = f"of {carriers.pop()}" if len(carriers) == 1 else f"of {len(carriers)} parts"
        count = "a vector" if len(zone.vectors) == 1 else f"{len(zone.vectors)} vectors"
        lines += [f"and {count}" if bound else f"for {count}", whose]
    return lines


def _group(zone: Cone) -> list[str]:
    """Lines that name a zone's group and its entry there; none if it is in none."""
    lines = [] if zone.any_of is None else [f"any of {zone.any_of}"]
    return lines if zone.entry is None else [*lines, f"with all of {zone.entry}"]


def zone_entries(scenario: Scenario) -> Entries:
    """Legend entries: one of each kind of zones that the scenario has."""

    def kind(zone: Cone) -> tuple[bool, bool, bool]:
        return isinstance(zone, KeepIn), not _binds_devices(zone), zone.any_of is not None

    kinds: dict[str, Entry] = {}
    for zone in sorted(zones_at(scenario, 0.0), key=kind):
        inside = isinstance(zone, KeepIn)
        text = "keep-in zone" if inside else "keep-out zone"
        text += "" if _binds_devices(zone) else ",\nfor no device"
        text += "" if zone.any_of is None else ",\nany of its group"
        edge = to_rgba(zone_outline(zone)["color"], 1.0 if inside else 0.6)
        look = {**_zone_fill(zone), "edgecolor": edge, "linestyle": zone_outline(zone)["linestyle"]}
        kinds.setdefault(text, (Patch(**look, linewidth=1), text))
    moving: Entries = [
        (Line2D([], [], color=GREY, linewidth=1.1), "way of a zone's axis,\nto its fainter edge")
    ]
    return [*kinds.values(), *moving * any(zone.moves for zone in scenario.zones)]


def zones_at(scenario: Scenario, time: float, *, moving: bool | None = None) -> list[Cone]:
    """Inertial zones at their places at a time, s: all, those that move, or those that stand still."""
    cones: tuple[Cone, ...] = (*scenario.keep_out, *scenario.keep_in)
    wanted = [zone for zone in cones if zone.is_inertial and moving in (None, zone.moves)]
    return [replace(zone, direction=zone.axis_at(time)) for zone in wanted]


def zone_ways(plan: Plan) -> list[tuple[Cone, np.ndarray]]:
    """Moving zones at their last places, with the ways of their axes (k, 3).

    The last instant is that of the goal; of a plan without one, the last that is known.
    """
    ways: list[tuple[Cone, np.ndarray]] = []
    zones: tuple[Cone, ...] = (*plan.scenario.keep_out, *plan.scenario.keep_in)
    for zone in zones:
        path = zone.path
        if path is not None and path.moves:
            last = float(path.times[-1]) if plan.goal is None else plan.goal.time
            there = replace(zone, direction=zone.axis_at(last))
            ways.append((there, path.at(np.linspace(0.0, last, _WAY))))
    return ways


def boresight_ways(plan: Plan) -> np.ndarray | None:
    """Boresights (k, D, 3) along the trajectory, or along the path without one; None without a path."""
    if plan.trajectory is not None:
        return motion(plan).boresights
    return None if plan.path is None else path_boresights(plan.path, plan.scenario.spacecraft)


def path_boresights(path: Path, craft: Spacecraft, points_an_edge: int = 24) -> np.ndarray:
    """Boresights (k, D, 3) along a path: geodesics of the platform with linear joints."""
    attitudes, joints, edges = path.attitudes, path.joints, path.edges
    if edges:
        places = np.linspace(0, edges, points_an_edge * edges + 1)
        edge = np.minimum(places.astype(int), edges - 1)
        part = places - edge
        attitudes = so3.geodesic(attitudes[edge], attitudes[edge + 1], part)
        joints = joints[edge] + part[:, None] * (joints[edge + 1] - joints[edge])
    return np.asarray(craft.boresights(attitudes, joints))


class Marks(NamedTuple):
    """Directions (k, 3) of some devices, by number, that have one mark with one name in the legend."""

    look: Look
    name: str
    devices: Sequence[int]
    directions: np.ndarray


def end_marks(plan: Plan) -> list[Marks]:
    """Where devices start and end, and where they shall point, as far as the plan knows.

    Targets are marked where no goal was found, and of a goal that has them by names of devices, since not
    every device has one then. They and wishes are where they are at the goal.
    """
    scenario, goal = plan.scenario, plan.scenario.goal
    craft = scenario.spacecraft
    every = range(len(craft.device_names))
    marks = [Marks(_START, "start", every, _given(scenario, scenario.start))]
    if plan.goal is not None:
        points = craft.boresights(plan.goal.attitude, plan.goal.joints)
        marks.append(Marks(_END, "goal", every, np.asarray(points)))
    elif isinstance(goal, GivenState):
        marks.append(Marks(_END, "goal", every, _given(scenario, goal)))
    if not isinstance(goal, GivenState):
        then = 0.0 if plan.goal is None else plan.goal.time
        if plan.goal is None or goal.devices:
            targets = np.array([path.at(then) for path in goal.paths])
            marks.append(Marks(_TARGET, "target", goal.numbers(craft), targets))
        wishing = [craft.device_names.index(wish.device) for wish in goal.prefer]
        wishes = np.array([as_path(wish.direction).at(then) for wish in goal.prefer])
        marks.append(Marks(_WISH, "wish", wishing, wishes))
    return [mark for mark in marks if len(mark.directions)]


def _given(scenario: Scenario, state: GivenState) -> np.ndarray:
    return np.asarray(scenario.spacecraft.boresights(state.attitude, state.joints))
