"""The paper's fit: published behaviour, limits at every instant, awkward paths, and its statuses."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_spacecraft
from node_paths import NAMES, ZIG_ZAG, fit_paper, fit_stored, load, wandering
from reference import assert_each
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.paper import qp
from jaxplan.trajectory import Samples, Trajectory

INERTIA = np.array([[120.0, 5.0, -3.0], [5.0, 90.0, 2.0], [-3.0, 2.0, 60.0]])

# Peaks that an independent program measured on these nodes at 80 s (rates and accelerations over their
# limits of 3 deg/s and 2 deg/s^2, jerk in deg/s^3), with one segment an interval and with three. Its jerks
# are differences of the acceleration over 0.022 s, which miss what lies within a step of a join.
PEAKS = {
    "astar_c1": {None: (0.40, 0.63, 11.1), 3: (0.41, 0.48, 2.05)},
    "astar_c2": {None: (0.55, 0.58, 10.5), 3: (0.58, 0.43, 2.07)},
    "astar_c3": {None: (0.66, 1.05, 22.9), 3: (0.57, 0.71, 4.45)},
    "astar_c4": {None: (0.53, 0.80, 12.5), 3: (0.54, 0.53, 2.41)},
}
# Of the smooth nodes, the smallest and the largest of the four cases.
SMOOTH_PEAKS = {
    None: ((0.21, 0.32), (0.22, 0.33), (3.8, 5.6)),
    3: ((0.22, 0.32), (0.16, 0.25), (0.85, 1.28)),
}
# The same program's durations at which the fit just keeps all limits, s.
SHORTEST = {
    "rrt_c1": {None: 40.3, 3: 35.4},
    "rrt_c2": {None: 42.8, 3: 38.2},
    "rrt_c3": {None: 42.7, 3: 37.5},
    "rrt_c4": {None: 42.2, 3: 37.7},
    "astar_c1": {None: 60.4, 3: 54.8},
    "astar_c2": {None: 57.6, 3: 51.2},
    "astar_c3": {None: 82.4, 3: 67.1},
    "astar_c4": {None: 69.7, 3: 56.7},
}


def fine_times(trajectory: Trajectory, count: int = 16_000) -> np.ndarray:
    """Times that the fit never looked at, with both sides of every break."""
    breaks = np.concatenate([trajectory.breaks, trajectory.joint_breaks])
    even = np.linspace(0, trajectory.duration, count)
    return np.unique(np.concatenate([even, breaks, np.nextafter(breaks[breaks > 0], 0)]))


def at(trajectory: Trajectory, t: np.ndarray) -> Samples:
    """Samples at some times, in one size of arrays, so that only one is compiled."""
    samples = trajectory.sample(np.resize(t, 16_384))
    return Samples(**{name: value[: len(t)] for name, value in vars(samples).items()})


def loads(trajectory: Trajectory, craft: Spacecraft, t: np.ndarray) -> dict[str, float]:
    """Largest share of each limit on a grid of times, in plain numpy."""
    s = at(trajectory, t)
    given = {
        "rate": (s.angular_velocity, craft.rate_limit),
        "acceleration": (s.angular_acceleration, craft.acceleration_limit),
        "joint rate": (s.joint_rates, craft.joint_rate_limits),
        "joint acceleration": (s.joint_accelerations, craft.joint_acceleration_limits),
    }
    if craft.jerk_limit is not None:
        given["jerk"] = (s.angular_jerk, craft.jerk_limit)
    if craft.inertia is not None:
        momentum = s.angular_velocity @ craft.inertia
        torque = s.angular_acceleration @ craft.inertia + np.cross(s.angular_velocity, momentum)
        given["momentum"] = (momentum, craft.wheel_momentum_limit)
        given["torque"] = (torque, craft.torque_limit)
    return {
        name: float(np.max(np.abs(values) / limit, initial=0.0)) for name, (values, limit) in given.items()
    }


def passes(trajectory: Trajectory, path: Path) -> bool:
    samples = at(trajectory, trajectory.node_times)
    attitudes = np.all(np.abs(samples.attitude - path.attitudes) <= 1e-9)
    return bool(attitudes and np.all(np.abs(samples.joints - path.joints) <= 1e-9))


def rests(trajectory: Trajectory) -> bool:
    ends = at(trajectory, trajectory.breaks[[0, -1]])
    fields = (ends.angular_velocity, ends.angular_acceleration, ends.joint_rates, ends.joint_accelerations)
    return all(np.all(np.abs(field) <= 1e-9) for field in fields)


def measured_peaks(name: str, segments: int | None) -> tuple[float, float, float]:
    trajectory, craft = fit_stored(name, segments).trajectory, make_spacecraft()
    found = loads(trajectory, craft, np.linspace(0, 80, 16_000))
    steps = 0.022 * np.arange(16)  # the jerk is largest beside a join
    times = np.concatenate([[b + steps, b - steps] for b in trajectory.node_times[1:-1]])
    times = np.clip(np.concatenate([times, [steps, 80 - steps]]), 0, 80)
    accelerations = at(trajectory, times.ravel()).angular_acceleration.reshape(*times.shape, 3)
    return (
        found["rate"],
        found["acceleration"],
        np.rad2deg(np.abs(np.diff(accelerations, axis=1)).max() / 0.022),
    )


def agree(value: float, printed: float) -> bool:
    """To 1 % or half a printed digit, and as much again as rounding to a third digit first makes out."""
    digits = 2 if printed < 10 else 1
    return abs(value - printed) <= max(0.01 * printed, 0.55 * 10.0**-digits)


@pytest.mark.parametrize(("name", "segments"), [(name, s) for name in ZIG_ZAG for s in (None, 3)])
def test_peaks_on_zig_zag_nodes_are_those_measured_before(name, segments):
    for value, printed in zip(measured_peaks(name, segments), PEAKS[name][segments], strict=True):
        assert agree(value, printed), (value, printed)


@pytest.mark.parametrize("segments", [None, 3])
def test_peaks_on_smooth_nodes_are_those_measured_before(segments):
    measured = np.array([measured_peaks(name, segments) for name in NAMES if name.startswith("rrt")])
    for values, (least, most) in zip(measured.T, SMOOTH_PEAKS[segments], strict=True):
        assert agree(values.min(), least), (values, least)
        assert agree(values.max(), most), (values, most)


@pytest.mark.parametrize(("name", "segments"), [(name, s) for name in NAMES for s in (None, 3)])
def test_shortest_durations_are_those_measured_before(name, segments):
    path, printed = load(name), SHORTEST[name][segments]
    wanted = segments or path.edges
    outcomes = []
    for duration in (printed + 0.06, printed - 0.06):
        fit = fit_paper(path, make_spacecraft(), TrajectorySettings(duration=duration, segments=wanted))
        outcomes.append(fit.status is Status.OK and len(fit.trajectory.coefficients) == wanted)
    assert outcomes == [True, False]


@pytest.mark.parametrize("name", NAMES)
def test_stretched_meets_its_first_limit_and_no_more(name):
    craft = make_spacecraft()
    fit = fit_paper(load(name), craft, TrajectorySettings())
    assert fit.status is Status.OK
    assert len(fit.trajectory.coefficients) == 3
    worst = max(loads(fit.trajectory, craft, fine_times(fit.trajectory)).values())
    assert 1 - 1e-5 <= worst <= 1
    assert rests(fit.trajectory)
    assert passes(fit.trajectory, load(name))


@pytest.mark.parametrize(
    ("binding", "limits"),
    [
        ("jerk", {"jerk_limit": np.deg2rad(0.2)}),
        ("torque", {"torque_limit": 0.5}),
        ("torque", {"torque_limit": np.array([5.0, 0.4, 0.3])}),
        ("momentum", {"wheel_momentum_limit": 1.0}),
    ],
)
def test_stretched_meets_the_optional_limits(binding, limits):
    craft = replace(
        make_spacecraft(), **({"inertia": INERTIA, "torque_limit": 1e3, "wheel_momentum_limit": 1e3} | limits)
    )
    trajectory = fit_paper(load("astar_c1"), craft, TrajectorySettings()).trajectory
    found = loads(trajectory, craft, fine_times(trajectory))
    assert max(found, key=found.get) == binding
    assert 1 - 1e-5 <= found[binding] <= 1


@pytest.mark.parametrize("terminals", [0, 1, 2, 4, 12])
def test_any_number_of_terminals_is_planned(terminals):
    craft, path = make_spacecraft(terminals), wandering(12, terminals, seed=terminals)
    fit = fit_paper(path, craft, TrajectorySettings())
    assert fit.status is Status.OK
    assert passes(fit.trajectory, path)
    assert rests(fit.trajectory)
    assert 1 - 1e-5 <= max(loads(fit.trajectory, craft, fine_times(fit.trajectory)).values()) <= 1


@pytest.mark.parametrize("edges", [1, 2, 3, 26, 27, 48, 199])
def test_paths_of_any_length_are_planned(edges):
    craft, path = make_spacecraft(1), wandering(edges, 1, seed=edges)
    fit = fit_paper(path, craft, TrajectorySettings())
    assert fit.status is Status.OK
    assert passes(fit.trajectory, path)
    assert rests(fit.trajectory)


@pytest.mark.parametrize(
    ("edges", "asked", "given"),
    [
        (2, None, 2),
        (13, None, 3),
        (26, None, 3),
        (27, None, 4),
        (48, None, 6),
        (48, 2, 6),
        (13, 5, 5),
        (13, 40, 13),
    ],
)
def test_segments_are_as_few_as_the_nodes_allow_and_as_many_as_asked(edges, asked, given):
    settings = TrajectorySettings(duration=5000.0, segments=asked)  # long enough for any limit
    fit = fit_paper(wandering(edges, 1, seed=edges, step=0.03), make_spacecraft(1), settings)
    assert fit.status is Status.OK
    assert len(fit.trajectory.coefficients) == len(fit.trajectory.joint_coefficients) == given


def test_more_segments_are_tried_where_few_break_a_limit():
    path, craft = wandering(26, 1, seed=5), make_spacecraft(1)
    few = fit_paper(path, craft, TrajectorySettings(segments=3)).trajectory
    fit = fit_paper(path, craft, TrajectorySettings(duration=0.9 * few.duration, segments=3))
    assert fit.status is Status.OK
    assert len(fit.trajectory.coefficients) > 3
    assert max(loads(fit.trajectory, craft, fine_times(fit.trajectory)).values()) <= 1


def test_a_curve_that_swings_between_its_nodes_is_cut_into_more_segments():
    """Nine uneven intervals a segment leave no freedom: the polynomials would go around many times."""
    path, craft = wandering(26, 1, seed=5), make_spacecraft(1)
    costs = np.random.default_rng(0).uniform(size=26) ** 4
    for uneven in (path, replace(path, edge_costs=costs)):
        fit = fit_paper(uneven, craft, TrajectorySettings())
        assert fit.status is Status.OK
        assert len(fit.trajectory.coefficients) > 3
        middles = (fit.trajectory.node_times[1:] + fit.trajectory.node_times[:-1]) / 2
        between = at(fit.trajectory, middles).joints
        assert_each(between, "<", np.maximum(path.joints[1:], path.joints[:-1]) + 0.1)
        assert_each(between, ">", np.minimum(path.joints[1:], path.joints[:-1]) - 0.1)


def test_more_segments_are_tried_where_a_joint_leaves_its_range():
    """So slow that rates do not matter, and so uneven that three segments swing."""
    path, craft = wandering(26, 1, seed=5), make_spacecraft(1)
    path = replace(path, edge_costs=np.random.default_rng(0).uniform(size=26) ** 4)
    loose = replace(craft, terminals=(replace(craft.terminals[0], yaw_limit=1e6, pitch_limit=1e6),))
    reached = []
    for limits in (loose, craft):
        fit = fit_paper(path, limits, TrajectorySettings(duration=1e7, segments=3))
        assert fit.status is Status.OK
        reached.append(np.abs(at(fit.trajectory, fine_times(fit.trajectory)).joints).max(axis=0))
    assert np.any(reached[0] > craft.joint_ranges[:, 1])
    assert_each(reached[1], "<=", craft.joint_ranges[:, 1])


def test_a_duration_too_short_says_which_would_do():
    path, craft = load("astar_c3"), make_spacecraft()
    fit = fit_paper(path, craft, TrajectorySettings(duration=30.0, segments=3))
    assert fit.status is Status.LIMITS_TOO_TIGHT
    assert max(loads(fit.trajectory, craft, fine_times(fit.trajectory)).values()) > 1
    assert "trajectory.duration_s" in fit.message
    written = float(fit.message.split("trajectory.duration_s to ")[1].split()[0])
    assert fit.needed_duration <= written <= fit.needed_duration + 0.01
    for duration in (fit.needed_duration, written):
        again = fit_paper(path, craft, TrajectorySettings(duration=duration, segments=3))
        assert again.status is Status.OK
        assert max(loads(again.trajectory, craft, fine_times(again.trajectory)).values()) <= 1
    stretched = fit_paper(path, craft, TrajectorySettings(segments=3)).trajectory.duration
    assert 0.9 * stretched < fit.needed_duration < 1.1 * stretched


def test_limits_broken_between_joins_are_no_success():
    """At every join of this fit the limits hold; it exceeds the acceleration by 5 % between them."""
    fit, craft = fit_stored("astar_c3", None), make_spacecraft()
    joins = loads(fit.trajectory, craft, fit.trajectory.breaks)
    assert max(joins.values()) <= 1
    assert fit.status is Status.LIMITS_TOO_TIGHT
    assert "platform acceleration y would reach 1.04" in fit.message


def test_limits_hold_at_joins_where_they_bind():
    craft = make_spacecraft()
    fit = fit_paper(load("astar_c3"), craft, TrajectorySettings(duration=35.0, segments=17))
    loose = replace(craft, acceleration_limit=1e3)
    free = fit_paper(load("astar_c3"), loose, TrajectorySettings(duration=35.0, segments=17))
    assert loads(free.trajectory, craft, free.trajectory.breaks)["acceleration"] > 1.1
    assert 1 - 1e-5 <= loads(fit.trajectory, craft, fit.trajectory.breaks)["acceleration"] <= 1
    assert passes(fit.trajectory, load("astar_c3"))


def test_programs_without_solution_are_infeasible(monkeypatch):
    monkeypatch.setattr(qp, "solve_all", lambda programs: [None] * len(programs))
    for duration in (80.0, "stretched"):
        fit = fit_paper(load("rrt_c1"), make_spacecraft(), TrajectorySettings(duration=duration))
        assert fit.status is Status.INFEASIBLE
        assert fit.trajectory is None
        assert "trajectory." in fit.message


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("duration", [80.0, "stretched"])
@pytest.mark.parametrize("field", ["attitudes", "joints"])
def test_a_nan_in_a_node_is_no_success(field, duration):
    path = load("rrt_c1")
    spoilt = getattr(path, field).copy()
    spoilt[6].flat[0] = np.nan
    path = replace(path, **{field: spoilt})
    fit = fit_paper(path, make_spacecraft(), TrajectorySettings(duration=duration))
    assert fit.status is Status.INFEASIBLE
    assert fit.trajectory is None


def test_time_is_shared_out_by_the_cost_of_the_edges():
    path = wandering(12, 1, seed=1)
    costs = np.array([1.0, 0.5, 1, 1, 0.25, 1, 1, 1, 0.75, 1, 1, 1])
    path = replace(path, edge_costs=costs)
    trajectory = fit_paper(path, make_spacecraft(1), TrajectorySettings()).trajectory
    expected = np.concatenate([[0], np.cumsum(costs)]) / costs.sum() * trajectory.duration
    np.testing.assert_allclose(trajectory.node_times, expected, rtol=1e-12)
    assert passes(trajectory, path)


def test_given_fractions_go_before_costs():
    path, fractions = wandering(6, 1, seed=1), np.array([0, 0.1, 0.3, 0.45, 0.7, 0.9, 1])
    fit = fit_paper(path, make_spacecraft(1), TrajectorySettings(duration=300.0), node_fractions=fractions)
    np.testing.assert_allclose(fit.trajectory.node_times, 300 * fractions, rtol=1e-15)
    assert passes(fit.trajectory, path)


def test_nodes_without_motion_between_them_share_their_time():
    path, twice = wandering(8, 1, seed=2), [0, 0, 1, 2, 3, 3, 3, 4, 5, 6, 7, 8, 8]
    costs = np.array([0, 1, 1, 1, 0, 0, 1, 1, 1, 1, 1, 0.0])
    repeated = Path(attitudes=path.attitudes[twice], joints=path.joints[twice], edge_costs=costs)
    fits = [fit_paper(p, make_spacecraft(1), TrajectorySettings()).trajectory for p in (path, repeated)]
    assert fits[1].duration == fits[0].duration
    np.testing.assert_array_equal(fits[1].node_times, fits[0].node_times[twice])
    assert passes(fits[1], repeated)


def test_a_nearly_empty_edge_does_not_ask_for_a_jolt():
    path = wandering(9, 1, seed=3)
    nudge = Rotation.from_rotvec([1e-6, 0, 0]).as_matrix()
    attitudes = np.insert(path.attitudes, 5, path.attitudes[4] @ nudge, axis=0)
    near = Path(
        attitudes=attitudes,
        joints=np.insert(path.joints, 5, path.joints[4], axis=0),
        edge_costs=np.insert(path.edge_costs, 4, 1e-5),
    )
    plain, nudged = (fit_paper(p, make_spacecraft(1), TrajectorySettings()).trajectory for p in (path, near))
    assert passes(nudged, near)
    assert nudged.duration < 1.5 * plain.duration


def test_a_platform_that_rests_for_part_of_the_path_is_planned():
    path = wandering(16, 2, seed=4)
    path = replace(path, attitudes=path.attitudes[[0] * 6 + list(range(6)) + [5] * 5])
    for segments in (None, 16):
        fit = fit_paper(path, make_spacecraft(2), TrajectorySettings(segments=segments))
        assert fit.status is Status.OK
        assert passes(fit.trajectory, path)
    assert_each(fit.trajectory.chart_rate[:5], "==", 0)  # Omega = 0


def test_joints_alone_and_platform_alone_are_planned():
    path, craft = wandering(10, 2, seed=6), make_spacecraft(2)
    still = replace(path, attitudes=np.broadcast_to(path.attitudes[0], (11, 3, 3)))
    fixed = replace(path, joints=np.broadcast_to(path.joints[3], (11, 4)))
    for one in (still, fixed):
        trajectory = fit_paper(one, craft, TrajectorySettings()).trajectory
        assert passes(trajectory, one)
        assert 1 - 1e-5 <= max(loads(trajectory, craft, fine_times(trajectory)).values()) <= 1
    assert np.abs(fit_paper(still, craft, TrajectorySettings()).trajectory.coefficients).max() <= 1e-14


@pytest.mark.parametrize("duration", [80.0, "stretched"])
@pytest.mark.parametrize("edges", [0, 4])
def test_a_path_without_motion_rests_for_no_time(edges, duration):
    one = wandering(0, 2, seed=7)
    path = Path(
        attitudes=np.repeat(one.attitudes, edges + 1, axis=0),
        joints=np.repeat(one.joints + 0.2, edges + 1, axis=0),
        edge_costs=np.zeros(edges),
    )
    fit = fit_paper(path, make_spacecraft(2), TrajectorySettings(duration=duration))
    assert fit.status is Status.OK
    np.testing.assert_array_equal(fit.trajectory.breaks, [0, 0])
    np.testing.assert_array_equal(fit.trajectory.node_times, np.zeros(edges + 1))
    s = fit.trajectory.sample(0.0)
    np.testing.assert_allclose(s.attitude, one.attitudes[0], atol=1e-15)
    np.testing.assert_array_equal(s.joints, path.joints[0])
    for field in ("angular_velocity", "angular_acceleration", "angular_jerk", "joint_rates", "joint_jerks"):
        np.testing.assert_array_equal(getattr(s, field), 0)
    with pytest.raises(ValueError, match=r"\[0, 0.0\]"):
        fit.trajectory.sample(1e-9)


def test_a_path_may_end_where_it_starts():
    path, order = wandering(6, 1, seed=8), [0, 1, 2, 3, 4, 3, 2, 1, 0]
    path = Path(attitudes=path.attitudes[order], joints=path.joints[order], edge_costs=np.ones(8))
    trajectory = fit_paper(path, make_spacecraft(1), TrajectorySettings()).trajectory
    assert passes(trajectory, path)
    assert trajectory.duration > 1


@pytest.mark.parametrize("edges", [0, 1, 12])
@pytest.mark.parametrize("duration", [120.0, "stretched"])
def test_rates_at_the_ends_are_met(edges, duration):
    craft, path = make_spacecraft(1), wandering(edges, 1, seed=9)
    rates = {
        "start_angular_velocity": np.array([0.01, -0.005, 0.002]),
        "start_joint_rates": np.array([0.01, -0.02]),
        "end_angular_velocity": np.array([-0.004, 0.01, 0.003]),
        "end_joint_rates": np.array([0.0, 0.015]),
    }
    fit = fit_paper(path, craft, TrajectorySettings(duration=duration), **rates)
    assert fit.status is Status.OK
    ends = at(fit.trajectory, fit.trajectory.breaks[[0, -1]])
    for i, when in enumerate(("start", "end")):
        assert_each(np.abs(ends.angular_velocity[i] - rates[f"{when}_angular_velocity"]), "<=", 1e-9)
        assert_each(np.abs(ends.joint_rates[i] - rates[f"{when}_joint_rates"]), "<=", 1e-9)
    assert_each(np.abs(ends.angular_acceleration), "<=", 1e-9)
    assert_each(np.abs(ends.attitude - path.attitudes[[0, -1]]), "<=", 1e-9)
    assert max(loads(fit.trajectory, craft, fine_times(fit.trajectory)).values()) <= 1


def test_a_start_beyond_the_limit_cannot_be_helped_by_time():
    rate = np.array([0.0, 1.1 * make_spacecraft(1).rate_limit, 0.0])
    fit = fit_paper(
        wandering(3, 1, seed=9),
        make_spacecraft(1),
        TrajectorySettings(duration=60.0),
        start_angular_velocity=rate,
    )
    assert fit.status is Status.LIMITS_TOO_TIGHT
    assert fit.needed_duration is None
    assert "lower the rates" in fit.message


@pytest.mark.parametrize("order", [5, 24])
def test_other_orders_work(order):
    path, craft = wandering(14, 1, seed=10), make_spacecraft(1)
    trajectory = fit_paper(path, craft, TrajectorySettings(order=order)).trajectory
    assert trajectory.coefficients.shape[1] == order + 1
    assert passes(trajectory, path)
    assert rests(trajectory)
    assert 1 - 1e-4 <= max(loads(trajectory, craft, fine_times(trajectory)).values()) <= 1


def test_the_rate_weight_acts_on_the_platform_alone():
    path, craft = load("astar_c1"), make_spacecraft()
    light, heavy = (
        fit_paper(path, craft, TrajectorySettings(duration=80.0, rate_weight=weight)).trajectory
        for weight in (0.0, 100.0)
    )
    np.testing.assert_array_equal(light.joint_coefficients, heavy.joint_coefficients)
    t = np.linspace(0, 80, 16_000)
    effort = [np.mean(one.sample(t).angular_velocity ** 2) for one in (light, heavy)]
    assert effort[1] < 0.999 * effort[0]


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"duration": 0.0}, "duration_s"),
        ({"duration": np.nan}, "duration_s"),
        (
            {"duration": "minimum", "method": "paper"},
            'duration_s = "minimum": must be a number or "stretched"$',
        ),
        ({"order": 4}, "order"),
        ({"segments": 0}, "segments"),
        ({"rate_weight": 0.0, "acceleration_weight": 0.0}, "weight"),
        ({"rate_weight": np.nan}, "weight"),
    ],
)
def test_senseless_settings_are_refused_by_name(settings, named):
    with pytest.raises(ValueError, match=f"trajectory.*{named}"):
        fit_paper(load("rrt_c1"), make_spacecraft(), TrajectorySettings(**{"method": "paper"} | settings))


@pytest.mark.parametrize(
    "fractions", [[0, 0.5, 0.5, 1], [0, 0.5, 1], [0.1, 0.4, 0.5, 1], [0, 0.2, 0.5, 0.9], [0, np.nan, 0.5, 1]]
)
def test_senseless_fractions_are_refused(fractions):
    with pytest.raises(ValueError, match="node_fractions"):
        fit_paper(
            wandering(3, 0, seed=0),
            make_spacecraft(0),
            TrajectorySettings(),
            node_fractions=np.array(fractions),
        )


@pytest.mark.parametrize("cost", [-1.0, np.nan, np.inf])
def test_senseless_costs_are_refused(cost):
    path = wandering(3, 0, seed=0)
    with pytest.raises(ValueError, match="costs"):
        fit_paper(replace(path, edge_costs=np.array([1, cost, 1])), make_spacecraft(0), TrajectorySettings())


def test_a_fit_is_the_same_when_made_again():
    path, craft, settings = load("astar_c3"), make_spacecraft(), TrajectorySettings(duration=45.0)
    first, second = (fit_paper(path, craft, settings) for _ in range(2))
    np.testing.assert_array_equal(first.trajectory.coefficients, second.trajectory.coefficients)
    assert first.needed_duration == second.needed_duration
