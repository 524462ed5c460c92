"""Messages that say why no attitude lets devices point at their targets.

They describe the best attitude there is, see `jaxplan.goal.Decomposition`, with angles in degrees.
"""

from itertools import combinations

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.goal.aims import AZIMUTH, goal_ranges
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft

_NAMED_EXCESS_SHARE = 0.5  # devices off by this share of the worst excess or more are named, too


def apart(craft: Spacecraft, asked: Targets) -> str | None:
    """Return text on two instruments that cannot both see their targets; None if there are no such two.

    It compares the angle between their boresights with that between their targets, which must agree within
    the tolerance.
    """
    first, names = craft.gimbals.count, craft.device_names
    fixed = [(place, number) for place, number in enumerate(asked.numbers(craft)) if number >= first]
    for (i, one), (j, other) in combinations(fixed, 2):
        boresights = craft.fixed_boresights[[one - first, other - first]]
        between, targets = separation(*boresights), separation(asked.directions[i], asked.directions[j])
        if abs(between - targets) > 2 * asked.tolerance:
            return (
                f"{names[one]} and {names[other]} are {np.rad2deg(between):.6g} deg apart, their targets "
                f"{np.rad2deg(targets):.6g} deg"
            )
    return None


def off(craft: Spacecraft, asked: Targets, excesses: np.ndarray) -> str:
    """Return text on the devices that miss their targets most: joints beyond limits, boresights off targets.

    Args:
        craft: with the devices.
        asked: their targets, at an instant.
        excesses: (n, 2) rad, `Decomposition.aim_excesses` of the n devices with targets.
    """
    told: dict[str, str] = {}
    gimbals, ranges = craft.gimbals, goal_ranges(craft, asked)
    bad = np.argwhere(excesses >= _NAMED_EXCESS_SHARE * np.max(excesses)).tolist()
    for place, angle in bad:
        device, by = asked.numbers(craft)[place], np.rad2deg(excesses[place, angle])
        if device < len(craft.terminals) or (device < gimbals.count and angle == AZIMUTH):
            joint = (gimbals.yaws if angle == AZIMUTH else gimbals.pitches)[device]
            told[craft.joint_names[joint]] = f"{by:.4g} deg beyond {_range_text(ranges[joint])}"
        else:  # an angle in the axes of its boresight: with the other one it makes up the distance
            by = np.rad2deg(np.linalg.norm(np.maximum(excesses[place], 0)))
            told[craft.device_names[device]] = f"{by:.4g} deg off its target"
    each = [f"{name} is {what}" for name, what in told.items()]
    return " and ".join(", ".join(each).rsplit(", ", 1))


def _range_text(ends: np.ndarray) -> str:
    """Return text for a joint's range (2,) rad, in degrees."""
    low, high = np.rad2deg(ends)
    return f"its limit of {high:.6g} deg" if low == -high else f"its range of {low:.6g} to {high:.6g} deg"
