"""How often the default search finds a path: a thousand random scenes of each kind.

`mha` searches each scene with its defaults, at most 2,000 expansions, for the nearest goal of step 1. Scenes
in which zones part a device from its goal (`find_barrier`) are proved to have no path and counted apart. A
path is clear when no whole edge of it breaks a zone by the exact bound. What `mha` misses, our RRT-Connect
tries for ten seconds, to tell whether there is a path after all; with --all it tries every scene.

Prints a line a kind: the least margin of all paths; expansions as mean, median, 99 % and most; lengths over
the straight motion's as mean and median. The seeds of what was missed, not clear or proved to have no path
follow. --first-seed splits a long study.

    python bench/success.py [-n 1000] [--first-seed 0] [--kinds keep_out held_links] [--all]
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from _machine import print_machine
from _measures import straight_lengths
from _options import not_negative, positive
from tqdm import tqdm

import jaxplan as jp
from jaxplan.cases import RANDOM_KINDS, SKY_KINDS
from jaxplan.model.scenario import SearchSettings
from jaxplan.search import PLANNERS, Scene, find_barrier
from jaxplan.study.printed_planners import TOLERANCE, least_margins, make_problem

RIVAL_SECONDS = 10.0
_HEAD = (
    f"{'kind':<15}{'scenes':>7}{'no path':>8}{'found':>7}{'clear':>7}{'least deg':>11}"
    f"{'expansions':>13}{'median':>8}{'99 %':>6}{'most':>6}{'length':>9}{'median':>8}{'RRT-Connect':>15}"
)


@dataclass(kw_only=True)
class Tally:
    """What happened in the scenes of one kind.

    Attributes:
        scenes: number of them.
        barred: seeds of those proved to have no path.
        missed: seeds in which `mha` finds none though none is proved impossible.
        unclear: seeds in which its path has an edge below zero.
        margins: least of each path found, rad.
        expansions: of each search of a scene that is not barred, successful or not.
        lengths: of each path found over the straight motion's.
        tried: scenes that RRT-Connect searched, and
        reached: in how many it found a path, and
        only_rival: seeds in which it alone did.
    """

    scenes: int = 0
    barred: list[int] = field(default_factory=list)
    missed: list[int] = field(default_factory=list)
    unclear: list[int] = field(default_factory=list)
    margins: list[float] = field(default_factory=list)
    expansions: list[int] = field(default_factory=list)
    lengths: list[float] = field(default_factory=list)
    tried: int = 0
    reached: int = 0
    only_rival: list[int] = field(default_factory=list)


def study(kind: str, seeds: Sequence[int], everywhere: bool) -> Tally:
    """Search the scenes of one kind; `everywhere` lets RRT-Connect search all, not only those missed."""
    tally = Tally(scenes=len(seeds))
    for number in tqdm(seeds, desc=kind, unit="scene"):
        scenario = jp.random_scenario(number, kind)
        scene = make_problem(scenario)
        if find_barrier(scene) is not None:
            tally.barred.append(number)
            continue
        result = PLANNERS["mha"](scene, scenario.search)
        tally.expansions.append(result.expansions)
        if result.path is None:
            tally.missed.append(number)
            tqdm.write(f"{kind} {number}: {result.status.name}")
        else:
            margin = float(np.min(least_margins(scene, result.path)))
            tally.margins.append(margin)
            tally.lengths.append(result.path.length / straight_lengths(scene)[0])
            if not margin >= -TOLERANCE:
                tally.unclear.append(number)
        if everywhere or result.path is None:
            tally.tried += 1
            reached = rival_finds(scene, scenario.search)
            tally.reached += reached
            if reached and result.path is None:
                tally.only_rival.append(number)
    return tally


def rival_finds(scene: Scene, settings: SearchSettings) -> bool:
    """Whether our RRT-Connect finds a path in ten seconds."""
    patient = replace(settings, time_limit=RIVAL_SECONDS, max_expansions=10**9)
    return PLANNERS["rrt_connect"](scene, patient).path is not None


def line(kind: str, tally: Tally) -> str:
    """The kind's line of the table."""
    found, of = len(tally.margins), tally.scenes - len(tally.barred)
    expansions, lengths = np.array(tally.expansions or [np.nan]), np.array(tally.lengths or [np.nan])
    return (
        f"{kind:<15}{tally.scenes:7}{len(tally.barred):8}{found:7}{found - len(tally.unclear):7}"
        f"{np.rad2deg(min(tally.margins, default=np.nan)):11.5f}{np.mean(expansions):13.2f}"
        f"{np.median(expansions):8.0f}{np.quantile(expansions, 0.99):6.0f}{np.max(expansions):6.0f}"
        f"{np.mean(lengths):9.4f}{np.median(lengths):8.4f}"
        f"{f'{tally.reached}/{tally.tried}' if tally.tried else 'no need':>15}"
        f"  {'all found, all clear' if found == of and not tally.unclear else 'SEE BELOW'}"
    )


def print_seeds(kind: str, tally: Tally) -> None:
    """Print the seeds of scenes without a path, missed, or not clear."""
    for what, seeds in (
        ("proved to have no path", tally.barred),
        ("missed by mha", tally.missed),
        ("found by RRT-Connect alone", tally.only_rival),
        ("found, but not clear", tally.unclear),
    ):
        if seeds:
            print(f"{kind}, {what}: seeds {', '.join(map(str, seeds))}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--scenes", type=positive, default=1000, help="of each kind (%(default)s)")
    parser.add_argument("--first-seed", type=not_negative, default=0, help="of the scenes (%(default)s)")
    parser.add_argument("--kinds", nargs="+", choices=RANDOM_KINDS, default=SKY_KINDS, metavar="KIND")
    parser.add_argument(
        "--all", action="store_true", help="RRT-Connect tries every scene, not only the missed"
    )
    options = parser.parse_args()
    print_machine()
    seeds = range(options.first_seed, options.first_seed + options.scenes)
    tallies = {kind: study(kind, seeds, options.all) for kind in dict.fromkeys(options.kinds)}
    print(f"seeds {seeds[0]} to {seeds[-1]}\n{_HEAD}")
    for kind, tally in tallies.items():
        print(line(kind, tally))
    print()
    for kind, tally in tallies.items():
        print_seeds(kind, tally)


if __name__ == "__main__":
    main()
