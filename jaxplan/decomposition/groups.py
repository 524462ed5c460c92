"""Caps of which not all need be clear: the kernels' side of groups.

A group asks for one of its members, a member for all of its caps. Lanes are the last axis, m caps the first.
"""

import jax
import jax.numpy as jnp
from jax import Array


def group_excess(excess: Array, member: Array, group: Array) -> Array:
    """Excess of each group: the worst cap of its best member.

    Args:
        excess: (m, K) of every cap.
        member: (m,) number of each cap's member, ascending.
        group: (m,) number of each cap's group.

    Returns:
        (m, K), -inf for numbers that no group has.
    """
    of_group, _, _ = _by_group(excess, member, group)
    return jnp.where(of_group < jnp.inf, of_group, -jnp.inf)


def applies(excess: Array, member: Array, group: Array) -> Array:
    """Which caps belong to the best member of their group, the first one where several are as good.

    Args:
        excess: (m, K) of every cap.
        member: (m,) number of each cap's member, ascending.
        group: (m,) number of each cap's group.

    Returns:
        (m, K) bool.
    """
    of_group, of_member, group_of = _by_group(excess, member, group)
    count = excess.shape[0]
    best = jnp.where(of_member <= of_group[group_of], jnp.arange(count)[:, None], count)
    chosen = jax.ops.segment_min(best, group_of, num_segments=count)
    return chosen[group] == member[:, None]


def _by_group(excess: Array, member: Array, group: Array) -> tuple[Array, Array, Array]:
    """Excess of each group and each member, +inf for numbers not used, and the group of each member."""
    count = excess.shape[0]
    of_member = jax.ops.segment_max(excess, member, num_segments=count, indices_are_sorted=True)
    used = jnp.zeros(count, bool).at[member].set(True)
    of_member = jnp.where(used[:, None], of_member, jnp.inf)
    group_of = jnp.zeros_like(group).at[member].set(group)
    return jax.ops.segment_min(of_member, group_of, num_segments=count), of_member, group_of
