"""What holds for all tests: float64, the processor, no window for figures, and each kernel compiled once.

What one worker or notebook has compiled the others read from a folder that lasts as long as the run, or from
the one that JAX_COMPILATION_CACHE_DIR names.
"""

import os
import shutil
import tempfile

# Before jax and matplotlib are imported; a test run on another device names it in JAX_PLATFORMS.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")

if "PYTEST_XDIST_WORKER" not in os.environ:  # the first of all processes; the others inherit it
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        os.environ["JAX_COMPILATION_CACHE_DIR"] = tempfile.mkdtemp(prefix="jaxplan-tests-")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"

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


def pytest_sessionfinish() -> None:
    """Remove the folder of what was compiled."""
    folder = os.environ["JAX_COMPILATION_CACHE_DIR"]
    if "PYTEST_XDIST_WORKER" not in os.environ and "jaxplan-tests-" in folder:
        shutil.rmtree(folder, ignore_errors=True)
