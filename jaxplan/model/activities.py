"""A timeline: activities one after the other, each with what it points at, how long it lasts, and when.

Times are seconds from the start of the timeline, which is the `epoch` of its scene; files give them as UTC.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import jax
import numpy as np

from jaxplan.model.equality import same
from jaxplan.model.export_names import ExportNames
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.display import shown

SHORTEST, CALM = SLEWS = ("shortest", "calm")
LOOK_AHEAD = "whether the platform turns to where the next slew leads, as far as tracking leaves it free"
"""Meaning of the key `look_ahead`, for the manual and for messages."""
REST = "rest until the end"
"""Name of the rest that a plan has in the time that is left after all activities."""
_TIME_RANGE = "[0, 86400]"  # s, of all times of a timeline


@shown("name", "kind", "duration s", "earliest s", "latest s", "after")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Activity:
    """One thing to do: follow targets, point at them for an instant, hold an attitude, or do nothing.

    Exactly one of `track`, `point`, `attitude` and `idle` is given.

    Attributes:
        name: name, unique in the timeline.
        track: targets that devices follow all the time, and what other devices prefer or hold; its
            `tolerance` is the largest pointing error of each.
        point: targets at which devices point at one instant, with the rates at which they move.
        attitude: a state that is held at rest.
        idle: whether nothing is asked: the spacecraft comes to rest and moves only where zones ask for it.
        duration: s, how long it lasts; None for until `latest`.
        earliest: s, time before which it must not begin; None for as soon as possible after the one before.
        latest: s, time by which it must have ended; None for any time.
        after: name of an activity that must have ended before this one begins; empty for the one in front of
            it.
    """

    name: str = field(metadata=key("name", "unique", static=True))
    track: Targets | None = keyed(None, "track", "targets that devices follow all the time")
    point: Targets | None = keyed(None, "point", "targets at which devices point at one instant")
    attitude: GivenState | None = keyed(None, "attitude", "the state to be held, at rest")
    idle: bool = keyed(False, "idle", "nothing is asked", static=True)
    duration: float | None = keyed(
        None,
        "for_s",
        "how long; if absent until its window ends, the last one until timeline.until_s",
        _TIME_RANGE,
    )
    earliest: float | None = keyed(
        None,
        "from_s",
        "it does not begin before; if absent as soon as can be after the one in front",
        _TIME_RANGE,
    )
    latest: float | None = keyed(None, "until_s", "it has ended by then", _TIME_RANGE)
    after: str = keyed(
        "", "after", "name of an activity that must have ended before", kind="activity name", static=True
    )

    @property
    def kind(self) -> str:
        """What is asked: "track", "point", "attitude" or "idle"; "none" if nothing is, which is a fault."""
        given = (name for name in ("track", "point", "attitude") if getattr(self, name) is not None)
        return next(given, "idle" if self.idle else "none")

    @property
    def targets(self) -> Targets | None:
        """The targets of `track` or `point`; None for other activities."""
        return self.track if self.track is not None else self.point


@shown("name", "kind", "start s", "end s")
@dataclass(frozen=True, kw_only=True)
class Segment:
    """A part of a timeline's plan: a slew, or what one activity does.

    Attributes:
        name: name of the activity; for a slew, of the activity to which it leads.
        kind: "slew", "track", "attitude" or "idle".
        start: s, from the start of the timeline.
        end: s, likewise.
    """

    name: str
    kind: str
    start: float
    end: float


@shown("name", "activities", "until s", "slew", "look_ahead")
@dataclass(frozen=True, kw_only=True, eq=False)
class Timeline:
    """Activities in their order, with the spacecraft that does them.

    Attributes:
        name: name for titles and tables.
        scene: spacecraft, start, zones, settings and epoch. Its goal is ignored. Whatever moves in it must be
            known from the start of the timeline to its end.
        activities: the activities; they are done in this order, except where their `after` asks for another.
        until: s, when the timeline ends; None for the end of the last activity.
        slew: "shortest" for slews in the shortest time, "calm" for slews that use all the time there is.
        look_ahead: whether the platform, where followed targets leave it free to turn, already turns towards
            where the next slew leads.
        names: what exported files call the spacecraft; None for the exports' defaults.
    """

    name: str = field(metadata=key("name", "for titles and tables"))
    scene: Scenario = field(metadata=key("scene", "spacecraft, start, zones, settings and epoch"))
    activities: tuple[Activity, ...] = field(metadata=key("activity", "what is to be done, in order"))
    until: float | None = keyed(
        None, "until_s", "when it ends; if absent at the end of the last activity", _TIME_RANGE
    )
    slew: str = keyed(
        SHORTEST, "slew", "whether slews take the shortest time, or all that there is", options=SLEWS
    )
    look_ahead: bool = keyed(False, "look_ahead", LOOK_AHEAD)
    names: ExportNames | None = field(
        default=None, metadata=key("", "what exported files call the spacecraft")
    )

    @property
    def spacecraft(self) -> Spacecraft:
        """The spacecraft of the scene."""
        return self.scene.spacecraft

    @property
    def epoch(self) -> np.datetime64 | None:
        """UTC of the start; None where the scene has none."""
        return self.scene.epoch

    def __eq__(self, other: object) -> bool:
        return same(self, other) if isinstance(other, Timeline) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.name)  # the same for equal ones


def in_order(activities: Iterable[Activity]) -> list[Activity]:
    """Return the activities in the order in which they are done.

    That is the given order, except that an activity with an `after` waits until that one is done.

    Raises:
        ValueError: if activities wait for each other in a circle; the message names them.
    """
    left, done = list(activities), list[Activity]()
    while left:
        names = {one.name for one in left}
        first = next((one for one in left if one.after not in names), None)
        if first is None:
            raise ValueError(f"activities that come after each other: {', '.join(sorted(names))}")
        done.append(first)
        left.remove(first)
    return done
