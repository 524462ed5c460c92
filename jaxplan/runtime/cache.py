"""The folder in which compiled code is kept between processes, so that only the first one waits for it.

It is the user's cache folder, ``~/.cache/jaxplan`` or the one in ``XDG_CACHE_HOME``, with a subfolder for
each kind of processor, since code for one may not run on another. It is used unless the user has configured
JAX otherwise. It is silently not used where it cannot be written, or where others can write: they could make
this process run any code. What JAX compiles for other code in the process is kept there, too.
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

_COMPILE_TIME_SETTING = "jax_persistent_cache_min_compile_time_secs"

# By default, JAX keeps only what took a second to compile, and most kernels here take less.
_KEEP_ALL = {
    _COMPILE_TIME_SETTING: 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}
_SETTING_NAMES = ("jax_compilation_cache_dir", *_KEEP_ALL)

_is_folder_decided = False


def compilation_cache(folder: str | os.PathLike[str] | None) -> None:
    """Keep compiled code in another folder, or nowhere.

    By default, what JAX compiles is kept between processes in the user's cache folder. The environment
    variable JAX_COMPILATION_CACHE_DIR, or the setting of this name in ``jax.config``, moves it, too; JAX then
    keeps only what took a second to compile, unless it is told otherwise.

    Args:
        folder: created, for this user alone, if it does not exist; None to keep nothing. Whoever can write
            there can run code in this process.

    Raises:
        OSError: if it cannot be created.
        TypeError: if it is no path.
        ValueError: if it is empty or a file; if nothing can be written there; if others than the user may
            write there or, without the sticky bit, in a folder above it.

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
            why_not = _folder_fault(place)
        except FileExistsError:
            why_not = "it is a file: name a folder"
        if why_not:
            raise ValueError(f"folder = {os.fspath(place)!r}: {why_not}")
    _apply_settings({"jax_compilation_cache_dir": None if place is None else str(place), **_KEEP_ALL})


def keep_by_default() -> None:
    """Keep compiled code in the user's cache folder, unless that has been decided otherwise already."""
    import jax

    global _is_folder_decided
    if _is_folder_decided or jax.config.jax_compilation_cache_dir is not None:  # type: ignore[attr-defined]
        return
    _is_folder_decided = True
    try:
        place = _users_folder()
        if not place.is_absolute():  # as where HOME is relative: each working folder would get its own
            return
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _folder_fault(place):
            return
    except (OSError, RuntimeError):  # the latter where there is no home folder
        return  # keeping code only saves time
    _apply_settings({"jax_compilation_cache_dir": str(place), **_KEEP_ALL})


def trusted_folder() -> Path | None:
    """Return the folder in which JAX keeps compiled code; None if there is none or it cannot be trusted."""
    import jax

    named = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    if not named or not os.path.isabs(named):  # none, or a URL of cloud storage
        return None
    place = Path(named)
    try:
        return place if place.is_dir() and not _folder_fault_once(named) else None
    except OSError:
        return None


@cache
def _folder_fault_once(named: str) -> str:
    """Return `_folder_fault` of the folder with this name, checked once in a process."""
    return _folder_fault(Path(named))


def settings() -> dict[str, object]:
    """Return JAX's settings for where and how this process keeps compiled code, for `adopt` in another."""
    import jax

    keep_by_default()
    with _settings_lock:
        found = {name: getattr(jax.config, name) for name in _SETTING_NAMES}
    if _running_blocks and found[_COMPILE_TIME_SETTING] == math.inf:
        found[_COMPILE_TIME_SETTING] = _usual_min_time
    return found


def adopt(given: dict[str, object]) -> None:
    """Keep compiled code as another process does, given the `settings` from there."""
    _apply_settings(given)


_running_blocks = 0  # with blocks of `written_once` that are running, in all threads
_usual_min_time = 0.0  # s, the setting `_COMPILE_TIME_SETTING` before the first of them
_settings_lock = threading.Lock()


@contextmanager
def written_once() -> Iterator[None]:
    """Keep JAX from writing to its own cache while this with block, or one in another thread, runs.

    Executables are written by `jaxplan.runtime.kernel_files` then; serialising them again would take as long.
    """
    import jax

    global _running_blocks, _usual_min_time
    with _settings_lock:
        if not _running_blocks:
            _usual_min_time = getattr(jax.config, _COMPILE_TIME_SETTING)
            jax.config.update(_COMPILE_TIME_SETTING, math.inf)
        _running_blocks += 1
    try:
        yield
    finally:
        with _settings_lock:
            _running_blocks -= 1
            # Whoever has set it meanwhile keeps that.
            if not _running_blocks and getattr(jax.config, _COMPILE_TIME_SETTING) == math.inf:
                jax.config.update(_COMPILE_TIME_SETTING, _usual_min_time)


def _apply_settings(given: dict[str, object]) -> None:
    """Apply settings of JAX, given by name, and note that the folder has been decided on."""
    import jax
    from jax.experimental.compilation_cache import compilation_cache as cache

    global _is_folder_decided
    _is_folder_decided = True
    moved = given["jax_compilation_cache_dir"] != jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    for name, value in given.items():
        jax.config.update(name, value)
    if moved:
        cache.reset_cache()  # else JAX would not look at the setting again
    # Entries that are damaged, or of another processor, are compiled again, which needs no warning.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache", UserWarning)


def _users_folder() -> Path:
    """Return the subfolder of the user's cache folder for this version of jaxplan and kind of processor."""
    chosen = os.environ.get("XDG_CACHE_HOME", "")
    root = Path(chosen) if os.path.isabs(chosen) else Path.home() / ".cache"  # as its specification asks
    return root / "jaxplan" / f"compiled-{__version__}-{processor_hash()}"


def processor_hash() -> str:
    """Return a short hash of this processor's instruction sets; that of "" where they cannot be read."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            known = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:  # no Linux: machines that share a folder are rare there
        known = ""
    return hashlib.sha256(" ".join(sorted(known.split())).encode()).hexdigest()[:8]


def _others_may_swap(found: os.stat_result) -> bool:
    """Tell whether users other than this one and root may rename what is in a folder, or redirect a link.

    With the sticky bit, as in /tmp, everybody can rename only their own files. A group with this user alone,
    as some systems create for every user, does not count as others.

    Args:
        found: what `lstat` returns for the folder or link.
    """
    if found.st_uid not in (0, os.geteuid()):
        return True
    if stat.S_ISLNK(found.st_mode) or found.st_mode & stat.S_ISVTX:
        return False
    group = found.st_mode & stat.S_IWGRP and not _is_private_group(found.st_gid)
    return bool(group or found.st_mode & stat.S_IWOTH)


def _is_private_group(group: int) -> bool:
    """Tell whether a group, by its number, has the user's name and no other members."""
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_name == user.pw_name and set(found.gr_mem) <= {user.pw_name}


def _folder_fault(place: Path) -> str:
    """Return why compiled code cannot be kept in a folder, in words for a message; "" if it can."""
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
