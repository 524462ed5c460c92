"""Rotations against scipy and closed forms, above all at the hard angles: zero and half a turn."""

from functools import cache
from itertools import pairwise

import jax
import numpy as np
import pytest
from quick import quick_jit
from reference import assert_each
from scipy.spatial.transform import Rotation

from jaxplan import so3
from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import length

HALF_TURN = np.pi
HARD_ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 1 - 1e-9, 1.0, 1 + 1e-9, 2.0, HALF_TURN - 1e-5]
ANGLES = {np.float64: [*HARD_ANGLES, HALF_TURN - 1e-11], np.float32: HARD_ANGLES}
AXES = np.random.default_rng(7).normal(size=(9, 3))
AXES[:4] = [[1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 1, 1]]
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
HALF_TURNS = 2 * AXES[:, :, None] * AXES[:, None, :] - np.eye(3)
PRECISIONS = pytest.mark.parametrize(("dtype", "eps"), [(np.float64, 2.3e-16), (np.float32, 1.2e-7)])
MODES = pytest.mark.parametrize("mode", ["forward", "reverse"])


def rotation_vectors(dtype):
    """(k, 3) every axis at every hard angle, in the given precision."""
    return np.concatenate([angle * AXES for angle in ANGLES[dtype]]).astype(dtype)


def rates(count, dtype):
    return np.random.default_rng(12).normal(size=(count, 3)).astype(dtype)


def random_attitudes(count, seed):
    return Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()


def cross_matrix(vectors):
    return np.cross(np.asarray(vectors, float)[..., None, :], np.eye(3)).swapaxes(-1, -2)


def mean_rotation(vectors, nodes=24):
    """The mean of exp(-s x^) over s in [0, 1], which is the right Jacobian, by Gauss-Legendre quadrature."""
    x, weights = np.polynomial.legendre.leggauss(nodes)
    turns = -(x[:, None, None] + 1) / 2 * np.asarray(vectors, float)
    matrices = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(*turns.shape, 3)
    return np.einsum("q,q...->...", weights / 2, matrices)


def compiled(function, *arguments):
    """What the jitted function returns, as numpy arrays; one compile a call instead of one an operation."""
    return jax.tree.map(np.array, quick_jit(function)(*arguments))


def jacobians(mode, function, points, *others):
    """Derivative in the first argument at every point, by forward or reverse mode."""
    derive = {"forward": jax.jacfwd, "reverse": jax.jacrev}[mode]
    return compiled(jax.vmap(derive(function)), points, *others)


@cache
def derivatives(mode, dtype):
    """Of exp, of log after exp, and of angle after exp, at all hard rotation vectors: one compile."""

    def functions(vector):
        attitude = so3.exp(vector)
        return {"exp": attitude, "log": so3.log(attitude), "angle": so3.angle(attitude)}

    return jacobians(mode, functions, rotation_vectors(dtype))


@PRECISIONS
def test_exp_is_scipys_rotation(dtype, eps):
    vectors = rotation_vectors(dtype)
    matrices = compiled(so3.exp, vectors)
    assert matrices.dtype == dtype
    np.testing.assert_allclose(matrices, Rotation.from_rotvec(vectors).as_matrix(), rtol=0, atol=4 * eps)


@pytest.mark.slow
@PRECISIONS
@MODES
def test_exp_moves_by_the_right_jacobian(mode, dtype, eps):
    vectors = rotation_vectors(dtype)
    attitudes = Rotation.from_rotvec(vectors).as_matrix()
    body_rates = mean_rotation(vectors).swapaxes(-1, -2)  # row m: of a unit rate of component m
    expected = np.moveaxis(attitudes[:, None] @ cross_matrix(body_rates), 1, -1)
    np.testing.assert_allclose(derivatives(mode, dtype)["exp"], expected, rtol=0, atol=10 * eps)


@PRECISIONS
def test_log_is_scipys_rotation_vector(dtype, eps):
    vectors = rotation_vectors(dtype)
    matrices = Rotation.from_rotvec(vectors).as_matrix().astype(dtype)
    result = compiled(so3.log, matrices)
    assert result.dtype == dtype
    np.testing.assert_allclose(result, vectors, rtol=0, atol=10 * eps)
    np.testing.assert_allclose(result, Rotation.from_matrix(matrices).as_rotvec(), rtol=0, atol=10 * eps)


@PRECISIONS
def test_small_rotations_keep_their_digits(dtype, eps):
    vectors = np.concatenate([1e-12 * AXES, 1e-8 * AXES, 1e-4 * AXES]).astype(dtype)
    back, angles = compiled(lambda w: (so3.log(so3.exp(w)), so3.angle(so3.exp(w))), vectors)
    np.testing.assert_allclose(back, vectors, rtol=4 * eps)
    np.testing.assert_allclose(angles, np.linalg.norm(vectors, axis=-1), rtol=4 * eps)


@PRECISIONS
@MODES
def test_log_of_exp_has_the_identity_as_derivative(mode, dtype, eps):
    jacobian = derivatives(mode, dtype)["log"]
    assert jacobian.dtype == dtype
    np.testing.assert_allclose(jacobian, np.broadcast_to(np.eye(3), jacobian.shape), rtol=0, atol=20 * eps)


@PRECISIONS
@MODES
def test_log_moves_by_the_inverse_right_jacobian(mode, dtype, eps):
    vectors = rotation_vectors(dtype)
    matrices = Rotation.from_rotvec(vectors).as_matrix().astype(dtype)
    jacobian = jacobians(mode, lambda t, r: so3.log(r + r @ so3.hat(t)), np.zeros_like(vectors), matrices)
    np.testing.assert_allclose(jacobian, np.linalg.inv(mean_rotation(vectors)), rtol=0, atol=20 * eps)


@PRECISIONS
def test_angle_is_the_length_of_the_rotation_vector(dtype, eps):
    vectors = rotation_vectors(dtype)
    matrices = Rotation.from_rotvec(vectors).as_matrix().astype(dtype)
    lengths = np.linalg.norm(vectors.astype(float), axis=-1)
    np.testing.assert_allclose(compiled(so3.angle, matrices), lengths, rtol=0, atol=10 * eps)


@PRECISIONS
@MODES
def test_angle_grows_along_the_axis_and_is_flat_at_zero(mode, dtype, eps):
    vectors = rotation_vectors(dtype)
    lengths = np.linalg.norm(vectors.astype(float), axis=-1, keepdims=True)
    expected = np.where(lengths > 0, vectors / np.where(lengths > 0, lengths, 1), 0)
    np.testing.assert_allclose(derivatives(mode, dtype)["angle"], expected, rtol=0, atol=20 * eps)


@PRECISIONS
def test_half_a_turn_has_right_values(dtype, eps):
    half_turns = HALF_TURNS.astype(dtype)
    vectors, angles = compiled(lambda r: (so3.log(r), so3.angle(r)), half_turns)
    largest = np.take_along_axis(vectors, np.argmax(np.abs(vectors), axis=-1)[:, None], axis=-1)
    np.testing.assert_array_less(0, largest)
    same_side = np.sign(np.sum(vectors * AXES, axis=-1, keepdims=True))
    np.testing.assert_allclose(vectors, HALF_TURN * same_side * AXES, rtol=0, atol=10 * eps)
    np.testing.assert_allclose(angles, HALF_TURN, rtol=0, atol=4 * eps)


@PRECISIONS
@MODES
def test_half_a_turn_has_finite_derivatives(mode, dtype, eps):
    half_turns = HALF_TURNS.astype(dtype)
    vectors = compiled(so3.log, half_turns)
    jacobian = jacobians(mode, lambda r: (so3.log(r), so3.angle(r), quaternion.from_matrix(r)), half_turns)
    for part in jacobian:
        np.testing.assert_array_equal(np.isfinite(part), True)
    increase = half_turns @ cross_matrix(vectors / HALF_TURN)  # of a turn about the axis that log returns
    np.testing.assert_allclose(np.sum(jacobian[1] * increase, axis=(-1, -2)), 1, rtol=0, atol=20 * eps)


def test_rotations_beyond_half_a_turn_come_back_on_the_short_side():
    lengths = np.array([HALF_TURN + 1e-6, 4.0, 6.2, 7.0, 30.0])
    vectors = (lengths[:, None, None] * AXES).reshape(-1, 3)
    back = compiled(lambda w: so3.log(so3.exp(w)), vectors)
    np.testing.assert_allclose(back, Rotation.from_rotvec(vectors).as_rotvec(), rtol=0, atol=2e-14)


@PRECISIONS
def test_quaternions_are_scipys_in_every_branch(dtype, eps):
    hard = Rotation.from_rotvec(rotation_vectors(np.float64)).as_matrix()
    attitudes = np.concatenate([random_attitudes(200, 1), hard]).astype(dtype)
    quaternions = compiled(quaternion.from_matrix, attitudes)
    assert set(np.argmax(np.abs(quaternions), axis=-1)) == {0, 1, 2, 3}
    assert_each(quaternions[:, 0], ">=", 0)
    reference = Rotation.from_matrix(attitudes).as_quat(scalar_first=True)
    reference *= np.sign(np.sum(reference * quaternions, axis=-1, keepdims=True))
    np.testing.assert_allclose(quaternions, reference, rtol=0, atol=5 * eps)
    np.testing.assert_allclose(compiled(quaternion.to_matrix, quaternions), attitudes, rtol=0, atol=8 * eps)


@MODES
def test_quaternions_move_by_half_the_body_rate(mode):
    attitudes = random_attitudes(60, 2)
    quaternions = compiled(quaternion.from_matrix, attitudes)
    scalar, vector = quaternions[:, 0, None, None], quaternions[:, 1:]
    expected = np.concatenate([-vector[:, None, :], scalar * np.eye(3) + cross_matrix(vector)], axis=1) / 2
    jacobian = jacobians(
        mode, lambda t, r: quaternion.from_matrix(r + r @ so3.hat(t)), np.zeros((60, 3)), attitudes
    )
    np.testing.assert_allclose(jacobian, expected, rtol=0, atol=1e-14)


def test_hat_is_the_cross_product_and_vee_its_inverse():
    a, b = np.random.default_rng(3).normal(size=(2, 5, 4, 3))
    matrices = compiled(so3.hat, a)
    np.testing.assert_allclose(np.einsum("...ij,...j->...i", matrices, b), np.cross(a, b), atol=1e-14)
    np.testing.assert_array_equal(compiled(so3.vee, matrices), a)
    square = np.random.default_rng(4).normal(size=(3, 3))
    np.testing.assert_allclose(compiled(so3.vee, matrices + square + square.T), a, atol=1e-14)


@PRECISIONS
@MODES
def test_length_is_the_norm_with_a_zero_derivative_at_zero(mode, dtype, eps):
    vectors = np.concatenate([np.zeros((1, 3)), AXES, 1e-15 * AXES, 1e6 * AXES]).astype(dtype)
    norms = np.linalg.norm(vectors.astype(float), axis=-1)
    np.testing.assert_allclose(compiled(length, vectors), norms, rtol=4 * eps)
    expected = vectors / np.where(norms > 0, norms, 1)[:, None]
    np.testing.assert_allclose(jacobians(mode, length, vectors), expected, rtol=0, atol=4 * eps)


@PRECISIONS
def test_distance_is_symmetric_and_scipys_magnitude(dtype, eps):
    first, second = random_attitudes(100, 5).astype(dtype), random_attitudes(100, 6).astype(dtype)
    forth, back = compiled(lambda a, b: (so3.distance(a, b), so3.distance(b, a)), first, second)
    np.testing.assert_allclose(forth, back, rtol=0, atol=8 * eps)
    relative = Rotation.from_matrix(first).inv() * Rotation.from_matrix(second)
    np.testing.assert_allclose(forth, relative.magnitude(), rtol=0, atol=10 * eps)


@PRECISIONS
def test_distance_has_a_finite_gradient_where_the_attitudes_are_equal(dtype, eps):
    attitudes = np.concatenate([np.eye(3)[None], random_attitudes(50, 8)]).astype(dtype)
    value_and_gradient = jax.vmap(jax.value_and_grad(so3.distance, argnums=(0, 1)))
    values, gradients = compiled(value_and_gradient, attitudes, attitudes)
    assert_each(values, "<=", 4 * eps)
    for gradient in gradients:
        assert_each(np.linalg.norm(gradient, axis=(-1, -2)), "<=", 1)
        np.testing.assert_array_equal(gradient[0], 0)


@PRECISIONS
def test_geodesic_ends_at_both_attitudes_and_turns_at_constant_speed(dtype, eps):
    first, second = random_attitudes(40, 9).astype(dtype), random_attitudes(40, 10).astype(dtype)
    attitudes = compiled(so3.geodesic, first, second, np.linspace(0, 1, 6).astype(dtype)[:, None])
    assert attitudes.shape == (6, 40, 3, 3)
    assert attitudes.dtype == dtype
    np.testing.assert_allclose(attitudes[0], first, rtol=0, atol=2 * eps)
    np.testing.assert_allclose(attitudes[-1], second, rtol=0, atol=10 * eps)
    turn = (Rotation.from_matrix(first).inv() * Rotation.from_matrix(second)).as_rotvec()
    for here, there in pairwise(attitudes):
        step = Rotation.from_matrix(here).inv() * Rotation.from_matrix(there)
        np.testing.assert_allclose(5 * step.as_rotvec(), turn, rtol=0, atol=80 * eps)


def test_geodesic_reaches_an_attitude_half_a_turn_away():
    first = random_attitudes(9, 11)
    second = first @ HALF_TURNS
    middle, end = compiled(so3.geodesic, first, second, np.array([[0.5], [1.0]]))
    np.testing.assert_allclose(end, second, atol=1e-14)
    for side in (first, second):
        relative = Rotation.from_matrix(side).inv() * Rotation.from_matrix(middle)
        np.testing.assert_allclose(relative.magnitude(), HALF_TURN / 2, rtol=0, atol=1e-14)


@PRECISIONS
def test_right_jacobian_is_the_mean_of_the_rotations_back(dtype, eps):
    vectors = np.concatenate([rotation_vectors(dtype), (5.0 * AXES).astype(dtype)])
    result = compiled(so3.right_jacobian, vectors)
    assert result.dtype == dtype
    np.testing.assert_allclose(result, mean_rotation(vectors), rtol=0, atol=6 * eps)


@PRECISIONS
def test_right_jacobian_gives_the_body_rate_of_exp(dtype, eps):
    vectors = rotation_vectors(dtype)
    velocities = rates(len(vectors), dtype)

    def both(vector, velocity):
        attitude, derivative = jax.jvp(so3.exp, (vector,), (velocity,))
        return so3.vee(attitude.T @ derivative), so3.right_jacobian(vector) @ velocity

    body_rates, expected = compiled(jax.vmap(both), vectors, velocities)
    np.testing.assert_allclose(body_rates, expected, rtol=0, atol=20 * eps)


@PRECISIONS
def test_right_jacobian_rate_is_the_derivative_along_the_curve(dtype, eps):
    vectors = np.concatenate([rotation_vectors(dtype), (5.0 * AXES).astype(dtype)])
    velocities = rates(len(vectors), dtype)
    result = compiled(so3.right_jacobian_rate, vectors, velocities)
    assert result.dtype == dtype
    _, along = compiled(lambda x, v: jax.jvp(so3.right_jacobian, (x,), (v,)), vectors, velocities)
    np.testing.assert_allclose(result, along, rtol=0, atol=20 * eps)
    at_zero = np.all(vectors == 0, axis=-1)
    np.testing.assert_allclose(result[at_zero], -cross_matrix(velocities[at_zero]) / 2, rtol=0, atol=2 * eps)


@PRECISIONS
def test_right_jacobian_acceleration_is_the_derivative_of_its_rate(dtype, eps):
    vectors = np.concatenate([rotation_vectors(dtype), (5.0 * AXES).astype(dtype)])
    velocities = rates(len(vectors), dtype)
    accelerations = velocities[::-1].copy()
    result = compiled(so3.right_jacobian_acceleration, vectors, velocities, accelerations)
    assert result.dtype == dtype
    _, along = compiled(
        lambda x, v, a: jax.jvp(so3.right_jacobian_rate, (x, v), (v, a)), vectors, velocities, accelerations
    )
    np.testing.assert_allclose(result, along, rtol=0, atol=50 * eps)
    at_zero, turn = np.all(vectors == 0, axis=-1), cross_matrix(velocities)
    expected = turn @ turn / 3 - cross_matrix(accelerations) / 2
    np.testing.assert_allclose(result[at_zero], expected[at_zero], rtol=0, atol=4 * eps)


def test_right_jacobian_rate_is_the_difference_of_its_values():
    vectors = np.concatenate([0.3 * AXES, 1.5 * AXES, 3.1 * AXES])
    velocities, step = rates(len(vectors), np.float64), 1e-5
    difference = mean_rotation(vectors + step * velocities) - mean_rotation(vectors - step * velocities)
    result = compiled(so3.right_jacobian_rate, vectors, velocities)
    np.testing.assert_allclose(result, difference / (2 * step), rtol=0, atol=1e-9)


@PRECISIONS
@MODES
def test_right_jacobian_and_its_rate_have_right_derivatives_at_zero(mode, dtype, eps):
    zero, rate = np.zeros((1, 3), dtype), np.array([[0.3, -0.2, 0.5]], dtype)
    jacobian, rate_jacobian = jacobians(
        mode, lambda x, v: (so3.right_jacobian(x), so3.right_jacobian_rate(x, v)), zero, rate
    )
    unit, turn = cross_matrix(np.eye(3)), cross_matrix(rate[0])  # D(x) = I - x^ / 2 + x^ x^ / 6 + ...
    np.testing.assert_allclose(jacobian[0], np.moveaxis(-unit / 2, 0, -1), rtol=0, atol=eps)
    np.testing.assert_allclose(
        rate_jacobian[0], np.moveaxis(unit @ turn + turn @ unit, 0, -1) / 6, rtol=0, atol=eps
    )


def test_quaternions_of_rotation_vectors_are_scipys_and_undone_by_log():
    vectors = rotation_vectors(np.float64)
    found = quaternion.exp(vectors)
    assert_each(np.abs(found - Rotation.from_rotvec(vectors).as_quat(scalar_first=True)), "<", 1e-15)
    assert_each(np.abs(quaternion.log(found) - vectors), "<", 1e-9)
