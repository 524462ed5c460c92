"""What is tried for a scenario, driven by hand: each need is met by what a test makes up."""

from dataclasses import replace

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.clock import Clock
from jaxplan.planner.ladder import BARE_LADDER, LADDER
from jaxplan.planner.proving import ProofQuery
from jaxplan.planner.record import Plan
from jaxplan.planner.steps import GoalQuery, SearchQuery, find_goals
from jaxplan.search import SearchResult
from jaxplan.search.astar import make_root, trace
from jaxplan.trajectory import Fit, FitQuery

NO_PATH = SearchResult(status=jp.Status.NODE_LIMIT, path=None, expansions=1)


@pytest.fixture(scope="module")
def case_plan() -> jp.Plan:
    return jp.plan(jp.paper_case(2), progress=False)


def begun(scenario: jp.Scenario) -> Attempts:
    """Attempts that have their goals."""
    attempts = Attempts(scenario, Clock(np.inf))
    assert isinstance(attempts.need, GoalQuery)
    attempts.accept_goals(find_goals(scenario, attempts.need.time))
    return attempts


def path_of(query: SearchQuery) -> SearchResult:
    """The straight motion, whatever is in its way."""
    path = trace(query.scene, make_root(query.scene))
    return SearchResult(status=jp.Status.OK, path=path, expansions=0)


def one_goal() -> jp.Scenario:
    case = jp.paper_case(2)
    return replace(case, search=replace(case.search, max_goals=1))


def climbed(attempts):
    """Settings of the searches and numbers of edges of the paths fitted, where no fit succeeds."""
    searched, edges = [], []
    while attempts.need is not None:
        if isinstance(attempts.need, SearchQuery):
            searched.append(attempts.need.settings)
            attempts.accept_path(path_of(attempts.need))
        elif isinstance(attempts.need, FitQuery):
            edges.append(attempts.need.path.edges)
            attempts.accept_fit(Fit(trajectory=None, status=jp.Status.INFEASIBLE, message="made up"))
    return searched, edges


def test_the_ladder_is_climbed_to_its_end_and_no_path_is_searched_or_fitted_twice():
    attempts = begun(one_goal())
    searched, edges = climbed(attempts)
    clearance = one_goal().search.clearance
    assert [own.clearance / clearance for own in searched] == pytest.approx(sorted({f for f, _ in LADDER}))
    assert len({own.seed for own in searched}) == len(searched)
    # all searches find the same path, so it is fitted once with each number of halvings
    assert edges == [edges[0] * 2**halvings for halvings in sorted({own for _, own in LADDER})]
    assert attempts.result().status is jp.Status.INFEASIBLE


def test_goals_that_are_found_anew_have_their_paths_fitted_anew():
    attempts = begun(one_goal())
    before = climbed(attempts)[1]
    attempts.accept_goals(find_goals(one_goal()))
    assert climbed(attempts)[1] == before
    assert attempts.result().status is jp.Status.INFEASIBLE


def test_without_a_path_it_is_searched_again_without_clearance():
    attempts = begun(one_goal())
    attempts.accept_path(NO_PATH)
    assert isinstance(attempts.need, SearchQuery)
    assert attempts.need.settings.clearance == BARE_LADDER[0][0] == 0
    attempts.accept_path(NO_PATH)
    assert attempts.need is None
    assert attempts.result().status is jp.Status.NODE_LIMIT


@pytest.mark.parametrize("method", ["global", "paper"])
def test_only_the_global_method_knows_that_a_duration_is_too_short_along_any_path(method):
    case = one_goal()
    attempts = begun(replace(case, trajectory=replace(case.trajectory, method=method)))
    attempts.accept_path(path_of(attempts.need))
    attempts.accept_fit(Fit(trajectory=None, status=jp.Status.LIMITS_TOO_TIGHT, message="too short"))
    assert (attempts.need is None) is (method == "global")
    assert attempts.plan.message == "too short"


def test_what_is_refused_leads_on_and_what_is_certified_ends_it(case_plan):
    attempts = begun(one_goal())
    fit = Fit(trajectory=case_plan.trajectory, status=jp.Status.OK, message="")
    attempts.accept_path(path_of(attempts.need))
    attempts.accept_fit(fit)
    assert isinstance(attempts.need, ProofQuery)
    attempts.accept_certificate(replace(case_plan.certificate, certified=False))
    assert attempts.plan.status is jp.Status.UNCERTIFIED
    assert isinstance(attempts.need, SearchQuery)
    attempts.accept_path(path_of(attempts.need))
    attempts.accept_fit(fit)
    attempts.accept_certificate(case_plan.certificate)
    assert attempts.need is None
    assert attempts.result().ok


def test_where_no_motion_from_bent_curves_is_certified_the_one_along_the_path_is_tried_last(case_plan):
    case = one_goal()
    attempts = begun(replace(case, trajectory=replace(case.trajectory, duration="minimum")))
    refused, guesses = replace(case_plan.certificate, certified=False), []
    while attempts.need is not None and len(guesses) < 20:
        if isinstance(attempts.need, SearchQuery):
            attempts.accept_path(path_of(attempts.need))
        elif isinstance(attempts.need, ProofQuery):
            attempts.accept_certificate(refused)
        else:
            guesses.append(attempts.need.settings.first_guesses)
            attempts.accept_fit(Fit(trajectory=case_plan.trajectory, status=jp.Status.OK, message=""))
    assert guesses[0] > 0
    assert set(guesses[:-1]) == {guesses[0]}
    assert guesses[-1] == 0
    assert attempts.result().status is jp.Status.UNCERTIFIED


def test_without_goals_the_plan_says_why():
    attempts = Attempts(one_goal(), Clock(np.inf))
    attempts.accept_goals(Plan(scenario=one_goal(), status=jp.Status.GOAL_UNREACHABLE, message="too far"))
    assert attempts.need is None
    assert attempts.result().message == "too far"


def test_a_start_that_breaks_something_is_settled_at_once():
    case = one_goal()
    attempts = Attempts(replace(case, start=replace(case.start, joints=case.start.joints + 3)), Clock(np.inf))
    assert attempts.need is None
    assert attempts.result().status is jp.Status.INVALID_START
