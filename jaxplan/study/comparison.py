"""Two studies of the same scenes, scene by scene.

Whether one planner finds more is asked of the scenes where they differ alone: if neither is better, each of
these is as likely to be the one's as the other's (McNemar's test, exact). What plans are like is compared on
the scenes that both plan.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.runtime.arguments import expect
from jaxplan.runtime.display import shown
from jaxplan.study.result import Printed, Study, counted
from jaxplan.study.rows import OK, Row

_QUANTITIES = {
    "path length (steps)": "length_steps",
    "duration (s)": "duration_s",
    "smallest margin (deg)": "min_margin_deg",
    "time (s)": "total_s",
}
_COLUMNS = ("scenes", "first", "second", "difference", "5 %", "median", "95 %", "second less")


@shown(
    "names",
    "both",
    "only_first",
    "only_second",
    "neither",
    "p_value",
    heading="Comparison of {0.scenes} scenes",
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison(Printed):
    """Two studies, scene by scene.

    Attributes:
        names: titles of the first study and the second.
        scenes: number of those that are in both.
        both: number of those that both plan, with a certificate.
        only_first: number of those that the first alone plans.
        only_second: number of those that the second alone plans.
        p_value: of the exact test of McNemar, two-sided: how likely it is that success differs at least as
            much in so many scenes if neither is better.
        differences: of each quantity, on the scenes that both plan, by label: their number, both means, mean,
            quantiles of second less first, and the share of scenes in which the second has less.
    """

    names: tuple[str, str]
    scenes: int
    both: int
    only_first: int
    only_second: int
    p_value: float
    differences: Mapping[str, Mapping[str, float]]

    @property
    def title(self) -> str:
        """Title with the number of scenes."""
        return f"Two studies of the same {counted(self.scenes, 'scene')}"

    @property
    def neither(self) -> int:
        """Number of scenes that neither of them plans."""
        return self.scenes - self.both - self.only_first - self.only_second

    def record(self) -> dict[str, Any]:
        """The comparison as a dict for JSON."""
        counts = ("scenes", "both", "only_first", "only_second", "neither", "p_value")
        return {
            **dict(zip(("first", "second"), self.names, strict=True)),
            **{name: getattr(self, name) for name in counts},
            "differences": {label: dict(values) for label, values in self.differences.items()},
        }

    def lines(self) -> list[tuple[str, str]]:
        """Lines above the differences, as (label, value)."""
        return [
            ("first", self.names[0]),
            ("second", self.names[1]),
            (
                "planned",
                f"{self.both} by both, {self.only_first} by the first alone, "
                f"{self.only_second} by the second alone, {self.neither} by none",
            ),
            ("success differs", f"p = {self.p_value:.3g} (McNemar, exact)"),
        ]

    def cells(self) -> list[list[str]]:
        """The differences as rows of texts, with their head."""
        rows = [
            [label, f"{values['scenes']:.0f}"]
            + [f"{values[name]:.4g}" for name in _COLUMNS[1:3]]
            + [f"{round(values[name], 9):+.4g}" for name in _COLUMNS[3:-1]]
            + [f"{100 * values[_COLUMNS[-1]]:.0f} %"]
            for label, values in self.differences.items()
        ]
        return [["planned by both", *_COLUMNS], *rows]


def compare_studies(first: Study, second: Study) -> Comparison:
    """Compare two studies on the scenes that both have done: by seed, or by the places of given scenarios.

    Args:
        first: for instance of the usual planner.
        second: of another one, or with other settings.

    Returns:
        The comparison, which prints as a table.

    Raises:
        ValueError: if they are of other kinds of scenes, or have no scene in common.

    Example:
        >>> seeds = range(100)
        >>> print(jp.compare_studies(jp.run_study(seeds), jp.run_study(seeds, planner="rrt_connect")))
    """
    from scipy.stats import binomtest

    for name, study in (("first", first), ("second", second)):
        expect(name, study, Study, "jp.run_study makes one, jp.load_study reads one")
    if first.kind != second.kind:
        raise ValueError(f"the studies are of different scenes, kind = {first.kind!r} and {second.kind!r}")
    left, right = _by_scene(first), _by_scene(second)
    pairs = [(row, right[key]) for key, row in left.items() if key in right]
    if not pairs:
        raise ValueError("the studies have no scene in common")
    success = [(one["status"] == OK, other["status"] == OK) for one, other in pairs]
    only_first, only_second = success.count((True, False)), success.count((False, True))
    differing = only_first + only_second
    solved = [pair for pair, good in zip(pairs, success, strict=True) if all(good)]
    differences = {label: _difference(solved, column) for label, column in _QUANTITIES.items()}
    return Comparison(
        names=(first.title, second.title),
        scenes=len(pairs),
        both=len(solved),
        only_first=only_first,
        only_second=only_second,
        p_value=float(binomtest(only_first, differing).pvalue) if differing else 1.0,
        differences={label: values for label, values in differences.items() if values},
    )


def _by_scene(study: Study) -> dict[Hashable, Row]:
    """Rows of a study's table joined with their times, by seed, or by (number, name) of given scenarios."""
    times = {row["scene"]: row for row in study.timings}
    return {
        row["seed"] if study.kind is not None else (row["scene"], row["name"]): times.get(row["scene"], {})
        | row
        for row in study.table
    }


def _difference(pairs: list[tuple[Row, Row]], column: str) -> dict[str, float]:
    """Statistics of a column's difference, second less first, over pairs of rows in which both have it.

    Returns:
        Values by `_COLUMNS`; none without such a pair.
    """
    values = np.array([[row.get(column) for row in pair] for pair in pairs], dtype=float).reshape(-1, 2)
    values = values[np.all(np.isfinite(values), axis=1)]
    if not len(values):
        return {}
    change = values[:, 1] - values[:, 0]
    spread = np.quantile(change, [0.05, 0.5, 0.95])
    found = (len(change), *np.mean(values, axis=0), np.mean(change), *spread, np.mean(change < 0))
    return {name: float(value) for name, value in zip(_COLUMNS, found, strict=True)}
