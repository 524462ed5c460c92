"""A manoeuvre as a film: the platform with its devices, whose beams move over the sphere of directions."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from jaxplan.files import replacing_file
from jaxplan.plotting import samples
from jaxplan.plotting.canvas import Canvas, panels
from jaxplan.plotting.globe_map import draw_line, draw_sphere, view_of
from jaxplan.plotting.marks import end_marks, end_style, zone_entries
from jaxplan.plotting.style import SMALL, device_entries, device_style, legend_beside
from jaxplan.plotting.view import PALE, View

if TYPE_CHECKING:
    from jaxplan.planner import Plan

SIZE = (6.6, 5.2)  # inches

_PLAY = 8.0  # s that a film lasts, however long the manoeuvre
_BODY = np.array([0.15, 0.15, 0.19])  # half edges of the platform, in radii of the sphere
_PALEST, _DARKEST = 0.93, 0.62  # greys of its faces, square to the eye and edgewise


def animate(
    plan: "Plan",
    ax: Canvas = None,
    *,
    view: tuple[float, float] | None = None,
    frames: int = 80,
) -> "Film":
    """A film of a manoeuvre on the globe.

    In a notebook ``HTML(jp.plot.animate(plan).to_jshtml())`` plays it; ``.save("slew.gif")`` writes a file,
    as ``.mp4`` where ffmpeg is installed. The file appears whole or not at all.

    Args:
        plan: with a trajectory.
        ax: axes, a figure to put them in, or None for a new one.
        view: inertial azimuth and elevation of the eye, deg; None for where most of the ways are in front.
        frames: pictures, evenly over the manoeuvre.

    Returns:
        The film; keep it until it is played or saved.

    Raises:
        ValueError: if the plan has no trajectory, or more than one axes is given.
    """
    motion = samples.motion(plan)
    (axes,) = panels(ax, 1, SIZE)
    seen = view_of(plan, view)
    draw_sphere(axes, plan, seen)
    for look, _, directions in end_marks(plan):
        for device, point in enumerate(directions):
            axes.plot(*seen.project(point), **end_style(look, device), alpha=0.5)
    for device, way in enumerate(np.moveaxis(motion.boresights, 1, 0)):
        draw_line(axes, seen, way, {"linewidth": 0.8, "zorder": 2.5, "color": device_style(device)["color"]})
    legend_beside(
        axes, [*device_entries(plan.scenario.spacecraft.device_names), *zone_entries(plan.scenario)]
    )
    picture = _Picture(axes, plan, motion, seen)
    picture(0)
    shown = np.linspace(0, len(motion.times) - 1, frames).round().astype(int)
    figure = axes.get_figure(root=True)
    assert figure is not None
    return Film(figure, picture, frames=shown, interval=1000 * _PLAY / frames, blit=True)


class Film(FuncAnimation):
    """An animation of matplotlib, with progress where it is saved."""

    def save(self, filename: str | os.PathLike[str], *arguments: Any, **settings: Any) -> None:
        """Write a film as matplotlib does, with a bar on stderr once it takes longer than a second."""
        from tqdm.auto import tqdm

        target = Path(filename)
        hidden = None if "progress_callback" not in settings else True  # None: where stderr is no terminal
        with (
            tqdm(desc="film", unit=" pictures", delay=1, leave=False, disable=hidden) as bar,
            replacing_file(target, suffix=target.suffix) as fresh,
        ):
            settings.setdefault("progress_callback", lambda _number, _total: bar.update())
            super().save(str(fresh), *arguments, **settings)


class _Picture:
    """What moves: called with a number of an instant, it brings everything there."""

    def __init__(self, axes: Axes, plan: "Plan", motion: samples.Motion, view: View) -> None:
        self.motion, self.view = motion, view
        craft = plan.scenario.spacecraft
        self.margins = [m.values for m in samples.margins(plan.scenario, motion.boresights, motion.times)]
        # A terminal stands on the platform's side where it looks at rest, an instrument where it looks.
        azimuths = craft.mounts
        rest = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros_like(azimuths)], axis=-1)
        outward = np.concatenate([rest, craft.fixed_boresights])
        self.feet = outward * np.min(_BODY / np.maximum(np.abs(outward), 1e-9), axis=1, keepdims=True)
        self.faces = PolyCollection([], edgecolor="0.35", linewidth=0.8, zorder=2.7)
        axes.add_collection(self.faces, autolim=False)
        self.trails, self.beams, self.spots = [], [], []
        for device in range(len(outward)):
            look = device_style(device)
            self.trails += [
                axes.plot([], [], linewidth=2.2, alpha=alpha, zorder=3, **look)[0] for alpha in (1.0, PALE)
            ]
            self.beams.append(
                axes.plot([], [], linewidth=1.4, color=look["color"], marker="o", markevery=[0])[0]
            )
            self.spots.append(
                axes.plot(
                    [], [], "o", markersize=7, color=look["color"], markeredgecolor="white", zorder=4.5
                )[0]
            )
        self.clock = axes.text(-1.06, 1.0, "", fontsize=SMALL + 1, ha="left", va="top")

    def __call__(self, number: int) -> list[Artist]:
        """Show an instant; returns what has changed."""
        attitude, directions = self.motion.values.attitude[number], self.motion.boresights[number]
        self._turn_platform(attitude)
        for device, direction in enumerate(directions):
            halves = self.view.sides(self.motion.boresights[: number + 1, device])
            for line, half in zip(self.trails[2 * device : 2 * device + 2], halves, strict=True):
                line.set_data(*half.T)
            foot, tip = self.feet[device] @ attitude.T, direction
            near, front = self.view.depth(tip) >= 0, self.view.depth(foot) >= 0
            self.beams[device].set_data(*self.view.project(np.stack([foot, tip])).T)
            self.beams[device].set(alpha=1.0 if near else 0.5, zorder=2.8 if front else 2.6)
            self.spots[device].set_data(*self.view.project(tip)[:, None])
            self.spots[device].set_alpha(1.0 if near else 0.45)
        self.clock.set_text(self._words(number))
        return [self.faces, *self.trails, *self.beams, *self.spots, self.clock]

    def _turn_platform(self, attitude: np.ndarray) -> None:
        """Draw the faces of the platform that the eye sees."""
        corners, shades = [], []
        for axis in range(3):
            first, second = (np.eye(3)[(axis + i) % 3] * _BODY for i in (1, 2))
            for side in (-1, 1):
                normal = side * np.eye(3)[axis]
                facing = float(self.view.depth(normal @ attitude.T))
                if facing > 0:
                    middle = normal * _BODY
                    square = [
                        middle + i * first + j * second for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))
                    ]
                    corners.append(self.view.project(np.array(square) @ attitude.T))
                    shades.append(to_rgb(str(_DARKEST + (_PALEST - _DARKEST) * facing)))
        self.faces.set_verts(corners)
        self.faces.set_facecolor(shades)

    def _words(self, number: int) -> str:
        times = self.motion.times
        words = f"{times[number]:.1f} of {times[-1]:.1f} s"
        found = [values[number] for values in self.margins if not np.isnan(values[number])]
        return f"{words}\nsmallest margin {np.rad2deg(min(found)):.2f} deg" if found else words
