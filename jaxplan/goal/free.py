"""Joints of devices that have no target and are not held: where a goal leaves them.

A device with a wish points as near to it as its range lets it. Any other stays as it is at the start, within
its range at the goal. Where that breaks a zone, such as the beam of a device that has a target, or a cone of
the sky that it must look into, the device moves: its joints are laid out on a grid, of the clear ones those
are taken that are reached in the least time, and brought back toward where it would rather be as far as
everything stays clear. Devices take their turns in the order of their numbers, twice where two are free,
since each may be in the other's way.
"""

import numpy as np

from jaxplan.goal.problem import GoalProblem
from jaxplan.model.constraints import SIGHT, constraint_margins
from jaxplan.model.gimbals import Gimbals, angles_along, in_range

SPARE = 2e-5
"""rad by which zones are kept: a motion that ends there may swing a little on the way."""
_GRIDS = (121, 41)  # places of a drive's angle, and of each of a terminal's
_HALVINGS = 40  # of the way back
_CLOSER = 3  # grids, each a few spacings of the one before wide


def settled(problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Joints at a goal, those of free devices where they are best.

    Args:
        problem: what is asked.
        attitude: (3, 3) of the goal.
        joints: (J,) rad, those of devices with targets and held ones as they are to be.

    Returns:
        (J,) rad. Where no place of a device is clear it is left where it would rather be.
    """
    gimbals, aims = problem.spacecraft.gimbals, problem.aims
    free = [number for number in range(gimbals.count) if number not in (*aims.devices, *aims.held)]
    joints = np.array(joints)
    for number in free:
        own = joints_of(problem.spacecraft.gimbals, number)
        joints[own] = _wanted(problem, number, attitude, joints[own])
    for _ in range(2 if len(free) > 1 else 1):
        for number in free:
            if _least(problem, attitude, joints, number) < 0:
                joints = _moved(problem, attitude, joints, number)
    return joints


def joints_of(gimbals: Gimbals, number: int) -> np.ndarray:
    """Numbers of a gimbal's one or two joints."""
    return np.array([gimbals.yaws[number], *gimbals.pitches[number : number + 1]])


def _wanted(problem: GoalProblem, number: int, attitude: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Where a device would be without zones: as it is, or nearest to its wish; its joints."""
    own = joints_of(problem.spacecraft.gimbals, number)
    low, high = problem.ranges[own].T
    wish = next((wish for wish in problem.wishes if wish.device == number), None)
    if wish is None:
        return np.clip(rest, low, high)
    frame = problem.spacecraft.gimbals.frames[number : number + 1]
    azimuth, elevation = angles_along(frame, (wish.direction @ attitude)[None])
    yaw = in_range(azimuth, problem.ranges[own[:1]], rest[:1])
    return np.clip(np.concatenate([yaw, elevation])[: len(own)], low, high)


def _least(problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray, number: int) -> np.ndarray:
    """(...) least margin of a device's constraints, at joints (..., J), less the spare; rad."""
    rows = problem.rows
    attitudes = np.broadcast_to(attitude, (*joints.shape[:-1], 3, 3))
    margins = constraint_margins(rows, problem.margins(attitudes, joints))
    takes_part = problem.sights.carriers == number
    concerned = np.any(rows.bound[:, takes_part], axis=1) | ((rows.frame == SIGHT) & takes_part[rows.partner])
    of_constraint = np.isin(rows.group, rows.group[concerned])
    return np.min(np.where(of_constraint, margins, np.inf), axis=-1, initial=np.inf) - SPARE


def _moved(problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray, number: int) -> np.ndarray:
    """Joints with those of a device where all is clear that it takes part in; as they are if nowhere is."""
    own = joints_of(problem.spacecraft.gimbals, number)
    wanted, ranges = joints[own], problem.ranges[own]
    rates = problem.spacecraft.joint_rate_limits[own]
    best: np.ndarray | None = None
    window = ranges
    for _ in range(1 + _CLOSER):
        axes = [np.linspace(ends[0], ends[1], _GRIDS[len(own) - 1]) for ends in window]
        places = np.stack([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")], axis=-1)
        clear = places[_least(problem, attitude, _put(joints, own, places), number) >= 0]
        if not len(clear):
            break
        cost = np.max(np.abs(clear - wanted) / rates, axis=-1)
        nearest = clear[np.argmin(cost)]
        if best is None or np.max(np.abs(nearest - wanted) / rates) < np.max(np.abs(best - wanted) / rates):
            best = nearest
        around = 2 * np.array([axis[1] - axis[0] for axis in axes])
        window = np.clip(np.stack([best - around, best + around], axis=-1), ranges[:, :1], ranges[:, 1:])
    if best is None:
        return joints
    share, step = 1.0, 0.5  # of the way from where it would rather be
    for _ in range(_HALVINGS):
        tried = share - step
        place = wanted + tried * (best - wanted)
        if _least(problem, attitude, _put(joints, own, place[None]), number)[0] >= 0:
            share = tried
        step /= 2
    return _put(joints, own, (wanted + share * (best - wanted))[None])[0]


def _put(joints: np.ndarray, own: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Joints (k, J) with some of them at each of some places (k, o)."""
    found = np.repeat(joints[None], len(places), axis=0)
    found[:, own] = places
    return found
