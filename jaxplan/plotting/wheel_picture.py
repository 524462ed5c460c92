"""Reaction wheels in the picture of a spacecraft: their places, rings, names and legend text.

A spacecraft says about which axes its wheels spin, but not where they are. They are drawn inside the
platform, each off its middle along the wheel's axis, or beside that place if another wheel is there already.
The middle of a wheel is its *hub*. Lengths are in units of the picture, whose platform is a cube with half
edges of 0.55; points are in body axes.
"""

from collections.abc import Sequence

import numpy as np

from jaxplan.model.wheels import Wheel

COLOUR = "0.25"  # of wheels; no device has this grey
FILL = (COLOUR, 0.30)  # colour and opacity of what a ring encloses
SPIN = 0.19  # length of the arrow along a wheel's axis
_HUB_DISTANCE, _RING_RADIUS = 0.36, 0.13  # a hub is so far from the middle of the platform
_SIDE_STEP, _MIN_HUB_DISTANCE = 2.4, 1.5  # radii: from a place to those beside it; least distance of two hubs


def hubs(wheels: Sequence[Wheel]) -> list[np.ndarray]:
    """Choose the middle (3,) of each wheel."""
    found: list[np.ndarray] = []
    for wheel in wheels:
        axis = np.asarray(wheel.axis, float)
        away = [
            side * _SIDE_STEP * _RING_RADIUS * way for way in _perpendicular_pair(axis) for side in (1, -1)
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
