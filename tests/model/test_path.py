"""The motion along an edge: its bounds hold at every instant, are sharp, and its cost counts steps."""

import jax
import numpy as np
import pytest
from builders import gimbals_about_z, named_craft
from quick import quick_jit
from reference import assert_each, boresights, direction, random_units
from scipy.spatial.transform import Rotation

from jaxplan.model import path
from jaxplan.model.path import Path
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut

INTERVALS = 3
NEAR = 0.1  # rad: margins this close to zero are what decides, and are far from every cone's axis


def device_names(terminals, instruments):
    return [f"t{i}" for i in range(terminals)] + [f"i{i}" for i in range(instruments)]


class Scene:
    """Random devices and cones: keep-out, keep-in and two groups, some wider than half the sky."""

    def __init__(self, terminals, instruments, seed=0):
        rng = np.random.default_rng((seed, terminals, instruments))
        self.terminals, self.instruments = terminals, instruments
        self.gimbals = gimbals_about_z(rng.uniform(-np.pi, np.pi, terminals))
        self.fixed_boresights = random_units(rng, instruments)
        names = device_names(terminals, instruments)

        def cone():
            return {"direction": random_units(rng), "half_angle": rng.uniform(0.2, 2.0)}

        def some():
            return tuple(rng.permutation(names)[: rng.integers(1, 3)])

        self.keep_out = [KeepOut(name=f"out-{i}", **cone(), devices=some() if i else ()) for i in range(4)]
        self.keep_in = [
            KeepIn(name=f"in-{i}", **cone(), devices=some(), any_of=group)
            for i, group in enumerate([None, "g", "h", "g", None, "h", "g"])
            if names
        ]
        self.cones = tabulate(self.keep_out, self.keep_in, named_craft(*names, terminals=terminals))
        self.sights = self.cones.sights(self.gimbals, self.fixed_boresights)

    def edges(self, count, scale, seed=1):
        """Random edges: attitude, joints, turn, joint change, each with a leading axis."""
        rng = np.random.default_rng((seed, self.terminals))
        joints = rng.uniform(-1, 1, (count, 2 * self.terminals)) * np.repeat(
            [np.pi, np.pi / 2], self.terminals
        )
        turns = rng.normal(size=(count, 3)) * scale * rng.uniform(0, 1, (count, 1))
        changes = rng.normal(size=(count, 2 * self.terminals)) * scale
        turns[::7] = 0  # the platform rests
        changes[::5] = 0  # the joints rest
        return Rotation.random(count, rng=rng).as_matrix(), joints, turns, changes

    def bounds(self, edges, intervals):
        """(count, Z) lower bounds, by one jitted call."""
        fixed = (self.cones, self.sights)
        return np.asarray(quick_jit(jax.vmap(lambda *e: path.edge_margins(*fixed, *e, intervals)))(*edges))

    def boresights(self, edges, fractions):
        """(count, len(fractions), D, 3) inertial."""
        attitudes, joints, turns, changes = edges
        q = joints[:, None] + fractions[:, None] * changes[:, None]
        steps = Rotation.from_rotvec((fractions[:, None] * turns[:, None]).reshape(-1, 3)).as_matrix()
        frames = attitudes[:, None] @ steps.reshape(len(turns), len(fractions), 3, 3)
        return boresights(self, frames, q)

    def sampled(self, edges, samples):
        """(count, Z) smallest margin of every constraint over the samples; rows as in `tabulate`."""
        points = self.boresights(edges, np.linspace(0, 1, samples))
        names = device_names(self.terminals, self.instruments)
        rows = np.full((len(points), samples, len(self.cones.group)), np.inf)
        leaders = {}
        for row, zone in enumerate([*self.keep_out, *self.keep_in]):
            bound = [names.index(device) for device in zone.devices] or list(range(len(names)))
            angles = np.arccos(np.clip(points[:, :, bound] @ zone.direction, -1, 1))
            side = 1 if isinstance(zone, KeepOut) else -1
            margin = np.min(side * (angles - zone.half_angle), axis=-1, initial=np.inf)
            lead = leaders.setdefault(getattr(zone, "any_of", None) or zone.name, row)
            rows[:, :, lead] = margin if lead == row else np.maximum(rows[:, :, lead], margin)
        return np.min(rows, axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("terminals", "instruments", "count"), [(0, 2, 900), (1, 0, 900), (2, 1, 900), (4, 3, 600), (12, 2, 200)]
)
@pytest.mark.parametrize("scale", [0.1, 2.0])
def test_edge_margins_are_never_above_the_true_margin(terminals, instruments, count, scale):
    scene = Scene(terminals, instruments)
    edges = scene.edges(count, scale)
    bounds, true = scene.bounds(edges, INTERVALS), scene.sampled(edges, 201)
    np.testing.assert_array_equal(np.isinf(bounds), np.isinf(true))
    near = np.abs(true) < NEAR
    assert near.any()
    assert_each(bounds[near], "<=", true[near] + 1e-13)
    assert_each(bounds, "<=", true + 3e-8)  # the arc cosine's rounding at a cone's axis


def test_edge_margins_are_sharp_for_edges_of_a_step():
    scene = Scene(3, 1)
    edges = scene.edges(2000, 0.1)
    bounds, true = scene.bounds(edges, INTERVALS), scene.sampled(edges, 201)
    near = np.abs(true) < NEAR
    lost = np.rad2deg(true[near] - bounds[near])
    assert np.median(lost) < 1e-9
    assert np.quantile(lost, 0.99) < 0.05
    assert lost.max() < 1.5


def test_edge_margins_get_sharper_with_the_square_of_the_intervals():
    scene = Scene(2, 1)
    edges = scene.edges(600, 0.7)
    true = scene.sampled(edges, 801)
    near = np.abs(true) < NEAR
    lost = [np.mean(true[near] - scene.bounds(edges, k)[near]) for k in (4, 8, 16)]
    assert lost[0] > 3 * lost[1] > 9 * lost[2] > 0


def yaw_and_pitch_edge(keep_out, keep_in, joints, joint_change, intervals):
    """Bounds of a resting platform with one terminal, which a single edge moves."""
    cones = tabulate(keep_out, keep_in, named_craft("t0", terminals=1))
    bound = jax.jit(path.edge_margins, static_argnums=6)
    edge = (np.eye(3), np.array(joints), np.zeros(3), np.array(joint_change))
    return np.asarray(bound(cones, cones.sights(gimbals_about_z([0.0]), np.zeros((0, 3))), *edge, intervals))


def test_edge_margins_lose_nothing_where_the_angle_to_the_axis_is_monotone():
    z = np.array([0.0, 0.0, 1.0])
    out = KeepOut(name="out", direction=z, half_angle=0.3)
    into = KeepIn(name="in", direction=z, half_angle=1.2, devices=("t0",))
    for first, change in ((0.4, 0.2), (0.6, -0.2)):
        bound = yaw_and_pitch_edge([out], [into], [0.3, first], [0.0, change], INTERVALS)
        nearest, farthest = np.pi / 2 - 0.6, np.pi / 2 - 0.4
        np.testing.assert_allclose(bound[:2], [nearest - 0.3, 1.2 - farthest], rtol=0, atol=1e-14)


@pytest.mark.parametrize("intervals", [1, 3, 8])
def test_an_edge_that_crosses_a_cone_between_clear_ends_is_found(intervals):
    out = KeepOut(name="out", direction=np.array([1.0, 0.0, 0.0]), half_angle=0.05)
    bound = yaw_and_pitch_edge([out], [], [-0.3, 0.0], [0.6, 0.0], intervals)
    assert bound[0] <= -0.05 + 1e-7


def test_an_edge_that_is_not_a_number_is_never_clear():
    scene = Scene(2, 1)
    edges = [part.copy() for part in scene.edges(1200, 0.1)]
    for part, row in zip(edges, (100, 400, 800, 1100), strict=True):
        part[row].flat[1] = np.nan
    bounds = scene.bounds(edges, INTERVALS)
    np.testing.assert_array_less(bounds[[100, 400, 800, 1100]].min(axis=1), -0.1)
    assert not np.isnan(bounds).any()


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_edge_margins_have_finite_derivatives_at_rest_and_in_motion(mode):
    scene = Scene(2, 1)
    fixed = (scene.cones, scene.sights)
    real = np.isfinite(scene.sampled(scene.edges(1, 0.1), 2)[0])
    derive = quick_jit(
        jax.vmap(mode(lambda *e: path.edge_margins(*fixed, *e, INTERVALS)[real], argnums=(0, 1, 2, 3)))
    )
    edges = scene.edges(35, 0.3)  # every seventh platform and every fifth set of joints rests
    for part in derive(*edges):
        np.testing.assert_array_equal(np.isfinite(part), True)


def direction_curvature(turn, change, instruments):
    """(..., D) bound of the second derivative of every inertial boresight, from those seen from the body."""
    terminals = change.shape[-1] // 2
    sights = tabulate([], [], named_craft()).sights(
        gimbals_about_z(np.zeros(terminals)), np.zeros((instruments, 3))
    )
    rate, bend = sights.bounds(change)
    spin = np.asarray(turn)[..., None]
    return spin**2 + 2 * spin * rate + bend


@pytest.mark.parametrize("terminals", [0, 1, 3])
def test_direction_curvature_bounds_the_second_derivative(terminals):
    scene = Scene(terminals, 2)
    edges = scene.edges(1500, 1.0)
    bounds = direction_curvature(np.linalg.norm(edges[2], axis=-1), edges[3], 2)
    assert bounds.shape == (1500, terminals + 2)

    def directions(s, attitude, joints, turn, change):
        attitudes, angles = path.motion(attitude, joints, turn, change, s[None])
        return (scene.sights.in_body(angles) @ attitudes.swapaxes(-1, -2))[0]

    second = quick_jit(
        jax.vmap(jax.vmap(jax.jacfwd(jax.jacfwd(directions)), (0, *[None] * 4)), (None, 0, 0, 0, 0))
    )
    accelerations = np.linalg.norm(second(np.linspace(0, 1, 9), *edges), axis=-1)
    assert_each(accelerations, "<=", bounds[:, None] * (1 + 1e-12) + 1e-14)


def test_direction_curvature_is_reached():
    def second(joints, turn, change):
        """Size of the second derivative by differences, at the middle of a motion."""
        s = np.array([-1e-3, 0.0, 1e-3])[:, None]
        body = direction(*(joints + s * change).T)
        inertial = np.stack(
            [Rotation.from_rotvec(step * turn).apply(v) for step, v in zip(s, body, strict=True)]
        )
        return np.linalg.norm(inertial[0] - 2 * inertial[1] + inertial[2]) / 1e-6

    z = np.array([0.0, 0.0, 1.0])
    for pitch, turn, change in (
        (0.0, 0.7 * z, [0.0, 0.0]),  # a turn about an axis square to the boresight
        (0.0, 0.4 * z, [0.3, 0.0]),  # with the yaw
        (0.0, 0.0 * z, [0.5, 0.3]),  # yaw and pitch where the yaw counts in full
        (np.pi / 2, 0.0 * z, [0.6, 0.5]),  # and at the pole, where it turns the pitch's direction
    ):
        bound = direction_curvature(np.linalg.norm(turn), np.array(change), 0)
        np.testing.assert_allclose(
            second(np.array([0.2, pitch]), turn, np.array(change)), bound[0], rtol=1e-6
        )


def test_motion_is_scipys_geodesic_with_linear_joints():
    scene = Scene(2, 1)
    fractions = np.linspace(0, 1, 7)
    for attitude, joints, turn, change in zip(*scene.edges(15, 1.0), strict=True):
        attitudes, angles = path.motion(attitude, joints, turn, change, fractions)
        expected = attitude @ Rotation.from_rotvec(fractions[:, None] * turn).as_matrix()
        np.testing.assert_allclose(attitudes, expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(angles, joints + fractions[:, None] * change, rtol=0, atol=1e-15)


def test_step_cost_is_the_slowest_of_platform_and_joints():
    steps = np.array([0.1, 0.2, 0.1, 0.4])
    rotations = np.array([0.0, 0.3, 0.1])
    changes = np.array([[0.05, -0.5, 0.0, 0.4], [0.2, 0.1, -0.1, 0.0], [0.0, 0.0, 0.0, -1.0]])
    np.testing.assert_allclose(path.step_cost(rotations, changes, 0.1, steps), [2.5, 3.0, 2.5])
    np.testing.assert_allclose(path.step_cost(rotations, np.zeros((3, 0)), 0.1, np.zeros(0)), [0.0, 3.0, 1.0])


def test_the_length_of_a_path_is_the_cost_of_its_edges():
    nodes = {"attitudes": np.tile(np.eye(3), (3, 1, 1)), "joints": np.zeros((3, 4))}
    walked = Path(**nodes, edge_costs=np.array([1.0, 2.5]))
    assert (walked.length, walked.edges) == (3.5, 2)
    resting = Path(attitudes=np.eye(3)[None], joints=np.zeros((1, 4)), edge_costs=np.zeros(0))
    assert (resting.length, resting.edges) == (0.0, 0)
