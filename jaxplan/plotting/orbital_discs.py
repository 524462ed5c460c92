"""Background of the two discs of the local orbital frame: rings, directions, and the Earth about nadir."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from jaxplan.plotting.frames import Orbital
from jaxplan.plotting.projections import TwoDiscs
from jaxplan.plotting.style import GREY, HALO, SMALL, Entries, Look

_EARTH: Look = {"facecolor": "#E3EDF5", "edgecolor": "#5B87A6", "linewidth": 1.0, "zorder": 0.6}
_EARTH_ENTRY: Look = {
    "marker": "o",
    "markersize": 9,
    "linestyle": "none",
    "markerfacecolor": _EARTH["facecolor"],
    "markeredgecolor": _EARTH["edgecolor"],
}
_RING: Look = {"facecolor": "none", "edgecolor": "0.85", "linewidth": 0.5}  # within a disc
_RING_NAME: Look = {**HALO, "fontsize": SMALL - 1, "color": "0.5"}


def draw_discs(axes: Axes, frame: Orbital) -> Entries:
    """Draw the two empty discs with rings, azimuth lines and the Earth; returns the Earth's legend entry."""
    projection = TwoDiscs()
    axes.set_aspect("equal", anchor="E")  # else the layout counts space beside it as the legend's room
    edge = projection.middle + 90
    axes.set(xlim=(-edge - 12, edge + 12), ylim=(-104, 104))
    axes.set_axis_off()
    earth = Circle((-projection.middle, 0), np.rad2deg(frame.limb()), **_EARTH)
    for middle, words in ((-projection.middle, "nadir"), (projection.middle, "zenith")):
        axes.add_artist(Circle((middle, 0), 90, facecolor="white", edgecolor="0.6", zorder=0.5))
        for ring in projection.rings[:-1]:
            axes.add_artist(Circle((middle, 0), ring, zorder=0.7, **_RING))
        for turn in np.deg2rad(range(0, 180, 45)):
            ends = 90 * np.array([[np.sin(turn)], [np.cos(turn)]]) * (-1, 1)
            axes.plot(middle + ends[0], ends[1], zorder=0.7, color="0.88", linewidth=0.5)
        small: Look = {"fontsize": SMALL, "color": GREY, "ha": "center"}
        axes.text(middle, 93, "ahead", va="bottom", **small)
        axes.text(middle, -93, f"behind \N{EN DASH} angles from {words}", va="top", **small)
        axes.text(middle + 97, 0, "right", va="center", rotation=90, **small)
        axes.text(middle - 97, 0, "left", va="center", rotation=90, **small)
    for text, (across, up) in projection.ring_names():
        axes.text(float(across), float(up), text, zorder=3.5, **_RING_NAME)
    axes.add_artist(earth)
    return [(Line2D([], [], **_EARTH_ENTRY), "the Earth, to its limb")]
