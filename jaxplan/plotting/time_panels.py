"""Angles, rates, accelerations and torques of a plan over time, with their limits.

A figure of a plan is a column of `Panel`s, each with curves, limits and labels; which quantities there are,
with their names and units, is listed in `jaxplan.model.limits`. These are the paper's Figures 8 to 10 and 13
to 15.

A *load* is a quantity other than rates and accelerations that a spacecraft may limit: torque, angular
momentum, jerk, and the torques and momenta of wheels. A *reserve* is what a scenario keeps back of a limit
(`Scenario.robust`).

A limit far from all curves of its panel is written above it instead of drawn, since the curves would shrink
to a line. Values are in radians and seconds, the axes in degrees and seconds.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from jaxplan.model.kinematics import Kinematics
from jaxplan.model.limits import QUANTITIES, Quantity, timed_limits
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheel_reach import wheel_loads
from jaxplan.planner import Plan
from jaxplan.plotting.limit_lines import both_sides, limit_lines
from jaxplan.plotting.style import (
    AXIS_STYLES,
    GREY,
    LENGTH_STYLE,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
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
    time_axis,
    titled,
)
from jaxplan.plotting.tracks import band_entry, draw_band
from jaxplan.trajectory import total_momentum

_LONG_WORD = 10  # letters of a label's last word, beyond which the unit stands on a line of its own
_MAX_LEGEND_ROWS = 10  # most entries of a legend column that is not higher than its panel
_FAR_LIMIT_RATIO = 4.0  # multiple of a plan's highest value beyond which a limit is written and not drawn
BODY = ("body x", "body y", "body z")
AXIS_ENTRIES: Entries = [
    (Line2D([], [], linewidth=1.6, **look), name) for look, name in zip(AXIS_STYLES, BODY, strict=True)
]
_REDUCED_LIMIT_LABEL = "limit less\nthe reserve"  # what a reserve leaves; the whole limit is then dashed
_WHOLE_LIMIT_LINE: Look = {"linewidth": 1, "linestyle": (0, (5, 3))}
_NODE_MARK: Look = {"marker": ".", "linestyle": "none"}
# Quantities of the platform's rate, acceleration and jerk.
SPIN = sorted(
    (q for q in QUANTITIES if not (q.of_joints or q.by_inertia or q.of_length)), key=lambda q: q.power
)
_NORMS_BY_POWER = {q.power: q for q in QUANTITIES if q.of_length}  # of these vectors, by order of derivative


class Panel(NamedTuple):
    """What one panel of a figure over time shows: c curves at k times.

    Attributes:
        quantity: what is drawn.
        words: label of the vertical axis, without the unit.
        values: (c, k) a row for each curve, in SI units.
        limits: (c, 2) least and largest allowed value of each curve, in SI units; an infinite one is no
            limit.
        styles: of the curves.
        names: of the curves.
        nodes: (c, m) values at the m nodes of the path, in SI units; None for no dots.
        error: half width of a band about each curve (`jaxplan.plotting.tracks`), in SI units; zero for none.
        whole: (c, 2) the whole limits where `limits` is what a reserve leaves of them; None without a
            reserve.
    """

    quantity: Quantity
    words: str
    values: np.ndarray
    limits: np.ndarray
    styles: Sequence[Look]
    names: Sequence[str]
    nodes: np.ndarray | None = None
    error: float = 0.0
    whole: np.ndarray | None = None

    def draw(self, axes: Axes, moves: Motion) -> Entries:
        """Draw the panel at the times of a motion; returns legend entries for the limits that are drawn."""
        if not self.styles:
            note(axes, "no joints")
        shown = self.quantity.in_unit(self.values)
        for values, style in zip(shown, self.styles, strict=True):
            curve(axes, moves.times, values, **style)
            if self.error > 0:
                error = float(self.quantity.in_unit(self.error))
                draw_band(axes, moves.times, values, error, style["color"])
        highest = float(np.max(np.abs(shown), initial=0.0))
        far = _FAR_LIMIT_RATIO if self.quantity.power else np.inf
        ends = self.quantity.in_unit(self.limits)
        whole = ends if self.whole is None else self.quantity.in_unit(self.whole)
        reserved = not np.array_equal(whole, ends)
        name = _REDUCED_LIMIT_LABEL if reserved else "limit"
        entries = limit_lines(axes, ends, self.styles, highest, far=far, name=name, owners=self.names)
        if reserved and entries:  # else the whole limit is too far away as well
            entries += limit_lines(axes, whole, self.styles, highest, far=far, look=_WHOLE_LIMIT_LINE)
        for values, style in zip(() if self.nodes is None else self.nodes, self.styles, strict=False):
            dots = self.quantity.in_unit(values)
            axes.plot(moves.node_times, dots, color=style["color"], markersize=4.5, **_NODE_MARK)
        if not self.quantity.power:
            axes.yaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 1.5, 3, 5, 6, 9, 10]))
        axes.set_ylabel(labelled(self.words, self.quantity), fontsize=TEXT)
        return entries


class Joints(NamedTuple):
    """A kind of joints: the name of their angle, their indices, and the number of the first device."""

    name: str
    which: slice
    device: int


def joint_kinds(craft: Spacecraft) -> list[Joints]:
    """Return the kinds of joints that a spacecraft has: yaws, pitches and drives' angles, in this order."""
    n, drives = len(craft.terminals), len(craft.drives)
    terminals = [Joints("yaw", slice(0, n), 0), Joints("pitch", slice(n, 2 * n), 0)] if n else []
    return terminals + ([Joints("drive", slice(2 * n, None), n)] if drives else [])


def _joint_panel(craft: Spacecraft, values: Kinematics, power: int, kind: Joints) -> Panel:
    """Make the panel of a kind of joints, for their angles (`power` 0) or the derivative of that order."""
    (quantity,) = (
        each
        for each in QUANTITIES
        if each.of_joints and each.power == power and (power or each.name == kind.name)
    )
    # angles are called "yaw", "pitch" and "drive angle", rates "yaw rate" and so on
    words = f"{kind.name} {quantity.word}" if power or kind.name == "drive" else quantity.word
    given = (
        both_sides(np.asarray(quantity.given(craft))[kind.which]) if power else craft.joint_ranges[kind.which]
    )
    own = values.joints[power][kind.which]
    styles = [device_style(kind.device + place) for place in range(len(own))]
    return Panel(quantity, words, own, given, styles, craft.device_names[kind.device :][: len(own)])


def _platform_panel(craft: Spacecraft, values: Kinematics, quantity: Quantity) -> Panel:
    """Make the panel of a quantity of the platform or its wheels.

    It has a curve for each body axis and, if the norm of the vector is limited, one for the norm; or for a
    quantity of wheels one for each wheel.
    """
    ends = _allowed_range(craft, quantity)
    if quantity.of_wheels:
        curves = wheel_loads(values, craft)[0 if quantity.power == 2 else 1]
        styles = [device_style(number) for number in range(len(curves))]
        return Panel(quantity, quantity.caption, curves, ends, styles, [one.name for one in craft.wheels])
    curves, length = quantity.values(values), _limited_norm(craft, quantity)
    if length is None:
        return Panel(quantity, quantity.caption, curves, ends, AXIS_STYLES, BODY)
    curves = np.concatenate([curves, length.values(values)])
    return Panel(quantity, quantity.caption, curves, ends, (*AXIS_STYLES, LENGTH_STYLE), (*BODY, "length"))


def _load_panel(scenario: Scenario, values: Kinematics, quantity: Quantity) -> Panel:
    """Make the panel of a load, with the limit less the reserve, which a plan keeps, and the whole one."""
    whole = _allowed_range(scenario.spacecraft, quantity)
    return _platform_panel(scenario.usable, values, quantity)._replace(whole=whole)


def _allowed_range(craft: Spacecraft, quantity: Quantity) -> np.ndarray:
    """Return least and largest allowed values (c, 2) of the curves of `_platform_panel`, in SI units."""
    if quantity.of_wheels:
        by_time = quantity.power == 2
        return both_sides(np.array([one.torque if by_time else one.momentum for one in craft.wheels]))
    given, length = quantity.given(craft), _limited_norm(craft, quantity)
    bounds = np.full(3, np.inf if given is None else given)
    return both_sides(bounds if length is None else np.append(bounds, length.given(craft)))


def _limited_norm(craft: Spacecraft, quantity: Quantity) -> Quantity | None:
    """Return the quantity that is the norm of a vector quantity, if the spacecraft limits that; else None."""
    length = _NORMS_BY_POWER.get(quantity.power) if quantity in SPIN else None
    return None if length is None or length.given(craft) is None else length


def _axis_entries(craft: Spacecraft, quantity: Quantity) -> Entries:
    """Return legend entries for the curves of a panel of the platform: body axes and perhaps the norm."""
    length: Entries = [(Line2D([], [], linewidth=1.6, **LENGTH_STYLE), "length")]
    return [*AXIS_ENTRIES, *(length if _limited_norm(craft, quantity) else [])]


def _draw_groups(
    plan: Plan,
    ax: Canvas,
    groups: Sequence[tuple[Entries, Sequence[Panel]]],
    moves: Motion,
    words: str,
    legend: bool,
) -> list[Axes]:
    """Draw groups of panels from top to bottom; returns the axes.

    Args:
        plan: that is drawn.
        ax: axes, a figure or None, as users give it.
        groups: for each group the legend entries of its curves, and its panels.
        moves: the sampled motion.
        words: what is drawn, for the title.
        legend: whether to draw title and legends.
    """
    count = sum(len(group) for _, group in groups)
    grid = panels(ax, count, size(count))
    left = iter(grid)
    for owners, group in groups:
        own = [next(left) for _ in group]
        drawn = [panel.draw(axes, moves) for panel, axes in zip(group, own, strict=True)]
        if legend and owners:  # a limit may be drawn on one panel and written above another
            entries = [*owners, *max(drawn, key=len)]
            # of many curves each panel has a part of the names, so that none is higher than its panel
            each = len(entries) if len(entries) <= _MAX_LEGEND_ROWS else -(-len(entries) // len(own))
            for place, axes in enumerate(own):
                legend_beside(axes, entries[each * place : each * (place + 1)], rows=_MAX_LEGEND_ROWS)
    if legend:
        titled(grid[0], plan, words)
    time_axis(grid, moves)
    return grid


def angles(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw joint angles of terminals and drives over time, with their ranges and the path's nodes.

    Where the scenario allows for errors of joints, a band about each curve shows them.

    Args:
        plan: a plan with a trajectory.
        ax: one axes for each of yaws, pitches and drives' angles that the spacecraft has, from top to bottom;
            a figure to put them in, or None for a new one. Without joints there is one, which says so.
        legend: whether to name the devices beside the panels, and the plan above them.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or another number of axes is given.
    """
    plan = expect_plan(plan)
    moves, craft = motion(plan), plan.scenario.spacecraft
    values = moves.values.kinematics(craft)
    shown = [_joint_panel(craft, values, 0, kind) for kind in joint_kinds(craft)]
    owners = _joint_device_entries(craft)
    if not shown:
        (axes,) = panels(ax, 1, size(1))
        note(axes, "no joints")
        time_axis([axes], moves)
        return [axes]
    if plan.path is not None and len(plan.path.joints) == len(moves.node_times):
        nodes = [plan.path.joints.T[kind.which] for kind in joint_kinds(craft)]
        shown = [panel._replace(nodes=own) for panel, own in zip(shown, nodes, strict=True)]
        owners += [(Line2D([], [], color=GREY, **_NODE_MARK), "node of the path")]
    if plan.scenario.robust is not None:
        error = float(plan.scenario.robust.joint_error)
        shown = [panel._replace(error=error) for panel in shown]
        owners += band_entry(error) if error > 0 else []
    return _draw_groups(plan, ax, [(owners, shown)], moves, "angles of joints", legend)


def rates(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw joint rates and the platform's angular velocity, in body axes, over time, with limits.

    Args:
        plan: a plan with a trajectory.
        ax: one axes for each of yaws, pitches and drives that the spacecraft has, and one for the platform,
            from top to bottom; a figure to put them in, or None for a new one.
        legend: whether to name curves beside the panels, and the plan above them.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or another number of axes is given.
    """
    return _draw_derivatives(plan, ax, 1, legend)


def accelerations(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw joint accelerations and the platform's angular acceleration, in body axes, over time, with limits.

    Args:
        plan: a plan with a trajectory.
        ax: as for `rates`.
        legend: whether to name curves beside the panels, and the plan above them.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or another number of axes is given.
    """
    return _draw_derivatives(plan, ax, 2, legend)


def _draw_derivatives(plan: Plan, ax: Canvas, power: int, legend: bool) -> list[Axes]:
    """Draw the rates (`power` 1) or accelerations (2) of yaws, pitches, drives and the platform."""
    plan = expect_plan(plan)
    moves, craft = motion(plan), plan.scenario.spacecraft
    values = moves.values.kinematics(craft)
    joints = [_joint_panel(craft, values, power, kind) for kind in joint_kinds(craft)]
    groups = [(_joint_device_entries(craft), joints)] * bool(joints)
    spin = SPIN[power - 1]
    groups.append((_axis_entries(craft, spin), [_platform_panel(craft, values, spin)]))
    return _draw_groups(plan, ax, groups, moves, "rates" if power == 1 else "accelerations", legend)


def torque(plan: Plan, ax: Canvas = None, *, legend: bool = True) -> list[Axes]:
    """Draw torque, angular momentum and jerk of the platform over time, and torques and momenta of wheels.

    Where a scenario keeps a reserve of the limits of torque and momentum (`Scenario.robust`), what is left is
    drawn as "limit less the reserve", and the whole limit dashed beyond it.

    Args:
        plan: a plan with a trajectory.
        ax: one axes for each of torque, momentum and jerk that the spacecraft limits, and for the torques and
            momenta of its wheels, from top to bottom; a figure to put them in, or None for a new one. If none
            is limited, torque and momentum are shown.
        legend: whether to name curves beside the panels, and the plan above them.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, the spacecraft has neither an inertia nor a limit of its
            jerk, or another number of axes is given.
    """
    plan = expect_plan(plan)
    moves, craft = motion(plan), plan.scenario.usable
    shown = limited_loads(craft) or [
        q for q in QUANTITIES if q.by_inertia and not q.of_wheels and craft.inertia is not None
    ]
    if not shown:
        raise ValueError(
            f"the spacecraft of {plan.scenario.name!r} has neither an inertia nor a limit of its jerk, "
            "so there is no torque to draw; give it spacecraft.inertia_kg_m2 or spacecraft.jerk_limit_deg_s3"
        )
    total = None if plan.trajectory is None else total_momentum(plan.trajectory, craft)
    values = moves.values.kinematics(craft, total)
    own, of_wheels = (
        [_load_panel(plan.scenario, values, quantity) for quantity in shown if quantity.of_wheels == wheels]
        for wheels in (False, True)
    )
    entries = device_entries([wheel.name for wheel in craft.wheels]) if of_wheels else []
    groups = [(AXIS_ENTRIES, own), (entries, of_wheels)]
    return _draw_groups(
        plan, ax, [(names, group) for names, group in groups if group], moves, "loads", legend
    )


def limited_loads(craft: Spacecraft) -> list[Quantity]:
    """Return the loads that a spacecraft limits; `torque` has a panel for each."""
    limited = (limit.quantity for limit in timed_limits(craft)[0])
    return [quantity for quantity in limited if quantity.by_inertia or quantity.power > 2]


def draw_platform_rate(axes: Axes, moves: Motion, craft: Spacecraft) -> Entries:
    """Draw the platform's angular velocity by body axis on one panel; returns its legend entries."""
    panel = _platform_panel(craft, moves.values.kinematics(craft), SPIN[0])
    return [*_axis_entries(craft, SPIN[0]), *panel.draw(axes, moves)]


def joint_panels(craft: Spacecraft, moves: Motion) -> list[Callable[[Axes], Entries]]:
    """Return for each kind of joints a function that draws their angles with ranges on a panel.

    Each of the functions returns legend entries.
    """
    values = moves.values.kinematics(craft)
    found: list[Callable[[Axes], Entries]] = []
    for kind in joint_kinds(craft):
        panel = _joint_panel(craft, values, 0, kind)
        owners = device_entries(craft.device_names)[kind.device : kind.device + len(panel.styles)]
        found.append(lambda axes, panel=panel, owners=owners: [*owners, *panel.draw(axes, moves)])  # type: ignore[misc]
    return found


def draw_wheel_momenta(axes: Axes, plan: Plan, moves: Motion) -> Entries:
    """Draw the angular momentum of each wheel on one panel; returns its legend entries."""
    craft = plan.scenario.usable
    total = None if plan.trajectory is None else total_momentum(plan.trajectory, craft)
    values = moves.values.kinematics(craft, total)
    (held,) = (quantity for quantity in QUANTITIES if quantity.of_wheels and quantity.power == 1)
    panel = _load_panel(plan.scenario, values, held)
    return [*device_entries([wheel.name for wheel in craft.wheels]), *panel.draw(axes, moves)]


def _joint_device_entries(craft: Spacecraft) -> Entries:
    """Return legend entries for the devices that have joints."""
    return device_entries(craft.device_names[: craft.gimbals.count])


def labelled(words: str, quantity: Quantity) -> str:
    """Return the label of a panel: words, then the unit, on a line of its own after a long word."""
    below = len(words.split()[-1]) > _LONG_WORD and "\n" not in words
    between = "\n" if below else " "
    return f"{words}{between}({quantity.printed_unit})"


def size(count: int) -> tuple[float, float]:
    """Return width and height in inches of a figure of `count` panels."""
    return WIDTH, 0.8 + 1.75 * count
