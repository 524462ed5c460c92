"""The motion of each kind of activity, from the time at which it begins.

A motion depends on when it begins, on the state that the spacecraft comes from, and for devices without a
target on where they are then. If there is none, `Refused` says which device, zone or time is in the way.
Times are seconds of the timeline; attitudes (3, 3) are body to inertial.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import array_module
from jaxplan.goal import Decomposition, decompose
from jaxplan.goal.followed_goal import with_wishes_met
from jaxplan.goal.pointing_start import least_rates
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import as_path
from jaxplan.model.goals import Targets
from jaxplan.model.path import Goal
from jaxplan.model.robust import Robust, usable
from jaxplan.model.scenario import STRETCHED
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.planner import messages
from jaxplan.planner.validity import breaches
from jaxplan.planner.wheel_room import overfull, with_wheel_room
from jaxplan.timeline import curves
from jaxplan.timeline.activity_times import ActivityTimes, Refused
from jaxplan.timeline.least_energy import Nodes, Wanted
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.timeline.tracking import (
    VIOLATION_TOLERANCE,
    State,
    Tracked,
    led_back,
    overrun,
    roomiest,
    track,
    violation_phrases,
)
from jaxplan.trajectory import Trajectory

SLEW_TIME = 30.0  # s, a usual slew; it weighs the way to a motion against the motion's own energy
_MAX_GOALS = 4  # number of attitudes of step 1 that are tried as first guesses
_LOOK_INTERVAL, _MAX_LOOKS = 5.0, 2000  # s between looks at zones, and the most of them
_EXACT_TOLERANCE = np.deg2rad(1e-6)  # rad, to which instruments and drives meet targets where they can
_EXTRA_ROOM = np.deg2rad(1.0)  # rad, room that pointing at an instant keeps to zones and ranges if it can


def with_room(craft: Spacecraft, targets: Targets) -> tuple[Spacecraft, Targets]:
    """Return spacecraft and targets that keep extra room, `_EXTRA_ROOM`, to ends of ranges and to zones."""
    clearance = array_module(targets.clearance).maximum(targets.clearance, _EXTRA_ROOM)
    return usable(craft, Robust(joint_error=_EXTRA_ROOM)), replace(targets, clearance=clearance)


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What is done from an instant on.

    Attributes:
        state: the state in which it begins.
        trajectory: the motion, its time zero at its begin; None for what takes no time.
        begin: s, in the timeline's times.
        tracked: how devices follow their targets; None where they have none.
        aim: the best goal of step 1 at the begin, to whose joints the nodes are drawn; None if unknown.
        led: whether the platform turns to where the next slew leads.
    """

    state: State
    trajectory: Trajectory | None
    begin: float
    tracked: Tracked | None = None
    aim: Goal | None = None
    led: bool = False


@dataclass(kw_only=True, eq=False)
class Doing(ActivityTimes):
    """An activity to be done by a spacecraft that comes from some state; see `ActivityTimes`.

    Attributes:
        before: the state from which the spacecraft comes.
        time: s, when it is in that state.
        total: (3,) N m s, momentum of platform and wheels in inertial axes; None without wheels.
        last: the motion that was found last, a first guess for the next; `motion` updates it.
    """

    before: State
    time: float
    total: np.ndarray | None = None
    last: Motion | None = field(default=None)

    def motion(self, begin: float) -> Motion:
        """Return the activity's motion from `begin`, s, on; raises `Refused` if there is none."""
        found = self._make_motion(begin)
        if self._fills_wheels(found):
            found = self._motion_with_wheel_room(begin) or found
        self.last = found
        self.expect_possible(found)
        return found

    def _fills_wheels(self, found: Motion) -> bool:
        """Tell whether wheels would be overfull by the attitudes alone with which targets are met.

        It is never told with `trajectory.optimal`, as slopes do not follow what wheels leave.
        """
        if self.activity.targets is None or self.scene.trajectory.optimal:
            return False
        attitudes = found.state.attitude if found.tracked is None else found.tracked.nodes.attitudes
        return overfull(self.scene.usable, self.total, attitudes)

    def _motion_with_wheel_room(self, begin: float) -> Motion | None:
        """Return the activity's motion by attitudes at which wheels are not full; None without any."""
        for scene in with_wheel_room(self.scene, self.total):
            with suppress(Refused):
                found = replace(self, scene=scene)._make_motion(begin)
                if not self._fills_wheels(found):
                    return found
        return None

    def _make_motion(self, begin: float) -> Motion:
        """Return the activity's motion from `begin`, s, on, which may exceed a limit."""
        own = self.activity
        self.expect_known(begin)
        if own.attitude is not None:
            given = own.attitude
            return self._holding_motion(State.still(given.attitude, given.joints), begin)
        if own.targets is None:
            return self._resting_motion(begin)
        return self._pointing_motion(own.targets, begin)

    def expect_possible(self, found: Motion) -> None:
        """Raise `Refused` if a motion exceeds a limit, or its ends break something or allow no slew."""
        if found.trajectory is None:
            return
        if fast := self._overload_text(found.trajectory, found.begin):
            raise Refused(Status.LIMITS_TOO_TIGHT, fast)
        # the slew to it must be able to end where it begins, and what follows to begin where it ends
        length = found.trajectory.duration
        ends = (found.state, 0.0, True), (State.of(found.trajectory, length), length, False)
        for state, after, arriving in ends:
            when = found.begin + after
            if broken := self._breach_text(state, when, arriving=arriving):
                raise Refused(Status.INVALID_GOAL, f"{broken}, at {when:.2f} s")

    def _overload_text(self, trajectory: Trajectory, begin: float) -> str:
        """Return text on the load that exceeds its limit the most, and when; empty if none does."""
        return overrun(
            self.scene.usable, trajectory, begin, self.total, moving=self.activity.targets is not None
        )

    def _holding_motion(self, state: State, begin: float) -> Motion:
        """Return the motion that stays in a state from `begin`, s, on; `Refused` if that breaks something."""
        if not self.lasts(begin):
            return Motion(state=state, trajectory=None, begin=begin)
        end = self.ends(begin)
        times = np.linspace(begin, end, curves.FEWEST)
        nodes = Nodes(
            times=times,
            attitudes=np.tile(state.attitude, (len(times), 1, 1)),
            joints=np.tile(state.joints, (len(times), 1)),
        )
        pursuit = Pursuit.of(self.scene.usable, self.scene.constraints, None)
        close = np.linspace(begin, end, int(np.clip((end - begin) / _LOOK_INTERVAL, len(times), _MAX_LOOKS)))
        still = [np.broadcast_to(part, (len(close), *part.shape)) for part in (state.attitude, state.joints)]
        margins = pursuit.margins(still[0], still[1], close)
        worst = close[int(np.argmin(np.min(margins, axis=1, initial=np.inf)))]
        phrases = violation_phrases(self.scene, replace(nodes, times=np.array([worst])), 0)
        if phrases:
            raise Refused(Status.INVALID_GOAL, f"{'; '.join(phrases)} at {worst:.2f} s")
        return Motion(state=state, trajectory=curves.through(nodes), begin=begin)

    def _resting_motion(self, begin: float) -> Motion:
        """Return the motion of a spacecraft that brakes to rest and then moves only if zones force it."""
        far = (begin - self.time) / 2  # braking evenly
        low, high = self.scene.usable.joint_ranges.T
        joints = np.clip(self.before.joints + far * self.before.rates, low, high)
        attitude = self.before.attitude @ so3.exp(far * self.before.velocity)
        still = State.still(attitude, joints)
        try:
            return self._holding_motion(still, begin)
        except Refused:
            return self._least_energy_motion(None, [attitude[None]], joints, begin)

    def _pointing_motion(self, targets: Targets, begin: float) -> Motion:
        """Return the motion that follows targets from `begin`, s, on, or the one that violates the least."""
        if not self.lasts(begin):
            return self._point_at_instant(targets, self._find_states(targets, begin).goals, begin)
        if self.last is not None and self.last.tracked is not None:
            nodes = self.last.tracked.nodes
            with suppress(Refused):  # later there may be another way
                aim = self._find_states(targets, begin).goals[0] if self.scene.trajectory.optimal else None
                joints = nodes.joints[0] if aim is None else aim.joints
                again = replace(self._least_energy_motion(targets, [nodes.attitudes], joints, begin), aim=aim)
                if keeps_all(again):
                    return again
        found = self._find_states(targets, begin)
        joints, refusals, made = found.goals[0].joints, [], []
        for guesses in self._guesses(targets, found.goals, begin):
            if guesses:
                try:
                    own = self._least_energy_motion(targets, guesses, joints, begin)
                    made.append(replace(own, aim=found.goals[0]))
                except Refused as refused:
                    refusals.append(refused)
            if made and keeps_all(made[-1]):
                return made[-1]
        if not made:
            raise refusals[0]
        return min(made, key=_violation_depth)  # the certificate tells what it breaks between its nodes

    def _guesses(self, targets: Targets, goals: Sequence[Goal], begin: float) -> Iterator[list[np.ndarray]]:
        """Yield lists of attitudes (1, 3, 3) at `begin`, s, as first guesses of a track, likely ones first.

        The best at the start may lead nowhere at the end. So next are those from which the targets lead to
        what is best at the end, and then those with the most room all along.
        """
        end, craft, rows = self.ends(begin), self.scene.usable, self.scene.constraints
        pursuit = Pursuit.of(craft, rows, targets)
        yield [goal.attitude[None] for goal in goals]
        later = self.attempted(craft, targets, end).goals
        yield [led_back(pursuit, goal.attitude, begin, end) for goal in later]
        yield roomiest(pursuit, self.before.joints, begin, end, count=_MAX_GOALS, seed=self.scene.search.seed)

    def _find_states(self, targets: Targets, begin: float) -> Decomposition:
        """Find states at `begin`, s, in which devices point at their targets, best first, or refuse."""
        scene, rows = self.scene, self.scene.constraints.at(begin)
        found = self.attempted(scene.usable, targets, begin)
        masked = any(one.mask for one in scene.usable.terminals)  # masks may be taken off ranges
        if not found.goals and (masked or found.aim_excess <= float(targets.tolerance)):
            self._expect_unobstructed(targets, begin)
        if not found.goals:
            settings = replace(scene.trajectory, duration=STRETCHED)
            asked = replace(scene, goal=targets.at(begin), trajectory=settings)
            text, _, _ = messages.unreachable(asked, rows, found, np.pi, begin).partition(": change ")
            text = text.replace(" at the goal", "")
            raise Refused(Status.GOAL_UNREACHABLE, f"{text}, at {begin:.2f} s")
        return found

    def _expect_unobstructed(self, targets: Targets, begin: float) -> None:
        """Raise `Refused` if targets can be met at `begin`, s, only where a constraint is broken."""
        bare = replace(self.scene, keep_out=(), keep_in=())
        terminals = tuple(replace(one, mask=()) for one in bare.spacecraft.terminals)
        bare = replace(bare, spacecraft=replace(bare.spacecraft, terminals=terminals))
        for goal in self.attempted(bare.usable, targets, begin, bare.constraints).goals:
            if broken := self._breach_text(State.still(goal.attitude, goal.joints), begin):
                raise Refused(Status.GOAL_UNREACHABLE, f"at best {broken}, at {begin:.2f} s")

    def attempted(
        self, craft: Spacecraft, targets: Targets, begin: float, rows: Constraints | None = None
    ) -> Decomposition:
        """Run step 1 for a spacecraft at `begin`, s, with the scene's constraints or with `rows`.

        Instruments and drives meet their targets exactly, so that the tolerance is left to the motion. If
        several of them cannot do so at once, they meet them within their tolerance.
        """
        asked, among = targets.at(begin), (self.scene.constraints if rows is None else rows).at(begin)
        most = float(targets.tolerance)
        bound = any(number >= len(craft.terminals) for number in targets.numbers(craft))
        for tolerance in dict.fromkeys((min(_EXACT_TOLERANCE, most), most)) if bound else (most,):
            found = decompose(
                craft,
                self.before.attitude,
                replace(asked, tolerance=tolerance),
                among,
                start_joints=self.before.joints,
                max_goals=_MAX_GOALS,
                seed=self.scene.search.seed,
            )
            if found.goals:
                break
        if targets.prefer and self.scene.trajectory.optimal:  # goals follow what they depend on
            own = craft, self.before.attitude, asked, among, self.before.joints
            return replace(found, goals=tuple(with_wishes_met(goal, *own) for goal in found.goals))
        return found

    def _point_at_instant(self, targets: Targets, goals: Sequence[Goal], begin: float) -> Motion:
        """Return the best state in which devices point at targets at `begin`, s, and turn with them."""
        roomy, clear = with_room(self.scene.usable, targets)
        first: str | None = None
        for goal in (*self.attempted(roomy, clear, begin).goals, *goals):
            state = self.at_rates(targets, goal, begin)
            broken = self._breach_text(state, begin, arriving=True) or self._breach_text(state, begin)
            if not broken:
                return Motion(state=state, trajectory=None, begin=begin)
            first = first or broken
        raise Refused(Status.INVALID_GOAL, f"{first}, at {begin:.2f} s")

    def at_rates(self, targets: Targets, goal: Goal, time: float) -> State:
        """Return a goal as the state in which devices follow targets at `time`, s, at the least rates."""
        spin, rates = least_rates(self.scene.usable, targets.at(time), goal, targets.rates(time))
        return replace(State.still(goal.attitude, goal.joints), velocity=spin, rates=rates)

    def _breach_text(self, state: State, time: float, *, arriving: bool = False) -> str:
        """Return text on what a state breaks at `time`, s, or must break next (before it, if `arriving`)."""
        each = state.attitude, state.joints, state.velocity, state.rates
        return "; ".join(breaches(self.scene, *each, arriving=arriving, time=time))

    def _least_energy_motion(
        self, targets: Targets | None, guesses: list[np.ndarray], joints: np.ndarray, begin: float
    ) -> Motion:
        """Return the motion of least energy near the first of some attitudes, `guesses`, that has one."""
        scene = self.scene
        craft, rows = scene.usable, scene.constraints
        pursuit = Pursuit.of(craft, rows, targets)
        settings = scene.trajectory
        wishes = () if targets is None else targets.prefer
        wanted = Wanted(
            attitude=self.before.attitude,
            joints=joints,
            slew_time=SLEW_TIME,
            wishes=tuple((craft.device_names.index(wish.device), as_path(wish.direction)) for wish in wishes),
            weights=(settings.rate_weight, settings.acceleration_weight),
            optimal=settings.optimal,
        )
        found = self._track_from_guesses(pursuit, wanted, guesses, begin)
        if wishes and self._overload_text(found.trajectory, begin):
            # to stay near the state before at first, and then go where a wish asks for, is too quick
            found = self._track_from_guesses(pursuit, replace(wanted, attitude=None), guesses, begin)
        self._expect_nodes_kept(found)
        return Motion(
            state=State.of(found.trajectory, 0.0), trajectory=found.trajectory, begin=begin, tracked=found
        )

    def _track_from_guesses(
        self, pursuit: Pursuit, wanted: Wanted, guesses: list[np.ndarray], begin: float
    ) -> Tracked:
        """Return the motion from the first guess that violates nothing, or else the one that does least."""
        targets = self.activity.targets
        tolerance = 1e-4 if targets is None else float(targets.tolerance)
        free, end = self._free_joints(targets), self.ends(begin)
        best: Tracked | None = None
        for guess in guesses:
            found = track(pursuit, wanted, free, guess, begin, end, tolerance)
            if best is None or found.depth < best.depth:
                best = found
            if max(best.depth) <= VIOLATION_TOLERANCE:
                break
        assert best is not None
        return best

    def _free_joints(self, targets: Targets | None) -> tuple[int, ...]:
        """Indices of the joints, of devices without a target, that may move for a zone or a wish."""
        craft, rows = self.scene.usable, self.scene.constraints
        gimbals, asked = craft.gimbals, () if targets is None else targets.numbers(craft)
        held = () if targets is None else targets.hold
        wished = () if targets is None else tuple(wish.device for wish in targets.prefer)
        found: list[int] = []
        for number in range(gimbals.count):
            name = craft.device_names[number]
            bound = bool(np.any(rows.bound[:, number])) or name in wished
            if number not in asked and name not in held and bound:
                found += gimbals.joints_of(number).tolist()
        return tuple(found)

    def _expect_nodes_kept(self, found: Tracked) -> None:
        """Raise `Refused` if nodes violate a range or a constraint."""
        if np.max(found.broken) <= VIOLATION_TOLERANCE:
            return
        phrases = violation_phrases(self.scene, found.nodes, found.worst)
        when = f"at {found.nodes.times[found.worst]:.2f} s"
        raise Refused(Status.GOAL_UNREACHABLE, f"{'; '.join(phrases) or 'a limit is passed'} {when}")


def _violation_depth(motion: Motion) -> tuple[float, float]:
    """Return how far nodes, and the curve between, violate something, rad; for motions with `tracked`."""
    assert motion.tracked is not None
    return motion.tracked.depth


def keeps_all(motion: Motion) -> bool:
    """Tell whether a motion that follows targets violates nothing at its nodes and between them."""
    return max(_violation_depth(motion)) <= VIOLATION_TOLERANCE
