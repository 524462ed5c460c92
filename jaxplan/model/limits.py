"""The limits of a spacecraft: what is limited, by which name and unit, and how it scales with time.

This is the only list of them. Fit, time scaling, peaks, certificate, figures and report go through `limits`
of a spacecraft; a new kind of limit is a new entry of `QUANTITIES`.

Vectors of the platform are in body axes. A motion that is slowed down to ``s`` times its duration passes the
same attitudes and joint angles, and each quantity falls by a power of ``s``. So the shortest duration at
which it keeps a limit follows exactly from the largest fraction of the limit that it uses
(`jaxplan.model.kinematics`).

What wheels give and hold has a *lesser* part, which falls by one power less: the torque that turns the total
momentum with the body falls like the rates, and what a slow motion leaves them to hold does not fall at all
(`jaxplan.model.wheels`). The duration is then a root of a polynomial, and where the lesser part alone exceeds
the limit slowing down does not help.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, norm
from jaxplan.model.kinematics import Kinematics, time_factor
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import row_names
from jaxplan.runtime.compute_once import made_once

_AXIS_NAMES = ("x", "y", "z")
_LENGTH_NAME = ("length",)
_SUPERSCRIPTS = str.maketrans("23", "\N{SUPERSCRIPT TWO}\N{SUPERSCRIPT THREE}", "^")


def _length_component(vector: AnyArray) -> AnyArray:
    """Return the Euclidean lengths (1, ...) of vectors (3, ...), with an axis for the only component."""
    return norm(vector)[None]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A quantity that a spacecraft may limit, with c components.

    Attributes:
        name: name in reports, such as "angular_velocity".
        word: word that follows the name of a joint or precedes that of a body axis, such as "rate".
        label: text at the head of a row of a table.
        caption: text beside a panel of a figure, for quantities of the platform.
        unit: unit for people: angles in degrees, and "^" before exponents.
        power: how it scales: at ``s`` times the duration it is divided by ``s ** power``. It is the number of
            time derivatives in it; zero if it does not depend on the duration.
        of_joints: whether its components belong to joints; otherwise they belong to the platform's axes, or
            to wheels.
        of_wheels: whether its components belong to the rows of an array of wheels.
        of_length: whether it is the length of a vector, its only component. A length has no derivative where
            it is zero; its square is smooth everywhere.
        by_inertia: whether it depends on the inertia, without which it cannot be limited.
        values: computes its components (c, ...) in SI units from a motion.
        lesser: computes the part of them that falls by one power less; None where there is none.
        given: gets its limit in SI units from a spacecraft: a number, or one for each component; None for no
            limit. For angles with a range it is half the width of the range.
        centre: gets the middle of its range for each component from a spacecraft; None where that is zero.
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
        """Pickle the name only, since every process has the same list of quantities."""
        return _find_quantity, (self.name,)

    @property
    def angular(self) -> bool:
        """Whether it is measured in radians here and in degrees for people."""
        return self.unit.startswith("deg")

    @property
    def printed_unit(self) -> str:
        """The unit with exponents as superscripts."""
        return self.unit.translate(_SUPERSCRIPTS)

    def in_unit(self, values: ArrayLike) -> np.ndarray:
        """Convert values from SI units to `unit`."""
        return np.rad2deg(values) if self.angular else np.asarray(values, float)


def _joint_ranges(craft: Spacecraft, which: int) -> AnyArray:
    """Return the ranges (c, 2) rad of the yaws (`which` = 0), the pitches (1), or the drives' angles (2)."""
    terminals = len(craft.terminals)
    return craft.joint_ranges[which * terminals : (which + 1) * terminals if which < 2 else None]


def _joint_angle_quantity(name: str, word: str, label: str, which: int) -> "Quantity":
    """Make the quantity of a kind of joint angle: `which` as in `_joint_ranges`, others as in `Quantity`."""
    return Quantity(
        name=name,
        word=word,
        label=label,
        unit="deg",
        power=0,
        of_joints=True,
        values=lambda motion: motion.angles(which),
        given=lambda craft: (_joint_ranges(craft, which)[:, 1] - _joint_ranges(craft, which)[:, 0]) / 2,
        centre=lambda craft: (_joint_ranges(craft, which)[:, 1] + _joint_ranges(craft, which)[:, 0]) / 2,
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
        values=lambda motion: _length_component(motion.spin[0]),
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
        values=lambda motion: _length_component(motion.spin[1]),
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
    _joint_angle_quantity("yaw", "yaw", "Yaw angles", 0),
    _joint_angle_quantity("pitch", "pitch", "Pitch angles", 1),
    _joint_angle_quantity("drive", "angle", "Drive angles", 2),
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

_QUANTITY_BY_NAME = {quantity.name: quantity for quantity in QUANTITIES}


def _find_quantity(name: str) -> Quantity:
    """Return the entry of `QUANTITIES` that has a name."""
    return _QUANTITY_BY_NAME[name]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Limit:
    """The condition ``|f - centre| <= bound`` for each of c components ``f`` of a quantity, at every instant.

    Attributes:
        quantity: the quantity that is limited.
        owners: (c,) for each component the name of what it belongs to: the body axis, the joint, the wheel or
            pair of wheels; for joint angles the device; for a length "length".
        bound: (c,) positive, in SI units.
        centre: (c,) in SI units; None for zero.
    """

    quantity: Quantity = field(metadata={"static": True})
    owners: tuple[str, ...] = field(metadata={"static": True})
    bound: AnyArray
    centre: AnyArray | None = None

    def shares(self, motion: Kinematics) -> AnyArray:
        """Return the fractions ``|f - centre| / bound`` (c, ...) of the limit that a motion uses."""
        xp, values, bound = arrays(self.quantity.values(motion), self.bound)
        shape = (-1, *[1] * (values.ndim - 1))
        if self.centre is not None:
            values = values - xp.asarray(self.centre).reshape(shape)
        return xp.abs(values) / bound.reshape(shape)

    def time_factors(self, motion: Kinematics) -> AnyArray:
        """Return by how much a motion's duration must be multiplied to keep the limit, as (c, ...).

        At this factor and at every larger one the component keeps the limit; infinite where slowing down
        cannot help.
        """
        lesser, power = self.quantity.lesser, self.quantity.power
        if lesser is None:
            return time_factor(self.shares(motion), power)
        _, values, slow, bound = arrays(self.quantity.values(motion), lesser(motion), self.bound)
        bound = bound.reshape(-1, *[1] * (values.ndim - 1))
        return time_factor((values - slow) / bound, power, slow / bound)

    @property
    def names(self) -> tuple[str, ...]:
        """(c,) names of the limited components, such as "platform rate x" or "terminal-1 yaw rate"."""
        word = self.quantity.word
        if self.quantity.of_joints or self.quantity.of_wheels:
            return tuple(f"{owner} {word}" for owner in self.owners)
        return tuple(f"platform {word} {owner}" for owner in self.owners)


@made_once
def limits(craft: Spacecraft) -> tuple[Limit, ...]:
    """Return all limits that a spacecraft has, in the order of `QUANTITIES`.

    Args:
        craft: the spacecraft. Its numbers may be traced; then the bounds are traced, too.

    Returns:
        Limits of joints that it does not have, and limits that need the inertia where none is given, are left
        out.
    """
    found = []
    for quantity in QUANTITIES:
        given = quantity.given(craft)
        if given is None or (quantity.by_inertia and craft.inertia is None):
            continue
        owners = _component_owners(quantity, craft)
        if owners:
            bound = array_module(given).full(len(owners), given)
            centre = None if quantity.centre is None else quantity.centre(craft)
            found.append(Limit(quantity=quantity, owners=owners, bound=bound, centre=centre))
    return tuple(found)


def _component_owners(quantity: Quantity, craft: Spacecraft) -> tuple[str, ...]:
    """Return the names (c,) of what each component belongs to, see `Limit`.

    They are empty if the spacecraft has no joint of the kind.
    """
    if quantity.of_wheels:
        return row_names(craft.wheels, craft.allocation)
    if not quantity.of_joints:
        return _LENGTH_NAME if quantity.of_length else _AXIS_NAMES
    if quantity.power:
        return craft.joint_names
    devices = craft.drives if quantity.name == "drive" else craft.terminals
    return tuple(device.name for device in devices)


def timed_limits(craft: Spacecraft) -> tuple[tuple[Limit, ...], tuple[Limit, ...]]:
    """Return the limits that a slower motion can keep (power > 0): the platform's, and the joints'."""
    timed = [limit for limit in limits(craft) if limit.quantity.power]
    joints = tuple(limit for limit in timed if limit.quantity.of_joints)
    return tuple(limit for limit in timed if not limit.quantity.of_joints), joints


def longest(craft: Spacecraft, power: int) -> AnyArray:
    """Return the largest length of the platform's angular velocity or acceleration that its limits allow.

    Args:
        craft: the spacecraft; its limits of torque and momentum are not looked at.
        power: 1 for the angular velocity, 2 for the angular acceleration.

    Returns:
        rad/s or rad/s^2: half the diagonal of the box that the limits of the components make (sqrt(3) times
        the limit if all axes share it), or the limit of the length where that is less.
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
    """Return the components of some quantities of the platform, one after the other, then their lesser parts.

    Args:
        names: names of the quantities.
        motion: the motion, with all that they need.

    Returns:
        (C + E, ...) in SI units: all C components, then the lesser parts of those E among them that have one.
    """
    own = [_QUANTITY_BY_NAME[name] for name in names]
    found = [quantity.values(motion) for quantity in own]
    found += [quantity.lesser(motion) for quantity in own if quantity.lesser is not None]
    return array_module(*found).concatenate(found)


def components(names: Iterable[str], rows: int = 0) -> list[slice]:
    """Return for each quantity of the platform the slice that it takes in the result of `values`.

    Args:
        names: names of the quantities, in the order given to `values`.
        rows: number of rows of the array of wheels.
    """
    found, first = [], 0
    for name in names:
        last = first + _component_count(name, rows)
        found.append(slice(first, last))
        first = last
    return found


def lesser_components(names: Iterable[str], rows: int) -> list[slice | None]:
    """Return for each quantity the slice of its lesser part in the result of `values`, or None.

    None stands for a quantity without a lesser part. Arguments are as for `components`.
    """
    given = list(names)
    first = sum(_component_count(name, rows) for name in given)
    found: list[slice | None] = []
    for name in given:
        has = _QUANTITY_BY_NAME[name].lesser is not None
        found.append(slice(first, first + rows) if has else None)
        first += rows * has
    return found


def are_lengths(names: Iterable[str], rows: int = 0) -> np.ndarray:
    """(C,) bool, which components of platform quantities, as `values` has them, are lengths of vectors."""
    return np.concatenate(
        [[_QUANTITY_BY_NAME[name].of_length] * _component_count(name, rows) for name in names]
    )


def _component_count(name: str, rows: int) -> int:
    """Return the number of components of a quantity of the platform, given the number of rows of wheels."""
    quantity = _QUANTITY_BY_NAME[name]
    if quantity.of_wheels:
        return rows
    return 1 if quantity.of_length else 3


def highest_derivative(names: Iterable[str]) -> int:
    """Return the highest time derivative that quantities of these names need."""
    return max(_QUANTITY_BY_NAME[name].power for name in names)
