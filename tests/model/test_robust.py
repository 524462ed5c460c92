"""What a tube takes off, beside the largest that perturbed directions and joint angles do."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_observer, make_scenario, make_spacecraft
from reference import angle, assert_each, in_body, outside
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.constraints import JOINTS, constraint_margins, state_margins
from jaxplan.model.robust import Robust, usable
from jaxplan.model.tabulation import tabulate
from jaxplan.schema import ScenarioError
from jaxplan.schema.reading import take_in

ERROR = np.deg2rad(2.0)
ROBUST = Robust(attitude_error=np.deg2rad(1.5), joint_error=ERROR, torque_reserve=25.0, momentum_reserve=10.0)
SIGNS = np.array([[yaw, pitch] for yaw in (-1, 1) for pitch in (-1, 1)]) * ERROR


def swings(craft, name, along, count=4001):
    """(k,) the most that errors of its joints move a direction along a device's moving part."""
    rng = np.random.default_rng(3)
    joints = np.tile(np.mean(craft.joint_ranges, axis=1), (count, 1))
    own = [n for n, joint in enumerate(craft.joint_names) if joint.startswith(name)]
    joints[:, own] = rng.uniform(*craft.joint_ranges[own].T, (count, len(own)))
    still, most = in_body(craft, name, joints, along), np.zeros(count)
    for sign in SIGNS:
        moved = joints.copy()
        moved[:, own] += sign[: len(own)]
        most = np.maximum(most, angle(still, in_body(craft, name, moved, along)))
    return most


def test_the_swing_bounds_what_joints_move_and_is_nearly_reached():
    craft = make_observer()
    antenna, array = craft.terminals[0], craft.drives[0]
    rng = np.random.default_rng(0)
    for along in [(1.0, 0.0, 0.0), *rng.standard_normal((6, 3))]:
        most = swings(craft, "antenna", np.array(along) / np.linalg.norm(along))
        assert_each(most, "<=", ROBUST.swing(antenna) + 1e-12)
        if along[0] == 1.0:
            assert np.max(most) >= 0.999 * ROBUST.swing(antenna)
    most = swings(craft, "array", (1.0, 0.0, 0.0))
    assert_each(most, "<=", ROBUST.swing(array) + 1e-12)
    assert np.max(most) >= 0.98 * ROBUST.swing(array)  # its normal is 80 deg off the axis
    assert ROBUST.swing(antenna) == pytest.approx(2 * np.arccos(np.cos(ERROR / 2) ** 2), rel=1e-9)
    assert ROBUST.swing(craft.instruments[0]) == 0
    tiny = Robust(joint_error=1e-12)
    assert tiny.terminal_swing == pytest.approx(np.sqrt(2) * 1e-12, rel=1e-12)


def test_margins_fall_by_what_the_worst_errors_take_and_by_no_less():
    """The least margin over errors is that with the tube, nearly so where pitches are about zero."""
    craft = make_spacecraft(2, 1)
    sky, aside = np.array([0.36, 0.48, 0.8]), np.array([0.5, 0.5, np.sqrt(0.5)])
    zones = [
        jp.KeepOut(name="out", direction=sky, half_angle=0.4),
        jp.KeepIn(name="in", direction=sky, half_angle=1.4, devices=("terminal-1", "camera-1")),
        jp.KeepOut(name="panel", axis_body=aside, half_angle=0.3, devices=("terminal-2",)),
        jp.KeepOut(name="beam", axis_device="terminal-2", half_angle=0.3, devices=("terminal-1",)),
    ]
    scene = replace(make_scenario(2), spacecraft=craft, keep_out=(), keep_in=())
    outs, ins = [z for z in zones if z.side > 0], [z for z in zones if z.side < 0]
    scene = replace(scene, keep_out=tuple(outs), keep_in=tuple(ins))
    rng, count = np.random.default_rng(1), 300
    attitudes = Rotation.random(count, rng=rng)
    joints = np.concatenate([rng.uniform(-1, 1, (count, 2)), rng.uniform(-0.02, 0.02, (count, 2))], axis=1)

    def least(robust, turns, angles):
        rows = tabulate(scene.keep_out, scene.keep_in, craft, robust=robust)
        found = state_margins(rows, rows.sights(craft.gimbals, craft.fixed_boresights), turns, angles)
        return {
            zone.name: np.min(found[:, rows.zone == number], axis=(1, 2))
            for number, zone in enumerate(scene.zones)
        }

    with_tube = least(ROBUST, attitudes.as_matrix(), joints)
    worst = {name: np.full(count, np.inf) for name in with_tube}
    for _ in range(1500):
        turn = Rotation.from_rotvec(ROBUST.attitude_error * unit_like(rng, count))
        signs = ERROR * rng.choice([-1.0, 1.0], joints.shape)
        own = least(None, (attitudes * turn).as_matrix(), joints + signs)
        for name, margin in own.items():
            worst[name] = np.minimum(worst[name], margin)
    for name, margin in with_tube.items():
        assert_each(worst[name], ">=", margin - 1e-12)
        turned, swung = name in ("out", "in"), 2 if name == "beam" else 1
        lost = turned * ROBUST.attitude_error + swung * ROBUST.terminal_swing
        # two terminals nearly level turn their beams toward each other by yaw alone, e of the sqrt(2) e each
        assert np.min(worst[name] - margin) <= (0.35 if name == "beam" else 0.06) * lost, name


def unit_like(rng, count):
    vectors = rng.standard_normal((count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_masks_grow_by_the_errors_and_by_no_more_at_a_sharp_corner():
    corners = np.deg2rad([[-20.0, -12.0], [22.0, -9.0], [-16.0, -7.0]])
    craft = make_spacecraft(1)
    masked = replace(craft, terminals=(replace(craft.terminals[0], mask=(corners,)),))
    rows = tabulate((), (), masked, robust=ROBUST)
    assert np.all(rows.frame[rows.zone >= 0] == JOINTS)
    joints = np.random.default_rng(0).uniform(*np.array([(-0.6, 0.6), (-0.3, 0.2)]).T, (20_000, 2))
    attitudes = np.broadcast_to(np.eye(3), (len(joints), 3, 3))
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
    margin = np.min(constraint_margins(rows, state_margins(rows, sights, attitudes, joints)), axis=1)
    grown = (corners[:, None] + SIGNS).reshape(-1, 2)  # all corners, moved by all errors
    hull = grown[ConvexHull(grown).vertices]
    beyond = outside(hull, joints)
    np.testing.assert_array_equal(margin >= 0, beyond >= 0)


def test_ranges_and_torque_are_what_is_left():
    craft = replace(make_observer(), inertia=np.eye(3) * 50, torque_limit=np.array([0.4, 0.3, 0.2]))
    craft = replace(craft, wheel_momentum_limit=np.array([4.0, 5.0, 6.0]))
    left = usable(craft, ROBUST)
    np.testing.assert_allclose(left.joint_ranges - craft.joint_ranges, [[ERROR, -ERROR]] * 3, atol=1e-15)
    np.testing.assert_allclose(left.torque_limit, [0.3, 0.225, 0.15])
    np.testing.assert_allclose(left.wheel_momentum_limit, [3.6, 4.5, 5.4])
    steep = replace(make_spacecraft(1).terminals[0], pitch_limit=np.deg2rad(89.99), yaw_limit=np.pi)
    left = usable(replace(make_spacecraft(1), terminals=(steep,)), ROBUST)
    ends = np.array([np.pi, np.deg2rad(89.9)]) - ERROR
    np.testing.assert_allclose(left.joint_ranges, np.stack([-ends, ends], axis=1), atol=1e-15)


LINK = jp.KeepIn(name="link", direction=[0, 0, 1.0], half_angle=0.05, devices=("terminal-1",))
FAULTS = {
    "a joint": ({}, {"joint_error": 0.3}, "robust.joint_error = 0.3 rad: must be below 0.261799, half of"),
    "a link": (
        {"keep_in": [LINK]},
        {"attitude_error": 0.03, "joint_error": 0.02},
        r"keep_in\[0\].half_angle = 0.05 rad: must be above 0.05828., which the tube of \[robust\]",
    ),
    "a wide zone": (
        {"keep_out": [jp.KeepOut(name="wide", direction=[0, 0, 1.0], half_angle=3.1)]},
        {"attitude_error": 0.1},
        r"keep_out\[0\].half_angle = 3.1 rad: must be below 3.04159, since the tube .* for terminal-1",
    ),
    "an error": ({}, {"attitude_error": -0.1}, "robust.attitude_error = -0.1 rad: must lie in"),
    "a reserve": ({}, {"torque_reserve": 100.0}, r"robust.torque_reserve = 100.*: must lie in \[0, 100\)"),
    "momentum": ({}, {"momentum_reserve": -1.0}, r"robust.momentum_reserve = -1.*: must lie in \[0, 100\)"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_a_tube_leaves_nothing_of_is_refused_by_name(name):
    changes, errors, told = FAULTS[name]
    scene = replace(make_scenario(2), **changes)
    take_in(scene)
    with pytest.raises(ScenarioError, match=told):
        take_in(replace(scene, robust=Robust(**errors)))


def test_a_field_of_view_narrower_than_the_tube_is_refused():
    camera = jp.Instrument(
        name="camera", boresight=[0, 0, 1.0], up=[1.0, 0, 0], field_of_view=np.deg2rad([6.0, 2.0])
    )
    craft = replace(make_spacecraft(2), instruments=(camera,))
    star = replace(LINK, half_angle=np.deg2rad(0.4), devices=("camera",), inside="field_of_view")
    scene = replace(make_scenario(2), spacecraft=craft, keep_in=(star,))
    take_in(replace(scene, robust=Robust(attitude_error=np.deg2rad(0.5))))
    with pytest.raises(ScenarioError, match=r"keep_in\[0\].half_angle .* since the tube"):
        take_in(replace(scene, robust=Robust(attitude_error=np.deg2rad(0.7))))
