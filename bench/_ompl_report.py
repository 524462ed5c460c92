"""The tables and targets of `ompl_compare`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from _measures import Measures

EASY, HARD, HELD = ("keep_out", "keep_in"), ("hard_keep_out", "hard_keep_in"), "held_links"
MHA, NUMPY = "mha", "numpy"  # our planner; and the end of the name of a rival with the checker in numpy

_HEAD = (
    f"  {'planner':<19}{'found':>9}{'clear':>9}{'mean ms':>9}{'median':>8}{'steps':>8}{'best':>7}"
    f"{'travel':>8}{'best':>7}{'below 0':>9}{'sampled':>8}{'edges':>8}{'least deg':>11}"
)


@dataclass(kw_only=True)
class Trial:
    """Results of a planner on a scene: seconds by seed and repeat, and a path, or None, for each seed."""

    seconds: list[list[float]]
    paths: list[Measures | None] = field(default_factory=list)
    expansions: int = 0

    @property
    def time(self) -> float:
        """Seconds, the median over the repeats averaged over the seeds."""
        return float(np.mean(np.median(self.seconds, axis=1)))

    @property
    def found(self) -> list[Measures]:
        return [path for path in self.paths if path is not None]

    def best(self, name: str) -> float:
        """Least `steps` or `travel` among the seeds; NaN without a path."""
        return min((getattr(path, name) for path in self.found), default=np.nan)

    def mean(self, name: str) -> float:
        """Mean `steps` or `travel` of the seeds; NaN without a path."""
        return float(np.mean([getattr(path, name) for path in self.found])) if self.found else np.nan


@dataclass(kw_only=True)
class Case:
    """A scene: steps and travel (rad) of the straight motion, and the trial of each planner by its name."""

    steps: float
    travel: float
    trials: Mapping[str, Trial]


def print_kind(kind: str, cases: Sequence[Case], infeasible: int) -> None:
    """Print the table of the planners on the scenes of one kind, of which some are left out as infeasible."""
    print(f"{kind}: {len(cases)} scenes, and {infeasible} proved to have no path")
    print(_HEAD)
    for name in dict.fromkeys(name for case in cases for name in case.trials):
        mine = [case for case in cases if name in case.trials]
        trials = [case.trials[name] for case in mine]
        paths = [path for trial in trials for path in trial.found]
        tried = sum(len(trial.paths) for trial in trials)
        clear = sum(not (path.below or path.below_sampled) for path in paths)
        times = 1e3 * np.array([trial.time for trial in trials])
        lengths = ""
        for unit in ("steps", "travel"):
            straight = np.array([getattr(case, unit) for case in mine])
            lengths += f"{_mean([trial.mean(unit) for trial in trials] / straight):8.3f}"
            lengths += f"{_mean([trial.best(unit) for trial in trials] / straight):7.3f}"
        print(
            f"  {name:<19}{f'{len(paths)}/{tried}':>9}{clear:>9}"
            f"{np.mean(times):9.2f}{np.median(times):8.2f}{lengths}"
            f"{sum(p.below for p in paths):9}{sum(p.below_sampled for p in paths):8}"
            f"{sum(p.edges for p in paths):8}"
            f"{np.rad2deg(min((p.margin for p in paths), default=np.nan)):11.4f}"
        )
    print()


def print_targets(results: Mapping[str, Sequence[Case]]) -> None:
    """Print each target: what is measured, its value, and the most that it may be."""
    print(f"{'target':<66}{'figure':>9}{'bar':>11}")
    for text, figure, bar in _targets(results):
        verdict = "met" if figure <= bar else "MISSED"
        print(f"{text:<66}{figure:9.3f}{f'<= {bar:g}':>11}  {verdict}")


def _targets(results: Mapping[str, Sequence[Case]]) -> Iterator[tuple[str, float, float]]:
    """Yield for each target a text, the value, and the most that it may be."""
    for kind, cases in results.items():
        ours = [case.trials[MHA] for case in cases]
        rivals = dict.fromkeys(name for case in cases for name in case.trials if name != MHA)
        missed = sum(not trial.found for trial in ours)
        yield f"{kind}: scenes without a path from {MHA}", missed, 0
        below = sum(path.below + path.below_sampled for trial in ours for path in trial.found)
        yield f"{kind}: edges of {MHA} below zero, by bound or samples", below, 0
        if kind not in EASY:
            expansions = float(np.mean([trial.expansions for trial in ours]))
            yield f"{kind}: mean expansions of {MHA}", expansions, 12
        if kind in HARD:
            yield f"{kind}: mean time of {MHA}, ms", 1e3 * float(np.mean([t.time for t in ours])), 5
        for name in rivals:
            both = [(case.trials[MHA], case.trials[name]) for case in cases if name in case.trials]
            ratio = float(np.mean([a.time for a, _ in both]) / np.mean([b.time for _, b in both]))
            if name.endswith(NUMPY):
                yield f"{kind}: time of {MHA} over {name}", ratio, 0.05
                continue
            if kind == HELD:
                yield f"{kind}: time of {MHA} over {name}", ratio, 1
            for unit in ("steps", "travel"):
                ratios = [a.best(unit) / b.best(unit) for a, b in both]
                yield f"{kind}: {unit} of {MHA} over the best seed of {name}", _mean(ratios), 1.02
        if kind in EASY:
            straight = [case.trials[MHA].best("steps") / case.steps for case in cases]
            yield f"{kind}: steps of {MHA} over the straight motion's", _mean(straight), 1.03


def _mean(values: Sequence[float] | np.ndarray) -> float:
    """Mean of the values that are not NaN, as without a path; NaN if there are none."""
    known = np.array([value for value in values if not np.isnan(value)])
    return float(np.mean(known)) if known.size else np.nan
