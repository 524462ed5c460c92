"""The entry point `slew_times`, which plans the pairs of goals as a study and makes a matrix of its rows."""

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

    A slew leaves the state of one goal and ends in that of another. A goal that is a `GivenState` is its own
    state, rates included. The state of `Targets` is found by step 1 (decomposition) from a reference state,
    whatever goal comes before, so that slews can be put one after another: it is the state that is turned
    least from the reference, unless the targets name another criterion. Wishes (`Targets.prefer`) may
    determine what the targets leave free, such as an array that turns toward the Sun. With targets that move,
    a slew leaves the state in which they are followed at its departure, and ends, at their rates, in a state
    that meets those of its goal at that time. To put such slews one after another, targets and wishes of two
    devices must determine the attitude.

    The times are those of certified plans of the duration "minimum": proved to keep all limits and zones,
    and the shortest that was found. `SlewTimes.bounds` has lower bounds of the time of any motion between the
    two states.

    The pairs are a study of `run_study`: planned in blocks of 16, resumed where a folder holds some of them,
    the same whatever the workers, and a pair whose planning kills its process loses only itself.

    Args:
        problem: the spacecraft; or a scenario, whose spacecraft, zones, `robust`, settings and epoch are
            used.
        goals: n goals, by name or in order: each a `GivenState`, `Targets`, or a dict of directions
            (3,), or paths of what moves, by names of devices.
        keep_out: keep-out zones; these and the next two are for a problem that is a spacecraft.
        keep_in: zones to stay in.
        joint_bounds: bounds of joint angles.
        departures: (k,) s, rising, when slews depart, in the time of what moves; the matrix then has a first
            axis of departures. None for time 0 only, without such an axis.
        pairs: (n, n) bool, or (k, n, n), which slews are planned; the others are "not asked". None for all.
        start: the reference from which states of targets are found, and in which wheels hold what they store;
            None for the scenario's start, or for the identity attitude with joints as near to zero as their
            ranges allow.
        free: whether slews go to any state that meets the targets of their goal, chosen for time, instead of
            the goal's own state. This gives the least time of a slew; but a slew then does not end in the
            state in which the next one begins.
        settings: scenario settings to change, such as ``{"trajectory.first_guesses": 0}`` for half the
            time to plan, or ``{"trajectory.duration_s": "stretched"}``. The duration is "minimum" unless it
            is given here, and no search has a time limit.
        workers: who plans: None for this process, a number of processes, or an executor, see `run_study`.
        out: a folder to which each chunk is written as soon as it is done, and at the end the matrix; None to
            keep results in memory.
        chunk: number of blocks, of 16 pairs each, that a worker gets at once; None for as many as take some
            two seconds.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Returns:
        The matrix. Where a pair has no certified slew its time is infinite, and its status says why.

    Raises:
        TypeError: for arguments of the wrong type.
        ScenarioError: (a ValueError) for values that a scenario file may not have, with every fault.
        ValueError: for zones given with a scenario, departures at which something is not known, pairs
            of a wrong shape, and a duration that is a number.
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
    wanted = _check_pairs(asked, pairs)
    with one_thread(), progress_bar("slew times: states of goals", shown=progress):
        made = _MatrixBuilder(asked, wanted)
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


def _check_pairs(problem: SlewProblem, pairs: ArrayLike | None) -> np.ndarray:
    """Check the argument `pairs` of `slew_times`; returns which slews are asked for, (k, n, n) bool.

    Raises:
        TypeError: if it is not an array of booleans.
        ValueError: if it has another shape than the matrix.
    """
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


class _MatrixBuilder:
    """The entries of a matrix of slew times while they are filled in.

    Entries from a goal to itself, and those of goals without a state, are filled in at once.

    Args:
        problem: the goals.
        wanted: (k, n, n) bool, which slews are asked for.

    Attributes:
        scenarios: planning problems of the other entries that are asked for.
    """

    def __init__(self, problem: SlewProblem, wanted: np.ndarray) -> None:
        self._problem, shape = problem, wanted.shape
        self._times, self._angles = np.full(shape, np.inf), np.full(shape, np.inf)
        self._bounds = np.zeros(shape)
        self._certified = np.zeros(shape, bool)
        self._status = np.full(shape, NOT_DONE, object)
        self._messages = np.full(shape, "", object)
        self._status[~wanted] = NOT_ASKED
        self._scenario_places: list[tuple[int, int, int]] = []
        self.scenarios: list[Scenario] = []
        for place in self._off_diagonal(wanted):
            why = problem.unmet(*place)
            if why is None:
                self._scenario_places.append(place)
                self.scenarios.append(problem.scenario(*place))
            else:
                self._status[place], self._messages[place] = why

    def _off_diagonal(self, wanted: np.ndarray) -> Iterator[tuple[int, int, int]]:
        """Yield the places (departure, first, second) of pairs of different goals that are asked for.

        Entries from a goal to itself, which need no slew, are filled in here.
        """
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
        """Fill in the entry that belongs to a row of the study's table."""
        place = self._scenario_places[row["scene"]]
        self._status[place], self._messages[place] = row["status"], row["message"] or ""
        self._certified[place] = bool(row["certified"]) and row["status"] == OK
        if self._certified[place]:
            self._times[place] = row["duration_s"]
        if row["duration_bound_s"] is not None:
            self._bounds[place] = row["duration_bound_s"]
        if row["slew_deg"] is not None:
            self._angles[place] = np.deg2rad(row["slew_deg"])

    def result(self) -> SlewTimes:
        """The matrix with the entries filled in so far; without given departures it has no axis for them."""
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
