"""Unit quaternions, components first: the one place where their products and matrices are written out.

A quaternion is four components ``w x y z`` as `jaxplan.geometry.vectors` has them, and so are those handed
out. A quaternion and its negative are the same rotation. `jaxplan.geometry.quaternion` has the same for
arrays (..., 4), `jaxplan.so3` for matrices and rotation vectors.
"""

from typing import TypeAlias

from jaxplan.geometry.vectors import AnyArray, Components, array_module, dot, unit

Quaternion: TypeAlias = tuple[AnyArray, ...]
"""``w x y z``."""

_STRAIGHT = 1e-6  # sine of half a turn, below which the chord and the arc are the same to rounding
_SMALL = 1e-16  # rad^2, below which a sine is its angle


def product(first: Components, second: Components) -> Quaternion:
    """Quaternion of ``R(first) @ R(second)``."""
    (a, b, c, d), (w, x, y, z) = first, second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def conjugate(quaternion: Components) -> Quaternion:
    """Quaternion of the inverse rotation."""
    w, x, y, z = quaternion
    return w, -x, -y, -z


def relative(first: Components, second: Components) -> Quaternion:
    """Quaternion of ``R(first)^T @ R(second)``, the turn from the first attitude to the second."""
    return product(conjugate(first), second)


def angle(quaternion: Components) -> AnyArray:
    """Angle of the rotation, rad in [0, pi]."""
    w, *vector = quaternion
    xp = array_module(w)
    return 2 * xp.arctan2(xp.sqrt(dot(vector, vector)), xp.abs(w))


def matrix(quaternion: Components) -> tuple[tuple[AnyArray, AnyArray, AnyArray], ...]:
    """Rows of the rotation matrix, three components each."""
    w, x, y, z = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def turned_back(quaternion: Components, vector: Components) -> tuple[AnyArray, ...]:
    """``R(quaternion)^T vector``: of an attitude's quaternion the body coordinates of an inertial vector."""
    return tuple(dot(column, vector) for column in zip(*matrix(quaternion), strict=True))


def exp(rotation_vector: Components) -> Quaternion:
    """Quaternion of a rotation vector, rad."""
    square = dot(rotation_vector, rotation_vector)
    xp = array_module(square)
    small = square < _SMALL
    half = xp.sqrt(xp.where(small, 1, square)) / 2
    factor = xp.where(small, 0.5, xp.sin(half) / (2 * half))
    return xp.where(small, 1, xp.cos(half)), *(factor * component for component in rotation_vector)


def slerp(first: Components, second: Components, fraction: AnyArray) -> Quaternion:
    """Quaternion on the shortest rotation from one attitude to another, at constant speed.

    Args:
        first: at fraction 0.
        second: at fraction 1, of either sign; half a turn away, either way round is the shortest.
        fraction: in [0, 1].
    """
    turn = relative(first, second)
    xp = array_module(turn[0])
    half = angle(turn) / 2
    sine = xp.sin(half)
    straight = sine < _STRAIGHT
    divisor = xp.where(straight, 1, sine)
    before = xp.where(straight, 1 - fraction, xp.sin((1 - fraction) * half) / divisor)
    after = xp.where(straight, fraction, xp.sin(fraction * half) / divisor)
    after = xp.where(turn[0] < 0, -after, after)
    return unit([before * a + after * b for a, b in zip(first, second, strict=True)])
