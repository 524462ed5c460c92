"""The chain: scenario -> goal -> path -> trajectory -> certificate, with its retries.

A plan that cannot be certified is never OK. For each goal, nearest first, a ladder of attempts is climbed:
the path as found, a new path with more clearance, and both with more nodes, so that the trajectory keeps
closer to them. A search that finds no path with the wanted clearance is run again without.
The first certified plan ends it; else the answer is that of the attempt that got furthest.

Where targets or zones move, a goal is one at the end of the manoeuvre (`meeting`), the search sees what zones
sweep (`sweeps`), and fit and certificate see them move.

The chain is a generator that asks for its searches, fits and proofs, so that those of many scenarios are made
together. Where targets or zones move, fits and goals follow each other, and a chain fits by itself.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from jaxplan.certificate import Report
from jaxplan.model.moments import moves
from jaxplan.model.path import Goal, Path, halve
from jaxplan.model.scenario import Scenario, SearchSettings
from jaxplan.model.status import Status
from jaxplan.planner import messages
from jaxplan.planner.check import ProofQuery, start_breaches
from jaxplan.planner.clock import Clock
from jaxplan.planner.goals import find_goals
from jaxplan.planner.meeting import guesses, meet
from jaxplan.planner.record import Plan, end_rates
from jaxplan.planner.sweeps import always, swept
from jaxplan.search import Scene, derived_seed, find_barrier, make_scene
from jaxplan.trajectory import Fit, FitQuery, fit_batch

# The ladder of attempts at one goal: factor on the clearance, and how often each edge is halved.
LADDER = ((1.0, 0), (3.0, 0), (1.0, 1), (3.0, 1), (6.0, 1))
# Where no path is found with the wanted clearance, and time is left.
BARE_LADDER = ((0.0, 0), (0.0, 1))

# Of two failures the later one here says more about what to change.
_TELLING = (
    Status.NO_PATH,  # to one goal
    Status.TIME_LIMIT,
    Status.NODE_LIMIT,
    Status.INFEASIBLE,
    Status.UNCERTIFIED,
    Status.GOAL_MISSED,
    Status.LIMITS_TOO_TIGHT,
    Status.OK,
)
# Another path to the same goal is not tried then.
_FOR_GOOD = (Status.LIMITS_TOO_TIGHT, Status.GOAL_MISSED)


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """A search that a chain asks for."""

    scene: Scene
    settings: SearchSettings


T = TypeVar("T")
Question = Query | FitQuery | ProofQuery
Asking = Generator[Question, Any, T]
Chain = Asking[Plan]


def chain(scenario: Scenario, clock: Clock) -> Chain:
    """Plan a scenario; yields searches, fits and proofs, and is sent their answers.

    Args:
        scenario: the problem and its settings.
        clock: takes the time of the other steps, and is asked for what is left.

    Returns:
        The plan, without its timings.
    """
    broken = start_breaches(scenario)
    if broken:
        return Plan(scenario=scenario, status=Status.INVALID_START, message=messages.invalid(broken))
    failed = None
    with clock.step("decompose"):
        times = guesses(scenario)
    for time in times:
        with clock.step("decompose"):
            goals = find_goals(scenario, time)
        if not isinstance(goals, Plan):
            break
        failed = failed or goals
    else:
        assert failed is not None  # there is at least one guess
        return failed
    best, nearest = _Best(), None
    for goal in goals:
        # Where there is none beside all that moving zones sweep, there may be one past them in time.
        for share in (1.0, 0.0) if moves(scenario) else (1.0,):
            yield from _climb(scenario, goal, clock, best, share)
            if best.over:
                break
        if best.over:
            break
        nearest = nearest or best.plan
    assert best.plan is not None  # there is at least one goal, and at least one attempt at it
    if best.plan.ok and nearest is not None:
        message = messages.farther(nearest, best.plan)
        return replace(best.plan, message=message)
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


def _climb(scenario: Scenario, goal: Goal, clock: Clock, best: _Best, share: float) -> Asking[None]:
    """Climb the ladder at one goal, until it is over.

    Args:
        scenario: the problem.
        goal: one of the problem's.
        clock: of the plan.
        best: that attempts are added to.
        share: of `swept`.
    """
    seen, proved = swept(scenario, goal, share), always(scenario, goal)
    scene = make_scene(scenario, goal, seen)
    with clock.step("search"):
        forbidden = scene if proved is seen else make_scene(scenario, goal, proved)
        barrier = find_barrier(forbidden)
    if barrier is not None:
        message = messages.parted(scenario, forbidden, barrier)
        best.add(Plan(scenario=scenario, status=Status.NO_PATH, message=message, goal=goal))
        return
    # It looks for the shortest motion before it says that a duration is too short.
    at_leisure = scenario.trajectory.method == "global"
    first = LADDER[0][0]
    found = {first: (yield Query(scene, _settings(scenario, first, 0, clock)))}
    bare = found[first].path is None and found[first].status is not Status.TIME_LIMIT
    for factor, halvings in BARE_LADDER if bare else LADDER:
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
        attempt = yield from finish(replace(so_far, path=path), path, clock)
        best.add(attempt)
        if best.over or (attempt.status in _FOR_GOOD and at_leisure):
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


def wanted_fit(scenario: Scenario, path: Path, goal: Goal) -> FitQuery:
    """Step 3 of a scenario through a path to a goal, by the method it asks for."""
    start, end = scenario.start, end_rates(scenario, goal)
    return FitQuery(
        path=path,
        spacecraft=scenario.spacecraft,
        settings=scenario.trajectory,
        cones=scenario.constraints,
        start_angular_velocity=start.angular_velocity,
        start_joint_rates=start.joint_rates,
        end_angular_velocity=end[0],
        end_joint_rates=end[1],
        horizon=goal.time,
    )


def fit(scenario: Scenario, path: Path, goal: Goal) -> Fit:
    """The same, fitted by itself."""
    return fit_batch([wanted_fit(scenario, path, goal)])[0]


def finish(so_far: Plan, path: Path, clock: Clock) -> Asking[Plan]:
    """Fit and certify a trajectory through a path."""
    scenario, goal = so_far.scenario, so_far.goal
    assert goal is not None
    if moves(scenario):
        with clock.step("trajectory"):
            meeting = meet(scenario, goal, path, fit)
            fitted, goal = meeting.fit, meeting.goal
            so_far = replace(so_far, goal=goal, path=meeting.path)
    else:
        fitted = yield wanted_fit(scenario, path, goal)
    so_far = fitted_plan(so_far, fitted)
    if so_far.trajectory is None:
        return so_far
    return judged(so_far, (yield ProofQuery(scenario=scenario, goal=goal, trajectory=so_far.trajectory)))


def fitted_plan(so_far: Plan, fitted: Fit) -> Plan:
    """The plan with what step 3 found, if anything, not yet certified."""
    message = fitted.note if fitted.status is Status.OK else fitted.message
    return replace(so_far, status=fitted.status, message=message, trajectory=fitted.trajectory)


def judged(so_far: Plan, report: Report) -> Plan:
    """The plan with a report on its trajectory, certified or not."""
    so_far = replace(so_far, report=report)
    if so_far.status in (Status.OK, Status.UNCERTIFIED) and not report.certified:
        return replace(so_far, status=Status.UNCERTIFIED, message=messages.uncertified(report))
    return so_far
