"""Geometry of fields of view and masks: edges of a rectangular field, half-planes of a convex polygon.

A *rectangular field* is a pyramid about a boresight. Its directions are ``up`` and, across that,
``left = up x boresight``. Its two full angles lie between opposite edges, measured in the plane of ``left``
(across) and in that of ``up`` (along). The field is on the inner side of four planes through its apex, with
outward normals:

    +-cos(across / 2) left - sin(across / 2) boresight,    +-cos(along / 2) up - sin(along / 2) boresight

The angle from the boresight to a corner has the tangent ``hypot(tan(across / 2), tan(along / 2))``.

A *mask* is a convex polygon of yaw and pitch, with its corners in either order. A point is outside of it if
``normal . (yaw, pitch) >= least`` for at least one of its edges, with ``normal`` of length one. If the range
of the yaw allows it, the mask is met again after each whole turn.

Everything but `turns` and `fault` computes with numpy or JAX, as its arguments do. Angles in rad.
"""

import math

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays

EDGES = ("left", "right", "upper", "lower")
"""Names of the edges of a field, in their order, as seen along the boresight with up upward."""
UP = np.array([0.0, 0.0, 1.0])
"""The direction of up of a terminal that does not say: the one in which its pitch rises."""
FORWARD = np.array([1.0, 0.0, 0.0])
"""The boresight of a terminal in the axes of its moving part: boresight, left, up."""
MOST_TURNS = 2
"""Whole turns to either side after which a mask of traced numbers is repeated: enough for ranges of two."""
_EDGE_TOLERANCE = 1e-9  # rad; shorter edges of a mask are refused, corners that bend by less are straight


def field_edges(boresight: ArrayLike, up: ArrayLike | None, angles: ArrayLike | None) -> AnyArray:
    """Return the outward normals of the four edges of a rectangular field.

    Args:
        boresight: (3,) unit vector.
        up: (3,) about at right angles to the boresight; only its component across that counts.
        angles: (2,) rad, full angles across `up` and along it, below pi.

    Returns:
        (4, 3) unit vectors in the frame of the boresight, in the order of `EDGES`.
    """
    xp, forward, above, full = arrays(boresight, up, angles)
    left = xp.cross(above, forward)
    left = left / xp.sqrt(xp.sum(left * left))
    half = full / 2
    across = (xp.cos(half[0]) * left, xp.sin(half[0]) * forward)
    along = (xp.cos(half[1]) * xp.cross(forward, left), xp.sin(half[1]) * forward)
    return xp.stack([sign * out - back for out, back in (across, along) for sign in (1.0, -1.0)])


def corner_angle(angles: ArrayLike | None) -> AnyArray:
    """Return the angle, rad, from boresight to corners of a rectangular field with full angles (2,) rad."""
    xp, full = arrays(angles)
    tangents = xp.tan(full / 2)
    return xp.arctan(xp.sqrt(xp.sum(tangents * tangents)))


def field_corners(boresight: np.ndarray, up: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return unit vectors (4, 3) to the corners of a rectangular field, in order around it, by numpy only.

    Arguments and frame are as for `field_edges`.
    """
    left, right, upper, lower = field_edges(boresight, up, angles)
    corners = np.stack(
        [np.cross(left, upper), np.cross(upper, right), np.cross(right, lower), np.cross(lower, left)]
    )
    corners /= np.linalg.norm(corners, axis=-1, keepdims=True)
    return np.asarray(corners * np.sign(corners @ boresight)[:, None])


def half_planes(corners: ArrayLike, *, box: bool = False) -> tuple[AnyArray, AnyArray]:
    """Return the half-planes outside of the edges of a convex polygon, as ``normal . point >= least``.

    Args:
        corners: (k, 2) in order around it, in either sense.
        box: whether to add the half-planes outside of its bounding box. They contain no more points; but if
            all half-planes are moved outward by the effect of a step of either coordinate, only with them
            does the polygon grow by exactly that step.

    Returns:
        Outward normals (k, 2) of length one, and (k,) least values outside; with `box` four more of each.
    """
    xp, points = arrays(corners)
    following = xp.roll(points, -1, axis=0)
    edge = following - points
    area = xp.sum(points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0])
    outward = xp.sign(area) * xp.stack([edge[:, 1], -edge[:, 0]], axis=-1)
    normals = outward / xp.sqrt(xp.sum(edge * edge, axis=-1))[:, None]
    least = xp.sum(normals * points, axis=-1)
    if box:
        sides = xp.concatenate([xp.max(points, axis=0), xp.max(-points, axis=0)])
        least = xp.concatenate([least, sides])
        normals = xp.concatenate([normals, xp.concatenate([xp.eye(2), -xp.eye(2)]).astype(normals.dtype)])
    return normals, least


def turns(corners: ArrayLike, low: ArrayLike, high: ArrayLike) -> tuple[int, ...]:
    """Return the whole turns of yaw by which a mask can be moved so that it reaches into a range.

    Args:
        corners: (k, 2) rad, yaw and pitch.
        low: rad, least yaw of the range.
        high: rad, largest yaw of the range.

    Returns:
        Numbers of turns, no more than needed. For JAX arrays, whose values may be unknown, all from
        -`MOST_TURNS` to `MOST_TURNS`.
    """
    if array_module(corners, low, high) is jnp:
        return tuple(range(-MOST_TURNS, MOST_TURNS + 1))
    yaws, turn = np.asarray(corners)[:, 0], 2 * np.pi
    first, last = (np.asarray(low) - np.max(yaws)) / turn, (np.asarray(high) - np.min(yaws)) / turn
    return tuple(range(math.floor(first) + 1, math.ceil(last)))


def fault(corners: np.ndarray) -> str | None:
    """Say what is wrong with the corners (k, 2) rad of a mask.

    Returns:
        Text that follows "must" in a message; None if nothing is wrong.
    """
    if len(corners) < 3:
        return f"have 3 corners or more, not {len(corners)}"
    edge = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edge, axis=-1)
    if np.min(lengths) < _EDGE_TOLERANCE:
        corner = int(np.argmin(lengths))
        if corner == len(corners) - 1:
            return "have each corner once, the last is the first again"
        return f"have corners apart from each other, corner [{corner}] is at the next one"
    following = np.roll(edge, -1, axis=0)
    bend = edge[:, 0] * following[:, 1] - edge[:, 1] * following[:, 0]
    ahead = np.sum(edge * following, axis=-1)
    if np.all(np.abs(bend) <= _EDGE_TOLERANCE * lengths * np.roll(lengths, -1)):
        return "have an area, its corners lie on a line"
    turned = np.arctan2(bend, ahead)
    around = round(float(np.sum(turned)) / (2 * np.pi))
    if abs(around) != 1:
        return "not cross itself"
    inward = np.flatnonzero(np.sign(around) * turned < -_EDGE_TOLERANCE)
    if len(inward):
        corner = (int(inward[0]) + 1) % len(corners)
        return f"be convex, it bends inward at corner [{corner}]: cut it there into convex ones, each a mask"
    return None
