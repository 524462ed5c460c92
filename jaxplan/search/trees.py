"""Trees that grow by random samples: their nodes, the states drawn for them, and how far motions are clear.

Random states are uniform, or such that terminals are held on the axes of their keep-in zones (`scene`). A
state is a row of ``4 + 2n`` numbers: the attitude relative to the start as a unit quaternion, scalar first,
and all joints. The distance between two states is the cost of the straight motion, in steps. Straight motions
are checked whole, a batch in one jitted call, and the answer is how far the motion is clear, so that one call
does what many single steps of a tree do.

The clearance wanted beyond the zones is less near start and goal, as with the other planners. How far a state
is from the root of its tree is known along the tree; from the other end it is at least the straight distance,
which is then used.
"""

from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry import quaternion
from jaxplan.model.gimbals import angles_toward, in_range
from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.runtime.stopwatch import working_time
from jaxplan.search.edges import interval_slacks, straight_lines, turns_between
from jaxplan.search.kernel_calls import Call, Kernel, Scenes, SearchRun, completed, picked
from jaxplan.search.paths import straight_paths, subdivide
from jaxplan.search.scene import Scene, SearchResult, steps_between, tapered
from jaxplan.search.smoothing import smooth_results

INTERVALS = 32


# Motions of a jitted call: few for single samples, many for neighbourhoods.
FEW, MANY = 4, 16


# Random states from which one is chosen, where terminals are to be held.
CANDIDATES = 32


# A turn this near to half a turn, rad, may go either way round: no motion relies on it.
HALF_TURN = 1e-6


def draw(scene: Scene, rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw random states, uniform on SO(3) times the box of the joints' ranges.

    Where terminals are held, which few random states satisfy, every second state is chosen among `CANDIDATES`
    random ones: the one whose held terminals can best be turned onto the axes of their cones, with these
    turned there. The others remain, so that no part of the space is left out.

    Args:
        scene: the problem.
        rng: where random numbers come from.
        count: number of states.

    Returns:
        (count, 4 + 2n).
    """
    states = _draw_uniform(scene, rng, count)
    if scene.held_axes and count > 1:
        candidates = _draw_uniform(scene, rng, count // 2 * CANDIDATES)
        excess = _turn_to_hold(scene, candidates).reshape(-1, CANDIDATES)
        states[1::2] = candidates.reshape(*excess.shape, -1)[np.arange(len(excess)), excess.argmin(axis=1)]
    return states


def _draw_uniform(scene: Scene, rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw states (count, 4 + 2n), uniform on SO(3) times the box of the joints' ranges."""
    turns = rng.standard_normal((count, 4))
    turns /= np.sqrt(np.sum(turns * turns, axis=1, keepdims=True))
    low, high = scene.joint_ranges.T
    share = rng.uniform(-1.0, 1.0, (count, len(low)))
    return np.concatenate([turns, (low + high) / 2 + share * (high - low) / 2], axis=1)


def _turn_to_hold(scene: Scene, states: np.ndarray) -> np.ndarray:
    """Turn, in place, the held terminals of k states onto their cones' axes, within the limits.

    `states` is (k, 4 + 2n).

    Returns:
        (k,) rad, the most by which a joint would have had to exceed its limits.
    """
    held, axes = np.array(list(scene.held_axes)), np.stack(list(scene.held_axes.values()))
    toward = axes @ scene.start_attitude
    places = np.concatenate([held, scene.gimbals.pitches[held]])
    ranges = scene.joint_ranges[places]
    angles = angles_toward(scene.gimbals.frames[held], quaternion.to_matrix(states[:, :4]), toward)
    joints = in_range(np.concatenate(angles, axis=-1), ranges)
    inside = np.clip(joints, *ranges.T)
    states[:, 4 + places] = inside
    return np.max(np.abs(joints - inside), axis=1)


@Kernel
def _count_clear_intervals(scene: Scene, first: Array, second: Array, clearance: Array) -> Array:
    """Return the number (b,) of intervals before the first that is not clear, on b straight motions.

    The last interval of a motion within `HALF_TURN` of half a turn counts as not clear, as it may go either
    way round.

    Args:
        scene: the problem.
        first: (b, 4 + 2n) states where the motions begin.
        second: (b, 4 + 2n) states where they end.
        clearance: (b, INTERVALS) rad wanted.
    """
    clear = interval_slacks(scene, straight_lines(scene, first, second, INTERVALS), clearance) >= 0
    turns = turns_between(first, second)
    certain = jnp.sum(turns * turns, axis=-1) < (jnp.pi - HALF_TURN) ** 2
    return jnp.sum(jnp.cumprod(clear.at[:, -1].min(certain), axis=-1), axis=-1)


def reached(answer: np.ndarray, count: int) -> np.ndarray:
    """Return how far straight motions are clear, given the answer to a `Space.reach_call`.

    Args:
        answer: answer of the kernel.
        count: number of the motions; the rest of the answer is padding.

    Returns:
        (count,) fraction of each motion, a multiple of ``1 / INTERVALS``, up to which it is clear.
    """
    return answer[:count] / INTERVALS


class Tree:
    """States with their parents, in arrays that double in size when they are full.

    Attributes:
        size: number of states; entries of the arrays beyond it mean nothing.
        states: (capacity, 4 + 2n).
        parents: (capacity,) int, index of each state's parent, -1 for the root.
        costs: (capacity,) steps from the root.
    """

    def __init__(self, root: np.ndarray) -> None:
        self.size = 0
        self.states = np.empty((64, len(root)))
        self.parents = np.empty(64, dtype=int)
        self.costs = np.empty(64)
        self.add(root, -1, 0.0)

    def add(self, state: np.ndarray, parent: int, cost: float) -> int:
        """Add a state (4 + 2n,), `cost` steps from the root, with its parent's index; return its index."""
        if self.size == len(self.costs):
            self.states = np.concatenate([self.states, np.empty_like(self.states)])
            self.parents = np.concatenate([self.parents, np.empty_like(self.parents)])
            self.costs = np.concatenate([self.costs, np.empty_like(self.costs)])
        place = self.size
        self.states[place], self.parents[place], self.costs[place] = state, parent, cost
        self.size += 1
        return place

    def branch(self, place: int) -> list[int]:
        """Return the indices of the states from the root to the one at index `place`."""
        places = []
        while place >= 0:
            places.append(place)
            place = int(self.parents[place])
        return places[::-1]


class Space:
    """A scene with its random samples, distances and checks of motions, and the effort spent on it.

    Attributes:
        scene: the problem.
        start: (4 + 2n,) state.
        goal: (4 + 2n,) state.
        extensions: number of straight motions by which trees have tried to grow.
    """

    def __init__(self, scene: Scene, settings: SearchSettings) -> None:
        self.scene, self.settings = scene, settings
        self.deadline = working_time() + settings.time_limit
        self.rng = np.random.default_rng(np.random.SeedSequence(settings.seed))
        self.start, self.goal = scene.ends
        self.extensions = 0

    @property
    def left(self) -> int:
        """Number of extensions that may still be tried."""
        return self.settings.max_expansions - self.extensions

    def spent(self) -> Status | None:
        """Return NODE_LIMIT or TIME_LIMIT if that limit is reached, else None."""
        if self.left <= 0:
            return Status.NODE_LIMIT
        return Status.TIME_LIMIT if working_time() >= self.deadline else None

    def draw(self, count: int) -> np.ndarray:
        """Draw random states (count, 4 + 2n), see the function `draw`."""
        return draw(self.scene, self.rng, count)

    def distance(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return the steps (...) of straight motions between states (..., 4 + 2n)."""
        turn = quaternion.distance(first[..., :4], second[..., :4])
        return steps_between(self.scene, turn, second[..., 4:] - first[..., 4:])

    def nearest(self, tree: Tree, states: np.ndarray) -> np.ndarray:
        """Return for each of k states (k, 4 + 2n) the index of the nearest state of the tree.

        The nearest is found to within some 1e-8 steps.
        """
        known = tree.states[: tree.size]
        cosines = np.minimum(np.abs(states[:, :4] @ known[:, :4].T), 1)  # of half the turns
        away = np.arccos(cosines) * (2 / self.scene.attitude_step)
        for joint, step in enumerate(self.scene.joint_steps, start=4):
            np.maximum(away, np.abs(states[:, joint, None] - known[:, joint]) / step, out=away)
        return np.argmin(away, axis=1)

    def reach(
        self, first: np.ndarray, second: np.ndarray, from_start: np.ndarray, from_goal: np.ndarray
    ) -> np.ndarray:
        """Compute how far any number of straight motions are clear; arguments as for `reach_call`.

        Returns:
            A fraction for each motion, see `reached`.
        """
        found = []
        for begin in range(0, len(first), MANY):
            part = slice(begin, begin + MANY)
            ends = np.asarray(from_start)[:, part], np.asarray(from_goal)[:, part]
            call = self.reach_call(first[part], second[part], *ends)
            found.append(reached(Scenes([self.scene]).answers([call])[0], len(first[part])))
        return np.concatenate(found)

    def reach_call(
        self, first: np.ndarray, second: np.ndarray, from_start: np.ndarray, from_goal: np.ndarray
    ) -> Call:
        """Make the call that tells how far straight motions are clear, see `reached`.

        Args:
            first: (b, 4 + 2n) states where b motions begin, at most MANY.
            second: (b, 4 + 2n) states where they end.
            from_start: (2, b) steps from the start of the scene to both ends, for the clearance.
            from_goal: (2, b) steps likewise from the goal.

        Raises:
            ValueError: for more than MANY motions.
        """
        count = len(first)
        if count > MANY:
            raise ValueError(f"at most {MANY} motions are checked in a call, not {count}")
        missing = (FEW if count <= FEW else MANY) - count
        still = np.tile(self.start, (missing, 1))
        clearance = self._wanted_clearance(self.distance(first, second), from_start, from_goal)
        padded = [(first, still), (second, still), (clearance, np.zeros((missing, INTERVALS)))]
        return Call(_count_clear_intervals, tuple(np.concatenate(part) for part in padded))

    def _wanted_clearance(
        self, length: np.ndarray, from_start: np.ndarray, from_goal: np.ndarray
    ) -> np.ndarray:
        """Return the clearance wanted on each interval of b motions, (b, INTERVALS) rad.

        Args:
            length: (b,) steps of the motions.
            from_start: (2, b) steps from the start of the scene to both ends.
            from_goal: (2, b) steps likewise from the goal.
        """
        fraction = np.arange(INTERVALS + 1) / INTERVALS
        along, back = length[:, None] * fraction, length[:, None] * (1 - fraction)
        ways = [
            np.minimum(ends[0][:, None] + along, ends[1][:, None] + back) for ends in (from_start, from_goal)
        ]
        steps = np.minimum(*ways)
        return np.asarray(tapered(self.settings.clearance, np.minimum(steps[:, :-1], steps[:, 1:])))

    def result(self, status: Status, path: Path | None = None) -> SearchResult:
        """Return the result of this status and path, with the extensions so far as expansions."""
        return SearchResult(
            status=status, path=path, expansions=self.extensions, queue_expansions=(self.extensions,)
        )

    def found(self, corners: np.ndarray) -> SearchResult:
        """Return the result OK with the path along given corners, states (k, 4 + 2n) from start to goal."""
        return self.result(Status.OK, subdivide(self.scene, corners))


def search_by_trees(
    grow: Callable[[Space], SearchRun], scenes: Scenes, settings: Sequence[SearchSettings]
) -> list[SearchResult]:
    """Search paths by trees: the straight motions first, then a run for each scene left, then smoothing.

    Args:
        grow: function that makes the run that grows trees in a space.
        scenes: the problems.
        settings: those of each search: limits of the effort, clearance and seed.

    Returns:
        For each scene OK with a path whose every edge is clear, or a status that says why there is none.
    """

    def grown(rest: list[int]) -> list[SearchResult]:
        some, own = scenes.part(rest), picked(settings, rest)
        runs = [grow(Space(*one)) for one in zip(some.scenes, own, strict=True)]
        some.run(runs)
        return smooth_results(some, own, [run.result() for run in runs])

    straight = [
        None
        if path is None
        else SearchResult(status=Status.OK, path=path, expansions=0, queue_expansions=(0,))
        for path in straight_paths(scenes, settings)
    ]
    return completed(straight, grown)
