"""The record of a plan: everything that planning found, from goal to certificate, and how it is displayed."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from jaxplan.certificate import Certificate
from jaxplan.model.duration_bound import DurationBound, duration_bound, excess
from jaxplan.model.goals import GivenState
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario, moves
from jaxplan.model.status import Status
from jaxplan.planner.files import read_plan, save_plan
from jaxplan.runtime.display import aligned, as_table, shown
from jaxplan.search import SearchResult
from jaxplan.trajectory import Trajectory


def end_rates(scenario: Scenario, goal: Goal) -> tuple[np.ndarray, np.ndarray]:
    """Return the rates with which a manoeuvre must end, as the scenario or its moving goal gives them.

    Args:
        scenario: the problem; where its goal does not move, its own end rates are returned.
        goal: where the manoeuvre ends; if it moves and has no rates, which is never certified, they are zero.

    Returns:
        Angular velocity (3,) rad/s in body axes, and joint rates (2n + d,) rad/s of n terminals, d drives.
    """
    if not scenario.goal.moves:
        return scenario.goal.angular_velocity, scenario.goal.joint_rates
    if goal.angular_velocity is None or goal.joint_rates is None:
        return np.zeros(3), np.zeros(len(goal.joints))  # such a goal is never certified
    return goal.angular_velocity, goal.joint_rates


def report_summary(report: Certificate | None) -> dict[str, Any]:
    """Return a certificate as a dict in the units of files; for None the same keys with None values."""
    found = Certificate(certified=False, faults=()) if report is None else report
    margin = found.min_margin
    summary = {
        "certified": found.certified,
        "faults": list(found.faults),
        "min_margin_deg": None if margin is None else float(np.rad2deg(margin)),
        "worst_device": found.worst_device,
        "worst_zone": found.worst_zone,
        "worst_time_s": found.worst_time,
        "peaks": dict(found.peaks),
        "peak_times_s": dict(found.peak_times),
    }
    return dict.fromkeys(summary) if report is None else summary


@shown(
    "status",
    "message",
    "goal.slew_angle deg",
    "search.expansions",
    "path.edges",
    "trajectory.duration s",
    "certificate.min_margin deg",
    heading="Plan of {0.scenario.name}",
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """The answer to a scenario. If planning failed, the fields of the steps after the failing one are None.

    Attributes:
        scenario: what was asked.
        status: how planning ended.
        message: for the user, what happened and what to change; empty when there is nothing to say.
        goal: the state in which the manoeuvre ends; with a time and end rates where something moves.
        search: the result of the path search, step 2.
        path: the nodes that the trajectory passes.
        trajectory: the manoeuvre as a function of time.
        certificate: what is proved of the trajectory; `report` is another name for it.
        timings: computation times, s: of each step without compiling, then "compile" and "total". They are
            the one part of a plan that is not deterministic.
    """

    scenario: Scenario
    status: Status
    message: str = ""
    goal: Goal | None = None
    search: SearchResult | None = None
    path: Path | None = None
    trajectory: Trajectory | None = None
    certificate: Certificate | None = None
    timings: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether this is a certified plan."""
        return self.status is Status.OK

    @property
    def report(self) -> Certificate | None:
        """The certificate, under its older name."""
        return self.certificate

    @property
    def goal_chosen(self) -> bool:
        """Whether step 1 chose the goal, as for targets; another attitude might then be reached sooner."""
        return not isinstance(self.scenario.goal, GivenState)

    @property
    def duration_bound(self) -> float | None:
        """Strict lower bound of the duration of a motion to this goal, s; None without a path.

        It follows from the limits that `duration_bound_name` names: rates, accelerations, torque and momentum
        of the platform, or rate and acceleration of a joint. Zones are left out of account. The bound holds
        for this goal alone, not for others that meet the same targets (`goal_chosen`). With the criterion
        "least_time", step 1 puts the goal with the least bound that its descents found first; unless zones
        made another goal quicker to reach, this is then the bound for all goals.
        """
        return None if self._bound is None else self._bound.seconds

    @property
    def duration_bound_name(self) -> str | None:
        """Name of the part whose limits set `duration_bound`, such as "terminal-1 yaw"; None without it."""
        return None if self._bound is None else self._bound.name

    @property
    def explained(self) -> float | None:
        """`duration_bound` as a fraction of the duration; None without a trajectory, or if nothing moves.

        It is at most 1 where the trajectory keeps the limits.
        """
        if self.trajectory is None or self._bound is None or not self.trajectory.duration:
            return None
        return self._bound.seconds / self.trajectory.duration

    @cached_property
    def _bound(self) -> DurationBound | None:
        """Lower bound of the duration between the path's ends, with its name; None without a path or goal."""
        if self.path is None or self.goal is None:
            return None
        start, goal_rates, ends = self.scenario.start, end_rates(self.scenario, self.goal), [0, -1]
        return duration_bound(
            self.scenario.usable,
            self.path.attitudes[ends],
            self.path.joints[ends],
            np.stack([start.angular_velocity, goal_rates[0]]),
            np.stack([start.joint_rates, goal_rates[1]]),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plan to a JSON file, see `jaxplan.planner.save_plan`."""
        save_plan(self, path)

    def rows(self) -> list[tuple[str, str]]:
        """Return the plan as (label, value) rows for a table, without the computation times."""
        rows = [("status", self.status.name)]
        if self.message:
            rows.append(("", self.message))
        if self.goal is not None:
            tense = "met" if self.ok else "looked for"
            when = f", {tense} at {self.goal.time:.2f} s" if moves(self.scenario) else ""
            rows.append(("goal slew", f"{np.rad2deg(self.goal.slew_angle):.2f} deg{when}"))
        if self.search is not None:
            count = self.search.expansions
            said = "1 expansion" if count == 1 else f"{count} expansions"
            rows.append(("search", f"{self.scenario.search.method}, {said}"))
        if self.path is not None:
            edges = self.path.edges
            interior = max(edges - 1, 0)
            rows.append(("path", f"{self.path.length:.2f} steps, {edges} edges, {interior} interior nodes"))
        if self.trajectory is not None:
            duration, bound = self.trajectory.duration, self.duration_bound
            text = f"{self.trajectory.method}, {duration:.2f} s, C{self.trajectory.smoothness}"
            above = None if bound is None else excess(duration, bound)
            if above is not None:
                how = f"{100 * above:.1f} % above" if above >= 0 else "less than"  # where limits are not kept
                text += f"; {how} the strict bound of {bound:.2f} s"
                text += " for this goal" if self.goal_chosen else ""
            rows.append(("trajectory", text))
            if above is not None:
                rows.append(("bound", f"by {self.duration_bound_name}, without zones"))
        if self.scenario.robust is not None:
            rows.append(("bears", f"{self.scenario.robust.told}; margins are what is left"))
        if self.certificate is not None:
            rows += self.certificate.rows()
        return rows

    def summary(self) -> dict[str, Any]:
        """Return the plan as a dict of plain values in the units of files, computation times included."""
        trajectory = self.trajectory
        return {
            "name": self.scenario.name,
            "status": self.status.name,
            "message": self.message,
            "slew_deg": None if self.goal is None else float(np.rad2deg(self.goal.slew_angle)),
            "expansions": None if self.search is None else self.search.expansions,
            "length_steps": None if self.path is None else self.path.length,
            "edges": None if self.path is None else self.path.edges,
            "duration_s": None if trajectory is None else trajectory.duration,
            "duration_bound_s": self.duration_bound,
            "duration_bound_name": self.duration_bound_name,
            "explained": self.explained,
            "goal_chosen": self.goal_chosen,
            **report_summary(self.certificate),
            "timings_s": dict(self.timings),
        }

    def __str__(self) -> str:
        lines = [f"Plan of {self.scenario.name}"]
        lines += [f"  {line}" for line in aligned(self.rows())]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return as_table(f"Plan of {self.scenario.name}", self.rows())


def load_plan(path: str | os.PathLike[str]) -> Plan:
    """Read a plan from a file that `save_plan` wrote.

    Args:
        path: the JSON file; computation times are read too if their file stands beside it.

    Raises:
        PlanFileError: if the file is missing, too large, not JSON, or not a plan.
    """
    return Plan(**read_plan(path))


class PlanningError(Exception):
    """Raised by `plan` where no certified plan was found.

    Attributes:
        plan: what was found before planning failed.
        status: why it failed.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, self.status = plan, plan.status
        super().__init__(plan)  # what a copy in another process is made from

    def __str__(self) -> str:
        return f"{self.status.name}: {self.status.value}. {self.plan.message}".strip()
