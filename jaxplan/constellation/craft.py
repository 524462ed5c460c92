"""The spacecraft of a shell where the caller names none: a platform with three laser terminals.

Where a satellite looks is said in its local frame: x ahead, in the direction of flight, y to the left, z up.
An attitude that has the body's axes there is the nominal one.
"""

import math

import numpy as np

from jaxplan.model.spacecraft import Spacecraft, Terminal


def relay_spacecraft() -> Spacecraft:
    """A platform with a terminal to the front, one to the back, and one to its left side for cross links.

    Each turns by 80 deg to either side and by 30 deg up and down, at up to 6 deg/s and 4 deg/s^2. The
    platform turns at up to 1 deg/s and 0.5 deg/s^2.
    """
    terminals = (("fore", 0.0), ("aft", 180.0), ("cross", 90.0))
    return Spacecraft(
        terminals=tuple(
            Terminal(
                name=name,
                mount=math.radians(mount),
                yaw_limit=math.radians(80.0),
                pitch_limit=math.radians(30.0),
                rate_limit=math.radians(6.0),
                acceleration_limit=math.radians(4.0),
            )
            for name, mount in terminals
        ),
        rate_limit=math.radians(1.0),
        acceleration_limit=math.radians(0.5),
    )


def nominal_attitudes(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Attitudes with the body's x axis ahead and its z axis up.

    Args:
        positions: (N, 3) inertial.
        velocities: (N, 3) of circular orbits.

    Returns:
        (N, 3, 3) body to inertial.
    """
    up = positions / np.linalg.norm(positions, axis=-1, keepdims=True)
    ahead = velocities / np.linalg.norm(velocities, axis=-1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up], axis=-1)
