"""Plans of spacecraft whose limits differ by body axis, or are of lengths of vectors."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario
from dense import assert_kept

import jaxplan as jp
from jaxplan.planner.steps import largest_slew
from jaxplan.planner.validity import start_breaches
from jaxplan.schema import dump_scenario, parse_scenario

deg = np.deg2rad


FILE = """
schema_version = 1
name = "own limits"
[spacecraft]
rate_limit_deg_s = [1.5, 1.5, 0.8]
rate_norm_limit_deg_s = 1.6
acceleration_limit_deg_s2 = 0.3
acceleration_norm_limit_deg_s2 = 0.35
[start]
attitude = [0.1, -0.2, 0.3]
[goal]
attitude = [-0.5, 0.9, 0.4]
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "duration"),
    [
        ("global", "stretched"),
        ("global", "minimum"),
        ("global", 75.0),
        ("paper", "stretched"),
        ("paper", 130.0),
    ],
)
def test_a_file_with_limits_of_axes_and_lengths_is_planned_within_them(method, duration):
    scenario = parse_scenario(FILE)
    assert parse_scenario(dump_scenario(scenario)).spacecraft.rate_norm_limit == deg(1.6)
    assert "rate_limit_deg_s = [1.5, 1.5, 0.8]" in dump_scenario(scenario)
    settings = replace(scenario.trajectory, method=method, duration=duration)
    plan = jp.plan(replace(scenario, trajectory=settings))
    craft, peaks = plan.scenario.spacecraft, plan.certificate.peaks
    assert_kept(plan.trajectory, craft)
    assert {"angular_velocity_norm", "angular_acceleration_norm"} <= peaks.keys()
    if isinstance(duration, str):
        assert max(peaks.values()) == pytest.approx(1, abs=3e-6)
    assert plan.trajectory.duration > plan.duration_bound


def test_a_time_too_short_for_a_length_says_so():
    scenario = parse_scenario(FILE.replace("0.35", "1e-3"))
    plan = jp.plan(replace(scenario, trajectory=replace(scenario.trajectory, duration=60.0)), throw=False)
    assert plan.status is jp.Status.LIMITS_TOO_TIGHT
    assert "platform acceleration length" in plan.message


def test_the_largest_slew_is_that_of_the_box_or_of_the_length():
    scenario = make_scenario(0, 1)
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration=2.0))

    def slew(**limits):
        return largest_slew(replace(scenario, spacecraft=replace(scenario.spacecraft, **limits)))

    assert slew(rate_limit=0.1) == pytest.approx(0.2 * np.sqrt(3), rel=1e-15)
    assert slew(rate_limit=np.array([0.2, 0.3, 0.6])) == pytest.approx(1.4, rel=1e-15)
    assert slew(rate_limit=np.array([0.2, 0.3, 0.6]), rate_norm_limit=0.5) == pytest.approx(1.0, rel=1e-15)
    assert slew(rate_norm_limit=99.0) == slew()


def test_a_start_that_turns_too_fast_about_an_axis_or_in_all_is_told():
    scenario = make_scenario(0, 1)
    craft = replace(scenario.spacecraft, rate_limit=deg([2.0, 3.0, 1.0]), rate_norm_limit=deg(3.2))

    def told(*rate):
        start = replace(scenario.start, angular_velocity=deg(rate))
        return start_breaches(replace(scenario, spacecraft=craft, start=start))

    assert told(1.9, -2.0, 0.9) == ()
    assert told(1.9, 2.0, -1.1) == ("the platform's rate about z is 1.1 deg/s, its limit 1 deg/s",)
    (length,) = told(-1.9, 2.9, 0.0)
    assert length == "the length of the platform's rate is 3.467 deg/s, its limit 3.2 deg/s"


def test_a_start_that_turns_with_more_momentum_than_wheels_may_hold_is_told():
    """About each body axis, with the reserve, and with what joints carry that turn then."""
    scenario = make_scenario(1)
    start = replace(scenario.start, angular_velocity=np.array([0.02, 0.0, -0.03]))
    moments = np.array([20.0, 25.0, 30.0])
    craft = replace(scenario.spacecraft, rate_limit=0.1, inertia=moments, wheel_momentum_limit=1.0)

    def told(craft, **changes):
        return start_breaches(replace(scenario, **{"spacecraft": craft, "start": start} | changes))

    assert told(craft) == ()
    (phrase,) = told(replace(craft, wheel_momentum_limit=np.array([0.5, 0.5, 0.8])))
    most = "wheel_momentum_limit_nms = 0.8 N m s at most"
    assert phrase == f"at its rates the wheels hold -0.9 N m s about body z at the start, of {most}"
    kept = jp.Robust(momentum_reserve=15.0)
    plan = jp.plan(replace(scenario, spacecraft=craft, start=start, robust=kept), throw=False, progress=False)
    assert plan.status is jp.Status.INVALID_START
    for words in (
        "-0.9 N m s about body z at the start, of wheel_momentum_limit_nms = 0.85 N m s at most, which",
        "[robust] momentum_reserve_percent = 15 leaves of 1 N m s; without it that is enough",
    ):
        assert words in plan.message, plan.message
    (phrase,) = told(replace(craft, wheel_momentum_limit=0.8), robust=kept)
    assert phrase.endswith(
        "= 0.68 N m s at most, which [robust] momentum_reserve_percent = 15 leaves of 0.8 N m s"
    )
    (terminal,) = craft.terminals
    rates = np.array([0.05, 0.0])  # about z
    stage = replace(craft, terminals=(replace(terminal, yaw_inertia=np.array([1.0, 1.0, 1.5])),))
    turning = replace(start, joint_rates=rates)
    assert told(stage, start=turning) == ()  # -0.9 + 1.5 * 0.05
    (phrase,) = told(replace(stage, wheel_momentum_limit=0.82), start=turning)
    assert "-0.825 N m s about body z" in phrase
