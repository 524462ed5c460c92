"""The attitude over time in the local orbital frame: roll, pitch and yaw of the body, and angles from nadir.

The frame is that of `jaxplan.plotting.frames`: x ahead, y to the right, z to nadir. Its axes become the
body's by a rotation about z (yaw), then about the new y (pitch), then about the newest x (roll): sequence
3-2-1, so that the rotation from the body to the frame is Rz(yaw) Ry(pitch) Rx(roll). Pitch lies within +-90
deg; at these ends roll and yaw turn about the same axis, and only their sum or difference means anything.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from jaxplan.geometry.vectors import separation
from jaxplan.planner import Plan
from jaxplan.plotting.frames import orbit_of
from jaxplan.plotting.projections import cut
from jaxplan.plotting.style import (
    AXIS_STYLES,
    TEXT,
    Canvas,
    Entries,
    curve,
    device_entries,
    device_style,
    expect_plan,
    legend_beside,
    motion,
    panels,
    plain,
    time_axis,
)
from jaxplan.plotting.time_panels import size
from jaxplan.sky import Satellite
from jaxplan.timeline.record import TimelinePlan

_ANGLE_NAMES = ("roll, about x", "pitch, about y", "yaw, about z")
_TICK_STEPS = [1, 1.5, 3, 4.5, 6, 9, 10]  # steps between ticks, times powers of ten


def attitude(
    plan: Plan | TimelinePlan,
    observer: Satellite | None = None,
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> list[Axes]:
    """Draw roll, pitch and yaw of the body in the local orbital frame, and each boresight's angle from nadir.

    The frame has z to nadir, y against the orbit's normal and x about along the velocity; the sequence is yaw
    about z, pitch about y, roll about x. All three angles are zero where the body's axes are those of the
    frame.

    Args:
        plan: a plan with a trajectory, also one of a timeline.
        observer: the spacecraft's orbit, one of `jaxplan.sky`; required, since a plan does not hold it.
        ax: two axes (one for a spacecraft without devices), a figure to put them in, or None for a new one.
        legend: whether to name curves beside the panels.

    Returns:
        The axes of the three angles and, if there are devices, of the angles from nadir.

    Raises:
        TypeError: if it is no plan, or the observer no orbit.
        ValueError: if the orbit, the epoch or a trajectory is missing, or another number of axes is given.

    Example:
        >>> jp.plot.attitude(plan, jp.load_observer("scene.toml"))
    """
    plan = expect_plan(plan)
    frame = orbit_of(plan, observer, "attitude")
    moves, names = motion(plan), plan.scenario.spacecraft.device_names
    count = 1 + bool(names)
    grid = panels(ax, count, attitude_size(count))
    turned = frame.turn(moves.times) @ moves.values.attitude
    _draw_angles(grid[0], moves.times, np.rad2deg(roll_pitch_yaw(turned)))
    plain(grid[0].set_title(f"{plan.scenario.name}: attitude{frame.words}", fontsize=TEXT + 1, loc="left"))
    entries: Entries = [
        (Line2D([], [], linewidth=1.6, **look), name)
        for look, name in zip(AXIS_STYLES, _ANGLE_NAMES, strict=True)
    ]
    if legend:
        legend_beside(grid[0], entries)
    if names:
        seen = frame.seen(moves.boresights, moves.times)
        for device, line in enumerate(np.moveaxis(seen, 1, 0)):
            off = np.rad2deg(separation(line, np.array([0.0, 0.0, 1.0])))
            curve(grid[1], moves.times, off, **device_style(device))
        grid[1].set_ylabel("boresight\nfrom nadir (deg)", fontsize=TEXT)
        grid[1].yaxis.set_major_locator(MaxNLocator(nbins=6, steps=_TICK_STEPS))
        if legend:
            legend_beside(grid[1], device_entries(names))
    time_axis(grid, moves)
    return grid


def attitude_size(count: int) -> tuple[float, float]:
    """Return width and height in inches of a figure of `count` panels."""
    width, height = size(count)
    return width, height + 0.6


def roll_pitch_yaw(rotation: np.ndarray) -> np.ndarray:
    """Compute roll, pitch and yaw of the sequence 3-2-1.

    Args:
        rotation: (k, 3, 3) from the body to the frame, Rz(yaw) Ry(pitch) Rx(roll).

    Returns:
        (3, k) rad, rows roll, pitch and yaw: roll and yaw in [-pi, pi], pitch in [-pi / 2, pi / 2].
    """
    roll = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
    pitch = np.arctan2(-rotation[:, 2, 0], np.hypot(rotation[:, 2, 1], rotation[:, 2, 2]))
    yaw = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return np.stack([roll, pitch, yaw])


def _draw_angles(axes: Axes, times: np.ndarray, angles: Sequence[np.ndarray] | np.ndarray) -> None:
    """Draw angles (3, k) deg over times (k,) s; curves are broken where they pass from 180 to -180 deg."""
    for values, look in zip(angles, AXIS_STYLES, strict=True):
        parts = cut(np.column_stack([values, times]))
        curve(axes, parts[:, 1], parts[:, 0], **look)
    axes.set_ylabel("body in the frame (deg)", fontsize=TEXT)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=7, steps=_TICK_STEPS))
