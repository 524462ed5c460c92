"""Plans that tests hold and follow, and a number on which every quantity of a trajectory has a say."""

from dataclasses import replace
from functools import cache, partial

import jax.numpy as jnp
import numpy as np
from builders import make_scenario, scene_of
from node_paths import load
from quick import quick_jit
from reference import boresights
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.cases import paper_case
from jaxplan.derivatives import follow
from jaxplan.model.path import Path
from jaxplan.model.scenario import STRETCHED
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.trajectory import evaluate

TIMES = np.array([0.13, 0.37, 0.5, 0.81])


def zig_zag():
    """The paper's third case along other nodes, without its zones."""
    scenario = replace(paper_case(3), keep_out=(), keep_in=())
    settings = replace(scenario.trajectory, method="paper", duration=STRETCHED)
    scenario = replace(scenario, trajectory=settings)
    return follow(replace(jp.plan(scenario), path=load("astar_c3")), scenario)


def near_a_zone():
    """Joint rates, a zone and nodes' tubes bind."""
    scenario = paper_case(2)
    return jp.plan(replace(scenario, trajectory=replace(scenario.trajectory, method="global", duration=31.0)))


def turned(duration, **limits):
    """A plan that turns by more than half a turn, along nodes that leave room."""
    turn = np.deg2rad(200.0) * np.array([0.36, -0.48, 0.8])
    scenario = make_scenario(1, turn=turn)
    settings = replace(scenario.trajectory, duration=duration, node_tube=0.2)
    scenario = replace(scenario, spacecraft=replace(scenario.spacecraft, **limits), trajectory=settings)
    start, shares = Rotation.from_rotvec(scenario.start.rotation_vector), np.linspace(0, 1, 9)
    path = Path(
        attitudes=(start * Rotation.from_rotvec(np.outer(shares, turn))).as_matrix(),
        joints=scenario.start.joints + np.outer(shares, scenario.goal.joints - scenario.start.joints),
        edge_costs=np.ones(8),
    )
    return follow(replace(jp.plan(scenario), path=path), scenario)


def the_long_way(duration):
    """Accelerations of the platform bind, all along; at the same rows a little way off, too."""
    return turned(duration, rate_limit=np.deg2rad(6.0), acceleration_limit=np.deg2rad(0.2))


def limits_of_lengths():
    """The length of the acceleration binds, and none of its components."""
    return turned(
        72.0,
        rate_limit=np.deg2rad([6.0, 5.0, 7.0]),
        rate_norm_limit=np.deg2rad(6.5),
        acceleration_limit=np.deg2rad(0.3),
        acceleration_norm_limit=np.deg2rad(0.25),
    )


CASES = {
    "paper, zig-zag, stretched": zig_zag,
    "limits and a zone": near_a_zone,
    "limits of the platform, the long way round": partial(the_long_way, 68.0),
    "the same in 72 s": partial(the_long_way, 72.0),
    "lengths of the platform's vectors": limits_of_lengths,
}


@cache
def plan_of(case):
    plan = CASES[case]()
    assert plan.ok, plan.message
    return plan


def one_of_two_links():
    """A camera that must see one of two cones: one leaves it little at an end, the other is never held."""
    scenario = make_scenario(0, 1)
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration=60.0))
    boresight = scenario.spacecraft.fixed_boresights[0]
    seen = jp.plan(scenario).trajectory.sample(np.array([0.0, 30.0, 60.0])).attitude @ boresight
    width = np.max(np.arccos(seen[[0, 2]] @ seen[1])) + np.deg2rad(0.2)
    cones = [("held", seen[1], float(width)), ("narrow", -seen[1], np.deg2rad(0.2))]
    return replace(
        scenario,
        keep_in=tuple(
            KeepIn(name=name, direction=axis, half_angle=angle, devices=("camera-1",), any_of="link")
            for name, axis, angle in cones
        ),
    )


def near_a_zone_at_the_goal():
    """A terminal that stops a fifth of a degree short of a zone, farther from it on all of the way."""
    scenario = make_scenario(1)
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration=30.0))
    last = jp.plan(scenario).trajectory.sample(np.array([27.0, 30.0]))
    seen = boresights(scene_of(scenario), last.attitude, last.joints)[:, 0]
    ahead = np.cross(np.cross(seen[0], seen[1]), seen[1])
    axis = np.cos(0.4) * seen[1] + np.sin(0.4) * ahead / np.linalg.norm(ahead)
    zone = KeepOut(name="ahead", direction=axis, half_angle=0.4 - np.deg2rad(0.2), devices=("terminal-1",))
    return replace(scenario, keep_out=(zone,))


def there_and_back():
    """A turn of more than half a turn, and back to where it began: on the way the logarithm winds."""
    scenario = make_scenario(1)
    settings = replace(scenario.trajectory, duration=160.0, node_tube=0.2)
    scenario = replace(scenario, goal=scenario.start, trajectory=settings)
    start = Rotation.from_rotvec(scenario.start.rotation_vector)
    angles = np.deg2rad([0, 50, 100, 150, 200, 200, 150, 100, 50, 0])
    path = Path(
        attitudes=(start * Rotation.from_rotvec(np.outer(angles, [0.36, -0.48, 0.8]))).as_matrix(),
        joints=np.repeat(scenario.start.joints[None], len(angles), axis=0),
        edge_costs=np.ones(len(angles) - 1),
    )
    return follow(replace(jp.plan(scenario), path=path), scenario)


def at_speed():
    """Rates at both ends, and limits of jerk and torque."""
    scenario = make_scenario(2)
    craft = replace(
        scenario.spacecraft,
        inertia=np.array([[20.0, 1, 0], [1, 25, -2], [0, -2, 30]]),
        torque_limit=np.array([0.4, 0.5, 0.6]),
        jerk_limit=np.deg2rad(1.0),
    )
    start, goal = (
        replace(
            end,
            angular_velocity=side * np.array([0.004, -0.003, 0.002]),
            joint_rates=side * np.full(4, 0.003),
        )
        for end, side in ((scenario.start, 1.0), (scenario.goal, -0.5))
    )
    settings = replace(scenario.trajectory, duration=45.0, rate_weight=0.7, jerk_weight=40.0)
    return replace(scenario, spacecraft=craft, start=start, goal=goal, trajectory=settings)


def widened_tube():
    """Nodes of which some are farther off than the tube that is asked for."""
    scenario = make_scenario(1)
    settings = replace(scenario.trajectory, duration=18.0, node_tube=np.deg2rad(0.4))
    scenario = replace(scenario, trajectory=settings)
    plan = jp.plan(scenario)
    joints = plan.path.joints.copy()
    joints[1:-1] += np.deg2rad(2.0) * (-1.0) ** np.arange(len(joints) - 2)[:, None]
    return follow(replace(plan, path=replace(plan.path, joints=joints)), scenario)


def metric(trajectory):
    """A number on which every quantity of a trajectory has a say."""
    duration = jnp.asarray(trajectory.breaks)[-1]
    s = evaluate(trajectory, TIMES * duration)
    platform = (
        jnp.sin(3 * s.attitude).sum() + jnp.sin(100 * s.angular_acceleration + 30 * s.angular_velocity).sum()
    )
    return platform + jnp.sum(jnp.cos(2 * s.joints) + 50 * s.joint_accelerations) + duration / 10


@cache
def valued():
    return quick_jit(metric)
