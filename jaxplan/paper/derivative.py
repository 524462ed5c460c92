"""The paper's scheme as a differentiable function of its inputs, near those of a fit that was made.

The following are held fixed: the limits that bind (hold with equality) at the joins, where a segment meets
the next one; the segments; and the times of the nodes as fractions of the duration. Then every quadratic
program is a linear system, and JAX differentiates the chain of them. S segments have l + 1 Legendre
coefficients on each of d axes; a path has m + 1 nodes and 2n joint angles.
"""

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.model.constraints import Constraints
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.paper.segments import PathNodes, assembled, node_indices, shortest_duration, split
from jaxplan.runtime.display import shown
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.measures import to_limits
from jaxplan.trajectory.node_times import FEWEST_NODES, padded
from jaxplan.trajectory.peaks import SAFETY
from jaxplan.trajectory.splines import end_derivatives, energy

_BINDING_TOLERANCE = 1e-9  # of a limit; a rate or acceleration at a join that is nearer to its limit is held


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class ActiveChain:
    """The segments of the platform or of the joints, with the limits that bind.

    Attributes:
        ends: (S + 1,) int, indices of the nodes where segments end.
        nodes: (S, slots) int, the node of each slot, see `segments`.
        present: (S, slots) bool, which slots hold a node.
        sides: (S, 2, d) for rate and acceleration at the join: 1 where the upper limit binds, -1 where the
            lower one does, else 0.
    """

    ends: np.ndarray
    nodes: np.ndarray
    present: np.ndarray
    sides: np.ndarray


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class PaperActiveSet:
    """Everything that derivatives hold fixed of a fit.

    Attributes:
        fractions: (m + 1,) times of the nodes over the duration.
        joints: segments of the joints.
        platform: segments of the platform.
        order: degree of the Legendre basis.
        stretched: whether the time is stretched to the limits afterwards.
    """

    fractions: np.ndarray
    joints: ActiveChain
    platform: ActiveChain
    order: int = field(metadata={"static": True})
    stretched: bool = field(metadata={"static": True})


def refit(
    held: PaperActiveSet,
    path: Path,
    spacecraft: Spacecraft,
    settings: TrajectorySettings,
    cones: Constraints,
    rates: ArrayLike,
) -> Trajectory:
    """Compute the trajectory of a fit whose inputs have changed a little; differentiable in all of them.

    Nothing is checked: where another limit comes to bind at a join, or one no longer does, the result is the
    optimum under those that are held.

    Args:
        held: what is held of a fit to as many nodes.
        path: its attitudes and joints; the costs of its edges are not used.
        spacecraft: its limits and inertia.
        settings: weights and duration.
        cones: the zones, which this method ignores.
        rates: (2, 3 + 2n) rad/s at start and end, of body axes and joints.

    Returns:
        The trajectory, its arrays traced where the inputs are.
    """
    attitudes, joints = jnp.asarray(path.attitudes), jnp.asarray(path.joints)
    joint_limits = jnp.stack([spacecraft.joint_rate_limits, spacecraft.joint_acceleration_limits])
    limits = jnp.stack([jnp.full(3, own) for own in (spacecraft.rate_limit, spacecraft.acceleration_limit)])
    duration: Any = settings.duration
    if held.stretched:
        duration = nominal_duration(
            attitudes, joints, held.fractions, jnp.concatenate([limits, joint_limits], axis=1)
        )
    times = jnp.asarray(held.fractions * duration)
    joint_rows, rows, b, chart_rate, end_turns = assembled(
        attitudes, times, jnp.asarray(held.joints.nodes), jnp.asarray(held.platform.nodes), order=held.order
    )
    ends = jnp.stack([jnp.asarray(rates), jnp.zeros(jnp.shape(rates))], axis=1)  # (2, 2, A)
    weights = settings.rate_weight, settings.acceleration_weight
    angles = _chain_coefficients(
        held.joints, times, joint_rows, joints[held.joints.nodes], (0.0, 1.0), joint_limits, ends[:, :, 3:]
    )
    coefficients = _chain_coefficients(
        held.platform,
        times,
        rows,
        b,
        weights,
        limits,
        ends[::-1, :, :3],
        end_turns=end_turns,
    )
    arrays: dict[str, Any] = {
        "breaks": times[held.platform.ends],
        "chart_attitude": attitudes[held.platform.ends[:-1]],
        "chart_start": times[held.platform.ends[:-1]],
        "chart_rate": chart_rate,
        "coefficients": coefficients,
        "joint_breaks": times[held.joints.ends],
        "joint_coefficients": angles,
        "node_times": times,
    }
    curve = Trajectory(**arrays, smoothness=2, method="paper")
    return to_limits(curve, spacecraft) if held.stretched else curve


def nominal_duration(attitudes: Array, joints: Array, fractions: np.ndarray, limits: Array) -> Array:
    """Compute `shortest_duration` in s for nodes, as a differentiable function.

    Args:
        attitudes: (m + 1, 3, 3), body to inertial.
        joints: (m + 1, 2n) rad.
        fractions: (m + 1,) times of the nodes over the duration; equal where a node is padding.
        limits: (2, 3 + 2n) of rates (rad/s) and accelerations (rad/s^2), of body axes and joints.
    """
    turns = so3.log(jnp.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:])
    moves = jnp.concatenate([turns, jnp.diff(joints, axis=0)], axis=1)
    return jnp.asarray(shortest_duration(moves, fractions, limits[0], limits[1]))


def _chain_coefficients(
    held: ActiveChain,
    times: Array,
    node_rows: Array,
    node_values: Array,
    weights: tuple[Any, Any],
    limits: Array,
    ends: Array,
    end_turns: Array | None = None,
) -> Array:
    """Coefficients (S, l + 1, d) of a chain of segments, as `segments.Chain` plans it.

    Args:
        held: the segments, and which limits bind.
        times: (m + 1,) s, of the nodes.
        node_rows: (S, slots, l + 1) values of the basis at each node.
        node_values: (S, slots, d) rad, values wanted there.
        weights: of rate and acceleration in the objective.
        limits: (2, d) of rates and accelerations at the joins.
        ends: (2, 2, d) rate and acceleration where the chain begins, then where it ends.
        end_turns: (S, 3, 3) ``W`` of the platform's charts, which makes the chain run backward; None for
            joints.
    """
    count, slots, size = node_rows.shape
    backward = end_turns is not None
    near, far = (1, 0) if backward else (0, 1)
    near_rows, far_rows = end_derivatives(size - 1)[near], end_derivatives(size - 1)[far]
    last = ends[1]

    def segment(derivatives: Array, own: tuple[Any, ...]) -> tuple[Array, Array]:
        half, turn, node_rows, node_values, present, sides, closing = own
        if backward:
            derivatives = derivatives @ turn
        to_x = jnp.stack([half, half**2])[:, None]
        rate = weights[0] * half**2
        objective = (rate * energy(size - 1, 1) + weights[1] * energy(size - 1, 2)) / (rate + weights[1])
        rows = jnp.concatenate([node_rows, near_rows, far_rows])
        far_values = jnp.where(closing, last, sides * limits / SAFETY)
        values = jnp.concatenate([node_values, derivatives * to_x, far_values * to_x])
        always = jnp.concatenate([present, jnp.ones(2, bool), jnp.full(2, closing)])
        binds = jnp.concatenate([jnp.zeros((slots + 2, values.shape[1]), bool), sides != 0])
        x = jax.vmap(_solve_equality_qp, (None, None, 1, 1), 1)(
            objective, rows, values, always[:, None] | binds
        )
        return far_rows @ x / to_x, x

    number = np.arange(count)
    own = (
        jnp.diff(times[held.ends]) / 2,
        end_turns,
        node_rows,
        node_values,
        held.present,
        held.sides,
        number == (0 if backward else count - 1),  # the one that closes the chain
    )
    return jax.lax.scan(segment, ends[0], own, reverse=backward)[1]


def _solve_equality_qp(objective: Array, rows: Array, values: Array, on: Array) -> Array:
    """Minimise ``x^T objective x`` subject to ``rows x = values`` for the rows that are on.

    A row that is off is replaced by the equation that its multiplier is zero.

    Args:
        objective: (p, p) for p unknowns.
        rows: (r, p) of r equations.
        values: (r,) right-hand sides.
        on: (r,) bool, which rows are on.

    Returns:
        (p,) ``x``.
    """
    active = jnp.where(on[:, None], rows, 0)
    off = jnp.diag(jnp.where(on, 0.0, 1.0))
    system = jnp.block([[objective, active.T], [active, off]])
    right = jnp.concatenate([jnp.zeros(len(objective)), jnp.where(on, values, 0)])
    return jnp.linalg.solve(system, right)[: len(objective)]


def held_of(
    nodes: PathNodes,
    curve: Trajectory,
    limits: tuple[np.ndarray, np.ndarray] | None,
    count: int = FEWEST_NODES,
) -> PaperActiveSet:
    """Collect what derivatives hold fixed of a fit; a limit that is just met at a join counts as binding.

    Args:
        nodes: those that were passed.
        curve: the trajectory before its time was stretched.
        limits: of the platform (2, 3) and of the joints (2, 2n), rates and accelerations at the joins; None
            where the time was stretched to the limits.
        count: the smallest number to which nodes are padded.
    """
    order = curve.coefficients.shape[1] - 1
    ends = split(len(nodes.turns), len(curve.coefficients), order)
    platform, joints = (None, None) if limits is None else limits
    return PaperActiveSet(
        fractions=padded(nodes.fractions, count),
        joints=_make_active_chain(ends[0], order, curve.joint_breaks, curve.joint_coefficients, joints, 1),
        platform=_make_active_chain(ends[1], order, curve.breaks, curve.coefficients, platform, 0),
        order=order,
        stretched=limits is None,
    )


def _make_active_chain(
    ends: np.ndarray,
    order: int,
    breaks: np.ndarray,
    coefficients: np.ndarray,
    limits: np.ndarray | None,
    far: int,
) -> ActiveChain:
    """Collect what derivatives hold fixed of one chain of segments.

    Args:
        ends: (S + 1,) int, indices of the nodes where segments end.
        order: degree of the Legendre basis.
        breaks: (S + 1,) s, ends of the segments.
        coefficients: (S, order + 1, d).
        limits: (2, d) of rates and accelerations at the joins; None for none.
        far: the end of a segment at which the next one to be planned is joined: 1 the last, 0 the first.
    """
    nodes = node_indices(ends, order - 2)
    sides = np.zeros((len(ends) - 1, 2, coefficients.shape[2]))
    if limits is not None:
        half = np.diff(breaks)[:, None, None] / 2
        to_x = half ** np.array([[1], [2]])
        reached = end_derivatives(order)[far] @ coefficients / to_x
        sides = np.where(np.abs(reached) >= limits * (1 - _BINDING_TOLERANCE), np.sign(reached), 0.0)
        sides[-1 if far else 0] = 0.0  # the closing segment
    present = np.arange(order - 2) <= np.diff(ends)[:, None]
    return ActiveChain(ends=ends, nodes=nodes, present=present, sides=sides)
