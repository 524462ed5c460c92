"""A timeline's plan as tables for spreadsheets: activities, segments, interruptions and events.

Tables are comma-separated text in UTF-8 with a line of names first. Times are seconds from the timeline's
start on, and UTC to the millisecond where the scene has an epoch; values that do not exist are empty.
"""

import csv
import io
from collections.abc import Iterable, Sequence

import numpy as np

from jaxplan.model.epochs import utc_stamps
from jaxplan.timeline.events import events
from jaxplan.timeline.listing import event_rows
from jaxplan.timeline.record import TimelinePlan


def activities_csv(plan: TimelinePlan) -> str:
    """Return a table with a row for each activity: what became of it, when, and how well devices point.

    Args:
        plan: plan of a timeline, also one that failed.
    """
    utc = _utc_texts(plan, [time for one in plan.activities for time in (one.start, one.end)])
    rows = [
        (
            one.name,
            one.kind,
            one.status.name,
            one.start,
            one.end,
            utc[one.start],
            utc[one.end],
            one.slew,
            None if one.pointing_error is None else float(np.rad2deg(one.pointing_error)),
            one.message,
        )
        for one in plan.activities
    ]
    names = "name kind status start_s end_s start_utc end_utc slew_s pointing_error_deg message"
    return _csv_text(names.split(), rows)


def segments_csv(plan: TimelinePlan) -> str:
    """Return a table with a row for each segment: slews, and what activities do.

    Args:
        plan: plan of a timeline, also one that failed.
    """
    utc = _utc_texts(plan, [time for one in plan.segments for time in (one.start, one.end)])
    rows = [(one.name, one.kind, one.start, one.end, utc[one.start], utc[one.end]) for one in plan.segments]
    return _csv_text(["name", "kind", "start_s", "end_s", "start_utc", "end_utc"], rows)


def interruptions_csv(plan: TimelinePlan) -> str:
    """Return a table with a row for each time in which a slew keeps a device from an unchanged target.

    Args:
        plan: plan of a timeline, also one that failed.
    """
    found = plan.interruptions
    utc = _utc_texts(plan, [time for one in found for time in (one.start, one.end)])
    rows = [
        (
            one.device,
            one.before,
            one.after,
            one.start,
            one.end,
            utc[one.start],
            utc[one.end],
            one.duration,
            float(np.rad2deg(one.off)),
        )
        for one in found
    ]
    names = "device before after start_s end_s start_utc end_utc duration_s off_deg"
    return _csv_text(names.split(), rows)


def events_csv(plan: TimelinePlan) -> str:
    """Return a table with a row for each event, see `events`.

    Args:
        plan: plan of a timeline, also one that failed.
    """
    names, *rows = event_rows(events(plan), plan.scene.epoch)
    return _csv_text(names, rows)


def _utc_texts(plan: TimelinePlan, times: Iterable[float | None]) -> dict[float | None, str]:
    """Return UTC texts of times, s, as a dict by time; texts are empty for None and without an epoch."""
    known = [time for time in times if time is not None]
    epoch = plan.scene.epoch
    if epoch is None:
        return dict.fromkeys([None, *known], "")
    return {None: ""} | dict(zip(known, utc_stamps(epoch, known), strict=True))


def _csv_text(names: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows as comma-separated text below a line of names."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return file.getvalue()
