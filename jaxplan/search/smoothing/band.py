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

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from jaxplan import zones
from jaxplan.search.motions import computed_once, dot
from jaxplan.search.problem import JOINT_RESERVE, TAPER_STEPS, Scene
from jaxplan.search.smoothing.components import between, in_body, spread, total

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
        mounts: (n,) rad.
        fixed: (3, i) boresights of the instruments, body axes.
        steps: (C,) rad a step, of rotation (3 times) and joints.
        limits: (2n,) rad, bound of each joint's angle.
        axes: (3, z) of all zones, in the body axes of the start.
        side: (z,) +1 for keep-out, -1 for keep-in.
        bound: (z, d) bool.
        group: (z,) int, as in `zones.Cones`; None where every zone holds by itself.
        scale: (z,) rad for a unit of the cosine, near the zone's edge.
        wanted: (z, s) signed cosine at which a zone is as far as wanted from each node.
        unit: () what turns steps on a piece into the unit of the energy.
    """

    mounts: Array
    fixed: Array
    steps: Array
    limits: Array
    axes: Array
    side: Array
    bound: Array
    group: Array | None
    scale: Array
    wanted: Array
    unit: Array


def make_problem(scene: Scene, length: Array, clearance: Array) -> Problem:
    """The scene as a band of `length` steps takes it, with `clearance` (rad) wanted off both ends."""
    pair = (scene.cones, scene.grouped_cones)
    at = jnp.arange(PIECES + 1) / PIECES
    taper = jnp.minimum(jnp.minimum(at, 1 - at) * length / TAPER_STEPS, 1)
    wanted = [zones.cosine_threshold(cones, (clearance + BUFFER) * taper).T for cones in pair]
    half_angle = jnp.concatenate([jnp.asarray(cones.half_angle) for cones in pair])
    direction = jnp.concatenate([jnp.asarray(cones.direction) for cones in pair])
    group = None
    if pair[1].half_angle.shape[0]:
        alone = pair[0].half_angle.shape[0]
        group = jnp.concatenate([jnp.asarray(pair[0].group), alone + jnp.asarray(pair[1].group)])
    ends = jnp.maximum(jnp.abs(scene.start_joints), jnp.abs(scene.goal_joints))
    limits = jnp.asarray(scene.joint_limits) - JOINT_RESERVE * jnp.asarray(scene.joint_steps)
    return Problem(
        mounts=jnp.asarray(scene.mounts),
        fixed=jnp.asarray(scene.fixed_boresights).T,
        steps=jnp.concatenate([jnp.full(3, scene.attitude_step), jnp.asarray(scene.joint_steps)]),
        limits=jnp.maximum(limits, ends),
        axes=jnp.asarray(scene.start_attitude).T @ direction.T,
        side=jnp.concatenate([jnp.asarray(cones.side) for cones in pair]),
        bound=jnp.concatenate([jnp.asarray(cones.bound) for cones in pair]),
        group=group,
        # at most ten: near the axis of a narrow cone the cosine tells little
        scale=1 / jnp.maximum(jnp.sin(half_angle), 0.1),
        wanted=jnp.concatenate(wanted),
        unit=PIECES / length,
    )


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


def sight(
    problem: Problem, quaternions: Array, joints: Array, gate: Array
) -> tuple[Array, Array, tuple[Array, Array, Array, Array]]:
    """Zones and boresights at the nodes.

    Returns:
        (3, z, f, s) axes of the zones and (3, d, f, s) boresights, in body axes; (n, f, s) each of cosine and
        sine of the azimuth, cosine and sine of the elevation.
    """
    count = problem.mounts.shape[0]
    offsets = jnp.concatenate([problem.mounts, jnp.zeros_like(problem.mounts)])
    angles = joints + spread(offsets, 2)
    cosines, sines = computed_once(gate, (jnp.cos(angles), jnp.sin(angles)))
    ca, ce, sa, se = cosines[:count], cosines[count:], sines[:count], sines[count:]
    boresights = jnp.stack([ce * ca, ce * sa, se])
    if problem.fixed.shape[1]:
        still = jnp.broadcast_to(spread(problem.fixed, 2), (*problem.fixed.shape, *joints.shape[1:]))
        boresights = jnp.concatenate([boresights, still], axis=1)
    return in_body(quaternions, problem.axes), boresights, (ca, sa, ce, se)


def zone_slacks(problem: Problem, axes: Array, boresights: Array) -> Array:
    """(z, d, f, s) how much nearer each device might be to each zone, about rad; FAR where it is free."""
    cosines = dot(axes[:, :, None], boresights[:, None])
    slacks = problem.wanted[:, None, None] - spread(problem.side, 3) * cosines
    slacks *= spread(problem.scale, 3)
    counts = jnp.broadcast_to(spread(problem.bound, 2), slacks.shape)
    if problem.group is not None:  # of a group only the zone that is best held counts
        held = jnp.min(jnp.where(counts, slacks, jnp.inf), axis=1, initial=jnp.inf)
        same = spread(problem.group[:, None] == problem.group, 2)
        best = jnp.max(jnp.where(same, held, -jnp.inf), axis=1)
        counts &= (held >= best)[:, None]
    return jnp.where(counts, slacks, FAR)


def beyond_limits(problem: Problem, joints: Array) -> Array:
    """(2n, f, s) rad that joints are beyond their limits."""
    return jnp.maximum(jnp.abs(joints) - spread(problem.limits, 2), 0)


def energy(problem: Problem, quaternions: Array, joints: Array, gate: Array) -> Array:
    """(f,) the energy of bands (4, f, s) and (2n, f, s)."""
    squares = squares_of(pieces(problem, quaternions, joints))
    tension = jnp.mean(jnp.sqrt(total(squares * squares)) + TRAVEL * total(squares), axis=-1)
    axes, boresights, _ = sight(problem, quaternions, joints, gate)
    short = jnp.minimum(zone_slacks(problem, axes, boresights), 0)
    beyond = beyond_limits(problem, joints)
    lacking = total(total(short * short)) + total(beyond * beyond)
    return tension + PENALTY * jnp.sum(lacking, axis=-1)
