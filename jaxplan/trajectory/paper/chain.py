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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.model.scenario import TrajectorySettings
from jaxplan.runtime.batching import run_all
from jaxplan.trajectory.basis import end_derivatives
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.paper import counting, qp
from jaxplan.trajectory.paper.assembly import Charts, Segments, assemble


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


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainRequest:
    """What is to be planned.

    Attributes:
        nodes: to pass.
        duration: s.
        segments: how many, as the counting rule allows.
        settings: order and weights.
        limits: of the platform (2, 3) and of the joints (2, 2n): rates and accelerations at the joins; None
            for none.
    """

    nodes: Nodes
    duration: float
    segments: int
    settings: TrajectorySettings
    limits: tuple[np.ndarray, np.ndarray] | None


def plan_chains(requests: Sequence[ChainRequest]) -> list[Trajectory | None]:
    """Plans all segments of many trajectories; None where a program has no solution."""
    pairs = [_chains(request) for request in requests]
    chains = [chain for _, *both in pairs for chain in both]
    run_all(chains, lambda _, programs: qp.solve_all(programs), most=max(len(chains), 1))
    return [_joined(request, *pair) for request, pair in zip(requests, pairs, strict=True)]


def _chains(request: ChainRequest) -> tuple[Charts, "Chain", "Chain"]:
    """The charts of a request, and the chains of the platform and of the joints, of which none is planned."""
    nodes, settings = request.nodes, request.settings
    joint_ends, platform_ends = counting.split(len(nodes.turns), request.segments, settings.order)
    joints, platform, charts = assemble(
        attitudes=nodes.attitudes,
        joints=nodes.joints,
        times=nodes.fractions * request.duration,
        joint_ends=joint_ends,
        platform_ends=platform_ends,
        order=settings.order,
        rate_weight=settings.rate_weight,
        acceleration_weight=settings.acceleration_weight,
    )
    platform_limits, joint_limits = (None, None) if request.limits is None else request.limits
    return (
        charts,
        Chain(platform, nodes.end[0], nodes.start[0], platform_limits, end_turns=charts.end_turn),
        Chain(joints, nodes.start[1], nodes.end[1], joint_limits),
    )


def _joined(request: ChainRequest, charts: Charts, platform: "Chain", joints: "Chain") -> Trajectory | None:
    """The trajectory of two chains that are planned; None if one of them has a program without a solution."""
    if platform.failed or joints.failed:
        return None
    nodes = request.nodes
    times = nodes.fractions * request.duration
    joint_ends, platform_ends = counting.split(len(nodes.turns), request.segments, request.settings.order)
    return Trajectory(
        breaks=times[platform_ends],
        chart_attitude=charts.attitude,
        chart_start=times[platform_ends[:-1]],
        chart_rate=charts.rate,
        coefficients=platform.coefficients,
        joint_breaks=times[joint_ends],
        joint_coefficients=joints.coefficients,
        node_times=times,
        smoothness=2,
        method="paper",
    )


class Chain:
    """Segments of the platform or of the joints, each planned from what the one before it left.

    Attributes:
        coefficients: (S, l + 1, d) of the segments that are planned.
        failed: whether a program had no solution, which ends the chain.
    """

    def __init__(
        self,
        segments: Segments,
        first: np.ndarray,
        last: np.ndarray,
        limits: np.ndarray | None,
        *,
        end_turns: np.ndarray | None = None,
    ) -> None:
        """Begin with the first segment.

        Args:
            segments: of the joints or of the platform.
            first: (2, d) rate and acceleration where the chain begins.
            last: (2, d) likewise where it ends.
            limits: (2, d) at the joins, or None.
            end_turns: (S, 3, 3) ``W`` of the platform's charts, which makes the chain run backward.
        """
        count, size = segments.objective.shape[:2]
        self.coefficients, self.failed = np.zeros((count, size, first.shape[1])), False
        self._segments, self._derivatives, self._last = segments, first, last
        self._limits, self._end_turns = limits, end_turns
        near, far = (0, 1) if end_turns is None else (1, 0)  # of the two ends of a segment
        self._near_rows, self._far_rows = end_derivatives(size - 1)[near], end_derivatives(size - 1)[far]
        self._open = list(range(count) if end_turns is None else reversed(range(count)))

    @property
    def _to_x(self) -> np.ndarray:
        """(2, 1) from derivatives in time to those in ``x``, on the segment that is next."""
        half = self._segments.length[self._open[0]] / 2
        return np.array([[half], [half**2]])

    def next_request(self) -> qp.Program | None:
        """The program of the next segment; None at the end of the chain."""
        if not self._open or self.failed:
            return None
        segments, k = self._segments, self._open[0]
        if self._end_turns is not None:
            self._derivatives = self._derivatives @ self._end_turns[k]  # W^T omega, as rows
        present, to_x = segments.present[k], self._to_x
        rows = [segments.node_rows[k, present], self._near_rows]
        values = [segments.node_values[k, present], self._derivatives * to_x]
        closing = len(self._open) == 1
        if closing:
            rows.append(self._far_rows)
            values.append(self._last * to_x)
        return qp.Program(
            objective=segments.objective[k],
            equalities=np.concatenate(rows),
            values=np.concatenate(values),
            limited=self._far_rows[:0] if self._limits is None or closing else self._far_rows,
            limits=self._last[:0] if self._limits is None or closing else self._limits * to_x,
        )

    def accept(self, solution: np.ndarray | None) -> None:
        """Go on with the answer (l + 1, d) to the last program; None where it has no solution."""
        if solution is None:
            self.failed = True
            return
        self._derivatives = self._far_rows @ solution / self._to_x
        self.coefficients[self._open.pop(0)] = solution
