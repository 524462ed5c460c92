"""Rows at places close to each other, where they are linearised: the platform's loads, and margins."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jaxplan.trajectory.global_spline.motion import Motion
from jaxplan.trajectory.global_spline.rows import (
    LIMIT,
    NEAR_ANGLE,
    NEAR_SHARE,
    SIGNS,
    ZONE,
    Index,
    Slopes,
    Step,
    numbers,
    taken,
)

_FAR_SHARE = 0.5  # of a limit is left at every place: then no step reaches it
_STRIDE = 4  # of places next to each other one in four is held, and those that are extreme


@dataclass(frozen=True, eq=False)
class Loads:
    """One of the platform's loads at the places: rows (G, S, 2, 3)."""

    name: str
    power: int
    motion: Motion
    load: int  # which
    scale: np.ndarray  # (G, 3) 1 / (limit * duration^power)
    rows: np.ndarray  # (G, 4, S, n) of the basis
    kind: int = LIMIT
    near: float = NEAR_SHARE
    linear: bool = False

    @property
    def time(self) -> float:
        """Of the rows."""
        return -float(self.power)

    @cached_property
    def room(self) -> np.ndarray:
        """Of the rows."""
        return 1 - SIGNS[:, None] * (self.motion.loads[:, :, self.load] * self.scale[:, None])[:, :, None]

    @cached_property
    def in_reach(self) -> np.ndarray:
        """Of the rows."""
        return ~np.all(self.room > _FAR_SHARE, axis=(1, 2, 3))

    def _local(self, curve: int) -> np.ndarray:
        """(S, 3, 4, 3) slopes of the shares."""
        return self.motion.load_slopes(curve)[:, self.load] * self.scale[curve, :, None, None]

    def change(self, step: Step) -> np.ndarray:
        """See `Family`."""
        change = np.empty((len(step.which), *self.room.shape[1:]))
        for own, curve in enumerate(step.which.tolist()):
            shares = np.einsum("sida,dsa->si", self._local(curve), step.curves[own, :, :, :3])
            change[own] = SIGNS[:, None] * shares[:, None]
        return change

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        curve, place, sign, axis = index
        axes = np.zeros((len(place), 4, self.motion.curves.shape[3]))
        for each in np.unique(curve).tolist():
            rows = curve == each
            local = self._local(each)[place[rows], axis[rows]]
            axes[rows, :, :3] = SIGNS[sign[rows]][:, None, None] * local
        return Slopes(axes, self.rows[curve, :, place])

    def chosen(self, wanted: np.ndarray, room: np.ndarray, which: np.ndarray) -> np.ndarray:
        """See `Family`; thinned, with the last place: unlike a margin, a load may be the worst at the end."""
        kept = _telling(room)
        kept[:, -1] = True
        return wanted & kept


@dataclass(frozen=True, eq=False)
class Zones:
    """Margins at the places: rows (G, S, D, Z)."""

    motion: Motion
    rows: np.ndarray  # (G, 4, S, n) of the basis
    room: np.ndarray  # beyond what is wanted
    name: str = "zone"
    kind: int = ZONE
    near: float = NEAR_ANGLE
    time: float = 0.0
    linear: bool = False

    @cached_property
    def in_reach(self) -> np.ndarray:
        """Of the rows."""
        return np.any(np.isfinite(self.room), axis=(1, 2, 3))

    def change(self, step: Step) -> np.ndarray:
        """See `Family`; zero of rows that stay far."""
        room = taken(self.room, step.which)
        reach = self.near + self.motion.reach(step.curves[:, 0], step.which)
        own, *rest = numbers(room < reach)
        local = self.motion.margin_slopes(step.which[own], *rest)
        change = np.zeros_like(room)
        change[(own, *rest)] = -np.einsum("ra,ra->r", local, step.curves[own, 0, rest[0]])
        return change

    def slopes(self, index: Index) -> Slopes:
        """See `Family`."""
        local = -self.motion.margin_slopes(*index)
        return Slopes(local[:, None], self.rows[index[0], 0, index[1]][:, None])

    def chosen(self, wanted: np.ndarray, room: np.ndarray, which: np.ndarray) -> np.ndarray:
        """See `Family`; thinned, and of a constraint only the entry that holds best."""
        return wanted & _telling(room) & np.isfinite(self.room[which])


def _telling(room: np.ndarray) -> np.ndarray:
    """Along the places, the second axis, each fourth one and the local minima of the room."""
    kept = np.zeros(room.shape, dtype=bool)
    kept[:, ::_STRIDE] = True
    with np.errstate(invalid="ignore"):
        kept[:, 1:-1] |= (room[:, 1:-1] <= room[:, :-2]) & (room[:, 1:-1] <= room[:, 2:])
    return kept
