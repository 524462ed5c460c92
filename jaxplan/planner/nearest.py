"""Plan to the nearest goal beside that of least time, where zones are in the way.

The goals of least time are told by bounds that know no zones, and a way round zones is found by luck in part:
of two goals close together either may be reached sooner. So where zones are in the way to the goal of least
time, and the bound of the time to the goal of least rotation leaves room, the shortest motion to that is
planned as well, just as if it had been asked for, and the shorter of both is the plan. So no plan of least
time is longer than that of least rotation.
"""

from dataclasses import replace

from jaxplan.model.goals import LEAST_ROTATION, LEAST_TIME, GivenState
from jaxplan.model.scenario import MINIMUM, moves
from jaxplan.model.status import Status
from jaxplan.planner.attempts import Attempts
from jaxplan.planner.record import Plan
from jaxplan.planner.shorter import SHORTER, is_bent, is_far, may_be_sooner
from jaxplan.planner.steps import find_goals


def to_the_nearest(attempts: Attempts) -> Attempts | None:
    """The attempts at the goal of least rotation; None where they would be of no use.

    Args:
        attempts: those at goals of least time, settled. Their clock goes on.
    """
    plan, clock, enough = attempts.plan, attempts.clock, attempts.enough
    if plan is None or not _may_help(plan, enough) or not clock.left():
        return None
    goal = plan.scenario.goal
    if isinstance(goal, GivenState):
        return None
    asked = replace(plan.scenario, goal=replace(goal, criterion=LEAST_ROTATION))
    with clock.step("decompose"):
        found = find_goals(asked)
    if isinstance(found, Plan) or not may_be_sooner(plan, found[0]):
        return None
    clock.improve_for = 0.0  # the first plan was improved for as long
    beside = Attempts(asked, clock, enough=enough)
    beside.accept_goals(found[:1])
    return beside


def shorter_of(plan: Plan, other: Plan | None) -> Plan:
    """The shorter one of a certified plan and of another way to plan its scenario, which may have failed."""
    if other is None or not other.ok or plan.trajectory is None or other.trajectory is None:
        return plan
    if other.trajectory.duration >= SHORTER * plan.trajectory.duration:
        return plan
    return replace(other, scenario=plan.scenario)


def _may_help(plan: Plan, enough: float) -> bool:
    """Whether a plan is certified, of least time, and zones make it longer than its bound and `enough`, s."""
    scenario, settings = plan.scenario, plan.scenario.trajectory
    asked = scenario.asked
    if isinstance(asked, GivenState) or asked.criterion != LEAST_TIME or asked.prefer or moves(scenario):
        return False
    if plan.status is not Status.OK or settings.duration != MINIMUM or not settings.first_guesses:
        return False
    return bool(scenario.zones) and is_far(plan, enough) and is_bent(plan)
