"""The command line: ``jaxplan plan``, ``check``, ``plot``, ``export``, ``study`` and ``table4``.

Results go to stdout, messages and progress to stderr. Exit codes: 0 done, 1 no plan, 2 bad input, 3 not
certified. Heavy imports wait until a command needs them, so that ``--help`` answers at once.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxplan.planner import Plan
    from jaxplan.scenario import Scenario

DONE, NO_PLAN, BAD_INPUT, NOT_CERTIFIED = 0, 1, 2, 3
_MARK = "jaxplan"  # in the pictures that are ours


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code.

    Args:
        arguments: the words after ``jaxplan``; those of the process by default.
    """
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except KeyboardInterrupt:
        return _complain("interrupted", 130)
    except BrokenPipeError:  # whoever read our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:
        place = "" if error.filename is None else f"{os.fspath(error.filename)}: "
        return _complain(f"{place}{error.strerror or error}", BAD_INPUT)
    except ValueError as error:  # ScenarioError and PlanFileError are such
        return _complain(str(error), BAD_INPUT)


def _complain(message: str, code: int) -> int:
    print(f"jaxplan: {message}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="jaxplan",
        description="Plan certified attitude manoeuvres of spacecraft with several pointing devices.",
        epilog="Exit codes: 0 done, 1 no plan, 2 bad input, 3 not certified.",
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    plan = commands.add_parser("plan", help="plan a scenario", description="Plan a scenario and certify it.")
    plan.add_argument(
        "scenario", metavar="SCENARIO", help="a scenario file, or case-1 to case-4 of the paper"
    )
    plan.add_argument("-o", "--out", metavar="DIR", help="write plan.json and figures there")
    plan.add_argument("--json", action="store_true", help="print a summary for machines")
    plan.set_defaults(run=_plan)
    check = commands.add_parser(
        "check", help="certify a plan file anew", description="Prove a plan file's trajectory safe, anew."
    )
    check.add_argument("plan", metavar="PLAN", help="a plan.json")
    check.add_argument("--json", action="store_true", help="print the certificate for machines")
    check.set_defaults(run=_check)
    plot = commands.add_parser(
        "plot", help="draw a plan file", description="Draw the figures of a plan file."
    )
    plot.add_argument("plan", metavar="PLAN", help="a plan.json")
    plot.add_argument("-o", "--out", metavar="DIR", help="where to; by default beside the plan")
    plot.set_defaults(run=_plot)
    _export_parser(commands)
    _study_parser(commands)
    _table4_parser(commands)
    parser.set_defaults(run=lambda options: _no_command(parser, options))
    return parser


def _export_parser(commands: Any) -> None:
    export = commands.add_parser(
        "export",
        help="write a plan for other tools",
        description="Certify a plan file anew and write its motion as another tool reads it.",
    )
    export.add_argument("plan", metavar="PLAN", help="a plan.json")
    export.add_argument(
        "--format", required=True, metavar="F", help="aem, ck (SPICE), stk, basilisk, csv or npz"
    )
    export.add_argument("--epoch", metavar="UTC", help="of the start, such as 2026-01-01T00:00:00")
    export.add_argument("--step", type=float, default=0.1, metavar="S", help="seconds between samples (0.1)")
    export.add_argument("-o", "--out", metavar="PATH", help="where to; by default beside the plan")
    export.add_argument("--force", action="store_true", help="replace what an earlier export wrote there")
    export.set_defaults(run=_export)


def _study_parser(commands: Any) -> None:
    study = commands.add_parser(
        "study",
        help="plan many random scenes, and say how it went",
        description="Plan many random scenes, or report on studies made before. "
        "Where a study with --out was interrupted, the same command goes on.",
    )
    study.add_argument("--kind", metavar="K", help="of the random scenes (keep_out)")
    study.add_argument("-n", type=_count, metavar="N", help="scenes (100)")
    study.add_argument("--first-seed", type=int, metavar="SEED", help="of the first scene (0)")
    study.add_argument("--planner", metavar="P", help="of all scenes (mha)")
    study.add_argument("--workers", type=_count, metavar="W", help="processes (1)")
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
    study.set_defaults(run=_study)


def _table4_parser(commands: Any) -> None:
    table4 = commands.add_parser(
        "table4",
        help="compare the planners as the paper's Table 4 does",
        description="Let every planner search the same random scenes, with the paper's rows beside.",
    )
    table4.add_argument(
        "-n", type=_count, default=20, metavar="N", help="scenes a kind (20, as in the paper)"
    )
    table4.add_argument("--kind", action="append", metavar="K", help="of random scenes; may be repeated")
    table4.add_argument("--planner", action="append", metavar="P", help="may be repeated; all by default")
    table4.add_argument("--first-seed", type=int, default=0, metavar="SEED", help="of the first scene (0)")
    table4.add_argument("-o", "--out", metavar="DIR", help="write a figure of the comparison there")
    table4.add_argument("--json", action="store_true", help="print the rows for machines")
    table4.set_defaults(run=_table4)


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a whole number, at least 1")
    return int(text)


def _no_command(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    if options.version:
        from jaxplan.version import __version__

        print(f"jaxplan {__version__}")
        return DONE
    parser.print_help(sys.stderr)
    return BAD_INPUT


def _plan(options: argparse.Namespace) -> int:
    from jaxplan.planner import plan, save_plan

    scenario = _scenario(options.scenario)
    folder = None if options.out is None else _folder(options.out)
    _keep_compiled_code()
    result = plan(scenario, throw=False)
    _print(result.summary() if options.json else result)
    if folder is not None:
        save_plan(result, folder / "plan.json")
        _say(f"wrote {folder / 'plan.json'}")
        _draw(result, folder)
    return {"OK": DONE, "UNCERTIFIED": NOT_CERTIFIED}.get(result.status.name, NO_PLAN)


def _scenario(name: str) -> "Scenario":
    from jaxplan.cases import CASE_NAMES, case_path
    from jaxplan.scenario import load_scenario

    if name in CASE_NAMES:
        return load_scenario(case_path(name))
    if not name:
        raise ValueError(f"SCENARIO is empty, it must name a file or one of {', '.join(CASE_NAMES)}")
    if not Path(name).exists():
        raise ValueError(f"{name}: no such file, and none of the cases {', '.join(CASE_NAMES)}")
    return load_scenario(name)


def _check(options: argparse.Namespace) -> int:
    from jaxplan.planner import check_plan
    from jaxplan.planner.record import report_summary

    plan = _load(options.plan)
    _keep_compiled_code()
    report = check_plan(plan)
    _print(report_summary(report) if options.json else report)
    return DONE if report.certified else NOT_CERTIFIED


def _plot(options: argparse.Namespace) -> int:
    plan = _load(options.plan)
    folder = _folder(str(Path(options.plan).parent) if options.out is None else options.out)
    _keep_compiled_code()
    _draw(plan, folder)
    return DONE if plan.ok else NO_PLAN


def _export(options: argparse.Namespace) -> int:
    from jaxplan.exporting import default_path, export

    plan = _load(options.plan)
    path = default_path(options.plan, options.format) if options.out is None else options.out
    _keep_compiled_code()
    written = export(
        plan, path, format=options.format, epoch=options.epoch, step_s=options.step, overwrite=options.force
    )
    _say(f"wrote {written}")
    return DONE


def _study(options: argparse.Namespace) -> int:
    from jaxplan.study import run_study

    if options.report is not None:
        return _report(options)
    first, count = options.first_seed or 0, options.n or 100
    settings = dict(map(_setting, options.set or ()))
    _keep_compiled_code()
    workers = None if options.workers in (None, 1) else options.workers
    study = run_study(
        range(first, first + count),
        options.kind or "keep_out",
        options.planner or "mha",
        settings,
        executor=workers,
        out=options.out,
    )
    summary = study.summary()
    _print(summary.record() if options.json else summary)
    if not study.complete:
        again = "" if options.out is None else ": the same command goes on"
        return _complain(f"interrupted after {summary.done} of {summary.scenes} scenes{again}", 130)
    return DONE


def _setting(text: str) -> tuple[str, Any]:
    """Name and value of a setting; a value that is no TOML is a text without its quotes."""
    import tomllib

    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--set {text}: must be NAME=VALUE, such as search.max_expansions=500")
    try:
        return name.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return name.strip(), value.strip()


def _report(options: argparse.Namespace) -> int:
    """Say what studies in folders found, and how they compare where there are two or more."""
    from jaxplan.study import compare_studies, load_study

    for name in ("kind", "n", "first_seed", "planner", "workers", "set"):
        if getattr(options, name) is not None:
            raise ValueError(
                f"{'-n' if name == 'n' else '--' + name.replace('_', '-')} says what to plan, "
                "but --report plans nothing"
            )
    studies = [load_study(folder) for folder in options.report]
    summaries = [study.summary() for study in studies]
    folder = None if options.out is None else _folder(options.out)
    compared = [compare_studies(studies[0], other) for other in studies[1:]]
    if options.json:
        records = [summary.record() for summary in summaries]
        _print({"studies": records, "comparisons": [one.record() for one in compared]})
    else:
        print(*summaries, *compared, sep="\n\n")
    if folder is not None:
        from jaxplan.plotting import study_figure

        _save(study_figure(studies), folder / "study.png")
    return DONE


def _table4(options: argparse.Namespace) -> int:
    from tqdm.auto import tqdm

    from jaxplan.cases import RANDOM_KINDS
    from jaxplan.search import PLANNERS
    from jaxplan.table4 import PAPER_KINDS, compare, format_table, printed_rows

    kinds, planners = (
        tuple(dict.fromkeys(names)) for names in (options.kind or PAPER_KINDS, options.planner or PLANNERS)
    )
    for key, chosen, known in (("--kind", kinds, RANDOM_KINDS), ("--planner", planners, tuple(PLANNERS))):
        for name in chosen:
            if name not in known:
                raise ValueError(f"{key} {name}: must be one of {', '.join(known)}")
    folder = None if options.out is None else _folder(options.out)
    _keep_compiled_code()
    total = options.n * len(kinds) * len(planners)
    with tqdm(total=total, desc="table4", unit=" searches", delay=1, leave=False, disable=None) as bar:
        rows = compare(kinds, planners, count=options.n, first_seed=options.first_seed, done=bar.update)
    _print([row.summary() for row in rows] if options.json else format_table(rows))
    if folder is not None:
        from jaxplan.plotting import comparison_figure

        _save(comparison_figure([*rows, *printed_rows(kinds)]), folder / "table4.png")
    return DONE


def _load(name: str) -> "Plan":
    from jaxplan.planner import load_plan

    if not name:
        raise ValueError("PLAN is empty, it must name a plan.json")
    return load_plan(name)


def _folder(name: str) -> Path:
    """The folder for results, made and tried before anything is computed for it."""
    if not name:
        raise ValueError("DIR of -o is empty, it must name a folder")
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (FileExistsError, NotADirectoryError) as error:
        file = next(place for place in (folder, *folder.parents) if place.exists())
        raise ValueError(f"{name}: cannot be a folder, {file} is a file") from error
    except OSError as error:
        raise ValueError(f"{name}: nothing can be written there: {error.strerror}") from error


def _print(result: Any) -> None:
    print(json.dumps(result, indent=1) if isinstance(result, dict | list) else result)


def _say(message: str) -> None:
    print(message, file=sys.stderr)


def _draw(plan: "Plan", folder: Path) -> None:
    """Write every figure that a plan has to a folder, and remove those of an earlier plan that it has not."""
    from jaxplan import plotting

    left = set(plotting.FIGURE_NAMES)
    for name, figure in plotting.figures(plan):
        _save(figure, folder / f"{name}.png")
        left.remove(name)
    for file in (folder / f"{name}.png" for name in sorted(left)):
        if file.is_file() and _MARK.encode() in file.read_bytes()[:200]:  # a picture of somebody else stays
            file.unlink()
            _say(f"removed {file}, which was of an earlier plan")


def _save(figure: Any, file: Path) -> None:
    figure.savefig(file, dpi=150, metadata={"Software": _MARK})
    _say(f"wrote {file}")


def _keep_compiled_code() -> None:
    """Let JAX keep its compiled kernels between runs, in a folder that only the user can write to."""
    import jax

    if jax.config.jax_compilation_cache_dir is not None:  # type: ignore[attr-defined]
        return  # the user has chosen one
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(root) / "jaxplan" / "compiled"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return  # it only saves time
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


if __name__ == "__main__":
    sys.exit(main())
