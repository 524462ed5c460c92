"""The joint map: masks where they are, the way through them, and outlines of fields on the sky."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario
from matplotlib.patches import Polygon
from reference import angle, boresights
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.plotting.joint_map import field_outlines

MASK = np.deg2rad([[150.0, -10.0], [190.0, -12.0], [170.0, 8.0]])
FIELD = np.deg2rad([14.0, 6.0])


@pytest.fixture(scope="module")
def plan():
    scene = make_scenario(2, 1)
    first, second = scene.spacecraft.terminals
    camera = replace(
        scene.spacecraft.instruments[0],
        boresight=np.array([0, 0.6, 0.8]),
        up=np.array([1.0, 0, 0]),
        field_of_view=FIELD,
    )
    terminals = (replace(first, mask=(MASK,), yaw_limit=np.pi), replace(second, field_of_view=FIELD))
    return jp.plan(
        replace(scene, spacecraft=replace(scene.spacecraft, terminals=terminals, instruments=(camera,))),
        progress=False,
    )


def test_the_map_has_each_terminals_way_and_its_masks_at_every_turn(plan):
    first, second = jp.plot.joint_map(plan)
    drawn = [np.asarray(patch.get_xy())[:-1] for patch in first.patches if type(patch) is Polygon]
    expected = [np.rad2deg(MASK) - [360, 0], np.rad2deg(MASK)]
    assert len(drawn) == 2
    for own, corners in zip(drawn, expected, strict=True):
        np.testing.assert_allclose(own, corners)
    assert not [patch for patch in second.patches if type(patch) is Polygon]
    assert {text.get_text() for text in first.texts} == {"mask 1"}
    for number, axes in enumerate((first, second)):
        way = axes.lines[0].get_xydata()
        for end, state in ((way[0], plan.scenario.start), (way[-1], plan.goal)):
            np.testing.assert_allclose(end, np.rad2deg(state.joints[[number, 2 + number]]), atol=1e-6)
        assert axes.get_title(loc="left") == f"terminal-{number + 1}"


def test_it_is_among_the_figures_where_there_are_masks_and_margins_name_them(plan):
    assert "joint_map" in dict(jp.plot.figures(plan))
    bare = replace(plan.scenario.spacecraft.terminals[0], mask=())
    craft = replace(plan.scenario.spacecraft, terminals=(bare, plan.scenario.spacecraft.terminals[1]))
    without = replace(plan, scenario=replace(plan.scenario, spacecraft=craft))
    assert "joint_map" not in dict(jp.plot.figures(without))
    assert "mask 1 of terminal-1" in {text.get_text() for text in jp.plot.margins(plan).texts}


def test_without_terminals_there_is_no_map(plan):
    craft = replace(plan.scenario.spacecraft, terminals=())
    with pytest.raises(ValueError, match="has no terminals"):
        jp.plot.joint_map(replace(plan, scenario=replace(plan.scenario, spacecraft=craft)))


def test_fields_are_drawn_at_start_and_goal_around_the_boresights(plan):
    state, craft = plan.scenario.start, plan.scenario.spacecraft
    seen = boresights(craft, Rotation.from_rotvec(state.rotation_vector).as_matrix(), state.joints)
    found = dict(field_outlines(plan.scenario, state.attitude, state.joints))
    assert sorted(found) == [1, 2]
    corner = np.arctan(np.hypot(*np.tan(FIELD / 2)))
    for number, line in found.items():
        np.testing.assert_allclose(line[0], line[-1], atol=1e-15)
        away = angle(line, seen[number])
        assert away.max() == pytest.approx(corner)
        assert away.min() == pytest.approx(FIELD[1] / 2)
        assert np.max(angle(line[1:], line[:-1])) <= np.max(FIELD) / 30  # else edges look bent beside a pole
    labels = [text.get_text() for text in jp.plot.sphere(plan).get_legend().get_texts()]
    assert "field of view" in labels
