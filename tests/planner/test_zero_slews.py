"""Goals that are met at the start: plans that take no time, in studies, matrices and measures."""

from dataclasses import replace

import numpy as np
import pytest

import jaxplan as jp

CRAFT = jp.Spacecraft(
    instruments=(jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),),
    rate_limit=np.deg2rad(1.0),
    acceleration_limit=np.deg2rad(0.2),
    inertia=np.diag([100.0, 120.0, 90.0]),
    torque_limit=0.3,
)


def looking(direction, name="look", **settings):
    return jp.Scenario(
        name=name,
        spacecraft=CRAFT,
        start=jp.GivenState(rotation_vector=[0.0, 0.0, 0.0], joints=[]),
        goal=jp.Targets.of({"camera": direction}),
        trajectory=jp.TrajectorySettings(**settings),
    )


@pytest.fixture(scope="module")
def still():
    return jp.plan(looking([0.0, 0.0, 1.0]), progress=False)


def test_it_takes_no_time_whatever_the_duration_asked_for(still):
    plans = jp.plan_batch([looking([0.0, 0.0, 1.0], duration=d) for d in (30.0, "minimum")], progress=False)
    for plan in (still, *plans):
        assert plan.ok
        assert plan.certificate.certified
        assert plan.trajectory.duration == 0
        assert plan.explained is None


def test_its_peaks_and_means_are_zero(still):
    for field in ("angular_velocity", "angular_acceleration", "joint_rates"):
        assert jp.measures.peak(still, field) == 0
        assert jp.measures.power_mean(still, field) == 0
    for measure in (jp.measures.effort, jp.measures.roughness, jp.measures.peak_torque, jp.measures.stretch):
        assert measure(still) == 0


def test_it_is_a_row_of_a_study():
    study = jp.run_study([looking([1.0, 0.0, 0.0]), looking([0.0, 0.0, 1.0], "still")], progress=False)
    assert [row["status"] for row in study.table] == ["OK", "OK"]
    assert study.table[1]["duration_s"] == 0
    assert len(study.values("over_bound")) == 1


def test_two_names_of_one_direction_are_no_time_apart():
    goals = {"a": [0.0, 1.0, 0.0], "b": [0.0, 1.0, 0.0], "c": [1.0, 0.0, 0.0]}
    times = jp.slew_times(CRAFT, {name: {"camera": one} for name, one in goals.items()}, progress=False)
    assert np.all(times.status == "OK")
    np.testing.assert_array_equal(times.times[:2, :2], 0)
    assert np.all(times.times[2, :2] > 10)


def test_it_is_not_followed(still):
    with pytest.raises(
        ValueError, match=r"does not move, so nothing of it can be followed: plan far by jp\.plan"
    ):
        jp.follow(still, looking([1.0, 0.0, 0.0], "far"))


def test_a_power_mean_of_what_there_is_not_is_refused(still):
    with pytest.raises(ValueError, match="field = 'nix': must be one of angular_velocity, "):
        jp.measures.peak(still, "nix")
    for power in (3, 0, 2.0):
        with pytest.raises(ValueError, match=r"power = .*: must be an even number of at least 2"):
            jp.measures.power_mean(still, "joint_rates", power=power)
    with pytest.raises(ValueError, match=r"needs spacecraft\.inertia_kg_m2"):
        jp.measures.peak_torque(still.trajectory, replace(CRAFT, inertia=None, torque_limit=None))
