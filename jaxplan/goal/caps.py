"""The constraints of problem (7) in one form: cones about body axes, caps, that directions must stay out of.

At a goal a terminal points along its target ``z``, so along ``R^T z`` in the body. Of most directions it is
known, then, where they are in one of two frames: targets and inertial axes in the inertial one, boresights of
instruments and axes of the body in the body's. A pair of a row and a sight in the same frame is *settled*
whatever the attitude; one of either is a cap. So is a row of joints that bounds a yaw or a pitch alone. All
other pairs depend on what the joints are: step 1 leaves them *open*.

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
of a group: it asks for one of its members, a member for all of its caps. An entry is held against what is
settled, and where a constraint has an entry that nothing of a cap stands against, it gives none at all.

`pairs_at_goal` computes with numpy or JAX, as its arguments do. Shapes: Z rows, S sights, m caps; in kernels
lanes are the last axis.
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
    room,
    state_margins,
)
from jaxplan.model.directions import Sights
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.batching import padded_count

HAIR = 1e-12
"""rad; caps are wider than the constraints by this, so that rounding breaks none."""
EMPTY = 1e-9
"""rad; caps of a smaller half-angle are left out."""
ALTERNATIVES = 16
"""Members that an entry is made of at most; beyond, its wide bounds of yaws are left open."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalProblem:
    """What is asked of the attitude at a goal.

    Attributes:
        spacecraft: its terminals and instruments.
        start: (3, 3) attitude at the start, body to inertial, ``R0``.
        directions: (n, 3) inertial unit vectors that the terminals point along.
        joint_limits: (2n,) rad, at the goal; from pi for a yaw and from pi / 2 for a pitch there is no limit.
        rows: all constraints, at an instant.
    """

    spacecraft: Spacecraft
    start: np.ndarray
    directions: np.ndarray
    joint_limits: np.ndarray
    rows: Constraints

    @property
    def sights(self) -> Sights:
        """The directions that the rows bind."""
        return self.rows.sights(self.spacecraft.mounts, self.spacecraft.fixed_boresights)

    def joints(self, attitudes: np.ndarray) -> np.ndarray:
        """(..., 2n) rad, at attitudes (..., 3, 3) at which terminals point along their directions."""
        return np.asarray(self.spacecraft.joints_toward(attitudes, self.directions))

    def margins(self, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """(..., Z, S) rad, of every pair in states."""
        return np.asarray(state_margins(self.rows, self.sights, attitudes, joints))


def group_excess(excess: np.ndarray, member: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Excess of each group: the worst cap of its best member.

    Args:
        excess: (m, K) of every cap.
        member: (m,) number of each cap's member, ascending.
        group: (m,) number of each cap's group, ascending.

    Returns:
        (groups, K).
    """
    members, groups = (np.flatnonzero(np.diff(numbers, prepend=-1)) for numbers in (member, group))
    if len(groups) == len(excess):  # as where no constraint leaves a choice
        return excess
    # a loop, since `reduceat` along the first axis takes ten times as long
    of_member = [np.max(part, axis=0) for part in np.split(excess, members[1:])]
    parts = np.split(np.stack(of_member), np.searchsorted(members, groups)[1:])
    return np.stack([np.min(part, axis=0) for part in parts])


def applies(excess: Array, member: Array, group: Array) -> Array:
    """Which caps belong to the best member of their group, the first one where several are as good.

    Args:
        excess: (m, K) of every cap.
        member: (m,) number of each cap's member, ascending.
        group: (m,) number of each cap's group.

    Returns:
        (m, K) bool.
    """
    count = excess.shape[0]
    of_member, of_group = ((number[:, None] == number)[:, :, None] for number in (member, group))

    def chosen(excess: Array) -> Array:
        own = jnp.max(jnp.where(of_member, excess, -jnp.inf), axis=1)
        best = jnp.min(jnp.where(of_group, own, jnp.inf), axis=1)
        first = jnp.min(jnp.where(of_group & (own <= best), member[:, None], count), axis=1)
        return first == member[:, None]

    choice = jnp.any(group[1:] == group[:-1])
    return jax.lax.cond(choice, chosen, lambda excess: jnp.ones(excess.shape, bool), excess)


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


def cleared(rows: Constraints, sights: Sights, directions: ArrayLike, clearance: ArrayLike) -> Constraints:
    """The constraints with a clearance, of what is left to the attitude.

    A row gives it up to half of the room that it leaves (`room`), and no more than the least margin of its
    pairs that are settled, since no attitude helps these.

    Args:
        rows: the constraints, at an instant.
        sights: what they bind.
        directions: (n, 3) inertial unit vectors that the terminals point along.
        clearance: rad.
    """
    pairs = pairs_at_goal(rows, sights, directions)
    xp, margin, half_angle, side, wanted = arrays(pairs.margin, rows.half_angle, rows.side, clearance)
    settled = xp.min(xp.where(pairs.settled, margin, xp.inf), axis=-1, initial=xp.inf)
    kept = xp.minimum(wanted, xp.minimum(room(rows), xp.maximum(settled, 0)))
    away = xp.where(rows.frame == JOINTS, 1, side)
    widened: Constraints = replace(rows, half_angle=half_angle + away * kept)
    return widened


def leaves_open(rows: Constraints, sights: Sights, directions: ArrayLike) -> bool:
    """Whether there are pairs that neither the targets nor the attitude at a goal decide."""
    return bool(np.any(_open(rows, pairs_at_goal(rows, sights, directions))))


def _open(rows: Constraints, pairs: Pairs) -> AnyArray:
    """(Z, S) bool, pairs that depend on the joints at a goal otherwise than as caps."""
    return rows.bound & ~pairs.settled & ~pairs.capped


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
        open: whether step 1 leaves something open.
    """

    axis: np.ndarray
    direction: np.ndarray
    half_angle: np.ndarray
    member: np.ndarray
    group: np.ndarray
    row: np.ndarray
    sight: np.ndarray
    open: bool

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


_NOWHERE = _Cap(-1, -1, np.zeros(3), np.zeros(3), 0.0)
_Member = list[_Cap]
_Group = list[_Member]


def assemble(problem: GoalProblem, widening: float = 0.0) -> Caps:
    """The caps of a problem.

    Pairs that are settled or open give no cap. A constraint of several entries gives none either when one of
    these holds for that reason or may hold, or when none can.

    Args:
        problem: what is asked.
        widening: rad by which every row is made easier.
    """
    rows, sights, directions = problem.rows, problem.sights, problem.directions
    pairs = pairs_at_goal(rows, sights, directions)
    open_ = bool(np.any(_open(rows, pairs)))
    fails = np.any(pairs.settled & (pairs.margin < 0), axis=-1)
    if widening:
        away = np.where(rows.frame == JOINTS, 1, rows.side)
        rows = replace(rows, half_angle=rows.half_angle - away * widening)
        pairs = pairs_at_goal(rows, sights, directions)
    groups = [*_of_joints(problem), *_of_rows(pairs, fails, rows, sights, problem.joint_limits)]
    members = [(number, member) for number, group in enumerate(groups) for member in group]
    found = [(number, group, cap) for number, (group, member) in enumerate(members) for cap in member]
    size = max(8, padded_count(len(found)))
    found += [(number, number, _NOWHERE) for number in range(len(found), size)]
    member, group, caps = zip(*found, strict=True)
    row, sight, axis, direction, half_angle = map(np.array, zip(*caps, strict=True))
    there = half_angle > EMPTY
    return Caps(
        axis=np.where(there[:, None], axis, 0),
        direction=direction @ problem.start,
        half_angle=np.where(there, half_angle + HAIR, -1),
        member=np.array(member),
        group=np.array(group),
        row=row,
        sight=sight,
        open=open_,
    )


def _of_rows(
    pairs: Pairs, fails: np.ndarray, rows: Constraints, sights: Sights, joint_limits: np.ndarray
) -> Iterator[_Group]:
    """The groups of caps that all rows give, in the order of their constraints.

    Args:
        pairs: of the rows.
        fails: (Z,) bool, rows that cannot hold, since a pair is settled that breaks them.
        rows: the constraints.
        sights: that they bind.
        joint_limits: (2n,) rad.
    """
    for constraint in np.unique(rows.group[np.any(pairs.capped, axis=-1)]):
        own = rows.group == constraint
        entries = np.unique(rows.entry[own])
        if len(entries) > 1:
            entries = np.setdiff1d(entries, rows.entry[own & fails])
        asked = []
        for entry in entries:
            of_entry = np.flatnonzero(own & (rows.entry == entry)).tolist()
            asked.append(
                [ways for row in of_entry for ways in _of_row(row, pairs, rows, sights, joint_limits)]
            )
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
        sign, bound = np.sign(cones.axis[row, 0]), cones.half_angle[row]
        limit = min(joint_limits[sight], np.pi)
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


def _of_joints(problem: GoalProblem) -> Iterator[_Group]:
    """The groups of each terminal's five caps: two of its yaw, two of its pitch, and its back.

    A yaw range wider than half a turn is the union of two half-spaces, so one of its caps is enough. A
    narrower one is their intersection. Where it is very narrow the point right behind is nearly clear of
    both caps, too; the cap over the whole back tells it apart. Where there is no limit of the yaw, one of two
    opposite halves is always met, and neither asks for anything.
    """
    yaws, pitches = np.split(problem.joint_limits, 2)
    limits = zip(np.minimum(yaws, np.pi).tolist(), pitches.tolist(), strict=True)
    quarter = np.pi / 2
    for mount, direction, (yaw, pitch) in zip(
        problem.spacecraft.mounts.tolist(), problem.directions, limits, strict=True
    ):

        def cap(axis: tuple[float, float, float], half_angle: float, toward: np.ndarray = direction) -> _Cap:
            return _Cap(-1, -1, np.array(axis), toward, half_angle)

        edges = mount + (yaw + quarter), mount - (yaw + quarter)
        sides = [cap((np.cos(edge), np.sin(edge), 0.0), quarter if yaw < np.pi else 0.0) for edge in edges]
        yield from [[[side] for side in sides]] if yaw > quarter else [[[side]] for side in sides]
        yield [[cap((0.0, 0.0, 1.0), quarter - pitch)]]
        yield [[cap((0.0, 0.0, -1.0), quarter - pitch)]]
        yield [[cap((-np.cos(mount), -np.sin(mount), 0.0), quarter if yaw < quarter else 0.0)]]


def deepest_row(
    caps: Caps, problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray
) -> tuple[float, int | None, int | None]:
    """The row of the caps that a state breaks most, or is nearest to breaking.

    Args:
        caps: the caps.
        problem: that they are of.
        attitude: (3, 3) of the state.
        joints: (2n,) rad, likewise.

    Returns:
        How deep a sight is inside, rad, negative when it is clear; the row and the sight. Of a constraint it
        is the entry broken least. Without such caps ``(-inf, None, None)``.
    """
    rows, used = problem.rows, caps.row >= 0
    if not np.any(used):
        return -np.inf, None, None
    capped = np.zeros(rows.bound.shape, dtype=bool)
    capped[caps.row[used], caps.sight[used]] = True
    some = np.any(capped, axis=-1)
    asked, possible = np.isin(rows.group, rows.group[some]), np.isin(rows.entry, rows.entry[some])
    margins = np.where(capped, problem.margins(attitude, joints), np.inf)
    worst = np.min(margins, axis=-1)
    worst = np.where(asked & ~possible, -np.inf, worst)  # an entry that what is settled rules out
    of_constraint = best_entries(rows, worst)
    leader = int(np.argmin(of_constraint))
    of_entry = np.where(rows.entry == chosen_entries(rows, worst)[leader], worst, np.inf)
    row = int(np.argmin(of_entry))
    return -float(of_constraint[leader]), row, int(np.argmin(margins[row]))
