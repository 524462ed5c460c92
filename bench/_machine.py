"""The head of every bench's output: on what machine, with which versions."""

import os
import platform
from importlib.metadata import version


def print_machine() -> None:
    """Print processor, cores and versions."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="ascii") as info:
            model = next(line.split(":", 1)[1].strip() for line in info if line.startswith("model name"))
    except (OSError, StopIteration):
        pass  # no such file on this system: the short name does
    packages = ", ".join(f"{name} {version(name)}" for name in ("jax", "numpy", "scipy", "osqp"))
    print(f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}, {packages}\n")
