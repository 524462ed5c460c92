"""The unfolded sphere with the zones and the ways of all boresights (Figures 7 and 12)."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Shape
from matplotlib.patheffects import withStroke

from jaxplan.plotting import samples, unfolded
from jaxplan.plotting.canvas import Canvas, panels
from jaxplan.plotting.style import (
    GREY,
    KEEP_IN,
    KEEP_OUT,
    SMALL,
    TEXT,
    Entries,
    Look,
    device_entries,
    device_style,
    legend_beside,
    plain,
    tidy,
)
from jaxplan.scenario import GivenState
from jaxplan.zones import KeepIn, KeepOut

if TYPE_CHECKING:
    from jaxplan.planner import Plan
    from jaxplan.scenario import Scenario

SIZE = (11.0, 4.9)  # inches

_CROWD = 20  # zones, beyond which their names get smaller and go without the devices they bind

_START: Look = {"marker": "*", "markersize": 14, "linestyle": "none", "markeredgewidth": 0.7}
_END: Look = {"marker": "s", "markersize": 8, "linestyle": "none", "markeredgewidth": 0.7}
_TARGET: Look = {"marker": "x", "markersize": 8, "linestyle": "none", "markeredgewidth": 2}
_NODE: Look = {"marker": ".", "markersize": 4.5, "linestyle": "none"}
_HALO = [withStroke(linewidth=2.5, foreground="white")]


def sphere(plan: "Plan", ax: Canvas = None, *, legend: bool = True) -> Axes:
    """The zones and the way of every device's boresight on the unfolded sphere.

    Keep-out zones are hatched with a solid outline, keep-in zones have a dashed one; the small print under a
    zone's name says which devices it binds if not all. A plan that failed is drawn as far as it came: the
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
    _name_zones(axes, scenario)
    marks = [*_draw_ways(axes, plan), *_draw_ends(axes, plan)]
    _frame(axes, plan)
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
    keep_in = isinstance(zone, KeepIn)
    line = unfolded.outline(zone.direction, zone.half_angle)
    colour, dashes = (KEEP_IN, (0, (5, 2.5))) if keep_in else (KEEP_OUT, "-")
    axes.plot(*line.T, color=colour, linestyle=dashes, linewidth=1.1, zorder=1.6)


def _fill(zone: KeepOut | KeepIn) -> Look:
    if isinstance(zone, KeepIn):
        return {"facecolor": to_rgba(KEEP_IN, 0.10), "edgecolor": "none"}
    return {"facecolor": to_rgba(KEEP_OUT, 0.09), "edgecolor": to_rgba(KEEP_OUT, 0.22), "hatch": "///"}


def _name_zones(axes: Axes, scenario: "Scenario") -> None:
    """Write each zone's name in it, or above it if a boresight must stay in, where no other name stands."""
    zones = _zones(scenario)
    crowded = len(zones) > _CROWD
    taken: list[tuple[float, float]] = []
    for zone in zones:
        lines = [zone.name] if crowded else [zone.name, *_bound_devices(zone, scenario)]
        azimuth, elevation = unfolded.unfold(zone.direction)
        room = 178 - 1.5 * max(len(line) for line in lines)  # a letter is about 3 deg wide
        across = float(np.clip(azimuth, -max(room, 0), max(room, 0)))
        places = [float(elevation + offset) for offset in _name_offsets(zone)]
        places = [place for place in places if abs(place) < 84] or [float(np.clip(elevation, -83, 83))]
        free = [place for place in places if not _near((across, place), taken)]
        spot = (across, (free or places)[0])
        taken.append(spot)
        label = axes.text(
            *spot,
            "\n".join(lines),
            color=KEEP_IN if isinstance(zone, KeepIn) else KEEP_OUT,
            fontsize=SMALL - 1.5 * crowded,
            ha="center",
            va="center",
            zorder=1.8,
            path_effects=_HALO,
        )
        plain(label)


def _name_offsets(zone: KeepOut | KeepIn) -> tuple[float, ...]:
    """Elevations of places for a zone's name, from that of its axis, deg; the best comes first."""
    size = float(np.rad2deg(zone.half_angle))
    inside = (0.0, 0.5 * size, -0.5 * size, 0.8 * size, -0.8 * size)
    return (size + 6, -size - 6, *inside) if isinstance(zone, KeepIn) else inside


def _near(spot: tuple[float, float], others: list[tuple[float, float]]) -> bool:
    """Whether a name would run into one of some others, which are about 20 by 7 deg large."""
    return any(abs(spot[0] - other[0]) < 20 and abs(spot[1] - other[1]) < 7 for other in others)


def _bound_devices(zone: KeepOut | KeepIn, scenario: "Scenario") -> list[str]:
    """A line that says in few words which devices a zone binds; none if it binds all."""
    names = scenario.spacecraft.device_names
    bound = [name for name in names if not zone.devices or name in zone.devices]
    others = [name for name in names if name not in bound]
    if not others:
        return []
    if len(bound) == 1:
        return [f"for {bound[0]}"]
    return [f"not {others[0]}"] if len(others) == 1 else [f"for {len(bound)} of {len(names)}"]


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
    if plan.path is None:
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
            edge = colour if look is _TARGET else "white"
            above = 4.2 if look is _START else 4  # a star shows on a square, but not the other way round
            axes.plot(*point, color=colour, markeredgecolor=edge, zorder=above, clip_on=False, **look)
    return [(Line2D([], [], color=GREY, **look), name) for look, name, _ in ends]


def _given(scenario: "Scenario", state: GivenState) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_rotvec(state.rotation_vector).as_matrix()
    return samples.boresights(scenario.spacecraft, attitude, np.asarray(state.joints))


def _frame(axes: Axes, plan: "Plan") -> None:
    tidy(axes)
    axes.spines[["top", "right"]].set_visible(True)
    axes.set(xlim=(-180, 180), ylim=(-90, 90))
    axes.set_xticks(range(-180, 181, 60))
    axes.set_yticks(range(-90, 91, 30))
    axes.set_xlabel("inertial azimuth (deg)", fontsize=TEXT)
    axes.set_ylabel("inertial elevation (deg)", fontsize=TEXT)
    outcome = "" if plan.ok else f": {plan.status.name}"
    plain(axes.set_title(f"{plan.scenario.name}{outcome}", fontsize=TEXT + 1, loc="left"))


def _zone_entries(scenario: "Scenario") -> Entries:
    entries: Entries = []
    if scenario.keep_out:
        patch = Patch(**{**_fill(scenario.keep_out[0]), "edgecolor": to_rgba(KEEP_OUT, 0.6)}, linewidth=1)
        entries.append((patch, "keep-out zone"))
    if scenario.keep_in:
        look = {**_fill(scenario.keep_in[0]), "edgecolor": KEEP_IN}
        entries.append((Patch(**look, linewidth=1, linestyle="--"), "keep-in zone"))
    return entries
