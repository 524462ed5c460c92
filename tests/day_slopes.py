"""Slopes of a day's total time beside differences of timelines planned anew."""

from collections.abc import Iterable

import pytest

import jaxplan as jp
from jaxplan.schema.numbers import numbers_of_timeline, with_numbers

STEP = 1e-5  # rad, s and the like, and relative, by which a number is changed to either side
NO_EFFECT = 1e-5  # s per unit, which such a difference has by rounding, and by limits that do not quite bind


def end_of(plan: jp.TimelinePlan) -> float:
    """When the last activity ends that is asked for, s."""
    names = [one.name for one in plan.timeline.activities]
    return [one.end for one in plan.activities if one.name in names][-1]


def difference(plan: jp.TimelinePlan, name: str) -> float:
    """The central difference of the total time by a number of the timeline's file, planned anew."""
    place = next(place for place in numbers_of_timeline(plan.timeline) if place.name == name)
    value = float(place.get(plan.timeline))
    step = STEP * max(abs(value), 1.0)
    ends = [
        end_of(jp.plan_timeline(with_numbers(plan.timeline, {place: value + side * step}), progress=False))
        for side in (1, -1)
    ]
    return (ends[0] - ends[1]) / (2 * step)


def assert_slopes_are_differences(plan: jp.TimelinePlan, names: Iterable[str], rel: float) -> int:
    """Check slopes of the total time by numbers of the timeline's file; returns how many of these matter."""
    found, matter = jp.sensitivities(plan, "total_time"), 0
    assert found.value == pytest.approx(end_of(plan), rel=1e-7)
    assert (found.measure, found.unit) == ("total_time", "s")
    for name in names:
        slope = difference(plan, name)
        alike = found[name] == pytest.approx(slope, rel=rel, abs=NO_EFFECT)
        assert alike, f"{name}: the slope is told as {found[name]}, differences have {slope}"
        matter += abs(slope) > NO_EFFECT
    return matter
