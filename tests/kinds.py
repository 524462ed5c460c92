"""Tables of pointing constraints of every kind, and margins of states by turning devices about their axes."""

from dataclasses import dataclass

import numpy as np
from reference import angle, gimbal_angles, seen
from scipy.spatial.transform import Rotation

from jaxplan.model.constraints import INERTIAL, JOINTS, SIGHT, Constraints
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


def table(constraints, devices, **sights):
    """The table of constraints, each a list of entries, each a list of rows; sights are as in `table_of`."""
    rows = []
    for entries in constraints:
        first = len(rows)
        for own in entries:
            rows += [vars(row) | {"entry": len(rows), "group": first} for row in own]
    return table_of(rows, devices, size=padded_count(len(rows)), **sights)


def table_of(rows, devices, *, body=(), carrier=(), carried=(), size=0):
    """The table of rows given as mappings, padded; one without an entry is a constraint by itself."""
    rows = [*rows, *[{}] * (size - len(rows))]
    sights = np.arange(devices + len(body) + len(carrier))

    def column(name, default, kind):
        return np.array([row.get(name, default) for row in rows], kind)

    entry = np.array([row.get("entry", number) for number, row in enumerate(rows)])
    paths = tuple(row.get("path") for row in rows)
    frame = column("frame", INERTIAL, int)
    return Constraints(
        axis=np.array([row.get("axis", (0, 0, np.nan if "path" in row else 1)) for row in rows], float),
        frame=frame,
        partner=column("partner", 0, int),
        half_angle=column("half_angle", 0.5, float),
        side=column("side", 1, float),
        bound=np.array([np.isin(sights, list(row.get("bound", ()))) for row in rows]),
        entry=entry,
        group=np.array([row.get("group", own) for row, own in zip(rows, entry, strict=True)]),
        zone=np.arange(len(rows)),
        body=np.array(body, float).reshape(-1, 3),
        carrier=np.array(carrier, int),
        carried=np.array(carried, float).reshape(-1, 3),
        paths=paths if any(path is not None for path in paths) else (),
        inner=bool(np.any(frame != INERTIAL)),
        nested=bool(np.any(entry != np.arange(len(rows)))),
    )


def seen_by(craft, rows, joints):
    """(k, S, 3) sights in body axes at joints (k, 2n + d)."""
    azimuth, elevation = gimbal_angles(craft.gimbals, joints)
    length = len(joints)
    turns = [
        Rotation.from_matrix(np.array(frame)) * Rotation.from_euler("ZY", np.stack([about, -lift], axis=1))
        for frame, about, lift in zip(craft.gimbals.frames, azimuth.T, elevation.T, strict=True)
    ]
    still = [np.tile(vector, (length, 1)) for vector in (*craft.fixed_boresights, *rows.body)]
    carried = [
        turns[of].apply(np.array(vector)) for of, vector in zip(rows.carrier, rows.carried, strict=True)
    ]
    return np.stack([*(turn.apply([1.0, 0, 0]) for turn in turns), *still, *carried], axis=1)


def row_values(craft, rows, number, sights, attitudes, joints, time=None):
    """(k, B) angles of the sights that a row binds to its axis, of a row of joints ``f . (yaw, pitch)``."""
    axis, bound = rows.axis[number], np.flatnonzero(rows.bound[number])
    if rows.frame[number] == JOINTS:
        azimuth, elevation = gimbal_angles(craft.gimbals, joints)
        return axis[0] * azimuth[:, bound] + axis[1] * elevation[:, bound]
    along = np.broadcast_to(axis, (len(joints), 3))
    if rows.frame[number] == SIGHT:
        along = sights[:, rows.partner[number]]
    elif rows.frame[number] == INERTIAL:
        path = rows.paths[number] if rows.paths else None
        along = np.einsum("kji,kj->ki", attitudes, along if path is None else seen(path, time))
    return angle(along[:, None], sights[:, bound])


def pair_margins_of(craft, rows, attitudes, joints, time=None):
    """(k, Z, S) rad, +inf where a row does not bind a sight."""
    found, sights = np.full((len(joints), *rows.bound.shape), np.inf), seen_by(craft, rows, joints)
    for number in np.flatnonzero(np.any(rows.bound, axis=1)):
        side = 1.0 if rows.frame[number] == JOINTS else rows.side[number]
        value = row_values(craft, rows, number, sights, attitudes, joints, time)
        found[:, number, rows.bound[number]] = side * (value - rows.half_angle[number])
    return found


def least_margins(craft, rows, attitudes, joints):
    """(k,) rad: of the worst constraint, that of its best entry, of that the worst row."""
    of_rows = pair_margins_of(craft, rows, attitudes, joints).min(axis=2)
    worst = np.full(len(joints), np.inf)
    for group in set(rows.group):
        entries = [
            of_rows[:, rows.entry == entry].min(axis=1) for entry in set(rows.entry[rows.group == group])
        ]
        worst = np.minimum(worst, np.max(entries, axis=0))
    return worst
