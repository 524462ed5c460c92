"""Slopes of measures by the keys of a file, beside differences of trajectories followed."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_plan

import jaxplan as jp
from jaxplan.schema.numbers import find_number, numbers_of, with_numbers
from jaxplan.tuning import OBJECTIVES, by_key
from jaxplan.tuning.by_key import Sensitivities

KEYS = {
    "trajectory.duration_s": 1e-2,
    "start.yaw_rad[0]": 1e-4,
    "start.attitude[1]": 1e-4,
    "spacecraft.terminal[2].mount_deg": 1e-2,
    "goal.yaw_limit_deg": 1e-2,
    "keep_out[0].half_angle_deg": 1e-2,
}


def test_all_numbers_of_a_file_that_may_change_by_themselves_are_found():
    scenario = jp.paper_case(2)
    found = {place.name: place for place in numbers_of(scenario)}
    assert set(KEYS) <= set(found)
    for name, place in found.items():
        assert place == find_number(scenario, name)
        changed = with_numbers(scenario, {place: place.get(scenario)})
        assert place.get(changed) == pytest.approx(place.get(scenario), rel=1e-12)
    assert not any("targets" in name or "seed" in name for name in found)


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return jp.plan(jp.paper_case(2))


@pytest.mark.slow
@pytest.mark.parametrize("measure", ["effort", "smallest_margin", "duration"])
def test_slopes_are_those_of_differences(plan, measure):
    found = jp.sensitivities(plan, measure)
    function = jp.differentiable(plan)
    sign = -1 if measure == "smallest_margin" else 1

    def value(scenario: jp.Scenario) -> float:
        with jax.enable_x64(True):
            return sign * float(OBJECTIVES[measure](function(scenario), scenario))

    assert found.value == pytest.approx(value(plan.scenario), rel=1e-9)
    for name, step in KEYS.items():
        place = find_number(plan.scenario, name)
        here = place.get(plan.scenario)
        above, below = (value(with_numbers(plan.scenario, {place: here + side * step})) for side in (1, -1))
        slope = (above - below) / (2 * step)
        assert found[name] == pytest.approx(slope, rel=1e-3, abs=1e-6 * abs(found.value)), name


@pytest.mark.slow
def test_the_table_is_told_in_units_of_files_with_what_matters_first(plan):
    found = jp.sensitivities(plan, "smallest_margin")
    first = found.rows[0]
    assert (first.name, first.unit) == ("keep_out[0].half_angle_deg", "deg")
    assert first.slope == pytest.approx(-1, abs=1e-6)  # a wider zone takes as much off the margin
    assert first.effect == pytest.approx(-0.21, abs=1e-6)
    for row in found.rows:
        assert row.slope_unit == (f"deg per {row.unit}" if row.unit else "deg")
    assert len({row.unit for row in found.rows}) > 2
    assert "slope -1 deg per deg" in found._repr_html_()
    assert list(found.table["slope_unit"]) == [row.slope_unit for row in found.rows]
    effects = np.abs([row.effect for row in found.rows])
    assert np.all(np.diff(effects) <= 0)
    assert found["keep_out[1].half_angle_deg"] == 0
    text = str(found).splitlines()
    assert text[0].startswith("smallest margin 1.03")
    assert text[1].rstrip().endswith("1 % more, deg")
    assert " deg per deg " in text[2]
    (last,) = (k for k, line in enumerate(text) if "whose slope is zero: " in line)
    assert len({len(line.rstrip()) for line in text[1:last]}) == 1  # aligned
    told, _, rest = (
        " ".join(line.strip() for line in text[last:]).partition(": ")[2].partition(" not listed: ")
    )
    assert rest.endswith("jp.differentiable has the slopes of all")
    told = told.split(", ")
    assert tuple(told) == found.without_effect
    assert max(map(len, text[last:])) <= 110
    assert found.table["name"][0] == first.name
    assert "<table" in found._repr_html_()
    with pytest.raises(KeyError, match="no number of this scenario"):
        found["goal.targets"]


@pytest.mark.parametrize(
    ("measure", "kind", "told"),
    [
        ("speed", ValueError, "unknown measure 'speed': must be one of"),
        (3, TypeError, "measure must be a name, not int"),
    ],
)
def test_what_is_no_measure_is_refused(measure, kind, told):
    with pytest.raises(kind, match=told):
        jp.sensitivities(make_plan(2, 1, zones=1), measure)


def test_what_a_measure_refuses_is_asked_with_wide_numbers(plan, monkeypatch):
    # what is traced with narrow ones JAX keeps, and later takes in their place
    kinds = []

    def refusing(trajectory, scenario):
        kinds.extend(leaf.dtype for leaf in [*jax.tree.leaves(trajectory), jnp.zeros(1)])
        raise ValueError("not of this one")

    monkeypatch.setattr(by_key, "make_objective", lambda _: refusing)
    with jax.enable_x64(False), pytest.raises(ValueError, match="not of this one"):
        jp.sensitivities(plan, "effort")
    assert set(kinds) == {np.dtype(np.float64)}


def test_the_margin_to_zones_that_move_is_refused_with_the_measures_that_there_are():
    plan = make_plan(2, 1, zones=1)
    path = jp.DirectionPath.through([0.0, 900.0], [[1.0, 0.0, 0.0], [0.96, 0.28, 0.0]])
    zones = (*plan.scenario.keep_out, jp.KeepOut(name="earth", direction=path, half_angle=0.1))
    moving = replace(plan, scenario=replace(plan.scenario, keep_out=zones))
    with pytest.raises(ValueError, match=r"of zones that stand still, and earth moves: plan\.certificate"):
        jp.sensitivities(moving, "smallest_margin")
    for one, offers in ((plan, True), (moving, False)):
        with pytest.raises(ValueError, match="unknown measure 'speed'") as told:
            jp.sensitivities(one, "speed")
        assert ("smallest_margin" in str(told.value)) == offers


def test_names_without_effect_are_not_broken_between_lines():
    names = tuple(f"search.terminal_step_scale.terminal-{k}-of-the-bus" for k in range(9))
    found = Sensitivities(measure="effort", value=1.0, unit="", rows=(), without_effect=names)
    assert all(name in str(found) for name in names)
