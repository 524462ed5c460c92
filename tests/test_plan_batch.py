from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from fake_study import die
from scenes import with_search
from trust import golden

import jaxplan as jp
from jaxplan.planner import runs


def scenarios() -> list[jp.Scenario]:
    """Easy and hard ones, one that needs a second search, and some that fail in different steps."""
    case = jp.paper_case(2)
    invalid = replace(case, start=replace(case.start, joints=case.start.joints + 3.0))
    tight = replace(case, trajectory=replace(case.trajectory, duration=20.0))
    return [
        case,
        jp.random_scenario(10, "hard_keep_out"),
        invalid,
        jp.random_scenario(0, "held_links"),
        with_search(jp.random_scenario(10, "hard_keep_out"), max_expansions=2),
        tight,
        jp.random_scenario(2, "keep_in"),
    ]


@pytest.fixture(scope="module")
def batch() -> list[jp.Plan]:
    return jp.plan_batch(scenarios())


def expect_the_same(one: jp.Plan, other: jp.Plan) -> None:
    """Two plans are one to the last bit."""
    assert (one.status, one.message) == (other.status, other.message)
    assert (one.path is None) == (other.path is None)
    if other.path is not None:
        assert np.array_equal(one.path.attitudes, other.path.attitudes)
        assert np.array_equal(one.path.joints, other.path.joints)
        assert one.search.expansions == other.search.expansions
    assert (one.trajectory is None) == (other.trajectory is None)
    if other.trajectory is not None:
        assert one.trajectory.duration == other.trajectory.duration
        t = np.linspace(0, other.trajectory.duration, 50)
        assert np.array_equal(one.trajectory.sample(t).joints, other.trajectory.sample(t).joints)
    assert (one.report and one.report.min_margin) == (other.report and other.report.min_margin)
    with TemporaryDirectory() as folder:
        assert golden.file_of(one, Path(folder)) == golden.file_of(other, Path(folder))


def test_a_batch_gives_the_same_plans_as_one_by_one(batch):
    for scenario, together in zip(scenarios(), batch, strict=True):
        expect_the_same(together, jp.plan(scenario, throw=False))


def test_random_scenes_are_planned_as_the_golden_set_says(batch):
    names = ("case 2", "hard_keep_out 10", "held_links 0", "keep_in 2")
    for name, plan in zip(names, [plan for plan in batch if plan.ok], strict=True):
        assert golden.verdict(name, plan)


def test_other_processes_give_the_same_plans(batch):
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        for here, there in zip(batch, jp.plan_batch(scenarios(), executor=pool), strict=True):
            expect_the_same(there, here)


def test_a_process_that_dies_is_an_error_that_says_what_outlives_it(monkeypatch):
    monkeypatch.setattr(runs, "_plan_part", die)
    with pytest.raises(RuntimeError, match="run_study outlives"):
        jp.plan_batch(scenarios()[:1], executor=1)


@pytest.mark.parametrize("executor", [0, -1, "two", True])
def test_what_cannot_plan_is_refused_before_anything_is(executor):
    with pytest.raises((TypeError, ValueError), match="executor"):
        jp.plan_batch(scenarios(), executor=executor)


def test_scenes_that_fail_do_not_keep_others_from_being_planned(batch):
    statuses = [plan.status for plan in batch]
    assert statuses.count(jp.Status.OK) == 4
    assert {jp.Status.INVALID_START, jp.Status.NODE_LIMIT, jp.Status.LIMITS_TOO_TIGHT} <= set(statuses)


def test_each_plan_knows_its_share_of_the_time(batch):
    for plan in batch:
        steps = {name: seconds for name, seconds in plan.timings.items() if name != "total"}
        assert plan.timings["total"] == pytest.approx(sum(steps.values()))
        assert (plan.search is not None) <= ("search" in steps)


def test_long_batches_are_planned_in_parts(batch, monkeypatch):
    monkeypatch.setattr(runs, "TOGETHER", 3)
    again = jp.plan_batch(scenarios())
    for first, second in zip(batch, again, strict=True):
        assert first.status is second.status
        assert first.path is None or np.array_equal(first.path.joints, second.path.joints)


def test_a_batch_may_be_empty_and_names_what_is_no_scenario():
    assert jp.plan_batch([]) == []
    with pytest.raises(TypeError, match=r"scenarios\[1\] must be a Scenario, not str"):
        jp.plan_batch([jp.paper_case(1), "case-1.toml"])
    with pytest.raises(TypeError, match=r"scenarios must be several, not a Scenario; jp\.plan plans one"):
        jp.plan_batch(jp.paper_case(1))
    assert [plan.ok for plan in jp.plan_batch(jp.paper_case(number) for number in (2,))] == [True]
