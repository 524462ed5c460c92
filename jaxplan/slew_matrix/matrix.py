"""The entry point `slew_times`: the pairs of goals as a study, and its rows as a matrix."""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jax.typing import ArrayLike

from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import JointBound, KeepIn, KeepOut
from jaxplan.runtime.arguments import file_path
from jaxplan.runtime.progress import progress_bar
from jaxplan.runtime.workers import Workers, one_thread
from jaxplan.slew_matrix.problem import SlewProblem, make_problem
from jaxplan.slew_matrix.result import NOT_ASKED, NOT_DONE, OK, SlewTimes
from jaxplan.study import run_study

MATRIX = "slew_times.npz"
"""Name of the file with the whole matrix in the folder of a study that is done."""


def slew_times(
    problem: Spacecraft | Scenario,
    goals: Mapping[str, Any] | Sequence[Any],
    *,
    keep_out: Sequence[KeepOut] = (),
    keep_in: Sequence[KeepIn] = (),
    joint_bounds: Sequence[JointBound] = (),
    departures: ArrayLike | None = None,
    pairs: ArrayLike | None = None,
    start: GivenState | None = None,
    free: bool = False,
    settings: Mapping[str, Any] | None = None,
    workers: Workers | None = None,
    out: str | os.PathLike[str] | None = None,
    chunk: int | None = None,
    progress: bool = True,
) -> SlewTimes:
    """Plan the slews between all goals, and return the matrix of the shortest times that are certified.

    A slew leaves the state of one goal and ends in that of another. The state of a `GivenState` is itself,
    with its rates. That of targets is found by step 1 from a reference, whatever goal comes before, so that
    slews can be put one after another: the state turned least from there, unless the targets name another
    criterion. Wishes (`Targets.prefer`) may settle the rest, such as an array toward the Sun. With targets
    that move a slew leaves the state in which they are followed at its departure, and ends, at their rates,
    in one that meets those of its goal then; to be put one after another these must settle the attitude,
    by targets and wishes of two devices.

    The times are those of certified plans of the duration "minimum": proved to keep all limits and zones,
    and the shortest that was found. `SlewTimes.bounds` has what no motion between two states is quicker than.

    Pairs are a study of `run_study`: planned in blocks of 16, resumed where a folder holds a part of them,
    the same whoever plans, and a pair whose planning kills its process costs itself alone.

    Args:
        problem: the spacecraft; or a scenario, whose spacecraft, zones, `robust`, settings and epoch count.
        goals: n of them, by name or in order: each a `GivenState`, `Targets`, or a dict of directions
            (3,), or paths of what moves, by names of devices.
        keep_out: zones that hold all the time, likewise the next two; of a spacecraft alone.
        keep_in: zones to stay in.
        joint_bounds: bounds of joint angles.
        departures: (k,) s, rising, at which slews depart, in the time of what moves: the matrix has an axis
            of them first then. None for the time 0 alone.
        pairs: (n, n) bool, or (k, n, n), which slews are planned; the others are "not asked". None for all.
        start: the reference of the states of targets; by default the scenario's start, or the identity with
            joints as near to zero as their ranges let them.
        free: whether slews go to any state that meets the targets of their goal, chosen for time, instead of
            its own state. It is what a slew takes at least; states do not fit together from slew to slew.
        settings: that differ from the scenario's, such as ``{"trajectory.first_guesses": 0}`` for half the
            time to plan, or ``{"trajectory.duration_s": "stretched"}``. The duration is "minimum" unless it
            is given here, and no search has a time limit.
        workers: who plans: None for this process, a number of processes, or an executor, see `run_study`.
        out: a folder where each chunk is safe once it is done; at last it holds the matrix, too.
        chunk: blocks of 16 pairs that are handed out together; by default as many as take some two seconds.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Returns:
        The matrix. Where a pair has no certified slew its time is infinite, and its status says why.

    Raises:
        TypeError: for what is none of what an argument may be.
        ScenarioError: (a ValueError) for values that a scenario file may not have, with every fault.
        ValueError: for zones beside those of a scenario, departures at which something is not known, pairs
            of a wrong shape, and a duration that is given.
        StudyFolderError: if the folder holds another problem, or something else, or is in use.
        RuntimeError: if workers die before they plan anything, or have another version of jaxplan.

    Example:
        >>> times = jp.slew_times(spacecraft, {"vela": {"telescope": vela}, "crab": {"telescope": crab}},
        ...                       keep_out=[sun], workers=2, out="slews")
        >>> times.times[0, 1], times.scenario("vela", "crab")
    """
    if out is not None:
        file_path("out", out)
    zones = {"keep_out": keep_out, "keep_in": keep_in, "joint_bounds": joint_bounds}
    asked = make_problem(
        problem, goals, zones=zones, departures=departures, start=start, free=free, settings=settings
    )
    wanted = _wanted(asked, pairs)
    with one_thread(), progress_bar("slew times: states of goals", shown=progress):
        made = _Matrix(asked, wanted)
    if made.scenarios:
        study = run_study(
            made.scenarios,
            planner=asked.scene.search.method,
            workers=workers,
            out=out,
            chunk=chunk,
            progress=progress,
        )
        for row in study.table:
            made.take(row)
    result = made.result()
    if out is not None and made.scenarios and result.complete:
        result.save(Path(out) / MATRIX)
    return result


def _wanted(problem: SlewProblem, pairs: ArrayLike | None) -> np.ndarray:
    """Which slews are asked for, (k, n, n) bool; raises a TypeError or ValueError for a wrong array."""
    count, when = len(problem.names), len(problem.times)
    shape = (when, count, count)
    if pairs is None:
        return np.ones(shape, bool)
    given = np.asarray(pairs)
    if given.dtype != bool:
        raise TypeError(f"pairs must be an array of True and False, not of {given.dtype}")
    if given.shape != shape[1:] and (problem.departures is None or given.shape != shape):
        also = "" if problem.departures is None else f" or {shape}"
        raise ValueError(f"pairs: must be of shape {shape[1:]}{also}, not {given.shape}")
    return np.broadcast_to(given, shape)


class _Matrix:
    """The entries of a matrix while they are filled in.

    Args:
        problem: the goals.
        wanted: (k, n, n) bool, which slews are planned.

    Attributes:
        scenarios: the planning problems that are left.
    """

    def __init__(self, problem: SlewProblem, wanted: np.ndarray) -> None:
        self._problem, shape = problem, wanted.shape
        self._times, self._angles = np.full(shape, np.inf), np.full(shape, np.inf)
        self._bounds = np.zeros(shape)
        self._certified = np.zeros(shape, bool)
        self._status = np.full(shape, NOT_DONE, object)
        self._messages = np.full(shape, "", object)
        self._status[~wanted] = NOT_ASKED
        self._places: list[tuple[int, int, int]] = []
        self.scenarios: list[Scenario] = []
        for place in self._off_diagonal(wanted):
            why = problem.unmet(*place)
            if why is None:
                self._places.append(place)
                self.scenarios.append(problem.scenario(*place))
            else:
                self._status[place], self._messages[place] = why

    def _off_diagonal(self, wanted: np.ndarray) -> Iterator[tuple[int, int, int]]:
        """Yield the places of pairs of two goals; fill in those of one, which need no slew."""
        for when, first, second in np.argwhere(wanted).tolist():
            place = when, first, second
            if first != second:
                yield place
                continue
            why = self._problem.stay(when, first)
            if why is None:
                self._times[place] = self._angles[place] = 0.0
                self._status[place], self._certified[place] = OK, True
            else:
                self._status[place], self._messages[place] = why

    def take(self, row: Mapping[str, Any]) -> None:
        """Fill in the entry of a row of the study."""
        place = self._places[row["scene"]]
        self._status[place], self._messages[place] = row["status"], row["message"] or ""
        self._certified[place] = bool(row["certified"]) and row["status"] == OK
        if self._certified[place]:
            self._times[place] = row["duration_s"]
        if row["duration_bound_s"] is not None:
            self._bounds[place] = row["duration_bound_s"]
        if row["slew_deg"] is not None:
            self._angles[place] = np.deg2rad(row["slew_deg"])

    def result(self) -> SlewTimes:
        """The matrix as it is filled in so far."""
        still = self._problem.departures is None

        def shaped(array: np.ndarray) -> np.ndarray:
            return array[0] if still else array

        return SlewTimes(
            name=self._problem.scene.name,
            names=self._problem.names,
            departures=self._problem.departures,
            times=shaped(self._times),
            bounds=shaped(self._bounds),
            angles=shaped(self._angles),
            certified=shaped(self._certified),
            status=shaped(self._status),
            messages=shaped(self._messages),
            problem=self._problem,
        )
