"""Keep-out and keep-in cones in the inertial frame, each bound to named devices, as users state them.

`tabulate` makes rows of them, see `jaxplan.model.constraints`: a zone is a row, whose margin is that of its
worst device; keep-in zones that share a group form one constraint, which holds while at least one of them
does. The axis of a zone may move (`DirectionPath`). Its row has NaN for an axis, so that where somebody
forgets about that, it counts as broken; `Constraints.at` gives the rows as they are at an instant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import jax
import numpy as np

from jaxplan.display import shown
from jaxplan.model.constraints import INERTIAL, Constraints, capacity
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


def tabulate(
    keep_out: Sequence[KeepOut], keep_in: Sequence[KeepIn], device_names: Sequence[str]
) -> Constraints:
    """The zones as padded rows, in the order keep-out, keep-in, padding.

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
    axis = stacked(given + [np.array([0.0, 0.0, 1.0])] * extra)
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
    return Constraints(
        axis=axis.reshape(-1, 3),
        frame=np.full(size, INERTIAL),
        partner=np.zeros(size, int),
        half_angle=half_angle,
        side=side,
        bound=bound,
        entry=np.arange(size),
        group=group,
        body=np.zeros((0, 3)),
        carrier=np.zeros(0, int),
        carried=np.zeros((0, 3)),
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
