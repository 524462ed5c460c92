"""The head of every bench's output: on what machine, with which versions."""

import contextlib
import os
import platform
from importlib.metadata import version


def print_machine(*others: str, pinned: bool = True) -> None:
    """Keep to one core where the system allows it, and print processor, cores and versions.

    On two cores the hand-over of small kernels between threads takes longer than the kernels and varies from
    run to run.

    Args:
        others: packages whose versions matter, besides those of every bench.
        pinned: whether it is to be one core; else all that there are.
    """
    cores = f"{os.cpu_count()} cores" + (" (one used)" if pinned else "")
    if pinned:
        with contextlib.suppress(AttributeError, OSError):
            os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="ascii") as info:
            model = next(line.split(":", 1)[1].strip() for line in info if line.startswith("model name"))
    except (OSError, StopIteration):
        pass  # no such file on this system: the short name does
    packages = ", ".join(f"{name} {version(name)}" for name in ("jax", "numpy", "scipy", "osqp", *others))
    print(f"{model}, {cores}, Python {platform.python_version()}, {packages}\n")
