"""The spline's durations, loads of the platform, rates at the ends, and whole plans."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import avoids, look, make_relay, make_spacecraft, sees
from dense import assert_kept, end_states, jumps, node_errors, shares
from manoeuvres import judge
from node_paths import NAMES, fit_global, fit_paper, load, wandering
from reference import assert_each
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.cases import SKY_KINDS, paper_case
from jaxplan.certificate import EndState
from jaxplan.model.duration_bound import duration_bound
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepOut
from jaxplan.planner.proving import prove

CRAFT = make_spacecraft()
numbers = pytest.mark.parametrize("number", [1, 2, 3, 4])
names = pytest.mark.parametrize("name", NAMES)


@cache
def planned(number, **settings):
    case = paper_case(number)
    goal = replace(case.goal, criterion="least_rotation")  # joints bind there
    return jp.plan(replace(case, goal=goal, trajectory=TrajectorySettings(**settings)))


def zones_of(scenario):
    return (*scenario.keep_out, *scenario.keep_in)


def bound_of(trajectory, craft, rates=None):
    ends = trajectory.sample(trajectory.duration * np.array([0.0, 1.0]))
    rates = np.zeros((2, 3 + ends.joints.shape[1])) if rates is None else rates
    return duration_bound(craft, ends.attitude, ends.joints, rates[:, :3], rates[:, 3:]).seconds


@numbers
@pytest.mark.parametrize(("ends", "above"), [("zero", 0.02), ("free", 0.005)])
def test_the_shortest_plans_of_the_paper_are_near_the_strict_bound(number, ends, above):
    plan = planned(number, duration="minimum", end_acceleration=ends)
    assert plan.status is Status.OK, plan.message
    assert plan.certificate.certified
    craft, trajectory = plan.scenario.spacecraft, plan.trajectory
    assert_kept(trajectory, craft, zones_of(plan.scenario))
    bound = bound_of(trajectory, craft)
    assert bound <= trajectory.duration <= (1 + above) * bound
    states = end_states(trajectory)
    assert_each(np.abs(states[0]), "<=", 1e-9)
    assert_each(jumps(trajectory, 3), "<=", 1e-9)
    if ends == "zero":
        assert_each(np.abs(states[1]), "<=", 1e-8)
    else:
        assert np.any(np.abs(states[1]) > 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ends", "limits_deg", "least"),
    [
        ("zero", (9.0, 9.0, 0.3), (32 * 5 / 0.3) ** (1 / 3)),  # the jerk at its limit, with three switches
        ("zero", (9.0, 9.0, 0.03), (32 * 5 / 0.03) ** (1 / 3)),
        ("free", (9.0, 9.0, 0.03), (12 * 5 / 0.03) ** (1 / 3)),  # with none
        ("free", (9.0, 0.5, None), 2 * (5 / 0.5) ** 0.5),
        ("free", (0.5, 0.5, None), 5 / 0.5 + 0.5 / 0.5),
    ],
)
def test_a_turn_about_a_body_axis_takes_at_most_as_long_as_by_switches_at_the_limits(ends, limits_deg, least):
    rate, acceleration, jerk = (None if limit is None else np.deg2rad(limit) for limit in limits_deg)
    craft = Spacecraft(
        terminals=(), instruments=(), rate_limit=rate, acceleration_limit=acceleration, jerk_limit=jerk
    )
    attitudes = Rotation.from_rotvec(np.deg2rad([[0, 0, 0], [0, 5, 0]])).as_matrix()
    path = Path(attitudes=attitudes, joints=np.zeros((2, 0)), edge_costs=np.ones(1))
    fit = fit_global(path, craft, TrajectorySettings(duration="minimum", end_acceleration=ends))
    assert fit.status is Status.OK, fit.message
    assert_kept(fit.trajectory, craft)
    assert fit.trajectory.duration <= 1.005 * least


@names
def test_stretched_lies_between_the_shortest_and_the_papers(name):
    path, durations = load(name), {}
    for duration in ("minimum", "stretched"):
        fit = fit_global(path, CRAFT, TrajectorySettings(duration=duration))
        assert fit.status is Status.OK
        durations[duration] = fit.trajectory.duration
        largest = {n: np.abs(s).max() for n, s in shares(fit.trajectory, CRAFT).items() if n != "range"}
        # The first limit is just met.
        assert max(largest.values()) == pytest.approx(1, abs=1e-4)
    paper = fit_paper(path, CRAFT, TrajectorySettings(method="paper", segments=3)).trajectory
    assert durations["minimum"] < durations["stretched"] < paper.duration


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rrt_c2", "astar_c1", "astar_c3", "rrt_c4"])
def test_a_duration_too_short_says_which_would_do(name):
    path, settings = load(name), TrajectorySettings(duration=15.0)
    fit = fit_global(path, CRAFT, settings)
    assert fit.status is Status.LIMITS_TOO_TIGHT
    assert fit.needed_duration > 15
    advised = float(re.search(r"duration_s to ([\d.]+)", fit.message).group(1))
    assert fit.needed_duration <= advised <= fit.needed_duration + 0.01
    longer = fit_global(path, CRAFT, replace(settings, duration=advised))
    assert longer.status is Status.OK, longer.message
    assert longer.trajectory.duration == advised
    assert_kept(longer.trajectory, CRAFT)
    shortest = fit_global(path, CRAFT, replace(settings, duration="minimum", node_tube=np.deg2rad(1.0)))
    assert fit.needed_duration <= 1.1 * shortest.trajectory.duration


FULL = np.array([[12.0, 1.2, -0.6], [1.2, 18.0, 1.8], [-0.6, 1.8, 24.0]])
SLEW = wandering(6, 1, seed=4, step=0.25)


@cache
def shortest_slew():
    """How long the slew takes, s, where no load limits it."""
    return fit_global(SLEW, make_spacecraft(1), TrajectorySettings(duration="minimum")).trajectory.duration


LOADED = [
    ("torque", {"torque_limit": 0.1}),
    ("torque", {"torque_limit": np.array([0.1, 0.15, 0.2])}),
    ("momentum", {"wheel_momentum_limit": 0.5}),
    ("momentum", {"wheel_momentum_limit": np.array([0.3, 0.4, 0.5]), "torque_limit": 1.0}),
    ("jerk", {"jerk_limit": np.deg2rad(0.5)}),
    ("jerk", {"jerk_limit": np.deg2rad([0.4, 0.5, 0.7])}),
    ("rate", {"rate_limit": np.deg2rad([2.4, 3.0, 1.8])}),
    ("rate length", {"rate_norm_limit": np.deg2rad(2.4)}),
    ("acceleration length", {"acceleration_norm_limit": np.deg2rad(0.15)}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("binding", "limits"), LOADED)
def test_torque_momentum_and_jerk_are_kept_and_bind(binding, limits):
    craft = replace(make_spacecraft(1), inertia=FULL, **limits)
    found = []
    for settings in (TrajectorySettings(duration="minimum"), TrajectorySettings(duration=90.0)):
        fit = fit_global(SLEW, craft, settings)
        assert fit.status is Status.OK, fit.message
        assert_kept(fit.trajectory, craft)
        assert certified(SLEW, fit.trajectory, craft)
        found.append(fit.trajectory)
    shortest, given = found
    assert given.duration == 90
    assert 1.05 * shortest_slew() < shortest.duration < 90
    assert np.abs(shares(shortest, craft)[binding]).max() == pytest.approx(1, abs=0.01)
    tighter = {name: 0.7 * limit for name, limit in limits.items()}
    slower = fit_global(SLEW, replace(craft, **tighter), TrajectorySettings(duration="minimum")).trajectory
    assert slower.duration > 1.02 * shortest.duration


def certified(path, trajectory, craft, keep_out=()):
    ends = trajectory.sample(trajectory.duration * np.array([0.0, 1.0]))
    np.testing.assert_allclose(ends.attitude, path.attitudes[[0, -1]], atol=1e-9)
    return judge(trajectory, craft, keep_out, **end_rates(trajectory)).certified


def end_rates(trajectory):
    ends = trajectory.sample(trajectory.duration * np.array([0.0, 1.0]))
    fields = ("attitude", "joints", "angular_velocity", "joint_rates")
    return {
        name: EndState(**{f: getattr(ends, f)[i] for f in fields}) for i, name in enumerate(("start", "goal"))
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "duration"),
    [(0, 60.0), (1, "minimum"), (2, "stretched")],
)
def test_rates_at_the_ends_are_met_among_zones(seed, duration):
    rng = np.random.default_rng(seed)
    craft, path = make_spacecraft(2, 1), wandering(6, 2, seed=seed, step=0.2)
    rates = np.deg2rad(rng.uniform(-0.8, 0.8, (2, 7)))
    # The middle node is inside; the ends are not.
    looks = path.attitudes @ craft.instruments[0].boresight
    across = np.cross(looks[0], looks[-1])
    axis = np.cos(0.1) * looks[3] + np.sin(0.1) * across / np.linalg.norm(across)
    zone = KeepOut(name="sun", direction=axis / np.linalg.norm(axis), half_angle=0.13, devices=("camera-1",))
    fit = fit_global(
        path,
        craft,
        TrajectorySettings(duration=duration),
        cones=tabulate((zone,), (), craft),
        start_angular_velocity=rates[0, :3],
        start_joint_rates=rates[0, 3:],
        end_angular_velocity=rates[1, :3],
        end_joint_rates=rates[1, 3:],
    )
    assert fit.status is Status.OK, fit.message
    np.testing.assert_allclose(end_states(fit.trajectory)[0], rates, atol=1e-9)
    assert_each(np.abs(end_states(fit.trajectory)[1]), "<=", 1e-8)
    ends = fit.trajectory.sample(fit.trajectory.duration * np.array([0.0, 1.0]))
    np.testing.assert_allclose(ends.angular_velocity, rates[:, :3], atol=1e-9)
    np.testing.assert_allclose(ends.joint_rates, rates[:, 3:], atol=1e-9)
    assert_each(node_errors(fit.trajectory, path)[[0, -1]], "<=", 1e-9)
    assert_kept(fit.trajectory, craft, (zone,))
    assert certified(path, fit.trajectory, craft, (zone,))
    assert fit.trajectory.duration >= bound_of(fit.trajectory, craft, rates)


@pytest.mark.parametrize("duration", [80.0, "minimum", "stretched"])
def test_a_goal_within_a_zone_is_no_success_and_names_the_device(duration):
    craft, path = make_spacecraft(0, 2), wandering(6, 0, seed=0, step=0.2)
    axis = path.attitudes[-1] @ craft.instruments[1].boresight
    zone = KeepOut(name="sun", direction=axis, half_angle=np.deg2rad(5.0), devices=("camera-2",))
    cones = tabulate((zone,), (), craft)
    fit = fit_global(path, craft, TrajectorySettings(duration=duration), cones=cones)
    assert fit.status is Status.UNCERTIFIED
    assert 4.9 <= float(re.search(r"camera-2 breaks a zone by ([\d.]+) deg", fit.message).group(1)) <= 5
    assert_kept(fit.trajectory, craft)


@pytest.mark.parametrize("duration", [120.0, "stretched", "minimum"])
def test_of_a_group_of_keep_in_zones_one_holds_at_every_time(duration):
    # Each camera holds for a part of the straight motion, which leads camera-1 through the Sun.
    cameras = {"camera-1": look(0), "camera-2": look(-120), "camera-3": look(0, 90)}
    zones = sees("camera-1", 30, 0, 60), sees("camera-2", 10, 0, 60), avoids("Sun", 60, 5, 20)
    scenario = make_relay(160, cameras, *zones)
    plan = jp.plan(replace(scenario, trajectory=TrajectorySettings(duration=duration)))
    assert plan.status is Status.OK, plan.message
    assert plan.certificate.certified
    assert_kept(plan.trajectory, scenario.spacecraft, zones_of(scenario))


@pytest.mark.slow
@pytest.mark.parametrize("kind", SKY_KINDS)
def test_random_scenes_are_certified_at_any_duration(kind):
    above = []
    for seed in range(4):
        scenario = jp.random_scenario(seed, kind)
        craft, zones = scenario.spacecraft, zones_of(scenario)
        plan = jp.plan(replace(scenario, trajectory=TrajectorySettings(duration="minimum")))
        assert plan.status is Status.OK, (seed, plan.message)
        assert plan.certificate.certified
        assert_kept(plan.trajectory, craft, zones, count=501)
        above.append(plan.trajectory.duration / bound_of(plan.trajectory, craft) - 1)
        cones = tabulate(scenario.keep_out, scenario.keep_in, craft)
        slow = fit_global(plan.path, craft, TrajectorySettings(duration=80.0), cones=cones)
        assert slow.status is Status.OK, (seed, slow.message)
        assert prove(scenario, plan.goal, slow.trajectory).certified, seed
        assert_kept(slow.trajectory, craft, zones, count=501)
    assert min(above) >= 0
    assert np.median(above) <= (0.05 if kind in ("keep_out", "keep_in") else 0.1)  # the rest are detours


@pytest.mark.parametrize("jerk_limit_deg", [0.3, 0.03])
def test_the_shortest_motion_is_never_longer_than_a_stretched_one_nor_is_a_longer_one_refused(jerk_limit_deg):
    craft = replace(make_spacecraft(1), jerk_limit=np.deg2rad(jerk_limit_deg))
    stretched = fit_global(SLEW, craft, TrajectorySettings()).trajectory
    shortest = fit_global(SLEW, craft, TrajectorySettings(duration="minimum")).trajectory
    assert shortest.duration <= stretched.duration
    longer = fit_global(SLEW, craft, TrajectorySettings(duration=1.05 * stretched.duration))
    assert longer.status is Status.OK, longer.message
    assert longer.trajectory.duration == 1.05 * stretched.duration
    assert_kept(longer.trajectory, craft)


@pytest.mark.parametrize("duration", [80.0, "minimum", "stretched"])
def test_a_joint_beyond_its_range_is_no_success(duration):
    path = wandering(4, 1, seed=2)
    joints = path.joints.copy()
    joints[-1, 1] = 1.2 * CRAFT.terminals[0].pitch_limit
    fit = fit_global(replace(path, joints=joints), make_spacecraft(1), TrajectorySettings(duration=duration))
    assert fit.status is Status.UNCERTIFIED
    assert "a joint leaves its range" in fit.message


def test_a_motion_that_ends_where_it_starts_takes_a_positive_time_and_keeps_its_rates():
    path, craft = wandering(1, 1, seed=0), make_spacecraft(1)
    still = replace(path, attitudes=path.attitudes[[0, 0]], joints=path.joints[[0, 0]])
    rate = np.deg2rad([1.0, 0, 0])
    fit = fit_global(still, craft, TrajectorySettings(duration="minimum"), start_angular_velocity=rate)
    assert fit.status is Status.OK
    assert fit.trajectory.duration > 0
    np.testing.assert_allclose(fit.trajectory.sample(np.zeros(1)).angular_velocity[0], rate, atol=1e-9)
    assert_kept(fit.trajectory, craft)


def test_what_makes_no_sense_is_refused_by_name():
    path, craft = wandering(2, 1, seed=0), make_spacecraft(1)
    with pytest.raises(ValueError, match=r"rate at the start is 1 rad/s: must be at most 0\.0523"):
        fit_global(path, craft, TrajectorySettings(), start_angular_velocity=np.array([1.0, 0, 0]))
    for key, value in (("end_acceleration", "no"), ("duration", True), ("duration", None)):
        with pytest.raises(ValueError, match=f"trajectory.{key}"):
            fit_global(path, craft, replace(TrajectorySettings(), **{key: value}))


@pytest.mark.parametrize("fit", [fit_global, fit_paper])
def test_a_path_that_is_not_of_this_spacecraft_is_refused_by_name(fit):
    path, craft = wandering(3, 1, seed=0), make_spacecraft(1)
    settings = TrajectorySettings(method="paper" if fit is fit_paper else "global", duration=60.0)
    for wrong, said in (
        ({"joints": path.joints[:, :1]}, r"path.joints is of shape \(4, 1\): must be \(4, 2\)"),
        ({"joints": path.joints[:3]}, r"path.joints is of shape \(3, 2\)"),
        ({"edge_costs": path.edge_costs[:2]}, r"path.edge_costs is of shape \(2,\): must be \(3,\)"),
        ({"attitudes": np.tile(np.eye(4), (4, 1, 1))}, r"path.attitudes is of shape \(4, 4, 4\)"),
        ({"attitudes": -path.attitudes}, r"path.attitudes\[0\] is no rotation matrix"),
        ({"attitudes": path.attitudes * np.array([1, 1, 1.01, 1])[:, None, None]}, r"path.attitudes\[2\]"),
        ({"attitudes": path.attitudes[:0]}, "the path has no nodes"),
    ):
        with pytest.raises(ValueError, match=said):
            fit(replace(path, **wrong), craft, settings)
    lists = {name: getattr(path, name).tolist() for name in ("attitudes", "joints", "edge_costs")}
    same = [fit(one, craft, settings).trajectory.coefficients for one in (path, replace(path, **lists))]
    np.testing.assert_array_equal(*same)
