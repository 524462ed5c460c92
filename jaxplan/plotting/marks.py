"""What all views of the sphere share: looks of zones, starts and goals, and the ways of the boresights."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxplan import so3
from jaxplan.moving import DirectionPath
from jaxplan.path import MovingGoal
from jaxplan.plotting import samples
from jaxplan.plotting.style import GREY, KEEP_IN, KEEP_OUT, Entries, Look, device_style
from jaxplan.scenario import GivenState, Targets
from jaxplan.scenario.moments import at, axis_at, is_moving, zone_at
from jaxplan.zones import KeepIn, KeepOut

if TYPE_CHECKING:
    from jaxplan.planner import Plan
    from jaxplan.scenario import Scenario

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
    if isinstance(zone, KeepIn):
        return {"color": KEEP_IN, "linestyle": (0, (5, 2.5)) if zone.any_of is None else (0, (1, 1.5))}
    return {"color": KEEP_OUT, "linestyle": "-"}


def zone_fill(zone: KeepOut | KeepIn) -> Look:
    """How a zone is filled: hatched for keep-out."""
    if isinstance(zone, KeepIn):
        return {"facecolor": to_rgba(KEEP_IN, 0.10), "edgecolor": "none"}
    return {"facecolor": to_rgba(KEEP_OUT, 0.09), "edgecolor": to_rgba(KEEP_OUT, 0.22), "hatch": "///"}


def zones_at(scenario: "Scenario", time: float, *, moving: bool | None = None) -> list[KeepOut | KeepIn]:
    """Zones where they are at a time, s: all of them, those that move, or those that do not."""
    zones: list[KeepOut | KeepIn] = [
        zone_at(zone, time) for zone in scenario.keep_out if moving in (None, is_moving(zone))
    ]
    return zones + [zone_at(zone, time) for zone in scenario.keep_in if moving in (None, is_moving(zone))]


def zone_ways(plan: "Plan") -> list[tuple[KeepOut | KeepIn, np.ndarray]]:
    """Zones that move where they are at last, and the ways of their axes (k, 3).

    The last instant is that of the goal; of a plan without one, the last that is known.
    """
    zones: list[KeepOut | KeepIn] = [*plan.scenario.keep_out, *plan.scenario.keep_in]
    ways: list[tuple[KeepOut | KeepIn, np.ndarray]] = []
    for zone in zones:
        if isinstance(zone.direction, DirectionPath):
            goal = plan.goal
            last = goal.time if isinstance(goal, MovingGoal) else float(zone.direction.times[-1])
            there = replace(zone, direction=axis_at(zone, last))
            ways.append((there, zone.direction.at(np.linspace(0.0, last, _WAY))))
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
        first = at(plan.scenario, 0.0).goal
        assert isinstance(first, Targets)
        ends.append((_TARGET, "target", first.directions))
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
    return np.asarray(scenario.spacecraft.boresights(so3.exp(state.rotation_vector), state.joints))


def zone_entries(scenario: "Scenario") -> Entries:
    """One of each kind of zones that the scenario has."""
    alone = [zone for zone in scenario.keep_in if zone.any_of is None]
    grouped = [zone for zone in scenario.keep_in if zone.any_of is not None]
    entries: Entries = []
    if scenario.keep_out:
        patch = Patch(**{**zone_fill(scenario.keep_out[0]), "edgecolor": to_rgba(KEEP_OUT, 0.6)}, linewidth=1)
        entries.append((patch, "keep-out zone"))
    for zones, text in ((alone, "keep-in zone"), (grouped, "keep-in zone,\nany of its group")):
        if zones:
            look = {
                **zone_fill(zones[0]),
                "edgecolor": KEEP_IN,
                "linestyle": zone_outline(zones[0])["linestyle"],
            }
            entries.append((Patch(**look, linewidth=1), text))
    if any(map(is_moving, scenario.keep_out)) or any(map(is_moving, scenario.keep_in)):
        entries.append(
            (Line2D([], [], color=GREY, linewidth=1.1), "way of a zone's axis,\nto its fainter edge")
        )
    return entries
