"""The quadratic programs of a fit, assembled in one compiled call.

Every segment works in ``x`` in [-1, 1], where ``d/dt = (2 / h) d/dx`` with ``h`` the segment's length. Its
rows are written in ``x``: there a rate is ``h / 2`` times that in time, an acceleration ``(h / 2)^2``
times. A segment has as many slots for nodes as the counting rule can fill; those left over repeat its last
node and are marked absent. Nodes and segments are padded to a few sizes, so that fits of different paths
share the compiled kernel.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.trajectory.basis import energy, legendre
from jaxplan.trajectory.schedule import FEWEST_NODES, padded

_FEWEST_SEGMENTS = 4  # smallest padded number; each next one is four times as large


@dataclass(frozen=True, kw_only=True, eq=False)
class Segments:
    """The programs of the platform or of the joints, but for what couples them.

    Attributes:
        length: (S,) s, ``h``.
        objective: (S, l + 1, l + 1) in ``x``, of order one.
        node_rows: (S, slots, l + 1) the basis at each node.
        node_values: (S, slots, d) rad, what the curve must be there.
        present: (S, slots) which slots hold a node.
    """

    length: np.ndarray
    objective: np.ndarray
    node_rows: np.ndarray
    node_values: np.ndarray
    present: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Charts:
    """The charts of the platform's segments.

    Attributes:
        attitude: (S, 3, 3) ``R_a``.
        rate: (S, 3) rad/s, ``Omega``.
        end_turn: (S, 3, 3) ``W`` at the segment's end, ``exp(-h Omega / 2)``.
    """

    attitude: np.ndarray
    rate: np.ndarray
    end_turn: np.ndarray


def assemble(
    *,
    attitudes: np.ndarray,
    joints: np.ndarray,
    times: np.ndarray,
    joint_ends: np.ndarray,
    platform_ends: np.ndarray,
    order: int,
    rate_weight: float,
    acceleration_weight: float,
) -> tuple[Segments, Segments, Charts]:
    """Assembles all programs of a fit.

    Args:
        attitudes: (m + 1, 3, 3) body to inertial.
        joints: (m + 1, 2n) rad.
        times: (m + 1,) s, increasing.
        joint_ends: (S + 1,) node indices where the joints' segments end, with 0 and m.
        platform_ends: (S + 1,) likewise for the platform.
        order: of the Legendre basis.
        rate_weight: ``lambda_1``, of the platform.
        acceleration_weight: ``lambda_2``.

    Returns:
        Segments of the joints, segments of the platform (``node_values`` are those of ``b``), and the charts.
    """
    count = len(joint_ends) - 1
    indices = [node_indices(ends, order - 2) for ends in (joint_ends, platform_ends)]
    nodes = padded(attitudes, FEWEST_NODES), padded(times, FEWEST_NODES)
    with jax.enable_x64(True):
        found = _assemble(*nodes, *(padded(index, _FEWEST_SEGMENTS) for index in indices), order=order)
        joint_rows, rows, b, rate, end_turn = (np.asarray(array)[:count] for array in found)

    def segments(
        ends: np.ndarray, node_rows: np.ndarray, values: np.ndarray, weights: tuple[float, float]
    ) -> Segments:
        length = np.diff(times[ends])
        # Objective (43) times (h / 2)^3, over the sum of the two weights that remain.
        first = weights[0] * (length / 2)[:, None, None] ** 2
        objective = (first * energy(order, 1) + weights[1] * energy(order, 2)) / (first + weights[1])
        present = np.arange(node_rows.shape[1]) <= np.diff(ends)[:, None]
        return Segments(
            length=length, objective=objective, node_rows=node_rows, node_values=values, present=present
        )

    return (
        segments(joint_ends, joint_rows, joints[indices[0]], (0.0, 1.0)),  # (21): no rate term
        segments(platform_ends, rows, b, (rate_weight, acceleration_weight)),
        Charts(attitude=attitudes[platform_ends[:-1]], rate=rate, end_turn=end_turn),
    )


def node_indices(ends: np.ndarray, slots: int) -> np.ndarray:
    """Node of each slot (S, slots) of segments with ends (S + 1,); slots left over repeat the last one."""
    return np.minimum(ends[:-1, None] + np.arange(slots), ends[1:, None])


def assembled(
    attitudes: Array, times: Array, joint_nodes: Array, platform_nodes: Array, *, order: int
) -> tuple[Array, ...]:
    """What depends on the nodes, as a pure function.

    Args:
        attitudes: (m + 1, 3, 3) body to inertial.
        times: (m + 1,) s.
        joint_nodes: (S, slots) node of each slot of the joints' segments.
        platform_nodes: (S, slots) likewise of the platform's.
        order: of the basis.

    Returns:
        Basis rows of joints and platform, values of ``b``, ``Omega`` and ``W`` at the end of each segment.
    """

    def rows(times: Array) -> Array:
        start, end = times[:, :1], times[:, -1:]
        return legendre(2 * (times - start) / (end - start) - 1, order)

    own_times, own_attitudes = times[platform_nodes], attitudes[platform_nodes]
    relative = jnp.swapaxes(own_attitudes[:, :1], -1, -2) @ own_attitudes  # R_a^T R_j
    tau = own_times - own_times[:, :1]
    rate = so3.log(relative[:, -1]) / tau[:, -1:]  # Omega of (25)
    turned = tau[..., None] * rate[:, None]
    back = so3.exp(-turned / 2)  # U_j^T
    b = so3.log(back @ relative @ back) + turned  # (32); the errata have it for nodes within a segment
    return rows(times[joint_nodes]), rows(own_times), b, rate, back[:, -1]


_assemble = partial(jax.jit, static_argnames="order")(assembled)
