"""Goals of least time beside those of least rotation: how much sooner they are, and what step 1 takes for it.

Random problems of step 1, as of bench/decomposition.py, of each kind: the strict bound of the time to the
goal of least rotation and to that of least time, and the warm time of step 1 for either.

    python bench/least_time_goals.py [-n 200] [--seed 0]
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import not_negative, positive
from tqdm import tqdm

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the problems are those of the tests
from pointing import KINDS, Problem, random_problem

from jaxplan import so3
from jaxplan.goal import Decomposition
from jaxplan.model.duration_bound import rest_bounds


def solved(problem: Problem, criterion: str) -> tuple[Decomposition, float]:
    """Solve a problem by a criterion; returns its goals, and the time that step 1 took once compiled, s."""
    asked = replace(problem, targets=replace(problem.targets, criterion=criterion))
    asked.decompose()
    begin = time.perf_counter()
    return asked.decompose(), time.perf_counter() - begin


def bound(problem: Problem, found: Decomposition) -> float:
    """Strict lower bound of the time to the first goal, s."""
    goal = found.goals[0]
    turn = np.asarray(so3.log(problem.start.T @ goal.attitude))
    return float(rest_bounds(problem.spacecraft, turn[None], goal.joints[None])[0])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--problems", type=positive, default=200, help="of each kind")
    parser.add_argument("--seed", type=not_negative, default=0, help="number of the first problem of each")
    options = parser.parse_args()
    print_machine()
    print(f"{'kind':15}{'sooner':>8}{'median':>9}{'most':>8}{'later':>7}{'more ms':>9}")
    for number, kind in enumerate(KINDS):
        gains, more = [], []
        for place in tqdm(range(options.problems), unit=kind, leave=False):
            problem = random_problem(number + len(KINDS) * (options.seed + place))
            nearest, before = solved(problem, "least_rotation")
            soonest, after = solved(problem, "least_time")
            more.append(after - before)
            if nearest.goals:
                first, second = bound(problem, nearest), bound(problem, soonest)
                gains.append(1 - second / first if first > 0 else 0.0)
        sooner, later = np.mean(np.array(gains) > 1e-3), np.sum(np.array(gains) < -1e-9)
        print(
            f"{kind:15}{100 * sooner:7.0f}%{100 * np.median(gains):8.1f}%{100 * max(gains):7.1f}%{later:7d}"
            f"{1e3 * np.median(more):9.1f}"
        )
    print("sooner: share of problems; median, most: share of the bound that is gained; later: must be 0")


if __name__ == "__main__":
    main()
