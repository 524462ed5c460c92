"""What a band strives for: an elastic band that contracts, while zones and joint limits push it back.

A band is a path of `PIECES` pieces of equal time. With ``a`` the steps that the platform and each joint make
on a piece, in a unit in which the largest is about one, its energy is

    mean over pieces of (sum a^4)^(1/2) + TRAVEL sum a^2
    + PENALTY * sum over nodes of (what clearance and joint limits lack, rad)^2

The first term is a smooth stand-in for the square of the largest ``a``, which is the time the piece takes;
as with every energy, equal pieces are the best. The second keeps joints from travelling for nothing while
another is the slowest. Both are convex in the pieces.

Axes: components first (of a quaternion, a vector, the joints; C = 3 + 2n of a motion, rotation first), then
zone z and device d, then f of bands tried at once, last the node s along the band. Attitudes are unit
quaternions relative to the start, neighbours of the same sign.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.geometry.vectors import dot
from jaxplan.model.constraints import JOINTS, SIGHT, Constraints, scores, thresholds
from jaxplan.model.sights import Sights
from jaxplan.search.motions import computed_once
from jaxplan.search.problem import JOINT_RESERVE, TAPER_STEPS, Scene
from jaxplan.search.smoothing.components import between, in_body, spread, total
from jaxplan.search.smoothing.sweeps import row_axes, row_values, sights_of

PIECES = 24
TRAVEL = 0.2
PENALTY = 700.0
# Clearance that a band is given beyond what is wanted, rad, for what lies between its nodes.
BUFFER = 0.012
FAR = 0.15
"""Slack, rad, of what no zone binds, or more than what is to be felt."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """What the energy needs to know of the scene.

    Attributes:
        sights: what is bound.
        rows: all constraints; where two sights must keep apart, each is the axis of a row.
        grouped: whether any constraint has several entries.
        steps: (C,) rad a step, of rotation (3 times) and joints.
        limits: (2n,) rad, bound of each joint's angle.
        axes: (3, z) of all rows, taken for inertial, in the body axes of the start.
        scale: (z,) rad for a unit of the score, near the row's edge.
        wanted: (z, s) score at which a row is as far as wanted from each node.
        unit: () what turns steps on a piece into the unit of the energy.
    """

    sights: Sights
    rows: Constraints
    steps: Array
    limits: Array
    axes: Array
    scale: Array
    wanted: Array
    unit: Array
    grouped: bool = field(metadata={"static": True})


def make_problem(scene: Scene, length: Array, clearance: Array) -> Problem:
    """The scene as a band of `length` steps takes it, with `clearance` (rad) wanted off both ends."""
    rows = _all_rows(scene)
    at = jnp.arange(PIECES + 1) / PIECES
    taper = jnp.minimum(jnp.minimum(at, 1 - at) * length / TAPER_STEPS, 1)
    # at most ten: near the axis of a narrow cone the cosine tells little
    scale = 1 / jnp.maximum(jnp.sin(jnp.asarray(rows.half_angle)), 0.1)
    ends = jnp.maximum(jnp.abs(scene.start_joints), jnp.abs(scene.goal_joints))
    limits = jnp.asarray(scene.joint_limits) - JOINT_RESERVE * jnp.asarray(scene.joint_steps)
    return Problem(
        sights=scene.sights,
        rows=rows,
        grouped=scene.grouped_cones.half_angle.shape[0] > 0,
        steps=jnp.concatenate([jnp.full(3, scene.attitude_step), jnp.asarray(scene.joint_steps)]),
        limits=jnp.maximum(limits, ends),
        axes=jnp.asarray(scene.start_attitude).T @ jnp.asarray(rows.axis).T,
        scale=jnp.where(rows.frame == JOINTS, 1, scale) if rows.inner else scale,
        wanted=thresholds(rows, (clearance + BUFFER) * taper).T,
        unit=PIECES / length,
    )


def _all_rows(scene: Scene) -> Constraints:
    """The rows of both tables, and those between two sights once more with the two exchanged."""
    tables = [scene.cones, scene.grouped_cones]
    if scene.grouped_cones.inner:
        tables.append(_exchanged(scene.grouped_cones))
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


def _exchanged(rows: Constraints) -> Constraints:
    """Rows between two sights with axis and sight exchanged; the others bind nothing."""
    bound = jnp.asarray(rows.bound)
    between = (jnp.asarray(rows.frame) == SIGHT) & jnp.any(bound, axis=1)
    axis = jnp.arange(bound.shape[1]) == jnp.asarray(rows.partner)[:, None]
    exchanged: dict[str, Any] = {"partner": jnp.argmax(bound, axis=1), "bound": axis & between[:, None]}
    return replace(rows, **exchanged)


def pieces(problem: Problem, quaternions: Array, joints: Array) -> Array:
    """(C, f, s - 1) motion on each piece, in the unit of the energy."""
    vector = between(quaternions)[1:]
    square = dot(vector, vector)
    # the arc sine's series, good to 1e-6 up to 0.7 rad
    turn = 2 * vector * (1 + square * (1 / 6 + square * (3 / 40 + square * 15 / 336)))
    motion = jnp.concatenate([turn, jnp.diff(joints, axis=-1)])
    return motion / spread(problem.steps, 2) * problem.unit


def squares_of(motion: Array) -> Array:
    """(1 + 2n, f, s) of the size of rotations and joint motions."""
    return jnp.concatenate([dot(motion[:3], motion[:3])[None], motion[3:] * motion[3:]])


def sight(problem: Problem, quaternions: Array, joints: Array, gate: Array) -> tuple[Array, Array, Array]:
    """Rows and sights at the nodes.

    Returns:
        (3, z, f, s) axes of the rows and (3, d, f, s) sights, in body axes; (2, n, f, s) cosine and sine of
        the azimuths.
    """
    mounts = jnp.asarray(problem.sights.mounts)
    angles = joints + spread(jnp.concatenate([mounts, jnp.zeros_like(mounts)]), 2)
    cosines, sines = computed_once(gate, (jnp.cos(angles), jnp.sin(angles)))
    body = sights_of(problem.sights, cosines, sines)
    axes = row_axes(problem.rows, in_body(quaternions, problem.axes), body)
    return axes, body, jnp.stack([cosines, sines])[:, : len(mounts)]


def zone_slacks(problem: Problem, axes: Array, body: Array, joints: Array) -> Array:
    """(z, d, f, s) how much nearer each sight might be to each row, about rad; FAR where it is free."""
    rows = problem.rows
    score = scores(rows.spread(3), dot(axes[:, :, None], body[:, None]), row_values(rows, joints))
    slacks = (problem.wanted[:, None, None] - score) * spread(problem.scale, 3)
    counts = jnp.broadcast_to(spread(jnp.asarray(rows.bound), 2), slacks.shape)
    if problem.grouped:  # of a constraint only the entry that holds best counts
        held = jnp.min(jnp.where(counts, slacks, jnp.inf), axis=1, initial=jnp.inf)
        if rows.nested:
            held = jnp.min(jnp.where(_same(rows.entry), held, jnp.inf), axis=1)
        best = jnp.max(jnp.where(_same(rows.group), held, -jnp.inf), axis=1)
        counts &= (held >= best)[:, None]
    return jnp.where(counts, slacks, FAR)


def _same(number: ArrayLike) -> Array:
    """(z, z, 1, 1) whether rows have the same number."""
    own = jnp.asarray(number)
    return spread(own[:, None] == own, 2)


def beyond_limits(problem: Problem, joints: Array) -> Array:
    """(2n, f, s) rad that joints are beyond their limits."""
    return jnp.maximum(jnp.abs(joints) - spread(problem.limits, 2), 0)


def energy(problem: Problem, quaternions: Array, joints: Array, gate: Array) -> Array:
    """(f,) the energy of bands (4, f, s) and (2n, f, s)."""
    squares = squares_of(pieces(problem, quaternions, joints))
    tension = jnp.mean(jnp.sqrt(total(squares * squares)) + TRAVEL * total(squares), axis=-1)
    axes, body, _ = sight(problem, quaternions, joints, gate)
    short = jnp.minimum(zone_slacks(problem, axes, body, joints), 0)
    beyond = beyond_limits(problem, joints)
    lacking = total(total(short * short)) + total(beyond * beyond)
    return tension + PENALTY * jnp.sum(lacking, axis=-1)
