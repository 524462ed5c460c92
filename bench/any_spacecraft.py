"""Plans of random spacecraft: how many are certified, and whether an independent check agrees.

Scenes of the kind any_spacecraft are planned in blocks, half of them "stretched", half in "minimum" duration.
Certified trajectories are checked at 3,001 instants in numpy and scipy alone, from what the scenario says of
each device: zones, masks, fields of view, ranges, limits, start, and goal. "broken" are those that break
something, or come nearer than what is proved; "unequal" are scenarios or plans that their files do not hold
to the last bit; "unnamed" are failures whose message names no device or constraint. There must be none of
these. Where `mha` gave up RRT-Connect has 10 s to find a path, "missed" if it does. What is found, and every
plan that was not certified, stands below the row of its block; what was cut off goes on with `--first-seed`.

    python bench/any_spacecraft.py [-n 1000] [--first-seed 0] [--block 48] [--workers 2]
"""

import argparse
import math
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
from _machine import print_machine
from _options import not_negative, positive

import jaxplan as jp
from jaxplan.cases.random_scenes import ANY_SPACECRAFT
from jaxplan.model.scenario import MINIMUM, STRETCHED

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the check is the tests' own
from dense import breaches
from reference import least_margin

GIVEN_UP = (jp.Status.NODE_LIMIT, jp.Status.TIME_LIMIT)
RRT_SECONDS = 10.0  # s that RRT-Connect has for a scene


def scene(seed: int) -> jp.Scenario:
    """The random scene of a seed, every other one with the duration "minimum"."""
    found = jp.random_scenario(seed, ANY_SPACECRAFT)
    search = replace(found.search, time_limit=math.inf)  # on a busy machine, too
    duration = MINIMUM if seed % 2 else STRETCHED
    return replace(found, search=search, trajectory=replace(found.trajectory, duration=duration))


def faults(plan: jp.Plan, folder: Path) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with a plan: the column that counts it, and a text; files go to a folder."""
    if plan.ok:
        found = breaches(plan)
        margin, least = plan.certificate.min_margin, least_margin(plan.scenario, plan.trajectory)
        if margin is not None and not least >= margin - 1e-9:
            found.append(f"{np.rad2deg(margin):g} deg are proved, {np.rad2deg(least):g} deg were met")
        if found:
            yield "broken", "; ".join(found)
    elif not _named(plan):
        yield "unnamed", f"{plan.status.name}: {plan.message}"
    if not _equal(plan, folder):
        yield "unequal", "its files hold another plan"
    if plan.status in GIVEN_UP and _found_by_rrt(plan.scenario):
        yield "missed", f"{plan.status.name}, but RRT-Connect found a path: {plan.message}"


def _named(plan: jp.Plan) -> bool:
    """Whether the message names a device or a constraint of the scenario."""
    names = {zone.any_of or zone.name for zone in plan.scenario.zones}
    return any(name in plan.message for name in (*names, *plan.scenario.spacecraft.device_names))


def _equal(plan: jp.Plan, folder: Path) -> bool:
    """Whether scenario and plan, written to a folder and read again, are the same to the last bit."""
    jp.save_scenario(plan.scenario, folder / "scene.toml")
    plan.save(folder / "plan.json")
    again = jp.load_plan(folder / "plan.json")
    pairs = (
        (plan.scenario, jp.load_scenario(folder / "scene.toml")),
        (plan.scenario, again.scenario),
        (plan.trajectory, again.trajectory),
    )
    for one, other in pairs:
        (leaves, tree), (others, other_tree) = jax.tree.flatten(one), jax.tree.flatten(other)
        if tree != other_tree or not all(map(np.array_equal, leaves, others)):
            return False
    return again.status is plan.status and again.message == plan.message


def _found_by_rrt(scenario: jp.Scenario) -> bool:
    """Whether RRT-Connect finds a path to one of the goals."""
    more = {"method": "rrt_connect", "time_limit": RRT_SECONDS, "max_expansions": 10**6}
    plan = jp.plan(replace(scenario, search=replace(scenario.search, **more)), throw=False)
    return plan.path is not None


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--scenes", type=positive, default=1000, help="number of scenes (%(default)s)")
    parser.add_argument("--first-seed", type=not_negative, default=0, help="of the scenes (%(default)s)")
    parser.add_argument("--block", type=positive, default=48, help="planned together (%(default)s)")
    parser.add_argument("--workers", type=positive, default=1, help="processes that plan (%(default)s)")
    options = parser.parse_args()
    print_machine(pinned=options.workers == 1)
    columns = ("broken", "unequal", "unnamed", "missed")
    print(f"{'seeds':<12}{'OK':>6}" + "".join(f"{name:>9}" for name in columns) + f"{'wall s':>9}  others")
    total = Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        last = options.first_seed + options.scenes
        for first in range(options.first_seed, last, options.block):
            began, count, lines = time.monotonic(), Counter[str](), []
            seeds = range(first, min(first + options.block, last))
            workers = None if options.workers == 1 else options.workers
            for plan in jp.plan_batch(map(scene, seeds), workers=workers, progress=False):
                count[plan.status.name] += 1
                if not plan.ok:
                    lines.append(f"{plan.scenario.name}: {plan.status.name}: {plan.message}")
                for word, fault in faults(plan, Path(folder)):
                    count[word] += 1
                    lines.append(f"{plan.scenario.name}: {word}: {fault}")
            total += count
            for name, own in ((f"{first} to {seeds[-1]}", count), ("all", total)):
                if own is total and seeds[-1] + 1 < last:
                    continue
                others = [f"{n} {word}" for word, n in own.items() if word.isupper() and word != "OK"]
                numbers = "".join(f"{own[column]:>9}" for column in columns)
                spent = f"{time.monotonic() - began:>9.0f}" if own is count else " " * 9
                print(f"{name:<12}{own['OK']:>6}{numbers}{spent}  {', '.join(others)}")
            print(*lines, sep="\n", end="\n" if lines else "", flush=True)
