"""Time of the certificate and what it does for it: instants evaluated, and how close its bounds come.

Prints for trajectories of the paper's cases, at 80 s and stretched to the limits, the median and least time
of `certify`, the instants at which it evaluates the trajectory, its bound of the least margin beside the
least on a grid of 100,001 instants, and its largest peak over limit beside the grid's. Then the time for
more zones than any case has.

    python bench/certificate.py [--repeats 100]
"""

import argparse
import time
from dataclasses import replace

import jax
import numpy as np
from _machine import print_machine
from _options import positive

import jaxplan as jp
from jaxplan.certificate import Certificate
from jaxplan.model import constraints, zones
from jaxplan.model.tabulation import tabulate
from jaxplan.planner.proving import prove


def on_grid(scenario: jp.Scenario, trajectory: jp.Trajectory) -> tuple[float, float]:
    """Least margin, rad, and largest ratio of a rate, acceleration or joint angle to its limit, on a grid."""
    craft = scenario.spacecraft
    cones = tabulate(scenario.keep_out, scenario.keep_in, craft)
    least, ratio = np.inf, 0.0
    for times in np.array_split(np.linspace(0, trajectory.duration, 100_001), 100):
        s = trajectory.sample(times)
        with jax.enable_x64(True):
            devices = constraints.pair_margins(cones, craft.boresights(s.attitude, s.joints), cones.axis)
            least = np.minimum(least, np.asarray(constraints.constraint_margins(cones, devices)).min())
        for values, limit in (
            (s.angular_velocity, craft.rate_limit),
            (s.angular_acceleration, craft.acceleration_limit),
            (s.joint_rates, craft.joint_rate_limits),
            (s.joint_accelerations, craft.joint_acceleration_limits),
            (s.joints, craft.joint_ranges[:, 1]),
        ):
            ratio = np.maximum(ratio, np.abs(values / limit).max(initial=0))
    return float(least), float(ratio)


def timed(scenario: jp.Scenario, plan: jp.Plan, repeats: int) -> tuple[Certificate, float, float]:
    """Certify a plan's trajectory `repeats` times; returns the certificate, and median and least ms."""
    assert plan.goal is not None
    assert plan.trajectory is not None
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        report = prove(scenario, plan.goal, plan.trajectory)
        seconds.append(time.perf_counter() - begin)
    return report, 1e3 * float(np.median(seconds)), 1e3 * min(seconds)


def crowded(scenario: jp.Scenario, count: int) -> jp.Scenario:
    """The scenario with `count` small keep-out zones for all devices besides its own zones."""
    directions = np.random.default_rng(0).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    small = [zones.KeepOut(name=f"small-{i}", direction=d, half_angle=1e-3) for i, d in enumerate(directions)]
    return replace(scenario, keep_out=(*scenario.keep_out, *small))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=positive, default=100)
    options = parser.parse_args()
    print_machine()
    print(
        "case          median ms  least ms  instants   margin proved / on grid, deg   peak proved / on grid"
    )
    for duration in (80.0, "stretched"):
        for number in (1, 2, 3, 4):
            case = jp.paper_case(number)
            case = replace(case, trajectory=replace(case.trajectory, duration=duration))
            plan = jp.plan(case, throw=False, progress=False)
            if plan.trajectory is None:
                print(f"{number} {duration!s:<11} {plan.status.name}")
                continue
            report, median, least = timed(case, plan, options.repeats)
            assert report.min_margin is not None
            margin, peak = on_grid(case, plan.trajectory)
            print(
                f"{number} {duration!s:<11}{median:10.1f}{least:10.1f}{report.evaluations:10d}"
                f"{np.rad2deg(report.min_margin):18.5f} / {np.rad2deg(margin):.5f}"
                f"{max(report.peaks.values()):18.9f} / {peak:.9f}"
            )
    case = jp.paper_case(2)
    plan = jp.plan(case, progress=False)
    for count in (60, 996):
        report, median, least = timed(crowded(case, count), plan, max(options.repeats // 10, 3))
        print(f"2 with {len(case.keep_out) + count:4d} zones: median {median:.1f} ms, least {least:.1f} ms")
