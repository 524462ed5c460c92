"""Goals of instruments with targets: step 1 beside a grid over roll, and beside scipy's SLSQP.

Random problems, solvable by construction, of the kinds in which instruments have targets. Where one has, the
platform is free to roll about it: slews are compared with the least on a grid over that roll, refined at its
minima and where something begins to break. All are compared with the best of many runs of SLSQP. Then another
device gets a wish, which on the same grid must be met as nearly; every other problem has a wish before it
that no roll changes. "worse" are answers that are so by more than 1e-6 rad. What is worse stands below its
row; rows are cumulative, and what was cut off goes on with `--first`.

    python bench/instrument_goals.py [-n 500] [--starts 60] [--first 0]
"""

import argparse
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import not_negative, positive

import jaxplan as jp

# problems and references are the tests' own; before the benches, of which one has the name of a test's module
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from pointing import Problem
from pointing_aims import KINDS, axes, over_roll, random_aims, slsqp
from reference import angle, random_units

TOLERANCE = 1e-6  # rad by which answers may differ and count as the same
EVERY = 50  # problems from one row to the next
OURS = [number for number, (_, aimed) in enumerate(KINDS.values()) if aimed[2]]
COLUMNS = ("problems", "solved", "on a grid", "worse", "by SLSQP", "worse", "better", "wishes", "worse")


def seed_of(number: int) -> int:
    """The seed of the problem of a number among those whose instruments have targets."""
    turn, place = divmod(number, len(OURS))
    return turn * len(KINDS) + OURS[place]


class Wishing:
    """A problem with a wish: a random direction that its first device without a target prefers."""

    def __init__(self, problem: Problem, seed: int) -> None:
        craft, targets = problem.spacecraft, problem.targets
        free = [one for one in (*craft.drives, *craft.instruments) if one.name not in targets.devices]
        self.device = free[0]
        self.toward = random_units(np.random.default_rng((seed, 1)))
        (still,) = targets.directions[[name.startswith("camera") for name in targets.devices]]
        prefer = [jp.Wish(device=self.device.name, direction=self.toward)]
        if seed % 2 and isinstance(self.device, jp.Instrument):
            prefer.insert(0, jp.Wish(device=self.device.name, direction=still))
        self.problem = replace(problem, targets=replace(targets, prefer=tuple(prefer)))

    def distance(self, attitude: np.ndarray) -> np.ndarray:
        """Least angle (...) rad from the device to its wish at attitudes (..., 3, 3), body to inertial."""
        seen = self.toward @ attitude
        if isinstance(self.device, jp.Instrument):
            return angle(seen, self.device.boresight)
        up, ahead = np.array(self.device.axis), np.array(self.device.boresight)
        own = seen @ axes(up, ahead)
        low, high = self.device.range
        middle, tilt = (low + high) / 2, np.arcsin(up @ ahead)
        off = np.mod(np.arctan2(own[..., 1], own[..., 0]) - middle + np.pi, 2 * np.pi) - np.pi
        beyond = np.maximum(np.abs(off) - (high - low) / 2, 0)
        level, height = np.hypot(own[..., 0], own[..., 1]), own[..., 2]
        beam = np.stack(
            [np.cos(tilt) * np.cos(beyond), np.cos(tilt) * np.sin(beyond), np.sin(tilt) + 0 * off], -1
        )
        return angle(beam, np.stack([level, 0 * level, height], -1))


def judge(seed: int, starts: int, count: Counter[str], largest: dict[str, float]) -> list[str]:
    """Solve the problem of a seed by step 1 and by the references, and count who is better.

    Args:
        seed: of the problem.
        starts: runs of SLSQP; 0 for none.
        count: counters by column, which are raised.
        largest: by reference, the largest angle, rad, by which ours is worse, which is updated.

    Returns:
        A line for each answer that is worse than a reference's.
    """
    kind, problem = random_aims(seed)
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    goals, lines = problem.decompose().goals, []
    count["problems"] += 1
    slew = goals[0].slew_angle if goals else np.inf
    count["solved"] += bool(goals)
    found = {}
    rolls = sum(name.startswith("camera") for name in problem.targets.devices) == 1
    if rolls and "drive" not in kind:
        found["grid"] = slew, over_roll(problem)
        wishing = Wishing(problem, seed)
        wished = wishing.problem.decompose().goals
        ours = float(wishing.distance(wished[0].attitude)) if wished else np.inf
        found["wish"] = ours, over_roll(problem, wishing.distance)
    if starts:
        found["SLSQP"] = slew, slsqp(problem, starts, rng)
    for name, (ours, theirs) in found.items():
        count[name] += np.isfinite(theirs)
        if np.isfinite(theirs):
            largest[name] = max(
                largest.get(name, -np.inf), ours - theirs if ours > theirs - TOLERANCE else -np.inf
            )
        count[f"{name} worse"] += ours > theirs + TOLERANCE
        count[f"{name} better"] += ours < theirs - TOLERANCE
        if ours > theirs + TOLERANCE:
            lines.append(f"seed {seed}, {kind}: {ours:.9f} rad, {name} {theirs:.9f}")
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-n", "--problems", type=positive, default=500, help="number of problems (%(default)s)"
    )
    parser.add_argument("--starts", type=not_negative, default=60, help="SLSQP runs a problem (%(default)s)")
    parser.add_argument("--first", type=not_negative, default=0, help="number of the first (%(default)s)")
    options = parser.parse_args()
    print_machine()
    print("".join(f"{column:>10}" for column in COLUMNS) + f"{'wall s':>10}")
    keys = (
        "problems",
        "solved",
        "grid",
        "grid worse",
        "SLSQP",
        "SLSQP worse",
        "SLSQP better",
        "wish",
        "wish worse",
    )
    count, largest, began, lines = Counter[str](), dict[str, float](), time.monotonic(), list[str]()
    for number in range(options.first, options.first + options.problems):
        lines += judge(seed_of(number), options.starts, count, largest)
        if count["problems"] % EVERY == 0 or count["problems"] == options.problems:
            spent = time.monotonic() - began
            print("".join(f"{count[key]:>10}" for key in keys) + f"{spent:>10.0f}")
            print(*lines, sep="\n", end="\n" if lines else "", flush=True)
            lines.clear()
    for name, gap in largest.items():
        print(f"worst beside {name}: {gap:.1e} rad")
