"""Aims of a goal: which device must point where within which ranges, and what that tells of directions.

Every device with a target is treated alike: in axes of its own, see `jaxplan.model.gimbals`, the target must
lie in a range of azimuth and a range of elevation. A terminal's ranges are those of its joints at the goal. A
drive has a range of azimuth, but its elevation must equal its tilt; for an instrument both angles must be
zero, in axes whose first one is its boresight. An angle without a range is an *equation*, which is met to a
tolerance. Where no attitude meets all aims, messages tell by how much the best attitude there is misses them
(`jaxplan.goal.Decomposition`).

A device without a target is either *held*: it keeps its joints, so that its boresight is an axis of the body.
Or it is *free* to move, and nothing is known of it before its joints are chosen
(`jaxplan.goal.free_devices`).

A *sight* is a direction that constraints bind, such as a device's boresight or an axis of the body, numbered
as in `jaxplan.model.directions.Sights`: the boresights of the devices come first, in the order of the
devices. Shapes: k devices with targets, J joints, S sights. All of it computes with numpy or JAX.
"""

from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, array_module, arrays, separation
from jaxplan.model.directions import Sights
from jaxplan.model.gimbals import TURN, Gimbals, angles_toward, frame_of, in_range, stacked
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft

AZIMUTH, ELEVATION = 0, 1
_TOLERANCE_SHARE = 0.5  # share of the tolerance that either angle of an equation may take
_NAMED_EXCESS_SHARE = 0.5  # devices off by this share of the worst excess or more are named, too


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Aims:
    """The k devices that have targets, with the azimuths and elevations at which each must see its own.

    Attributes:
        devices: numbers of the devices with targets, which are also the numbers of their boresights as
            sights.
        held: numbers of the gimbals that keep their joints.
        equations: for each device with a target, whether its azimuth is an equation, and whether its
            elevation is.
        directions: (k, 3) inertial directions of the targets.
        frames: (k, 3, 3) rotations from each device's axes, in which azimuth and elevation are, to body axes.
        ranges: (k, 2, 2) rad, least and largest azimuth, then least and largest elevation.
    """

    devices: tuple[int, ...] = field(metadata={"static": True})
    held: tuple[int, ...] = field(metadata={"static": True})
    equations: tuple[tuple[bool, bool], ...] = field(metadata={"static": True})
    directions: np.ndarray
    frames: np.ndarray
    ranges: np.ndarray

    @property
    def has_equations(self) -> bool:
        """Whether the azimuth or elevation of any device is an equation."""
        return any(any(own) for own in self.equations)

    def free(self, gimbals: Gimbals) -> list[int]:
        """Return the numbers of the gimbals that have no target and are not held."""
        return [number for number in range(gimbals.count) if number not in (*self.devices, *self.held)]

    def angles(self, attitude: ArrayLike) -> tuple[AnyArray, AnyArray]:
        """Return azimuths and elevations of the k targets in the devices' axes, each (..., k) rad.

        Azimuths are moved by whole turns to within half a turn of the middle of their ranges.

        Args:
            attitude: (..., 3, 3) body to inertial.
        """
        _, turn, directions, frames, ranges = arrays(attitude, self.directions, self.frames, self.ranges)
        azimuth, elevation = angles_toward(frames, turn, directions)
        return in_range(azimuth, ranges[:, AZIMUTH]), elevation

    def excess(self, attitude: np.ndarray) -> np.ndarray:
        """Return how far azimuths and elevations of the k targets are out of their ranges, (..., k, 2) rad.

        Values are positive outside a range and negative inside.

        Args:
            attitude: (..., 3, 3) body to inertial.
        """
        angles = np.stack(self.angles(attitude), axis=-1)
        return np.maximum(self.ranges[..., 0] - angles, angles - self.ranges[..., 1])


def goal_ranges(craft: Spacecraft, targets: Targets) -> AnyArray:
    """Return the joint ranges (J, 2) rad at the goal: the spacecraft's, or the targets' limits if tighter."""
    n, drives = len(craft.terminals), len(craft.drives)
    given = [np.inf if limit is None else limit for limit in (targets.yaw_limit, targets.pitch_limit)]
    most = stacked([*[given[0]] * n, *[given[1]] * n, *[np.inf] * drives])
    xp, own, most = arrays(craft.joint_ranges, most)
    # where both are equal the comparison takes the joint's own limit, and its derivative
    low = xp.where(-most > own[:, 0], -most, own[:, 0])
    high = xp.where(most < own[:, 1], most, own[:, 1])
    return xp.stack([low, high], axis=-1)


def aims_of(craft: Spacecraft, targets: Targets, ranges: AnyArray, tolerance: float = 0.0) -> Aims:
    """Make the aims that targets set for the devices of a spacecraft.

    Args:
        craft: terminals, drives and instruments.
        targets: where they are at the goal.
        ranges: (J, 2) rad, joint ranges at the goal, see `goal_ranges`.
        tolerance: rad, within which equations are met; zero for exactly.
    """
    names, gimbals = craft.device_names, craft.gimbals.count
    devices = targets.numbers(craft)
    held = tuple(
        number for number in range(gimbals) if number not in devices and names[number] in targets.hold
    )
    boxes = [box_of(craft, number, ranges, _TOLERANCE_SHARE * tolerance) for number in devices]
    directions = targets.directions
    return Aims(
        devices=devices,
        held=held,
        equations=tuple((number >= gimbals, number >= len(craft.terminals)) for number in devices),
        directions=array_module(directions).asarray(directions, float).reshape(-1, 3),
        frames=stacked([frame for frame, _ in boxes]).reshape(-1, 3, 3),
        ranges=stacked([box for _, box in boxes]).reshape(-1, 2, 2),
    )


def box_of(craft: Spacecraft, number: int, ranges: AnyArray, share: float) -> tuple[AnyArray, AnyArray]:
    """Return the axes of a device, and the range of azimuth and elevation in which it can point.

    Args:
        craft: the spacecraft.
        number: number of the device.
        ranges: (J, 2) rad, of the joints at the goal.
        share: rad, by which an angle without a range may be off to either side.

    Returns:
        (3, 3) rotation from the device's axes to body axes, and (2, 2) rad, least and largest azimuth, then
        elevation.
    """
    gimbals, around = craft.gimbals, np.array([-share, share])
    if number >= gimbals.count:
        boresight = craft.fixed_boresights[number - gimbals.count]
        return frame_of(_perpendicular_vector(boresight), boresight), np.array([around, around])
    azimuth = ranges[gimbals.yaws[number]]
    if number < gimbals.terminals:
        elevation = ranges[gimbals.pitches[number]]
    else:
        elevation = gimbals.tilts[number - gimbals.terminals] + around
    return gimbals.frames[number], array_module(azimuth, elevation).stack([azimuth, elevation])


def _perpendicular_vector(boresight: AnyArray) -> AnyArray:
    """Return some vector (3,), not of unit length, perpendicular to a unit boresight (3,)."""
    xp, ahead = arrays(boresight)
    flat = jax.lax.stop_gradient(ahead) if xp is not np else ahead
    least = xp.eye(3)[xp.argmin(xp.abs(flat))]
    return least - xp.sum(least * ahead) * ahead


def pointed(gimbals: Gimbals, aims: Aims, attitude: ArrayLike, rest: ArrayLike) -> AnyArray:
    """Return joints (..., J) rad with which devices point at their targets, at attitudes (..., 3, 3).

    Pitches are not clipped to their ranges.

    Args:
        gimbals: of the spacecraft.
        aims: what must point where.
        attitude: (..., 3, 3) body to inertial.
        rest: (J,) rad, joints that devices without a target keep; of the angles that differ by whole turns a
            yaw takes the one within its range that is nearest to its angle here.
    """
    xp, turn, others = arrays(attitude, rest)
    joints = xp.broadcast_to(others, (*turn.shape[:-2], *others.shape))
    own = [(place, number) for place, number in enumerate(aims.devices) if number < gimbals.count]
    if not own:
        return joints
    places, numbers = (np.array(part) for part in zip(*own, strict=True))
    of_terminals = numbers < gimbals.terminals  # in any order among the targets
    _, directions, frames, ranges = arrays(aims.directions, aims.frames, aims.ranges)
    azimuth, elevation = angles_toward(frames[places], turn, directions[places])
    yaws = gimbals.yaws[numbers]
    yaw = in_range(azimuth, ranges[places, AZIMUTH], others[yaws])
    pitches = gimbals.pitches[numbers[of_terminals]]
    found = xp.concatenate([yaw, elevation[..., of_terminals]], axis=-1)
    which = np.concatenate([yaws, pitches])
    if xp is np:
        joints = np.array(joints)
        joints[..., which] = found
        return joints
    return joints.at[..., which].set(found)


class Known(NamedTuple):
    """Directions of the S sights that are known at a goal whatever the attitude, and in which frame.

    Attributes:
        inertial: (S,) bool, sights whose inertial direction is known.
        in_body: (S,) bool, sights whose direction in body axes is known.
        toward: (S, 3) inertial unit vectors of the sights known in the inertial frame; zero for the others.
        along: (S, 3) unit vectors in body axes of the sights known there; zero for the others.
        angles: (S,) bool, sights that are boresights of gimbals that keep their joints.
        winds: (S,) bool, sights with a target whose range of azimuth is wider than a whole turn.
    """

    inertial: np.ndarray
    in_body: AnyArray
    toward: AnyArray
    along: AnyArray
    angles: AnyArray
    winds: AnyArray


def known_sights(aims: Aims, sights: Sights, rest: ArrayLike) -> Known:
    """Tell which directions of sights are known at a goal, whatever the attitude.

    Args:
        aims: the aims of the goal.
        sights: the sights that the constraints bind.
        rest: (J,) rad, joints that held devices keep.
    """
    count, gimbals, carriers = sights.count, sights.gimbals.count, sights.carriers
    inertial = np.zeros(count, bool)
    inertial[list(aims.devices)] = True
    held = array_module(carriers).any(carriers[:, None] == np.array(aims.held, int), axis=-1)
    in_body = (carriers < 0) | held
    xp, directions, along, ranges = arrays(aims.directions, sights.in_body(rest), aims.ranges)
    own = np.zeros((count, len(aims.devices)), directions.dtype)
    own[list(aims.devices), np.arange(len(aims.devices))] = 1
    return Known(
        inertial=inertial,
        in_body=in_body,
        toward=own @ directions,
        along=xp.where(in_body[:, None], along, 0.0),
        angles=held & (np.arange(count) < gimbals),
        winds=own @ (ranges[:, AZIMUTH, 1] - ranges[:, AZIMUTH, 0] > TURN) > 0,
    )


def apart(craft: Spacecraft, asked: Targets) -> str | None:
    """Return text on two instruments that cannot both see their targets; None if there are no such two.

    It compares the angle between their boresights with that between their targets, which must agree within
    the tolerance.
    """
    first, names = craft.gimbals.count, craft.device_names
    fixed = [(place, number) for place, number in enumerate(asked.numbers(craft)) if number >= first]
    for (i, one), (j, other) in combinations(fixed, 2):
        boresights = craft.fixed_boresights[[one - first, other - first]]
        between, targets = separation(*boresights), separation(asked.directions[i], asked.directions[j])
        if abs(between - targets) > 2 * asked.tolerance:
            return (
                f"{names[one]} and {names[other]} are {np.rad2deg(between):.6g} deg apart, their targets "
                f"{np.rad2deg(targets):.6g} deg: they differ by {np.rad2deg(abs(between - targets)):.3g} deg "
                f"and {np.rad2deg(2 * asked.tolerance):.3g} deg is tolerated"
            )
    return None


def off(craft: Spacecraft, asked: Targets, excesses: np.ndarray) -> str:
    """Return text on the devices that miss their targets most: joints beyond limits, boresights off targets.

    Args:
        craft: with the devices.
        asked: their targets, at an instant.
        excesses: (n, 2) rad, `jaxplan.goal.Decomposition.aim_excesses` of the n devices with targets.
    """
    told: dict[str, str] = {}
    gimbals, ranges = craft.gimbals, goal_ranges(craft, asked)
    bad = np.argwhere(excesses >= _NAMED_EXCESS_SHARE * np.max(excesses)).tolist()
    for place, angle in bad:
        device, by = asked.numbers(craft)[place], np.rad2deg(excesses[place, angle])
        if device < len(craft.terminals) or (device < gimbals.count and angle == AZIMUTH):
            joint = (gimbals.yaws if angle == AZIMUTH else gimbals.pitches)[device]
            told[craft.joint_names[joint]] = f"{by:.4g} deg beyond {_range_text(ranges[joint])}"
        else:  # an angle in the axes of its boresight: with the other one it makes up the distance
            by = np.rad2deg(np.linalg.norm(np.maximum(excesses[place], 0)))
            told[craft.device_names[device]] = f"{by:.4g} deg off its target"
    each = [f"{name} is {what}" for name, what in told.items()]
    return " and ".join(", ".join(each).rsplit(", ", 1))


def _range_text(ends: np.ndarray) -> str:
    """Return text for a joint's range (2,) rad, in degrees."""
    low, high = np.rad2deg(ends)
    return f"its limit of {high:.6g} deg" if low == -high else f"its range of {low:.6g} to {high:.6g} deg"
