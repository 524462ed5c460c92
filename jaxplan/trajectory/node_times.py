"""When a motion passes the nodes of a path, and the trapezoidal pace along it.

A path has m + 1 nodes and m edges. The duration is divided among the edges by their costs, which are the
times that they take at full speed; equal costs give the equal split of the paper. An edge of little cost
still gets a tenth of the mean, so that two near nodes with a corner between them do not ask for a jolt.
Successive nodes without motion between them count as one.

For the spline fit the *length* of a path is the time in s that its edges take at full speed. The motion along
it has a trapezoidal profile of the rate (the *pace*), with a rising and a falling *flank*, in which it
accelerates and brakes; between them it cruises. Where the motion starts or ends with a rate the flank begins
or ends with as much of it as leads along the path. In a shortest motion the slowest joint moves in just this
way, so the spline's breaks lie close together near the flanks, and few suffice between them. A *place* is a
fraction of the duration, from 0 to 1.
"""

from dataclasses import dataclass, replace

import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, length, max_along, min_along
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.limits import limits, timed_limits
from jaxplan.model.path import Path
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.batching import padded_count

_CALM_FLANK_SHARE = 1 / 3  # of the duration, each flank if there is time; near the least acceleration energy
_STEEP_FLANK_SHARE = 0.1  # of the duration, the least flank if time is short
_STEEP_FLANK_RISES = 2.0  # times the shortest time to full speed, the least flank likewise
_FLANK_INTERVALS = 9  # intervals that cover a flank and a little more
_FLANK_STEP = 0.25  # of the flank, length of one such interval at most
FIRST_GUESS = 1.01  # first guess of a duration, over that of the trapezoid, whose accelerations jump

FEWEST_NODES = 32  # smallest number that nodes are padded to

_MIN_NORM = 1e-9  # least length of a row of the wheel array that is divided by

_MIN_EDGE_SHARE = 0.1  # of the mean edge's time, the least that an edge gets
_SAME_NODE_TOLERANCE = 1e-10  # rad, or difference of matrix elements, up to which nodes are the same


def _distinct_nodes(path: Path) -> np.ndarray:
    """Bool for each of m + 1 nodes of a path, whether it differs from the one before; true for the first."""
    turned = np.abs(np.diff(path.attitudes, axis=0)).max(axis=(1, 2), initial=0.0)
    moved = np.abs(np.diff(path.joints, axis=0)).max(axis=1, initial=0.0)
    same = (turned <= _SAME_NODE_TOLERANCE) & (moved <= _SAME_NODE_TOLERANCE)  # a NaN is not the same
    return np.concatenate([[True], ~same])


def passed_nodes(path: Path, *, at_speed: bool, every: bool) -> tuple[Path, np.ndarray]:
    """Remove repeated nodes from a path; what remains has at least two nodes unless nothing moves.

    Args:
        path: with m + 1 nodes.
        at_speed: whether the motion starts or ends with a rate: then it leaves even a single node, and comes
            back to it, so that the node is listed twice.
        every: whether repeated nodes are kept, unless nothing moves.

    Returns:
        The path, of one node if nothing moves, and (m + 1,) the index there of each given node.
    """
    kept = _distinct_nodes(path)
    if not at_speed and np.sum(kept) == 1:
        every = False
    elif len(kept) == 1:
        twice = np.zeros(2, dtype=int)
        both = Path(attitudes=path.attitudes[twice], joints=path.joints[twice], edge_costs=np.ones(1))
        return both, np.zeros(1, dtype=int)
    else:
        kept[-1] |= np.sum(kept) == 1
    kept |= every
    passed = Path(
        attitudes=np.asarray(path.attitudes, float)[kept],
        joints=np.asarray(path.joints, float)[kept],
        edge_costs=np.asarray(path.edge_costs, float)[kept[1:]],
    )
    return passed, np.cumsum(kept) - 1


def node_fractions(edge_costs: AnyArray, on: AnyArray | None = None) -> AnyArray:
    """Divide the duration among edges in proportion to their costs.

    Args:
        edge_costs: (m,) finite and not negative, m >= 1; those below a tenth of the mean count as that, and
            all count as equal if all are zero.
        on: (m,) bool, the edges that count; the others, at the end, are padding. None for all.

    Returns:
        (m + 1,) times of the nodes over the duration, strictly increasing from 0 to 1; 1 at padding.
    """
    xp, costs = arrays(edge_costs)
    own = xp.ones(len(costs), bool) if on is None else on
    mean = xp.sum(xp.where(own, costs, 0)) / xp.sum(own)
    shares = xp.maximum(costs / xp.where(mean > 0, mean, 1), xp.where(mean > 0, _MIN_EDGE_SHARE, 1.0))
    if xp is np and np.all(np.abs(shares - shares[0]) <= 1e-12 * shares[0]):
        return np.linspace(0.0, 1.0, len(shares) + 1)
    ends = xp.cumsum(xp.concatenate([xp.zeros(1, costs.dtype), xp.where(own, shares, 0)]))
    return xp.where(ends < ends[-1], ends / ends[-1], 1.0)  # exactly, since `places` has a root there


def edge_times(turns: AnyArray, moves: AnyArray, craft: Spacecraft) -> AnyArray:
    """Times (m,) in s that edges take at full speed, cruising all the way.

    Args:
        turns: (m, 3) rad, rotation vector of the platform along each edge, in the axes of its first node.
        moves: (m, 2n) rad, of the joints.
        craft: its limits of rates and momentum.
    """
    # Each edge is passed in one second at a steady pace, which is then slowed to the limits. Wheels count
    # as if they held nothing at the start: what they hold then fills them more on one edge, less on another.
    # How stages are turned, and what momentum they carry, is ignored.
    steady = Kinematics(spin=[turns.T], joints=[0 * moves.T, moves.T], inertia=craft.whole_inertia)
    if craft.wheel_array is not None:
        empty = craft.wheel_array
        empty = empty._replace(apart=0 * empty.apart)
        steady = steady._replace(total=0 * turns.T, array=empty)
    shares = [limit.shares(steady) for limit in limits(craft) if limit.quantity.power == 1]
    xp = array_module(*shares)
    return max_along(xp.concatenate(shares), 0)


def end_paces(turns: AnyArray, moves: AnyArray, times: AnyArray, rates: AnyArray, last: AnyArray) -> AnyArray:
    """Paces (2,) at both ends of a path over that at full speed: how far rates there lead along its edges.

    Args:
        turns: (m, 3) rad, as of `edge_times`.
        moves: (m, 2n) rad, likewise.
        times: (m,) s, of the edges.
        rates: (2, 3 + 2n) rad/s at start and end, of body axes and joints.
        last: index of the last edge; those after it are padding.
    """
    xp, turns, moves, times, rates = arrays(turns, moves, times, rates)
    edges = xp.stack([xp.concatenate([turns[edge], moves[edge]]) for edge in (0, last)])
    square = xp.sum(edges * edges, axis=1)
    full = xp.stack([times[0], times[last]])  # s, in which the edge is passed at full speed
    return full * xp.sum(edges * rates, axis=1) / xp.where(square > 0, square, 1)


def rise_time(turns: AnyArray, moves: AnyArray, craft: Spacecraft) -> AnyArray:
    """Time in s in which the axis that moves longest reaches its full rate; arguments as of `edge_times`."""
    rate, acceleration, jerk = (axis_bounds(craft, power) for power in (1, 2, 3))
    xp, turned, moved, rate, acceleration = arrays(turns, moves, rate, acceleration)
    needed = rate / acceleration + acceleration / jerk
    ways = xp.sum(xp.abs(xp.concatenate([turned, moved], axis=1)), axis=0)
    return needed[xp.argmax(ways / rate)]


def turn_time(turn: np.ndarray, craft: Spacecraft) -> float:
    """Time in s of a turn about one axis at full speed and acceleration, from rest to rest.

    Wheels count as if they held nothing at the start.

    Args:
        turn: (3,) rad, rotation vector in body axes.
        craft: its limits of rates, accelerations, momentum and torque.
    """
    still = np.zeros((1, len(craft.joint_names)))
    # As in `edge_times`, in one second, but at a steady acceleration from rest.
    begun = Kinematics(
        spin=[np.zeros((3, 1)), turn[:, None], np.zeros((3, 1))],
        inertia=craft.whole_inertia,
        total=np.zeros((3, 1)),
        array=craft.wheel_array,
    )
    shares = [limit.shares(begun) for limit in timed_limits(craft)[0] if limit.quantity.power == 2]
    length, share = float(edge_times(turn[None], still, craft)[0]), float(np.max(np.concatenate(shares)))
    return float(TrapezoidalProfile.quickest(length, share / length).duration) if length else 0.0


def axis_bounds(craft: Spacecraft, power: int) -> AnyArray:
    """Bounds (3 + 2n,) on a derivative of the motion, about each body axis and of each joint; inf for none.

    A torque limit is converted with the largest principal moment of inertia, for every axis. Limits on
    momentum are left to `edge_times`, which knows the axis of each edge.

    Args:
        craft: its limits.
        power: 1 for rates (rad/s), 2 for accelerations (rad/s^2), 3 for jerks (rad/s^3).
    """
    bounds = [limit.bound for limit in limits(craft)]
    xp = array_module(craft.inertia, *bounds)
    platform, joints = xp.full(3, np.inf), xp.full(len(craft.joint_names), np.inf)
    heaviest = 1.0 if craft.inertia is None else xp.linalg.norm(xp.asarray(craft.whole_inertia), 2)
    for limit, bound in zip(limits(craft), bounds, strict=True):
        quantity = limit.quantity
        if quantity.power != power or (quantity.by_inertia and power == 1):
            continue
        if quantity.of_joints:
            joints = bound
        else:
            if quantity.of_wheels:  # the radius of a ball within their limits, which holds in all directions
                bound = bound / xp.maximum(length(craft.wheel_array.rows), _MIN_NORM)  # type: ignore[union-attr]
            platform = xp.minimum(platform, min_along(bound, 0) / heaviest if quantity.by_inertia else bound)
    return xp.concatenate([platform, joints])


def edge_turns(attitudes: np.ndarray) -> np.ndarray:
    """Compute the rotation along each edge.

    Args:
        attitudes: (m + 1, 3, 3) body to inertial.

    Returns:
        (m, 3) rad, rotation vectors in the axes of each edge's first node.
    """
    return np.asarray(so3.log(np.swapaxes(attitudes[:-1], -1, -2) @ attitudes[1:]))


def padded(array: np.ndarray, least: int) -> np.ndarray:
    """Pad an array to one of few lengths by repeating its last entry, so that few kernels are compiled.

    Args:
        array: (k, ...), k at least 1.
        least: the smallest length, see `padded_count`.
    """
    extra = padded_count(len(array), least) - len(array)
    return np.concatenate([array, np.repeat(array[-1:], extra, axis=0)])


@dataclass(frozen=True, kw_only=True, eq=False)
class TrapezoidalProfile:
    """A trapezoid of the rate over time along a path; its numbers may be arrays that JAX traces.

    Attributes:
        length: of the path, s at full speed.
        duration: s.
        flank: s, duration of each of the two flanks.
        ends: (2,) rates at both ends over the mean rate, in [0, 1]; None for rest at both.
    """

    length: AnyArray
    duration: AnyArray
    flank: AnyArray
    ends: AnyArray | None = None

    @classmethod
    def quickest(cls, length: AnyArray, rise: AnyArray) -> "TrapezoidalProfile":
        """The quickest profile: it reaches full speed in ``rise`` seconds, or less speed on a short path.

        Args:
            length: of the path, s at full speed.
            rise: s.
        """
        xp, length, rise = arrays(length, rise)
        full, least = length >= rise, 2 * _safe_sqrt(length * rise)
        duration = xp.where(full, length + rise, least)
        return cls(length=length, duration=duration, flank=xp.where(full, rise, least / 2))

    @classmethod
    def within(cls, duration: AnyArray, length: AnyArray, rise: AnyArray) -> "TrapezoidalProfile":
        """The profile of a given duration: if there is time, at most half the full speed and long flanks.

        Args:
            duration: s.
            length: of the path, s at full speed.
            rise: s, shortest time in which full speed is reached.
        """
        xp, duration, length, rise = arrays(duration, length, rise)
        calm = _CALM_FLANK_SHARE * duration
        steepest = xp.maximum(_STEEP_FLANK_RISES * rise, _STEEP_FLANK_SHARE * duration)
        flank = xp.clip(duration - 2 * length, xp.minimum(steepest, calm), calm)
        flank = xp.where(duration > length + rise, xp.minimum(flank, duration - length), flank)
        return cls(length=length, duration=duration, flank=flank)

    def between(self, paces: AnyArray) -> "TrapezoidalProfile":
        """The profile with rates at its ends that are `paces` (2,) times full speed.

        They are cut to lie between rest and the mean rate: a motion that leads back at an end rests there.
        """
        xp, paces, length, duration = arrays(paces, self.length, self.duration)
        return replace(self, ends=xp.clip(paces * duration / length, 0.0, 1.0))

    @property
    def flank_share(self) -> AnyArray:
        """Fraction of the duration that a flank takes, on which alone the methods below depend."""
        return self.flank / self.duration

    def progress(self, places: np.ndarray) -> np.ndarray:
        """Fractions of the path that have been passed at places in [0, 1], of the same shape (S,)."""
        flank = self.flank_share
        begin, end = (0.0, 0.0) if self.ends is None else self.ends
        speed = (1 - flank * (begin + end) / 2) / (1 - flank)
        rising = begin * places + (speed - begin) * places**2 / (2 * flank)
        falling = 1 - end * (1 - places) - (speed - end) * (1 - places) ** 2 / (2 * flank)
        cruising = speed * (places - flank / 2) + begin * flank / 2
        return np.where(places < flank, rising, np.where(places > 1 - flank, falling, cruising))

    def places(self, shares: AnyArray) -> AnyArray:
        """Places in [0, 1] at which given fractions of the path are passed: the inverse of `progress`."""
        xp, shares, flank = arrays(shares, self.flank_share)
        if self.ends is None:  # the formulas below at rest, without rounding of their own
            speed = 1 / (1 - flank)
            low = _safe_sqrt(2 * flank * shares / speed)
            high = 1 - _safe_sqrt(2 * flank * (1 - shares) / speed)
            middle = shares / speed + flank / 2
        else:
            begin, end = self.ends[0], self.ends[1]
            speed = (1 - flank * (begin + end) / 2) / (1 - flank)
            low = _time_to_pass(shares, begin, (speed - begin) / flank)
            high = 1 - _time_to_pass(1 - shares, end, (speed - end) / flank)
            middle = (shares - begin * flank / 2) / speed + flank / 2
        return xp.where(low < flank, low, xp.where(high > 1 - flank, high, middle))

    def breaks(self, intervals: int) -> np.ndarray:
        """Make `intervals` + 1 breaks from 0 to 1, close together near the flanks.

        They are equidistant if there is next to no cruise.
        """
        flank = self.flank_share
        if 2 * flank < 0.9:
            near = np.arange(_FLANK_INTERVALS + 1) * min(_FLANK_STEP * flank, 1 / (3 * _FLANK_INTERVALS))
        else:  # no cruise: the acceleration changes its sign in the middle
            return np.linspace(0, 1, intervals + 1)
        middle = np.linspace(near[-1], 1 - near[-1], intervals + 1 - 2 * _FLANK_INTERVALS)
        return np.concatenate([near[:-1], middle, (1 - near)[-2::-1]])


def _time_to_pass(way: AnyArray, rate: AnyArray, acceleration: AnyArray) -> AnyArray:
    """Time in which a way is passed that begins at a rate and accelerates; neither is negative."""
    xp, way, rate = arrays(way, rate)
    rates = rate + _safe_sqrt(rate * rate + 2 * acceleration * way)
    return xp.where(rates > 0, 2 * way / xp.where(rates > 0, rates, 1), 0.0)


def _safe_sqrt(values: AnyArray) -> AnyArray:
    """Square roots of numbers, zero for those that are not positive; at zero the derivative is zero."""
    xp, values = arrays(values)
    positive = values > 0
    return xp.where(positive, xp.sqrt(xp.where(positive, values, 1)), 0)


def along(values: np.ndarray, shares: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Interpolate points on the straight lines between nodes.

    Args:
        values: (m + 1, A) of the nodes.
        shares: (m + 1,) parameters of the nodes, rising from 0 to 1, such as their places.
        gone: (S,) parameters of the points.

    Returns:
        (S, A).
    """
    return np.stack([np.interp(gone, shares, column) for column in values.T], axis=1)
