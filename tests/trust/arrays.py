"""Plans of spacecraft with 3 to 6 reaction wheels about random axes, sampled densely by numpy and scipy.

Wheels differ in all numbers and hold something at the start. By the pseudo-inverse each keeps its limits at
every sample, by the envelope a linear program finds a sharing out that does, and neither is so with limits a
little tighter. What the certificate says was reached at most is near what samples show.
"""

import numpy as np
from wheels import (
    by_envelope,
    by_pseudo_inverse,
    exchanged,
    instants,
    least_shared,
    numbers,
    random_wheels,
    with_wheels,
)

import jaxplan as jp

SAMPLES = 4000  # of a plan
PROGRAMS = 20  # samples of a plan and quantity for which a linear program is solved, half of them the worst
ROUNDING = 1e-9  # of a limit
SAMPLED = 1e-7  # likewise, what differences of attitudes leave of an acceleration's digits
TIGHTER = 1e-4  # of what is reached
NEAR = 1.01  # what is proved over the largest sample
DURATIONS = ("minimum", "stretched", 120.0)


def attempt(seed: int) -> str:
    """Plan and sample the array of a seed; returns how near the certificate comes to the samples."""
    count, allocation = 3 + seed % 4, ("pseudo_inverse", "minimax")[seed // 4 % 2]
    scenario = with_wheels(
        random_wheels(count, seed=1000 + seed), allocation, seed=seed, duration=DURATIONS[seed % 3]
    )
    plan = jp.plan(scenario, progress=False)
    craft, trajectory = plan.scenario.spacecraft, plan.trajectory
    time = instants(trajectory, SAMPLES)
    stated = by_pseudo_inverse if allocation == "pseudo_inverse" else by_envelope
    axes, *limits, _ = numbers(craft)
    farthest = 1.0
    vectors = exchanged(trajectory, craft, time)
    for name, shares, limit, own in zip(
        ("wheel_torques", "wheel_momenta"), stated(trajectory, craft, time), limits, vectors, strict=True
    ):
        largest = np.abs(shares).max(axis=1)
        most, proved = largest.max(), plan.certificate.peaks[name]
        assert most <= 1 + ROUNDING, f"{name} reaches {most:.12g} of its limit"
        assert most <= proved * (1 + SAMPLED), f"{name} reaches {most:.12g}, {proved:.12g} is proved"
        assert proved <= NEAR * most, f"{name} is proved to reach {proved:.6g}, {most:.6g} is met"
        farthest = max(farthest, proved / most)
        if allocation == "minimax":
            worst = np.argsort(largest)[-PROGRAMS // 2 :]
            for place in {*worst, *range(0, len(time), 2 * len(time) // PROGRAMS)}:
                needed = least_shared(axes, limit, own[place])[0]
                assert needed <= 1 + ROUNDING, f"{name} needs {needed:.12g} at {time[place]} s"
            tight = limit * most * (1 - TIGHTER)
            assert least_shared(axes, tight, own[worst[-1]])[0] > 1, f"{name} fits into less than it takes"
    near = next(share for share in (1e-5, 1e-4, 1e-3, 1e-2) if farthest <= 1 + share)
    return f"{allocation} within {100 * near:g} %"
