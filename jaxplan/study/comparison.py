"""Comparison of two studies of the same scenes, scene by scene.

Whether one planner succeeds more often is tested only on the scenes where exactly one of the two succeeds: if
neither is better, each of these is equally likely to be solved by the one or the other (McNemar's exact
test). The quality of plans is compared on the scenes that both studies plan.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.runtime.arguments import expect
from jaxplan.runtime.display import shown
from jaxplan.study.result import Printed, Study, counted
from jaxplan.study.rows import OK, Row

_COMPARED_COLUMNS = {  # what is compared: label, and column of a study's table or times
    "path length (steps)": "length_steps",
    "duration (s)": "duration_s",
    "smallest margin (deg)": "min_margin_deg",
    "time (s)": "total_s",
}
# Statistics of a quantity: number of scenes, means of both; mean, quantiles and sign of second minus first.
_STATISTICS = ("scenes", "first", "second", "difference", "5 %", "median", "95 %", "second less")


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
    """Comparison of two studies, scene by scene; prints as a table.

    A scene counts as planned where its plan is certified (status OK).

    Attributes:
        names: titles of the first study and the second.
        scenes: number of scenes that both studies have done.
        both: number of these that both plan.
        only_first: number that only the first plans.
        only_second: number that only the second plans.
        p_value: of McNemar's exact test, two-sided: the probability of a difference in success at least this
            large if neither is better; 1 where success never differs.
        differences: statistics of each quantity by its label, over the scenes that both plan. Each is a dict
            with "scenes" (their number), "first" and "second" (the two means), "difference" (mean of second
            minus first), its quantiles "5 %", "median" and "95 %", and "second less" (fraction of scenes in
            which the second has the smaller value).
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
        """Number of scenes that neither study plans."""
        return self.scenes - self.both - self.only_first - self.only_second

    def record(self) -> dict[str, Any]:
        """The comparison as a dict that JSON can hold."""
        counts = ("scenes", "both", "only_first", "only_second", "neither", "p_value")
        return {
            **dict(zip(("first", "second"), self.names, strict=True)),
            **{name: getattr(self, name) for name in counts},
            "differences": {label: dict(values) for label, values in self.differences.items()},
        }

    def lines(self) -> list[tuple[str, str]]:
        """Lines to print above the differences, as (label, value)."""
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
        """The differences as rows of texts, the first row with the titles of columns."""
        rows = [
            [label, f"{values['scenes']:.0f}"]
            + [f"{values[name]:.4g}" for name in _STATISTICS[1:3]]
            + [f"{round(values[name], 9):+.4g}" for name in _STATISTICS[3:-1]]
            + [f"{100 * values[_STATISTICS[-1]]:.0f} %"]
            for label, values in self.differences.items()
        ]
        return [["planned by both", *_STATISTICS], *rows]


def compare_studies(first: Study, second: Study) -> Comparison:
    """Compare two studies on the scenes that both have done.

    Random scenes are matched by seed, given scenarios by their place in the study together with their name.

    Args:
        first: a study, for instance of the usual planner.
        second: a study of another planner, or with other settings.

    Returns:
        The comparison, which prints as a table.

    Raises:
        ValueError: if the studies are of different kinds of scenes, or have no scene in common.

    Example:
        >>> seeds = range(100)
        >>> print(jp.compare_studies(jp.run_study(seeds), jp.run_study(seeds, planner="rrt_connect")))
    """
    from scipy.stats import binomtest

    for name, study in (("first", first), ("second", second)):
        expect(name, study, Study, "jp.run_study makes one, jp.load_study reads one")
    if first.kind != second.kind:
        raise ValueError(f"the studies are of different scenes, kind = {first.kind!r} and {second.kind!r}")
    left, right = _rows_by_scene(first), _rows_by_scene(second)
    pairs = [(row, right[key]) for key, row in left.items() if key in right]
    if not pairs:
        raise ValueError("the studies have no scene in common")
    success = [(one["status"] == OK, other["status"] == OK) for one, other in pairs]
    only_first, only_second = success.count((True, False)), success.count((False, True))
    differing = only_first + only_second
    solved = [pair for pair, good in zip(pairs, success, strict=True) if all(good)]
    differences = {
        label: _difference_statistics(solved, column) for label, column in _COMPARED_COLUMNS.items()
    }
    return Comparison(
        names=(first.title, second.title),
        scenes=len(pairs),
        both=len(solved),
        only_first=only_first,
        only_second=only_second,
        p_value=float(binomtest(only_first, differing).pvalue) if differing else 1.0,
        differences={label: values for label, values in differences.items() if values},
    )


def _rows_by_scene(study: Study) -> dict[Hashable, Row]:
    """Rows of a study's table, each joined with its times, by the key that identifies the scene.

    The key is the seed of a random scene, or (place in the study, name) of a given scenario.
    """
    times = {row["scene"]: row for row in study.timings}
    return {
        row["seed"] if study.kind is not None else (row["scene"], row["name"]): times.get(row["scene"], {})
        | row
        for row in study.table
    }


def _difference_statistics(pairs: list[tuple[Row, Row]], column: str) -> dict[str, float]:
    """Statistics of a column's difference, second minus first, over pairs of rows that both have a value.

    Returns:
        Values by the names `_STATISTICS`; an empty dict if there is no such pair.
    """
    values = np.array([[row.get(column) for row in pair] for pair in pairs], dtype=float).reshape(-1, 2)
    values = values[np.all(np.isfinite(values), axis=1)]
    if not len(values):
        return {}
    change = values[:, 1] - values[:, 0]
    spread = np.quantile(change, [0.05, 0.5, 0.95])
    found = (len(change), *np.mean(values, axis=0), np.mean(change), *spread, np.mean(change < 0))
    return {name: float(value) for name, value in zip(_STATISTICS, found, strict=True)}
