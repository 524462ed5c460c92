"""Slopes of plans by the inertias of stages beside differences, and of plans that are made anew."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from quick import quick_jit
from stages import random_inertia
from wheels import random_wheels, with_wheels

import jaxplan as jp

STEP = 1e-4  # kg m^2, to either side
SIZE = 0.1  # kg m^2
HEAVIER = (2.0, 3.0, 15.0)  # times that; then many rows that bind nearly follow from others
# So that some wheels bind in torque and some in momentum.
TIGHT = {"torque": 0.4, "momentum": 0.45, "stored": 0.2}


def scarce(duration, size=SIZE):
    """A spacecraft with a terminal that pushes back by stages of so many kg m^2, whose motion wheels bind."""
    array = tuple(
        replace(one, **{name: factor * getattr(one, name) for name, factor in TIGHT.items()})
        for one in random_wheels(4, seed=5)
    )
    scenario = with_wheels(array, duration=duration)
    return with_inertias(
        scenario, size * np.array([1.0, 1.1, 1.3]), random_inertia(np.random.default_rng(3), size)
    )


def with_inertias(scenario, yaw, pitch):
    """The scenario with these inertias of its terminal's stages: moments, and a matrix."""
    (terminal,) = scenario.spacecraft.terminals
    terminal = replace(terminal, yaw_inertia=yaw, pitch_inertia=pitch)
    return replace(scenario, spacecraft=replace(scenario.spacecraft, terminals=(terminal,)))


def inertias(scenario):
    (terminal,) = scenario.spacecraft.terminals
    return np.asarray(terminal.yaw_inertia), np.asarray(terminal.pitch_inertia)


def driven(duration):
    """A spacecraft bound by wheels, of a drive that pushes back, with the three moments of its whole."""
    scenario = scarce(duration)
    panel = jp.Drive(
        name="panel",
        axis=np.array([0.6, 0.8, 0.0]),
        boresight=np.array([0.0, 0.6, 0.8]),
        range=np.deg2rad([-170.0, 170.0]),
        rate_limit=np.deg2rad(4.0),
        acceleration_limit=np.deg2rad(3.0),
    )
    craft = replace(scenario.spacecraft, terminals=(), drives=(panel,))
    scenario = replace(
        scenario,
        spacecraft=craft,
        start=replace(scenario.start, joints=np.array([-0.8]), joint_rates=np.zeros(1)),
        goal=replace(scenario.goal, joints=np.array([0.7]), joint_rates=np.zeros(1)),
    )
    return with_own(scenario, np.array([20.0, 25.0, 30.0]), random_inertia(np.random.default_rng(3), SIZE))


def with_own(scenario, moments, panel):
    """The scenario with these moments of the whole, and this inertia of its drive."""
    (drive,) = scenario.spacecraft.drives
    craft = replace(scenario.spacecraft, inertia=moments, drives=(replace(drive, inertia=panel),))
    return replace(scenario, spacecraft=craft)


def own_inertias(scenario):
    (drive,) = scenario.spacecraft.drives
    return np.asarray(scenario.spacecraft.inertia), np.asarray(drive.inertia)


# A scene, and how its inertias, three moments and a matrix, are read and written.
CRAFT = {"terminal": (scarce, inertias, with_inertias), "drive and whole": (driven, own_inertias, with_own)}
SCENES = {
    "shortest": ("minimum", jp.measures.duration),
    "stretched": ("stretched", jp.measures.duration),
    "in a given time": (None, jp.measures.effort),
}


def ways():
    """Ways (3,) to change the moments, and symmetric (3, 3) the matrix."""
    yield from ((way, np.zeros((3, 3))) for way in np.eye(3))
    for row, column in ((0, 0), (2, 2), (0, 1), (1, 2)):
        way = np.zeros((3, 3))
        way[row, column] = way[column, row] = 1.0
        yield np.zeros(3), way


@cache
def measured(measure, put=with_inertias):
    """Kernel for a measure of a plan that is held, and its slopes by both inertias, which `put` writes."""

    def value(given, own, held):
        return measure(jp.replan(held, put(own, *given)))

    return quick_jit(jax.value_and_grad(value))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "craft"),
    [*((name, "terminal") for name in SCENES), ("in a given time", "drive and whole")],
)
def test_slopes_by_inertias_are_differences(name, craft):
    (duration, measure), (made, read, put) = SCENES[name], CRAFT[craft]
    plan = jp.plan(made(duration or "minimum"), progress=False)
    if duration is None:  # not much longer than the shortest, so that limits bind
        longer = replace(plan.scenario.trajectory, duration=1.25 * plan.trajectory.duration)
        plan = jp.plan(replace(plan.scenario, trajectory=longer), progress=False)
    held, given, kernel = jp.hold(plan), read(plan.scenario), measured(measure, put)
    with jax.enable_x64(True):
        own = jax.tree.map(np.asarray, plan.scenario)
        here, slopes = kernel(given, own, held)
        binding = 0
        for way in ways():
            ends = [
                float(
                    kernel(tuple(g + side * STEP * w for g, w in zip(given, way, strict=True)), own, held)[0]
                )
                for side in (1, -1)
            ]
            told = float(sum(np.sum(slope * w) for slope, w in zip(slopes, way, strict=True)))
            expected = (ends[0] - ends[1]) / (2 * STEP)
            assert told == pytest.approx(expected, rel=1e-6, abs=1e-6 * abs(float(here))), way
            binding += abs(expected) > 1e-4 * abs(float(here))
    assert binding >= 2  # what is asked about matters


@pytest.mark.slow
def test_the_shortest_duration_follows_an_inertia_as_plans_made_anew():
    plan = jp.plan(scarce("minimum"), progress=False)
    kernel, given = measured(jp.measures.duration), inertias(plan.scenario)
    step = 0.02 * SIZE
    both = [with_inertias(plan.scenario, given[0] + side * step * np.ones(3), given[1]) for side in (1, -1)]
    held = [jp.hold(plan), *(jp.hold(jp.follow(plan, each)) for each in both)]
    with jax.enable_x64(True):
        (_, slopes), *ends = (
            kernel(inertias(own), jax.tree.map(np.asarray, own), each)
            for own, each in zip((plan.scenario, *both), held, strict=True)
        )
    found = (float(ends[0][0]) - float(ends[1][0])) / (2 * step)
    assert float(np.sum(slopes[0])) == pytest.approx(found, rel=2e-2)


@pytest.mark.slow
def test_optima_with_heavy_stages_are_found_to_the_last_digit():
    for factor in HEAVIER:
        plan = jp.plan(scarce("minimum", factor * SIZE), progress=False)
        found = quick_jit(jp.replan)(jp.hold(plan), jax.tree.map(np.asarray, plan.scenario))
        assert 0.99 * plan.trajectory.duration < float(jp.measures.duration(found))
        assert float(jp.measures.duration(found)) <= plan.trajectory.duration
