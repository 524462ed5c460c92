"""Timelines that ask for directions or attitudes that cannot be: hidden, out of range, in a zone."""

from dataclasses import replace

import numpy as np
from impossible import (
    AHEAD,
    AWAY,
    BLINKING,
    BOTH,
    FIXED,
    NORTH,
    SIDE,
    SITE,
    START,
    TURNED,
    Case,
    antenna_zone,
    below,
    beside,
    holding,
    images,
    masked_relay,
    resting,
    talks,
    telescope_zone,
    tracking,
    turning,
    with_antenna,
)
from passing import LINKS, NADIR, OTHERS, SUN, deg, links, observer_zones, relay_scene, relay_zones
from reference import unit
from scipy.spatial.transform import Rotation

import jaxplan as jp

S = jp.Status
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
    "link that the Sun outshines": Case(
        lambda: talks(
            tracking({"fore": below("friend", "the Sun", 0.0, 3000.0, LINKS["fore"])}, duration=5.0)
        ),
        S.INVALID_GOAL,
        ("friend, the target of fore", "hidden by the Sun", "3000.00 s"),
    ),
    "target that is not seen for long enough": Case(
        lambda: images(tracking({"telescope": replace(SITE, hidden=BLINKING)}, duration=10.0)),
        S.INVALID_GOAL,
        ("blinker, the target of telescope", "hidden by its horizon", "20.00 s"),
    ),
    "instant with a joint out of range": Case(
        lambda: images(tracking(BOTH, what="point"), spacecraft=with_antenna(pitch_range=deg(-10.0, 10.0))),
        S.GOAL_UNREACHABLE,
        ("antenna pitch", "beyond its limit of 10 deg"),
    ),
    "instant of two instruments whose targets do not fit": Case(
        lambda: images(tracking({"telescope": SITE, "camera": -SUN}, what="point")),
        S.GOAL_UNREACHABLE,
        ("telescope and camera", "5.71059 deg apart", "their targets"),
    ),
    "switch whose masks forbid it": Case(
        lambda: images(
            replace(tracking(FIXED | {"antenna": SIDE}, duration=5.0), name="first"),
            tracking(FIXED | {"antenna": START.attitude @ unit([1.0, 1.0, 0.5])}, duration=5.0),
            spacecraft=with_antenna(mask=(deg(20, 0, 80, 0, 80, 60, 20, 60).reshape(4, 2),)),
            keep_out=(),
        ),
        S.GOAL_UNREACHABLE,
        ("antenna", "19.47 deg inside mask 1 of antenna"),
    ),
    "one target for two terminals that look away from each other": Case(
        lambda: talks(tracking({"east": LINKS["east"], "west": LINKS["east"]}, duration=5.0), keep_out=()),
        S.GOAL_UNREACHABLE,
        ("east yaw", "west yaw", "10 deg beyond its limit of 80 deg"),
    ),
    "target that leaves a keep-in zone": Case(
        lambda: images(
            tracking({"telescope": turning(AHEAD, 0.5)}, duration=60.0),
            keep_out=(),
            keep_in=(telescope_zone("sky", AHEAD, 20.0, jp.KeepIn),),
        ),
        S.GOAL_UNREACHABLE,
        ("telescope", "15 deg outside keep-in zone sky", " at 70.00 s"),
    ),
    "target out of a keep-in zone": Case(
        lambda: images(
            tracking({"antenna": -SIDE}, duration=5.0),
            keep_out=(),
            keep_in=(antenna_zone("sky", SIDE, 60.0, jp.KeepIn),),
        ),
        S.GOAL_UNREACHABLE,
        ("antenna", "120 deg outside keep-in zone sky"),
    ),
    "zone that comes to a device that is held": Case(
        lambda: images(
            jp.Activity(
                name="asked",
                track=jp.Targets.of(FIXED, tolerance=deg(0.01), hold=("antenna",)),
                duration=60.0,
            ),
            keep_out=(antenna_zone("passer", turning(SIDE, 0.5, since=40.0).path(200.0), 8.0),),
        ),
        S.GOAL_UNREACHABLE,
        ("antenna", "8 deg inside keep-out zone passer", " at 40.00 s"),
    ),
    "zone that only errors reach": Case(
        lambda: images(
            tracking({"telescope": unit(SUN + np.tan(deg(31)) * unit(np.cross(SUN, NORTH)))}, duration=5.0),
            robust=jp.Robust(attitude_error=deg(1.5)),
        ),
        S.GOAL_UNREACHABLE,
        ("telescope", "0.5 deg inside keep-out zone sun"),
    ),
    "attitude with an antenna in a zone": Case(
        lambda: images(holding(AWAY), keep_out=(antenna_zone("moon", TURNED[:, 0], 10.0),)),
        S.INVALID_GOAL,
        ("antenna", "10 deg inside keep-out zone moon"),
    ),
    "attitude with a drive out of range": Case(
        lambda: images(holding(START.rotation_vector, (0, 0, 3.3))),
        S.INVALID_GOAL,
        ("array angle", "9.076 deg beyond its limit of 180 deg"),
    ),
}
