"""Rotations and pointing in numpy: float64 whatever JAX is set to, and JAX where an argument is of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxplan import so3
from jaxplan.geometry import quaternion, rotations, vectors
from jaxplan.geometry.vectors import arrays, max_along, min_along
from jaxplan.model import gimbals
from jaxplan.model.devices import Instrument, Terminal
from jaxplan.model.spacecraft import Spacecraft

RNG = np.random.default_rng(31)
ANGLES = np.concatenate([RNG.uniform(0.01, 3.1, 20), [1e-9, 1 - 1e-9, 1 + 1e-9, np.pi - 1e-6]])
AXES = RNG.normal(size=(len(ANGLES), 3))
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
VECTORS = ANGLES[:, None] * AXES
TURNS = Rotation.from_rotvec(VECTORS)
OTHERS = Rotation.random(len(ANGLES), rng=RNG)
RELATIVE = TURNS.inv() * OTHERS
RATES = RNG.normal(size=VECTORS.shape)
MOUNTS = np.array([0.3, -2.4])
JOINTS = np.concatenate(
    [RNG.uniform(-0.6, 0.6, (len(ANGLES), 2)), RNG.uniform(-1.2, 1.2, (len(ANGLES), 2))], 1
)
FIXED = AXES[:1]
CRAFT = Spacecraft(
    terminals=tuple(
        Terminal(name=f"t{i}", mount=mount, yaw_limit=1, pitch_limit=1, rate_limit=1, acceleration_limit=1)
        for i, mount in enumerate(MOUNTS)
    ),
    instruments=(Instrument(name="camera", boresight=FIXED[0]),),
    rate_limit=1.0,
    acceleration_limit=1.0,
)


def cross_matrix(vectors):
    return np.cross(vectors[..., None, :], np.eye(3)).swapaxes(-1, -2)


def joints_toward(frames, attitude, directions):
    angles = gimbals.angles_toward(*arrays(frames, attitude, directions)[1:])
    return vectors.array_module(*angles).concatenate(angles, axis=-1)


def canonical(rotations):
    return rotations.as_quat(canonical=True, scalar_first=True)


def looks(azimuths, elevations):
    """(..., 3) the x axis turned by an elevation, then by an azimuth."""
    pairs = np.stack([azimuths, -elevations], axis=-1)
    return Rotation.from_euler("ZY", pairs.reshape(-1, 2)).apply([1.0, 0, 0]).reshape(*pairs.shape[:-1], 3)


def right_jacobian(vectors):
    """The closed form of Lemma 3, or the first terms of its series."""
    t = np.linalg.norm(vectors, axis=-1)[:, None, None]
    small, safe = t < 1e-3, np.where(t < 1e-3, 1, t)
    half, cubic = 2 * (np.sin(safe / 2) / safe) ** 2, (safe - np.sin(safe)) / safe**3
    x = cross_matrix(vectors)
    return np.eye(3) - np.where(small, 0.5, half) * x + np.where(small, 1 / 6, cubic) * x @ x


BODY = np.concatenate(
    [looks(JOINTS[:, :2] + MOUNTS, JOINTS[:, 2:]), np.tile(FIXED, (len(ANGLES), 1, 1))], axis=1
)
AZIMUTHS = JOINTS[:, 0] + MOUNTS[0]
SEEN = np.einsum("kij,kdj->kdi", TURNS.as_matrix(), BODY)
STEP, LONG_STEP = 1e-5, 3e-4
OTHER_RATES = RATES[:, [2, 0, 1]] - 0.3


def along(steps):
    """A curve with a rate and an acceleration, so many steps on."""
    time = steps * LONG_STEP
    return VECTORS + time * RATES + time**2 / 2 * OTHER_RATES


# The function, its arguments, what scipy or a closed form says, and by how much that may be off.
CASES = {
    "exp": (so3.exp, (VECTORS,), TURNS.as_matrix(), 1e-15),
    "log": (so3.log, (TURNS.as_matrix(),), VECTORS, 3e-15),
    "angle": (so3.angle, (TURNS.as_matrix(),), ANGLES, 3e-15),
    "distance": (so3.distance, (TURNS.as_matrix(), OTHERS.as_matrix()), RELATIVE.magnitude(), 3e-15),
    "geodesic": (
        so3.geodesic,
        (TURNS.as_matrix(), OTHERS.as_matrix(), 0.3),
        (TURNS * Rotation.from_rotvec(0.3 * RELATIVE.as_rotvec())).as_matrix(),
        3e-15,
    ),
    "hat": (so3.hat, (RATES,), cross_matrix(RATES), 0),
    "vee": (so3.vee, (cross_matrix(RATES),), RATES, 0),
    "length": (vectors.length, (RATES,), np.linalg.norm(RATES, axis=-1), 1e-15),
    "right Jacobian": (so3.right_jacobian, (VECTORS,), right_jacobian(VECTORS), 2e-15),
    "its rate": (
        so3.right_jacobian_rate,
        (VECTORS, RATES),
        (right_jacobian(VECTORS + STEP * RATES) - right_jacobian(VECTORS - STEP * RATES)) / (2 * STEP),
        1e-9,
    ),
    "its acceleration": (
        so3.right_jacobian_acceleration,
        (VECTORS, RATES, OTHER_RATES),
        (right_jacobian(along(1)) - 2 * right_jacobian(VECTORS) + right_jacobian(along(-1))) / LONG_STEP**2,
        1e-6,
    ),
    "quaternion of a matrix": (quaternion.from_matrix, (TURNS.as_matrix(),), canonical(TURNS), 1e-15),
    "matrix of a quaternion": (quaternion.to_matrix, (canonical(TURNS),), TURNS.as_matrix(), 1e-15),
    "log of a quaternion": (quaternion.log, (canonical(TURNS),), VECTORS, 3e-15),
    "product": (quaternion.product, (canonical(TURNS), canonical(OTHERS)), canonical(TURNS * OTHERS), 1e-15),
    "distance of quaternions": (
        quaternion.distance,
        (canonical(TURNS), -canonical(OTHERS)),
        RELATIVE.magnitude(),
        3e-15,
    ),
    "conjugate": (quaternion.conjugate, (canonical(TURNS),), canonical(TURNS.inv()), 1e-15),
    "pointing": (vectors.pointing, (JOINTS[:, 0], JOINTS[:, 2]), looks(JOINTS[:, 0], JOINTS[:, 2]), 1e-15),
    "separation": (
        vectors.separation,
        (AXES, RATES),
        np.arccos(np.sum(AXES * RATES, axis=-1) / np.linalg.norm(RATES, axis=-1)),
        1e-14,
    ),
    "azimuth": (lambda seen: vectors.azimuth_elevation(seen)[0], (BODY[:, 0],), AZIMUTHS, 3e-15),
    "elevation": (lambda seen: vectors.azimuth_elevation(seen)[1], (BODY[:, 0],), JOINTS[:, 2], 3e-15),
    "wrap": (gimbals.wrap, (JOINTS + 6 * np.pi,), JOINTS, 1e-14),
    "body boresights": (CRAFT.gimbals.boresights, (JOINTS,), BODY[:, :2], 1e-15),
    "joints toward": (joints_toward, (CRAFT.gimbals.frames, TURNS.as_matrix(), SEEN[:, :2]), JOINTS, 5e-15),
    "the spacecraft's boresights": (CRAFT.boresights, (TURNS.as_matrix(), JOINTS), SEEN, 2e-15),
    "the spacecraft's joints": (CRAFT.joints_toward, (TURNS.as_matrix(), SEEN[:, :2]), JOINTS, 5e-15),
}
cases = pytest.mark.parametrize("case", CASES)


def cast(values, dtype, module=np):
    """Arrays in a dtype; numbers as they are."""
    return [value if isinstance(value, float) else module.asarray(value, dtype) for value in values]


@cases
@pytest.mark.parametrize("precision", [True, False])
def test_arrays_of_numpy_are_computed_in_float64_whatever_jax_is_set_to(case, precision):
    function, arguments, expected, tolerance = CASES[case]
    with jax.enable_x64(precision):
        found = function(*arguments)
        again = function(*(np.asarray(one).tolist() for one in arguments))
    assert isinstance(found, np.ndarray)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)
    assert again.dtype == np.float64
    np.testing.assert_array_equal(again, found)


@cases
@pytest.mark.parametrize("precision", [True, False])
def test_arrays_of_jax_give_arrays_of_jax_in_their_dtype(case, precision):
    function, arguments, _, _ = CASES[case]
    with jax.enable_x64(precision):
        found = function(*cast(arguments, np.float32, jnp))
    assert isinstance(found, jax.Array)
    assert found.dtype == np.float32


@cases
def test_arrays_of_single_precision_stay_so(case):
    function, arguments, expected, _ = CASES[case]
    found = function(*cast(arguments, np.float32))
    assert isinstance(found, np.ndarray)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-3 if case == "its rate" else 3e-6)


@cases
def test_numpy_and_a_jitted_function_say_the_same(case):
    function, arguments, _, _ = CASES[case]
    traced = jax.jit(function)(*arguments)
    assert isinstance(traced, jax.Array)
    np.testing.assert_allclose(traced, function(*arguments), rtol=0, atol=1e-14)


def test_hard_places_are_computed_in_numpy_without_a_warning():
    long = np.array([[1e100, 0.0, 0.0], [0.0, -1e6, 1e5]])
    np.testing.assert_array_equal(np.isfinite(so3.exp(long)), True)
    np.testing.assert_array_equal(np.isfinite(so3.right_jacobian(long)), True)
    np.testing.assert_array_equal(so3.exp(np.zeros(3)), np.eye(3))
    np.testing.assert_array_equal(so3.log(np.eye(3)), np.zeros(3))
    np.testing.assert_allclose(so3.log(np.diag([-1.0, 1.0, -1.0])), [0, np.pi, 0], rtol=1e-15)
    np.testing.assert_array_equal(vectors.length(np.zeros((2, 0, 3))), np.zeros((2, 0)))
    poles = joints_toward(np.stack([np.eye(3)] * 2), np.eye(3), np.array([[0, 0, 1], [0, 0, -1]]))
    np.testing.assert_array_equal(poles[2:], [np.pi / 2, -np.pi / 2])


def test_what_is_not_a_number_stays_so_without_a_warning():
    nothing = np.full(3, np.nan)
    for found in (so3.exp(nothing), so3.log(so3.exp(nothing)), so3.right_jacobian_rate(nothing, nothing)):
        np.testing.assert_array_equal(found, np.nan)


def test_long_turns_have_finite_derivatives_in_single_precision():
    vector = np.array([3e3, 0.0, 1e3], np.float32)
    np.testing.assert_array_equal(np.isfinite(jax.jacrev(so3.exp)(vector)), True)


def test_one_argument_of_jax_is_enough():
    with jax.enable_x64(True):
        found = so3.distance(jnp.asarray(TURNS.as_matrix()), OTHERS.as_matrix())
    assert isinstance(found, jax.Array)
    assert isinstance(CRAFT.boresights(np.eye(3), jnp.zeros(4)), jax.Array)


def test_numbers_take_the_precision_of_the_arrays_beside_them():
    _, single, number, whole = arrays(np.float32([1, 2]), 0.5, 2)
    assert {single.dtype, number.dtype, whole.dtype} == {np.dtype(np.float32)}
    _, *others = arrays(0.5, np.arange(3), [1, 2], np.float64(0.5))
    assert {other.dtype for other in others} == {np.dtype(np.float64)}


def both(function, *arguments):
    """What a function of components says in numpy and jitted by JAX, stacked along the first axis."""
    traced = jax.jit(lambda *given: jnp.stack(function(*given)))(*arguments)
    found = np.stack(function(*arguments))
    np.testing.assert_allclose(traced, found, rtol=0, atol=1e-15)
    return found


def test_components_come_from_any_leading_axis_and_broadcast():
    one, many = TURNS[0], canonical(OTHERS).T.reshape(4, 4, 6)
    expected = (one * OTHERS).as_matrix().reshape(4, 6, 3, 3)
    product = both(rotations.product, canonical(one)[:, None, None], many)
    turned = np.stack([np.stack(row) for row in rotations.matrix(product)])
    np.testing.assert_allclose(turned, np.moveaxis(expected, (2, 3), (0, 1)), rtol=0, atol=2e-15)


def test_vectors_turned_back_are_in_the_axes_of_the_attitude():
    found = both(rotations.turned_back, canonical(TURNS).T[:, :, None], RATES.T[:, None])
    expected = [turn.inv().apply(RATES) for turn in TURNS]
    np.testing.assert_allclose(np.moveaxis(found, 0, -1), expected, rtol=0, atol=4e-15)


def test_a_rotation_vector_has_scipys_quaternion_at_any_length():
    long = np.concatenate([VECTORS, np.zeros((1, 3)), 3 * VECTORS])
    found = both(rotations.exp, long.T).T
    expected = Rotation.from_rotvec(long).as_quat(scalar_first=True)
    expected *= np.sign(np.sum(expected * found, axis=1, keepdims=True))
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-15)


@pytest.mark.parametrize("sign", [1, -1])
def test_slerp_turns_the_short_way_at_constant_speed(sign):
    first, last = canonical(TURNS).T, sign * canonical(OTHERS).T
    for fraction in (0.0, 0.3, 1.0):
        found = both(rotations.slerp, first, last, np.full(len(TURNS), fraction))
        expected = TURNS * Rotation.from_rotvec(fraction * RELATIVE.as_rotvec())
        apart = Rotation.from_quat(found.T, scalar_first=True).inv() * expected
        np.testing.assert_allclose(apart.magnitude(), 0, atol=3e-15)
        np.testing.assert_allclose(np.linalg.norm(found, axis=0), 1, rtol=1e-15)


def test_slerp_between_neighbours_a_hair_apart_is_their_chord():
    first = np.array([1.0, 0, 0, 0])
    second = np.array([1.0, 1e-9, 0, 0])
    np.testing.assert_allclose(rotations.slerp(first, second, 0.25)[1], 2.5e-10, rtol=1e-15)
    np.testing.assert_array_equal(np.stack(rotations.slerp(first, first, 0.5)), first)


def test_turns_about_the_axes_of_joints_are_the_derivatives_of_pointing():
    by_joint = jax.vmap(jax.jacfwd(lambda joints: CRAFT.gimbals.boresights(joints)[0]))(JOINTS)
    axes = CRAFT.gimbals.axes(JOINTS[:, 0], np.zeros(len(JOINTS), int))
    found = [np.cross(axis, BODY[:, 0]) for axis in axes]
    np.testing.assert_allclose(found, [by_joint[..., 0], by_joint[..., 2]], rtol=0, atol=1e-15)


def test_carried_vectors_turn_with_azimuth_and_elevation():
    azimuth, elevation = JOINTS[:, 0], JOINTS[:, 2]
    circles = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    found = both(vectors.carried, RATES.T, *circles)
    turns = Rotation.from_euler("ZY", np.stack([azimuth, -elevation], axis=-1))
    np.testing.assert_allclose(found.T, turns.apply(RATES), rtol=0, atol=2e-15)
    ahead, left, up = (np.stack(axis, axis=-1) for axis in vectors.frame(*circles))
    np.testing.assert_allclose(np.cross(ahead, left), up, rtol=0, atol=1e-15)


def test_cross_and_dot_are_numpys():
    np.testing.assert_allclose(both(vectors.cross, AXES.T, RATES.T).T, np.cross(AXES, RATES), atol=1e-15)
    np.testing.assert_allclose(vectors.dot(AXES.T, RATES.T), np.sum(AXES * RATES, axis=1), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(both(vectors.unit, RATES.T), axis=0), 1, rtol=1e-15)


@pytest.mark.parametrize("axis", [0, 1, -1])
def test_the_largest_along_an_axis_has_the_derivative_of_one_entry(axis):
    values = np.random.default_rng(3).normal(size=(4, 5))
    values[1] = values[2] = 2.0  # several are the largest
    values[:, 3] = 2.0
    one_way, other = (
        jax.jit(mode(lambda v: max_along(v, axis)))(values) for mode in (jax.jacfwd, jax.jacrev)
    )
    np.testing.assert_array_equal(one_way, other)
    found = max_along(jnp.asarray(values), axis)
    np.testing.assert_array_equal(found, np.max(values, axis=axis))
    np.testing.assert_array_equal(max_along(values, axis), found)
    np.testing.assert_array_equal(min_along(jnp.asarray(values), axis), np.min(values, axis=axis))
    np.testing.assert_array_equal(np.sum(one_way != 0, axis=(-1, -2)), 1)
    np.testing.assert_array_equal(np.sum(one_way * values, axis=(-1, -2)), found)
    low = jax.jit(jax.jacrev(lambda v: min_along(v, axis)))(values)
    np.testing.assert_array_equal(np.sum(low * values, axis=(-1, -2)), np.min(values, axis=axis))


def test_among_no_entries_the_largest_is_less_than_all_numbers():
    for values in (np.zeros((2, 0)), jnp.zeros((2, 0))):
        np.testing.assert_array_equal(max_along(values, -1), [-np.inf, -np.inf])
        np.testing.assert_array_equal(min_along(values, -1), [np.inf, np.inf])
