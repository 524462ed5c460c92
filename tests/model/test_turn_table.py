"""Tabulated lengths of turns grow no faster than they may, cell by cell, and are near the least time."""

import jax
import numpy as np
import pytest
from reference import assert_each
from scipy.spatial.transform import Rotation

from jaxplan.model.turn_table import TurnTable, turn_table

INSET = 0.01  # of a cell, from its corners, so that differences stay within it
STEP = 1e-8  # rad, of the differences


def places(table: TurnTable, rates):
    """Rotation vectors near the corners and in the middle of all cells; rates are in falling order."""
    _, _, _, angles, ratios, _ = table.shares.shape
    inside = np.array([*np.ndindex(2, 2, 2), (0.5, 0.5, 0.5)]) * (1 - 2 * INSET) + INSET
    cells = np.stack(np.meshgrid(*[np.arange(n - 1) for n in (angles, ratios, ratios)], indexing="ij"), -1)
    found = (cells.reshape(-1, 1, 3) + inside).reshape(-1, 3) / (angles - 1, ratios - 1, ratios - 1)
    turns = []
    for face in range(3):
        along = np.empty((len(found), 3))
        along[:, (face + np.arange(3)) % 3] = np.insert(found[:, 1:], 0, 1, axis=1)
        along *= rates
        turns.append(np.pi * found[:, :1] * along / np.linalg.norm(along, axis=1, keepdims=True))
    return np.concatenate(turns)


def growth(measure, rates):
    """Of the length, by differences along turns about each body axis; so of each turn and of its inverse."""
    table = turn_table(measure)
    turns = places(table, rates)
    turns = np.concatenate([turns, -turns])
    slopes = np.empty(turns.shape)
    for axis, step in enumerate(STEP * np.eye(3)):
        ends = [(Rotation.from_rotvec(turns) * Rotation.from_rotvec(s * step)).as_rotvec() for s in (1, -1)]
        slopes[:, axis] = (table.length(ends[0], rates) - table.length(ends[1], rates)) / (2 * STEP)
    return np.linalg.norm(slopes * rates, ord=1 if measure == "box" else 2, axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("measure", ["box", "ellipsoid"])
def test_no_length_grows_faster_than_it_may(measure):
    table, rng = turn_table(measure), np.random.default_rng(5)
    pairs = [(first, second) for first in table.ratios[0] for second in table.ratios[1]]
    pairs += list(np.column_stack([rng.uniform(known[0], 1, 12) for known in table.ratios]))
    for first, second in pairs:
        assert_each(growth(measure, np.array([1, first, first * second])), "<=", 1)


@pytest.mark.parametrize("measure", ["box", "ellipsoid"])
def test_lengths_have_the_symmetries_of_turns_and_of_units(measure):
    table, rng = turn_table(measure), np.random.default_rng(6)
    turns = Rotation.random(50, rng=rng).as_rotvec()
    rates = np.array([0.5, 2.0, 1.1])
    known = table.length(turns, rates)
    for signs in np.array([*np.ndindex(2, 2, 2)]) * 2 - 1:
        np.testing.assert_allclose(table.length(turns * signs, rates), known, rtol=1e-12)
    for order in ([1, 2, 0], [2, 1, 0]):
        np.testing.assert_allclose(table.length(turns[:, order], rates[order]), known, rtol=1e-12)
    np.testing.assert_allclose(table.length(turns, 3 * rates), known / 3, rtol=1e-12)
    assert table.length(np.zeros(3), rates) == 0


def test_numpy_and_jax_have_the_same_lengths():
    turns = Rotation.random(50, rng=np.random.default_rng(7)).as_rotvec()
    rates = np.array([1.0, 0.2, 0.7])
    known = turn_table("box").length(turns, rates)
    with jax.enable_x64(True):
        found = jax.jit(turn_table("box").length)(turns, rates)
    np.testing.assert_allclose(found, known, rtol=1e-12)


def test_chains_of_arcs_take_longer_than_the_length_of_the_turn_that_they_make():
    rng = np.random.default_rng(8)
    for _ in range(200):
        rates = rng.uniform(0.2, 1, 3)
        signs, times = rng.integers(-1, 2, (3, 3)), rng.uniform(0, 2.5, 3)
        turn = Rotation.identity()
        for sign, time in zip(signs, times, strict=True):
            turn = turn * Rotation.from_rotvec(sign * rates * time)
        assert turn_table("box").length(turn.as_rotvec(), rates) <= np.sum(times)


@pytest.mark.parametrize(
    ("turn", "least", "share"),
    [  # the least times are those of arcs about diagonals, see the module
        ([np.pi, 0, 0], 4 * np.pi / 3**1.5, 0.92),
        ([0, np.pi / 2, 0], 1.344555, 0.92),
        ([0, 0, 2.5], 1.989100, 0.92),
        (np.pi / np.sqrt(2) * np.array([1, 1, 0]), np.pi / np.sqrt(2), 0.95),
    ],
)
def test_lengths_of_unit_rates_are_near_the_least_time(turn, least, share):
    assert share * least <= turn_table("box").length(np.array(turn), np.ones(3)) <= least
