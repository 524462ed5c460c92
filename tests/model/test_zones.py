"""Margins to cones: right to the last digits, right in sign, and never clear by mistake."""

import jax
import numpy as np
import pytest
from builders import named_craft
from quick import quick_jit
from reference import assert_each, random_units, unit
from scipy.spatial.transform import Rotation

from jaxplan.geometry.vectors import separation
from jaxplan.model import constraints
from jaxplan.model.scores import edge_bound, margins_of_scores, thresholds
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.runtime.batching import padded_count

DEVICES = ("a", "b", "c")
CRAFT = named_craft(*DEVICES)
ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 1.0, np.pi / 2, 2.0, np.pi - 1e-5, np.pi - 1e-11, np.pi]
PRECISIONS = pytest.mark.parametrize(("dtype", "eps"), [(np.float64, 2.3e-16), (np.float32, 1.2e-7)])
MODES = pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
Z = np.array([0.0, 0.0, 1.0])


def random_directions(shape, seed):
    return random_units(np.random.default_rng(seed), *shape)


def half_chord_angle(first, second):
    """Angle of two directions from half the chord between them: all digits, in extended precision."""
    a, b = unit(np.asarray(first, np.longdouble)), unit(np.asarray(second, np.longdouble))
    near, far = (np.minimum(np.sqrt(np.sum(v * v, axis=-1)) / 2, 1) for v in (a - b, a + b))
    return np.where(near < far, 2 * np.arcsin(near), np.pi - 2 * np.arcsin(far)).astype(float)


def away_from_z(angle, azimuth=0.3):
    return np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])


def keep_out(half_angle, direction=Z, devices=(), name="out"):
    return KeepOut(name=name, direction=direction, half_angle=half_angle, devices=devices)


def keep_in(half_angle, direction=Z, devices=("a",), any_of=None, name="in"):
    return KeepIn(name=name, direction=direction, half_angle=half_angle, devices=devices, any_of=any_of)


def margins_of(cones, boresights):
    """(..., Z) of every constraint."""
    return constraints.constraint_margins(cones, constraints.pair_margins(cones, boresights, cones.axis))


def margins(cones, boresights):
    """The same by one jitted call."""
    return np.asarray(quick_jit(margins_of)(cones, boresights))


@PRECISIONS
def test_separation_keeps_all_digits_at_every_angle(dtype, eps):
    first = random_directions((40, 1), 1)
    sideways = unit(np.cross(first, random_directions((40, 1), 2)))
    angles = np.array(ANGLES)[:, None]
    second = (np.cos(angles) * first + np.sin(angles) * sideways).astype(dtype)
    first = first.astype(dtype)
    result = np.asarray(separation(first, second))
    assert result.dtype == dtype
    np.testing.assert_allclose(result, np.broadcast_to(ANGLES, result.shape), rtol=0, atol=4 * eps)
    np.testing.assert_allclose(result, half_chord_angle(first, second), rtol=0, atol=4 * eps)


@MODES
@PRECISIONS
def test_separation_grows_along_the_great_circle_and_is_flat_at_its_ends(mode, dtype, eps):
    axis = Z.astype(dtype)
    directions = np.array([away_from_z(angle) for angle in ANGLES]).astype(dtype)
    directions[[0, -1]] = [Z, -Z]
    gradients = np.asarray(quick_jit(jax.vmap(mode(separation), in_axes=(0, None)))(directions, axis))
    outward = np.array([away_from_z(angle + np.pi / 2) for angle in ANGLES])
    tangential = gradients - np.sum(gradients * directions, axis=-1, keepdims=True) * directions
    np.testing.assert_allclose(tangential[1:-1], outward[1:-1], rtol=0, atol=8 * eps)
    np.testing.assert_allclose(tangential[[0, -1]], 0, rtol=0, atol=eps)


@pytest.mark.parametrize("half_angle", [0.2, 1.0, 1.9, 3.0])
def test_keep_out_is_clear_outside_and_keep_in_inside(half_angle):
    cones = tabulate([keep_out(half_angle, devices=("a",))], [keep_in(half_angle)], named_craft("a"))
    angles = half_angle + np.array([-0.15, -1e-9, 1e-9, 0.1])
    boresights = np.array([away_from_z(angle) for angle in angles])[:, None, :]
    outside, inside = margins(cones, boresights)[:, :2].T
    np.testing.assert_allclose(outside, angles - half_angle, rtol=0, atol=1e-15)
    np.testing.assert_allclose(inside, half_angle - angles, rtol=0, atol=1e-15)


def test_margins_are_the_angles_to_each_axis_less_the_half_angle():
    rng = np.random.default_rng(4)
    axes, halves = random_directions((6,), 5), rng.uniform(0.1, 3.0, 6)
    cones = tabulate(
        [keep_out(h, d) for d, h in zip(axes[:4], halves[:4], strict=True)],
        [keep_in(h, d, DEVICES) for d, h in zip(axes[4:], halves[4:], strict=True)],
        CRAFT,
    )
    boresights = random_directions((500, 3), 6)
    result = np.asarray(constraints.pair_margins(cones, boresights, cones.axis))
    assert result.shape == (500, 8, 3)
    sides = np.array([1, 1, 1, 1, -1, -1])
    angles = half_chord_angle(boresights[:, None], axes[:, None])
    expected = sides[:, None] * (angles - halves[:, None])
    np.testing.assert_allclose(result[:, :6], expected, rtol=0, atol=2e-15)


@pytest.mark.parametrize(
    ("devices", "said"),
    [(("a", "bb"), "zone out: devices: there is no 'bb', only a, b, c"), ("abc", "must be a tuple of names")],
)
def test_a_zone_of_a_device_that_there_is_not_is_refused_since_it_would_bind_nothing(devices, said):
    with pytest.raises(ValueError, match=said):
        tabulate([keep_out(0.3, devices=devices)], [], CRAFT)


def test_a_zone_binds_the_named_devices_and_no_other():
    cones = tabulate(
        [keep_out(0.3, devices=("a", "c")), keep_out(0.4)], [keep_in(0.5, devices=("b",))], CRAFT
    )
    result = np.asarray(constraints.pair_margins(cones, np.tile(Z, (3, 1)), cones.axis))
    np.testing.assert_allclose(result[:3], [[-0.3, np.inf, -0.3], [-0.4, -0.4, -0.4], [np.inf, 0.5, np.inf]])
    np.testing.assert_allclose(margins(cones, np.tile(Z, (3, 1)))[:3], [-0.3, -0.4, 0.5])


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 16, 17, 40])
def test_padding_fills_up_to_a_power_of_two_and_never_binds(count):
    cones = tabulate([keep_out(0.3, name=f"{i}") for i in range(count)], [], CRAFT)
    rows = len(cones.half_angle)
    assert rows == padded_count(count)
    assert count <= rows < max(2 * count, 9)
    assert rows in (0, 8, 16, 32, 64)
    boresights = np.concatenate([random_directions((20, 3), 7), np.broadcast_to(Z, (1, 3, 3))])
    np.testing.assert_array_equal(np.isfinite(margins(cones, boresights)[:, :count]), True)
    np.testing.assert_array_equal(margins(cones, boresights)[:, count:], np.inf)
    assert not cones.bound[count:].any()


def test_without_devices_every_zone_is_clear():
    cones = tabulate([keep_out(0.3)], [], named_craft())
    np.testing.assert_array_equal(margins(cones, np.zeros((5, 0, 3))), np.inf)


def test_a_group_is_as_good_as_its_best_zone_with_its_worst_device():
    x, y = np.eye(3)[:2]
    cones = tabulate(
        [keep_out(0.1, -Z, devices=("b",))],
        [
            keep_in(0.5, x, ("a", "b"), any_of="relay"),
            keep_in(0.4, x, ("c",)),
            keep_in(0.6, y, ("a", "b"), any_of="relay"),
            keep_in(0.3, Z, ("c",), any_of="sun"),
        ],
        CRAFT,
    )
    rng = np.random.default_rng(8)
    boresights = unit(rng.normal(size=(400, 3, 3)) + 2 * x * rng.integers(0, 2, (400, 1, 1)))
    a, b, c = (boresights[:, i] for i in range(3))

    def inside(device, axis, half):
        return half - half_chord_angle(device, axis)

    relay = np.maximum(
        np.minimum(inside(a, x, 0.5), inside(b, x, 0.5)), np.minimum(inside(a, y, 0.6), inside(b, y, 0.6))
    )
    expected = [-inside(b, -Z, 0.1), relay, inside(c, x, 0.4), np.full(400, np.inf), inside(c, Z, 0.3)]
    np.testing.assert_allclose(margins(cones, boresights)[:, :5], np.stack(expected, -1), atol=2e-15)


def test_a_keep_out_zone_is_never_in_a_group():
    cones = tabulate([keep_out(0.1), keep_out(0.2)], [keep_in(0.3, any_of="g")] * 2, named_craft("a"))
    np.testing.assert_array_equal(cones.group[:4], [0, 1, 2, 2])
    np.testing.assert_array_equal(cones.side[:4], [1, 1, -1, -1])


@pytest.mark.parametrize("kind", ["keep_out", "keep_in", "group"])
def test_a_boresight_that_is_not_a_number_is_never_clear(kind):
    zone = {
        "keep_out": ([keep_out(0.1)], []),
        "keep_in": ([], [keep_in(3.0, devices=DEVICES)]),
        "group": ([], [keep_in(3.0, devices=DEVICES, any_of="g"), keep_in(3.1, devices=DEVICES, any_of="g")]),
    }[kind]
    cones = tabulate(*zone, CRAFT)
    boresights = np.tile(away_from_z(1.0), (3000, 3, 1))
    clear = margins(cones, boresights)
    assert_each(clear, ">=", 0)
    boresights[1000, 1, 2] = np.nan
    broken = margins(cones, boresights)
    assert np.min(broken[1000]) == -np.inf
    np.testing.assert_array_equal(np.delete(broken, 1000, axis=0), np.delete(clear, 1000, axis=0))


@MODES
def test_margins_have_finite_derivatives_everywhere(mode):
    cones = tabulate([keep_out(0.3)], [keep_in(0.4, devices=DEVICES)], CRAFT)
    boresights = np.array([[Z, -Z, away_from_z(1.0)], [away_from_z(0.3), away_from_z(1e-9), Z]])
    gradients = jax.vmap(
        mode(
            lambda b: constraints.constraint_margins(cones, constraints.pair_margins(cones, b, cones.axis))[
                :2
            ]
        )
    )
    np.testing.assert_array_equal(np.isfinite(gradients(boresights)), True)


def test_edge_bound_is_never_passed_and_reached_by_the_parabola():
    rng = np.random.default_rng(9)
    start, end = rng.normal(size=(2, 2000))
    curvature = np.abs(rng.normal(size=2000)) * rng.choice([0.0, 0.1, 3.0], 2000)  # C h^2 / 2
    fraction = np.linspace(0, 1, 4001)[:, None]
    parabola = start + (end - start) * fraction + curvature * fraction * (1 - fraction)
    bound = np.asarray(edge_bound(start, end, curvature))
    peak = np.max(parabola, axis=0)
    assert_each(bound, ">=", peak - 1e-14)
    np.testing.assert_allclose(bound, peak, rtol=0, atol=1e-6 * (1 + curvature.max()))


def test_edge_bound_is_the_larger_end_where_the_curvature_cannot_turn_the_function():
    rng = np.random.default_rng(10)
    start, end = rng.normal(size=(2, 500))
    bound = edge_bound(start, end, 0.999 * np.abs(end - start))
    np.testing.assert_array_equal(bound, np.maximum(start, end))


@pytest.mark.parametrize("place", [0, 1, 2])
def test_edge_bound_of_what_is_not_a_number_is_infinite(place):
    arguments = [0.1, 0.2, 0.3]
    arguments[place] = np.nan
    assert edge_bound(*arguments) == np.inf


def signed_cosines(cones, angles):
    """(len(angles), Z) as a device at these angles from every axis has them."""
    return cones.side * np.cos(angles)[:, None]


def test_margins_from_cosines_are_the_margins():
    cones = tabulate([keep_out(0.7), keep_out(2.2)], [keep_in(0.5), keep_in(2.0)], named_craft("a"))
    angles = np.linspace(0.01, 3.13, 200)
    expected = cones.side * (angles[:, None] - cones.half_angle)
    result = margins_of_scores(cones, signed_cosines(cones, angles))
    np.testing.assert_allclose(result, expected, rtol=0, atol=1e-13)
    past = margins_of_scores(cones, np.full(8, 1.5))  # beyond the worst: on the axis, or opposite
    np.testing.assert_allclose(past[:4], [-0.7, -2.2, 0.5 - np.pi, 2.0 - np.pi], rtol=0, atol=1e-15)


@MODES
def test_margins_from_cosines_have_finite_derivatives_at_the_axis_and_beyond(mode):
    cones = tabulate([keep_out(0.7)], [keep_in(0.5)], named_craft("a"))
    jacobian = jax.vmap(mode(lambda c: margins_of_scores(cones, c)[:2]))
    np.testing.assert_array_equal(np.isfinite(jacobian(np.linspace(-2, 2, 9)[:, None] * np.ones(8))), True)


@pytest.mark.parametrize("clearance", [0.0, 0.01, 0.3])
def test_the_cosine_threshold_is_where_the_margin_is_the_clearance(clearance):
    cones = tabulate([keep_out(0.7), keep_out(2.2)], [keep_in(0.7), keep_in(2.0)], named_craft("a"))
    angles = np.linspace(0, np.pi, 1001)
    slack = np.asarray(thresholds(cones, clearance)) - signed_cosines(cones, angles)
    excess = cones.side * (angles[:, None] - cones.half_angle) - clearance
    decided = np.abs(excess) > 1e-9
    np.testing.assert_array_equal((slack >= 0)[decided], (excess >= 0)[decided])


def test_a_clearance_is_given_up_to_half_of_the_room_a_zone_leaves():
    cones = tabulate([keep_out(3.1)], [keep_in(0.02)], named_craft("a"))
    rooms = np.array([np.pi - 3.1, 0.02])
    angles = cones.half_angle[:2] + cones.side[:2] * rooms / 2  # in the middle of what is left
    for shift, clear in ((1e-6, True), (-1e-6, False)):
        cosines = np.full(8, -np.inf)
        cosines[:2] = cones.side[:2] * np.cos(angles + cones.side[:2] * shift)
        slack = np.asarray(thresholds(cones, 1.0)) - cosines
        np.testing.assert_array_equal(slack[:2] >= 0, clear)
        np.testing.assert_array_equal(slack[2:], np.inf)


def test_margins_turn_with_the_scene():
    turn = Rotation.random(rng=np.random.default_rng(11)).as_matrix()
    axes, boresights = random_directions((5,), 12), random_directions((50, 3), 13)

    def scene(rotation):
        outs = [keep_out(0.5 + 0.1 * i, rotation @ axis) for i, axis in enumerate(axes)]
        return margins(tabulate(outs, [], CRAFT), boresights @ rotation.T)

    np.testing.assert_allclose(scene(turn), scene(np.eye(3)), rtol=0, atol=1e-14)
