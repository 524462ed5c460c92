"""The tube about a plan in figures: how far errors of attitude and joints may move what is drawn.

On the sphere the tube of a boresight is a band of the angle that the error of the attitude and those of its
joints add up to, drawn by its two edges and a circle at either end; it is about inertial directions that this
counts. Over joint angles it is a band of the error of joints.
"""

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from jaxplan.model.scenario import Scenario
from jaxplan.plotting.projections import Projection, circle
from jaxplan.plotting.style import GREY, Entries, Look, device_style
from jaxplan.plotting.zones import draw_line

NAME = "tube of errors"
_EDGE: Look = {"linewidth": 0.8, "linestyle": (0, (1, 1.4)), "zorder": 2.9}
_BAND = 0.22  # opacity
_STILL = 1e-9  # length of a chord below which a direction stands still
_MOST = 400  # squares of which a band over two joints is made


def radii(scenario: Scenario) -> np.ndarray:
    """How far each device's boresight may be off the plan as seen from inertial space, (D,) rad."""
    robust, devices = scenario.robust, scenario.spacecraft.devices
    if robust is None:
        return np.zeros(len(devices))
    return np.array([float(robust.loss(one, None, inertial=True)) for one in devices])


def draw_tubes(axes: Axes, projection: Projection, scenario: Scenario, tracks: np.ndarray) -> Entries:
    """Draw the tube about the track of every boresight, (k, D, 3); returns its legend entry, if any."""
    found = radii(scenario)
    for device, radius in enumerate(found):
        for line in edges(tracks[:, device], radius) if radius > 0 else ():
            draw_line(axes, projection, line, {"color": device_style(device)["color"], **_EDGE})
    return [(Line2D([], [], color=GREY, **_EDGE), told(found))] if np.any(found > 0) else []


def told(radii: np.ndarray | float) -> str:
    """The tube's name with its radius, rad, or the least and the largest of several (D,).

    At the size of a figure a tube of a tenth of a degree cannot be told from its track.
    """
    least, largest = (f"{np.rad2deg(own):.3g}" for own in (np.min(radii), np.max(radii)))
    return f"{NAME},\n\N{PLUS-MINUS SIGN}{least if least == largest else f'{least} to {largest}'} deg"


def edges(track: np.ndarray, radius: float) -> Iterator[np.ndarray]:
    """Yield the lines (m, 3) that are `radius` rad to either side of a track (k, 3), and about its ends."""
    steps = np.diff(track, axis=0)
    moving = np.linalg.norm(steps, axis=1) > _STILL
    places, steps = track[1:][moving], steps[moving]
    across = np.cross(places, steps)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    for side in (1, -1) if len(places) > 1 else ():
        yield np.cos(radius) * places + side * np.sin(radius) * across
    for end in track[[0, -1]] if len(places) else track[:1]:
        yield circle(end, radius)


def draw_band(axes: Axes, times: np.ndarray, values: np.ndarray, error: float, colour: str) -> None:
    """Fill what lies within an error of values (k,) over times, in the units of the axes."""
    axes.fill_between(times, values - error, values + error, color=colour, alpha=_BAND, linewidth=0)


def draw_squares(axes: Axes, points: np.ndarray, error: float, colour: str) -> None:
    """Fill what lies within an error of either coordinate of points (k, 2), in the units of the axes."""
    own = points[np.linspace(0, len(points) - 1, min(len(points), _MOST)).astype(int)]
    squares = [Rectangle((x - error, y - error), 2 * error, 2 * error) for x, y in own.tolist()]
    pale = 1 - _BAND * (1 - np.array(to_rgb(colour)))
    axes.add_collection(PatchCollection(squares, facecolor=[pale], edgecolor="none", zorder=1.4))


def band_entry(error: float) -> Entries:
    """The legend entry of a band of an error, rad."""
    return [(Patch(facecolor=GREY, alpha=_BAND, linewidth=0), told(error))]
