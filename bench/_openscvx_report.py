"""The tables of `openscvx_compare`."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from _flight import Verdict

_HEAD = (
    f"  {'planner':<22}{'OK':>8}{'refused':>9}{'T/bound':>9}{'worst':>8}{'solve s':>9}{'ours x':>8}"
    f"{'total s':>9}{'iterations':>12}{'least deg':>11}{'peak':>8}"
)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What a planner did in a scene.

    Attributes:
        ok: whether it says so itself.
        verdict: of the check; None where there is nothing to check.
        ratio: duration over the least that the slowest joint needs; NaN where there is no manoeuvre.
        seconds: time of the solver, median over repeats.
        total: s, of the whole plan; NaN for the rival, which is given goal and path.
        iterations: of the rival, NaN for jaxplan.
        ours: seconds of jaxplan's solver in the same scene.
        note: text that is printed if it fails.
    """

    ok: bool
    verdict: Verdict | None
    ratio: float
    seconds: float
    total: float
    iterations: float
    ours: float
    note: str = ""

    @property
    def refused(self) -> bool:
        """Whether the planner says OK but the check refuses the manoeuvre."""
        return self.ok and (self.verdict is None or bool(self.verdict.refusal))

    @property
    def good(self) -> bool:
        """Whether the planner says OK and the check agrees."""
        return self.ok and not self.refused


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene's name and what each planner did in it, by the planner's name."""

    name: str
    trials: dict[str, Trial]


def print_kind(kind: str, cases: Sequence[Case], left_out: int, *, each: bool) -> None:
    """Print the table of the planners on the scenes of one kind; with `each` also a line for every trial."""
    print(f"{kind}: {len(cases)} scenes, and {left_out} without a searched path")
    print(_HEAD)
    for name in dict.fromkeys(name for case in cases for name in case.trials):
        print(_line(name, [case.trials[name] for case in cases if name in case.trials]))
        if each:
            for case in cases:
                if name in case.trials:
                    print(_line(f"  {case.name}", [case.trials[name]]))
    for case in cases:
        for name, trial in case.trials.items():
            if trial.refused:
                reason = trial.verdict.refusal if trial.verdict else "nothing to check"
                print(f"  {case.name}, {name}: refused, {reason}")
            elif not trial.ok and trial.note:
                print(f"  {case.name}, {name}: {trial.note}")
    print()


def _line(name: str, trials: Sequence[Trial]) -> str:
    """A row of the table: a planner's trials."""
    good = [trial for trial in trials if trial.good]
    margins = [trial.verdict.margin for trial in trials if trial.ok and trial.verdict]
    peaks = [trial.verdict.peak for trial in trials if trial.ok and trial.verdict]
    counts = (
        f"  {name:<22}{f'{sum(t.ok for t in trials)}/{len(trials)}':>8}{sum(t.refused for t in trials):9}"
    )
    return counts + "".join(
        f"{'-':>{width}}" if np.isnan(value) else f"{value:{width}.{digits}f}"
        for value, width, digits in (
            (_middle(t.ratio for t in good), 9, 4),
            (max((t.ratio for t in good), default=np.nan), 8, 4),
            (_middle(t.seconds for t in trials), 9, 3),
            (_middle(t.seconds / t.ours for t in trials), 8, 1),
            (_middle(t.total for t in trials), 9, 3),
            (_middle(t.iterations for t in trials), 12, 0),
            (min(margins, default=np.nan), 11, 4),
            (max(peaks, default=np.nan), 8, 4),
        )
    )


def _middle(values: Iterable[float]) -> float:
    """Median of the values that are not NaN; NaN if there are none."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.median(known)) if known else np.nan
