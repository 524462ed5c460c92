"""What a user waits for when a process begins: the first plan and the first gradient, cold and cached.

Each run is a process of its own: *cold* finds an empty cache of compiled code, *cached* what an earlier run
left there. Prints medians in seconds; with --against another checkout is measured in turns with this one.

    python bench/start.py [--repeats 5] [--against DIR]
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import positive

HERE = Path(__file__).resolve().parent.parent

PROGRAM = """
from time import perf_counter
clock = [perf_counter()]
import jax
import jaxplan as jp
clock.append(perf_counter())
plan = jp.plan(jp.paper_case(2), progress=False)
clock.append(perf_counter())
held = jp.hold(plan)
with jax.enable_x64(True):
    slope = jax.jit(jax.grad(lambda scenario: jp.measures.effort(jp.replan(held, scenario)), allow_int=True))
    clock.append(perf_counter())
    jax.block_until_ready(slope(plan.scenario))
    clock.append(perf_counter())
    jax.block_until_ready(slope(plan.scenario))
    clock.append(perf_counter())
print(*(after - before for before, after in zip(clock, clock[1:])))
"""
COLUMNS = ("import", "first plan", "both", "hold", "first gradient", "next gradient")


def seconds(root: Path, home: str) -> list[float]:
    """What a process took that finds compiled code under some home."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "XDG_"))}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        check=True,
        cwd=root,  # which python -c looks into first
        env=inherited | {"HOME": home, "PYTHONPATH": str(root)},
    )
    loading, planning, *rest = map(float, done.stdout.split())
    return [loading, planning, loading + planning, *rest]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=positive, default=5)
    parser.add_argument("--against", type=Path, metavar="DIR", help="another checkout of jaxplan")
    options = parser.parse_args()
    print_machine(pinned=False)
    roots = {"this": HERE} | ({"against": options.against.resolve()} if options.against else {})
    found: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
    for _ in range(options.repeats):
        for name, root in roots.items():
            with tempfile.TemporaryDirectory() as home:
                found[name, "cold"].append(seconds(root, home))
                found[name, "cached"].append(seconds(root, home))
    print(f"{'':<16}" + "".join(f"{column:>16}" for column in COLUMNS))
    for (name, state), runs in found.items():
        print(f"{name + ', ' + state:<16}" + "".join(f"{value:>16.3f}" for value in np.median(runs, axis=0)))
