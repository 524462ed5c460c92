"""The chain: scenario -> goal -> path -> trajectory -> certificate, with its retries.

A plan that cannot be certified is never OK. For each goal, nearest first, a ladder of attempts is climbed:
the path as found, a new path with more clearance, and both with more nodes, so that the trajectory keeps
closer to them. A search that finds no path with the wanted clearance is run again without.
The first certified plan ends it; else the answer is that of the attempt that got furthest.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from jaxplan.path import Goal, Path, halve
from jaxplan.planner import messages
from jaxplan.planner.check import prove, start_attitude
from jaxplan.planner.goals import find_goals
from jaxplan.planner.record import Plan, PlanningError
from jaxplan.planner.validity import breaches
from jaxplan.scenario import Scenario
from jaxplan.search import PLANNERS, SearchResult, derived_seed, find_barrier, make_scene
from jaxplan.status import Status
from jaxplan.trajectory import METHODS

# The ladder of attempts at one goal: factor on the clearance, and how often each edge is halved.
LADDER = ((1.0, 0), (3.0, 0), (1.0, 1), (3.0, 1), (6.0, 1))
# Where no path is found with the wanted clearance.
BARE_LADDER = ((0.0, 0), (0.0, 1))

# Of two failures the later one here says more about what to change.
_TELLING = (
    Status.NO_PATH,  # to one goal
    Status.TIME_LIMIT,
    Status.NODE_LIMIT,
    Status.INFEASIBLE,
    Status.UNCERTIFIED,
    Status.LIMITS_TOO_TIGHT,
    Status.OK,
)


def plan(scenario: Scenario, *, throw: bool = True, progress: bool = True) -> Plan:
    """Plan a manoeuvre and prove it safe.

    Args:
        scenario: the problem and its settings.
        throw: raise when there is no certified plan; otherwise return what was found, with its status.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Returns:
        The plan. Of a failed one the fields before the failing step are filled; UNCERTIFIED keeps trajectory
        and report.

    Raises:
        PlanningError: with ``status``, ``plan`` and a message that says what to change, if ``throw``.
        TypeError: if it is no scenario.

    Example:
        >>> import jaxplan as jp
        >>> plan = jp.plan(jp.paper_case(2))
        >>> plan.trajectory.sample(10.0).attitude.shape
        (3, 3)
    """
    _expect_scenario(scenario)
    clock = _Clock(scenario.search.time_limit, progress)
    with clock.bar():
        result = _plan(scenario, clock)
    result = replace(result, timings={**clock.seconds, "total": clock.elapsed()})
    if throw and not result.ok:
        raise PlanningError(result)
    return result


def _expect_scenario(given: object) -> None:
    """Raise for what is none, such as the name of a file."""
    if not isinstance(given, Scenario):
        kind = type(given).__name__
        raise TypeError(f"scenario must be a Scenario, not {kind}; jp.load_scenario reads one from a file")


def _plan(scenario: Scenario, clock: "_Clock") -> Plan:
    start = scenario.start
    attitude = start_attitude(scenario)
    broken = breaches(scenario, attitude, start.joints, start.angular_velocity, start.joint_rates)
    if broken:
        return Plan(scenario=scenario, status=Status.INVALID_START, message=messages.invalid(broken))
    with clock.step("decompose"):
        goals = find_goals(scenario, attitude)
    if isinstance(goals, Plan):
        return goals
    best: Plan | None = None
    for goal in goals:
        for candidate in _attempts(scenario, attitude, goal, clock):
            if best is None or _TELLING.index(candidate.status) > _TELLING.index(best.status):
                best = candidate
            if candidate.status in (Status.OK, Status.TIME_LIMIT):
                return best
    assert best is not None  # there is at least one goal, and at least one attempt at it
    return best


def _attempts(scenario: Scenario, attitude: np.ndarray, goal: Goal, clock: "_Clock") -> Iterator[Plan]:
    """Climb the ladder at one goal."""
    scene = make_scene(scenario, goal, attitude)
    with clock.step("search"):
        barrier = find_barrier(scene)
    if barrier is not None:
        message = messages.parted(scenario, barrier)
        yield Plan(scenario=scenario, status=Status.NO_PATH, message=message, goal=goal)
        return
    found: dict[float, SearchResult] = {}

    def search(factor: float) -> SearchResult:
        if factor not in found:
            settings = replace(
                scenario.search,
                clearance=factor * scenario.search.clearance,
                seed=derived_seed(scenario.search.seed, len(found)) if found else scenario.search.seed,
                time_limit=clock.left(),
            )
            with clock.step("search"):
                found[factor] = PLANNERS[settings.method](scene, settings)
        return found[factor]

    ladder = LADDER if search(LADDER[0][0]).path is not None else BARE_LADDER
    for factor, halvings in ladder:
        result = search(factor)
        failed = Plan(scenario=scenario, status=result.status, goal=goal, search=result)
        if result.path is None:
            yield replace(failed, message=messages.no_path(scenario, scene, result))
            return
        path = result.path
        for _ in range(halvings):
            path = halve(path)
        yield _finish(replace(failed, path=path), path, clock)


def _finish(so_far: Plan, path: Path, clock: "_Clock") -> Plan:
    """Fit and certify a trajectory through a path."""
    scenario, goal = so_far.scenario, so_far.goal
    assert goal is not None
    start, end = scenario.start, scenario.goal
    with clock.step("trajectory"):
        fitted = METHODS[scenario.trajectory.method](
            path,
            scenario.spacecraft,
            scenario.trajectory,
            start_angular_velocity=start.angular_velocity,
            start_joint_rates=start.joint_rates,
            end_angular_velocity=end.angular_velocity,
            end_joint_rates=end.joint_rates,
        )
    message = "" if fitted.status is Status.OK else fitted.message
    so_far = replace(so_far, status=fitted.status, message=message, trajectory=fitted.trajectory)
    if fitted.trajectory is None:
        return so_far
    with clock.step("certificate"):
        report = prove(scenario, goal, fitted.trajectory)
    so_far = replace(so_far, report=report)
    if fitted.status is Status.OK and not report.certified:
        return replace(so_far, status=Status.UNCERTIFIED, message=messages.uncertified(report))
    return so_far


class _Clock:
    """Seconds by step, what is left of the time limit, and the bar that shows the step under way."""

    def __init__(self, time_limit: float, progress: bool) -> None:
        self.start = time.monotonic()
        self.time_limit, self.progress = time_limit, progress
        self.seconds: dict[str, float] = {}

    def elapsed(self) -> float:
        return time.monotonic() - self.start

    def left(self) -> float:
        return max(self.time_limit - self.elapsed(), 0.0)

    @contextmanager
    def bar(self) -> Iterator[None]:
        """A bar of the steps done, shown after a second where somebody can see it."""
        from tqdm.auto import tqdm

        hidden = not self.progress or None  # None: where stderr is no terminal
        with tqdm(desc="planning", unit=" steps", delay=1, leave=False, disable=hidden) as self._bar:
            yield

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Add the time of a block to a step."""
        begin = time.monotonic()
        self._bar.set_description(f"planning: {name}")
        yield
        self._bar.update()
        self.seconds[name] = self.seconds.get(name, 0.0) + time.monotonic() - begin
