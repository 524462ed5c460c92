"""A clock that stands still while JAX compiles, for limits on how long something may take.

What is compiled is compiled once for all scenes of the same sizes, so a limit must not depend on which of
them comes first.
"""

import time

import jax

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
