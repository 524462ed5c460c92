"""Step 1: compute the attitudes from which all devices can point at their targets, the nearest first.

This solves problem (7) of section 3.1, with equations (3) and (4) as in the errata. A goal is an attitude
``R_d = R0 exp(eta^)``, with ``R0`` the start and ``|eta| <= pi``, at which every joint is within its limits
and every constraint holds that the attitude decides on, such as a zone that binds a body-fixed instrument.
Goals are local minima of ``|eta|``, up to a dozen; the first one returned is the global minimum, the others
are the next best. With the criterion of the least time they are instead the ``R_d`` that platform and joints
reach soonest.

Terms of this package, beside those of `jaxplan.model.constraints` (a *row* is a cone, a *sight* a direction
that it binds):

- *slew*: the angle of the rotation from the start to the goal.
- *aim*: a device that must point at its target, with ranges of azimuth and elevation (`aims`).
- *pair*: a row and a sight that it binds. It is *settled* if its margin is the same at every attitude, a cap
  if the attitude decides on it, and *open* if the joints do (`pairs`).
- *cap*: a cone about a body axis that an inertial direction must stay out of (`caps`).
- *wish*: a direction that a device without a target shall come near to (`Targets.prefer`).
- *free*: of a device with joints, without a target and not held still.
- *make way*: of a free device, to move its joints until the constraints hold (`free_devices`).
- *covering*: points on SO(3) such that every attitude is near one of them (`multistart`).

The modules: `aims` tells what must point where and what is known then; `caps` writes what the attitude
decides on in one form; `descent` finds local minima from many starts at once; `multistart` proves where there
is no solution, and takes the global minimum of the local ones; `least_time` finds those that are reached
soonest, by the descents of `minimax`; `open_constraints` finds goals that keep the open pairs, too.
`derivative` has the goals' derivatives. Attitudes are body to inertial, angles in radians, joints as in
`jaxplan.model.spacecraft`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import jax
import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.goal import least_time, multistart
from jaxplan.goal.caps import Caps, assemble, deepest_row
from jaxplan.goal.derivative import goal_in_time
from jaxplan.goal.free_devices import WISH_SPARE, settled, with_wishes
from jaxplan.goal.open_constraints import beyond, goals_beside
from jaxplan.goal.pairs import cleared
from jaxplan.goal.problem import GoalProblem, Wished
from jaxplan.model.constraints import Constraints, constraint_margins
from jaxplan.model.goals import LEAST_TIME, Targets
from jaxplan.model.path import Goal
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit

CANDIDATES = 16
"""Most goals that are computed where pairs are left open (`leaves_open`); few problems have so many."""
_MIN_MARGIN = -1e-9  # rad; a constraint whose margin is below this is broken


@shown(
    "goals",
    "slew_angle deg",
    "aim_excess deg",
    "worst_aim",
    "zone_excess deg",
    "worst_zone",
    "worst_device",
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Decomposition:
    """The goals of a problem, nearest first; where it has none, by how much the best attitude misses.

    All attributes but `goals` describe one attitude, the best there is. Where the joints' ranges and the
    zones can be met, it is the nearest attitude at which they are, even if that is beyond the bound of the
    slew. Where some joint must leave its range, it is the attitude at which the worst joint leaves it least,
    without regard to zones. Otherwise it is, of the attitudes that keep the joints' ranges, the one at which
    the worst sight is least deep in a zone.

    Attributes:
        goals: distinct local minima of the slew, nearest first and none beyond its bound. With the criterion
            of the least time they are local minima of the time, the soonest first, and the goal of least
            slew. Where pairs are left open and the first goal breaks one, goals that keep them are among the
            others. Empty where the problem has no solution.
        slew_angle: rad, rotation from the start to the best attitude. Where there are no goals though neither
            excess is above zero, it is the slew that would be needed.
        aim_excess: rad, how far the worst device is from pointing at its target: the angle by which its joint
            would have to leave its range or, for an angle that no joint sets, by which the boresight is off;
            -inf where no device has a target.
        worst_aim: number of that device among those with targets, and 0 for its azimuth or 1 for its
            elevation; None where no device has a target.
        zone_excess: rad, how deep the worst sight (boresight or body axis) is in a zone; negative where it is
            clear, and -inf where the attitude decides on no zone.
        worst_zone: number of that zone's row among the constraints; None where the attitude decides on no
            zone.
        worst_device: number of that sight, which is a device's or, beyond the devices, that of a body axis;
            None where the attitude decides on no zone.
        aim_excesses: (n, 2) rad, the aim excess of azimuth and elevation of each of the n devices with a
            target.
    """

    goals: tuple[Goal, ...]
    slew_angle: float
    aim_excess: float
    worst_aim: tuple[int, int] | None
    zone_excess: float
    worst_zone: int | None
    worst_device: int | None
    aim_excesses: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))


def decompose(
    spacecraft: Spacecraft,
    start_attitude: np.ndarray,
    targets: Targets,
    cones: Constraints,
    *,
    start_joints: np.ndarray | None = None,
    max_slew: float = np.pi,
    max_goals: int = 3,
    seed: int = 0,
    told: Callable[[Goal], object] | None = None,
) -> Decomposition:
    """Solve problem (7), corrected, for its global minimum and the next-best local ones.

    The slew is minimised, unless the targets' criterion is the least time (`jaxplan.goal.least_time`).

    What the targets alone settle is left to the caller, such as zones that only bind terminals: these point
    at their targets whatever the attitude. Constraints that depend on joints in any other way than through a
    boresight's direction or a bound of one joint are left open (`problem.leaves_open`): goals may break
    these, see `Decomposition.goals`.

    Args:
        spacecraft: its devices, any number of each sort.
        start_attitude: (3, 3) ``R0``, body to inertial.
        targets: directions for devices, and limits of joints at the goal where those are tighter.
        cones: all constraints, for the devices of the spacecraft, at an instant.
        start_joints: (J,) rad, joint angles that devices without a target keep; zero by default.
        max_slew: rad, bound of ``|eta|`` (equations 5 and 6).
        max_goals: how many goals are wanted at most, at least 1; their attitudes are 2 deg apart or more.
            Where pairs are left open there may be more, to choose from.
        seed: seed of the random rotation of the set of starting attitudes; the same seed gives the same goals
            to the last bit.
        told: called with the goal of least rotation before goals of the least time are looked for; None to
            call nothing.

    Returns:
        The goals, stationary to 1e-10 and within all constraints but the open ones, or why there are none.
    """
    problem = GoalProblem.of(spacecraft, start_attitude, targets, cones, start_joints)
    if targets.clearance:
        problem = replace(problem, rows=cleared(problem.rows, problem.pairs, targets.clearance))
    with jax.enable_x64(True):
        wishes = Wished.all_of(spacecraft, targets, problem.ranges)
        problem, met = with_wishes(problem, wishes, seed)
        caps = assemble(problem)
        most = max(max_goals, CANDIDATES) if caps.open else max_goals
        solutions = multistart.minima(caps, most, seed)
        if not len(solutions):
            solutions = met
        if not len(solutions):
            best = _find_least_violating_turn(problem, seed)
            missed = multistart.minimum_near(
                caps, best
            )  # a solution that the descents from the covering missed
            if len(missed):
                problem, solutions = with_wishes(problem, wishes, seed, missed)
                caps = assemble(problem)
        nearest = _make_goal(problem, solutions[0] if len(solutions) else best)
        soonest = targets.criterion == LEAST_TIME and len(solutions) > 0
        if soonest:
            if told is not None:
                told(nearest)
            solutions = least_time.soonest(problem, caps, solutions, most, max_slew, seed)
    goals = [goal for goal in (_make_goal(problem, one) for one in solutions) if goal.slew_angle <= max_slew]
    if caps.open and goals and _breaks_constraint(problem, goals[0]):
        goals += goals_beside(problem, np.stack([goal.attitude for goal in goals]), max_slew, seed)
        goals.sort(key=lambda goal: goal.slew_angle)
    if soonest:
        goals = least_time.by_time(problem, goals)
    goals.sort(key=lambda goal: beyond(problem, goal.attitude).tolist())  # those beside may be off the wishes
    excess = problem.aims.excess(nearest.attitude)
    zone_excess, worst_zone, worst_device = deepest_row(caps, problem, nearest.attitude, nearest.joints)
    return Decomposition(
        goals=tuple(goals),
        slew_angle=nearest.slew_angle,
        aim_excess=float(np.max(excess, initial=-np.inf)),
        worst_aim=divmod(int(np.argmax(excess)), 2) if excess.size else None,
        zone_excess=zone_excess,
        worst_zone=worst_zone,
        worst_device=worst_device,
        aim_excesses=excess,
    )


def descend_once(
    spacecraft: Spacecraft,
    start_attitude: np.ndarray,
    targets: Targets,
    cones: Constraints,
    *,
    start_joints: np.ndarray | None = None,
) -> None:
    """Run a search for goals of the least time once, so that it is compiled; arguments as for `decompose`."""
    problem = GoalProblem.of(spacecraft, start_attitude, targets, cones, start_joints)
    with jax.enable_x64(True):
        wishes = Wished.all_of(spacecraft, targets, problem.ranges)
        met = tuple(wish._replace(reach=WISH_SPARE) for wish in wishes)  # as if all wishes could be met
        problem = replace(problem, wishes=met)
        least_time.descended(problem, assemble(problem), quaternion.exp(np.zeros((1, 3))))


def _make_goal(problem: GoalProblem, turn: np.ndarray) -> Goal:
    """Return the goal at the attitude ``R0 E``, with the joints of free devices chosen.

    Args:
        problem: the problem of step 1.
        turn: (4,) unit quaternion of ``E``, the rotation from the start.
    """
    attitude = problem.start @ quaternion.to_matrix(turn)
    joints, _ = settled(problem, attitude, np.clip(problem.joints(attitude), *problem.ranges.T))
    return Goal(attitude=attitude, joints=joints, slew_angle=float(multistart.slew(turn[None])[0]))


def _breaks_constraint(problem: GoalProblem, goal: Goal) -> bool:
    """Tell whether any constraint of the problem has a margin below `_MIN_MARGIN` at a goal."""
    margins = constraint_margins(problem.rows, problem.margins(goal.attitude, goal.joints))
    return not np.all(margins >= _MIN_MARGIN)


def _find_least_violating_turn(problem: GoalProblem, seed: int) -> np.ndarray:
    """Return the attitude at which a problem without a solution is violated least.

    Where devices can point at their targets once zones are left aside, the zones are relaxed until there is a
    solution; otherwise the ranges of azimuth and elevation are relaxed, without zones.

    Returns:
        (4,) unit quaternion of the rotation from the start.
    """

    def easier_zones(by: float) -> Caps:
        return assemble(problem, widening=by)

    def easier_aims(by: float) -> Caps:
        return assemble(problem.wider(by))

    has_zones = np.any(easier_zones(0).row >= 0)
    can_point = has_zones and len(multistart.minima(easier_aims(0), 1, seed)) > 0
    if not can_point:
        best, _ = multistart.least_widening(easier_aims, np.pi, seed)
        can_point = has_zones and easier_aims(0).clear(quaternion.to_matrix(best))
    if can_point:
        best, _ = multistart.least_widening(easier_zones, np.pi, seed)
    return best


def tracking_rates(
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: np.ndarray,
    targets: Targets,
    cones: Constraints,
    *,
    start_joints: np.ndarray,
    target_rates: np.ndarray,
    axis_rates: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rates of platform and joints with which devices follow moving targets at a goal.

    Args:
        goal: one that `decompose` found for this problem.
        spacecraft: its devices, J joints in all.
        start_attitude: (3, 3) ``R0``, body to inertial.
        targets: where they are when the manoeuvre ends, with limits.
        cones: all Z rows of constraints at that instant.
        start_joints: (J,) rad, joint angles that devices without a target keep.
        target_rates: (n, 3) 1/s, time derivatives of the directions of the n targets, inertial.
        axis_rates: (Z, 3) 1/s, time derivatives of the cones' axes; zero for all axes that are not inertial.

    Returns:
        (3,) angular velocity, rad/s, body axes, and (J,) joint rates, rad/s. Together they turn every
        boresight exactly as its target turns. Where the optimum has no derivative, the platform's rate is the
        one that `differentiable_goal` chooses.
    """
    place = Goal(attitude=goal.attitude, joints=goal.joints, slew_angle=goal.slew_angle)
    with jax.enable_x64(True):
        found = _goal_in_time_jit(
            place,
            spacecraft,
            start_attitude,
            targets,
            cones,
            start_joints=start_joints,
            target_rates=target_rates,
            axis_rates=axis_rates,
        )
        return np.asarray(found.angular_velocity), np.asarray(found.joint_rates)


_goal_in_time_jit = quick_jit(goal_in_time, level=0)  # runs in less than a millisecond in any case
