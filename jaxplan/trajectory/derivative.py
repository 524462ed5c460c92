"""The optimum of a spline fit as a differentiable function of its inputs, by the implicit function theorem.

The optimum ``x`` of a fit, with multipliers ``y`` of the rows that bind, is a root of

    F(x, y; inputs) = (gradient in x of energy + y . rows,  rows that bind) = 0.

As long as the same rows bind, the implicit function theorem gives its derivatives in all inputs
(`refit`). Held fixed are the breaks, when each node is passed as a share of the duration, the places that
were looked at, the rows that bind, and the branches of logarithms.

The root is followed by Newton's method on ``F(z; inputs) = 0`` with ``z = (x, y)``; the matrix is exact, with
the curvature of loads and margins in it. Automatic differentiation, forward or reverse, gives ``dz = -K^-1
(dF / d inputs)``, the implicit function theorem, and refuses to differentiate that again.
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
from jaxplan.display import shown
from jaxplan.first_order import first_derivatives_only
from jaxplan.geometry.vectors import length
from jaxplan.model.constraints import (
    Constraints,
    axes_in_body,
    joint_values,
    margins_of_scores,
    room,
    scores,
    state_margins,
)
from jaxplan.model.limits import timed_limits
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.sights import Sights
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.quick_jit import quick_jit
from jaxplan.trajectory import options
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.measures import to_limits
from jaxplan.trajectory.motion import loads_at
from jaxplan.trajectory.splines import SMOOTHNESS

Traced = Any  # an array: of numpy as it is made, of JAX where it is traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class BindingLinear:
    """``sign * (row . c[:, axis] - centre) / scale <= 1``.

    Attributes:
        on: (R,) bool, the others are padding.
        row: (R, n).
        sign: (R,).
        axis: (R,) int.
        node: (R,) int, whose value is the centre; -1 for zero.
        scale: (R,) int, which of the scales: of rates, accelerations and ranges of joints, and of the tube.
    """

    on: Traced
    row: Traced
    sign: Traced
    axis: Traced
    node: Traced
    scale: Traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class BindingLoads:
    """``sign * load / limit <= 1`` at places.

    Attributes:
        on: (R,) bool.
        place: (R,).
        rows: (R, 4, n) of the basis there.
        sign: (R,).
        load: (R,) int.
        axis: (R,) int.
    """

    on: Traced
    place: Traced
    rows: Traced
    sign: Traced
    load: Traced
    axis: Traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class BindingMargins:
    """``margin >= wanted`` at places.

    Attributes:
        on: (R,) bool.
        place: (R,).
        row: (R, n) of the basis there.
        device: (R,) int, the sight.
        zone: (R,) int, the row of the constraints.
    """

    on: Traced
    place: Traced
    row: Traced
    device: Traced
    zone: Traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class ActiveSet:
    """A fit as a root, for `refit`.

    Attributes:
        free: (n, k) ``F`` of `CurveSpace`; so are the next two.
        of_values: (n, v).
        of_rates: (n, 2).
        energies: (3, n, n) of the first three derivatives, as shares of the first curve's.
        pieces: (K, 6, n) to Legendre coefficients on each interval.
        breaks: (K + 1,) in [0, 1].
        places: (m + 1,) of the nodes in [0, 1].
        given: (v,) int, nodes that are passed exactly.
        windings: (m + 1,) whole turns added to the logarithm at each node.
        long_way: 1 where the chart turns the long way round, else 0.
        share: of the limits on the platform's loads that the rows allow.
        widened: of the tube that was asked for, the one that was kept.
        counted: (2, D, Z) bool, which margins at the two ends count: of a constraint those of the best entry.
        duration: s, at which a fit without limits is made before its time is stretched; NaN for a given one.
        linear: rows that bind, as the next two.
        loads: of the platform's.
        zones: of margins.
        x: (k, A) the root.
        multipliers: (R,) of linear rows, loads and zones.
        stretched: whether the time is stretched to the limits.
    """

    free: Traced
    of_values: Traced
    of_rates: Traced
    energies: Traced
    pieces: Traced
    breaks: Traced
    places: Traced
    given: Traced
    windings: Traced
    long_way: Traced
    share: Traced
    widened: Traced
    counted: Traced
    duration: Traced
    linear: BindingLinear
    loads: BindingLoads
    zones: BindingMargins
    x: Traced
    multipliers: Traced
    stretched: bool = field(metadata={"static": True})


def filled(array: np.ndarray, size: int) -> np.ndarray:
    """An array with zeros added to its first axis."""
    return np.concatenate([array, np.zeros((size - len(array), *array.shape[1:]), array.dtype)])


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class FitInputs:
    """All that the optimum depends on.

    Attributes:
        attitude: (3, 3) of the chart.
        turn: (3,) likewise.
        nodes: (m + 1, A) ``b`` and joints.
        offset: (n, A) coefficients of the curve without freedom.
        energy: (n, n) of one axis.
        scales: of linear rows, see `BindingLinear`.
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
    held: ActiveSet,
    path: Path,
    craft: Spacecraft,
    settings: TrajectorySettings,
    cones: Constraints,
    rates: ArrayLike,
    duration: Traced,
) -> FitInputs:
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
    radius = held.widened * (options.ROWS.tube_radius if settings.node_tube is None else settings.node_tube)
    tube = jnp.concatenate([jnp.full(3, radius / np.sqrt(3.0)), jnp.full(joints.shape[1], radius)])
    platform, of_joints = timed_limits(craft)
    scales = [limit.bound * duration**limit.quantity.power for limit in of_joints]
    scales += [craft.joint_limits, tube]
    sights, at_ends = cones.sights(craft.mounts, craft.fixed_boresights), jnp.array([0, -1])
    margins = jnp.swapaxes(state_margins(cones, sights, attitudes[at_ends], joints[at_ends]), 1, 2)
    left = jnp.min(jnp.where(held.counted, margins, jnp.inf), axis=0)
    wanted = jnp.minimum(
        jnp.minimum(options.ROWS.clearance, room(cones)), options.ROWS.share_of_ends * jnp.maximum(left, 0)
    )
    return FitInputs(
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


def refit(
    held: ActiveSet,
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


@quick_jit
def linearised(held: ActiveSet, inputs: FitInputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """``F`` and its derivative at ``z``, the free coefficients and the multipliers in one row."""
    z = jnp.asarray(z)
    return _residual(held, inputs, z), _matrix(held, inputs, z)


def _solve(held: ActiveSet, inputs: FitInputs) -> Traced:
    """The root ``z``, flat."""
    return _root(held, inputs)[0]


@jax.custom_jvp
def _root(held: ActiveSet, inputs: FitInputs) -> tuple[Traced, tuple[Traced, Traced]]:
    """The root, and the factors of the matrix there."""
    z = jnp.concatenate([held.x.ravel(), held.multipliers])

    def far(at: tuple[Any, ...]) -> Traced:
        count, _, left, _ = at
        return (count < options.ACTIVE_SET.refit_steps) & ~jnp.all(
            jnp.abs(left) <= options.ACTIVE_SET.refit_residual
        )

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
def _root_slope(primals: tuple[ActiveSet, FitInputs], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    """The implicit function theorem; its matrix is held, so it must not be differentiated again."""
    z, factors = _root(*primals)
    held, inputs = first_derivatives_only(primals)
    _, left = jax.jvp(lambda held, inputs: _residual(held, inputs, z), (held, inputs), tangents)
    none = jnp.zeros_like(factors[0]), np.zeros(factors[1].shape, jax.dtypes.float0)
    return (z, factors), (-lu_solve(factors, left), none)


def _split(held: ActiveSet, z: Traced) -> tuple[Traced, Traced]:
    return z[: held.x.size].reshape(held.x.shape), z[held.x.size :]


def _on(held: ActiveSet) -> Traced:
    return jnp.concatenate([held.linear.on, held.loads.on, held.zones.on])


def _residual(held: ActiveSet, inputs: FitInputs, z: Traced) -> Traced:
    """``F``; a row that is padding stands for its multiplier, which is zero."""
    x, y = _split(held, z)
    c, on = held.free @ x + inputs.offset, _on(held)
    values, slopes = _rows(held, inputs, c)
    pull = held.free.T @ (inputs.energy @ c) + jnp.tensordot(jnp.where(on, y, 0), slopes, axes=1)
    return jnp.concatenate([pull.ravel(), jnp.where(on, values, y)])


def _rows(held: ActiveSet, inputs: FitInputs, c: Traced) -> tuple[Traced, Traced]:
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
    function: Callable[..., Traced], inputs: FitInputs, rows: BindingLoads | BindingMargins, local: Traced
) -> Traced:
    """A function of one row and what it depends on, for all rows."""
    return jax.vmap(function, (None, 0, 0))(inputs, rows, local)


def _load_row(inputs: FitInputs, row: BindingLoads, z: Traced) -> Traced:
    """One load at one place, from ``b`` and its derivatives (4, 3)."""
    loads = loads_at(inputs.turn, row.place, z, inputs.inertia, inputs.names)
    return row.sign * loads[row.load, row.axis] / inputs.limits[row.load, row.axis] - 1


def _zone_row(inputs: FitInputs, row: BindingMargins, z: Traced) -> Traced:
    """One margin at one place, from ``b`` and joints (3 + 2n,)."""
    half = so3.exp(row.place * inputs.turn / 2)
    attitude = inputs.attitude @ half @ so3.exp(z[:3] - row.place * inputs.turn) @ half
    cones, seen = inputs.cones.some(row.zone[None]), inputs.sights.in_body(z[3:])
    axis = axes_in_body(cones, cones.axis @ attitude, seen)[0]
    values = joint_values(cones, z[3:])[row.device] if cones.inner else None
    margin = margins_of_scores(cones, scores(cones, (seen[row.device] @ axis)[None], values))
    return inputs.wanted[row.device, row.zone] - margin[0]


def _matrix(held: ActiveSet, inputs: FitInputs, z: Traced) -> Traced:
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
    corner = jnp.diag(jnp.where(on, -options.ACTIVE_SET.regularisation, 1.0))
    return jnp.block([[curved.reshape(x.size, x.size), jacobian.T], [jacobian, corner]])
