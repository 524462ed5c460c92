"""Geometry in joint angles, rad, for drawing what joints reach: cells of surfaces, points of lines, masks."""

import numpy as np

from jaxplan.geometry.vectors import pointing
from jaxplan.model.devices import Terminal
from jaxplan.model.gimbals import TURN
from jaxplan.model.outlines import half_planes, turns

_CELL_WIDTH = np.deg2rad(5.0)  # rad: approximate width of the cells that surfaces are made of
_LINE_STEP = np.deg2rad(2.0)  # rad: largest distance between points of lines on them


def turn_by(azimuth: float, elevation: float) -> np.ndarray:
    """Return the rotation (3, 3) from a moving part's axes (boresight, left, up) to its mount's.

    Args:
        azimuth: rad, the yaw of a terminal or the angle of a drive.
        elevation: rad, the pitch of a terminal or the tilt of a drive.
    """
    ahead = pointing(azimuth, elevation)
    left = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([ahead, left, np.cross(ahead, left)], axis=-1)


def once_around(span: np.ndarray) -> np.ndarray:
    """Cut a range (2,), rad, to one turn: the turn that ends at pi, or as near to pi as the range allows.

    A range of less than a turn is returned as it is.
    """
    if span[1] - span[0] < TURN:
        return span
    high = np.clip(np.pi, span[0] + TURN, span[1])
    return np.array([high - TURN, high])


def cells_of(span: np.ndarray) -> np.ndarray:
    """Divide a range (2,), rad, into equal cells about `_CELL_WIDTH` wide; returns their edges (k,)."""
    return np.linspace(span[0], span[1], 1 + max(1, round(float(span[1] - span[0]) / _CELL_WIDTH)))


def points_of(span: np.ndarray) -> np.ndarray:
    """Return equidistant angles (k,) over a range (2,), rad, at most `_LINE_STEP` apart, with both ends."""
    return np.linspace(span[0], span[1], 2 + int(float(span[1] - span[0]) / _LINE_STEP))


def middles_of(edges: np.ndarray) -> np.ndarray:
    """Return the middles (k,) of the cells between edges (k + 1,)."""
    return (edges[1:] + edges[:-1]) / 2


def within_masks(terminal: Terminal, points: np.ndarray) -> np.ndarray:
    """Return whether points (..., 2), yaw and pitch in rad, lie in a mask of a terminal, at any turn of yaw.

    The result is (...) bool.
    """
    found = np.zeros(points.shape[:-1], dtype=bool)
    low, high = np.min(points[..., 0]), np.max(points[..., 0])
    for corners in terminal.mask:
        normals, least = half_planes(np.asarray(corners, float))
        for turn in turns(corners, low, high):
            inside = (points - [TURN * turn, 0.0]) @ normals.T < least
            found |= np.all(inside, axis=-1)
    return found


def outline_of(
    corners: np.ndarray, turn: int, yaws: np.ndarray, pitches: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return yaws and pitches, rad, at points along the outline of a mask.

    Args:
        corners: (k, 2) yaw and pitch of the mask's corners, rad.
        turn: number of whole turns of yaw by which the mask is moved.
        yaws: (2,) range of yaw, rad; points are clipped to it.
        pitches: (2,) range of pitch, rad; points are clipped to it.
    """
    places, count = np.linspace(0.0, len(corners), 24 * len(corners) + 1), np.arange(len(corners) + 1)
    closed = corners[count % len(corners)] + np.array([TURN * turn, 0.0])
    yaw, pitch = (np.interp(places, count, closed[:, column]) for column in range(2))
    return np.clip(yaw, *yaws), np.clip(pitch, *pitches)
