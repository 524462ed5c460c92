"""How fast a path is gone along, and where the breaks of a spline lie.

A path is measured by the time that each edge takes at full speed. It is gone along with a trapezoid of the
rate: the faster, the steeper its flanks. In a shortest motion the slowest joint does nothing else, so near
its flanks the breaks lie close, and few suffice between them.
"""

from dataclasses import dataclass

import numpy as np

_CALM_FLANK = 1 / 3  # of the duration, where there is time enough; near the least acceleration energy
_STEEP_FLANK, _STEEP_RISES = 0.1, 2.0  # of the duration and of the quickest rise, where there is not
_FLANK_BREAKS = 9  # intervals that cover a flank and a little more
_FLANK_STEP = 0.25  # of the flank, one interval


@dataclass(frozen=True, kw_only=True, eq=False)
class Pace:
    """A trapezoid of the rate along a path.

    Attributes:
        length: s at full speed.
        duration: s.
        flank: s, of each of the two.
    """

    length: float
    duration: float
    flank: float

    @classmethod
    def quickest(cls, length: float, rise: float) -> "Pace":
        """With full speed, which is reached in ``rise`` seconds, or with as much as there is room for."""
        if length >= rise:
            return cls(length=length, duration=length + rise, flank=rise)
        duration = 2 * np.sqrt(length * rise)
        return cls(length=length, duration=duration, flank=duration / 2)

    @classmethod
    def within(cls, duration: float, length: float, rise: float) -> "Pace":
        """In a given duration: at half the speed or less, where there is time, between flanks as calm."""
        steepest = max(_STEEP_RISES * rise, _STEEP_FLANK * duration)
        flank = np.clip(duration - 2 * length, min(steepest, _CALM_FLANK * duration), _CALM_FLANK * duration)
        if duration > length + rise:
            flank = min(flank, duration - length)
        return cls(length=length, duration=duration, flank=float(flank))

    def gone(self, places: np.ndarray) -> np.ndarray:
        """Share of the path gone at places (S,) in [0, 1] of the duration."""
        flank = self.flank / self.duration
        speed = 1 / (1 - flank)
        rising = speed * places**2 / (2 * flank)
        falling = 1 - speed * (1 - places) ** 2 / (2 * flank)
        cruising = speed * (places - flank / 2)
        return np.where(places < flank, rising, np.where(places > 1 - flank, falling, cruising))

    def places(self, shares: np.ndarray) -> np.ndarray:
        """Where shares (m + 1,) of the path are gone: the inverse of `gone`."""
        flank = self.flank / self.duration
        speed = 1 / (1 - flank)
        low = np.sqrt(np.maximum(2 * flank * shares / speed, 0))
        high = 1 - np.sqrt(np.maximum(2 * flank * (1 - shares) / speed, 0))
        middle = shares / speed + flank / 2
        return np.where(low < flank, low, np.where(high > 1 - flank, high, middle))

    def breaks(self, intervals: int) -> np.ndarray:
        """Breaks (intervals + 1,) in [0, 1], close together about the flanks."""
        flank = self.flank / self.duration
        if 2 * flank < 0.9:
            near = np.arange(_FLANK_BREAKS + 1) * min(_FLANK_STEP * flank, 1 / (3 * _FLANK_BREAKS))
        else:  # no cruise: the acceleration changes its sign in the middle
            return np.linspace(0, 1, intervals + 1)
        middle = np.linspace(near[-1], 1 - near[-1], intervals + 1 - 2 * _FLANK_BREAKS)
        return np.concatenate([near[:-1], middle, (1 - near)[-2::-1]])


def along(values: np.ndarray, shares: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Points on the straight lines between nodes.

    Args:
        values: (m + 1, A).
        shares: (m + 1,) of the path at the nodes, rising from 0 to 1.
        gone: (S,) of the path.

    Returns:
        (S, A).
    """
    return np.stack([np.interp(gone, shares, column) for column in values.T], axis=1)
