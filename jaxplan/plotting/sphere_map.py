"""The unfolded sphere with the zones and the ways of all boresights (Figures 7 and 12)."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Rectangle
from matplotlib.path import Path as Shape

from jaxplan.plotting import samples, unfolded
from jaxplan.plotting.canvas import Canvas, panels
from jaxplan.plotting.style import (
    GREY,
    KEEP_IN,
    KEEP_OUT,
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
from jaxplan.scenario import GivenState
from jaxplan.zones import KeepIn, KeepOut

if TYPE_CHECKING:
    from jaxplan.planner import Plan
    from jaxplan.scenario import Scenario

SIZE = (11.0, 4.9)  # inches

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
_NODE: Look = {"marker": ".", "markersize": 4.5, "linestyle": "none"}


def sphere(plan: "Plan", ax: Canvas = None, *, legend: bool = True) -> Axes:
    """The zones and the way of every device's boresight on the unfolded sphere.

    Keep-out zones are hatched with a solid outline, keep-in zones have a dashed one, or a dotted one if they
    are of a group of which any one holds; the small print under a zone's name says which devices it binds if
    not all, and its group. A plan that failed is drawn as far as it came: the
    path instead of the trajectory, start and goal without a path, and the targets where no goal was found.

    Args:
        plan: of any status.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name devices and marks beside the map.

    Returns:
        The axes: inertial azimuth against elevation, deg.

    Raises:
        ValueError: if more than one axes is given.
    """
    (axes,) = panels(ax, 1, SIZE)
    scenario = plan.scenario
    for zone in _zones(scenario):
        _draw_zone(axes, zone)
    outlines = len(axes.lines)
    marks = [*_draw_ways(axes, plan), *_draw_ends(axes, plan)]
    drawn = [np.zeros((0, 2)), *(line.get_xydata() for line in axes.lines[outlines:])]
    name_zones(axes, scenario, np.concatenate(drawn))
    _frame(axes, plan)
    if not scenario.spacecraft.device_names:
        note(axes, "no devices")
    if legend:
        entries = [*device_entries(scenario.spacecraft.device_names), *marks, *_zone_entries(scenario)]
        legend_beside(axes, entries)
    return axes


def _zones(scenario: "Scenario") -> list[KeepOut | KeepIn]:
    return [*scenario.keep_out, *scenario.keep_in]


def _draw_zone(axes: Axes, zone: KeepOut | KeepIn) -> None:
    rings = unfolded.region(zone.direction, zone.half_angle)
    shape = Shape.make_compound_path(
        *(Shape(np.concatenate([ring, ring[:1]]), closed=True) for ring in rings)
    )
    axes.add_artist(PathPatch(shape, **_fill(zone), zorder=1, linewidth=0))  # add_patch would be slow
    line = unfolded.outline(zone.direction, zone.half_angle)
    axes.plot(*line.T, **_outline(zone), linewidth=1.1, zorder=1.6)


def _outline(zone: KeepOut | KeepIn) -> Look:
    if isinstance(zone, KeepIn):
        return {"color": KEEP_IN, "linestyle": (0, (5, 2.5)) if zone.any_of is None else (0, (1, 1.5))}
    return {"color": KEEP_OUT, "linestyle": "-"}


def _fill(zone: KeepOut | KeepIn) -> Look:
    if isinstance(zone, KeepIn):
        return {"facecolor": to_rgba(KEEP_IN, 0.10), "edgecolor": "none"}
    return {"facecolor": to_rgba(KEEP_OUT, 0.09), "edgecolor": to_rgba(KEEP_OUT, 0.22), "hatch": "///"}


def _draw_ways(axes: Axes, plan: "Plan") -> Entries:
    """The trajectory, or the path if there is none, and the path's nodes."""
    if plan.trajectory is not None:
        ways = samples.motion(plan).boresights
    elif plan.path is not None:
        ways = samples.path_boresights(plan)
    else:
        return []
    for device, way in enumerate(np.moveaxis(ways, 1, 0)):
        axes.plot(*unfolded.cut(unfolded.unfold(way)).T, linewidth=1.8, zorder=3, **device_style(device))
    if plan.path is None or not plan.scenario.spacecraft.device_names:
        return []
    nodes = samples.boresights(plan.scenario.spacecraft, plan.path.attitudes, plan.path.joints)
    for device, points in enumerate(np.moveaxis(unfolded.unfold(nodes), 1, 0)):
        axes.plot(*points.T, color=device_style(device)["color"], zorder=3.2, **_NODE)
    return [(Line2D([], [], color=GREY, **_NODE), "node of the path")]


def _draw_ends(axes: Axes, plan: "Plan") -> Entries:
    """A star at the start and a square at the goal of every device; a cross at its target without a goal."""
    goal = plan.scenario.goal
    ends = [(_START, "start", _given(plan.scenario, plan.scenario.start))]
    if plan.goal is not None:
        points = samples.boresights(plan.scenario.spacecraft, plan.goal.attitude, plan.goal.joints)
        ends.append((_END, "goal", points))
    elif isinstance(goal, GivenState):
        ends.append((_END, "goal", _given(plan.scenario, goal)))
    else:
        ends.append((_TARGET, "target", goal.directions))
    ends = [end for end in ends if len(end[2])]
    for look, _, directions in ends:
        for device, point in enumerate(unfolded.unfold(directions)):
            colour = device_style(device)["color"]
            edge = "white" if look is _START else colour
            axes.plot(*point, color=colour, markeredgecolor=edge, zorder=4.2 if look is _START else 4, **look)
    return [(Line2D([], [], color=GREY, **look), name) for look, name, _ in ends]


def _given(scenario: "Scenario", state: GivenState) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_rotvec(state.rotation_vector).as_matrix()
    return samples.boresights(scenario.spacecraft, attitude, np.asarray(state.joints))


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


def _zone_entries(scenario: "Scenario") -> Entries:
    """One of each kind of zones that the scenario has."""
    alone = [zone for zone in scenario.keep_in if zone.any_of is None]
    grouped = [zone for zone in scenario.keep_in if zone.any_of is not None]
    entries: Entries = []
    if scenario.keep_out:
        patch = Patch(**{**_fill(scenario.keep_out[0]), "edgecolor": to_rgba(KEEP_OUT, 0.6)}, linewidth=1)
        entries.append((patch, "keep-out zone"))
    for zones, text in ((alone, "keep-in zone"), (grouped, "keep-in zone,\nany of its group")):
        if zones:
            look = {**_fill(zones[0]), "edgecolor": KEEP_IN, "linestyle": _outline(zones[0])["linestyle"]}
            entries.append((Patch(**look, linewidth=1), text))
    return entries
