"""The page on a timeline's plan: summary, activities, events, figures and certificate."""

import numpy as np

from jaxplan.model.status import Status
from jaxplan.report import tables
from jaxplan.report.markup import (
    ALONG_ORBIT,
    Markup,
    degrees,
    document,
    facts,
    join,
    number,
    section,
    table,
    tag,
    tiles,
)
from jaxplan.sky import Satellite
from jaxplan.timeline.events import Event, events
from jaxplan.timeline.record import PlannedActivity, TimelinePlan
from jaxplan.timeline.tables import activity_rows, clock, stamps
from jaxplan.version import __version__

_CAPTIONS = {
    "timeline": "What is done when: a row for each device, with a bar while it follows a target, hatched "
    "where that is hidden; slews are grey. Below: smallest margin to each zone, pointing error and what is "
    "proved of it, the platform's angular velocity, angles of joints, and what wheels hold.",
    "globe": "The sphere of directions with the ways of all boresights over the day; zones are where they "
    "are at the start, and their fainter edges where they are at the end.",
    "sphere": "The same unfolded: inertial azimuth and elevation.",
    **ALONG_ORBIT,
    "spacecraft": "The spacecraft in its body axes: how devices are mounted, what they reach, and where they "
    "look at the start. Where on the platform they stand is not known, and lengths mean nothing.",
    "accelerations": "Angular acceleration of the platform in body axes, and accelerations of the joints.",
    "torque": "What the actuators must give, in body axes or wheel by wheel, with their limits.",
}
_MAX_EVENTS = 2000  # rows of the table of events at most


def day_page(plan: TimelinePlan, viewer: Markup | None = None, observer: Satellite | None = None) -> str:
    """Make the HTML page on a timeline's plan of any status.

    Args:
        plan: the plan.
        viewer: HTML of the viewer; None for none.
        observer: the spacecraft's orbit, see `report_html`; None for no figures along it.
    """
    found, pictures = events(plan), dict(_draw_figures(plan, observer))
    colophon = (
        f"Made by jaxplan {__version__}. The certificate is the one of the plan, from its trajectory alone. "
        "Attitudes map body to inertial axes."
    )
    main = tag(
        "main",
        _header(plan),
        *([] if viewer is None else [section("space", "In space", viewer)]),
        *_page_sections(plan, found, pictures),
        tag("footer", tag("p", colophon)),
    )
    title = f"{plan.timeline.name} \N{EN DASH} {_status_words(plan.status)}"
    return document(title, main, running=viewer is not None)


def _status_words(status: Status) -> str:
    """Name of a status as words, such as "Goal unreachable"; "Certified" for OK."""
    return "Certified" if status is Status.OK else status.name.replace("_", " ").capitalize()


def _header(plan: TimelinePlan) -> Markup:
    """Head of the page: title, verdict, and the numbers that matter most."""
    text = f"{plan.status.value[:1].upper()}{plan.status.value[1:]}."
    if plan.ok:
        text = "Every zone and every limit holds at every instant, and every device follows its target."
    told = [tag("strong", _status_words(plan.status)), tag("p", text)]
    for label, words in (("What happened", plan.message), ("What to change", plan.advice)):
        if words:
            told.append(tag("p", tag("b", f"{label}: "), words))
    return tag(
        "header",
        tag("p", "Plan of a timeline", class_="kicker"),
        tag("h1", plan.timeline.name),
        tag("div", *told, class_="verdict good" if plan.ok else "verdict bad"),
        tiles(_key_numbers(plan)),
    )


def _key_numbers(plan: TimelinePlan) -> list[tuple[str, str, str]]:
    """The most important numbers as (label, value, unit); those that the plan lacks are left out."""
    asked = {activity.name for activity in plan.timeline.activities}  # without the final rest
    done = sum(one.ok and one.name in asked for one in plan.activities)
    found = [("activities planned", f"{done} of {len(asked)}", "")]
    if plan.trajectory is not None:
        found.append(("duration, h:min:s", duration_text(plan.trajectory.duration), ""))
        rests = f" ({plan.slews_to_rests} to rests)" * (plan.slews_to_rests > 0)
        slewing = sum(one.end - one.start for one in plan.slews)
        found.append((f"in {len(plan.slews)} slews{rests}, h:min:s", duration_text(slewing), ""))
    if plan.pointing_error is not None:
        found.append(("pointing, within", degrees_text(plan.pointing_error), "deg"))
    certificate = plan.certificate
    if certificate is not None and certificate.min_margin is not None:
        found.append(("smallest margin", degrees(certificate.min_margin), "deg"))
    if certificate is not None and certificate.peaks:
        quantity, percent = tables.highest_peak(certificate, plan.timeline.scene.spacecraft)
        found.append((f"of its limit: {quantity}", percent, "%"))
    return found


def duration_text(seconds: float) -> str:
    """Text of a duration in s as hours, minutes and seconds, rounded, as in "1:02:03"."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def degrees_text(angle: float) -> str:
    """Text of a small angle (rad) in degrees, with two significant digits."""
    return f"{float(np.rad2deg(angle)):.2g}"


def _page_sections(plan: TimelinePlan, found: tuple[Event, ...], pictures: dict[str, Markup]) -> list[Markup]:
    """The sections of the page; those for what the plan does not have are left out."""

    def shown(*names: str) -> list[Markup]:
        return [pictures[name] for name in names if name in pictures]

    scene = plan.timeline.scene
    parts = [
        section("day", "The day", *shown("timeline")),
        section("activities", "Activities", activities_table(plan)),
    ]
    if found:
        parts.append(section("events", "Events", events_listed(plan, found)))
    if plan.trajectory is not None:
        parts.append(
            section(
                "motion", "The motion", *shown("globe", "sphere", *ALONG_ORBIT, "accelerations", "torque")
            )
        )
    if plan.certificate is not None:
        parts.append(section("certificate", "Certificate", *_certificate_contents(plan)))
    setting = (
        *shown("spacecraft"),
        tables.spacecraft_tables(scene.spacecraft),
        tables.zones_table(scene),
        tables.tube_table(scene),
    )
    parts.append(section("scene", "Scene", *setting))
    if plan.timings:
        rows = [[name, number(seconds, 3)] for name, seconds in plan.timings.items()]
        timings = table(["Step", "Time|s"], rows, "Time spent planning")
        parts.append(section("timings", "Timings", timings))
    return parts


def activities_table(plan: TimelinePlan) -> Markup:
    """Table of the outcome of each activity, and a table of messages if there are any."""
    when, (_, *rows) = clock(plan), activity_rows(plan, messages=False)
    rows = [[*row[:-1], _outcome_words(one)] for row, one in zip(rows, plan.activities, strict=True)]
    titles = ["Activity", "Kind", "Start|", "End|", "Slew|s", "Error, at most|deg", "Status"]
    tried = {one.name for one in plan.activities}
    left = [one.name for one in plan.timeline.activities if one.name not in tried]
    rest = f"; not tried: {', '.join(left)}" if left else ""
    last = "; slews to rests on the way are not among these" * (plan.slews_to_rests > 0)
    caption = f"Activities, in the order in which they are done; times in {when}{last}{rest}"
    told = [[one.name, one.message] for one in plan.activities if one.message]
    messages = table(["Activity", "What is in the way, and what to change"], told, "Messages")
    return join([table(titles, rows, caption), *([messages] if told else [])])


def _outcome_words(one: PlannedActivity) -> str:
    """The outcome of an activity in words: "Planned", or its status."""
    return "Planned" if one.ok else _status_words(one.status)


def events_listed(plan: TimelinePlan, found: tuple[Event, ...]) -> Markup:
    """Table of the events, of which at most the first `_MAX_EVENTS` are shown."""
    kept = found[:_MAX_EVENTS]
    rows = [
        [stamp, event.text]
        for stamp, event in zip(stamps(plan, [event.time for event in kept]), kept, strict=True)
    ]
    more = "" if len(kept) == len(found) else f", the first {len(kept)} of {len(found)}"
    return table(["Time", "Event"], rows, f"What happens, in order of time{more}; times in {clock(plan)}")


def _certificate_contents(plan: TimelinePlan) -> list[Markup]:
    """Contents of the section on the certificate, which the plan must have."""
    proof, scene = plan.certificate, plan.timeline.scene
    assert proof is not None
    rows = [
        ("Certificate", "holds at every instant" if proof.certified else "does not hold"),
        ("Instants evaluated", f"{proof.evaluations:,}"),
    ]
    if proof.min_margin is not None and proof.worst_time is not None:
        when = stamps(plan, [proof.worst_time])[0]
        least = f"{degrees(proof.min_margin, 3)} deg, {proof.worst_device} to {proof.worst_zone}"
        rows.append(("Smallest margin, at least", f"{least} at {when} ({clock(plan)})"))
    content = [facts(rows, "Proof"), tables.faults_list(proof)]
    if proof.peaks:
        content.append(tables.peaks_table(proof, scene.usable))
    return content


def _draw_figures(plan: TimelinePlan, observer: Satellite | None) -> list[tuple[str, Markup]]:
    """Draw the figures of the page; returns the name and the HTML of each."""
    from jaxplan.plotting import inline_figures  # imported here, since it needs matplotlib

    found = []
    for name, address in inline_figures(plan, names=tuple(_CAPTIONS), observer=observer):
        caption = _CAPTIONS[name]
        image = tag("img", src=address, alt=caption)
        found.append((name, tag("figure", image, tag("figcaption", caption), id=f"figure-{name}")))
    return found
