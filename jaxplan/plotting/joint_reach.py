"""Where what joints reach is drawn, as angles in rad: cells of surfaces, points of lines, and masks."""

import numpy as np

from jaxplan.geometry.vectors import pointing
from jaxplan.model.devices import Terminal
from jaxplan.model.gimbals import TURN
from jaxplan.model.outlines import half_planes, turns

_CELL = np.deg2rad(5.0)  # rad: width of the cells that surfaces are made of
_STEP = np.deg2rad(2.0)  # rad between points of lines on them, at most


def turn_by(azimuth: float, elevation: float) -> np.ndarray:
    """Rotation (3, 3) by angles in rad, from a moving part's axes (boresight, left, up) to its mount's."""
    ahead = pointing(azimuth, elevation)
    left = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([ahead, left, np.cross(ahead, left)], axis=-1)


def once_around(span: np.ndarray) -> np.ndarray:
    """A range (2,) rad, cut to one turn: the one that ends at pi, or as near to that as the range allows."""
    if span[1] - span[0] < TURN:
        return span
    high = np.clip(np.pi, span[0] + TURN, span[1])
    return np.array([high - TURN, high])


def cells_of(span: np.ndarray) -> np.ndarray:
    """Edges (k,) of equal cells of a range, rad, each about `_CELL` wide."""
    return np.linspace(span[0], span[1], 1 + max(1, round(float(span[1] - span[0]) / _CELL)))


def points_of(span: np.ndarray) -> np.ndarray:
    """Equidistant angles (k,) of a range, rad, at most `_STEP` apart."""
    return np.linspace(span[0], span[1], 2 + int(float(span[1] - span[0]) / _STEP))


def middles_of(edges: np.ndarray) -> np.ndarray:
    """Middles (k,) of the cells between edges (k + 1,)."""
    return (edges[1:] + edges[:-1]) / 2


def within_masks(terminal: Terminal, points: np.ndarray) -> np.ndarray:
    """Which (yaw, pitch) (..., 2) rad lie in a mask of a terminal, at any turn of the yaw; (...) bool."""
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
    """Yaws and pitches along a mask's outline, rad, its corners (k, 2) moved by whole turns of the yaw.

    Points are clipped to the ranges (2,) of yaws and pitches.
    """
    places, count = np.linspace(0.0, len(corners), 24 * len(corners) + 1), np.arange(len(corners) + 1)
    closed = corners[count % len(corners)] + np.array([TURN * turn, 0.0])
    yaw, pitch = (np.interp(places, count, closed[:, column]) for column in range(2))
    return np.clip(yaw, *yaws), np.clip(pitch, *pitches)
