"""Goals of least time beside those of least rotation: how much sooner they are, and what step 1 takes for it.

`problems`: random problems of step 1, as of bench/decomposition.py, of each kind: the strict bound of the
time to the goal of least rotation and to that of least time, and the warm time of step 1 for either.
`scenes`: random scenes with targets, planned in the shortest time to either goal, and the bound of the time
beside the least of many goals that are drawn.

    python bench/least_time_goals.py [problems scenes] [-n 200] [--seed 0] [--drawn 200000]
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import not_negative, positive
from scipy.spatial.transform import Rotation
from tqdm import tqdm

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the problems are those of the tests
from pointing import KINDS, Problem, random_problem

import jaxplan as jp
from jaxplan import so3
from jaxplan.goal import Decomposition
from jaxplan.model.constraints import constraint_margins, state_margins
from jaxplan.model.duration_bound import rest_bounds
from jaxplan.model.gimbals import angles_toward
from jaxplan.planner.steps import find_goals

SCENES = ("keep_out", "keep_in", "hard_keep_out", "hard_keep_in", "held_links")
SAME = 1e-3  # share of a duration by which two fits to one goal may differ
_NEAR, _ROUNDS = 16, 4  # goals drawn so far near which a round draws, and how many rounds


def solved(problem: Problem, criterion: str) -> tuple[Decomposition, float]:
    """Solve a problem by a criterion; returns its goals, and the time that step 1 took once compiled, s."""
    asked = replace(problem, targets=replace(problem.targets, criterion=criterion))
    asked.decompose()
    begin = time.perf_counter()
    return asked.decompose(), time.perf_counter() - begin


def bound(problem: Problem, found: Decomposition) -> float:
    """Strict lower bound of the time to the first goal, s."""
    goal = found.goals[0]
    turn = np.asarray(so3.log(problem.start.T @ goal.attitude))
    return float(rest_bounds(problem.spacecraft, turn[None], goal.joints[None])[0])


def least_of_drawn(scene: jp.Scenario, count: int, seed: int) -> float:
    """Least strict bound of the time, s, to goals that are drawn: half of all attitudes, then near the best.

    A goal meets all targets exactly, within the ranges and clear of the zones; inf where none is found.
    """
    rng = np.random.default_rng([41, seed])
    craft, targets, rows = scene.spacecraft, scene.goal, scene.constraints
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
    start = np.asarray(so3.exp(scene.start.rotation_vector))
    limits = np.array([targets.yaw_limit, targets.pitch_limit]).repeat(len(craft.terminals))
    ranges = np.clip(craft.joint_ranges, -limits[:, None], limits[:, None])
    attitudes = random_attitudes(rng, count // 2)
    best, kept = np.inf, np.empty((0, 3, 3))
    known = np.empty(0)
    for number in range(_ROUNDS + 1):
        azimuth, elevation = angles_toward(craft.gimbals.frames, attitudes, targets.directions)
        joints = np.concatenate([azimuth, elevation], axis=-1)
        able = np.all((joints >= ranges[:, 0]) & (joints <= ranges[:, 1]), axis=-1)
        attitudes, joints = attitudes[able], joints[able]
        margins = state_margins(rows, sights, attitudes, joints)
        clear = np.all(constraint_margins(rows, margins) >= 0, axis=-1)
        attitudes, joints = attitudes[clear], joints[clear]
        turns = np.asarray(so3.log(start.T @ attitudes))
        times = np.asarray(rest_bounds(craft, turns, joints - scene.start.joints))
        kept, known = np.concatenate([kept, attitudes]), np.concatenate([known, times])
        first = np.argsort(known)[:_NEAR]
        kept, known = kept[first], known[first]
        if not len(kept):
            return np.inf
        best = known[0]
        spread = 0.1 / 4**number  # rad
        size = count // 2 // _ROUNDS // len(kept) + 1
        offsets = rng.normal(scale=spread, size=(len(kept), size, 3))
        attitudes = (kept[:, None] @ np.asarray(so3.exp(offsets))).reshape(-1, 3, 3)
    return float(best)


def random_attitudes(rng: np.random.Generator, count: int) -> np.ndarray:
    """Uniform random attitudes (count, 3, 3)."""
    return Rotation.random(count, rng=rng).as_matrix()


def first_bound(scene: jp.Scenario) -> float:
    """Strict bound of the time, s, to the first goal of least time that step 1 finds."""
    goal = find_goals(replace(scene, goal=replace(scene.goal, criterion="least_time")))[0]
    turn = np.asarray(so3.log(scene.start.attitude.T @ goal.attitude))
    return float(rest_bounds(scene.spacecraft, turn[None], (goal.joints - scene.start.joints)[None])[0])


def scenes(first: int, count: int, drawn: int) -> None:
    """Print how much sooner scenes of each kind end at goals of least time, and how good their bounds are."""
    print(
        f"{'kind':15}{'both planned':>13}{'sooner':>8}{'median':>9}{'most':>8}{'later':>7}"
        f"{'bound within 1 %':>18}{'most above':>11}  not planned"
    )
    for kind in SCENES:
        gains, above, failed = [], [], []
        for seed in tqdm(range(first, first + count), unit=kind, leave=False):
            scene = jp.random_scenario(seed, kind)
            scene = replace(scene, trajectory=replace(scene.trajectory, duration="minimum"))
            plans = {
                criterion: jp.plan(
                    replace(scene, goal=replace(scene.goal, criterion=criterion)), throw=False, progress=False
                )
                for criterion in ("least_time", "least_rotation")
            }
            failed += [f"{seed} {name}: {plan.status.name}" for name, plan in plans.items() if not plan.ok]
            soonest, nearest = plans.values()
            above.append(first_bound(scene) / least_of_drawn(scene, drawn, seed) - 1)
            if soonest.ok and nearest.ok:
                gains.append(1 - soonest.trajectory.duration / nearest.trajectory.duration)
                if gains[-1] < -SAME or above[-1] > 0.01:
                    tqdm.write(f"  {kind} {seed}: {gains[-1]:.4f} sooner, bound {above[-1]:.4f} above")
        won, over = np.array(gains), np.array(above)
        print(
            f"{kind:15}{len(won):7} of {count:<3}"
            f"{100 * np.mean(won > SAME):7.0f}%{100 * np.median(won):8.1f}%"
            f"{100 * np.max(won):7.1f}%{np.sum(won < -SAME):7d}{100 * np.mean(over <= 0.01):17.1f}%"
            f"{100 * np.max(over):10.2f}%  {'; '.join(failed)}",
            flush=True,
        )
    print("sooner: share of scenes; median, most: share of the duration that is gained; later: must be 0")


def problems(first: int, count: int) -> None:
    """Print how much less the bounds of the time are to goals of least time, and what step 1 takes for it."""
    print(f"{'kind':15}{'sooner':>8}{'median':>9}{'most':>8}{'later':>7}{'more ms':>9}")
    for number, kind in enumerate(KINDS):
        gains, more = [], []
        for place in tqdm(range(first, first + count), unit=kind, leave=False):
            problem = random_problem(number + len(KINDS) * place)
            nearest, before = solved(problem, "least_rotation")
            soonest, after = solved(problem, "least_time")
            more.append(after - before)
            if nearest.goals:
                first, second = bound(problem, nearest), bound(problem, soonest)
                gains.append(1 - second / first if first > 0 else 0.0)
        sooner, later = np.mean(np.array(gains) > 1e-3), np.sum(np.array(gains) < -1e-9)
        print(
            f"{kind:15}{100 * sooner:7.0f}%{100 * np.median(gains):8.1f}%{100 * max(gains):7.1f}%{later:7d}"
            f"{1e3 * np.median(more):9.1f}"
        )
    print("sooner: share of problems; median, most: share of the bound that is gained; later: must be 0")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = ("problems", "scenes")
    parser.add_argument("parts", nargs="*", default=parts, choices=(*parts, []), metavar="PART")
    parser.add_argument("-n", type=positive, default=200, help="of each kind")
    parser.add_argument("--seed", type=not_negative, default=0, help="number of the first of each kind")
    parser.add_argument("--drawn", type=positive, default=200_000, help="goals beside which bounds stand")
    options = parser.parse_args()
    print_machine()
    if "problems" in options.parts:
        problems(options.seed, options.n)
    if "scenes" in options.parts:
        scenes(options.seed, options.n, options.drawn)


if __name__ == "__main__":
    main()
