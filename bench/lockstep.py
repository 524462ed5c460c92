"""Searches in a batch beside one by one: paths a second on one core, and whether the answers agree.

python bench/lockstep.py [-n 256] [--kinds keep_out keep_in] [--repeats 5]
"""

import argparse
import time
from dataclasses import replace

import numpy as np
from _machine import print_machine
from _options import positive
from tqdm import tqdm

import jaxplan as jp
from jaxplan.cases import SKY_KINDS
from jaxplan.model.scenario import SearchSettings
from jaxplan.search import PLANNERS, Scene, SearchResult, search_batch
from jaxplan.study.printed_planners import make_problem


def one_by_one(scenes: list[Scene], settings: list[SearchSettings]) -> list[SearchResult]:
    """Search scenes one after the other, with the settings of each."""
    return [PLANNERS["mha"](scene, each) for scene, each in zip(scenes, settings, strict=True)]


def same(first: SearchResult, second: SearchResult) -> bool:
    """Whether two answers agree to 1e-6."""
    if first.path is None or second.path is None:
        return first.path is second.path and first.status is second.status
    return first.path.joints.shape == second.path.joints.shape and all(
        np.allclose(one, other, rtol=0, atol=1e-6)
        for one, other in (
            (first.path.attitudes, second.path.attitudes),
            (first.path.joints, second.path.joints),
        )
    )


def compare(kind: str, count: int, repeats: int) -> None:
    """Search scenes of a kind one by one and in a batch, in turns, and print paths a second of both."""
    scenarios = [
        jp.random_scenario(seed, kind) for seed in tqdm(range(count), desc=kind, unit="scene", leave=False)
    ]
    scenes, settings = [make_problem(scenario) for scenario in scenarios], [s.search for s in scenarios]
    answers = {one_by_one: one_by_one(scenes, settings), search_batch: search_batch(scenes, settings)}
    seconds: dict[object, list[float]] = {call: [] for call in answers}
    for _ in range(repeats):
        for call in answers:  # in turns, so that a noisy machine hits both
            new = [replace(scene) for scene in scenes]  # with nothing of them computed yet
            begin = time.perf_counter()
            call(new, settings)
            seconds[call].append(time.perf_counter() - begin)
    alone, together = (count / float(np.median(seconds[call])) for call in (one_by_one, search_batch))
    agree = sum(same(*pair) for pair in zip(*answers.values(), strict=True))
    print(f"{kind:15}{count:7d}{alone:12.0f}{together:12.0f}{together / alone:8.2f}{agree:8d}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--scenes", type=positive, default=256, help="searched at once (default 256)")
    parser.add_argument("--kinds", nargs="+", choices=SKY_KINDS, default=SKY_KINDS)
    parser.add_argument("--repeats", type=positive, default=5)
    options = parser.parse_args()
    print_machine()
    print(f"{'':15}{'':7}{'paths a second':>24}{'':8}{'same':>8}")
    print(f"{'kind':15}{'scenes':>7}{'one by one':>12}{'together':>12}{'ratio':>8}{'answers':>8}")
    for kind in options.kinds:
        compare(kind, options.scenes, options.repeats)


if __name__ == "__main__":
    main()
