"""Arrays of reaction wheels: what each wheel is, and the linear inequalities (*rows*) that limit an array.

Wheels exchange momentum with the platform: the total momentum ``H`` is constant in inertial axes. With
attitude ``R`` (body to inertial), inertia ``J`` (wheels locked), and angular velocity ``omega`` in body axes,
the wheels hold the momentum ``h`` and give the platform the torque ``tau``, both in body axes:

    h = R^T H - J omega,    tau = -h' = J omega' + omega x (R^T H),    H = R_0 (J omega_0 + h_0),

with ``h_0 = sum a_k stored_k`` at the start, where ``a_k`` are the axes of the wheels. The *allocation* says
how both are distributed over the wheels:

    "pseudo_inverse"   wheel k gives ``(A+ tau)_k`` and holds ``stored_k + (A+ (h - h_0))_k``, with ``A+`` the
                       pseudo-inverse of the matrix of axes. There is one row for each wheel, and it is exact.
    "minimax"          the envelope: everything that some distribution reaches at an instant. It is a zonotope
                       ``{sum a_k u_k: |u_k| <= limit_k}`` for the torque and another for the momentum. It has
                       a row ``|f . x| <= sum |f . a_k| limit_k`` for each pair of axes, with ``f`` the unit
                       normal to both. The envelope does not show momenta by which wheels work against each
                       other, so at the start there must be none: wheels then hold the distribution in which
                       the largest fraction of a wheel's limit is least.

Both have ``r`` rows, numbered alike for torque and momentum. For pairs of parallel axes, and for pairs that
lie in the plane of an earlier pair, the row is zero and its limit one, which every motion keeps: so the
number of rows does not depend on the axes, which can therefore be traced.

Vectors are in body axes; units are N m and N m s.
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
_PARALLEL_SINE = 1e-9  # sine of an angle below which axes, or normals of planes, count as parallel


@shown("axis", "torque N m", "momentum N m s", "stored N m s")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Wheel:
    """A reaction wheel, whose momentum is its spin inertia times its speed relative to the platform.

    Attributes:
        name: name, unique among the wheels.
        axis: (3,) unit vector in body axes about which it spins.
        torque: N m, its largest torque in either direction.
        momentum: N m s, its largest momentum in either direction.
        stored: N m s, its momentum at the start, positive about its axis.
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
    """An array of n wheels with the r rows that limit it (see the module's docstring).

    With ``tau`` and ``h`` the torque and the momentum of all wheels together, rows ask for
    ``|rows tau| <= torque`` and ``|rows h + apart| <= momentum``.

    Attributes:
        axes: (n, 3) unit vectors in body axes, the wheels' axes.
        rows: (r, 3), the matrix that torque and momentum are multiplied by.
        apart: (r,) N m s, what is added to the products with the momentum: the momenta by which wheels work
            against each other, which the pseudo-inverse leaves as they are. Zero for the envelope.
        stored: (3,) N m s, momentum of all wheels together at the start, body axes.
        torque: (r,) N m, limits of the rows' products with the torque.
        momentum: (r,) N m s, limits of the rows' products with the momentum.
        each_torque: (n,) N m, torque limit of each wheel.
        each_momentum: (n,) N m s, momentum limit of each wheel.
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
    """Make the array of some wheels, in numpy or JAX as their numbers are.

    Args:
        wheels: three or more, whose axes span space; axes are scaled to unit length.
        allocation: one of `ALLOCATIONS`.
    """
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
    """Name the r rows of an array by wheel, or in the envelope as "array across wheel-1 and wheel-2"."""
    names = [wheel.name for wheel in wheels]
    if allocation != MINIMAX:
        return tuple(names)
    return tuple(f"array across {first} and {second}" for first, second in combinations(names, 2))


def least_shares(axes: np.ndarray, limit: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find how much of their limits wheels need at least to produce given vectors together.

    Of all distributions over the wheels the one counts whose largest ratio of a wheel's part to its limit is
    least.

    Args:
        axes: (n, 3) unit vectors that span space, the wheels' axes.
        limit: (n,) positive limits of the wheels.
        vectors: (k, 3) torques or momenta in the unit of `limit`, in the frame of `axes`.

    Returns:
        (k,) that least largest ratio, above 1 for a vector outside of the envelope; and (k, 3) unit normals
        of the faces of the envelope towards which the vectors lie, on the vectors' side.
    """
    normals, sizes = _facets(axes)
    kept = np.any(normals != 0, axis=1)
    normals, reach = normals[kept], sizes[kept] @ limit
    shares = vectors @ normals.T / reach
    own = np.argmax(np.abs(shares), axis=1)
    share = np.take_along_axis(shares, own[:, None], axis=1)[:, 0]
    return np.abs(share), normals[own] * np.where(share < 0, -1, 1)[:, None]


def _facets(axes: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Find the facets of the envelope of wheels with axes (n, 3), one for each pair of axes, r in number.

    Returns:
        Unit normals (r, 3), at right angles to both axes of the pair, and (r, n) absolute values of their
        products with all axes. Both are zero for a pair that is parallel or lies in the plane of an earlier
        one.
    """
    xp, axes = arrays(axes)
    pairs = np.array(list(combinations(range(len(axes)), 2)))
    across = xp.cross(axes[pairs[:, 0]], axes[pairs[:, 1]])
    square = xp.sum(across * across, axis=1)
    apart = square > _PARALLEL_SINE**2
    normals = across / xp.sqrt(xp.where(apart, square, 1))[:, None]
    between = xp.cross(normals[:, None], normals[None])
    # whether the planes of two pairs are the same
    same = xp.sum(between * between, axis=2) <= _PARALLEL_SINE**2
    earlier = np.tri(len(pairs), k=-1, dtype=bool)
    kept = apart & ~xp.any(same & apart & earlier, axis=1)
    of_pair = np.zeros((len(pairs), len(axes)), bool)
    of_pair[np.arange(len(pairs))[:, None], pairs] = True
    sizes = xp.where(of_pair, 0, xp.abs(normals @ axes.T))  # exactly zero for the axes of the pair
    return xp.where(kept[:, None], normals, 0), xp.where(kept[:, None], sizes, 0)
