"""What binds at the optimum of a fit, and the numbers that it is differentiated in.

A *row* is an inequality of the fit (`constraints`); letters of sizes are those of `motion`. The conditions of
optimality under these rows are those of `optimality`.
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
