"""What the comparison of planners draws: the results of one planner, and how they look.

A planner has one colour in all panels, that of its place among the planners of step 2, whichever of them are
compared. Results that are only known from print are grey.
"""

from typing import Protocol

import numpy as np

from jaxplan.plotting.style import COLOURS, GREY
from jaxplan.search import PLANNERS


class Compared(Protocol):
    """What one planner did on the scenes of one kind, such as a `jaxplan.table4.Row`.

    Attributes:
        kind: of the scenes.
        planner: its name.
        scenes: how many there were.
        found: in how many of them it found a path.
        clear: in how many of them the path is clear; None where nobody knows.
        solved: (scenes,) bool, in which of them that is so; None for printed results.
        seconds: (scenes,) of each search; of printed results (3,) least, largest, mean.
        nodes: (clear,) interior nodes of the clear paths; of printed results likewise.
        steps: (clear,) their lengths in steps; None for printed results.
    """

    @property
    def kind(self) -> str: ...  # noqa: D102

    @property
    def planner(self) -> str: ...  # noqa: D102

    @property
    def scenes(self) -> int: ...  # noqa: D102

    @property
    def found(self) -> int: ...  # noqa: D102

    @property
    def clear(self) -> int | None: ...  # noqa: D102

    @property
    def solved(self) -> np.ndarray | None: ...  # noqa: D102

    @property
    def seconds(self) -> np.ndarray: ...  # noqa: D102

    @property
    def nodes(self) -> np.ndarray: ...  # noqa: D102

    @property
    def steps(self) -> np.ndarray | None: ...  # noqa: D102

    def interval(self, successes: int) -> tuple[float, float]:
        """Bounds of a success rate in these scenes."""


def is_printed(row: Compared) -> bool:
    """Whether a row is only known from print: spreads instead of a value for each scene."""
    return row.solved is None


def colour(row: Compared) -> str:
    """Of a row in all panels."""
    return planner_colour(row.planner)


def planner_colour(name: str) -> str:
    """Of a planner in all figures; grey for one that is not ours."""
    names = tuple(PLANNERS)
    return COLOURS[names.index(name) % len(COLOURS)] if name in names else GREY
