"""Fits that wheels do not let be, however slow the motion: which of them is full, where, and how full.

What wheels hold while the body rests at an attitude is the total momentum, seen from the body, and depends on
no duration (`jaxplan.model.wheels`). Where that alone is at a wheel's limit, or beyond it, slowing down does
not help.
"""

from collections.abc import Sequence

import numpy as np

from jaxplan.model.kinematics import Kinematics
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.model.wheels import MINIMAX, row_names
from jaxplan.trajectory.curve import Trajectory, total_momentum
from jaxplan.trajectory.fit import Fit
from jaxplan.trajectory.problem import FitProblem

_FULL = 1e-6  # of a wheel's limit, by which it may be beyond it at the goal
_SAMPLES = 2001  # of a motion on which wheels are looked at, of which numbers with few digits are told
_ADVICE = (
    "so that slowing down does not help: lower spacecraft.wheel.stored_nms, raise momentum_nms, or change "
    "the goal"
)


def full_at_goal(problem: FitProblem) -> Fit | None:
    """The fit, LIMITS_TOO_TIGHT, of wheels that cannot hold what the goal leaves them; None if they can.

    It follows from the ends alone, whichever way the goal is reached and in whatever time.
    """
    array, body = problem.spacecraft.wheel_array, problem.body
    if array is None:
        return None
    total = problem.attitudes[-1].T @ problem.attitudes[0] @ body.total
    motion = Kinematics(spin=(problem.rates[1, :3],), inertia=body.inertia, total=total, array=array)
    held = np.abs(motion.wheel_momenta)
    shares = held / array.momentum
    if not np.any(shares > 1 + _FULL):
        return None
    phrases = [
        f"{owner} would hold {held[row]:.4g} N m s, of {array.momentum[row]:.4g} N m s at most"
        for row, owner in _told(problem.spacecraft, shares, 1 + _FULL)
    ]
    return _refused(None, f"at the goal, however slowly it is reached, {' and '.join(phrases)}")


def full_on_the_way(trajectory: Trajectory, craft: Spacecraft) -> Fit:
    """The fit, LIMITS_TOO_TIGHT, of a motion that fills wheels of a spacecraft however slow it is."""
    array, total = craft.wheel_array, total_momentum(trajectory, craft)
    if array is None or total is None:
        raise ValueError("without wheels none is full")
    samples = trajectory.sample(np.linspace(0, trajectory.duration, _SAMPLES))
    held = np.abs(samples.kinematics(craft, total).resting_momenta)
    shares = held / array.momentum[:, None]
    phrases = []
    for row, owner in _told(craft, shares.max(axis=1), 1 - _FULL):
        most = int(np.argmax(shares[row]))
        turn = samples.attitude[0].T @ samples.attitude[most]
        angle = np.rad2deg(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
        where = "at the start" if most == 0 else f"with the body turned by {angle:.3g} deg"
        phrase = f"{owner} would hold {held[row, most]:.4g} N m s {where}"
        beyond = "" if shares[row, most] > 1 + _FULL else ", to which turning adds"
        phrases.append(f"{phrase}, of {array.momentum[row]:.4g} N m s at most{beyond}")
    return _refused(trajectory, f"turned about slowly, {' and '.join(phrases)}")


def _told(craft: Spacecraft, shares: np.ndarray, most: float) -> Sequence[tuple[int, str]]:
    """Rows whose shares (r,) are above `most`, or the largest one if none is, with words for each.

    Of an array that shares out so that the largest share is least, the one with the largest share.
    """
    envelope = craft.allocation == MINIMAX
    rows = np.flatnonzero(shares > most)
    if envelope or not len(rows):
        rows = np.array([np.argmax(shares)])
    names = row_names(craft.wheels, craft.allocation)
    return [(row, f"the {names[row]}" if envelope else f'wheel "{names[row]}"') for row in rows.tolist()]


def _refused(trajectory: Trajectory | None, why: str) -> Fit:
    """The fit of wheels that are full, with a trajectory where there is one."""
    message = f"{why}, {_ADVICE}"
    return Fit(trajectory=trajectory, status=Status.LIMITS_TOO_TIGHT, message=message, full_wheels=True)
