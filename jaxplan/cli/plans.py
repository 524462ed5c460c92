"""The commands on one plan: ``plan``, ``check``, ``plot``, ``report``, ``view`` and ``export``.

Each is a function that takes the parsed arguments and returns the exit code. It imports by itself what the
others do not need, so that each starts quickly.
"""

import argparse
import shlex
from dataclasses import fields, replace
from pathlib import Path

from jaxplan import planner
from jaxplan.certificate import Certificate
from jaxplan.cli import timelines
from jaxplan.cli.common import (
    DONE,
    NO_PLAN,
    NOT_CERTIFIED,
    complain,
    draw,
    name_earlier,
    print_result,
    save,
    say,
    set_up_jax,
    writable_file,
    writable_folder,
)
from jaxplan.cli.scenes import first_character, is_scenario, load_scene
from jaxplan.model.status import Status
from jaxplan.planner import Plan
from jaxplan.planner.clock import expect_shortest
from jaxplan.planner.record import report_summary
from jaxplan.runtime.files import Source, expect_replaceable
from jaxplan.runtime.progress import progress_bar
from jaxplan.schema import find_observer, load_observer
from jaxplan.sky import Satellite
from jaxplan.timeline.record import TimelinePlan

_PLAN_FILE = "plan.json"  # name of the file that is written to a folder
_TABLE_SUFFIXES = (".aem", ".a", ".bc", ".csv")  # suffixes of files that are tables of attitudes and no plans


def plan(options: argparse.Namespace) -> int:
    """Plan a scenario and print the result; with ``-o``, write plan and figures to a folder."""
    scenario = load_scene(options.scenario)
    folder = None if options.out is None else writable_folder(options.out)
    if folder is not None:
        expect_replaceable(folder / _PLAN_FILE, Source.PLAN)
    asked = f"--improve-for {options.improve_for:g}"
    expect_shortest(asked, options.improve_for, scenario, options.scenario)
    result = planner.plan(scenario, throw=False, improve_for_s=options.improve_for)
    print_result(result.summary() if options.json else result)
    if folder is not None:
        file = folder / _PLAN_FILE
        planner.save_plan(result, file)
        say(f"wrote {file}")
        draw(result, folder, observer=find_observer(timelines.file_of(options.scenario)))
        name_earlier(file)
    return _exit_code(result)


def check(options: argparse.Namespace) -> int:
    """Certify a plan file anew and print the certificate; with ``--scenario``, check a table of attitudes."""
    if options.scenario is not None:
        return _check_table(options)
    for name in ("interpolation", "forgive_deg", "forgive_percent"):
        if getattr(options, name) is not None:
            raise ValueError(f"--{name.replace('_', '-')}: is of a table, which takes --scenario, too")
    if Path(options.plan).suffix.lower() in _TABLE_SUFFIXES:
        raise ValueError(
            f"{options.plan}: is no plan but a table of attitudes: hold it against a scene with "
            "--scenario SCENARIO"
        )
    if timelines.is_timeline_plan(options.plan):
        return timelines.check(options)
    plan = load_plan_file(options.plan)
    if plan.trajectory is None or plan.goal is None:
        from jaxplan.exporting import ending

        return complain(f"{options.plan}: {ending(plan)}", _exit_code(plan))
    report = _recertify(plan)
    print_result(report_summary(report) if options.json else report)
    return DONE if report.certified else NOT_CERTIFIED


def _check_table(options: argparse.Namespace) -> int:
    """Prove which limits and zones of a scene a table of attitudes keeps, and print the result."""
    from jaxplan.tables import certify_table

    name = options.scenario
    scene = timelines.load_timeline_file(name) if timelines.is_timeline(name) else load_scene(name)
    if not Path(options.plan).exists():
        raise ValueError(f"{options.plan}: no such file")
    if first_character(options.plan) == "{" or timelines.is_timeline_plan(options.plan):
        raise ValueError(f"{options.plan}: is a plan and no table; without --scenario it is proved as it is")
    try:
        found = certify_table(options.plan, options.interpolation, scene, **_forgiveness_options(options))
    except ImportError as error:
        raise ValueError(f"{options.plan}: {error}") from error
    print_result(found.summary() if options.json else found)
    return DONE if found.certified else NOT_CERTIFIED


def _forgiveness_options(options: argparse.Namespace) -> dict[str, float]:
    """Options given for how much a table may fall short, as keyword arguments of `certify_table`."""
    given = {name: getattr(options, name) for name in ("forgive_deg", "forgive_percent")}
    return {name: value for name, value in given.items() if value is not None}


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of a plan file, or the spacecraft of a scenario, as PNG files."""
    if not options.plan:
        raise ValueError("FILE is empty, it must name a plan or a scenario file")
    if is_scenario(options.plan) or timelines.is_timeline(options.plan):
        return _plot_spacecraft(options)
    plan = _load_any_plan(options.plan)
    observer = _read_observer(options, plan)
    folder = writable_folder(str(Path(options.plan).parent) if options.out is None else options.out)
    if plan.ok:  # since figures show what the certificate proves
        plan = replace(plan, certificate=_recertify(plan))
    draw(plan, folder, options.frequency, observer)
    if plan.certificate is not None and plan.ok and not plan.certificate.certified:
        return complain(f"{options.plan}: its certificate, made anew, fails", NOT_CERTIFIED)
    return _exit_code(plan)


def _plot_spacecraft(options: argparse.Namespace) -> int:
    """Draw the spacecraft of a scenario or timeline, in its state at the start."""
    from jaxplan import plotting

    if options.frequency:
        raise ValueError(
            f"--frequency {options.frequency[0]:g}: is for a plan, and {options.plan} is a scenario; make "
            f"out/plan.json of it with: jaxplan plan {shlex.quote(options.plan)} -o out"
        )
    if options.observer is not None:
        raise ValueError(f"--observer {options.observer}: is for a plan, and {options.plan} is a scenario")
    of_timeline = timelines.is_timeline(options.plan)
    scene = timelines.load_timeline_file(options.plan).scene if of_timeline else load_scene(options.plan)
    folder = writable_folder(str(Path(options.plan).parent) if options.out is None else options.out)
    save(plotting.spacecraft_figure(scene.spacecraft, scene.start.joints), folder / "spacecraft.png")
    return DONE


def report(options: argparse.Namespace) -> int:
    """Write an HTML page on a plan file."""
    from jaxplan.report import report_html

    plan = _load_any_plan(options.plan)
    observer = _read_observer(options, plan)
    path = Path(options.plan).with_suffix(".html") if options.out is None else options.out
    writable_file(path, options.plan, options.observer)
    if isinstance(plan, TimelinePlan) and plan.ok:  # other pages do so themselves
        plan = replace(plan, certificate=_recertify(plan))
    more = {"frequencies": options.frequency, "viewer": options.view, "observer": observer}
    with progress_bar("drawing the page"):
        page = report_html(plan, path, overwrite=options.force, **more)
    say(f"wrote {page}")
    if plan.ok and not _recertify(plan).certified:  # the page shows the reason
        return complain(f"{options.plan}: its certificate, made anew, fails", NOT_CERTIFIED)
    return _exit_code(plan)


def view(options: argparse.Namespace) -> int:
    """Write an interactive page that shows the plan of a file in space."""
    from jaxplan.viewing import view as make_view

    plan = _load_any_plan(options.plan)
    path = Path(options.plan).with_suffix(".view.html") if options.out is None else options.out
    if plan.trajectory is None:
        from jaxplan.exporting import ending

        return complain(f"{options.plan}: {ending(plan)}", _exit_code(plan))
    writable_file(path, options.plan)
    with progress_bar("drawing the page"):
        shown = make_view(plan)
    say(f"wrote {shown.save(path, overwrite=options.force)}: open it in a browser, ? lists its keys")
    return _exit_code(plan)


def export(options: argparse.Namespace) -> int:
    """Write the motion of a plan file in a format of another tool."""
    from jaxplan import exporting
    from jaxplan.model.export_names import ExportNames

    if options.format is None:
        raise ValueError(f"--format: missing, must be one of {', '.join(exporting.FORMATS)}")
    plan = _load_any_plan(options.plan)
    of_timeline = isinstance(plan, TimelinePlan)
    beside = Path(options.plan).with_name("motion") if of_timeline else options.plan  # plan.npz is taken
    path = exporting.default_path(beside, options.format) if options.out is None else options.out
    writable_file(path, options.plan, options.observer)
    given = {each.name: getattr(options, each.name) for each in fields(ExportNames)}
    try:
        written = exporting.export(
            plan,
            path,
            format=options.format,
            epoch=options.epoch,
            step_s=options.step,
            tolerance_deg=options.tolerance,
            observer=None if options.observer is None else load_observer(timelines.file_of(options.observer)),
            names=ExportNames(**{key: value for key, value in given.items() if value is not None}),
            overwrite=options.force,
            **_forgiveness_options(options),
        )
    except exporting.UncertifiedError as error:
        return complain(str(error), NOT_CERTIFIED if plan.ok else _exit_code(plan))
    told = [f"wrote {written}", exporting.needed_by(plan, options.format)]
    if options.step == exporting.SPARSEST:
        told.append(_describe_table_size(written))
    say(": ".join(filter(None, told)))
    return DONE


def _describe_table_size(file: Path) -> str:
    """Text with the numbers of rows and values of a written table; empty if it cannot be read back."""
    from jaxplan.tables import load_attitude

    try:
        table = load_attitude(file)
    except (ValueError, ImportError):  # CZML is not read back; or a reader is not installed
        return ""
    return f"{len(table.times)} rows, {table.numbers} numbers"


def _read_observer(options: argparse.Namespace, plan: Plan | TimelinePlan) -> Satellite | None:
    """Read the orbit from the file that ``--observer`` names; None without that option.

    Raises:
        ValueError: if the plan has no epoch.
    """
    name = options.observer
    if name is None:
        return None
    if plan.scenario.epoch is None:
        raise ValueError(f"--observer {name}: {options.plan} has no epoch, at which the orbit would be known")
    return load_observer(timelines.file_of(name))


def _load_any_plan(name: str) -> Plan | TimelinePlan:
    """Read the plan of a scenario or of a timeline from a file; raises a ValueError if it is neither."""
    return timelines.load_plan(name) if timelines.is_timeline_plan(name) else load_plan_file(name)


def _recertify(plan: Plan | TimelinePlan) -> Certificate:
    """Make a new certificate of a plan."""
    if not isinstance(plan, TimelinePlan):
        return planner.certify(plan)
    with progress_bar("proving"):
        return plan.certify()


def _exit_code(plan: Plan | TimelinePlan) -> int:
    """The exit code for the status of a plan."""
    return {Status.OK: DONE, Status.UNCERTIFIED: NOT_CERTIFIED}.get(plan.status, NO_PLAN)


def load_plan_file(name: str) -> Plan:
    """Read the plan of a scenario from a file.

    Raises:
        ValueError: if there is no such file, or it is not a plan of a scenario; the message suggests what to
            do.
    """
    set_up_jax()
    if not name:
        raise ValueError("PLAN is empty, it must name a plan.json")
    timelines.refuse(name)
    if is_scenario(name):
        raise ValueError(
            f"{name}: is a scenario by its name and no plan file; make out/plan.json of it with: jaxplan "
            f"plan {shlex.quote(name)} -o out"
        )
    if Path(name).is_dir():
        inside = Path(name) / _PLAN_FILE
        advice = f"perhaps {inside} is meant" if inside.is_file() else "name a plan.json in it"
        raise ValueError(f"{name}: is a folder, {advice}")
    if not Path(name).exists():
        raise ValueError(f"{name}: no such file; jaxplan plan SCENARIO -o DIR makes DIR/plan.json")
    try:
        return planner.load_plan(name)
    except planner.PlanFileError as error:
        if name.endswith(".timings.json"):
            plan = name.removesuffix(".timings.json") + ".json"
            raise ValueError(f"{name}: holds the timings of a plan, perhaps {plan} is meant") from error
        if first_character(name) not in (None, "{"):
            raise ValueError(f"{error}; jaxplan plan SCENARIO -o DIR makes plan files") from error
        raise
