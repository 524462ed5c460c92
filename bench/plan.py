"""Latency of whole plans, warm, and of the import.

Prints for each of the paper's cases the median time of a plan and of its steps, what a second scene of the
same padded sizes compiles (nothing), and the time of ``import jaxplan`` beside that of jax alone, each in
fresh processes.

    python bench/plan.py [--repeats 30]
"""

import argparse
import subprocess
import sys
import time
from dataclasses import replace

import jax
import numpy as np
from _machine import print_machine
from _options import positive

import jaxplan as jp

STEPS = ("decompose", "search", "trajectory", "certificate", "total")


def timings(scenario: jp.Scenario, repeats: int) -> dict[str, float]:
    """Median milliseconds by step, over search seeds, after a first plan that compiles."""
    jp.plan(scenario, progress=False)
    runs = []
    for seed in range(repeats):
        seeded = replace(scenario, search=replace(scenario.search, seed=seed))
        runs.append(jp.plan(seeded, progress=False).timings)
    return {step: 1e3 * float(np.median([run[step] for run in runs])) for step in STEPS}


def compiled_by_second_scene() -> int:
    """Number of kernels compiled for a scene of the same padded sizes as one planned before."""
    jp.plan(jp.paper_case(1), progress=False)
    events: list[str] = []
    jax.monitoring.register_event_duration_secs_listener(lambda event, _, **__: events.append(event))
    jp.plan(jp.paper_case(2), progress=False)
    return sum("backend_compile" in event for event in events)


def import_seconds(statement: str, repeats: int = 7) -> float:
    """Median seconds of a statement in fresh processes, by its own clock."""
    program = f"import time; begin = time.perf_counter(); {statement}; print(time.perf_counter() - begin)"
    runs = [
        float(subprocess.run([sys.executable, "-c", program], capture_output=True, check=True).stdout)
        for _ in range(repeats)
    ]
    return float(np.median(runs))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=positive, default=30)
    options = parser.parse_args()
    print_machine()
    print(f"compiled by a second scene of the same sizes: {compiled_by_second_scene()}\n")
    print("median ms   " + "".join(f"{step:>13}" for step in STEPS))
    for duration in (80.0, "stretched"):
        for number in (1, 2, 3, 4):
            case = jp.paper_case(number)
            case = replace(case, trajectory=replace(case.trajectory, duration=duration))
            row = timings(case, options.repeats)
            name = f"case {number}" + (" *" if duration == "stretched" else "")
            print(f"{name:<12}" + "".join(f"{row[step]:13.1f}" for step in STEPS))
    print('* with duration_s = "stretched"\n')
    alone, ours = import_seconds("import jax"), import_seconds("import jaxplan")
    first_use = import_seconds("import jaxplan; jaxplan.plan")
    print(f"import jax {alone:.2f} s, import jaxplan {ours:.2f} s, and with jaxplan.plan {first_use:.2f} s")
    begin = time.perf_counter()
    jp.plan(jp.paper_case(2), progress=False)
    print(f"one more plan of case 2: {1e3 * (time.perf_counter() - begin):.1f} ms")
