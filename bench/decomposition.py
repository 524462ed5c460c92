"""Step 1 against scipy's SLSQP, and its latency.

Solves random problems, all of them solvable, of ten kinds (the paper's targets; one to twelve terminals; yaw
ranges wider than half a turn; star trackers and telescopes with keep-out and keep-in zones at the goal, with
and without terminals) and compares the best goal's slew with the best of 60 SLSQP runs from random starts.

    python bench/decomposition.py [-n 1000] [--starts 60] [--seed 0]
"""

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import not_negative, positive
from tqdm import tqdm

sys.path.append(
    str(Path(__file__).parents[1] / "tests")
)  # the problems and the reference are those of the tests
from pointing import KINDS, Printed, random_problem

TOLERANCE = 1e-8  # rad by which slews may differ and count as the same


def compare(first: int, count: int, starts: int) -> None:
    """Solve problems by step 1 and by SLSQP from random starts, and print a row for each kind."""
    verdicts = {kind: Counter[str]() for kind in KINDS}
    goals, gaps = Counter[int](), []
    for seed in tqdm(range(first, first + count), unit="problem"):
        problem = random_problem(seed)
        found = problem.decompose()
        reference = Printed(problem).slsqp(starts, np.random.default_rng(np.random.SeedSequence(seed)))
        verdict = verdicts[KINDS[seed % len(KINDS)]]
        verdict["problems"] += 1
        verdict["solved"] += bool(found.goals)
        verdict["solved by SLSQP"] += np.isfinite(reference)
        if not found.goals:
            verdict["worse"] += np.isfinite(reference)
            continue
        goals[len(found.goals)] += 1
        gap = found.goals[0].slew_angle - reference
        verdict["worse"] += gap > TOLERANCE
        verdict["better"] += gap < -TOLERANCE
        if abs(gap) <= TOLERANCE:
            gaps.append(gap)
        if gap > TOLERANCE:
            tqdm.write(f"problem {seed}: {found.goals[0].slew_angle:.12f}, SLSQP {reference:.12f}")
    columns = ("problems", "solved", "solved by SLSQP", "worse", "better")
    print(f"{'kind':15}" + "".join(f"{column:>17}" for column in columns))
    for kind, verdict in [*verdicts.items(), ("all", sum(verdicts.values(), Counter[str]()))]:
        print(f"{kind:15}" + "".join(f"{verdict[column]:17d}" for column in columns))
    print(f"worse and better: by more than {TOLERANCE:g} rad than the best of {starts} SLSQP runs")
    if gaps:
        print(f"the others differ by {min(gaps):.1e} to {max(gaps):.1e} rad")
    print("distinct goals: " + ", ".join(f"{k} in {goals[k]}" for k in sorted(goals)) + "\n")


def latency(first: int, repeats: int) -> None:
    """Print the time of step 1, compiled before, for each kind of problems."""
    print("warm latency, ms       median     90 %")
    for number, kind in enumerate(KINDS):
        seconds = []
        for seed in range(first + number, first + number + len(KINDS) * repeats, len(KINDS)):
            problem = random_problem(seed)
            problem.decompose()  # compiles, where the padded size is new
            begin = time.perf_counter()
            problem.decompose()
            seconds.append(time.perf_counter() - begin)
        print(f"{kind:18}{1e3 * np.median(seconds):11.2f}{1e3 * np.quantile(seconds, 0.9):9.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--problems", type=positive, default=1000)
    parser.add_argument("--starts", type=positive, default=60, help="SLSQP runs a problem")
    parser.add_argument(
        "--seed", type=not_negative, default=0, help="number of the first problem, a multiple of ten"
    )
    parser.add_argument(
        "--repeats", type=positive, default=50, help="problems of each kind whose latency is measured"
    )
    options = parser.parse_args()
    if options.seed % len(KINDS):
        parser.error(
            f"argument --seed: {options.seed} must be a multiple of {len(KINDS)}, the number of kinds"
        )
    print_machine()
    latency(options.seed, options.repeats)
    print()
    compare(options.seed, options.problems, options.starts)


if __name__ == "__main__":
    main()
