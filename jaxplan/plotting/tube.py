"""The tube about a plan in figures: how far errors of attitude and joints may move what is drawn.

The errors are those that the scenario allows for (`Scenario.robust`). On the sphere the tube of a boresight
is a band whose half width is the error of the attitude plus what errors of its joints add; it is drawn by its
two edges and a circle at either end. It holds for directions as seen in inertial axes. Over joint angles the
tube is a band of the error of joints.
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
_EDGE_LINE: Look = {"linewidth": 0.8, "linestyle": (0, (1, 1.4)), "zorder": 2.9}
_BAND_OPACITY = 0.22  # opacity of a band
_MIN_CHORD = 1e-9  # length of a chord below which a direction stands still
_MAX_SQUARES = 400  # most squares of which a band in a map of yaw and pitch is made


def radii(scenario: Scenario) -> np.ndarray:
    """Return how far each boresight may be off the plan in inertial axes, (D,) rad; 0 without errors."""
    robust, devices = scenario.robust, scenario.spacecraft.devices
    if robust is None:
        return np.zeros(len(devices))
    return np.array([float(robust.loss(one, None, inertial=True)) for one in devices])


def draw_tubes(axes: Axes, projection: Projection, scenario: Scenario, tracks: np.ndarray) -> Entries:
    """Draw tubes about the tracks (k, D, 3) of D devices; returns one legend entry, or none without tubes."""
    found = radii(scenario)
    for device, radius in enumerate(found):
        for line in edges(tracks[:, device], radius) if radius > 0 else ():
            draw_line(axes, projection, line, {"color": device_style(device)["color"], **_EDGE_LINE})
    return [(Line2D([], [], color=GREY, **_EDGE_LINE), told(found))] if np.any(found > 0) else []


def told(radii: np.ndarray | float) -> str:
    """Return the legend text of a tube: its name and its radius, or the least and largest of radii (D,), rad.

    The numbers are needed since a tube of a tenth of a degree looks the same as its track.
    """
    least, largest = (f"{np.rad2deg(own):.3g}" for own in (np.min(radii), np.max(radii)))
    return f"{NAME},\n\N{PLUS-MINUS SIGN}{least if least == largest else f'{least} to {largest}'} deg"


def edges(track: np.ndarray, radius: float) -> Iterator[np.ndarray]:
    """Yield lines (m, 3) at `radius` rad to either side of a track (k, 3), and circles about its ends.

    A track that stands still has one circle.
    """
    steps = np.diff(track, axis=0)
    moving = np.linalg.norm(steps, axis=1) > _MIN_CHORD
    places, steps = track[1:][moving], steps[moving]
    across = np.cross(places, steps)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    for side in (1, -1) if len(places) > 1 else ():
        yield np.cos(radius) * places + side * np.sin(radius) * across
    for end in track[[0, -1]] if len(places) else track[:1]:
        yield circle(end, radius)


def draw_band(axes: Axes, times: np.ndarray, values: np.ndarray, error: float, colour: str) -> None:
    """Fill the band within `error` of values (k,) over times (k,), all in the units of the axes."""
    axes.fill_between(times, values - error, values + error, color=colour, alpha=_BAND_OPACITY, linewidth=0)


def draw_squares(axes: Axes, points: np.ndarray, error: float, colour: str) -> None:
    """Fill a square of half width `error` about each of the points (k, 2), in the units of the axes."""
    own = points[np.linspace(0, len(points) - 1, min(len(points), _MAX_SQUARES)).astype(int)]
    squares = [Rectangle((x - error, y - error), 2 * error, 2 * error) for x, y in own.tolist()]
    pale = 1 - _BAND_OPACITY * (1 - np.array(to_rgb(colour)))
    axes.add_collection(PatchCollection(squares, facecolor=[pale], edgecolor="none", zorder=1.4))


def band_entry(error: float) -> Entries:
    """Return the legend entry of the band of an error, rad."""
    return [(Patch(facecolor=GREY, alpha=_BAND_OPACITY, linewidth=0), told(error))]
