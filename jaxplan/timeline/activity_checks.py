"""Checks of a planned activity: it must end within its window, and its devices must point well enough."""

import numpy as np

from jaxplan.model.activities import Activity
from jaxplan.model.status import Status
from jaxplan.timeline.activity_times import LEAST_LENGTH, Refused
from jaxplan.timeline.motions import Doing, Motion

_TIME_TOLERANCE = 1e-9  # s, by which a time may be late


def expect_in_time(doing: Doing, motion: Motion, since: float) -> None:
    """Raise `Refused` if an activity ends after its window, or would begin after its latest end.

    Args:
        doing: the activity that is being planned.
        motion: its motion, which says when it begins.
        since: s, when the slew to it begins, for the message.
    """
    activity = doing.activity
    end, latest = doing.ends(motion.begin), activity.latest
    lasting = activity.duration is None and activity.kind != "point"
    if lasting and doing.latest_end is not None and not doing.lasts(motion.begin):
        late = motion.begin - doing.latest_end
        when = f", {late:.2f} s after its end" if late > LEAST_LENGTH else ", when it has to end"
        raise Refused(Status.OUT_OF_WINDOW, f"it can begin at {motion.begin:.2f} s at the earliest{when}")
    if latest is not None and end > latest + _TIME_TOLERANCE:
        hidden = doing.seen_at_last(motion.begin)
        why = f"its slew begins at {since:.2f} s and ends at {motion.begin:.2f} s"
        advice = "Let the window end later, ask for less time, or do less before"
        if hidden:  # then what is done before does not matter
            why, advice = hidden, "Let the window end later, or ask for less time"
        raise Refused(
            Status.OUT_OF_WINDOW,
            f"it can end at {end:.2f} s at the earliest, {end - latest:.2f} s after its window: {why}. "
            f"{advice}",
        )


def expect_near(activity: Activity, error: float | None) -> None:
    """Raise `Refused` if an activity that tracks has a larger pointing error than its tolerance.

    `error` is the angle, rad, within which devices are proved to point; None where nothing is tracked.
    """
    if error is None or activity.track is None or error <= float(activity.track.tolerance):
        return
    off, most = np.rad2deg([error, float(activity.track.tolerance)])
    raise Refused(
        Status.UNCERTIFIED,
        f"devices are proved to point within {off:.3g} deg, tolerance_deg = {most:g} is asked for: raise "
        "it, or choose a target that moves less fast",
    )
