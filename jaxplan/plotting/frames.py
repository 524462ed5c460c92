"""The axes in which directions are drawn: inertial ones, or the local orbital frame of a spacecraft.

The local orbital frame is that of `jaxplan.sky.local_axes`: z to nadir, y against the orbit's normal, and
x = y x z, about along the velocity. It turns with the spacecraft, so what stands still in space moves in it.
On the globe nadir is below, as for somebody who looks ahead with the Earth under the feet and y to the right;
elsewhere its half spheres are two discs (`jaxplan.plotting.projections.TwoDiscs`).
"""

from dataclasses import dataclass
from typing import Any, ClassVar, get_args

import numpy as np
from numpy.typing import ArrayLike

from jaxplan import sky
from jaxplan.geometry.vectors import azimuth_elevation
from jaxplan.planner import Plan
from jaxplan.plotting.projections import GlobeView
from jaxplan.runtime.arguments import expect_any
from jaxplan.sky.orbits import EARTH_RADIUS

_UPRIGHT = np.array([1.0, -1.0, -1.0])  # takes the frame's axes to those with x ahead and z to the zenith

_FASTEST = 1.2e-3  # rad/s: of a spacecraft in low orbit


class Inertial:
    """Axes that stand still."""

    moves: ClassVar[bool] = False
    words: ClassVar[str] = ""

    @property
    def rate(self) -> float:
        """About how fast what stands still in space turns in these axes, rad/s."""
        return 0.0

    def end(self, plan: Plan) -> float:
        """When a plan's goal is met, s; in axes that stand still only of one that moves."""
        return 0.0 if plan.goal is None else plan.goal.time

    def seen(self, directions: np.ndarray, times: ArrayLike) -> np.ndarray:
        """Directions (..., 3) in these axes; they do not depend on times."""
        del times
        return directions

    def attitude(self, attitude: np.ndarray, time: float) -> np.ndarray:
        """The rotation (3, 3) from the body to these axes at a time, s."""
        del time
        return attitude

    def view(self, azimuth: float, elevation: float) -> GlobeView:
        """The globe seen from an azimuth and elevation of the eye, rad."""
        return GlobeView.from_angles(azimuth, elevation)

    def facing(self, directions: np.ndarray) -> GlobeView:
        """The globe with most of the directions (k, 3) in front."""
        return GlobeView.facing(directions)


@dataclass(frozen=True)
class Orbital(Inertial):
    """The local orbital frame.

    Attributes:
        observer: the spacecraft's orbit.
        epoch: UTC of the plan's start.
    """

    observer: sky.Satellite
    epoch: np.datetime64

    moves: ClassVar[bool] = True
    words: ClassVar[str] = ", in the local orbital frame"

    @property
    def rate(self) -> float:
        """About how fast what stands still in space turns in the frame, rad/s."""
        return _FASTEST

    def end(self, plan: Plan) -> float:
        """When a plan's motion ends, s."""
        return 0.0 if plan.trajectory is None else plan.trajectory.duration

    def limb(self) -> float:
        """Angle of the Earth's limb from nadir at the epoch, rad, of an Earth that is a sphere."""
        place = sky.positions(self.observer, epoch=self.epoch, times=0.0)
        return float(np.arcsin(min(1.0, EARTH_RADIUS / float(np.linalg.norm(place)))))

    def turn(self, times: ArrayLike) -> np.ndarray:
        """The rotations (..., 3, 3) that take inertial directions to the frame at times (...), s."""
        return sky.local_axes(self.observer, epoch=self.epoch, times=times)

    def seen(self, directions: np.ndarray, times: ArrayLike) -> np.ndarray:
        """Directions in the frame.

        Args:
            directions: (3,) or (k, ..., 3) inertial; one for all times, or one for each of them.
            times: () or (k,) s.

        Returns:
            (..., 3) or (k, ..., 3).
        """
        turn = self.turn(times)
        if np.ndim(times) == 0:
            return np.asarray(directions @ turn.T)
        every = np.broadcast_to(directions, (len(turn), 3)) if np.ndim(directions) == 1 else directions
        return np.asarray(np.einsum("kij,k...j->k...i", turn, every))

    def attitude(self, attitude: np.ndarray, time: float) -> np.ndarray:
        """The rotation (3, 3) from the body to the frame at a time, s."""
        return np.asarray(self.turn(time) @ attitude)

    def view(self, azimuth: float, elevation: float) -> GlobeView:
        """The globe seen from an azimuth and elevation of the eye in the frame, rad, with the zenith up."""
        return _over(GlobeView.from_angles(-azimuth, -elevation))

    def facing(self, directions: np.ndarray) -> GlobeView:
        """The globe with most of the directions (k, 3) in front, and the zenith up."""
        return _over(GlobeView.facing(directions * _UPRIGHT))


INERTIAL = Inertial()


def _over(view: GlobeView) -> GlobeView:
    """A view of upright axes as one of the frame's, with the zenith up in the picture."""
    left, above = np.rad2deg(azimuth_elevation(view.axes[2]))
    where = "below" if above < 0 else "above"
    told = f"seen from azimuth {0 - left:.0f}, {abs(above):.0f} deg {where} the horizontal"
    return GlobeView(view.axes * _UPRIGHT, f"{told} (orbital frame, zenith up)")


def frame_of(plan: Plan, frame: object, observer: object) -> Inertial:
    """The axes that a figure's arguments ask for.

    Args:
        plan: that is drawn.
        frame: "inertial" or "orbital".
        observer: the spacecraft's orbit, of the latter alone.

    Raises:
        TypeError: if the observer is no orbit.
        ValueError: if there is no such frame, or what it needs is not known.
    """
    if frame not in ("inertial", "orbital"):
        raise ValueError(f"frame = {frame!r}: must be 'inertial' or 'orbital'")
    if frame == "inertial":
        if observer is not None:
            raise ValueError("observer: frame 'inertial' asks for no orbit, frame = 'orbital' does")
        return INERTIAL
    return orbit_of(plan, observer, "frame = 'orbital'")


def orbit_of(plan: Plan, observer: object, asked: str) -> Orbital:
    """The local orbital frame of a plan, for what is `asked`; raises as `frame_of` does."""
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
