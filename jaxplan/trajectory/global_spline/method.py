"""Step 3 by one spline: how long, in how many intervals, and what to do where a limit or a zone is broken."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jaxplan.path import Path
from jaxplan.scenario.model import MINIMUM, STRETCHED, TrajectorySettings
from jaxplan.spacecraft import Spacecraft
from jaxplan.status import Status
from jaxplan.trajectory import schedule
from jaxplan.trajectory.bound import duration_bound
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.fit import Fit, at_rest, boundary, check, too_tight
from jaxplan.trajectory.global_spline import sqp
from jaxplan.trajectory.global_spline.bases import DEGREE, SMOOTHNESS, Basis
from jaxplan.trajectory.global_spline.build import Request, build, trajectory
from jaxplan.trajectory.global_spline.chart import REACH
from jaxplan.trajectory.global_spline.families import TUBE
from jaxplan.trajectory.global_spline.timing import Pace, full_speed_times
from jaxplan.trajectory.scaling import SAFETY, Peaks, peaks
from jaxplan.zones import Cones, tabulate

TUBE_RADIUS = float(
    np.deg2rad(1.0)
)  # about the nodes, unless the settings have one; a shortest motion has none

_INTERVALS = 32  # of a spline, or a multiple of it
_NODES_EACH = 1.5  # intervals for a node that is passed exactly
_NODES_IN_TUBE = 2 / 3  # likewise for one in a tube
_POINTS, _FEW_POINTS, _MANY = 8, 4, 128  # places on each interval, and on each of many
_BEGIN = 1.01  # of the duration of a trapezoid, whose accelerations jump
_TIGHTER = (
    1e-3,
    1e-2,
)  # shares of the limits left to what happens between the places, in one attempt and the next
_TUBE_BROKEN = 1e-6  # rad
_KEPT = 0.3  # of the wanted margins, which a sound curve has
_LONGER = 1.02  # from one duration to the next, when one is looked for that is long enough
_LOOKS = 8
_TELLING = 0.01  # of the duration: a lower bound, as of a path that ends where it starts, tells nothing
_WIDER = 3.0  # tube, before there is none
_HURRY = 0.97  # of the time along the nodes, below which they are only a first guess


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
        the last word on them.

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
    distinct = schedule.distinct_nodes(path)
    if np.sum(distinct) == 1 and not np.any(rates):
        still = replace(at_rest(path, DEGREE, "global"), smoothness=SMOOTHNESS)
        return Fit(trajectory=still, status=Status.OK, message="the path has no motion")
    if len(distinct) == 1:  # it leaves its node and comes back to it
        attitudes, angles = np.repeat(path.attitudes, 2, axis=0), np.repeat(path.joints, 2, axis=0)
        path, distinct = Path(attitudes=attitudes, joints=angles, edge_costs=np.ones(1)), np.ones(2, bool)
    distinct[-1] |= np.sum(distinct) == 1
    if node_fractions is not None:
        distinct = np.ones_like(distinct)
    none = tabulate((), (), spacecraft.device_names)
    job = _Job(
        attitudes=np.asarray(path.attitudes, float)[distinct],
        joints=np.asarray(path.joints, float)[distinct],
        fractions=None if node_fractions is None else np.asarray(node_fractions, float),
        rates=rates,
        spacecraft=spacecraft,
        cones=none if cones is None else cones,
        settings=settings,
    )
    fit = _fit(job)
    if fit.trajectory is None:
        return fit
    times = fit.trajectory.node_times[np.cumsum(distinct) - 1]
    return replace(fit, trajectory=replace(fit.trajectory, node_times=times))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Job:
    """What all attempts share."""

    attitudes: np.ndarray
    joints: np.ndarray
    fractions: np.ndarray | None
    rates: np.ndarray
    spacecraft: Spacecraft
    cones: Cones
    settings: TrajectorySettings

    @property
    def at_speed(self) -> bool:
        """Whether the motion starts or ends with a rate."""
        return bool(np.any(self.rates))

    @property
    def weights(self) -> tuple[float, float, float]:
        """Of rate, acceleration and jerk."""
        settings = self.settings
        return settings.rate_weight, settings.acceleration_weight, settings.jerk_weight

    def radius(self, free_time: bool) -> float:
        """Of the tube, rad."""
        if self.settings.node_tube is not None:
            return float(self.settings.node_tube)
        return np.inf if free_time else TUBE_RADIUS

    @cached_property
    def bound(self) -> float:
        """No motion between the two ends is quicker, s."""
        ends = [0, -1]
        return duration_bound(
            self.spacecraft, self.attitudes[ends], self.joints[ends], self.rates[:, :3], self.rates[:, 3:]
        )

    @cached_property
    def times(self) -> np.ndarray:
        """(m,) s of each edge at full speed."""
        moves = np.column_stack([schedule.edge_turns(self.attitudes), np.diff(self.joints, axis=0)])
        return full_speed_times(moves, _limits(self.spacecraft)[0])

    @property
    def rise(self) -> float:
        """In which every axis reaches its full rate, s."""
        rate, acceleration = _limits(self.spacecraft)
        return float(np.max(rate / acceleration))

    def quickest(self) -> Pace:
        """The pace at full speed along the path."""
        return Pace.quickest(max(float(np.sum(self.times)), self.bound / 100, 1e-6 * self.rise), self.rise)

    def request(self, pace: Pace, radius: float, finer: int, *, graded: bool) -> Request:
        """What to fit at a pace.

        Args:
            pace: along the path.
            radius: rad, of the tube.
            finer: factor on the number of intervals.
            graded: whether breaks lie close about the flanks, not as the nodes do.
        """
        count = len(self.attitudes) - 1
        shares = schedule.node_fractions(self.times)
        if self.fractions is not None:
            places = self.fractions
        else:
            places = shares if self.at_speed else pace.places(shares)
        each = _NODES_EACH if radius == 0 else _NODES_IN_TUBE if np.isfinite(radius) else 0.0
        intervals = finer * _INTERVALS * max(1, int(np.ceil(each * count / _INTERVALS)))
        if radius == 0:  # as many breaks between nodes as there are elsewhere
            basis = Basis.on(np.interp(np.linspace(0, count, intervals + 1), np.arange(count + 1), places))
        elif graded and not self.at_speed:
            basis = Basis.on(pace.breaks(intervals))
        else:
            basis = Basis.even(intervals)
        return Request(
            attitudes=self.attitudes,
            joints=self.joints,
            places=places,
            rates=self.rates,
            basis=basis,
            points=_POINTS if intervals < _MANY else _FEW_POINTS,
            radius=radius,
            rest=self.settings.end_acceleration == "zero",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attempt:
    """A curve, and what it breaks.

    Attributes:
        trajectory: of the curve.
        peaks: over all time.
        clear: whether zones are kept at the places.
        radius: rad, of the tube that was tried.
        tube: rad, how far nodes are beyond the tube that was asked for; zero or less for none.
    """

    trajectory: Trajectory
    peaks: Peaks
    clear: bool
    radius: float
    tube: float

    @property
    def sound(self) -> bool:
        """Whether nothing is broken but perhaps limits of rates and loads."""
        return self.clear and self.peaks.in_range and self.tube <= _TUBE_BROKEN

    @property
    def kept(self) -> bool:
        """Whether all limits are kept."""
        return self.peaks.stretch <= 1 and self.peaks.in_range

    @property
    def merit(self) -> tuple[bool, bool, bool, float]:
        """The larger the better."""
        inside = self.clear and self.peaks.in_range
        return inside, self.kept, self.tube <= _TUBE_BROKEN, -self.peaks.stretch


def _limits(spacecraft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Rates and accelerations of platform and joints (3 + 2n,)."""
    return (
        np.concatenate([np.full(3, spacecraft.rate_limit), spacecraft.joint_rate_limits]),
        np.concatenate([np.full(3, spacecraft.acceleration_limit), spacecraft.joint_acceleration_limits]),
    )


def _tightened(spacecraft: Spacecraft, share: float) -> Spacecraft:
    """The spacecraft with the platform's limits a little lower; joints are held at every instant anyway."""
    names = ("rate_limit", "acceleration_limit", "jerk_limit", "torque_limit", "wheel_momentum_limit")
    limits = {name: getattr(spacecraft, name) for name in names}
    return replace(
        spacecraft, **{name: limit * (1 - share) for name, limit in limits.items() if limit is not None}
    )


def _fit(job: _Job) -> Fit:
    """The fit in the duration that the settings ask for."""
    duration = job.settings.duration
    if duration == MINIMUM or (duration == STRETCHED and job.at_speed):
        return _free(job, job.radius(free_time=duration == MINIMUM))
    if duration == STRETCHED:
        return _stretched(job)
    return _timed(job, float(duration))


def _ladder(radius: float, *, in_time: bool = True) -> Iterator[tuple[int, float]]:
    """Factors on the number of intervals and radii of the tube, one attempt after the other.

    Args:
        radius: rad, asked for.
        in_time: whether there is time enough to go along the nodes.
    """
    if radius == 0 or (in_time and radius < np.inf):
        yield 1, radius
        yield 2, radius
    if 0 < radius < np.inf and in_time:
        yield 1, _WIDER * radius
    if radius > 0:
        yield 1, np.inf
        yield 2, np.inf


def _attempt(
    job: _Job, request: Request, duration: float, *, limited: bool, free_time: bool, tighter: float = 0.0
) -> _Attempt | None:
    """Fit a request; None if its nodes leave the chart or numbers overflow."""
    craft = _tightened(job.spacecraft, tighter) if tighter else job.spacecraft
    built = build(
        request, craft, job.cones, duration, weights=job.weights, limited=limited, free_time=free_time
    )
    if not built.reach <= REACH:
        return None
    task = built.task
    point = sqp.improve(task, task.point(built.coefficients, duration))
    if not (np.all(np.isfinite(point.coefficients)) and point.motion.is_finite()):
        return None
    curve = trajectory(task, point, point.duration * request.places)
    found = peaks(curve, job.spacecraft)
    if not np.isfinite(found.stretch):
        return None
    return _Attempt(
        trajectory=curve,
        peaks=found,
        clear=bool(np.all(point.motion.margins >= _KEPT * task.wanted)),
        radius=request.radius,
        tube=point.violations[TUBE],
    )


def _timed(job: _Job, duration: float) -> Fit:
    """The fit in a given duration."""
    attempt = None if duration < job.bound else _best_at(job, duration)
    if attempt is not None and attempt.kept:
        return _success(job, attempt, job.radius(free_time=False))
    # The shortest motion says whether there is one at all, and what to ask for.
    shortest = _shortest(job, np.inf)
    if shortest is None:
        return _beyond(job)
    needed = max(_BEGIN * shortest.trajectory.duration, _LONGER * duration)
    for look in range(_LOOKS):
        enough = _best_at(job, needed)
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


def _hurried(job: _Job, attempt: _Attempt, duration: float) -> _Attempt:
    """The same motion in another duration."""
    curve = attempt.trajectory.scaled(duration / attempt.trajectory.duration)
    return replace(attempt, trajectory=curve, peaks=peaks(curve, job.spacecraft))


def _best_at(job: _Job, duration: float) -> _Attempt | None:
    """The first sound attempt within all limits, or the one nearest to it; None beyond every chart."""
    quickest, radius = job.quickest(), job.radius(free_time=False)
    pace = Pace.within(duration, quickest.length, job.rise)
    in_time = job.at_speed or duration >= _HURRY * quickest.duration
    best = None
    for finer, wide in _ladder(radius, in_time=in_time):
        for tighter in _TIGHTER:
            request = job.request(pace, wide, finer, graded=False)
            attempt = _attempt(job, request, duration, limited=True, free_time=False, tighter=tighter)
            if attempt is None:
                return best
            if best is None or attempt.merit > best.merit:
                best = attempt
            if not 1 < attempt.peaks.stretch <= 1 + tighter:  # more than what happens between the places
                break
        if best is not None and best.kept and best.sound:
            break
    return best


def _stretched(job: _Job) -> Fit:
    """The fit at the quickest pace without limits, scaled in time to the limits."""
    pace, asked = job.quickest(), job.radius(free_time=False)
    best = None
    for finer, radius in _ladder(asked):
        request = job.request(pace, radius, finer, graded=True)
        attempt = _attempt(job, request, _BEGIN * pace.duration, limited=False, free_time=False)
        if attempt is None:
            break
        if best is None or attempt.merit > best.merit:
            best = attempt
        if attempt.sound:
            break
    return _beyond(job) if best is None else _success(job, best, asked, stretch=True)


def _shortest(job: _Job, radius: float) -> _Attempt | None:
    """The shortest motion, before its time is stretched to what lies between the places."""
    pace = job.quickest()
    best = None
    for finer, wide in _ladder(radius):
        request = job.request(pace, wide, finer, graded=True)
        attempt = _attempt(job, request, _BEGIN * pace.duration, limited=True, free_time=True)
        if attempt is None:
            break
        if best is None or attempt.merit > best.merit:
            best = attempt
        if attempt.sound:
            break
    return best


def _free(job: _Job, radius: float) -> Fit:
    """The shortest motion."""
    best = _shortest(job, radius)
    if best is None:
        return _beyond(job)
    if not job.at_speed:
        return _success(job, best, radius, stretch=True)
    # Scaling the time would change the rates at the ends: the curve is fitted again where it is too quick.
    duration = best.trajectory.duration
    for look in range(_LOOKS):
        if best.kept:
            return _success(job, best, radius)
        duration *= max(best.peaks.stretch, 1 + _TIGHTER[0]) ** (2**look)
        curve = best.trajectory
        again = _attempt(
            job,
            job.request(job.quickest(), radius, 1, graded=True),
            duration,
            limited=True,
            free_time=False,
            tighter=_TIGHTER[0],
        )
        if again is None:
            break
        best = again
    return Fit(
        trajectory=curve,
        status=Status.LIMITS_TOO_TIGHT,
        message=too_tight(curve.duration, best.peaks, None),
    )


def _success(job: _Job, attempt: _Attempt, radius: float, *, stretch: bool = False) -> Fit:
    """A fit that is OK, perhaps after its time is stretched to the limits; the tube asked for is named."""
    curve = attempt.trajectory
    if stretch:
        curve = curve.scaled(attempt.peaks.stretch * SAFETY)
    nearest = attempt.peaks.names[attempt.peaks.binding]
    above = ""
    if job.bound > _TELLING * curve.duration:
        above = f", {100 * (curve.duration / job.bound - 1):.1f} % above the strict bound"
    message = f"{curve.duration:.2f} s{above}; {nearest} is nearest to its limit"
    if attempt.radius > radius:
        wide = f"{np.rad2deg(attempt.radius):g} deg" if np.isfinite(attempt.radius) else "any distance"
        message += f"; within trajectory.node_tube_deg nothing was found, nodes are passed within {wide}"
    return Fit(trajectory=curve, status=Status.OK, message=message)


def _beyond(job: _Job) -> Fit:
    """No chart holds the path."""
    message = (
        f"the nodes lie more than {np.rad2deg(REACH):.0f} deg off the steady rotation from start to goal: "
        'set trajectory.method to "paper"'
    )
    return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
