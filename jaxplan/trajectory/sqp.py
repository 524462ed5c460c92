"""Sequential quadratic programming for curves, with the duration given or as short as possible.

    minimise   energy(c) / energy_0          or          T / T_0 + small * energy(c) / energy_0

subject to limits, zones and tubes (`constraint_blocks`), each elastic with an exact penalty, so that every
program has an answer. Steps that do not lower the merit (objective and penalties at the true curve) are
damped. Alike problems are worked on together, each until it is done.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np

from jaxplan.runtime.batching import in_groups
from jaxplan.trajectory import options
from jaxplan.trajectory.constraints import constraint_blocks
from jaxplan.trajectory.iterates import LIMIT, TUBE, ZONE, Iterates, SQPSolution, Stack
from jaxplan.trajectory.problem import DiscreteProblem
from jaxplan.trajectory.program import Multipliers, QuadraticProgram, decrease_bound, solve
from jaxplan.trajectory.splines import weighted


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialGuess:
    """A curve from which the best one near it is looked for.

    Attributes:
        discrete: the problem.
        coefficients: (n, A) of the curve.
        duration: s.
        target_duration: s, at which the search ends, since it is short enough.
        max_violation: the curve is returned as it is if it breaks a limit by more than this share.
        ftol: relative decrease below which the search ends: of sound curves in a given time the decrease that
            the next program promises, else the change of the merit.
    """

    discrete: DiscreteProblem
    coefficients: np.ndarray
    duration: float
    target_duration: float = 0.0
    max_violation: float = np.inf
    ftol: float = field(default_factory=lambda: options.SQP.ftol)


def improve(begins: Sequence[InitialGuess]) -> list[SQPSolution]:
    """Step from curves to the best ones near them.

    Args:
        begins: where to begin, and with what.

    Returns:
        For each the curve of the lowest merit; broken rows show in its violations.
    """
    return in_groups(begins, lambda begin: begin.discrete.kind, _improved, most=options.SQP.together)


def penalties(free_time: bool) -> np.ndarray:
    """Penalties by kind of row, larger than any multiplier of a problem that has a solution."""
    table = {LIMIT: 1e1, ZONE: 2e1, TUBE: 1e1} if free_time else {LIMIT: 1e3, ZONE: 1e3, TUBE: 1e2}
    return np.array([table[kind] for kind in range(len(table))])


class Objective:
    """Energy, or duration with a little of the energy, both as shares of the first curve's, of a stack."""

    def __init__(self, stack: Stack, start: Iterates) -> None:
        self._stack, self._duration = stack, start.duration
        self.share = np.ones(len(start.duration))
        self.share = self.energy(start)

    @property
    def _free_time(self) -> bool:
        return self._stack.members[0].free_time

    def some(self, stack: Stack, which: np.ndarray) -> "Objective":
        """The objective of some members, (G,) bool, whose stack is given."""
        found = copy(self)
        found._stack, found._duration, found.share = stack, self._duration[which], self.share[which]
        return found

    def _form(self, duration: np.ndarray) -> np.ndarray:
        """(G, n, n), `weighted` as shares of the first curves'."""
        form = weighted(self._stack.energies, duration, self._stack.weights)
        return np.asarray(form / self.share[:, None, None])

    def energy(self, at: Iterates) -> np.ndarray:
        """Energies (G,) as shares of the first curves'."""
        product = at.coefficients * (self._form(at.duration) @ at.coefficients)
        return np.asarray(np.sum(product.reshape(len(product), -1), axis=1) / 2)

    def merit(self, at: Iterates, penalty: np.ndarray) -> np.ndarray:
        """Objectives and penalties (G, 3) by kind of row: (G,)."""
        value = self.energy(at)
        if self._free_time:
            value = options.SQP.energy_weight * value + at.duration / self._duration
        broken = penalty * np.maximum(at.violations, 0.0)
        return np.asarray(value + (broken[:, LIMIT] + broken[:, ZONE] + broken[:, TUBE]))

    def program(self, at: Iterates, damping: np.ndarray, penalty: np.ndarray) -> QuadraticProgram:
        """The programs at curves, where the duration counts as a share of its own."""
        stack = self._stack
        form = self._form(at.duration) * (options.SQP.energy_weight if self._free_time else 1.0)
        return QuadraticProgram(
            free=stack.free,
            by_time=at.duration[:, None, None] * stack.by_time,
            hessian=form + damping[:, None, None] * stack.energies[:, 0],
            gradient=form @ at.coefficients,
            duration_hessian=options.SQP.duration_hessian if self._free_time else None,
            rows=stack.rows,
            blocks=list(constraint_blocks(stack, at)),
            penalty=penalty,
        )


@dataclass(kw_only=True, eq=False)
class SQPState:
    """The members of a stack that are not done, and how far they are; all arrays are (G,) or (G, ...)."""

    stack: Stack
    objective: Objective
    at: Iterates
    number: np.ndarray
    target_duration: np.ndarray
    ftol: np.ndarray
    penalty: np.ndarray
    value: np.ndarray
    damping: np.ndarray
    failed: np.ndarray
    penalty_updates: np.ndarray
    falling: np.ndarray
    multipliers: Multipliers

    @classmethod
    def of(cls, begins: Sequence[InitialGuess]) -> "SQPState":
        """The state at first curves of alike problems."""
        stack, count = Stack.of([begin.discrete for begin in begins]), len(begins)
        at = stack.iterates(
            np.stack([begin.coefficients for begin in begins]),
            np.array([begin.duration for begin in begins]),
        )
        objective = Objective(stack, at)
        penalty = np.tile(penalties(stack.members[0].free_time), (count, 1))
        return cls(
            stack=stack,
            objective=objective,
            at=at,
            number=np.arange(count),
            target_duration=np.array([begin.target_duration for begin in begins]),
            ftol=np.array([begin.ftol for begin in begins]),
            penalty=penalty,
            value=objective.merit(at, penalty),
            damping=np.zeros(count),
            failed=np.zeros(count, dtype=int),
            penalty_updates=np.zeros(count, dtype=int),
            falling=np.zeros(count, dtype=bool),
            multipliers={},
        )

    def some(self, which: np.ndarray) -> "SQPState":
        """Those of (G,) bool."""
        stack = self.stack.some(which)
        names = (
            "number",
            "target_duration",
            "ftol",
            "penalty",
            "value",
            "damping",
            "failed",
            "penalty_updates",
            "falling",
        )
        return SQPState(
            stack=stack,
            objective=self.objective.some(stack, which),
            at=self.at.some(which),
            multipliers={name: own[which] for name, own in self.multipliers.items()},
            **{name: getattr(self, name)[which] for name in names},
        )

    def step(self) -> np.ndarray:
        """One step of each; which of them (G,) are done."""
        free_time = self.stack.members[0].free_time
        quadratic = self.objective.program(self.at, self.damping, self.penalty)
        proposal = solve(quadratic, self.multipliers)
        self.multipliers = proposal.multipliers
        ahead = self.stack.iterates(
            self.at.coefficients + proposal.coefficients, self.at.duration * (1 + proposal.stretch)
        )
        value = self.objective.merit(ahead, self.penalty)
        close = np.abs(self.value - value) <= np.minimum(options.SQP.settled, self.ftol) * self.value
        gained = self.objective.energy(self.at) - self.objective.energy(ahead)
        little = self.at.is_sound & (gained <= self.ftol * self.value)
        better = value < self.value
        self.falling = better & (ahead.duration <= (1 - options.SQP.falling) * self.at.duration)
        self.at = Iterates.chosen(self.at, ahead, better)
        self.value = np.where(better, value, self.value)
        calmer = np.where(self.damping > options.SQP.no_damping, self.damping / options.SQP.damping, 0.0)
        wilder = np.maximum(options.SQP.damping * self.damping, options.SQP.first_damping)
        self.damping = np.where(better, np.where(self.failed > 0, self.damping, calmer), wilder)
        self.failed = np.where(better, 0, self.failed + 1)
        short = better & (self.at.duration <= self.target_duration)
        done = short | (close & (self.at.is_sound | (self.penalty_updates == options.SQP.penalty_updates)))
        if not free_time:
            done |= little & self.at.is_sound  # before the step and after it
            done |= (self.failed == options.SQP.most_failed) & (
                self.penalty_updates == options.SQP.penalty_updates
            )
            self._stop(done, better & self.at.is_sound)
        self._increase_penalty(close & ~done)
        return done

    def _stop(self, done: np.ndarray, asked: np.ndarray) -> None:
        """Those of (G,) bool that are asked about are done where the next program cannot promise enough."""
        which = np.flatnonzero(asked & ~done)
        if len(which):
            quadratic = self.objective.program(self.at, np.zeros(len(done)), self.penalty)
            done[which] = (
                decrease_bound(quadratic, self.multipliers, which) <= self.ftol[which] * self.value[which]
            )

    def _increase_penalty(self, which: np.ndarray) -> None:
        """Increase the penalties of broken rows, for those of (G,) bool."""
        if not np.any(which):
            return
        self.penalty_updates[which] += 1
        self.penalty[which] *= options.SQP.penalty_growth
        self.value = np.where(which, self.objective.merit(self.at, self.penalty), self.value)
        self.damping[which] = 0.0


def _improved(begins: Sequence[InitialGuess]) -> list[SQPSolution]:
    """The best curves near first ones, of alike problems."""
    search = SQPState.of(begins)
    answers: dict[int, SQPSolution] = {}
    done = ~(search.at.violations[:, LIMIT] <= np.array([begin.max_violation for begin in begins]))
    for steps in range(options.SQP.most_steps + 1):
        if steps > 0:
            done = search.step()
            if steps >= options.SQP.enough_steps:
                done |= ~search.falling | (steps == options.SQP.most_steps)
        for own in np.flatnonzero(done).tolist():
            answers[int(search.number[own])] = search.at.one(own, steps)
        if np.all(done):
            break
        if np.any(done):
            search = search.some(~done)
    return [answers[number] for number in range(len(begins))]
