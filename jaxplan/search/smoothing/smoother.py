"""Path smoothing after the search: bands descend from the straight motion, and from the path cut short.

The straight motion is the first start, zones or not: the descent often pushes it out of them, and to a
shorter way than the search has found. Where that fails, or is not near the shortest there can be, the other
start is the path itself without what can be left out. What comes out of a descent counts only if every edge
is clear, by as much as is wanted or by as much as in the path that was given.
"""

import numpy as np

from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.search.corners import ARRIVED, edge_rotations
from jaxplan.search.lockstep import Call, Steps
from jaxplan.search.problem import Scene
from jaxplan.search.smoothing import chains
from jaxplan.search.smoothing.bends import EDGES, Bend, bend, edge_table, edges_for, padded, score

# A length within this factor of the straight motion's is not worth another start.
NEAR_SHORTEST = 1.01
# A path may be longer than the one given by this factor, and only where it is better in score.
LENGTHENING = 1.005


def bend_straight(scene: Scene, settings: SearchSettings) -> Steps[Bend | None]:
    """What a descent makes of the straight motion from start to goal, which may be the whole answer.

    Args:
        scene: the problem; start and goal are not the same.
        settings: gives the clearance.
    """
    attitudes = np.stack([scene.start_attitude, scene.goal_attitude])
    joints = np.stack([scene.start_joints, scene.goal_joints])
    return (yield from bend(attitudes, joints, settings.clearance, edges_for(np.inf, scene)))


def smooth(scene: Scene, settings: SearchSettings, path: Path, bent: Bend | None = None) -> Steps[Path]:
    """A path between the same ends that is shorter and smoother, or the path itself.

    Args:
        scene: the problem.
        settings: its clearance is wanted beyond the zones.
        path: from start to goal, at least one node.
        bent: of `bend_straight`, if it is known already.

    Returns:
        A path with edges of about the same cost, at most one step, that are clear by the exact bound: with
        the wanted clearance, which tapers to nothing at both ends as in the search; or, where the path given
        has edges with less than that, with at least what the worst of these has. In steps it is shorter,
        or longer by up to 0.5 % where platform and joints travel less for it. It is the path given if that
        is straight, or if no better one was found.
    """
    straight = scene.straight_steps
    if straight <= ARRIVED or _is_straight(scene, path, straight):
        return path
    if bent is None:
        bent = yield from bend_straight(scene, settings)
    race = _Race(scene, settings, path)
    yield from race.enter(bent)
    if race.best is None or race.best.length > NEAR_SHORTEST * straight:
        edges = edges_for(LENGTHENING * path.length, scene)
        kept = yield from chains.cheapest(path, settings.clearance)
        last = yield from bend(path.attitudes[kept], path.joints[kept], settings.clearance, edges)
        yield from race.enter(last)
        if race.best is None and last is not None:  # often a little more descent is all that lacks
            yield from race.enter((yield from bend(last.attitudes, last.joints, settings.clearance, edges)))
    return path if race.best is None else race.best.path(scene)


class _Race:
    """The best that came out of descents, and the path that it must beat."""

    def __init__(self, scene: Scene, settings: SearchSettings, path: Path) -> None:
        self.path = path
        self.clearance = settings.clearance
        self.score = score(path.length, _travel(scene, path))
        self.best: Bend | None = None

    def enter(self, found: Bend | None) -> Steps[None]:
        """Take what was found if it is better than the best so far, and as clear as it must be."""
        if found is None or found.length > LENGTHENING * self.path.length or found.score >= self.score:
            return
        if np.all(found.margins >= 0) and (found.clear or (yield from self._as_clear_as_given(found))):
            self.best, self.score = found, found.score

    def _as_clear_as_given(self, found: Bend) -> Steps[bool]:
        """Whether what lacks of the wanted clearance lacks in the path given, too; of very long ones no."""
        edges = self.path.edges
        if edges > EDGES:  # would compile kernels of its own
            return False
        table = yield Call(
            edge_table, (*padded(self.path.attitudes, self.path.joints, EDGES), self.clearance)
        )
        margins, slacks = table[:2, :edges]
        floor = np.min(margins[~(slacks >= 0)], initial=np.inf)
        return bool(np.all((found.slacks >= 0) | (found.margins >= max(floor, 0))))


def _is_straight(scene: Scene, path: Path, straight: float) -> bool:
    """Whether the nodes lie on the straight motion, at the places that their costs say."""
    if path.length > straight + ARRIVED:
        return False
    passed = np.concatenate([[0.0], np.cumsum(path.edge_costs)])[:, None] / straight
    joints = scene.start_joints + passed * (scene.goal_joints - scene.start_joints)
    turned = np.sum(edge_rotations(path.attitudes))
    return bool(
        np.all(np.abs(path.joints - joints) <= ARRIVED)
        and turned <= np.linalg.norm(scene.goal_coordinates) + ARRIVED
    )


def _travel(scene: Scene, path: Path) -> float:
    """Steps of the platform and of all joints, added up."""
    joints = np.abs(np.diff(path.joints, axis=0)) / scene.joint_steps
    return float(np.sum(edge_rotations(path.attitudes)) / scene.attitude_step + np.sum(joints))
