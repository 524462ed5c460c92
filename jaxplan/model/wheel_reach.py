"""What an array of n wheels reaches, in any direction and by a form, and what part of it each wheel gives.

Together the wheels give a torque, or hold a momentum, ``x = sum a_k u_k`` with their axes ``a_k`` and with
``|u_k|`` at most ``limit_k``; momenta by which they work against each other (``apart``) are not in ``x``. By
the pseudo-inverse wheel k has the part ``a_k . y`` of it, where ``x = S y`` and ``S`` is the sum of the
``a_k a_k^T``. So all torques, or all momenta, lie in

    {S y: lower_k <= a_k . y <= upper_k}         under the pseudo-inverse,
    {sum a_k u_k: |u_k| <= limit_k}              under the envelope, which contains the former.

The bounds of torque are ``-limit_k`` and ``limit_k``, those of momentum these less ``apart_k``.

Under the pseudo-inverse, for a direction ``c`` and any three wheels whose axes span space,
``S c = sum l_k a_k`` gives ``c . x = sum l_k (a_k . y)`` and so a bound; as this is a linear program, the
least of these bounds is the largest ``c . x`` itself. A quadratic form, ``sqrt(x . M x)``, is largest at a
corner of the set: a point where three wheels are at a bound.

**What each wheel gives and holds** is by the pseudo-inverse a row of the array (`jaxplan.model.wheels`). By
the envelope it is the distribution in which the largest ratio of a wheel's part to its limit is least, for
torque and momentum separately: the least ``s`` with ``x = sum a_k u_k`` and ``|u_k| <= s limit_k`` (Markley,
Reynolds, Liu and Lebsock, "Maximum torque and momentum envelopes for reaction wheel arrays", NASA
20110015369). It needs no linear program: ``s`` is that of the face ``f`` of the envelope which ``x`` comes
nearest to. Every wheel whose axis is not in the plane of the face works at ``s`` of its limit, on the side of
``f``. The rest of ``x`` lies in the plane, and is distributed in the same way: all wheels in the plane work
at the ratio of the line which the rest comes nearest to, except those along that line, which take what is
left.

Body axes, N m, N m s.
"""

from collections.abc import Iterator
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from jaxplan.geometry.vectors import AnyArray, arrays, cross, dot, length, min_along
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.quadratic import inverse_of, largest_size
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import PSEUDO_INVERSE, least_shares
from jaxplan.runtime.compute_once import made_once

_MAX_WHEELS_AT_ONCE = 8  # largest number of wheels whose 2^(n - 1) corners are listed together
_PLANAR_VOLUME = 1e-12  # volume of three unit axes below which they lie in a plane but for rounding
_PRECISE_VOLUME = 1e-6  # volume of three unit axes from which on what follows from them is precise
_CORNER_TOLERANCE = 1e-6  # fraction of a range by which a corner may lie beyond it, for rounding
_MAX_FRAMES = 6  # most frames whose boxes are fitted to what wheels allow
_EVEN = 1e-9  # share of its trace below which two principal values of a form count as equal
_ORTHOGONALITY_TOLERANCE = 1e-9  # product of unit vectors below which they count as at right angles


class Reach(NamedTuple):
    """The set of all torques, or of all momenta, that an array of n wheels reaches.

    Attributes:
        axes: (n, 3) unit vectors in body axes.
        each: (n,) N m or N m s, the wheels' limits.
        lower: (n,) least values of ``a_k . y``; None for the envelope.
        upper: (n,) largest values of ``a_k . y``; None for the envelope.
        corners: groups (v, 3) of vectors. The set lies in the convex hull of all sums that take one vector,
            or its opposite, from each group.
    """

    axes: AnyArray
    each: AnyArray
    lower: AnyArray | None
    upper: AnyArray | None
    corners: tuple[AnyArray, ...]

    def along(self, directions: AnyArray) -> AnyArray:
        """Return the largest ``|c . x|`` (k,) of vectors x of the set, for directions c (k, 3).

        The directions may have any length.
        """
        xp, directions, axes, each = arrays(directions, self.axes, self.each)
        found = xp.abs(directions @ axes.T) @ each
        if self.lower is None or self.upper is None:
            return found
        three, inverses, volume = _axis_triples(axes)
        shares = xp.einsum(
            "ki,tij->tkj", directions @ (axes.T @ axes), inverses
        )  # ``l``, for each choice of three
        lower, upper = (bound[three][:, None] for bound in (self.lower, self.upper))
        both = [xp.maximum(own * lower, own * upper).sum(axis=2) for own in (shares, -shares)]
        each_way = [min_along(xp.where(volume[:, None] < _PRECISE_VOLUME, xp.inf, own), 0) for own in both]
        return xp.minimum(found, xp.maximum(*each_way))

    def largest(self, matrix: AnyArray) -> AnyArray:
        """Return an upper bound of ``sqrt(x . matrix x)`` for vectors x of the set.

        It is reached if there is one group of corners.
        """
        return sum(largest_size(own, matrix) for own in self.corners)


@made_once
def reaches(craft: Spacecraft) -> tuple[Reach, Reach]:
    """Return the set of torques and the set of momenta that a spacecraft's wheels reach.

    Raises:
        ValueError: if it has no wheels.
    """
    array = craft.wheel_array
    if array is None:
        raise ValueError("there are no wheels")
    found = []
    for each, apart in ((array.each_torque, 0 * array.each_torque), (array.each_momentum, array.apart)):
        _, axes, each = arrays(array.axes, each)
        if craft.allocation != PSEUDO_INVERSE:
            found.append(Reach(axes, each, None, None, tuple(_sums_at_bounds(axes, each))))
            continue
        lower, upper = -each - apart, each - apart
        corners = list(_sums_at_bounds(axes, each))
        if len(axes) <= _MAX_WHEELS_AT_ONCE:
            corners = [_polytope_corners(axes, lower, upper, corners[0])]
        found.append(Reach(axes, each, lower, upper, tuple(corners)))
    torque, momentum = found
    return torque, momentum


@made_once
def fitted_frames(craft: Spacecraft) -> AnyArray:
    """Return frames (f, 3, 3) in which boxes closely fit what angular velocities and accelerations can be.

    The first axis of each, its first row, is at right angles to one of the nearest faces of these sets, whose
    faces are parallel; a face that there is not gives the body's x axis. The other two are the principal axes
    of the squares of all faces, as they look along the first.

    Raises:
        ValueError: if there are no wheels.
    """
    array = craft.wheel_array
    if array is None:
        raise ValueError("there are no wheels")
    xp, inertia, rows, torque, momentum = arrays(
        craft.whole_inertia, array.rows, array.torque, array.momentum
    )
    faces = rows @ inertia / xp.sqrt(torque * momentum)[:, None]
    form = faces.T @ faces
    faces = faces[xp.argsort(-length(faces))[:_MAX_FRAMES]]
    size = length(faces)[:, None]
    first = xp.where(size > 0, faces / xp.where(size > 0, size, 1), np.eye(3)[0])
    side = xp.cross(first, xp.asarray(np.eye(3))[xp.argmin(xp.abs(first), axis=1)])
    side = side / length(side)[:, None]
    other = xp.cross(first, side)
    of_side, of_other = side @ form, other @ form
    twist = 2 * xp.sum(of_side * other, axis=1)
    spread = xp.sum(of_side * side - of_other * other, axis=1)
    even = twist**2 + spread**2 < (_EVEN * xp.trace(form)) ** 2
    half = (xp.arctan2(xp.where(even, 0, twist), xp.where(even, 1, spread)) / 2)[:, None]
    second = xp.cos(half) * side + xp.sin(half) * other
    return xp.stack([first, second, xp.cross(first, second)], axis=1)


class WheelSpeeds(NamedTuple):
    """How fast wheels let a body turn, and how fast its angular velocity may change.

    Attributes:
        torque: torques that the wheels reach.
        momentum: momenta that they reach.
        inverse: (3, 3) inverse of the inertia, 1 / (kg m^2).
        total: N m s, length of the total momentum of platform and wheels, which must be turned with the body.
        carried: N m s, bound of the momentum that moving gimbals add.
        pushed: N m, bound of the torque that moving gimbals add.
    """

    torque: Reach
    momentum: Reach
    inverse: AnyArray
    total: AnyArray
    carried: AnyArray = 0.0
    pushed: AnyArray = 0.0

    @classmethod
    def of(cls, craft: Spacecraft, total: AnyArray, inertia: AnyArray) -> "WheelSpeeds":
        """Make it for a spacecraft with wheels, without the effect of moving gimbals.

        Args:
            craft: the spacecraft.
            total: N m s, length of the total momentum of platform and wheels.
            inertia: (3, 3) kg m^2, of the platform.
        """
        return cls(*reaches(craft), inverse_of(inertia), total)

    def rate(self, axes: AnyArray) -> AnyArray:
        """Return bounds (k,) rad/s of the angular velocity along unit vectors (k, 3) in body axes."""
        light = axes @ self.inverse
        return self.momentum.along(light) + length(light) * (self.total + self.carried)

    def acceleration(self, axes: AnyArray, top: AnyArray) -> AnyArray:
        """Return bounds (k,) rad/s^2 of the angular acceleration along unit vectors.

        Args:
            axes: (k, 3) unit vectors in body axes.
            top: rad/s, bound of the length of the angular velocity.
        """
        light = axes @ self.inverse
        return self.torque.along(light) + length(light) * (self.total * top + self.pushed)

    def boxes(
        self, frames: AnyArray, rate: AnyArray, acceleration: AnyArray, top: AnyArray
    ) -> tuple[AnyArray, AnyArray]:
        """Return bounds of angular velocity and acceleration along the axes of frames.

        Args:
            frames: (f, 3, 3), three unit vectors at right angles as rows of each, such as `fitted_frames`.
            rate: (3,) rad/s, bounds along the body axes.
            acceleration: (3,) rad/s^2, likewise.
            top: rad/s, bound of the length of the angular velocity.

        Returns:
            Bounds (f, 3) rad/s and (f, 3) rad/s^2.
        """
        xp, axes, rate, acceleration = arrays(frames.reshape(-1, 3), rate, acceleration)
        spread = xp.abs(axes)
        limits = (self.rate(axes), spread @ rate), (self.acceleration(axes, top), spread @ acceleration)
        rates, accelerations = (xp.minimum(*own).reshape(-1, 3) for own in limits)
        return rates, accelerations

    def top(self, plane: AnyArray) -> AnyArray:
        """Return a bound, rad/s, of the length of the angular velocity's projection by a matrix (3, 3)."""
        return self._bound_length(self.momentum, plane, self.total + self.carried)

    def growth(self, plane: AnyArray, top: AnyArray) -> AnyArray:
        """Return a bound, rad/s^2, of the length of the angular acceleration's projection.

        Args:
            plane: (3, 3) matrix of the projection.
            top: rad/s, bound of the length of the angular velocity.
        """
        return self._bound_length(self.torque, plane, self.total * top + self.pushed)

    def _bound_length(self, reach: Reach, plane: AnyArray, beside: AnyArray) -> AnyArray:
        """Return a bound of the length of ``plane @ inverse @ (x + b)``.

        Here x is any vector of `reach`, and b any vector whose length is at most `beside`.
        """
        light = plane @ self.inverse
        return reach.largest(light.T @ light) + length(length(light)) * beside


def _axis_triples(axes: AnyArray) -> tuple[np.ndarray, AnyArray, AnyArray]:
    """Return all choices of three of the axes (n, 3).

    Returns:
        Their numbers (t, 3); the inverses (t, 3, 3) of the matrices that have the three axes as rows; and the
        volumes (t,) that they span. Inverses for axes in a plane are finite, and mean nothing.
    """
    xp, axes = arrays(axes)
    three = np.array(list(combinations(range(len(axes)), 3)))
    first, second, third = (axes[three[:, place]].T for place in range(3))
    pairs = (second, third), (third, first), (first, second)
    across = xp.stack([xp.stack(cross(*pair)) for pair in pairs])  # (pair, component, t)
    volume = dot(first, across[0])
    inverses = across.T / xp.where(xp.abs(volume) < _PLANAR_VOLUME, 1, volume)[:, None, None]
    return three, inverses, xp.abs(volume)


def _polytope_corners(axes: AnyArray, lower: AnyArray, upper: AnyArray, others: AnyArray) -> AnyArray:
    """Return the corners (v, 3) of ``{S y: lower <= axes y <= upper}``.

    Args:
        axes: (n, 3).
        lower: (n,).
        upper: (n,).
        others: (w, 3) vectors whose hull, with their opposites, contains the set.

    Returns:
        The corners, and zeros in place of intersections of three planes that are no corners. If three axes
        lie so nearly in a plane that one of their corners may be lost to rounding, the `others` follow; else
        w zeros.
    """
    xp, axes, lower, upper = arrays(axes, lower, upper)
    three, inverses, volume = _axis_triples(axes)
    high = np.array(list(product((False, True), repeat=3)))
    bounds = xp.where(high[None], upper[three][:, None], lower[three][:, None])  # (t, 8, 3)
    y = xp.einsum("tij,tsj->tsi", inverses, bounds).reshape(-1, 3)
    parts, room = y @ axes.T, _CORNER_TOLERANCE * (upper - lower)
    inside = xp.all((parts >= lower - room) & (parts <= upper + room), axis=1)
    inside &= xp.repeat(volume >= _PLANAR_VOLUME, len(high))
    found = xp.where(inside[:, None], y, 0) @ (axes.T @ axes)
    thin = xp.any((volume >= _PLANAR_VOLUME) & (volume < _PRECISE_VOLUME))
    return xp.concatenate([found, xp.where(thin, others, 0)])


def _sums_at_bounds(axes: AnyArray, bound: AnyArray) -> Iterator[AnyArray]:
    """Yield for every few wheels all sums (v, 3) of ``axes_k u_k`` with ``u_k`` at plus or minus its bound.

    Of two opposite sums one is left out.
    """
    xp, axes, bound = arrays(axes, bound)
    vectors = axes * bound[:, None]
    for first in range(0, len(vectors), _MAX_WHEELS_AT_ONCE):
        own = vectors[first : first + _MAX_WHEELS_AT_ONCE]
        signs = np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=len(own) - 1)])
        yield xp.asarray(signs) @ own


def wheel_loads(motion: Kinematics, craft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Return the torques (n, ...) N m and momenta (n, ...) N m s of the n wheels, positive about their axes.

    Args:
        motion: the motion, with inertia, total momentum and array of wheels; of numpy arrays.
        craft: the spacecraft.

    Raises:
        ValueError: if there are no wheels.
    """
    array = motion.array
    if array is None or motion.total is None:
        raise ValueError("without wheels they give and hold nothing")
    if craft.allocation == PSEUDO_INVERSE:
        return np.asarray(motion.wheel_torques), np.asarray(motion.wheel_momenta)
    given, held = np.asarray(motion.torque), np.asarray(motion.total - motion.momentum)
    parts = ((given, array.each_torque), (held, array.each_momentum))
    torque, momentum = (shared_out(array.axes, limit, vectors) for vectors, limit in parts)
    return torque, momentum


def shared_out(axes: np.ndarray, limit: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Distribute vectors over wheels so that the largest ratio of a wheel's part to its limit is least.

    Args:
        axes: (n, 3) unit vectors that span space, the wheels' axes.
        limit: (n,) positive limits of the wheels.
        vectors: (3, ...) in the unit of the limits.

    Returns:
        (n, ...) the part of each wheel, along its axis; the parts add up to the vectors.
    """
    x = np.moveaxis(vectors, 0, -1).reshape(-1, 3)
    share, face = least_shares(axes, limit, x)
    side = face @ axes.T  # (k, n)
    within = np.abs(side) <= _ORTHOGONALITY_TOLERANCE
    found = np.where(within, 0, np.sign(side) * share[:, None] * limit)
    rest = x - found @ axes
    lines = np.cross(face[:, None], axes)  # (k, n, 3), in the plane and across each wheel of it
    reach = np.abs(np.einsum("kni,mi->knm", lines, axes)) * within[:, None] @ limit
    shares = np.where(within, np.einsum("kni,ki->kn", lines, rest) / np.where(reach > 0, reach, 1), 0)
    own = np.argmax(np.where(within, np.abs(shares), -1), axis=1)
    each = np.arange(len(x))
    share, line = shares[each, own], lines[each, own]
    side = line @ axes.T
    along = within & (np.abs(side) <= _ORTHOGONALITY_TOLERANCE)
    found += np.where(within & ~along, np.sign(side) * share[:, None] * limit, 0)
    rest = x - found @ axes
    chosen = axes[own]
    turned = np.where(along, np.sign(chosen @ axes.T), 0) * limit
    found += turned * (np.sum(rest * chosen, axis=1) / np.abs(turned).sum(axis=1))[:, None]
    return np.moveaxis(found.reshape(*np.moveaxis(vectors, 0, -1).shape[:-1], len(axes)), -1, 0)
