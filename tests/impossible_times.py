"""Timelines that are too late, too fast, or start wrongly, or whose wheels are full."""

from dataclasses import replace

import numpy as np
from impossible import (
    AHEAD,
    AWAY,
    FIXED,
    SIDE,
    SITE,
    START,
    TILTED,
    Case,
    below,
    filled,
    going_round,
    holding,
    images,
    resting,
    started,
    swaying,
    talks,
    telescope_zone,
    tracking,
    turning,
    with_antenna,
    with_wheels,
)
from passing import deg, links, observer
from reference import unit

import jaxplan as jp

S = jp.Status
CASES = {
    "window a second too short": Case(
        lambda: talks(jp.Activity(name="asked", track=links("east", "west"), duration=41.0, latest=48.5)),
        S.OUT_OF_WINDOW,
        ("can end at 49.", "after its window", "begins at 0.00 s", "ends at 8."),
    ),
    "window that is over": Case(
        lambda: talks(resting("first", 30.0), resting(latest=20.0)),
        S.OUT_OF_WINDOW,
        ("can end at 35.0", "15.0", "after its window"),
    ),
    "window that is over for what lasts": Case(
        lambda: talks(resting("first", 30.0), jp.Activity(name="asked", track=links(), latest=20.0)),
        S.OUT_OF_WINDOW,
        ("can begin at", "after its end"),
    ),
    "window that ends before the slew to what lasts": Case(
        lambda: images(tracking({"telescope": -AHEAD}, latest=20.0), keep_out=()),
        S.OUT_OF_WINDOW,
        ("can begin at", "after its end"),
    ),
    "end of the timeline": Case(
        lambda: talks(resting("first", 30.0), resting(duration=30.5)),
        S.OUT_OF_WINDOW,
        ("can begin at 30.00 s at the earliest", "at least 0.50 s after the timeline", "60.00 s"),
    ),
    "end of the window before that of the timeline": Case(
        lambda: talks(resting("first", 30.0), resting(duration=30.5, latest=50.0)),
        S.OUT_OF_WINDOW,
        (
            "can begin at 30.00 s at the earliest",
            "at least 10.50 s after its window, which ends at 50.00 s",
            "let its window end later",
        ),
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
    "target too fast to follow": Case(
        lambda: images(tracking({"telescope": turning(AHEAD, 3.0)}, earliest=10.0, duration=5.0)),
        S.LIMITS_TOO_TIGHT,
        ("platform rate", "times its limit", " at 1"),
    ),
    "instant that comes before its target is seen": Case(
        lambda: images(
            tracking({"telescope": below("site", "its horizon", 0.0, 50.0, SITE)}, what="point", latest=30.0)
        ),
        S.OUT_OF_WINDOW,
        ("can end at 50.00 s", "20.00 s after its window", "site is hidden by its horizon until 50.00 s"),
    ),
    "instant whose window is over": Case(
        lambda: images(tracking({"telescope": -AHEAD}, what="point", latest=20.0), keep_out=()),
        S.OUT_OF_WINDOW,
        ("can end at", "after its window"),
    ),
    "wheels full in an attitude": Case(
        lambda: images(holding(TILTED.as_rotvec()), spacecraft=filled(0.9, 0.9), keep_out=()),
        S.LIMITS_TOO_TIGHT,
        (
            'wheel "wheel-',
            '" would hold 25.46 N m s at 10.00 s, of 20 N m s at most',
            "slowing down does not help: lower spacecraft.wheel.stored_nms",
            "another attitude",
        ),
    ),
    "wheels too small for a target": Case(
        lambda: images(
            tracking({"telescope": turning(AHEAD, 1.5)}, duration=5.0),
            spacecraft=with_wheels(momentum=1.2),
            keep_out=(),
        ),
        S.LIMITS_TOO_TIGHT,
        ('momentum of wheel "wheel-4"', "times its limit", "as targets move then"),
    ),
    "wheels too weak for a target": Case(
        lambda: images(
            tracking({"telescope": swaying(AHEAD, 0.5, 0.3)}, duration=25.0),
            spacecraft=with_wheels(torque=0.02),
            keep_out=(),
        ),
        S.LIMITS_TOO_TIGHT,
        ("wheel-", "torque", "times its limit"),
    ),
    "torque too weak for a target": Case(
        lambda: images(
            tracking({"telescope": swaying(AHEAD, 0.5, 0.3)}, duration=25.0),
            spacecraft=replace(observer(), wheels=(), torque_limit=np.full(3, 0.02)),
            keep_out=(),
        ),
        S.LIMITS_TOO_TIGHT,
        ("platform torque y", "times its limit"),
    ),
    "target that sways too fast": Case(
        lambda: images(tracking({"telescope": swaying(AHEAD, 1.5, 1.0)}, duration=15.0), keep_out=()),
        S.LIMITS_TOO_TIGHT,
        ("platform acceleration y", "2.9", "times its limit"),
    ),
    "target too fast for the length of a rate": Case(
        lambda: images(
            tracking({"telescope": turning(AHEAD, 1.5)}, duration=5.0),
            spacecraft=replace(observer(), rate_norm_limit=deg(1.0)),
            keep_out=(),
        ),
        S.LIMITS_TOO_TIGHT,
        ("platform rate length", "1.5 times its limit"),
    ),
    "target faster than a joint": Case(
        lambda: images(
            tracking(
                FIXED | {"antenna": going_round(START.attitude @ unit([1.0, 0, 0.5]), 4.5, AHEAD)},
                duration=5.0,
            ),
            keep_out=(),
        ),
        S.LIMITS_TOO_TIGHT,
        ("antenna yaw rate", "1.125 times its limit"),
    ),
    "target that a joint cannot accelerate with": Case(
        lambda: images(
            tracking(
                FIXED | {"antenna": swaying(SIDE, 3.0, 1.0, axis=START.attitude[:, 1])},
                duration=5.0,
            ),
            keep_out=(),
        ),
        S.LIMITS_TOO_TIGHT,
        ("antenna yaw acceleration", "times its limit"),
    ),
    "target faster than a drive": Case(
        lambda: images(
            tracking(FIXED | {"array": going_round(-AHEAD, 1.5, START.attitude[:, 1])}, duration=10.0),
            keep_out=(),
        ),
        S.LIMITS_TOO_TIGHT,
        ("array angle rate", "1.5 times its limit"),
    ),
    "attitude whose window is over": Case(
        lambda: images(holding(AWAY, latest=20.0), keep_out=()),
        S.OUT_OF_WINDOW,
        ("can end at", "after its window"),
    ),
    "attitude after the end of the timeline": Case(
        lambda: images(resting("first", 95.5), holding(AWAY), keep_out=()),
        S.OUT_OF_WINDOW,
        ("can begin at 96.00 s at the earliest", "at least 1.00 s after the timeline", "100.00 s"),
    ),
    "rest that comes too late": Case(
        lambda: started(images(resting(latest=6.0), keep_out=()), angular_velocity=deg(0.0, 1.9, 0.0)),
        S.OUT_OF_WINDOW,
        ("can end at 11.", "after its window"),
    ),
    "start too fast": Case(
        lambda: started(images(resting()), angular_velocity=deg(0.0, 2.5, 0.0)),
        S.INVALID_START,
        ("platform's rate about y", "2.5 deg/s, its limit 2 deg/s"),
    ),
    "start with a joint too fast": Case(
        lambda: started(images(resting()), joint_rates=deg(0.0, 5.0, 0.0)),
        S.INVALID_START,
        ("rate of antenna pitch", "5 deg/s, its limit 4 deg/s"),
    ),
    "start from which a joint cannot stop": Case(
        lambda: started(images(resting()), joint_rates=deg(0.0, 4.0, 0.0), joints=deg(0.0, 80.0, 0.0)),
        S.INVALID_START,
        ("antenna pitch", "5 deg from its limit of 85 deg", "cannot stop before it"),
    ),
    "what comes after a failed one": Case(
        lambda: images(replace(holding(AWAY, latest=5.2), name="first"), resting(after="first")),
        S.OUT_OF_WINDOW,
        ("first, after which it comes, is not done",),
        go_on=True,
    ),
}
