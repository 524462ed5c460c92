"""Number and name the directions that zones bind, and check the names that zones give.

Such a direction is a *sight*. Sights are numbered as in `jaxplan.model.constraints`: first the devices
(terminals, drives, instruments), then axes of the body, then vectors of moving parts. The axes of the body
are those that zones state, and the outward normals of the edges of instruments' fields of view; the vectors
of moving parts are the same for devices with joints.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxplan.model import outlines
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.jit import is_traced


class Bound:
    """The sights that cones bind; its methods find those of a zone, and raise ValueError for wrong names.

    Attributes:
        craft: the spacecraft that carries the devices.
        devices: names of its devices.
        terminals: number of its terminals.
        gimbals: number of its devices with joints.
        body: for each axis of the body the vector (3,) in body axes and its name.
        carried: for each vector of a moving part the vector (3,) along its device's boresight, left and up,
            its name, and the number of the device.
    """

    def __init__(self, cones: Sequence[Any], spacecraft: Spacecraft) -> None:
        self.devices, self.terminals = spacecraft.device_names, len(spacecraft.terminals)
        self.gimbals = self.terminals + len(spacecraft.drives)
        self.craft = spacecraft
        self.body: list[tuple[Any, str]] = []
        self.carried: list[tuple[Any, str, int]] = []
        places: dict[Any, tuple[bool, int]] = {}  # whether it is in `body`, and its index there
        for zone in cones:
            for vector in zone.vectors:
                places[id(vector)] = self._add_vector(zone, vector)
        for number in sorted({number for zone in cones if zone.of_field for number in self.fields(zone)}):
            places[number] = self._add_edges(number)
        first = len(self.devices), len(self.devices) + len(self.body)
        self._first_sight = {what: first[not of_body] + place for what, (of_body, place) in places.items()}

    @property
    def names(self) -> list[str]:
        """Names of all sights: devices, then axes of the body, then vectors of moving parts.

        An edge is called by its field of view, another vector by its components.
        """
        return [*self.devices, *(name for _, name in self.body), *(name for _, name, _ in self.carried)]

    @property
    def owners(self) -> list[int]:
        """For each sight the number of the device of whose field of view it is an edge.

        A sight that is no edge has its own number there.
        """
        found = list(range(self.count))
        for number, first in self._first_sight.items():
            if number in range(len(self.devices)):
                found[first : first + len(outlines.EDGES)] = [number] * len(outlines.EDGES)
        return found

    @property
    def count(self) -> int:
        """Number of sights, the directions that zones bind."""
        return len(self.devices) + len(self.body) + len(self.carried)

    def carrier(self, sight: int) -> Any:
        """Return the terminal or drive whose joints turn a sight, which is given by its number.

        The result is None if the body carries the sight.
        """
        first = len(self.devices) + len(self.body)
        number = self.carried[sight - first][2] if sight >= first else sight
        return self.craft.devices[number] if number < self.gimbals else None

    def alike(self, sights: Sequence[int]) -> list[list[int]]:
        """Group numbers of sights by what carries them: terminals, drives, or the body.

        Returns:
            A list of numbers for each kind of carrier that occurs, in the order of their first sights.
        """
        found: dict[type, list[int]] = {}
        for sight in sights:
            found.setdefault(type(self.carrier(sight)), []).append(sight)
        return list(found.values())

    def _add_vector(self, zone: Any, vector: Any) -> tuple[bool, int]:
        """Append a vector of a zone to `body`, or to `carried` if a device carries it.

        Returns:
            Whether it went to `body`, and its index in the list.
        """
        if vector.to is None:
            self.body.append((vector.along, body_axis_name(vector.along)))
            return True, len(self.body) - 1
        name = f"direction {_format_vector(vector.along)} of {vector.to}"
        self.carried.append((vector.along, name, self.gimbal(zone, "vectors", vector.to)))
        return False, len(self.carried) - 1

    def _add_edges(self, number: int) -> tuple[bool, int]:
        """Append the outward normals of the edges of a device's field of view to `body` or `carried`.

        Args:
            number: number of the device; normals of instruments go to `body`.

        Returns:
            Whether they went to `body`, and the index of the first one in the list.
        """
        device: Any = self.craft.devices[number]
        of_body = number >= self.gimbals
        first = len(self.body if of_body else self.carried)
        for edge, normal in zip(outlines.EDGES, device.edges, strict=True):
            name = f"{edge} edge of {device.name}'s field"
            if of_body:
                self.body.append((normal, name))
            else:
                self.carried.append((normal, name, number))
        return of_body, first

    def device(self, zone: Any, key: str, name: str) -> int:
        """Return the number of the device called `name`.

        Raises:
            ValueError: if there is none. The message names the zone and `key`, the zone's attribute that
                holds the name.
        """
        if name not in self.devices:
            known = ", ".join(self.devices) or "the spacecraft has none"
            raise ValueError(f"zone {zone.name}: {key}: there is no {name!r}, only {known}")
        return self.devices.index(name)

    def terminal(self, zone: Any, key: str, name: str) -> int:
        """Return the number of the terminal called `name`; arguments are as for `device`.

        Raises:
            ValueError: if there is no such device, or it is no terminal.
        """
        number = self.device(zone, key, name)
        if number >= self.terminals:
            raise ValueError(f"zone {zone.name}: {key}: {name!r} is no terminal")
        return number

    def gimbal(self, zone: Any, key: str, name: str) -> int:
        """Return the number of the device with joints called `name`; arguments are as for `device`.

        Raises:
            ValueError: if there is no such device, or it has no joints.
        """
        number = self.device(zone, key, name)
        if number >= self.gimbals:
            raise ValueError(f"zone {zone.name}: {key}: {name!r} has no joints")
        return number

    def bound(self, zone: Any) -> list[int]:
        """Return the numbers of all sights that a cone binds: its devices in their order, then its vectors.

        Raises:
            ValueError: if it binds nothing, or names a device that does not exist or names one twice.
        """
        given: object = zone.devices  # whatever its type says
        if isinstance(given, str):
            raise ValueError(f"zone {zone.name}: devices = {given!r}: must be a tuple of names")
        names = zone.devices
        if zone.binds_all:
            names = self.devices
        elif not names and not zone.vectors:
            raise ValueError(f"zone {zone.name}: devices: must name what it binds, at least one")
        numbers = [self.device(zone, "devices", name) for name in names]
        for place, name in enumerate(names):
            if name in names[:place]:
                raise ValueError(f"zone {zone.name}: devices: {name!r} is named twice")
        return numbers + [self._first_sight[id(vector)] for vector in zone.vectors]

    def fields(self, zone: Any) -> list[int]:
        """Return the numbers of the devices whose fields of view a zone binds; by default all that have one.

        Raises:
            ValueError: if it binds a vector or a device without a field of view, or if no device has one.
        """
        if zone.vectors:
            raise ValueError(f"zone {zone.name}: vectors: have no field of view")
        with_field = [n for n, one in enumerate(self.craft.devices) if one.field_of_view is not None]
        if zone.binds_all:
            if not with_field:
                raise ValueError(f"zone {zone.name}: devices: none has a field_of_view")
            return with_field
        numbers = self.bound(zone)
        for number in numbers:
            if number not in with_field:
                raise ValueError(f"zone {zone.name}: devices: {self.devices[number]!r} has no field_of_view")
        return numbers

    def edges(self, number: int) -> range:
        """Return the numbers of the four sights that are the edge normals of a device's field of view.

        `number` is that of the device.
        """
        return range(self._first_sight[number], self._first_sight[number] + len(outlines.EDGES))


def body_axis_name(axis: np.ndarray) -> str:
    """Return the name of an axis (3,) of the body in messages, such as "axis (0, 0, 1) of the body"."""
    return f"axis {_format_vector(axis)} of the body"


def _format_vector(vector: np.ndarray) -> str:
    """Return a vector's components as text with three digits, such as "(0, 0, 1)"."""
    if is_traced(vector):  # its numbers are not known, and nobody reads the name
        return "(traced)"
    return f"({', '.join(f'{part:.3g}' for part in vector)})"
