"""What an array of wheels reaches: its largest torque and momentum along a direction, and by a form.

The wheels give, or hold beside what they hold against each other, ``x = sum a_k u_k`` with ``|u_k|`` at most
their limits. By the pseudo-inverse wheel k has the part ``a_k . y`` of it, where ``x = S y`` and ``S`` is the
sum of the ``a_k a_k^T``. So torque and momentum lie in

    {S y: lower_k <= a_k . y <= upper_k}         under the pseudo-inverse,
    {sum a_k u_k: |u_k| <= upper_k}              under the envelope, which holds the former,

with bounds of momentum about what wheels hold against each other, ``apart``.

Of any three wheels whose axes span space, ``c = sum l_k (S a'_k)`` of a direction ``c`` gives ``c . x = sum
l_k (a_k . y)``, and so a bound; of a linear program the least of them is the largest ``c . x`` itself. Where
``sqrt(x . M x)`` is largest, is a corner: one where three wheels are at a bound.

Body axes, N m, N m s.
"""

from collections.abc import Iterator
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from jaxplan.geometry.vectors import AnyArray, arrays, length
from jaxplan.model.quadratic import inverse_of, largest_size
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import PSEUDO_INVERSE
from jaxplan.runtime.once import made_once

_AT_ONCE = 8  # wheels whose corners are looked at together, half of two to the power of this
_FLAT = 1e-12  # volume of three axes, below which they lie in a plane but for rounding
_THIN = 1e-6  # likewise, from which on what three wheels say is precise
_BEYOND = 1e-6  # of a limit, by which a corner may be beyond it, since it is rounded


class Reach(NamedTuple):
    """All torques or all momenta of an array of n wheels.

    Attributes:
        axes: (n, 3) unit vectors in body axes.
        each: (n,) N m or N m s, the wheels' limits.
        lower: (n,) the least ``a_k . y``; None for the envelope.
        upper: (n,) the largest; likewise.
        corners: groups (v, 3): of each sum of one out of each group the convex hull has all of the reach.
    """

    axes: AnyArray
    each: AnyArray
    lower: AnyArray | None
    upper: AnyArray | None
    corners: tuple[AnyArray, ...]

    def along(self, directions: AnyArray) -> AnyArray:
        """The largest products (k,) of vectors of the reach, or their opposites, with directions (k, 3)."""
        xp, directions, axes, each = arrays(directions, self.axes, self.each)
        found = xp.abs(directions @ axes.T) @ each
        if self.lower is None or self.upper is None:
            return found
        three, inverses, volume = _threes(axes)
        shares = xp.einsum("ki,tij->tkj", directions @ (axes.T @ axes), inverses)  # of both, at each three
        lower, upper = (bound[three][:, None] for bound in (self.lower, self.upper))
        both = [xp.maximum(own * lower, own * upper).sum(axis=2) for own in (shares, -shares)]
        each_way = [xp.min(xp.where(volume[:, None] < _THIN, xp.inf, own), axis=0) for own in both]
        return xp.minimum(found, xp.maximum(*each_way))

    def largest(self, matrix: AnyArray) -> AnyArray:
        """The largest ``sqrt(x . matrix x)`` of the reach, or more."""
        return sum(largest_size(own, matrix) for own in self.corners)


@made_once
def reaches(craft: Spacecraft) -> tuple[Reach, Reach]:
    """The torques and the momenta that a spacecraft's wheels reach, which it has."""
    array = craft.wheel_array
    if array is None:
        raise ValueError("there are no wheels")
    found = []
    for each, apart in ((array.each_torque, 0 * array.each_torque), (array.each_momentum, array.apart)):
        _, axes, each = arrays(array.axes, each)
        if craft.allocation != PSEUDO_INVERSE:
            found.append(Reach(axes, each, None, None, tuple(_sums(axes, each))))
            continue
        lower, upper = -each - apart, each - apart
        corners = list(_sums(axes, each))
        if len(axes) <= _AT_ONCE:
            corners = [_corners(axes, lower, upper, corners[0])]
        found.append(Reach(axes, each, lower, upper, tuple(corners)))
    torque, momentum = found
    return torque, momentum


class WheelSpeeds(NamedTuple):
    """How fast wheels let a body turn, and how fast that changes, with what they hold at the start.

    Attributes:
        torque: that they reach.
        momentum: likewise.
        inverse: (3, 3) of the inertia, 1 / (kg m^2).
        total: N m s, length of the total momentum, which the body turns against.
        carried: N m s, by which gimbals that move change the momentum at most.
        pushed: N m, by which they change the torque at most.
    """

    torque: Reach
    momentum: Reach
    inverse: AnyArray
    total: AnyArray
    carried: AnyArray = 0.0
    pushed: AnyArray = 0.0

    @classmethod
    def of(cls, craft: Spacecraft, total: AnyArray, inertia: AnyArray) -> "WheelSpeeds":
        """Make the bound for a spacecraft with wheels.

        Args:
            craft: the spacecraft.
            total: N m s, norm of the angular momentum of platform and wheels.
            inertia: (3, 3) kg m^2, of the platform.
        """
        return cls(*reaches(craft), inverse_of(inertia), total)

    @property
    def rate(self) -> AnyArray:
        """(3,) rad/s, the largest components of the angular velocity."""
        return self.momentum.along(self.inverse) + length(self.inverse) * (self.total + self.carried)

    def acceleration(self, top: AnyArray) -> AnyArray:
        """(3,) rad/s^2, those of the acceleration while the body turns by at most `top` rad/s."""
        beside = self.total * top + self.pushed
        return self.torque.along(self.inverse) + length(self.inverse) * beside

    def top(self, plane: AnyArray) -> AnyArray:
        """rad/s, the largest length of the angular velocity's projection, by a matrix (3, 3)."""
        return self._length(self.momentum, plane, self.total + self.carried)

    def growth(self, plane: AnyArray, top: AnyArray) -> AnyArray:
        """rad/s^2, likewise of the acceleration while the body turns by at most `top` rad/s."""
        return self._length(self.torque, plane, self.total * top + self.pushed)

    def _length(self, reach: Reach, plane: AnyArray, beside: AnyArray) -> AnyArray:
        """The largest length of a projection of the inverse's products with a reach and with a vector."""
        light = plane @ self.inverse
        return reach.largest(light.T @ light) + length(length(light)) * beside


def _threes(axes: AnyArray) -> tuple[np.ndarray, AnyArray, AnyArray]:
    """All choices of three axes (t, 3), the inverses (t, 3, 3) of these as rows, and their volumes (t,).

    Inverses of choices that lie in a plane are finite.
    """
    xp, axes = arrays(axes)
    three = np.array(list(combinations(range(len(axes)), 3)))
    first, second, third = (axes[three[:, place]] for place in range(3))
    across = xp.stack([xp.cross(second, third), xp.cross(third, first), xp.cross(first, second)], axis=2)
    volume = xp.sum(first * across[..., 0], axis=1)
    inverses = across / xp.where(xp.abs(volume) < _FLAT, 1, volume)[:, None, None]
    return three, inverses, xp.abs(volume)


def _corners(axes: AnyArray, lower: AnyArray, upper: AnyArray, others: AnyArray) -> AnyArray:
    """The corners (v, 3) of ``{S y: lower <= axes y <= upper}``, with zeros in the place of what is none.

    Where three axes lie so nearly in a plane that a corner of theirs may be lost in rounding, there are
    `others` beside them (w, 3), whose hull has all of it.
    """
    xp, axes, lower, upper = arrays(axes, lower, upper)
    three, inverses, volume = _threes(axes)
    high = np.array(list(product((False, True), repeat=3)))
    bounds = xp.where(high[None], upper[three][:, None], lower[three][:, None])  # (t, 8, 3)
    y = xp.einsum("tij,tsj->tsi", inverses, bounds).reshape(-1, 3)
    parts, room = y @ axes.T, _BEYOND * (upper - lower)
    inside = xp.all((parts >= lower - room) & (parts <= upper + room), axis=1)
    inside &= xp.repeat(volume >= _FLAT, len(high))
    found = xp.where(inside[:, None], y, 0) @ (axes.T @ axes)
    thin = xp.any((volume >= _FLAT) & (volume < _THIN))
    return xp.concatenate([found, xp.where(thin, others, 0)])


def _sums(axes: AnyArray, bound: AnyArray) -> Iterator[AnyArray]:
    """Yield of every few wheels all sums (v, 3) of ``axes_k u_k`` with ``u_k`` at a bound, but opposites."""
    xp, axes, bound = arrays(axes, bound)
    vectors = axes * bound[:, None]
    for first in range(0, len(vectors), _AT_ONCE):
        own = vectors[first : first + _AT_ONCE]
        signs = np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=len(own) - 1)])
        yield xp.asarray(signs) @ own
