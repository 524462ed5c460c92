"""The limits of a spacecraft: what is limited, by which name and unit, and how it scales with time.

This is the one list of them. Fit, time scaling, peaks, certificate, figures and report go through `limits` of
a spacecraft; a further limit is a further row of `QUANTITIES`.

Vectors of the platform are in body axes. A motion that takes ``s`` times as long passes the same attitudes
and joint angles, and each quantity falls by a power of ``s``. So the shortest time in which a motion keeps a
limit follows from the largest share of it that is taken, exactly (`jaxplan.model.scaling`).

What wheels give and hold has a *lesser* part, which falls by one power less: the torque that turns the total
momentum with the body falls like the rates, and what a slow motion leaves them to hold does not fall at all
(`jaxplan.model.wheels`). There a root stands in place of the power, and where the lesser part alone is beyond
its limit slowing down does not help.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, norm
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.scaling import time_factor
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import row_names
from jaxplan.runtime.once import made_once

_AXES = ("x", "y", "z")
_LENGTH = ("length",)
_RAISED = str.maketrans("23", "\N{SUPERSCRIPT TWO}\N{SUPERSCRIPT THREE}", "^")


def _length(vector: AnyArray) -> AnyArray:
    """The Euclidean length (1, ...) of vectors (3, ...)."""
    return norm(vector)[None]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Something that a spacecraft may limit.

    Attributes:
        name: in reports, such as "angular_velocity".
        word: where it is said of which joint or body axis it is, such as "rate".
        label: at the head of a row of a table.
        caption: beside a panel of a figure, where it is of the platform.
        unit: for people: with angles in degrees, and "^" before exponents.
        power: how it scales: in ``s`` times the time it is ``s ** power`` times smaller. That is the number
            of derivatives by time that it is made of; zero of what does not depend on the duration.
        of_joints: whether its components are those of joints; else they are along the platform's three axes,
            or of wheels.
        of_wheels: whether they are those of the rows of an array of wheels.
        of_length: whether it is the length of such a vector, its only component. Where that is zero it has no
            derivative, its square is smooth everywhere.
        by_inertia: whether it depends on the inertia, without which it cannot be limited.
        values: its components (c, ...) in SI units, of a motion.
        lesser: the part of them that falls by one power less; None where there is none.
        given: its limit in SI units, of a spacecraft: a number, or one a component; None for no limit. Of
            what has a range it is half of that.
        centre: the middle of its range, one a component, of a spacecraft; None for zero.
    """

    name: str
    word: str
    label: str
    caption: str = ""
    unit: str
    power: int
    of_joints: bool = False
    of_wheels: bool = False
    of_length: bool = False
    by_inertia: bool = False
    values: Callable[[Kinematics], AnyArray]
    lesser: Callable[[Kinematics], AnyArray] | None = None
    given: Callable[[Spacecraft], Any]
    centre: Callable[[Spacecraft], Any] | None = None

    def __reduce__(self) -> tuple[Callable[[str], "Quantity"], tuple[str]]:
        """Pickle the name alone, since every process has the same list."""
        return _named, (self.name,)

    @property
    def angular(self) -> bool:
        """Whether it is measured in radians, and in degrees for people."""
        return self.unit.startswith("deg")

    @property
    def printed_unit(self) -> str:
        """The unit with raised exponents."""
        return self.unit.translate(_RAISED)

    def in_unit(self, values: ArrayLike) -> np.ndarray:
        """Values in `unit`, from values in SI units."""
        return np.rad2deg(values) if self.angular else np.asarray(values, float)


def _ranges(craft: Spacecraft, which: int) -> AnyArray:
    """Ranges (c, 2) rad of the terminals' yaws (`which` = 0) or pitches (1), or of the drives (2)."""
    terminals = len(craft.terminals)
    return craft.joint_ranges[which * terminals : (which + 1) * terminals if which < 2 else None]


def _angle(name: str, word: str, label: str, which: int) -> "Quantity":
    """The quantity of a kind of joint angle, `which` as of `_ranges`, the others as of `Quantity`."""
    return Quantity(
        name=name,
        word=word,
        label=label,
        unit="deg",
        power=0,
        of_joints=True,
        values=lambda motion: motion.angles(which),
        given=lambda craft: (_ranges(craft, which)[:, 1] - _ranges(craft, which)[:, 0]) / 2,
        centre=lambda craft: (_ranges(craft, which)[:, 1] + _ranges(craft, which)[:, 0]) / 2,
    )


QUANTITIES = (
    Quantity(
        name="angular_velocity",
        word="rate",
        label="Angular velocity",
        caption="platform angular\nvelocity",
        unit="deg/s",
        power=1,
        values=lambda motion: motion.spin[0],
        given=lambda craft: craft.rate_limit,
    ),
    Quantity(
        name="angular_velocity_norm",
        word="rate",
        label="Length of angular velocity",
        unit="deg/s",
        power=1,
        of_length=True,
        values=lambda motion: _length(motion.spin[0]),
        given=lambda craft: craft.rate_norm_limit,
    ),
    Quantity(
        name="angular_acceleration",
        word="acceleration",
        label="Angular acceleration",
        caption="platform angular\nacceleration",
        unit="deg/s^2",
        power=2,
        values=lambda motion: motion.spin[1],
        given=lambda craft: craft.acceleration_limit,
    ),
    Quantity(
        name="angular_acceleration_norm",
        word="acceleration",
        label="Length of angular acceleration",
        unit="deg/s^2",
        power=2,
        of_length=True,
        values=lambda motion: _length(motion.spin[1]),
        given=lambda craft: craft.acceleration_norm_limit,
    ),
    Quantity(
        name="joint_rates",
        word="rate",
        label="Joint rates",
        unit="deg/s",
        power=1,
        of_joints=True,
        values=lambda motion: motion.joints[1],
        given=lambda craft: craft.joint_rate_limits,
    ),
    Quantity(
        name="joint_accelerations",
        word="acceleration",
        label="Joint accelerations",
        unit="deg/s^2",
        power=2,
        of_joints=True,
        values=lambda motion: motion.joints[2],
        given=lambda craft: craft.joint_acceleration_limits,
    ),
    _angle("yaw", "yaw", "Yaw angles", 0),
    _angle("pitch", "pitch", "Pitch angles", 1),
    _angle("drive", "angle", "Drive angles", 2),
    Quantity(
        name="torque",
        word="torque",
        label="Torque",
        caption="torque",
        unit="N m",
        power=2,
        by_inertia=True,
        values=lambda motion: motion.torque,
        given=lambda craft: craft.torque_limit,
    ),
    Quantity(
        name="wheel_momentum",
        word="momentum",
        label="Wheel momentum",
        caption="angular\nmomentum",
        unit="N m s",
        power=1,
        by_inertia=True,
        values=lambda motion: motion.momentum,
        given=lambda craft: craft.wheel_momentum_limit,
    ),
    Quantity(
        name="jerk",
        word="jerk",
        label="Jerk",
        caption="platform angular\njerk",
        unit="deg/s^3",
        power=3,
        values=lambda motion: motion.spin[2],
        given=lambda craft: craft.jerk_limit,
    ),
    Quantity(
        name="wheel_torques",
        word="torque",
        label="Wheel torques",
        caption="wheel torques",
        unit="N m",
        power=2,
        of_wheels=True,
        by_inertia=True,
        values=lambda motion: motion.wheel_torques,
        lesser=lambda motion: motion.turning_torques,
        given=lambda craft: craft.wheel_array and craft.wheel_array.torque,
    ),
    Quantity(
        name="wheel_momenta",
        word="momentum",
        label="Wheel momenta",
        caption="wheel momenta",
        unit="N m s",
        power=1,
        of_wheels=True,
        by_inertia=True,
        values=lambda motion: motion.wheel_momenta,
        lesser=lambda motion: motion.resting_momenta,
        given=lambda craft: craft.wheel_array and craft.wheel_array.momentum,
    ),
)
"""All that can be limited, in the order of a report."""

_BY_NAME = {quantity.name: quantity for quantity in QUANTITIES}


def _named(name: str) -> Quantity:
    """The quantity of a name."""
    return _BY_NAME[name]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Limit:
    """``|f - centre| <= bound`` at every instant, for each component ``f`` of a quantity.

    Attributes:
        quantity: what is limited.
        owners: (c,) of each component the body axis, the joint, the wheel or pair of wheels, or for angles
            the terminal, by name; of a length "length".
        bound: (c,) positive, in SI units.
        centre: (c,) in SI units; None for zero.
    """

    quantity: Quantity = field(metadata={"static": True})
    owners: tuple[str, ...] = field(metadata={"static": True})
    bound: AnyArray
    centre: AnyArray | None = None

    def shares(self, motion: Kinematics) -> AnyArray:
        """Shares ``|f - centre| / bound`` (c, ...) of the limit that a motion takes."""
        xp, values, bound = arrays(self.quantity.values(motion), self.bound)
        shape = (-1, *[1] * (values.ndim - 1))
        if self.centre is not None:
            values = values - xp.asarray(self.centre).reshape(shape)
        return xp.abs(values) / bound.reshape(shape)

    def time_factors(self, motion: Kinematics) -> AnyArray:
        """Factors (c, ...) on the time of a motion from which on each component keeps the limit."""
        lesser, power = self.quantity.lesser, self.quantity.power
        if lesser is None:
            return time_factor(self.shares(motion), power)
        _, values, slow, bound = arrays(self.quantity.values(motion), lesser(motion), self.bound)
        bound = bound.reshape(-1, *[1] * (values.ndim - 1))
        return time_factor((values - slow) / bound, power, slow / bound)

    @property
    def names(self) -> tuple[str, ...]:
        """(c,) of the components, such as "platform rate x" or "terminal-1 yaw rate"."""
        word = self.quantity.word
        if self.quantity.of_joints or self.quantity.of_wheels:
            return tuple(f"{owner} {word}" for owner in self.owners)
        return tuple(f"platform {word} {owner}" for owner in self.owners)


@made_once
def limits(craft: Spacecraft) -> tuple[Limit, ...]:
    """All limits that a spacecraft has, in the order of `QUANTITIES`.

    Args:
        craft: its numbers may be traced; then so are the bounds.

    Returns:
        Without those of joints where there are none, and without those that need the inertia where there is
        no inertia.
    """
    found = []
    for quantity in QUANTITIES:
        given = quantity.given(craft)
        if given is None or (quantity.by_inertia and craft.inertia is None):
            continue
        owners = _owners(quantity, craft)
        if owners:
            bound = array_module(given).full(len(owners), given)
            centre = None if quantity.centre is None else quantity.centre(craft)
            found.append(Limit(quantity=quantity, owners=owners, bound=bound, centre=centre))
    return tuple(found)


def _owners(quantity: Quantity, craft: Spacecraft) -> tuple[str, ...]:
    """Names (c,) of what each component is of, see `Limit`; empty where the spacecraft has no such joint."""
    if quantity.of_wheels:
        return row_names(craft.wheels, craft.allocation)
    if not quantity.of_joints:
        return _LENGTH if quantity.of_length else _AXES
    if quantity.power:
        return craft.joint_names
    devices = craft.drives if quantity.name == "drive" else craft.terminals
    return tuple(device.name for device in devices)


def timed_limits(craft: Spacecraft) -> tuple[tuple[Limit, ...], tuple[Limit, ...]]:
    """The limits that a slower motion can keep (power above zero): of the platform, and of the joints."""
    timed = [limit for limit in limits(craft) if limit.quantity.power]
    joints = tuple(limit for limit in timed if limit.quantity.of_joints)
    return tuple(limit for limit in timed if not limit.quantity.of_joints), joints


def longest(craft: Spacecraft, power: int) -> AnyArray:
    """The largest length of the platform's angular velocity, or of a derivative of it, that limits allow.

    Args:
        craft: its limits of that derivative count, and not those of torque or momentum.
        power: 1 of the angular velocity, 2 of the acceleration.

    Returns:
        In rad/s, rad/s^2: the diagonal of the box within the limits, sqrt(3) times one that all axes share;
            or the limit of the length where that is less.
    """
    bounds = [
        limit.bound
        for limit in timed_limits(craft)[0]
        if limit.quantity.power == power and not limit.quantity.by_inertia
    ]
    xp = array_module(*bounds)
    lengths = [xp.max(bound) * xp.sqrt(xp.sum((bound / xp.max(bound)) ** 2)) for bound in bounds]
    return xp.min(xp.stack(lengths))


def values(names: Iterable[str], motion: Kinematics) -> AnyArray:
    """Components of quantities by name, one after the other, and then their lesser parts.

    Args:
        names: of the platform's.
        motion: with all that they need.

    Returns:
        (C + E, ...) in SI units: C components, and the lesser parts of the E among them that have one, which
        are the last.
    """
    own = [_BY_NAME[name] for name in names]
    found = [quantity.values(motion) for quantity in own]
    found += [quantity.lesser(motion) for quantity in own if quantity.lesser is not None]
    return array_module(*found).concatenate(found)


def components(names: Iterable[str], rows: int = 0) -> list[slice]:
    """List the slices that quantities of the platform have of the vector that `values` returns.

    Args:
        names: of the quantities, in the order of that vector.
        rows: number of rows of the array of wheels.
    """
    found, first = [], 0
    for name in names:
        last = first + _size(name, rows)
        found.append(slice(first, last))
        first = last
    return found


def lesser_components(names: Iterable[str], rows: int) -> list[slice | None]:
    """For each of the platform's quantities the slice of its lesser part in `values`; None without one."""
    given = list(names)
    first = sum(_size(name, rows) for name in given)
    found: list[slice | None] = []
    for name in given:
        has = _BY_NAME[name].lesser is not None
        found.append(slice(first, first + rows) if has else None)
        first += rows * has
    return found


def are_lengths(names: Iterable[str], rows: int = 0) -> np.ndarray:
    """(C,) which components of the platform's quantities, as `values` has them, are lengths of vectors."""
    return np.concatenate([[_BY_NAME[name].of_length] * _size(name, rows) for name in names])


def _size(name: str, rows: int) -> int:
    """Number of components of one of the platform's quantities, with so many rows of wheels."""
    quantity = _BY_NAME[name]
    if quantity.of_wheels:
        return rows
    return 1 if quantity.of_length else 3


def highest_derivative(names: Iterable[str]) -> int:
    """The highest derivative by time that quantities of these names need."""
    return max(_BY_NAME[name].power for name in names)
