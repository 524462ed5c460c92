"""Timelines that cannot be done, each with the status and the words that say why: what they are made of.

The cases themselves are tables in `impossible_places`, of where devices and the body point, and in
`impossible_times`, of windows, limits and starts.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from passing import LOW, Aim, deg, observer, observer_scene, relay, relay_scene, site
from reference import unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.hidden_spans import Hidden

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


def swaying(first, size, rate, axis=NORTH) -> Aim:
    """A direction that sways by a size, deg, at a rate, rad/s, about a first one."""
    about = unit(np.cross(first, axis))
    return Aim(
        lambda time: Rotation.from_rotvec(np.multiply.outer(deg(size) * np.sin(rate * time), about)).apply(
            first
        ),
        step=0.5,
    )


def going_round(first, rate, about) -> Aim:
    """A direction that goes round an axis at a rate, deg/s."""
    return Aim(
        lambda time: Rotation.from_rotvec(np.multiply.outer(deg(rate) * time, about)).apply(first), step=1.0
    )


def holding(rotation_vector, joints=(0.0, 0.0, 0.0), **more):
    """An activity that holds an attitude."""
    state = jp.GivenState(rotation_vector=np.asarray(rotation_vector), joints=np.asarray(joints))
    return jp.Activity(name="asked", attitude=state, **{"duration": 5.0} | more)


def resting(name="asked", duration=5.0, **more):
    return jp.Activity(name=name, idle=True, duration=duration, **more)


def images(*activities, until=100.0, **scene):
    return jp.Timeline(name="images", scene=observer_scene(**scene), activities=activities, until=until)


def talks(*activities, until=60.0, **scene):
    return jp.Timeline(name="talks", scene=relay_scene(**scene), activities=activities, until=until)


def started(timeline, **changes):
    """A timeline that starts otherwise."""
    scene = timeline.scene
    return replace(timeline, scene=replace(scene, start=replace(scene.start, **changes)))


def antenna_zone(name, direction, half_angle, kind=jp.KeepOut):
    return kind(name=name, direction=direction, half_angle=deg(half_angle), devices=("antenna",))


def telescope_zone(name, direction, half_angle, kind=jp.KeepOut):
    return kind(name=name, direction=direction, half_angle=deg(half_angle), devices=("telescope",))


def with_antenna(**changes):
    craft = observer()
    return replace(craft, terminals=(replace(craft.terminals[0], **changes),))


def masked_relay():
    craft = relay()
    corners = deg(10, 10, 30, 10, 30, 30, 10, 30).reshape(4, 2)
    return replace(craft, terminals=(replace(craft.terminals[0], mask=(corners,)), *craft.terminals[1:]))


def with_wheels(**changes):
    craft = observer()
    return replace(craft, wheels=tuple(replace(wheel, **changes) for wheel in craft.wheels))


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
    go_on: bool = False


BOTH = {"telescope": SITE, "antenna": beside(SITE, 45.0)}
SIDE = START.attitude[:, 0]  # where its antenna looks
TURNED = Rotation.from_rotvec(AWAY).as_matrix()
FIXED = {
    "telescope": AHEAD,
    "camera": START.attitude @ observer().instruments[1].boresight,
}  # which holds all
TILTED = Rotation.from_matrix(START.attitude) * Rotation.from_rotvec([0, np.pi / 4, 0])
BLINKING = (
    Hidden(target="blinker", by="its horizon", start=-1.0, end=20.0),
    Hidden(target="blinker", by="the Earth", start=25.0, end=3000.0),
)
