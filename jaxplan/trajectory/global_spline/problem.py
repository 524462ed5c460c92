"""What does not change while a curve is looked for: chart, spacecraft with its limits, constraints."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jax.typing import ArrayLike

from jaxplan.model.constraints import Constraints, Sights
from jaxplan.spacecraft import Spacecraft
from jaxplan.trajectory.global_spline.chart import Chart


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """What does not change while a curve is looked for.

    Attributes:
        chart: of the platform.
        spacecraft: its limits.
        cones: the pointing constraints.
        horizon: s, when axes that move are taken to be where they are at the end.
        limits: (Q, 3) of the platform's loads, in time.
        powers: (Q,) of 1 / duration in the loads.
        dynamic: whether torque and momentum are among the loads.
        jerky: whether the jerk is.
        names: (Q,) of the loads.
    """

    chart: Chart
    spacecraft: Spacecraft
    cones: Constraints
    horizon: float
    limits: np.ndarray
    powers: np.ndarray
    dynamic: bool
    jerky: bool
    names: tuple[str, ...]

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

    @classmethod
    def of(cls, chart: Chart, spacecraft: Spacecraft, cones: Constraints, horizon: float = 0.0) -> "Problem":
        """The problem of a spacecraft among zones; what has no limit is not looked at."""
        loads: list[tuple[str, ArrayLike, int]] = [
            ("rate", spacecraft.rate_limit, 1),
            ("acceleration", spacecraft.acceleration_limit, 2),
        ]
        actuators = (spacecraft.torque_limit, spacecraft.wheel_momentum_limit)
        dynamic = spacecraft.inertia is not None and any(limit is not None for limit in actuators)
        if dynamic:
            torque, momentum = (np.inf if limit is None else limit for limit in actuators)
            loads += [("torque", torque, 2), ("momentum", momentum, 1)]
        if spacecraft.jerk_limit is not None:
            loads.append(("jerk", spacecraft.jerk_limit, 3))
        names, limits, powers = zip(*loads, strict=True)
        return cls(
            chart=chart,
            spacecraft=spacecraft,
            cones=cones,
            horizon=horizon,
            limits=np.stack([np.broadcast_to(np.asarray(limit, float), 3) for limit in limits]),
            powers=np.array(powers),
            dynamic=dynamic,
            jerky=spacecraft.jerk_limit is not None,
            names=names,
        )
