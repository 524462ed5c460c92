"""When an activity may be done: when it ends, until when things are known, and when its targets are seen.

Times are seconds of the timeline.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.model.activities import Activity
from jaxplan.model.goals import Targets
from jaxplan.model.hidden_spans import after_hidden
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status

LEAST_LENGTH = 1e-6
"""s; a motion that is not longer counts as an instant."""
_TIME_TOLERANCE = 1e-9  # s, by which a time may be late
_INSTANT_TOLERANCE = 1e-3  # s, between the end of a span and what begins because of it


class Refused(Exception):
    """Raised where an activity cannot be done; its arguments are a status and a message."""

    def __init__(self, status: Status, message: str) -> None:
        self.status, self.message = status, message
        super().__init__(message)


@dataclass(kw_only=True, eq=False)
class ActivityTimes:
    """An activity with what says when it may be done.

    Attributes:
        scene: spacecraft, zones and settings, in the timeline's times.
        activity: what is asked.
        latest_end: s, when an activity without a duration ends; None if nothing says so.
        known: s, until when positions of targets and zones are known.
    """

    scene: Scenario
    activity: Activity
    latest_end: float | None = None
    known: float = np.inf

    def ends(self, begin: float) -> float:
        """Return when the activity ends, s, if its motion begins at `begin`, s."""
        own = self.activity
        if own.kind == "point":
            return begin
        if own.duration is not None:
            return max(begin, own.earliest or 0.0) + own.duration
        assert self.latest_end is not None
        return max(self.latest_end, begin)

    def lasts(self, begin: float) -> bool:
        """Tell whether a motion from `begin`, s, to the end has a length; if not, it is an instant."""
        return self.ends(begin) - begin > LEAST_LENGTH

    @property
    def last_begin(self) -> float:
        """The latest time, s, at which the motion may begin, given until when things are known."""
        return self.known - (0.0 if self.activity.kind == "point" else self.activity.duration or 0.0)

    def expect_known(self, begin: float) -> None:
        """Raise `Refused` if the activity from `begin`, s, has a hidden target or outlasts the timeline."""
        if own_targets := self.activity.targets:
            self._expect_seen(own_targets, begin, self.ends(begin))
        latest = np.inf if self.activity.latest is None else self.activity.latest
        what, until = ("its window", latest) if latest < self.known else ("the timeline", self.known)
        end = self.ends(begin)
        if end - self.known > _TIME_TOLERANCE:  # slews that end later are not tried, so these are bounds
            raise Refused(
                Status.OUT_OF_WINDOW,
                f"it can begin at {begin:.2f} s at the earliest, and would end at least {end - until:.2f} s "
                f"after {what}, which ends at {until:.2f} s: let {what} end later, ask for less time, or do "
                "less before",
            )

    def _expect_seen(self, targets: Targets, begin: float, end: float) -> None:
        """Raise `Refused` if a target is hidden at some time from `begin` to `end`, s."""
        for name, path in zip(targets.names(self.scene.spacecraft), targets.paths, strict=True):
            for span in path.hidden:
                if span.start <= begin < span.end - _TIME_TOLERANCE or begin < span.start < end:
                    raise Refused(
                        Status.INVALID_GOAL,
                        f"{span.target}, the target of {name}, is hidden by {span.by} from "
                        f"{span.start:.2f} s to {span.end:.2f} s, and is asked for from {begin:.2f} s to "
                        f"{end:.2f} s",
                    )

    def seen_from(self, time: float) -> float:
        """Return the first begin, s, not before `time`, from which all targets are seen all along.

        An instant of pointing is not before its window. If targets are not seen again as far as is known, the
        result is `time`.
        """
        targets = self.activity.targets
        if targets is None:
            return time
        if self.activity.kind == "point":
            time = max(time, self.activity.earliest or 0.0)
        asked = time
        spans = [span for path in targets.paths for span in path.hidden]
        while True:
            begin = after_hidden(spans, time)
            if self.ends(begin) > self.known or (begin > time and begin >= self.known):
                return asked
            inside = [span for span in spans if begin < span.start < self.ends(begin)]
            if not inside:
                return begin
            time = max(span.end for span in inside)

    def seen_at_last(self, begin: float) -> str:
        """Return a phrase on the target that was hidden until just `begin`, s; empty if there is none."""
        targets = self.activity.targets
        for path in () if targets is None else targets.paths:
            for span in path.hidden:
                if abs(span.end - begin) <= _INSTANT_TOLERANCE:
                    return f"{span.target} is hidden by {span.by} until {span.end:.2f} s"
        return ""
