"""Several trajectories side by side: rates, accelerations and jerks with their limits, and where pieces join.

Trajectories are given by names; in `compare` the colour and line style of each follow from its position among
the names. A *break* is a time at which pieces of a trajectory meet; there it is sampled on both sides, so
that a jump is drawn as a vertical stroke. A break at which the jerk may jump is a *join*.

A limit far from all curves of its panel is written above it. Values are in radians and seconds, the axes in
degrees and seconds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxplan.model.limits import timed_limits
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.planner import Plan
from jaxplan.plotting.day import as_plan
from jaxplan.plotting.limit_lines import both_sides, limit_lines
from jaxplan.plotting.motion_differences import against
from jaxplan.plotting.style import (
    AXIS_STYLES,
    GREY,
    SMALL,
    TEXT,
    Canvas,
    Entries,
    Look,
    curve,
    device_style,
    expect_mapping,
    expect_trajectories,
    legend_beside,
    panels,
    plain,
    time_span,
)
from jaxplan.plotting.time_panels import AXIS_ENTRIES, BODY, SPIN, labelled
from jaxplan.runtime.arguments import expect, expect_any
from jaxplan.tables import AttitudeTable
from jaxplan.timeline.record import TimelinePlan
from jaxplan.trajectory import Trajectory

_FAR_LIMIT_RATIO = 1.5  # multiple of the largest magnitude beyond which a limit is written and not drawn
_GRID_INSTANTS = 880  # times of the even grid, to which both sides of some seventy breaks are added
_SMOOTH_JERK_ORDER = 3  # number of continuous derivatives of the attitude from which on the jerk has no jumps
_GREY_LINE: Look = {"color": GREY}
_JOIN_LINE: Look = {"color": "0.7", "linewidth": 0.9, "linestyle": (0, (1, 2))}


def compare(
    trajectories: Mapping[str, Trajectory | Plan | TimelinePlan | AttitudeTable],
    spacecraft: Spacecraft | None = None,
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> list[Axes]:
    """Draw several motions with limits: rates, accelerations and jerks, or how far tables are off the first.

    There is a column for each body axis of the platform, and one, with a scale of its own, for a joint: the
    one that comes nearest to a limit of its rate or acceleration in any of the trajectories.

    If a table of attitudes is among them, as `jaxplan.load_attitude` reads one, the rows are instead: how far
    each motion has turned from the first attitude of the first motion, or the angle of the joint; how far it
    is off the first motion; and rates, for tables those of the motion that their readers make of them. The
    joint is then the one that is farthest off.

    Args:
        trajectories: trajectories, plans and tables by what they are called.
        spacecraft: whose limits are meant; None for that of the first plan.
        ax: twelve axes in three rows of four, without joints nine in rows of three; a figure to put them in,
            or None for a new one.
        legend: whether to name the motions beside the panels; with tables it says what each is.

    Returns:
        The axes, row by row: rates, accelerations and jerks; or turns, differences and rates.

    Raises:
        TypeError: if they are not such motions by names, or the spacecraft is none.
        ValueError: if there are none, a plan has no trajectory, a spacecraft is needed, or another number of
            axes is given.

    Example:
        >>> jp.plot.compare({"paper": slow.trajectory, "global": fast.trajectory}, scenario.spacecraft)
        >>> jp.plot.compare({"plan": plan, "table": jp.load_attitude("slew.aem")})
    """
    given, craft = _check_arguments(trajectories, spacecraft)
    if any(isinstance(each, AttitudeTable) for each in given.values()):
        return against(given, craft, ax, legend=legend)
    bare = {name: each.trajectory if isinstance(each, Plan) else each for name, each in given.items()}
    return _draw_trajectories(bare, craft, ax, legend=legend)


def _check_arguments(
    given: object, spacecraft: object
) -> tuple[dict[str, Trajectory | Plan | AttitudeTable], Spacecraft]:
    """Check the arguments of `compare` and return them; raises as `compare` does.

    Plans of timelines are replaced by plans of one manoeuvre, a missing spacecraft by that of the first plan.
    """
    taken: dict[str, Trajectory | Plan | AttitudeTable] = {}
    for name, each in expect_mapping("trajectories", given).items():
        plan = as_plan(each) if isinstance(each, TimelinePlan) else each
        known = (Trajectory, Plan, AttitudeTable)
        expect_any(f"trajectories[{name!r}]", plan, known, "a trajectory, a plan or a table of attitudes")
        if isinstance(plan, Plan) and plan.trajectory is None:
            ending = ": ".join(filter(None, [plan.status.name, plan.message]))
            raise ValueError(
                f"trajectories[{name!r}]: the plan has no trajectory to draw; it ended as {ending}"
            )
        taken[name] = plan
    if not taken:
        raise ValueError("there are no trajectories to draw")
    if spacecraft is None:
        plans = [each for each in taken.values() if isinstance(each, Plan)]
        if not plans:
            raise ValueError("spacecraft: missing, whose limits are meant; only a plan has one of its own")
        spacecraft = plans[0].scenario.spacecraft
    return taken, expect("spacecraft", spacecraft, Spacecraft, "scenario.spacecraft is one")


def _draw_trajectories(
    trajectories: Mapping[str, Any], spacecraft: Spacecraft, ax: Canvas, *, legend: bool
) -> list[Axes]:
    """Draw what `compare` draws for trajectories without tables."""
    sampled = _sample_trajectories(trajectories, spacecraft)
    bounds = _spin_limits(spacecraft)
    titles, values = [*BODY], [one.platform for one in sampled.values()]  # each (3, k, 3)
    if spacecraft.joint_count:
        # of rates and accelerations, (2, 2n + d)
        limits = np.stack([limit.bound for limit in timed_limits(spacecraft)[1]])
        peaks = np.max([np.max(np.abs(one.joints[:2]), axis=1) for one in sampled.values()], axis=0)
        joint = int(np.argmax(np.max(peaks / limits, axis=0)))
        titles.append(spacecraft.joint_names[joint])
        values = [
            np.dstack([own, one.joints[..., joint]])
            for own, one in zip(values, sampled.values(), strict=True)
        ]
        bounds = np.column_stack([bounds, [*limits[:, joint], np.inf]])
    across = len(titles)
    every = panels(ax, 3 * across, (2.7 * across + 1.6, 6.2), columns=across, alone=across - 3)
    styles: list[Look] = [{**device_style(number), "linewidth": 1.4} for number in range(len(sampled))]
    highest = np.max([np.max(np.abs(own), axis=1) for own in values], axis=0)  # (3, across)
    highest[:, :3] = np.max(highest[:, :3], axis=1, keepdims=True)  # the body axes share their scale
    limited: Entries = []
    for axes, (row, column) in zip(every, np.ndindex(3, across), strict=True):
        for one, own, look in zip(sampled.values(), values, styles, strict=True):
            curve(axes, one.times, np.rad2deg(own[row, :, column]), **look)
        top = float(highest[row, column])
        limited = _draw_limits(axes, bounds[row, column, None], [_GREY_LINE], top) or limited
    for quantity, axes in zip(SPIN, every[::across], strict=True):
        axes.set_ylabel(labelled(quantity.word, quantity), fontsize=TEXT)
    _add_titles_and_time_axis(every, titles, sampled)
    if legend:
        entries = [(Line2D([], [], **look), name) for name, look in zip(sampled, styles, strict=True)]
        legend_beside(every[across - 1], [*entries, *limited])
    return every


def segments(
    trajectories: Mapping[str, Trajectory],
    spacecraft: Spacecraft,
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> list[Axes]:
    """Draw angular acceleration and jerk of the platform, one trajectory per column, with joins (Figure 11).

    Dotted lines are joins, where the jerk may jump; the largest jump of a body axis is written above the
    jerks.

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
    sampled = _sample_trajectories(trajectories, spacecraft)
    across = len(sampled)
    every = panels(ax, 2 * across, (2.7 * across + 1.6, 4.8), columns=across)
    bounds, limited, joins = _spin_limits(spacecraft), Entries(), Entries()
    highest = np.max([np.max(np.abs(one.platform), axis=(1, 2)) for one in sampled.values()], axis=0)
    for axes, (row, one) in zip(every, product((1, 2), sampled.values()), strict=True):
        for time in one.joins:
            axes.axvline(time, zorder=1.4, **_JOIN_LINE)
            joins = [(Line2D([], [], **_JOIN_LINE), "join")]
        for values, look in zip(one.platform[row].T, AXIS_STYLES, strict=True):
            curve(axes, one.times, np.rad2deg(values), **{**look, "linewidth": 1.2})
        limited = _draw_limits(axes, bounds[row], AXIS_STYLES, highest[row]) or limited
    _add_titles_and_time_axis(every, list(sampled), sampled)
    for quantity, axes in zip(SPIN[1:], every[::across], strict=True):
        axes.set_ylabel(f"platform angular\n{labelled(quantity.word, quantity)}", fontsize=TEXT)
    for axes, one in zip(every[across:], sampled.values(), strict=True):
        jump = f"largest jump {np.rad2deg(one.jump):.2g} deg/s³" if len(one.joins) else "no jumps"
        axes.set_title(jump, fontsize=SMALL, color=GREY)
    if legend:
        legend_beside(every[across - 1], [*AXIS_ENTRIES, *joins, *limited])
    return every


@dataclass(frozen=True, kw_only=True, eq=False)
class _SampledTrajectory:
    """A trajectory sampled on a grid that has both sides of every break.

    Attributes:
        times: (k,) s, rising; a single one if it takes no time.
        platform: (3, k, 3) angular velocity, acceleration and jerk, rad/s, rad/s^2, rad/s^3, in body axes.
        joints: (3, k, 2n + d) rates, accelerations and jerks of joints, in the same units.
        joins: (j,) s, where the platform's jerk may jump.
        jump: rad/s^3, largest jump of a component of the jerk at a join; 0 without joins.
    """

    times: np.ndarray
    platform: np.ndarray
    joints: np.ndarray
    joins: np.ndarray
    jump: float

    @classmethod
    def of(cls, trajectory: Trajectory) -> Self:
        """Sample a trajectory."""
        end = trajectory.duration
        grid = np.linspace(0.0, end, _GRID_INSTANTS if end > 0 else 1)
        after = np.unique(np.concatenate([trajectory.breaks, trajectory.joint_breaks]))
        after = after[(after > 0) & (after < end)]
        times = np.unique(np.concatenate([grid, after, np.nextafter(after, 0.0)]))
        values = trajectory.sample(times)
        joins = trajectory.breaks[1:-1] if trajectory.smoothness < _SMOOTH_JERK_ORDER else np.zeros(0)
        jerk = values.angular_jerk
        ends = np.searchsorted(times, joins)
        return cls(
            times=times,
            platform=np.stack([values.angular_velocity, values.angular_acceleration, jerk]),
            joints=np.stack([values.joint_rates, values.joint_accelerations, values.joint_jerks]),
            joins=joins,
            jump=float(np.max(np.abs(jerk[ends] - jerk[ends - 1]), initial=0.0)),
        )


def _sample_trajectories(
    trajectories: Mapping[str, Trajectory], spacecraft: Spacecraft
) -> dict[str, _SampledTrajectory]:
    """Check the arguments of a figure and sample its trajectories, by name; raises as `compare` does."""
    expect_trajectories(trajectories, spacecraft)
    if not trajectories:
        raise ValueError("there are no trajectories to draw")
    return {name: _SampledTrajectory.of(trajectory) for name, trajectory in trajectories.items()}


def _spin_limits(craft: Spacecraft) -> np.ndarray:
    """Return limits of rate, acceleration and jerk about each body axis.

    Returns:
        (3, 3) rad/s, rad/s^2, rad/s^3, a row for each quantity; infinite where there is no limit.
    """
    given = [quantity.given(craft) for quantity in SPIN]
    return np.stack([np.full(3, np.inf if limit is None else limit) for limit in given])


def _draw_limits(axes: Axes, limits: np.ndarray, styles: Sequence[Look], highest: float) -> Entries:
    """Draw limits of the curves of a panel; returns their legend entry, or none.

    Args:
        axes: the panel.
        limits: (c,) largest magnitudes, in radians; infinite where there is no limit.
        styles: of the curves.
        highest: largest magnitude of the curves, in radians; limits far above it are written, not drawn.
    """
    ends = both_sides(np.rad2deg(limits))
    return limit_lines(axes, ends, styles, np.rad2deg(highest), far=_FAR_LIMIT_RATIO)


def _add_titles_and_time_axis(
    every: list[Axes], titles: list[str], sampled: Mapping[str, _SampledTrajectory]
) -> None:
    """Write titles above the columns of panels and give all panels the same time axis."""
    end = max(float(one.times[-1]) for one in sampled.values())
    for column, title in enumerate(titles):
        plain(every[column].set_title(title, fontsize=TEXT))
        time_span(every[column :: len(titles)], end)
