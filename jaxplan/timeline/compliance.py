"""Check that a motion does what activities ask for: when each is done, in which order, in which state.

A plan says which activities it does and when; none of that is taken on trust. An activity that lasts must
have a segment of its kind, within its window, for as long as is asked for; one of an instant must have its
state then. That an attitude is held is checked by the polynomials of the motion: Legendre polynomials are at
most one in size, so the sizes of the higher coefficients bound how far a piece departs from its mean.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from jaxplan import so3
from jaxplan.certificate.limits import TOLERANCE
from jaxplan.geometry.vectors import separation
from jaxplan.model.activities import Activity, Segment, Timeline, in_order
from jaxplan.model.directions import as_path
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import Trajectory

_TIME_TOLERANCE = 1e-6  # s, by which a time may be missed because of rounding
_DIFFERENCE_STEP = 1e-4  # s to either side of an instant, over which boresights are moved by their joints
_MAX_DRIFT = 1e-6  # rad/s, by which a beam's rate may differ from its target's at an instant

Done = Mapping[str, tuple[float, float]]
"""When activities begin and end, s, as a plan has it, by name."""


def unmet(
    timeline: Timeline, trajectory: Trajectory, segments: Sequence[Segment], done: Done, *, whole: bool
) -> list[str]:
    """Return a sentence for each thing that activities ask for and a motion does not do.

    How well devices point while they track is left to `proving.pointing_error`.

    Args:
        timeline: what was asked.
        trajectory: the motion over all segments.
        segments: slews and activities in order of time.
        done: begin and end, s, of each activity that is said to be done, by name.
        whole: whether all of the timeline is said to be done, so that a missing activity is a fault.
    """
    faults: list[str] = []
    ended: dict[str, float] = {}
    last = 0.0
    for activity in in_order(timeline.activities):
        if activity.name not in done:
            faults += [f"{activity.name}: is not done"] if whole else []
            continue
        begin, end = done[activity.name]
        found = [
            *_time_faults(activity, begin, end, timeline.until),
            *_visibility_faults(activity, begin, end),
        ]
        if begin < last - _TIME_TOLERANCE:
            found.append(f"begins at {begin:.2f} s, before what is in front of it ends, at {last:.2f} s")
        if activity.after and not ended.get(activity.after, np.inf) <= begin + _TIME_TOLERANCE:
            found.append(f"is not done after {activity.after}")
        if not 0 <= begin <= end <= trajectory.duration + _TIME_TOLERANCE:
            found.append(f"is not within the motion, which ends at {trajectory.duration:.2f} s")
        else:
            found += _motion_faults(timeline.scene.spacecraft, activity, trajectory, segments, begin, end)
        faults += [f"{activity.name}: {fault}" for fault in found]
        ended[activity.name] = last = end
    until = timeline.until
    if whole and until is not None and not trajectory.duration >= until - _TIME_TOLERANCE:
        faults.append(f"the motion ends at {trajectory.duration:.2f} s, the timeline at {until:.2f} s")
    return faults


def _motion_faults(
    craft: Spacecraft,
    activity: Activity,
    trajectory: Trajectory,
    segments: Sequence[Segment],
    begin: float,
    end: float,
) -> Iterator[str]:
    """Yield what an activity asks for that is not met in the motion from `begin` to `end`, s."""
    lasting = activity.kind != "point" and end - begin > _TIME_TOLERANCE
    if lasting and not any(_covers(segment, activity, begin, end) for segment in segments):
        yield f"has no segment from {begin:.2f} s to {end:.2f} s"
    elif activity.attitude is not None:
        yield from _hold_faults(activity.attitude, trajectory, begin, end)
    elif activity.targets is not None and not lasting:
        yield from _pointing_faults(craft, activity.targets, trajectory, begin)


def _covers(segment: Segment, activity: Activity, begin: float, end: float) -> bool:
    """Tell whether a segment belongs to an activity and lasts at least from `begin` to `end`, s."""
    own = (segment.name, segment.kind) == (activity.name, activity.kind)
    return own and segment.start <= begin + _TIME_TOLERANCE and segment.end >= end - _TIME_TOLERANCE


def _time_faults(activity: Activity, begin: float, end: float, until: float | None) -> Iterator[str]:
    """Yield how an activity from `begin` to `end`, s, violates its window or the duration it must have.

    `until` is the end of the timeline, s, or None.
    """
    if activity.earliest is not None and not begin >= activity.earliest - _TIME_TOLERANCE:
        yield f"begins at {begin:.2f} s, not from {activity.earliest:.2f} s on"
    if activity.latest is not None and not end <= activity.latest + _TIME_TOLERANCE:
        yield f"ends at {end:.2f} s, not by {activity.latest:.2f} s"
    lasts = end - begin
    if activity.duration is not None and not lasts >= activity.duration - _TIME_TOLERANCE:
        yield f"lasts {lasts:.2f} s, not {activity.duration:.2f} s"
    last = until if activity.latest is None else activity.latest
    if activity.kind == "point" or activity.duration is not None or last is None:
        return
    if not end >= last - _TIME_TOLERANCE:
        yield f"ends at {end:.2f} s, not at {last:.2f} s"


def _visibility_faults(activity: Activity, begin: float, end: float) -> Iterator[str]:
    """Yield a phrase for each target of an activity that is hidden at some time from `begin` to `end`, s."""
    for path in () if activity.targets is None else activity.targets.paths:
        for span in path.hidden:
            if span.at(begin) or begin < span.start < end - _TIME_TOLERANCE:
                yield f"{span.target} is hidden by {span.by} from {span.start:.2f} s on"


def _hold_faults(state: GivenState, trajectory: Trajectory, begin: float, end: float) -> Iterator[str]:
    """Yield a phrase if attitude or joints leave a given state at any time from `begin` to `end`, s."""
    at = trajectory.sample(np.clip(begin, 0.0, trajectory.duration))
    turned = float(so3.distance(state.attitude, at.attitude))
    joints = np.abs(at.joints - state.joints)
    for piece in _overlapping_pieces(trajectory.breaks, begin, end):
        base, own = trajectory.chart_attitude[piece], trajectory.coefficients[piece]
        # where the chart turns it leaves its base by as much at most
        elapsed = np.max(np.abs(trajectory.breaks[piece : piece + 2] - trajectory.chart_start[piece]))
        away = float(so3.distance(state.attitude, base @ so3.exp(own[0])))
        moved = np.sum(np.linalg.norm(own[1:], axis=-1)) + elapsed * np.linalg.norm(
            trajectory.chart_rate[piece]
        )
        turned = np.maximum(turned, away + moved)  # of which no number that is none is lost
    for piece in _overlapping_pieces(trajectory.joint_breaks, begin, end):
        own = trajectory.joint_coefficients[piece]
        joints = np.maximum(joints, np.abs(own[0] - state.joints) + np.sum(np.abs(own[1:]), axis=0))
    worst = np.max(joints, initial=0.0)
    if not turned <= TOLERANCE:
        yield f"its attitude is held within {np.rad2deg(turned):.3g} deg, not as it is asked for"
    if not worst <= TOLERANCE:
        yield f"its joints are held within {np.rad2deg(worst):.3g} deg, not as they are asked for"


def _overlapping_pieces(breaks: np.ndarray, begin: float, end: float) -> range:
    """Indices of the pieces that overlap times from `begin` to `end`, s, by more than `_TIME_TOLERANCE`."""
    first = int(np.searchsorted(breaks, begin + _TIME_TOLERANCE, side="right")) - 1
    last = int(np.searchsorted(breaks, end - _TIME_TOLERANCE))
    return range(max(first, 0), min(last, len(breaks) - 1))


def _pointing_faults(
    craft: Spacecraft, targets: Targets, trajectory: Trajectory, time: float
) -> Iterator[str]:
    """Yield a phrase for each device that at `time`, s, misses its target or moves otherwise than that."""
    at = trajectory.sample(np.clip(time, 0.0, trajectory.duration))
    when = np.array([time])
    change = _DIFFERENCE_STEP * np.array([-1.0, 0.0, 1.0])[:, None] * at.joint_rates
    moving = np.asarray(craft.gimbals.boresights(at.joints + change))
    still = np.broadcast_to(craft.fixed_boresights, (len(moving), *craft.fixed_boresights.shape))
    beams = np.concatenate([moving, still], axis=1)
    for name, number, path in zip(targets.names(craft), targets.numbers(craft), targets.paths, strict=True):
        toward, beam = as_path(path), beams[:, number]
        off = float(separation(at.attitude @ beam[1], np.asarray(toward.at(when))[0]))
        if not off <= float(targets.tolerance):
            yield f"{name} is off its target by {np.rad2deg(off):.3g} deg at {time:.2f} s"
        turning = np.cross(at.angular_velocity, beam[1]) + (beam[2] - beam[0]) / (2 * _DIFFERENCE_STEP)
        drift = float(np.linalg.norm(at.attitude @ turning - np.asarray(toward.rate(when))[0]))
        if not drift <= _MAX_DRIFT:
            yield f"{name} moves by {np.rad2deg(drift):.3g} deg/s otherwise than its target at {time:.2f} s"
