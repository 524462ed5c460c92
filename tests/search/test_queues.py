import numpy as np

from jaxplan.search.queues import Block, ExplorationQueue, LazyQueue


def drain(queue: LazyQueue) -> list[tuple[object, int]]:
    out = []
    while np.isfinite(queue.min_key()):
        block, child = queue.pop()
        out.append((block.content, child))
    return out


def test_children_come_out_by_key_across_blocks():
    rng = np.random.default_rng(0)
    queue, expected = LazyQueue(0), []
    for name in range(20):
        keys = rng.uniform(size=rng.integers(1, 50))
        queue.push(Block(name, keys[None].copy()))
        expected += [(key, name, child) for child, key in enumerate(keys)]
    assert drain(queue) == [(name, child) for _, name, child in sorted(expected)]


def test_ties_come_out_in_the_order_of_insertion():
    queue = LazyQueue(0)
    for name in range(3):
        queue.push(Block(name, np.zeros((1, 2))))
    assert drain(queue) == [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)]


def test_a_child_taken_from_one_queue_leaves_the_others():
    first, second = LazyQueue(0), LazyQueue(1)
    block = Block("b", np.array([[0.0, 1.0, 2.0], [2.0, 1.0, 0.0]]))
    first.push(block)
    second.push(block)
    assert first.min_key() == 0.0
    assert first.pop() == (block, 0)
    assert second.min_key() == 0.0
    assert second.pop() == (block, 2)
    assert first.min_key() == 1.0
    assert second.min_key() == 1.0
    first.pop()
    assert first.min_key() == second.min_key() == np.inf


def test_children_of_infinite_key_do_not_come_out():
    queue = LazyQueue(0)
    queue.push(Block("b", np.array([[np.inf, 1.0, np.inf, 0.5]])))
    queue.push(Block("closed", np.full((1, 3), np.inf)))
    assert drain(queue) == [("b", 3), ("b", 1)]


def test_exploration_takes_every_open_child_once_and_types_alike():
    rng = np.random.default_rng(1)
    queue, key_queue = ExplorationQueue(), LazyQueue(0)
    blocks = [Block(name, np.ones((1, 50))) for name in ("a", "b")] + [Block("c", np.full((1, 50), np.inf))]
    blocks[0].keys[0, 7] = np.inf
    for block, kind in zip(blocks, ((0, 1), (2, 3), (2, 3)), strict=True):
        queue.push(block, kind)
        key_queue.push(block)
    first = [queue.pop(rng)[0].content for _ in range(60)]
    assert 15 <= first.count("a") <= 45, "a type has its turn however many children it has"
    rest = []
    while (drawn := queue.pop(rng)) is not None:
        rest.append(drawn[0].content)
    assert len(first) + len(rest) == 99
    assert key_queue.min_key() == np.inf
