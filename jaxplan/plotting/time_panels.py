"""Angles, rates, accelerations and torques over time, with their limits.

What every figure over time shares: curves with their limits, the nodes as ticks, and the time axis.

Angles, rates and accelerations over time with their limits (the paper's Figures 8 to 10 and 13 to 15).

Beside them are the loads that a spacecraft may limit in addition, by body axis. What there is, by which name
and in which unit, is the list of `jaxplan.model.limits`.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike

from jaxplan.model.limits import QUANTITIES, Limit, Quantity, timed_limits
from jaxplan.plotting.samples import Motion, motion
from jaxplan.plotting.style import (
    AXIS_STYLES,
    GREY,
    TEXT,
    Canvas,
    Entries,
    Look,
    device_entries,
    device_style,
    legend_beside,
    limit_lines,
    note,
    panels,
    tidy,
)

if TYPE_CHECKING:
    from jaxplan.model.spacecraft import Spacecraft
    from jaxplan.planner import Plan


_LONG = 10  # letters of a word, beside more of which its unit has no place
FAR = 4.0  # times the highest value: a limit beyond is told and not drawn


def labelled(words: str, quantity: Quantity) -> str:
    """What a panel of a quantity is labelled with: words and the unit, which stands below a long word."""
    below = len(words.split()[-1]) > _LONG and "\n" not in words
    between = "\n" if below else " "
    return f"{words}{between}({quantity.printed_unit})"


def panel(
    axes: Axes,
    motion: Motion,
    values: np.ndarray,
    limits: np.ndarray,
    styles: Sequence[Look],
    label: str,
    *,
    degrees: bool = True,
    far: float = FAR,
) -> Entries:
    """Draw curves over time with their limits.

    Args:
        axes: where to.
        motion: whose times are meant.
        values: (k, c) a column for each curve, in radians and seconds; drawn in degrees.
        limits: (c,) likewise; an infinite one is not drawn.
        styles: of the curves.
        label: of the vertical axis, with the unit.
        degrees: False if the values are drawn as they are.
        far: times the highest value, beyond which a limit is told above the panel and not drawn.

    Returns:
        Legend entries for the limits, if there are any.
    """
    shown = np.rad2deg if degrees else np.asarray
    for column, style in zip(shown(values).T, styles, strict=True):
        curve(axes, motion.times, column, **style)
    highest = float(np.max(np.abs(shown(values)), initial=0.0))
    entries = limit_lines(axes, shown(limits), styles, highest, far=far)
    axes.set_ylabel(label, fontsize=TEXT)
    return entries


def curve(axes: Axes, times: np.ndarray, values: np.ndarray, **style: Any) -> None:
    """Draw one curve; a manoeuvre that takes no time is a dot."""
    marker = "o" if len(times) == 1 else None
    axes.plot(times, values, **{"linewidth": 1.6, "marker": marker, "markersize": 5, **style})


def time_axis(panels: Sequence[Axes], motion: Motion) -> None:
    """Time in seconds under the lowest of some panels, and under those that do not share its axis."""
    time_span(panels, float(motion.times[-1]), motion.node_times)


def time_span(panels: Sequence[Axes], end: float, node_times: ArrayLike = ()) -> None:
    """The same from zero to an end, s, with ticks for nodes."""
    lowest = panels[-1]
    for axes in panels:
        tidy(axes)
        axes.set_xticks(np.asarray(node_times), minor=True)
        axes.tick_params(axis="x", which="minor", length=3, color="0.35")
        if end > 0:
            axes.set_xlim(0, end)
            axes.xaxis.set_major_locator(_EndLocator(end))
            axes.xaxis.set_major_formatter(FuncFormatter(partial(_seconds, end)))
        else:
            axes.set(xlim=(-1, 1), xticks=[0])
        shared = axes is not lowest and axes.get_shared_x_axes().joined(axes, lowest)
        axes.set_xlabel("" if shared else "time (s)", fontsize=TEXT)


class _EndLocator(MaxNLocator):
    """Round times, and the duration, so that it can be read off."""

    def __init__(self, end: float) -> None:
        super().__init__(nbins=8, steps=[1, 2, 2.5, 5, 10])
        self.end = end

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """The ticks of a view, less those whose labels would run into that of the end."""
        ticks = np.asarray(super().tick_values(vmin, vmax), dtype=float)
        return [*ticks[np.abs(ticks - self.end) > 0.08 * (vmax - vmin)].tolist(), self.end]


def _seconds(end: float, time: float, _: int | None = None) -> str:
    """A time as its tick says it; the duration to three digits, or to the second."""
    if time != end:
        return f"{time:.6g}"
    text = f"{end:.{max(0, 2 - math.floor(math.log10(end)))}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def size(count: int) -> tuple[float, float]:
    """Width and height in inches of a figure of so many panels."""
    return 9.0, 0.8 + 1.9 * count


def _count(craft: "Spacecraft") -> int:
    """Panels of rates or accelerations: pitches and yaws, if there are any, and the platform."""
    return 3 if craft.terminals else 1


def angles(plan: "Plan", ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Yaw and pitch of every terminal over time, with limits and the path's nodes.

    Args:
        plan: with a trajectory.
        ax: two axes (yaws, pitches), a figure to put them in, or None for a new one.
        legend: whether to name the terminals beside the upper panel.

    Returns:
        The two axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or other than two axes are given.
    """
    moves, craft = motion(plan), plan.scenario.spacecraft
    kinematics = moves.values.kinematics()
    axes = panels(ax, 2, size(2))
    for panel_axes in axes:
        panel_axes.yaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 1.5, 3, 5, 6, 9, 10]))
    entries = [
        _joints(
            axes[row],
            moves,
            quantity.values(kinematics).T,
            quantity.given(craft),
            quantity.word,
            quantity,
            far=np.inf,
        )
        for row, quantity in enumerate(each for each in QUANTITIES if each.power == 0)
    ]
    if plan.path is not None and len(plan.path.joints) == len(moves.node_times):
        for row, nodes in enumerate(np.split(np.rad2deg(plan.path.joints), 2, axis=1)):
            for number, column in enumerate(nodes.T):
                colour = device_style(number)["color"]
                axes[row].plot(moves.node_times, column, ".", color=colour, markersize=4.5)
        node = Line2D([], [], color=GREY, marker=".", linestyle="none")
        entries[0] = [(node, "node of the path"), *entries[0]]
    time_axis(axes, moves)
    if legend and craft.terminals:
        legend_beside(axes[0], [*_terminals(craft), *entries[0]])
    return axes


def rates(plan: "Plan", ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Joint rates and the platform's angular velocity over time, with limits.

    Args:
        plan: with a trajectory.
        ax: three axes (pitch rates, yaw rates, platform), or one if there are no terminals; a figure to put
            them in; None for a new one.
        legend: whether to name curves beside the panels.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or another number of axes is given.
    """
    return _derivatives(plan, ax, 1, legend=legend)


def accelerations(plan: "Plan", ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Joint accelerations and the platform's angular acceleration over time, with limits.

    Args:
        plan: with a trajectory.
        ax: as for `rates`.
        legend: whether to name curves beside the panels.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or another number of axes is given.
    """
    return _derivatives(plan, ax, 2, legend=legend)


def _derivatives(plan: "Plan", ax: Canvas, power: int, *, legend: bool) -> list[Axes]:
    """A derivative of the joints, and the one of the platform's attitude that falls as fast with the pace."""
    moves, craft = motion(plan), plan.scenario.spacecraft
    axes = panels(ax, _count(craft), size(_count(craft)))
    for limit in timed_limits(craft)[1]:
        if limit.quantity.power == power:
            _joint_pair(axes, moves, craft, limit, legend)
    entries = _of_attitude(axes[-1], moves, craft, power)
    if legend:
        legend_beside(axes[-1], entries)
    time_axis(axes, moves)
    return axes


def torque(plan: "Plan", ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Torque, angular momentum and jerk of the platform over time, with limits.

    Args:
        plan: with a trajectory.
        ax: an axes for each of torque, momentum and jerk that the spacecraft limits, from top to bottom; a
            figure to put them in; None for a new one. If it limits none, torque and momentum are shown.
        legend: whether to name curves beside the upper panel.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, the spacecraft neither an inertia nor a limit of its jerk,
            or another number of axes is given.
    """
    moves, craft = motion(plan), plan.scenario.spacecraft
    limited = {limit.quantity: limit.bound for limit in _loads(craft)}
    shown = list(limited) or [each for each in QUANTITIES if each.by_inertia and craft.inertia is not None]
    if not shown:
        raise ValueError(
            f"the spacecraft of {plan.scenario.name!r} has neither an inertia nor a limit of its jerk, "
            "so there is no torque to draw"
        )
    axes = panels(ax, len(shown), size(len(shown)))
    every = [
        _platform(axes[row], moves, craft, quantity, limited.get(quantity, np.full(3, np.inf)))
        for row, quantity in enumerate(shown)
    ]
    if legend:
        legend_beside(axes[0], max(every, key=len))  # limits may be drawn on one panel and told on another
    time_axis(axes, moves)
    return axes


def load_limits(craft: "Spacecraft") -> int:
    """How many loads a spacecraft limits beside its rate and acceleration: the panels of its `torque`."""
    return len(_loads(craft))


def _loads(craft: "Spacecraft") -> list[Limit]:
    """The platform's limits that have no panel among rates and accelerations."""
    return [each for each in timed_limits(craft)[0] if each.quantity.by_inertia or each.quantity.power > 2]


def platform_rate(axes: Axes, moves: Motion, craft: "Spacecraft") -> Entries:
    """Draw the platform's angular velocity by body axis on one panel; returns its legend entries."""
    return _of_attitude(axes, moves, craft, 1)


def _of_attitude(axes: Axes, moves: Motion, craft: "Spacecraft", power: int) -> Entries:
    """The angular velocity or its derivative on one panel."""
    (limit,) = (
        each
        for each in timed_limits(craft)[0]
        if each.quantity.power == power and not each.quantity.by_inertia
    )
    return _platform(axes, moves, craft, limit.quantity, limit.bound)


def _platform(
    axes: Axes, moves: Motion, craft: "Spacecraft", quantity: Quantity, limits: np.ndarray
) -> Entries:
    """A quantity by body axis, with its limits (3,), which may be infinite."""
    values = quantity.values(moves.values.kinematics(craft.inertia)).T
    label = labelled(quantity.caption, quantity)
    entries = panel(axes, moves, values, limits, AXIS_STYLES, label, degrees=quantity.angular)
    lines = [Line2D([], [], linewidth=1.6, **look) for look in AXIS_STYLES]
    return [*zip(lines, ("body x", "body y", "body z"), strict=True), *entries]


def _joint_pair(axes: list[Axes], moves: Motion, craft: "Spacecraft", limit: Limit, legend: bool) -> None:
    """Pitches on the first panel and yaws on the second, the paper's order."""
    values = np.split(limit.quantity.values(moves.values.kinematics()).T, 2, axis=1)
    bounds, names = np.split(limit.bound, 2), ("yaw", "pitch")
    yaws, pitches = (
        _joints(
            axes[1 - half], moves, values[half], bounds[half], f"{name} {limit.quantity.word}", limit.quantity
        )
        for half, name in enumerate(names)
    )
    if legend:
        legend_beside(axes[0], [*_terminals(craft), *(pitches or yaws)])


def _joints(
    axes: Axes,
    moves: Motion,
    values: np.ndarray,
    limits: np.ndarray,
    words: str,
    quantity: Quantity,
    far: float = FAR,
) -> Entries:
    """A joint of every terminal on one panel, with values (k, n) and limits (n,)."""
    styles = [device_style(number) for number in range(len(limits))]
    if not styles:
        note(axes, "no terminals")
    return panel(axes, moves, values, limits, styles, labelled(words, quantity), far=far)


def _terminals(craft: "Spacecraft") -> Entries:
    return device_entries([terminal.name for terminal in craft.terminals])
