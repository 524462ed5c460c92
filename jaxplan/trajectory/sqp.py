"""Sequential quadratic programming for curves, with the duration given or as short as possible.

    minimise   energy(c) / energy_0          or          T / T_0 + small * energy(c) / energy_0

over the coefficients ``c`` and perhaps the duration ``T``; index 0 means the first curve. Limits, zones and
tubes (`constraint_blocks`) are *elastic*: they may be broken at an exact penalty, so that every program has a
solution. The *merit* is the objective plus the penalties at the true curve. A step that does not lower it is
rejected, and repeated with more *damping*, a term of the program that keeps steps short. Alike problems are
worked on together, each until it is done; letters of sizes are those of `motion`.

Where the shortest motion from rest to rest is asked for (`DiscreteProblem.hastens`), a part of a failed step
is tried before the step is repeated, and programs are solved only as precisely as a step deserves. What a
program gains, and how much of that its step missed, decide when to end.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from jaxplan.runtime.batching import in_groups
from jaxplan.trajectory.constraints import ConstraintBlock, constraint_blocks
from jaxplan.trajectory.discretisation import DiscreteProblem
from jaxplan.trajectory.motion import LIMIT, TUBE, ZONE, Iterates, Stack, members_of, mixed
from jaxplan.trajectory.splines import weighted
from jaxplan.trajectory.step_programs import Multipliers, QPSolution, QuadraticProgram, decrease_bound, solve

TOGETHER = 16  # problems of a stack; with more, access to memory takes the time
_ENOUGH_STEPS = 16  # steps after which a search goes on only if its duration still falls
_MAX_STEPS = 64  # steps after which every search ends
_FALLING_SHARE = 0.05  # of the duration; one that falls by as much in a step counts as falling
_MAX_PENALTY_UPDATES = 1  # most times that penalties grow where something stays broken
_PENALTY_GROWTH = 30.0  # factor by which penalties grow
ENERGY_WEIGHT = 1e-3  # weight of the energy beside the duration, where a shortest motion is looked for
_DURATION_HESSIAN = 12.0  # in the logarithm of the duration: without constraints it falls by 1 / 12 in a step
_BOLD_DURATION_HESSIAN = 3.0  # the same where the duration alone is lowered, and not the energy
_OVERLOOKED_SHARE = 1e-3  # of a row's tolerance: if a step breaks it by less, the row is not added
_BOLD_OVERLOOKED_SHARE = 3e-2  # the same where the duration alone is lowered, and the end is less precise
_ROUGH_TOLERANCE = 5e-4  # of a limit, or rad; a curve that breaks less may still start another search
_MERIT_TOLERANCE = 1e-4  # of the merit: a smaller change between steps ends the search, as `ftol` does
_FTOL = 1e-3  # of the energy: the least decrease for which another step is made
_DAMPING_FACTOR = 8.0  # factor by which damping grows after a failed step, and falls after a good one
_FIRST_DAMPING = 1e-2  # of the energy's form: the damping after the first failed step
_MIN_DAMPING = 1e-6  # of the energy's form: smaller damping is dropped
_MAX_FAILED_STEPS = 2  # failed steps in a row after which a search ends, once penalties have grown
_HOPELESS_EXCESS = 0.5  # excess over a limit, in a given duration with rates at the ends: it ends at once

# For shortest motions from rest to rest, whose durations tell how near the end is.
_LEEWAY_PER_STRETCH = 1.0  # of a row's tolerance, overlooked for each unit of relative change of the duration
_FEW_ROUNDS = (3, 0.1)  # most rounds of programs that shorten the duration by more than this fraction
_FIRST_PROXIMITY = 0.1  # damping to begin with: of equally quick motions the nearest is taken
_MIN_PROXIMITY = 0.01  # least damping
_PROXIMITY_AFTER_FAILURE = 0.3  # least damping after a step that failed as a whole
_NEGLIGIBLE_DAMPING = 0.1  # damping; with no more, what a program gains is hardly changed
_POOR_GAIN_RATIO = 0.25  # of what a program gains; a step that gains less is damped next like a failed one
_SHORTER_STEP_FRACTION = 0.4  # fraction of a step that is tried where the whole does not lower the merit
_NEAR_END_GAIN = 0.03  # of the duration; if a program gains less, what it missed is about what is left
_LITTLE_GAIN_FACTOR = 5.0  # times `settled`: a program that promises less, whose step fails, ends the search
_PROMISE_FACTOR = 1.5  # times what a program gains: the most that a search is expected to gain
_CLIPPED_GAIN_SHARE = 0.6  # of the most that a program can gain; beyond it the search may gain far more

# Penalties by kind of constraint, larger than any multiplier of a problem that has a solution.
_PENALTIES = {LIMIT: 1e3, ZONE: 1e3, TUBE: 1e2}
_PENALTIES_OF_FREE_TIME = {LIMIT: 1e1, ZONE: 2e1, TUBE: 1e1}


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialGuess:
    """A curve from which the best one near it is looked for, and when that search ends.

    Attributes:
        discrete: the problem.
        coefficients: (n, A) of the curve, n on each of A axes.
        duration: s.
        target_duration: s; the search ends once the duration is no longer than this.
        max_violation: if the curve breaks a limit by more than this fraction, it is returned as it is.
        ftol: relative decrease below which the search ends: for sound curves in a given time the decrease
            that the next program promises, otherwise the change of the merit.
        by_time_to: not None where only the duration is to be lowered, and the energy serves to measure steps:
            these are bolder then, and end where one gains less than this fraction of the duration.
    """

    discrete: DiscreteProblem
    coefficients: np.ndarray
    duration: float
    target_duration: float = 0.0
    max_violation: float = np.inf
    ftol: float = _FTOL
    by_time_to: float | None = None


class SQPSolution(NamedTuple):
    """A curve with its duration, margins and violations.

    Attributes:
        coefficients: (n, A) of the curve, n on each of A axes.
        duration: s.
        margins: (S, D, Z) rad, by place, sight and row of the constraints, as `Iterates` has them.
        violations: (3,) the largest by kind (`LIMIT`, `ZONE`, `TUBE`); zero or less where none is broken.
        finite: whether all loads and cosines of angles are finite.
        steps: how many steps were tried, successful or not; 0 if the first curve breaks limits too far to be
            improved.
    """

    coefficients: np.ndarray
    duration: float
    margins: np.ndarray
    violations: np.ndarray
    finite: bool
    steps: int


def improve(begins: Sequence[InitialGuess]) -> list[SQPSolution]:
    """Improve curves by steps of sequential quadratic programming to the best ones near them.

    Args:
        begins: first curves, and when to end.

    Returns:
        For each the curve of the lowest merit, in the same order; `violations` tell which constraints it
        breaks.
    """
    return in_groups(begins, lambda begin: begin.discrete.kind, _improve_alike, most=TOGETHER)


@dataclass(kw_only=True, eq=False)
class SQPState:
    """Those members of a stack that are not done, and how far they are; all arrays are (G,) or (G, ...).

    Attributes:
        at: the present curves.
        number: index of each member among those that began together.
        share: energies of the first curves, by which energies are divided.
        first_duration: s, of the first curves.
        target_duration: see `InitialGuess`.
        ftol: see `InitialGuess`.
        settled: relative changes of the merits below which the searches end.
        pull: weights of the energies in the objectives: 1 in a given duration, otherwise less, or 0.
        duration_hessian: second derivatives assumed in the logarithms of the durations.
        overlooked: fractions of rows' tolerances, by which steps may break them.
        penalty: (G, 3) by kind of constraint, for each unit of violation.
        spent: energies of the curves, divided by `share`.
        value: merits of the curves.
        damping: of the next steps.
        failed: number of steps in a row that did not lower the merit.
        penalty_updates: how often penalties grew.
        falling: whether the last step made the duration much shorter.
        multipliers: of the last programs.
        promise: s, estimates of the shortest durations that the searches can come to, from the last programs;
            0 if these do not tell.
    """

    at: Iterates
    number: np.ndarray
    share: np.ndarray
    first_duration: np.ndarray
    target_duration: np.ndarray
    ftol: np.ndarray
    settled: np.ndarray
    pull: np.ndarray
    duration_hessian: np.ndarray
    overlooked: np.ndarray
    penalty: np.ndarray
    spent: np.ndarray
    value: np.ndarray
    damping: np.ndarray
    failed: np.ndarray
    penalty_updates: np.ndarray
    falling: np.ndarray
    multipliers: Multipliers
    promise: np.ndarray
    _block_cache: tuple[Iterates, list[ConstraintBlock]] | None = field(default=None, init=False, repr=False)

    @classmethod
    def of(cls, begins: Sequence[InitialGuess]) -> "SQPState":
        """Make the state at first curves of alike problems."""
        stack, count = Stack.of([begin.discrete for begin in begins]), len(begins)
        at = stack.iterates(
            np.stack([begin.coefficients for begin in begins]),
            np.array([begin.duration for begin in begins]),
        )
        free_time = stack.members[0].free_time
        table = _PENALTIES_OF_FREE_TIME if free_time else _PENALTIES
        weight = ENERGY_WEIGHT if free_time else 1.0
        alone = np.array([begin.by_time_to is not None for begin in begins])
        hastens = stack.members[0].hastens
        state = cls(
            at=at,
            number=np.arange(count),
            share=np.ones(count),
            first_duration=at.duration,
            target_duration=np.array([begin.target_duration for begin in begins]),
            ftol=np.array([begin.ftol for begin in begins]),
            settled=np.array([begin.by_time_to or min(_MERIT_TOLERANCE, begin.ftol) for begin in begins]),
            pull=np.where(alone, 0.0, weight),
            duration_hessian=np.where(alone, _BOLD_DURATION_HESSIAN, _DURATION_HESSIAN),
            overlooked=np.where(alone, _BOLD_OVERLOOKED_SHARE, _OVERLOOKED_SHARE),
            penalty=np.tile([table[kind] for kind in (LIMIT, ZONE, TUBE)], (count, 1)),
            spent=np.ones(count),
            value=np.zeros(count),
            damping=np.full(count, _FIRST_PROXIMITY if hastens else 0.0),
            failed=np.zeros(count, dtype=int),
            penalty_updates=np.zeros(count, dtype=int),
            falling=np.full(count, hastens),
            multipliers={},
            promise=np.zeros(count),
        )
        state.share = state.energy(at)
        state.spent = state.energy(at)
        state.value = state.merit(at, state.spent)
        return state

    @property
    def stack(self) -> Stack:
        """The problems of the members."""
        return self.at.stack

    @property
    def _free_time(self) -> bool:
        """Whether the durations are unknowns; it is the same for all members."""
        return self.stack.members[0].free_time

    @property
    def _hastens(self) -> bool:
        """Whether the shortest motions from rest to rest are looked for; it is the same for all members."""
        return self.stack.members[0].hastens

    def _energy_matrix(self, duration: np.ndarray) -> np.ndarray:
        """Matrix (n, n) of one axis's energy over the first curve's energy, for each of G durations in s."""
        return weighted(self.stack.energies, duration, self.stack.weights / self.share[:, None])

    def energy(self, at: Iterates) -> np.ndarray:
        """Energy (G,) of each curve, divided by that of the first curve."""
        bare = _without_offset(at)
        product = bare * (self._energy_matrix(at.duration) @ bare)
        return np.asarray(np.sum(product.reshape(len(product), -1), axis=1) / 2)

    def merit(self, at: Iterates, energy: np.ndarray) -> np.ndarray:
        """Merit (G,) of each curve, objective plus penalties; `energy` (G,) are the curves' energies."""
        value = self.pull * energy
        if self._free_time:
            value = value + at.duration / self.first_duration
        return np.asarray(value + np.sum(self.penalty * np.maximum(at.violations, 0.0), axis=1))

    def program(self, at: Iterates, damping: np.ndarray) -> QuadraticProgram:
        """Make the quadratic programs at curves, each with its damping (G,).

        In them a change of the duration is relative to the duration.
        """
        stack = self.stack
        energy = self._energy_matrix(at.duration)
        form = energy * (ENERGY_WEIGHT if self._free_time else 1.0)
        return QuadraticProgram(
            free=stack.free,
            by_time=at.duration[:, None, None] * stack.by_time,
            hessian=form + damping[:, None, None] * stack.energies[:, 0],
            gradient=self.pull[:, None, None] * (energy @ _without_offset(at)),
            duration_hessian=self._own_duration_hessian if self._free_time else None,
            rows=stack.rows,
            blocks=self._blocks_at(at),
            penalty=self.penalty,
            overlooked=self.overlooked,
            leeway=_LEEWAY_PER_STRETCH if self._hastens else 0.0,
            few_rounds=_FEW_ROUNDS if self._hastens else None,
            roughly=self.pull == 0 if self._hastens else None,
        )

    @property
    def _own_duration_hessian(self) -> np.ndarray:
        """Second derivative (G,) in the duration for each next program; smaller if that falls fast."""
        return np.where(self._hastens & self.falling, _BOLD_DURATION_HESSIAN, self.duration_hessian)

    def _blocks_at(self, at: Iterates) -> list[ConstraintBlock]:
        """Constraint blocks at curves, cached for the curves of the last call."""
        if self._block_cache is None or self._block_cache[0] is not at:
            self._block_cache = at, list(constraint_blocks(at))
        return self._block_cache[1]

    def step(self) -> np.ndarray:
        """Try a step of each member, and take it if it lowers the merit.

        Returns:
            (G,) bool for each member, whether its search is done.
        """
        proposal = solve(self.program(self.at, self.damping), self.multipliers)
        self.multipliers = proposal.multipliers
        ahead = self.stack.iterates(
            self.at.coefficients + proposal.coefficients, self.at.duration * (1 + proposal.stretch)
        )
        energy = self.energy(ahead)
        value = self.merit(ahead, energy)
        whole, damped = value < self.value, self.damping
        missed = ahead.duration / self.at.duration - 1 - proposal.stretch
        if self._hastens:
            clipped = proposal.stretch * self._own_duration_hessian <= -_CLIPPED_GAIN_SHARE
            self.promise = np.where(clipped, 0.0, self.at.duration * (1 + _PROMISE_FACTOR * proposal.stretch))
            whole &= -missed >= (_POOR_GAIN_RATIO - 1) * -proposal.stretch
            if not np.all(value < self.value):
                ahead, energy, value = self._try_shorter_steps(proposal, ahead, energy, value)
        close = np.abs(self.value - value) <= self.settled * self.value
        little = self.at.is_sound & (self.spent - energy <= self.ftol * self.value)
        better = value < self.value
        close &= whole | ~better
        self.falling = better & (ahead.duration <= (1 - _FALLING_SHARE) * self.at.duration)
        self.at = mixed(self.at, ahead, better)
        self.spent = np.where(better, energy, self.spent)
        self.value = np.where(better, value, self.value)
        self.damping = self._next_damping(whole, better)
        self.failed = np.where(better, 0, self.failed + 1)
        dearest = self.penalty_updates == _MAX_PENALTY_UPDATES
        done = better & (self.at.duration <= self.target_duration)
        if self._hastens:
            near = whole & (missed <= self.settled) & (proposal.stretch >= -_NEAR_END_GAIN)
            near |= -proposal.stretch <= np.where(better, self.settled, _LITTLE_GAIN_FACTOR * self.settled)
            done |= near & ((damped <= _NEGLIGIBLE_DAMPING) | (self.failed > 1)) & self.kept
            done |= self.promise >= [own.problem.at_most for own in self.stack.members]
        done |= close & (self.kept | dearest)
        if not self._free_time:
            done |= little & self.at.is_sound  # before the step and after it
            hopeless = self.stack.members[0].problem.at_speed & (
                self.at.violations[:, LIMIT] > _HOPELESS_EXCESS
            )
            done |= (self.failed == _MAX_FAILED_STEPS) & (dearest | hopeless)
            self._stop_if_little_promised(done, better & self.at.is_sound)
        self._increase_penalty(close & ~done)
        return done

    def _try_shorter_steps(
        self, proposal: QPSolution, ahead: Iterates, energy: np.ndarray, value: np.ndarray
    ) -> tuple[Iterates, np.ndarray, np.ndarray]:
        """Replace failed steps by a fraction of them, where that lowers the merit.

        Returns:
            Curves ahead, their energies and their merits; those of the whole step where no part was taken.
        """
        shorter = self.stack.iterates(
            self.at.coefficients + _SHORTER_STEP_FRACTION * proposal.coefficients,
            self.at.duration * (1 + _SHORTER_STEP_FRACTION * proposal.stretch),
        )
        spent = self.energy(shorter)
        worth = self.merit(shorter, spent)
        taken = ~(value < self.value) & (worth < self.value)
        return mixed(ahead, shorter, taken), np.where(taken, spent, energy), np.where(taken, worth, value)

    def _next_damping(self, whole: np.ndarray, better: np.ndarray) -> np.ndarray:
        """Damping (G,) of the next steps, after steps `better` as a `whole`, only in part, or not at all."""
        least, first = (_MIN_PROXIMITY, _PROXIMITY_AFTER_FAILURE) if self._hastens else (0.0, _FIRST_DAMPING)
        calmer = np.where(self.damping > _MIN_DAMPING, self.damping / _DAMPING_FACTOR, 0.0)
        calmer = np.where(self.failed > 0, self.damping, np.maximum(calmer, least))
        return np.where(whole & better, calmer, np.maximum(_DAMPING_FACTOR * self.damping, first))

    @property
    def kept(self) -> np.ndarray:
        """Bool (G,) for each curve: whether constraints are kept, or nearly so if only the duration counts.

        In the latter case the curve is the beginning of another search, which mends small violations.
        """
        return self.at.is_sound | (self.pull == 0) & np.all(self.at.violations <= _ROUGH_TOLERANCE, axis=1)

    def _stop_if_little_promised(self, done: np.ndarray, asked: np.ndarray) -> None:
        """Set `done`, in place, where `asked` is true and the next program promises too small a decrease."""
        which = np.flatnonzero(asked & ~done)
        if len(which):
            quadratic = self.program(self.at, np.zeros(len(done)))
            promised = decrease_bound(quadratic, self.multipliers, which)
            done[which] = promised <= self.ftol[which] * self.value[which]

    def _increase_penalty(self, which: np.ndarray) -> None:
        """Increase, in place, the penalties of the members `which` (G,) bool, and drop their damping."""
        if not np.any(which):
            return
        self.penalty_updates[which] += 1
        self.penalty[which] *= _PENALTY_GROWTH
        self.value = np.where(which, self.merit(self.at, self.spent), self.value)
        self.damping[which] = _MIN_PROXIMITY if self._hastens else 0.0


def _without_offset(at: Iterates) -> np.ndarray:
    """Coefficients of the curves shifted to begin at zero, so that energies lose no digits, (G, n, A).

    G counts curves, n coefficients and A axes.
    """
    return at.coefficients - at.coefficients[:, :1]


def solution_at(at: Iterates, member: int, steps: int) -> SQPSolution:
    """Extract the curve of number `member` as a solution, after so many `steps`."""
    return SQPSolution(
        coefficients=at.coefficients[member].copy(),  # a view would keep the whole stack in memory
        duration=float(at.duration[member]),
        margins=at.margins[member].copy(),
        violations=at.violations[member].copy(),
        finite=bool(at.finite[member]),
        steps=steps,
    )


def _improve_alike(begins: Sequence[InitialGuess]) -> list[SQPSolution]:
    """Do the same as `improve` for first curves of problems of one kind."""
    state = SQPState.of(begins)
    solutions: dict[int, SQPSolution] = {}
    best: dict[int, float] = {}  # s, shortest durations found for each problem
    done = ~(state.at.violations[:, LIMIT] <= np.array([begin.max_violation for begin in begins]))
    for steps in range(_MAX_STEPS + 1):
        if steps > 0:
            done = state.step()
            if steps >= _ENOUGH_STEPS:
                done |= ~state.falling | (steps == _MAX_STEPS)
            owner = [id(own) for own in state.stack.members]
            for member in np.flatnonzero(done & state.kept).tolist():
                best[owner[member]] = min(best.get(owner[member], np.inf), float(state.at.duration[member]))
            done |= state.promise >= [best.get(own, np.inf) for own in owner]
        for member in np.flatnonzero(done).tolist():
            solutions[int(state.number[member])] = solution_at(state.at, member, steps)
        if np.all(done):
            break
        if np.any(done):
            state = members_of(state, ~done)
    return [solutions[number] for number in range(len(begins))]


class NearOptimum(NamedTuple):
    """A curve that is near an optimum, and the rows that bind there.

    Attributes:
        state: of the search, with this curve alone in its stack.
        at: the curve; an unknown duration is long enough for the limits that the next program sees.
        multipliers: of every row, from the quadratic program at the curve.
    """

    state: SQPState
    at: Iterates
    multipliers: Multipliers


def near_optima(begins: Sequence[InitialGuess]) -> list[NearOptimum]:
    """Improve curves to the best ones near them, and solve the quadratic program at each of these."""
    pairs = zip(begins, improve(begins), strict=True)
    ends = [replace(own, coefficients=best.coefficients, duration=best.duration) for own, best in pairs]
    return in_groups(ends, lambda end: end.discrete.kind, _with_multipliers, most=TOGETHER)


def _with_multipliers(ends: Sequence[InitialGuess]) -> list[NearOptimum]:
    """Solve the quadratic programs at curves of one kind, all in one stack."""
    state, count = SQPState.of(ends), len(ends)
    at, proposal = state.at, solve(state.program(state.at, np.zeros(count)), {})
    if ends[0].discrete.free_time:  # limits kept by coefficients take more time than those kept at places
        at = state.stack.iterates(at.coefficients, at.duration * (1 + proposal.stretch), as_given=True)
    y, numbers = proposal.multipliers, np.arange(count)[:, None]
    return [NearOptimum(members_of(state, n), members_of(at, n), members_of(y, n)) for n in numbers]
