r"""How programs interpolate a table of attitudes, as pieces of motion that can be certified.

A *reader* is a program that takes a table and interpolates between its rows. Let the body attitudes (body to
inertial) of row ``k`` and the next, ``h`` seconds later, be ``R_k`` and ``R_{k+1}``, with the turn
``theta n`` between them (``R_k^T R_{k+1} = exp(theta n^)``, ``n`` a unit vector):

- `SLERP`: a turn about one axis at constant rate, ``R_k exp(theta n^ t / h)``. SPICE's C-kernels of type 3,
  STK at interpolation order 1, and most libraries do this.
- `LINEAR`: components of the quaternion are linear, and the result is scaled to unit length. The axis is the
  same but the rate is not constant: with ``c = tan(theta / 4)`` the angle from the middle is ``2 atan(c x)``,
  where x goes from -1 to 1.
- `RODRIGUES`: modified Rodrigues parameters are linear, as in Basilisk's ``waypointReference``. Those of both
  ends have length at most one; if they are more than one apart, the second is replaced by its shadow set.
- `RATE`: the angular velocity of row ``k`` is kept, ``R_k exp(t omega_k^)``, as in C-kernels of type 2; the
  attitude jumps where that misses the next row.
- `HERMITE`: the rotation vector from ``R_k`` is the cubic through both rows' attitudes and angular
  velocities.

Joints are linear from row to row; with `HERMITE` they are cubic where the table has their rates.

`SLERP`, `RATE` and `HERMITE` are pieces of `jaxplan.certificate` as they stand. Motions of `LINEAR` and
`RODRIGUES` are cut so finely that a turn about one axis at constant rate is close. On a part of ``h`` seconds
with ``|omega| <= w`` and ``|omega'| <= a`` the angular velocity differs from that of the turn, ``omega_0``,
by at most ``a h / 2 (1 + h w / 6)``, since by Magnus' expansion the mean of ``omega`` differs from
``omega_0`` by at most ``w a h^2 / 12``. The angle between two attitudes changes no faster than the difference
of their angular velocities, so it is at most half of ``h`` times that difference. For `LINEAR`,
``a = 16 c^3 / h^2`` with the ``c`` above. For `RODRIGUES`, with parameters ``s`` that are linear::

    omega' = 8 |s'|^2 s / (1 + s^2)^2 - 16 (s . s') N / (1 + s^2)^3,   |N| = (1 + s^2) |s'|,

so that ``a = 24 |s'|^2 max x / (1 + x^2)^2 < 7.8 |s'|^2``, and ``w = 4 |s'|``.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan import so3
from jaxplan.geometry import quaternion
from jaxplan.tables.table import HERMITE, LINEAR, RATE, RODRIGUES, SLERP, AttitudeTable

# 24 times the largest of x / (1 + x^2)^2, which is at x = 1 / sqrt(3).
_RODRIGUES_ACCELERATION = 24 * 9 / (16 * np.sqrt(3))
_LARGEST_PART_TURN = 0.1  # rad, for which the terms of Magnus' expansion left out are below 1 %
_SAFETY_FACTOR = 1.05  # factor on bounds that covers those terms and h w / 6
_SMALLEST_TURN = 1e-9  # rad: turns below which the axis of rotation is not used
MOST_PARTS = 2_000_000
"""Most pieces that a table is cut into."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """The motion that a reader makes of a table, in the form of trajectories for `jaxplan.certificate`.

    It has n pieces of the platform and, for k rows, k - 1 intervals between rows; p is the polynomials'
    degree.

    Attributes:
        breaks: (n + 1,) s from the first row on, ends of the platform's pieces.
        chart_attitude: (n, 3, 3) rotation matrices, body to inertial, at the start of each piece.
        chart_rate: (n, 3) rad/s, body axes, angular velocity of each piece's chart.
        coefficients: (n, p + 1, 3) rad, Legendre coefficients of ``b`` (see `jaxplan.certificate.motion`).
        joint_breaks: (k,) s, times of the rows.
        joint_coefficients: (k - 1, p + 1, J) rad, Legendre coefficients of the J joints.
        smoothness: number of derivatives that are claimed to be continuous; -1 claims nothing.
        off: rad, bound of the angle between the motion and these pieces.
        rate_off: rad/s, bound of the difference of their angular velocities.
        begins: (k - 1, 3) rad/s in body axes, angular velocity at the start of each interval of the table.
        ends: (k - 1, 3) rad/s in body axes, angular velocity at its end.
    """

    breaks: np.ndarray
    chart_attitude: np.ndarray
    chart_rate: np.ndarray
    coefficients: np.ndarray
    joint_breaks: np.ndarray
    joint_coefficients: np.ndarray
    smoothness: int = -1
    off: float = 0.0
    rate_off: float = 0.0
    begins: np.ndarray
    ends: np.ndarray

    @property
    def chart_start(self) -> np.ndarray:
        """(n,) s, start of each platform piece."""
        return self.breaks[:-1]

    def part(self, first: int, last: int) -> "Reading":
        """Return the table's intervals with indices from `first` to `last` - 1; time starts anew at zero."""
        begin, end = self.joint_breaks[first], self.joint_breaks[last]
        own = slice(int(np.searchsorted(self.breaks, begin)), int(np.searchsorted(self.breaks, end)))
        return Reading(
            breaks=self.breaks[own.start : own.stop + 1] - begin,
            chart_attitude=self.chart_attitude[own],
            chart_rate=self.chart_rate[own],
            coefficients=self.coefficients[own],
            joint_breaks=self.joint_breaks[first : last + 1] - begin,
            joint_coefficients=self.joint_coefficients[first:last],
            off=self.off,
            rate_off=self.rate_off,
            begins=self.begins[first:last],
            ends=self.ends[first:last],
        )


def needs(table: AttitudeTable, interpolation: str) -> str | None:
    """Return a sentence on what a table lacks for an interpolation; None if it lacks nothing."""
    if interpolation in (RATE, HERMITE) and table.angular_velocity is None:
        return f"interpolation = {interpolation!r}: {table.name} has no angular velocities, which that takes"
    return None


def sampled(
    table: AttitudeTable, interpolation: str, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """Interpolate a table at given times, as a reader does.

    Args:
        table: as it was read.
        interpolation: one of `INTERPOLATIONS`, for which the table has what is needed (see `needs`).
        times: (n,) s from the table's epoch, between its first and last row.

    Returns:
        (n, 4) quaternions, body to inertial, scalar first, and (n, J) joints in rad; None for these where the
        table has no joints.
    """
    own = np.clip(np.searchsorted(table.times, times, side="right") - 1, 0, len(table.times) - 2)
    step = np.diff(table.times)[own]
    share = (times - table.times[own]) / step
    attitude = _interpolate_attitudes(table, interpolation, own, share)
    if table.joints is None:
        return attitude, None
    if interpolation == HERMITE and table.joint_rates is not None:
        rates = table.joint_rates
        cubic = _cubic_coefficients(
            table.joints[own], rates[own], table.joints[own + 1], rates[own + 1], step
        )
        x = (2 * share - 1)[:, None]
        powers = np.stack([np.ones_like(x), x, (3 * x * x - 1) / 2, (5 * x**3 - 3 * x) / 2], axis=1)
        return attitude, np.asarray((cubic * powers).sum(axis=1))
    return attitude, table.joints[own] + share[:, None] * (table.joints[own + 1] - table.joints[own])


def reading(table: AttitudeTable, interpolation: str, tolerance: float, rate_tolerance: float) -> Reading:
    """Return the motion that a reader makes of a table, as pieces that can be certified.

    Args:
        table: as it was read.
        interpolation: one of `INTERPOLATIONS`, for which the table has what is needed (see `needs`).
        tolerance: rad, by which pieces may be off the motion.
        rate_tolerance: rad/s, by which their angular velocity may be off.

    Raises:
        ValueError: if that would take `MOST_PARTS` pieces or more.
    """
    times, steps = table.times - table.times[0], np.diff(table.times)
    turn = _rotation_vectors(table.quaternions[:-1], table.quaternions[1:])
    joints = _joint_coefficients(table, interpolation, steps)
    if interpolation in (LINEAR, RODRIGUES):
        return _cut_into_parts(table, interpolation, turn, joints, tolerance, rate_tolerance)
    rate = turn / steps[:, None]
    if interpolation == SLERP:
        begins = ends = rate
        coefficients = _line_coefficients(rate * steps[:, None])
    elif interpolation == RATE:
        assert table.angular_velocity is not None
        rate = begins = ends = table.angular_velocity[:-1]
        coefficients = _line_coefficients(rate * steps[:, None])
    else:
        assert table.angular_velocity is not None
        begins, ends = table.angular_velocity[:-1], table.angular_velocity[1:]
        rate = np.zeros_like(turn)
        coefficients = _cubic_coefficients(rate, begins, turn, _rotation_vector_rates(turn, ends), steps)
    return Reading(
        breaks=times,
        chart_attitude=table.attitudes[:-1],
        chart_rate=rate,
        coefficients=coefficients,
        joint_breaks=times,
        joint_coefficients=joints,
        begins=begins,
        ends=ends,
    )


def _cut_into_parts(
    table: AttitudeTable,
    interpolation: str,
    turn: np.ndarray,
    joints: np.ndarray,
    tolerance: float,
    rate_tolerance: float,
) -> Reading:
    """Return the motion of `LINEAR` or `RODRIGUES` in short parts that turn about one axis; see the module.

    Args:
        table: as it was read.
        interpolation: `LINEAR` or `RODRIGUES`.
        turn: (k - 1, 3) rad, rotation vectors between neighbouring rows.
        joints: (k - 1, p + 1, J) rad, Legendre coefficients of the joints.
        tolerance: as of `reading`.
        rate_tolerance: as of `reading`.

    Raises:
        ValueError: if that would take `MOST_PARTS` pieces or more.
    """
    steps = np.diff(table.times)
    angle = np.linalg.norm(turn, axis=1)
    if interpolation == LINEAR:
        c = np.tan(angle / 4)
        speed, bend = 4 * c / steps, 16 * c**3 / steps**2  # fastest in the middle
        axis = turn / np.where(angle < _SMALLEST_TURN, 1.0, angle)[:, None]
        begins = ends = axis * (4 * c / (steps * (1 + c * c)))[:, None]
    else:
        first, slope = _rodrigues_lines(table.quaternions[:-1], table.quaternions[1:])
        slope = slope / steps[:, None]
        size = np.linalg.norm(slope, axis=1)
        speed, bend = 4 * size, _RODRIGUES_ACCELERATION * size**2
        begins = _rodrigues_angular_velocity(first, slope)
        ends = _rodrigues_angular_velocity(first + slope * steps[:, None], slope)
    wanted = np.max(
        [
            np.ones_like(steps),
            steps * np.sqrt(_SAFETY_FACTOR * bend / (4 * tolerance)),
            steps * _SAFETY_FACTOR * bend / (2 * rate_tolerance),
            steps * speed / _LARGEST_PART_TURN,
        ],
        axis=0,
    )
    if not np.sum(wanted) < MOST_PARTS:
        raise ValueError(
            f"{table.name}: rows are too far apart to be proved with interpolation {interpolation}"
        )
    parts = np.ceil(wanted).astype(int)
    owner = np.repeat(np.arange(len(steps)), parts)
    place = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    share = place / parts[owner]
    starts = table.times[:-1][owner] - table.times[0] + share * steps[owner]
    breaks = np.append(starts, table.duration)
    at = np.concatenate([_interpolate_attitudes(table, interpolation, owner, share), table.quaternions[-1:]])
    width = np.diff(breaks)
    small = _rotation_vectors(at[:-1], at[1:])
    longest = steps / parts
    return Reading(
        breaks=breaks,
        chart_attitude=np.asarray(quaternion.to_matrix(at[:-1])),
        chart_rate=small / width[:, None],
        coefficients=_line_coefficients(small),
        joint_breaks=table.times - table.times[0],
        joint_coefficients=joints,
        off=float(np.max(_SAFETY_FACTOR * bend * longest**2 / 4)),
        rate_off=float(np.max(_SAFETY_FACTOR * bend * longest / 2)),
        begins=begins,
        ends=ends,
    )


def _interpolate_attitudes(
    table: AttitudeTable, interpolation: str, own: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """Interpolate attitudes as a reader does: quaternions (n, 4), body to inertial, scalar first.

    Args:
        table: as it was read.
        interpolation: one of `INTERPOLATIONS`.
        own: (n,) indices of intervals.
        share: (n,) places in these intervals, from 0 to 1.
    """
    begin, end, part = table.quaternions[own], table.quaternions[own + 1], share[:, None]
    if interpolation in _INTERPOLATORS:
        return _INTERPOLATORS[interpolation](begin, end, part)
    assert table.angular_velocity is not None
    step = np.diff(table.times)[own]
    velocity = table.angular_velocity[own]
    vector = part * step[:, None] * velocity
    if interpolation == HERMITE:
        turn = _rotation_vectors(begin, end)
        slopes = _rotation_vector_rates(turn, table.angular_velocity[own + 1])
        a, b = step[:, None] * velocity, step[:, None] * slopes
        vector = part * (a + part * (3 * turn - 2 * a - b + part * (a + b - 2 * turn)))
    return np.asarray(quaternion.product(begin, quaternion.exp(vector)))


def _rotation_vectors(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return rotation vectors (n, 3) rad, body axes, from quaternions (n, 4) to others, the shorter way."""
    return np.asarray(quaternion.log(quaternion.product(quaternion.conjugate(begin), end)))


def turned_between(begin: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate between unit quaternions (..., 4) of like sign, by a turn about one axis at constant rate.

    `share` (..., 1) is the place between them, from 0 to 1.
    """
    half = 2 * np.arcsin(np.clip(np.linalg.norm(end - begin, axis=-1, keepdims=True) / 2, 0, 1))
    still = half < _SMALLEST_TURN
    sine = np.where(still, 1.0, np.sin(half))
    turned = (np.sin((1 - share) * half) * begin + np.sin(share * half) * end) / sine
    return _normalise(np.where(still, begin + share * (end - begin), turned))


def linear_between(begin: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate between unit quaternions (..., 4) of like sign linearly, and scale to unit length.

    `share` (..., 1) is the place between them, from 0 to 1.
    """
    return _normalise(begin + share * (end - begin))


def rodrigues_between(begin: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate between unit quaternions (..., 4), scalar first, by linear modified Rodrigues parameters.

    `share` (..., 1) is the place between them, from 0 to 1.
    """
    first, slope = _rodrigues_lines(begin, end)
    sigma = first + share * slope
    square = np.sum(sigma**2, axis=-1, keepdims=True)
    return np.asarray(np.concatenate([1 - square, 2 * sigma], axis=-1) / (1 + square))


def _rodrigues_lines(begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return modified Rodrigues parameters (..., 3) of quaternions (..., 4), and their difference to others'.

    Both have length at most 1; where they are more than 1 apart, the second is replaced by its shadow set.
    """
    both = (np.where(q[..., :1] < 0, -q, q) for q in (begin, end))
    first, second = (q[..., 1:] / (1 + q[..., :1]) for q in both)
    far = np.linalg.norm(second - first, axis=-1, keepdims=True) > 1
    square = np.sum(second**2, axis=-1, keepdims=True)
    second = np.where(far, -second / np.where(far, square, 1.0), second)
    return first, second - first


def _normalise(quaternions: np.ndarray) -> np.ndarray:
    """Scale quaternions (..., 4) to unit length."""
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True))


def _rodrigues_angular_velocity(sigma: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return angular velocities (n, 3) rad/s, body axes, from modified Rodrigues parameters and their slopes.

    Args:
        sigma: (n, 3) parameters.
        slope: (n, 3) 1/s, their derivatives by time.
    """
    square = np.sum(sigma * sigma, axis=1, keepdims=True)
    along = np.sum(sigma * slope, axis=1, keepdims=True)
    numerator = (1 - square) * slope - 2 * np.cross(sigma, slope) + 2 * along * sigma
    return np.asarray(4 * numerator / (1 + square) ** 2)


def _rotation_vector_rates(turn: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return time derivatives (n, 3) rad/s of rotation vectors at angular velocities in body axes.

    Args:
        turn: (n, 3) rad.
        velocity: (n, 3) rad/s.
    """
    return np.asarray(np.linalg.solve(so3.right_jacobian(turn), velocity[..., None])[..., 0])


def _line_coefficients(turn: np.ndarray) -> np.ndarray:
    """Return Legendre coefficients (n, 2, 3) of lines that rise from zero to `turn` (n, 3) on each piece."""
    return np.stack([turn / 2, turn / 2], axis=1)


def _cubic_coefficients(
    begin: np.ndarray, slope: np.ndarray, end: np.ndarray, end_slope: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """Return Legendre coefficients (n, 4, c) of cubics with given values and time derivatives at both ends.

    Args:
        begin: (n, c) values at the starts.
        slope: (n, c) derivatives there.
        end: (n, c) values at the ends.
        end_slope: (n, c) derivatives there.
        steps: (n,) s, lengths of the pieces.
    """
    half = steps[:, None] / 2
    a, b = half * slope, half * end_slope
    mean, apart = (begin + end) / 2, (end - begin) / 2
    # in x from -1 to 1: m + (a - b) / 4 (1 - x^2) + x (3 d - (a + b) / 2) / 2 + x^3 ((a + b) / 2 - d) / 2
    square, third = (b - a) / 4, ((a + b) / 2 - apart) / 2
    first, constant = (3 * apart - (a + b) / 2) / 2, mean - square
    return np.stack([constant + square / 3, first + 3 * third / 5, 2 * square / 3, 2 * third / 5], axis=1)


def _joint_coefficients(table: AttitudeTable, interpolation: str, steps: np.ndarray) -> np.ndarray:
    """Return Legendre coefficients (k - 1, p + 1, J) rad of joints between k rows, `steps` s apart."""
    if table.joints is None:
        return np.zeros((len(steps), 1, 0))
    begin, end = table.joints[:-1], table.joints[1:]
    if interpolation == HERMITE and table.joint_rates is not None:
        return _cubic_coefficients(begin, table.joint_rates[:-1], end, table.joint_rates[1:], steps)
    return np.stack([(begin + end) / 2, (end - begin) / 2], axis=1)


_INTERPOLATORS = {SLERP: turned_between, LINEAR: linear_between, RODRIGUES: rodrigues_between}
