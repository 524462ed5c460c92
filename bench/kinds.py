"""Plans among constraints of every kind: how many are certified, and whether dense samples agree.

Random scenes of the kinds that are not only cones on the sky are planned together, half of them "stretched",
half of them in "minimum" duration. Certified trajectories are then sampled at 5,003 instants, and their
margins computed from the zones as they are stated, in numpy and scipy alone. "broken" are those with a margin
below zero by more than the certificate allows; there must be none. "refused" are trajectories that were found
but not certified. Prints a row for each kind, with the least of the sampled margins and the median of the
seconds that a plan took, its share of what is done together and without compiling. What went wrong follows.

    python bench/kinds.py [-n 112] [--first-seed 0] [--kinds masks mixed] [--workers 2]
"""

import argparse
import math
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import not_negative, positive

import jaxplan as jp
from jaxplan.cases import RANDOM_KINDS, SKY_KINDS
from jaxplan.model.scenario import MINIMUM, STRETCHED

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the check is the tests' own
from reference import least_margin

NEW_KINDS = tuple(kind for kind in RANDOM_KINDS if kind not in SKY_KINDS)
ALLOWED = 1e-9  # rad below zero


def scenes(kind: str, first: int, count: int) -> list[jp.Scenario]:
    """Random scenes of a kind, every other one with the duration "minimum"."""
    found = []
    for seed in range(first, first + count):
        scene = jp.random_scenario(seed, kind)
        duration = MINIMUM if seed % 2 else STRETCHED
        search = replace(scene.search, time_limit=math.inf)  # on a busy machine, too
        found.append(replace(scene, search=search, trajectory=replace(scene.trajectory, duration=duration)))
    return found


def report(kind: str, plans: list[jp.Plan]) -> list[str]:
    """Print the row of a kind; returns a line for each plan that is worth a look."""
    statuses, lines, broken, least = Counter(plan.status for plan in plans), [], 0, np.inf
    for plan in plans:
        if plan.ok:
            margin = least_margin(plan.scenario, plan.trajectory)
            least = np.fmin(least, margin)
            if margin >= -ALLOWED:
                continue
            broken += 1
            lines.append(f"{plan.scenario.name}: certified, but {np.rad2deg(margin):.6f} deg")
        else:
            lines.append(f"{plan.scenario.name}: {plan.status.name}: {plan.message}")
    refused = statuses.pop(jp.Status.UNCERTIFIED, 0)
    certified = statuses.pop(jp.Status.OK, 0)
    others = ", ".join(f"{count} {status.name}" for status, count in statuses.most_common())
    seconds = np.median([plan.timings["total"] for plan in plans])
    print(
        f"{kind:<14}{len(plans):>7}{certified:>7}{broken:>8}{refused:>9}{np.rad2deg(least):>11.4f}"
        f"{seconds:>9.2f}  {others}",
        flush=True,
    )
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--scenes", type=positive, default=112, help="of each kind (%(default)s)")
    parser.add_argument("--first-seed", type=not_negative, default=0, help="of the scenes (%(default)s)")
    parser.add_argument("--kinds", nargs="+", choices=RANDOM_KINDS, default=NEW_KINDS, metavar="KIND")
    parser.add_argument("--workers", type=positive, default=1, help="processes that plan (%(default)s)")
    options = parser.parse_args()
    print_machine(pinned=options.workers == 1)
    print(
        f"{'kind':<14}{'scenes':>7}{'OK':>7}{'broken':>8}{'refused':>9}{'least deg':>11}{'median s':>9}"
        "  others"
    )
    workers = None if options.workers == 1 else options.workers
    found = {
        kind: report(
            kind, list(jp.plan_batch(scenes(kind, options.first_seed, options.scenes), workers=workers))
        )
        for kind in options.kinds
    }
    print()
    for line in (line for lines in found.values() for line in lines):
        print(line)
