"""Spacecraft of a constellation, and the links that they can hold.

The spacecraft of a shell where the caller names none: a platform with three laser terminals.

Where a satellite looks is said in its local frame: x ahead, in the direction of flight, y to the left, z up.
An attitude that has the body's axes there is the nominal one.

Whom each terminal of a shell points at, before and after a switch of the topology, and who can be seen.

A topology is an array (T, n): for each satellite the number of the satellite that each of its terminals
points at. Those made here are mutual: where A has a terminal for B, B has one for A. Only the outer planes of
a star with three terminals have nobody to pair with after the switch, beyond them there is none.

With three terminals a satellite has its two neighbours in the plane, and one in a plane beside. Even planes
pair with those to their east, odd ones with those to their west; at the switch they change sides. With
four, it has one to the east and one to the west, the nearest ones; at the switch both go to the next slot.
"""

import math
from collections.abc import Sequence

import jax
import numpy as np
from jax import Array

from jaxplan.constellation.shell import Shell
from jaxplan.model.spacecraft import Spacecraft, Terminal
from jaxplan.runtime.jit import quick_jit
from jaxplan.schema import ScenarioError
from jaxplan.sky import orbits


def relay_spacecraft() -> Spacecraft:
    """A platform with a terminal to the front, one to the back, and one to its left side for cross links.

    Each turns by 80 deg to either side and by 30 deg up and down, at up to 6 deg/s and 4 deg/s^2. The
    platform turns at up to 1 deg/s and 0.5 deg/s^2.
    """
    terminals = (("fore", 0.0), ("aft", 180.0), ("cross", 90.0))
    return Spacecraft(
        terminals=tuple(
            Terminal(
                name=name,
                mount=math.radians(mount),
                yaw_limit=math.radians(80.0),
                pitch_limit=math.radians(30.0),
                rate_limit=math.radians(6.0),
                acceleration_limit=math.radians(4.0),
            )
            for name, mount in terminals
        ),
        rate_limit=math.radians(1.0),
        acceleration_limit=math.radians(0.5),
    )


def nominal_attitudes(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Attitudes with the body's x axis ahead and its z axis up.

    Args:
        positions: (N, 3) inertial.
        velocities: (N, 3) of circular orbits.

    Returns:
        (N, 3, 3) body to inertial.
    """
    up = positions / np.linalg.norm(positions, axis=-1, keepdims=True)
    ahead = velocities / np.linalg.norm(velocities, axis=-1, keepdims=True)
    return np.stack([ahead, np.cross(up, ahead), up], axis=-1)


WHEN = ("before", "after")


def default_topologies(shell: Shell, terminals: int) -> tuple[np.ndarray, np.ndarray]:
    """The topologies before and after a switch.

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
    """A topology that the caller gives.

    Args:
        value: (T, n) numbers of satellites.
        key: its name.
        shell: that they are of.
        terminals: of each satellite, n.

    Raises:
        ScenarioError: if it is none.
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


def lines_of_sight(positions: np.ndarray, topology: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of all links, and how near to the Earth they come.

    Args:
        positions: (T, 3) km.
        topology: (T, n).

    Returns:
        (T, n, 3) inertial unit vectors, zero for a satellite's link to itself, and (T, n) km: the lowest
        altitude of each line.
    """
    with jax.enable_x64(True):
        found = np.asarray(_lines_of_sight(positions[:, None], positions[topology]))
    return found[..., :3], found[..., 3]


@quick_jit
def _lines_of_sight(here: Array, there: Array) -> Array:
    direction, lowest = orbits.line_of_sight(here, there), orbits.grazing_altitude(here, there)
    return jax.numpy.concatenate([direction, lowest[..., None]], axis=-1)


def unreachable(
    shell: Shell,
    topology: np.ndarray,
    when: str,
    names: Sequence[str],
    directions: np.ndarray,
    grazing: np.ndarray,
    positions: np.ndarray,
    earth_half_angle: float,
    lowest_altitude: float,
) -> list[str]:
    """What is wrong with links: to oneself, through the Earth or its air, or too close to its limb.

    Args:
        shell: the satellites.
        topology: (T, n).
        when: of `WHEN`.
        names: of the terminals.
        directions: (T, n, 3) of the links.
        grazing: (T, n) km.
        positions: (T, 3) km.
        earth_half_angle: rad, of the cone about nadir that no link may be in.
        lowest_altitude: km that lines must stay above.

    Returns:
        A phrase for each terminal with such links, which names the first of its satellites.
    """
    down = -positions / np.linalg.norm(positions, axis=-1, keepdims=True)
    cosine = np.einsum("tni,ti->tn", directions, down)
    off_nadir = np.arccos(np.clip(cosine, -1, 1))
    itself = topology == np.arange(shell.total)[:, None]
    blocked = ~(grazing >= lowest_altitude)
    low = ~(off_nadir >= earth_half_angle)
    faults = []
    for column, name in enumerate(names):
        bad = np.flatnonzero((itself | blocked | low)[:, column])
        if not len(bad):
            continue
        first = int(bad[0])
        other = int(topology[first, column])
        if itself[first, column]:
            why = "has the satellite itself as its target"
        elif blocked[first, column]:
            why = (
                f"comes down to {grazing[first, column]:.0f} km, "
                f"below lowest_altitude = {lowest_altitude:g} km"
            )
        else:
            why = (
                f"is {np.rad2deg(off_nadir[first, column]):.1f} deg from nadir, inside the Earth's cone of "
                f"{np.rad2deg(earth_half_angle):.1f} deg: a smaller drift_time makes that narrower"
            )
        more = f"; so it is with {len(bad) - 1} other satellites" if len(bad) > 1 else ""
        place = f"satellite {first} (plane {shell.plane[first]}, slot {shell.slot[first]})"
        faults.append(f"{place}, {name} to satellite {other} {when} the switch: the link {why}{more}")
    return faults
