"""What holds for all tests: float64, the processor, and no window for figures.

What one worker, notebook or run has compiled the others read from the user's cache folder, as every program
that uses the package does, or from the one that JAX_COMPILATION_CACHE_DIR names.
"""

import os

# Before jax and matplotlib are imported; a test run on another device names it in JAX_PLATFORMS.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")

import jax
import pytest

jax.config.update("jax_enable_x64", True)

_compilations: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, _seconds, **_: _compilations.append(event) if "backend_compile" in event else None
)


@pytest.fixture
def compilations():
    """The programs that JAX has compiled since the test began, one entry each."""
    # One listener for all tests: JAX's older versions only take all of them away, the library's own too.
    _compilations.clear()
    return _compilations
