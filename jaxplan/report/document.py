"""The page as a whole: head, verdict, and the parts in the order of planning."""

from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from jaxplan.model.status import STEPS, Status
from jaxplan.planner.proof import certify, check_margins
from jaxplan.report import tables
from jaxplan.report.markup import Markup, facts, join, number, section, tag
from jaxplan.schema import dump_scenario
from jaxplan.version import __version__

if TYPE_CHECKING:
    from jaxplan.certificate import Certificate
    from jaxplan.planner import Plan

# What a browser may load: pictures and looks that are in the page itself.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"

_CAPTIONS = {
    "globe": "The sphere of directions, with zones and the ways of all boresights; what is behind is pale.",
    "sphere": "The same unfolded: inertial azimuth and elevation.",
    "margins": "Margin of every device to every zone; the triangle is the bound that is proved.",
    "angles": "Angles of the joints, with their limits.",
    "rates": "Angular velocity of the platform in body axes, and rates of the joints.",
    "accelerations": "Angular acceleration of the platform in body axes, and accelerations of the joints.",
    "torque": "What the actuators must give, in body axes, with their limits.",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """What stands at the top.

    Attributes:
        word: in short.
        text: in a sentence.
        certified: whether all is proved.
        step: where it ended, one of `STEPS`.
        message: what happened; empty if all is well.
        advice: what to change; likewise.
    """

    word: str
    text: str
    certified: bool
    step: str
    message: str = ""
    advice: str = ""

    @classmethod
    def of(cls, plan: "Plan", report: "Certificate | None") -> Self:
        """Of a plan, with the certificate made anew; a plan that says it is well but is not is found out."""
        if plan.ok and report is not None and report.certified:
            text = "Every zone and every limit holds at every instant, not at samples alone."
            return cls(word="Certified", text=text, certified=True, step=plan.status.step)
        status, message = plan.status, plan.message
        if plan.ok:
            status = Status.UNCERTIFIED
            found = "; ".join(report.faults) if report is not None else "there is no trajectory"
            message = f"The plan calls itself certified, but its certificate, made anew, fails: {found}"
        return cls(
            word=status.name.replace("_", " ").capitalize(),
            text=f"{status.value[:1].upper()}{status.value[1:]}.",
            certified=False,
            step=status.step,
            message=message,
            advice=status.advice,
        )


def page(plan: "Plan") -> str:
    """The page on a plan of any status, see `jaxplan.report.report_html`."""
    there = plan.trajectory is not None and plan.goal is not None
    report = certify(plan) if there else None
    verdict = Verdict.of(plan, report)
    pictures = dict(_pictures(plan))
    main = tag(
        "main",
        _header(plan, verdict, report),
        *_parts(plan, report, pictures),
        tag("footer", _colophon(plan)),
    )
    style = Markup(files("jaxplan.report").joinpath("page.css").read_text(encoding="utf-8"))
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name_="color-scheme", content="light dark"),
        tag("title", f"{plan.scenario.name} \N{EN DASH} {verdict.word}"),
        tag("style", style),
    )
    return f"<!DOCTYPE html>\n{tag('html', head, tag('body', main), lang='en')}\n"


def _parts(plan: "Plan", report: "Certificate | None", pictures: dict[str, Markup]) -> list[Markup]:
    """The sections, as far as the plan came."""

    def shown(*names: str) -> list[Markup]:
        return [pictures[name] for name in names if name in pictures]

    craft = plan.scenario.spacecraft
    parts = [
        section("manoeuvre", "The manoeuvre", *shown("globe", "sphere")),
        section(
            "scenario",
            "Scenario",
            tables.spacecraft_tables(craft),
            tables.zones_table(plan.scenario),
            tables.motion_table(plan),
        ),
        section("goal", "Start and goal", tables.ends_tables(plan)),
    ]
    if plan.search is not None:
        parts.append(section("path", "Path", tables.path_table(plan)))
    if plan.trajectory is not None:
        figures = shown("angles", "rates", "accelerations", "torque")
        parts.append(section("trajectory", "Trajectory", tables.trajectory_table(plan), *figures))
    if report is not None:
        parts.append(section("certificate", "Certificate", *_certificate(plan, report), *shown("margins")))
    if plan.timings:
        parts.append(section("timings", "Timings", tables.timings_table(plan)))
    intro = tag("p", "Saved as a file, ", tag("code", "jaxplan plan FILE"), " plans this again.")
    text = tag("pre", tag("code", dump_scenario(plan.scenario)))
    return [*parts, section("settings", "Scenario file", intro, text)]


def _certificate(plan: "Plan", report: "Certificate") -> list[Markup]:
    margins = check_margins(plan)
    verdict = "holds at every instant" if report.certified else "does not hold"
    rows = [("Certificate", verdict), ("Instants evaluated", f"{report.evaluations:,}")]
    content = [facts(rows, "Proof"), tables.faults_list(report)]
    if report.peaks:
        content.append(tables.peaks_table(report, plan.scenario.spacecraft))
    if margins:
        content.append(tables.margins_table(margins, plan))
    return content


def _header(plan: "Plan", verdict: Verdict, report: "Certificate | None") -> Markup:
    """Title, verdict, how far it came, and the numbers that matter most."""
    look = "verdict good" if verdict.certified else "verdict bad"
    told: list[Any] = [tag("strong", verdict.word), tag("p", verdict.text)]
    for label, text in (("What happened", verdict.message), ("What to change", verdict.advice)):
        if text:
            told.append(tag("p", tag("b", f"{label}: "), text))
    return tag(
        "header",
        tag("p", "Attitude plan", class_="kicker"),
        tag("h1", plan.scenario.name),
        tag("div", *told, class_=look),
        _steps(verdict),
        tag("dl", *(_tile(*tile) for tile in _numbers(plan, report)), class_="tiles"),
    )


def _steps(verdict: Verdict) -> Markup:
    """The steps of planning: done, where it ended, and not reached."""
    ended = STEPS.index(verdict.step)
    items = []
    for place, step in enumerate(STEPS):
        failed = place == ended and not verdict.certified
        look = "failed" if failed else "done" if place <= ended else "left"
        word = {"failed": "failed here", "done": "done", "left": "not reached"}[look]
        items.append(tag("li", tag("b", step), tag("span", word), class_=look))
    return tag("ol", *items, class_="steps")


def _numbers(plan: "Plan", report: "Certificate | None") -> list[tuple[str, str, str]]:
    """(label, number, unit) of what matters most."""
    found = []
    if plan.goal is not None:
        found.append(("platform turns", number(float(np.rad2deg(plan.goal.slew_angle)), 1), "deg"))
    if plan.path is not None:
        found.append(("path", number(plan.path.length, 1), "steps"))
    if plan.trajectory is not None:
        found.append(("duration", number(plan.trajectory.duration), "s"))
    if report is not None and report.min_margin is not None:
        found.append(("smallest margin", number(float(np.rad2deg(report.min_margin))), "deg"))
    if report is not None and report.peaks:
        quantity, percent = tables.highest_peak(report, plan.scenario.spacecraft)
        found.append((f"of its limit: {quantity}", percent, "%"))
    return found


def _tile(label: str, value: str, unit: str) -> Markup:
    return tag("div", tag("dt", label), tag("dd", value, " ", tag("span", unit, class_="unit")))


def _pictures(plan: "Plan") -> list[tuple[str, Markup]]:
    """Every figure of the plan by its name, inside the page."""
    from jaxplan.plotting import inline_figures  # only here: the rest does without matplotlib

    found = []
    for name, address in inline_figures(plan):
        caption = _CAPTIONS.get(name, name)
        image = tag("img", src=address, alt=caption)
        found.append((name, tag("figure", image, tag("figcaption", caption), id=f"figure-{name}")))
    return found


def _colophon(plan: "Plan") -> Markup:
    return join(
        [
            tag(
                "p",
                f"Made by jaxplan {__version__}. The certificate was made anew for this page, from the "
                "trajectory alone. Attitudes map body to inertial axes.",
            )
        ]
    )
