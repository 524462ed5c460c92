"""Speed of step 3, warm, on the stored node sequences and on long random paths.

Prints medians of fits at several durations and of samples of a trajectory.

    python bench/trajectory.py [--repeats 50]
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

import numpy as np
from _machine import print_machine
from _options import positive

sys.path.insert(0, str(File(__file__).parents[1] / "tests"))

from builders import make_spacecraft
from node_paths import NAMES, load, wandering

from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import Fit, FitQuery, fit_batch


def median_ms(call: Callable[[], object], repeats: int) -> float:
    """Median time of a call, ms, after a first one that compiles."""
    call()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(seconds))


def fits(repeats: int) -> None:
    """Fit the paths in several durations, and print the times."""
    craft = make_spacecraft()
    kinds = {
        "stretched": TrajectorySettings(),
        "80 s, 3": TrajectorySettings(duration=80.0, segments=3),
        "80 s, m": TrajectorySettings(duration=80.0, segments=1000),
        "20 s (too short)": TrajectorySettings(duration=20.0, segments=3),
    }
    print("fit, median ms          " + "".join(f"{kind:>18s}" for kind in kinds))
    paths = {f"{name}, {load(name).edges} edges": load(name) for name in NAMES}
    paths |= {f"random, {edges} edges": wandering(edges, 3, seed=edges, step=0.03) for edges in (48, 199)}
    for name, path in paths.items():
        row = []
        for settings in kinds.values():
            limit = repeats if settings.duration != 20.0 and path.edges < 100 else max(repeats // 10, 3)
            row.append(median_ms(lambda p=path, s=settings: fit_paper(p, craft, s), limit))
        print(f"{name:24s}" + "".join(f"{value:18.1f}" for value in row))


def fit_paper(path: Path, craft: Spacecraft, settings: TrajectorySettings) -> Fit:
    """Fit a path by the paper's method."""
    query = FitQuery(path=path, spacecraft=craft, settings=replace(settings, method="paper"))
    return fit_batch([query])[0]


def samples(repeats: int) -> None:
    """Sample trajectories of 3 and 12 terminals at several numbers of times, and print how long it takes."""
    path = load("astar_c3")
    print("\nsamples, median ms      3 terminals      12 terminals")
    wide = replace(path, joints=np.tile(path.joints, 4))
    trajectories = [
        fit_paper(p, make_spacecraft(count), TrajectorySettings()).trajectory
        for p, count in ((path, 3), (wide, 12))
    ]
    for count in (1, 200, 1000, 10_000, 100_000):
        row = []
        for trajectory in trajectories:
            t = np.linspace(0, trajectory.duration, count)
            call = lambda trajectory=trajectory, t=t: trajectory.sample(t)  # noqa: E731
            row.append(median_ms(call, repeats if count < 10_000 else max(repeats // 10, 3)))
        print(f"{count:10d} {row[0]:24.2f} {row[1]:17.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=positive, default=50)
    arguments = parser.parse_args()
    print_machine()
    fits(arguments.repeats)
    samples(arguments.repeats)
