"""The folder in which compiled code is kept between processes: only the first of them ever waits for it.

It is the user's cache folder, ``~/.cache/jaxplan`` or that of ``XDG_CACHE_HOME``, with a part for each kind
of processor, since code for one may not run on another. It is used unless the user has told JAX otherwise,
and silently not where it cannot be written or may not be trusted: whoever can write there can have us run any
code. What JAX compiles for others in the same process is kept there, too.
"""

import hashlib
import math
import os
import stat
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from jaxplan.version import __version__

_LEAST_TIME = "jax_persistent_cache_min_compile_time_secs"

# JAX keeps by itself only what took a second to compile, and most kernels here take less.
_KEEP_ALL = {
    _LEAST_TIME: 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}
_SETTINGS = ("jax_compilation_cache_dir", *_KEEP_ALL)

_decided = False


def compilation_cache(folder: str | os.PathLike[str] | None) -> None:
    """Keep compiled code in another folder, or in none.

    What JAX compiles is by default kept between processes in the user's cache folder. An environment variable
    JAX_COMPILATION_CACHE_DIR, or the setting of ``jax.config`` with this name, moves it, too; JAX then keeps
    only what took a second to compile, unless it is told otherwise.

    Args:
        folder: made, for this user alone, if it does not exist; None to keep nothing. Whoever can write there
            can run code in this process.

    Raises:
        OSError: if it cannot be made.
        TypeError: if it is no path.
        ValueError: if it is empty or a file, nothing can be written there, or others than the user may write
            there or, without the sticky bit, in a folder above it.

    Example:
        >>> jp.compilation_cache("/scratch/compiled")
        >>> jp.compilation_cache(None)
    """
    if not (folder is None or isinstance(folder, str | os.PathLike)):
        raise TypeError(f"folder must be a path, or None to keep nothing, not {type(folder).__name__}")
    if folder is not None and not os.fspath(folder):
        raise ValueError("folder is empty: name one, or pass None to keep nothing")
    place = None if folder is None else Path(folder).expanduser().absolute()
    if place is not None:
        try:
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            why_not = _fault(place)
        except FileExistsError:
            why_not = "it is a file: name a folder"
        if why_not:
            raise ValueError(f"folder = {os.fspath(place)!r}: {why_not}")
    _use({"jax_compilation_cache_dir": None if place is None else str(place), **_KEEP_ALL})


def keep_by_default() -> None:
    """Keep compiled code in the user's cache folder, unless somebody has decided otherwise."""
    import jax

    global _decided
    if _decided or jax.config.jax_compilation_cache_dir is not None:  # type: ignore[attr-defined]
        return
    _decided = True
    try:
        place = _users_folder()
        if not place.is_absolute():  # as where HOME is not: each folder would get its own
            return
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _fault(place):
            return
    except (OSError, RuntimeError):  # the latter where nobody has a home
        return  # it only saves time
    _use({"jax_compilation_cache_dir": str(place), **_KEEP_ALL})


def trusted_folder() -> Path | None:
    """The folder in which JAX keeps what it compiles, if nobody but this user can write there."""
    import jax

    named = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    if not named or not os.path.isabs(named):  # none, or one in some cloud
        return None
    place = Path(named)
    try:
        return place if place.is_dir() and not _fault_once(named) else None
    except OSError:
        return None


@cache
def _fault_once(named: str) -> str:
    """`_fault` of the folder of this name, looked up once in a process."""
    return _fault(Path(named))


def settings() -> dict[str, object]:
    """The settings of JAX for where and how this process keeps compiled code, for `adopt` in another one."""
    import jax

    keep_by_default()
    with _turn:
        found = {name: getattr(jax.config, name) for name in _SETTINGS}
    if _blocks and found[_LEAST_TIME] == math.inf:
        found[_LEAST_TIME] = _usual
    return found


def adopt(given: dict[str, object]) -> None:
    """Keep compiled code as another process does, by its `settings`."""
    _use(given)


_blocks = 0  # those of `written_once` that have begun and not ended, in all threads
_usual = 0.0  # what the setting was before the first of them
_turn = threading.Lock()


@contextmanager
def written_once() -> Iterator[None]:
    """Let JAX write nothing into its own cache while a block, or one like it in another thread, runs.

    To write an executable there takes as long as here: it is made a text of bytes, and packed.
    """
    import jax

    global _blocks, _usual
    with _turn:
        if not _blocks:
            _usual = getattr(jax.config, _LEAST_TIME)
            jax.config.update(_LEAST_TIME, math.inf)
        _blocks += 1
    try:
        yield
    finally:
        with _turn:
            _blocks -= 1
            if not _blocks and getattr(jax.config, _LEAST_TIME) == math.inf:  # nobody has set it meanwhile
                jax.config.update(_LEAST_TIME, _usual)


def _use(given: dict[str, object]) -> None:
    """Set these settings of JAX by name, and note that the folder has been decided on."""
    import jax
    from jax.experimental.compilation_cache import compilation_cache as cache

    global _decided
    _decided = True
    moved = given["jax_compilation_cache_dir"] != jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    for name, value in given.items():
        jax.config.update(name, value)
    if moved:
        cache.reset_cache()  # which looks at the setting only once
    # Entries that are damaged, or were written by another processor, are compiled again: no more than that.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache", UserWarning)


def _users_folder() -> Path:
    """The subfolder of the user's cache folder for this version of jaxplan on this kind of processor."""
    chosen = os.environ.get("XDG_CACHE_HOME", "")
    root = Path(chosen) if os.path.isabs(chosen) else Path.home() / ".cache"  # as its specification asks
    return root / "jaxplan" / f"compiled-{__version__}-{_processor()}"


def _processor() -> str:
    """A short hash of the instruction sets of this processor; where they cannot be read, of none."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            known = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:  # no Linux: machines that share a folder are rare there
        known = ""
    return hashlib.sha256(" ".join(sorted(known.split())).encode()).hexdigest()[:8]


def _others_may_swap(found: os.stat_result) -> bool:
    """Whether others than the user and root may rename what is in a folder, or redirect a link; by `lstat`.

    Where the sticky bit is set, as in /tmp, everybody renames only what is theirs. A group of the user alone,
    as some systems give to everybody, is no others.
    """
    if found.st_uid not in (0, os.geteuid()):
        return True
    if stat.S_ISLNK(found.st_mode) or found.st_mode & stat.S_ISVTX:
        return False
    group = found.st_mode & stat.S_IWGRP and not _is_the_users_alone(found.st_gid)
    return bool(group or found.st_mode & stat.S_IWOTH)


def _is_the_users_alone(group: int) -> bool:
    """Whether the group of this number is called like the user, and nobody else has been added to it."""
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_name == user.pw_name and set(found.gr_mem) <= {user.pw_name}


def _fault(place: Path) -> str:
    """Why compiled code cannot be kept in a folder, as words for a message; empty if it can."""
    found = place.stat()
    if found.st_uid != os.geteuid() or found.st_mode & 0o022:
        return "others may write there, and so have us run any code: make it the user's own, with mode 700"
    for way in (place, place.resolve()):
        for parent in way.parents:
            if _others_may_swap(parent.lstat()):
                return (
                    f"others may write in {parent}, so put one of theirs in the place of this one, and have "
                    "us run any code: take that right from them, or choose another place"
                )
    return "" if os.access(place, os.W_OK | os.X_OK) else "nothing can be written there"
