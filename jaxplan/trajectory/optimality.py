"""The conditions of optimality of a spline fit, as long as the same rows bind, and their matrix.

The optimum ``x`` of a fit, with multipliers ``y`` of the rows that bind, is a root of

    F(x, y; inputs) = (gradient in x of energy + y . rows,  rows that bind) = 0.

In the shortest motion the logarithm ``t`` of its duration is looked for as well: the gradient is then that in
``x`` and ``t`` of ``t`` plus a little of the energy's logarithm. The matrix, the derivative of ``F`` in
``z = (x, y)`` or ``(x, y, t)``, is exact, with the curvature of loads and margins in it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import array_module
from jaxplan.model.constraints import Constraints, axes_in_body, joint_values, margins_of_scores, scores
from jaxplan.model.directions import Sights
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.trajectory.kernels import loads_at
from jaxplan.trajectory.sqp import ENERGY_WEIGHT

_REGULARISATION = 1e-13  # of the matrix, where rows that bind depend on each other

Traced = Any  # an array: of numpy as it is made, of JAX where it is traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class BindingLinear:
    """Linear rows that bind: ``sign * (row . c[:, axis] - centre) / scale <= 1``.

    Attributes:
        on: (R,) bool, the others are padding.
        rows: (R, 4, n), of a node with three derivatives by its place, of which others have none.
        sign: (R,).
        axis: (R,) int.
        node: (R,) int, whose value is the centre; -1 for that of the scale.
        scale: (R,) int, which of the scales: of rates, accelerations and ranges of joints, and of the tube.
    """

    on: Traced
    rows: Traced
    sign: Traced
    axis: Traced
    node: Traced
    scale: Traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class BindingLoads:
    """Rows of the platform's loads that bind: ``sign * load / limit <= 1`` at places.

    Attributes:
        on: (R,) bool.
        place: (R,).
        rows: (R, 4, n) of the basis there.
        sign: (R,).
        component: (R,) int, of all loads.
    """

    on: Traced
    place: Traced
    rows: Traced
    sign: Traced
    component: Traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class BindingMargins:
    """Rows of margins that bind: ``margin >= wanted`` at places.

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
        flank: share of the duration that a flank of the pace takes.
        least_length: s at full speed, what a path of next to no length is taken for.
        by_flank: derivatives by that of what lies on breaks that follow it, by the names of attributes;
            empty where breaks are even.
        given: (v,) int, nodes that are passed exactly.
        windings: (m + 1,) whole turns added to the logarithm at each node.
        long_way: 1 where the chart turns the long way round, else 0.
        share: of the limits on the platform's loads that the rows allow.
        widened: of the tube that was asked for, the one that was kept.
        counted: (2, D, Z) bool, which margins at the two ends count: of a constraint those of the best entry.
        duration: s, of the shortest motion, to begin with.
        linear: rows that bind, as the next two.
        loads: of the platform's.
        zones: of margins.
        x: (k, A) the root.
        multipliers: (R,) of linear rows, loads and zones.
        pace: when nodes are passed: "paced" by a trapezoid of the rate, "steady" or at "given" places.
        stretched: whether the time is stretched to the limits.
        free_time: whether the shortest duration was looked for.
    """

    free: Traced
    of_values: Traced
    of_rates: Traced
    energies: Traced
    pieces: Traced
    breaks: Traced
    places: Traced
    flank: Traced
    least_length: Traced
    by_flank: dict[str, Traced]
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
    pace: str = field(metadata={"static": True})
    stretched: bool = field(metadata={"static": True})
    free_time: bool = field(metadata={"static": True})


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class FitInputs:
    """All that the optimum depends on.

    Attributes:
        attitude: (3, 3) of the chart.
        turn: (3,) likewise.
        nodes: (m + 1, A) ``b`` and joints.
        moved: (m + 1,) of the nodes' places from those that are held.
        ends: (2, A) rad/s, rates of the coordinates.
        weights: (3,) of the squares of rate, acceleration and jerk.
        scales: of linear rows in time, see `BindingLinear`, with their powers of the duration.
        powers: likewise.
        centres: likewise, from which they are counted; of nodes these themselves.
        limits: (C,) of the components of the platform's loads, in time.
        wanted: (D, Z) rad, margins to keep.
        axes: (R, 3) axes of the rows of margins, inertial ones turned to the chart's middle between ``U``
            and ``U`` at the row's place, ``(R_a U)^T e``.
        halves: (R, 3, 3) ``U`` there.
        inertia: (3, 3).
        duration: s; of a shortest motion that with which it begins.
        cones: the pointing constraints.
        sights: what they bind, D of them.
        load_powers: (C,) of 1 / duration in the components.
        names: (Q,) of the platform's loads.
    """

    attitude: Traced
    turn: Traced
    nodes: Traced
    moved: Traced
    ends: Traced
    weights: Traced
    scales: Traced
    powers: Traced
    centres: Traced
    limits: Traced
    wanted: Traced
    axes: Traced
    halves: Traced
    inertia: Traced
    duration: Traced
    cones: Constraints
    sights: Sights
    load_powers: tuple[int, ...] = field(metadata={"static": True})
    names: tuple[str, ...] = field(metadata={"static": True})


@quick_jit
def linearised(held: ActiveSet, inputs: FitInputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """The conditions ``F`` and their derivative at ``z``, free coefficients and multipliers in one vector."""
    z = jnp.asarray(z)
    return residual(held, inputs, z), matrix(held, inputs, z)


@quick_jit
def curve_of(held: ActiveSet, inputs: FitInputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """Spline coefficients (n, A) and duration, s, of the curve that a root ``z`` of `residual` stands for."""
    x, _, duration = _split(held, inputs, jnp.asarray(z))
    return held.free @ x + offset_of(held, inputs, duration), duration


def flat(held: ActiveSet) -> Traced:
    """The ``z`` that is held: free coefficients, multipliers, and where time is free ``log(duration)``."""
    parts = [held.x.ravel(), held.multipliers]
    if held.free_time:
        parts.append(array_module(held.duration).log(held.duration)[None])
    return array_module(*parts).concatenate(parts)


def _split(held: ActiveSet, inputs: FitInputs, z: Traced) -> tuple[Traced, Traced, Traced]:
    """Free coefficients, multipliers, and the duration."""
    x, y = z[: held.x.size].reshape(held.x.shape), z[held.x.size :][: len(held.multipliers)]
    return x, y, jnp.exp(z[-1]) if held.free_time else inputs.duration


def offset_of(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """(n, A) coefficients of the curve without freedom."""
    return held.of_values @ inputs.nodes[held.given] + duration * (held.of_rates @ inputs.ends)


def energy_of(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """(n, n) of one axis."""
    return jnp.tensordot(inputs.weights * duration ** -np.array([1.0, 3.0, 5.0]), held.energies, axes=1)


def _on(held: ActiveSet) -> Traced:
    return jnp.concatenate([held.linear.on, held.loads.on, held.zones.on])


def residual(held: ActiveSet, inputs: FitInputs, z: Traced) -> Traced:
    """``F``; a row that is padding stands for its multiplier, which is zero."""
    x, y, duration = _split(held, inputs, z)
    c, on = held.free @ x + offset_of(held, inputs, duration), _on(held)
    values, slopes = _values(held, inputs, c, duration), _slopes(held, inputs, c, duration)
    if held.free_time:
        by_time, gradient = _log_energy_slopes(held, inputs, c, z[-1])
    else:
        gradient = energy_of(held, inputs, duration) @ c
    pull = held.free.T @ gradient + jnp.tensordot(jnp.where(on, y, 0), slopes, axes=1)
    parts = [pull.ravel(), jnp.where(on, values, y)]
    if held.free_time:
        shares = jnp.where(on, _powers(held, inputs) * (values + 1), 0)
        parts.append((1 + by_time - jnp.sum(y * shares))[None])
    return jnp.concatenate(parts)


def _log_energy_slopes(held: ActiveSet, inputs: FitInputs, c: Traced, time: Traced) -> tuple[Traced, Traced]:
    """Derivatives of what little a shortest motion has of its energy's logarithm, in ``t`` and in ``c``."""

    def little(time: Traced, c: Traced) -> Traced:
        energy = jnp.sum(c * (energy_of(held, inputs, jnp.exp(time)) @ c)) / 2
        return ENERGY_WEIGHT * jnp.log(energy)

    slopes: tuple[Traced, Traced] = jax.grad(little, (0, 1))(time, c)
    return slopes


def _powers(held: ActiveSet, inputs: FitInputs) -> Traced:
    """(R,) of the duration by which rows fall; a motion from rest to rest depends on it in no other way."""
    linear = inputs.powers[held.linear.scale]
    loads = jnp.array(inputs.load_powers, float)[held.loads.component]
    return jnp.concatenate([linear, loads, jnp.zeros(len(held.zones.on))])


def _linear_factors(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """Factors (R,) of the linear rows: their signs over their scales."""
    scale = inputs.scales[held.linear.scale] * duration ** inputs.powers[held.linear.scale]
    return held.linear.sign / jnp.where(held.linear.on, scale, 1)


def _linear_rows(held: ActiveSet, inputs: FitInputs) -> Traced:
    """(R, n) of the basis, those of nodes where these are passed now."""
    linear = held.linear
    moved = jnp.where(linear.node >= 0, inputs.moved[linear.node], 0)
    powers = jnp.stack([jnp.ones_like(moved), moved, moved**2 / 2, moved**3 / 6], axis=1)
    return jnp.einsum("rd,rdn->rn", powers, linear.rows)


def _values(held: ActiveSet, inputs: FitInputs, c: Traced, duration: Traced) -> Traced:
    """By how much of a limit, of zones by how many rad, each row is broken (R,)."""
    linear, loads, zones = held.linear, held.loads, held.zones
    value = jnp.einsum("rn,nr->r", _linear_rows(held, inputs), c[:, linear.axis])
    of_node = inputs.nodes[linear.node, linear.axis]
    centre = jnp.where(linear.node >= 0, of_node, inputs.centres[linear.scale])
    values = [_linear_factors(held, inputs, duration) * (value - centre) - 1]
    if len(loads.on):
        local = jnp.einsum("rdn,na->rda", loads.rows, c[:, :3])
        values.append(_load_values(inputs, duration, loads, local))
    if len(zones.on):
        values.append(_zone_values(inputs, zones, (inputs.axes, inputs.halves), zones.row @ c))
    return jnp.concatenate(values)


def _slopes(held: ActiveSet, inputs: FitInputs, c: Traced, duration: Traced) -> Traced:
    """Derivatives (R, k, A) of the rows in the free coefficients."""
    linear, loads, zones = held.linear, held.loads, held.zones
    axes = c.shape[1]
    rows = _linear_factors(held, inputs, duration)[:, None] * (_linear_rows(held, inputs) @ held.free)
    slopes = [jnp.einsum("rk,ra->rka", rows, jnp.eye(axes)[linear.axis])]
    if len(loads.on):
        local = jnp.einsum("rdn,na->rda", loads.rows, c[:, :3])
        slope = _load_slopes(inputs, duration, loads, local)
        own = jnp.einsum("rdk,rda->rka", loads.rows @ held.free, slope)
        slopes.append(jnp.pad(own, ((0, 0), (0, 0), (0, axes - 3))))
    if len(zones.on):
        slope = _zone_slopes(inputs, zones, (inputs.axes, inputs.halves), zones.row @ c)
        slopes.append(jnp.einsum("rk,ra->rka", zones.row @ held.free, slope))
    return jnp.concatenate(slopes)


def _load_row(inputs: FitInputs, duration: Traced, row: BindingLoads, z: Traced) -> Traced:
    """One load at one place, from ``b`` and its derivatives (4, 3)."""
    loads = loads_at(inputs.turn, row.place, z, inputs.inertia, inputs.names)
    limit = inputs.limits * duration ** np.array(inputs.load_powers, float)
    return row.sign * loads[row.component] / limit[row.component] - 1


def _zone_row(inputs: FitInputs, row: BindingMargins, chart: tuple[Traced, Traced], z: Traced) -> Traced:
    """One margin at one place, with axis and ``U`` of the row there, from ``b`` and joints (3 + 2n,)."""
    axis, half = chart
    turned = axis @ so3.exp(z[:3] - row.place * inputs.turn) @ half
    cones, seen = inputs.cones.some(row.zone[None]), inputs.sights.in_body(z[3:])
    axis = axes_in_body(cones, turned[None], seen)[0]
    values = joint_values(cones, inputs.sights.gimbals, z[3:])[row.device] if cones.inner else None
    margin = margins_of_scores(cones, scores(cones, (seen[row.device] @ axis)[None], values))
    return inputs.wanted[row.device, row.zone] - margin[0]


def _with_slopes(row: Callable[..., Traced], axes: Any) -> tuple[Callable[..., Traced], ...]:
    """A function of one row for all of them, its derivative in what it depends on, and the second one.

    They are jitted, so that however often a program calls them they are traced and compiled once.
    """
    slope = jax.jacfwd(row, 3)
    return tuple(jax.jit(jax.vmap(one, axes)) for one in (row, slope, jax.jacfwd(slope, 3)))


_load_values, _load_slopes, _load_bends = _with_slopes(_load_row, (None, None, 0, 0))
_zone_values, _zone_slopes, _zone_bends = _with_slopes(_zone_row, (None, 0, 0, 0))


def matrix(held: ActiveSet, inputs: FitInputs, z: Traced) -> Traced:
    """Derivative of `residual` in ``z``, put together from small blocks at the rows that bind."""
    x, y, duration = _split(held, inputs, z)
    c, free, on = held.free @ x + offset_of(held, inputs, duration), held.free, _on(held)
    loads, zones = held.loads, held.zones
    counts = np.cumsum([len(held.linear.on), len(loads.on)])
    _, of_loads, of_zones = jnp.split(jnp.where(on, y, 0), counts)
    energy, identity = energy_of(held, inputs, duration), jnp.eye(x.shape[1])
    curved = jnp.einsum("kl,ab->kalb", free.T @ energy @ free, identity)
    if held.free_time:  # of the energy's logarithm
        least = jnp.sum(c * (energy @ c)) / 2
        pull = free.T @ (energy @ c) / least
        curved = ENERGY_WEIGHT * (curved / least - jnp.einsum("ka,lb->kalb", pull, pull))
    if len(loads.on):
        basis = loads.rows @ free
        local = jnp.einsum("rdn,na->rda", loads.rows, c[:, :3])
        bend = _load_bends(inputs, duration, loads, local)
        own = jnp.einsum("r,rdk,rdaeb,rel->kalb", of_loads, basis, bend, basis, optimize=True)
        curved = curved.at[:, :3, :, :3].add(own)
    if len(zones.on):
        basis = zones.row @ free
        bend = _zone_bends(inputs, zones, (inputs.axes, inputs.halves), zones.row @ c)
        curved = curved + jnp.einsum("r,rk,rab,rl->kalb", of_zones, basis, bend, basis, optimize=True)
    jacobian = _slopes(held, inputs, c, duration).reshape(len(y), x.size) * on[:, None]
    corner = jnp.diag(jnp.where(on, -_REGULARISATION, 1.0))
    at_time = jnp.block([[curved.reshape(x.size, x.size), jacobian.T], [jacobian, corner]])
    if not held.free_time:
        return at_time
    falls = jnp.where(on, _powers(held, inputs), 0)
    shares = falls * (_values(held, inputs, c, duration) + 1)
    _, (corner, of_c) = jax.jvp(
        lambda time: _log_energy_slopes(held, inputs, c, time), (z[-1],), (jnp.ones_like(z[-1]),)
    )
    beside = (free.T @ of_c).ravel() - jnp.tensordot(y * falls, jacobian, axes=1)
    corner = corner + jnp.sum(y * falls * shares)
    by_time = jnp.concatenate([beside, -shares, corner[None]])
    return jnp.block([[at_time, by_time[:-1, None]], [by_time[None]]])  # symmetric, as of a gradient
