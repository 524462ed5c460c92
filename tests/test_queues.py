import numpy as np

from jaxplan.search.queues import Block, LazyQueue


def drain(queue: LazyQueue) -> list[tuple[object, int]]:
    out = []
    while np.isfinite(queue.min_key()):
        block, child = queue.pop()
        out.append((block.content, child))
    return out


def test_children_come_out_by_key_across_blocks():
    rng = np.random.default_rng(0)
    queue, expected = LazyQueue(), []
    for name in range(20):
        keys = rng.uniform(size=rng.integers(0, 50))
        queue.push(Block(name, np.zeros(len(keys), dtype=bool)), np.arange(len(keys)), keys)
        expected += [(key, name, child) for child, key in enumerate(keys)]
    assert drain(queue) == [(name, child) for _, name, child in sorted(expected)]


def test_ties_come_out_in_the_order_of_insertion():
    queue = LazyQueue()
    for name in range(3):
        queue.push(Block(name, np.zeros(2, dtype=bool)), np.arange(2), np.zeros(2))
    assert drain(queue) == [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)]


def test_a_child_taken_from_one_queue_leaves_the_others():
    first, second = LazyQueue(), LazyQueue()
    block = Block("b", np.zeros(3, dtype=bool))
    first.push(block, np.arange(3), np.array([0.0, 1.0, 2.0]))
    second.push(block, np.arange(3), np.array([2.0, 1.0, 0.0]))
    assert first.min_key() == 0.0
    assert first.pop() == (block, 0)
    assert second.min_key() == 0.0
    assert second.pop() == (block, 2)
    assert first.min_key() == 1.0
    assert second.min_key() == 1.0
    first.pop()
    assert first.min_key() == second.min_key() == np.inf


def test_only_the_children_that_were_pushed_come_out():
    queue = LazyQueue()
    queue.push(Block("b", np.zeros(9, dtype=bool)), np.array([7, 3]), np.array([1.0, 0.5]))
    queue.push(Block("empty", np.zeros(9, dtype=bool)), np.array([], dtype=int), np.array([]))
    assert drain(queue) == [("b", 3), ("b", 7)]
