"""Angles, rates and accelerations over time with their limits (the paper's Figures 8 to 10 and 13 to 15).

Beside them are the loads that a spacecraft may limit in addition, by body axis: with the inertia ``J``, the
torque ``J omega' + omega x J omega`` and the angular momentum ``J omega``, and the platform's jerk.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from jaxplan.plotting.canvas import Canvas, panels
from jaxplan.plotting.samples import Motion, motion
from jaxplan.plotting.style import (
    AXIS_STYLES,
    GREY,
    Entries,
    device_entries,
    device_style,
    legend_beside,
    note,
)
from jaxplan.plotting.timelines import FAR, panel, time_axis

if TYPE_CHECKING:
    from jaxplan.planner import Plan
    from jaxplan.spacecraft import Spacecraft


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
    values, limits = moves.values.joints, craft.joint_limits
    axes = panels(ax, 2, size(2))
    for panel_axes in axes:
        panel_axes.yaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 1.5, 3, 5, 6, 9, 10]))
    entries = [
        _joints(axes[row], moves, craft, values, limits, name, f"{name} (deg)", far=np.inf)
        for row, name in enumerate(("yaw", "pitch"))
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
    moves, craft = motion(plan), plan.scenario.spacecraft
    axes = panels(ax, _count(craft), size(_count(craft)))
    if craft.terminals:
        values, limits = moves.values.joint_rates, craft.joint_rate_limits
        _joint_pair(axes, moves, craft, values, limits, "rate (deg/s)", legend)
    entries = platform_rate(axes[-1], moves, craft)
    if legend:
        legend_beside(axes[-1], entries)
    time_axis(axes, moves)
    return axes


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
    moves, craft = motion(plan), plan.scenario.spacecraft
    axes = panels(ax, _count(craft), size(_count(craft)))
    if craft.terminals:
        values, limits = moves.values.joint_accelerations, craft.joint_acceleration_limits
        _joint_pair(axes, moves, craft, values, limits, "acceleration\n(deg/s²)", legend)
    values = moves.values.angular_acceleration
    entries = _platform(
        axes[-1], moves, values, craft.acceleration_limit, "platform angular\nacceleration (deg/s²)"
    )
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
    loads = _loads(moves, craft)
    if not loads:
        raise ValueError(
            f"the spacecraft of {plan.scenario.name!r} has neither an inertia nor a limit of its jerk, "
            "so there is no torque to draw"
        )
    shown = [load for load in loads if load.limit is not None] or loads
    axes = panels(ax, len(shown), size(len(shown)))
    every = [
        _platform(axes[row], moves, load.values, load.limit, load.label, degrees=load.degrees)
        for row, load in enumerate(shown)
    ]
    if legend:
        legend_beside(axes[0], max(every, key=len))  # limits may be drawn on one panel and told on another
    time_axis(axes, moves)
    return axes


def load_limits(craft: "Spacecraft") -> int:
    """How many of torque, momentum and jerk a spacecraft limits: the panels of its `torque`."""
    limits = (craft.torque_limit, craft.wheel_momentum_limit, craft.jerk_limit)
    return sum(limit is not None for limit in limits)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Load:
    """What a panel of `torque` shows: values (k, 3), their limit, and what they are called."""

    values: np.ndarray
    limit: ArrayLike | None
    label: str
    degrees: bool


def _loads(moves: Motion, craft: "Spacecraft") -> list[_Load]:
    """The loads that can be computed; the jerk only where it is limited."""
    loads = []
    if craft.inertia is not None:
        rate, acceleration = moves.values.angular_velocity, moves.values.angular_acceleration
        inertia = np.asarray(craft.inertia)
        momentum = rate @ inertia.T
        moment = acceleration @ inertia.T + np.cross(rate, momentum)
        loads = [
            _Load(values=moment, limit=craft.torque_limit, label="torque (N m)", degrees=False),
            _Load(
                values=momentum,
                limit=craft.wheel_momentum_limit,
                label="angular\nmomentum (N m s)",
                degrees=False,
            ),
        ]
    if craft.jerk_limit is not None:
        jerk, label = moves.values.angular_jerk, "platform angular\njerk (deg/s³)"
        loads.append(_Load(values=jerk, limit=craft.jerk_limit, label=label, degrees=True))
    return loads


def platform_rate(axes: Axes, moves: Motion, craft: "Spacecraft") -> Entries:
    """Draw the platform's angular velocity by body axis on one panel; returns its legend entries."""
    label = "platform angular\nvelocity (deg/s)"
    return _platform(axes, moves, moves.values.angular_velocity, craft.rate_limit, label)


def _platform(
    axes: Axes,
    moves: Motion,
    values: np.ndarray,
    limit: ArrayLike | None,
    label: str,
    *,
    degrees: bool = True,
) -> Entries:
    """Values (k, 3) by body axis, with one limit for all or one each."""
    limits = np.broadcast_to(np.inf if limit is None else np.asarray(limit, dtype=float), 3)
    entries = panel(axes, moves, values, limits, AXIS_STYLES, label, degrees=degrees)
    lines = [Line2D([], [], linewidth=1.6, **look) for look in AXIS_STYLES]
    return [*zip(lines, ("body x", "body y", "body z"), strict=True), *entries]


def _joint_pair(
    axes: list[Axes],
    moves: Motion,
    craft: "Spacecraft",
    values: np.ndarray,
    limits: np.ndarray,
    quantity: str,
    legend: bool,
) -> None:
    """Pitches on the first panel and yaws on the second, the paper's order."""
    pitches = _joints(axes[0], moves, craft, values, limits, "pitch", f"pitch {quantity}")
    yaws = _joints(axes[1], moves, craft, values, limits, "yaw", f"yaw {quantity}")
    if legend:
        legend_beside(axes[0], [*_terminals(craft), *(pitches or yaws)])


def _joints(
    axes: Axes,
    moves: Motion,
    craft: "Spacecraft",
    values: np.ndarray,
    limits: np.ndarray,
    joint: str,
    label: str,
    far: float = FAR,
) -> Entries:
    """The yaws or the pitches on one panel; values (k, 2n) and limits (2n,) are of all joints."""
    count = len(craft.terminals)
    half = slice(0, count) if joint == "yaw" else slice(count, None)
    styles = [device_style(number) for number in range(count)]
    if not count:
        note(axes, "no terminals")
    return panel(axes, moves, values[:, half], limits[half], styles, label, far=far)


def _terminals(craft: "Spacecraft") -> Entries:
    return device_entries([terminal.name for terminal in craft.terminals])
