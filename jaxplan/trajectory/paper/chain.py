"""The paper's scheme: segments planned one after another, joints forward and platform backward (section 4).

Every segment is a quadratic program for the Legendre coefficients of each axis. A joint's segment takes
rate and acceleration over from the one before (18), the last one ends at the final rates (19). The platform
is planned on charts of SO(3): the curve ``b`` of a segment passes ``b(t_j) = eta(t_j) + (t_j - t_a) Omega``
at its nodes (32) and meets the segment after it, whose chart starts there, with the transpose that (36)
lacks in print:

    b'(t_b) = W^T omega,   b''(t_b) = W^T omega',   W = exp(-(t_b - t_a) Omega / 2)      (36)

and the first one starts at the initial rate (37): at a chart's start ``omega = b'`` and ``omega' = b''``
exactly (34). Where a segment will meet the next one to be planned, rates and accelerations are held within
their limits (20, whose first line means the rate, and 38). The objectives are (21) for the joints,
accelerations alone, and (43) for the platform.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.model.scenario import TrajectorySettings
from jaxplan.trajectory.asking import Ask, Steps, in_turn
from jaxplan.trajectory.basis import end_derivatives
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.paper import counting, qp
from jaxplan.trajectory.paper.assembly import Segments, assemble


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """What a trajectory must pass, without its duration.

    Attributes:
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n) rad.
        fractions: (m + 1,) of the duration, strictly increasing from 0 to 1.
        turns: (m, 3) rad, rotation of each edge in the axes of its first node.
        start: of the platform (2, 3) and of the joints (2, 2n): rate and acceleration per s and s^2.
        end: likewise.
    """

    attitudes: np.ndarray
    joints: np.ndarray
    fractions: np.ndarray
    turns: np.ndarray
    start: tuple[np.ndarray, np.ndarray]
    end: tuple[np.ndarray, np.ndarray]

    @property
    def moves(self) -> np.ndarray:
        """(m, 3 + 2n) rad: rotation and joint changes of each edge."""
        return np.concatenate([self.turns, np.diff(self.joints, axis=0)], axis=1)


def fit_nodes(
    nodes: Nodes,
    duration: float,
    segments: int,
    settings: TrajectorySettings,
    limits: tuple[np.ndarray, np.ndarray] | None,
) -> Steps[Trajectory | None]:
    """Plans all segments; asks for the answers to their programs.

    Args:
        nodes: to pass.
        duration: s.
        segments: how many, as the counting rule allows.
        settings: order and weights.
        limits: of the platform (2, 3) and of the joints (2, 2n): rates and accelerations at the joins; None
            for none.

    Returns:
        The trajectory, or None if a program has no solution.
    """
    times = nodes.fractions * duration
    joint_ends, platform_ends = counting.split(len(nodes.turns), segments, settings.order)
    joints, platform, charts = yield in_turn(
        assemble,
        attitudes=nodes.attitudes,
        joints=nodes.joints,
        times=times,
        joint_ends=joint_ends,
        platform_ends=platform_ends,
        order=settings.order,
        rate_weight=settings.rate_weight,
        acceleration_weight=settings.acceleration_weight,
    )
    platform_limits, joint_limits = (None, None) if limits is None else limits
    b = yield from _chain(platform, nodes.end[0], nodes.start[0], platform_limits, end_turns=charts.end_turn)
    if b is None:
        return None
    angles = yield from _chain(joints, nodes.start[1], nodes.end[1], joint_limits)
    if angles is None:
        return None
    return Trajectory(
        breaks=times[platform_ends],
        chart_attitude=charts.attitude,
        chart_start=times[platform_ends[:-1]],
        chart_rate=charts.rate,
        coefficients=b,
        joint_breaks=times[joint_ends],
        joint_coefficients=angles,
        node_times=times,
        smoothness=2,
        method="paper",
    )


def _chain(
    segments: Segments,
    first: np.ndarray,
    last: np.ndarray,
    limits: np.ndarray | None,
    *,
    end_turns: np.ndarray | None = None,
) -> Steps[np.ndarray | None]:
    """Plans the segments of a chain, each from what the one before it left.

    Args:
        segments: of the joints or of the platform.
        first: (2, d) rate and acceleration where the chain begins.
        last: (2, d) likewise where it ends.
        limits: (2, d) at the joins, or None.
        end_turns: (S, 3, 3) ``W`` of the platform's charts, which makes the chain run backward.

    Returns:
        (S, l + 1, d) coefficients, or None if a program has no solution.
    """
    count = len(segments.length)
    near, far = (0, 1) if end_turns is None else (1, 0)  # of the two ends of a segment
    size = segments.objective.shape[1]
    coefficients = np.zeros((count, size, first.shape[1]))
    end_rows = end_derivatives(size - 1)
    near_rows, far_rows = end_rows[near], end_rows[far]
    derivatives = first
    for k in range(count) if end_turns is None else reversed(range(count)):
        closing = k == (count - 1 if end_turns is None else 0)
        if end_turns is not None:
            derivatives = derivatives @ end_turns[k]  # W^T omega, as rows
        half = segments.length[k] / 2
        to_x = np.array([[half], [half**2]])  # from derivatives in time to those in x
        present = segments.present[k]
        rows = [segments.node_rows[k, present], near_rows]
        values = [segments.node_values[k, present], derivatives * to_x]
        if closing:
            rows.append(far_rows)
            values.append(last * to_x)
        limited = limits is not None and not closing
        program = qp.Program(
            objective=segments.objective[k],
            equalities=np.concatenate(rows),
            values=np.concatenate(values),
            limited=far_rows if limited else far_rows[:0],
            limits=limits * to_x if limited else last[:0],
        )
        solution: np.ndarray | None = yield Ask(qp.solve_all, program)
        if solution is None:
            return None
        coefficients[k] = solution
        derivatives = far_rows @ solution / to_x
    return coefficients
