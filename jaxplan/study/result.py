"""What a study found: its table, summary and text.

Lines and numbers of a study as aligned text.

A study in a few lines: how many scenes are planned, and how quick, short and safe the plans are.

The result of a study: its table, its times, and what follows from them.
"""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxplan.proportions import success_interval
from jaxplan.runtime.arguments import file_path
from jaxplan.runtime.display import as_table, shown
from jaxplan.study.rows import COLUMNS, OK, TABLE, TIMES, TIMINGS, Row, read_header, read_rows

if TYPE_CHECKING:
    import pandas as pd


Lines = Sequence[tuple[str, str]]
Cells = Sequence[Sequence[str]]


def aligned(title: str, lines: Lines, cells: Cells) -> str:
    """Labels and values, and below them a table whose columns line up.

    Args:
        title: above all.
        lines: (label, value).
        cells: rows of the table, the first of them its head.
    """
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    widths[0] = max([widths[0], *(len(label) for label, _ in lines)])
    text = [title, *(f"  {label:<{widths[0]}}  {value}" for label, value in lines)]
    for row in cells:
        numbers = (f"{cell:>{width}}" for cell, width in zip(row[1:], widths[1:], strict=True))
        text.append(f"  {row[0]:<{widths[0]}}  {'  '.join(numbers)}")
    return "\n".join(text)


QUANTILES: Mapping[str, float] = {"least": 0.0, "5 %": 0.05, "median": 0.5, "95 %": 0.95, "most": 1.0}

# Label, column, and whether every scene counts or only those that are planned.
_QUANTITIES = (
    ("time (s), all scenes", "total_s", True),
    ("  of which search (s)", "search_s", True),
    ("expansions, all scenes", "expansions", True),
    ("path length (steps)", "length_steps", False),
    ("interior nodes", "interior_nodes", False),
    ("duration (s)", "duration_s", False),
    ("duration over its bound", "over_bound", False),
    ("smallest margin (deg)", "min_margin_deg", False),
)


@shown("done", "planned", "statuses", heading="Summary of {0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Summary:
    """A study in a few numbers.

    Attributes:
        title: which study.
        scenes: how many it has.
        done: of how many of them something is known.
        planned: of how many there is a certified plan.
        interval: 95 % Wilson interval of the success rate.
        statuses: how often each came, most frequent first.
        spreads: of each quantity the number of its values, their mean and their `QUANTILES`, by label.
    """

    title: str
    scenes: int
    done: int
    planned: int
    interval: tuple[float, float]
    statuses: Mapping[str, int]
    spreads: Mapping[str, Mapping[str, float]]

    @property
    def success_rate(self) -> float | None:
        """Share of the scenes done that have a certified plan; None where none is done."""
        return self.planned / self.done if self.done else None

    def record(self) -> dict[str, Any]:
        """The summary for machines."""
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
        """What stands above the quantiles, as (label, value)."""
        low, high = (100 * bound for bound in self.interval)
        rate = "-" if self.success_rate is None else f"{100 * self.success_rate:.2f} %"
        done = f"{self.done}" if self.done == self.scenes else f"{self.done} done of {self.scenes}"
        return [
            ("scenes", done),
            ("planned, certified", f"{self.planned}: {rate}, 95 % interval {low:.2f} to {high:.2f} %"),
            ("status", ", ".join(f"{count} {name}" for name, count in self.statuses.items()) or "-"),
        ]

    def cells(self) -> list[list[str]]:
        """The quantiles as rows of texts, with their head."""
        head = ["", "values", "mean", *QUANTILES]
        rows = [
            [label, f"{spread['values']:.0f}", *(f"{spread[name]:.4g}" for name in head[2:])]
            for label, spread in self.spreads.items()
        ]
        return [head, *rows]

    def __str__(self) -> str:
        return aligned(self.title, self.lines(), self.cells())

    def _repr_html_(self) -> str:
        return as_table(self.title, self.lines(), self.cells())


def summarise(study: "Study") -> Summary:
    """See `Study.summary`."""
    table = study.table
    planned = sum(row["status"] == OK for row in table)
    values = {column: column_values(study, column, every) for _, column, every in _QUANTITIES}
    return Summary(
        title=f"Study of {study.title}",
        scenes=study.scenes,
        done=len(table),
        planned=planned,
        interval=success_interval(planned, len(table)),
        statuses=dict(Counter(row["status"] for row in table).most_common()),
        spreads={label: _spread(values[column]) for label, column, _ in _QUANTITIES if len(values[column])},
    )


def column_values(study: "Study", column: str, every: bool) -> np.ndarray:
    """The values of a column, of all scenes that have one or of those that are planned.

    Args:
        study: any.
        column: of its table or its times, or "over_bound" for a duration over the least that the goal allows.
        every: whether scenes without a plan count.
    """
    chosen = [row for row in study.table if every or row["status"] == OK]
    if column == "over_bound":
        bounds = ((row["duration_s"], row["duration_bound_s"]) for row in chosen)
        return np.array([duration / bound for duration, bound in bounds if duration and bound])
    if column in TIMES:  # of which rows may be missing
        scenes = {row["scene"] for row in chosen}
        chosen = [row for row in study.timings if row["scene"] in scenes]
    return np.array([row[column] for row in chosen if row[column] is not None], dtype=float)


def _spread(values: np.ndarray) -> dict[str, float]:
    spread = {"values": float(len(values)), "mean": float(np.mean(values))}
    return spread | {name: float(np.quantile(values, share)) for name, share in QUANTILES.items()}


@shown("done", "scenes", "folder", heading="Study of {0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """What became of many scenes. Of a study in a folder, rows are read when they are first asked for.

    Attributes:
        kind: of random scenes; None where scenarios were given.
        planner: its name.
        settings: that differ from the scenes' own.
        scenes: how many there are; those that were not planned yet have no row.
        folder: where it is kept; None if only here.
    """

    kind: str | None
    planner: str
    settings: Mapping[str, Any]
    scenes: int
    folder: Path | None = None
    _held: Mapping[str, list[Row]] = field(default_factory=dict, repr=False)

    @cached_property
    def table(self) -> list[Row]:
        """A row a scene, in the order of the scenes: the same on every run. See `rows.COLUMNS`."""
        return self._rows(TABLE, COLUMNS)

    @cached_property
    def timings(self) -> list[Row]:
        """Likewise the seconds of each scene, by step; None for those that crashed."""
        return self._rows(TIMINGS, TIMES)

    def _rows(self, file: str, columns: Mapping[str, type]) -> list[Row]:
        if self.folder is None:
            return sorted(self._held[file], key=lambda row: row["scene"])
        rows = read_rows(self.folder / file, columns, self.scenes, past=file == TIMINGS)
        if file == TABLE:
            return rows
        done = {row["scene"] for row in self.table}
        return [row for row in rows if row["scene"] in done]

    @property
    def title(self) -> str:
        """Which scenes, by which planner, with which settings."""
        of = "scenarios" if self.kind is None else f"{self.kind} scenes"
        changed = "".join(f", {name} = {value}" for name, value in self.settings.items())
        return f"{self.scenes} {of} by {self.planner}{changed}"

    @property
    def done(self) -> int:
        """How many scenes have a row."""
        return len(self.table)

    @property
    def complete(self) -> bool:
        """Whether all scenes have a row."""
        return self.done == self.scenes

    def summary(self) -> Summary:
        """Success rate with its interval, and quantiles of what was found; prints as a table."""
        return summarise(self)

    def to_pandas(self) -> "pd.DataFrame":
        """Table and times as one data frame, a row a scene, missing values as pandas' own NA.

        Raises:
            ImportError: without pandas, which the extra ``study`` brings.
        """
        from jaxplan.study.rows import to_pandas

        return to_pandas(self)

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write `to_pandas` to a Parquet file, whole or not at all.

        Args:
            path: of the file; one that is there is replaced.

        Raises:
            ImportError: without pandas or pyarrow, which the extra ``study`` brings.
        """
        from jaxplan.study.rows import to_parquet

        to_parquet(self, path)

    def __str__(self) -> str:
        return str(self.summary())

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()


def load_study(folder: str | os.PathLike[str]) -> Study:
    """Read the folder of a study, also of one that is not done yet.

    Args:
        folder: what `run_study` was given as ``out``.

    Raises:
        TypeError: for what is no path.
        StudyFolderError: if it holds no study.
    """
    place = file_path("folder", folder)
    header = read_header(place)
    return Study(
        kind=header["kind"],
        planner=header["planner"],
        settings=header["settings"],
        scenes=header["scenes"],
        folder=place,
    )
