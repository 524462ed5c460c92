"""Keplerian orbits against integration of the equation of motion, rotations of scipy, and circles."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from jaxplan import sky
from jaxplan.sky.orbits import eccentric_anomaly

EPOCH = "2026-06-20T09:30:00"
MU = 398600.4418
ORBITS = [
    (6900.0, 0.01, 97.5, 10.0, 90.0, 0.0),
    (26600.0, 0.74, 63.4, 250.0, 270.0, 190.0),
    (42164.0, 0.0, 0.0, 0.0, 0.0, 75.0),
    (7500.0, 0.1, 120.0, -60.0, 400.0, -170.0),
]


def orbit_of(a, e, *angles, **more):
    names = ("inclination", "node", "perigee", "anomaly")
    return sky.KeplerOrbit(
        semi_major_axis=a,
        eccentricity=e,
        **dict(zip(names, np.deg2rad(angles).tolist(), strict=True)),
        **more,
    )


def start(a, e, inclination, node, perigee, anomaly):
    """Position and velocity by the equation of the conic, and Euler's angles."""
    nu = np.deg2rad(anomaly)
    radius = a * (1 - e * e) / (1 + e * np.cos(nu))
    plane = Rotation.from_euler("ZXZ", [node, inclination, perigee], degrees=True)
    speed = np.sqrt(MU / (a * (1 - e * e)))
    return (
        plane.apply(radius * np.array([np.cos(nu), np.sin(nu), 0])),
        plane.apply(speed * np.array([-np.sin(nu), e + np.cos(nu), 0])),
    )


@pytest.mark.parametrize("elements", ORBITS)
def test_an_orbit_solves_the_equation_of_motion(elements):
    position, velocity = start(*elements)
    times = np.linspace(0, 9000, 31)
    solved = solve_ivp(
        lambda t, y: [*y[3:], *(-MU * y[:3] / np.linalg.norm(y[:3]) ** 3)],
        (0, 9000),
        [*position, *velocity],
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-9,
    )
    orbit = orbit_of(*elements)
    np.testing.assert_allclose(sky.positions(orbit, epoch=EPOCH, times=times), solved.y[:3].T, atol=1e-4)
    np.testing.assert_allclose(sky.velocities(orbit, epoch=EPOCH, times=times), solved.y[3:].T, atol=1e-7)
    np.testing.assert_allclose(sky.positions(orbit, epoch=EPOCH), position, atol=1e-8)


def test_without_eccentricity_it_is_a_circular_orbit():
    circle = sky.CircularOrbit(altitude=550.0, inclination=0.9, node=0.4, latitude=1.3)
    orbit = sky.KeplerOrbit(
        semi_major_axis=6928.137, eccentricity=0.0, inclination=0.9, node=0.4, perigee=0.5, anomaly=0.8
    )
    times = np.linspace(-1e4, 1e4, 41)
    for of in (sky.positions, sky.velocities):
        np.testing.assert_allclose(
            of(orbit, epoch=EPOCH, times=times), of(circle, epoch=EPOCH, times=times), atol=1e-8
        )


def test_keplers_equation_is_solved_for_all_eccentricities():
    rng = np.random.default_rng(5)
    mean = np.concatenate([rng.uniform(-20, 20, 3000), [0, 1e-9, -1e-6, np.pi, -np.pi, 3 * np.pi]])
    for eccentricity in (0.0, 0.01, 0.7, 0.99, 0.99999):
        found = eccentric_anomaly(mean, eccentricity)
        np.testing.assert_allclose(found - eccentricity * np.sin(found), mean, atol=1e-14, rtol=1e-15)


def test_elements_may_have_an_epoch_of_their_own():
    pytest.importorskip("erfa", reason="pyerfa is not installed")
    early = orbit_of(*ORBITS[1], epoch="2026-06-20T09:28:20")
    np.testing.assert_allclose(
        sky.positions(early, epoch=EPOCH, times=[0.0, 50.0]),
        sky.positions(orbit_of(*ORBITS[1]), epoch=EPOCH, times=[100.0, 150.0]),
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"eccentricity": 1.0}, r"eccentricity = 1.0: must lie in \[0, 1\)"),
        ({"eccentricity": 0.2}, "the perigee is 5520 km from the Earth's centre, must be beyond 6378.137"),
        ({"semi_major_axis": np.nan}, "semi_major_axis = nan: must lie in"),
        ({"inclination": 97.5}, r"inclination = 97.5: must lie in \[-pi, pi\] rad"),
        ({"perigee": np.inf}, "perigee = inf: must lie in"),
        ({"anomaly": "0"}, "anomaly = '0': must be a number"),
        ({"epoch": "soon"}, "epoch = 'soon'"),
    ],
)
def test_what_is_no_orbit_is_an_error_with_key_and_value(change, words):
    with pytest.raises(ValueError, match=words):
        sky.KeplerOrbit(**{**vars(orbit_of(*ORBITS[0])), **change})
