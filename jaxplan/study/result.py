"""The result of a study: its table, computation times and summary; and how such results print as text."""

import math
import os
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.runtime.arguments import file_path, show
from jaxplan.runtime.display import Cells, as_table, shown
from jaxplan.runtime.files import replacing_file
from jaxplan.study.rows import OK, TIMES, Row, columns_of
from jaxplan.study.store import TABLE, TIMINGS, read_header, scan

Lines = Sequence[tuple[str, str]]


class Printed(ABC):
    """Base class of results that print as a title, lines of labels and values, and a table.

    Notebooks show the same as HTML.
    """

    @property
    @abstractmethod
    def title(self) -> str:
        """The title, which stands above the lines and the table."""

    def lines(self) -> Lines:
        """Lines above the table, as (label, value); none by default."""
        return ()

    @abstractmethod
    def cells(self) -> Cells:
        """The table as rows of texts, the first row with the titles of columns."""

    def __str__(self) -> str:
        return aligned(self.title, self.lines(), self.cells())

    def _repr_html_(self) -> str:
        return as_table(self.title, self.lines(), self.cells())


def aligned(title: str, lines: Lines, cells: Cells) -> str:
    """Format a title, labels with their values, and a table with aligned columns as one text.

    Args:
        title: first line of the text.
        lines: (label, value) of each line above the table.
        cells: rows of the table, the first with the titles of columns; it must have a row.
    """
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    widths[0] = max([widths[0], *(len(label) for label, _ in lines)])
    text = [title, *(f"  {label:<{widths[0]}}  {value}" for label, value in lines)]
    for row in cells:
        numbers = (f"{cell:>{width}}" for cell, width in zip(row[1:], widths[1:], strict=True))
        text.append(f"  {row[0]:<{widths[0]}}  {'  '.join(numbers)}")
    return "\n".join(text)


QUANTILES: Mapping[str, float] = {"least": 0.0, "5 %": 0.05, "median": 0.5, "95 %": 0.95, "most": 1.0}
# Quantities of a summary: label, column, and whether every scene counts or only the planned ones.
_SUMMARY_QUANTITIES = (
    ("time (s), all scenes", "total_s", True),
    ("  of which search (s)", "search_s", True),
    ("expansions, all scenes", "expansions", True),
    ("path length (steps)", "length_steps", False),
    ("interior nodes", "interior_nodes", False),
    ("duration (s)", "duration_s", False),
    ("duration over its bound", "over_bound", False),
    ("smallest margin (deg)", "min_margin_deg", False),
)
_PANDAS_TYPES = {int: "Int64", float: "Float64", bool: "boolean", str: "string"}  # pandas types that allow NA


_Z = 1.959963984540054  # quantile of the normal distribution that leaves 2.5 % above it


def success_interval(successes: int, trials: int) -> tuple[float, float]:
    """Compute the 95 % Wilson confidence interval of a success rate.

    Args:
        successes: number of successes.
        trials: number of trials.

    Returns:
        Lower and upper bound, both from 0 to 1; (0, 1) if there are no trials.
    """
    if trials == 0:
        return 0.0, 1.0
    # In closed form, since scipy first computes a test beside it, which takes for ever for huge numbers.
    share, spread = successes / trials, _Z**2 / trials
    middle = share + spread / 2
    half = math.sqrt(spread * (share * (1 - share) + spread / 4))
    return max((middle - half) / (1 + spread), 0.0), min((middle + half) / (1 + spread), 1.0)


def counted(number: int, noun: str) -> str:
    """Text of a number and a noun, which is in the plural unless the number is 1."""
    return f"{number} {noun}{'s' * (number != 1)}"


@shown("done", "planned", "statuses", heading="Summary of {0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Summary(Printed):
    """Summary of a study: success rate, counts of statuses, and quantiles of results; prints as a table.

    Attributes:
        study: title of the study.
        scenes: number of its scenes.
        done: number of scenes that have a row.
        planned: number of scenes with a certified plan.
        statuses: number of scenes with each status, the most frequent first.
        spreads: statistics of each quantity by its label: the number of "values", their "mean", and their
            quantiles by the names of `QUANTILES`.
    """

    study: str
    scenes: int
    done: int
    planned: int
    statuses: Mapping[str, int]
    spreads: Mapping[str, Mapping[str, float]]

    @property
    def title(self) -> str:
        """Title of the summary."""
        return f"Study of {self.study}"

    @property
    def success_rate(self) -> float | None:
        """Fraction of the scenes done that have a certified plan, from 0 to 1; None if no scene is done."""
        return self.planned / self.done if self.done else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson confidence interval of the success rate: lower and upper bound, from 0 to 1."""
        return success_interval(self.planned, self.done)

    def record(self) -> dict[str, Any]:
        """The summary as a dict that JSON can hold."""
        return {
            "title": self.title,
            "scenes": self.scenes,
            "done": self.done,
            "planned": self.planned,
            "success_rate": self.success_rate,
            "success_95_percent": list(self.interval),
            "statuses": dict(self.statuses),
            "spreads": {label.strip(): dict(spread) for label, spread in self.spreads.items()},
        }

    def lines(self) -> list[tuple[str, str]]:
        """Lines to print above the quantiles, as (label, value)."""
        low, high = (100 * bound for bound in self.interval)
        rate = "-" if self.success_rate is None else f"{100 * self.success_rate:.2f} %"
        done = f"{self.done}" if self.done == self.scenes else f"{self.done} done of {self.scenes}"
        return [
            ("scenes", done),
            ("planned, certified", f"{self.planned}: {rate}, 95 % interval {low:.2f} to {high:.2f} %"),
            ("status", ", ".join(f"{count} {name}" for name, count in self.statuses.items()) or "-"),
        ]

    def cells(self) -> list[list[str]]:
        """The quantiles as rows of texts, the first row with the titles of columns."""
        head = ["", "values", "mean", *QUANTILES]
        rows = [
            [label, f"{spread['values']:.0f}", *(f"{spread[name]:.4g}" for name in head[2:])]
            for label, spread in self.spreads.items()
        ]
        return [head, *rows]


@shown("done", "scenes", "folder", heading="Study of {0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Results of planning many scenes. If the study is in a folder, its rows are read when first asked for.

    Attributes:
        kind: kind of the random scenes; None where scenarios were given.
        planner: name of the search method.
        settings: scenario settings that the study changed.
        scenes: number of its scenes; those that are not done yet have no row.
        folder: where it is kept; None if it is in memory only.
        columns: names of the study's own columns.
    """

    kind: str | None
    planner: str
    settings: Mapping[str, Any]
    scenes: int
    folder: Path | None = None
    columns: tuple[str, ...] = ()
    _memory_rows: Mapping[str, list[Row]] = field(default_factory=dict, repr=False)

    @cached_property
    def table(self) -> list[Row]:
        """Rows of the scenes done, in the order of scenes, the same on every run; see `rows.COLUMNS`."""
        return self._read_rows(TABLE)

    @cached_property
    def timings(self) -> list[Row]:
        """Computation times in s of the scenes in the table, by step, with the columns `rows.TIMES`.

        Times are None where a scene crashed; a scene whose times are lost has no row.
        """
        done = {row["scene"] for row in self.table}
        return [row for row in self._read_rows(TIMINGS) if row["scene"] in done]

    def _read_rows(self, name: str) -> list[Row]:
        """Rows of `TABLE` or `TIMINGS`, in the order of scenes; of several for a scene the last counts."""
        if self.folder is None:
            return sorted(self._memory_rows[name], key=lambda row: row["scene"])
        rows = {row["scene"]: row for _, row in scan(self.folder, name, self.scenes, self.columns)}
        return [rows[number] for number in sorted(rows)]

    @property
    def title(self) -> str:
        """Number and kind of scenes, planner and changed settings in one line."""
        of = "scenario" if self.kind is None else f"{self.kind} scene"
        changed = "".join(f", {name} = {value}" for name, value in self.settings.items())
        return f"{counted(self.scenes, of)} by {self.planner}{changed}"

    @property
    def done(self) -> int:
        """Number of scenes that have a row."""
        return len(self.table)

    @property
    def complete(self) -> bool:
        """Whether all scenes have a row."""
        return self.done == self.scenes

    @property
    def planned(self) -> int:
        """Number of scenes with a certified plan (status OK)."""
        return sum(row["status"] == OK for row in self.table)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson confidence interval of the success rate among the scenes done: bounds from 0 to 1."""
        return success_interval(self.planned, self.done)

    def values(self, column: str, every: bool = False) -> np.ndarray:
        """Collect the values of a column; scenes without a value are left out.

        Args:
            column: a column of the table or the times; or "over_bound", the ratio of the duration to the
                lower bound of any motion's duration, zones ignored.
            every: whether scenes without a certified plan count, too.

        Returns:
            Array (k,) of the values.

        Raises:
            ValueError: if there is no such column of numbers.
        """
        kinds = {**columns_of(self.columns), **TIMES, "over_bound": float}
        known = [name for name, kind in kinds.items() if kind is not str]
        if column not in known:
            raise ValueError(f"column = {show(column)}: must be one of {', '.join(known)}")
        chosen = [row for row in self.table if every or row["status"] == OK]
        if column == "over_bound":
            bounds = ((row["duration_s"], row["duration_bound_s"]) for row in chosen)
            return np.array([duration / bound for duration, bound in bounds if duration and bound])
        if column in TIMES:  # rows of times may be missing
            scenes = {row["scene"] for row in chosen}
            chosen = [row for row in self.timings if row["scene"] in scenes]
        return np.array([row[column] for row in chosen if row[column] is not None], dtype=float)

    def summary(self) -> Summary:
        """Summarize the study: success rate with interval, and quantiles of results; prints as a table."""
        quantities = [*_SUMMARY_QUANTITIES, *((name, name, False) for name in self.columns)]
        values = {label: self.values(column, every) for label, column, every in quantities}
        return Summary(
            study=self.title,
            scenes=self.scenes,
            done=self.done,
            planned=self.planned,
            statuses=dict(Counter(row["status"] for row in self.table).most_common()),
            spreads={label: _spread(known) for label, known in values.items() if len(known)},
        )

    def to_pandas(self) -> Any:
        """Table and times as one `pandas.DataFrame`, a row for each scene; missing values are pandas' NA.

        Raises:
            ImportError: without pandas, which the extra ``study`` installs.
        """
        with _explain_missing_package("pandas"):
            import pandas as pd
        times = {row["scene"]: row for row in self.timings}
        rows = [{**times.get(row["scene"], {}), **row} for row in self.table]
        return pd.DataFrame(
            {
                name: pd.array([row.get(name) for row in rows], dtype=_PANDAS_TYPES[kind])
                for name, kind in {**columns_of(self.columns), **TIMES}.items()
            }
        )

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write the data frame of `to_pandas` to a Parquet file, as a whole or not at all.

        Args:
            path: of the file; an existing file is replaced.

        Raises:
            ImportError: without pandas or pyarrow, which the extra ``study`` installs.
        """
        with _explain_missing_package("pyarrow"):
            import pyarrow  # noqa: F401
        frame = self.to_pandas()
        with replacing_file(Path(path)) as temporary:
            frame.to_parquet(temporary, engine="pyarrow", index=False)

    def __str__(self) -> str:
        return str(self.summary())

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()


def _spread(values: np.ndarray) -> dict[str, float]:
    """Number, mean and quantiles of values (k,), k > 0, with the names that `Summary.spreads` has."""
    spread = {"values": float(len(values)), "mean": float(np.mean(values))}
    return spread | {name: float(np.quantile(values, share)) for name, share in QUANTILES.items()}


@contextmanager
def _explain_missing_package(package: str) -> Iterator[None]:
    """Context in which an ImportError is replaced by one that says how to install the package."""
    try:
        yield
    except ImportError as error:
        raise ImportError(
            f"{package} is missing: install the extra that brings it, pip install 'jaxplan[study]'"
        ) from error


def load_study(folder: str | os.PathLike[str]) -> Study:
    """Read the folder of a study, which may still be incomplete.

    Args:
        folder: the one that `run_study` was given as ``out``.

    Raises:
        TypeError: if `folder` is not a path.
        StudyFolderError: if the folder does not hold a study.
    """
    place = file_path("folder", folder)
    header = read_header(place)
    return Study(
        **{key: header[key] for key in ("kind", "planner", "settings", "scenes")},
        folder=place,
        columns=tuple(header.get("columns", ())),
    )
