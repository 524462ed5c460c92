"""Where devices stand on the platform in pictures: a spacecraft knows how they are mounted, but not where.

The platform is drawn as a cube with half edges of 1. Each device has a *side*, a direction from the middle of
the cube in body axes, and stands where this direction meets the surface: at its *foot*. The side of a
terminal or a drive is the mean of all directions that its boresight can reach, that of an instrument its
boresight. Where this mean is too short to tell a direction, the side of a terminal is its boresight at zero
angles, and that of a drive its axis, or the opposite of the axis where another device stands already.
"""

from itertools import product

import numpy as np

from jaxplan.geometry.vectors import pointing
from jaxplan.model.gimbals import TURN
from jaxplan.model.spacecraft import Spacecraft

_MIN_MEAN_LENGTH = 0.2  # of all directions that a device reaches; a shorter mean tells no side
_MIN_FOOT_DISTANCE = 0.6  # half edges between the feet of two devices at least, where there is room
_SIDE_STEP = 0.65  # half edges from a foot to the places beside it that are tried


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
