"""The trials of a search for settings: a study each, and a row of what came of it.

Success comes before the objective: rows with more failed scenes are always worse.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np

from jaxplan.progress import Bar
from jaxplan.study import Study, run_study
from jaxplan.study.blocks import LARGEST
from jaxplan.study.rows import OK
from jaxplan.study.task import Task
from jaxplan.tuning.ranges import Range

Score = Callable[[Study], float]


class Ended(Exception):
    """No more trials: they are spent, or one raised the cause of this."""


class Trials:
    """Makes studies and keeps their rows, and the best and the first of the studies."""

    def __init__(
        self, task: Task, ranges: tuple[Range, ...], score: Score, most: int, noisy: bool, bar: Bar
    ) -> None:
        self.task, self.ranges, self.score, self.most, self.bar = task, ranges, score, most, bar
        self.history: list[dict[str, float]] = []
        self._known: dict[tuple[float, ...], float] = {}
        if noisy:
            self._study({})  # a rehearsal, so that the first trial is not the one with cold caches
        numbers = {one.name: one.own for one in ranges}
        self.baseline = self.study = self._study({})
        self.own = self.best = self._note(self.baseline, numbers)
        self._known[tuple(numbers.values())] = self._rank(self.own)

    def __call__(self, values: np.ndarray) -> float:
        """The rank of settings, lower is better; those that were tried before cost nothing."""
        numbers = {one.name: one.number(value) for one, value in zip(self.ranges, values, strict=True)}
        key = tuple(numbers.values())
        if key in self._known:
            return self._known[key]
        if len(self.history) == self.most:
            raise Ended
        try:
            study = self._study(numbers)
            row = self._note(study, numbers)
        except (TypeError, ValueError) as error:  # which scipy would take for a fault of its own
            raise Ended from error
        if _key(row) < _key(self.best):
            self.best, self.study = row, study
        self._known[key] = self._rank(row)
        return self._known[key]

    def measure_again(self) -> str:
        """Let fresh measurements decide between the best and the scenes' own settings; says how."""
        settings = {one.name: self.best[one.name] for one in self.ranges}
        try:
            first, last = self._study({}), self._study(settings)
        except KeyboardInterrupt:
            return "interrupted before the times were measured again"
        self.baseline, self.own = first, {**self.own, **self._measured(first)}
        row = {**self.best, **self._measured(last)}
        better = _key(row) < _key(self.own)
        self.study, self.best = (last, row) if better else (self.baseline, self.own)
        return "measured again" if better else f"trial {row['trial']} was not better when measured again"

    def _study(self, settings: Mapping[str, float]) -> Study:
        # in one chunk where it may be, so that the times of trials compare
        study = run_study(
            self.task.scenes, self.task.kind, self.task.planner, settings, chunk=LARGEST, progress=False
        )
        if not study.complete:  # a study ends early where it is interrupted
            raise KeyboardInterrupt
        return study

    def _measured(self, study: Study) -> dict[str, float]:
        value = float(self.score(study))
        if math.isnan(value) or value == -math.inf:
            raise ValueError(f"objective is {value}: must be a finite number, or inf for the worst")
        planned = sum(row["status"] == OK for row in study.table)
        return {"objective": value, "success_rate": planned / len(study.table)}

    def _note(self, study: Study, numbers: Mapping[str, float]) -> dict[str, float]:
        row = {"trial": len(self.history), **self._measured(study), **numbers}
        self.history.append(row)
        self.bar.update()
        best = min(self.history, key=_key)
        self.bar.note(f"best {best['objective']:.5g}")
        return row

    def _rank(self, row: Mapping[str, float]) -> float:
        """The order of `_key` as one number: failed scenes, and less than one for the objective."""
        value = row["objective"]
        scale = abs(self.history[0]["objective"])
        scale = scale if 0 < scale < math.inf else 1.0
        share = value / (abs(value) + scale) if value < math.inf else 1.0
        return len(self.task.scenes) * (1 - row["success_rate"]) + share / 2


def _key(row: Mapping[str, float]) -> tuple[float, float]:
    """Success first."""
    return -row["success_rate"], row["objective"]
