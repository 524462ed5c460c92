"""The picture of a spacecraft: its lines and surfaces stand where the mounting says, by turns of scipy."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from builders import make_observer, make_plan, make_spacecraft
from drawn import assert_apart
from matplotlib import pyplot
from matplotlib.figure import Figure
from oblique import oblique_craft
from reference import angle, assert_each, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.plotting import mounting, spacecraft_parts, style
from jaxplan.plotting.spacecraft_parts import feet

DOME, LOOK, FIELD = mounting._REACH_RADIUS, mounting._BORESIGHT, mounting._FIELD_LENGTH


def frame_of(device) -> np.ndarray:
    """Boresight across the axis, left and axis as columns, of a terminal of any mounting or a drive."""
    axis, boresight = (
        (device.axis, device.boresight)
        if isinstance(device, jp.Drive)
        else (device.mounting.yaw_axis, device.mounting.boresight)
    )
    left = unit(np.cross(axis, boresight))
    return np.stack([np.cross(left, axis), left, axis], axis=1)


def boresights(craft, joints) -> np.ndarray:
    """Boresights in body axes, turned by scipy."""
    n, found = len(craft.terminals), []
    for i, terminal in enumerate(craft.terminals):
        frame = frame_of(terminal)
        found.append(frame @ Rotation.from_euler("ZY", [joints[i], -joints[n + i]]).apply([1.0, 0, 0]))
    for drive, turn in zip(craft.drives, joints[2 * n :], strict=True):
        found.append(Rotation.from_rotvec(turn * np.asarray(drive.axis)).apply(drive.boresight))
    return np.array([*found, *(one.boresight for one in craft.instruments)])


def lines(axes, colour: str) -> list[np.ndarray]:
    """The lines (k, 3) of a colour."""
    return [np.array(line.get_data_3d()).T for line in axes.lines if line.get_color() == colour]


def legend(axes) -> mpl.legend.Legend | None:
    """The legend of the page."""
    return next((own for one in axes.figure.axes if (own := one.get_legend()) is not None), None)


def picture_of(craft, joints=None) -> mounting._Picture:
    axes, _ = mounting._make_3d_axes(Figure())
    given = np.zeros(craft.joint_count) if joints is None else joints
    picture = mounting._Picture(craft, axes, given, turned=joints is not None)
    picture.draw()
    return picture


def surfaces(picture, colour: str) -> np.ndarray:
    """Middles (k, 3) of the surfaces of a colour."""
    wanted = mpl.colors.to_rgb(colour)
    found = zip(picture.surfaces, picture.colours, strict=True)
    return np.array([np.mean(patch, axis=0) for patch, own in found if own[:3] == wanted])


def masked_craft() -> jp.Spacecraft:
    """A terminal on an oblique face, its range more than a turn, with a mask met after each."""
    craft = make_observer()
    mask = np.deg2rad([[150, 0], [210, 0], [200, 40], [160, 40]])
    return replace(craft, terminals=(replace(craft.terminals[0], mask=(mask,)),))


@pytest.mark.parametrize(
    "craft", [make_observer(), oblique_craft(4, 2, 2), oblique_craft(0, 3), oblique_craft(5, 2, 1)]
)
def test_boresights_are_drawn_from_feet_to_where_they_look(craft):
    joints = np.mean(craft.joint_ranges, axis=1) + 0.1
    axes = jp.plot.spacecraft(craft, joints=joints)
    at_zero, there = boresights(craft, np.zeros_like(joints)), boresights(craft, joints)
    for number, foot in enumerate(mounting._HALF_EDGE * feet(craft)):
        own = [line for line in lines(axes, style.device_style(number)["color"]) if len(line) == 2]
        ends = [line[1] - line[0] for line in own if np.allclose(line[0], foot)]
        for wanted in (at_zero, there) if number < craft.gimbals.count else (at_zero,):
            assert any(np.allclose(end, LOOK * wanted[number], atol=1e-12) for end in ends)


@pytest.mark.parametrize("craft", [make_observer(), masked_craft(), oblique_craft(1, 1, seed=3)])
def test_what_a_device_reaches_is_drawn_where_its_ranges_and_masks_let_it(craft):
    picture = picture_of(craft)
    (terminal,), frame = craft.terminals, frame_of(craft.terminals[0])
    foot = mounting._HALF_EDGE * feet(craft)[0]
    low, high = terminal.ranges[:, 0], terminal.ranges[:, 1]
    for colour, masked in ((style.device_style(0)["color"], False), (style.KEEP_OUT, True)):
        middles = surfaces(picture, colour)
        assert bool(len(middles)) == (bool(terminal.mask) or not masked)
        if not len(middles):
            continue
        own = (middles - foot) @ frame / DOME
        assert_each(np.linalg.norm(own, axis=1), ">", 0.99)
        yaw, pitch = np.arctan2(own[:, 1], own[:, 0]), np.arcsin(own[:, 2] / np.linalg.norm(own, axis=1))
        assert_each(pitch, ">", low[1] - 1e-3)
        assert_each(pitch, "<", high[1] + 1e-3)
        turned = yaw[:, None] + 2 * np.pi * np.arange(-2, 3)
        assert np.all(np.any((turned >= low[0] - 1e-9) & (turned <= high[0] + 1e-9), axis=1))
        if terminal.mask:  # of the trapezoid, a cell's width aside
            across = np.deg2rad(30 - 10 * np.rad2deg(pitch) / 40) - np.abs(np.abs(yaw) - np.pi)
            inside = np.minimum(across, np.minimum(pitch, np.deg2rad(40) - pitch))
            assert np.all(inside > -np.deg2rad(0.2)) if masked else np.all(inside < np.deg2rad(0.2))


def test_all_of_a_range_is_drawn():
    craft = replace(make_observer(), drives=(), instruments=())
    terminal = replace(craft.terminals[0], yaw_range=np.deg2rad([-40.0, 75.0]))
    cells = picture_of(replace(craft, terminals=(terminal,))).surfaces[6:]  # after the faces of the platform
    areas = [np.linalg.norm(np.cross(a - c, b - d)) / 2 for a, b, c, d in cells]
    low, high = np.deg2rad([-5.0, 85.0])
    expected = DOME**2 * np.deg2rad(115.0) * (np.sin(high) - np.sin(low))
    np.testing.assert_allclose(np.sum(areas), expected, rtol=3e-3)


def test_a_drive_turns_its_fan_about_its_axis():
    craft = make_observer()
    (drive,), foot = craft.drives, mounting._HALF_EDGE * feet(craft)[1]
    arcs = [
        line for line in lines(jp.plot.spacecraft(craft), style.device_style(1)["color"]) if len(line) > 3
    ]
    (arc,) = (line - foot for line in arcs)
    np.testing.assert_allclose(angle(arc, drive.axis), angle(drive.boresight, drive.axis), atol=1e-9)
    for end, turn in zip(arc[[0, -1]], drive.range, strict=True):
        np.testing.assert_allclose(
            end / DOME, Rotation.from_rotvec(turn * drive.axis).apply(drive.boresight), atol=1e-12
        )


def test_a_field_of_view_is_a_pyramid_of_its_angles_about_the_boresight():
    rng = np.random.default_rng(4)
    frame = Rotation.random(rng=rng).as_matrix()
    full = np.deg2rad([40.0, 24.0])
    look = jp.Instrument(name="camera", boresight=frame[:, 0], up=frame[:, 2], field_of_view=full)
    beam = replace(make_observer().terminals[0], up=unit([0, 0.6, 0.8]), field_of_view=full)
    craft = replace(make_observer(), terminals=(beam,), drives=(), instruments=(look,))
    joints = np.deg2rad([110.0, 33.0])
    picture = picture_of(craft, joints)
    turned = frame_of(beam) @ Rotation.from_euler("ZY", joints * [1, -1]).as_matrix()
    roll = Rotation.from_rotvec(np.arctan2(-0.6, 0.8) * np.array([1.0, 0, 0])).as_matrix()
    for number, (name, axes) in enumerate({"antenna": turned @ roll, "camera": frame}.items()):
        foot = mounting._HALF_EDGE * feet(craft)[craft.device_names.index(name)]
        colour = style.device_style(number)["color"]
        around = [line for line in lines(picture.axes, colour) if len(line) == 5]
        own = [(line - foot) @ axes for line in around if np.allclose((line - foot) @ axes[:, 0], FIELD)]
        assert len(own) == 1
        tangents = np.abs(own[0][:, 1:] / own[0][:, :1])
        np.testing.assert_allclose(tangents, np.tile(np.tan(full / 2), (5, 1)), atol=1e-9)


def test_the_legend_tells_ranges_fields_and_what_lines_are():
    craft = masked_craft()
    told = [text.get_text() for text in legend(jp.plot.spacecraft(craft)).get_texts()]
    assert told[0] == "antenna\n  yaw \N{MINUS SIGN}150 to 290 deg\n  pitch \N{MINUS SIGN}5 to 85 deg"
    assert told[1] == "array\n  angle \N{MINUS SIGN}120 to 200 deg"
    assert told[2:5] == ["telescope", "tracker-1", "tracker-2"]
    assert {"mask, cut out of it", "boresight at zero angles"} < set(told)
    assert "boresight at the given angles" not in told
    joints = np.zeros(craft.joint_count)
    told = [text.get_text() for text in legend(jp.plot.spacecraft(craft, joints)).get_texts()]
    assert "boresight at the given angles" in told
    plain = [text.get_text() for text in legend(jp.plot.spacecraft(make_spacecraft())).get_texts()]
    assert not {"mask, cut out of it", "field of view,\nwith an arrow to its up"} & set(plain)
    names = [text.get_text() for text in jp.plot.spacecraft(craft).texts]
    assert names == ["x", "y", "z", *craft.device_names]


def _wheels(*axes):
    return tuple(
        jp.Wheel(name=f"wheel-{k}", axis=unit(axis), torque=0.2, momentum=4.0) for k, axis in enumerate(axes)
    )


def test_each_wheel_is_a_ring_across_its_axis_with_an_arrow_along_it_and_its_name():
    wheels = _wheels([1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1])
    craft = replace(make_observer(), inertia=80.0 * np.eye(3), wheels=wheels)
    axes = jp.plot.spacecraft(craft)
    own = lines(axes, spacecraft_parts.COLOUR)
    rings = [line for line in own if len(line) > 9]
    assert len(rings) == len(wheels)
    for wheel, ring in zip(wheels, rings, strict=True):
        middle = np.mean(ring[:-1], axis=0)
        np.testing.assert_allclose((ring - middle) @ wheel.axis, 0, atol=1e-12)
        assert_each(np.max(np.abs(ring)), "<", mounting._HALF_EDGE)  # it is in the platform
        (arrow,) = [line for line in own if len(line) == 2 and np.allclose(line[0], middle)]
        np.testing.assert_allclose(unit(arrow[1] - arrow[0]), wheel.axis, atol=1e-12)
    assert [text.get_text() for text in axes.texts][-4:] == [wheel.name for wheel in wheels]
    told = [text.get_text() for text in legend(axes).get_texts()]
    assert "4 reaction wheels,\narrow along the axis;\neach 0.2 N m, 4 N m s" in told
    assert {len(corners) for corners in picture_of(craft).surfaces} == {4}
    other = replace(craft, wheels=(replace(wheels[0], torque=0.1), *wheels[1:]))
    told = [text.get_text() for text in legend(jp.plot.spacecraft(other)).get_texts()]
    assert "4 reaction wheels,\narrow along the axis" in told


def test_wheels_about_one_axis_stand_apart():
    axes = [*np.eye(3), *-np.eye(3), *np.eye(3), [1, 1, 1], [0, 0, 1]]
    middles = np.array(spacecraft_parts.hubs(_wheels(*axes)))
    apart = np.linalg.norm(middles[:, None] - middles, axis=-1) + 9 * np.eye(len(middles))
    assert np.min(apart) > 0.19
    assert_each(np.abs(middles), "<", mounting._HALF_EDGE - 0.05)


@pytest.mark.parametrize("wheels", [(), ([1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1])])
def test_names_of_devices_and_wheels_do_not_lie_over_each_other(wheels):
    sight = jp.Instrument(
        name="telescope", boresight=np.array([0.0, 0.0, 1.0])
    )  # along the z axis and its name
    for craft in (make_observer(), replace(make_observer(), instruments=(sight,), drives=(), terminals=())):
        craft = replace(craft, inertia=80.0 * np.eye(3), wheels=_wheels(*wheels))
        figure = Figure(figsize=mounting.SIZE, layout="constrained")
        axes = jp.plot.spacecraft(craft, ax=figure)
        assert_apart(figure, axes.texts, 4)


def test_feet_are_on_the_platform_apart_and_on_the_sides_to_which_devices_look():
    for craft in (make_observer(), make_spacecraft(4, 2), oblique_craft(3, 2, 3)):
        stand = feet(craft)
        np.testing.assert_allclose(np.max(np.abs(stand), axis=1), 1.0)
        apart = np.linalg.norm(stand[:, None] - stand, axis=-1) + 9 * np.eye(len(stand))
        assert np.min(apart) > 0.3
    craft = make_observer()
    stand = feet(craft)
    assert np.argmax(np.abs(stand[0])) == 2  # its range is about the yaw axis, which is most along z
    np.testing.assert_allclose(unit(stand[2]), [0, 0, 1])  # the telescope
    twins = replace(craft.drives[0], range=np.array([-np.pi, np.pi]), boresight=np.array([0.0, 0, 1]))
    pair = replace(craft, terminals=(), instruments=(), drives=(twins, replace(twins, name="other")))
    np.testing.assert_allclose(feet(pair), [[0, 1, 0], [0, -1, 0]], atol=1e-12)


def test_the_picture_has_equal_scales_and_holds_all_that_is_drawn():
    rng = np.random.default_rng(2)
    for craft in (make_observer(), make_spacecraft(0, 0), oblique_craft(5, 2, 1)):
        axes = jp.plot.spacecraft(craft, rng.uniform(*craft.joint_ranges.T))
        spans = [np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())]
        np.testing.assert_allclose(spans, spans[0])
        axes.figure.draw_without_rendering()
        points = np.concatenate([np.array(line.get_data_3d()).T for line in axes.lines])
        across, up, _ = mounting.proj_transform(*points.T, axes.get_proj())
        seen = axes.transData.transform(np.stack([across, up], axis=1))
        box = axes.get_window_extent()
        assert_each(seen, ">", np.array([box.x0, box.y0]))
        assert_each(seen, "<", np.array([box.x1, box.y1]))
        if craft.devices:
            assert legend(axes).get_window_extent().x1 <= axes.figure.bbox.x1


def test_wrong_arguments_are_told_and_nothing_stays_open():
    craft, before = make_observer(), dict(mpl.rcParams)
    with pytest.raises(TypeError, match=r"ax.*projection='3d'"):
        jp.plot.spacecraft(craft, ax=Figure().subplots())
    with pytest.raises(TypeError, match=r"scenario\.spacecraft is one"):
        jp.plot.spacecraft(make_plan())
    with pytest.raises(ValueError, match="joints"):
        jp.plot.spacecraft(craft, joints=[0.0, 0.0])
    given = Figure().add_subplot(projection="3d")
    assert jp.plot.spacecraft(craft, ax=given, legend=False) is given
    assert legend(given) is None
    named = replace(craft, drives=(replace(craft.drives[0], name="$a^2$"),))
    assert "$a^2$" in [text.get_text() for text in jp.plot.spacecraft(named).texts]
    assert pyplot.get_fignums() == []
    assert dict(mpl.rcParams) == before
