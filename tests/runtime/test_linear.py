"""Tests of linear maps with a kernel for each direction."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxplan.runtime.differentiation import linear_map

MATRIX = np.array([[1.0, 2.0, -1.0], [0.5, 0.0, 4.0]])
AT, ALONG, BACK = np.array([0.3, -2.0, 1.5]), np.array([1.0, 0.25, -3.0]), np.array([2.0, -0.75])

calls = []
turned = linear_map(
    "turned",
    lambda matrix, vector: calls.append("forward") or [matrix @ vector[0]],
    lambda matrix, answer: calls.append("backward") or [matrix.T @ answer[0]],
)


@jax.custom_jvp
def squares(x):
    return MATRIX @ (x**2 / 2)


@squares.defjvp
def slope(own, ways):
    (x,), (way,) = own, ways
    answer = MATRIX @ (x**2 / 2)
    return answer, turned(MATRIX * x, [way], [answer])[0]


@pytest.fixture(autouse=True)
def wide():
    with jax.enable_x64(True):
        yield


def test_it_has_both_modes_of_differentiation():
    expected = MATRIX * AT
    for jacobian in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jacobian(squares)(AT), expected, rtol=1e-14)
        np.testing.assert_allclose(jax.jit(jacobian(squares))(AT), expected, rtol=1e-14)
    np.testing.assert_allclose(jax.linearize(squares, AT)[1](ALONG), expected @ ALONG, rtol=1e-14)
    np.testing.assert_allclose(jax.vjp(squares, AT)[1](BACK)[0], expected.T @ BACK, rtol=1e-14)


def test_each_direction_calls_its_own_kernel_alone():
    calls.clear()
    jax.grad(lambda x: jnp.sum(squares(x)))(AT)
    assert calls == ["backward"]
    calls.clear()
    jax.jvp(squares, (AT,), (ALONG,))
    assert calls == ["forward"]


def test_it_is_differentiated_along_its_vector_but_not_in_what_it_depends_on():
    def along(way):
        return turned(MATRIX, [way], [BACK])[0]

    np.testing.assert_allclose(jax.jacfwd(along)(ALONG), MATRIX, rtol=1e-14)
    np.testing.assert_allclose(jax.vmap(along)(np.eye(3)), MATRIX.T, rtol=1e-14)
    with pytest.raises(NotImplementedError, match="turned cannot be differentiated"):
        jax.jvp(lambda scale: turned(scale * MATRIX, [ALONG], [BACK])[0], (1.0,), (1.0,))


def test_plain_numbers_that_it_depends_on_do_not_pass_through_transformations():
    def along(matrix):
        return jax.make_jaxpr(lambda way: turned(matrix, [way], [BACK]))(ALONG)

    for matrix, inputs in ((MATRIX, 1), (jax.jit(lambda: jnp.asarray(MATRIX))(), 1)):
        (one,) = along(matrix).eqns
        assert len(one.invars) == inputs
    (one,) = jax.make_jaxpr(lambda matrix: turned(matrix, [ALONG], [BACK]))(MATRIX).eqns
    assert len(one.invars) == 2
