"""Search settings tuned by trials: each trial is a study of the same scenes with other settings.

The result of a search jumps with its settings, so there is no gradient to follow (`descent` has one, of
trajectories). A trial makes whole plans, as `run_study` does, not the search alone: a short path without a
certified trajectory is a failure. Success comes before the objective: trials with more failed scenes are
always worse. Times are computation times of the search step.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from jaxplan.model.scenario import Scenario
from jaxplan.runtime.display import shown
from jaxplan.runtime.progress import Bar, progress_bar
from jaxplan.study import Study, run_study
from jaxplan.study.result import Printed, counted
from jaxplan.study.run import LARGEST
from jaxplan.study.task import Task, make_task
from jaxplan.tuning.parameters import Range, make_ranges

Score = Callable[[Study], float]
Row = Mapping[str, float]

# For each objective its label, the study's column, and whether all scenes count, not only those planned.
_OBJECTIVES = {
    "time": ("search time (s)", "search_s", True),
    "expansions": ("expansions", "expansions", True),
    "length": ("path length (steps)", "length_steps", False),
}
_POPULATION_SIZE = 8  # of the first population: the scenes' own settings and seven more; scipy wants five
_DEFAULT_RANGES: Mapping[str, tuple[float, float]] = {
    "search.heuristic_weight": (1, 20),
    "search.anchor_weight": (1, 4),
    "search.attitude_step_rad": (0.05, 0.3),
}


class Ended(Exception):
    """Raised when all trials are spent, or when a trial fails with an error, which is then the cause."""


class Trial(NamedTuple):
    """One trial: its row in the history, and its study."""

    row: Row
    study: Study


class Trials:
    """Runs trials, and keeps their rows, the best trial, and the one with the scenes' own settings.

    Making one runs the first trial, with the scenes' own settings.

    Args:
        task: the study that is made in each trial.
        ranges: the settings to vary, with their bounds.
        score: computes the objective of a study.
        most: number of trials; a further one raises `Ended`.
        noisy: whether the objective depends on computation times, so that a first study is made and
            discarded.
        bar: counts trials, and shows the best objective.
    """

    def __init__(
        self, task: Task, ranges: tuple[Range, ...], score: Score, most: int, noisy: bool, bar: Bar
    ) -> None:
        self.task, self.ranges, self.score, self.most, self.bar = task, ranges, score, most, bar
        self.history: list[Row] = []
        self._known_ranks: dict[tuple[float, ...], float] = {}
        numbers = {one.name: one.own for one in ranges}
        if noisy:
            self._run_trial(0, numbers)  # a rehearsal, so that the first trial has no cold caches
        self.own = self.best = self._make_next_trial(numbers)

    def __call__(self, values: np.ndarray) -> float:
        """Make a trial with settings (k,), unless it was made before; return its rank, lower is better.

        Raises:
            Ended: if all trials are spent, or because of an error in this one.
        """
        numbers = {one.name: one.number(value) for one, value in zip(self.ranges, values, strict=True)}
        key = tuple(numbers.values())
        if key not in self._known_ranks:
            if len(self.history) == self.most:
                raise Ended
            try:
                trial = self._make_next_trial(numbers)
            except (TypeError, ValueError) as error:  # which scipy would take for a fault of its own
                raise Ended from error
            self.best = self._choose_better(self.best, trial)
            self.bar.note(f"best {self.best.row['objective']:.5g}")
        return self._known_ranks[key]

    def measure_again(self) -> str:
        """Repeat the trials of the best and of the scenes' own settings, and keep the better.

        Returns a message on that.
        """
        try:
            own, best = map(self._repeat_trial, (self.own, self.best))
        except KeyboardInterrupt:
            return "interrupted before the times were measured again"
        self.own, self.best = own, self._choose_better(own, best)
        if self.best is own:
            return f"trial {best.row['trial']} was not better when measured again"
        return "measured again"

    def _repeat_trial(self, trial: Trial) -> Trial:
        """Repeat a trial without entering it in the history."""
        numbers = {one.name: trial.row[one.name] for one in self.ranges}
        return self._run_trial(int(trial.row["trial"]), numbers)

    def _make_next_trial(self, numbers: Row) -> Trial:
        """Make the next trial with the given settings, and enter it in the history."""
        trial = self._run_trial(len(self.history), numbers)
        self.history.append(trial.row)
        self._known_ranks[tuple(numbers.values())] = self._rank(trial)
        self.bar.update()
        return trial

    def _run_trial(self, number: int, numbers: Row) -> Trial:
        """Make trial `number` with the given settings; number 0 has the scenes' own settings instead.

        Raises:
            KeyboardInterrupt: if the study is interrupted.
            ValueError: if its objective is NaN or -inf.
        """
        task = self.task
        # in one chunk where it may be, so that the times of trials compare
        study = run_study(
            task.scenes,
            task.kind,
            planner=task.planner,
            settings=numbers if number else {},
            chunk=LARGEST,
            progress=False,
        )
        if not study.complete:  # a study ends early where it is interrupted
            raise KeyboardInterrupt
        value = float(self.score(study))
        if math.isnan(value) or value == -math.inf:
            raise ValueError(f"objective is {value}: must be a finite number, or inf for the worst")
        rate = study.planned / study.done
        return Trial({"trial": number, "objective": value, "success_rate": rate, **numbers}, study)

    def _choose_better(self, one: Trial, other: Trial) -> Trial:
        """Return the trial with the lower rank; the first one if both are equally good."""
        return min(one, other, key=self._rank)

    def _rank(self, trial: Trial) -> float:
        """Return the rank of a trial: failed scenes, plus less than one that grows with the objective."""
        value, scale = trial.row["objective"], abs(self.history[0]["objective"])
        scale = scale if 0 < scale < math.inf else 1.0
        share = value / (abs(value) + scale) if value < math.inf else 1.0
        return len(self.task.scenes) * (1 - trial.row["success_rate"]) + share / 2


@shown("settings", "objective", "message", heading="{0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class SearchTuning(Printed):
    """Result of tuning by trials.

    Attributes:
        settings: those of the best trial, as `run_study` and a scenario file take them. If the scenes' own
            are the best, settings in which the scenes differ are left out.
        objective: name of the objective that was lowered, with its unit.
        own: the row of the scenes' own settings; it belongs to `baseline`.
        best: the row of the best settings; it belongs to `study`.
        history: a row for each trial: its number, the objective, the success rate and the numbers by name.
            The first has the scenes' own settings, with NaN for what is not a number that all share.
        study: the study with the best settings.
        baseline: the study with the scenes' own settings.
        message: how the result was found, and what was given up.
    """

    settings: Mapping[str, float]
    objective: str
    own: Mapping[str, float]
    best: Mapping[str, float]
    history: tuple[Mapping[str, float], ...]
    study: Study
    baseline: Study
    message: str

    @property
    def title(self) -> str:
        """Title with the scenes and the number of trials."""
        return f"Tuning of {replace(self.baseline, settings={}).title}, {counted(len(self.history), 'trial')}"

    @property
    def answer(self) -> int:
        """Number of the trial that had the best settings."""
        return int(self.best["trial"])

    @property
    def label(self) -> str:
        """Label of the objective for the axis of a figure, with its unit."""
        return self.objective

    def cells(self) -> list[list[str]]:
        """Return own and best settings and their results as rows of text, the first one the head."""
        labels = {"objective": self.objective, "success_rate": "success rate (%)"}
        rows = []
        for key in [key for key in self.own if key != "trial"]:
            values = [(100 if key == "success_rate" else 1) * row[key] for row in (self.own, self.best)]
            rows.append([labels.get(key, key), *("-" if math.isnan(v) else f"{v:.5g}" for v in values)])
        return [["", "own", "best"], *rows]

    def lines(self) -> list[tuple[str, str]]:
        """Return the best trial, and how it was found, as (label, value) rows."""
        return [("best", f"trial {self.answer}"), ("", self.message)]


def tune_search(
    scenarios_or_seeds: Iterable[Scenario] | Iterable[int],
    kind: str | None = None,
    *,
    planner: str = "mha",
    over: Mapping[str, tuple[float, float]] = _DEFAULT_RANGES,
    objective: str | Score = "time",
    trials: int = 30,
    seed: int = 0,
    progress: bool = True,
) -> SearchTuning:
    """Look for better search settings by trials, without a gradient.

    Success comes first: settings that leave more scenes without a certified plan are always worse, whatever
    their objective. Among settings with equally many failures, the lower objective is better. The scenes' own
    settings are the first trial, and the answer is never worse than they are.

    Expansions and lengths are the same on every run. Computation times are noisy: the least of many is lower
    than it would be if measured again. So the best and the scenes' own settings are measured once more, one
    after the other, and these measurements decide. The same is done if the objective is a function, since it
    may depend on times.

    Args:
        scenarios_or_seeds: the scenes, or seeds of `random_scenario`.
        kind: kind of random scenes; None for "keep_out". Only with seeds.
        planner: one of those of `run_study`; settings that it does not use have no effect.
        over: bounds (low, high) of the settings to vary, by dotted names in the keys and units of a scenario
            file. Whole numbers stay whole.
        objective: "time" for the mean computation time of the search, "expansions" for the mean number in the
            last search of each scene, both over all scenes; "length" for the mean length of the paths of
            planned scenes; or a function of a `Study` whose value is finite or +inf.
        trials: most trials, at least 2; the scenes' own settings are one of them.
        seed: seed of the trials' random choices.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Returns:
        The best settings, and all trials. Ctrl-C ends the search early, with the best until then.

    Raises:
        TypeError: if scenes are not scenarios or seeds, or the objective is neither a name nor a function.
        ValueError: for bad seeds, an unknown kind, planner or objective, too few trials, or an objective
            whose value is NaN or -inf.
        ScenarioError: for settings or bounds that a file could not hold; all are listed.

    Example:
        >>> found = jp.tune_search(range(20), "hard_keep_out", objective="expansions")
        >>> study = jp.run_study(range(20, 200), "hard_keep_out", settings=found.settings)
    """
    for name, value, least in (("trials", trials, 2), ("seed", seed, 0)):
        if type(value) is not int or value < least:
            raise ValueError(f"{name} = {value!r}: must be an integer of at least {least}")
    label, score = _make_score(objective)
    task = make_task(scenarios_or_seeds, kind, planner, None)
    ranges = make_ranges(task, over)
    with progress_bar("tuning", "trials", total=trials, shown=progress) as bar:
        noisy = objective not in ("expansions", "length")
        made = Trials(task, ranges, score, trials, noisy, bar)
        ending = _run_search(made, seed)
        if made.best.row["trial"] and noisy and not ending:
            ending = made.measure_again()
    best = made.best.row
    found = "found by trials, not by a gradient: others may be better"
    nothing = "nothing better than the scenes' own settings was found"
    return SearchTuning(
        settings={one.name: best[one.name] for one in ranges if not math.isnan(best[one.name])},
        objective=label,
        own=made.own.row,
        best=best,
        history=tuple(made.history),
        study=made.best.study,
        baseline=made.own.study,
        message="; ".join(filter(None, (found if best["trial"] else nothing, ending))),
    )


def _run_search(trial: Trials, seed: int) -> str:
    """Try settings until all trials are spent, by differential evolution.

    It only compares trials, so that noise, jumps, plateaus and failures do it little harm, it keeps whole
    numbers whole, and every trial after the first eight builds on the better ones. Methods that fit a model
    (COBYQA) or move a simplex are quicker where the objective is smooth, but lose most of that where it is
    noisy; neither knows whole numbers.

    Returns:
        A message if the search was interrupted; else an empty text.
    """
    from scipy.optimize import differential_evolution
    from scipy.stats.qmc import LatinHypercube

    generator = np.random.default_rng(seed)
    low, high, own = np.array([(one.low, one.high, one.own) for one in trial.ranges], dtype=float).T
    spread = low + (high - low) * LatinHypercube(len(low), rng=generator).random(_POPULATION_SIZE)
    spread[0] = np.where(np.isnan(own), spread[0], np.clip(own, low, high))
    try:
        differential_evolution(
            trial,
            list(zip(low, high, strict=True)),
            init=spread,
            integrality=[one.integer for one in trial.ranges],
            maxiter=trial.most,  # the trials are spent before, unless most were made before
            tol=0,  # ends where all settings are equally good
            polish=False,
            rng=generator,
        )
    except KeyboardInterrupt:
        return f"interrupted after {len(trial.history)} of {trial.most} trials"
    except Ended as ended:
        if ended.__cause__ is not None:
            raise ended.__cause__ from None
    return ""


def _make_score(objective: str | Score) -> tuple[str, Score]:
    """Return label and function of an objective, a name or a function; raises as `tune_search` does."""
    if isinstance(objective, str):
        if objective not in _OBJECTIVES:
            known = ", ".join(_OBJECTIVES)
            raise ValueError(f"objective = {objective!r}: must be one of {known}, or a function of a Study")
        label, column, every = _OBJECTIVES[objective]

        def mean(study: Study) -> float:
            values = study.values(column, every)
            return float(np.mean(values)) if len(values) else math.inf

        return label, mean
    if not callable(objective):
        raise TypeError(f"objective must be a name or a function of a Study, not {type(objective).__name__}")
    return getattr(objective, "__name__", "objective"), objective
