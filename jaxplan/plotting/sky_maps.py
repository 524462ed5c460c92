"""The two maps of the sphere of directions, unfolded and as a globe.

The unfolded sphere with the zones and the ways of all boresights (Figures 7 and 12).

The sphere of directions in space, with zones and boresights on it.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, PathPatch, Rectangle
from matplotlib.path import Path as Shape
from matplotlib.patheffects import withStroke

from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.plotting import projections
from jaxplan.plotting.projections import PALE, View, circle, insides
from jaxplan.plotting.sky_marks import (
    NODE,
    ZONE_WAY,
    boresight_ways,
    end_marks,
    end_style,
    name_zones,
    zone_entries,
    zone_fill,
    zone_outline,
    zone_ways,
    zones_at,
)
from jaxplan.plotting.style import (
    GREY,
    SMALL,
    TEXT,
    Canvas,
    Entries,
    Labels,
    Look,
    device_entries,
    device_style,
    expect_plan,
    expect_view,
    legend_beside,
    note,
    panels,
    plain,
    tidy,
)

if TYPE_CHECKING:
    from jaxplan.planner import Plan


SPHERE_SIZE = (11.0, 4.9)  # inches
_FAINT: Look = {"linewidth": 0.9, "alpha": 0.55, "zorder": 1.6}


def sphere(plan: "Plan", ax: Canvas = None, *, legend: bool = True) -> Axes:
    """The zones and the way of every device's boresight on the unfolded sphere.

    Keep-out zones are hatched with a solid outline, keep-in zones have a dashed one, or a dotted one if they
    are of a group of which any one holds; the small print under a zone's name says which devices it binds if
    not all, and its group. One that moves is drawn where it is at first, with the way of its axis and,
    fainter, its edge at last. A plan that failed is drawn as far as it came: the path instead of the
    trajectory, start and goal without a path, and the targets where no goal was found.

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
    scenario = plan.scenario
    for zone in zones_at(scenario, 0.0):
        _unfold_zone(axes, zone)
    for last, way in zone_ways(plan):
        look = zone_outline(last)
        axes.plot(*projections.outline(last.axis_at(), last.half_angle).T, **look, **_FAINT)
        axes.plot(*projections.cut(projections.unfold(way)).T, color=look["color"], **ZONE_WAY)
    outlines = len(axes.lines)
    marks = [*_unfold_ways(axes, plan), *_unfold_ends(axes, plan)]
    drawn = [np.zeros((0, 2)), *(line.get_xydata() for line in axes.lines[outlines:])]
    ends = [np.zeros((0, 2)), *(projections.unfold(directions) for _, _, directions in end_marks(plan))]
    name_zones(axes, scenario, np.concatenate(drawn), np.concatenate(ends))
    _map_frame(axes, plan)
    if not scenario.spacecraft.device_names:
        note(axes, "no devices")
    if legend:
        entries = [*device_entries(scenario.spacecraft.device_names), *marks, *zone_entries(scenario)]
        legend_beside(axes, entries)
    return axes


def _unfold_zone(axes: Axes, zone: KeepOut | KeepIn) -> None:
    rings = projections.region(zone.axis_at(), zone.half_angle)
    shape = Shape.make_compound_path(
        *(Shape(np.concatenate([ring, ring[:1]]), closed=True) for ring in rings)
    )
    axes.add_artist(PathPatch(shape, **zone_fill(zone), zorder=1, linewidth=0))  # add_patch would be slow
    line = projections.outline(zone.axis_at(), zone.half_angle)
    axes.plot(*line.T, **zone_outline(zone), linewidth=1.1, zorder=1.6)


def _unfold_ways(axes: Axes, plan: "Plan") -> Entries:
    """The trajectory, or the path if there is none, and the path's nodes."""
    ways = boresight_ways(plan)
    if ways is None:
        return []
    for device, way in enumerate(np.moveaxis(ways, 1, 0)):
        axes.plot(
            *projections.cut(projections.unfold(way)).T, linewidth=1.8, zorder=3, **device_style(device)
        )
    if plan.path is None or not plan.scenario.spacecraft.device_names:
        return []
    nodes = plan.scenario.spacecraft.boresights(plan.path.attitudes, plan.path.joints)
    for device, points in enumerate(np.moveaxis(projections.unfold(nodes), 1, 0)):
        axes.plot(*points.T, color=device_style(device)["color"], zorder=3.2, **NODE)
    return [(Line2D([], [], color=GREY, **NODE), "node of the path")]


def _unfold_ends(axes: Axes, plan: "Plan") -> Entries:
    """A star at the start and a square at the goal of every device; a cross at its target without a goal."""
    ends = end_marks(plan)
    for look, _, directions in ends:
        for device, point in enumerate(projections.unfold(directions)):
            axes.plot(*point, **end_style(look, device))
    return [(Line2D([], [], color=GREY, **look), name) for look, name, _ in ends]


def _map_frame(axes: Axes, plan: "Plan") -> None:
    tidy(axes)
    axes.spines[["top", "right"]].set_visible(True)
    # A strip around the map, so that a mark at a pole or at the meridian is whole.
    axes.set(xlim=(-186, 186), ylim=(-96, 96))
    axes.patch.set_facecolor("0.94")
    axes.add_artist(Rectangle((-180, -90), 360, 180, facecolor="white", edgecolor="0.6", zorder=0.5))
    axes.set_xticks(range(-180, 181, 60))
    axes.set_yticks(range(-90, 91, 30))
    axes.set_xlabel("inertial azimuth (deg)", fontsize=TEXT)
    axes.set_ylabel("inertial elevation (deg)", fontsize=TEXT)
    outcome = "" if plan.ok else f": {plan.status.name}"
    plain(axes.set_title(f"{plan.scenario.name}{outcome}", fontsize=TEXT + 1, loc="left"))


GLOBE_SIZE = (8.2, 6.4)  # inches
_LETTER, _LINE = 0.032, 0.07  # radii that a letter of a name is wide and a line high
_NOTHING = np.zeros((0, 2))
_HALO = [withStroke(linewidth=2.5, foreground="white")]


def globe(
    plan: "Plan",
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
    draw_sphere(axes, plan, seen, zones_at(plan.scenario, 0.0))
    entries = [*device_entries(plan.scenario.spacecraft.device_names), *_draw_ways(axes, plan, seen)]
    if legend:
        legend_beside(axes, [*entries, *zone_entries(plan.scenario)])
    return axes


def view_of(plan: "Plan", angles: tuple[float, float] | None) -> View:
    """The view that was asked for, deg, or the one with most of the ways in front."""
    if angles is not None:
        expect_view(angles)
        return View.from_angles(*np.deg2rad(angles))
    ways = boresight_ways(plan)
    ends = [directions for _, _, directions in end_marks(plan)]
    points = ends if ways is None else [ways.reshape(-1, 3)]
    return View.facing(np.concatenate([np.zeros((1, 3)), *points]))  # there may be no devices


def draw_sphere(axes: Axes, plan: "Plan", view: View, zones: Sequence[KeepOut | KeepIn]) -> None:
    """The empty globe with some zones, their names, the ways of zones that move, and the title."""
    axes.set_aspect("equal")
    axes.set(xlim=(-1.06, 1.06), ylim=(-1.06, 1.06))
    axes.set_axis_off()
    axes.add_artist(Circle((0, 0), 1, facecolor="white", edgecolor="0.6", linewidth=1, zorder=0.5))
    poles = np.array([0.0, 0.0, 1.0])
    meridians = [
        circle(np.array([np.cos(a), np.sin(a), 0.0]), np.pi / 2) for a in np.deg2rad(range(0, 180, 30))
    ]
    for line in [*meridians, *circle(poles, np.deg2rad(range(30, 180, 30)))]:
        draw_line(axes, view, line, {"color": "0.85", "linewidth": 0.5, "zorder": 0.7})
    for last, way in zone_ways(plan):
        edge: Look = zone_outline(last) | {"linewidth": 0.6, "zorder": 1.6}
        draw_line(axes, view, circle(last.axis_at(), last.half_angle), edge)
        draw_line(axes, view, way, {"color": edge["color"], **ZONE_WAY})
    ways = boresight_ways(plan)
    draw_zones(axes, view, zones, _NOTHING if ways is None else view.project(ways.reshape(-1, 3)))
    outcome = "" if plan.ok else f": {plan.status.name}"
    plain(axes.set_title(f"{plan.scenario.name}{outcome}", fontsize=TEXT + 1, loc="left"))
    eye = np.rad2deg([np.arctan2(*view.axes[2, 1::-1]), np.arcsin(view.axes[2, 2])])
    text = f"seen from azimuth {eye[0]:.0f}, elevation {eye[1]:.0f} deg (inertial); grid of 30 deg"
    axes.text(0, -1.1, text, fontsize=SMALL, color=GREY, ha="center", va="top")


def draw_zones(
    axes: Axes, view: View, zones: Sequence[KeepOut | KeepIn], ways: np.ndarray = _NOTHING
) -> list[Artist]:
    """Zones at rest with their names, which should not cover ways (k, 2); returns all that was drawn."""
    drawn = [artist for zone in zones for artist in _draw_zone(axes, view, zone)]
    return [*drawn, *_name_zones(axes, view, zones, ways)]


def draw_line(axes: Axes, view: View, line: np.ndarray, look: Look) -> list[Line2D]:
    """A line on the sphere, pale on the far side: its front and its back."""
    near, far = view.sides(line)
    return [axes.plot(*near.T, **look)[0], axes.plot(*far.T, **look, alpha=PALE)[0]]


def _draw_zone(axes: Axes, view: View, zone: KeepOut | KeepIn) -> list[Artist]:
    right, up, inside = insides(view, zone.axis_at(), zone.half_angle)
    fill = zone_fill(zone)
    colour, hatch = to_rgba(fill["facecolor"]), fill.get("hatch")
    limb = Circle((0, 0), 1, transform=axes.transData)
    areas: list[Artist] = []
    for values, share in zip(inside, (1.3, PALE), strict=True):
        look: Look = {"colors": [(*colour[:3], share * colour[3])], "hatches": [hatch if share > 1 else None]}
        if np.any(values > 0):
            area = axes.contourf(right, up, values, levels=[0, 3], zorder=1, **look)
            area.set(clip_path=limb, edgecolor=fill["edgecolor"], linewidth=0)
            areas.append(area)
    edge: Look = zone_outline(zone) | {"linewidth": 1.1, "zorder": 1.6}
    return [*areas, *draw_line(axes, view, circle(zone.axis_at(), zone.half_angle), edge)]


def _name_zones(axes: Axes, view: View, zones: Sequence[KeepOut | KeepIn], ways: np.ndarray) -> list[Artist]:
    """Each zone's name in it, or above or below if a boresight must stay in; pale on the far side."""
    labels = Labels(ways)
    texts: list[Artist] = []
    # Those in front first, and of them the smallest, as they have the least room.
    for zone in sorted(zones, key=lambda zone: (view.depth(zone.axis_at()) < 0, zone.half_angle)):
        centre = view.project(zone.axis_at())
        near = view.depth(zone.axis_at()) >= 0
        size = np.array([_LETTER * len(zone.name), _LINE])
        spots = centre + np.array(_name_spots(zone, size))
        places = [spot for spot in spots if np.hypot(*spot) < 1]
        spot = labels.place([*places, centre], size, must=True)
        assert spot is not None
        text = axes.text(
            float(spot[0]),
            float(spot[1]),
            zone.name,
            color=zone_outline(zone)["color"],
            alpha=1.0 if near else 0.5,
            fontsize=SMALL,
            ha="center",
            va="center",
            zorder=1.8,
            path_effects=_HALO if near else [],
        )
        texts.append(plain(text))
    return texts


def _name_spots(zone: KeepOut | KeepIn, size: np.ndarray) -> list[tuple[float, float]]:
    """Where a zone's name may stand, from its centre in the picture; the best comes first."""
    away = float(np.sin(min(zone.half_angle, np.pi / 2)))
    if isinstance(zone, KeepIn):
        beside = away + size[1] / 2 + 0.02
        return [(0.0, beside), (0.0, -beside)]
    steps = (0.0, 0.3, -0.3, 0.6, -0.6, 0.85, -0.85)
    return [(away * across, away * up) for across in (0.0, 0.3, -0.3, 0.6, -0.6) for up in steps]


def _draw_ways(axes: Axes, plan: "Plan", view: View) -> Entries:
    ways, names = boresight_ways(plan), plan.scenario.spacecraft.device_names
    entries: Entries = []
    if ways is not None:
        for device, way in enumerate(np.moveaxis(ways, 1, 0)):
            draw_line(axes, view, way, {"linewidth": 1.8, "zorder": 3, **device_style(device)})
    if plan.path is not None and names:
        nodes = plan.scenario.spacecraft.boresights(plan.path.attitudes, plan.path.joints)
        for device, points in enumerate(np.moveaxis(nodes, 1, 0)):
            near, look = view.depth(points) >= 0, {"color": device_style(device)["color"], **NODE}
            axes.plot(*view.project(points[near]).T, zorder=3.2, **look)
            axes.plot(*view.project(points[~near]).T, zorder=3.2, alpha=PALE, **look)
        entries.append((Line2D([], [], color=GREY, **NODE), "node of the path"))
    for look, name, directions in end_marks(plan):
        for device, point in enumerate(directions):
            alpha = 1.0 if view.depth(point) >= 0 else PALE
            axes.plot(*view.project(point), **end_style(look, device), alpha=alpha)
        entries.append((Line2D([], [], color=GREY, **look), name))
    return entries
