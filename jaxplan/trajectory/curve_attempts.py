"""Attempts at the curve of a fit, each one spline on given breaks, and the `Ladder` that orders them.

An attempt is *sound* if it keeps zones, joint ranges and its tube, and if its limits are kept or slowing down
would keep them. It is *kept* if all limits and joint ranges are kept as it is. A *rung* of a ladder is a
factor on the number of intervals and a radius of the tube.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jaxplan.trajectory import sqp
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.discretisation import DiscreteProblem, Timing, discretise
from jaxplan.trajectory.motion import TUBE
from jaxplan.trajectory.node_times import TrapezoidalProfile
from jaxplan.trajectory.peaks import Peaks, all_peaks, peaks
from jaxplan.trajectory.problem import FitProblem, Mesh
from jaxplan.trajectory.splines import SMOOTHNESS
from jaxplan.trajectory.sqp import InitialGuess, SQPSolution

_TUBE_TOLERANCE = 1e-6  # rad outside the tube, up to which nodes still count as passed
_DEEP_BREACH = float(np.deg2rad(0.3))  # rad; if a zone is broken by more, more intervals do not help
_MARGIN_ROUNDING = 1e-9  # rad; a negative margin that is not larger is due to rounding alone
_MIN_MARGIN_SHARE = 0.3  # fraction of the wanted margins that a sound curve has at least
_MAX_FIRST_VIOLATION = 1e-3  # of a limit; a first curve that breaks it by more is not improved in given time
_NEARLY_KEPT_STRETCH = 1.01  # factor on time; a curve that keeps the limits with it nearly keeps them
_HOPELESS_STRETCH = 1.05  # factor on time; a curve that needs more is not tried again with more intervals
_WIDER_TUBE_FACTOR = 3.0  # factor on the tube's radius that is tried before the tube is dropped


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempt:
    """A curve that was fitted, with its peaks and margins, which tell which limits and zones it breaks.

    Attributes:
        discrete: the problem that was solved.
        solution: the curve that was found.
        trajectory: the same curve as a trajectory.
        peaks: of the trajectory over all time.
    """

    discrete: DiscreteProblem
    solution: SQPSolution
    trajectory: Trajectory
    peaks: Peaks

    @property
    def problem(self) -> FitProblem:
        """The problem of which `discrete` is a discretisation."""
        return self.discrete.problem

    @property
    def duration(self) -> float:
        """Duration of the trajectory in s."""
        return self.trajectory.duration

    @property
    def radius(self) -> float:
        """Radius in rad of the tube that was tried; 0 for nodes passed exactly, inf for no tube."""
        return self.discrete.mesh.radius

    @cached_property
    def clear(self) -> bool:
        """Whether zones are kept at all places, by at least a part of the wanted margins."""
        return bool(np.all(self.solution.margins >= _MIN_MARGIN_SHARE * self.problem.wanted))

    @cached_property
    def breach(self) -> tuple[str, float] | None:
        """Name of the device that breaks a zone the most, and by how much in rad; None where none does.

        An axis of the body counts as "the body", a vector that a terminal carries as that terminal.
        """
        margins = self.solution.margins
        if np.all(margins >= -_MARGIN_ROUNDING):
            return None
        _, sight, _ = np.unravel_index(np.argmin(margins), margins.shape)
        names, cones = self.problem.spacecraft.device_names, self.problem.cones
        carriers = [names[terminal] for terminal in cones.carrier]
        return (*names, *["the body"] * len(cones.body), *carriers)[sight], -float(np.min(margins))

    @property
    def in_tube(self) -> bool:
        """Whether nodes are passed within the tube that was tried."""
        return bool(self.solution.violations[TUBE] <= _TUBE_TOLERANCE)

    @property
    def may_leave_tube(self) -> bool:
        """Whether the motion was kept in a tube about the nodes that the settings do not ask for."""
        in_tube = np.isfinite(self.radius) and np.isfinite(self.problem.radius)
        return bool(in_tube) and self.problem.settings.node_tube is None

    @property
    def sound(self) -> bool:
        """Whether zones, joint ranges and the tube are kept, and limits are kept at least if slowed down."""
        return self.clear and self.peaks.in_range and self.in_tube and self.possible

    @property
    def possible(self) -> bool:
        """Whether all limits of rates and loads are kept, or would be in some longer time."""
        return self.peaks.kept or bool(np.isfinite(self.peaks.stretch))

    @property
    def kept(self) -> bool:
        """Whether all limits of rates, loads and joint ranges are kept."""
        return self.peaks.kept and self.peaks.in_range

    @property
    def good(self) -> bool:
        """Whether the attempt is sound, and its motion keeps all limits without being slowed down."""
        return self.sound and self.kept

    @property
    def needed(self) -> float:
        """Duration in s from which on the same motion, uniformly scaled in time, keeps all limits.

        It is the motion's own duration where slowing down does not help.
        """
        stretch = self.peaks.stretch
        return self.trajectory.duration * (stretch if np.isfinite(stretch) else 1.0)

    def scaled(self, duration: float) -> "Attempt":
        """Return the attempt with its motion scaled in time to another duration in s."""
        curve = self.trajectory.scaled(duration / self.trajectory.duration)
        for breaks in (curve.breaks, curve.joint_breaks):  # `scaled` made them, so they may be written to
            breaks[-1] = duration  # exactly, without rounding
        return replace(self, trajectory=curve, peaks=peaks(curve, self.problem.spacecraft))

    @property
    def too_deep(self) -> bool:
        """Whether a zone is broken so deeply that more intervals would not mend it."""
        return self.breach is not None and self.breach[1] > _DEEP_BREACH

    @property
    def merit(self) -> tuple[bool, bool, bool, float]:
        """Sort key by which attempts on a ladder are compared; the larger, the better.

        It prefers zones and ranges kept, then limits nearly kept, then the tube kept, then a smaller stretch.
        """
        stretch = min(self.peaks.stretch, 1.0) if self.peaks.kept else self.peaks.stretch
        inside, nearly = self.clear and self.peaks.in_range, stretch <= _NEARLY_KEPT_STRETCH
        return inside, nearly, self.in_tube, -stretch

    @property
    def pace(self) -> tuple[bool, float]:
        """Sort key by which shortest motions are compared: soundness, then speed; the larger, the better."""
        return self.sound, -self.needed


Attempts = dict[int, Attempt | None]
"""Attempts by the number of their fit; None beyond every chart."""


def quicker(others: Attempts, attempts: Attempts) -> Attempts:
    """Return those of `others` that are better than the attempt of the same number among `attempts`.

    They are sound, and once their time is scaled until all limits are just kept they take less time, or the
    other attempt is not sound. A number is left out where either of the two is None.
    """

    def is_quicker(other: Attempt | None, own: Attempt | None) -> bool:
        if other is None or own is None or not other.sound:
            return False
        return not own.sound or other.needed < own.needed

    return {n: other for n, other in others.items() if is_quicker(other, attempts[n])}


def first_curve(
    problem: FitProblem,
    mesh: Mesh,
    duration: float,
    timing: Timing,
    *,
    tighter: float = 0.0,
    coefficients: np.ndarray | None = None,
) -> InitialGuess | None:
    """Make the curve from which an attempt begins; None if the nodes leave every chart.

    Args:
        problem: what is fitted.
        mesh: breaks of the spline, places of the nodes, and the tube about them.
        duration: s, given or to begin with, depending on `timing`.
        timing: how the duration of the curve is determined.
        tighter: fraction of the limits on the platform's loads that the curve is to leave unused.
        coefficients: (n, A) of the curve to begin with; None for the one nearest to the path.
    """
    discrete = discretise(problem, mesh, timing, share=1 - tighter)
    if discrete is None:
        return None
    begin = discrete.nearest(duration) if coefficients is None else coefficients
    return InitialGuess(discrete=discrete, coefficients=begin, duration=duration)


def make_attempts(begins: Sequence[InitialGuess | None]) -> list[Attempt | None]:
    """Improve first curves, all together, to attempts; None where the curve is None or numbers overflow."""
    given = [begin for begin in begins if begin is not None]
    made = iter(
        finished([(own.discrete, found) for own, found in zip(given, _improve_guesses(given), strict=True)])
    )
    return [None if begin is None else next(made) for begin in begins]


def finished(made: Sequence[tuple[DiscreteProblem, SQPSolution]]) -> list[Attempt | None]:
    """Make attempts from problems with their solutions; None where numbers overflow."""
    curves = {
        number: _to_trajectory(discrete, solution)
        for number, (discrete, solution) in enumerate(made)
        if solution.duration > 0 and np.all(np.isfinite(solution.coefficients)) and solution.finite
    }
    found = all_peaks([(curve, made[number][0].problem.spacecraft) for number, curve in curves.items()])
    attempts = {
        number: Attempt(discrete=made[number][0], solution=made[number][1], trajectory=curve, peaks=own)
        for (number, curve), own in zip(curves.items(), found, strict=True)
        if own.sound
    }
    return [attempts.get(number) for number in range(len(made))]


def _improve_guesses(begins: Sequence[InitialGuess]) -> list[SQPSolution]:
    """Improve first curves to the best ones near them, all together.

    In a given duration a curve that breaks limits by far is not improved, since steps from there lead
    nowhere. Instead a slower one of free duration is found first, which is then improved in the duration
    given.
    """
    first = [
        begin
        if begin.discrete.free_time or begin.discrete.problem.at_speed
        else replace(begin, max_violation=0.0 if begin.discrete.limited else _MAX_FIRST_VIOLATION)
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
    freed = [replace(first[number].discrete, timing="shortest", freed=True) for number in hasty]
    slower = sqp.improve(
        [
            replace(own, discrete=discrete, target_duration=own.duration, max_violation=np.inf)
            for discrete, own in zip(freed, (first[number] for number in hasty), strict=True)
        ]
    )
    slow = [
        replace(first[number], coefficients=solution.coefficients, max_violation=_MAX_FIRST_VIOLATION)
        for number, solution in zip(hasty, slower, strict=True)
    ]
    for number, solution in zip(hasty, sqp.improve(slow), strict=True):
        solutions[number] = solution
    return solutions


def _to_trajectory(discrete: DiscreteProblem, solution: SQPSolution) -> Trajectory:
    """Convert a solution's curve to a trajectory."""
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
    """The attempts at one fit, one after the other, up to the first that is good enough.

    A rung is a number of intervals and a radius of the tube. An attempt that breaks limits by next to
    nothing, as may happen between places, is repeated on its rung with slightly tighter limits. After an
    attempt that is hopeless, rungs with more intervals are skipped.

    Attributes:
        problem: what is fitted.
        profile: the pace along the path.
        rungs: factors on the number of intervals, and radii of the tube (rad), of the present rung and those
            ahead; empty at the end.
        duration: s, given or to begin with.
        timing: how the duration of the curves is determined.
        graded: whether breaks lie close together near the flanks of the pace.
        tighter: fractions of the limits that are left unused, tried in this order on each rung.
        best: the best attempt of the rungs done; None if there is none, as beyond every chart.
    """

    problem: FitProblem
    profile: TrapezoidalProfile
    rungs: list[tuple[int, float]]
    duration: float
    timing: Timing
    graded: bool = True
    tighter: Sequence[float] = (0.0,)
    best: Attempt | None = None
    _rung_best: Attempt | None = None  # the best one on this rung
    _tightening_count: int = 0  # how often limits were taken tighter on this rung

    def first_curve(self) -> InitialGuess | None:
        """Make the curve from which the next attempt begins; None if the nodes leave every chart."""
        if self._rung_best is None:
            finer, radius = self.rungs[0]
            mesh = self.problem.mesh(self.profile, radius, finer, graded=self.graded)
        else:
            mesh = self._rung_best.discrete.mesh
        tighter = self.tighter[self._tightening_count]
        return first_curve(self.problem, mesh, self.duration, self.timing, tighter=tighter)

    def accept(self, made: Attempt | None) -> None:
        """Take in the attempt made from `first_curve`, None if there is none, and choose the next rung.

        No rungs are left once an attempt is good enough.
        """
        if made is not None:
            if self._rung_best is None or made.merit > self._rung_best.merit:
                self._rung_best = made
            nearly = 1 < made.peaks.stretch <= 1 + self.tighter[self._tightening_count]
            if nearly and self._tightening_count + 1 < len(self.tighter):
                self._tightening_count += 1
                return
        last, self._rung_best, self._tightening_count = self._rung_best, None, 0
        del self.rungs[0]
        if last is None:
            self.rungs.clear()
            return
        if self.best is None or last.merit > self.best.merit:
            self.best = last
        timed = self.timing == "given"
        if last.sound and (last.kept or not timed):
            self.rungs.clear()
        stuck = not last.peaks.kept and last.solution.steps == 0  # its first curve could not be mended
        if last.too_deep or (timed and (stuck or last.peaks.stretch > _HOPELESS_STRETCH)):
            while self.rungs and self.rungs[0][0] > 1:
                del self.rungs[0]


def rungs(radius: float, *, in_time: bool = True) -> list[tuple[int, float]]:
    """List the rungs of a ladder in order: factors on the number of intervals, and radii of the tube (rad).

    Args:
        radius: rad, of the tube asked for.
        in_time: whether there is time enough to pass all nodes. Otherwise, unless `radius` is 0, only one
            rung without a tube is listed: the shortest motion, which is looked for then, is found sooner.
    """
    along_nodes = radius == 0 or (in_time and radius < np.inf)
    wider = [(1, _WIDER_TUBE_FACTOR * radius)] if 0 < radius < np.inf and in_time else []
    free = [(1, np.inf), (2, np.inf)][: 2 if in_time else 1] if radius > 0 else []
    return [*([(1, radius), (2, radius)] if along_nodes else []), *wider, *free]
