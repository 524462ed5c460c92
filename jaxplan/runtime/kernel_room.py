"""Room for compiled kernels in a process that plans scenarios of many shapes.

JAX keeps every kernel that it has compiled. On Linux each takes some sixty memory maps, of which a process
has 65,530 unless the system is set otherwise; where none is left it dies of "LLVM compilation error: Cannot
allocate memory", after some hundred scenarios of ever other numbers of devices and zones. So before that all
kernels of the process are forgotten, and those that are used again are compiled again.
"""

import jax

_COMPILED = "/jax/core/compile/backend_compile_duration"  # an event each
_EVERY = 40  # kernels between two looks: reading the maps takes milliseconds
_SHARE = 0.5  # of the maps that there may be
_LIMIT, _MAPS = "/proc/sys/vm/max_map_count", "/proc/self/maps"

_new = 0


def _count(event: str, duration_secs: float, **_: str | int) -> None:
    global _new
    _new += event == _COMPILED


jax.monitoring.register_event_duration_secs_listener(_count)


def make_room() -> bool:
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
