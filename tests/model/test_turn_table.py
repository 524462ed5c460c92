"""Tabulated lengths of turns grow no faster than they may, as is proved, and are near the least time."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from reference import assert_each
from scipy.spatial.transform import Rotation
from turn_growth import (
    Boxes,
    bounds,
    boxes_of,
    cotangent,
    excess,
    excess_between,
    factors,
    halves,
    sides,
)

from jaxplan.model.turn_table import turn_table

MEASURES = ["box", "ellipsoid"]
STEP = 1e-7  # rad, of the differences of lengths
SHARE = 0.05  # of a box's side, of the second differences of slopes


def in_boxes(boxes, face, shares):
    """Parameters (5, N) at shares (5, N) of the boxes' sides, with v (3, 2, N) and `slopes` (N,) there."""
    pieces = boxes.pieces
    for share in shares:
        pieces = pieces[:, 0] * (1 - share) + pieces[:, 1] * share
    at = boxes.ends[:, 0] * (1 - shares) + boxes.ends[:, 1] * shares
    return at, np.array(sides(at[0], cotangent(at[0])[0], factors(face, *at[1:]), pieces[:5])), pieces[5]


@pytest.mark.slow
@pytest.mark.parametrize("measure", MEASURES)
def test_no_length_grows_faster_than_it_may(measure):
    assert_each(excess(turn_table(measure), measure), "<=", 0)


@pytest.mark.parametrize("measure", MEASURES)
def test_two_faces_have_the_same_shares_along_their_edge(measure):
    shares = turn_table(measure).shares
    for face in range(3):
        np.testing.assert_array_equal(shares[:, :, face, :, -1, :], shares[:, :, (face + 1) % 3, :, :, -1])


@pytest.mark.parametrize("measure", MEASURES)
def test_slopes_that_the_proof_bounds_are_those_of_the_lengths(measure):
    table, rng = turn_table(measure), np.random.default_rng(5)
    for place in rng.integers(len(table.finer[0]) - 1, size=(4, 2)):
        for face in range(3):
            boxes = boxes_of(table, face, place)
            shares = rng.uniform(0.01, 0.99, (5, boxes.ends.shape[-1]))
            shares[3:] = shares[3:, :1]  # one spacecraft
            at, slopes, divided = in_boxes(boxes, face, shares)
            rates = np.cumprod([1, at[3, 0], at[4, 0]])
            axes = (face + np.arange(3)) % 3
            turns = np.empty((len(divided), 3))
            turns[:, axes] = np.stack([np.ones_like(at[1]), at[1], at[2]], 1) * rates[axes]
            turns *= (at[0] / np.linalg.norm(turns, axis=1))[:, None]
            for side in (1, -1):
                for axis, known in zip(axes, slopes[:, 0 if side == 1 else 1], strict=True):
                    step = STEP * np.eye(3)[axis]
                    ends = [
                        (Rotation.from_rotvec(side * turns) * Rotation.from_rotvec(s * step)).as_rotvec()
                        for s in (1, -1)
                    ]
                    slope = (table.length(ends[0], rates) - table.length(ends[1], rates)) / (2 * STEP)
                    found = side * rates[axis] * slope * divided
                    np.testing.assert_allclose(found, known, rtol=0, atol=1e-6)


@pytest.mark.parametrize("measure", MEASURES)
def test_second_differences_of_slopes_are_within_the_errors_of_the_proof(measure):
    table, rng = turn_table(measure), np.random.default_rng(9)
    for place in rng.integers(len(table.finer[0]) - 1, size=(4, 2)):
        for face in range(3):
            boxes = boxes_of(table, face, place)
            shares = rng.uniform(SHARE, 1 - SHARE, (5, boxes.ends.shape[-1]))
            for k, step in enumerate(SHARE * np.eye(5)[:, :, None]):
                low, middle, high = (in_boxes(boxes, face, shares + s * step)[1] for s in (-1, 0, 1))
                up, down = np.moveaxis(boxes.errors[k], 2, 0)
                bends = (low - 2 * middle + high) / SHARE**2 / 8
                assert_each(bends, ">=", -up - 1e-9)
                assert_each(bends, "<=", down + 1e-9)


@pytest.mark.parametrize("measure", MEASURES)
def test_halves_of_boxes_have_the_slopes_of_the_whole_within_their_bounds(measure):
    table, rng = turn_table(measure), np.random.default_rng(11)
    order, corners = 1 if measure == "box" else 2, np.array([*np.ndindex(2, 2, 2, 2, 2)]).T
    for face, place in enumerate(rng.integers(len(table.finer[0]) - 1, size=(3, 2))):
        cells = boxes_of(table, face, place)
        for cell in rng.integers(cells.ends.shape[-1], size=20):
            whole = box = Boxes(*(part[..., [cell]] for part in cells))
            for _ in range(8):
                (both,) = halves(box, measure)
                half = rng.integers(2)
                box = Boxes(*(part[..., [half]] for part in both))
                shares = np.concatenate([corners, rng.uniform(size=(5, 20))], axis=1)
                at, slopes, divided = in_boxes(box, face, shares)
                first, last = whole.ends.swapaxes(0, 1)
                _, *known = in_boxes(whole, face, (at - first) / (last - first))
                np.testing.assert_allclose(slopes, known[0], rtol=0, atol=1e-11)
                np.testing.assert_allclose(divided, known[1], rtol=0, atol=1e-12)
                most = np.linalg.norm(slopes, ord=order, axis=0).max(0) - divided
                bound, error = bounds(box, face, measure)
                assert_each(most, "<=", bound)
                assert_each(np.max(most[: corners.shape[1]]), ">=", bound - error - 1e-12)


def test_cotangent_and_its_derivatives_fall():
    angles = np.linspace(0, np.pi, 1001)
    values = cotangent(angles)
    middle = (angles[1:] + angles[:-1]) / 2
    for found, slope in zip(values[:2], cotangent(middle)[1:], strict=True):
        np.testing.assert_allclose(np.diff(found) / np.diff(angles), slope, rtol=0, atol=1e-5)
    assert_each(np.diff(values, axis=1), "<", 0)


@pytest.mark.slow
@pytest.mark.parametrize("measure", MEASURES)
def test_a_share_that_is_a_little_larger_has_no_proof(measure):
    table, rng = turn_table(measure), np.random.default_rng(10)
    place = 0, 0  # between the least tabulated ratios and the next finer ones
    for _ in range(2):
        shares = table.shares.copy()
        shares[0, 0][tuple(rng.integers(1, shares.shape[2:]))] *= 1.01
        assert excess_between(replace(table, shares=shares), measure, place) > 1e-3


@pytest.mark.parametrize("measure", MEASURES)
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
