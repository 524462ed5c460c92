"""States that a file gives in the local orbital frame: z to nadir, y against the orbit's normal, x = y x z.

A scenario holds inertial attitudes, so such states are converted when the file is read, for the instant of
the state: the start, or the end of a manoeuvre whose duration is given.
"""

from typing import Any

import numpy as np

from jaxplan import sky, so3
from jaxplan.model.goals import GivenState
from jaxplan.schema.faults import WRONG, Place
from jaxplan.schema.sky import View, is_wrong
from jaxplan.schema.states import LOCAL, LocalState

# s to either side, over which the frame's turn is differenced; off by 1e-10 rad/s at most.
_DIFFERENCE_STEP = 0.5


def in_inertial(state: Any, view: Any, time: float | None, place: Place) -> Any:
    """Convert a state in the local orbital frame to an inertial one.

    Args:
        state: start or goal, as it was read; anything that is no `LocalState` is returned as it is.
        view: the table ``[sky]``, as it was read; None if the file has none.
        time: s from the epoch, when the state holds; None if it is not known.
        place: place of the state.

    Returns:
        A `GivenState`, or `WRONG` if there is none; why that is was noted.
    """
    if not isinstance(state, LocalState):
        return state
    here = place["frame"]
    if view is None:
        return here.fault("needs [sky], with epoch_utc and observer", LOCAL)
    if time is None:
        complaint = (
            "needs trajectory.duration_s to be a number, since the frame turns; else give targets, such as "
            'camera = "nadir", with a wish for "ram"'
        )
        return here.fault(complaint, LOCAL)
    parts = dict(vars(state))
    if not isinstance(view, View) or is_wrong(view) or any(own is WRONG for own in parts.values()):
        return WRONG  # noted before
    times = time + _DIFFERENCE_STEP * np.array([-1.0, 0.0, 1.0])
    try:
        before, then, after = np.swapaxes(
            sky.local_axes(view.observer, epoch=view.epoch, times=times), -1, -2
        )
    except (ValueError, ImportError) as error:
        return here.fault(str(error), LOCAL)
    attitude = then @ so3.exp(parts["rotation_vector"])
    turning = so3.log(after @ before.T) / (2 * _DIFFERENCE_STEP)  # of the frame, inertial axes
    spin = parts["angular_velocity"] + attitude.T @ turning
    return GivenState(**parts | {"rotation_vector": so3.log(attitude), "angular_velocity": spin})
