"""Reaction wheels in the picture of a spacecraft: where they stand, their rings, and what is said of them.

A spacecraft says about which axes its wheels spin, but not where they are. They are drawn in the platform,
each off its middle along the wheel's axis, or beside that where another one stands already. Lengths are those
of the picture, whose platform is a cube with half edges of 0.55.
"""

from collections.abc import Sequence

import numpy as np

from jaxplan.model.wheels import Wheel

COLOUR = "0.25"  # of wheels; no device is grey
FILL = (COLOUR, 0.30)  # colour and opacity of what a ring encloses
SPIN = 0.19  # length of the arrow along the axis
_OFF, _RADIUS = 0.36, 0.13  # of the middle of a wheel from that of the platform, and of its ring
_BESIDE, _APART = 2.4, 1.5  # radii from a place to those beside it, and between two wheels at least


def hubs(wheels: Sequence[Wheel]) -> list[np.ndarray]:
    """Middles (3,) of wheels."""
    found: list[np.ndarray] = []
    for wheel in wheels:
        axis = np.asarray(wheel.axis, float)
        away = [side * _BESIDE * _RADIUS * way for way in _across(axis) for side in (1, -1)]
        places = [_OFF * axis, -_OFF * axis]
        places += [side * _OFF * axis + aside for side in (1, -1) for aside in away]
        free = [one for one in places if all(np.linalg.norm(one - hub) > _APART * _RADIUS for hub in found)]
        found.append((free or places)[0])
    return found


def ring(wheel: Wheel, hub: np.ndarray) -> np.ndarray:
    """Points (k, 3) of a wheel's ring across its axis, the last of which is the first."""
    turn = np.linspace(0, 2 * np.pi, 37)[:, None]
    first, second = _across(np.asarray(wheel.axis, float))
    return np.asarray(hub + _RADIUS * (np.cos(turn) * first + np.sin(turn) * second))


def name_places(wheel: Wheel, hub: np.ndarray) -> list[np.ndarray]:
    """Points (3,) at which a wheel's name may stand, the best first: beyond its arrow, and about its ring."""
    axis = np.asarray(wheel.axis, float)
    around = [side * way for way in _across(axis) for side in (1, -1)]
    ends = [1.4 * SPIN * axis, -1.3 * _RADIUS * axis]
    return [hub + end for end in (*ends, *(1.6 * _RADIUS * way for way in around))]


def label(wheels: Sequence[Wheel]) -> str:
    """Legend text of wheels: how many they are, with their limits where these are alike."""
    count = "reaction wheel" if len(wheels) == 1 else f"{len(wheels)} reaction wheels"
    told = f"{count},\narrow along the axis"
    if len({(wheel.torque, wheel.momentum) for wheel in wheels}) != 1:
        return told
    each = "each " * (len(wheels) > 1)
    return f"{told};\n{each}{wheels[0].torque:.4g} N m, {wheels[0].momentum:.4g} N m s"


def _across(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (3,) at right angles to an axis (3,) and to each other."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)
