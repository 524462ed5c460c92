"""Derivatives of where devices without a target make way, beside places found anew."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_spacecraft
from quick import quick_jit
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan import so3
from jaxplan.goal.aims import goal_ranges
from jaxplan.goal.free_devices import SPARE, places, preferred, settled
from jaxplan.goal.problem import GoalProblem, Wished
from jaxplan.model.tabulation import tabulate

ATTITUDE = Rotation.from_rotvec([0.4, -0.7, 0.3]).as_matrix()
JOINTS = np.array([0.1, -0.2, 0.05, 0.07, 0.3])  # yaws, pitches, the drive's angle
STEP = 1e-4  # rad


def scene_at(p, wish=None):
    """Attitude, spacecraft, constraints, targets and joints where all that matters is changed by p (18,).

    The beam of terminal-1 is in the way of terminal-2, and a cone of the sky in that of a drive.
    """
    craft = make_spacecraft(2)
    first, second = craft.terminals
    attitude = ATTITUDE @ so3.exp(p[:3])
    drive = jp.Drive(
        name="drive",
        axis=so3.exp(p[8:11]) @ np.array([0.0, 0.6, 0.8]),
        boresight=so3.exp(p[8:11]) @ np.array([1.0, 0.0, 0.0]),
        range=np.array([-2.0, 2.5]) + p[11:13],
        rate_limit=0.02,
        acceleration_limit=0.01,
    )
    second = replace(second, mount=second.mount + p[13], yaw_range=np.array([-1.5, 1.6]), yaw_limit=None)
    craft = replace(craft, terminals=(first, second), drives=(drive,))
    ahead = np.cos(0.4) * np.array([1.0, 0, 0]) + np.sin(0.4) * np.cross([0.0, 0.6, 0.8], [1.0, 0, 0])
    zones = (
        jp.KeepOut(name="beam", axis_device="terminal-1", devices=("terminal-2",), half_angle=0.2 + p[3]),
        jp.KeepOut(
            name="sky",
            direction=ATTITUDE @ so3.exp(p[5:8]) @ ahead,
            devices=("drive",),
            half_angle=0.3 + p[4],
        ),
    )
    targets = jp.Targets(
        directions=(ATTITUDE @ craft.gimbals.frames[0] @ np.array([1.0, 0.1, 0.05]))[None],
        devices=("terminal-1",),
        prefer=() if wish is None else (jp.Wish(device="terminal-2", direction=wish),),
    )
    return attitude, craft, tabulate(zones, (), craft), targets, JOINTS + jnp_or_np(p).pad(p[14:18], (1, 0))


def jnp_or_np(p):
    return np if isinstance(p, np.ndarray) else jnp


def found(p, wish):
    attitude, craft, rows, targets, joints = scene_at(p, wish)
    problem = GoalProblem.of(craft, attitude, targets, rows, joints)
    problem = replace(problem, wishes=tuple(Wished.all_of(craft, targets, problem.ranges)))
    return settled(problem, np.asarray(attitude), np.asarray(problem.joints(attitude)))


def along(p, wish, moves):
    """Joints where devices make way along the same lines as before, by scipy's root of their margins."""
    attitude, craft, rows, targets, start = scene_at(p, wish)
    problem = GoalProblem.of(craft, attitude, targets, rows, start)
    joints = problem.joints(attitude)
    if wish is not None:
        frame = craft.gimbals.frames[1]
        x, y, z = wish @ attitude @ frame
        joints[[1, 3]] = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    low, high = problem.ranges.T
    for move in moves:
        own = list(move.joints)
        here, there = joints[own], low[own] + move.toward * (high - low)[own]

        def place(share, own=own, here=here, there=there, joints=joints):
            moved = joints.copy()
            moved[own] = here + share * (there - here)
            return moved

        def left(share, move=move, place=place):
            return problem.margins(attitude, place(share))[move.row, move.sight] - SPARE

        joints = place(brentq(left, move.share - 0.05, move.share + 0.05, xtol=1e-15, rtol=1e-14))
    return joints


@pytest.mark.parametrize("wished", [False, True])
def test_a_device_that_makes_way_moves_with_what_is_in_its_way(wished):
    wish = ATTITUDE @ Rotation.from_rotvec([0.0, 0.02, 0.04]).apply(
        make_spacecraft(2).gimbals.frames[1] @ np.array([1.0, -0.2, 0.05])
    )
    wish = wish / np.linalg.norm(wish) if wished else None
    origin = np.zeros(18)
    joints, moves = found(origin, wish)
    assert sorted(move.joints for move in moves)[:2] == [(1, 3), (4,)]
    assert not any(move.ties for move in moves)
    problem = scene_at(origin, wish)
    aims = GoalProblem.of(problem[1], ATTITUDE, problem[3], problem[2], JOINTS).aims

    def told(p):
        attitude, craft, rows, targets, start = scene_at(p, wish)
        gimbals = craft.gimbals
        own = GoalProblem.of(make_spacecraft(2), ATTITUDE, targets).aims  # for terminal-1 alone
        ranges = goal_ranges(craft, targets)
        at = jnp.asarray(start).at[np.array([0, 2])].set(jnp.stack(own.angles(attitude))[:, 0])
        wishes = [] if wish is None else [(1, wish)]
        at = preferred(gimbals, ranges, aims.free(gimbals), wishes, attitude, at)
        sights = rows.sights(gimbals, craft.fixed_boresights)
        return places(moves, ranges, rows, sights, attitude, at)

    value, slopes = quick_jit(lambda p: (told(p), jax.jacfwd(told)(p)))(origin)
    np.testing.assert_allclose(value, joints, atol=1e-10)
    rng = np.random.default_rng(0)
    for _ in range(4):
        way = rng.normal(size=18)
        steps = [by * STEP * way for by in (1, -1, 2, -2)]
        ahead, behind, far, farther = (along(p, wish, moves) for p in steps)
        expected = (8 * (ahead - behind) - (far - farther)) / (12 * STEP)
        np.testing.assert_allclose(slopes @ way, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
        # A drive has but one line, so it is where it is found anew as well.
        ahead, behind, far, farther = (found(p, wish)[0][4] for p in steps)
        expected = (8 * (ahead - behind) - (far - farther)) / (12 * STEP)
        assert slopes[4] @ way == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_a_device_that_makes_way_for_two_things_at_once_is_told():
    attitude, craft, rows, targets, joints = scene_at(np.zeros(18))
    (sky,) = np.flatnonzero(rows.zone == 1)
    twice = [sky if row == len(rows.zone) - 1 else row for row in range(len(rows.zone))]
    names = ("axis", "frame", "partner", "half_angle", "side", "bound", "zone")
    rows = replace(rows, **{name: getattr(rows, name)[twice] for name in names})
    problem = GoalProblem.of(craft, attitude, targets, rows, joints)
    _, moves = settled(problem, attitude, problem.joints(attitude))
    assert {move.joints: move.ties for move in moves} == {(1, 3): False, (4,): True}
