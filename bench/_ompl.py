"""OMPL's RRTConnect with path simplification on the problems of step 2.

The space is SO(3), whose distance is half of the rotation and therefore counts twice, times the box of the
joints. What a Python user can do for speed is done: a whole motion is one call of the checker; OMPL itself
copies states into the array that the checker reads; the time limit is looked at between expansions, where
``solve(seconds)`` would start a thread and wait for it at the end; spaces and checkers are made before the
clock runs.
"""

import ctypes
import time

import jax
import numpy as np
from _motion_checkers import Checker, zone_table
from _options import MISSING
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Path
from jaxplan.search import Scene
from jaxplan.search.paths import subdivide

try:
    from ompl import base, geometric, util
except ModuleNotFoundError as missing:
    raise SystemExit(MISSING.format(missing.name, "bench")) from None

TIME_LIMIT = 5.0  # s, of one search
util.setLogLevel(util.LogLevel.LOG_NONE)

_make_capsule = ctypes.pythonapi.PyCapsule_New
_make_capsule.restype = ctypes.py_object
_make_capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
_POINTER = ctypes.c_char_p(b"nb_handle")  # by this name OMPL's bindings know a pointer


class _Motions(base.MotionValidator):
    """OMPL's validator of motions and states, which asks a checker.

    Args:
        information: OMPL's, of the space.
        space: of attitudes and joints.
        scene: the problem.
        check: the checker.
        resolution: rad between samples of a motion.
    """

    def __init__(
        self,
        information: base.SpaceInformation,
        space: base.CompoundStateSpace,
        scene: Scene,
        check: Checker,
        resolution: float,
    ) -> None:
        super().__init__(information)
        self.motion = np.zeros((2, 4 + len(scene.joint_ranges)))
        self.first, self.last = (_make_capsule(row.ctypes.data, _POINTER, None) for row in self.motion)
        self.copy = space.serialize
        frames = scene.gimbals.frames
        mounts = np.arctan2(frames[:, 1, 0], frames[:, 0, 0])  # of terminals that yaw about z
        self.check, self.arguments = check, (mounts, zone_table(scene), resolution)

    def checkMotion(self, first: base.State, last: base.State) -> bool:
        self.copy(self.first, first)
        self.copy(self.last, last)
        return self.check(self.motion, *self.arguments)

    def holds(self, state: base.State) -> bool:
        return self.checkMotion(state, state)

    def row(self, state: base.State) -> np.ndarray:
        """A state of OMPL as an array (4 + 2n,): quaternion x, y, z, w and joints, rad."""
        self.copy(self.first, state)
        return self.motion[0].copy()


class Rival:
    """OMPL's RRTConnect on one scene.

    Args:
        scene: the problem; its zones bind one by one, without groups.
        check: one of `_motion_checkers`.
        resolution: rad by which platform and joints move between samples of a motion.
        extent: rad that a tree grows at once, OMPL's ``range``; 0 for OMPL's own choice, a fifth of the
            space's extent.
    """

    def __init__(self, scene: Scene, check: Checker, *, resolution: float, extent: float) -> None:
        self.scene, self.extent = scene, extent
        self.space = base.CompoundStateSpace()
        self.space.addSubspace(base.SO3StateSpace(), 2.0)
        self.space.addSubspace(_box(scene.joint_ranges), 1.0)
        self.setup = geometric.SimpleSetup(self.space)
        self.information = self.setup.getSpaceInformation()
        self.motions = _Motions(self.information, self.space, scene, check, resolution)
        self.information.setMotionValidator(self.motions)
        self.setup.setStateValidityChecker(self.motions.holds)
        self.information.setup()
        self.ends = (
            self._state(scene.start_attitude, scene.start_joints),
            self._state(scene.goal_attitude, scene.goal_joints),
        )

    def solve(self, seed: int) -> tuple[float, Path | None]:
        """Search for a path and simplify it; the same seed makes the same path.

        Args:
            seed: 0 or more.

        Returns:
            The seconds it took, and the path in edges of at most one step, None where there is none.
        """
        util.RNG.setSeed(seed + 1)  # 0 would be taken from the clock
        self.setup.clear()
        self.setup.setStartAndGoalStates(*self.ends)
        planner = geometric.RRTConnect(self.information)
        if self.extent:
            planner.setRange(self.extent)
        self.setup.setPlanner(planner)
        self.setup.setup()
        begin = time.perf_counter()
        self.setup.solve(base.timedPlannerTerminationCondition(TIME_LIMIT))
        found = self.setup.haveExactSolutionPath()
        if found:
            self.setup.simplifySolution()
        seconds = time.perf_counter() - begin
        return seconds, self._path() if found else None

    def _state(self, attitude: np.ndarray, joints: np.ndarray) -> base.State:
        """A state of OMPL from an attitude (3, 3), body to inertial, and joints (2n,) rad."""
        state = self.space.allocState()
        turn = state[0]
        turn.x, turn.y, turn.z, turn.w = Rotation.from_matrix(attitude).as_quat().tolist()
        state[1][0 : len(joints)] = joints.tolist()
        return state

    def _path(self) -> Path:
        """OMPL's solution as a path, in edges of at most one step."""
        solution = self.setup.getSolutionPath()
        states = [solution.getState(i) for i in range(solution.getStateCount())]
        rows = np.array([self.motions.row(state) for state in states])
        with jax.enable_x64(True):
            start = Rotation.from_matrix(self.scene.start_attitude)
        since = (start.inv() * Rotation.from_quat(rows[:, :4])).as_quat(scalar_first=True)
        return subdivide(self.scene, np.concatenate([since, rows[:, 4:]], axis=1))


def _box(ranges: np.ndarray) -> base.RealVectorStateSpace:
    """OMPL's space of the joints within ranges (2n, 2) rad."""
    space, bounds = base.RealVectorStateSpace(len(ranges)), base.RealVectorBounds(len(ranges))
    for joint, (low, high) in enumerate(ranges.tolist()):
        bounds.setLow(joint, low)
        bounds.setHigh(joint, high)
    space.setBounds(bounds)
    return space
