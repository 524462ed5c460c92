"""Attitudes from which a track may lead where those nearest to the state before lead to nothing."""

from dataclasses import replace

import numpy as np
import pytest
from reference import state_margins
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.timeline.motions import Doing
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.timeline.tracking import State, roomiest

END = 120.0
ROOM = (150.0, 250.0)  # deg, rolls at which the tracker sees neither light at any time


def passing(first, last):
    """A path in the plane of x and y from one azimuth, deg, to another until `END`."""
    angles = np.deg2rad(first + (last - first) * np.linspace(0.0, 1.0, 97))
    samples = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    return jp.DirectionPath.through(np.linspace(0.0, END, 97), samples)


@pytest.fixture(scope="module")
def scene():
    """A camera looks along z; a tracker along x has a gap between two lights near it, which closes."""
    craft = jp.Spacecraft(
        terminals=(),
        rate_limit=np.deg2rad(1.0),
        acceleration_limit=np.deg2rad(0.2),
        instruments=(
            jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),
            jp.Instrument(name="tracker", boresight=np.array([1.0, 0.0, 0.0])),
        ),
    )
    ahead = np.array([np.cos(np.deg2rad(20)), -np.sin(np.deg2rad(20)), 0.0])
    zones = (
        jp.KeepOut(name="still", direction=ahead, half_angle=np.deg2rad(90), devices=("tracker",)),
        jp.KeepOut(
            name="passing", direction=passing(120, 60), half_angle=np.deg2rad(30), devices=("tracker",)
        ),
    )
    start = jp.GivenState(rotation_vector=np.deg2rad([0.0, 0.0, 80.0]), joints=np.zeros(0))
    return jp.Scenario(name="gap", spacecraft=craft, start=start, goal=start, keep_out=zones)


TARGETS = jp.Targets(devices=("camera",), directions=np.array([[0.0, 0.0, 1.0]]))


def test_they_keep_room_all_along(scene):
    pursuit = Pursuit.of(scene.usable, scene.constraints, TARGETS)
    found = roomiest(pursuit, np.zeros(0), 0.0, END, count=4, seed=1)
    assert len(found) == 4
    times = np.linspace(0.0, END, 121)
    for attitude in found:
        np.testing.assert_allclose(attitude[0] @ [0, 0, 1], [0, 0, 1], atol=1e-9)
        held = np.broadcast_to(attitude[0], (len(times), 3, 3))
        margins = state_margins(scene, held, np.zeros((len(times), 0)), times)
        assert min(float(np.min(margin)) for margin in margins.values()) > 0
        roll = np.rad2deg(np.arctan2(attitude[0, 1, 0], attitude[0, 0, 0])) % 360
        assert ROOM[0] < roll < ROOM[1]
    again = roomiest(pursuit, np.zeros(0), 0.0, END, count=4, seed=1)
    np.testing.assert_array_equal(found, again)


def test_there_are_none_where_targets_leave_one_attitude(scene):
    both = jp.Targets(devices=("camera", "tracker"), directions=np.eye(3)[[2, 0]])
    pursuit = Pursuit.of(scene.usable, scene.constraints, both)
    assert roomiest(pursuit, np.zeros(0), 0.0, END, count=4, seed=1) == []


def test_a_track_goes_there_where_nothing_nearer_lasts(scene, monkeypatch):
    asked = []

    def nearest_alone(self, targets, goals, begin):
        """As if step 1 found the gap at the start alone, as it may where there are many goals."""
        for number, guesses in enumerate(guessed(self, targets, goals[:1], begin)):
            asked.append(number)
            yield guesses if number != 1 else []

    guessed = Doing._guesses
    monkeypatch.setattr(Doing, "_guesses", nearest_alone)
    watch = jp.Activity(name="watch", track=TARGETS, duration=END, earliest=0.0)
    doing = Doing(
        scene=scene, activity=watch, before=State.still(scene.start.attitude, np.zeros(0)), time=0.0
    )
    motion = doing.motion(0.0)
    assert asked == [0, 1, 2]
    roll = np.rad2deg(np.arctan2(*motion.state.attitude[[1, 0], [0, 0]])) % 360
    assert ROOM[0] < roll < ROOM[1]


def test_a_motion_that_was_found_before_does_not_bind_the_next(scene):
    watch = jp.Activity(name="watch", track=TARGETS, duration=END / 2)
    before = State.still(scene.start.attitude, np.zeros(0))
    doing = Doing(scene=scene, activity=watch, before=before, time=0.0)
    found = doing.motion(0.0)
    inside = Rotation.from_rotvec([0.0, 0.0, np.deg2rad(-19.0)]).as_matrix()  # the light that stands still
    lost = replace(found.tracked.nodes, attitudes=np.tile(inside, (13, 1, 1)))
    doing.last = replace(found, tracked=replace(found.tracked, nodes=lost))
    later = doing.motion(END / 2)
    assert later.begin == END / 2
    assert np.max(later.tracked.broken) == 0
