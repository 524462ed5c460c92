"""The jitted expansion: all children of a node with their slack, cost and heuristics, in one call.

What a device sees depends only on the attitude move and on its own terminal's two joints, each of which has
three options. So zones are looked at once for every (attitude move, option pair, device) and the children
read the result: nine entries a device instead of one a joint move. Edges are checked whole: each is cut
into intervals, and on each of these a bound of the boresight's curvature makes its ends speak for what
lies between. Slack is a difference of cosines, >= 0 where the wanted clearance is kept.
Letters of axes as in `jaxplan.search.motions`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, reduce

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import zones
from jaxplan.search.motions import STRAIGHT_INTERVALS, Sight, dot, motions
from jaxplan.search.problem import Scene

PLACE_COLUMNS = 7  # attitude relative to the start (4), rotation vector to the goal (3)
HEURISTICS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Expansion:
    """The children of a node: every attitude move (A) with every joint move (M).

    Attributes:
        places: (A, 7) where the attitude moves lead: unit quaternion relative to the start (4), rotation
            vector from there to the goal in body axes (3).
        slacks: (A, M) smallest slack on the way, +inf without zones.
        steps: (A, M) cost of the move, steps.
        heuristics: (4, A, M) steps of the straight motion on to the goal; equation (15): rotation
            angle, Euclidean and Manhattan distance, each with the joints', rad.
        straight: (STRAIGHT_INTERVALS,) smallest slack along the node's straight motion to the goal.
    """

    places: np.ndarray
    slacks: np.ndarray
    steps: np.ndarray
    heuristics: np.ndarray
    straight: np.ndarray


def _fold(combine: Callable[[Array, Array], Array], values: Array, axis: int, empty: float) -> Array:
    """Reduce a short axis by elementwise steps, which fuse; NaN is kept. `empty` is returned for none."""
    parts = [jax.lax.index_in_dim(values, i, axis, keepdims=False) for i in range(values.shape[axis])]
    if not parts:
        return jnp.full(values.shape[:axis] + values.shape[axis:][1:], empty)
    return reduce(combine, parts)


def _signed_cosines(cones: zones.Cones, zone_axes: ArrayLike, sight: Sight, edges: bool) -> Array:
    """Each device's signed cosines, worst of each interval, or at the end alone: (a, o, k or 1, d, z)."""
    axes, body = jnp.asarray(zone_axes), jnp.asarray(sight.body)
    dots = dot(axes[:, :, None, :, None, :], body[:, None, :, :, :, None])
    if edges:
        sag = jnp.asarray(sight.sag)[:, :, None, :, None]
        cosines = zones.swept_cosines(cones, dots[:, :, :-1], dots[:, :, 1:], sag)
    else:
        cosines = jnp.asarray(cones.side) * dots[:, :, -1:]
    return jnp.where(cones.bound.T, cosines, -jnp.inf)


def _child_slacks(
    scene: Scene, sight: Sight, choice: Array, wanted: tuple[Array, Array], edges: bool
) -> Array:
    """Smallest slack of every child, (a, m).

    Args:
        scene: the problem.
        sight: lines of sight of the moves.
        choice: (m, d) the option pair of each device's joints.
        wanted: (z,) cosines asked for by the zones, and by those of groups.
        edges: whether the whole edge counts.
    """
    devices = range(choice.shape[1])
    cosines = _fold(jnp.maximum, _signed_cosines(scene.cones, sight.axes, sight, edges), 2, -jnp.inf)
    worst = _fold(jnp.minimum, wanted[0] - cosines, 3, jnp.inf)  # (a, o, d)
    total = jnp.full((worst.shape[0], choice.shape[0]), jnp.inf)
    for device in devices:
        total = jnp.minimum(total, worst[:, choice[:, device], device])
    if scene.grouped_cones.half_angle.shape[0]:  # a group's zone couples its devices at each instant
        grouped = _signed_cosines(scene.grouped_cones, sight.grouped_axes, sight, edges)
        for interval in range(grouped.shape[2]):
            seen = [grouped[:, choice[:, device], interval, device] for device in devices]  # (a, m, z)
            held = reduce(jnp.maximum, seen)
            total = jnp.minimum(total, _group_slacks(scene, wanted[1] - held))
    return total


def _group_slacks(scene: Scene, slacks: Array) -> Array:
    """Smallest slack over all groups, (...), each group's best zone counting; slacks are (..., z)."""
    return jnp.min(zones.group_margins(scene.grouped_cones, slacks), axis=-1)


def _straight_slacks(scene: Scene, sight: Sight, wanted: tuple[Array, Array]) -> Array:
    """Smallest slack on each interval of the straight motion to the goal, (k,)."""
    cosines = _signed_cosines(scene.cones, sight.axes, sight, edges=True)[0, 0]  # (k, d, z)
    slacks = wanted[0] - _fold(jnp.maximum, cosines, 1, -jnp.inf)
    total = _fold(jnp.minimum, slacks, 1, jnp.inf)
    if scene.grouped_cones.half_angle.shape[0]:
        grouped = _signed_cosines(scene.grouped_cones, sight.grouped_axes, sight, edges=True)[0, 0]
        held = wanted[1] - _fold(jnp.maximum, grouped, 1, -jnp.inf)
        total = jnp.minimum(total, _group_slacks(scene, held))
    return total


@partial(jax.jit, static_argnames="edges")
def _expand(
    scene: Scene,
    node: Array,
    turns: Array,
    options: Array,
    choice: Array,
    clearance: Array,
    gate: Array,
    *,
    edges: bool,
) -> Array:
    """The answer of `expand` as one array."""
    parts = motions(scene, node, turns, options, choice, clearance, gate)
    moved, straight, places, reach, ways, wanted = parts
    terminals = scene.mounts.shape[0]
    pairs = 3 * choice[:, :terminals] + choice[:, terminals:]
    still = jnp.zeros((choice.shape[0], scene.fixed_boresights.shape[0]), pairs.dtype)
    device_choice = jnp.concatenate([pairs, still], axis=-1)
    slacks = _child_slacks(scene, moved, device_choice, (wanted[0][0], wanted[1][0]), edges)
    along = _straight_slacks(scene, straight, (wanted[0][1:], wanted[1][1:]))
    turn_steps, angle, euclidean, manhattan = reach[:, :, None]
    joint_steps, steps_left, manhattan_left, euclidean_left = ways[:, None, :]
    numbers = [
        slacks,
        jnp.maximum(turn_steps, joint_steps),
        jnp.maximum(angle / scene.attitude_step, steps_left),
        angle + manhattan_left,  # the three of (15)
        euclidean + euclidean_left,
        manhattan + manhattan_left,
    ]
    return jnp.concatenate([places.ravel(), *(number.ravel() for number in numbers), along])


def expand(
    scene: Scene,
    node: np.ndarray,
    turns: np.ndarray,
    options: np.ndarray,
    choice: np.ndarray,
    clearance: np.ndarray,
    *,
    edges: bool,
) -> Expansion:
    """All children of a node, and the straight motion from it to the goal.

    Args:
        scene: the problem.
        node: (7 + 2n,) unit quaternion relative to the start (4), rotation vector to the goal in body
            axes (3), joints.
        turns: (A, 3) rotation vectors of the attitude moves, body axes.
        options: (3, 2n) change of each joint under each of its three options, rad.
        choice: (M, 2n) int, the option of each joint in each joint move.
        clearance: (1 + STRAIGHT_INTERVALS,) rad wanted of the children, and along the straight motion.
        edges: whether zones hold over the whole edge or at its end alone.
    """
    packed = np.asarray(_expand(scene, node, turns, options, choice, clearance, True, edges=edges))
    shape = (len(turns), len(choice))
    first, last = len(turns) * PLACE_COLUMNS, len(packed) - STRAIGHT_INTERVALS
    numbers = packed[first:last].reshape(2 + HEURISTICS, *shape)
    return Expansion(
        packed[:first].reshape(-1, PLACE_COLUMNS), numbers[0], numbers[1], numbers[2:], packed[last:]
    )
