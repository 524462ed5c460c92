"""Make the result of a fit from its best attempt: the trajectory, the status, and the message to the user."""

from dataclasses import replace

import numpy as np

from jaxplan.model.duration_bound import excess
from jaxplan.model.status import Status
from jaxplan.trajectory.active_set import FitRecord
from jaxplan.trajectory.chart import CHART_REACH
from jaxplan.trajectory.fit import Fit, needed_words, too_tight
from jaxplan.trajectory.full_wheels import full_on_the_way
from jaxplan.trajectory.ladder import Attempt
from jaxplan.trajectory.peaks import SAFETY

NOT_OPTIMAL = "it is not the optimum: near the fit none was found that keeps all limits and can be certified"


def better(fit: Fit, other: Fit) -> Fit:
    """Return the better of two fits: the one that succeeded or, if both or none did, the one that is faster.

    Of failed fits the one with a trajectory is preferred, then the one that needs less time.
    """

    def key(one: Fit) -> tuple[bool, bool, float]:
        found, curve = one.status is Status.OK, one.trajectory
        time = curve.duration if found and curve is not None else one.needed_duration
        return not found, curve is None, np.inf if time is None else time

    return min(fit, other, key=key)


def success(attempt: Attempt, *, stretch: bool = False) -> Fit:
    """Make the fit of an attempt within all limits on rates and loads.

    Where the settings ask for the optimum and that is sound, too, it is the optimum near the attempt;
    otherwise a note says that it is not. Its status is UNCERTIFIED if it breaks a zone or a joint's range.

    Args:
        attempt: the best one.
        stretch: whether its time is first scaled, so that it just keeps all limits.
    """
    found = _fit_of_attempt(attempt, stretch=stretch)
    if not attempt.problem.settings.optimal or found.origin is None:
        return found
    notes = "; ".join(filter(None, (found.note, NOT_OPTIMAL)))
    spare = replace(found, message=f"{found.message}; {NOT_OPTIMAL}", note=notes)
    best = found.origin.at_optimum()
    if best is None or not best.sound or not (stretch or best.kept):
        return spare
    return replace(_fit_of_attempt(best, stretch=stretch), spare=spare)


def _fit_of_attempt(attempt: Attempt, *, stretch: bool) -> Fit:
    """The fit with an attempt's curve: OK, or UNCERTIFIED if it breaks a zone or a joint's range."""
    curve, problem = attempt.trajectory, attempt.problem
    if stretch:
        curve = curve.scaled(attempt.peaks.stretch * SAFETY)
    broken = None
    if attempt.breach is not None:
        device, depth = attempt.breach
        broken = f"{device} breaks a zone by {np.rad2deg(depth):.2f} deg", "a larger search.clearance_deg"
    elif not attempt.peaks.in_range:
        broken = "a joint leaves its range", "start and goal farther inside, or lower joint rates there"
    if broken is not None:
        message = f"{broken[0]}, and no curve near the path was found that does not: try {broken[1]}"
        return Fit(trajectory=curve, status=Status.UNCERTIFIED, message=message)
    nearest = attempt.peaks.names[attempt.peaks.binding]
    share = excess(curve.duration, problem.bound)
    above = "" if share is None else f", {100 * share:.1f} % above the strict bound"
    message, note = f"{curve.duration:.2f} s{above}; {nearest} is nearest to its limit", ""
    if attempt.radius > problem.radius:
        how = "the path is only a first guess of the motion"
        if np.isfinite(attempt.radius):
            how = f"the motion is up to {np.rad2deg(attempt.radius):g} deg off the nodes of its path"
        tube = f"trajectory.node_tube_deg = {np.rad2deg(problem.radius):g}"
        note = f"{how}, since within {tube} of the nodes none was found, or a slow one"
        message = f"{message}; {note}"
    origin = FitRecord(problem=problem, attempt=attempt, stretched=stretch)
    return Fit(trajectory=curve, status=Status.OK, message=message, note=note, origin=origin)


_RATES_ADVICE = (
    "lower the rates at start and end; where these are those of targets that move, meet them at another "
    "time, by a number for trajectory.duration_s"
)


def limits_too_tight(closest: Attempt, duration: float, needed: float | None) -> Fit:
    """Make the fit, LIMITS_TOO_TIGHT, of an attempt that breaks a limit.

    Args:
        closest: the attempt that comes nearest to keeping the limits.
        duration: the one asked for, s.
        needed: duration in which all limits are kept, s; None if none was found.
    """
    problem, enough = closest.problem, None
    if needed is None and np.isinf(closest.peaks.stretch):
        return full_on_the_way(closest.trajectory, problem.spacecraft)
    if needed is not None:
        enough = needed_words(needed, moving=problem.horizon > 0, scalable=True)
    else_try = _RATES_ADVICE if problem.at_speed else 'set it to "minimum"'
    return Fit(
        trajectory=closest.trajectory,
        status=Status.LIMITS_TOO_TIGHT,
        message=too_tight(duration, closest.peaks, enough, else_try),
        needed_duration=needed,
    )


def beyond_charts() -> Fit:
    """Make the fit, INFEASIBLE, of a path with a node too far from the steady rotation in every chart."""
    message = (
        f"the nodes lie more than {np.rad2deg(CHART_REACH):.0f} deg off the steady rotation "
        'from start to goal: set trajectory.method to "paper"'
    )
    return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
