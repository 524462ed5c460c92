"""The matrix of slew times: what a scheduler reads from it, how it prints, and how it is kept in a file.

Its axes are departures (if any are given), the goal that a slew leaves, and the goal that it goes to.
"""

import csv
import os
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario
from jaxplan.runtime.arguments import file_path, number
from jaxplan.runtime.display import Cells, shown
from jaxplan.runtime.files import replacing_file
from jaxplan.slew_matrix.problem import SlewProblem, Unmet
from jaxplan.study.result import QUANTILES, Printed

OK, NOT_ASKED, NOT_DONE = "OK", "not asked", "not done"
_COLUMNS = ("from", "to", "time_s", "bound_s", "angle_deg", "certified", "status", "message")
_MAX_PRINTED_GOALS = 10  # number of goals up to which a matrix is printed entry by entry
_LARGEST_FILE = 2**31  # bytes up to which a file is read
_ARRAY_KINDS = {"times": "f", "bounds": "f", "angles": "f", "certified": "b", "status": "U", "messages": "U"}
_KIND_TYPES: dict[str, Any] = {"f": float, "b": bool, "U": str}


@shown("goals", "planned", "statuses", heading="Slew times of {0.name}")
@dataclass(frozen=True, kw_only=True, eq=False)
class SlewTimes(Printed):
    """Certified shortest times of the slews between goals; `jaxplan.slew_times` makes it.

    For n goals arrays are (n, n), the goal that is left first; with k departures they are (k, n, n).

    Attributes:
        name: of the scene.
        names: (n,) names of the goals.
        departures: (k,) s; None where slews depart at time 0 only.
        times: s, of certified slews; infinite where there is none, zero from a goal to itself.
        bounds: s, lower bounds of the time of any motion between the two ends of the plan, zones ignored;
            zero where none is known. Where the goal was free, the end is the state that the plan chose.
        angles: rad, by which the platform turns from start to end; infinite where no end is known.
        certified: bool, whether the slew is planned and proved; from a goal to itself, whether its state
            keeps all limits and zones.
        status: names of `Status`; "crashed" where planning raised an error; "not asked"; or "not done"
            where planning was interrupted before.
        messages: why there is no slew, and what to change; empty where there is one.
        problem: what was planned; None if the matrix was read from a file.
    """

    name: str
    names: tuple[str, ...]
    departures: np.ndarray | None
    times: np.ndarray
    bounds: np.ndarray
    angles: np.ndarray
    certified: np.ndarray
    status: np.ndarray
    messages: np.ndarray
    problem: SlewProblem | None = None

    @property
    def goals(self) -> int:
        """Number of goals, n."""
        return len(self.names)

    @property
    def planned(self) -> int:
        """Number of pairs of different goals with a certified slew, over all departures."""
        return int(np.sum(self.certified) - np.sum(_diagonal(self.certified)))

    @property
    def statuses(self) -> dict[str, int]:
        """Number of pairs of different goals with each status, the most frequent first."""
        apart = Counter(map(str, self.status.ravel()))
        apart.subtract(map(str, _diagonal(self.status).ravel()))
        return {status: count for status, count in apart.most_common() if count}

    @property
    def complete(self) -> bool:
        """Whether every pair that was asked for is done; false only after Ctrl-C."""
        return not np.any(self.status == NOT_DONE)

    def ticks(self, step: float = 1.0) -> np.ndarray:
        """Slew times as integers for a scheduler: numbers of steps, rounded up so that the slew fits.

        Args:
            step: s, length of a step, in [1e-6, 1e6].

        Returns:
            int64 of the matrix's shape; -1 where there is no certified slew.

        Raises:
            ValueError: for a step out of its range.
        """
        seconds = number("step", step, "a number of seconds")
        if not 1e-6 <= seconds <= 1e6:
            raise ValueError(f"step = {seconds:g}: must lie in [1e-6, 1e6] s")
        there = np.isfinite(self.times)
        return np.where(there, np.ceil(np.where(there, self.times, 0.0) / seconds), -1).astype(np.int64)

    def scenario(self, first: str | int, second: str | int, departure: int = 0) -> Scenario:
        """The planning problem of a slew; `jaxplan.plan` makes the plan of it whose time is in the matrix.

        Args:
            first: the goal that it leaves, by name or index.
            second: the goal that it goes to, likewise.
            departure: index of the departure.

        Raises:
            ValueError: if there is no such goal or departure, both goals are the same, one of them has no
                state, or the matrix was read from a file.
        """
        problem, place = self._require_problem(), self._indices({"first": first, "second": second}, departure)
        when, here, there = place
        if here == there:
            raise ValueError(f"second = {second!r}: must be another goal than the one that is left")
        why = problem.unmet(when, here, there)
        if why is not None:
            raise ValueError(f"there is no slew to plan: {why.status}: {why.message}")
        return problem.scenario(when, here, there)

    def state(self, goal: str | int, departure: int = 0) -> GivenState | None:
        """The state in which slews leave a goal at a departure; None if the goal has none.

        Args:
            goal: by name or index.
            departure: index of the departure.

        Raises:
            ValueError: if there is no such goal or departure, or the matrix was read from a file.
        """
        when, place = self._indices({"goal": goal}, departure)
        state = self._require_problem().states[when][place]
        return None if isinstance(state, Unmet) else state

    def _require_problem(self) -> SlewProblem:
        """The problem; raises a ValueError if the matrix was read from a file, which does not hold it."""
        if self.problem is None:
            raise ValueError("a file of slew times holds no goals: jp.slew_times with its folder has them")
        return self.problem

    def _indices(self, goals: Mapping[str, str | int], departure: int) -> tuple[int, ...]:
        """Check a departure and goals; returns their indices, the departure's first.

        Args:
            goals: a goal's name or index, by the name of the argument it comes from.
            departure: index of the departure.

        Raises:
            ValueError: if there is no such departure or goal.
        """
        count = 1 if self.departures is None else len(self.departures)
        if isinstance(departure, bool) or departure not in range(count):
            raise ValueError(f"departure = {departure!r}: must be an integer in [0, {count - 1}]")
        places = []
        for name, goal in goals.items():
            if isinstance(goal, str) and goal in self.names:
                places.append(self.names.index(goal))
            elif isinstance(goal, int | np.integer) and type(goal) is not bool and goal in range(self.goals):
                places.append(int(goal))
            else:
                raise ValueError(
                    f"{name} = {goal!r}: must be one of {', '.join(self.names[:12])}, or its number"
                )
        return int(departure), *places

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield a row for each pair of different goals, in the units of files.

        A time or angle that is not known is None. With departures, a row begins with departure_s.
        """
        for place in np.ndindex(self.times.shape):
            *when, first, second = place
            if first == second:
                continue
            time, angle = float(self.times[place]), float(self.angles[place])
            departure = {} if self.departures is None else {"departure_s": float(self.departures[when[0]])}
            yield {
                **departure,
                "from": self.names[first],
                "to": self.names[second],
                "time_s": time if np.isfinite(time) else None,
                "bound_s": float(self.bounds[place]),
                "angle_deg": float(np.rad2deg(angle)) if np.isfinite(angle) else None,
                "certified": bool(self.certified[place]),
                "status": str(self.status[place]),
                "message": str(self.messages[place]),
            }

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write `rows` to a CSV file, as a whole or not at all; values that are not known are empty.

        Raises:
            TypeError: if `path` is not a path.
            OSError: if it cannot be written.
        """
        rows = list(self.rows())
        head = ["departure_s"] * (self.departures is not None) + list(_COLUMNS)
        with (
            replacing_file(file_path("path", path)) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            writer = csv.DictWriter(file, head, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write arrays and names to an NPZ file, as a whole or not at all; equal matrices make equal files.

        The problem is not written.

        Raises:
            TypeError: if `path` is not a path.
            OSError: if it cannot be written.
        """
        arrays: dict[str, Any] = {
            name: np.asarray(getattr(self, name), dtype=_KIND_TYPES[kind])
            for name, kind in _ARRAY_KINDS.items()
        }
        if self.departures is not None:
            arrays["departures"] = self.departures
        with replacing_file(file_path("path", path), ".npz") as temporary:
            np.savez_compressed(
                temporary, allow_pickle=False, name=np.array(self.name), names=np.array(self.names), **arrays
            )

    @property
    def title(self) -> str:
        """Title with the scene's name."""
        return f"Slew times of {self.name}"

    def lines(self) -> list[tuple[str, str]]:
        """Lines to print above the table, as (label, value)."""
        told = f"{self.goals}"
        if self.departures is not None:
            first, last = self.departures[[0, -1]]
            told += f", at {len(self.departures)} departures from {first:g} to {last:g} s"
        counts = ", ".join(f"{count} {name}" for name, count in self.statuses.items()) or "-"
        return [("goals", told), ("slews", counts)]

    def cells(self) -> Cells:
        """The table to print: a small matrix in seconds, or quantiles of times, bounds and angles."""
        if self.departures is None and self.goals <= _MAX_PRINTED_GOALS:
            rows = [
                [name, *(f"{time:.2f}" if np.isfinite(time) else "-" for time in own)]
                for name, own in zip(self.names, self.times, strict=True)
            ]
            return [["from, to (s)", *self.names], *rows]
        there = self.certified & ~np.eye(self.goals, dtype=bool)
        quantities = (
            ("time (s)", self.times[there]),
            ("bound (s)", self.bounds[there]),
            ("angle (deg)", np.rad2deg(self.angles[there])),
        )
        return [
            ["", "slews", *QUANTILES],
            *(
                [label, f"{len(own)}", *(f"{np.quantile(own, share):.4g}" for share in QUANTILES.values())]
                for label, own in quantities
                if len(own)
            ),
        ]


def load_slew_times(path: str | os.PathLike[str]) -> SlewTimes:
    """Read a matrix that `SlewTimes.save` wrote, or that `slew_times` wrote to its folder.

    Args:
        path: the NPZ file, or the folder.

    Returns:
        The matrix, without its problem.

    Raises:
        TypeError: if `path` is not a path.
        ValueError: if it is not such a file, or damaged.
        OSError: if it cannot be read.

    Example:
        >>> times = jp.load_slew_times("slews")
    """
    file = file_path("path", path)
    if file.is_dir():
        file = file / "slew_times.npz"
        if not file.exists():
            raise FileNotFoundError(
                f"{path}: holds no slew_times.npz, which jp.slew_times writes at its end; the same call goes "
                "on with a folder that it has begun"
            )
    if file.stat().st_size > _LARGEST_FILE:
        raise ValueError(f"{file}: too large, at most {_LARGEST_FILE} bytes are read")
    try:
        with file.open("rb") as opened, np.load(opened, allow_pickle=False) as held:
            known = {name: held[name] for name in held.files}
    except (ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile) as error:
        raise ValueError(f"{file}: no file of slew times ({error})") from error
    fault = _find_fault(known)
    if fault:
        raise ValueError(f"{file}: no file of slew times ({fault})")
    arrays = {name: known[name] for name in _ARRAY_KINDS}
    arrays |= {name: arrays[name].astype(object) for name in ("status", "messages")}
    return SlewTimes(
        name=str(known["name"]),
        names=tuple(map(str, known["names"])),
        departures=known.get("departures"),
        **arrays,
    )


def _diagonal(matrix: np.ndarray) -> np.ndarray:
    """The diagonal (..., n) of a matrix (..., n, n): the entries from each goal to itself."""
    return np.asarray(np.diagonal(matrix, axis1=-2, axis2=-1))


def _find_fault(known: dict[str, np.ndarray]) -> str:
    """Check the arrays of a file; returns a message on what is wrong, empty if nothing is."""
    for name, kind in {**_ARRAY_KINDS, "name": "U", "names": "U"}.items():
        if name not in known:
            return f"{name} is missing"
        if known[name].dtype.kind != kind:
            return f"{name} is of {known[name].dtype}"
    departures = known.get("departures")
    if departures is not None and (departures.dtype.kind != "f" or departures.ndim != 1):
        return "departures are no list of numbers"
    count = len(known["names"]) if known["names"].ndim == 1 else 0
    shape = (count, count) if departures is None else (len(departures), count, count)
    for name in _ARRAY_KINDS:
        if not count or known[name].shape != shape:
            return f"{name} is of shape {known[name].shape}"
    if any(np.any(np.isnan(known[name]) | (known[name] < 0)) for name in ("times", "bounds", "angles")):
        return "a time, bound or angle is negative or no number"
    return ""
