"""Keep-out and keep-in cones in the inertial frame, each bound to named devices.

A margin is an angle in radians: for a keep-out zone how far a device's boresight is outside the cone
(equation 11), for a keep-in zone how far it is inside (equation 12); zero or more is clear. A zone's
margin is that of its worst device. Keep-in zones that share a group form one constraint, which holds
while at least one of them does: its margin is that of its best zone. Angles are taken by ``atan2``, so
no digit is lost near 0 or half a turn. What is not a number counts as broken from the start, since
``jnp.min`` and ``jnp.max`` may drop a NaN on the CPU.

`Cones` is the same as plain arrays, for kernels. It is padded to a few fixed sizes with zones that bind
no device (margin +inf), so that scenes of different size share one compiled kernel.

The axis of a zone may move (`DirectionPath`). Its row has NaN for a direction, so that where somebody forgets
about that, it counts as broken; `Cones.at` gives the zones as they are at an instant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.display import shown
from jaxplan.moving import DirectionPath
from jaxplan.spacecraft import stacked


@shown("half_angle deg", "direction", "devices")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class KeepOut:
    """A cone that the named devices must not look into.

    Attributes:
        name: unique among all zones.
        direction: (3,) unit vector of the axis, inertial; or its path, of an axis that moves.
        half_angle: rad, in (0, pi).
        devices: names of the devices it binds; empty for all.
    """

    name: str = field(metadata={"static": True})
    direction: np.ndarray | DirectionPath
    half_angle: float
    devices: tuple[str, ...] = field(default=(), metadata={"static": True})


@shown("half_angle deg", "direction", "devices", "any_of")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class KeepIn:
    """A cone that each of the named devices must stay in.

    Attributes:
        name: unique among all zones.
        direction: (3,) unit vector of the axis, inertial; or its path, of an axis that moves.
        half_angle: rad, in (0, pi).
        devices: names of the devices it binds, at least one.
        any_of: name of its group, None for a zone that must hold by itself.
    """

    name: str = field(metadata={"static": True})
    direction: np.ndarray | DirectionPath
    half_angle: float
    devices: tuple[str, ...] = field(metadata={"static": True})
    any_of: str | None = field(default=None, metadata={"static": True})


@shown("side", "half_angle deg", "bound", "group", "direction", "paths")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Cones:
    """All zones of a scene as arrays, keep-out first, padded to `capacity` rows.

    Attributes:
        direction: (Z, 3) unit vectors; NaN in the rows of axes that move.
        half_angle: (Z,) rad.
        side: (Z,) +1 for keep-out, -1 for keep-in.
        bound: (Z, D) bool, the devices each zone binds; none for padding.
        group: (Z,) int, zones with the same number form one constraint; a zone by itself has its own.
        paths: of the axes that move, by row: None for one that does not; empty where none does.
    """

    direction: np.ndarray
    half_angle: np.ndarray
    side: np.ndarray
    bound: np.ndarray
    group: np.ndarray
    paths: tuple[DirectionPath | None, ...] = ()

    def axes(self, times: ArrayLike) -> np.ndarray:
        """Directions (..., Z, 3) of all axes at times (...), s."""
        t = np.asarray(times, float)
        found = np.broadcast_to(self.direction, (*t.shape, *self.direction.shape)).copy()
        for row, path in enumerate(self.paths):
            if path is not None:
                found[..., row, :] = path.at(t)
        return found

    def at(self, time: float) -> Self:
        """The zones as they are at an instant, s; none of them moves."""
        return replace(self, direction=self.axes(time), paths=()) if self.paths else self


def capacity(count: int) -> int:
    """Rows that `count` zones are padded to: 0, 8, 16, 32, ..."""
    return 0 if count == 0 else max(8, 1 << (count - 1).bit_length())


def tabulate(keep_out: Sequence[KeepOut], keep_in: Sequence[KeepIn], device_names: Sequence[str]) -> Cones:
    """The zones as padded arrays, in the order keep-out, keep-in, padding.

    Args:
        keep_out: zones to stay out of.
        keep_in: zones to stay in.
        device_names: names in the order of the device axis.

    Raises:
        ValueError: if a zone is of a device that there is not, for it would bind nothing.
    """
    zones: list[KeepOut | KeepIn] = [*keep_out, *keep_in]
    for zone in zones:
        _expect_devices(zone, device_names)
    size = capacity(len(zones))
    extra = size - len(zones)
    nowhere = np.full(3, np.nan)
    given = [nowhere if isinstance(zone.direction, DirectionPath) else zone.direction for zone in zones]
    direction = stacked(given + [np.array([0.0, 0.0, 1.0])] * extra)
    half_angle = stacked([zone.half_angle for zone in zones] + [0.5] * extra)
    side = np.ones(size)
    bound = np.zeros((size, len(device_names)), dtype=bool)
    group = np.arange(size)
    first_of: dict[str, int] = {}
    for row, zone in enumerate(zones):
        names = zone.devices or tuple(device_names)
        bound[row] = [name in names for name in device_names]
        if isinstance(zone, KeepIn):
            side[row] = -1
            if zone.any_of is not None:
                group[row] = first_of.setdefault(zone.any_of, row)
    paths = [zone.direction if isinstance(zone.direction, DirectionPath) else None for zone in zones]
    return Cones(
        direction=direction.reshape(-1, 3),
        half_angle=half_angle,
        side=side,
        bound=bound,
        group=group,
        paths=tuple(paths) if any(path is not None for path in paths) else (),
    )


def _expect_devices(zone: KeepOut | KeepIn, device_names: Sequence[str]) -> None:
    """Raise a ValueError if a zone names no devices of the spacecraft."""
    given: object = zone.devices  # whatever its type says
    if isinstance(given, str):
        raise ValueError(f"zone {zone.name}: devices = {zone.devices!r}: must be a tuple of names")
    for name in zone.devices:
        if name not in device_names:
            known = ", ".join(device_names) or "the spacecraft has none"
            raise ValueError(f"zone {zone.name}: devices: there is no {name!r}, only {known}")


def separation(first: ArrayLike, second: ArrayLike) -> Array:
    """Angle between directions, exact near 0 and pi.

    Args:
        first: (..., 3).
        second: (..., 3), broadcast.

    Returns:
        (...) rad in [0, pi]; its derivative at 0 and pi is taken as zero.
    """
    a, b = jnp.asarray(first), jnp.asarray(second)
    return jnp.arctan2(so3.length(jnp.cross(a, b)), jnp.sum(a * b, axis=-1))


def device_margins(cones: Cones, boresights: ArrayLike) -> Array:
    """Margin of every device to every zone.

    Args:
        cones: the zones.
        boresights: (..., D, 3) inertial unit vectors.

    Returns:
        (..., Z, D) rad; +inf where a zone does not bind a device, -inf where a margin is not a number.
    """
    angles = separation(jnp.asarray(boresights)[..., None, :, :], cones.direction[:, None, :])
    margins = jnp.asarray(cones.side)[:, None] * (angles - cones.half_angle[:, None])
    return jnp.where(cones.bound, jnp.where(jnp.isnan(margins), -jnp.inf, margins), jnp.inf)


def constraint_margins(cones: Cones, device_margin: ArrayLike) -> Array:
    """Margin of every constraint: the worst device of a zone, the best zone of a group.

    Args:
        cones: the zones.
        device_margin: (..., Z, D) as `device_margins` gives it.

    Returns:
        (..., Z) rad; rows that belong to another row's group, and padding, are +inf.
    """
    return group_margins(cones, jnp.min(jnp.asarray(device_margin), axis=-1, initial=jnp.inf))


def group_margins(cones: Cones, zone_margin: ArrayLike) -> Array:
    """Margin of every constraint from those of the zones: the best zone of each group.

    Args:
        cones: the zones.
        zone_margin: (..., Z) rad.

    Returns:
        (..., Z) rad; rows that belong to another row's group, and padding, are +inf.
    """
    same_group = cones.group[:, None] == cones.group[None, :]  # (row, member)
    members = jnp.where(same_group, jnp.asarray(zone_margin)[..., None, :], -jnp.inf)
    best = jnp.max(members, axis=-1, initial=-jnp.inf)
    leads = cones.group == jnp.arange(cones.group.shape[0])
    return jnp.where(leads, best, jnp.inf)


def edge_bound(start: ArrayLike, end: ArrayLike, curvature: ArrayLike) -> Array:
    """Largest value on an interval of a function known at both ends, of bounded second derivative.

    With ``|f''| <= C`` on an interval of length ``h``, ``f`` lies below the parabola through its end values
    with second derivative ``-C``. Where that is monotone the larger end value is the bound, with
    nothing lost.

    Args:
        start: (...) f at the interval's start.
        end: (...) f at its end.
        curvature: (...) ``C h^2 / 2``.

    Returns:
        (...) upper bound of f on the interval; +inf where one of the three is not a number.
    """
    a, b, c = jnp.asarray(start), jnp.asarray(end), jnp.asarray(curvature)
    rise = b - a
    inside = jnp.abs(rise) < c
    # the quotient by itself, since many intervals often share a curvature; of one too small to be seen beside
    # anything a larger one is as good
    vertex = a + (c + rise) ** 2 * (0.25 / jnp.maximum(c, jnp.sqrt(jnp.finfo(c.dtype).tiny)))
    bound = jnp.where(inside, vertex, jnp.maximum(a, b))
    return jnp.where(jnp.isnan(rise + c), jnp.inf, bound)


def swept_cosines(cones: Cones, start: ArrayLike, end: ArrayLike, curvature: ArrayLike) -> Array:
    """Upper bound of ``side * cos(angle to the axis)`` while a boresight moves.

    The larger it is, the smaller the margin. Comparing cosines instead of angles lets callers reduce
    over devices and times before they pay for the arc cosine of `margins_from_cosines`.

    Args:
        cones: the zones.
        start: (..., Z) cosines of the angles to the zones' axes where the motion starts.
        end: (..., Z) where it ends.
        curvature: (..., Z or 1) ``C h^2 / 2`` of `edge_bound` for the boresight's motion.

    Returns:
        (..., Z), whether the zone binds the device or not.
    """
    side = jnp.asarray(cones.side)
    return edge_bound(side * start, side * end, curvature)


def cosine_threshold(cones: Cones, clearance: ArrayLike) -> Array:
    """The signed cosine at which a margin is just the wanted clearance.

    Comparing with it tells whether margins reach a clearance without an arc cosine.

    Args:
        cones: the zones.
        clearance: (...) rad wanted; a zone gives it up to half of the room that it leaves.

    Returns:
        (..., Z); ``side * cos(angle to the axis)`` is at most this where the clearance is kept.
    """
    side = jnp.asarray(cones.side)
    room = jnp.where(side > 0, jnp.pi - cones.half_angle, cones.half_angle) / 2
    wanted = jnp.minimum(jnp.asarray(clearance)[..., None], room)
    return side * jnp.cos(cones.half_angle + side * wanted)


def margins_from_cosines(cones: Cones, signed_cosines: ArrayLike) -> Array:
    """Margins of ``side * cos(angle to the axis)``.

    Args:
        cones: the zones.
        signed_cosines: (..., Z), beyond [-1, 1] taken as the end of that range.

    Returns:
        (..., Z) rad; good to 1e-8 near a cone's very axis, else to rounding. At the axis and beyond the
        derivative is taken as zero.
    """
    side = jnp.asarray(cones.side)
    cosines = side * signed_cosines
    beyond = jnp.abs(cosines) >= 1  # where the arc cosine has no derivative
    angles = jnp.where(beyond, jnp.where(cosines > 0, 0, jnp.pi), jnp.arccos(jnp.where(beyond, 0, cosines)))
    return side * (angles - cones.half_angle)
