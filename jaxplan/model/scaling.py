"""How a motion keeps limits by taking longer.

A motion that takes ``s`` times as long passes the same attitudes and joint angles, and what is limited falls
by a power of ``s``; a *lesser* part of it falls by one power less (`jaxplan.model.limits`). So the shortest
time in which a motion keeps a limit follows exactly from the largest share of the limit that is taken.
"""

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, arrays

_FULL = 1 + 1e-12  # share of a limit up to which its lesser part counts as within


def time_factor(share: ArrayLike, power: int | np.ndarray, lesser: ArrayLike | None = None) -> AnyArray:
    """How many times as long a motion has to take for a share of a limit to become one.

    Args:
        share: (...) magnitude over limit, of a quantity whose power is above zero; beside a lesser part with
            its sign.
        power: its power, 1 or more; 1 or 2 beside a lesser part.
        lesser: (...) likewise, what is to be added and falls by one power less; None for nothing.

    Returns:
        ``share ** (1 / power)``; at zero, where a root has no derivative, the derivative is taken as zero.
        With a lesser part the least factor from which on the sum stays within the limit, whatever it is in
        less time; infinite where there is none.
    """
    if lesser is not None:
        return _time_root(share, power, lesser)
    xp, given = arrays(share)
    zero = given == 0
    return xp.where(zero, 0, xp.where(zero, 1, given) ** (1 / power))


def _time_root(share: ArrayLike, power: int | np.ndarray, lesser: ArrayLike) -> AnyArray:
    """The least ``s`` from which on ``|share / s^p + lesser / s^(p - 1)| <= 1``, with ``p`` the power."""
    xp, a, b = arrays(share, lesser)
    if power == 1:
        room = 1 - xp.where(a < 0, -b, b)
        open_ = room > 0
        found = xp.where(open_, xp.abs(a) / xp.where(open_, room, 1), xp.where(a == 0, 0, xp.inf))
        return xp.where(xp.abs(b) > _FULL, xp.inf, xp.where(xp.isnan(a + b), xp.nan, found))
    found = xp.where(xp.isnan(a + b), xp.nan, 0 * a)
    for sign in (1, -1):  # the larger root of s^2 - sign b s - sign a
        square = b * b + 4 * sign * a
        real = square > 0
        size, along = xp.sqrt(xp.where(real, square, 1)), sign * b
        back = xp.where(along < 0, size - along, 1)  # so that no digits cancel
        root = xp.where(along < 0, 2 * sign * a / back, (along + size) / 2)
        found = xp.where(real & (root > found), root, found)
    return found
