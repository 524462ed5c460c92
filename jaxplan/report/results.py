"""What was found: path, trajectory, and what the certificate proves of it, quantity by quantity.

Peaks are upper bounds and margins lower bounds over all time, from the proof and not from samples. Degrees
and seconds.
"""

from typing import TYPE_CHECKING

import numpy as np

from jaxplan.model.limits import limits
from jaxplan.report.markup import (
    NONE,
    Column,
    Markup,
    Row,
    facts,
    join,
    number,
    numeric,
    share,
    table,
    tag,
)
from jaxplan.report.scene import kind_of
from jaxplan.trajectory import excess

if TYPE_CHECKING:
    from jaxplan.certificate import ProvedMargin, Report
    from jaxplan.model.spacecraft import Spacecraft
    from jaxplan.planner import Plan

_STEP_NAMES = {
    "decompose": "goal",
    "search": "path",
    "trajectory": "trajectory",
    "certificate": "certificate",
    "compile": "compiling",
    "total": "in all",
}


def path_table(plan: "Plan") -> Markup:
    """How the search went, and the path if there is one."""
    assert plan.search is not None
    settings = plan.scenario.search
    rows = [
        ("Planner", f"{settings.method}, seed {settings.seed}"),
        ("Expansions", f"{plan.search.expansions} of at most {settings.max_expansions}"),
    ]
    if plan.path is not None:
        edges = plan.path.edges
        rows += [
            ("Length", f"{number(plan.path.length)} steps"),
            ("Edges", str(edges)),
            ("Interior nodes", str(max(edges - 1, 0))),
        ]
    return facts(rows, "How it was found")


def trajectory_table(plan: "Plan") -> Markup:
    """Method, duration and smoothness."""
    trajectory, bound = plan.trajectory, plan.duration_bound
    assert trajectory is not None
    asked = plan.scenario.trajectory.duration
    rows = [
        ("Method", trajectory.method),
        ("Duration", f"{number(trajectory.duration, 3)} s"),
        ("Asked for", f'"{asked}"' if isinstance(asked, str) else f"{asked:g} s"),
    ]
    if bound is not None:
        above = excess(trajectory.duration, bound)
        there = " to this goal" if plan.goal_chosen else ""
        rows.append((f"No motion{there} is quicker than", f"{number(bound, 3)} s"))
        if above is not None:
            rows.append(("Above that", f"{share(above)} %"))
    rows.append(("Continuous derivatives", str(trajectory.smoothness)))
    if plan.ok and plan.message:
        rows.append(("Note", plan.message))
    return facts(rows, "Method and duration")


def highest_peak(report: "Report", craft: "Spacecraft") -> tuple[str, str]:
    """The quantity that comes closest to its limit, and its share of that in percent."""
    name = max(report.peaks, key=lambda name: report.peaks[name])
    return _limited(name, craft)[0].lower(), share(report.peaks[name])


def peaks_table(report: "Report", craft: "Spacecraft") -> Markup:
    """Peaks beside their limits."""
    columns = [
        Column("Quantity"),
        numeric("Largest, at most"),
        numeric("Limit"),
        Column("Unit"),
        numeric("Share", "%"),
        Column(""),
        numeric("At", "s"),
    ]
    rows = []
    for name, peak in report.peaks.items():
        label, unit, limits = _limited(name, craft)
        same = len(limits) > 0 and np.ptp(limits) <= 1e-12 * np.max(limits)
        rows.append(
            [
                label,
                number(peak * float(limits[0]), 3) if same else NONE,
                f"{number(float(limits[0]), 3)}" if same else _range(limits),
                unit,
                share(peak),
                _bar(peak),
                number(report.peak_times.get(name)),
            ]
        )
    return table(columns, rows, "Peaks over all time, as proved")


def _range(limits: np.ndarray) -> str:
    if not len(limits):
        return NONE
    return f"{number(float(np.min(limits)), 3)} to {number(float(np.max(limits)), 3)}"


def _limited(name: str, craft: "Spacecraft") -> tuple[str, str, np.ndarray]:
    """Of a peak in the report: its label, its unit, and the limits of its components in that unit."""
    for limit in limits(craft):
        if limit.quantity.name == name:
            return limit.quantity.label, limit.quantity.printed_unit, limit.quantity.in_unit(limit.bound)
    return name.replace("_", " "), "", np.zeros(0)


def _bar(peak: float) -> Markup:
    """A share of one as a line; beyond one it is full, and of another colour."""
    beyond = not peak <= 1 + 1e-9
    width = 100 if beyond else 100 * peak
    return tag(
        "span",
        tag("span", class_="fill over" if beyond else "fill", style=f"width:{width:.1f}%"),
        class_="bar",
        aria_hidden="true",
    )


def margins_table(margins: tuple["ProvedMargin", ...], plan: "Plan") -> Markup:
    """Margins by zone and device, the smallest first."""
    zones = {zone.name: zone for zone in plan.scenario.zones}
    columns = [
        Column("Zone"),
        Column("Kind"),
        Column("Device"),
        numeric("Margin, at least", "deg"),
        numeric("Smallest at", "s"),
    ]
    rows: list[Row] = [
        [
            margin.zone if len(margin.zones) == 1 else f"{margin.zone} of {', '.join(margin.zones)}",
            kind_of(zones[margin.zone]),
            margin.device,
            number(float(np.rad2deg(margin.bound)), 3),
            number(margin.time),
        ]
        for margin in sorted(margins, key=lambda margin: margin.bound)
    ]
    return table(columns, rows, "Margins over all time, as proved", marked=0)


def faults_list(report: "Report") -> Markup:
    """What the certificate does not hold for; nothing if all is well."""
    if not report.faults:
        return join(())
    return tag("ul", *(tag("li", fault) for fault in report.faults), class_="faults")


def timings_table(plan: "Plan") -> Markup:
    """Seconds by step."""
    rows = [[_STEP_NAMES.get(name, name), number(seconds, 3)] for name, seconds in plan.timings.items()]
    return table([Column("Step"), numeric("Time", "s")], rows, "Time spent planning")
