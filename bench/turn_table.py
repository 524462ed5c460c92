"""Makes jaxplan/model/turn_table.npz: lengths of turns, the largest that grow no faster than they may.

    python bench/turn_table.py [--out FILE]

For each pair of ratios of the rates the shares at the table's places are raised as far as the inequality of
`jaxplan.model.turn_table` lets them, at the corners, edges and middles of all cells: a linear goal within
convex bounds, by L-BFGS with growing penalties. The slope at a place is linear in the shares at the eight
corners of its cell, so it is one product with a matrix. What is left above 1 then, looked for in finer
places and between the tabulated ratios too, goes into the table as what lengths are divided by. It takes a
quarter of an hour on one core.
"""

import argparse
import sys
from itertools import pairwise
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from jaxplan.model.turn_table import FILE, UNIT, Measure, TurnTable

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the proof is the tests' own
from turn_growth import FINEST, excess_between

jax.config.update("jax_enable_x64", True)

ANGLES, PLACES = 13, 11  # along |r| from 0 to pi, and along each ratio of q from 0 to 1
RATIOS = {
    "box": ([0.35, 0.6, 1.0], [0.35, 0.6, 1.0]),
    "ellipsoid": ([0.4, 0.65, 1.0], [0.4, 0.65, 1.0]),
}
CORNERS = list(np.ndindex(2, 2, 2))
PENALTIES = 1e2, 1e3, 1e4  # of the squared excess; ends where it is below half a percent
ITERATIONS = 300  # for each penalty
ALONG_AXES = 30.0  # weight of a turn about a body axis, of which there are few places, over that of others
MARGIN = 1e-3  # relative margin on the growth of a length, for what lies between the places evaluated
MORE = 1.15  # factor of the excess between tabulated ratios, for what lies between the ratios evaluated
BETWEEN = 4  # parts of a cell of ratios, at whose ends growth is evaluated
FINER = 4  # parts of a cell of turns, along each coordinate, likewise


def rates_of(first: float, second: float) -> np.ndarray:
    """Rates (3,) in falling order from the ratios of the second to the first and the third to the second."""
    return np.array([1.0, first, first * second])


def slopes(rates: np.ndarray, face: int, parts: int, side: int) -> np.ndarray:
    """Matrices from the shares at a cell's corners to rate times slope of a length along each body axis.

    Args:
        rates: (3,) of the body axes.
        face: axis f of the largest ``|r_i| / c_i``, see `jaxplan.model.turn_table`.
        parts: into which a cell is cut along each coordinate; slopes are taken at the ends of these.
        side: 1 for the turn, -1 for its inverse.

    Returns:
        (cells, places, 3, 8).
    """
    counts = np.array([ANGLES, PLACES, PLACES])
    cells = np.stack(np.meshgrid(*[np.arange(n - 1) for n in counts], indexing="ij"), -1).reshape(-1, 1, 3)
    inside = np.stack(np.meshgrid(*[np.linspace(0, 1, parts + 1)] * 3, indexing="ij"), -1).reshape(1, -1, 3)
    steps = np.array([np.pi, 1, 1]) / (counts - 1)
    places = (cells + inside) * steps
    angle, others = places[..., :1], places[..., 1:]
    axes = (face + np.arange(3)) % 3
    along = np.zeros(places.shape)
    along[..., axes] = np.concatenate([np.ones_like(angle), others], -1) * rates[axes]
    size = np.linalg.norm(along, axis=-1, keepdims=True)
    along /= size
    turn, largest = angle * along, angle / size
    half = np.where(angle > 1e-3, angle, 1) / 2
    bend = np.where(angle > 1e-3, (1 - half / np.tan(half)) / (2 * half) ** 2, 1 / 12)
    found = np.empty((*places.shape, len(CORNERS)))
    for n, corner in enumerate(CORNERS):
        near = np.where(corner, inside, 1 - inside)
        rise = np.where(corner, 1, -1) / steps
        share = np.prod(near, -1)
        by = [rise[k] * np.prod(np.delete(near, k, -1), -1) for k in range(3)]
        slope = np.empty(places.shape)
        slope[..., axes[0]] = share - others[..., 0] * by[1] - others[..., 1] * by[2]
        slope[..., axes[1]], slope[..., axes[2]] = by[1], by[2]
        slope = slope / rates + largest * by[0][..., None] * along
        once = np.cross(turn, slope)  # the slope by r, brought to turns about body axes
        found[..., n] = rates * (slope - side * once / 2 + bend * np.cross(turn, once))
    return found


def numbers() -> np.ndarray:
    """Number (3, K, L, L) of each place of the table; a place on the edge of two faces has one number."""
    first, second = np.meshgrid(np.arange(PLACES), np.arange(PLACES), indexing="ij")
    keys = np.zeros((3, ANGLES, PLACES, PLACES, 4), int)
    keys[..., 3] = np.arange(ANGLES)[:, None, None]
    for face in range(3):
        for axis, value in zip((face + np.arange(3)) % 3, (PLACES - 1, first, second), strict=True):
            keys[face, ..., axis] = value
    return np.unique(keys.reshape(-1, 4), axis=0, return_inverse=True)[1].reshape(keys.shape[:-1])


def corners_of(values: np.ndarray, face: int) -> np.ndarray:
    """Values (3, K, L, L) at the corners of a face's cells, (cells, 8)."""
    ends = [slice(None, -1), slice(1, None)]
    return np.stack([values[face][tuple(ends[k] for k in corner)].ravel() for corner in CORNERS], 1)


def sizes(slope: jax.Array, measure: Measure) -> jax.Array:
    """Growth (...) of lengths from rate times slope (..., 3), by a measure; smoothed, a little too large."""
    if measure == "box":
        return jnp.sum(jnp.sqrt(slope**2 + 1e-4), -1)
    return jnp.sqrt(jnp.sum(slope**2, -1) + 1e-12)


@jax.jit
def penalised(values: jax.Array, weights: jax.Array, of_box: bool, near: tuple, penalty: float) -> jax.Array:
    """Cost of shares: penalty on squared growth above 1, less their weighted sum.

    Args:
        values: (k,) a share for each number of `numbers`.
        weights: (k,) of them.
        of_box: whether the measure is that of a box.
        near: matrices of `slopes`, and the numbers (cells, 8) of the corners of their cells.
        penalty: factor of the penalty.
    """
    matrix, corner = near
    slope = jnp.einsum("cpmk,ck->cpm", matrix, values[corner])
    size = jnp.where(of_box, sizes(slope, "box"), sizes(slope, "ellipsoid"))
    excess = jnp.maximum(size - 1, 0)
    worst = jnp.mean(jnp.max(excess, 1) ** 2) + jnp.mean(excess**2)
    return penalty * worst - jnp.sum(weights * values)


climb = jax.jit(jax.value_and_grad(penalised))


def raised(shares: np.ndarray, rates: np.ndarray, measure: Measure) -> np.ndarray:
    """Shares (3, K, L, L), raised from first ones as far as the growth of lengths at rates (3,) allows."""
    number = numbers()
    values, weights = np.empty(number.max() + 1), np.empty(number.max() + 1)
    values[number] = shares
    weights[number] = (np.arange(ANGLES) ** 2 + 0.5)[:, None, None]
    weights[number[..., 0, 0]] *= ALONG_AXES
    weights /= weights.sum() * np.mean(values)
    sides = [(face, side) for face in range(3) for side in (1, -1)]
    near = (
        jnp.asarray(np.concatenate([slopes(rates, face, 2, side) for face, side in sides])),
        jnp.asarray(np.concatenate([corners_of(number, face) for face, _ in sides])),
    )
    for penalty in PENALTIES:
        found = minimize(
            lambda x, p=penalty: [np.asarray(v, float) for v in climb(x, weights, measure == "box", near, p)],
            values,
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": ITERATIONS, "maxcor": 20},
        )
        values = found.x
    return values[number]


def largest_slope(shares: np.ndarray, rates: np.ndarray, measure: Measure, parts: int = FINER) -> float:
    """Largest growth of a length of shares (3, K, L, L) at rates (3,), over all cells; 1 is allowed."""
    order = 1 if measure == "box" else 2
    found = 0.0
    for face in range(3):
        corners = corners_of(shares, face)
        for side in (1, -1):
            slope = np.einsum("cpmk,ck->cpm", slopes(rates, face, parts, side), corners)
            found = max(found, np.linalg.norm(slope, ord=order, axis=-1).max())
    return found


def first_shares(rates: np.ndarray, measure: Measure) -> np.ndarray:
    """Shares (3, K, L, L) to begin with: for a box of the turn about the eigenaxis, else of the angle.

    The latter are exact for equal rates.
    """
    found = np.ones((3, ANGLES, PLACES, PLACES))
    if measure == "ellipsoid":
        places = np.linspace(0, 1, PLACES)
        found *= np.sqrt(1 + places[:, None] ** 2 + places**2)
    return found


def between(known: list[float]) -> np.ndarray:
    """Ratios at which growth is evaluated: those tabulated, and `BETWEEN` - 1 between each two."""
    parts = [np.linspace(a, b, BETWEEN + 1)[:-1] for a, b in pairwise(known)]
    return np.concatenate([*parts, known[-1:]])


def slopes_between(shares: np.ndarray, measure: Measure) -> np.ndarray:
    """Largest growth (P, Q) of lengths at the ratios of `between`, with margins; `proved` begins with it."""
    ratios = RATIOS[measure]
    fine = [between(known) for known in ratios]
    by = [
        np.stack([np.interp(f, known, row) for row in np.eye(len(known))], 1)
        for f, known in zip(fine, ratios, strict=True)
    ]
    found = np.empty((len(fine[0]), len(fine[1])))
    for place in np.ndindex(found.shape):
        mixed = np.einsum("u,v,uv...", by[0][place[0]], by[1][place[1]], shares)
        found[place] = largest_slope(mixed, rates_of(fine[0][place[0]], fine[1][place[1]]), measure)
    print(f"{measure}: largest slopes\n{np.round(found, 4)}", flush=True)
    return (1 + MORE * np.maximum(found - 1, 0)) * (1 + MARGIN)


def proved(slopes: np.ndarray, shares: np.ndarray, measure: Measure) -> np.ndarray:
    """What lengths are divided by (P, Q) at the ratios of `between`, raised until the proof is found."""
    first, second = RATIOS[measure]
    table = TurnTable(
        ratios=(np.array(first), np.array(second)),
        finer=(between(first), between(second)),
        slopes=slopes.copy(),
        shares=shares,
    )
    for u, v in np.ndindex(len(table.finer[0]) - 1, len(table.finer[1]) - 1):
        while (lacking := excess_between(table, measure, (u, v))) > 0:
            table.slopes[u : u + 2, v : v + 2] += max(lacking, FINEST)
    print(f"{measure}: raised by at most {np.max(table.slopes - slopes):.1e} for the proof", flush=True)
    return table.slopes


def table(measure: Measure) -> np.ndarray:
    """Shares (U, V, 3, K, L, L) of a measure at all tabulated ratios; prints how they come out."""
    first, second = RATIOS[measure]
    found = np.empty((len(first), len(second), 3, ANGLES, PLACES, PLACES))
    for u in reversed(range(len(first))):
        for v in reversed(range(len(second))):
            rates = rates_of(first[u], second[v])
            if v + 1 < len(second):
                start = found[u, v + 1]
            elif u + 1 < len(first):
                start = found[u + 1, v]
            else:
                start = first_shares(rates, measure)
            shares = raised(start, rates, measure)
            most = largest_slope(shares, rates, measure)
            found[u, v] = shares / most
            print(f"{measure} {first[u]} {second[v]}: slope {most:.4f}, mean {found[u, v].mean():.4f}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=FILE)
    parser.add_argument("--measure", choices=list(RATIOS), action="append")
    arguments = parser.parse_args()
    kept = {}
    for measure in arguments.measure or RATIOS:
        kept[measure] = np.floor(table(measure) / UNIT).astype(np.uint16)
        shares = kept[measure] * UNIT
        kept[f"{measure}_slopes"] = proved(slopes_between(shares, measure), shares, measure)
        for n, ratios in enumerate(RATIOS[measure], 1):
            kept[f"{measure}_ratios_{n}"] = np.array(ratios)
            kept[f"{measure}_finer_{n}"] = between(ratios)
    np.savez_compressed(arguments.out, **kept)


if __name__ == "__main__":
    main()
