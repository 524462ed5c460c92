"""Slews between the motions of activities: they end in the state, rates and accelerations of what follows.

A slew is planned from one state to another at given times, as any manoeuvre. Its duration is the time that
there is, or the shortest, which is looked for from the strict lower bound on: first in a time a little above
that, then by the shortest motion itself. The state in which it ends depends on when that is, so that each
duration has a goal of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate
from jaxplan.model.duration_bound import duration_bound
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.planner.clock import Clock
from jaxplan.planner.record import Plan
from jaxplan.planner.rounds import plan_in_rounds
from jaxplan.timeline import curves, proving
from jaxplan.timeline.later import at_time
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import Trajectory

_ABOVE = (1.03, 1.08)  # times the bound: durations that are tried before the shortest motion is looked for
_CLOSE = 1.004  # times the bound, below which a duration is not worth a try
_SLACK = 1.01  # times the shortest time to a goal, that is given to reach the goal at another time
_LONGER = 1.06  # from one try to the next, where neither fits
_TRIES = 5
_FIRST = 10.0  # s, for which the first goal is found
_LEAST = 0.5  # s, of any slew


@dataclass(frozen=True, kw_only=True, eq=False)
class Slew:
    """A slew, or why there is none.

    Attributes:
        status: how it ended.
        message: what is in the way, and what to change.
        trajectory: from its start on, which is its zero; None where it failed.
        duration: s, planned or asked for; of a failed one what is needed at least, as far as it is known.
        goal: what follows, by the function that says it.
        proof: the certificate of the trajectory.
    """

    status: Status
    message: str
    trajectory: Trajectory | None
    duration: float
    goal: Any = None
    proof: Certificate | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Departure:
    """Where slews start.

    Attributes:
        scene: zones and settings, in the timeline's times.
        craft: the spacecraft with what its wheels hold then.
        state: at the start.
        time: s, in the timeline's times.
    """

    scene: Scenario
    craft: Spacecraft
    state: State
    time: float

    def in_time(self, goal: State, duration: float) -> Slew:
        """The slew to a state in a given duration, s."""
        plan = self._plan(goal, float(duration))
        if plan.trajectory is None or not plan.ok:
            return Slew(status=plan.status, message=plan.message, trajectory=None, duration=duration)
        ends = (self.state.acceleration, self.state.bends), (goal.acceleration, goal.bends)
        made = curves.bent(plan.trajectory, ends)
        proof = proving.certify_part(self.scene, self.time, made, self.craft)
        if not proof.certified:
            text = "; ".join(proof.faults)
            return Slew(status=Status.UNCERTIFIED, message=text, trajectory=None, duration=duration)
        return Slew(status=Status.OK, message="", trajectory=made, duration=made.duration, proof=proof)

    def shortest(
        self, goal_at: Callable[[float], tuple[State, Any]], seen_from: Callable[[float], float]
    ) -> Slew:
        """The slew of the shortest time to a goal that depends on when it is reached.

        Args:
            goal_at: function from a time, s, in the timeline's times, to the state then and whatever the
                caller wants to have of it.
            seen_from: function from such a time to the first one at or after it at which there is a goal.
        """

        def admitted(duration: float) -> float:
            return seen_from(self.time + max(duration, _LEAST)) - self.time

        duration = admitted(_FIRST)
        state, found = goal_at(self.time + duration)
        duration = admitted(_ABOVE[0] * self.bound(state))
        factors = list(_ABOVE[1:])
        failed: Slew | None = None
        for _ in range(_TRIES):
            state, found = goal_at(self.time + duration)
            bound = self.bound(state)
            if duration < _CLOSE * bound:
                duration = admitted(_ABOVE[0] * bound)
                state, found = goal_at(self.time + duration)
            slew = self.in_time(state, duration)
            if slew.trajectory is not None:
                return replace(slew, goal=found)
            failed = failed or slew
            if slew.status not in _PERHAPS_TOO_SHORT:
                return slew
            if factors:
                duration = admitted(max(factors.pop(0) * bound, duration + _LEAST))
                continue
            quickest = self._plan(state, MINIMUM)
            if quickest.trajectory is None or not quickest.ok:
                return Slew(
                    status=quickest.status, message=quickest.message, trajectory=None, duration=duration
                )
            needed = _SLACK * quickest.trajectory.duration
            duration = admitted(needed if needed > duration else _LONGER * duration)
        assert failed is not None
        return failed

    def bound(self, goal: State) -> float:
        """Strict lower bound, s, of the duration of slews to a state; it knows no zones."""
        pairs = [(getattr(self.state, name), getattr(goal, name)) for name in _BOUND]
        return duration_bound(self.craft, *(np.stack(pair) for pair in pairs)).seconds

    def _plan(self, goal: State, duration: Any) -> Plan:
        """The plan of a slew to a state in a duration."""
        scene = at_time(self.scene, self.time, None if isinstance(duration, str) else duration)
        scenario = replace(
            scene,
            name=f"slew at {self.time:.2f} s",
            spacecraft=self.craft,
            start=_given(self.state),
            goal=_given(goal),
            trajectory=replace(
                scene.trajectory,
                duration=duration,
                method="global",
                end_acceleration="zero",
                node_tube=np.inf if scene.trajectory.node_tube is None else scene.trajectory.node_tube,
                first_guesses=0,
            ),
        )
        return plan_in_rounds([scenario], [Clock(scenario.search.time_limit)])[0]


_PERHAPS_TOO_SHORT = (Status.LIMITS_TOO_TIGHT, Status.UNCERTIFIED)
_BOUND = ("attitude", "joints", "velocity", "rates")


def _given(state: State) -> GivenState:
    """A state as scenarios have it."""
    return GivenState(
        rotation_vector=np.asarray(so3.log(state.attitude)),
        joints=state.joints,
        angular_velocity=state.velocity,
        joint_rates=state.rates,
    )
