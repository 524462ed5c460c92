"""Which terminals are to be held on the axis of a keep-in zone while the platform turns, and on which.

A terminal that a zone by itself binds must stay in it all the time. One that a zone of a group binds need
not, as another zone of the group may hold instead; but as long as none does it has to follow its zone, and
of random motions hardly any would. So it is proposed to be held, too, on the axis of the zone that it looks
nearest to at start or goal. This only guides a search: what is clear, the margins say.
"""

import numpy as np

from jaxplan.model.constraints import INERTIAL, Constraints
from jaxplan.model.path import Goal
from jaxplan.model.scenario import GivenState
from jaxplan.model.spacecraft import Spacecraft


def held_axes(
    spacecraft: Spacecraft, rows: Constraints, start: GivenState, goal: Goal
) -> tuple[np.ndarray, np.ndarray]:
    """The terminals to be held, and where they look then.

    Args:
        spacecraft: its terminals.
        rows: the constraints, none of them moving.
        start: where the search begins.
        goal: where it goes.

    Returns:
        (n,) bool, whether a terminal is to be held; (n, 3) inertial axes, any where it is not.
    """
    ends = [spacecraft.boresights(state.attitude, state.joints) for state in (start, goal)]
    seen, terminals = np.stack(ends, axis=1), len(spacecraft.terminals)
    inside = (rows.side < 0) & (rows.frame == INERTIAL)
    held, axes = np.zeros(terminals, dtype=bool), np.tile([0.0, 0.0, 1.0], (terminals, 1))
    for terminal, looks in enumerate(seen[:terminals]):
        binding = np.flatnonzero(inside & rows.bound[:, terminal])
        alone = binding[rows.single[binding]]
        if len(binding):
            nearest = np.argmax(np.max(rows.axis[binding] @ looks.T, axis=1))
            held[terminal] = True
            axes[terminal] = rows.axis[alone[0] if len(alone) else binding[nearest]]
    return held, axes
