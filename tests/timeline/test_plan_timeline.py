"""Whole plans of timelines, checked by numpy and scipy: joins, targets, limits, zones and wheels."""

import csv
import io
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from dense import shares
from passing import (
    AXES,
    INERTIA,
    LINKS,
    LOW,
    OTHERS,
    SUN,
    Aim,
    Orbit,
    beams,
    deg,
    misses,
    observer_scene,
    relay_scene,
    satellite,
    site,
)
from reference import FIRST, SECOND, attitudes_of, joints_of, spin_of, stated_margins, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.activities import in_order
from jaxplan.timeline import proving
from jaxplan.timeline.slews import Departure
from jaxplan.timeline.tables import interruptions_csv

TOLERANCE = deg(0.01)
SITES = {
    number: site(LOW, time, beside) for number, (time, beside) in enumerate(((250.0, 1.0), (330.0, -1.0)))
}
FRIEND = satellite(Orbit(900.0, 80.0, 0.0, 30.0), LOW)
STAR = unit([0.4, -0.8, 0.3])
ASIDE = jp.GivenState(rotation_vector=np.array([0.3, 0.4, -0.1]), joints=np.array([0.2, -0.1, 0.3]))


def pointing(aims: dict[str, Aim], **more) -> jp.Targets:
    return jp.Targets.of({name: aim.path() for name, aim in aims.items()}, tolerance=TOLERANCE, **more)


def activity(name: str, *, what="track", **more) -> jp.Activity:
    """An activity that points at what it is named after in `AIMS`."""
    wish = (jp.Wish(device="array", direction=SUN),) if name in WISHING else ()
    return jp.Activity(name=name, **{what: pointing(AIMS[name], prefer=wish)}, **more)


AIMS = {
    "links": LINKS,
    "other links": LINKS | OTHERS,
    "links again": LINKS,
    "image": {"telescope": SITES[0]},
    "relay": {"telescope": SITES[1], "antenna": FRIEND},
    "glance": {"telescope": SITES[1]},
}
WISHING = ("image", "relay")


def links_day(slew: str = "shortest", **more) -> jp.Timeline:
    """Three spells of links, the second with other neighbours, and a rest."""
    return jp.Timeline(
        name="links",
        scene=relay_scene(**more),
        activities=(
            activity("links", duration=60.0),
            activity("other links", earliest=90.0, latest=150.0),
            activity("links again", duration=30.0),
        ),
        until=220.0,
        slew=slew,
    )


def images_day() -> jp.Timeline:
    """An image, a relay with the array toward the Sun, a glance, an attitude and a rest; with wheels."""
    return jp.Timeline(
        name="images",
        scene=observer_scene(),
        activities=(
            activity("image", earliest=200.0, duration=12.0),
            activity("relay", earliest=300.0, duration=25.0),
            activity("glance", what="point", earliest=400.0),
            jp.Activity(name="rest", idle=True, duration=30.0, earliest=440.0),
            jp.Activity(name="aside", attitude=ASIDE, duration=20.0, earliest=560.0),
        ),
        until=600.0,
        slew="calm",
    )


DAYS = {"links": links_day, "calm links": lambda: links_day("calm"), "images": images_day}
each_day = pytest.mark.parametrize("name", DAYS)


@cache
def planned(name: str) -> jp.TimelinePlan:
    """The plan of a day, made once."""
    return jp.plan_timeline(DAYS[name](), progress=False)


def spans(plan: jp.TimelinePlan, kind: str):
    """Name, start and end of all segments of a kind."""
    return [(one.name, one.start, one.end) for one in plan.segments if one.kind == kind]


def one_sided(trajectory, time, side):
    """Attitude, joints and two derivatives of each at a break, from the piece before (-1) or after (1)."""
    step = 5e-3
    piece = np.searchsorted(trajectory.breaks, time + side * 1e-7, side="right") - 1
    stencil = np.stack(
        [attitudes_of(trajectory, np.array([time + i * step]), np.array([piece]))[0] for i in range(-4, 5)]
    )
    middle = stencil[4].T

    def vee(matrix):
        apart = matrix - matrix.T
        return np.array([apart[2, 1], apart[0, 2], apart[1, 0]]) / 2

    turned = np.tensordot(FIRST / step, stencil, 1), np.tensordot(SECOND / step**2, stencil, 1)
    beside = joints_of(trajectory, np.array([time + side * 1e-9]))[:, 0]  # of the piece that ends, or begins
    return {
        "attitude": stencil[4],
        "rate": vee(middle @ turned[0]),
        "acceleration": vee(middle @ turned[1]),
        "joints": beside,
    }


@each_day
def test_a_day_is_planned_and_certified_whole(name):
    plan = planned(name)
    assert plan.ok
    assert plan.certificate.certified
    assert all(one.ok for one in plan.activities)
    assert plan.trajectory.duration == plan.timeline.until
    jumps = {name: jump for name, jump in plan.certificate.jumps.items() if "jerk" not in name}
    assert len(jumps) == 6
    assert max(jumps.values()) < 1e-9


@each_day
def test_segments_follow_each_other_without_gaps(name):
    segments = planned(name).segments
    assert segments[0].start == 0
    assert segments[-1].end == planned(name).timeline.until
    for one, other in pairwise(segments):
        assert one.end == other.start
        assert one.start < one.end


@each_day
def test_the_motion_has_two_continuous_derivatives_where_segments_join(name):
    trajectory = planned(name).trajectory
    for segment in planned(name).segments[1:]:
        before, after = (one_sided(trajectory, segment.start, side) for side in (-1, 1))
        np.testing.assert_allclose(after["attitude"], before["attitude"], rtol=0, atol=1e-9)
        np.testing.assert_allclose(after["rate"], before["rate"], rtol=0, atol=1e-9)
        np.testing.assert_allclose(after["acceleration"], before["acceleration"], rtol=0, atol=2e-9)
        np.testing.assert_allclose(after["joints"], before["joints"], rtol=0, atol=1e-8)


@each_day
def test_devices_point_at_where_their_targets_truly_are_within_what_is_proved(name):
    plan, aims_met = planned(name), 0
    for activity_name, start, end in spans(plan, "track"):
        own = next(one for one in plan.activities if one.name == activity_name)
        time = np.append(np.arange(start, end, 0.5), end)
        worst = np.max(misses(plan.trajectory, plan.timeline.scene.spacecraft, AIMS[activity_name], time))
        # what samples tell of a target is off by some 1e-8 rad at most
        assert worst <= own.pointing_error + 2e-8
        assert own.pointing_error <= TOLERANCE
        aims_met += 1
    assert aims_met >= 2


@pytest.mark.parametrize("name", ["links", "calm links"])
def test_interruptions_are_of_devices_that_keep_their_targets_and_last_from_track_to_track(name):
    plan = planned(name)
    found, tracks = plan.interruptions, spans(plan, "track")
    expected = [
        (device, before[0], after[0], before[2], after[1])
        for before, after in pairwise(tracks)
        for device in ("fore", "aft")
    ]
    assert [(one.device, one.before, one.after, one.start, one.end) for one in found] == expected
    assert len(found) == 4
    for one in found:
        assert one.duration > 0
        time = np.linspace(one.start, one.end, 1000)
        aim = {one.device: LINKS[one.device]}
        worst = np.max(misses(plan.trajectory, plan.timeline.scene.spacecraft, aim, time))
        assert one.off == pytest.approx(worst, rel=1e-2, abs=1e-6)
    assert dict(plan.rows())["interruptions"].startswith("4 of targets that stay")
    rows = list(csv.DictReader(io.StringIO(interruptions_csv(plan))))
    assert [(row["device"], float(row["duration_s"])) for row in rows] == [
        (one.device, one.duration) for one in found
    ]
    told = plan.summary()["interruptions"]
    assert [(one["device"], one["start_s"]) for one in told] == [(one.device, one.start) for one in found]


def test_nothing_is_interrupted_where_targets_change_or_something_else_is_to_be_done():
    assert planned("images").interruptions == ()
    assert interruptions_csv(planned("images")).count("\n") == 1
    whole = planned("links")
    idle = jp.Activity(name="links again", idle=True)  # what the second slew leads to tracks nothing
    changed = replace(whole.timeline, activities=(*whole.timeline.activities[:2], idle))
    assert {one.after for one in replace(whole, timeline=changed).interruptions} == {"other links"}


@each_day
def test_limits_ranges_and_zones_are_kept_on_a_grid(name):
    plan = planned(name)
    craft, trajectory = replace(plan.timeline.scene.spacecraft, wheels=()), plan.trajectory
    for limit, share in shares(trajectory, craft, 4001).items():
        assert np.max(np.abs(share)) <= 1 + 1e-5, limit
    time = np.linspace(0.0, trajectory.duration, 2003)
    margins = stated_margins(plan.timeline.scene, trajectory, time)
    assert set(margins) == {zone.name for zone in plan.timeline.scene.zones}
    least = min(float(np.min(margin)) for margin in margins.values())
    assert plan.certificate.min_margin - 1e-6 <= least
    assert plan.certificate.min_margin > 0


@each_day
def test_windows_and_durations_are_kept(name):
    plan = planned(name)
    ends = [0.0]
    for asked, done in zip(plan.timeline.activities, plan.activities, strict=False):
        assert done.name == asked.name
        assert done.start >= (asked.earliest or 0.0) - 1e-9
        assert done.end <= (asked.latest or np.inf) + 1e-9
        assert done.start - done.slew >= ends[-1] - 1e-6 or done.slew == 0
        if asked.duration is not None:
            assert done.end - done.start == pytest.approx(asked.duration, abs=1e-9)
        ends.append(done.end)


def test_a_target_is_followed_until_its_window_opens_after_the_shortest_slew():
    plan = planned("links")
    name, start, end = spans(plan, "track")[1]
    assert name == "other links"
    assert start < 89.0
    assert end == 150.0
    done = plan.activities[1]
    assert (done.start, done.end) == (90.0, 150.0)


def test_a_calm_slew_takes_the_time_until_the_window_opens():
    plan = planned("calm links")
    name, start, end = spans(plan, "slew")[1]
    assert name == "other links"
    assert end == pytest.approx(90.0, abs=1e-9)
    assert start == plan.activities[0].end
    # the slews of both days lead to the same links; the calm one takes longer, and so is slower
    rates = []
    for day in ("links", "calm links"):
        time = np.linspace(*spans(planned(day), "slew")[1][1:], 99)
        rates.append(np.max(np.abs(joints_of(planned(day).trajectory, time)[1])))
    assert rates[1] < 0.6 * rates[0]


def test_a_glance_points_at_its_target_at_its_instant_and_moves_with_it():
    plan = planned("images")
    done = next(one for one in plan.activities if one.name == "glance")
    assert done.start == done.end == pytest.approx(400.0)
    craft = plan.timeline.scene.spacecraft
    at = [
        misses(plan.trajectory, craft, AIMS["glance"], np.array([400.0 + t]))[0, 0] for t in (-0.05, 0, 0.05)
    ]
    assert at[1] <= TOLERANCE
    assert np.ptp(at) < deg(1e-4)


def test_the_shortest_slew_to_an_instant_comes_after_a_rest():
    glance = activity("glance", what="point", earliest=400.0)
    day = jp.plan_timeline(
        replace(images_day(), activities=(glance,), until=500.0, slew="shortest"), progress=False
    )
    assert day.certificate.certified
    done = day.activities[0]
    assert done.start == done.end == pytest.approx(400.0, abs=1e-9)
    (_, begin, rested), (_, left, end) = spans(day, "idle")[0], spans(day, "slew")[0]
    assert begin == 0.0
    assert (rested, end) == (left, pytest.approx(400.0, abs=1e-9))
    time = np.linspace(begin, rested, 9)
    assert np.ptp(attitudes_of(day.trajectory, time), axis=0).max() < 1e-12
    own = day.choices[0].departure
    assert done.slew == end - left <= 1.5 * own.bound(day.choices[0].goal)


def test_a_rest_ends_earlier_where_the_slew_from_it_takes_longer_than_one_without(monkeypatch):
    shortest, told = Departure.shortest, []

    def hasty(departure, *asked):
        found = shortest(departure, *asked)
        told.append(found.duration)
        return found if found.duration > 200 else replace(found, duration=0.3 * found.duration)

    monkeypatch.setattr(Departure, "shortest", hasty)
    glance = activity("glance", what="point", earliest=400.0)
    day = jp.plan_timeline(
        replace(images_day(), activities=(glance,), until=500.0, slew="shortest"), progress=False
    )
    assert day.certificate.certified
    assert day.activities[0].start == pytest.approx(400.0, abs=1e-9)
    (_, begin, rested), (_, left, end) = spans(day, "idle")[0], spans(day, "slew")[0]
    assert begin == 0.0
    assert rested == left
    assert min(told) <= end - left <= 1.5 * day.choices[0].departure.bound(day.choices[0].goal)


def test_a_day_is_planned_again_from_an_activity_on():
    day = planned("links")
    longer = replace(day.timeline.activities[2], duration=35.0)
    changed = replace(day.timeline, activities=(*day.timeline.activities[:2], longer))
    again = jp.plan_timeline(changed, after=day, from_activity="links again", progress=False)
    assert again.certify().certified
    kept = [one for one in day.segments if one.name != "links again" and one.end <= 150.0 + 1e-9]
    assert list(again.segments[: len(kept)]) == kept
    time = np.linspace(0.0, 150.0, 301)
    np.testing.assert_array_equal(attitudes_of(again.trajectory, time), attitudes_of(day.trajectory, time))
    assert again.activities[2].end - again.activities[2].start == pytest.approx(35.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"duration": 40.0}, "activity links differs from the one that was planned in duration"),
        ({"track": pointing(LINKS | OTHERS)}, "activity links differs .* in track"),
    ],
)
def test_what_is_kept_must_be_what_is_still_asked_for(changes, said):
    day = planned("links")
    first, *others = day.timeline.activities
    changed = replace(day.timeline, activities=(replace(first, **changes), *others))
    with pytest.raises(ValueError, match=said):
        jp.plan_timeline(changed, after=day, from_activity="links again", progress=False)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda day: ("day.toml",), "timeline must be a Timeline, not str; jp.load_timeline reads one"),
        (lambda day: (day.timeline.scene,), "timeline must be a Timeline, not Scenario; jp.load_timeline"),
        (
            lambda day: (day.timeline, day.timeline),
            "after must be a TimelinePlan, not Timeline; jp.plan_time",
        ),
        (lambda day: (day.timeline, day, 2), "from_activity must be a str, not int"),
    ],
    ids=["file", "scene", "after", "from_activity"],
)
def test_arguments_of_other_classes_are_refused_by_name(given, said):
    names = "timeline", "after", "from_activity"
    more = dict(zip(names, (None, None, "links"), strict=True)) | dict(
        zip(names, given(planned("links")), strict=False)
    )
    with pytest.raises(TypeError, match=said):
        jp.plan_timeline(**more)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            lambda scene: {"start": replace(scene.start, joints=scene.start.joints + 0.01)},
            "the start differs",
        ),
        (lambda scene: {"epoch": np.datetime64("2031-01-01")}, "the epoch differs"),
    ],
    ids=["start", "epoch"],
)
def test_a_day_planned_again_must_begin_as_it_did(changes, said):
    day = planned("links")
    scene = day.timeline.scene
    changed = replace(day.timeline, scene=replace(scene, **changes(scene)))
    with pytest.raises(ValueError, match=said):
        jp.plan_timeline(changed, after=day, from_activity="links again", progress=False)


KEPT = {"idle": {"idle": True}, "attitude": {"attitude": relay_scene().start}}


@pytest.mark.parametrize("slew", ["shortest", "calm"])
@pytest.mark.parametrize("asked", KEPT)
def test_what_is_held_already_needs_no_slew(asked, slew):
    first = jp.Activity(name="first", **KEPT[asked], latest=0.1)
    second = jp.Activity(name="second", **KEPT[asked], earliest=50.0, duration=70.0)
    timeline = replace(links_day(slew), activities=(first, second), until=120.3)
    plan = jp.plan_timeline(timeline, progress=False)
    assert [(one.start, one.end, one.slew) for one in plan.activities] == [
        (0.0, 0.1, 0.0),
        (50.0, 120.0, 0.0),
        (120.0, pytest.approx(120.3), 0.0),
    ]
    assert not plan.slews
    assert plan.certify().certified
    late = replace(timeline, activities=(first, replace(second, earliest=None, latest=70.0)))
    found = jp.plan_timeline(late, throw=False, progress=False)
    assert found.status is jp.Status.OUT_OF_WINDOW
    assert "can end at 70.10 s at the earliest, 0.10 s after its window" in found.message


def held_day(*activities, until):
    return replace(links_day("shortest"), activities=activities, until=until)


def test_what_is_nearly_held_takes_the_least_slew():
    start = relay_scene().start
    turned = replace(start, rotation_vector=np.add(start.rotation_vector, [1e-7, 0, 0]))
    day = held_day(jp.Activity(name="aside", attitude=turned, duration=1.0), until=10.0)
    plan = jp.plan_timeline(day, progress=False)
    assert plan.activities[0].slew == pytest.approx(0.5)


def test_rounding_that_is_left_until_the_end_is_no_rest():
    thirds = [jp.Activity(name=name, idle=True, duration=3.3333333) for name in "abc"]
    plan = jp.plan_timeline(held_day(*thirds, until=10.0), progress=False)
    assert [one.name for one in plan.activities] == ["a", "b", "c"]


def test_a_day_of_one_instant_has_a_motion_that_is_proved():
    instant = jp.Activity(name="now", idle=True, duration=0.0)
    day = held_day(instant, until=None)
    still = replace(day, scene=replace(day.scene, keep_out=(), keep_in=()))
    plan = jp.plan_timeline(still, progress=False)
    assert plan.trajectory is not None
    assert plan.certificate.certified


def test_an_attitude_is_held_at_rest():
    plan = planned("images")
    done = next(one for one in plan.activities if one.name == "aside")
    time = np.linspace(done.start, done.end, 21)
    np.testing.assert_allclose(
        attitudes_of(plan.trajectory, time), np.tile(ASIDE.attitude, (21, 1, 1)), atol=1e-9
    )
    np.testing.assert_allclose(joints_of(plan.trajectory, time)[0], np.tile(ASIDE.joints, (21, 1)), atol=1e-9)


def test_a_spacecraft_at_rest_does_not_move():
    plan = planned("images")
    start, end = next((a, b) for name, a, b in spans(plan, "idle") if name == "rest")
    time = np.linspace(start, end, 9)
    assert np.ptp(attitudes_of(plan.trajectory, time), axis=0).max() < 1e-12
    assert np.ptp(joints_of(plan.trajectory, time)[0], axis=0).max() < 1e-12


def test_the_array_comes_nearer_to_the_sun_than_it_was_where_it_prefers_it():
    plan = planned("images")
    array = plan.timeline.scene.spacecraft.device_names.index("array")
    done = next(one for one in plan.activities if one.name == "relay")
    seen = beams(plan.trajectory, plan.timeline.scene.spacecraft, np.array([0.0, done.start, done.end]))[
        :, array
    ]
    cosines = seen @ SUN
    assert min(cosines[1:]) > cosines[0]


def test_wheels_hold_what_the_conservation_of_momentum_leaves_them():
    plan = planned("images")
    craft, trajectory = plan.timeline.scene.spacecraft, plan.trajectory
    time = np.linspace(0.0, trajectory.duration, 701)
    spin, attitudes = spin_of(trajectory, time)[0], attitudes_of(trajectory, time)
    stored = np.array([wheel.stored for wheel in craft.wheels])
    total = attitudes[0] @ (AXES.T @ stored)  # at rest the wheels have it all
    held = np.einsum("kji,j->ki", attitudes, total) - spin @ INERTIA
    apart = stored - np.linalg.pinv(AXES.T) @ AXES.T @ stored  # what no motion changes
    each = held @ np.linalg.pinv(AXES.T).T + apart
    peak = np.max(np.abs(each) / 20.0)
    proved = max(share for name, share in plan.certificate.peaks.items() if "momenta" in name)
    assert peak <= proved + 1e-6
    assert proved <= 1.02 * peak
    np.testing.assert_allclose(each[0], stored, rtol=0, atol=1e-7)


def test_an_activity_that_comes_after_another_is_done_after_it(tmp_path):
    rests = [
        jp.Activity(name=name, idle=True, duration=1.0, after=after)
        for name, after in (("a", "c"), ("b", ""), ("c", ""))
    ]
    timeline = jp.Timeline(name="order", scene=relay_scene(), activities=tuple(rests), until=50.0)
    assert [one.name for one in in_order(timeline.activities)] == ["b", "c", "a"]
    plan = jp.plan_timeline(timeline, progress=False)
    assert [one.name for one in plan.activities] == ["b", "c", "a", "rest until the end"]
    starts = [one.start for one in plan.activities]
    assert starts == sorted(starts)
    plan.save(tmp_path / "plan.npz")  # with what is done in the time that is left
    read = jp.load_timeline_plan(tmp_path / "plan.npz")
    assert [one.name for one in read.activities] == [one.name for one in plan.activities]


def test_planning_ends_at_what_cannot_be_done_unless_it_shall_go_on():
    rests = [jp.Activity(name=name, idle=True, duration=20.0) for name in ("first", "last")]
    late = jp.Activity(name="late", idle=True, duration=5.0, latest=10.0)
    timeline = jp.Timeline(
        name="late", scene=relay_scene(), activities=(rests[0], late, rests[1]), until=100.0
    )
    stopped = jp.plan_timeline(timeline, throw=False, progress=False)
    gone = jp.plan_timeline(timeline, throw=False, go_on=True, progress=False)
    assert [one.name for one in stopped.activities] == ["first", "late"]
    assert [one.ok for one in gone.activities] == [True, False, True, True]
    for plan in (stopped, gone):
        assert plan.status is jp.Status.OUT_OF_WINDOW
        assert "activity late" in plan.message
        assert plan.certificate.certified
    assert gone.trajectory.duration == 100.0
    with pytest.raises(jp.TimelineError, match="activity late") as caught:
        jp.plan_timeline(timeline, progress=False)
    assert caught.value.status is jp.Status.OUT_OF_WINDOW


def test_what_comes_after_a_failed_activity_is_not_done_and_what_only_follows_it_is():
    rests = {
        name: jp.Activity(name=name, idle=True, duration=5.0) for name in ("first", "late", "next", "last")
    }
    rests["late"] = replace(rests["late"], latest=5.5)
    rests["next"] = replace(rests["next"], after="late")
    rests["last"] = replace(rests["last"], after="first")
    timeline = jp.Timeline(name="after", scene=relay_scene(), activities=tuple(rests.values()), until=60.0)
    plan = jp.plan_timeline(timeline, throw=False, go_on=True, progress=False)
    done = {one.name: one for one in plan.activities}
    assert [done[name].ok for name in rests] == [True, False, False, True]
    assert done["next"].message == "late, after which it comes, is not done (OUT_OF_WINDOW)"
    assert plan.certificate.certified


def test_what_points_less_well_than_is_asked_is_not_done_and_planning_ends_there(monkeypatch):
    monkeypatch.setattr(proving, "pointing_error", lambda *_: deg(0.02))
    first = activity("links", duration=10.0)
    rest = jp.Activity(name="rest", idle=True, duration=5.0)
    timeline = jp.Timeline(name="off", scene=relay_scene(), activities=(first, rest), until=60.0)
    plans = [jp.plan_timeline(timeline, throw=False, go_on=on, progress=False) for on in (False, True)]
    assert [[one.ok for one in plan.activities] for plan in plans] == [[False], [False, True, True]]
    for plan in plans:
        assert plan.status is jp.Status.UNCERTIFIED
        assert "within 0.02 deg, tolerance_deg = 0.01 is asked for" in plan.message
        assert plan.activities[0].start is None
    assert plans[0].trajectory is None


def test_a_tube_about_the_plan_keeps_clear_of_zones_and_ranges():
    tube = jp.Robust(attitude_error=deg(2.0), joint_error=deg(0.5))
    whole = links_day(robust=tube)
    plan = jp.plan_timeline(replace(whole, activities=whole.activities[:1], until=65.0), progress=False)
    assert plan.certificate.certified
    time = np.linspace(0.0, 65.0, 501)
    margins = stated_margins(plan.timeline.scene, plan.trajectory, time)
    assert min(float(np.min(margin)) for margin in margins.values()) > deg(2.0)
    assert plan.certificate.min_margin > 0
    joints, ranges = joints_of(plan.trajectory, time)[0], plan.timeline.scene.spacecraft.joint_ranges
    assert np.min(ranges[:, 1] - np.abs(joints)) >= deg(0.5)


def test_how_well_devices_point_is_proved_of_spacecraft_with_a_limit_of_torque_too():
    craft = replace(
        relay_scene().spacecraft, inertia=np.diag([20.0, 25.0, 30.0]), torque_limit=np.full(3, 1.0)
    )
    whole = links_day(spacecraft=craft)
    plan = jp.plan_timeline(replace(whole, activities=whole.activities[:1], until=65.0), progress=False)
    assert plan.pointing_error <= TOLERANCE


def test_an_instant_leaves_joints_the_room_to_stop():
    # the antenna's target is at the end of the range of its pitch, and goes on beyond it
    telescope = Aim(lambda time: np.tile(unit([0.2, 0.3, -0.9]), (len(time), 1)))
    about = unit(np.cross(telescope.at(np.zeros(1))[0], [0.0, 1.0, 0.0]))

    def at(time):
        # the pitch is what is left of a right angle from the telescope
        apart = deg(90.0 - 84.99) - 0.01 * (np.asarray(time) - 30.0)
        return Rotation.from_rotvec(np.multiply.outer(apart, about)).apply(telescope.at(np.zeros(1))[0])

    glance = jp.Activity(
        name="glance", point=pointing({"telescope": telescope, "antenna": Aim(at)}), earliest=30.0
    )
    rest = jp.Activity(name="rest", idle=True, duration=5.0)
    timeline = jp.Timeline(name="edge", scene=observer_scene(), activities=(glance, rest), until=60.0)
    plan = jp.plan_timeline(timeline, throw=False, go_on=True, progress=False)
    refused, rested = plan.activities[:2]
    assert refused.status is jp.Status.INVALID_GOAL
    assert "antenna pitch" in refused.message
    assert "30.00 s" in refused.message
    assert rested.ok


@pytest.mark.parametrize(("beside", "duration"), [(3.0, 400.0), (3.0, 2000.0), (0.0, 400.0), (0.0, 2000.0)])
def test_a_spacecraft_at_rest_gives_way_to_a_zone_that_comes_along(beside, duration):
    ahead = observer_scene().start.attitude[:, 2]
    across = unit(np.cross(ahead, [0.3, 0.2, 0.9]))
    middle = np.cos(deg(beside)) * ahead + np.sin(deg(beside)) * np.cross(ahead, across)

    def passing(time):
        far = deg(0.25) * (np.asarray(time) - 260.0)
        return np.cos(far)[:, None] * middle + np.sin(far)[:, None] * across

    zone = jp.KeepOut(name="passer", direction=Aim(passing).path(), half_angle=deg(8), devices=("telescope",))
    rest = jp.Activity(name="rest", idle=True, duration=duration)
    scene = observer_scene(keep_out=(zone,))
    timeline = jp.Timeline(name="passer", scene=scene, activities=(rest,), until=duration + 30.0)
    plan = jp.plan_timeline(timeline, throw=False, progress=False)
    assert plan.ok, plan.message


def changed(plan: jp.TimelinePlan, name: str, **changes) -> jp.TimelinePlan:
    """The same plan for a timeline in which an activity is another."""
    every = tuple(replace(one, **changes) if one.name == name else one for one in plan.timeline.activities)
    return replace(plan, timeline=replace(plan.timeline, activities=every))


def said(plan: jp.TimelinePlan, name: str, **changes) -> jp.TimelinePlan:
    """The same plan, in which it says something else of an activity."""
    every = tuple(replace(one, **changes) if one.name == name else one for one in plan.activities)
    return replace(plan, activities=every)


def overtaking(rate: float) -> jp.DirectionPath:
    """A target that is where that of the glance is at its instant, and turns otherwise by a rate, deg/s."""
    own = SITES[1].path()
    turn = Rotation.from_rotvec(np.multiply.outer(deg(rate) * (own.times - 400.0), [0.0, 0.0, 1.0]))
    return jp.DirectionPath.through(own.times, turn.apply(own.samples))


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (
            lambda day: changed(
                day, "aside", attitude=replace(ASIDE, rotation_vector=np.array([0.3, 0.4, -0.2]))
            ),
            "aside: its attitude is held within ",
        ),
        (
            lambda day: changed(
                day, "aside", attitude=replace(ASIDE, joints=np.array([0.2, -0.1 + 1e-6, 0.3]))
            ),
            "aside: its joints are held within 5.73e-05 deg",
        ),
        (lambda day: changed(day, "aside", duration=21.0), "aside: lasts 20.00 s, not 21.00 s"),
        (
            lambda day: changed(day, "aside", earliest=565.0),
            "aside: begins at 560.00 s, not from 565.00 s on",
        ),
        (lambda day: changed(day, "rest", latest=460.0), "rest: ends at 470.00 s, not by 460.00 s"),
        (lambda day: changed(day, "glance", after="aside"), "glance: begins at 400.00 s, before"),
        (
            lambda day: changed(day, "glance", point=pointing({"telescope": SITES[0]})),
            "glance: telescope is off its target by ",
        ),
        (
            lambda day: changed(day, "glance", point=jp.Targets.of({"telescope": overtaking(2e-3)})),
            "glance: telescope moves by ",
        ),
        (lambda day: changed(day, "image", track=None, idle=True), "image: has no segment from 200.00 s"),
        (lambda day: said(day, "glance", start=401.0, end=401.0), "glance: telescope moves by "),
        (lambda day: said(day, "rest", start=None), "rest: is not within the motion"),
        (lambda day: replace(day, activities=day.activities[1:]), "image: is not done"),
        (
            lambda day: replace(day, timeline=replace(day.timeline, until=700.0)),
            "the motion ends at 600.00 s",
        ),
    ],
    ids=lambda one: "" if callable(one) else one,
)
def test_a_plan_that_does_not_do_what_it_says_is_not_certified(plan, words):
    certificate = plan(planned("images")).certify()
    assert not certificate.certified
    assert any(words in fault for fault in certificate.faults), certificate.faults


def test_a_plan_whose_segments_begin_within_a_piece_of_the_motion_is_not_certified():
    plan = planned("links")
    first, second, *others = plan.segments
    shared = (second.start + second.end) / 2 + 0.0123
    moved = replace(first, end=shared), replace(second, start=shared), *others
    certificate = replace(plan, segments=moved).certify()
    assert not certificate.certified
    assert f"the segment {second.name} does not begin at a break of the motion" in certificate.faults
    assert plan.certify().certified


def test_a_slew_past_a_zone_takes_no_longer_than_one_along_its_rim():
    # the straight way of the telescope leads through the middle of the zone, and its target moves on
    first = observer_scene().start.attitude[:, 2]
    across = unit(np.cross(first, [0.3, 0.2, 0.9]))

    def ahead(time, rate=0.0, begin=40.0):
        angle = deg(begin + rate * np.asarray(time))[..., None]
        return np.cos(angle) * first + np.sin(angle) * across

    zone = jp.KeepOut(name="lamp", direction=ahead(0.0), half_angle=deg(20), devices=("telescope",))
    look = jp.Targets.of({"telescope": Aim(lambda time: ahead(time, 0.05, 80.0)).path(200.0)})
    whole = jp.Timeline(
        name="past",
        scene=observer_scene(spacecraft=replace(observer_scene().spacecraft, wheels=()), keep_out=(zone,)),
        activities=(jp.Activity(name="look", track=look, duration=5.0),),
        until=150.0,
    )
    plan = jp.plan_timeline(whole, progress=False)
    tangent, arc = np.arccos(np.cos(deg(40)) / np.cos(deg(20))), np.arccos(np.tan(deg(20)) / np.tan(deg(40)))
    around = np.rad2deg(2 * tangent + 2 * (np.pi / 2 - arc) * np.sin(deg(20)))
    rate, acceleration = 2.0, 0.5  # deg
    assert plan.activities[0].slew <= around / rate + rate / acceleration + 2.0
    assert plan.certificate.min_margin > 0
