"""Plans within a tube: whatever errors of attitude and joints are within it, nothing is broken."""

from dataclasses import replace

import numpy as np
import pytest
from builders import avoids, make_relay
from dense import SHARE, joint_limits, shares
from reference import angle, assert_each, attitudes_of, boresights, joints_of, state_margins, unit
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.constraints import constraint_margins
from jaxplan.model.constraints import state_margins as margins_of_rows
from jaxplan.schema import with_settings

ROUNDING = 1e-9  # rad
ROBUST = jp.Robust(attitude_error=np.deg2rad(0.4), joint_error=np.deg2rad(0.3), torque_reserve=12.0)
KINDS = ("keep_out", "keep_in", "hard_keep_out", "hard_keep_in", "held_links")
OTHERS = ("beams", "carried", "moving", "mixed", "terminal_masks", "fields")
STATES = 10_000


def perturbed(plan, robust, rng, instants=200):
    """Margins by name of states off a plan's, at instants, half of them where margins are least; and joints."""
    trajectory, craft, scenario = plan.trajectory, plan.scenario.spacecraft, plan.scenario
    dense = np.linspace(0, trajectory.duration, 2001)
    margins = state_margins(scenario, attitudes_of(trajectory, dense), joints_of(trajectory, dense)[0], dense)
    least = np.min([*margins.values()] or [dense], axis=0)
    near = dense[np.argsort(least)[: instants // 2]]
    times = np.concatenate([near, rng.uniform(0, trajectory.duration, instants - len(near))])
    time = np.repeat(times, STATES // instants)
    turn = Rotation.from_rotvec(robust.attitude_error * unit(rng.standard_normal((len(time), 3))))
    attitudes = attitudes_of(trajectory, times).repeat(STATES // instants, axis=0) @ turn.as_matrix()
    off = robust.joint_error * rng.choice([-1.0, 1.0], (len(time), craft.joint_count))
    joints = joints_of(trajectory, times)[0].repeat(STATES // instants, axis=0) + off
    return state_margins(scenario, attitudes, joints, time), joints


def broken(plan, robust, seed):
    """How deep perturbed states are within what they break, rad: zones and masks, and ends of ranges."""
    margins, joints = perturbed(plan, robust, np.random.default_rng(seed))
    ranges = joint_limits(plan.scenario.spacecraft)[0]
    beyond = np.maximum(ranges[:, 0] - joints, joints - ranges[:, 1]) if joints.size else np.zeros((1, 1))
    assert not any(np.isnan(margin).any() for margin in margins.values())
    return -min([np.min(margin) for margin in margins.values()], default=np.inf), np.max(beyond)


def check_kinds(kinds, seeds):
    """Plans with a tube bear all errors within it, and enough plans without one do not."""
    scenes = [jp.random_scenario(seed, kind) for kind in kinds for seed in seeds]
    with_tube = jp.plan_batch([replace(scene, robust=ROBUST) for scene in scenes], progress=False)
    for plan in with_tube:
        assert plan.ok, f"{plan.scenario.name}: {plan.message}"
    failed = 0
    for seed, (plan, bare) in enumerate(zip(with_tube, jp.plan_batch(scenes, progress=False), strict=True)):
        deep, beyond = broken(plan, ROBUST, seed)
        assert deep <= ROUNDING, f"{plan.scenario.name} is broken by {np.rad2deg(deep)} deg"
        assert beyond <= ROUNDING, f"{plan.scenario.name}: a joint is {np.rad2deg(beyond)} deg out of range"
        failed += max(broken(bare, ROBUST, seed)) > np.deg2rad(0.05)
    return failed, len(scenes)


def test_no_error_within_the_tube_breaks_anything():
    failed, _ = check_kinds(("hard_keep_out", "any_spacecraft"), (0, 2))
    assert failed >= 2  # of the plans without a tube, so that the check sees what it is for


@pytest.mark.slow
def test_no_error_within_the_tube_breaks_anything_of_any_kind():
    failed, count = check_kinds((*KINDS, "any_spacecraft"), range(3))
    assert failed >= count // 2
    failed, count = check_kinds(OTHERS, range(2))
    assert failed >= count // 3
