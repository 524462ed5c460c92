"""Random starts of the paper's spacecraft, the goals of step 1 from there, and the straight motion between.

Scenes of most kinds share the paper's spacecraft with three terminals, and as targets the lines of sight of
the paper's orbits (section 5). Step 1 (decomposition) finds goals: attitudes and joints at which all
terminals point at their targets. It needs no zones here: those of the scenes bind terminals, whose directions
are the same at every goal. The *straight motion* to a goal turns the platform about one fixed axis while the
joints change linearly.

Attitudes are body to inertial, angles in radians. Joints (6,) are all yaws and then all pitches.
"""

import itertools
import math
from collections.abc import Iterator
from functools import cache

import jax
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.cases.paper import paper_case
from jaxplan.goal import decompose
from jaxplan.model.gimbals import angles_along
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.path import Goal, motion
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.runtime.jit import quick_jit
from jaxplan.sky import orbits

YAW_LIMIT, PITCH_LIMIT = math.radians(88.0), math.radians(13.0)  # rad, largest joint angles at start and goal
JOINT_LIMITS = np.repeat([YAW_LIMIT, PITCH_LIMIT], 3)
HAIR = 1e-9
"""Least slack of what is admissible, as a cosine or in rad."""
UNAMBIGUOUS = 1e-6
"""rad; the slew to the second-best goal is longer by at least this."""
LONGEST_TURN = math.radians(179.0)
"""rad, greatest turn to a goal; half a turn could be made in either direction."""
BATCH = 64
"""Number of starts drawn at once."""
SAMPLES = 129
"""Number of samples of the straight motion, its ends included."""
BROKEN = math.radians(0.2)
"""rad, least depth in a zone at some sample of a straight motion that counts as blocked."""
PATIENCE = 50
"""Number of sets of zones that are tried with one start."""


def admissible(slack: np.ndarray) -> np.ndarray:
    """Tell whether a slack (a difference of cosines, or of angles in rad) is at least `HAIR`.

    Every decision about a draw is made by this function, so that rounding does not change scenes.
    """
    return slack >= HAIR


@cache
def setting() -> tuple[Spacecraft, Targets]:
    """The paper's spacecraft, and as targets the lines of sight to three other satellites (section 5)."""
    node, anomaly = np.radians([[10.0, 10.0, 5.0, 13.0], [20.0, 25.0, 15.0, 15.0]])
    with jax.enable_x64(True):
        directions = np.asarray(_lines_of_sight(node, anomaly))
    return paper_case(1).spacecraft, Targets(
        directions=directions,
        yaw_limit=YAW_LIMIT,
        pitch_limit=PITCH_LIMIT,
        angular_velocity=np.zeros(3),
        joint_rates=np.zeros(6),
    )


@quick_jit
def _lines_of_sight(node: Array, anomaly: Array) -> Array:
    """Inertial unit vectors (3, 3) from the first of four satellites to the others.

    Args:
        node: (4,) rad, right ascensions of the ascending nodes.
        anomaly: (4,) rad, arguments of latitude.
    """
    satellites = orbits.position(500.0, math.radians(10.0), node, anomaly)
    return orbits.line_of_sight(satellites[0], satellites[1:])


def starts(
    rng: np.random.Generator, held: int, within: float
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Draw starts with uniform attitude and joints, and keep those with held terminals near their targets.

    An attitude is uniform on SO(3) if it brings terminal 1's boresight to a uniform point of the sphere and
    turns uniformly about it. Where terminal 1 is held, that point is drawn from the spherical cap around its
    target.

    Args:
        rng: source of the draws.
        held: number of terminals, counted from the first, that must be near their targets; 0 for none.
        within: rad, greatest angle between a held terminal's boresight and its target.

    Yields:
        Attitude (3, 3), joints (6,) in rad, and inertial boresights (3, 3) of the three terminals; without
        end.
    """
    craft, targets = setting()
    while True:
        joints = rng.uniform(-1, 1, (BATCH, 6)) * JOINT_LIMITS
        body = craft.gimbals.boresights(joints)
        cosine = rng.uniform(math.cos(within) if held else -1, 1, BATCH)
        around, roll = rng.uniform(-np.pi, np.pi, (2, BATCH))
        offset = np.stack([cosine, *np.sqrt(1 - cosine**2) * [np.cos(around), np.sin(around)]], axis=-1)
        toward = offset @ _frame_along(targets.directions[0]).T
        attitudes = _frame_along(toward) @ _turn_about_x(roll) @ np.swapaxes(_frame_along(body[:, 0]), -1, -2)
        seen = body @ np.swapaxes(attitudes, -1, -2)
        near = np.sum(seen * targets.directions, axis=-1)[:, :held] - math.cos(within)
        for i in np.flatnonzero(np.all(admissible(near), axis=-1)):
            yield attitudes[i], joints[i], seen[i]


def _frame_along(first: np.ndarray) -> np.ndarray:
    """Complete unit vectors (..., 3) to rotation matrices (..., 3, 3) that have them as their first column.

    The vectors must not be along z. The second column is perpendicular to z.
    """
    second = np.cross([0.0, 0.0, 1.0], first)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def _turn_about_x(angle: np.ndarray) -> np.ndarray:
    """Rotations (k, 3, 3) about the x axis by angles (k,) rad."""
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = 1
    turn[:, 1, 1] = turn[:, 2, 2] = np.cos(angle)
    turn[:, 2, 1] = np.sin(angle)
    turn[:, 1, 2] = -turn[:, 2, 1]
    return turn


def nearest_goal(attitude: np.ndarray, least: float = 0.0, most: float = LONGEST_TURN) -> Goal | None:
    """Find the goal of step 1 to which the platform turns least.

    Args:
        attitude: (3, 3) at the start, body to inertial.
        least: rad, least turn of the platform that is accepted; zero for no bound.
        most: rad, greatest turn that is accepted.

    Returns:
        The goal; None if the turn is out of this range, or another goal is nearly as near (`UNAMBIGUOUS`).
    """
    if least and _reaches_goal_within(attitude, least):
        return None  # step 1 would find this too, but takes a hundred times as long
    craft, targets = setting()
    first, *others = decompose(craft, attitude, targets, tabulate((), (), craft)).goals
    slacks = [most - first.slew_angle, *([first.slew_angle - least] if least else [])]
    slacks += [goal.slew_angle - first.slew_angle - UNAMBIGUOUS for goal in others]
    return first if np.all(admissible(np.array(slacks))) else None


def _reaches_goal_within(attitude: np.ndarray, angle: float) -> bool:
    """Try some turns by less than `angle` (rad); returns whether one of them leads to a goal.

    False does not mean that there is none.
    """
    craft, targets = setting()
    body = targets.directions @ (attitude @ _turns_within(angle))
    return bool(np.any(np.all(np.abs(_joints_along(craft, body)) < JOINT_LIMITS, axis=-1)))


def _joints_along(craft: Spacecraft, body: np.ndarray) -> np.ndarray:
    """Joint angles (..., 6), rad, at which the terminals point along given directions.

    Args:
        craft: the spacecraft.
        body: (..., 3, 3) unit vectors in body axes, one for each terminal.
    """
    return np.concatenate(angles_along(craft.gimbals.frames, body), axis=-1)


@cache
def _turns_within(angle: float) -> np.ndarray:
    """Rotations (k, 3, 3) by less than `angle`, rad, about axes to a cube's corners, edges and faces."""
    axes = np.array([axis for axis in itertools.product((-1, 0, 1), repeat=3) if any(axis)], dtype=float)
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    return np.asarray(so3.exp(np.concatenate([angle * part * axes for part in (0.0, 0.33, 0.66, 0.99)])))


def straight_states(attitude: np.ndarray, joints: np.ndarray, goal: Goal) -> tuple[np.ndarray, np.ndarray]:
    """Attitudes (SAMPLES, 3, 3) and joints (SAMPLES, 6) along the straight motion from a start to a goal."""
    turn = so3.log(attitude.T @ goal.attitude)
    return motion(attitude, joints, turn, goal.joints - joints, np.linspace(0, 1, SAMPLES))


def straight_motion(attitude: np.ndarray, joints: np.ndarray, goal: Goal) -> np.ndarray:
    """Inertial boresights (SAMPLES, 3, 3) of the terminals along the straight motion to a goal."""
    return np.asarray(setting()[0].boresights(*straight_states(attitude, joints, goal)))


def at_rest(attitude: np.ndarray, joints: np.ndarray) -> GivenState:
    """The state at rest with an attitude (3, 3), body to inertial, and joints (J,) in rad."""
    return GivenState(
        rotation_vector=so3.log(attitude),
        joints=joints,
        angular_velocity=np.zeros(3),
        joint_rates=np.zeros(len(joints)),
    )
