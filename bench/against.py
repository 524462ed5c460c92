"""Plans by this checkout and by another one, in turns: milliseconds a plan by step, alone and together.

Random scenes of the five kinds, stretched and shortest, the paper's cases, and satellites of a constellation
are planned one by one and in one batch, in processes of their own that take turns. Of each figure the least
over rounds and turns is taken, and the least memory of a process. Both checkouts must know what the script
calls; the installed package is not used.

    python bench/against.py DIR [--scenes 10] [--satellites 60] [--turns 3] [--rounds 3]
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from _machine import print_machine
from _options import positive
from tqdm import tqdm

HERE = Path(__file__).resolve().parent.parent
PROGRAM = """
import json, resource, sys, time
from collections import Counter
from dataclasses import replace
import jaxplan as jp

scenes, satellites, rounds = map(int, sys.argv[1:])
kinds = ("keep_out", "keep_in", "hard_keep_out", "hard_keep_in", "held_links")
random = [jp.random_scenario(seed, kind) for kind in kinds for seed in range(scenes)]
shell = jp.walker("53:1584/72/39", 550.0)
switch = jp.link_switch(shell, sun_direction=[0.0, 0.9174771, 0.3977885])
groups = {
    "random, stretched": random,
    "random, shortest": [
        replace(one, trajectory=replace(one.trajectory, duration="minimum")) for one in random[::3]
    ],
    "the paper's cases": [jp.paper_case(number) for number in (1, 2, 3, 4)] * 3,
    "satellites": [switch.scenario(number) for number in range(satellites)],
}
least = {}
for group, chosen in groups.items():
    for way in ("alone", "together"):
        for round in range(rounds + 1):  # the first one compiles
            began = time.perf_counter()
            if way == "alone":
                plans = [jp.plan(scene, throw=False, progress=False) for scene in chosen]
            else:
                plans = jp.plan_batch(chosen, progress=False)
            spent = Counter({"all told": time.perf_counter() - began})
            for plan in plans:
                spent.update({step: plan.timings.get(step, 0.0) for step in STEPS})
            for step, seconds in spent.items() if round else ():
                name = f"{group}|{way}|{step}"
                least[name] = min(least.get(name, 1e9), 1e3 * seconds / len(chosen))
least["|memory|MiB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps(least))
"""
STEPS = ("decompose", "search", "trajectory", "certificate")


def measured(tree: Path, cache: str, arguments: list[str]) -> dict[str, float]:
    """Run the program in a process that uses a checkout; returns its figures, by "group|way|step".

    Args:
        tree: folder of the checkout.
        cache: folder in which it keeps compiled code.
        arguments: of the program.
    """
    environment = {
        **os.environ,
        "PYTHONPATH": str(tree),
        "XDG_CACHE_HOME": cache,
        "OPENBLAS_NUM_THREADS": "1",
    }
    program = f"STEPS = {STEPS}\n{PROGRAM}"
    answer = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env=environment, cwd=cache, capture_output=True, text=True, check=True,
    )  # fmt: skip
    figures: dict[str, float] = json.loads(answer.stdout)
    return figures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tree", type=Path, help="the other checkout")
    parser.add_argument("--scenes", type=positive, default=10, help="of each kind")
    parser.add_argument("--satellites", type=positive, default=60)
    parser.add_argument("--turns", type=positive, default=3, help="processes of each checkout")
    parser.add_argument("--rounds", type=positive, default=3, help="in each process")
    options = parser.parse_args()
    print_machine()
    trees = {"this": HERE, "other": options.tree.resolve()}
    arguments = [str(number) for number in (options.scenes, options.satellites, options.rounds)]
    least: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for _ in tqdm(range(options.turns), leave=False, disable=None):
            for name, tree in trees.items():
                cache = Path(folder) / name
                cache.mkdir(exist_ok=True)
                for figure, value in measured(tree, str(cache), arguments).items():
                    own = least.setdefault(figure, {})
                    own[name] = min(value, own.get(name, value))
    print(f"\n{'ms a plan':<20}{'':<10}{'step':<13}{'other':>9}{'this':>9}{'ratio':>7}")
    for figure, own in least.items():
        group, way, step = figure.split("|")
        ratio = own["this"] / own["other"]
        print(f"{group:<20}{way:<10}{step:<13}{own['other']:>9.2f}{own['this']:>9.2f}{ratio:>7.2f}")
