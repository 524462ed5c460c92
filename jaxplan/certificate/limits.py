"""Limits on rates, accelerations, joint angles and torque as bounds on polynomials, proved over all time.

Every limited quantity has components ``f`` that must stay within ``-limit`` and ``+limit``. The margin of a
component is ``1 - |f| / limit``, so that a peak over its limit is one minus the least margin.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jaxplan.certificate import bounds, jets
from jaxplan.certificate.bounds import LEBESGUE, Layout, Minima, Rows
from jaxplan.certificate.errors import Evidence
from jaxplan.certificate.motion import DEGREE
from jaxplan.certificate.pieces import ROUNDING

if TYPE_CHECKING:
    from jaxplan.spacecraft import Spacecraft

_AXES = ("about x", "about y", "about z")
_DEGREE = float(np.rad2deg(1))
_UNITS = {
    "angular_velocity": (_DEGREE, "deg/s"),
    "angular_acceleration": (_DEGREE, "deg/s^2"),
    "joint_rates": (_DEGREE, "deg/s"),
    "joint_accelerations": (_DEGREE, "deg/s^2"),
    "yaw": (_DEGREE, "deg"),
    "pitch": (_DEGREE, "deg"),
    "torque": (1.0, "N m"),
    "wheel_momentum": (1.0, "N m s"),
    "jerk": (_DEGREE, "deg/s^3"),
}


def tolerance(margin: np.ndarray) -> np.ndarray:
    """How close a bound comes to the largest ratio met: a twentieth of the margin, from 1e-10 to 5e-7."""
    return np.clip(np.abs(margin) / 20, 1e-10, 5e-7)


@dataclass(frozen=True, eq=False)
class Quantity:
    """Something with a limit, sampled.

    Attributes:
        name: its key in the report.
        components: (c,) names, such as "about x".
        values: (c, n, m) samples on the intervals.
        left_out: (c, n) or (n,), how far the polynomials through the samples may be off.
        rounding: likewise, size of the samples' rounding errors.
        limit: (c,) positive.
    """

    name: str
    components: tuple[str, ...]
    values: np.ndarray
    left_out: np.ndarray
    rounding: np.ndarray
    limit: np.ndarray


def quantities(spacecraft: "Spacecraft", evidence: Evidence) -> list[Quantity]:
    """All quantities that the spacecraft limits, in the order of the report."""
    spin, joints = evidence.samples.spin, evidence.samples.joints
    left_out, rounding = evidence.left_out, evidence.rounding
    rates = [
        Quantity(name, _AXES, spin[d], left_out.spin[d], rounding.spin[d], np.full(3, limit))
        for d, (name, limit) in enumerate(
            (
                ("angular_velocity", spacecraft.rate_limit),
                ("angular_acceleration", spacecraft.acceleration_limit),
                ("jerk", spacecraft.jerk_limit),
            )
        )
        if limit is not None
    ]
    count = len(spacecraft.terminals)
    terminals, joint_names = spacecraft.device_names[:count], spacecraft.joint_names
    every, yaws, pitches = slice(None), slice(None, count), slice(count, None)
    of_joints = [
        Quantity(
            name,
            tuple(f"of {owner}" for owner in owners),
            joints[d][part],
            left_out.joints[d][part],
            rounding.joints[d][part],
            limit[part],
        )
        for name, owners, d, part, limit in (
            ("joint_rates", joint_names, 1, every, spacecraft.joint_rate_limits),
            ("joint_accelerations", joint_names, 2, every, spacecraft.joint_acceleration_limits),
            ("yaw", terminals, 0, yaws, spacecraft.joint_limits),
            ("pitch", terminals, 0, pitches, spacecraft.joint_limits),
        )
        if count
    ]
    return rates[:2] + of_joints + _of_actuators(spacecraft, evidence) + rates[2:]


def _of_actuators(spacecraft: "Spacecraft", evidence: Evidence) -> list[Quantity]:
    """Torque ``J w' + w x J w`` and momentum ``J w`` in body axes, where they are limited."""
    if spacecraft.inertia is None:
        return []
    (velocity, acceleration), inertia = evidence.samples.spin[:2], np.asarray(spacecraft.inertia, float)
    size = np.linalg.norm(inertia, 2)
    left_out, rounding = size * evidence.left_out.spin, size * evidence.rounding.spin
    momentum = np.einsum("ij,jnm->inm", inertia, velocity)
    found = []
    if spacecraft.torque_limit is not None:
        torque = np.einsum("ij,jnm->inm", inertia, acceleration) + np.cross(velocity, momentum, axis=0)
        speed, half = evidence.majorants.spin, evidence.on.half
        square = jets.product("n,n->n", speed, speed)[DEGREE + 1] / half**2
        left_out_torque = left_out[1] + size * 2.0 ** (1 - DEGREE) * square
        rounding_torque = rounding[1] + 2 * speed[0] / half * rounding[0]
        limit = np.full(3, spacecraft.torque_limit)
        found.append(Quantity("torque", _AXES, torque, left_out_torque, rounding_torque, limit))
    if spacecraft.wheel_momentum_limit is not None:
        limit = np.full(3, spacecraft.wheel_momentum_limit)
        found.append(Quantity("wheel_momentum", _AXES, momentum, left_out[0], rounding[0], limit))
    return found


def prove(limited: list[Quantity], evidence: Evidence) -> Minima:
    """Bounds the least of ``1 - |f| / limit`` over all time.

    Returns:
        For the components of all quantities in turn, trajectory by trajectory.
    """
    on, limit = evidence.on, np.concatenate([q.limit for q in limited])[:, None]
    ratio = np.concatenate([q.values for q in limited]) / limit[..., None]
    largest = np.abs(ratio).max(axis=2)
    error = [np.broadcast_to(q.left_out + LEBESGUE * q.rounding, q.values.shape[:2]) for q in limited]
    conversion = ROUNDING * bounds.growth(DEGREE) * largest
    coefficients = bounds.to_rows(ratio.reshape(-1, DEGREE + 1))
    components, trajectories = len(limit), len(on.begins) - 1
    every = np.ones(trajectories * components, dtype=bool)
    quantity = np.repeat(np.arange(len(limited)), [len(q.components) for q in limited])
    owner = np.arange(trajectories)[:, None]
    layout = Layout(
        opens_entry=every,
        opens_clause=every,
        quantity=(len(limited) * owner + quantity).ravel(),
        owner=np.repeat(owner, components),
    )
    rows = Rows(
        coefficients=np.concatenate([1 - coefficients, 1 + coefficients], axis=1),
        error=np.tile((np.concatenate(error) / limit + conversion).ravel(), 2),
        kind=np.tile((np.arange(components)[:, None] + components * on.trajectory).ravel(), 2),
        low=np.tile(on.low, 2 * components),
        high=np.tile(on.high, 2 * components),
    )
    minima = Minima.of(len(every))
    bounds.minimise(rows, layout, minima, lambda value, _: value, tolerance)
    return minima


def peaks(limited: list[Quantity], minima: Minima) -> dict[str, float]:
    """Upper bounds of the largest ``|f| / limit`` of each quantity."""
    return {q.name: 1 - float(np.min(minima.bound[part])) for q, part in _parts(limited)}


def peak_times(limited: list[Quantity], minima: Minima) -> dict[str, float]:
    """When each quantity is largest, s."""
    return {q.name: float(minima.time[part][np.argmin(minima.seen[part])]) for q, part in _parts(limited)}


def faults(limited: list[Quantity], minima: Minima, allowance: float) -> Iterator[str]:
    """A sentence for each component that is not proved to stay within its limit and the allowance."""
    for quantity, part in _parts(limited):
        scale, unit = _UNITS[quantity.name]
        for component, limit, bound, seen, time in zip(
            quantity.components,
            quantity.limit,
            minima.bound[part],
            minima.seen[part],
            minima.time[part],
            strict=True,
        ):
            if bound >= -allowance:
                continue
            name = f"{quantity.name.replace('_', ' ')} {component}"
            if seen < -allowance:
                reached = f"{scale * limit * (1 - seen):.6g} {unit}, {1 - seen:.8g} of its limit,"
                yield f"{name} reaches {reached} at t = {time:.6g} s"
            else:
                met = f"{1 - seen:.8g} of it was met at t = {time:.6g} s, the bound is {1 - bound:.8g}"
                yield f"{name} is not proved to keep its limit: {met}"


def _parts(limited: list[Quantity]) -> Iterator[tuple[Quantity, slice]]:
    """The quantities with the places of their components among all."""
    begin = 0
    for quantity in limited:
        yield quantity, slice(begin, begin + len(quantity.components))
        begin += len(quantity.components)
