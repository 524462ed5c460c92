"""The paper's scheme (section 4): how a path is cut into segments, and how these are planned one by one.

A path has m + 1 nodes and m *intervals* between them; a *segment* is a polynomial over ``n`` successive
intervals. It has ``l + 1`` coefficients an axis and must pass ``n + 1`` nodes. It takes two derivatives over
from its neighbour, or from the start of the motion, and should keep a coefficient for its objective; the one
that closes the chain takes two from the other end as well. So the closing segment (the last for the joints,
the first for the platform, which is planned backward) holds at most ``l - 4`` intervals, every other one
``l - 3``. The *counting rule* follows: ``m`` intervals fit into ``S`` segments exactly if
``m // S <= l - 4``.

The programs of a fit are assembled in one compiled call. Every segment works in ``x`` in [-1, 1], where
``d/dt = (2 / h) d/dx`` with ``h`` the segment's length. Its rows are written in ``x``: there a rate is
``h / 2`` times that in time, an acceleration ``(h / 2)^2`` times. A segment has as many *slots* for nodes as
the counting rule can fill; those left over repeat its last node and are marked absent. Nodes and segments are
padded to a few sizes, so that fits of different paths share the compiled kernel.

Segments are planned one after another, joints forward and platform backward. Every segment is a quadratic
program for the Legendre coefficients of each axis. A joint's segment takes rate and acceleration over from
the one before (18), the last one ends at the final rates (19). The platform is planned on charts of SO(3):
the curve ``b`` of a segment passes ``b(t_j) = eta(t_j) + (t_j - t_a) Omega`` at its nodes (32) and meets the
segment after it, whose chart starts there, with the transpose that (36) lacks in print:

    b'(t_b) = W^T omega,   b''(t_b) = W^T omega',   W = exp(-(t_b - t_a) Omega / 2)      (36)

and the first one starts at the initial rate (37): at a chart's start ``omega = b'`` and ``omega' = b''``
exactly (34). Where a segment will meet the next one to be planned, at a *join*, rates and accelerations are
held within their limits (20, whose first line means the rate, and 38). The objectives are (21) for the
joints, accelerations alone, and (43) for the platform.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module, arrays
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.paper import qp
from jaxplan.runtime.batching import run_all
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.splines import end_derivatives, energy, legendre

_CHART_REACH = 2.5  # rad, largest turn of a segment; a chart's logarithm must stay off half a turn


def fewest_segments(intervals: int, order: int) -> int:
    """The smallest number of segments that the counting rule (see the module) allows.

    Args:
        intervals: m, at least 1.
        order: degree ``l`` of the Legendre basis, at least `MIN_ORDER`.
    """
    return intervals // (order - 3) + 1


@cache
def split(intervals: int, segments: int, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Split a path into segments: indices of the nodes where those of the joints and of the platform end.

    Both are split equally wherever the counting rule allows it for both; otherwise the closing segments,
    which are at opposite ends, are the short ones.

    Args:
        intervals: m, at least 1.
        segments: S, from `fewest_segments` to m.
        order: degree of the Legendre basis.

    Returns:
        Two integer arrays (S + 1,), from 0 to m, read-only: joints, platform.
    """
    ends = [np.round(np.linspace(0, intervals, segments + 1)).astype(int)] * 2
    sizes = np.diff(ends[0])
    if max(sizes[0], sizes[-1]) > order - 4 or sizes.max() > order - 3:
        sizes = np.full(segments, intervals // segments)
        sizes[: intervals % segments] += 1
        ends = [np.concatenate([[0], np.cumsum(own)]) for own in (sizes, sizes[::-1])]
    for own in ends:
        own.flags.writeable = False
    return ends[0], ends[1]


def is_full(intervals: int, segments: int, order: int) -> bool:
    """Tell whether a closing segment has at most one coefficient left to minimise its objective with."""
    return segments < intervals and intervals // segments >= order - 5


def charts_suffice(turns: np.ndarray, ends: np.ndarray) -> bool:
    """Tell whether every segment of more than one interval can work in one chart.

    A segment whose edges turn by ``L`` in all has ``|eta| <= L`` along them, since ``eta`` is the rotation
    between two motions that start together and end together; below half a turn its logarithm does not jump. A
    single interval always works.

    Args:
        turns: (m, 3) rad, rotation vector of each edge.
        ends: (S + 1,) node indices where the platform's segments end.
    """
    turned = np.add.reduceat(np.linalg.norm(turns, axis=1), ends[:-1])
    return bool(np.all((turned <= _CHART_REACH) | (np.diff(ends) == 1)))


def shortest_duration(
    moves: ArrayLike, fractions: ArrayLike, rate_limits: ArrayLike, acceleration_limits: ArrayLike
) -> Any:
    """Estimate the duration in s in which differences of the nodes, from rest to rest, keep all limits.

    First differences are compared with rates, second ones with accelerations. It is differentiable, with
    numpy or JAX as the arguments are.

    Args:
        moves: (m, d) change of each axis along each edge, rad.
        fractions: (m + 1,) times of the nodes over the duration; an edge that takes no time is padding, and
            does not move.
        rate_limits: (d,) rad/s.
        acceleration_limits: (d,) rad/s^2.

    Returns:
        A number in s; a curve through the nodes needs more.
    """
    xp, moves, fractions, *limits = arrays(moves, fractions, rate_limits, acceleration_limits)
    shares = xp.diff(fractions)[:, None]
    own = shares > 0
    rates = xp.pad(xp.where(own, moves / xp.where(own, shares, 1), 0), ((1, 1), (0, 0)))
    between = xp.pad(xp.where(own, shares, 0), ((1, 1), (0, 0)))
    before = xp.where(between[:-1] > 0, between[:-1], between[1:])
    after = xp.where(between[1:] > 0, between[1:], between[:-1])
    middle = (before + after) / 2
    accelerations = xp.where(middle > 0, xp.diff(rates, axis=0) / xp.where(middle > 0, middle, 1), 0)
    by_rate = xp.max(xp.abs(rates) / limits[0])
    return xp.maximum(by_rate, xp.sqrt(xp.max(xp.abs(accelerations) / limits[1])))


@dataclass(frozen=True, kw_only=True, eq=False)
class Segments:
    """The programs of S segments, but for the derivatives that they take over from each other.

    Attributes:
        length: (S,) s, ``h``.
        objective: (S, l + 1, l + 1) quadratic form in the coefficients, scaled to order one.
        node_rows: (S, slots, l + 1) values of the basis at each node.
        node_values: (S, slots, d) rad, values of the curve wanted there.
        present: (S, slots) bool, which slots hold a node.
    """

    length: np.ndarray
    objective: np.ndarray
    node_rows: np.ndarray
    node_values: np.ndarray
    present: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Charts:
    """The charts of the platform's S segments.

    Attributes:
        attitude: (S, 3, 3) ``R_a``, body to inertial.
        rate: (S, 3) rad/s, ``Omega``.
        end_turn: (S, 3, 3) ``W`` at the segment's end, ``exp(-h Omega / 2)``.
    """

    attitude: np.ndarray
    rate: np.ndarray
    end_turn: np.ndarray


def assemble(
    *,
    attitudes: np.ndarray,
    joints: np.ndarray,
    times: np.ndarray,
    joint_ends: np.ndarray,
    platform_ends: np.ndarray,
    order: int,
    rate_weight: float,
    acceleration_weight: float,
) -> tuple[Segments, Segments, Charts]:
    """Assemble all programs of a fit.

    Args:
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n) rad.
        times: (m + 1,) s, increasing.
        joint_ends: (S + 1,) node indices where the joints' segments end, with 0 and m.
        platform_ends: (S + 1,) likewise for the platform.
        order: degree of the Legendre basis.
        rate_weight: ``lambda_1``, of the platform.
        acceleration_weight: ``lambda_2``, of the platform.

    Returns:
        Segments of the joints, segments of the platform (``node_values`` are those of ``b``), and the charts.
    """
    indices = [node_indices(ends, order - 2) for ends in (joint_ends, platform_ends)]
    joint_rows, rows, b, rate, end_turn = assembled(attitudes, times, *indices, order=order)

    def segments(
        ends: np.ndarray, node_rows: np.ndarray, values: np.ndarray, weights: tuple[float, float]
    ) -> Segments:
        length = np.diff(times[ends])
        # Objective (43) times (h / 2)^3, over the sum of the two weights that remain.
        first = weights[0] * (length / 2)[:, None, None] ** 2
        objective = (first * energy(order, 1) + weights[1] * energy(order, 2)) / (first + weights[1])
        present = np.arange(node_rows.shape[1]) <= np.diff(ends)[:, None]
        return Segments(
            length=length, objective=objective, node_rows=node_rows, node_values=values, present=present
        )

    return (
        segments(joint_ends, joint_rows, joints[indices[0]], (0.0, 1.0)),  # (21): no rate term
        segments(platform_ends, rows, b, (rate_weight, acceleration_weight)),
        Charts(attitude=attitudes[platform_ends[:-1]], rate=rate, end_turn=end_turn),
    )


def node_indices(ends: np.ndarray, slots: int) -> np.ndarray:
    """(S, slots) index of the node in each slot of S segments; slots that are left over repeat the last node.

    Args:
        ends: (S + 1,) node indices where segments end, the start included.
        slots: number of slots of each segment.
    """
    return np.minimum(ends[:-1, None] + np.arange(slots), ends[1:, None])


def assembled(
    attitudes: AnyArray, times: AnyArray, joint_nodes: AnyArray, platform_nodes: AnyArray, *, order: int
) -> tuple[AnyArray, ...]:
    """Compute all numbers of the quadratic programs that depend on the path's nodes, in numpy or JAX.

    Args:
        attitudes: (m + 1, 3, 3) of the nodes of the path, body to inertial.
        times: (m + 1,) s, when they are passed.
        joint_nodes: (S, slots) int, indices of the nodes on each of the S segments of the joints' curve; the
            last one is repeated on segments with fewer.
        platform_nodes: (S, slots) int, likewise of the platform's curve.
        order: degree l of the Legendre polynomials on a segment.

    Returns:
        Values of the polynomials at the nodes of joints and platform, (S, slots, l + 1) each; and, in the
        paper's symbols, ``b`` at the platform's nodes, (S, slots, 3) rad; ``Omega`` of each segment's chart,
        (S, 3) rad/s; and ``W`` (S, 3, 3) at the end of each segment.
    """
    xp = array_module(attitudes, times)

    def rows(times: AnyArray) -> AnyArray:
        start, end = times[:, :1], times[:, -1:]
        return legendre(2 * (times - start) / (end - start) - 1, order)

    own_times, own_attitudes = times[platform_nodes], attitudes[platform_nodes]
    relative = xp.swapaxes(own_attitudes[:, :1], -1, -2) @ own_attitudes  # R_a^T R_j
    tau = own_times - own_times[:, :1]
    rate = so3.log(relative[:, -1]) / tau[:, -1:]  # Omega of (25)
    turned = tau[..., None] * rate[:, None]
    back = so3.exp(-turned / 2)  # U_j^T
    b = so3.log(back @ relative @ back) + turned  # (32); the errata have it for nodes within a segment
    return rows(times[joint_nodes]), rows(own_times), b, rate, back[:, -1]


@dataclass(frozen=True, kw_only=True, eq=False)
class PathNodes:
    """The nodes that a trajectory must pass, with their times over the duration and the rates at its ends.

    Attributes:
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n) rad.
        fractions: (m + 1,) times over the duration, strictly increasing from 0 to 1.
        turns: (m, 3) rad, rotation vector of each edge in the axes of its first node.
        rates: (2, 3 + 2n) rad/s at start and end, of body axes and joints; accelerations are zero there.
    """

    attitudes: np.ndarray
    joints: np.ndarray
    fractions: np.ndarray
    turns: np.ndarray
    rates: np.ndarray

    @property
    def moves(self) -> np.ndarray:
        """(m, 3 + 2n) rad, for each of the m edges its rotation vector and its changes of the 2n joints."""
        return np.concatenate([self.turns, np.diff(self.joints, axis=0)], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainRequest:
    """A trajectory to be planned.

    Attributes:
        nodes: those to pass.
        duration: s.
        segments: number of segments, as the counting rule allows.
        settings: order and weights.
        limits: of the platform (2, 3) and of the joints (2, 2n): rates (rad/s) and accelerations (rad/s^2) at
            the joins; None for none.
    """

    nodes: PathNodes
    duration: float
    segments: int
    settings: TrajectorySettings
    limits: tuple[np.ndarray, np.ndarray] | None


def plan_chains(requests: Sequence[ChainRequest]) -> list[Trajectory | None]:
    """Plan many trajectories, all their segments; None for one with a program that has no solution."""
    pairs = [_make_chains(request) for request in requests]
    chains = [chain for _, *both in pairs for chain in both]
    run_all(chains, lambda _, programs: qp.solve_all(programs), most=max(len(chains), 1))
    return [_join_chains(request, *pair) for request, pair in zip(requests, pairs, strict=True)]


def _make_chains(request: ChainRequest) -> tuple[Charts, "Chain", "Chain"]:
    """Make the charts of a request, and the chains of the platform and of the joints, not planned yet."""
    nodes, settings = request.nodes, request.settings
    joint_ends, platform_ends = split(len(nodes.turns), request.segments, settings.order)
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
    start, end = np.stack([nodes.rates, np.zeros_like(nodes.rates)], axis=1)  # rates and accelerations
    return (
        charts,
        Chain(platform, end[:, :3], start[:, :3], platform_limits, end_turns=charts.end_turn),
        Chain(joints, start[:, 3:], end[:, 3:], joint_limits),
    )


def _join_chains(
    request: ChainRequest, charts: Charts, platform: "Chain", joints: "Chain"
) -> Trajectory | None:
    """Make the trajectory of two planned chains; None if one of them has a program without a solution."""
    if platform.failed or joints.failed:
        return None
    nodes = request.nodes
    times = nodes.fractions * request.duration
    joint_ends, platform_ends = split(len(nodes.turns), request.segments, request.settings.order)
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
    """Segments of the platform or of the joints, each planned with the end derivatives of the one before it.

    It is a `jaxplan.runtime.batching.Run` that asks for one quadratic program after the other.

    Attributes:
        coefficients: (S, l + 1, d) of the segments that are planned, zero for the others.
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
        """Make a chain of which no segment is planned yet.

        Args:
            segments: of the joints or of the platform.
            first: (2, d) rate and acceleration where the chain begins.
            last: (2, d) rate and acceleration where it ends.
            limits: (2, d) of rates and accelerations at the joins; None for none.
            end_turns: (S, 3, 3) ``W`` of the platform's charts, which makes the chain run backward; None for
                joints.
        """
        count, size = segments.objective.shape[:2]
        self.coefficients, self.failed = np.zeros((count, size, first.shape[1])), False
        self._segments, self._near_derivatives, self._final_derivatives = segments, first, last
        self._limits, self._end_turns = limits, end_turns
        near, far = (0, 1) if end_turns is None else (1, 0)  # of the two ends of a segment
        self._near_rows, self._far_rows = end_derivatives(size - 1)[near], end_derivatives(size - 1)[far]
        self._open_segments = list(range(count) if end_turns is None else reversed(range(count)))

    @property
    def _factors_to_x(self) -> np.ndarray:
        """(2, 1) factors from first and second time derivatives to those in ``x``, on the next segment."""
        half = self._segments.length[self._open_segments[0]] / 2
        return np.array([[half], [half**2]])

    def next_request(self) -> qp.SegmentQP | None:
        """Return the program of the next segment; None at the end of the chain or after a failure."""
        if not self._open_segments or self.failed:
            return None
        segments, k = self._segments, self._open_segments[0]
        if self._end_turns is not None:
            self._near_derivatives = self._near_derivatives @ self._end_turns[k]  # W^T omega, as rows
        present, to_x = segments.present[k], self._factors_to_x
        rows = [segments.node_rows[k, present], self._near_rows]
        values = [segments.node_values[k, present], self._near_derivatives * to_x]
        closing = len(self._open_segments) == 1
        if closing:
            rows.append(self._far_rows)
            values.append(self._final_derivatives * to_x)
        return qp.SegmentQP(
            objective=segments.objective[k],
            equalities=np.concatenate(rows),
            values=np.concatenate(values),
            limited=self._far_rows[:0] if self._limits is None or closing else self._far_rows,
            limits=self._final_derivatives[:0] if self._limits is None or closing else self._limits * to_x,
        )

    def accept(self, solution: np.ndarray | None) -> None:
        """Take the solution of the last program: (l + 1, d) coefficients, or None, which ends the chain."""
        if solution is None:
            self.failed = True
            return
        self._near_derivatives = self._far_rows @ solution / self._factors_to_x
        self.coefficients[self._open_segments.pop(0)] = solution
