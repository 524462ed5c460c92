"""The constraints of problem (7) in one form: caps that directions must stay out of.

With ``R = R0 E`` an inertial direction ``z`` has the body components ``E^T R0^T z``. Every constraint on the
goal keeps one such vector out of a cap of the unit sphere in body axes, of axis ``a`` and half-angle ``h``:

    yaw <= Y         half the sphere, beyond the plane at the yaw Y; likewise for the lower limit (equation 4)
    pitch <= P       around the body's z axis, ``h = pi / 2 - P``; around -z for the lower limit
    keep-out zone    around an instrument's boresight, for the zone's direction; ``h`` is its half-angle
    keep-in zone     around the opposite of the boresight; ``h`` is pi less its half-angle

So the angle between ``a`` and ``E^T R0^T z`` is at least ``h``, and what is missing is the excess, in rad.
Constraints of which one is enough (a yaw range wider than half a turn, zones of one group) are members of
a group; a member may have several caps, all of which must be clear.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.model.constraints import Constraints, angle_between, capacity
from jaxplan.spacecraft import Spacecraft

HAIR = 1e-12
"""rad; caps are wider than the constraints by this, so that rounding breaks none."""
EMPTY = 1e-9
"""rad; caps of a smaller half-angle are left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Caps:
    """All caps of a problem, padded with empty ones; sorted by group, then by member.

    Attributes:
        axis: (m, 3) unit vectors in body axes; zero for an empty cap.
        direction: (m, 3) unit vectors that stay out of the caps, in the body axes of the start.
        half_angle: (m,) rad, -1 for an empty cap.
        member: (m,) number of the member that the cap belongs to, ascending.
        group: (m,) number of the group that the member belongs to.
        zone: (m,) row of the zone that the cap is of; -1 for those of joints and empty ones.
        instrument: (m,) number of the instrument, likewise.
    """

    axis: np.ndarray
    direction: np.ndarray
    half_angle: np.ndarray
    member: np.ndarray
    group: np.ndarray
    zone: np.ndarray
    instrument: np.ndarray

    def excess(self, rotation: np.ndarray) -> np.ndarray:
        """How deep (m,) the directions are inside the caps after a rotation ``E`` (3, 3), rad."""
        body = self.direction @ rotation
        sine = np.linalg.norm(np.cross(self.axis, body), axis=-1)
        return self.half_angle - np.arctan2(sine, np.sum(self.axis * body, axis=-1))


def assemble(
    spacecraft: Spacecraft,
    start_attitude: np.ndarray,
    directions: np.ndarray,
    joint_limits: np.ndarray,
    cones: Constraints,
    widening: float = 0.0,
) -> Caps:
    """The caps of a goal at which the terminals point along given directions.

    Terminals point there whatever the attitude, so zones that bind them alone give no cap. A group
    gives none either when one of its zones holds for that reason, or when none can.

    Args:
        spacecraft: its mounts and instruments.
        start_attitude: (3, 3) body to inertial, ``R0``.
        directions: (n, 3) inertial unit vectors, one a terminal.
        joint_limits: (2n,) rad; from pi for a yaw and from pi / 2 for a pitch there is no limit.
        cones: all zones.
        widening: rad by which every zone is made easier.
    """
    joint_axis, joint_half_angle, joint_group = _of_joints(spacecraft.mounts, joint_limits)
    zone, instrument = _zones_at_goal(directions, cones)
    side = cones.side[zone]
    zone_axis = side[:, None] * spacecraft.fixed_boresights[instrument]
    zone_half_angle = np.where(side > 0, 0, np.pi) + side * cones.half_angle[zone] - widening

    joints, used = len(joint_group), len(joint_group) + len(zone)
    size = max(8, capacity(used))
    rest = np.arange(used, size)

    def padded(of_joints: np.ndarray | int, of_zones: np.ndarray, of_rest: np.ndarray | int) -> np.ndarray:
        rows = np.empty((size, *of_zones.shape[1:]), dtype=of_zones.dtype)
        rows[:joints], rows[joints:used], rows[used:] = of_joints, of_zones, of_rest
        return rows

    half_angle = padded(joint_half_angle, zone_half_angle, 0)
    there = half_angle > EMPTY
    return Caps(
        axis=np.where(there[:, None], padded(joint_axis, zone_axis, 0), 0),
        direction=padded(np.repeat(directions, 5, axis=0), cones.axis[zone], 0) @ start_attitude,
        half_angle=np.where(there, half_angle + HAIR, -1),
        member=padded(np.arange(joints), joints + _runs(zone), rest),
        group=padded(joint_group, joints + _runs(cones.group[zone]), rest),
        zone=padded(-1, zone, -1),
        instrument=padded(-1, instrument, -1),
    )


def _of_joints(mounts: np.ndarray, joint_limits: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axis (5n, 3), half-angle (5n,) and group (5n,) of each terminal's caps: two yaw, two pitch, its back.

    A yaw range wider than half a turn is the union of two half-spaces, so one of its caps is enough. A
    narrower one is their intersection. Where it is very narrow the point right behind is nearly clear of
    both caps, too; the cap over the whole back tells it apart.
    """
    count = len(mounts)
    yaw, pitch = np.minimum(joint_limits[:count], np.pi), joint_limits[count:]
    axis, half_angle = np.zeros((count, 5, 3)), np.full((count, 5), np.pi / 2)
    for row, sign in ((0, 1.0), (1, -1.0)):
        edge = mounts + sign * (yaw + np.pi / 2)  # sin(yaw limit -+ yaw) >= 0
        axis[:, row, 0], axis[:, row, 1] = np.cos(edge), np.sin(edge)
        axis[:, row + 2, 2] = sign
        half_angle[:, row + 2] -= pitch
    axis[:, 4, 0], axis[:, 4, 1] = -np.cos(mounts), -np.sin(mounts)
    half_angle[yaw >= np.pi / 2, 4] = 0
    group = np.arange(5 * count).reshape(count, 5)
    group[:, 1] = np.where(yaw > np.pi / 2, group[:, 0], group[:, 1])
    return axis.reshape(-1, 3), half_angle.reshape(-1), group.reshape(-1)


def _zones_at_goal(directions: np.ndarray, cones: Constraints) -> tuple[np.ndarray, np.ndarray]:
    """Zone and instrument of each pair that the attitude decides on, sorted by group, then by zone."""
    count = len(directions)
    terminals, instruments = cones.bound[:, :count], cones.bound[:, count:]
    holds = np.all(~terminals | (_terminal_margins(directions, cones) >= 0), axis=-1)
    alone = np.bincount(cones.group, minlength=len(cones.group))[cones.group] == 1
    settled = cones.group[holds & ~alone & ~np.any(instruments, axis=-1)]  # hold whatever the attitude
    open_ = (alone | holds) & ~np.isin(cones.group, settled)
    zone, instrument = np.nonzero(instruments & open_[:, None])
    order = np.lexsort((zone, cones.group[zone]))
    return zone[order], instrument[order]


def _terminal_margins(directions: np.ndarray, cones: Constraints) -> np.ndarray:
    """Margin (Z, n) to every zone of every terminal that points along its direction, rad."""
    angle = angle_between(cones.axis[:, None], directions[None])
    return np.asarray(cones.side[:, None] * (angle - cones.half_angle[:, None]))


def _runs(keys: np.ndarray) -> np.ndarray:
    """Number of the run of equal neighbours that each key is in, from 0."""
    return np.cumsum(np.concatenate([[0], np.diff(keys) != 0]))[: len(keys)]


def deepest_zone(caps: Caps, rotation: np.ndarray) -> tuple[float, int | None, int | None]:
    """The zone that a rotation from the start breaks most, or is nearest to breaking.

    Args:
        caps: the caps.
        rotation: (3, 3) ``E``.

    Returns:
        How deep an instrument is inside, rad, negative when it is clear; the zone and the instrument. Of a
        group it is the zone broken least. Without zones ``(-inf, None, None)``.
    """
    inside = caps.excess(rotation) - HAIR
    worst_of_member: dict[tuple[int, int], tuple[float, int, int]] = {}
    for row in np.flatnonzero(caps.zone >= 0):
        found = (float(inside[row]), int(caps.zone[row]), int(caps.instrument[row]))
        key = (int(caps.group[row]), int(caps.member[row]))
        worst_of_member[key] = max(worst_of_member.get(key, found), found)
    best_of_group: dict[int, tuple[float, int, int]] = {}
    for (group, _), found in worst_of_member.items():
        best_of_group[group] = min(best_of_group.get(group, found), found)
    return max(best_of_group.values(), default=(-np.inf, None, None))
