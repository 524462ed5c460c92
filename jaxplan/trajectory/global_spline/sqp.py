"""Sequential quadratic programming for one curve, with the duration given or as short as possible.

    minimise   energy(c) / energy_0          or          T / T_0 + small * energy(c) / energy_0

subject to limits, zones and tubes (`families`), each elastic with an exact penalty, so that every program has
an answer. Steps that do not lower the merit (objective and penalties at the true curve) are damped.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.trajectory.global_spline.curve_space import CurveSpace
from jaxplan.trajectory.global_spline.families import families
from jaxplan.trajectory.global_spline.linear_rows import Tube
from jaxplan.trajectory.global_spline.motion import Motion, evaluate
from jaxplan.trajectory.global_spline.problem import Problem
from jaxplan.trajectory.global_spline.program import Quadratic, propose
from jaxplan.trajectory.global_spline.rows import LIMIT, TUBE, ZONE, Family

_MOST_STEPS = 16
_DEARER, _GROWTH = 1, 30.0  # how often the penalties grow where something stays broken, and by what
_SMALL = 1e-3  # weight of the energy beside the duration
_HASTE = 12.0  # of the duration: alone it would fall by 1 / 12 in a step
_SETTLED = 1e-4  # of the merit, between steps
_BROKEN = 1e-6  # what is left of a row's violation, beyond which it counts as broken
_DAMPING = 8.0
_FIRST_DAMPING = 1e-2
_NO_DAMPING = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """A curve with its duration, and all that is known of it.

    Attributes:
        coefficients: (n, A).
        duration: s.
        motion: at the places of the search.
        violations: by kind of row, the largest; zero or less where none is broken.
    """

    coefficients: np.ndarray
    duration: float
    motion: Motion
    violations: dict[int, float]

    @property
    def is_sound(self) -> bool:
        """Whether nothing is broken."""
        return all(broken <= _BROKEN for broken in self.violations.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A fit.

    Attributes:
        problem: chart, limits and zones.
        space: the curves.
        places: (S,) where loads and margins are looked at.
        rows: (4, S, n) of the basis there.
        wanted: (D, Z) rad, margins to keep.
        tube: about the nodes, or None.
        limited: whether limits of rates and loads are kept, or time will be stretched to them.
        weights: of the energy.
        free_time: whether the duration is looked for as well.
    """

    problem: Problem
    space: CurveSpace
    places: np.ndarray
    rows: np.ndarray
    wanted: np.ndarray
    tube: Tube | None
    limited: bool
    weights: tuple[float, float, float]
    free_time: bool

    def point(self, coefficients: np.ndarray, duration: float) -> Point:
        """A curve with all known of it; with free time and rest at both ends, in the time that it needs."""
        motion = evaluate(self.problem, self.places, self.rows @ coefficients)
        craft = self.problem.spacecraft
        found = {ZONE: float(np.max(self.wanted - motion.margins, initial=-np.inf)), TUBE: -np.inf}
        found[LIMIT] = float(np.max(np.abs(motion.curves[0, :, 3:]) - craft.joint_limits, initial=-np.inf))
        if self.limited:
            needed = needed_duration(self.problem, motion)
            if self.free_time and not np.any(self.space.by_time):
                duration = needed
            found[LIMIT] = max(found[LIMIT], needed / duration - 1)
        if self.tube is not None:
            found[TUBE] = float(np.max(self.tube.off(coefficients), initial=-np.inf))
        if not motion.is_finite():
            found[LIMIT] = np.inf
        return Point(coefficients=coefficients, duration=duration, motion=motion, violations=found)

    def rows_at(self, point: Point) -> list[Family]:
        """All rows at a point."""
        return list(
            families(
                self.problem,
                self.space.basis,
                self.rows,
                point.motion,
                point.coefficients,
                point.duration,
                wanted=self.wanted,
                tube=self.tube,
                limited=self.limited,
            )
        )


def needed_duration(problem: Problem, motion: Motion) -> float:
    """The shortest duration in which a motion keeps all limits of rates and loads at its places, s."""
    craft = problem.spacecraft
    found = [
        np.max(np.abs(motion.loads[:, q]) / limit) ** (1 / power)
        for q, (limit, power) in enumerate(zip(problem.limits, problem.powers, strict=True))
    ]
    for power, limit in enumerate((craft.joint_rate_limits, craft.joint_acceleration_limits), start=1):
        found.append(np.max(np.abs(motion.curves[power, :, 3:]) / limit, initial=0) ** (1 / power))
    return float(np.max(found))


def penalties(free_time: bool) -> np.ndarray:
    """By kind of row, larger than any multiplier of a problem that has a solution."""
    table = {LIMIT: 1e1, ZONE: 2e1, TUBE: 1e1} if free_time else {LIMIT: 1e3, ZONE: 1e3, TUBE: 1e2}
    return np.array([table[kind] for kind in range(len(table))])


def improve(task: Task, start: Point, *, until: float = 0.0) -> Point:
    """Step from a curve to the best one near it.

    Args:
        task: what is looked for.
        start: where to begin.
        until: s, a duration that is short enough.

    Returns:
        The point of the lowest merit; broken rows show in its violations.
    """
    penalty = penalties(task.free_time)
    objective = Objective(task, start)
    at, value, damping, failed = start, objective.merit(start, penalty), 0.0, False
    held: dict[str, np.ndarray] = {}
    dearer = 0
    for _ in range(_MOST_STEPS):
        proposal = propose(objective.quadratic(at, damping), task.rows_at(at), penalty, held)
        held = proposal.multipliers
        step = proposal.step
        ahead = task.point(at.coefficients + step.coefficients, at.duration * (1 + step.stretch))
        ahead_value = objective.merit(ahead, penalty)
        close = abs(value - ahead_value) <= _SETTLED * value
        if ahead_value < value:
            at, value = ahead, ahead_value
            if not failed:
                damping = damping / _DAMPING if damping > _NO_DAMPING else 0.0
            failed = False
            close |= proposal.exact and not task.free_time and damping == 0
            if at.duration <= until:
                break
        else:
            damping, failed = max(_DAMPING * damping, _FIRST_DAMPING), True
        if close and (at.is_sound or dearer == _DEARER):
            break
        if close:
            dearer += 1
            penalty = _GROWTH * penalty
            value, damping = objective.merit(at, penalty), 0.0
    return at


class Objective:
    """Energy, or duration with a little of the energy, both as shares of the first curve's."""

    def __init__(self, task: Task, start: Point) -> None:
        self._task, self._duration = task, start.duration
        self.share = 1.0
        self.share = self._energy(start)

    def _form(self, duration: float) -> np.ndarray:
        return self._task.space.energy(duration, self._task.weights) / self.share

    def _energy(self, point: Point) -> float:
        form = self._form(point.duration)
        return float(np.sum(point.coefficients * (form @ point.coefficients))) / 2

    def merit(self, point: Point, penalty: np.ndarray) -> float:
        """Objective and penalties."""
        value = self._energy(point)
        if self._task.free_time:
            value = _SMALL * value + point.duration / self._duration
        broken = sum(penalty[kind] * max(0.0, most) for kind, most in point.violations.items())
        return float(value + broken)

    def quadratic(self, point: Point, damping: float) -> Quadratic:
        """The objective about a point, where the duration counts as a share of its own."""
        task = self._task
        form = self._form(point.duration) * (_SMALL if task.free_time else 1.0)
        return Quadratic(
            free=task.space.free,
            by_time=point.duration * task.space.by_time,
            hessian=form + damping * task.space.energies[0],
            gradient=form @ point.coefficients,
            haste=_HASTE if task.free_time else None,
            rows=task.rows,
        )
