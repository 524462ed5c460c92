"""What all commands share: exit codes, output, folders to write to, and how JAX is set up."""

import json
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from glob import escape
from pathlib import Path
from typing import Any

from jaxplan.runtime.progress import progress_bar

DONE, NO_PLAN, BAD_INPUT, NOT_CERTIFIED = 0, 1, 2, 3
MARK = "jaxplan"  # what the PNG files that we write name as their software; others are never removed


def complain(message: str, code: int) -> int:
    """Print what went wrong to stderr; returns the exit code."""
    print(f"jaxplan: {message}", file=sys.stderr)
    return code


def writable_folder(name: str) -> Path:
    """Make a folder for results, with its parents, and try to write a temporary file there.

    Returns:
        Its path.

    Raises:
        ValueError: if the name is empty or that of a file, or nothing can be written there.
    """
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
    """Make the folder that a file is to stand in, as `writable_folder` does, before anything is computed."""
    writable_folder(str(Path(path).parent))


def print_result(result: Any) -> None:
    """Print a result to stdout: a dict or list as JSON, all else as text."""
    print(json.dumps(result, indent=1) if isinstance(result, dict | list) else result)


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Show warnings for users within a `with` block as sentences on stderr, without a line of code."""
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def tell(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, UserWarning):
                say(f"jaxplan: warning: {message}")
            else:
                usual(message, category, *where, **more)

        warnings.showwarning = tell
        yield


def say(message: str) -> None:
    """Print a message to stderr."""
    print(message, file=sys.stderr)


def save(figure: Any, file: Path, tell: Callable[[str], None] = say) -> None:
    """Write a figure as PNG, whole or not at all, and tell the file's name, if not otherwise on stderr."""
    from jaxplan.plotting import write_png
    from jaxplan.runtime.files import replacing_file

    with replacing_file(file) as fresh:
        write_png(figure, fresh, MARK)
    tell(f"wrote {file}")


def draw(plan: Any, folder: Path, frequencies: Sequence[float] = (), observer: Any = None) -> None:
    """Write every figure that a plan has to a folder, and remove those of an earlier plan that it has not.

    A bar on stderr names the figure that is being drawn, and counts.

    Args:
        plan: of a scenario or of a timeline.
        folder: there is one.
        frequencies: Hz, of modes; with some, one figure is the spectrum of the torque.
        observer: the spacecraft's orbit, with which there are figures in its frame and the ground track.
    """
    from jaxplan import plotting

    every = plotting.drawings(plan, frequencies, observer)
    with progress_bar("drawing", "figures", total=len(every)) as bar:
        for name, make in every:
            bar.step(name.replace("_", " "))
            save(make(), folder / f"{name}.png", bar.say)
            bar.update()
    for name in sorted(set(plotting.FIGURE_NAMES) - {name for name, _ in every}):
        file = folder / f"{name}.png"
        if file.is_file() and MARK.encode() in file.read_bytes()[:200]:  # a picture of somebody else stays
            file.unlink()
            say(f"removed {file}, which was of an earlier plan")


def name_earlier(plan_file: Path, exports: Sequence[Path] = ()) -> None:
    """Name on stderr what was made of the plan that was in a file before: its reports, pages and tables.

    They are not removed, for somebody has asked for each of them.

    Args:
        plan_file: with the plan.
        exports: where exports of an earlier plan may be, none of them of the plan itself.
    """
    own = plan_file.name, plan_file.with_suffix(".timings.json").name
    found = sorted(plan_file.parent.glob(f"{escape(plan_file.stem)}.*"))
    old = [str(file) for file in found if file.name not in own and file.is_file()]
    old += [str(path) for path in exports if path.exists()]
    if old:
        say(f"{', '.join(old)}: of an earlier plan, make {'it' if len(old) == 1 else 'them'} anew")


def set_up_jax() -> None:
    """Make JAX compute in the calling thread: most kernels take less time than handing them to another."""
    import jax

    jax.config.update("jax_cpu_enable_async_dispatch", False)
