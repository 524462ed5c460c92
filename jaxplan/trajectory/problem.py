"""The problem of a spline fit: the nodes of a path, what is asked of the curve, and its discretisation.

All attempts at a fit share its `FitProblem`. Each works on a `DiscreteProblem`: splines on one mesh, in one
chart of SO(3), evaluated at finitely many places. A *place* is a fraction of the duration, from 0 to 1. The
*tube* is a ball about each node, through which the curve has to pass. Letters of sizes are those of `motion`;
a path has m + 1 nodes, and 2n counts the joint angles (J in `motion`).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.constraints import Constraints, axes_in_body, counted, joint_values, pair_margins
from jaxplan.model.directions import Sights
from jaxplan.model.duration_bound import duration_bound, rest_bounds
from jaxplan.model.limits import (
    Limit,
    components,
    highest_derivative,
    lesser_components,
    timed_limits,
)
from jaxplan.model.scenario import MINIMUM, TrajectorySettings
from jaxplan.model.scores import room
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.batching import padded_count
from jaxplan.trajectory import node_times
from jaxplan.trajectory.chart import CHART_REACH, Chart, farthest, fitting
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.kernels import Body
from jaxplan.trajectory.node_times import TrapezoidalProfile, along
from jaxplan.trajectory.splines import Basis, CurveSpace

_MIN_INTERVALS = 32  # least number of intervals of a spline; more follow zones more closely, but cost time
_INTERVALS_PER_NODE = 1.5  # intervals per node that is passed exactly; fewer leave no freedom between nodes
_INTERVALS_PER_TUBE_NODE = 2 / 3  # intervals per node in a tube, which constrains less
_POINTS_PER_INTERVAL = 8  # places on each interval; with more, less is overlooked between them
_POINTS_PER_SHORT_INTERVAL = 4  # places on each interval where intervals are many, and so short
_MANY_INTERVALS = 128  # number of intervals from which on each has `_POINTS_PER_SHORT_INTERVAL`
_MIN_TUBE_NODES = 8  # least padded number of nodes in tubes; a larger one makes more fits alike
_SMOOTHING_WEIGHT = 1e-9  # weight of the third derivative beside the distance from the path, in first curves
_DEFAULT_TUBE_RADIUS = float(np.deg2rad(1.0))  # rad, of the tube about nodes, unless the settings give one
_CLEARANCE = float(np.deg2rad(0.3))  # rad, margin wanted at places, so that zones are kept between them
_BIND_FACTOR = 1.05  # factor on the platform's own least time; if the joints take longer, they alone bind
_LIGHT_RATIO = 1.05  # of the bounds without and with moving parts; up to it these parts are light
_END_MARGIN_SHARE = 0.5  # fraction of the margin at start or goal that is wanted elsewhere, at most

Timing = Literal["given", "stretched", "shortest"]
"""How the duration of a curve is determined: "given" by the settings; "stretched" to the limits, after a fit
that ignores them; "shortest", an unknown of the fit, as short as the limits allow."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Where a spline has its breaks, and at which places it passes the nodes.

    Attributes:
        places: (m + 1,) fractions of the duration, in [0, 1], at which the nodes are passed.
        basis: B-splines on the breaks.
        points: number of places on each interval between breaks at which loads and margins are evaluated.
        radius: rad, of the tube about the nodes; 0 to pass them exactly, inf for no tube.
        flank: fraction of the duration that a flank of the pace takes, if breaks lie close there; else NaN.
    """

    places: np.ndarray
    basis: Basis
    points: int
    radius: float
    flank: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FitProblem:
    """The nodes of a path with all that is asked of the curve.

    Attributes:
        attitudes: (m + 1, 3, 3) body to inertial, of the nodes.
        joints: (m + 1, 2n) rad, of the nodes.
        turns: (m, 3) rad, rotation vector of each edge in the body axes of its first node.
        fractions: (m + 1,) places of the nodes, given; None to derive them from the pace along the path.
        rates: (2, 3 + 2n) rad/s at start and end, of body axes and joints.
        spacecraft: its limits and geometry.
        cones: the pointing constraints.
        settings: of step 3.
        horizon: s; at place ``s``, axes that move are taken where they are at the time ``s * horizon``.
        near: a motion near which the shortest one is looked for, on its breaks; None for breaks of its own.
        at_most: s; a shortest motion that takes longer is of no use, so the search may give up there.
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
    near: Trajectory | None = None
    at_most: float = np.inf

    @property
    def at_speed(self) -> bool:
        """Whether any rate at the start or the end is not zero."""
        return bool(np.any(self.rates))

    @property
    def rests(self) -> bool:
        """Whether accelerations are required to be zero at both ends; otherwise they are free."""
        return self.settings.end_acceleration == "zero"

    @property
    def resting(self) -> "FitProblem":
        """The same problem with zero accelerations at both ends; its solutions solve this one, too."""
        return self if self.rests else replace(self, settings=replace(self.settings, end_acceleration="zero"))

    @property
    def stiff(self) -> "FitProblem":
        """The same problem as if the inertia stayed the same as joints move, if what they move is light."""
        return self._stiff or self

    @cached_property
    def _stiff(self) -> "FitProblem | None":
        """The stiff problem; None if no part that joints move has an inertia, or if one is not light."""
        if self.spacecraft.stages is None:
            return None
        other = replace(self, spacecraft=self.spacecraft.stiff)
        return other if other.bound <= _LIGHT_RATIO * self.bound else None

    @property
    def weights(self) -> tuple[float, float, float]:
        """Weights of the squares of rate, acceleration and jerk in the energy."""
        settings = self.settings
        return settings.rate_weight, settings.acceleration_weight, settings.jerk_weight

    @property
    def width(self) -> float:
        """Radius of the tube about the nodes in rad, for attempts that use a tube."""
        return tube_radius(self.settings)

    @property
    def radius(self) -> float:
        """Radius in rad of the tube asked for; inf for a shortest motion unless the settings give one."""
        free = self.settings.duration == MINIMUM and self.settings.node_tube is None
        return np.inf if free else self.width

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """Limits on the platform's loads, such as rates, accelerations, torques and wheel momenta."""
        return timed_limits(self.spacecraft)[0]

    @cached_property
    def joint_limits(self) -> tuple[Limit, ...]:
        """Limits on the rates and accelerations of the joints."""
        return timed_limits(self.spacecraft)[1]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the limited quantities of the platform."""
        return tuple(limit.quantity.name for limit in self.limits)

    @cached_property
    def components(self) -> list[slice]:
        """For each of `names`, the slice of its components among the C components of all loads."""
        return components(self.names, self.wheel_rows)

    @cached_property
    def lesser(self) -> list[slice | None]:
        """Slices of the lesser parts (see `kernels`) of each of `names` among all loads; None without."""
        return lesser_components(self.names, self.wheel_rows)

    @property
    def wheel_rows(self) -> int:
        """Number of rows of the wheel array; 0 without wheels."""
        array = self.spacecraft.wheel_array
        return 0 if array is None else len(array.rows)

    @cached_property
    def body(self) -> Body:
        """What the loads depend on: inertia, wheels, total momentum and gimbal stages."""
        return Body.of(self.spacecraft, self.joints[0], self.rates[0])

    @cached_property
    def sights(self) -> Sights:
        """The D sights, which are the directions that the constraints bind."""
        return self.cones.sights(self.spacecraft.gimbals, np.asarray(self.spacecraft.fixed_boresights, float))

    def axes(self, places: np.ndarray) -> np.ndarray:
        """Axes (S, Z, 3) of the Z rows of constraints at S places, each in the frame of its row."""
        return self.cones.axes(np.minimum(places, 1.0) * self.horizon)

    @cached_property
    def end_margins(self) -> np.ndarray:
        """Margins in rad at start and goal: (2, D, Z) for ends, sights and rows of the constraints.

        It is inf where a row does not bind a sight, and for all entries of a constraint but the best.
        """
        cones, ends = self.cones, [0, -1]
        joints = self.joints[ends]
        seen = self.sights.in_body(joints)
        axes = axes_in_body(cones, self.axes(np.array([0.0, 1.0])) @ self.attitudes[ends], seen)
        values = joint_values(cones, self.sights.gimbals, joints) if cones.inner else None
        margins = pair_margins(cones, seen, axes, values)
        kept = counted(cones, np.min(margins, axis=2, initial=np.inf))
        return np.asarray(np.swapaxes(np.where(kept[..., None], margins, np.inf), 1, 2))

    @cached_property
    def wanted(self) -> np.ndarray:
        """(D, Z) rad, margins to keep of each sight to each row of the constraints, see `wanted_margins`."""
        return np.asarray(wanted_margins(self.cones, np.min(self.end_margins, axis=0)))

    @cached_property
    def bound(self) -> float:
        """Strict lower bound in s of the duration of any motion between the two ends."""
        ends = [0, -1]
        return duration_bound(
            self.spacecraft, self.attitudes[ends], self.joints[ends], self.rates[:, :3], self.rates[:, 3:]
        ).seconds

    @cached_property
    def platform_binds(self) -> bool:
        """Whether the platform alone takes about as long as the joints do, or longer.

        Its bound from rest to rest is compared. With wheels, which are strong in few directions, that bound
        is loose; so the platform also counts as slow if a turn about one axis takes clearly longer than
        `bound`.
        """
        turn = so3.log(self.attitudes[0].T @ self.attitudes[-1])
        alone = rest_bounds(self.spacecraft, turn[None], np.zeros((1, self.joints.shape[1])))[0]
        slow = _BIND_FACTOR * self.bound
        if self.spacecraft.wheels and node_times.turn_time(turn, self.spacecraft) >= slow:
            return True
        return bool(_BIND_FACTOR * alone >= self.bound)

    @cached_property
    def times(self) -> np.ndarray:
        """(m,) s, time that each of the m edges takes at full speed."""
        return np.asarray(node_times.edge_times(self.turns, np.diff(self.joints, axis=0), self.spacecraft))

    @cached_property
    def rise(self) -> float:
        """Time in s in which the axis that moves longest accelerates to its full rate."""
        return float(node_times.rise_time(self.turns, np.diff(self.joints, axis=0), self.spacecraft))

    @property
    def least_length(self) -> float:
        """The least length that a path is taken to have, in s at full speed."""
        return max(self.bound / 100, 1e-6 * self.rise)

    @cached_property
    def quickest(self) -> TrapezoidalProfile:
        """The trapezoidal pace at full speed along the path, or as fast as a short path allows."""
        return TrapezoidalProfile.quickest(max(float(np.sum(self.times)), self.least_length), self.rise)

    def mesh(self, profile: TrapezoidalProfile, radius: float, finer: int, *, graded: bool) -> Mesh:
        """Make the mesh for a pace along the path.

        Args:
            profile: the pace, on which the places of nodes and flanks depend.
            radius: rad, of the tube; 0 to pass nodes exactly, inf for no tube.
            finer: factor on the number of intervals.
            graded: whether breaks lie close together near the flanks, else they are equidistant; without
                effect if nodes are passed exactly or the motion starts or ends with a rate.
        """
        count = len(self.attitudes) - 1
        if self.fractions is not None:
            places = self.fractions
        else:
            shares = node_times.node_fractions(self.times)
            places = shares if self.at_speed else profile.places(shares)
        each = _INTERVALS_PER_TUBE_NODE if np.isfinite(radius) else 0.0
        if radius == 0:
            each = _INTERVALS_PER_NODE
        intervals = finer * _MIN_INTERVALS * max(1, int(np.ceil(each * count / _MIN_INTERVALS)))
        flank = np.nan
        if radius == 0:  # as many breaks between nodes as there are elsewhere
            basis = Basis.on(np.interp(np.linspace(0, count, intervals + 1), np.arange(count + 1), places))
        elif graded and not self.at_speed:
            basis, flank = Basis.on(profile.breaks(intervals)), float(profile.flank_share)
        else:
            basis = Basis.even(intervals)
        points = _POINTS_PER_INTERVAL if intervals < _MANY_INTERVALS else _POINTS_PER_SHORT_INTERVAL
        return Mesh(places=places, basis=basis, points=points, radius=radius, flank=flank)


def tube_radius(settings: TrajectorySettings) -> Any:
    """Radius of the tube about the nodes in rad: that of the settings, or the default of 1 deg."""
    return _DEFAULT_TUBE_RADIUS if settings.node_tube is None else settings.node_tube


def wanted_margins(cones: Constraints, left: AnyArray) -> AnyArray:
    """Margins (D, Z) in rad that the curve is to keep: `_CLEARANCE`, or less where that is not possible.

    It is at most half of the margin at either end and at most half of the cone's own room, and never
    negative.

    Args:
        cones: the pointing constraints.
        left: (D, Z) rad, the smaller of the margins at the two ends.
    """
    xp, least, most = arrays(left, room(cones))
    # The room matters for rows of an entry that need not hold, since another entry holds at both ends.
    return xp.minimum(xp.minimum(_CLEARANCE, most), _END_MARGIN_SHARE * xp.maximum(least, 0))


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteProblem:
    """A fit in finitely many numbers: splines in a chart, evaluated at finitely many places.

    Attributes:
        problem: what is fitted.
        mesh: breaks of the splines, and the tube about the nodes.
        chart: of the platform's motion.
        nodes: (m + 1, A) rad, chart coordinates ``b`` and joint angles of the nodes.
        share: fraction of the limits on the platform's loads that may be used; the joints' may be used in
            full, since they are kept at every instant and not only at the places.
        timing: see `Timing`.
        space: the curves to choose from, with n spline coefficients on each of A axes.
        places: (S,) in [0, 1], where loads and margins are evaluated.
        rows: (4, S, n) values of the splines, and of their first three derivatives, at the places.
        tube_rows: (M, n) values of the splines at M nodes with a tube, padded with zeros so that more
            problems are alike; M is 0 where there is no tube.
        tube_values: (M, A) rad, these nodes, padded likewise.
        tube_radius: (A,) rad, for each axis; for the platform's three, of a cube within the ball.
        freed: whether the duration asked for is given, and is made free only until the limits are kept.
        to_the_end: whether a search goes on to the optimum, however little is to be gained.
    """

    problem: FitProblem
    mesh: Mesh
    chart: Chart
    nodes: np.ndarray
    share: float
    timing: Timing
    space: CurveSpace
    places: np.ndarray
    rows: np.ndarray
    tube_rows: np.ndarray
    tube_values: np.ndarray
    tube_radius: np.ndarray
    freed: bool = False
    to_the_end: bool = False

    @property
    def limited(self) -> bool:
        """Whether the fit itself has to keep limits of rates and loads."""
        return self.timing != "stretched"

    @property
    def free_time(self) -> bool:
        """Whether the duration is an unknown of the fit."""
        return self.timing == "shortest"

    @property
    def hastens(self) -> bool:
        """Whether a search for a shortest motion from rest to rest may end once little is left to gain."""
        return self.free_time and not self.freed and not self.to_the_end and not self.problem.at_speed

    @property
    def kind(self) -> tuple[Any, ...]:
        """Key of sizes and choices; only problems with equal keys can be put into one stack."""
        problem = self.problem
        return (
            self.rows.shape,
            self.space.free.shape,
            self.tube_rows.shape,
            problem.cones.bound.shape,
            problem.joints.shape[1],
            len(problem.spacecraft.drives),
            problem.names,
            problem.wheel_rows,
            None if problem.body.stages is None else problem.body.stages.turned,
            bool(problem.cones.paths),
            problem.cones.inner,
            len(problem.cones.carried),
            problem.at_speed,
            self.timing,
            self.hastens,
        )

    def nearest(self, duration: float) -> np.ndarray:
        """Coefficients (n, A) of the slightly smoothed curve nearest to the path, for a duration (s)."""
        space, rows = self.space, self.rows[0]
        wanted = along(self.nodes, self.mesh.places, self.places)
        start = space.fixed + duration * space.by_time
        design = rows @ space.free
        bending = space.free.T @ space.energies[3] @ space.free
        weight = _SMOOTHING_WEIGHT * len(bending) / np.trace(bending)
        pull = design.T @ (wanted - rows @ start) - weight * (space.free.T @ (space.energies[3] @ start))
        return start + space.free @ np.linalg.solve(design.T @ design + weight * bending, pull)

    def on_mesh(self, mesh: Mesh) -> "DiscreteProblem":
        """The same problem on another mesh, in the same chart."""
        nodes = self.problem.attitudes, self.problem.turns, mesh.places
        return _discretise_in_chart(
            self.problem, mesh, self.timing, self.share, self.chart, self.chart.coordinates(*nodes)
        )


def discretise(
    problem: FitProblem, mesh: Mesh, timing: Timing, *, share: float = 1.0
) -> DiscreteProblem | None:
    """Make the discrete problem that an attempt works on.

    Args:
        problem: what is fitted.
        mesh: breaks of the spline, places of the nodes, and the tube about them.
        timing: how the duration is determined.
        share: fraction of the limits on the platform's loads that may be used.

    Returns:
        The problem in the chart in which nodes lie nearest to a steady turn; None if one is beyond
        `CHART_REACH`.
    """
    chart, b = fitting(problem.attitudes, problem.turns, mesh.places)
    if not farthest(chart, b, mesh.places) <= CHART_REACH:
        return None
    return _discretise_in_chart(problem, mesh, timing, share, chart, b)


def _discretise_in_chart(
    problem: FitProblem, mesh: Mesh, timing: Timing, share: float, chart: Chart, b: np.ndarray
) -> DiscreteProblem:
    """Make the discrete problem in a chart in which the nodes have coordinates ``b`` (m + 1, 3), rad."""
    nodes, rates = np.column_stack([b, problem.joints]), problem.rates
    if np.any(rates[1, :3]):  # at the goal the chart has turned
        rates = rates.copy()
        rates[1, :3] = chart.end_turn @ rates[1, :3]
    inner, nobody = slice(1, -1), slice(0, 0)
    exact = inner if mesh.radius == 0 else nobody
    in_tube = inner if 0 < mesh.radius < np.inf else nobody
    radius = np.full(nodes.shape[1], mesh.radius)
    radius[:3] /= np.sqrt(3.0)  # an error of b bounds that of the attitude
    count, (size, axes) = len(nodes[in_tube]), (mesh.basis.size, nodes.shape[1])
    tube_rows, tube_values = (
        np.zeros((padded_count(count, _MIN_TUBE_NODES), width)) for width in (size, axes)
    )
    if count:
        tube_rows[:count] = mesh.basis.rows(mesh.places[in_tube], 1)[0]
        tube_values[:count] = nodes[in_tube]
    # At an end at rest without acceleration only loads that depend on the jerk may have their peak.
    to_end = highest_derivative(problem.names) > 2 or not problem.rests
    places, rows = mesh.basis.within(mesh.points, to_end=to_end)
    return DiscreteProblem(
        problem=problem,
        mesh=mesh,
        chart=chart,
        nodes=nodes,
        share=share,
        timing=timing,
        space=CurveSpace.of(
            mesh.basis, nodes[[0, -1]], rates, problem.rests, mesh.places[exact], nodes[exact]
        ),
        places=places,
        rows=rows,
        tube_rows=tube_rows,
        tube_values=tube_values,
        tube_radius=radius,
    )
