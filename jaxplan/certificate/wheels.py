"""Torque and momentum of reaction wheels on a trajectory, computed anew for the certificate.

Let ``R`` be the attitude (body to inertial), ``w`` the angular velocity in body axes, and ``L`` the momentum
in body axes of all but the wheels (`inertia`; ``J w`` where no stages move). The total momentum
``H = R_0 (L_0 + h_0)`` is constant in inertial axes, with index 0 for the start. The wheels hold the momentum
``h`` and give the platform the torque ``tau``, both in body axes:

    h = R^T H - L,    tau = L' + w x (R^T H),    h_0 the sum of what each wheel stores at the start.

Limits are on products of ``tau`` and ``h`` with *rows* (r, 3). An array with the allocation by the
pseudo-inverse has a row for each wheel: with the pseudo-inverse ``P`` of the wheels' axes, ``P tau`` and
``stored + P (h - h_0)`` are limited. With the allocation "minimax" only the envelope counts, which is all
that some distribution over the wheels can reach. It has a row for each pair of wheels, the unit vector at
right angles to both axes: along it, no distribution gives more than the sum of what all wheels' limits have
there. For a pair of parallel axes there is no such vector, and the row is zero.

The interpolation error of ``R^T H`` follows from the majorant ``|H| exp(m)`` of the attitude (`bounds`), that
of ``w x (R^T H)`` from the product of this with the majorant of ``w``.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from jaxplan.certificate import inertia, series
from jaxplan.certificate.bounds import Evidence
from jaxplan.certificate.motion import DEGREE
from jaxplan.model.spacecraft import Spacecraft

_PARALLEL_TOLERANCE = 1e-9  # sine of an angle below which axes count as parallel
_ENVELOPE_ALLOCATION = "minimax"  # whose envelope is asked for; the other is the pseudo-inverse
_LIMIT_ATTRIBUTES = {"wheel_torques": "torque", "wheel_momenta": "momentum"}  # of wheels, by quantity


def numbers(craft: Spacecraft) -> np.ndarray:
    """Return the numbers of n wheels as rows (n, 6): axis, limits of torque and momentum, stored momentum."""
    own = [[*wheel.axis, wheel.torque, wheel.momentum, wheel.stored] for wheel in craft.wheels]
    return np.array(own, np.float64).reshape(-1, 6)


def bounds(craft: Spacecraft, name: str) -> np.ndarray:
    """Return the limits (r,) of an array's rows, N m for "wheel_torques" or N m s for "wheel_momenta".

    A row that is zero has the limit 1, which is always kept.
    """
    given = np.array([getattr(wheel, _LIMIT_ATTRIBUTES[name]) for wheel in craft.wheels], np.float64)
    if craft.allocation != _ENVELOPE_ALLOCATION:
        return given
    rows = rows_of(craft)
    reach = np.abs(rows @ _wheel_axes(craft).T) @ given
    return np.where(rows.any(axis=1), reach, 1.0)


def torques(evidence: Evidence, craft: Spacecraft) -> Sequence[np.ndarray]:
    """Return products (r, n, m) N m of the rows with the wheels' torque ``tau``, with error bounds.

    Returns:
        Samples; bounds of the interpolation errors (r, n); sizes of the rounding errors (r, n).
    """
    change, of_change, rounding = inertia.change(evidence, craft)
    total, carried = _total_momentum(evidence, craft)
    values = change + inertia.cross(evidence.samples.spin[0], carried)
    half, speed, turned = evidence.on.half, evidence.majorants.spin, evidence.majorants.attitude
    crossed = series.product("n,n->n", speed, turned[: len(speed)])[DEGREE + 1] / half
    left_out = of_change + 2.0 ** (1 - DEGREE) * total * crossed
    rounding = rounding + total * (evidence.rounding.spin[0] + speed[0] / half * _attitude_rounding(evidence))
    return _project_on_rows(rows_of(craft), values, left_out, rounding)


def momenta(evidence: Evidence, craft: Spacecraft) -> Sequence[np.ndarray]:
    """Return the momenta (r, n, m) N m s that the rows limit, with error bounds as of `torques`."""
    rows, (own, of_own, rounding) = rows_of(craft), inertia.momentum(evidence, craft)
    total, carried = _total_momentum(evidence, craft)
    values = carried - own
    turned = evidence.majorants.attitude[DEGREE + 1]
    left_out = of_own + 2.0 ** (1 - DEGREE) * total * turned
    rounding = rounding + total * _attitude_rounding(evidence)
    found, *errors = _project_on_rows(rows, values, left_out, rounding)
    if craft.allocation != _ENVELOPE_ALLOCATION:
        stored = numbers(craft)[:, 5]
        found = found + (stored - rows @ (_wheel_axes(craft).T @ stored))[:, None, None]
    return found, *errors


def negligible(craft: Spacecraft) -> np.ndarray:
    """Return errors as large as a limit: (4,), of angular velocity, its two derivatives, and the attitude."""
    sizes = np.linalg.norm(rows_of(craft), axis=1)
    sizes[sizes == 0] = np.nan
    torque, momentum = (float(np.nanmin(bounds(craft, name) / sizes)) for name in _LIMIT_ATTRIBUTES)
    heaviest, stored = (
        inertia.fixed(craft)[1],
        float(np.linalg.norm(_wheel_axes(craft).T @ numbers(craft)[:, 5])),
    )
    of_turning = momentum / stored if stored > 0 else np.inf
    by_rate = torque / stored if stored > 0 else np.inf
    return np.array([min(momentum / heaviest, by_rate), torque / heaviest, np.inf, of_turning])


def _project_on_rows(rows: np.ndarray, values: np.ndarray, *errors: np.ndarray) -> Sequence[np.ndarray]:
    """Return products (r, n, m) of rows with vectors (3, n, m), and errors (r, n) from the vectors' (n,)."""
    sizes = np.linalg.norm(rows, axis=1)[:, None]
    return np.einsum("ri,inm->rnm", rows, values), *(sizes * error for error in errors)


def _total_momentum(evidence: Evidence, craft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Return the lengths (n,) N m s of the total momentum ``H``, and ``R^T H`` (3, n, m) in body axes."""
    samples, on = evidence.samples, evidence.on
    first = on.begins[:-1]
    stored = _wheel_axes(craft).T @ numbers(craft)[:, 5]
    own = inertia.at_starts(samples, first, craft) + stored[:, None]
    total = np.sum(samples.attitude[:, :, first, 0] * own, axis=1)[:, on.trajectory]
    return np.linalg.norm(total, axis=0), np.einsum("jinm,jn->inm", samples.attitude, total)


def _attitude_rounding(evidence: Evidence) -> np.ndarray:
    """Return sizes (n,) of rounding errors of unit vectors turned by the attitude at the start and back."""
    own, on = evidence.rounding.attitude, evidence.on
    if own is None:
        raise ValueError("rounding of the attitude is not known")
    return own + own[on.begins[:-1]][on.trajectory]


def _wheel_axes(craft: Spacecraft) -> np.ndarray:
    """Return the axes (n, 3) of the wheels, scaled to unit length, in body axes."""
    axes = numbers(craft)[:, :3]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def rows_of(craft: Spacecraft) -> np.ndarray:
    """Return the rows (r, 3) of an array of wheels, whose products with torque and momentum are limited."""
    axes = _wheel_axes(craft)
    if craft.allocation != _ENVELOPE_ALLOCATION:
        return np.linalg.pinv(axes.T)
    across = np.array([np.cross(one, other) for one, other in combinations(axes, 2)])
    size = np.linalg.norm(across, axis=1, keepdims=True)
    return np.where(size > _PARALLEL_TOLERANCE, across / np.where(size > _PARALLEL_TOLERANCE, size, 1), 0)
