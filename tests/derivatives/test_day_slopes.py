"""Slopes of a day's total time by the keys of its file, beside differences of timelines planned anew."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import at_rest, make_spacecraft
from day_slopes import assert_slopes_are_differences, end_of
from kernels import nothing_new
from passing import observer
from reference import direction, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.timeline.choices import BOUND, NEEDED
from jaxplan.tuning import days

AGREE = 1e-4  # relative, of a slope and a difference of timelines planned anew
# Wheels reach their torque at places that soon change: the optimum has a corner there, and slopes to either
# side, which are 0.6 % apart.
AT_CORNERS = {"wheels": 3e-3}

CRAFT = make_spacecraft(2, 1)  # of all days that ask for no other, so that they have their kernels in common

# Bounds of turns are by a table, linear between its places: of turns at such places there are no slopes.
LOOK = at_rest([0.013, 0.007, 0.019], [0.6, 0.05, 0.1, 0.02])
TURNED = at_rest([0.041, 0.123, -0.217], [0.57, 0.03, 0.11, 0.01])
FAR = at_rest([0.11, -0.23, 1.07], [0.13, 0.01, 0.02, 0.07])


def day_of(*activities, craft=CRAFT, start=None, **more) -> jp.Timeline:
    """A timeline of a spacecraft, by itself CRAFT, whose shortest motions are at their optimum."""
    begin = at_rest(np.zeros(3), np.zeros(4)) if start is None else start
    scene = jp.Scenario(
        name="scene",
        spacecraft=craft,
        start=begin,
        goal=begin,
        trajectory=jp.TrajectorySettings(optimal=True),
    )
    return jp.Timeline(name="day", scene=scene, activities=activities, **more)


def joints_and_platform() -> jp.Timeline:
    """A joint's way, a rest, and a turn; each slew takes a little more than its bound."""
    return day_of(
        jp.Activity(name="look", attitude=LOOK, duration=5.0),
        jp.Activity(name="rest", idle=True, duration=7.0),
        jp.Activity(name="turn", attitude=TURNED, duration=9.0),
    )


def windows() -> jp.Timeline:
    """The same with a window before the turn, that is waited for, and a rest to the end."""
    look, rest, turn = joints_and_platform().activities
    back = jp.Activity(name="back", attitude=LOOK, duration=3.0)
    return day_of(look, rest, replace(turn, earliest=60.0), back, until=200.0)


def windows_in_the_time_there_is() -> jp.Timeline:
    """The same with slews that take all the time until a window opens."""
    return replace(windows(), slew="calm")


def far_turn() -> jp.Timeline:
    """A turn whose shortest motion takes longer than tried at first."""
    return day_of(jp.Activity(name="far", attitude=FAR, duration=4.0))


def stars() -> jp.Timeline:
    """Stars of a terminal, at an instant, and of a camera, for some time, each after the least turn there.

    The first star is so far up that the platform turns until the pitch of the terminal is near its limit.
    """
    star = Rotation.from_rotvec([0.21, 0.13, 0.31]).apply(CRAFT.instruments[0].boresight)
    return day_of(
        jp.Activity(name="beam", point=jp.Targets.of({"terminal-1": direction(0.3, 0.5)})),
        jp.Activity(name="star", track=jp.Targets.of({"camera-1": star}), duration=5.0),
        jp.Activity(name="look", attitude=at_rest([0.3, 0.1, 0.2], np.zeros(4)), duration=5.0),
    )


def moving(rate, first, pitch) -> jp.DirectionPath:
    """A direction that goes round at a rate, rad/s, from an azimuth at 0 s, and rises slowly."""
    times = np.linspace(0, 400.0, 81)
    return jp.DirectionPath.through(times, direction(first + rate * times, pitch + 1e-4 * times))


def ships() -> jp.Timeline:
    """Instants at targets that move, before a rest and after others."""
    ship, other = moving(1e-3, 0.3, 0.5), moving(1.3e-3, 0.6, 0.7)
    both = {"camera-1": other, "terminal-2": moving(-1e-3, 2.0, 0.1)}
    return day_of(
        jp.Activity(name="ship", point=jp.Targets.of({"camera-1": ship})),
        jp.Activity(name="both", point=jp.Targets.of(both)),
        jp.Activity(name="rest", idle=True, duration=5.0),
        jp.Activity(name="look", attitude=at_rest([0.3, 0.1, 0.2], np.zeros(4)), duration=5.0),
        until=400.0,
    )


def tracks() -> jp.Timeline:
    """Targets followed for a while by two terminals that leave the attitude free, after an instant."""
    wide = tuple(replace(one, pitch_limit=1.2) for one in CRAFT.terminals)
    pair = {"terminal-1": moving(-2e-3, 0.2, 0.4), "terminal-2": moving(1e-3, 3.0, -0.2)}
    return day_of(
        jp.Activity(name="ship", point=jp.Targets.of({"camera-1": moving(1e-3, 0.3, 0.5)})),
        jp.Activity(name="pair", track=jp.Targets.of(pair, tolerance=1e-4), duration=30.0),
        jp.Activity(name="look", attitude=at_rest([0.3, 0.1, 0.2], np.zeros(4)), duration=5.0),
        craft=replace(CRAFT, terminals=wide),
        until=400.0,
    )


def wheels() -> jp.Timeline:
    """An observer without devices whose wheels give all that its turns may have."""
    whole = observer()
    few = tuple(replace(one, torque=0.3, momentum=4.0, stored=0.6 * one.stored) for one in whole.wheels)
    return day_of(
        jp.Activity(name="over", attitude=at_rest([0.53, 0.07, 0.05], []), duration=3.0),
        jp.Activity(name="on", attitude=at_rest([0.47, 0.31, 0.13], []), duration=3.0),
        craft=replace(whole, terminals=(), drives=(), instruments=(), wheels=few),
        start=at_rest([0.11, 0.03, -0.02], []),
    )


DAYS = {
    "joints and platform": (joints_and_platform, {BOUND}, 12),
    "windows": (windows, {BOUND}, 5),
    "windows in the time there is": (windows_in_the_time_there_is, {BOUND}, 3),
    "stars": (stars, {BOUND}, 7),
    "ships": (ships, {BOUND}, 7),
    "tracks": (tracks, {BOUND}, 6),
    "wheels": (wheels, {NEEDED}, 6),
}
SOME = {
    "joints and platform": (
        "spacecraft.rate_limit_deg_s",
        "spacecraft.acceleration_limit_deg_s2",
        "spacecraft.terminal[0].rate_limit_deg_s",
        "spacecraft.terminal[0].acceleration_limit_deg_s2",
        "spacecraft.terminal[1].rate_limit_deg_s",
        "start.yaw_rad[0]",
        "activity[0].for_s",
        "activity[0].attitude[0]",
        "activity[0].yaw_rad[0]",
        "activity[0].pitch_rad[1]",
        "activity[1].for_s",
        "activity[2].attitude[0]",
        "activity[2].attitude[1]",
        "activity[2].attitude[2]",
    ),
    "windows": (
        "spacecraft.rate_limit_deg_s",
        "spacecraft.terminal[0].rate_limit_deg_s",
        "activity[0].for_s",
        "activity[2].from_s",
        "activity[2].for_s",
        "activity[2].attitude[0]",
        "activity[3].attitude[1]",
        "timeline.until_s",
    ),
    "windows in the time there is": (
        "spacecraft.rate_limit_deg_s",
        "spacecraft.terminal[0].rate_limit_deg_s",
        "activity[0].for_s",
        "activity[2].from_s",
        "activity[2].attitude[1]",
        "timeline.until_s",
    ),
    "stars": (
        "spacecraft.rate_limit_deg_s",
        "spacecraft.acceleration_limit_deg_s2",
        "start.attitude[0]",
        "start.attitude[1]",
        "start.attitude[2]",
        "spacecraft.terminal[0].pitch_limit_deg",
        "activity[1].for_s",
        "activity[2].attitude[0]",
        "activity[2].attitude[1]",
        "activity[2].attitude[2]",
    ),
    "ships": (
        "spacecraft.rate_limit_deg_s",
        "spacecraft.acceleration_limit_deg_s2",
        "spacecraft.terminal[0].rate_limit_deg_s",
        "spacecraft.terminal[1].pitch_limit_deg",
        "start.yaw_rad[0]",
        "start.attitude[1]",
        "activity[2].for_s",
        "activity[3].attitude[0]",
        "activity[3].attitude[1]",
    ),
    "tracks": (
        "spacecraft.rate_limit_deg_s",
        "spacecraft.acceleration_limit_deg_s2",
        "spacecraft.terminal[0].pitch_limit_deg",
        "start.attitude[1]",
        "start.attitude[2]",
        "activity[1].for_s",
        "activity[2].attitude[0]",
    ),
    "wheels": (
        "spacecraft.wheel[0].torque_nm",
        "spacecraft.wheel[1].momentum_nms",
        "spacecraft.wheel[2].stored_nms",
        "spacecraft.wheel[3].stored_nms",
        "start.attitude[0]",
        "activity[0].attitude[1]",
        "activity[1].attitude[2]",
    ),
}
QUICK = ("windows in the time there is",)
each_day = pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in DAYS]
)


@cache
def planned(make: Callable[[], jp.Timeline]) -> jp.TimelinePlan:
    return jp.plan_timeline(make(), progress=False)


@each_day
def test_slopes_of_the_total_time_are_differences_of_timelines_planned_anew(name):
    make, kinds, some = DAYS[name]
    plan = planned(make)
    assert kinds <= {one.time.kind for one in plan.choices if one.time is not None}
    assert assert_slopes_are_differences(plan, SOME[name], AT_CORNERS.get(name, AGREE)) >= some


@pytest.mark.slow
def test_days_that_differ_in_names_alone_share_their_kernels(compilations):
    plan = planned(stars)
    first, day = jp.sensitivities(plan), plan.timeline
    renamed = replace(
        day,
        name="the day after",
        scene=replace(day.scene, name="over the sea"),
        activities=tuple(replace(one, name=f"{one.name} again") for one in day.activities),
    )
    other = jp.plan_timeline(renamed, progress=False)
    with nothing_new(compilations):
        again = jp.sensitivities(other)
    assert [row.slope for row in again.rows] == [row.slope for row in first.rows]


@pytest.mark.slow
def test_slopes_by_samples_of_a_target_are_differences_of_days_planned_anew():
    plan = planned(ships)
    _, slopes, _ = days.day_slopes(plan)
    first, *others = plan.timeline.activities
    (path,), (own,) = (one.point.directions for one in (first, slopes.activities[0]))
    assert not np.any(own.slopes)
    way = np.asarray(own.samples) / np.linalg.norm(own.samples)

    def at(by):
        moved = jp.DirectionPath.through(path.times, unit(path.samples + by * way))
        changed = replace(first, point=replace(first.point, directions=(moved,)))
        return end_of(jp.plan_timeline(replace(plan.timeline, activities=(changed, *others)), progress=False))

    assert np.sum(own.samples * way) == pytest.approx((at(1e-4) - at(-1e-4)) / 2e-4, rel=AGREE)


def test_an_instant_at_its_window_moves_with_the_window():
    target = jp.Targets.of({"terminal-1": unit([0.9, 0.3, 0.316])})
    glance = jp.Activity(name="glance", point=target, earliest=100.0)
    found = jp.sensitivities(jp.plan_timeline(day_of(glance, until=200.0), progress=False))
    assert found.value == pytest.approx(100.0)
    assert found["activity[0].from_s"] == pytest.approx(1.0)


def test_nothing_before_a_window_that_is_waited_for_matters():
    found = jp.sensitivities(planned(windows))
    before = [
        name for name in found.without_effect if name.startswith(("activity[0]", "activity[1]", "start"))
    ]
    assert "activity[0].for_s" in before
    assert "start.yaw_rad[0]" in before
    assert not any(row.name in before for row in found.rows)
    assert found["activity[2].from_s"] == pytest.approx(1.0)
    assert found["timeline.until_s"] == 0  # rest after the last activity is not counted
    last = planned(windows).timeline.activities[2].name
    assert found.note.startswith(f"activity {last} ")
    assert "window" in found.note
    assert found.note.endswith(", so that nothing before that changes the total time")
    assert "changes the total time\nnot listed: numbers" in str(found).replace("\n  ", " ")
    assert jp.sensitivities(planned(joints_and_platform)).note == ""


def test_a_plan_that_was_read_has_the_slopes_of_the_one_that_was_written(tmp_path):
    plan = planned(joints_and_platform)
    plan.save(tmp_path / "plan.npz")
    read = jp.load_timeline_plan(tmp_path / "plan.npz")
    assert read.choices == ()
    first, again = jp.sensitivities(plan), jp.sensitivities(read)
    assert [row.name for row in again.rows] == [row.name for row in first.rows]
    slopes = np.array([[row.slope for row in own.rows] for own in (first, again)])
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-9)


def test_a_plan_that_is_another_one_when_planned_anew_is_refused():
    plan = planned(joints_and_platform)
    late = tuple(replace(one, end=one.end + 1.0) for one in plan.activities)
    with pytest.raises(ValueError, match="planned anew its activities end at other times"):
        jp.sensitivities(replace(plan, activities=late, choices=()))


def test_all_activities_without_derivatives_are_named_with_their_reasons():
    times = np.linspace(0.0, 200.0, 21)
    moving = jp.DirectionPath.through(times, direction(1e-3 * times, np.full(21, 0.5)))
    craft = make_spacecraft(2, 2)
    away = jp.Wish(device="camera-2", direction=-craft.instruments[1].boresight)
    glance = jp.Targets.of({"camera-1": np.array([0.0, 0.6, 0.8])}, prefer=(away,))
    day = day_of(
        jp.Activity(name="look", attitude=at_rest([0.1, 0.0, 0.0], np.zeros(4)), duration=5.0),
        jp.Activity(name="ship", track=jp.Targets.of({"camera-1": moving}), duration=5.0),
        jp.Activity(name="glance", point=glance),
        craft=craft,
        until=200.0,
    )
    coarse = replace(day.scene.trajectory, optimal=False)
    day = replace(day, scene=replace(day.scene, trajectory=coarse))
    plan = jp.plan_timeline(day, progress=False)
    with pytest.raises(ValueError, match="has no derivatives that are known: ") as refused:
        jp.sensitivities(plan)
    told = str(refused.value)
    assert "activity ship: its targets, zones or wishes make it move: set trajectory.optimal = true" in told
    assert "activity glance: its goal is as near as can be to what camera-2 would look at" in told
    assert "leave the wish out, or give it an attitude" in told
    assert "activity look" not in told


def test_no_shortest_motion_is_looked_for_where_an_activity_is_refused_anyway(monkeypatch):
    plan = planned(far_turn)
    monkeypatch.setattr(days, "expand_time", never)
    monkeypatch.setattr(days, "_state_rule", odd)
    with pytest.raises(ValueError, match="it is odd"):
        jp.sensitivities(plan)


def odd(_):
    raise ValueError("it is odd")


def never(*_, **__):
    raise AssertionError("this takes long, and is not needed")


def test_an_attitude_that_was_held_before_has_no_slopes_though_idle_has():
    """Any change of it adds the least slew."""
    first = jp.Activity(name="first", attitude=LOOK, duration=5.0)
    for second in (
        jp.Activity(name="second", attitude=LOOK, duration=5.0),
        jp.Activity(name="second", idle=True, duration=5.0),
    ):
        day = jp.plan_timeline(day_of(first, second), progress=False)
        assert day.activities[1].slew == 0
        if second.idle:
            assert jp.sensitivities(day, "total_time").rows
        else:
            with pytest.raises(ValueError, match="second: it keeps the attitude before it"):
                jp.sensitivities(day, "total_time")


def test_a_plan_that_failed_is_refused():
    plan = replace(planned(joints_and_platform), status=jp.Status.UNCERTIFIED)
    with pytest.raises(ValueError, match="ended as UNCERTIFIED: only an OK one"):
        jp.sensitivities(plan)


def test_what_is_no_measure_of_a_day_is_refused():
    with pytest.raises(
        ValueError, match="unknown measure 'effort' of a timeline's plan: must be 'total_time'"
    ):
        jp.sensitivities(planned(windows), "effort")


@pytest.mark.slow
def test_plans_above_the_optimum_have_its_total_time_and_slopes():
    best = planned(far_turn)
    assert NEEDED in {one.time.kind for one in best.choices}
    scene = best.timeline.scene
    coarse = replace(scene, trajectory=replace(scene.trajectory, optimal=False))
    above = jp.plan_timeline(replace(best.timeline, scene=coarse), progress=False)
    found = jp.sensitivities(above)
    assert found.value == pytest.approx(end_of(above), rel=1e-3)
    names = (
        "spacecraft.rate_limit_deg_s",
        "spacecraft.acceleration_limit_deg_s2",
        "start.attitude[1]",
        "activity[0].attitude[2]",
    )
    assert assert_slopes_are_differences(best, names, AGREE, found) == len(names)


def test_a_day_that_looks_ahead_and_leads_no_track_keeps_its_slopes():
    plain, ahead = (
        jp.plan_timeline(replace(stars(), look_ahead=look_ahead), progress=False)
        for look_ahead in (False, True)
    )
    assert not any(choice.motion.led for choice in ahead.choices)
    found = [jp.sensitivities(plan, "total_time") for plan in (plain, ahead)]
    assert found[0].value == found[1].value
    names = ("spacecraft.acceleration_limit_deg_s2", "activity[1].for_s")
    assert [found[0][name] for name in names] == [found[1][name] for name in names]
    assert found[1]["activity[1].for_s"] == pytest.approx(1.0, abs=1e-6)
