"""States, goals and paths, and the motion between two nodes.

The motion along an edge is the geodesic of the platform and linear joints, both at constant speed:
``R(s) = R0 exp(s phi^)``, ``q(s) = q0 + s dq`` with ``s`` in [0, 1]. Its margins are bounded from below over
the whole edge: the second derivative of each boresight ``p(s)`` is bounded (`direction_curvature`), so a
few samples speak for the intervals between them.

The cost of an edge is counted in steps, ``max(rotation / attitude step, |dq_j| / joint step_j)``, which is
also the time the move takes when every step takes the same.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3, spacecraft, zones
from jaxplan.display import shown
from jaxplan.geometry.arrays import AnyArray, arrays


@shown("slew_angle deg", "joints deg", "attitude")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Goal:
    """Where the manoeuvre ends.

    Attributes:
        attitude: (3, 3) body to inertial.
        joints: (2n,) rad, all yaws then all pitches.
        slew_angle: rotation of the platform from the start, rad.
    """

    attitude: np.ndarray
    joints: np.ndarray
    slew_angle: float


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
class MovingGoal(Goal):
    """Where and when a manoeuvre ends among targets or zones that move.

    Attributes:
        time: s, when the manoeuvre must end, since then the targets are where devices point.
        angular_velocity: (3,) rad/s of the platform then, body axes.
        joint_rates: (2n,) rad/s; with the platform's they let devices follow their targets.
    """

    time: float
    angular_velocity: np.ndarray
    joint_rates: np.ndarray


@shown("edges", "length steps", "edge_costs steps", "joints deg", "attitudes")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """A sequence of nodes from start to goal.

    Attributes:
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n) rad.
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
) -> Array:
    """Cost of a motion in steps: the slowest of the platform and all joints.

    Args:
        rotation: (...) angle of the platform's rotation, rad.
        joint_change: (..., 2n) rad.
        attitude_step: rad a step.
        joint_steps: (2n,) rad a step.

    Returns:
        (...) steps.
    """
    joint_cost = jnp.max(jnp.abs(joint_change) / joint_steps, axis=-1, initial=0.0)
    return jnp.maximum(jnp.asarray(rotation) / attitude_step, joint_cost)


def motion(
    attitude: ArrayLike, joints: ArrayLike, turn: ArrayLike, joint_change: ArrayLike, fraction: ArrayLike
) -> tuple[AnyArray, AnyArray]:
    """States along an edge.

    Args:
        attitude: (3, 3) where the edge starts.
        joints: (2n,) likewise.
        turn: (3,) rotation vector ``phi`` of the edge, body axes.
        joint_change: (2n,) ``dq``.
        fraction: (k,) in [0, 1].

    Returns:
        (k, 3, 3) attitudes and (k, 2n) joints.
    """
    xp, start, angles, phi, change, s = arrays(attitude, joints, turn, joint_change, fraction)
    steps = so3.exp(s[:, None] * phi)
    # a product and a sum instead of a small matrix product: it fuses with what surrounds it
    attitudes = xp.sum(start[:, :, None] * steps[:, None], axis=-2)
    return attitudes, angles + s[:, None] * change


def direction_curvature(rotation: ArrayLike, joint_change: ArrayLike, instruments: int) -> Array:
    """Bound of ``|p''(s)|`` of every device's boresight along a motion.

    With ``p = R v``, ``v`` in body axes, ``p'' = R (phi x (phi x v) + 2 phi x v' + v'')``. For ``u = |dyaw|``
    and ``w = |dpitch|``, equation (13) gives ``|v'|^2 <= u^2 + w^2``, and ``|v''|^2`` is linear in
    ``cos^2 pitch``: at most ``(u^2 + w^2)^2`` (pitch 0) or ``w^2 (w^2 + 4 u^2)`` (pitch 90 deg).

    Args:
        rotation: (...) rad.
        joint_change: (..., 2n) rad.
        instruments: number of body-fixed devices.

    Returns:
        (..., n + instruments) rad^2.
    """
    phi = jnp.asarray(rotation)[..., None]
    change = jnp.abs(jnp.asarray(joint_change))
    count = change.shape[-1] // 2
    yaw, pitch = change[..., :count], change[..., count:]
    rate = so3.length(jnp.stack([yaw, pitch], axis=-1))
    bend = jnp.maximum(rate**2, pitch * so3.length(jnp.stack([pitch, 2 * yaw], axis=-1)))
    moving = phi**2 + 2 * phi * rate + bend
    still = jnp.broadcast_to(phi**2, (*moving.shape[:-1], instruments))
    return jnp.concatenate([moving, still], axis=-1)


def interval_cosines(
    cones: zones.Cones,
    mounts: ArrayLike,
    fixed_boresights: ArrayLike,
    attitude: ArrayLike,
    joints: ArrayLike,
    turn: ArrayLike,
    joint_change: ArrayLike,
    intervals: int,
) -> Array:
    """Upper bound of every zone's signed cosine on each interval of one edge, see `zones.swept_cosines`.

    Args:
        cones: the zones.
        mounts: (n,) rad.
        fixed_boresights: (i, 3) body axes.
        attitude: (3, 3) at the edge's start.
        joints: (2n,) at the edge's start.
        turn: (3,) rotation vector ``phi`` of the edge, body axes.
        joint_change: (2n,) ``dq``.
        intervals: number of equal intervals, static; more make the bound sharper.

    Returns:
        (intervals, Z), of the worst device that each zone binds; -inf where it binds none.
    """
    turn_vector = jnp.asarray(turn)
    fraction = jnp.arange(intervals + 1) / intervals
    attitudes, angles = motion(attitude, joints, turn_vector, joint_change, fraction)
    body = spacecraft.body_boresights(mounts, fixed_boresights, angles)
    inertial = jnp.sum(attitudes[:, None] * body[:, :, None, :], axis=-1)  # (intervals + 1, D, 3)
    dots = jnp.sum(inertial[:, :, None, :] * cones.direction, axis=-1)  # (intervals + 1, D, Z)
    curvature = direction_curvature(so3.length(turn_vector), joint_change, jnp.shape(fixed_boresights)[0])
    cosines = zones.swept_cosines(cones, dots[:-1], dots[1:], curvature[:, None] / (2 * intervals**2))
    return jnp.max(jnp.where(cones.bound.T, cosines, -jnp.inf), axis=-2, initial=-jnp.inf)


def edge_margins(
    cones: zones.Cones,
    mounts: ArrayLike,
    fixed_boresights: ArrayLike,
    attitude: ArrayLike,
    joints: ArrayLike,
    turn: ArrayLike,
    joint_change: ArrayLike,
    intervals: int,
) -> Array:
    """Lower bound of every constraint's margin over one whole edge; arguments as for `interval_cosines`.

    Returns:
        (Z,) rad, +inf for padding and for zones that follow another of their group; exact to about
        1e-8 rad at a cone's very axis, else to rounding.
    """
    worst = interval_cosines(cones, mounts, fixed_boresights, attitude, joints, turn, joint_change, intervals)
    zone_margin = jnp.where(worst == -jnp.inf, jnp.inf, zones.margins_from_cosines(cones, worst))
    return jnp.min(zones.group_margins(cones, zone_margin), axis=0)
