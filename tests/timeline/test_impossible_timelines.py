"""What cannot be done is refused by name, with the device, zone, joint or second that is in the way."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from passing import (
    LINKS,
    LOW,
    NADIR,
    OTHERS,
    SUN,
    Aim,
    deg,
    links,
    observer,
    observer_scene,
    observer_zones,
    relay,
    relay_scene,
    relay_zones,
    site,
)
from reference import unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.hidden import Hidden

SITE = site(LOW, 250.0, 1.0)  # seen until 601 s
NORTH = np.array([0.0, 0.0, 1.0])
AWAY = np.array([1.0, 0.5, 0.0])  # rotation vector of an attitude far from the observer's start
START = observer_scene().start
AHEAD = START.attitude[:, 2]  # where its telescope looks


def tracking(aims, **more):
    """An activity that tracks aims, paths or fixed directions by name of device."""
    each = {name: aim.path() if isinstance(aim, Aim) else aim for name, aim in aims.items()}
    what = more.pop("what", "track")
    return jp.Activity(name="asked", **{what: jp.Targets.of(each, tolerance=deg(0.01))}, **more)


def beside(aim: Aim, apart: float, seed=(0.3, 0.2, 0.9)) -> Aim:
    """A direction at a steady angle, deg, from an aim."""

    def at(time):
        ahead = aim.at(time)
        return np.cos(deg(apart)) * ahead + np.sin(deg(apart)) * unit(np.cross(ahead, seed))

    return Aim(at, step=aim.step)


def turning(first, rate, axis=NORTH, since=0.0) -> Aim:
    """A direction that turns at a steady rate, deg/s, from a first one on."""
    about = unit(np.cross(first, axis))
    return Aim(
        lambda time: Rotation.from_rotvec(np.multiply.outer(deg(rate) * (time - since), about)).apply(first),
        step=1.0,
    )


def holding(rotation_vector, joints=(0.0, 0.0, 0.0), **more):
    """An activity that holds an attitude."""
    state = jp.GivenState(rotation_vector=np.asarray(rotation_vector), joints=np.asarray(joints))
    return jp.Activity(name="asked", attitude=state, duration=5.0, **more)


def resting(name="asked", duration=5.0, **more):
    return jp.Activity(name=name, idle=True, duration=duration, **more)


def images(*activities, until=100.0, **scene):
    return jp.Timeline(name="images", scene=observer_scene(**scene), activities=activities, until=until)


def talks(*activities, until=60.0, **scene):
    return jp.Timeline(name="talks", scene=relay_scene(**scene), activities=activities, until=until)


def telescope_zone(name, direction, half_angle, kind=jp.KeepOut):
    return kind(name=name, direction=direction, half_angle=deg(half_angle), devices=("telescope",))


def with_antenna(**changes):
    craft = observer()
    return replace(craft, terminals=(replace(craft.terminals[0], **changes),))


def masked_relay():
    craft = relay()
    corners = deg(10, 10, 30, 10, 30, 30, 10, 30).reshape(4, 2)
    return replace(craft, terminals=(replace(craft.terminals[0], mask=(corners,)), *craft.terminals[1:]))


def filled(first, others=0.0):
    """The observer with wheels that hold a part of what they can."""
    craft = observer()
    stored = [first, *[others] * 3]
    wheels = (replace(wheel, stored=20.0 * own) for wheel, own in zip(craft.wheels, stored, strict=True))
    return replace(craft, wheels=tuple(wheels))


def below(target, by, start, end, aim):
    return replace(aim, hidden=(Hidden(target=target, by=by, start=start, end=end),))


@dataclass(frozen=True)
class Case:
    """A timeline that cannot be done, the status that says so, and what its message must say."""

    make: Callable[[], jp.Timeline]
    status: jp.Status
    words: tuple[str, ...]


S = jp.Status
BOTH = {"telescope": SITE, "antenna": beside(SITE, 45.0)}
CASES = {
    "target behind the Earth": Case(
        lambda: talks(
            tracking({"fore": below("friend", "the Earth", 0.0, 3000.0, NADIR)}, duration=5.0), keep_out=()
        ),
        S.INVALID_GOAL,
        ("friend, the target of fore", "hidden by the Earth", "0.00 s", "3000.00 s"),
    ),
    "target below its horizon": Case(
        lambda: images(tracking({"telescope": SITE}, earliest=700.0, duration=10.0), until=900.0),
        S.INVALID_GOAL,
        ("site at 250", "telescope", "its horizon", "601.00 s"),
    ),
    "target that sets too soon": Case(
        lambda: images(tracking({"telescope": SITE}, earliest=595.0, duration=10.0), until=900.0),
        S.INVALID_GOAL,
        ("site at 250", "telescope", "its horizon", "601.00 s"),
    ),
    "instant at which a target is hidden": Case(
        lambda: images(tracking({"telescope": SITE}, what="point", earliest=700.0), until=900.0),
        S.INVALID_GOAL,
        ("site at 250", "telescope", "its horizon", "601.00 s"),
    ),
    "target in a keep-out zone": Case(
        lambda: talks(tracking({"fore": SUN}, duration=5.0)),
        S.GOAL_UNREACHABLE,
        ("fore", "inside keep-out zone sun", "8 deg"),
    ),
    "target in a zone that moves": Case(
        lambda: talks(tracking({"west": NADIR}, duration=5.0)),
        S.GOAL_UNREACHABLE,
        ("west", "inside keep-out zone earth", "68.0"),
    ),
    "target that goes into a zone": Case(
        lambda: images(tracking({"telescope": turning(SUN, 0.5, since=100.0)}, duration=100.0), until=150.0),
        S.GOAL_UNREACHABLE,
        ("telescope", "inside keep-out zone sun", " at "),
    ),
    "instant in a zone": Case(
        lambda: images(tracking({"telescope": SUN}, what="point")),
        S.INVALID_GOAL,
        ("telescope", "inside keep-out zone sun"),
    ),
    "window a second too short": Case(
        lambda: talks(jp.Activity(name="asked", track=links("east", "west"), duration=41.0, latest=48.5)),
        S.OUT_OF_WINDOW,
        ("can end at 49.", "after its window", "begins at 0.00 s", "ends at 8."),
    ),
    "window that is over": Case(
        lambda: talks(resting("first", 30.0), resting(latest=20.0)),
        S.OUT_OF_WINDOW,
        ("can end at 36.0", "16.0", "after its window"),
    ),
    "window that is over for what lasts": Case(
        lambda: talks(resting("first", 30.0), jp.Activity(name="asked", track=links(), latest=20.0)),
        S.OUT_OF_WINDOW,
        ("can begin at", "after its end"),
    ),
    "end of the timeline": Case(
        lambda: talks(resting("first", 30.0), resting(duration=29.5)),
        S.OUT_OF_WINDOW,
        ("begun at 31.00 s", "0.50 s after the timeline", "60.00 s"),
    ),
    "mask in the way of an attitude": Case(
        lambda: talks(
            holding(relay_scene().start.rotation_vector, deg(20, 0, 0, 0, 20, 0, 0, 0)),
            spacecraft=masked_relay(),
            keep_out=(),
        ),
        S.INVALID_GOAL,
        ("fore", "inside mask 1 of fore", "10 deg"),
    ),
    "mask in the way of targets": Case(
        lambda: images(
            tracking(BOTH, duration=5.0),
            spacecraft=with_antenna(mask=(deg(-170, 30, 170, 30, 170, 60, -170, 60).reshape(4, 2),)),
        ),
        S.GOAL_UNREACHABLE,
        ("antenna", "mask 1 of antenna"),
    ),
    "range of a joint too small": Case(
        lambda: images(tracking(BOTH, duration=5.0), spacecraft=with_antenna(pitch_range=deg(-10.0, 10.0))),
        S.GOAL_UNREACHABLE,
        ("antenna pitch", "beyond its limit of 10 deg"),
    ),
    "attitude with a joint out of range": Case(
        lambda: images(holding(START.rotation_vector, (0.0, 1.6, 0.0))),
        S.INVALID_GOAL,
        ("antenna pitch", "6.673 deg beyond its limit of 85 deg"),
    ),
    "two instruments whose targets do not fit": Case(
        lambda: images(tracking({"telescope": SITE, "camera": -SUN}, duration=5.0)),
        S.GOAL_UNREACHABLE,
        ("telescope and camera", "5.71059 deg apart", "their targets"),
    ),
    "drive that cannot reach its target": Case(
        lambda: images(
            tracking(
                {
                    "telescope": SITE,
                    "camera": beside(SITE, float(np.rad2deg(np.arctan(0.1)))),
                    "array": beside(SITE, 80.0, (1.0, 0.0, 0.0)),
                },
                duration=5.0,
            )
        ),
        S.GOAL_UNREACHABLE,
        ("array", "off its target"),
    ),
    "attitude in a zone": Case(
        lambda: images(holding(Rotation.align_vectors([SUN], [NORTH])[0].as_rotvec())),
        S.INVALID_GOAL,
        ("telescope", "30 deg inside keep-out zone sun"),
    ),
    "attitude out of a keep-in zone": Case(
        lambda: images(holding(AWAY), keep_in=(telescope_zone("here", AHEAD, 20.0, jp.KeepIn),)),
        S.INVALID_GOAL,
        ("telescope", "outside keep-in zone here"),
    ),
    "attitude into which a zone moves": Case(
        lambda: images(
            replace(holding(START.rotation_vector), duration=60.0),
            keep_out=(telescope_zone("passer", turning(AHEAD, 0.5, since=50.0).path(200.0), 8.0),),
        ),
        S.INVALID_GOAL,
        ("telescope", "inside keep-out zone passer", " at 4"),
    ),
    "rest in a sky that runs away": Case(
        lambda: images(
            resting(duration=50.0),
            keep_in=(telescope_zone("sky", turning(AHEAD, 5.0).path(200.0), 10.0, jp.KeepIn),),
        ),
        S.GOAL_UNREACHABLE,
        ("telescope", "outside keep-in zone sky", " at "),
    ),
    "start in a zone": Case(
        lambda: images(resting(), keep_out=(telescope_zone("moon", AHEAD, 5.0),)),
        S.INVALID_START,
        ("telescope", "5 deg inside keep-out zone moon"),
    ),
    "start out of range": Case(
        lambda: images(resting(), spacecraft=with_antenna(yaw_range=deg(10.0, 170.0))),
        S.INVALID_START,
        ("antenna yaw", "10 deg beyond its limit of 10 deg"),
    ),
    "start whose wheels the reserve overfills": Case(
        lambda: images(resting(), spacecraft=filled(0.95), robust=jp.Robust(momentum_reserve=20.0)),
        S.INVALID_START,
        ("wheel-1",),
    ),
    "beam in another beam": Case(
        lambda: images(
            tracking(BOTH, duration=5.0),
            keep_out=(
                jp.KeepOut(name="beam", axis_device="telescope", devices=("antenna",), half_angle=deg(60)),
            ),
        ),
        S.GOAL_UNREACHABLE,
        ("antenna", "beam"),
    ),
    "structure in the way": Case(
        lambda: images(
            tracking(BOTH, duration=5.0),
            keep_out=(
                *observer_zones(),
                jp.KeepOut(name="boom", axis_body=NORTH, devices=("antenna",), half_angle=deg(60)),
            ),
        ),
        S.GOAL_UNREACHABLE,
        ("antenna", "boom"),
    ),
    "target too fast to follow": Case(
        lambda: images(tracking({"telescope": turning(AHEAD, 3.0)}, earliest=10.0, duration=5.0)),
        S.LIMITS_TOO_TIGHT,
        ("platform rate y", "1.48", "times its limit", " at 1"),
    ),
    "target too fast for an instant": Case(
        lambda: images(tracking({"telescope": turning(AHEAD, 3.0)}, what="point", earliest=10.0)),
        S.INVALID_GOAL,
        ("platform's rate about y", "2.97", "its limit 2 deg/s", "10.00 s"),
    ),
    "two terminals whose targets pass each other's zones": Case(
        lambda: talks(
            jp.Activity(name="asked", track=links("east"), duration=5.0),
            keep_out=(
                *relay_zones(),
                jp.KeepOut(
                    name="side",
                    direction=OTHERS["east"].at(np.array([20.0]))[0],
                    half_angle=deg(3),
                    devices=("east",),
                ),
            ),
        ),
        S.GOAL_UNREACHABLE,
        ("east", "inside keep-out zone side", " at "),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_cannot_be_done_is_refused_by_name(name):
    case = CASES[name]
    plan = jp.plan_timeline(case.make(), throw=False, progress=False)
    asked = plan.activities[-1]
    assert not plan.ok
    assert not asked.ok
    assert asked.status is case.status, asked.message
    assert plan.status is case.status
    for word in case.words:
        assert word in asked.message
    assert f"activity {asked.name}: " in plan.message
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


def test_the_refusal_of_a_second_activity_leaves_the_plan_of_the_first():
    whole = talks(resting("first", 10.0), tracking({"fore": SUN}, duration=5.0), resting("last"))
    plan = jp.plan_timeline(whole, throw=False, progress=False)
    assert [one.name for one in plan.activities] == ["first", "asked"]
    assert plan.certificate.certified
    assert plan.trajectory.duration == plan.activities[0].end
    assert set(LINKS) == {one.name for one in plan.timeline.scene.spacecraft.terminals}
