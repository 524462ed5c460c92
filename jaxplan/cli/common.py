"""What the commands share: exit codes, files to read and folders to write, output."""

import argparse
import json
import shlex
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from jaxplan.model.scenario import Scenario
    from jaxplan.model.status import Status
    from jaxplan.planner import Plan

DONE, NO_PLAN, BAD_INPUT, NOT_CERTIFIED = 0, 1, 2, 3
MARK = "jaxplan"  # in the pictures that are ours


def code_of(status: "Status") -> int:
    """The exit code for how a plan ended."""
    return {"OK": DONE, "UNCERTIFIED": NOT_CERTIFIED}.get(status.name, NO_PLAN)


def complain(message: str, code: int) -> int:
    """Say what went wrong; returns the exit code."""
    print(f"jaxplan: {message}", file=sys.stderr)
    return code


class Parser(argparse.ArgumentParser):
    """A parser whose errors are of the command that was given, and name its help."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the words, and end."""
        self.print_usage(sys.stderr)
        self.exit(BAD_INPUT, f"{self.prog}: error: {message}; see {self.prog} --help\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """The words by their meaning, of which none may be left."""
        known, left = super().parse_known_args(args, namespace)
        if left:
            self.error(f"unrecognized arguments: {' '.join(left)}")
        return known, left


def command(commands: Any, name: str, run: Callable[[Any], int], help: str, description: str) -> Any:
    """Add a command to a parser's, and say what runs it; returns the parser of its words."""
    parser = commands.add_parser(name, help=help, description=description)
    parser.set_defaults(run=run)
    return parser


def count(text: str) -> int:
    """A whole number of at least 1, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a whole number, at least 1")
    return int(text)


def load_scene(name: str) -> "Scenario":
    """The scenario of a file, or a case of the paper."""
    set_up_jax()
    from jaxplan.cases import CASE_NAMES, case_path
    from jaxplan.schema import ScenarioError, load_scenario

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


def load(name: str) -> "Plan":
    """The plan of a file."""
    set_up_jax()
    from jaxplan.cases import CASE_NAMES
    from jaxplan.planner import PlanFileError, load_plan

    if not name:
        raise ValueError("PLAN is empty, it must name a plan.json")
    if name in CASE_NAMES or (name.endswith(".toml") and Path(name).is_file()):
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
        return load_plan(name)
    except PlanFileError as error:
        if name.endswith(".timings.json"):
            plan = name.removesuffix(".timings.json") + ".json"
            raise ValueError(f"{name}: holds the timings of a plan, perhaps {plan} is meant") from error
        if _first_character(name) not in (None, "{"):
            raise ValueError(f"{error}; jaxplan plan SCENARIO -o DIR makes plan files") from error
        raise


def _first_character(name: str) -> str | None:
    """The first one of a file that is not blank: of plans a brace, and never of TOML; None if unread."""
    if not Path(name).is_file():  # what came through a pipe is gone
        return None
    try:
        with open(name, encoding="utf-8-sig", errors="replace") as file:
            return file.read(1000).lstrip()[:1]
    except OSError:
        return None


def writable_folder(name: str) -> Path:
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


def try_folder_of(path: str | Path) -> None:
    """Make and try the folder of a file that shall be written, before anything is computed for it."""
    writable_folder(str(Path(path).parent))


def print_result(result: Any) -> None:
    """Results go to stdout."""
    print(json.dumps(result, indent=1) if isinstance(result, dict | list) else result)


def say(message: str) -> None:
    """Messages go to stderr."""
    print(message, file=sys.stderr)


def save(figure: Any, file: Path) -> None:
    """Write a figure whole or not at all, and say where."""
    from jaxplan.runtime.files import replacing_file

    with replacing_file(file) as fresh:
        figure.savefig(fresh, format="png", dpi=150, metadata={"Software": MARK})
    say(f"wrote {file}")


def set_up_jax() -> None:
    """Let JAX compute in the thread that asks: most kernels take less time than to hand them to another."""
    import jax

    jax.config.update("jax_cpu_enable_async_dispatch", False)
