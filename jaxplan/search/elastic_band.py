"""An elastic band: a path that descends to less energy, pulled tight but held off by zones and joint limits.

The path has `PIECES` pieces of equal time. With ``a`` the steps that the platform and each joint make on a
piece, in a unit in which the largest is about one, its energy is

    mean over pieces of (sum a^4)^(1/2) + TRAVEL sum a^2
    + PENALTY * sum over nodes of (what clearance and joint limits lack, rad)^2

The first term is a smooth stand-in for the square of the largest ``a``, which is the time the piece takes; as
with every energy, equal pieces are the best. The second keeps joints from travelling for nothing while
another is the slowest. Both are convex in the pieces.

The band descends by damped Newton steps. The energy is taken to second order; clearances are linearised
(Gauss-Newton). A step is sought among smooth displacements, K shapes (`_spline_basis`) for each of the C
components of a motion, so that a band bends as a whole and the system to solve has K C unknowns. Of several
fractions of a step the best is taken. The result carries no promise: whether it is clear and shorter is for
others to check. The elements of the system are sums over nodes, or pieces, of the product of two shapes and a
second derivative. They are formed for the pairs p of shapes that overlap, and then put in their places.

A *slack* of a row (a condition on one or two directions, or on joints) is what its score has left to the
threshold at which the wanted clearance is just kept, negative where it is broken; here scaled to about rad.

Axes of arrays: components first (4 of a quaternion, 3 of a vector, the J joints, or the C = 3 + J components
of a motion, rotation first), then rows z and sights d, then the f bands tried at once, last the s nodes along
the band. Attitudes are unit quaternions relative to the start, scalar first, neighbours of the same sign.
"""

from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement, product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry import rotations
from jaxplan.geometry.vectors import cross, dot, unit
from jaxplan.model.constraints import INERTIAL, JOINTS, SIGHT, Constraints, axes_in_body, joint_values
from jaxplan.model.directions import Sights
from jaxplan.model.scores import scores, thresholds
from jaxplan.runtime.jit import materialise
from jaxplan.search.scene import JOINT_RESERVE, Scene, tapered

PIECES = 24
TRAVEL = 0.2
PENALTY = 700.0
# rad, added to the clearance wanted at the nodes of a band, to cover what lies between them.
BUFFER = 0.012
FAR = 0.15
"""Slack, rad, given to what no row binds; at more than this a row adds no curvature to the system."""
FRACTIONS = (1.0, 0.4, 0.12, 0.03)
# Curvature added to that of the energy, to keep steps short: for all motion, and near zones (within FAR).
DAMPING, NEAR_DAMPING = 0.2, 0.005
_SHAPE_COUNT = 8
_NORM_OFFSET = 1e-12


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """The numbers of a scene that the energy is made of.

    Attributes:
        sights: the directions that the rows bind.
        rows: all constraints; where two sights must keep apart, each of the two is the axis of a row.
        grouped: whether any constraint has several entries.
        steps: (C,) rad, length of a step of each component of motion: rotation (three times) and each joint.
        ranges: (2, J) rad, least and largest angle of each joint.
        axes: (3, z) unit axes of all z rows, each as if it were inertial, in the body axes at the start.
        scale: (z,) rad for a unit of the score, near the row's edge.
        wanted: (z, s) score at which a row just keeps the clearance wanted at each of s nodes.
        unit: () factor from steps on a piece to the unit of the energy.
    """

    sights: Sights
    rows: Constraints
    steps: Array
    ranges: Array
    axes: Array
    scale: Array
    wanted: Array
    unit: Array
    grouped: bool = field(metadata={"static": True})


def spread(values: Array, axes: int) -> Array:
    """Append so many axes of length one to the shape of an array."""
    return values.reshape(*values.shape, *(1,) * axes)


def total(values: Array) -> Array:
    """Sum over a short leading axis, unrolled so that XLA fuses it."""
    return sum((values[i] for i in range(values.shape[0])), start=jnp.zeros(values.shape[1:]))


def make_problem(scene: Scene, length: Array, clearance: Array) -> Problem:
    """Make the problem of a band of `length` steps, with `clearance` rad wanted away from both ends."""
    rows = _all_rows(scene)
    at = jnp.arange(PIECES + 1) / PIECES
    # at most ten: near the axis of a narrow cone the cosine tells little
    scale = 1 / jnp.maximum(jnp.sin(jnp.asarray(rows.half_angle)), 0.1)
    ends = jnp.stack([jnp.asarray(scene.start_joints), jnp.asarray(scene.goal_joints)])
    low, high = jnp.asarray(scene.joint_ranges).T
    reserve = jnp.minimum(JOINT_RESERVE * jnp.asarray(scene.joint_steps), (high - low) / 2)
    low, high = jnp.minimum(low + reserve, jnp.min(ends, 0)), jnp.maximum(high - reserve, jnp.max(ends, 0))
    return Problem(
        sights=scene.sights,
        rows=rows,
        grouped=scene.grouped_cones.half_angle.shape[0] > 0,
        steps=jnp.concatenate([jnp.full(3, scene.attitude_step), jnp.asarray(scene.joint_steps)]),
        ranges=jnp.stack([low, high]),
        axes=jnp.asarray(scene.start_attitude).T @ jnp.asarray(rows.axis).T,
        scale=jnp.where(rows.frame == JOINTS, 1, scale) if rows.inner else scale,
        wanted=thresholds(rows, tapered(clearance + BUFFER, jnp.minimum(at, 1 - at) * length)).T,
        unit=PIECES / length,
    )


def _all_rows(scene: Scene) -> Constraints:
    """Return the rows of both tables, and those between two sights once more with these exchanged."""
    tables = list(scene.tables)
    if scene.grouped_cones.inner:
        tables.append(_exchange_sights(scene.grouped_cones))
    before = np.cumsum([0, tables[0].half_angle.shape[0], 0])  # what is exchanged joins its constraint

    def joined(name: str) -> Array:
        return jnp.concatenate([jnp.asarray(getattr(table, name)) for table in tables])

    def numbered(name: str) -> Array:
        parts = zip(tables, before, strict=False)
        return jnp.concatenate([jnp.asarray(getattr(table, name)) + first for table, first in parts])

    names = ("axis", "frame", "partner", "half_angle", "side", "bound")
    arrays: dict[str, Any] = {name: joined(name) for name in names}
    arrays |= {name: numbered(name) for name in ("entry", "group")}
    return replace(
        scene.cones,
        **arrays,
        paths=(),
        inner=any(table.inner for table in tables),
        nested=any(table.nested for table in tables),
    )


def _exchange_sights(rows: Constraints) -> Constraints:
    """Return rows between two sights with axis and sight exchanged; the other rows bind nothing."""
    bound = jnp.asarray(rows.bound)
    between = (jnp.asarray(rows.frame) == SIGHT) & jnp.any(bound, axis=1)
    axis = jnp.arange(bound.shape[1]) == jnp.asarray(rows.partner)[:, None]
    exchanged: dict[str, Any] = {"partner": jnp.argmax(bound, axis=1), "bound": axis & between[:, None]}
    return replace(rows, **exchanged)


def pieces(problem: Problem, quaternions: Array, joints: Array) -> Array:
    """Return the motion on each piece of f bands with s nodes, (C, f, s - 1), in the unit of the energy.

    The C components are those of rotation and the J joints. `quaternions` are (4, f, s), `joints` (J, f, s)
    rad.
    """
    vector = jnp.stack(rotations.relative(quaternions[..., :-1], quaternions[..., 1:])[1:])
    square = dot(vector, vector)
    # the arc sine's series, good to 1e-6 up to 0.7 rad
    turn = 2 * vector * (1 + square * (1 / 6 + square * (3 / 40 + square * 15 / 336)))
    motion = jnp.concatenate([turn, jnp.diff(joints, axis=-1)])
    return motion / spread(problem.steps, 2) * problem.unit


def squares_of(motion: Array) -> Array:
    """Return squares of the sizes of rotations and joint motions, (1 + J, f, s), of motions (C, f, s)."""
    return jnp.concatenate([dot(motion[:3], motion[:3])[None], motion[3:] * motion[3:]])


def nodes_seen(problem: Problem, quaternions: Array, joints: Array) -> tuple[Array, Array]:
    """Return axes of z rows (3, z, f, s) and d sights (3, d, f, s) in body axes at s nodes of f bands."""
    behind = quaternions.ndim - 1
    turned = rotations.turned_back(quaternions[:, None], spread(problem.axes, behind))
    sights = problem.sights.in_body(jnp.moveaxis(joints, 0, -1))  # (f, s, d, 3)
    axes = axes_in_body(problem.rows, jnp.moveaxis(jnp.stack(turned), (0, 1), (-1, -2)), sights)
    both = tuple(jnp.moveaxis(part, (-1, -2), (0, 1)) for part in (axes, sights))
    found: tuple[Array, Array] = materialise(problem.steps[0], both)
    return found


def zone_slacks(problem: Problem, axes: Array, body: Array, joints: Array) -> Array:
    """Return the slack of d sights to z rows at the s nodes of f bands, (z, d, f, s) in about rad.

    It is `FAR` where the row does not bind the sight, or another entry of the constraint holds better.

    Args:
        problem: the scene.
        axes: (3, z, f, s) of the rows, body axes, from `nodes_seen`.
        body: (3, d, f, s) of the sights, likewise.
        joints: (J, f, s) rad.
    """
    rows = problem.rows
    values = None
    if rows.inner:
        values = joint_values(rows, problem.sights.gimbals, jnp.moveaxis(joints, 0, -1))  # (f, s, d, z)
        values = jnp.moveaxis(values, (-1, -2), (0, 1))
    score = scores(rows.spread(3), dot(axes[:, :, None], body[:, None]), values)
    slacks = (problem.wanted[:, None, None] - score) * spread(problem.scale, 3)
    counts = jnp.broadcast_to(spread(jnp.asarray(rows.bound), 2), slacks.shape)
    if problem.grouped:  # of a constraint only the entry that holds best counts
        held = jnp.min(jnp.where(counts, slacks, jnp.inf), axis=1, initial=jnp.inf)
        if rows.nested:
            held = jnp.min(jnp.where(_same_number(rows.entry), held, jnp.inf), axis=1)
        best = jnp.max(jnp.where(_same_number(rows.group), held, -jnp.inf), axis=1)
        counts &= (held >= best)[:, None]
    return jnp.where(counts, slacks, FAR)


def _same_number(number: ArrayLike) -> Array:
    """Tell for every two of z rows whether they have the same number (z,), as of their entry or group.

    The result is (z, z, 1, 1) bool.
    """
    own = jnp.asarray(number)
    return spread(own[:, None] == own, 2)


def beyond_limits(problem: Problem, joints: Array) -> Array:
    """Return how far joints are above (positive) or below (negative) their ranges, or 0 inside.

    Joints and result are (J, f, s) rad, at s nodes of f bands.
    """
    low, high = (spread(bound, 2) for bound in problem.ranges)
    return joints - jnp.clip(joints, low, high)


def energy(problem: Problem, quaternions: Array, joints: Array) -> Array:
    """Return the energy (f,) of f bands with s nodes, of quaternions (4, f, s) and joints (J, f, s) rad."""
    squares = squares_of(pieces(problem, quaternions, joints))
    tension = jnp.mean(jnp.sqrt(total(squares * squares)) + TRAVEL * total(squares), axis=-1)
    axes, body = nodes_seen(problem, quaternions, joints)
    short = jnp.minimum(zone_slacks(problem, axes, body, joints), 0)
    beyond = beyond_limits(problem, joints)
    lacking = total(total(short * short)) + total(beyond * beyond)
    return tension + PENALTY * jnp.sum(lacking, axis=-1)


def _spline_basis() -> np.ndarray:
    """Return K shapes of displacement at the nodes, (PIECES + 1, K).

    They are cubic B-splines on even knots, zero at both ends.
    """
    at = np.linspace(0, _SHAPE_COUNT - 1, PIECES + 1)[:, None]
    knots = np.concatenate([np.zeros(3), np.arange(_SHAPE_COUNT), np.full(3, _SHAPE_COUNT - 1.0)])
    values = ((at >= knots[:-1]) & (at < knots[1:])).astype(float)
    for degree in range(1, 4):  # Cox and de Boor
        starts, ends = knots[: -1 - degree], knots[degree + 1 :]
        rise, fall = knots[degree:-1] - starts, ends - knots[1:-degree]
        up = (at - starts) / np.where(rise > 0, rise, np.inf)
        down = (ends - at) / np.where(fall > 0, fall, np.inf)
        values = up * values[:, :-1] + down * values[:, 1:]
    inner = values[:, 1:-1]  # the first and the last spline are those that do not vanish at the ends
    inner[[0, -1]] = 0
    return inner


_NODE_SHAPES = _spline_basis()
_PIECE_SHAPES = np.diff(_NODE_SHAPES, axis=0)
_SHAPE_PAIRS = [
    (i, j)
    for i, j in combinations_with_replacement(range(_SHAPE_COUNT), 2)
    if np.any(_NODE_SHAPES[:, i] * _NODE_SHAPES[:, j])
]
_NODE_PRODUCTS, _PIECE_PRODUCTS = (
    np.stack([shapes[:, i] * shapes[:, j] for i, j in _SHAPE_PAIRS], axis=-1)
    for shapes in (_NODE_SHAPES, _PIECE_SHAPES)
)


def _penalty_derivatives(
    problem: Problem, quaternions: Array, joints: Array
) -> tuple[Array, Array, Array, Array]:
    """Return first and second derivatives of the energy's penalty at the s nodes of a band (4, s) and (J, s).

    Returns:
        Of the rows' part the first (5, d, s) and second (5, 5, d, s) derivatives, by rotation (3), yaw and
        pitch of each device d; of the joint limits' part the first (J, s) and second (J, s) derivatives.
    """
    constraints = problem.rows
    axes, body = nodes_seen(problem, quaternions[:, None], joints[:, None])
    slacks = zone_slacks(problem, axes, body, joints[:, None])[:, :, 0]
    zone, seen = axes[:, :, None, 0], body[:, None, :, 0]
    by_yaw, by_pitch = _sight_derivatives(problem.sights, body[:, :, 0], joints)
    turned = jnp.stack(cross(seen, zone))
    moved = jnp.stack([dot(by_yaw[:, None], zone), dot(by_pitch[:, None], zone)])
    factor = -jnp.asarray(constraints.side)
    if constraints.inner:  # of these the platform's turn changes nothing
        frame, normal = spread(jnp.asarray(constraints.frame), 2), jnp.asarray(constraints.axis)
        turned = jnp.where(frame == INERTIAL, turned, 0)
        moved = jnp.where(frame == JOINTS, spread(normal.T[:2], 2), moved)
        factor = jnp.where(constraints.frame == JOINTS, 1.0, factor)
    rows = jnp.concatenate([turned, moved])
    rows *= spread(factor * problem.scale, 2)
    near = NEAR_DAMPING * jnp.clip(1 - slacks / FAR, 0, 1)
    weight = 2 * PENALTY * jnp.where(slacks < 0, 1, near)
    rows, weight, force = materialise(problem.steps[0], (rows, weight, 2 * PENALTY * jnp.minimum(slacks, 0)))
    first = jnp.sum(force * rows, axis=1)
    second = jnp.sum(weight * rows[:, None] * rows[None], axis=2)
    first, second = (_sum_by_device(problem.sights, part) for part in (first, second))
    beyond = beyond_limits(problem, joints[:, None])[:, 0]
    return first, second, 2 * PENALTY * beyond, 2 * PENALTY * (beyond != 0)


def _sight_derivatives(sights: Sights, body: Array, joints: Array) -> list[Array]:
    """Return derivatives of d sights by the yaw and by the pitch of their devices, (3, d, s) each.

    Args:
        sights: the directions that the rows bind.
        body: (3, d, s) the sights at the s nodes, body axes.
        joints: (J, s) rad.
    """
    gimbals = sights.gimbals
    if not gimbals.count:
        return [jnp.zeros_like(body)] * 2
    ahead, left, up = jnp.transpose(jnp.asarray(gimbals.frames), (2, 1, 0))[..., None]  # (3, g, 1)
    azimuth = joints[gimbals.yaws]
    across = jnp.sin(azimuth) * ahead - jnp.cos(azimuth) * left
    of_sights = [axis[:, jnp.maximum(sights.carriers, 0)] for axis in (up, across)]
    both = [jnp.stack(cross(axis, body)) for axis in of_sights]
    return [own * part[:, None] for own, part in zip(both, sights.turning, strict=True)]


def _sum_by_device(sights: Sights, terms: Array) -> Array:
    """Sum terms (..., d, s) by sight to terms by device, whose carried vectors count with it."""
    if not sights.carried.shape[0]:
        return terms
    count = sights.gimbals.count + sights.fixed.shape[0]
    own, carried = terms[..., :count, :], terms[..., count:, :]
    return own.at[..., sights.carrier, :].add(carried)


def _tension_derivatives(problem: Problem, quaternions: Array, joints: Array) -> tuple[Array, Array]:
    """Return derivatives of the energy's mean over pieces by the motions on the pieces, in rad.

    `DAMPING` is included in the second derivatives.

    Args:
        problem: the scene.
        quaternions: (4, s) of one band with s nodes.
        joints: (J, s) rad.

    Returns:
        First (C, s - 1) and second (C, C, s - 1) derivatives by the C components of motion.
    """
    u = pieces(problem, quaternions[:, None], joints[:, None])[:, 0]
    squares = squares_of(u)
    norm = jnp.sqrt(total(squares * squares) + _NORM_OFFSET)
    squares = jnp.concatenate([squares[:1], squares[:1], squares])
    same = jnp.eye(len(u))[:, :, None]
    group = same.at[:3, :3].set(1)  # the components of the rotation make one size
    cube = squares * u
    second = 4 * (group * u[:, None] * u / norm - cube[:, None] * cube / norm**3)
    second += same * (2 * squares / norm + 2 * TRAVEL + DAMPING)
    scale = problem.unit / problem.steps[:, None]
    return 2 * (squares / norm + TRAVEL) * u * scale / PIECES, second * scale[:, None] * scale / PIECES


def _system_indices(terminals: int, drives: int, devices: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the index of each element of the Newton system among the packed terms (`_newton_step`).

    Returns:
        Indices (K C, K C) of the terms of the pieces and joint limits, then of those of the zones. The packed
        array holds, one after the other, the terms (C, C, p), (5, 5, devices, p), (3, 3, p) summed over
        devices, and p zeros.
    """
    size = 3 + 2 * terminals + drives
    row = [0, 1, 2] + [3] * terminals + [4] * terminals + [3] * drives
    device = [-1] * 3 + 2 * list(range(terminals)) + list(range(terminals, terminals + drives))
    of_devices = size * size
    of_rotation = of_devices + 25 * devices
    zero = of_rotation + 9
    every, zone = np.full((2, size, size), zero)
    for c, e in product(range(size), repeat=2):
        every[c, e] = c * size + e
        if c < 3 and e < 3:
            zone[c, e] = of_rotation + c * 3 + e
        elif min(device[c], device[e]) < 0 or device[c] == device[e]:
            zone[c, e] = of_devices + (row[c] * 5 + row[e]) * devices + max(device[c], device[e])
    pair = np.full((_SHAPE_COUNT, _SHAPE_COUNT), -1)
    for place, (i, j) in enumerate(_SHAPE_PAIRS):
        pair[i, j] = pair[j, i] = place
    outer = pair[:, None, :, None]

    def placed(inner: np.ndarray) -> np.ndarray:
        places = np.where(outer < 0, zero * len(_SHAPE_PAIRS), inner[:, None] * len(_SHAPE_PAIRS) + outer)
        return places.reshape(_SHAPE_COUNT * size, -1)

    return placed(every), placed(zone)


def _newton_step(problem: Problem, quaternions: Array, joints: Array) -> Array:
    """Return the damped Newton step of a band (4, s) and (J, s): displacements of its s nodes, (C, s) rad."""
    gimbals = problem.sights.gimbals
    terminals, drives = gimbals.terminals, gimbals.tilts.shape[0]
    devices = gimbals.count + problem.sights.fixed.shape[0]
    push, bend, limit_push, limit_bend = _penalty_derivatives(problem, quaternions, joints)
    pull, stiff = _tension_derivatives(problem, quaternions, joints)
    of_joints = [push[3, :terminals], push[4, :terminals], push[3, terminals : gimbals.count]]
    joint_push = jnp.concatenate(of_joints) + limit_push
    force = jnp.concatenate([jnp.sum(push[:3], axis=1), joint_push])
    gradient = (force @ _NODE_SHAPES + pull @ _PIECE_SHAPES).T  # (K, C)

    every, zone = stiff @ _PIECE_PRODUCTS, bend @ _NODE_PRODUCTS  # (C, C, p), (5, 5, d, p)
    own = jnp.pad(limit_bend @ _NODE_PRODUCTS, [(3, 0), (0, 0)])
    every += own[:, None] * np.eye(len(own))[..., None]
    parts = [every, zone, jnp.sum(zone[:3, :3], axis=2), jnp.zeros(len(_SHAPE_PAIRS))]
    packed = jnp.concatenate([part.ravel() for part in parts])
    places = _system_indices(terminals, drives, devices)
    factor = jax.lax.linalg.cholesky(packed[places[0]] + packed[places[1]], symmetrize_input=False)
    half = jax.lax.linalg.triangular_solve(factor, gradient.reshape(-1, 1), left_side=True, lower=True)
    whole = jax.lax.linalg.triangular_solve(factor, half, left_side=True, lower=True, transpose_a=True)
    return -(whole.reshape(gradient.shape).T @ _NODE_SHAPES.T)


def _displace(quaternions: Array, joints: Array, displacement: Array) -> tuple[Array, Array]:
    """Return a band moved by displacements (C, ..., s) rad, of which the first three are body rotations."""
    turn = jnp.concatenate([jnp.ones_like(displacement[:1]), displacement[:3] / 2])
    return jnp.stack(unit(rotations.product(quaternions, turn))), joints + displacement[3:]


def descend(problem: Problem, quaternions: Array, joints: Array, iterations: int) -> tuple[Array, Array]:
    """Return the band after damped Newton steps of its energy.

    Args:
        problem: the scene.
        quaternions: (4, PIECES + 1).
        joints: (J, PIECES + 1) rad.
        iterations: number of steps, static.

    Returns:
        Quaternions and joints of the band at the end; its first and last node do not move.
    """

    def contract(_: int, nodes: tuple[Array, Array]) -> tuple[Array, Array]:
        step = _newton_step(problem, *nodes)
        fractions = jnp.asarray(FRACTIONS)
        tried = _displace(nodes[0][:, None], nodes[1][:, None], fractions[:, None] * step[:, None])
        best = jnp.argmin(energy(problem, *materialise(problem.steps[0], tried)))
        return _displace(*nodes, fractions[best] * step)

    return jax.lax.fori_loop(0, iterations, contract, (quaternions, joints))
