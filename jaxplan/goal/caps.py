"""Pairs and groups of step 1 as caps: cones about body axes that a target's direction stays out of.

Caps of which not all need be clear: the kernels' side of groups.

A group asks for one of its members, a member for all of its caps. Lanes are the last axis, m caps the first.

What each pair of a row and a sight asks of the attitude at a goal.

At a goal a terminal points along its target ``z``, so along ``R^T z`` in the body. Of most directions it is
known, then, where they are in one of two frames: targets and inertial axes in the inertial one, boresights of
instruments and axes of the body in the body's. A pair of the same frame is settled whatever the attitude; one
of either is a cap that a direction keeps out of (`caps`). So is a row of joints that bounds a yaw or a pitch
alone. All other pairs depend on what the joints are: step 1 leaves them open, and who uses a goal checks them
in its state.

All of it computes with numpy or JAX, as its arguments do. Shapes: Z rows, S sights.

The constraints of problem (7) in one form: caps that directions must stay out of.

With ``R = R0 E`` an inertial direction ``z`` has the body components ``E^T R0^T z``. Every constraint on the
goal keeps one such vector out of a cap of the unit sphere in body axes, of axis ``a`` and half-angle ``h``:

    yaw <= Y         half the sphere, beyond the plane at the yaw Y; likewise for the lower limit (equation 4)
    pitch <= P       around the body's z axis, ``h = pi / 2 - P``; around -z for the lower limit
    keep-out cone    around what is fixed to the body, for what is inertial: an instrument or an axis of the
                     body for a zone's direction or a target, or a cone's axis in the body for a target;
                     ``h`` is its half-angle
    keep-in cone     around the opposite; ``h`` is pi less its half-angle

So the angle between ``a`` and ``E^T R0^T z`` is at least ``h``, and what is missing is the excess, in rad.
Constraints of which one is enough (a yaw range wider than half a turn, entries of one constraint) are members
of a group; a member may have several caps, all of which must be clear.

What the attitude does not decide gives no cap (`caps`): an entry is held against what is settled, and where
a constraint has an entry that nothing of a cap stands against, it gives none at all.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, product
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import AnyArray, arrays, separation
from jaxplan.model.constraints import (
    BODY,
    INERTIAL,
    JOINTS,
    SIGHT,
    Constraints,
    best_entries,
    chosen_entries,
    pair_margins,
)
from jaxplan.model.directions import Sights
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.batching import padded_count


def group_excess(excess: Array, member: Array, group: Array) -> Array:
    """Excess of each group: the worst cap of its best member.

    Args:
        excess: (m, K) of every cap.
        member: (m,) number of each cap's member, ascending.
        group: (m,) number of each cap's group.

    Returns:
        (m, K), -inf for numbers that no group has.
    """
    of_group, _, _ = _by_group(excess, member, group)
    return jnp.where(of_group < jnp.inf, of_group, -jnp.inf)


def applies(excess: Array, member: Array, group: Array) -> Array:
    """Which caps belong to the best member of their group, the first one where several are as good.

    Args:
        excess: (m, K) of every cap.
        member: (m,) number of each cap's member, ascending.
        group: (m,) number of each cap's group.

    Returns:
        (m, K) bool.
    """
    of_group, of_member, group_of = _by_group(excess, member, group)
    count = excess.shape[0]
    best = jnp.where(of_member <= of_group[group_of], jnp.arange(count)[:, None], count)
    chosen = jax.ops.segment_min(best, group_of, num_segments=count)
    return chosen[group] == member[:, None]


def _by_group(excess: Array, member: Array, group: Array) -> tuple[Array, Array, Array]:
    """Excess of each group and each member, +inf for numbers not used, and the group of each member."""
    count = excess.shape[0]
    of_member = jax.ops.segment_max(excess, member, num_segments=count, indices_are_sorted=True)
    used = jnp.zeros(count, bool).at[member].set(True)
    of_member = jnp.where(used[:, None], of_member, jnp.inf)
    group_of = jnp.zeros_like(group).at[member].set(group)
    return jax.ops.segment_min(of_member, group_of, num_segments=count), of_member, group_of


class Pairs(NamedTuple):
    """Every pair at a goal.

    Attributes:
        settled: (Z, S) bool, pairs that the attitude changes nothing about.
        margin: (Z, S) rad, of those that are settled.
        capped: (Z, S) bool, pairs that are caps. A bound of a yaw is one beside others, see `caps`.
        axis: (Z, S, 3) of the cap, unit vectors in body axes.
        direction: (Z, S, 3) unit vectors that stay out of the caps, inertial.
        half_angle: (Z, S) rad.
    """

    settled: AnyArray
    margin: AnyArray
    capped: AnyArray
    axis: AnyArray
    direction: AnyArray
    half_angle: AnyArray


def pairs_at_goal(rows: Constraints, sights: Sights, directions: ArrayLike) -> Pairs:
    """All pairs of a scene as they are at a goal.

    Args:
        rows: the constraints, at an instant.
        sights: what they bind.
        directions: (n, 3) inertial unit vectors that the terminals point along.
    """
    xp, toward, fixed, axis = arrays(directions, sights.fixed, rows.axis)
    side, half_angle = rows.side[:, None], rows.half_angle[:, None]
    known = _known(sights)
    seen = xp.concatenate([toward, fixed, xp.zeros(sights.carried.shape, toward.dtype)])
    frame = rows.frame[:, None]
    if rows.inner:
        another = frame == SIGHT
        axis = xp.where(another, seen[rows.partner], axis)
        frame = xp.where(another, xp.asarray(known)[rows.partner][:, None], frame)
    in_body = known == BODY
    mixed = ((frame == INERTIAL) & in_body) | ((frame == BODY) & (known == INERTIAL))
    pairs = Pairs(
        settled=rows.bound & (frame == known) & (known != JOINTS),
        margin=pair_margins(rows, seen, axis),
        capped=rows.bound & mixed,
        axis=side[..., None] * xp.where(in_body[:, None], seen, axis[:, None]),
        direction=xp.where(in_body[:, None], axis[:, None], seen),
        half_angle=xp.broadcast_to(xp.where(side > 0, 0, np.pi) + side * half_angle, rows.bound.shape),
    )
    return _with_joints(pairs, rows, sights, seen) if rows.inner else pairs


def _known(sights: Sights) -> np.ndarray:
    """The frame (S,) in which each sight is known at a goal; `JOINTS` where it takes the joints to know."""
    counts = [sights.mounts.shape[0], sights.fixed.shape[0], sights.carried.shape[0]]
    return np.repeat([INERTIAL, BODY, JOINTS], counts)


def _with_joints(pairs: Pairs, rows: Constraints, sights: Sights, seen: AnyArray) -> Pairs:
    """The pairs with caps for rows of joints that bound a yaw or a pitch alone."""
    xp, normal, bound, mounts = arrays(rows.axis, rows.half_angle, sights.mounts)
    of_yaw, sign = single_yaws(rows), xp.sign(normal[:, 0] + normal[:, 1])
    rest = np.zeros(rows.bound.shape[1] - mounts.shape[0])
    edge = xp.concatenate([mounts, rest]) + (sign * (bound - np.pi / 2))[:, None]
    yaw_axis = xp.stack([xp.cos(edge), xp.sin(edge), xp.zeros_like(edge)], axis=-1)
    pitch_axis = -sign[:, None, None] * np.array([0.0, 0.0, 1.0])
    half_angle = np.pi / 2 + xp.where(of_yaw, 0, bound)[:, None]
    ours = (rows.frame == JOINTS)[:, None]
    alone = of_yaw | (normal[:, 0] == 0)
    return pairs._replace(
        capped=xp.where(ours, rows.bound & alone[:, None], pairs.capped),
        axis=xp.where(ours[..., None], xp.where(of_yaw[:, None, None], yaw_axis, pitch_axis), pairs.axis),
        direction=xp.where(ours[..., None], seen, pairs.direction),
        half_angle=xp.where(ours, half_angle, pairs.half_angle),
    )


def single_yaws(rows: Constraints) -> AnyArray:
    """(Z,) bool, the rows of joints that bound a yaw alone."""
    return (rows.frame == JOINTS) & (rows.axis[:, 1] == 0)


def leaves_open(rows: Constraints, sights: Sights, directions: ArrayLike) -> bool:
    """Whether there are pairs that neither the targets nor the attitude at a goal decide."""
    pairs = pairs_at_goal(rows, sights, directions)
    return bool(np.any(rows.bound & ~pairs.settled & ~pairs.capped))


HAIR = 1e-12
"""rad; caps are wider than the constraints by this, so that rounding breaks none."""
EMPTY = 1e-9
"""rad; caps of a smaller half-angle are left out."""
ALTERNATIVES = 16
"""Members that an entry is made of at most; beyond, its wide bounds of yaws are left open."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Caps:
    """All caps of a problem, padded with empty ones; sorted by group, then by member.

    Attributes:
        axis: (m, 3) unit vectors in body axes; zero for an empty cap.
        direction: (m, 3) unit vectors that stay out of the caps, in the body axes of the start.
        half_angle: (m,) rad, -1 for an empty cap.
        member: (m,) number of the member that the cap belongs to, ascending.
        group: (m,) number of the group that the member belongs to.
        row: (m,) the row of the constraints that the cap is of; -1 for limits of joints and empty ones.
        sight: (m,) number of the sight, likewise.
    """

    axis: np.ndarray
    direction: np.ndarray
    half_angle: np.ndarray
    member: np.ndarray
    group: np.ndarray
    row: np.ndarray
    sight: np.ndarray

    def excess(self, rotation: np.ndarray) -> np.ndarray:
        """How deep (m,) the directions are inside the caps after a rotation ``E`` (3, 3), rad."""
        return np.asarray(self.half_angle - separation(self.axis, self.direction @ rotation))


class _Cap(NamedTuple):
    """One cap of a row, its direction inertial."""

    row: int
    sight: int
    axis: np.ndarray
    direction: np.ndarray
    half_angle: float


_Member = list[_Cap]
_Group = list[_Member]


def assemble(
    spacecraft: Spacecraft,
    start_attitude: np.ndarray,
    directions: np.ndarray,
    joint_limits: np.ndarray,
    cones: Constraints,
    widening: float = 0.0,
) -> Caps:
    """The caps of a goal at which the terminals point along given directions.

    Pairs that are settled or open, see `caps`, give no cap. A constraint of several entries gives none
    either when one of these holds for that reason or may hold, or when none can.

    Args:
        spacecraft: its mounts and instruments.
        start_attitude: (3, 3) body to inertial, ``R0``.
        directions: (n, 3) inertial unit vectors, one a terminal.
        joint_limits: (2n,) rad; from pi for a yaw and from pi / 2 for a pitch there is no limit.
        cones: all constraints.
        widening: rad by which every row is made easier.
    """
    joint_axis, joint_half_angle, joint_group = _of_joints(spacecraft.mounts, joint_limits)
    groups = list(_of_rows(spacecraft, directions, joint_limits, cones, widening))
    members = [(number, member) for number, group in enumerate(groups) for member in group]
    found = [(group, number, cap) for number, (group, member) in enumerate(members) for cap in member]
    joints, used = len(joint_group), len(joint_group) + len(found)
    size = max(8, padded_count(used))
    rest = np.arange(used, size)

    def padded(of_joints: np.ndarray, of_rows: list, of_rest: np.ndarray | int) -> np.ndarray:
        shape = of_joints.shape[1:]
        own = np.reshape(np.array(of_rows, of_joints.dtype), (-1, *shape))
        return np.concatenate([of_joints, own, np.broadcast_to(of_rest, (size - used, *shape))])

    caps = [cap for *_, cap in found]
    half_angle = padded(joint_half_angle, [cap.half_angle for cap in caps], 0)
    there = half_angle > EMPTY
    axis = padded(joint_axis, [cap.axis for cap in caps], 0)
    toward = padded(np.repeat(directions, 5, axis=0), [cap.direction for cap in caps], 0)
    none = np.full(joints, -1)
    return Caps(
        axis=np.where(there[:, None], axis, 0),
        direction=toward @ start_attitude,
        half_angle=np.where(there, half_angle + HAIR, -1),
        member=padded(np.arange(joints), [joints + number for _, number, _ in found], rest),
        group=padded(joint_group, [joints + group for group, _, _ in found], rest),
        row=padded(none, [cap.row for cap in caps], -1),
        sight=padded(none, [cap.sight for cap in caps], -1),
    )


def _of_rows(
    spacecraft: Spacecraft,
    directions: np.ndarray,
    joint_limits: np.ndarray,
    cones: Constraints,
    widening: float,
) -> Iterator[_Group]:
    """The groups of caps that all rows give, in the order of their constraints."""
    sights = cones.sights(spacecraft.mounts, spacecraft.fixed_boresights)
    pairs = pairs_at_goal(cones, sights, directions)
    fails = np.any(pairs.settled & (pairs.margin < 0), axis=-1)
    if widening:
        away = np.where(cones.frame == JOINTS, 1, cones.side)
        cones = replace(cones, half_angle=cones.half_angle - away * widening)
        pairs = pairs_at_goal(cones, sights, directions)
    for constraint in np.unique(cones.group[np.any(pairs.capped, axis=-1)]):
        own = cones.group == constraint
        entries = np.unique(cones.entry[own])
        if len(entries) > 1:
            entries = np.setdiff1d(entries, cones.entry[own & fails])
        asked = []
        for entry in entries:
            rows = np.flatnonzero(own & (cones.entry == entry)).tolist()
            asked.append([ways for row in rows for ways in _of_row(row, pairs, cones, sights, joint_limits)])
        yield from _groups(asked)


def _of_row(
    row: int, pairs: Pairs, cones: Constraints, sights: Sights, joint_limits: np.ndarray
) -> Iterator[list[_Member]]:
    """For each pair of a row that asks for something the ways to meet it: one, or two of which one is enough.

    A bound of a yaw is met on an arc from there to the joint's limit; see `_of_joints` for its caps.
    """
    of_yaw = single_yaws(cones)[row]
    for sight in np.flatnonzero(pairs.capped[row]).tolist():
        place = row, sight
        cap = _Cap(*place, pairs.axis[place], pairs.direction[place], pairs.half_angle[place])
        if not of_yaw:
            yield [[cap]]
            continue
        sign, bound, limit = (
            np.sign(cones.axis[row, 0]),
            cones.half_angle[row],
            min(joint_limits[sight], np.pi),
        )
        far, middle = sights.mounts[sight] + sign * np.array([limit + np.pi / 2, (limit + bound) / 2])
        beyond = cap._replace(axis=np.array([np.cos(far), np.sin(far), 0]))
        behind = cap._replace(axis=-np.array([np.cos(middle), np.sin(middle), 0]))
        if limit - bound < np.pi:
            yield [[cap, beyond, behind]]
        elif bound > -limit:
            yield [[cap], [beyond]]


def _groups(asked: list[list[list[_Member]]]) -> Iterator[_Group]:
    """The groups of a constraint, from the ways to meet each pair of each of its entries."""
    if len(asked) == 1:  # each of its pairs must hold, so those with two ways are groups by themselves
        (entry,) = asked
        plain = [cap for ways in entry if len(ways) == 1 for cap in ways[0]]
        yield from [[plain]] if plain else []
        yield from (ways for ways in entry if len(ways) > 1)
        return
    group: _Group = []
    for entry in asked:
        few = 2 ** sum(len(ways) > 1 for ways in entry) <= ALTERNATIVES
        kept = entry if few else [ways for ways in entry if len(ways) == 1]
        if not kept:
            return  # holds, or may hold
        group += [list(chain.from_iterable(choice)) for choice in product(*kept)]
    if group:
        yield group


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
    half_angle[yaw >= np.pi, :2] = (
        0  # one of two opposite halves is always met, and neither asks for anything
    )
    group = np.arange(5 * count).reshape(count, 5)
    group[:, 1] = np.where(yaw > np.pi / 2, group[:, 0], group[:, 1])
    return axis.reshape(-1, 3), half_angle.reshape(-1), group.reshape(-1)


def deepest_row(caps: Caps, cones: Constraints, margins: np.ndarray) -> tuple[float, int | None, int | None]:
    """The row of the caps that a state breaks most, or is nearest to breaking.

    Args:
        caps: the caps.
        cones: the constraints that they are of.
        margins: (Z, S) rad, of the state.

    Returns:
        How deep a sight is inside, rad, negative when it is clear; the row and the sight. Of a constraint it
        is the entry broken least. Without such caps ``(-inf, None, None)``.
    """
    capped = np.zeros(cones.bound.shape, dtype=bool)
    used = caps.row >= 0
    capped[caps.row[used], caps.sight[used]] = True
    some = np.any(capped, axis=-1)
    if not np.any(some):
        return -np.inf, None, None
    asked, possible = np.isin(cones.group, cones.group[some]), np.isin(cones.entry, cones.entry[some])
    worst = np.min(np.where(capped, margins, np.inf), axis=-1)
    worst = np.where(asked & ~possible, -np.inf, worst)  # an entry that what is settled rules out
    of_constraint = best_entries(cones, worst)
    leader = int(np.argmin(of_constraint))
    of_entry = np.where(cones.entry == chosen_entries(cones, worst)[leader], worst, np.inf)
    row = int(np.argmin(of_entry))
    return -float(of_constraint[leader]), row, int(np.argmin(np.where(capped[row], margins[row], np.inf)))
