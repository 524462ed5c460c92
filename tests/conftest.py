"""What holds for all tests: float64, the processor, and no window for figures."""

import os

# Before jax and matplotlib are imported; a test run on another device names it in JAX_PLATFORMS.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")

import jax

jax.config.update("jax_enable_x64", True)
