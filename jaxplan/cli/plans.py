"""The commands on one plan: ``plan``, ``check``, ``plot``, ``report`` and ``export``."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxplan.cli.common import (
    DONE,
    MARK,
    NOT_CERTIFIED,
    code_of,
    command,
    complain,
    load,
    load_scene,
    print_result,
    save,
    say,
    try_folder_of,
    writable_folder,
)

if TYPE_CHECKING:
    from jaxplan.planner import Plan


def add_commands(commands: Any) -> None:
    """Tell the parser of them."""
    plan = command(commands, "plan", _plan, "plan a scenario", "Plan a scenario and certify it.")
    plan.add_argument(
        "scenario", metavar="SCENARIO", help="a scenario file, or case-1 to case-4 of the paper"
    )
    plan.add_argument("-o", "--out", metavar="DIR", help="write plan.json and figures there")
    plan.add_argument("--json", action="store_true", help="print a summary for machines")
    check = command(
        commands, "check", _check, "certify a plan file anew", "Prove a plan file's trajectory safe, anew."
    )
    plot = command(commands, "plot", _plot, "draw a plan file", "Draw the figures of a plan file.")
    report = command(
        commands,
        "report",
        _report,
        "write a page on a plan file",
        "Certify a plan file anew and write a self-contained HTML page on it.",
    )
    export = command(
        commands,
        "export",
        _export,
        "write a plan for other tools",
        "Certify a plan file anew and write its motion as another tool reads it.",
    )
    for each in (check, plot, report, export):
        each.add_argument("plan", metavar="PLAN", help="a plan.json, as jaxplan plan -o DIR writes it")
    check.add_argument("--json", action="store_true", help="print the certificate for machines")
    plot.add_argument("-o", "--out", metavar="DIR", help="where to; by default beside the plan")
    report.add_argument("-o", "--out", metavar="FILE", help="where to; by default beside the plan, as .html")
    report.add_argument("--force", action="store_true", help="replace a file that is there")
    export.add_argument(
        "--format", required=True, metavar="F", help="aem, ck (SPICE), stk, basilisk, csv or npz"
    )
    export.add_argument(
        "--epoch",
        metavar="UTC",
        help="of the start, such as 2026-01-01T00:00:00; that of the scene if absent",
    )
    export.add_argument("--step", type=float, default=0.1, metavar="S", help="seconds between samples (0.1)")
    export.add_argument("-o", "--out", metavar="PATH", help="where to; by default beside the plan")
    export.add_argument("--force", action="store_true", help="replace what an earlier export wrote there")


def _plan(options: argparse.Namespace) -> int:
    from jaxplan.planner import plan, save_plan

    scenario = load_scene(options.scenario)
    folder = None if options.out is None else writable_folder(options.out)
    result = plan(scenario, throw=False)
    print_result(result.summary() if options.json else result)
    if folder is not None:
        save_plan(result, folder / "plan.json")
        say(f"wrote {folder / 'plan.json'}")
        _draw(result, folder)
    return code_of(result.status)


def _check(options: argparse.Namespace) -> int:
    from jaxplan.planner import certify
    from jaxplan.planner.record import report_summary

    plan = load(options.plan)
    report = certify(plan)
    print_result(report_summary(report) if options.json else report)
    return DONE if report.certified else NOT_CERTIFIED


def _plot(options: argparse.Namespace) -> int:
    from jaxplan.planner import certify

    plan = load(options.plan)
    folder = writable_folder(str(Path(options.plan).parent) if options.out is None else options.out)
    if plan.ok:  # what figures call proved is proved anew
        plan = replace(plan, certificate=certify(plan))
    _draw(plan, folder)
    if plan.certificate is not None and plan.ok and not plan.certificate.certified:
        return complain(f"{options.plan}: its certificate, made anew, fails", NOT_CERTIFIED)
    return code_of(plan.status)


def _report(options: argparse.Namespace) -> int:
    from jaxplan.planner import certify
    from jaxplan.report import report_html

    plan = load(options.plan)
    path = Path(options.plan).with_suffix(".html") if options.out is None else options.out
    try_folder_of(path)
    say(f"wrote {report_html(plan, path, overwrite=options.force)}")
    if plan.ok and not certify(plan).certified:  # the page says why
        return complain(f"{options.plan}: its certificate, made anew, fails", NOT_CERTIFIED)
    return code_of(plan.status)


def _export(options: argparse.Namespace) -> int:
    from jaxplan.exporting import default_path, export

    plan = load(options.plan)
    path = default_path(options.plan, options.format) if options.out is None else options.out
    try_folder_of(path)
    written = export(
        plan, path, format=options.format, epoch=options.epoch, step_s=options.step, overwrite=options.force
    )
    say(f"wrote {written}")
    return DONE


def _draw(plan: "Plan", folder: Path) -> None:
    """Write every figure that a plan has to a folder, and remove those of an earlier plan that it has not."""
    from jaxplan import plotting

    drawn = []
    for name, figure in plotting.figures(plan):
        save(figure, folder / f"{name}.png")
        drawn.append(name)
    for name in sorted(set(plotting.FIGURE_NAMES) - set(drawn)):
        file = folder / f"{name}.png"
        if file.is_file() and MARK.encode() in file.read_bytes()[:200]:  # a picture of somebody else stays
            file.unlink()
            say(f"removed {file}, which was of an earlier plan")
