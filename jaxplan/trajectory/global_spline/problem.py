"""What does not change while a curve is looked for: chart, spacecraft with its limits, constraints."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jaxplan.model.constraints import Constraints, Sights
from jaxplan.model.limits import Limit, timed_limits
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory.global_spline.chart import Chart


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """What does not change while a curve is looked for.

    Attributes:
        chart: of the platform.
        spacecraft: its limits.
        cones: the pointing constraints.
        horizon: s, when axes that move are taken to be where they are at the end.
        share: of the limits on the platform's loads that may be taken.
    """

    chart: Chart
    spacecraft: Spacecraft
    cones: Constraints
    horizon: float = 0.0
    share: float = 1.0

    @cached_property
    def _timed(self) -> tuple[tuple[Limit, ...], tuple[Limit, ...]]:
        return timed_limits(self.spacecraft)

    @property
    def joint_limits(self) -> tuple[Limit, ...]:
        """Of rates and accelerations of the joints."""
        return self._timed[1]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(Q,) of the platform's loads: of the quantities that are limited."""
        return tuple(limit.quantity.name for limit in self._timed[0])

    @cached_property
    def limits(self) -> np.ndarray:
        """(Q, 3) of the platform's loads, in time."""
        return self.share * np.stack([limit.bound for limit in self._timed[0]])

    @cached_property
    def powers(self) -> np.ndarray:
        """(Q,) of 1 / duration in the platform's loads."""
        return np.array([limit.quantity.power for limit in self._timed[0]])

    @property
    def inertia(self) -> np.ndarray:
        """(3, 3) kg m^2, body axes; where none is given, none is needed."""
        given = self.spacecraft.inertia
        return np.eye(3) if given is None else np.asarray(given, float)

    @cached_property
    def sights(self) -> Sights:
        """What the constraints bind, D of them."""
        return self.cones.sights(self.spacecraft.mounts, np.asarray(self.spacecraft.fixed_boresights, float))

    def axes(self, places: np.ndarray) -> np.ndarray:
        """Axes (S, Z, 3) of the rows at places (S,) in [0, 1], inertial unless they are of the body."""
        return self.cones.axes(np.minimum(places, 1.0) * self.horizon)
