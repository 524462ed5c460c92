"""The rows of Table 4: what one planner did on the scenes of one kind, and what the paper printed."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.display import shown
from jaxplan.proportions import success_interval

PAPER_KINDS = ("keep_out", "keep_in")


@shown("kind", "planner", "scenes", "found", "clear", "seconds s", "nodes", "steps")
@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """What one planner did on the scenes of one kind.

    Attributes:
        kind: of the scenes.
        planner: its name in `PLANNERS`, or the paper's.
        scenes: how many were tried, those proved infeasible left out.
        found: in how many of them it found a path.
        clear: in how many of them no edge of the path breaks a zone; None where nobody knows.
        solved: (scenes,) bool, in which of them that is so; None for the paper.
        seconds: (scenes,) each search took, successful or not; for the paper (3,) least, largest, mean.
        nodes: (clear,) interior nodes; for the paper (3,) likewise.
        steps: (clear,) length in steps; None for the paper.
    """

    kind: str
    planner: str
    scenes: int
    found: int
    clear: int | None
    solved: np.ndarray | None
    seconds: np.ndarray
    nodes: np.ndarray
    steps: np.ndarray | None

    def interval(self, successes: int) -> tuple[float, float]:
        """95 % Wilson interval of a success rate in these scenes."""
        return success_interval(successes, self.scenes)

    def summary(self) -> dict[str, Any]:
        """The row for machines: least, largest and mean of times (s) and lengths."""
        printed = self.steps is None
        return {
            "kind": self.kind,
            "planner": self.planner,
            "scenes": self.scenes,
            "found": self.found,
            "clear": self.clear,
            "found_95_percent": self.interval(self.found),
            "clear_95_percent": None if self.clear is None else self.interval(self.clear),
            "seconds": spread(self.seconds, printed),
            "interior_nodes": spread(self.nodes, printed),
            "steps": None if self.steps is None else spread(self.steps, False),
        }


def _printed(kind: str, planner: str, found: int, seconds: Sequence[float], nodes: Sequence[float]) -> Row:
    return Row(
        kind=kind,
        planner=planner,
        scenes=20,
        found=found,
        clear=None,
        solved=None,
        seconds=np.array(seconds),
        nodes=np.array(nodes),
        steps=None,
    )


# As printed, from other scenes of the same description, on another machine.
PAPER = (
    _printed("keep_out", "paper's MHA*", 19, (0.1, 0.7, 0.3), (15, 49, 27.6)),
    _printed("keep_out", "paper's WA*", 15, (0.1, 0.6, 0.2), (17, 42, 26.6)),
    _printed("keep_out", "paper's RRT*", 15, (1.5, 25.6, 6.0), (13, 26, 20.5)),
    _printed("keep_in", "paper's MHA*", 19, (0.2, 0.5, 0.2), (11, 38, 24.4)),
    _printed("keep_in", "paper's WA*", 18, (0.1, 1.7, 0.3), (13, 38, 24.2)),
    _printed("keep_in", "paper's RRT*", 17, (0.7, 13.1, 3.2), (11, 28, 16.8)),
)


def printed_rows(kinds: Iterable[str]) -> tuple[Row, ...]:
    """The paper's rows of some kinds of scenes; it has none of most."""
    wanted = set(kinds)
    return tuple(row for row in PAPER if row.kind in wanted)


def spread(values: np.ndarray, printed: bool) -> tuple[float, float, float] | None:
    """Least, largest and mean; of the paper's rows they are given. None of nothing."""
    if not len(values):
        return None
    if printed:
        return float(values[0]), float(values[1]), float(values[2])
    return float(np.min(values)), float(np.max(values)), float(np.mean(values))
