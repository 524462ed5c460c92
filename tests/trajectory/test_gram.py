"""The matrix of a program's rows, and systems with it, in the platform's unknowns and as it is."""

import numpy as np
import pytest
from reference import assert_each

from jaxplan.trajectory.gram import DenseGram, PlatformGram, gram_of, order_by_place
from jaxplan.trajectory.interior_point import BoxQP, solve_box_qps
from jaxplan.trajectory.splines import Basis

JOINTS = 4


def rows_of(rng, *, joints=40, coupled=6, twice=False):
    """Rows at random places of B-splines: axes, along, time; the platform's first in no order."""
    basis = Basis.even(20)
    count = 150 + joints + coupled
    places = np.sort(rng.uniform(0, 1, count))
    along = np.swapaxes(basis.rows(places)[:, :, 3:-3], 0, 1)  # (r, 4, k)
    along = along / np.max(np.abs(along), axis=2, keepdims=True)
    axes = rng.normal(size=(count, 4, 3 + JOINTS))
    kind = rng.permutation(np.repeat([0, 1, 2], [150, joints, coupled]))
    axes[kind == 0, :, 3:] = 0.0
    axes[kind == 1, 1:] = 0.0
    axes[kind == 1] *= np.eye(3 + JOINTS)[3 + rng.integers(JOINTS, size=joints)][:, None]
    axes[kind == 2, 1:] = 0.0
    if twice:  # each row of the platform again
        axes, along = (np.concatenate([own, own[kind == 0]]) for own in (axes, along))
    return axes, along, rng.normal(size=len(axes))


def both(axes, along, time, bend=3.0):
    """The matrix solved for the platform's unknowns, and as it is, and the order of the rows."""
    size = along.shape[2]
    root = np.random.default_rng(1).normal(size=(size, size))
    hessian = root @ root.T + np.eye(size)
    order, count = order_by_place(axes, along)
    own = axes[order], along[order], time[order], hessian, np.linalg.inv(hessian), bend
    return gram_of(*own, count), gram_of(*own, 0), order, count


CASES = [
    {},
    {"joints": 0, "coupled": 45},
    {"joints": 60, "coupled": 0},
    {"joints": 0, "coupled": 0, "twice": True},
]


@pytest.mark.parametrize("kinds", CASES)
def test_a_matrix_in_the_unknowns_of_the_platform_is_the_same_matrix(kinds):
    rng = np.random.default_rng(3)
    split, dense, _, count = both(*rows_of(rng, **kinds))
    assert isinstance(split, PlatformGram)
    assert count >= 150
    matrix, size = dense.matrix, np.max(dense.matrix)
    np.testing.assert_allclose(
        np.stack([split.times(unit) for unit in np.eye(len(matrix))]), matrix, rtol=0, atol=1e-12 * size
    )
    np.testing.assert_allclose(split.diagonal(), matrix.diagonal(), rtol=1e-11)
    scale = rng.uniform(0.1, 10, len(matrix))
    scaled, y = split.scaled(scale), rng.normal(size=len(matrix))
    np.testing.assert_allclose(scaled.times(y), scale * (matrix @ (scale * y)), rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("kinds", CASES)
@pytest.mark.parametrize(("least", "share"), [(-6, 1e-10), (-10, 1e-8), (-12, 1e-10)])
def test_systems_are_solved_alike_by_the_unknowns_of_the_platform(kinds, least, share):
    rng = np.random.default_rng(4)
    split, dense, *_ = both(*rows_of(rng, **kinds))
    scale = 1 / np.sqrt(dense.diagonal())
    split, dense = split.scaled(scale), dense.scaled(scale)
    for _ in range(5):
        diagonal = 10.0 ** rng.uniform(least, 8, len(scale))
        right = rng.normal(size=len(scale))
        found = split.factored(diagonal)(right)
        left = dense.times(found) + diagonal * found - right
        assert_each(np.abs(left), "<", share * np.max(np.abs(found)))


def test_the_order_has_rows_of_the_platform_first_by_place_and_coupled_ones_last():
    axes, along, _ = rows_of(np.random.default_rng(5))
    order, count = order_by_place(axes, along)
    assert sorted(order.tolist()) == list(range(len(axes)))
    first, other = axes[order[:count]], axes[order[count:]]
    assert not np.any(first[:, :, 3:])
    places = np.argmax(np.any(along[order[:count]] != 0, axis=1), axis=1)
    assert_each(np.diff(places), ">=", 0)
    touches = np.any(other[:, :, :3], axis=(1, 2))
    assert np.all(np.any(other[:, :, 3:], axis=(1, 2)))
    assert_each(np.diff(touches.astype(int)), ">=", 0)
    assert np.sum(touches) == 6


@pytest.mark.parametrize("rows", [0, 150])
def test_few_rows_stay_as_they_are(rows):
    axes, along, _ = rows_of(np.random.default_rng(6))
    order, count = order_by_place(axes[:rows], along[:rows])
    assert count == 0
    np.testing.assert_array_equal(order, np.arange(rows))


@pytest.mark.parametrize("kinds", CASES)
def test_programs_have_the_same_solution_in_either_form(kinds):
    rng = np.random.default_rng(7)
    split, dense, *_ = both(*rows_of(rng, **kinds))
    count = len(dense.diagonal())
    linear, top = dense.times(rng.uniform(-1, 1, count)), 10.0 ** rng.uniform(-2, 1, count)
    own, other = solve_box_qps([BoxQP(split, linear, top), BoxQP(dense, linear, top)])
    assert own.residual <= 1e-9
    assert other.residual <= 1e-9
    size = np.max(np.abs(linear))
    # Where rows depend on each other many multipliers serve, but all push alike.
    np.testing.assert_allclose(
        dense.times(own.multipliers), dense.times(other.multipliers), rtol=0, atol=1e-6 * size
    )
    assert_each(own.multipliers, ">=", 0)
    assert_each(own.multipliers, "<=", top)


def test_in_a_given_duration_the_matrix_is_of_the_coefficients_alone():
    axes, along, time = rows_of(np.random.default_rng(10))
    split, dense, *_ = both(axes, along, np.zeros_like(time))
    slopes = np.einsum("rpa,rpk->rak", axes, along)[order_by_place(axes, along)[0]]
    weighed = np.linalg.solve(split.hessian[::3, ::3][:-1, :-1], np.swapaxes(slopes, 1, 2)).swapaxes(1, 2)
    expected = np.einsum("rak,sak->rs", weighed, slopes)
    y = np.random.default_rng(11).normal(size=len(time))
    np.testing.assert_allclose(dense.times(y), expected @ y, rtol=0, atol=1e-8 * np.max(expected))
    np.testing.assert_allclose(split.times(y), expected @ y, rtol=0, atol=1e-8 * np.max(expected))


def test_numbers_that_are_not_finite_are_told():
    axes, along, time = rows_of(np.random.default_rng(8))
    split, dense, *_ = both(axes, along, time)
    assert split.is_finite()
    assert dense.is_finite()
    time[7] = np.nan
    split, dense, *_ = both(axes, along, time)
    assert not split.is_finite()
    assert not dense.is_finite()


def test_a_diagonal_that_is_not_positive_is_told():
    split, dense, *_ = both(*rows_of(np.random.default_rng(9)))
    diagonal = np.full(len(dense.diagonal()), -1e9)
    assert split.factored(diagonal) is None
    assert DenseGram(dense.matrix).factored(diagonal) is None
