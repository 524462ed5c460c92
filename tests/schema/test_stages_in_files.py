"""Inertias of stages in files and in Python: what is read and written, what is refused with its reason."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_observer, make_scenario
from stages import with_stages
from wheels import INERTIA

import jaxplan as jp
import jaxplan.schema as sc

OBSERVER = make_scenario(craft=with_stages(replace(make_observer(), inertia=INERTIA), 1.0, 2))
FRAME = OBSERVER.spacecraft.terminals[0].frame
MOMENTS = [0.2, 0.3, 0.4]


def tables(whole=INERTIA, drive=None, **terminal):
    """A file's tables of an observer, with keys of its terminal, of its drive, and the whole inertia."""
    found = sc.scenario_to_dict(replace(OBSERVER, name="stages"))
    craft = found["spacecraft"]
    plain = {key: value for key, value in craft["terminal"][0].items() if "_inertia_" not in key}
    own = {key: value for key, value in craft["drive"][0].items() if "inertia" not in key}
    craft |= {"terminal": [plain | terminal], "drive": [own | (drive or {})]}
    if whole is None:
        del craft["inertia_kg_m2"]
    else:
        craft["inertia_kg_m2"] = np.asarray(whole).tolist()
    return found


def test_inertias_are_read_and_written_back(tmp_path):
    craft = OBSERVER.spacecraft
    moments = replace(craft, drives=(replace(craft.drives[0], inertia=np.array(MOMENTS)),))
    for own in (craft, moments):
        jp.save_scenario(replace(OBSERVER, spacecraft=own), tmp_path / "own.toml")
        found = jp.load_scenario(tmp_path / "own.toml").spacecraft
        for name in ("yaw_inertia", "pitch_inertia"):
            np.testing.assert_array_equal(getattr(found.terminals[0], name), getattr(own.terminals[0], name))
        np.testing.assert_array_equal(found.drives[0].inertia, own.drives[0].inertia)
    read = sc.scenario_from_dict(tables(yaw_inertia_kg_m2=MOMENTS)).spacecraft
    np.testing.assert_array_equal(read.terminals[0].yaw_inertia, MOMENTS)
    assert read.terminals[0].pitch_inertia is None
    assert read.drives[0].inertia is None
    harmless = replace(OBSERVER, spacecraft=replace(craft, wheels=()))  # without a limit of torque
    assert sc.scenario_from_dict(sc.scenario_to_dict(harmless)).spacecraft.stages is not None


def test_the_whole_inertia_may_be_three_moments_and_is_written_back_so(tmp_path):
    three = [40.0, 45.0, 50.0]
    own = sc.scenario_from_dict(tables(three, yaw_inertia_kg_m2=MOMENTS))
    np.testing.assert_array_equal(own.spacecraft.inertia, three)
    matrix = sc.scenario_from_dict(tables(np.diag(three), yaw_inertia_kg_m2=MOMENTS))
    for craft in (own.spacecraft, matrix.spacecraft):
        np.testing.assert_array_equal(craft.whole_inertia, np.diag(three))
    np.testing.assert_array_equal(own.spacecraft.fixed_inertia, matrix.spacecraft.fixed_inertia)
    for scenario, kept in ((own, three), (matrix, np.diag(three).tolist())):
        jp.save_scenario(scenario, tmp_path / "own.toml")
        found = jp.load_scenario(tmp_path / "own.toml")
        assert found.spacecraft.inertia.tolist() == kept
        assert sc.scenario_to_dict(found)["spacecraft"]["inertia_kg_m2"] == kept


YAW = "spacecraft.terminal[0].yaw_inertia_kg_m2"
REFUSED = {
    "without the whole": (
        tables(None, yaw_inertia_kg_m2=MOMENTS),
        f"{YAW}: needs spacecraft.inertia_kg_m2, that of the whole",
    ),
    "more than the whole": (
        tables(yaw_inertia_kg_m2=[30.0, 30.0, 30.0]),
        "spacecraft.inertia_kg_m2 = ",
        f"without {YAW} a least moment of -1",
    ),
    "more than the whole together": (
        tables(yaw_inertia_kg_m2=[12.0] * 3, drive={"inertia_kg_m2": [12.0] * 3}),
        "spacecraft.inertia_kg_m2 = ",
        f"without {YAW}, spacecraft.drive[0].inertia_kg_m2 a least moment",
    ),
    "a rest that no body has": (
        tables(FRAME @ np.diag([80.0, 110.0, 95.0]) @ FRAME.T, yaw_inertia_kg_m2=[79.0, 109.0, 40.0]),
        "spacecraft.inertia_kg_m2 = ",
        f"what is left without {YAW} must have no principal moment above the sum of the other two",
        "as no body has; it has 1, 1, 55",
    ),
    "two moments": (
        tables(yaw_inertia_kg_m2=[0.2, 0.3]),
        f"{YAW} = [0.2, 0.3]: must be an array of 3 moments, or 3 rows of 3 numbers, not of 2",
    ),
    "a number": (tables(yaw_inertia_kg_m2=0.2), f"{YAW} = 0.2: must be an array of 3 moments"),
    "a word": (tables(yaw_inertia_kg_m2=[0.2, "x", 0.2]), f'{YAW}[1] = "x": must be a number'),
    "rows that differ": (
        tables(yaw_inertia_kg_m2=[[1, 0, 0], [0, 1], [0, 0, 1]]),
        f"{YAW}[1] = [0, 1]: must be an array of 3 numbers",
    ),
    "no body has it": (
        tables(yaw_inertia_kg_m2=[0.1, 0.1, 0.4]),
        f"{YAW} = [0.1, 0.1, 0.4]: must have no principal moment above the sum",
    ),
    "negative": (
        tables(drive={"inertia_kg_m2": [0.1, -0.1, 0.1]}),
        "spacecraft.drive[0].inertia_kg_m2 = [0.1, -0.1, 0.1]: must be positive definite",
    ),
    "askew": (
        tables(yaw_inertia_kg_m2=[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]),
        f"{YAW} = [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]: must be symmetric",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_with_the_reason(name):
    given, first, *words = REFUSED[name]
    with pytest.raises(sc.ScenarioError) as caught:
        sc.scenario_from_dict(given)
    (fault,) = caught.value.faults
    assert fault.startswith(first), fault
    assert all(word in fault for word in words), fault


def test_what_stages_leave_may_be_a_body_with_masses_away_from_the_middle():
    """The rest is a body, a thin rod, or a plate, and the stages' masses where their axes cross."""
    own = np.diag(MOMENTS)
    rod, plate, arm = np.diag([1e-3, 2.0, 2.0]), np.diag([1.0, 2.0, 3.0]), np.array([0.0, 0.3, 2.0])
    shifted = 4.0 * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    for rest in (rod, plate, shifted + plate, shifted + 1e-6 * np.eye(3)):
        whole = rest + FRAME @ own @ FRAME.T
        given = tables((whole + whole.T) / 2, yaw_inertia_kg_m2=MOMENTS)
        found = sc.scenario_from_dict(given).spacecraft.fixed_inertia
        np.testing.assert_allclose(found, rest, atol=1e-12)


def test_the_same_is_refused_in_python():
    craft = OBSERVER.spacecraft
    (terminal,) = craft.terminals
    askew = jp.Mount(yaw_axis=np.array([0.0, 0.0, 2.0]), boresight=np.array([1.0, 0.0, 0.0]))
    for changes, words in (
        ({"inertia": None}, "needs spacecraft.inertia"),
        ({"inertia": INERTIA / 20}, "spacecraft.inertia"),
        ({"terminals": (replace(terminal, yaw_inertia=np.ones(4)),)}, "must be an array of 3 moments"),
        ({"terminals": (replace(terminal, yaw_inertia=np.eye(2)),)}, "must be an array of 3 moments"),
        ({"terminals": (replace(terminal, yaw_inertia=np.array([1, 1, np.nan])),)}, "yaw_inertia"),
        ({"terminals": (replace(terminal, mounting=askew),)}, "mounting.yaw_axis = [0.0, 0.0, 2.0]"),
    ):
        with pytest.raises(sc.ScenarioError) as caught:
            jp.plan(replace(OBSERVER, spacecraft=replace(craft, **changes)))
        assert any(words in fault for fault in caught.value.faults), caught.value.faults
