"""The polynomials of a motion as plain numbers, for code and for JSON: charts, pieces, and joints.

What is written is the motion that is certified itself, and no samples of it. A *piece* is an interval with
one polynomial, a *chart* the reference motion that it is relative to. On a piece of the platform from ``t_k``
to ``t_{k+1}``, with ``x = 2 (t - t_k) / (t_{k+1} - t_k) - 1`` in [-1, 1], ``b`` is the polynomial
``sum_i c_i x^i``, and the attitude is (equation 25, corrected; see `trajectory.curve`)

    q(t) = q_a u e u,   u = exp((t - t_a) Omega / 2),   e = exp(b(t) - (t - t_a) Omega),

with unit quaternions, scalar first, body to inertial, where ``exp`` is that of a rotation vector. The powers
of x are equal to the Legendre polynomials that a trajectory has, except for the last digit or two.
"""

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.exporting.flight import Flight
from jaxplan.exporting.sampled import Sampling
from jaxplan.geometry import quaternion, rotations
from jaxplan.trajectory import Trajectory

SCHEMA, VERSION = "jaxplan-pieces", 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """A motion's polynomials in powers of x: N pieces of the platform in C charts, M pieces of J joints.

    Attributes:
        breaks: (N + 1,) s, ends of the platform's pieces.
        chart: (N,) int, index of the chart of each piece.
        coefficients: (N, p + 1, 3) rad, those of ``b`` by rising powers.
        quaternions: (C, 4) ``q_a`` of each chart, scalar first, with signs such that ``q(t)`` does not jump.
        starts: (C,) s, ``t_a`` of each chart.
        rates: (C, 3) rad/s, ``Omega`` of each chart.
        joint_breaks: (M + 1,) s, ends of the joints' pieces.
        joint_coefficients: (M, r + 1, J) rad, those of the joints by rising powers.
    """

    breaks: np.ndarray
    chart: np.ndarray
    coefficients: np.ndarray
    quaternions: np.ndarray
    starts: np.ndarray
    rates: np.ndarray
    joint_breaks: np.ndarray
    joint_coefficients: np.ndarray

    @property
    def numbers(self) -> int:
        """How many floating-point numbers these are; breaks that platform and joints share count once."""
        arrays = [self.coefficients, self.quaternions, self.starts, self.rates, self.breaks]
        joints = [self.joint_coefficients]
        if not self.shares_breaks:
            joints.append(self.joint_breaks)
        return sum(array.size for array in (arrays + joints if self.joint_count else arrays))

    @property
    def joint_count(self) -> int:
        """Number of joints."""
        return int(self.joint_coefficients.shape[2])

    @property
    def shares_breaks(self) -> bool:
        """Whether the joints' pieces have the same breaks as those of the platform."""
        return np.array_equal(self.breaks, self.joint_breaks)


def pieces_of(trajectory: Trajectory) -> Pieces:
    """Return the polynomials of a trajectory in powers of x, with each chart once."""
    own = (trajectory.chart_attitude, trajectory.chart_start, trajectory.chart_rate)
    rows = np.column_stack([np.asarray(part).reshape(len(trajectory.chart_start), -1) for part in own])
    begins = np.concatenate([[True], np.any(rows[1:] != rows[:-1], axis=1)])
    first = np.flatnonzero(begins)
    made = Pieces(
        breaks=np.asarray(trajectory.breaks),
        chart=np.cumsum(begins) - 1,
        coefficients=_legendre_to_powers(trajectory.coefficients),
        quaternions=np.asarray(quaternion.continuous(trajectory.chart_attitude[first])),
        starts=np.asarray(trajectory.chart_start)[first],
        rates=np.asarray(trajectory.chart_rate)[first],
        joint_breaks=np.asarray(trajectory.joint_breaks),
        joint_coefficients=_legendre_to_powers(trajectory.joint_coefficients),
    )
    signs = [1.0]
    for before, after in pairwise(range(len(first))):
        left, right = (
            _attitude_at(made, piece, made.breaks[first[after]]) for piece in (first[after] - 1, first[after])
        )
        signs.append(signs[before] * (1.0 if left @ right >= 0 else -1.0))
    made.quaternions[:] *= np.array(signs)[:, None]
    return made


def write_pieces(sampling: Sampling, path: Path) -> None:
    """Write the polynomials as JSON in UTF-8; docs/flight.md describes its keys.

    Args:
        sampling: the motion's sampling; its instants are not used.
        path: the file.
    """
    flight = sampling.flight
    held = described(flight, sampling.names.object_name or flight.name, sampling.start)
    path.write_text(json.dumps(held, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def described(flight: Flight, name: str, start: np.datetime64 | None = None) -> dict[str, Any]:
    """Describe the polynomials and the segments of a flight as a dict for JSON.

    Args:
        flight: the motion.
        name: under which it is written.
        start: UTC of time zero; None where it is not known.
    """
    own = pieces_of(flight.trajectory)
    return {
        "schema": SCHEMA,
        "schema_version": VERSION,
        "name": name,
        "epoch_utc": None if start is None else str(start),
        "duration_s": float(flight.trajectory.duration),
        "charts": [
            {"quaternion": q.tolist(), "start_s": float(start), "rate_rad_s": rate.tolist()}
            for q, start, rate in zip(own.quaternions, own.starts, own.rates, strict=True)
        ],
        "platform": {
            "breaks_s": own.breaks.tolist(),
            "chart": own.chart.tolist(),
            "powers_rad": own.coefficients.tolist(),
        },
        "joints": {
            "names": list(flight.spacecraft.joint_names),
            "breaks_s": own.joint_breaks.tolist(),
            "powers_rad": own.joint_coefficients.tolist(),
        },
        "segments": [
            {"name": each.name, "kind": each.kind, "start_s": each.start, "end_s": each.end}
            for each in flight.segments
        ],
    }


def _attitude_at(pieces: Pieces, piece: int, time: float) -> np.ndarray:
    """Return the quaternion (4,), scalar first, body to inertial, on a piece by index at a time, s."""
    begin, end = pieces.breaks[piece : piece + 2]
    x = 2 * (time - begin) / (end - begin) - 1 if end > begin else -1.0
    chart = pieces.chart[piece]
    turned = (time - pieces.starts[chart]) * pieces.rates[chart]
    b = x ** np.arange(pieces.coefficients.shape[1]) @ pieces.coefficients[piece]
    half, own = (rotations.exp(tuple(vector)) for vector in (turned / 2, b - turned))
    first = rotations.product(tuple(pieces.quaternions[chart]), half)
    return np.array(rotations.product(rotations.product(first, own), half))


def _legendre_to_powers(coefficients: np.ndarray) -> np.ndarray:
    """Convert coefficients (n, p + 1, d) of Legendre polynomials to those of powers of x."""
    order = coefficients.shape[1] - 1
    table = np.zeros((order + 1, order + 1), np.longdouble)  # row k: the powers of the polynomial of degree k
    table[0, 0] = 1
    for k in range(order):  # (k + 1) P_{k+1} = (2 k + 1) x P_k - k P_{k-1}
        table[k + 1, 1:] = (2 * k + 1) * table[k, :-1] / (k + 1)
        table[k + 1] -= k * table[k - 1] / (k + 1)
    return np.einsum("kp,nkd->npd", table, np.asarray(coefficients, np.longdouble)).astype(np.float64)
