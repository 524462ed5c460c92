"""Where a label goes: at the first of some places where it covers no other label, and the fewest curves.

Any unit will do, as long as places, sizes and points share it; a label is a box around its place.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

Box = tuple[np.ndarray, np.ndarray]  # centre and size, (2,) each


@dataclass(frozen=True)
class Labels:
    """The labels of one panel, as they are placed one after the other.

    Attributes:
        points: (k, 2) of what is drawn, which labels should not cover.
        taken: boxes that no label may touch; those of the labels placed are added.
    """

    points: np.ndarray
    taken: list[Box] = field(default_factory=list)

    def place(self, places: Iterable[ArrayLike], size: ArrayLike, *, must: bool = False) -> np.ndarray | None:
        """Choose a place and take it.

        Args:
            places: centres that the label may have, the best first.
            size: width and height of the label.
            must: whether the label has to stand somewhere, be it upon another one.

        Returns:
            (2,) the centre; None if there is no room.
        """
        every, extent = [np.asarray(place, dtype=float) for place in places], np.asarray(size, dtype=float)
        free = [place for place in every if not any(_touch((place, extent), box) for box in self.taken)]
        candidates = free or (every if must else [])
        if not candidates:
            return None
        best = min(candidates, key=lambda place: self._covered(place, extent))  # of equals, the first
        self.taken.append((best, extent))
        return best

    def _covered(self, centre: np.ndarray, size: np.ndarray) -> int:
        return int(np.sum(np.all(np.abs(self.points - centre) < size / 2, axis=-1)))


def _touch(one: Box, other: Box) -> bool:
    return bool(np.all(np.abs(one[0] - other[0]) < (one[1] + other[1]) / 2))
