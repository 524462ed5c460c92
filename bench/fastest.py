"""Shortest slews of a platform alone beside published optima, an independent optimiser, and other searches.

`published`: Bilimoria and Wie, JGCD 16(3), 1993, half a turn; other angles and inertias, and slews within
rates and accelerations, beside direct shooting. `random`: slews about axes that are drawn, axes of the body
among them, each kind of limits in turn, beside direct shooting from many starts. `zones`: scenes with round
zones, each beside the best plan of other searches if it is over 1 % above the bound. Every plan is certified.
`warm`: what whole plans take by the clock once all is compiled, by whether the platform is at a limit of its
own at some instant, or joints alone are. Of two plans of a scene the quicker one counts.

    python bench/fastest.py [published random zones warm] [-n 30] [--starts 64] [--searches 24]
"""

import argparse
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from _machine import print_machine
from _options import not_negative, positive
from _shooting import Slew

import jaxplan as jp
from jaxplan import so3

OPTIMUM = 3.2431  # s, published for half a turn of a unit inertia with a unit torque about each axis
FREE = np.full(3, np.inf)  # rad/s: rates without limits
INERTIAS = ((1.0, 1.0, 1.0), (1.0, 2.0, 3.0), (1.0, 1.0, 0.3), (1.0, 1.6, 1.6))  # kg m^2
RATE, ACCELERATION = np.deg2rad(3.0), np.deg2rad(2.0)
KINDS = ("hard_keep_out", "keep_out", "single_instrument")  # of scenes with zones
SUN = np.array([0.0, np.cos(np.deg2rad(23.4)), np.sin(np.deg2rad(23.4))])  # at a solstice
FULL = 0.99  # share of a limit from which on it is reached
SIX = 6  # number of cones of a scene with a single instrument


def scene_of(slew: Slew, ends: str) -> jp.Scenario:
    """The slew as a scenario in the shortest time, with accelerations at both ends that are zero or free."""
    turning: dict[str, object] = {"acceleration_limit": 1e3}
    if slew.inertia is None:
        turning["acceleration_limit"] = slew.push
    else:
        turning |= {"torque_limit": slew.push[0], "inertia": slew.inertia}
    craft = jp.Spacecraft(
        terminals=(),
        instruments=(jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),),
        rate_limit=np.where(np.isfinite(slew.rate), slew.rate, 10.0),
        **turning,
    )
    return jp.Scenario(
        name="slew",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=np.zeros(3), joints=np.zeros(0)),
        goal=jp.GivenState(rotation_vector=slew.turn, joints=np.zeros(0)),
        trajectory=jp.TrajectorySettings(duration="minimum", end_acceleration=ends),
    )


def single_instrument(seed: int) -> jp.Scenario:
    """Draw a scene of a camera alone that slews far among six cones."""
    rng = np.random.default_rng([77, seed])

    def drawn() -> np.ndarray:
        axis = rng.normal(size=3)
        return axis / np.linalg.norm(axis)

    boresight = np.array([1.0, 0.0, 0.0])
    while True:
        start = so3.exp(rng.uniform(0, np.pi) * drawn())
        goal = start @ so3.exp(rng.uniform(1.5, np.pi - 1e-3) * drawn())
        cones = [(drawn(), np.deg2rad(rng.uniform(10, 35))) for _ in range(SIX)]
        ends = [attitude @ boresight for attitude in (start, goal)]
        if all(np.arccos(np.clip(end @ axis, -1, 1)) > half + 0.03 for end in ends for axis, half in cones):
            break
    craft = jp.Spacecraft(
        terminals=(),
        instruments=(jp.Instrument(name="camera", boresight=boresight),),
        rate_limit=RATE,
        acceleration_limit=np.deg2rad(1.0),
    )
    return jp.Scenario(
        name=f"single instrument {seed}",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=so3.log(start), joints=np.zeros(0)),
        goal=jp.GivenState(rotation_vector=so3.log(goal), joints=np.zeros(0)),
        keep_out=tuple(
            jp.KeepOut(name=f"cone {number}", direction=axis, half_angle=half)
            for number, (axis, half) in enumerate(cones)
        ),
        trajectory=jp.TrajectorySettings(duration="minimum"),
    )


def timed(scenario: jp.Scenario) -> tuple[jp.Plan, float]:
    """Plan a scenario; returns the plan, and the CPU time that it took, s."""
    began = time.process_time()
    plan = jp.plan(scenario, throw=False, progress=False)
    return plan, time.process_time() - began


def beside(name: str, slew: Slew, starts: int, known: float = np.inf) -> tuple[float, float]:
    """Plan a slew with accelerations at both ends zero and free, and print its row.

    Args:
        name: of the row.
        slew: the slew.
        starts: of the independent optimiser; 0 for none.
        known: s, a duration that is published.

    Returns:
        Both durations over the best that is known.
    """
    plans = [timed(scene_of(slew, ends)) for ends in ("zero", "free")]
    bound = plans[0][0].duration_bound or np.nan
    guess = plans[0][0].trajectory.duration if plans[0][0].ok else 1.5 * bound
    best = min(known, slew.quickest(starts, guess)) if starts else known
    lasts = [plan.trajectory.duration if plan.ok else np.inf for plan, _ in plans]
    print(
        f"{name:<34} {best:>8.4f}  "
        + "  ".join(f"{last:>8.4f} {last / best:>7.4f}" for last in lasts)
        + f"  {bound / min(best, *lasts):>6.3f}  {1e3 * plans[0][1]:>7.0f} {1e3 * plans[1][1]:>7.0f}",
        flush=True,
    )
    return lasts[0] / best, lasts[1] / best


def print_head(title: str) -> None:
    """Print the columns of slews."""
    print(f"\n{title:<34} {'':>8}  {'accelerations zero':>16}  {'free':>16}  {'':>6}  {'CPU, ms':>15}")
    print(
        f"{'':<34} {'best, s':>8}  {'s':>8} {'ratio':>7}  {'s':>8} {'ratio':>7}  {'bound':>6}  "
        f"{'zero':>7} {'free':>7}"
    )


def published(starts: int) -> None:
    """Print rows of slews about axes of the body, where the turn about one axis is far from the quickest."""
    x, z = np.eye(3)[0], np.eye(3)[2]
    half = np.pi * (1 - 1e-9)
    print_head("about an axis of the body")
    for angle in (30, 60, 90, 120, 150, 180):
        turn = min(np.deg2rad(angle), half) * z
        slew = Slew(turn=turn, push=np.ones(3), rate=FREE, inertia=np.eye(3))
        known = OPTIMUM if angle == 180 else np.inf
        beside(f"unit sphere, torque 1, {angle} deg", slew, starts, known)
    for inertia in INERTIAS[1:]:
        slew = Slew(turn=half * z, push=np.ones(3), rate=FREE, inertia=np.diag(inertia))
        beside(f"inertia {inertia}, 180 deg", slew, starts)
    for angle in (90, 180):
        turn = min(np.deg2rad(angle), half) * x
        slew = Slew(turn=turn, push=np.full(3, ACCELERATION), rate=np.full(3, RATE))
        beside(f"3 deg/s, 2 deg/s^2, {angle} deg", slew, starts)
    slew = Slew(turn=half * z, push=np.full(3, ACCELERATION), rate=FREE)
    beside("2 deg/s^2, 180 deg", slew, starts)


def drawn_slews(first: int, count: int) -> Iterator[tuple[str, Slew]]:
    """Yield names and slews about random axes, every fourth about a body axis, with three kinds of limits."""
    for seed in range(first, first + count):
        rng = np.random.default_rng([28, seed])
        axis = np.eye(3)[seed % 3] if seed % 4 == 0 else rng.normal(size=3)
        turn = rng.uniform(0.3, np.pi - 1e-6) * axis / np.linalg.norm(axis)
        kind = ("rates", "accelerations", "torque")[seed % 3]
        if kind == "rates":
            slew = Slew(turn=turn, push=np.full(3, ACCELERATION), rate=np.full(3, RATE))
        elif kind == "accelerations":
            slew = Slew(turn=turn, push=np.full(3, ACCELERATION), rate=FREE)
        else:
            squares = rng.uniform(0.2, 1, size=3)  # kg m^2, of the distances along each axis: it is a body
            inertia = np.diag(np.sum(squares) - squares)
            slew = Slew(turn=turn, push=np.ones(3), rate=FREE, inertia=inertia)
        yield f"{seed}: {kind}, {np.rad2deg(np.linalg.norm(turn)):.0f} deg", slew


def random(first: int, count: int, starts: int) -> None:
    """Print rows of slews about random axes, and how far their durations are from the best known."""
    print_head("axes drawn")
    ratios = np.array([beside(name, slew, starts) for name, slew in drawn_slews(first, count)])
    for column, ends in enumerate(("zero", "free")):
        own = ratios[:, column]
        print(
            f"  {ends}: median {np.median(own):.4f}, largest {np.max(own):.4f}, "
            f"at most 1.02 in {np.sum(own <= 1.02)} of {len(own)}"
        )


def quickest_of_others(scene: jp.Scenario, searches: int) -> float:
    """The shortest duration, s, of other searches by two methods in turn, each fitted along its own path."""
    best = np.inf
    settings = replace(scene.trajectory, first_guesses=0)
    for number in range(searches):
        method, seed = ("mha", "rrt_connect")[number % 2], 1001 + number // 2
        search = replace(scene.search, method=method, seed=seed)
        plan, _ = timed(replace(scene, search=search, trajectory=settings))
        best = min(best, plan.trajectory.duration if plan.ok else np.inf)
    return best


def zones(first: int, count: int, searches: int, kinds: list[str]) -> None:
    """Print rows of scenes with zones, each beside the best of other searches if the bound leaves room."""
    for kind in kinds:
        print(f"\n{kind:<24} {'s':>8} {'bound, s':>9} {'others, s':>9} {'ratio':>7} {'CPU, ms':>8}")
        ratios, spent, failed = [], [], []
        for seed in range(first, first + count):
            scene = single_instrument(seed) if kind == "single_instrument" else jp.random_scenario(seed, kind)
            scene = replace(scene, trajectory=replace(scene.trajectory, duration="minimum"))
            plan, own = timed(scene)
            if not plan.ok:
                failed.append(f"{seed}: {plan.status.name}")
                continue
            spent.append(1e3 * own)
            duration, bound = plan.trajectory.duration, plan.duration_bound
            others = quickest_of_others(scene, searches) if duration > 1.01 * bound else np.inf
            ratios.append(max(1.0, duration / others))
            told = f"{others:9.3f}" if np.isfinite(others) else f"{'at bound':>9}"
            print(
                f"{seed:<24} {duration:8.3f} {bound:9.3f} {told} {ratios[-1]:7.4f} {spent[-1]:8.0f}",
                flush=True,
            )
        within = np.sum(np.array(ratios) <= 1.01)
        print(
            f"{kind}: {len(ratios)} of {count} certified, at most 1.01 times the best in {within}, largest "
            f"{max(ratios):.4f}, CPU {np.median(spent):.0f} ms in the median, "
            f"{np.quantile(spent, 0.9):.0f} ms in 90 %  {'; '.join(failed)}",
            flush=True,
        )


def in_the_shortest_time(scenarios: Iterable[jp.Scenario]) -> list[jp.Scenario]:
    """The scenarios in the shortest time, by the method "global"."""
    return [
        replace(own, trajectory=replace(own.trajectory, method="global", duration="minimum"))
        for own in scenarios
    ]


def warm(first: int, count: int) -> None:
    """Print what whole warm plans take, by kind of scene and by whose limits bind."""
    seeds = range(first, first + count)
    slews = [slew for _, slew in drawn_slews(first, count)]
    groups = {f"{ends} at the ends": [scene_of(slew, ends) for slew in slews] for ends in ("zero", "free")}
    groups["the paper's cases"] = in_the_shortest_time(jp.paper_case(number) for number in range(1, 5))
    for kind in ("keep_out", "keep_in", "hard_keep_in"):
        groups[kind] = in_the_shortest_time(jp.random_scenario(seed, kind) for seed in seeds)
    for kind in ("keep_out", "keep_in"):
        nearest = [replace(own, goal=replace(own.goal, criterion="least_rotation")) for own in groups[kind]]
        groups[f"{kind}, nearest goal"] = nearest
    switch = jp.link_switch(jp.walker("53:1584/72/39", 550.0), sun_direction=SUN)
    groups["satellites"] = in_the_shortest_time(switch.scenarios(range(0, 1584, 1584 // count)))
    by_limits: dict[bool, list[float]] = {True: [], False: []}
    print(f"\n{'whole plans, ms':<24} {'plans':>6} {'median':>7} {'90 %':>7}")
    for name, scenes in groups.items():
        took = []
        for scene in scenes:
            jp.plan(scene, throw=False, progress=False)
        for scene in scenes:
            seconds = []
            for _ in range(2):
                began = time.perf_counter()
                plan = jp.plan(scene, throw=False, progress=False)
                seconds.append(time.perf_counter() - began)
            took.append(1e3 * min(seconds))
            by_limits[at_its_limits(plan)].append(took[-1])
        print_times(name, took)
    print_times("the platform binds", by_limits[True])
    print_times("joints alone bind", by_limits[False])


def at_its_limits(plan: jp.Plan) -> bool:
    """Whether the platform reaches a limit of its rates, accelerations, torque or wheels."""
    shares = {} if plan.certificate is None else plan.certificate.peaks
    return max((share for name, share in shares.items() if "joint" not in name), default=0.0) > FULL


def print_times(name: str, took: list[float]) -> None:
    """Print a row of times, ms."""
    print(f"{name:<24} {len(took):>6} {np.median(took):>7.0f} {np.quantile(took, 0.9):>7.0f}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = ("published", "random", "zones", "warm")
    parser.add_argument("parts", nargs="*", default=parts, choices=(*parts, []), metavar="PART")
    parser.add_argument("-n", type=positive, default=30, help="drawn slews, and scenes of each kind")
    parser.add_argument("--starts", type=not_negative, default=64, help="of the independent optimiser")
    parser.add_argument("--searches", type=positive, default=24)
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS, help="of scenes with zones")
    parser.add_argument("--first-seed", type=not_negative, default=0)
    options = parser.parse_args()
    print_machine()
    if "published" in options.parts:
        published(options.starts)
    if "random" in options.parts:
        random(options.first_seed, options.n, options.starts)
    if "zones" in options.parts:
        zones(options.first_seed, options.n, options.searches, options.kinds)
    if "warm" in options.parts:
        warm(options.first_seed, options.n)
