"""Proof that a tabulated length of turns grows no faster than it may; tests and the table's maker share it.

A cell of `jaxplan.model.turn_table` is here a box of five parameters: the angle ``a = |r|``, the ratios ``y``
and ``z`` of the two smaller q to the largest, and both ratios ``u`` and ``w`` of the rates ``c``, these
between two finer ratios of the table. In it the length is ``q_f S``, over what is interpolated between the
table's `slopes`. With axes in the order f, f+1, f+2, products of vectors by components, ``p = (1, y, z)`` and
``rho = |c p|``, the turn is ``r = a c p / rho``, and

    v = C s + (a S_a + (1 - C) S) m - side (a / 2) n,       C = (a / 2) cot(a / 2),
    s = (S - y S_y - z S_z, S_y, S_z),    m = c^2 p / rho^2,    n = c ((c p) x (s / c)) / rho

are rates times slopes, ``c_i X_i (q_f S)``, of the turn for side 1, and of its inverse but for the sign for
side -1. To prove is that the size of v, the sum of ``|v_i|`` for a box and the length for an ellipsoid, is
nowhere above the interpolated `slopes`.

**In a box** v is above what is linear in each parameter between its values at the 32 corners by at most the
sum, over the five parameters k, of

    up = h_k^2 / 8 times the largest of -(d/dk)^2 v and of zero,

and below it by at most `down`, with the other sign; h_k is the box's side. That is the error of linear
interpolation along k, and interpolating along the others takes means of it. So the size of v is at most that
of ``max(v + up, down - v)`` with the interpolated v, which is convex in it, while the interpolated `slopes`
are linear in each parameter: the former exceeds the latter most at a corner. Where that is too much, the box
is cut in halves along the parameter with the largest error.

Second derivatives are bounded once for each cell, by intervals. S, ``a S_a`` and s are linear in each
parameter: their corners tell all. ``1 - C`` is a power series in ``a`` without negative terms, so it and its
derivatives rise: the ends of ``a`` tell all. For m and n a cell is cut into `PARTS`. Rounding is far below
`ROUNDING`.

**Why that is enough.** A length F is continuous: two faces have the same shares along their edge, cells of a
face the same at their corners, and F is the same of ``r`` with any of its signs changed, so of both rotation
vectors of a half turn. To change two signs is to turn the body's axes by half a turn, which changes two signs
of w and no size of it; to change all three is to take the inverse, hence the two sides. So finitely many
closed pieces, cells with signs, cover all turns, and in each F has a smooth formula with bounded slopes. Then
F is Lipschitz, and along a motion has a derivative at almost all times. Of the times at which the motion is
in one piece all but countably many are limits of others, where the derivative is that of this piece's
formula: the sum of ``X_i F w_i``, at most the size of w times that of v over the `slopes`. At no turn at all,
where the formula has no slope, F is zero, and so is its derivative at limits of such times. The rates are
constants of a problem: what F is divided by may vary with their ratios, and its kinks there do not matter.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jets import ONE, ZERO, Interval, Jet

from jaxplan.model.turn_table import Measure, TurnTable

FINEST = 1e-5
"""Error of the size of v below which a box that is not proved is cut no further."""
PARTS = 2, 2, 2, 2
"""Parts of a cell along y, z, u and w, over which second derivatives of m and n are bounded."""
ROUNDING = 1e-9
"""Added to sizes of v, which come of fewer than 1e3 operations with numbers below 1e4 times sides squared."""

CORNERS = (0, 1, 2, 3, 4)  # axes of arrays (2, 2, 2, 2, 2, ...), by the ends of a, y, z, u and w
CIRCLE = (0, 1, 2), (1, 2, 0), (2, 0, 1)
Number = np.ndarray | Jet


class Boxes(NamedTuple):
    """N boxes of the five parameters on one face.

    Attributes:
        ends: (5, 2, N) low and high of a, y, z, u and w.
        pieces: (6, 2, 2, 2, 2, 2, N) at the corners S, a S_a, s (3,), and the interpolated `slopes`.
        errors: (5, 3, 2, 2, N) of the interpolated v at most: by parameter, component, side, `up` or `down`.
    """

    ends: np.ndarray
    pieces: np.ndarray
    errors: np.ndarray


def excess(table: TurnTable, measure: Measure) -> np.ndarray:
    """By how much the size of v exceeds the interpolated `slopes`, between finer ratios and the next ones.

    Returns:
        (P - 1, Q - 1), zero or less where it is proved that it does nowhere. Else there is a place where it
        does, by as much or by more, or one where that is not known to within `FINEST`.
    """
    shape = [len(finer) - 1 for finer in table.finer]
    return np.array([excess_between(table, measure, place) for place in np.ndindex(*shape)]).reshape(shape)


def excess_between(table: TurnTable, measure: Measure, place: tuple[int, ...]) -> float:
    """`excess` between the finer ratios at a place (2,) and the next ones."""
    found = [-np.inf]
    for face in range(3):
        left = [boxes_of(table, face, place)]
        while left:
            boxes = left.pop()
            bound, error = bounds(boxes, face, measure)
            disproved = bound > error  # at a corner, whatever is between
            unsettled = (bound > 0) & ~disproved & (error > FINEST)
            found.append(np.max(bound - error * disproved, where=~unsettled, initial=-np.inf))
            left += halves(Boxes(*(part[..., unsettled] for part in boxes)), measure)
    return float(np.max(found))


def boxes_of(table: TurnTable, face: int, place: tuple[int, ...]) -> Boxes:
    """All cells of a face, between the finer ratios at a place (2,) and the next ones."""
    corners, slopes = shares_at(table, face, place)
    grids = [np.linspace(0, np.pi, corners.shape[2]), *[np.linspace(0, 1, n) for n in corners.shape[3:]]]
    between = [finer[at : at + 2] for finer, at in zip(table.finer, place, strict=True)]
    low = np.meshgrid(*[grid[:-1] for grid in grids], indexing="ij", sparse=True)
    high = np.meshgrid(*[grid[1:] for grid in grids], indexing="ij", sparse=True)
    ends = [np.stack(pair) for pair in zip(low, high, strict=True)]
    ends += [np.reshape(pair, (2, 1, 1, 1)) for pair in between]
    pieces = pieces_of(corners, slopes, ends)
    errors = errors_of(face, ends, pieces)
    whole = pieces.shape[-3:]
    return Boxes(
        np.stack([np.broadcast_to(end, (2, *whole)).reshape(2, -1) for end in ends]),
        pieces.reshape(*pieces.shape[:-3], -1),
        errors.reshape(*errors.shape[:-3], -1),
    )


def at_corners(ends: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Low and high of the five parameters, each (2, ...), the k-th along axis k of `CORNERS`."""
    return [end.reshape(*np.where(np.arange(5) == k, 2, 1), *end.shape[1:]) for k, end in enumerate(ends)]


def shares_at(table: TurnTable, face: int, place: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Shares (2, 2, K, L, L) of a face and `slopes` (2, 2) at the finer ratios about a place (2,).

    Between these shares are linear in each ratio, for which all tabulated ratios have to be among the finer.
    """
    shares = table.shares[:, :, face]
    for axis, (known, finer, at) in enumerate(zip(table.ratios, table.finer, place, strict=True)):
        if not (np.isin(known, finer).all() and known[0] == finer[0] and known[-1] == finer[-1] == 1):
            raise ValueError(f"finer ratios {finer} must have tabulated ones {known} among them, up to 1")
        weights = np.stack([np.interp(finer[at : at + 2], known, row) for row in np.eye(len(known))], 1)
        shares = np.moveaxis(np.tensordot(weights, shares, axes=(1, axis)), 0, axis)
    first, second = place
    return shares, table.slopes[first : first + 2, second : second + 2]


def pieces_of(shares: np.ndarray, slopes: np.ndarray, ends: list[np.ndarray]) -> np.ndarray:
    """Pieces (6, 2, 2, 2, 2, 2, K - 1, L - 1, L - 1) of `Boxes`, from what `shares_at` returns."""
    for axis in (2, 4, 6):
        parts = np.split(shares, [1, shares.shape[axis] - 1], axis=axis)
        shares = np.stack([np.concatenate(parts[:2], axis=axis), np.concatenate(parts[1:], axis=axis)])
    share = np.moveaxis(shares, (0, 1, 2), (2, 1, 0))
    a, y, z, *_ = at_corners(ends)
    by_a, by_y, by_z = (
        np.broadcast_to(np.diff(share, axis=k) / (ends[k][1] - ends[k][0]), share.shape) for k in range(3)
    )
    divided = np.broadcast_to(slopes.reshape(1, 1, 1, 2, 2, 1, 1, 1), share.shape)
    return np.stack([share, a * by_a, share - y * by_y - z * by_z, by_y, by_z, divided])


def factors(face: int, y: Number, z: Number, u: Number, w: Number) -> tuple[list, list]:
    """m (3,), and what s has to be multiplied by for n (3, 2): ``n_i = n[i][0] s_k - n[i][1] s_j``.

    Here and below i, j and k follow each other in a circle.
    """
    powers = np.roll([[0, 0], [1, 0], [1, 1]], -face, axis=0)  # of u and w in the rates, from axis f on
    powers = powers - powers[0]  # over that of axis f: only ratios count

    def by_rates(exponents):
        return u ** float(exponents[0]) * w ** float(exponents[1])

    p = 1.0, y, z
    square = 1.0 + (by_rates(2 * powers[1]) * y * y + by_rates(2 * powers[2]) * z * z)  # (rho / c_f)^2
    inverse, root = square**-1.0, square**-0.5
    m, n = [], []
    for i, j, k in CIRCLE:
        m.append(p[i] * (by_rates(2 * powers[i]) * inverse))
        both = powers[i] + powers[j] - powers[k], powers[i] + powers[k] - powers[j]
        n.append((p[j] * (by_rates(both[0]) * root), p[k] * (by_rates(both[1]) * root)))
    return m, n


def sides(a: Number, c: Number, of_others: tuple[list, list], pieces: Sequence[Number]) -> list:
    """v (3, 2) by component and side, from the angle, its C, `factors`, and the first five pieces."""
    m, n = of_others
    share, by_angle, *s = pieces
    along = by_angle + share - c * share
    found = []
    for i, j, k in CIRCLE:
        even, odd = c * s[i] + along * m[i], 0.5 * a * (n[i][0] * s[k] - n[i][1] * s[j])
        found.append((even - odd, even + odd))
    return found


def cotangent(angle: np.ndarray) -> tuple[np.ndarray, ...]:
    """C (...) at angles in [0, pi] with its first two derivatives, which all fall."""
    half = np.where(angle > 0, angle, 1) / 2
    c, square = half / np.tan(half), np.sin(half) ** 2
    found = c, (c / half - half / square) / 2, (c - 1) / (2 * square)
    return tuple(np.where(angle > 0, v, at_zero) for v, at_zero in zip(found, (1, 0, -1 / 6), strict=True))


def errors_of(face: int, ends: list[np.ndarray], pieces: np.ndarray) -> np.ndarray:
    """Errors (5, 3, 2, 2, K - 1, L - 1, L - 1) of `Boxes`, from ends that are broadcast and pieces."""
    errors = np.empty((5, 3, 2, 2, *pieces.shape[-3:]))
    of_angle = [Interval(high, low) for low, high in cotangent(ends[0])]
    for k, (low, high) in enumerate(ends):

        def jet(piece, k=k, width=high - low):
            found = piece, np.diff(piece, axis=k) / width
            return Jet(*(Interval(values.min(CORNERS), values.max(CORNERS)) for values in found))

        a = Jet(Interval(*ends[0]), ONE if k == 0 else ZERO)
        c = Jet(*of_angle) if k == 0 else Jet(of_angle[0])
        v = sides(a, c, factors_of(face, ends, k), [jet(piece) for piece in pieces[:5]])
        for component, side in np.ndindex(3, 2):
            bend = v[component][side].bend
            errors[k, component, side, 0] = (high - low) ** 2 / 8 * np.maximum(-bend.low, 0)
            errors[k, component, side, 1] = (high - low) ** 2 / 8 * np.maximum(bend.high, 0)
    return errors


def factors_of(face: int, ends: list[np.ndarray], k: int) -> tuple[list, list]:
    """`factors` as jets in parameter k, over whole cells: y, z, u and w are cut into `PARTS` for them."""
    places = []
    for n, parts in enumerate(PARTS):
        low, high = ends[n + 1].reshape(2, -1, 1)
        inner = low + (high - low) * np.arange(1, parts) / parts
        shape = np.ones((4, 2), int)  # of cells and parts, by parameter
        shape[n] = len(low), parts
        cut = (np.concatenate(part, axis=1).reshape(shape.ravel()) for part in ((low, inner), (inner, high)))
        places.append(Jet(Interval(*cut), ONE if k == n + 1 else ZERO))
    whole = np.broadcast_shapes(*(place.value.low.shape for place in places))

    def cover(found):
        if found is ZERO:
            return ZERO
        low, high = np.broadcast_to(found.low, whole), np.broadcast_to(found.high, whole)
        axes = (1, 3, 4, 5, 6, 7)  # leave y and z of the cells
        return Interval(low.min(axes)[None], high.max(axes)[None])

    def covered(jet):
        return Jet(cover(jet.value), cover(jet.slope), cover(jet.bend))

    m, n = factors(face, *places)
    return [covered(jet) for jet in m], [[covered(jet) for jet in pair] for pair in n]


def size(v, measure: Measure):
    """Of v (3, ...), by a measure."""
    return sum(np.abs(x) for x in v) if measure == "box" else np.sqrt(sum(x * x for x in v))


def bounds(boxes: Boxes, face: int, measure: Measure) -> tuple[np.ndarray, np.ndarray]:
    """By how much (N,) the size of v exceeds the interpolated `slopes` at most; the error (N,) of that.

    At a corner it does so by at least their difference.
    """
    a, *others = at_corners(boxes.ends)
    v = sides(a, cotangent(a)[0], factors(face, *others), boxes.pieces[:5])
    errors = boxes.errors.sum(0)
    most = -np.inf
    for side in range(2):
        pairs = zip(v, errors[:, side], strict=True)
        held = [np.maximum(both[side] + up, down - both[side]) for both, (up, down) in pairs]
        most = np.maximum(most, size(held, measure))
    most = np.max(most - boxes.pieces[5], axis=CORNERS)
    return most + ROUNDING, size(errors.max((1, 2)), measure) + ROUNDING


def halves(boxes: Boxes, measure: Measure) -> list[Boxes]:
    """Boxes in halves along the parameter that each has its largest error from, by that parameter."""
    longest = np.argmax([size(error, measure) for error in boxes.errors.max((2, 3))], axis=0)
    found = []
    for k in np.unique(longest):
        ends, pieces, errors = (part[..., longest == k] for part in boxes)
        errors = np.where(np.arange(5)[:, None, None, None, None] == k, errors / 4, errors)
        first, last = np.split(pieces, 2, axis=k + 1)
        middle = (first + last) / 2
        cut = np.repeat(ends[None], 2, axis=0)
        cut[0, k, 1] = cut[1, k, 0] = ends[k].mean(0)
        both = np.concatenate([first, middle], k + 1), np.concatenate([middle, last], k + 1)
        found.append(Boxes(*(np.concatenate(pair, -1) for pair in (cut, both, (errors, errors)))))
    return found
