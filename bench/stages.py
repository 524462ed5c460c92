"""Slews of a light spacecraft whose terminals push back, beside plans that do not know of it.

The scenes are the paper's four cases and random ones like them. The whole has 100 kg m^2 about each axis, and
four wheels in a pyramid of 0.2 N m and 8 N m s each, empty at the start. A terminal has 5 kg: a fork of 2 kg
that yaws, with a radius of gyration of 0.15 m about the yaw axis, and on it a telescope of 3 kg, a cylinder
0.4 m long and 0.2 m thick. `--heavier` multiplies their inertias.

Of each plan that is made without these inertias the largest torque of the platform's body axes without and
with them, the certificate's largest share of a wheel's torque and momentum with them, and how much longer a
plan takes that knows of them. Then how many plans break a wheel's limit, and warm CPU times of plans, also of
a body without wheels, in two boxes of limits about its axes. The inner one is what the pyramid can give about
all axes at once, as it is approximated by hand; the outer one what it gives about one axis at a time.

    python bench/stages.py [-n 20] [--heavier 1 10] [--repeats 3]
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from _machine import print_machine
from _options import not_negative, positive
from tqdm import tqdm

import jaxplan as jp

WHOLE = np.diag([100.0, 100.0, 100.0])  # kg m^2
FORK = np.array([0.03, 0.03, 0.045])  # kg m^2 about boresight, left, yaw axis
TELESCOPE = np.array([0.015, 0.0475, 0.0475])
PYRAMID = np.array([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]]) / np.sqrt(2)
TORQUE, MOMENTUM = 0.2, 8.0  # N m, N m s
DURATIONS = ("minimum", "stretched")
ALLOWED = 1e-6  # share of a limit by which the certificate lets a plan pass it
OUTER, INNER = 1.0, 0.5  # shares of what the pyramid gives along an axis: each alone, all together


def in_a_box(scenario: jp.Scenario, duration: str, share: float) -> jp.Scenario:
    """The scene with limits about the body's axes instead of wheels, a share of what the pyramid gives."""
    scenario = scene(scenario, duration, 0.0)
    along = share * np.sum(np.abs(PYRAMID), axis=0)  # of the unit wheels
    box = {"torque_limit": TORQUE * along, "wheel_momentum_limit": MOMENTUM * along}
    return replace(scenario, spacecraft=replace(scenario.spacecraft, wheels=(), **box))


def scene(scenario: jp.Scenario, duration: str, factor: float) -> jp.Scenario:
    """The scene with wheels and terminals of these inertias times a factor; zero for none."""
    wheels = [
        jp.Wheel(name=f"wheel-{k}", axis=axis, torque=TORQUE, momentum=MOMENTUM)
        for k, axis in enumerate(PYRAMID, 1)
    ]
    terminals = [
        replace(one, yaw_inertia=factor * FORK, pitch_inertia=factor * TELESCOPE) if factor else one
        for one in scenario.spacecraft.terminals
    ]
    craft = replace(
        scenario.spacecraft, inertia=WHOLE, torque_limit=None, wheel_momentum_limit=None, wheels=tuple(wheels)
    )
    craft = replace(craft, terminals=tuple(terminals))
    fit = replace(scenario.trajectory, method="global", duration=duration)
    return replace(scenario, spacecraft=craft, trajectory=fit)


def scenes(count: int) -> list[tuple[str, jp.Scenario]]:
    """The paper's cases and random scenes, by name."""
    cases = [(f"case {number}", jp.paper_case(number)) for number in range(1, 5)]
    return cases + [(f"random {seed}", jp.random_scenario(seed)) for seed in range(count)]


def compare(own: Sequence[tuple[str, jp.Scenario]], factor: float) -> None:
    """Print what plans without the inertias come to with them, and what plans with them take."""
    print(f"inertias of stages times {factor:g}")
    print(f"{'':24}{'torque, N m':>20}{'share of a wheel':>24}{'duration, s':>20}")
    print(f"{'':24}{'without':>10}{'with':>10}{'torque':>12}{'momentum':>12}{'without':>10}{'with':>10}")
    for duration in DURATIONS:
        broken, most, longer, planned = 0, [], [], 0
        for name, scenario in tqdm(own, leave=False, disable=not sys.stderr.isatty()):
            blind, told = (scene(scenario, duration, own_factor) for own_factor in (0.0, factor))
            plan, other = (jp.plan(each, throw=False, progress=False) for each in (blind, told))
            if not (plan.ok and other.ok):
                continue
            planned += 1
            trajectory = plan.trajectory
            torques = [float(jp.measures.peak_torque(trajectory, each.spacecraft)) for each in (blind, told)]
            peaks = jp.certify(replace(plan, scenario=told)).peaks
            shares = [peaks[key] for key in ("wheel_torques", "wheel_momenta")]
            broken += max(shares) > 1 + ALLOWED
            most.append(max(shares))
            durations = trajectory.duration, other.trajectory.duration
            longer.append(durations[1] / durations[0])
            if name.startswith("case"):
                line = f"{name + ', ' + duration:24}" + "".join(f"{value:10.4f}" for value in torques)
                line += "".join(f"{value:12.4f}" for value in shares)
                print(line + "".join(f"{value:10.2f}" for value in durations))
        print(
            f"{duration}: {broken} of {planned} plans made without break a wheel's limit; share of a limit "
            f"median {np.median(most):.4f}, largest {max(most):.4f}; plans that know take "
            f"{np.median(longer):.4f} times as long (median), at most {max(longer):.4f}"
        )
    print()


def seconds(calls: Sequence[Callable[[], object]], repeats: int) -> list[float]:
    """CPU seconds of each call, the least of some in turns, after one of each that compiles."""
    for call in calls:
        call()
    found = np.empty((repeats, len(calls)))
    for row in found:
        for column, call in enumerate(calls):
            begin = time.process_time()
            call()
            row[column] = time.process_time() - begin
    return np.min(found, axis=0).tolist()


def clock(own: Sequence[jp.Scenario], repeats: int) -> None:
    """Print warm CPU times of plans in boxes, with wheels, and with the inertias, alone and in a batch."""
    names = ("outer box", "inner box", "wheels", "inertias", "over outer", "over inner", "over wheels")
    print(f"{'CPU, ms a plan':20}" + "".join(f"{name:>13}" for name in names))
    for duration in DURATIONS:
        variants = [[in_a_box(each, duration, share) for each in own] for share in (OUTER, INNER)]
        variants += [[scene(each, duration, factor) for each in own] for factor in (0.0, 1.0)]
        alone = np.sum(
            [
                seconds([partial(jp.plan, each, throw=False, progress=False) for each in same], repeats)
                for same in tqdm(
                    list(zip(*variants, strict=True)), leave=False, disable=not sys.stderr.isatty()
                )
            ],
            axis=0,
        )
        batch = seconds([partial(jp.plan_batch, each, progress=False) for each in variants], repeats)
        for name, found in (("alone", alone), ("batch", batch)):
            times = 1e3 * np.asarray(found) / len(own)
            ratios = times[3] / times[:3]
            line = f"{duration + ', ' + name:20}" + "".join(f"{value:13.1f}" for value in times)
            print(line + "".join(f"{value:13.2f}" for value in ratios))


def main() -> None:
    """Read the options, compare and clock."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-n", type=not_negative, default=20, help="random scenes beside the cases")
    parser.add_argument("--heavier", type=float, nargs="*", default=[1.0, 10.0], help="factors on inertias")
    parser.add_argument("--repeats", type=positive, default=3, help="of which the least time counts")
    options = parser.parse_args()
    print_machine()
    for factor in options.heavier:
        compare(scenes(options.n), factor)
    clock([each for _, each in scenes(options.n)], options.repeats)


if __name__ == "__main__":
    main()
