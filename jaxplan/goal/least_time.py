"""Find goals of least time: the attitudes that meet a problem and that platform and joints reach soonest.

What is minimised is a strict lower bound of the time from rest to rest, `jaxplan.model.duration_bound`: the
time that the slowest of platform and joints takes by itself. Least rotation leaves as much motion as possible
to the joints; where these are the slower ones, the platform turns toward them until both take equally long.
Descents (`minimax`) start from the points of the covering (`multistart`) at which that time is least, as far
as a solution may lie near them, and from the goals of least rotation. These are among the answers, so no
answer is slower than they are.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, length, max_along
from jaxplan.goal import multistart
from jaxplan.goal.aims import Aims
from jaxplan.goal.caps import Caps
from jaxplan.goal.descent import CLEAR
from jaxplan.goal.distances import Platform, Pointers, legendre
from jaxplan.goal.minimax import TIMES, Soonest, soonest_ends
from jaxplan.goal.problem import GoalProblem, Wished
from jaxplan.model.duration_bound import rest_bounds
from jaxplan.model.gimbals import angles_along, in_range, stacked
from jaxplan.model.limits import limits, longest
from jaxplan.model.path import Goal
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.turn_table import turn_table
from jaxplan.model.wheel_reach import WheelSpeeds, fitted_frames
from jaxplan.runtime.batching import padded_count

LANES = 64
"""Starts of a batch; most descents end in a few goals."""
STATIONARY = 1e-7
"""Largest residual of the conditions of optimality of an end that is a goal; beyond, see `SURE`."""
SURE = 2e-3
"""Share of the time by which an end that is not stationary must beat all that are, to be a goal."""
_RATIO_TOLERANCE = 1e-9  # relative difference below which ratios of rate to acceleration count as equal
_POLYNOMIAL_TERMS = (5, 4, 4)  # of the polynomials in place of tabulated shares: off by 0.4 % in the mean
INSTANT = 1e-9
"""s; where the goal of least rotation takes no longer than this, no other goals are looked for."""


def times(problem: GoalProblem, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Return strict lower bounds (N,) s of the time from rest at the start to rest at N states.

    Args:
        problem: the problem of step 1, with its start.
        attitudes: (N, 3, 3) body to inertial.
        joints: (N, J) rad.
    """
    turns = np.asarray(so3.log(problem.start.T @ attitudes))
    return np.asarray(rest_bounds(problem.spacecraft, turns, joints - problem.rest))


def likely_joints(problem: GoalProblem, attitudes: np.ndarray) -> np.ndarray:
    """Return likely joints (N, J) rad at N attitudes (N, 3, 3), regardless of zones.

    Devices point toward targets and wishes as far as their ranges allow; the others are at rest.
    """
    joints = np.clip(problem.joints(attitudes), *problem.ranges.T)
    for wish in problem.wishes:
        if wish.kind != "instrument":
            own = problem.spacecraft.gimbals.joints_of(wish.device)
            azimuth, elevation = angles_along(wish.frame[None], (wish.direction @ attitudes)[..., None, :])
            yaw = in_range(azimuth, wish.box[:1], problem.rest[own[:1]])
            angles = np.clip(np.concatenate([yaw, elevation], axis=-1), *wish.box.T)
            joints[:, own] = angles[:, : len(own)]
    return joints


def soonest(
    problem: GoalProblem, caps: Caps, nearest: np.ndarray, count: int, max_slew: float, seed: int
) -> np.ndarray:
    """Find the attitudes that are reached soonest.

    Args:
        problem: the problem of step 1.
        caps: the caps of the problem.
        nearest: (k, 4) unit quaternions from the start, the k local minima of the rotation, nearest first, at
            least one.
        count: how many attitudes are wanted at most.
        max_slew: rad, bound of the rotation.
        seed: seed of the covering of SO(3), see `multistart.covering_points`.

    Returns:
        (at most count, 4) unit quaternions of the rotation from the start, scalar first and not negative, 2
        deg or more apart, the quickest first. The nearest of all is among them where more than one is wanted.
    """
    if _least_times(problem, nearest)[0] <= INSTANT:
        return nearest
    starts = np.concatenate([nearest, _quickest_starts(problem, caps, LANES - len(nearest), seed)])[:LANES]
    ends = descended(problem, caps, starts)
    clear = (ends.excess <= CLEAR) & (multistart.slew(ends.quaternion) <= max_slew)
    found = np.concatenate([nearest, ends.quaternion[clear]])
    settled = np.concatenate([np.ones(len(nearest), bool), ends.residual[clear] <= STATIONARY])
    after = _least_times(problem, found)
    settled |= after < (1 - SURE) * np.min(after[settled])
    return _pick_distinct(found[settled], after[settled], nearest[0], count)


def by_time(problem: GoalProblem, goals: list[Goal]) -> list[Goal]:
    """Sort goals by their least times (`times`) with their joints, and equal times by their slews."""
    if not goals:
        return goals
    after = times(
        problem, np.stack([one.attitude for one in goals]), np.stack([one.joints for one in goals])
    ).tolist()
    ordered = sorted(zip(after, goals, strict=True), key=lambda own: (own[0], own[1].slew_angle))
    return [goal for _, goal in ordered]


def descended(problem: GoalProblem, caps: Caps, starts: np.ndarray) -> Soonest:
    """Run the descents of `minimax` from unit quaternions (at most `LANES`, 4) and return where they end."""
    unit = float(time_unit(problem.spacecraft))
    starts = np.resize(starts, (LANES, 4))
    asked = (caps.axis, caps.direction, caps.half_angle, caps.member, caps.group)
    moving = pointers(problem.spacecraft, problem.aims, problem.wishes, problem.start, problem.rest, unit)
    first = np.clip(_least_times(problem, starts) / unit, *TIMES)
    turning = platform(problem.spacecraft, unit)
    packed = np.asarray(soonest_ends(np.ascontiguousarray(starts.T), first, *asked, moving, turning))
    return Soonest(packed[:4].T, *packed[4:])


def time_unit(craft: Spacecraft) -> AnyArray:
    """Return the unit of time of the descents, s, which is about the time of half a turn."""
    rate, acceleration = longest(craft, 1), longest(craft, 2)
    return np.pi / rate + rate / acceleration


def pointers(
    craft: Spacecraft,
    aims: Aims,
    wishes: Sequence[Wished],
    start: AnyArray,
    rest: AnyArray,
    unit: AnyArray,
) -> Pointers:
    """Return the devices whose joints follow directions, padded with some that do not move.

    Args:
        craft: its devices and limits.
        aims: what must point where.
        wishes: directions that devices without a target are to be near to.
        start: (3, 3) attitude at the start, body to inertial.
        rest: (J,) rad, joints at the start.
        unit: s, unit of time of the rates and accelerations.
    """
    gimbals = craft.gimbals
    aimed = zip(aims.devices, aims.directions, aims.frames, aims.ranges, strict=True)
    each: list[Any] = [(*one, False) for one in aimed if one[0] < gimbals.count]
    each += [(w.device, w.direction, w.frame, w.box, True) for w in wishes if w.kind != "instrument"]
    own = [gimbals.joints_of(number) for number, *_ in each]
    spare = max(4, padded_count(len(each))) - len(each)
    _, directions, frames, ranges, cut = zip(*each, *[_PADDING_DEVICE] * spare, strict=True)

    def by_angle(values: AnyArray, other: float) -> AnyArray:
        """Return values (J,) of joints by device, azimuth then elevation (p, 2); `other` for no joint."""
        found = [[values[which[0]], values[which[1]] if len(which) > 1 else other] for which in own]
        flat = [value for pair in [*found, *[[other, other]] * spare] for value in pair]
        return stacked(flat).reshape(-1, 2)

    return Pointers(
        direction=stacked(directions) @ start,
        frame=stacked(frames),
        ranges=stacked(ranges),
        cut=np.array(cut),
        rest=by_angle(rest, 0.0),
        moves=np.array([[True, len(which) > 1] for which in own] + [[False, False]] * spare),
        rate=by_angle(craft.joint_rate_limits * unit, 1.0),
        acceleration=by_angle(craft.joint_acceleration_limits * unit**2, 1.0),
    )


_PADDING_DEVICE = (-1, np.array([1.0, 0.0, 0.0]), np.eye(3), np.array([[-1.0, 1.0], [-1.0, 1.0]]), False)


def platform(craft: Spacecraft, unit: AnyArray) -> Platform:
    """Return the lengths of turns of the platform and limits of their speeds, with `unit` s as unit of time.

    Limits of torque and momentum, those of wheels too, are converted to limits of acceleration and rate of
    each axis, for a body at rest with its joints at zero and wheels without momentum at the start.
    """
    given = {limit.quantity.name: limit.bound for limit in limits(craft)}
    xp, rate, acceleration = arrays(given["angular_velocity"], given["angular_acceleration"])
    if (inertia := craft.whole_inertia) is not None:
        xp, light, rate, acceleration = arrays(np.eye(3), rate, acceleration)
        light = xp.abs(array_module(inertia).linalg.inv(inertia))
        for name, power in (("wheel_momentum", 1), ("torque", 2)):
            if name in given and power == 1:
                rate = xp.minimum(rate, light @ given[name])
            elif name in given:
                acceleration = xp.minimum(acceleration, light @ given[name])
    norms, planes = [longest(craft, 1), longest(craft, 2)], [[np.inf] * 3] * 2
    fitted: list[tuple[AnyArray, AnyArray, AnyArray]] = []  # frames of boxes, with rates and accelerations
    if craft.wheels:
        own, every = WheelSpeeds.of(craft, 0.0, craft.whole_inertia), np.eye(3)
        xp, rate, acceleration, by_momentum, by_torque = arrays(
            rate, acceleration, own.rate(every), own.acceleration(every, 0.0)
        )
        rate, acceleration = xp.minimum(rate, by_momentum), xp.minimum(acceleration, by_torque)
        norms = [xp.minimum(norms[0], own.top(every)), xp.minimum(norms[1], own.growth(every, 0.0))]
        across = [every - np.outer(axis, axis) for axis in every]
        planes = [[own.top(plane) for plane in across], [own.growth(plane, 0.0) for plane in across]]
        frames = fitted_frames(craft)
        fitted = list(zip(frames, *own.boxes(frames, rate, acceleration, 0.0), strict=True))
    boxes = [rate, xp.sqrt(rate * acceleration), acceleration]
    if xp is np and np.ptp(rate / acceleration) <= _RATIO_TOLERANCE * np.max(rate / acceleration):
        boxes = boxes[:1]
    tables = [(np.eye(3), rate, acceleration, box) for box in boxes]
    tables += [(frame, top, growth, growth) for frame, top, growth in fitted]
    axes, of_rates, of_growths, sides = (stacked(parts) for parts in zip(*tables, strict=True))
    lengths = turn_table("box").lengths(sides)
    xp = array_module(axes, sides)
    tops, growths = (
        [
            *(
                xp.minimum(length(limit[np.arange(3) != axis]), xp.minimum(norm, by_wheels[axis]))
                for axis in range(3)
            ),
            norm,
        ]
        for limit, norm, by_wheels in zip((rate, acceleration), norms, planes, strict=True)
    )
    return Platform(
        axes=xp.swapaxes(xp.take_along_axis(axes, lengths.order[:, :, None], axis=1), 1, 2),
        rates=lengths.used,
        shares=_fit_shares(lengths.shares),
        top=stacked([*tops, *max_along(of_rates / sides, -1)]) * unit,
        growth=stacked([*growths, *max_along(of_growths / sides, -1)]) * unit**2,
    )


def _fit_shares(shares: AnyArray) -> AnyArray:
    """Fit tabulated shares of `turn_table` by polynomials, in the sense of least squares.

    Args:
        shares: (b, 3, A, L, L), of b tables at A angles and twice L ratios for each of three axes.

    Returns:
        (b, 3, i, j, k) coefficients of Legendre polynomials; i, j and k are `_POLYNOMIAL_TERMS`.
    """
    for count, terms in zip(shares.shape[2:], _POLYNOMIAL_TERMS, strict=True):
        shares = array_module(shares).tensordot(shares, _legendre_fit_matrix(count, terms), axes=(2, 1))
    return shares


@cache
def _legendre_fit_matrix(count: int, terms: int) -> np.ndarray:
    """Return the matrix (terms, count) from values at `count` places to Legendre coefficients.

    The places are evenly spaced from 0 to 1, ends included.
    """
    return np.linalg.pinv(np.stack(legendre(np.linspace(0, 1, count), terms), axis=1))


def _least_times(problem: GoalProblem, quaternions: np.ndarray) -> np.ndarray:
    """Return least times (K,) s of K rotations from the start, with joints from `likely_joints`.

    `quaternions` (K, 4) are of unit length, scalar first.
    """
    attitudes = problem.start @ quaternion.to_matrix(quaternions)
    return times(problem, attitudes, likely_joints(problem, attitudes))


def _quickest_starts(problem: GoalProblem, caps: Caps, count: int, seed: int) -> np.ndarray:
    """Return points (at most count, 4) of the covering near which a solution may lie, the quickest first."""
    points = multistart.covering_points(seed)
    possible = np.flatnonzero(multistart.depths(caps, seed) <= 0)
    first = np.argsort(_least_times(problem, points[possible]), kind="stable")[:count]
    return points[possible[first]]


def _pick_distinct(quaternions: np.ndarray, times: np.ndarray, nearest: np.ndarray, count: int) -> np.ndarray:
    """Return the quickest quaternions (at most count, 4) that are `multistart.APART` or more from each other.

    Args:
        quaternions: (K, 4) unit quaternions of K rotations from the start.
        times: (K,) s, least times of these.
        nearest: (4,) of the goal of least rotation, which takes the last place where it is not among them.
        count: how many are wanted at most.
    """
    slews = multistart.slew(quaternions)
    left = np.lexsort([slews, times])
    kept = np.empty((0, 4))
    while len(left) and len(kept) < count:
        best = quaternions[left[0]]
        kept = np.concatenate([kept, [best if best[0] >= 0 else -best]])
        left = left[np.abs(quaternions[left] @ best) < np.cos(multistart.APART / 2)]
    if count > 1 and np.all(np.abs(kept @ nearest) < np.cos(multistart.APART / 2)):
        kept[-1:] = nearest
    return kept
