"""Attempts at curves, each with one spline on given breaks, and the `Ladder` of attempts of one fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxplan.trajectory import options, sqp
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.iterates import TUBE, SQPSolution
from jaxplan.trajectory.peaks import Peaks, all_peaks
from jaxplan.trajectory.problem import AttemptRequest, DiscreteProblem, FitProblem, Mesh, discretise
from jaxplan.trajectory.schedule import TrapezoidalProfile
from jaxplan.trajectory.splines import SMOOTHNESS


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempt:
    """A curve, and what it breaks.

    Attributes:
        request: what it was made for.
        discrete: the problem that was solved.
        solution: the curve that was found.
        trajectory: of the curve.
        peaks: over all time.
        clear: whether zones are kept at the places, with some of the clearance.
        breach: what breaks a zone, by name, and by how much (rad); None where none does.
        tube: rad, how far nodes are beyond it; zero or less where they are within.
    """

    request: AttemptRequest
    discrete: DiscreteProblem
    solution: SQPSolution
    trajectory: Trajectory
    peaks: Peaks
    clear: bool
    breach: tuple[str, float] | None
    tube: float

    @property
    def radius(self) -> float:
        """Radius of the tube that was tried, rad."""
        return self.request.mesh.radius

    @property
    def sound(self) -> bool:
        """Whether nothing is broken but perhaps limits of rates and loads."""
        return self.clear and self.peaks.in_range and self.tube <= options.ACCEPTANCE.tube_broken

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
        return self.breach is not None and self.breach[1] > options.ACCEPTANCE.deep

    @property
    def merit(self) -> tuple[bool, bool, bool, float]:
        """Attempts are compared by it; the larger the better."""
        inside, nearly = self.clear and self.peaks.in_range, self.peaks.stretch <= options.ACCEPTANCE.nearly
        return inside, nearly, self.tube <= options.ACCEPTANCE.tube_broken, -self.peaks.stretch


def make_attempts(requests: Sequence[AttemptRequest]) -> list[Attempt | None]:
    """Attempts at all requests; None where the nodes leave the chart or numbers overflow."""
    begins = {number: begin for number, one in enumerate(requests) if (begin := _first_curve(one))}
    solutions = _improved([requests[number].problem for number in begins], list(begins.values()))
    attempts: list[Attempt | None] = [None] * len(requests)
    made = [
        (requests[number], begin.discrete, solution)
        for (number, begin), solution in zip(begins.items(), solutions, strict=True)
    ]
    for number, attempt in zip(begins, finished(made), strict=True):
        attempts[number] = attempt
    return attempts


def finished(
    made: Sequence[tuple[AttemptRequest, DiscreteProblem, SQPSolution]],
) -> list[Attempt | None]:
    """Attempts with the curves of solutions; None where numbers overflow."""
    curves = {
        number: _trajectory(discrete, solution, solution.duration * request.mesh.places)
        for number, (request, discrete, solution) in enumerate(made)
        if solution.duration > 0 and np.all(np.isfinite(solution.coefficients)) and solution.finite
    }
    peaks = all_peaks([(curve, made[number][0].problem.spacecraft) for number, curve in curves.items()])
    attempts: list[Attempt | None] = [None] * len(made)
    for (number, curve), own in zip(curves.items(), peaks, strict=True):
        request, discrete, solution = made[number]
        if np.isfinite(own.stretch):
            attempts[number] = Attempt(
                request=request,
                discrete=discrete,
                solution=solution,
                trajectory=curve,
                peaks=own,
                clear=bool(np.all(solution.margins >= options.ACCEPTANCE.kept_margin * discrete.wanted)),
                breach=_breach(solution.margins, request.problem),
                tube=float(solution.violations[TUBE]),
            )
    return attempts


def _first_curve(request: AttemptRequest) -> sqp.InitialGuess | None:
    """Where the search for a request begins; None if the nodes leave every chart."""
    found = discretise(request)
    if found is None:
        return None
    discrete, nearest = found
    coefficients = nearest if request.begin is None else request.begin
    return sqp.InitialGuess(discrete=discrete, coefficients=coefficients, duration=request.duration)


def _improved(problems: Sequence[FitProblem], begins: Sequence[sqp.InitialGuess]) -> list[SQPSolution]:
    """The best curves near the first ones.

    In a given time one that is far too quick is left as it is at first: from there a program leads nowhere.
    So one is made that is slow enough, and that is improved.
    """
    first = [
        begin
        if begin.discrete.free_time or problem.at_speed
        else replace(begin, max_violation=0.0 if begin.discrete.limited else options.ACCEPTANCE.mended)
        for problem, begin in zip(problems, begins, strict=True)
    ]
    solutions = sqp.improve(first)
    hasty = [
        number
        for number, begin in enumerate(first)
        if begin.discrete.limited and solutions[number].steps == 0
    ]
    slower = sqp.improve(
        [
            replace(
                own,
                discrete=replace(own.discrete, free_time=True),
                target_duration=own.duration,
                max_violation=np.inf,
            )
            for own in (first[number] for number in hasty)
        ]
    )
    slow = [
        replace(first[number], coefficients=solution.coefficients, max_violation=options.ACCEPTANCE.mended)
        for number, solution in zip(hasty, slower, strict=True)
    ]
    for number, solution in zip(hasty, sqp.improve(slow), strict=True):
        solutions[number] = solution
    return solutions


def _trajectory(discrete: DiscreteProblem, solution: SQPSolution, node_times: np.ndarray) -> Trajectory:
    """The curve of a solution in time.

    Args:
        discrete: the problem, with chart and basis.
        solution: the curve.
        node_times: (m + 1,) s, when the nodes are passed.
    """
    basis, chart, duration = discrete.space.basis, discrete.system.chart, solution.duration
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
        node_times=node_times,
        smoothness=SMOOTHNESS,
        method="global",
    )


def _breach(margins: np.ndarray, problem: FitProblem) -> tuple[str, float] | None:
    """What breaks a zone the most, given margins (S, D, Z), and by how much (rad); None where nothing does.

    Axes of the body go by the name of the body, what terminals carry by theirs.
    """
    if np.all(margins >= -options.ACCEPTANCE.rounding):
        return None
    _, sight, _ = np.unravel_index(np.argmin(margins), margins.shape)
    names, cones = problem.spacecraft.device_names, problem.cones
    carriers = [names[terminal] for terminal in cones.carrier]
    return (*names, *["the body"] * len(cones.body), *carriers)[sight], -float(np.min(margins))


class Ladder:
    """One fit's attempts, one after the other, up to the first that is good enough.

    A rung is a number of intervals and a radius of the tube. On each of them the limits are taken a little
    tighter where a curve breaks them by next to nothing, which happens between the places. After an attempt
    without hope more intervals are not tried.

    Attributes:
        best: of the attempts so far; None before the first, and beyond every chart.
    """

    def __init__(
        self,
        problem: FitProblem,
        profile: TrapezoidalProfile,
        attempts: Sequence[tuple[int, float]],
        *,
        duration: float,
        graded: bool = True,
        limited: bool,
        free_time: bool,
        tighter: Sequence[float] = (0.0,),
    ) -> None:
        """Begin with the first rung.

        Args:
            problem: what is fitted.
            profile: along the path.
            attempts: factors on the number of intervals, and radii of the tube (rad).
            duration: s, given or to begin with.
            graded: whether breaks lie close about the flanks.
            limited: see `AttemptRequest`; so are the next two.
            free_time: whether the shortest duration is looked for.
            tighter: shares of the limits that are left, first and then.
        """
        self.best: Attempt | None = None
        self._job, self._pace, self._graded = problem, profile, graded
        self._duration, self._limited, self._free_time = duration, limited, free_time
        self._tighter, self._share = tighter, 0
        self._rungs = list(attempts)
        self._mesh: Mesh | None = None
        self._here: Attempt | None = None  # the best one on this rung

    @property
    def _timed(self) -> bool:
        return self._limited and not self._free_time

    def next_request(self) -> AttemptRequest | None:
        """The attempt that is to be made next; None at the end."""
        if not self._rungs:
            return None
        if self._mesh is None:
            finer, radius = self._rungs[0]
            self._mesh = self._job.mesh(self._pace, radius, finer, graded=self._graded)
        return AttemptRequest(
            problem=self._job,
            mesh=self._mesh,
            duration=self._duration,
            limited=self._limited,
            free_time=self._free_time,
            tighter=self._tighter[self._share],
        )

    def accept(self, made: Attempt | None) -> None:
        """Go on with the attempt that was made."""
        if made is not None:
            if self._here is None or made.merit > self._here.merit:
                self._here = made
            nearly = 1 < made.peaks.stretch <= 1 + self._tighter[self._share]
            if nearly and self._share + 1 < len(self._tighter):
                self._share += 1
                return
        last, self._here, self._mesh, self._share = self._here, None, None, 0
        del self._rungs[0]
        if last is None:
            self._rungs.clear()
            return
        if self.best is None or last.merit > self.best.merit:
            self.best = last
        if last.sound and (last.kept or not self._timed):
            self._rungs.clear()
        if last.too_deep or (self._timed and last.peaks.stretch > options.ACCEPTANCE.hopeless):
            while self._rungs and self._rungs[0][0] > 1:
                del self._rungs[0]


def rungs(radius: float, *, in_time: bool = True) -> list[tuple[int, float]]:
    """Factors on the number of intervals and radii of the tube, one attempt after the other.

    Args:
        radius: rad, asked for.
        in_time: whether there is time enough to go along the nodes.
    """
    along_nodes = radius == 0 or (in_time and radius < np.inf)
    wider = [(1, options.STRATEGY.wider * radius)] if 0 < radius < np.inf and in_time else []
    free = [(1, np.inf), (2, np.inf)] if radius > 0 else []
    return [*([(1, radius), (2, radius)] if along_nodes else []), *wider, *free]
