"""The motion of least energy as a function of its begin and the state before, beside ones planned anew."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import at_rest, make_spacecraft
from reference import direction

import jaxplan as jp
from jaxplan import so3
from jaxplan.timeline.motions import Doing
from jaxplan.timeline.track_derivative import ends_of, track_of
from jaxplan.timeline.tracking import State

STEP = 1e-4  # s or rad, to either side
PARTS = ("attitude", "velocity", "joints", "rates")


def target(rate, first, rise):
    times = np.linspace(0, 200.0, 41)
    return jp.DirectionPath.through(times, direction(first + rate * times, 0.5 + rise * times))


@pytest.fixture(scope="module")
def doing():
    """A function that tracks for a while from a begin, s, with the state before turned by a vector."""
    craft, begin = make_spacecraft(2, 1), at_rest([0.1, 0.2, 0.0], np.zeros(4))
    scene = jp.Scenario(
        name="scene",
        spacecraft=craft,
        start=begin,
        goal=begin,
        trajectory=jp.TrajectorySettings(optimal=True),
    )
    targets = jp.Targets.of({"camera-1": target(2e-3, 0.3, 1e-4)}, tolerance=1e-5)
    activity = jp.Activity(name="ship", track=targets, duration=40.0)

    def motion(begin, turn):
        before = State.still(so3.exp(np.array([0.1, 0.2, 0.0])) @ so3.exp(turn), np.zeros(4))
        own = Doing(scene=scene, activity=activity, before=before, time=0.0, known=200.0)
        return own.motion(begin)

    return scene, targets, motion


def states(motion):
    """Both ends of a motion as numbers."""
    trajectory = motion.trajectory
    ends = [State.of(trajectory, time) for time in (0.0, trajectory.duration)]
    return np.concatenate([np.ravel(getattr(end, part)) for end in ends for part in PARTS])


def test_ends_of_a_track_and_their_slopes_are_those_of_tracks_planned_anew(doing):
    scene, targets, planned = doing
    found = planned(20.0, np.zeros(3))
    track = track_of(found, scene.usable, scene.constraints, targets)

    def ends(x):
        own = replace(track, begin=20.0 + x[0], end=60.0 + x[0], attitude=track.attitude @ so3.exp(x[1:]))
        return jnp.concatenate([jnp.ravel(getattr(end, part)) for end in ends_of(own) for part in PARTS])

    with jax.enable_x64(True):
        np.testing.assert_allclose(ends(jnp.zeros(4)), states(found), atol=1e-9)
        slopes = np.asarray(jax.jacfwd(ends)(jnp.zeros(4)))
    for place, step in enumerate(STEP * np.eye(4)):
        near = [states(planned(20.0 + side * step[0], side * step[1:])) for side in (1, -1)]
        np.testing.assert_allclose(slopes[:, place], (near[0] - near[1]) / (2 * STEP), atol=1e-6)
    assert np.max(np.abs(slopes[:, 0])) > 1e-4
    assert np.max(np.abs(slopes[:, 1:])) > 0.1
