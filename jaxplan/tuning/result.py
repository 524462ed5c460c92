"""Results of tuning by the gradient, and the state from which it goes on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax

from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan
from jaxplan.runtime.display import shown
from jaxplan.study.text import Printed


@shown("step", "objective", "free")
@dataclass(frozen=True, kw_only=True, eq=False)
class Stop:
    """Numbers on the way of a descent.

    Attributes:
        free: parameters.
        step: of the history.
        objective: as its trajectories, which are followed, have it.
    """

    free: jax.Array
    step: int
    objective: float


@shown("history", "plans", "checkpoints", "free")
@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """State of a descent, which need not be at the numbers of its result.

    Attributes:
        asked: what the call asks for, by its arguments, as far as it can be told.
        free: parameters.
        memory: of the optimiser.
        plans: that trajectories are followed from; none to begin with.
        first: plans of the numbers to begin with, all certified.
        history: a row for each step that was made.
        checkpoints: where plans were made anew, the beginning first.
        lowest: the step with the lowest objective.
    """

    asked: Mapping[str, Any]
    free: jax.Array
    memory: Any
    plans: tuple[Plan, ...] = ()
    first: tuple[Plan, ...] = ()
    history: tuple[Mapping[str, float], ...] = ()
    checkpoints: tuple[Stop, ...] = ()
    lowest: Stop | None = None

    def expect(self, asked: Mapping[str, Any]) -> None:
        """Raise where a call that resumes asks for something else."""
        differing = [name for name, value in asked.items() if self.asked[name] != value]
        if differing:
            raise ValueError(
                f"resume is the result of another call: {', '.join(differing)} must be those of then"
            )


@shown("objective", "numbers", "message", heading="{0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Tuning(Printed):
    """Result of tuning by the gradient.

    Attributes:
        scenarios: tuned, in the order given; planned anew and certified.
        plans: of them.
        numbers: the tuned numbers by name, in the file's units: the last ones or, where those are worse or
            have no certified plans, better ones on the way to them.
        objective: of these plans; never above that of the plans to begin with.
        label: what was lowered, with its unit.
        history: a row a step: its number, the objective, the length of its gradient in the free parameters,
            and the numbers by name. Its trajectories are followed, not searched anew.
        message: what was given up, empty if all is well.
        state: of the descent, from which ``tune(resume=...)`` goes on.
    """

    scenarios: tuple[Scenario, ...]
    plans: tuple[Plan, ...]
    numbers: Mapping[str, float]
    objective: float
    history: tuple[Mapping[str, float], ...]
    label: str = "objective"
    message: str = ""
    state: Any = field(default=None, repr=False)

    @property
    def scenario(self) -> Scenario:
        """The first of them."""
        return self.scenarios[0]

    def cells(self) -> list[list[str]]:
        """Objective and numbers before and after, as rows of texts with their head."""
        first = self.history[0]
        rows = {"objective": (first["objective"], self.objective)}
        rows |= {name: (first[name], value) for name, value in self.numbers.items()}
        return [["", "before", "after"], *([name, f"{a:.6g}", f"{b:.6g}"] for name, (a, b) in rows.items())]

    @property
    def answer(self) -> int | None:
        """The step that had the tuned numbers; None where none of the history has them."""
        for row in self.history:
            if all(row.get(name) == value for name, value in self.numbers.items()):
                return int(row["step"])
        return None

    @property
    def title(self) -> str:
        """Title with the number of scenarios and steps."""
        count = len(self.scenarios)
        of = "1 scenario" if count == 1 else f"{count} scenarios"
        return f"Tuning of {of}, {len(self.history) - 1} steps"

    def lines(self) -> list[tuple[str, str]]:
        """The message, where there is one."""
        return [("", self.message)] if self.message else []
