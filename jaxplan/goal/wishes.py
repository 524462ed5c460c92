"""Meet the wishes of a goal: of attitudes that meet the targets, find those nearest to the wishes.

A wish is a direction that a device without a target shall come near to. Each wish in turn is made as near as
the ones before allow: the least angle within which there is an attitude that meets all targets, zones and
former wishes is found by bisection, with all of these as caps (`jaxplan.goal.caps`). A search of the whole
covering for an angle a little less then either proves that this is the least, as far as its descents go, or
finds something nearer, from which the bisection goes on. Where many attitudes are equally near, as where the
wish is parallel to what the targets fix, the one of least slew is taken.
"""

from dataclasses import replace

import numpy as np

from jaxplan.goal import multistart
from jaxplan.goal.caps import Caps, assemble
from jaxplan.goal.problem import GoalProblem, Wished

SPARE = 4e-7
"""rad, by which a wish is met less than it might be, so that the next ones have room."""
_MIN_GAIN = 6e-7  # rad; a smaller gain in nearness is not searched for
_MAX_SEARCHES = 6  # most searches of the whole covering for each wish


def with_wishes(
    problem: GoalProblem, wishes: list[Wished], seed: int, found: np.ndarray | None = None
) -> tuple[GoalProblem, np.ndarray]:
    """Return the problem with its wishes as near as can be, one after the other.

    Args:
        problem: the problem of step 1; it is returned as it is where it has no solution.
        wishes: in the order of their priority.
        seed: seed of the covering.
        found: (1, 4) unit quaternion of a rotation from the start that solves the problem; None to look for
            one where there are wishes.

    Returns:
        The problem, and a quaternion (1, 4) of a rotation from the start that solves it, or none (0, 4).
        Where the wishes leave hardly any room, that may be the only solution that can be found.
    """
    if found is None:
        found = multistart.minima(assemble(problem), 1, seed) if wishes else np.empty((0, 4))
    if not len(found):
        return problem, found
    near = found[0]
    for wish in wishes:
        near, reach = _minimise_reach(problem, wish, seed, near)
        problem = replace(problem, wishes=(*problem.wishes, wish._replace(reach=reach)))
    return problem, multistart.minimum_near(assemble(problem), near)


def _minimise_reach(
    problem: GoalProblem, wish: Wished, seed: int, near: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the rotation from the start at which a wish is nearest, and how near it is.

    Args:
        problem: with the wishes before, each within its reach.
        wish: the next one.
        seed: seed of the covering.
        near: (4,) unit quaternion of a solution of the problem to start from.

    Returns:
        Unit quaternion (4,), and the least reach with which there is a solution plus `SPARE`, rad.
    """

    def within(reach: float) -> Caps:
        return assemble(replace(problem, wishes=(*problem.wishes, wish._replace(reach=reach))))

    least = np.pi
    for _ in range(_MAX_SEARCHES):
        near, least = multistart.least_widening(within, least, seed, near)
        if least <= _MIN_GAIN:
            break
        nearer = multistart.minima(within(least - _MIN_GAIN), 1, seed)
        if not len(nearer):
            break
        near, least = nearer[0], least - _MIN_GAIN
    return near, least + SPARE
