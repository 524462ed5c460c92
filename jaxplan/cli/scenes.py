"""The commands ``new`` and ``validate`` on scenario files, and functions by which other commands read scenes.

A command takes the parsed arguments and returns the exit code.
"""

import argparse
import os
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from jaxplan.cases import CASE_NAMES, TIMELINE_NAMES, case_path
from jaxplan.cli import timelines
from jaxplan.cli.common import BAD_INPUT, DONE, NO_PLAN, print_result, say, set_up_jax, writable_file
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario, moves
from jaxplan.model.status import Status
from jaxplan.model.zones import masks
from jaxplan.planner import Plan
from jaxplan.planner.validity import contradictions, start_breaches
from jaxplan.runtime.files import Source, expect_replaceable, replacing_file
from jaxplan.runtime.progress import progress_bar
from jaxplan.schema import ScenarioError, load_scenario
from jaxplan.schema.faults import plural
from jaxplan.schema.text import template
from jaxplan.schema.timelines import timeline_template
from jaxplan.timeline.impossibilities import foreseen

_COUNTED_NOUNS = {  # what a scene, its spacecraft or a timeline has several of, with the noun for one of them
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

_IMPOSSIBLE_HEADING = "an activity cannot be done"  # heading of the reasons why activities are impossible


def new(options: argparse.Namespace) -> int:
    """Write a scenario or timeline file to begin with: a template, a case, an example, or from answers."""
    if options.ask and (options.source is not None or options.timeline):
        raise ValueError("--ask: makes a scenario of answers, so it goes without --from and --timeline")
    file = Path(options.file)
    if options.file != "-":
        if not options.file or options.file.endswith(os.sep) or file.is_dir():
            raise ValueError(f"{options.file or 'FILE'}: must name a file, such as {file / 'scene.toml'}")
        expect_replaceable(file, Source.SCENE)
        if file.exists() and not options.force:
            raise ValueError(f"{file}: is there already; take another name, or replace it with --force")
        writable_file(options.file)
    text = _text_from_answers(file) if options.ask else _source_text(options.source, options.timeline)
    if options.file == "-":
        print(text, end="")
        return DONE
    with replacing_file(file, kind=Source.SCENE) as fresh:
        fresh.write_text(text, encoding="utf-8")
    command = "timeline" if options.timeline or options.source in TIMELINE_NAMES else "plan"
    if options.ask:
        say(_format_findings(_check_file(str(file))))
    say(f"wrote {file}; plan it with: jaxplan {command} {shlex.quote(str(file))} -o out")
    return DONE


def _text_from_answers(file: Path) -> str:
    """Make the text of a scenario file from answers on stdin, one to a line; questions go to stderr."""
    from jaxplan.cli.interview import interview
    from jaxplan.cli.questions import Dialog

    set_up_jax()
    name = "scene" if file.name == "-" else file.stem
    return interview(Dialog(sys.stdin, sys.stderr, file.parent), name, _find_breaches)


def _source_text(source: str | None, timeline: bool) -> str:
    """Text of a template, or of a case that comes with the package.

    Args:
        source: name of the case; None for a template.
        timeline: whether it is of a timeline.

    Raises:
        ValueError: if there is no such case.
    """
    if source is None:
        return timeline_template() if timeline else template()
    known = TIMELINE_NAMES if timeline else (*CASE_NAMES, *TIMELINE_NAMES)
    if source not in known:
        raise ValueError(f"--from {source}: must be one of {', '.join(known)}")
    return case_path(source).read_text(encoding="utf-8")


def validate(options: argparse.Namespace) -> int:
    """Print for each file what it contains and what is wrong with it."""
    found = []
    with progress_bar("reading", "files", total=len(options.files)) as bar:
        for name in options.files:
            found.append(_check_file(name))
            bar.update()
    print_result(found if options.json else "\n".join(map(_format_findings, found)))
    if any(one["faults"] for one in found):
        return BAD_INPUT
    return DONE if all(one["valid"] for one in found) else NO_PLAN


def _check_file(name: str) -> dict[str, Any]:
    """Read a scenario or timeline file, and check it without planning.

    Returns:
        A dict for JSON, with the keys "file"; "valid"; "faults" of the text; "start" and "goal", what is
        violated there; "holds", the counts of `_contents`, None if the file is faulty; and for a timeline
        "activities", the reasons why activities are impossible.
    """
    found: dict[str, Any] = {"file": name, "valid": False, "faults": [], "start": [], "goal": []}
    try:
        if timelines.is_timeline(name):
            asked = timelines.load_timeline_file(name)
            start = list(start_breaches(replace(asked.scene, goal=asked.scene.start)))
            vain = list(foreseen(asked))
            holds = _contents(asked.scene) | {"activities": len(asked.activities)}
            return found | {
                "valid": not (start or vain),
                "start": start,
                "activities": vain,
                "holds": holds,
            }
        scene = load_scene(name)
    except ScenarioError as error:
        return found | {"faults": list(error.faults), "holds": None}
    except ValueError as error:  # it is not a scenario file
        return found | {"faults": [str(error).removeprefix(f"{name}: ")], "holds": None}
    start, goal = _find_breaches(scene)
    return found | {"valid": not (start or goal), "start": start, "goal": goal, "holds": _contents(scene)}


def _contents(scene: Scenario) -> dict[str, Any]:
    """Name of a scene, and the number of each thing in `_COUNTED_NOUNS` that it has."""
    everything = {**vars(scene), **vars(scene.spacecraft), "masks": masks(scene.spacecraft)}
    return {"name": scene.name, **{key: len(everything[key]) for key in _COUNTED_NOUNS if key in everything}}


def _find_breaches(scene: Scenario) -> tuple[list[str], list[str]]:
    """Check the two ends of a scenario without planning.

    A goal that is a given state is checked if nothing in the scene moves. Of targets only what is certain is
    told, without searching for a goal: that they are hidden, or inside zones of their own devices.

    Returns:
        Messages on the limits and zones that the start violates, and on what is wrong at the goal.
    """
    certain = contradictions(scene)
    if certain:
        return list(start_breaches(scene)), list(certain)
    goal = None
    if isinstance(scene.goal, GivenState) and not moves(scene):
        from jaxplan.planner.steps import find_goals

        goal = find_goals(scene)
    return list(start_breaches(scene)), [goal.message] if isinstance(goal, Plan) else []


def _format_findings(found: dict[str, Any]) -> str:
    """Text that presents what `_check_file` found in one file."""
    name, holds = found["file"], found["holds"]
    if holds is None:
        return str(ScenarioError(found["faults"], name or '""'))
    counted = [(key, holds[key]) for key in _COUNTED_NOUNS if holds.get(key)]
    parts = ", ".join(f"{number} {_inflect_noun(_COUNTED_NOUNS[key], number)}" for key, number in counted)
    broken = [
        f"\n  {status.value}: {'; '.join(found[place])}"
        for place, status in (("start", Status.INVALID_START), ("goal", Status.INVALID_GOAL))
        if found[place]
    ]
    broken += [f"\n  {_IMPOSSIBLE_HEADING}: {phrase}" for phrase in found.get("activities", ())]
    if broken:
        return f"{name}: {parts}{''.join(broken)}"
    return f"{name}: ok: {parts}; the start keeps all limits and zones"


def _inflect_noun(noun: str, number: int) -> str:
    """A noun in the singular or plural, as it stands after a number."""
    return noun if number == 1 else plural(noun)


def load_scene(name: str) -> Scenario:
    """Read a scenario from a file, or a case of the paper by its name.

    Raises:
        ScenarioError: (a ValueError) for a scenario with faults.
        ValueError: if there is no such file, or it is not a scenario file.
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
        if first_character(name) == "{":
            raise ValueError(
                f"{name}: not TOML but JSON, as plan files are; jaxplan check, plot, report and export take "
                "those"
            ) from error
        raise


def is_scenario(name: str) -> bool:
    """Tell whether a name is that of a case of the paper, or of an existing file whose name ends in .toml."""
    return name in CASE_NAMES or (name.endswith(".toml") and Path(name).is_file())


def first_character(name: str) -> str | None:
    """First character of a file that is not blank; plans begin with a brace, TOML files never do.

    Returns:
        The character; empty for a blank file, None if it is no regular file or cannot be read.
    """
    if not Path(name).is_file():  # a pipe cannot be read twice
        return None
    try:
        with open(name, encoding="utf-8-sig", errors="replace") as file:
            return file.read(1000).lstrip()[:1]
    except OSError:
        return None
