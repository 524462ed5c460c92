"""Sun, Moon and Earth: where they are, and how large.

The Earth's way round the Sun is pyerfa's ``epv00`` (1900 to 2100, 1e-7 of the distance), the Moon's
``moon98`` (Meeus, 10 arc seconds). Radii are IAU's: nominal of the Sun (2015 B3), mean of the Moon (2015),
equatorial of the Earth, so that the flattened Earth lies within the sphere.
"""

import numpy as np

from jaxplan.orbits import EARTH_RADIUS
from jaxplan.sky.instants import library, terrestrial

BODIES = ("sun", "moon", "earth")
RADII = {"sun": 695_700.0, "moon": 1737.4, "earth": EARTH_RADIUS}  # km


def body_state(body: str, epoch: np.datetime64, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of a body.

    Args:
        body: one of `BODIES`.
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3) km from the Earth's centre and (..., 3) km/s, GCRS.
    """
    if body == "earth":
        return np.zeros((*times.shape, 3)), np.zeros((*times.shape, 3))
    erfa = library("erfa")
    instant = terrestrial(epoch, times)
    if body == "sun":
        heliocentric, _ = erfa.epv00(*instant)
        sign, pv = -1.0, heliocentric
    else:
        sign, pv = 1.0, erfa.moon98(*instant)
    unit = sign * erfa.DAU * 1e-3  # km
    return unit * pv["p"], unit / erfa.DAYSEC * pv["v"]
