"""Margins over time: how far every device is from breaking a constraint, and what the certificate proves.

A margin is an angle, positive where the constraint is kept. A zone binds the devices to which it applies. At
an instant the *active* zone of a device is the one to which its margin is smallest; a *stretch* is a time
over which this is the same zone.

The scale of margins in degrees is ``asinh(margin / width)``: linear near the limit at zero, where margins
matter, and logarithmic beyond, so that half a degree and 130 deg can both be read off one panel.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.ticker import Locator

from jaxplan.geometry.vectors import min_of_numbers
from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan
from jaxplan.plotting.limit_lines import barrier
from jaxplan.plotting.style import (
    GREY,
    HALO,
    KEEP_OUT,
    SMALL,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Labels,
    Look,
    Motion,
    curve,
    device_entries,
    device_style,
    expect_plan,
    legend_beside,
    motion,
    note,
    panels,
    plain,
    plain_numbers,
    time_axis,
    titled,
)
from jaxplan.trajectory.zone_margins import ZoneMargins

_LINEAR_WIDTHS = np.array([1.0, 2.0, 5.0, 10.0, 20.0, 50.0])  # deg: of the linear part of the scale
_ROUND_DEGREES = [digit * 10.0**power for power in (-2, -1, 0, 1, 2) for digit in range(1, 10)]
_TICKS = [
    0.0,
    *(sign * value for value in _ROUND_DEGREES if value <= 180 for sign in (-1, 1)),
]  # nearest to zero first
_MIN_MINOR_SPACING = 0.2  # least distance of ticks without a label, in widths of a label
SIZE = (WIDTH, 4.2)  # inches
_PROVED_MARK: Look = {"marker": "^", "color": "black", "markersize": 7, "linestyle": "none"}
# Offsets of a name's centre from the lowest point of its curve, in halves of the name's size, the best first.
_ADJACENT_OFFSETS = [(0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)]
_NAME_OFFSETS = np.array(
    [*_ADJACENT_OFFSETS, (0, 2.5), (1, 2.5), (-1, 2.5), (2, 0), (-2, 0), (2, 2.5), (-2, 2.5)]
)
_LEVEL_TOLERANCE = 1.0  # points: parts of a curve less than that above its lowest point count as lowest, too
_VIOLATED_AREA: Look = {"facecolor": to_rgba(KEEP_OUT, 0.12), "edgecolor": "none", "zorder": 0.6}
_CROWDED_COUNT = 60  # number of curves beyond which they are drawn fainter


@dataclass(frozen=True, kw_only=True, eq=False)
class Margin:
    """Margin of a device to a zone, or to an ``any_of`` group of zones, over time.

    Attributes:
        device: number of the device; higher numbers are further directions that zones bind, in the order of
            `Scenario.sight_names`.
        zone: name of the zone or of the group.
        values: (k,) rad, >= 0 where it is kept; NaN while the group's best entry does not bind the device.
    """

    device: int
    zone: str
    values: np.ndarray


def open_near_zero(axes: Axes, which: Literal["x", "y"], lowest: float) -> None:
    """Give one axis of a panel the asinh scale of margins, with ticks at round numbers.

    Args:
        axes: the panel.
        which: of its axes, "x" or "y".
        lowest: deg, smallest margin of the panel; the scale is linear up to about there, at least up to 1
            deg.
    """
    width = float(np.max(_LINEAR_WIDTHS[lowest >= _LINEAR_WIDTHS], initial=_LINEAR_WIDTHS[0]))
    axis: Axis = getattr(axes, f"{which}axis")
    getattr(axes, f"set_{which}scale")("asinh", linear_width=width)
    axis.set_major_locator(_DegreeLocator((0, 1, 5, 2, 3), 1.0))
    plain_numbers(axis)
    axis.set_minor_locator(_DegreeLocator(range(10), _MIN_MINOR_SPACING))
    axis.set_tick_params(which="minor", length=2, color=GREY)


class _DegreeLocator(Locator):
    """Locator of ticks at round numbers of degrees, as many as there is room for.

    Args:
        digits: first digits that ticks may have, in the order in which ticks are tried; 0 stands for zero.
        room: least distance of two ticks, in widths of a label.
    """

    def __init__(self, digits: Iterable[int], room: float) -> None:
        self._digits, self._room = tuple(digits), room

    def __call__(self) -> Sequence[float]:
        assert self.axis is not None
        return self.tick_values(*self.axis.get_view_interval())

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Return the ticks in a view, so far apart that their labels do not touch."""
        axis: Any = self.axis
        low, high, *places = axis.get_transform().transform(np.array([vmin, vmax, *_TICKS])).tolist()
        apart = self._room * abs(high - low) / max(axis.get_tick_space(), 1)
        ticks: dict[float, float] = {}  # with their places
        for digit in self._digits:
            for tick, place in zip(_TICKS, places, strict=True):
                if _first_digit(tick) != digit or not vmin <= tick <= vmax:
                    continue
                if all(abs(place - other) >= apart for other in ticks.values()):
                    ticks[tick] = place
        return sorted(ticks)


@cache
def _first_digit(value: float) -> int:
    """Return the first significant digit of a number, 0 for zero."""
    return int(f"{abs(value):e}"[0])


def margins(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> Axes:
    """Draw the margin over time of every device, and every vector that zones bind, to each of its zones.

    The bold line of a device is its smallest margin. It has the name of the zone that is active at its lowest
    point and, where there is room, of those that are active elsewhere. The vertical axis is linear near zero,
    for a degree or up to the smallest margin, and logarithmic beyond, so that it holds every line. Below
    zero, where it is red, a constraint is broken. Zones of an ``any_of`` group count as the best of them. A
    triangle marks the lower bound for all margins at all times that the certificate proves.

    Args:
        plan: a plan with a trajectory.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name devices and the proved bound beside the panel.

    Returns:
        The axes, in s and deg.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory.
    """
    moves = motion(plan)
    (axes,) = panels(ax, 1, SIZE)
    devices, others = draw(axes, plan, moves)
    time_axis([axes], moves)
    if legend:
        titled(axes, expect_plan(plan), "margins")
        legend_beside(axes, [*devices, *others])
    return axes


def draw(axes: Axes, plan: Plan, moves: Motion) -> tuple[Entries, Entries]:
    """Draw margins over time on one panel; returns legend entries of devices, and those of everything else.

    Both are empty if the scenario has no zones, which the panel then says.
    """
    axes.set_ylabel("margin to zones (deg)", fontsize=TEXT)
    found = margins_over_time(plan.scenario, moves)
    if not found:
        note(axes, "no zones")
        axes.set_yticks([])
        return [], []
    alpha = 0.6 if len(found) <= _CROWDED_COUNT else 0.3
    of_devices: dict[int, list[Margin]] = {}
    for margin in found:
        style = device_style(margin.device)
        curve(axes, moves.times, np.rad2deg(margin.values), **style, linewidth=0.7, alpha=alpha)
        of_devices.setdefault(margin.device, []).append(margin)
    smallest = {device: _combine_margins(own) for device, own in sorted(of_devices.items())}
    for device, line in smallest.items():
        curve(axes, moves.times, line.values, **device_style(device), linewidth=2)
    proved = _proved_bounds(plan)
    marks = [(time, bound) for time, bound, _ in proved]
    span(axes, [*(bound for _, bound in marks), *(np.rad2deg(margin.values) for margin in found)])
    _name_zones(axes, moves.times, smallest, marks)
    names = device_entries(plan.scenario.sight_names)
    kinds: Entries = [
        (Line2D([], [], color=GREY, linewidth=2), "smallest of a device"),
        (Line2D([], [], color=GREY, linewidth=0.7), "to each zone"),
        (Line2D([], [], color=KEEP_OUT, **barrier(-1)), "limit: below it\na zone is broken"),
    ]
    for time, bound, text in proved:
        axes.plot([time], [bound], **_PROVED_MARK, zorder=5, clip_on=False)
        kinds.append((Line2D([], [], **_PROVED_MARK), text))
    return [names[device] for device in smallest], kinds


class _ActiveStretch(NamedTuple):
    """A stretch: its zone, and the indices of its first and last instants and of the smallest margin."""

    zone: str
    first: int
    last: int
    lowest: int


class _SmallestMargin(NamedTuple):
    """A device's smallest margin at each time, (k,) deg, and its stretches, by time."""

    values: np.ndarray
    stretches: list[_ActiveStretch]


def _combine_margins(own: Sequence[Margin]) -> _SmallestMargin:
    """Combine the margins of one device to its smallest margin; NaN where it has none."""
    table = np.rad2deg([margin.values for margin in own])
    values = min_of_numbers(table)
    binding = np.argmin(np.where(np.isnan(table), np.inf, table), axis=0)
    known = np.flatnonzero(~np.isnan(values))
    parts = np.split(known, np.flatnonzero((np.diff(known) > 1) | (np.diff(binding[known]) != 0)) + 1)
    stretches = [
        _ActiveStretch(
            own[binding[part[0]]].zone, int(part[0]), int(part[-1]), int(part[np.argmin(values[part])])
        )
        for part in parts
    ]
    return _SmallestMargin(values, stretches)


def span(axes: Axes, drawn: Sequence[float | np.ndarray]) -> None:
    """Fit the vertical axis to all drawn values, deg, and draw the limit at zero and the red area below.

    If the panel shares its vertical axis with one that is scaled already, the limits of that are kept inside.
    """
    before = [] if axes.get_autoscaley_on() else axes.get_ylim()  # limits set by a panel that shares the axis
    values = np.concatenate([np.ravel(one) for one in (*before, *drawn)])
    lowest, highest = float(np.nanmin(values)), float(np.nanmax(values))
    open_near_zero(axes, "y", lowest)
    scale = axes.yaxis.get_transform()
    low, high = scale.transform(np.array([min(0.0, lowest), max(0.0, highest)]))
    pad = 0.06 * max(high - low, 1.0)
    axes.set_ylim(*scale.inverted().transform(np.array([low - pad, high + pad])))
    axes.axhspan(-360, 0, **_VIOLATED_AREA)
    axes.axhline(0, color=KEEP_OUT, zorder=1.5, **barrier(-1))


def _name_zones(
    axes: Axes, times: np.ndarray, smallest: dict[int, _SmallestMargin], marks: list[tuple[float, float]]
) -> None:
    """Write the names of active zones along the curves of smallest margins, as far as there is room.

    First each device's smallest margin gets a name at its lowest point, the lowest device first; then
    stretches that are as long as their names get theirs. A name stands above or below its stretch, or a line
    leads to it; it stands in the red area only where the zone is broken.

    Args:
        axes: the panel, with its scale set.
        times: (k,) s.
        smallest: smallest margins by number of the device.
        marks: places (time in s, margin in deg) of marks that no name may cover.
    """
    panel = axes.get_window_extent()
    size = np.array([panel.width, panel.height]) * 72 / axes.figure.dpi  # points, before the final layout
    height = axes.yaxis.get_transform().transform
    low, high = height(np.array(axes.get_ylim()))

    def on_page(time: np.ndarray | float, value: np.ndarray | float) -> np.ndarray:
        across = np.divide(time, times[-1]) if times[-1] > 0 else np.full_like(time, 0.5)
        return np.stack([across, (height(value) - low) / (high - low)], axis=-1) * size

    curves = {device: on_page(times, line.values) for device, line in smallest.items()}
    zero = on_page(times, np.zeros_like(times))
    labels = Labels(np.concatenate([zero, *curves.values()]))
    labels.taken.extend((on_page(*mark), np.full(2, _PROVED_MARK["markersize"] + 2.0)) for mark in marks)
    for device, stretch, first in _rank_stretches(smallest):
        points, value = curves[device], smallest[device].values[stretch.lowest]
        extent = SMALL * np.array([0.62 * len(stretch.zone) + 0.5, 1.2])
        start, end = points[[stretch.first, stretch.last], 0]
        if not first and end - start < extent[0]:
            continue
        corner = points[_middle_of_lowest(points[:, 1], stretch)]
        beside = extent / 2 + 2
        if any(np.all(np.abs(spot - corner) < 1) for spot, _ in labels.taken[: len(marks)]):
            beside = beside + (_PROVED_MARK["markersize"] + 2.0) / 2  # clear of the mark that stands there
        least = np.array([0.0, zero[0, 1] if value >= 0 else 0.0]) + extent / 2
        offered = [(corner + offset * beside, bool(np.any(np.abs(offset) > 1))) for offset in _NAME_OFFSETS]
        offered = [one for one in offered if np.all(one[0] >= least) and np.all(one[0] <= size - extent / 2)]
        near = [spot for spot, far in offered if start - 1 <= spot[0] <= end + 1 and not far]
        spot, led = labels.place(near, extent), False
        if spot is None and first:  # preferably not within a long stretch of another zone
            others = [
                points[[own.first, own.last], 0]
                for own in smallest[device].stretches
                if own.zone != stretch.zone and np.ptp(points[[own.first, own.last], 0]) > extent[0] / 2
            ]
            every = [place for place, _ in offered]
            apart = [place for place in every if not any(a <= place[0] <= b for a, b in others)]
            found = (labels.place(each, extent) for each in (apart, every))
            spot, led = next((one for one in found if one is not None), None), True
        if spot is not None:
            lowest = np.array([times[_middle_of_lowest(points[:, 1], stretch)], value])
            _write_zone_name(
                axes, stretch.zone, device_style(device)["color"], lowest, spot - corner, led=led
            )


def _rank_stretches(smallest: dict[int, _SmallestMargin]) -> list[tuple[int, _ActiveStretch, bool]]:
    """List all stretches by smallest margin as (device, stretch, whether it is the device's lowest).

    Those that are the lowest of their device come before all others.
    """
    found: list[tuple[bool, float, int, _ActiveStretch]] = []
    for device, line in smallest.items():
        depths = [float(line.values[own.lowest]) for own in line.stretches]
        for place, number in enumerate(np.argsort(depths, kind="stable").tolist()):
            found.append((place > 0, depths[number], device, line.stretches[number]))
    return [(device, own, not later) for later, _, device, own in sorted(found, key=lambda one: one[:3])]


def _middle_of_lowest(heights: np.ndarray, stretch: _ActiveStretch) -> int:
    """Return the index of the instant in the middle of the level part around a stretch's lowest point.

    Noise would otherwise choose a place on the level part. `heights` (k,) are those of the curve in points.
    """
    own = heights[stretch.first : stretch.last + 1]
    higher = np.flatnonzero(own > heights[stretch.lowest] + _LEVEL_TOLERANCE) + stretch.first
    before = int(np.max(higher[higher < stretch.lowest], initial=stretch.first - 1))
    after = int(np.min(higher[higher > stretch.lowest], initial=stretch.last + 1))
    return (before + after) // 2


def _write_zone_name(
    axes: Axes, zone: str, colour: str, point: np.ndarray, offset: np.ndarray, *, led: bool
) -> None:
    """Write a zone's name at an offset (2,), points, from a point (time in s, margin in deg).

    With `led` a line leads from the name to the point.
    """
    place: Look = {"xytext": tuple(offset), "textcoords": "offset points"}
    leader: Look = {"arrowstyle": "-", "color": colour, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 1}
    look: Look = {**place, **HALO, **({"arrowprops": leader} if led else {})}
    plain(axes.annotate(zone, (float(point[0]), float(point[1])), color=colour, fontsize=SMALL, **look))


def _proved_bounds(plan: Plan) -> list[tuple[float, float, str]]:
    """Return the certificate's bound of all margins as (time in s, margin in deg, legend text).

    The list has one element, or none without a finite bound.
    """
    proof = plan.certificate
    if proof is None or proof.min_margin is None or proof.worst_time is None:
        return []
    bound = float(np.rad2deg(proof.min_margin))
    word = "proved for all time:" if proof.certified else "not certified; bound:"
    where = f"{proof.worst_device} to {proof.worst_zone}\nat {proof.worst_time:.2f} s"
    text = f"{word}\nat least {bound:.3f} deg,\n{where}"
    return [(proof.worst_time, bound, text)] if np.isfinite(bound) else []


def margins_over_time(scenario: Scenario, moves: Motion) -> list[Margin]:
    """Compute margins over time of devices and vectors to their zones, equations (11) and (12).

    Of a group only its best entry counts, at every instant the one whose worst member has most margin, so
    that the smallest of all margins at an instant is that of the scene. A mask that repeats every turn of yaw
    counts once, where it is nearest.

    Args:
        scenario: whose zones are meant; one that moves is taken where it is at each instant.
        moves: the motion.

    Returns:
        One `Margin` for each device and zone that binds it at some time.
    """
    margins = ZoneMargins(scenario)
    table = margins.at(moves.times, moves.values.attitude, moves.values.joints)
    found: dict[tuple[int, str], np.ndarray] = {}
    for pair, values in zip(margins.pairs, table.T, strict=True):
        own = pair.device, pair.zone
        found[own] = np.fmin(found[own], values) if own in found else values
    return [
        Margin(device=device, zone=zone, values=values)
        for (device, zone), values in found.items()
        if not np.all(np.isnan(values))  # of an entry that is never its group's best
    ]
