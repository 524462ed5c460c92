"""The commands on one scene or plan, from ``new`` to ``export``.

Each is a function that takes the parsed arguments and returns the exit code. It imports by itself what others
do without, so that each begins soon.
"""

import argparse
import os
import shlex
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from jaxplan import planner
from jaxplan.cases import CASE_NAMES, TIMELINE_NAMES, case_path
from jaxplan.certificate import Certificate
from jaxplan.cli import timelines
from jaxplan.cli.common import (
    BAD_INPUT,
    DONE,
    NO_PLAN,
    NOT_CERTIFIED,
    complain,
    draw,
    print_result,
    save,
    say,
    set_up_jax,
    try_folder_of,
    writable_folder,
)
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario, moves
from jaxplan.model.status import Status
from jaxplan.model.zones import masks
from jaxplan.planner import Plan
from jaxplan.planner.clock import expect_shortest
from jaxplan.planner.record import report_summary
from jaxplan.planner.validity import hidden_targets, start_breaches
from jaxplan.runtime.files import replacing_file
from jaxplan.schema import ScenarioError, find_observer, load_observer, load_scenario
from jaxplan.schema.text import template
from jaxplan.schema.timelines import timeline_template
from jaxplan.sky import Satellite
from jaxplan.timeline.record import TimelinePlan

_TABLES = (".aem", ".a", ".bc", ".csv")  # suffixes of files that are tables of attitudes and no plans
_COUNTED = {  # what a scene, its spacecraft or a timeline has several of, and what one of them is called
    "terminals": "terminal",
    "drives": "drive",
    "instruments": "instrument",
    "wheels": "reaction wheel",
    "keep_out": "keep-out zone",
    "keep_in": "keep-in zone",
    "joint_bounds": "joint bound",
    "masks": "mask",
    "activities": "activity",
}


def new(options: argparse.Namespace) -> int:
    """Write a scenario or timeline file to begin with: the template, a case of the paper, or an example."""
    if options.ask and (options.source is not None or options.timeline):
        raise ValueError("--ask: makes a scenario of answers, so it goes without --from and --timeline")
    file = Path(options.file)
    if options.file != "-":
        if not options.file or options.file.endswith(os.sep) or file.is_dir():
            raise ValueError(f"{options.file or 'FILE'}: must name a file, such as {file / 'scene.toml'}")
        if file.exists() and not options.force:
            raise ValueError(f"{file}: is there already; take another name, or replace it with --force")
        try_folder_of(file)
    text = _answered(file) if options.ask else _text(options.source, options.timeline)
    if options.file == "-":
        print(text, end="")
        return DONE
    with replacing_file(file) as fresh:
        fresh.write_text(text, encoding="utf-8")
    command = "timeline" if options.timeline or options.source in TIMELINE_NAMES else "plan"
    if options.ask:
        say(_line(_findings(str(file))))
    say(f"wrote {file}; plan it with: jaxplan {command} {shlex.quote(str(file))} -o out")
    return DONE


def _answered(file: Path) -> str:
    """Text of a scenario file made of answers on stdin, one a line; questions go to stderr."""
    from jaxplan.cli.interview import interview
    from jaxplan.cli.questions import Dialog

    set_up_jax()
    name = "scene" if file.name == "-" else file.stem
    return interview(Dialog(sys.stdin, sys.stderr, file.parent), name, _breaches)


def _text(source: str | None, timeline: bool) -> str:
    """Text of a template for None, else of the case of that name; raises ValueError if there is none."""
    if source is None:
        return timeline_template() if timeline else template()
    known = TIMELINE_NAMES if timeline else (*CASE_NAMES, *TIMELINE_NAMES)
    if source not in known:
        raise ValueError(f"--from {source}: must be one of {', '.join(known)}")
    return case_path(source).read_text(encoding="utf-8")


def validate(options: argparse.Namespace) -> int:
    """Print what scenario files hold and what is wrong with them."""
    found = [_findings(name) for name in options.files]
    print_result(found if options.json else "\n".join(map(_line, found)))
    if any(one["faults"] for one in found):
        return BAD_INPUT
    return DONE if all(one["valid"] for one in found) else NO_PLAN


def _findings(name: str) -> dict[str, Any]:
    """Read a scenario file; returns a dict for JSON of what it holds, its faults, and what its ends break.

    A file that is faulty, or no scenario at all, has None for what it holds.
    """
    found: dict[str, Any] = {"file": name, "valid": False, "faults": [], "start": [], "goal": []}
    try:
        if timelines.is_timeline(name):
            asked = timelines.load_timeline_file(name)
            start = list(start_breaches(replace(asked.scene, goal=asked.scene.start)))
            holds = _holds(asked.scene) | {"activities": len(asked.activities)}
            return found | {"valid": not start, "start": start, "holds": holds}
        scene = load_scene(name)
    except ScenarioError as error:
        return found | {"faults": list(error.faults), "holds": None}
    except ValueError as error:  # it is none at all
        return found | {"faults": [str(error).removeprefix(f"{name}: ")], "holds": None}
    start, goal = _breaches(scene)
    return found | {"valid": not (start or goal), "start": start, "goal": goal, "holds": _holds(scene)}


def _holds(scene: Scenario) -> dict[str, Any]:
    """The name of a scene, and how many it has of what `_COUNTED` says."""
    everything = {**vars(scene), **vars(scene.spacecraft), "masks": masks(scene.spacecraft)}
    return {"name": scene.name, **{key: len(everything[key]) for key in _COUNTED if key in everything}}


def _breaches(scene: Scenario) -> tuple[list[str], list[str]]:
    """Messages on the limits and zones that the start breaks, and on what is wrong at the goal.

    The goal is checked where it is a given state and nothing moves; and where the duration is a number,
    whether its targets are hidden then.
    """
    duration = scene.trajectory.duration
    if not isinstance(duration, str):
        unseen = hidden_targets(scene, float(duration))
        if unseen:
            return list(start_breaches(scene)), list(unseen)
    goal = None
    if isinstance(scene.goal, GivenState) and not moves(scene):
        from jaxplan.planner.steps import find_goals

        goal = find_goals(scene)
    return list(start_breaches(scene)), [goal.message] if isinstance(goal, Plan) else []


def _line(found: dict[str, Any]) -> str:
    """Text for what `_findings` returns of one scenario file."""
    name, holds = found["file"], found["holds"]
    if holds is None:
        return str(ScenarioError(found["faults"], name or '""'))
    counted = [(key, holds[key]) for key in _COUNTED if holds.get(key)]
    parts = ", ".join(f"{number} {_plural(_COUNTED[key], number)}" for key, number in counted)
    broken = [
        f"\n  {status.value}: {'; '.join(found[place])}"
        for place, status in (("start", Status.INVALID_START), ("goal", Status.INVALID_GOAL))
        if found[place]
    ]
    if broken:
        return f"{name}: {parts}{''.join(broken)}"
    return f"{name}: ok: {parts}; the start keeps all limits and zones"


def _plural(noun: str, number: int) -> str:
    """A noun as it stands after a number."""
    if number == 1:
        return noun
    return f"{noun.removesuffix('y')}ies" if noun.endswith("y") else f"{noun}s"


def plan(options: argparse.Namespace) -> int:
    """Plan a scenario, and write plan and figures to a folder."""
    scenario = load_scene(options.scenario)
    folder = None if options.out is None else writable_folder(options.out)
    asked = f"--improve-for {options.improve_for:g}"
    expect_shortest(asked, options.improve_for, scenario, options.scenario)
    result = planner.plan(scenario, throw=False, improve_for_s=options.improve_for)
    print_result(result.summary() if options.json else result)
    if folder is not None:
        planner.save_plan(result, folder / "plan.json")
        say(f"wrote {folder / 'plan.json'}")
        draw(result, folder, observer=find_observer(_file_of(options.scenario)))
    return _code_of(result)


def check(options: argparse.Namespace) -> int:
    """Certify a plan file anew, or a table of attitudes, and print the certificate."""
    if options.scenario is not None:
        return _check_table(options)
    for name in ("interpolation", "forgive_deg", "forgive_percent"):
        if getattr(options, name) is not None:
            raise ValueError(f"--{name.replace('_', '-')}: is of a table, which takes --scenario, too")
    if Path(options.plan).suffix.lower() in _TABLES:
        raise ValueError(
            f"{options.plan}: is no plan but a table of attitudes: hold it against a scene with "
            "--scenario SCENARIO"
        )
    if timelines.is_timeline_plan(options.plan):
        return timelines.check(options)
    plan = load_plan_file(options.plan)
    if plan.trajectory is None or plan.goal is None:
        from jaxplan.exporting import ending

        return complain(f"{options.plan}: {ending(plan)}", _code_of(plan))
    report = planner.certify(plan)
    print_result(report_summary(report) if options.json else report)
    return DONE if report.certified else NOT_CERTIFIED


def _check_table(options: argparse.Namespace) -> int:
    """Prove what a table of attitudes keeps of a scene, and print that."""
    from jaxplan.tables import certify_table

    name = options.scenario
    scene = timelines.load_timeline_file(name) if timelines.is_timeline(name) else load_scene(name)
    if not Path(options.plan).exists():
        raise ValueError(f"{options.plan}: no such file")
    if _first_character(options.plan) == "{" or timelines.is_timeline_plan(options.plan):
        raise ValueError(f"{options.plan}: is a plan and no table; without --scenario it is proved as it is")
    try:
        found = certify_table(options.plan, options.interpolation, scene, **_forgiving(options))
    except ImportError as error:
        raise ValueError(f"{options.plan}: {error}") from error
    print_result(found.summary() if options.json else found)
    return DONE if found.certified else NOT_CERTIFIED


def _forgiving(options: argparse.Namespace) -> dict[str, float]:
    """What is to be forgiven of a table, as far as it is told."""
    given = {name: getattr(options, name) for name in ("forgive_deg", "forgive_percent")}
    return {name: value for name, value in given.items() if value is not None}


def plot(options: argparse.Namespace) -> int:
    """Draw the figures of a plan file, or the spacecraft of a scenario."""
    if _is_scenario(options.plan) or timelines.is_timeline(options.plan):
        return _plot_spacecraft(options)
    plan = _load_any_plan(options.plan)
    observer = _observer(options, plan)
    folder = writable_folder(str(Path(options.plan).parent) if options.out is None else options.out)
    if plan.ok:  # what figures call proved is proved anew
        plan = replace(plan, certificate=_certified_anew(plan))
    draw(plan, folder, options.frequency, observer)
    if plan.certificate is not None and plan.ok and not plan.certificate.certified:
        return complain(f"{options.plan}: its certificate, made anew, fails", NOT_CERTIFIED)
    return _code_of(plan)


def _plot_spacecraft(options: argparse.Namespace) -> int:
    """Draw the spacecraft of a scenario as it is at the start."""
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
    observer = _observer(options, plan)
    path = Path(options.plan).with_suffix(".html") if options.out is None else options.out
    try_folder_of(path)
    if isinstance(plan, TimelinePlan) and plan.ok:  # a page on a single plan makes its certificate by itself
        plan = replace(plan, certificate=plan.certify())
    more = {"frequencies": options.frequency, "viewer": options.view, "observer": observer}
    say(f"wrote {report_html(plan, path, overwrite=options.force, **more)}")
    if plan.ok and not _certified_anew(plan).certified:  # the page says why
        return complain(f"{options.plan}: its certificate, made anew, fails", NOT_CERTIFIED)
    return _code_of(plan)


def view(options: argparse.Namespace) -> int:
    """Write the page on which a plan file turns in space."""
    from jaxplan.viewing import view as make_view

    plan = _load_any_plan(options.plan)
    path = Path(options.plan).with_suffix(".view.html") if options.out is None else Path(options.out)
    if plan.trajectory is None:
        from jaxplan.exporting import ending

        return complain(f"{options.plan}: {ending(plan)}", _code_of(plan))
    shown = make_view(plan)
    try_folder_of(path)
    say(f"wrote {shown.save(path, overwrite=options.force)}: open it in a browser, ? lists its keys")
    return _code_of(plan)


def export(options: argparse.Namespace) -> int:
    """Write the motion of a plan file as another tool reads it."""
    from jaxplan import exporting
    from jaxplan.model.export_names import ExportNames

    plan = _load_any_plan(options.plan)
    of_timeline = isinstance(plan, TimelinePlan)
    beside = Path(options.plan).with_name("motion") if of_timeline else options.plan  # plan.npz is the plan
    path = exporting.default_path(beside, options.format) if options.out is None else options.out
    try_folder_of(path)
    given = {each.name: getattr(options, each.name) for each in fields(ExportNames)}
    try:
        written = exporting.export(
            plan,
            path,
            format=options.format,
            epoch=options.epoch,
            step_s=options.step,
            tolerance_deg=options.tolerance,
            observer=None if options.observer is None else load_observer(_file_of(options.observer)),
            names=ExportNames(**{key: value for key, value in given.items() if value is not None}),
            overwrite=options.force,
            **_forgiving(options),
        )
    except exporting.UncertifiedError as error:
        return complain(str(error), NOT_CERTIFIED if plan.ok else _code_of(plan))
    told = [f"wrote {written}", exporting.needed_by(plan, options.format)]
    if options.step == exporting.SPARSEST:
        told.append(_counted(written))
    say(": ".join(filter(None, told)))
    return DONE


def _counted(file: Path) -> str:
    """Tell how many rows and numbers a written table has; nothing where its format is not read back."""
    from jaxplan.tables import load_attitude

    try:
        table = load_attitude(file)
    except (ValueError, ImportError):  # CZML, or a reader that is not installed
        return ""
    return f"{len(table.times)} rows, {table.numbers} numbers"


def _observer(options: argparse.Namespace, plan: Plan | TimelinePlan) -> Satellite | None:
    """The orbit of the file that ``--observer`` names, for a plan with an epoch; None without that option."""
    name = options.observer
    if name is None:
        return None
    if plan.scenario.epoch is None:
        raise ValueError(f"--observer {name}: {options.plan} has no epoch, at which the orbit would be known")
    return load_observer(_file_of(name))


def _file_of(name: str) -> str:
    """The path of a scenario or timeline file, which may be an example by its name."""
    return str(case_path(name)) if name in (*CASE_NAMES, *TIMELINE_NAMES) else name


def _load_any_plan(name: str) -> Plan | TimelinePlan:
    """Read the plan of a file, of a scenario or a timeline; raises a ValueError if it is none."""
    return timelines.load_plan(name) if timelines.is_timeline_plan(name) else load_plan_file(name)


def _certified_anew(plan: Plan | TimelinePlan) -> Certificate:
    """The certificate of a plan, made anew."""
    return plan.certify() if isinstance(plan, TimelinePlan) else planner.certify(plan)


def _code_of(plan: Plan | TimelinePlan) -> int:
    """The exit code for a plan's status."""
    return {Status.OK: DONE, Status.UNCERTIFIED: NOT_CERTIFIED}.get(plan.status, NO_PLAN)


def load_scene(name: str) -> Scenario:
    """Read the scenario of a file, or a case of the paper by its name.

    Raises:
        ScenarioError: (a ValueError) for a scenario with faults.
        ValueError: if there is no such file, or it is no scenario file.
    """
    set_up_jax()
    timelines.refuse(name)
    cases = ", ".join(CASE_NAMES)
    if name in CASE_NAMES:
        return load_scenario(case_path(name))
    if not name:
        raise ValueError(f"SCENARIO is empty, it must name a file or one of {cases}")
    if not Path(name).exists():
        raise ValueError(
            f"{name}: no such file, and none of the cases {cases}; jaxplan new writes a file to begin with"
        )
    if Path(name).is_dir():
        raise ValueError(f"{name}: is a folder, name a scenario file in it")
    try:
        return load_scenario(name)
    except ScenarioError as error:
        if _first_character(name) == "{":
            raise ValueError(
                f"{name}: not TOML but JSON, as plan files are; jaxplan check, plot, report and export take "
                "those"
            ) from error
        raise


def load_plan_file(name: str) -> Plan:
    """Read the plan of a file.

    Raises:
        ValueError: if there is no such file, or it is no plan file.
    """
    set_up_jax()
    if not name:
        raise ValueError("PLAN is empty, it must name a plan.json")
    timelines.refuse(name)
    if _is_scenario(name):
        raise ValueError(
            f"{name}: is a scenario and no plan file; make out/plan.json of it with: jaxplan plan "
            f"{shlex.quote(name)} -o out"
        )
    if Path(name).is_dir():
        inside = Path(name) / "plan.json"
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
        if _first_character(name) not in (None, "{"):
            raise ValueError(f"{error}; jaxplan plan SCENARIO -o DIR makes plan files") from error
        raise


def _is_scenario(name: str) -> bool:
    """Whether a name is that of a case of the paper, or of a TOML file that exists."""
    return name in CASE_NAMES or (name.endswith(".toml") and Path(name).is_file())


def _first_character(name: str) -> str | None:
    """First character of a file that is no blank (plans have a brace, TOML never has); None if unreadable."""
    if not Path(name).is_file():  # what came through a pipe is gone
        return None
    try:
        with open(name, encoding="utf-8-sig", errors="replace") as file:
            return file.read(1000).lstrip()[:1]
    except OSError:
        return None
