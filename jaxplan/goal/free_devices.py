"""Devices that have no target and are not held: where a goal leaves their joints, and how it meets wishes.

**Wishes.** A wish is a direction that a device without a target shall come near to. Each wish in turn is made
as near as the ones before allow: the least angle within which there is an attitude that meets all targets,
zones and former wishes is found by bisection, with all of these as caps (`jaxplan.goal.caps`). A search of
the whole covering of attitudes (`jaxplan.goal.multistart`) for an angle a little less then either proves that
this is the least, as far as its descents go, or finds something nearer, from which the bisection goes on.
Where many attitudes are equally near, as where the wish is parallel to what the targets fix, the one of least
slew is taken.

**Joints.** A free device with a wish points as near to the wished direction as its range lets it. Any other
stays as it is at the start, within its range at the goal. Where that breaks a zone, such as the beam of a
device that has a target, or a cone of the sky that it must look into, the device *makes way*: of the clear
places on a grid of its joint angles the one reached in the least time is taken. Where none is clear, finer
grids about the place of most margin are looked at. The joints are then brought back toward where they would
rather be as far as everything stays clear. Devices take turns in the order of their numbers, twice where
several are free, since each may be in the other's way.

So a device that makes way ends on the straight line of its joint angles from where it would rather be (share
0) to that clear place (share 1), where the margin of one pair of a constraint's row and a sight is `SPARE`.
With line and pair held fixed that is a differentiable function of all that a goal depends on (`places`).
Shapes: J joints, o joints of one device (1 or 2), Z rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxplan.geometry.vectors import AnyArray, array_module
from jaxplan.goal import multistart
from jaxplan.goal.caps import Caps, assemble
from jaxplan.goal.problem import GoalProblem, Wished
from jaxplan.model.constraints import SIGHT, Constraints, constraint_margins, state_margins
from jaxplan.model.directions import Sights
from jaxplan.model.gimbals import Gimbals, angles_along, in_range
from jaxplan.runtime.display import shown

WISH_SPARE = 4e-7
"""rad, by which a wish is met less than it might be, so that the next ones have room."""
_MIN_GAIN = 6e-7  # rad; a smaller gain in nearness is not searched for
_MAX_SEARCHES = 6  # most searches of the whole covering for each wish
SPARE = 2e-5
"""rad by which zones are kept: a motion that ends there may swing a little on the way."""
_GRID_POINTS = (121, 41)  # grid points over a drive's angle, and over each of a terminal's two angles
_BISECTIONS = 40  # bisections that find the share of the line
_GRID_REFINEMENTS = 3  # further grids, each four spacings of the one before wide, about its best place
_MAX_GRIDS = 7  # most grids, where no place is clear yet
_TIE_TOLERANCE = 1e-8  # rad; pairs whose margins are within this of the least one are ties


def with_wishes(
    problem: GoalProblem, wishes: list[Wished], seed: int, found: np.ndarray | None = None
) -> tuple[GoalProblem, np.ndarray]:
    """Return the problem with its wishes as near as can be, one after the other.

    Args:
        problem: the problem of step 1; it is returned as it is where it has no solution.
        wishes: in the order of their priority.
        seed: seed of the covering.
        found: (1, 4) unit quaternion of a rotation from the start that solves the problem; None to look for
            one where there are wishes.

    Returns:
        The problem, and a quaternion (1, 4) of a rotation from the start that solves it, or none (0, 4).
        Where the wishes leave hardly any room, that may be the only solution that can be found.
    """
    if found is None:
        found = multistart.minima(assemble(problem), 1, seed) if wishes else np.empty((0, 4))
    if not len(found):
        return problem, found
    near = found[0]
    for wish in wishes:
        near, reach = _minimise_reach(problem, wish, seed, near)
        problem = replace(problem, wishes=(*problem.wishes, wish._replace(reach=reach)))
    return problem, multistart.minimum_near(assemble(problem), near)


def _minimise_reach(
    problem: GoalProblem, wish: Wished, seed: int, near: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the rotation from the start at which a wish is nearest, and how near it is.

    Args:
        problem: with the wishes before, each within its reach.
        wish: the next one.
        seed: seed of the covering.
        near: (4,) unit quaternion of a solution of the problem to start from.

    Returns:
        Unit quaternion (4,), and the least reach with which there is a solution plus `WISH_SPARE`, rad.
    """

    def within(reach: float) -> Caps:
        return assemble(replace(problem, wishes=(*problem.wishes, wish._replace(reach=reach))))

    least = np.pi
    for _ in range(_MAX_SEARCHES):
        near, least = multistart.least_widening(within, least, seed, near)
        if least <= _MIN_GAIN:
            break
        nearer = multistart.minima(within(least - _MIN_GAIN), 1, seed)
        if not len(nearer):
            break
        near, least = nearer[0], least - _MIN_GAIN
    return near, least + WISH_SPARE


@shown("joints", "share", "row", "sight", "ties")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class MadeWay:
    """How a device without a target moved out of the way: along which line, how far, and what stopped it.

    Attributes:
        joints: numbers of its o joints.
        toward: (o,) the clear place toward which it moved, as fractions of the joints' ranges (0 least, 1
            largest angle).
        share: () where it stopped on the line from where it would rather be (0) to that place (1).
        row: () int, the row of the constraints whose margin with `sight` is just `SPARE` there.
        sight: () int, number of that sight.
        ties: whether other pairs have the same margin, so that it is unknown which of them will bind.
    """

    joints: tuple[int, ...] = field(metadata={"static": True})
    toward: np.ndarray
    share: np.ndarray
    row: np.ndarray
    sight: np.ndarray
    ties: bool = field(metadata={"static": True})


def settled(
    problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray
) -> tuple[np.ndarray, tuple[MadeWay, ...]]:
    """Return the joints at a goal, with free devices as near to what they prefer as constraints allow.

    Args:
        problem: the problem of step 1.
        attitude: (3, 3) of the goal, body to inertial.
        joints: (J,) rad; those of devices with targets and held ones as they shall be, those of free ones as
            at the start.

    Returns:
        (J,) rad, and how devices made way, in the order in which they did. A device for which no place is
        clear is left where it would rather be.
    """
    gimbals = problem.spacecraft.gimbals
    free = problem.aims.free(gimbals)
    wishes = [(wish.device, wish.direction) for wish in problem.wishes]
    joints = preferred(gimbals, problem.ranges, free, wishes, attitude, joints)
    moves: list[MadeWay] = []
    for _ in range(2 if len(free) > 1 else 1):
        for number in free:
            if _least_margin(problem, attitude, joints, number) < 0:
                moved = _make_way(problem, attitude, joints, number)
                if moved is not None:
                    joints = _set_joints(
                        joints, moved.joints, _joints_at_share(moved, joints, problem.ranges, moved.share)
                    )
                    moves.append(moved)
    return joints, tuple(moves)


def preferred(
    gimbals: Gimbals,
    ranges: AnyArray,
    free: Sequence[int],
    wishes: Sequence[tuple[int, AnyArray]],
    attitude: AnyArray,
    joints: AnyArray,
) -> AnyArray:
    """Return joints (J,) rad with free devices where they would be without zones: at rest or nearest a wish.

    Args:
        gimbals: of the spacecraft.
        ranges: (J, 2) rad, at the goal.
        free: numbers of the free devices.
        wishes: pairs of a device's number and an inertial direction (3,); the first one of a device counts.
        attitude: (3, 3) of the goal, body to inertial.
        joints: (J,) rad, which devices without a wish keep, clipped to their ranges.
    """
    for number in free:
        own = gimbals.joints_of(number)
        place, (low, high) = joints[own], ranges[own].T
        wish = next((direction for device, direction in wishes if device == number), None)
        if wish is not None:
            frame = gimbals.frames[number : number + 1]
            azimuth, elevation = angles_along(frame, (wish @ attitude)[None])
            yaw = in_range(azimuth, ranges[own[:1]], place[:1])
            place = array_module(yaw, elevation).concatenate([yaw, elevation])[: len(own)]
        xp = array_module(place, low)
        # a comparison leaves the joint's own where it is at an end of its range, and with it the derivative
        joints = _set_joints(joints, own, xp.where(place < low, low, xp.where(place > high, high, place)))
    return joints


def places(
    moves: Sequence[MadeWay],
    ranges: AnyArray,
    rows: Constraints,
    sights: Sights,
    attitude: AnyArray,
    joints: AnyArray,
) -> AnyArray:
    """Return joints (J,) rad in which each device that makes way stops at a margin of `SPARE` of its pair.

    It takes one step of Newton's method along each device's line. Where a device was found to stop that
    changes nothing, and it gives the place its first derivatives.

    Args:
        moves: how devices made way, in the order in which they did.
        ranges: (J, 2) rad, at the goal.
        rows: all constraints.
        sights: the directions that they bind.
        attitude: (3, 3) of the goal, body to inertial.
        joints: (J,) rad, of free devices as `preferred` has them.
    """
    for move in moves:

        def margin(share: Any, move: MadeWay = move, joints: Any = joints) -> Any:
            place = _set_joints(joints, move.joints, _joints_at_share(move, joints, ranges, share))
            return state_margins(rows, sights, attitude, place)[move.row, move.sight]

        share = jnp.asarray(move.share, jnp.asarray(joints).dtype)
        least, slope = jax.jvp(margin, (share,), (jnp.ones_like(share),))
        share = share - (least - SPARE) / slope
        joints = _set_joints(joints, move.joints, _joints_at_share(move, joints, ranges, share))
    return joints


def _joints_at_share(move: MadeWay, joints: AnyArray, ranges: AnyArray, share: AnyArray) -> AnyArray:
    """Return the o joints of a device, rad, at a share of its line.

    The line begins at the device's angles in `joints` (J,).
    """
    own = np.array(move.joints)
    low, high = ranges[own].T
    return joints[own] + share * (low + move.toward * (high - low) - joints[own])


def rows_about_device(problem: GoalProblem, number: int) -> np.ndarray:
    """Tell which of Z rows are of constraints that bind a sight of a device or have one as axis."""
    rows = problem.rows
    takes_part = problem.sights.carriers == number
    concerned = np.any(rows.bound[:, takes_part], axis=1) | ((rows.frame == SIGHT) & takes_part[rows.partner])
    return np.isin(rows.group, rows.group[concerned])


def _least_margin(problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray, number: int) -> np.ndarray:
    """Return the least margin (...) of the constraints that concern device `number`, less `SPARE`, in rad.

    It is negative where the device must make way, and infinite where nothing concerns the device.

    Args:
        problem: the problem of step 1.
        attitude: (3, 3) body to inertial.
        joints: (..., J) rad.
        number: number of the device.
    """
    attitudes = np.broadcast_to(attitude, (*joints.shape[:-1], 3, 3))
    margins = constraint_margins(problem.rows, problem.margins(attitudes, joints))
    return (
        np.min(np.where(rows_about_device(problem, number), margins, np.inf), axis=-1, initial=np.inf) - SPARE
    )


def _make_way(problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray, number: int) -> MadeWay | None:
    """Return how device `number` makes way so that all constraints about it hold; None if it cannot."""
    own = problem.spacecraft.gimbals.joints_of(number)
    wanted, ranges = joints[own], problem.ranges[own]
    rates = problem.spacecraft.joint_rate_limits[own]
    best: np.ndarray | None = None
    cost, window = np.inf, ranges
    for number_of_grids in range(_MAX_GRIDS):
        if best is not None and number_of_grids > _GRID_REFINEMENTS:
            break
        axes = [np.linspace(ends[0], ends[1], _GRID_POINTS[len(own) - 1]) for ends in window]
        places = np.stack([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")], axis=-1)
        margins = _least_margin(problem, attitude, _joints_at_places(joints, own, places), number)
        clear = places[margins >= 0]
        if len(clear):
            costs = np.max(np.abs(clear - wanted) / rates, axis=-1)
            if np.min(costs) < cost:
                best, cost = clear[np.argmin(costs)], np.min(costs)
        centre = places[np.argmax(margins)] if best is None else best  # a clear place may lie between
        around = 2 * np.array([axis[1] - axis[0] for axis in axes])
        window = np.clip(np.stack([centre - around, centre + around], axis=-1), ranges[:, :1], ranges[:, 1:])
    if best is None:
        return None
    share, step = 1.0, 0.5  # of the line from where it would rather be
    for _ in range(_BISECTIONS):
        tried = share - step
        place = wanted + tried * (best - wanted)
        if _least_margin(problem, attitude, _joints_at_places(joints, own, place[None]), number)[0] >= 0:
            share = tried
        step /= 2
    low, high = ranges.T
    toward = np.where(high > low, (best - low) / np.where(high > low, high - low, 1), 0)
    return _record_made_way(
        problem, attitude, _set_joints(joints, own, wanted + share * (best - wanted)), number, toward, share
    )


def _record_made_way(
    problem: GoalProblem,
    attitude: np.ndarray,
    joints: np.ndarray,
    number: int,
    toward: np.ndarray,
    share: float,
) -> MadeWay:
    """Make the `MadeWay` of device `number`, with the pair of row and sight whose margin is the least one.

    Args:
        problem: the problem of step 1.
        attitude: (3, 3) of the goal, body to inertial.
        joints: (J,) rad, with the device's where it stops.
        number: number of the device.
        toward: fractions of the ranges of the device's joints, as in `MadeWay`.
        share: as in `MadeWay`.
    """
    margins = problem.margins(attitude, joints)
    least = float(_least_margin(problem, attitude, joints, number)) + SPARE
    counts = problem.rows.bound & rows_about_device(problem, number)[:, None]
    off = np.where(counts, np.abs(margins - least), np.inf)
    row, sight = np.unravel_index(np.argmin(off), off.shape)
    own = tuple(problem.spacecraft.gimbals.joints_of(number).tolist())
    return MadeWay(
        joints=own,
        toward=toward,
        share=np.array(share),
        row=np.array(row),
        sight=np.array(sight),
        ties=bool(np.sum(off <= _TIE_TOLERANCE) > 1),
    )


def _set_joints(joints: AnyArray, own: Sequence[int] | np.ndarray, values: AnyArray) -> AnyArray:
    """Return a copy of joints (J,) in which the o joints numbered `own` have `values` (o,).

    It is an array of numpy, or of JAX where either argument is.
    """
    which = np.asarray(own)
    if array_module(joints, values) is jnp:
        return jnp.asarray(joints).at[which].set(values)
    found = np.array(joints)
    found[which] = values
    return found


def _joints_at_places(joints: np.ndarray, own: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return k copies (k, J) of joints (J,), in which the o joints numbered `own` have `places` (k, o)."""
    found = np.repeat(joints[None], len(places), axis=0)
    found[:, own] = places
    return found
