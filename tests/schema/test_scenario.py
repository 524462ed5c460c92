"""Reading scenario files to the model, and writing them back."""

import json
import math
from dataclasses import MISSING, fields, replace
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import jaxplan as jp
import jaxplan.schema as sc
from jaxplan.schema.layout import (
    INSTRUMENT,
    JOINT_BOUND,
    KEEP_IN,
    KEEP_OUT,
    SCENARIO,
    SEARCH,
    SPACECRAFT,
    TERMINAL,
    TRAJECTORY,
    VECTOR,
)
from jaxplan.schema.sky import SKY
from jaxplan.schema.states import STATE, TARGETS
from jaxplan.schema.value_kinds import shortest_degrees

EVERY_KEY = Path(__file__).parents[1] / "scenarios" / "every_key.toml"
MINIMAL = """
schema_version = 1
name = "minimal"
spacecraft = { rate_limit_deg_s = 3, acceleration_limit_deg_s2 = 2 }
start = { attitude = [0, 0, 0] }
goal = { attitude = [0, 0, 1] }
"""


def bits(scenario):
    """All that a scenario holds: the shape of its tree with the static fields, and its numbers to the bit."""
    leaves, tree = jax.tree_util.tree_flatten(scenario)
    return tree, [np.asarray(leaf, dtype=float).tobytes() for leaf in leaves]


def with_start(text):
    return sc.parse_scenario(MINIMAL.replace("start = { attitude = [0, 0, 0] }", f"start = {{ {text} }}"))


def test_scenarios_are_equal_if_their_files_are():
    one, other = sc.load_scenario(EVERY_KEY), sc.load_scenario(EVERY_KEY)
    assert one == other
    assert len({one, other}) == 1
    wider = replace(one.keep_out[1], half_angle=one.keep_out[1].half_angle + 1e-9)
    assert one != replace(one, keep_out=(one.keep_out[0], wider))
    assert one != replace(one, name="another")
    assert one != "every key"


def test_a_file_is_read_in_radians_and_seconds():
    s = sc.load_scenario(EVERY_KEY)
    craft = s.spacecraft
    assert (s.name, craft.device_names) == ("every key", ("fore", "aft", "star-tracker"))
    np.testing.assert_allclose(craft.joint_ranges[:, 1], np.deg2rad([180, 90, 15.5, 30]), rtol=1e-15)
    np.testing.assert_allclose(craft.joint_rate_limits, np.deg2rad([4, 5, 4, 5]), rtol=1e-15)
    np.testing.assert_allclose(craft.joint_acceleration_limits, np.deg2rad([3, 2.1, 3, 2.1]), rtol=1e-15)
    limits = [craft.rate_limit, craft.acceleration_limit, *craft.jerk_limit]
    np.testing.assert_allclose(limits, np.deg2rad([3, 2, 1.5, 1.2, 0.9]), rtol=1e-15)
    np.testing.assert_array_equal(craft.torque_limit, [0.2, 0.3, 0.25])
    assert craft.wheel_momentum_limit == 4.0
    np.testing.assert_array_equal(s.start.joints, [0.9272, 1.2532, 0.1686, 0.1439])
    np.testing.assert_array_equal(s.goal.joint_rates, [0, 0, 0, 0.004])
    assert s.goal.pitch_limit == pytest.approx(math.radians(8), rel=1e-15)
    assert [zone.devices for zone in s.keep_out] == [
        ("star-tracker", "aft"),
        (),
        ("fore",),
        ("aft",),
        ("star-tracker",),
    ]
    assert [zone.outside for zone in s.keep_out] == [None] * 4 + ["field_of_view"]
    np.testing.assert_allclose(craft.instruments[0].field_of_view, np.deg2rad([20.1, 12]), rtol=1e-15)
    np.testing.assert_allclose(craft.terminals[0].mask[0][2], np.deg2rad([-160, -5.5]), rtol=1e-15)
    assert (s.keep_in[0].devices, s.keep_in[0].any_of) == (("fore",), "relay")
    assert s.search.terminal_step_scale == {"fore": 0.5}
    assert (s.search.attitude_moves, s.search.clearance) == (7, pytest.approx(math.radians(0.7)))
    assert (s.trajectory.duration, s.trajectory.order, s.trajectory.rate_weight) == (80.0, 11, 0.0)
    assert (s.trajectory.node_tube, s.trajectory.end_acceleration) == (math.radians(2.5), "free")


def test_what_a_file_leaves_out_is_the_default_of_the_model():
    s = sc.parse_scenario(MINIMAL)
    assert vars(s.search) == vars(jp.SearchSettings())
    assert vars(s.trajectory) == vars(jp.TrajectorySettings())
    assert s.trajectory.duration == "stretched"
    assert (s.keep_out, s.keep_in, s.spacecraft.terminals, s.spacecraft.instruments) == ((), (), (), ())
    assert s.spacecraft.jerk_limit is s.spacecraft.inertia is s.spacecraft.torque_limit is None
    np.testing.assert_array_equal(s.start.angular_velocity, np.zeros(3))
    assert s.start.joints.shape == s.start.joint_rates.shape == s.goal.joints.shape == (0,)


def test_writing_and_reading_again_gives_the_same_bits():
    s = sc.load_scenario(EVERY_KEY)
    text = sc.dump_scenario(s)
    assert bits(sc.parse_scenario(text)) == bits(s)
    assert sc.dump_scenario(sc.parse_scenario(text)) == text


@pytest.mark.parametrize(
    "written", [0.7, [0.7, 0.7, 0.7], [0.1, 1.3, 2.9], [1, 2, 3]], ids=["one", "equal", "three", "integers"]
)
def test_limits_of_the_body_axes_are_written_as_they_were_given(written):
    keys = ("rate_limit_deg_s", "acceleration_limit_deg_s2", "jerk_limit_deg_s3")
    loads = ("torque_limit_nm", "wheel_momentum_limit_nms")
    tables = sc.scenario_to_dict(sc.load_scenario(EVERY_KEY))
    tables["spacecraft"] |= dict.fromkeys((*keys, *loads), written)
    read = sc.scenario_from_dict(tables)
    craft = read.spacecraft
    for limit in (craft.rate_limit, craft.acceleration_limit, craft.jerk_limit):
        np.testing.assert_array_equal(limit, np.deg2rad(written))
    np.testing.assert_array_equal(craft.torque_limit, written)
    again = sc.scenario_to_dict(read)["spacecraft"]
    assert [again[key] for key in (*keys, *loads)] == [written] * 5
    assert bits(sc.parse_scenario(sc.dump_scenario(read))) == bits(read)


@pytest.mark.parametrize("terminals", [0, 1, 2, 3, 4, 12])
def test_any_number_of_terminals_survives_writing(terminals):
    rng = np.random.default_rng(terminals)
    unit = rng.normal(size=(terminals + 1, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    keys = ("mount_deg", "yaw_limit_deg", "pitch_limit_deg", "rate_limit_deg_s", "acceleration_limit_deg_s2")
    tables = {
        "schema_version": 1,
        "name": f'{terminals} terminals, \u00e9\u00df "quoted" \\ slashed',
        "spacecraft": {
            **dict.fromkeys(("rate_limit_deg_s", "acceleration_limit_deg_s2"), 2.0),
            "terminal": [
                {"name": f"t {i}"} | dict(zip(keys, rng.uniform(0, 89, 5).tolist(), strict=True))
                for i in range(terminals)
            ],
        },
        "start": {
            "quaternion_wxyz": rng.permutation([0.5, -0.1, 0.5, 0.7]).tolist(),
            "yaw_deg": rng.uniform(-90, 90, terminals).tolist(),
            "pitch_deg": rng.uniform(-15, 15, terminals).tolist(),
        },
        "goal": {"targets": unit[1:].tolist()} if terminals else {"attitude": unit[0].tolist()},
        "keep_out": [
            {"name": f"z{i}", "direction": u.tolist(), "half_angle_deg": 7.1} for i, u in enumerate(unit)
        ],
        "search": {"terminal_step_scale": {f"t {i}": float(rng.uniform()) for i in range(terminals)}},
    }
    s = sc.scenario_from_dict(tables)
    assert len(s.spacecraft.terminals) == terminals
    assert s.start.joints.shape == (2 * terminals,)
    np.testing.assert_allclose(s.start.joints[:terminals], np.deg2rad(tables["start"]["yaw_deg"]), rtol=1e-15)
    assert bits(sc.parse_scenario(sc.dump_scenario(s))) == bits(s)
    assert bits(
        sc.scenario_from_dict(json.loads(json.dumps(sc.scenario_to_dict(s), allow_nan=False)))
    ) == bits(s)


@given(st.floats(-360, 360))
def test_every_angle_in_degrees_is_written_back_to_the_same_radians(degrees):
    angle = math.radians(degrees)
    assert math.radians(shortest_degrees(angle)).hex() == angle.hex()


@given(st.decimals(-360, 360, places=12))
def test_degrees_come_back_with_the_digits_they_were_given(degrees):
    assert shortest_degrees(math.radians(float(degrees))) == float(degrees)


@given(st.floats(1e-300, 7))
def test_any_radians_are_written_to_the_last_digit_but_one(angle):
    assert math.radians(shortest_degrees(angle)) == pytest.approx(angle, rel=2.3e-16, abs=0)


def test_only_what_is_required_or_differs_from_the_default_is_written():
    written = sc.scenario_to_dict(sc.parse_scenario(MINIMAL))
    assert written == {
        "schema_version": 1,
        "name": "minimal",
        "spacecraft": {"rate_limit_deg_s": 3.0, "acceleration_limit_deg_s2": 2.0},
        "start": {"attitude": [0.0, 0.0, 0.0]},
        "goal": {"attitude": [0.0, 0.0, 1.0]},
        "search": {"method": "mha"},  # a later version may have another default
        "trajectory": {"method": "global"},
    }


def test_minus_zero_survives_writing():
    s = with_start("attitude = [-0.0, 0, 1], angular_velocity_rad_s = [-0.0, 0, 0]").start
    again = sc.parse_scenario(sc.dump_scenario(replace(sc.parse_scenario(MINIMAL), start=s))).start
    assert np.signbit(again.rotation_vector).tolist() == [True, False, False]
    assert np.signbit(again.angular_velocity).tolist() == [True, False, False]


def test_words_stand_for_their_meaning_both_ways():
    text = MINIMAL + '[search]\ntime_limit_s = "off"\n[trajectory]\n'
    for word in ("stretched", "minimum"):
        s = sc.parse_scenario(text + f'duration_s = "{word}"\n')
        assert math.isinf(s.search.time_limit)
        assert s.trajectory.duration == word
        assert sc.scenario_to_dict(s)["search"]["time_limit_s"] == "off"
        assert sc.parse_scenario(sc.dump_scenario(s)).trajectory.duration == word


@pytest.mark.parametrize("written", ["inf", '"inf"'])
def test_a_tube_may_be_infinite(written):
    s = sc.parse_scenario(MINIMAL + f"[trajectory]\nnode_tube_deg = {written}\n")
    assert s.trajectory.node_tube == math.inf
    again = sc.parse_scenario(sc.dump_scenario(s))
    assert again.trajectory.node_tube == math.inf
    assert bits(again) == bits(s)


def test_a_scenario_is_a_tree_of_numbers():
    s = sc.parse_scenario(sc.dump_scenario(sc.load_scenario(EVERY_KEY)))
    doubled = jax.tree_util.tree_map(lambda leaf: 2 * leaf, s)
    assert doubled.search.terminal_step_scale == {"fore": 1.0}
    np.testing.assert_array_equal(doubled.goal.directions, 2 * s.goal.directions)
    assert (doubled.name, doubled.search.method, doubled.keep_out[1].name) == (
        s.name,
        s.search.method,
        "earth",
    )
    on_device = jax.tree_util.tree_map(jax.numpy.asarray, s)
    assert sc.dump_scenario(on_device) == sc.dump_scenario(s)
    stretched = jax.tree_util.tree_map(np.asarray, sc.parse_scenario(MINIMAL))
    assert stretched.trajectory.duration == "stretched"


@pytest.mark.parametrize(
    "quaternion",
    [[0.8, 0.2, -0.4, 0.4], [-0.8, 0.2, -0.4, 0.4], [1, 0, 0, 0], [-1, 0, 0, 0], [0.9999995, 1e-3, 0, 0]],
)
def test_a_quaternion_is_the_rotation_that_scipy_reads(quaternion):
    state = with_start(f"quaternion_wxyz = {quaternion}").start
    expected = Rotation.from_quat(quaternion, scalar_first=True).as_rotvec()
    np.testing.assert_allclose(state.rotation_vector, expected, atol=1e-15)


def test_half_a_turn_as_a_quaternion_keeps_its_axis():
    for quaternion in ([0, 0.6, 0, -0.8], [-0.0, 0.6, 0, -0.8]):
        state = with_start(f"quaternion_wxyz = {quaternion}").start
        np.testing.assert_allclose(state.rotation_vector, [0.6 * np.pi, 0, -0.8 * np.pi], rtol=1e-15)


def test_published_directions_are_normalised_and_unit_ones_keep_their_bits():
    zones = sc.load_scenario(EVERY_KEY).keep_out
    printed = np.array([0.3214, 0.5567, 0.7660])
    np.testing.assert_allclose(zones[0].direction, printed / np.linalg.norm(printed), rtol=1e-15)
    rng = np.random.default_rng(7)
    unit = rng.normal(size=(1000, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    rows = [{"name": f"z{i}", "direction": u.tolist(), "half_angle_deg": 1} for i, u in enumerate(unit)]
    base = sc.scenario_to_dict(sc.parse_scenario(MINIMAL))
    read = sc.scenario_from_dict(base | {"keep_out": rows}).keep_out
    assert np.array([zone.direction for zone in read]).tobytes() == unit.tobytes()


def test_saving_replaces_the_file_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "scene.toml"
    first, second = sc.parse_scenario(MINIMAL), sc.load_scenario(EVERY_KEY)
    sc.save_scenario(first, path)
    assert bits(sc.load_scenario(path)) == bits(first)

    def full_disk(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.replace", full_disk)
        with pytest.raises(OSError, match="No space"):
            sc.save_scenario(second, path)
    assert bits(sc.load_scenario(path)) == bits(first)
    sc.save_scenario(second, path)
    assert bits(sc.load_scenario(path)) == bits(second)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "table", [SCENARIO, SKY, SPACECRAFT, TERMINAL, VECTOR, KEEP_OUT, KEEP_IN, JOINT_BOUND, SEARCH, TRAJECTORY]
)
def test_the_layout_covers_the_model(table):
    needed = {f.name for f in fields(table.model) if f.default is MISSING and f.default_factory is MISSING}
    whole = {f.name for f in fields(table.model)}
    instead = {entry.instead_of for entry in table.fields}  # of these one is required, whichever
    required = {entry.attribute for entry in table.fields if entry.required} - {"schema_version"}
    assert required - instead == needed - instead
    assert whole <= {entry.attribute for entry in table.fields}


def test_the_example_file_uses_every_key():
    used = sc.scenario_to_dict(sc.load_scenario(EVERY_KEY))

    def keys(table, *left_out):
        return {entry.key for entry in table.fields} - set(left_out)

    assert keys(SCENARIO, "sky") == set(used)  # which is resolved when it is read, as a zone's body is
    # drives, mounts, ranges and goals by name are in the files of test_device_files, wheels in their own test
    assert keys(SPACECRAFT, "drive", "wheel", "allocation") == set(used["spacecraft"])
    mounted = ("mount", "yaw_range_deg", "pitch_range_deg")
    own = [
        f"{axis}_{of}"
        for axis in ("yaw", "pitch")
        for of in ("rate_limit_deg_s", "acceleration_limit_deg_s2")
    ]
    assert keys(TERMINAL, *mounted, *own) == set(used["spacecraft"]["terminal"][0])
    angles = ("yaw_deg", "pitch_deg", "drive_rad", "drive_deg", "joints_deg")
    angles += ("frame",)  # which is resolved, too
    assert keys(STATE, "quaternion_wxyz", *angles) == set(used["start"])
    assert keys(TARGETS, "prefer", "hold", "criterion", "tolerance_deg") == set(used["goal"])
    others = ("satellite", "direction_samples", "times_s", "axis_body", "axis_device")
    assert keys(KEEP_OUT, "body", "exclusion_deg", "moving", *others, "outside") == set(used["keep_out"][0])
    assert keys(KEEP_IN, *others, "inside") == set(used["keep_in"][0])
    assert keys(INSTRUMENT) == set(used["spacecraft"]["instrument"][0])
    assert keys(VECTOR) == set(used["keep_in"][0]["vector"][0])
    assert keys(JOINT_BOUND) == set(used["joint_bound"][0])
    assert {"axis_body", "axis_device", "outside"} <= {key for zone in used["keep_out"] for key in zone}
    # methods are written even where they are the default
    assert keys(SEARCH) == set(used["search"])
    assert keys(TRAJECTORY) == set(used["trajectory"])
