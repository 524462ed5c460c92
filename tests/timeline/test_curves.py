"""Curves through nodes, ends bent to accelerations, and parts joined, by differences of numpy's own."""

from functools import cache

import numpy as np
import pytest
from reference import FIRST, SECOND, attitudes_of, joints_of
from scipy.spatial.transform import Rotation

from jaxplan import so3
from jaxplan.timeline import curves
from jaxplan.timeline.least_energy import Nodes
from jaxplan.trajectory import Trajectory


def tumbling(time, turns=3.0):
    """Attitudes (k, 3, 3) of a motion of several turns about an axis that sways, and joints (k, 2)."""
    share = np.asarray(time) / 100.0
    sway = Rotation.from_euler("xy", np.stack([0.4 * np.sin(3 * share), 0.3 * np.cos(2 * share)], axis=-1))
    turn = Rotation.from_rotvec((2 * np.pi * turns * (share + 0.1 * share**2))[:, None] * [0.6, 0.0, 0.8])
    joints = np.stack([np.sin(4 * share), share**3 - share], axis=-1)
    return (sway * turn).as_matrix(), joints


@cache
def curve(turns=3.0, count=101) -> tuple[Nodes, Trajectory]:
    times = np.linspace(0.0, 100.0, count) + 7.0
    attitudes, joints = tumbling(times - 7.0, turns)
    nodes = Nodes(times=times, attitudes=attitudes, joints=joints)
    return nodes, curves.through(nodes)


def slew() -> Trajectory:
    """A slew of several pieces in a chart that turns, as the fit makes them."""
    rng = np.random.default_rng(5)
    turn = np.array([0.4, -0.7, 0.5])
    times = np.linspace(0.0, 20.0, 12)
    share = (times / 20.0)[:, None]
    bumps = share * (1 - share) * rng.normal(size=(1, 3)) * 0.2
    breaks, b = curves._legendre_spline(times, share * turn + bumps)
    joint_breaks, joints = curves._legendre_spline(times, share**2 * [0.5, -0.3])
    pieces = len(b)
    return Trajectory(
        breaks=breaks,
        chart_attitude=np.tile(Rotation.from_rotvec([0.3, 0.1, -0.9]).as_matrix(), (pieces, 1, 1)),
        chart_start=np.zeros(pieces),
        chart_rate=np.tile(turn / 20.0, (pieces, 1)),
        coefficients=b,
        joint_breaks=joint_breaks,
        joint_coefficients=joints,
        node_times=np.array([0.0, 20.0]),
        smoothness=2,
        method="global",
    )


def one_piece() -> Trajectory:
    """A slew of a single piece, from rest to rest."""
    rise = np.polynomial.Polynomial([0, 0, 0, 10.0, -15.0, 6.0])  # from 0 to 1, flat at both
    legendre = curves._POWERS_TO_LEGENDRE @ rise.coef
    turn = np.array([0.2, 0.5, -0.4])
    return Trajectory(
        breaks=np.array([0.0, 9.0]),
        chart_attitude=Rotation.from_rotvec([[0.1, -0.4, 0.2]]).as_matrix(),
        chart_start=np.zeros(1),
        chart_rate=(turn / 9.0)[None],
        coefficients=(legendre[:, None] * turn)[None],
        joint_breaks=np.array([0.0, 9.0]),
        joint_coefficients=(legendre[:, None] * [0.3, -0.2])[None],
        node_times=np.array([0.0, 9.0]),
        smoothness=2,
        method="global",
    )


def velocities(trajectory, time, piece, step=2e-2):
    """Angular velocity and acceleration (k, 3), body axes, by differences of attitudes on given pieces."""
    stencil = np.stack(
        [attitudes_of(trajectory, time + i * step, piece) for i in range(-8, 9)]
    )  # pieces go on beyond their ends

    def vee(m):
        return (
            np.stack(
                [m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]],
                axis=-1,
            )
            / 2
        )

    middle = np.swapaxes(stencil[8], -1, -2)
    first = np.tensordot(FIRST / step, stencil[4:13], 1)
    second = np.tensordot(SECOND / step**2, stencil[4:13], 1)
    return vee(middle @ first), vee(middle @ second)


def test_a_curve_passes_through_its_nodes():
    nodes, found = curve()
    time = nodes.times - nodes.times[0]
    off = Rotation.from_matrix(np.swapaxes(nodes.attitudes, 1, 2) @ attitudes_of(found, time)).magnitude()
    assert np.max(off) < 1e-12
    np.testing.assert_allclose(joints_of(found, time)[0], nodes.joints, rtol=0, atol=1e-13)
    assert found.duration == pytest.approx(100.0)


@pytest.mark.parametrize("turns", [0.5, 3.0, 3.13, 8.0])
def test_no_chart_is_left_after_more_than_a_radian(turns):
    _, found = curve(turns)
    seen = np.polynomial.legendre.legval(np.linspace(-1, 1, 9), np.moveaxis(found.coefficients, 1, 0))
    assert np.max(np.linalg.norm(seen, axis=1)) < 1.0 + 1e-6


def test_between_its_nodes_a_curve_is_near_the_motion_that_they_are_of():
    _, found = curve()
    time = np.linspace(0.0, 100.0, 1777)
    attitudes, joints = tumbling(time)
    off = Rotation.from_matrix(np.swapaxes(attitudes, 1, 2) @ attitudes_of(found, time)).magnitude()
    assert np.max(off) < 1e-6
    np.testing.assert_allclose(joints_of(found, time)[0], joints, rtol=0, atol=1e-9)


def test_a_curve_of_several_turns_has_two_continuous_derivatives_where_charts_end():
    _, found = curve()
    changed = np.any(np.diff(found.chart_attitude, axis=0) != 0, axis=(1, 2))
    inner = 1 + np.flatnonzero(changed)
    assert len(inner) >= 8  # three turns, and charts of a radian
    time = found.breaks[inner]
    for one, other in zip(
        (attitudes_of(found, time, inner - 1), *velocities(found, time, inner - 1)),
        (attitudes_of(found, time, inner), *velocities(found, time, inner)),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


def test_a_curve_has_two_continuous_derivatives_at_all_breaks():
    _, found = curve()
    inner = np.arange(1, len(found.breaks) - 1)
    time = found.breaks[inner]
    before, after = velocities(found, time, inner - 1), velocities(found, time, inner)
    np.testing.assert_allclose(before[0], after[0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(before[1], after[1], rtol=0, atol=1e-9)


def test_charts_end_before_they_have_turned_far():
    nodes, found = curve(count=401)
    steps = Rotation.from_matrix(np.swapaxes(nodes.attitudes[:-1], 1, 2) @ nodes.attitudes[1:]).magnitude()
    time = np.linspace(0.0, 100.0, 999)
    piece = np.clip(np.searchsorted(found.breaks, time, side="right") - 1, 0, len(found.breaks) - 2)
    turned = np.swapaxes(found.chart_attitude[piece], 1, 2) @ attitudes_of(found, time)
    # the last one has the nodes that are too few for one of their own
    assert np.max(Rotation.from_matrix(turned).magnitude()) < 1.0 + curves.FEWEST * np.max(steps)


def test_what_stands_still_does_so_to_the_last_bit():
    times = np.linspace(0.0, 50.0, curves.FEWEST)
    turn = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix()
    nodes = Nodes(times=times, attitudes=np.tile(turn, (8, 1, 1)), joints=np.tile([0.1, -0.7], (8, 1)))
    found = curves.through(nodes)
    at = found.sample(np.linspace(0.0, 50.0, 33))
    np.testing.assert_array_equal(at.joints, np.tile([0.1, -0.7], (33, 1)))
    for name in ("angular_velocity", "angular_acceleration", "joint_rates", "joint_accelerations"):
        np.testing.assert_array_equal(getattr(at, name), 0)


def test_a_curve_without_joints_is_made_as_well():
    nodes, _ = curve()
    found = curves.through(Nodes(times=nodes.times, attitudes=nodes.attitudes, joints=np.zeros((101, 0))))
    assert found.sample(3.0).joints.shape == (0,)


@pytest.mark.parametrize("made", [slew, one_piece], ids=["pieces", "one piece"])
def test_bent_ends_have_the_accelerations_that_are_asked_for_and_leave_the_rest(made):
    given = made()
    rng = np.random.default_rng(9)
    ends = [(0.01 * rng.normal(size=3), 0.01 * rng.normal(size=2)) for _ in range(2)]
    found = curves.bent(given, ends)
    pieces = len(given.breaks) - 2
    for (spin, joint), time, piece in zip(ends, (0.0, given.duration), (0, pieces), strict=True):
        now, was = (velocities(one, np.array([time]), np.array([piece])) for one in (found, given))
        np.testing.assert_allclose(now[1][0], spin, rtol=0, atol=1e-9)
        np.testing.assert_allclose(now[0], was[0], rtol=0, atol=1e-10)
        at = found.sample(time)
        np.testing.assert_allclose(at.angular_acceleration, spin, rtol=0, atol=1e-12)
        np.testing.assert_allclose(at.joint_accelerations, joint, rtol=0, atol=1e-12)
        before = given.sample(time)
        np.testing.assert_allclose(at.attitude, before.attitude, rtol=0, atol=1e-14)
        np.testing.assert_allclose(at.joints, before.joints, rtol=0, atol=1e-14)
        np.testing.assert_allclose(at.angular_velocity, before.angular_velocity, rtol=0, atol=1e-14)
        np.testing.assert_allclose(at.joint_rates, before.joint_rates, rtol=0, atol=1e-14)


@pytest.mark.parametrize("made", [slew, one_piece], ids=["pieces", "one piece"])
def test_ends_that_are_bent_on_shorter_pieces_change_rates_less(made):
    given, share = made(), 0.25
    ends = (np.array([0.01, -0.02, 0.03]), np.array([0.02, -0.01])), (np.full(3, -0.02), np.full(2, 0.01))
    whole, brief = curves.bent(given, ends), curves.bent(given, ends, share)
    time = np.linspace(0.0, given.duration, 20_001)
    was, far, near = (one.sample(time) for one in (given, whole, brief))
    spans = np.diff(given.joint_breaks)[[0, -1]]
    inner = (time > share * spans[0]) & (time < given.duration - share * spans[1])
    for name in ("attitude", "angular_velocity", "angular_acceleration", "joints", "joint_rates"):
        np.testing.assert_allclose(getattr(near, name)[inner], getattr(was, name)[inner], rtol=0, atol=1e-11)
    changes = [np.max(np.abs(one.joint_rates - was.joint_rates)) for one in (far, near)]
    assert 0 < changes[1] <= 1.001 * share * changes[0]
    most = max(0.0678 * np.max(np.abs(end[1])) * span for end, span in zip(ends, spans, strict=True))
    assert changes[1] <= share * most
    for (spin, joint), at in zip(ends, (0, -1), strict=True):
        np.testing.assert_allclose(near.angular_acceleration[at], spin, rtol=0, atol=1e-11)
        np.testing.assert_allclose(near.joint_accelerations[at], joint, rtol=0, atol=1e-11)


def test_bent_ends_move_nothing_on_the_inner_pieces():
    given = slew()
    found = curves.bent(given, [(np.full(3, 0.01), np.full(2, 0.01)), (np.full(3, -0.02), np.zeros(2))])
    np.testing.assert_array_equal(found.coefficients[1:-1], given.coefficients[1:-1])
    np.testing.assert_array_equal(found.joint_coefficients[1:-1], given.joint_coefficients[1:-1])
    inner = np.arange(1, len(found.breaks) - 1)
    time = found.breaks[inner]
    for one, other in zip(velocities(found, time, inner - 1), velocities(found, time, inner), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)


def test_a_joined_trajectory_equals_its_parts():
    _, first = curve()
    parts = [(0.0, first), (first.duration, slew()), (first.duration + 20.0, one_piece())]
    found = curves.joined(parts)
    assert found.duration == pytest.approx(first.duration + 29.0, abs=1e-12)
    for begin, part in parts:
        inner = np.linspace(0.01, part.duration - 0.01, 77)
        one, other = part.sample(inner), found.sample(begin + inner)
        for name in ("attitude", "joints", "angular_velocity", "joint_rates", "angular_acceleration"):
            np.testing.assert_allclose(getattr(other, name), getattr(one, name), rtol=0, atol=1e-11)


def test_the_charts_of_joined_parts_start_when_their_parts_do():
    parts = [(0.0, slew()), (20.0, slew())]
    found = curves.joined(parts)
    half = len(found.chart_start) // 2
    np.testing.assert_array_equal(found.chart_start[half:], 20.0)
    np.testing.assert_array_equal(found.node_times, [0.0, 20.0, 40.0])
    assert np.all(np.diff(found.breaks) > 0)
    off = so3.distance(found.sample(27.0).attitude, slew().sample(7.0).attitude)
    assert off < 1e-12
