"""Links of a shell: which satellite each terminal points at, all day or at a switch, and what blocks them.

A *topology* is an integer array (T, n) for T satellites with n terminals each: entry [s, k] is the number of
the satellite that terminal k of satellite s points at. The topologies made here are mutual: where A has a
terminal for B, B has one for A. The only exception is a star with three terminals after the switch: a
satellite in an outer plane has nobody to pair with there, as there is no plane beyond.

**Around a switch**, a single change of links, with three terminals a satellite is linked to its two
neighbours in the plane, and to one satellite in a plane beside. Before the switch, even planes pair with
those to their east and odd ones with those to their west; after it, the other way round. With four terminals
a satellite is linked to the nearest satellites to the east and to the west; after the switch, to the second
nearest ones.

**Over time** the links are a mesh. A satellite's links in its plane always go to the same satellites, those
directly ahead and behind. To either side it is linked to the nearest satellite of the plane beside, as long
as neither of the two is beyond a given latitude, since planes cross at high latitudes. Two satellites are
linked where each is the nearest to the other. The satellite that is linked already counts as nearer than it
is by a fraction of its distance, the *hysteresis*, so that links do not change back and forth. Sides are seen
from the satellite, with the zenith up: its right is opposite to the normal of its orbit. So the plane to the
east is to the right of satellites that fly north and to the left of those that fly south, and terminals
change their planes where the satellites turn round, at the highest latitudes.

A link is *out* while its direction is inside the Sun's cone, or outside by less than `CLEARANCE`: an operator
would not use it, and a terminal that looked along it would violate the keep-out cone. Its terminal *waits* at
`CLEARANCE` outside the cone, as close to the link as the Earth's cone allows, ready to take it up again.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

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
_RIM_POINTS = 721
"""Directions around the Sun's cone tried for a waiting terminal, half to either side of the nearest."""
SIDES = FORE, AFT, RIGHT, LEFT = ("fore", "aft", "right", "left")
NOBODY = -1
"""In the place of a satellite's number: no link."""
_AHEAD_PENALTY = 1e-9  # relative increase of distances ahead, so that ahead and behind never tie


def default_topologies(shell: Shell, terminals: int) -> tuple[np.ndarray, np.ndarray]:
    """Make the topologies before and after a switch for satellites with three or four terminals.

    Args:
        shell: with at least two satellites in each plane. A star has no planes beyond its outer ones; a third
            terminal that would point there points to the plane on the other side instead.
        terminals: number of each satellite's terminals, three or four.

    Returns:
        The two topologies, (T, n) int, before and after the switch. Columns are fore, aft and cross; or fore,
        aft, east and west.

    Raises:
        ScenarioError: for another number of terminals, an odd number of planes with three terminals, or a
            star with four.
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
    """Check a topology that the caller gives, and return it as an array.

    Args:
        value: (T, n) satellite numbers, one for each terminal of each satellite.
        key: the argument's name, for messages.
        shell: the T satellites.
        terminals: number of each satellite's terminals, n.

    Returns:
        (T, n) int.

    Raises:
        ScenarioError: for another shape or type, or a number outside [0, T - 1].
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
    """Earth and Sun around a shell at one time, which its links must avoid.

    Directions are unit vectors in the inertial frame of `jaxplan.sky.orbits`.

    Attributes:
        shell: the satellites.
        time: s, at which positions are taken.
        sun_direction: (3,) unit vector toward the Sun; None where there is no keep-out cone of the Sun.
        sun_half_angle: rad, of the Sun's cone.
        lowest_altitude: km, below which no point of a link may lie.
        earth_half_angle: rad, of the cone about nadir in which no link may be. It is wide enough for nadir to
            move over `drift_time`.
        drift_time: s, the longest manoeuvre for which the Earth's cone is wide enough.
    """

    shell: Shell
    time: float
    sun_direction: np.ndarray | None
    sun_half_angle: float
    lowest_altitude: float
    earth_half_angle: float
    drift_time: float

    def links(self, topology: np.ndarray, when: str, names: Sequence[str]) -> tuple[np.ndarray, list[str]]:
        """Compute the directions of all links, and messages about those that are not possible.

        A link is not possible if it leads to the satellite itself, passes below `lowest_altitude`, or is
        inside the Earth's cone about nadir.

        Args:
            topology: (T, n) int, the satellite that each terminal points at.
            when: "before" or "after" the switch, for messages.
            names: of the n terminals, for messages.

        Returns:
            Directions (T, n, 3), inertial unit vectors, zero for a satellite's link to itself; and one
            message for each terminal and each reason why its links are impossible, which describes that of
            the first satellite concerned and counts the others. Without messages all links are possible.
        """
        shell, positions = self.shell, self.shell.positions(self.time)
        with jax.enable_x64(True):
            seen = np.asarray(_lines_of_sight(positions[:, None], positions[topology]))
        directions, grazing = seen[..., :3], seen[..., 3]
        cosine = np.einsum("tni,ti->tn", directions, shell.nadir(self.time))
        off_nadir = np.arccos(np.clip(cosine, -1, 1))
        itself = topology == np.arange(shell.total)[:, None]
        blocked = ~(grazing >= self.lowest_altitude) & ~itself
        inside = ~(off_nadir >= self.earth_half_angle) & ~itself & ~blocked
        cone = np.rad2deg(self.earth_half_angle)
        reasons: tuple[tuple[np.ndarray, Callable[[tuple[int, int]], str]], ...] = (
            (itself, lambda _: "has the satellite itself as its target"),
            (
                blocked,
                lambda link: (
                    f"comes down to {grazing[link]:.0f} km, "
                    f"below lowest_altitude = {self.lowest_altitude:g} km"
                ),
            ),
            (
                inside,
                lambda link: (
                    f"is {np.rad2deg(off_nadir[link]):.1f} deg from nadir, inside the Earth's "
                    f"cone of {cone:.1f} deg: a smaller drift_time makes that narrower"
                ),
            ),
        )
        faults = []
        for column, name in enumerate(names):
            for bad, why in reasons:
                concerned = np.flatnonzero(bad[:, column]).tolist()
                if not concerned:
                    continue
                first, others = concerned[0], len(concerned) - 1
                more = f"; so it is with {others} other satellite{'s' * (others > 1)}" if others else ""
                link = f"{name} to satellite {topology[first, column]} {when} the switch"
                place = f"satellite {first} (plane {shell.plane[first]}, slot {shell.slot[first]})"
                faults.append(f"{place}, {link}: the link {why((first, column))}{more}")
        return directions, faults

    def in_the_sun(self, directions: np.ndarray) -> np.ndarray:
        """Tell which directions are inside the Sun's cone, or closer to its rim than `CLEARANCE`.

        Args:
            directions: (..., 3) inertial unit vectors.

        Returns:
            (...) bool; all False where no Sun is kept out.
        """
        if self.sun_direction is None:
            return np.zeros(directions.shape[:-1], dtype=bool)
        return np.asarray(separation(directions, self.sun_direction) < self.sun_half_angle + CLEARANCE)

    def waiting(self, links: np.ndarray, out: np.ndarray) -> np.ndarray:
        """Find the directions in which the terminals wait whose links are out.

        Args:
            links: (2, T, n, 3) inertial unit vectors, before and after the switch.
            out: (2, T, n) bool, whether each link is out.

        Returns:
            (k, 3) inertial unit vectors for the k links that are out, in the order of ``links[out]``. Without
            a Sun these are the links themselves.

        Raises:
            ScenarioError: if the cones of Sun and Earth leave a terminal nowhere to wait.
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
    """Directions from `here` to `there`, and how close the lines between them come to the Earth.

    Args:
        here: (..., 3) km, inertial position of the satellite that looks.
        there: (..., 3) km, inertial position of the satellite looked at.

    Returns:
        (..., 4): the inertial unit vector, then the lowest altitude along the line in km.
    """
    direction, lowest = orbits.line_of_sight(here, there), orbits.grazing_altitude(here, there)
    return jax.numpy.concatenate([direction, lowest[..., None]], axis=-1)


def waiting_directions(
    links: np.ndarray, sun: np.ndarray, half_angle: float, down: np.ndarray, earth_half_angle: float
) -> tuple[np.ndarray, np.ndarray]:
    """Find the directions nearest to links that keep `CLEARANCE` from the cones of Sun and Earth.

    Only directions at `CLEARANCE` outside the rim of the Sun's cone are tried, at `_RIM_POINTS` points.

    Args:
        links: (K, 3) inertial unit vectors of the links, inside the Sun's cone or near it.
        sun: (3,) inertial unit vector toward the Sun.
        half_angle: rad, of the Sun's cone.
        down: (K, 3) inertial unit vectors toward nadir.
        earth_half_angle: rad, of the Earth's cone about nadir.

    Returns:
        (K, 3) unit vectors, the nearest direction tried that is clear of the Earth; and (K,) bool, whether
        there is one. Where there is none, the vector is the nearest direction tried, which is not clear.
    """
    toward = links - (links @ sun)[:, None] * sun
    length = np.linalg.norm(toward, axis=-1, keepdims=True)
    # any perpendicular direction, for a link exactly toward the Sun
    anywhere = np.cross(sun, np.eye(3)[np.argmin(np.abs(sun))])
    first = np.where(length > 1e-12, toward / np.where(length > 1e-12, length, 1), _normalize(anywhere))
    second = np.cross(sun, first)
    turn = np.linspace(-np.pi, np.pi, _RIM_POINTS)
    turn = turn[np.argsort(np.abs(turn), kind="stable")]  # smallest turn from the link first
    around = np.cos(turn)[:, None] * first[:, None] + np.sin(turn)[:, None] * second[:, None]
    rim = half_angle + CLEARANCE
    places = np.cos(rim) * sun + np.sin(rim) * around  # (K, turns, 3)
    clear = separation(places, down[:, None]) >= earth_half_angle + CLEARANCE
    chosen = np.argmax(clear, axis=-1)
    return _normalize(places[np.arange(len(links)), chosen]), np.any(clear, axis=-1)


def _normalize(vectors: np.ndarray) -> np.ndarray:
    """Scale vectors (..., 3) to unit length."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


@dataclass(kw_only=True, eq=False)
class Mesh:
    """The links of a shell as time goes on; `at` must be called with times that do not decrease.

    The links between planes depend on those of the call before, because of the hysteresis.

    Args:
        shell: the satellites.
        sides: the side of `SIDES` that each terminal serves.
        highest_latitude: rad, beyond which a satellite has no links to other planes.
        hysteresis: fraction by which another satellite must be nearer for a link to change to it.
    """

    shell: Shell
    sides: tuple[str, ...]
    highest_latitude: float
    hysteresis: float
    _partners: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        shell = self.shell
        # slot in the plane to the east that each slot is linked to
        self._partners = np.full((self._pair_count, shell.slots), NOBODY)

    @property
    def _pair_count(self) -> int:
        """Number of pairs of neighbouring planes that are linked; 0 without terminals on both sides.

        It is also 0 for a delta of one or two planes; with two planes both sides would face the same plane.
        """
        planes = self.shell.planes
        if not {RIGHT, LEFT} <= set(self.sides):
            return 0
        if self.shell.pattern == "star":
            return planes - 1
        return planes if planes > 2 else 0

    def at(self, time: float) -> np.ndarray:
        """Compute the links at a time and remember those between planes for the next call.

        Args:
            time: s, not less than that of the call before.

        Returns:
            (T, n) int: the satellite that each terminal is linked to, `NOBODY` for none. Links are mutual.
        """
        shell = self.shell
        links = np.full((shell.total, len(self.sides)), NOBODY)
        numbers = np.arange(shell.total)
        for side, step in ((FORE, 1), (AFT, -1)):
            if side in self.sides:
                there = shell.neighbours(0, step)
                links[:, self.sides.index(side)] = np.where(there == numbers, NOBODY, there)
        if self._pair_count:
            self._link_planes(links, time)
        return links

    def _link_planes(self, links: np.ndarray, time: float) -> None:
        """Write the links between neighbouring planes at a time into `links`, in place.

        Args:
            links: (T, n) int, whose columns for right and left are changed.
            time: s.
        """
        shell, count = self.shell, self._pair_count
        shape = (shell.planes, shell.slots, 3)
        place, ahead = (np.reshape(states, shape) for states in shell.states(time))
        place = place / shell.radius
        normal = np.cross(place[:, 0], ahead[:, 0])
        west, east = np.arange(count), (np.arange(count) + 1) % shell.planes
        # whether each satellite of the east (west) plane is left of the west (east) plane, (pairs, slots)
        left_of_west = np.einsum("psk,pk->ps", place[east], normal[west]) > 0
        left_of_east = np.einsum("psk,pk->ps", place[west], normal[east]) > 0
        low = np.abs(place[..., 2]) <= math.sin(self.highest_latitude)
        # one must have the other on its left, the other on its right: (pairs, west slots, east slots)
        fits = left_of_west[:, None, :] != left_of_east[:, :, None]
        fits &= low[west][:, :, None] & low[east][:, None, :]
        cosine = np.clip(np.einsum("psk,ptk->pst", place[west], place[east]), -1, 1)
        far = np.sqrt(2 - 2 * cosine)
        behind = np.einsum("psk,ptk->pst", ahead[west], place[east]) > 0
        far = np.where(fits, far * (1 + _AHEAD_PENALTY * behind), np.inf)
        pair, slot = np.nonzero(self._partners >= 0)
        far[pair, slot, self._partners[pair, slot]] *= 1 - self.hysteresis
        best, back = np.argmin(far, axis=2), np.argmin(far, axis=1)
        own = np.arange(shell.slots)
        chosen = np.take_along_axis(far, best[:, :, None], axis=2)[..., 0]
        mutual = (np.take_along_axis(back, best, axis=1) == own) & np.isfinite(chosen)
        self._partners = np.where(mutual, best, NOBODY)
        pair, slot = np.nonzero(mutual)
        other = best[pair, slot]
        right, left = (self.sides.index(side) for side in (RIGHT, LEFT))
        to_left = left_of_west[pair, other]
        ends = west[pair] * shell.slots + slot, east[pair] * shell.slots + other
        columns = np.where(to_left, left, right), np.where(to_left, right, left)
        # the nearest is written last and stays
        order = np.argsort(-np.tile(chosen[pair, slot], 2), kind="stable")
        who, whom, column = (np.concatenate(part)[order] for part in (ends, ends[::-1], columns))
        links[who, column] = whom
        for mine, theirs in ((right, left), (left, right)):
            answered = links[links[:, mine], theirs] == np.arange(shell.total)
            links[:, mine] = np.where((links[:, mine] >= 0) & answered, links[:, mine], NOBODY)


def crossing_latitude(shell: Shell) -> float:
    """Highest latitude in rad that a shell's satellites reach; neighbouring planes cross near it."""
    return math.asin(math.sin(shell.inclination))
