"""The conditions of optimality of a spline fit, as long as the same rows bind, and their matrix.

A *row* is an inequality of the fit (`constraints`); letters of sizes are those of `motion`. The optimum ``x``
of a fit (its free coefficients), with multipliers ``y`` of the rows that bind, is a root of

    F(x, y; inputs) = (gradient in x of energy + y . rows,  rows that bind) = 0.

In the shortest motion the logarithm ``t`` of its duration is an unknown as well: the gradient is then that in
``x`` and ``t`` of ``t`` plus a little of the energy's logarithm. The matrix, the derivative of ``F`` in
``z = (x, y)`` or ``(x, y, t)``, is exact, with the curvature of loads and margins in it.

In all functions below `held` is the active set, which stays fixed, `inputs` are the numbers in which the root
is differentiated, ``z`` is as above, ``c`` are spline coefficients (n, A), and durations are in s.
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
from jaxplan.model.constraints import Constraints, axes_in_body, joint_values
from jaxplan.model.directions import Sights
from jaxplan.model.scores import margins_of_scores, scores
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.trajectory.kernels import Body, loads_at
from jaxplan.trajectory.sqp import ENERGY_WEIGHT

_REGULARISATION = 1e-13  # of the matrix, where rows that bind depend on each other

Traced = Any  # an array: of numpy when it is made, of JAX where it is traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class BindingLinear:
    """Linear rows that bind: ``sign * (row . c[:, axis] - centre) / scale <= 1``.

    Attributes:
        on: (R,) bool, the others are padding.
        rows: (R, 4, n) coefficients of ``c``; for a node in a tube also their derivatives in its place, for
            others zeros.
        sign: (R,) -1 or 1.
        axis: (R,) int, index among the A axes.
        node: (R,) int, the node whose value is the centre; -1 to take the centre of the scale.
        scale: (R,) int, index in `FitInputs.scales`.
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
        on: (R,) bool, the others are padding.
        place: (R,) in [0, 1].
        rows: (R, 4, n) values of the splines, and of their three derivatives, there.
        sign: (R,) -1 or 1.
        component: (R,) int, index among the C loads.
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
        on: (R,) bool, the others are padding.
        place: (R,) in [0, 1].
        row: (R, n) values of the splines there.
        device: (R,) int, index of the sight.
        zone: (R,) int, index of the row of the constraints.
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
    """What is held fixed of a fit whose optimum is a root, for `refit`.

    Attributes:
        free: (n, k) ``F`` of `CurveSpace`; the next two are its attributes, too.
        of_values: (n, v).
        of_rates: (n, 2).
        energies: (3, n, n) Gram matrices of the splines' three derivatives, over the first curve's energy.
        pieces: (K, 6, n) from coefficients to Legendre coefficients on each interval.
        breaks: (K + 1,) in [0, 1].
        places: (m + 1,) of the nodes in [0, 1].
        flank: share of the duration that a flank of the pace takes.
        least_length: s at full speed, the least length that a path is taken to have.
        by_flank: derivatives in `flank` of the attributes that depend on the breaks, by their names; empty
            where breaks do not follow the flank.
        given: (v,) int, nodes that are passed exactly, the ends first.
        windings: (m + 1,) whole turns added to the logarithm at each node.
        long_way: 1 where the chart turns the long way round, else 0.
        share: of the limits on the platform's loads that the rows allow.
        widened: radius of the tube that was used over that asked for.
        counted: (2, D, Z) bool, which margins at the two ends count: of a constraint those of the best entry.
        duration: s, of the optimum; where that is given, the inputs' is used instead.
        linear: linear rows that bind.
        loads: rows of the platform's loads that bind.
        zones: rows of margins that bind.
        x: (k, A) free coefficients of the root.
        multipliers: (R,) of linear rows, loads and zones, one after the other.
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
        attitude: (3, 3) of the chart, body to inertial.
        turn: (3,) rad, of the chart.
        nodes: (m + 1, A) rad, ``b`` and joints.
        moved: (m + 1,) how far the nodes' places are from those that are held.
        ends: (2, A) rad/s, rates of the coordinates.
        weights: (3,) of the squares of rate, acceleration and jerk.
        scales: bounds of linear rows, see `BindingLinear`: joints' rates (rad/s), accelerations (rad/s^2) and
            half ranges (rad), and the tube's radius on each axis (rad).
        powers: powers of the duration by which the scales are multiplied.
        centres: values about which the scales' bounds lie; for the tube the nodes are used instead.
        limits: (C,) on the components of the platform's loads, in units of time.
        wanted: (D, Z) rad, margins to keep.
        axes: (R, 3) axes of the rows of margins, inertial ones turned to the chart's middle between ``U``
            and ``U`` at the row's place, ``(R_a U)^T e``.
        halves: (R, 3, 3) ``U`` there.
        body: what turns.
        duration: s; for a shortest motion not used, as it is an unknown.
        cones: the pointing constraints.
        sights: the D directions that they bind.
        load_powers: (C,) powers of 1 / duration that the components have.
        lesser: (C,) number of the lesser part of each, among all loads; -1 for none.
        names: (Q,) of the platform's limited quantities.
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
    body: Body
    duration: Traced
    cones: Constraints
    sights: Sights
    load_powers: tuple[int, ...] = field(metadata={"static": True})
    lesser: tuple[int, ...] = field(metadata={"static": True})
    names: tuple[str, ...] = field(metadata={"static": True})


@quick_jit
def linearised(held: ActiveSet, inputs: FitInputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """The conditions ``F`` and their derivative at ``z``, see `residual` and `matrix`."""
    z = jnp.asarray(z)
    return residual(held, inputs, z), matrix(held, inputs, z)


@quick_jit
def curve_of(held: ActiveSet, inputs: FitInputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """Spline coefficients (n, A) and duration, s, of the curve at ``z``, such as a root of `residual`."""
    x, _, duration = _split(held, inputs, jnp.asarray(z))
    return held.free @ x + offset_of(held, inputs, duration), duration


def flat(held: ActiveSet) -> Traced:
    """``z`` of an active set: free coefficients, multipliers, and ``log(duration)`` if that is free."""
    parts = [held.x.ravel(), held.multipliers]
    if held.free_time:
        parts.append(array_module(held.duration).log(held.duration)[None])
    return array_module(*parts).concatenate(parts)


def _split(held: ActiveSet, inputs: FitInputs, z: Traced) -> tuple[Traced, Traced, Traced]:
    """Free coefficients ``x`` (k, A), multipliers ``y`` (R,) and duration (s) from ``z``."""
    x, y = z[: held.x.size].reshape(held.x.shape), z[held.x.size :][: len(held.multipliers)]
    return x, y, jnp.exp(z[-1]) if held.free_time else inputs.duration


def offset_of(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """(n, A) coefficients of the curve whose free coefficients are zero, in a duration (s)."""
    return held.of_values @ inputs.nodes[held.given] + duration * (held.of_rates @ inputs.ends)


def energy_of(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """(n, n) matrix of the energy of one axis in a duration (s), over the first curve's energy."""
    return jnp.tensordot(inputs.weights * duration ** -np.array([1.0, 3.0, 5.0]), held.energies, axes=1)


def _on(held: ActiveSet) -> Traced:
    """(R,) bool, which of all rows are no padding."""
    return jnp.concatenate([held.linear.on, held.loads.on, held.zones.on])


def residual(held: ActiveSet, inputs: FitInputs, z: Traced) -> Traced:
    """``F`` at ``z``, a vector like it; for a row that is padding it is the row's multiplier, zero."""
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
        lesser = _lesser_terms(held, inputs, c, duration)
        if lesser is not None:
            shares = shares.at[lesser[0]].add(-lesser[1])
        parts.append((1 + by_time - jnp.sum(y * shares))[None])
    return jnp.concatenate(parts)


def _log_energy_slopes(held: ActiveSet, inputs: FitInputs, c: Traced, time: Traced) -> tuple[Traced, Traced]:
    """Derivatives of ``ENERGY_WEIGHT * log(energy)`` in ``t``, which is `time`, and in ``c`` (n, A)."""

    def little(time: Traced, c: Traced) -> Traced:
        energy = jnp.sum(c * (energy_of(held, inputs, jnp.exp(time)) @ c)) / 2
        return ENERGY_WEIGHT * jnp.log(energy)

    slopes: tuple[Traced, Traced] = jax.grad(little, (0, 1))(time, c)
    return slopes


def _powers(held: ActiveSet, inputs: FitInputs) -> Traced:
    """(R,) powers of the duration by which rows fall; a motion at rest at its ends depends on it only so."""
    linear = inputs.powers[held.linear.scale]
    loads = jnp.array(inputs.load_powers, float)[held.loads.component]
    return jnp.concatenate([linear, loads, jnp.zeros(len(held.zones.on))])


def _lesser_terms(held: ActiveSet, inputs: FitInputs, c: Traced, duration: Traced) -> Any:
    """Lesser parts of the rows of loads, by which these fall less, and their slopes in the free coefficients.

    Returns:
        The rows' slice among all, the parts (R,), zero of padding, and the slopes (R, k A); None where no
        load has a lesser part.
    """
    loads, first = held.loads, len(held.linear.on)
    if not len(loads.on) or max(inputs.lesser) < 0:
        return None
    local = jnp.einsum("rdn,na->rda", loads.rows, c[:, :3])
    value = jnp.where(loads.on, _lesser_values(inputs, duration, loads, local), 0)
    slope = jnp.einsum("rdk,rda->rka", loads.rows @ held.free, _lesser_slopes(inputs, duration, loads, local))
    slope = jnp.pad(slope, ((0, 0), (0, 0), (0, c.shape[1] - 3))).reshape(len(value), -1)
    return slice(first, first + len(value)), value, jnp.where(loads.on[:, None], slope, 0)


def _linear_factors(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """Factors (R,) of the linear rows: their signs over their scales."""
    scale = inputs.scales[held.linear.scale] * duration ** inputs.powers[held.linear.scale]
    return held.linear.sign / jnp.where(held.linear.on, scale, 1)


def _linear_rows(held: ActiveSet, inputs: FitInputs) -> Traced:
    """(R, n) coefficients of ``c`` in the linear rows, for nodes at the places where they are passed now."""
    linear = held.linear
    moved = jnp.where(linear.node >= 0, inputs.moved[linear.node], 0)
    powers = jnp.stack([jnp.ones_like(moved), moved, moved**2 / 2, moved**3 / 6], axis=1)
    return jnp.einsum("rd,rdn->rn", powers, linear.rows)


def _values(held: ActiveSet, inputs: FitInputs, c: Traced, duration: Traced) -> Traced:
    """(R,) by how much each row is broken: shares of the bound, for margins rad."""
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
    """Derivatives (R, k, A) of the rows' `_values` in the free coefficients."""
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
    """By what share of its limit one load exceeds it, from ``b`` and its derivatives, z (4, 3)."""
    loads = loads_at(inputs.turn, row.place, z, inputs.body, inputs.names)
    limit = inputs.limits * duration ** np.array(inputs.load_powers, float)
    value = row.sign * loads[row.component] / limit[row.component] - 1
    if any(number >= 0 for number in inputs.lesser):
        value = value + (1 - 1 / duration) * _lesser_row(inputs, duration, row, z)
    return value


def _lesser_row(inputs: FitInputs, duration: Traced, row: BindingLoads, z: Traced) -> Traced:
    """The part of a load's share of its limit that falls by one power less; arguments as of `_load_row`."""
    loads = loads_at(inputs.turn, row.place, z, inputs.body, inputs.names)
    number = jnp.array(inputs.lesser)[row.component]
    limit = inputs.limits * duration ** np.array([power - 1.0 for power in inputs.load_powers])
    return jnp.where(number >= 0, row.sign * loads[number] / limit[row.component], 0)


def _zone_row(inputs: FitInputs, row: BindingMargins, chart: tuple[Traced, Traced], z: Traced) -> Traced:
    """By how much one margin lacks of what is wanted, rad.

    Args:
        inputs: as of the module.
        row: the row, at its place.
        chart: its entries of `FitInputs.axes` (3,) and `FitInputs.halves` (3, 3).
        z: (A,) ``b`` and joints there, rad.
    """
    axis, half = chart
    turned = axis @ so3.exp(z[:3] - row.place * inputs.turn) @ half
    cones, seen = inputs.cones.some(row.zone[None]), inputs.sights.in_body(z[3:])
    axis = axes_in_body(cones, turned[None], seen)[0]
    values = joint_values(cones, inputs.sights.gimbals, z[3:])[row.device] if cones.inner else None
    margin = margins_of_scores(cones, scores(cones, (seen[row.device] @ axis)[None], values))
    return inputs.wanted[row.device, row.zone] - margin[0]


def _with_slopes(row: Callable[..., Traced], axes: Any) -> tuple[Callable[..., Traced], ...]:
    """A function of one row mapped over all rows, its first and its second derivative in the last argument.

    They are jitted, so that however often a program calls them they are traced and compiled once.

    Args:
        row: of four arguments.
        axes: for each argument 0 if rows have their own, None if they share it, as of `jax.vmap`.
    """
    slope = jax.jacfwd(row, 3)
    return tuple(jax.jit(jax.vmap(one, axes)) for one in (row, slope, jax.jacfwd(slope, 3)))


_load_values, _load_slopes, _load_bends = _with_slopes(_load_row, (None, None, 0, 0))
_lesser_values, _lesser_slopes, _ = _with_slopes(_lesser_row, (None, None, 0, 0))
_zone_values, _zone_slopes, _zone_bends = _with_slopes(_zone_row, (None, 0, 0, 0))


def matrix(held: ActiveSet, inputs: FitInputs, z: Traced) -> Traced:
    """Derivative of `residual` in ``z``, square, assembled from small blocks at the rows that bind."""
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
    lesser = _lesser_terms(held, inputs, c, duration)
    if lesser is not None:
        own, slow, bent = lesser
        beside = beside + jnp.tensordot(y[own], bent, axes=1)
        # p^2 (whole - slow) + (p - 1)^2 slow
        corner = corner + jnp.sum(y[own] * (1 - 2 * falls[own]) * slow)
        shares = shares.at[own].add(-slow)
    by_time = jnp.concatenate([beside, -shares, corner[None]])
    return jnp.block([[at_time, by_time[:-1, None]], [by_time[None]]])  # symmetric, as of a gradient
