"""What all commands share: parser, exit codes, terminal output, folders, figures, and settings of JAX.

The parser's error messages suggest what may have been meant.
"""

import argparse
import difflib
import json
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from glob import escape
from pathlib import Path
from typing import Any, NoReturn

from jaxplan.runtime.progress import Bar, progress_bar

DONE, NO_PLAN, BAD_INPUT, NOT_CERTIFIED = 0, 1, 2, 3  # exit codes
MARK = "jaxplan"  # software named in the PNG files written here; only files with it are ever removed


def complain(message: str, code: int) -> int:
    """Print an error message to stderr; returns `code`, the exit code."""
    print(f"jaxplan: {message}", file=sys.stderr)
    return code


def writable_folder(name: str) -> Path:
    """Make a folder for results, with its parents, and check that files can be written there.

    Returns:
        The folder's path.

    Raises:
        ValueError: if the name is empty, ``-`` or that of a file, or nothing can be written there.
    """
    if not name:
        raise ValueError("DIR of -o is empty, it must name a folder")
    refuse_stdout(name)
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


def writable_file(name: str | Path, *inputs: str | None) -> None:
    """Make the folder that a file is to be in, and check that the file can be written there.

    Args:
        name: path of the file; an existing one passes.
        *inputs: files that the command reads, or names of cases; None for one that is not given.

    Raises:
        ValueError: if the name is ``-``, or that of one of these files, or nothing can be written there.
    """
    refuse_stdout(str(name))
    path = Path(name)
    for given in inputs:
        if given is not None and path.exists() and Path(given).exists() and path.samefile(given):
            raise ValueError(f"-o {name}: is what this command reads, take another name")
    writable_folder(str(path.parent))


def refuse_stdout(name: str) -> None:
    """Raise a ValueError for ``-``, which many programs take for stdout."""
    if name == "-":
        raise ValueError(
            "-o -: must be a name, since only jaxplan new writes a file to stdout; ./- is a name"
        )


def print_result(result: Any) -> None:
    """Print a result to stdout: a dict or list as JSON, all else as text."""
    print(json.dumps(result, indent=1) if isinstance(result, dict | list) else result)


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Within a `with` block, show each UserWarning on stderr without the line of code that raised it."""
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


def save(figure: Any, file: Path) -> None:
    """Write a figure of matplotlib to a PNG file, as a whole or not at all, and tell its name on stderr.

    An existing file is replaced.
    """
    from jaxplan.plotting import draw_png

    say(_write(draw_png(figure, MARK), file))


def _write(picture: Callable[[Path], None], file: Path) -> str:
    """Have a picture written to a file, as a whole or not at all; return the message that it is."""
    from jaxplan.runtime.files import replacing_file

    with replacing_file(file) as fresh:
        picture(fresh)
    return f"wrote {file}"


def draw(plan: Any, folder: Path, frequencies: Sequence[float] = (), observer: Any = None) -> None:
    """Write all figures of a plan to a folder as PNG, and remove those that only an earlier plan had.

    A progress bar on stderr names the figure being drawn. Meanwhile a thread writes the figure before it.

    Args:
        plan: of a scenario or of a timeline.
        folder: an existing folder.
        frequencies: Hz, of structural modes, marked in a figure of the torque's spectrum; there is no such
            figure without them.
        observer: the spacecraft's orbit, for figures in the local orbital frame and the ground track; None to
            leave these out.
    """
    from concurrent.futures import Future, ThreadPoolExecutor

    from jaxplan import plotting

    def tell(bar: Bar, done: Future[str]) -> None:
        bar.say(done.result())
        bar.update()

    every = plotting.drawings(plan, frequencies, observer)
    with progress_bar("drawing", "figures", total=len(every)) as bar, ThreadPoolExecutor(1) as writer:
        written: list[Future[str]] = []
        for name, make in every:
            bar.step(name.replace("_", " "))
            picture = plotting.draw_png(make(), MARK)
            written.append(writer.submit(_write, picture, folder / f"{name}.png"))
            if len(written) > 1:
                tell(bar, written[-2])
        for last in written[-1:]:
            tell(bar, last)
    for name in sorted(set(plotting.FIGURE_NAMES) - {name for name, _ in every}):
        file = folder / f"{name}.png"
        if file.is_file() and MARK.encode() in file.read_bytes()[:200]:  # other pictures are kept
            file.unlink()
            say(f"removed {file}, which was of an earlier plan")


def name_earlier(plan_file: Path, exports: Sequence[Path] = ()) -> None:
    """Name on stderr the files made from an earlier plan in the same file: its reports, pages and tables.

    They are not removed, since the user asked for each of them.

    Args:
        plan_file: file of the plan; files whose names begin alike are named.
        exports: files in which exports of an earlier plan may be.
    """
    own = plan_file.name, plan_file.with_suffix(".timings.json").name
    found = sorted(plan_file.parent.glob(f"{escape(plan_file.stem)}.*"))
    old = [str(file) for file in found if file.name not in own and file.is_file()]
    old += [str(path) for path in exports if path.exists()]
    if old:
        say(f"{', '.join(old)}: of an earlier plan, make {'it' if len(old) == 1 else 'them'} anew")


def set_up_jax() -> None:
    """Make JAX compute in the calling thread, since most kernels take less time than a change of thread."""
    import jax

    jax.config.update("jax_cpu_enable_async_dispatch", False)


def report_refused_kernels() -> None:
    """Say on stderr how many kernels that earlier processes compiled could not be used, if any."""
    executables = sys.modules.get("jaxplan.runtime.kernel_files")  # imported only if anything was computed
    refused = executables.refused() if executables is not None else 0
    if refused:
        print(
            f"jaxplan: {refused} of the kernels that earlier runs had kept were damaged, or refused by XLA "
            "as on some processors, and compiled again; jp.compilation_cache chooses another folder for them",
            file=sys.stderr,
        )


class Parser(argparse.ArgumentParser):
    """A parser that reports unknown arguments with the usage of the subcommand, and points to its help."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and what is wrong with the arguments, and exit with `BAD_INPUT`."""
        self.print_usage(sys.stderr)
        self.exit(BAD_INPUT, f"{self.prog}: error: {message}; see {self.prog} --help\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments as argparse does, but treat an unknown one as an error instead of returning it."""
        known, left = super().parse_known_args(args, namespace)
        if left:
            self.error(f"unrecognized arguments: {' '.join(left)}{self._suggestion_for(left[0])}")
        return known, left

    def _suggestion_for(self, word: str) -> str:
        """Advice on an unknown word, to end a message: a similar option, or how to name an output file.

        Returns:
            The advice, which begins with a comma or semicolon; empty if there is none.
        """
        options = self._option_string_actions
        if word.startswith("-"):
            close = difflib.get_close_matches(word.partition("=")[0], list(options), n=1)
            return f", perhaps {close[0]} is meant" if close else ""
        return f"; what is written is named by -o {word}" if "." in word and "-o" in options else ""
