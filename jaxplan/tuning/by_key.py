"""How much each number of a scenario's file matters to a plan: slopes by the file's keys, in its units.

A *measure* is a number computed from a plan, such as its duration; a *slope* is its derivative by a number of
the file. Slopes are derivatives of the plan with its choices held fixed (`jaxplan.gradients`), so they hold
for small changes: the same goal among those of step 1, the same corners of the path, the same limits and
zones that bind. Numbers that depend on each other, such as those of a unit vector, are left out.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import EllipsisType
from typing import Any

import jax
import numpy as np

from jaxplan.derivatives import own_arrays
from jaxplan.gradients import differentiable
from jaxplan.model.file_keys import unit_of
from jaxplan.planner import Plan
from jaxplan.runtime.arguments import expect
from jaxplan.runtime.display import as_table, in_columns, shown
from jaxplan.runtime.progress import progress_bar
from jaxplan.schema.numbers import NumberPlace, numbers_of, numbers_of_timeline
from jaxplan.timeline import TimelinePlan
from jaxplan.tuning.days import TOTAL_TIME, day_slopes
from jaxplan.tuning.objectives import (
    MARGIN,
    OBJECTIVES,
    Objective,
    make_objective,
    offered,
    unit_of_objective,
)

_LINE_WIDTH = 110  # most characters in a line of names
_NOT_LISTED = (
    "not listed: numbers that are left at their defaults, and those of directions and matrices, such as an "
    "inertia"
)
_IN_CODE = "; jp.differentiable has the slopes of all"
_EFFECT_SHARE = 0.01  # fraction of a number by which `effect` lets it grow
_SLOPE_TOLERANCE = 1e-12  # fraction of the largest slope; smaller ones count as zero


@shown("name", "value", "unit", "slope", "slope_unit", "effect")
@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """What a number of a scenario's file does to a plan.

    Attributes:
        name: its dotted name, in the file's keys, such as ``keep_out[0].half_angle_deg``.
        value: the number, in the file's unit.
        unit: the number's unit; empty if it has none.
        slope: derivative of the measure by the number, in the measure's unit over the number's.
        slope_unit: both units, such as "s per deg/s"; empty if neither has one.
    """

    name: str
    value: float
    unit: str
    slope: float
    slope_unit: str = ""

    @property
    def effect(self) -> float:
        """Change of the measure, in its unit, if the number grows by 1 % of its size, to first order."""
        return self.slope * abs(self.value) * _EFFECT_SHARE + 0.0  # no minus zero


@shown("measure", "value", "unit")
@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivities:
    """Slopes of a measure of a plan by all numbers of its scenario's file.

    Attributes:
        measure: its name.
        value: the measure, at the optimum to which the slopes belong.
        unit: the measure's unit.
        rows: the numbers whose slope is not zero, by decreasing size of `effect`, then of the slope.
        without_effect: names of the numbers whose slope is zero.
        note: why many slopes are zero, such as that a day waits for something; empty for nothing to say.
    """

    measure: str
    value: float
    unit: str
    rows: tuple[Sensitivity, ...]
    without_effect: tuple[str, ...]
    note: str = ""

    def __getitem__(self, name: str) -> float:
        """Return the slope by the number with a dotted name; raises KeyError if there is no such number."""
        for row in self.rows:
            if row.name == name:
                return row.slope
        if name in self.without_effect:
            return 0.0
        raise KeyError(f"{name}: no number of this scenario that may change by itself")

    @property
    def table(self) -> np.ndarray:
        """The rows as a structured array, which ``pd.DataFrame`` takes.

        Its columns are name, value, unit, slope, slope_unit and effect.
        """
        texts = [("name", "U120"), ("unit", "U12"), ("slope_unit", "U32")]
        kinds = dict([*texts, *((name, float) for name in ("value", "slope", "effect"))])
        names = ("name", "value", "unit", "slope", "slope_unit", "effect")
        rows = [tuple(getattr(row, name) for name in names) for row in self.rows]
        return np.array(rows, dtype=[(name, kinds[name]) for name in names])

    @property
    def _left_out(self) -> str:
        """Text on the numbers that are neither in `rows` nor in `without_effect`."""
        return _NOT_LISTED + _IN_CODE * (self.measure != TOTAL_TIME)

    def __str__(self) -> str:
        more = "1 % more" + f", {self.unit}" * bool(self.unit)
        head = ("number", "value", "", f"slope of {self.measure}", "", more)
        rows = [
            (
                row.name,
                f"{row.value:.6g}",
                row.unit,
                f"{row.slope:+.4g}",
                row.slope_unit,
                f"{row.effect:+.3g}",
            )
            for row in self.rows
        ]
        lines = [f"{self.measure.replace('_', ' ')} {self.value:.6g} {self.unit}"]
        lines += in_columns([head, *rows], "<><><>")
        if self.without_effect:
            names = f"and {len(self.without_effect)} whose slope is zero: {', '.join(self.without_effect)}"
            lines += textwrap.wrap(
                names, _LINE_WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
            )
        for text in (self.note, self._left_out):
            lines += textwrap.wrap(text, _LINE_WIDTH, subsequent_indent="  ")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        rows = [
            (
                row.name,
                f"{row.value:.6g} {row.unit}: slope {row.slope:+.4g} {row.slope_unit}, "
                f"1 % more {row.effect:+.3g} {self.unit}".rstrip(),
            )
            for row in self.rows
        ]
        caption = f"{self.measure.replace('_', ' ')} {self.value:.6g} {self.unit}"
        rows += [(name, "slope 0") for name in self.without_effect]
        rows += [("note", text) for text in (self.note, self._left_out) if text]
        return as_table(caption, rows)


def sensitivities(plan: Plan | TimelinePlan, measure: str | None = None) -> Sensitivities:
    """Compute how a measure of a plan changes with each number of its scenario's or timeline's file.

    Args:
        plan: a certified plan that `differentiable` accepts, or one of a timeline.
        measure: one of `jaxplan.tuning.OBJECTIVES`, such as "effort", "duration" or, where zones stand still,
            "smallest_margin"; for a timeline's plan "total_time", until its last activity ends. None for
            "effort", or for "total_time".

    Returns:
        The slopes in the units of files. If a choice of the plan is just about to change, a slope is that on
        the side where the plan is. If more wheels are at their limits at an instant than the torque has
        dimensions, slopes by single wheels are one of several possible splits; only the slope by all of them
        together is certain.

    Raises:
        TypeError: if `plan` is not a plan, or `measure` not a name.
        ValueError: if there is no such measure, if the plan lacks what it measures, or if the plan has no
            derivatives, as for `differentiable`; for a timeline's plan also as for
            `jaxplan.tuning.days.hold_day`.

    Example:
        >>> print(jp.sensitivities(plan, "smallest_margin"))
        >>> print(jp.sensitivities(jp.plan_timeline(timeline), "total_time"))
    """
    if measure is not None and not isinstance(measure, str):
        raise TypeError(f"measure must be a name, not {type(measure).__name__}")
    if isinstance(plan, TimelinePlan):
        return _day_sensitivities(plan, TOTAL_TIME if measure is None else measure)
    expect("plan", plan, Plan, "jp.plan makes one of a scenario, jp.plan_timeline that of a timeline")
    if measure == TOTAL_TIME:
        raise ValueError(f"measure {TOTAL_TIME!r} is of a timeline's plan, of this one it is 'duration'")
    measure = "effort" if measure is None else measure
    if measure not in OBJECTIVES:
        raise ValueError(f"unknown measure {measure!r}: must be one of {', '.join(offered(plan.scenario))}")
    aim: Objective = make_objective(measure)
    sign = -1.0 if measure == MARGIN else 1.0  # which counts negative as an objective, and here as it is
    scenario = own_arrays(plan.scenario)
    if plan.trajectory is not None:
        with jax.enable_x64(True):
            jax.eval_shape(aim, plan.trajectory, scenario)  # what the measure refuses is told at once
    function = differentiable(plan)
    with progress_bar("derivatives"), jax.enable_x64(True):
        value, slopes = jax.value_and_grad(lambda own: aim(function(own), own), allow_int=True)(scenario)
    told = measure, sign * float(value), unit_of_objective(measure)
    return _gather_slopes(told, numbers_of(plan.scenario), plan.scenario, slopes, sign)


def _day_sensitivities(plan: TimelinePlan, measure: str) -> Sensitivities:
    """Compute the slopes of a day's total time by the numbers of its timeline's file."""
    if measure != TOTAL_TIME:
        raise ValueError(f"unknown measure {measure!r} of a timeline's plan: must be {TOTAL_TIME!r}")
    with progress_bar("derivatives of the day"):
        value, slopes, note = day_slopes(plan)
    told = _gather_slopes((measure, value, "s"), numbers_of_timeline(plan.timeline), plan.timeline, slopes)
    return replace(told, note=note)


def _gather_slopes(
    told: tuple[str, float, str], places: Sequence[NumberPlace], owner: Any, slopes: Any, sign: float = 1.0
) -> Sensitivities:
    """Gather slopes into a `Sensitivities`.

    Args:
        told: name, value and unit of the measure.
        places: where the numbers stand.
        owner: the scenario or timeline that has the numbers.
        slopes: an object like `owner` with the derivatives of `sign` times the measure.
        sign: 1 or -1.
    """
    measure, value, unit = told
    found = [
        Sensitivity(
            name=place.name,
            value=float(place.get(owner)),
            unit=_number_unit(place),
            slope=sign * _slope_at(slopes, place.path) * place.factor,
            slope_unit=_slope_unit(unit, _number_unit(place)),
        )
        for place in places
    ]
    if found and not any(np.isfinite(one.slope) for one in found):
        raise ValueError(
            f"the slopes of {measure} are no numbers: the plan has no derivatives that are known. One along "
            "other nodes may have some: try a larger trajectory.node_tube_deg, or another search.seed"
        )
    least = _SLOPE_TOLERANCE * max((abs(one.slope) for one in found if np.isfinite(one.slope)), default=0.0)
    some = [one for one in found if not abs(one.slope) <= least]  # a slope that is no number is told, too
    return Sensitivities(
        measure=measure,
        value=value,
        unit=unit,
        rows=tuple(sorted(some, key=lambda one: (-abs(one.effect), -abs(one.slope)))),
        without_effect=tuple(one.name for one in found if one not in some),
    )


def _slope_unit(measure: str, number: str) -> str:
    """Return the unit of a slope from those of a measure and a number; either may be empty."""
    return f"{measure or '1'} per {number}" if number else measure


def _number_unit(place: NumberPlace) -> str:
    """Return the unit in which the last key of a number's name ends."""
    return unit_of(place.name.rpartition(".")[2].partition("[")[0])


def _slope_at(slopes: Any, path: tuple[str | int | EllipsisType, ...]) -> float:
    """Return the slope at a `NumberPlace.path`; the sum over an array for which a single number stands."""
    value = slopes
    for step in path:
        if step is ...:
            return float(np.sum(np.asarray(value, float)))
        value = getattr(value, step) if isinstance(step, str) else value[step]
    if getattr(value, "dtype", None) == jax.dtypes.float0 or value is None:
        return 0.0
    return float(np.sum(np.asarray(value, float)))
