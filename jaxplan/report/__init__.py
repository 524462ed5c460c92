"""A plan as a page for people: ``jp.report_html(plan, "slew.html")``.

The page is a single HTML file that needs no other: figures are inside it, it forbids browsers to load
anything, and no scripts run in it unless a viewer is asked for. It follows the reader's choice of light or
dark, and prints in light. `markup` makes HTML in which all text of a scenario is escaped, `tables` presents
what was asked and what was found, `day` makes the page on a timeline's plan, and this module the page on a
single manoeuvre: head, verdict, and the parts in the order of planning.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from jaxplan.certificate import Certificate
from jaxplan.model.status import STEPS, Status
from jaxplan.planner import Plan
from jaxplan.planner.proving import certify, check_margins
from jaxplan.report import tables
from jaxplan.report.day import day_page
from jaxplan.report.markup import (
    ALONG_ORBIT,
    Markup,
    degrees,
    document,
    facts,
    framed,
    number,
    section,
    tag,
    tiles,
)
from jaxplan.runtime.arguments import expect, file_path
from jaxplan.runtime.files import free_place, replacing_file
from jaxplan.schema import dump_scenario
from jaxplan.sky import Satellite
from jaxplan.timeline.record import TimelinePlan
from jaxplan.version import __version__
from jaxplan.viewing import view

__all__ = ["report_html"]


def report_html(
    plan: Plan | TimelinePlan,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    frequencies: Sequence[float] = (),
    viewer: bool = False,
    observer: Satellite | None = None,
) -> Path:
    """Write a self-contained HTML page on a plan.

    For a single manoeuvre it shows scenario, goal, path, trajectory, the certificate with every margin and
    peak, figures, computation times, and the scenario file to plan it again. The certificate is made anew for
    it. If the plan failed it says at which step and what to change. For a timeline's plan it shows
    activities, events and figures, with the certificate that the plan has.

    Args:
        plan: of any status, of a scenario or a timeline.
        path: the file. It is written as a whole or not at all; its folder is made if it is missing.
        overwrite: whether an existing file may be replaced. Plans, and files of scenarios and timelines, are
            never replaced.
        frequencies: Hz, at which the spectrum of a single manoeuvre's torque is listed and drawn; without any
            there is no spectrum.
        viewer: whether the page begins with an interactive view of the plan in space (`jaxplan.view`; extra
            ``view``). The page then runs scripts, and is 3 MB larger.
        observer: the spacecraft's orbit, one of `jaxplan.sky`, for figures in the local orbital frame and the
            ground track, where the plan has an epoch (extra ``orbit``); None to leave these out.

    Returns:
        The path of the file.

    Raises:
        TypeError: if plan, path or orbit have the wrong type.
        ValueError: if the path is empty or a folder, or a frequency is not positive; if the orbit is not
            known for the time of the plan; or if a viewer is wanted, but the extra is missing or the plan has
            no trajectory.
        FileExistsError: if there is a file at the path that may not be replaced, or a device or pipe.
    """
    if not isinstance(plan, TimelinePlan):
        expect("plan", plan, Plan, "jp.plan makes one of a scenario, jp.plan_timeline that of a timeline")
    file_path("path", path)
    target = free_place(path, overwrite=overwrite)
    shown = framed(view(plan).html, f"{plan.scenario.name} in space") if viewer else None
    if isinstance(plan, TimelinePlan):
        text = day_page(plan, shown, observer)
    else:
        text = page(plan, frequencies, shown, observer)
    with replacing_file(target) as fresh:
        fresh.write_text(text, encoding="utf-8")
    return target


_CAPTIONS = {
    "globe": "The sphere of directions, with zones and the ways of all boresights; what is behind is pale.",
    "sphere": "The same unfolded: inertial azimuth and elevation.",
    **ALONG_ORBIT,
    "spacecraft": "The spacecraft in its body axes: how devices are mounted, what they reach, and where they "
    "look at the start. Where on the platform they stand is not known, and lengths mean nothing.",
    "margins": "Margin of every device to every zone; the triangle is the bound that is proved.",
    "joint_map": "Yaw and pitch of every terminal, with its range and masks.",
    "angles": "Angles of the joints, with their limits.",
    "rates": "Angular velocity of the platform in body axes, and rates of the joints.",
    "accelerations": "Angular acceleration of the platform in body axes, and accelerations of the joints.",
    "torque": "What the actuators must give, in body axes or wheel by wheel, with their limits.",
    "spectrum": "Amplitude of the Fourier transform of the whole manoeuvre; the legend has the length of the "
    "vector, or the most that a wheel has, at the frequencies that were asked for.",
}


def page(
    plan: Plan,
    frequencies: Sequence[float] = (),
    viewer: Markup | None = None,
    observer: Satellite | None = None,
) -> str:
    """Make the HTML page on a single manoeuvre's plan of any status, which is certified anew for it.

    Args:
        plan: the plan.
        frequencies: Hz, see `report_html`.
        viewer: HTML of the viewer; None for none.
        observer: the spacecraft's orbit, see `report_html`.
    """
    there = plan.trajectory is not None and plan.goal is not None
    certificate = certify(plan) if there else None
    status, message = _verdict(plan, certificate)
    pictures = dict(_draw_figures(plan, frequencies, observer))
    colophon = (
        f"Made by jaxplan {__version__}. The certificate was made anew for this page, from the "
        "trajectory alone. Attitudes map body to inertial axes."
    )
    main = tag(
        "main",
        _header(plan, status, message, certificate),
        *([] if viewer is None else [section("space", "In space", viewer)]),
        *_page_sections(plan, certificate, pictures),
        tag("footer", tag("p", colophon)),
    )
    title = f"{plan.scenario.name} \N{EN DASH} {_status_words(status)}"
    return document(title, main, running=viewer is not None)


def _verdict(plan: Plan, certificate: Certificate | None) -> tuple[Status, str]:
    """Status and message to show: the plan's, unless it claims a certificate that fails when made anew.

    Args:
        plan: the plan.
        certificate: made anew; None if there is no trajectory.
    """
    if not plan.ok:
        return plan.status, plan.message
    if certificate is not None and certificate.certified:
        return Status.OK, ""
    found = "there is no trajectory" if certificate is None else "; ".join(certificate.faults)
    claim = "The plan calls itself certified, but its certificate, made anew, fails"
    return Status.UNCERTIFIED, f"{claim}: {found}"


def _status_words(status: Status) -> str:
    """Name of a status as words, such as "Node limit"; "Certified" for OK."""
    return "Certified" if status is Status.OK else status.name.replace("_", " ").capitalize()


def _page_sections(plan: Plan, certificate: Certificate | None, pictures: dict[str, Markup]) -> list[Markup]:
    """The sections of the page; those for steps that the plan did not reach are left out."""

    def shown(*names: str) -> list[Markup]:
        return [pictures[name] for name in names if name in pictures]

    craft = plan.scenario.spacecraft
    parts = [
        section("manoeuvre", "The manoeuvre", *shown("globe", "sphere", *ALONG_ORBIT)),
        section(
            "scenario",
            "Scenario",
            *shown("spacecraft"),
            tables.spacecraft_tables(craft),
            tables.zones_table(plan.scenario),
            tables.motion_table(plan),
            tables.tube_table(plan.scenario),
        ),
        section("goal", "Start and goal", tables.ends_tables(plan)),
    ]
    if plan.search is not None:
        parts.append(section("path", "Path", tables.path_table(plan)))
    if plan.trajectory is not None:
        figures = shown("angles", "rates", "accelerations", "torque", "spectrum")
        parts.append(section("trajectory", "Trajectory", tables.trajectory_table(plan), *figures))
    if certificate is not None:
        parts.append(
            section(
                "certificate", "Certificate", *_certificate_contents(plan, certificate), *shown("margins")
            )
        )
    if plan.timings:
        parts.append(section("timings", "Timings", tables.timings_table(plan)))
    intro = tag("p", "Saved as a file, ", tag("code", "jaxplan plan FILE"), " plans this again.")
    text = tag("pre", tag("code", dump_scenario(plan.scenario)))
    return [*parts, section("settings", "Scenario file", intro, text)]


def _certificate_contents(plan: Plan, certificate: Certificate) -> list[Markup]:
    """Contents of the section on the certificate: verdict, what could not be proved, peaks and margins."""
    margins = check_margins(plan)
    verdict = "holds at every instant" if certificate.certified else "does not hold"
    rows = [("Certificate", verdict), ("Instants evaluated", f"{certificate.evaluations:,}")]
    content = [facts(rows, "Proof"), tables.faults_list(certificate)]
    if certificate.peaks:
        content.append(tables.peaks_table(certificate, plan.scenario.usable))
    if margins:
        content.append(tables.margins_table(margins, plan))
    return content


def _header(plan: Plan, status: Status, message: str, certificate: Certificate | None) -> Markup:
    """Head of the page: title, verdict, how far the plan came, and the numbers that matter most."""
    certified = status is Status.OK
    text = f"{status.value[:1].upper()}{status.value[1:]}."
    if certified:
        text = "Every zone and every limit holds at every instant, not at samples alone."
    told = [tag("strong", _status_words(status)), tag("p", text)]
    for label, words in (("What happened", message), ("What to change", status.advice)):
        if words:
            told.append(tag("p", tag("b", f"{label}: "), words))
    return tag(
        "header",
        tag("p", "Attitude plan", class_="kicker"),
        tag("h1", plan.scenario.name),
        tag("div", *told, class_="verdict good" if certified else "verdict bad"),
        _steps_list(status),
        tiles(_key_numbers(plan, certificate)),
    )


def _steps_list(status: Status) -> Markup:
    """The steps of planning as an HTML list, each marked as done, failed or not reached."""
    ended, items = STEPS.index(status.step), []
    for place, step in enumerate(STEPS):
        look, word = ("done", "done") if place <= ended else ("left", "not reached")
        if place == ended and status is not Status.OK:
            look, word = "failed", "failed here"
        items.append(tag("li", tag("b", step), tag("span", word), class_=look))
    return tag("ol", *items, class_="steps")


def _key_numbers(plan: Plan, certificate: Certificate | None) -> list[tuple[str, str, str]]:
    """The most important numbers as (label, value, unit); those that the plan lacks are left out."""
    found = []
    if plan.goal is not None:
        found.append(("platform turns", degrees(plan.goal.slew_angle, 1), "deg"))
    if plan.path is not None:
        found.append(("path", number(plan.path.length, 1), "steps"))
    if plan.trajectory is not None:
        found.append(("duration", number(plan.trajectory.duration), "s"))
    if certificate is not None and certificate.min_margin is not None:
        found.append(("smallest margin", degrees(certificate.min_margin), "deg"))
    if certificate is not None and certificate.peaks:
        quantity, percent = tables.highest_peak(certificate, plan.scenario.spacecraft)
        found.append((f"of its limit: {quantity}", percent, "%"))
    return found


def _draw_figures(
    plan: Plan, frequencies: Sequence[float], observer: Satellite | None
) -> list[tuple[str, Markup]]:
    """Draw every figure of the plan; returns the name and the HTML of each.

    Args:
        plan: the plan.
        frequencies: Hz; without any there is no spectrum.
        observer: the spacecraft's orbit; None for no figures along it.
    """
    from jaxplan.plotting import inline_figures  # imported here, since it needs matplotlib

    found = []
    for name, address in inline_figures(plan, frequencies, observer=observer):
        caption = _CAPTIONS.get(name, name)
        image = tag("img", src=address, alt=caption)
        found.append((name, tag("figure", image, tag("figcaption", caption), id=f"figure-{name}")))
    return found
