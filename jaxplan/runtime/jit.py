"""Compiled code: quickly made, kept between processes, and forgotten before it fills the memory.

A *kernel* is a jitted function compiled for arguments of certain kinds (shapes and types).

What has been compiled is kept between processes (`jaxplan.runtime.kernel_files`).

**Kernels that are ready soon**: a first plan waits much longer for their compilation than for its results. On
the CPU, XLA writes the loops of a fused computation in one of two ways. The newer one, by way of a separate
language for loops, takes two to three times as long to compile kernels like those here, and they run no
faster. `quick_jit` asks for the older one where the installed XLA still has it; that of jaxlib 0.11 and later
has not. While JAX traces and lowers a kernel, Python does not look for cyclic garbage
(`jaxplan.runtime.garbage`).

**Room** for kernels in a process that plans scenarios of many shapes. XLA takes some 20 MB for each, so of
more than `_MOST_KERNELS` of ours the older half is forgotten, and what is used again is read from its file,
or compiled again where none is kept. What other code jits is kept by JAX. On Linux each kernel takes some
eighty memory maps, of which a process has 65,530 unless the system is set otherwise. Where none is left the
process dies of "LLVM compilation error: Cannot allocate memory". So before that all kernels of the process
are forgotten, those of other code, too.
"""

import inspect
import os
import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial, wraps
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxplan.runtime import kernel_files
from jaxplan.runtime.ahead import NoLongerWantedError, still_wanted
from jaxplan.runtime.garbage import uncollected
from jaxplan.runtime.progress import COMPILE_ENDS
from jaxplan.runtime.stopwatch import lock_with_clock_stopped

Answer = TypeVar("Answer")
# The second option saves a twelfth of the time with the newer way of loops, as XLA does not check itself. The
# third saves a tenth: code for LLVM is not split for threads, as other kernels are compiled beside.
_QUICK_OPTIONS: dict[str, bool | int] = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_emitter_verification_level": 0,
    "xla_cpu_parallel_codegen_split_count": 1,
}
_UNTRACED_TYPES = frozenset({np.ndarray, float, int, bool, np.float64, np.int64})  # never tracers
_MOST_KERNELS = 200  # of ours in one process, 4 GB; a plan uses up to ten, a gradient or a day some dozens
_KERNELS_PER_CHECK = 40  # new kernels between two looks at the memory maps, whose reading takes milliseconds
_MOST_MAPS_SHARE = 0.5  # fraction of the allowed memory maps above which kernels are forgotten
_MAPS_LIMIT_FILE, _MAPS_FILE = "/proc/sys/vm/max_map_count", "/proc/self/maps"
_LONGEST_WAIT = 1.0  # s, for another thread's trace to end; then all go on


_known_kernels: list[dict[Hashable, Callable[..., Any]]] = []  # executables of each function, by kinds


def quick_jit(function: Callable[..., Answer], *, level: int = 3, **options: Any) -> Callable[..., Answer]:
    """Jit a function so that it compiles in about half the time, never twice at once, and is kept.

    The time is halved only with an XLA that still has the older kind of loops (see the module). A thread that
    needs what another one is compiling waits for that. Later processes read what is compiled without tracing
    the function again (`jaxplan.runtime.kernel_files`).

    Args:
        function: the function to be jitted; inside other traced functions it is as if jitted by `jax.jit`.
        level: how far LLVM optimises, from 0 to 3. At 1, kernels of many small steps compile in three
            quarters of the time and run as quickly, but those of long loops take half as long again to run.
            At 0, for what runs a few times, they compile in a third of the time and take three times as long
            to run.
        options: static_argnums or static_argnames, as of `jax.jit`.

    Returns:
        The same function, jitted.
    """
    traced, static = jax.jit(function, **options), _static_arguments(function, **options)
    asked = _QUICK_OPTIONS | {"xla_backend_optimization_level": level}
    told = os.environ.get("XLA_FLAGS", "")  # what is told there, such as tests do, holds for all kernels
    flags = {name: value for name, value in asked.items() if f"--{name}=" not in told}
    known: dict[Hashable, Callable[..., Answer]] = {}
    _known_kernels.append(known)
    turn = threading.RLock()

    @wraps(function)
    def kernel(*args: Any, **kwargs: Any) -> Answer:
        fixed = [args[place] for place in static if isinstance(place, int) and place < len(args)]
        fixed += [(name, kwargs[name]) for name in static if name in kwargs]
        args_left = tuple(value for place, value in enumerate(args) if place not in static)
        given = {name: value for name, value in kwargs.items() if name not in static}
        leaves, tree = jax.tree.flatten((args_left, given))
        foreign = not _UNTRACED_TYPES.issuperset(map(type, leaves))
        if (foreign and is_traced(leaves)) or _is_config_unusual():
            return traced(*args, **kwargs)
        kinds = (tree, jax.config.jax_enable_x64, *fixed, *map(_argument_kind, leaves))  # type: ignore[attr-defined]
        compiled = known.get(kinds)
        if compiled is None:
            with lock_with_clock_stopped(turn):
                compiled = known.get(kinds)
                if compiled is None:
                    compiled = known[kinds] = _load_or_compile(function, options, flags, kinds, args, kwargs)
        return compiled(*args_left, **given)

    return kernel


def kernel_count() -> int:
    """Return how many kernels this process has compiled or read, and not forgotten."""
    return sum(map(len, _known_kernels))


def is_traced(tree: Any) -> bool:
    """Tell whether JAX is tracing any leaf of a tree."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def to_numpy(tree: Any) -> Any:
    """Convert the leaves of a tree, but no tracers, to numpy arrays; so one kernel serves all callers."""
    return jax.tree.map(lambda leaf: leaf if isinstance(leaf, jax.core.Tracer) else np.asarray(leaf), tree)


def _static_arguments(function: Callable[..., Any], **options: Any) -> set[int | str]:
    """Return the static arguments of a function by `options` of `jax.jit`, each by position and name."""
    told = {key: (value,) if isinstance(value, int | str) else value for key, value in options.items()}
    names = list(inspect.signature(function).parameters)
    places = [*told.get("static_argnums", ()), *map(names.index, told.get("static_argnames", ()))]
    return {*places, *(names[place] for place in places)}


def _argument_kind(leaf: Any) -> Hashable:
    """Return the kind of an argument: shape and dtype, or type. Equal kinds share an executable."""
    if type(leaf) is np.ndarray:
        return leaf.shape, leaf.dtype
    if isinstance(leaf, jax.Array):
        return leaf.shape, leaf.dtype, leaf.weak_type
    return (leaf.shape, leaf.dtype) if isinstance(leaf, np.ndarray) else cast(Hashable, type(leaf))


def _is_config_unusual() -> bool:
    """Whether JAX is set to something else than compiling for, and running on, the only device there is."""
    config: Any = jax.config
    chosen = config.jax_default_device is not None or _has_several_devices()
    return bool(config.jax_disable_jit or config.jax_debug_nans or chosen)


@cache
def _has_several_devices() -> bool:
    """Tell whether there is more than one device."""
    return jax.device_count() > 1  # an executable is for one of them, and arguments may lie on another


def _load_or_compile(
    function: Callable[..., Answer],
    options: dict[str, Any],
    flags: dict[str, bool | int],
    kinds: Hashable,
    args: Any,
    kwargs: Any,
) -> Callable[..., Answer]:
    """Return the executable of a function for arguments of some kinds: read if kept, else compiled and kept.

    Args:
        function: the function to be compiled.
        options: options of `jax.jit`.
        flags: compiler options; those that XLA does not know are left out.
        kinds: kinds of the arguments, part of the key under which executables are kept.
        args: an example of the positional arguments, for tracing.
        kwargs: an example of the keyword arguments.

    Raises:
        NoLongerWantedError: in a thread that compiles ahead, once that is over.
    """
    global _new_kernels
    # The same function may be jitted in two ways.
    name, text = kernel_files.name_of(function), kernel_files.text_of((kinds, *sorted(flags.items())))
    kept = kernel_files.load(name, text)
    if kept is None:
        with kernel_files.one_at_a_time(name, text):
            kept = kernel_files.load(name, text)
            if kept is None:
                known = known_options(**flags)  # JAX accepts options at the outermost level only
                with _turn_to_trace(), uncollected():
                    if not still_wanted():
                        raise NoLongerWantedError
                    jitted = jax.jit(_own(function), **options, compiler_options=known)
                    lowered = jitted.lower(*args, **kwargs)
                if not still_wanted():
                    raise NoLongerWantedError
                return cast(Callable[..., Answer], kernel_files.compile_and_keep(lowered, name, text))
    _new_kernels += 1
    return kept


def _own(function: Callable[..., Answer]) -> Callable[..., Answer]:
    """Return a function that does the same; what JAX keeps for it is forgotten with it."""

    @wraps(function)
    def own(*args: Any, **kwargs: Any) -> Answer:
        return function(*args, **kwargs)

    if isinstance(function, partial):
        own.__name__ = function.func.__name__
    return own


_tracing = threading.RLock()


@contextmanager
def _turn_to_trace() -> Iterator[None]:
    """Trace and lower in a with block after other threads, so that the first kernel is compiled early.

    Threads that trace at once hold each other up, since only one can run Python. After `_LONGEST_WAIT` all
    that wait go on: what the other thread needs might be a kernel that this one is to compile.
    """
    own = _tracing.acquire(timeout=_LONGEST_WAIT)
    try:
        yield
    finally:
        if own:
            _tracing.release()


def materialise(positive: ArrayLike, values: Any) -> Any:
    """Return equal values, which the compiler keeps as arrays instead of fusing them into later loops.

    Otherwise, what goes into many results is computed, and compiled, anew for each of them. A conditional
    whose outcome cannot be foreseen ends the fusion; `jax.lax.optimization_barrier` does not on the CPU.

    Args:
        positive: () an argument of the jitted function, or the count of a loop, that is always above zero.
        values: any tree of arrays.
    """

    def never(array: jax.Array) -> jax.Array:
        return jnp.full_like(array, jnp.nan if jnp.issubdtype(array.dtype, jnp.inexact) else -1)

    return jax.lax.cond(jnp.asarray(positive) > 0, lambda v: v, lambda v: jax.tree.map(never, v), values)


_option_names: dict[str, bool] = {}  # of the compiler options that were tried, whether this XLA has them
_trying = threading.Lock()


def known_options(**options: bool | int) -> dict[str, bool | int]:
    """Return those of some compiler options that this XLA has for the CPU; none on other devices.

    Options come and go with XLA's releases, and compiling with one that is not known fails.
    """
    if jax.default_backend() != "cpu":
        return {}
    with _trying:
        untried = {name: value for name, value in options.items() if name not in _option_names}
        if untried and _are_accepted(untried):
            _option_names.update(dict.fromkeys(untried, True))
        for name in untried.keys() - _option_names.keys():
            _option_names[name] = _are_accepted({name: untried[name]})
        return {name: value for name, value in options.items() if _option_names[name]}


def _are_accepted(options: dict[str, bool | int]) -> bool:
    """Tell whether XLA compiles something with these options."""
    try:
        jax.jit(lambda: 0, compiler_options=options).lower().compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True


_new_kernels = 0


def _count_new_kernel(event: str, duration_secs: float, **_: str | int) -> None:
    """Count the kernels compiled since `clear_if_full` last looked."""
    global _new_kernels
    _new_kernels += event == COMPILE_ENDS


jax.monitoring.register_event_duration_secs_listener(_count_new_kernel)


def clear_if_full(most_maps: float | None = None) -> bool:
    """Forget half of our kernels if they are too many, and all if their memory maps are; tell whether it did.

    It looks at the maps only after `_KERNELS_PER_CHECK` new kernels, so that it may be called often, or if
    told how many are too many.

    Args:
        most_maps: fraction of the allowed memory maps above which all kernels of the process are forgotten;
            None for `_MOST_MAPS_SHARE`.
    """
    global _new_kernels
    crowded, full = kernel_count() > _MOST_KERNELS, False
    if most_maps is not None or _new_kernels >= _KERNELS_PER_CHECK:
        _new_kernels = 0
        share = _MOST_MAPS_SHARE if most_maps is None else most_maps
        with suppress(OSError), open(_MAPS_LIMIT_FILE, "rb") as limit, open(_MAPS_FILE, "rb") as maps:
            full = maps.read().count(b"\n") > share * int(limit.read())  # only Linux has such a limit
    if crowded or full:
        for known in _known_kernels:
            kinds = list(known)  # the oldest first
            for kind in kinds if full else kinds[: len(kinds) // 2]:
                known.pop(kind, None)
    if full:
        jax.clear_caches()
    return crowded or full
