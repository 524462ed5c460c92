"""What is asked of the planner: spacecraft, start, goal, zones and settings; and what of it moves.

Frozen dataclasses, in radians and seconds. Lists may stand for arrays and tuples, and any real number for a
float: planning takes them for what the attributes below say, as does all that reads or writes a scenario.
Checks live there: JAX rebuilds the dataclasses with tracers inside, so nothing here may look at a value.
Numbers that may be tuned are leaves; counts, names and choices are static.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.equality import same
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import JointBound, KeepIn, KeepOut, Zone, tabulate
from jaxplan.runtime.display import shown
from jaxplan.runtime.once import made_once

# `search.add_planner` adds to them.
SEARCH_METHODS = ["mha", "mha-paper", "wastar", "rrt_star", "rrt_connect"]
TRAJECTORY_METHODS = ("global", "paper")
END_ACCELERATIONS = ("zero", "free")


@jax.tree_util.register_static
class Word(str):
    """A word that stands in a number's place; to JAX it is no leaf, so mapping over leaves passes it by."""

    __slots__ = ()


STRETCHED = Word("stretched")
MINIMUM = Word("minimum")


# Rates that are left out: zeros once a scenario is planned, when it is known how many.
_AT_REST: Any = None


def _static(**kwargs: Any) -> Any:
    return field(metadata={"static": True}, **kwargs)


@shown("rotation_vector deg", "joints deg", "angular_velocity deg/s", "joint_rates deg/s")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class GivenState:
    """An attitude with joint angles: the start, or a goal that is given.

    Attributes:
        rotation_vector: (3,) rad; the attitude, body to inertial, is its exponential.
        joints: (2n,) rad, all yaws then all pitches.
        angular_velocity: (3,) rad/s, body axes; zero if left out.
        joint_rates: (2n,) rad/s; zero if left out.
    """

    rotation_vector: np.ndarray
    joints: np.ndarray
    angular_velocity: np.ndarray = _AT_REST
    joint_rates: np.ndarray = _AT_REST

    paths: ClassVar[tuple[DirectionPath, ...]] = ()  # as of targets: nothing that it points at moves
    moves: ClassVar[bool] = False

    @property
    @made_once
    def attitude(self) -> np.ndarray:
        """(3, 3), body to inertial."""
        attitude: np.ndarray = so3.exp(self.rotation_vector)
        return attitude


@shown("directions", "yaw_limit deg", "pitch_limit deg", "angular_velocity deg/s", "joint_rates deg/s")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Targets:
    """A goal given as directions: step 1 finds attitude and joints.

    Attributes:
        directions: (n, 3) inertial unit vectors, one a terminal; where some move a tuple of what each is, a
            vector (3,) or its path. These are met where they are at the end, and at their rates.
        yaw_limit: rad, tighter than the joints' own at the goal; None for those.
        pitch_limit: likewise.
        angular_velocity: (3,) rad/s at the goal, body axes; zero if left out, as it must be where some move.
        joint_rates: (2n,) rad/s at the goal; likewise.
    """

    directions: Any
    yaw_limit: float | None = None
    pitch_limit: float | None = None
    angular_velocity: np.ndarray = _AT_REST
    joint_rates: np.ndarray = _AT_REST

    @property
    def paths(self) -> tuple[DirectionPath, ...]:
        """The directions over time."""
        return tuple(as_path(direction) for direction in self.directions)

    @property
    def moves(self) -> bool:
        """Whether any moves."""
        each = self.directions if isinstance(self.directions, list | tuple) else ()
        return any(isinstance(direction, DirectionPath) and direction.moves for direction in each)

    def at(self, time: ArrayLike) -> Self:
        """The targets where they are at an instant, s; of such as move, at rest."""
        if not self.moves:
            return self
        each = [path.at(time) for path in self.paths]
        seen = array_module(*each).stack(each)
        return replace(
            self, directions=seen, angular_velocity=np.zeros(3), joint_rates=np.zeros(2 * len(seen))
        )

    def rates(self, time: ArrayLike) -> AnyArray:
        """(n, 3) 1/s, how fast the directions turn at an instant, s."""
        each = [path.rate(time) for path in self.paths]
        return array_module(*each).stack(each) if each else np.zeros((0, 3))


@shown(
    "method",
    "attitude_step rad",
    "joint_step rad",
    "terminal_step_scale",
    "heuristic_weight",
    "anchor_weight",
    "attitude_moves",
    "clearance deg",
    "max_expansions",
    "time_limit s",
    "max_goals",
    "improvements",
    "seed",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class SearchSettings:
    """Settings of step 2.

    Attributes:
        method: name of the planner.
        attitude_step: rad, ``delta_SO(3)``.
        joint_step: rad, ``delta_h``.
        terminal_step_scale: factor on the joint step of named terminals.
        heuristic_weight: ``w1``, at least 1.
        anchor_weight: ``w2``, at least 1.
        attitude_moves: random unit vectors drawn for an expansion.
        clearance: rad, wanted beyond the zones; it tapers to zero at start and goal.
        max_expansions: a search gives up after as many; of `mha` half of those beyond 48 are for trees. A
            plan may need several searches.
        time_limit: s, infinite for none ("off" in files); what is spent on compiling does not count.
        max_goals: how many distinct goals of step 1 may be tried.
        improvements: how many further searches may look for a shorter path once one is found, while
            expansions and time are left; only `mha` makes them.
        seed: of every random choice.
    """

    method: str = _static(default="mha")
    attitude_step: float = 0.1
    joint_step: float = 0.1
    terminal_step_scale: dict[str, float] = field(default_factory=dict)
    heuristic_weight: float = 8.0
    anchor_weight: float = 2.0
    attitude_moves: int = _static(default=6)
    clearance: float = math.radians(0.5)
    max_expansions: int = _static(default=2000)
    time_limit: float = _static(default=60.0)
    max_goals: int = _static(default=3)
    improvements: int = _static(default=0)
    seed: int = _static(default=0)


@shown(
    "method",
    "duration s",
    "segments",
    "order",
    "rate_weight",
    "acceleration_weight",
    "jerk_weight",
    "node_tube deg",
    "end_acceleration",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectorySettings:
    """Settings of step 3.

    Attributes:
        method: name of the method.
        duration: s; `STRETCHED` (equal to "stretched") for the shortest uniform time scaling within all
            limits; `MINIMUM` (equal to "minimum"), of "global" only, for the shortest motion within limits
            and zones.
        segments: of "paper", at least as many quadratic programs along the path; None for as few as its
            length allows.
        order: of "paper", of the Legendre basis, ``l``.
        rate_weight: ``lambda_1``, on rates; of "paper" the platform's alone.
        acceleration_weight: ``lambda_2``, on accelerations.
        jerk_weight: of "global", on jerks.
        node_tube: of "global", rad, how far nodes may be passed; 0 for exactly, infinite to take them as a
            first guess. None for 1 deg, and in the shortest motion for infinite.
        end_acceleration: of "global", "zero" or "free" at start and goal.
        optimal: of "global", whether a fit goes on to the optimum, whose derivatives `jp.differentiable` has;
            else it may end some thousandths of its energy above.
    """

    method: str = _static(default="global")
    duration: float | str = STRETCHED
    segments: int | None = _static(default=None)
    order: int = _static(default=12)
    rate_weight: float = 1.0
    acceleration_weight: float = 3.0
    jerk_weight: float = 30.0
    node_tube: float | None = None
    end_acceleration: str = _static(default="zero")
    optimal: bool = _static(default=False)

    @property
    def timed(self) -> bool:
        """Whether the duration is given, rather than what the motion takes."""
        return not isinstance(self.duration, str)


@shown(
    "spacecraft.terminals",
    "spacecraft.instruments",
    "keep_out",
    "keep_in",
    "joint_bounds",
    "goal",
    "start",
    "trajectory.duration s",
    "search",
    "trajectory",
    "epoch",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Scenario:
    """A planning problem with its settings.

    Two of them are equal if they say the same, in lists or arrays, in full or in short, with numbers to
    within the rounding of an angle that goes to degrees and back (`jaxplan.model.equality`).

    Attributes:
        name: for titles and tables.
        spacecraft: platform, terminals and instruments.
        start: the state the manoeuvre starts from.
        goal: directions to point at, of which some may move, or a given state.
        keep_out: cones to stay out of.
        keep_in: cones to stay in.
        joint_bounds: half-planes of joint angles to stay in.
        search: settings of step 2.
        trajectory: settings of step 3.
        epoch: UTC of the manoeuvre's start, which is that of what bodies and satellites stand for; None where
            it is no matter.
    """

    name: str = _static()
    spacecraft: Spacecraft
    start: GivenState
    goal: Targets | GivenState
    keep_out: tuple[KeepOut, ...] = ()
    keep_in: tuple[KeepIn, ...] = ()
    joint_bounds: tuple[JointBound, ...] = ()
    search: SearchSettings = field(default_factory=SearchSettings)
    trajectory: TrajectorySettings = field(default_factory=TrajectorySettings)
    epoch: np.datetime64 | None = field(default=None, metadata={"static": True})

    @property
    def zones(self) -> tuple[Zone, ...]:
        """All pointing constraints, in the order of `constraints`."""
        return (*self.keep_out, *self.keep_in, *self.joint_bounds)

    @property
    @made_once
    def constraints(self) -> Constraints:
        """The same as rows."""
        craft = self.spacecraft
        return tabulate(
            self.keep_out,
            self.keep_in,
            craft.device_names,
            joint_bounds=self.joint_bounds,
            terminals=len(craft.terminals),
        )

    def __eq__(self, other: object) -> bool:
        return same(self, other) if isinstance(other, Scenario) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.name)  # the same for equal ones, and never a tracer


def paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """All that moves, with its name in messages: zones by theirs, targets by their terminal's."""
    for zone in scenario.zones:
        if zone.moves and zone.path is not None:
            yield f"zone {zone.name}", zone.path
    if scenario.goal.moves:
        for terminal, path in zip(scenario.spacecraft.terminals, scenario.goal.paths, strict=True):
            if path.moves:
                yield f"the target of {terminal.name}", path


def moves(scenario: Scenario) -> bool:
    """Whether a zone or a target moves."""
    return next(paths(scenario), None) is not None


def known_until(scenario: Scenario) -> tuple[float, str]:
    """Until when all that moves is known, s, and what is not from then on; infinite where nothing moves."""
    ends = [(float(path.times[-1]), name) for name, path in paths(scenario)]
    return min(ends, default=(np.inf, ""))
