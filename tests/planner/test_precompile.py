"""Nothing is compiled again for scenarios of a kind once its kernels are there."""

import threading
from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario
from kernels import nothing_new

import jaxplan as jp
from jaxplan import gradients, warming
from jaxplan.planner import precompile as planner_ahead
from jaxplan.planner.steps import find_goals
from jaxplan.runtime import jit
from jaxplan.runtime.ahead import ahead, cores, side_by_side
from jaxplan.runtime.jit import kernel_count
from jaxplan.search import precompile as search_ahead

KINDS = ("keep_out", "keep_in", "hard_keep_out", "hard_keep_in", "held_links")
DURATIONS = ("stretched", "minimum", 60.0)
ROBUST = jp.Robust(attitude_error=0.002, joint_error=0.001)


def timed(scenario, duration):
    return replace(scenario, trajectory=replace(scenario.trajectory, duration=duration))


@pytest.mark.slow
def test_random_scenes_of_all_kinds_and_durations_compile_nothing_once_two_classes_are_warm(
    compilations,
):
    # up to 8 zones by themselves, and up to 8 beside them in groups
    for kind in ("keep_out", "hard_keep_in"):
        jp.warm_up(jp.random_scenario(0, kind), progress=False)
    for seed in range(200):
        scenario = jp.random_scenario(seed, KINDS[seed % len(KINDS)])
        with nothing_new(compilations, seed):
            jp.plan(timed(scenario, DURATIONS[seed // 5 % 3]), throw=False, progress=False)


@pytest.mark.slow
def test_batches_compile_nothing_once_they_are_warm(compilations):
    jp.warm_up(jp.random_scenario(0, "hard_keep_out"), batches=True, progress=False)
    scenarios = [jp.random_scenario(seed, "hard_keep_out") for seed in range(40)]
    with nothing_new(compilations):
        plans = jp.plan_batch(scenarios, progress=False)
    assert all(plan.ok for plan in plans)


@pytest.mark.slow
def test_gradients_compile_nothing_once_they_are_warm(compilations):
    scenario = jp.paper_case(1)
    jp.warm_up(scenario, gradients=True, progress=False)
    plan = jp.plan(scenario, progress=False)
    trajectory = jp.differentiable(plan)
    compilations.clear()
    slope = jax.grad(lambda own: jp.measures.effort(trajectory(own)), allow_int=True)(plan.scenario)
    assert np.isfinite(slope.trajectory.duration)
    assert len(compilations) <= 2  # the function itself, which JAX takes for a new one


def test_a_spacecraft_stands_for_scenarios_of_up_to_eight_zones(compilations):
    scenario = make_scenario(1)
    jp.warm_up(scenario.spacecraft, progress=False)
    with nothing_new(compilations):
        assert jp.plan(timed(scenario, "stretched"), progress=False).ok


def test_a_spacecraft_stands_for_scenarios_with_a_tube_too():
    """A mask of four corners has four more rows there, so three of them need twelve more."""
    corners = np.deg2rad([[60, 0], [70, -5], [80, 0], [70, 10]])
    masked = [
        replace(one, mask=tuple(corners + np.deg2rad([shift, 0]) for shift in (0, 8)))
        for one in make_scenario(1).spacecraft.terminals
    ]
    craft = replace(make_scenario(1).spacecraft, terminals=tuple(masked))
    found = warming._still_scenarios(craft)
    shapes = [one.constraints.bound.shape for one in found]
    for own in found[:2]:
        assert replace(own, robust=ROBUST).constraints.bound.shape in shapes
    assert len(set(shapes)) > 1
    # without masks tables are the same
    assert len(warming._still_scenarios(make_scenario(1).spacecraft)) == 2


@pytest.mark.parametrize(
    ("problem", "options", "error", "words"),
    [
        ("case-2.toml", {}, TypeError, "problem must be a Scenario or a Spacecraft, not str"),
        (make_scenario(1).spacecraft, {"gradients": True}, ValueError, "gradients = True: needs a scenario"),
        (make_scenario(1), {"gradients": 1}, TypeError, "gradients must be True or False, not 1"),
        (make_scenario(1), {"batches": "no"}, TypeError, "batches must be True or False, not 'no'"),
        (replace(make_scenario(1), keep_out=3), {}, ValueError, "keep_out"),
    ],
)
def test_what_cannot_be_warmed_up_is_refused(problem, options, error, words):
    with pytest.raises(error, match=words):
        jp.warm_up(problem, progress=False, **options)


def test_a_kind_is_asked_for_once_by_itself_and_once_for_batches(monkeypatch):
    monkeypatch.setattr(planner_ahead, "_begun_kinds", set())
    scenarios = [make_scenario(1), replace(make_scenario(1), name="twin")]
    assert planner_ahead.usual_tasks(scenarios[:1])
    assert not planner_ahead.usual_tasks(scenarios[:1])
    assert planner_ahead.usual_tasks(scenarios)
    assert not planner_ahead.usual_tasks(scenarios)


def test_of_many_scenarios_of_a_kind_some_are_hard(monkeypatch):
    tasks = []
    for count in (planner_ahead._MIN_COUNT_FOR_SMOOTHING - 1, planner_ahead._MIN_COUNT_FOR_SMOOTHING):
        monkeypatch.setattr(planner_ahead, "_begun_kinds", set())
        tasks.append(len(planner_ahead.usual_tasks([make_scenario(1)] * count)))
    assert tasks[1] > tasks[0] > 0


def test_the_band_of_a_goal_of_least_time_waits_until_the_motion_to_the_nearest_goal_is_not_clear(
    monkeypatch,
):
    scenario = jp.paper_case(2)
    soonest = timed(replace(scenario, goal=replace(scenario.goal, criterion="least_time")), "minimum")
    counts, banded = [], []
    for one, many in ((soonest, False), (soonest, True)):
        monkeypatch.setattr(planner_ahead, "_begun_kinds", set())
        counts.append(len(planner_ahead._tasks_for_one(one, many)))
    assert counts[1] == counts[0] + 1
    monkeypatch.setattr(search_ahead, "straight_bands", lambda *_: banded.append(1))
    goal = find_goals(scenario)[0]
    for one, wanted in ((scenario, 1), (replace(scenario, keep_out=(), keep_in=()), 0)):
        banded.clear()
        for task in planner_ahead.further_tasks(one, goal):
            task()
        assert len(banded) == wanted


def test_goals_of_least_time_tell_the_nearest_goal_first():
    scenario = jp.paper_case(2)
    told = []
    nearest = find_goals(scenario, told=told.append)[0]
    assert not told
    find_goals(replace(scenario, goal=replace(scenario.goal, criterion="least_time")), told=told.append)
    (first,) = told
    np.testing.assert_allclose(first.attitude, nearest.attitude, atol=1e-9)


@pytest.mark.parametrize("method", ["paper", "global"])
def test_tasks_of_a_gradient_compile_the_kernels_that_it_calls(compilations, method):
    scenario = jp.paper_case(1)
    plan = jp.plan(replace(scenario, trajectory=replace(scenario.trajectory, method=method)), progress=False)
    trajectory = jp.differentiable(plan)
    side_by_side(gradients._compilation_tasks(trajectory.held, plan.scenario), lambda: None)
    with jax.enable_x64(True):
        before = kernel_count()
        found, back = jax.vjp(trajectory, plan.scenario)
        back(jax.tree.map(np.ones_like, found))
        assert kernel_count() == before


@pytest.mark.skipif(cores() < 2, reason="on one core nothing is done beside something else")
def test_tasks_are_done_beside_a_block_and_those_not_begun_at_its_end_are_left():
    done, go_on = [], threading.Event()

    def wait(number):
        go_on.wait(10)
        done.append(number)

    before = threading.active_count()
    with ahead([lambda number=number: wait(number) for number in range(50)]):
        assert threading.active_count() > before
    go_on.set()
    for thread in set(threading.enumerate()) - {threading.current_thread()}:
        if thread.name.endswith("(work)"):
            thread.join()
    assert len(done) <= cores()


@pytest.mark.skipif(cores() < 2, reason="on one core nothing is done beside something else")
def test_a_kernel_that_nobody_waits_for_any_more_is_traced_and_not_compiled(compilations):
    begun, go_on = threading.Event(), threading.Event()

    @jit.quick_jit
    def slow_to_trace(x):
        begun.set()
        go_on.wait(10)
        return x + 1

    with ahead([lambda: slow_to_trace(1.0)]):
        begun.wait(10)
    go_on.set()
    for thread in threading.enumerate():
        if thread.name.endswith("(work)"):
            thread.join()
    assert "jit(slow_to_trace)" not in compilations
    assert slow_to_trace(1.0) == 2  # for whoever asks for it after all
    assert "jit(slow_to_trace)" in compilations


@pytest.mark.skipif(cores() < 2, reason="on one core nothing is done beside something else")
def test_tasks_may_come_later_as_long_as_the_block_runs():
    done = threading.Event()
    with ahead([]) as work:
        work.add([done.set])
        assert done.wait(10)
    late = threading.Event()
    work.add([late.set])
    assert not late.wait(0.1)


def test_a_task_that_fails_beside_a_block_is_silent_and_side_by_side_it_is_told():
    def fail():
        raise ArithmeticError("no answer")

    with ahead([fail]):
        pass
    with pytest.raises(ArithmeticError, match="no answer"):
        side_by_side([fail], lambda: None)
    counted = []
    side_by_side([lambda: None] * 5, lambda: counted.append(1))
    assert len(counted) == 5
