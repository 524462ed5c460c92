"""All rows that curves must keep."""

from collections.abc import Iterator

import numpy as np

from jaxplan.trajectory.global_spline.linear_rows import Joints, Nodes, Ranges
from jaxplan.trajectory.global_spline.place_rows import Loads, Zones
from jaxplan.trajectory.global_spline.rows import Family, stacked
from jaxplan.trajectory.global_spline.stack import Points, Stack


def families(stack: Stack, at: Points) -> Iterator[Family]:
    """All rows of a stack of tasks at curves of theirs."""
    kind, duration = stack.tasks[0], at.duration[:, None]
    problems = stack.problems
    crafts = [problem.spacecraft for problem in problems]
    if np.any(np.isfinite(at.motion.margins)):
        yield Zones(at.motion, stack.rows, at.motion.margins - stack.wanted[:, None])
    if crafts[0].terminals:
        yield Ranges(at.coefficients, np.stack([craft.joint_limits for craft in crafts]))
    if kind.limited:
        for each in zip(*(problem.joint_limits for problem in problems), strict=True):
            quantity, bound = each[0].quantity, np.stack([limit.bound for limit in each])
            differences = stacked([task.space.basis.differences[quantity.power] for task in stack.tasks])
            scale = 1 / (bound * duration**quantity.power)
            yield Joints(at.coefficients, quantity.name, quantity.power, differences, scale)
        first = problems[0]
        for q, (name, power) in enumerate(zip(first.names, first.powers, strict=True)):
            limit = np.stack([problem.limits[q] for problem in problems])
            yield Loads(name, int(power), at.motion, q, 1 / (limit * duration**power), stack.rows)
    if kind.tube is not None:
        yield Nodes(at.coefficients, stack.tube_rows, stack.tube_values, stack.tube_radius)
