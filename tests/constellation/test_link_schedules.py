"""Schedules of links against the geometry of circular orbits, written anew here."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from reference import assert_each, unit

import jaxplan as jp
from jaxplan import sky
from jaxplan.constellation import relay_spacecraft
from jaxplan.constellation.links import CLEARANCE, Mesh

R, MU = 6378.137, 398600.4418
EPOCH = "2026-06-20T09:30:00"
FORE, AFT, RIGHT, LEFT = range(4)
SHELLS = [
    jp.walker("53:240/12/5", 1200.0, epoch_angle=0.2),
    jp.walker("86.4:120/6/2", 1000.0, pattern="star"),
    jp.walker("97.6:160/8/3", 1500.0),
]


@pytest.fixture(scope="module", params=SHELLS, ids=[shell.notation for shell in SHELLS])
def schedule(request):
    return jp.link_schedule(request.param, epoch=EPOCH, duration_s=3000.0, step_s=100.0)


def states(shell, time):
    """Positions, km, and orbit normals (T, 3) of a shell's satellites, by the elements that Walker gives."""
    plane, slot = np.divmod(np.arange(shell.total), shell.total // shell.planes)
    spread = np.pi if shell.pattern == "star" else 2 * np.pi
    node = spread * plane / shell.planes
    motion = np.sqrt(MU / (R + shell.altitude) ** 3)
    phase = 2 * np.pi * (slot * shell.planes + plane * shell.phasing) / shell.total
    u, i = shell.epoch_angle + phase + motion * time, shell.inclination
    along = np.stack([np.cos(node), np.sin(node), 0 * node], axis=-1)
    normal = np.stack([np.sin(i) * np.sin(node), -np.sin(i) * np.cos(node), np.cos(i) + 0 * node], axis=-1)
    across = np.cross(normal, along)
    return (R + shell.altitude) * (np.cos(u)[:, None] * along + np.sin(u)[:, None] * across), normal


def steps(schedule, every=5):
    """Start, end and links (T, n) of some steps."""
    ends = [*schedule.times[1:], schedule.until]
    return list(zip(schedule.times, ends, schedule.topology, strict=True))[::every]


def test_links_are_mutual_to_the_opposite_side(schedule):
    for own, other in ((FORE, AFT), (RIGHT, LEFT)):
        for side, back in ((own, other), (other, own)):
            step, satellite = np.nonzero(schedule.topology[:, :, side] >= 0)
            whom = schedule.topology[step, satellite, side]
            np.testing.assert_array_equal(schedule.topology[step, whom, back], satellite)
    assert np.sum(schedule.topology[:, :, RIGHT] >= 0) > 100


def test_links_ahead_are_in_the_plane_and_cross_links_in_the_planes_beside_on_their_side(schedule):
    shell = schedule.shell
    for start, _, links in steps(schedule):
        place, normal = states(shell, start)
        for side in (FORE, AFT):
            there = links[:, side] >= 0
            np.testing.assert_array_equal(shell.plane[links[there, side]], shell.plane[there])
        for side, sign in ((RIGHT, -1), (LEFT, 1)):
            (own,) = np.nonzero(links[:, side] >= 0)
            other = links[own, side]
            apart = np.abs(shell.plane[own] - shell.plane[other])
            assert set(apart) <= {1} if shell.pattern == "star" else set(apart) <= {1, shell.planes - 1}
            assert_each(sign * np.einsum("kc,kc->k", place[other] - place[own], normal[own]), ">", 0)


def test_cross_links_are_to_the_nearest_but_for_hysteresis_and_below_the_latitude(schedule):
    shell = schedule.shell
    highest = np.arcsin(np.sin(shell.inclination)) - np.deg2rad(5.0)
    for start, _, links in steps(schedule):
        place, _ = states(shell, start)
        far = np.linalg.norm(place[:, None] - place[None], axis=-1)
        low = np.abs(place[:, 2]) <= np.sin(highest) * (R + shell.altitude) + 1e-6
        for side in (RIGHT, LEFT):
            (own,) = np.nonzero(links[:, side] >= 0)
            other = links[own, side]
            assert np.all(low[own] & low[other])
            for one, whom in zip(own[::7], other[::7], strict=True):
                rivals = low & (shell.plane == shell.plane[whom])
                assert far[one, whom] <= np.min(far[one][rivals]) / (1 - 0.1) + 1e-6


def test_no_link_leads_through_a_cone_at_any_time_of_its_step(schedule):
    shell = schedule.shell
    limb = np.arcsin((R + 80.0) / (R + shell.altitude))
    assert schedule.cones["earth"] == pytest.approx(limb, abs=1e-12)
    for start, end, links in steps(schedule, 10):
        satellite, terminal = np.nonzero(links >= 0)
        other = links[satellite, terminal]
        for time in np.linspace(start, end, 12):
            place, _ = states(shell, time)
            way = unit(place[other] - place[satellite])
            sun = unit(sky.positions("sun", epoch=EPOCH, times=time) - place[satellite])
            for body, half in ((sun, np.deg2rad(10.0)), (-unit(place[satellite]), limb)):
                apart = np.arccos(np.clip(np.einsum("kc,kc->k", way, body), -1, 1))
                assert_each(apart, ">=", half + CLEARANCE / 2)


def test_links_out_for_the_sun_are_counted_and_others_stay():
    shell = SHELLS[0]
    known = {"epoch": EPOCH, "duration_s": 300.0, "step_s": 100.0}
    free = jp.link_schedule(shell, sun_half_angle=None, **known)
    wide = jp.link_schedule(shell, sun_half_angle=0.5, **known)
    lost = (free.topology >= 0) & (wide.topology < 0)
    assert np.sum(lost) > 0
    np.testing.assert_array_equal(wide.topology[~lost], free.topology[~lost])
    assert wide.outages["sun"] == 100.0 * np.sum(lost)
    assert set(free.outages) == {"earth"}


def test_hysteresis_keeps_a_link_until_another_is_nearer_by_its_share():
    shell = jp.walker("50:24/4/1", 8000.0)
    changes = []
    for share in (0.0, 0.3):
        mesh = Mesh(
            shell=shell, sides=("fore", "aft", "right", "left"), highest_latitude=1.5, hysteresis=share
        )
        found = np.stack([mesh.at(time) for time in np.arange(0, shell.period, 60.0)])
        both = (found[1:] >= 0) & (found[:-1] >= 0)
        changes.append(np.sum((found[1:] != found[:-1]) & both))
    assert changes[0] > changes[1]


def test_spans_are_the_times_between_changes(schedule):
    for satellite in (0, 17, 77):
        spans = schedule.spans(satellite)
        assert spans[0].start == 0
        assert spans[-1].end == schedule.until
        assert all(one.end == other.start for one, other in pairwise(spans))
        assert all(one.links != other.links for one, other in pairwise(spans))
        for step, time in enumerate(schedule.times):
            (own,) = (span for span in spans if span.start <= time < span.end)
            assert own.links == tuple(schedule.topology[step, satellite])
    total = sum(len(schedule.spans(number)) - 1 for number in range(schedule.shell.total))
    assert total == schedule.changes


def test_given_links_are_taken_as_an_array_or_as_a_function():
    shell = SHELLS[0]
    mesh = jp.link_schedule(shell, epoch=EPOCH, duration_s=600.0, step_s=200.0)
    known = {"epoch": EPOCH, "duration_s": 600.0, "step_s": 200.0}
    by_array = jp.link_schedule(shell, topology=(mesh.times, mesh.topology), **known)
    by_function = jp.link_schedule(shell, topology=lambda time: mesh.topology[int(time // 200)], **known)
    for given in (by_array, by_function):
        np.testing.assert_array_equal(given.topology, mesh.topology)
        assert given.outages == {"sun": 0.0, "earth": 0.0}


def test_two_planes_or_two_terminals_have_no_cross_links():
    known = {"epoch": EPOCH, "duration_s": 100.0}
    two = jp.link_schedule(jp.walker("53:40/2/1", 1200.0), **known)
    assert np.all(two.topology[:, :, 2:] < 0)
    craft = relay_spacecraft(4)
    pair = jp.Spacecraft(
        terminals=craft.terminals[:2],
        rate_limit=craft.rate_limit,
        acceleration_limit=craft.acceleration_limit,
    )
    assert jp.link_schedule(SHELLS[0], spacecraft=pair, **known).topology.shape[2] == 2


NONE = np.full((1, 240, 4), -1)


FIVE = replace(
    relay_spacecraft(4),
    terminals=(*relay_spacecraft(4).terminals, replace(relay_spacecraft(4).terminals[0], name="fifth")),
)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"duration_s": 0.0, "step_s": np.nan}, ["duration_s = 0.0", "step_s = nan", "[1, 86400]"]),
        ({"duration_s": 1e5}, ["duration_s = 100000.0", "[1, 86400]"]),
        (
            {"hysteresis": 1.0, "sun_half_angle": 0.0},
            ["hysteresis = 1.0: must be a number in [0, 0.9]", "sun_half_angle = 0.0"],
        ),
        ({"moon_half_angle": "wide"}, ["moon_half_angle = 'wide'"]),
        ({"highest_latitude": 50.0}, ["highest_latitude = 50.0", "rad"]),
        ({"sides": ("fore", "aft", "right")}, ["sides", "as many as terminals, 4"]),
        ({"sides": ("fore", "aft", "up", "left")}, ["sides", "names of fore, aft, right, left"]),
        ({"spacecraft": relay_spacecraft(3)}, ["3 terminals", "give sides"]),
        ({"spacecraft": relay_spacecraft(3), "sides": ("fore", "aft", "left")}, ["both or none"]),
        ({"spacecraft": FIVE}, ["has 5 terminals, and there are only 4 sides: give a topology"]),
        ({"spacecraft": FIVE, "sides": ("fore", "aft")}, ["only 4 sides: give a topology"]),
        ({"topology": NONE}, ["a pair (times, links)"]),
        ({"topology": ([0.0, 1.0], NONE)}, ["(1, 240, 4)", "(2, 240, 4)"]),
        ({"topology": ([1.0], NONE)}, ["times", "from 0"]),
        ({"topology": ([0.0, np.nan], NONE)}, ["times"]),
        ({"topology": ([0.0], NONE + 0.5)}, ["float64"]),
        ({"topology": ([0.0], NONE - 1)}, ["topology[0, 0, 0] = -2", "[-1, 239]"]),
        ({"topology": ([0.0], NONE + 1)}, ["topology[0, 0, 0] = 0", "itself"]),
        ({"topology": lambda time: [[0], [1, 2]]}, ["shape (0,)"]),
    ],
)
def test_a_schedule_that_cannot_be_is_refused_by_name(options, words):
    known = {"epoch": EPOCH, "duration_s": 60.0}
    with pytest.raises(jp.ScenarioError) as raised:
        jp.link_schedule(SHELLS[0], **known | options)
    for word in words:
        assert word in str(raised.value)


def test_what_is_no_shell_or_epoch_is_refused():
    with pytest.raises(TypeError, match=r"jp\.walker"):
        jp.link_schedule("53:240/12/5", epoch=EPOCH, duration_s=60.0)
    with pytest.raises(ValueError, match="epoch"):
        jp.link_schedule(SHELLS[0], epoch="noon", duration_s=60.0)
    with pytest.raises(jp.ScenarioError, match="80: must be below the shell's, 60 km"):
        jp.link_schedule(jp.walker("53:240/12/5", 60.0), epoch=EPOCH, duration_s=60.0)
    with pytest.raises(ValueError, match="terminals = 5"):
        relay_spacecraft(5)
