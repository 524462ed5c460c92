"""Planning a fleet: the links of every satellite of a shell over hours or a day, with all plans kept on disk.

Each satellite is planned independently, its links as a timeline, in this process or by workers. Its plan is
written to the folder as soon as it is made; in memory there is only one table row for each satellite. A
satellite whose planning raises an error, or kills its worker process twice, gets a row with the status
"crashed".
"""

import hashlib
import json
import math
import os
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.constellation.fleet_folder import FleetFolder, Row
from jaxplan.constellation.link_schedules import LinkSchedule
from jaxplan.constellation.orders import Order, Planned, given_up, order_of, plan_order
from jaxplan.constellation.shell import out_of_range
from jaxplan.model.activities import SHORTEST, SLEWS
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.runtime.arguments import expect, file_path, show
from jaxplan.runtime.display import aligned, as_table, shown
from jaxplan.runtime.progress import progress_bar
from jaxplan.runtime.workers import Workers, WorkersDiedError, who_works
from jaxplan.schema import ScenarioError, scenario_to_dict, with_settings
from jaxplan.study.run import DEATHS, answers
from jaxplan.timeline import TimelinePlan
from jaxplan.version import __version__

_TOLERANCE_RANGE = math.radians(1e-8), math.radians(1.0)  # rad, of the pointing tolerances allowed
_MOST_TOLD = 10  # planned satellites that messages name


@shown("done", "satellites", "failures", "folder", heading="Fleet of {0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Fleet:
    """Outcome of planning a shell's satellites, with plans in a folder; made by `plan_fleet` or `load_fleet`.

    Attributes:
        title: the shell, epoch and duration.
        satellites: number of satellites that were to be planned; of `load_fleet` the number in the shell.
        folder: where the plans are.
        table: one row for each satellite that has been planned, ordered by satellite number, with the columns
            of `orders.COLUMNS`: status, message, activities, linked and scheduled seconds, slews, and proved
            bounds. It is the same on every run.
    """

    title: str
    satellites: int
    folder: Path
    table: list[Row]

    @property
    def done(self) -> int:
        """Number of satellites that have a row in the table, whether they were planned or failed."""
        return len(self.table)

    @property
    def complete(self) -> bool:
        """Whether every satellite asked for has a row in the table, whether it was planned or failed."""
        return self.done == self.satellites

    @property
    def certified(self) -> int:
        """Number of satellites with status OK: every activity is planned, the whole motion certified."""
        return sum(row["status"] == Status.OK.name for row in self.table)

    @property
    def failures(self) -> dict[str, int]:
        """Number of satellites with each status other than OK, by its name, most frequent first."""
        names = Counter(row["status"] for row in self.table if row["status"] != Status.OK.name)
        return dict(names.most_common())

    @cached_property
    def timings(self) -> list[Row]:
        """Computation times in s by planning step, one row for each satellite where they are known."""
        known = {row["satellite"] for row in self.table}
        return [row for row in self._store.timings() if row["satellite"] in known]

    @cached_property
    def _store(self) -> FleetFolder:
        """The fleet's folder, opened for reading."""
        return FleetFolder.of(self.folder)[0]

    def load(self, satellite: int) -> TimelinePlan:
        """Read the plan of one satellite from the folder, for instance to certify it anew, draw or export it.

        Args:
            satellite: number of the satellite.

        Raises:
            ValueError: if the fleet has no satellite of that number, or it is not planned.
            PlanFileError: if its plan file is damaged.
        """
        given: Any = satellite  # it may be anything at run time
        whole = isinstance(given, int | np.integer) and not isinstance(given, bool)
        if not whole or not 0 <= given < self._store.total:
            most = self._store.total - 1
            raise ValueError(f"satellite = {show(given)}: must be an integer in [0, {most}]")
        if not self._store.place(int(given)).exists():
            raise ValueError(f"satellite = {given}: is not planned, {_told_planned(self._store.planned())}")
        return self._store.plan(int(given))

    def rows(self) -> list[tuple[str, str]]:
        """Return the fleet's totals as (label, value) texts for a printed table."""
        table = self.table
        done = f"{self.done}" if self.complete else f"{self.done} done of {self.satellites}"
        rows = [("satellites", done), ("planned, certified", f"{self.certified}")]
        rows += [(name, f"{count}") for name, count in self.failures.items()]
        slews = sum(row["slews"] for row in table)
        if slews:
            seconds, longest = (
                sum(row["slew_s"] for row in table),
                max(row["longest_slew_s"] for row in table),
            )
            rows.append(
                ("slews", f"{slews}, {seconds / slews:.1f} s on average, {longest:.1f} s the longest")
            )
        scheduled = sum(row["scheduled_s"] for row in table)
        if scheduled:
            share = sum(row["linked_s"] for row in table) / scheduled
            rows.append(("links", f"followed for {100 * share:.2f} % of the scheduled time"))
        errors = [row["pointing_error_deg"] for row in table if row["pointing_error_deg"] is not None]
        if errors:
            rows.append(("pointing", f"within {max(errors):.2g} deg of every link, proved"))
        margins = [row for row in table if row["min_margin_deg"] is not None]
        if margins:
            least = min(margins, key=lambda row: row["min_margin_deg"])
            of = f"{least['worst_device']} of satellite {least['satellite']} to {least['worst_zone']}"
            rows.append(("smallest margin", f"{least['min_margin_deg']:.3f} deg, {of}, proved"))
        return rows

    def __str__(self) -> str:
        return "\n".join([f"Fleet of {self.title}", *(f"  {line}" for line in aligned(self.rows()))])

    def _repr_html_(self) -> str:
        return as_table(f"Fleet of {self.title}", self.rows())


def plan_fleet(
    schedule: LinkSchedule,
    folder: str | os.PathLike[str],
    *,
    satellites: Iterable[int] | None = None,
    tolerance: float = math.radians(0.01),
    slew: str = SHORTEST,
    settings: Mapping[str, Any] | None = None,
    workers: Workers | None = None,
    progress: bool = True,
) -> Fleet:
    """Plan the links of a shell's satellites over hours or a day, and keep every plan in a folder.

    Each satellite follows its links until they change, then slews to the next ones as soon as they are
    scheduled. Its terminals stay clear of Sun and Earth at all times, and its whole motion is certified.
    Activities that cannot be planned are named in the satellite's row, and the rest of its time is planned
    nevertheless. On one machine the files are the same bytes whatever the workers, and however often the call
    is interrupted: repeating a call that was killed continues it, and may ask for more satellites. Ctrl-C
    ends the call early and returns what is done.

    Args:
        schedule: the links, from `link_schedule`.
        folder: a new or empty folder, or that of the same fleet. A plan that is there is not made again.
        satellites: numbers of the satellites to plan; None for all.
        tolerance: greatest angle in rad between a terminal and its link, from 1e-8 deg to 1 deg.
        slew: "shortest" for slews in the shortest time, "calm" to take longer where there is time.
        settings: scenario settings that differ from the defaults, such as ``{"search.max_expansions": 500}``;
            None for the defaults. Searches have no time limit.
        workers: who plans: None for this process, a number of processes, or an executor, such as
            ``get_executor()`` of a Dask client; satellites go out one by one.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Returns:
        The outcome of each satellite. Its table has the satellites asked for, not all those in the folder.

    Raises:
        ScenarioError: for a satellite number, tolerance, slew or setting that is not allowed.
        TypeError, ValueError: for a schedule, folder or workers of the wrong type.
        StudyFolderError: if the folder holds something else, such as another fleet, or is in use.
        RuntimeError: if workers die before they plan anything, or have another version of jaxplan.

    Example:
        >>> shell = jp.walker("53:1584/72/39", 550.0)
        >>> schedule = jp.link_schedule(shell, epoch="2026-06-20T09:30:00", duration_s=shell.period)
        >>> print(jp.plan_fleet(schedule, "fleet", satellites=range(0, 1584, 132), workers=2))
    """
    expect("schedule", schedule, LinkSchedule, "jp.link_schedule makes one of a shell")
    place = file_path("folder", folder)
    faults = out_of_range("tolerance", tolerance, "rad", *_TOLERANCE_RANGE)
    if slew not in SLEWS:
        faults.append(f"slew = {slew!r}: must be {' or '.join(map(repr, SLEWS))}")
    if faults:
        raise ScenarioError(faults, "the fleet")
    chosen = schedule.chosen(satellites)
    given = {} if settings is None else settings
    with_settings(_example_scenario(schedule.spacecraft), given)
    who = who_works(workers, None)
    make = partial(order_of, schedule, tolerance=float(tolerance), slew=slew, settings=given)
    store = FleetFolder(place, schedule.shell.total)
    with store.claimed(_describe_fleet(schedule, float(tolerance), slew, given)):
        rows = store.rows()
        left = _SatelliteQueue([number for number in chosen if number not in rows], make)
        try:
            _plan_satellites(store, rows, left, len(chosen), who, progress)
        except WorkersDiedError as error:
            raise RuntimeError(str(error)) from None
        finally:
            rows = {number: rows[number] for number in sorted(rows)}
            store.write_table(rows)
    return Fleet(
        title=_title(schedule.shell.name, str(schedule.epoch), schedule.until),
        satellites=len(chosen),
        folder=place,
        table=[rows[number] for number in sorted(chosen) if number in rows],
    )


def load_fleet(folder: str | os.PathLike[str]) -> Fleet:
    """Read the folder of a fleet, which may still be incomplete.

    Args:
        folder: the one that `plan_fleet` was given.

    Returns:
        The fleet, with the rows that are in the folder; its `satellites` counts the whole shell.

    Raises:
        TypeError: if `folder` is not a path.
        StudyFolderError: if the folder does not hold a fleet.
    """
    place = file_path("folder", folder)
    store, head = FleetFolder.of(place)
    return Fleet(
        title=_title(head["shell"], head["epoch"], head["until_s"]),
        satellites=store.total,
        folder=place,
        table=list(store.rows().values()),
    )


def _told_planned(numbers: list[int]) -> str:
    """Return text on which satellites are planned, the first and the last of many, to end a message."""
    if not numbers:
        return "nor is any other"
    told = list(map(str, numbers))
    if len(told) > _MOST_TOLD:
        told = [*told[: _MOST_TOLD - 1], "...", f"{told[-1]} ({len(numbers)} of them)"]
    return f"planned are {', '.join(told)}"


def _plan_satellites(
    store: FleetFolder,
    rows: dict[int, Row],
    left: "_SatelliteQueue",
    satellites: int,
    workers: Workers | None,
    progress: bool,
) -> None:
    """Plan the satellites that are left, write their files, and add their rows to `rows` in place.

    Ctrl-C ends it early: it returns normally, with the rows of the satellites that are done.
    """
    if not left:
        return
    with progress_bar(
        "fleet", "satellites", total=satellites, initial=satellites - len(left), shown=progress
    ) as bar:
        bar.step("workers begin, and may compile" if workers is not None else "")
        try:
            with closing(answers(left, workers, plan_order)) as found:
                for planned in found:
                    store.add(planned)
                    rows[planned.satellite] = planned.row
                    bar.step("")
                    bar.update()
        except KeyboardInterrupt:
            pass  # the rows so far are returned


class _SatelliteQueue:
    """The satellites that are left to be planned, handed out to `answers` one by one.

    Where a worker dies while several satellites are being planned, each of them becomes a *suspect*: it is
    planned again with no other running. A suspect whose worker dies `DEATHS` times is given up.
    """

    def __init__(self, numbers: Iterable[int], make: partial[Order]) -> None:
        self._unplanned, self._make_order = deque(numbers), make
        self._suspects: deque[Order] = deque()
        self._suspect_running = False  # whether what is under way is a suspect

    def __len__(self) -> int:
        return len(self._unplanned) + len(self._suspects)

    def take(self, under_way: int, most: int = 1) -> Order | None:
        """Remove and return the next order; None if none is left, or none may run beside those under way.

        Args:
            under_way: number of orders being planned now.
            most: not used, since satellites go out one by one.
        """
        if under_way and (self._suspects or self._suspect_running):
            return None
        self._suspect_running = bool(self._suspects)
        if self._suspects:
            return self._suspects.popleft()
        return self._make_order(self._unplanned.popleft()) if self._unplanned else None

    def learn(self, scenes: int, seconds: float) -> None:
        """Do nothing: satellites go out one by one, whatever time they take."""

    def suspect(self, chunks: Iterable[Order]) -> None:
        """Put back orders, one of which may have killed a worker, to be planned with nothing else running."""
        self._suspects.extend(chunks)

    def killed(self, chunk: Order) -> Iterator[Planned]:
        """Handle an order whose worker died while nothing else ran: put it back, or give it up.

        Yields:
            The answer with status "crashed", if this was its last attempt; nothing otherwise.
        """
        deaths = chunk.deaths + 1
        if deaths < DEATHS:
            self.suspect([replace(chunk, deaths=deaths)])
        else:
            yield given_up(chunk, f"its worker died, {deaths} times while it planned nothing else")


def _example_scenario(craft: Spacecraft) -> Scenario:
    """A scenario at rest with the given spacecraft, used to check settings and to describe the spacecraft."""
    still = GivenState(rotation_vector=np.zeros(3), joints=np.mean(craft.joint_ranges, axis=1))
    return Scenario(name="fleet", spacecraft=craft, start=still, goal=still)


def _title(shell: str, epoch: str, until: float) -> str:
    """The shell's name, the duration (s) and the epoch in one line."""
    return f"{shell}, {until:g} s from {epoch} on"


def _describe_fleet(
    schedule: LinkSchedule, tolerance: float, slew: str, settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Description of a fleet for its head, fit for JSON; equal descriptions mean equal plans."""
    shell = schedule.shell
    craft = json.dumps(scenario_to_dict(_example_scenario(schedule.spacecraft))["spacecraft"], sort_keys=True)
    links = hashlib.sha256(schedule.times.tobytes())
    links.update(schedule.topology.tobytes())
    return {
        "jaxplan": __version__,
        "shell": shell.name,
        "satellites": shell.total,
        "inclination_rad": shell.inclination,
        "epoch_angle_rad": shell.epoch_angle,
        "epoch": str(schedule.epoch),
        "until_s": schedule.until,
        "links": links.hexdigest(),
        "spacecraft": hashlib.sha256(craft.encode()).hexdigest(),
        "cones_rad": dict(schedule.cones),
        "tolerance_rad": tolerance,
        "slew": slew,
        "settings": dict(settings),
    }
