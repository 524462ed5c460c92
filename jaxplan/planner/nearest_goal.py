"""Plan to the goal of least rotation beside that of least time, where zones are in the way.

Goals of least time are chosen by bounds that know no zones, and which way round zones a search finds is
partly luck: of two goals close together, either may be reached sooner. So where zones are in the way to the
goal of least time, and the bound for the goal of least rotation leaves room, the shortest motion to that goal
is planned as well, just as if it had been asked for, and the shorter of both plans is taken. So no plan of
least time is longer than that of least rotation.
"""

from dataclasses import replace

from jaxplan import so3
from jaxplan.model.goals import LEAST_ROTATION, LEAST_TIME, GivenState
from jaxplan.model.scenario import MINIMUM, moves
from jaxplan.model.status import Status
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.record import Plan
from jaxplan.planner.shorter import SHORTER, is_bent, is_far, may_be_sooner
from jaxplan.planner.steps import find_goals

_SAME_GOAL_ANGLE = 1e-6  # rad; goals whose attitudes are closer than this are the same


def to_the_nearest(attempts: Attempts) -> Attempts | None:
    """Begin attempts at the goal of least rotation; None where they would be of no use.

    Args:
        attempts: settled ones at goals of least time. The new attempts share their clock, whose `improve_for`
            is set to 0.
    """
    plan, clock, enough = attempts.plan, attempts.clock, attempts.enough
    if plan is None or not _nearest_may_help(plan, enough) or not clock.left():
        return None
    goal, own = plan.scenario.goal, plan.goal
    if isinstance(goal, GivenState) or own is None:
        return None
    asked = replace(plan.scenario, goal=replace(goal, criterion=LEAST_ROTATION))
    with clock.step("decompose"):
        found = find_goals(asked)
    if isinstance(found, Plan) or not may_be_sooner(plan, found[0]):
        return None
    if not is_far(plan, enough) and float(so3.distance(own.attitude, found[0].attitude)) < _SAME_GOAL_ANGLE:
        return None  # near the bound the same goal is reached as soon
    clock.improve_for = 0.0  # the first plan was improved for as long
    beside = Attempts(asked, clock, enough=enough)
    beside.accept_goals(found[:1])
    return beside


def shorter_of(plan: Plan, other: Plan | None) -> Plan:
    """Return the shorter of a certified plan and another plan for its scenario.

    The other one may be None or have failed, and is taken only if it is shorter than `SHORTER` times the
    first.
    """
    if other is None or not other.ok or plan.trajectory is None or other.trajectory is None:
        return plan
    if other.trajectory.duration >= SHORTER * plan.trajectory.duration:
        return plan
    return replace(other, scenario=plan.scenario)


def _nearest_may_help(plan: Plan, enough: float) -> bool:
    """Tell whether a plan is certified, of least time, longer than `enough` s, and leads round zones."""
    scenario, settings = plan.scenario, plan.scenario.trajectory
    asked = scenario.asked
    if isinstance(asked, GivenState) or asked.criterion != LEAST_TIME or asked.prefer or moves(scenario):
        return False
    if plan.status is not Status.OK or plan.trajectory is None or plan.trajectory.duration <= enough:
        return False
    looks = settings.duration == MINIMUM and settings.first_guesses > 0
    return looks and bool(scenario.zones) and is_bent(plan)
