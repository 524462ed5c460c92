"""Slew times between the targets of a telescope: pairs a second of `slew_times`, beside plans one by one.

A telescope that is fixed to the body, a panel that turns to the Sun as far as that lets it, and the Sun kept
out; targets are drawn from the sky. All is compiled, by planning the same pairs, before the clocks run. With
workers these are begun, and have planned the same, before.

    python bench/slew_times.py [-n 8] [--workers 2] [--repeats 3]
"""

import argparse
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import jax
import numpy as np
from _machine import print_machine
from _options import positive

import jaxplan as jp
from jaxplan.slew_matrix import SlewTimes

Matrix = Callable[[ProcessPoolExecutor | None], SlewTimes]
SUN = np.array([-0.8, 0.0, -0.6])
SETTINGS = {"default": {}, "first_guesses = 0": {"trajectory.first_guesses": 0}}


def survey(count: int) -> dict[str, jp.Targets]:
    """Targets by name, drawn from the sky between 55 and 125 deg from the Sun."""
    rng, goals = np.random.default_rng(0), dict[str, jp.Targets]()
    while len(goals) < count:
        one = rng.normal(size=3)
        one /= np.linalg.norm(one)
        if abs(one @ SUN) < np.cos(np.deg2rad(55)):
            wish = jp.Wish(device="panel", direction=SUN)
            goals[f"target {len(goals) + 1}"] = jp.Targets.of({"telescope": one}, prefer=[wish])
    return goals


def craft() -> jp.Spacecraft:
    """The spacecraft: a telescope and a panel, both fixed to the body."""
    return jp.Spacecraft(
        instruments=[
            jp.Instrument(name="telescope", boresight=[0, 0, 1]),
            jp.Instrument(name="panel", boresight=[1, 0, 0]),
        ],
        rate_limit=np.deg2rad([1.2, 1.2, 0.6]),
        acceleration_limit=np.deg2rad([0.08, 0.08, 0.04]),
    )


def seconds_of(work: Callable[[], object], repeats: int) -> float:
    """Median of the wall times of some work, s."""
    spent = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        spent.append(time.perf_counter() - began)
    return float(np.median(spent))


def quick_dispatch() -> None:
    """Have JAX compute in the calling thread, as in processes that jaxplan begins itself."""
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def compared(name: str, matrix: Matrix, workers: int, repeats: int, cores: set[int]) -> None:
    """Print pairs a second of `slew_times` here and by workers, and of plans one by one."""
    found = matrix(None)
    apart = ~np.eye(found.goals, dtype=bool)
    scenes = [found.scenario(a, b) for a, b in np.argwhere(apart).tolist()]

    def loop() -> list[jp.Plan]:
        return [jp.plan(scene, throw=False, progress=False) for scene in scenes]

    differ = max(
        abs(plan.trajectory.duration - own)
        for plan, own in zip(loop(), found.times[apart], strict=True)
        if plan.ok
    )
    print(f"\n{name}: {found.planned} of {len(scenes)} pairs certified, up to {differ:.1e} s from jp.plan")
    own = os.sched_getaffinity(0)
    rates = {
        "loop of jp.plan": len(scenes) / seconds_of(loop, repeats),
        "slew_times, this process": len(scenes) / seconds_of(lambda: matrix(None), repeats),
    }
    os.sched_setaffinity(0, cores)  # the workers have all cores
    with ProcessPoolExecutor(workers, get_context("spawn"), initializer=quick_dispatch) as pool:
        for _ in range(2):
            matrix(pool)
        rates[f"slew_times, {workers} workers"] = len(scenes) / seconds_of(lambda: matrix(pool), repeats)
    os.sched_setaffinity(0, own)
    for label, rate in rates.items():
        print(f"  {label:24}  {rate:6.2f} pairs/s")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--goals", type=positive, default=8, help="targets (%(default)s)")
    parser.add_argument("--workers", type=positive, default=2, help="processes (%(default)s)")
    parser.add_argument(
        "--repeats", type=positive, default=3, help="of which the median counts (%(default)s)"
    )
    options = parser.parse_args()
    cores = os.sched_getaffinity(0)
    print_machine()
    zone = jp.KeepOut(name="sun", direction=SUN, half_angle=np.deg2rad(50), devices=["telescope"])
    for name, settings in SETTINGS.items():
        known = partial(
            jp.slew_times, craft(), survey(options.goals), keep_out=[zone], settings=settings, progress=False
        )

        def matrix(workers: ProcessPoolExecutor | None, known: Any = known) -> SlewTimes:
            found: SlewTimes = known(workers=workers, chunk=1)
            return found

        compared(name, matrix, options.workers, options.repeats, cores)


if __name__ == "__main__":
    main()
