"""Flights with wheels by worker processes, and their table: plans with a tube, and those without."""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from itertools import starmap
from multiprocessing import get_context

import numpy as np
from _wheel_check import STEP, Deviation, Outcome, deviation, fly_all
from scipy.stats import binomtest
from tqdm import tqdm

import jaxplan as jp

CHUNK = 25  # scenes that are planned together
COMPARED = 5  # flights without errors

HEAD = (
    f"{'':<14}{'flown':>6}{'left the tube':>26}{'broke a cone':>15}{'saturated':>18}{'duration, s':>12}"
    f"{'margin, deg':>14}{'error, deg':>21}{'torque':>14}{'momentum':>14}\n"
    f"{'':<14}{'':>6}{'':>26}{'in it':>8}{'out':>7}{'by torque':>10}{'speed':>8}{'median':>12}"
    f"{'median':>8}{'least':>6}{'median':>8}{'99 %':>6}{'most':>7}" + 2 * f"{'median':>8}{'most':>6}"
)


def report(count: int, workers: int, tube: jp.Robust, each: bool) -> None:
    """Plan and fly, and print all.

    Args:
        count: of scenes.
        workers: processes.
        tube: of the first row, and for what is counted in the second.
        each: whether with a line for each flight.
    """
    chunks = [range(first, min(first + CHUNK, count)) for first in range(0, count, CHUNK)]
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        compared = [
            (step, [pool.submit(deviation, seed, step) for seed in range(min(COMPARED, count))])
            for step in (STEP, STEP / 10)
        ]
        flights: dict[str, list[Future[list[Outcome]]]] = {"with tube": [], "without": []}
        for chunk in chunks:
            for name, kept in (("with tube", tube), ("without", None)):
                flights[name].append(pool.submit(fly_all, chunk, kept))
        for step, found in compared:
            print(undisturbed(step, [one.result() for one in found]))
        with tqdm(total=2 * count, desc="flown", unit=" plans") as bar:
            for pair in zip(*flights.values(), strict=True):
                for done in pair:
                    bar.update(len(done.result()))
    print(
        f"tube: {np.rad2deg(tube.attitude_error):g} deg, {tube.torque_reserve:g} % of the torque and "
        f"{tube.momentum_reserve:g} % of the momentum of wheels kept back\n{HEAD}"
    )
    for name, parts in flights.items():
        outcomes = [one for part in parts for one in part.result()]
        print(f"{row(name, outcomes, tube)}\n{'':<14}{notes(outcomes)}")
        if each:
            print("\n".join(f"  {one}" for one in outcomes))


def row(name: str, outcomes: Sequence[Outcome], tube: jp.Robust) -> str:
    """A row of the table; what is NaN counts as broken, saturated and out of the tube."""
    flown = [one for one in outcomes if one.status == "OK"]
    if not flown:
        return f"{name:<14}{0:>6}"
    duration, margin, error, torque, momentum = (
        np.array([getattr(one, field) for one in flown])
        for field in ("duration", "margin", "error", "torque", "momentum")
    )
    stayed, kept = error <= np.rad2deg(tube.attitude_error), margin >= 0
    left = int(np.sum(~stayed))
    bounds = binomtest(left, len(flown)).proportion_ci(0.95, method="exact")
    between = f"{100 * bounds.low:.1f} to {100 * bounds.high:.1f} %"
    return (
        f"{name:<14}{len(flown):>6}{left:>7} = {100 * left / len(flown):>4.1f} ({between})".ljust(46)
        + f"{np.sum(stayed & ~kept):>8}{np.sum(~stayed & ~kept):>7}"
        f"{np.sum(~(torque <= 1)):>10}{np.sum(~(momentum < 1)):>8}{np.median(duration):>12.1f}"
        f"{np.median(margin):>8.2f}{np.min(margin):>6.2f}"
        f"{np.median(error):>8.3f}{np.quantile(error, 0.99):>6.2f}{np.max(error):>7.3f}"
        f"{np.median(torque):>8.3f}{np.max(torque):>6.2f}{np.median(momentum):>8.3f}{np.max(momentum):>6.2f}"
    )


def notes(outcomes: Sequence[Outcome]) -> str:
    """Lines on what was not planned, and on the momentum that nothing should change."""
    failed = Counter(one.status for one in outcomes if one.status != "OK")
    drift = np.max([one.drift for one in outcomes if one.status == "OK"], initial=0.0)
    told = ", ".join(starmap("{1} {0}".format, failed.items())) or "none"
    return f"not planned: {told}; total momentum changed by at most {drift:.0e} N m s"


def undisturbed(step: float, found: Sequence[Deviation]) -> str:
    """A line on flights without errors."""
    momentum, torque, attitude = (
        np.max([getattr(one, field) for one in found]) for field in ("momentum", "torque", "attitude")
    )
    return (
        f"{len(found)} flights without errors, steps of {step:g} s: off the plan by at most {momentum:.5f} "
        f"N m s and {torque:.5f} N m of a wheel, {attitude:.4f} deg"
    )
