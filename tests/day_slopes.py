"""Slopes of a day's total time beside differences of timelines planned anew."""

from collections.abc import Iterable

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.schema.numbers import numbers_of_timeline, with_numbers

STEP = 1e-5  # rad, s and the like, and relative, by which a number is changed to either side
NO_EFFECT = 1e-5  # s per unit, which such a difference has by rounding, and by limits that do not quite bind


def end_of(plan: jp.TimelinePlan) -> float:
    """When the last activity ends that is asked for, s."""
    names = [one.name for one in plan.timeline.activities]
    return [one.end for one in plan.activities if one.name in names][-1]


def change(plan: jp.TimelinePlan, way: dict[str, float]) -> float:
    """By how much the total time, s, changes along a way of numbers of the timeline's file, planned anew.

    The way has the change of each number, by its name; the result is the central difference.
    """
    places = {place.name: place for place in numbers_of_timeline(plan.timeline)}
    ends = []
    for side in (1, -1):
        moved = {
            places[name]: float(places[name].get(plan.timeline)) + side * step for name, step in way.items()
        }
        ends.append(end_of(jp.plan_timeline(with_numbers(plan.timeline, moved), progress=False)))
    return (ends[0] - ends[1]) / 2


def assert_slopes_are_differences(
    plan: jp.TimelinePlan, names: Iterable[str], rel: float, found: jp.Sensitivities | None = None
) -> int:
    """Check slopes of the total time by numbers of the timeline's file; returns how many of these matter.

    They are those of the plan unless others are given.

    All numbers are changed at once, so that two plans check all slopes: each in the direction in which the
    total time grows, and those that matter most by less than the others. Only if that fails, each is changed
    by itself, to tell which slope is wrong.
    """
    found = found or jp.sensitivities(plan, "total_time")
    assert found.value == pytest.approx(end_of(plan), rel=1e-7)
    assert (found.measure, found.unit) == ("total_time", "s")
    values = {place.name: float(place.get(plan.timeline)) for place in numbers_of_timeline(plan.timeline)}
    steps = {name: STEP * max(abs(values[name]), 1.0) for name in names}
    effects = {name: abs(found[name]) * step for name, step in steps.items()}
    matter = [name for name in steps if abs(found[name]) > NO_EFFECT]
    usual = np.exp(np.mean([np.log(effects[name]) for name in matter]))
    way = {
        name: float(
            np.copysign(step * min(1.0, usual / effects[name] if name in matter else 1.0), found[name])
        )
        for name, step in steps.items()
    }

    def assert_alike(part: dict[str, float]) -> None:
        told = {name: found[name] * step for name, step in part.items()}
        allowed = sum(rel * abs(told[name]) + NO_EFFECT * abs(step) for name, step in part.items())
        seen, expected = change(plan, part), sum(told.values())
        assert abs(seen - expected) <= allowed, f"{part}: slopes tell {expected} s, differences have {seen} s"

    try:
        assert_alike(way)
    except AssertionError:
        for name, step in steps.items():
            assert_alike({name: step})
        raise
    return len(matter)
