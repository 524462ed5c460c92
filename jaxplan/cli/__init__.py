"""The command line: the arguments and help of all commands, and the exit codes that they end with.

Results go to stdout, messages and progress to stderr. Exit codes are 0 done, 1 no plan, 2 bad input, 3 not
certified. A command is the function of its name in `jaxplan.cli.scenes`, `plans`, `sky`, `timelines` or
`studies`. These modules are imported only when a command runs, so that ``--help`` answers at once.
"""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from jaxplan.cli.common import BAD_INPUT, DONE, Parser, complain, plain_warnings, report_refused_kernels
from jaxplan.cli.streams import Outlet, outlets
from jaxplan.runtime.garbage import end_without_collection, seldom_collected
from jaxplan.runtime.progress import seldom_lines
from jaxplan.version import __version__

DESCRIPTION = "Plan certified attitude manoeuvres of spacecraft with several pointing devices."
EXIT_CODES = "Exit codes: 0 done, 1 no plan, 2 bad input, 3 not certified."
FIRST_STEPS = """\
  jaxplan new scene.toml            write a scene to begin with, and change it
  jaxplan validate scene.toml       see whether all is right with it
  jaxplan plan scene.toml -o out    plan it: out/plan.json and figures"""

# Written out here, since importing the modules that define them takes a second, too long for ``--help``.
_KIND_NAMES = (
    "keep_out, keep_in, hard_keep_out, hard_keep_in, held_links, masks, beams, panels, carried, "
    "joint_bounds, grouped, moving, moved_goals, mixed, terminal_masks, fields or any_spacecraft"
)
_PLANNER_NAMES = "mha, mha-paper, wastar, rrt_star or rrt_connect"
_COMMAND_MODULES = {
    "new": "scenes",
    "validate": "scenes",
    "passes": "sky",
    "study": "studies",
    "table4": "studies",
    "timeline": "timelines",
}  # the other commands are in `plans`
_PLAN_HELP = "a plan.json, as jaxplan plan -o DIR writes it"
_ANY_PLAN_HELP = f"{_PLAN_HELP}, or a plan.npz of jaxplan timeline"
_SCENE_HELP = "a scenario file, or case-1 to case-4 of the paper"
_FORCE_HELP = "replace what is there, unless it is a plan or scene"
_TIMELINE_HELP = "a timeline's file, or case-day or case-imaging, which come with the package"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command of the command line; returns the exit code.

    Bad input, OS errors and Ctrl-C (exit code 130) are reported on stderr instead of raised. Where nobody
    reads the output any more, the work is done all the same.

    Args:
        arguments: what follows ``jaxplan`` on the command line; None for those of the process.
    """
    if arguments is None:  # then the process ends with this command
        end_without_collection()
    with outlets() as out:
        return _run(arguments, out)


def _run(arguments: Sequence[str] | None, out: Outlet) -> int:
    """Run a command, and report its errors; `out` is stdout. See `main`."""
    parser = _make_parser()
    options = parser.parse_args(arguments)
    try:
        with seldom_collected(), seldom_lines(), plain_warnings():
            code = _run_command(parser, options)
        out.flush()  # so that an error, such as a full disk, is still reported
        report_refused_kernels()
        return code
    except KeyboardInterrupt:
        return complain("interrupted", 130)
    except OSError as error:
        try:
            out.flush()
        except OSError:  # so that Python does not complain at exit, too
            out.drop()
        place = "" if error.filename is None else f"{os.fspath(error.filename)}: "
        return complain(f"{place}{error.strerror or error}", BAD_INPUT)
    except ValueError as error:  # ScenarioError and PlanFileError are subclasses
        return complain(str(error), BAD_INPUT)


def _run_command(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    """Run the command that was parsed, or print version or help; returns the exit code."""
    if options.command is not None:
        home = import_module(f"jaxplan.cli.{_COMMAND_MODULES.get(options.command, 'plans')}")
        return int(getattr(home, options.command)(options))
    if options.version:
        print(f"jaxplan {__version__}")
        return DONE
    parser.print_help(sys.stderr)
    return BAD_INPUT


def _make_parser() -> argparse.ArgumentParser:
    """Make the parser of the command line, with all commands."""
    parser = Parser(
        prog="jaxplan",
        description=DESCRIPTION,
        epilog=f"first steps:\n{FIRST_STEPS}\n\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    _add_scene_commands(commands)
    _add_plan_commands(commands)
    _add_timeline(commands)
    _add_study(commands)
    _add_table4(commands)
    return parser


def _parse_count(text: str) -> int:
    """Read a whole number of at least 1; a `type` for argparse, which reports the error for other texts."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a whole number, at least 1")
    return int(text)


def _parse_seconds(text: str) -> float:
    """Read a time in seconds, zero or more; a `type` for argparse, which reports other texts as errors."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0 <= seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: must be a number of seconds in [0, inf)")
    return seconds


def _parse_step(text: str) -> float | str:
    """Read seconds between samples; a text that is not a number, such as "sparsest", is returned as it is."""
    try:
        return float(text)
    except ValueError:
        return text  # the export refuses it unless it is "sparsest"


def _parse_frequency(text: str) -> float:
    """Read a frequency in Hz, above zero; a `type` for argparse, which reports the error for other texts."""
    try:
        frequency = float(text)
    except ValueError:
        frequency = math.nan
    if not 0 < frequency < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: must be a number of Hz in (0, inf)")
    return frequency


def _add_scene_commands(commands: Any) -> None:
    """Add the commands ``new``, ``validate`` and ``passes`` to the parser."""
    new = commands.add_parser(
        "new",
        help="write a scenario file to begin with",
        description=(
            "Write a scenario file that can be planned as it is, with a comment on every option; "
            "or that of a timeline. With --ask it is made of answers to questions about a spacecraft and a "
            "task, which may come from a file or a pipe, too."
        ),
    )
    new.add_argument("--ask", action="store_true", help="ask what you have, and write a scenario of that")
    new.add_argument("file", metavar="FILE", help="its name, such as scene.toml; - for stdout")
    new.add_argument(
        "--from",
        dest="source",
        metavar="CASE",
        help="copy a case of the paper instead, case-1 to case-4, or a timeline, case-day or case-imaging",
    )
    new.add_argument("--timeline", action="store_true", help="write a timeline's file instead")
    new.add_argument("--force", action="store_true", help="replace what is there, unless it is a plan")
    validate = commands.add_parser(
        "validate",
        help="say what is wrong with scenario files",
        description=(
            "Say what files of scenarios and timelines hold, or all that is wrong with them, "
            "and whether each start (and goal, where it is a given state) keeps the limits and zones. "
            "Nothing is planned."
        ),
    )
    validate.add_argument("files", nargs="+", metavar="SCENARIO", help=f"{_SCENE_HELP}; or {_TIMELINE_HELP}")
    validate.add_argument("--json", action="store_true", help="print what was found for machines")
    passes = commands.add_parser(
        "passes",
        help="say when targets can be seen",
        description=(
            "Say when the satellites and points of the ground in a file's [sky] can be seen, how high, how "
            "far away and how far off nadir: the windows of a timeline's activities."
        ),
    )
    passes.add_argument(
        "scene", metavar="FILE", help="of a scenario or timeline, or case-day or case-imaging"
    )
    passes.add_argument(
        "targets", nargs="*", default=[], metavar="TARGET", help="names in [sky]; all unless told"
    )
    passes.add_argument(
        "--for",
        dest="duration",
        type=float,
        metavar="S",
        help="seconds, for how long from epoch_utc on, up to 31 days (for_duration_s, else a day)",
    )
    passes.add_argument("--json", action="store_true", help="print them for machines")


def _add_plan_commands(commands: Any) -> None:
    """Add the commands that make or read a plan, from ``plan`` to ``export``, to the parser."""
    plan = commands.add_parser(
        "plan", help="plan a scenario", description=("Plan a scenario and certify it.")
    )
    plan.add_argument("scenario", metavar="SCENARIO", help=_SCENE_HELP)
    plan.add_argument("-o", "--out", metavar="DIR", help="write plan.json and figures there")
    plan.add_argument(
        "--improve-for",
        type=_parse_seconds,
        default=0.0,
        metavar="SECONDS",
        help='look so long for a shorter plan, where trajectory.duration_s is "minimum"',
    )
    plan.add_argument("--json", action="store_true", help="print a summary for machines")
    check = commands.add_parser(
        "check",
        help="certify a plan file anew, or a table of attitudes",
        description=(
            "Prove a plan file's trajectory safe, anew; or with --scenario what a table of attitudes "
            "(CCSDS AEM, SPICE C-kernel, STK, Basilisk, CSV, npz) keeps of a scene as its readers fly it."
        ),
    )
    plot = commands.add_parser(
        "plot",
        help="draw a plan file, or the spacecraft of a scenario",
        description=(
            "Draw the figures of a plan file; or of a scenario, before it is planned, the spacecraft with "
            "its axes, devices, ranges and masks in space."
        ),
    )
    report = commands.add_parser(
        "report",
        help="write a page on a plan file",
        description=("Certify a plan file anew and write a self-contained HTML page on it."),
    )
    export = commands.add_parser(
        "export",
        help="write a plan for other tools",
        description=("Certify a plan file anew and write its motion as another tool reads it."),
    )
    view = commands.add_parser(
        "view",
        help="write a page on which a plan turns in space",
        description=(
            "Write one HTML file, which needs no network, with the sphere, zones, spacecraft and beams in "
            "space, a clock to play, and margins, rates and joints beneath. Needs the extra view."
        ),
    )
    view.add_argument(
        "-o", "--out", metavar="FILE", help="where to; by default beside the plan, as .view.html"
    )
    view.add_argument("--force", action="store_true", help=_FORCE_HELP)
    for each in (check, report, view, export):
        each.add_argument("plan", metavar="PLAN", help=_ANY_PLAN_HELP)
    plot.add_argument("plan", metavar="FILE", help=f"{_ANY_PLAN_HELP}; or {_SCENE_HELP}")
    check.add_argument("--json", action="store_true", help="print the certificate for machines")
    check.add_argument(
        "--scenario", metavar="SCENARIO", help=f"take PLAN for a table and hold it against {_SCENE_HELP}"
    )
    check.add_argument(
        "--interpolation",
        metavar="WORD",
        help=(
            "between a table's rows: slerp, quaternion_linear, mrp_linear, constant_rate or hermite; "
            "what readers of the format do if absent"
        ),
    )
    for each in (check, export):
        each.add_argument(
            "--forgive-deg",
            type=float,
            metavar="DEG",
            help="by which margins of a table may fall short of zero (0.001)",
        )
        each.add_argument(
            "--forgive-percent",
            type=float,
            metavar="P",
            help="of a limit, by which a table may exceed it (0.5)",
        )
    plot.add_argument("-o", "--out", metavar="DIR", help="where to; by default beside the file")
    for each in (plot, report):
        each.add_argument(
            "--frequency",
            action="append",
            default=[],
            type=_parse_frequency,
            metavar="HZ",
            help="draw the spectrum of the plan's torque with a line there; may be repeated",
        )
        each.add_argument(
            "--observer",
            metavar="SCENE",
            help=(
                "a file whose [sky] has the spacecraft's orbit: draw attitude and sphere in the local "
                "orbital frame, too, and the ground track"
            ),
        )
    report.add_argument("-o", "--out", metavar="FILE", help="where to; by default beside the plan, as .html")
    report.add_argument("--force", action="store_true", help=_FORCE_HELP)
    report.add_argument("--view", action="store_true", help="with the plan in space, to turn and play")
    export.add_argument(
        "--format",
        metavar="F",
        help="aem, ck (SPICE), stk, czml, basilisk, csv or npz; c (C99) or json for the polynomials",
    )
    export.add_argument(
        "--epoch",
        metavar="UTC",
        help="of the start, such as 2026-01-01T00:00:00; that of the scene if absent",
    )
    export.add_argument(
        "--step",
        type=_parse_step,
        metavar="S",
        help="seconds between samples (0.1); or sparsest, for as few as will do",
    )
    export.add_argument(
        "--tolerance",
        type=float,
        metavar="DEG",
        help="in place of a step: samples so that linear interpolation is off by less",
    )
    for name, metavar, words in (
        ("object-name", "NAME", "of the spacecraft; that of the scene if absent"),
        ("object-id", "ID", "of the spacecraft, such as 2000-075A (UNKNOWN)"),
        ("originator", "NAME", "of the message (JAXPLAN)"),
        ("frame-name", "NAME", "of the body's frame (SC_BODY_1 in messages, JAXPLAN_BUS in kernels)"),
        ("reference-frame", "NAME", "of the inertial frame: EME2000 (the default), ICRF or GCRF"),
    ):
        export.add_argument(f"--{name}", metavar=metavar, help=words)
    export.add_argument("--naif-id", type=int, metavar="N", help="SPICE's number of the spacecraft (-999)")
    export.add_argument(
        "--observer", metavar="SCENE", help="of czml: a file whose [sky] has the spacecraft's orbit"
    )
    export.add_argument("-o", "--out", metavar="PATH", help="where to; by default beside the plan")
    export.add_argument("--force", action="store_true", help=_FORCE_HELP)


def _add_timeline(commands: Any) -> None:
    """Add the command ``timeline`` to the parser."""
    timeline = commands.add_parser(
        "timeline",
        help="plan the activities of a day",
        description=(
            "Plan the activities of a timeline, with the slews between them, as one certified motion."
        ),
    )
    timeline.add_argument("timeline", metavar="TIMELINE", help=_TIMELINE_HELP)
    timeline.add_argument(
        "-o",
        "--out",
        metavar="DIR",
        help="write plan.npz, timeline.toml, four tables (activities.csv and others) and figures there",
    )
    timeline.add_argument(
        "--go-on", action="store_true", help="plan the rest, too, where an activity cannot be done"
    )
    timeline.add_argument(
        "--export",
        nargs="+",
        action="extend",
        default=[],
        metavar="F",
        help="write the motion to DIR for other tools, too: aem, ck, stk, czml, basilisk, csv or npz",
    )
    timeline.add_argument("--json", action="store_true", help="print a summary for machines")


def _add_study(commands: Any) -> None:
    """Add the command ``study`` to the parser."""
    study = commands.add_parser(
        "study",
        help="plan many scenes, random ones or files of one's own, and say how it went",
        description=(
            "Plan many random scenes, or the scenario files of a folder, or report on studies made before. "
            "Where a study with --out was interrupted, the same command goes on."
        ),
    )
    study.add_argument(
        "scenes",
        nargs="?",
        metavar="FOLDER",
        help="whose scenario files (.toml) are planned, not random scenes",
    )
    study.add_argument("--kind", metavar="K", help=f"kind of the random scenes: {_KIND_NAMES} (keep_out)")
    study.add_argument("-n", type=_parse_count, metavar="N", help="number of scenes (100)")
    study.add_argument("--first-seed", type=int, metavar="SEED", help="seed of the first scene (0)")
    study.add_argument("--planner", metavar="P", help=f"planner of all scenes: {_PLANNER_NAMES} (mha)")
    study.add_argument("--workers", type=_parse_count, metavar="W", help="number of processes that plan (1)")
    study.add_argument(
        "--set",
        action="append",
        metavar="NAME=VALUE",
        help="a setting, such as search.max_expansions=500; may be repeated",
    )
    study.add_argument(
        "--report", nargs="+", metavar="DIR", help="plan nothing, report on the studies in these folders"
    )
    study.add_argument(
        "-o", "--out", metavar="DIR", help="keep the study there; with --report, write figures there"
    )
    study.add_argument("--json", action="store_true", help="print the summary for machines")


def _add_table4(commands: Any) -> None:
    """Add the command ``table4`` to the parser."""
    table4 = commands.add_parser(
        "table4",
        help="compare the planners as the paper's Table 4 does",
        description=("Let every planner search the same random scenes, with the paper's rows beside."),
    )
    table4.add_argument(
        "-n", type=_parse_count, default=20, metavar="N", help="scenes a kind (20, as in the paper)"
    )
    table4.add_argument(
        "--kind",
        action="append",
        metavar="K",
        help=f"kind of random scenes: {_KIND_NAMES}; may be repeated (keep_out and keep_in, as in the paper)",
    )
    table4.add_argument(
        "--planner", action="append", metavar="P", help=f"{_PLANNER_NAMES}; may be repeated (all of them)"
    )
    table4.add_argument(
        "--first-seed", type=int, default=0, metavar="SEED", help="seed of the first scene (0)"
    )
    table4.add_argument("-o", "--out", metavar="DIR", help="write a figure of the comparison there")
    table4.add_argument("--json", action="store_true", help="print the rows for machines")
