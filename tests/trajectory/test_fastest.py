"""Shortest motions of a platform alone, which no turn about one axis reaches."""

import numpy as np
import pytest
from reference import assert_each

import jaxplan as jp
from jaxplan import so3
from jaxplan.model.path import Path
from jaxplan.model.status import Status
from jaxplan.trajectory import FitQuery, fit_batch

HALF = np.pi * (1 - 1e-9)  # of a turn: one way round is the short one
OPTIMA = {180: 3.2431, 90: 2.4211}  # s: Bilimoria and Wie, JGCD 16(3), 1993; and switch times for 90 deg
CAMERA = (jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),)


def sphere():
    """A unit inertia with a unit torque about each axis."""
    return jp.Spacecraft(
        terminals=(),
        instruments=CAMERA,
        rate_limit=10.0,
        acceleration_limit=1e3,
        torque_limit=1.0,
        inertia=np.eye(3),
    )


def agile(rate=3.0, acceleration=2.0):
    limits = {"rate_limit": np.deg2rad(rate), "acceleration_limit": np.deg2rad(acceleration)}
    return jp.Spacecraft(terminals=(), instruments=CAMERA, **limits)


def shortest(slews, ends, **settings):
    """Fits of slews (spacecraft, rotation vector), all together."""
    asked = jp.TrajectorySettings(duration="minimum", end_acceleration=ends, **settings)
    paths = [
        Path(
            attitudes=np.stack([np.eye(3), so3.exp(np.asarray(turn, float))]),
            joints=np.zeros((2, 0)),
            edge_costs=np.ones(1),
        )
        for _, turn in slews
    ]
    queries = [
        FitQuery(path=path, spacecraft=craft, settings=asked)
        for path, (craft, _) in zip(paths, slews, strict=True)
    ]
    fits = fit_batch(queries)
    assert all(own.status is Status.OK for own in fits), [own.message for own in fits]
    return np.array([own.trajectory.duration for own in fits])


def drawn(count):
    """Slews within rates and accelerations, every third about an axis of the body."""
    rng, slews = np.random.default_rng(28), []
    for number in range(count):
        axis = np.eye(3)[number % 3] if number % 3 == 0 else rng.normal(size=3)
        slews.append((agile(), rng.uniform(0.5, 3.1) * axis / np.linalg.norm(axis)))
    return slews


@pytest.mark.parametrize(("ends", "above"), [("zero", 1.01), ("free", 1.005)])
def test_published_optima_are_nearly_reached_and_never_undercut(ends, above):
    slews = [(sphere(), min(np.deg2rad(angle), HALF) * np.eye(3)[2]) for angle in OPTIMA]
    ratios = shortest(slews, ends) / np.array(list(OPTIMA.values()))
    assert_each(ratios, "<=", above)
    assert_each(ratios, ">=", 1 - 2e-5)  # the optima are printed with four digits


def test_half_a_turn_about_a_body_axis_leaves_that_axis_where_rates_bind():
    (duration,) = shortest([(agile(), HALF * np.eye(3)[0])], "zero")
    assert duration <= 48.4  # s; the turn about the axis takes 61.5 at least


def test_free_accelerations_at_the_ends_never_take_longer_than_zero_ones():
    slews = drawn(9)
    assert_each(shortest(slews, "free"), "<=", shortest(slews, "zero") * (1 + 1e-9))


def test_more_first_guesses_take_next_to_no_longer_than_the_path_alone_and_often_much_less():
    slews = drawn(9)
    alone, bent = (shortest(slews, "zero", first_guesses=count) for count in (0, 4))
    assert_each(bent, "<=", 1.005 * alone)  # on other breaks
    assert np.min(bent / alone) < 0.95


def test_a_shortest_motion_is_the_same_in_every_call():
    slews = drawn(3)
    np.testing.assert_array_equal(shortest(slews, "zero"), shortest(slews, "zero"))
