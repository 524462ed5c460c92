from dataclasses import replace

import numpy as np
import pytest
from scenes import with_search

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


def test_a_batch_gives_the_same_plans_as_one_by_one(batch):
    for scenario, together in zip(scenarios(), batch, strict=True):
        alone = jp.plan(scenario, throw=False)
        assert (together.status, together.message) == (alone.status, alone.message)
        assert (together.path is None) == (alone.path is None)
        if alone.path is not None:
            assert np.array_equal(together.path.attitudes, alone.path.attitudes)
            assert np.array_equal(together.path.joints, alone.path.joints)
            assert together.search.expansions == alone.search.expansions
        assert (together.trajectory is None) == (alone.trajectory is None)
        if alone.trajectory is not None:
            assert together.trajectory.duration == alone.trajectory.duration
            t = np.linspace(0, alone.trajectory.duration, 50)
            assert np.array_equal(together.trajectory.sample(t).joints, alone.trajectory.sample(t).joints)
        assert (together.report and together.report.min_margin) == (alone.report and alone.report.min_margin)


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
