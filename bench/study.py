"""Studies: scenes a second by one process and by two, and what memory a long one takes.

Two processes are measured without their start: both plan the same scenes before the clock runs. Memory is
that of the process that keeps the study, in a folder, after every tenth of the scenes. To see what rows
take, and not plans, the scenes of that part are not planned.

    python bench/study.py [-n 400] [--kind keep_in] [--rows 20000]
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import positive

from jaxplan.cases import RANDOM_KINDS
from jaxplan.runtime.workers import WorkerPool
from jaxplan.study.rows import STEPS, Answer, plan_chunk, row_of, times_of
from jaxplan.study.run import Blocks, by_workers, run_task
from jaxplan.study.task import Chunk, Task

_REHEARSALS = 2  # of the whole study, after which each process has compiled what it uses


def rate(kind: str, count: int, workers: int) -> float:
    """Scenes a second that a number of processes plan, of a study of `count` scenes of a kind."""
    pool = WorkerPool(workers)
    try:
        task = Task(kind=kind, scenes=range(count), planner="mha")
        for size in (*[1] * _REHEARSALS, None):  # the last one counts
            began = time.perf_counter()
            chunks = Blocks(task, range(count), size)
            rows = sum(len(answer.table) for answer in by_workers(chunks, plan_chunk, pool))
        return rows / (time.perf_counter() - began)
    finally:
        pool.shutdown(at_once=False)


def memory(scenes: int) -> None:
    """Print the resident memory of a study of many scenes, MiB."""
    seen: list[float] = []

    def no_plan(chunk: Chunk) -> Answer:
        heads = [chunk.head(place) for place in range(len(chunk.scenes))]
        if chunk.numbers[-1] >= len(seen) * scenes / 10:
            seen.append(resident())
        message = "not planned, but with a message as long as those of scenes without a path"
        rows = [row_of(message, h) for h in heads]
        return Answer(rows, [times_of(dict.fromkeys(STEPS, 0.1), h) for h in heads], 1e-3)

    task = Task(kind="keep_in", scenes=range(scenes), planner="mha")
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        run_task(task, None, Path(folder) / "study", None, False, no_plan)
        seconds = time.perf_counter() - began
        size = sum(file.stat().st_size for file in (Path(folder) / "study").iterdir()) / 2**20
    slope = np.polyfit(np.linspace(0.1, 1, len(seen) - 1), seen[1:], 1)[0] * 2**20 / scenes
    print(f"memory of a study of {scenes} scenes, MiB: {', '.join(f'{value:.0f}' for value in seen)}")
    print(
        f"{slope:.0f} bytes a scene in memory, {size:.0f} MiB on disk, {scenes / seconds:.0f} rows a second"
    )


def resident() -> float:
    """Resident memory of this process, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--scenes", type=positive, default=400, help="that are planned (%(default)s)")
    parser.add_argument("--kind", choices=RANDOM_KINDS, default="keep_in", help="of them (%(default)s)")
    parser.add_argument("--rows", type=positive, default=20_000, help="of the long study (%(default)s)")
    options = parser.parse_args()
    affinity = os.sched_getaffinity(0)
    print_machine()
    memory(options.rows)
    os.sched_setaffinity(0, affinity)  # the workers have all cores
    rates = []
    for workers in (1, 2):
        rates.append(rate(options.kind, options.scenes, workers))
        print(f"{options.kind}, {options.scenes} scenes, processes: {workers}; {rates[-1]:.1f} a second")
    print(f"two over one {rates[1] / rates[0]:.2f}")


if __name__ == "__main__":
    main()
