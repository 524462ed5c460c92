"""A fleet: 1,584 satellites that follow their links over an orbit; a sample of them, by processes and Dask.

The shell is 53:1584/72/39 at 550 km, with links in the plane and to both sides as they change over its orbit
of 95 min from the June solstice on, 60 s a step, and keep-out cones of Sun (10 deg) and Earth. A sample of
its satellites, evenly spread, is planned by 1 and 2 processes and by a local Dask cluster of 1, 2 and 4
workers of one thread each, every time anew into an empty folder. Before the clocks run each way plans a few
satellites that are not in the sample, so that compiled code is there. The files must be the same bytes each
time. What all satellites and a cluster would take is the CPU time of the sample, extrapolated: no more.

    python bench/fleet.py [-n 12] [--processes 1 2] [--dask 1 2 4] [--duration 5739]
"""

import argparse
import hashlib
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import MISSING, positive
from _processes import cpu_seconds, evenly, peak_memory

import jaxplan as jp

Pool = tuple[Executor | None, Callable[[], Sequence[int]]]
"""Who plans, and a function that tells the ids of the processes that do."""


def digest(folder: Path) -> str:
    """SHA-256 of all plans, rows and the table of a fleet's folder."""
    found = hashlib.sha256()
    for path in sorted([*folder.glob("plans/*.npz"), *folder.glob("rows/*"), folder / "table.jsonl"]):
        found.update(path.read_bytes())
    return found.hexdigest()


def in_calling_threads() -> None:
    """Have JAX compute in the thread that asks, not in another, as in processes of jaxplan's own."""
    import jax

    jax.config.update("jax_cpu_enable_async_dispatch", False)


@contextmanager
def processes(number: int) -> Iterator[Pool]:
    """A number of processes of their own."""
    with ProcessPoolExecutor(number, get_context("spawn"), in_calling_threads) as pool:
        yield pool, lambda: list(pool._processes or {})


@contextmanager
def dask(number: int) -> Iterator[Pool]:
    """A local Dask cluster of a number of workers, each a process of one thread."""
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise SystemExit(MISSING.format("distributed", "dask")) from error
    with (
        LocalCluster(
            n_workers=number, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        Client(cluster) as client,
    ):
        client.run(in_calling_threads)
        yield client.get_executor(), lambda: list(client.run(os.getpid).values())


def run(schedule: jp.LinkSchedule, sample: Sequence[int], pool: Pool, number: int) -> jp.Fleet:
    """Plan a sample by a pool of so many workers, and print what it takes."""
    executor, ids = pool
    total = schedule.shell.total
    with tempfile.TemporaryDirectory() as place:
        others = [(own + total // 2 // len(sample)) % total for own in sample[:number]]
        jp.plan_fleet(schedule, Path(place) / "rehearsal", satellites=others, workers=executor)
        known = ids()
        began, used = time.perf_counter(), cpu_seconds([*known, os.getpid()])
        result = jp.plan_fleet(schedule, Path(place) / "fleet", satellites=sample, workers=executor)
        wall, used = time.perf_counter() - began, cpu_seconds([*known, os.getpid()]) - used
        slews = sum(row["slews"] for row in result.table)
        size = sum(path.stat().st_size for path in (result.folder / "plans").iterdir())
        names = ("slews", "motions", "proof")
        steps = [sum(row[f"{name}_s"] for row in result.timings) for name in names]
        parts = zip(names, steps, strict=True)
        shares = ", ".join(f"{name} {100 * seconds / sum(steps):.0f} %" for name, seconds in parts)
        print(
            f"  certified {result.certified} of {result.done}; wall {wall:.1f} s, CPU {used:.1f} s: "
            f"{used / result.done:.2f} s a satellite, {used / slews:.2f} s a switch ({shares}); "
            f"memory {peak_memory([*known, os.getpid()]):.0f} MiB in all, "
            f"{peak_memory([os.getpid()]):.0f} here; {size / result.done / 1024:.0f} KiB a plan"
        )
        whole, plans = used / result.done * total / 3600, size / result.done * total / 2**20
        print(
            f"  extrapolated from {result.done} to {total} satellites: {whole:.1f} h of CPU time, "
            f"so {whole:.1f} h / N on N such cores; {plans:.0f} MiB of plans"
        )
        print(f"  digest of all files {digest(result.folder)[:16]}")
    return result


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--satellites", type=positive, default=12, help="in the sample (%(default)s)")
    parser.add_argument("--processes", type=positive, nargs="*", default=[1, 2])
    parser.add_argument("--dask", type=positive, nargs="*", default=[1, 2, 4])
    parser.add_argument("--duration", type=positive, default=5739, help="s (%(default)s, one orbit)")
    options = parser.parse_args()
    print_machine(pinned=False)
    shell = jp.walker("53:1584/72/39", 550.0)
    began = time.process_time()
    schedule = jp.link_schedule(shell, epoch="2026-06-20T09:30:00", duration_s=float(options.duration))
    print(f"{schedule}\nmade in {time.process_time() - began:.1f} s of CPU time", end="; ")
    sample = evenly(shell.total, options.satellites)
    switches = np.mean([len(schedule.spans(number)) for number in sample])
    print(f"{len(sample)} satellites in the sample, {switches:.1f} switches each\n")
    result = None
    for kind, numbers in ((processes, options.processes), (dask, options.dask)):
        for number in numbers:
            print(f"{number} workers of {kind.__name__}")
            with kind(number) as pool:
                result = run(schedule, sample, pool, number)
    if result is not None:
        print(f"\n{result}")


if __name__ == "__main__":
    main()
