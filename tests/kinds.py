"""Tables of pointing constraints of every kind, and margins of states by turning devices about their axes."""

from dataclasses import dataclass

import numpy as np
from reference import angle
from scipy.spatial.transform import Rotation

from jaxplan.model.constraints import BODY, INERTIAL, JOINTS, SIGHT, Constraints
from jaxplan.runtime.batching import padded_count


@dataclass(frozen=True, kw_only=True)
class Row:
    """One row of a table, its numbers as `Constraints` has them."""

    frame: int = INERTIAL
    axis: tuple = (0.0, 0.0, 1.0)
    half_angle: float = 0.5
    side: float = 1.0
    bound: tuple = ()
    partner: int = 0


def table(constraints, devices, *, body=(), carrier=(), carried=()):
    """The table of constraints, each a list of entries, each a list of rows."""
    rows, entry, group = [], [], []
    for entries in constraints:
        first = len(rows)
        for own in entries:
            entry += [len(rows)] * len(own)
            rows += own
        group += [first] * (len(rows) - first)
    size = padded_count(len(rows))
    sights = devices + len(body) + len(carrier)
    padding = list(range(len(rows), size))
    nested = len(entry) > len(set(entry))
    rows = rows + [Row()] * len(padding)
    return Constraints(
        axis=np.array([row.axis for row in rows], float),
        frame=np.array([row.frame for row in rows]),
        partner=np.array([row.partner for row in rows]),
        half_angle=np.array([row.half_angle for row in rows]),
        side=np.array([row.side for row in rows]),
        bound=np.array([[sight in row.bound for sight in range(sights)] for row in rows]),
        entry=np.array(entry + padding),
        group=np.array(group + padding),
        zone=np.arange(size),
        body=np.array(body, float).reshape(-1, 3),
        carrier=np.array(carrier, int),
        carried=np.array(carried, float).reshape(-1, 3),
        inner=any(row.frame != INERTIAL for row in rows),
        nested=nested,
    )


def seen_by(craft, rows, joints):
    """(k, S, 3) sights in body axes at joints (k, 2n)."""
    count, length = len(craft.mounts), len(joints)
    turns = [
        Rotation.from_euler("ZY", np.stack([joints[:, i] + craft.mounts[i], -joints[:, count + i]], axis=1))
        for i in range(count)
    ]
    still = [np.tile(vector, (length, 1)) for vector in (*craft.fixed_boresights, *rows.body)]
    carried = [turns[of].apply(vector) for of, vector in zip(rows.carrier, rows.carried, strict=True)]
    return np.stack([*(turn.apply([1.0, 0, 0]) for turn in turns), *still, *carried], axis=1)


def row_values(craft, rows, number, sight, attitudes, joints):
    """(k,) angle of a sight to a row's axis, of a row of joints ``f . (yaw, pitch)``."""
    axis, count = rows.axis[number], len(craft.mounts)
    if rows.frame[number] == JOINTS:
        return axis[0] * joints[:, sight] + axis[1] * joints[:, count + sight]
    seen = seen_by(craft, rows, joints)
    along = {
        INERTIAL: np.einsum("kji,j->ki", attitudes, axis),
        BODY: np.tile(axis, (len(joints), 1)),
        SIGHT: seen[:, rows.partner[number]],
    }[int(rows.frame[number])]
    own = seen[:, sight]
    return angle(along, own)


def pair_margins_of(craft, rows, attitudes, joints):
    """(k, S, Z) rad, +inf where a row does not bind a sight."""
    found = np.full((len(joints), *rows.bound.T.shape), np.inf)
    for number, sight in np.argwhere(rows.bound):
        value = row_values(craft, rows, number, sight, attitudes, joints)
        side = 1.0 if rows.frame[number] == JOINTS else rows.side[number]
        found[:, sight, number] = side * (value - rows.half_angle[number])
    return found


def least_margins(craft, rows, attitudes, joints):
    """(k,) rad: of the worst constraint, that of its best entry, of that the worst row."""
    of_rows = pair_margins_of(craft, rows, attitudes, joints).min(axis=1)
    worst = np.full(len(joints), np.inf)
    for group in set(rows.group):
        entries = [
            of_rows[:, rows.entry == entry].min(axis=1) for entry in set(rows.entry[rows.group == group])
        ]
        worst = np.minimum(worst, np.max(entries, axis=0))
    return worst
