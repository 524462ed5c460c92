"""ActiveRows of the method "global": the room that they tell of, and how a step and time change it."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_spacecraft
from node_paths import wandering

from jaxplan.model.zones import KeepIn, KeepOut, tabulate
from jaxplan.trajectory.chart import fitting
from jaxplan.trajectory.constraints import (
    JointDerivativeBlock,
    JointRangeBlock,
    LoadBlock,
    MarginBlock,
    Step,
    TubeBlock,
)
from jaxplan.trajectory.motion import evaluate
from jaxplan.trajectory.problem import System
from jaxplan.trajectory.splines import Basis

RNG = np.random.default_rng(8)
BASIS = Basis.even(6)
PLACES = np.linspace(0.02, 0.98, 23)
ROWS = BASIS.rows(PLACES)
STEP = 1e-5


def step(which, change):
    """A change (n, A) of one of two curves."""
    return Step(np.array([which]), change[None], (ROWS @ change)[None], np.zeros(1))


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
        if sort == "tube":
            return TubeBlock(c, two(rows), two(nodes) + np.array([[[1]], [[0]]]), two(radius) * [[2], [1]])
        if sort == "ranges":
            return JointRangeBlock(c, two(limits) * [[2], [1]])
        power = 1 if sort == "rates" else 2
        return JointDerivativeBlock(
            c, sort, power, two(basis.differences[power]), two(1 / limits) * [[2], [1]]
        )

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
    assert own.time == {"rates": -1.0, "accelerations": -2.0}.get(sort, 0.0)
    lessened = own.change(step(1, change))
    assert np.allclose(own.slack[1], room(coefficients), rtol=0, atol=1e-12)
    assert np.allclose(own.slack[1] - lessened[0], room(coefficients + change), rtol=0, atol=1e-12)
    index = every(1, own.slack.shape[1:])
    by_slopes = np.einsum("ran,na->r", own.slopes(index).full, change)
    assert np.allclose(by_slopes, lessened[0][index[1:]], rtol=0, atol=1e-12)


def system():
    """Three terminals and a camera among zones, with limits of everything."""
    craft = replace(
        make_spacecraft(3, 1),
        inertia=np.array([[2.0, 0.2, -0.1], [0.2, 3.0, 0.3], [-0.1, 0.3, 4.0]]),
        torque_limit=np.full(3, 0.1),
        wheel_momentum_limit=np.array([1.0, 2.0, 3.0]),
        jerk_limit=0.1,
    )
    path = wandering(5, 3, seed=1, step=0.4)
    chart, _ = fitting(path.attitudes, np.linspace(0, 1, 6))
    axes = RNG.normal(size=(4, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    out, inside = (
        [kind(name=f"{i}", direction=axes[i], half_angle=1.0, devices=craft.device_names) for i in numbers]
        for kind, numbers in ((KeepOut, (0, 1)), (KeepIn, (2, 3)))
    )
    return System(chart=chart, spacecraft=craft, cones=tabulate(out, inside, craft.device_names))


PROBLEM = system()
COEFFICIENTS, CHANGE = RNG.normal(size=(2, BASIS.size, 9))


def motion(coefficients):
    """Of two curves, the second with these coefficients."""
    both = np.stack([coefficients[::-1], coefficients])
    return evaluate([PROBLEM, PROBLEM], two(PLACES), ROWS @ both[:, None])


def every(curve, shape):
    """Index of all rows of a curve."""
    index = np.nonzero(np.ones(shape, dtype=bool))
    return (np.full(len(index[0]), curve), *index)


def differences(room, change=CHANGE):
    """By how much a change lessens the room."""
    return (room(COEFFICIENTS - STEP * change) - room(COEFFICIENTS + STEP * change)) / (2 * STEP)


@pytest.mark.parametrize("load", range(5))
def test_rows_of_loads_are_the_room_at_places_and_how_a_step_lessens_it(load):
    name, power, limit = PROBLEM.names[load], int(PROBLEM.powers[load]), np.array([0.7, 1.3, 2.0])

    def room(coefficients):
        shares = motion(coefficients).loads[1, :, load] / limit
        return np.stack([1 - shares, 1 + shares], axis=1)

    own = LoadBlock(name, power, motion(COEFFICIENTS), load, two(1 / limit) * [[2], [1]], two(ROWS))
    np.testing.assert_allclose(own.slack[1], room(COEFFICIENTS), rtol=1e-12)
    lessened = own.change(step(1, CHANGE))[0]
    found = differences(room)
    np.testing.assert_allclose(lessened, found, atol=1e-6 * np.abs(found).max())
    index = every(1, lessened.shape)
    by_slopes = np.einsum("ran,na->r", own.slopes(index).full, CHANGE)
    np.testing.assert_allclose(by_slopes, lessened[index[1:]], rtol=1e-9)
    # At the limit the share falls with the power of the duration.
    longer = replace(own, scale=own.scale / (1 + STEP) ** power)
    gained = (longer.slack - own.slack) / STEP / (1 - own.slack)
    np.testing.assert_allclose(-own.time, gained, rtol=1e-3)
    # Of two curves one is far from its limit all along.
    assert np.all(own.may_bind)
    far = replace(own, scale=own.scale * np.array([[0.4 / np.abs(1 - own.slack[0]).max()], [1]]))
    np.testing.assert_array_equal(far.may_bind, [False, True])


def test_rows_of_zones_are_the_room_at_places_and_how_a_step_lessens_it_where_they_are_near():
    wanted = RNG.uniform(0, 0.2, PROBLEM.cones.bound.T.shape)

    def room(coefficients):
        margins = motion(coefficients).margins
        return np.where(np.isfinite(margins), margins, 9.0) - wanted  # 9 where a zone does not bind

    own = MarginBlock(motion(COEFFICIENTS), two(ROWS), room(COEFFICIENTS))
    # Of all axes, of each joint alone, and next to nothing.
    for change in (
        0.1 * CHANGE,
        *(CHANGE * (np.arange(9) == axis) for axis in range(3, 9)),
        1e-7 * CHANGE,
    ):
        lessened, found = own.change(step(1, change))[0], differences(room, change)[1]
        looked = lessened != 0
        assert 0.01 < looked.mean() < 0.9
        np.testing.assert_allclose(lessened[looked], found[looked], rtol=1e-5, atol=1e-7)
        assert np.all(own.slack[1] >= found + own.tolerance, where=~looked & (found != 0))
        index = np.nonzero(looked)
        by_slopes = np.einsum("ran,na->r", own.slopes((np.ones_like(index[0]), *index)).full, change)
        np.testing.assert_allclose(by_slopes, lessened[looked], rtol=1e-9)
    unbound = replace(own, slack=own.slack * np.array([1, np.inf])[:, None, None, None])
    np.testing.assert_array_equal(unbound.may_bind, [True, False])
    assert own.time == 0.0  # an angle does not change with time


def test_of_places_next_to_each_other_one_in_four_is_held_and_the_last_and_those_with_the_least_room():
    room = RNG.normal(size=(23, 2, 3))
    own = LoadBlock("rate", 1, motion(COEFFICIENTS), 0, np.ones((2, 3)), two(ROWS))
    chosen = own.chosen(np.ones((1, *room.shape), dtype=bool), room[None], np.array([1]))[0]
    for series, kept in zip(room.reshape(23, -1).T, chosen.reshape(23, -1).T, strict=True):
        least = [0 < i < 22 and series[i] == min(series[i - 1 : i + 2]) for i in range(23)]
        np.testing.assert_array_equal(kept, (np.arange(23) % 4 == 0) | (np.arange(23) == 22) | least)
    assert not np.any(own.chosen(np.zeros((1, *room.shape), dtype=bool), room[None], np.array([1])))
