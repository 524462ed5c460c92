"""What is held of a fit while its inputs change a little: the discretisation and which rows bind.

The optimum ``x`` of a fit, with multipliers ``y`` of the rows that bind, is a root of

    F(x, y; inputs) = (gradient in x of energy + y . rows,  rows that bind) = 0.

As long as the same rows bind, the implicit function theorem gives its derivatives in all inputs
(`refit`). Held fixed are the breaks, when each node is passed as a share of the duration, the places that
were looked at, the rows that bind, and the branches of logarithms.
"""

from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

from jaxplan.display import shown

Traced = Any  # an array: of numpy as it is made, of JAX where it is traced


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class LinearRows:
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
class LoadRows:
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
class ZoneRows:
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
class Held:
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
    linear: LinearRows
    loads: LoadRows
    zones: ZoneRows
    x: Traced
    multipliers: Traced
    stretched: bool = field(metadata={"static": True})


def padded_size(count: int, least: int) -> int:
    """Rows that so many are padded to: ``least``, 4 times that, 16 times, ...; few sizes stack in batches."""
    while least < count:
        least *= 4
    return least


def filled(array: np.ndarray, size: int) -> np.ndarray:
    """An array with zeros added to its first axis."""
    return np.concatenate([array, np.zeros((size - len(array), *array.shape[1:]), array.dtype)])
