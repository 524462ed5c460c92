"""Messages on the pointing constraints that a state breaks, with angles in degrees."""

from collections.abc import Iterator, Sequence

import numpy as np

from jaxplan.model.bound import body_axis_name
from jaxplan.model.constraints import (
    INERTIAL,
    JOINTS,
    SIGHT,
    Constraints,
    best_entries,
    chosen_entries,
    state_margins,
)
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut, Mask, Zone

ROUNDING = 1e-9
"""rad, or share of a rate, by which a limit may be passed and not be broken, as in the certificate."""


def constraint_breaches(
    rows: Constraints,
    spacecraft: Spacecraft,
    attitude: np.ndarray,
    joints: np.ndarray,
    zones: Sequence[Zone],
    called: Sequence[str],
) -> Iterator[str]:
    """Yield a phrase for every pointing constraint that a state breaks.

    Args:
        rows: the constraints, at an instant.
        spacecraft: whose devices they bind.
        attitude: (3, 3) body to inertial.
        joints: (2n + d,) rad.
        zones: (r,) the zone of each of the r rows before the padding.
        called: names of the sights.

    Yields:
        The worst row of the constraint's best entry, the worst sight of that row, and the overlap in degrees.
    """
    sights = rows.sights(spacecraft.gimbals, spacecraft.fixed_boresights)
    table = state_margins(rows, sights, np.asarray(attitude), np.asarray(joints))
    worst = np.min(table, axis=-1, initial=np.inf)
    leaders = np.flatnonzero(~(best_entries(rows, worst) >= -ROUNDING))
    if not len(leaders):
        return
    beams = [f"the beam of {name}" for name in spacecraft.device_names]
    axes = [*beams, *called[len(beams) :]]
    chosen = chosen_entries(rows, worst)
    for leader in leaders:
        row = int(np.argmin(np.where(rows.entry == chosen[leader], worst, np.inf)))
        sight = int(np.argmin(table[row]))
        zone = zones[row]
        name = zone.name if zone.any_of is None else f"{zone.name}, the nearest of group {zone.any_of}"
        overlap = f"{np.rad2deg(-worst[row]):.4g} deg"
        yield f"{called[sight]} is {overlap} {_where(rows, row, zone, name, axes)}"


def _where(rows: Constraints, row: int, zone: Zone, name: str, axes: Sequence[str]) -> str:
    """The end of a sentence on a sight that breaks a row, such as "inside keep-out zone sun".

    Args:
        rows: the constraints.
        row: number of the row.
        zone: that the row is of.
        name: the zone's, as the sentence has it.
        axes: (S,) the sights' names as axes of cones.
    """
    if rows.frame[row] == JOINTS:
        return f"{'inside' if isinstance(zone, Mask) else 'beyond joint bound'} {name}"
    inside = isinstance(zone, KeepIn)
    side = "outside keep-in" if inside else "inside keep-out"
    if isinstance(zone, KeepOut | KeepIn) and zone.of_field:
        side = "short of keep-in" if inside else "too close to keep-out"
    if rows.frame[row] == INERTIAL:
        return f"{side} zone {name}"
    if rows.frame[row] == SIGHT:
        return f"{side} cone {name}, about {axes[rows.partner[row]]}"
    return f"{side} cone {name}, about {body_axis_name(rows.axis[row])}"
