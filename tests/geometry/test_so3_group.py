"""SO(3) is a group with a distance that no rotation changes, whatever rotations hypothesis comes up with."""

import jax.numpy as jnp
import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from quick import quick_jit

from jaxplan import so3
from jaxplan.geometry.vectors import length

# Components of rotation vectors; also ones that vanish, and turns beyond a whole one.
component = st.floats(-7, 7, allow_subnormal=False) | st.sampled_from(
    [0.0, 1e-300, 1e-12, np.pi, -np.pi, 2 * np.pi]
)
vector = st.tuples(component, component, component)
ROUNDING = 2e-14  # of products of three matrices with entries of order one
HALF = (np.pi, 0.0, 0.0)


@quick_jit
def group(a, b, c, fraction):
    """All that is asked about, in one program."""
    first, second, third = so3.exp(a), so3.exp(b), so3.exp(c)
    turned = [third @ x for x in (first, second)]
    return {
        "rotations": jnp.stack([first, second, third, first @ second]),
        "inverse": so3.exp(-a) @ first,
        "neutral": so3.exp(0 * a),
        "associative": (first @ second) @ third - first @ (second @ third),
        "conjugate": first @ so3.exp(b) @ first.T - so3.exp(first @ b),
        "again": so3.exp(so3.log(first)) - first,
        "back": so3.exp(so3.log(first.T)) - first.T,
        "short": length(so3.log(first @ second)),
        "one parameter": so3.exp(fraction * a) @ so3.exp((1 - fraction) * a) - first,
        "distances": jnp.stack(
            [
                so3.distance(first, second),
                so3.distance(second, first),
                so3.distance(*turned),
                so3.distance(first @ third, second @ third),
            ]
        ),
        "sides": jnp.stack(
            [so3.distance(first, second), so3.distance(second, third), so3.distance(first, third)]
        ),
        "same": so3.distance(first, first),
        "ends": jnp.stack(
            [so3.geodesic(first, second, 0.0) - first, so3.geodesic(first, second, 1.0) - second]
        ),
        "middle": jnp.stack(
            [
                so3.distance(first, so3.geodesic(first, second, fraction))
                - fraction * so3.distance(first, second)
            ]
        ),
    }


@settings(max_examples=100, deadline=None, derandomize=True)
@given(vector, vector, vector, st.floats(0, 1))
@example(HALF, HALF, (0.0, np.pi, 0.0), 0.5)
@example((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
@example((1e-9, 0.0, 0.0), (0.0, 1e-9, 0.0), (np.pi, 0.0, 1e-9), 1.0)
def test_rotations_form_a_group_and_distances_do_not_depend_on_the_frame(a, b, c, fraction):
    a, b, c = (np.array(x) for x in (a, b, c))
    found = {name: np.asarray(part) for name, part in group(a, b, c, fraction).items()}
    for name in found:
        np.testing.assert_array_equal(np.isfinite(found[name]), True, err_msg=name)
    rotations = found["rotations"]
    np.testing.assert_allclose(np.swapaxes(rotations, 1, 2) @ rotations - np.eye(3), 0, atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.det(rotations), 1, rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(found["neutral"], np.eye(3))
    np.testing.assert_allclose(found["inverse"], np.eye(3), rtol=0, atol=ROUNDING)
    size = 1 + max(np.linalg.norm(x) for x in (a, b))
    for name in ("associative", "conjugate", "again", "back", "one parameter", "ends"):
        np.testing.assert_allclose(found[name], 0, atol=size * ROUNDING, err_msg=name)
    assert found["short"] <= np.pi + ROUNDING
    d = found["distances"]
    # Where the angle is near half a turn, a matrix tells it to rounding only by its quaternion.
    np.testing.assert_allclose(d, d[0], rtol=0, atol=1e-7)
    first, second, third = found["sides"]
    assert third <= first + second + 1e-7
    assert found["same"] <= 1e-7
    if d[0] < np.pi - 1e-6:
        np.testing.assert_allclose(found["middle"], 0, atol=1e-7)
