"""Step 1: the attitudes from which all terminals can point at their targets, the nearest first.

Problem (7) of section 3.1, with equations (3) and (4) as in the errata: the ``R_d = R0 exp(eta^)`` of least
``|eta| <= pi`` at which every joint is within its limits and every constraint holds that the attitude decides
on, such as a zone that binds a body-fixed instrument. It has up to a dozen local minima; the first goal is
the global one, the others are the next best.

`caps` tells what the attitude decides on, and writes it in one form; `descent` finds local minima from many
starts at once; `multistart` rules out where there is no solution, and makes the global minimum of the local
ones. `sensitivity` has the goals' derivatives. Attitudes are body to inertial, angles in radians, joints all
yaws and then all pitches.
"""

from dataclasses import dataclass

import jax
import numpy as np

from jaxplan.geometry import quaternion
from jaxplan.goal import multistart
from jaxplan.goal.caps import Caps, assemble, deepest_row
from jaxplan.model.constraints import Constraints, state_margins
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import tabulate
from jaxplan.runtime.display import shown


@shown(
    "goals",
    "slew_angle deg",
    "joint_excess deg",
    "worst_joint",
    "zone_excess deg",
    "worst_zone",
    "worst_device",
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Decomposition:
    """Goals, or why there are none.

    All but the goals tells of one attitude, the best there is. Where the joints' ranges and the zones can be
    met, it is the nearest at which they are, if need be beyond the bound of the slew. Where some joint must
    leave its range, it is the one at which the worst joint does so least, zones left aside; else the one
    within the joints' ranges at which the worst sight is least deep in a zone.

    Attributes:
        goals: distinct local minima of the slew, nearest first and none beyond its bound.
        slew_angle: rad, rotation from the start to the best attitude. Where there are no goals though neither
            excess is above zero, it is the slew that would be needed.
        joint_excess: rad, how far the worst joint is beyond its limit at the goal; -inf without terminals.
        worst_joint: its number in the joint vector; None without terminals.
        zone_excess: rad, how deep the worst sight is in a zone; -inf where no zone matters.
        worst_zone: row of that zone among the cones; None where no zone matters.
        worst_device: number of that sight: of a device, or beyond these of an axis of the body, likewise.
    """

    goals: tuple[Goal, ...]
    slew_angle: float
    joint_excess: float
    worst_joint: int | None
    zone_excess: float
    worst_zone: int | None
    worst_device: int | None


def decompose(
    spacecraft: Spacecraft,
    start_attitude: np.ndarray,
    targets: Targets,
    cones: Constraints,
    *,
    max_slew: float = np.pi,
    max_goals: int = 3,
    seed: int = 0,
) -> Decomposition:
    """Solve problem (7), corrected, for its global minimum and the next-best local ones.

    What the targets settle is left to the caller, such as zones that only bind terminals: these point at
    their targets whatever the attitude. So is what depends on joints in another way than by a boresight's
    direction or a bound of one joint (`caps.leaves_open`).

    Args:
        spacecraft: its terminals and instruments, any number of either.
        start_attitude: (3, 3) ``R0``, body to inertial.
        targets: a direction for each terminal, and limits at the goal where those are tighter.
        cones: all constraints, for the devices of the spacecraft.
        max_slew: rad, bound of ``|eta|`` (equations 5 and 6).
        max_goals: how many goals are wanted at most, at least 1; their attitudes are 2 deg apart or more.
        seed: turns the set of starts; the same seed gives the same goals to the last bit.

    Returns:
        The goals, stationary to 1e-10 and within all of these constraints, or why there are none.
    """
    start = np.asarray(start_attitude, dtype=np.float64)
    directions = np.asarray(targets.directions, dtype=np.float64).reshape(-1, 3)
    limits = goal_limits(spacecraft, targets)
    caps = assemble(spacecraft, start, directions, limits, cones)
    with jax.enable_x64(True):
        solutions = multistart.minima(caps, max_goals, seed)
        best = (
            solutions if len(solutions) else _least_broken(spacecraft, start, directions, limits, cones, seed)
        )
    states = _states(best[np.arange(max_goals) % len(best)], start, directions, spacecraft)
    goals = [
        Goal(attitude=attitude, joints=np.clip(joints, -limits, limits), slew_angle=slew)
        for attitude, joints, slew in states[: len(solutions)]
        if slew <= max_slew
    ]
    attitude, joints, slew = states[0]
    joint_excess = np.abs(joints) - limits
    sights = cones.sights(spacecraft.mounts, spacecraft.fixed_boresights)
    margins = state_margins(cones, sights, attitude, joints)
    zone_excess, worst_zone, worst_device = deepest_row(caps, cones, margins)
    return Decomposition(
        goals=tuple(goals),
        slew_angle=slew,
        joint_excess=float(np.max(joint_excess, initial=-np.inf)),
        worst_joint=int(np.argmax(joint_excess)) if len(limits) else None,
        zone_excess=zone_excess,
        worst_zone=worst_zone,
        worst_device=worst_device,
    )


def _least_broken(
    spacecraft: Spacecraft,
    start: np.ndarray,
    directions: np.ndarray,
    limits: np.ndarray,
    cones: Constraints,
    seed: int,
) -> np.ndarray:
    """The best attitude (1, 4), as a rotation from the start, of a problem without solution."""
    nowhere = tabulate((), (), spacecraft.device_names)

    def wider_joints(by: float) -> Caps:
        return assemble(spacecraft, start, directions, limits + by, nowhere)

    def easier_zones(by: float) -> Caps:
        return assemble(spacecraft, start, directions, limits, cones, widening=by)

    has_zones = np.any(easier_zones(0).row >= 0)
    can_point = has_zones and len(multistart.minima(wider_joints(0), 1, seed)) > 0
    return multistart.least_widening(easier_zones if can_point else wider_joints, np.pi, seed)[None]


def goal_limits(spacecraft: Spacecraft, targets: Targets) -> np.ndarray:
    """Limits (2n,) of the joints at the goal: the tighter of a joint's own and the one given for the goal."""
    given = [np.inf if limit is None else limit for limit in (targets.yaw_limit, targets.pitch_limit)]
    return np.minimum(spacecraft.joint_limits, np.repeat(given, len(spacecraft.terminals)))


def _states(
    quaternions: np.ndarray, start: np.ndarray, directions: np.ndarray, spacecraft: Spacecraft
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Attitude (3, 3), joints (2n,) and slew of each quaternion of ``E``."""
    attitudes = start @ quaternion.to_matrix(quaternions)
    joints = spacecraft.joints_toward(attitudes, directions)
    return list(zip(attitudes, joints, multistart.slew(quaternions).tolist(), strict=True))
