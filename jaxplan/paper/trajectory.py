"""Step 3 by the paper's method: durations and numbers of segments to try, and whether results keep limits.

The scheme itself is `segments`. It holds limits only at joins, where two segments meet, so the peaks over all
time are computed afterwards, and a trajectory that breaks a limit anywhere is no success. A path has m + 1
nodes, a spacecraft 2n joint angles. Fits, and what belongs to them, are in dictionaries by the number of the
query.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jaxplan.model.scenario import STRETCHED, TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.paper.derivative import PaperActiveSet, held_of
from jaxplan.paper.segments import (
    ChainRequest,
    PathNodes,
    charts_suffice,
    fewest_segments,
    is_full,
    plan_chains,
    shortest_duration,
    split,
)
from jaxplan.runtime.batching import Seconds
from jaxplan.trajectory import node_times
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.fit import (
    Fit,
    FitQuery,
    at_rest,
    checked,
    fit_each,
    needed_words,
    too_tight,
    within_limits,
)
from jaxplan.trajectory.node_times import FEWEST_NODES
from jaxplan.trajectory.outcome import full_on_the_way, within_longest
from jaxplan.trajectory.peaks import SAFETY, Peaks, all_peaks

_DEFAULT_SEGMENTS = 3
_SEGMENT_GROWTH = 1.5  # factor on the number of segments from one attempt to the next
_DURATION_FACTOR = 1.001  # factor beyond the time that the last curve requires, where that was too short
_MAX_DURATIONS = 12  # most durations that are tried in search of one that is long enough
_MAX_CALM_STRETCH = 2.5  # times the nominal duration; on nodes of the paper's cases a fit needs 1.5 to 2.1


def fit(queries: Sequence[FitQuery], seconds: Seconds | None = None) -> list[Fit]:
    """Fit trajectories through all nodes of paths.

    A number for ``settings.duration`` is kept. Where a program has no solution more segments are tried, up to
    one an interval; where the curve breaks a limit or leaves a joint's range, for as long as that helps.

    "stretched" fits once and without limits, at the nominal duration, in which the differences of the nodes
    just keep them, and scales the curve in time until its first limit binds, plus a millionth. The nominal
    duration is about half of the final one; since the weights act in seconds another choice would give
    another curve, but the final duration depends on it by a few per cent only. Scaling would change a rate at
    the start or end: with one, the fit is repeated at longer durations instead, until all limits are kept.

    There are three segments unless ``settings.segments`` asks for another number, and more where the counting
    rule or the reach of a chart needs them. A curve may also swing between its nodes, when they are uneven or
    leave its segments next to no freedom. So where a stretched one needs more than 2.5 times the nominal
    duration or leaves a joint's range, or its segments are full and their number was not asked for, more are
    tried and the quickest is taken.

    Args:
        queries: one for each fit; this method ignores their zones.
        seconds: accumulates the computation time of each fit, s, in place; None to measure nothing.

    Returns:
        The fits. A path without motion gives a trajectory at rest (`at_rest`), unless there is a rate at an
        end.

    Raises:
        ValueError: if settings, costs, fractions or rates make no sense; the message names which.
    """
    fits = fit_each(queries, _prepare, _Strategy(Seconds(len(queries)) if seconds is None else seconds).fits)
    return [within_longest(*one) for one in zip(fits, queries, strict=True)]


def _prepare(query: FitQuery) -> "Fit | tuple[PaperProblem, np.ndarray]":
    """Make the problem of a query and the index there of each given node; or the fit if nothing moves.

    Raises a ValueError, see `fit`.
    """
    node_fractions = query.node_fractions
    path, rates = checked(query)
    path, own = node_times.passed_nodes(path, at_speed=bool(np.any(rates)), every=node_fractions is not None)
    if len(path.attitudes) == 1:
        return at_rest(query, path, query.settings.order, 2, len(own))
    fractions = node_times.node_fractions(path.edge_costs) if node_fractions is None else node_fractions
    nodes = PathNodes(
        attitudes=path.attitudes,
        joints=path.joints,
        fractions=np.asarray(fractions, float),
        turns=node_times.edge_turns(path.attitudes),
        rates=rates,
    )
    problem = PaperProblem(
        nodes=nodes, spacecraft=query.spacecraft, settings=query.settings, moving=query.horizon > 0
    )
    return problem, own


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperProblem:
    """The problem that all attempts at a fit share.

    Attributes:
        nodes: of the path.
        spacecraft: its limits.
        settings: of step 3.
        moving: whether goal or zones move, so that they differ after another duration.
    """

    nodes: PathNodes
    spacecraft: Spacecraft
    settings: TrajectorySettings
    moving: bool

    @property
    def at_speed(self) -> bool:
        """Whether any rate at the start or the end is not zero."""
        return bool(np.any(self.nodes.rates))

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Limits of rates (rad/s) and accelerations (rad/s^2): of the platform (2, 3), of joints (2, 2n)."""
        craft = self.spacecraft
        platform = np.stack([np.full(3, limit) for limit in (craft.rate_limit, craft.acceleration_limit)])
        return platform, np.stack([craft.joint_rate_limits, craft.joint_acceleration_limits])

    @property
    def at_joins(self) -> tuple[np.ndarray, np.ndarray]:
        """`limits` reduced by a millionth, which programs keep at the joins."""
        platform, joints = self.limits
        return platform / SAFETY, joints / SAFETY

    @property
    def stretches(self) -> bool:
        """Whether a fit without limits is to be stretched to them: if asked for, and at rest at both ends."""
        return self.settings.duration == STRETCHED and not self.at_speed

    @property
    def nominal_duration(self) -> float:
        """Estimate in s of the shortest duration from the nodes, plus time to brake the rates at the ends."""
        rates, accelerations = np.hstack(self.limits)
        ends = np.sum(np.abs(self.nodes.rates), axis=0)
        moves = shortest_duration(self.nodes.moves, self.nodes.fractions, rates, accelerations)
        return float(moves + np.max(ends / accelerations))

    def segment_counts(self) -> Iterator[int]:
        """Yield the numbers of segments to try, from as few as wanted up to one an interval."""
        intervals, order = len(self.nodes.turns), self.settings.order
        count = max(self.settings.segments or _DEFAULT_SEGMENTS, fewest_segments(intervals, order))
        while count < intervals:
            if charts_suffice(self.nodes.turns, split(intervals, count, order)[1]):
                yield count
            count = max(count + 1, int(_SEGMENT_GROWTH * count))
        yield intervals

    def is_full(self, segments: int) -> bool:
        """Tell whether this many segments leave next to no freedom, and their number was not asked for."""
        own = self.settings
        return own.segments is None and is_full(len(self.nodes.turns), segments, own.order)


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperAttempt:
    """A trajectory with its peaks, and how it came about.

    Attributes:
        trajectory: the one planned, before its time is stretched.
        peaks: of the trajectory over all time.
        nodes: those that are passed.
        limits: those kept at the joins, as in `ChainRequest`; None for none.
    """

    trajectory: Trajectory
    peaks: Peaks
    nodes: PathNodes
    limits: tuple[np.ndarray, np.ndarray] | None

    def hold(self, nodes: int = FEWEST_NODES) -> PaperActiveSet:
        """Collect what derivatives of the fit hold fixed; nodes are padded to at least `nodes`."""
        return held_of(self.nodes, self.trajectory, self.limits, nodes)

    @property
    def kept(self) -> bool:
        """Whether all limits and joint ranges are kept."""
        return self.peaks.kept and self.peaks.in_range

    @property
    def calm(self) -> bool:
        """Whether it does not swing between nodes: peaks are near limits, and joints keep their ranges."""
        return self.peaks.stretch <= _MAX_CALM_STRETCH and self.peaks.in_range

    def better_than(self, other: "PaperAttempt | None") -> bool:
        """Whether it keeps joint ranges where the other does not or, if both or none do, needs less time.

        It is better than None.
        """
        if other is None or self.peaks.in_range != other.peaks.in_range:
            return other is None or self.peaks.in_range
        return self.peaks.stretch < other.peaks.stretch


class _Strategy:
    """Makes many fits, each with a number; trajectories needed at the same time are planned together.

    Attributes:
        seconds: accumulates the computation time of each fit's attempts, s.
    """

    def __init__(self, seconds: Seconds) -> None:
        self.seconds = seconds

    def fits(self, problems: dict[int, PaperProblem]) -> dict[int, Fit]:
        """Make the fits in the durations that the settings ask for."""
        stretched = {n: problem for n, problem in problems.items() if problem.stretches}
        timed = {n: problem for n, problem in problems.items() if n not in stretched}
        durations = {
            n: problem.nominal_duration
            if problem.settings.duration == STRETCHED
            else float(problem.settings.duration)
            for n, problem in timed.items()
        }
        at_speed = {n: problem for n, problem in timed.items() if problem.settings.duration == STRETCHED}
        needed = self._find_needed_durations(at_speed, durations)
        durations |= {n: own for n, own in needed.items() if own is not None}
        return self._fit_stretched(stretched) | self._fit_timed(timed, durations)

    def _fit_timed(self, problems: dict[int, PaperProblem], durations: dict[int, float]) -> dict[int, Fit]:
        """Make fits in given durations in s; one that breaks limits says which duration would do."""
        attempts = self._find_best_attempts(problems, durations)
        good = {n: own for n, own in attempts.items() if own is not None and own.peaks.kept}
        left = {n: problem for n, problem in problems.items() if n not in good}
        first = {
            n: durations[n]
            * (2 if (own := attempts[n]) is None else _DURATION_FACTOR * _finite_stretch(own.peaks.stretch))
            for n in left
        }
        needed = self._find_needed_durations(left, first)
        fits = {n: _make_success(own.trajectory, own) for n, own in good.items()}
        return fits | {n: _make_failure(left[n], durations[n], attempts[n], needed[n]) for n in left}

    def _find_best_attempts(
        self, problems: dict[int, PaperProblem], durations: dict[int, float]
    ) -> "dict[int, PaperAttempt | None]":
        """The attempts in given durations (s) with the fewest segments that keep limits, or else the best.

        More segments are tried for as long as they help; None where no program has a solution.
        """

        def enough(n: int, segments: int, own: PaperAttempt | None, best: PaperAttempt | None) -> bool:
            return own is not None and (own is not best or own.kept)

        return self._try_segment_counts(problems, durations, enough, limited=True)

    def _find_needed_durations(
        self, problems: dict[int, PaperProblem], durations: dict[int, float]
    ) -> dict[int, float | None]:
        """Durations (s), from given ones on, in which fits keep limits; None after `_MAX_DURATIONS` tries.

        Scaling a curve's time is not enough, since the fit in the longer time is another curve.
        """
        found: dict[int, float | None] = dict.fromkeys(problems)
        durations = {n: durations[n] for n in problems}
        for look in range(_MAX_DURATIONS):
            for n, own in self._find_best_attempts({n: problems[n] for n in durations}, durations).items():
                stretch = 2.0 if own is None else _finite_stretch(own.peaks.stretch)
                if own is not None and own.peaks.kept:
                    found[n] = durations.pop(n)
                else:  # in ever longer steps, in case the durations do not settle
                    durations[n] *= stretch * _DURATION_FACTOR ** (2**look)
        return found

    def _fit_stretched(self, problems: dict[int, PaperProblem]) -> dict[int, Fit]:
        """Make the quickest fits of the nominal durations without limits, scaled in time to the limits."""

        def enough(n: int, segments: int, own: PaperAttempt | None, best: PaperAttempt | None) -> bool:
            return best is not None and best.calm and not problems[n].is_full(segments)

        durations = {n: problem.nominal_duration for n, problem in problems.items()}
        best = self._try_segment_counts(problems, durations, enough, limited=False)
        message = "with any number of segments a quadratic program has no solution: change trajectory.order"
        none = Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
        fits = dict.fromkeys(best, none)
        for n, own in best.items():
            if own is None:
                continue
            if np.isinf(own.peaks.stretch):  # wheels are full, and as full in a slower motion
                fits[n] = _make_failure(problems[n], durations[n], own, None)
            else:
                fits[n] = _make_success(own.trajectory.scaled(own.peaks.stretch * SAFETY), own)
        return fits

    def _try_segment_counts(
        self,
        problems: dict[int, PaperProblem],
        durations: dict[int, float],
        enough: "Callable[[int, int, PaperAttempt | None, PaperAttempt | None], bool]",
        *,
        limited: bool,
    ) -> "dict[int, PaperAttempt | None]":
        """Make attempts with more and more segments, and return the best of each fit, None if there is none.

        Args:
            problems: what is fitted.
            durations: s, of the fits.
            enough: (number of the fit, number of segments, attempt, best attempt) -> whether to stop.
            limited: whether limits are kept at the joins.
        """
        best: dict[int, PaperAttempt | None] = dict.fromkeys(problems)
        counts = {n: problem.segment_counts() for n, problem in problems.items()}
        while tries := {n: count for n, own in counts.items() if (count := next(own, None)) is not None}:
            counts = {n: counts[n] for n in tries}
            for n, own in self._attempt(problems, durations, tries, limited=limited).items():
                if own is not None and own.better_than(best[n]):
                    best[n] = own
                if enough(n, tries[n], own, best[n]):
                    del counts[n]
        return best

    def _attempt(
        self,
        problems: dict[int, PaperProblem],
        durations: dict[int, float],
        counts: dict[int, int],
        *,
        limited: bool,
    ) -> "dict[int, PaperAttempt | None]":
        """Plan trajectories in `counts` segments; None where one fails; see `_try_segment_counts`."""
        requests = {
            n: ChainRequest(
                nodes=problems[n].nodes,
                duration=durations[n],
                segments=count,
                settings=problems[n].settings,
                limits=problems[n].at_joins if limited else None,
            )
            for n, count in counts.items()
        }
        with self.seconds.shared(list(counts)):
            planned = dict(zip(counts, plan_chains(list(requests.values())), strict=True))
            curves = {n: curve for n, curve in planned.items() if curve is not None}
            peaks = all_peaks([(curve, problems[n].spacecraft) for n, curve in curves.items()])
        found: dict[int, PaperAttempt | None] = dict.fromkeys(counts)
        for (n, curve), own in zip(curves.items(), peaks, strict=True):
            if own.sound:
                request = requests[n]
                found[n] = PaperAttempt(
                    trajectory=curve, peaks=own, nodes=request.nodes, limits=request.limits
                )
        return found


def _finite_stretch(stretch: float) -> float:
    """Return a factor on time to try: `stretch` itself, or 2 where it is not finite."""
    return stretch if np.isfinite(stretch) else 2.0


def _make_success(trajectory: Trajectory, attempt: PaperAttempt) -> Fit:
    """Make the fit, OK, of a trajectory that keeps all limits, which came from an attempt."""
    message = within_limits(trajectory, attempt.peaks)
    return Fit(trajectory=trajectory, status=Status.OK, message=message, origin=attempt)


def _make_failure(
    problem: PaperProblem, duration: float, attempt: PaperAttempt | None, needed: float | None
) -> Fit:
    """Make the fit of a problem that could not be solved within its limits, with status and message.

    It is INFEASIBLE if no quadratic program had a solution, and otherwise mostly LIMITS_TOO_TIGHT with the
    trajectory that came nearest; `full_on_the_way` reports wheels that are full at any duration.

    Args:
        problem: the path, spacecraft and settings.
        duration: s, that was asked for.
        attempt: the one nearest to the limits; None if no program had a solution.
        needed: s, a duration in which all limits are kept; None if none was found.
    """
    # "stretched" cannot be recommended with rates at the ends, or where something moves.
    enough = (
        needed_words(needed, moving=problem.moving, scalable=not (problem.at_speed or problem.moving))
        if needed
        else None
    )
    if attempt is None:
        advice = f"; {enough}" if enough else ": raise trajectory.duration_s or trajectory.segments"
        message = f"with any number of segments a quadratic program has no solution in {duration:g} s{advice}"
        return Fit(trajectory=None, status=Status.INFEASIBLE, message=message, needed_duration=needed)
    if needed is None and np.isinf(attempt.peaks.stretch):
        return full_on_the_way(attempt.trajectory, problem.spacecraft)
    else_try = "raise trajectory.segments, or lower the rates at start and end"
    return Fit(
        trajectory=attempt.trajectory,
        status=Status.LIMITS_TOO_TIGHT,
        message=too_tight(duration, attempt.peaks, enough, else_try),
        needed_duration=needed,
    )
