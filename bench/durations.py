"""The method "global" on random scenes: durations over the strict bound, time to fit, independent check.

Each plan is flown by `_flight` in numpy alone. Times are without those of compiling, which plans keep apart.
Prints a row for each kind and duration. With --rates all scenes turn at the start, and every other one whose
goal is a state at the goal, too, at up to half the rates that are allowed.

    python bench/durations.py [-n 50] [--first-seed 0] [--kinds keep_out held_links] [--durations minimum 80]
                              [--rates]
"""

import argparse
from dataclasses import replace

import numpy as np
from _flight import flight_of, inspect
from _machine import print_machine
from _options import not_negative, positive

import jaxplan as jp
from jaxplan.cases import SKY_KINDS, random_scenario
from jaxplan.model.scenario import Scenario


def scenes(kind: str, first: int, count: int) -> list[Scenario]:
    """The paper's four cases for the kind "cases", else `count` random scenes from a first seed on."""
    if kind == "cases":
        return [jp.paper_case(number) for number in range(1, 5)]
    return [random_scenario(seed, kind) for seed in range(first, first + count)]


def in_motion(scenario: Scenario, seed: int) -> Scenario:
    """The scenario with random rates of the platform at the start, and of odd seeds at the goal."""
    rng = np.random.default_rng([seed, 7])
    most = np.broadcast_to(scenario.spacecraft.rate_limit, 3) / 2
    start, goal = (rng.uniform(-most, most) for _ in range(2))
    own = replace(scenario, start=replace(scenario.start, angular_velocity=start))
    if isinstance(own.goal, jp.GivenState) and seed % 2:
        own = replace(own, goal=replace(own.goal, angular_velocity=goal))
    return own


def report(kind: str, duration: float | str, scenarios: list[Scenario]) -> None:
    """Plan all scenes in a duration, s or a word, fly the plans, and print their row."""
    ratios, fits, totals, refused, failed = [], [], [], 0, []
    for number, scenario in enumerate(scenarios):
        settings = replace(scenario.trajectory, method="global", duration=duration)
        asked = replace(scenario, trajectory=settings)
        plan = jp.plan(asked, throw=False, progress=False)
        if not plan.ok:
            failed.append(f"{number}: {plan.status.name}")
            continue
        refused += bool(inspect(asked, plan.goal, flight_of(plan.trajectory)).refusal)
        ratios.append(plan.trajectory.duration / plan.duration_bound)
        fits.append(1e3 * plan.timings["trajectory"])
        totals.append(1e3 * plan.timings["total"])
    low, middle, high = np.quantile(ratios, [0, 0.5, 0.9])
    print(
        f"{kind:<14} {duration!s:<10} {len(ratios):>4} of {len(scenarios):<4} {refused:>7}  "
        f"{low:>7.4f} {middle:>8.4f} {high:>8.4f}  {np.median(fits):>9.1f} {np.quantile(fits, 0.9):>9.1f} "
        f"{np.median(totals):>9.1f}  {'; '.join(failed)}",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=positive, default=50, help="random scenes of each kind")
    parser.add_argument("--first-seed", type=not_negative, default=0)
    parser.add_argument("--kinds", nargs="+", choices=("cases", *SKY_KINDS), default=("cases", *SKY_KINDS))
    parser.add_argument("--durations", nargs="+", default=("minimum", "stretched", "80"))
    parser.add_argument("--rates", action="store_true", help="random rates at the ends")
    options = parser.parse_args()
    print_machine()
    print(
        f"{'':<14} {'':<10} {'certified':<12} {'refused':>7}  {'duration over the bound':>25}  "
        f"{'fit, ms':>19} {'plan, ms':>9}\n"
        f"{'scenes':<14} {'duration':<10} {'':<12} {'':>7}  {'least':>7} {'median':>8} {'90 %':>8}  "
        f"{'median':>9} {'90 %':>9} {'median':>9}"
    )
    for kind in options.kinds:
        for word in options.durations:
            duration = word if word in ("minimum", "stretched") else float(word)
            chosen = scenes(kind, options.first_seed, options.n)
            if options.rates:
                chosen = [in_motion(one, seed) for seed, one in enumerate(chosen, options.first_seed)]
            report(kind, duration, chosen)
