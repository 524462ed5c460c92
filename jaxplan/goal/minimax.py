"""Descent to goals of least time among caps: the slowest of platform and joints as quick as can be.

From rest to rest a joint goes at most ``reach(t)`` within the time ``t``, a trapezoid of its rate, and so
does the platform along its turn. With the way ``w`` that each has to go from the start, the least time is

    minimise  t^2 / 2 + STILLNESS theta^2 / 2   over E and t
    such that  w(E) <= reach(t)  for platform and joints to either side, and  excess(E) <= 0  for all caps

which has smooth constraints, where the time of each as a function of its way has a root at zero. Of attitudes
that are as quick the small second term prefers the one nearest to the start. It is solved by sequential
quadratic programming in four unknowns, as in `jaxplan.goal.descent`, with which it shares caps, lanes and
programs; ``E = R0^T R`` is a unit quaternion that is turned by ``exp(d^)``.

An angle with target ``b`` in body axes, seen in a device's axes, has the gradient ``g x b`` along ``d``,
with ``g`` its gradient by ``b``. Second derivatives are those of JAX. Time is in units of about that of half
a turn. Shapes: p pointers (devices whose joints follow a direction), w ways, m caps, K lanes.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry import rotations
from jaxplan.geometry.vectors import AnyArray, cross, dot
from jaxplan.goal.caps import applies
from jaxplan.goal.descent import (
    LEAST_CURVATURE,
    LONGEST_STEP,
    MET,
    PROXIMITY,
    Active,
    active_terms,
    angle_terms,
    bordered_inverse,
    cap_terms,
    identity,
    inner,
    inverse,
    least_eigenvalue,
    none_active,
    restoration,
    solve,
    sum_of_squares,
    turned,
)
from jaxplan.model.gimbals import in_range
from jaxplan.runtime.jit import quick_jit

STEPS = 14
STILLNESS = 1e-4
"""Weight of the square of the turn, rad^2, beside that of the time, in units."""
TIMES = 0.01, 50.0  # units of time, least and largest that a step may lead to
_ABOVE = 1e-9  # least square of the cosine of an elevation, where the azimuth has no derivative
_NO_TURN = 1e-16  # rad^2, a square of an angle below which it has no derivative
_NOWHERE = -1.0  # rad, way of what does not move


class Pointers(NamedTuple):
    """Devices whose joints follow directions, azimuth and elevation of each.

    Attributes:
        direction: (p, 3) unit vectors in the body axes of the start.
        frame: (p, 3, 3) body from the device's axes.
        ranges: (p, 2, 2) rad.
        cut: (p,) bool, whether angles beyond the ranges are brought to their ends, as of wishes.
        rest: (p, 2) rad, angles at the start.
        moves: (p, 2) bool, whether there is such a joint.
        rate: (p, 2) rad per unit of time.
        acceleration: (p, 2) likewise.
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
    """Lengths of a turn of the platform, its angle and those by tables, with limits of their speeds.

    A length is the largest ``q_f`` times its share, see `jaxplan.model.turn_table`; the share is here a
    polynomial near the tabulated one, which is smooth. The three that it may be are ways of their own, each
    with its share as of the edge where it is not the largest: so a program sees both sides of an edge.

    Attributes:
        axes: (b, 3, 3) body from the axes of each table, in the order of its rates.
        rates: (b, 3) of the table, rad/s.
        shares: (b, 3, i, j, k) coefficients of Legendre polynomials of |r| and of the two others' ``q``.
        top: (1 + b,) of the speeds, per unit of time, the angle's first.
        growth: (1 + b,) likewise.
    """

    axes: np.ndarray
    rates: np.ndarray
    shares: np.ndarray
    top: np.ndarray
    growth: np.ndarray


def reach(time: Array, top: Array, growth: Array) -> tuple[Array, Array, Array]:
    """The longest ways (w, K) from rest to rest in times (K,), with first and second derivatives by time."""
    own, most = growth[:, None], top[:, None]
    rises = own * time < 2 * most
    speed = jnp.where(rises, own * time / 2, most)
    return speed * time - speed**2 / own, speed, jnp.where(rises, own / 2, 0)


def moved_angles(quaternion: Array, pointers: Pointers) -> tuple[Array, Array]:
    """How far joints go, (2 p, K) rad with sign, azimuths first, and the gradients (3, 2 p, K)."""
    direction = jnp.moveaxis(pointers.direction, -1, 0)[:, :, None]
    frame = jnp.moveaxis(pointers.frame, 0, -1)[..., None]  # (3, 3, p, 1)
    body = jnp.stack(rotations.turned_back(quaternion, direction))  # (3, p, K)
    x, y, z = (inner(frame[:, column], body) for column in range(3))
    square = jnp.maximum(x * x + y * y, _ABOVE)
    level = jnp.sqrt(square)
    slopes = [
        [-y / square, x / square, jnp.zeros_like(z)],
        [-x * z / level, -y * z / level, level],
    ]
    found, gradients = [], []
    for part, angle in enumerate((jnp.arctan2(y, x), jnp.arctan2(z, level))):
        low, high = pointers.ranges[:, part, 0][:, None], pointers.ranges[:, part, 1][:, None]
        rest = pointers.rest[:, part][:, None]
        if part == 0:
            angle = in_range(angle.T, pointers.ranges[:, 0], rest[:, 0]).T
        cut = pointers.cut[:, None] & ((angle < low) | (angle > high))
        there = pointers.moves[:, part][:, None]
        angle = jnp.where(cut, jnp.clip(angle, low, high), angle)
        slope = inner(jnp.moveaxis(frame, 1, 0), jnp.stack(slopes[part])[:, None])
        gradient = jnp.stack(cross(slope, body))
        found.append(jnp.where(there, angle - rest, 0))
        gradients.append(jnp.where(there & ~cut, gradient, 0))
    return jnp.concatenate(found), jnp.concatenate(gradients, axis=1)


def turn_ways(eta: Array, platform: Platform) -> Array:
    """Ways (1 + 3 b, K) of the platform for rotation vectors (3, K): angles, and what lengths may be."""
    square = dot(eta, eta)
    small = square < _NO_TURN
    angle = jnp.where(small, 0, jnp.sqrt(jnp.where(small, 1, square)))
    axes = jnp.moveaxis(platform.axes, 0, -1)[..., None]  # (3, 3, b, 1)
    own = jnp.abs(inner(axes, eta[:, None, None])) / platform.rates.T[:, :, None]  # (3, b, K)
    found = [angle[None]]
    for face in range(3):
        largest, *others = (own[(face + step) % 3] for step in range(3))
        there = largest > 0
        shares = [jnp.where(there, one / jnp.where(there, largest, 1), 1) for one in others]
        places = [jnp.minimum(angle / jnp.pi, 1) + 0 * largest, *(jnp.minimum(one, 1) for one in shares)]
        found.append(largest * _share(jnp.asarray(platform.shares)[:, face], places))
    return jnp.concatenate(found)


def _share(coefficients: Array, places: list[Array]) -> Array:
    """Values (b, K) of polynomials (b, i, j, k) at three places (b, K) in [0, 1]."""
    found = coefficients[..., None]
    for place in places:
        terms = legendre(place, found.shape[1])
        found = jnp.sum(
            found * jnp.stack(terms, axis=1).reshape(len(place), -1, *[1] * (found.ndim - 3), place.shape[1]),
            axis=1,
        )
    return found


def legendre(place: AnyArray, count: int) -> list[AnyArray]:
    """The first Legendre polynomials, from [0, 1]."""
    x = 2 * place - 1
    terms = [0 * x + 1, x]
    for degree in range(1, count - 1):
        terms.append(((2 * degree + 1) * x * terms[-1] - degree * terms[-2]) / (degree + 1))
    return terms[:count]


def ways(quaternion: Array, pointers: Pointers, platform: Platform) -> tuple[Array, Array]:
    """Ways (w, K) of platform, and joints to either side, with gradients (3, w, K), w = 1 + 3 b + 4 p."""

    def turn(move: Array) -> Array:
        return turn_ways(angle_terms(turned(quaternion, move))[1], platform)

    turned_by, slopes_of_turn = _with_slopes(turn, jnp.zeros_like(quaternion[1:]))
    moved, slopes = moved_angles(quaternion, pointers)
    there = jnp.concatenate([pointers.moves[:, 0], pointers.moves[:, 1]])[:, None]
    either = [jnp.where(there, sign * moved, _NOWHERE) for sign in (1, -1)]
    return (
        jnp.concatenate([turned_by, *either]),
        jnp.concatenate([slopes_of_turn, slopes, -slopes], axis=1),
    )


def _with_slopes(function: Callable[[Array], Array], move: Array) -> tuple[Array, Array]:
    """Values (..., K) of a function of moves (3, K), lane by lane, and their gradients (3, ..., K)."""

    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(function, (move,), (jnp.zeros_like(move) + direction[:, None],))

    found: tuple[Array, Array] = jax.vmap(along, out_axes=(None, 0))(jnp.eye(3, dtype=move.dtype))
    return found


def paces(pointers: Pointers, platform: Platform) -> tuple[Array, Array]:
    """Tops and growths (1 + 3 b + 4 p,) of the speeds along the ways."""
    found = []
    for of_turn, of_joint in ((platform.top, pointers.rate), (platform.growth, pointers.acceleration)):
        own = jnp.where(pointers.moves, of_joint, 1).T.reshape(-1)
        found.append(jnp.concatenate([of_turn[:1], jnp.tile(of_turn[1:], 3), own, own]))
    return found[0], found[1]


class _Point(NamedTuple):
    """A point of a descent with all that its next step needs."""

    quaternion: Array  # (4, K)
    time: Array  # (K,)
    excess: Array  # (K,) of the caps that apply
    residual: Array  # (K,) of the conditions of optimality, over one plus the sum of the multipliers


class Soonest(NamedTuple):
    """Where the descents ended; K lanes.

    Attributes:
        quaternion: (K, 4) of ``E``, scalar first and below zero beyond half a turn.
        time: (K,) units.
        excess: (K,) rad, depth in the worst cap that applies.
        residual: (K,) of the conditions of optimality.
    """

    quaternion: np.ndarray
    time: np.ndarray
    excess: np.ndarray
    residual: np.ndarray


@quick_jit
def soonest_ends(
    starts: Array,
    times: Array,
    axis: Array,
    direction: Array,
    half_angle: Array,
    member: Array,
    group: Array,
    pointers: Pointers,
    platform: Platform,
) -> Array:
    """The fields of `Soonest` as rows (7, K), of starts (4, K) with times (K,), of `Caps`, and what moves."""
    rates = paces(pointers, platform)
    caps, count = len(axis), len(rates[0])

    def step(_count: int, state: tuple[Array, Array, Active, _Point]) -> tuple[Array, Array, Active, _Point]:
        quaternion, time, active, _ = state
        _, eta, nearness = angle_terms(quaternion)
        body, excess, slopes = cap_terms(quaternion, axis, direction, half_angle)
        excess = jnp.where(applies(excess, member, group), excess, MET)
        way, way_slopes = ways(quaternion, pointers, platform)
        reached, top, bend = reach(time, *rates)
        every = jnp.concatenate([excess, way - reached])
        gradients = jnp.concatenate(
            [
                jnp.concatenate([slopes, way_slopes], axis=1),
                jnp.concatenate([jnp.zeros_like(excess), -top])[None],
            ]
        )

        of_caps = active._replace(number=jnp.where(active.number < caps, active.number, -1))
        curved, _, _ = active_terms(of_caps, axis, body, excess, slopes)
        weight = jnp.sum(
            jnp.where(caps + jnp.arange(count)[:, None, None] == active.number, active.multiplier, 0), axis=1
        )  # (w, K)
        hessian = STILLNESS * nearness + curved + _curvature(quaternion, pointers, platform, weight)
        corner = jnp.maximum(1 - jnp.sum(weight * bend, axis=0), LEAST_CURVATURE)

        chosen = jnp.maximum(active.number, 0)
        depth = jnp.take_along_axis(every, chosen, axis=0)
        used = (active.number >= 0) & (depth > MET)
        depth = jnp.where(used, depth, 0)
        normals = jnp.where(used, jnp.take_along_axis(gradients, chosen[None], axis=1), 0)  # (4, 4, K)
        multiplier = jnp.where(used, active.multiplier, 0)
        scale = 1 + jnp.sum(multiplier, axis=0)
        gradient = jnp.concatenate([STILLNESS * eta, time[None]])
        stationarity = gradient + jnp.sum(multiplier * normals, axis=1)
        slackness = jnp.max(jnp.abs(multiplier * depth), axis=0)
        size = jnp.sqrt(inner(stationarity, stationarity))
        beyond = jnp.max(way - reached, axis=0)  # the time is not the least one yet
        residual = jnp.maximum(jnp.maximum(size, slackness) / scale, beyond)
        point = _Point(quaternion, time, jnp.max(excess, axis=0), residual)

        inverses = _inverse(hessian, corner, normals, PROXIMITY * scale)
        pushed = gradient + PROXIMITY * scale * jnp.sum(normals * depth, axis=1)
        move, active, lost = solve(inverses, pushed, gradients, every)
        matrix, pull = restoration(slopes, excess)
        back = jnp.concatenate([-inner(inverse(matrix), pull[:, None]), jnp.zeros_like(time)[None]])
        move = jnp.where(lost, back, move)
        length = jnp.sqrt(dot(move, move))
        move = move * (LONGEST_STEP / jnp.maximum(length, LONGEST_STEP))
        return turned(quaternion, move[:3]), jnp.clip(time + move[3], *TIMES), active, point

    lanes, dtype = starts.shape[1], starts.dtype
    number = jnp.zeros(lanes, dtype)
    unknown = _Point(starts, number, number, number)
    first = (starts, times, none_active(lanes, dtype, 4), unknown)
    *_, end = jax.lax.fori_loop(0, STEPS + 1, step, first)
    return jnp.concatenate([end.quaternion, jnp.stack([end.time, end.excess, end.residual])])


def _curvature(quaternion: Array, pointers: Pointers, platform: Platform, weight: Array) -> Array:
    """Hessian (3, 3, K) of the sum of ways with weights (w, K)."""

    def pull(move: Array) -> Array:
        return jnp.sum(weight * ways(turned(quaternion, move), pointers, platform)[1], axis=1)

    _, found = _with_slopes(pull, jnp.zeros_like(quaternion[1:]))
    return (found + jnp.swapaxes(found, 0, 1)) / 2


def _inverse(hessian: Array, corner: Array, normals: Array, proximity: Array) -> Array:
    """Inverse (4, 4, K) of the Hessian with the squares of the active constraints, made positive definite.

    Args:
        hessian: (3, 3, K) along turns.
        corner: (K,) along time, positive.
        normals: (4, 4, K) gradients of the active constraints.
        proximity: (K,) weight of their squares.
    """
    along, time = normals[:3], normals[3]
    border = proximity * jnp.sum(along * time, axis=1)
    corner = corner + proximity * jnp.sum(time * time, axis=0)
    rest = hessian + proximity * sum_of_squares(along) - border[:, None] * border[None] / corner
    shift = jnp.maximum(0, LEAST_CURVATURE - least_eigenvalue(rest))
    return bordered_inverse(rest + shift * identity(rest), border, corner)
