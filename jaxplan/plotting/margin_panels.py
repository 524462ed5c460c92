"""Margins over time: how far every device is from breaking a constraint, and what the certificate proves.

The scale of a margin in degrees is ``asinh(margin / width)``: linear near the limit at zero, where margins
matter, and logarithmic beyond, so that half a degree and 130 deg are both read off one panel.
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

from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan
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
    barrier,
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

_WIDTHS = np.array([1.0, 2.0, 5.0, 10.0, 20.0, 50.0])  # deg, within which the scale may be linear
_DEGREES = [digit * 10.0**power for power in (-2, -1, 0, 1, 2) for digit in range(1, 10)]
_TICKS = [
    0.0,
    *(sign * value for value in _DEGREES if value <= 180 for sign in (-1, 1)),
]  # nearest to zero first
_MINOR = 0.2  # least distance of ticks without a label, in widths of a label, lest they run together
SIZE = (WIDTH, 4.2)  # inches
_PROVED: Look = {"marker": "^", "color": "black", "markersize": 7, "linestyle": "none"}
# Offsets of a name's centre from the lowest point of its curve, in halves of the name's size, the best first.
_OFFSETS = np.array(
    [(0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1), (0, 2.5), (1, 2.5), (-1, 2.5), (2, 0), (-2, 0)]
)
_BROKEN: Look = {"facecolor": to_rgba(KEEP_OUT, 0.12), "edgecolor": "none", "zorder": 0.6}
_CROWD = 60  # number of curves beyond which they are drawn fainter


@dataclass(frozen=True, kw_only=True, eq=False)
class Margin:
    """Margin of a device to a zone, or to a group of them, over time.

    Attributes:
        device: number of the device, or beyond these of a further direction that zones bind.
        zone: name of the zone or of the group.
        values: (k,) rad, >= 0 is clear; NaN while the group's best zone does not bind the device.
    """

    device: int
    zone: str
    values: np.ndarray


def open_near_zero(axes: Axes, which: Literal["x", "y"], lowest: float) -> None:
    """Give one axis of a panel the asinh scale of margins, with ticks at round numbers.

    Args:
        axes: the panel.
        which: of its axes.
        lowest: deg, the smallest margin of the panel: the scale is linear up to about there, and at least up
            to a degree.
    """
    width = float(np.max(_WIDTHS[lowest >= _WIDTHS], initial=_WIDTHS[0]))
    axis: Axis = getattr(axes, f"{which}axis")
    getattr(axes, f"set_{which}scale")("asinh", linear_width=width)
    axis.set_major_locator(_DegreeLocator((0, 1, 5, 2, 3), 1.0))
    plain_numbers(axis)
    axis.set_minor_locator(_DegreeLocator(range(10), _MINOR))
    axis.set_tick_params(which="minor", length=2, color=GREY)


class _DegreeLocator(Locator):
    """Locator of ticks at round numbers of degrees, as many as there is room for.

    Args:
        digits: first digits that ticks may have, in the order in which ticks are tried.
        room: least distance of two ticks, in widths of a label.
    """

    def __init__(self, digits: Iterable[int], room: float) -> None:
        self._digits, self._room = tuple(digits), room

    def __call__(self) -> Sequence[float]:
        assert self.axis is not None
        return self.tick_values(*self.axis.get_view_interval())

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """The ticks of a view, so far apart that their labels do not touch."""
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
    """First significant digit of a number, 0 of zero."""
    return int(f"{abs(value):e}"[0])


def margins(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> Axes:
    """Draw the margin over time of every device, and every vector that zones bind, to each of its zones.

    The bold line of a device is its smallest margin, named after the zone at its lowest point. The vertical
    axis holds every line: it is linear near zero, for a degree or up to the smallest margin, and logarithmic
    beyond. Below zero, where it is red, a constraint is broken. Zones of an ``any_of`` group count as the
    best of them. A triangle marks the lower bound over all time that the certificate proves.

    Args:
        plan: with a trajectory.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name devices and the proved bound beside the panel.

    Returns:
        The axes.

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
    """Draw margins over time on one panel; returns the legend entries of the devices, and of all else."""
    axes.set_ylabel("margin to zones (deg)", fontsize=TEXT)
    found = margins_over_time(plan.scenario, moves)
    if not found:
        note(axes, "no zones")
        axes.set_yticks([])
        return [], []
    alpha = 0.6 if len(found) <= _CROWD else 0.3
    of_devices: dict[int, list[Margin]] = {}
    for margin in found:
        style = device_style(margin.device)
        curve(axes, moves.times, np.rad2deg(margin.values), **style, linewidth=0.7, alpha=alpha)
        of_devices.setdefault(margin.device, []).append(margin)
    smallest = {device: _smallest(own) for device, own in sorted(of_devices.items())}
    for device, line in smallest.items():
        curve(axes, moves.times, line.values, **device_style(device), linewidth=2)
    proved = _proved(plan)
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
        axes.plot([time], [bound], **_PROVED, zorder=5, clip_on=False)
        kinds.append((Line2D([], [], **_PROVED), text))
    return [names[device] for device in smallest], kinds


class _Smallest(NamedTuple):
    """A device's smallest margin over time, deg, with its lowest instant and the zone that it is to then."""

    values: np.ndarray
    lowest: int
    zone: str


def _smallest(own: Sequence[Margin]) -> _Smallest:
    """The smallest of a device's margins, at each time."""
    table = np.rad2deg([margin.values for margin in own])
    values = np.fmin.reduce(table)
    lowest = int(np.nanargmin(values))
    return _Smallest(values, lowest, own[int(np.nanargmin(table[:, lowest]))].zone)


def span(axes: Axes, drawn: Sequence[float | np.ndarray]) -> None:
    """Scale the vertical axis to all values drawn, deg, and draw the limit at zero and the red area below."""
    before = [] if axes.get_autoscaley_on() else axes.get_ylim()  # of a panel that shares the axis
    values = np.concatenate([np.ravel(one) for one in (*before, *drawn)])
    lowest, highest = float(np.nanmin(values)), float(np.nanmax(values))
    open_near_zero(axes, "y", lowest)
    scale = axes.yaxis.get_transform()
    low, high = scale.transform(np.array([min(0.0, lowest), max(0.0, highest)]))
    pad = 0.06 * max(high - low, 1.0)
    axes.set_ylim(*scale.inverted().transform(np.array([low - pad, high + pad])))
    axes.axhspan(-360, 0, **_BROKEN)
    axes.axhline(0, color=KEEP_OUT, zorder=1.5, **barrier(-1))


def _name_zones(
    axes: Axes, times: np.ndarray, smallest: dict[int, _Smallest], marks: list[tuple[float, float]]
) -> None:
    """Name the zone at the lowest point of each smallest margin, lowest first and as far as there is room.

    Args:
        axes: the panel, scaled.
        times: (k,) s.
        smallest: by number of the device.
        marks: places (time in s, margin in deg) of marks that no name may cover.
    """
    panel = axes.get_window_extent()
    size = np.array([panel.width, panel.height]) * 72 / axes.figure.dpi  # points, before the final layout
    height = axes.yaxis.get_transform().transform
    low, high = height(np.array(axes.get_ylim()))

    def on_page(time: np.ndarray | float, value: np.ndarray | float) -> np.ndarray:
        across = np.divide(time, times[-1]) if times[-1] > 0 else np.full_like(time, 0.5)
        return np.stack([across, (height(value) - low) / (high - low)], axis=-1) * size

    drawn = [np.zeros_like(times), *(line.values for line in smallest.values())]  # with the line at zero
    labels = Labels(np.concatenate([on_page(times, values) for values in drawn]))
    labels.taken.extend((on_page(*mark), np.full(2, _PROVED["markersize"] + 2.0)) for mark in marks)
    for device, line in sorted(smallest.items(), key=lambda item: item[1].values[item[1].lowest]):
        lowest = float(times[line.lowest]), float(line.values[line.lowest])
        corner, extent = on_page(*lowest), SMALL * np.array([0.62 * len(line.zone) + 0.5, 1.2])
        beside = extent / 2 + 2
        if any(np.all(np.abs(spot - corner) < 1) for spot, _ in labels.taken[: len(marks)]):
            beside = beside + (_PROVED["markersize"] + 2.0) / 2  # of the mark that stands there
        places = [corner + offset for offset in _OFFSETS * beside]
        spot = labels.place(
            [p for p in places if np.all(np.abs(p - size / 2) <= (size - extent) / 2)], extent
        )
        if spot is not None:
            place: Look = {"xytext": tuple(spot - corner), "textcoords": "offset points"}
            colour = device_style(device)["color"]
            plain(axes.annotate(line.zone, lowest, color=colour, fontsize=SMALL, **place, **HALO))


def _proved(plan: Plan) -> list[tuple[float, float, str]]:
    """The proved bound of all margins as (time in s, margin in deg, legend text), if there is one."""
    proof = plan.certificate
    if proof is None or proof.min_margin is None or proof.worst_time is None:
        return []
    bound = float(np.rad2deg(proof.min_margin))
    word = "proved for all time:" if proof.certified else "not certified; bound:"
    where = f"{proof.worst_device} to {proof.worst_zone}\nat {proof.worst_time:.2f} s"
    text = f"{word}\nat least {bound:.3f} deg,\n{where}"
    return [(proof.worst_time, bound, text)] if np.isfinite(bound) else []


def margins_over_time(scenario: Scenario, moves: Motion) -> list[Margin]:
    """Margins over time of devices and vectors to constraints that bind them, equations (11) and (12).

    A group counts as the best of its entries: at every instant the one whose worst member has most margin.
    So the smallest of all margins at an instant is that of the scene. A mask that repeats every turn of a yaw
    counts once, where it is nearest.

    Args:
        scenario: whose zones are meant; one that moves is taken where it is at each instant.
        moves: the motion.
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
        if not np.all(np.isnan(values))  # of an entry that is never the best
    ]
