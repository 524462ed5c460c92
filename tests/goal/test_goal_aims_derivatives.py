"""Derivatives of goals by how devices are mounted, their ranges and targets, against goals found anew."""

import itertools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from pointing import Problem
from pointing_aims import KINDS, conditions, random_aims
from quick import quick_jit
from scipy.spatial.transform import Rotation

from jaxplan import so3
from jaxplan.goal.derivative import differentiable_goal
from jaxplan.model.devices import Mount

STEP, TOLERANCE = 1e-4, 1e-6
EXACTLY = 2e-10  # rad, to which equations are met here, the least that a file may have


def inputs_of(problem: Problem) -> dict[str, np.ndarray]:
    """Changes by which a goal is differentiated, all zero: of axes turns, in body axes or inertial."""
    craft = problem.spacecraft
    return {
        "start": np.zeros(3),
        "targets": np.zeros((len(problem.targets.directions), 3)),
        "mounts": np.zeros((len(craft.terminals), 3)),
        "drives": np.zeros((len(craft.drives), 2, 3)),
        "boresights": np.zeros((len(craft.instruments), 3)),
        "ranges": np.zeros((craft.joint_count, 2)),
        "cones": np.zeros((len(problem.cones.axis), 3)),
        "half angles": np.zeros(len(problem.cones.axis)),
    }


def changed(problem: Problem, inputs: dict, turn) -> Problem:
    """The problem with its inputs changed; `turn` makes rotations (3, 3) of vectors (3,)."""
    craft, count = problem.spacecraft, len(problem.spacecraft.terminals)
    ranges = inputs["ranges"]

    def turned(vectors, by):
        return [turn(own) @ vector for own, vector in zip(by, vectors, strict=True)]

    terminals = tuple(
        replace(
            terminal,
            mounting=Mount(
                yaw_axis=turn(by) @ terminal.mounting.yaw_axis,
                boresight=turn(by) @ terminal.mounting.boresight,
            ),
            yaw_range=terminal.yaw_range + ranges[number],
            pitch_range=terminal.pitch_range + ranges[count + number],
        )
        for number, (terminal, by) in enumerate(zip(craft.terminals, inputs["mounts"], strict=True))
    )
    drives = tuple(
        replace(
            drive,
            axis=turn(by[0]) @ drive.axis,
            boresight=turn(by[1]) @ drive.boresight,
            range=drive.range + ranges[2 * count + number],
        )
        for number, (drive, by) in enumerate(zip(craft.drives, inputs["drives"], strict=True))
    )
    instruments = tuple(
        replace(one, boresight=turn(by) @ one.boresight)
        for one, by in zip(craft.instruments, inputs["boresights"], strict=True)
    )
    module = np if isinstance(inputs["start"], np.ndarray) else jnp
    directions = module.stack(turned(problem.targets.directions, inputs["targets"]))
    cones = [module.zeros((0, 3)), *(own[None] for own in turned(problem.cones.axis, inputs["cones"]))]
    axis = module.concatenate(cones)
    return Problem(
        spacecraft=replace(craft, terminals=terminals, drives=drives, instruments=instruments),
        start=problem.start @ turn(inputs["start"]),
        targets=replace(problem.targets, directions=directions, tolerance=EXACTLY),
        cones=replace(problem.cones, axis=axis, half_angle=problem.cones.half_angle + inputs["half angles"]),
    )


def found_anew(problem: Problem, inputs: dict) -> np.ndarray:
    new = changed(problem, inputs, lambda vector: Rotation.from_rotvec(vector).as_matrix())
    goal = new.decompose(max_goals=1).goals[0]
    return np.concatenate([goal.attitude.ravel(), goal.joints, [goal.slew_angle]])


@quick_jit
def goal_with_slopes(goal, problem: dict, zero: dict, along: dict) -> tuple[jax.Array, jax.Array, dict]:
    """Attitude, joints and slew as one vector, its derivative along a direction, and that of its sum."""

    def as_function(inputs):
        new = changed(Problem(**problem), inputs, so3.exp)
        end = differentiable_goal(goal, new.spacecraft, new.start, new.targets, new.cones)
        return jnp.concatenate([jnp.ravel(end.attitude), end.joints, jnp.reshape(end.slew_angle, 1)])

    value, push = jax.linearize(as_function, zero)
    (pulled,) = jax.linear_transpose(push, zero)(jnp.ones_like(value))
    return value, push(along), pulled


def derivative(problem: Problem, goal, along: dict) -> np.ndarray:
    """Derivative along a direction, of attitude, joints and slew."""
    value, slope, pulled = goal_with_slopes(goal, vars(problem), inputs_of(problem), along)
    packed = np.concatenate([goal.attitude.ravel(), goal.joints, [goal.slew_angle]])
    np.testing.assert_allclose(value, packed, rtol=0, atol=50 * EXACTLY)
    flat = ravel_pytree(along)[0] @ ravel_pytree(pulled)[0]
    np.testing.assert_allclose(flat, slope.sum(), rtol=1e-9, atol=1e-9)  # backward is forward
    return np.asarray(slope)


def difference(problem: Problem, along: dict) -> np.ndarray:
    """Central differences of goals found anew, extrapolated."""

    def central(step: float) -> np.ndarray:
        ends = [
            found_anew(problem, {name: sign * step * part for name, part in along.items()})
            for sign in (1, -1)
        ]
        return (ends[0] - ends[1]) / (2 * step)

    return (4 * central(STEP / 2) - central(STEP)) / 3


def clear_of_others(number: int) -> tuple:
    """Kind, problem and goal of the first of a kind that is not about to lean on something else."""
    for seed in itertools.count(number, len(KINDS)):
        kind, problem = random_aims(seed)
        problem = replace(problem, targets=replace(problem.targets, tolerance=EXACTLY))
        goal = problem.decompose(max_goals=1).goals[0]
        least = np.sort(conditions(problem, goal.attitude)[0])
        if not np.any((least > 1e-9) & (least < 0.01)) and goal.slew_angle <= 3.1:  # nor the other way round
            return kind, problem, goal


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(KINDS)), ids=list(KINDS))
def test_derivatives_of_devices_of_every_kind_are_those_of_goals_found_anew(number):
    kind, problem, goal = clear_of_others(number)
    rng = np.random.default_rng(number)
    zero = inputs_of(problem)
    ways = [{name: rng.normal(size=part.shape) for name, part in zero.items()}]
    if kind == "two instruments":  # the two must go on to fit each other
        shared = {name: 0 * part for name, part in zero.items()}
        turn = rng.normal(size=3)
        ways = [shared | {"start": turn}, shared | {"targets": np.tile(turn, (2, 1))}]
    for along in ways:
        found, expected = derivative(problem, goal, along), difference(problem, along)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * scale + 1e-8)
