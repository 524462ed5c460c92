"""All rows that a curve must keep."""

from collections.abc import Iterator

import numpy as np

from jaxplan.trajectory.global_spline.bases import Basis
from jaxplan.trajectory.global_spline.linear_rows import Joints, Nodes, Ranges, Tube
from jaxplan.trajectory.global_spline.motion import Motion
from jaxplan.trajectory.global_spline.place_rows import Loads, Zones
from jaxplan.trajectory.global_spline.problem import Problem
from jaxplan.trajectory.global_spline.rows import Family


def families(
    problem: Problem,
    basis: Basis,
    rows: np.ndarray,
    motion: Motion,
    coefficients: np.ndarray,
    duration: float,
    *,
    wanted: np.ndarray,
    tube: Tube | None,
    limited: bool,
) -> Iterator[Family]:
    """All rows at a curve.

    Args:
        problem: limits and zones.
        basis: of the curve.
        rows: (4, S, n) of the basis at the places.
        motion: of the curve at the places.
        coefficients: (n, A) of the curve.
        duration: s.
        wanted: (D, Z) rad, margins to keep.
        tube: about the nodes, or None.
        limited: whether limits of rates and loads are kept, or time will be stretched to them.
    """
    craft = problem.spacecraft
    if np.any(np.isfinite(motion.margins)):
        yield Zones(motion, rows, motion.margins - wanted)
    if craft.terminals:
        yield Ranges(coefficients, craft.joint_limits)
    if limited:
        if craft.terminals:
            of_joints = (craft.joint_rate_limits, craft.joint_acceleration_limits)
            for power, limit in enumerate(of_joints, start=1):
                yield Joints(f"joint {power}", power, basis, coefficients, 1 / (limit * duration**power))
        for q, (name, power) in enumerate(zip(problem.names, problem.powers, strict=True)):
            scale = 1 / (problem.limits[q] * duration**power)
            yield Loads(name, int(power), motion, q, scale, rows)
    if tube is not None:
        yield Nodes(tube, coefficients)
