"""The ways along which a platform turns, with the limits that keep the speed along each low.

A *way* is a distance that a motion has to cover, with limits of the speed along it (*top*) and of its rate of
change (*growth*), see `jaxplan.model.duration_bound`. These are the ways of the platform:

    way                        speed                             top, growth
    length in a box            max of |w_i| / c_i                max of limit_i / c_i, also of accelerations
    the same in other axes     max of |e_i . w| / c_i            the same, for what wheels allow along e_i
    angle of the turn          |w|                               limits of the lengths, or diagonals of boxes
    angle of a body axis       |w across it|                     diagonals of the two other axes' limits
    length by the energy       sqrt(w . J w)                     the largest over boxes; growth by torque too

`w` is the angular velocity in body axes, `J` the inertia; a box has the half sides `c`, and lengths of turns
are those of `jaxplan.model.turn_table`. By the energy the speed grows no faster than the largest
``sqrt(torque . J^-1 torque)``, since gyroscopic torques do no work. In a box they count: from rest,
``w_i' <= a_i + g_i t^2``, with ``a = |J^-1| torque`` and ``g_i`` the largest of ``|J^-1 (w x J w)|_i`` for
the energy, or the momentum, that there can be after one second. Limits of momentum are converted to limits of
the rates.

Wheels give ``J w' + w x (R^T H)`` and hold ``R^T H - J w``, both within what the array reaches by its
allocation (`jaxplan.model.wheel_reach`); ``|H|``, the total momentum, is known from the start. So the rates
are at most ``J^-1`` times the reach of the momenta plus ``|H|``, the accelerations at most ``J^-1`` times the
reach of the torques plus ``|w| |H|``; in the energy the torque that turns ``H`` does no work. The lengths of
both, and of their parts across a body axis, are at most those at the corners of the reach, which are smaller
than the diagonals of boxes. A box about the body axes is much larger than the reach of slanted wheels; so
there are boxes in other axes as well, each with a side along a face (`wheel_reach.fitted_frames`).

If stages of gimbals have an inertia, ``J`` depends on the joints, and moving joints carry momentum and push
back. `jaxplan.model.inertia_bounds` bounds these: with ``d = J - J_c`` the momentum is ``J_c w + (d w + p)``,
so limits of momentum and torque let ``J_c w`` and ``J_c w'`` be larger by the most that ``d w + p`` and
``d w' + J' w + p'`` can be, and gyroscopic torque adds the former times ``|w|``. In the energy the speed is
``sqrt(w . J(q) w)``: it is at least that by the least inertia, which gives the distance; its top is that by
the greatest inertia; and as

    d/dt (w . J w) / 2 = w . (torque - J' w / 2 - p')

its growth is at most what the torque gives by the least inertia plus ``(|p'| + |J'| |w| / 2) / sqrt(a)``,
with ``a`` the least principal moment of that.

Any ``c`` is allowed; tried are the limits of the rates, those of the accelerations, and the geometric mean of
both; in the axes of wheels' faces those of the accelerations. Radians, seconds, body axes.
"""

from collections.abc import Iterator
from typing import NamedTuple
from weakref import WeakKeyDictionary

import jax
import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, length, max_along, min_along, separation
from jaxplan.model.inertia_bounds import InertiaBounds, inertia_bounds, most_by
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.limits import limits, longest
from jaxplan.model.minimum_times import Way
from jaxplan.model.quadratic import (
    greatest_of,
    inverse_of,
    largest_in_box,
    principal,
    roots_of,
    sizes_by,
)
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.turn_table import Lengths, turn_table
from jaxplan.model.wheel_reach import WheelSpeeds, fitted_frames, reaches

_RATIO_TOLERANCE = (
    1e-9  # relative difference below which the axes' ratios of acceleration to rate count as equal
)

RATES = "rates and accelerations of the platform"
TORQUE = "rates, accelerations and torque of the platform"
ENERGY = "torque and inertia of the platform"


class Ends(NamedTuple):
    """The motion at start and end, where the spacecraft need not rest.

    The joints are the yaws of n terminals, their pitches, and the angles of d drives.

    Attributes:
        spins: (2, 3) rad/s, angular velocities in body axes; None if the platform rests at both ends.
        joints: (2, 2n + d) rad, joint angles; None if the joints rest, too.
        rates: (2, 2n + d) rad/s, joint rates; None if the joints rest, too.
    """

    spins: AnyArray | None = None
    joints: AnyArray | None = None
    rates: AnyArray | None = None

    def momenta(self, craft: Spacecraft, *, still: bool = False) -> AnyArray:
        """Return the momenta (2, 3) N m s of all but the wheels at start and end, body axes.

        Args:
            craft: the spacecraft.
            still: whether to take joint rates as zero.

        Raises:
            ValueError: if the joints are not given.
        """
        spins = np.zeros((2, 3)) if self.spins is None else self.spins
        if self.joints is None or self.rates is None:
            raise ValueError("joints are not known")
        rates = 0 * self.rates if still else self.rates
        motion = Kinematics(
            spin=[spins.T],
            joints=[self.joints.T, rates.T],
            inertia=craft.fixed_inertia,
            stages=craft.stages,
        )
        momentum: AnyArray = motion.momentum
        return array_module(momentum).asarray(momentum).T


class _BoxLength(NamedTuple):
    """The length of turns in a box."""

    axes: AnyArray  # (3, 3), the box's axes as rows
    lengths: Lengths

    def of(self, turns: AnyArray) -> AnyArray:
        """Return the lengths (...) of turns (..., 3) rad."""
        return self.lengths.of(turns @ self.axes.T)


class _Angle(NamedTuple):
    """The angle of turns, or by which they move the direction of a body axis."""

    axis: int | None = None

    def of(self, turns: AnyArray) -> AnyArray:
        """Return the angles (...) rad of turns (..., 3) rad."""
        return length(turns) if self.axis is None else _axis_angles(turns)[..., self.axis]


class _EnergyLength(NamedTuple):
    """The length of turns by the energy: the largest of several lower bounds."""

    roots: AnyArray  # (3,) (kg m^2)^1/2, of the least principal moments
    axes: AnyArray  # (3, 3), the principal axes as columns
    lengths: Lengths

    def of(self, turns: AnyArray) -> AnyArray:
        """Return the lengths (...) rad (kg m^2)^1/2 of turns (..., 3) rad."""
        own = turns @ self.axes
        rows, angles = [self.lengths.of(own)], _axis_angles(own)
        for axis in range(3):
            rows.append(min_along(self.roots[np.arange(3) != axis], -1) * angles[..., axis])
        return greatest_of(rows)


class _LengthLimits(NamedTuple):
    """A length of turns with limits of the speed along it: a way before the turn is known, see `Way`."""

    name: str
    length: _BoxLength | _Angle | _EnergyLength
    top: AnyArray
    growth: AnyArray
    more_growth: AnyArray | None = None
    speeds: AnyArray | None = None

    def way(self, turns: AnyArray) -> Way:
        """Return the way of turns (..., 3) rad."""
        return Way(
            name=self.name,
            distance=self.length.of(turns),
            top=self.top,
            growth=self.growth,
            more_growth=self.more_growth,
            speeds=self.speeds,
        )


def ways_of_platform(craft: Spacecraft, turns: AnyArray, ends: Ends) -> Iterator[Way]:
    """Yield the ways of the platform, which are those in the table of the module's docstring.

    Args:
        craft: the spacecraft, with its limits and inertia.
        turns: (..., 3) rad, rotation vectors from start to end, in body axes at the start.
        ends: the motion at both ends.
    """
    still = all(part is None for part in ends)
    for own in _limits_at_rest(craft) if still else _length_limits(craft, ends):
        yield own.way(turns)


# Beside the spacecraft and not in them, since their tables are large and spacecraft are sent to workers.
_known_at_rest: WeakKeyDictionary[Spacecraft, list[_LengthLimits]] = WeakKeyDictionary()


def _limits_at_rest(craft: Spacecraft) -> list[_LengthLimits]:
    """Return `_length_limits` of a platform that rests at both ends, kept unless JAX traces them."""
    known = _known_at_rest.get(craft)
    if known is None:
        known = list(_length_limits(craft, Ends()))
        if not any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(known)):
            _known_at_rest[craft] = known
    return known


def _length_limits(craft: Spacecraft, ends: Ends) -> Iterator[_LengthLimits]:
    """Yield lengths of turns with their limits, for a spacecraft with a motion `ends` at both ends."""
    given = {limit.quantity.name: limit.bound for limit in limits(craft)}
    rate, acceleration = given["angular_velocity"], given["angular_acceleration"]
    norms, name, spins = (longest(craft, 1), longest(craft, 2)), RATES, ends.spins
    if "wheel_momentum" in given:
        body = inertia_bounds(craft)
        xp, inverse, momentum = arrays(inverse_of(body.middle), given["wheel_momentum"])
        by_momentum = xp.abs(inverse) @ momentum
        if craft.stages is not None:
            fastest = most_by(norms[0], body, length(momentum) + body.carried)
            by_momentum = by_momentum + length(inverse) * (body.off * fastest + body.carried)
        rate = xp.minimum(rate, by_momentum)
    across = own = None
    if craft.wheel_array is not None:
        array, body, total = craft.wheel_array, inertia_bounds(craft), _total_momentum(craft, ends)
        own = WheelSpeeds.of(craft, total, body.middle)
        yield _energy_limits(craft, body, given, norms, ends)
        if craft.stages is not None:
            most = most_by(
                norms[0],
                body,
                array_module(array.each_momentum).sum(array.each_momentum) + total + body.carried,
            )
            own = own._replace(carried=body.carried + body.off * most)
        xp, rate, acceleration, own_rate = arrays(rate, acceleration, own.rate(np.eye(3)))
        rate = xp.minimum(rate, own_rate)
        top = xp.minimum(xp.minimum(norms[0], length(rate)), own.top(np.eye(3)))
        if craft.stages is not None:
            push = body.pushed + body.swept * top
            most = most_by(norms[1], body, xp.sum(array.each_torque) + total * top + push)
            own = own._replace(pushed=push + body.off * most)
        acceleration = xp.minimum(acceleration, own.acceleration(np.eye(3), top))
        norms, name = (top, xp.minimum(norms[1], own.growth(np.eye(3), top))), TORQUE
        planes = np.eye(3) - np.eye(3)[:, :, None] * np.eye(3)[:, None]
        across = [own.top(plane) for plane in planes], [own.growth(plane, top) for plane in planes]
    if "torque" in given:
        body = inertia_bounds(craft)
        yield _energy_limits(craft, body, given, norms, ends)
        at_rest, gyroscopic, later = _accelerations_by_torque(body.middle, given["torque"])
        xp, acceleration, at_rest, later = arrays(acceleration, at_rest, later)
        if craft.stages is not None:
            fastest = norms[0]
            push = body.pushed + body.swept * fastest + fastest * (body.off * fastest + body.carried)
            heaviest = xp.max(principal(body.middle)[0])
            most = most_by(norms[1], body, length(given["torque"]) + push + heaviest * fastest**2)
            at_rest = at_rest + length(inverse_of(body.middle)) * (push + body.off * most)
        elif spins is None:
            slower = at_rest < acceleration
            yield from _limits_in_boxes(
                TORQUE,
                None,
                rate,
                xp.where(slower, at_rest, acceleration),
                xp.where(slower, later, 0),
            )
        acceleration = xp.minimum(acceleration, at_rest + gyroscopic * norms[0] ** 2)
    yield from _limits_in_boxes(name, spins, rate, acceleration)
    if own is not None:
        frames = fitted_frames(craft)
        every = own.boxes(frames, rate, acceleration, norms[0])
        lengths = turn_table("box").lengths(every[1])
        for number, (axes, rates, growths) in enumerate(zip(frames, *every, strict=True)):
            of_frame = _BoxLength(axes, Lengths(*(part[number] for part in lengths)))
            yield _limits_in_box(name, spins, of_frame, growths, rates, growths)
    speeds = None if spins is None else length(spins)
    yield _LengthLimits(RATES if across is None else name, _Angle(), *norms, speeds=speeds)
    yield from _axis_limits(name, spins, rate, acceleration, norms, across)


def _limits_in_boxes(
    name: str,
    spins: AnyArray | None,
    rate: AnyArray,
    acceleration: AnyArray,
    more: AnyArray | None = None,
) -> Iterator[_LengthLimits]:
    """Yield the lengths of turns in up to three boxes: of rates, of accelerations, and between them.

    Args:
        name: name of the limits.
        spins: (2, 3) rad/s, angular velocities at both ends; None at rest.
        rate: (3,) rad/s, limits of the angular velocity's components.
        acceleration: (3,) rad/s^2, limits of the acceleration's components, at rest if `more` is given.
        more: (3,) rad/s^4, by which these rise with the square of the time since rest; None for zero.
    """
    xp, rate, acceleration = arrays(rate, acceleration)
    boxes = [rate]
    ratio = acceleration / rate
    if xp is not np or np.ptp(ratio) > _RATIO_TOLERANCE * np.max(ratio):
        boxes += [acceleration, xp.sqrt(rate * acceleration)]
    for box in boxes:
        along = _BoxLength(np.eye(3), turn_table("box").lengths(box))
        yield _limits_in_box(name, spins, along, box, rate, acceleration, more)


def _limits_in_box(
    name: str,
    spins: AnyArray | None,
    along: _BoxLength,
    box: AnyArray,
    rate: AnyArray,
    acceleration: AnyArray,
    more: AnyArray | None = None,
) -> _LengthLimits:
    """Return the length `along` of turns in a box with half sides (3,).

    The other arguments are those of `_limits_in_boxes`, with limits along the axes of the box.
    """
    return _LengthLimits(
        name=name,
        length=along,
        top=max_along(rate / box, -1),
        growth=max_along(acceleration / box, -1),
        more_growth=None if more is None else max_along(more / box, -1),
        speeds=None if spins is None else (abs(spins @ along.axes.T) / box).max(axis=1),
    )


def _axis_limits(
    name: str,
    spins: AnyArray | None,
    rate: AnyArray,
    acceleration: AnyArray,
    norms: tuple[AnyArray, AnyArray],
    of_wheels: tuple[list[AnyArray], list[AnyArray]] | None,
) -> Iterator[_LengthLimits]:
    """Yield for each body axis the angle between its directions at start and end.

    Turns about the axis itself do not change that angle.

    Args:
        name: name of the limits.
        spins: (2, 3) rad/s, angular velocities at both ends; None at rest.
        rate: (3,) rad/s, limits of the angular velocity's components.
        acceleration: (3,) rad/s^2, limits of the acceleration's components.
        norms: rad/s and rad/s^2, limits of the lengths of both.
        of_wheels: for each axis the limits by wheels of the lengths of what lies across it, first of the
            angular velocity and then of the acceleration; None without wheels.
    """
    xp, rate, acceleration = arrays(rate, acceleration)
    for axis in range(3):
        across = np.arange(3) != axis
        top = xp.minimum(length(rate[across]), norms[0])
        growth = xp.minimum(length(acceleration[across]), norms[1])
        if of_wheels is not None:
            top, growth = xp.minimum(top, of_wheels[0][axis]), xp.minimum(growth, of_wheels[1][axis])
        speeds = None if spins is None else length(spins[:, across])
        yield _LengthLimits(name, _Angle(axis), top, growth, speeds=speeds)


def _axis_angles(turns: AnyArray) -> AnyArray:
    """Return the angles (..., 3) rad by which turns (..., 3) rad move the directions of the three axes."""
    _, turned = arrays(so3.exp(turns))
    return separation(np.eye(3, dtype=turned.dtype), array_module(turned).swapaxes(turned, -1, -2))


def _energy_limits(
    craft: Spacecraft,
    body: InertiaBounds,
    given: dict[str, AnyArray],
    norms: tuple[AnyArray, AnyArray],
    ends: Ends,
) -> _LengthLimits:
    """Return the length of turns along which the speed is ``sqrt(w . J w)``.

    Args:
        craft: the spacecraft; if it has wheels, their limits are used instead of those of torque.
        body: bounds of the inertia ``J``.
        given: (3,) bounds of the limits, by the names of their quantities.
        norms: rad/s and rad/s^2, limits of the lengths of angular velocity and acceleration.
        ends: the motion at both ends.
    """
    array, spins = craft.wheel_array, ends.spins
    xp, least, greatest = arrays(body.least, body.greatest)
    moments, axes = principal(least)
    roots, heaviest = xp.sqrt(moments), xp.sqrt(xp.max(principal(greatest)[0]))
    lightest, inverse, speeds = xp.sqrt(xp.min(moments)), inverse_of(least), None
    carried, pushed, swept = (
        (0.0, 0.0, 0.0)
        if craft.stages is None
        else (body.carried / lightest, body.pushed / lightest, body.swept * norms[0] / 2 / lightest)
    )
    tops = [norms[0] * heaviest, largest_in_box(given["angular_velocity"], greatest)]
    if "wheel_momentum" in given:
        tops.append(largest_in_box(given["wheel_momentum"], inverse) + carried)
    growths = [norms[1] * heaviest, largest_in_box(given["angular_acceleration"], greatest)]
    growths = [growth + swept for growth in growths]
    if array is None:
        growths.append(largest_in_box(given["torque"], inverse) + pushed + swept)
    else:
        torque, momentum = reaches(craft)
        tops.append(momentum.largest(inverse) + _total_momentum(craft, ends) / lightest + carried)
        growths.append(torque.largest(inverse) + pushed + swept)
    xp = array_module(*tops, *growths)
    if spins is not None and craft.stages is None:
        speeds = sizes_by(spins, least)
    elif spins is not None:
        speeds = roots_of((spins * ends.momenta(craft, still=True)).sum(axis=1))
    return _LengthLimits(
        name=ENERGY,
        length=_EnergyLength(roots, axes, turn_table("ellipsoid").lengths(1 / roots)),
        top=min_along(xp.stack(tops), 0),
        growth=min_along(xp.stack(growths), 0),
        speeds=speeds,
    )


def _total_momentum(craft: Spacecraft, ends: Ends) -> AnyArray:
    """Return the length, N m s, of the total momentum of platform and wheels, from the start's motion.

    Raises:
        ValueError: if there are no wheels.
    """
    if craft.wheel_array is None:
        raise ValueError("there are no wheels")
    if craft.stages is not None:
        resting = ends.joints is None
        return length(
            craft.wheel_array.stored if resting else craft.wheel_array.stored + ends.momenta(craft)[0]
        )
    _, inertia, stored = arrays(craft.whole_inertia, craft.wheel_array.stored)
    return length(stored if ends.spins is None else stored + inertia @ ends.spins[0])


def _accelerations_by_torque(inertia: AnyArray, torque: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Return bounds of the angular acceleration's components.

    Args:
        inertia: (3, 3) kg m^2.
        torque: (3,) N m, limits of the torque's components.

    Returns:
        (3,) rad/s^2, by the torque, for a body at rest; (3,) factors of the square of the angular velocity's
        length, for what a turning body adds; and (3,) rad/s^4, factors of the square of the time since rest,
        for the same.
    """
    xp, inertia, torque = arrays(inertia, torque)
    inverse = inverse_of(inertia)
    moments, axes = principal(inertia)
    half = (axes / xp.sqrt(moments)) @ axes.T
    crossed = so3.hat(inverse) @ inertia
    forms = (crossed + xp.swapaxes(crossed, -1, -2)) / 2  # w . forms[i] w is component i of J^-1 (w x J w)
    sizes = [max_along(xp.abs(xp.linalg.eigvalsh(by @ forms @ by)), -1) for by in (np.eye(3), half, inverse)]
    later = xp.minimum(sizes[1] * largest_in_box(torque, inverse) ** 2, sizes[2] * xp.sum(torque**2))
    return xp.abs(inverse) @ torque, sizes[0], later
