"""Times in which slews interrupt devices that have the same target before and after.

A slew leads the whole spacecraft from one activity to the next, all devices together: those whose targets
change and those whose targets do not. The latter leave their targets during the slew, since the motions
before and after it are planned separately. A device with another target in the next activity, or none, is not
interrupted: its tracking just ends.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.model.activities import Segment, Timeline
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.equality import same
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.display import shown
from jaxplan.trajectory import Trajectory

_SAMPLE_STEP = 0.25  # s, most time between samples of how far a device is off its target
_MIN_SAMPLES = 65  # least number of such samples in an interruption


@shown("device", "before", "after", "start s", "end s", "off deg")
@dataclass(frozen=True, kw_only=True)
class Interruption:
    """A time in which a device does not track the target that it has before and after.

    Attributes:
        device: its name.
        before: name of the activity that tracked the target until then.
        after: name of the activity that tracks it from then on.
        start: s from the timeline's start, when the activity before stops tracking it.
        end: s, when the activity after it, or the wait for its window, begins to track it.
        off: rad, the largest angle between device and target meanwhile, at sampled instants.
    """

    device: str
    before: str
    after: str
    start: float
    end: float
    off: float

    @property
    def duration(self) -> float:
        """Duration of the interruption, s."""
        return self.end - self.start


def interruptions(
    timeline: Timeline, segments: Sequence[Segment], trajectory: Trajectory
) -> tuple[Interruption, ...]:
    """Find for how long slews keep devices from targets that they have before and after.

    Args:
        timeline: what was asked.
        segments: slews and activities in order of time, without gaps.
        trajectory: the motion over all segments.

    Returns:
        One interruption for each slew and each device that tracks the same target before and after it, in
        order of time and then of the targets of the activity before. If another activity lies between, there
        is none.
    """
    return tuple(_find_interruptions(timeline, segments, trajectory))


def _find_interruptions(
    timeline: Timeline, segments: Sequence[Segment], trajectory: Trajectory
) -> Iterator[Interruption]:
    """Yield the interruptions; arguments as of `interruptions`."""
    craft = timeline.scene.spacecraft
    asked = {one.name: one.track for one in timeline.activities}
    tracks = [number for number, one in enumerate(segments) if one.kind == "track"]
    for first, last in pairwise(tracks):
        before, after = segments[first], segments[last]
        one, other = asked.get(before.name), asked.get(after.name)
        between = segments[first + 1 : last]
        if one is None or other is None or not between:
            continue
        if any(part.name != after.name for part in between):  # something else was to be done
            continue
        following = dict(zip(other.names(craft), other.paths, strict=True))
        for device, path in zip(one.names(craft), one.paths, strict=True):
            if device in following and same(path, following[device]):
                yield Interruption(
                    device=device,
                    before=before.name,
                    after=after.name,
                    start=before.end,
                    end=after.start,
                    off=_max_offset(craft, device, as_path(path), trajectory, before.end, after.start),
                )


def _max_offset(
    craft: Spacecraft, device: str, path: DirectionPath, trajectory: Trajectory, start: float, end: float
) -> float:
    """Return the largest angle, rad, between a device and its target at samples from `start` to `end`, s."""
    times = np.linspace(start, end, max(_MIN_SAMPLES, 1 + int(np.ceil((end - start) / _SAMPLE_STEP))))
    at = trajectory.sample(np.clip(times, 0.0, trajectory.duration))
    beams = np.asarray(craft.boresights(at.attitude, at.joints))[:, craft.device_names.index(device)]
    return float(np.max(separation(beams, np.asarray(path.at(times)))))
