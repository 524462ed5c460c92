"""Wheels in files and in Python: what is read and written, and what is refused with its reason."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario
from wheels import INERTIA, random_wheels, with_wheels

import jaxplan as jp
import jaxplan.schema as sc
from jaxplan.schema.numbers import find_number

WHEEL = {"name": "a", "axis": [0, 0, 1], "torque_nm": 0.2, "momentum_nms": 8.0}
AXES = ([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.6, 0.8])
FOUR = [WHEEL | {"name": name, "axis": axis} for name, axis in zip("abcd", AXES, strict=True)]


def tables(wheels=FOUR, **more):
    """A file's tables with wheels, and more keys of the spacecraft; one of None is left out."""
    found = sc.scenario_to_dict(replace(make_scenario(1), name="wheels"))
    craft = found["spacecraft"] | {"inertia_kg_m2": INERTIA.tolist(), "wheel": wheels} | more
    return found | {"spacecraft": {key: value for key, value in craft.items() if value is not None}}


def faults_of(given):
    with pytest.raises(sc.ScenarioError) as caught:
        sc.scenario_from_dict(given)
    return caught.value.faults


def test_wheels_are_read_and_written_back(tmp_path):
    for allocation in ("pseudo_inverse", "minimax"):
        scenario = with_wheels(random_wheels(5, seed=1), allocation)
        jp.save_scenario(scenario, tmp_path / "own.toml")
        text, found = (tmp_path / "own.toml").read_text(), jp.load_scenario(tmp_path / "own.toml")
        assert text.count("[[spacecraft.wheel]]") == 5
        assert ('allocation = "minimax"' in text) == (allocation == "minimax")
        assert found.spacecraft.allocation == allocation
        for own, other in zip(scenario.spacecraft.wheels, found.spacecraft.wheels, strict=True):
            np.testing.assert_allclose(other.axis, own.axis, rtol=1e-15)
            for name in ("name", "torque", "momentum", "stored"):
                assert getattr(other, name) == getattr(own, name)
    read = sc.scenario_from_dict(tables()).spacecraft
    assert [wheel.stored for wheel in read.wheels] == [0.0] * 4
    assert read.allocation == "pseudo_inverse"
    assert make_scenario(1).spacecraft.wheels == ()


# 7 N m s against each other: what they hold together is 1 N m s along the first axis
AGAINST = [one | {"stored_nms": held} for one, held in zip(FOUR, (1.0, -4.2, -5.6, 7.0), strict=True)]

REFUSED = {
    "held against each other": (
        tables(AGAINST, allocation="minimax"),
        'spacecraft.allocation = "minimax": shares out so that the fullest wheel has the least, 12.5 % of '
        "its momentum_nms for what they hold together, and by stored_nms one has 87.5 %: they hold momentum "
        'against each other, which is for "pseudo_inverse" to count; or give them stored_nms 1, 0, 0, 0',
    ),
    "two": (
        tables(FOUR[:2]),
        "spacecraft.wheel: 2 of them, must be three or more, so that they turn the body about any axis: "
        "about one that they miss, torque would have to be exactly zero at every instant, which is not",
    ),
    "in a plane": (
        tables([FOUR[1], FOUR[2], FOUR[3]]),
        "spacecraft.wheel: their axes must not lie in one plane",
    ),
    "fuller than full": (
        tables([*FOUR, WHEEL | {"name": "e", "stored_nms": -8.5}]),
        "spacecraft.wheel[4].stored_nms = -8.5: must be at most",
    ),
    "no inertia": (tables(inertia_kg_m2=None), "spacecraft.wheel: needs spacecraft.inertia_kg_m2"),
    "a torque limit": (
        tables(torque_limit_nm=0.5),
        "spacecraft.torque_limit_nm: cannot stand beside spacecraft.wheel, where each has its own, such as "
        "spacecraft.wheel[0].torque_nm: it is for thrusters",
    ),
    "a momentum limit": (
        tables(wheel_momentum_limit_nms=[4.0, 4.0, 4.0]),
        "spacecraft.wheel_momentum_limit_nms: cannot stand beside spacecraft.wheel",
    ),
    "an allocation of nothing": (
        tables(None, allocation="minimax"),
        'spacecraft.allocation = "minimax": is how wheels share out torque, and there is no spacecraft.wheel',
    ),
    "another allocation": (tables(allocation="best"), 'spacecraft.allocation = "best": must be'),
    "one name twice": (
        tables([*FOUR, FOUR[0]]),
        'spacecraft.wheel[4].name = "a": the same as spacecraft.wheel[0].name',
    ),
    "no torque": (
        tables([*FOUR, WHEEL | {"name": "e", "torque_nm": 0.0}]),
        "spacecraft.wheel[4].torque_nm = 0.0: must lie in [1e-12, 1e12]",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_with_the_reason(name):
    given, words = REFUSED[name]
    (fault,) = faults_of(given)
    assert fault.startswith(words), fault


def test_the_same_is_refused_in_python():
    array, craft = random_wheels(4, seed=2), with_wheels(random_wheels(4, seed=2)).spacecraft
    for changes, words in (
        ({"wheels": array[:2]}, "2 of them, must be three or more"),
        ({"inertia": None}, "spacecraft.wheels: needs spacecraft.inertia"),
        ({"torque_limit": 1.0}, "spacecraft.torque_limit: cannot stand beside spacecraft.wheels"),
        ({"wheels": (), "allocation": "minimax"}, "spacecraft.allocation"),
        ({"wheels": (*array[:3], replace(array[3], stored=9.0))}, "stored = 9.0 N m s: must be at most"),
        ({"wheels": (*array[:3], "wheel")}, "must be a Wheel"),
    ):
        scenario = replace(make_scenario(1), spacecraft=replace(craft, **changes))
        with pytest.raises(sc.ScenarioError) as caught:
            jp.plan(scenario)
        assert any(words in fault for fault in caught.value.faults), caught.value.faults


def test_single_numbers_of_wheels_have_names():
    scenario = with_wheels(random_wheels(4, seed=3))
    place = find_number(scenario, "spacecraft.wheel[2].stored_nms")
    assert place.get(scenario) == scenario.spacecraft.wheels[2].stored
