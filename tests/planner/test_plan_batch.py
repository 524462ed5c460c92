from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest
from builders import with_search
from fake_study import die
from trust import golden

import jaxplan as jp
from jaxplan.planner import entry_points


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


def expect_agreement(one: jp.Plan, other: jp.Plan) -> None:
    """Two plans agree to 1e-6, with the same status."""
    assert one.status is other.status
    assert (one.path is None) == (other.path is None)
    if other.path is not None:
        assert one.search.expansions == other.search.expansions
        np.testing.assert_allclose(one.path.attitudes, other.path.attitudes, atol=1e-6)
        np.testing.assert_allclose(one.path.joints, other.path.joints, atol=1e-6)
    assert (one.trajectory is None) == (other.trajectory is None)
    if other.trajectory is not None:
        assert one.trajectory.duration == pytest.approx(other.trajectory.duration, rel=1e-6)
        share = np.linspace(0, 1, 50)
        first, second = (plan.trajectory.sample(share * plan.trajectory.duration) for plan in (one, other))
        np.testing.assert_allclose(first.attitude, second.attitude, atol=1e-6)
        np.testing.assert_allclose(first.joints, second.joints, atol=1e-6)
    assert (one.certificate is None) == (other.certificate is None)
    if other.certificate is not None:
        assert one.certificate.min_margin == pytest.approx(other.certificate.min_margin, abs=1e-6)


@pytest.mark.slow
def test_a_batch_agrees_with_one_by_one(batch):
    for scenario, together in zip(scenarios(), batch, strict=True):
        expect_agreement(together, jp.plan(scenario, throw=False))


@pytest.mark.slow
def test_a_batch_of_shortest_motions_agrees_with_one_by_one():
    case = jp.paper_case(2)
    asked = [
        case,
        jp.random_scenario(1, "hard_keep_out"),  # its platform is the slowest
        jp.random_scenario(3, "held_links"),  # along the path of another search, where there is one
        replace(case, goal=replace(case.goal, criterion="least_rotation")),
        jp.random_scenario(3, "any_spacecraft"),
    ]
    asked = [
        replace(one, trajectory=replace(one.trajectory, method="global", duration="minimum")) for one in asked
    ]
    for scenario, together in zip(asked, jp.plan_batch(asked), strict=True):
        expect_agreement(together, jp.plan(scenario, throw=False))
        assert together.ok


def test_the_same_batch_gives_the_same_bytes(batch, tmp_path):
    for one, other in zip(batch, jp.plan_batch(scenarios()), strict=True):
        assert one.message == other.message
        assert golden.file_of(one, tmp_path) == golden.file_of(other, tmp_path)


def test_random_scenes_are_planned_as_the_golden_set_says(batch):
    names = ("case 2", "hard_keep_out 10", "held_links 0", "keep_in 2")
    for name, plan in zip(names, [plan for plan in batch if plan.ok], strict=True):
        assert golden.verdict(name, plan)


@pytest.mark.slow
def test_other_processes_give_the_same_plans(batch):
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        for here, there in zip(batch, jp.plan_batch(scenarios(), workers=pool), strict=True):
            expect_agreement(there, here)


def test_a_process_that_dies_is_an_error_that_says_what_outlives_it(monkeypatch):
    monkeypatch.setattr(entry_points, "_plan_part", die)
    with pytest.raises(RuntimeError, match="run_study outlives"):
        jp.plan_batch(scenarios()[:1], workers=1)


@pytest.mark.parametrize("workers", [0, -1, "two", True])
def test_what_cannot_plan_is_refused_before_anything_is(workers):
    with pytest.raises((TypeError, ValueError), match="workers"):
        jp.plan_batch(scenarios(), workers=workers)


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
    monkeypatch.setattr(entry_points, "TOGETHER", 3)
    again = jp.plan_batch(scenarios())
    for first, second in zip(batch, again, strict=True):
        expect_agreement(first, second)


def test_a_batch_may_be_empty_and_names_what_is_no_scenario():
    assert jp.plan_batch([]) == []
    with pytest.raises(TypeError, match=r"scenarios\[1\] must be a Scenario, not str"):
        jp.plan_batch([jp.paper_case(1), "case-1.toml"])
    with pytest.raises(TypeError, match=r"scenarios must be several, not a Scenario; jp\.plan plans one"):
        jp.plan_batch(jp.paper_case(1))
    assert [plan.ok for plan in jp.plan_batch(jp.paper_case(number) for number in (2,))] == [True]
