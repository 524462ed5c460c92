"""What the optimum of a fit depends on, from a path, a spacecraft, settings and zones; differentiable."""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.display import shown
from jaxplan.geometry.vectors import length
from jaxplan.model.constraints import Constraints, Sights, room, state_margins
from jaxplan.model.limits import timed_limits
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory.global_spline.build import CLEARANCE, OF_ENDS
from jaxplan.trajectory.global_spline.held import Held, Traced
from jaxplan.trajectory.global_spline.job import TUBE_RADIUS


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Inputs:
    """All that the optimum depends on.

    Attributes:
        attitude: (3, 3) of the chart.
        turn: (3,) likewise.
        nodes: (m + 1, A) ``b`` and joints.
        offset: (n, A) coefficients of the curve without freedom.
        energy: (n, n) of one axis.
        scales: of linear rows, see `LinearRows`.
        limits: (Q, 3) of the platform's loads, in the place.
        wanted: (D, Z) rad, margins to keep.
        inertia: (3, 3).
        cones: the pointing constraints.
        sights: what they bind, D of them.
        names: (Q,) of the platform's loads.
    """

    attitude: Traced
    turn: Traced
    nodes: Traced
    offset: Traced
    energy: Traced
    scales: Traced
    limits: Traced
    wanted: Traced
    inertia: Traced
    cones: Constraints
    sights: Sights
    names: tuple[str, ...] = field(metadata={"static": True})


def gather_inputs(
    held: Held,
    path: Path,
    craft: Spacecraft,
    settings: TrajectorySettings,
    cones: Constraints,
    rates: ArrayLike,
    duration: Traced,
) -> Inputs:
    """The inputs of what is held, for the arguments of `refit.refit` and a duration in s."""
    attitudes, joints = jnp.asarray(path.attitudes), jnp.asarray(path.joints)
    first, last = attitudes[0], attitudes[-1]
    turn = so3.log(first.T @ last)
    turn = turn * (1 - 2 * jnp.pi * held.long_way / _positive(length(turn)))
    back = so3.exp(-held.places[:, None] * turn / 2)  # U^T
    eta = so3.log(back @ (first.T @ attitudes) @ back)
    eta = eta * (1 + 2 * jnp.pi * held.windings / _positive(length(eta)))[:, None]
    nodes = jnp.concatenate([eta + held.places[:, None] * turn, joints], axis=1)
    ends = jnp.asarray(rates)
    ends = ends.at[1, :3].set(so3.exp(turn / 2) @ ends[1, :3])
    weights = jnp.stack(
        [jnp.asarray(w) for w in (settings.rate_weight, settings.acceleration_weight, settings.jerk_weight)]
    )
    radius = held.widened * (TUBE_RADIUS if settings.node_tube is None else settings.node_tube)
    tube = jnp.concatenate([jnp.full(3, radius / np.sqrt(3.0)), jnp.full(joints.shape[1], radius)])
    platform, of_joints = timed_limits(craft)
    scales = [limit.bound * duration**limit.quantity.power for limit in of_joints]
    scales += [craft.joint_limits, tube]
    sights, at_ends = cones.sights(craft.mounts, craft.fixed_boresights), jnp.array([0, -1])
    margins = jnp.swapaxes(state_margins(cones, sights, attitudes[at_ends], joints[at_ends]), 1, 2)
    left = jnp.min(jnp.where(held.counted, margins, jnp.inf), axis=0)
    wanted = jnp.minimum(jnp.minimum(CLEARANCE, room(cones)), OF_ENDS * jnp.maximum(left, 0))
    return Inputs(
        attitude=first,
        turn=turn,
        nodes=nodes,
        offset=held.of_values @ nodes[held.given] + duration * (held.of_rates @ ends),
        energy=jnp.tensordot(weights * duration ** -np.array([1.0, 3.0, 5.0]), held.energies, axes=1),
        scales=jnp.concatenate([jnp.asarray(scale) for scale in scales]),
        limits=held.share
        * jnp.stack([jnp.asarray(limit.bound) * duration**limit.quantity.power for limit in platform]),
        wanted=wanted,
        inertia=jnp.eye(3) if craft.inertia is None else jnp.asarray(craft.inertia),
        cones=cones,
        sights=sights,
        names=tuple(limit.quantity.name for limit in platform),
    )


def _positive(length: Array) -> Traced:
    return jnp.where(length > 0, length, 1)
