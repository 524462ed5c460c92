"""What the certificate refuses: anything that is not finite, jumps, wrong ends, and data of a wrong form."""

import re
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from manoeuvres import claimed
from numpy.polynomial import legendre
from scipy.spatial.transform import Rotation
from wheels import wheels

from jaxplan.certificate import EndState, certify
from jaxplan.model.devices import Drive, Instrument, Mount, Terminal
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.trajectory.curve import Trajectory

DURATION = 20.0
TURN = np.array([0.4, -0.2, 0.3])
CHANGE = np.array([0.3, -0.2])
# From 0 to 1 with rest at both ends, as a Legendre series; and its halves, on [-1, 0] and [0, 1].
SMOOTH = np.polynomial.Polynomial([1 / 2, 15 / 16, 0, -5 / 8, 0, 3 / 16])
LEFT, RIGHT = (
    legendre.poly2leg(SMOOTH(np.polynomial.Polynomial([centre, 0.5])).coef) for centre in (-0.5, 0.5)
)


def turn_in_two_pieces():
    """A turn about a fixed axis in one chart but two pieces, and the joints likewise."""
    both = np.stack([LEFT, RIGHT])
    breaks = np.array([0, DURATION / 2, DURATION])
    return Trajectory(
        breaks=breaks,
        chart_attitude=np.stack([np.eye(3)] * 2),
        chart_start=np.zeros(2),
        chart_rate=np.stack([TURN / DURATION] * 2),
        coefficients=both[..., None] * TURN,
        joint_breaks=breaks,
        joint_coefficients=both[..., None] * CHANGE,
        node_times=breaks,
        smoothness=2,
        method="by hand",
    )


SPACECRAFT = Spacecraft(
    terminals=(
        Terminal(name="t", mount=0.5, yaw_limit=1.0, pitch_limit=0.5, rate_limit=0.1, acceleration_limit=0.1),
    ),
    instruments=(Instrument(name="i", boresight=np.array([0.0, 0.0, 1.0])),),
    rate_limit=0.1,
    acceleration_limit=0.1,
    jerk_limit=0.1,
    inertia=np.diag([100.0, 80.0, 90.0]),
    torque_limit=10.0,
    wheel_momentum_limit=10.0,
)
LOOSE = replace(SPACECRAFT, jerk_limit=None)
ODD = Terminal(  # the same, with all that may be given by itself
    name="t",
    mounting=Mount(yaw_axis=np.array([0.0, 0.0, 1.0]), boresight=np.array([0.6, 0.8, 0.0])),
    yaw_range=np.array([-0.2, 7.0]),
    pitch_range=np.array([-0.4, 0.3]),
    yaw_rate_limit=0.1,
    pitch_rate_limit=0.11,
    yaw_acceleration_limit=0.1,
    pitch_acceleration_limit=0.11,
)
DRIVES = tuple(
    Drive(
        name=name,
        axis=np.array([0.0, 0.0, 1.0]),
        boresight=np.array(boresight),
        range=np.array([-0.4, 0.5]),
        rate_limit=0.1,
        acceleration_limit=0.1,
    )
    for name, boresight in (("t", [1.0, 0.0, 0.0]), ("i", [0.0, -0.28, 0.96]))
)
WHEELS = wheels(np.array([[1, 0, 0], [0, 0.6, 0.8], [0, -0.6, 0.8], [0.6, 0.8, 0]]), 90.0, 99.0, 1.0)
SPACECRAFTS = {
    "an angle about z": SPACECRAFT,
    "axes and ranges": replace(SPACECRAFT, terminals=(ODD,)),
    "drives": replace(SPACECRAFT, terminals=(), drives=DRIVES, instruments=()),
    "wheels": replace(SPACECRAFT, wheels=WHEELS),
    "stages": replace(
        SPACECRAFT, terminals=(replace(ODD, yaw_inertia=np.eye(3), pitch_inertia=np.array([2.0, 3, 4])),)
    ),
}
ZONES = (
    KeepOut(name="out", direction=np.array([0.0, 0.0, -1.0]), half_angle=0.5),
    KeepIn(name="in", direction=np.array([0.0, 0.0, 1.0]), half_angle=1.0, devices=("i",), any_of="g"),
    KeepIn(name="or", direction=np.array([1.0, 0.0, 0.0]), half_angle=0.5, devices=("i",), any_of="g"),
)
CONES = tabulate(ZONES[:1], ZONES[1:], SPACECRAFT)


def rotation(vector):
    return Rotation.from_rotvec(vector).as_matrix()


def judge(trajectory=None, spacecraft=SPACECRAFT, cones=CONES, **changes):
    ends = {
        "start": EndState(attitude=np.eye(3), joints=np.zeros(2)),
        "goal": EndState(attitude=rotation(TURN), joints=CHANGE),
    }
    names = [z.name for z in ZONES]
    trajectory = turn_in_two_pieces() if trajectory is None else trajectory
    return certify(claimed(trajectory, spacecraft, cones, zone_names=names, **(ends | changes)))


def refused(report, *words):
    """Whether a report refuses with one fault that has the words in it."""
    assert not report.certified
    assert len(report.faults) == 1, report.faults
    return all(word in report.faults[0] for word in words)


def with_entry(array, index, value):
    changed = np.array(array, dtype=np.float64)
    changed[index] = value
    return changed


def test_a_turn_about_one_axis_is_certified_with_its_exact_peaks():
    report = judge()
    assert report.faults == ()
    assert report.certified
    rate, joint_rate = (15 / 16 * np.abs(x) / (DURATION / 2) for x in (TURN, CHANGE))
    steepest = 15 / 4 * np.sqrt(1 / 3) * 2 / 3 / (DURATION / 2) ** 2  # of SMOOTH, at x = 1 / sqrt(3)
    assert report.peaks == pytest.approx(
        {
            "angular_velocity": rate.max() / 0.1,
            "angular_acceleration": steepest * 0.4 / 0.1,
            "joint_rates": joint_rate.max() / 0.1,
            "joint_accelerations": steepest * 0.3 / 0.1,
            "yaw": 0.3 / 1.0,
            "pitch": 0.2 / 0.5,
            "torque": report.peaks["torque"],
            "wheel_momentum": rate[0] * 100 / 10,
            "jerk": 15 / 2 * 0.4 / (DURATION / 2) ** 3 / 0.1,
        },
        abs=1e-6,
    )
    assert list(report.peaks)[:3] == ["angular_velocity", "angular_acceleration", "joint_rates"]
    assert max(report.jumps.values()) < 1e-15


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_refused_wherever_it_stands(value):
    trajectory = turn_in_two_pieces()
    names = [f.name for f in fields(trajectory) if f.name not in ("smoothness", "method")]
    for name in names:
        array = getattr(trajectory, name)
        for index in np.ndindex(array.shape):
            report = judge(replace(trajectory, **{name: with_entry(array, index, value)}))
            assert refused(report, f"trajectory.{name} is not finite"), (name, index)
    for f in (one for one in fields(CONES) if not one.metadata.get("static")):
        array = np.asarray(getattr(CONES, f.name))
        for index in np.ndindex(array.shape):
            report = judge(cones=replace(CONES, **{f.name: with_entry(array, index, value)}))
            assert not report.certified, (f.name, index)
            assert report.faults[0] == f"cones.{f.name} is not finite"
    state = {
        "attitude": np.eye(3),
        "joints": np.zeros(2),
        "angular_velocity": np.zeros(3),
        "joint_rates": np.zeros(2),
    }
    for name, array in state.items():
        for index in np.ndindex(array.shape):
            for end in ("start", "goal"):
                wrong = EndState(**(state | {name: with_entry(array, index, value)}))
                assert not judge(**{end: wrong}).certified, (end, name, index)


def broken(part, value):
    """A dataclass with one of its numbers changed at a time, those of its parts too, and which it was."""
    for own in fields(part):
        whole = getattr(part, own.name)
        if isinstance(whole, str) or whole is None:
            continue
        if is_dataclass(whole):
            changed = list(broken(whole, value))
        elif isinstance(whole, tuple):
            changed = [
                ((*whole[:number], wrong, *whole[number + 1 :]), which)
                for number, one in enumerate(whole)
                for wrong, which in broken(one, value)
            ]
        else:
            changed = [(with_entry(whole, at, value)[()], at) for at in np.ndindex(np.shape(whole))]
        for wrong, which in changed:
            yield replace(part, **{own.name: wrong}), (own.name, which)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", SPACECRAFTS)
def test_a_spacecraft_with_a_number_that_is_not_finite_is_refused(name, value):
    assert judge(spacecraft=SPACECRAFTS[name]).certified
    count = 0
    for wrong, which in broken(SPACECRAFTS[name], value):
        assert not judge(spacecraft=wrong).certified, which
        count += 1
    assert count > 20


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"mounting": Mount(yaw_axis=np.array([0, 0, 1.0]), boresight=np.array([0.6, 0, 0.8]))},
            "right angles",
        ),
        (
            {"mounting": Mount(yaw_axis=np.array([0, 0, 2.0]), boresight=np.array([1.0, 0, 0]))},
            "right angles",
        ),
        ({"mounting": None}, "the mount of t is not finite"),
        ({"yaw_range": np.array([0.5, -0.5])}, "the range of t yaw is [0.5, -0.5]"),
        ({"pitch_range": np.array([0.1, 0.1])}, "the range of t pitch is [0.1, 0.1]"),
        ({"yaw_rate_limit": 0.0}, "rate limit of t yaw"),
        ({"pitch_acceleration_limit": -1.0}, "acceleration limit of t pitch"),
    ],
)
def test_a_terminal_that_no_device_can_be_is_refused(changes, words):
    wrong = replace(SPACECRAFT, terminals=(replace(ODD, **changes),))
    assert any(words in fault for fault in judge(spacecraft=wrong).faults), judge(spacecraft=wrong).faults


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"boresight": np.array([0.0, 0.0, 1.0])}, "the boresight of t lies along its axis"),
        ({"boresight": np.array([0.0, 0.0, -1.0])}, "the boresight of t lies along its axis"),
        ({"axis": np.array([0.0, 0.5, 0.5])}, "axis or boresight of t is no unit vector"),
        ({"range": np.array([0.3, -0.3])}, "the range of t angle is [0.3, -0.3]"),
        ({"rate_limit": -0.1}, "rate limit of t angle"),
    ],
)
def test_a_drive_that_no_device_can_be_is_refused(changes, words):
    drives = (replace(DRIVES[0], **changes), DRIVES[1])
    wrong = replace(SPACECRAFTS["drives"], drives=drives)
    assert any(words in fault for fault in judge(spacecraft=wrong).faults), judge(spacecraft=wrong).faults


def test_ends_must_be_met_to_1e_minus_8():
    step = 2e-8
    state = EndState(
        attitude=rotation(TURN), joints=CHANGE, angular_velocity=np.zeros(3), joint_rates=np.zeros(2)
    )
    assert judge(goal=state).certified
    assert refused(
        judge(goal=replace(state, attitude=rotation(TURN) @ rotation([step, 0, 0]))),
        "the goal is missed by 2e-08 rad",
    )
    assert judge(goal=replace(state, attitude=rotation(TURN) @ rotation([step / 4, 0, 0]))).certified
    for key, words in (
        ("joints", "joints"),
        ("angular_velocity", "angular velocity"),
        ("joint_rates", "joint rates"),
    ):
        value = getattr(state, key)
        for index in range(len(value)):
            assert refused(
                judge(goal=replace(state, **{key: with_entry(value, index, value[index] + step)})), words
            )
            assert judge(
                goal=replace(state, **{key: with_entry(value, index, value[index] - step / 4)})
            ).certified
    start = EndState(attitude=rotation([0, step, 0]), joints=np.zeros(2))
    assert refused(judge(start=start), "the start is missed by 2e-08 rad in attitude")
    opposite = judge(goal=replace(state, attitude=rotation(TURN) @ np.diag([1.0, -1, -1])))
    assert refused(opposite, "3.14 rad")


def test_motion_at_the_ends_is_refused_unless_it_is_wanted():
    steady = np.stack([legendre.poly2leg([c, 0.25]) for c in (0.25, 0.75)])[..., None]
    trajectory = turn_in_two_pieces()
    moving = replace(trajectory, coefficients=steady * TURN, joint_coefficients=steady * CHANGE)
    missed = "the {} is missed by {} rad/s in {}"
    assert judge(moving).faults == tuple(
        missed.format(end, *what)
        for end in ("start", "goal")
        for what in ((0.02, "angular velocity"), (0.015, "joint rates"))
    )
    rates = {"angular_velocity": TURN / DURATION, "joint_rates": CHANGE / DURATION}
    start = EndState(attitude=np.eye(3), joints=np.zeros(2), **rates)
    goal = EndState(attitude=rotation(TURN), joints=CHANGE, **rates)
    assert judge(moving, start=start, goal=goal).certified
    for key, rate in rates.items():
        assert refused(judge(moving, start=start, goal=replace(goal, **{key: -rate})), "the goal is missed")


def bumped(trajectory, field, order, size):
    """The trajectory with a jump of a derivative at its break, and of some higher ones, but the same ends."""
    half = DURATION / 4  # of a piece
    start = np.polynomial.Polynomial([1, 1]) ** order * half**order / (1, 1, 2, 6)[order]
    series = legendre.poly2leg((start * np.polynomial.Polynomial([1, -1]) ** 3 / 8).coef)
    array = getattr(trajectory, field)
    wide = np.concatenate([array, np.zeros((2, 7 - array.shape[1], array.shape[2]))], axis=1)
    wide[1, : len(series), 1] += size * series
    return replace(trajectory, **{field: wide})


@pytest.mark.parametrize(
    ("field", "order", "words"),
    [
        ("coefficients", 0, "rad in attitude of the platform"),
        ("coefficients", 1, "rad/s in angular velocity of the platform"),
        ("coefficients", 2, "rad/s^2 in angular acceleration of the platform"),
        ("coefficients", 3, "rad/s^3 in angular jerk of the platform"),
        ("joint_coefficients", 0, "rad in t pitch"),
        ("joint_coefficients", 1, "rad/s in the rate of t pitch"),
        ("joint_coefficients", 2, "rad/s^2 in the acceleration of t pitch"),
        ("joint_coefficients", 3, "rad/s^3 in the jerk of t pitch"),
    ],
)
def test_a_jump_of_a_derivative_that_ought_to_be_continuous_is_refused(field, order, words):
    smooth = replace(turn_in_two_pieces(), smoothness=max(order, 1))
    report = judge(bumped(smooth, field, order, 3e-8))
    assert not report.certified
    assert re.match(rf"there is a jump of (2.9|3)\d*e-08 {re.escape(words)} at t = 10 s", report.faults[0])
    assert judge(bumped(smooth, field, order, 1e-9)).certified
    if order > 1:
        report = judge(bumped(replace(smooth, smoothness=order - 1), field, order, 3e-8), LOOSE)
        assert report.certified
        assert max(report.jumps.values()) > 2.9e-8


def test_a_limited_jerk_forbids_jumps_of_the_angular_acceleration():
    jumping = bumped(replace(turn_in_two_pieces(), smoothness=1), "coefficients", 2, 1e-6)
    assert judge(jumping, LOOSE).certified
    assert refused(judge(jumping), "rad/s^2 in angular acceleration")
    assert judge(bumped(replace(turn_in_two_pieces(), smoothness=1), "joint_coefficients", 2, 1e-6)).certified


def static_trajectory():
    return Trajectory(
        breaks=np.zeros(2),
        chart_attitude=rotation(TURN)[None],
        chart_start=np.zeros(1),
        chart_rate=np.zeros((1, 3)),
        coefficients=np.zeros((1, 1, 3)),
        joint_breaks=np.zeros(2),
        joint_coefficients=CHANGE[None, None],
        node_times=np.zeros(1),
        smoothness=2,
        method="none",
    )


def test_a_state_without_duration_is_checked_like_any_other():
    still, end = static_trajectory(), EndState(attitude=rotation(TURN), joints=CHANGE)
    report = judge(still, start=end, goal=end)
    assert report.certified
    assert report.worst_time == 0
    assert set(report.peak_times.values()) == {0}
    assert report.peaks["yaw"] == pytest.approx(0.3)
    assert report.peaks["angular_velocity"] < 1e-12
    axis = rotation(TURN) @ [0, 0, 1]
    assert report.min_margin == pytest.approx(1 - np.arccos(axis[2]), abs=1e-9)
    elsewhere = EndState(attitude=np.eye(3), joints=CHANGE)
    assert refused(judge(still, start=end, goal=elsewhere), "the goal is missed by 0.539 rad in attitude")
    touching = replace(CONES, half_angle=with_entry(CONES.half_angle, 1, np.arccos(axis[2])))
    assert judge(still, cones=touching, start=end, goal=end).min_margin == pytest.approx(0, abs=1e-12)
    inside = replace(CONES, half_angle=with_entry(CONES.half_angle, 1, np.arccos(axis[2]) - 1e-8))
    assert refused(judge(still, cones=inside, start=end, goal=end), "keep-in zone in", "t = 0 s")
    narrow = replace(SPACECRAFT.terminals[0], yaw_limit=0.2999)
    tight = judge(still, replace(SPACECRAFT, terminals=(narrow,)), start=end, goal=end)
    assert refused(tight, "yaw of t reaches 17.18873 deg, of at most 17.183 deg", "t = 0 s")
    for name, value in (("chart_rate", np.full((1, 3), 0.1)), ("coefficients", np.full((1, 2, 3), 0.1))):
        assert refused(judge(replace(still, **{name: value}), start=end, goal=end), "no duration")


@pytest.mark.parametrize(("overrun", "certified"), [(0.0, True), (5e-10, True), (2e-9, False), (1e-3, False)])
def test_allowances_are_a_billionth_and_no_more(overrun, certified):
    still, end = static_trajectory(), EndState(attitude=rotation(TURN), joints=CHANGE)
    terminal = replace(SPACECRAFT.terminals[0], yaw_limit=0.3 / (1 + overrun))
    report = judge(still, replace(SPACECRAFT, terminals=(terminal,)), start=end, goal=end)
    assert report.certified is certified
    assert report.peaks["yaw"] == pytest.approx(1 + overrun, abs=3e-12)
    yaw, places = np.rad2deg(0.3), {2e-9: 10, 1e-3: 4}.get(overrun, 0)  # so that both angles differ
    reached = (
        f"yaw of t reaches {yaw:.{places}f} deg, of at most {yaw / (1 + overrun):.{places}f} deg, at t = 0 s"
    )
    assert certified or report.faults == (reached,)
    angle = np.arccos((rotation(TURN) @ [0, 0, 1])[2])
    cones = replace(CONES, half_angle=with_entry(CONES.half_angle, 1, angle - overrun))
    report = judge(still, cones=cones, start=end, goal=end)
    assert report.certified is certified
    assert report.min_margin == pytest.approx(-overrun, abs=1e-12)
    assert certified or report.faults[0].startswith(
        f"i is {np.rad2deg(overrun):.3g} deg outside the keep-in zone in"
    )


def test_lengths_of_directions_within_their_tolerance_do_not_matter():
    still, end = static_trajectory(), EndState(attitude=rotation(TURN), joints=CHANGE)
    exact = judge(still, start=end, goal=end).min_margin
    longer = Instrument(name="i", boresight=np.array([0.0, 0.0, 1 + 8e-7]))
    for trajectory, spacecraft, cones in (
        (replace(still, chart_attitude=still.chart_attitude * (1 + 4e-10)), SPACECRAFT, CONES),
        (still, replace(SPACECRAFT, instruments=(longer,)), CONES),
        (still, SPACECRAFT, replace(CONES, axis=CONES.axis * (1 - 8e-7))),
    ):
        report = judge(trajectory, spacecraft, cones, start=end, goal=end)
        assert report.certified
        assert report.min_margin == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"breaks": np.array([0.0, 10, 10])}, "breaks do not rise"),
        ({"breaks": np.array([0.0, 20, 10])}, "joint_breaks do not start and end with"),
        ({"joint_breaks": np.array([0.0, 10, 20.001])}, "joint_breaks do not start and end with"),
        ({"breaks": np.array([1.0, 10, 20])}, "start at 1 s"),
        ({"breaks": np.array([0.0, 20])}, "chart_attitude has the shape"),
        ({"breaks": np.zeros((3, 1))}, "breaks has the shape (3, 1)"),
        ({"joint_breaks": np.array([20.0])}, "joint_breaks has the shape (1,)"),
        ({"coefficients": np.zeros((2, 6, 2))}, "coefficients has the shape (2, 6, 2) and not (2, 6, 3)"),
        ({"coefficients": np.zeros((2, 0, 3))}, "coefficients has the shape"),
        ({"joint_coefficients": np.zeros((2, 6, 4))}, "joint_coefficients has the shape"),
        ({"chart_start": np.zeros(3)}, "chart_start has the shape"),
        ({"chart_attitude": np.stack([np.eye(3), np.diag([1.0, 1, -1])])}, "no rotation matrix"),
        ({"chart_attitude": np.stack([np.eye(3), np.diag([1.0, 1, 1 + 1e-8])])}, "no rotation matrix"),
    ],
)
def test_a_trajectory_of_a_wrong_form_is_refused(changes, words):
    report = judge(replace(turn_in_two_pieces(), **changes))
    assert not report.certified
    assert any(words in fault for fault in report.faults), report.faults


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"half_angle": np.zeros(8)}, "not between 0 and 180 deg"),
        ({"half_angle": np.full(8, np.pi)}, "not between 0 and 180 deg"),
        ({"side": np.zeros(8)}, "neither +1 nor -1"),
        ({"axis": np.ones((8, 3))}, "no unit vector"),
        ({"bound": np.ones((8, 2), dtype=bool)}, "beyond the 3 that have a name"),
        ({"bound": np.ones((8, 3), dtype=bool)}, "cones.bound has the shape (8, 3) and not (8, 2)"),
        ({"group": np.zeros(3)}, "cones.group has the shape"),
    ],
)
def test_cones_of_a_wrong_form_are_refused(changes, words):
    assert refused(judge(cones=replace(CONES, **changes)), words)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate_limit": 0.0}, "rate_limit = 0 is not positive"),
        ({"jerk_limit": -1.0}, "jerk_limit = -1 is not positive"),
        ({"rate_limit": np.array([1.0, 2.0])}, "rate_limit has the shape (2,) and not (3,)"),
        ({"rate_limit": np.array([1.0, np.nan, 2.0])}, "rate_limit = 1, nan, 2 is not positive"),
        ({"rate_norm_limit": np.ones(3)}, "rate_norm_limit has the shape (3,) and not ()"),
        ({"rate_norm_limit": np.inf}, "rate_norm_limit = inf is not positive"),
        ({"acceleration_norm_limit": 0.0}, "acceleration_norm_limit = 0 is not positive"),
        ({"inertia": np.eye(2)}, "inertia has the shape"),
        ({"wheels": WHEELS[:2]}, "axes of spacecraft.wheels do not span space"),
        ({"wheels": (*WHEELS, replace(WHEELS[0], axis=np.ones(3)))}, "axis of wheel-1 is no unit vector"),
        (
            {"wheels": (*WHEELS, replace(WHEELS[1], torque=0.0))},
            "torque or momentum of wheel-2 is not positive",
        ),
        ({"terminals": (replace(ODD, yaw_inertia=np.ones(4)),)}, "yaw_inertia of t is no inertia"),
        ({"terminals": (replace(ODD, pitch_inertia=-np.eye(3)),)}, "pitch_inertia of t is no inertia"),
        ({"terminals": (replace(ODD, pitch_inertia=np.array([1, 1, np.nan])),)}, "pitch_inertia of t is no"),
        ({"terminals": (replace(ODD, yaw_inertia=90 * np.eye(3)),)}, "inertia is not more than the inertias"),
        ({"wheels": WHEELS, "allocation": "best"}, "allocation = 'best' is not known"),
        ({"instruments": (Instrument(name="i", boresight=np.zeros(3)),)}, "boresight of i is no unit vector"),
    ],
)
def test_a_spacecraft_of_a_wrong_form_is_refused(changes, words):
    assert refused(judge(spacecraft=replace(SPACECRAFT, **changes)), words)


def test_a_torque_limit_without_inertia_is_refused():
    faults = judge(spacecraft=replace(SPACECRAFT, inertia=None)).faults
    assert [fault.split(" cannot")[0] for fault in faults] == [
        "spacecraft.torque_limit",
        "spacecraft.wheel_momentum_limit",
    ]


def test_end_states_of_a_wrong_form_are_refused():
    good = EndState(attitude=np.eye(3), joints=np.zeros(2))
    for changes, words in (
        ({"attitude": np.zeros((3, 4))}, "start.attitude has the shape"),
        ({"attitude": np.diag([1.0, 1, -1])}, "start.attitude is no rotation"),
        ({"joints": np.zeros(3)}, "start.joints has the shape"),
        ({"joint_rates": np.zeros(3)}, "start.joint_rates has the shape"),
        ({"angular_velocity": np.zeros(2)}, "start.angular_velocity has the shape"),
    ):
        assert refused(judge(start=replace(good, **changes)), words)


@pytest.mark.parametrize("size", [1e3, 1e8, 1e150, 1e300])
def test_absurd_coefficients_are_refused_without_a_warning(size):
    trajectory = turn_in_two_pieces()
    for name in ("coefficients", "joint_coefficients"):
        array = getattr(trajectory, name)
        assert not judge(replace(trajectory, **{name: with_entry(array, (1, 3, 1), size)})).certified
