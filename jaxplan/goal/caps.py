"""The constraints of problem (7) in one form: caps (cones about body axes) that directions must stay out of.

At a goal a device points along its target ``z``, which is ``R^T z`` in body axes. So of most directions it is
known in which frame they stand still, and a pair of a row and a sight that stand still in different frames is
a cap (`jaxplan.goal.pairs`).

With ``R = R0 E`` an inertial direction ``z`` has the body components ``E^T R0^T z``. Every constraint on the
goal keeps one such vector out of a cap of the unit sphere in body axes, of axis ``a`` and half-angle ``h``:

    azimuth <= Y     half the sphere, beyond the plane at the azimuth Y; likewise for the least (equation 4)
    elevation <= P   around the device's yaw axis, ``h = pi / 2 - P``; around its opposite for the least
    keep-out cone    around what is fixed to the body, for what is inertial: an instrument or an axis of the
                     body for a zone's direction or a target, or a cone's axis in the body for a target;
                     ``h`` is its half-angle
    keep-in cone     around the opposite; ``h`` is pi less its half-angle

So the angle between ``a`` and ``E^T R0^T z`` must be at least ``h``. The *excess* of a cap is ``h`` less that
angle, in rad: positive where the direction is inside the cap. Some constraints leave a choice (a yaw range
wider than half a turn, the entries of one constraint). The alternatives are the *members* of a *group*: a
group holds if one of its members does, and a member if all of its caps do. An entry that a settled pair
breaks is left out; where a constraint has an entry that no cap can break, the constraint gives no cap at all.

Shapes: Z rows, S sights, m caps; in kernels the last axis runs over K lanes, which are problems side by side.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, product
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry.vectors import pointing, separation
from jaxplan.goal.aims import AZIMUTH, Aims
from jaxplan.goal.pairs import single_yaws
from jaxplan.goal.problem import GoalProblem, Wished, leaves_open
from jaxplan.model.constraints import (
    JOINTS,
    best_entries,
    chosen_entries,
)
from jaxplan.runtime.batching import padded_count

HAIR = 1e-12
"""rad; caps are wider than the constraints by this, so that rounding breaks none."""
EMPTY = 1e-9
"""rad; caps of a smaller half-angle are left out."""
SHARP = 2e-6
"""rad; a narrower cone about a wish is replaced by the square in it, since descents fail at its curvature.
So are the cones about both ends of a drive's range, together with the band between them."""
ALTERNATIVES = 16
"""Most members that an entry is written as; beyond, its wide bounds of yaws are left open."""


def group_excess(excess: np.ndarray, member: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return the excess of each group, which is that of the worst cap of its best member.

    Args:
        excess: (m, K) excess of m caps in K lanes, rad.
        member: (m,) number of each cap's member, ascending.
        group: (m,) number of each cap's group, ascending.

    Returns:
        (groups, K); or `excess` itself, (m, K), where no group has several members.
    """
    members, groups = (np.flatnonzero(np.diff(numbers, prepend=-1)) for numbers in (member, group))
    if len(groups) == len(members):
        return excess
    # a loop, since `reduceat` along the first axis takes ten times as long
    of_member = [np.max(part, axis=0) for part in np.split(excess, members[1:])]
    parts = np.split(np.stack(of_member), np.searchsorted(members, groups)[1:])
    return np.stack([np.min(part, axis=0) for part in parts])


def applies(excess: Array, member: Array, group: Array) -> Array:
    """Tell which caps belong to the best member of their group, the first one where several are equally good.

    Args:
        excess: (m, K) excess of m caps in K lanes, rad.
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

    choice = jnp.any((group[1:] == group[:-1]) & (member[1:] != member[:-1]))
    return jax.lax.cond(choice, chosen, lambda excess: jnp.ones(excess.shape, bool), excess)


@dataclass(frozen=True, kw_only=True, eq=False)
class Caps:
    """All m caps of a problem, padded with empty ones; sorted by group, then by member.

    Attributes:
        axis: (m, 3) unit vectors in body axes; zero for an empty cap.
        direction: (m, 3) unit vectors that must stay out of the caps, in the body axes of the start.
        half_angle: (m,) rad, -1 for an empty cap.
        member: (m,) number of the member that the cap belongs to, ascending.
        group: (m,) number of the group that the member belongs to.
        row: (m,) number of the constraints' row from which the cap comes; -1 for caps of aims and wishes, and
            empty ones.
        sight: (m,) number of the sight that the cap is about; -1 for empty ones.
        open: whether step 1 leaves pairs open, see `problem.leaves_open`.
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
        """Return how deep the directions of all m caps are inside them, (m,) rad.

        Args:
            rotation: (3, 3) rotation ``E`` from the start.
        """
        return np.asarray(self.half_angle - separation(self.axis, self.direction @ rotation))

    def clear(self, rotation: np.ndarray) -> bool:
        """Tell whether all groups hold after a rotation from the start, with half of `HAIR` to spare.

        Args:
            rotation: (3, 3) rotation ``E`` from the start.
        """
        excess = group_excess(self.excess(rotation)[:, None], self.member, self.group)
        return bool(np.all(excess <= HAIR / 2))


class _Cap(NamedTuple):
    """One cap, as in `Caps`, but with its direction in the inertial frame."""

    row: int
    sight: int
    axis: np.ndarray
    direction: np.ndarray
    half_angle: float


_EMPTY_CAP = _Cap(-1, -1, np.zeros(3), np.zeros(3), 0.0)
_Member = list[_Cap]
_Group = list[_Member]


def assemble(problem: GoalProblem, widening: float = 0.0) -> Caps:
    """Return the caps of a problem, padded to a few fixed numbers.

    Pairs that are settled or open give no cap. Nor does a constraint with several entries if one of them has
    no caps: it may hold whatever the attitude, or depends on open pairs. If every entry is broken by a
    settled pair, there is no cap either.

    Args:
        problem: the problem of step 1.
        widening: rad by which the bound of every row is relaxed.
    """
    rows, pairs = problem.rows, problem.pairs
    fails = np.any(pairs.settled & (pairs.margin < 0), axis=-1)
    if widening:
        away = np.where(rows.frame == JOINTS, 1, rows.side)
        problem = replace(problem, rows=replace(rows, half_angle=rows.half_angle - away * widening))
    groups = [*_groups_of_aims(problem.aims), *_groups_of_rows(problem, fails)]
    groups += [group for wish in problem.wishes if (group := _group_of_wish(wish))]
    members = [(number, member) for number, group in enumerate(groups) for member in group]
    found = [(number, group, cap) for number, (group, member) in enumerate(members) for cap in member]
    size = max(8, padded_count(len(found)))
    found += [(number, number, _EMPTY_CAP) for number in range(len(found), size)]
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
        open=leaves_open(problem),
    )


def _groups_of_rows(problem: GoalProblem, fails: np.ndarray) -> Iterator[_Group]:
    """Yield the groups of caps that all Z rows give, in the order of their constraints.

    Args:
        problem: the problem of step 1.
        fails: (Z,) bool, rows that cannot hold, since one of their settled pairs has a negative margin.
    """
    rows, pairs = problem.rows, problem.pairs
    for constraint in np.unique(rows.group[np.any(pairs.capped, axis=-1)]):
        own = rows.group == constraint
        entries = np.unique(rows.entry[own])
        if len(entries) > 1:
            entries = np.setdiff1d(entries, rows.entry[own & fails])
        asked = []
        for entry in entries:
            of_entry = np.flatnonzero(own & (rows.entry == entry)).tolist()
            asked.append([ways for row in of_entry for ways in _members_by_pair(row, problem)])
        yield from _groups_of_constraint(asked)


def _members_by_pair(row: int, problem: GoalProblem) -> Iterator[_Group]:
    """Yield, for each pair of a row that is a cap, its members: one, or two of which one is enough.

    A bound of a yaw is met where the yaw lies on the arc from the bound to the end of the joint's range.
    """
    rows, pairs, aims = problem.rows, problem.pairs, problem.aims
    of_yaw = single_yaws(rows)[row]
    for sight in np.flatnonzero(pairs.capped[row]).tolist():
        place = row, sight
        cap = _Cap(*place, pairs.axis[place], pairs.direction[place], pairs.half_angle[place])
        if not of_yaw:
            yield [[cap]]
            continue
        sign, bound = np.sign(rows.axis[row, 0]), rows.half_angle[row]
        number = aims.devices.index(sight)
        low, high = aims.ranges[number, AZIMUTH]
        arc = (bound, high) if sign > 0 else (low, -bound)
        if arc == (low, high) or arc[0] < low or arc[1] > high:
            continue  # the range of the joint itself is narrower
        ways = _members_of_arc(*arc, cap, aims.frames[number])
        if ways:
            yield ways


def _members_of_arc(low: float, high: float, cap: _Cap, frame: np.ndarray) -> _Group:
    """Return the members, of which one is enough, that keep an azimuth within `low` to `high` rad.

    Args:
        low: rad, the least azimuth.
        high: rad, the largest azimuth.
        cap: a cap whose row, sight and direction the members get.
        frame: (3, 3) rotation from the device's axes to body axes.

    Returns:
        One or two members; none where the arc spans a whole turn. An arc of more than half a turn is the
        union of two half-spaces, so one of their caps is enough. A shorter one is their intersection, one
        member with both caps. For a narrow arc the point right behind it is nearly clear of both caps, so a
        third cap covers the opposite side.
    """

    def at(azimuth: float, half_angle: float = np.pi / 2) -> _Cap:
        axis = frame @ np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        return cap._replace(axis=axis, half_angle=half_angle)

    quarter, width = np.pi / 2, high - low
    if width >= 2 * np.pi:
        return []
    planes = at(high + quarter), at(low - quarter)
    if width > np.pi:
        return [[plane] for plane in planes]
    behind = [at((low + high) / 2 + np.pi)] if width < np.pi else []
    return [[*planes, *behind]]


def _groups_of_constraint(asked: list[list[list[_Member]]]) -> Iterator[_Group]:
    """Yield the groups that together say the same as one constraint.

    Args:
        asked: the entries of the constraint, of which one must hold; each is a list of pairs, which must all
            hold; each pair is a list of members, one of which must have all its caps avoided.
    """
    if len(asked) == 1:  # each of its pairs must hold, so those with two members are groups by themselves
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
            return  # no cap can break this entry
        group += [list(chain.from_iterable(choice)) for choice in product(*kept)]
    if group:
        yield group


def _groups_of_aims(aims: Aims) -> Iterator[_Group]:
    """Yield the groups of caps that come from the ranges of azimuth and elevation of devices with targets."""
    for device, frame, direction, ranges in zip(
        aims.devices, aims.frames, aims.directions, aims.ranges, strict=True
    ):
        cap = _Cap(-1, device, np.zeros(3), direction, 0.0)
        (low, high), (least, most) = ranges.tolist()
        ways = _members_of_arc(low, high, cap, frame)
        yield from [ways] if ways else []
        upward = frame[:, 2]
        yield [[cap._replace(axis=upward, half_angle=np.pi / 2 - most)]]
        yield [[cap._replace(axis=-upward, half_angle=np.pi / 2 + least)]]


def _group_of_wish(wish: Wished) -> _Group:
    """Return the group of caps that keeps a wish within its `reach`; empty where every attitude does."""
    reach, frame = wish.reach, wish.frame
    cap = _Cap(-1, wish.device, np.zeros(3), wish.direction, 0.0)

    def near(azimuth: float, elevation: float) -> _Member:
        """Return the member that keeps to a cone about a direction in the device's axes."""
        axis = -frame @ pointing(azimuth, elevation)
        return [cap._replace(axis=axis, half_angle=np.pi - reach)]

    (low, high), (least, most) = wish.box.tolist()
    if wish.kind == "instrument" and reach < SHARP:
        share = reach / np.sqrt(2)
        sides = [cap._replace(axis=way * frame[:, 2], half_angle=np.pi / 2 - share) for way in (1, -1)]
        group = [[*way, *sides] for way in _members_of_arc(-share, share, cap, frame)]
    elif wish.kind == "instrument":
        group = [near(0.0, 0.0)]
    else:
        sharp = wish.kind == "drive" and reach < SHARP
        beside = reach if wish.kind == "terminal" else 0.0
        if sharp:
            reach /= np.sqrt(2)
            beside = reach / max(np.cos(least), reach)  # of the azimuth, for as much of the boresight
        upward = frame[:, 2]
        band = [
            cap._replace(axis=upward, half_angle=np.pi / 2 - most - reach),
            cap._replace(axis=-upward, half_angle=np.pi / 2 + least - reach),
        ]
        ways = _members_of_arc(low - beside, high + beside, cap, frame) or [[]]
        group = [[*way, *band] for way in ways]
        if wish.kind == "drive" and not sharp and high - low < 2 * np.pi:
            group += [near(low, least), near(high, least)]
    group = [[cap for cap in member if cap.half_angle > EMPTY] for member in group]
    return group if all(group) else []


def deepest_row(
    caps: Caps, problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray
) -> tuple[float, int | None, int | None]:
    """Return the row that a state breaks most, or is nearest to breaking, of the rows that give caps.

    Args:
        caps: all caps of the problem.
        problem: the problem of step 1.
        attitude: (3, 3) of the state, body to inertial.
        joints: (J,) rad, of the state.

    Returns:
        How deep the worst sight is inside a zone, rad, negative where it is clear; the number of the row; and
        that of the sight. Of each constraint the entry that is broken least counts. Without caps of rows the
        result is ``(-inf, None, None)``.
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
    worst = np.where(asked & ~possible, -np.inf, worst)  # an entry that a settled pair breaks
    of_constraint = best_entries(rows, worst)
    leader = int(np.argmin(of_constraint))
    of_entry = np.where(rows.entry == chosen_entries(rows, worst)[leader], worst, np.inf)
    row = int(np.argmin(of_entry))
    return -float(of_constraint[leader]), row, int(np.argmin(margins[row]))
