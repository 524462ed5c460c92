"""The chain: scenario -> goal -> path -> trajectory -> certificate, with its retries.

A plan that cannot be certified is never OK. For each goal, nearest first, a ladder of attempts is climbed:
the path as found, a new path with more clearance, and both with more nodes, so that the trajectory keeps
closer to them. A search that finds no path with the wanted clearance is run again without.
The first certified plan ends it; else the answer is that of the attempt that got furthest.

The chain is a generator that asks for its searches, so that those of many scenarios can run in lockstep.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from jaxplan.path import Goal, Path, halve
from jaxplan.planner import messages
from jaxplan.planner.check import prove, start_attitude
from jaxplan.planner.clock import Clock
from jaxplan.planner.goals import find_goals
from jaxplan.planner.record import Plan
from jaxplan.planner.validity import breaches
from jaxplan.scenario import Scenario, SearchSettings
from jaxplan.search import Scene, SearchResult, derived_seed, find_barrier, make_scene
from jaxplan.status import Status
from jaxplan.trajectory import METHODS, Fit
from jaxplan.zones import tabulate

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


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """A search that a chain asks for."""

    scene: Scene
    settings: SearchSettings


Chain = Generator[Query, SearchResult, Plan]


def chain(scenario: Scenario, clock: Clock) -> Chain:
    """Plan a scenario; yields searches and is sent their answers.

    Args:
        scenario: the problem and its settings.
        clock: takes the time of the other steps, and is asked for what is left.

    Returns:
        The plan, without its timings.
    """
    start = scenario.start
    attitude = start_attitude(scenario)
    broken = breaches(scenario, attitude, start.joints, start.angular_velocity, start.joint_rates)
    if broken:
        return Plan(scenario=scenario, status=Status.INVALID_START, message=messages.invalid(broken))
    with clock.step("decompose"):
        goals = find_goals(scenario, attitude)
    if isinstance(goals, Plan):
        return goals
    best = _Best()
    for goal in goals:
        yield from _climb(scenario, attitude, goal, clock, best)
        if best.over:
            break
    assert best.plan is not None  # there is at least one goal, and at least one attempt at it
    return best.plan


class _Best:
    """The attempt that got furthest, and whether there is any use in another."""

    plan: Plan | None = None
    over = False

    def add(self, attempt: Plan) -> None:
        """Take an attempt into account."""
        if self.plan is None or _TELLING.index(attempt.status) > _TELLING.index(self.plan.status):
            self.plan = attempt
        self.over = attempt.status in (Status.OK, Status.TIME_LIMIT)


def _climb(
    scenario: Scenario, attitude: np.ndarray, goal: Goal, clock: Clock, best: _Best
) -> Generator[Query, SearchResult, None]:
    """Climb the ladder at one goal, until it is over."""
    scene = make_scene(scenario, goal, attitude)
    with clock.step("search"):
        barrier = find_barrier(scene)
    if barrier is not None:
        message = messages.parted(scenario, barrier)
        best.add(Plan(scenario=scenario, status=Status.NO_PATH, message=message, goal=goal))
        return
    # It looks for the shortest motion before it says that a duration is too short.
    at_leisure = scenario.trajectory.method == "global"
    first = LADDER[0][0]
    found = {first: (yield Query(scene, _settings(scenario, first, 0, clock)))}
    for factor, halvings in LADDER if found[first].path is not None else BARE_LADDER:
        if factor not in found:
            found[factor] = yield Query(scene, _settings(scenario, factor, len(found), clock))
        result = found[factor]
        so_far = Plan(scenario=scenario, status=result.status, goal=goal, search=result)
        if result.path is None:
            best.add(replace(so_far, message=messages.no_path(scenario, scene, result)))
            return
        path = result.path
        for _ in range(halvings):
            path = halve(path)
        attempt = finish(replace(so_far, path=path), path, clock)
        best.add(attempt)
        if best.over or (attempt.status is Status.LIMITS_TOO_TIGHT and at_leisure):
            return


def _settings(scenario: Scenario, factor: float, earlier: int, clock: Clock) -> SearchSettings:
    """Of a search with a factor on the clearance, after `earlier` others."""
    seed = scenario.search.seed
    return replace(
        scenario.search,
        clearance=factor * scenario.search.clearance,
        seed=derived_seed(seed, earlier) if earlier else seed,
        time_limit=clock.left(),
    )


def fit(scenario: Scenario, path: Path) -> Fit:
    """Step 3 of a scenario through a path, by the method it asks for."""
    start, end = scenario.start, scenario.goal
    return METHODS[scenario.trajectory.method](
        path,
        scenario.spacecraft,
        scenario.trajectory,
        cones=tabulate(scenario.keep_out, scenario.keep_in, scenario.spacecraft.device_names),
        start_angular_velocity=start.angular_velocity,
        start_joint_rates=start.joint_rates,
        end_angular_velocity=end.angular_velocity,
        end_joint_rates=end.joint_rates,
    )


def finish(so_far: Plan, path: Path, clock: Clock) -> Plan:
    """Fit and certify a trajectory through a path."""
    scenario, goal = so_far.scenario, so_far.goal
    assert goal is not None
    with clock.step("trajectory"):
        fitted = fit(scenario, path)
    message = fitted.note if fitted.status is Status.OK else fitted.message
    so_far = replace(so_far, status=fitted.status, message=message, trajectory=fitted.trajectory)
    if fitted.trajectory is None:
        return so_far
    with clock.step("certificate"):
        report = prove(scenario, goal, fitted.trajectory)
    so_far = replace(so_far, report=report)
    if fitted.status in (Status.OK, Status.UNCERTIFIED) and not report.certified:
        return replace(so_far, status=Status.UNCERTIFIED, message=messages.uncertified(report))
    return so_far
