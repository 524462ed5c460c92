"""What both methods know of a path's nodes: which are distinct, when each is passed, how far it turns.

Time is shared out by the cost of the edges, which is the time that each takes at full speed; equal costs
give the equal split of the paper. An edge of little cost still gets a tenth of the mean, so that two near
nodes with a corner between them do not ask for a jolt. Nodes without motion between them count as one.
"""

import numpy as np

from jaxplan import so3
from jaxplan.model.path import Path

FEWEST_NODES = 32  # smallest padded number; each next one is four times as large

_LEAST_SHARE = 0.1  # of the mean edge's time
_SAME_NODE = 1e-10  # rad, or matrix element


def _distinct_nodes(path: Path) -> np.ndarray:
    """Which nodes differ from the one before; the first one does.

    Args:
        path: with m + 1 nodes.

    Returns:
        (m + 1,) bool.
    """
    turned = np.abs(np.diff(path.attitudes, axis=0)).max(axis=(1, 2), initial=0.0)
    moved = np.abs(np.diff(path.joints, axis=0)).max(axis=1, initial=0.0)
    same = (turned <= _SAME_NODE) & (moved <= _SAME_NODE)  # a NaN is not the same
    return np.concatenate([[True], ~same])


def passed_nodes(path: Path, *, at_speed: bool, every: bool) -> tuple[Path, np.ndarray]:
    """The path that a motion passes, whose nodes are not repeated, unless that is all there is to it.

    Args:
        path: with m + 1 nodes.
        at_speed: whether the motion starts or ends with a rate: then it leaves even a single node, and comes
            back to it.
        every: whether repeated nodes are kept, unless nothing moves.

    Returns:
        The path, of one node if nothing moves, and for each given node its own number there.
    """
    kept = _distinct_nodes(path)
    if not at_speed and np.sum(kept) == 1:
        every = False
    elif len(kept) == 1:
        twice = np.zeros(2, dtype=int)
        both = Path(attitudes=path.attitudes[twice], joints=path.joints[twice], edge_costs=np.ones(1))
        return both, np.zeros(1, dtype=int)
    else:
        kept[-1] |= np.sum(kept) == 1
    kept |= every
    passed = Path(
        attitudes=np.asarray(path.attitudes, float)[kept],
        joints=np.asarray(path.joints, float)[kept],
        edge_costs=np.asarray(path.edge_costs, float)[kept[1:]],
    )
    return passed, np.cumsum(kept) - 1


def node_fractions(edge_costs: np.ndarray) -> np.ndarray:
    """Times of the nodes as fractions of the duration.

    Args:
        edge_costs: (m,) finite and not negative, m >= 1.

    Returns:
        (m + 1,) strictly increasing from 0 to 1.
    """
    mean = np.mean(edge_costs)
    shares = np.maximum(edge_costs / mean, _LEAST_SHARE) if mean > 0 else np.ones(len(edge_costs))
    if np.all(np.abs(shares - shares[0]) <= 1e-12 * shares[0]):
        return np.linspace(0.0, 1.0, len(shares) + 1)
    ends = np.concatenate([[0.0], np.cumsum(shares)])
    return ends / ends[-1]


def edge_turns(attitudes: np.ndarray) -> np.ndarray:
    """Rotation along each edge.

    Args:
        attitudes: (m + 1, 3, 3) body to inertial.

    Returns:
        (m, 3) rad, rotation vectors in the axes of each edge's first node.
    """
    return np.asarray(so3.log(np.swapaxes(attitudes[:-1], -1, -2) @ attitudes[1:]))


def padded(array: np.ndarray, size: int) -> np.ndarray:
    """An array brought to one of few lengths by repeating its last entry, so that kernels are compiled once.

    Args:
        array: (k, ...).
        size: the least length; each next one is four times as large.
    """
    while size < len(array):
        size *= 4
    return np.concatenate([array, np.repeat(array[-1:], size - len(array), axis=0)])
