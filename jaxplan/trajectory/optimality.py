"""The optimality conditions of a spline fit for a fixed set of binding rows, and their derivative matrix.

A *row* is an inequality of the fit (`constraints`); it *binds* if it holds with equality. R is the number of
rows, k that of free coefficients on each axis, and other letters of sizes are those of `motion`. The optimum
``x`` of a fit (its free coefficients), with multipliers ``y`` of the rows that bind, is a root of

    F(x, y; inputs) = (gradient in x of energy + y . rows,  rows that bind) = 0.

In the shortest motion the logarithm ``t`` of its duration is an unknown as well: the gradient is then that in
``x`` and ``t`` of ``t`` plus a small multiple of the energy's logarithm. The matrix, the derivative of ``F``
in ``z = (x, y)`` or ``(x, y, t)``, is exact, with the curvature of loads and margins in it.

In all functions below `held` is the active set, which stays fixed, `inputs` are the numbers in which the root
is differentiated, ``z`` is as above, ``c`` are spline coefficients (n, A), and durations are in s. Arrays of
rows are padded to a few sizes; a row that is padding has no effect.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import array_module
from jaxplan.model.constraints import axes_in_body, joint_values
from jaxplan.model.scores import margins_of_scores, scores
from jaxplan.runtime.jit import quick_jit
from jaxplan.trajectory.binding import ActiveSet, BindingLoads, BindingMargins, FitInputs, Traced
from jaxplan.trajectory.kernels import loads_at
from jaxplan.trajectory.sqp import ENERGY_WEIGHT

_REGULARISATION = 1e-13  # subtracted from the diagonal of binding rows, which may depend on each other


@partial(quick_jit, level=1)
def linearised(held: ActiveSet, inputs: FitInputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """Return the conditions ``F`` and their derivative in ``z``, see `conditions`."""
    return conditions(held, inputs, jnp.asarray(z))


@quick_jit
def curve_of(held: ActiveSet, inputs: FitInputs, z: ArrayLike) -> tuple[Traced, Traced]:
    """Return the curve at ``z``: n spline coefficients on each of A axes (n, A), and the duration in s."""
    x, _, duration = _split_unknowns(held, inputs, jnp.asarray(z))
    return held.free @ x + offset_of(held, inputs, duration), duration


def flat(held: ActiveSet) -> Traced:
    """Make ``z`` of an active set: free coefficients, multipliers, and ``log(duration)`` if that is free."""
    parts = [held.x.ravel(), held.multipliers]
    if held.free_time:
        parts.append(array_module(held.duration).log(held.duration)[None])
    return array_module(*parts).concatenate(parts)


def _split_unknowns(held: ActiveSet, inputs: FitInputs, z: Traced) -> tuple[Traced, Traced, Traced]:
    """Split ``z`` into free coefficients ``x`` (k, A), multipliers ``y`` (R,) of rows, and duration (s)."""
    x, y = z[: held.x.size].reshape(held.x.shape), z[held.x.size :][: len(held.multipliers)]
    return x, y, jnp.exp(z[-1]) if held.free_time else inputs.duration


def offset_of(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """Spline coefficients (n, A), on A axes, of the curve whose free coefficients are all zero."""
    return held.of_values @ inputs.nodes[held.given] + duration * (held.of_rates @ inputs.ends)


def energy_of(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """Matrix (n, n) of one axis's energy in n spline coefficients, divided by the first curve's energy."""
    return jnp.tensordot(inputs.weights * duration ** -np.array([1.0, 3.0, 5.0]), held.energies, axes=1)


def _row_mask(held: ActiveSet) -> Traced:
    """(R,) bool for all rows (linear ones, loads, margins), false for padding."""
    return jnp.concatenate([held.linear.on, held.loads.on, held.zones.on])


def residual(held: ActiveSet, inputs: FitInputs, z: Traced) -> Traced:
    """Evaluate the conditions ``F`` at ``z``, a vector of the same length.

    The entry of a row that is padding is that row's multiplier, so that it is zero at the root.
    """
    return _residual(held, inputs, z, _rows_at(held, inputs, z))


def _residual(held: ActiveSet, inputs: FitInputs, z: Traced, rows: "_Rows") -> Traced:
    """Do the same as `residual` where the rows at ``z`` are known."""
    _, y, duration = _split_unknowns(held, inputs, z)
    on, (c, values, slopes, lesser) = _row_mask(held), rows
    if held.free_time:
        by_time, gradient = _log_energy_slopes(held, inputs, c, z[-1])
    else:
        gradient = energy_of(held, inputs, duration) @ c
    pull = held.free.T @ gradient + jnp.tensordot(jnp.where(on, y, 0), slopes, axes=1)
    parts = [pull.ravel(), jnp.where(on, values, y)]
    if held.free_time:
        shares = jnp.where(on, _duration_powers(held, inputs) * (values + 1), 0)
        if lesser is not None:
            shares = shares.at[_load_rows(held)].add(-lesser[0])
        parts.append((1 + by_time - jnp.sum(y * shares))[None])
    return jnp.concatenate(parts)


def _log_energy_slopes(held: ActiveSet, inputs: FitInputs, c: Traced, time: Traced) -> tuple[Traced, Traced]:
    """Derivatives of ``ENERGY_WEIGHT * log(energy)`` in ``t`` (the argument `time`) and in ``c``."""

    def little(time: Traced, c: Traced) -> Traced:
        energy = jnp.sum(c * (energy_of(held, inputs, jnp.exp(time)) @ c)) / 2
        return ENERGY_WEIGHT * jnp.log(energy)

    slopes: tuple[Traced, Traced] = jax.grad(little, (0, 1))(time, c)
    return slopes


def _duration_powers(held: ActiveSet, inputs: FitInputs) -> Traced:
    """(R,) power of the duration by which each row falls; zero for margins.

    A motion at rest at its ends depends on the duration in no other way, lesser parts of loads apart.
    """
    linear = inputs.powers[held.linear.scale]
    loads = jnp.array(inputs.load_powers, float)[held.loads.component]
    return jnp.concatenate([linear, loads, jnp.zeros(len(held.zones.on))])


def _load_rows(held: ActiveSet) -> slice:
    """The slice of the loads' rows among all rows."""
    first = len(held.linear.on)
    return slice(first, first + len(held.loads.on))


def _linear_factors(held: ActiveSet, inputs: FitInputs, duration: Traced) -> Traced:
    """(R,) factors of the linear rows: their signs over their scales, which depend on the duration."""
    scale = inputs.scales[held.linear.scale] * duration ** inputs.powers[held.linear.scale]
    return held.linear.sign / jnp.where(held.linear.on, scale, 1)


def _linear_rows(held: ActiveSet, inputs: FitInputs) -> Traced:
    """(R, n) factors of the n coefficients in each linear row, with nodes at their present places."""
    linear = held.linear
    moved = jnp.where(linear.node >= 0, inputs.moved[linear.node], 0)
    powers = jnp.stack([jnp.ones_like(moved), moved, moved**2 / 2, moved**3 / 6], axis=1)
    return jnp.einsum("rd,rdn->rn", powers, linear.rows)


class _Rows(NamedTuple):
    """All rows at some ``z``, with their derivatives in the k free coefficients of each axis.

    Attributes:
        coefficients: (n, A) of the curve there, ``c``.
        values: (R,) excess of each row over its bound, negative if kept: a fraction of the bound; rad for
            margins.
        slopes: (R, k, A) its derivatives.
        lesser: the lesser parts of the loads' rows (one each, zero for padding), which fall by one power of
            the duration less than the rest of their loads, and the derivatives of these (one row each, k A
            columns); None where no load has a lesser part.
    """

    coefficients: Traced
    values: Traced
    slopes: Traced
    lesser: tuple[Traced, Traced] | None


def _rows_at(held: ActiveSet, inputs: FitInputs, z: Traced) -> _Rows:
    """Evaluate all rows with their derivatives."""
    x, _, duration = _split_unknowns(held, inputs, z)
    c, axes = held.free @ x + offset_of(held, inputs, duration), x.shape[1]
    linear, loads, zones = held.linear, held.loads, held.zones
    factors, own_rows, lesser = _linear_factors(held, inputs, duration), _linear_rows(held, inputs), None
    value = jnp.einsum("rn,nr->r", own_rows, c[:, linear.axis])
    of_node = inputs.nodes[linear.node, linear.axis]
    centre = jnp.where(linear.node >= 0, of_node, inputs.centres[linear.scale])
    values = [factors * (value - centre) - 1]
    rows = factors[:, None] * (own_rows @ held.free)
    slopes = [jnp.einsum("rk,ra->rka", rows, jnp.eye(axes)[linear.axis])]
    if len(loads.on):
        local, basis = _local_curves(inputs, loads, c), loads.rows @ held.free
        found, slow = _load_values(inputs, duration, loads, local)
        values.append(found)
        by_free = [
            jnp.einsum("rdk,rda->rka", basis, slope) for slope in _load_slopes(inputs, duration, loads, local)
        ]
        by_free = [jnp.pad(one, ((0, 0), (0, 0), (0, axes - one.shape[2]))) for one in by_free]
        slopes.append(by_free[0])
        if max(inputs.lesser) >= 0:
            bent = by_free[1].reshape(len(slow), -1)
            lesser = jnp.where(loads.on, slow, 0), jnp.where(loads.on[:, None], bent, 0)
    if len(zones.on):
        chart = inputs.axes, inputs.halves
        values.append(_zone_values(inputs, zones, chart, zones.row @ c))
        slope = _zone_slopes(inputs, zones, chart, zones.row @ c)
        slopes.append(jnp.einsum("rk,ra->rka", zones.row @ held.free, slope))
    return _Rows(c, jnp.concatenate(values), jnp.concatenate(slopes), lesser)


def _local_curves(inputs: FitInputs, loads: BindingLoads, c: Traced) -> Traced:
    """The curve (r, 4, B) at the places of r rows of loads, with three derivatives, on the axes they need."""
    return jnp.einsum("rdn,na->rda", loads.rows, c[:, : inputs.body.axes])


def _load_excess(inputs: FitInputs, duration: Traced, row: BindingLoads, z: Traced) -> tuple[Traced, Traced]:
    """Fraction of its limit by which one load exceeds it, negative if it is kept, and its lesser part.

    Args:
        inputs: as of the module.
        duration: s.
        row: a single row, at its place.
        z: (4, B) the curve's first B axes there (``b``, perhaps joints), and their three derivatives by the
            place.

    Returns:
        The excess, and the lesser part as a fraction of the load's limit, zero where there is none.
    """
    loads = loads_at(inputs.turn, row.place, z, inputs.body, inputs.names)
    limit = inputs.limits * duration ** np.array(inputs.load_powers, float)
    value = row.sign * loads[row.component] / limit[row.component] - 1
    if max(inputs.lesser) < 0:
        return value, jnp.zeros_like(value)
    number = jnp.array(inputs.lesser)[row.component]
    limit = inputs.limits * duration ** np.array([power - 1.0 for power in inputs.load_powers])
    slow = jnp.where(number >= 0, row.sign * loads[number] / limit[row.component], 0)
    return value + (1 - 1 / duration) * slow, slow


def _margin_shortfall(
    inputs: FitInputs, row: BindingMargins, chart: tuple[Traced, Traced], z: Traced
) -> Traced:
    """Angle in rad by which one margin falls short of what is wanted; negative if it is kept.

    Args:
        inputs: as of the module.
        row: a single row, at its place.
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


def _map_with_derivatives(row: Callable[..., Any], axes: Any) -> tuple[Callable[..., Any], ...]:
    """Map a function of one row over all rows, with its first and second derivative in the last argument.

    The three functions are jitted, so that they are traced and compiled once however often a program calls
    them.

    Args:
        row: of four arguments.
        axes: for each argument 0 if rows have their own, None if they share it, as of `jax.vmap`.
    """
    slope = jax.jacfwd(row, 3)
    return tuple(jax.jit(jax.vmap(one, axes)) for one in (row, slope, jax.jacfwd(slope, 3)))


_load_values, _load_slopes, _load_hessians = _map_with_derivatives(_load_excess, (None, None, 0, 0))
_zone_values, _zone_slopes, _zone_hessians = _map_with_derivatives(_margin_shortfall, (None, 0, 0, 0))


def conditions(held: ActiveSet, inputs: FitInputs, z: Traced) -> tuple[Traced, Traced]:
    """Evaluate the conditions ``F`` at ``z``, with their derivative in ``z``, which is a symmetric matrix."""
    rows = _rows_at(held, inputs, z)
    return _residual(held, inputs, z, rows), _matrix(held, inputs, z, rows)


def _matrix(held: ActiveSet, inputs: FitInputs, z: Traced, rows: "_Rows") -> Traced:
    """Derivative of `residual` in ``z``, assembled from blocks at the binding rows."""
    x, y, duration = _split_unknowns(held, inputs, z)
    free, on, (c, values, slopes, lesser) = held.free, _row_mask(held), rows
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
        bend, _ = _load_hessians(inputs, duration, loads, _local_curves(inputs, loads, c))
        bent = jnp.einsum("r,rdk,rdaeb,rel->kalb", of_loads, basis, bend, basis, optimize=True)
        first = slice(bent.shape[1])
        curved = curved.at[:, first, :, first].add(bent)
    if len(zones.on):
        basis = zones.row @ free
        bend = _zone_hessians(inputs, zones, (inputs.axes, inputs.halves), zones.row @ c)
        curved = curved + jnp.einsum("r,rk,rab,rl->kalb", of_zones, basis, bend, basis, optimize=True)
    jacobian = slopes.reshape(len(y), x.size) * on[:, None]
    corner = jnp.diag(jnp.where(on, -_REGULARISATION, 1.0))
    at_time = jnp.block([[curved.reshape(x.size, x.size), jacobian.T], [jacobian, corner]])
    if not held.free_time:
        return at_time
    falls = jnp.where(on, _duration_powers(held, inputs), 0)
    shares = falls * (values + 1)
    _, (corner, of_c) = jax.jvp(
        lambda time: _log_energy_slopes(held, inputs, c, time), (z[-1],), (jnp.ones_like(z[-1]),)
    )
    beside = (free.T @ of_c).ravel() - jnp.tensordot(y * falls, jacobian, axes=1)
    corner = corner + jnp.sum(y * falls * shares)
    if lesser is not None:
        own, (slow, bent) = _load_rows(held), lesser
        beside = beside + jnp.tensordot(y[own], bent, axes=1)
        # p^2 (whole - slow) + (p - 1)^2 slow
        corner = corner + jnp.sum(y[own] * (1 - 2 * falls[own]) * slow)
        shares = shares.at[own].add(-slow)
    by_time = jnp.concatenate([beside, -shares, corner[None]])
    return jnp.block([[at_time, by_time[:-1, None]], [by_time[None]]])  # symmetric, as of a gradient
