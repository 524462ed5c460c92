"""Slopes of plans beside differences of plans that are made anew along the same path.

Three groups of plans by the method "global": in a given duration among hard zones, in a given duration in low
orbit where targets and zones move, and shortest ones. Of each the slopes of the effort, or of the shortest
duration, by the duration, weights, the half angle of the nearest zone and limits of rates, and two plans made
anew for each (`jaxplan.follow`, taken to its optimum), a little to either side. Prints for each number how
many slopes there are, how many are told apart since other rows, places or peaks bind on the two sides, or a
side is not held, and the median and largest error, as a share of the difference or of a thousandth of what is
measured for each relative change of the number, whichever is larger. What it takes to go on from a fit to the
optimum (`trajectory.optimal`), and what a plan's own is above its optimum's, follow.

    python bench/slopes.py [-n 30] [--moving 10] [--shortest 10] [--duration 60] [--step 1e-4]
"""

import argparse
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jax
import numpy as np
from _machine import print_machine
from _options import not_negative
from tqdm import tqdm

import jaxplan as jp
from jaxplan.derivatives import Held
from jaxplan.planner.steps import wanted_fit
from jaxplan.runtime.jit import known_options
from jaxplan.trajectory import fit_batch
from jaxplan.trajectory.measures import time_factors
from jaxplan.trajectory.outcome import NOT_OPTIMAL

Change = Callable[[jp.Scenario, float], jp.Scenario]
Measure = Callable[[jp.Trajectory], Any]
Place = Callable[[Any], Any]  # function of the slopes by all numbers of a scenario that returns one of them

LOW_ORBIT = Path(__file__).parents[1] / "tests" / "scenarios" / "low_orbit.toml"
SAME_PLACE = 1e-3  # of the duration: places on the curve that are farther apart are two
SAME_PEAK = 1e-3  # of the duration: peaks that are farther apart are two
# Without optimisation and XLA's newer emitters a sixth of the time; what is computed is small.
QUICKLY = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}


@cache
def compiled(measure: Measure) -> Callable[..., Any]:
    """Jitted function of a scenario and what is held: value, trajectory and slopes of a measure."""

    def measured(own: jp.Scenario, held: Held) -> tuple[Any, jp.Trajectory]:
        trajectory = jp.replan(held, own)
        return measure(trajectory), trajectory

    return jax.jit(
        jax.value_and_grad(measured, has_aux=True, allow_int=True),
        compiler_options=known_options(**QUICKLY),
    )


def told(scenario: jp.Scenario, held: Held, measure: Measure) -> tuple[float, jp.Trajectory, jp.Scenario]:
    """Value of a measure, the trajectory, and the slopes by all numbers of the scenario, in 64 bits."""
    plain = jax.tree.map(np.asarray, replace(scenario, name=""))  # names would be compiled for anew
    with jax.enable_x64(True):
        (value, trajectory), slopes = compiled(measure)(plain, held)
    return float(value), jax.tree.map(np.asarray, trajectory), slopes


def numbers(plan: jp.Plan) -> Iterator[tuple[str, float, Change, Place]]:
    """Yield the numbers whose slopes are checked: name, value, how to change it, its place among slopes."""
    scenario = plan.scenario
    craft, settings = scenario.spacecraft, scenario.trajectory

    def of_settings(name: str) -> tuple[str, float, Change, Place]:
        return (
            name.replace("_", " "),
            getattr(settings, name),
            lambda own, value: replace(own, trajectory=replace(own.trajectory, **{name: value})),
            lambda slopes: getattr(slopes.trajectory, name),
        )

    def of_craft(name: str) -> tuple[str, float, Change, Place]:
        return (
            name.replace("_", " "),
            getattr(craft, name),
            lambda own, value: replace(own, spacecraft=replace(own.spacecraft, **{name: value})),
            lambda slopes: getattr(slopes.spacecraft, name),
        )

    if settings.timed:
        yield of_settings("duration")
    yield of_settings("rate_weight")
    yield of_settings("acceleration_weight")
    yield of_craft("rate_limit")

    def slower(own: jp.Scenario, value: float) -> jp.Scenario:
        terminals = tuple(replace(one, rate_limit=value) for one in own.spacecraft.terminals)
        return replace(own, spacecraft=replace(own.spacecraft, terminals=terminals))

    if len({one.rate_limit for one in craft.terminals}) == 1:
        yield (
            "joint rate limit",
            craft.terminals[0].rate_limit,
            slower,
            lambda slopes: sum(one.rate_limit for one in slopes.spacecraft.terminals),
        )
    nearest = [zone for zone in scenario.keep_out if zone.name == plan.certificate.worst_zone]
    if nearest:
        index = scenario.keep_out.index(nearest[0])

        def wider(own: jp.Scenario, value: float) -> jp.Scenario:
            zones = list(own.keep_out)
            zones[index] = replace(zones[index], half_angle=value)
            return replace(own, keep_out=tuple(zones))

        yield (
            "half angle",
            nearest[0].half_angle,
            wider,
            lambda slopes: slopes.keep_out[index].half_angle,
        )


def binding(held: Held) -> list[np.ndarray]:
    """Arrays of which constraints bind, and at which places, to be compared."""
    parts = [vars(part) for part in (held.fit.linear, held.fit.loads, held.fit.zones)]
    return [np.asarray(row) for part in parts for name, row in part.items() if name not in ("row", "rows")]


def same(lows: list[np.ndarray], highs: list[np.ndarray]) -> bool:
    """Whether the same constraints bind at the same places, from `binding` of two plans."""
    return all(
        low.shape == high.shape and np.allclose(low, high, atol=SAME_PLACE)
        for low, high in zip(lows, highs, strict=True)
    )


def optimal_cost(plan: jp.Plan) -> tuple[float, float, bool] | None:
    """Seconds of a fit and from there to the optimum, compiling aside, and whether the latter is certified.

    None where there is no optimum.
    """
    assert plan.path is not None
    assert plan.goal is not None
    query = [wanted_fit(plan.scenario, plan.path, plan.goal)]
    fit_batch(query)
    begin = time.process_time()
    record = fit_batch(query)[0].origin
    middle = time.process_time()
    if record.at_optimum() is None:  # which compiles
        return None
    after = time.process_time()
    record.at_optimum()
    taken = time.process_time() - after
    settings = replace(plan.scenario.trajectory, optimal=True)
    best = jp.follow(plan, replace(plan.scenario, trajectory=settings))
    return middle - begin, taken, best.ok and NOT_OPTIMAL not in best.message


def peak_time(trajectory: jp.Trajectory, scenario: jp.Scenario) -> float:
    """Time of the largest peak of a motion relative to its limit, as a share of the duration."""
    shares = np.linspace(0, 1, 10_001)
    factors = time_factors(trajectory.sample(shares * trajectory.duration), scenario.spacecraft)
    return float(shares[np.argmax(np.asarray(factors))])


def anew(plan: jp.Plan, scenario: jp.Scenario) -> Held | None:
    """Plan a scenario near a plan's along its path, and hold that; None if it cannot be held."""
    try:
        return jp.hold(jp.follow(plan, scenario))
    except ValueError:
        return None


def compare(plan: jp.Plan, step: float, errors: dict[str, list[float]]) -> float | None:
    """Compare the slopes of a plan with differences.

    Args:
        plan: the plan.
        step: relative change of each number to either side.
        errors: by name of the number, to which errors are added; NaN where both sides differ in what binds.

    Returns:
        Excess of the plan's measure over that of its optimum, as a share; None if it cannot be held.
    """
    measure = jp.measures.effort if plan.scenario.trajectory.timed else jp.measures.duration
    try:
        held = jp.hold(plan)
    except ValueError:
        return None
    own, _, slopes = told(plan.scenario, held, measure)
    for name, value, change, place in numbers(plan):
        slope = float(place(slopes))
        changed = [change(plan.scenario, value * (1 + sign * step)) for sign in (-1, 1)]
        low, high = (anew(plan, other) for other in changed)
        errors.setdefault(name, []).append(np.nan)
        if low is None or high is None or not same(binding(low), binding(high)):
            continue
        ends, curves, _ = zip(
            *(told(other, its, measure) for other, its in zip(changed, (low, high), strict=True)), strict=True
        )
        if not plan.scenario.trajectory.timed:
            peaks = [peak_time(curve, other) for curve, other in zip(curves, changed, strict=True)]
            if abs(peaks[1] - peaks[0]) > SAME_PEAK:
                continue
        difference = (ends[1] - ends[0]) / (2 * step * value)
        errors[name][-1] = abs(slope - difference) / max(abs(difference), 1e-3 * own / value)
    with jax.enable_x64(True):
        return float(measure(plan.trajectory)) / own - 1


def show(name: str, scenes: list[jp.Scenario], step: float) -> None:
    """Plan a group, compare its slopes, and print what came of it."""
    plans = [plan for plan in jp.plan_batch(scenes, progress=False) if plan.ok]
    errors: dict[str, list[float]] = {}
    above = [compare(plan, step, errors) for plan in tqdm(plans, leave=False)]
    held = [own for own in above if own is not None]
    print(f"\n{name}: {len(scenes)} scenes, {len(plans)} planned, {len(held)} held")
    print(f"{'number':<20}{'slopes':>8}{'apart':>8}{'median':>12}{'largest':>12}")
    errors["all"] = [error for own in errors.values() for error in own]
    for label, own in errors.items():
        kept = [error for error in own if np.isfinite(error)]
        found = f"{np.median(kept):>12.1e}{np.max(kept):>12.1e}" if kept else ""
        print(f"{label:<20}{len(kept):>8}{len(own) - len(kept):>8}{found}")
    costs = [cost for plan in plans if (cost := optimal_cost(plan)) is not None]
    if costs:
        fits, ways, certified = (np.array(own) for own in zip(*costs, strict=True))
        print(
            f"to the optimum: median {1e3 * np.median(ways):.0f} ms beside {1e3 * np.median(fits):.0f} ms "
            f"of a fit, {np.sum(certified)} of {len(plans)} certified"
        )
    if held:
        print(f"above the optimum: median {np.median(held):.1e}, largest {max(held, key=abs):.1e}")


def in_time(scenes: Iterable[jp.Scenario], duration: float | str) -> list[jp.Scenario]:
    """Scenes with the method "global" and a duration, s, or "minimum"."""
    return [
        replace(own, trajectory=replace(own.trajectory, method="global", duration=duration)) for own in scenes
    ]


def low_orbit(count: int) -> list[jp.Scenario]:
    """Hand-overs of links in low orbit, in durations from 66 to 102 s."""
    scene = jp.load_scenario(LOW_ORBIT)
    return [own for duration in np.linspace(66.0, 102.0, count) for own in in_time([scene], float(duration))]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--plans", type=not_negative, default=30, help="among hard zones")
    parser.add_argument("--moving", type=not_negative, default=10, help="plans in low orbit")
    parser.add_argument("--shortest", type=not_negative, default=10, help="shortest plans")
    parser.add_argument("--duration", type=float, default=60.0, help="s, among hard zones")
    parser.add_argument("--step", type=float, default=1e-4, help="to either side, relative")
    options = parser.parse_args()
    print_machine()
    hard = [jp.random_scenario(seed, "hard_keep_out") for seed in range(options.plans)]
    show("hard_keep_out", in_time(hard, options.duration), options.step)
    show("low orbit, moving", low_orbit(options.moving), options.step)
    hard = [jp.random_scenario(seed, "hard_keep_out") for seed in range(options.shortest)]
    show("shortest", in_time(hard, "minimum"), options.step)
