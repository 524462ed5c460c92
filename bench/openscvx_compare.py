"""Minimum-time slews beside OpenSCvx, on the same scenes and the same goal states in the same run.

For the paper's four cases and scenes of `random_scenario`, jaxplan plans in the shortest time and OpenSCvx
solves the same problem from start to the goal that jaxplan found, once with accelerations that may jump
(bang-bang) and once with continuous ones that are zero at both ends (smooth). Its first guess is the
straight motion and, where that fails, jaxplan's searched path. Both take turns, compiled before and on one
core; the times of a scene are medians over the repeats. `solve` is step 3 of jaxplan, which starts from its
searched path, beside a whole solve of OpenSCvx; `total` is a whole plan with goal, search and certificate.

Every answer is flown by an independent check (`_flight.py`) at 20,000 instants: zones, limits, goal. `OK` is
what a planner says of itself, `refused` how many of those the check refuses; durations, over what the slowest
joint needs by itself, are those of the rest, as median and worst. `ours x` is the time over that of jaxplan's
solve, the median of the scenes' ratios. The least margin and the highest peak over its limit are those of all
that are called OK.

    python bench/openscvx_compare.py [-n 10] [--kinds keep_out held_links] [--repeats 3] [--each]
"""

import argparse
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace

import jax
import numpy as np
from _flight import flight_of, inspect, joint_bound
from _machine import print_machine
from _openscvx import Rival, Way
from _openscvx_data import zones_by_terminal
from _openscvx_report import Case, Trial, print_kind
from _options import not_negative, positive
from tqdm import tqdm

import jaxplan as jp
from jaxplan.cases import SKY_KINDS
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario

CASES, WAYS = "cases", ("bang-bang", "smooth")


class Rivals:
    """OpenSCvx's compiled problems, one for each way to run it and numbers of zones at the terminals."""

    def __init__(self, ways: Sequence[Way]) -> None:
        self.ways = ways
        self._made: dict[tuple[Way, tuple[int, ...]], Rival] = {}

    def of(self, scenario: Scenario, goal: Goal, way: Way) -> Rival:
        """The problem for a scene; one that is not there yet is compiled, and the time printed.

        Its first solve takes longer than the next ones, so one goes before.
        """
        counts = tuple(len(zones) for zones in zones_by_terminal(scenario))
        if (way, counts) not in self._made:
            rival = Rival(scenario.spacecraft, counts, way)
            tqdm.write(f"{way.name} for {counts} zones compiled in {rival.compile_seconds:.1f} s")
            rival.solve(scenario, goal, None)
            self._made[way, counts] = rival
        return self._made[way, counts]


def compare(scenario: Scenario, rivals: Rivals, repeats: int) -> Case | None:
    """Let jaxplan and OpenSCvx plan one scene in turns; None where jaxplan finds no path."""
    first = jp.plan(scenario, throw=False, progress=False)  # compiles
    goal, path = first.goal, first.path
    if goal is None or path is None:
        return None
    plans, runs = [], [_Runs(rivals.of(scenario, goal, way), way.name) for way in rivals.ways]
    for _ in range(repeats):
        plans.append(jp.plan(scenario, throw=False, progress=False))
        for run in runs:
            run.go(scenario, goal, path)
    bound = joint_bound(scenario, goal)
    ours = float(np.median([plan.timings.get("trajectory", np.nan) for plan in plans]))
    flown = None if first.trajectory is None else flight_of(first.trajectory)
    mine = Trial(
        ok=first.ok,
        verdict=None if flown is None else inspect(scenario, goal, flown),
        ratio=np.nan if flown is None else flown.duration / bound,
        seconds=ours,
        total=float(np.median([plan.timings["total"] for plan in plans])),
        iterations=np.nan,
        ours=ours,
        note=f"{first.status.name}: {first.message}",
    )
    trials = {name: trial for run in runs for name, trial in run.trials(scenario, goal, bound, ours).items()}
    return Case(name=scenario.name, trials={"jaxplan": mine, **trials})


class _Runs:
    """OpenSCvx's runs on one scene: from the straight motion, and where that fails from jaxplan's path."""

    def __init__(self, rival: Rival, name: str) -> None:
        self.rival, self.name = rival, name
        self.verdicts, self.answers, self.seconds = {}, {}, {}

    def go(self, scenario: Scenario, goal: Goal, path: Path) -> None:
        """Solve once from each first guess until one succeeds; one that failed before is not tried again."""
        for guess, given in (("straight", None), ("searched", path)):
            name = f"{self.name}, {guess}"
            if name not in self.answers or self._good(name):
                answer = self.rival.solve(scenario, goal, given)
                self.seconds.setdefault(name, []).append(answer.seconds)
                if name not in self.answers:
                    self.answers[name] = answer
                    if answer.flight is not None:
                        self.verdicts[name] = inspect(scenario, goal, answer.flight)
            if self._good(name):
                return

    def _good(self, name: str) -> bool:
        """Whether the answer from a first guess, by name, has converged and is not refused."""
        verdict = self.verdicts.get(name)
        return self.answers[name].converged and verdict is not None and not verdict.refusal

    def trials(self, scenario: Scenario, goal: Goal, bound: float, ours: float) -> dict[str, Trial]:
        """The trials, by the name of way and first guess.

        Args:
            scenario: the scene.
            goal: of it.
            bound: s, the least that the slowest joint needs.
            ours: s, the time of jaxplan's solver.
        """
        return {
            name: Trial(
                ok=answer.converged,
                verdict=self.verdicts.get(name),
                ratio=np.nan if answer.flight is None else answer.flight.duration / bound,
                seconds=float(np.median(self.seconds[name])),
                total=np.nan,
                iterations=answer.iterations,
                ours=ours,
                note=f"not converged in {answer.iterations} iterations",
            )
            for name, answer in self.answers.items()
        }


def run_kind(kind: str, scenarios: Iterable[Scenario], rivals: Rivals, options: argparse.Namespace) -> None:
    """Compare on the scenes of a kind one after the other, and print their table."""
    cases, left_out = [], 0
    for scenario in tqdm(list(scenarios), desc=kind, unit="scene"):
        settings = replace(scenario.trajectory, method=options.method, duration=options.duration)
        case = compare(replace(scenario, trajectory=settings), rivals, options.repeats)
        if case is None:
            left_out += 1
        else:
            cases.append(case)
    print_kind(kind, cases, left_out, each=options.each or kind == CASES)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    kinds = (CASES, *SKY_KINDS)
    parser.add_argument("-n", "--scenes", type=positive, default=10, help="of each kind (%(default)s)")
    parser.add_argument("--first-seed", type=not_negative, default=0, help="of the scenes (%(default)s)")
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds, metavar="KIND")
    parser.add_argument("--repeats", type=positive, default=3, help="of every plan and solve (%(default)s)")
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS, metavar="WAY", help="of OpenSCvx")
    parser.add_argument("--nodes", type=positive, default=30, help="of OpenSCvx (%(default)s)")
    parser.add_argument("--method", default="global", help="of jaxplan's step 3 (%(default)s)")
    parser.add_argument("--duration", default="minimum", help="likewise (%(default)s)")
    parser.add_argument("--each", action="store_true", help="a line for every scene, too")
    return parser.parse_args()


def main() -> None:
    options = parse()
    print_machine("openscvx", "cvxpy", "qoco")
    jax.config.update("jax_enable_x64", True)  # OpenSCvx does so later; jaxplan would be compiled anew then
    ways = dict.fromkeys(options.ways)
    rivals = Rivals([Way(name=name, jumps=name == "bang-bang", nodes=options.nodes) for name in ways])
    begin = time.perf_counter()
    for kind in dict.fromkeys(options.kinds):
        if kind == CASES:
            scenarios = [jp.paper_case(number) for number in (1, 2, 3, 4)]
        else:
            seeds = range(options.first_seed, options.first_seed + options.scenes)
            scenarios = [jp.random_scenario(seed, kind) for seed in seeds]
        run_kind(kind, scenarios, rivals, options)
    print(f"{time.perf_counter() - begin:.0f} s in all")


if __name__ == "__main__":
    main()
