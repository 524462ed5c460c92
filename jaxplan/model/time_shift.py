"""A scene, a goal and a direction with their times counted from a later instant.

Whatever moves is known over times from 0 on, the start of a scene. When times are counted from an instant
``t`` of it, the times of a path become less by ``t``, and the epoch becomes later by ``t``.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.hidden_spans import Hidden
from jaxplan.model.scenario import Scenario
from jaxplan.model.zones import KeepIn, KeepOut

AnyCone = TypeVar("AnyCone", KeepOut, KeepIn)
_SPAN_PADDING = 60.0  # s before and after a span of time, for which directions are kept


def later(scene: Scenario, time: float, duration: float | None = None) -> Scenario:
    """Return the scene with times of its zones and its epoch counted from `time` on; its goal is unchanged.

    Args:
        scene: the scene with times counted from its start.
        time: s, the instant that becomes time 0.
        duration: s after `time`, for which moving zones must be known; samples long before and after are
            dropped, which makes planning quicker and changes no direction in between. None to keep all
            samples.
    """
    if time == 0.0 and duration is None:
        return scene

    def moved(zones: Iterable[AnyCone]) -> tuple[AnyCone, ...]:
        return tuple(
            replace(
                zone,
                direction=later_direction(zone.direction, time, duration) if zone.moves else zone.direction,
                lasts=zone.lasts - time,
            )
            if zone.moves or zone.lasts < np.inf
            else zone
            for zone in zones
        )

    epoch = scene.epoch
    if epoch is not None:
        epoch = epoch + np.timedelta64(round(time * 1e9), "ns")
    return replace(scene, keep_out=moved(scene.keep_out), keep_in=moved(scene.keep_in), epoch=epoch)


def later_goal(goal: GivenState | Targets, time: float) -> GivenState | Targets:
    """Return the goal with the times of its moving targets and wishes counted from a time, s, on."""
    if isinstance(goal, GivenState) or not goal.moves or time == 0.0:
        return goal
    wishes = tuple(replace(wish, direction=later_direction(wish.direction, time)) for wish in goal.prefer)
    directions: Any = goal.directions
    if isinstance(directions, list | tuple):
        directions = tuple(later_direction(direction, time) for direction in directions)
    return replace(goal, directions=directions, prefer=wishes)


def later_direction(direction: Any, time: float, duration: float | None = None) -> Any:
    """Return a direction with its times counted from a time, s, on; one that stands still is unchanged.

    `duration` is as for `later`.
    """
    if not isinstance(direction, DirectionPath) or not direction.moves:
        return direction
    first, beyond = 0, len(direction.times)
    if duration is not None:
        first = max(0, int(np.searchsorted(direction.times, time - _SPAN_PADDING)) - 2)
        beyond = int(np.searchsorted(direction.times, time + duration + _SPAN_PADDING)) + 3
    own = slice(first, beyond)
    return replace(
        direction,
        times=np.asarray(direction.times)[own] - time,
        samples=direction.samples[own],
        slopes=direction.slopes[own],
        hidden=tuple(
            Hidden(target=span.target, by=span.by, start=span.start - time, end=span.end - time)
            for span in direction.hidden
        ),
    )
