"""Wishes of a goal: of all attitudes that meet the targets, those nearest to what devices prefer, in order.

Each wish in turn is made as near as the ones before allow: the least angle within which there is an attitude
that meets all targets, zones and former wishes is found by bisection, as the caps of `jaxplan.goal.caps` have
it. A search of the whole covering a little nearer then either proves that this is the least, as far as its
descents go, or finds something nearer, from which the bisection goes on. Where many attitudes are as near, as
where the wish is parallel to what the targets fix, nothing is preferred and the least turn decides.
"""

from dataclasses import replace

import numpy as np

from jaxplan.goal import multistart
from jaxplan.goal.caps import Caps, assemble
from jaxplan.goal.problem import GoalProblem, Wished

SPARE = 4e-7
"""rad, by which a wish is met less than it might be, so that the next ones have room."""
_NEARER = 6e-7  # rad; what is not nearer by this is not looked for
_LOOKS = 6  # of the whole covering, for each wish


def with_wishes(problem: GoalProblem, wishes: list[Wished], seed: int) -> GoalProblem:
    """The problem with its wishes as near as can be, one after the other.

    Args:
        problem: what is asked; one without solution is handed back as it is.
        wishes: in the order of their worth.
        seed: of the covering.
    """
    if not wishes or not len(multistart.minima(assemble(problem), 1, seed)):
        return problem
    for wish in wishes:
        problem = replace(problem, wishes=(*problem.wishes, wish._replace(reach=_least(problem, wish, seed))))
    return problem


def _least(problem: GoalProblem, wish: Wished, seed: int) -> float:
    """The least distance of a wish, with some to spare, rad."""

    def within(reach: float) -> Caps:
        return assemble(replace(problem, wishes=(*problem.wishes, wish._replace(reach=reach))))

    least = np.pi
    for _ in range(_LOOKS):
        _, least = multistart.least_widening(within, least, seed)
        if least <= _NEARER:
            break
        nearer = multistart.minima(within(least - _NEARER), 1, seed)
        if not len(nearer):
            break
        least -= _NEARER
    return least + SPARE
