"""What reaction wheels give and hold on a trajectory, computed anew for the certificate.

With the attitude ``R``, the angular velocity ``w`` (body axes) and the momentum ``L`` of all but the wheels,
which is ``J w`` without stages that move (`inertia`), the total ``H = R_0 (L_0 + h_0)`` stays as it is in
inertial axes; the wheels hold ``h`` and give the platform the torque ``tau``:

    h = R^T H - L,    tau = L' + w x (R^T H),    h_0 the sum of what each wheel stores at the start.

Of an array that shares out by the pseudo-inverse ``P`` of its axes, wheel by wheel ``P tau`` and
``stored + P (h - h_0)`` are limited. Of one whose envelope is asked for it is, for each pair of wheels, the
product of ``tau`` and of ``h`` with the unit vector across both axes: no sharing out gives more along it
than the sum of what the limits of all wheels have there. A pair of parallel axes has no such vector, and its
row is zero.

Left out by the polynomials through the samples: of ``R^T H`` what the majorant ``|H| exp(m)`` of the
attitude says (`bounds`), of ``w x (R^T H)`` the product of that with the majorant of ``w``.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from jaxplan.certificate import inertia, series
from jaxplan.certificate.bounds import Evidence
from jaxplan.certificate.motion import DEGREE
from jaxplan.model.spacecraft import Spacecraft

_PARALLEL = 1e-9  # sine of an angle below which axes count as parallel
_ENVELOPE = "minimax"  # the allocation whose envelope is asked for; the other is the pseudo-inverse
_LIMITS = {"wheel_torques": "torque", "wheel_momenta": "momentum"}  # attributes of wheels, by quantity


def numbers(craft: Spacecraft) -> np.ndarray:
    """All numbers of the wheels, (n, 6): axes, limits of torque and momentum, and what is stored."""
    own = [[*wheel.axis, wheel.torque, wheel.momentum, wheel.stored] for wheel in craft.wheels]
    return np.array(own, np.float64).reshape(-1, 6)


def bounds(craft: Spacecraft, name: str) -> np.ndarray:
    """Limits (r,) of the rows of an array of wheels, N m or N m s, by the quantity's name."""
    given = np.array([getattr(wheel, _LIMITS[name]) for wheel in craft.wheels], np.float64)
    if craft.allocation != _ENVELOPE:
        return given
    rows = rows_of(craft)
    reach = np.abs(rows @ _axes(craft).T) @ given
    return np.where(rows.any(axis=1), reach, 1.0)


def torques(evidence: Evidence, craft: Spacecraft) -> Sequence[np.ndarray]:
    """Products (r, n, m) N m of the rows with the wheels' torque, what is left out, and rounding."""
    change, of_change, rounding = inertia.change(evidence, craft)
    total, carried = _total(evidence, craft)
    values = change + np.cross(evidence.samples.spin[0], carried, axis=0)
    half, speed, turned = evidence.on.half, evidence.majorants.spin, evidence.majorants.attitude
    crossed = series.product("n,n->n", speed, turned[: len(speed)])[DEGREE + 1] / half
    left_out = of_change + 2.0 ** (1 - DEGREE) * total * crossed
    rounding = rounding + total * (evidence.rounding.spin[0] + speed[0] / half * _rounding(evidence))
    return _along(rows_of(craft), values, left_out, rounding)


def momenta(evidence: Evidence, craft: Spacecraft) -> Sequence[np.ndarray]:
    """Momenta (r, n, m) N m s that the rows limit, what is left out of them, and their rounding."""
    rows, (own, of_own, rounding) = rows_of(craft), inertia.momentum(evidence, craft)
    total, carried = _total(evidence, craft)
    values = carried - own
    turned = evidence.majorants.attitude[DEGREE + 1]
    left_out = of_own + 2.0 ** (1 - DEGREE) * total * turned
    rounding = rounding + total * _rounding(evidence)
    found, *errors = _along(rows, values, left_out, rounding)
    if craft.allocation != _ENVELOPE:
        stored = numbers(craft)[:, 5]
        found = found + (stored - rows @ (_axes(craft).T @ stored))[:, None, None]
    return found, *errors


def negligible(craft: Spacecraft) -> np.ndarray:
    """(4,) errors as large as a limit: of angular velocity and its two derivatives, and of the attitude."""
    sizes = np.linalg.norm(rows_of(craft), axis=1)
    sizes[sizes == 0] = np.nan
    torque, momentum = (float(np.nanmin(bounds(craft, name) / sizes)) for name in _LIMITS)
    heaviest, stored = inertia.fixed(craft)[1], float(np.linalg.norm(_axes(craft).T @ numbers(craft)[:, 5]))
    of_turning = momentum / stored if stored > 0 else np.inf
    by_rate = torque / stored if stored > 0 else np.inf
    return np.array([min(momentum / heaviest, by_rate), torque / heaviest, np.inf, of_turning])


def _along(rows: np.ndarray, values: np.ndarray, *errors: np.ndarray) -> Sequence[np.ndarray]:
    """Products (r, n, m) of rows with vectors (3, n, m), and errors (r, n) that errors (n,) make there."""
    sizes = np.linalg.norm(rows, axis=1)[:, None]
    return np.einsum("ri,inm->rnm", rows, values), *(sizes * error for error in errors)


def _total(evidence: Evidence, craft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Sizes (n,) N m s of the total momenta, and the momenta in body axes (3, n, m)."""
    samples, on = evidence.samples, evidence.on
    first = on.begins[:-1]
    stored = _axes(craft).T @ numbers(craft)[:, 5]
    own = inertia.at_starts(samples, first, craft) + stored[:, None]
    total = np.sum(samples.attitude[:, :, first, 0] * own, axis=1)[:, on.trajectory]
    return np.linalg.norm(total, axis=0), np.einsum("jinm,jn->inm", samples.attitude, total)


def _rounding(evidence: Evidence) -> np.ndarray:
    """Size (n,) of the rounding errors of unit vectors that the attitude turns there and back."""
    own, on = evidence.rounding.attitude, evidence.on
    if own is None:
        raise ValueError("rounding of the attitude is not known")
    return own + own[on.begins[:-1]][on.trajectory]


def _axes(craft: Spacecraft) -> np.ndarray:
    """Axes (n, 3) of the wheels, unit vectors."""
    axes = numbers(craft)[:, :3]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def rows_of(craft: Spacecraft) -> np.ndarray:
    """Rows (r, 3) of the array of wheels."""
    axes = _axes(craft)
    if craft.allocation != _ENVELOPE:
        return np.linalg.pinv(axes.T)
    across = np.array([np.cross(one, other) for one, other in combinations(axes, 2)])
    size = np.linalg.norm(across, axis=1, keepdims=True)
    return np.where(size > _PARALLEL, across / np.where(size > _PARALLEL, size, 1), 0)
