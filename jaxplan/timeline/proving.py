"""What is proved of a timeline's plan: limits and zones at every instant, and how well devices point.

The certificate of the whole is made of those of its segments, each from the prover of single plans, and of
checks where they join: two successive segments must have the same attitude, joints, rates and accelerations
there. What wheels hold follows from the total momentum, which stays as it is at the start; each segment
begins with what they hold then.

How well devices point is the largest angle from their targets. Its bound is proved as the margin of a cone
about each target as it moves.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from jaxplan.certificate import Certificate, Claim, EndState, certify, faults_later, prove_margins
from jaxplan.certificate.limits import TOLERANCE
from jaxplan.model.activities import Segment, Timeline
from jaxplan.model.goals import Targets
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.model.time_shift import later
from jaxplan.model.zones import KeepIn
from jaxplan.timeline import curves
from jaxplan.timeline.compliance import Done, unmet
from jaxplan.timeline.tracking import State
from jaxplan.timeline.wheel_momentum import holding, total_in
from jaxplan.trajectory import Trajectory

_CONE_FACTOR = 2.0  # times the tolerance: half angle of the keep-in cone about a target, for the proof
_MAX_HALF_ANGLE = 0.5  # rad, largest half angle of such a cone
_STATE_FIELDS = {
    "attitude": "attitude",
    "joints": "joints",
    "angular_velocity": "velocity",
    "joint_rates": "rates",
    "angular_acceleration": "acceleration",
    "joint_accelerations": "bends",
}


def pointing_error(scene: Scenario, targets: Targets, trajectory: Trajectory, begin: float) -> float:
    """Return an upper bound, rad, of the angle between devices and their targets at all times.

    Args:
        scene: the spacecraft and settings, in the timeline's times.
        targets: the devices' targets.
        trajectory: the motion that follows them; its time zero is its start.
        begin: s, when it starts in the timeline.

    Returns:
        The bound; infinite if none could be proved for some device.
    """
    craft = scene.spacecraft
    # directions count alone
    terminals = tuple(replace(one, mask=()) for one in craft.terminals)
    bare = replace(craft, terminals=terminals, wheels=(), torque_limit=None, wheel_momentum_limit=None)
    half = min(_CONE_FACTOR * float(targets.tolerance), _MAX_HALF_ANGLE)
    zones = [
        KeepIn(name=f"target of {name}", direction=path, half_angle=half, devices=(name,))
        for name, path in zip(targets.names(craft), targets.paths, strict=True)
    ]
    moved = later(replace(scene, keep_out=(), keep_in=tuple(zones)), begin, trajectory.duration)
    found = prove_margins(
        Claim(
            trajectory=trajectory,
            spacecraft=bare,
            cones=tabulate((), moved.keep_in, bare),
            zone_names=[zone.name for zone in zones],
        )
    )
    bounds = [margin.bound for margin in found]
    return float("inf") if len(bounds) < len(zones) else half - min(bounds)


def certify_part(scene: Scenario, begin: float, trajectory: Trajectory, craft: Spacecraft) -> Certificate:
    """Certify a part of a motion.

    Args:
        scene: zones and settings, in the timeline's times. A part that begins at time zero must start in the
            scene's start.
        begin: s, when the part begins in the timeline.
        trajectory: the part; its time zero is its start.
        craft: the spacecraft, whose wheels store what they hold when the part begins.
    """
    moved = replace(later(scene, begin, trajectory.duration), spacecraft=craft)
    return certify(
        Claim(
            trajectory=trajectory,
            spacecraft=craft,
            cones=moved.stated,
            zone_names=[moved.zones[zone].name for zone in moved.stated.zone if zone >= 0],
            sight_names=moved.sight_names,
            robust=moved.robust,
            start=None if begin > 0 else _start_state(scene),
        )
    )


def _start_state(scene: Scenario) -> EndState:
    """Return the scene's start in the form that claims have."""
    start = scene.start
    return EndState(
        attitude=start.attitude,
        joints=start.joints,
        angular_velocity=start.angular_velocity,
        joint_rates=start.joint_rates,
    )


def jumps_between(before: Trajectory, after: Trajectory) -> dict[str, float]:
    """Return the largest jumps from the end of a trajectory to the start of the next, by quantity.

    Names are those in `Certificate.jumps`; units are rad and seconds.
    """
    ended, begun = State.of(before, before.duration), State.of(after, 0.0)
    return {
        name: float(np.max(np.abs(getattr(begun, own) - getattr(ended, own)), initial=0.0))
        for name, own in _STATE_FIELDS.items()
    }


def merged(parts: Sequence[tuple[float, Trajectory, Certificate]]) -> Certificate:
    """Return the certificate of a motion from those of its parts.

    The jumps from part to part are checked as well.

    Args:
        parts: each as (s at which it begins, trajectory, certificate), in order of time.
    """
    begins = [begin for begin, _, _ in parts]
    found = [proof for _, _, proof in parts]
    joins = [jumps_between(one, other) for (_, one, _), (_, other, _) in pairwise(parts)]
    faults = [
        f"{fault}, in the part that begins at {begin:.2f} s"
        for one, begin in zip(found, begins, strict=True)
        for fault in faults_later(one, begin)
    ]
    jumps: dict[str, float] = {}
    for each in (*(one.jumps for one in found), *joins):
        for name, jump in each.items():
            jumps[name] = max(jumps.get(name, 0.0), jump)
    for number, join in enumerate(joins):
        wrong = {name: jump for name, jump in join.items() if not jump <= TOLERANCE}
        faults += [
            f"{name.replace('_', ' ')} jumps by {jump:.3g} at {begins[number + 1]:.2f} s"
            for name, jump in wrong.items()
        ]
    peaks: dict[str, float] = {}
    times: dict[str, float] = {}
    for one, begin in zip(found, begins, strict=True):
        for name, peak in one.peaks.items():
            if not peak <= peaks.get(name, -np.inf):
                peaks[name], times[name] = peak, one.peak_times[name] + begin
    bound = [number for number, one in enumerate(found) if one.min_margin is not None]
    whole = Certificate(
        certified=not faults and all(one.certified for one in found),
        peaks=peaks,
        peak_times=times,
        jumps=jumps,
        faults=tuple(faults),
        evaluations=sum(one.evaluations for one in found),
    )
    if not bound:
        return whole
    worst = min(bound, key=lambda number: found[number].min_margin or 0.0)
    least = found[worst]
    assert least.worst_time is not None
    return replace(
        whole,
        min_margin=least.min_margin,
        worst_time=least.worst_time + begins[worst],
        worst_device=least.worst_device,
        worst_zone=least.worst_zone,
    )


def _gap_faults(trajectory: Trajectory, segments: Sequence[Segment]) -> list[str]:
    """Return a sentence for each way in which segments fail to cover a trajectory one after the other.

    They must begin at breaks of both platform and joints, so that a part can be cut out there.
    """
    ends = [0.0, *(segment.end for segment in segments)]
    off = [segment for segment, end in zip(segments, ends, strict=False) if segment.start != end]
    faults = [f"the segment {segment.name} does not begin where the one before ends" for segment in off]
    breaks = np.intersect1d(trajectory.breaks, trajectory.joint_breaks)
    between = [segment for segment in segments if segment.start not in breaks]
    faults += [f"the segment {segment.name} does not begin at a break of the motion" for segment in between]
    if ends[-1] != trajectory.duration:
        faults.append(f"segments end at {ends[-1]:.2f} s, the motion at {trajectory.duration:.2f} s")
    return faults


def certify_segments(
    timeline: Timeline,
    trajectory: Trajectory,
    segments: Sequence[Segment],
    done: Done,
    *,
    whole: bool = False,
) -> Certificate:
    """Certify the motion of a timeline's plan, segment by segment.

    Args:
        timeline: what was asked.
        trajectory: the motion over all segments.
        segments: slews and activities in order of time.
        done: begin and end, s, of the activities that are said to be done, by name.
        whole: whether the whole timeline is said to be done.

    Returns:
        The certificate, whose `faults` list what could not be proved. It covers that each of these activities
        is done, and that devices point within their tolerances.
    """
    scene = timeline.scene
    asked = {one.name: one for one in timeline.activities}
    total: np.ndarray | None = None
    proofs: list[tuple[float, Trajectory, Certificate]] = []
    gaps = _gap_faults(trajectory, segments)
    faults = [*gaps, *unmet(timeline, trajectory, segments, done, whole=whole)]
    for segment in () if gaps else segments:
        own = curves.part(trajectory, segment.start, segment.end)
        begun = State.of(own, 0.0)
        total = total_in(scene.spacecraft, begun) if total is None else total
        craft = holding(scene.spacecraft, total, begun)
        proofs.append((segment.start, own, certify_part(scene, segment.start, own, craft)))
        activity = asked.get(segment.name)
        if segment.kind == "track" and activity is not None and activity.track is not None:
            error = pointing_error(scene, activity.track, own, segment.start)
            if not error <= float(activity.track.tolerance):
                off, most = np.rad2deg([error, float(activity.track.tolerance)])
                faults.append(f"{segment.name}: devices point within {off:.3g} deg, not {most:.3g} deg")
    found = merged(proofs)
    return replace(found, certified=found.certified and not faults, faults=(*found.faults, *faults))
