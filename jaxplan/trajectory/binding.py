"""The rows that bind at the optimum of a fit, and the numbers in which the optimum is differentiated.

A *row* is an inequality of the fit (`constraints`); it *binds* if it holds with equality and its multiplier
is positive. The optimality conditions under these rows are those of `optimality`. Letters of sizes are those
of `motion`; besides, R is the number of rows, m + 1 that of nodes, K that of intervals of the spline, and k
that of free coefficients on each axis.
"""

from dataclasses import dataclass, field
from typing import Any

import jax

from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import Sights
from jaxplan.runtime.display import shown
from jaxplan.trajectory.kernels import Body

Traced = Any  # an array: of numpy when it is made, of JAX where it is traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class BindingLinear:
    """Linear rows that bind: ``sign * (row . c[:, axis] - centre) / scale <= 1``.

    Attributes:
        on: (R,) bool, true for rows, false for padding.
        rows: (R, 4, n) factors of the n coefficients; for a node in a tube also their derivatives by its
            place, for others zeros.
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
        on: (R,) bool, true for rows, false for padding.
        place: (R,) in [0, 1].
        rows: (R, 4, n) values of the n splines, and of their three derivatives, there.
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
        on: (R,) bool, true for rows, false for padding.
        place: (R,) in [0, 1].
        row: (R, n) values of the n splines there.
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
    """The rows that bind at a fit's optimum, and all else that `refit` holds fixed.

    Attributes:
        free: (n, k) from k free to n spline coefficients of an axis: ``F`` of `CurveSpace`.
        of_values: (n, v) from the values of v nodes that are passed exactly to coefficients.
        of_rates: (n, 2) from rates at the ends to coefficients.
        energies: (3, n, n) Gram matrices of the splines' three derivatives, divided by the first curve's
            energy.
        pieces: (K, 6, n) from coefficients to Legendre coefficients on each interval.
        breaks: (K + 1,) in [0, 1], of the K intervals.
        places: (m + 1,) of the path's nodes in [0, 1].
        flank: fraction of the duration that a flank of the pace takes.
        least_length: s at full speed, the least length that a path is taken to have.
        by_flank: derivatives in `flank` of the attributes that depend on the breaks, by their names; empty
            where breaks do not follow the flank.
        given: (v,) int, nodes that are passed exactly, the ends first.
        windings: (m + 1,) whole turns added to the logarithm at each node.
        long_way: 1 where the chart turns the long way round, else 0.
        share: fraction of the limits on the platform's loads that the rows allow.
        widened: radius of the tube that was used over that asked for.
        counted: (2, D, Z) bool, which margins at the two ends count: in each constraint those of the best
            entry.
        duration: s, of the optimum; where the duration is given, that of the inputs is used instead.
        linear: linear rows that bind.
        loads: rows of the platform's loads that bind.
        zones: rows of margins that bind.
        x: (k, A) free coefficients of the optimum on A axes.
        multipliers: (R,) of linear rows, loads and zones, one after the other.
        pace: on what the places of nodes depend, as of `Mesh`.
        stretched: whether the time is scaled to the limits afterwards.
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
    """All numbers on which the optimum depends.

    Attributes:
        attitude: (3, 3) of the chart, body to inertial.
        turn: (3,) rad, rotation vector of the chart from start to end.
        nodes: (m + 1, A) rad, chart coordinates ``b`` and joint angles on A axes.
        moved: (m + 1,) by how much the nodes' places exceed those of the active set.
        ends: (2, A) rad/s, rates of the coordinates at start and end.
        weights: (3,) of the squares of rate, acceleration and jerk.
        scales: bounds of linear rows, see `BindingLinear`: joints' rates (rad/s), accelerations (rad/s^2) and
            half ranges (rad), and the tube's radius on each axis (rad).
        powers: powers of the duration by which the scales are multiplied.
        centres: values about which the scales' bounds lie; for the tube the nodes are used instead.
        limits: (C,) on the C components of the platform's loads, in SI units.
        wanted: (D, Z) rad, margins to keep, of D sights to Z rows of the constraints.
        axes: (R, 3) ``(R_a U)^T e`` of the inertial axes ``e`` of the rows of margins, with ``U`` of the
            chart at the row's place.
        halves: (R, 3, 3) ``U`` at the row's place.
        body: the rotating masses.
        duration: s; not used for a shortest motion, whose duration is an unknown.
        cones: the pointing constraints.
        sights: the D directions that they bind.
        load_powers: (C,) powers of 1 / duration that the components have.
        lesser: (C,) index of each component's lesser part among all loads; -1 for none.
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
