"""The mesh of a shell as it changes: links to neighbours in the plane and to the nearest satellites beside.

A satellite's links in its plane always go to the same satellites, those directly ahead and behind. To either
side it is linked to the nearest satellite of the plane beside, as long as neither of the two is beyond a
given latitude, since planes cross at high latitudes. Two satellites are linked where each is the nearest to
the other. The satellite that is linked already counts as nearer than it is by a fraction of its distance, the
*hysteresis*, so that links do not change back and forth.

Sides are seen from the satellite, with the zenith up: its right is opposite to the normal of its orbit. So
the plane to the east is to the right of satellites that fly north and to the left of those that fly south,
and terminals change their planes where the satellites turn round, at the highest latitudes.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from jaxplan.constellation.shell import Shell

SIDES = FORE, AFT, RIGHT, LEFT = ("fore", "aft", "right", "left")
NOBODY = -1
"""In the place of a satellite's number: no link."""
_AHEAD_PENALTY = 1e-9  # relative increase of distances ahead, so that ahead and behind never tie


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
