"""Rows at places close to each other, where they are linearised: the platform's loads, and margins."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jaxplan.trajectory.global_spline.motion import Motion
from jaxplan.trajectory.global_spline.rows import LIMIT, NEAR_ANGLE, NEAR_SHARE, SIGNS, ZONE, Index, Step

_FAR_SHARE = 0.5  # of a limit is left at every place: then no step reaches it
_KNOWN_ANGLE = np.deg2rad(20.0)  # margins beyond are not looked at: no step takes a boresight that far
_STRIDE = 4  # of places next to each other one in four is held, and those that are extreme


@dataclass(frozen=True, eq=False)
class Loads:
    """One of the platform's loads at the places: rows (S, 2, 3)."""

    name: str
    power: int
    motion: Motion
    load: int  # which
    scale: np.ndarray  # (3,) 1 / (limit * duration^power)
    rows: np.ndarray  # (4, S, n) of the basis
    kind: int = LIMIT
    near: float = NEAR_SHARE
    linear: bool = False

    @property
    def time(self) -> float:
        """Of the rows."""
        return -float(self.power)

    @property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return 1 - SIGNS[:, None] * (self.motion.loads[:, self.load] * self.scale)[:, None]

    @cached_property
    def _local(self) -> np.ndarray:
        """(S, 3, 4, 3) slopes of the shares."""
        return self.motion.load_slopes[:, self.load] * self.scale[:, None, None]

    def change(self, step: Step) -> np.ndarray:
        """See `Family`; where all is far from its limit, so that no step reaches it, none is looked for."""
        if np.all(self.room > _FAR_SHARE):
            return np.zeros_like(self.room)
        shares = np.einsum("sida,dsa->si", self._local, step.curves[:, :, :3])
        return SIGNS[:, None] * shares[:, None]

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        place, sign, axis = index
        local = np.zeros((0, 4, 3))
        if len(place):
            local = SIGNS[sign][:, None, None] * self._local[place, axis]
        slopes = np.zeros((len(place), self.motion.curves.shape[2], self.rows.shape[2]))
        slopes[:, :3] = np.einsum("rda,drn->ran", local, self.rows[:, place])
        return slopes

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; thinned."""
        return wanted & _telling(room)


@dataclass(frozen=True, eq=False)
class Zones:
    """Margins at the places: rows (S, D, Z)."""

    motion: Motion
    rows: np.ndarray
    room: np.ndarray  # beyond what is wanted
    name: str = "zone"
    kind: int = ZONE
    near: float = NEAR_ANGLE
    time: float = 0.0
    linear: bool = False

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        index = np.nonzero(self.room < _KNOWN_ANGLE)
        change = np.zeros_like(self.room)
        local = self.motion.margin_slopes(*index)
        change[index] = -np.einsum("ra,ra->r", local, step.curves[0, index[0]])
        return change

    def slopes(self, index: Index) -> np.ndarray:
        """See `Family`."""
        local = -self.motion.margin_slopes(*index)
        return local[:, :, None] * self.rows[0, index[0]][:, None, :]

    def chosen(self, wanted: np.ndarray, room: np.ndarray) -> np.ndarray:
        """See `Family`; thinned, and of a group only the entry that holds best."""
        return wanted & _telling(room) & np.isfinite(self.room)


def _telling(room: np.ndarray) -> np.ndarray:
    """Along the first axis, each fourth place and the local minima of the room."""
    kept = np.zeros(room.shape, dtype=bool)
    kept[::_STRIDE] = True
    with np.errstate(invalid="ignore"):
        kept[1:-1] |= (room[1:-1] <= room[:-2]) & (room[1:-1] <= room[2:])
    return kept
