"""Plan a timeline: its activities one after the other, slews between them, and the proof of it all.

Each activity begins as soon as its slew can end, but not before its window opens and the activity that it
comes after has ended; what keeps the spacecraft as it rests needs no slew. If the window opens later than a
slew in the shortest time ends, the targets are tracked until it opens, if they are seen then, or the slew
begins after a rest. A slew that is "calm" takes the time that there is, or a gentle time after a rest. An
activity that cannot be done is reported by name and left out, as is what comes after it by its `after`.
Planning ends there or, if asked to go on, continues from the state before it.

An activity is *led* if its motion turns the platform to where the next slew leads (`looking_ahead`).
"""

import time as clock
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from jaxplan.certificate import Certificate, faults_later
from jaxplan.model.activities import CALM, REST, Activity, Timeline, in_order
from jaxplan.model.status import Status
from jaxplan.runtime.progress import progress_bar
from jaxplan.runtime.workers import one_thread
from jaxplan.timeline import curves, proving
from jaxplan.timeline.activity_checks import expect_in_time, expect_near
from jaxplan.timeline.activity_times import LEAST_LENGTH, Refused
from jaxplan.timeline.choices import Choice, SlewTime
from jaxplan.timeline.looking_ahead import led_ahead
from jaxplan.timeline.motions import Doing, Motion
from jaxplan.timeline.partial_plan import SoFar, first_again
from jaxplan.timeline.record import PlannedActivity, TimelineError, TimelinePlan
from jaxplan.timeline.slews import Departure, Slew
from jaxplan.timeline.tracking import State

_GENTLE_FACTOR = 6.0  # times the lower bound: how long a slew takes at most where there is time
_GENTLE_DURATION = 60.0  # s; a slew of that duration is gentle in any case, and less time is not worth a rest
_MAX_TRIES, _RETRY_FACTOR = 3, 1.05  # most slews from a rest, and the next one's time over what one needs
_TIME_TOLERANCE = 1e-9  # s, below which there is no time for a slew


@dataclass(frozen=True, kw_only=True, eq=False)
class _Option:
    """How an activity can be done.

    Attributes:
        doing: the activity, with what it begins from.
        departure: where the slew to it starts.
        slew: the slew to it.
        motion: the motion that follows the slew.
    """

    doing: Doing
    departure: Departure
    slew: Slew
    motion: Motion


@dataclass(frozen=True, kw_only=True, eq=False)
class _UnledOption:
    """How an activity that was led would be done if it were not.

    Attributes:
        day: the day as planned before it.
        found: its slew and motion, not led.
        bound: s, lower bound of the next slew's duration after that motion.
    """

    day: "_Day"
    found: _Option
    bound: float


def plan_timeline(
    timeline: Timeline,
    *,
    after: TimelinePlan | None = None,
    from_activity: str | None = None,
    throw: bool = True,
    go_on: bool = False,
    progress: bool = True,
) -> TimelinePlan:
    """Plan all activities of a timeline and the slews between them, and prove the motion safe.

    Args:
        timeline: what is to be done.
        after: an earlier plan, which is kept up to where the slew to `from_activity` begins. Up to then the
            timeline must be the same; from that activity on anything may differ. None to plan all.
        from_activity: name of the first activity that is planned anew; None to plan all.
        throw: raise TimelineError if an activity cannot be planned; if False, return what was found.
        go_on: whether to plan the rest if an activity cannot be planned; if False, planning ends there.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Returns:
        The plan, whose trajectory is a single one over all activities.

    Raises:
        TypeError: for arguments of other classes, such as the name of a file in place of a timeline.
        TimelineError: if `throw` and the plan is not OK; it has the plan, its status and a message that says
            which activity failed, what is in the way and what to change.
        ScenarioError: for values that no timeline may have; the message lists every fault.
        ValueError: if only one of `after` and `from_activity` is given, if there is no such activity, or if
            what comes before it has changed.

    Example:
        >>> day = jp.plan_timeline(timeline)
        >>> changed = jp.plan_timeline(other, after=day, from_activity="lisbon")
    """
    with one_thread():
        day = _Day(timeline)
        count = len(day.timeline.activities)
        with progress_bar("planning", "activities", total=count, shown=progress) as bar:
            for activity in day.left(after, from_activity):
                bar.step(activity.name)
                day = day.after(activity)
                if not day.activities[-1].ok and not go_on:
                    break
                bar.update()
            else:
                day.rest()
            bar.step("proof")
            plan = day.result()
    if throw and not plan.ok:
        raise TimelineError(plan)
    return plan


class _Day(SoFar):
    """A partly planned timeline that can plan further activities.

    Attributes:
        otherwise: how the last activity would be done if it were not led; None if it is not led.
        following: the next activity by the name of each, if the timeline looks ahead; else empty.
    """

    def __init__(self, timeline: Timeline) -> None:
        super().__init__(timeline)
        self.otherwise: _UnledOption | None = None
        ordered = in_order(self.timeline.activities) if self.timeline.look_ahead else ()
        self.following = {one.name: then for one, then in pairwise(ordered)}

    def left(self, kept: TimelinePlan | None, name: str | None) -> list[Activity]:
        """Return the activities to plan, in order, after taking those before `name` over from a kept plan.

        With None for both arguments all activities are to be planned; None for one of them is a ValueError.
        """
        ordered = in_order(self.timeline.activities)
        if kept is None and name is None:
            return ordered
        if kept is None or name is None:
            raise ValueError("after and from_activity: one needs the other")
        first = first_again(self.timeline, kept, name)
        names = [one.name for one in ordered[:first]]
        for segment in kept.segments:
            if segment.name not in names:
                break
            assert kept.trajectory is not None
            own = curves.part(kept.trajectory, segment.start, segment.end)
            proof = proving.certify_part(self.scene, segment.start, own, self._loaded_craft())
            self._add_part(segment.name, segment.kind, own, proof)
        self.activities += kept.activities[:first]
        self.choices += [one for one in kept.choices if one.activity.name in names]
        return ordered[first:]

    def after(self, activity: Activity) -> "_Day":
        """Plan an activity from the state so far, or record why it cannot be done; returns the day after it.

        If the activity before was led to this one, the day in which it was not is planned as well, unless its
        slew cannot be shorter, and the better day is returned. So this activity ends no later, and is not
        refused, because the one before was led. Activities after it begin from another state, and may end
        later.
        """
        otherwise, self.otherwise = self.otherwise, None
        done = self._try_activity(activity)
        if otherwise is None or (done and (self.activities[-1].slew or 0.0) <= otherwise.bound):
            return self
        other = otherwise.day
        try:
            other._add_activity(otherwise.found, *other._prove_motion(otherwise.found))
        except Refused:
            return self
        if not other._try_activity(activity):
            return self if done else other
        return self if done and self._last_times() < other._last_times() else other

    def _last_times(self) -> tuple[float, float]:
        """Return when the last activity ends and how long the slew to it takes, s, for comparing two days."""
        last = self.activities[-1]
        return round(last.end or 0.0, 6), last.slew or 0.0

    def _try_activity(self, activity: Activity) -> bool:
        """Plan an activity from the state so far, or record why it cannot be done.

        Returns whether it could.
        """
        before = self._mark()
        try:
            if self.broken:
                raise Refused(Status.INVALID_START, "; ".join(self.broken))
            self._expect_done(activity.after)
            self._do_activity(activity)
        except Refused as refused:
            self._roll_back(before)  # without a rest that was to fill time
            self.activities.append(
                PlannedActivity(
                    name=activity.name, kind=activity.kind, status=refused.status, message=refused.message
                )
            )
            return False
        return True

    def _expect_done(self, name: str) -> None:
        """Raise `Refused` if the activity `name`, which must be done before, is not; "" stands for none."""
        failed = next((one for one in self.activities if one.name == name and not one.ok), None)
        if failed is not None:
            raise Refused(failed.status, f"{name}, after which it comes, is not done ({failed.status.name})")

    def rest(self) -> None:
        """Plan a rest until the end of the timeline, if time is left."""
        until = self.timeline.until
        if until is not None and until > self.time + LEAST_LENGTH:
            self._try_activity(Activity(name=REST, idle=True))

    def _do_activity(self, activity: Activity, *, listed: bool = True) -> None:
        """Plan an activity; raises `Refused`.

        `listed` is False for a rest that only fills time, which is not listed among the activities.
        """
        doing = self._make_doing(activity)
        slew, motion = self._find_slew(doing)
        departure = Departure(scene=self.scene, craft=self._loaded_craft(), state=self.state, time=self.time)
        found = _Option(doing=doing, departure=departure, slew=slew, motion=motion)
        if not self._try_led(found):
            self._add_activity(found, *self._prove_motion(found), listed=listed)

    def _add_activity(
        self, found: _Option, proof: Certificate | None, error: float | None, *, listed: bool = True
    ) -> None:
        """Append slew and motion of an activity, and list the activity unless `listed` is False.

        Args:
            found: how the activity is done.
            proof: certificate of its motion; None if it takes no time.
            error: rad, angle within which devices are proved to point; None if nothing is tracked.
            listed: whether the activity is listed, with the choices made for it.
        """
        activity, slew, motion = found.doing.activity, found.slew, found.motion
        if slew.trajectory is not None and slew.proof is not None:
            self._add_part(activity.name, "slew", slew.trajectory, slew.proof)
        if motion.trajectory is not None and proof is not None:
            self._add_part(activity.name, activity.kind, motion.trajectory, proof)
        self.state = motion.state if motion.trajectory is None else self.state
        if not listed:
            return
        self.choices.append(
            Choice(
                activity=activity,
                before=found.doing.before,
                since=found.doing.time,
                departure=found.departure,
                time=slew.time,
                goal=motion.state,
                begin=motion.begin,
                end=self.time,
                motion=motion,
            )
        )
        self.activities.append(
            PlannedActivity(
                name=activity.name,
                kind=activity.kind,
                status=Status.OK,
                start=max(motion.begin, activity.earliest or 0.0),
                end=self.time,
                slew=slew.duration if slew.trajectory is not None else 0.0,
                pointing_error=error,
            )
        )

    def _make_doing(self, activity: Activity) -> Doing:
        """Return an activity as one to be done from the state so far."""
        return Doing(
            scene=self.scene,
            activity=activity,
            before=self.state,
            time=self.time,
            latest_end=activity.latest if activity.latest is not None else self.timeline.until,
            known=np.inf if self.timeline.until is None else self.timeline.until,
            total=self.total,
        )

    def _try_led(self, found: _Option) -> bool:
        """Plan an activity led to where the next slew leads; returns whether that was possible and of use.

        The slew to it takes as long as the one that was found before.
        """
        doing, departure, then = found.doing, found.departure, self.following.get(found.doing.activity.name)
        begin = found.motion.begin
        if then is None or found.slew.trajectory is None:
            return False
        if self.timeline.slew == CALM and (then.earliest or 0.0) > doing.ends(begin) + _TIME_TOLERANCE:
            return False  # the next slew takes the time that there is
        begun = clock.monotonic()
        led = led_ahead(doing, found.motion, self._make_doing(then))
        self.seconds["motions"] += clock.monotonic() - begun
        if led is None:
            return False
        begun = clock.monotonic()
        slew = departure.in_time(led.motion.state, begin - departure.time)
        self.seconds["slews"] += clock.monotonic() - begun
        if slew.trajectory is None:
            return False
        slew = replace(slew, goal=led.motion, time=found.slew.time)
        own = replace(found, slew=slew, motion=led.motion)
        try:
            proved = self._prove_motion(own)
        except Refused:
            return False
        self.otherwise = _UnledOption(day=self._copy(), found=found, bound=led.bound)
        self._add_activity(own, *proved)
        return True

    def _prove_motion(self, found: _Option) -> tuple[Certificate | None, float | None]:
        """Return the proof of a motion, and within which angle, rad, devices point; raises `Refused`.

        Both are None for a motion that takes no time; the angle is None if nothing is tracked.
        """
        activity, motion = found.doing.activity, found.motion
        if motion.trajectory is None:
            return None, None
        begun, error = clock.monotonic(), None
        craft = self._loaded_craft(found.slew.trajectory)
        proof = proving.certify_part(self.scene, motion.begin, motion.trajectory, craft)
        if activity.track is not None:
            error = proving.pointing_error(self.scene, activity.track, motion.trajectory, motion.begin)
        self.seconds["proof"] += clock.monotonic() - begun
        if not proof.certified:
            faults = faults_later(proof, motion.begin)
            raise Refused(
                Status.UNCERTIFIED, f"{'; '.join(faults)}; the activity begins at {motion.begin:.2f} s"
            )
        expect_near(activity, error)
        return proof, error

    def _find_slew(self, doing: Doing) -> tuple[Slew, Motion]:
        """Return the slew to an activity and the motion that follows it; raises `Refused`."""
        activity = doing.activity
        if held := self._find_held(doing):
            return held
        opens = activity.earliest or 0.0
        departure = Departure(scene=self.scene, craft=self._loaded_craft(), state=self.state, time=self.time)
        waits = opens > self.time + _TIME_TOLERANCE
        if waits and self.timeline.slew == CALM:
            try:
                return self._calm_slew(departure, doing, opens)
            except Refused as refused:
                if refused.status not in (Status.LIMITS_TOO_TIGHT, Status.UNCERTIFIED):
                    raise
                waits = False  # there is too little time until then
        begun = clock.monotonic()
        spent = self.seconds["motions"]

        def goal_at(time: float) -> tuple[State, Motion]:
            found = self._find_motion(doing, time)
            return found.state, found

        try:
            slew = departure.shortest(goal_at, doing.seen_from, doing.last_begin)
        except Refused:
            if not waits:
                raise
            return self._calm_slew(departure, doing, opens)
        finally:
            self.seconds["slews"] += clock.monotonic() - begun - (self.seconds["motions"] - spent)
        if slew.trajectory is None:
            if waits:
                return self._calm_slew(departure, doing, opens)
            raise Refused(slew.status, f"no slew to it from {self.time:.2f} s on: {slew.message}")
        expect_in_time(doing, slew.goal, self.time)
        if slew.time is not None and slew.time.at_an_instant:
            return self._slew_after_rest(departure, doing, slew), slew.goal
        return slew, slew.goal

    def _find_held(self, doing: Doing) -> tuple[Slew, Motion] | None:
        """Return a slew of no duration to an activity that keeps the spacecraft as it rests, and its motion.

        Returns:
            None for an activity that asks for something else, or where zones do not let it rest as it is.
        """
        given = doing.activity.attitude
        asked = self.state if given is None else State.still(given.attitude, given.joints)
        if doing.activity.targets is not None or not self.state.at_rest or not asked.same_as(self.state):
            return None
        try:
            motion = self._find_motion(doing, self.time)
        except Refused as refused:
            if refused.status is Status.OUT_OF_WINDOW:
                raise
            return None
        if motion.tracked is not None or (motion.trajectory is None and not self.parts):
            return None  # it moves, or would leave a day without any motion
        expect_in_time(doing, motion, self.time)
        return Slew(status=Status.OK, message="", duration=0.0, time=SlewTime.fixed(0.0)), motion

    def _slew_after_rest(self, departure: Departure, doing: Doing, slew: Slew) -> Slew:
        """Return a slew that ends at a given instant, such as that at which a target comes into sight.

        If there is much time until then, the platform rests first, and then slews in the shortest time. If
        there is not, or that fails, the slew takes all the time there is; it is the argument `slew`.
        """
        motion, slew = slew.goal, replace(slew, time=None)
        if slew.duration <= _GENTLE_DURATION:
            return slew
        quick = departure.shortest(lambda _: (motion.state, motion), lambda time: time)
        lasts = None if quick.trajectory is None else quick.duration
        for _ in range(_MAX_TRIES):
            if lasts is None or slew.duration - lasts <= _GENTLE_DURATION:
                break
            mark = self._mark()
            if not self._rest_until(doing.activity.name, motion.begin - lasts):
                break
            departure = replace(departure, craft=self._loaded_craft(), state=self.state, time=self.time)
            late = departure.in_time(motion.state, motion.begin - self.time)
            if late.trajectory is not None:
                return late
            self._roll_back(mark)  # from where it rests the way may be a longer one
            lasts = None if late.needed is None else max(_RETRY_FACTOR * late.needed, _RETRY_FACTOR * lasts)
        return slew

    def _calm_slew(self, departure: Departure, doing: Doing, opens: float) -> tuple[Slew, Motion]:
        """Return the slew that takes all the time until an activity may begin, and the motion that follows.

        `opens` is when its window opens, s. If there is more time than a gentle slew takes, a rest comes
        first.
        """
        begin = doing.seen_from(opens)
        motion = self._find_motion(doing, begin)
        expect_in_time(doing, motion, self.time)
        gentle = max(_GENTLE_FACTOR * departure.bound(motion.state), _GENTLE_DURATION)
        if begin - self.time > gentle + _GENTLE_DURATION and self._rest_until(
            doing.activity.name, begin - gentle
        ):
            departure = replace(departure, craft=self._loaded_craft(), state=self.state, time=self.time)
        begun = clock.monotonic()
        slew = departure.in_time(motion.state, begin - self.time)
        self.seconds["slews"] += clock.monotonic() - begun
        if slew.trajectory is None:
            raise Refused(
                slew.status, f"no slew to it from {self.time:.2f} s to {begin:.2f} s: {slew.message}"
            )
        return slew, motion

    def _rest_until(self, name: str, until: float) -> bool:
        """Rest until a time, s, from which a slew to the activity `name` is gentle.

        Returns whether that works.
        """
        try:
            self._do_activity(Activity(name=name, idle=True, latest=until), listed=False)
        except Refused:
            return False
        return True

    def _find_motion(self, doing: Doing, begin: float) -> Motion:
        """Return the motion of an activity from `begin`, s, on, and count its computation time."""
        begun = clock.monotonic()
        try:
            return doing.motion(begin)
        finally:
            self.seconds["motions"] += clock.monotonic() - begun
