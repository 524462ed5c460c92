"""Slews between the motions of activities: they end in the state, rates and accelerations of what follows.

A slew leads from one state to another at given times. It is fitted along the straight path first, and where
that cannot be proved it is planned with a search, as any manoeuvre. Its duration is the time that there is,
or the shortest, which is looked for from the strict lower bound on: first in a time a little above that, then
in what the fit says is needed. The state in which it ends depends on when that is, so that each duration has
a goal of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.certificate import Certificate
from jaxplan.model.duration_bound import duration_bound
from jaxplan.model.goals import GivenState
from jaxplan.model.later import later
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.planner.clock import Clock
from jaxplan.planner.rounds import plan_in_rounds
from jaxplan.planner.steps import fit
from jaxplan.timeline import curves, proving
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import Trajectory

_ABOVE = 1.03  # times the bound: the first duration that is tried
_ROOM = 0.3  # s above the bound that it is at least, since accelerations begin and end at rest
_CLOSE = 1.004  # times the bound, below which a duration is not worth a try
_SLACK = 1.003  # times what is needed to a goal, that is given to reach the goal of another time
_GROWTH = (1.02, 1.04, 1.08, 1.15, 1.3, 1.6)  # times: how much longer at least the next try is
_STEP = 0.05  # s: likewise
_FIRST = 10.0  # s, for which the first goal is found
_LEAST = 0.5  # s, of any slew


@dataclass(frozen=True, kw_only=True, eq=False)
class Slew:
    """A slew, or why there is none.

    Attributes:
        status: how it ended.
        message: what is in the way, and what to change.
        duration: s, planned or asked for.
        needed: s, that are long enough where that duration is too short; None where that is not known.
        trajectory: from its start on, which is its zero; None where it failed.
        goal: what follows, by the function that says it.
        proof: the certificate of the trajectory.
    """

    status: Status
    message: str
    duration: float
    needed: float | None = None
    trajectory: Trajectory | None = None
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
        """The slew to a state in a given duration, s; of one that is too short it says what is needed."""
        scenario = self._scenario(goal, duration)
        straight = fit(scenario, _straight(self.state, goal), _goal(self.state, goal, duration))
        if straight.status is Status.LIMITS_TOO_TIGHT:
            needed = straight.needed_duration
            text = straight.message
            return Slew(status=straight.status, message=text, duration=duration, needed=needed)
        if straight.status is Status.OK and straight.trajectory is not None:
            slew = self._proved(goal, straight.trajectory)
            if slew.trajectory is not None:
                return slew
        plan = plan_in_rounds([scenario], [Clock(scenario.search.time_limit)])[0]
        if plan.trajectory is None or not plan.ok:
            return Slew(status=plan.status, message=plan.message, duration=duration)
        return self._proved(goal, plan.trajectory)

    def _proved(self, goal: State, fitted: Trajectory) -> Slew:
        """A slew that was fitted, with the accelerations of both ends, and its certificate."""
        ends = (self.state.acceleration, self.state.bends), (goal.acceleration, goal.bends)
        made = curves.bent(fitted, ends)
        proof = proving.certify_part(self.scene, self.time, made, self.craft)
        if not proof.certified:
            text = "; ".join(proof.faults)
            return Slew(status=Status.UNCERTIFIED, message=text, duration=made.duration)
        return Slew(status=Status.OK, message="", trajectory=made, duration=made.duration, proof=proof)

    def shortest(
        self,
        goal_at: Callable[[float], tuple[State, Any]],
        seen_from: Callable[[float], float],
        last: float = np.inf,
    ) -> Slew:
        """The slew of the shortest time to a goal that depends on when it is reached.

        Args:
            goal_at: function from a time, s, in the timeline's times, to the state then and whatever the
                caller wants to have of it.
            seen_from: function from such a time to the first one at or after it at which there is a goal.
            last: s, the last such time at which there is one.
        """

        def admitted(duration: float) -> float:
            return seen_from(self.time + max(duration, _LEAST)) - self.time

        duration = admitted(min(_FIRST, last - self.time))
        state, found = goal_at(self.time + duration)
        duration = admitted(_above(self.bound(state)))
        failed: Slew | None = None
        for growth in _GROWTH:
            state, found = goal_at(self.time + duration)
            bound = self.bound(state)
            if duration < _CLOSE * bound:
                duration = admitted(_above(bound))
                state, found = goal_at(self.time + duration)
            slew = self.in_time(state, duration)
            if slew.trajectory is not None:
                return replace(slew, goal=found)
            failed = failed or slew
            if slew.status not in _PERHAPS_TOO_SHORT:
                return slew
            needed = slew.needed
            if needed is None and slew.status is Status.LIMITS_TOO_TIGHT:
                needed = self._shortest_to(state)
            duration = admitted(max(_SLACK * (needed or 0.0), growth * duration, duration + _STEP))
        assert failed is not None
        return failed

    def _shortest_to(self, goal: State) -> float | None:
        """Duration, s, of the shortest motion to a state; None where there is none."""
        scenario = self._scenario(goal, MINIMUM)
        plan = plan_in_rounds([scenario], [Clock(scenario.search.time_limit)])[0]
        return plan.trajectory.duration if plan.trajectory is not None and plan.ok else None

    def bound(self, goal: State) -> float:
        """Strict lower bound, s, of the duration of slews to a state; it knows no zones."""
        pairs = [(getattr(self.state, name), getattr(goal, name)) for name in _BOUND]
        return duration_bound(self.craft, *(np.stack(pair) for pair in pairs)).seconds

    def _scenario(self, goal: State, duration: Any) -> Scenario:
        """The problem of a slew to a state in a duration, s, or the shortest."""
        scene = later(self.scene, self.time, None if isinstance(duration, str) else duration)
        tube = scene.trajectory.node_tube
        settings = replace(
            scene.trajectory,
            duration=duration,
            method="global",
            end_acceleration="zero",
            node_tube=np.inf if tube is None else tube,
            first_guesses=0,
        )
        return replace(
            scene,
            name=f"slew at {self.time:.2f} s",
            spacecraft=self.craft,
            start=_given(self.state),
            goal=_given(goal),
            trajectory=settings,
        )


_PERHAPS_TOO_SHORT = (Status.LIMITS_TOO_TIGHT, Status.UNCERTIFIED)
_BOUND = ("attitude", "joints", "velocity", "rates")


def _above(bound: float) -> float:
    """The first duration, s, that is tried of slews with a strict bound, s."""
    return max(_ABOVE * bound, bound + _ROOM)


def _given(state: State) -> GivenState:
    """A state as scenarios have it."""
    return GivenState(
        rotation_vector=np.asarray(so3.log(state.attitude)),
        joints=state.joints,
        angular_velocity=state.velocity,
        joint_rates=state.rates,
    )


def _goal(start: State, state: State, time: float) -> Goal:
    """A state as the goal of a slew of `time` s."""
    return Goal(
        attitude=state.attitude,
        joints=state.joints,
        slew_angle=float(so3.distance(start.attitude, state.attitude)),
        time=time,
        angular_velocity=state.velocity,
        joint_rates=state.rates,
    )


def _straight(start: State, goal: State) -> Path:
    """The path of a single edge."""
    return Path(
        attitudes=np.stack([start.attitude, goal.attitude]),
        joints=np.stack([start.joints, goal.joints]),
        edge_costs=np.ones(1),
    )
