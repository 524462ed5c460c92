"""A manoeuvre as a film: the platform turns, and the beams of its devices move over the sphere of directions.

A *beam* is the line from a device to the point of the sphere where its boresight points; its *trail* is the
curve of these points until now.
"""

import base64
import io
import os
import re
from itertools import chain, product
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from jaxplan.planner import Plan
from jaxplan.plotting.margin_panels import margins_over_time
from jaxplan.plotting.projections import PALE, GlobeView
from jaxplan.plotting.sky import draw_ball, draw_ends, draw_zones, view_of
from jaxplan.plotting.spacecraft_parts import feet
from jaxplan.plotting.style import (
    SMALL,
    Canvas,
    Look,
    Motion,
    device_entries,
    device_style,
    expect_plan,
    legend_beside,
    motion,
    panels,
)
from jaxplan.plotting.zones import draw_line, draw_zone, name_zones, zone_entries, zones_at
from jaxplan.runtime.display import shown
from jaxplan.runtime.files import expect_replaceable, replacing_file
from jaxplan.runtime.progress import progress_bar
from jaxplan.timeline.record import TimelinePlan

SIZE = (6.8, 5.6)  # inches

_PLAYING_TIME = 8.0  # s: playing time of a film, however long the manoeuvre
_MAX_PLAYER_FRAMES = 120  # most pictures in the player that a notebook shows
_COLOUR_COUNT = 64  # colours of a picture in a player: a quarter of the bytes, and no difference to be seen
_EMBED_LIMIT = 200.0  # MB: limit given to matplotlib for all pictures of a player, before colours are reduced
_IMAGE_ENDINGS, _VIDEO_ENDINGS = (".gif", ".png", ".webp"), (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi")
_HALF_EDGES = np.array([0.15, 0.15, 0.19])  # half edges of the platform, in radii of the sphere
_LIGHTEST_GREY, _DARKEST_GREY = 0.93, 0.62  # of the platform's faces: facing the eye, and edgewise


def animate(
    plan: Plan | TimelinePlan,
    ax: Canvas = None,
    *,
    view: tuple[float, float] | None = None,
    frames: int = 80,
) -> "Film":
    """Make a film of a manoeuvre on the globe, where the platform turns and the devices' beams move.

    As the last expression of a notebook's cell it shows a player. ``.save("slew.gif")`` writes a file;
    ``.mp4`` and the like need ffmpeg.

    Args:
        plan: a plan with a trajectory, also one of a timeline.
        ax: axes, a figure to put them in, or None for a new one.
        view: inertial azimuth and elevation of the eye, deg; None for a view with most boresights in front.
        frames: number of pictures, spread evenly over the manoeuvre.

    Returns:
        The film. Its figure holds a reference to it, so that it keeps playing in a window.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, frames is less than one, or more than one axes is given.
    """
    if frames < 1:
        raise ValueError(f"frames = {frames}: must be 1 or more")
    plan = expect_plan(plan)
    moves = motion(plan)
    if ax is None and "inline" in mpl.get_backend():  # a notebook would show the figure beside the player
        ax = Figure(figsize=SIZE, layout="constrained")
    (axes,) = panels(ax, 1, SIZE)
    seen = view_of(plan, view)
    draw_ball(axes, seen)
    draw_zones(axes, plan, seen, zones_at(plan.scenario, 0.0, moving=False))
    axes.set_ylim(-1.06, 1.3)  # with room for the clock above
    ends = draw_ends(axes, plan, seen, alpha=0.5)
    for device, track in enumerate(np.moveaxis(moves.boresights, 1, 0)):
        draw_line(
            axes, seen, track, {"linewidth": 0.8, "zorder": 2.5, "color": device_style(device)["color"]}
        )
    devices = device_entries(plan.scenario.spacecraft.device_names)
    legend_beside(axes, [*devices, *ends, *zone_entries(plan.scenario)])
    picture = _Picture(axes, plan, moves, seen)
    picture(0)
    even = np.linspace(0, moves.times[-1], frames)
    instants = np.interp(even, moves.times, np.arange(len(moves.times))).round().astype(int)
    figure = axes.get_figure(root=True)
    assert figure is not None
    return Film(figure, picture, instants)


@shown("pictures", "duration s", heading="Film of {0.picture.scenario.name}")
class Film(FuncAnimation):
    """An animation of matplotlib that shows a player in notebooks and a progress bar while it is saved.

    Args:
        figure: the figure that is drawn on; it gets an attribute ``film``.
        picture: draws the state at an index of the motion's times.
        instants: (k,) indices of the motion's times, one for each picture.
    """

    def __init__(self, figure: Figure, picture: "_Picture", instants: np.ndarray) -> None:
        self.figure, self.picture, self.instants = figure, picture, instants
        super().__init__(
            figure, picture, frames=instants, interval=1000 * _PLAYING_TIME / len(instants), blit=True
        )
        figure.film = self  # type: ignore[attr-defined]  # else it stops where nobody else keeps it

    @property
    def pictures(self) -> int:
        """Number of pictures in the film."""
        return len(self.instants)

    @property
    def duration(self) -> float:
        """Duration of the manoeuvre, s; not the playing time of the film."""
        return float(self.picture.motion.times[-1])

    def __del__(self) -> None:
        """Suppress matplotlib's warning about an animation that was never drawn."""

    def save(
        self, filename: str | os.PathLike[str], writer: Any = None, *arguments: Any, **settings: Any
    ) -> None:
        """Write the film to a file, with a progress bar on stderr once it takes longer than a second.

        Args:
            filename: ends in .gif, .png or .webp, or, where ffmpeg is installed, in .mp4, .m4v, .mov, .mkv,
                .webm or .avi. The file appears whole or not at all, and its folder is made.
            writer: a writer of matplotlib, needed for any other ending; None to choose one by the ending.
            *arguments: passed to matplotlib's ``Animation.save``.
            **settings: likewise; a ``progress_callback`` replaces the progress bar.

        Raises:
            ValueError: if the file's name has another ending and no writer is given.
            RuntimeError: if ffmpeg is needed and not installed.
            OSError: if the file cannot be written there, such as where the name is that of a folder.
        """
        target = Path(filename)
        writer = _choose_writer(target) if writer is None else writer
        _check_writable(target)
        bar_shown = "progress_callback" not in settings
        with (
            progress_bar("film", "pictures", total=len(self.instants), shown=bar_shown) as bar,
            replacing_file(target, suffix=target.suffix) as fresh,
        ):
            settings.setdefault("progress_callback", lambda _number, _total: bar.update())
            super().save(str(fresh), writer, *arguments, **settings)

    def to_jshtml(self, *arguments: Any, **settings: Any) -> str:
        """Return an HTML player with all pictures in it; arguments are those of matplotlib's method."""
        with mpl.rc_context({"animation.embed_limit": _EMBED_LIMIT}):
            return re.sub(
                r'(data:image/png;base64,)([^"]+)', _reduce_colours, super().to_jshtml(*arguments, **settings)
            )

    def _repr_html_(self) -> str:
        """Return the player for a notebook; of a long film it shows only every n-th picture."""
        step = -(-len(self.instants) // _MAX_PLAYER_FRAMES)
        if step == 1:
            return self.to_jshtml()
        return Film(self.figure, self.picture, self.instants[::step]).to_jshtml()


def _choose_writer(target: Path) -> str:
    """Choose matplotlib's writer by the ending of a file's name; raises as `Film.save` does."""
    suffix = target.suffix.lower()
    if suffix in _IMAGE_ENDINGS:
        return "pillow"
    if suffix not in _VIDEO_ENDINGS:
        ending = f"ends in {suffix!r}" if suffix else "has no ending"
        known = ", ".join((*_IMAGE_ENDINGS, *_VIDEO_ENDINGS))
        raise ValueError(f"{target} {ending}: the name of a film must end in one of {known}")
    if not FFMpegWriter.isAvailable():
        raise RuntimeError(
            f"{target}: a film can be saved as {suffix} only where ffmpeg is installed, and no program "
            f"{mpl.rcParams['animation.ffmpeg_path']!r} was found: install it, or save as .gif"
        )
    return "ffmpeg"


def _check_writable(target: Path) -> None:
    """Raise an OSError if a file cannot be written, before drawing takes minutes."""
    expect_replaceable(target)
    folder = next(parent for parent in target.absolute().parents if parent.exists())
    if not folder.is_dir():
        raise NotADirectoryError(f"{target} cannot be written: {folder} is a file, not a folder")
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{target} cannot be written: there is no permission to write to {folder}")


def _reduce_colours(found: re.Match[str]) -> str:
    """Reduce the colours of a PNG picture so that it takes fewer bytes.

    Args:
        found: match of a ``data:`` address, with its head as group 1 and the base64 text as group 2.

    Returns:
        The new address.
    """
    picture = Image.open(io.BytesIO(base64.b64decode(found[2].replace("\\\n", ""))))
    file = io.BytesIO()
    picture.convert("RGB").quantize(_COLOUR_COUNT).save(file, "png")
    return found[1] + base64.b64encode(file.getvalue()).decode()


class _Picture:
    """The moving artists of a film; calling it with an index of the motion's times moves them to that time.

    Args:
        axes: to draw on, with the globe in it.
        plan: whose spacecraft and zones are drawn.
        moves: the sampled motion.
        view: projection of the globe.
    """

    def __init__(self, axes: Axes, plan: Plan, moves: Motion, view: GlobeView) -> None:
        self.axes, self.motion, self.view = axes, moves, view
        self.scenario = plan.scenario
        self.moving: list[Artist] = []  # artists of moving zones
        craft = plan.scenario.spacecraft
        self.margins = [margin.values for margin in margins_over_time(plan.scenario, moves)]
        self.feet = feet(craft) * _HALF_EDGES
        self.faces = PolyCollection([], edgecolor="0.35", linewidth=0.8, zorder=2.7)
        axes.add_collection(self.faces, autolim=False)
        looks = [device_style(device) for device in range(len(self.feet))]
        self.trails = [
            [axes.plot([], [], linewidth=2.2, alpha=alpha, zorder=3, **look)[0] for alpha in (1.0, PALE)]
            for look in looks
        ]
        colours = [{"color": look["color"]} for look in looks]
        self.beams = [axes.plot([], [], linewidth=1.4, marker="o", markevery=[0], **c)[0] for c in colours]
        spot: Look = {"markersize": 7, "markeredgecolor": "white", "zorder": 4.5}
        self.spots = [axes.plot([], [], "o", **spot, **c)[0] for c in colours]
        self.clock = axes.text(-1.06, 1.27, "", fontsize=SMALL + 1, ha="left", va="top")

    def __call__(self, number: int) -> list[Artist]:
        """Move all artists to the motion's time of index `number`; returns the artists that have changed."""
        attitude = self.motion.values.attitude[number]
        self._turn_platform(attitude)
        feet, tips = self.feet @ attitude.T, self.motion.boresights[number]
        near, front = self.view.depth(tips) >= 0, self.view.depth(feet) >= 0
        for device, ends in enumerate(self.view.project(np.stack([feet, tips], axis=1))):
            track = self.motion.boresights[: number + 1, device]
            for line, (flat, _) in zip(self.trails[device], self.view.parts(track), strict=True):
                line.set_data(*flat.T)
            self.beams[device].set_data(*ends.T)
            self.beams[device].set(alpha=1.0 if near[device] else 0.5, zorder=2.8 if front[device] else 2.6)
            self.spots[device].set_data(*ends[1:].T)
            self.spots[device].set_alpha(1.0 if near[device] else 0.45)
        self.clock.set_text(self._describe_instant(number))
        self._move_zones(float(self.motion.times[number]))
        return [*self.moving, self.faces, *chain(*self.trails), *self.beams, *self.spots, self.clock]

    def _move_zones(self, time: float) -> None:
        """Redraw the moving zones where they are at a time, s, and remove those drawn before."""
        for artist in self.moving:
            artist.remove()
        zones = zones_at(self.scenario, time, moving=True)
        self.moving = [artist for zone in zones for artist in draw_zone(self.axes, self.view, zone)]
        self.moving += name_zones(self.axes, self.view, zones)

    def _turn_platform(self, attitude: np.ndarray) -> None:
        """Draw the faces of the platform that the eye sees at an attitude (3, 3), body to inertial."""
        corners, shades = [], []
        for axis, side in product(range(3), (-1, 1)):
            middle, first, second = np.roll(np.eye(3), -axis, axis=0) * _HALF_EDGES
            facing = float(self.view.depth(side * np.eye(3)[axis] @ attitude.T))
            if facing > 0:
                square = [
                    side * middle + i * first + j * second for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))
                ]
                corners.append(self.view.project(np.array(square) @ attitude.T))
                shades.append(to_rgb(str(_DARKEST_GREY + (_LIGHTEST_GREY - _DARKEST_GREY) * facing)))
        self.faces.set_verts(corners)
        self.faces.set_facecolor(shades)

    def _describe_instant(self, number: int) -> str:
        """Return the time and the smallest margin of any device at the motion's time of an index, as text."""
        times = self.motion.times
        words = f"{times[number]:.1f} of {times[-1]:.1f} s"
        found = [values[number] for values in self.margins if not np.isnan(values[number])]
        return f"{words}\nsmallest margin {np.rad2deg(min(found)):.2f} deg" if found else words
