"""Links of a shell: whom each terminal points at before and after a switch, and what is in the way.

A topology is an array (T, n): for each satellite the number of the satellite that each of its terminals
points at. Those made here are mutual: where A has a terminal for B, B has one for A. Only the outer planes of
a star with three terminals have nobody to pair with after the switch, beyond them there is none.

With three terminals a satellite has its two neighbours in the plane, and one in a plane beside. Even planes
pair with those to their east, odd ones with those to their west; at the switch they change sides. With
four, it has one to the east and one to the west, the nearest ones; at the switch both go to the next slot.

A link is out while its direction is inside the Sun's cone, or outside by less than `CLEARANCE`: an operator
would not use it, and a terminal that looked along it would break the cone. Its terminal waits at `CLEARANCE`
outside the cone, as close to the link as the Earth's cone allows, ready to take it up again.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jax import Array

from jaxplan.constellation.shell import Shell
from jaxplan.geometry.vectors import separation
from jaxplan.runtime.jit import quick_jit
from jaxplan.schema import ScenarioError
from jaxplan.sky import orbits

WHEN = ("before", "after")
CLEARANCE = math.radians(1.0)
"""rad between the Sun's cone and a link that is not out; a waiting terminal keeps it from both cones."""
_TURNS = 721
"""Directions around the Sun's cone tried for a waiting terminal, half to either side of the nearest."""


def default_topologies(shell: Shell, terminals: int) -> tuple[np.ndarray, np.ndarray]:
    """Make the topologies before and after a switch, for three or four terminals a satellite.

    Args:
        shell: of at least two satellites a plane. Beyond the outer planes of a star there is nobody; a
            terminal that would point there keeps to the plane on the other side.
        terminals: of each satellite, three or four.

    Returns:
        Two (T, n) int: fore, aft and cross; or fore, aft, east and west.

    Raises:
        ScenarioError: for another number of terminals, or planes that cannot be paired.
    """
    if terminals not in (3, 4):
        raise ScenarioError(
            [f"the spacecraft has {terminals} terminals: with other than 3 or 4, give before and after"],
            "the links",
        )
    if terminals == 3 and shell.planes % 2:
        raise ScenarioError(
            [f"planes = {shell.planes}: must be even, so that each plane has one to pair with"], "the links"
        )
    fore, aft = shell.neighbours(0, 1), shell.neighbours(0, -1)
    nearest, second = shell.nearest_slot_steps().tolist()
    east, west = shell.neighbours(1, nearest), shell.neighbours(-1, -nearest)
    if terminals == 3:
        east, west = np.where(east < 0, west, east), np.where(west < 0, east, west)
        even = shell.plane % 2 == 0
        across = np.where(even, east, west), np.where(even, west, east)
        return np.stack([fore, aft, across[0]], axis=-1), np.stack([fore, aft, across[1]], axis=-1)
    if shell.pattern == "star":
        raise ScenarioError(
            ['pattern = "star": its outer planes have neighbours on one side only, so give before and after'],
            "the links",
        )
    later = shell.neighbours(1, second), shell.neighbours(-1, -second)
    return np.stack([fore, aft, east, west], axis=-1), np.stack([fore, aft, *later], axis=-1)


def checked_topology(value: object, key: str, shell: Shell, terminals: int) -> np.ndarray:
    """Check a topology that the caller gives.

    Args:
        value: (T, n) numbers of satellites.
        key: the argument's name, for messages.
        shell: of which satellites.
        terminals: number of each satellite's, n.

    Returns:
        (T, n) int.

    Raises:
        ScenarioError: for another shape or type, or a number that no satellite has.
    """
    try:
        table = np.asarray(value)
    except ValueError:  # rows of different lengths
        table = np.zeros(0)
    if table.shape != (shell.total, terminals) or not np.issubdtype(table.dtype, np.integer):
        wanted = f"integers of shape ({shell.total}, {terminals}), a satellite for each terminal"
        raise ScenarioError(
            [f"{key} has shape {table.shape} and type {table.dtype}: must be {wanted}"], "the links"
        )
    wrong = np.argwhere((table < 0) | (table >= shell.total))
    if len(wrong):
        row, column = wrong[0].tolist()
        raise ScenarioError(
            [f"{key}[{row}, {column}] = {table[row, column]}: must lie in [0, {shell.total - 1}]"],
            "the links",
        )
    return table


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings:
    """Earth and Sun around a shell at one time, which its links must lead past.

    Attributes:
        shell: the satellites.
        time: s, of the positions.
        sun_direction: (3,) unit vector, inertial; None where no Sun is kept out.
        sun_half_angle: rad, of its cone.
        lowest_altitude: km that links stay above.
        earth_half_angle: rad, of the cone about nadir that no link may be in, wide enough for `drift_time`.
        drift_time: s, that a manoeuvre may take before nadir has moved by more than its cone is wider.
    """

    shell: Shell
    time: float
    sun_direction: np.ndarray | None
    sun_half_angle: float
    lowest_altitude: float
    earth_half_angle: float
    drift_time: float

    def links(self, topology: np.ndarray, when: str, names: Sequence[str]) -> tuple[np.ndarray, list[str]]:
        """Directions of all links, and messages on those that cannot be.

        Args:
            topology: (T, n).
            when: of `WHEN`.
            names: of the terminals.

        Returns:
            (T, n, 3) inertial unit vectors, zero for a satellite's link to itself; and a phrase for each
            terminal with links to oneself, through the Earth or its air, or too close to its limb, which
            names the first of its satellites.
        """
        shell, positions = self.shell, self.shell.positions(self.time)
        with jax.enable_x64(True):
            seen = np.asarray(_lines_of_sight(positions[:, None], positions[topology]))
        directions, grazing = seen[..., :3], seen[..., 3]
        cosine = np.einsum("tni,ti->tn", directions, shell.nadir(self.time))
        off_nadir = np.arccos(np.clip(cosine, -1, 1))
        itself = topology == np.arange(shell.total)[:, None]
        blocked = ~(grazing >= self.lowest_altitude)
        bad = itself | blocked | ~(off_nadir >= self.earth_half_angle)
        faults = []
        for column in np.flatnonzero(np.any(bad, axis=0)):
            first, count = int(np.argmax(bad[:, column])), int(np.sum(bad[:, column]))
            if itself[first, column]:
                why = "has the satellite itself as its target"
            elif blocked[first, column]:
                why = (
                    f"comes down to {grazing[first, column]:.0f} km, "
                    f"below lowest_altitude = {self.lowest_altitude:g} km"
                )
            else:
                off, cone = np.rad2deg([off_nadir[first, column], self.earth_half_angle])
                why = (
                    f"is {off:.1f} deg from nadir, inside the Earth's cone of {cone:.1f} deg: "
                    "a smaller drift_time makes that narrower"
                )
            more = f"; so it is with {count - 1} other satellites" if count > 1 else ""
            link = f"{names[int(column)]} to satellite {topology[first, column]} {when} the switch"
            place = f"satellite {first} (plane {shell.plane[first]}, slot {shell.slot[first]})"
            faults.append(f"{place}, {link}: the link {why}{more}")
        return directions, faults

    def in_the_sun(self, directions: np.ndarray) -> np.ndarray:
        """Which directions (..., 3) are inside the Sun's cone, or closer to it than `CLEARANCE`: (...)."""
        if self.sun_direction is None:
            return np.zeros(directions.shape[:-1], dtype=bool)
        return np.asarray(separation(directions, self.sun_direction) < self.sun_half_angle + CLEARANCE)

    def waiting(self, links: np.ndarray, out: np.ndarray) -> np.ndarray:
        """Find the directions in which terminals wait whose links are out.

        Args:
            links: (2, T, n, 3) inertial unit vectors, before and after the switch.
            out: (2, T, n) bool, which of them are out.

        Returns:
            (k, 3) inertial unit vectors for the k links that are out, in the order of ``links[out]``.

        Raises:
            ScenarioError: if there is no such place.
        """
        if self.sun_direction is None:
            return links[out]
        satellites = np.nonzero(out)[1]
        down = self.shell.nadir(self.time)[satellites]
        places, there = waiting_directions(
            links[out], self.sun_direction, self.sun_half_angle, down, self.earth_half_angle
        )
        if not np.all(there):
            number = satellites[np.argmin(there)]
            fault = f"satellite {number}: the cones of Sun and Earth leave its terminals nowhere to wait"
            raise ScenarioError([fault], f"the shell {self.shell.name}")
        return places


@quick_jit
def _lines_of_sight(here: Array, there: Array) -> Array:
    """(..., 4): inertial unit vector from `here` to `there`, (..., 3) km; the line's lowest altitude, km."""
    direction, lowest = orbits.line_of_sight(here, there), orbits.grazing_altitude(here, there)
    return jax.numpy.concatenate([direction, lowest[..., None]], axis=-1)


def waiting_directions(
    links: np.ndarray, sun: np.ndarray, half_angle: float, down: np.ndarray, earth_half_angle: float
) -> tuple[np.ndarray, np.ndarray]:
    """Find the directions nearest to links that are clear of the cones of Sun and Earth.

    Args:
        links: (K, 3) directions of the links, inertial.
        sun: (3,) direction of the Sun.
        half_angle: rad, of its cone.
        down: (K, 3) directions of nadir.
        earth_half_angle: rad, of the Earth's cone about nadir.

    Returns:
        (K, 3) unit vectors, the admissible ones nearest to the links, and (K,) bool: whether there is one.
    """
    toward = links - (links @ sun)[:, None] * sun
    length = np.linalg.norm(toward, axis=-1, keepdims=True)
    anywhere = np.cross(sun, np.eye(3)[np.argmin(np.abs(sun))])  # for a link right to the Sun
    first = np.where(length > 1e-12, toward / np.where(length > 1e-12, length, 1), _unit(anywhere))
    second = np.cross(sun, first)
    turn = np.linspace(-np.pi, np.pi, _TURNS)
    turn = turn[np.argsort(np.abs(turn), kind="stable")]  # the nearest first
    around = np.cos(turn)[:, None] * first[:, None] + np.sin(turn)[:, None] * second[:, None]
    rim = half_angle + CLEARANCE
    places = np.cos(rim) * sun + np.sin(rim) * around  # (K, turns, 3)
    clear = separation(places, down[:, None]) >= earth_half_angle + CLEARANCE
    chosen = np.argmax(clear, axis=-1)
    return _unit(places[np.arange(len(links)), chosen]), np.any(clear, axis=-1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) at unit length."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
