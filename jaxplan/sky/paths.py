"""How the direction to a target goes over a manoeuvre, for zones and targets that move."""

import numpy as np

from jaxplan.geometry.directions import separation
from jaxplan.given import number
from jaxplan.model.moving import DirectionPath
from jaxplan.sky.sights import Epoch, Thing, directions, drift_times

ACCURACY = 1e-9  # rad, of the path between its samples
_FEWEST, _MOST = 8, 4096  # intervals


def path(target: Thing, *, epoch: Epoch, observer: Thing, duration_s: float) -> DirectionPath:
    """The direction to a target over a manoeuvre.

    Args:
        target: what is looked at: a satellite, a body's name, or a position.
        epoch: UTC of the manoeuvre's start.
        observer: who looks, a satellite or a body.
        duration_s: s, in (0, 86400].

    Returns:
        The path, as the axis of a zone or the target of a terminal, with so many samples that it is within
        1e-9 rad of `directions` wherever it was looked at between them.

    Raises:
        ValueError: as `directions`; and if the target passes so close that 4,096 samples are not enough.
        ImportError: if the extra ``orbit`` is needed and not installed.

    Example:
        >>> zone = KeepIn(name="link", direction=sky.path(neighbour, epoch=epoch, observer=here,
        ...     duration_s=80.0), half_angle=0.1, devices=("terminal-1",))
    """
    if not number("duration_s", duration_s, "a number of s") > 0:
        raise ValueError(f"duration_s = {duration_s}: must lie in (0, 86400] s")
    drift_times(observer, duration_s)  # for its errors
    intervals = _FEWEST
    while intervals <= _MOST:
        times = np.linspace(0.0, duration_s, 2 * intervals + 1)
        seen = directions(target, epoch=epoch, observer=observer, times=times)
        try:
            found = DirectionPath.through(times[::2], seen[::2])
        except ValueError:  # it turns too far between them
            found = None
        if found is not None and np.all(separation(found.at(times), seen) <= ACCURACY):
            return found
        intervals *= 2
    raise ValueError(f"target: passes so close that {_MOST} samples over {duration_s:g} s do not follow it")
