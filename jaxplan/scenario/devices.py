"""Kinds of values in a scenario file that name devices: lists of them, and factors for some."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from jaxplan.scenario.faults import Place, nearest
from jaxplan.scenario.kinds import Interval, Kind, Number

_FACTOR = Number(Interval("[1e-3, 1e3]"))


@dataclass(frozen=True)
class DeviceList(Kind):
    """Names of terminals and instruments, at least one."""

    wanted = "an array of names of devices"

    def read(self, value: object, place: Place) -> tuple[str, ...] | None:
        """The names."""
        if not isinstance(value, list) or not value:
            place.fault(f"must be {self.wanted}, at least one", value)
            return None
        before = len(place.faults)
        known = place.devices.all
        seen: set[str] = set()
        for i, name in enumerate(value):
            if not isinstance(name, str):
                place.item(i).fault("must be the name of a device", name)
            elif name in seen:
                place.item(i).fault("is named twice", name)
            elif known is not None and name not in known:
                place.item(i).fault(f"no such device, {nearest(name, known, 'devices')}", name)
            else:
                seen.add(name)
        return tuple(value) if len(place.faults) == before else None

    def take(self, value: Any, place: Place) -> tuple[str, ...] | None:
        """The names; one by itself may be given as it is, and none."""
        names = [value] if isinstance(value, str) else value
        if isinstance(names, list | tuple) and all(isinstance(name, str) for name in names):
            return self.read(list(names), place) if names else ()
        place.refuse("must be a tuple of names of devices", value)
        return None

    def write(self, value: Any) -> list[str]:
        """A list."""
        return list(value)


@dataclass(frozen=True)
class DeviceName(Kind):
    """The name of a device.

    Attributes:
        with_joints: whether it must be a terminal.
    """

    with_joints: bool = False

    @property
    def wanted(self) -> str:
        """What it names."""
        return f"the name of a {self._noun}"

    @property
    def _noun(self) -> str:
        return "terminal" if self.with_joints else "device"

    def read(self, value: object, place: Place) -> str | None:
        """The name."""
        known = place.devices.terminals if self.with_joints else place.devices.all
        if not isinstance(value, str):
            place.fault(f"must be {self.wanted}", value)
        elif known is not None and value not in known:
            place.fault(f"no such {self._noun}, {nearest(value, known, f'{self._noun}s')}", value)
        else:
            return value
        return None

    def take(self, value: Any, place: Place) -> str | None:
        """The name."""
        if isinstance(value, str):
            return self.read(value, place)
        place.refuse(f"must be {self.wanted}", value)
        return None


@dataclass(frozen=True)
class TerminalFactors(Kind):
    """A positive factor for some of the terminals."""

    wanted = "a table from names of terminals to numbers"
    range = _FACTOR.range

    def read(self, value: object, place: Place) -> dict[str, float] | None:
        """The factors by name."""
        if not isinstance(value, dict):
            place.fault(f"must be {self.wanted}", value)
            return None
        return self._each(_FACTOR.read, value, place)

    def _each(self, make: Callable[[Any, Place], Any], value: Mapping[str, Any], place: Place) -> Any:
        """The factors of terminals that there are."""
        before = len(place.faults)
        known = place.devices.terminals
        for name in value:
            if known is not None and name not in known:
                place.key(name).fault(f"no such terminal, {nearest(name, known, 'terminals')}")
        read = {name: make(number, place.key(name)) for name, number in value.items()}
        return read if len(place.faults) == before else None

    def take(self, value: Any, place: Place) -> dict[str, float] | None:
        """The factors by name."""
        if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
            place.refuse("must be a dict from names of terminals to numbers", value)
            return None
        return self._each(_FACTOR.take, value, place)

    def write(self, value: Any) -> dict[str, float]:
        """A table."""
        return {name: float(factor) for name, factor in value.items()}
