"""The default search beside OMPL's RRTConnect with path simplification, on the same scenes in the same run.

For scenes of `random_scenario` and the nearest goal of step 1, `mha` and OMPL take turns: in each of the
repeats `mha` searches twice, the second time by the clock, and OMPL once with every seed, all compiled
before, on one core. The time of `mha` is that of the whole search from the bare scene, distance fields and
smoothing included; that of OMPL is RRTConnect and simplification, with a whole-motion checker in numba. A
scene's time is the median over the repeats, for OMPL averaged over its seeds. OMPL plans with its own range
(how far its trees grow at once) and with 0.5 rad, which is about the fastest for these scenes.

Tables print a line a planner: paths found, paths without an edge below zero, time, length in steps and travel
(rotation and all joints, rad), each over the straight motion's and for OMPL also that of its best seed; edges
below zero by the exact bound and by dense samples; the least margin by the bound. Then the targets, each with
its figure and its bar; ratios of lengths are means over scenes, ratios of times those of the means.

    python bench/ompl_compare.py [-n 100] [--kinds held_links] [--ompl-seeds 20] [--numpy-checker [10]]
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from _machine import print_machine
from _measures import measure, straight_lengths
from _motion_checkers import Checker, compiled, vectorised
from _ompl import Rival
from _ompl_report import MHA, NUMPY, Case, Trial, print_kind, print_targets
from _options import angle, not_negative, positive
from tqdm import tqdm

import jaxplan as jp
from jaxplan.cases import SKY_KINDS
from jaxplan.model.scenario import Scenario
from jaxplan.search import PLANNERS, Scene, find_barrier
from jaxplan.study.printed_planners import make_problem


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One way to run OMPL: name, checker, range in rad (0: its own), seeds, repeats, number of scenes."""

    name: str
    check: Checker
    extent: float
    seeds: int
    repeats: int
    scenes: int


def settings(options: argparse.Namespace) -> list[Setting]:
    """The ways to run OMPL that the options ask for."""
    ways = []
    for extent in options.ranges:
        name = "OMPL" if extent == 0 else f"OMPL {extent:g} rad"
        counts = {"seeds": options.ompl_seeds, "repeats": options.repeats, "scenes": options.scenes}
        ways.append(Setting(name=name, check=compiled, extent=extent, **counts))
        if options.numpy_checker:
            counts = {"seeds": min(options.ompl_seeds, 3), "repeats": 1, "scenes": options.numpy_checker}
            ways.append(Setting(name=f"{name} {NUMPY}", check=vectorised, extent=extent, **counts))
    return ways


def compare(
    scenario: Scenario, scene: Scene, ways: Sequence[Setting], repeats: int, resolution: float
) -> Case:
    """Let `mha` and OMPL plan one scene in turns.

    Args:
        scenario: the scene.
        scene: its search problem.
        ways: to run OMPL.
        repeats: of `mha`.
        resolution: rad between samples of OMPL's checker.
    """
    search = PLANNERS[MHA]
    result = search(scene, scenario.search)
    ours = Trial(seconds=[[]], expansions=result.expansions)
    ours.paths.append(None if result.path is None else measure(scene, result.path))
    rivals = [Rival(scene, way.check, resolution=resolution, extent=way.extent) for way in ways]
    trials = [Trial(seconds=[[] for _ in range(way.seeds)]) for way in ways]
    for repeat in range(repeats):
        search(scene, scenario.search)  # follows OMPL; the next follows its like, as OMPL's runs do
        bare = replace(scene)  # with nothing of it computed yet
        begin = time.perf_counter()
        search(bare, scenario.search)
        ours.seconds[0].append(time.perf_counter() - begin)
        for way, rival, trial in zip(ways, rivals, trials, strict=True):
            for number in range(way.seeds if repeat < way.repeats else 0):
                seconds, path = rival.solve(number)
                trial.seconds[number].append(seconds)
                if repeat == 0:
                    trial.paths.append(None if path is None else measure(scene, path))
    steps, travel = straight_lengths(scene)
    named = {way.name: trial for way, trial in zip(ways, trials, strict=True)}
    return Case(steps=steps, travel=travel, trials={MHA: ours, **named})


def run_kind(kind: str, ways: Sequence[Setting], options: argparse.Namespace) -> tuple[list[Case], int]:
    """Compare on the scenes of a kind; returns the results, and how many were proved to have no path."""
    cases, infeasible = [], 0
    for place in tqdm(range(options.scenes), desc=kind, unit="scene"):
        scenario = jp.random_scenario(options.first_seed + place, kind)
        scene = make_problem(scenario)
        if find_barrier(scene) is not None:
            infeasible += 1
            continue
        now = [way for way in ways if place < way.scenes]
        if not cases:  # compiles
            compare(scenario, scene, now, 1, options.resolution)
        cases.append(compare(scenario, scene, now, options.repeats, options.resolution))
    return cases, infeasible


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--scenes", type=positive, default=100, help="of each kind (%(default)s)")
    parser.add_argument("--first-seed", type=not_negative, default=0, help="of the scenes (%(default)s)")
    parser.add_argument("--kinds", nargs="+", choices=SKY_KINDS, default=SKY_KINDS, metavar="KIND")
    parser.add_argument("--repeats", type=positive, default=5, help="of every search (%(default)s)")
    parser.add_argument("--ompl-seeds", type=positive, default=20, help="runs of OMPL a scene (%(default)s)")
    parser.add_argument(
        "--ranges",
        type=angle,
        nargs="+",
        default=(0.0, 0.5),
        metavar="RAD",
        help="of OMPL; 0: its own (0 0.5)",
    )
    parser.add_argument(
        "--resolution", type=angle, default=0.01, metavar="RAD", help="of OMPL's checker (%(default)s)"
    )
    parser.add_argument(
        "--numpy-checker",
        type=positive,
        nargs="?",
        const=10,
        default=0,
        metavar="SCENES",
        help="OMPL also with its checker in numpy, on so many scenes of each kind (%(const)s), 3 seeds, once",
    )
    return parser.parse_args()


def main() -> None:
    options = parse()
    print_machine("ompl", "numba")
    ways, results = settings(options), {}
    for kind in dict.fromkeys(options.kinds):
        cases, infeasible = run_kind(kind, ways, options)
        print_kind(kind, cases, infeasible)
        results[kind] = cases
    print_targets({kind: cases for kind, cases in results.items() if cases})


if __name__ == "__main__":
    main()
