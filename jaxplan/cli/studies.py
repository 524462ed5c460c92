"""The commands on many scenes: ``study`` and ``table4``.

Each is a function that takes the parsed arguments and returns the exit code.
"""

import argparse
import shlex
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jaxplan.cases import RANDOM_KINDS
from jaxplan.cli.common import (
    DONE,
    complain,
    print_result,
    refuse_stdout,
    save,
    say,
    set_up_jax,
    writable_folder,
)
from jaxplan.cli.scenes import load_scene
from jaxplan.model.scenario import Scenario
from jaxplan.runtime.display import in_columns
from jaxplan.search import PLANNERS
from jaxplan.study import Study, compare_studies, load_study, run_study
from jaxplan.study import printed_planners as table
from jaxplan.study.store import HEADER


def study(options: argparse.Namespace) -> int:
    """Plan many scenes, random ones or files of a folder, and print a summary; or report on studies."""
    if options.report is not None:
        return _report_studies(options)
    if options.out is not None:
        refuse_stdout(options.out)
    settings = dict(map(_parse_setting, options.set or ()))
    set_up_jax()
    workers = None if options.workers in (None, 1) else options.workers
    own = [] if options.scenes is None else _read_scenes(options)
    first, count = _first_seed(options), options.n or 100
    study = run_study(
        [scene for _, scene in own] if own else range(first, first + count),
        None if own else options.kind or "keep_out",
        planner=options.planner or "mha",
        settings=settings,
        workers=workers,
        out=options.out,
    )
    summary = study.summary()
    if options.json:
        files = {"files": [path.name for path, _ in own]} if own else {}
        print_result(summary.record() | files)
    else:
        print_result(f"{_outcome_table(own, study)}\n\n{summary}" if own else summary)
    if not study.complete:
        again = "" if options.out is None else ": the same command goes on"
        return complain(f"interrupted after {summary.done} of {summary.scenes} scenes{again}", 130)
    return DONE


def _read_scenes(options: argparse.Namespace) -> list[tuple[Path, Scenario]]:
    """Read the scenario files of a folder.

    Returns:
        (path, scenario) of each file, ordered by name. Files with faults are named on stderr and left out.

    Raises:
        ValueError: if it is not a folder, has no valid file, or options of random scenes are given.
    """
    folder = Path(options.scenes)
    for name, given in (("--kind", options.kind), ("-n", options.n), ("--first-seed", options.first_seed)):
        if given is not None:
            raise ValueError(f"{name} is of random scenes, and {folder} has scenes of its own")
    if not folder.is_dir():
        raise ValueError(f"{folder}: must be a folder with scenario files (.toml)")
    found, left = [], 0
    for path in sorted(folder.glob("*.toml")):
        try:
            found.append((path, load_scene(str(path))))
        except ValueError as error:
            say(f"left out: {error}")
            left += 1
    if not found:
        usable = f" that can be planned, and {left} with faults" if left else ""
        raise ValueError(f"{folder}: has no scenario file (.toml){usable}")
    return found


def _outcome_table(own: Sequence[tuple[Path, Scenario]], study: Study) -> str:
    """Table, as text, of how planning ended for each file.

    Args:
        own: path and scenario of each scene of the study.
        study: the study of these scenes.
    """
    head = ("file", "status", "duration, s", "margin, deg", "message")
    rows = [head]
    for row in study.table:
        margin, duration = row["min_margin_deg"], row["duration_s"]
        rows.append(
            (
                own[row["scene"]][0].name,
                row["status"],
                "" if duration is None else f"{duration:.2f}",
                "" if margin is None else f"{margin:.3f}",
                row["message"] or "",
            )
        )
    return "\n".join(in_columns(rows, "<<>><"))


def _first_seed(options: argparse.Namespace) -> int:
    """Seed of the first scene, 0 by default; raises a ValueError for a negative one."""
    first = options.first_seed or 0
    if first < 0:
        raise ValueError(f"--first-seed {first}: seeds must be at least 0")
    return int(first)


def _parse_setting(text: str) -> tuple[str, Any]:
    """Divide a text NAME=VALUE into name and value; a value that is not TOML is returned as text.

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


def _report_studies(options: argparse.Namespace) -> int:
    """Print summaries of the studies in folders; compare the first with each other one."""
    if options.scenes is not None:
        raise ValueError(f"{options.scenes}: says what to plan, but --report plans nothing")
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
    """Compare the planners on random scenes, as in the paper's Table 4, and print the table."""
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
