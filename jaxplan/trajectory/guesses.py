"""First curves for shortest motions, bent away from the turn about one axis, and breaks for them.

The turn about one fixed axis is a stationary point of the duration by its symmetry, and seldom the quickest
motion: with limits on each body axis a motion is quicker where several axes work at their limits all the time
(Bilimoria and Wie, JGCD 16(3), 1993). So a curve is *bent*: a few slow sine waves about all three axes are
added to it. From each bent curve the shortest motion near it is looked for on few intervals. The best is then
made precise on more intervals, most of which lie where the acceleration changes fast, which is where a
shortest motion switches between its limits.

What light gimbals do to the platform as they move changes little about which motion is quickest, and costs
much to compute. So all but the last of these steps solve the problem that is `stiff`.

Functions return an `InitialGuess`, from which `sqp` looks for the best curve nearby.
"""

from dataclasses import replace

import numpy as np

from jaxplan import so3
from jaxplan.trajectory.curve_attempts import Attempt, first_curve
from jaxplan.trajectory.discretisation import DiscreteProblem, discretise
from jaxplan.trajectory.node_times import FIRST_GUESS, axis_bounds
from jaxplan.trajectory.problem import FitProblem, Mesh
from jaxplan.trajectory.splines import Basis
from jaxplan.trajectory.sqp import InitialGuess

COARSE = 12  # intervals of bent curves, enough for five switches of the acceleration
FINE = 32  # intervals on which the best bent curve is made precise

# Fractions of the duration: the search by time alone ends when a step gains less.
_COARSE_TIME_TOLERANCE = 1e-2  # on few intervals, where only the best curve is chosen
_FINE_TIME_TOLERANCE = 1e-3  # on many intervals, whose breaks are moved afterwards
_POINTS_PER_INTERVAL = 8  # places on each interval
_WAVE_COUNT = 3  # number of waves by which a curve is bent: the slowest ones
_BEND_RATIO = 0.13  # amplitude of the slowest wave, rad for each rad of the rotation from start to goal
_MIN_BEND = 0.01  # rad, least amplitude, for motions whose platform hardly turns
_EVEN_SHARE = 0.3  # fraction of the breaks that are spread evenly; the others follow the jerk
_JERK_SAMPLES = 2048  # places at which the jerk is evaluated
_MAX_DENSITY = 8.0  # most times that breaks are closer than even ones; much closer ones cost digits
_JERK_WINDOW = 61  # number of these places over which the size of the jerk is averaged
_BREAK_TOLERANCE = 5e-3  # of the duration; breaks that differ by less are those of a slightly other problem
_MAX_END_SHIFT = 0.3  # rad, by which an end may have moved; beyond, another kind of motion may be quickest
_CURVATURE_WEIGHT = 1e-2  # weight of second derivatives beside distances, where a curve changes its mesh


def near(problem: FitProblem) -> InitialGuess | None:
    """The curve of the motion ``problem.near``, on that motion's breaks, moved to the problem's ends.

    Args:
        problem: what is fitted.

    Returns:
        The curve with the ends of the problem; None if ``problem.near`` is None, if the problem has a tube or
        a rate at an end, if the nodes leave every chart, if the motion's ends are too far from the problem's,
        or if its breaks are the usual ones, which the search chooses by itself.
    """
    own = problem.near
    if own is None or problem.radius < np.inf or problem.at_speed:
        return None
    breaks = own.breaks / own.duration
    usual = problem.mesh(problem.quickest, np.inf, max(1, (len(breaks) - 1) // FINE), graded=True)
    even = np.linspace(0, 1, len(breaks))
    if any(_are_alike(breaks, others) for others in (usual.basis.breaks, even)):
        return None
    discrete = discretise(problem, _tubeless_mesh(usual, Basis.on(breaks)), "shortest")
    if discrete is None:
        return None
    space, size = discrete.space, discrete.space.basis.size
    pieces = np.concatenate([own.coefficients, own.joint_coefficients], axis=2).reshape(
        -1, len(space.fixed.T)
    )
    spline = np.linalg.lstsq(space.basis.pieces(np.eye(size)).reshape(-1, size), pieces, rcond=None)[0]
    missing = discrete.nodes[[0, -1]] - spline[[0, -1]]
    if np.max(np.abs(missing)) > _MAX_END_SHIFT:
        return None
    gone = np.linalg.lstsq(discrete.rows[0], discrete.places, rcond=None)[0][:, None]  # of the curve z(s) = s
    start = space.fixed + own.duration * space.by_time
    moved = spline + (1 - gone) * missing[0] + gone * missing[1] - start
    free = np.linalg.lstsq(space.free, moved, rcond=None)[0]
    return InitialGuess(discrete=discrete, coefficients=start + space.free @ free, duration=own.duration)


def _are_alike(breaks: np.ndarray, others: np.ndarray) -> bool:
    """Tell whether two sets of breaks in [0, 1] are equally many and nearly equal."""
    return len(breaks) == len(others) and bool(np.max(np.abs(breaks - others)) <= _BREAK_TOLERANCE)


def in_time(attempt: Attempt, duration: float, *, tighter: float) -> InitialGuess | None:
    """An attempt's curve in a given duration (s), with its breaks and rates at both ends; None beyond charts.

    `tighter` is the fraction of the limits on the platform's loads that is to be left unused.
    """
    own = attempt.solution
    curve = own.coefficients + (duration - own.duration) * attempt.discrete.space.by_time
    mesh = attempt.discrete.mesh
    return first_curve(attempt.problem, mesh, duration, "given", tighter=tighter, coefficients=curve)


def shorter(attempt: Attempt) -> InitialGuess | None:
    """An attempt's curve, on its breaks, to look for the shortest motion near it; None beyond charts."""
    own = attempt.solution
    return first_curve(
        attempt.problem, attempt.discrete.mesh, own.duration, "shortest", coefficients=own.coefficients
    )


def along(problem: FitProblem) -> InitialGuess | None:
    """The curve nearest to a problem's path, on few intervals; None if its nodes leave every chart.

    The problem is taken as stiff.
    """
    problem = problem.stiff
    mesh = _tubeless_mesh(problem.mesh(problem.quickest, np.inf, 1, graded=False), Basis.even(COARSE))
    duration = FIRST_GUESS * problem.quickest.duration
    begin = first_curve(problem, mesh, duration, "shortest")
    return None if begin is None else replace(begin, by_time_to=_COARSE_TIME_TOLERANCE)


def coarse(attempt: Attempt) -> InitialGuess:
    """The curve nearest to an attempt's, on few intervals, as the start of a rough search.

    The problem is taken as stiff.
    """
    discrete = _move_to_basis(attempt.discrete, Basis.even(COARSE), attempt.problem.stiff)
    return _guess_near(discrete, attempt, by_time_to=_COARSE_TIME_TOLERANCE)


def bent(begin: InitialGuess, count: int) -> list[InitialGuess]:
    """Make curves that differ from one by slow waves about all three axes; they are the same in every call.

    Args:
        begin: the curve, on few intervals.
        count: how many bent curves to make.
    """
    discrete, places = begin.discrete, begin.discrete.places
    calm = places**3 * (10 - 15 * places + 6 * places**2)  # at rest at both ends
    waves = np.sin(np.pi * np.arange(1, _WAVE_COUNT + 1) * calm[:, None])
    ends = discrete.problem.attitudes[[0, -1]]
    size = max(_BEND_RATIO * float(so3.distance(*ends)), _MIN_BEND)
    free, wave_rows = discrete.space.free, discrete.rows[0] @ discrete.space.free
    by_wave = np.linalg.lstsq(wave_rows, waves, rcond=None)[0]  # (k, waves)
    found = []
    for heights in _quasi_random_heights(count) * size / np.arange(1, _WAVE_COUNT + 1)[:, None]:
        coefficients = begin.coefficients.copy()
        coefficients[:, :3] += free @ by_wave @ heights
        found.append(replace(begin, coefficients=coefficients))
    return found


def precise(attempt: Attempt, problem: FitProblem, *, by_time_alone: bool) -> InitialGuess:
    """The curve nearest to an attempt's, on many intervals, most of them where the attempt switches.

    Args:
        attempt: on few intervals or many.
        problem: that of the attempt, or the one of which the attempt's is the stiff one.
        by_time_alone: whether the duration alone is to be lowered, without the energy.
    """
    discrete = _move_to_basis(attempt.discrete, Basis.on(_switching_breaks(attempt, FINE)), problem)
    return _guess_near(discrete, attempt, by_time_to=_FINE_TIME_TOLERANCE if by_time_alone else None)


def _guess_near(discrete: DiscreteProblem, attempt: Attempt, by_time_to: float | None) -> InitialGuess:
    """The curve nearest to an attempt's in another discrete problem; `by_time_to` as in `InitialGuess`."""
    return InitialGuess(
        discrete=discrete,
        coefficients=_project_curve(attempt, discrete),
        duration=attempt.needed,
        by_time_to=by_time_to,
    )


def _move_to_basis(discrete: DiscreteProblem, basis: Basis, problem: FitProblem) -> DiscreteProblem:
    """Change a discrete problem to another basis, without a tube and with a free duration.

    Args:
        discrete: the one to change.
        basis: with the new breaks.
        problem: what is fitted, with the ends and the path that the discrete one has.
    """
    own = replace(discrete, problem=problem)
    return replace(own.on_mesh(_tubeless_mesh(discrete.mesh, basis)), timing="shortest")


def _tubeless_mesh(mesh: Mesh, basis: Basis) -> Mesh:
    """Make the mesh of a basis, with nodes at the places of another mesh and without a tube about them."""
    return replace(mesh, basis=basis, points=_POINTS_PER_INTERVAL, radius=np.inf, flank=np.nan)


def _project_curve(attempt: Attempt, discrete: DiscreteProblem) -> np.ndarray:
    """Coefficients (n, A) of a problem's curve nearest to an attempt's in value and second derivative.

    There are n coefficients on each of A axes.
    """
    space, rows = discrete.space, discrete.rows
    own = attempt.discrete.space.basis.rows(discrete.places, 3)
    start = space.fixed + attempt.needed * space.by_time
    wanted = [own[power] @ attempt.solution.coefficients - rows[power] @ start for power in (0, 2)]
    design = np.concatenate([rows[0], _CURVATURE_WEIGHT * rows[2]]) @ space.free
    target = np.concatenate([wanted[0], _CURVATURE_WEIGHT * wanted[1]])
    found: np.ndarray = start + space.free @ np.linalg.lstsq(design, target, rcond=None)[0]
    return found


def _switching_breaks(attempt: Attempt, intervals: int) -> np.ndarray:
    """Breaks (intervals + 1,) from 0 to 1, the closer together the larger the jerk of an attempt is there."""
    edges = np.linspace(0, 1, _JERK_SAMPLES + 1)
    rows = attempt.discrete.space.basis.rows((edges[1:] + edges[:-1]) / 2)[3]
    accelerations = axis_bounds(attempt.problem.spacecraft, 2)
    jerk = np.max(np.abs(rows @ attempt.solution.coefficients) / accelerations, axis=1)
    half = _JERK_WINDOW // 2
    around = np.convolve(np.pad(jerk, half, mode="edge"), np.full(_JERK_WINDOW, 1 / _JERK_WINDOW), "valid")
    mean = np.mean(around)
    density = _EVEN_SHARE + (1 - _EVEN_SHARE) * np.minimum(around / mean if mean > 0 else 1.0, _MAX_DENSITY)
    gone = np.concatenate([[0.0], np.cumsum(density)])
    return np.interp(np.linspace(0, 1, intervals + 1), gone / gone[-1], edges)


def _quasi_random_heights(count: int) -> np.ndarray:
    """Numbers (count, waves, 3) in [-1, 1], spread evenly: multiples of square roots of primes, modulo 1."""
    primes = np.array([2, 3, 5, 7, 11, 13, 17, 19, 23])
    steps = np.sqrt(primes) * np.arange(1, count + 1)[:, None]
    return np.asarray(2 * np.mod(steps, 1) - 1).reshape(count, _WAVE_COUNT, 3)
