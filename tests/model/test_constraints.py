"""Margins and bounds of every kind of pair, against plain numpy and dense sampling."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import gimbals_about_z
from kinds import pair_margins_of
from oblique import oblique_craft
from reference import assert_each, random_units
from scipy.spatial.transform import Rotation

from jaxplan.model.constraints import (
    BODY,
    INERTIAL,
    JOINTS,
    SIGHT,
    Constraints,
    axes_in_body,
    best_entries,
    constraint_margins,
    joint_values,
    state_margins,
    worst_constraint,
)
from jaxplan.model.directions import Sights
from jaxplan.model.scores import edge_bound, margins_of_scores, room, score_curvature, scores, thresholds

RNG = np.random.default_rng(5)
TERMINALS = 2


def craft_sights(gimbals):
    """Two terminals or more, an instrument and an axis of the body, and two more vectors of moving parts."""
    return Sights(
        gimbals=gimbals,
        fixed=random_units(RNG, 2),
        carrier=np.array([1, gimbals.count - 1]),
        carried=random_units(RNG, 2),
    )


def every_kind(gimbals):
    """A row of every kind that binds all sights it may, some of them in entries and groups."""
    own = craft_sights(gimbals)
    frame = np.array([INERTIAL, INERTIAL, BODY, SIGHT, SIGHT, JOINTS, JOINTS, BODY])
    bound = np.ones((8, own.count), bool)
    bound[frame == JOINTS] = np.arange(own.count) < TERMINALS
    bound[3, 1] = bound[4, 4] = False  # a sight is no constraint on itself
    normal = np.append(random_units(RNG, 8)[:, :2], np.zeros((8, 1)), axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    rows = Constraints(
        axis=np.where((frame == JOINTS)[:, None], normal, random_units(RNG, 8)),
        frame=frame,
        partner=np.array([0, 0, 0, 1, 4, 0, 0, 0]),
        half_angle=RNG.uniform(0.2, 1.2, 8),
        side=np.array([1.0, -1, 1, 1, -1, 1, 1, -1]),
        bound=bound,
        entry=np.array([0, 1, 2, 2, 4, 5, 6, 7]),
        group=np.array([0, 1, 1, 1, 4, 5, 5, 7]),
        zone=np.arange(8),
        body=own.fixed[1:],
        carrier=own.carrier,
        carried=own.carried,
        inner=True,
        nested=True,
    )
    return rows, rows.sights(own.gimbals, own.fixed[:1])


def margins_one_by_one(rows, sights, attitude, joints):
    """(Z, S) rad, each by itself."""
    craft = SimpleNamespace(gimbals=sights.gimbals, fixed_boresights=sights.fixed[:1])
    return pair_margins_of(craft, rows, attitude[None], joints[None])[0]


KINDS = {
    "about z": every_kind(gimbals_about_z([0.3, -2.0])),
    "mounted in any way, with drives": every_kind(oblique_craft(TERMINALS, 2).gimbals),
}
ROWS, SIGHTS = KINDS["about z"]
kinds = pytest.mark.parametrize("kind", KINDS)


def random_joints(sights):
    drives = sights.gimbals.count - TERMINALS
    return np.concatenate(
        [RNG.uniform(-3, 3, TERMINALS), RNG.uniform(-1.5, 1.5, TERMINALS), RNG.uniform(-3, 3, drives)]
    )


@kinds
def test_margins_of_every_kind_are_those_of_rotations(kind):
    rows, sights = KINDS[kind]
    for _ in range(20):
        attitude, joints = Rotation.random(rng=RNG).as_matrix(), random_joints(sights)
        wanted = margins_one_by_one(rows, sights, attitude, joints)
        np.testing.assert_allclose(state_margins(rows, sights, attitude, joints), wanted, atol=1e-14)
    traced = jax.jit(state_margins)(rows, sights, attitude, joints)
    np.testing.assert_allclose(traced, wanted, atol=1e-14)


@kinds
def test_scores_are_below_thresholds_just_where_margins_keep_the_clearance(kind):
    rows, sights = KINDS[kind]
    for clearance in (0.0, 0.1, 3.0):
        attitude, joints = Rotation.random(rng=RNG).as_matrix(), random_joints(sights)
        seen = sights.in_body(joints)
        axes = axes_in_body(rows, rows.axis @ attitude, seen)
        score = scores(rows, seen @ axes.T, joint_values(rows, sights.gimbals, joints))  # (S, Z)
        margin = np.where(rows.bound.T, margins_of_scores(rows, score), np.inf)
        np.testing.assert_allclose(margin.T, state_margins(rows, sights, attitude, joints), atol=1e-7)
        asked = np.minimum(clearance, room(rows))
        kept = score <= thresholds(rows, clearance)
        np.testing.assert_array_equal(kept[rows.bound.T], (margin >= asked)[rows.bound.T])


@kinds
def test_rates_and_bends_bound_the_derivatives_of_sights_seen_from_the_body(kind):
    _, sights = KINDS[kind]
    step, reached = 1e-3, np.zeros((2, sights.count))
    for _ in range(600):
        joints, size = random_joints(sights), RNG.uniform(0.1, 1.0)
        change = size * RNG.uniform(-1, 1, len(joints)) * RNG.integers(0, 2, len(joints))
        before, here, after = sights.in_body(joints + np.array([[-step], [0], [step]]) * change)
        first = np.linalg.norm(after - before, axis=-1) / (2 * step)
        second = np.linalg.norm(after - 2 * here + before, axis=-1) / step**2
        bounds = np.stack(sights.bounds(change))
        assert_each([first, second], "<=", bounds * (1 + 1e-6) + 1e-9)
        share = np.stack([first, second]) / np.where(bounds > 1e-3, bounds, np.inf)
        reached = np.maximum(reached, share)
        np.testing.assert_array_equal(bounds[:, sights.carriers < 0], 0)
    # and none is far too large; of a drive it is as of a boresight across the axis
    reached[:, TERMINALS : sights.gimbals.count] /= np.cos(sights.gimbals.tilts)
    assert_each(reached[:, sights.carriers >= 0], ">", 0.8)


@kinds
def test_bounds_over_a_motion_hold_between_its_ends_for_every_kind_of_pair(kind):
    rows, sights = KINDS[kind]
    share = np.linspace(0, 1, 201)
    closest = np.full(rows.bound.shape[::-1], np.inf)
    for size in np.geomspace(0.01, 3, 150):
        attitude, turn = Rotation.random(rng=RNG), size * random_units(RNG) * RNG.uniform(0, 1)
        first = random_joints(sights)
        change = size * RNG.uniform(-1, 1, len(first)) * RNG.integers(0, 2, len(first))
        joints = first + share[:, None] * change
        turned = (attitude * Rotation.from_rotvec(share[:, None] * turn)).as_matrix()
        seen = sights.in_body(joints)
        axes = axes_in_body(rows, rows.axis @ turned, seen)
        score = scores(rows, seen @ np.swapaxes(axes, 1, 2), joint_values(rows, sights.gimbals, joints))
        bend = score_curvature(rows, np.linalg.norm(turn), *sights.bounds(change))
        bound = edge_bound(score[0], score[-1], bend / 2)
        above = bound - score.max(axis=0)
        assert_each(above, ">=", -1e-12)
        second = np.abs(score[2:] - 2 * score[1:-1] + score[:-2]).max(axis=0) * 200**2
        assert_each(second, "<=", bend * (1 + 1e-6) + 1e-9)
        closest = np.minimum(closest, np.where(second > 1e-6, bend / np.maximum(second, 1e-9), np.inf))
    cones = rows.bound.T & (rows.frame != JOINTS)
    np.testing.assert_array_less(closest[cones & (closest < np.inf)], 4)  # and none is far too large


def test_a_constraint_holds_as_its_best_entry_does_of_which_all_rows_must():
    margin = RNG.normal(size=(7, 8))
    found = best_entries(ROWS, margin)
    np.testing.assert_array_equal(found[:, 0], margin[:, 0])
    np.testing.assert_array_equal(
        found[:, 1], np.maximum(margin[:, 1], np.minimum(margin[:, 2], margin[:, 3]))
    )
    np.testing.assert_array_equal(found[:, 5], np.maximum(margin[:, 5], margin[:, 6]))
    np.testing.assert_array_equal(np.isinf(found[:, [2, 3, 6]]), True)
    pairs = np.where(ROWS.bound, margin[0][:, None] + np.arange(SIGHTS.count), np.inf)
    np.testing.assert_array_equal(constraint_margins(ROWS, pairs), best_entries(ROWS, pairs.min(axis=1)))


def test_the_worst_constraint_is_the_least_best_entry_however_entries_were_mixed():
    mixed = replace(  # two constraints whose entries and rows take turns, and one by itself
        ROWS, entry=np.array([0, 1, 0, 3, 1, 3, 6, 7]), group=np.array([0, 1, 0, 1, 1, 1, 0, 7])
    )
    wanted = np.arange(8) != 7
    ordered = mixed.part(wanted)
    margin = RNG.normal(size=(40, 8))
    best = best_entries(mixed, margin)[:, :7].min(axis=1)
    for kind in (np.asarray, jnp.asarray):
        own = kind(np.where(ordered.zone >= 0, margin[:, ordered.zone], np.inf))
        np.testing.assert_array_equal(worst_constraint(ordered, own), best.astype(own.dtype))
        np.testing.assert_array_equal(best_entries(ordered, own).min(axis=1), best.astype(own.dtype))
    assert worst_constraint(mixed.part(np.zeros(8, bool)), np.zeros((2, 0))).tolist() == [np.inf] * 2


def test_what_is_not_a_number_counts_as_broken():
    joints = np.full(2 * TERMINALS, np.nan)
    found = state_margins(ROWS, SIGHTS, np.eye(3), joints)
    np.testing.assert_array_equal(found[:, :TERMINALS][ROWS.bound[:, :TERMINALS]], -np.inf)
    np.testing.assert_array_equal(
        state_margins(ROWS, SIGHTS, np.full((3, 3), np.nan), random_joints(SIGHTS))[0], -np.inf
    )


def test_edges_with_numbers_that_are_none_are_out_of_bounds():
    for place in range(3):
        numbers = np.array([0.1, 0.2, 0.3])
        numbers[place] = np.nan
        assert edge_bound(*numbers) == np.inf


def test_slopes_of_bounds_of_joints_know_nothing_of_axes_that_move():
    gimbals = gimbals_about_z([0.0, 2.0])
    rows, _ = every_kind(gimbals)
    still = np.asarray(rows.axis)
    moving = replace(
        rows, axis=np.where((rows.frame == INERTIAL)[:, None], np.nan, still)
    )  # of these is a path

    def total(joints, own):
        values = joint_values(own, gimbals, joints)
        return jnp.sum(jnp.where(own.frame == JOINTS, values, 1.0))

    joints = jnp.asarray(RNG.uniform(-1, 1, 4))
    value, slopes = jax.value_and_grad(total)(joints, moving)
    expected = jax.value_and_grad(total)(joints, rows)
    np.testing.assert_allclose(value, expected[0])
    np.testing.assert_allclose(slopes, expected[1])
    assert np.any(slopes != 0)
