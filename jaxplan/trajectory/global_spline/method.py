"""Step 3 by one spline: how long, in how many intervals, and what to do where a limit or a zone is broken."""

from dataclasses import replace

import numpy as np

from jaxplan.model.constraints import Constraints
from jaxplan.model.path import Path
from jaxplan.model.scenario import MINIMUM, STRETCHED, TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.model.zones import tabulate
from jaxplan.trajectory import schedule
from jaxplan.trajectory.asking import Steps, alone, in_turn
from jaxplan.trajectory.bound import excess
from jaxplan.trajectory.fit import Fit, FitQuery, Needed, at_rest, boundary, checked, too_tight
from jaxplan.trajectory.global_spline.attempts import (
    BEGIN,
    LONGER,
    LOOKS,
    TIGHTER,
    best_at,
    enough_time,
    hurried,
    released,
    shortest,
    stretched,
)
from jaxplan.trajectory.global_spline.bases import DEGREE, SMOOTHNESS
from jaxplan.trajectory.global_spline.chart import REACH
from jaxplan.trajectory.global_spline.holding import Origin
from jaxplan.trajectory.global_spline.job import Attempt, Job, attempt_at
from jaxplan.trajectory.scaling import SAFETY

_MOST_LONGER = 1.1  # from one duration to the next
_ROUNDING = 1e-9  # of a rate, beyond its limit


def fit_global(
    path: Path,
    spacecraft: Spacecraft,
    settings: TrajectorySettings,
    *,
    cones: Constraints | None = None,
    node_fractions: np.ndarray | None = None,
    start_angular_velocity: np.ndarray | None = None,
    start_joint_rates: np.ndarray | None = None,
    end_angular_velocity: np.ndarray | None = None,
    end_joint_rates: np.ndarray | None = None,
    horizon: float = 0.0,
) -> Fit:
    """Fits one spline of degree 5, platform and joints together, to a path.

    It has four continuous derivatives and least energy (rate, acceleration and jerk with the settings'
    weights) among those that pass the nodes within the tube, keep all limits and stay clear of the zones. The
    nodes are passed at the pace of a trapezoid. A number for ``settings.duration`` is kept. "stretched" fits
    at the quickest pace without limits and scales the time until the first limit binds; unless the settings
    give a tube, it leaves the nodes where that takes twice the bound and a motion without them is quicker.
    "minimum" looks for the shortest duration within all limits and zones; the nodes are then only a first
    guess, unless the settings give a tube. With a rate at the start or end, "stretched" is the same with the
    tube.

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
        horizon: s, the duration for which zones that move are taken: where the motion is at a share of its
            own, these are at the same share of that.

    Returns:
        The fit; of one that is OK, zones are kept at the places that were looked at, and the certificate has
        the last word on them. UNCERTIFIED where one is broken there.

    Raises:
        ValueError: if settings, costs, fractions or rates make no sense; the message names which.
    """
    query = FitQuery(
        path=path,
        spacecraft=spacecraft,
        settings=settings,
        cones=cones,
        node_fractions=node_fractions,
        start_angular_velocity=start_angular_velocity,
        start_joint_rates=start_joint_rates,
        end_angular_velocity=end_angular_velocity,
        end_joint_rates=end_joint_rates,
        horizon=horizon,
    )
    return alone(steps(query))


def steps(query: FitQuery) -> Steps[Fit]:
    """`fit_global` as a generator, see `asking`."""
    spacecraft, settings, node_fractions = query.spacecraft, query.settings, query.node_fractions
    path = checked(query.path, spacecraft, settings, node_fractions)
    joints = path.joints.shape[1]
    ends = (
        (query.start_angular_velocity, query.start_joint_rates),
        (query.end_angular_velocity, query.end_joint_rates),
    )
    rates = np.stack([np.append(boundary(own, 3)[0], boundary(other, joints)[0]) for own, other in ends])
    limits = np.concatenate([np.full(3, spacecraft.rate_limit), spacecraft.joint_rate_limits])
    worst = np.unravel_index(np.argmax(np.abs(rates) / limits), rates.shape)
    if not np.abs(rates[worst]) <= (1 + _ROUNDING) * limits[worst[1]]:
        raise ValueError(
            f"a rate at the {('start', 'end')[worst[0]]} is {rates[worst]:g} rad/s: "
            f"must be at most {limits[worst[1]]:g}"
        )
    if not (np.all(np.isfinite(path.attitudes)) and np.all(np.isfinite(path.joints))):
        message = "a node of the path is not made of finite numbers"
        return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
    path, own = schedule.passed_nodes(path, at_speed=bool(np.any(rates)), every=node_fractions is not None)
    if len(path.attitudes) == 1:
        still = replace(at_rest(query, path, DEGREE, "global", len(own)), smoothness=SMOOTHNESS)
        return Fit(trajectory=still, status=Status.OK, message="the path has no motion")
    none = tabulate((), (), spacecraft.device_names)
    turns: np.ndarray = yield in_turn(schedule.edge_turns, attitudes=path.attitudes)
    job = Job(
        attitudes=path.attitudes,
        joints=path.joints,
        turns=turns,
        fractions=None if node_fractions is None else np.asarray(node_fractions, float),
        rates=rates,
        spacecraft=spacecraft,
        cones=none if query.cones is None else query.cones,
        settings=settings,
        horizon=query.horizon,
    )
    fit = yield from _fit(job)
    if fit.trajectory is None:
        return fit
    return replace(fit, trajectory=replace(fit.trajectory, node_times=fit.trajectory.node_times[own]))


def _fit(job: Job) -> Steps[Fit]:
    """The fit in the duration that the settings ask for.

    What keeps everything with accelerations of zero at both ends does so where they are free. So a motion
    with free ones is never longer, nor is none found where there is one with zero.
    """
    duration = job.settings.duration
    if not isinstance(duration, str):
        fit = yield from _timed(job, float(duration))
        if fit.status is Status.OK or job.rests:
            return fit
        return _better(fit, (yield from _timed(job.resting, float(duration))))
    stretching = duration == STRETCHED and not job.at_speed
    find, radius = stretched if stretching else shortest, job.radius(free_time=duration == MINIMUM)
    best = yield from find(job.resting, radius)
    fit = yield from _within_limits(job.resting, best, radius)
    if job.rests:
        return fit
    if stretching or best is None or fit.status is not Status.OK:
        best = yield from find(job, radius)
    else:
        best = yield from released(job, best)
    return _better((yield from _within_limits(job, best, radius)), fit)


def _better(fit: Fit, other: Fit) -> Fit:
    """The fit that succeeded or, where both or none did, the one that takes or needs less time."""

    def key(one: Fit) -> tuple[bool, bool, float]:
        found, curve = one.status is Status.OK, one.trajectory
        time = curve.duration if found and curve is not None else one.needed_duration
        return not found, curve is None, np.inf if time is None else time

    return min(fit, other, key=key)


def _timed(job: Job, duration: float) -> Steps[Fit]:
    """The fit in a given duration."""
    radius = job.radius(free_time=False)
    attempt = None if duration < job.bound else (yield from best_at(job, duration, radius))
    if attempt is not None and attempt.peaks.stretch <= 1:
        return _success(job, attempt, radius)
    # The shortest motion says whether there is one at all, and what to ask for.
    best = yield from shortest(job, np.inf)
    if best is None:
        return _beyond()
    if job.at_speed:
        needed = yield from enough_time(job, max(BEGIN * best.trajectory.duration, LONGER * duration))
    else:  # slowing it keeps all limits
        needed = best.needed * SAFETY if best.sound else None
        if needed is not None and needed <= duration:
            return _success(job, hurried(job, best, duration), radius)
    enough = None
    if needed is not None:
        enough = Needed(duration=needed, moving=job.horizon > 0, scalable=True)
    closest = attempt if attempt is not None else hurried(job, best, duration)
    else_try = "lower the rates at start and end" if job.at_speed else 'set it to "minimum"'
    return Fit(
        trajectory=closest.trajectory,
        status=Status.LIMITS_TOO_TIGHT,
        message=too_tight(duration, closest.peaks, enough, else_try),
        needed_duration=needed,
    )


def _within_limits(job: Job, best: Attempt | None, radius: float) -> Steps[Fit]:
    """The fit of a motion in just the time that its limits allow."""
    if best is None:
        return _beyond()
    if not job.at_speed:
        return _success(job, best, radius, stretch=True)
    # Scaling the time would change the rates at the ends: the curve is fitted again where it is too quick.
    duration = best.trajectory.duration
    for look in range(LOOKS):
        if best.peaks.stretch <= 1 and best.sound:
            return _success(job, best, radius)
        tighter = min(TIGHTER[0] + 2 * max(0.0, best.peaks.stretch - 1), TIGHTER[1])
        # Tighter limits alone take longer by as much.
        duration *= np.clip(best.peaks.stretch, 1 + tighter, _MOST_LONGER) ** (2**look)
        again = yield from attempt_at(
            job,
            job.request(job.quickest(), best.radius, 1, graded=True),
            duration,
            limited=True,
            free_time=False,
            tighter=tighter,
        )
        if again is None:
            break
        best = again
    if best.peaks.stretch <= 1:
        return _success(job, best, radius)
    curve = best.trajectory
    message = too_tight(curve.duration, best.peaks, None, "lower the rates at start and end")
    return Fit(trajectory=curve, status=Status.LIMITS_TOO_TIGHT, message=message)


def _success(job: Job, attempt: Attempt, radius: float, *, stretch: bool = False) -> Fit:
    """A fit within all limits on rates and loads, perhaps after its time is stretched to them."""
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
    share = excess(curve.duration, job.bound)
    above = "" if share is None else f", {100 * share:.1f} % above the strict bound"
    message, note = f"{curve.duration:.2f} s{above}; {nearest} is nearest to its limit", ""
    if attempt.radius > radius:
        wide = f"passed within {np.rad2deg(attempt.radius):g} deg"
        how = wide if np.isfinite(attempt.radius) else "only a first guess"
        note = f"nodes are {how}: within trajectory.node_tube_deg no motion was found, or a slow one"
        message = f"{message}; {note}"
    origin = Origin(job=job, attempt=attempt, stretched=stretch)
    return Fit(trajectory=curve, status=Status.OK, message=message, note=note, origin=origin)


def _beyond() -> Fit:
    """No chart holds the path."""
    message = (
        f"the nodes lie more than {np.rad2deg(REACH):.0f} deg off the steady rotation from start to goal: "
        'set trajectory.method to "paper"'
    )
    return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
