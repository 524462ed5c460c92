"""Motions that track: nodes come closer where what lies between them would break what they keep."""

import numpy as np
import pytest
from passing import LOW, Aim, deg, observer
from reference import angle, attitudes_of, unit

import jaxplan as jp
from jaxplan.model.tabulation import tabulate
from jaxplan.timeline.least_motion import Wanted
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.timeline.tracking import Tracked, finer, track

START, END, TOLERANCE = 200.0, 500.0, 1e-4
FIRST = 13  # nodes, of a target that stands still
DOWN = LOW.frame(START) @ np.diag([1.0, -1, -1])
CRAFT = observer()
STAR, SIGHT = (DOWN @ one.boresight for one in CRAFT.instruments)
OVER = unit(np.cross(SIGHT, STAR) + 0.2 * STAR)
OVER = unit(OVER - SIGHT * (SIGHT @ OVER))


def passing(rate: float):
    """A direction that passes at a rate, rad/s, through where the camera looks, between two of the nodes."""

    def at(time):
        far = rate * (np.asarray(time) - 337.0)
        return np.cos(far)[:, None] * SIGHT + np.sin(far)[:, None] * OVER

    return at


def tracked(rate: float, half: float, guess: np.ndarray = DOWN[None], start: float = START) -> Tracked:
    """The telescope on a star while a zone about what passes binds the camera."""
    zone = jp.KeepOut(
        name="passer", direction=Aim(passing(rate)).path(700.0), half_angle=half, devices=("camera",)
    )
    pursuit = Pursuit.of(CRAFT, tabulate((zone,), (), CRAFT), jp.Targets.of({"telescope": STAR}))
    wanted = Wanted(attitude=DOWN, joints=np.zeros(3), slew_time=30.0)
    found = track(pursuit, wanted, (), guess, start, END, TOLERANCE)
    assert found.nodes.times[0] == start
    closer = finer(pursuit, wanted, (), found, TOLERANCE)
    assert len(closer.nodes.times) == 2 * len(found.nodes.times) - 1
    return found


@pytest.mark.parametrize(("rate", "half"), [(1.5, 10.0), (1.0, 8.0), (1.0, 6.0)])
def test_what_passes_from_node_to_node_is_kept_by_nodes_that_are_closer(rate, half):
    rate, half = deg(rate, half)
    found = tracked(rate, half)
    assert len(found.nodes.times) > FIRST
    time = np.arange(0.0, END - START, 0.2)
    attitudes = attitudes_of(found.trajectory, time)
    camera, telescope = (attitudes @ CRAFT.instruments[number].boresight for number in (1, 0))
    assert np.min(angle(camera, passing(rate)(START + time))) > half - 1e-9
    assert np.max(angle(telescope, STAR)) < TOLERANCE
    assert found.depth == (0.0, 0.0)


def test_an_earlier_answer_has_no_fewer_nodes_when_it_begins_later():
    first = tracked(*deg(1.5, 10))
    again = tracked(*deg(1.5, 10), guess=first.nodes.attitudes, start=START + 3)
    assert len(again.nodes.times) >= len(first.nodes.times) > FIRST
    assert again.depth == (0.0, 0.0)


def test_nodes_are_not_closer_where_nothing_lies_between_or_nothing_helps():
    assert len(tracked(*deg(0.01, 2)).nodes.times) == FIRST
    stuck = tracked(*deg(2, 20))  # the zone passes over the star, so that the camera cannot give way
    assert max(stuck.depth) > deg(1)
