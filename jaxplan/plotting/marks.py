"""What all views of the sphere share: looks of zones, starts and goals, and the ways of the boresights."""

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxplan.model.scenario import GivenState
from jaxplan.model.zones import KeepIn, KeepOut, binds_all
from jaxplan.plotting import samples
from jaxplan.plotting.style import GREY, KEEP_IN, KEEP_OUT, Entries, Look, device_style

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
