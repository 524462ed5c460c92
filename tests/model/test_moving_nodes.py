"""Nodes that go along with the ends of a path, beside scipy."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxplan.model.path import leads_of

TURN, MOVE = np.array([0.36, -0.48, 0.8]), np.array([0.3, -0.2, 0.5])
START = Rotation.from_rotvec([0.4, 1.1, -0.3])


def straight(shares, turn=TURN, move=MOVE, start=START):
    return (start * Rotation.from_rotvec(np.outer(shares, turn))).as_matrix(), np.outer(shares, move)


def with_ends(nodes, first, last):
    moved = np.array(nodes)
    moved[0], moved[-1] = first, last
    return moved


@pytest.mark.parametrize("angle", [np.deg2rad(20.0), np.pi, np.deg2rad(200.0), np.deg2rad(350.0)])
def test_nodes_of_a_straight_path_stay_at_their_shares(angle):
    shares = np.array([0.0, 0.1, 0.3, 0.35, 0.8, 1.0])
    attitudes, joints = straight(shares, angle * TURN)
    leads = leads_of(attitudes, joints)
    again = leads.nodes(attitudes, joints)
    np.testing.assert_allclose(again[0], attitudes, atol=1e-14)
    np.testing.assert_allclose(again[1], joints, atol=1e-14)
    tilt, further = Rotation.from_rotvec([0.01, 0.02, -0.01]), np.array([0.02, 0.0, -0.03])
    expected = straight(shares, angle * TURN + 0.01, MOVE + further, tilt * START)
    moved = leads.nodes(
        with_ends(attitudes, expected[0][0], expected[0][-1]),
        with_ends(joints, expected[1][0], expected[1][-1]),
    )
    np.testing.assert_allclose(moved[0], expected[0], atol=1e-13)
    np.testing.assert_allclose(moved[1], expected[1], atol=1e-14)


def test_corners_and_what_is_between_them_stay():
    """A path of three straight motions, padded with its last node."""
    shares = np.linspace(0, 1, 4)
    pieces = [straight(shares)]
    for turn in ([0.5, 0.2, 0.1], [-0.3, 0.4, 0.6]):
        attitudes, joints = pieces[-1]
        ahead = straight(shares, np.array(turn), -MOVE, Rotation.from_matrix(attitudes[-1]))
        pieces.append((ahead[0], joints[-1] + ahead[1]))
    attitudes, joints = (
        np.concatenate([own[0] if n == 0 else own[0][1:] for n, own in enumerate(zip(part, strict=True))])
        for part in zip(*pieces, strict=True)
    )
    padded = [np.concatenate([own, own[-1:], own[-1:]]) for own in (attitudes, joints)]
    leads = leads_of(*padded, len(attitudes))
    np.testing.assert_array_equal(leads.first, [0, 0, 0, 3, 4, 5, 6, 6, 6, 9, 9, 9])
    np.testing.assert_array_equal(leads.second, [0, 3, 3, 3, 4, 5, 6, 9, 9, 9, 9, 9])
    np.testing.assert_allclose(leads.share[[1, 2, 7, 8]], [1 / 3, 2 / 3] * 2)
    end = Rotation.from_rotvec([0.01, 0.0, 0.0]).as_matrix() @ attitudes[-1]
    moved = np.array(padded[0])
    moved[9:] = end
    found = leads.nodes(moved, padded[1])[0]
    np.testing.assert_allclose(found[:7], attitudes[:7], atol=1e-14)
    np.testing.assert_allclose(found[9:], moved[9:], atol=1e-14)
    assert np.all(np.abs(found[7:9] - attitudes[7:9]).max(axis=(1, 2)) > 1e-3)


def test_nodes_that_do_not_move_have_finite_slopes():
    attitudes, joints = np.repeat(START.as_matrix()[None], 3, axis=0), np.zeros((3, 2))
    leads = leads_of(attitudes, joints)

    def total(ends):
        found = leads.nodes(*ends)
        return found[0].sum() + found[1].sum()

    assert all(np.all(np.isfinite(own)) for own in jax.grad(total)((attitudes, joints)))
