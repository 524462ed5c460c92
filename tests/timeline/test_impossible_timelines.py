"""What cannot be done is refused by name, with the device, zone, joint or second that is in the way."""

import re
from dataclasses import replace

import impossible_places
import impossible_times
import pytest
from impossible import AHEAD, AWAY, holding, images, resting, talks, tracking
from passing import LINKS, SUN, links

import jaxplan as jp

S = jp.Status
CASES = impossible_places.CASES | impossible_times.CASES


def test_there_are_many_kinds():
    assert len(CASES) == len(impossible_places.CASES) + len(impossible_times.CASES) >= 50


@pytest.mark.parametrize("name", CASES)
def test_what_cannot_be_done_is_refused_by_name(name):
    case = CASES[name]
    plan = jp.plan_timeline(case.make(), throw=False, go_on=case.go_on, progress=False)
    asked = next(one for one in plan.activities if one.name == "asked")
    assert not plan.ok
    assert not asked.ok
    assert asked.status is case.status, asked.message
    assert plan.status is case.status
    for word in case.words:
        assert word in asked.message
    failed = next(one for one in plan.activities if not one.ok)
    assert f"activity {failed.name}: {failed.message}" in plan.message
    assert not re.search(r"trajectory\.|duration_s|goal\.", f"{jp.TimelineError(plan)} {plan.advice}")
    assert asked.start is None
    assert asked.end is None


def test_a_window_is_kept_to_the_second():
    asked = jp.Activity(name="asked", track=links("east", "west"), duration=41.0, latest=59.0)
    end = jp.plan_timeline(talks(asked), progress=False).activities[0].end
    kept = jp.plan_timeline(talks(replace(asked, latest=end + 0.01)), progress=False)
    assert kept.activities[0].end == end
    short = jp.plan_timeline(talks(replace(asked, latest=end - 1)), throw=False, progress=False)
    assert short.status is S.OUT_OF_WINDOW
    assert "1.00 s after its window" in short.message


@pytest.mark.parametrize(
    "asked",
    [
        tracking({"telescope": -AHEAD}),
        tracking({"telescope": -AHEAD}, what="point"),
        tracking({"telescope": -AHEAD}, duration=3.0),
        holding(AWAY, duration=None),
    ],
    ids=["track", "point", "track for a time", "attitude"],
)
def test_what_is_told_of_the_end_of_the_timeline_is_a_bound_and_is_called_one(asked):
    day = images(asked, until=400.0, keep_out=())
    begin = jp.plan_timeline(day, progress=False).activities[0].start
    lasts = asked.duration or 0.0
    for until in (5.0, 0.5 * begin, 0.98 * begin):
        plan = jp.plan_timeline(replace(day, until=until), throw=False, progress=False)
        assert plan.status is S.OUT_OF_WINDOW
        told = re.search(
            r"can begin at ([\d.]+) s at the earliest, (?:and .* at least )?([\d.]+) s", plan.message
        )
        earliest, late = (float(number) for number in told.groups())
        assert until < earliest <= begin + 0.01
        assert late == pytest.approx(earliest + lasts - until, abs=0.011)


@pytest.mark.parametrize("lasts", [0.0, 1e-11, 1e-7])
def test_what_lasts_less_than_a_microsecond_is_an_instant(lasts):
    brief = jp.Activity(name="asked", track=links("east", "west"), duration=lasts)
    plan = jp.plan_timeline(talks(brief), progress=False)
    (asked, *_) = plan.activities
    assert asked.start == asked.end
    assert all(one.kind != "track" for one in plan.segments)
    assert plan.certify().certified


def test_the_refusal_of_a_second_activity_leaves_the_plan_of_the_first():
    whole = talks(resting("first", 10.0), tracking({"fore": SUN}, duration=5.0), resting("last"))
    plan = jp.plan_timeline(whole, throw=False, progress=False)
    assert [one.name for one in plan.activities] == ["first", "asked"]
    assert plan.certificate.certified
    assert plan.trajectory.duration == plan.activities[0].end
    assert set(LINKS) == {one.name for one in plan.timeline.scene.spacecraft.terminals}
