"""Shorter plans along the paths of other searches, and for as long as is asked."""

import re
from dataclasses import replace

import numpy as np
import pytest
from dense import assert_kept

import jaxplan as jp
from jaxplan import so3

SHORT = 40.3  # s; the first search passes the cones on the side that takes 47.8


@pytest.fixture(scope="module")
def scene():
    """A camera that slews far among six cones."""
    rng = np.random.default_rng([77, 0])

    def drawn():
        axis = rng.normal(size=3)
        return axis / np.linalg.norm(axis)

    boresight = np.array([1.0, 0.0, 0.0])
    while True:
        start = so3.exp(rng.uniform(0, np.pi) * drawn())
        goal = start @ so3.exp(rng.uniform(1.5, np.pi - 1e-3) * drawn())
        cones = [(drawn(), np.deg2rad(rng.uniform(10, 35))) for _ in range(6)]
        ends = [attitude @ boresight for attitude in (start, goal)]
        if all(np.arccos(np.clip(end @ axis, -1, 1)) > half + 0.03 for end in ends for axis, half in cones):
            break
    craft = jp.Spacecraft(
        terminals=(),
        instruments=(jp.Instrument(name="camera", boresight=boresight),),
        rate_limit=np.deg2rad(3.0),
        acceleration_limit=np.deg2rad(1.0),
    )
    return jp.Scenario(
        name="among cones",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=so3.log(start), joints=np.zeros(0)),
        goal=jp.GivenState(rotation_vector=so3.log(goal), joints=np.zeros(0)),
        keep_out=tuple(
            jp.KeepOut(name=f"cone {number}", direction=axis, half_angle=half)
            for number, (axis, half) in enumerate(cones)
        ),
        trajectory=jp.TrajectorySettings(duration="minimum"),
    )


def with_guesses(scene, count):
    return replace(scene, trajectory=replace(scene.trajectory, first_guesses=count))


def test_the_quicker_side_of_cones_is_found_and_certified(scene):
    plan = jp.plan(scene)
    assert plan.ok
    assert plan.certificate.certified
    assert plan.trajectory.duration < SHORT
    assert_kept(plan.trajectory, scene.spacecraft, scene.keep_out)
    alone = jp.plan(with_guesses(scene, 0))
    assert alone.trajectory.duration > SHORT + 5


def test_the_path_of_a_shorter_plan_is_the_one_that_it_follows(scene):
    plan = jp.plan(scene)
    samples = plan.trajectory.sample(plan.trajectory.node_times)
    offs = so3.distance(samples.attitude, plan.path.attitudes)
    assert np.max(offs) < 0.6  # rad; the other way round is farther off


def test_improving_never_ends_with_a_longer_plan_and_stops_in_time(scene):
    first = jp.plan(with_guesses(scene, 0))
    improved = jp.plan(with_guesses(scene, 0), improve_for_s=2.0)
    assert improved.certificate.certified
    assert improved.trajectory.duration < first.trajectory.duration


def test_a_batch_finds_the_same_plan(scene):
    (together,) = jp.plan_batch([scene])
    assert together.trajectory.duration == pytest.approx(jp.plan(scene).trajectory.duration, rel=1e-6)


@pytest.mark.parametrize("seconds", [-1.0, np.nan, np.inf, "long", None])
def test_a_time_to_improve_that_makes_no_sense_is_refused_by_name(scene, seconds):
    with pytest.raises(ValueError, match="improve_for_s"):
        jp.plan(scene, improve_for_s=seconds)


@pytest.mark.parametrize("duration", ["stretched", 80.0])
def test_only_the_shortest_duration_is_improved(scene, duration):
    given = replace(scene, trajectory=replace(scene.trajectory, duration=duration))
    needed = re.escape('improve_for_s = 3: needs trajectory.duration_s = "minimum", and that of ')
    with pytest.raises(ValueError, match=f"{needed}.* is {duration}"):
        jp.plan(given, improve_for_s=3)
