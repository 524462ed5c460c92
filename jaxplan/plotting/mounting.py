"""A spacecraft in space: how its devices are mounted, what they can reach, and where they look.

The platform is a cube, since nothing is known of its shape, and devices stand on the sides to which they
look, each at its foot. Around its foot a terminal is drawn with its yaw axis and the part of a sphere that
its ranges reach, with masks cut out; a drive with its axis and the fan in which its boresight turns; a field
of view as a pyramid. A reaction wheel is a ring in the cube, across its axis. Where all this is, is computed
in `jaxplan.plotting.spacecraft_parts`. Lengths mean nothing; directions are in body axes. An arrow on what a
joint reaches points to where its angle grows.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform
from numpy.typing import ArrayLike

from jaxplan.geometry.vectors import pointing
from jaxplan.model.devices import Drive, Instrument, Terminal
from jaxplan.model.gimbals import TURN
from jaxplan.model.outlines import FORWARD, UP, field_corners, turns
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.plotting import spacecraft_parts
from jaxplan.plotting.spacecraft_parts import (
    cells_of,
    feet,
    middles_of,
    once_around,
    outline_of,
    points_of,
    turn_by,
    within_masks,
)
from jaxplan.plotting.style import (
    AXIS_STYLES,
    GREY,
    HALO,
    KEEP_OUT,
    SMALL,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Labels,
    Look,
    device_style,
    legend_beside,
    new_figure,
    plain,
)
from jaxplan.runtime.arguments import expect, expect_numbers

SIZE = (WIDTH, 5.7)  # inches
_HALF_EDGE, _REACH_RADIUS, _AXIS_LENGTH, _BORESIGHT, _FIELD_LENGTH = 0.55, 0.38, 0.52, 0.62, 0.54
"""Lengths in the picture: half edge of the platform; from the foot of a device the radius of what it reaches,
its axis, its boresight, and its field of view."""
_FRAME_LENGTH = 1.3  # length of the body axes, from the middle of the platform
_EYE_ANGLES = (24.0, -52.0)  # deg, elevation and azimuth of the eye
_REACH_ALPHA, _MASK_ALPHA, _FACE_ALPHA = 0.20, 0.45, 0.10  # opacities: also of the platform's faces
_LEGEND_AXES_WIDTH = 0.01  # width of the empty axes that the legend stands beside, in widths of the picture
_MAX_LINES, _OTHER_LINES = 34, 12  # in a column of the legend; of these, for entries that are no devices
_FILLED_SHARE = 0.84  # fraction of the axes' width or height that the picture fills
_LETTER_SIZE = np.array([0.75, 1.8])  # width of a letter and height of a line, in units of the font size
_HEAD_LENGTH = 0.07  # length of an arrow's head, in the picture's units
_WHEEL_ENTRY: Look = {"color": spacecraft_parts.COLOUR, "markerfacecolor": to_rgba(*spacecraft_parts.FILL)}
_SQUARE_CORNERS = ((1, 1), (1, -1), (-1, -1), (-1, 1))  # corners of a square, in order around it


def spacecraft(
    spacecraft: Spacecraft, joints: ArrayLike | None = None, ax: Canvas = None, *, legend: bool = True
) -> Axes3D:
    """Draw a spacecraft in its body axes, so that a wrong mounting is seen.

    Args:
        spacecraft: whose devices and reaction wheels are drawn.
        joints: (2n + d,) rad, yaws then pitches of its n terminals, then angles of its d drives: fields of
            view are drawn there, and boresights there and at zero angles. None for zero angles alone.
        ax: 3-D axes, a figure to put them in, or None for a new one.
        legend: whether to say beside the picture what is drawn, with ranges unless there are too many
            devices.

    Returns:
        The 3-D axes, which the mouse turns in a window.

    Raises:
        TypeError: if it is no spacecraft, or the axes are flat.
        ValueError: if the number of joints is not 2n + d.

    Example:
        >>> jp.plot.spacecraft(scenario.spacecraft, joints=scenario.start.joints)
    """
    craft = expect("spacecraft", spacecraft, Spacecraft, "scenario.spacecraft is one")
    angles = np.zeros(craft.joint_count)
    if joints is not None:
        expect_numbers("joints", joints, craft.joint_count)
        angles = np.asarray(joints, float)
    axes, beside = _make_3d_axes(ax)
    picture = _Picture(craft, axes, angles, turned=joints is not None)
    picture.draw()
    if legend:
        entries = picture.entries()
        lines = sum(1 + text.count("\n") for _, text in entries)
        legend_beside(beside, entries, columns=-(-lines // _MAX_LINES))
    return axes


def spacecraft_figure(craft: Spacecraft, joints: ArrayLike) -> Figure:
    """Draw `spacecraft` in a new figure that does not belong to pyplot; arguments are as there."""
    figure = Figure(figsize=SIZE, layout="constrained")
    spacecraft(craft, joints, ax=figure)
    return figure


def _make_3d_axes(where: Canvas) -> tuple[Axes3D, Axes]:
    """Make or check the 3-D axes to draw on; returns them, and the axes that the legend stands beside.

    In a figure the latter are narrow axes of their own, since a layout does not know how wide 3-D axes are.
    """
    if where is None:
        where = new_figure(SIZE)
    if isinstance(where, Figure | SubFigure):
        columns = where.add_gridspec(1, 2, width_ratios=(1, _LEGEND_AXES_WIDTH))
        axes, beside = (
            where.add_subplot(columns[0], projection="3d", computed_zorder=False),
            where.add_subplot(columns[1]),
        )
        beside.set_axis_off()
    else:
        axes = expect("ax", where, Axes3D, "give axes with projection='3d', or a figure to put them in")
        beside = axes
    axes.view_init(*_EYE_ANGLES)
    axes.set_proj_type("ortho")
    axes.set_axis_off()
    return axes, beside


class _Picture:
    """Drawing of a spacecraft; its surfaces form one collection, so that near ones cover far ones.

    Args:
        craft: the spacecraft.
        axes: 3-D axes to draw on.
        joints: (J,) rad, angles of all joints.
        turned: whether boresights are drawn at these angles, besides zero angles.
    """

    def __init__(self, craft: Spacecraft, axes: Axes3D, joints: np.ndarray, *, turned: bool) -> None:
        self.craft, self.axes, self.turned = craft, axes, turned
        self.surfaces: list[np.ndarray] = []
        self.drawn: list[np.ndarray] = []  # points of lines
        self.colours: list[tuple[float, float, float, float]] = []
        azimuth, elevation = craft.gimbals.angles(joints)
        own = [turn_by(*pair) for pair in zip(azimuth, elevation, strict=True)]
        # rotations to the body from the moving part (boresight, left, up) of each gimbal
        self.moved = [frame @ turn for frame, turn in zip(craft.gimbals.frames, own, strict=True)]
        self.hubs = spacecraft_parts.hubs(craft.wheels)
        self.zero = craft.boresights(np.eye(3), np.zeros(craft.joint_count))
        self.now = craft.boresights(np.eye(3), joints)

    def draw(self) -> None:
        """Draw the platform, its axes, wheels and devices with their names, at equal scales of all axes."""
        self._draw_body()
        self._draw_wheels()
        for number, (device, foot) in enumerate(
            zip(self.craft.devices, _HALF_EDGE * feet(self.craft), strict=True)
        ):
            self._draw_device(number, device, foot)
        looks: Look = {"edgecolors": "none", "antialiaseds": False, "rasterized": True, "zorder": 1}
        self.axes.add_collection3d(Poly3DCollection(self.surfaces, facecolors=self.colours, **looks))
        self._fit_axes()
        self._write_names()

    def _draw_body(self) -> None:
        """Draw the platform as a cube, and the body axes as arrows with their names."""
        for axis, side in np.ndindex(3, 2):
            middle, first, second = np.roll(np.eye(3), -axis, axis=0) * _HALF_EDGE
            square = np.array([(2 * side - 1) * middle + i * first + j * second for i, j in _SQUARE_CORNERS])
            self._fill(square[None], "0.5", _FACE_ALPHA)
            self._add_line(square[[0, 1, 2, 3, 0]], {"color": "0.55", "linewidth": 0.8})
        for axis, look, name in zip(np.eye(3), AXIS_STYLES, "xyz", strict=True):
            self._add_arrow(np.array([_HALF_EDGE * axis, _FRAME_LENGTH * axis]), {**look, "linewidth": 1.4})
            self._write_text(1.06 * _FRAME_LENGTH * axis, name, look["color"], TEXT + 2)

    def _draw_wheels(self) -> None:
        """Draw each reaction wheel as a ring across its axis, with an arrow along the axis."""
        look: Look = {"color": spacecraft_parts.COLOUR, "linewidth": 1.3}
        for wheel, hub in zip(self.craft.wheels, self.hubs, strict=True):
            ring = spacecraft_parts.ring(wheel, hub)
            hubs = np.broadcast_to(hub, ring[2::2].shape)
            self._fill(
                np.stack([hubs, ring[:-2:2], ring[1:-1:2], ring[2::2]], axis=1), *spacecraft_parts.FILL
            )
            self._add_line(ring, look)
            self._add_arrow(_segment(hub, spacecraft_parts.SPIN * np.asarray(wheel.axis)), look)

    def _draw_device(self, number: int, device: Terminal | Drive | Instrument, foot: np.ndarray) -> None:
        """Draw device `number` at its foot (3,): what it reaches, its boresights and its field of view."""
        look = device_style(number)
        colour = look["color"]
        if isinstance(device, Terminal):
            self._draw_reach(number, device, foot)
        elif isinstance(device, Drive):
            self._draw_fan(number, device, foot)
        self._add_arrow(_segment(foot, _BORESIGHT * self.zero[number]), {**look, "linewidth": 2.2})
        if self.turned and not isinstance(device, Instrument):
            self._add_line(_segment(foot, _BORESIGHT * self.now[number]), {"color": colour, "linewidth": 1.2})
            tip = (foot + _BORESIGHT * self.now[number])[:, None]
            self.axes.plot(*tip, marker="o", markersize=5, color=colour, zorder=4)
        if device.field_of_view is not None:
            self._draw_field(number, device, device.field_of_view, foot)

    def _draw_reach(self, number: int, terminal: Terminal, foot: np.ndarray) -> None:
        """Draw the part of a sphere that a terminal's ranges reach, its masks in red, and its yaw axis."""
        frame, colour = self.craft.gimbals.frames[number], device_style(number)["color"]
        ranges = np.asarray(terminal.ranges, float)
        yaws, pitches = once_around(ranges[0]), ranges[1]

        def place(yaw: ArrayLike, pitch: ArrayLike) -> np.ndarray:
            return np.asarray(foot + _REACH_RADIUS * (pointing(*np.broadcast_arrays(yaw, pitch)) @ frame.T))

        across, upward = cells_of(yaws), cells_of(pitches)
        corners = place(*np.meshgrid(across, upward, indexing="ij"))
        cells = np.stack([corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]], axis=-2)
        middles = np.stack(np.meshgrid(middles_of(across), middles_of(upward), indexing="ij"), axis=-1)
        masked = within_masks(terminal, middles)
        self._fill(cells[~masked], colour, _REACH_ALPHA)
        self._fill(cells[masked], KEEP_OUT, _MASK_ALPHA)
        edge: Look = {"color": colour, "linewidth": 0.9}
        low, high = (points_of(span) for span in (yaws, pitches))
        ends = [place(low, pitches[0]), place(low, pitches[1])]
        if yaws[1] - yaws[0] < TURN:
            ends += [place(yaws[0], high), place(yaws[1], high)]
        for line in ends:
            self._add_line(line, edge)
        self._add_arrow(place(low, np.clip(0.0, *pitches)), edge)
        self._add_arrow(place(np.clip(0.0, *yaws), high), edge)
        for corner in terminal.mask:
            for turn in turns(corner, *yaws):
                self._add_line(
                    place(*outline_of(corner, turn, yaws, pitches)), {"color": KEEP_OUT, "linewidth": 1.3}
                )
        self._add_line(
            _segment(foot, _AXIS_LENGTH * frame[:, 2]), {"color": colour, "linewidth": 1, "linestyle": ":"}
        )

    def _draw_fan(self, number: int, drive: Drive, foot: np.ndarray) -> None:
        """Draw the fan in which the boresight of a drive turns, and the axis of the drive."""
        frame, colour = self.craft.gimbals.frames[number], device_style(number)["color"]
        angles = points_of(once_around(np.asarray(drive.range, float)))
        own = pointing(angles, np.full_like(angles, float(drive.tilt)))
        arc = foot + _REACH_RADIUS * (own @ frame.T)
        self._fill(
            np.stack([np.broadcast_to(foot, arc[1:].shape), arc[:-1], arc[1:]], axis=1), colour, _REACH_ALPHA
        )
        self._add_arrow(arc, {"color": colour, "linewidth": 0.9})
        axis = np.array([-0.5, 1.0])[:, None] * _AXIS_LENGTH * frame[:, 2]
        self._add_line(foot + axis, {"color": colour, "linewidth": 1, "linestyle": ":"})

    def _draw_field(self, number: int, device: Any, full: np.ndarray, foot: np.ndarray) -> None:
        """Draw a field of view of full angles (2,), rad, as a pyramid, with an arrow up at its upper edge."""
        colour = device_style(number)["color"]
        if isinstance(device, Terminal):
            up, turn = UP if device.up is None else device.up, self.moved[number]
            corners, up = field_corners(FORWARD, up, full) @ turn.T, turn @ up
        else:
            up, corners = device.up, field_corners(device.boresight, device.up, full)
        tips = foot + _FIELD_LENGTH * corners / (corners @ self.now[number])[:, None]
        around = tips[[0, 1, 2, 3, 0]]
        sides = np.stack([np.broadcast_to(foot, (4, 3)), around[:-1], around[1:]], axis=1)
        self._fill(sides, colour, _REACH_ALPHA)
        thin: Look = {"color": colour, "linewidth": 0.8}
        for line in (around, *(np.array([foot, tip]) for tip in tips)):
            self._add_line(line, thin)
        middle = foot + _FIELD_LENGTH * self.now[number]
        end = middle + (np.max((tips - middle) @ up) + 0.15) * np.asarray(up)
        self._add_arrow(np.array([middle, end]), {**thin, "linewidth": 1.2})

    def _fit_axes(self) -> None:
        """Give all three axes one scale, with which the picture as first seen fills the page."""
        points = np.concatenate(self.drawn)
        limits = self.axes.set_xlim, self.axes.set_ylim, self.axes.set_zlim
        self.axes.set_box_aspect((1, 1, 1))
        for limit in limits:
            limit(-1, 1)
        unit_axes = np.concatenate([np.zeros((1, 3)), np.eye(3)])
        across, up, _ = proj_transform(*np.concatenate([unit_axes, points]).T, self.axes.get_proj())
        seen = np.stack([across, up])
        low, high = np.min(seen[:, 4:], axis=1), np.max(seen[:, 4:], axis=1)
        # point in space at the middle of what is seen: limits about it bring it to the middle of the page
        middle = np.linalg.pinv(seen[:, 1:4] - seen[:, :1]) @ ((low + high) / 2)
        for limit, centre in zip(limits, middle, strict=True):
            limit(centre - 1, centre + 1)
        room = np.array([np.ptp(self.axes.viewLim.intervalx), np.ptp(self.axes.viewLim.intervaly)])
        self.axes.set_box_aspect((1, 1, 1), zoom=_FILLED_SHARE * np.min(room / (high - low)))

    def _write_names(self) -> None:
        """Write the name of each device at the end of its boresight or axis, where it covers no other name.

        Names of wheels stand beside their rings or at the ends of their arrows.
        """
        letter = _LETTER_SIZE * (SMALL + 1) * self.axes.figure.dpi / 72  # pixels, before the final layout
        labels = Labels(np.zeros((0, 2)))
        labels.taken.extend((self._to_pixels(1.06 * _FRAME_LENGTH * axis), 2 * letter) for axis in np.eye(3))
        for number, foot in enumerate(_HALF_EDGE * feet(self.craft)):
            ends = [_BORESIGHT * self.now[number], _BORESIGHT * self.zero[number]]
            if number < self.craft.gimbals.count:
                ends += [side * _AXIS_LENGTH * self.craft.gimbals.frames[number, :, 2] for side in (1, -0.5)]
            places = [foot + 1.15 * end for end in ends] + [foot + share * ends[0] for share in (0.75, 0.45)]
            look = (device_style(number)["color"], SMALL + 1)
            self._place_name(labels, self.craft.device_names[number], places, letter, look)
        letter = letter * SMALL / (SMALL + 1)
        labels.taken.extend((self._to_pixels(hub), np.full(2, float(letter[1]))) for hub in self.hubs)
        for wheel, hub in zip(self.craft.wheels, self.hubs, strict=True):
            places = spacecraft_parts.name_places(wheel, hub)
            self._place_name(labels, wheel.name, places, letter, (spacecraft_parts.COLOUR, SMALL))

    def _place_name(
        self, labels: Labels, name: str, places: list[np.ndarray], letter: np.ndarray, look: tuple[str, float]
    ) -> None:
        """Write a name at one of several places (3,) in body axes.

        `letter` is the size (2,) of a letter in pixels, `look` the colour and size of the text.
        """
        spots = [self._to_pixels(place) for place in places]
        spot = labels.place(spots, letter * [len(name), 1.0], must=True)
        where = int(np.argmin([np.linalg.norm(one - spot) for one in spots]))
        self._write_text(places[where], name, *look)

    def _to_pixels(self, point: np.ndarray) -> np.ndarray:
        """Return the place (2,) in the picture, in pixels, of a point (3,) in body axes."""
        across, up, _ = proj_transform(*point, self.axes.get_proj())
        return np.asarray(self.axes.transData.transform((across, up)))

    def _fill(self, polygons: Sequence[np.ndarray] | np.ndarray, colour: str, alpha: float) -> None:
        """Add triangles or squares, each (k, 3) in body axes, to the surfaces that `draw` draws together.

        All get four corners, a triangle one of them twice: matplotlib would pad shorter ones with arbitrary
        values, and scale the axes to those.
        """
        corners = np.asarray(polygons)
        self.surfaces += list(corners if corners.shape[1] == 4 else corners[:, [0, 1, 2, 2]])
        self.colours += [to_rgba(colour, alpha)] * len(polygons)

    def _add_line(self, points: np.ndarray, look: Look) -> None:
        """Draw a line through points (k, 3) in body axes."""
        self.drawn.append(points)
        self.axes.plot(*points.T, zorder=3, **look)

    def _add_arrow(self, points: np.ndarray, look: Look) -> None:
        """Draw a line through points (k, 3) with an arrowhead at its end.

        The head is turned so that it lies flat on a surface around the middle of the platform.
        """
        self._add_line(points, look)
        back = points[-1] - points[-2]
        back = back / np.linalg.norm(back)
        aside = np.cross(back, points[-1])
        if np.linalg.norm(aside) < 1e-6:
            aside = np.cross(back, np.roll(np.eye(3)[np.argmax(np.abs(back))], 1))
        aside = aside / np.linalg.norm(aside)
        barbs = [points[-1] - _HEAD_LENGTH * back + side * 0.45 * _HEAD_LENGTH * aside for side in (1, -1)]
        self._add_line(np.array([barbs[0], points[-1], barbs[1]]), {**look, "linestyle": "-"})

    def _write_text(self, place: np.ndarray, text: str, colour: str, size: float) -> None:
        """Write a text at a point (3,) in body axes."""
        named = self.axes.text(*place, text, color=colour, fontsize=size, zorder=5, **HALO)
        plain(named)

    def entries(self) -> Entries:
        """Return the legend entries: devices with their ranges, and the meanings of lines and surfaces."""
        devices = self.craft.devices
        crowded = sum(_device_label(device).count("\n") + 1 for device in devices) > _MAX_LINES - _OTHER_LINES
        found: Entries = [
            (Line2D([], [], linewidth=2.2, **device_style(number)), _device_label(device, short=crowded))
            for number, device in enumerate(devices)
        ]
        joints = [device for device in devices if not isinstance(device, Instrument)]
        masked = any(terminal.mask for terminal in self.craft.terminals)
        line: Look = {"color": GREY, "linewidth": 2.2}
        kinds: list[tuple[bool, Any, str]] = [
            (bool(devices), Line2D([], [], **line), "boresight at zero angles"),
            (
                self.turned and bool(joints),
                Line2D([], [], color=GREY, linewidth=1.2, marker="o", markersize=5, markevery=[1]),
                "boresight at the given angles",
            ),
            (
                bool(joints),
                Line2D([], [], color=GREY, linewidth=1, linestyle=":"),
                "yaw axis, axis of a drive",
            ),
            (
                bool(joints),
                Patch(color=to_rgba(GREY, _REACH_ALPHA)),
                "what a device can reach;\narrows to where angles grow",
            ),
            (
                masked,
                Patch(facecolor=to_rgba(KEEP_OUT, _MASK_ALPHA), edgecolor=KEEP_OUT),
                "mask, cut out of it",
            ),
            (
                any(device.field_of_view is not None for device in devices),
                Line2D(
                    [], [], color=GREY, linewidth=0.8, marker="^", markerfacecolor="none", linestyle="none"
                ),
                "field of view,\nwith an arrow to its up",
            ),
            (
                bool(self.craft.wheels),
                Line2D([], [], marker="o", markersize=8, linestyle="none", **_WHEEL_ENTRY),
                spacecraft_parts.label(self.craft.wheels),
            ),
        ]
        return found + [(handle, text) for there, handle, text in kinds if there]


def _device_label(device: Terminal | Drive | Instrument, *, short: bool = False) -> str:
    """Return a device's legend text: its name and, unless `short`, its ranges and field of view, deg."""
    if short:
        return device.name
    lines = [device.name]
    if isinstance(device, Terminal):
        yaw, pitch = np.asarray(device.ranges, float)
        lines += [f"  yaw {_format_range(yaw)}", f"  pitch {_format_range(pitch)}"]
    elif isinstance(device, Drive):
        lines.append(f"  angle {_format_range(np.asarray(device.range, float))}")
    if device.field_of_view is not None:
        lines.append("  field {} x {} deg".format(*map(_format_degrees, device.field_of_view)))
    return "\n".join(lines)


def _format_range(ends: np.ndarray) -> str:
    """Return a range (2,), rad, as text in degrees."""
    return "{} to {} deg".format(*map(_format_degrees, ends))


def _format_degrees(angle: float) -> str:
    """Return an angle, rad, as text in degrees."""
    return f"{np.rad2deg(angle):.4g}".replace("-", "\N{MINUS SIGN}")


def _segment(foot: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return both ends (2, 3) of a vector (3,) that begins at a foot (3,)."""
    return np.array([foot, foot + vector])
