"""Parts of the picture of a spacecraft: where devices and wheels are drawn, and what joints reach.

**Devices.** A spacecraft knows how they are mounted, but not where. The platform is drawn as a cube with half
edges of 1. Each device has a *side*, a direction from the middle of the cube in body axes, and stands where
this direction meets the surface: at its *foot*. The side of a terminal or a drive is the mean of all
directions that its boresight can reach, that of an instrument its boresight. Where this mean is too short to
tell a direction, the side of a terminal is its boresight at zero angles, and that of a drive its axis, or the
opposite of the axis where another device stands already.

**Wheels.** A spacecraft says about which axes its wheels spin, but not where they are. They are drawn inside
the platform, each off its middle along the wheel's axis, or beside that place if another wheel is there
already. The middle of a wheel is its *hub*. Their lengths are in units of a picture whose platform is a cube
with half edges of 0.55; points are in body axes.

**What joints reach** is drawn from joint angles, rad: cells of surfaces, points of lines, masks.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from jaxplan.geometry.vectors import pointing
from jaxplan.model.devices import Terminal
from jaxplan.model.gimbals import TURN
from jaxplan.model.outlines import half_planes, turns
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import Wheel

_MIN_MEAN_LENGTH = 0.2  # of all directions that a device reaches; a shorter mean tells no side
_MIN_FOOT_DISTANCE = 0.6  # half edges between the feet of two devices at least, where there is room
_SIDE_STEP = 0.65  # half edges from a foot to the places beside it that are tried


COLOUR = "0.25"  # of wheels; no device has this grey
FILL = (COLOUR, 0.30)  # colour and opacity of what a ring encloses
SPIN = 0.19  # length of the arrow along a wheel's axis
_HUB_DISTANCE, _RING_RADIUS = 0.36, 0.13  # a hub is so far from the middle of the platform
_HUB_STEP, _MIN_HUB_DISTANCE = 2.4, 1.5  # radii: from a place to those beside it; least distance of two hubs


_CELL_WIDTH = np.deg2rad(5.0)  # rad: approximate width of the cells that surfaces are made of
_LINE_STEP = np.deg2rad(2.0)  # rad: largest distance between points of lines on them


def feet(craft: Spacecraft) -> np.ndarray:
    """Choose the points (D, 3) on the surface of the cube at which the D devices are drawn, in body axes."""
    taken: list[np.ndarray] = []
    for wanted in _rank_sides(craft):
        places = [_foot_places(side) for side in wanted]
        every = [*(own[0] for own in places), *(place for own in places for place in own[1:])]
        free = [
            place for place in every if all(np.linalg.norm(place - one) > _MIN_FOOT_DISTANCE for one in taken)
        ]
        taken.append((free or every)[0])
    return np.array(taken).reshape(-1, 3)


def _rank_sides(craft: Spacecraft) -> list[list[np.ndarray]]:
    """Return for each device the sides on which it may stand, best first: directions (3,) in body axes."""
    frames, ranges = craft.gimbals.frames, craft.joint_ranges
    n, found = len(craft.terminals), list[list[np.ndarray]]()
    for number in range(n):
        middle = frames[number] @ _mean_boresight(ranges[number], ranges[n + number])
        found.append([middle if np.linalg.norm(middle) > _MIN_MEAN_LENGTH else frames[number, :, 0]])
    for place, drive in enumerate(craft.drives):
        tilt = craft.gimbals.tilts[place]
        middle = frames[n + place] @ _mean_boresight(ranges[2 * n + place], np.array([tilt, tilt]))
        axis = np.asarray(drive.axis, float)
        found.append([middle] if np.linalg.norm(middle) > _MIN_MEAN_LENGTH else [axis, -axis])
    return found + [[boresight] for boresight in craft.fixed_boresights]


def _mean_boresight(yaws: np.ndarray, pitches: np.ndarray) -> np.ndarray:
    """Average the boresights over ranges (2,) of yaw and pitch, rad.

    Returns the mean (3,) in mount axes, whose length is less than one. Of a range of yaw of a turn or more
    only its last turn counts.
    """
    low = yaws[0] if yaws[1] - yaws[0] < TURN else yaws[1] - TURN
    yaw, pitch = np.meshgrid(np.linspace(low, yaws[1], 73), np.linspace(pitches[0], pitches[1], 19))
    mean: np.ndarray = np.mean(pointing(yaw, pitch), axis=(0, 1))
    return mean


def _foot_places(side: np.ndarray) -> list[np.ndarray]:
    """Return points (3,) of the surface where a device may stand: in the direction `side`, then beside it."""
    foot = side / np.max(np.abs(side))
    across = [axis for axis in np.eye(3) if abs(axis @ foot) < 1]
    beside = []
    for shares in product((0, 1, -1), repeat=len(across)):
        moved = foot + _SIDE_STEP * sum(
            (share * axis for share, axis in zip(shares, across, strict=True)), 0 * foot
        )
        beside.append(np.clip(moved, -1, 1))
    return beside


def hubs(wheels: Sequence[Wheel]) -> list[np.ndarray]:
    """Choose the middle (3,) of each wheel."""
    found: list[np.ndarray] = []
    for wheel in wheels:
        axis = np.asarray(wheel.axis, float)
        away = [
            side * _HUB_STEP * _RING_RADIUS * way for way in _perpendicular_pair(axis) for side in (1, -1)
        ]
        places = [_HUB_DISTANCE * axis, -_HUB_DISTANCE * axis]
        places += [side * _HUB_DISTANCE * axis + aside for side in (1, -1) for aside in away]
        free = [
            one
            for one in places
            if all(np.linalg.norm(one - hub) > _MIN_HUB_DISTANCE * _RING_RADIUS for hub in found)
        ]
        found.append((free or places)[0])
    return found


def ring(wheel: Wheel, hub: np.ndarray) -> np.ndarray:
    """Return points (k, 3) of a wheel's ring, a circle across its axis about `hub`; the last is the first."""
    turn = np.linspace(0, 2 * np.pi, 37)[:, None]
    first, second = _perpendicular_pair(np.asarray(wheel.axis, float))
    return np.asarray(hub + _RING_RADIUS * (np.cos(turn) * first + np.sin(turn) * second))


def name_places(wheel: Wheel, hub: np.ndarray) -> list[np.ndarray]:
    """Return points (3,) where a wheel's name may stand: best beyond its arrow, then about its ring."""
    axis = np.asarray(wheel.axis, float)
    around = [side * way for way in _perpendicular_pair(axis) for side in (1, -1)]
    ends = [1.4 * SPIN * axis, -1.3 * _RING_RADIUS * axis]
    return [hub + end for end in (*ends, *(1.6 * _RING_RADIUS * way for way in around))]


def label(wheels: Sequence[Wheel]) -> str:
    """Return the legend text of wheels: how many there are, and their limits if all have the same."""
    count = "reaction wheel" if len(wheels) == 1 else f"{len(wheels)} reaction wheels"
    told = f"{count},\narrow along the axis"
    if len({(wheel.torque, wheel.momentum) for wheel in wheels}) != 1:
        return told
    each = "each " * (len(wheels) > 1)
    return f"{told};\n{each}{wheels[0].torque:.4g} N m, {wheels[0].momentum:.4g} N m s"


def _perpendicular_pair(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors (3,) at right angles to a unit vector `axis` (3,) and to each other."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)


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
