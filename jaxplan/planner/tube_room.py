"""Advice on plans that fail with a tube about them: how much smaller its errors would have to be.

The tube is the set of attitudes and joint angles within the errors of `Scenario.robust`, for all of which
zones and ranges must hold. It shrinks the room in every zone and range, and one that is too wide may show
elsewhere: in rates at a goal that must stay between moving zones, or in loads of a motion without room to
swing. If no goal is found with the whole tube, the largest fraction of its errors with a goal is sought; in
any case the room that the tube leaves at start and goal is told, where it is small.
"""

from dataclasses import replace

import numpy as np

from jaxplan.model.constraints import Constraints, constraint_margins, state_margins
from jaxplan.model.robust import Robust
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.planner.record import Plan
from jaxplan.planner.steps import find_goals
from jaxplan.planner.validity import contradictions

_NO_GOAL_STATUSES = (Status.INVALID_GOAL, Status.GOAL_UNREACHABLE)
_BISECTIONS = 5  # bisections for the fraction of the errors with which there is a goal
_END_VERBS = {"start": "begin", "goal": "end"}
_NARROW_ROOM = np.deg2rad(1.0)  # rad; a tube that leaves less room at start or goal may be what is in the way


def with_advice(plan: Plan) -> Plan:
    """Return a plan with advice on its tube in the message, if it failed and a smaller tube may help."""
    robust = plan.scenario.robust
    if plan.ok or robust is None or not max(robust.attitude_error, robust.joint_error) > 0:
        return plan
    words = [plan.message]
    if plan.status in _NO_GOAL_STATUSES:
        words.append(_goal_advice(plan, robust))
        if not words[-1]:  # there is none without a tube either
            return plan
    words.append(_end_room_advice(plan, robust))
    return replace(plan, message="; ".join(filter(None, words)))


def _goal_advice(plan: Plan, robust: Robust) -> str:
    """Return text for a message: the largest errors of `robust` with which the plan has a goal.

    It is empty where there is no goal without errors either.
    """
    scenario = plan.scenario
    if contradictions(scenario):
        return ""
    given = scenario.trajectory.duration
    time = float(given) if not isinstance(given, str) else 0.0 if plan.goal is None else plan.goal.time

    def share(part: float) -> Robust:
        errors = {name: part * getattr(robust, name) for name in ("attitude_error", "joint_error")}
        return replace(robust, **errors)

    def reached(part: float) -> bool:
        return not isinstance(find_goals(replace(scenario, robust=share(part)), time), Plan)

    if not reached(0.0):
        return ""
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if reached(middle) else (low, middle)
    if low == 0.0:
        return f"without {robust.words} there is a goal, and with small errors none was found"
    borne = share(low)
    each = {"attitude_error_deg": borne.attitude_error, "joint_error_deg": borne.joint_error}
    told = " and ".join(
        f"{name} = {_round_down_text(np.rad2deg(error))}" for name, error in each.items() if error
    )
    return f"{robust.words} is too wide for a goal: there is one with {told}"


def _end_room_advice(plan: Plan, robust: Robust) -> str:
    """Return text on the least room that the tube leaves at start and goal; empty where there is enough."""
    scenario, goal = plan.scenario, plan.goal
    ends = [("start", np.asarray(scenario.start.attitude), np.asarray(scenario.start.joints), 0.0)]
    if goal is not None:
        ends.append(("goal", goal.attitude, goal.joints, goal.time))
    found = [
        (*_least_zone_margin(scenario, scenario.constraints.at(time), attitude, joints), end)
        for end, attitude, joints, time in ends
    ]
    left, sight, zone, end = min(found, key=lambda one: one[0])
    if not left < _NARROW_ROOM:
        return ""
    room = f"{max(np.rad2deg(left), 0.0):.2f} deg of room to zone {zone} at the {end}"
    return f"{robust.words} leaves {sight} {room}: lower its errors, or {_END_VERBS[end]} farther from that"


def _least_zone_margin(
    scenario: Scenario, rows: Constraints, attitude: np.ndarray, joints: np.ndarray
) -> tuple[float, str, str]:
    """Return the least margin of a state to any zone, rad, and the names of the sight and the zone.

    `rows` are the constraints at the time of the state, `attitude` (3, 3) is body to inertial, `joints` (2n +
    d,) in rad. Without zones the margin is infinite and the names are empty.
    """
    count = int(np.sum(np.asarray(rows.zone) >= 0))
    if not count:
        return np.inf, "", ""
    craft = scenario.usable
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
    table = np.asarray(state_margins(rows, sights, attitude, joints))
    least = float(np.min(np.asarray(constraint_margins(rows, table))))
    row, sight = np.unravel_index(int(np.argmin(np.abs(table[:count] - least))), table[:count].shape)
    return least, scenario.sight_names[sight], scenario.zones[rows.zone[row]].name


def _round_down_text(value: float) -> str:
    """Return text of a positive number, rounded down to two significant digits."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{np.floor(value / unit + 1e-9) * unit:.10g}"
