"""Fields of view, masks and clearances in files and in Python: what is read, written and refused."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario

import jaxplan as jp
from jaxplan.schema import ScenarioError, dump_scenario, parse_scenario

TEXT = """
schema_version = 1
name = "fields"
[spacecraft]
rate_limit_deg_s = 1.5
acceleration_limit_deg_s2 = 0.3
[[spacecraft.instrument]]
name = "telescope"
boresight = [0, 0, 1]
up = [1, 0, 0]
field_of_view_deg = [14.3, 10]
[[spacecraft.instrument]]
name = "tracker"
boresight = [0, 1, 0]
[[spacecraft.terminal]]
name = "antenna"
mount_deg = 0
yaw_limit_deg = 180
pitch_limit_deg = 80
rate_limit_deg_s = 4.0
acceleration_limit_deg_s2 = 1.0
field_of_view_deg = [6, 4]
mask_deg = [[[60, 0], [120, 0], [120, 30.5], [60, 30]]]
[start]
attitude = [0, 0, 0]
yaw_deg = [0]
pitch_deg = [0]
[goal]
targets = [[1, 0, 0]]
clearance_deg = 0.5
[[keep_out]]
name = "sun"
direction = [0.6, 0.8, 0]
outside = "field_of_view"
half_angle_deg = 5
devices = ["telescope"]
[[keep_in]]
name = "star"
direction = [0, 0, 1]
inside = "field_of_view"
half_angle_deg = 1
devices = ["telescope"]
"""
MASK = "[[60, 0], [120, 0], [120, 30.5], [60, 30]]"


def test_fields_and_masks_are_read_in_radians_and_written_back_as_they_were():
    scene = parse_scenario(TEXT)
    telescope, antenna = scene.spacecraft.instruments[0], scene.spacecraft.terminals[0]
    np.testing.assert_allclose(telescope.field_of_view, np.deg2rad([14.3, 10]), rtol=1e-15)
    np.testing.assert_array_equal(telescope.up, [1, 0, 0])
    assert antenna.up is None
    np.testing.assert_allclose(antenna.mask[0], np.deg2rad([[60, 0], [120, 0], [120, 30.5], [60, 30]]))
    assert (scene.keep_out[0].outside, scene.keep_in[0].inside) == ("field_of_view", "field_of_view")
    assert scene.goal.clearance == pytest.approx(np.deg2rad(0.5))
    written = dump_scenario(scene)
    (terminal,) = tomllib.loads(written)["spacecraft"]["terminal"]
    assert terminal["mask_deg"] == [[[60, 0], [120, 0], [120, 30.5], [60, 30]]]
    assert "field_of_view_deg = [14.3, 10.0]" in written
    assert parse_scenario(written) == scene


FAULTS = {
    (
        "[14.3, 10]",
        "[14.3, 180]",
    ): "spacecraft.instrument[0].field_of_view_deg[1] = 180: must lie in (0, 180)",
    ("[14.3, 10]", "[14.3]"): "field_of_view_deg = [14.3]: must be an array of 2 numbers, not 1",
    ("up = [1, 0, 0]\n", ""): "spacecraft.instrument[0].up: missing, must be a unit vector",
    ("field_of_view_deg = [14.3, 10]\n", ""): "instrument[0].field_of_view_deg: missing, must be 2 numbers",
    (
        "up = [1, 0, 0]",
        "up = [0.6, 0, 0.8]",
    ): "at right angles to the boresight, is 36.8699 deg from it",
    ("field_of_view_deg = [6, 4]", "field_of_view_deg = [6, 4]\nup = [0.6, 0.8, 0]"): (
        "spacecraft.terminal[0].up = [0.6, 0.8, 0.0]: must be at right angles to the boresight"
    ),
    (
        'outside = "field_of_view"',
        'outside = "field"',
    ): 'keep_out[0].outside = "field": must be "field_of_view"',
    ("half_angle_deg = 5", "half_angle_deg = 90"): "keep_out[0].half_angle_deg = 90.0: must be below 90",
    ("half_angle_deg = 5", "half_angle_deg = -1"): "keep_out[0].half_angle_deg = -1: must lie in (0, 180)",
    (
        "half_angle_deg = 1\n",
        "half_angle_deg = 5\n",
    ): "half_angle_deg = 5.0: must be below 5: telescope sees no",
    ('outside = "field_of_view"\nhalf_angle_deg = 5', "half_angle_deg = 0"): (
        "keep_out[0].half_angle_deg = 0: must lie in (0, 180)"
    ),
    ('5\ndevices = ["telescope"]', '5\ndevices = ["tracker"]'): (
        'keep_out[0].devices[0] = "tracker": has no field_of_view_deg, from which to count'
    ),
    ('5\ndevices = ["telescope"]', "5\nvector = [{ along = [1, 0, 0] }]"): (
        "keep_out[0].outside: is of fields of view, which vectors do not have"
    ),
    (
        MASK,
        "[[60, 0], [120, 0]]",
    ): "terminal[0].mask_deg[0] = [[60, 0], [120, 0]]: must have 3 corners or more",
    (
        MASK,
        "[[60, 0], [120, 0], [70, 5], [60, 30]]",
    ): "must be convex, it bends inward at corner [2]: cut it there",
    (MASK, "[[60, 0], [120, 30], [120, 0], [60, 30]]"): "must not cross itself",
    (MASK, "[[60, 0], [90, 0], [120, 0]]"): "must have an area",
    (MASK, "[[60, 0], [400, 0], [120, 30]]"): "mask_deg[0][1][0] = 400: must lie in [-360, 360]",
    (
        MASK,
        "[[60, 0, 1], [90, 0], [120, 20]]",
    ): "mask_deg[0][0] = [60, 0, 1]: must be an array of 2 numbers, not 3",
    (f"mask_deg = [{MASK}]", "mask_deg = [[60, 0], [120, 0], [120, 20]]"): (
        "each of 3 corners [yaw, pitch] or more; of one polygon too, within brackets of its own"
    ),
    (MASK, "7"): "mask_deg[0] = 7: must be an array of corners [yaw, pitch]",
    (f"mask_deg = [{MASK}]", "mask_deg = 7"): "mask_deg = 7: must be an array of polygons",
    ("clearance_deg = 0.5", "clearance_deg = 46"): "goal.clearance_deg = 46: must lie in [0, 45]",
}


@pytest.mark.parametrize("change", FAULTS)
def test_what_is_wrong_is_told_with_key_value_and_range(change):
    text = TEXT.replace(*change, 1)
    assert text != TEXT
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text)
    assert any(FAULTS[change] in fault for fault in caught.value.faults), caught.value.faults
    assert len(caught.value.faults) == 1 or "field_of_view_deg: missing" in FAULTS[change]


def test_an_up_that_is_slightly_off_will_do():
    scene = parse_scenario(TEXT.replace("up = [1, 0, 0]", "up = [1, 0, 0.0009]"))
    edges = scene.spacecraft.instruments[0].edges
    np.testing.assert_allclose(edges, parse_scenario(TEXT).spacecraft.instruments[0].edges, atol=1e-12)


def test_groups_with_too_many_fields_are_refused():
    zones = [
        f'[[keep_out]]\nname = "z{i}"\ndirection = [0, 0, 1]\noutside = "field_of_view"\nhalf_angle_deg = 5\n'
        'any_of = "g"\nentry = "e"\n'
        for i in range(2)
    ]
    text = TEXT + "\n".join(zones)
    with pytest.raises(
        ScenarioError, match="keeps 4 fields of view clear, which may hold in 625 ways, 64 at most"
    ):
        parse_scenario(text)


def test_python_may_give_lists_and_is_refused_alike():
    scene = make_scenario(1)
    terminal = replace(scene.spacecraft.terminals[0], mask=[[[-1.5, 0.1], [-1.2, 0.1], [-1.2, 0.2]]])
    plan = jp.plan(replace(scene, spacecraft=replace(scene.spacecraft, terminals=[terminal])), progress=False)
    assert plan.ok
    assert plan.scenario.spacecraft.terminals[0].mask[0].shape == (3, 2)
    bad = replace(terminal, mask=([[-1.5, 0.1], [-1.2, 0.1]],))
    with pytest.raises(ScenarioError, match=r"terminals\[0\].mask\[0\] = .*: must have 3 corners"):
        jp.plan(replace(scene, spacecraft=replace(scene.spacecraft, terminals=(bad,))))
