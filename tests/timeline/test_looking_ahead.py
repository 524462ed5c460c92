"""Tracks that are led to where the next slew leads: shorter slews, and all that was kept before is kept."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dense import shares
from passing import LINKS, MINE, deg, links, misses, relay, relay_zones
from reference import angle, attitudes_of, boresights, joints_of, stated_margins, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan import so3
from jaxplan.timeline import looking_ahead, planning
from jaxplan.timeline.curves import part
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.timeline.record import load_timeline_plan
from jaxplan.timeline.tracking import State

TOLERANCE = deg(0.01)
STAR = MINE.frame(0.0) @ unit(np.array([0.3, 0.5, 0.6]))  # some 60 deg from where the camera looks
TRACK = 240.0  # s
ARRAYS = ("breaks", "coefficients", "chart_attitude", "joint_breaks", "joint_coefficients")


def camera_scene() -> jp.Scenario:
    """The link satellite with a camera along its motion, which zones do not bind."""
    craft = replace(relay(), instruments=(jp.Instrument(name="camera", boresight=np.array([1.0, 0, 0])),))
    toward = {name: aim.at(np.zeros(1))[0] for name, aim in LINKS.items()}
    start = jp.point(craft, toward, attitude=MINE.frame(0.0))
    zones = tuple(replace(zone, devices=tuple(LINKS)) for zone in relay_zones())
    return jp.Scenario(name="camera", spacecraft=craft, start=start, goal=start, keep_out=zones)


LINK = jp.Activity(name="links", track=links(), duration=TRACK)
IMAGE = jp.Activity(name="image", track=jp.Targets.of({"camera": STAR}, tolerance=TOLERANCE), duration=20.0)


def day_of(*activities: jp.Activity, **more) -> jp.Timeline:
    return jp.Timeline(name="day", scene=camera_scene(), activities=activities, until=600.0, **more)


@cache
def planned(look_ahead: bool) -> jp.TimelinePlan:
    """Links for some minutes and an image after them, planned once."""
    return jp.plan_timeline(day_of(LINK, IMAGE, look_ahead=look_ahead), progress=False)


def both(*activities: jp.Activity, **more) -> list[jp.TimelinePlan]:
    """The plans of a day without and with looking ahead."""
    return [
        jp.plan_timeline(day_of(*activities, look_ahead=ahead, **more), progress=False)
        for ahead in (False, True)
    ]


def assert_same_bits(one: jp.TimelinePlan, other: jp.TimelinePlan) -> None:
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one.trajectory, name), getattr(other.trajectory, name))


def led(plan: jp.TimelinePlan) -> list[str]:
    """Names of the activities that were led ahead."""
    return [choice.activity.name for choice in plan.choices if choice.motion.led]


def test_the_slew_after_a_track_is_a_good_part_shorter():
    plain, ahead = planned(False), planned(True)
    assert led(plain) == []
    assert led(ahead) == ["links"]
    assert ahead.activities[1].slew < 0.25 * plain.activities[1].slew
    assert ahead.activities[1].end < plain.activities[1].end - 20.0
    assert ahead.ok
    assert ahead.certify().certified


def test_a_track_that_is_led_begins_and_ends_when_it_did_and_as_it_did():
    plain, ahead = planned(False), planned(True)
    before, after = plain.activities[0], ahead.activities[0]
    assert after.start == pytest.approx(before.start, abs=1e-9)
    assert after.end == pytest.approx(before.end, abs=1e-9)
    early = before.start + np.linspace(0.0, TRACK / 6, 60)  # two of twelve intervals between nodes
    for own in (attitudes_of, lambda *at: joints_of(*at, orders=1)[0]):
        np.testing.assert_allclose(
            own(ahead.trajectory, early), own(plain.trajectory, early), rtol=0, atol=1e-4
        )
    late = [own.trajectory.sample(before.end).attitude for own in (plain, ahead)]
    assert Rotation.from_matrix(late[0].T @ late[1]).magnitude() > deg(40)


def test_devices_still_point_and_limits_ranges_and_zones_are_kept():
    plan = planned(True)
    one, trajectory = plan.activities[0], plan.trajectory
    time = np.append(np.arange(one.start, one.end, 0.5), one.end)
    worst = np.max(misses(trajectory, plan.scene.spacecraft, LINKS, time))
    assert worst <= one.pointing_error + 2e-8
    assert one.pointing_error <= TOLERANCE
    for limit, share in shares(trajectory, plan.scene.spacecraft, 4001).items():
        assert np.max(np.abs(share)) <= 1 + 1e-5, limit
    margins = stated_margins(plan.scene, trajectory, np.linspace(0.0, trajectory.duration, 2003))
    assert min(float(np.min(margin)) for margin in margins.values()) > 0


def test_what_it_costs_is_a_turn_of_the_platform_well_below_its_limits():
    plan = planned(True)
    segment = next(one for one in plan.segments if one.kind == "track")
    found = shares(part(plan.trajectory, segment.start, segment.end), plan.scene.spacecraft, 2001)
    for name in ("rate", "acceleration", "joint rate", "joint acceleration"):
        assert np.max(np.abs(found[name])) < 0.6, name


@pytest.mark.parametrize("room", [None, 0.5], ids=["later", "too late for its window"])
def test_what_makes_the_next_activity_later_is_not_kept(monkeypatch, room):
    plain = planned(False)
    end = plain.activities[1].end

    def led_away(doing, motion, then):
        """A turn away from where the next slew leads, which is said to be shorter."""
        pursuit = Pursuit.of(doing.scene.usable, doing.scene.constraints, doing.activity.track)
        last = State.of(motion.trajectory, motion.trajectory.duration).attitude
        ahead = looking_ahead._find_next_slew(motion, then, 10.0).attitude
        away = last @ so3.exp(-0.3 * so3.log(last.T @ ahead))
        led_there.append(looking_ahead._draw_end_toward(doing, pursuit, motion, away, 2.0))
        return looking_ahead.Led(motion=led_there[-1], bound=0.0)

    led_there = []
    monkeypatch.setattr(planning, "led_ahead", led_away)
    image = replace(IMAGE, latest=None if room is None else end + room)
    plan = jp.plan_timeline(day_of(LINK, image, look_ahead=True), progress=False)
    assert [motion.led for motion in led_there] == [True]
    assert led(plan) == []
    assert_same_bits(plan, plain)


def test_a_last_activity_is_not_led():
    first = replace(IMAGE, duration=5.0)
    plain, ahead = both(first, replace(LINK, duration=60.0))
    assert "links" not in led(ahead)
    assert_same_bits(plain, ahead)  # the camera takes all but the roll, by which the bound is no shorter


def test_nothing_changes_where_the_next_activity_needs_no_turn_or_waits_for_a_joint():
    track = replace(LINK, duration=60.0)
    again = replace(LINK, name="links again", duration=5.0)
    end = jp.plan_timeline(day_of(track), progress=False)
    last = end.trajectory.sample(end.activities[0].end)
    joints = last.joints.copy()
    joints[0] += deg(40)
    stow = jp.GivenState(rotation_vector=Rotation.from_matrix(last.attitude).as_rotvec(), joints=joints)
    plain, ahead = both(track, jp.Activity(name="stow", attitude=stow, duration=5.0), again)
    assert led(ahead) == []
    np.testing.assert_array_equal(plain.segments[1].end, ahead.segments[1].end)
    assert_same_bits(plain, ahead)


def test_nothing_changes_where_a_calm_slew_has_all_the_time_until_a_window():
    later = replace(IMAGE, earliest=200.0)
    plain, ahead = both(replace(LINK, duration=60.0), later, slew="calm")
    assert_same_bits(plain, ahead)
    assert led(ahead) == []


def test_a_given_attitude_is_led_to_as_well():
    turned = Rotation.from_matrix(MINE.frame(0.0)) * Rotation.from_euler("z", 25, degrees=True)
    held = jp.GivenState(rotation_vector=turned.as_rotvec(), joints=planned(False).scene.start.joints)
    plain, ahead = both(replace(LINK, duration=60.0), jp.Activity(name="aside", attitude=held, duration=5.0))
    assert led(ahead) == ["links"]
    assert ahead.activities[1].slew < 0.8 * plain.activities[1].slew
    assert ahead.certificate.certified


def test_files_keep_the_key_and_the_plan():
    timeline = day_of(LINK, IMAGE, look_ahead=True)
    text = jp.schema.dump_timeline(timeline)
    assert "look_ahead = true" in text
    assert jp.schema.parse_timeline(text).look_ahead is True
    assert "look_ahead" not in jp.schema.dump_timeline(replace(timeline, look_ahead=False))


def test_a_plan_that_was_led_is_read_back_and_proved_anew(tmp_path):
    planned(True).save(tmp_path / "plan.npz")
    again = load_timeline_plan(tmp_path / "plan.npz")
    assert again.timeline.look_ahead
    assert_same_bits(again, planned(True))
    assert again.certify().certified


def test_a_day_is_planned_again_from_the_activity_on_to_which_a_track_was_led():
    day = planned(True)
    other = replace(IMAGE, duration=25.0)
    changed = replace(day.timeline, activities=(LINK, other))
    again = jp.plan_timeline(changed, after=day, from_activity="image", progress=False)
    assert again.certify().certified
    assert again.activities[1].slew == pytest.approx(day.activities[1].slew, abs=1e-6)
    time = np.linspace(0.0, day.activities[0].end, 301)
    np.testing.assert_array_equal(attitudes_of(again.trajectory, time), attitudes_of(day.trajectory, time))


def test_slopes_of_a_day_with_a_track_that_is_led_are_refused_by_name():
    with pytest.raises(ValueError, match=r"activity links: it is led .* look_ahead = false"):
        jp.sensitivities(planned(True), "total_time")


def test_the_camera_sees_its_star():
    plan = planned(True)
    one = plan.activities[1]
    time = np.linspace(one.start, one.end, 41)
    craft = plan.scene.spacecraft
    seen = boresights(
        craft, attitudes_of(plan.trajectory, time), joints_of(plan.trajectory, time, orders=1)[0]
    )
    assert np.max(angle(seen[:, list(craft.device_names).index("camera")], STAR)) <= TOLERANCE
