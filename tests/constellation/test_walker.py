"""Walker shells against closed forms, and the default links between their satellites."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.constellation import default_topologies

R, MU = 6378.137, 398600.4418
# of several sizes, patterns and phasings; the last numbers of planes and slots have no common divisor
SHELLS = [
    jp.walker("53:1584/72/39", 550.0, epoch_angle=0.3),
    jp.walker("86.4:66/6/2", 781.0, pattern="star"),
    jp.walker("30:36/6/3", 2000.0),
    jp.walker("97.6:35/5/4", 3000.0, epoch_angle=-2.0),
]
IDS = [shell.notation for shell in SHELLS]


@pytest.mark.parametrize("shell", SHELLS, ids=IDS)
def test_satellites_are_back_after_a_period_of_keplers_third_law(shell):
    period = 2 * np.pi * np.sqrt((R + shell.altitude) ** 3 / MU)
    assert shell.period == pytest.approx(period, rel=1e-14)
    np.testing.assert_allclose(shell.positions(period), shell.positions(), atol=1e-7)
    speed = np.linalg.norm(shell.velocities(17.0), axis=-1)
    np.testing.assert_allclose(speed, np.sqrt(MU / (R + shell.altitude)), rtol=1e-13)


@pytest.mark.parametrize("shell", SHELLS, ids=IDS)
def test_planes_and_slots_are_spaced_as_walker_says(shell):
    # the elements, recovered from position and velocity
    position, velocity = shell.states(0.0)
    normal = np.cross(position, velocity)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    np.testing.assert_allclose(np.arccos(normal[:, 2]), shell.inclination, atol=1e-12)
    node = np.stack([-normal[:, 1], normal[:, 0], np.zeros(shell.total)], axis=-1) / np.sin(shell.inclination)
    along = np.sum(np.cross(normal, node) * position, axis=-1)
    latitude = np.arctan2(along, np.sum(node * position, axis=-1))
    planes, slots = np.divmod(np.arange(shell.total), shell.total // shell.planes)
    spread = 360.0 if shell.pattern == "delta" else 180.0
    expected_node = np.deg2rad(spread * planes / shell.planes)
    phase = 360.0 * slots * shell.planes / shell.total + planes * shell.phasing * 360.0 / shell.total
    for found, expected in (
        (np.arctan2(node[:, 1], node[:, 0]), expected_node),
        (latitude, shell.epoch_angle + np.deg2rad(phase)),
    ):
        off = np.exp(1j * (found - expected)) - 1
        np.testing.assert_allclose(np.abs(off), 0, atol=1e-12)


@pytest.mark.parametrize("shell", SHELLS, ids=IDS)
def test_neighbours_in_a_plane_are_a_chord_apart(shell):
    chord = 2 * (R + shell.altitude) * np.sin(np.pi * shell.planes / shell.total)
    for step in (1, -1):
        between = shell.positions(99.0)[shell.neighbours(0, step)] - shell.positions(99.0)
        np.testing.assert_allclose(np.linalg.norm(between, axis=-1), chord, rtol=1e-12)


@pytest.mark.parametrize("shell", [SHELLS[0], SHELLS[2], SHELLS[3]], ids=[IDS[0], IDS[2], IDS[3]])
def test_a_delta_turned_by_one_plane_is_itself_some_time_earlier(shell):
    turn = Rotation.from_euler("z", 2 * np.pi / shell.planes)
    later = shell.positions(shell.phasing / shell.total * shell.period)
    np.testing.assert_allclose(turn.apply(later), shell.positions()[shell.neighbours(1, 0)], atol=1e-7)


@pytest.mark.parametrize("shell", SHELLS, ids=IDS)
def test_steps_and_their_opposites_cancel(shell):
    numbers = np.arange(shell.total)
    for plane_step, slot_step in ((0, 1), (1, 0), (1, -2), (-1, 1), (shell.planes - 1, 3)):
        found = shell.neighbours(plane_step, slot_step)
        there = found >= 0
        assert np.all(there) or shell.pattern == "star"
        back = shell.neighbours(-plane_step, -slot_step)[found[there]]
        np.testing.assert_array_equal(back, numbers[there])
        assert len(set(found[there])) == np.sum(there)


def test_a_star_has_nobody_beyond_its_outer_planes():
    star = SHELLS[1]
    np.testing.assert_array_equal(star.neighbours(1, 0) < 0, star.plane == 5)
    np.testing.assert_array_equal(star.neighbours(-1, 4) < 0, star.plane == 0)


@pytest.mark.parametrize("shell", SHELLS, ids=IDS)
def test_the_nearest_slots_of_the_next_plane_are_those_of_least_mean_square_distance(shell):
    times = np.arange(8) / 8 * shell.period
    inner = np.flatnonzero(shell.plane == 0)[:1]
    squares = []
    for step in range(shell.slots):
        other = shell.neighbours(1, step)[inner]
        apart = [shell.positions(time)[inner] - shell.positions(time)[other] for time in times]
        squares.append(np.mean(np.square(apart)))
    order = np.argsort(np.round(squares, 3), kind="stable")[:2]
    found = shell.nearest_slot_steps() % shell.slots
    np.testing.assert_allclose(np.array(squares)[found], np.array(squares)[order], rtol=1e-9)


@pytest.mark.parametrize(
    ("notation", "altitude", "options", "words"),
    [
        ("53:1584-72-39", 550.0, {}, ["i:T/P/F"]),
        (53, 550.0, {}, ["i:T/P/F"]),
        ("181:10/3/3", 550.0, {}, ["i must", "P must divide T = 10", "F must lie in"]),
        ("5.3.1:0/1/0", 550.0, {}, ["i must", "T must lie"]),
        ("53:10/0/0", 550.0, {}, ["P must"]),
        ("53:10/5/1", -1.0, {"pattern": "rose"}, ["altitude = -1.0", "pattern = 'rose'"]),
        ("53:10/5/1", np.nan, {"epoch_angle": np.nan}, ["altitude = nan", "epoch_angle = nan"]),
        ("53:10/5/1", 550e3, {}, ["altitude = 550000.0: must be a number of km in (0, 150000]"]),
        ("53:10/5/1", True, {}, ["altitude = True"]),
    ],
)
def test_a_shell_that_cannot_be_is_refused(notation, altitude, options, words):
    with pytest.raises(jp.ScenarioError) as raised:
        jp.walker(notation, altitude, **options)
    assert len(raised.value.faults) == len(words)
    for word in words:
        assert word in str(raised.value)


# the links


@pytest.mark.parametrize(("shell", "terminals"), [(SHELLS[0], 3), (SHELLS[2], 3), (SHELLS[3], 4)])
def test_links_are_mutual_and_the_cross_links_change(shell, terminals):
    before, after = default_topologies(shell, terminals)
    for topology in (before, after):
        pairs = {(number, int(other)) for number, row in enumerate(topology) for other in row}
        assert pairs == {(other, number) for number, other in pairs}
        assert len(pairs) == terminals * shell.total
    np.testing.assert_array_equal(before[:, :2], after[:, :2])
    np.testing.assert_array_equal(before[:, 0], shell.neighbours(0, 1))
    assert np.all(before[:, 2:] != after[:, 2:])


def test_cross_links_go_to_the_planes_beside():
    shell = SHELLS[0]
    before, after = (topology[:, 2] for topology in default_topologies(shell, 3))
    planes = shell.plane
    step = np.where(planes % 2 == 0, 1, -1)
    np.testing.assert_array_equal(shell.plane[before], (planes + step) % 72)
    np.testing.assert_array_equal(shell.plane[after], (planes - step) % 72)


def test_the_outer_planes_of_a_star_keep_their_links():
    star = SHELLS[1]
    before, after = default_topologies(star, 3)
    outer = (star.plane == 0) | (star.plane == 5)
    np.testing.assert_array_equal(before[:, 2] == after[:, 2], outer)
