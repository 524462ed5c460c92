"""Slews of the Hubble Space Telescope as arXiv 2509.22422 has it, from random attitudes to as many others.

Inertia, torque, rates of each axis and the Sun to stay 20 deg away from are in tests/scenarios/hubble.toml;
start and goal are uniform among the attitudes 25 deg or more from the Sun. Each is flown in the least time
that is found ("minimum"), and as fast as its path's pace allows ("stretched"). "broken" are certified plans
that break something at 3,001 instants, checked in numpy and scipy alone; there must be none. "slack" is the
duration over the bound that no motion can undercut. Plans are made one by one, each with its own time.

    python bench/hubble.py [-n 100] [--first-seed 0]
"""

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import not_negative, positive

import jaxplan as jp
from jaxplan.model.scenario import MINIMUM, STRETCHED

# scenes and check are the tests' own; before the benches, of which one has the name of a test's module
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from dense import breaches
from telescopes import hubble


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--scenes", type=positive, default=100, help="number of starts (%(default)s)")
    parser.add_argument("--first-seed", type=not_negative, default=0, help="of the scenes (%(default)s)")
    options = parser.parse_args()
    print_machine()
    print(
        f"{'duration':<12}{'OK':>5}{'broken':>8}{'ms, median':>12}{'90 %':>7}"
        f"{'flight s':>10}{'slack':>7}  others"
    )
    for duration in (STRETCHED, MINIMUM):
        count, spent, flights, slack = Counter[str](), [], [], []
        for seed in range(options.first_seed, options.first_seed + options.scenes):
            scenario = hubble(seed, duration=duration)
            if not spent:
                jp.plan(scenario, throw=False)  # compiles
            begin = time.perf_counter()
            plan = jp.plan(scenario, throw=False)
            spent.append(1e3 * (time.perf_counter() - begin))
            count[plan.status.name] += 1
            if not plan.ok:
                print(f"seed {seed}: {plan.status.name}: {plan.message}")
                continue
            flights.append(plan.trajectory.duration)
            slack.append(plan.trajectory.duration / plan.duration_bound)
            faults = breaches(plan)
            count["broken"] += bool(faults)
            if faults:
                print(f"seed {seed}: {'; '.join(faults)}")
        others = [f"{number} {word}" for word, number in count.items() if word.isupper() and word != "OK"]
        print(
            f"{duration:<12}{count['OK']:>5}{count['broken']:>8}{np.median(spent):>12.0f}"
            f"{np.quantile(spent, 0.9):>7.0f}{np.median(flights):>10.0f}{np.median(slack):>7.2f}  "
            + ", ".join(others),
            flush=True,
        )


if __name__ == "__main__":
    main()
