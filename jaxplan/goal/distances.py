"""Distances that platform and joints travel from the start, with two derivatives, for goals of least time.

A *way* is such a distance. For a joint it is its change of angle, rad, taken with either sign; for the
platform it is the angle of its turn, rad, the angle between a body axis before and after the turn, or a
length of the turn from `jaxplan.model.turn_table`. Along ``E exp(d^)`` a way ``w`` has the first derivatives,
or *slopes*, ``dw / dd`` and the second derivatives, or *bends*, ``d^2 w / dd^2``, both at ``d = 0``. They are
written out here, since with nested derivatives of JAX the descents took five times as long to compile. An
angle that depends on a target's body components ``b``, with gradient ``g`` by ``b``, has the slopes ``g x
b``. The ways of the turn follow from its rotation vector ``eta``, whose slopes are ``J = k I + (1 - k) u u^T
+ eta^ / 2`` with ``k = (theta / 2) cot(theta / 2)``, ``theta`` its length and ``u`` its direction.

Shapes: p pointers (devices whose joints follow a direction), b tables of turns, w = 4 + 3 b + 4 p ways, K
lanes (problems side by side, the last axis).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry import rotations
from jaxplan.geometry.vectors import AnyArray, cross, dot
from jaxplan.goal.descent import angle_terms, inner
from jaxplan.model.gimbals import in_range

_MIN_SQUARED_COSINE = 1e-9  # least one of an elevation; at zero the azimuth has no derivative
_MIN_SQUARED_ANGLE = 1e-16  # rad^2, square of the turn's angle below which its derivatives are taken as zero
_MIN_SINE = 1e-9  # sine of an axis's angle below which its derivatives are taken as zero
_ABSENT_JOINT_WAY = -1.0  # rad, way of a joint that there is not: no constraint, since it is below any reach
_AXIS_ORDERS = (np.arange(3)[:, None] + np.arange(3)) % 3  # row f: axes, that of the largest ``q_f`` first
_FIRST_ORDERS = np.eye(3, dtype=int)
_DERIVATIVE_ORDERS = [
    np.zeros(3, int),
    *_FIRST_ORDERS,
    *(_FIRST_ORDERS[a] + _FIRST_ORDERS[b] for a in range(3) for b in range(a, 3)),
]
"""Orders of the derivative by each of three places, of the value and of its first and second derivatives."""
_FIRST_DERIVATIVES = np.array([1, 2, 3])
_SECOND_DERIVATIVES = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])
"""Indices among `_DERIVATIVE_ORDERS` of the first and second derivatives, by the numbers of the places."""


class Pointers(NamedTuple):
    """The p devices whose joints follow directions, with azimuth and elevation of each.

    Attributes:
        direction: (p, 3) unit vectors in the body axes of the start.
        frame: (p, 3, 3) rotations from the device's axes to body axes.
        ranges: (p, 2, 2) rad, least and largest azimuth, then elevation.
        cut: (p,) bool, whether angles beyond the ranges are clipped to their ends, as for wishes.
        rest: (p, 2) rad, azimuth and elevation at the start.
        moves: (p, 2) bool, whether the device has a joint for that angle.
        rate: (p, 2) rad per unit of time, limit of the joint's rate.
        acceleration: (p, 2) rad per unit of time squared, limit of its acceleration.
    """

    direction: np.ndarray
    frame: np.ndarray
    ranges: np.ndarray
    cut: np.ndarray
    rest: np.ndarray
    moves: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


class Platform(NamedTuple):
    """Lengths of turns of the platform by b tables, and limits of the speed along its ways.

    A length is the largest ``q_f`` times its share, see `jaxplan.model.turn_table`. Here the share is a
    smooth polynomial near the tabulated one. Each of the three axes ``f`` gives a way of its own, also where
    its ``q_f`` is not the largest, with the share then taken at the edge; so the quadratic program sees both
    sides of an edge between two axes.

    Attributes:
        axes: (b, 3, 3) rotations from the axes of each table, ordered as its rates, to body axes.
        rates: (b, 3) rates of each table, rad/s.
        shares: (b, 3, i, j, k) coefficients of Legendre polynomials: by table and axis ``f``, with i, j and k
            terms in ``|r|`` and in the two ratios of ``q``.
        top: (4 + b,) largest speed along each way, per unit of time: the angles of body axes x, y and z, the
            turn's angle, and the lengths by tables.
        growth: (4 + b,) largest acceleration along each way, per unit of time squared.
    """

    axes: np.ndarray
    rates: np.ndarray
    shares: np.ndarray
    top: np.ndarray
    growth: np.ndarray


def reach(time: Array, top: Array, growth: Array) -> tuple[Array, Array, Array]:
    """Return the longest ways from rest to rest in given times, with two derivatives by time.

    The profile of the speed is a trapezoid, or a triangle for short times.

    Args:
        time: (K,) units of time, one for each of K lanes.
        top: (w,) largest speed along each of w ways.
        growth: (w,) largest acceleration along each way.

    Returns:
        The ways, their first and their second derivatives by time, each (w, K).
    """
    own, most = growth[:, None], top[:, None]
    rises = own * time < 2 * most
    speed = jnp.where(rises, own * time / 2, most)
    return speed * time - speed**2 / own, speed, jnp.where(rises, own / 2, 0)


class Course(NamedTuple):
    """Functions of the attitude with their derivatives by ``d``, n functions in K lanes.

    Attributes:
        values: (n, K).
        slopes: (3, n, K) first derivatives.
        bends: (3, 3, n, K) second derivatives.
    """

    values: Array
    slopes: Array
    bends: Array


def ways(
    quaternion: Array, pointers: Pointers, platform: Platform
) -> tuple[Array, Array, Callable[[Array], Array]]:
    """Return the w ways of the platform and of joints with either sign, in K lanes.

    Args:
        quaternion: (4, K) unit quaternions of ``E``.
        pointers: the devices whose joints follow directions.
        platform: lengths of the platform's turns.

    Returns:
        The ways (w, K), their slopes (3, w, K), and a function that takes weights (w, K) and returns the
        weighted sum (3, 3, K) of the bends.
    """
    turning, moved = _platform_ways(quaternion, platform), joint_angles(quaternion, pointers)
    there = jnp.concatenate([pointers.moves[:, 0], pointers.moves[:, 1]])[:, None]
    either = [jnp.where(there, sign * moved.values, _ABSENT_JOINT_WAY) for sign in (1, -1)]

    def bent(weights: Array) -> Array:
        of_turn, ahead, back = jnp.split(weights, np.cumsum([len(turning.values), len(moved.values)]))
        return jnp.sum(of_turn * turning.bends, axis=2) + jnp.sum((ahead - back) * moved.bends, axis=2)

    slopes = jnp.concatenate([turning.slopes, moved.slopes, -moved.slopes], axis=1)
    return jnp.concatenate([turning.values, *either]), slopes, bent


def _join_courses(courses: Sequence[Course]) -> Course:
    """Join the functions of several courses into one course."""
    return Course(*(jnp.concatenate(parts, axis=-2) for parts in zip(*courses, strict=True)))


def joint_angles(quaternion: Array, pointers: Pointers) -> Course:
    """Return signed changes (2 p, K) rad of joint angles from the start, azimuths first, with derivatives.

    They are zero, with zero derivatives, where there is no such joint.

    Args:
        quaternion: (4, K) unit quaternions of ``E`` in K lanes.
        pointers: the p devices whose joints follow directions.
    """
    direction = jnp.moveaxis(pointers.direction, -1, 0)[:, :, None]
    frame = jnp.moveaxis(pointers.frame, 0, -1)[..., None]  # (3, 3, p, 1)
    body = jnp.stack(rotations.turned_back(quaternion, direction))  # (3, p, K)
    x, y, z = (inner(frame[:, column], body) for column in range(3))
    square = jnp.maximum(x * x + y * y, _MIN_SQUARED_COSINE)
    level = jnp.sqrt(square)
    outward = (frame[:, 0] * x + frame[:, 1] * y) / level
    onward = (frame[:, 1] * x - frame[:, 0] * y) / level
    out, on, rise = (jnp.stack(cross(one, body)) / level for one in (outward, onward, frame[:, 2]))
    bends = (
        _symmetric_product(onward / level, body) - 2 * _symmetric_product(out, on),
        (_symmetric_product(frame[:, 2], body) + z * (_symmetric_product(rise, rise) - _identity(body)))
        / level,
    )
    found = []
    for part, angle in enumerate((jnp.arctan2(y, x), jnp.arctan2(z, level))):
        low, high = pointers.ranges[:, part, 0][:, None], pointers.ranges[:, part, 1][:, None]
        rest = pointers.rest[:, part][:, None]
        if part == 0:
            angle = in_range(angle.T, pointers.ranges[:, 0], rest[:, 0]).T
        cut = pointers.cut[:, None] & ((angle < low) | (angle > high))
        there = pointers.moves[:, part][:, None]
        angle = jnp.where(cut, jnp.clip(angle, low, high), angle)
        slopes, bend = (jnp.where(there & ~cut, own[part], 0) for own in ((on, rise), bends))
        found.append(Course(jnp.where(there, angle - rest, 0), slopes, bend))
    return _join_courses(found)


def axis_angles(quaternion: Array) -> Course:
    """Return the angle between each body axis before and after a turn, with derivatives, (3, K) rad.

    The turns are unit quaternions (4, K), K lanes of them.
    """
    axes = jnp.eye(3, dtype=quaternion.dtype)
    seen = jnp.stack(
        rotations.turned_back(quaternion, axes[:, :, None])
    )  # (3, axis, K): before, in body axes
    normal, cosine = jnp.stack(cross(axes[:, :, None], seen)), jnp.einsum("iik->ik", seen)
    size = jnp.sqrt(dot(normal, normal))
    there = size > _MIN_SINE
    sine = jnp.where(there, size, 1)
    slopes = jnp.where(there, -normal / sine, 0)
    about = _symmetric_product(axes[:, :, None], seen) - _identity(seen) * cosine
    bends = jnp.where(there, -(about + _symmetric_product(slopes, slopes) * cosine) / sine, 0)
    return Course(jnp.arctan2(size, cosine), slopes, bends)


def _platform_ways(quaternion: Array, platform: Platform) -> Course:
    """Return the ways (4 + 3 b, K) of the platform with b tables of turns, those of `axis_angles` first.

    The turns are unit quaternions (4, K), K lanes of them.
    """
    angle, eta, hessian = angle_terms(quaternion)
    by_turn = turn_ways(eta, platform)
    nearness = jnp.trace(hessian) / 2 - 0.5  # k
    there = angle > 1e-8
    size = jnp.where(there, angle, 1)
    unit = jnp.where(there, eta / size, 0)
    uneven = nearness * (1 - nearness) / size

    def back(vectors: Array) -> Array:
        """Return ``J^T`` times vectors (3, ..., K), with ``J`` the slopes of ``eta`` (see the module)."""
        between = [1] * (vectors.ndim - 2)
        matrix = hessian.reshape(3, 3, *between, -1)
        turn = eta.reshape(3, *between, -1)
        return inner(matrix, vectors[:, None]) - jnp.stack(cross(turn, vectors)) / 2

    slopes, across = by_turn.slopes, unit[:, None]
    along = dot(across, slopes)
    beside = slopes - across * along
    side = 2 * uneven * beside - (1 - nearness) * jnp.stack(cross(across, slopes))
    plane = (_identity(across) - _symmetric_product(across, across)) * jnp.where(there, uneven - angle / 4, 0)
    bends = back(jnp.swapaxes(back(by_turn.bends), 0, 1)) + _symmetric_product(across, side) + along * plane
    return _join_courses([axis_angles(quaternion), Course(by_turn.values, back(slopes), bends)])


def turn_ways(eta: Array, platform: Platform) -> Course:
    """Return ways (1 + 3 b, K) of the platform, with derivatives by its rotation vector ``eta``.

    The first is the turn's angle. Then come, for each axis ``f`` taken as that of the largest ``q_f``, the
    lengths by the b tables.

    Args:
        eta: (3, K) rad, rotation vectors in K lanes.
        platform: the tables of lengths.
    """
    square = dot(eta, eta)
    small = square < _MIN_SQUARED_ANGLE
    size = jnp.sqrt(jnp.where(small, 1, square))
    angle, unit = jnp.where(small, 0, size), jnp.where(small, 0, eta / size)
    bend = jnp.where(small, 0, (_identity(unit) - unit[:, None] * unit) / size)
    axes = jnp.moveaxis(platform.axes / platform.rates[:, None], 0, -1)[..., None]  # (3, 3, b, 1)
    along = inner(axes, eta[:, None, None])  # (3, b, K)
    # (f, 3, b, K), (3, f, 3, b, K)
    own, slope = jnp.abs(along)[_AXIS_ORDERS], (axes * jnp.sign(along))[:, _AXIS_ORDERS]
    largest, steepest = own[:, 0], slope[:, :, 0]
    there = largest > 0
    safe = jnp.where(there, largest, 1)[:, None]
    shares = jnp.where(there[:, None], own[:, 1:] / safe, 1)
    none = jnp.zeros_like(largest)[:, None]
    places = jnp.concatenate([none + jnp.minimum(angle / jnp.pi, 1), jnp.minimum(shares, 1)], axis=1)
    by_share = jnp.where(
        there[:, None] & (shares < 1), (slope[:, :, 1:] - shares * steepest[:, :, None]) / safe, 0
    )
    short = jnp.where(angle < jnp.pi, 1 / jnp.pi, 0)
    by_angle = none + (short * unit)[:, None, None, None]
    steps = jnp.concatenate([by_angle, by_share], axis=2)  # (3, f, 3, b, K)
    value, first, second = _evaluate_polynomials(jnp.asarray(platform.shares), places)
    # The bends of the two other shares cancel with the products of their slopes and those of the largest.
    twice = jnp.einsum("xfibk,fijbk,yfjbk->xyfbk", steps, second, steps)
    by_turn = 2 * _symmetric_product(steepest, steps[:, :, 0]) + largest * (short * bend)[:, :, None, None]
    lengths = Course(
        values=largest * value,
        slopes=steepest * value + largest * jnp.sum(steps * first, axis=2),
        bends=largest * twice + first[:, 0] * by_turn,
    )
    flat = Course(*(part.reshape(*part.shape[:-3], -1, part.shape[-1]) for part in lengths))
    return _join_courses([Course(angle[None], unit[:, None], bend[:, :, None]), flat])


def _symmetric_product(first: Array, other: Array) -> Array:
    """Return the symmetric part (3, 3, ...) of the outer products of two vectors (3, ...)."""
    return (first[:, None] * other[None] + other[:, None] * first[None]) / 2


def _identity(vectors: Array) -> Array:
    """Return the identity (3, 3, 1, ...) with as many trailing axes as vectors (3, ...) have."""
    return jnp.eye(3, dtype=vectors.dtype).reshape(3, 3, *[1] * (vectors.ndim - 1))


def _evaluate_polynomials(coefficients: Array, places: Array) -> tuple[Array, Array, Array]:
    """Evaluate polynomials at three places in [0, 1], with first and second derivatives by the places.

    Args:
        coefficients: (b, f, i, j, l) for b tables and f axes, with i, j and l terms along the three places.
        places: (f, 3, b, K), in K lanes.

    Returns:
        Values (f, b, K), first derivatives (f, 3, b, K) and second ones (f, 3, 3, b, K).
    """
    terms, every = [], coefficients
    for number, count in enumerate(coefficients.shape[2:]):
        terms.append(jnp.stack(legendre(places[:, number], count)))  # (count, f, b, K)
        once = _legendre_derivative_matrix(count)
        orders = np.stack([np.eye(count), once, once @ once]).astype(coefficients.dtype)
        # The axis of this place's coefficients becomes two, at the end: order of the derivative, coefficient.
        every = jnp.tensordot(every, orders, axes=(2, 1))
    chosen = jnp.stack([every[:, :, first, :, other, :, third] for first, other, third in _DERIVATIVE_ORDERS])
    basis = jnp.einsum("ifbk,jfbk,lfbk->bfijlk", *terms)
    found = jnp.einsum("obfijl,bfijlk->ofbk", chosen, basis)
    first, second = found[_FIRST_DERIVATIVES], found[_SECOND_DERIVATIVES]
    return found[0], jnp.moveaxis(first, 0, 1), jnp.moveaxis(second, (0, 1), (1, 2))


def _legendre_derivative_matrix(count: int) -> np.ndarray:
    """Return the matrix that takes coefficients of a Legendre series to those of its derivative.

    The matrix (count, count) is multiplied by the coefficients as a row from the left. The derivative is by a
    place in [0, 1].
    """
    once = np.zeros((count, count))
    once[:, :-1] = 2 * np.polynomial.legendre.legder(np.eye(count), axis=1)
    return once


def legendre(place: AnyArray, count: int) -> list[AnyArray]:
    """Return the first `count` Legendre polynomials, shifted to [0, 1], at places of any shape."""
    x = 2 * place - 1
    terms = [0 * x + 1, x]
    for degree in range(1, count - 1):
        terms.append(((2 * degree + 1) * x * terms[-1] - degree * terms[-2]) / (degree + 1))
    return terms[:count]


def speed_limits(pointers: Pointers, platform: Platform) -> tuple[Array, Array]:
    """Return the largest speeds and accelerations along the w ways, each (w,), in the order of `ways`."""
    found = []
    for of_turn, of_joint in ((platform.top, pointers.rate), (platform.growth, pointers.acceleration)):
        own = jnp.where(pointers.moves, of_joint, 1).T.reshape(-1)
        found.append(jnp.concatenate([of_turn[:4], jnp.tile(of_turn[4:], 3), own, own]))
    return found[0], found[1]
