"""Step 3 by the method of the paper: how long, in how many segments, and whether the result keeps its limits.

The scheme itself is `chain`. It holds limits at joins only, so the peaks over all time are looked at
afterwards, and a trajectory that breaks a limit anywhere is no success.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from jaxplan.model.constraints import Constraints
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.trajectory import schedule
from jaxplan.trajectory.asking import Ask, Steps, alone, in_turn
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.fit import Fit, FitQuery, Needed, at_rest, boundary, checked, too_tight, within_limits
from jaxplan.trajectory.paper import counting
from jaxplan.trajectory.paper.chain import Nodes, fit_nodes
from jaxplan.trajectory.paper.holding import Origin
from jaxplan.trajectory.scaling import SAFETY, Peaks, all_peaks

_DEFAULT_SEGMENTS = 3
_MORE_SEGMENTS = 1.5  # growth of their number from one attempt to the next
_LONGER = 1.001  # beyond the time that the last curve asks for, when a needed duration is looked for
_LOOKS = 12
_CALM = 2.5  # nominal durations; on the nodes of the paper's cases a fit needs 1.5 to 2.1 of them


def fit_paper(
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
    """Fits a trajectory through all nodes of a path.

    A number for ``settings.duration`` is kept. Where a program has no solution more segments are tried, up to
    one an interval; where the curve breaks a limit or leaves a joint's range, for as long as that helps.

    "stretched" fits once and without limits, at the duration at which the differences of the nodes just keep
    them, and scales the curve in time until its first limit binds, short of a millionth. That duration is
    about half of the final one; since the weights act in seconds another choice would give another curve,
    but the final duration depends on it by a few per cent only. Scaling would change a rate at the start or
    end: with one, the fit is repeated at longer durations instead, until all limits are kept.

    There are three segments unless ``settings.segments`` asks for another number, and more where the counting
    rule or the reach of a chart needs them. A curve may also swing between its nodes, when they are uneven or
    leave its segments next to no freedom. So where a stretched one needs more than 2.5 times the nominal
    duration or leaves a joint's range, or its segments are full and their number was not asked for, more
    are tried and the quickest is taken.

    Args:
        path: m + 1 nodes; the edges' costs share out the time.
        spacecraft: its limits.
        settings: of step 3.
        cones: the zones, which this method does not look at.
        node_fractions: (m + 1,) times of the nodes as fractions of the duration, strictly increasing from 0
            to 1, instead of what the costs say.
        start_angular_velocity: (3,) rad/s, body axes; zero by default, as are the next three.
        start_joint_rates: (2n,) rad/s.
        end_angular_velocity: (3,) rad/s, body axes.
        end_joint_rates: (2n,) rad/s.
        horizon: s, after which goal or zones that move are where they are, which this method does not look
            at.

    Returns:
        The fit. A path without motion gives a trajectory of duration 0, unless it starts or ends with a rate.

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
    """`fit_paper` as a generator, see `asking`."""
    spacecraft, settings, node_fractions = query.spacecraft, query.settings, query.node_fractions
    path = checked(query.path, spacecraft, settings, node_fractions)
    joints = path.joints.shape[1]
    start = boundary(query.start_angular_velocity, 3), boundary(query.start_joint_rates, joints)
    end = boundary(query.end_angular_velocity, 3), boundary(query.end_joint_rates, joints)
    at_speed = any(np.any(rate != 0) for rate in (*start, *end))
    path, own = schedule.passed_nodes(path, at_speed=at_speed, every=node_fractions is not None)
    if len(path.attitudes) == 1:
        trajectory = at_rest(query, path, settings.order, "paper", len(own))
        return Fit(trajectory=trajectory, status=Status.OK, message="the path has no motion")
    fractions = schedule.node_fractions(path.edge_costs) if node_fractions is None else node_fractions
    turns: np.ndarray = yield in_turn(schedule.edge_turns, attitudes=path.attitudes)
    nodes = Nodes(
        attitudes=path.attitudes,
        joints=path.joints,
        fractions=np.asarray(fractions, float),
        turns=turns,
        start=start,
        end=end,
    )
    task = _Task(
        nodes=nodes, spacecraft=spacecraft, settings=settings, at_speed=at_speed, moving=query.horizon > 0
    )
    fit = yield from _fit(task)
    if fit.trajectory is None:
        return fit
    return replace(fit, trajectory=replace(fit.trajectory, node_times=fit.trajectory.node_times[own]))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """What all attempts of a fit share.

    Attributes:
        nodes: of the path.
        spacecraft: its limits.
        settings: of step 3.
        at_speed: whether the motion starts or ends with a rate.
        moving: whether goal or zones are others after another time.
    """

    nodes: Nodes
    spacecraft: Spacecraft
    settings: TrajectorySettings
    at_speed: bool
    moving: bool

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Rates and accelerations of the platform (2, 3) and of the joints (2, 2n)."""
        craft = self.spacecraft
        platform = np.repeat([[craft.rate_limit], [craft.acceleration_limit]], 3, axis=1)
        return platform, np.stack([craft.joint_rate_limits, craft.joint_acceleration_limits])

    @property
    def nominal_duration(self) -> float:
        """Shortest duration by the nodes alone, and time to brake what the ends ask for, s."""
        rates, accelerations = np.hstack(self.limits)
        ends = np.abs(np.hstack(self.nodes.start)[0]) + np.abs(np.hstack(self.nodes.end)[0])
        moves = counting.shortest_duration(self.nodes.moves, self.nodes.fractions, rates, accelerations)
        return moves + float(np.max(ends / accelerations))

    def segment_counts(self) -> Iterator[int]:
        """Numbers of segments to try, from as few as wanted up to one an interval."""
        intervals, order = len(self.nodes.turns), self.settings.order
        count = max(self.settings.segments or _DEFAULT_SEGMENTS, counting.fewest_segments(intervals, order))
        while count < intervals:
            if counting.charts_suffice(self.nodes.turns, counting.split(intervals, count, order)[1]):
                yield count
            count = max(count + 1, int(_MORE_SEGMENTS * count))
        yield intervals

    def attempt(self, duration: float, segments: int, *, limited: bool) -> Steps["_Attempt | None"]:
        """A trajectory with its peaks; with limits at its joins or without."""
        platform, joints = self.limits
        limits = (platform / SAFETY, joints / SAFETY) if limited else None
        trajectory = yield from fit_nodes(self.nodes, duration, segments, self.settings, limits)
        if trajectory is None:
            return None
        found: Peaks = yield Ask(all_peaks, (trajectory, self.spacecraft))
        origin = Origin(nodes=self.nodes, trajectory=trajectory, limits=limits)
        return (
            _Attempt(trajectory=trajectory, peaks=found, origin=origin)
            if np.isfinite(found.stretch)
            else None
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attempt:
    """A trajectory with its peaks, and how it came about."""

    trajectory: Trajectory
    peaks: Peaks
    origin: Origin

    def better_than(self, other: "_Attempt | None") -> bool:
        """Whether its joints keep their range where the other's do not, or else it needs less time."""
        if other is None or self.peaks.in_range != other.peaks.in_range:
            return other is None or self.peaks.in_range
        return self.peaks.stretch < other.peaks.stretch


def _fit(task: _Task) -> Steps[Fit]:
    """The fit at the duration that the settings ask for."""
    if task.settings.duration != "stretched":
        return (yield from _timed(task, float(task.settings.duration)))
    if task.at_speed:
        needed = yield from _needed_duration(task, task.nominal_duration)
        return (yield from _timed(task, needed or task.nominal_duration))
    return (yield from _stretched(task))


def _timed(task: _Task, duration: float) -> Steps[Fit]:
    """The fit at a given duration."""
    attempt = yield from _best_at(task, duration)
    if attempt is None:
        needed = yield from _needed_duration(task, 2 * duration)
        advice = (
            f"; {_enough(task, needed)}" if needed else ": raise trajectory.duration_s or trajectory.segments"
        )
        message = f"with any number of segments a quadratic program has no solution in {duration:g} s{advice}"
        return Fit(trajectory=None, status=Status.INFEASIBLE, message=message, needed_duration=needed)
    trajectory, stretch = attempt.trajectory, attempt.peaks.stretch
    if stretch <= 1:
        message = within_limits(trajectory, attempt.peaks)
        return Fit(trajectory=trajectory, status=Status.OK, message=message, origin=attempt.origin)
    needed = yield from _needed_duration(task, _LONGER * stretch * duration)
    message = too_tight(
        duration,
        attempt.peaks,
        _enough(task, needed) if needed else None,
        "raise trajectory.segments, or lower the rates at start and end",
    )
    return Fit(trajectory=trajectory, status=Status.LIMITS_TOO_TIGHT, message=message, needed_duration=needed)


def _enough(task: _Task, duration: float) -> Needed:
    """A duration that was found, for a message; "stretched" knows no rates at the ends, nor what moves."""
    return Needed(duration=duration, moving=task.moving, scalable=not (task.at_speed or task.moving))


def _best_at(task: _Task, duration: float) -> Steps[_Attempt | None]:
    """The attempt with the fewest segments that keeps all limits; where none does, the one nearest to it.

    More segments are tried for as long as they help.
    """
    best = None
    for count in task.segment_counts():
        attempt = yield from task.attempt(duration, count, limited=True)
        if attempt is None:
            continue
        if not attempt.better_than(best):
            break
        best = attempt
        if best.peaks.stretch <= 1 and best.peaks.in_range:
            break
    return best


def _needed_duration(task: _Task, duration: float) -> Steps[float | None]:
    """A duration, from the given one on, at which a fit keeps all limits; None if the looks run out.

    A curve's own stretch is not enough, since the fit at the longer time is another curve.
    """
    for look in range(_LOOKS):
        attempt = yield from _best_at(task, duration)
        stretch = 2.0 if attempt is None else attempt.peaks.stretch
        if stretch <= 1:
            return duration
        duration *= stretch * _LONGER ** (2**look)  # in ever longer steps, should it not settle
    return None


def _stretched(task: _Task) -> Steps[Fit]:
    """The quickest of the fits at the nominal duration without limits, scaled in time to the limits."""
    best = None
    for count in task.segment_counts():
        attempt = yield from task.attempt(task.nominal_duration, count, limited=False)
        if attempt is not None and attempt.better_than(best):
            best = attempt
        full = task.settings.segments is None and counting.is_full(
            len(task.nodes.turns), count, task.settings.order
        )
        if best is not None and best.peaks.stretch <= _CALM and best.peaks.in_range and not full:
            break
    if best is None:
        message = "with any number of segments a quadratic program has no solution: change trajectory.order"
        return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
    trajectory = best.trajectory.scaled(best.peaks.stretch * SAFETY)
    message = within_limits(trajectory, best.peaks)
    return Fit(trajectory=trajectory, status=Status.OK, message=message, origin=best.origin)
