"""Two pictures of the sphere of directions: unfolded, and seen from outside.

The unfolded sphere: directions and cones on a map of azimuth and elevation.

The map shows inertial directions as points ``(azimuth, elevation)`` in degrees on [-180, 180] x [-90, 90].
Its left and right edge are one meridian, its upper and lower edge one pole each. Lines that cross the
meridian are cut there; what lies between two parts of a line is a row of NaN, so that one array holds the
whole line.

A cone's boundary is a circle on the sphere. On the map it is a closed ring if the smaller of the two caps
that it bounds holds no pole, and otherwise a graph over all azimuths. So the cap's region is bounded by
rings, by the graph and the edge at the pole, or, of a cone of more than 90 deg, by the frame with a hole.

The sphere seen from outside, from very far: the orthographic projection, and what is in front of it.

Points of the picture are ``(right, up)`` in units of the sphere's radius. Up is north, the inertial z axis.
What lies on the far side is seen through the sphere, and drawn paler.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from jaxplan.geometry.vectors import azimuth_elevation, frame

FRAME = np.array([[-180.0, -90.0], [180.0, -90.0], [180.0, 90.0], [-180.0, 90.0]])

# Angles along a circle, counted from its northernmost point. Near the ends of its meridian, where it may pass
# close to a pole and the azimuth turns fast, they crowd.
_NEAR = np.geomspace(1e-10, 0.02, 60)
_ROUND = np.unique(
    np.concatenate(
        [np.linspace(0, 2 * np.pi, 720, endpoint=False), _NEAR, np.pi - _NEAR, np.pi + _NEAR, -_NEAR]
    )
    % (2 * np.pi)
)


def unfold(directions: np.ndarray) -> np.ndarray:
    """Points of directions on the map.

    Args:
        directions: (..., 3) of any length but zero.

    Returns:
        (..., 2) azimuth in [-180, 180] and elevation, deg; the azimuth of a pole means nothing.
    """
    return np.rad2deg(np.stack(azimuth_elevation(directions), axis=-1))


def cut(points: np.ndarray) -> np.ndarray:
    """A line on the map, taken apart where it crosses the meridian at its edges.

    Args:
        points: (k, 2) deg, successive points of the line; the shorter way between two is meant.

    Returns:
        (k', 2) deg: at every crossing the line runs up to the edge, a row of NaN follows, and it goes on from
        the other edge. No step between two points is longer than 180 deg of azimuth.
    """
    azimuth, elevation = points.T
    before = np.flatnonzero(np.abs(np.diff(azimuth)) > 180)
    edge = np.copysign(180.0, azimuth[before])
    rest, step = edge - azimuth[before], azimuth[before + 1] + 2 * edge - azimuth[before]
    share = np.divide(rest, step, out=np.zeros_like(rest), where=step != 0)
    height = elevation[before] + share * (elevation[before + 1] - elevation[before])
    gap = np.full_like(edge, np.nan)
    extra = np.stack([np.stack([edge, gap, -edge]), np.stack([height, gap, height])], axis=-1)
    return np.insert(points, np.repeat(before + 1, 3), extra.transpose(1, 0, 2).reshape(-1, 2), axis=0)


def outline(axis: np.ndarray, half_angle: float) -> np.ndarray:
    """The boundary of a cone as a line on the map.

    Args:
        axis: (3,) unit vector.
        half_angle: rad, in (0, pi).

    Returns:
        (k, 2) deg, every point at the half angle from the axis; cut at the meridian like the lines of `cut`.
    """
    curve, pole = _boundary(*_smaller_cap(axis, half_angle))
    if pole:
        return curve
    closed = np.concatenate([curve, curve[:1]])
    closed[:, 0] -= 360 * np.round(closed[:, 0] / 360)
    return cut(closed)


def region(axis: np.ndarray, half_angle: float) -> list[np.ndarray]:
    """The inside of a cone as rings on the map.

    Args:
        axis: (3,) unit vector.
        half_angle: rad, in (0, pi).

    Returns:
        Rings (k, 2) in deg, not closed, within the map. Outer rings run counter-clockwise and holes
        clockwise, so they can be filled together as one path.
    """
    curve, pole = _boundary(*_smaller_cap(axis, half_angle))
    inside = half_angle <= np.pi / 2
    if pole:
        edge = 90.0 if (pole > 0) == inside else -90.0
        return [_counter_clockwise(np.concatenate([curve, [[180.0, edge], [-180.0, edge]]]))]
    parts = [_counter_clockwise(part) for part in _within_frame(curve)]
    return parts if inside else [FRAME, *(part[::-1] for part in parts)]


def _smaller_cap(axis: np.ndarray, half_angle: float) -> tuple[np.ndarray, float]:
    """The cone itself up to 90 deg, beyond it the one opposite, with the same boundary."""
    return (axis, half_angle) if half_angle <= np.pi / 2 else (-axis, np.pi - half_angle)


def _boundary(axis: np.ndarray, half_angle: float) -> tuple[np.ndarray, int]:
    """The boundary of a cone of at most 90 deg, and the pole in it: 1 for north, -1 for south, 0 for none.

    With a pole it is a graph from azimuth -180 to 180, with none a ring without cuts, which may leave the map
    on one side. Both have points exactly on the meridian where they meet it.
    """
    azimuth, elevation = np.deg2rad(unfold(axis))
    pole = int(elevation + half_angle > np.pi / 2) - int(half_angle - elevation > np.pi / 2)
    meridian = np.pi - azimuth  # as seen from the axis
    crossings = _crossings(elevation, half_angle, meridian)
    if not pole:
        x, y, z = _circle(elevation, half_angle, np.unique(np.concatenate([_ROUND, crossings])))
        x = np.maximum(x, 0)  # a rounding error below zero, where the circle touches a pole
        points = np.stack([np.rad2deg(azimuth + np.arctan2(y, x)), _elevation(x, y, z)], axis=-1)
        return points, 0
    x, y, z = _circle(elevation, half_angle, _ROUND)
    points = unfold(np.stack([*_turned(x, y, azimuth), z], axis=-1))
    points = points[np.argsort(points[:, 0])]
    points = points[np.abs(points[:, 0]) < 180 - 1e-9]
    x, y, z = _circle(elevation, half_angle, crossings)
    end = _elevation(x, y, z)[np.argmax(x * np.cos(meridian) + y * np.sin(meridian))]
    return np.concatenate([[[-180.0, end]], points, [[180.0, end]]]), pole


def _circle(
    elevation: float, half_angle: float, angle: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions on a cone whose axis has azimuth zero, by the angle from the northernmost one."""
    north, east = np.sin(half_angle) * np.cos(angle), np.sin(half_angle) * np.sin(angle)
    along = np.cos(half_angle)
    x = along * np.cos(elevation) - north * np.sin(elevation)
    return x, east, along * np.sin(elevation) + north * np.cos(elevation)


def _crossings(elevation: float, half_angle: float, meridian: float) -> np.ndarray:
    """Angles along the `_circle` at which it meets the plane of a meridian: two or none."""
    sine = np.sin(half_angle) * np.cos(meridian)
    cosine = np.sin(half_angle) * np.sin(elevation) * np.sin(meridian)
    constant = np.cos(half_angle) * np.cos(elevation) * np.sin(meridian)
    size = np.hypot(sine, cosine)
    if abs(constant) > size * (1 + 1e-12):
        return np.zeros(0)
    middle, side = np.arctan2(sine, cosine), np.arccos(np.clip(constant / size, -1, 1))
    return np.array([middle - side, middle + side]) % (2 * np.pi)


def _turned(x: np.ndarray, y: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    return x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)


def _elevation(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.rad2deg(np.arctan2(z, np.hypot(x, y)))


def _within_frame(ring: np.ndarray) -> list[np.ndarray]:
    """A ring's parts on the map, each closed along the edge at which it is cut."""
    for edge in (-180.0, 180.0):
        closed = np.concatenate([ring, ring[:1]])
        beyond = closed[:, 0] - edge
        before = np.flatnonzero(beyond[:-1] * beyond[1:] < 0)
        share = (beyond[before] / (beyond[before] - beyond[before + 1]))[:, None]
        ring = np.insert(ring, before + 1, (1 - share) * closed[before] + share * closed[before + 1], axis=0)
    parts = [ring + np.array([shift, 0]) for shift in (-360, 0, 360)]
    parts = [part[np.abs(part[:, 0]) <= 180 + 1e-9] for part in parts]
    return [np.clip(part, -FRAME[2], FRAME[2]) for part in parts if len(part) and np.ptp(part[:, 0]) > 1e-6]


def _counter_clockwise(ring: np.ndarray) -> np.ndarray:
    x, y = (ring - ring[0]).T
    area = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return ring if area > 0 else ring[::-1]


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
