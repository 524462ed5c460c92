"""The unfolded sphere with the zones and the ways of all boresights (Figures 7 and 12)."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Shape

from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.plotting import unfolded
from jaxplan.plotting.canvas import Canvas, panels
from jaxplan.plotting.given import expect_plan
from jaxplan.plotting.marks import (
    NODE,
    ZONE_WAY,
    boresight_ways,
    end_marks,
    end_style,
    zone_entries,
    zone_fill,
    zone_outline,
    zone_ways,
    zones_at,
)
from jaxplan.plotting.style import (
    GREY,
    TEXT,
    Entries,
    Look,
    device_entries,
    device_style,
    legend_beside,
    note,
    plain,
    tidy,
)
from jaxplan.plotting.zone_names import name_zones

if TYPE_CHECKING:
    from jaxplan.planner import Plan

SIZE = (11.0, 4.9)  # inches
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
    (axes,) = panels(ax, 1, SIZE)
    scenario = plan.scenario
    for zone in zones_at(scenario, 0.0):
        _draw_zone(axes, zone)
    for last, way in zone_ways(plan):
        look = zone_outline(last)
        axes.plot(*unfolded.outline(last.axis_at(), last.half_angle).T, **look, **_FAINT)
        axes.plot(*unfolded.cut(unfolded.unfold(way)).T, color=look["color"], **ZONE_WAY)
    outlines = len(axes.lines)
    marks = [*_draw_ways(axes, plan), *_draw_ends(axes, plan)]
    drawn = [np.zeros((0, 2)), *(line.get_xydata() for line in axes.lines[outlines:])]
    ends = [np.zeros((0, 2)), *(unfolded.unfold(directions) for _, _, directions in end_marks(plan))]
    name_zones(axes, scenario, np.concatenate(drawn), np.concatenate(ends))
    _frame(axes, plan)
    if not scenario.spacecraft.device_names:
        note(axes, "no devices")
    if legend:
        entries = [*device_entries(scenario.spacecraft.device_names), *marks, *zone_entries(scenario)]
        legend_beside(axes, entries)
    return axes


def _draw_zone(axes: Axes, zone: KeepOut | KeepIn) -> None:
    rings = unfolded.region(zone.axis_at(), zone.half_angle)
    shape = Shape.make_compound_path(
        *(Shape(np.concatenate([ring, ring[:1]]), closed=True) for ring in rings)
    )
    axes.add_artist(PathPatch(shape, **zone_fill(zone), zorder=1, linewidth=0))  # add_patch would be slow
    line = unfolded.outline(zone.axis_at(), zone.half_angle)
    axes.plot(*line.T, **zone_outline(zone), linewidth=1.1, zorder=1.6)


def _draw_ways(axes: Axes, plan: "Plan") -> Entries:
    """The trajectory, or the path if there is none, and the path's nodes."""
    ways = boresight_ways(plan)
    if ways is None:
        return []
    for device, way in enumerate(np.moveaxis(ways, 1, 0)):
        axes.plot(*unfolded.cut(unfolded.unfold(way)).T, linewidth=1.8, zorder=3, **device_style(device))
    if plan.path is None or not plan.scenario.spacecraft.device_names:
        return []
    nodes = plan.scenario.spacecraft.boresights(plan.path.attitudes, plan.path.joints)
    for device, points in enumerate(np.moveaxis(unfolded.unfold(nodes), 1, 0)):
        axes.plot(*points.T, color=device_style(device)["color"], zorder=3.2, **NODE)
    return [(Line2D([], [], color=GREY, **NODE), "node of the path")]


def _draw_ends(axes: Axes, plan: "Plan") -> Entries:
    """A star at the start and a square at the goal of every device; a cross at its target without a goal."""
    ends = end_marks(plan)
    for look, _, directions in ends:
        for device, point in enumerate(unfolded.unfold(directions)):
            axes.plot(*point, **end_style(look, device))
    return [(Line2D([], [], color=GREY, **look), name) for look, name, _ in ends]


def _frame(axes: Axes, plan: "Plan") -> None:
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
