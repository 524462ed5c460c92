"""A covering of all attitudes, and which of its points can have a solution near them.

The points are a super-Fibonacci spiral on the unit quaternions: any attitude is within `RADIUS` of one of
them. A direction in body axes moves by no more than the attitude turns, so an attitude clear of all caps is
within `RADIUS` of a point that is inside no cap by more than `RADIUS`. Points that are, are ruled out;
where all are, the problem is proved to have no solution.
"""

from functools import lru_cache

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.decomposition.caps import Caps
from jaxplan.decomposition.groups import group_excess
from jaxplan.geometry import rotations
from jaxplan.runtime.quick_jit import quick_jit

POINTS = 4096
RADIUS = 0.25
"""rad; the largest distance found of any attitude to the nearest point is 0.2455."""
BEYOND = 704
"""Points taken twice: those within `RADIUS` of half a turn, (r + sin r) / pi of all, and a few more."""

# The spiral turns by 1 / _FIRST and 1 / _SECOND of a circle a point in its two planes. Both come from the
# positive roots of x^4 = x + 4 and x^2 = 2, which keep the points apart best.
_FIRST = np.sqrt(2.0)
_SECOND = 1.533751168755204288118041


@lru_cache(maxsize=8)
def points(seed: int) -> np.ndarray:
    """Unit quaternions (N, 4) in the order of their angle, the identity first.

    The scalar part is above zero up to half a turn. The last points, below zero, are those near half a turn
    once more, the longer way round: a solution near half a turn has a point near it on its own side, too.

    Args:
        seed: of a random turn of the whole covering.
    """
    step = np.arange(POINTS) + 0.5
    share = step / POINTS
    first, second = 2 * np.pi * step / _FIRST, 2 * np.pi * step / _SECOND
    spiral = np.stack(
        [
            np.sqrt(share) * np.sin(first),
            np.sqrt(share) * np.cos(first),
            np.sqrt(1 - share) * np.sin(second),
            np.sqrt(1 - share) * np.cos(second),
        ]
    )
    turn = np.random.default_rng(np.random.SeedSequence(seed)).normal(size=4)
    turned = np.stack(rotations.product(turn / np.linalg.norm(turn), spiral), axis=-1)
    both = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], turned, -turned])
    return both[np.argsort(-both[:, 0], kind="stable")[: 1 + POINTS + BEYOND]]


@lru_cache(maxsize=8)
def _rotations(seed: int) -> np.ndarray:
    """Rotation matrices of the points, entries first: (9, N), single precision."""
    return np.array(rotations.matrix(points(seed).T), dtype=np.float32).reshape(9, -1)


def depths(caps: Caps, seed: int) -> np.ndarray:
    """How far each point of the covering is from being possible.

    Args:
        caps: what directions must stay out of.
        seed: of the covering.

    Returns:
        (N,) zero or less where a solution may lie within `RADIUS` of the point; larger the deeper the point
        is inside a cap.
    """
    # a . E^T z is the sum of these times the entries of E
    entries = np.einsum("mi,mj->mji", caps.axis, caps.direction).reshape(-1, 9)
    reach = caps.half_angle - RADIUS
    excluded = np.where(reach > 0, np.cos(reach), np.inf)
    single = np.float32
    return np.asarray(
        _depths(entries.astype(single), excluded.astype(single), _rotations(seed), caps.member, caps.group)
    )


@quick_jit
def _depths(entries: Array, excluded: Array, rotations: Array, member: Array, group: Array) -> Array:
    depth = entries @ rotations - excluded[:, None]
    return jnp.max(group_excess(depth, member, group), axis=0)
