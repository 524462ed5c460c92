"""Frames by plain numpy from the formulas of handbooks, for the tests of the sky.

Precession is IAU 1976 (Lieske), nutation the four largest terms (Meeus, chapter 22:
good to 0.5 arc seconds in longitude, of which the equation of the equinoxes takes most back).
"""

import numpy as np

ARCSEC = np.pi / 180 / 3600
TEME_ACCURACY = 0.3 * ARCSEC  # of all that is left out


def centuries(utc: str) -> float:
    """Julian centuries of terrestrial time from J2000 on, TAI - UTC taken as 35 s."""
    since = np.datetime64(utc, "ns") - np.datetime64("2000-01-01T12:00:00", "ns")
    return (float(since / np.timedelta64(1, "ns")) * 1e-9 + 67.2) / 86400 / 36525


def about(axis: int, angle: float) -> np.ndarray:
    """R1, R2, R3 of the handbooks: coordinates in axes that are turned by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis - 1]
    turned = np.eye(3)
    turned[i, i] = turned[j, j] = c
    turned[i, j], turned[j, i] = s, -s
    return turned


def precession(t: float) -> np.ndarray:
    """From J2000 to the mean equator and equinox of date."""
    zeta = (2306.2181 + (0.30188 + 0.017998 * t) * t) * t * ARCSEC
    z = (2306.2181 + (1.09468 + 0.018203 * t) * t) * t * ARCSEC
    theta = (2004.3109 - (0.42665 + 0.041833 * t) * t) * t * ARCSEC
    return about(3, -z) @ about(2, theta) @ about(3, -zeta)


def teme_to_j2000(utc: str) -> np.ndarray:
    """From the true equator and mean equinox of date to J2000."""
    t = centuries(utc)
    node, sun, moon = np.deg2rad(
        [125.04452 - 1934.136261 * t, 280.4665 + 36000.7698 * t, 218.3165 + 481267.8813 * t]
    )
    psi = -17.20 * np.sin(node) - 1.32 * np.sin(2 * sun) - 0.23 * np.sin(2 * moon) + 0.21 * np.sin(2 * node)
    eps = 9.20 * np.cos(node) + 0.57 * np.cos(2 * sun) + 0.10 * np.cos(2 * moon) - 0.09 * np.cos(2 * node)
    mean = np.deg2rad(23.4392911) - 46.8150 * t * ARCSEC
    nutation = about(1, -mean - eps * ARCSEC) @ about(3, -psi * ARCSEC) @ about(1, mean)
    true_of_date = about(3, -psi * ARCSEC * np.cos(mean))
    return (nutation @ precession(t)).T @ true_of_date


def on_the_ground(utc: str, latitude: float, longitude: float) -> np.ndarray:
    """(3,) km, J2000: a place at sea level, geodetic deg; UT1 is taken as UTC."""
    lat, lon = np.deg2rad([latitude, longitude])
    normal = 6378.137 / np.sqrt(1 - 0.00669437999 * np.sin(lat) ** 2)
    fixed = normal * np.array(
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), 0.99330562 * np.sin(lat)]
    )
    return earth_to_j2000(utc) @ fixed


def earth_to_j2000(utc: str) -> np.ndarray:
    """From the axes that are fixed to the Earth to J2000; UT1 is taken as UTC."""
    days = float(
        (np.datetime64(utc, "ns") - np.datetime64("2000-01-01T12:00:00", "ns")) / np.timedelta64(1, "D")
    )
    t = days / 36525
    sidereal = np.deg2rad(280.46061837 + 360.98564736629 * days + 0.000387933 * t**2)  # Meeus, 12.4
    return teme_to_j2000(utc) @ about(3, -sidereal)


def almanac_sun(utc: str) -> np.ndarray:
    """(3,) unit vector, J2000: the Astronomical Almanac's formula, good to 0.01 deg, less aberration."""
    t = centuries(utc)
    n = 36525 * t
    g = np.deg2rad(357.528 + 0.9856003 * n)
    longitude = (
        np.deg2rad(280.460 + 0.9856474 * n + 1.915 * np.sin(g) + 0.020 * np.sin(2 * g)) + 20.5 * ARCSEC
    )
    oblique = np.deg2rad(23.439 - 4e-7 * n)
    x, y = np.cos(longitude), np.sin(longitude)
    return precession(t).T @ np.array([x, y * np.cos(oblique), y * np.sin(oblique)])
