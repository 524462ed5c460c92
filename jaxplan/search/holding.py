"""Which terminals are to be held on the axis of a keep-in zone while the platform turns, and on which.

A terminal that a zone by itself binds must stay in it all the time. One that a zone of a group binds need
not, as another zone of the group may hold instead; but as long as none does it has to follow its zone, and
of random motions hardly any would. So it is proposed to be held, too, on the axis of the zone that it looks
nearest to at start or goal. This only guides a search: what is clear, the margins say.
"""

import numpy as np

from jaxplan.path import Goal
from jaxplan.scenario.model import Scenario
from jaxplan.scenario.moments import axis_at
from jaxplan.zones import KeepIn


def held_axes(scenario: Scenario, start_attitude: np.ndarray, goal: Goal) -> tuple[np.ndarray, np.ndarray]:
    """The terminals to be held, and where they look then.

    Args:
        scenario: its keep-in zones and spacecraft.
        start_attitude: (3, 3) of the scenario's start.
        goal: where the search goes.

    Returns:
        (n,) bool, whether a terminal is to be held; (n, 3) inertial axes, any where it is not.
    """
    ends = [(start_attitude, scenario.start.joints), (goal.attitude, goal.joints)]
    seen = np.stack([scenario.spacecraft.boresights(*end) for end in ends], axis=1)
    zones = [
        _zone(terminal.name, scenario.keep_in, looks)
        for terminal, looks in zip(scenario.spacecraft.terminals, seen, strict=False)  # not instruments
    ]
    held = np.array([zone is not None for zone in zones], dtype=bool)
    axes = [np.array([0.0, 0.0, 1.0]) if zone is None else axis_at(zone) for zone in zones]
    return held, np.reshape(axes, (-1, 3))


def _zone(name: str, keep_in: tuple[KeepIn, ...], looks: np.ndarray) -> KeepIn | None:
    """The zone to hold a terminal on which looks along (2, 3) at start and goal; none if none binds it."""
    binding = [zone for zone in keep_in if name in zone.devices]
    alone = [zone for zone in binding if zone.any_of is None]
    if alone:
        return alone[0]
    return max(binding, key=lambda zone: float(np.max(looks @ axis_at(zone))), default=None)
