"""Measures of a plan are those of its trajectory, spacecraft and zones; what is neither is refused."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_plan
from wheels import random_wheels

import jaxplan as jp
from jaxplan.trajectory import measures

INERTIA = np.diag([120.0, 90.0, 60.0])


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    made = make_plan(duration=30.0)
    craft = replace(made.scenario.spacecraft, inertia=INERTIA, wheels=random_wheels(3, 4))
    return replace(made, scenario=replace(made.scenario, spacecraft=craft))


def test_a_plan_stands_for_its_trajectory_spacecraft_and_zones(plan):
    own, craft, cones = plan.trajectory, plan.scenario.spacecraft, plan.scenario.constraints
    for of_plan, of_parts in (
        (measures.effort(plan), measures.effort(own)),
        (measures.roughness(plan), measures.roughness(own)),
        (measures.duration(plan), measures.duration(own)),
        (measures.peak(plan, "joint_rates"), measures.peak(own, "joint_rates")),
        (measures.power_mean(plan, field="joint_rates"), measures.power_mean(own, "joint_rates")),
        (measures.peak_torque(plan), measures.peak_torque(own, craft)),
        (measures.peak_torque(plan, craft), measures.peak_torque(own, craft)),
        (measures.least_margin(plan), measures.least_margin(own, craft, cones)),
        (measures.stretch(plan), measures.stretch(own, craft)),
        (measures.to_limits(plan).duration, measures.to_limits(own, craft).duration),
        (
            measures.torque_spectrum(plan, frequencies=[0.1, 1.0]),
            measures.torque_spectrum(own, craft, [0.1, 1.0]),
        ),
        (measures.wheel_torques(plan, t=[1.0, 2.0]), measures.wheel_torques(own, craft, [1.0, 2.0])),
        (measures.wheel_momenta(plan, t=3.0), measures.wheel_momenta(own, craft, 3.0)),
        (
            measures.integral(plan, lambda samples: samples.joints[:, 0]),
            measures.integral(own, lambda samples: samples.joints[:, 0]),
        ),
        (
            measures.largest(plan, lambda samples: samples.joints[..., 0]),
            measures.largest(own, lambda samples: samples.joints[..., 0]),
        ),
    ):
        np.testing.assert_array_equal(of_plan, of_parts)
    assert float(measures.effort(plan)) > 0


def test_what_has_no_motion_is_refused_by_name(plan):
    failed = replace(plan, trajectory=None)
    own, craft = plan.trajectory, plan.scenario.spacecraft
    for call, error, words in (
        (lambda: measures.effort(failed), ValueError, "trajectory: the plan has none, it ended as"),
        (
            lambda: measures.effort(plan.scenario),
            TypeError,
            "trajectory must be a Trajectory, not Scenario; a plan",
        ),
        (lambda: measures.effort(3.0), TypeError, "trajectory must be a Trajectory, not float"),
        (lambda: measures.effort(None), TypeError, "trajectory must be a Trajectory, not NoneType"),
        (lambda: measures.peak_torque(None), TypeError, "trajectory must be a Trajectory, not NoneType"),
        (lambda: measures.peak_torque(own), TypeError, "craft"),
        (
            lambda: measures.peak_torque(own, plan.scenario),
            TypeError,
            "craft must be a Spacecraft, not Scenario",
        ),
        (lambda: measures.torque_spectrum(plan, [0.1]), TypeError, "told by its name"),
        (lambda: measures.least_margin(own, craft, [1]), TypeError, "cones must be a Constraints, not list"),
        (lambda: measures.peak(plan), TypeError, "field"),
    ):
        with pytest.raises(error, match=words):
            call()


@pytest.mark.parametrize("measure", [measures.torque, measures.time_factors])
def test_measures_of_samples_say_what_makes_them(plan, measure):
    own, craft = plan.trajectory, replace(plan.scenario.spacecraft, wheels=())
    for wrong in (own, plan, None):
        with pytest.raises(TypeError, match=r"samples must be .*; plan.trajectory.sample\(t\) returns them"):
            measure(wrong, craft)
    with pytest.raises(TypeError, match="craft must be a Spacecraft, not Plan"):
        measure(own.sample([0.0, 1.0]), plan)
    assert len(measure(own.sample([0.0, 1.0]), craft)) == 2


def test_a_torque_without_an_inertia_is_refused(plan):
    bare = replace(plan.scenario.spacecraft, inertia=None, torque_limit=None, wheels=())
    for call in (
        lambda: measures.torque(plan.trajectory.sample([0.0]), bare),
        lambda: measures.peak_torque(plan, bare),
    ):
        with pytest.raises(ValueError, match=r"needs spacecraft\.inertia_kg_m2, which is not set"):
            call()
