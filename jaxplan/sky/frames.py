"""From TEME, the frame that SGP4 computes in, to the axes of the GCRS.

TEME has its z axis along the Earth's true axis of date (Celestial Ephemeris Pole), and its x axis in the true
equator where sidereal time is the mean one of 1982: it differs from the true equator and equinox of date by
a turn about z, the equation of the equinoxes. That it goes with GMST of 1982 is how its authors define it
(Vallado and others, AIAA 2006-6753, appendix C):

    r_Earth = R3(GMST82) r_TEME = R3(GAST) r_true,     r_true = N P B r_GCRS,

so that r_GCRS = (N P B)^T R3(GMST82 - GAST) r_TEME. N P B is IAU 2006/2000A's. The turn is the difference of
two sidereal times of one instant, in which UT1 - UTC does not matter.
"""

import numpy as np

from jaxplan.sky.instants import library, terrestrial, universal


def teme_to_gcrs(epoch: np.datetime64, times: np.ndarray) -> np.ndarray:
    """Rotation that takes TEME of each instant to the axes of the GCRS.

    It turns by some 8e-12 rad/s (precession), which a velocity in orbit does not feel.

    Args:
        epoch: UTC.
        times: (...) s after it.

    Returns:
        (..., 3, 3).
    """
    erfa = library("erfa")
    tt, ut = terrestrial(epoch, times), universal(epoch, times)
    true_of_date = erfa.pnm06a(*tt)  # from the GCRS
    turn = erfa.gmst82(*ut) - erfa.gst06(*ut, *tt, true_of_date)
    c, s, o = np.cos(turn), np.sin(turn), np.zeros(np.shape(turn))
    about_z = np.stack([c, s, o, -s, c, o, o, o, o + 1], axis=-1).reshape(*np.shape(turn), 3, 3)
    rotation: np.ndarray = np.swapaxes(true_of_date, -1, -2) @ about_z
    return rotation
