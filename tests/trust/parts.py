"""The parts of the table, each with the count that it takes for the whole."""

import random
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

import jaxplan as jp
from trust import (
    any_spacecraft,
    arrays,
    bad_input,
    dips,
    flights,
    golden,
    graphs,
    lanes,
    long_run,
    programs,
    symmetry,
    verdicts,
)
from trust.tally import Tally, tally

Run = Callable[[Sequence[int]], Iterable[Tally]]


@dataclass(frozen=True, kw_only=True)
class Part:
    """What is counted from a sequence of seeds, and how many of them make the whole."""

    count: int
    run: Run


def one(what: str, attempt: Callable[[int], object], count: int) -> Part:
    """A part with one row."""
    return Part(count=count, run=lambda seeds: [tally(what, seeds, attempt)])


def _bad_input(seeds: Sequence[int]) -> list[Tally]:
    names = list(bad_input.cases())
    return [tally("bad input: refused, nothing written", names[: max(len(seeds), 1)], bad_input.attempt)]


def _verdicts(seeds: Sequence[int]) -> list[Tally]:
    words: dict[str, int] = {}

    def attempt(seed: int) -> str:
        word = verdicts.attempt(seed)
        words[word] = words.get(word, 0) + 1
        return word

    first = tally("certificate: never yes where samples say no", seeds, attempt)
    yes, no = (words.get(f"clear, {word}", 0) for word in ("yes", "no"))
    share = yes / max(yes + no, 1)
    refused = [] if share >= verdicts.SHARE else ["too many"]
    note = f"{share:.3%}, at least {verdicts.SHARE:.0%} wanted"
    second = Tally(what="and yes from 0.05 deg on", count=yes + no, failures=refused, note=note)
    return [first, second]


def _programs(seeds: Sequence[int]) -> list[Tally]:
    return [
        tally("programs in a box against OSQP", seeds, programs.box),
        tally("programs with limits against NNLS", seeds, programs.limited),
        tally("programs in three unknowns against NNLS", seeds[: max(len(seeds) // 10, 1)], programs.three),
    ]


def _graphs(seeds: Sequence[int]) -> list[Tally]:
    return [
        tally("search within w1 w2 of the cheapest way", seeds, graphs.attempt),
        tally("smaller cones stay solvable", seeds[: max(len(seeds) // 5, 1)], graphs.shrinking),
    ]


def _golden(seeds: Sequence[int]) -> list[Tally]:
    """The golden set in a batch, its verdicts, and the same files in every company."""
    names = golden.NAMES[: max(len(seeds), 2)]
    plans = jp.plan_batch([golden.scenario_of(name) for name in names], progress=False)
    by_name = dict(zip(names, plans, strict=True))
    found = [tally("golden set: verdicts and lengths", names, lambda n: golden.verdict(n, by_name[n]))]
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder)
        files = {name: golden.file_of(plan, there) for name, plan in by_name.items()}
        backwards = golden.files(reversed(names), there)
        mixed = random.Random(0).sample(names, len(names))
        company = {
            k: v for n in range(0, len(mixed), 7) for k, v in golden.files(mixed[n : n + 7], there).items()
        }
        workers = golden.files(names, there, workers=2)

        def same(name: str) -> None:
            alone = golden.file_of(jp.plan(golden.scenario_of(name), throw=False, progress=False), there)
            for way in (alone, backwards[name], company[name], workers[name]):
                assert way == files[name], "another file"

        found.append(tally("golden set: the same bytes in 5 ways", names, same))
    motions = [name for name, plan in by_name.items() if plan.ok]
    found.append(tally("motion against integration", motions, lambda name: _flight(name, by_name[name])))
    return found


def _flight(name: str, plan: jp.Plan) -> None:
    found = flights.errors(plan.trajectory, flights.random_inertia(len(name)))
    assert all(error <= flights.TOLERANCE for error in found.values()), found


def _lanes(seeds: Sequence[int]) -> list[Tally]:
    first = tally("NaN in one lane of 1,000", seeds, lanes.attempt)
    some = seeds[: max(len(seeds) // 20, 1)]
    return [first, tally("NaN in one of 8 searches", some, lambda seed: lanes.searches(8, seed))]


def _batch(seeds: Sequence[int]) -> list[Tally]:
    """A thousand scenes planned together, with and without a NaN in one of them."""
    from dataclasses import replace as changed

    count = max(len(seeds), 2)
    scenes = [jp.random_scenario(seed, "keep_in") for seed in range(count)]
    good = jp.plan_batch(scenes, progress=False)
    lost = count // 3
    joints = np.full(6, np.nan)
    scenes[lost] = changed(scenes[lost], start=changed(scenes[lost].start, joints=joints))
    found = jp.plan_batch(scenes, progress=False)
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder)

        def same(number: int) -> str:
            if number == lost:
                assert found[number].status is jp.Status.INVALID_START
                return "refused"
            assert golden.file_of(good[number], there) == golden.file_of(found[number], there)
            return "the same"

        return [tally("scenes beside one with a NaN", range(count), same)]


def _study(seeds: Sequence[int]) -> list[Tally]:
    """A study killed again and again, and shared out in every way."""
    import trust_study

    options = trust_study.options(["-n", str(max(len(seeds), 20)), "--kills", str(max(len(seeds) // 25, 2))])
    with tempfile.TemporaryDirectory() as folder:
        ways = trust_study.Trial(options, Path(folder)).run(sys.stderr)
    wrong = [name for name, same in ways.items() if same is False]
    note = f"of {options.scenes} scenes, {options.kills} kills"
    return [Tally(what="study: the same table in every way", count=len(ways), failures=wrong, note=note)]


PARTS = {
    "bad": Part(count=200, run=_bad_input),
    "verdicts": Part(count=100_000, run=_verdicts),
    "dips": one("dips of a microsecond, and their twins", dips.attempt, 2000),
    "symmetry": one("frame, mirror, names, order, pace", symmetry.attempt, 2000),
    "programs": Part(count=2000, run=_programs),
    "graphs": Part(count=1000, run=_graphs),
    "lanes": Part(count=200, run=_lanes),
    "golden": Part(count=len(golden.NAMES), run=_golden),
    "batch": Part(count=1000, run=_batch),
    "study": Part(count=500, run=_study),
    "arrays": one("wheels within limits at every sample", arrays.attempt, 100),
    "any_spacecraft": one("random spacecraft: certified, or say why", any_spacecraft.attempt, 1000),
    "mixed": Part(count=10_000, run=lambda seeds: long_run.run(seeds)),
}

jax.config.update("jax_enable_x64", True)
