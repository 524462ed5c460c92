"""Plans as functions of their scenario: derivatives against differences of plans that are made anew."""

import re
from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from builders import make_scenario
from held_plans import CASES, metric, plan_of, turned, valued, widened_tube
from node_paths import fit_global
from quick import quick_jit
from reference import assert_each

import jaxplan as jp
from jaxplan.derivatives import follow, hold, replan
from jaxplan.model.path import Path
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn
from jaxplan.planner.steps import fit

STEP = 5e-6  # which is within what the rows that bind allow


cases = pytest.mark.parametrize("case", CASES)


@cache
def compiled():
    return quick_jit(
        jax.value_and_grad(lambda scenario, held: metric(replan(held, scenario)), allow_int=True)
    )


replanned = quick_jit(replan)


def told(scenario, held):
    """Value and gradient in every number of the scenario, at what is held of a plan."""
    # Numbers of Python, of numpy and of both would be compiled for anew.
    return compiled()(jax.tree.map(np.asarray, scenario), held)


def made_anew(case, scenario):
    """The number of a plan that is made anew between the same interior nodes, at its very optimum."""
    plan = follow(plan_of(case), scenario)
    assert plan.trajectory is not None, plan.message
    with jax.enable_x64(True):
        if scenario.trajectory.method == "paper":  # its programs are solved to rounding
            return float(valued()(plan.trajectory))
        craft, start = scenario.spacecraft, scenario.start
        fit = fit_global(
            plan.path,
            craft,
            scenario.trajectory,
            cones=tabulate(scenario.keep_out, scenario.keep_in, craft),
            start_angular_velocity=start.angular_velocity,
        )
        assert fit.origin is not None, fit.message
        return float(told(scenario, replace(hold(plan_of(case)), fit=fit.origin.hold(), goal=plan.goal))[0])


def leaves_of(scenario):
    return jax.tree_util.tree_flatten_with_path(scenario)


@pytest.mark.slow
@cases
def test_gradients_are_those_of_plans_that_are_made_anew(case):
    plan = plan_of(case)
    scenario = plan.scenario
    with jax.enable_x64(True):
        value, gradient = told(scenario, hold(plan))
    assert float(value) == pytest.approx(made_anew(case, scenario), rel=1e-9)
    leaves, tree = jax.tree_util.tree_flatten_with_path(scenario)
    slopes = [np.asarray(slope) for slope in jax.tree.leaves(gradient)]
    names = [jax.tree_util.keystr(path) for path, _ in leaves]
    if not np.any(scenario.start.angular_velocity):  # with a rate it would be gone along at another pace
        slopes = [
            np.zeros(1) if "velocity" in name or "joint_rates" in name else slope
            for name, slope in zip(names, slopes, strict=True)
        ]
    telling = [slope.dtype.kind == "f" and bool(np.any(np.abs(slope) > 1e-7)) for slope in slopes]
    assert all(np.all(np.isfinite(slope)) for slope in slopes if slope.dtype.kind == "f")
    rng = np.random.default_rng(0)
    of = {name.split(".")[1].split("[")[0] for name, tells in zip(names, telling, strict=True) if tells}
    assert of >= {"start", "goal", "trajectory", "spacecraft"}
    for part in (("start", "goal", "spacecraft", "keep_out", "keep_in"), ("trajectory",)):
        steps, expected = [], 0.0
        for (_, leaf), name, slope, tells in zip(leaves, names, slopes, telling, strict=True):
            step = np.zeros(np.shape(leaf))
            if tells and name.split(".")[1].split("[")[0] in part:
                step = rng.normal(size=np.shape(leaf)) * max(1.0, float(np.max(np.abs(leaf))))
                if "direction" in name:  # a unit vector is turned
                    step -= np.sum(step * leaf, axis=-1, keepdims=True) * leaf
                expected += float(np.sum(slope * step))
            steps.append(step)

        def at(share, steps=steps):
            changed = [
                leaf + share * step if np.any(step) else leaf
                for (_, leaf), step in zip(leaves, steps, strict=True)
            ]
            return made_anew(case, jax.tree.unflatten(tree, changed))

        found = (at(STEP) - at(-STEP)) / (2 * STEP)
        assert expected == pytest.approx(found, rel=1e-6, abs=1e-7), part


@pytest.mark.slow
@cases
def test_the_optimum_is_found_from_some_way_off_while_the_same_rows_bind(case):
    plan, settings = plan_of(case), plan_of(case).scenario.trajectory
    heavier = replace(settings, acceleration_weight=1.001 * settings.acceleration_weight)
    heavier = replace(plan.scenario, trajectory=heavier)
    held = hold(plan)
    with jax.enable_x64(True):
        value, off = (float(told(scenario, held)[0]) for scenario in (plan.scenario, heavier))
        assert off == pytest.approx(made_anew(case, heavier), rel=1e-9)
        assert abs(off - value) > 1e-6
        if settings.method == "global":
            noise = np.random.default_rng(0).normal(size=held.fit.x.shape)
            held = replace(held, fit=replace(held.fit, x=held.fit.x + 0.01 * noise))
            assert float(told(plan.scenario, held)[0]) == pytest.approx(value, rel=1e-11)


@pytest.mark.slow
@cases
def test_what_is_no_number_gives_none_and_an_end(case):
    plan = plan_of(case)
    settings = replace(plan.scenario.trajectory, acceleration_weight=np.nan)
    with jax.enable_x64(True):
        value, _ = told(replace(plan.scenario, trajectory=settings), hold(plan))
    assert np.isnan(value)


@pytest.mark.slow
@pytest.mark.parametrize("duration", [60.0, 62.0, 64.0])
def test_what_binds_is_told_where_a_rate_stays_the_same_for_long(duration):
    plan = turned(duration)  # its rows follow from each other, at the limit and near it
    fit = hold(plan).fit
    assert_each(fit.multipliers, ">=", 0)
    assert np.count_nonzero(fit.multipliers) == fit.linear.on.sum() + fit.loads.on.sum()


def test_a_motion_that_comes_back_to_where_it_starts_is_followed():
    scenario = make_scenario(1)
    start = replace(scenario.start, angular_velocity=np.array([0.004, -0.003, 0.002]))
    settings = replace(scenario.trajectory, duration=40.0)
    plan = jp.plan(replace(scenario, start=start, goal=scenario.start, trajectory=settings))
    with jax.enable_x64(True):
        again = replanned(hold(plan), jax.tree.map(np.asarray, plan.scenario))
    own = plan.trajectory.coefficients
    assert np.max(np.abs(own[:, 1:])) > 1e-4
    np.testing.assert_allclose(again.coefficients, own, rtol=0, atol=1e-10)


@pytest.mark.slow
def test_slopes_of_a_motion_between_rates_in_a_given_time_are_differences_of_plans_made_anew():
    case = jp.paper_case(2)
    rates = {"angular_velocity": np.array([0.001, -0.002, 0.003]), "joint_rates": np.full(6, 0.002)}
    scenario = replace(
        case,
        start=replace(case.start, **rates),
        trajectory=jp.TrajectorySettings(duration=70.0, optimal=True),
    )
    plan = jp.plan(scenario, progress=False)
    trajectory = jp.differentiable(plan)
    with jax.enable_x64(True):
        slope = jax.grad(lambda own: jp.measures.effort(trajectory(own)), allow_int=True)(plan.scenario)
    ways = {"angular_velocity": np.array([0.3, -0.5, 0.8]), "joint_rates": np.linspace(-1.0, 1.0, 6)}
    told = 20.0 * slope.trajectory.duration + sum(
        np.sum(getattr(slope.start, name) * way) for name, way in ways.items()
    )

    def effort(step):
        start = replace(case.start, **{name: rates[name] + step * way for name, way in ways.items()})
        settings = replace(scenario.trajectory, duration=70.0 + 20.0 * step)
        return float(jp.measures.effort(jp.follow(plan, replace(scenario, start=start, trajectory=settings))))

    assert told == pytest.approx((effort(1e-5) - effort(-1e-5)) / 2e-5, rel=1e-6)


@pytest.mark.slow
def test_what_has_no_derivative_is_refused_with_a_reason():
    scenario = make_scenario(1)
    shortest = replace(scenario, trajectory=replace(scenario.trajectory, duration="minimum"))
    # Just above the shortest time the fit in a given one may fail, and the shortest motion is slowed.
    duration = 1.001 * jp.plan(shortest).trajectory.duration
    slowed = jp.plan(replace(scenario, trajectory=replace(scenario.trajectory, duration=duration)))
    said = (
        f"for a duration of {duration:g} s a quicker motion was slowed, which has no derivatives: try another"
    )
    with pytest.raises(ValueError, match=re.escape(said)):
        hold(slowed)
    # So may one without limits, which to be stretched to them has derivatives.
    origin = fit(scenario, slowed.path, slowed.goal).origin
    origin.hold()
    problem = replace(origin.problem, settings=slowed.scenario.trajectory)
    with pytest.raises(ValueError, match=re.escape(said)):
        replace(origin, problem=problem, stretched=False).hold()
    speed = replace(scenario.start, angular_velocity=np.array([0.004, -0.003, 0.002]))
    at_speed = replace(scenario, start=speed)  # "stretched"
    with pytest.raises(
        ValueError, match="has no derivatives: it is a shortest motion with rates at its ends"
    ):
        hold(jp.plan(at_speed))
    there = replace(scenario, goal=replace(scenario.start))
    with pytest.raises(ValueError, match="does not move"):
        hold(jp.plan(there))
    tight = replace(scenario, trajectory=replace(scenario.trajectory, duration=1.0))
    failed = jp.plan(tight, throw=False)
    with pytest.raises(ValueError, match=f"ended as {failed.status.name}"):
        hold(failed)


def assert_replanned(plan):
    """What is replanned at a plan's own scenario is the plan."""
    scenario = jax.tree.map(np.asarray, replace(plan.scenario, name="", epoch=None))
    with jax.enable_x64(True):
        again = replanned(hold(plan), scenario)
    # Its times of nodes are each told once, and then padded.
    again, expected = (
        replace(each, node_times=np.unique(each.node_times)) for each in (again, plan.trajectory)
    )
    for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(expected), strict=True):
        assert np.shape(one) == np.shape(other)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-7)


def test_plans_whose_tube_was_widened_are_replanned_as_they_are():
    plan = widened_tube()
    assert "up to 1.2 deg off" in plan.message
    assert_replanned(plan)


@pytest.mark.parametrize("method", ["global", "paper"])
def test_nodes_that_are_repeated_are_passed_over(method):
    scenario = make_scenario(1)
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration=60.0, method=method))
    plan = jp.plan(scenario)
    middle = len(plan.path.attitudes) // 2
    twice = np.insert(np.arange(len(plan.path.attitudes)), middle, middle)
    path = Path(
        attitudes=plan.path.attitudes[twice],
        joints=plan.path.joints[twice],
        edge_costs=np.insert(plan.path.edge_costs, middle, 0.0),
    )
    assert_replanned(follow(replace(plan, path=path), scenario))


@pytest.mark.slow
def test_plans_whose_group_changes_hands_are_replanned_as_they_are():
    scenario = make_scenario(0, 1, turn=(0.5, -0.8, 0.6))
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration=60.0))
    boresight = scenario.spacecraft.fixed_boresights[0]
    seen = jp.plan(scenario).trajectory.sample(np.array([0.0, 15.0, 45.0, 60.0])).attitude @ boresight
    across = np.cross(seen[0], seen[3]) / np.linalg.norm(np.cross(seen[0], seen[3]))
    wide, tight = [], []
    for number, (middle, end) in enumerate(((1, 0), (2, 3))):
        axis = seen[middle] + np.deg2rad(8.0) * across
        axis /= np.linalg.norm(axis)
        names = scenario.spacecraft.device_names
        for zones, room in ((wide, 1.0), (tight, 0.7)):
            angle = float(np.arccos(seen[end] @ axis) + np.deg2rad(room))
            zones.append(
                KeepIn(name=f"{number}", direction=axis, half_angle=angle, devices=names, any_of="link")
            )
    plan = jp.plan(replace(scenario, keep_in=tuple(wide)))
    plan = follow(plan, replace(scenario, keep_in=tuple(tight)))
    assert (
        plan.certificate.min_margin <= np.deg2rad(0.3) + 1e-6
    )  # one of them binds where the other takes over
    assert_replanned(plan)


def test_second_derivatives_and_numbers_of_32_bits_are_refused():
    scenario = make_scenario(1)
    plan = jp.plan(replace(scenario, trajectory=replace(scenario.trajectory, duration=30.0)))
    held = hold(plan)

    def end(duration):
        settings = replace(plan.scenario.trajectory, duration=duration)
        return replan(held, replace(plan.scenario, trajectory=settings)).coefficients[3, 2, 0]

    with jax.enable_x64(True), pytest.raises(NotImplementedError, match="first derivatives only"):
        jax.eval_shape(jax.grad(jax.grad(end)), 30.0)
    with jax.enable_x64(False), pytest.raises(ValueError, match=r"call it within jax\.enable_x64"):
        replan(held, plan.scenario)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["global", "paper"])
def test_slopes_of_a_batch_are_those_of_each_and_of_differences_forward_and_reverse(method):
    scenario = make_scenario(1)
    settings = replace(scenario.trajectory, method=method, duration=30.0, rate_weight=1.0)
    scenario = jax.tree.map(np.asarray, replace(scenario, trajectory=settings))
    held = hold(jp.plan(scenario))
    leaves, tree = jax.tree.flatten(scenario)
    varied = [
        number for number, leaf in enumerate(leaves) if leaf.dtype.kind == "f" and np.all(np.isfinite(leaf))
    ]
    own = [leaves[number] for number in varied]

    def number_of(*numbers):
        changed = list(leaves)
        for place, leaf in zip(varied, numbers, strict=True):
            changed[place] = leaf
        return 1e4 * jp.measures.effort(replan(held, jax.tree.unflatten(tree, changed)))

    rng = np.random.default_rng(0)
    batch = [leaf + 1e-4 * rng.normal(size=(64, *leaf.shape)) for leaf in own]
    ways = [rng.normal(size=part.shape) * np.maximum(np.abs(part), 0.1) for part in batch]
    every = tuple(range(len(own)))

    along = quick_jit(jax.vmap(lambda at, way: jax.jvp(number_of, tuple(at), tuple(way))))
    with jax.enable_x64(True):
        reverse = quick_jit(jax.vmap(jax.grad(number_of, every)))(*batch)
        _, forward = along(batch, ways)
        alone = quick_jit(jax.grad(number_of, every))(*(part[5] for part in batch))
        at = {
            share: np.asarray(
                along([part + share * 1e-5 * way for part, way in zip(batch, ways, strict=True)], ways)[0]
            )
            for share in (-2, -1, 1, 2)
        }
    found = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * 1e-5)
    slope = sum(
        (np.asarray(part) * way).reshape(64, -1).sum(axis=1) for part, way in zip(reverse, ways, strict=True)
    )
    assert len(own) >= 15
    off = np.sort(np.abs(slope - found)) / np.abs(found).max()
    assert_each(off[:-3], "<=", 1e-6)  # within the steps the pace of some may have a kink
    assert off[-1] <= 1e-5
    np.testing.assert_allclose(forward, slope, rtol=1e-9, atol=1e-9 * np.abs(slope).max())
    for one, single in zip(reverse, alone, strict=True):
        np.testing.assert_allclose(one[5], single, rtol=1e-8, atol=1e-9)
