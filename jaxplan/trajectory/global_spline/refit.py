"""A fit as a pure function of its inputs, near those of a fit that was made (`held`).

Newton's method on ``F(z; inputs) = 0`` with ``z = (x, y)``; the matrix is exact, with the curvature of loads
and margins in it. Automatic differentiation, forward or reverse, gives ``dz = -K^-1 (dF / d inputs)``, the
implicit function theorem, and refuses to differentiate that again.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import lu_factor, lu_solve
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.first_order import first_derivatives_only
from jaxplan.model.constraints import (
    Constraints,
    axes_in_body,
    joint_values,
    margins_of_scores,
    scores,
)
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.global_spline.bases import SMOOTHNESS
from jaxplan.trajectory.global_spline.held import Held, LoadRows, Traced, ZoneRows
from jaxplan.trajectory.global_spline.inputs import Inputs, gather_inputs
from jaxplan.trajectory.global_spline.kernels import loads_at
from jaxplan.trajectory.measures import to_limits

_STEPS, _LEFT = 5, 1e-9  # at most so many of Newton's steps, to such a residual, before the last one
_SLACK = 1e-13  # of the matrix, where rows that bind depend on each other


def refit(
    held: Held,
    path: Path,
    spacecraft: Spacecraft,
    settings: TrajectorySettings,
    cones: Constraints,
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
    inputs = gather_inputs(held, path, spacecraft, settings, cones, rates, duration)
    coefficients = held.free @ _split(held, _solve(held, inputs))[0] + inputs.offset
    base = coefficients[:1]  # see `Basis.pieces`
    pieces = jnp.einsum("kpn,na->kpa", held.pieces, coefficients - base).at[:, 0].add(base)
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


@jax.jit
def linearised(held: Held, inputs: Inputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """``F`` and its derivative at ``z``, the free coefficients and the multipliers in one row."""
    z = jnp.asarray(z)
    return _residual(held, inputs, z), _matrix(held, inputs, z)


def _solve(held: Held, inputs: Inputs) -> Traced:
    """The root ``z``, flat."""
    return _root(held, inputs)[0]


@jax.custom_jvp
def _root(held: Held, inputs: Inputs) -> tuple[Traced, tuple[Traced, Traced]]:
    """The root, and the factors of the matrix there."""
    z = jnp.concatenate([held.x.ravel(), held.multipliers])

    def far(at: tuple[Any, ...]) -> Traced:
        count, _, left, _ = at
        return (count < _STEPS) & ~jnp.all(jnp.abs(left) <= _LEFT)

    def ahead(at: tuple[Any, ...]) -> tuple[Any, ...]:
        count, z, _, _ = at
        left, factors = _residual(held, inputs, z), lu_factor(_matrix(held, inputs, z))
        return count + 1, z - lu_solve(factors, left), left, factors

    none = jnp.zeros((len(z), len(z)), z.dtype), jnp.zeros(len(z), jnp.int32)
    start = jnp.array(0), z, jnp.full_like(z, jnp.inf), none
    # The factors are those of the step before, which at the root are the same.
    _, z, _, factors = jax.lax.while_loop(far, ahead, start)
    return z - lu_solve(factors, _residual(held, inputs, z)), factors


@_root.defjvp
def _root_slope(primals: tuple[Held, Inputs], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    """The implicit function theorem; its matrix is held, so it must not be differentiated again."""
    z, factors = _root(*primals)
    held, inputs = first_derivatives_only(primals)
    _, left = jax.jvp(lambda held, inputs: _residual(held, inputs, z), (held, inputs), tangents)
    none = jnp.zeros_like(factors[0]), np.zeros(factors[1].shape, jax.dtypes.float0)
    return (z, factors), (-lu_solve(factors, left), none)


def _split(held: Held, z: Traced) -> tuple[Traced, Traced]:
    return z[: held.x.size].reshape(held.x.shape), z[held.x.size :]


def _on(held: Held) -> Traced:
    return jnp.concatenate([held.linear.on, held.loads.on, held.zones.on])


def _residual(held: Held, inputs: Inputs, z: Traced) -> Traced:
    """``F``; a row that is padding stands for its multiplier, which is zero."""
    x, y = _split(held, z)
    c, on = held.free @ x + inputs.offset, _on(held)
    values, slopes = _rows(held, inputs, c)
    pull = held.free.T @ (inputs.energy @ c) + jnp.tensordot(jnp.where(on, y, 0), slopes, axes=1)
    return jnp.concatenate([pull.ravel(), jnp.where(on, values, y)])


def _rows(held: Held, inputs: Inputs, c: Traced) -> tuple[Traced, Traced]:
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
    function: Callable[..., Traced], inputs: Inputs, rows: LoadRows | ZoneRows, local: Traced
) -> Traced:
    """A function of one row and what it depends on, for all rows."""
    return jax.vmap(function, (None, 0, 0))(inputs, rows, local)


def _load_row(inputs: Inputs, row: LoadRows, z: Traced) -> Traced:
    """One load at one place, from ``b`` and its derivatives (4, 3)."""
    loads = loads_at(inputs.turn, row.place, z, inputs.inertia, inputs.names)
    return row.sign * loads[row.load, row.axis] / inputs.limits[row.load, row.axis] - 1


def _zone_row(inputs: Inputs, row: ZoneRows, z: Traced) -> Traced:
    """One margin at one place, from ``b`` and joints (3 + 2n,)."""
    half = so3.exp(row.place * inputs.turn / 2)
    attitude = inputs.attitude @ half @ so3.exp(z[:3] - row.place * inputs.turn) @ half
    cones, seen = inputs.cones.some(row.zone[None]), inputs.sights.in_body(z[3:])
    axis = axes_in_body(cones, cones.axis @ attitude, seen)[0]
    values = joint_values(cones, z[3:])[row.device] if cones.inner else None
    margin = margins_of_scores(cones, scores(cones, (seen[row.device] @ axis)[None], values))
    return inputs.wanted[row.device, row.zone] - margin[0]


def _matrix(held: Held, inputs: Inputs, z: Traced) -> Traced:
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
