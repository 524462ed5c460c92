"""The strategy of the spline fit: which durations, intervals and tubes are tried, and which curve is taken.

It settles many fits at once. They go by numbers: a function takes systems by number and answers by number,
and what is asked for at the same time is made together. A fit is looked for on a `Ladder` of attempts; what
is tried on which ladder, and what is made of the best attempt, depends on the duration that is asked for:

    a number      `Strategy.timed`: a curve in that time, or else the shortest one, which says what is needed
    "stretched"   `Strategy.stretched`: a curve without limits, then slowed until the first limit binds
    "minimum"     `Strategy.shortest`: the shortest curve within all limits

Where a limit, a zone or the tube is broken more intervals are tried, then a wider tube, then none.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.model.scenario import MINIMUM, STRETCHED
from jaxplan.model.status import Status
from jaxplan.model.zones import tabulate
from jaxplan.runtime.batching import Seconds
from jaxplan.trajectory import options, schedule
from jaxplan.trajectory.attempts import (
    Attempt,
    Ladder,
    make_attempts,
    rungs,
)
from jaxplan.trajectory.fit import Fit, FitQuery, at_rest, boundary, checked
from jaxplan.trajectory.outcome import better, beyond_charts, limits_too_tight, success
from jaxplan.trajectory.peaks import SAFETY, peaks
from jaxplan.trajectory.problem import AttemptRequest, FitProblem
from jaxplan.trajectory.schedule import TrapezoidalProfile
from jaxplan.trajectory.splines import DEGREE, SMOOTHNESS

Attempts = dict[int, Attempt | None]  # by fit; None beyond every chart


def fit(queries: Sequence[FitQuery], seconds: Seconds | None = None) -> list[Fit]:
    """Fits one spline of degree 5, platform and joints together, to each of many paths.

    It has four continuous derivatives and least energy (rate, acceleration and jerk with the settings'
    weights) among those that pass the nodes within the tube, keep all limits and stay clear of the zones. The
    nodes are passed at the pace of a trapezoid. A number for ``settings.duration`` is kept. "stretched" fits
    at the quickest pace without limits and scales the time until the first limit binds; unless the settings
    give a tube, it leaves the nodes where that takes twice the bound and a motion without them is quicker.
    "minimum" looks for the shortest duration within all limits and zones; the nodes are then only a first
    guess, unless the settings give a tube. With a rate at the start or end, "stretched" is the same with the
    tube.

    Args:
        queries: one a fit.
        seconds: of the fits, to which the time of each is added.

    Returns:
        The fits; of one that is OK, zones are kept at the places that were looked at, and the certificate has
        the last word on them. UNCERTIFIED where one is broken there.

    Raises:
        ValueError: if settings, costs, fractions or rates make no sense; the message names which.
    """
    strategy = Strategy(Seconds(len(queries)) if seconds is None else seconds)
    begun = [_begin(query) for query in queries]
    problems = {number: one[0] for number, one in enumerate(begun) if not isinstance(one, Fit)}
    numbers = {number: one[1] for number, one in enumerate(begun) if not isinstance(one, Fit)}
    fits = {number: one for number, one in enumerate(begun) if isinstance(one, Fit)}
    for number, found in strategy.fits(problems).items():
        fits[number] = found.at_given_nodes(numbers[number])
    return [fits[number] for number in range(len(queries))]


def _begin(query: FitQuery) -> Fit | tuple[FitProblem, np.ndarray]:
    """What is fitted, and for each given node its number there; the fit itself where nothing moves."""
    spacecraft, settings, fractions = query.spacecraft, query.settings, query.node_fractions
    path = checked(query.path, spacecraft, settings, fractions)
    joints = path.joints.shape[1]
    ends = (
        (query.start_angular_velocity, query.start_joint_rates),
        (query.end_angular_velocity, query.end_joint_rates),
    )
    rates = np.stack([np.append(boundary(own, 3)[0], boundary(other, joints)[0]) for own, other in ends])
    limits = np.concatenate([np.full(3, spacecraft.rate_limit), spacecraft.joint_rate_limits])
    worst = np.unravel_index(np.argmax(np.abs(rates) / limits), rates.shape)
    if not np.abs(rates[worst]) <= (1 + options.ACCEPTANCE.rate_rounding) * limits[worst[1]]:
        raise ValueError(
            f"a rate at the {('start', 'end')[worst[0]]} is {rates[worst]:g} rad/s: "
            f"must be at most {limits[worst[1]]:g}"
        )
    if not (np.all(np.isfinite(path.attitudes)) and np.all(np.isfinite(path.joints))):
        message = "a node of the path is not made of finite numbers"
        return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
    path, own = schedule.passed_nodes(path, at_speed=bool(np.any(rates)), every=fractions is not None)
    if len(path.attitudes) == 1:
        still = replace(at_rest(query, path, DEGREE, "global", len(own)), smoothness=SMOOTHNESS)
        return Fit(trajectory=still, status=Status.OK, message="the path has no motion")
    problem = FitProblem(
        attitudes=path.attitudes,
        joints=path.joints,
        turns=schedule.edge_turns(path.attitudes),
        fractions=None if fractions is None else np.asarray(fractions, float),
        rates=rates,
        spacecraft=spacecraft,
        cones=tabulate((), (), spacecraft.device_names) if query.cones is None else query.cones,
        settings=settings,
        horizon=query.horizon,
    )
    return problem, own


class Strategy:
    """Settles many fits; see the module.

    Attributes:
        seconds: of the fits, to which the time of attempts is added.
    """

    def __init__(self, seconds: Seconds) -> None:
        self.seconds = seconds

    def fits(self, problems: dict[int, FitProblem]) -> dict[int, Fit]:
        """The fits in the durations that the settings ask for.

        What keeps everything with accelerations of zero at both ends does so where they are free. So a motion
        with free ones is never longer, nor is none found where there is one with zero.
        """
        timed = {
            n: problem for n, problem in problems.items() if not isinstance(problem.settings.duration, str)
        }
        others = {n: problem for n, problem in problems.items() if n not in timed}
        return self._in_given_time(timed) | self._in_least_time(others)

    def _in_given_time(self, problems: dict[int, FitProblem]) -> dict[int, Fit]:
        fits = self.timed(problems)
        again = {
            n: problem.resting
            for n, problem in problems.items()
            if not problem.rests and fits[n].status is not Status.OK
        }
        for n, other in self.timed(again).items():
            fits[n] = better(fits[n], other)
        return fits

    def _in_least_time(self, problems: dict[int, FitProblem]) -> dict[int, Fit]:
        radii = {
            n: problem.radius(free_time=problem.settings.duration == MINIMUM)
            for n, problem in problems.items()
        }
        resting = {n: problem.resting for n, problem in problems.items()}
        best = self._quickest(resting, radii)
        fits = self._within_limits(resting, best, radii)
        free = {n: problem for n, problem in problems.items() if not problem.rests}
        shortened = {
            n: attempt
            for n, problem in free.items()
            if (attempt := best[n]) is not None and not _stretches(problem) and fits[n].status is Status.OK
        }
        found = self._released({n: (problems[n], attempt) for n, attempt in shortened.items()})
        found |= self._quickest({n: problem for n, problem in free.items() if n not in shortened}, radii)
        for n, other in self._within_limits(free, found, radii).items():
            fits[n] = better(other, fits[n])
        return fits

    def timed(self, problems: dict[int, FitProblem]) -> dict[int, Fit]:
        """Fits in given durations."""
        durations = {n: float(problem.settings.duration) for n, problem in problems.items()}
        radii = {n: problem.radius(free_time=False) for n, problem in problems.items()}
        possible = {n: problem for n, problem in problems.items() if durations[n] >= problem.bound}
        attempts = dict.fromkeys(problems) | self._in_time(possible, durations, radii)
        fits = {
            n: success(problems[n], attempt, radii[n])
            for n, attempt in attempts.items()
            if attempt is not None and attempt.peaks.stretch <= 1
        }
        # The shortest motion says whether there is one at all, and what to ask for.
        left = {n: problem for n, problem in problems.items() if n not in fits}
        best = self.shortest(left, dict.fromkeys(left, np.inf))
        fits |= {n: beyond_charts() for n, own in best.items() if own is None}
        quickest = {n: own for n, own in best.items() if own is not None}
        needed = self._needed({n: left[n] for n in quickest}, quickest, durations)
        for n, own in quickest.items():
            problem, duration, enough = left[n], durations[n], needed[n]
            if (
                not problem.at_speed and enough is not None and enough <= duration
            ):  # slowing it keeps all limits
                fits[n] = success(problem, time_scaled(problem, own, duration), radii[n])
            else:
                fits[n] = limits_too_tight(
                    problem, attempts[n] or time_scaled(problem, own, duration), duration, enough
                )
        return fits

    def _needed(
        self, problems: dict[int, FitProblem], quickest: dict[int, Attempt], durations: dict[int, float]
    ) -> dict[int, float | None]:
        """Durations in which all limits are kept, from the shortest motions; None where none is found."""
        found: dict[int, float | None] = {
            n: own.needed * SAFETY if own.sound else None for n, own in quickest.items()
        }
        open_ = {n: problem for n, problem in problems.items() if problem.at_speed}
        found |= dict.fromkeys(open_)
        longer = {
            n: max(
                options.STRATEGY.begin * quickest[n].trajectory.duration,
                options.STRATEGY.longer * durations[n],
            )
            for n in open_
        }
        for look in range(options.STRATEGY.looks):
            attempts = self._in_time(open_, longer, dict.fromkeys(open_, np.inf))
            found |= {n: longer[n] for n, own in attempts.items() if own is not None and own.kept}
            open_ = {n: problem for n, problem in open_.items() if found[n] is None}
            longer = {n: longer[n] * options.STRATEGY.longer ** (2**look) for n in open_}
        return found

    def _in_time(
        self, problems: dict[int, FitProblem], durations: dict[int, float], radii: dict[int, float]
    ) -> Attempts:
        """The first sound attempts within all limits, or the ones nearest to it, in given durations."""
        ladders = {}
        for n, problem in problems.items():
            full_speed = problem.quickest()
            hurry = durations[n] / full_speed.duration
            ladders[n] = Ladder(
                problem,
                TrapezoidalProfile.within(durations[n], full_speed.length, problem.rise),
                rungs(radii[n], in_time=problem.at_speed or hurry >= options.STRATEGY.hurry),
                duration=durations[n],
                graded=hurry < options.STRATEGY.leisure,
                limited=True,
                free_time=False,
                tighter=options.STRATEGY.tighter,
            )
        return self._climb(ladders)

    def _along(self, problems: dict[int, FitProblem], radii: dict[int, float], *, shortest: bool) -> Attempts:
        """The first sound attempts at the quickest pace, or the ones nearest to it.

        Args:
            problems: what is fitted.
            radii: rad, of the tubes.
            shortest: whether the shortest motion within all limits is looked for; else one without limits, to
                be stretched to them.
        """
        profiles = {n: problem.quickest() for n, problem in problems.items()}
        return self._climb(
            {
                n: Ladder(
                    problem,
                    profiles[n],
                    rungs(radii[n]),
                    duration=options.STRATEGY.begin * profiles[n].duration,
                    limited=shortest,
                    free_time=shortest,
                )
                for n, problem in problems.items()
            }
        )

    def _quickest(self, problems: dict[int, FitProblem], radii: dict[int, float]) -> Attempts:
        """Motions to be stretched to their limits, or the shortest ones, as the settings ask."""
        stretching = {n: problem for n, problem in problems.items() if _stretches(problem)}
        others = {n: problem for n, problem in problems.items() if n not in stretching}
        return self.stretched(stretching, radii) | self.shortest(others, radii)

    def stretched(self, problems: dict[int, FitProblem], radii: dict[int, float]) -> Attempts:
        """Motions without limits, to be stretched to them."""
        best = self._along(problems, radii, shortest=False)
        slow = {
            n: problem
            for n, problem in problems.items()
            if (own := best[n]) is not None
            and own.sound
            and own.needed > options.STRATEGY.slow * problem.bound
            and problem.settings.node_tube is None
        }
        guided = self._along(slow, dict.fromkeys(slow, np.inf), shortest=False)
        return best | _quicker(guided, best)

    def shortest(self, problems: dict[int, FitProblem], radii: dict[int, float]) -> Attempts:
        """The shortest motions within all limits, or the ones nearest to it.

        Where one from rest to rest is far above the bound, perhaps one without limits, stretched.
        """
        best = self._along(problems, radii, shortest=True)
        slow = {
            n: problem
            for n, problem in problems.items()
            if (own := best[n]) is not None
            and not problem.at_speed
            and not (own.sound and own.needed <= options.STRATEGY.detour * problem.bound)
        }
        tubes = {n: min(radii[n], problem.radius(free_time=False)) for n, problem in slow.items()}
        return best | _quicker(self._along(slow, tubes, shortest=False), best)

    def _released(self, given: dict[int, tuple[FitProblem, Attempt]]) -> Attempts:
        """What shortest motions with accelerations of zero at both ends become once they are free.

        Found from the path itself the one with free ones may be the longer one: it begins farther away, since
        close to a path such accelerations are large, and may end in another local minimum.
        """
        return self._attempts(
            {
                n: AttemptRequest(
                    problem=problem,
                    mesh=attempt.request.mesh,
                    duration=attempt.solution.duration,
                    limited=True,
                    free_time=True,
                    begin=attempt.solution.coefficients,
                )
                for n, (problem, attempt) in given.items()
            }
        )

    def _within_limits(
        self, problems: dict[int, FitProblem], attempts: Attempts, radii: dict[int, float]
    ) -> dict[int, Fit]:
        """Fits from motions in just the time that their limits allow."""
        best = {n: own for n, own in attempts.items() if own is not None}
        best |= self._slowed({n: problems[n] for n in best if problems[n].at_speed}, best)
        fits = {n: beyond_charts() for n, own in attempts.items() if own is None}
        for n, own in best.items():
            problem = problems[n]
            if not problem.at_speed:
                fits[n] = success(problem, own, radii[n], stretch=True)
            elif own.peaks.stretch <= 1:
                fits[n] = success(problem, own, radii[n])
            else:
                fits[n] = limits_too_tight(problem, own, own.trajectory.duration, None)
        return fits

    def _slowed(self, problems: dict[int, FitProblem], attempts: dict[int, Attempt]) -> dict[int, Attempt]:
        """Motions with rates at the ends in so much more time that they keep all limits.

        Scaling the time would change these rates: the curve is fitted again where it is too quick.
        """
        best = {n: attempts[n] for n in problems}
        durations = {n: own.trajectory.duration for n, own in best.items()}
        open_ = dict(problems)
        for look in range(options.STRATEGY.looks):
            open_ = {
                n: problem
                for n, problem in open_.items()
                if not (best[n].peaks.stretch <= 1 and best[n].sound)
            }
            requests = {}
            for n, problem in open_.items():
                stretch = best[n].peaks.stretch
                tighter = min(
                    options.STRATEGY.tighter[0] + 2 * max(0.0, stretch - 1), options.STRATEGY.tighter[1]
                )
                # Tighter limits alone take longer by as much.
                durations[n] *= float(np.clip(stretch, 1 + tighter, options.STRATEGY.most_longer)) ** (
                    2**look
                )
                requests[n] = AttemptRequest(
                    problem=problem,
                    mesh=problem.mesh(problem.quickest(), best[n].radius, 1, graded=True),
                    duration=durations[n],
                    limited=True,
                    free_time=False,
                    tighter=tighter,
                )
            made = {n: own for n, own in self._attempts(requests).items() if own is not None}
            best |= made
            open_ = {n: problems[n] for n in made}
        return best

    def _climb(self, ladders: dict[int, Ladder]) -> Attempts:
        """The best attempts on ladders; the next ones of all are made together."""
        requests = {n: request for n, own in ladders.items() if (request := own.next_request())}
        while requests:
            for n, made in self._attempts(requests).items():
                ladders[n].accept(made)
            requests = {n: request for n in requests if (request := ladders[n].next_request())}
        return {n: own.best for n, own in ladders.items()}

    def _attempts(self, requests: dict[int, AttemptRequest]) -> Attempts:
        with self.seconds.shared(list(requests)):
            return dict(zip(requests, make_attempts(list(requests.values())), strict=True))


def time_scaled(problem: FitProblem, attempt: Attempt, duration: float) -> Attempt:
    """The same motion in another duration."""
    curve = attempt.trajectory.scaled(duration / attempt.trajectory.duration)
    for breaks in (curve.breaks, curve.joint_breaks):  # new arrays
        breaks[-1] = duration  # to the last bit
    return replace(attempt, trajectory=curve, peaks=peaks(curve, problem.spacecraft))


def _stretches(problem: FitProblem) -> bool:
    """Whether a motion without limits is asked for, whose time is stretched to them."""
    return problem.settings.duration == STRETCHED and not problem.at_speed


def _quicker(others: Attempts, attempts: Attempts) -> Attempts:
    """Those of the other attempts that are sound and quicker than the first ones, once these keep limits."""
    found: Attempts = {}
    for n, other in others.items():
        own = attempts[n]
        if other is None or own is None or not other.sound:
            continue
        if not own.sound or other.needed < own.needed:
            found[n] = other
    return found
