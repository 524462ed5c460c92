"""States in which devices point along their targets at the start, at the rates at which these move."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from builders import make_observer
from reference import angle, in_body
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.goal.pointing_start import NotPointingError

TIMES = np.linspace(0.0, 400.0, 81)


def unit(vector):
    return np.asarray(vector, float) / np.linalg.norm(vector)


def passing(first, turn):
    """A direction that turns by a rotation vector each second."""
    return jp.DirectionPath.through(TIMES, Rotation.from_rotvec(TIMES[:, None] * turn).apply(unit(first)))


def seen(craft, state, name):
    return state.attitude @ in_body(craft, name, np.asarray(state.joints)[None])[0]


def test_devices_point_along_their_targets_and_a_wish_is_met():
    craft, toward, link = make_observer(), unit([0.3, -0.2, 0.9]), unit([-0.4, 0.6, 0.5])
    state = jp.point(
        craft, {"telescope": toward, "antenna": link}, prefer=[jp.Wish(device="array", direction=[1, 0, 0])]
    )
    assert angle(seen(craft, state, "telescope"), toward) <= np.deg2rad(1e-6)
    assert angle(seen(craft, state, "antenna"), link) <= 1e-9
    away = angle(seen(craft, state, "array"), np.array([1.0, 0, 0]))
    plain = jp.point(craft, {"telescope": toward, "antenna": link})
    assert away <= angle(seen(craft, plain, "array"), np.array([1.0, 0, 0])) + 1e-6
    np.testing.assert_array_equal(state.angular_velocity, 0)


def test_rates_let_every_device_follow_its_target_and_turn_about_no_boresight_without_need():
    craft = make_observer()
    paths = {
        "telescope": passing([0.3, -0.2, 0.9], [1e-3, 4e-4, -2e-4]),
        "antenna": passing([-0.4, 0.6, 0.5], [-3e-4, 1e-3, 5e-4]),
    }
    state, step = jp.point(craft, paths), 1e-2

    class Later:
        attitude = state.attitude @ Rotation.from_rotvec(step * state.angular_velocity).as_matrix()
        joints = state.joints + step * state.joint_rates

    for name, path in paths.items():
        moved = (seen(craft, Later, name) - seen(craft, state, name)) / step
        np.testing.assert_allclose(moved, path.rate(step / 2), rtol=0, atol=1e-7)
    boresight = in_body(craft, "telescope", np.asarray(state.joints)[None])[0]
    assert abs(boresight @ state.angular_velocity) <= 1e-12


def test_zones_hold_at_the_start_or_it_is_refused():
    craft, toward = make_observer(), unit([0.3, -0.2, 0.9])
    inside = jp.KeepOut(name="sun", direction=toward, half_angle=0.3, devices=("telescope",))
    with pytest.raises(NotPointingError, match="zone"):
        jp.point(craft, {"telescope": toward}, keep_out=[inside])


def test_a_device_that_there_is_not_is_named():
    with pytest.raises(jp.ScenarioError, match="telescop"):
        jp.point(make_observer(), {"telescop": [0.0, 0.0, 1.0]})


def test_what_is_in_the_way_of_a_start_is_told_with_devices_and_angles():
    craft, toward = make_observer(), unit([0.3, -0.2, 0.9])
    one, other = craft.instruments[:2]
    between = np.rad2deg(angle(one.boresight, other.boresight))
    with pytest.raises(NotPointingError, match=f"{one.name} and {other.name} are {between:.6g} deg apart"):
        jp.point(craft, {one.name: toward, other.name: toward})
    inside = jp.KeepOut(name="sun", direction=toward, half_angle=0.3, devices=("telescope",))
    with pytest.raises(NotPointingError, match=r"telescope is 17\.19 deg inside keep-out zone sun"):
        jp.point(craft, {"telescope": toward}, keep_out=[inside])


def test_a_target_that_is_hidden_at_the_start_is_refused_with_when_it_is_seen():
    craft, path = make_observer(), passing([0.3, -0.2, 0.9], [1e-3, 0, 0])
    spans = [(0.0, 30.0, "the Earth"), (20.0, 75.001, "the Moon"), (200.0, 401.0, "the Earth")]
    spans = tuple(jp.Hidden(target="relay", by=by, start=a, end=b) for a, b, by in spans)
    for own, words in ((spans, "it is seen from 75.01 s on"), (spans[:1], "it is seen from 30 s on")):
        with pytest.raises(
            NotPointingError, match="relay, the target of antenna, is hidden by the Earth"
        ) as e:
            jp.point(craft, {"antenna": replace(path, hidden=own)})
        assert str(e.value).endswith(f"at the start; {words}")
    never = (jp.Hidden(target="relay", by="its horizon", start=0.0, end=500.0),)
    with pytest.raises(NotPointingError, match=r"by its horizon at the start; it is not seen again in all"):
        jp.point(craft, {"antenna": replace(path, hidden=never)})
    assert jp.point(craft, {"antenna": replace(path, hidden=spans[2:])}).joints.shape == (3,)


def test_a_field_of_view_that_no_attitude_keeps_off_a_zone_is_told_with_the_zone():
    craft, toward = make_observer(), unit([0.3, -0.2, 0.9])
    camera = replace(craft.instruments[0], field_of_view=np.deg2rad([20.0, 10.0]), up=None)
    camera = replace(camera, up=unit(np.cross(camera.boresight, [0.3, 0.5, -0.7])))
    craft = replace(craft, instruments=(camera,))
    near = Rotation.from_rotvec(np.deg2rad(13.0) * unit(np.cross(toward, [1.0, 0, 0]))).apply(toward)
    other = Rotation.from_rotvec(np.deg2rad(90.0) * toward).apply(near)
    zones = [
        jp.KeepOut(name=name, direction=axis, half_angle=np.deg2rad(5.0), outside="field_of_view")
        for name, axis in (("one", near), ("other", other))
    ]
    assert jp.point(craft, {camera.name: toward}, keep_out=zones[:1]).joints.shape == (3,)
    with pytest.raises(
        NotPointingError, match=r"breaks a zone; at one of them .* too close to keep-out zone"
    ):
        jp.point(craft, {camera.name: toward}, keep_out=zones)


def test_a_device_has_the_angles_that_are_told_at_the_start_whatever_is_in_the_way():
    craft = make_observer()
    masked = replace(craft.terminals[0], mask=(np.deg2rad([[10, 0], [60, 0], [60, 40], [10, 40]]),))
    craft, toward = replace(craft, terminals=(masked,)), {"telescope": unit([0.3, -0.2, 0.9])}
    clear, within, beyond = np.deg2rad([[100, 20, 30], [30, 20, 30], [100, 20, 300]])
    np.testing.assert_allclose(jp.point(craft, toward, joints=clear).joints, clear, rtol=0, atol=1e-12)
    with pytest.raises(NotPointingError, match="antenna is 20 deg inside mask 1 of antenna"):
        jp.point(craft, toward, joints=within)
    with pytest.raises(
        NotPointingError, match="array angle is 300 deg at the start, beyond its limit of 200 deg"
    ):
        jp.point(craft, toward, joints=beyond)
    state = jp.point(craft, toward, prefer=[jp.Wish(device="antenna", direction=[0.0, 0, 1])], joints=within)
    assert abs(state.joints[2] - within[2]) <= 1e-12
    assert not np.allclose(state.joints[:2], within[:2])


def test_joints_are_the_same_whatever_the_order_of_targets():
    craft, targets = make_observer(), {"array": [-0.8, 0.0, -0.6], "antenna": [-0.48, 0.6, 0.64]}
    known = [jp.point(craft, dict(order)) for order in permutations(targets.items())]
    for other in known:
        np.testing.assert_allclose(other.joints, known[0].joints, atol=1e-9)
        np.testing.assert_allclose(other.rotation_vector, known[0].rotation_vector, atol=1e-9)
