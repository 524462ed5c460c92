"""Proof, before a table is written, that it keeps zones, ranges and rates when readers interpolate it.

By how much it may fall short without being refused is the rule of `jaxplan.tables.tolerances`, which is also
that of checks of tables.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jaxplan.exporting.flight import Day, UncertifiedError, scene_of
from jaxplan.exporting.instants import chosen_instants, sparsest_instants
from jaxplan.exporting.sampled import Sampling
from jaxplan.geometry import quaternion
from jaxplan.planner import Plan
from jaxplan.tables import AttitudeTable
from jaxplan.tables.proof import certify_rows
from jaxplan.tables.table import RODRIGUES
from jaxplan.tables.tolerances import Forgiven

SPARSEST = "sparsest"
"""The step of a table with the fewest rows."""
SPARSEST_DEG = 0.05
"""deg: by which such a table may be off the motion, unless told."""
_MOST_HALVINGS = 12  # tolerances tried for a sparse table, each half of the one before
_ROWS_PER_BATCH = 2_000  # rows that are proved at once
_MOST_ROWS = 200_000  # that are proved; with more, rows are too close for interpolation to matter


class Readings(NamedTuple):
    """How readers of a table interpolate between its rows, by names of `jaxplan.tables.INTERPOLATIONS`.

    Attributes:
        usual: what most do.
        other: what some do, with which margins and ranges must hold, too; None where all do the same.
    """

    usual: str
    other: str | None = None


def rows_of(sampling: Sampling, first: int, last: int, interpolation: str) -> AttitudeTable:
    """Return rows `first` to `last` of a motion as a table; it has joints even where the format has none."""
    values = sampling.flight.trajectory.sample(sampling.times[first : last + 1])
    names = sampling.spacecraft.joint_names
    return AttitudeTable(
        times=sampling.times[first : last + 1],
        quaternions=np.asarray(quaternion.from_matrix(values.attitude)),
        angular_velocity=values.angular_velocity,
        joints=values.joints if names else None,
        joint_rates=values.joint_rates if names else None,
        joint_names=names,
        spacecraft=sampling.spacecraft,
        interpolation=interpolation,
        name=f"the table of {sampling.flight.name}",
    )


def broken_by(plan: Plan | Day, sampling: Sampling, how: Readings, forgives: Forgiven) -> tuple[str, ...]:
    """Find what a table breaks, by more than is forgiven, when readers interpolate it.

    Args:
        plan: the plan or day, with its scene.
        sampling: the motion's sampling, with the table's instants.
        how: what readers do.
        forgives: by how much the table may fall short.

    Returns:
        Sentences on the first stretch of rows that breaks something; empty if all hold.
    """
    scene, last = scene_of(plan), len(sampling.times) - 1
    for first in range(0, last, _ROWS_PER_BATCH):
        rows, usual = rows_of(sampling, first, min(first + _ROWS_PER_BATCH, last), how.usual), how.usual
        proof = certify_rows(rows, usual, scene, float(rows.times[0]), forgives, other=how.other)
        if proof.faults:
            return proof.faults
    return ()


def expect_held(plan: Plan | Day, sampling: Sampling, how: Readings, format: str, forgives: Forgiven) -> None:
    """Refuse a table that breaks something when readers interpolate it; arguments as of `broken_by`.

    Tables of more than `_MOST_ROWS` are not checked.

    Raises:
        UncertifiedError: with what breaks, when, and what to do.
    """
    if len(sampling.times) > _MOST_ROWS:
        return
    faults = broken_by(plan, sampling, how, forgives)
    if faults:
        raise UncertifiedError(
            f"a table of {len(sampling.times)} rows does not hold as readers of format {format} fly it, with "
            f"{how.usual.replace('_', ' ')} between rows: {'; '.join(faults)}. Forgiven is "
            f"{forgives.words}. Take a smaller step_s (--step) or tolerance_deg (--tolerance), or format c "
            "or json, which hold the polynomials"
        )


def sparsest(
    plan: Plan | Day, sampling: Sampling, how: Readings, tolerance: float, forgives: Forgiven
) -> Sampling:
    """Return a sampling with few rows that is near the motion and holds when readers interpolate it.

    For a single manoeuvre, as few as `sparsest_instants` finds; for a day, those of `chosen_instants`.

    Args:
        plan: the plan or day, with its scene.
        sampling: the motion's sampling; its instants are not used.
        how: what readers do.
        tolerance: rad, by which attitude, devices and joints may be off the motion; it is halved until all
            holds.
        forgives: by how much the table may fall short.

    Raises:
        UncertifiedError: if no table holds.
    """
    flight = sampling.flight
    faults: tuple[str, ...] = ()
    choose = chosen_instants if flight.segments else sparsest_instants
    for halving in range(_MOST_HALVINGS):
        near = tolerance / 2**halving
        times = choose(flight, near, rodrigues=how.usual == RODRIGUES)
        found = replace(sampling, times=times, tolerance=near)
        faults = broken_by(plan, found, how, forgives)
        if not faults:
            return found
    raise UncertifiedError(f"no table of {flight.name} holds, however close its rows: {'; '.join(faults)}")
