"""Records of the choices made while a timeline was planned: how the duration of each slew came about.

A slew in the shortest time takes ``factor * base + offset`` seconds, where the base is a number that follows
from the slew's ends. Its kind is one of

    FIXED     no base at all: the duration is the offset
    BOUND     the strict lower bound of the time to a goal
    NEEDED    the time of the shortest motion to a goal that was found
    SEEN      the time until an instant at which targets come out of hiding

The goal is the one that belongs to some duration tried before, since where devices must point depends on when
the slew ends. Derivatives of a timeline hold these choices fixed, and let the numbers vary.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

from jaxplan.model.activities import Activity
from jaxplan.model.path import Path
from jaxplan.runtime.display import shown
from jaxplan.timeline.tracking import State
from jaxplan.trajectory import Trajectory

FIXED, BOUND, NEEDED, SEEN = "fixed", "bound", "needed", "seen"


@shown("kind", "seconds s", "factor", "offset s")
@dataclass(frozen=True, kw_only=True, eq=False)
class SlewTime:
    """The duration of a slew, ``factor * base + offset``, and what the base is.

    Attributes:
        seconds: s, the duration.
        kind: kind of the base: `FIXED`, `BOUND`, `NEEDED` or `SEEN`, see the module.
        factor: factor on the base; zero for `FIXED`.
        offset: s, added to it.
        goal: the goal state of the bound, or of the shortest motion; None for other kinds.
        after: the duration tried before, which determined this goal; None for other kinds.
        path: the path along which the shortest motion was sought; None for a straight path and for other
            kinds.
        shortest: the shortest motion, if a search found it; None otherwise.
        motion: the motion that follows that goal, a `jaxplan.timeline.motions.Motion`; None for other kinds.
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
        """Return a duration, s, that depends on nothing."""
        return cls(seconds=seconds, offset=seconds)

    @property
    def at_an_instant(self) -> bool:
        """Whether the slew ends exactly when its targets come out of hiding, or when its window opens."""
        return self.kind == SEEN and self.factor == 1.0 and self.offset == 0.0

    def longer(self, factor: float, more: float) -> "SlewTime":
        """Return `factor` times this duration plus `more` seconds, recorded as such."""
        return replace(
            self,
            seconds=factor * self.seconds + more,
            factor=factor * self.factor,
            offset=factor * self.offset + more,
        )


@shown("activity.name", "time", "begin s")
@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """How the beginning of an activity came about.

    Attributes:
        activity: what was done.
        before: the spacecraft's state at the end of what was done before.
        since: s, when that state was reached, in the timeline's times.
        departure: where the slew starts, a `jaxplan.timeline.slews.Departure`; it is later than `since` if
            the spacecraft had time to rest before.
        time: how the slew's duration came about; None for a slew that ends when the window opens or the
            targets come into sight.
        goal: the state in which the slew ends.
        begin: s, when the slew ends, in the timeline's times.
        end: s, when the activity ends, likewise.
        motion: what follows the slew, a `jaxplan.timeline.motions.Motion`.
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
