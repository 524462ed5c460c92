"""What is certain to be impossible in a timeline before any of it is planned.

A state that an activity holds may break limits, or zones that stand still; a target may lie in a zone of its
own device; and targets may be hidden for too much of the window in which they are to be tracked. Whatever
depends on what is done before, or on where zones are at some time, is left to planning.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jaxplan.model.activities import Activity, Timeline
from jaxplan.model.breaches import in_own_zone
from jaxplan.model.goals import Targets
from jaxplan.model.hidden_spans import Hidden, after_hidden
from jaxplan.model.scenario import Scenario
from jaxplan.planner.validity import breaches

_TIME_TOLERANCE = 1e-9  # s, by which rounding may let a target be hidden too soon


def foreseen(timeline: Timeline) -> tuple[str, ...]:
    """Return what activities ask for that can never be done.

    Args:
        timeline: in radians and seconds, as it was read.

    Returns:
        A phrase for each, which begins with the name of its activity; empty if nothing is certainly
        impossible.
    """
    still = _drop_moving_zones(timeline.scene)
    return tuple(
        f"{activity.name}: {phrase}"
        for activity in timeline.activities
        for phrase in _activity_impossibilities(activity, still, timeline.until)
    )


def _drop_moving_zones(scene: Scenario) -> Scenario:
    """Return the scene without moving zones and without groups that have a moving one."""
    groups = {zone.any_of for zone in scene.zones if zone.moves} - {None}
    kept: dict[str, Any] = {
        kind: tuple(zone for zone in getattr(scene, kind) if not zone.moves and zone.any_of not in groups)
        for kind in ("keep_out", "keep_in", "joint_bounds")
    }
    return replace(scene, **kept)


def _activity_impossibilities(activity: Activity, scene: Scenario, until: float | None) -> Iterator[str]:
    """Yield a phrase for each thing that an activity asks for in vain.

    `scene` has only zones that stand still; `until` is the end of the timeline, s, or None.
    """
    if activity.attitude is not None:
        state, rest = activity.attitude, np.zeros(len(activity.attitude.joints))
        yield from breaches(scene, state.attitude, state.joints, np.zeros(3), rest)
    if activity.targets is None:
        return
    if not activity.targets.moves:
        own = in_own_zone(scene.spacecraft, scene.cones, activity.targets, 0.0)
        yield from () if own is None else (own,)
    latest = until if activity.latest is None else activity.latest
    if latest is not None:
        yield from _never_seen_phrases(activity, activity.targets, scene, latest)


def _never_seen_phrases(
    activity: Activity, targets: Targets, scene: Scenario, latest: float
) -> Iterator[str]:
    """Yield a phrase for each target that is not seen for long enough by `latest`, s.

    If each of them is, but not all together, yield one phrase that says so.
    """
    opens = activity.earliest or 0.0
    lasts = None if activity.duration is None and activity.kind != "point" else activity.duration or 0.0
    how_long = "up to the end of" if lasts is None else f"for {lasts:g} s within" if lasts else "within"
    window = f"{how_long} its time, from {opens:.10g} s to {latest:.10g} s"
    pairs = list(zip(targets.names(scene.spacecraft), targets.paths, strict=True))
    alone = [(name, path) for name, path in pairs if not _has_visible_span(path.hidden, opens, lasts, latest)]
    for name, path in alone:
        by = " and ".join(dict.fromkeys(span.by for span in path.hidden if span.end > opens))
        yield f"{path.target}, the target of {name}, is not seen {window}: it is hidden by {by}"
    together = [span for _, path in pairs for span in path.hidden]
    if not alone and not _has_visible_span(together, opens, lasts, latest):
        yield f"its targets are not all seen together {window}"


def _has_visible_span(spans: Sequence[Hidden], opens: float, lasts: float | None, latest: float) -> bool:
    """Whether there is a time from `opens` to `latest`, s, that is free of all hidden spans for long enough.

    `lasts` is how long, s; None if the time must go on until `latest`, and may then begin at any time before.
    """
    time = opens
    while True:
        begin = after_hidden(spans, time)
        end = latest if lasts is None else begin + lasts
        if end > latest + _TIME_TOLERANCE or (lasts is None and not begin < latest):
            return False
        inside = [span.end for span in spans if begin < span.start < end - _TIME_TOLERANCE]
        if not inside:
            return True
        time = max(inside)
