"""Plans of many scenarios in rounds: scenario -> goals -> path -> trajectory -> certificate -> plan.

In each round all scenarios that are not settled yet get what they need next: their goals are found one by
one, their searches, fits and proofs are made together. What that is, with all retries, is for their
`Attempts` to say.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from jaxplan.model.scenario import Scenario
from jaxplan.planner.attempts import Attempts, SearchQuery
from jaxplan.planner.clock import Clock, shared_step
from jaxplan.planner.goals import GoalQuery, find_goals
from jaxplan.planner.proof import ProofQuery, prove_batch
from jaxplan.planner.record import Plan
from jaxplan.runtime.jit import clear_if_full
from jaxplan.search import search_batch
from jaxplan.trajectory import FitQuery, fit_batch

Query = TypeVar("Query")


def plan_in_rounds(
    scenarios: Sequence[Scenario],
    clocks: Sequence[Clock],
    settled: Callable[[int], object] = lambda count: None,
) -> list[Plan]:
    """Plan scenarios together.

    Args:
        scenarios: the problems.
        clocks: of each.
        settled: is told after each round how many plans have been settled by it.

    Returns:
        The plans in the same order, failed ones with their status and message.
    """
    every = [Attempts(*one) for one in zip(scenarios, clocks, strict=True)]
    open_ = every
    while open_:
        clear_if_full()
        _find_goals(open_)
        _search_paths(open_)
        _fit_trajectories(open_)
        _prove_certificates(open_)
        left = [attempts for attempts in open_ if attempts.need is not None]
        settled(len(open_) - len(left))
        open_ = left
    return [attempts.result() for attempts in every]


def _find_goals(open_: Sequence[Attempts]) -> None:
    """Step 1 of all that need it, one by one."""
    for attempts, query in _in_need(open_, GoalQuery):
        with attempts.clock.step("decompose"):
            found = find_goals(query.scenario, query.time)
        attempts.accept_goals(found)


def _search_paths(open_: Sequence[Attempts]) -> None:
    """Step 2 of all that need it, together."""
    waiting = _in_need(open_, SearchQuery)
    with shared_step("search", [attempts.clock for attempts, _ in waiting]) as seconds:
        scenes, settings = [query.scene for _, query in waiting], [query.settings for _, query in waiting]
        found = search_batch(scenes, settings, seconds)
    for (attempts, _), result in zip(waiting, found, strict=True):
        attempts.accept_path(result)


def _fit_trajectories(open_: Sequence[Attempts]) -> None:
    """Step 3 of all that need it, together."""
    waiting = _in_need(open_, FitQuery)
    with shared_step("trajectory", [attempts.clock for attempts, _ in waiting]) as seconds:
        found = fit_batch([query for _, query in waiting], seconds)
    for (attempts, _), fitted in zip(waiting, found, strict=True):
        attempts.accept_fit(fitted)


def _prove_certificates(open_: Sequence[Attempts]) -> None:
    """The certificates of all that need one, together."""
    waiting = _in_need(open_, ProofQuery)
    with shared_step("certificate", [attempts.clock for attempts, _ in waiting]):
        found = prove_batch([query for _, query in waiting])
    for (attempts, _), certificate in zip(waiting, found, strict=True):
        attempts.accept_certificate(certificate)


def _in_need(open_: Sequence[Attempts], kind: type[Query]) -> list[tuple[Attempts, Query]]:
    """The attempts whose next need is of a kind, each with that need."""
    needs: list[tuple[Attempts, Any]] = [(attempts, attempts.need) for attempts in open_]
    return [(attempts, need) for attempts, need in needs if isinstance(need, kind)]
