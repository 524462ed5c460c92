"""A plan as a function of its scenario, and the choices that are held fixed in it.

What a planner chooses has no derivative and is held fixed (`hold`): which local minimum of step 1 the goal is
and which limits and zones are active there, the corners of the path, and which limits, zones and nodes bind
in step 3. All else follows the scenario (`replan`): the first and last node are its start and its goal, nodes
on straight motions next to these move with them (`jaxplan.model.path`), in the global method nodes
are passed at the times that the pace along the path gives, and the trajectory is the optimum of step 3. Where
targets or zones move, in a given duration, the goal and its rates are those at the end time. Where a choice
is about to change, the derivative is that of the side that is held. After tuning, plan again: another path
may have become better.

What is held of a plan, and which scenarios have derivatives, is in `held`; `replanning` has the function,
`following` plans that are made anew near others.
"""

from jaxplan.derivatives.following import follow, follow_and_hold
from jaxplan.derivatives.held import (
    Held,
    expect_alike,
    expect_followable,
    expect_known_time,
    hold,
    hold_each,
    own_arrays,
)
from jaxplan.derivatives.replanning import End, end_of, held_end, motion_to, of_arrays, replan, replan_to

__all__ = [
    "End",
    "Held",
    "end_of",
    "expect_alike",
    "expect_followable",
    "expect_known_time",
    "follow",
    "follow_and_hold",
    "held_end",
    "hold",
    "hold_each",
    "motion_to",
    "of_arrays",
    "own_arrays",
    "replan",
    "replan_to",
]
