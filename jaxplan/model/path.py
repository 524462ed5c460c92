"""Goals and paths, and the motion between two nodes of a path.

A path is a sequence of *nodes*, which are states, connected by *edges*. Along an edge the platform follows
the geodesic and the joints change linearly, all at constant speed: ``R(s) = R0 exp(s phi^)``,
``q(s) = q0 + s dq`` with ``s`` in [0, 1], where ``phi`` is the rotation vector of the edge in body axes. Its
margins are bounded from below over the whole edge from a few samples, by the bounds of
`jaxplan.model.scores`.

The cost of an edge is counted in steps, ``max(rotation / attitude step, |dq_j| / joint step_j)``, which is
the duration of the move if every step takes the same time. There are 2n + d joints of n terminals and d
drives: all yaws, all pitches, all drives' angles.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, arrays, length, max_along, min_along
from jaxplan.model import constraints
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import Sights
from jaxplan.model.goals import GivenState
from jaxplan.model.scores import edge_bound, margins_of_scores, score_curvature, scores
from jaxplan.runtime.display import shown


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
