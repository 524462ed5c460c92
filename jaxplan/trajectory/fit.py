"""The result of step 3, and what its methods share: checks, the trajectory at rest, messages about limits.

A path has m + 1 nodes, a spacecraft 2n joint angles. "global" is the method of `strategy`, "paper" that of
`jaxplan.paper`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, TypeVar

import numpy as np

from jaxplan.model.constraints import Constraints
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.status import Status
from jaxplan.runtime.display import shown
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.peaks import Peaks

Problem = TypeVar("Problem")  # what a method makes of a query

_ORTHONORMALITY_TOLERANCE = 1e-6  # by which elements of R R^T may differ from those of the identity

NEAR_THE_BOUND = 1.015
"""Factor on the lower bound of the duration; a motion within it is not compared with other shortest ones."""

MIN_ORDER = 5  # of the paper's basis: a single interval must meet three conditions at either end


@shown("status", "message", "note", "trajectory", "needed_duration s")
@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The result of a method of step 3.

    Attributes:
        trajectory: None if no curve was found, or what is asked at an end is impossible; else with
            LIMITS_TOO_TIGHT, the one that breaks limits, and with UNCERTIFIED, the one that breaks a zone or
            the range of a joint.
        status: OK, LIMITS_TOO_TIGHT, UNCERTIFIED or INFEASIBLE.
        message: which limit is nearest or broken and, for a failure, what to change, by names of settings in
            a file.
        note: what was asked for and is not delivered, of a fit that is OK; empty if nothing.
        origin: how the trajectory came about; its method ``hold`` returns what derivatives start from. None
            where there is no trajectory, or nothing moves.
        needed_duration: s, in which the same settings keep all limits, though a shorter time may do; None if
            none was needed or found.
        spare: the fit before it was improved to the optimum, for use if the optimum is not certified; else
            None.
        short_of: "momentum" or "torque" where it failed because there is too little of that however slow the
            motion is, such as in wheels that are full; else empty.
    """

    trajectory: Trajectory | None
    status: Status
    message: str
    note: str = ""
    origin: Any = None
    needed_duration: float | None = None
    spare: "Fit | None" = None
    short_of: str = ""

    def at_given_nodes(self, numbers: np.ndarray) -> "Fit":
        """Return the fit with the times of all given nodes, repeated ones included.

        `numbers` (m + 1,) are, for each given node, its index among the nodes that the trajectory passes.
        """
        curve = self.trajectory
        if curve is None:
            return self
        spare = None if self.spare is None else self.spare.at_given_nodes(numbers)
        own = replace(curve, node_times=curve.node_times[numbers])
        return replace(self, trajectory=own, spare=spare)


@shown(
    "path",
    "settings",
    "spacecraft",
    "cones",
    "node_fractions",
    "start_angular_velocity deg/s",
    "start_joint_rates deg/s",
    "end_angular_velocity deg/s",
    "end_joint_rates deg/s",
    "horizon s",
    "near",
    "at_most s",
)
@dataclass(frozen=True, kw_only=True, eq=False)
class FitQuery:
    """What is asked of step 3.

    Attributes:
        path: m + 1 nodes; in the paper's method the edges' costs determine how the time is divided among
            them.
        spacecraft: its limits, dynamics included.
        settings: of step 3.
        cones: the zones, None for none; the paper's method ignores them.
        node_fractions: (m + 1,) times of the nodes as fractions of the duration, strictly increasing from 0
            to 1; None to leave them to the method.
        start_angular_velocity: (3,) rad/s, body axes; None for rest, as for the next three.
        start_joint_rates: (2n,) rad/s.
        end_angular_velocity: (3,) rad/s, body axes.
        end_joint_rates: (2n,) rad/s.
        horizon: s, assumed duration for zones that move: at a fraction of the motion's duration they are
            where they are after the same fraction of the horizon.
        near: a motion near which the shortest one is looked for, on its breaks, if these are concentrated
            where its acceleration switches; None to look for the best.
        at_most: s, if only a shorter motion is of use: the search for the shortest one ends once it can come
            to nothing shorter than that.
    """

    path: Path
    spacecraft: Spacecraft
    settings: TrajectorySettings
    cones: Constraints | None = None
    node_fractions: np.ndarray | None = None
    start_angular_velocity: np.ndarray | None = None
    start_joint_rates: np.ndarray | None = None
    end_angular_velocity: np.ndarray | None = None
    end_joint_rates: np.ndarray | None = None
    horizon: float = 0.0
    near: Trajectory | None = None
    at_most: float = np.inf


def checked(query: FitQuery) -> tuple[Path, np.ndarray]:
    """Check a query and return its path and its rates at both ends.

    Returns:
        The path in float64, and rates (2, 3 + 2n) rad/s at start and end, of body axes and joints.

    Raises:
        ValueError: if settings, edge costs, node fractions, nodes or rates are invalid; the message says what
            is wrong, naming a setting by its key in a file.
    """
    settings, fractions = query.settings, query.node_fractions
    path = _expect_path(query.path, query.spacecraft)
    duration = settings.duration
    if settings.end_acceleration not in ("zero", "free"):
        raise ValueError(
            f'trajectory.end_acceleration = {settings.end_acceleration!r}: must be "zero" or "free"'
        )
    asked: object = duration  # whatever its type says
    if isinstance(asked, bool) or not isinstance(asked, str | Real):
        raise ValueError(f"trajectory.duration_s = {duration!r}: must be a positive number or a word")
    weights = np.array([settings.rate_weight, settings.acceleration_weight, settings.jerk_weight])
    if isinstance(duration, str):
        words = ("stretched", "minimum") if settings.method == "global" else ("stretched",)
        if duration not in words:
            known = " or ".join(f'"{word}"' for word in words)
            raise ValueError(f'trajectory.duration_s = "{duration}": must be a number or {known}')
    elif not 0 < duration < np.inf:
        raise ValueError(f"trajectory.duration_s = {duration}: must be positive")
    if settings.order < MIN_ORDER:
        raise ValueError(f"trajectory.order = {settings.order}: must be at least {MIN_ORDER}")
    if settings.segments is not None and settings.segments < 1:
        raise ValueError(f"trajectory.segments = {settings.segments}: must be at least 1")
    if not (np.all(weights >= 0) and np.all(np.isfinite(weights)) and np.any(weights[:2] > 0)):
        raise ValueError(
            "trajectory.*_weight must not be negative, nor rate_weight and acceleration_weight zero"
        )
    if settings.node_tube is not None and not settings.node_tube >= 0:
        raise ValueError("trajectory.node_tube_deg must not be negative")
    if not np.all((path.edge_costs >= 0) & np.isfinite(path.edge_costs)):
        raise ValueError("the costs of a path's edges must be finite and not negative")
    if fractions is not None and not (
        np.shape(fractions) == (len(path.attitudes),)
        and fractions[0] == 0
        and fractions[-1] == 1
        and np.all(np.diff(fractions) > 0)
    ):
        raise ValueError("node_fractions must rise strictly from 0 to 1, one a node")
    return path, np.stack(
        [
            np.append(_expect_rate(velocity, 3), _expect_rate(rates, path.joints.shape[1]))
            for velocity, rates in (
                (query.start_angular_velocity, query.start_joint_rates),
                (query.end_angular_velocity, query.end_joint_rates),
            )
        ]
    )


def _expect_rate(given: np.ndarray | None, size: int) -> np.ndarray:
    """Return a rate as (size,) finite numbers, zeros for None; raise a ValueError for anything else."""
    rate = np.zeros(size) if given is None else np.asarray(given, float)
    if rate.shape != (size,) or not np.all(np.isfinite(rate)):
        raise ValueError(f"a rate at the start or end must be {size} finite numbers")
    return rate


def fit_each(
    queries: Sequence[FitQuery],
    begin: Callable[[FitQuery], Fit | tuple[Problem, np.ndarray]],
    fits: Callable[[dict[int, Problem]], dict[int, Fit]],
) -> list[Fit]:
    """Fit many trajectories by one method.

    Args:
        queries: what is asked.
        begin: from a query to the method's problem and, for each given node, its index among those that are
            passed; or to the fit itself if it is known at once, as where nothing moves.
        fits: from problems to fits, both as dictionaries by the number of the query.

    Returns:
        The fits in the order of the queries, with the times of all given nodes.
    """
    begun = [begin(query) for query in queries]
    moving = {number: one for number, one in enumerate(begun) if not isinstance(one, Fit)}
    found = fits({number: problem for number, (problem, _) in moving.items()})
    given = {number: own.at_given_nodes(moving[number][1]) for number, own in found.items()}
    return [one if isinstance(one, Fit) else given[number] for number, one in enumerate(begun)]


def _expect_path(path: Path, spacecraft: Spacecraft) -> Path:
    """Return a path in float64 after a check of its shapes and rotation matrices.

    Numbers that are not finite pass; they are left to the fit.

    Raises:
        ValueError: if there are no nodes, shapes do not fit the spacecraft, or an attitude is no rotation.
    """
    count = len(path.attitudes)
    shapes = {
        "attitudes": (count, 3, 3),
        "joints": (count, spacecraft.joint_count),
        "edge_costs": (count - 1,),
    }
    arrays = {name: np.asarray(getattr(path, name), float) for name in shapes}
    if not count:
        raise ValueError("the path has no nodes")
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ValueError(f"path.{name} is of shape {arrays[name].shape}: must be {shape}")
    attitudes = arrays["attitudes"]
    off = np.abs(attitudes @ np.swapaxes(attitudes, 1, 2) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((off > _ORTHONORMALITY_TOLERANCE) | (np.linalg.det(attitudes) < 0))
    if len(wrong):
        raise ValueError(f"path.attitudes[{wrong[0]}] is no rotation matrix")
    return Path(**arrays)


def at_rest(query: FitQuery, path: Path, order: int, smoothness: int, count: int) -> Fit:
    """Make the fit of a path without motion: a trajectory at rest.

    Its duration is 0, so that it can be sampled at t = 0; where the settings give the duration as a number it
    rests for the query's horizon instead.

    Args:
        query: the one that it answers.
        path: of one node.
        order: degree of the Legendre basis.
        smoothness: number of continuous derivatives that the method's trajectories have.
        count: number of nodes that were given.
    """
    duration = 0.0 if isinstance(query.settings.duration, str) else query.horizon
    joint_coefficients = np.zeros((1, order + 1, path.joints.shape[1]))
    joint_coefficients[0, 0] = path.joints[0]
    still = Trajectory(
        breaks=np.array([0.0, duration]),
        chart_attitude=np.array(path.attitudes[:1], dtype=float),
        chart_start=np.zeros(1),
        chart_rate=np.zeros((1, 3)),
        coefficients=np.zeros((1, order + 1, 3)),
        joint_breaks=np.array([0.0, duration]),
        joint_coefficients=joint_coefficients,
        node_times=np.linspace(0.0, duration, count),
        smoothness=smoothness,
        method=query.settings.method,
    )
    return Fit(trajectory=still, status=Status.OK, message="the path has no motion")


def within_limits(trajectory: Trajectory, peaks: Peaks) -> str:
    """The message about a trajectory of the paper's method that keeps all limits."""
    nearest = peaks.names[peaks.binding]
    segments = len(trajectory.coefficients)
    return f"{trajectory.duration:.2f} s in {segments} segments; {nearest} is nearest to its limit"


def needed_words(duration: float, *, moving: bool, scalable: bool) -> str:
    """Words on how long a motion within all limits takes, and on what to write into the settings.

    Args:
        duration: s, of such a motion; it is rounded up to hundredths. A quicker motion may exist that was not
            found.
        moving: whether goal or zones move, and so differ in another duration: then the duration is a guess.
        scalable: whether "stretched" may be recommended, too.
    """
    number = f"{math.ceil(duration * 100) / 100:.2f}"
    told = f"at most {number} s are needed"
    if moving:
        told, number = f"this way takes about {number} s", f"about {number}"
    otherwise = ', or to "stretched"' if scalable else ""
    return f"{told}: set trajectory.duration_s to {number} or more{otherwise}"


def too_tight(duration: float, peaks: Peaks, needed: str | None, else_try: str) -> str:
    """The message about a trajectory that breaks a limit.

    Args:
        duration: the one asked for, s.
        peaks: of the trajectory.
        needed: the words of `needed_words`; None if no duration was found in which limits are kept.
        else_try: words on what to change in that case.
    """
    name, ratio = peaks.names[peaks.binding], peaks.ratios[peaks.binding]
    excess = f"in {duration:g} s {name} would reach {ratio:.4g} times its limit"
    if needed is None:
        return f"{excess}, and no longer trajectory.duration_s was found that keeps all limits: {else_try}"
    return f"{excess}; {needed}"
