"""Records of what was chosen while a timeline was planned: how the duration of each slew came about.

A slew in the shortest time takes a multiple of a number that follows from its ends, and some seconds more:

    FIXED     nothing but these seconds
    BOUND     the strict lower bound of the time to a goal
    NEEDED    the time of the shortest motion to a goal that was found
    SEEN      the time until an instant at which targets come out of hiding

The goal is the one of some earlier duration, since where devices must point depends on when the slew ends.
Derivatives of a timeline hold these choices, and follow the numbers.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

from jaxplan.model.path import Path
from jaxplan.model.timeline import Activity
from jaxplan.runtime.display import shown
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import Trajectory

FIXED, BOUND, NEEDED, SEEN = "fixed", "bound", "needed", "seen"


@shown("kind", "seconds s", "factor", "offset s")
@dataclass(frozen=True, kw_only=True, eq=False)
class SlewTime:
    """A duration of a slew, ``factor * base + offset``, and what the base is.

    Attributes:
        seconds: s, the duration.
        kind: of the base: `FIXED`, `BOUND`, `NEEDED` or `SEEN`.
        factor: on the base, which is zero of `FIXED`.
        offset: s.
        goal: to which the bound is, or the shortest motion; None of other kinds.
        after: the duration after which that goal is the one; None likewise.
        path: along which the shortest motion was looked for; None for the straight one, and likewise.
        shortest: that motion, where it was found by a search; None where not.
        motion: what follows that goal, a `jaxplan.timeline.motions.Motion`; None of other kinds.
    """

    seconds: float
    kind: str = FIXED
    factor: float = 0.0
    offset: float = 0.0
    goal: State | None = None
    after: "SlewTime | None" = None
    path: Path | None = None
    shortest: Trajectory | None = None
    motion: Any = None

    @classmethod
    def fixed(cls, seconds: float) -> Self:
        """A duration, s, that nothing changes."""
        return cls(seconds=seconds, offset=seconds)

    @property
    def at_an_instant(self) -> bool:
        """Whether the slew ends just when its targets come out of hiding, or its window opens."""
        return self.kind == SEEN and self.factor == 1.0 and self.offset == 0.0

    def longer(self, factor: float, more: float) -> "SlewTime":
        """A duration that is a multiple of this one, and some seconds more."""
        return replace(
            self,
            seconds=factor * self.seconds + more,
            factor=factor * self.factor,
            offset=factor * self.offset + more,
        )


@shown("activity.name", "time", "begin s")
@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """How an activity came to begin.

    Attributes:
        activity: what was done.
        before: the state after what was done before.
        since: s, when it was reached, in the timeline's times.
        departure: where the slew to it starts, a `jaxplan.timeline.slews.Departure`; later than `since` where
            there was time to rest before.
        time: how the slew's duration came about; None of one that ends when the window opens, or targets are
            seen.
        goal: the state in which the slew ends.
        begin: s, when it does, in the timeline's times.
        end: s, when the activity ends, likewise.
        motion: what follows, a `jaxplan.timeline.motions.Motion`.
    """

    activity: Activity
    before: State
    since: float
    departure: Any
    time: SlewTime | None
    goal: State
    begin: float
    end: float
    motion: Any
