"""Stages of gimbals that push back: beside MuJoCo and plain numpy; peaks of any motion, with their proof."""

from dataclasses import replace
from itertools import groupby

import jax
import numpy as np
import pytest
from builders import make_spacecraft
from manoeuvres import judge, manoeuvre
from reference import random_units
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from stages import exchanged, momentum, motion, parts, torque, with_stages
from wheels import INERTIA, instants, numbers, random_wheels

import jaxplan as jp
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.limits import timed_limits
from jaxplan.trajectory import measures
from jaxplan.trajectory.curve import on_common_pieces
from jaxplan.trajectory.kernels import Body, load_slopes_at, motion_at
from jaxplan.trajectory.peaks import peaks

STATES = 200


def drive(number):
    axis, ahead = random_units(np.random.default_rng(90 + number), 2)
    return jp.Drive(
        name=f"drive-{number}",
        axis=axis,
        boresight=ahead,
        range=np.array([-3.0, 3.0]),
        rate_limit=0.1,
        acceleration_limit=0.1,
    )


def oblique(terminals, drives, size=1.5, seed=0):
    """A spacecraft with terminals about any axes and drives, whose stages all have an inertia."""
    craft = make_spacecraft(terminals)
    rng = np.random.default_rng(seed)
    turns = Rotation.random(terminals, rng=rng).as_matrix()
    mounted = [
        replace(one, mount=None, mounting=jp.Mount(yaw_axis=turn[:, 2], boresight=turn[:, 0]))
        for one, turn in zip(craft.terminals, turns, strict=True)
    ]
    craft = replace(
        craft, terminals=tuple(mounted), drives=tuple(drive(k) for k in range(drives)), inertia=4 * INERTIA
    )
    return with_stages(craft, size, seed)


def states(craft, count, seed=1):
    """Angular velocities and accelerations (count, 3), joints, rates and accelerations (count, J)."""
    rng, joints = np.random.default_rng(seed), craft.joint_count
    spin = rng.normal(size=(2, count, 3))
    return spin[0], spin[1], rng.uniform(-3, 3, (count, joints)), *rng.normal(size=(2, count, joints))


def kinematics(craft, velocity, acceleration, joints, rates, accelerations):
    return Kinematics(
        spin=[velocity.T, acceleration.T],
        joints=[joints.T, rates.T, accelerations.T],
        drives=len(craft.drives),
        inertia=craft.fixed_inertia,
        stages=craft.stages,
    )


def text_of(values):
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


def as_mujoco(craft, seed=2):
    """The spacecraft as a model of MuJoCo, and the centre of mass (3,) of the whole in body axes.

    Its bodies have masses, and lie anywhere, but for the centres of mass of stages, which lie on their axes.
    So the whole's inertia about its centre of mass is that of the platform's, with what masses apart add.
    """
    rng = np.random.default_rng(seed)
    fixed, bodies = np.array(craft.fixed_inertia), ""
    places, masses = [np.zeros(3)], [rng.uniform(20, 60)]
    for _, own in groupby(parts(craft), key=lambda stage: stage[2]):  # of each device
        at, text, ends = rng.uniform(-1, 1, 3), "", ""
        for frame, inertia, yaw, pitch in own:
            joint, axis = (yaw, "0 0 1") if pitch is None else (pitch, "0 -1 0")
            turn = text_of(Rotation.from_matrix(frame).as_quat()[[3, 0, 1, 2]])
            where = f'pos="{text_of(at)}" quat="{turn}"' if pitch is None else ""
            places.append(at)
            masses.append(rng.uniform(1, 5))
            text += f'<body {where}><joint type="hinge" name="{joint}" axis="{axis}"/>'
            text += body_of(masses[-1], inertia)
            ends += "</body>"
        bodies += text + ends
    places, masses = np.array(places), np.array(masses)
    centre = masses @ places / masses.sum()
    for place, mass in zip(places - centre, masses, strict=True):
        fixed = fixed - mass * (place @ place * np.eye(3) - np.outer(place, place))
    base = f"<body><freejoint/>{body_of(masses[0], fixed)}{bodies}</body>"
    return f'<mujoco><option gravity="0 0 0"/><worldbody>{base}</worldbody></mujoco>', centre


def body_of(mass, inertia):
    full = text_of(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    return f'<inertial pos="0 0 0" mass="{mass:.17g}" fullinertia="{full}"/>'


@pytest.mark.parametrize(("terminals", "drives"), [(1, 0), (2, 1), (3, 2), (4, 0), (4, 3)])
def test_the_torque_is_that_of_mujocos_inverse_dynamics(terminals, drives):
    mujoco = pytest.importorskip("mujoco")
    craft = oblique(terminals, drives, seed=terminals)
    craft = replace(
        craft, inertia=60 * np.asarray(craft.inertia)
    )  # so that platforms with masses apart have one
    text, centre = as_mujoco(craft)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    own = states(craft, STATES)
    found = np.transpose(kinematics(craft, *own).torque)
    for number, (velocity, acceleration, joints, rates, accelerations) in enumerate(zip(*own, strict=True)):
        attitude = Rotation.random(rng=np.random.default_rng(number))
        data.qpos[3:7] = attitude.as_quat()[[3, 0, 1, 2]]
        data.qvel[3:6], data.qacc[3:6] = velocity, acceleration
        # no force: the centre of mass of the whole does not accelerate
        swung = np.cross(acceleration, centre) + np.cross(velocity, np.cross(velocity, centre))
        data.qacc[:3] = -attitude.apply(swung)
        for joint in range(craft.joint_count):
            hinge = model.joint(str(joint))
            data.qpos[hinge.qposadr[0]] = joints[joint]
            data.qvel[hinge.dofadr[0]], data.qacc[hinge.dofadr[0]] = rates[joint], accelerations[joint]
        mujoco.mj_inverse(model, data)
        expected = data.qfrc_inverse[3:6]
        np.testing.assert_allclose(found[number], expected, atol=1e-9 * np.linalg.norm(expected), rtol=0)
        assert np.abs(data.qfrc_inverse[:3]).max() < 1e-9 * np.linalg.norm(expected)


def test_momentum_and_torque_are_those_of_numpy_in_numpy_and_jax():
    craft = oblique(3, 2)
    velocity, acceleration, joints, rates, accelerations = own = states(craft, 50)
    found = kinematics(craft, *own)
    np.testing.assert_allclose(found.momentum.T, momentum(craft, velocity, joints, rates), atol=1e-12)
    step = 1e-6
    ends = [
        momentum(
            craft,
            velocity + side * step * acceleration,
            joints + side * step * rates + step**2 * accelerations / 2,
            rates + side * step * accelerations,
        )
        for side in (1, -1)
    ]
    expected = (ends[0] - ends[1]) / (2 * step) + np.cross(velocity, momentum(craft, velocity, joints, rates))
    np.testing.assert_allclose(found.torque.T, expected, atol=1e-6 * np.abs(expected).max())
    with jax.enable_x64(True):
        traced = jax.jit(lambda craft, *own: kinematics(craft, *own).torque)(craft, *own)
        slopes = jax.jit(jax.jacfwd(lambda craft: kinematics(craft, *own).torque.sum()))(craft)
    np.testing.assert_allclose(traced, found.torque, atol=1e-12 * np.abs(expected).max())
    for leaf in jax.tree.leaves(slopes):
        assert np.isfinite(leaf).all()


def test_moments_are_a_matrix_about_the_devices_axes_and_round_stages_turn_freely():
    craft = oblique(1, 1)
    by_moments, by_matrix = (
        replace(
            craft,
            terminals=(replace(craft.terminals[0], yaw_inertia=given, pitch_inertia=None),),
            drives=(replace(craft.drives[0], inertia=given),),
        )
        for given in (np.array([1.0, 2.0, 2.5]), np.diag([1.0, 2.0, 2.5]))
    )
    own = states(craft, 5)
    np.testing.assert_array_equal(kinematics(by_moments, *own).torque, kinematics(by_matrix, *own).torque)
    ball = np.full(3, 1.2)
    round_ = with_inertias(craft, lambda _: ball)
    velocity, acceleration, joints, rates, accelerations = own
    still = (velocity, acceleration, joints, 0 * rates, 0 * accelerations)
    plain = without(craft)
    np.testing.assert_allclose(
        kinematics(round_, *still).torque, kinematics(plain, *still).torque, atol=1e-12
    )


def test_three_moments_of_the_whole_are_a_matrix_in_measures_peaks_and_proof():
    trajectory = manoeuvre(3, terminals=2, drives=1, wiggle=0.3, step=1.0)
    base = oblique(2, 1, size=0.5, seed=1)
    moments = np.array([70.0, 80.0, 90.0])
    for loads in (
        {"wheels": random_wheels(4, 1)},
        {"torque_limit": np.array([2.0, 3, 4]), "wheel_momentum_limit": 5.0},
    ):
        for craft in (base, without(base)):
            own, other = (
                replace(craft, inertia=given, rate_limit=9.0, acceleration_limit=9.0, **loads)
                for given in (moments, np.diag(moments))
            )
            first, second = (peaks(trajectory, each) for each in (own, other))
            np.testing.assert_allclose(first.ratios, second.ratios, rtol=1e-12)
            assert judge(trajectory, own).peaks == judge(trajectory, other).peaks
            assert (
                judge(trajectory, replace(own, inertia=moments[:2]))
                .faults[0]
                .startswith("spacecraft.inertia has")
            )


def with_inertias(craft, of):
    """The spacecraft with the inertia of each stage made by a function of what it is."""
    return replace(
        craft,
        terminals=tuple(
            replace(one, yaw_inertia=of(one.yaw_inertia), pitch_inertia=of(one.pitch_inertia))
            for one in craft.terminals
        ),
        drives=tuple(replace(one, inertia=of(one.inertia)) for one in craft.drives),
    )


def without(craft):
    return with_inertias(craft, lambda _: None)


def test_momentum_is_conserved_where_no_torque_acts():
    """With joints that are driven along given angles, and the body left to itself, or to empty wheels."""
    craft = oblique(2, 1)
    rng = np.random.default_rng(5)
    size, phase, pace = rng.uniform(0.2, 1, (3, craft.joint_count))

    def driven(time):
        turn = pace * time + phase
        return size * np.sin(turn), size * pace * np.cos(turn), -size * pace**2 * np.sin(turn)

    def at(time, velocity, acceleration):
        spin = [velocity, acceleration]
        joints = list(driven(time))
        return Kinematics(
            spin=spin, joints=joints, inertia=craft.fixed_inertia, stages=craft.stages, drives=1
        )

    def change(time, state):
        attitude, velocity = state[:9].reshape(3, 3), state[9:]
        rest = at(time, velocity, np.zeros(3)).torque  # the torque is linear in the acceleration
        by_each = np.stack([at(time, velocity, axis).torque - rest for axis in np.eye(3)], axis=1)
        return np.concatenate([(attitude @ hat(velocity)).ravel(), -np.linalg.solve(by_each, rest)])

    first = np.concatenate([np.eye(3).ravel(), [0.3, -0.2, 0.4]])
    found = solve_ivp(
        change, (0, 20), first, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=np.linspace(0, 20, 9)
    )
    told = [
        state[:9].reshape(3, 3) @ at(time, state[9:], np.zeros(3)).momentum
        for time, state in zip(found.t, found.y.T, strict=True)
    ]
    np.testing.assert_allclose(told, told[:1] * len(told), rtol=0, atol=1e-12 * np.linalg.norm(told[0]))
    assert np.ptp(found.y[9:], axis=1).min() > 0.05  # though it tumbles


def test_wheels_that_give_what_a_motion_asks_keep_the_total_momentum():
    """The body and its joints turn as they are told; what wheels hold follows from their torque alone."""
    craft = oblique(2, 1)
    array = replace(craft, wheels=random_wheels(4, seed=3)).wheel_array
    rng = np.random.default_rng(6)
    size, phase, pace = rng.uniform(0.2, 0.8, (3, 3 + craft.joint_count))

    def driven(time):
        turn = pace * time + phase
        found = size * np.sin(turn), size * pace * np.cos(turn), -size * pace**2 * np.sin(turn)
        spin, joints = [own[:3] for own in found[:2]], [own[3:] for own in found]
        return spin, joints

    def at(time, total):
        spin, joints = driven(time)
        return Kinematics(
            spin=spin,
            joints=joints,
            drives=1,
            inertia=craft.fixed_inertia,
            stages=craft.stages,
            total=total,
            array=array,
        )

    first = at(0, np.zeros(3)).momentum + array.stored  # as of attitudes that begin with none

    def change(time, state):
        attitude = state[:9].reshape(3, 3)
        motion = at(time, attitude.T @ first)
        return np.concatenate([(attitude @ hat(motion.spin[0])).ravel(), -motion.wheel_torques])

    count = len(array.axes)
    begin = np.concatenate([np.eye(3).ravel(), array.apart + array.rows @ array.stored])
    found = solve_ivp(
        change, (0, 20), begin, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=np.linspace(0, 20, 9)
    )
    for time, state in zip(found.t, found.y.T, strict=True):
        attitude, held = state[:9].reshape(3, 3), state[9 : 9 + count]
        told = attitude @ (at(time, first).momentum + held @ array.axes)
        np.testing.assert_allclose(told, first, rtol=0, atol=1e-12 * np.linalg.norm(first))
        expected = at(time, attitude.T @ first).wheel_momenta
        np.testing.assert_allclose(held, expected, rtol=0, atol=1e-12 * np.linalg.norm(first))
    assert np.ptp(found.y[9:], axis=1).min() > 0.5  # N m s, that wheels take up


def hat(vector):
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def test_pieces_of_platform_and_joints_together_are_the_same_motion():
    trajectory = manoeuvre(4, terminals=2, drives=1, pieces=3, joint_pieces=2)
    found = on_common_pieces(trajectory)
    assert len(found.breaks) == len(found.joint_breaks) == 5
    time = np.linspace(0, 80, 301)
    own, other = trajectory.sample(time), found.sample(time)
    for name, values in vars(own).items():
        scale = np.abs(values).max()
        near = 1e-8 if "jerk" in name else 1e-10  # each derivative on a shorter piece costs digits
        np.testing.assert_allclose(getattr(other, name), values, atol=near * scale, err_msg=name)
    assert on_common_pieces(found) is found


@pytest.mark.parametrize("seed", range(4))
def test_peaks_and_what_is_proved_are_those_of_dense_samples(seed):
    """Of motions whose platform and joints have breaks of their own, on oblique gimbals that turn far."""
    trajectory = manoeuvre(seed, terminals=2, drives=1, pieces=3, joint_pieces=2, wiggle=0.3, step=1.0)
    wheels = random_wheels(4, seed) if seed % 2 else ()
    loads = {} if wheels else {"torque_limit": np.array([2.0, 3, 4]), "wheel_momentum_limit": 5.0}
    craft = replace(oblique(2, 1, seed=seed), wheels=wheels, rate_limit=9.0, acceleration_limit=9.0, **loads)
    time = instants(trajectory, 20_001)
    if wheels:
        axes, most, full, stored = numbers(craft)
        share = np.linalg.pinv(axes.T)
        given, held = exchanged(trajectory, craft, time)
        dense = {
            "wheel_torques": np.abs(given @ share.T / most),
            "wheel_momenta": np.abs((stored + (held - stored @ axes) @ share.T) / full),
        }
    else:
        dense = {
            "torque": np.abs(torque(trajectory, craft, time)) / craft.torque_limit,
            "wheel_momentum": np.abs(motion(trajectory, craft, time)[0]) / craft.wheel_momentum_limit,
        }
    found, proved = peaks(trajectory, craft), judge(trajectory, craft)
    told = dict(zip(found.names, found.ratios, strict=True))
    for name, shares in dense.items():
        largest = shares.max()
        kind = name.rsplit("_", 1)[-1].replace("torques", "torque").replace("momenta", "momentum")
        own = max(ratio for key, ratio in told.items() if kind in key)
        assert own == pytest.approx(largest, rel=1e-4)
        assert largest <= own * (1 + 1e-9)
        assert largest <= proved.peaks[name] * (1 + 1e-9)
        assert proved.peaks[name] <= 1.0001 * largest + 5e-7
    stretch = found.stretch
    if np.isfinite(stretch):
        assert np.max(peaks(trajectory.scaled(stretch), craft).ratios) == pytest.approx(1, abs=1e-9)
        assert measures.stretch(trajectory, craft) == pytest.approx(stretch, rel=1e-8)


@pytest.mark.parametrize(("terminals", "drives", "jerky"), [(2, 1, False), (1, 0, True), (0, 2, False)])
def test_slopes_of_loads_in_curves_are_differences(terminals, drives, jerky):
    craft, rng, step = oblique(terminals, drives), np.random.default_rng(terminals), 1e-5
    limits = {"wheels": random_wheels(4, seed=3), "jerk_limit": np.ones(3) if jerky else None}
    craft = replace(craft, torque_limit=None, wheel_momentum_limit=None, **limits)
    names, axes = tuple(limit.quantity.name for limit in timed_limits(craft)[0]), 3 + craft.joint_count
    body = Body.of(craft, rng.normal(size=axes - 3), rng.normal(size=axes))
    turn, places, curves = rng.normal(size=3), rng.uniform(size=6), rng.normal(size=(4, 6, axes))

    def loads(curves):
        return np.asarray(motion_at(np.eye(3), turn, places, curves, body, names=names)[2])

    with jax.enable_x64(True):
        found = np.asarray(load_slopes_at(turn, places, curves, body, names=names))
        allowed = 1e-6 * np.abs(found).max()
        for d, axis in np.ndindex(4, axes):
            change = np.zeros_like(curves)
            change[d, :, axis] = step
            expected = (loads(curves + change) - loads(curves - change)) / (2 * step)
            np.testing.assert_allclose(found[:, :, d, axis], expected, rtol=1e-6, atol=allowed)
