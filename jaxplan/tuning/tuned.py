"""What a descent of `jaxplan.tuning.descent` returns, and the state from which it can be continued."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax

from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan
from jaxplan.runtime.display import shown
from jaxplan.study.result import Printed, counted


@shown("step", "objective", "free")
@dataclass(frozen=True, kw_only=True, eq=False)
class Stop:
    """A point of a descent.

    Attributes:
        free: the free parameters there.
        step: number of the step in the history.
        objective: mean objective over the followed trajectories.
    """

    free: jax.Array
    step: int
    objective: float


@shown("history", "plans", "checkpoints", "free")
@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """State of a descent, from which it can go on; its numbers need not be those of the result.

    Attributes:
        asked: the call's arguments by name, in a form that can be compared; an objective that is a function
            is None.
        free: the free parameters.
        memory: the optimizer's own state.
        plans: the plans from which trajectories are followed; empty before the first.
        first: plans for the numbers to begin with, all certified.
        history: a row for each step that was made.
        checkpoints: the points at which plans were made anew, the beginning first.
        lowest: the point with the lowest objective; None before the first step.
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
        """Raise ValueError if a call that resumes this one has other arguments."""
        differing = [name for name, value in asked.items() if self.asked[name] != value]
        if differing:
            raise ValueError(
                f"resume is the result of another call: {', '.join(differing)} must be those of then"
            )


@shown("objective", "numbers", "message", heading="{0.title}")
@dataclass(frozen=True, kw_only=True, eq=False)
class Tuning(Printed):
    """Result of tuning along the gradient.

    Attributes:
        scenarios: the tuned scenarios, in the order given, planned anew and certified.
        plans: their plans.
        numbers: the tuned numbers by name, in the file's units: the last ones or, if those are worse or have
            no certified plans, better ones on the way to them.
        objective: mean objective of these plans; never above `before`.
        before: mean objective of the plans to begin with, which are planned and certified like the tuned
            ones.
        label: name of the objective, with its unit.
        history: a row for each step: its number, the objective, the length of its gradient in the free
            parameters, and the numbers by name. Its trajectories are followed, not searched anew.
        message: what was given up; empty when there is nothing to say.
        state: state of the descent, from which ``tune(resume=...)`` goes on.
    """

    scenarios: tuple[Scenario, ...]
    plans: tuple[Plan, ...]
    numbers: Mapping[str, float]
    objective: float
    history: tuple[Mapping[str, float], ...]
    before: float = math.nan
    label: str = "objective"
    message: str = ""
    state: Any = field(default=None, repr=False)

    @property
    def scenario(self) -> Scenario:
        """The first of the tuned scenarios."""
        return self.scenarios[0]

    def cells(self) -> list[list[str]]:
        """Return objective and numbers before and after as rows of text, the first one the head."""
        first = self.history[0]
        rows = {"objective": (self.before, self.objective)}
        rows |= {name: (first[name], value) for name, value in self.numbers.items()}
        return [["", "before", "after"], *([name, f"{a:.6g}", f"{b:.6g}"] for name, (a, b) in rows.items())]

    @property
    def answer(self) -> int | None:
        """Number of the step that had the tuned numbers; None if no row of the history has them."""
        for row in self.history:
            if all(row.get(name) == value for name, value in self.numbers.items()):
                return int(row["step"])
        return None

    @property
    def title(self) -> str:
        """Title with the numbers of scenarios and steps."""
        of, steps = counted(len(self.scenarios), "scenario"), counted(len(self.history) - 1, "step")
        return f"Tuning of {of}, {steps}"

    def lines(self) -> list[tuple[str, str]]:
        """Return the message as a (label, value) row; empty without one."""
        return [("", self.message)] if self.message else []
