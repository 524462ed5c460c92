"""Compiled kernels of this package, kept between processes as what XLA made of them.

JAX's own cache of compiled code saves XLA's part, but to find an entry there a kernel has to be traced and
lowered again, which takes longer than reading what was compiled. So executables are kept, too, by what they
follow from: the function, the kinds of its arguments, all sources of this package, and the versions and flags
of Python, numpy and JAX. They lie in the folder of compiled code (`jaxplan.runtime.cache`), those of other
sources in parts of their own. Most changes of sources leave most programs as they are: each has another name
in the folder of programs, by which other sources find it once they have lowered it, too. Beside each stands
whether it calls LAPACK, which takes a tenth of a second to get ready. Whatever cannot be kept or read is
compiled as ever.
"""

import hashlib
import os
import pickle
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from types import EllipsisType
from typing import Any

import jax
import numpy as np

from jaxplan.runtime.cache import trusted_folder, written_once

_PACKAGE = Path(__file__).resolve().parent.parent
_PATIENCE = 30.0  # s; then a kernel is compiled though another process, perhaps a stopped one, is at it
_LOOK = 0.02  # s, between two looks whether it is done
_PARTS = 3  # folders of other sources or versions that are left, the newest ones

_FORM = 2  # of the content of files, so that none of another form is read
_CALL = "custom_call"  # in the text of programs that call functions of a library
_PROGRAMS = "programs"  # folder of further names of executables, by what JAX has lowered

_refused = 0


def refused() -> int:
    """How many kept executables XLA has refused to load in this process, as it does on some processors."""
    return _refused


def load(name: str | None, kinds: str | None) -> Callable[..., Any] | None:
    """Read the executable of a kernel; None if it has not been kept, or is refused, which `refused` counts.

    Args:
        name: the kernel's, by `name_of`; None for one that is not kept.
        kinds: the kinds of its arguments, by `text_of`; None likewise.
    """
    global _refused
    place = _place(name, kinds)
    if place is None or not place.is_file():
        return None
    found = _read(place)
    if found is None:
        _refused += 1
    return found


def _read(place: Path) -> Callable[..., Any] | None:
    """Read the executable in a file; None, and the file deleted, if it is damaged or of another processor."""
    from jax.experimental.serialize_executable import deserialize_and_load

    try:
        content, calls_library = pickle.loads(place.read_bytes())
        if calls_library:
            _prepare_lapack()
        found: Callable[..., Any] = deserialize_and_load(*content)
    except Exception:
        _forget(place)
        return None
    return found


@cache
def _prepare_lapack() -> None:
    """Hand LAPACK's functions to XLA, which JAX does only when it lowers a kernel that calls them."""
    try:
        from jaxlib.lapack import prepare_lapack_call

        prepare_lapack_call("potrf_ffi", np.float64)  # all of them, in half the time
    except Exception:  # as where another version of JAX has another place for it
        jax.jit(jax.lax.linalg.cholesky).lower(np.eye(1))


class _Hits(threading.local):
    """How often JAX has found something in its own cache, in a thread."""

    count = 0


_hits = _Hits()


def _listen(event: str, **_: str | int) -> None:
    """Count a hit in JAX's own cache, for events of that name."""
    _hits.count += event == "/jax/compilation_cache/cache_hits"


jax.monitoring.register_event_listener(_listen)


def compile_and_keep(lowered: Any, name: str | None, kinds: str | None) -> Any:
    """Compile a kernel that has been lowered, and keep the executable if there is a folder for it.

    A program that was kept for other sources is read, and kept for these, too. What JAX had in its own cache
    is not kept: XLA cannot write down again what it has read. What is kept here JAX does not keep once more.

    Args:
        lowered: the kernel, by ``jax.jit(...).lower``.
        name: as of `load`.
        kinds: as of `load`.
    """
    place = _place(name, kinds)
    if place is None:
        return lowered.compile()
    code = lowered.as_text()
    text = f"{_FORM}\n{_versions()}\n{kinds}\n{lowered.out_tree}\n{code}"
    program = place.parent.parent / _PROGRAMS / _short(text)
    if program.is_file():
        found = _read(program)
        if found is not None:
            with suppress(OSError):
                _make_room(place.parent)
                os.link(program, place)
            return found
    hits = _hits.count
    with written_once():
        compiled = lowered.compile()
    if _hits.count == hits:
        _save(place, compiled, calls_library=_CALL in code)
        with suppress(OSError):  # where files have one name only, it is for these sources alone
            program.parent.mkdir(mode=0o700, exist_ok=True)
            os.link(place, program)
    return compiled


@contextmanager
def one_at_a_time(name: str | None, kinds: str | None) -> Iterator[None]:
    """Hold a lock in a block, so that no two processes compile a kernel at once; arguments as of `load`.

    A process that has waited for the lock is to look again for what the other has kept. After `_PATIENCE`
    seconds it goes on without the lock.
    """
    place = _place(name, kinds)
    with ExitStack() as stack:
        if place is not None:
            with suppress(ImportError, OSError):  # where files cannot be locked, both compile
                import fcntl

                _make_room(place.parent)
                lock = stack.enter_context(open(f"{place}.lock", "w"))
                until = time.monotonic() + _PATIENCE
                while time.monotonic() < until:
                    try:
                        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    except BlockingIOError:
                        time.sleep(_LOOK)
                        continue
                    stack.callback(_forget, lock.name)
                    break
        yield


def _forget(file: str | Path) -> None:
    """Delete a file, if it can be."""
    with suppress(OSError):
        os.unlink(file)


def _save(place: Path, compiled: Any, *, calls_library: bool) -> None:
    """Write an executable to the file `place`, whole or not at all; nothing is raised where that fails.

    Args:
        place: of the file.
        compiled: the executable.
        calls_library: whether it calls functions of a library, such as LAPACK's, which must be ready then.
    """
    from jax.experimental.serialize_executable import serialize

    with suppress(Exception):  # it only saves time
        content = pickle.dumps((serialize(compiled), calls_library))
        _make_room(place.parent)
        with tempfile.NamedTemporaryFile(dir=place.parent, delete=False) as new:  # for this user alone
            new.write(content)
        os.replace(new.name, place)


def name_of(function: Any) -> str | None:
    """The full name of a function, with what `partial` has bound; None if it is not of jaxplan's modules."""
    if isinstance(function, partial):
        values = [function.func, *function.args, *(value for _, value in sorted(function.keywords.items()))]
        parts = [text_of(one) for one in values]
        keys = ",".join(sorted(function.keywords))
        return None if None in parts else f"{', '.join(filter(None, parts))} ({keys})"
    module, name = getattr(function, "__module__", ""), getattr(function, "__qualname__", "")
    found: Any = getattr(sys.modules.get(module), name, None)  # nothing, for what a program makes on its way
    known = found is function or getattr(found, "__wrapped__", None) is function
    return f"{module}.{name}" if known and module.startswith("jaxplan.") else None


def text_of(kinds: object) -> str | None:
    """The kinds of arguments as text, the same in every process; None where some cannot be put so."""
    if kinds is None or isinstance(kinds, bool | int | float | str | np.dtype | EllipsisType):
        return repr(kinds)
    if isinstance(kinds, type):
        return f"{kinds.__module__}.{kinds.__qualname__}"
    if isinstance(kinds, jax.tree_util.PyTreeDef):
        text = str(kinds)
        return None if " at 0x" in text else text
    if is_dataclass(kinds):
        kinds = (type(kinds), *(getattr(kinds, field.name) for field in fields(kinds)))
    if callable(kinds):
        return name_of(kinds)
    if not isinstance(kinds, tuple):
        return None
    parts = [text_of(part) for part in kinds]
    return None if None in parts else f"({', '.join(filter(None, parts))})"


def _place(name: str | None, kinds: str | None) -> Path | None:
    """The file of an executable; None where nothing is kept."""
    folder = trusted_folder()
    if name is None or kinds is None or folder is None or jax.default_backend() != "cpu":
        return None
    return folder / f"kernels-{_origin()}" / _short(f"{name}\n{kinds}")


def _short(text: str) -> str:
    """A file's name for a long text."""
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@cache
def _versions() -> str:
    """Versions and flags that compiled code depends on besides the program, as text."""
    from jaxlib.version import __version__ as jaxlib_version

    versions = sys.version, np.__version__, jax.__version__, jaxlib_version
    return repr((versions, os.environ.get("XLA_FLAGS")))


@cache
def _origin() -> str:
    """A short hash of all that executables depend on: versions, flags and the sources of this package."""
    found = hashlib.sha256(_versions().encode())
    for file in sorted(_PACKAGE.rglob("*.py")):
        found.update(file.relative_to(_PACKAGE).as_posix().encode() + file.read_bytes())
    return found.hexdigest()[:12]


def _make_room(part: Path) -> None:
    """Make the folder `part` for executables of today's sources; delete all but the newest of other sources.

    Programs that only the deleted ones had go with them.
    """
    if part.is_dir():
        return
    part.mkdir(mode=0o700, exist_ok=True)
    others = sorted(part.parent.glob("kernels-*"), key=lambda folder: folder.stat().st_mtime)
    for old in others[: -1 - _PARTS]:
        shutil.rmtree(old, ignore_errors=True)
    for program in (part.parent / _PROGRAMS).glob("*"):
        with suppress(OSError):
            if program.stat().st_nlink == 1:
                program.unlink()
