"""Make the result of a fit from its best attempt: the trajectory, the status, and the message to the user.

Some fits fail because a wheel is full however slow the motion; messages name the wheel, the place, and how
full it is. The momentum that wheels hold while the body rests at an attitude is the total momentum, seen from
the body, and does not depend on the duration (`jaxplan.model.wheels`). Where that alone is at a wheel's
limit, or beyond it, slowing down does not help. The *rows* of an array are its wheels or, with the allocation
"minimax", pairs of wheels.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jax.typing import ArrayLike

from jaxplan.model.duration_bound import excess
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.scenario import LONGEST_DURATION
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.model.wheels import MINIMAX, WheelArray, row_names
from jaxplan.trajectory.active_set import FitRecord
from jaxplan.trajectory.chart import CHART_REACH
from jaxplan.trajectory.curve import Trajectory, total_momentum
from jaxplan.trajectory.curve_attempts import Attempt
from jaxplan.trajectory.fit import Fit, FitQuery, needed_words, too_tight
from jaxplan.trajectory.peaks import SAFETY, peaks
from jaxplan.trajectory.problem import FitProblem

NOT_OPTIMAL = "it is not the optimum: near the fit none was found that keeps all limits and can be certified"
_FULL_TOLERANCE = 1e-6  # of a wheel's limit, by which it may be exceeded at the goal
_TORQUE_POWER = 2  # of the time scaling by which torques and accelerations fall
_SAMPLE_COUNT = 2001  # samples of a motion from which the numbers in messages are taken, with few digits
_MIN_BODY_MOMENTUM = 1e-9  # of a wheel's limit; smaller momentum of the body at the start counts as none
_STORED_ADVICE = "lower spacecraft.wheel.stored_nms, raise momentum_nms, or change the goal"
_IN_MOTION_ADVICE = (
    "check spacecraft.inertia_kg_m2, lower the rates at the start or spacecraft.wheel.stored_nms, raise "
    "momentum_nms, or change the goal"
)
_RATES_ADVICE = (
    "lower the rates at start and end; where these are those of targets that move, meet them at another "
    "time, by a number for trajectory.duration_s"
)


def better(fit: Fit, other: Fit) -> Fit:
    """Return the better of two fits: the one that succeeded or, if both or none did, the one that is faster.

    Of failed fits the one with a trajectory is preferred, then the one that needs less time.
    """

    def key(one: Fit) -> tuple[bool, bool, float]:
        found, curve = one.status is Status.OK, one.trajectory
        time = curve.duration if found and curve is not None else one.needed_duration
        return not found, curve is None, np.inf if time is None else time

    return min(fit, other, key=key)


def success(attempt: Attempt, *, stretch: bool = False) -> Fit:
    """Make the fit of an attempt within all limits on rates and loads.

    Where the settings ask for the optimum and that is sound, too, it is the optimum near the attempt;
    otherwise a note says that it is not. Its status is UNCERTIFIED if it breaks a zone or a joint's range.

    Args:
        attempt: the best one.
        stretch: whether its time is first scaled, so that it just keeps all limits.
    """
    found = _fit_of_attempt(attempt, stretch=stretch)
    if not attempt.problem.settings.optimal or found.origin is None:
        return found
    notes = "; ".join(filter(None, (found.note, NOT_OPTIMAL)))
    spare = replace(found, message=f"{found.message}; {NOT_OPTIMAL}", note=notes)
    best = found.origin.at_optimum()
    if best is None or not best.sound or not (stretch or best.kept):
        return spare
    return replace(_fit_of_attempt(best, stretch=stretch), spare=spare)


def _fit_of_attempt(attempt: Attempt, *, stretch: bool) -> Fit:
    """The fit with an attempt's curve: OK, or UNCERTIFIED if it breaks a zone or a joint's range."""
    curve, problem = attempt.trajectory, attempt.problem
    if stretch:
        curve = curve.scaled(attempt.peaks.stretch * SAFETY)
    broken = None
    if attempt.breach is not None:
        device, depth = attempt.breach
        broken = f"{device} breaks a zone by {np.rad2deg(depth):.2f} deg", "a larger search.clearance_deg"
    elif not attempt.peaks.in_range:
        broken = "a joint leaves its range", "start and goal farther inside, or lower joint rates there"
    if broken is not None:
        message = f"{broken[0]}, and no curve near the path was found that does not: try {broken[1]}"
        return Fit(trajectory=curve, status=Status.UNCERTIFIED, message=message)
    nearest = attempt.peaks.names[attempt.peaks.binding]
    share = excess(curve.duration, problem.bound)
    above = "" if share is None else f", {100 * share:.1f} % above the strict bound"
    message, note = f"{curve.duration:.2f} s{above}; {nearest} is nearest to its limit", ""
    if attempt.radius > problem.radius:
        how = "the path is only a first guess of the motion"
        if np.isfinite(attempt.radius):
            how = f"the motion is up to {np.rad2deg(attempt.radius):g} deg off the nodes of its path"
        tube = f"trajectory.node_tube_deg = {np.rad2deg(problem.radius):g}"
        note = f"{how}, since within {tube} of the nodes none was found, or a slow one"
        message = f"{message}; {note}"
    origin = FitRecord(problem=problem, attempt=attempt, stretched=stretch)
    return Fit(trajectory=curve, status=Status.OK, message=message, note=note, origin=origin)


def limits_too_tight(
    closest: Attempt, duration: float, needed: float | None, shorter: float | None = None
) -> Fit:
    """Make the fit, LIMITS_TOO_TIGHT, of an attempt that breaks a limit.

    Args:
        closest: the attempt that comes nearest to keeping the limits.
        duration: the one asked for, s.
        needed: duration in which all limits are kept, s; None if none was found.
        shorter: a duration below the one asked for in which they are, s; None if none is known.
    """
    problem, enough = closest.problem, None
    if needed is None and np.isinf(closest.peaks.stretch):
        return full_on_the_way(closest.trajectory, problem.spacecraft)
    if shorter is not None:
        enough = f'there is a motion in {shorter:.2f} s: set trajectory.duration_s to "minimum"'
    elif needed is not None:
        enough = needed_words(needed, moving=problem.horizon > 0, scalable=True)
    else_try = _RATES_ADVICE if problem.at_speed else 'set it to "minimum"'
    return Fit(
        trajectory=closest.trajectory,
        status=Status.LIMITS_TOO_TIGHT,
        message=too_tight(duration, closest.peaks, enough, else_try),
        needed_duration=needed,
    )


def beyond_charts() -> Fit:
    """Make the fit, INFEASIBLE, of a path with a node too far from the steady rotation in every chart."""
    message = (
        f"the nodes lie more than {np.rad2deg(CHART_REACH):.0f} deg off the steady rotation "
        'from start to goal: set trajectory.method to "paper"'
    )
    return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)


def full_at_goal(problem: FitProblem) -> Fit | None:
    """Make the fit, LIMITS_TOO_TIGHT, of wheels that cannot hold what the goal leaves them; else None.

    It follows from the ends alone, in whatever way and time the goal is reached; the fit has no trajectory.
    """
    array, body = problem.spacecraft.wheel_array, problem.body
    if array is None:
        return None
    held = np.abs(_motion_at_end(problem, 1).wheel_momenta)
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


def overloaded_at_an_end(problem: FitProblem) -> Fit | None:
    """Make the fit, LIMITS_TOO_TIGHT, of rates at an end that need more torque than there is; else None.

    A body that turns without acceleration needs torque that turns its momentum, and that of its wheels, with
    it. Where accelerations at the ends are zero it follows from the rates alone; the fit has no trajectory.
    """
    if not (problem.rests and problem.at_speed):
        return None
    for end, place in enumerate(("start", "goal")):
        motion = _motion_at_end(problem, end)
        loads = [limit for limit in problem.limits if limit.quantity.power == _TORQUE_POWER]
        shares = {
            name: float(share)
            for limit in loads
            for name, share in zip(limit.names, limit.shares(motion), strict=True)
        }
        name = max(shares, key=shares.__getitem__, default="")
        if shares and shares[name] > 1 + _FULL_TOLERANCE:
            more = "spacecraft.wheel.stored_nms, or raise torque_nms" if motion.array else "raise that limit"
            advice = f"lower the rates at the {place}, or {more}"
            if end and problem.horizon > 0:  # then the rates are those of targets at that time
                advice = _RATES_ADVICE
            message = (
                f"at the {place} the rates alone need {shares[name]:.4g} times the limit of {name}, in "
                f"whatever time the motion is made, as the momentum there turns with the body: {advice}"
            )
            return Fit(trajectory=None, status=Status.LIMITS_TOO_TIGHT, message=message, short_of="torque")
    return None


def full_at_rest(problem: FitProblem) -> Fit | None:
    """Make the fit, LIMITS_TOO_TIGHT, of wheels that leave a body at rest next to no momentum; else None.

    They are full at the start or the goal while the body rests, and every motion is longer than
    `LONGEST_DURATION` by its lower bound. The fit has no trajectory.
    """
    array = problem.body.array
    if array is None or not problem.bound > LONGEST_DURATION:
        return None
    held = np.stack([np.abs(_motion_at_end(problem, end).resting_momenta) for end in (0, 1)], axis=1)
    if not np.any(held > (1 - _FULL_TOLERANCE) * array.momentum[:, None]):
        return None
    phrases = _describe_fullest(problem.spacecraft, held, ["at the start", "at the goal"])
    carried = problem.body.total - array.stored
    return _make_full_wheels_fit(None, f"while the body rests, {phrases}", carried, array)


def within_longest(fit: Fit, query: FitQuery) -> Fit:
    """Return a fit, or one that is LIMITS_TOO_TIGHT where its motion is longer than `LONGEST_DURATION`.

    Neither a duration in a scenario nor a plan's file can be as long.
    """
    curve = fit.trajectory
    if max(0.0 if curve is None else curve.duration, fit.needed_duration or 0.0) <= LONGEST_DURATION:
        return fit
    if fit.short_of or curve is None:
        return replace(fit, trajectory=None)
    found = peaks(curve, query.spacecraft)
    message = (
        f"within the limit of {found.names[found.binding]} the motion takes more than "
        f"{int(LONGEST_DURATION):,} s, the most that trajectory.duration_s may be: raise that limit"
    )
    return Fit(trajectory=None, status=Status.LIMITS_TOO_TIGHT, message=message)


def _motion_at_end(problem: FitProblem, end: int) -> Kinematics:
    """The motion at the start (`end` 0) or the goal (1) of a problem, with accelerations of zero."""
    body = problem.body
    attitude, joints, rates = (own[-end] for own in (problem.attitudes, problem.joints, problem.rates))
    return Kinematics(
        spin=(rates[:3], np.zeros(3), np.zeros(3)),
        joints=(joints, rates[3:], np.zeros(len(joints))),
        drives=len(problem.spacecraft.drives),
        inertia=body.inertia,
        total=None if body.total is None else attitude.T @ problem.attitudes[0] @ body.total,
        array=body.array,
        stages=body.stages,
    ).known


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
    turns = np.trace(samples.attitude[0].T @ samples.attitude, axis1=1, axis2=2)
    angles = np.rad2deg(np.arccos(np.clip((turns - 1) / 2, -1, 1)))
    where = ["at the start", *(f"with the body turned by {angle:.3g} deg" for angle in angles[1:])]
    phrases = _describe_fullest(craft, held, where)
    carried = samples.attitude[0].T @ total - array.stored
    return _make_full_wheels_fit(trajectory, f"turned about slowly, {phrases}", carried, array)


def _describe_fullest(craft: Spacecraft, held: np.ndarray, where: Sequence[str]) -> str:
    """Return text on the wheels of a spacecraft that are full, or on the fullest one.

    Args:
        craft: a spacecraft with wheels.
        held: (r, k) N m s, what they hold at k places while the body rests, without signs.
        where: (k,) words on the places.
    """
    array, phrases = craft.wheel_array, list[str]()
    assert array is not None
    shares = held / array.momentum[:, None]
    for row, owner in _choose_rows_to_report(craft, shares.max(axis=1), 1 - _FULL_TOLERANCE):
        most = int(np.argmax(shares[row]))
        beyond = "" if shares[row, most] > 1 + _FULL_TOLERANCE else ", to which turning adds"
        phrase = f"{owner} would hold {held[row, most]:.4g} N m s {where[most]}"
        phrases.append(f"{phrase}, of {array.momentum[row]:.4g} N m s at most{beyond}")
    return ", and ".join(phrases)


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
    return Fit(trajectory=trajectory, status=Status.LIMITS_TOO_TIGHT, message=message, short_of="momentum")
