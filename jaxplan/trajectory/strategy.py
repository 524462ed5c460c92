"""The strategy of the spline fit: which durations, intervals and tubes are tried, and which curve is taken.

Many fits are made at once. Each has a number: functions take problems by number and return attempts or fits
by number, and attempts that are needed at the same time are made together. An *attempt* is one curve fitted
to one problem; a fit climbs a `Ladder` of attempts, whose *rungs* are numbers of intervals with radii of the
tube. Which ladder, and what is made of its best attempt, depends on the duration that is asked for:

    a number      `Strategy.timed`: a curve in that time, or else the shortest one, which says what is needed
    "stretched"   `Strategy.stretched`: a curve without limits, then slowed until the first limit binds
    "minimum"     `Strategy.shortest`: the shortest curve within all limits

Where a limit, a zone or the tube is broken more intervals are tried, then a wider tube, then none. An attempt
is *sound* if it keeps zones, joint ranges and its tube, and limits at least when slowed. The *bound* is a
strict lower bound of the duration.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from jaxplan.model.scenario import STRETCHED
from jaxplan.model.status import Status
from jaxplan.model.tabulation import tabulate
from jaxplan.runtime.batching import Seconds
from jaxplan.trajectory import guesses, node_times
from jaxplan.trajectory.curve_attempts import (
    Attempt,
    Attempts,
    Ladder,
    first_curve,
    make_attempts,
    quicker,
    rungs,
)
from jaxplan.trajectory.discretisation import Timing
from jaxplan.trajectory.fit import NEAR_THE_BOUND, Fit, FitQuery, at_rest, checked, fit_each
from jaxplan.trajectory.moving_ends import MovingEnds
from jaxplan.trajectory.node_times import FIRST_GUESS
from jaxplan.trajectory.outcome import (
    better,
    beyond_charts,
    full_at_goal,
    full_at_rest,
    limits_too_tight,
    overloaded_at_an_end,
    success,
    within_longest,
)
from jaxplan.trajectory.peaks import SAFETY
from jaxplan.trajectory.problem import FitProblem
from jaxplan.trajectory.splines import DEGREE, SMOOTHNESS
from jaxplan.trajectory.sqp import InitialGuess

_RATE_ROUNDING = 1e-9  # of a limit, by which rates at start and end may exceed it
_UNUSED_LIMIT_SHARES = (1e-3, 1e-2)  # of the limits, left unused at places in first and further attempts
_DURATION_ROUNDING = 1e-12  # of a duration, by which the shortest motion may exceed it by rounding
_SLOW_RATIO = 2.0  # times the bound; if longer, a stretched motion is tried without a tube as well
_DETOUR_RATIO = 1.1  # times the bound; if longer, a shortest motion is compared with a stretched one
_HURRY_RATIO = 0.97  # of the quickest time along the nodes; in less time they are only a first guess
_LEISURE_RATIO = 1.15  # of the quickest time along the nodes; in less time breaks lie close about the flanks

Problems = dict[int, FitProblem]  # by the number of the fit
Radius = Callable[[FitProblem], float]  # of a tube about the nodes, rad


def _own_radius(problem: FitProblem) -> float:
    """Radius in rad of the tube that a problem asks for."""
    return problem.radius


def _no_tube(_: FitProblem) -> float:
    """Radius inf, which means no tube."""
    return np.inf


def fit(queries: Sequence[FitQuery], seconds: Seconds | None = None) -> list[Fit]:
    """Fit one spline of degree 5, platform and joints together, to each of many paths.

    It has four continuous derivatives and least energy (rate, acceleration and jerk with the settings'
    weights) among those that pass the nodes within the tube, keep all limits and stay clear of the zones. The
    nodes are passed at the pace of a trapezoid (`node_times`). What else is done depends on
    ``settings.duration``:

    - A number of seconds is kept.
    - "stretched" fits at the quickest pace without limits and scales the time until the first limit binds.
      Without a tube in the settings it leaves the nodes if that takes twice the bound and a motion off them
      is quicker. With a rate at an end it is "minimum" with the tube, or without it for the same reason.
    - "minimum" looks for the shortest duration within all limits and zones; the nodes are then only a first
      guess, unless the settings give a tube.

    Args:
        queries: one for each fit.
        seconds: accumulates the computation time of each fit, s, in place; None to measure nothing.

    Returns:
        The fits. One that is OK keeps zones at the places that were looked at, and the certificate has the
        last word on them; one that is UNCERTIFIED breaks a zone there, or leaves a joint's range.

    Raises:
        ValueError: if settings, costs, fractions or rates make no sense; the message names which.
    """
    fits = fit_each(queries, _prepare, Strategy(Seconds(len(queries)) if seconds is None else seconds).fits)
    return [within_longest(*one) for one in zip(fits, queries, strict=True)]


def _prepare(query: FitQuery) -> Fit | tuple[FitProblem, np.ndarray]:
    """Make the problem of a query and the index there of each given node, or the fit if it is known at once.

    It is known if nothing moves, numbers are not finite, wheels would be full at the goal, rates at an end
    alone need more torque than there is, or wheels are full at rest. See `fit` on errors.
    """
    spacecraft, fractions = query.spacecraft, query.node_fractions
    path, rates = checked(query)
    longest = np.inf if spacecraft.rate_norm_limit is None else spacecraft.rate_norm_limit
    limits = np.concatenate([np.full(3, spacecraft.rate_limit), spacecraft.joint_rate_limits, [longest]])
    given = np.column_stack([rates, np.linalg.norm(rates[:, :3], axis=1)])
    worst = np.unravel_index(np.argmax(np.abs(given) / limits), given.shape)
    if not np.abs(given[worst]) <= (1 + _RATE_ROUNDING) * limits[worst[1]]:
        raise ValueError(
            f"a rate at the {('start', 'end')[worst[0]]} is {given[worst]:g} rad/s: "
            f"must be at most {limits[worst[1]]:g}"
        )
    if not (np.all(np.isfinite(path.attitudes)) and np.all(np.isfinite(path.joints))):
        message = "a node of the path is not made of finite numbers"
        return Fit(trajectory=None, status=Status.INFEASIBLE, message=message)
    path, own = node_times.passed_nodes(path, at_speed=bool(np.any(rates)), every=fractions is not None)
    if len(path.attitudes) == 1:
        return at_rest(query, path, DEGREE, SMOOTHNESS, len(own))
    problem = FitProblem(
        attitudes=path.attitudes,
        joints=path.joints,
        turns=node_times.edge_turns(path.attitudes),
        fractions=None if fractions is None else np.asarray(fractions, float),
        rates=rates,
        spacecraft=spacecraft,
        cones=tabulate((), (), spacecraft) if query.cones is None else query.cones,
        settings=query.settings,
        horizon=query.horizon,
        near=query.near,
        at_most=query.at_most,
    )
    impossible = full_at_goal(problem) or overloaded_at_an_end(problem) or full_at_rest(problem)
    return impossible or (problem, own)


class Strategy:
    """Makes many fits together; see the module.

    Attributes:
        seconds: accumulates the computation time of each fit's attempts, s.
    """

    def __init__(self, seconds: Seconds) -> None:
        self.seconds = seconds
        self._moving = MovingEnds(self._attempt)

    def fits(self, problems: Problems) -> dict[int, Fit]:
        """Make the fits in the durations that the settings ask for.

        A motion with accelerations of zero at both ends is also one where these are free. So where they are
        free both are tried: a motion is found if there is one with zero, and it is never longer than that.
        """
        timed = {n: one for n, one in problems.items() if not isinstance(one.settings.duration, str)}
        others = {n: one for n, one in problems.items() if n not in timed}
        return self._fit_in_given_time(timed) | self._fit_in_least_time(others)

    def _fit_in_given_time(self, problems: Problems) -> dict[int, Fit]:
        """Fits in given durations; where free end accelerations fail, zero ones are tried."""
        fits = self.timed(problems)
        failed = {n: one for n, one in problems.items() if fits[n].status is not Status.OK and not one.rests}
        for n, other in self.timed({n: one.resting for n, one in failed.items()}).items():
            fits[n] = better(fits[n], other)
        return fits

    def _fit_in_least_time(self, problems: Problems) -> dict[int, Fit]:
        """Fits for "stretched" and "minimum", with zero end accelerations, then with free ones if allowed."""
        best = self._find_quickest({n: one.resting for n, one in problems.items()})
        fits = self._make_fits_within_limits(best)
        free = {n: one for n, one in problems.items() if not one.rests}
        shortened = {
            n: own
            for n, one in free.items()
            if (own := best[n]) is not None and not _is_to_be_stretched(one) and fits[n].status is Status.OK
        }
        found = self._free_end_accelerations(free, shortened)
        found |= self._find_quickest({n: one for n, one in free.items() if n not in shortened})
        for n, other in self._make_fits_within_limits(found).items():
            fits[n] = better(other, fits[n])
        return fits

    def timed(self, problems: Problems) -> dict[int, Fit]:
        """Fits in given durations; if one fails, the shortest motion tells which duration is needed."""
        durations = {n: float(one.settings.duration) for n, one in problems.items()}
        possible = {n: one for n, one in problems.items() if durations[n] >= one.bound}
        closest = dict.fromkeys(problems) | self._attempt_in_time(possible, durations)
        closest |= self._moving.keep_limits(_at_speed(closest), durations)
        fits = {n: success(own) for n, own in closest.items() if own is not None and own.peaks.kept}
        # The shortest motion says whether there is one at all, and what to ask for. Where the bound says that
        # there is none, the one along the path is enough for that.
        left = {n: one for n, one in problems.items() if n not in fits}
        quickest = self.shortest({n: one for n, one in left.items() if n in possible}, _no_tube)
        hopeless = {n: one for n, one in left.items() if n not in possible}
        quickest |= self._attempt_along(hopeless, "shortest", _no_tube)
        moving = _at_speed(quickest)
        for n, own in quickest.items():
            if own is None:
                fits[n] = beyond_charts()
            elif n not in moving:
                fits[n] = _scaled_to(durations[n], own, closest[n])
        return fits | self._prolonged_to(durations, moving, closest)

    def _prolonged_to(
        self, durations: Mapping[int, float], quickest: Mapping[int, Attempt], closest: Attempts
    ) -> dict[int, Fit]:
        """Fits in given durations, s, from the shortest motions with rates at the ends; some may fail.

        Where `closest` has no attempt in the given duration, a failed fit shows one near the shortest motion,
        and that motion itself if there is none either.
        """
        slowed = self._moving.slow_to_limits(quickest)
        swift = {n: own for n, own in slowed.items() if own.good and own.duration <= durations[n]}
        longer = self._moving.prolong(swift, durations)
        fits = {n: success(own) for n, own in longer.items() if own.kept}
        failed = {n: own for n, own in slowed.items() if n not in fits}
        shown = self._moving.nearby({n: own for n, own in failed.items() if closest[n] is None}, durations)
        for n, own in failed.items():
            given, found = durations[n], own.duration if own.good else None
            needed, shorter = (found, None) if own.duration > given else (None, found)
            fits[n] = limits_too_tight(closest[n] or shown.get(n) or own, given, needed, shorter)
        return fits

    def _attempt_in_time(
        self, problems: Problems, durations: dict[int, float], radius: Radius = _own_radius
    ) -> Attempts:
        """The first sound attempts within all limits in given durations in s, or else the best ones made."""
        ladders = {}
        for n, problem in problems.items():
            hurry = durations[n] / problem.quickest.duration
            ladders[n] = Ladder(
                problem=problem,
                profile=problem.pace_in(durations[n]),
                rungs=rungs(radius(problem), in_time=problem.at_speed or hurry >= _HURRY_RATIO),
                duration=durations[n],
                timing="given",
                graded=hurry < _LEISURE_RATIO,
                tighter=_UNUSED_LIMIT_SHARES,
            )
        return self._climb_ladders(ladders)

    def _attempt_along(self, problems: Problems, timing: Timing, radius: Radius = _own_radius) -> Attempts:
        """The first sound attempts at the quickest pace along the path, or else the best ones made.

        Args:
            problems: what is fitted.
            timing: of the motions, "stretched" or "shortest".
            radius: from a problem to the radius of its tube, rad.
        """
        return self._climb_ladders(
            {
                n: Ladder(
                    problem=problem,
                    profile=problem.quickest,
                    rungs=rungs(radius(problem)),
                    duration=FIRST_GUESS * problem.quickest.duration,
                    timing=timing,
                )
                for n, problem in problems.items()
            }
        )

    def _find_quickest(self, problems: Problems) -> Attempts:
        """The best attempts of `stretched` or of `shortest`, as the settings and end rates ask."""
        stretching = {n: one for n, one in problems.items() if _is_to_be_stretched(one)}
        best = self.shortest({n: one for n, one in problems.items() if n not in stretching})
        slow = {n: problems[n] for n, own in best.items() if own is not None and _is_slow_in_its_tube(own)}
        return self.stretched(stretching) | best | quicker(self.shortest(slow, _no_tube), best)

    def stretched(self, problems: Problems) -> Attempts:
        """The best attempts that ignore limits, to be stretched to the limits afterwards."""
        best = self._attempt_along(problems, "stretched")
        slow = {n: problems[n] for n, own in best.items() if own is not None and _is_slow_in_its_tube(own)}
        return best | quicker(self._attempt_along(slow, "stretched", _no_tube), best)

    def shortest(self, problems: Problems, radius: Radius = _own_radius) -> Attempts:
        """The shortest motions within all limits, or else the best attempts made.

        If a problem names a motion with breaks at switches, only motions near that are looked for. Otherwise,
        if the platform is not much quicker than the joints, the search starts from curves bent away from the
        path (`guesses`); else it starts along the path, and from bent curves where there is something to
        gain. A motion from rest to rest far above the lower bound is compared with one without limits,
        stretched to them.
        """
        near = {n: begin for n, one in problems.items() if (begin := guesses.near(one)) is not None}
        found = {n: own for n, own in self._attempt(near, near.get).items() if own is not None and own.sound}
        problems = {n: one for n, one in problems.items() if n not in found}
        leaving = {
            n: one
            for n, one in problems.items()
            if one.platform_binds and radius(one) == np.inf and not one.at_speed
        }
        bent = self._search_bent_curves({n: guesses.along(one) for n, one in leaving.items()}, problems)
        found |= {n: own for n, own in bent.items() if own is not None and own.sound}
        left = {n: one for n, one in problems.items() if n not in found}
        best = self._attempt_along(left, "shortest", radius)
        slow = {
            n: one
            for n, one in left.items()
            if (own := best[n]) is not None
            and not one.at_speed
            and not (own.sound and own.needed <= _DETOUR_RATIO * one.bound)
            and own.needed < one.at_most
        }
        best |= quicker(self._attempt_along(slow, "stretched", lambda one: one.width), best)
        begins = {
            n: guesses.coarse(own)
            for n, own in best.items()
            if own is not None
            and radius(own.problem) == np.inf
            and not own.problem.at_speed
            and n not in leaving
            and not (own.sound and own.needed <= NEAR_THE_BOUND * own.problem.bound)
        }
        return best | quicker(self._search_bent_curves(begins, problems), best) | found

    def _search_bent_curves(self, begins: Mapping[int, InitialGuess | None], problems: Problems) -> Attempts:
        """The shortest motions near curves on few intervals, and near curves bent away from these.

        Args:
            begins: the curves, of stiff problems; None beyond every chart.
            problems: what is fitted; the settings say how many bent curves are tried. If none, no attempt is
                made.
        """
        counts = {n: problems[n].settings.first_guesses for n in begins}
        every = {
            n: [own, *guesses.bent(own, counts[n])]
            for n, own in begins.items()
            if own is not None and counts[n]
        }
        owner = [n for n, own in every.items() for _ in own]
        with self.seconds.shared(owner):
            made = make_attempts([begin for own in every.values() for begin in own])
        best: dict[int, Attempt] = {}
        for n, own in zip(owner, made, strict=True):
            if own is not None and (n not in best or own.pace > best[n].pace):
                best[n] = own
        best = self._refine_attempts(best, {n: problems[n].stiff for n in best}, by_time_alone=True)
        return dict(self._refine_attempts(best, problems, by_time_alone=False))

    def _refine_attempts(
        self, attempts: dict[int, Attempt], problems: Problems, *, by_time_alone: bool
    ) -> dict[int, Attempt]:
        """The shortest motions near those of attempts, on breaks close together where these switch."""

        def begin(n: int) -> InitialGuess:
            return guesses.precise(attempts[n], problems[n], by_time_alone=by_time_alone)

        found = self._attempt(attempts, begin)
        return {n: own for n, own in found.items() if own is not None}

    def _free_end_accelerations(self, problems: Problems, shortened: dict[int, Attempt]) -> Attempts:
        """The shortest motions with free end accelerations, near those with zero ones (`shortened`).

        Started from the path, where end accelerations are large, it might end in a longer local minimum.
        """

        def begin(n: int) -> InitialGuess | None:
            mesh, own = shortened[n].discrete.mesh, shortened[n].solution
            return first_curve(problems[n], mesh, own.duration, "shortest", coefficients=own.coefficients)

        return self._attempt(shortened, begin)

    def _make_fits_within_limits(self, attempts: Attempts) -> dict[int, Fit]:
        """Make fits from attempts, each in the shortest time in which its motion keeps all limits."""
        fits = {n: beyond_charts() for n, own in attempts.items() if own is None}
        best = {n: own for n, own in attempts.items() if own is not None}
        moving = self._moving.slow_to_limits(_at_speed(best))
        lost = {n: own.problem for n, own in moving.items() if not own.good and own.may_leave_tube}
        without = {n: own for n, own in self.shortest(lost, _no_tube).items() if own is not None}
        free = {n: own for n, own in self._moving.slow_to_limits(without).items() if own.good}
        best |= moving | free
        for n, own in best.items():
            if not own.problem.at_speed and np.isfinite(own.peaks.stretch):
                fits[n] = success(own, stretch=True)
            elif own.peaks.kept:
                fits[n] = success(own)
            else:
                fits[n] = limits_too_tight(own, own.duration, None)
        return fits

    def _climb_ladders(self, ladders: dict[int, Ladder]) -> Attempts:
        """Make attempts on ladders to their ends, those of all fits together; return the best of each."""

        def begin(n: int) -> InitialGuess | None:
            return ladders[n].first_curve()

        open_ = list(ladders)
        while open_:
            for n, made in self._attempt(open_, begin).items():
                ladders[n].accept(made)
            open_ = [n for n in open_ if ladders[n].rungs]
        return {n: own.best for n, own in ladders.items()}

    def _attempt(self, which: Iterable[int], begin: Callable[[int], InitialGuess | None]) -> Attempts:
        """Make attempts of some fits together, from first curves that `begin` makes by number."""
        numbers = list(which)
        if not numbers:
            return {}
        with self.seconds.shared(numbers):
            return dict(zip(numbers, make_attempts([begin(n) for n in numbers]), strict=True))


def _scaled_to(duration: float, quickest: Attempt, closest: Attempt | None) -> Fit:
    """The fit in a given duration, s, that is the shortest motion from rest to rest, slowed; it may fail.

    A failed one shows `closest`, if there is such an attempt in this duration.
    """
    needed = quickest.needed * SAFETY if quickest.sound and np.isfinite(quickest.peaks.stretch) else None
    if needed is not None and needed <= (1 + _DURATION_ROUNDING) * duration:
        return success(quickest.scaled(duration))
    return limits_too_tight(closest or quickest.scaled(duration), duration, needed)


def _at_speed(attempts: Mapping[int, Attempt | None]) -> dict[int, Attempt]:
    """Return the attempts, by number, that have a rate at the start or the goal."""
    return {n: own for n, own in attempts.items() if own is not None and own.problem.at_speed}


def _is_to_be_stretched(problem: FitProblem) -> bool:
    """Whether a fit without limits is to be stretched to them: if asked for, and at rest at both ends."""
    return problem.settings.duration == STRETCHED and not problem.at_speed


def _is_slow_in_its_tube(attempt: Attempt) -> bool:
    """Tell whether an attempt takes much longer than the bound in a tube that nobody asked for."""
    return attempt.may_leave_tube and attempt.sound and attempt.needed > _SLOW_RATIO * attempt.problem.bound
