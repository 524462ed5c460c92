"""Compiled code: kept between processes, let go before there is no room, and called quickly.

**A clock** that stands still while JAX compiles, for limits on how long something may take. What is compiled
is compiled once for all scenes of the same sizes, so a limit must not depend on which of them comes first.

**Room** for kernels in a process that plans scenarios of many shapes. JAX keeps every kernel that it has
compiled. On Linux each takes some sixty memory maps, of which a process has 65,530 unless the system is set
otherwise; where none is left it dies of "LLVM compilation error: Cannot allocate memory", after some hundred
scenarios of ever other numbers of devices and zones. So before that all kernels of the process are forgotten,
and those that are used again are compiled again.

**Kernels that are ready soon**: a first plan waits for their compilation much longer than for its results.
XLA writes the loops of a fused computation on the CPU in one of two ways. The newer one, through a language
of its own for loops, takes two to three times as long to compile kernels such as ours, and what it makes of
them is no quicker. `quick_jit` asks for the older one where the installed XLA still has it, and is `jax.jit`
otherwise.

**The folder** in which JAX keeps what it compiles, so that only the first process ever waits for it. A first
plan compiles for ten seconds; read from the folder it takes three. The folder is the user's cache folder,
``~/.cache/jaxplan`` or that of ``XDG_CACHE_HOME``, with a part for each kind of processor, since code for one
may not run on another. It is used unless the user has told JAX otherwise, and silently not where it cannot be
written or may not be trusted: whoever can write there can have us run any code. What JAX compiles for others
in the same process is kept there, too.
"""

import hashlib
import os
import stat
import time
import warnings
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

_EVENTS = (
    "/jax/core/compile/jaxpr_trace_duration",
    "/jax/core/compile/jaxpr_to_mlir_module_duration",
    "/jax/core/compile/backend_compile_duration",
)
_compiling = 0.0


def _listen(event: str, duration_secs: float, **_: str | int) -> None:
    global _compiling
    if event in _EVENTS:
        _compiling += duration_secs


jax.monitoring.register_event_duration_secs_listener(_listen)


def working_time() -> float:
    """Seconds since some instant, without those spent on tracing and compiling."""
    return time.monotonic() - _compiling


_COMPILED = "/jax/core/compile/backend_compile_duration"  # an event each
_EVERY = 40  # kernels between two looks: reading the maps takes milliseconds
_SHARE = 0.5  # of the maps that there may be
_LIMIT, _MAPS = "/proc/sys/vm/max_map_count", "/proc/self/maps"

_new = 0


def _count(event: str, duration_secs: float, **_: str | int) -> None:
    global _new
    _new += event == _COMPILED


jax.monitoring.register_event_duration_secs_listener(_count)


def clear_if_full() -> bool:
    """Forget all compiled kernels if they take too many memory maps; returns whether they did."""
    global _new
    if _new < _EVERY:
        return False
    _new = 0
    try:
        with open(_LIMIT, "rb") as limit, open(_MAPS, "rb") as maps:
            full = maps.read().count(b"\n") > _SHARE * int(limit.read())
    except OSError:  # no Linux, no such limit
        return False
    if full:
        jax.clear_caches()
    return full


Answer = TypeVar("Answer")

_SOON: dict[str, bool | int] = {"xla_cpu_use_fusion_emitters": False}
_RARELY_RUN = _SOON | {"xla_backend_optimization_level": 0}


def quick_jit(
    function: Callable[..., Answer], *, optimised: bool = True, **options: Any
) -> Callable[..., Answer]:
    """Jit a function so that it compiles in about half the time.

    Args:
        function: to be jitted; inside other traced functions it is as if jitted by `jax.jit`.
        optimised: False for what runs a few times in milliseconds, which compiles in half of that time again
            and runs two to three times as long.
        options: of `jax.jit`.

    Returns:
        The same function, jitted.
    """
    traced = jax.jit(function, **options)
    jitted: list[Callable[..., Answer]] = []

    @wraps(function)
    def kernel(*args: Any, **kwargs: Any) -> Answer:
        if not jitted:  # at the first call, since asking XLA starts it
            own = _SOON if optimised else _RARELY_RUN
            jitted.append(jax.jit(function, **options, compiler_options=own) if _known() else traced)
        try:
            return jitted[0](*args, **kwargs)
        except ValueError:  # JAX takes such options at the outermost level alone
            return traced(*args, **kwargs)

    return kernel


def materialise(positive: ArrayLike, values: Any) -> Any:
    """The same values, kept by the compiler as arrays instead of being fused into the loops that read them.

    Without it what goes into many results is computed, and compiled, anew for each of them. A conditional
    whose outcome cannot be foreseen ends the fusion; `jax.lax.optimization_barrier` does not on the CPU.

    Args:
        positive: () an argument of the jitted function, or the count of a loop, that is above zero.
        values: any tree of arrays.
    """

    def never(array: jax.Array) -> jax.Array:
        return jnp.full_like(array, jnp.nan if jnp.issubdtype(array.dtype, jnp.inexact) else -1)

    return jax.lax.cond(jnp.asarray(positive) > 0, lambda v: v, lambda v: jax.tree.map(never, v), values)


@cache
def _known() -> bool:
    """Tell whether kernels run on the CPU, by an XLA that knows these options."""
    if jax.default_backend() != "cpu":
        return False
    try:
        jax.jit(lambda: 0, compiler_options=_SOON).lower().compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True


# JAX keeps by itself only what took a second to compile, and most kernels here take less.
_KEEP_ALL = {
    "jax_persistent_cache_min_compile_time_secs": 0.0,
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
        ValueError: if it is empty, nothing can be written there, or others than the user may write there or,
            without the sticky bit, in a folder above it.

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
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        why_not = _fault(place)
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


def settings() -> dict[str, object]:
    """Where and how this process keeps compiled code, for `adopt` in another one."""
    import jax

    keep_by_default()
    return {name: getattr(jax.config, name) for name in _SETTINGS}


def adopt(given: dict[str, object]) -> None:
    """Keep compiled code as another process does."""
    _use(given)


def _use(given: dict[str, object]) -> None:
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
    """The part of the user's cache folder that is for this kind of processor."""
    chosen = os.environ.get("XDG_CACHE_HOME", "")
    root = Path(chosen) if os.path.isabs(chosen) else Path.home() / ".cache"  # as its specification asks
    return root / "jaxplan" / f"compiled-{_processor()}"


def _processor() -> str:
    """A short name for what instructions this processor knows."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            known = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:  # no Linux: machines that share a folder are rare there
        known = ""
    return hashlib.sha256(" ".join(sorted(known.split())).encode()).hexdigest()[:8]


def _others_may_swap(found: os.stat_result) -> bool:
    """Whether others than the user and root may rename what is in a folder, or turn a link elsewhere.

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
    """Whether a group is called like the user, and nobody else has been added to it."""
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_name == user.pw_name and set(found.gr_mem) <= {user.pw_name}


def _fault(place: Path) -> str:
    """Why compiled code cannot be kept in a folder; empty if it can."""
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
