"""A study in a few lines: how many scenes are planned, and how quick, short and safe the plans are."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxplan.display import as_table, shown
from jaxplan.proportions import success_interval
from jaxplan.study.rows import OK, TIMES
from jaxplan.study.text import aligned

if TYPE_CHECKING:
    from jaxplan.study.result import Study

QUANTILES: Mapping[str, float] = {"least": 0.0, "5 %": 0.05, "median": 0.5, "95 %": 0.95, "most": 1.0}

# Label, column, and whether every scene counts or only those that are planned.
_QUANTITIES = (
    ("time (s), all scenes", "total_s", True),
    ("  of which search (s)", "search_s", True),
    ("expansions, all scenes", "expansions", True),
    ("path length (steps)", "length_steps", False),
    ("interior nodes", "interior_nodes", False),
    ("duration (s)", "duration_s", False),
    ("duration over its bound", "over_bound", False),
    ("smallest margin (deg)", "min_margin_deg", False),
)


@shown("done", "planned", "statuses", heading="Summary of {0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Summary:
    """A study in a few numbers.

    Attributes:
        title: which study.
        scenes: how many it has.
        done: of how many of them something is known.
        planned: of how many there is a certified plan.
        interval: 95 % Wilson interval of the success rate.
        statuses: how often each came, most frequent first.
        spreads: of each quantity the number of its values, their mean and their `QUANTILES`, by label.
    """

    title: str
    scenes: int
    done: int
    planned: int
    interval: tuple[float, float]
    statuses: Mapping[str, int]
    spreads: Mapping[str, Mapping[str, float]]

    @property
    def success_rate(self) -> float | None:
        """Share of the scenes done that have a certified plan; None where none is done."""
        return self.planned / self.done if self.done else None

    def record(self) -> dict[str, Any]:
        """The summary for machines."""
        return {
            "title": self.title,
            "scenes": self.scenes,
            "done": self.done,
            "planned": self.planned,
            "success_rate": self.success_rate,
            "success_95_percent": list(self.interval),
            "statuses": dict(self.statuses),
            "spreads": {label.strip(): dict(spread) for label, spread in self.spreads.items()},
        }

    def lines(self) -> list[tuple[str, str]]:
        """What stands above the quantiles, as (label, value)."""
        low, high = (100 * bound for bound in self.interval)
        rate = "-" if self.success_rate is None else f"{100 * self.success_rate:.2f} %"
        done = f"{self.done}" if self.done == self.scenes else f"{self.done} done of {self.scenes}"
        return [
            ("scenes", done),
            ("planned, certified", f"{self.planned}: {rate}, 95 % interval {low:.2f} to {high:.2f} %"),
            ("status", ", ".join(f"{count} {name}" for name, count in self.statuses.items()) or "-"),
        ]

    def cells(self) -> list[list[str]]:
        """The quantiles as rows of texts, with their head."""
        head = ["", "values", "mean", *QUANTILES]
        rows = [
            [label, f"{spread['values']:.0f}", *(f"{spread[name]:.4g}" for name in head[2:])]
            for label, spread in self.spreads.items()
        ]
        return [head, *rows]

    def __str__(self) -> str:
        return aligned(self.title, self.lines(), self.cells())

    def _repr_html_(self) -> str:
        return as_table(self.title, self.lines(), self.cells())


def summarise(study: "Study") -> Summary:
    """See `Study.summary`."""
    table = study.table
    planned = sum(row["status"] == OK for row in table)
    values = {column: column_values(study, column, every) for _, column, every in _QUANTITIES}
    return Summary(
        title=f"Study of {study.title}",
        scenes=study.scenes,
        done=len(table),
        planned=planned,
        interval=success_interval(planned, len(table)),
        statuses=dict(Counter(row["status"] for row in table).most_common()),
        spreads={label: _spread(values[column]) for label, column, _ in _QUANTITIES if len(values[column])},
    )


def column_values(study: "Study", column: str, every: bool) -> np.ndarray:
    """The values of a column, of all scenes that have one or of those that are planned.

    Args:
        study: any.
        column: of its table or its times, or "over_bound" for a duration over the least that the goal allows.
        every: whether scenes without a plan count.
    """
    chosen = [row for row in study.table if every or row["status"] == OK]
    if column == "over_bound":
        bounds = ((row["duration_s"], row["duration_bound_s"]) for row in chosen)
        return np.array([duration / bound for duration, bound in bounds if duration and bound])
    if column in TIMES:  # of which rows may be missing
        scenes = {row["scene"] for row in chosen}
        chosen = [row for row in study.timings if row["scene"] in scenes]
    return np.array([row[column] for row in chosen if row[column] is not None], dtype=float)


def _spread(values: np.ndarray) -> dict[str, float]:
    spread = {"values": float(len(values)), "mean": float(np.mean(values))}
    return spread | {name: float(np.quantile(values, share)) for name, share in QUANTILES.items()}
