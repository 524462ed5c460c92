"""Compiling what a test runs once: quickly rather than well, and the same but for rounding."""

import jax

from jaxplan.runtime.jit import known_options

# XLA's older emitters and no optimisation: a sixth of the time for derivatives, which are many small kernels.
# Not for the package's own kernels: by these emitters answers depend on a batch's shape in their last bits.
OPTIONS = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}


def quick_jit(function):
    """Like `jax.jit`, on the processor."""
    return jax.jit(function, compiler_options=known_options(**OPTIONS))
