"""Rows of the method "global": the room that they tell of, and how a step and time change it."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_spacecraft
from fits import problem_of, stack_at
from node_paths import wandering
from reference import assert_each

from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.trajectory.constraints import LinearBlock, LoadBlock, MarginBlock
from jaxplan.trajectory.splines import Basis

RNG = np.random.default_rng(8)
BASIS = Basis.even(6)
PLACES = np.linspace(0.02, 0.98, 23)
ROWS = BASIS.rows(PLACES)
STEP = 1e-5


def step(which, change):
    """A change (n, A) of one of two curves."""
    return np.array([which]), change[None], (ROWS @ change)[None]


def by_slopes(block, index, change):
    """By how much a change (n, A) lessens the slack of some rows."""
    axes, basis = block.slopes(index)
    return np.einsum("rja,rjn,na->r", axes, basis, change)


def two(arrays):
    """The same for two curves."""
    return np.stack([arrays, arrays])


@pytest.mark.parametrize("sort", ["rates", "accelerations", "ranges", "tube"])
def test_linear_rows_are_the_room_that_a_curve_leaves_and_how_a_step_lessens_it(sort):
    rng = np.random.default_rng(3)
    basis = BASIS
    coefficients, other, change = rng.normal(size=(3, basis.size, 5))  # of the platform and two joints
    places, limits = np.linspace(0.1, 0.9, 4), np.array([0.7, 1.3])
    nodes, radius = rng.normal(size=(4, 5)), rng.uniform(0.2, 1, 5)
    rows = basis.rows(places, 1)[0]
    # Of two curves the second is looked at; the first has other limits.
    both = np.stack([other, coefficients])

    def block(c):
        power = {"rates": 1, "accelerations": 2}.get(sort, 0)
        of_sort = {"matrix": two(basis.differences[power]), "scale": two(1 / limits) / [[2], [1]]}
        if sort == "tube":
            centre = two(nodes) + np.array([[[1]], [[0]]])
            of_sort = {"matrix": two(rows), "centre": centre, "scale": two(1 / radius) / [[2], [1]]}
        if sort == "ranges":
            of_sort |= {"scale": np.ones((2, 2)), "bound": (two(limits) * [[2], [1]])[:, None, None]}
        return LinearBlock(name=sort, power=power, tolerance=0.1, coefficients=c, **of_sort)

    def room(c):
        """By how much values may grow, and fall, before they are at a bound."""
        if sort == "tube":
            off = (rows @ c - nodes) / radius
            return np.stack([1 - off, 1 + off])
        if sort == "ranges":
            return np.stack([limits - c[:, 3:], limits + c[:, 3:]])
        shares = basis.differences[1 if sort == "rates" else 2] @ c[:, 3:] / limits
        return np.stack([1 - shares, 1 + shares])

    own = block(both)
    lessened = own.change(*step(1, change))
    np.testing.assert_allclose(own.slack[1], room(coefficients), rtol=0, atol=1e-12)
    np.testing.assert_allclose(own.slack[1] - lessened[0], room(coefficients + change), rtol=0, atol=1e-12)
    index = every(1, own.slack.shape[1:])
    np.testing.assert_allclose(by_slopes(own, index, change), lessened[0][index[1:]], rtol=0, atol=1e-12)


def stack():
    """Three terminals and a camera among zones, with limits of everything."""
    craft = replace(
        make_spacecraft(3, 1),
        inertia=np.array([[2.0, 0.2, -0.1], [0.2, 3.0, 0.3], [-0.1, 0.3, 4.0]]),
        torque_limit=np.full(3, 0.1),
        wheel_momentum_limit=np.array([1.0, 2.0, 3.0]),
        jerk_limit=0.1,
        rate_norm_limit=0.2,
        acceleration_norm_limit=0.3,
    )
    axes = RNG.normal(size=(4, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    out, inside = (
        [kind(name=f"{i}", direction=axes[i], half_angle=1.0, devices=craft.device_names) for i in numbers]
        for kind, numbers in ((KeepOut, (0, 1)), (KeepIn, (2, 3)))
    )
    cones = tabulate(out, inside, craft)
    problem = problem_of(wandering(5, 3, seed=1, step=0.4), craft, cones)
    return stack_at([problem, problem], PLACES, ROWS)


STACK = stack()
PROBLEM = STACK.members[0].problem
COEFFICIENTS, CHANGE = RNG.normal(size=(2, BASIS.size, 9))


def motion(coefficients):
    """Of two curves, the second with these coefficients."""
    both = np.stack([coefficients[::-1], coefficients])
    return STACK.iterates(both, np.ones(2))


def every(curve, shape):
    """Index of all rows of a curve."""
    index = np.nonzero(np.ones(shape, dtype=bool))
    return (np.full(len(index[0]), curve), *index)


def differences(room, change=CHANGE):
    """By how much a change lessens the room."""
    return (room(COEFFICIENTS - STEP * change) - room(COEFFICIENTS + STEP * change)) / (2 * STEP)


@pytest.mark.parametrize("load", range(7))
def test_rows_of_loads_are_the_room_at_places_and_how_a_step_lessens_it(load):
    quantity, components = PROBLEM.limits[load].quantity, PROBLEM.components[load]
    limit = np.array([0.7, 1.3, 2.0])[: len(PROBLEM.limits[load].owners)]

    def room(coefficients):
        shares = motion(coefficients).loads[1, :, components] / limit
        return np.stack([1 - shares, 1 + shares], axis=1)

    own = LoadBlock(
        name=quantity.name,
        power=quantity.power,
        own=components,
        at=motion(COEFFICIENTS),
        scale=two(1 / limit) * [[2], [1]],
    )
    np.testing.assert_allclose(own.slack[1], room(COEFFICIENTS), rtol=1e-12)
    lessened = own.change(*step(1, CHANGE))[0]
    found = differences(room)
    np.testing.assert_allclose(lessened, found, atol=1e-6 * np.abs(found).max())
    index = every(1, lessened.shape)
    np.testing.assert_allclose(by_slopes(own, index, CHANGE), lessened[index[1:]], rtol=1e-9)
    # At the limit the share falls with the power of the duration.
    longer = replace(own, scale=own.scale / (1 + STEP) ** quantity.power)
    gained = (longer.slack - own.slack) / STEP / (1 - own.slack)
    np.testing.assert_allclose(own.power, gained, rtol=1e-3)
    # Of two curves one is far from its limit all along.
    np.testing.assert_array_equal(own.may_bind, True)
    far = replace(own, scale=own.scale * np.array([[0.4 / np.abs(1 - own.slack[0]).max()], [1]]))
    np.testing.assert_array_equal(far.may_bind, [False, True])


def test_rows_of_zones_are_the_room_at_places_and_how_a_step_lessens_it_where_they_are_near():
    wanted = RNG.uniform(0, 0.2, PROBLEM.cones.bound.T.shape)

    def room(coefficients):
        margins = motion(coefficients).margins
        return np.where(np.isfinite(margins), margins, 9.0) - wanted  # 9 where a zone does not bind

    own = MarginBlock(at=motion(COEFFICIENTS), slack=room(COEFFICIENTS))
    # Of all axes, of each joint alone, and next to nothing.
    for change in (
        0.1 * CHANGE,
        *(CHANGE * (np.arange(9) == axis) for axis in range(3, 9)),
        1e-7 * CHANGE,
    ):
        lessened, found = own.change(*step(1, change))[0], differences(room, change)[1]
        looked = lessened != 0
        assert 0.01 < looked.mean() < 0.9
        np.testing.assert_allclose(lessened[looked], found[looked], rtol=1e-5, atol=1e-7)
        idle = ~looked & (found != 0)
        assert_each(own.slack[1][idle], ">=", (found + own.tolerance)[idle])
        index = np.nonzero(looked)
        found = by_slopes(own, (np.ones_like(index[0]), *index), change)
        np.testing.assert_allclose(found, lessened[looked], rtol=1e-9)
    unbound = replace(own, slack=own.slack * np.array([1, np.inf])[:, None, None, None])
    np.testing.assert_array_equal(unbound.may_bind, [True, False])
    assert own.power == 0  # an angle does not change with time


def test_of_places_next_to_each_other_one_in_four_is_held_and_the_last_and_those_with_the_least_room():
    room = RNG.normal(size=(23, 2, 3))
    own = LoadBlock(name="rate", power=1, own=slice(0, 3), at=motion(COEFFICIENTS), scale=np.ones((2, 3)))
    chosen = own.chosen(np.ones((1, *room.shape), dtype=bool), room[None], np.array([1]))[0]
    for series, kept in zip(room.reshape(23, -1).T, chosen.reshape(23, -1).T, strict=True):
        least = [0 < i < 22 and series[i] == min(series[i - 1 : i + 2]) for i in range(23)]
        np.testing.assert_array_equal(kept, (np.arange(23) % 4 == 0) | (np.arange(23) == 22) | least)
    assert not np.any(own.chosen(np.zeros((1, *room.shape), dtype=bool), room[None], np.array([1])))
