"""Plan a timeline: its activities one after the other, slews between them, and the proof of it all.

Each activity begins as soon as its slew can end, not before its window and the one that it comes after. Where
the window is later than that, a slew in the shortest time is followed by the targets' pursuit until the
window opens, if they are seen then, or else begins after a rest; a calm one takes the time that there is, or
what is gentle, after a rest. An activity that cannot be done is told by name and is not done, nor is what
comes after it by its `after`. Planning ends there; if asked the rest is planned from the state before it.
"""

import time as clock
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from jaxplan.certificate import Certificate, faults_later
from jaxplan.model.sameness import same
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.model.timeline import CALM, REST, Activity, Segment, Timeline, in_order
from jaxplan.planner.validity import start_breaches
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.progress import progress_bar
from jaxplan.runtime.workers import one_thread
from jaxplan.schema.faults import nearest
from jaxplan.schema.timelines import take_in_timeline
from jaxplan.timeline import curves, proving
from jaxplan.timeline.choices import Choice
from jaxplan.timeline.motions import Doing, Motion, Refused
from jaxplan.timeline.record import PlannedActivity, TimelineError, TimelinePlan
from jaxplan.timeline.slews import Departure, Slew
from jaxplan.timeline.stored import holding, total_in
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import Trajectory

_GENTLE = 6.0  # times the strict bound: how long a slew takes at most where there is time
_USUAL = 60.0  # s: a slew that long is gentle in any case, and less time is not worth a rest
_TRIES, _MORE = 3, 1.05  # slews from a rest that are tried, and the factor on what one needs for the next
_SAME = 1e-9  # s, below which there is no time for a slew


def plan_timeline(
    timeline: Timeline,
    *,
    after: TimelinePlan | None = None,
    from_activity: str | None = None,
    throw: bool = True,
    go_on: bool = False,
    progress: bool = True,
) -> TimelinePlan:
    """Plan all activities of a timeline, with the slews between them, and prove it safe.

    Args:
        timeline: what is to be done.
        after: an earlier plan that is kept up to where the slew to `from_activity` begins. Until then the
            timeline must be the same; from that activity on anything may differ.
        from_activity: name of the first activity that is planned anew.
        throw: raise when an activity cannot be planned; otherwise return what was found.
        go_on: whether the rest is planned where an activity cannot be; else planning ends there.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Returns:
        The plan, whose trajectory is one over all activities.

    Raises:
        TimelineError: with ``status``, ``plan`` and a message that says which activity, what is in the way
            and what to change, if ``throw``.
        ScenarioError: for what no timeline may have; the message lists every fault.
        ValueError: if one of `after` and `from_activity` is given without the other, or no such activity is.

    Example:
        >>> day = jp.plan_timeline(timeline)
        >>> changed = jp.plan_timeline(other, after=day, from_activity="lisbon")
    """
    with (
        one_thread(),
        progress_bar("planning", "activities", total=len(timeline.activities), shown=progress) as bar,
    ):
        day = _Day(timeline)
        for activity in day.left(after, from_activity):
            bar.step(activity.name)
            if not day.do(activity) and not go_on:
                break
            bar.update()
        else:
            day.rest()
        bar.step("proof")
        plan = day.result()
    if throw and not plan.ok:
        raise TimelineError(plan)
    return plan


class _Day:
    """A timeline under way: what is planned so far, and the state in which that ends."""

    def __init__(self, timeline: Timeline) -> None:
        timeline = take_in_timeline(timeline)
        scene, start = timeline.scene, timeline.scene.start
        self.timeline, self.scene = timeline, scene
        zero = np.zeros(len(start.joints))
        self.state = State(
            attitude=start.attitude,
            joints=start.joints,
            velocity=np.asarray(start.angular_velocity, float),
            rates=np.asarray(start.joint_rates, float),
            acceleration=np.zeros(3),
            bends=zero,
        )
        self.time = 0.0
        self.total = total_in(scene.spacecraft, self.state)
        self.parts: list[tuple[float, Trajectory]] = []
        self.proofs: list[tuple[float, Trajectory, Certificate]] = []
        self.segments: list[Segment] = []
        self.activities: list[PlannedActivity] = []
        self.choices: list[Choice] = []
        self.seconds = {"motions": 0.0, "slews": 0.0, "proof": 0.0}
        self.broken = start_breaches(replace(scene, goal=start))

    def left(self, kept: TimelinePlan | None, name: str | None) -> list[Activity]:
        """The activities that are to be planned; those before a name are taken from a plan that is kept."""
        ordered = in_order(self.timeline.activities)
        if kept is None and name is None:
            return ordered
        if kept is None or name is None:
            raise ValueError("after and from_activity: one needs the other")
        expect("after", kept, TimelinePlan, "jp.plan_timeline makes one")
        names = [one.name for one in ordered]
        if name not in names:
            raise ValueError(f"from_activity = {name!r}: no such activity, {nearest(name, names, 'names')}")
        first = names.index(name)
        before = kept.activities[:first]
        if [one.name for one in before] != names[:first]:
            raise ValueError(f"after: the activities before {name} are not those of the timeline")
        self._expect_the_same(kept, names[:first])
        for segment in kept.segments:
            if segment.name not in names[:first]:
                break
            assert kept.trajectory is not None
            own = curves.part(kept.trajectory, segment.start, segment.end)
            proof = proving.certify_part(self.scene, segment.start, own, self._craft())
            self._add(segment.name, segment.kind, own, proof)
        self.activities += before
        self.choices += [one for one in kept.choices if one.activity.name in names[:first]]
        return ordered[first:]

    def _expect_the_same(self, kept: TimelinePlan, names: Sequence[str]) -> None:
        """Raise a ValueError where activities of these names, or the start, are others in a kept plan."""
        were, are = (
            {one.name: one for one in timeline.activities} for timeline in (kept.timeline, self.timeline)
        )
        for own in names:
            changed = [
                part.name
                for part in fields(Activity)
                if not same(getattr(were.get(own), part.name, None), getattr(are[own], part.name))
            ]
            if changed:
                raise ValueError(
                    f"after: activity {own} differs from the one that was planned in "
                    f"{', '.join(changed)}: plan anew from it on, by from_activity, or leave it as it was"
                )
        if not same(kept.timeline.scene.start, self.scene.start):
            raise ValueError(
                "after: the start differs from the one that was planned: plan the whole timeline"
            )

    def do(self, activity: Activity) -> bool:
        """Plan an activity from the state so far on; returns whether it could be."""
        before = self._mark()
        try:
            if self.broken:
                raise Refused(Status.INVALID_START, "; ".join(self.broken))
            self._expect_done(activity.after)
            self._do(activity)
        except Refused as refused:
            self._back_to(before)  # without a rest that was to fill time
            self.activities.append(
                PlannedActivity(
                    name=activity.name, kind=activity.kind, status=refused.status, message=refused.message
                )
            )
            return False
        return True

    def _mark(self) -> tuple[State, float, int]:
        """How far the plan is, to come back to by `_back_to`."""
        return self.state, self.time, len(self.parts)

    def _back_to(self, mark: tuple[State, float, int]) -> None:
        """Take away what was added after a mark."""
        self.state, self.time, kept = mark
        del self.parts[kept:], self.proofs[kept:], self.segments[kept:]

    def _expect_done(self, name: str) -> None:
        """Raise `Refused` if the activity of a name, which was to be done before, is not; empty for none."""
        failed = next((one for one in self.activities if one.name == name and not one.ok), None)
        if failed is not None:
            raise Refused(failed.status, f"{name}, after which it comes, is not done ({failed.status.name})")

    def rest(self) -> None:
        """Rest until the timeline's end, if time is left."""
        until = self.timeline.until
        if until is not None and until > self.time + _SAME:
            self.do(Activity(name=REST, idle=True))

    def _do(self, activity: Activity, *, listed: bool = True) -> None:
        """Plan an activity; raises `Refused`. What only fills time is not listed among the activities."""
        doing = Doing(
            scene=self.scene,
            activity=activity,
            before=self.state,
            time=self.time,
            latest_end=activity.latest if activity.latest is not None else self.timeline.until,
            known=np.inf if self.timeline.until is None else self.timeline.until,
            total=self.total,
        )
        slew, motion = self._slew(doing)
        start = max(motion.begin, activity.earliest or 0.0)
        error = proof = None
        if motion.trajectory is not None:
            begun = clock.monotonic()
            proof = proving.certify_part(
                self.scene, motion.begin, motion.trajectory, self._craft(slew.trajectory)
            )
            if activity.track is not None:
                error = proving.pointing_error(self.scene, activity.track, motion.trajectory, motion.begin)
            self.seconds["proof"] += clock.monotonic() - begun
            if not proof.certified:
                faults = faults_later(proof, motion.begin)
                raise Refused(
                    Status.UNCERTIFIED, f"{'; '.join(faults)}; the activity begins at {motion.begin:.2f} s"
                )
            self._expect_near(activity, error)
        departure = Departure(scene=self.scene, craft=self._craft(), state=self.state, time=self.time)
        if slew.trajectory is not None and slew.proof is not None:
            self._add(activity.name, "slew", slew.trajectory, slew.proof)
        if motion.trajectory is not None and proof is not None:
            self._add(activity.name, activity.kind, motion.trajectory, proof)
        self.state = motion.state if motion.trajectory is None else self.state
        if not listed:
            return
        self.choices.append(
            Choice(
                activity=activity,
                before=doing.before,
                since=doing.time,
                departure=departure,
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
                start=start,
                end=self.time,
                slew=slew.duration if slew.trajectory is not None else 0.0,
                pointing_error=error,
            )
        )

    @staticmethod
    def _expect_near(activity: Activity, error: float | None) -> None:
        """Raise `Refused` if the error, rad, within which devices are proved to point is too large."""
        if error is None or activity.track is None or error <= float(activity.track.tolerance):
            return
        off, most = np.rad2deg([error, float(activity.track.tolerance)])
        raise Refused(
            Status.UNCERTIFIED,
            f"devices are proved to point within {off:.3g} deg, tolerance_deg = {most:g} is asked for: raise "
            "it, or choose a target that moves less fast",
        )

    def _add(self, name: str, kind: str, trajectory: Trajectory, proof: Certificate) -> None:
        """Append a part of the motion with its certificate, and go on from its end."""
        self.parts.append((self.time, trajectory))
        self.proofs.append((self.time, trajectory, proof))
        end = self.time + trajectory.duration
        self.segments.append(Segment(name=name, kind=kind, start=self.time, end=end))
        self.state, self.time = State.of(trajectory, trajectory.duration), end

    def _craft(self, further: Trajectory | None = None) -> Spacecraft:
        """The spacecraft with what its wheels hold now, or at the end of a further part."""
        state = self.state if further is None else State.of(further, further.duration)
        return holding(self.scene.spacecraft, self.total, state)

    def _slew(self, doing: Doing) -> tuple[Slew, Motion]:
        """The slew to an activity, and the motion that follows; raises `Refused`."""
        activity = doing.activity
        opens = activity.earliest or 0.0
        departure = Departure(scene=self.scene, craft=self._craft(), state=self.state, time=self.time)
        waits = opens > self.time + _SAME
        if waits and self.timeline.slew == CALM:
            try:
                return self._calm(departure, doing, opens)
            except Refused as refused:
                if refused.status not in (Status.LIMITS_TOO_TIGHT, Status.UNCERTIFIED):
                    raise
                waits = False  # there is too little time until then
        begun = clock.monotonic()
        spent = self.seconds["motions"]

        def goal_at(time: float) -> tuple[State, Motion]:
            found = self._motion(doing, time)
            return found.state, found

        try:
            slew = departure.shortest(goal_at, doing.seen_from, doing.last_begin)
        except Refused:
            if not waits:
                raise
            return self._calm(departure, doing, opens)
        finally:
            self.seconds["slews"] += clock.monotonic() - begun - (self.seconds["motions"] - spent)
        if slew.trajectory is None:
            if waits:
                return self._calm(departure, doing, opens)
            raise Refused(slew.status, f"no slew to it from {self.time:.2f} s on: {slew.message}")
        self._expect_in_time(doing, slew.goal)
        if slew.time is not None and slew.time.at_an_instant:
            return self._after_rest(departure, doing, slew), slew.goal
        return slew, slew.goal

    def _after_rest(self, departure: Departure, doing: Doing, slew: Slew) -> Slew:
        """A slew that must not end before an instant, such as that at which a target comes into sight.

        Where there is much time until then the platform rests, and slews in the shortest time after that;
        else, or where that cannot be, it takes all the time that there is, which is `slew`.
        """
        motion, slew = slew.goal, replace(slew, time=None)
        if slew.duration <= _USUAL:
            return slew
        quick = departure.shortest(lambda _: (motion.state, motion), lambda time: time)
        lasts = None if quick.trajectory is None else quick.duration
        for _ in range(_TRIES):
            if lasts is None or slew.duration - lasts <= _USUAL:
                break
            mark = self._mark()
            if not self._wait(doing.activity.name, motion.begin - lasts):
                break
            departure = replace(departure, craft=self._craft(), state=self.state, time=self.time)
            late = departure.in_time(motion.state, motion.begin - self.time)
            if late.trajectory is not None:
                return late
            self._back_to(mark)  # from where it rests the way may be a longer one
            lasts = None if late.needed is None else max(_MORE * late.needed, _MORE * lasts)
        return slew

    def _calm(self, departure: Departure, doing: Doing, opens: float) -> tuple[Slew, Motion]:
        """The slew that takes all the time until an activity may begin, and the motion that follows."""
        begin = doing.seen_from(opens)
        motion = self._motion(doing, begin)
        self._expect_in_time(doing, motion)
        gentle = max(_GENTLE * departure.bound(motion.state), _USUAL)
        if begin - self.time > gentle + _USUAL and self._wait(doing.activity.name, begin - gentle):
            departure = replace(departure, craft=self._craft(), state=self.state, time=self.time)
        begun = clock.monotonic()
        slew = departure.in_time(motion.state, begin - self.time)
        self.seconds["slews"] += clock.monotonic() - begun
        if slew.trajectory is None:
            raise Refused(
                slew.status, f"no slew to it from {self.time:.2f} s to {begin:.2f} s: {slew.message}"
            )
        return slew, motion

    def _wait(self, name: str, until: float) -> bool:
        """Rest until a time, s, from which a slew to an activity is gentle; returns whether that can be."""
        try:
            self._do(Activity(name=name, idle=True, latest=until), listed=False)
        except Refused:
            return False
        return True

    def _motion(self, doing: Doing, begin: float) -> Motion:
        """The motion of an activity from a time, s, on."""
        begun = clock.monotonic()
        try:
            return doing.motion(begin)
        finally:
            self.seconds["motions"] += clock.monotonic() - begun

    def _expect_in_time(self, doing: Doing, motion: Motion) -> None:
        """Raise `Refused` if an activity would end too late."""
        activity = doing.activity
        end, latest = doing.ends(motion.begin), activity.latest
        lasting = activity.duration is None and activity.kind != "point"
        if lasting and doing.latest_end is not None and not end > motion.begin:
            late = motion.begin - doing.latest_end
            raise Refused(
                Status.OUT_OF_WINDOW,
                f"it can begin at {motion.begin:.2f} s at the earliest, {late:.2f} s after its end",
            )
        if latest is not None and end > latest + _SAME:
            hidden = doing.seen_at_last(motion.begin)
            why = f"its slew begins at {self.time:.2f} s and ends at {motion.begin:.2f} s"
            advice = "Let the window end later, ask for less time, or do less before"
            if hidden:  # then what is done before does not matter
                why, advice = hidden, "Let the window end later, or ask for less time"
            raise Refused(
                Status.OUT_OF_WINDOW,
                f"it can end at {end:.2f} s at the earliest, {end - latest:.2f} s after its window: {why}. "
                f"{advice}",
            )

    def result(self) -> TimelinePlan:
        """The plan of all that was done, with its proof."""
        failed = next((one for one in self.activities if not one.ok), None)
        trajectory = certificate = None
        status, message = Status.OK, ""
        if self.parts:
            begun = clock.monotonic()
            trajectory = curves.joined(self.parts)
            certificate = proving.merged(self.proofs)
            self.seconds["proof"] += clock.monotonic() - begun
            if not certificate.certified:
                status, message = Status.UNCERTIFIED, "; ".join(certificate.faults)
        if failed is not None:
            told = f"activity {failed.name}: {failed.message}"
            status, message = failed.status, "; ".join(filter(None, (told, message)))
        return TimelinePlan(
            timeline=self.timeline,
            status=status,
            message=message,
            activities=tuple(self.activities),
            segments=tuple(self.segments),
            trajectory=trajectory,
            certificate=certificate,
            choices=tuple(self.choices),
            timings=dict(self.seconds),
        )
