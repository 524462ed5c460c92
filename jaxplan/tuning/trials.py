"""Search settings tuned by trials: each is a study of the same scenes, by other settings.

The trials of a search for settings: a study each, and a row of what came of it.

Success comes before the objective: rows with more failed scenes are always worse.

What a search does jumps with its settings, so there is no gradient to follow (`descent` has one, of
trajectories). A trial plans whole, as `run_study` does, not the search alone: a short path that no certified
trajectory follows is a failure. Times are those of the search step.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from jaxplan.cases import random_scenario
from jaxplan.model.scenario import Scenario
from jaxplan.runtime.display import as_table, shown
from jaxplan.runtime.progress import Bar, progress_bar
from jaxplan.study import Study, run_study
from jaxplan.study.blocks import LARGEST
from jaxplan.study.result import aligned, column_values
from jaxplan.study.rows import OK
from jaxplan.study.task import Task, make_task
from jaxplan.tuning.parameters import Range, make_ranges

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


# Label, column, and whether every scene counts or only those that are planned, as in a study's summary.
_OBJECTIVES = {
    "time": ("search time (s)", "search_s", True),
    "expansions": ("expansions", "expansions", True),
    "length": ("path length (steps)", "length_steps", False),
}
_POPULATION = 8  # the scenes' own settings and seven more; scipy wants at least five
_OVER: Mapping[str, tuple[float, float]] = {
    "search.heuristic_weight": (1, 20),
    "search.anchor_weight": (1, 4),
    "search.attitude_step_rad": (0.05, 0.3),
}


@shown("settings", "objective", "message", heading="{0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class SearchTuning:
    """What trials found.

    Attributes:
        settings: of the best trial, as `run_study` and a scenario file take them. Where the scenes' own are
            the best these are they; one in which the scenes differ is left out then.
        objective: what was lowered, with its unit.
        own: the row of the scenes' own settings, as ``baseline`` has it.
        best: likewise of the best settings, as ``study`` has it.
        history: a row a trial: its number, the objective, the success rate and the numbers by name. The first
            are the scenes' own settings, with NaN for what is no number that all share.
        study: by the best settings.
        baseline: by the scenes' own.
        message: how it was found, and what was given up.
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
        """Of which scenes, and how many trials there were."""
        return f"Tuning of {replace(self.baseline, settings={}).title}, {len(self.history)} trials"

    @property
    def answer(self) -> int:
        """The trial that had the best settings."""
        return int(self.best["trial"])

    @property
    def label(self) -> str:
        """What was lowered, with its unit: as `Tuning` has it beside the objective's value."""
        return self.objective

    def cells(self) -> list[list[str]]:
        """What the scenes' own and the best settings are and do, as rows of texts with their head."""
        labels = {"objective": self.objective, "success_rate": "success rate (%)"}
        factors = {"success_rate": 100.0}
        rows = []
        for key in self.own:
            if key != "trial":
                values = [factors.get(key, 1.0) * row[key] for row in (self.own, self.best)]
                rows.append([labels.get(key, key), *("-" if math.isnan(v) else f"{v:.5g}" for v in values)])
        return [["", "own", "best"], *rows]

    def __str__(self) -> str:
        head = [self.title, f"  best: trial {self.best['trial']}", f"  {self.message}"]
        return aligned("\n".join(head), [], self.cells())

    def _repr_html_(self) -> str:
        return as_table(
            self.title, [("best", f"trial {self.best['trial']}"), ("", self.message)], self.cells()
        )


def tune_search(
    scenarios_or_seeds: Iterable[Scenario] | Iterable[int],
    kind: str | None = None,
    *,
    planner: str = "mha",
    over: Mapping[str, tuple[float, float]] = _OVER,
    objective: str | Score = "time",
    trials: int = 30,
    seed: int = 0,
    progress: bool = True,
) -> SearchTuning:
    """Look for better search settings by trials, without a gradient.

    Success comes first: settings that leave more scenes without a certified plan are always worse, whatever
    their objective. Among settings with as many failures, the lower objective is better. The scenes' own
    settings are the first trial, and the answer is never worse than they are.

    Expansions and lengths are the same on every run. Times are noisy: the least of many is lower than it
    would be again, so the best and the scenes' own settings are measured once more, one after the other, and
    these measurements decide. A function is treated likewise, as it may look at times.

    Args:
        scenarios_or_seeds: the scenes, or seeds of `random_scenario`.
        kind: of the random scenes, "keep_out" unless told; only with seeds.
        planner: one of those of `run_study`; settings that it does not have change nothing.
        over: bounds of the settings to vary, by dotted names in the keys and units of a scenario file.
            Whole numbers stay whole.
        objective: "time" for the mean of the search step, "expansions" for that of the last search, both of
            all scenes, "length" for the mean length of the paths of planned scenes, or a function of a
            `Study`, whose value is finite or +inf.
        trials: at most, the scenes' own settings among them.
        seed: of the trials' random choices.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Returns:
        The best settings, and all trials. Ctrl-C ends the search early, with the best until then.

    Raises:
        TypeError: for scenes that are none, or an objective that is neither a name nor a function.
        ValueError: for bad seeds, an unknown kind, planner or objective, too few trials, or an objective
            that is no number.
        ScenarioError: for settings or bounds that a file could not hold; all are named.

    Example:
        >>> found = jp.tune_search(range(20), "hard_keep_out", planner="mha-paper", objective="expansions")
        >>> study = jp.run_study(range(20, 200), "hard_keep_out", "mha-paper", found.settings)
    """
    for name, value, least in (("trials", trials, 2), ("seed", seed, 0)):
        if type(value) is not int or value < least:
            raise ValueError(f"{name} = {value!r}: must be an integer of at least {least}")
    label, score = _make_score(objective)
    task = make_task(scenarios_or_seeds, kind, planner, None)
    scenarios = tuple(
        # all of a kind have the same settings
        scene if isinstance(scene, Scenario) else random_scenario(scene, str(task.kind))
        for scene in (task.scenes if task.kind is None else task.scenes[:1])
    )
    ranges = make_ranges(task, scenarios, over)
    with progress_bar("tuning", "trials", total=trials, shown=progress) as bar:
        noisy = objective not in ("expansions", "length")
        trial = Trials(task, ranges, score, trials, noisy, bar)
        ending = _search(trial, seed)
        changed = trial.best["trial"] > 0
        if changed and noisy and not ending:
            ending = trial.measure_again()
    messages = ["found by trials, not by a gradient: others may be better"] * (trial.best["trial"] > 0)
    messages += ["nothing better than the scenes' own settings was found"] * (trial.best["trial"] == 0)
    return SearchTuning(
        settings={one.name: trial.best[one.name] for one in ranges if not math.isnan(trial.best[one.name])},
        objective=label,
        own=trial.own,
        best=trial.best,
        history=tuple(trial.history),
        study=trial.study,
        baseline=trial.baseline,
        message="; ".join([*messages, *([ending] if ending else [])]),
    )


def _search(trial: Trials, seed: int) -> str:
    """Try settings until all trials are spent; says how it ended, if not so.

    Differential evolution, of scipy's methods: it only compares trials, so that noise, jumps, plateaus and
    failures do it little harm, it keeps whole numbers whole, and every trial after the first eight builds on
    the better ones. Methods that fit a model (COBYQA) or move a simplex are quicker where the objective is
    smooth, but lose most of that where it is noisy; neither knows whole numbers.
    """
    from scipy.optimize import differential_evolution
    from scipy.stats.qmc import LatinHypercube

    generator = np.random.default_rng(seed)
    low, high, own = np.array([(one.low, one.high, one.own) for one in trial.ranges], dtype=float).T
    spread = low + (high - low) * LatinHypercube(len(low), rng=generator).random(_POPULATION)
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
    """The objective's label, and the function."""
    if isinstance(objective, str):
        if objective not in _OBJECTIVES:
            known = ", ".join(_OBJECTIVES)
            raise ValueError(f"objective = {objective!r}: must be one of {known}, or a function of a Study")
        label, column, every = _OBJECTIVES[objective]

        def mean(study: Study) -> float:
            values = column_values(study, column, every)
            return float(np.mean(values)) if len(values) else math.inf

        return label, mean
    if not callable(objective):
        raise TypeError(f"objective must be a name or a function of a Study, not {type(objective).__name__}")
    return getattr(objective, "__name__", "objective"), objective
