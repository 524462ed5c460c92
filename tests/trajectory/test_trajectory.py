"""What a trajectory is between its nodes: smooth, exact in its rates, and sampled as it says."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_spacecraft
from node_paths import NAMES, ZIG_ZAG, fit_paper, fit_stored, load, turning, wandering
from quick import quick_jit
from reference import assert_each
from scipy.spatial.transform import Rotation

from jaxplan.model.scenario import TrajectorySettings
from jaxplan.paper import segments
from jaxplan.trajectory import Trajectory, evaluate

STORED = pytest.mark.parametrize(("name", "segments"), [(n, s) for n in NAMES for s in (None, 3)])
ZIG_ZAGS = pytest.mark.parametrize(("name", "segments"), [(n, s) for n in ZIG_ZAG for s in (None, 3)])
EIGHTH = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
EIGHTH_SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


def stored(name, segments):
    trajectory = fit_stored(name, segments).trajectory
    assert trajectory is not None
    return trajectory


def one_piece(trajectory: Trajectory, k: int) -> Trajectory:
    """A single piece of platform and joints as a trajectory of its own."""
    return replace(
        trajectory,
        breaks=trajectory.breaks[k : k + 2],
        chart_attitude=trajectory.chart_attitude[k : k + 1],
        chart_start=trajectory.chart_start[k : k + 1],
        chart_rate=trajectory.chart_rate[k : k + 1],
        coefficients=trajectory.coefficients[k : k + 1],
        joint_breaks=trajectory.joint_breaks[k : k + 2],
        joint_coefficients=trajectory.joint_coefficients[k : k + 1],
    )


def largest_jumps(trajectory: Trajectory) -> np.ndarray:
    """Over all joins, with each side from its own piece: attitude, its two rates, joints, their two rates."""
    platform = ("attitude", "angular_velocity", "angular_acceleration")
    joints = ("joints", "joint_rates", "joint_accelerations")
    jumps = np.zeros((len(trajectory.breaks) - 2, 6))
    for k in range(len(jumps)):
        sides = [one_piece(trajectory, k), one_piece(trajectory, k + 1)]
        left, right = (side.sample(trajectory.breaks[k + 1]) for side in sides)
        jumps[k, :3] = [np.abs(getattr(left, name) - getattr(right, name)).max() for name in platform]
        # The joints may be joined at another time, beyond the end of these pieces of the platform.
        wide = [replace(side, breaks=np.array([0.0, trajectory.duration])) for side in sides]
        left, right = (side.sample(trajectory.joint_breaks[k + 1]) for side in wide)
        jumps[k, 3:] = [np.abs(getattr(left, name) - getattr(right, name)).max() for name in joints]
    return jumps.max(axis=0)


@STORED
def test_curve_and_two_derivatives_are_continuous(name, segments):
    assert_each(largest_jumps(stored(name, segments)), "<=", 1e-9)


@pytest.mark.parametrize(("name", "jump_deg_s"), zip(ZIG_ZAG, [0.31, 0.11, 0.54, 0.20], strict=True))
def test_the_printed_sign_of_w_breaks_continuity(name, jump_deg_s, monkeypatch):
    """Equation (36) as printed, without the transpose: the errata's jumps of the angular velocity show."""
    assemble = segments.assemble

    def as_printed(**nodes):
        joints, platform, charts = assemble(**nodes)
        return joints, platform, replace(charts, end_turn=np.swapaxes(charts.end_turn, -1, -2))

    monkeypatch.setattr(segments, "assemble", as_printed)
    fit = fit_paper(load(name), make_spacecraft(), TrajectorySettings(duration=80.0, segments=3))
    assert np.rad2deg(largest_jumps(fit.trajectory)[1]) == pytest.approx(jump_deg_s, abs=0.005)


@STORED
def test_nodes_are_passed(name, segments):
    trajectory, path = stored(name, segments), load(name)
    samples = trajectory.sample(np.resize(trajectory.node_times, 1000))  # as many as other tests compile for
    nodes = len(path.attitudes)
    assert_each(np.abs(samples.attitude[:nodes] - path.attitudes), "<=", 1e-9)
    assert_each(np.abs(samples.joints[:nodes] - path.joints), "<=", 1e-9)
    np.testing.assert_allclose(trajectory.node_times, np.linspace(0, 80, len(path.attitudes)), rtol=1e-15)


@STORED
def test_both_ends_are_at_rest(name, segments):
    ends = stored(name, segments).sample([0.0, 80.0])
    for field in ("angular_velocity", "angular_acceleration", "joint_rates", "joint_accelerations"):
        assert_each(np.abs(getattr(ends, field)), "<=", 1e-9, field)


@ZIG_ZAGS
def test_attitudes_are_rotations(name, segments):
    attitude = stored(name, segments).sample(np.linspace(0, 80, 1000)).attitude
    assert_each(np.abs(np.swapaxes(attitude, -1, -2) @ attitude - np.eye(3)), "<=", 1e-12)
    assert_each(np.linalg.det(attitude), ">", 0)


@ZIG_ZAGS
def test_rates_are_the_differences_of_what_they_belong_to(name, segments):
    """Against central differences of eighth order, within pieces."""
    trajectory = stored(name, segments)
    step = 0.02
    inside = np.linspace(0, 1, 110 // len(trajectory.coefficients))[:, None] * (
        np.diff(trajectory.breaks) - 10 * step
    )
    centres = (trajectory.breaks[:-1] + 5 * step + inside).ravel()
    around = centres[:, None] + step * np.arange(-4, 5)
    s = trajectory.sample(around.ravel())

    def difference(values: np.ndarray, weights: np.ndarray, order: int) -> np.ndarray:
        return np.tensordot(weights, values.reshape(-1, 9, *values.shape[1:]), axes=(0, 1)) / step**order

    def middle(values: np.ndarray) -> np.ndarray:
        return values.reshape(-1, 9, *values.shape[1:])[:, 4]

    def skew_part(m: np.ndarray) -> np.ndarray:
        pairs = ((2, 1), (0, 2), (1, 0))
        return np.stack([m[:, i, j] - m[:, j, i] for i, j in pairs], axis=-1) / 2

    back = np.swapaxes(middle(s.attitude), -1, -2)
    # R' = R w^ and R'' = R (w^ w^ + w'^), whose first term is symmetric
    checks = [
        (skew_part(back @ difference(s.attitude, EIGHTH, 1)), s.angular_velocity),
        (skew_part(back @ difference(s.attitude, EIGHTH_SECOND, 2)), s.angular_acceleration),
        (difference(s.angular_acceleration, EIGHTH, 1), s.angular_jerk),
        (difference(s.joints, EIGHTH, 1), s.joint_rates),
        (difference(s.joints, EIGHTH_SECOND, 2), s.joint_accelerations),
        (difference(s.joint_accelerations, EIGHTH, 1), s.joint_jerks),
    ]
    for expected, given in checks:
        assert_each(np.abs(expected - middle(given)), "<=", 1e-8)
        assert np.abs(expected).max() > 1e-4  # the comparison is not of zeros


@pytest.mark.parametrize("segments", [None, 3])
def test_integrated_angular_velocity_gives_the_attitude(segments):
    """R' = R w^ integrated by a Magnus method of fourth order, apart from any chart."""
    trajectory = stored("astar_c3", segments)
    steps = 2400 // len(trajectory.coefficients)
    inside = np.arange(steps)[:, None] / steps * np.diff(trajectory.breaks)
    edges = np.append((trajectory.breaks[:-1] + inside).T.ravel(), trajectory.duration)
    h = np.diff(edges)[:, None]
    gauss = edges[:-1, None] + h * (0.5 + np.array([-1, 1]) * np.sqrt(3) / 6)
    w = trajectory.sample(gauss.ravel()).angular_velocity.reshape(-1, 2, 3)
    turns = h * (w[:, 0] + w[:, 1]) / 2 + np.sqrt(3) / 12 * h**2 * np.cross(w[:, 0], w[:, 1])
    steps = Rotation.from_rotvec(turns).as_matrix()
    attitude = load("astar_c3").attitudes[0]
    for step in steps:
        attitude = attitude @ step
    assert_each(np.abs(attitude - load("astar_c3").attitudes[-1]), "<=", 1e-8)


def test_a_break_belongs_to_the_piece_that_begins_and_the_end_to_the_last():
    trajectory = stored("astar_c3", 3)
    join = trajectory.breaks[1]
    right, left = one_piece(trajectory, 1).sample(join), one_piece(trajectory, 0).sample(join)
    at = trajectory.sample(join)
    assert np.abs(right.angular_jerk - left.angular_jerk).max() > 1e-3  # the jerk jumps, so the choice shows
    np.testing.assert_array_equal(at.angular_jerk, right.angular_jerk)
    last = one_piece(trajectory, 2).sample(80.0)
    np.testing.assert_array_equal(trajectory.sample(80.0).angular_jerk, last.angular_jerk)


def test_shapes_follow_the_times():
    trajectory = stored("rrt_c1", 3)
    scalar, vector, none = trajectory.sample(12.0), trajectory.sample([12.0, 13.0]), trajectory.sample([])
    shapes = {"attitude": (3, 3), "joints": (6,)} | dict.fromkeys(
        ("angular_velocity", "angular_acceleration", "angular_jerk"), (3,)
    )
    shapes |= dict.fromkeys(("joint_rates", "joint_accelerations", "joint_jerks"), (6,))
    for field, shape in shapes.items():
        for samples, leading in ((scalar, ()), (vector, (2,)), (none, (0,))):
            value = getattr(samples, field)
            assert type(value) is np.ndarray
            assert (value.dtype, value.shape) == (np.float64, leading + shape)
        np.testing.assert_array_equal(getattr(vector, field)[0], getattr(scalar, field))


@pytest.mark.parametrize("t", [-1e-9, 80.0 + 1e-9, np.nan, np.inf, [1.0, np.nan], [0.0, 81.0]])
def test_times_outside_are_refused_with_the_range(t):
    with pytest.raises(ValueError, match=r"\[0, 80.0\] s"):
        stored("rrt_c1", 3).sample(t)


def test_times_in_a_matrix_are_refused():
    with pytest.raises(ValueError, match=r"\(2, 2\)"):
        stored("rrt_c1", 3).sample(np.zeros((2, 2)))


def test_many_samples_are_those_of_few():
    trajectory = stored("astar_c3", 3)
    t = np.linspace(0, 80, 40_001)
    many, few = trajectory.sample(t), trajectory.sample(t[::400])
    for field in ("attitude", "angular_acceleration", "joints", "joint_jerks"):
        np.testing.assert_allclose(getattr(many, field)[::400], getattr(few, field), rtol=0, atol=1e-13)


def test_results_do_not_depend_on_the_precision_of_the_caller():
    path, expected = load("rrt_c1"), stored("rrt_c1", 3)
    with jax.enable_x64(False):
        given = fit_paper(path, make_spacecraft(), TrajectorySettings(duration=80.0, segments=3)).trajectory
        samples = given.sample(10.0)
    np.testing.assert_array_equal(given.coefficients, expected.coefficients)
    np.testing.assert_array_equal(given.joint_coefficients, expected.joint_coefficients)
    assert samples.attitude.dtype == np.float64
    np.testing.assert_array_equal(samples.attitude, expected.sample(10.0).attitude)


def test_a_second_trajectory_of_the_same_sizes_compiles_nothing(compilations):
    counts = []
    for edges, count, duration, times in (
        (14, 3, "stretched", 5),
        (17, 4, "stretched", 7),
        (20, 3, 400.0, 8),
    ):
        settings = TrajectorySettings(segments=count, duration=duration)
        trajectory = fit_paper(wandering(edges, 1, seed=edges), make_spacecraft(1), settings).trajectory
        trajectory.sample(np.linspace(0, trajectory.duration, times))
        counts.append(len(compilations))
    assert counts[0] == counts[1] == counts[2]


def test_scaling_keeps_the_attitudes_and_divides_the_rates():
    trajectory = stored("astar_c3", 3)
    slow, t = trajectory.scaled(1.7), np.linspace(0, 80, 1000)
    quick_samples, slow_samples = trajectory.sample(t), slow.sample(np.minimum(1.7 * t, slow.duration))
    powers = {"attitude": 0, "angular_velocity": 1, "angular_acceleration": 2, "angular_jerk": 3}
    powers |= {"joints": 0, "joint_rates": 1, "joint_accelerations": 2, "joint_jerks": 3}
    for field, power in powers.items():
        expected = getattr(quick_samples, field) / 1.7**power
        np.testing.assert_allclose(getattr(slow_samples, field), expected, rtol=1e-9, atol=1e-11)


def resting_chart(dtype):
    """A chart with Omega = 0 and eta = 0 whose platform and joints rest."""
    return Trajectory(
        breaks=np.array([0.0, 2.0, 4.0], dtype),
        chart_attitude=np.broadcast_to(np.eye(3, dtype=dtype), (2, 3, 3)),
        chart_start=np.array([0.0, 2.0], dtype),
        chart_rate=np.zeros((2, 3), dtype),
        coefficients=np.zeros((2, 13, 3), dtype),
        joint_breaks=np.array([0.0, 4.0], dtype),
        joint_coefficients=np.zeros((1, 13, 2), dtype),
        node_times=np.array([0.0, 4.0], dtype),
        smoothness=2,
        method="paper",
    )


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_values_and_gradients_are_finite_at_rest(dtype):
    trajectory = resting_chart(dtype)
    times = jnp.array([0.0, 1.0, 2.0, 4.0], dtype)

    def total(rate, coefficients, t):
        s = evaluate(replace(trajectory, chart_rate=rate, coefficients=coefficients), t)
        parts = (s.attitude, s.angular_velocity, s.angular_acceleration)
        return sum(jnp.sum(array**2) + jnp.sum(array) for array in parts)

    @quick_jit
    def both(trajectory, times):
        leaves = (trajectory.chart_rate, trajectory.coefficients, times)
        return evaluate(trajectory, times), jax.grad(total, argnums=(0, 1, 2))(*leaves)

    samples, gradients = both(trajectory, times)
    assert {array.dtype for array in jax.tree.leaves(samples)} == {np.dtype(dtype)}
    np.testing.assert_array_equal(samples.attitude, np.broadcast_to(np.eye(3), (4, 3, 3)))
    for gradient in gradients:
        np.testing.assert_array_equal(np.isfinite(gradient), True)
    assert np.abs(gradients[1]).max() > 0


def test_derivatives_in_the_coefficients_are_those_of_differences():
    trajectory = stored("astar_c3", 3)
    t = jnp.linspace(1.0, 79.0, 8)
    direction = np.random.default_rng(3).normal(size=trajectory.coefficients.shape)

    @quick_jit
    def jerk(coefficients):
        return evaluate(replace(trajectory, coefficients=coefficients), t).angular_jerk

    _, slope = jax.jvp(jerk, (trajectory.coefficients,), (direction,))
    h = 1e-5
    ahead, behind = (jerk(trajectory.coefficients + sign * h * direction) for sign in (1, -1))
    np.testing.assert_allclose(slope, (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-9)


def test_evaluation_composes_with_vmap():
    trajectory = stored("astar_c3", 3)
    t = np.linspace(0, 80, 8)
    one_by_one = quick_jit(jax.vmap(lambda time: evaluate(trajectory, time)))(t)
    together = trajectory.sample(t)  # by numpy
    for field in vars(together):
        np.testing.assert_allclose(getattr(one_by_one, field), getattr(together, field), atol=1e-13)


@pytest.mark.parametrize(
    "angles_deg",
    [
        list(range(0, 201, 20)),  # beyond half a turn
        list(range(0, 721, 60)),  # twice around
        [0, 120, 240, 360],  # once around in three edges: the chart must not take the short way back
        [0, 170, 340],
    ],
)
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, -2.0, 0.5)])
def test_long_rotations_go_the_way_of_their_edges(angles_deg, axis):
    path = turning(angles_deg, axis)
    settings = TrajectorySettings(duration=200.0 * path.edges, segments=1)
    trajectory = fit_paper(path, make_spacecraft(0), settings).trajectory
    middles = (trajectory.node_times[1:] + trajectory.node_times[:-1]) / 2
    samples = trajectory.sample(np.concatenate([trajectory.node_times, middles]))
    at_nodes, between = samples.attitude[: len(angles_deg)], samples.attitude[len(angles_deg) :]
    assert_each(np.abs(at_nodes - path.attitudes), "<=", 1e-9)
    unit = np.array(axis) / np.linalg.norm(axis)
    turned = Rotation.from_matrix(np.swapaxes(path.attitudes[:-1], -1, -2) @ between).as_rotvec()
    steps = np.deg2rad(np.diff(angles_deg))
    assert_each(np.abs(turned - (turned @ unit)[:, None] * unit), "<=", 1e-9)  # about the axis alone
    assert_each(turned @ unit, ">", 0.1 * steps)
    assert_each(turned @ unit, "<", 0.9 * steps)


def test_half_a_turn_in_one_edge_is_passed():
    path = turning([0, 180])
    trajectory = fit_paper(path, make_spacecraft(0), TrajectorySettings()).trajectory
    assert_each(np.abs(trajectory.sample(trajectory.duration).attitude - path.attitudes[1]), "<=", 1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_quaternions_of_samples_are_those_of_scipy_without_jumps(name):
    curve = stored(name, None)
    times = np.linspace(0, curve.duration, 200)
    found = curve.sample(times)
    np.testing.assert_allclose(Rotation.from_quat(found.quaternion).as_matrix(), found.attitude, atol=1e-12)
    assert_each(np.sum(found.quaternion[1:] * found.quaternion[:-1], axis=1), ">", 0.9)
    np.testing.assert_array_equal(curve.sample(times[7]).quaternion.shape, (4,))
    assert found.quaternion[0, 3] >= 0
