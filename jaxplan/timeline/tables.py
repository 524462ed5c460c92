"""A timeline's plan as rows of text, and as tables for spreadsheets: activities, segments, events and so on.

Tables are comma-separated text in UTF-8 with a line of names first. Times are seconds from the timeline's
start on, and UTC to the millisecond where the scene has an epoch; values that do not exist are empty.
"""

import csv
import io
from collections.abc import Iterable, Sequence

import numpy as np

from jaxplan.model.epochs import utc_stamps
from jaxplan.timeline.events import Event, events
from jaxplan.timeline.record import TimelinePlan

NONE = "\N{EN DASH}"
"""What stands where nothing is known."""


def clock(plan: TimelinePlan) -> str:
    """Return what the texts of `stamps` show: "UTC", with the date if the whole plan is on one, or "s"."""
    epoch = plan.timeline.scene.epoch
    if epoch is None:
        return "s"
    date = _single_date(plan)
    return "UTC" if date is None else f"UTC, {date}"


def _single_date(plan: TimelinePlan) -> str | None:
    """Return the UTC date of a plan if all of it is on one date; else, and without an epoch, None."""
    epoch = plan.timeline.scene.epoch
    if epoch is None:
        return None
    end = 0.0 if plan.trajectory is None else plan.trajectory.duration
    first, last = (stamp[:10] for stamp in utc_stamps(epoch, [0.0, end]))
    return first if first == last else None


def stamps(plan: TimelinePlan, times: Iterable[float | None]) -> list[str]:
    """Return texts of times given in s: UTC or seconds, as `clock` says; a dash for None."""
    given = list(times)
    known = [time for time in given if time is not None]
    epoch, cut = plan.timeline.scene.epoch, 0 if _single_date(plan) is None else len("2026-06-20 ")
    if epoch is None:
        texts = iter([f"{time:.2f}" for time in known])
    else:
        texts = iter([stamp.replace("T", " ")[cut:] for stamp in utc_stamps(epoch, known)])
    return [NONE if time is None else next(texts) for time in given]


def activity_rows(plan: TimelinePlan, *, messages: bool = True) -> list[list[str]]:
    """Return rows of a table with what became of each activity; the first row is the head.

    Columns are name, kind, start, end, duration of the slew in s, largest pointing error in deg, and status.
    The message is a last column if any activity has one.

    Args:
        plan: plan of a timeline.
        messages: False to leave out the column of messages.

    Example:
        >>> as_table("Plan of a day", plan.rows(), activity_rows(plan, messages=False))
    """
    told = messages and any(one.message for one in plan.activities)
    starts = stamps(plan, [one.start for one in plan.activities])
    ends = stamps(plan, [one.end for one in plan.activities])
    rows = []
    for one, start, end in zip(plan.activities, starts, ends, strict=True):
        slew = NONE if one.slew is None else f"{one.slew:.2f}"
        error = NONE if one.pointing_error is None else f"{np.rad2deg(one.pointing_error):.1e}"
        row = [one.name, one.kind, start, end, slew, error, one.status.name]
        rows.append([*row, one.message] if told else row)
    when = clock(plan)
    head = ["activity", "kind", f"start, {when}", f"end, {when}", "slew, s", "error, deg", "status"]
    return [[*head, "message"] if told else head, *rows]


def event_rows(found: Iterable[Event], epoch: np.datetime64 | None = None) -> list[list[str]]:
    """Return rows of a CSV file of events; the first row is the head.

    Args:
        found: the events, from `events`.
        epoch: UTC of the timeline's start; None leaves out the column of UTC.

    Example:
        >>> with open("events.csv", "w", newline="") as file:
        ...     csv.writer(file).writerows(event_rows(events(plan), plan.scenario.epoch))
    """
    every = list(found)
    rows = [[f"{event.time:.6f}", event.kind, event.what, event.text] for event in every]
    head = ["time_s", "kind", "what", "text"]
    if epoch is not None:
        stamps = utc_stamps(epoch, [event.time for event in every])
        rows = [[row[0], stamp, *row[1:]] for row, stamp in zip(rows, stamps, strict=True)]
        head.insert(1, "utc")
    return [head, *rows]


def events_table(found: Iterable[Event], epoch: np.datetime64 | None = None) -> str:
    """Return events as a table of text, one line each below a head; arguments as of `event_rows`."""
    lines: list[str] = []
    for row in event_rows(found, epoch):
        time, *others = row
        cells = [f"{time if not lines else f'{float(time):.3f}':>12}"]
        if epoch is not None:
            cells.append(f"{others.pop(0):<23}")
        lines.append("  ".join([*cells, f"{others[0]:<15}", others[-1]]))
    return "\n".join(lines)


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
