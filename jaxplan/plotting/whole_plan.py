"""A plan in one figure, and all figures of a plan."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from jaxplan.plotting import margin_panel, motion_panels, samples, sphere_map
from jaxplan.plotting.canvas import new_figure
from jaxplan.plotting.given import expect_plan
from jaxplan.plotting.margin_panel import margins
from jaxplan.plotting.motion_panels import accelerations, angles, platform_rate, rates, torque
from jaxplan.plotting.sphere_map import sphere
from jaxplan.plotting.style import legend_beside
from jaxplan.plotting.timelines import time_axis

if TYPE_CHECKING:
    from jaxplan.planner import Plan

OVERVIEW_SIZE = (11.0, 9.0)  # inches
FIGURE_NAMES = ("overview", "sphere", "angles", "rates", "accelerations", "torque", "margins")
"""Of all the figures that a plan may have."""


def overview(plan: "Plan", ax: Figure | SubFigure | None = None) -> list[Axes]:
    """The unfolded sphere, and below it yaws and pitches, margins and the platform's angular velocity.

    Args:
        plan: with a trajectory.
        ax: a figure to fill, or None for a new one.

    Returns:
        The axes of sphere, yaws, pitches, margins and angular velocity, in this order; without terminals
        there are none of yaws and pitches.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory.
    """
    moves, craft = samples.motion(plan), plan.scenario.spacecraft
    figure = new_figure(OVERVIEW_SIZE) if ax is None else ax
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(5, 4))[:, 0]
    top = sphere(plan, ax=upper)
    grid = lower.subplots(2 if craft.terminals else 1, 2, sharex=True, squeeze=False)
    joints, others = (list(grid[:, 0]), list(grid[:, 1])) if craft.terminals else ([], list(grid[0]))
    if joints:
        angles(plan, ax=joints, legend=False)
    named, lines = margin_panel.draw(others[0], plan, moves)
    further = [entry for entry in named if entry[1] not in craft.device_names]  # the sphere names devices
    legend_beside(others[0], [*further, *lines])
    legend_beside(others[1], platform_rate(others[1], moves, craft))
    for column in [others] if joints else [[axes] for axes in others]:
        time_axis(column, moves)
    return [top, *joints, *others]


def figures(plan: "Plan") -> Iterator[tuple[str, Figure]]:
    """Every figure that a plan has, one after the other; none of them belongs to pyplot.

    Args:
        plan: of any status. Without a trajectory only the sphere is drawn, without terminals no angles,
            without zones no margins, and torque only where it, the momentum or the jerk has a limit.

    Yields:
        The figure's name, fit for a file, and the figure.

    Raises:
        TypeError: if it is no plan.
    """
    expect_plan(plan)
    terminals = bool(plan.scenario.spacecraft.terminals)
    zones = bool(plan.scenario.zones)
    dynamic = motion_panels.size(3 if terminals else 1)
    loads = motion_panels.load_limits(plan.scenario.spacecraft)
    moves = plan.trajectory is not None
    drawings: list[tuple[Callable[..., Any], tuple[float, float], bool]] = [
        (overview, OVERVIEW_SIZE, moves),
        (sphere, sphere_map.SIZE, True),
        (angles, motion_panels.size(2), moves and terminals),
        (rates, dynamic, moves),
        (accelerations, dynamic, moves),
        (torque, motion_panels.size(max(loads, 1)), moves and loads > 0),
        (margins, margin_panel.SIZE, moves and zones),
    ]
    for name, (draw, size, there) in zip(FIGURE_NAMES, drawings, strict=True):
        if there:
            figure = Figure(figsize=size, layout="constrained")
            draw(plan, ax=figure)
            yield name, figure
