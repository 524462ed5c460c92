"""The timelines that come with the package are what they say, and are planned as a whole, with a proof."""

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.cases import TIMELINE_NAMES

pytest.importorskip("erfa")

QUARTER = 900.0  # s


@pytest.fixture(scope="module")
def day():
    return jp.example_timeline("case-day")


def test_the_names_are_known_and_others_are_refused():
    assert TIMELINE_NAMES == ("case-day", "case-imaging")
    with pytest.raises(ValueError, match="name = 'case-1': must be one of case-day, case-imaging"):
        jp.example_timeline("case-1")


@pytest.mark.slow
def test_the_day_switches_both_links_to_the_side_every_quarter_of_an_hour(day):
    assert day.until == 86400.0
    assert len(day.activities) == 96
    for number, one in enumerate(day.activities):
        assert one.latest == QUARTER * (number + 1)
        assert one.track.devices == ("fore", "aft", "east", "west")
    for one, other in zip(day.activities, day.activities[1:], strict=False):
        same = [a is b for a, b in zip(one.track.directions, other.track.directions, strict=True)]
        assert same == [True, True, False, False]
    assert len({id(path) for one in day.activities for path in one.track.directions}) == 6


@pytest.mark.slow
def test_no_link_of_the_day_passes_the_zones_of_sun_and_moon(day):
    times = np.arange(0.0, 86400.0, 30.0)
    zones = {zone.name: zone for zone in day.scene.keep_out}
    for path in {id(path): path for one in day.activities for path in one.track.directions}.values():
        for zone in zones.values():
            apart = np.arccos(np.sum(path.at(times) * zone.direction.at(times), axis=-1))
            assert np.min(apart) > zone.half_angle + np.deg2rad(1)


@pytest.mark.slow
def test_the_whole_day_is_planned(day):
    plan = jp.plan_timeline(day, progress=False)
    assert plan.ok
    assert all(one.ok for one in plan.activities)
    assert plan.trajectory.duration == pytest.approx(86400.0)
    assert max(one.slew for one in plan.activities) < 20.0
    assert plan.pointing_error < np.deg2rad(0.01)
    assert plan.certify().certified


@pytest.mark.slow
def test_the_images_are_planned(tmp_path):
    asked = jp.example_timeline("case-imaging")
    plan = jp.plan_timeline(asked, progress=False)
    assert plan.ok
    windows = {one.name: one for one in asked.activities}
    for one in plan.activities:
        own = windows[one.name]
        assert one.start >= (own.earliest or 0.0) - 1e-9
        assert one.end <= (own.latest or asked.until) + 1e-6
        assert one.end - one.start >= (own.duration or 0.0) - 1e-9
    plan.save(tmp_path / "plan.npz")
    assert jp.load_timeline_plan(tmp_path / "plan.npz").certify().certified
