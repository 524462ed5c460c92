"""The commands on scenario files: ``new`` and ``validate``."""

import argparse
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxplan.cli.common import BAD_INPUT, DONE, NO_PLAN, command, load_scene, print_result, say, try_folder_of

if TYPE_CHECKING:
    from jaxplan.model.scenario import Scenario

_COUNTED = {  # what a scene and its spacecraft have several of, and what one of them is called
    "terminals": "terminal",
    "instruments": "instrument",
    "keep_out": "keep-out zone",
    "keep_in": "keep-in zone",
    "joint_bounds": "joint bound",
}


def add_commands(commands: Any) -> None:
    """Tell the parser of them."""
    new = command(
        commands,
        "new",
        _new,
        "write a scenario file to begin with",
        "Write a scenario file that can be planned as it is, with a comment on every option.",
    )
    new.add_argument("file", metavar="FILE", help="its name, such as scene.toml; - for stdout")
    new.add_argument(
        "--from", dest="source", metavar="CASE", help="copy a case of the paper instead, case-1 to case-4"
    )
    new.add_argument("--force", action="store_true", help="replace a file that is there")
    validate = command(
        commands,
        "validate",
        _validate,
        "say what is wrong with scenario files",
        "Say what scenario files hold, or all that is wrong with them, and whether each start "
        "(and goal, where it is a given state) keeps the limits and zones. Nothing is planned.",
    )
    validate.add_argument(
        "files", nargs="+", metavar="SCENARIO", help="a scenario file, or case-1 to case-4 of the paper"
    )
    validate.add_argument("--json", action="store_true", help="print what was found for machines")


def _new(options: argparse.Namespace) -> int:
    from jaxplan.runtime.files import replacing_file

    if options.file == "-":
        print(_text(options.source), end="")
        return DONE
    file = Path(options.file)
    if not options.file or options.file.endswith(os.sep) or file.is_dir():
        raise ValueError(f"{options.file or 'FILE'}: must name a file, such as {file / 'scene.toml'}")
    if file.exists() and not options.force:
        raise ValueError(f"{file}: is there already; take another name, or replace it with --force")
    try_folder_of(file)
    with replacing_file(file) as fresh:
        fresh.write_text(_text(options.source), encoding="utf-8")
    say(f"wrote {file}; plan it with: jaxplan plan {shlex.quote(str(file))} -o out")
    return DONE


def _text(source: str | None) -> str:
    """The template, or the file of a case."""
    from jaxplan.cases import CASE_NAMES, case_path
    from jaxplan.schema.text import template

    if source is None:
        return template()
    if source not in CASE_NAMES:
        raise ValueError(f"--from {source}: must be one of {', '.join(CASE_NAMES)}")
    return case_path(source).read_text(encoding="utf-8")


def _validate(options: argparse.Namespace) -> int:
    found = [_findings(name) for name in options.files]
    print_result(found if options.json else "\n".join(map(_line, found)))
    if any(one["faults"] for one in found):
        return BAD_INPUT
    return DONE if all(one["valid"] for one in found) else NO_PLAN


def _findings(name: str) -> dict[str, Any]:
    """Collect what a scenario file holds, its faults, and what its start and goal break."""
    from jaxplan.schema import ScenarioError

    found: dict[str, Any] = {"file": name, "valid": False, "faults": [], "start": [], "goal": []}
    try:
        scene = load_scene(name)
    except ScenarioError as error:
        return found | {"faults": list(error.faults), "holds": None}
    except ValueError as error:  # it is none at all
        return found | {"faults": [str(error).removeprefix(f"{name}: ")], "holds": None}
    start, goal = _breaches(scene)
    everything = {**vars(scene), **vars(scene.spacecraft)}
    holds = {"name": scene.name, **{key: len(everything[key]) for key in _COUNTED}}
    return found | {"valid": not (start or goal), "start": start, "goal": goal, "holds": holds}


def _breaches(scene: "Scenario") -> tuple[list[str], list[str]]:
    """List what the start breaks, and the goal where it is a given state among nothing that moves."""
    from jaxplan.model.scenario import GivenState, moves
    from jaxplan.planner import Plan
    from jaxplan.planner.steps import find_goals
    from jaxplan.planner.validity import start_breaches

    goal = None
    if isinstance(scene.goal, GivenState) and not moves(scene):
        goal = find_goals(scene)
    return list(start_breaches(scene)), [goal.message] if isinstance(goal, Plan) else []


def _line(found: dict[str, Any]) -> str:
    """The findings for a reader."""
    from jaxplan.model.status import Status
    from jaxplan.schema import ScenarioError

    name, holds = found["file"], found["holds"]
    if holds is None:
        return str(ScenarioError(found["faults"], name or '""'))
    counted = [(key, holds[key]) for key in _COUNTED if holds[key]]
    parts = ", ".join(f"{number} {_COUNTED[key]}{'' if number == 1 else 's'}" for key, number in counted)
    broken = [
        f"\n  {status.value}: {'; '.join(found[place])}"
        for place, status in (("start", Status.INVALID_START), ("goal", Status.INVALID_GOAL))
        if found[place]
    ]
    if broken:
        return f"{name}: {parts}{''.join(broken)}"
    return f"{name}: ok: {parts}; the start keeps all limits and zones"
