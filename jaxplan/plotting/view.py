"""The sphere seen from outside, from very far: the orthographic projection, and what is in front of it.

Points of the picture are ``(right, up)`` in units of the sphere's radius. Up is north, the inertial z axis.
What lies on the far side is seen through the sphere, and drawn paler.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from jaxplan.geometry.directions import frame

# The far side shows at that share of the near side's opacity.
PALE = 0.28
_ELEVATIONS = np.deg2rad([15, 0, -15, 30, -30, 45, -45])  # of a chosen view
_LIMB = 0.2  # depth, below which a direction is seen too much from the side


@dataclass(frozen=True)
class View:
    """Where the eye is.

    Attributes:
        axes: (3, 3) rows right, up and toward the eye, inertial.
    """

    axes: np.ndarray

    @classmethod
    def from_angles(cls, azimuth: float, elevation: float) -> Self:
        """The eye at an inertial azimuth and elevation, rad."""
        toward, right, up = frame(np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation))
        return cls(np.array([right, up, toward]))

    @classmethod
    def facing(cls, directions: np.ndarray) -> Self:
        """Of views all around, the one with most of (k, 3) directions in front; of equals, the levelest."""
        angles = [(a, e) for e in _ELEVATIONS for a in np.deg2rad(range(0, 360, 15))]
        views = [cls.from_angles(*pair) for pair in angles]
        shares = [
            np.mean(view.depth(directions) > _LIMB) - 0.05 * abs(pair[1])
            for view, pair in zip(views, angles, strict=True)
        ]
        return views[int(np.argmax(shares))]

    def project(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) of the picture for (..., 3) points."""
        return np.asarray(points @ self.axes[:2].T)

    def depth(self, points: np.ndarray) -> np.ndarray:
        """(...) toward the eye; the sphere's near side is positive."""
        return np.asarray(points @ self.axes[2])

    def sides(self, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A line (k, 3) on the sphere as (k, 2) in front and behind, NaN where it is on the other side."""
        flat, near = self.project(line), self.depth(line) >= 0
        far = ~near
        far[1:] |= near[1:] & ~near[:-1]  # so that the two halves meet
        far[:-1] |= near[:-1] & ~near[1:]
        return np.where(near[:, None], flat, np.nan), np.where(far[:, None], flat, np.nan)


def circle(direction: np.ndarray, half_angle: float | np.ndarray, count: int = 181) -> np.ndarray:
    """Edges of cones on the sphere.

    Args:
        direction: (3,) unit vector of the axis.
        half_angle: (...) rad.
        count: of points, the last of which is the first.

    Returns:
        (..., count, 3).
    """
    aside = np.eye(3)[np.argmin(np.abs(direction))]
    right = np.cross(direction, aside)
    right /= np.linalg.norm(right)
    turn = np.linspace(0, 2 * np.pi, count)[:, None]
    around = np.cos(turn) * right + np.sin(turn) * np.cross(direction, right)
    angle = np.asarray(half_angle)[..., None, None]
    return np.asarray(np.cos(angle) * direction + np.sin(angle) * around)


def insides(
    view: View, direction: np.ndarray, half_angle: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far the picture's points are inside a cone, for contours of its near and its far side.

    Args:
        view: of the picture.
        direction: (3,) unit vector of the axis.
        half_angle: rad.

    Returns:
        (n,) right and up of a square grid, and (2, n, n): cosine of the angle from the axis less that of the
        half angle, in front and behind. Beyond the limb it goes on as at the limb.
    """
    line = np.linspace(-1.01, 1.01, 203)
    right, up = np.meshgrid(line, line)
    radius = np.maximum(np.hypot(right, up), 1)
    right, up = right / radius, up / radius
    depth = np.sqrt(np.maximum(1 - right**2 - up**2, 0))
    points = np.stack([np.stack([right, up, side * depth], axis=-1) for side in (1, -1)])
    return line, line, points @ (view.axes @ direction) - np.cos(half_angle)
