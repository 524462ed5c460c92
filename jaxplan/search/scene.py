"""The problem and the result of step 2: the numbers of one search as kernels take them, and what was found.

A terminal that a keep-in zone binds by itself must stay in that zone all the time. One that a zone of a group
binds need not, as another zone of the group may hold instead; but as long as none does it has to follow its
zone, and hardly any random motion would. Both are *held*: a search may keep them on the axis of their zone;
of a group it is the zone that the terminal looks nearest to at start or goal. This only guides a search;
whether a motion is clear is decided by the margins.

2n stands for the number of all joints, J, drives counted too. A step is a unit of cost: `attitude_step` of
rotation, or the joint's entry of `joint_steps`.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import AnyArray, array_module
from jaxplan.model.constraints import INERTIAL, SIGHT, Constraints
from jaxplan.model.directions import Sights
from jaxplan.model.gimbals import Gimbals
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.model.zones import KeepIn
from jaxplan.runtime.display import shown

# The wanted clearance grows from nothing to its full value over this many steps from start and goal.
TAPER_STEPS = 4.0
# Times the half angle of a keep-in zone; in steps of the platform up to that, paths are found in the zone.
NARROW_STEP = 2.0
# rad; shorter steps than this ask for more nodes than any search expands.
LEAST_STEP = 1e-3
# Steps that nodes keep from joint limits where start and goal allow: a trajectory swings past its nodes.
JOINT_RESERVE = 0.2


@shown(
    "goal_coordinates deg",
    "start_joints deg",
    "goal_joints deg",
    "attitude_step rad",
    "joint_steps rad",
    "joint_ranges deg",
    "cones",
    "grouped_cones",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """The numbers of a search problem, as the kernels take them.

    Attributes:
        cones: the rows of constraints that bind one device at a time, padded.
        grouped_cones: the rows that couple devices, padded apart: those of constraints with several entries,
            of which one must hold, and those about another device's boresight.
        gimbals: how the joints turn devices.
        fixed_boresights: (i, 3) unit vectors in body axes, boresights of the i instruments.
        joint_ranges: (J, 2) rad, least and largest angle of each joint.
        attitude_step: rad, rotation of the platform in one step.
        joint_steps: (2n,) rad, change of each joint in one step.
        start_attitude: (3, 3) body to inertial; with the joints, the root of the search.
        start_joints: (2n,) rad.
        goal_attitude: (3, 3) body to inertial.
        goal_joints: (2n,) rad.
        goal_quaternion: (4,) unit quaternion of the goal relative to the start, scalar first and not
            negative.
        goal_coordinates: (3,) rotation vector of the goal relative to the start, rad.
    """

    cones: Constraints
    grouped_cones: Constraints
    gimbals: Gimbals
    fixed_boresights: np.ndarray
    joint_ranges: np.ndarray
    attitude_step: float
    joint_steps: np.ndarray
    start_attitude: np.ndarray
    start_joints: np.ndarray
    goal_attitude: np.ndarray
    goal_joints: np.ndarray
    goal_quaternion: np.ndarray
    goal_coordinates: np.ndarray

    @property
    def tables(self) -> tuple[Constraints, Constraints]:
        """All constraints: the rows that bind one device at a time, and those that couple devices."""
        return self.cones, self.grouped_cones

    @property
    def sights(self) -> Sights:
        """The *sights*: directions, such as boresights, that constraints bind."""
        return self.cones.sights(self.gimbals, self.fixed_boresights)

    @cached_property
    def ends(self) -> np.ndarray:
        """Start and goal as states (2, 4 + 2n): unit quaternion relative to the start, and joints."""
        start = np.concatenate([[1.0, 0.0, 0.0, 0.0], self.start_joints])
        return np.stack([start, np.concatenate([self.goal_quaternion, self.goal_joints])])

    @cached_property
    def seen(self) -> np.ndarray:
        """Inertial directions (2, S, 3) of all S sights at start and goal."""
        joints = np.stack([self.start_joints, self.goal_joints])
        attitudes = np.stack([self.start_attitude, self.goal_attitude])
        return np.asarray(self.sights.in_body(joints) @ np.swapaxes(attitudes, -1, -2))

    @cached_property
    def held_axes(self) -> dict[int, np.ndarray]:
        """Inertial axes (3,) of the zones on which terminals are held, by the terminal's number."""
        axes: dict[int, np.ndarray] = {}
        for terminal, looks in enumerate(self.seen[:, : self.gimbals.terminals].swapaxes(0, 1)):
            alone, grouped = (
                rows.axis[(rows.side < 0) & (rows.frame == INERTIAL) & rows.bound[:, terminal]]
                for rows in self.tables
            )
            if len(alone):
                axes[terminal] = alone[0]
            elif len(grouped):
                axes[terminal] = grouped[np.argmax(np.max(grouped @ looks.T, axis=1))]
        return axes

    @cached_property
    def straight_steps(self) -> float:
        """Cost in steps of the straight motion from start to goal; no path costs less."""
        change = self.goal_joints - self.start_joints
        return float(steps_between(self, np.linalg.norm(self.goal_coordinates), change))

    @cached_property
    def packed(self) -> tuple["Layout", np.ndarray]:
        """The layout of the scene's numbers, and all of them in one float64 vector, as kernels take them."""
        leaves, structure = jax.tree.flatten(self)
        arrays = [np.asarray(leaf) for leaf in leaves]
        kinds = "".join(array.dtype.char for array in arrays)
        layout = Layout(structure, tuple(array.shape for array in arrays), kinds)
        return layout, np.concatenate([array.ravel() for array in arrays], dtype=float)


@shown("shapes", "kinds")
@dataclass(frozen=True, slots=True)
class Layout:
    """Where the numbers of a scene lie in its vector; vectors of the same layout can be stacked.

    Attributes:
        structure: structure of the pytree that a scene is.
        shapes: shapes of its leaves.
        kinds: the dtype character of each leaf.
    """

    structure: Any
    shapes: tuple[tuple[int, ...], ...]
    kinds: str

    def scene(self, vector: Array) -> Scene:
        """Return the scene whose numbers a vector holds, for use in a kernel."""
        ends = np.cumsum([math.prod(shape) for shape in self.shapes])
        parts = zip(jnp.split(vector, ends[:-1]), self.shapes, self.kinds, strict=True)
        leaves = [part.reshape(shape).astype(kind) for part, shape, kind in parts]
        scene: Scene = jax.tree.unflatten(self.structure, leaves)
        return scene


@shown("status", "expansions", "path.length steps", "path.edges", "queue_expansions")
@dataclass(frozen=True, kw_only=True, eq=False)
class SearchResult:
    """The result of step 2.

    Attributes:
        status: OK, NODE_LIMIT, TIME_LIMIT or NO_PATH.
        path: the path from start to goal, None unless the status is OK.
        expansions: number of nodes expanded.
        queue_expansions: how many of them each queue asked for, the anchor's first; with `mha` the last
            number is that of the trees.
    """

    status: Status
    path: Path | None
    expansions: int
    queue_expansions: tuple[int, ...] = ()


def make_scene(scenario: Scenario, goal: Goal, constraints: Constraints | None = None) -> Scene:
    """Make the scene of one search from a scenario's start to a goal.

    Args:
        scenario: the problem; its settings give the steps.
        goal: attitude and joints at the end.
        constraints: what must hold, none of it moving; None for the scenario's own.
    """
    craft, start = scenario.usable, scenario.start
    rows = scenario.constraints if constraints is None else constraints
    turn = quaternion.from_matrix(start.attitude.T @ np.asarray(goal.attitude, float))
    coupled = ~rows.single | (rows.frame == SIGHT)
    return Scene(
        cones=rows.part(~coupled & (rows.zone >= 0)),
        grouped_cones=rows.part(coupled & (rows.zone >= 0)),
        gimbals=craft.gimbals,
        fixed_boresights=craft.fixed_boresights,
        joint_ranges=craft.joint_ranges,
        attitude_step=float(scenario.search.attitude_step),
        joint_steps=joint_steps(scenario),
        start_attitude=start.attitude,
        start_joints=np.asarray(start.joints, float),
        goal_attitude=np.asarray(goal.attitude, float),
        goal_joints=np.asarray(goal.joints, float),
        goal_quaternion=turn,
        goal_coordinates=quaternion.log(turn),
    )


def narrow_zone(scenario: Scenario) -> KeepIn | None:
    """Return the keep-in zone that asks for the shortest step, if that is shorter than the settings' step.

    An edge of one step in a zone is seen to stay there only if the zone is wide enough for a bound of how far
    the edge may swing out. Zones of groups need not hold, and what moves is widened to what it sweeps; None
    is returned for these.
    """
    cones = [
        zone for zone in scenario.keep_in if zone.inside is None and zone.any_of is None and zone.is_inertial
    ]
    narrowest = min(cones, key=lambda zone: zone.half_angle, default=None)
    if narrowest is None or _step_in(narrowest, scenario) >= scenario.search.attitude_step:
        return None
    return narrowest


def _step_in(zone: KeepIn, scenario: Scenario) -> float:
    """Return a step of the platform, rad, that is short enough for a keep-in zone without the tube."""
    tube = scenario.robust
    reserve = 0.0 if tube is None else tube.attitude_error + tube.joint_error
    return max(NARROW_STEP * (float(zone.half_angle) - reserve), LEAST_STEP)


def in_narrow_zones(scenario: Scenario, scene: Scene) -> Scene | None:
    """Return the scene with a step of the platform that is short enough for the narrowest keep-in zone.

    None if its step is short enough already, or if no zone asks for a shorter one.
    """
    zone = narrow_zone(scenario)
    step = math.inf if zone is None else _step_in(zone, scenario)
    return replace(scene, attitude_step=step) if step < scene.attitude_step else None


def derived_seed(seed: int, *key: int) -> int:
    """Return a seed for a further search, independent of the seed itself and of those with other keys."""
    return int(np.random.SeedSequence(seed, spawn_key=key).generate_state(1)[0])


def joint_steps(scenario: Scenario) -> np.ndarray:
    """Return the change of each joint in one step, (J,) rad, with the scale of its device."""
    search, craft = scenario.search, scenario.usable
    owners = [one.name for one in craft.terminals] * 2 + [one.name for one in craft.drives]
    scales = [search.terminal_step_scale.get(name, 1.0) for name in owners]
    return search.joint_step * np.array(scales, dtype=float)


def tapered(clearance: AnyArray, steps: AnyArray) -> AnyArray:
    """Return the clearance wanted at some steps from start or goal, (...) rad.

    It is zero there and grows linearly to its full value after `TAPER_STEPS`.

    Args:
        clearance: rad, wanted far from both.
        steps: (...) steps to the nearer of start and goal; below zero no clearance is wanted.
    """
    xp = array_module(clearance, steps)
    return clearance * xp.maximum(xp.minimum(steps / TAPER_STEPS, 1), 0)


def steps_between(scene: Scene, rotation: ArrayLike, joint_change: np.ndarray) -> np.ndarray:
    """Return the cost of straight motions in steps, as `jaxplan.model.path.step_cost` does, in numpy.

    Args:
        scene: gives the steps.
        rotation: (...) rad, rotation of the platform.
        joint_change: (..., 2n) rad.
    """
    joint = np.max(np.abs(joint_change) / scene.joint_steps, axis=-1, initial=0.0)
    return np.maximum(np.asarray(rotation) / scene.attitude_step, joint)
