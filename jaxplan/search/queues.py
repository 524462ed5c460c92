"""Priority queues that take the children of an expansion as one block and open it lazily.

Pushing several hundred children onto several heaps costs more than computing them. Here each heap holds one
entry for each block, under the key of the block's best child that is left; once that child is taken, from
whichever queue, the block goes back under the key of its next best. Ties are broken by the order of
insertion, so that a search is deterministic.
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
        keys: (queues, children), the smallest taken first; +inf for a child that is taken or not valid.
    """

    content: Any
    keys: np.ndarray


@dataclass(slots=True)
class LazyQueue:
    """A priority queue of blocks of children.

    Attributes:
        row: index of this queue among the rows of the blocks' keys.
        heap: entries (key, number of insertion to break ties, child, block).
        ties: counter of insertions.
    """

    row: int
    heap: list[tuple[float, int, int, Block]] = field(default_factory=list)
    ties: count = field(default_factory=count)

    def push(self, block: Block) -> None:
        """Add the children of a block; a block without valid children is ignored."""
        best = int(block.keys[self.row].argmin())
        key = float(block.keys[self.row, best])
        if key < np.inf:
            heapq.heappush(self.heap, (key, next(self.ties), best, block))

    def min_key(self) -> float:
        """Return the smallest key of a child not taken yet, infinity if there is none.

        The child's block comes to the top of the heap.
        """
        while self.heap:
            key, tie, child, block = self.heap[0]
            keys = block.keys[self.row]
            if keys[child] == key:
                return key
            best = int(keys.argmin())  # the child has been taken
            if keys[best] == np.inf:
                heapq.heappop(self.heap)
            else:
                heapq.heapreplace(self.heap, (float(keys[best]), tie, best, block))
        return float("inf")

    def pop(self) -> tuple[Block, int]:
        """Take the child of smallest key, for all queues; return its block and its number there.

        `min_key` must have been called just before, with a finite answer.
        """
        _, _, child, block = self.heap[0]
        block.keys[:, child] = np.inf
        return block, child


@dataclass(slots=True)
class ExplorationQueue:
    """A queue that gives any child, whatever its key: type-based exploration.

    Blocks are put into buckets by their type, the cost of their parent and that of what is ahead of it. A
    bucket is drawn uniformly, then a block of it, then a child of that. When all heuristics point the same
    wrong way, this is what gets the search out.

    Attributes:
        buckets: blocks by type, the whole steps of their parent's cost and of the cost ahead of it.
    """

    buckets: dict[tuple[int, int], list[Block]] = field(default_factory=dict)

    def push(self, block: Block, kind: tuple[int, int]) -> None:
        """Add the children of a block to the bucket of type `kind`."""
        self.buckets.setdefault(kind, []).append(block)

    def pop(self, rng: np.random.Generator) -> tuple[Block, int] | None:
        """Take a random child, for all queues; return its block and number there, None if there is none."""
        while self.buckets:
            kind = list(self.buckets)[rng.integers(len(self.buckets))]
            blocks = self.buckets[kind]
            place = int(rng.integers(len(blocks)))
            block = blocks[place]
            open_children = np.flatnonzero(np.isfinite(block.keys[0]))
            if len(open_children):
                child = int(open_children[rng.integers(len(open_children))])
                block.keys[:, child] = np.inf
                return block, child
            blocks[place] = blocks[-1]
            blocks.pop()
            if not blocks:
                del self.buckets[kind]
        return None
