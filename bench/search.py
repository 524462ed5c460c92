"""Speed and success of step 2 on the paper's cases, warm.

Prints the time of one expansion of 384 children, all told and the kernel alone, beside that of an empty
jitted call with the same arguments (which tells how fast the machine is), and the searches of the four cases.

    python bench/search.py [--repeats 300]
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import jax
import numpy as np
from _machine import print_machine
from _options import positive

from jaxplan.cases import paper_case
from jaxplan.planner.steps import find_goals
from jaxplan.search import PLANNERS, make_scene, mha
from jaxplan.search.astar import Rules, Search, make_root
from jaxplan.search.expansion import EDGE_INTERVALS, ONWARD_INTERVALS, expansion_call
from jaxplan.search.fields import distance_fields
from jaxplan.search.kernel_calls import Scenes


def median_us(call: Callable[[], object], repeats: int) -> float:
    """Median time of a call, us, after a first one that compiles."""
    call()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(seconds))


def expansion_times(repeats: int) -> None:
    """Print the times of an empty call, of the expansion's kernel and of a whole expansion, for case 2."""
    scenario = paper_case(2)
    scene = make_scene(scenario, find_goals(scenario)[0])
    with jax.enable_x64(True):
        node, rng = make_root(scene), np.random.default_rng(0)
        moves = mha.propose(scene, node, rng, scenario.search, 0)
        clearance = np.zeros(EDGE_INTERVALS + ONWARD_INTERVALS)
        fields = distance_fields(scene).table
        arguments = (node.packed, moves.turns, moves.options, moves.choice, clearance, fields)
        empty = jax.jit(lambda scene, packed, *rest: packed[:3] + rest[0].sum())
        print(f"children an expansion          {len(moves.turns) * len(moves.choice):10d}")
        nothing = median_us(lambda: np.asarray(empty(scene.packed[1], *arguments)), repeats)
        print(f"an empty jitted call           {nothing:10.0f} us")
        call = expansion_call(node.packed, moves, clearance, fields, edges=True)
        kernel = median_us(lambda: Scenes([scene]).answers([call]), repeats)
        print(f"the expansion kernel           {kernel:10.0f} us")
        whole = []
        rules = mha.rules(scene)
        without_shortcut = replace(rules, direct=False)
        for seed in range(max(repeats // 20, 5)):
            whole += _times_of_expansions(scene, replace(scenario.search, seed=seed), without_shortcut)
        print(f"an expansion all told          {1e6 * np.median(whole):10.0f} us")


def _times_of_expansions(scene: object, settings: object, rules: Rules) -> list[float]:
    """Seconds of each of up to 20 expansions: queues, moves, kernel, costs and the new children."""
    search, scenes = Search(scene, settings, rules), Scenes([scene])
    seconds: list[float] = []
    call = search.next_request()
    while call is not None and len(seconds) < 20:
        begin = time.perf_counter()
        search.accept(scenes.answers([call])[0])
        call = search.next_request()
        seconds.append(time.perf_counter() - begin)
    return seconds


def case_searches(repeats: int) -> None:
    """Search the paper's cases by every planner with several seeds, and print lengths and times."""
    print("\ncase  planner      steps (needed)  expansions  median ms over seeds")
    for number in (1, 2, 3, 4):
        scenario = paper_case(number)
        goal = find_goals(scenario)[0]
        scene = make_scene(scenario, goal)
        needed = scene.straight_steps
        for method, search in PLANNERS.items():
            search(scene, scenario.search)
            seconds, lengths, expansions = [], [], []
            for seed in range(max(repeats // 15, 5)):
                begin = time.perf_counter()
                result = search(scene, replace(scenario.search, seed=seed))
                seconds.append(time.perf_counter() - begin)
                lengths.append(result.path.length if result.path else np.nan)
                expansions.append(result.expansions)
            print(
                f"{number:4d}  {method:11s}  {np.median(lengths):6.2f} ({needed:5.2f})"
                f"  {np.median(expansions):10.0f}  {1e3 * np.median(seconds):8.1f}"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=positive, default=300)
    options = parser.parse_args()
    print_machine()
    expansion_times(options.repeats)
    case_searches(options.repeats)
