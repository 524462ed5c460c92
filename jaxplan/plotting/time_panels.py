"""Angles, rates, accelerations and torques over time with their limits, of a plan or of several trajectories.

A figure of a plan is a table of `Panel`, each with curves, limits and labels; what there is, by which name
and in which unit, is the list of `jaxplan.model.limits`. They are the paper's Figures 8 to 11 and 13 to 15.

Several trajectories are given by their names; in `compare` the colour and line style of each are those of its
place among the names. At a break a trajectory is drawn from both sides, so that a jump is a vertical stroke.

A limit far from all curves of its panel is told above it instead of drawn, since the curves would shrink to a
line. Inside are radians and seconds, on the axes degrees and seconds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from jaxplan.model.limits import QUANTITIES, Kinematics, Quantity, timed_limits
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.planner import Plan
from jaxplan.plotting.style import (
    AXIS_STYLES,
    GREY,
    LENGTH_STYLE,
    SMALL,
    TEXT,
    Canvas,
    Entries,
    Look,
    Motion,
    both_sides,
    curve,
    device_entries,
    device_style,
    expect_trajectories,
    legend_beside,
    limit_lines,
    motion,
    note,
    panels,
    plain,
    time_axis,
    time_span,
)
from jaxplan.trajectory import Trajectory

_LONG = 10  # letters of a word, beside more of which its unit has no place
_FAR = 4.0  # times the highest value of a plan, beyond which a limit is told and not drawn
_FAR_OF_SEVERAL = 1.5  # likewise of several trajectories, whose panels are small
_BODY = ("body x", "body y", "body z")
_AXIS_ENTRIES: Entries = [
    (Line2D([], [], linewidth=1.6, **look), name) for look, name in zip(AXIS_STYLES, _BODY, strict=True)
]
_NODE: Look = {"marker": ".", "linestyle": "none"}
_INSTANTS = 880  # of the grid, besides both sides of some seventy breaks
_SMOOTH = 3  # continuous derivatives of the attitude, with which the jerk has no jumps
_GREY: Look = {"color": GREY}
_JOIN: Look = {"color": "0.7", "linewidth": 0.9, "linestyle": (0, (1, 2))}
# Of the platform's rate, acceleration and jerk.
_SPIN = sorted(
    (q for q in QUANTITIES if not (q.of_joints or q.by_inertia or q.of_length)), key=lambda q: q.power
)
_LENGTHS = {q.power: q for q in QUANTITIES if q.of_length}  # of those vectors, by their powers


class Panel(NamedTuple):
    """What one panel of a figure over time shows.

    Attributes:
        quantity: what is drawn.
        words: the quantity by the name of what it is of.
        values: (c, k) a row for each curve, in SI units.
        limits: (c, 2) likewise, least and largest; an infinite one is none.
        styles: of the curves.
        nodes: (c, m) at the path's nodes, or none.
    """

    quantity: Quantity
    words: str
    values: np.ndarray
    limits: np.ndarray
    styles: Sequence[Look]
    nodes: np.ndarray | None = None

    def draw(self, axes: Axes, moves: Motion) -> Entries:
        """Draw it; returns legend entries for limits, if there are any."""
        if not self.styles:
            note(axes, "no joints")
        shown = self.quantity.in_unit(self.values)
        for values, style in zip(shown, self.styles, strict=True):
            curve(axes, moves.times, values, **style)
        highest = float(np.max(np.abs(shown), initial=0.0))
        far = _FAR if self.quantity.power else np.inf
        entries = limit_lines(axes, self.quantity.in_unit(self.limits), self.styles, highest, far=far)
        for values, style in zip(() if self.nodes is None else self.nodes, self.styles, strict=False):
            dots = self.quantity.in_unit(values)
            axes.plot(moves.node_times, dots, color=style["color"], markersize=4.5, **_NODE)
        if not self.quantity.power:
            axes.yaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 1.5, 3, 5, 6, 9, 10]))
        axes.set_ylabel(_labelled(self.words, self.quantity), fontsize=TEXT)
        return entries


class Joints(NamedTuple):
    """A kind of joints: what their angles are called, which they are, and the first device that has one."""

    name: str
    which: slice
    device: int


def joint_kinds(craft: Spacecraft) -> list[Joints]:
    """The kinds of joints that a spacecraft has: yaws, pitches and drives' angles."""
    n, drives = len(craft.terminals), len(craft.drives)
    terminals = [Joints("yaw", slice(0, n), 0), Joints("pitch", slice(n, 2 * n), 0)] if n else []
    return terminals + ([Joints("drive", slice(2 * n, None), n)] if drives else [])


def _joint_panel(craft: Spacecraft, values: Kinematics, power: int, kind: Joints) -> Panel:
    """The panel of a kind of joints' angles, or of a derivative of them."""
    (quantity,) = (
        each
        for each in QUANTITIES
        if each.of_joints and each.power == power and (power or each.name == kind.name)
    )
    # a drive's angle is called so, the others by their joint
    words = f"{kind.name} {quantity.word}" if power or kind.name == "drive" else quantity.word
    given = (
        both_sides(np.asarray(quantity.given(craft))[kind.which]) if power else craft.joint_ranges[kind.which]
    )
    own = values.joints[power][kind.which]
    styles = [device_style(kind.device + place) for place in range(len(own))]
    return Panel(quantity, words, own, given, styles)


def _platform_panel(craft: Spacecraft, values: Kinematics, quantity: Quantity) -> Panel:
    """The components of a quantity along the body axes and, where that is limited, their length."""
    given = quantity.given(craft)
    curves, bounds = quantity.values(values), np.full(3, np.inf if given is None else given)
    length = _limited_length(craft, quantity)
    if length is None:
        return Panel(quantity, quantity.caption, curves, both_sides(bounds), AXIS_STYLES)
    curves = np.concatenate([curves, length.values(values)])
    bounds = np.append(bounds, length.given(craft))
    return Panel(quantity, quantity.caption, curves, both_sides(bounds), (*AXIS_STYLES, LENGTH_STYLE))


def _limited_length(craft: Spacecraft, quantity: Quantity) -> Quantity | None:
    """The length of a vector that a spacecraft limits; None where it does not, or the vector has none."""
    length = _LENGTHS.get(quantity.power) if quantity in _SPIN else None
    return None if length is None or length.given(craft) is None else length


def _axis_entries(craft: Spacecraft, quantity: Quantity) -> Entries:
    """Legend entries of the curves of a platform's panel."""
    length: Entries = [(Line2D([], [], linewidth=1.6, **LENGTH_STYLE), "length")]
    return [*_AXIS_ENTRIES, *(length if _limited_length(craft, quantity) else [])]


def _figure(
    plan: Plan, ax: Canvas, groups: Sequence[tuple[Entries, Sequence[Panel]]], moves: Motion, legend: bool
) -> list[Axes]:
    """Draw panels from top to bottom, with a legend beside the first of each group."""
    count = sum(len(group) for _, group in groups)
    grid = panels(ax, count, size(count))
    left = iter(grid)
    for owners, group in groups:
        own = [next(left) for _ in group]
        drawn = [panel.draw(axes, moves) for panel, axes in zip(group, own, strict=True)]
        if legend and owners:  # limits may be drawn on one panel and told on another
            legend_beside(own[0], [*owners, *max(drawn, key=len)])
    time_axis(grid, moves)
    return grid


def angles(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Joint angles of terminals and drives over time, with both ends of their ranges and the path's nodes.

    Args:
        plan: with a trajectory.
        ax: an axes for each of yaws, pitches and drives' angles that there are, from top to bottom; a figure
            to put them in, or None for a new one. Without joints there is one, which says so.
        legend: whether to name the devices beside the upper panel.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or another number of axes is given.
    """
    moves, craft = motion(plan), plan.scenario.spacecraft
    values = moves.values.kinematics(craft)
    shown = [_joint_panel(craft, values, 0, kind) for kind in joint_kinds(craft)]
    owners = _movers(craft)
    if not shown:
        (axes,) = panels(ax, 1, size(1))
        note(axes, "no joints")
        time_axis([axes], moves)
        return [axes]
    if plan.path is not None and len(plan.path.joints) == len(moves.node_times):
        nodes = [plan.path.joints.T[kind.which] for kind in joint_kinds(craft)]
        shown = [panel._replace(nodes=own) for panel, own in zip(shown, nodes, strict=True)]
        owners += [(Line2D([], [], color=GREY, **_NODE), "node of the path")]
    return _figure(plan, ax, [(owners, shown)], moves, legend)


def rates(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Joint rates and the platform's angular velocity over time, with limits.

    Args:
        plan: with a trajectory.
        ax: an axes for each of pitches, yaws and drives that there are, and one for the platform, from top
            to bottom; a figure to put them in; None for a new one.
        legend: whether to name curves beside the panels.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or another number of axes is given.
    """
    return _derivatives(plan, ax, 1, legend)


def accelerations(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
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
    return _derivatives(plan, ax, 2, legend)


def _derivatives(plan: Plan, ax: Canvas, power: int, legend: bool) -> list[Axes]:
    """Draw a derivative of pitches, yaws (the paper's order), drives and the platform's attitude."""
    moves, craft = motion(plan), plan.scenario.spacecraft
    values = moves.values.kinematics(craft)
    kinds = sorted(joint_kinds(craft), key=lambda kind: ("pitch", "yaw", "drive").index(kind.name))
    joints = [_joint_panel(craft, values, power, kind) for kind in kinds]
    groups = [(_movers(craft), joints)] * bool(joints)
    spin = _SPIN[power - 1]
    groups.append((_axis_entries(craft, spin), [_platform_panel(craft, values, spin)]))
    return _figure(plan, ax, groups, moves, legend)


def torque(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
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
    shown = limited_loads(craft) or [q for q in QUANTITIES if q.by_inertia and craft.inertia is not None]
    if not shown:
        raise ValueError(
            f"the spacecraft of {plan.scenario.name!r} has neither an inertia nor a limit of its jerk, "
            "so there is no torque to draw; give it spacecraft.inertia_kg_m2 or spacecraft.jerk_limit_deg_s3"
        )
    values = moves.values.kinematics(craft)
    group = [_platform_panel(craft, values, quantity) for quantity in shown]
    return _figure(plan, ax, [(_AXIS_ENTRIES, group)], moves, legend)


def limited_loads(craft: Spacecraft) -> list[Quantity]:
    """Quantities beside rates and accelerations that a spacecraft limits; `torque` has a panel of each."""
    limited = (limit.quantity for limit in timed_limits(craft)[0])
    return [quantity for quantity in limited if quantity.by_inertia or quantity.power > 2]


def draw_platform_rate(axes: Axes, moves: Motion, craft: Spacecraft) -> Entries:
    """Draw the platform's angular velocity by body axis on one panel; returns its legend entries."""
    panel = _platform_panel(craft, moves.values.kinematics(craft), _SPIN[0])
    return [*_axis_entries(craft, _SPIN[0]), *panel.draw(axes, moves)]


def _movers(craft: Spacecraft) -> Entries:
    """Legend entries of the devices that have joints."""
    return device_entries(craft.device_names[: craft.gimbals.count])


def _labelled(words: str, quantity: Quantity) -> str:
    """Label of a panel: words and unit, which stands on a line of its own below a long word."""
    below = len(words.split()[-1]) > _LONG and "\n" not in words
    between = "\n" if below else " "
    return f"{words}{between}({quantity.printed_unit})"


def size(count: int) -> tuple[float, float]:
    """Width and height in inches of a figure of so many panels."""
    return 9.0, 0.8 + 1.9 * count


def compare(
    trajectories: Mapping[str, Trajectory],
    spacecraft: Spacecraft,
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
        ax: twelve axes in three rows of four, without joints nine in rows of three; a figure to put them
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
    sampled = _sampled(trajectories, spacecraft)
    bounds = _spin_limits(spacecraft)
    titles, values = [*_BODY], [one.platform for one in sampled.values()]  # each (3, k, 3)
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
        limited = _limit(axes, bounds[row, column, None], [_GREY], highest[row, column]) or limited
    for quantity, axes in zip(_SPIN, every[::across], strict=True):
        axes.set_ylabel(_labelled(quantity.word, quantity), fontsize=TEXT)
    _finish(every, titles, sampled)
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
    sampled = _sampled(trajectories, spacecraft)
    across = len(sampled)
    every = panels(ax, 2 * across, (2.7 * across + 1.6, 4.8), columns=across)
    bounds, limited, joins = _spin_limits(spacecraft), Entries(), Entries()
    highest = np.max([np.max(np.abs(one.platform), axis=(1, 2)) for one in sampled.values()], axis=0)
    for axes, (row, one) in zip(every, product((1, 2), sampled.values()), strict=True):
        for time in one.joins:
            axes.axvline(time, zorder=1.4, **_JOIN)
            joins = [(Line2D([], [], **_JOIN), "join")]
        for values, look in zip(one.platform[row].T, AXIS_STYLES, strict=True):
            curve(axes, one.times, np.rad2deg(values), **{**look, "linewidth": 1.2})
        limited = _limit(axes, bounds[row], AXIS_STYLES, highest[row]) or limited
    _finish(every, list(sampled), sampled)
    for quantity, axes in zip(_SPIN[1:], every[::across], strict=True):
        axes.set_ylabel(f"platform angular\n{_labelled(quantity.word, quantity)}", fontsize=TEXT)
    for axes, one in zip(every[across:], sampled.values(), strict=True):
        jump = f"largest jump {np.rad2deg(one.jump):.2g} deg/s³" if len(one.joins) else "no jumps"
        axes.set_title(jump, fontsize=SMALL, color=GREY)
    if legend:
        legend_beside(every[across - 1], [*_AXIS_ENTRIES, *joins, *limited])
    return every


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sampled:
    """A trajectory on a grid with both sides of every break.

    Attributes:
        times: (k,) s, a single one if it takes no time.
        platform: (3, k, 3) rad/s, rad/s^2, rad/s^3, by body axis.
        joints: (3, k, 2n + d) likewise.
        joins: (j,) s, where the platform's jerk may jump.
        jump: rad/s^3, the largest one there; 0 without joins.
    """

    times: np.ndarray
    platform: np.ndarray
    joints: np.ndarray
    joins: np.ndarray
    jump: float

    @classmethod
    def of(cls, trajectory: Trajectory) -> Self:
        end = trajectory.duration
        grid = np.linspace(0.0, end, _INSTANTS if end > 0 else 1)
        after = np.unique(np.concatenate([trajectory.breaks, trajectory.joint_breaks]))
        after = after[(after > 0) & (after < end)]
        times = np.unique(np.concatenate([grid, after, np.nextafter(after, 0.0)]))
        values = trajectory.sample(times)
        joins = trajectory.breaks[1:-1] if trajectory.smoothness < _SMOOTH else np.zeros(0)
        jerk = values.angular_jerk
        ends = np.searchsorted(times, joins)
        return cls(
            times=times,
            platform=np.stack([values.angular_velocity, values.angular_acceleration, jerk]),
            joints=np.stack([values.joint_rates, values.joint_accelerations, values.joint_jerks]),
            joins=joins,
            jump=float(np.max(np.abs(jerk[ends] - jerk[ends - 1]), initial=0.0)),
        )


def _sampled(trajectories: Mapping[str, Trajectory], spacecraft: Spacecraft) -> dict[str, _Sampled]:
    expect_trajectories(trajectories, spacecraft)
    if not trajectories:
        raise ValueError("there are no trajectories to draw")
    return {name: _Sampled.of(trajectory) for name, trajectory in trajectories.items()}


def _spin_limits(craft: Spacecraft) -> np.ndarray:
    """Limits of rate, acceleration and jerk about each axis, (3, 3); infinite where there is none."""
    given = [quantity.given(craft) for quantity in _SPIN]
    return np.stack([np.full(3, np.inf if limit is None else limit) for limit in given])


def _limit(axes: Axes, limits: np.ndarray, styles: Sequence[Look], highest: float) -> Entries:
    """Draw limits beside a known highest value, all in radians; returns their legend entry, if drawn."""
    ends = both_sides(np.rad2deg(limits))
    return limit_lines(axes, ends, styles, np.rad2deg(highest), far=_FAR_OF_SEVERAL)


def _finish(every: list[Axes], titles: list[str], sampled: Mapping[str, _Sampled]) -> None:
    """Put titles above the columns of panels and the time below."""
    end = max(float(one.times[-1]) for one in sampled.values())
    for column, title in enumerate(titles):
        plain(every[column].set_title(title, fontsize=TEXT))
        time_span(every[column :: len(titles)], end)
