"""What is drawn on the sphere of directions: zones with their names, ways and ends of boresights.

What all views of the sphere share: looks of zones, starts and goals, and the ways of the boresights.

Names of the zones on the unfolded sphere, each where it covers no other name and little of the ways.
"""

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from jaxplan.geometry.vectors import pointing, separation
from jaxplan.model.scenario import GivenState
from jaxplan.model.zones import KeepIn, KeepOut, binds_all
from jaxplan.plotting import projections, samples
from jaxplan.plotting.style import GREY, KEEP_IN, KEEP_OUT, SMALL, Entries, Labels, Look, device_style, plain

if TYPE_CHECKING:
    from jaxplan.model.scenario import Scenario
    from jaxplan.planner import Plan


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
ZONE_WAY: Look = {"linewidth": 1.1, "zorder": 1.7}
_WAY = 33  # points of it
NODE: Look = {"marker": ".", "markersize": 4.5, "linestyle": "none"}


def zone_outline(zone: KeepOut | KeepIn) -> Look:
    """Colour and line of a zone's edge: dashed for keep-in, dotted for one of a group."""
    inside = isinstance(zone, KeepIn)
    alone = (0, (5, 2.5)) if inside else "-"
    return {
        "color": KEEP_IN if inside else KEEP_OUT,
        "linestyle": alone if zone.any_of is None else (0, (1, 1.5)),
    }


def zone_fill(zone: KeepOut | KeepIn) -> Look:
    """How a zone is filled: hatched for keep-out; hardly where no way that is drawn is bound by it."""
    colour = KEEP_IN if isinstance(zone, KeepIn) else KEEP_OUT
    if not binds_devices(zone):
        return {"facecolor": to_rgba(colour, 0.03), "edgecolor": "none"}
    if isinstance(zone, KeepIn):
        return {"facecolor": to_rgba(KEEP_IN, 0.10), "edgecolor": "none"}
    return {"facecolor": to_rgba(KEEP_OUT, 0.09), "edgecolor": to_rgba(KEEP_OUT, 0.22), "hatch": "///"}


def binds_devices(zone: KeepOut | KeepIn) -> bool:
    """Whether a zone binds any device, and not further vectors alone."""
    return binds_all(zone) or bool(zone.devices)


def zones_at(scenario: "Scenario", time: float, *, moving: bool | None = None) -> list[KeepOut | KeepIn]:
    """Zones that have a place on the sky, where they are at a time, s: all, those that move, or the rest."""
    cones: tuple[KeepOut | KeepIn, ...] = (*scenario.keep_out, *scenario.keep_in)
    wanted = [zone for zone in cones if zone.is_inertial and moving in (None, zone.moves)]
    return [replace(zone, direction=zone.axis_at(time)) for zone in wanted]


def zone_ways(plan: "Plan") -> list[tuple[KeepOut | KeepIn, np.ndarray]]:
    """Zones that move where they are at last, and the ways of their axes (k, 3).

    The last instant is that of the goal; of a plan without one, the last that is known.
    """
    ways: list[tuple[KeepOut | KeepIn, np.ndarray]] = []
    zones: tuple[KeepOut | KeepIn, ...] = (*plan.scenario.keep_out, *plan.scenario.keep_in)
    for zone in zones:
        path = zone.path
        if path is not None and path.moves:
            last = float(path.times[-1]) if plan.goal is None else plan.goal.time
            there = replace(zone, direction=zone.axis_at(last))
            ways.append((there, path.at(np.linspace(0.0, last, _WAY))))
    return ways


def boresight_ways(plan: "Plan") -> np.ndarray | None:
    """(k, D, 3) along the trajectory, or along the path if there is none; None without a path."""
    if plan.trajectory is not None:
        return samples.motion(plan).boresights
    return None if plan.path is None else samples.path_boresights(plan)


def end_marks(plan: "Plan") -> list[tuple[Look, str, np.ndarray]]:
    """Where devices start, and where they must end, as far as the plan knows.

    Returns:
        Of start, goal or target, those that there are: mark, name, (D, 3) directions, one a device.
    """
    goal = plan.scenario.goal
    ends = [(_START, "start", _given(plan.scenario, plan.scenario.start))]
    if plan.goal is not None:
        points = plan.scenario.spacecraft.boresights(plan.goal.attitude, plan.goal.joints)
        ends.append((_END, "goal", points))
    elif isinstance(goal, GivenState):
        ends.append((_END, "goal", _given(plan.scenario, goal)))
    else:
        ends.append((_TARGET, "target", goal.at(0.0).directions))
    return [end for end in ends if len(end[2])]


def end_style(look: Look, device: int) -> Look:
    """A mark of `end_marks` in a device's colour; the star stands before the others."""
    colour = device_style(device)["color"]
    star = look is _START
    return {
        "color": colour,
        "markeredgecolor": "white" if star else colour,
        "zorder": 4.2 if star else 4,
        **look,
    }


def _given(scenario: "Scenario", state: GivenState) -> np.ndarray:
    return np.asarray(scenario.spacecraft.boresights(state.attitude, state.joints))


def zone_entries(scenario: "Scenario") -> Entries:
    """One of each kind of zones that the scenario has."""
    zones, entries = zones_at(scenario, 0.0), Entries()
    for kind, edge, text in (
        (KeepOut, to_rgba(KEEP_OUT, 0.6), "keep-out zone"),
        (KeepIn, KEEP_IN, "keep-in zone"),
    ):
        for devices, grouped in product((True, False), (False, True)):
            rest = ("" if devices else ",\nfor no device") + (",\nany of its group" if grouped else "")
            own = [
                zone
                for zone in zones
                if isinstance(zone, kind)
                and (zone.any_of is not None) == grouped
                and binds_devices(zone) == devices
            ]
            if own:
                look = {
                    **zone_fill(own[0]),
                    "edgecolor": edge,
                    "linestyle": zone_outline(own[0])["linestyle"],
                }
                entries.append((Patch(**look, linewidth=1), text + rest))
    if any(zone.moves for zone in scenario.zones):
        entries.append(
            (Line2D([], [], color=GREY, linewidth=1.1), "way of a zone's axis,\nto its fainter edge")
        )
    return entries


_CROWD = 20  # zones, beyond which their names get smaller and go without the devices they bind
_LETTER, _LINE = 3.0, 5.5  # deg of the map that a letter is wide and a line high
_MARK = 8.0  # deg of the map that a start or a goal takes
_HALO = [withStroke(linewidth=2.5, foreground="white")]


def name_zones(axes: Axes, scenario: "Scenario", ways: np.ndarray, marks: np.ndarray) -> None:
    """Write each zone's name in it, or beside it if a boresight must stay in.

    Args:
        axes: of the map.
        scenario: whose zones are meant.
        ways: (k, 2) deg, points of what is drawn, which names should not cover.
        marks: (m, 2) deg, of starts and goals, which names cover only where there is no other place.
    """
    # Small zones first, as they have the least room; of equals as they come.
    zones = sorted(zones_at(scenario, 0.0), key=lambda zone: zone.half_angle)
    crowded = len(zones) > _CROWD
    labels = Labels(ways, [(mark, np.full(2, _MARK)) for mark in marks])
    for zone in zones:
        lines = [zone.name] if crowded else [zone.name, *_bound(zone, scenario), *_group(zone)]
        size = (_LETTER * max(len(line) for line in lines), _LINE * len(lines))
        spot = labels.place(_places(zone, size), size, must=True)
        assert spot is not None
        label = axes.text(
            float(spot[0]),
            float(spot[1]),
            "\n".join(lines),
            color=KEEP_IN if isinstance(zone, KeepIn) else KEEP_OUT,
            fontsize=SMALL - 1.5 * crowded,
            ha="center",
            va="center",
            zorder=1.8,
            path_effects=_HALO,
        )
        plain(label)


def _places(zone: KeepOut | KeepIn, size: tuple[float, float]) -> list[tuple[float, float]]:
    """Where on the map a zone's name may stand, deg; the best comes first.

    That is over and under a keep-in zone, since its inside is where the ways are, and else in the zone. Of
    one that is more than half the sphere the outside is the smaller part, so its name stays inside, too.
    """
    azimuth, elevation = projections.unfold(zone.axis_at())
    angle = float(np.rad2deg(zone.half_angle))
    wide = angle > 90
    inside = [(0.0, offset * min(angle, 90)) for offset in (0, 0.5, -0.5, 0.8, -0.8)]
    near = [0.6 * angle / np.cos(np.deg2rad(min(abs(elevation), 60.0)))] if not wide else []
    turns = [side * turn for turn in (*near, 60.0, 120.0) for side in (1, -1)]
    aside = [(turn, height) for turn in turns for _, height in inside]
    beside = (
        []
        if wide or not isinstance(zone, KeepIn)
        else [(0.0, side * (angle + size[1] / 2 + 2)) for side in (1, -1)]
    )
    room = np.maximum((180 - size[0] / 2, 87 - size[1] / 2), 0)
    places = []
    for turn, height in [*beside, *inside, *aside]:
        across = (azimuth + turn + 180) % 360 - 180
        clear = abs(elevation + height) <= room[1]
        sure = not wide and turn == 0
        if clear and (sure or _separation(zone, across, elevation + height) < angle - 3):
            places.append((float(np.clip(across, -room[0], room[0])), float(elevation + height)))
    if not places:
        across, up = np.clip((azimuth, elevation), -room, room)
        places.append((float(across), float(up)))
    return places


def _separation(zone: KeepOut | KeepIn, azimuth: float, elevation: float) -> float:
    """Angle of a place on the map from a zone's axis, deg."""
    a, e = np.deg2rad((azimuth, elevation))
    return float(np.rad2deg(separation(pointing(a, e), zone.axis_at())))


def _bound(zone: KeepOut | KeepIn, scenario: "Scenario") -> list[str]:
    """In few words which devices and vectors a zone binds; nothing if it binds all devices and no vector."""
    names = scenario.spacecraft.device_names
    bound = [name for name in names if binds_all(zone) or name in zone.devices]
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


def _group(zone: KeepOut | KeepIn) -> list[str]:
    """Lines that name a zone's group and its entry there; none if it is in none."""
    lines = [] if zone.any_of is None else [f"any of {zone.any_of}"]
    return lines if zone.entry is None else [*lines, f"with all of {zone.entry}"]
