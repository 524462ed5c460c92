"""The problem of a spline fit: the nodes of a path, what is asked of the curve, and meshes for it.

All attempts at a fit share its `FitProblem`; each makes it finite on a mesh (`discretisation`). A *place* is
a fraction of the duration, from 0 to 1. The *tube* is a ball about each node, through which the curve has to
pass. Letters of sizes are those of `motion`; a path has m + 1 nodes, and 2n counts the joint angles (J in
`motion`).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, arrays
from jaxplan.model.constraints import Constraints, axes_in_body, counted, joint_values, pair_margins
from jaxplan.model.directions import Sights
from jaxplan.model.duration_bound import duration_bound, rest_bounds
from jaxplan.model.limits import (
    Limit,
    components,
    lesser_components,
    timed_limits,
)
from jaxplan.model.scenario import MINIMUM, TrajectorySettings
from jaxplan.model.scores import room
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import node_times
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.kernels import Body
from jaxplan.trajectory.node_times import TrapezoidalProfile
from jaxplan.trajectory.splines import Basis

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Where a spline has its breaks, and at which places it passes the nodes.

    Attributes:
        places: (m + 1,) fractions of the duration, in [0, 1], at which the nodes are passed.
        basis: B-splines on the breaks.
        points: number of places on each interval between breaks at which loads and margins are evaluated.
        radius: rad, of the tube about the nodes; 0 to pass them exactly, inf for no tube.
        flank: fraction of the duration that a flank of the pace takes, if breaks lie close there; else NaN.
        pace: on what the places depend: a trapezoid of the rate from "rest to rest", or with rates at the
            ends, "at speed"; "steady", in proportion to the edges' times at full speed; or "given".
    """

    places: np.ndarray
    basis: Basis
    points: int
    radius: float
    flank: float
    pace: str


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

    @cached_property
    def end_paces(self) -> np.ndarray:
        """(2,) paces along the path at its ends, over that at full speed, from the rates there."""
        moves = np.diff(self.joints, axis=0)
        return np.asarray(node_times.end_paces(self.turns, moves, self.times, self.rates, len(moves) - 1))

    @property
    def least_length(self) -> float:
        """The least length that a path is taken to have, in s at full speed."""
        return max(self.bound / 100, 1e-6 * self.rise)

    @cached_property
    def quickest(self) -> TrapezoidalProfile:
        """The trapezoidal pace at full speed along the path, or as fast as a short path allows."""
        return TrapezoidalProfile.quickest(max(float(np.sum(self.times)), self.least_length), self.rise)

    def pace_in(self, duration: float) -> TrapezoidalProfile:
        """The trapezoidal pace along the path in a given duration, s, with the rates at both ends."""
        profile = TrapezoidalProfile.within(duration, self.quickest.length, self.rise)
        return profile.between(self.end_paces) if self.at_speed else profile

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
        places, pace = self.fractions, "given"
        if places is None:
            places, pace = node_times.node_fractions(self.times), "steady"
            if not self.at_speed:
                places, pace = profile.places(places), "rest to rest"
            elif profile.ends is not None and radius > 0:
                places, pace = profile.places(places), "at speed"
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
        return Mesh(places=places, basis=basis, points=points, radius=radius, flank=flank, pace=pace)


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
