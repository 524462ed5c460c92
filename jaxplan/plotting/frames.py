"""The axes in which directions are drawn: inertial ones, or the local orbital frame of a spacecraft.

The local orbital frame is that of `jaxplan.sky.local_axes`: z points to nadir, y against the orbit's normal,
and x = y x z about along the velocity. It turns with the spacecraft, so a direction that is fixed in space
moves in it. On the globe it is drawn with nadir below, as seen by somebody who looks ahead with the Earth
under the feet and y to the right; elsewhere its two half spheres are drawn as two discs
(`jaxplan.plotting.projections.TwoDiscs`) on a background of rings, directions, and the Earth about nadir.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import ArrayLike

from jaxplan import sky
from jaxplan.geometry.vectors import azimuth_elevation
from jaxplan.planner import Plan
from jaxplan.plotting.projections import GlobeView, TwoDiscs
from jaxplan.plotting.style import GREY, HALO, SMALL, Entries, Look
from jaxplan.runtime.arguments import expect_any
from jaxplan.sky.frames import EARTH_RADIUS

_ZENITH_UP_SIGNS = np.array([1.0, -1.0, -1.0])  # to turn the frame's axes to x ahead, y left, z to the zenith
_LOW_ORBIT_RATE = 1.2e-3  # rad/s: rate at which the frame of a spacecraft in low orbit turns
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


class Inertial:
    """Inertial axes; also the base class of axes that move.

    Attributes:
        moves: whether the axes turn in space.
        words: what titles say about the axes; empty for inertial ones.
    """

    moves: ClassVar[bool] = False
    words: ClassVar[str] = ""

    @property
    def rate(self) -> float:
        """Estimated rate, rad/s, at which a direction that is fixed in space turns in these axes."""
        return 0.0

    def end(self, plan: Plan) -> float:
        """Return the time, s, at which directions at the end of a plan are taken.

        It is the time at which the goal is met; 0 where no goal was found.
        """
        return 0.0 if plan.goal is None else plan.goal.time

    def seen(self, directions: np.ndarray, times: ArrayLike) -> np.ndarray:
        """Return inertial directions (..., 3) in these axes, which are the same directions at all times."""
        del times
        return directions

    def attitude(self, attitude: np.ndarray, time: float) -> np.ndarray:
        """Convert an attitude (3, 3), body to inertial at a time, s, to one from the body to these axes."""
        del time
        return attitude

    def view(self, azimuth: float, elevation: float) -> GlobeView:
        """Return the globe as seen from an azimuth and an elevation of the eye in these axes, rad."""
        return GlobeView.from_angles(azimuth, elevation)

    def facing(self, directions: np.ndarray) -> GlobeView:
        """Return the globe turned so that most of the directions (k, 3), in these axes, are in front."""
        return GlobeView.facing(directions)


@dataclass(frozen=True)
class Orbital(Inertial):
    """The local orbital frame of a spacecraft over the time of a plan.

    Attributes:
        observer: the spacecraft's orbit.
        epoch: UTC of the plan's start, time zero.
        moves: whether the axes turn in space.
        words: what titles say about the axes.
    """

    observer: sky.Satellite
    epoch: np.datetime64

    moves: ClassVar[bool] = True
    words: ClassVar[str] = ", in the local orbital frame"

    @property
    def rate(self) -> float:
        """Estimated rate, rad/s, at which a direction that is fixed in space turns in this frame."""
        return _LOW_ORBIT_RATE

    def end(self, plan: Plan) -> float:
        """Return when a plan's motion ends, s; 0 without a trajectory."""
        return 0.0 if plan.trajectory is None else plan.trajectory.duration

    def limb(self) -> float:
        """Return the angle, rad, between nadir and the Earth's limb at the epoch, for a spherical Earth."""
        place = sky.positions(self.observer, epoch=self.epoch, times=0.0)
        return float(np.arcsin(min(1.0, EARTH_RADIUS / float(np.linalg.norm(place)))))

    def turn(self, times: ArrayLike) -> np.ndarray:
        """Return rotations (..., 3, 3) from inertial axes to the frame at times (...), s from the epoch."""
        return sky.local_axes(self.observer, epoch=self.epoch, times=times)

    def seen(self, directions: np.ndarray, times: ArrayLike) -> np.ndarray:
        """Turn inertial directions into the frame.

        Args:
            directions: (3,) one direction for all times, or (k, ..., 3) with its own directions for each
                time; of any shape (..., 3) at a single time.
            times: () or (k,) s after the epoch.

        Returns:
            (..., 3) for a single time, (k, ..., 3) for several.
        """
        turn = self.turn(times)
        if np.ndim(times) == 0:
            return np.asarray(directions @ turn.T)
        every = np.broadcast_to(directions, (len(turn), 3)) if np.ndim(directions) == 1 else directions
        return np.asarray(np.einsum("kij,k...j->k...i", turn, every))

    def attitude(self, attitude: np.ndarray, time: float) -> np.ndarray:
        """Convert an attitude (3, 3), body to inertial at a time, s, to one from the body to the frame."""
        return np.asarray(self.turn(time) @ attitude)

    def view(self, azimuth: float, elevation: float) -> GlobeView:
        """Return the globe, zenith up, seen from an azimuth and elevation of the eye in the frame, rad."""
        return _to_orbital_view(GlobeView.from_angles(-azimuth, -elevation))

    def facing(self, directions: np.ndarray) -> GlobeView:
        """Return the globe, zenith up, turned so that most directions (k, 3) in the frame are in front."""
        return _to_orbital_view(GlobeView.facing(directions * _ZENITH_UP_SIGNS))


INERTIAL = Inertial()


def _to_orbital_view(view: GlobeView) -> GlobeView:
    """Convert a view in axes with z to the zenith to a view for directions in the orbital frame."""
    left, above = np.rad2deg(azimuth_elevation(view.axes[2]))
    where = "below" if above < 0 else "above"
    told = f"seen from azimuth {0 - left:.0f}, {abs(above):.0f} deg {where} the horizontal"
    return GlobeView(view.axes * _ZENITH_UP_SIGNS, f"{told} (orbital frame, zenith up)")


def frame_of(plan: Plan, frame: object, observer: object) -> Inertial:
    """Return the axes that a figure's arguments `frame` and `observer` ask for.

    Args:
        plan: the plan that is drawn.
        frame: "inertial" or "orbital".
        observer: the spacecraft's orbit, needed for "orbital"; None for "inertial".

    Raises:
        TypeError: if the observer is no orbit.
        ValueError: if there is no such frame, an orbit is given for "inertial", or the orbit, the plan's
            epoch or its trajectory is missing for "orbital".
    """
    if frame not in ("inertial", "orbital"):
        raise ValueError(f"frame = {frame!r}: must be 'inertial' or 'orbital'")
    if frame == "inertial":
        if observer is not None:
            raise ValueError("observer: frame 'inertial' asks for no orbit, frame = 'orbital' does")
        return INERTIAL
    return orbit_of(plan, observer, "frame = 'orbital'")


def orbit_of(plan: Plan, observer: object, asked: str) -> Orbital:
    """Return the local orbital frame of a plan; raises as `frame_of` does for "orbital".

    Args:
        plan: the plan that is drawn.
        observer: the spacecraft's orbit.
        asked: what needs the frame, for the messages of errors.
    """
    if observer is None:
        raise ValueError(
            f"{asked}: needs observer, the spacecraft's orbit, since a plan does not hold it: one of jp.sky, "
            "or jp.load_observer(file) of a scene with [sky]"
        )
    expect_any("observer", observer, get_args(sky.Satellite), "an orbit, as those of jp.sky")
    orbit: Any = observer
    if plan.trajectory is None:
        raise ValueError(f"{asked}: the plan of {plan.scenario.name!r} has no trajectory to draw")
    if plan.scenario.epoch is None:
        raise ValueError(
            f"{asked}: the scene {plan.scenario.name!r} has no epoch: give it epoch_utc, or [sky]"
        )
    return Orbital(orbit, plan.scenario.epoch)


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
