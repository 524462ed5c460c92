"""A fit as a pure function of its inputs, near those of a fit that was made (`held`).

Newton's method on ``F(z; inputs) = 0`` with ``z = (x, y)``; the matrix is exact, with the curvature of loads
and margins in it. Its last step is written so that automatic differentiation, forward or reverse, gives
``dz = -K^-1 (dF / d inputs)``, the implicit function theorem.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.linalg import lu_factor, lu_solve
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.path import Path
from jaxplan.scenario.model import TrajectorySettings
from jaxplan.spacecraft import Spacecraft, body_boresights
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.global_spline.bases import SMOOTHNESS
from jaxplan.trajectory.global_spline.build import CLEARANCE, OF_ENDS
from jaxplan.trajectory.global_spline.held import Held, LoadRows, Traced, ZoneRows
from jaxplan.trajectory.global_spline.job import TUBE_RADIUS
from jaxplan.trajectory.global_spline.motion import loads_at
from jaxplan.trajectory.measures import to_limits
from jaxplan.zones import Cones, separation

_STEPS, _LEFT = 5, 1e-9  # at most so many of Newton's steps, to such a residual, before the last one
_SLACK = 1e-13  # of the matrix, where rows that bind depend on each other


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class _Inputs:
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
        mounts: (n,) rad.
        fixed: (I, 3) boresights of the instruments.
        cones: the zones.
        dynamic: whether torque and momentum are among the loads.
        jerky: whether the jerk is.
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
    mounts: Traced
    fixed: Traced
    cones: Cones
    dynamic: bool = field(metadata={"static": True})
    jerky: bool = field(metadata={"static": True})


def refit(
    held: Held,
    path: Path,
    spacecraft: Spacecraft,
    settings: TrajectorySettings,
    cones: Cones,
    rates: ArrayLike,
) -> Trajectory:
    """The trajectory of a fit whose inputs have changed a little; differentiable in all of them.

    Args:
        held: of a fit to as many nodes.
        path: its attitudes and joints; edges' costs have no say.
        spacecraft: its limits, mountings and inertia.
        settings: weights, duration and tube.
        cones: the zones.
        rates: (2, 3 + 2n) rad/s at start and end, of body axes and joints.

    Returns:
        The trajectory, its arrays traced where the inputs are. Nothing is checked: where another row comes to
        bind, or one does no longer, it is the optimum under the rows that are held.
    """
    duration = held.duration if held.stretched else jnp.asarray(settings.duration)
    inputs = _inputs(held, path, spacecraft, settings, cones, rates, duration)
    coefficients = held.free @ _split(held, _solve(held, inputs))[0] + inputs.offset
    pieces = jnp.einsum("kpn,na->kpa", held.pieces, coefficients)
    count = len(held.breaks) - 1
    breaks = held.breaks * duration
    arrays: dict[str, Any] = {
        "breaks": breaks,
        "chart_attitude": jnp.broadcast_to(inputs.attitude, (count, 3, 3)),
        "chart_start": jnp.zeros(count),
        "chart_rate": jnp.broadcast_to(inputs.turn / duration, (count, 3)),
        "coefficients": pieces[:, :, :3],
        "joint_breaks": breaks,
        "joint_coefficients": pieces[:, :, 3:],
        "node_times": held.places * duration,
    }
    curve = Trajectory(**arrays, smoothness=SMOOTHNESS, method="global")
    return to_limits(curve, spacecraft) if held.stretched else curve


inputs_of = jax.jit(lambda *arguments: _inputs(*arguments))


@jax.jit
def linearised(held: Held, inputs: _Inputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """``F`` and its derivative at ``z``, the free coefficients and the multipliers in one row."""
    z = jnp.asarray(z)
    return _residual(held, inputs, z), _matrix(held, inputs, z)


def _inputs(
    held: Held,
    path: Path,
    craft: Spacecraft,
    settings: TrajectorySettings,
    cones: Cones,
    rates: ArrayLike,
    duration: Traced,
) -> _Inputs:
    attitudes, joints = jnp.asarray(path.attitudes), jnp.asarray(path.joints)
    first, last = attitudes[0], attitudes[-1]
    turn = so3.log(first.T @ last)
    turn = turn * (1 - 2 * jnp.pi * held.long_way / _positive(so3.length(turn)))
    back = so3.exp(-held.places[:, None] * turn / 2)  # U^T
    eta = so3.log(back @ (first.T @ attitudes) @ back)
    eta = eta * (1 + 2 * jnp.pi * held.windings / _positive(so3.length(eta)))[:, None]
    nodes = jnp.concatenate([eta + held.places[:, None] * turn, joints], axis=1)
    ends = jnp.asarray(rates)
    ends = ends.at[1, :3].set(so3.exp(turn / 2) @ ends[1, :3])
    weights = jnp.stack(
        [jnp.asarray(w) for w in (settings.rate_weight, settings.acceleration_weight, settings.jerk_weight)]
    )
    radius = TUBE_RADIUS if settings.node_tube is None else settings.node_tube
    tube = jnp.concatenate([jnp.full(3, radius / np.sqrt(3.0)), jnp.full(joints.shape[1], radius)])
    scales = [
        craft.joint_rate_limits * duration,
        craft.joint_acceleration_limits * duration**2,
        craft.joint_limits,
        tube,
    ]
    limits: list[ArrayLike] = [craft.rate_limit, craft.acceleration_limit]
    actuators = (craft.torque_limit, craft.wheel_momentum_limit)
    dynamic = craft.inertia is not None and any(limit is not None for limit in actuators)
    if dynamic:
        limits += [jnp.inf if limit is None else limit for limit in actuators]
    if craft.jerk_limit is not None:
        limits.append(craft.jerk_limit)
    powers = np.array(held.powers)[:, None]
    body = body_boresights(craft.mounts, craft.fixed_boresights, joints[jnp.array([0, -1])])
    margins = cones.side * (
        _angles(body @ jnp.swapaxes(attitudes[jnp.array([0, -1])], -1, -2), cones) - cones.half_angle
    )
    room = jnp.where(cones.side > 0, jnp.pi - cones.half_angle, cones.half_angle)
    wanted = jnp.minimum(CLEARANCE, OF_ENDS * jnp.minimum(jnp.maximum(jnp.min(margins, axis=0), 0), room))
    return _Inputs(
        attitude=first,
        turn=turn,
        nodes=nodes,
        offset=held.of_values @ nodes[held.given] + duration * (held.of_rates @ ends),
        energy=jnp.tensordot(weights * duration ** -np.array([1.0, 3.0, 5.0]), held.energies, axes=1),
        scales=jnp.concatenate([jnp.asarray(scale) for scale in scales]),
        limits=held.tightened
        * jnp.stack([jnp.broadcast_to(jnp.asarray(limit), 3) for limit in limits])
        * duration**powers,
        wanted=wanted,
        inertia=jnp.eye(3) if craft.inertia is None else jnp.asarray(craft.inertia),
        mounts=jnp.asarray(craft.mounts),
        fixed=jnp.asarray(craft.fixed_boresights),
        cones=cones,
        dynamic=dynamic,
        jerky=craft.jerk_limit is not None,
    )


def _solve(held: Held, inputs: _Inputs) -> Traced:
    """The root ``z``, flat."""
    fixed = jax.lax.stop_gradient((held, inputs))
    z = jnp.concatenate([held.x.ravel(), held.multipliers])

    def far(at: tuple[Any, ...]) -> Traced:
        count, _, left, _ = at
        return (count < _STEPS) & ~jnp.all(jnp.abs(left) <= _LEFT)

    def ahead(at: tuple[Any, ...]) -> tuple[Any, ...]:
        count, z, _, _ = at
        left, factors = _residual(*fixed, z), lu_factor(_matrix(*fixed, z))
        return count + 1, z - lu_solve(factors, left), left, factors

    none = jnp.zeros((len(z), len(z)), z.dtype), jnp.zeros(len(z), jnp.int32)
    start = jnp.array(0), z, jnp.full_like(z, jnp.inf), none
    # The factors are those of the step before, which at the root are the same.
    _, z, _, factors = jax.lax.stop_gradient(jax.lax.while_loop(far, ahead, jax.lax.stop_gradient(start)))
    return z - lu_solve(factors, _residual(held, inputs, z))


def _split(held: Held, z: Traced) -> tuple[Traced, Traced]:
    return z[: held.x.size].reshape(held.x.shape), z[held.x.size :]


def _on(held: Held) -> Traced:
    return jnp.concatenate([held.linear.on, held.loads.on, held.zones.on])


def _residual(held: Held, inputs: _Inputs, z: Traced) -> Traced:
    """``F``; a row that is padding stands for its multiplier, which is zero."""
    x, y = _split(held, z)
    c, on = held.free @ x + inputs.offset, _on(held)
    values, slopes = _rows(held, inputs, c)
    pull = held.free.T @ (inputs.energy @ c) + jnp.tensordot(jnp.where(on, y, 0), slopes, axes=1)
    return jnp.concatenate([pull.ravel(), jnp.where(on, values, y)])


def _rows(held: Held, inputs: _Inputs, c: Traced) -> tuple[Traced, Traced]:
    """By how much of a limit, of zones by how many rad, each row is broken (R,); slopes (R, k, A)."""
    linear, loads, zones = held.linear, held.loads, held.zones
    axes = c.shape[1]
    value = jnp.einsum("rn,nr->r", linear.row, c[:, linear.axis])
    centre = jnp.where(linear.node >= 0, inputs.nodes[linear.node, linear.axis], 0)
    scale = jnp.where(linear.on, inputs.scales[linear.scale], 1)
    factor = linear.sign / scale
    values = [factor * (value - centre) - 1]
    slopes = [
        jnp.einsum("rk,ra->rka", factor[:, None] * (linear.row @ held.free), jnp.eye(axes)[linear.axis])
    ]
    if len(loads.on):
        local = jnp.einsum("rdn,na->rda", loads.rows, c[:, :3])
        values.append(_each(_load_row, inputs, loads, local))
        slope = _each(jax.jacfwd(_load_row, 2), inputs, loads, local)
        own = jnp.einsum("rdk,rda->rka", loads.rows @ held.free, slope)
        slopes.append(jnp.pad(own, ((0, 0), (0, 0), (0, axes - 3))))
    if len(zones.on):
        local = zones.row @ c
        values.append(_each(_zone_row, inputs, zones, local))
        slope = _each(jax.jacfwd(_zone_row, 2), inputs, zones, local)
        slopes.append(jnp.einsum("rk,ra->rka", zones.row @ held.free, slope))
    return jnp.concatenate(values), jnp.concatenate(slopes)


def _each(
    function: Callable[..., Traced], inputs: _Inputs, rows: LoadRows | ZoneRows, local: Traced
) -> Traced:
    """A function of one row and what it depends on, for all rows."""
    return jax.vmap(function, (None, 0, 0))(inputs, rows, local)


def _load_row(inputs: _Inputs, row: LoadRows, z: Traced) -> Traced:
    """One load at one place, from ``b`` and its derivatives (4, 3)."""
    loads = loads_at(inputs.turn, row.place, z, inputs.inertia, inputs.dynamic, inputs.jerky)
    return row.sign * loads[row.load, row.axis] / inputs.limits[row.load, row.axis] - 1


def _zone_row(inputs: _Inputs, row: ZoneRows, z: Traced) -> Traced:
    """One margin at one place, from ``b`` and joints (3 + 2n,)."""
    half = so3.exp(row.place * inputs.turn / 2)
    attitude = inputs.attitude @ half @ so3.exp(z[:3] - row.place * inputs.turn) @ half
    body = body_boresights(inputs.mounts, inputs.fixed, z[3:])[row.device]
    cones, zone = inputs.cones, row.zone
    angle = separation(attitude @ body, jnp.asarray(cones.direction)[zone])
    margin = jnp.asarray(cones.side)[zone] * (angle - jnp.asarray(cones.half_angle)[zone])
    return inputs.wanted[row.device, zone] - margin


def _matrix(held: Held, inputs: _Inputs, z: Traced) -> Traced:
    """Derivative of `_residual` in ``z``, put together from small blocks at the rows that bind."""
    x, y = _split(held, z)
    c, free, on = held.free @ x + inputs.offset, held.free, _on(held)
    loads, zones = held.loads, held.zones
    counts = np.cumsum([len(held.linear.on), len(loads.on)])
    _, of_loads, of_zones = jnp.split(jnp.where(on, y, 0), counts)
    curved = jnp.einsum("kl,ab->kalb", free.T @ inputs.energy @ free, jnp.eye(x.shape[1]))
    if len(loads.on):
        basis = loads.rows @ free
        local = jnp.einsum("rdn,na->rda", loads.rows, c[:, :3])
        bend = _each(jax.jacfwd(jax.jacfwd(_load_row, 2), 2), inputs, loads, local)
        own = jnp.einsum("r,rdk,rdaeb,rel->kalb", of_loads, basis, bend, basis, optimize=True)
        curved = curved.at[:, :3, :, :3].add(own)
    if len(zones.on):
        basis = zones.row @ free
        bend = _each(jax.jacfwd(jax.jacfwd(_zone_row, 2), 2), inputs, zones, zones.row @ c)
        curved = curved + jnp.einsum("r,rk,rab,rl->kalb", of_zones, basis, bend, basis, optimize=True)
    jacobian = _rows(held, inputs, c)[1].reshape(len(y), x.size) * on[:, None]
    corner = jnp.diag(jnp.where(on, -_SLACK, 1.0))
    return jnp.block([[curved.reshape(x.size, x.size), jacobian.T], [jacobian, corner]])


def _angles(boresights: Array, cones: Cones) -> Traced:
    """(..., D, Z) between devices (..., D, 3) and zones' axes."""
    return separation(boresights[..., :, None, :], jnp.asarray(cones.direction))


def _positive(length: Array) -> Traced:
    return jnp.where(length > 0, length, 1)
