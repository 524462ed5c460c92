"""Priority queues that take the children of an expansion as one lazily opened block.

Pushing several hundred children onto several heaps costs more than computing them. Here each heap holds one
entry a block, keyed by the block's best child that is left; taking that child puts the block back under
its next one. Ties are broken by the order of insertion, so that a search is deterministic.
"""

import heapq
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import numpy as np


@dataclass(slots=True, eq=False)
class Block:
    """The children of one expansion, shared by all queues that hold it.

    Attributes:
        content: whatever the search needs to make a child's node.
        taken: (children,) bool, those that some queue has handed out.
    """

    content: Any
    taken: np.ndarray


@dataclass(slots=True)
class LazyQueue:
    """A priority queue of blocks of children.

    Attributes:
        heap: entries (key, tie, order, sorted keys, position, block).
        ties: insertion counter.
    """

    heap: list[tuple[float, int, np.ndarray, list[float], int, Block]] = field(default_factory=list)
    ties: count = field(default_factory=count)

    def push(self, block: Block, children: np.ndarray, keys: np.ndarray) -> None:
        """Add children of a block.

        Args:
            block: the block.
            children: (c,) int, which of its children.
            keys: (c,) their keys, the smallest coming out first; no NaN.
        """
        if len(children):
            order = np.argsort(keys, kind="stable")
            ranked = keys[order].tolist()
            heapq.heappush(self.heap, (ranked[0], next(self.ties), children[order], ranked, 0, block))

    def min_key(self) -> float:
        """Smallest key of a child that is still to be had, infinity when there is none."""
        while self.heap:
            key, tie, order, ranked, position, block = self.heap[0]
            start = position
            while position < len(ranked) and block.taken[order[position]]:
                position += 1
            if position == start:
                return key
            if position == len(ranked):
                heapq.heappop(self.heap)
            else:
                entry = (ranked[position], tie, order, ranked, position, block)
                heapq.heapreplace(self.heap, entry)
        return float("inf")

    def pop(self) -> tuple[Block, int]:
        """Take the child of smallest key; `min_key` must have been finite."""
        _, _, order, _, position, block = self.heap[0]
        child = int(order[position])
        block.taken[child] = True
        return block, child
