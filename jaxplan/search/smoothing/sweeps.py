"""Whole paths as arrays: what their edges cost, nodes evenly along them, and the margins of every edge.

Arrays of vectors, quaternions (``w x y z``) and rotations have the component as their first axis, and any
others behind it; their products are those of `jaxplan.geometry`.

For kernels. Components come first (quaternion or joint), nodes or edges last. Attitudes are unit quaternions
relative to the start, neighbours of the same sign (`aligned`).
"""

from functools import reduce

import jax.numpy as jnp
from jax import Array

from jaxplan.geometry import quaternion, rotations, vectors
from jaxplan.geometry.vectors import dot
from jaxplan.model.constraints import (
    INERTIAL,
    SIGHT,
    Constraints,
    best_entries,
    edge_bound,
    joint_values,
    margins_of_scores,
    room,
    score_curvature,
    scores,
)
from jaxplan.model.directions import Sights
from jaxplan.model.path import step_cost
from jaxplan.search.motions import computed_once
from jaxplan.search.problem import TAPER_STEPS, Scene


def total(values: Array) -> Array:
    """Sum over a short leading axis, unrolled so that it fuses."""
    return sum((values[i] for i in range(values.shape[0])), start=jnp.zeros(values.shape[1:]))


def spread(values: Array, axes: int) -> Array:
    """Values with further axes of length one at the end."""
    return values.reshape(*values.shape, *(1,) * axes)


def between(quaternions: Array) -> Array:
    """Quaternions of the turns between neighbours along the last axis, body axes."""
    return jnp.stack(rotations.relative(quaternions[..., :-1], quaternions[..., 1:]))


def in_body(quaternions: Array, directions: Array) -> Array:
    """Directions (3, z) given in the start's body axes, in those at quaternions (4, b, s): (3, z, b, s)."""
    return jnp.stack(rotations.turned_back(quaternions, spread(directions, quaternions.ndim - 1)))


_TINY = 1e-12


def aligned(quaternions: Array) -> Array:
    """The same attitudes (4, k), each of the sign that is nearer to the one before."""
    q = quaternions
    cosines = jnp.sum(q[:, 1:] * q[:, :-1], axis=0)
    signs = jnp.cumprod(jnp.where(cosines < 0, -1.0, 1.0))
    return q * jnp.concatenate([jnp.ones(1), signs])


def nodes(scene: Scene, attitudes: Array, joints: Array) -> tuple[Array, Array]:
    """Nodes (k, 3, 3) and (k, 2n) as this module takes them."""
    # a product and a sum instead of small matrix products
    since = jnp.sum(jnp.asarray(scene.start_attitude)[:, :, None] * attitudes[:, :, None, :], axis=1)
    return aligned(quaternion.from_matrix(since).T), joints.T


def steps(scene: Scene, angles: Array, changes: Array) -> Array:
    """Cost of motions, (m,), of rotations (m,) and joint changes (2n, m)."""
    return step_cost(angles, changes.T, scene.attitude_step, scene.joint_steps)


def edge_costs(scene: Scene, quaternions: Array, joints: Array) -> tuple[Array, Array]:
    """Steps that each edge costs, and those of all its motions added up, both (m,)."""
    change = jnp.diff(joints, axis=-1)
    angles = rotations.angle(between(quaternions))
    every = jnp.sum(jnp.abs(change) / jnp.asarray(scene.joint_steps)[:, None], axis=0)
    return steps(scene, angles, change), angles / scene.attitude_step + every


def evenly(
    quaternions: Array, joints: Array, costs: Array, count: Array | int, nodes: int
) -> tuple[Array, Array]:
    """Nodes at equal costs along a path.

    Args:
        quaternions: (4, k + 1).
        joints: (2n, k + 1) rad.
        costs: (k,) steps of the edges; those of no cost at the end count as the goal.
        count: () number of equal edges wanted.
        nodes: static, number of nodes handed out; those after the goal are the goal again.

    Returns:
        (4, nodes) and (2n, nodes); ends as they were.
    """
    until = jnp.concatenate([jnp.zeros(1), jnp.cumsum(costs)])
    at = jnp.arange(nodes) * (until[-1] / count)
    edge = jnp.sum(at[:, None] >= until[None, 1:-1], axis=-1)
    part = jnp.clip((at - until[edge]) / jnp.maximum(costs[edge], _TINY), 0, 1)
    attitudes = jnp.stack(rotations.slerp(quaternions[:, edge], quaternions[:, edge + 1], part))
    angles = joints[:, edge] + part * (joints[:, edge + 1] - joints[:, edge])
    beyond = jnp.arange(nodes) >= count
    return jnp.where(beyond, quaternions[:, -1:], attitudes), jnp.where(beyond, joints[:, -1:], angles)


def wanted_clearance(
    scene: Scene, quaternions: Array, joints: Array, costs: Array, clearance: Array
) -> Array:
    """Clearance that the search would want on each edge, rad, (m,); none at start and goal.

    As there, what lies behind is counted along the path and what lies ahead along the straight motion,
    less the edge itself.
    """
    behind = jnp.cumsum(costs) - costs
    goal = jnp.asarray(scene.goal_quaternion)[:, None]
    turn = rotations.angle(rotations.relative(quaternions[:, :-1], goal))
    left = jnp.asarray(scene.goal_joints)[:, None] - joints[:, :-1]
    ahead = steps(scene, turn, left) - jnp.maximum(costs, 1)
    return clearance * jnp.clip(jnp.minimum(behind, ahead) / TAPER_STEPS, 0, 1)


def edge_margins(
    scene: Scene, quaternions: Array, joints: Array, wanted: Array, gate: Array
) -> tuple[Array, Array]:
    """`motion_margins` of the edges between nodes (4, m + 1) and (2n, m + 1), at most a few steps long."""
    turns = between(quaternions)
    return motion_margins(
        scene, quaternions[:, :-1], turns, joints[:, :-1], jnp.diff(joints), wanted, gate, halvings=2
    )


def motion_margins(
    scene: Scene,
    quaternions: Array,
    turns: Array,
    joints: Array,
    changes: Array,
    wanted: Array,
    gate: Array,
    *,
    halvings: int,
) -> tuple[Array, Array]:
    """Lower bounds over whole motions, as `jaxplan.model.path.edge_margins` has them for one.

    Args:
        scene: the problem.
        quaternions: (4, m) where the motions start.
        turns: (4, m) quaternions of the whole turns, body axes.
        joints: (2n, m) rad, at the start.
        changes: (2n, m) rad.
        wanted: (m,) rad; a zone gives it up to half of the room that it leaves.
        gate: see `computed_once`.
        halvings: static; each motion is cut into ``2^halvings`` intervals.

    Returns:
        (m,) smallest margin, and smallest margin less what is wanted, rad; +inf without zones.
    """
    parts = 2**halvings
    attitudes, cosines, sines = _positions(scene, quaternions, turns, joints, changes, gate, halvings)
    body = sights_of(scene.sights, cosines, sines)  # (3, d, parts + 1, m)
    rate, bend = scene.sights.bounds(changes.T / parts)
    least = [jnp.full_like(wanted, jnp.inf)] * 2  # margin and slack
    for cones in (scene.cones, scene.grouped_cones):
        if not cones.bound.size:
            continue
        axes = row_axes(
            cones, in_body(attitudes, jnp.asarray(scene.start_attitude).T @ jnp.asarray(cones.axis).T), body
        )
        places = joints[:, None] + changes[:, None] * (jnp.arange(parts + 1) / parts)[:, None]
        values = row_values(cones, places)
        score = scores(cones.spread(3), dot(axes[:, :, None], body[:, None]), values)
        score = computed_once(gate, score)  # (z, d, parts + 1, m)
        curvature = score_curvature(cones, rotations.angle(turns) / parts, rate, bend).T  # (z or 1, d, m)
        over = edge_bound(score[:, :, :-1], score[:, :, 1:], curvature[:, :, None] / 2)  # +inf for a NaN
        over = jnp.where(spread(jnp.asarray(cones.bound), 2), over, -jnp.inf)
        worst = reduce(jnp.maximum, [over[:, d] for d in range(over.shape[1])])  # (z, parts, m)
        if cones is scene.cones:  # the worst interval counts: one arc cosine for all
            worst = jnp.max(worst, axis=1, keepdims=True)
        worst = jnp.moveaxis(worst, 0, -1)
        margins = margins_of_scores(cones, worst)
        margins = jnp.where(jnp.isneginf(worst), jnp.inf, margins)
        both = [margins, margins - jnp.minimum(wanted[:, None], room(cones))]
        if cones is scene.grouped_cones:
            both = [best_entries(cones, part) for part in both]
        new = [jnp.min(part, axis=(0, -1)) for part in both]
        least = [jnp.minimum(first, second) for first, second in zip(least, new, strict=True)]
    return least[0], least[1]


def sights_of(sights: Sights, cosines: Array, sines: Array) -> Array:
    """Sights (3, d, ...) in body axes, from cosines and sines (2n, ...) of azimuths and then elevations."""
    count = sights.mounts.shape[0]
    ca, ce, sa, se = cosines[:count], cosines[count:], sines[:count], sines[count:]
    seen = [jnp.stack(vectors.outward(ca, sa, ce, se))]
    if sights.fixed.shape[0]:
        fixed = spread(jnp.asarray(sights.fixed).T, ca.ndim - 1)
        seen.append(jnp.broadcast_to(fixed, (*fixed.shape[:2], *ca.shape[1:])))
    if sights.carried.shape[0]:
        circles = (part[sights.carrier] for part in (ca, sa, ce, se))
        seen.append(jnp.stack(sights.carried_at(*circles, behind=ca.ndim - 1)))
    return jnp.concatenate(seen, axis=1)


def row_axes(rows: Constraints, turned: Array, body: Array) -> Array:
    """Axes (3, z, ...) of the rows in body axes.

    Args:
        rows: the constraints.
        turned: (3, z, ...) the axes, all taken for inertial, in body axes.
        body: (3, d, ...) sights.
    """
    if not rows.inner:
        return turned
    behind = turned.ndim - 2
    frame, still = spread(jnp.asarray(rows.frame), behind), spread(jnp.asarray(rows.axis).T, behind)
    return jnp.where(frame == INERTIAL, turned, jnp.where(frame == SIGHT, body[:, rows.partner], still))


def row_values(rows: Constraints, joints: Array) -> Array | None:
    """What rows of joints hold against their bound, (z, d, ...), at joints (2n, ...)."""
    if not rows.inner:
        return None
    return jnp.moveaxis(joint_values(rows, jnp.moveaxis(joints, 0, -1)), (-1, -2), (0, 1))


def _positions(
    scene: Scene, quaternions: Array, turns: Array, joints: Array, changes: Array, gate: Array, halvings: int
) -> tuple[Array, Array, Array]:
    """Motions at the ends of their even parts.

    Sines are taken for the start and the first part alone; the others are products of these.

    Returns:
        (4, parts + 1, m) attitudes; (2n, parts + 1, m) each of the cosines and sines of azimuths and
        elevations.
    """
    parts = 2**halvings
    mounts = jnp.concatenate([scene.mounts, jnp.zeros_like(scene.mounts)])[:, None]
    half = rotations.angle(turns) / 2
    sine = jnp.sin(half)
    axis = turns[1:] * jnp.where(turns[0] < 0, -1, 1) / jnp.where(sine > 0, sine, 1)
    angles = [joints + mounts, changes / parts, half / parts]
    cosines, sines = computed_once(gate, ([jnp.cos(a) for a in angles], [jnp.sin(a) for a in angles]))
    attitudes, circles = quaternions[:, None], jnp.stack([cosines[0], sines[0]])[:, :, None]
    step = jnp.concatenate([cosines[2][None], axis * sines[2]])[:, None]
    turn = jnp.stack([cosines[1], sines[1]])[:, :, None]
    for _ in range(halvings):
        attitudes = jnp.concatenate([attitudes, _times(attitudes, step)], axis=1)
        circles = jnp.concatenate([circles, _product(circles, turn)], axis=2)
        step, turn = _times(step, step), _product(turn, turn)
    attitudes = jnp.concatenate([attitudes, _times(attitudes[:, :1], step)], axis=1)
    circles = jnp.concatenate([circles, _product(circles[:, :, :1], turn)], axis=2)
    attitudes, circles = computed_once(gate, (attitudes, circles))
    return attitudes, circles[0], circles[1]


def _times(first: Array, second: Array) -> Array:
    """Product of quaternions, (4, ...)."""
    return jnp.stack(rotations.product(first, second))


def _product(first: Array, second: Array) -> Array:
    """Cosine and sine of the sum of two angles, (2, ...)."""
    cosine, sine = first[0] * second[0] - first[1] * second[1], first[1] * second[0] + first[0] * second[1]
    return jnp.stack([cosine, sine])
