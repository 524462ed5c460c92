"""Many at once beside one by one: fits of step 3 in 80 s, and whole plans, by one process and by several.

Fits are those of paths of random scenes of all five kinds; plans those of satellites that switch a link,
evenly spread over a shell of 1,584. What is compared takes turns on the same cores; medians are printed, and
whether all answers are the same to the last bit.

    python bench/batch.py [-n 256] [--workers 2] [--repeats 5]
"""

import argparse
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields
from functools import partial
from multiprocessing import get_context
from typing import Any

import jax
import numpy as np
from _machine import print_machine
from _options import positive
from tqdm import tqdm

import jaxplan as jp
from jaxplan.cases import SKY_KINDS
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.tabulation import tabulate
from jaxplan.trajectory import FitQuery, Trajectory, fit_batch

Work = Callable[[], list[Trajectory | None]]


def paths(count: int, method: str) -> list[FitQuery]:
    """Find `count` paths of random scenes, to be fitted in 80 s by a method of step 3."""
    scenes = [
        jp.random_scenario(seed, kind) for seed in range(-(-count // len(SKY_KINDS))) for kind in SKY_KINDS
    ]
    settings = TrajectorySettings(method=method, duration=80.0)
    found = []
    for plan in jp.plan_batch(scenes[:count]):
        if plan.path is None:
            raise SystemExit(f"{plan.scenario.name} has no path: {plan.message}")
        scene = plan.scenario
        cones = tabulate(scene.keep_out, scene.keep_in, scene.spacecraft)
        query = FitQuery(path=plan.path, spacecraft=scene.spacecraft, settings=settings, cones=cones)
        found.append(query)
    return found


def satellites(count: int) -> list[jp.Scenario]:
    """Scenarios of `count` satellites of a shell that switch a link, evenly spread."""
    tilt = np.radians(23.44)
    shell = jp.walker("53:1584/72/39", 550.0)
    scenes = jp.link_switch(shell, sun_direction=[0.0, np.cos(tilt), np.sin(tilt)]).scenarios()
    return [scenes[number] for number in np.linspace(0, len(scenes) - 1, count).astype(int)]


def fitted(queries: Sequence[FitQuery]) -> list[Trajectory | None]:
    """Fit queries together; returns their trajectories."""
    return [fit.trajectory for fit in fit_batch(queries)]


def fits(count: int, method: str, pool: ProcessPoolExecutor, workers: int) -> dict[str, Work]:
    """Functions, by name, that fit the same paths one by one, together, and by workers."""
    queries = paths(count, method)
    parts = [queries[number::workers] for number in range(workers)]

    def by_workers() -> list[Trajectory | None]:
        found: list[Any] = [None] * count
        for number, part in enumerate(pool.map(fitted, parts)):
            found[number::workers] = part
        return found

    return {
        "one by one": lambda: [fitted([query])[0] for query in queries],
        "together": lambda: fitted(queries),
        f"{workers} processes": by_workers,
    }


def plans(count: int, pool: ProcessPoolExecutor, workers: int) -> dict[str, Work]:
    """Functions, by name, that plan the same satellites one by one, together, and by workers."""
    scenes = satellites(count)
    batch = partial(jp.plan_batch, scenes, progress=False)
    return {
        "one by one": lambda: [jp.plan(scene, throw=False, progress=False).trajectory for scene in scenes],
        "together": lambda: [plan.trajectory for plan in batch()],
        f"{workers} processes": lambda: [plan.trajectory for plan in batch(workers=pool)],
    }


def same(one: Trajectory | None, other: Trajectory | None) -> bool:
    """Whether two trajectories agree to the last bit."""
    if one is None or other is None:
        return one is other
    names = [field.name for field in fields(one)]
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def inline() -> None:
    """Make JAX compute in the calling thread, as jaxplan does in workers of its own."""
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def compare(what: str, ways: dict[str, Work], count: int, repeats: int) -> None:
    """Time ways to do the same work in turns, and print a row: ms each, ratios, and whether answers agree."""
    answers = {name: work() for name, work in ways.items()}  # nothing is compiled later
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for _ in tqdm(range(repeats), desc=what, leave=False):
        for name, work in ways.items():  # in turns, so that a noisy machine hits all
            began = time.perf_counter()
            work()
            seconds[name].append(time.perf_counter() - began)
    first, *others = ways
    each = {name: float(np.median(own)) / count for name, own in seconds.items()}
    agree = [all(map(same, answers[first], answers[name])) for name in others]
    row = f"{what:18}{1000 * each[first]:14.2f}"
    for name in others:
        row += f"{1000 * each[name]:14.2f}{each[first] / each[name]:8.2f}"
    print(f"{row}{'yes' if all(agree) else 'NO':>8}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--count", type=positive, default=256, help="fits, and plans (default 256)")
    parser.add_argument("--workers", type=positive, default=2, help="processes (default 2)")
    parser.add_argument("--repeats", type=positive, default=5)
    options = parser.parse_args()
    print_machine(pinned=False)
    count, workers = options.count, options.workers
    print(f"{count} each, ms")
    several = f"{workers} processes"
    print(f"{'':18}{'one by one':>14}{'together':>14}{'ratio':>8}{several:>14}{'ratio':>8}{'same':>8}")
    with ProcessPoolExecutor(workers, get_context("spawn"), inline) as pool:
        for method in ("paper", "global"):
            compare(f"fits, {method}", fits(count, method, pool, workers), count, options.repeats)
        compare("plans, satellites", plans(count, pool, workers), count, options.repeats)


if __name__ == "__main__":
    main()
