"""What a spline fit is about: the system in its chart, the mesh of the spline, the nodes of the path."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jaxplan.model.constraints import Constraints
from jaxplan.model.limits import Limit, timed_limits
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.sights import Sights
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import options, schedule
from jaxplan.trajectory.chart import Chart
from jaxplan.trajectory.schedule import TrapezoidalProfile, duration_bound
from jaxplan.trajectory.splines import Basis


@dataclass(frozen=True, kw_only=True, eq=False)
class System:
    """A spacecraft in its chart, with its limits and constraints: all that does not change in a search.

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
        """Limits of rates and accelerations of the joints."""
        return self._timed[1]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names (Q,) of the platform's quantities that are limited."""
        return tuple(limit.quantity.name for limit in self._timed[0])

    @cached_property
    def limits(self) -> np.ndarray:
        """Limits (Q, 3) of the platform's quantities, in time."""
        return self.share * np.stack([limit.bound for limit in self._timed[0]])

    @cached_property
    def powers(self) -> np.ndarray:
        """Powers (Q,) of 1 / duration in the platform's quantities."""
        return np.array([limit.quantity.power for limit in self._timed[0]])

    @property
    def inertia(self) -> np.ndarray:
        """Inertia (3, 3) kg m^2, body axes; where none is given, none is needed."""
        given = self.spacecraft.inertia
        return np.eye(3) if given is None else np.asarray(given, float)

    @cached_property
    def sights(self) -> Sights:
        """What the constraints bind, D of them."""
        return self.cones.sights(self.spacecraft.mounts, np.asarray(self.spacecraft.fixed_boresights, float))

    def axes(self, places: np.ndarray) -> np.ndarray:
        """Axes (S, Z, 3) of the rows at places (S,) in [0, 1], inertial unless they are of the body."""
        return self.cones.axes(np.minimum(places, 1.0) * self.horizon)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Where a spline has its breaks, and where it passes the nodes.

    Attributes:
        places: (m + 1,) of the nodes in [0, 1].
        basis: of the splines.
        points: places on each interval at which loads and margins are looked at.
        radius: rad, of the tube about the nodes; 0 to pass them exactly, inf for none.
        flank: share of the duration about which breaks lie close; NaN where they do not.
    """

    places: np.ndarray
    basis: Basis
    points: int
    radius: float
    flank: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FitProblem:
    """What is fitted: the nodes of a path with all that is asked of the curve; all attempts share it.

    Attributes:
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n) rad.
        turns: (m, 3) rad, rotation of each edge in the axes of its first node.
        fractions: (m + 1,) times of the nodes over the duration, None for those of the profile.
        rates: (2, 3 + 2n) rad/s at start and end, of body axes and joints.
        spacecraft: its limits.
        cones: the pointing constraints.
        settings: of step 3.
        horizon: s, when axes that move are taken to be where they are at the end.
    """

    attitudes: np.ndarray
    joints: np.ndarray
    turns: np.ndarray
    fractions: np.ndarray | None
    rates: np.ndarray
    spacecraft: Spacecraft
    cones: Constraints
    settings: TrajectorySettings
    horizon: float = 0.0

    @property
    def at_speed(self) -> bool:
        """Whether the motion starts or ends with a rate."""
        return bool(np.any(self.rates))

    @property
    def rests(self) -> bool:
        """Whether accelerations are zero at both ends; else they are free."""
        return self.settings.end_acceleration == "zero"

    @property
    def resting(self) -> "FitProblem":
        """The same with accelerations of zero at both ends: what solves it solves this."""
        return self if self.rests else replace(self, settings=replace(self.settings, end_acceleration="zero"))

    @property
    def weights(self) -> tuple[float, float, float]:
        """Weights of rate, acceleration and jerk."""
        settings = self.settings
        return settings.rate_weight, settings.acceleration_weight, settings.jerk_weight

    def radius(self, free_time: bool) -> float:
        """Radius of the tube about the nodes, rad."""
        if self.settings.node_tube is not None:
            return float(self.settings.node_tube)
        return np.inf if free_time else options.ROWS.tube_radius

    @cached_property
    def bound(self) -> float:
        """No motion between the two ends is quicker, s."""
        ends = [0, -1]
        return duration_bound(
            self.spacecraft, self.attitudes[ends], self.joints[ends], self.rates[:, :3], self.rates[:, 3:]
        )

    @cached_property
    def times(self) -> np.ndarray:
        """(m,) s of each edge at full speed."""
        return np.asarray(schedule.edge_times(self.turns, np.diff(self.joints, axis=0), self.spacecraft))

    @cached_property
    def rise(self) -> float:
        """In which the axis with the longest way reaches its full rate, s."""
        return float(schedule.rise_time(self.turns, np.diff(self.joints, axis=0), self.spacecraft))

    @property
    def least_length(self) -> float:
        """What a path of next to no length is taken for, s at full speed."""
        return max(self.bound / 100, 1e-6 * self.rise)

    def quickest(self) -> TrapezoidalProfile:
        """The pace at full speed along the path."""
        return TrapezoidalProfile.quickest(max(float(np.sum(self.times)), self.least_length), self.rise)

    def mesh(self, profile: TrapezoidalProfile, radius: float, finer: int, *, graded: bool) -> Mesh:
        """Where the spline has its breaks, for a pace along the path.

        Args:
            profile: along the path.
            radius: rad, of the tube.
            finer: factor on the number of intervals.
            graded: whether breaks lie close about the flanks, not as the nodes do.
        """
        count = len(self.attitudes) - 1
        shares = schedule.node_fractions(self.times)
        if self.fractions is not None:
            places = self.fractions
        else:
            places = shares if self.at_speed else profile.places(shares)
        each = (
            options.MESH.intervals_per_node
            if radius == 0
            else options.MESH.intervals_per_tube
            if np.isfinite(radius)
            else 0.0
        )
        flank = np.nan
        intervals = (
            finer * options.MESH.intervals * max(1, int(np.ceil(each * count / options.MESH.intervals)))
        )
        if radius == 0:  # as many breaks between nodes as there are elsewhere
            basis = Basis.on(np.interp(np.linspace(0, count, intervals + 1), np.arange(count + 1), places))
        elif graded and not self.at_speed:
            basis, flank = Basis.on(profile.breaks(intervals)), float(profile.flank_share)
        else:
            basis = Basis.even(intervals)
        points = options.MESH.points if intervals < options.MESH.many else options.MESH.few_points
        return Mesh(places=places, basis=basis, points=points, radius=radius, flank=flank)


@dataclass(frozen=True, kw_only=True, eq=False)
class AttemptRequest:
    """What one attempt is to look for.

    Attributes:
        problem: what is fitted.
        mesh: breaks of the spline, times of the nodes, and the tube about them.
        duration: s, given or to begin with.
        limited: whether limits are kept, or time will be stretched to them.
        free_time: whether the shortest duration is looked for.
        tighter: share of the platform's limits that is left; joints are held at every instant anyway.
        begin: (n, A) coefficients of the curve to begin with; None for the one nearest to the path.
    """

    problem: FitProblem
    mesh: Mesh
    duration: float
    limited: bool
    free_time: bool
    tighter: float = 0.0
    begin: np.ndarray | None = None
