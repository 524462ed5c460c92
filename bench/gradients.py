"""What derivatives cost, and how long tuning takes.

Prints for both methods of step 3 the median time of a number of a trajectory that follows its scenario
(`jaxplan.replan`), of that number with its gradient in every number of the scenario, and of the fit itself;
then the time to tune weights over a batch of random scenes, its first steps, which compile, apart.

    python bench/gradients.py [--scenes 64] [--steps 100]
"""

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import replace

import jax
import numpy as np
from _machine import print_machine
from _options import positive

import jaxplan as jp


def milliseconds(call: Callable[[], object], repeats: int = 20) -> float:
    """Median time of a call, ms, after a first one that compiles."""
    jax.block_until_ready(call())
    runs = []
    for _ in range(repeats):
        begin = time.perf_counter()
        jax.block_until_ready(call())
        runs.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(runs))


def compare(method: str) -> None:
    """Print the times of a method of step 3, for case 2 in 80 s."""
    case = jp.paper_case(2)
    scenario = replace(case, trajectory=replace(case.trajectory, method=method))
    plan = jp.plan(scenario, progress=False)
    held = jp.hold(plan)

    def effort(scenario: jp.Scenario) -> jax.Array:
        return jp.measures.effort(jp.replan(held, scenario))

    value, both = jax.jit(effort), jax.jit(jax.value_and_grad(effort, allow_int=True))
    with jax.enable_x64(True):
        alone = milliseconds(lambda: value(scenario))
        together = milliseconds(lambda: both(scenario))
    fit = 1e3 * float(np.median([jp.plan(scenario, progress=False).timings["trajectory"] for _ in range(20)]))
    print(f"{method:<8} {alone:>9.2f} {together:>15.2f} {together / alone:>7.2f} {fit:>9.2f}")


def tune(method: str, scenes: int, steps: int) -> None:
    """Tune two weights over random scenes, and print the times and the objective before and after."""
    scenarios = []
    for seed in range(scenes):
        scenario = jp.random_scenario(seed, "keep_out")
        settings = replace(scenario.trajectory, method=method, duration=120.0)
        scenarios.append(replace(scenario, trajectory=settings))
    over = ("trajectory.rate_weight", "trajectory.acceleration_weight")
    begin = time.perf_counter()
    first = jp.tune(scenarios, "peak_acceleration", over=over, steps=1, progress=False)
    compiled = time.perf_counter()
    result = jp.tune(scenarios, "peak_acceleration", over=over, steps=steps, progress=False)
    end = time.perf_counter()
    peaks = [row["objective"] for row in result.history]
    print(
        f"{method:<8} {compiled - begin:>11.1f} {end - compiled:>11.1f}   "
        f"{peaks[0]:.4f} -> {peaks[-1]:.4f} {first.message}{result.message}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=positive, default=64)
    parser.add_argument("--steps", type=positive, default=100)
    options = parser.parse_args()
    affinity = os.sched_getaffinity(0)
    print_machine()
    print("case 2   value, ms  with gradient, ms  ratio   fit, ms")
    for method in ("paper", "global"):
        compare(method)
    os.sched_setaffinity(0, affinity)  # slopes are taken on all cores
    print(f"\n{options.steps} steps over {options.scenes} random keep_out scenes in 120 s")
    print("         one step, s  all, warm, s   mean peak acceleration, deg/s^2")
    for method in ("paper", "global"):
        tune(method, options.scenes, options.steps)
