"""What is made of an attempt in the end: a fit that keeps all limits, or one that says what is broken."""

from dataclasses import replace

import numpy as np

from jaxplan.model.status import Status
from jaxplan.trajectory import options
from jaxplan.trajectory.active_set import FitRecord
from jaxplan.trajectory.attempts import Attempt
from jaxplan.trajectory.fit import Fit, Needed, too_tight
from jaxplan.trajectory.peaks import SAFETY
from jaxplan.trajectory.problem import FitProblem
from jaxplan.trajectory.schedule import excess

NOT_OPTIMAL = "it is not the optimum: near the fit none was found that keeps all limits and can be certified"


def better(fit: Fit, other: Fit) -> Fit:
    """The fit that succeeded or, where both or none did, the one that takes or needs less time."""

    def key(one: Fit) -> tuple[bool, bool, float]:
        found, curve = one.status is Status.OK, one.trajectory
        time = curve.duration if found and curve is not None else one.needed_duration
        return not found, curve is None, np.inf if time is None else time

    return min(fit, other, key=key)


def success(problem: FitProblem, attempt: Attempt, radius: float, *, stretch: bool = False) -> Fit:
    """A fit within all limits on rates and loads, perhaps after its time is stretched to them.

    Where the settings ask for the optimum and that is sound, too, it is the optimum near the attempt.
    """
    found = _within_limits(problem, attempt, radius, stretch=stretch)
    if not problem.settings.optimal or found.origin is None:
        return found
    spare = noted(found, NOT_OPTIMAL)
    best = found.origin.at_optimum()
    if best is None or not best.sound or not (stretch or best.kept):
        return spare
    return replace(_within_limits(problem, best, radius, stretch=stretch), spare=spare)


def noted(fit: Fit, note: str) -> Fit:
    """The fit with a further note in its message."""
    notes = f"{fit.note}; {note}" if fit.note else note
    return replace(fit, message=f"{fit.message}; {note}", note=notes)


def _within_limits(problem: FitProblem, attempt: Attempt, radius: float, *, stretch: bool) -> Fit:
    curve = attempt.trajectory
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
    if attempt.radius > radius:
        wide = f"passed within {np.rad2deg(attempt.radius):g} deg"
        how = wide if np.isfinite(attempt.radius) else "only a first guess"
        note = f"nodes are {how}: within trajectory.node_tube_deg no motion was found, or a slow one"
        message = f"{message}; {note}"
    origin = FitRecord(problem=problem, attempt=attempt, stretched=stretch)
    return Fit(trajectory=curve, status=Status.OK, message=message, note=note, origin=origin)


def limits_too_tight(problem: FitProblem, closest: Attempt, duration: float, needed: float | None) -> Fit:
    """The fit that breaks a limit, and in what time it would not."""
    enough = None
    if needed is not None:
        enough = Needed(duration=needed, moving=problem.horizon > 0, scalable=True)
    else_try = "lower the rates at start and end" if problem.at_speed else 'set it to "minimum"'
    return Fit(
        trajectory=closest.trajectory,
        status=Status.LIMITS_TOO_TIGHT,
        message=too_tight(duration, closest.peaks, enough, else_try),
        needed_duration=needed,
    )


def beyond_charts() -> Fit:
    """No chart holds the path."""
    message = (
        f"the nodes lie more than {np.rad2deg(options.CHART.reach):.0f} deg off the steady rotation "
        'from start to goal: set trajectory.method to "paper"'
    )
    return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
