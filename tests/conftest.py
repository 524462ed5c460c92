"""What holds for all tests: float64, the processor, and no window for figures.

What one worker, notebook or run has compiled the others read from the user's cache folder, as every program
that uses the package does, or from the one that JAX_COMPILATION_CACHE_DIR names.
"""

import importlib.metadata
import os

# Before jax and matplotlib are imported; a test run on another device names it in JAX_PLATFORMS.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")
# Most of the time goes to compiling what runs for milliseconds, so kernels are compiled without optimisation
# here: in a third of the time, to run at two thirds of the speed. Nor is code for LLVM split for threads,
# since tests run on all cores. XLA_FLAGS= asks for what users get. A process ends at once that has a flag
# which its XLA does not know: that of jaxlib 0.11 or later no longer has the second, and may lose the third.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0"
    + " --xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
    * (tuple(map(int, importlib.metadata.version("jaxlib").split(".")[:2])) < (0, 11)),
)

import hypothesis
import jax
import pytest

from jaxplan.runtime.jit import clear_if_full

# How long an example takes is not what is tested, and other processes may hold one up.
hypothesis.settings.register_profile(
    "suite", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("suite")

jax.config.update("jax_enable_x64", True)

_compilations: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, _, **more: (
        _compilations.append(str(more.get("fun_name", event))) if "backend_compile" in event else None
    )
)


def pytest_collection_modifyitems(items):
    """Notebooks are slow."""
    for item in items:
        if item.path.suffix == ".ipynb":
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def compilations():
    """The programs that JAX has compiled since the test began, one entry each."""
    # One listener for all tests: JAX's older versions only take all of them away, the library's own too.
    _compilations.clear()
    return _compilations


@pytest.fixture(scope="module", autouse=True)
def _room_for_kernels():
    """Forget the kernels of many files before they fill the memory: tests compile some without a plan."""
    yield
    clear_if_full(most_maps=0.2)
