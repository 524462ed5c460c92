"""Zones that are known for a time: what takes longer is refused by their name, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
from builders import avoids, make_scenario

import jaxplan as jp
from jaxplan.model.scenario import known_until
from jaxplan.model.time_shift import later
from jaxplan.schema.reading import dump_scenario, parse_scenario

ASIDE = avoids("sun", 200.0, -60.0, 5.0)
BRIEF = replace(ASIDE, lasts=3.0)


def scene(zone=BRIEF, duration="stretched") -> jp.Scenario:
    made = make_scenario(2, 1, keep_out=(zone,), seed=3)
    return replace(made, trajectory=replace(made.trajectory, duration=duration, method="global"))


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return jp.plan(scene(ASIDE))


@pytest.mark.parametrize("duration", ["stretched", "minimum"])
def test_a_motion_that_takes_longer_than_a_zone_lasts_is_not_certified(duration):
    found = jp.plan(scene(duration=duration), throw=False)
    assert found.status is jp.Status.UNCERTIFIED
    assert (
        f"zone sun is known for 3 s, and the motion takes {found.trajectory.duration:.4g} s" in found.message
    )


def test_a_zone_that_lasts_long_enough_is_as_one_for_good(plan):
    own = jp.plan(scene(replace(ASIDE, lasts=plan.trajectory.duration * (1 + 1e-9))))
    np.testing.assert_array_equal(own.trajectory.coefficients, plan.trajectory.coefficients)
    assert own.certificate.min_margin == plan.certificate.min_margin


def test_a_plan_is_not_certified_anew_where_its_zone_does_not_last(plan):
    proof = jp.certify(replace(plan, scenario=scene()))
    assert not proof.certified
    assert any(fault.startswith("zone sun is known for 3 s") for fault in proof.faults)


def test_a_given_duration_beyond_a_zones_is_refused_by_key_and_value():
    with pytest.raises(jp.ScenarioError, match=r"keep_out\[0\]\.lasts = 3.0 s: must reach.*duration = 40"):
        jp.plan(scene(duration=40.0))


def test_a_table_that_ends_after_a_zone_is_refused(plan):
    times = np.linspace(0.0, plan.trajectory.duration, 9)
    values = plan.trajectory.sample(times)
    table = jp.AttitudeTable(
        times=times,
        quaternions=values.quaternion[:, [3, 0, 1, 2]],
        joints=values.joints,
        joint_names=plan.scenario.spacecraft.joint_names,
    )
    with pytest.raises(ValueError, match=r"zone sun is known until 3 s"):
        jp.certify_table(table, "slerp", scene())


def test_departures_after_a_zone_are_refused():
    with pytest.raises(
        ValueError, match=r"departures\[1\] = 4: must be earlier than 3 s, until when zone sun"
    ):
        jp.slew_times(scene(), [scene().goal], departures=[0, 4])


def test_time_that_has_gone_is_taken_off():
    assert later(scene(), 1.0).keep_out[0].lasts == 2.0
    assert known_until(later(scene(), 1.0)) == (2.0, "zone sun")
    assert known_until(scene(ASIDE)) == (np.inf, "")


def test_files_keep_it_and_leave_out_what_lasts_for_good():
    text = dump_scenario(scene())
    assert "lasts_s = 3.0" in text
    assert parse_scenario(text).keep_out[0].lasts == 3.0
    assert "lasts_s" not in dump_scenario(scene(ASIDE))


@pytest.mark.parametrize("value", ["-1.0", "0", '"long"', "nan", "true"])
def test_no_other_value_passes(value):
    text = dump_scenario(scene()).replace("lasts_s = 3.0", f"lasts_s = {value}")
    with pytest.raises(jp.ScenarioError, match=r"keep_out\[0\]\.lasts_s"):
        parse_scenario(text)
