"""What the commands share: exit codes, files to read and folders to write, output."""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxplan.planner import Plan
    from jaxplan.status import Status

DONE, NO_PLAN, BAD_INPUT, NOT_CERTIFIED = 0, 1, 2, 3
MARK = "jaxplan"  # in the pictures that are ours


def code_of(status: "Status") -> int:
    """The exit code for how a plan ended."""
    return {"OK": DONE, "UNCERTIFIED": NOT_CERTIFIED}.get(status.name, NO_PLAN)


def complain(message: str, code: int) -> int:
    """Say what went wrong; returns the exit code."""
    print(f"jaxplan: {message}", file=sys.stderr)
    return code


def count(text: str) -> int:
    """A whole number of at least 1, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be a whole number, at least 1")
    return int(text)


def load(name: str) -> "Plan":
    """The plan of a file."""
    from jaxplan.planner import load_plan

    if not name:
        raise ValueError("PLAN is empty, it must name a plan.json")
    return load_plan(name)


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


def print_result(result: Any) -> None:
    """Results go to stdout."""
    print(json.dumps(result, indent=1) if isinstance(result, dict | list) else result)


def say(message: str) -> None:
    """Messages go to stderr."""
    print(message, file=sys.stderr)


def save(figure: Any, file: Path) -> None:
    """Write a figure whole or not at all, and say where."""
    from jaxplan.files import replacing_file

    with replacing_file(file) as fresh:
        figure.savefig(fresh, format="png", dpi=150, metadata={"Software": MARK})
    say(f"wrote {file}")


def set_up_jax() -> None:
    """Let JAX compute in the thread that asks: most kernels take less time than to hand them to another."""
    import jax

    jax.config.update("jax_cpu_enable_async_dispatch", False)
