"""How a motion is slowed down so that it keeps limits.

A motion that is slowed down to ``s`` times its duration passes the same attitudes and joint angles, and what
is limited falls by a power of ``s``; a *lesser* part of it falls by one power less (`jaxplan.model.limits`).
So the shortest duration at which it keeps a limit follows exactly from the largest fraction of the limit that
it uses.
"""

import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, arrays

_MAX_LESSER_SHARE = 1 + 1e-12  # fraction of a limit up to which a lesser part counts as within it


def time_factor(share: ArrayLike, power: int | np.ndarray, lesser: ArrayLike | None = None) -> AnyArray:
    """Return by how much the duration of a motion must be multiplied to use exactly the whole of a limit.

    Args:
        share: (...) magnitude of a quantity over its limit, the quantity having a power above zero. If there
            is a lesser part, the rest of the quantity over its limit, with its sign.
        power: the power of the quantity: 1 or more; with a lesser part 1 or 2.
        lesser: (...) lesser part of the quantity over its limit, with its sign; None for none.

    Returns:
        ``share ** (1 / power)``; at zero, where the root has no derivative, zero is taken for it. With a
        lesser part the least factor such that the limit is kept at this and at all larger factors; infinite
        if there is none.
    """
    if lesser is not None:
        return _least_time_factor(share, power, lesser)
    xp, given = arrays(share)
    zero = given == 0
    return xp.where(zero, 0, xp.where(zero, 1, given) ** (1 / power))


def _least_time_factor(share: ArrayLike, power: int | np.ndarray, lesser: ArrayLike) -> AnyArray:
    """Return the least ``s`` from which on ``|share / s^p + lesser / s^(p - 1)| <= 1``, with p the power."""
    xp, a, b = arrays(share, lesser)
    if power == 1:
        room = 1 - xp.where(a < 0, -b, b)
        open_ = room > 0
        found = xp.where(open_, xp.abs(a) / xp.where(open_, room, 1), xp.where(a == 0, 0, xp.inf))
        return xp.where(xp.abs(b) > _MAX_LESSER_SHARE, xp.inf, xp.where(xp.isnan(a + b), xp.nan, found))
    found = xp.where(xp.isnan(a + b), xp.nan, 0 * a)
    for sign in (1, -1):  # the larger root of s^2 - sign b s - sign a
        square = b * b + 4 * sign * a
        real = square > 0
        size, along = xp.sqrt(xp.where(real, square, 1)), sign * b
        back = xp.where(along < 0, size - along, 1)  # so that no digits cancel
        root = xp.where(along < 0, 2 * sign * a / back, (along + size) / 2)
        found = xp.where(real & (root > found), root, found)
    return found
