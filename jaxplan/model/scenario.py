"""The planning problem as data: spacecraft, start, goal, zones and settings; and which parts of it move.

Planning has three steps: step 1 finds goal states, step 2 searches a path to one of them, step 3 runs a
trajectory along the path. The classes are frozen dataclasses, in radians and seconds. Lists may stand for
arrays and tuples, and any real number for a float: whatever plans, reads or writes a scenario first converts
them to the types that are given below, and checks them. Nothing in this module may look at a value, since JAX
rebuilds the dataclasses with tracers inside. Numbers that may be tuned are leaves of the JAX tree; counts,
names and choices are static.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import jax
import numpy as np

from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.equality import same
from jaxplan.model.file_keys import key, keyed
from jaxplan.model.goals import LEAST_ROTATION, LEAST_TIME, GivenState, Targets
from jaxplan.model.hidden_spans import after_hidden
from jaxplan.model.robust import Robust, usable
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import bound_by, tabulate
from jaxplan.model.zones import JointBound, KeepIn, KeepOut, Turns, Zone, masks
from jaxplan.runtime.compute_once import made_once
from jaxplan.runtime.display import shown

# Names of planners; `search.add_planner` adds to them.
SEARCH_METHODS = ["mha", "mha-paper", "wastar", "rrt_star", "rrt_connect"]
TRAJECTORY_METHODS = ("global", "paper")
END_ACCELERATIONS = ("zero", "free")
_LONGEST = "1e7"  # s, as files have it
LONGEST_DURATION = float(_LONGEST)
"""s, the longest duration that can be asked for, and that a plan may have."""
_STEP_RANGE = "[1e-3, 3.14]"  # rad, range of a search step; a longer turn has a shorter way round


@jax.tree_util.register_static
class Word(str):
    """A word that is given instead of a number.

    JAX takes it for structure, so mapping over leaves skips it.
    """

    __slots__ = ()


STRETCHED = Word("stretched")
MINIMUM = Word("minimum")


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class SearchSettings:
    """Settings of planning step 2, the search for a path. A search expands nodes and moves by steps.

    Attributes:
        method: name of the planner.
        attitude_step: rad, turn of the platform in one step, ``delta_SO(3)`` of the paper.
        joint_step: rad, change of a joint in one step, ``delta_h``.
        terminal_step_scale: factors on the joint step, by names of terminals.
        heuristic_weight: ``w1``, at least 1.
        anchor_weight: ``w2``, at least 1.
        attitude_moves: number of random directions of rotation that are tried when a node is expanded.
        clearance: rad, margin wanted beyond the zones; it tapers to zero at start and goal.
        max_expansions: number of expansions after which a search gives up; `mha` leaves half of those beyond
            48 to random trees. A plan may need several searches.
        time_limit: s, infinite for none ("off" in files); compile time does not count.
        max_goals: largest number of goals of step 1 that are tried.
        improvements: largest number of further searches for a shorter path once one is found, while
            expansions and time are left; only `mha` makes them.
        seed: seed of all random choices.
    """

    method: str = keyed("mha", "method", "the planner", options=SEARCH_METHODS, always=True, static=True)
    attitude_step: float = keyed(
        0.1, "attitude_step_rad", "turn of the platform in a step, delta_SO(3) of the paper", _STEP_RANGE
    )
    joint_step: float = keyed(
        0.1, "joint_step_rad", "change of a joint in a step, delta_h of the paper", _STEP_RANGE
    )
    terminal_step_scale: dict[str, float] = field(
        default_factory=dict,
        metadata=key("terminal_step_scale", "factors on the joint step", "[1e-3, 1e3]", kind="factors"),
    )
    heuristic_weight: float = keyed(8.0, "heuristic_weight", "w1 of the paper", "[1, 1e6]")
    anchor_weight: float = keyed(2.0, "anchor_weight", "w2 of the paper", "[1, 1e6]")
    attitude_moves: int = keyed(6, "attitude_moves", "random turns an expansion", "[1, 256]", static=True)
    clearance: float = keyed(
        math.radians(0.5), "clearance_deg", "wanted beyond zones, tapering to zero at both ends", "[0, 90)"
    )
    max_expansions: int = keyed(
        2000, "max_expansions", "a search gives up after them", "[1, inf)", static=True
    )
    time_limit: float = keyed(
        60.0,
        "time_limit_s",
        "what a plan may take, compiling aside",
        "(0, inf)",
        words={"off": math.inf},
        static=True,
    )
    max_goals: int = keyed(3, "max_goals", "goals of step 1 that may be tried", "[1, 100]", static=True)
    improvements: int = keyed(0, "improvements", "searches for shorter paths", "[0, 10000]", static=True)
    seed: int = keyed(0, "seed", "of every random choice", "[0, inf)", static=True)


@shown()
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectorySettings:
    """Settings of planning step 3, the trajectory.

    Attributes:
        method: "global" or "paper". Settings that belong to the other method have no effect, so that one may
            change the method alone.
        duration: s; or `STRETCHED` ("stretched") for the shortest uniform time scaling within all limits; or
            `MINIMUM` ("minimum"), for "global" only, for the shortest motion within limits and zones.
        segments: for "paper": the least number of quadratic programs along the path; None for as few as its
            length allows.
        order: for "paper": degree of the Legendre basis, ``l``.
        rate_weight: ``lambda_1``, weight of rates in the cost; for "paper" of the platform's alone.
        acceleration_weight: ``lambda_2``, weight of accelerations.
        jerk_weight: for "global": weight of jerks.
        node_tube: for "global": distance, rad, at which the motion may pass the nodes of the path. 0 for
            exactly through them; infinite to use them as a first guess only. None for 1 deg, and for infinite
            in the shortest motion.
        end_acceleration: for "global": whether accelerations at start and goal are "zero" or "free".
        first_guesses: for the shortest motion: number of curves bent away from the path from which it is also
            optimized, and half as many paths of other searches (those that look quickest of six times as
            many), where the lower bound of the duration leaves something to gain; 0 for none.
        optimal: for "global": whether the fit continues to the optimum, whose derivatives `jp.differentiable`
            gives; otherwise it may end with a cost some thousandths above.
    """

    method: str = keyed(
        "global",
        "method",
        "the method; a key that is said to be of the other one has no effect",
        options=TRAJECTORY_METHODS,
        always=True,
        static=True,
    )
    duration: float | str = keyed(
        STRETCHED,
        "duration_s",
        "or as short as scaling the time, or any motion, allows",
        f"[1e-3, {_LONGEST}]",
        words={"stretched": STRETCHED, "minimum": MINIMUM},
    )
    segments: int | None = keyed(
        None, "segments", "of paper, at least; if absent as few as the path allows", "[1, 1000]", static=True
    )
    # Position, rate and acceleration at both ends take six coefficients; beyond degree 24 rounding shows.
    order: int = keyed(12, "order", "of paper, degree of the polynomials", "[5, 24]", static=True)
    rate_weight: float = keyed(1.0, "rate_weight", "lambda_1 of the paper", "[0, 1e6]")
    acceleration_weight: float = keyed(3.0, "acceleration_weight", "lambda_2 of the paper", "[1e-6, 1e6]")
    jerk_weight: float = keyed(30.0, "jerk_weight", "of global", "[0, 1e6]")
    node_tube: float | None = keyed(
        None,
        "node_tube_deg",
        'of global, how far off a node may be passed; if absent 1, and for "minimum" inf',
        "[0, 180]",
        words={"inf": math.inf},
    )
    end_acceleration: str = keyed(
        "zero", "end_acceleration", "of global, at start and goal", options=END_ACCELERATIONS, static=True
    )
    first_guesses: int = keyed(
        4,
        "first_guesses",
        'of "minimum", other curves and other paths from which a shorter motion is looked for',
        "[0, 1000]",
        static=True,
    )
    optimal: bool = keyed(
        False,
        "optimal",
        "of global, whether a fit goes on to the optimum, whose derivatives are known",
        static=True,
    )

    @property
    def timed(self) -> bool:
        """Whether the duration is given in seconds, rather than found."""
        return not isinstance(self.duration, str)


@shown(
    "spacecraft.terminals",
    "spacecraft.drives",
    "spacecraft.instruments",
    "keep_out",
    "keep_in",
    "joint_bounds",
    "robust",
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

    Two scenarios are equal if they state the same problem: as lists or arrays, in full or in short form, with
    numbers equal to within the rounding of an angle that goes to degrees and back (`same`).

    Attributes:
        name: name for titles and tables.
        epoch: UTC of the start, for which directions of bodies and satellites were computed; None where it
            does not matter.
        spacecraft: platform, terminals, drives and instruments.
        start: the state from which the manoeuvre starts.
        goal: directions to point at, some of which may move, or a given state.
        keep_out: cones to stay out of.
        keep_in: cones to stay in.
        joint_bounds: half-planes of joint angles to stay in.
        robust: errors of attitude and joints for which zones, masks and ranges must hold, and the reserves of
            torque and momentum; None for none.
        search: settings of step 2.
        trajectory: settings of step 3.
    """

    name: str = field(metadata=key("name", "for titles and tables", static=True))
    epoch: np.datetime64 | None = keyed(
        None,
        "epoch_utc",
        "UTC of the start, for exports; that of [sky] where there is one",
        kind="epoch",
        static=True,
    )
    spacecraft: Spacecraft = field(metadata=key("spacecraft", "platform, terminals and instruments"))
    start: GivenState = field(
        metadata=key("start", "the state the manoeuvre starts from, or what points where then", kind="start")
    )
    goal: Targets | GivenState = field(
        metadata=key("goal", "directions to point at, or a given state", kind="goal")
    )
    keep_out: tuple[KeepOut, ...] = keyed((), "keep_out", "cones to stay out of")
    keep_in: tuple[KeepIn, ...] = keyed((), "keep_in", "cones to stay in")
    joint_bounds: tuple[JointBound, ...] = keyed((), "joint_bound", "half-planes of yaw and pitch to stay in")
    robust: Robust | None = keyed(None, "robust", "errors that the plan must bear")
    search: SearchSettings = field(
        default_factory=SearchSettings, metadata=key("search", "settings of step 2", always=True)
    )
    trajectory: TrajectorySettings = field(
        default_factory=TrajectorySettings, metadata=key("trajectory", "settings of step 3", always=True)
    )

    @property
    def asked(self) -> Targets | GivenState:
        """The goal, with the criterion filled in that follows from the duration if its targets name none."""
        if isinstance(self.goal, GivenState) or self.goal.criterion is not None:
            return self.goal
        duration = self.trajectory.duration
        # Goals of least time do not follow what moves: if anything does, they are only taken when asked for.
        shortest = isinstance(duration, str) and duration == MINIMUM and not moves(self)
        return replace(self.goal, criterion=LEAST_TIME if shortest else LEAST_ROTATION)

    @property
    def cones(self) -> tuple[KeepOut | KeepIn, ...]:
        """The keep-out zones, then the keep-in zones; joint bounds and masks are not among them."""
        return (*self.keep_out, *self.keep_in)

    @property
    def zones(self) -> tuple[Zone, ...]:
        """All pointing constraints: keep-out and keep-in zones, joint bounds and masks of terminals.

        `Constraints.zone` numbers them in this order.
        """
        return (*self.keep_out, *self.keep_in, *self.joint_bounds, *masks(self.spacecraft))

    @property
    @made_once
    def usable(self) -> Spacecraft:
        """The spacecraft with its ranges and limits of torque and momentum reduced to what a plan may use."""
        return self.spacecraft if self.robust is None else usable(self.spacecraft, self.robust)

    @property
    @made_once
    def constraints(self) -> Constraints:
        """All pointing constraints as rows (`jaxplan.model.constraints`), tightened by errors of `robust`."""
        return self.rows()

    @property
    @made_once
    def stated(self) -> Constraints:
        """The rows of `constraints` as users stated the zones, without the errors of `robust`."""
        return self.constraints if self.robust is None else replace(self, robust=Robust()).constraints

    def rows(self, turns: Turns | None = None) -> Constraints:
        """Return the constraints as rows, with masks repeated after given whole turns of the yaw.

        Args:
            turns: for each mask the whole turns (see `jaxplan.model.zones.masks`); None for those at which a
                mask reaches into the range of the yaw.
        """
        return tabulate(
            self.keep_out,
            self.keep_in,
            self.spacecraft,
            joint_bounds=self.joint_bounds,
            turns=turns,
            robust=self.robust,
        )

    @property
    @made_once
    def sight_names(self) -> tuple[str, ...]:
        """Names of all that constraints bind: devices, then edges of fields of view and other vectors."""
        return tuple(bound_by(self.zones, self.spacecraft).names)

    def __eq__(self, other: object) -> bool:
        return same(self, other) if isinstance(other, Scenario) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.name)  # the same for equal ones, and never a tracer


def paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """Yield all paths along which zones, targets or wishes move, each with the name it has in messages."""
    for zone in scenario.zones:
        if zone.moves and zone.path is not None:
            yield f"zone {zone.name}", zone.path
    for device, path in target_paths(scenario):
        yield f"the target of {device}", path
    if isinstance(scenario.goal, Targets):
        for wish in scenario.goal.prefer:
            if as_path(wish.direction).moves:
                yield f"what {wish.device} prefers", as_path(wish.direction)


def target_paths(scenario: Scenario) -> Iterator[tuple[str, DirectionPath]]:
    """Yield the path of each target that moves, with the name of the device that points there."""
    goal = scenario.goal
    if isinstance(goal, Targets) and goal.moves:
        for name, path in zip(goal.names(scenario.spacecraft), goal.paths, strict=True):
            if path.moves:
                yield name, path


def moves(scenario: Scenario) -> bool:
    """Tell whether a zone, a target or a wish moves."""
    return next(paths(scenario), None) is not None


def seen_from(scenario: Scenario, time: float) -> float:
    """Return the first time, s, at or after `time` at which no moving target is known to be hidden."""
    return after_hidden([span for _, path in target_paths(scenario) for span in path.hidden], time)


def known_until(scenario: Scenario) -> tuple[float, str]:
    """Find until when zones and moving directions are known.

    Returns:
        The time, s, and the name of what ends first; infinite and empty where nothing moves and all zones
        last for ever.
    """
    ends = [(float(path.times[-1]), name) for name, path in paths(scenario)]
    ends += [(zone.lasts, f"zone {zone.name}") for zone in scenario.zones if zone.lasts < np.inf]
    return min(ends, default=(np.inf, ""))
