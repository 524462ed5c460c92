"""The constraints of problem (7) in one form: caps (cones about body axes) that directions must stay out of.

At a goal a device points along its target ``z``, so along ``R^T z`` in the body. Of most directions it is
known, then, in which frame they stand still, and a pair of a row and a sight that do so in different ones is
a cap (`jaxplan.goal.pairs`).

With ``R = R0 E`` an inertial direction ``z`` has the body components ``E^T R0^T z``. Every constraint on the
goal keeps one such vector out of a cap of the unit sphere in body axes, of axis ``a`` and half-angle ``h``:

    azimuth <= Y     half the sphere, beyond the plane at the azimuth Y; likewise for the least (equation 4)
    elevation <= P   around the device's yaw axis, ``h = pi / 2 - P``; around its opposite for the least
    keep-out cone    around what is fixed to the body, for what is inertial: an instrument or an axis of the
                     body for a zone's direction or a target, or a cone's axis in the body for a target;
                     ``h`` is its half-angle
    keep-in cone     around the opposite; ``h`` is pi less its half-angle

So the angle between ``a`` and ``E^T R0^T z`` is at least ``h``, and what is missing is the excess, in rad.
Constraints of which one is enough (a yaw range wider than half a turn, entries of one constraint) are members
of a group: it asks for one of its members, a member for all of its caps. An entry that a settled pair breaks
is left out; where a constraint has an entry that no cap can break, the constraint gives no cap at all.

Shapes: Z rows, S sights, m caps; in kernels lanes are the last axis.
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
    """Excess of each group, that of the worst cap of its best member; of each cap where no group has several.

    Args:
        excess: (m, K) of every cap.
        member: (m,) number of each cap's member, ascending.
        group: (m,) number of each cap's group, ascending.

    Returns:
        (groups, K), or (m, K).
    """
    members, groups = (np.flatnonzero(np.diff(numbers, prepend=-1)) for numbers in (member, group))
    if len(groups) == len(members):
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

    choice = jnp.any((group[1:] == group[:-1]) & (member[1:] != member[:-1]))
    return jax.lax.cond(choice, chosen, lambda excess: jnp.ones(excess.shape, bool), excess)


@dataclass(frozen=True, kw_only=True, eq=False)
class Caps:
    """All caps of a problem, padded with empty ones; sorted by group, then by member.

    Attributes:
        axis: (m, 3) unit vectors in body axes; zero for an empty cap.
        direction: (m, 3) unit vectors that stay out of the caps, in the body axes of the start.
        half_angle: (m,) rad, -1 for an empty cap.
        member: (m,) number of the member that the cap belongs to, ascending.
        group: (m,) number of the group that the member belongs to.
        row: (m,) the row of the constraints that the cap is of; -1 for aims and empty ones.
        sight: (m,) number of the sight; -1 for empty ones.
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
        """Excess (m,) rad, how deep the directions are inside the caps, after a rotation ``E`` (3, 3)."""
        return np.asarray(self.half_angle - separation(self.axis, self.direction @ rotation))

    def clear(self, rotation: np.ndarray) -> bool:
        """True if a rotation ``E`` (3, 3) keeps all directions out of the caps, by half of `HAIR` or more."""
        excess = group_excess(self.excess(rotation)[:, None], self.member, self.group)
        return bool(np.all(excess <= HAIR / 2))


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
    """The caps of a problem, padded.

    Pairs that are settled or open give no cap. A constraint of several entries gives none either when one of
    these holds for that reason or may hold, or when none can.

    Args:
        problem: what is asked.
        widening: rad by which the bound of every row is widened.
    """
    rows, pairs = problem.rows, problem.pairs
    fails = np.any(pairs.settled & (pairs.margin < 0), axis=-1)
    if widening:
        away = np.where(rows.frame == JOINTS, 1, rows.side)
        problem = replace(problem, rows=replace(rows, half_angle=rows.half_angle - away * widening))
    groups = [*_of_aims(problem.aims), *_of_rows(problem, fails)]
    groups += [group for wish in problem.wishes if (group := _of_wish(wish))]
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
        open=leaves_open(problem),
    )


def _of_rows(problem: GoalProblem, fails: np.ndarray) -> Iterator[_Group]:
    """Yield the groups of caps that all rows give, in the order of their constraints.

    Args:
        problem: what is asked.
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
            asked.append([ways for row in of_entry for ways in _of_row(row, problem)])
        yield from _groups(asked)


def _of_row(row: int, problem: GoalProblem) -> Iterator[_Group]:
    """Yield for each pair of a row, by number, that is a cap its members: one, or two of which one is enough.

    A bound of a yaw is met on the arc from the bound to the end of the joint's range.
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
            continue  # the range is narrower
        ways = _of_arc(*arc, cap, aims.frames[number])
        if ways:
            yield ways


def _of_arc(low: float, high: float, cap: _Cap, frame: np.ndarray) -> _Group:
    """The members that keep an azimuth within `low` to `high` rad, of which one is enough.

    There is none where the two span a whole turn.

    Args:
        low: rad, the least azimuth.
        high: rad, the largest.
        cap: whose row, sight and direction the caps get.
        frame: (3, 3) body from the device's axes.

    More than half a turn is the union of two half-spaces, so one of their caps is enough. Less is their
    intersection. Of a narrow one the point right behind is nearly clear of both caps, too; the cap over the
    whole back tells it apart.
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


def _groups(asked: list[list[list[_Member]]]) -> Iterator[_Group]:
    """Yield alternatives that together say the same as one constraint: of each, one member must hold.

    Args:
        asked: the constraint as entries, of which one must hold; each as pairs, which must all hold; and each
            pair as lists of caps, of one of which all must be avoided.
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


def _of_aims(aims: Aims) -> Iterator[_Group]:
    """Yield the groups of caps that the ranges of azimuth and elevation of devices with targets give."""
    for device, frame, direction, ranges in zip(
        aims.devices, aims.frames, aims.directions, aims.ranges, strict=True
    ):
        cap = _Cap(-1, device, np.zeros(3), direction, 0.0)
        (low, high), (least, most) = ranges.tolist()
        ways = _of_arc(low, high, cap, frame)
        yield from [ways] if ways else []
        upward = frame[:, 2]
        yield [[cap._replace(axis=upward, half_angle=np.pi / 2 - most)]]
        yield [[cap._replace(axis=-upward, half_angle=np.pi / 2 + least)]]


def _of_wish(wish: Wished) -> _Group:
    """The group of caps that keeps a wish within its `reach`; empty where every attitude does."""
    reach, frame = wish.reach, wish.frame
    cap = _Cap(-1, wish.device, np.zeros(3), wish.direction, 0.0)

    def near(azimuth: float, elevation: float) -> _Member:
        """The cap outside a cone about a direction in the device's axes."""
        axis = -frame @ pointing(azimuth, elevation)
        return [cap._replace(axis=axis, half_angle=np.pi - reach)]

    (low, high), (least, most) = wish.box.tolist()
    if wish.kind == "instrument" and reach < SHARP:
        share = reach / np.sqrt(2)
        sides = [cap._replace(axis=way * frame[:, 2], half_angle=np.pi / 2 - share) for way in (1, -1)]
        group = [[*way, *sides] for way in _of_arc(-share, share, cap, frame)]
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
        ways = _of_arc(low - beside, high + beside, cap, frame) or [[]]
        group = [[*way, *band] for way in ways]
        if wish.kind == "drive" and not sharp and high - low < 2 * np.pi:
            group += [near(low, least), near(high, least)]
    group = [[cap for cap in member if cap.half_angle > EMPTY] for member in group]
    return group if all(group) else []


def deepest_row(
    caps: Caps, problem: GoalProblem, attitude: np.ndarray, joints: np.ndarray
) -> tuple[float, int | None, int | None]:
    """The row that a state breaks most, or is nearest to breaking, of the rows that give caps.

    Args:
        caps: all caps of the problem.
        problem: what is asked.
        attitude: (3, 3) of the state, body to inertial.
        joints: (J,) rad, of the state.

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
    worst = np.where(asked & ~possible, -np.inf, worst)  # an entry that a settled pair breaks
    of_constraint = best_entries(rows, worst)
    leader = int(np.argmin(of_constraint))
    of_entry = np.where(rows.entry == chosen_entries(rows, worst)[leader], worst, np.inf)
    row = int(np.argmin(of_entry))
    return -float(of_constraint[leader]), row, int(np.argmin(margins[row]))
