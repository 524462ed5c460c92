"""Plans as functions of their scenario: derivatives against differences of plans that are made anew."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from node_paths import load
from scenes import make_scenario

import jaxplan as jp
from jaxplan.cases import paper_case
from jaxplan.scenario import STRETCHED
from jaxplan.sensitivity import follow, hold, replan
from jaxplan.trajectory import evaluate

TIMES = np.array([0.13, 0.37, 0.5, 0.81])
INERTIA = np.array([[12.0, 1.2, -0.6], [1.2, 18.0, 1.8], [-0.6, 1.8, 24.0]])


def with_path(scenario, path):
    """A plan of a scenario along other nodes."""
    return follow(replace(jp.plan(scenario), path=path), scenario)


def zig_zag(number, **settings):
    scenario = paper_case(number)
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, **settings))
    return with_path(scenario, load(f"astar_c{number}"))


def planned(number, **settings):
    scenario = paper_case(number)
    return jp.plan(replace(scenario, trajectory=replace(scenario.trajectory, **settings)))


def loaded():
    """One terminal; in this time the torque binds."""
    scenario = make_scenario(1)
    craft = replace(scenario.spacecraft, inertia=INERTIA, torque_limit=np.array([0.1, 0.15, 0.2]))
    settings = replace(scenario.trajectory, method="global", duration=22.0)
    return jp.plan(replace(scenario, spacecraft=craft, trajectory=settings))


CASES = {
    "paper": lambda: planned(1, method="paper", duration=80.0),
    "paper, zig-zag, stretched": lambda: zig_zag(3, method="paper", duration=STRETCHED),
    "global, near a zone": lambda: planned(2, method="global", duration=40.0),
    "global, zig-zag": lambda: zig_zag(1, method="global", duration=80.0),
    "global, through the nodes, stretched": lambda: planned(
        4, method="global", duration=STRETCHED, node_tube=0.0
    ),
    "global, torque": loaded,
}
cases = pytest.mark.parametrize("case", CASES)


@cache
def plan_of(case):
    plan = CASES[case]()
    assert plan.ok, plan.message
    return plan


def metric(trajectory):
    """A number on which every quantity of a trajectory has a say."""
    duration = jnp.asarray(trajectory.breaks)[-1]
    s = evaluate(trajectory, TIMES * duration)
    platform = (
        jnp.sin(3 * s.attitude).sum() + jnp.sin(100 * s.angular_acceleration + 30 * s.angular_velocity).sum()
    )
    return platform + jnp.sum(jnp.cos(2 * s.joints) + 50 * s.joint_accelerations) + duration / 10


@cache
def kernel(case):
    """Value and gradient in every number of the scenario, at what is held of a plan."""
    return jax.jit(jax.value_and_grad(lambda scenario, held: metric(replan(held, scenario)), allow_int=True))


def made_anew(case, scenario):
    """The number of a plan that is made anew between the same interior nodes, at its very optimum."""
    plan = follow(plan_of(case), scenario)
    assert plan.trajectory is not None, plan.message
    with jax.enable_x64(True):
        if scenario.trajectory.method == "paper":  # its programs are solved to rounding
            return float(metric(plan.trajectory))
        return float(kernel(case)(scenario, hold(plan))[0])


def leaves_of(scenario):
    return jax.tree_util.tree_flatten_with_path(scenario)


@cases
def test_gradients_are_those_of_plans_that_are_made_anew(case):
    plan = plan_of(case)
    scenario = plan.scenario
    with jax.enable_x64(True):
        value, gradient = kernel(case)(scenario, hold(plan))
    assert float(value) == pytest.approx(made_anew(case, scenario), rel=1e-9)
    leaves, tree = leaves_of(scenario)
    checked = 0
    for number, ((path, leaf), slope) in enumerate(zip(leaves, jax.tree.leaves(gradient), strict=True)):
        slope, name = np.asarray(slope), jax.tree_util.keystr(path)
        if slope.dtype.kind != "f" or not slope.size:
            continue
        assert np.all(np.isfinite(slope)), name
        if not np.any(np.abs(slope) > 1e-7):
            continue
        direction = np.random.default_rng(number).normal(size=slope.shape)
        if "direction" in name or "boresight" in name:  # a unit vector is turned
            direction -= np.sum(direction * leaf, axis=-1, keepdims=True) * leaf
        step = 1e-5 * max(1.0, float(np.max(np.abs(leaf))))

        def at(share):
            changed = [other for _, other in leaves]
            changed[number] = leaf + share * step * direction  # noqa: B023
            return made_anew(case, jax.tree.unflatten(tree, changed))

        differences = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * step)
        assert np.sum(slope * direction) == pytest.approx(differences, rel=1e-6, abs=1e-7), name
        checked += 1
    assert checked >= 8
