"""Attempts at curves, each with one spline on given breaks, and the `Ladder` of attempts of one fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jaxplan.trajectory import sqp
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.motion import TUBE
from jaxplan.trajectory.peaks import Peaks, all_peaks
from jaxplan.trajectory.problem import DiscreteProblem, FitProblem, Mesh, Timing, discretise
from jaxplan.trajectory.schedule import TrapezoidalProfile
from jaxplan.trajectory.splines import SMOOTHNESS
from jaxplan.trajectory.sqp import InitialGuess, SQPSolution

_TUBE_BROKEN = 1e-6  # rad beyond the tube, up to which nodes count as passed
_DEEP = float(np.deg2rad(0.3))  # rad; a zone broken by more is not so for want of intervals
_ROUNDING = 1e-9  # rad of a margin that is rounding alone
_KEPT_MARGIN = 0.3  # of the wanted margins, which a sound curve has
_MENDED = 1e-3  # of a limit; a first curve that breaks it by more is not improved in a given time
_NEARLY = 1.01  # on time; a curve that keeps limits with so much more of it is nearly there
_HOPELESS = 1.05  # on time; a curve that needs more of it is not mended by more intervals
_WIDER = 3.0  # times the tube's radius, before there is none


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempt:
    """A curve that was fitted, with its peaks: from them and its margins follows what it breaks.

    Attributes:
        discrete: the problem that was solved.
        solution: the curve that was found.
        trajectory: of the curve.
        peaks: over all time.
    """

    discrete: DiscreteProblem
    solution: SQPSolution
    trajectory: Trajectory
    peaks: Peaks

    @property
    def problem(self) -> FitProblem:
        """What is fitted."""
        return self.discrete.problem

    @property
    def radius(self) -> float:
        """Radius of the tube that was tried, rad."""
        return self.discrete.mesh.radius

    @cached_property
    def clear(self) -> bool:
        """Whether zones are kept at the places, with some of the clearance."""
        return bool(np.all(self.solution.margins >= _KEPT_MARGIN * self.problem.wanted))

    @cached_property
    def breach(self) -> tuple[str, float] | None:
        """What breaks a zone the most, and by how much (rad); None where nothing does.

        Axes of the body go by the name of the body, what terminals carry by theirs.
        """
        margins = self.solution.margins
        if np.all(margins >= -_ROUNDING):
            return None
        _, sight, _ = np.unravel_index(np.argmin(margins), margins.shape)
        names, cones = self.problem.spacecraft.device_names, self.problem.cones
        carriers = [names[terminal] for terminal in cones.carrier]
        return (*names, *["the body"] * len(cones.body), *carriers)[sight], -float(np.min(margins))

    @property
    def in_tube(self) -> bool:
        """Whether nodes are passed within the tube that was tried."""
        return bool(self.solution.violations[TUBE] <= _TUBE_BROKEN)

    @property
    def sound(self) -> bool:
        """Whether nothing is broken but perhaps limits of rates and loads."""
        return self.clear and self.peaks.in_range and self.in_tube

    @property
    def kept(self) -> bool:
        """Whether all limits are kept."""
        return self.peaks.stretch <= 1 and self.peaks.in_range

    @property
    def needed(self) -> float:
        """Duration to which its time is to be stretched, s."""
        return self.trajectory.duration * self.peaks.stretch

    @property
    def too_deep(self) -> bool:
        """Whether a zone is broken so deep that it is not for want of intervals."""
        return self.breach is not None and self.breach[1] > _DEEP

    @property
    def merit(self) -> tuple[bool, bool, bool, float]:
        """Key by which attempts are compared: the larger, the better."""
        stretch = self.peaks.stretch
        inside, nearly = self.clear and self.peaks.in_range, stretch <= _NEARLY
        return inside, nearly, self.in_tube, -stretch

    @property
    def pace(self) -> tuple[bool, float]:
        """Key by which shortest motions are compared: the larger, the better."""
        return self.sound, -self.needed


def first_curve(
    problem: FitProblem,
    mesh: Mesh,
    duration: float,
    timing: Timing,
    *,
    tighter: float = 0.0,
    coefficients: np.ndarray | None = None,
) -> InitialGuess | None:
    """Where an attempt begins; None if the nodes leave every chart.

    Args:
        problem: what is fitted.
        mesh: breaks of the spline, times of the nodes, and the tube about them.
        duration: s, given or to begin with.
        timing: of the curve.
        tighter: share of the limits on the platform's loads that is left.
        coefficients: (n, A) of the curve to begin with; None for the one nearest to the path.
    """
    discrete = discretise(problem, mesh, timing, share=1 - tighter)
    if discrete is None:
        return None
    begin = discrete.nearest(duration) if coefficients is None else coefficients
    return InitialGuess(discrete=discrete, coefficients=begin, duration=duration)


def make_attempts(begins: Sequence[InitialGuess | None]) -> list[Attempt | None]:
    """Attempts from first curves; None of one that is None, or whose numbers overflow."""
    given = [begin for begin in begins if begin is not None]
    made = iter(finished([(own.discrete, found) for own, found in zip(given, _improved(given), strict=True)]))
    return [None if begin is None else next(made) for begin in begins]


def finished(made: Sequence[tuple[DiscreteProblem, SQPSolution]]) -> list[Attempt | None]:
    """Attempts with the curves of solutions; None where numbers overflow."""
    curves = {
        number: _trajectory(discrete, solution)
        for number, (discrete, solution) in enumerate(made)
        if solution.duration > 0 and np.all(np.isfinite(solution.coefficients)) and solution.finite
    }
    peaks = all_peaks([(curve, made[number][0].problem.spacecraft) for number, curve in curves.items()])
    attempts = {
        number: Attempt(discrete=made[number][0], solution=made[number][1], trajectory=curve, peaks=own)
        for (number, curve), own in zip(curves.items(), peaks, strict=True)
        if np.isfinite(own.stretch)
    }
    return [attempts.get(number) for number in range(len(made))]


def _improved(begins: Sequence[InitialGuess]) -> list[SQPSolution]:
    """Improve first curves to the best ones near them.

    In a given time one that is far too quick is left as it is at first: from there a program leads nowhere.
    So one is made that is slow enough, and that is improved.
    """
    first = [
        begin
        if begin.discrete.free_time or begin.discrete.problem.at_speed
        else replace(begin, max_violation=0.0 if begin.discrete.limited else _MENDED)
        for begin in begins
    ]
    solutions = sqp.improve(first)
    hasty = [
        number
        for number, begin in enumerate(first)
        if begin.discrete.limited and solutions[number].steps == 0
    ]
    if not hasty:
        return solutions
    freed = [replace(first[number].discrete, timing="shortest") for number in hasty]
    slower = sqp.improve(
        [
            replace(own, discrete=discrete, target_duration=own.duration, max_violation=np.inf)
            for discrete, own in zip(freed, (first[number] for number in hasty), strict=True)
        ]
    )
    slow = [
        replace(first[number], coefficients=solution.coefficients, max_violation=_MENDED)
        for number, solution in zip(hasty, slower, strict=True)
    ]
    for number, solution in zip(hasty, sqp.improve(slow), strict=True):
        solutions[number] = solution
    return solutions


def _trajectory(discrete: DiscreteProblem, solution: SQPSolution) -> Trajectory:
    """The trajectory that a solution stands for."""
    basis, chart, duration = discrete.space.basis, discrete.chart, solution.duration
    pieces = basis.pieces(solution.coefficients)
    count = len(pieces)
    breaks = basis.breaks * duration
    return Trajectory(
        breaks=breaks,
        chart_attitude=np.repeat(chart.attitude[None], count, axis=0),
        chart_start=np.zeros(count),
        chart_rate=np.repeat(chart.turn[None] / duration, count, axis=0),
        coefficients=np.ascontiguousarray(pieces[:, :, :3]),
        joint_breaks=breaks,
        joint_coefficients=np.ascontiguousarray(pieces[:, :, 3:]),
        node_times=duration * discrete.mesh.places,
        smoothness=SMOOTHNESS,
        method="global",
    )


@dataclass(kw_only=True, eq=False)
class Ladder:
    """One fit's attempts, one after the other, up to the first that is good enough.

    On each rung the limits are taken a little tighter where a curve breaks them by next to nothing, which
    happens between the places. After an attempt without hope more intervals are not tried.

    Attributes:
        problem: what is fitted.
        profile: along the path.
        rungs: factors on the number of intervals, and radii of the tube (rad), of the attempts ahead.
        duration: s, given or to begin with.
        timing: of the curves.
        graded: whether breaks lie close about the flanks.
        tighter: shares of the limits that are left, first and then.
        best: of the attempts so far; None before the first, and beyond every chart.
    """

    problem: FitProblem
    profile: TrapezoidalProfile
    rungs: list[tuple[int, float]]
    duration: float
    timing: Timing
    graded: bool = True
    tighter: Sequence[float] = (0.0,)
    best: Attempt | None = None
    _here: Attempt | None = None  # the best one on this rung
    _tightened: int = 0  # how often limits were taken tighter on this rung

    def first_curve(self) -> InitialGuess | None:
        """Where the next attempt begins; None if the nodes leave every chart."""
        if self._here is None:
            finer, radius = self.rungs[0]
            mesh = self.problem.mesh(self.profile, radius, finer, graded=self.graded)
        else:
            mesh = self._here.discrete.mesh
        tighter = self.tighter[self._tightened]
        return first_curve(self.problem, mesh, self.duration, self.timing, tighter=tighter)

    def accept(self, made: Attempt | None) -> None:
        """Go on with the attempt that was made."""
        if made is not None:
            if self._here is None or made.merit > self._here.merit:
                self._here = made
            nearly = 1 < made.peaks.stretch <= 1 + self.tighter[self._tightened]
            if nearly and self._tightened + 1 < len(self.tighter):
                self._tightened += 1
                return
        last, self._here, self._tightened = self._here, None, 0
        del self.rungs[0]
        if last is None:
            self.rungs.clear()
            return
        if self.best is None or last.merit > self.best.merit:
            self.best = last
        timed = self.timing == "given"
        if last.sound and (last.kept or not timed):
            self.rungs.clear()
        stuck = last.peaks.stretch > 1 and last.solution.steps == 0  # its first curve could not be mended
        if last.too_deep or (timed and (stuck or last.peaks.stretch > _HOPELESS)):
            while self.rungs and self.rungs[0][0] > 1:
                del self.rungs[0]


def rungs(radius: float, *, in_time: bool = True) -> list[tuple[int, float]]:
    """The rungs of a ladder: factors on the number of intervals and radii of the tube, in their order.

    Args:
        radius: rad, asked for.
        in_time: whether there is time enough to go along the nodes. Without it more intervals are not tried
            either: the shortest motion, which is looked for then, is found sooner.
    """
    along_nodes = radius == 0 or (in_time and radius < np.inf)
    wider = [(1, _WIDER * radius)] if 0 < radius < np.inf and in_time else []
    free = [(1, np.inf), (2, np.inf)][: 2 if in_time else 1] if radius > 0 else []
    return [*([(1, radius), (2, radius)] if along_nodes else []), *wider, *free]
