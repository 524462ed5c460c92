"""Compiled kernels of this package, kept between processes as XLA's executables.

A *kernel* is a jitted function for arguments of certain kinds (shapes and types). JAX's own cache saves XLA's
part of compiling, but to find an entry there a kernel has to be traced and lowered again, which takes longer
than reading the executable. So executables are kept here, too, under a key made of all that they depend on:
the function, the kinds of its arguments, all sources of this package, and the versions and flags of Python,
numpy and JAX. They are in the folder of compiled code (`jaxplan.runtime.cache`), with a subfolder for each
state of the sources. Most changes of sources leave most *programs* (lowered kernels) as they are. So each
executable has a second name in the folder of programs, made from its program, under which it is found after a
change of sources once the kernel has been lowered. Each file also says whether the executable calls LAPACK,
which takes a tenth of a second to get ready. Whatever cannot be kept or read is compiled as usual.
"""

import hashlib
import os
import pickle
import shutil
import sys
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

from jaxplan.runtime.cache import processor_hash, trusted_folder, written_once
from jaxplan.runtime.files import replacing_file

_PACKAGE_FOLDER = Path(__file__).resolve().parent.parent
_LOCK_TIMEOUT = 30.0  # s, to wait for another process that compiles the same kernel but may have stopped
_LOCK_POLL_TIME = 0.02  # s, between two looks whether that process is done
_KEPT_FOLDERS = 3  # number of the newest folders of other sources or versions that are not deleted

_DIGEST_SIZE = 32  # bytes
_FORMAT_VERSION = 3  # version of the files' content, so that none of another version is read
_LIBRARY_CALL = "custom_call"  # occurs in the text of programs that call functions of a library
_PROGRAMS_FOLDER = "programs"  # folder of further names of executables, by what JAX has lowered

_refused_count = 0


def refused() -> int:
    """Return how many kept executables could not be loaded in this process, as happens on some processors."""
    return _refused_count


def load(name: str | None, kinds: str | None) -> Callable[..., Any] | None:
    """Read the executable of a kernel; None if it is not kept, or cannot be loaded, which `refused` counts.

    Args:
        name: name of the kernel, from `name_of`; None for one that is not kept.
        kinds: kinds of its arguments, from `text_of`; None for those of a kernel that is not kept.
    """
    global _refused_count
    place = _executable_path(name, kinds)
    if place is None or not place.is_file():
        return None
    found = _read_executable(place)
    if found is None:
        _refused_count += 1
    return found


def _read_executable(place: Path) -> Callable[..., Any] | None:
    """Read the executable in a file; if it is damaged or of another processor, delete it and return None."""
    from jax.experimental.serialize_executable import deserialize_and_load

    try:
        file = place.read_bytes()
        content = file[_DIGEST_SIZE:]
        if _digest(content) != file[:_DIGEST_SIZE]:  # XLA would run what is damaged
            raise ValueError("damaged")
        executable, calls_library = pickle.loads(content)
        if calls_library:
            _prepare_lapack()
        found: Callable[..., Any] = deserialize_and_load(*executable)
    except Exception:
        _delete_file(place)
        return None
    return found


def _digest(content: bytes) -> bytes:
    """Return the digest of a file's content, which stands before it."""
    return hashlib.sha256(content).digest()


@cache
def _prepare_lapack() -> None:
    """Register LAPACK's functions with XLA, which JAX does only when it lowers a kernel that calls them."""
    try:
        from jaxlib.lapack import prepare_lapack_call

        prepare_lapack_call("potrf_ffi", np.float64)  # prepares all of them, in half the time
    except Exception:  # as in a version of JAX that has the function elsewhere
        jax.jit(jax.lax.linalg.cholesky).lower(np.eye(1))


class _CacheHits(threading.local):
    """How often JAX has found something in its own cache, in this thread."""

    count = 0


_cache_hits = _CacheHits()


def _count_cache_hit(event: str, **_: str | int) -> None:
    """Count an event of JAX if it is a hit in JAX's own cache."""
    _cache_hits.count += event == "/jax/compilation_cache/cache_hits"


jax.monitoring.register_event_listener(_count_cache_hit)


def compile_and_keep(lowered: Any, name: str | None, kinds: str | None) -> Any:
    """Compile a lowered kernel, and keep the executable if there is a folder for it; return it.

    A program that was kept for other sources is read, and kept for these, too. What JAX found in its own
    cache is not kept, since XLA cannot serialise again what it has loaded. What is kept here is not written
    to JAX's cache.

    Args:
        lowered: the kernel, as ``jax.jit(...).lower`` returns it.
        name: as of `load`.
        kinds: as of `load`.
    """
    place = _executable_path(name, kinds)
    if place is None:
        return lowered.compile()
    code = lowered.as_text()
    text = f"{_FORMAT_VERSION}\n{_versions()}\n{kinds}\n{lowered.out_tree}\n{code}"
    program = place.parent.parent / _PROGRAMS_FOLDER / _hash_name(text)
    if program.is_file():
        found = _read_executable(program)
        if found is not None:
            with suppress(OSError):
                _prepare_folder(place.parent)
                os.link(program, place)
            return found
    hits = _cache_hits.count
    with written_once():
        compiled = lowered.compile()
    if _cache_hits.count == hits:
        _save_executable(place, compiled, calls_library=_LIBRARY_CALL in code)
        with suppress(OSError):  # without hard links it is found for these sources alone
            program.parent.mkdir(mode=0o700, exist_ok=True)
            os.link(place, program)
    return compiled


@contextmanager
def one_at_a_time(name: str | None, kinds: str | None) -> Iterator[None]:
    """Hold a lock within a with block, so that no two processes compile a kernel at once.

    A process that has waited should look again for what the other has kept. After `_LOCK_TIMEOUT` seconds it
    goes on without the lock. Arguments are those of `load`.
    """
    place = _executable_path(name, kinds)
    with ExitStack() as stack:
        if place is not None:
            with suppress(ImportError, OSError):  # where files cannot be locked, both compile
                import fcntl

                _prepare_folder(place.parent)
                lock = stack.enter_context(open(f"{place}.lock", "w"))
                until = time.monotonic() + _LOCK_TIMEOUT
                while time.monotonic() < until:
                    try:
                        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    except BlockingIOError:
                        time.sleep(_LOCK_POLL_TIME)
                        continue
                    stack.callback(_delete_file, lock.name)
                    break
        yield


def _delete_file(file: str | Path) -> None:
    """Delete a file; do nothing if that fails."""
    with suppress(OSError):
        os.unlink(file)


def _save_executable(place: Path, compiled: Any, *, calls_library: bool) -> None:
    """Write an executable to the file `place`, completely or not at all; nothing is raised if that fails.

    Args:
        place: path of the file.
        compiled: the executable.
        calls_library: whether it calls functions of a library, such as LAPACK's, which must be made ready
            before it is loaded.
    """
    from jax.experimental.serialize_executable import serialize

    with suppress(Exception):  # keeping executables only saves time
        content = pickle.dumps((serialize(compiled), calls_library))
        _prepare_folder(place.parent)
        with replacing_file(place, private=True) as new:
            new.write_bytes(_digest(content) + content)


def name_of(function: Any) -> str | None:
    """Return a function's full name, with what `partial` has bound; None if not in jaxplan's modules."""
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
    """Return the kinds of arguments as a text that is the same in every process; None if there is none."""
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


def _executable_path(name: str | None, kinds: str | None) -> Path | None:
    """Return the file of an executable, which may not exist yet; None where nothing is kept."""
    folder = trusted_folder()
    if name is None or kinds is None or folder is None or jax.default_backend() != "cpu":
        return None
    return folder / f"kernels-{_sources_hash()}" / _hash_name(f"{name}\n{kinds}")


def _hash_name(text: str) -> str:
    """Return a hash of a text as a file's name."""
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@cache
def _versions() -> str:
    """Return a text of versions, flags and processor, on which compiled code depends besides the program."""
    from jaxlib.version import __version__ as jaxlib_version

    versions = sys.version, np.__version__, jax.__version__, jaxlib_version
    return repr((versions, os.environ.get("XLA_FLAGS"), processor_hash()))


@cache
def _sources_hash() -> str:
    """Return a short hash of versions, flags and all sources of this package, for the name of a subfolder."""
    found = hashlib.sha256(_versions().encode())
    for file in sorted(_PACKAGE_FOLDER.rglob("*.py")):
        found.update(file.relative_to(_PACKAGE_FOLDER).as_posix().encode() + file.read_bytes())
    return found.hexdigest()[:12]


def _prepare_folder(part: Path) -> None:
    """Create the subfolder for executables of the present sources, and delete old ones of other sources.

    The `_KEPT_FOLDERS` newest of these are left. Programs that only the deleted ones had are deleted, too.
    """
    if part.is_dir():
        return
    part.mkdir(mode=0o700, exist_ok=True)
    others = sorted(part.parent.glob("kernels-*"), key=lambda folder: folder.stat().st_mtime)
    for old in others[: -1 - _KEPT_FOLDERS]:
        shutil.rmtree(old, ignore_errors=True)
    for program in (part.parent / _PROGRAMS_FOLDER).glob("*"):
        with suppress(OSError):
            if program.stat().st_nlink == 1:
                program.unlink()
