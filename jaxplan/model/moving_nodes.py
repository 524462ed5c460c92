"""Nodes of a path that move with its ends: those on straight motions from the start and to the goal.

A motion is *straight* if platform and joints turn at constant rates. A search cuts such motions into edges of
one step. So a node on the straight motion that leaves the start, or on the one that reaches the goal (a
*lead*), was not chosen by itself: when that end moves, the node keeps its fraction of the motion. If the
whole path is straight, this holds for every node. The functions compute with numpy or JAX.
"""

from dataclasses import dataclass

import jax
import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module, length
from jaxplan.runtime.display import shown

_LINE_TOLERANCE = 1e-9  # rad; an edge that is off a line by no more than this lies on it


@shown("first", "second", "share")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Leads:
    """Where the m + 1 nodes of a path lie on the straight motions next to its ends.

    Attributes:
        first: (m + 1,) int, number of the node at which the straight motion begins on which each node lies;
            for a node that lies on none its own number.
        second: (m + 1,) int, number of the node at which that motion ends; likewise.
        share: (m + 1,) fraction of that motion at which the node lies; zero for a node that lies on none.
        turn: (m + 1, 3) rad, rotation vector of the platform over the whole motion, body axes at its
            beginning; it may exceed half a turn.
    """

    first: np.ndarray
    second: np.ndarray
    share: np.ndarray
    turn: np.ndarray

    def nodes(self, attitudes: AnyArray, joints: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return all nodes, with those on straight motions put back onto these after the ends have moved.

        Args:
            attitudes: (m + 1, 3, 3) body to inertial, with the ends where they are now.
            joints: (m + 1, J) rad, likewise, of J joints.

        Returns:
            Attitudes (m + 1, 3, 3) and joints (m + 1, J).
        """
        start, turn = attitudes[self.first], self._rotation_vectors(attitudes)
        moves = joints[self.second] - joints[self.first]
        turned = start @ so3.exp(self.share[:, None] * turn)
        return turned, joints[self.first] + self.share[:, None] * moves

    def _rotation_vectors(self, attitudes: AnyArray) -> AnyArray:
        """Return the rotation vectors (m + 1, 3) rad of the straight motions, turning the way of `turn`."""
        xp = array_module(attitudes)
        turn = so3.log(xp.swapaxes(attitudes[self.first], -1, -2) @ attitudes[self.second])
        angle = length(turn)
        other_way = xp.sum(turn * self.turn, axis=-1) < 0
        return turn * (1 - xp.where(other_way, 2 * np.pi / xp.where(angle > 0, angle, 1), 0))[:, None]


def leads_of(attitudes: np.ndarray, joints: np.ndarray, nodes: int | None = None) -> Leads:
    """Find the leads of a path.

    Args:
        attitudes: (m + 1, 3, 3) of its nodes, body to inertial.
        joints: (m + 1, J) rad, of its nodes, for J joints.
        nodes: number of nodes before the padding; None if there is no padding.
    """
    count = len(attitudes)
    turns = so3.log(np.swapaxes(attitudes[:-1], -1, -2) @ attitudes[1:])[: (nodes or count) - 1]
    edges = np.concatenate([turns, np.diff(joints, axis=0)[: len(turns)]], axis=1)
    own = np.minimum(np.arange(count), (nodes or count) - 1)  # padded nodes equal the last one
    first, second = own.copy(), own.copy()
    share, turn = np.zeros(count), np.zeros((count, 3))
    last = len(edges)
    ahead = _count_straight_edges(edges)
    behind = last - _count_straight_edges(edges[::-1])
    for begin, end in {(0, ahead), (behind, last)}:
        steps = np.linalg.norm(edges[begin:end], axis=1)
        if end - begin < 2 or not np.sum(steps):
            continue
        inner = slice(begin + 1, end)
        first[inner], second[inner] = begin, end
        share[inner] = (np.cumsum(steps) / np.sum(steps))[:-1]
        turn[inner] = np.sum(turns[begin:end], axis=0)
    return Leads(first=first, second=second, share=share, turn=turn)


def _count_straight_edges(edges: np.ndarray) -> int:
    """Return how many of the first edges lie along one line, within less than a whole turn of the platform.

    Args:
        edges: (m, 3 + J) rad, changes along each edge: rotation vector of the platform, then joints.
    """
    steps = np.linalg.norm(edges, axis=1)
    moving = np.flatnonzero(steps)
    if not len(moving):
        return 0
    along = edges[moving[0]] / steps[moving[0]]
    ways = edges @ along
    off = np.linalg.norm(edges - ways[:, None] * along, axis=1)
    turned = np.linalg.norm(np.cumsum(edges[:, :3], axis=0), axis=1)
    straight = (off <= _LINE_TOLERANCE) & (ways >= 0) & (turned < 2 * np.pi)
    return int(np.argmin(np.append(straight, False)))
