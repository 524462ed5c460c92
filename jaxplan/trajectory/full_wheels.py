"""Fits that fail because a wheel is full however slow the motion: which wheel, where, and how full.

The momentum that wheels hold while the body rests at an attitude is the total momentum, seen from the body,
and does not depend on the duration (`jaxplan.model.wheels`). Where that alone is at a wheel's limit, or
beyond it, slowing down does not help. The *rows* of an array are its wheels or, with the allocation
"minimax", pairs of wheels.
"""

from collections.abc import Sequence

import numpy as np
from jax.typing import ArrayLike

from jaxplan.model.kinematics import Kinematics
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.model.wheels import MINIMAX, WheelArray, row_names
from jaxplan.trajectory.curve import Trajectory, total_momentum
from jaxplan.trajectory.fit import Fit
from jaxplan.trajectory.problem import FitProblem

_FULL_TOLERANCE = 1e-6  # of a wheel's limit, by which it may be exceeded at the goal
_SAMPLE_COUNT = 2001  # samples of a motion from which the numbers in messages are taken, with few digits
_MIN_BODY_MOMENTUM = 1e-9  # of a wheel's limit; smaller momentum of the body at the start counts as none
_STORED_ADVICE = "lower spacecraft.wheel.stored_nms, raise momentum_nms, or change the goal"
_IN_MOTION_ADVICE = (
    "check spacecraft.inertia_kg_m2, lower the rates at the start or spacecraft.wheel.stored_nms, raise "
    "momentum_nms, or change the goal"
)


def full_at_goal(problem: FitProblem) -> Fit | None:
    """Make the fit, LIMITS_TOO_TIGHT, of wheels that cannot hold what the goal leaves them; else None.

    It follows from the ends alone, in whatever way and time the goal is reached; the fit has no trajectory.
    """
    array, body = problem.spacecraft.wheel_array, problem.body
    if array is None:
        return None
    total = problem.attitudes[-1].T @ problem.attitudes[0] @ body.total
    motion = Kinematics(spin=(problem.rates[1, :3],), inertia=body.inertia, total=total, array=array)
    held = np.abs(motion.wheel_momenta)
    shares = held / array.momentum
    if not np.any(shares > 1 + _FULL_TOLERANCE):
        return None
    phrases = [
        f"{owner} would hold {held[row]:.4g} N m s, of {array.momentum[row]:.4g} N m s at most"
        for row, owner in _choose_rows_to_report(problem.spacecraft, shares, 1 + _FULL_TOLERANCE)
    ]
    carried = body.total - array.stored
    return _make_full_wheels_fit(
        None, f"at the goal, however slowly it is reached, {' and '.join(phrases)}", carried, array
    )


def full_on_the_way(trajectory: Trajectory, craft: Spacecraft) -> Fit:
    """Make the fit, LIMITS_TOO_TIGHT, of a motion that fills wheels of a spacecraft however slow it is.

    Raises:
        ValueError: if the spacecraft has no wheels.
    """
    array, total = craft.wheel_array, total_momentum(trajectory, craft)
    if array is None or total is None:
        raise ValueError("without wheels none is full")
    samples = trajectory.sample(np.linspace(0, trajectory.duration, _SAMPLE_COUNT))
    held = np.abs(samples.kinematics(craft, total).resting_momenta)
    shares = held / array.momentum[:, None]
    phrases = []
    for row, owner in _choose_rows_to_report(craft, shares.max(axis=1), 1 - _FULL_TOLERANCE):
        most = int(np.argmax(shares[row]))
        turn = samples.attitude[0].T @ samples.attitude[most]
        angle = np.rad2deg(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
        where = "at the start" if most == 0 else f"with the body turned by {angle:.3g} deg"
        phrase = f"{owner} would hold {held[row, most]:.4g} N m s {where}"
        beyond = "" if shares[row, most] > 1 + _FULL_TOLERANCE else ", to which turning adds"
        phrases.append(f"{phrase}, of {array.momentum[row]:.4g} N m s at most{beyond}")
    carried = samples.attitude[0].T @ total - array.stored
    return _make_full_wheels_fit(trajectory, f"turned about slowly, {' and '.join(phrases)}", carried, array)


def _choose_rows_to_report(craft: Spacecraft, shares: np.ndarray, most: float) -> Sequence[tuple[int, str]]:
    """Choose the rows of the wheel array to report, and a phrase that names each.

    They are those whose fractions `shares` (r,) of their limits exceed `most`, or the largest one if none
    does. Of an array with the allocation "minimax" it is always the largest one alone.
    """
    envelope = craft.allocation == MINIMAX
    rows = np.flatnonzero(shares > most)
    if envelope or not len(rows):
        rows = np.array([np.argmax(shares)])
    names = row_names(craft.wheels, craft.allocation)
    return [(row, f"the {names[row]}" if envelope else f'wheel "{names[row]}"') for row in rows.tolist()]


def _make_full_wheels_fit(
    trajectory: Trajectory | None, why: str, carried: ArrayLike, array: WheelArray
) -> Fit:
    """Make the fit for wheels that are full.

    Args:
        trajectory: of the motion; None if there is none.
        why: which wheels are full, and by how much.
        carried: (3,) N m s, momentum of the body and its stages at the start, without what wheels store.
        array: the wheels.
    """
    share, advice = float(np.linalg.norm(carried)), _STORED_ADVICE
    if share > _MIN_BODY_MOMENTUM * float(np.max(array.momentum)):
        stored = float(np.linalg.norm(array.stored))
        why = (
            f"{why}; all that they hold is what is there at the start, {share:.4g} N m s by "
            f"spacecraft.inertia_kg_m2 and the rates of [start], and {stored:.4g} N m s that they store"
        )
        advice = _IN_MOTION_ADVICE
    message = f"{why}, so that slowing down does not help: {advice}"
    return Fit(trajectory=trajectory, status=Status.LIMITS_TOO_TIGHT, message=message, full_wheels=True)
