"""Unit quaternions as four separate components, scalar first; their formulas are written out only here.

A quaternion is given as its components ``w x y z`` along the first axis (an array (4, ...) or a sequence of
four arrays, see `jaxplan.geometry.vectors`), and results are tuples of four. A quaternion and its negative
are the same rotation; ``R(q)`` is the rotation matrix of ``q``. `jaxplan.geometry.quaternion` has the same
functions for arrays (..., 4), `jaxplan.so3` for matrices and rotation vectors.
"""

from typing import TypeAlias

from jaxplan.geometry.vectors import AnyArray, Components, array_module, dot, unit

Quaternion: TypeAlias = tuple[AnyArray, ...]
"""``w x y z``."""

_MIN_SLERP_SINE = 1e-6  # sine of half the angle, below which chord and arc agree to rounding
_MIN_SQUARED_ANGLE = 1e-16  # rad^2, square of an angle below which its sine equals it to rounding


def product(first: Components, second: Components) -> Quaternion:
    """Quaternion of the rotation ``R(first) @ R(second)``, not normalised."""
    (a, b, c, d), (w, x, y, z) = first, second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def conjugate(quaternion: Components) -> Quaternion:
    """Quaternion of the inverse rotation, with the vector part negated."""
    w, x, y, z = quaternion
    return w, -x, -y, -z


def relative(first: Components, second: Components) -> Quaternion:
    """Quaternion of ``R(first)^T @ R(second)``, the rotation from the first attitude to the second."""
    return product(conjugate(first), second)


def angle(quaternion: Components) -> AnyArray:
    """Angle (...) rad in [0, pi] of the rotation of a quaternion, whatever its sign and length."""
    w, *vector = quaternion
    xp = array_module(w)
    return 2 * xp.arctan2(xp.sqrt(dot(vector, vector)), xp.abs(w))


def matrix(quaternion: Components) -> tuple[tuple[AnyArray, AnyArray, AnyArray], ...]:
    """Rotation matrix of a unit quaternion, as its three rows of three components each."""
    w, x, y, z = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def turned_back(quaternion: Components, vector: Components) -> tuple[AnyArray, ...]:
    """Return ``R(quaternion)^T vector``, which takes an inertial vector to the body axes of an attitude."""
    return tuple(dot(column, vector) for column in zip(*matrix(quaternion), strict=True))


def exp(rotation_vector: Components) -> Quaternion:
    """Unit quaternion of a rotation vector, given as three components (...) in rad."""
    square = dot(rotation_vector, rotation_vector)
    xp = array_module(square)
    small = square < _MIN_SQUARED_ANGLE
    half = xp.sqrt(xp.where(small, 1, square)) / 2
    factor = xp.where(small, 0.5, xp.sin(half) / (2 * half))
    return xp.where(small, 1, xp.cos(half)), *(factor * component for component in rotation_vector)


def slerp(first: Components, second: Components, fraction: AnyArray) -> Quaternion:
    """Unit quaternion on the shortest rotation from one attitude to another, at constant speed.

    Args:
        first: unit quaternion at fraction 0.
        second: unit quaternion at fraction 1, of either sign. Half a turn away, both ways round are shortest,
            and one of them is taken.
        fraction: (...) in [0, 1].
    """
    turn = relative(first, second)
    xp = array_module(turn[0])
    half = angle(turn) / 2
    sine = xp.sin(half)
    straight = sine < _MIN_SLERP_SINE
    divisor = xp.where(straight, 1, sine)
    before = xp.where(straight, 1 - fraction, xp.sin((1 - fraction) * half) / divisor)
    after = xp.where(straight, fraction, xp.sin(fraction * half) / divisor)
    after = xp.where(turn[0] < 0, -after, after)
    return unit([before * a + after * b for a, b in zip(first, second, strict=True)])
