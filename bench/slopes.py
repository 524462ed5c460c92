"""Slopes of plans beside differences of plans that are made anew along the same path.

Plans random scenes in a given duration by the method "global", takes the slope of the effort by the duration,
the weight of the rate, the half angle of the nearest zone and the limit of the rate, and makes two plans anew
for each (`jaxplan.follow`, taken to its optimum), a little to either side. Prints for each number how many
slopes there are, how many are not comparable since other rows bind on the two sides, or a side is not held,
and the median and largest error, as a share of the difference or of a thousandth of the effort for each
relative change of the number, whichever is larger. What the plan's effort is above its optimum's follows.

    python bench/slopes.py [-n 30] [--kind hard_keep_out] [--duration 60] [--step 1e-4]
"""

import argparse
from collections.abc import Callable
from dataclasses import replace

import jax
import numpy as np
from _machine import print_machine
from _options import positive
from tqdm import tqdm

import jaxplan as jp
from jaxplan.cases import RANDOM_KINDS
from jaxplan.derivatives import Differentiable

Change = Callable[[jp.Scenario, float], jp.Scenario]


def numbers(plan: jp.Plan) -> dict[str, tuple[float, Change]]:
    """What is changed: its value, and the scenario with another one."""
    scenario = plan.scenario
    craft, settings = scenario.spacecraft, scenario.trajectory
    found: dict[str, tuple[float, Change]] = {
        "duration": (
            settings.duration,
            lambda own, value: replace(own, trajectory=replace(own.trajectory, duration=value)),
        ),
        "rate weight": (
            settings.rate_weight,
            lambda own, value: replace(own, trajectory=replace(own.trajectory, rate_weight=value)),
        ),
        "rate limit": (
            craft.rate_limit,
            lambda own, value: replace(own, spacecraft=replace(own.spacecraft, rate_limit=value)),
        ),
    }
    nearest = [zone for zone in scenario.keep_out if zone.name == plan.certificate.worst_zone]
    if nearest:
        index = scenario.keep_out.index(nearest[0])

        def wider(own: jp.Scenario, value: float) -> jp.Scenario:
            zones = list(own.keep_out)
            zones[index] = replace(zones[index], half_angle=value)
            return replace(own, keep_out=tuple(zones))

        found["half angle"] = nearest[0].half_angle, wider
    return found


# Compiled once for all plans of equal shapes.
_effort = jax.jit(lambda held, scenario: jp.measures.effort(jp.replan(held, scenario)))


def effort(function: Differentiable) -> float:
    """Of the plan at its optimum, in 64 bits."""
    with jax.enable_x64(True):
        return float(jp.measures.effort(function.optimum.trajectory))


def binding(function: Differentiable) -> list[np.ndarray]:
    """Which rows bind, as arrays to be compared."""
    fit = function.held.fit
    rows = [leaf for part in (fit.linear, fit.loads, fit.zones) for leaf in jax.tree.leaves(part)]
    return [np.asarray(row) for row in rows if np.asarray(row).dtype.kind in "bi"]


def anew(plan: jp.Plan, scenario: jp.Scenario) -> Differentiable | None:
    """The plan of a scenario near another's, made anew along its path; None where it cannot be held."""
    try:
        return jp.differentiable(jp.follow(plan, scenario))
    except ValueError:
        return None


def compare(plan: jp.Plan, step: float, errors: dict[str, list[float]]) -> float | None:
    """Add the errors of a plan's slopes, NaN for what cannot be compared; its effort above the optimum's."""
    try:
        function = jp.differentiable(plan)
    except ValueError:
        return None
    own = effort(function)
    with jax.enable_x64(True):
        for name, (value, change) in numbers(plan).items():
            slope = float(jax.grad(lambda v, c=change: _effort(function.held, c(plan.scenario, v)))(value))
            sides = [anew(plan, change(plan.scenario, value * (1 + sign * step))) for sign in (-1, 1)]
            low, high = sides
            alike = (
                low is not None
                and high is not None
                and len(binding(low)) == len(binding(high))
                and all(map(np.array_equal, binding(low), binding(high)))
            )
            if not alike:
                errors.setdefault(name, []).append(np.nan)
                continue
            difference = (effort(high) - effort(low)) / (2 * step * value)
            least = 1e-3 * own / value
            errors.setdefault(name, []).append(abs(slope - difference) / max(abs(difference), least))
        return float(jp.measures.effort(plan.trajectory)) / own - 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--plans", type=positive, default=30)
    parser.add_argument("--kind", choices=RANDOM_KINDS, default="hard_keep_out")
    parser.add_argument("--duration", type=float, default=60.0, help="s")
    parser.add_argument("--step", type=float, default=1e-4, help="to either side, relative")
    options = parser.parse_args()
    print_machine()
    scenes = [jp.random_scenario(seed, options.kind) for seed in range(options.plans)]
    scenes = [
        replace(own, trajectory=replace(own.trajectory, method="global", duration=options.duration))
        for own in scenes
    ]
    errors: dict[str, list[float]] = {}
    plans = [plan for plan in jp.plan_batch(scenes, progress=False) if plan.ok]
    above = [compare(plan, options.step, errors) for plan in tqdm(plans, leave=False)]
    held = [own for own in above if own is not None]
    print(f"{len(scenes)} scenes, {len(plans)} planned, {len(held)} held")
    print(f"{'number':<14}{'slopes':>8}{'apart':>8}{'median':>12}{'largest':>12}")
    for name, own in errors.items():
        told = np.array([error for error in own if np.isfinite(error)])
        print(
            f"{name:<14}{len(told):>8}{len(own) - len(told):>8}{np.median(told):>12.1e}{np.max(told):>12.1e}"
        )
    print(f"effort above that of the optimum: median {np.median(held):.1e}, largest {np.max(held):.1e}")
