"""Strict lower bounds of the time that any motion takes within the limits of a spacecraft.

A *way* is a distance that a motion has to cover: a length of the platform's turn, or the change of a joint's
angle. Along each the motion has a speed, whose magnitude limits keep below a *top*, and whose rate of change
they keep below a *growth*, its largest acceleration. So a way takes at least the time of a trapezoid of the
speed, or of a triangle. Every way gives a lower bound of the duration, and the largest of them is used.

    way                        speed                             top, growth
    a joint's angle            its rate                          the joint's own limits
    length in a box            max of |w_i| / c_i                max of limit_i / c_i, also of accelerations
    angle of the turn          |w|                               limits of the lengths, or diagonals of boxes
    angle of a body axis       |w across it|                     diagonals of the two other axes' limits
    length by the energy       sqrt(w . J w)                     the largest over boxes; growth by torque too

`w` is the angular velocity in body axes; lengths of turns are those of `jaxplan.model.turn_table`. By J the
speed grows no faster than the largest ``sqrt(torque . J^-1 torque)``, since gyroscopic torques do no work.
In a box they count: from rest, ``w_i' <= a_i + g_i t^2``, with ``a = |J^-1| torque`` and ``g_i`` the largest
of ``|J^-1 (w x J w)|_i`` for the energy, or the momentum, that there can be after a second. Limits of
momentum are taken for limits of the rates.

Wheels give ``J w' + w x (R^T H)`` and hold ``R^T H - J w``, both within what the array reaches by its
allocation (`jaxplan.model.wheel_reach`); ``|H|`` is known from the start. So the rates are within ``J^-1``
times the reach of the momenta and ``|H|`` about it, accelerations within that of the torques and ``|w| |H|``,
and in the energy the torque that turns ``H`` does no work. Lengths of both, and of what lies across a body
axis, are at most those of the corners, which is less than the diagonals of boxes.

Any ``c`` is allowed; the limits of rates, those of accelerations and what lies between are tried.

No zone is in these bounds, nor jerk, nor that accelerations be continuous: they only add to the time.
Radians, seconds, body axes.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, length, separation
from jaxplan.model.limits import limits, longest
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.turn_table import turn_table
from jaxplan.model.wheel_reach import WheelSpeeds, total_length

_TELLING = 0.01  # share of the duration below which a bound says nothing, as of a path that ends at its start
_SAME = 1e-9  # relative difference below which the axes' ratios of acceleration to rate count as equal
_ROOTS = 12  # steps of Newton's method, which has then converged to rounding

_CORNERS = np.array([(1.0, *signs) for signs in product((1.0, -1.0), repeat=2)])
"""(4, 3) corners of the box of half widths one about zero, without their opposites."""

RATES = "rates and accelerations of the platform"
TORQUE = "rates, accelerations and torque of the platform"
ENERGY = "torque and inertia of the platform"


@dataclass(frozen=True, kw_only=True)
class DurationBound:
    """A strict lower bound of the duration.

    Attributes:
        seconds: s, no motion takes less.
        name: of the limits from which the bound follows.
    """

    seconds: float
    name: str


@dataclass(frozen=True, kw_only=True, eq=False)
class _Way:
    """A distance that a motion has to cover, and the limits of the speed along it.

    Its unit U is rad for angles, rad over that of the box for lengths in boxes, and rad (kg m^2)^1/2 for the
    length by the energy.

    Attributes:
        name: of the limits.
        distance: (...) U, with a sign where it has one.
        top: U/s, largest speed, or inf.
        growth: U/s^2, largest acceleration along the way.
        more_growth: U/s^4, by which that grows with the square of the time since rest; zero for a motion with
            rates at an end.
        speeds: (2,) U/s, at start and end; None from rest to rest.
        signed: whether the speed may be negative, as that of a joint.
    """

    name: str
    distance: AnyArray
    top: AnyArray
    growth: AnyArray
    more_growth: AnyArray = 0.0
    speeds: AnyArray | None = None
    signed: bool = False

    @property
    def rest_time(self) -> AnyArray:
        """Least time (...) s from rest to rest, with numpy or JAX."""
        xp, far, top, growth, more = arrays(self.distance, self.top, self.growth, self.more_growth)
        far = xp.abs(far)
        full = top / growth  # s, until the top is reached; from above, where Newton's method stays
        for _ in range(_ROOTS):
            full = full - (full * (growth + more * full**2 / 3) - top) / (growth + more * full**2)
        flanks = full**2 * (growth + more * full**2 / 6)  # covered by both of them
        moving = far > 0
        some = xp.where(moving, far, 1)
        square = 2 * some / (growth + xp.sqrt(growth**2 + 2 * more * some / 3))
        time = xp.where(far < flanks, 2 * xp.sqrt(square), 2 * full + (far - flanks) / top)
        return xp.where(moving, time, 0)

    @property
    def time(self) -> np.ndarray:
        """Least time between the speeds at both ends, (...) s; in numpy."""
        if self.speeds is None:
            return np.asarray(self.rest_time)
        first, last = self.speeds
        found = shortest_time(self.distance, first, last, self.top, self.growth)
        # speeds along a length are at least zero: on too short a one they cannot change within the growth
        short = 2 * self.growth * np.abs(self.distance) < np.abs(first**2 - last**2)
        return np.where(short & (not self.signed), np.abs(first - last) / self.growth, found)


def shortest_time(
    distance: np.ndarray, first: np.ndarray, last: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Least time of a motion on a line with bounded rate and acceleration.

    Args:
        distance: (...) rad, with its sign.
        first: (...) rad/s, rate at the start, within the limit.
        last: (...) rad/s, rate at the end, likewise.
        rate: (...) rad/s, the limit.
        acceleration: (...) rad/s^2, likewise.

    Returns:
        (...) s.
    """
    best = np.full(np.broadcast(distance, first, last, rate).shape, np.inf)
    for sign in (1, -1):  # which way it goes first
        d, v, w = sign * distance, sign * first, sign * last
        square = acceleration * d + (v**2 + w**2) / 2  # of the rate at the top of a triangle
        top = np.sqrt(np.maximum(square, 0))
        triangle = (2 * top - v - w) / acceleration
        coasting = (2 * rate - v - w) / acceleration + (square - rate**2) / (rate * acceleration)
        time = np.where(top <= rate, triangle, coasting)
        possible = (square >= 0) & (top >= np.maximum(v, w) * (1 - 1e-12) - 1e-15)
        best = np.minimum(best, np.where(possible, np.maximum(time, 0), np.inf))
    return best


def rest_bounds(spacecraft: Spacecraft, turns: ArrayLike, moves: ArrayLike) -> AnyArray:
    """Strict lower bounds of the time of motions from rest to rest.

    Args:
        spacecraft: its limits.
        turns: (N, 3) rad, rotation vectors of the platform in the axes that the body has at first.
        moves: (N, 2n + d) rad, of the joints.

    Returns:
        (N,) s. Derivatives are finite, and right almost everywhere; by the inertia the principal axes are
        taken to stay.
    """
    _, turned, moved = arrays(turns, moves)
    times = [way.rest_time for way in _ways_of_platform(spacecraft, turned)]
    times += [way.rest_time for way in _ways_of_joints(spacecraft, moved)]
    return _most(times)


def time_along(spacecraft: Spacecraft, attitudes: np.ndarray, joints: np.ndarray) -> float:
    """About how long a motion along a path takes, to compare paths: the slowest on each edge at top speed.

    A top speed that cannot be reached by accelerating along half of the path is lowered to what can.

    Args:
        spacecraft: its limits.
        attitudes: (m + 1, 3, 3) nodes, body to inertial.
        joints: (m + 1, 2n + d) rad.

    Returns:
        s, no bound.
    """
    turns = so3.log(np.swapaxes(attitudes[:-1], -1, -2) @ attitudes[1:])
    ways = [*_ways_of_platform(spacecraft, turns), *_ways_of_joints(spacecraft, np.diff(joints, axis=0))]
    slowest = np.zeros(len(turns))
    for way in ways:
        far = np.abs(way.distance)
        speed = np.minimum(way.top, np.sqrt(way.growth * max(np.sum(far), np.finfo(float).tiny)))
        slowest = np.maximum(slowest, far / speed)
    return float(np.sum(slowest))


def duration_bound(
    spacecraft: Spacecraft,
    attitudes: np.ndarray,
    joints: np.ndarray,
    angular_velocities: np.ndarray,
    joint_rates: np.ndarray,
) -> DurationBound:
    """Strict lower bound of the time of a motion between two states, with rates at either.

    Args:
        spacecraft: its limits.
        attitudes: (2, 3, 3) first and last, body to inertial.
        joints: (2, 2n + d) rad.
        angular_velocities: (2, 3) rad/s, body axes.
        joint_rates: (2, 2n + d) rad/s.

    Returns:
        The largest bound, with its name; of equal ones the first.
    """
    turn = so3.log(attitudes[0].T @ attitudes[1])
    spins = np.asarray(angular_velocities, float) if np.any(angular_velocities) else None
    ways = list(_ways_of_platform(spacecraft, turn, spins))
    ways += _ways_of_joints(spacecraft, np.subtract(joints[1], joints[0]), np.asarray(joint_rates, float))
    times = [float(way.time) for way in ways]
    slowest = int(np.argmax(times))
    return DurationBound(seconds=times[slowest], name=ways[slowest].name)


def excess(duration: float, bound: float) -> float | None:
    """Share by which a duration exceeds a bound, both in s; None where the bound is too low to matter."""
    return duration / bound - 1 if bound > _TELLING * duration else None


def _ways_of_joints(craft: Spacecraft, moves: AnyArray, rates: np.ndarray | None = None) -> Iterator[_Way]:
    """Yield the way of each joint, of changes (..., 2n + d) rad and rates (2, 2n + d) rad/s at both ends.

    Rates of None are zero.
    """
    tops, growths = craft.joint_rate_limits, craft.joint_acceleration_limits
    for number, name in enumerate(craft.joint_names):
        yield _Way(
            name=name,
            distance=moves[..., number],
            top=tops[number],
            growth=growths[number],
            speeds=None if rates is None else rates[:, number],
            signed=True,
        )


def _ways_of_platform(craft: Spacecraft, turns: AnyArray, spins: np.ndarray | None = None) -> Iterator[_Way]:
    """Yield the ways of the platform: those of the module's table but the first, each with its limits.

    Args:
        craft: its limits and inertia.
        turns: (..., 3) rad, rotation vectors from start to end, in the body axes of the start.
        spins: (2, 3) rad/s, angular velocities at start and end, body axes; None from rest to rest.
    """
    given = {limit.quantity.name: limit.bound for limit in limits(craft)}
    rate, acceleration = given["angular_velocity"], given["angular_acceleration"]
    norms, name = (longest(craft, 1), longest(craft, 2)), RATES
    if "wheel_momentum" in given:
        xp, inverse, momentum = arrays(_inverse(craft.inertia), given["wheel_momentum"])
        rate = xp.minimum(rate, xp.abs(inverse) @ momentum)
    across = None
    if craft.wheel_array is not None:
        own = WheelSpeeds.of(craft, total_length(craft, spins))
        yield _energy_way(craft.inertia, given, norms, turns, spins, own)
        xp, rate, acceleration, own_rate = arrays(rate, acceleration, own.rate)
        rate = xp.minimum(rate, own_rate)
        top = xp.minimum(xp.minimum(norms[0], length(rate)), own.top(np.eye(3)))
        acceleration = xp.minimum(acceleration, own.acceleration(top))
        norms, name = (top, xp.minimum(norms[1], own.growth(np.eye(3), top))), TORQUE
        planes = np.eye(3) - np.eye(3)[:, :, None] * np.eye(3)[:, None]
        across = [own.top(plane) for plane in planes], [own.growth(plane, top) for plane in planes]
    if "torque" in given:
        yield _energy_way(craft.inertia, given, norms, turns, spins)
        at_rest, gyroscopic, later = _accelerations_by_torque(craft.inertia, given["torque"])
        xp, acceleration, at_rest, later = arrays(acceleration, at_rest, later)
        if spins is None:
            slower = at_rest < acceleration
            yield from _box_ways(
                TORQUE,
                turns,
                None,
                rate,
                xp.where(slower, at_rest, acceleration),
                xp.where(slower, later, 0),
            )
        acceleration = xp.minimum(acceleration, at_rest + gyroscopic * norms[0] ** 2)
    yield from _box_ways(name, turns, spins, rate, acceleration)
    yield _Way(
        name=RATES if across is None else name,
        distance=length(turns),
        top=norms[0],
        growth=norms[1],
        speeds=None if spins is None else length(spins),
    )
    yield from _axis_ways(name, turns, spins, rate, acceleration, norms, across)


def _box_ways(
    name: str,
    turns: AnyArray,
    spins: np.ndarray | None,
    rate: AnyArray,
    acceleration: AnyArray,
    more: AnyArray = 0.0,
) -> Iterator[_Way]:
    """Yield the lengths of turns in the boxes of the rates, of the accelerations, and of what lies between.

    Args:
        name: of the limits.
        turns: (..., 3) rad, rotation vectors.
        spins: (2, 3) rad/s, at both ends; None at rest.
        rate: (3,) rad/s, limits of the components.
        acceleration: (3,) rad/s^2, likewise.
        more: (3,) rad/s^4, by which these grow with the square of the time since rest.
    """
    xp, rate, acceleration, more = arrays(rate, acceleration, more)
    boxes = [rate]
    ratio = acceleration / rate
    if xp is not np or np.ptp(ratio) > _SAME * np.max(ratio):
        boxes += [acceleration, xp.sqrt(rate * acceleration)]
    for box in boxes:
        yield _Way(
            name=name,
            distance=turn_table("box").length(turns, box),
            top=xp.max(rate / box),
            growth=xp.max(acceleration / box),
            more_growth=xp.max(more / box),
            speeds=None if spins is None else np.max(np.abs(spins) / box, axis=1),
        )


def _axis_ways(
    name: str,
    turns: AnyArray,
    spins: np.ndarray | None,
    rate: AnyArray,
    acceleration: AnyArray,
    norms: tuple[AnyArray, AnyArray],
    of_wheels: tuple[list[AnyArray], list[AnyArray]] | None,
) -> Iterator[_Way]:
    """Yield for each body axis the angle between its directions at start and end, which is a way.

    Turns about the axis itself do not change it. The name of the limits, turns (..., 3) rad, spins (2, 3)
    rad/s at both ends or None, rate (3,) rad/s, acceleration (3,) rad/s^2, and `norms`, limits of the lengths
    of both; `of_wheels` likewise of what lies across each axis, None without.
    """
    turned = _axis_angles(turns)
    xp, rate, acceleration = arrays(rate, acceleration)
    for axis in range(3):
        across = np.arange(3) != axis
        top = xp.minimum(length(rate[across]), norms[0])
        growth = xp.minimum(length(acceleration[across]), norms[1])
        if of_wheels is not None:
            top, growth = xp.minimum(top, of_wheels[0][axis]), xp.minimum(growth, of_wheels[1][axis])
        yield _Way(
            name=name,
            distance=turned[..., axis],
            top=top,
            growth=growth,
            speeds=None if spins is None else length(spins[:, across]),
        )


def _axis_angles(turns: AnyArray) -> AnyArray:
    """Angles (..., 3) rad between the directions of the three axes before and after turns (..., 3) rad."""
    _, turned = arrays(so3.exp(turns))
    return separation(np.eye(3, dtype=turned.dtype), array_module(turned).swapaxes(turned, -1, -2))


def _energy_way(
    inertia: AnyArray,
    given: dict[str, AnyArray],
    norms: tuple[AnyArray, AnyArray],
    turns: AnyArray,
    spins: np.ndarray | None,
    wheels: WheelSpeeds | None = None,
) -> _Way:
    """The way along which the speed is ``sqrt(w . J w)``, with the largest of its lower bounds as distance.

    Args:
        inertia: (3, 3) kg m^2, ``J``.
        given: bounds (3,) of the limits, by the names of their quantities.
        norms: limits of the lengths of angular velocity and acceleration, rad/s and rad/s^2.
        turns: (..., 3) rad, rotation vectors.
        spins: (2, 3) rad/s, at both ends; None at rest.
        wheels: what they allow stands in the place of limits of torque and momentum; None without.
    """
    xp, inertia = arrays(inertia)
    moments, axes = _principal(inertia)
    roots, heaviest = xp.sqrt(moments), xp.sqrt(xp.max(moments))
    own = turns @ axes
    rows = [turn_table("ellipsoid").length(own, 1 / roots)]
    angles = _axis_angles(own)
    for axis in range(3):
        rows.append(xp.min(roots[np.arange(3) != axis]) * angles[..., axis])
    tops = [norms[0] * heaviest, _largest(given["angular_velocity"], inertia)]
    if "wheel_momentum" in given:
        tops.append(_largest(given["wheel_momentum"], _inverse(inertia)))
    growths = [norms[1] * heaviest, _largest(given["angular_acceleration"], inertia)]
    if wheels is None:
        growths.append(_largest(given["torque"], _inverse(inertia)))
    else:
        momentum, most = wheels.momentum, wheels.total / xp.sqrt(xp.min(moments))
        tops.append(momentum.largest(_inverse(inertia)) + most)
        growths.append(wheels.torque.largest(_inverse(inertia)))
    xp = array_module(*tops, *growths)
    return _Way(
        name=ENERGY,
        distance=_most(rows),
        top=xp.min(xp.stack(tops)),
        growth=xp.min(xp.stack(growths)),
        speeds=None if spins is None else _sizes(spins, inertia),
    )


def _accelerations_by_torque(inertia: AnyArray, torque: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Bounds of the angular acceleration's components, by inertia (3, 3) kg m^2 and torque limits (3,) N m.

    Returns:
        (3,) rad/s^2 at rest, by the torque; (3,) of what a turning body adds, by the square of its angular
        velocity; and (3,) rad/s^4, of what it adds by the square of the time since it was at rest.
    """
    xp, inertia, torque = arrays(inertia, torque)
    inverse = _inverse(inertia)
    moments, axes = _principal(inertia)
    half = (axes / xp.sqrt(moments)) @ axes.T
    crossed = so3.hat(inverse) @ inertia
    forms = (crossed + xp.swapaxes(crossed, -1, -2)) / 2  # w . forms[i] w is component i of J^-1 (w x J w)
    sizes = [
        xp.max(xp.abs(xp.linalg.eigvalsh(by @ forms @ by)), axis=-1) for by in (np.eye(3), half, inverse)
    ]
    later = xp.minimum(sizes[1] * _largest(torque, inverse) ** 2, sizes[2] * xp.sum(torque**2))
    return xp.abs(inverse) @ torque, sizes[0], later


def _most(values: list[AnyArray]) -> AnyArray:
    """The elementwise maximum of arrays, taken by index, so that it has the derivative of one of them.

    Compiled, a maximum may be equal to none of the values, and then its derivative is zero.
    """
    xp = array_module(*values)
    rows = xp.stack(values)
    return xp.take_along_axis(rows, xp.argmax(rows, axis=0)[None], axis=0)[0]


def _inverse(matrix: AnyArray) -> AnyArray:
    """The inverse of a matrix, by numpy or JAX."""
    return array_module(matrix).linalg.inv(matrix)


def _principal(inertia: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Principal moments (3,) of an inertia, and principal axes (3, 3) as columns, without derivatives."""
    if array_module(inertia) is np:
        _, axes = np.linalg.eigh(inertia)
    else:
        _, axes = jax.numpy.linalg.eigh(jax.lax.stop_gradient(inertia))
    return array_module(axes).diagonal(axes.T @ inertia @ axes), axes


def _largest(bound: AnyArray, matrix: AnyArray) -> AnyArray:
    """The largest ``sqrt(x . matrix x)`` over the box ``|x_i| <= bound_i``."""
    xp, bound, matrix = arrays(bound, matrix)
    return xp.max(_sizes(_CORNERS * bound, matrix))


def _sizes(vectors: AnyArray, matrix: AnyArray) -> AnyArray:
    """``sqrt(x . matrix x)`` (k,) of vectors (k, 3)."""
    xp, x, matrix = arrays(vectors, matrix)
    return xp.sqrt(xp.sum((x @ matrix) * x, axis=-1))
