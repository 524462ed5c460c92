"""Plan many scenarios in rounds: scenario -> goals -> path -> trajectory -> certificate -> plan.

In each round every scenario that is not settled yet gets what it needs next: goals are found two at a time,
searches, fits and proofs of all scenarios are made together. What a scenario needs, with all retries, is
decided by its `Attempts`, and which attempts are made by its `InTime`.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.clock import Clock
from jaxplan.planner.duration_attempts import InTime
from jaxplan.planner.precompile import further_tasks, usual_tasks
from jaxplan.planner.proving import ProofQuery, prove_batch
from jaxplan.planner.record import Plan
from jaxplan.planner.steps import GoalQuery, SearchQuery, find_goals
from jaxplan.runtime.ahead import Ahead, ahead
from jaxplan.runtime.batching import Seconds
from jaxplan.runtime.garbage import seldom_collected
from jaxplan.runtime.jit import clear_if_full
from jaxplan.runtime.stopwatch import working_time
from jaxplan.search import search_batch
from jaxplan.trajectory import Fit, FitQuery, fit_batch

Query = TypeVar("Query")

_THREADS = 2  # in which goals are found
_TINY = 1e-9  # s, a least time to divide by


def plan_in_rounds(
    scenarios: Sequence[Scenario],
    clocks: Sequence[Clock],
    settled: Callable[[int], object] = lambda count: None,
    made: list[tuple[FitQuery, Fit]] | None = None,
) -> list[Plan]:
    """Plan scenarios together.

    Args:
        scenarios: the problems.
        clocks: one for each scenario.
        settled: called after each round with the number of plans that it has settled.
        made: a list to which all fits are appended, each as (query, fit); None where nobody needs them.

    Returns:
        The plans in the same order, failed ones with their status and message.
    """
    every = [InTime(*one) for one in zip(scenarios, clocks, strict=True)]
    open_ = [one for one in every if one.advance()]
    settled(len(every) - len(open_))
    tasks = usual_tasks([one.scenario for one in open_])
    with seldom_collected(), ahead(tasks) as work:
        new = work if tasks and len(open_) == 1 else None
        while open_:
            clear_if_full()
            under_way = [one.attempts for one in open_]
            _find_goals(under_way, new)
            _search_paths(under_way)
            _fit_trajectories(under_way, made)
            _prove_certificates(under_way)
            left = [one for one in open_ if one.advance()]
            settled(len(open_) - len(left))
            open_ = left
    return [one.result() for one in every]


def _find_goals(open_: Sequence[Attempts], work: Ahead | None) -> None:
    """Run step 1, finding goals, for all attempts that need it, two at a time.

    Most of the time goes to one kernel; the Python code of another query runs meanwhile.

    Args:
        open_: attempts of plans that are not settled.
        work: takes tasks that compile kernels ahead, as the first goals call for; None for no such tasks.
    """

    def find(query: GoalQuery) -> _FoundGoals:
        def told(nearest: Goal) -> None:
            if work is not None:
                work.add(further_tasks(query.scenario, nearest))

        begin, began = time.monotonic(), working_time()
        goals = find_goals(query.scenario, query.time, told)
        return _FoundGoals(goals, time.monotonic() - begin, working_time() - began)

    waiting = _select_waiting(open_, GoalQuery)
    begin = time.monotonic()
    for attempts, _ in waiting:
        attempts.clock.show("decompose")
    every = _find_in_threads(find, [query for _, query in waiting])
    # Two at a time take longer than alone: each is given its share of the time of all.
    share = (time.monotonic() - begin) / max(sum(found.seconds for found in every), _TINY)
    for (attempts, _), (goals, seconds, working) in zip(waiting, every, strict=True):
        attempts.clock.add("decompose", share * seconds, share * working)
        attempts.accept_goals(goals)


class _FoundGoals(NamedTuple):
    """Goals of a scenario, or the failed plan without any, and the time that they took.

    Attributes:
        goals: as `find_goals` returns them.
        seconds: s of wall time.
        working: s of these that were not spent on compiling.
    """

    goals: tuple[Goal, ...] | Plan
    seconds: float
    working: float


def _find_in_threads(
    find: Callable[[GoalQuery], _FoundGoals], queries: Sequence[GoalQuery]
) -> list[_FoundGoals]:
    """Find the goals of many queries in two threads, those of a single one in this thread."""
    if len(queries) < _THREADS:
        return [find(query) for query in queries]
    with ThreadPoolExecutor(_THREADS) as pool:  # on Ctrl-C `map` cancels those that were not begun
        return list(pool.map(find, queries))


def _search_paths(open_: Sequence[Attempts]) -> None:
    """Run step 2, the path search, for all attempts that need it, together."""
    waiting = _select_waiting(open_, SearchQuery)
    with _shared_step("search", [attempts.clock for attempts, _ in waiting]) as seconds:
        scenes, settings = [query.scene for _, query in waiting], [query.settings for _, query in waiting]
        found = search_batch(scenes, settings, seconds)
    for (attempts, _), result in zip(waiting, found, strict=True):
        attempts.accept_path(result)


def _fit_trajectories(open_: Sequence[Attempts], made: list[tuple[FitQuery, Fit]] | None) -> None:
    """Run step 3, the fit, for all attempts that need it, together.

    Each fit is appended to `made` as (query, fit), unless `made` is None.
    """
    waiting = _select_waiting(open_, FitQuery)
    with _shared_step("trajectory", [attempts.clock for attempts, _ in waiting]) as seconds:
        found = fit_batch([query for _, query in waiting], seconds)
    for (attempts, query), fitted in zip(waiting, found, strict=True):
        if made is not None:
            made.append((query, fitted))
        attempts.accept_fit(fitted)


def _prove_certificates(open_: Sequence[Attempts]) -> None:
    """Certify the trajectories of all attempts that need it, together."""
    waiting = _select_waiting(open_, ProofQuery)
    with _shared_step("certificate", [attempts.clock for attempts, _ in waiting]):
        found = prove_batch([query for _, query in waiting])
    for (attempts, _), certificate in zip(waiting, found, strict=True):
        attempts.accept_certificate(certificate)


def _select_waiting(open_: Sequence[Attempts], kind: type[Query]) -> list[tuple[Attempts, Query]]:
    """Return the attempts whose next need is a query of the given kind, each with that query."""
    needs: list[tuple[Attempts, Any]] = [(attempts, attempts.need) for attempts in open_]
    return [(attempts, need) for attempts, need in needs if isinstance(need, kind)]


@contextmanager
def _shared_step(name: str, clocks: Sequence[Clock]) -> Iterator[Seconds]:
    """Add the time of a `with` block to one step of several plans.

    Args:
        name: of the step.
        clocks: those of the plans; if there are none, nothing is counted.

    Yields:
        A record in which the block notes the seconds of each plan; the remaining time is shared equally.
    """
    seconds = Seconds(len(clocks))
    begin, began = time.monotonic(), working_time()
    for clock in clocks:
        clock.show(name)
    yield seconds
    if not clocks:
        return
    wall, working = time.monotonic() - begin, working_time() - began
    spent = seconds.spent + (working - seconds.spent.sum()) / len(clocks)
    for clock, own in zip(clocks, spent.tolist(), strict=True):
        clock.add(name, own + (wall - working) / len(clocks), own)
