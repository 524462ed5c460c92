"""Planning all satellites of a switch, in this process or by workers, and the results.

The result is a study of the switch's scenarios, presented by satellite: as arrays, a table, and a summary.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from jaxplan.constellation.links import WHEN
from jaxplan.constellation.shell import Shell
from jaxplan.constellation.switch import LinkSwitch
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.display import shown
from jaxplan.runtime.workers import Workers
from jaxplan.study import Study, Summary, run_study

_DROPPED_COLUMNS = ("scene", "seed", "name", "kind")  # of a study; the satellite's number replaces them


@shown("satellites", "study.done", heading="Constellation of {0.switch.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Constellation:
    """Results of planning a switch; arrays have an entry for each of the N satellites that have been planned.

    N is less than the number of satellites asked for if planning was interrupted.

    Attributes:
        switch: the switch that was planned.
        satellites: numbers in the shell of the satellites asked for, in the order of planning.
        study: the underlying study, with `to_pandas` and `to_parquet`; its scene k is ``satellites[k]``.
    """

    switch: LinkSwitch
    satellites: Sequence[int]
    study: Study

    @property
    def shell(self) -> Shell:
        """The shell whose links are switched."""
        return self.switch.shell

    @cached_property
    def table(self) -> list[dict[str, Any]]:
        """Table with a row for each planned satellite; it is the same on every run.

        Columns are satellite, plane, slot, sun_outages_before and sun_outages_after (numbers of its links
        that lead through the Sun's cone or within `CLEARANCE` of it), and those of a study's table from
        planner on.
        """
        rows = []
        for row in self._label_by_satellite(self.study.table):
            number = row["satellite"]
            outages = np.sum(self.switch.sun_outage[:, number], axis=-1)
            place = {
                "satellite": number,
                "plane": int(self.shell.plane[number]),
                "slot": int(self.shell.slot[number]),
                **{f"sun_outages_{when}": int(count) for when, count in zip(WHEN, outages, strict=True)},
            }
            rows.append(place | row)
        return rows

    @cached_property
    def timings(self) -> list[dict[str, Any]]:
        """Computation times in s of each satellite's planning, by step; a row for each satellite."""
        return self._label_by_satellite(self.study.timings)

    def _label_by_satellite(self, rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """Replace the columns `_DROPPED_COLUMNS` of a study's rows by the satellite's number."""
        return [
            {"satellite": int(self.satellites[row["scene"]])}
            | {name: value for name, value in row.items() if name not in _DROPPED_COLUMNS}
            for row in rows
        ]

    def _column(self, name: str, kind: type = float) -> np.ndarray:
        """A column (N,) of the table as an array of type `kind`; unknown values become NaN."""
        return np.array([np.nan if row[name] is None else row[name] for row in self.table], dtype=kind)

    @property
    def planned(self) -> np.ndarray:
        """Numbers (N,) of the planned satellites in the shell, in the order of the table's rows."""
        return self._column("satellite", int)

    @property
    def status(self) -> np.ndarray:
        """Outcome (N,) for each satellite: the name of a `Status`, or "crashed"."""
        return self._column("status", str)

    @property
    def certified(self) -> np.ndarray:
        """Whether each satellite has a certified plan, (N,) bool."""
        return self._column("certified", bool)

    @property
    def duration(self) -> np.ndarray:
        """Durations (N,) of the manoeuvres, s; NaN where there is no trajectory."""
        return self._column("duration_s")

    @property
    def slew_angle(self) -> np.ndarray:
        """Angles (N,) by which the platforms turn from start to goal, rad; NaN where no goal was found."""
        return np.deg2rad(self._column("slew_deg"))

    @property
    def min_margin(self) -> np.ndarray:
        """Proved lower bounds (N,) of each satellite's smallest margin, rad; NaN without a certificate.

        A margin is the angle to the nearest limit of a zone, positive where the zone is kept.
        """
        return np.deg2rad(self._column("min_margin_deg"))

    @property
    def sun_outage(self) -> np.ndarray:
        """Whether each satellite has a link, before or after, that leads through the Sun's cone, (N,) bool.

        Links within `CLEARANCE` of the cone count, too.
        """
        return np.any(self.switch.sun_outage, axis=(0, 2))[self.planned]

    def summary(self) -> "ConstellationSummary":
        """Summarize plans and outages: counts, and quantiles of durations, path lengths and margins."""
        return ConstellationSummary(
            **vars(self.study.summary()),
            switch=self.switch,
            sun_outages=tuple(int(np.sum(out[self.planned])) for out in self.switch.sun_outage),
            satellites_with_outages=int(np.sum(self.sun_outage)),
            beyond_drift=int(np.sum(self.duration > self.switch.drift_time)),
        )

    def __str__(self) -> str:
        return str(self.summary())

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()


@shown("done", "planned", "satellites_with_outages", "beyond_drift", heading="Summary of {0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class ConstellationSummary(Summary):
    """A constellation in a few numbers: those of its study, and those of its links; prints as a table.

    It has the attributes of `Summary`, and these:

    Attributes:
        switch: the switch that was planned.
        sun_outages: numbers of the planned satellites' links that lead through the Sun's cone, or within
            `CLEARANCE` of it, before and after.
        satellites_with_outages: number of planned satellites with such a link.
        beyond_drift: number of manoeuvres that take longer than the switch's `drift_time`, so that the
            Earth's cone was not made wide enough for them.
    """

    switch: LinkSwitch
    sun_outages: tuple[int, ...]
    satellites_with_outages: int
    beyond_drift: int

    @property
    def title(self) -> str:
        """Title of the switch."""
        return f"Switch of the {self.switch.title}"

    def record(self) -> dict[str, Any]:
        """The summary as a dict that JSON can hold."""
        return super().record() | {
            **{f"sun_outages_{when}": count for when, count in zip(WHEN, self.sun_outages, strict=True)},
            "satellites_with_sun_outages": self.satellites_with_outages,
            "beyond_drift_time": self.beyond_drift,
        }

    def lines(self) -> list[tuple[str, str]]:
        """Lines to print above the quantiles, as (label, value)."""
        switch, (_, *lines) = self.switch, super().lines()
        done = f"{self.done}" if self.done == switch.shell.total else f"{self.done} of {switch.shell.total}"
        earth = f"{np.rad2deg(switch.earth_half_angle):.1f} deg about nadir"
        late = f"{self.beyond_drift} manoeuvres beyond its {switch.drift_time:g} s"
        lines = [("satellites", done), *lines, ("Earth's cone", f"{earth}; {late}")]
        if switch.sun_direction is not None:
            before, after = self.sun_outages
            cone = f"{np.rad2deg(switch.sun_half_angle):.3g} deg"
            links = f"through it {before} links before and {after} after"
            lines.append(("Sun's cone", f"{cone}; {links}, of {self.satellites_with_outages} satellites"))
        return lines


def plan_constellation(
    switch: LinkSwitch,
    *,
    satellites: Iterable[int] | None = None,
    planner: str = "mha",
    settings: Mapping[str, Any] | None = None,
    workers: Workers | None = None,
    out: str | os.PathLike[str] | None = None,
    chunk: int | None = None,
    progress: bool = True,
    executor: Workers | None = None,
) -> Constellation:
    """Plan the manoeuvres of a shell's satellites from their links before a switch to those after it.

    This is a Monte-Carlo study of the switch's scenarios (`run_study`): `plan_batch` plans them block by
    block, a satellite that fails gets a row instead of an exception, and the table is the same whatever the
    workers. Durations are "stretched" unless settings say otherwise. Plans are not kept, since thousands of
    them take much memory: ``jp.plan(switch.scenario(17))`` makes one again.

    Args:
        switch: the satellites' links before and after, from `link_switch`.
        satellites: numbers of the satellites to plan; None for all.
        planner: name of the search method, see `run_study`.
        settings: scenario settings that differ from the defaults, such as
            ``{"trajectory.duration_s": "minimum"}``; None for the defaults.
        workers: who plans: None for this process, a number of processes, or an executor.
        out: a folder that keeps the rows of each chunk as soon as it is done; None to keep them in memory.
        chunk: number of blocks, of 16 satellites each, that a worker gets at once; None for as many as take
            some two seconds.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        executor: an older name of workers.

    Returns:
        The outcome of each satellite.

    Raises:
        ScenarioError: for a satellite number or a setting that is not allowed.
        TypeError, ValueError, StudyFolderError, RuntimeError: see `run_study`.

    Example:
        >>> result = jp.plan_constellation(jp.link_switch(jp.walker("53:96/12/1", 1414.0)))
        >>> print(result.summary())
    """
    expect("switch", switch, LinkSwitch, "jp.link_switch makes one of a shell")
    chosen = switch.chosen(satellites)
    study = run_study(
        switch.scenarios(chosen),
        planner=planner,
        settings=settings,
        workers=workers,
        out=out,
        chunk=chunk,
        progress=progress,
        executor=executor,
    )
    return Constellation(switch=switch, satellites=chosen, study=study)
