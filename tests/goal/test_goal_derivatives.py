"""Derivatives of step 1's goals, held against differences of goals that are found anew."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from pointing import Problem, make_problem, random_problem
from pointing_kinds import KINDS, one_of, past_a_plane
from quick import quick_jit
from reference import assert_each, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan import so3
from jaxplan.geometry.vectors import pointing
from jaxplan.goal import derivative as goal_derivative
from jaxplan.goal.derivative import differentiable_goal
from jaxplan.goal.descent import active_terms
from jaxplan.model.constraints import JOINTS
from jaxplan.model.path import Goal
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut

STEP = 1e-4
TOLERANCE = 1e-6
Inputs = dict[str, np.ndarray]


def from_scenario(scenario: jp.Scenario) -> Problem:
    cones = tabulate(scenario.keep_out, scenario.keep_in, scenario.spacecraft)
    start = Rotation.from_rotvec(scenario.start.rotation_vector).as_matrix()
    return Problem(spacecraft=scenario.spacecraft, start=start, targets=scenario.goal, cones=cones)


def inputs_of(problem: Problem) -> Inputs:
    """All that a goal can be differentiated by, and a turn of the start in body axes."""
    craft, targets = problem.spacecraft, problem.targets
    inputs = {
        "turn": np.zeros(3),
        "targets": targets.directions,
        "mounts": problem.mounts,
        "own limits": craft.joint_ranges[:, 1],
        "boresights": craft.fixed_boresights,
        "cones": problem.cones.axis,
        "body": problem.cones.body,
        "half-angles": problem.cones.half_angle,
    }
    if targets.yaw_limit is not None:
        inputs["goal limits"] = np.array([targets.yaw_limit, targets.pitch_limit])
    return inputs


def changed(problem: Problem, inputs: Inputs, exp: Callable = so3.exp) -> Problem:
    """The problem with other inputs; directions may have any length."""
    craft, count = problem.spacecraft, len(problem.spacecraft.terminals)
    limits = inputs["own limits"]
    terminals = tuple(
        replace(terminal, mount=inputs["mounts"][i], yaw_limit=limits[i], pitch_limit=limits[count + i])
        for i, terminal in enumerate(craft.terminals)
    )
    instruments = tuple(
        replace(instrument, boresight=boresight)
        for instrument, boresight in zip(craft.instruments, inputs["boresights"], strict=True)
    )
    targets = replace(problem.targets, directions=inputs["targets"])
    joints = (problem.cones.frame == JOINTS)[:, None]  # what these bound stays a yaw or a pitch
    axis = inputs["cones"] * ~joints + problem.cones.axis * joints
    if "goal limits" in inputs:
        targets = replace(targets, yaw_limit=inputs["goal limits"][0], pitch_limit=inputs["goal limits"][1])
    return Problem(
        spacecraft=replace(craft, terminals=terminals, instruments=instruments),
        start=problem.start @ exp(inputs["turn"]),
        targets=targets,
        cones=replace(problem.cones, axis=axis, half_angle=inputs["half-angles"], body=inputs["body"]),
    )


def found_anew(problem: Problem, inputs: Inputs) -> np.ndarray:
    unit = dict(inputs)
    for name in ("targets", "boresights", "cones", "body"):
        unit[name] = inputs[name] / np.linalg.norm(inputs[name], axis=-1, keepdims=True)
    turned = changed(problem, unit, lambda turn: Rotation.from_rotvec(turn).as_matrix())
    goal = turned.decompose(max_goals=1).goals[0]
    return np.concatenate([goal.attitude.ravel(), goal.joints, [goal.slew_angle]])


def difference(problem: Problem, along: Inputs) -> np.ndarray:
    """Derivative along a direction: central differences, extrapolated."""
    inputs = inputs_of(problem)

    def central(step: float) -> np.ndarray:
        ends = [
            found_anew(problem, {name: inputs[name] + sign * step * along[name] for name in inputs})
            for sign in (1, -1)
        ]
        return (ends[0] - ends[1]) / (2 * step)

    return (4 * central(STEP / 2) - central(STEP)) / 3


LEVEL, AT_LIMITS = np.array([0.3, -0.4, 0.5, 0.1, -0.1, 0.0]), np.array([1.5, 0.0, -1.5, 0.2, 0.0, -0.2])
HALF_TURN = np.pi * np.array([0.6, 0.0, 0.8])
SPECIAL = {  # joints at the targets, limits there, and the turn from the start to where they are met
    "start is goal": (LEVEL, (1.5, 0.2), np.zeros(3)),
    "start is goal, at limits": (AT_LIMITS, (1.5, 0.2), np.zeros(3)),
    "half a turn": (np.zeros(6), (1e-3, 1e-3), HALF_TURN),
    "half a turn, hardly any room": (np.zeros(6), (1e-8, 1e-8), HALF_TURN),
}


def three_terminals() -> list[Problem]:
    """The paper's four cases, random scenes, and at the end the special ones: 64 problems."""
    problems = [from_scenario(jp.paper_case(number)) for number in (1, 2, 3, 4)]
    problems += [from_scenario(jp.random_scenario(seed, "keep_out")) for seed in range(60 - len(SPECIAL))]
    first = problems[0]
    for joints, (yaw, pitch), turn in SPECIAL.values():
        end = first.start @ Rotation.from_rotvec(turn).as_matrix()
        directions = np.asarray(first.spacecraft.boresights(end, joints))
        targets = replace(first.targets, directions=directions, yaw_limit=yaw, pitch_limit=pitch)
        problems.append(replace(first, targets=targets))
    return problems


def with_an_instrument() -> list[Problem]:
    """Two terminals, and a telescope whose zones are in the way of the goal there would be without them."""
    problems = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        start, solution = Rotation.random(2, rng=rng).as_matrix()
        mounts, azimuths, elevations = rng.uniform(-0.5, 0.5, (3, 2)) * np.array([[6.0], [2.0], [0.5]])
        directions = np.asarray(pointing(mounts + azimuths, elevations)) @ solution.T
        boresight = unit(rng.standard_normal(3))
        craft = {
            "mounts": mounts,
            "yaw_limits": 2.0,
            "pitch_limits": 0.3 + seed / 5,
            "boresights": (boresight,),
        }
        free = make_problem(start, directions, **craft).decompose(max_goals=1).goals[0].attitude @ boresight
        seen = solution @ boresight
        apart = np.arccos(free @ seen)
        keys = ("name", "direction", "half_angle")
        zones = [
            ("sun", unit(free + 0.1 * apart * rng.standard_normal(3)), 0.4 * apart),
            ("near", seen, 0.8 * apart),
            ("far", -free, 0.3),
        ]
        sun, *stations = (dict(zip(keys, zone, strict=True), devices=("i0",)) for zone in zones)
        keep_in = tuple(KeepIn(**station, any_of="stations") for station in stations)
        problems.append(make_problem(start, directions, **craft, keep_out=(KeepOut(**sun),), keep_in=keep_in))
    return problems


GROUPS = {
    "three terminals": three_terminals,
    "two terminals and an instrument": with_an_instrument,
    "every kind of row": lambda: [
        *(one_of(kind, seed=number) for number, kind in enumerate(KINDS)),
        past_a_plane(),
    ],
    "four terminals": lambda: [random_problem(seed) for seed in (5, 15, 25, 35)],
}


def as_function(goal: Goal, problem: dict, inputs: Inputs) -> jax.Array:
    """Attitude, joints and slew in one vector."""
    new = changed(Problem(**problem), inputs)
    end = differentiable_goal(goal, new.spacecraft, new.start, new.targets, new.cones)
    return jnp.concatenate([end.attitude.ravel(), end.joints, end.slew_angle[None]])


def value_and_derivatives(goal: Goal, problem: dict, inputs: Inputs) -> tuple[jax.Array, Inputs, Inputs]:
    """The goal as a vector, and its derivatives forward and backward."""
    value, push = jax.linearize(lambda changes: as_function(goal, problem, changes), inputs)
    pull = jax.linear_transpose(push, inputs)
    flat, rebuild = ravel_pytree(inputs)
    columns = jax.vmap(lambda change: push(rebuild(change)))(jnp.eye(len(flat)))
    forward = jax.vmap(rebuild)(columns.T)
    (reverse,) = jax.vmap(pull)(jnp.eye(len(value)))
    return value, forward, reverse


@dataclass(frozen=True, kw_only=True)
class Group:
    problems: list[Problem]
    goals: list[Goal]
    value: np.ndarray  # (K, p)
    forward: Inputs  # (K, p, ...)
    reverse: Inputs

    @property
    def ordinary(self) -> range:
        """Problems whose goals have derivatives."""
        return range(len(self.problems) - (len(SPECIAL) if len(self.problems) == 64 else 0))


def arguments_of(problem: Problem) -> tuple[Goal, dict, Inputs]:
    return problem.decompose(max_goals=1).goals[0], vars(problem), inputs_of(problem)


@cache
def solved(name: str) -> Group:
    problems = GROUPS[name]()
    rows = [arguments_of(problem) for problem in problems]
    stacked = jax.tree.map(lambda *leaf: np.stack(leaf), *rows)
    value, forward, reverse = jax.tree.map(np.asarray, quick_jit(jax.vmap(value_and_derivatives))(*stacked))
    goals = [goal for goal, *_ in rows]
    return Group(problems=problems, goals=goals, value=value, forward=forward, reverse=reverse)


@pytest.fixture(params=GROUPS)
def group(request) -> Group:
    return solved(request.param)


def along(derivative: Inputs, row: int, direction: Inputs) -> np.ndarray:
    parts = [np.tensordot(derivative[name][row], part, axes=part.ndim) for name, part in direction.items()]
    return np.sum(parts, axis=0)


def directions_of(number: int, inputs: Inputs) -> list[Inputs]:
    """Where to look: along each input by itself for six problems, along all at once for the others."""
    rng = np.random.default_rng(number)
    draws = {name: rng.standard_normal(value.shape) for name, value in inputs.items()}
    if number >= 6:
        return [draws]
    return [
        {name: draw * (name == one) for name, draw in draws.items()} for one in inputs if inputs[one].size
    ]


@pytest.mark.slow
def test_derivatives_are_those_of_goals_found_anew(group):
    for row in group.ordinary:
        problem = group.problems[row]
        for direction in directions_of(row, inputs_of(problem)):
            expected = difference(problem, direction)
            found = along(group.forward, row, direction)
            np.testing.assert_allclose(
                found, expected, rtol=0, atol=TOLERANCE * np.abs(expected).max() + 1e-9
            )


@pytest.mark.slow
def test_cases_lean_on_nothing_to_three_limits_and_on_zones():
    limits = [
        np.sum(np.abs(goal.joints) >= problem.limits - 1e-9)
        for name in GROUPS
        for goal, problem in zip(solved(name).goals, solved(name).problems, strict=True)
    ]
    assert set(limits) >= {0, 1, 2, 3}
    zones = solved("two terminals and an instrument")
    found = [problem.decompose(max_goals=1).zone_excess for problem in zones.problems]
    assert np.sum(np.abs(found) <= 1e-10) >= 4


def test_backward_is_forward(group):
    for name, forward in group.forward.items():
        np.testing.assert_allclose(group.reverse[name], forward, rtol=1e-9, atol=1e-9)


def test_the_goal_stays_what_it_is(group):
    for value, goal in zip(group.value, group.goals, strict=True):
        packed = np.concatenate([goal.attitude.ravel(), goal.joints, [goal.slew_angle]])
        np.testing.assert_allclose(value, packed, rtol=0, atol=1e-10)


def test_derivatives_are_finite_everywhere(group):
    for derivative in (group.forward, group.reverse):
        for part in derivative.values():
            np.testing.assert_array_equal(np.isfinite(part), True)


@pytest.mark.parametrize("name", ["start is goal", "start is goal, at limits"])
def test_without_a_slew_the_goal_follows_the_start(name):
    group = solved("three terminals")
    row = 64 - len(SPECIAL) + list(SPECIAL).index(name)
    assert group.goals[row].slew_angle == 0
    turns = np.stack([group.problems[row].start @ so3.hat(axis) for axis in np.eye(3)], axis=-1)
    np.testing.assert_allclose(group.forward["turn"][row, :9].reshape(3, 3, 3), turns, atol=1e-14)
    for derivative in group.forward.values():
        np.testing.assert_allclose(derivative[row, -1], 0, atol=1e-14)  # of the slew


def test_where_nearby_attitudes_are_as_good_the_goal_moves_least():
    """A telescope that looks away from a cone may turn there about any axis across."""
    start, boresight = Rotation.random(rng=1).as_matrix(), unit(np.array([0.3, -0.5, 0.8]))
    opposite = KeepIn(name="station", direction=-start @ boresight, half_angle=0.4, devices=("i0",))
    nothing = np.zeros((0, 3))
    problem = make_problem(start, nothing, np.zeros(0), boresights=(boresight,), keep_in=(opposite,))
    goal, arrays, inputs = arguments_of(problem)
    _, forward, _ = quick_jit(value_and_derivatives)(goal, arrays, inputs)
    assert goal.slew_angle == pytest.approx(np.pi - 0.4, abs=1e-9)
    np.testing.assert_allclose(forward["half-angles"][-1, 0], -1.0, atol=1e-6)  # of the slew, by the cone
    for part in forward.values():
        assert_each(np.abs(part), "<=", 10)


def test_one_problem_by_itself():
    group = solved("three terminals")
    goal, problem, inputs = arguments_of(group.problems[1])
    slope = quick_jit(jax.grad(lambda changes: as_function(goal, problem, changes)[-1]))(inputs)
    for name, part in slope.items():
        np.testing.assert_allclose(part, group.forward[name][1, -1], atol=1e-12)


def test_without_the_curvature_of_caps_derivatives_are_wrong(monkeypatch):
    def flat(*arguments):
        curved, normals, depth = active_terms(*arguments)
        return 0 * curved, normals, depth

    def slope(goal: Goal, problem: dict, inputs: Inputs, direction: Inputs) -> jax.Array:
        return jax.jvp(lambda changes: as_function(goal, problem, changes), (inputs,), (direction,))[1]

    group = solved("two terminals and an instrument")
    rows = [arguments_of(problem) for problem in group.problems]
    directions = [directions_of(6, inputs)[0] for *_, inputs in rows]
    stacked = jax.tree.map(
        lambda *leaf: np.stack(leaf), *[(*row, way) for row, way in zip(rows, directions, strict=True)]
    )
    monkeypatch.setattr(goal_derivative, "active_terms", flat)
    without = np.asarray(quick_jit(jax.vmap(slope))(*stacked))
    right = np.stack([along(group.forward, row, way) for row, way in enumerate(directions)])
    errors = np.abs(without - right).max(axis=1) / np.abs(right).max(axis=1)
    assert np.sum(errors > 1e4 * TOLERANCE) >= 3
    np.testing.assert_allclose(without[:, -1], right[:, -1], atol=1e-9)  # the slew itself needs none


def test_second_derivatives_are_refused():
    goal, problem, inputs = arguments_of(from_scenario(jp.paper_case(1)))

    def steepness(changes):
        slope = jax.grad(lambda changes: as_function(goal, problem, changes)[-1])(changes)
        return jnp.sum(slope["mounts"] ** 2)

    with pytest.raises(NotImplementedError, match="first derivatives only"):
        jax.eval_shape(jax.grad(steepness), inputs)


def test_precision_is_that_of_the_goal():
    goal, problem, inputs = arguments_of(from_scenario(jp.paper_case(1)))
    single = replace(goal, attitude=goal.attitude.astype(np.float32))
    shape = jax.eval_shape(lambda changes: as_function(single, problem, changes), inputs)
    assert shape.dtype == np.float32
