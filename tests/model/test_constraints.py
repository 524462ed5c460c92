"""Margins and bounds of every kind of pair, against plain numpy and dense sampling."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
from builders import gimbals_about_z
from kinds import pair_margins_of
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
    edge_bound,
    joint_values,
    margins_of_scores,
    room,
    score_curvature,
    scores,
    state_margins,
    thresholds,
    worst_constraint,
)
from jaxplan.model.directions import Sights

RNG = np.random.default_rng(5)
TERMINALS = 2


def craft_sights():
    """Two terminals, an instrument and an axis of the body, and two more vectors of the second terminal."""
    return Sights(
        gimbals=gimbals_about_z([0.3, -2.0]),
        fixed=random_units(RNG, 2),
        carrier=np.array([1, 1]),
        carried=random_units(RNG, 2),
    )


def every_kind():
    """A row of every kind that binds all sights it may, some of them in entries and groups."""
    own = craft_sights()
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


def margins_one_by_one(attitude, joints):
    """(Z, S) rad, each by itself."""
    craft = SimpleNamespace(gimbals=SIGHTS.gimbals, fixed_boresights=SIGHTS.fixed[:1])
    return pair_margins_of(craft, ROWS, attitude[None], joints[None])[0]


ROWS, SIGHTS = every_kind()


def random_joints():
    return np.concatenate([RNG.uniform(-3, 3, TERMINALS), RNG.uniform(-1.5, 1.5, TERMINALS)])


def test_margins_of_every_kind_are_those_of_rotations():
    for _ in range(20):
        attitude, joints = Rotation.random(rng=RNG).as_matrix(), random_joints()
        wanted = margins_one_by_one(attitude, joints)
        np.testing.assert_allclose(state_margins(ROWS, SIGHTS, attitude, joints), wanted, atol=1e-14)
    traced = jax.jit(state_margins)(ROWS, SIGHTS, attitude, joints)
    np.testing.assert_allclose(traced, wanted, atol=1e-14)


def test_scores_are_below_thresholds_just_where_margins_keep_the_clearance():
    for clearance in (0.0, 0.1, 3.0):
        attitude, joints = Rotation.random(rng=RNG).as_matrix(), random_joints()
        sights = SIGHTS.in_body(joints)
        axes = axes_in_body(ROWS, ROWS.axis @ attitude, sights)
        score = scores(ROWS, sights @ axes.T, joint_values(ROWS, SIGHTS.gimbals, joints))  # (S, Z)
        margin = np.where(ROWS.bound.T, margins_of_scores(ROWS, score), np.inf)
        np.testing.assert_allclose(margin.T, state_margins(ROWS, SIGHTS, attitude, joints), atol=1e-7)
        asked = np.minimum(clearance, room(ROWS))
        kept = score <= thresholds(ROWS, clearance)
        np.testing.assert_array_equal(kept[ROWS.bound.T], (margin >= asked)[ROWS.bound.T])


def test_bounds_over_a_motion_hold_between_its_ends_for_every_kind_of_pair():
    share = np.linspace(0, 1, 201)
    closest = np.full(ROWS.bound.shape[::-1], np.inf)
    for size in np.geomspace(0.01, 3, 150):
        attitude, turn = Rotation.random(rng=RNG), size * random_units(RNG) * RNG.uniform(0, 1)
        change = size * RNG.uniform(-1, 1, 2 * TERMINALS) * RNG.integers(0, 2, 2 * TERMINALS)
        joints = random_joints() + share[:, None] * change
        turned = (attitude * Rotation.from_rotvec(share[:, None] * turn)).as_matrix()
        sights = SIGHTS.in_body(joints)
        axes = axes_in_body(ROWS, ROWS.axis @ turned, sights)
        score = scores(ROWS, sights @ np.swapaxes(axes, 1, 2), joint_values(ROWS, SIGHTS.gimbals, joints))
        bend = score_curvature(ROWS, np.linalg.norm(turn), *SIGHTS.bounds(change))
        bound = edge_bound(score[0], score[-1], bend / 2)
        above = bound - score.max(axis=0)
        assert_each(above, ">=", -1e-12)
        second = np.abs(score[2:] - 2 * score[1:-1] + score[:-2]).max(axis=0) * 200**2
        assert_each(second, "<=", bend * (1 + 1e-6) + 1e-9)
        closest = np.minimum(closest, np.where(second > 1e-6, bend / np.maximum(second, 1e-9), np.inf))
    cones = ROWS.bound.T & (ROWS.frame != JOINTS)
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
        state_margins(ROWS, SIGHTS, np.full((3, 3), np.nan), random_joints())[0], -np.inf
    )


def test_edges_with_numbers_that_are_none_are_out_of_bounds():
    for place in range(3):
        numbers = np.array([0.1, 0.2, 0.3])
        numbers[place] = np.nan
        assert edge_bound(*numbers) == np.inf
