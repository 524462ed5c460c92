"""The attempts at one goal, in turn: paths with more and more clearance, and trajectories with more nodes."""

from collections.abc import Sequence

from jaxplan.model.path import Goal
from jaxplan.planner.record import Plan
from jaxplan.search import Scene, SearchResult
from jaxplan.trajectory import Fit

# The ladder of attempts at one goal: a factor on the clearance, which keeps paths farther from zones, and how
# often each edge is halved, which keeps the trajectory closer to the path.
LADDER = ((1.0, 0), (3.0, 0), (1.0, 1), (3.0, 1), (6.0, 1))
# The same without clearance, where no path is found with the wanted one, and time is left.
BARE_LADDER = ((0.0, 0), (0.0, 1))


class Ladder:
    """The attempts that are made at one goal, in turn.

    Attributes:
        goal: where the manoeuvre is to end.
        scene: the search problem.
        rungs: attempts still to be made, each as (factor on the clearance, times that edges are halved).
        found: results of searches, by factor on the clearance.
        factor: factor of the attempt under way.
        halvings: halvings of the attempt under way.
        so_far: the plan of the attempt under way.
        spare: the fit to go back to if that plan's trajectory is not certified; None for none.
        uncertified: the first plan whose trajectory was not certified.
        unbent: whether the motion along its path without bent curves has been asked for.
    """

    def __init__(self, goal: Goal, scene: Scene, rungs: Sequence[tuple[float, int]]) -> None:
        self.goal, self.scene, self.rungs = goal, scene, list(rungs)
        self.found: dict[float, SearchResult] = {}
        self.factor, self.halvings = LADDER[0]
        self.so_far: Plan
        self.spare: Fit | None = None
        self.uncertified: Plan | None = None
        self.unbent = False
