"""What a user waits for when a process begins: first plans, slopes, a step of tuning, and the command line.

Each run is a whole process: *cold* finds an empty cache of compiled code, *cached* what the run before left
there. Prints medians in seconds, by the clock and of the processor on all cores; the latter holds also where
others use the machine. With --against another checkout is measured in turns with this one. With --kernels
each cold process also tells, by kernel, how long XLA took, lines of the program that it was given, and calls;
of kernels that are jitted by JAX alone calls are not counted.

    python bench/cold.py [--repeats 5] [--jobs plan check] [--against DIR] [--kernels]
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from time import perf_counter

import numpy as np
from _machine import print_machine
from _options import positive

HERE = Path(__file__).resolve().parent.parent

SCENE = """
from dataclasses import replace
import jax
import jaxplan as jp
def scene(seed, duration):
    drawn = jp.random_scenario(seed, "keep_out")
    return replace(drawn, trajectory=replace(drawn.trajectory, duration=duration))
"""
GRADIENT = """
import jax
import jaxplan as jp
plan = jp.plan({}, progress=False)
function = jp.differentiable(plan)
with jax.enable_x64(True):
    slope = jax.grad(lambda scenario: jp.measures.effort(function(scenario)), allow_int=True)
    jax.block_until_ready(slope(plan.scenario))
"""
COMMAND = "import sys; sys.argv[1:] = {}; from jaxplan.cli import main; sys.exit(main())"
JOBS = {  # a program each, run in the folder of the checkout; DIR is a folder with a plan of case 2
    "plan": "import jaxplan as jp; jp.plan(jp.paper_case(2), progress=False)",
    "minimum": f"{SCENE}jp.plan(scene(0, 'minimum'), throw=False, progress=False)",
    "gradient": GRADIENT.format("jp.paper_case(2)"),
    "gradient, wheels": GRADIENT.format('jp.load_scenario("docs/gallery/wheels.toml")'),
    "gradients of 3": f"""{SCENE}
for seed in range(3):
    plan = jp.plan(scene(seed, 150.0), progress=False)
    function = jp.differentiable(plan)
    with jax.enable_x64(True):
        slope = jax.grad(lambda scenario: jp.measures.effort(function(scenario)), allow_int=True)
        jax.block_until_ready(slope(plan.scenario))
""",
    "tune": f"""{SCENE}
scenes = [scene(seed, 60.0) for seed in range(64)]
jp.tune(scenes, "effort", over=["trajectory.duration_s"], steps=1, progress=False)
""",
    "jaxplan plan": COMMAND.format('["plan", "case-2", "-o", DIR]'),
    "jaxplan check": COMMAND.format('["check", DIR + "/plan.json"]'),
}

# Runs before a job; jaxplan asks for its kernels by quick_jit, and JAX for all programs by this one function.
COUNTING = """
import atexit
from collections import defaultdict
from functools import wraps
from time import perf_counter
import jax._src.compiler as compiler
import jaxplan.runtime.jit as jit
found = defaultdict(lambda: [0.0, 0, 0])
compiled, jitted = compiler.backend_compile_and_load, jit.quick_jit

def compile_and_count(backend, module, *rest, **more):
    begin = perf_counter()
    program = compiled(backend, module, *rest, **more)
    own = found[module.operation.attributes["sym_name"].value.removeprefix("jit_")]
    own[0] += perf_counter() - begin
    own[1] += str(module).count("\\n")
    return program

def jit_and_count(function, **options):
    kernel = jitted(function, **options)
    @wraps(function)
    def counted(*args, **kwargs):
        found[function.__name__][2] += 1
        return kernel(*args, **kwargs)
    return counted

def tell():
    for name, (seconds, lines, calls) in sorted(found.items(), key=lambda item: -item[1][0]):
        if seconds:
            print(f"kernel  {name:<40}{seconds:>9.3f}{lines:>9}{calls or '-':>7}")

compiler.backend_compile_and_load, jit.quick_jit = compile_and_count, jit_and_count
atexit.register(tell)
"""


def run(root: Path, home: str, program: str, folder: str) -> tuple[list[float], str]:
    """Run a program in a new process; returns its seconds by the clock and of the processor, and its output.

    Args:
        root: folder of a checkout.
        home: folder in which it keeps compiled code.
        program: text in Python.
        folder: what the program calls DIR.
    """
    # With PYTHONDONTWRITEBYTECODE every process would compile the sources of this package anew.
    left_out = ("JAX_", "XDG_", "PYTHONDONTWRITEBYTECODE")
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(left_out)}
    with tempfile.TemporaryFile("w+") as printed, tempfile.TemporaryFile("w+") as said:
        begin = perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-c", f"DIR = {folder!r}\n{program}"],
            stdout=printed,
            stderr=said,
            cwd=root,  # which python -c looks into first
            env=inherited | {"HOME": home, "PYTHONPATH": str(root)},
        )
        _, status, used = os.wait4(process.pid, 0)
        wall = perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        printed.seek(0)
        said.seek(0)
        if process.returncode:
            raise SystemExit(f"{root}: a process failed\n{said.read()}")
        return [wall, used.ru_utime + used.ru_stime], printed.read()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=positive, default=5)
    parser.add_argument(
        "--jobs", nargs="+", choices=JOBS, default=list(JOBS), metavar="JOB", help=f"{[*JOBS]}"
    )
    parser.add_argument("--against", type=Path, metavar="DIR", help="another checkout of jaxplan")
    parser.add_argument("--kernels", action="store_true", help="tell what each kernel took to compile")
    options = parser.parse_args()
    print_machine(pinned=False)
    roots = {"this": HERE} | ({"against": options.against.resolve()} if options.against else {})
    found: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        run(HERE, folder, JOBS["jaxplan plan"], folder)
        for _ in range(options.repeats):
            for job in options.jobs:
                for name, root in roots.items():
                    with tempfile.TemporaryDirectory() as home:
                        found[job, name] += [
                            run(root, home, JOBS[job], folder)[0] + run(root, home, JOBS[job], folder)[0]
                        ]
        print(f"{'':<30}{'cold, s':>10}{'CPU':>8}{'cached, s':>12}{'CPU':>8}")
        for (job, name), runs in found.items():
            cold, cold_cpu, cached, cached_cpu = np.median(runs, axis=0)
            print(f"{job:<18}{name:<12}{cold:>10.2f}{cold_cpu:>8.2f}{cached:>12.2f}{cached_cpu:>8.2f}")
        for job in options.jobs if options.kernels else ():
            for name, root in roots.items():
                with tempfile.TemporaryDirectory() as home:
                    _, printed = run(root, home, f"{COUNTING}\n{JOBS[job]}", folder)
                print(f"\n{f'{job}, {name}':<42}{'XLA, s':>9}{'lines':>9}{'calls':>7}")
                told = (
                    line.partition("kernel") for line in printed.splitlines()
                )  # beside what a command prints
                print("\n".join(row for before, mark, row in told if mark and not before))
