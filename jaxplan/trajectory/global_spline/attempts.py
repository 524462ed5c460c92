"""Looking for one curve that does: attempts with more intervals, wider tubes and longer times, one by one."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from jaxplan.trajectory.asking import Steps
from jaxplan.trajectory.global_spline.job import Attempt, Job, attempt_at, ladder
from jaxplan.trajectory.global_spline.timing import Pace
from jaxplan.trajectory.scaling import peaks

BEGIN = 1.01  # of the duration of a trapezoid, whose accelerations jump
TIGHTER = (1e-3, 1e-2)  # shares of the limits left to what is between places, first and then
LONGER = 1.02  # from one duration to the next, when one is looked for that is long enough
LOOKS = 8
_SLOW = 2.0  # times the bound: beyond, corners of the path may be what takes long, and a tube keeps them
_DETOUR = 1.1  # of the bound, beyond which a motion is worth a second look
_HURRY = 0.97  # of the time along the nodes, below which they are only a first guess
_LEISURE = 1.15  # of that time; with less, breaks lie close about the flanks
_HOPELESS = 1.05  # of the duration is missing: not for want of intervals


def best_at(job: Job, duration: float, radius: float) -> Steps[Attempt | None]:
    """The first sound attempt within all limits, or the one nearest to it; None beyond every chart."""
    full_speed = job.quickest()
    pace = Pace.within(duration, full_speed.length, job.rise)
    hurry = duration / full_speed.duration

    def attempt(finer: int, wide: float) -> Steps[Attempt | None]:
        request = job.request(pace, wide, finer, graded=hurry < _LEISURE)
        made = None
        for tighter in TIGHTER:
            again = yield from attempt_at(
                job, request, duration, limited=True, free_time=False, tighter=tighter
            )
            if again is None:
                break
            if made is None or again.merit > made.merit:
                made = again
            if not 1 < again.peaks.stretch <= 1 + tighter:  # else it is what happens between the places
                break
        return made

    in_time = job.at_speed or hurry >= _HURRY
    return (
        yield from _climb(
            ladder(radius, in_time=in_time),
            attempt,
            enough=lambda made: made.sound and made.kept,
            hopeless=lambda made: made.too_deep or made.peaks.stretch > _HOPELESS,
        )
    )


def along(job: Job, radius: float, *, shortest: bool) -> Steps[Attempt | None]:
    """The first sound attempt at the quickest pace, or the one nearest to it; None beyond every chart.

    Args:
        job: what is fitted.
        radius: rad, of the tube.
        shortest: whether the shortest motion within all limits is looked for; else one without limits, to be
            stretched to them.
    """
    pace = job.quickest()

    def attempt(finer: int, wide: float) -> Steps[Attempt | None]:
        request = job.request(pace, wide, finer, graded=True)
        return (
            yield from attempt_at(job, request, BEGIN * pace.duration, limited=shortest, free_time=shortest)
        )

    return (
        yield from _climb(
            ladder(radius), attempt, enough=lambda made: made.sound, hopeless=lambda made: made.too_deep
        )
    )


def shortest(job: Job, radius: float) -> Steps[Attempt | None]:
    """The shortest motion within all limits, or the one nearest to it; None beyond every chart."""
    return (yield from (along(job, radius, shortest=True) if job.at_speed else _quickest(job, radius)))


def stretched(job: Job, radius: float) -> Steps[Attempt | None]:
    """A motion without limits, to be stretched to them; None beyond every chart."""
    best = yield from along(job, radius, shortest=False)
    if best is not None and best.sound and best.needed > _SLOW * job.bound and job.settings.node_tube is None:
        guided = yield from along(job, np.inf, shortest=False)
        if guided is not None and guided.sound and guided.needed < best.needed:
            best = guided
    return best


def released(job: Job, attempt: Attempt) -> Steps[Attempt | None]:
    """What the shortest motion with accelerations of zero at both ends becomes once they are free.

    Found from the path itself the one with free ones may be the longer one: it begins farther away, since
    close to a path such accelerations are large, and may end in another local minimum.
    """
    return (
        yield from attempt_at(
            job,
            replace(attempt.request, rest=False),
            attempt.point.duration,
            limited=True,
            free_time=True,
            begin=attempt.point.coefficients,
        )
    )


def _quickest(job: Job, radius: float) -> Steps[Attempt | None]:
    """The shortest motion, or where that is far above the bound perhaps one without limits, stretched."""
    best = yield from along(job, radius, shortest=True)
    if best is None or (best.sound and best.needed <= _DETOUR * job.bound):
        return best
    other = yield from along(job, min(radius, job.radius(free_time=False)), shortest=False)
    if other is None or not other.sound or (best.sound and best.needed <= other.needed):
        return best
    return other


def hurried(job: Job, attempt: Attempt, duration: float) -> Attempt:
    """The same motion in another duration."""
    curve = attempt.trajectory.scaled(duration / attempt.trajectory.duration)
    for breaks in (curve.breaks, curve.joint_breaks):  # new arrays
        breaks[-1] = duration  # to the last bit
    return replace(attempt, trajectory=curve, peaks=peaks(curve, job.spacecraft))


def enough_time(job: Job, needed: float) -> Steps[float | None]:
    """A duration in which all limits are kept, from a first guess on; None if none is found."""
    for look in range(LOOKS):
        attempt = yield from best_at(job, needed, np.inf)
        if attempt is not None and attempt.kept:
            return needed
        needed *= LONGER ** (2**look)
    return None


def _climb(
    rungs: Iterable[tuple[int, float]],
    attempt: Callable[[int, float], Steps[Attempt | None]],
    enough: Callable[[Attempt], bool],
    hopeless: Callable[[Attempt], bool],
) -> Steps[Attempt | None]:
    """The best attempt on the rungs of a ladder, up to the first that is enough or beyond the chart.

    After a hopeless one more intervals are not tried.
    """
    best, last = None, None
    for finer, wide in rungs:
        if last is not None and finer > 1 and hopeless(last):
            continue
        last = yield from attempt(finer, wide)
        if last is None:
            break
        if best is None or last.merit > best.merit:
            best = last
        if enough(last):
            break
    return best
