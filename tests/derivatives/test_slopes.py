"""Slopes of a plan's effort or duration beside differences of plans that are made anew along its path."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import LOW_ORBIT, make_scenario

import jaxplan as jp

STEP = 1e-4  # to either side, relative
LENGTHS = ("rate_norm_limit", "acceleration_norm_limit")


def asking(scenario, **settings):
    return replace(scenario, trajectory=replace(scenario.trajectory, **settings))


def within_lengths(own):
    lengths = {"rate_norm_limit": np.deg2rad(1.5), "acceleration_norm_limit": np.deg2rad(0.2)}
    return replace(own, spacecraft=replace(own.spacecraft, **lengths))


def shortest(scenario):
    return asking(scenario, duration="minimum")


SCENES = {
    "shortest": lambda: shortest(make_scenario(1)),
    "shortest, within lengths": lambda: within_lengths(shortest(make_scenario(1))),
    "in low orbit": lambda: asking(jp.load_scenario(LOW_ORBIT), duration=80.0),
    "joints alone, through nodes": lambda: asking(
        make_scenario(4, turn=(0.0, 0.0, 0.0)), duration=40.0, node_tube=0.0
    ),
}


def of_settings(name):
    return lambda own, factor: asking(own, **{name: factor * getattr(own.trajectory, name)})


def of_joints(own, factor):
    terminals = tuple(replace(one, rate_limit=factor * one.rate_limit) for one in own.spacecraft.terminals)
    return replace(own, spacecraft=replace(own.spacecraft, terminals=terminals))


def of_platform(own, factor):
    craft = own.spacecraft
    return replace(
        own,
        spacecraft=replace(
            craft,
            rate_limit=factor * craft.rate_limit,
            acceleration_limit=factor * craft.acceleration_limit,
            **{name: factor * getattr(craft, name) for name in LENGTHS if getattr(craft, name) is not None},
        ),
    )


CHANGES = {
    "duration": of_settings("duration"),
    "rate weight": of_settings("rate_weight"),
    "acceleration weight": of_settings("acceleration_weight"),
    "joint rates": of_joints,
    "platform": of_platform,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_slopes_are_those_of_plans_made_anew(name):
    plan = jp.plan(SCENES[name](), progress=False)
    timed = not isinstance(plan.scenario.trajectory.duration, str)
    measure = jp.measures.effort if timed else jp.measures.duration
    # Of shortest motions other rows bind soon where weights change.
    changes = {own: change for own, change in CHANGES.items() if timed or own in ("joint rates", "platform")}

    def at(plan):
        told = jp.differentiable(plan)
        with jax.enable_x64(True):
            value, slopes = jax.value_and_grad(lambda own: measure(told(own)), allow_int=True)(plan.scenario)
        return float(value), slopes

    value, slopes = at(plan)
    optimum = jp.differentiable(plan).optimum
    assert optimum.ok
    assert float(measure(optimum.trajectory)) == pytest.approx(value, rel=1e-9)
    found = {}
    for own, change in changes.items():
        anew = (jp.follow(plan, change(plan.scenario, factor)) for factor in (1 + STEP, 1 - STEP))
        ends = [float(measure(jp.differentiable(other).optimum.trajectory)) for other in anew]
        found[own] = (ends[0] - ends[1]) / (2 * STEP)
        way = jax.tree.leaves(change(plan.scenario, 2.0))
        expected = sum(
            float(np.sum(slope * (np.asarray(there) - np.asarray(here))))
            for slope, there, here in zip(
                jax.tree.leaves(slopes), way, jax.tree.leaves(plan.scenario), strict=True
            )
            if np.asarray(here).dtype.kind == "f" and np.any(np.asarray(there) != np.asarray(here))
        )
        assert expected == pytest.approx(found[own], rel=1e-3, abs=1e-5 * value), own
    assert max(map(abs, found.values())) > 0.1 * value  # what is asked about matters


@pytest.mark.parametrize("scenario", [jp.paper_case(2), SCENES["joints alone, through nodes"]()])
def test_what_is_held_with_room_for_more_nodes_repeats_the_last_one(scenario):
    plan = jp.plan(scenario, progress=False)
    few, many = jp.hold(plan), jp.hold(plan, nodes=64)
    assert (len(few.attitudes), len(many.attitudes)) == (32, 64)
    ways = jax.tree_util.tree_leaves_with_path(jax.tree.map(np.asarray, few))
    for (way, own), other in zip(ways, jax.tree.leaves(jax.tree.map(np.asarray, many)), strict=True):
        if own.shape != other.shape:
            assert (len(own), len(other)) == (32, 64), jax.tree_util.keystr(way)
            np.testing.assert_array_equal(other[32:], np.broadcast_to(own[-1:], own.shape))
        np.testing.assert_allclose(other[: len(own)] if own.ndim else other, own, rtol=1e-9, atol=1e-12)
