"""States, goals and paths, and the motion between two nodes.

The motion along an edge is the geodesic of the platform and linear joints, both at constant speed:
``R(s) = R0 exp(s phi^)``, ``q(s) = q0 + s dq`` with ``s`` in [0, 1]. Its margins are bounded from below over
the whole edge, by the bounds of `jaxplan.model.constraints`, from a few samples.

The cost of an edge is counted in steps, ``max(rotation / attitude step, |dq_j| / joint step_j)``, which is
also the time the move takes when every step takes the same.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, arrays, length
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
        joints: (2n + d,) rad, yaws, pitches, drives.
        slew_angle: rotation of the platform from the start, rad.
        time: s, at which the manoeuvre must end, for which moving targets were taken; 0 where nothing moves.
        angular_velocity: (3,) rad/s of the platform then, body axes; None for what the scenario asks for.
        joint_rates: (2n + d,) rad/s, likewise; with the platform's they let devices follow their targets.
    """

    attitude: np.ndarray
    joints: np.ndarray
    slew_angle: float
    time: float = 0.0
    angular_velocity: np.ndarray | None = None
    joint_rates: np.ndarray | None = None

    @property
    def state(self) -> GivenState:
        """The goal as a state that a scenario may be given as its goal, or as its start."""
        names = ("angular_velocity", "joint_rates")
        rates = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return GivenState(rotation_vector=np.asarray(so3.log(self.attitude)), joints=self.joints, **rates)


@shown("edges", "length steps", "edge_costs steps", "joints deg", "attitudes")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """A sequence of nodes from start to goal.

    Attributes:
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n + d) rad.
        edge_costs: (m,) cost of each edge in steps; a trajectory shares its time out by them.
    """

    attitudes: np.ndarray
    joints: np.ndarray
    edge_costs: np.ndarray

    @property
    def length(self) -> float:
        """Cost of the path in steps."""
        return float(np.sum(self.edge_costs))

    @property
    def edges(self) -> int:
        """Number of edges, m."""
        return len(self.edge_costs)


def halve(path: Path) -> Path:
    """The same path with a node in the middle of every edge.

    Args:
        path: with m edges.

    Returns:
        A path with 2m edges of half the cost each.
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
    """Cost of a motion in steps: the largest of those of the platform and of all joints.

    Args:
        rotation: (...) angle of the platform's rotation, rad.
        joint_change: (..., 2n + d) rad.
        attitude_step: rad a step.
        joint_steps: (2n + d,) rad a step.

    Returns:
        (...) steps.
    """
    xp, turn, change, step, steps = arrays(rotation, joint_change, attitude_step, joint_steps)
    return xp.maximum(turn / step, xp.max(xp.abs(change) / steps, axis=-1, initial=0.0))


def motion(
    attitude: ArrayLike, joints: ArrayLike, turn: ArrayLike, joint_change: ArrayLike, fraction: ArrayLike
) -> tuple[AnyArray, AnyArray]:
    """States along an edge.

    Args:
        attitude: (3, 3) where the edge starts, body to inertial.
        joints: (2n + d,) rad, where the edge starts.
        turn: (3,) rad, rotation vector ``phi`` of the edge, body axes.
        joint_change: (2n + d,) rad, ``dq``.
        fraction: (k,) in [0, 1].

    Returns:
        (k, 3, 3) attitudes and (k, 2n + d) joints.
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
    """Upper bound of every row's score on each interval of one edge, see `jaxplan.model.constraints`.

    Args:
        rows: the constraints, of which no axis moves.
        sights: what they bind.
        attitude: (3, 3) at the edge's start.
        joints: (2n + d,) at the edge's start.
        turn: (3,) rotation vector ``phi`` of the edge, body axes.
        joint_change: (2n + d,) ``dq``.
        intervals: number of equal intervals, static; more make the bound sharper.

    Returns:
        (intervals, Z), of the worst sight that each row binds; -inf where it binds none.
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
    return jnp.max(jnp.where(rows.bound.T, bound, -jnp.inf), axis=-2, initial=-jnp.inf)


def edge_margins(
    rows: Constraints,
    sights: Sights,
    attitude: ArrayLike,
    joints: ArrayLike,
    turn: ArrayLike,
    joint_change: ArrayLike,
    intervals: int,
) -> Array:
    """Lower bound of every constraint's margin over one whole edge; arguments as for `interval_scores`.

    Returns:
        (Z,) rad, +inf for padding and for rows that follow another of their constraint; exact to about
        1e-8 rad at a cone's very axis, else to rounding.
    """
    worst = interval_scores(rows, sights, attitude, joints, turn, joint_change, intervals)
    margin = jnp.where(worst == -jnp.inf, jnp.inf, margins_of_scores(rows, worst))
    return jnp.min(constraints.best_entries(rows, margin), axis=0)
