"""The command ``timeline``, and functions by which other commands read timelines and their plans."""

import argparse
import shlex
from pathlib import Path
from typing import Any

from jaxplan.cases import CASE_NAMES, TIMELINE_NAMES, case_path
from jaxplan.cli.common import (
    DONE,
    NO_PLAN,
    NOT_CERTIFIED,
    complain,
    draw,
    name_earlier,
    print_result,
    say,
    set_up_jax,
    writable_folder,
)
from jaxplan.model.activities import Timeline
from jaxplan.model.status import Status
from jaxplan.planner.record import report_summary
from jaxplan.runtime.files import Source, expect_replaceable, is_day_plan, replacing_file
from jaxplan.runtime.progress import progress_bar
from jaxplan.schema import find_observer, load_timeline, save_timeline
from jaxplan.schema.text import LARGEST_TIMELINE, parse
from jaxplan.schema.timelines import KIND
from jaxplan.timeline import TimelinePlan, load_timeline_plan
from jaxplan.timeline.tables import activities_csv, events_csv, interruptions_csv, segments_csv

PLAN, TIMELINE = "plan.npz", "timeline.toml"  # names of the files that are written to a folder
_TABLE_WRITERS = {
    "activities.csv": activities_csv,
    "segments.csv": segments_csv,
    "interruptions.csv": interruptions_csv,
    "events.csv": events_csv,
}


def timeline(options: argparse.Namespace) -> int:
    """Plan a timeline and print the result; with ``-o``, write plan, tables, figures and exports."""
    from jaxplan.exporting import FORMATS, export
    from jaxplan.timeline import plan_timeline

    asked = load_timeline_file(options.timeline)
    formats = tuple(dict.fromkeys(options.export))
    if formats and options.out is None:
        raise ValueError("--export needs -o DIR, where the files go")
    _expect_exports(asked, formats)
    folder = None if options.out is None else writable_folder(options.out)
    if folder is not None:
        expect_replaceable(folder / PLAN, Source.DAY_PLAN)
        expect_replaceable(folder / TIMELINE, Source.SCENE)
    plan = plan_timeline(asked, throw=False, go_on=options.go_on)
    print_result(plan.summary() if options.json else plan)
    code = _exit_code(plan)
    if folder is not None:
        _write_results(plan, folder, file_of(options.timeline))
        for name in formats if plan.ok else ():
            say(f"wrote {export(plan, _export_path(folder, name), format=name, overwrite=True)}")
        kept = formats if plan.ok else ()
        name_earlier(folder / PLAN, [_export_path(folder, name) for name in FORMATS if name not in kept])
        if formats and not plan.ok:
            return complain(
                f"{options.timeline}: is not exported, since it ended as {plan.status.name}", code
            )
    return code


def _expect_exports(asked: Timeline, formats: tuple[str, ...]) -> None:
    """Check before planning that a plan could be exported in some formats; raises a ValueError if not."""
    if not formats:
        return
    from jaxplan.exporting import FORMATS

    for name in formats:
        if name not in FORMATS:
            raise ValueError(f"--export {name}: must be one of {', '.join(FORMATS)}")
        if FORMATS[name].dated and asked.scene.epoch is None:
            raise ValueError(f"--export {name}: needs an epoch: give the timeline epoch_utc, or [sky]")


def file_of(name: str) -> str:
    """Path of a scenario or timeline file; a case or example may be given by its name."""
    return str(case_path(name)) if name in (*CASE_NAMES, *TIMELINE_NAMES) else name


def _write_results(plan: TimelinePlan, folder: Path, source: str) -> None:
    """Write timeline, plan, tables and figures to a folder, and say so on stderr.

    Args:
        plan: what was made of the timeline.
        folder: an existing folder.
        source: the timeline's file. If it is the one that would be written, it stays as the user wrote it.
    """
    names = [PLAN, *_TABLE_WRITERS]
    if not ((folder / TIMELINE).exists() and (folder / TIMELINE).samefile(source)):
        save_timeline(plan.timeline, folder / TIMELINE)
        names.insert(0, TIMELINE)
    plan.save(folder / PLAN)
    for name, table in _TABLE_WRITERS.items():
        with replacing_file(folder / name) as fresh:
            fresh.write_text(table(plan), encoding="utf-8")
    for name in names:
        say(f"wrote {folder / name}")
    draw(plan, folder, observer=find_observer(source))


def _export_path(folder: Path, name: str) -> Path:
    """Path in a folder for the export in the format called `name`."""
    from jaxplan.exporting import FORMATS

    return folder / f"motion{FORMATS[name].suffix}"


def check(options: argparse.Namespace) -> int:
    """Certify the plan of a timeline anew, and print the certificate.

    The exit code is 0 only if all activities are planned, too.
    """
    plan = load_plan(options.plan)
    if plan.trajectory is None:
        return complain(
            f"{options.plan}: has no trajectory, {plan.status.name}: {plan.message}", _exit_code(plan)
        )
    with progress_bar("proving"):
        found = plan.certify()
    if options.json:
        print_result(report_summary(found) | {"status": plan.status.name, "not_done": list(plan.not_done)})
    else:
        print_result(found)
    if not plan.ok:  # only a part of what was asked is planned and proved
        missing = f", of {len(plan.timeline.activities)} activities not done: {', '.join(plan.not_done)}"
        told = f"{options.plan}: is not all that was asked{missing if plan.not_done else ''}"
        return complain(f"{told}; it ended as {plan.status.name}", _exit_code(plan))
    return DONE if found.certified else NOT_CERTIFIED


def load_timeline_file(name: str) -> Timeline:
    """Read a timeline from a file, or an example by its name.

    Raises:
        ScenarioError: (a ValueError) for a timeline with faults.
        ValueError: if there is no such file.
    """
    set_up_jax()
    if name in TIMELINE_NAMES:
        return load_timeline(case_path(name))
    known = ", ".join(TIMELINE_NAMES)
    if not name:
        raise ValueError(f"TIMELINE is empty, it must name a file or one of {known}")
    if is_timeline_plan(name):
        raise ValueError(f"{name}: is a plan; jaxplan check, plot, report and export take it")
    if not Path(name).exists():
        raise ValueError(
            f"{name}: no such file, and none of {known}; jaxplan new --timeline writes a file to begin with"
        )
    if Path(name).is_dir():
        raise ValueError(f"{name}: is a folder, name a timeline's file in it")
    content = _read_toml(name)
    if "goal" in content and not {"kind", "activity", "timeline"}.intersection(content):
        raise ValueError(f"{name}: is a scenario; plan it with: jaxplan plan {shlex.quote(name)} -o out")
    return load_timeline(name)


def is_timeline(name: str) -> bool:
    """Tell whether a name is that of an example of a timeline, or of a TOML file with a timeline."""
    return name in TIMELINE_NAMES or _read_toml(name).get("kind") == KIND


def _read_toml(name: str) -> dict[str, Any]:
    """Return what a TOML file holds, with nothing checked; empty if it is no such file."""
    if not name.endswith(".toml") or not Path(name).is_file():
        return {}
    try:
        with open(name, "rb") as file:
            return parse(file.read(LARGEST_TIMELINE + 1).decode("utf-8-sig"), LARGEST_TIMELINE)
    except (OSError, ValueError):
        return {}


def is_timeline_plan(name: str) -> bool:
    """Tell whether a file holds a plan that `TimelinePlan.save` wrote."""
    return Path(name).is_file() and is_day_plan(name)


def load_plan(name: str) -> TimelinePlan:
    """Read the plan of a timeline from a file; raises a PlanFileError (a ValueError) if it is none."""
    set_up_jax()
    return load_timeline_plan(name)


def refuse(name: str) -> None:
    """Raise a ValueError if the file holds a timeline or its plan, where a scenario or its plan is wanted."""
    if is_timeline_plan(name):
        raise ValueError(f"{name}: is the plan of a timeline, and no scenario or plan of one")
    if is_timeline(name):
        raise ValueError(f"{name}: is a timeline; plan it with: jaxplan timeline {shlex.quote(name)} -o out")


def _exit_code(plan: TimelinePlan) -> int:
    """The exit code for the status of a timeline's plan."""
    return {Status.OK: DONE, Status.UNCERTIFIED: NOT_CERTIFIED}.get(plan.status, NO_PLAN)
