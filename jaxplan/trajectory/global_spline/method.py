"""Step 3 by one spline: how long, in how many intervals, and what to do where a limit or a zone is broken."""

from dataclasses import replace

import numpy as np

from jaxplan.path import Path
from jaxplan.scenario.model import MINIMUM, STRETCHED, TrajectorySettings
from jaxplan.spacecraft import Spacecraft
from jaxplan.status import Status
from jaxplan.trajectory import schedule
from jaxplan.trajectory.fit import Fit, at_rest, boundary, check, too_tight
from jaxplan.trajectory.global_spline.bases import DEGREE, SMOOTHNESS
from jaxplan.trajectory.global_spline.chart import REACH
from jaxplan.trajectory.global_spline.job import Attempt, Job, attempt_at, ladder
from jaxplan.trajectory.global_spline.timing import Pace
from jaxplan.trajectory.scaling import SAFETY, peaks
from jaxplan.zones import Cones, tabulate

_BEGIN = 1.01  # of the duration of a trapezoid, whose accelerations jump
_TIGHTER = (1e-3, 1e-2)  # shares of the limits left to what is between places, first and then
_LONGER = 1.02  # from one duration to the next, when one is looked for that is long enough
_LOOKS = 8
_TELLING = 0.01  # of the duration: a lower bound, as of a path that ends where it starts, tells nothing
_HURRY = 0.97  # of the time along the nodes, below which they are only a first guess
_LEISURE = 1.15  # of that time; with less, breaks lie close about the flanks
_HOPELESS = 1.05  # of the duration is missing: not for want of intervals


def fit_global(
    path: Path,
    spacecraft: Spacecraft,
    settings: TrajectorySettings,
    *,
    cones: Cones | None = None,
    node_fractions: np.ndarray | None = None,
    start_angular_velocity: np.ndarray | None = None,
    start_joint_rates: np.ndarray | None = None,
    end_angular_velocity: np.ndarray | None = None,
    end_joint_rates: np.ndarray | None = None,
) -> Fit:
    """Fits one spline of degree 5, platform and joints together, to a path.

    It has four continuous derivatives and least energy (rate, acceleration and jerk with the settings'
    weights) among those that pass the nodes within the tube, keep all limits and stay clear of the zones. The
    nodes are passed at the pace of a trapezoid. A number for ``settings.duration`` is kept. "stretched" fits
    at the quickest pace without limits and scales the time until the first limit binds. "minimum" looks for
    the shortest duration within all limits and zones; the nodes are then only a first guess, unless the
    settings give a tube. With a rate at the start or end, "stretched" is the same with the tube.

    Where a limit, a zone or the tube is broken more intervals are tried, then a wider tube, then none.

    Args:
        path: m + 1 nodes.
        spacecraft: its limits, dynamics included.
        settings: of step 3.
        cones: the zones, None for none.
        node_fractions: (m + 1,) times of the nodes as fractions of the duration, strictly increasing from 0
            to 1.
        start_angular_velocity: (3,) rad/s, body axes; zero by default, as are the next three.
        start_joint_rates: (2n,) rad/s.
        end_angular_velocity: (3,) rad/s, body axes.
        end_joint_rates: (2n,) rad/s.

    Returns:
        The fit; of one that is OK, zones are kept at the places that were looked at, and the certificate has
        the last word on them. UNCERTIFIED where one is broken there.

    Raises:
        ValueError: if settings, costs, fractions or rates make no sense; the message names which.
    """
    check(path, settings, node_fractions)
    joints = path.joints.shape[1]
    rates = np.stack(
        [
            np.concatenate([boundary(start_angular_velocity, 3)[0], boundary(start_joint_rates, joints)[0]]),
            np.concatenate([boundary(end_angular_velocity, 3)[0], boundary(end_joint_rates, joints)[0]]),
        ]
    )
    if not (np.all(np.isfinite(path.attitudes)) and np.all(np.isfinite(path.joints))):
        message = "a node of the path is not made of finite numbers"
        return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
    path, own = schedule.passed_nodes(path, at_speed=bool(np.any(rates)), every=node_fractions is not None)
    if len(path.attitudes) == 1:
        still = replace(at_rest(path, DEGREE, "global", len(own)), smoothness=SMOOTHNESS)
        return Fit(trajectory=still, status=Status.OK, message="the path has no motion")
    none = tabulate((), (), spacecraft.device_names)
    job = Job(
        attitudes=path.attitudes,
        joints=path.joints,
        fractions=None if node_fractions is None else np.asarray(node_fractions, float),
        rates=rates,
        spacecraft=spacecraft,
        cones=none if cones is None else cones,
        settings=settings,
    )
    fit = _fit(job)
    if fit.trajectory is None:
        return fit
    return replace(fit, trajectory=replace(fit.trajectory, node_times=fit.trajectory.node_times[own]))


def _fit(job: Job) -> Fit:
    """The fit in the duration that the settings ask for."""
    duration = job.settings.duration
    if duration == MINIMUM or (duration == STRETCHED and job.at_speed):
        return _free(job, job.radius(free_time=duration == MINIMUM))
    if duration == STRETCHED:
        return _stretched(job)
    return _timed(job, float(duration))


def _timed(job: Job, duration: float) -> Fit:
    """The fit in a given duration."""
    attempt = None if duration < job.bound else _best_at(job, duration, job.radius(free_time=False))
    if attempt is not None and attempt.kept:
        return _success(job, attempt, job.radius(free_time=False))
    # The shortest motion says whether there is one at all, and what to ask for.
    shortest = _along(job, np.inf, shortest=True)
    if shortest is None:
        return _beyond(job)
    needed = max(_BEGIN * shortest.trajectory.duration, _LONGER * duration)
    for look in range(_LOOKS):
        enough = _best_at(job, needed, np.inf)
        if enough is not None and enough.kept:
            break
        needed *= _LONGER ** (2**look)
    else:
        needed = np.nan
    closest = attempt if attempt is not None else _hurried(job, shortest, duration)
    return Fit(
        trajectory=closest.trajectory,
        status=Status.LIMITS_TOO_TIGHT,
        message=too_tight(duration, closest.peaks, needed if np.isfinite(needed) else None),
        needed_duration=needed if np.isfinite(needed) else None,
    )


def _hurried(job: Job, attempt: Attempt, duration: float) -> Attempt:
    """The same motion in another duration."""
    curve = attempt.trajectory.scaled(duration / attempt.trajectory.duration)
    return replace(attempt, trajectory=curve, peaks=peaks(curve, job.spacecraft))


def _best_at(job: Job, duration: float, radius: float) -> Attempt | None:
    """The first sound attempt within all limits, or the one nearest to it; None beyond every chart."""
    quickest = job.quickest()
    pace = Pace.within(duration, quickest.length, job.rise)
    hurry = duration / quickest.duration
    best, last = None, None
    for finer, wide in ladder(radius, in_time=job.at_speed or hurry >= _HURRY):
        if last is not None and finer > 1 and (last.hopeless or last.peaks.stretch > _HOPELESS):
            continue
        for tighter in _TIGHTER:
            request = job.request(pace, wide, finer, graded=hurry < _LEISURE)
            last = attempt_at(job, request, duration, limited=True, free_time=False, tighter=tighter)
            if last is None:
                return best
            if best is None or last.merit > best.merit:
                best = last
            if not 1 < last.peaks.stretch <= 1 + tighter:  # else it is what happens between the places
                break
        if best is not None and best.kept and best.sound:
            break
    return best


def _along(job: Job, radius: float, *, shortest: bool) -> Attempt | None:
    """The first sound attempt at the quickest pace, or the one nearest to it; None beyond every chart.

    Args:
        job: what is fitted.
        radius: rad, of the tube.
        shortest: whether the shortest motion within all limits is looked for; else one without limits, to be
            stretched to them.
    """
    pace = job.quickest()
    best, last = None, None
    for finer, wide in ladder(radius):
        if last is not None and finer > 1 and last.hopeless:
            continue
        request = job.request(pace, wide, finer, graded=True)
        last = attempt_at(job, request, _BEGIN * pace.duration, limited=shortest, free_time=shortest)
        if last is None:
            break
        if best is None or last.merit > best.merit:
            best = last
        if last.sound:
            break
    return best


def _stretched(job: Job) -> Fit:
    """The fit at the quickest pace without limits, scaled in time to the limits."""
    radius = job.radius(free_time=False)
    best = _along(job, radius, shortest=False)
    return _beyond(job) if best is None else _success(job, best, radius, stretch=True)


def _free(job: Job, radius: float) -> Fit:
    """The shortest motion."""
    best = _along(job, radius, shortest=True)
    if best is None:
        return _beyond(job)
    if not job.at_speed:
        return _success(job, best, radius, stretch=True)
    # Scaling the time would change the rates at the ends: the curve is fitted again where it is too quick.
    duration = best.trajectory.duration
    for look in range(_LOOKS):
        if best.kept:
            return _success(job, best, radius)
        tighter = _TIGHTER[0] + 2 * max(0.0, best.peaks.stretch - 1)
        duration *= max(best.peaks.stretch, 1 + _TIGHTER[0]) ** (2**look)
        again = attempt_at(
            job,
            job.request(job.quickest(), best.radius, 1, graded=True),
            duration,
            limited=True,
            free_time=False,
            tighter=min(tighter, _TIGHTER[1]),
        )
        if again is None:
            break
        best = again
    curve = best.trajectory
    message = too_tight(curve.duration, best.peaks, None)
    return Fit(trajectory=curve, status=Status.LIMITS_TOO_TIGHT, message=message)


def _success(job: Job, attempt: Attempt, radius: float, *, stretch: bool = False) -> Fit:
    """A fit within all limits, perhaps after its time is stretched to them; names a tube wider than asked."""
    curve = attempt.trajectory
    if stretch:
        curve = curve.scaled(attempt.peaks.stretch * SAFETY)
    if attempt.breach is not None:
        device, depth = attempt.breach
        message = (
            f"{device} breaks a zone by {np.rad2deg(depth):.2f} deg, and no curve near the path was found "
            "that keeps it: look for a path with a larger search.clearance_deg, or give more time"
        )
        return Fit(trajectory=curve, status=Status.UNCERTIFIED, message=message)
    nearest = attempt.peaks.names[attempt.peaks.binding]
    above = ""
    if job.bound > _TELLING * curve.duration:
        above = f", {100 * (curve.duration / job.bound - 1):.1f} % above the strict bound"
    message = f"{curve.duration:.2f} s{above}; {nearest} is nearest to its limit"
    if attempt.radius > radius:
        wide = f"{np.rad2deg(attempt.radius):g} deg" if np.isfinite(attempt.radius) else "any distance"
        message += f"; within trajectory.node_tube_deg nothing was found, nodes are passed within {wide}"
    return Fit(trajectory=curve, status=Status.OK, message=message)


def _beyond(job: Job) -> Fit:
    """No chart holds the path."""
    message = (
        f"the nodes lie more than {np.rad2deg(REACH):.0f} deg off the steady rotation from start to goal: "
        'set trajectory.method to "paper"'
    )
    return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
