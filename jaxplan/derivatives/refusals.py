"""Which scenarios and plans have derivatives, and the reasons why others have none.

All reasons are told at once. Those that depend on the fit of a plan are found when it is held
(`jaxplan.derivatives.held`).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxplan.goal.followed_goal import least_time_doubt
from jaxplan.model.goals import LEAST_TIME, Targets
from jaxplan.model.scenario import Scenario, moves

_NEEDS_TIME = (
    "has targets or zones that move: derivatives and tuning then know given durations only: set "
    "trajectory.duration_s to a number (it has no slopes itself then), or hold what moves at an instant"
)


def expect_followable(scenario: Scenario) -> None:
    """Raise a ValueError for a scenario none of whose plans can have derivatives.

    Reasons that depend on the plan itself are found by `hold`.
    """
    asked = scenario.asked
    targets = asked if isinstance(asked, Targets) else None
    end = () if targets is not None and targets.moves else rates_at(scenario, asked)
    reasons = reasons_of_scenario(scenario, end)
    if targets is not None and targets.criterion == LEAST_TIME and (targets.moves or targets.prefer):
        reasons.append(least_time_doubt(targets))
    refuse(scenario.name, reasons)


def reasons_of_scenario(scenario: Scenario, end: Sequence[Any]) -> list[str]:
    """Return the reasons why plans of a scenario have no derivatives, as far as the scenario alone tells.

    `end` holds the angular velocity (3,) and joint rates (J,) rad/s at the goal.
    """
    if needs_time(scenario):
        return [f"its scene {_NEEDS_TIME}"]
    ends = (*rates_at(scenario, scenario.start), *end)
    if not scenario.trajectory.timed and any(np.any(rate) for rate in ends):
        return ["it is a shortest motion with rates at its ends: set trajectory.duration_s to a number"]
    return []


def refuse(name: str, reasons: Sequence[str]) -> None:
    """Raise a ValueError that lists the reasons why a plan has no derivatives, unless there are none."""
    if len(reasons) == 1:
        raise ValueError(f"the plan of {name} has no derivatives: {reasons[0]}")
    if reasons:
        numbered = "\n".join(f"  {number}. {reason}" for number, reason in enumerate(reasons, 1))
        raise ValueError(
            f"the plan of {name} has no derivatives, for {len(reasons)} reasons:\n{numbered}\n"
            "A goal that is given as a state, plan.goal.state, and a trajectory.duration_s some per cent "
            "above that of the plan do without all of them"
        )


def needs_time(scenario: Scenario) -> bool:
    """Tell whether a target or zone moves and no duration is given; the duration then depends on the goal."""
    return moves(scenario) and not scenario.trajectory.timed


def expect_known_time(scenario: Scenario) -> None:
    """Raise a ValueError where a target or zone moves and no duration is given."""
    if needs_time(scenario):
        raise ValueError(f"{scenario.name} {_NEEDS_TIME}")


def rates_at(scenario: Scenario, end: Any) -> tuple[Any, Any]:
    """Return the angular velocity (3,) and joint rates (J,) rad/s of a start or goal, with zeros for None."""
    given, counts = (end.angular_velocity, end.joint_rates), (3, scenario.spacecraft.joint_count)
    velocity, rates = (
        np.zeros(count) if own is None else own for own, count in zip(given, counts, strict=True)
    )
    return velocity, rates
