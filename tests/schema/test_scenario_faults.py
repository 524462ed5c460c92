"""Malformed scenario files: every fault is named with its place, value and range; nothing else is raised."""

import pickle
import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tables import ABSENT
from trust.bad_scenarios import TABLES, WRONG_VALUES, at, changed, with_fault

import jaxplan.schema as sc
from jaxplan.schema.faults import nearest


def places(value, path=""):
    """Places of all values in nested tables and arrays, the tables and arrays among them."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in pairs:
        here = f"{path}[{key}]" if isinstance(key, int) else f"{path}.{key}".lstrip(".")
        yield here
        yield from places(item, here)


def faults_of(tables):
    with pytest.raises(sc.ScenarioError) as caught:
        sc.scenario_from_dict(tables)
    return caught.value.faults


PLACES = list(places(TABLES))
NUMBERS = [place for place in PLACES if type(at(TABLES, place)) in (int, float)]
INTEGERS = {
    "schema_version",
    "search.attitude_moves",
    "search.max_expansions",
    "search.improvements",
    "search.max_goals",
    "search.seed",
}
INTEGERS |= {"trajectory.segments", "trajectory.order", "trajectory.first_guesses"}
NO_STAGES = {f"spacecraft.terminal[0].{stage}_inertia_kg_m2": ABSENT for stage in ("yaw", "pitch")}


@pytest.mark.parametrize("line", WRONG_VALUES)
def test_a_wrong_value_is_the_one_fault_with_place_value_and_range(line):
    assert faults_of(with_fault(line)) == (line,)


RANGE = r"( and lie in [\[(].*[\])]| and be greater than 0)?"  # what has none is part of a direction


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf], ids=str)
def test_every_number_must_be_finite(value):
    for place in NUMBERS:
        if (place, value) == ("trajectory.node_tube_deg", np.inf):
            continue  # no tube at all
        complaints = faults_of(changed({place: value}))
        if place in INTEGERS:
            assert len(complaints) == 1
            assert re.match(rf"{re.escape(place)} = {value}: must be (an integer|1)", complaints[0])
        else:
            assert len(complaints) == 1
            assert re.fullmatch(rf"{re.escape(place)} = {value}: must be finite{RANGE}", complaints[0])


# Settings that go into nothing that could overflow, and tests of whose sign or norm already refuse them.
HARMLESS = {"search.time_limit_s", "search.seed", "search.max_expansions"}


def test_no_number_may_be_absurdly_large():
    for place in sorted(set(NUMBERS) - HARMLESS):
        for value in (10**18, -(10**18)) if place in INTEGERS else (1e308, -1e308):
            first = faults_of(changed({place: value}))[0]
            assert first.startswith((f"{place} = ", f"{place.partition('[')[0]}")), place


def test_one_of_something_is_singular():
    alone = changed({"spacecraft.terminal": TABLES["spacecraft"]["terminal"][:1]})
    found = faults_of(alone)
    assert "start.yaw_rad = [0.9272, 1.2532]: must be an array of 1 number, one a terminal, not of 2" in found
    targets = "[[-0.5349, 0.8296, 0.1604], [0.4212, -0.9032, -0.0832]]"
    assert f"goal.targets = {targets}: must be an array of 1 direction, one a terminal, not of 2" in found


def test_an_integer_beyond_all_floats_is_not_finite():
    for place in set(NUMBERS) - INTEGERS:
        (fault,) = faults_of(changed({place: 10**400}))
        assert re.fullmatch(rf"{re.escape(place)} = \(a huge integer\): must be finite{RANGE}", fault)


@pytest.mark.parametrize("value", [True, None, "text", {}, []], ids=str)
def test_no_value_may_have_the_wrong_type(value):
    for place in PLACES:
        expected = at(TABLES, place)
        if type(value) is type(expected) or isinstance(expected, dict | list):
            continue
        first = faults_of(changed({place: value}))[0]
        assert first.startswith(place), (place, value)


def test_an_integer_will_do_for_a_number():
    for place in set(NUMBERS) - INTEGERS:
        value = at(TABLES, place)
        if value == int(value):
            sc.scenario_from_dict(changed({place: int(value)}))


def test_all_faults_are_reported_at_once():
    found = faults_of(changed(dict.fromkeys(NUMBERS, np.nan)))
    assert len(found) == len(NUMBERS)
    assert {line.split(" = ")[0] for line in found} == set(NUMBERS)


def test_the_message_lists_all_faults():
    with pytest.raises(sc.ScenarioError) as caught:
        sc.scenario_from_dict(changed({"keep_out[1].half_angle_deg": 210, "search.seed": -1}))
    assert str(caught.value).splitlines() == [
        "the scenario has 2 faults:",
        "  keep_out[1].half_angle_deg = 210: must lie in (0, 180)",
        "  search.seed = -1: must be at least 0",
    ]
    assert isinstance(caught.value, ValueError)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.faults, str(again)) == (caught.value.faults, str(caught.value))


def test_a_misspelt_key_is_answered_with_the_nearest_one():
    for place in PLACES:
        parent, _, key = place.rpartition(".")
        if "[" in key or parent == "search.terminal_step_scale" or key == "keep_out":
            continue
        misspelt = f"{parent}.{key}{key[-1]}".lstrip(".")
        found = faults_of(changed({place: ABSENT, misspelt: at(TABLES, place)}))
        assert f"{misspelt}: unknown key, perhaps {key} is meant" in found


def test_a_key_like_none_is_answered_with_the_known_ones():
    found = faults_of(changed({"keep_out[0].colour": "red", "unit": 1}))
    assert found == (
        "unit: unknown key, the keys are schema_version, name, epoch_utc, spacecraft, start, goal, sky, "
        "keep_out, keep_in, joint_bound, robust, search, trajectory",
        "keep_out[0].colour: unknown key, the keys are name, direction, axis_body, axis_device, "
        "half_angle_deg, body, exclusion_deg, moving, satellite, direction_samples, times_s, devices, "
        "vector, lasts_s, any_of, entry, outside",
    )


def test_only_names_that_are_alike_are_suggested_and_each_known_one_is_told_once():
    assert nearest("priority", ["point", "track"], "keys") == "the keys are point, track"
    assert nearest("rate_deg_s", ["drive_deg", "yaw_deg"], "keys") == "the keys are drive_deg, yaw_deg"
    assert nearest("antena", ["antenna", "array"], "names") == "perhaps antenna is meant"
    assert nearest("sun", ["antenna", "antenna"], "devices") == "the devices are antenna"


def test_of_a_zone_with_two_axes_only_that_is_told():
    read = changed({"keep_out[0].axis_body": [0.0, 0.0, 1.0], "keep_out[0].devices": ABSENT})
    complaint = "stands in the place of direction, only one of them can be given"
    assert faults_of(read) == (f"keep_out[0].axis_body: {complaint}",)


COUNTED = "an array of 2 numbers, one a terminal"
JOINTS = "joints_deg, such as { fore = [0.0, 0.0] }"


@pytest.mark.parametrize(
    "line",
    [
        "schema_version: missing, must be 1",
        "name: missing, must be a line of text",
        "spacecraft: missing, must be a table",
        "start: missing, must be a table with attitude and joints, or with targets",
        "goal: missing, must be a table with targets, or with attitude, yaw_rad and pitch_rad",
        "spacecraft.rate_limit_deg_s: missing, must be a number in [1e-6, 1e6], or 3, one a body axis",
        "spacecraft.terminal[1].pitch_limit_deg: missing (or pitch_range_deg), must be a number in (0, 90)",
        "spacecraft.instrument[0].boresight: missing, must be a unit vector of 3 numbers",
        "start.attitude: missing (or quaternion_wxyz), must be a rotation vector of 3 numbers",
        f"start.yaw_rad: missing (or yaw_deg, or {JOINTS}), must be {COUNTED}",
        f"start.pitch_rad: missing (or pitch_deg, or {JOINTS}), must be {COUNTED}",
        "keep_out[1].half_angle_deg: missing (or exclusion_deg), must be a number in (0, 180)",
        "keep_out[2].devices: missing (or vector), must be an array of names of devices",
    ],
)
def test_a_missing_key_is_named_with_what_it_must_be(line):
    assert line in faults_of(changed({line.partition(":")[0]: ABSENT}))


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (
            {"start.quaternion_wxyz": [1, 0, 0, 0]},
            "start.quaternion_wxyz: stands in the place of attitude, only one of them can be given",
        ),
        (
            {"start.yaw_deg": [1, 2]},
            "start.yaw_deg: stands in the place of yaw_rad, only one of them can be given",
        ),
        (
            {"start.attitude": ABSENT, "start.quaternion_wxyz": [0.1, 0.2, 0.3, 0.4]},
            "start.quaternion_wxyz = [0.1, 0.2, 0.3, 0.4]: must be a unit quaternion in the order w x y z, "
            "its norm is 0.547723",
        ),
        (
            {"start.attitude": ABSENT, "start.quaternion_wxyz": [1, 0, 0]},
            "start.quaternion_wxyz = [1, 0, 0]: must be a unit quaternion of 4 numbers, w x y z, not of 3",
        ),
        (
            {"start.attitude": ABSENT, "start.quaternion_wxyz": [0, 0, 0, 0]},
            "start.quaternion_wxyz = [0, 0, 0, 0]: must be a unit quaternion in the order w x y z, not zero",
        ),
        (
            {"goal.attitude": [0, 0, 1]},
            "goal.attitude: the goal has targets, from which attitude and joints are found; give either",
        ),
        (
            {"goal": {"attitude": [0, 0, 1], "yaw_rad": [0, 0], "pitch_rad": [0, 0], "yaw_limit_deg": 3}},
            "goal.yaw_limit_deg: only a goal with targets has it",
        ),
        ({"goal": {}}, "goal: must be a table with targets, or with attitude, yaw_rad and pitch_rad"),
        (
            {"goal": {"prefer": []}},
            "goal: must be a table with targets, or with attitude, yaw_rad and pitch_rad; "
            "a wish comes after targets: what it is alone is a target",
        ),
        (
            {"spacecraft.inertia_kg_m2": ABSENT, "spacecraft.torque_limit_nm": ABSENT, **NO_STAGES},
            "spacecraft.wheel_momentum_limit_nms = 4.0: needs spacecraft.inertia_kg_m2",
        ),
        (
            {"search.terminal_step_scale": {"four": 0.5}},
            "search.terminal_step_scale.four: no such jointed device, perhaps fore is meant",
        ),
        ({"spacecraft.terminal[1].name": "fore", "keep_out": [], "keep_in": [], "joint_bound": []},
         'spacecraft.terminal[1].name = "fore": the same as spacecraft.terminal[0].name'),
    ],
)  # fmt: skip
def test_keys_that_contradict_each_other_are_named(changes, line):
    assert faults_of(changed(changes)) == (line,)


@pytest.mark.parametrize(
    ("inertia", "complaint"),
    [
        (
            [[1, 0, 0], [0.1, 1, 0], [0, 0, 1]],
            "must be symmetric, but [0][1] = 0 is not [1][0] = 0.1",
        ),
        (
            [[2, 0.1, 0.2], [0.1, 2, 0.3], [0.25, 0, 2]],
            "must be symmetric, but [0][2] = 0.2 is not [2][0] = 0.25, [1][2] = 0.3 is not [2][1] = 0",
        ),
        ([[0, 0, 0], [0, 0, 0], [0, 0, 0]], "must be positive definite"),
        (np.diag([1e-13] * 3).tolist(), "must have its largest moment in [1e-12, 1e12]"),
        ([[1, 2, 0], [2, 1, 0], [0, 0, 1]], "must be positive definite"),
        ([[0.3, 0.3, 0], [0.3, 0.3, 0], [0, 0, 0.6]], "must be positive definite"),
        (
            [[1e9, 0, 0], [0, 1e9, 0], [0, 0, 2.01e9]],
            "must have no principal moment above the sum of the other two, as no body has",
        ),
    ],
)
def test_an_inertia_must_be_that_of_a_body(inertia, complaint):
    assert faults_of(changed({"spacecraft.inertia_kg_m2": inertia, **NO_STAGES})) == (
        f"spacecraft.inertia_kg_m2 = {inertia}: {complaint}",
    )
    flat_plate = [[1e-9, 0, 0], [0, 1e-9, 0], [0, 0, 2e-9]]
    assert sc.scenario_from_dict(changed({"spacecraft.inertia_kg_m2": flat_plate, **NO_STAGES}))


def test_the_papers_method_stretches_the_time_from_rest_to_rest_alone():
    line = (
        'trajectory.duration_s = "stretched": must be a number of seconds, since stretching the time would '
        "change start.angular_velocity_rad_s, start.joint_rates_rad_s, goal.angular_velocity_rad_s"
    )
    at_goal = {"goal.joint_rates_rad_s": [0, 0, 0, 0], "trajectory.method": "paper"}
    assert faults_of(changed({"trajectory.duration_s": "stretched", **at_goal})) == (line,)
    of_paper = {"trajectory": {"method": "paper"}, "goal.joint_rates_rad_s": [0, 0, 0, 0]}
    assert faults_of(changed(of_paper)) == (line,)  # it is the default
    assert sc.scenario_from_dict(changed({"trajectory": {}}))  # the other method does
    assert faults_of(changed({"trajectory": {"method": "paper", "duration_s": "minimum"}})) == (
        'trajectory.duration_s = "minimum": only trajectory.method = "global" has it',
    )
    rest = {
        f"{table}.{key}": ABSENT
        for table in ("start", "goal")
        for key in ("angular_velocity_rad_s", "joint_rates_rad_s")
    }
    assert sc.scenario_from_dict(changed({"trajectory.duration_s": "stretched", **rest}))


def test_a_start_outside_the_joint_limits_is_no_fault_of_the_file():
    assert sc.scenario_from_dict(changed({"start.yaw_rad": [10.0, 3.0]})).start.joints[0] == 10


def test_the_wrong_spacecraft_does_not_hide_what_is_wrong_elsewhere():
    found = faults_of(changed({"spacecraft": 3, "keep_out[0].half_angle_deg": -1, "trajectory.order": 2}))
    assert found == (
        "spacecraft = 3: must be a table",
        "keep_out[0].half_angle_deg = -1: must lie in (0, 180)",
        "trajectory.order = 2: must lie in [5, 24]",
    )


def test_too_many_zones_or_faults_end_the_reading():
    zone = TABLES["keep_out"][1]
    assert faults_of(changed({"keep_out": [zone] * 1000})) == (
        "the file: 1003 zones, more than the 1000 that are allowed",
    )
    found = faults_of({f"key {i}": 0 for i in range(100_000)})
    assert (len(found), found[-1]) == (1001, "too many faults, reading stopped here")


anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from(["fore", "aft", ""]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(st.sampled_from(PLACES), anything, min_size=1, max_size=3))
@example({"keep_out": True})
def test_no_value_anywhere_raises_anything_but_the_scenario_error(changes):
    try:
        tables = changed(dict(sorted(changes.items(), reverse=True)))
        scenario = sc.scenario_from_dict(tables)
    except sc.ScenarioError:
        return
    text = sc.dump_scenario(scenario)
    assert sc.dump_scenario(sc.parse_scenario(text)) == text
