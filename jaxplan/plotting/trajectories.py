"""Several trajectories side by side, with their durations and segments.

How long several methods take for the same goals, beside the strict bound that none can beat.

Trajectories of one path side by side: their rates, accelerations and jerks.

Each has a name, by which figures call it; in `compare` its colour and line style are those of its place among
the names. At a break a trajectory is drawn from both sides, so that a jump is a vertical stroke. A limit far
from all curves of a row is told above its panel instead of drawn, since the curves would shrink to a line.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle, islice
from typing import TYPE_CHECKING, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxplan.model.limits import QUANTITIES, limits, timed_limits
from jaxplan.plotting.style import (
    AXIS_STYLES,
    COLOURS,
    GREY,
    SMALL,
    TEXT,
    Canvas,
    Entries,
    Look,
    device_style,
    expect_mapping,
    expect_trajectories,
    legend_beside,
    limit_lines,
    panels,
    plain,
    tidy,
)
from jaxplan.plotting.time_panels import curve, labelled, time_span

if TYPE_CHECKING:
    from jaxplan.model.spacecraft import Spacecraft
    from jaxplan.trajectory.curve import Trajectory


_MARKERS = ("o", "s", "D", "^", "v", "P", "X")
_HEIGHT, _ROW = 1.0, 0.26  # inches: of what is around the panel, and of a method of a scene
_GAP = 0.6  # between scenes, in rows
_AREA: Look = {"color": "0.93", "linewidth": 0}
_BOUND: Look = {"color": "black", "linewidth": 1.6}


def durations(
    seconds: Mapping[str, Mapping[str, float]],
    bounds: Mapping[str, float],
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> Axes:
    """Durations of several methods for each scene, with their excess over the bound in percent.

    Args:
        seconds: of each method, by the names of scenes; a scene without a value has no mark.
        bounds: s, no motion to the same goal is shorter, by the names of scenes
            (`jaxplan.trajectory.duration_bound`); another goal that meets the same targets may be met sooner.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name the methods beside the panel.

    Returns:
        The axes.

    Raises:
        TypeError: if they are no dicts.
        ValueError: if there are no methods or no scenes.

    Example:
        >>> jp.plot.durations({"minimum": {"case 1": 20.9}, "stretched": {"case 1": 25.5}}, {"case 1": 20.6})
    """
    for method, of_method in expect_mapping("seconds", seconds).items():
        expect_mapping(f"seconds[{method!r}]", of_method)
    expect_mapping("bounds", bounds)
    if not (seconds and bounds):
        raise ValueError("there are no durations to draw")
    pitch = len(seconds) + _GAP
    (axes,) = panels(ax, 1, (9.0, _HEIGHT + _ROW * pitch * len(bounds)))
    tidy(axes)
    axes.grid(False, axis="y")
    longest = max(bounds.values())
    for number, (scene, bound) in enumerate(bounds.items()):
        top = number * pitch
        low, high = top - 0.5, top + len(seconds) - 0.5
        axes.fill_between([0, bound], low, high, **_AREA, zorder=0.5)
        axes.plot([bound, bound], [low, high], **_BOUND)
        for line, (of_method, look) in enumerate(zip(seconds.values(), looks(len(seconds)), strict=True)):
            if scene in of_method:
                value = float(of_method[scene])
                longest = max(longest, value)
                axes.plot([bound, value], [top + line] * 2, color=look["color"], linewidth=1, alpha=0.6)
                axes.plot([value], [top + line], **look)
                axes.annotate(
                    f"{100 * (value / bound - 1):+.{1 if value < 1.1 * bound else 0}f} %",
                    (value, top + line),
                    xytext=(7, 0),
                    textcoords="offset points",
                    va="center",
                    fontsize=SMALL,
                    color=GREY,
                )
    centres = np.arange(len(bounds)) * pitch + (len(seconds) - 1) / 2
    axes.set_yticks(centres, list(bounds))
    for label in axes.get_yticklabels():
        plain(label)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(bounds) * pitch - _GAP - 0.2, -0.8)
    axes.set_xlim(0, 1.1 * longest)
    axes.set_xlabel("duration (s)", fontsize=TEXT)
    if legend:
        entries: Entries = [
            (Line2D([], [], **look), name) for name, look in zip(seconds, looks(len(seconds)), strict=True)
        ]
        bound_line = (Line2D([], [], **_BOUND), "strict bound\nfor the goal")
        legend_beside(axes, [*entries, bound_line, (Patch(**_AREA), "impossible")])
    return axes


def looks(count: int) -> list[Look]:
    """Marks of so many methods."""
    return [
        {"color": colour, "marker": marker, "markersize": 6, "linestyle": "none"}
        for colour, marker in islice(zip(cycle(COLOURS), cycle(_MARKERS)), count)
    ]


_BODY = ("body x", "body y", "body z")
# Of the angular velocity and its derivatives.
_LABELS = [labelled(each.word, each) for each in QUANTITIES if not each.of_joints and not each.by_inertia]
_FAR = 1.5  # times the largest value, beyond which a limit is told and not drawn
_INSTANTS = 880  # of the grid; with both sides of some seventy breaks a kernel's worth of times
_SMOOTH = 3  # continuous derivatives of the attitude, with which the jerk has no jumps
_JOIN: Look = {"color": "0.7", "linewidth": 0.9, "linestyle": (0, (1, 2))}


def compare(
    trajectories: Mapping[str, "Trajectory"],
    spacecraft: "Spacecraft",
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> list[Axes]:
    """Rates, accelerations and jerks of several trajectories, with limits.

    There is a column for each body axis of the platform, and one, with a scale of its own, for the joint that
    comes nearest to a limit of its rate or acceleration in any of the trajectories.

    Args:
        trajectories: by what they are called.
        spacecraft: whose limits are meant.
        ax: twelve axes in three rows of four, without terminals nine in rows of three; a figure to put them
            in, or None for a new one.
        legend: whether to name the trajectories beside the panels.

    Returns:
        The axes, row by row: rates, accelerations and jerks.

    Raises:
        TypeError: if they are no trajectories by names, or it is no spacecraft.
        ValueError: if there are no trajectories, or another number of axes is given.

    Example:
        >>> jp.plot.compare({"paper": slow.trajectory, "global": fast.trajectory}, scenario.spacecraft)
    """
    expect_trajectories(trajectories, spacecraft)
    sampled = _sampled(trajectories)
    titles = [*_BODY]
    columns = [[found.platform[:, :, axis] for found in sampled.values()] for axis in range(3)]
    bounds = np.repeat(_platform_limits(spacecraft)[:, None], 3, axis=1)
    if spacecraft.terminals:
        joint = _busiest(list(sampled.values()), spacecraft)
        titles.append(spacecraft.joint_names[joint])
        columns.append([found.joints[:, :, joint] for found in sampled.values()])
        bounds = np.column_stack([bounds, [*_joint_limits(spacecraft)[:, joint], np.inf]])
    across = len(columns)
    every = panels(ax, 3 * across, (2.7 * across + 1.6, 6.2), columns=across, alone=across - 3)
    styles: list[Look] = [{**device_style(number), "linewidth": 1.4} for number in range(len(sampled))]
    entries: Entries = [(Line2D([], [], **look), name) for name, look in zip(sampled, styles, strict=True)]
    for row in range(3):
        line = every[row * across : (row + 1) * across]
        for axes, curves in zip(line, columns, strict=True):
            for found, values, look in zip(sampled.values(), curves, styles, strict=True):
                curve(axes, found.times, np.rad2deg(values[row]), **look)
        highest = [max(float(np.max(np.abs(values[row]))) for values in curves) for curves in columns]
        highest[:3] = [max(highest[:3])] * 3  # the body axes share their scale
        shown = [_limit(*of_panel) for of_panel in zip(line, bounds[row], highest, strict=True)]
        entries += next((drawn for drawn in shown if drawn and len(entries) == len(sampled)), [])
        line[0].set_ylabel(_LABELS[row], fontsize=TEXT)
    _finish(every, titles, max(float(found.times[-1]) for found in sampled.values()))
    if legend:
        legend_beside(every[across - 1], entries)
    return every


def segments(
    trajectories: Mapping[str, "Trajectory"],
    spacecraft: "Spacecraft",
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> list[Axes]:
    """Angular acceleration and jerk of the platform, a trajectory a column, with their joins (Figure 11).

    Dotted lines are joins where the jerk may jump; the largest jump of a body axis is told above the jerks.

    Args:
        trajectories: by what they are called, such as the number of their segments.
        spacecraft: whose limits are meant.
        ax: two rows of as many axes as trajectories, a figure to put them in, or None for a new one.
        legend: whether to name the curves beside the panels.

    Returns:
        The axes, those of the accelerations first.

    Raises:
        TypeError: if they are no trajectories by names, or it is no spacecraft.
        ValueError: if there are no trajectories, or another number of axes is given.

    Example:
        >>> tries = [replace(query, settings=replace(settings, segments=n)) for n in (4, 5, 6)]
        >>> fits = zip(("4 segments", "5 segments", "6 segments"), fit_batch(tries))
        >>> jp.plot.segments({name: fit.trajectory for name, fit in fits}, craft)
    """
    expect_trajectories(trajectories, spacecraft)
    sampled = _sampled(trajectories)
    across = len(sampled)
    every = panels(ax, 2 * across, (2.7 * across + 1.6, 4.8), columns=across)
    bounds = _platform_limits(spacecraft)
    entries: Entries = [
        (Line2D([], [], linewidth=1.6, **look), name) for look, name in zip(AXIS_STYLES, _BODY, strict=True)
    ]
    drawn: Entries = []
    for row in (1, 2):
        line = every[(row - 1) * across : row * across]
        highest = max(float(np.max(np.abs(found.platform[row]))) for found in sampled.values())
        for axes, found in zip(line, sampled.values(), strict=True):
            for time in found.joins:
                axes.axvline(time, zorder=1.4, **_JOIN)
            for values, look in zip(found.platform[row].T, AXIS_STYLES, strict=True):
                curve(axes, found.times, np.rad2deg(values), **{**look, "linewidth": 1.2})
            drawn = _limit(axes, bounds[row], highest) or drawn
        line[0].set_ylabel(f"platform angular\n{_LABELS[row]}", fontsize=TEXT)
    _finish(every, list(sampled), max(float(found.times[-1]) for found in sampled.values()))
    for axes, found in zip(every[across:], sampled.values(), strict=True):
        jump = f"largest jump {np.rad2deg(found.jump):.2g} deg/s³" if len(found.joins) else "no jumps"
        axes.set_title(jump, fontsize=SMALL, color=GREY)
    if legend:
        joins: Entries = (
            [(Line2D([], [], **_JOIN), "join")] if any(len(s.joins) for s in sampled.values()) else []
        )
        legend_beside(every[across - 1], [*entries, *joins, *drawn])
    return every


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sampled:
    """A trajectory on a grid with both sides of every break.

    Attributes:
        times: (k,) s, a single one if it takes no time.
        platform: (3, k, 3) rad/s, rad/s^2, rad/s^3, by body axis.
        joints: (3, k, 2n) likewise.
        joins: (j,) s, where the platform's jerk may jump.
        jump: rad/s^3, the largest one there; 0 without joins.
    """

    times: np.ndarray
    platform: np.ndarray
    joints: np.ndarray
    joins: np.ndarray
    jump: float

    @classmethod
    def of(cls, trajectory: "Trajectory") -> Self:
        end = trajectory.duration
        grid = np.linspace(0.0, end, _INSTANTS if end > 0 else 1)
        after = np.unique(np.concatenate([trajectory.breaks, trajectory.joint_breaks]))
        after = after[(after > 0) & (after < end)]
        times = np.unique(np.concatenate([grid, after, np.nextafter(after, 0.0)]))
        values = trajectory.sample(times)
        names = ("rates", "accelerations", "jerks")
        joins = trajectory.breaks[1:-1] if trajectory.smoothness < _SMOOTH else np.zeros(0)
        jerk = values.angular_jerk
        ends = np.searchsorted(times, joins)
        return cls(
            times=times,
            platform=np.stack([values.angular_velocity, values.angular_acceleration, jerk]),
            joints=np.stack([getattr(values, f"joint_{name}") for name in names]),
            joins=joins,
            jump=float(np.max(np.abs(jerk[ends] - jerk[ends - 1]), initial=0.0)),
        )


def _sampled(trajectories: Mapping[str, "Trajectory"]) -> dict[str, _Sampled]:
    if not trajectories:
        raise ValueError("there are no trajectories to draw")
    return {name: _Sampled.of(trajectory) for name, trajectory in trajectories.items()}


def _platform_limits(spacecraft: "Spacecraft") -> np.ndarray:
    """Of rate, acceleration and jerk, (3,); infinite where there is none."""
    found = np.full(3, np.inf)
    for limit in limits(spacecraft):
        if not limit.quantity.of_joints and not limit.quantity.by_inertia:
            found[limit.quantity.power - 1] = limit.bound[0]  # it is the same about every axis
    return found


def _joint_limits(spacecraft: "Spacecraft") -> np.ndarray:
    """Of rates and accelerations, (2, 2n)."""
    return np.stack([limit.bound for limit in timed_limits(spacecraft)[1]])


def _busiest(sampled: list[_Sampled], spacecraft: "Spacecraft") -> int:
    """The joint that takes the largest share of a limit."""
    peaks = np.max([np.max(np.abs(found.joints[:2]), axis=1) for found in sampled], axis=0)
    return int(np.argmax(np.max(peaks / _joint_limits(spacecraft), axis=0)))


def _limit(axes: Axes, limit: float, highest: float) -> Entries:
    """A limit of panels whose highest value is known, both in radians; its legend entry if it is drawn."""
    degrees, value = np.rad2deg([limit]), float(np.rad2deg(highest))
    return limit_lines(axes, degrees, [{"color": GREY}], value, far=_FAR)


def _finish(every: list[Axes], titles: list[str], end: float) -> None:
    """Titles above the columns and time below them."""
    across = len(titles)
    for column, title in enumerate(titles):
        plain(every[column].set_title(title, fontsize=TEXT))
        time_span(every[column::across], end)
