"""Goals and paths, the motion between two nodes of a path, and nodes that move with a path's ends.

A path is a sequence of *nodes*, which are states, connected by *edges*. Along an edge the platform follows
the geodesic and the joints change linearly, all at constant speed: ``R(s) = R0 exp(s phi^)``,
``q(s) = q0 + s dq`` with ``s`` in [0, 1], where ``phi`` is the rotation vector of the edge in body axes. Its
margins are bounded from below over the whole edge from a few samples, by the bounds of
`jaxplan.model.scores`.

The cost of an edge is counted in steps, ``max(rotation / attitude step, |dq_j| / joint step_j)``, which is
the duration of the move if every step takes the same time. There are 2n + d joints of n terminals and d
drives: all yaws, all pitches, all drives' angles.

A motion is *straight* if platform and joints turn at constant rates. A search cuts such motions into edges of
one step. So a node on the straight motion that leaves the start, or on the one that reaches the goal (a
*lead*), was not chosen by itself: when that end moves, the node keeps its fraction of the motion. If the
whole path is straight, this holds for every node. `Leads`, which moves nodes, computes with numpy or JAX.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, length, max_along, min_along
from jaxplan.model import constraints
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import Sights
from jaxplan.model.goals import GivenState
from jaxplan.model.scores import edge_bound, margins_of_scores, score_curvature, scores
from jaxplan.runtime.display import shown

_LINE_TOLERANCE = 1e-9  # rad; an edge that is off a line by no more than this lies on it


@shown(
    "time s",
    "slew_angle deg",
    "joints deg",
    "angular_velocity deg/s",
    "joint_rates deg/s",
    "attitude",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Goal:
    """The state in which the manoeuvre ends; with time and rates where targets or zones move.

    Attributes:
        attitude: (3, 3) body to inertial.
        joints: (2n + d,) rad: yaws, pitches, drives.
        slew_angle: rad, rotation of the platform from the start.
        time: s, at which the manoeuvre must end, since moving targets were taken where they are then; 0 where
            nothing moves.
        angular_velocity: (3,) rad/s of the platform at the goal, body axes; None for the one that the
            scenario states.
        joint_rates: (2n + d,) rad/s at the goal; None likewise. With both rates the devices follow their
            targets.
    """

    attitude: np.ndarray
    joints: np.ndarray
    slew_angle: float
    time: float = 0.0
    angular_velocity: np.ndarray | None = None
    joint_rates: np.ndarray | None = None

    @property
    def state(self) -> GivenState:
        """The goal as a `GivenState`, which can be the goal or the start of a scenario.

        Rates that are None in the goal are left out.
        """
        names = ("angular_velocity", "joint_rates")
        rates = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return GivenState(rotation_vector=np.asarray(so3.log(self.attitude)), joints=self.joints, **rates)


@shown("edges", "length steps", "edge_costs steps", "joints deg", "attitudes")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """A sequence of m + 1 nodes from start to goal.

    Attributes:
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n + d) rad.
        edge_costs: (m,) cost of each edge in steps; a trajectory divides its duration in proportion to them.
    """

    attitudes: np.ndarray
    joints: np.ndarray
    edge_costs: np.ndarray

    @property
    def length(self) -> float:
        """Cost of the whole path in steps, the sum of those of its edges."""
        return float(np.sum(self.edge_costs))

    @property
    def edges(self) -> int:
        """Number of edges, m."""
        return len(self.edge_costs)


def halve(path: Path) -> Path:
    """Return the same path with another node in the middle of every edge.

    Args:
        path: a path with m edges.

    Returns:
        A path with 2m edges, each of half the cost.
    """
    nodes = 2 * path.edges + 1
    attitudes, joints = np.empty((nodes, 3, 3)), np.empty((nodes, path.joints.shape[1]))
    attitudes[::2] = path.attitudes
    attitudes[1::2] = so3.geodesic(path.attitudes[:-1], path.attitudes[1:], 0.5)
    joints[::2], joints[1::2] = path.joints, (path.joints[:-1] + path.joints[1:]) / 2
    return Path(attitudes=attitudes, joints=joints, edge_costs=np.repeat(path.edge_costs / 2, 2))


def step_cost(
    rotation: ArrayLike, joint_change: ArrayLike, attitude_step: ArrayLike, joint_steps: ArrayLike
) -> AnyArray:
    """Return the cost of a motion in steps: the largest of those of the platform and of all joints.

    Args:
        rotation: (...) rad, angle of the platform's rotation.
        joint_change: (..., 2n + d) rad.
        attitude_step: rad of rotation in one step.
        joint_steps: (2n + d,) rad of each joint in one step.

    Returns:
        (...) steps, not rounded.
    """
    xp, turn, change, step, steps = arrays(rotation, joint_change, attitude_step, joint_steps)
    return xp.maximum(turn / step, xp.max(xp.abs(change) / steps, axis=-1, initial=0.0))


def motion(
    attitude: ArrayLike, joints: ArrayLike, turn: ArrayLike, joint_change: ArrayLike, fraction: ArrayLike
) -> tuple[AnyArray, AnyArray]:
    """Return states along an edge.

    Args:
        attitude: (3, 3) where the edge starts, body to inertial.
        joints: (2n + d,) rad, where the edge starts.
        turn: (3,) rad, rotation vector ``phi`` of the edge, body axes.
        joint_change: (2n + d,) rad, ``dq``.
        fraction: (k,) fractions of the edge, in [0, 1].

    Returns:
        (k, 3, 3) attitudes, body to inertial, and (k, 2n + d) joints, rad.
    """
    xp, start, angles, phi, change, s = arrays(attitude, joints, turn, joint_change, fraction)
    steps = so3.exp(s[:, None] * phi)
    # a product and a sum instead of a small matrix product: it fuses with what surrounds it
    attitudes = xp.sum(start[:, :, None] * steps[:, None], axis=-2)
    return attitudes, angles + s[:, None] * change


def interval_scores(
    rows: Constraints,
    sights: Sights,
    attitude: ArrayLike,
    joints: ArrayLike,
    turn: ArrayLike,
    joint_change: ArrayLike,
    intervals: int,
) -> Array:
    """Return an upper bound of every row's score on each interval of one edge.

    A score is a margin without its arc cosine, larger where the margin is smaller (`jaxplan.model.scores`).

    Args:
        rows: the constraints, Z rows of which no axis moves.
        sights: the directions that they bind.
        attitude: (3, 3) where the edge starts, body to inertial.
        joints: (2n + d,) rad, where the edge starts.
        turn: (3,) rad, rotation vector ``phi`` of the edge, body axes.
        joint_change: (2n + d,) rad, ``dq``.
        intervals: number of equal intervals, static; with more of them the bound is sharper.

    Returns:
        (intervals, Z), for the worst sight that each row binds; -inf where it binds none.
    """
    turn_vector = jnp.asarray(turn)
    fraction = jnp.arange(intervals + 1) / intervals
    attitudes, angles = motion(attitude, joints, turn_vector, joint_change, fraction)
    seen = sights.in_body(angles)  # (intervals + 1, S, 3)
    turned = jnp.sum(attitudes[:, None] * jnp.asarray(rows.axis)[:, :, None], axis=-2)
    axes = constraints.axes_in_body(rows, turned, seen)
    cosines = jnp.sum(seen[:, :, None] * axes[:, None], axis=-1)  # (intervals + 1, S, Z)
    values = constraints.joint_values(rows, sights.gimbals, angles) if rows.inner else None
    score = scores(rows, cosines, values)
    bend = score_curvature(rows, length(turn_vector), *sights.bounds(joint_change))
    bound = edge_bound(score[:-1], score[1:], bend / (2 * intervals**2))
    return max_along(jnp.where(rows.bound.T, bound, -jnp.inf), -2)


def edge_margins(
    rows: Constraints,
    sights: Sights,
    attitude: ArrayLike,
    joints: ArrayLike,
    turn: ArrayLike,
    joint_change: ArrayLike,
    intervals: int,
) -> Array:
    """Return a lower bound of every constraint's margin over one whole edge.

    Arguments are as for `interval_scores`.

    Returns:
        (Z,) rad, at the first row of each constraint; +inf for its other rows and for padding. It is good to
        about 1e-8 rad where a sight lies on a cone's axis, else to rounding.
    """
    worst = interval_scores(rows, sights, attitude, joints, turn, joint_change, intervals)
    margin = jnp.where(worst == -jnp.inf, jnp.inf, margins_of_scores(rows, worst))
    return min_along(constraints.best_entries(rows, margin), 0)


@shown("first", "second", "share")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Leads:
    """Where the m + 1 nodes of a path lie on the straight motions next to its ends.

    Attributes:
        first: (m + 1,) int, number of the node at which the straight motion begins on which each node lies;
            for a node that lies on none its own number.
        second: (m + 1,) int, number of the node at which that motion ends; likewise.
        share: (m + 1,) fraction of that motion at which the node lies; zero for a node that lies on none.
        turn: (m + 1, 3) rad, rotation vector of the platform over the whole motion, body axes at its
            beginning; it may exceed half a turn.
    """

    first: np.ndarray
    second: np.ndarray
    share: np.ndarray
    turn: np.ndarray

    def nodes(self, attitudes: AnyArray, joints: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return all nodes, with those on straight motions put back onto these after the ends have moved.

        Args:
            attitudes: (m + 1, 3, 3) body to inertial, with the ends where they are now.
            joints: (m + 1, J) rad, likewise, of J joints.

        Returns:
            Attitudes (m + 1, 3, 3) and joints (m + 1, J).
        """
        start, turn = attitudes[self.first], self._rotation_vectors(attitudes)
        moves = joints[self.second] - joints[self.first]
        turned = start @ so3.exp(self.share[:, None] * turn)
        return turned, joints[self.first] + self.share[:, None] * moves

    def _rotation_vectors(self, attitudes: AnyArray) -> AnyArray:
        """Return the rotation vectors (m + 1, 3) rad of the straight motions, turning the way of `turn`."""
        xp = array_module(attitudes)
        turn = so3.log(xp.swapaxes(attitudes[self.first], -1, -2) @ attitudes[self.second])
        angle = length(turn)
        other_way = xp.sum(turn * self.turn, axis=-1) < 0
        return turn * (1 - xp.where(other_way, 2 * np.pi / xp.where(angle > 0, angle, 1), 0))[:, None]


def leads_of(attitudes: np.ndarray, joints: np.ndarray, nodes: int | None = None) -> Leads:
    """Find the leads of a path.

    Args:
        attitudes: (m + 1, 3, 3) of its nodes, body to inertial.
        joints: (m + 1, J) rad, of its nodes, for J joints.
        nodes: number of nodes before the padding; None if there is no padding.
    """
    count = len(attitudes)
    turns = so3.log(np.swapaxes(attitudes[:-1], -1, -2) @ attitudes[1:])[: (nodes or count) - 1]
    edges = np.concatenate([turns, np.diff(joints, axis=0)[: len(turns)]], axis=1)
    own = np.minimum(np.arange(count), (nodes or count) - 1)  # padded nodes equal the last one
    first, second = own.copy(), own.copy()
    share, turn = np.zeros(count), np.zeros((count, 3))
    last = len(edges)
    ahead = _count_straight_edges(edges)
    behind = last - _count_straight_edges(edges[::-1])
    for begin, end in {(0, ahead), (behind, last)}:
        steps = np.linalg.norm(edges[begin:end], axis=1)
        if end - begin < 2 or not np.sum(steps):
            continue
        inner = slice(begin + 1, end)
        first[inner], second[inner] = begin, end
        share[inner] = (np.cumsum(steps) / np.sum(steps))[:-1]
        turn[inner] = np.sum(turns[begin:end], axis=0)
    return Leads(first=first, second=second, share=share, turn=turn)


def _count_straight_edges(edges: np.ndarray) -> int:
    """Return how many of the first edges lie along one line, within less than a whole turn of the platform.

    Args:
        edges: (m, 3 + J) rad, changes along each edge: rotation vector of the platform, then joints.
    """
    steps = np.linalg.norm(edges, axis=1)
    moving = np.flatnonzero(steps)
    if not len(moving):
        return 0
    along = edges[moving[0]] / steps[moving[0]]
    ways = edges @ along
    off = np.linalg.norm(edges - ways[:, None] * along, axis=1)
    turned = np.linalg.norm(np.cumsum(edges[:, :3], axis=0), axis=1)
    straight = (off <= _LINE_TOLERANCE) & (ways >= 0) & (turned < 2 * np.pi)
    return int(np.argmin(np.append(straight, False)))
