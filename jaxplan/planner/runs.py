"""The entry points `plan` and `plan_batch`: one scenario, or many at once, here or in other processes.

A scenario is checked as one from a file is, and planned with the numbers that its file would hold.
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
_LEAST_HANDED_OUT = 32  # scenarios in a part for a worker, so that it, too, plans many together
_PARTS = 3  # parts for each worker, so that all get done at about the same time


def plan(
    scenario: Scenario, *, throw: bool = True, progress: bool = True, improve_for_s: float = 0.0
) -> Plan:
    """Plan a manoeuvre and prove it safe.

    Args:
        scenario: the problem and its settings; lists may stand for arrays and tuples.
        throw: raise when there is no certified plan; otherwise return what was found, with its status.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        improve_for_s: s, for which a shorter plan is looked for than the first one, of a duration that is
            "minimum": along other ways round zones, and from more first guesses. It ends earlier once the
            bound leaves little to gain. What is found in that time depends on the machine.

    Returns:
        The plan. Of a failed one the fields before the failing step are filled; UNCERTIFIED keeps trajectory
        and report.

    Raises:
        PlanningError: with ``status``, ``plan`` and a message that says what to change, if ``throw``.
        TypeError: if it is no scenario.
        ScenarioError: for values that a scenario file may not have, methods that do not exist among them,
            and those of a wrong type or shape; a ValueError, with every fault.
        ValueError: for less than no time, or one without end, and for any but with the duration "minimum".

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
    """Plan many scenarios, their searches, fits and proofs together.

    Args:
        scenarios: the problems, each with its own settings; they need not be alike.
        workers: who plans: None for this process; a number of processes of its own; or any
            `concurrent.futures.Executor`, whose processes keep what they have compiled for the next call.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        executor: an older name of workers.

    Returns:
        The plans in the same order, failed ones with their status and message: none raises. They agree with
        those of `plan` one by one to 1e-6, with the same statuses, where the same way is taken and no time
        limit ends a search. Of the time of what was made together each plan is given its share: an equal
        one of what was done at once.

    Raises:
        TypeError: if one of them is no scenario, or workers are no executor and no number.
        ScenarioError: as of `plan`, before anything is planned, with the number of the scenario.
        ValueError: for less than one process.
        RuntimeError: if worker processes die; `run_study` outlives that.
    """
    if isinstance(scenarios, Scenario):
        raise TypeError("scenarios must be several, not a Scenario; jp.plan plans one")
    given = several("scenarios", scenarios, "scenarios")
    scenarios = [as_filed(f"scenarios[{number}]", scenario) for number, scenario in enumerate(given)]
    chosen = who_works(workers, executor)
    if chosen is not None and scenarios:
        try:
            return _by_workers(scenarios, chosen, progress)
        except WorkersDiedError as error:
            raise RuntimeError(str(error)) from None
    return _here(scenarios, progress)


def plan_with_fits(
    scenarios: Sequence[Scenario], *, progress: bool = True
) -> tuple[list[Plan], list[Fit | None]]:
    """`plan_batch` in this process, and the fit of step 3 of each plan in a given duration.

    None stands for a fit that another motion than the plan's came of, or another duration.
    """
    filed = [as_filed(f"scenarios[{number}]", scenario) for number, scenario in enumerate(scenarios)]
    made: list[tuple[FitQuery, Fit]] = []
    plans = _here(filed, progress, made)
    by_motion = {id(fit.trajectory): (query, fit) for query, fit in made}
    fits: list[Fit | None] = []
    for plan in plans:
        query, fit = by_motion.get(id(plan.trajectory), (None, None))
        own = query is not None and query.path is plan.path and query.settings is plan.scenario.trajectory
        fits.append(fit if own and plan.ok and plan.scenario.trajectory.timed else None)
    return plans, fits


def as_filed(name: str, given: object) -> Scenario:
    """A scenario that was made in Python, as a file would hold it.

    Args:
        name: of the argument, for messages.
        given: to be planned.

    Raises:
        TypeError: for what is no scenario, such as the name of a file.
        ScenarioError: for values that a file may not have, and those of a wrong type or shape; the message
            lists every fault by its attribute.
    """
    several = isinstance(given, list | tuple)
    advice = "jp.plan_batch plans several" if several else "jp.load_scenario reads one from a file"
    scenario = expect(name, given, Scenario, advice)
    try:
        return take_in(scenario)
    except ScenarioError as error:
        raise ScenarioError(error.faults, name) from error


def _here(
    scenarios: Sequence[Scenario], progress: bool, made: list[tuple[FitQuery, Fit]] | None = None
) -> list[Plan]:
    """Plan scenarios that `as_filed` returned, in this process; `made` is as of `plan_in_rounds`."""
    plans: list[Plan] = []
    with one_thread(), progress_bar("planning", "plans", total=len(scenarios), shown=progress) as bar:
        for first in range(0, len(scenarios), TOGETHER):
            part = scenarios[first : first + TOGETHER]
            plans += plan_in_rounds(part, [Clock(one.search.time_limit) for one in part], bar.update, made)
    return plans


def _by_workers(scenarios: Sequence[Scenario], workers: Workers, progress: bool) -> list[Plan]:
    """Plan scenarios that `as_filed` returned in other processes, part by part.

    Raises:
        RuntimeError: if a worker process dies.
    """
    pool = WorkerPool(workers)
    size = min(TOGETHER, max(_LEAST_HANDED_OUT, -(-len(scenarios) // (_PARTS * pool.workers))))
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
    """Plan a part of the scenarios, in a worker process."""
    return _here(scenarios, progress=False)
