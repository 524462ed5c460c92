r"""What readers make of a table between its rows, as pieces that can be certified.

From row ``k`` to the next, ``h`` seconds later, with body attitudes ``R_k`` and the turn ``theta n`` between
them (``R_k^T R_{k+1} = exp(theta n^)``):

- `SLERP`: a turn about one axis at constant rate, ``R_k exp(theta n^ t / h)``. So do SPICE's C-kernels of
  type 3, STK at interpolation order 1, and most libraries.
- `LINEAR`: components of the quaternion are linear, and it is brought to unit length. The axis is the same,
  the rate is not: with ``c = tan(theta / 4)`` the angle from the middle is ``2 atan(c x)``, x from -1 to 1.
- `RODRIGUES`: modified Rodrigues parameters are linear, as Basilisk's ``waypointReference`` has it. Those of
  both ends are of length at most one, and of the second the shadow is taken where they are more than one
  apart.
- `RATE`: the angular velocity of row ``k`` stays, ``R_k exp(t omega_k^)``, as in C-kernels of type 2;
  attitudes jump where that misses the next row.
- `HERMITE`: the rotation vector from ``R_k`` is the cubic of both rows' attitudes and angular velocities.

Joints are linear from row to row, and cubic with `HERMITE` where the table has their rates.

The first, fourth and fifth are pieces of `jaxplan.certificate` as they stand. The other two are cut so
finely that a turn about one axis is close: on a part of ``h`` seconds with ``|omega| <= w`` and
``|omega'| <= a`` the angular velocity differs from that of the turn, ``c``, by at most
``a h / 2 (1 + h w / 6)``, since by Magnus' expansion the mean of ``omega`` does from ``c`` by at most
``w a h^2 / 12``; and the angle between two attitudes changes by at most the difference of their angular
velocities, so that it is at most half of ``h`` times that.
Of `LINEAR` ``a = 16 c^3 / h^2``. Of `RODRIGUES`, whose parameters ``s`` are linear::

    omega' = 8 |s'|^2 s / (1 + s^2)^2 - 16 (s . s') N / (1 + s^2)^3,   |N| = (1 + s^2) |s'|,

so that ``a = 24 |s'|^2 max x / (1 + x^2)^2 < 7.8 |s'|^2``, and ``w = 4 |s'|``.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan import so3
from jaxplan.geometry import quaternion
from jaxplan.tables.table import HERMITE, LINEAR, RATE, RODRIGUES, SLERP, AttitudeTable

_CURVED = 24 * 9 / (16 * np.sqrt(3))  # 24 times the largest of x / (1 + x^2)^2, which is at x = 1 / sqrt(3)
_SHORT = 0.1  # rad: the turn of a part, for which the terms of Magnus' expansion left out are below 1 %
_MORE = 1.05  # what bounds are multiplied by for those terms and for h w / 6
_STILL = 1e-9  # rad: turns below which an axis is no axis
MOST_PARTS = 2_000_000
"""Most pieces that a table is cut into."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """The motion that a reader makes of a table, as `jaxplan.certificate` reads trajectories.

    Attributes:
        breaks: (n + 1,) s from the first row on.
        chart_attitude: (n, 3, 3) body to inertial, at the start of each piece.
        chart_rate: (n, 3) rad/s, body axes.
        coefficients: (n, p + 1, 3) rad, Legendre coefficients.
        joint_breaks: (m + 1,) s.
        joint_coefficients: (m, p + 1, J) rad.
        smoothness: claimed of the whole: none.
        off: rad, by which the motion may differ from these pieces.
        rate_off: rad/s, by which its angular velocity may.
        begins: (k - 1, 3) rad/s in body axes, angular velocity at the start of each interval of the table.
        ends: (k - 1, 3) likewise at its end.
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
        """(n,) s."""
        return self.breaks[:-1]

    def part(self, first: int, last: int) -> "Reading":
        """The intervals of the table from number `first` to before `last`, with time from the first on."""
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
    """Say what a table lacks for an interpolation; None if it has all that it needs."""
    if interpolation in (RATE, HERMITE) and table.angular_velocity is None:
        return f"interpolation = {interpolation!r}: {table.name} has no angular velocities, which that takes"
    return None


def sampled(
    table: AttitudeTable, interpolation: str, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """Attitudes and joints that a reader of a table finds at some instants.

    Args:
        table: as it was read.
        interpolation: one of `INTERPOLATIONS`, for which the table has what is needed.
        times: (n,) s from the epoch, within the table.

    Returns:
        (n, 4) quaternions, body to inertial, scalar first, and (n, J) joints in rad, None without.
    """
    own = np.clip(np.searchsorted(table.times, times, side="right") - 1, 0, len(table.times) - 2)
    step = np.diff(table.times)[own]
    share = (times - table.times[own]) / step
    attitude = _attitude(table, interpolation, own, share)
    if table.joints is None:
        return attitude, None
    if interpolation == HERMITE and table.joint_rates is not None:
        rates = table.joint_rates
        cubic = _cubic(table.joints[own], rates[own], table.joints[own + 1], rates[own + 1], step)
        x = (2 * share - 1)[:, None]
        powers = np.stack([np.ones_like(x), x, (3 * x * x - 1) / 2, (5 * x**3 - 3 * x) / 2], axis=1)
        return attitude, np.asarray((cubic * powers).sum(axis=1))
    return attitude, table.joints[own] + share[:, None] * (table.joints[own + 1] - table.joints[own])


def reading(table: AttitudeTable, interpolation: str, tolerance: float, rate_tolerance: float) -> Reading:
    """The motion that a reader makes of a table.

    Args:
        table: as it was read.
        interpolation: one of `INTERPOLATIONS`, for which the table has what is needed.
        tolerance: rad, by which pieces may be off the motion.
        rate_tolerance: rad/s, by which their angular velocity may.

    Raises:
        ValueError: if that would take too many pieces.
    """
    times, steps = table.times - table.times[0], np.diff(table.times)
    turn = _turns(table.quaternions[:-1], table.quaternions[1:])
    joints = _joint_pieces(table, interpolation, steps)
    if interpolation in (LINEAR, RODRIGUES):
        return _cut(table, interpolation, turn, joints, tolerance, rate_tolerance)
    rate = turn / steps[:, None]
    if interpolation == SLERP:
        begins = ends = rate
        coefficients = _linear(rate * steps[:, None])
    elif interpolation == RATE:
        assert table.angular_velocity is not None
        rate = begins = ends = table.angular_velocity[:-1]
        coefficients = _linear(rate * steps[:, None])
    else:
        assert table.angular_velocity is not None
        begins, ends = table.angular_velocity[:-1], table.angular_velocity[1:]
        rate = np.zeros_like(turn)
        coefficients = _cubic(rate, begins, turn, _slopes(turn, ends), steps)
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


def _cut(
    table: AttitudeTable,
    interpolation: str,
    turn: np.ndarray,
    joints: np.ndarray,
    tolerance: float,
    rate_tolerance: float,
) -> Reading:
    """The motion of `LINEAR` or `RODRIGUES` in parts that turn about one axis, see the module."""
    steps = np.diff(table.times)
    angle = np.linalg.norm(turn, axis=1)
    if interpolation == LINEAR:
        c = np.tan(angle / 4)
        speed, bend = 4 * c / steps, 16 * c**3 / steps**2  # fastest in the middle
        axis = turn / np.where(angle < _STILL, 1.0, angle)[:, None]
        begins = ends = axis * (4 * c / (steps * (1 + c * c)))[:, None]
    else:
        first, slope = _rodrigues_lines(table.quaternions[:-1], table.quaternions[1:])
        slope = slope / steps[:, None]
        size = np.linalg.norm(slope, axis=1)
        speed, bend = 4 * size, _CURVED * size**2
        begins = _spin_of(first, slope)
        ends = _spin_of(first + slope * steps[:, None], slope)
    wanted = np.max(
        [
            np.ones_like(steps),
            steps * np.sqrt(_MORE * bend / (4 * tolerance)),
            steps * _MORE * bend / (2 * rate_tolerance),
            steps * speed / _SHORT,
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
    at = np.concatenate([_attitude(table, interpolation, owner, share), table.quaternions[-1:]])
    width = np.diff(breaks)
    small = _turns(at[:-1], at[1:])
    longest = steps / parts
    return Reading(
        breaks=breaks,
        chart_attitude=np.asarray(quaternion.to_matrix(at[:-1])),
        chart_rate=small / width[:, None],
        coefficients=_linear(small),
        joint_breaks=table.times - table.times[0],
        joint_coefficients=joints,
        off=float(np.max(_MORE * bend * longest**2 / 4)),
        rate_off=float(np.max(_MORE * bend * longest / 2)),
        begins=begins,
        ends=ends,
    )


def _attitude(table: AttitudeTable, interpolation: str, own: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) at shares (n,) of the intervals of numbers `own` (n,), as a reader has them."""
    begin, end, part = table.quaternions[own], table.quaternions[own + 1], share[:, None]
    if interpolation in _BETWEEN:
        return _BETWEEN[interpolation](begin, end, part)
    assert table.angular_velocity is not None
    step = np.diff(table.times)[own]
    velocity = table.angular_velocity[own]
    vector = part * step[:, None] * velocity
    if interpolation == HERMITE:
        turn = _turns(begin, end)
        slopes = _slopes(turn, table.angular_velocity[own + 1])
        a, b = step[:, None] * velocity, step[:, None] * slopes
        vector = part * (a + part * (3 * turn - 2 * a - b + part * (a + b - 2 * turn)))
    return np.asarray(quaternion.product(begin, quaternion.exp(vector)))


def _turns(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) rad, body axes, from quaternions (n, 4) to others, the shorter way."""
    return np.asarray(quaternion.log(quaternion.product(quaternion.conjugate(begin), end)))


def turned_between(begin: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) between two of the same sign, by the turn about one axis at constant rate."""
    half = 2 * np.arcsin(np.clip(np.linalg.norm(end - begin, axis=-1, keepdims=True) / 2, 0, 1))
    still = half < _STILL
    sine = np.where(still, 1.0, np.sin(half))
    turned = (np.sin((1 - share) * half) * begin + np.sin(share * half) * end) / sine
    return _unit(np.where(still, begin + share * (end - begin), turned))


def linear_between(begin: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) between two of the same sign, by components that are linear."""
    return _unit(begin + share * (end - begin))


def rodrigues_between(begin: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) between two whose modified Rodrigues parameters are taken for linear."""
    first, slope = _rodrigues_lines(begin, end)
    sigma = first + share * slope
    square = np.sum(sigma**2, axis=-1, keepdims=True)
    return np.asarray(np.concatenate([1 - square, 2 * sigma], axis=-1) / (1 + square))


def _rodrigues_lines(begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modified Rodrigues parameters (..., 3) of quaternions (..., 4), and the way to those of others.

    Each is given by its parameters of length at most 1, and the second by the others where the two are more
    than 1 apart.
    """
    both = (np.where(q[..., :1] < 0, -q, q) for q in (begin, end))
    first, second = (q[..., 1:] / (1 + q[..., :1]) for q in both)
    far = np.linalg.norm(second - first, axis=-1, keepdims=True) > 1
    square = np.sum(second**2, axis=-1, keepdims=True)
    second = np.where(far, -second / np.where(far, square, 1.0), second)
    return first, second - first


def _unit(quaternions: np.ndarray) -> np.ndarray:
    """The quaternions (..., 4) at unit length."""
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True))


def _spin_of(sigma: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Angular velocities (n, 3) in body axes, of modified Rodrigues parameters and their slopes, 1/s."""
    square = np.sum(sigma * sigma, axis=1, keepdims=True)
    along = np.sum(sigma * slope, axis=1, keepdims=True)
    numerator = (1 - square) * slope - 2 * np.cross(sigma, slope) + 2 * along * sigma
    return np.asarray(4 * numerator / (1 + square) ** 2)


def _slopes(turn: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Derivatives (n, 3) of rotation vectors `turn` (n, 3) at angular velocities (n, 3) in body axes."""
    return np.asarray(np.linalg.solve(so3.right_jacobian(turn), velocity[..., None])[..., 0])


def _linear(turn: np.ndarray) -> np.ndarray:
    """Legendre coefficients (n, 2, 3) of what rises from zero by `turn` (n, 3) on each piece."""
    return np.stack([turn / 2, turn / 2], axis=1)


def _cubic(
    begin: np.ndarray, slope: np.ndarray, end: np.ndarray, end_slope: np.ndarray, steps: np.ndarray
) -> np.ndarray:
    """Legendre coefficients (n, 4, c) of cubics by both ends and the slopes (n, c) by time there."""
    half = steps[:, None] / 2
    a, b = half * slope, half * end_slope
    mean, apart = (begin + end) / 2, (end - begin) / 2
    # in x from -1 to 1: m + (a - b) / 4 (1 - x^2) + x (3 d - (a + b) / 2) / 2 + x^3 ((a + b) / 2 - d) / 2
    square, third = (b - a) / 4, ((a + b) / 2 - apart) / 2
    first, constant = (3 * apart - (a + b) / 2) / 2, mean - square
    return np.stack([constant + square / 3, first + 3 * third / 5, 2 * square / 3, 2 * third / 5], axis=1)


def _joint_pieces(table: AttitudeTable, interpolation: str, steps: np.ndarray) -> np.ndarray:
    """Legendre coefficients (k - 1, p + 1, J) rad of the joints."""
    if table.joints is None:
        return np.zeros((len(steps), 1, 0))
    begin, end = table.joints[:-1], table.joints[1:]
    if interpolation == HERMITE and table.joint_rates is not None:
        return _cubic(begin, table.joint_rates[:-1], end, table.joint_rates[1:], steps)
    return np.stack([(begin + end) / 2, (end - begin) / 2], axis=1)


_BETWEEN = {SLERP: turned_between, LINEAR: linear_between, RODRIGUES: rodrigues_between}
