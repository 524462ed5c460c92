"""What is fitted: the nodes with all that is asked of the curve, and one attempt at it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jaxplan.model.constraints import Constraints
from jaxplan.model.limits import Kinematics, limits
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import schedule
from jaxplan.trajectory.asking import Ask, Steps, in_turn
from jaxplan.trajectory.bound import duration_bound
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.global_spline import sqp
from jaxplan.trajectory.global_spline.bases import Basis
from jaxplan.trajectory.global_spline.build import Built, Request, build, trajectory, wanted_margins
from jaxplan.trajectory.global_spline.chart import REACH, farthest, fitting
from jaxplan.trajectory.global_spline.problem import Problem
from jaxplan.trajectory.global_spline.rows import TUBE
from jaxplan.trajectory.global_spline.stack import Point, Task
from jaxplan.trajectory.global_spline.timing import Pace
from jaxplan.trajectory.scaling import Peaks, all_peaks

# About the nodes, unless the settings have one; a shortest motion has none.
TUBE_RADIUS = float(np.deg2rad(1.0))

_INTERVALS = 32  # of a spline, or a multiple of it
_NODES_EACH = 1.5  # intervals for a node that is passed exactly
_NODES_IN_TUBE = 2 / 3  # likewise for one in a tube
_POINTS, _FEW_POINTS, _MANY = 8, 4, 128  # places on each interval, and on each of many
_TUBE_BROKEN = 1e-6  # rad
_DEEP = float(np.deg2rad(0.3))
_ROUNDING = 1e-9  # rad
_KEPT = 0.3  # of the wanted margins, which a sound curve has
_MENDED = 1e-3  # of a limit, beyond which a curve is not what a given duration needs
_NEARLY = 1.01  # of the duration keeps all limits: what happens between the places is still to be mended
_WIDER = 3.0  # tube, before there is none


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """What all attempts share."""

    attitudes: np.ndarray
    joints: np.ndarray
    turns: np.ndarray
    fractions: np.ndarray | None
    rates: np.ndarray
    spacecraft: Spacecraft
    cones: Constraints
    settings: TrajectorySettings
    horizon: float = 0.0

    @property
    def at_speed(self) -> bool:
        """Whether the motion starts or ends with a rate."""
        return bool(np.any(self.rates))

    @property
    def rests(self) -> bool:
        """Whether accelerations are zero at both ends; else they are free."""
        return self.settings.end_acceleration == "zero"

    @property
    def resting(self) -> "Job":
        """The same with accelerations of zero at both ends: what solves it solves this."""
        return self if self.rests else replace(self, settings=replace(self.settings, end_acceleration="zero"))

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
    def moves(self) -> np.ndarray:
        """(m, 3 + 2n) rad along each edge."""
        return np.column_stack([self.turns, np.diff(self.joints, axis=0)])

    @cached_property
    def times(self) -> np.ndarray:
        """(m,) s of each edge at full speed."""
        platform, joints = self.moves[:, :3].T, self.moves[:, 3:].T
        # In a second every edge is gone along at a steady pace, which is to be slowed to the limits.
        steady = Kinematics(spin=[platform], joints=[0 * joints, joints], inertia=self.spacecraft.inertia)
        paced = [limit for limit in limits(self.spacecraft) if limit.quantity.power == 1]
        return np.max(np.concatenate([limit.shares(steady) for limit in paced]), axis=0)

    @cached_property
    def rise(self) -> float:
        """In which the axis with the longest way reaches its full rate, s."""
        rate, acceleration, jerk = (_about_any_axis(self.spacecraft, power) for power in (1, 2, 3))
        needed = rate / acceleration + acceleration / jerk
        return float(needed[np.argmax(np.sum(np.abs(self.moves), axis=0) / rate)])

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
            rest=self.rests,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempt:
    """A curve, and what it breaks.

    Attributes:
        task: what was looked for.
        point: the curve that was found.
        request: what it was made for.
        trajectory: of the curve.
        peaks: over all time.
        clear: whether zones are kept at the places, with some of the clearance.
        breach: what breaks a zone, by name, and by how much (rad); None where none does.
        tube: rad, how far nodes are beyond it; zero or less where they are within.
    """

    task: Task
    point: Point
    request: Request
    trajectory: Trajectory
    peaks: Peaks
    clear: bool
    breach: tuple[str, float] | None
    tube: float

    @property
    def radius(self) -> float:
        """Of the tube that was tried, rad."""
        return self.request.radius

    @property
    def sound(self) -> bool:
        """Whether nothing is broken but perhaps limits of rates and loads."""
        return self.clear and self.peaks.in_range and self.tube <= _TUBE_BROKEN

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
        """The larger the better."""
        inside, nearly = self.clear and self.peaks.in_range, self.peaks.stretch <= _NEARLY
        return inside, nearly, self.tube <= _TUBE_BROKEN, -self.peaks.stretch


def _about_any_axis(spacecraft: Spacecraft, power: int) -> np.ndarray:
    """Bounds (3 + 2n,) of this derivative of the motion that hold whatever axis it is about, or inf.

    Those of the momentum are left to `Job.times`, which knows the axis of each edge.
    """
    platform, joints = np.full(3, np.inf), np.full(len(spacecraft.joint_names), np.inf)
    heaviest = 1.0 if spacecraft.inertia is None else np.linalg.norm(spacecraft.inertia, 2)
    for limit in limits(spacecraft):
        quantity = limit.quantity
        if quantity.power != power or (quantity.by_inertia and power == 1):
            continue
        if quantity.of_joints:
            joints = limit.bound
        else:
            platform = np.minimum(platform, np.min(limit.bound) / (heaviest if quantity.by_inertia else 1.0))
    return np.concatenate([platform, joints])


def ladder(radius: float, *, in_time: bool = True) -> Iterator[tuple[int, float]]:
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


def attempt_at(
    job: Job,
    request: Request,
    duration: float,
    *,
    limited: bool,
    free_time: bool,
    tighter: float = 0.0,
    begin: np.ndarray | None = None,
) -> Steps[Attempt | None]:
    """Fit a request.

    Args:
        job: what all attempts share.
        request: what to fit.
        duration: s, given or to begin with.
        limited: whether limits are kept, or time will be stretched to them.
        free_time: whether the shortest duration is looked for.
        tighter: share of the platform's limits that is left; joints are held at every instant anyway.
        begin: (n, A) coefficients of the curve to begin with, the one nearest to the path by default.

    Returns:
        The attempt; None if the nodes leave the chart or numbers overflow.
    """
    chart, b = yield in_turn(fitting, attitudes=request.attitudes, places=request.places)
    if not farthest(chart, b, request.places) <= REACH:
        return None
    problem = Problem(
        chart=chart, spacecraft=job.spacecraft, cones=job.cones, horizon=job.horizon, share=1 - tighter
    )
    wanted: np.ndarray = yield Ask(wanted_margins, (problem, request))
    built: Built = yield in_turn(
        build,
        request=request,
        problem=problem,
        b=b,
        wanted=wanted,
        duration=duration,
        weights=job.weights,
        limited=limited,
        free_time=free_time,
    )
    task = built.task
    begin = built.coefficients if begin is None else begin
    first = sqp.Begin(task=task, coefficients=begin, duration=duration)
    point = yield from _nearby(job, first)
    if not (point.duration > 0 and np.all(np.isfinite(point.coefficients)) and point.finite):
        return None
    curve = trajectory(task, point, point.duration * request.places)
    found: Peaks = yield Ask(all_peaks, (curve, job.spacecraft))
    if not np.isfinite(found.stretch):
        return None
    return Attempt(
        task=task,
        point=point,
        request=request,
        trajectory=curve,
        peaks=found,
        clear=bool(np.all(point.margins >= _KEPT * task.wanted)),
        breach=_breach(point.margins, job),
        tube=float(point.violations[TUBE]),
    )


def _nearby(job: Job, first: sqp.Begin) -> Steps[Point]:
    """The best curve near the first one; in a given time one that is far too quick is left as it is."""
    task = first.task
    if not (task.free_time or job.at_speed):
        first = replace(first, patience=0.0 if task.limited else _MENDED)
    point: Point = yield Ask(sqp.improve, first)
    if task.limited and point.steps == 0:
        # From a curve that is far too quick a program leads nowhere: one is made that is slow enough.
        free = replace(first, task=replace(task, free_time=True), until=first.duration, patience=np.inf)
        slower: Point = yield Ask(sqp.improve, free)
        slow = replace(first, coefficients=slower.coefficients, patience=_MENDED)
        point = yield Ask(sqp.improve, slow)
    return point


def _breach(margins: np.ndarray, job: Job) -> tuple[str, float] | None:
    """Of margins (S, D, Z); axes of the body go by the name of the body, what terminals carry by theirs."""
    if np.all(margins >= -_ROUNDING):
        return None
    _, sight, _ = np.unravel_index(np.argmin(margins), margins.shape)
    names, cones = job.spacecraft.device_names, job.cones
    carriers = [names[terminal] for terminal in cones.carrier]
    return (*names, *["the body"] * len(cones.body), *carriers)[sight], -float(np.min(margins))
