"""Arrays of reaction wheels: what each wheel is, and which rows of torque and momentum limit an array.

Wheels exchange momentum with the platform: the total ``H`` stays as it is in inertial axes. With attitude
``R``, inertia ``J`` (wheels locked), and the angular velocity ``omega`` in body axes the wheels hold ``h``
and give the platform the torque ``tau``,

    h = R^T H - J omega,    tau = -h' = J omega' + omega x (R^T H),    H = R_0 (J omega_0 + h_0),

with ``h_0 = sum a_k stored_k`` of the axes ``a_k``. How the array shares them out is its *allocation*:

    "pseudo_inverse"   wheel k gives ``(A+ tau)_k`` and holds ``stored_k + (A+ (h - h_0))_k``, with ``A+`` the
                       pseudo-inverse of the matrix of axes: a row a wheel, exact.
    "minimax"          the envelope: all that some sharing out reaches at an instant. It is a zonotope
                       ``{sum a_k u_k: |u_k| <= limit_k}``, of the torque and of the momentum, and a row
                       ``|f . x| <= sum |f . a_k| limit_k`` for each pair of axes, ``f`` across both.
                       What wheels hold against each other does not show there, so at the start they hold
                       nothing against each other: the largest share of a limit is the least.

So both have ``r`` rows, here numbered alike for torque and momentum. Of pairs of parallel axes, and of pairs
that have the plane of an earlier pair, the row is zero and its limit one, which every motion keeps: so rows
are as many whatever the axes are, and can be traced.

Body axes, N m, N m s.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import jax
import numpy as np

from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.gimbals import stacked
from jaxplan.runtime.display import shown

PSEUDO_INVERSE, MINIMAX = ALLOCATIONS = ("pseudo_inverse", "minimax")
"""How an array of wheels shares out torque and momentum."""

FLAT = 1e-3
"""Least singular value of the matrix of axes, by which they span space."""
_PARALLEL = 1e-9  # sine of an angle below which axes, or normals of planes, count as parallel


@shown("axis", "torque N m", "momentum N m s", "stored N m s")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Wheel:
    """A reaction wheel, whose momentum is its spin inertia times its speed relative to the platform.

    Attributes:
        name: unique among the wheels.
        axis: (3,) unit vector in body axes that it spins about.
        torque: N m, the most that it gives either way.
        momentum: N m s, the most that it holds either way.
        stored: N m s that it holds at the start, positive about its axis.
    """

    name: str = field(metadata=key("name", "unique among the wheels", static=True))
    axis: np.ndarray = field(metadata=key("axis", "that it spins about, body axes", kind="unit vector"))
    torque: float = field(metadata=key("torque_nm", "the most that it gives either way", "[1e-12, 1e12]"))
    momentum: float = field(
        metadata=key("momentum_nms", "the most that it holds either way", "[1e-12, 1e12]")
    )
    stored: float = keyed(
        0.0, "stored_nms", "that it holds at the start, at most momentum_nms either way", "[-1e12, 1e12]"
    )


class WheelArray(NamedTuple):
    """The rows of an array of n wheels, r of them.

    Attributes:
        axes: (n, 3) unit vectors in body axes.
        rows: (r, 3), of which the products with torque and momentum are limited.
        apart: (r,) N m s beside the momentum's products: what wheels hold against each other, and keep.
        stored: (3,) N m s, of all wheels together at the start, body axes.
        torque: (r,) N m, the limits of the torque's products.
        momentum: (r,) N m s, those of the momentum's.
        each_torque: (n,) N m, the limits of the wheels.
        each_momentum: (n,) N m s, likewise.
    """

    axes: AnyArray
    rows: AnyArray
    apart: AnyArray
    stored: AnyArray
    torque: AnyArray
    momentum: AnyArray
    each_torque: AnyArray
    each_momentum: AnyArray


def wheel_array(wheels: Sequence[Wheel], allocation: str) -> WheelArray:
    """The array of some wheels, whose axes span space; with numpy or JAX as their numbers are."""
    xp, axes, torque, momentum, held = arrays(
        *(
            stacked([getattr(one, name) for one in wheels])
            for name in ("axis", "torque", "momentum", "stored")
        )
    )
    axes = axes / xp.sqrt(xp.sum(axes * axes, axis=1))[:, None]
    stored, each = held @ axes, (torque, momentum)
    if allocation == MINIMAX:
        rows, reach = _facets(axes)
        torque, momentum = reach @ torque, reach @ momentum
        still = xp.all(rows == 0, axis=1)
        torque, momentum = xp.where(still, 1, torque), xp.where(still, 1, momentum)
        apart = xp.zeros(len(rows), rows.dtype)
    else:
        rows = axes @ xp.linalg.inv(axes.T @ axes)
        apart = held - rows @ stored
    return WheelArray(axes, rows, apart, stored, torque, momentum, *each)


def row_names(wheels: Sequence[Wheel], allocation: str) -> tuple[str, ...]:
    """(r,) the wheel that each row is of, by name; of the envelope "array across wheel-1 and wheel-2"."""
    names = [wheel.name for wheel in wheels]
    if allocation != MINIMAX:
        return tuple(names)
    return tuple(f"array across {first} and {second}" for first, second in combinations(names, 2))


def least_shares(axes: np.ndarray, limit: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least largest share of the wheels' limits by which some sharing out reaches vectors.

    Args:
        axes: (n, 3) unit vectors that span space.
        limit: (n,) positive.
        vectors: (k, 3) in its unit.

    Returns:
        (k,) shares, beyond 1 outside of the envelope, and (k, 3) unit normals of the faces that are nearest.
    """
    normals, sizes = _facets(axes)
    kept = np.any(normals != 0, axis=1)
    normals, reach = normals[kept], sizes[kept] @ limit
    shares = vectors @ normals.T / reach
    own = np.argmax(np.abs(shares), axis=1)
    share = np.take_along_axis(shares, own[:, None], axis=1)[:, 0]
    return np.abs(share), normals[own] * np.where(share < 0, -1, 1)[:, None]


def _facets(axes: AnyArray) -> tuple[AnyArray, AnyArray]:
    """The normals (r, 3) of facets for pairs of axes (n, 3), and sizes (r, n) of their products with these.

    Both are zero for pairs that are parallel, or in the plane of an earlier pair.
    """
    xp, axes = arrays(axes)
    pairs = np.array(list(combinations(range(len(axes)), 2)))
    across = xp.cross(axes[pairs[:, 0]], axes[pairs[:, 1]])
    square = xp.sum(across * across, axis=1)
    apart = square > _PARALLEL**2
    normals = across / xp.sqrt(xp.where(apart, square, 1))[:, None]
    between = xp.cross(normals[:, None], normals[None])
    same = xp.sum(between * between, axis=2) <= _PARALLEL**2  # of this row and an earlier one
    earlier = np.tri(len(pairs), k=-1, dtype=bool)
    kept = apart & ~xp.any(same & apart & earlier, axis=1)
    of_pair = np.zeros((len(pairs), len(axes)), bool)
    of_pair[np.arange(len(pairs))[:, None], pairs] = True
    sizes = xp.where(of_pair, 0, xp.abs(normals @ axes.T))  # across both, to the last digit
    return xp.where(kept[:, None], normals, 0), xp.where(kept[:, None], sizes, 0)
