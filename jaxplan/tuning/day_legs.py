"""One leg of a day, the slew to an activity and the activity itself, with derivatives of when it ends.

The duration of a slew is a multiple of the strict lower bound, which is a formula, or of the time of the
shortest motion. That motion is an optimum, differentiated as that of a single plan (`jaxplan.gradients`): its
slopes by ends, limits, inertia and zones are computed once, and a first-order expansion stands for it here.
Bound and shortest motion are to the state in which the activity begins (`jaxplan.tuning.day_states`).
"""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.derivatives import own_arrays
from jaxplan.gradients import differentiable
from jaxplan.model.activities import Activity
from jaxplan.model.duration_bound import moving_bound, rest_bounds
from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.at_once import at_once
from jaxplan.timeline.choices import BOUND, NEEDED, SEEN, Choice, SlewTime
from jaxplan.timeline.motions import Motion
from jaxplan.timeline.slews import Departure
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import measures
from jaxplan.tuning.day_states import Ends, Known, Reached, When

TIME_TOLERANCE = 1e-6  # s, by which times of a plan that was read, and of that plan made anew, may differ
_OPTIMUM_TOLERANCE = 0.01  # fraction of a shortest motion's time by which the optimum near it may differ


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeExpansion:
    """The time of a shortest motion near a plan's, to first order.

    Attributes:
        seconds: s, at the optimum.
        scenario: the scenario of the slew, in which that is the time.
        slopes: derivatives of the time by the scenario's numbers, in an object like it.
    """

    seconds: float
    scenario: Scenario
    slopes: Scenario

    def at(self, scenario: Scenario) -> Any:
        """Return the time, s, for a scenario near that of the plan."""
        change: Any = 0.0
        each = (jax.tree.leaves(tree) for tree in (self.slopes, scenario, self.scenario))
        for slope, now, then in zip(*each, strict=True):
            if np.asarray(slope).dtype.kind == "f":  # limits may be infinite, and have no slopes then
                change += jnp.sum(jnp.where(np.isfinite(then), slope * (jnp.asarray(now) - then), 0.0))
        return self.seconds + change


def expand_time(departure: Departure, time: SlewTime) -> TimeExpansion:
    """Expand the shortest time of a slew to first order in the numbers of its scenario.

    Args:
        departure: the state from which the slew starts.
        time: the slew's duration, a multiple of that shortest time.

    Raises:
        ValueError: if the shortest plan cannot be differentiated, or if its optimum takes a time that differs
            by more than 1 % from the one that was found.
    """
    plan = departure.shortest_plan(time)
    function = differentiable(plan)
    with jax.enable_x64(True):
        scenario = own_arrays(plan.scenario)
        seconds, slopes = jax.value_and_grad(lambda own: measures.duration(function(own)), allow_int=True)(
            scenario
        )
    asked = (time.seconds - time.offset) / time.factor
    if not abs(float(seconds) - asked) <= _OPTIMUM_TOLERANCE * asked:
        raise ValueError(f"the optimum near the slew of {asked:.2f} s takes {float(seconds):.2f} s")
    return TimeExpansion(seconds=float(seconds), scenario=scenario, slopes=slopes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """The slew to an activity and the activity itself, in numbers near those of the plan's timeline.

    Attributes:
        slopes: as of `HeldDay`.
        choice: how the activity came to begin, in the plan.
        reached: the rule for the state in which it begins.
        activity: the activity, with the changed numbers.
        scene: the timeline's scene, likewise.
        craft: the spacecraft, with what its wheels hold before the slew.
        state: the state before the slew.
        time: s, when that is reached.
        until: s, when the timeline ends; None without.
    """

    slopes: dict[int, TimeExpansion]
    choice: Choice
    reached: Reached
    activity: Activity
    scene: Scenario
    craft: Spacecraft
    state: State
    time: Any
    until: Any

    @property
    def begin(self) -> Any:
        """When the activity begins, s."""
        if self.choice.time is not None and isinstance(self.reached, Known):
            return self.choice.begin
        if self.choice.time is not None:
            return self.time + self._slew_seconds(self.choice.time)
        opens = self.choice.activity.earliest or 0.0
        late = abs(self.choice.begin - opens) > TIME_TOLERANCE  # what is hidden then depends on no number
        return self.choice.begin if late else self.activity.earliest or 0.0

    def states(self, begin: Any, near: Motion) -> Ends:
        """Return the states in which the activity begins, at `begin`, s, and ends, near a plan's motion."""
        when = When(self.time, begin, self.ends(begin))
        return self.reached.at(self.scene, self.activity, self.state, when, near)

    def ends(self, begin: Any) -> Any:
        """Return when the activity ends, s, if it begins at `begin`, s."""
        activity, opens = self.activity, self.activity.earliest
        if activity.duration is not None:
            waits = self.choice.begin < (self.choice.activity.earliest or 0.0)
            return (begin if opens is None or not waits else opens) + activity.duration
        if activity.kind == "point":
            return begin
        return self.until if activity.latest is None else activity.latest

    def _slew_seconds(self, own: SlewTime) -> Any:
        """Return a duration of the slew, s, for the changed numbers."""
        base: Any = 0.0
        if own.kind in (BOUND, NEEDED):
            after = own.after if self.reached.in_time else None
            goal = self.states(0.0 if after is None else self.time + self._slew_seconds(after), own.motion)[0]
            base = self._lower_bound(own, goal) if own.kind == BOUND else self._shortest_time(own, goal)
        elif own.kind == SEEN:
            base = self.choice.since + (own.seconds - own.offset) / own.factor - self.time
        return own.factor * base + own.offset

    def _lower_bound(self, own: SlewTime, goal: State) -> Any:
        """Return the strict lower bound, s, of the slew to a goal; either end may be in motion."""
        assert own.goal is not None
        then = self.choice.departure.state, own.goal
        turning = any(np.any(one.velocity) for one in then)
        pairs = [
            jnp.stack([jnp.asarray(getattr(one, name)) for one in (self.state, goal)])
            for name in ("attitude", "joints", "velocity", "rates")
        ]
        if turning or any(np.any(one.rates) for one in then):
            return _moving_bound(self.craft, *pairs, turning=turning)
        return _rest_bound(self.craft, *pairs[:2])

    def _shortest_time(self, own: SlewTime, goal: State) -> Any:
        """Return the time, s, of the shortest motion to a goal at rest."""
        here = replace(self.choice.departure, scene=self.scene, craft=self.craft, state=self.state)
        return self.slopes[id(own)].at(here.scenario(goal, MINIMUM))


@at_once()
def _rest_bound(craft: Spacecraft, attitudes: Array, joints: Array) -> Array:
    """Return the lower bound, s, of a slew at rest between attitudes (2, 3, 3) and joints (2, J)."""
    turn, moved = so3.log(attitudes[0].T @ attitudes[1]), joints[1] - joints[0]
    return rest_bounds(craft, turn[None], moved[None])[0]


@at_once("turning")
def _moving_bound(
    craft: Spacecraft, attitudes: Array, joints: Array, velocities: Array, rates: Array, *, turning: bool
) -> Array:
    """Return the lower bound, s, of a slew between two states, see `moving_bound`."""
    return moving_bound(craft, attitudes, joints, velocities, rates, turning=turning)
