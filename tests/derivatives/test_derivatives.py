"""Tests of `jp.differentiable`: a plan as a function that needs no context, whatever JAX is set to."""

import warnings
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_scenario
from kernels import nothing_new
from quick import quick_jit

import jaxplan as jp


@pytest.fixture(scope="module", autouse=True)
def as_jax_is_set_by_default():
    with jax.enable_x64(False):
        yield


@pytest.fixture(scope="module")
def plan():
    return jp.plan(jp.paper_case(2), progress=False)


@pytest.fixture(scope="module")
def trajectory(plan):
    return jp.differentiable(plan)


@pytest.fixture(scope="module")
def slopes(plan, trajectory):
    """Of the effort, by JAX as it is set by default, and in 64 bits by `replan`."""
    assert not jax.config.jax_enable_x64
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)  # JAX tells so of numbers that it cuts to 32 bits
        narrow = jax.jit(jax.grad(lambda scenario: jp.measures.effort(trajectory(scenario))))(plan.scenario)
    with jax.enable_x64(True):
        effort = jax.grad(lambda scenario: jp.measures.effort(jp.replan(trajectory.held, scenario)))
        wide = quick_jit(effort)(plan.scenario)
    return narrow, wide


def test_at_the_plans_own_scenario_it_is_the_plans_trajectory_in_64_bits(plan, trajectory):
    found = trajectory(plan.scenario)
    for own, other in zip(*(jax.tree.leaves(one) for one in (found, plan.trajectory)), strict=True):
        assert isinstance(own, np.ndarray)
        assert own.dtype == np.asarray(other).dtype
    times = np.linspace(0, plan.trajectory.duration, 101)
    before, now = plan.trajectory.sample(times), found.sample(times)
    np.testing.assert_allclose(now.attitude, before.attitude, atol=1e-6)
    np.testing.assert_allclose(now.joints, before.joints, atol=1e-6)


def test_scenes_that_differ_in_names_and_in_how_they_were_searched_share_their_kernels(
    plan, trajectory, compilations
):
    scene = plan.scenario
    other = replace(
        scene,
        name="another night",
        epoch=np.datetime64("2031-05-06T07:08:09"),
        keep_out=tuple(replace(zone, name=f"not {zone.name}") for zone in scene.keep_out),
        keep_in=tuple(replace(zone, name=f"still {zone.name}") for zone in scene.keep_in),
        search=replace(scene.search, seed=7, max_expansions=300),
    )
    assert jax.tree.structure(other) != jax.tree.structure(scene)

    def slopes_of(function, scenario):
        return jax.grad(lambda own: jp.measures.effort(function(own)), allow_int=True)(scenario)

    first, function = slopes_of(trajectory, scene), jp.differentiable(replace(plan, scenario=other))
    with nothing_new(compilations):
        again = slopes_of(function, other)
    assert jax.tree.structure(again) == jax.tree.structure(jax.tree.map(np.zeros_like, other))
    for own, known in zip(*map(jax.tree.leaves, (again, first)), strict=True):
        np.testing.assert_array_equal(own, known)


def test_a_goal_that_is_given_as_a_state_is_differentiated_without_a_context():
    plan = jp.plan(make_scenario(1), progress=False)
    trajectory = jp.differentiable(plan)
    slopes = jax.grad(lambda scenario: jp.measures.effort(trajectory(scenario)), allow_int=True)(
        plan.scenario
    )
    step = 1e-6
    ends = []
    for side in (1, -1):
        joints = plan.scenario.goal.joints + side * step * np.array([1.0, 0.0])
        moved = replace(plan.scenario, goal=replace(plan.scenario.goal, joints=joints))
        ends.append(float(jp.measures.effort(trajectory(moved))))
    assert float(slopes.goal.joints[0]) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-4)


@pytest.mark.slow
def test_slopes_under_jit_are_those_in_64_bits_without_a_context(slopes):
    narrow, wide = slopes
    largest = max(float(np.max(np.abs(leaf), initial=0.0)) for leaf in jax.tree.leaves(wide))
    assert largest > 0
    for own, other in zip(*(jax.tree.leaves(one) for one in slopes), strict=True):
        assert own.dtype == jnp.float32
        np.testing.assert_allclose(own, other, rtol=1e-4, atol=1e-6 * largest)
    assert narrow.trajectory.duration < 0  # more time, less effort


@pytest.mark.slow
def test_slopes_without_jit_are_those_under_it(plan, trajectory, slopes):
    plain = jax.grad(lambda scenario: jp.measures.effort(trajectory(scenario)))(plan.scenario)
    largest = max(float(np.max(np.abs(leaf), initial=0.0)) for leaf in jax.tree.leaves(plain))
    for own, other in zip(*(jax.tree.leaves(one) for one in (plain, slopes[1])), strict=True):
        assert own.dtype == jnp.float32
        np.testing.assert_allclose(own, other, rtol=1e-4, atol=1e-6 * largest)


@pytest.mark.slow
def test_many_scenarios_are_followed_at_once(plan, trajectory):
    durations = plan.scenario.trajectory.duration * jnp.array([1.0, 1.02])

    def effort(scenario):
        return jp.measures.effort(trajectory(scenario))

    def at(duration):
        settings = replace(plan.scenario.trajectory, duration=duration)
        return effort(replace(plan.scenario, trajectory=settings))

    together, alone = quick_jit(jax.vmap(at))(durations), quick_jit(at)
    np.testing.assert_allclose(together, [alone(duration) for duration in durations], rtol=2e-6)
    assert together[1] < together[0]


@pytest.mark.slow
def test_within_64_bits_it_is_replan_and_has_both_modes(plan, trajectory, slopes):
    with jax.enable_x64(True):
        along = quick_jit(
            lambda at, way: jax.jvp(lambda own: jp.measures.effort(trajectory(own)), (at,), (way,))
        )
        _, slope = along(plan.scenario, slopes[1])
    square = sum(float(np.sum(np.square(leaf))) for leaf in jax.tree.leaves(slopes[1]))
    np.testing.assert_allclose(float(slope), square, rtol=1e-8)


@pytest.mark.slow
def test_within_64_bits_plain_numbers_have_both_modes_by_kernels(plan, trajectory, slopes):
    def effort(own):
        return jp.measures.effort(trajectory(own))

    with jax.enable_x64(True):
        back = jax.grad(effort, allow_int=True)(plan.scenario)
        way = jax.tree.map(
            lambda leaf, slope: (
                np.zeros(np.shape(leaf), jax.dtypes.float0) if slope.dtype.kind == "V" else slope
            ),
            plan.scenario,
            back,
        )
        _, along = jax.jvp(effort, (plan.scenario,), (way,))
    real = [np.asarray(leaf) for leaf in jax.tree.leaves(back) if leaf.dtype.kind == "f"]
    expected = [np.asarray(leaf) for leaf in jax.tree.leaves(slopes[1]) if leaf.dtype.kind == "f"]
    for own, other in zip(real, expected, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(float(along), sum(np.sum(leaf**2) for leaf in real), rtol=1e-8)


def test_what_is_no_plan_or_scenario_is_named(plan, trajectory):
    with pytest.raises(TypeError, match="plan must be a Plan"):
        jp.differentiable(plan.scenario)
    with pytest.raises(TypeError, match="scenario must be a Scenario"):
        trajectory(plan)


@pytest.mark.slow
def test_a_plan_can_be_made_a_function_while_its_own_arrays_are_differentiated_by():
    plan = jp.plan(jp.paper_case(1), progress=False)
    trajectory = jp.differentiable(plan)
    with jax.enable_x64(False):
        inside = jax.grad(lambda own: jp.measures.effort(jp.differentiable(plan)(own)), allow_int=True)
        outside = jax.grad(lambda own: jp.measures.effort(trajectory(own)), allow_int=True)
        slopes = [find(plan.scenario).trajectory.duration for find in (inside, outside)]
    np.testing.assert_allclose(*slopes, rtol=1e-6)


def camera_looks(direction, **settings):
    """A spacecraft, in lists, with a camera alone that is free to roll about what it looks at."""
    craft = jp.Spacecraft(
        instruments=(jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),),
        inertia=[[40, 1, 0], [1, 50, -2], [0, -2, 45]],
        rate_limit=[0.02] * 3,
        acceleration_limit=np.deg2rad(0.2),
    )
    return jp.Scenario(
        name="camera",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=[0.0, 0.0, 0.0], joints=[]),
        goal=jp.Targets.of({"camera": direction}),
        trajectory=jp.TrajectorySettings(**settings),
    )


def test_the_optimum_is_certified_where_step_1_leaves_the_goal_slightly_off_its_own():
    plan = jp.plan(camera_looks([0.6, 0.0, 0.8], duration=200.0, optimal=True), progress=False)
    optimum = jp.differentiable(plan).optimum
    assert optimum.ok
    assert optimum.certificate.certified
    assert jp.certify(optimum).certified
    np.testing.assert_allclose(optimum.goal.attitude[:, 2], [0.6, 0.0, 0.8], rtol=0, atol=1e-8)


def test_second_derivatives_are_refused_whatever_jax_is_set_to():
    plan = jp.plan(camera_looks([0.6, 0.0, 0.8], duration=200.0), progress=False)
    trajectory = jp.differentiable(plan)

    def effort(duration):
        settings = replace(plan.scenario.trajectory, duration=duration)
        return jp.measures.effort(trajectory(replace(plan.scenario, trajectory=settings)))

    for second in (jax.hessian(effort), jax.grad(jax.grad(effort))):
        with pytest.raises(NotImplementedError, match="first derivatives only"):
            second(200.0)


def test_slopes_are_refused_where_the_least_rotation_is_half_a_turn_either_way():
    plan = jp.plan(camera_looks([0.0, 0.0, -1.0], duration=200.0), progress=False)
    with pytest.raises(
        ValueError, match="half a turn away, where the least rotation turns one way or the other"
    ):
        jp.differentiable(plan)


def as_the_manual_writes(**changes):
    """The camera, its inertia, limits and target in lists."""
    return replace(camera_looks([0.6, 0.0, 0.8], duration=200.0), **changes)


def test_lists_may_stand_for_arrays_as_they_may_for_a_plan():
    plan = jp.plan(as_the_manual_writes(), progress=False)
    trajectory = jp.differentiable(plan)
    own, found = trajectory(plan.scenario), trajectory(as_the_manual_writes())
    for one, other in zip(jax.tree.leaves(own), jax.tree.leaves(found), strict=True):
        np.testing.assert_array_equal(one, other)
    slopes = [
        jax.grad(lambda own: jp.measures.effort(trajectory(own)), allow_int=True)(scenario)
        for scenario in (as_the_manual_writes(), plan.scenario)
    ]
    np.testing.assert_allclose(*(np.ravel(one.goal.directions) for one in slopes), rtol=1e-5)


def test_a_scenario_with_other_devices_or_more_zones_is_refused_by_their_names():
    plan = jp.plan(as_the_manual_writes(), progress=False)
    trajectory = jp.differentiable(plan)
    ship, sun = (jp.KeepOut(name=name, direction=[0.0, 1.0, 0.0], half_angle=0.1) for name in ("ship", "sun"))
    others = {
        "scenario has the devices terminal-1, terminal-2, terminal-3: must have those of the plan, camera": (
            jp.paper_case(1)
        ),
        "scenario has keep_out ship, sun: must have as many as the plan, which has none": (
            as_the_manual_writes(keep_out=[ship, sun])
        ),
    }
    for words, other in others.items():
        for call in (trajectory, jax.jit(trajectory)):
            with pytest.raises(ValueError, match=words):
                call(other)


def test_what_no_file_may_hold_is_refused_as_by_a_plan():
    plan = jp.plan(as_the_manual_writes(), progress=False)
    trajectory = jp.differentiable(plan)
    settings = replace(plan.scenario.trajectory, duration=-1.0)
    with pytest.raises(jp.ScenarioError, match="scenario: trajectory"):
        trajectory(replace(plan.scenario, trajectory=settings))
