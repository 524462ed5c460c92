"""The result of a study: its table, its times, and what follows from them."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxplan.display import shown
from jaxplan.given import file_path
from jaxplan.study.lines import TABLE, TIMINGS, read_header, read_rows
from jaxplan.study.rows import COLUMNS, TIMES, Row
from jaxplan.study.summary import Summary, summarise

if TYPE_CHECKING:
    import pandas as pd


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
        from jaxplan.study.frames import to_pandas

        return to_pandas(self)

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write `to_pandas` to a Parquet file, whole or not at all.

        Args:
            path: of the file; one that is there is replaced.

        Raises:
            ImportError: without pandas or pyarrow, which the extra ``study`` brings.
        """
        from jaxplan.study.frames import to_parquet

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
