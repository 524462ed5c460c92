"""The commands on many scenes: ``study`` and ``table4``."""

import argparse
import shlex
from pathlib import Path
from typing import Any

from jaxplan.cli.common import (
    DONE,
    command,
    complain,
    count,
    print_result,
    save,
    set_up_jax,
    writable_folder,
)

# As words, since to ask for them takes a second that help should not take.
_KINDS = (
    "keep_out, keep_in, hard_keep_out, hard_keep_in, held_links, masks, beams, panels, carried, "
    "joint_bounds, grouped, moving, moved_goals or mixed"
)
_PLANNERS = "mha, mha-paper, wastar, rrt_star or rrt_connect"


def add_commands(commands: Any) -> None:
    """Tell the parser of them."""
    _add_study(commands)
    _add_table4(commands)


def _add_study(commands: Any) -> None:
    study = command(
        commands,
        "study",
        _study,
        "plan many random scenes, and say how it went",
        "Plan many random scenes, or report on studies made before. "
        "Where a study with --out was interrupted, the same command goes on.",
    )
    study.add_argument("--kind", metavar="K", help=f"kind of the random scenes: {_KINDS} (keep_out)")
    study.add_argument("-n", type=count, metavar="N", help="number of scenes (100)")
    study.add_argument("--first-seed", type=int, metavar="SEED", help="seed of the first scene (0)")
    study.add_argument("--planner", metavar="P", help=f"planner of all scenes: {_PLANNERS} (mha)")
    study.add_argument("--workers", type=count, metavar="W", help="number of processes that plan (1)")
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
    table4 = command(
        commands,
        "table4",
        _table4,
        "compare the planners as the paper's Table 4 does",
        "Let every planner search the same random scenes, with the paper's rows beside.",
    )
    table4.add_argument("-n", type=count, default=20, metavar="N", help="scenes a kind (20, as in the paper)")
    table4.add_argument(
        "--kind",
        action="append",
        metavar="K",
        help=f"kind of random scenes: {_KINDS}; may be repeated (keep_out and keep_in, as in the paper)",
    )
    table4.add_argument(
        "--planner", action="append", metavar="P", help=f"{_PLANNERS}; may be repeated (all of them)"
    )
    table4.add_argument(
        "--first-seed", type=int, default=0, metavar="SEED", help="seed of the first scene (0)"
    )
    table4.add_argument("-o", "--out", metavar="DIR", help="write a figure of the comparison there")
    table4.add_argument("--json", action="store_true", help="print the rows for machines")


def _study(options: argparse.Namespace) -> int:
    from jaxplan.study import run_study

    if options.report is not None:
        return _report(options)
    first, count = _first_seed(options), options.n or 100
    settings = dict(map(_setting, options.set or ()))
    set_up_jax()
    workers = None if options.workers in (None, 1) else options.workers
    study = run_study(
        range(first, first + count),
        options.kind or "keep_out",
        options.planner or "mha",
        settings,
        workers=workers,
        out=options.out,
    )
    summary = study.summary()
    print_result(summary.record() if options.json else summary)
    if not study.complete:
        again = "" if options.out is None else ": the same command goes on"
        return complain(f"interrupted after {summary.done} of {summary.scenes} scenes{again}", 130)
    return DONE


def _first_seed(options: argparse.Namespace) -> int:
    first = options.first_seed or 0
    if first < 0:
        raise ValueError(f"--first-seed {first}: seeds must be at least 0")
    return int(first)


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
    from jaxplan.study.store import HEADER

    for name in ("kind", "n", "first_seed", "planner", "workers", "set"):
        if getattr(options, name) is not None:
            raise ValueError(
                f"{'-n' if name == 'n' else '--' + name.replace('_', '-')} says what to plan, "
                "but --report plans nothing"
            )
    for name in options.report:
        if not (Path(name) / HEADER).is_file():
            raise ValueError(f"{name}: holds no study; jaxplan study -o {shlex.quote(name)} makes one there")
    studies = [load_study(folder) for folder in options.report]
    summaries = [study.summary() for study in studies]
    folder = None if options.out is None else writable_folder(options.out)
    compared = [compare_studies(studies[0], other) for other in studies[1:]]
    if options.json:
        records = [summary.record() for summary in summaries]
        print_result({"studies": records, "comparisons": [one.record() for one in compared]})
    else:
        print(*summaries, *compared, sep="\n\n")
    if folder is not None:
        from jaxplan.plotting import study_figure

        save(study_figure(studies), folder / "study.png")
    return DONE


def _table4(options: argparse.Namespace) -> int:
    from jaxplan.cases import RANDOM_KINDS
    from jaxplan.search import PLANNERS
    from jaxplan.study.table4 import PAPER_KINDS, compare, format_table, printed_rows

    kinds, planners = (
        tuple(dict.fromkeys(names)) for names in (options.kind or PAPER_KINDS, options.planner or PLANNERS)
    )
    for key, chosen, known in (("--kind", kinds, RANDOM_KINDS), ("--planner", planners, tuple(PLANNERS))):
        for name in chosen:
            if name not in known:
                raise ValueError(f"{key} {name}: must be one of {', '.join(known)}")
    first = _first_seed(options)
    folder = None if options.out is None else writable_folder(options.out)
    set_up_jax()
    rows = compare(kinds, planners, count=options.n, first_seed=first, progress=True)
    print_result([row.summary() for row in rows] if options.json else format_table(rows))
    if folder is not None:
        from jaxplan.plotting import comparison_figure

        save(comparison_figure([*rows, *printed_rows(kinds)]), folder / "table4.png")
    return DONE
