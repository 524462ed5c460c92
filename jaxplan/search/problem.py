"""What every planner of step 2 is given, and what it answers.

Which terminals are to be held on the axis of a keep-in zone while the platform turns, and on which.

A terminal that a zone by itself binds must stay in it all the time. One that a zone of a group binds need
not, as another zone of the group may hold instead; but as long as none does it has to follow its zone, and
of random motions hardly any would. So it is proposed to be held, too, on the axis of the zone that it looks
nearest to at start or goal. This only guides a search: what is clear, the margins say.
"""

from dataclasses import dataclass, field
from functools import cached_property

import jax
import numpy as np
from numpy.typing import ArrayLike

from jaxplan.geometry import quaternion
from jaxplan.model.constraints import INERTIAL, SIGHT, Constraints
from jaxplan.model.directions import Sights
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import GivenState, Scenario, SearchSettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.runtime.display import shown


def held_axes(
    spacecraft: Spacecraft, rows: Constraints, start: GivenState, goal: Goal
) -> tuple[np.ndarray, np.ndarray]:
    """The terminals to be held, and where they look then.

    Args:
        spacecraft: its terminals.
        rows: the constraints, none of them moving.
        start: where the search begins.
        goal: where it goes.

    Returns:
        (n,) bool, whether a terminal is to be held; (n, 3) inertial axes, any where it is not.
    """
    ends = [spacecraft.boresights(state.attitude, state.joints) for state in (start, goal)]
    seen, terminals = np.stack(ends, axis=1), len(spacecraft.terminals)
    inside = (rows.side < 0) & (rows.frame == INERTIAL)
    held, axes = np.zeros(terminals, dtype=bool), np.tile([0.0, 0.0, 1.0], (terminals, 1))
    for terminal, looks in enumerate(seen[:terminals]):
        binding = np.flatnonzero(inside & rows.bound[:, terminal])
        alone = binding[rows.single[binding]]
        if len(binding):
            nearest = np.argmax(np.max(rows.axis[binding] @ looks.T, axis=1))
            held[terminal] = True
            axes[terminal] = rows.axis[alone[0] if len(alone) else binding[nearest]]
    return held, axes


# The wanted clearance grows from nothing to its full value over this many steps from start and goal.
TAPER_STEPS = 4.0
# Steps that joints keep from their limits unless they must: a trajectory swings past its nodes.
JOINT_RESERVE = 0.2


@shown(
    "goal_coordinates deg",
    "start_joints deg",
    "goal_joints deg",
    "attitude_step rad",
    "joint_steps rad",
    "joint_limits deg",
    "held",
    "cones",
    "grouped_cones",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """The numbers of a search problem, as the kernels take them.

    Attributes:
        cones: the rows that ask something of one device at a time, padded.
        grouped_cones: those that couple devices, padded apart: of constraints of which one entry must hold,
            and about another device's boresight.
        mounts: (n,) rad.
        fixed_boresights: (i, 3) body axes.
        joint_limits: (2n,) rad.
        attitude_step: rad.
        joint_steps: (2n,) rad.
        start_attitude: (3, 3); with the joints, the root of the search.
        start_joints: (2n,) rad.
        goal_attitude: (3, 3).
        goal_joints: (2n,) rad.
        held: (n,) bool, terminals that a search should keep in a keep-in zone, see above.
        held_axes: (n, 3) axis of that zone, inertial.
        goal_quaternion: (4,) of the goal relative to the start.
        goal_coordinates: (3,) rotation vector of the goal relative to the start, rad.
    """

    cones: Constraints
    grouped_cones: Constraints
    mounts: np.ndarray
    fixed_boresights: np.ndarray
    joint_limits: np.ndarray
    attitude_step: float
    joint_steps: np.ndarray
    start_attitude: np.ndarray
    start_joints: np.ndarray
    goal_attitude: np.ndarray
    goal_joints: np.ndarray
    held: np.ndarray
    held_axes: np.ndarray
    goal_quaternion: np.ndarray
    goal_coordinates: np.ndarray

    @property
    def sights(self) -> Sights:
        """What the constraints bind."""
        return self.cones.sights(self.mounts, self.fixed_boresights)

    def seen(self, attitude: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Inertial directions (..., S, 3) of all sights at attitudes (..., 3, 3) and joints (..., 2n)."""
        return np.asarray(self.sights.in_body(joints) @ np.swapaxes(attitude, -1, -2))

    @cached_property
    def straight_steps(self) -> float:
        """Cost in steps of the straight motion from start to goal; no path costs less."""
        change = self.goal_joints - self.start_joints
        return float(steps_between(self, np.linalg.norm(self.goal_coordinates), change))

    @cached_property
    def on_device(self) -> "Scene":
        """The same as arrays that jitted functions take without a copy, in 64 bits."""
        with jax.enable_x64(True):
            return _same(self)


_same = jax.jit(lambda scene: scene)  # a fifth of the time that jax.device_put takes for many leaves


@shown("status", "expansions", "path.length steps", "path.edges", "queue_expansions")
@dataclass(frozen=True, kw_only=True, eq=False)
class SearchResult:
    """The answer of step 2.

    Attributes:
        status: OK, NODE_LIMIT, TIME_LIMIT or NO_PATH.
        path: from start to goal, None unless the status is OK.
        expansions: nodes expanded.
        queue_expansions: how many of them each queue asked for, the anchor's first; of `mha` the last number
            is that of the trees.
    """

    status: Status
    path: Path | None
    expansions: int
    queue_expansions: tuple[int, ...] = field(default=())


def make_scene(scenario: Scenario, goal: Goal, constraints: Constraints | None = None) -> Scene:
    """Collect the numbers of one search.

    Args:
        scenario: the problem; its settings give the steps.
        goal: where to go.
        constraints: what must hold, none of it moving; the scenario's own unless told.
    """
    craft, start = scenario.spacecraft, scenario.start
    rows = scenario.constraints if constraints is None else constraints
    goal_quaternion, goal_coordinates = _relative(start.attitude, np.asarray(goal.attitude, float))
    held, axes = held_axes(craft, rows, start, goal)
    coupled = ~rows.single | (rows.frame == SIGHT)
    return Scene(
        cones=rows.part(~coupled & (rows.zone >= 0)),
        grouped_cones=rows.part(coupled & (rows.zone >= 0)),
        mounts=craft.mounts,
        fixed_boresights=craft.fixed_boresights,
        joint_limits=craft.joint_limits,
        attitude_step=float(scenario.search.attitude_step),
        joint_steps=joint_steps(scenario),
        start_attitude=start.attitude,
        start_joints=np.asarray(start.joints, float),
        goal_attitude=np.asarray(goal.attitude, float),
        goal_joints=np.asarray(goal.joints, float),
        held=held,
        held_axes=axes,
        goal_quaternion=goal_quaternion,
        goal_coordinates=goal_coordinates,
    )


def _relative(start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    turned = quaternion.from_matrix(start.T @ goal)
    return turned, quaternion.log(turned)


def derived_seed(seed: int, *key: int) -> int:
    """A seed for a further search, independent of the seed itself and of those with other keys."""
    return int(np.random.SeedSequence(seed, spawn_key=key).generate_state(1)[0])


def joint_steps(scenario: Scenario) -> np.ndarray:
    """(2n,) rad a step of each joint: the joint step times its terminal's scale."""
    search: SearchSettings = scenario.search
    scales = [search.terminal_step_scale.get(t.name, 1.0) for t in scenario.spacecraft.terminals]
    return search.joint_step * np.array(scales * 2, dtype=float)


def steps_between(scene: Scene, rotation: ArrayLike, joint_change: np.ndarray) -> np.ndarray:
    """Cost of straight motions in steps, `jaxplan.model.path.step_cost` in numpy.

    Args:
        scene: gives the steps.
        rotation: (...) rad.
        joint_change: (..., 2n) rad.
    """
    joint = np.max(np.abs(joint_change) / scene.joint_steps, axis=-1, initial=0.0)
    return np.maximum(np.asarray(rotation) / scene.attitude_step, joint)
