"""The certificate's peaks against dense sampling: derivatives of attitude and joints, torque, momentum."""

import re
from dataclasses import replace

import numpy as np
import pytest
from manoeuvres import craft, grid, judge, manoeuvre
from reference import joints_of, spin_of
from scipy.optimize import minimize_scalar

import jaxplan as jp
from jaxplan.certificate.bounds import Minima
from jaxplan.certificate.limits import Limited, faults
from jaxplan.model.limits import limits


def largest(trajectory, curve):
    """Largest |component| of a curve time -> (k, c), with the maximum between samples, and when."""
    time = grid(trajectory, 1001)
    values = np.abs(curve(time))
    at, component = np.unravel_index(np.argmax(values), values.shape)
    around = time[max(at - 1, 0)], time[min(at + 1, len(time) - 1)]

    def loss(t):
        return -abs(curve(np.array([t]))[0, component])

    found = minimize_scalar(loss, bounds=around, method="bounded", options={"xatol": 1e-10})
    return max(-float(found.fun), float(values[at, component])), float(time[at])


INERTIA = np.array([[120.0, 5, -3], [5, 80, 2], [-3, 2, 150]])


def curves(trajectory, terminals):
    """Every limited curve as a function of time, by its key in `peaks`."""

    def torque(time):
        velocity, acceleration, _ = spin_of(trajectory, time)
        return acceleration @ INERTIA + np.cross(velocity, velocity @ INERTIA)

    def length(derivative):
        return lambda time: np.linalg.norm(spin_of(trajectory, time)[derivative], axis=1, keepdims=True)

    return {
        "angular_velocity": lambda time: spin_of(trajectory, time)[0],
        "angular_velocity_norm": length(0),
        "angular_acceleration": lambda time: spin_of(trajectory, time)[1],
        "angular_acceleration_norm": length(1),
        "joint_rates": lambda time: joints_of(trajectory, time)[1],
        "joint_accelerations": lambda time: joints_of(trajectory, time)[2],
        "yaw": lambda time: joints_of(trajectory, time)[0, :, :terminals],
        "pitch": lambda time: joints_of(trajectory, time)[0, :, terminals:],
        "torque": torque,
        "wheel_momentum": lambda time: spin_of(trajectory, time)[0] @ INERTIA,
        "jerk": lambda time: spin_of(trajectory, time)[2],
    }


def limited(terminals, limits):
    """A spacecraft with the given limits, by their keys in `peaks`."""
    platform = {
        "rate_limit": limits["angular_velocity"],
        "rate_norm_limit": limits["angular_velocity_norm"],
        "acceleration_limit": limits["angular_acceleration"],
        "acceleration_norm_limit": limits["angular_acceleration_norm"],
        "jerk_limit": limits["jerk"],
        "inertia": INERTIA,
        "torque_limit": limits["torque"],
        "wheel_momentum_limit": limits["wheel_momentum"],
    }
    joints = {
        "yaw_limit": limits["yaw"],
        "pitch_limit": limits["pitch"],
        "rate_limit": limits["joint_rates"],
        "acceleration_limit": limits["joint_accelerations"],
    }
    return craft(terminals, joints=joints, **platform)


def test_peaks_are_bounds_and_tight():
    for seed in range(3):
        trajectory = manoeuvre(400 + seed, terminals=2, pieces=1 + seed % 3, wiggle=0.5)
        true = {name: largest(trajectory, curve)[0] for name, curve in curves(trajectory, 2).items()}
        report = judge(trajectory, limited(2, true))
        assert list(report.peaks) == list(report.peak_times) == list(true)
        for name, peak in report.peaks.items():
            assert 1 - 2e-9 <= peak <= 1 + 2e-9, name  # what differences leave
            time = report.peak_times[name] + np.array([-1e-9, 0, 1e-9])  # the jerk jumps at breaks
            there = np.abs(curves(trajectory, 2)[name](np.clip(time, 0, 80))).max()
            assert there == pytest.approx(true[name], rel=1e-5), name


@pytest.mark.parametrize("name", curves(None, 1))
def test_each_limit_is_held_to_a_millionth(name):
    trajectory = manoeuvre(500, terminals=1, wiggle=0.5)
    wide = dict.fromkeys(curves(None, 1), 1e4)
    peak, when = largest(trajectory, curves(trajectory, 1)[name])
    for over, verdict in ((-1.5e-6, True), (1e-6, False)):
        report = judge(trajectory, limited(1, wide | {name: peak / (1 + over)}))
        assert report.certified is verdict
        assert report.peaks[name] == pytest.approx(1 + over, abs=1e-7)
    assert len(report.faults) == 1
    words = rf"({name.replace('_', ' ')} about [xyz]|{name.replace('_', ' ').removesuffix('s')} of .*)"
    if name.endswith("_norm"):
        words = f"the length of the {name.removesuffix('_norm').replace('_', ' ')}"
    assert re.match(f"{words} reaches ", report.faults[0])
    assert float(re.search(r"t = (\S+) s", report.faults[0])[1]) == pytest.approx(when, abs=0.1)


def test_a_bound_over_the_limit_is_no_breach_that_was_met():
    values, limit = np.zeros((3, 1, 1)), np.full(3, 2.0)
    torque = limits(craft(0, inertia=INERTIA, torque_limit=limit))[-1]
    quantity = Limited(torque, values, values[0], values[0], limit)
    minima = Minima(bound=np.array([-0.5, -0.5, 0.0]), seen=np.array([-0.25, 0.0, 0.2]), time=np.arange(3.0))
    assert list(faults([quantity], minima, 1e-6, np.zeros((1, 1)))) == [
        "torque about x reaches 2.5 N m, 1.25 of its limit, at t = 0 s",
        "torque about y is not proved to keep its limit: 1 of it was met at t = 1 s, the bound is 1.5",
    ]
    minima.seen[1] = 0.25
    assert "0.75 of it was met" in list(faults([quantity], minima, 1e-6, np.zeros((1, 1))))[1]


def test_a_joint_beyond_its_range_is_told_by_its_own_angle_and_the_end_that_counts():
    trajectory = manoeuvre(500, terminals=1, wiggle=0.5)
    time = np.linspace(0, trajectory.duration, 100_001)
    pitch = np.rad2deg(joints_of(trajectory, time)[0, :, 1])
    low, high, tube = pitch.min(), pitch.max(), jp.Robust(joint_error=np.deg2rad(0.5))
    for ends, word, robust, met, most in (
        ((low - 30, high - 0.15), "most", None, high, high - 0.15),
        ((low + 0.15, high + 50), "least", None, low, low + 0.15),
        ((low - 30, high + 0.35), "most", tube, high, high - 0.15),
        ((low - 0.5 + 1e-5, high + 50), "least", tube, low, low + 1e-5),
    ):
        joints = {"pitch_limit": None, "pitch_range": np.deg2rad(ends)}
        report = judge(trajectory, craft(1, joints=joints), robust=robust)
        (fault,) = report.faults
        told = re.fullmatch(
            rf"pitch of terminal-0 reaches (\S+) deg, of at {word} (\S+) deg, at t = (\S+) s", fault
        )
        assert told, fault
        reached, end, when = map(float, told.groups())
        apart = abs(met - most)
        assert (reached, end) == pytest.approx((met, most), abs=0.02 * apart)
        assert reached != end
        assert when == pytest.approx(time[np.argmin(np.abs(pitch - met))], abs=0.05)


def test_an_angle_that_is_not_proved_is_told_with_the_bound():
    ranged = craft(1, joints={"pitch_limit": None, "pitch_range": np.deg2rad([-10.0, 80.0])})
    (pitch,) = (one for one in limits(ranged) if one.quantity.name == "pitch")
    values = np.deg2rad([[[-44.0]]])
    quantity = Limited(pitch, values, values[0], values[0], np.deg2rad([45.0]))
    minima = Minima(bound=np.array([-1 / 45]), seen=np.array([1 / 45]), time=np.zeros(1))
    (fault,) = faults([quantity], minima, 1e-9, np.zeros((1, 1)))
    assert fault == (
        "pitch of terminal-0 is not proved to stay in its range: -9 deg was met at t = 0 s, of at least "
        "-10 deg, and the bound is -11 deg"
    )


def test_faults_of_wheels_are_sentences_with_few_digits():
    shares = np.array([0.28629641, 3.4567e-7, -0.1, -0.1, -0.1, -0.1])
    for allocation, subject in (("pseudo_inverse", "w1"), ("minimax", "the array across w1 and w2")):
        array = tuple(
            jp.Wheel(name=f"w{k}", axis=axis, torque=0.5, momentum=8.0)
            for k, axis in enumerate([*np.eye(3), np.full(3, 3**-0.5)], 1)
        )
        momenta = limits(replace(craft(0, inertia=INERTIA), wheels=array, allocation=allocation))[-1]
        count = len(momenta.bound)
        values = np.zeros((count, 1, 1))
        quantity = Limited(momenta, values, values[0], values[0], np.full(count, 8.0))
        minima = Minima(bound=-shares[:count], seen=-shares[:count], time=np.arange(float(count)))
        reached = f"wheel momentum of {subject} reaches 10.2904 N m s, 1.286 of its limit, at t = 0 s"
        first, second = faults([quantity], minima, 1e-9, np.zeros((1, 1)))
        assert first == reached
        assert "1.000000346 of its limit" in second
