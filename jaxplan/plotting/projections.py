"""Three projections of the sphere of directions: a flat map, two discs, and the globe seen from outside.

All have the same methods, so that `jaxplan.plotting.sky` draws on any of them: where directions are in the
picture and how opaque marks are there, into which parts a line is cut, and which directions the points of the
picture have, for areas and names. Directions are unit vectors in the axes of the figure.

The flat map shows directions as points ``(azimuth, elevation)`` in degrees on [-180, 180] x [-90, 90]. Its
left and right edge are one meridian, its upper and lower edge one pole each. A line that crosses this
meridian is cut there, with a row of NaN in between, so that one array holds the whole line. So is one that
runs over a pole, where the azimuth jumps by half a turn.

The two discs are the half spheres about z (left) and -z (right): in the local orbital frame those about nadir
and the zenith. Angles from the middle and azimuths about it are true (azimuthal equidistant). Both are seen
from the zenith, so that x is up and y to the right on either.

The globe is the orthographic projection, seen from infinitely far. Points of the picture are ``(right, up)``
in units of the sphere's radius, with the z axis upward (the zenith in the orbital
frame). The far side is seen through the sphere, paler.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import ClassVar, NamedTuple, Self, TypeAlias

import numpy as np

from jaxplan.geometry.vectors import azimuth_elevation, frame, pointing, separation

PALE = 0.28  # opacity of the far side of the globe, as a fraction of that of the near side

# rad: angles along a circle from its northernmost point, where it begins. It may pass close to a pole only
# near there or opposite; there the azimuth changes fast, so points are dense.
_NEAR = np.geomspace(1e-6, 0.02, 40)
_CIRCLE_ANGLES = np.unique(
    [*np.linspace(0, 2 * np.pi, 721), *_NEAR, *(np.pi - _NEAR), *(np.pi + _NEAR), *(2 * np.pi - _NEAR)]
)
_EYE_ELEVATIONS = np.deg2rad([15, 0, -15, 30, -30, 45, -45])  # rad: elevations of the eye that are tried
_LIMB_DEPTH = 0.2  # radii: depth below which a direction is too near to the limb to count as in front
_POLE_DISTANCE = 1.0  # deg: a line that is nearer to a pole counts as over it; less than its drawn width
_STRAIGHT_TURN = 4.0  # deg: difference of azimuth up to which a line between two points is drawn straight
_STRAIGHT_ANGLE = np.deg2rad(1.0)  # rad: angle between two points up to which it is straight in any case
_MAX_STEPS = 90  # most steps into which a line between two points is divided
# Coordinates of the grids on which areas are computed: deg on flat map and discs, radii on the globe.
_AZIMUTH_LINES, _ELEVATION_LINES = np.linspace(-180, 180, 361), np.linspace(-90, 90, 181)
_GLOBE_LINES = np.linspace(-1.01, 1.01, 203)
_DISC_LINES = np.linspace(-91.0, 91.0, 183)
_SMALL_CONE = np.deg2rad(3.0)  # rad: half angle of a cone up to which the grid is made finer around it
_FINE_OFFSETS = np.linspace(-1.1, 1.1, 23)  # offsets of added coordinates from its centre, in its half widths


def circle(axis: np.ndarray, half_angle: float) -> np.ndarray:
    """Return points along the edge of a cone on the sphere, from its northernmost point around.

    Args:
        axis: (3,) unit vector.
        half_angle: rad.

    Returns:
        (k, 3) unit vectors, the last of which equals the first.
    """
    azimuth, elevation = azimuth_elevation(axis)
    _, left, up = frame(np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation))
    turn = _CIRCLE_ANGLES[:, None]
    around = np.cos(turn) * np.array(up) + np.sin(turn) * np.array(left)
    return np.asarray(np.cos(half_angle) * axis + np.sin(half_angle) * around)


def grid_lines() -> list[np.ndarray]:
    """Return meridians and parallels every 30 deg, each as unit vectors (k, 3)."""
    meridians = [circle(pointing(angle, 0.0), np.pi / 2) for angle in np.deg2rad(range(0, 180, 30))]
    return meridians + [circle(np.array([0.0, 0.0, 1.0]), angle) for angle in np.deg2rad(range(30, 180, 30))]


def unfold(directions: np.ndarray) -> np.ndarray:
    """Map directions to points of the flat map.

    Args:
        directions: (..., 3) of any length but zero.

    Returns:
        (..., 2) azimuth in [-180, 180] and elevation, deg; the azimuth of a pole is arbitrary.
    """
    return np.rad2deg(np.stack(azimuth_elevation(directions), axis=-1))


def cut(points: np.ndarray) -> np.ndarray:
    """Cut a line on the flat map where it crosses the meridian at the map's edges.

    Args:
        points: (k, 2) deg, successive points of the line; two are joined the shorter way round in azimuth.

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


def over_poles(points: np.ndarray) -> np.ndarray:
    """Cut a line on the flat map where it runs over a pole.

    Args:
        points: (k, 2) deg, successive points of the line.

    Returns:
        (k', 2) deg: points within `_POLE_DISTANCE` of a pole are replaced by it at the azimuths of the points
        before and after, with a row of NaN between. A line that stays near a pole is returned as it is.
    """
    near = np.abs(points[:, 1]) > 90 - _POLE_DISTANCE
    if not np.any(near) or np.all(np.abs(points[:, 1]) > 90 - 1.5 * _POLE_DISTANCE):
        return points
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    parts, done = list[np.ndarray](), 0
    for first, after in edges.reshape(-1, 2):
        pole = np.copysign(90.0, points[first, 1])
        parts.append(points[done:first])
        if first > 0:
            parts.append(np.array([[points[first - 1, 0], pole]]))
        if first > 0 and after < len(points):
            parts.append(np.full((1, 2), np.nan))
        if after < len(points):
            parts.append(np.array([[points[after, 0], pole]]))
        done = after
    return np.concatenate([*parts, points[done:]])


def fine(line: np.ndarray, wide: np.ndarray) -> np.ndarray:
    """Insert points along great circles between those points of a line that are far apart.

    Args:
        line: (k, 3) unit vectors.
        wide: (k - 1,) number of steps wanted between each two points, 1 for no points between.

    Returns:
        (k', 3), among them all of the line's points. None are put between points closer than
        `_STRAIGHT_ANGLE`, and between opposite ones, since those have no unique great circle.
    """
    apart = separation(line[:-1], line[1:])
    steps = np.where(
        (apart > _STRAIGHT_ANGLE) & (apart < np.pi - 1e-6), np.clip(wide, 1, _MAX_STEPS), 1
    ).astype(int)
    if not np.any(steps > 1):
        return line
    before = np.repeat(np.arange(len(steps)), steps)
    share = (np.arange(len(before)) - np.repeat(np.cumsum(steps) - steps, steps)) / steps[before]
    angle = apart[before]
    sine = np.where(np.sin(angle) > 0, np.sin(angle), 1.0)
    first, second = np.sin((1 - share) * angle) / sine, np.sin(share * angle) / sine
    points = first[:, None] * line[before] + second[:, None] * line[before + 1]
    points[share == 0] = line[before[share == 0]]
    return np.concatenate([points, line[-1:]])


class Sheet(NamedTuple):
    """One layer of a picture on a grid of picture points, from which filled areas are computed.

    Attributes:
        across: (n,) horizontal coordinates: deg on flat map and discs, radii on the globe.
        upward: (m,) vertical coordinates.
        directions: (m, n, 3) unit vectors of the directions at the grid's points.
        strength: factor for the opacity of areas on this layer.
        limb: centre (2,) and radius of the circle at which the layer ends; None for a rectangle.
    """

    across: np.ndarray
    upward: np.ndarray
    directions: np.ndarray
    strength: float
    limb: tuple[tuple[float, float], float] | None = None


class FlatMap:
    """Projection of the sphere to azimuth and elevation in degrees.

    Attributes:
        letter: deg, width of a letter of a name and height of its line.
        mark: deg, size of the mark of a start or a goal.
        gap: deg between the edge of a zone and a name beside it.
    """

    letter: ClassVar = np.array([4.6, 8.6])
    mark: ClassVar = 10.0
    gap: ClassVar = 2.0

    def project(self, directions: np.ndarray) -> np.ndarray:
        """Return points (..., 2) of the picture, deg, for directions (..., 3)."""
        return unfold(directions)

    def opacity(self, directions: np.ndarray) -> np.ndarray:
        """Return the opacity (...) of marks and lines at directions (..., 3), which is 1 everywhere."""
        return np.ones(directions.shape[:-1])

    def parts(self, line: np.ndarray) -> list[tuple[np.ndarray, float]]:
        """Cut a line (k, 3) on the sphere into lines (k', 2) of the picture, each with its opacity."""
        if len(line) > 1:
            turned = np.abs(np.diff(unfold(line)[:, 0]))
            turned = np.minimum(turned, 360 - turned)
            line = fine(line, np.where(turned > _STRAIGHT_TURN, np.ceil(2 * turned / _STRAIGHT_TURN), 1))
        return [(cut(over_poles(unfold(line))), 1.0)]

    def sheets(self, axis: np.ndarray, half_angle: float) -> Iterator[Sheet]:
        """Yield the only layer of the map, on a grid that is fine enough for the given cone."""
        if half_angle > _SMALL_CONE:
            yield _flat_sheet()
            return
        (azimuth, elevation), (width, height) = self.project(axis), self.extent(axis, half_angle)
        across, upward = _AZIMUTH_LINES, _refine_lines(_ELEVATION_LINES, elevation, height)
        for turn in (-360.0, 0.0, 360.0):  # a cone at one edge of the map is seen at the other, too
            across = _refine_lines(across, azimuth + turn, width)
        yield _make_sheet(across, upward)

    def extent(self, axis: np.ndarray, half_angle: float) -> tuple[float, float]:
        """Return half the width and height, deg, of a cone in the picture, at most those of a half sphere."""
        angle = min(float(np.rad2deg(half_angle)), 90.0)
        return angle / np.cos(min(abs(azimuth_elevation(axis)[1]), np.pi / 3)), angle

    def fit(self, spots: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Move centres (k, 2) of labels of a size (2,) so far that the labels lie on the map."""
        room = np.maximum(np.array([180.0, 87.0]) - size / 2, 0)
        azimuth = (spots[:, 0] + 180) % 360 - 180
        return np.clip(np.stack([azimuth, spots[:, 1]], axis=-1), -room, room)

    def directions(self, spots: np.ndarray, _: np.ndarray) -> np.ndarray:
        """Return the directions (k, 3) at points (k, 2) of the picture."""
        return np.asarray(pointing(*np.deg2rad(spots.T)))


def _make_sheet(across: np.ndarray, upward: np.ndarray) -> Sheet:
    """Make the layer of the flat map for azimuths (n,) and elevations (m,), deg."""
    return Sheet(across, upward, np.asarray(pointing(*np.deg2rad(np.meshgrid(across, upward)))), 1.0)


@cache
def _flat_sheet() -> Sheet:
    """Return the layer of the flat map on its usual grid, computed once."""
    return _make_sheet(_AZIMUTH_LINES, _ELEVATION_LINES)


def _refine_lines(lines: np.ndarray, centre: float, reach: float) -> np.ndarray:
    """Add coordinates within about `reach` of a centre to grid coordinates (n,), for a small cone there."""
    more = centre + reach * _FINE_OFFSETS
    return np.union1d(lines, more[(more > lines[0]) & (more < lines[-1])])


class TwoDiscs:
    """Projection of the half spheres about z and -z to one disc each, with true angles from the middles.

    Attributes:
        middle: deg in the picture; the discs' middles are that far left (z) and right (-z) of the origin.
        letter: deg, width of a letter of a name and height of its line.
        mark: deg, size of the mark of a start or a goal.
        gap: deg between the edge of a zone and a name beside it.
        rings: deg from the middles, radii of the rings that are drawn and named.
    """

    rings: ClassVar = (30, 60, 90)
    middle: ClassVar = 104.0
    letter: ClassVar = np.array([4.7, 8.8])
    mark: ClassVar = 10.0
    gap: ClassVar = 2.0

    def project(self, directions: np.ndarray) -> np.ndarray:
        """Return points (..., 2) of the picture, deg, for directions (..., 3) in the frame."""
        return self._to_disc(directions, directions[..., 2] >= 0)

    def ring_names(self) -> list[tuple[str, np.ndarray]]:
        """Return the names of the rings with their places (2,), which no other name may cover."""
        found = []
        for middle, ring in product((-self.middle, self.middle), self.rings):
            off = (ring + 6 * (ring == 90)) * np.sqrt(0.5)  # the name of the outermost ring stands outside
            found.append((f"{ring}\N{DEGREE SIGN}", np.array([middle + off, -off])))
        return found

    def _to_disc(self, directions: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Map directions (..., 3) to points (..., 2) of the disc about z where `first`, else about -z."""
        across = np.hypot(directions[..., 0], directions[..., 1])
        off = np.rad2deg(np.arctan2(across, np.where(first, 1, -1) * directions[..., 2]))
        share = np.divide(off, across, out=np.zeros_like(off), where=across > 0)
        middle = np.where(first, -self.middle, self.middle)
        return np.stack([middle + share * directions[..., 1], share * directions[..., 0]], axis=-1)

    def opacity(self, directions: np.ndarray) -> np.ndarray:
        """Return the opacity (...) of marks and lines at directions (..., 3), which is 1 everywhere."""
        return np.ones(directions.shape[:-1])

    def parts(self, line: np.ndarray) -> list[tuple[np.ndarray, float]]:
        """Convert a line (k, 3) to a line (k', 2) of the picture, cut where it leaves a disc; opacity 1."""
        if len(line) > 1:
            line = fine(line, np.ceil(separation(line[:-1], line[1:]) / _STRAIGHT_ANGLE))
        first = line[:, 2] >= 0
        before = np.flatnonzero(np.diff(first))
        low, high = line[before], line[before + 1]
        share = low[:, 2] / (low[:, 2] - high[:, 2])
        edge = low + share[:, None] * (high - low)
        edge[:, 2] = 0.0
        here, there = self._to_disc(edge, first[before]), self._to_disc(edge, ~first[before])
        extra = np.stack([here, np.full_like(here, np.nan), there], axis=1).reshape(-1, 2)
        return [(np.insert(self.project(line), np.repeat(before + 1, 3), extra, axis=0), 1.0)]

    def sheets(self, axis: np.ndarray, half_angle: float) -> Iterator[Sheet]:
        """Yield a layer for each disc; points beyond its edge have the directions of the edge."""
        own, (reach, _) = self.project(axis), self.extent(axis, half_angle)
        for side in (1, -1):
            middle = np.array([-side * self.middle, 0.0])
            across = upward = _DISC_LINES
            if half_angle <= _SMALL_CONE:
                across, upward = (_refine_lines(across, centre, reach) for centre in own - middle)
            directions = _from_disc(*np.meshgrid(across, upward)) * (1, 1, side)
            yield Sheet(across + middle[0], upward, directions, 1.0, ((float(middle[0]), 0.0), 90.0))

    def extent(self, axis: np.ndarray, half_angle: float) -> tuple[float, float]:
        """Return half the width and height, deg, of a cone in the picture, at most those of a half sphere."""
        size = min(float(np.rad2deg(half_angle)), 90.0)
        return size, size

    def fit(self, spots: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Move centres (k, 2) of labels of a size (2,) so far that each lies in the square of one disc."""
        middle = np.where(spots[:, :1] < 0, -self.middle, self.middle) * (1, 0)
        room = np.maximum(np.array([94.0, 88.0]) - size / 2, 0)
        return np.asarray(middle + np.clip(spots - middle, -room, room))

    def directions(self, spots: np.ndarray, _: np.ndarray) -> np.ndarray:
        """Return the directions (k, 3) at points (k, 2) of the picture; NaN beyond the discs."""
        side = np.where(spots[:, 0] < 0, 1.0, -1.0)
        right, up = spots[:, 0] + side * self.middle, spots[:, 1]
        found = _from_disc(right, up) * np.stack([np.ones_like(side), np.ones_like(side), side], axis=-1)
        return np.where(np.hypot(right, up)[:, None] <= 90 + 1e-9, found, np.nan)


def _from_disc(right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return directions (..., 3) at places, deg from the middle of the disc about z; clipped to its edge."""
    off = np.hypot(right, up)
    angle = np.deg2rad(np.minimum(off, 90.0))
    across = np.sin(angle) / np.where(off > 0, off, 1.0)
    return np.stack([across * up, across * right, np.cos(angle)], axis=-1)


@dataclass(frozen=True)
class GlobeView:
    """Orthographic projection of the sphere as seen from outside.

    Attributes:
        axes: (3, 3) rows are the directions right, up and toward the eye.
        told: caption for axes that are not inertial; empty for inertial ones.
        letter: radii, width of a letter of a name and height of its line.
        mark: radii, size of the mark of a start or a goal.
        gap: radii between the edge of a zone and a name beside it.
    """

    axes: np.ndarray
    told: str = ""

    letter: ClassVar = np.array([0.032, 0.07])
    mark: ClassVar = 0.08
    gap: ClassVar = 0.02

    @classmethod
    def from_angles(cls, azimuth: float, elevation: float) -> Self:
        """Make the view with the eye at an azimuth and an elevation, rad, and the z axis upward."""
        toward, right, up = frame(np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation))
        return cls(np.array([right, up, toward]))

    @classmethod
    def facing(cls, directions: np.ndarray) -> Self:
        """Make the view with most of the directions (k, 3) in front, rather from a low elevation."""
        angles = [(a, e) for e in _EYE_ELEVATIONS for a in np.deg2rad(range(0, 360, 15))]
        views = [cls.from_angles(*pair) for pair in angles]
        shares = [
            np.mean(view.depth(directions) > _LIMB_DEPTH) - 0.05 * abs(pair[1])
            for view, pair in zip(views, angles, strict=True)
        ]
        return views[int(np.argmax(shares))]

    @property
    def words(self) -> str:
        """Caption that says from where the globe is seen."""
        azimuth, elevation = np.rad2deg(azimuth_elevation(self.axes[2]))
        return self.told or f"seen from azimuth {azimuth:.0f}, elevation {elevation:.0f} deg (inertial)"

    def project(self, directions: np.ndarray) -> np.ndarray:
        """Return points (..., 2) of the picture, radii, for points (..., 3) on or in the sphere."""
        return np.asarray(directions @ self.axes[:2].T)

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Return the depth (...) of points (..., 3) toward the eye, positive on the near side."""
        return np.asarray(points @ self.axes[2])

    def opacity(self, directions: np.ndarray) -> np.ndarray:
        """Return the opacity (...) of marks and lines at directions (..., 3): 1 in front, `PALE` behind."""
        return np.where(self.depth(directions) >= 0, 1.0, PALE)

    def parts(self, line: np.ndarray) -> list[tuple[np.ndarray, float]]:
        """Split a line (k, 3) into front and back: points (k, 2), NaN elsewhere, each with its opacity."""
        flat, near = self.project(line), self.depth(line) >= 0
        far = ~near
        far[1:] |= near[1:] & ~near[:-1]  # so that the two halves meet
        far[:-1] |= near[:-1] & ~near[1:]
        return [(np.where(side[:, None], flat, np.nan), alpha) for side, alpha in ((near, 1.0), (far, PALE))]

    def sheets(self, axis: np.ndarray, half_angle: float) -> Iterator[Sheet]:
        """Yield layers for front and back; grid points beyond the limb have directions of the limb."""
        across = upward = _GLOBE_LINES
        points = _whole_half_sphere()
        if half_angle <= _SMALL_CONE:
            (right, up), (reach, _) = self.project(axis), self.extent(axis, half_angle)
            across, upward = _refine_lines(across, right, reach), _refine_lines(upward, up, reach)
            points = _half_sphere_points(across, upward)
        for side, strength in ((1, 1.3), (-1, PALE)):
            yield Sheet(across, upward, points * (1, 1, side) @ self.axes, strength, ((0.0, 0.0), 1.0))

    def extent(self, axis: np.ndarray, half_angle: float) -> tuple[float, float]:
        """Return half the width and height, radii, of a cone in the picture, as if seen along its axis."""
        size = float(np.sin(min(half_angle, np.pi / 2)))
        return size, size

    def fit(self, spots: np.ndarray, _: np.ndarray) -> np.ndarray:
        """Return centres (k, 2) of labels unchanged, since there is room all around the globe."""
        return spots

    def directions(self, spots: np.ndarray, beside: np.ndarray) -> np.ndarray:
        """Return directions (k, 3) at points (k, 2), on the side of `beside` (3,); NaN beyond the limb."""
        depth = np.sqrt(np.where(np.hypot(*spots.T) < 1, 1 - np.sum(spots**2, axis=-1), np.nan))
        side = 1 if self.depth(beside) >= 0 else -1
        return np.column_stack([spots, side * depth]) @ self.axes


Projection: TypeAlias = FlatMap | TwoDiscs | GlobeView


def _half_sphere_points(across: np.ndarray, upward: np.ndarray) -> np.ndarray:
    """Return points (m, n, 3) of the near half sphere, (right, up, depth), on a grid about the unit disc."""
    right, up = np.meshgrid(across, upward)
    radius = np.maximum(np.hypot(right, up), 1)
    right, up = right / radius, up / radius
    return np.stack([right, up, np.sqrt(np.maximum(1 - right**2 - up**2, 0))], axis=-1)


@cache
def _whole_half_sphere() -> np.ndarray:
    """Return the points of the near half sphere on the globe's usual grid, computed once."""
    return _half_sphere_points(_GLOBE_LINES, _GLOBE_LINES)
