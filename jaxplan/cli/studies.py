"""The commands on many scenes: ``study`` and ``table4``.

Each is a function that takes the parsed arguments and returns the exit code.
"""

import argparse
import shlex
import tomllib
from pathlib import Path
from typing import Any

from jaxplan.cases import RANDOM_KINDS
from jaxplan.cli.common import DONE, complain, print_result, save, set_up_jax, writable_folder
from jaxplan.search import PLANNERS
from jaxplan.study import compare_studies, load_study, run_study
from jaxplan.study import table4 as table
from jaxplan.study.store import HEADER


def study(options: argparse.Namespace) -> int:
    """Plan many random scenes, or report on studies made before."""
    if options.report is not None:
        return _report(options)
    first, count = _first_seed(options), options.n or 100
    settings = dict(map(_setting, options.set or ()))
    set_up_jax()
    workers = None if options.workers in (None, 1) else options.workers
    study = run_study(
        range(first, first + count),
        options.kind or "keep_out",
        planner=options.planner or "mha",
        settings=settings,
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
    """The seed of the first scene, 0 unless given; raises ValueError for a negative one."""
    first = options.first_seed or 0
    if first < 0:
        raise ValueError(f"--first-seed {first}: seeds must be at least 0")
    return int(first)


def _setting(text: str) -> tuple[str, Any]:
    """Name and value of a setting NAME=VALUE; a value that is no TOML is taken as a string without quotes.

    Raises:
        ValueError: if there is no equals sign.
    """
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--set {text}: must be NAME=VALUE, such as search.max_expansions=500")
    try:
        return name.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return name.strip(), value.strip()


def _report(options: argparse.Namespace) -> int:
    """Print summaries of the studies in folders, and comparisons with the first where there are several."""
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


def table4(options: argparse.Namespace) -> int:
    """Compare the planners as the paper's Table 4 does."""
    kinds, planners = (
        tuple(dict.fromkeys(names))
        for names in (options.kind or table.PAPER_KINDS, options.planner or PLANNERS)
    )
    for key, chosen, known in (("--kind", kinds, RANDOM_KINDS), ("--planner", planners, tuple(PLANNERS))):
        for name in chosen:
            if name not in known:
                raise ValueError(f"{key} {name}: must be one of {', '.join(known)}")
    first = _first_seed(options)
    folder = None if options.out is None else writable_folder(options.out)
    set_up_jax()
    rows = table.compare(kinds, planners, count=options.n, first_seed=first, progress=True)
    print_result([row.summary() for row in rows] if options.json else table.format_table(rows))
    if folder is not None:
        from jaxplan.plotting import comparison_figure

        save(comparison_figure([*rows, *table.printed_rows(kinds)]), folder / "table4.png")
    return DONE
