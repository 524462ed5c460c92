"""Slopes of days as engineers write them: wishes, starts with rates, tolerances, devices that give way."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import at_rest, make_spacecraft
from day_slopes import assert_slopes_are_differences
from reference import direction, unit

import jaxplan as jp
from jaxplan import so3
from jaxplan.goal import decompose
from jaxplan.goal.derivative import differentiable_goal
from jaxplan.goal.followed_goal import with_wishes_met

AGREE = 1e-6  # relative, of a slope and a difference of timelines planned anew
# Its slews are tried in multiples of a shortest motion, which differences know to a hundred-thousandth.
AT_TRIES = {"a coarse tolerance": 1e-4}
SUN = unit([-0.8, 0.1, -0.6])
STAR = unit([0.5, 0.2, 0.84])
BEGIN = at_rest([0.1, 0.2, 0.3], [0.2, 0.5, 0.3])
LOOK = jp.Activity(name="look", attitude=at_rest([0.3, 0.1, 0.2], [0.1, 0.4, 0.0]), duration=5.0)


def imager() -> jp.Spacecraft:
    """A camera fixed to the body, an antenna that lifts from the horizontal, and an array on a drive."""
    antenna = make_spacecraft(1).terminals[0]
    axis = unit([0.1, 1.0, 0.05])
    return jp.Spacecraft(
        terminals=(replace(antenna, name="antenna", pitch_range=(0.0, 1.2), pitch_limit=None),),
        drives=(
            jp.Drive(
                name="array",
                axis=axis,
                boresight=unit(np.cross([1.0, 0.0, 0.0], axis)),
                range=(-3.0, 3.0),
                rate_limit=0.05,
                acceleration_limit=0.03,
            ),
        ),
        instruments=(
            jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),
            jp.Instrument(name="tracker", boresight=unit([0.6, 0.1, -0.8])),
        ),
        rate_limit=np.deg2rad(1.5),
        acceleration_limit=np.deg2rad(0.3),
    )


def day_of(*activities, start=BEGIN, zones=(), optimal=True, **more) -> jp.Timeline:
    """A timeline of the imager."""
    scene = jp.Scenario(
        name="scene",
        spacecraft=imager(),
        start=start,
        goal=start,
        keep_out=zones,
        trajectory=jp.TrajectorySettings(optimal=optimal),
    )
    return jp.Timeline(name="day", scene=scene, activities=activities, **more)


def passing(rate, first, height) -> jp.DirectionPath:
    """A direction at a height that goes round at a rate, rad/s, from an azimuth at 0 s, rad."""
    times = np.linspace(0, 400.0, 81)
    return jp.DirectionPath.through(times, direction(first + rate * times, height + 1e-4 * times))


def targets(path, tolerance=1e-4, *, wish=True) -> jp.Targets:
    """A target of the camera, while the array comes to face the Sun if it has a `wish`."""
    wishes = (jp.Wish(device="array", direction=SUN),) if wish else ()
    return jp.Targets.of({"camera": path}, tolerance=tolerance, prefer=wishes)


def at_rates() -> jp.Timeline:
    """A start in the local frame, which has rates."""
    start = replace(BEGIN, angular_velocity=np.array([2e-4, 1e-3, -1e-4]))
    return day_of(LOOK, start=start)


def wishes() -> jp.Timeline:
    """An instant and a star, at which the array faces the Sun as nearly as it can."""
    return day_of(
        jp.Activity(name="star", track=targets(STAR), duration=20.0),
        jp.Activity(name="glance", point=targets(unit([0.45, 0.3, 0.84]))),
        LOOK,
    )


def wishes_of_moving() -> jp.Timeline:
    """A ship that the camera follows, while the array does the Sun."""
    ship = jp.Activity(name="ship", track=targets(passing(1e-3, 0.3, 0.9)), duration=20.0)
    return day_of(ship, LOOK, until=400.0)


def out_of_reach() -> jp.Timeline:
    """A ship that the camera follows at the largest rate, while the tracker comes no nearer to its wish."""
    asked = replace(targets(passing(1e-3, 0.3, 0.9)), prefer=(jp.Wish(device="tracker", direction=SUN),))
    return day_of(jp.Activity(name="ship", track=asked, duration=20.0), LOOK, until=400.0)


def coarse_tolerance() -> jp.Timeline:
    """An instant at which the camera may be off by a twentieth of a degree."""
    return day_of(jp.Activity(name="star", point=targets(STAR, 1e-3, wish=False)))


def antenna_in_the_way() -> jp.Timeline:
    """A ship that is followed while the antenna keeps just some room from a zone."""
    zone = jp.KeepOut(
        name="sun",
        direction=unit([0.8617, 0.5052, 0.0473]),
        half_angle=0.2,
        devices=("antenna",),
    )
    ship = jp.Activity(name="ship", track=targets(passing(2e-3, 0.3, 0.9), wish=False), duration=20.0)
    swing = at_rest([0.09, 0.43, 0.06], [-1.1, 0.4, 0.3])
    return day_of(ship, jp.Activity(name="swing", attitude=swing, duration=5.0), zones=(zone,), until=400.0)


def rest_in_the_way() -> jp.Timeline:
    """A rest in which the Moon comes by, so that the antenna gives way."""
    times = np.linspace(0, 400.0, 81)
    moon = jp.DirectionPath.through(times, direction(0.4 - 2.5e-3 * times, 0.55 + 0 * times))
    zone = jp.KeepOut(name="moon", direction=moon, half_angle=0.1, devices=("antenna",))
    return day_of(
        jp.Activity(name="first", attitude=at_rest([0, 0, 0.01], [0.2, 0.5, 0.2]), duration=3.0),
        jp.Activity(name="rest", idle=True, duration=30.0),
        jp.Activity(name="swing", attitude=at_rest([0, 0, 0.013], [0.1, 1.1, 0.2]), duration=5.0),
        start=at_rest(np.zeros(3), [0.2, 0.5, 0.3]),
        zones=(zone,),
        until=400.0,
    )


DAYS = {
    "a start with rates": (
        at_rates,
        ("start.angular_velocity_rad_s[1]", "start.attitude[1]", "activity[0].attitude[2]"),
    ),
    "wishes": (wishes, ("activity[0].for_s", "start.attitude[2]", "spacecraft.acceleration_limit_deg_s2")),
    "wishes of moving": (
        wishes_of_moving,
        ("activity[0].for_s", "start.attitude[0]", "spacecraft.drive[0].rate_limit_deg_s"),
    ),
    "a wish out of reach": (
        out_of_reach,
        ("activity[0].for_s", "start.attitude[0]", "spacecraft.rate_limit_deg_s"),
    ),
    "a coarse tolerance": (coarse_tolerance, ("start.attitude[0]", "spacecraft.acceleration_limit_deg_s2")),
    "an antenna in the way": (
        antenna_in_the_way,
        ("activity[0].for_s", "start.yaw_rad[0]", "activity[1].yaw_rad[0]", "keep_out[0].half_angle_deg"),
    ),
    "rest in the way": (
        rest_in_the_way,
        (
            "activity[0].for_s",
            "activity[2].pitch_rad[0]",
            "keep_out[0].half_angle_deg",
        ),
    ),
}
QUICK = ("a start with rates",)
each_day = pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in DAYS]
)


@each_day
def test_slopes_of_realistic_days_are_differences_of_timelines_planned_anew(name):
    make, keys = DAYS[name]
    plan = jp.plan_timeline(make(), progress=False)
    assert assert_slopes_are_differences(plan, keys, AT_TRIES.get(name, AGREE)) == len(keys)


def test_what_comes_before_a_window_that_is_waited_for_is_not_followed():
    ship = jp.Activity(name="ship", track=targets(passing(1e-3, 0.3, 0.9), wish=False), duration=20.0)
    day = day_of(ship, replace(LOOK, earliest=150.0), optimal=False, until=400.0)
    found = jp.sensitivities(jp.plan_timeline(day, progress=False))
    assert found.value == pytest.approx(155.0)
    assert {row.name: row.slope for row in found.rows} == {
        "activity[1].from_s": 1.0,
        "activity[1].for_s": 1.0,
    }


def test_an_instrument_looks_at_the_middle_of_its_target():
    plan = jp.plan_timeline(coarse_tolerance(), progress=False)
    attitude = plan.choices[0].goal.attitude
    assert np.linalg.norm(attitude[:, 2] - STAR) <= 1e-7


def test_a_goal_that_meets_a_wish_follows_its_target():
    craft, start = imager(), so3.exp(np.array(BEGIN.rotation_vector))
    wanted = replace(targets(STAR), criterion="least_rotation", tolerance=1e-8)
    rows, axis = day_of(LOOK).scene.constraints, np.array([0.3, -0.5, 0.8])

    def asked(share):
        return replace(wanted, directions=(STAR + share * axis)[None])

    def found(share):
        near = replace(asked(share), directions=unit(asked(share).directions))
        goal = decompose(craft, start, near, rows, start_joints=BEGIN.joints).goals[0]
        return with_wishes_met(goal, craft, start, near, rows, BEGIN.joints)

    goal, ahead, behind = (found(share) for share in (0.0, 1e-5, -1e-5))
    with jax.enable_x64(True):

        def followed(share):
            own = {"start_joints": BEGIN.joints, "moves": (), "met": (0,)}
            after = differentiable_goal(goal, craft, start, asked(share), rows, **own)
            return after.attitude, after.joints

        _, slopes = jax.jvp(followed, (0.0,), (1.0,))
    np.testing.assert_allclose(slopes[0], (ahead.attitude - behind.attitude) / 2e-5, atol=1e-7)
    np.testing.assert_allclose(slopes[1], (ahead.joints - behind.joints) / 2e-5, atol=1e-7)
    assert np.linalg.norm(slopes[0]) > 0.1
    assert np.linalg.norm(slopes[1]) > 0.1
