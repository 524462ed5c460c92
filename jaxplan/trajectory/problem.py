"""What a spline fit is about, and the same in finitely many numbers that `sqp` works on.

What a spline fit is about: the system in its chart, the mesh of the spline, the nodes of the path.

From a path to the problem in finitely many numbers that `sqp` works on, and a first curve.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from jaxplan.model.constraints import Constraints, axes_in_body, counted, pair_margins, room
from jaxplan.model.directions import Sights
from jaxplan.model.limits import Limit, highest_derivative, timed_limits
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.batching import padded_count
from jaxplan.trajectory import options, schedule
from jaxplan.trajectory.chart import Chart, farthest, fitting
from jaxplan.trajectory.schedule import TrapezoidalProfile, along, duration_bound
from jaxplan.trajectory.splines import Basis, CurveSpace


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


@dataclass(frozen=True, eq=False)
class Tube:
    """Nodes that a curve must pass within a tube.

    Attributes:
        rows: (m, n) of the basis at the nodes.
        values: (m, A) rad.
        radius: (A,) rad, for each axis.
    """

    rows: np.ndarray
    values: np.ndarray
    radius: np.ndarray

    @property
    def padded_nodes(self) -> int:
        """What the number of nodes is padded to in a stack, so that more problems are alike."""
        return padded_count(len(self.rows), options.MESH.tube_nodes)


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteProblem:
    """A fit in finitely many numbers: curves of a space, looked at in some places.

    Attributes:
        system: chart, limits and zones.
        space: the curves.
        places: (S,) where loads and margins are looked at.
        rows: (4, S, n) of the basis there.
        wanted: (D, Z) rad, margins to keep.
        tube: about the nodes, or None.
        limited: whether limits of rates and loads are kept, or time will be stretched to them.
        weights: of the energy.
        free_time: whether the duration is looked for as well.
    """

    system: System
    space: CurveSpace
    places: np.ndarray
    rows: np.ndarray
    wanted: np.ndarray
    tube: Tube | None
    limited: bool
    weights: tuple[float, float, float]
    free_time: bool

    @property
    def kind(self) -> tuple[Any, ...]:
        """What the problems of one stack share."""
        system = self.system
        return (
            self.rows.shape,
            self.space.free.shape,
            self.wanted.shape,
            len(system.spacecraft.terminals),
            system.names,
            bool(system.cones.paths),
            system.cones.inner,
            len(system.cones.carried),
            None if self.tube is None else self.tube.padded_nodes,
            bool(np.any(self.space.by_time)),
            self.limited,
            self.free_time,
        )


def discretise(request: AttemptRequest) -> tuple[DiscreteProblem, np.ndarray] | None:
    """The problem for `sqp.improve`, and a curve to begin with.

    Args:
        request: what is looked for.

    Returns:
        The problem, and coefficients (n, A) of the spline nearest to the path; None if the nodes leave every
        chart.
    """
    problem, mesh = request.problem, request.mesh
    chart, b = fitting(problem.attitudes, mesh.places)
    if not farthest(chart, b, mesh.places) <= options.CHART.reach:
        return None
    system = System(
        chart=chart,
        spacecraft=problem.spacecraft,
        cones=problem.cones,
        horizon=problem.horizon,
        share=1 - request.tighter,
    )
    nodes = np.column_stack([b, problem.joints])
    space, places, rows = _curves(problem, system, mesh, nodes)
    discrete = DiscreteProblem(
        system=system,
        space=space,
        places=places,
        rows=rows,
        wanted=wanted_margins(system, problem.attitudes, problem.joints),
        tube=_tube(mesh, nodes),
        limited=request.limited,
        weights=problem.weights,
        free_time=request.free_time,
    )
    return discrete, _nearest(space, rows[0], along(nodes, mesh.places, places), request.duration)


def _curves(
    problem: FitProblem, system: System, mesh: Mesh, nodes: np.ndarray
) -> tuple[CurveSpace, np.ndarray, np.ndarray]:
    """The curves that may be chosen, and the places (S,) that are looked at with the rows there."""
    inner = slice(1, -1)
    space = CurveSpace.of(mesh.basis, nodes[[0, -1]], _rates(problem, system), rest=problem.rests)
    if mesh.radius == 0 and len(nodes) > 2:
        space = space.through(mesh.places[inner], nodes[inner])
    # At an end in rest with no acceleration only what is made of the jerk may be the largest there is.
    to_end = highest_derivative(system.names) > 2 or not problem.rests
    return space, *mesh.basis.within(mesh.points, to_end=to_end)


def on_mesh(problem: FitProblem, discrete: DiscreteProblem, mesh: Mesh) -> DiscreteProblem:
    """The same problem on a mesh with as many breaks a little elsewhere."""
    nodes = np.column_stack(
        [discrete.system.chart.coordinates(problem.attitudes, mesh.places), problem.joints]
    )
    space, places, rows = _curves(problem, discrete.system, mesh, nodes)
    return replace(discrete, space=space, places=places, rows=rows, tube=_tube(mesh, nodes))


def _rates(problem: FitProblem, system: System) -> np.ndarray:
    """Rates (2, A) rad/s of the coordinates at both ends: at the goal the chart has turned."""
    rates = problem.rates
    if np.any(rates[1, :3]):
        rates = rates.copy()
        rates[1, :3] = system.chart.end_turn @ rates[1, :3]
    return rates


def _tube(mesh: Mesh, nodes: np.ndarray) -> Tube | None:
    """The tube about the inner nodes, of the platform's axes a cube within the ball; None without one."""
    if len(nodes) == 2 or not 0 < mesh.radius < np.inf:
        return None
    radius = np.full(nodes.shape[1], mesh.radius)
    radius[:3] /= np.sqrt(3.0)  # what b is off bounds what the attitude is
    return Tube(mesh.basis.rows(mesh.places[1:-1], 1)[0], nodes[1:-1], radius)


def _nearest(space: CurveSpace, rows: np.ndarray, wanted: np.ndarray, duration: float) -> np.ndarray:
    """The curve nearest to points (S, A) at the places, a little smoothed."""
    start = space.fixed + duration * space.by_time
    design = rows @ space.free
    bending = space.free.T @ space.energies[3] @ space.free
    weight = options.MESH.smoothing * len(bending) / np.trace(bending)
    pull = design.T @ (wanted - rows @ start) - weight * (space.free.T @ (space.energies[3] @ start))
    return start + space.free @ np.linalg.solve(design.T @ design + weight * bending, pull)


def wanted_margins(system: System, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Margins to keep (D, Z), rad: no more than half of what the ends and the row itself leave."""
    least = np.maximum(np.min(end_margins(system, attitudes, joints), axis=0), 0)
    # The room is for rows of an entry beside which another one holds at both ends.
    return np.minimum(
        np.minimum(options.ROWS.clearance, room(system.cones)), options.ROWS.share_of_ends * least
    )


def end_margins(system: System, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Margins (2, D, Z) at start and goal of nodes, rad, as `Motion` has them."""
    cones, ends = system.cones, [0, -1]
    seen = system.sights.in_body(joints[ends])
    axes = axes_in_body(cones, system.axes(np.array([0.0, 1.0])) @ attitudes[ends], seen)
    margins = pair_margins(cones, seen, axes, joints[ends])
    kept = counted(cones, np.min(margins, axis=2, initial=np.inf))
    return np.asarray(np.swapaxes(np.where(kept[..., None], margins, np.inf), 1, 2))
