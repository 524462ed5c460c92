"""Nodes are put closer while the motion between them breaks what they keep."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxplan.timeline import tracking
from jaxplan.timeline.least_energy import Nodes, Wanted
from jaxplan.timeline.tracking import Tracked


def motion(count, broken=0.0, between=0.0, too_quick=0.0):
    """A motion of a minute that stands still, with so many intervals, and what it breaks."""
    times = np.linspace(100.0, 160.0, count + 1)

    def sample(times):
        return SimpleNamespace(attitude=np.broadcast_to(np.eye(3), (len(times), 3, 3)))

    return Tracked(
        trajectory=SimpleNamespace(duration=60.0, sample=sample),
        nodes=Nodes(times=times, attitudes=sample(times).attitude, joints=np.zeros((count + 1, 0))),
        broken=np.full(count + 1, broken),
        between=between,
        too_quick=too_quick,
        wanted=Wanted(attitude=None, joints=np.zeros(0), slew_time=1.0),
    )


@pytest.mark.parametrize(
    ("first", "depths", "counts"),
    [
        ({}, [], []),
        ({"broken": 0.1, "between": 0.2}, [], []),
        ({"between": 0.2}, [0.1, 0.05, 0.0], [24, 48, 96]),
        ({"too_quick": 0.2}, [0.1, 0.0], [24, 48]),
        ({"between": 0.2}, [0.1, 0.1], [24, 48]),
        ({"between": 0.2}, [0.2], [24]),
        ({"between": 0.2}, [0.15, 0.1, 0.05, 0.04], [24, 48, 96, 192]),
    ],
    ids=[
        "all kept",
        "nodes break",
        "until kept",
        "rates",
        "no better",
        "not once better",
        "as many as may be",
    ],
)
def test_nodes_are_put_closer_as_long_as_it_helps(monkeypatch, first, depths, counts):
    asked, left = [], list(depths)

    def found(search, times, guess, tolerance):
        assert times[[0, -1]].tolist() == [100.0, 160.0]
        assert len(guess) == len(times)
        asked.append(len(times) - 1)
        return motion(asked[-1], between=left.pop(0))

    monkeypatch.setattr(tracking, "_solve_from_guess", found)
    begun = motion(12, **first)
    answer = tracking._refine_nodes(None, begun, 1e-4)
    assert asked == counts
    least = min([max(begun.between, begun.too_quick), *depths])
    assert answer.depth[1] == (least if counts else max(begun.between, begun.too_quick))
