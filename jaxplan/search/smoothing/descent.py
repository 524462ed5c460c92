"""The descent of a band: damped Newton steps among smooth displacements.

The energy is taken to second order; clearances are linearised (Gauss-Newton). A step is sought among smooth
displacements, K shapes (`_basis`) for each of the C components of a motion, so that a band bends as a whole
and the system to solve has K C unknowns. Of several fractions of a step the best is taken. Nothing is
promised of the result: whether it is clear and shorter is for others to check.

The elements of the system are sums over nodes, or pieces, of the product of two shapes and a second
derivative. They are formed for the pairs p of shapes that overlap, and then put in their places. Other axes
as in `jaxplan.search.smoothing.band`.
"""

from itertools import combinations_with_replacement, product

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.geometry import directions, rotations
from jaxplan.geometry.vectors import cross, dot, unit
from jaxplan.model.constraints import INERTIAL, JOINTS
from jaxplan.model.sights import Sights
from jaxplan.search.motions import computed_once
from jaxplan.search.smoothing import band
from jaxplan.search.smoothing.band import FAR, PENALTY, PIECES, TRAVEL, Problem
from jaxplan.search.smoothing.components import spread, total

FRACTIONS = (1.0, 0.4, 0.12, 0.03)
# Curvature added to that of the energy, to keep steps short: of any motion, and toward zones nearer than FAR.
DAMPING, NEAR_DAMPING = 0.2, 0.005
_SHAPES = 8
_TINY = 1e-12


def _basis() -> np.ndarray:
    """(PIECES + 1, K) displacements along a band: cubic B-splines on even knots, zero at both ends."""
    at = np.linspace(0, _SHAPES - 1, PIECES + 1)[:, None]
    knots = np.concatenate([np.zeros(3), np.arange(_SHAPES), np.full(3, _SHAPES - 1.0)])
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


_AT_NODES = _basis()
_ON_PIECES = np.diff(_AT_NODES, axis=0)
_PAIRS = [
    (i, j)
    for i, j in combinations_with_replacement(range(_SHAPES), 2)
    if np.any(_AT_NODES[:, i] * _AT_NODES[:, j])
]
_NODE_PAIRS, _PIECE_PAIRS = (
    np.stack([shapes[:, i] * shapes[:, j] for i, j in _PAIRS], axis=-1) for shapes in (_AT_NODES, _ON_PIECES)
)


def _zone_terms(
    problem: Problem, quaternions: Array, joints: Array, gate: Array
) -> tuple[Array, Array, Array, Array]:
    """Derivatives of what clearance and limits lack, at the nodes of a band (4, s) and (2n, s).

    Returns:
        (5, d, s) and (5, 5, d, s) first and second ones through the zones, by rotation (3), yaw and pitch of
        each device; (2n, s) both through the joint limits.
    """
    constraints = problem.rows
    axes, body, angles = band.sight(problem, quaternions[:, None], joints[:, None], gate)
    slacks = band.zone_slacks(problem, axes, body, joints[:, None])[:, :, 0]
    zone, seen = axes[:, :, None, 0], body[:, None, :, 0]
    by_yaw, by_pitch = _by_joints(problem.sights, body[:, :, 0], angles[:, :, 0])
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
    rows, weight, force = computed_once(gate, (rows, weight, 2 * PENALTY * jnp.minimum(slacks, 0)))
    first = jnp.zeros((5, *rows.shape[2:]))
    second = jnp.zeros((5, *first.shape))
    for z in range(rows.shape[1]):
        first += force[z] * rows[:, z]
        second += weight[z] * rows[:, None, z] * rows[None, :, z]
    first, second = (_of_devices(problem.sights, part) for part in (first, second))
    beyond = band.beyond_limits(problem, joints[:, None])[:, 0]
    return first, second, 2 * PENALTY * jnp.sign(joints) * beyond, 2 * PENALTY * (beyond > 0)


def _by_joints(sights: Sights, body: Array, angles: Array) -> list[Array]:
    """Derivatives (3, d, s) of sights in yaw and in pitch.

    Args:
        sights: what is bound.
        body: (3, d, s) where they are.
        angles: (2, n, s) cosine and sine of the azimuths.
    """
    if not sights.mounts.shape[0]:
        return [jnp.zeros_like(body)] * 2
    circles = angles[:, jnp.maximum(sights.carriers, 0)]
    both = directions.turns(tuple(body), *circles)
    return [jnp.stack(own) * part[:, None] for own, part in zip(both, sights.turning, strict=True)]


def _of_devices(sights: Sights, terms: Array) -> Array:
    """Terms (..., d, s) of sights, those of vectors that a terminal carries added to its own."""
    if not sights.carried.shape[0]:
        return terms
    count = sights.mounts.shape[0] + sights.fixed.shape[0]
    own, carried = terms[..., :count, :], terms[..., count:, :]
    return own.at[..., sights.carrier, :].add(carried)


def _piece_terms(problem: Problem, quaternions: Array, joints: Array) -> tuple[Array, Array]:
    """First (C, s - 1) and second derivatives (C, C, s - 1) of the tension, by what each piece moves."""
    u = band.pieces(problem, quaternions[:, None], joints[:, None])[:, 0]
    squares = band.squares_of(u)
    norm = jnp.sqrt(total(squares * squares) + _TINY)
    squares = jnp.concatenate([squares[:1], squares[:1], squares])
    same = jnp.eye(len(u))[:, :, None]
    group = same.at[:3, :3].set(1)  # the components of the rotation make one size
    cube = squares * u
    second = 4 * (group * u[:, None] * u / norm - cube[:, None] * cube / norm**3)
    second += same * (2 * squares / norm + 2 * TRAVEL + DAMPING)
    scale = problem.unit / problem.steps[:, None]
    return 2 * (squares / norm + TRAVEL) * u * scale / PIECES, second * scale[:, None] * scale / PIECES


def _places(terminals: int, devices: int) -> tuple[np.ndarray, np.ndarray]:
    """Where each element of the system stands among the packed terms.

    Returns:
        (K C, K C) places of the terms that do not belong to a device, then of those of devices; the packed
        terms are (C, C, p), (5, 5, d, p), (3, 3, p) and zeros, (p,).
    """
    size = 3 + 2 * terminals
    row = [0, 1, 2] + [3] * terminals + [4] * terminals
    device = [-1] * 3 + 2 * list(range(terminals))
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
    pair = np.full((_SHAPES, _SHAPES), -1)
    for place, (i, j) in enumerate(_PAIRS):
        pair[i, j] = pair[j, i] = place
    outer = pair[:, None, :, None]

    def placed(inner: np.ndarray) -> np.ndarray:
        places = np.where(outer < 0, zero * len(_PAIRS), inner[:, None] * len(_PAIRS) + outer)
        return places.reshape(_SHAPES * size, -1)

    return placed(every), placed(zone)


def _step(problem: Problem, quaternions: Array, joints: Array, gate: Array) -> Array:
    """The displacement (C, s) that would end the descent if the energy were what it looks like."""
    terminals = problem.sights.mounts.shape[0]
    devices = terminals + problem.sights.fixed.shape[0]
    push, bend, limit_push, limit_bend = _zone_terms(problem, quaternions, joints, gate)
    pull, stiff = _piece_terms(problem, quaternions, joints)
    joint_push = jnp.concatenate([push[3, :terminals], push[4, :terminals]]) + limit_push
    force = jnp.concatenate([jnp.sum(push[:3], axis=1), joint_push])
    gradient = (force @ _AT_NODES + pull @ _ON_PIECES).T  # (K, C)

    every, zone = stiff @ _PIECE_PAIRS, bend @ _NODE_PAIRS  # (C, C, p), (5, 5, d, p)
    own = jnp.pad(limit_bend @ _NODE_PAIRS, [(3, 0), (0, 0)])
    every += own[:, None] * np.eye(len(own))[..., None]
    parts = [every, zone, jnp.sum(zone[:3, :3], axis=2), jnp.zeros(len(_PAIRS))]
    packed = jnp.concatenate([part.ravel() for part in parts])
    places = _places(terminals, devices)
    factor = jax.lax.linalg.cholesky(packed[places[0]] + packed[places[1]], symmetrize_input=False)
    half = jax.lax.linalg.triangular_solve(factor, gradient.reshape(-1, 1), left_side=True, lower=True)
    whole = jax.lax.linalg.triangular_solve(factor, half, left_side=True, lower=True, transpose_a=True)
    return -(whole.reshape(gradient.shape).T @ _AT_NODES.T)


def _moved(quaternions: Array, joints: Array, displacement: Array) -> tuple[Array, Array]:
    """A band after displacements (C, ..., s), which turn its nodes about body axes."""
    turn = jnp.concatenate([jnp.ones_like(displacement[:1]), displacement[:3] / 2])
    return jnp.stack(unit(rotations.product(quaternions, turn))), joints + displacement[3:]


def descend(
    problem: Problem, quaternions: Array, joints: Array, gate: Array, iterations: int
) -> tuple[Array, Array]:
    """Let a band contract.

    Args:
        problem: the scene.
        quaternions: (4, PIECES + 1).
        joints: (2n, PIECES + 1) rad.
        gate: see `computed_once`.
        iterations: static.

    Returns:
        The same of the band at the end; its first and last node do not move.
    """

    def contract(_: int, nodes: tuple[Array, Array]) -> tuple[Array, Array]:
        step = _step(problem, *nodes, gate)
        fractions = jnp.asarray(FRACTIONS)
        tried = _moved(nodes[0][:, None], nodes[1][:, None], fractions[:, None] * step[:, None])
        attitudes, angles = computed_once(gate, tried)
        best = jnp.argmin(band.energy(problem, attitudes, angles, gate))
        return _moved(*nodes, fractions[best] * step)

    return jax.lax.fori_loop(0, iterations, contract, (quaternions, joints))
