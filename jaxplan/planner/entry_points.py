"""The entry points `plan` and `plan_batch`: plan one scenario, or many, here or in other processes.

A scenario made in Python is checked as one from a file is, and planned with the numbers its file would hold.
"""

from collections.abc import Iterable, Sequence
from concurrent.futures import BrokenExecutor, Future

import numpy as np

from jaxplan.model.scenario import Scenario
from jaxplan.planner.clock import Clock, expect_shortest
from jaxplan.planner.record import Plan, PlanningError
from jaxplan.planner.rounds import plan_in_rounds
from jaxplan.runtime.arguments import expect, number, several
from jaxplan.runtime.progress import progress_bar
from jaxplan.runtime.workers import WorkerPool, Workers, WorkersDiedError, one_thread, who_works
from jaxplan.schema import ScenarioError
from jaxplan.schema.reading import take_in
from jaxplan.trajectory import Fit, FitQuery

TOGETHER = 256
"""Scenarios that are planned at once, so that progress is seen and memory stays small."""
_MIN_PART_SIZE = 32  # least scenarios in a part for a worker, so that it, too, plans many together
_PARTS_PER_WORKER = 3  # parts for each worker, so that all of them end at about the same time


def plan(
    scenario: Scenario, *, throw: bool = True, progress: bool = True, improve_for_s: float = 0.0
) -> Plan:
    """Plan a manoeuvre and prove it safe.

    Args:
        scenario: the problem and its settings; lists may stand for arrays and tuples.
        throw: raise PlanningError when there is no certified plan; if False, return what was found.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        improve_for_s: how long, s, to look for a plan shorter than the first one, where the duration is
            "minimum": along other ways round zones, and from more first guesses. It ends earlier once the
            lower bound of the duration leaves little to gain. The result depends on the machine's speed.

    Returns:
        The plan. In a failed one the fields before the failing step are filled; one that is UNCERTIFIED has a
        trajectory and a certificate.

    Raises:
        PlanningError: if `throw` and there is no certified plan; it has the plan, its status and a message
            that says what to change.
        TypeError: if `scenario` is not a Scenario.
        ScenarioError: for values that a scenario file may not have, such as unknown methods, and for wrong
            types or shapes; a ValueError that lists every fault.
        ValueError: if `improve_for_s` is negative or infinite, or not 0 and the duration not "minimum".

    Example:
        >>> import jaxplan as jp
        >>> plan = jp.plan(jp.paper_case(2))
        >>> plan.trajectory.sample(10.0).attitude.shape
        (3, 3)
    """
    scenario = as_filed("scenario", scenario)
    improve_for = number("improve_for_s", improve_for_s, "a number of seconds")
    if not 0 <= improve_for < np.inf:
        raise ValueError(f"improve_for_s = {improve_for:g}: must lie in [0, inf)")
    expect_shortest(f"improve_for_s = {improve_for:g}", improve_for, scenario, scenario.name)
    with one_thread(), progress_bar("planning", shown=progress) as bar:
        if scenario.zones:
            bar.compiles_for(f"{len(scenario.constraints.zone)} zones")
        clock = Clock(scenario.search.time_limit, bar.step, improve_for=improve_for)
        (result,) = plan_in_rounds([scenario], [clock])
    if throw and not result.ok:
        raise PlanningError(result)
    return result


def plan_batch(
    scenarios: Iterable[Scenario],
    *,
    workers: Workers | None = None,
    progress: bool = True,
    executor: Workers | None = None,
) -> list[Plan]:
    """Plan many scenarios, with their searches, fits and proofs done together.

    Args:
        scenarios: the problems, each with its own settings; they need not be alike.
        workers: who plans: None for this process; a number of worker processes to start; or any
            `concurrent.futures.Executor`, whose processes keep what they have compiled for the next call.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        executor: an older name of `workers`.

    Returns:
        The plans in the same order. None raises: failed plans have their status and message. Each agrees with
        that of `plan` to 1e-6, and in status, unless rounding leads it another way or a time limit ends a
        search. The computation time of what was done for several plans at once is shared equally among them.

    Raises:
        TypeError: if one of them is not a Scenario, or `workers` is neither an executor nor a number.
        ScenarioError: as for `plan`, before anything is planned, with the scenario's index.
        ValueError: if `workers` is less than 1.
        RuntimeError: if worker processes die; `run_study` continues in that case.
    """
    if isinstance(scenarios, Scenario):
        raise TypeError("scenarios must be several, not a Scenario; jp.plan plans one")
    given = several("scenarios", scenarios, "scenarios")
    scenarios = [as_filed(f"scenarios[{number}]", scenario) for number, scenario in enumerate(given)]
    chosen = who_works(workers, executor)
    if chosen is not None and scenarios:
        try:
            return _plan_by_workers(scenarios, chosen, progress)
        except WorkersDiedError as error:
            raise RuntimeError(str(error)) from None
    return _plan_in_process(scenarios, progress)


def plan_with_fits(
    scenarios: Sequence[Scenario], *, progress: bool = True
) -> tuple[list[Plan], list[Fit | None]]:
    """Plan like `plan_batch` in this process, and return the fit behind each plan as well.

    Returns:
        The plans, and for each plan its fit of step 3. The latter is None unless the plan is certified, in a
        given duration, and its trajectory is that very fit along its path with the scenario's own settings.
    """
    filed = [as_filed(f"scenarios[{number}]", scenario) for number, scenario in enumerate(scenarios)]
    made: list[tuple[FitQuery, Fit]] = []
    plans = _plan_in_process(filed, progress, made)
    by_motion = {id(fit.trajectory): (query, fit) for query, fit in made}
    fits: list[Fit | None] = []
    for plan in plans:
        query, fit = by_motion.get(id(plan.trajectory), (None, None))
        own = query is not None and query.path is plan.path and query.settings is plan.scenario.trajectory
        fits.append(fit if own and plan.ok and plan.scenario.trajectory.timed else None)
    return plans, fits


def as_filed(name: str, given: object) -> Scenario:
    """Check a scenario that was made in Python, and return it with the values that its file would hold.

    Args:
        name: of the argument, for messages.
        given: what was passed as the scenario.

    Raises:
        TypeError: if it is not a Scenario but, say, the name of a file.
        ScenarioError: for values that a file may not have, and for wrong types or shapes; the message lists
            every fault by its attribute.
    """
    several = isinstance(given, list | tuple)
    advice = "jp.plan_batch plans several" if several else "jp.load_scenario reads one from a file"
    scenario = expect(name, given, Scenario, advice)
    try:
        return take_in(scenario)
    except ScenarioError as error:
        raise ScenarioError(error.faults, name) from error


def _plan_in_process(
    scenarios: Sequence[Scenario], progress: bool, made: list[tuple[FitQuery, Fit]] | None = None
) -> list[Plan]:
    """Plan checked scenarios in this process, `TOGETHER` at a time; `made` is as of `plan_in_rounds`."""
    plans: list[Plan] = []
    with one_thread(), progress_bar("planning", "plans", total=len(scenarios), shown=progress) as bar:
        for first in range(0, len(scenarios), TOGETHER):
            part = scenarios[first : first + TOGETHER]
            plans += plan_in_rounds(part, [Clock(one.search.time_limit) for one in part], bar.update, made)
    return plans


def _plan_by_workers(scenarios: Sequence[Scenario], workers: Workers, progress: bool) -> list[Plan]:
    """Plan checked scenarios in worker processes, part by part.

    Raises:
        RuntimeError: if a worker process dies.
    """
    pool = WorkerPool(workers)
    size = min(TOGETHER, max(_MIN_PART_SIZE, -(-len(scenarios) // (_PARTS_PER_WORKER * pool.workers))))
    parts = [scenarios[first : first + size] for first in range(0, len(scenarios), size)]
    plans: list[Plan] = []
    futures: list[Future[list[Plan]]] = []
    try:
        with progress_bar("planning", "plans", total=len(scenarios), shown=progress) as bar:
            bar.step("workers begin, and may compile")
            for part in parts:
                futures.append(pool.submit(_plan_part, part))
            for future in futures:
                plans += future.result()
                bar.step("")
                bar.update(len(plans) - bar.done)
    except BrokenExecutor as error:
        pool.shutdown(at_once=True)
        raise RuntimeError("a worker process died while it planned; jp.run_study outlives that") from error
    except BaseException:  # Ctrl-C among others
        for future in futures:  # somebody's executor goes on, but not with these
            future.cancel()
        pool.shutdown(at_once=True)
        raise
    pool.shutdown(at_once=False)
    return plans


def _plan_part(scenarios: Sequence[Scenario]) -> list[Plan]:
    """Plan a part of the scenarios, as a task of a worker process."""
    return _plan_in_process(scenarios, progress=False)
