"""Motions with rates at start or end, and how they come within the limits.

A motion from rest to rest is scaled in time until it just keeps all limits. Scaling would change rates at the
ends, so other motions are made from it instead, each near the one before: in slightly more time, under
slightly tighter limits, until one keeps them between the places that were looked at, too.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial

import numpy as np

from jaxplan.trajectory import guesses
from jaxplan.trajectory.curve_attempts import Attempt, Attempts, first_curve
from jaxplan.trajectory.sqp import InitialGuess

_LEAST_TIGHTENING = 1e-4  # of the limits, by which they are taken tighter at least
_MOST_TIGHTENING = 0.05  # of the limits, by which they are taken tighter at most
_MAX_TIGHTENINGS = 6  # most times that limits are taken tighter
_NEARLY_KEPT = 1.1  # factor on time; motions that need more to keep the limits are not mended by tighter ones
_PATH_UNUSED_SHARES = (1e-3, 1e-2)  # of the limits, least and most that motions along a path leave unused
_PROLONGED_UNUSED_SHARE = 1e-3  # of the limits, that prolonged motions leave unused
_MAX_DURATION_FACTOR = 1.1  # largest factor from the first duration of a motion along a path to the second
_MAX_DURATIONS = 8  # most durations of motions along a path
_CONVERGED_STRETCH = 1.01  # factor on time; a shortest motion that needs more was not found yet
_MAX_SEARCHES_AGAIN = 3  # most times that the shortest motion is looked for again from the one that was found
_WORTH_A_SEARCH = 0.99  # times a motion's duration; if the last search came to less, another one may, too
_PROLONGING_STEPS = 3  # steps in which a motion is changed to a longer duration

Attempting = Callable[[Iterable[int], Callable[[int], InitialGuess | None]], Attempts]
"""Makes attempts of fits with some numbers, from first curves that a function makes by number."""


class MovingEnds:
    """Makes motions with rates at their ends that keep all limits, from ones that do not.

    Args:
        attempt: makes attempts.
    """

    def __init__(self, attempt: Attempting) -> None:
        self._attempt = attempt

    def slow_to_limits(self, attempts: Mapping[int, Attempt]) -> dict[int, Attempt]:
        """Change attempts with rates at the ends, which may break limits, until they keep them.

        Scaling their time instead would change these rates. Curves near the attempts are tried first, in
        slightly more time; where these do not keep the limits, longer and longer motions are, until one does.
        If an attempt had broken limits by far, the shortest motion is then looked for again from there.
        """
        best = dict(attempts) | self.keep_limits(attempts)
        best |= self._lengthen({n: own for n, own in best.items() if not _is_enough(own)})
        far = {n for n, own in attempts.items() if own.peaks.stretch > _CONVERGED_STRETCH and best[n].good}

        def begin(n: int) -> InitialGuess | None:
            return guesses.shorter(best[n])

        for _ in range(_MAX_SEARCHES_AGAIN):
            again = self._attempt(far, begin)
            mended = self.keep_limits({n: own for n, own in again.items() if own is not None})
            quick = {n: own for n, own in mended.items() if own.good and own.duration < best[n].duration}
            far = {n for n, own in quick.items() if own.duration < _WORTH_A_SEARCH * best[n].duration}
            best |= quick
        return best

    def keep_limits(
        self, attempts: Mapping[int, Attempt], durations: Mapping[int, float] | None = None
    ) -> dict[int, Attempt]:
        """Repeat attempts that nearly keep the limits with tighter ones, until they keep them.

        Args:
            attempts: motions with rates at the ends, each the start of those after it.
            durations: s, that must not change; None to take more time where that is needed.

        Returns:
            The last attempt of each, whether it keeps them or not.
        """
        best, tighter = dict(attempts), dict.fromkeys(attempts, 0.0)

        def begin(n: int, look: int) -> InitialGuess | None:
            own, excess = best[n], max(_LEAST_TIGHTENING, best[n].peaks.stretch - 1)
            beyond = min(2**look * excess, _MOST_TIGHTENING)
            tighter[n] = min(tighter[n] + beyond, _MOST_TIGHTENING)
            longer = own.duration * (1 + 1.5 * beyond)  # tighter limits by themselves take more time
            return guesses.in_time(own, durations[n] if durations else longer, tighter=tighter[n])

        for look in range(_MAX_TIGHTENINGS):
            open_ = [n for n, own in best.items() if not own.peaks.kept and own.peaks.stretch <= _NEARLY_KEPT]
            made = self._attempt(open_, partial(begin, look=look))
            best.update({n: own for n, own in made.items() if own is not None})
        return best

    def _lengthen(self, attempts: Mapping[int, Attempt]) -> dict[int, Attempt]:
        """Make motions along the paths of attempts in longer durations until they keep all limits."""
        best, open_ = dict(attempts), list(attempts)
        durations = {n: max(own.duration, own.problem.bound) for n, own in best.items()}

        def begin(n: int, look: int) -> InitialGuess | None:
            problem, stretch = best[n].problem, best[n].peaks.stretch
            least, most = _PATH_UNUSED_SHARES
            tighter = min(least + 2 * max(0.0, stretch - 1), most)
            # Tighter limits by themselves make the motion longer by as much.
            longer = float(np.clip(stretch, 1 + tighter, _MAX_DURATION_FACTOR))
            durations[n] *= longer ** (2**look)
            mesh = problem.mesh(problem.quickest, best[n].radius, 1, graded=True)
            return first_curve(problem, mesh, durations[n], "given", tighter=tighter)

        for look in range(_MAX_DURATIONS):
            open_ = [n for n in open_ if not _is_enough(best[n])]
            # Wheels that are full stay as full in more time.
            open_ = [n for n in open_ if not np.isinf(best[n].peaks.stretch)]
            made = self._attempt(open_, partial(begin, look=look))
            open_ = [n for n, own in made.items() if own is not None]
            best.update({n: own for n, own in made.items() if own is not None})
        return best

    def prolong(self, attempts: Mapping[int, Attempt], durations: Mapping[int, float]) -> dict[int, Attempt]:
        """Change motions with rates at the ends to longer durations, s, in steps, each near the one before.

        The result may break limits.
        """
        best, steps = dict(attempts), range(1, _PROLONGING_STEPS + 1)
        for left in reversed(steps):
            longer = {
                n: own.duration * (durations[n] / own.duration) ** (1 / left) if left > 1 else durations[n]
                for n, own in best.items()
            }
            made = self.nearby(best, longer)
            best = {n: own for n, own in made.items() if own is not None}
            best = self.keep_limits(best, longer)
        return best

    def nearby(self, attempts: Mapping[int, Attempt], durations: Mapping[int, float]) -> Attempts:
        """Attempts in given durations, s, each near another one, on the breaks of that; limits may be broken.

        There is none where the nodes leave every chart.
        """

        def begin(n: int) -> InitialGuess | None:
            return guesses.in_time(attempts[n], durations[n], tighter=_PROLONGED_UNUSED_SHARE)

        return self._attempt(attempts, begin)


def _is_enough(attempt: Attempt) -> bool:
    """Tell whether an attempt keeps limits, zones and ranges, and any tube that was asked for.

    A motion that does not stay in any other tube is looked for without one, which is quicker than in it.
    """
    asked = attempt.problem.settings.node_tube is not None
    return attempt.kept and attempt.clear and (attempt.in_tube or not asked)
