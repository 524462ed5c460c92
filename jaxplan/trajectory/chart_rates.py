"""Rates of the platform in charts of SO(3) at very many points, by cross products in numpy.

What `pieces.chart_motion` says of a chart (equations 25 to 29), without attitudes and not for derivatives.
With ``E = exp(eta^)``, and ``U = exp(tau Omega^ / 2)``, which leaves ``Omega`` as it is,

    omega  = U^T v,                     v  = (Omega + E^T Omega) / 2 + w,   w = D(eta) eta',
    omega' = U^T (v' - Omega x v / 2),  v' = w' - w x (E^T Omega) / 2.

All is analytic in time, so a step of it along the imaginary axis tells the next derivative to the last digit.
Every column is computed as if it were alone, to the last bit.
"""

import numpy as np

from jaxplan.geometry import vectors
from jaxplan.geometry.vectors import dot

_SMALL = 0.05  # rad^2, below which series are used
_ZERO = 1e-300  # rad^2
_STEP = 1e-30  # s, along the imaginary axis


def rates(chart_rate: np.ndarray, tau: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    """Angular velocity, angular acceleration and perhaps angular jerk.

    Args:
        chart_rate: (3, n) rad/s, ``Omega``.
        tau: (n,) s since the chart's start.
        b: (k + 1, 3, n) rad, the curve and its first derivatives by time: two, or three for the jerk.

    Returns:
        k arrays (3, n), in rad/s, rad/s^2 and rad/s^3, body axes.
    """
    if len(b) == 3:
        return list(_velocity_and_acceleration(chart_rate, tau, *b))
    ahead = b[:-1] + 1j * _STEP * b[1:]
    velocity, acceleration = _velocity_and_acceleration(chart_rate, tau + 1j * _STEP, *ahead)
    return [velocity.real, acceleration.real, acceleration.imag / _STEP]


def _velocity_and_acceleration(
    chart_rate: np.ndarray, tau: np.ndarray, b: np.ndarray, b_rate: np.ndarray, b_acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    eta, eta_rate = b - tau * chart_rate, b_rate - chart_rate
    square = dot(eta, eta)
    sine, cosine = _sine_and_cosine(square)
    cubic, cosine_slope, cubic_slope = _further(square, sine, cosine)

    def tangent(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``D x``, with ``eta x x`` and ``eta x (eta x x)``."""
        once = cross(eta, vector)
        twice = cross(eta, once)
        return vector - cosine * once + cubic * twice, once, twice

    once = cross(eta, chart_rate)
    turned = chart_rate - sine * once + cosine * cross(eta, once)  # E^T Omega
    own, once, twice = tangent(eta_rate)  # w
    bend = tangent(b_acceleration)[0] + cubic * cross(eta_rate, once)
    square_rate = 2 * dot(eta, eta_rate)
    bend += (cubic_slope * square_rate) * twice - (cosine_slope * square_rate) * once  # w'
    velocity = (chart_rate + turned) / 2 + own
    acceleration = bend - cross(own, turned) / 2 - cross(chart_rate, velocity) / 2
    turn = tau * chart_rate / 2
    of_turn = _sine_and_cosine(dot(turn, turn))
    return _turned_back(turn, *of_turn, velocity), _turned_back(turn, *of_turn, acceleration)


def _turned_back(turn: np.ndarray, sine: np.ndarray, cosine: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """``exp(turn^)^T x``."""
    once = cross(turn, vector)
    return np.asarray(vector - sine * once + cosine * cross(turn, once))


def _sine_and_cosine(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``sin t / t`` and ``(1 - cos t) / t^2`` of ``t^2``."""
    angle = np.sqrt(np.where(square.real < _ZERO, _ZERO, square))
    half = np.sin(angle / 2) / angle
    return np.sin(angle) / angle, 2 * half * half


def _further(
    square: np.ndarray, sine: np.ndarray, cosine: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``(t - sin t) / t^3`` of ``t^2``, and the slopes of ``(1 - cos t) / t^2`` and of that by ``t^2``."""
    small = square.real < _SMALL
    z, safe = np.where(small, square, 0), np.where(small, 1, square)
    cubic = np.where(
        small, 1 / 6 - z * (1 / 120 - z * (1 / 5040 - z * (1 / 362880 - z / 39916800))), (1 - sine) / safe
    )
    of_cosine = z * (2 / 720 - z * (3 / 40320 - z * (4 / 3628800 - z * 5 / 479001600))) - 1 / 24
    of_cubic = z * (2 / 5040 - z * (3 / 362880 - z * (4 / 39916800 - z * 5 / 6227020800))) - 1 / 120
    return (
        cubic,
        np.where(small, of_cosine, (sine - 2 * cosine) / (2 * safe)),
        np.where(small, of_cubic, (cosine - 3 * cubic) / (2 * safe)),
    )


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Of vectors (3, n)."""
    return np.array(vectors.cross(first, second))  # quicker than a stack
