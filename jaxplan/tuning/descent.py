"""Gradient descent on numbers of scenarios through `derivatives.replan`.

As the numbers change, trajectories are *followed*: each stays the optimum under the limits and zones that
bind, which are *held* fixed. From time to time the plans are *renewed*: made anew on their paths, so that
what is held of them fits the numbers reached. At the end the scenarios are planned from the beginning for the
last numbers and, if plans fail there or others on the way have a lower objective, for those. The result is
the best numbers whose plans are all certified; those to begin with are among them.

A descent works on *free* parameters, one for each number, which may take any value (`parameters`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxplan.derivatives import Held, expect_followable, expect_known_time, follow_and_hold, hold_each
from jaxplan.model.nameless import bare
from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan, plan_batch
from jaxplan.planner.entry_points import as_filed, plan_with_fits
from jaxplan.runtime.ahead import ahead
from jaxplan.runtime.arguments import expect, several
from jaxplan.runtime.batching import padded_count
from jaxplan.runtime.garbage import seldom_collected
from jaxplan.runtime.jit import clear_if_full, quick_jit
from jaxplan.runtime.progress import progress_bar
from jaxplan.schema import scenario_to_dict
from jaxplan.schema.numbers import with_numbers
from jaxplan.trajectory import Fit, Trajectory
from jaxplan.trajectory.node_times import FEWEST_NODES, padded
from jaxplan.tuning.objectives import (
    MARGIN,
    Objective,
    as_weights,
    make_objective,
    mean_slope,
    objective_label,
    refuse_margin,
    value_of,
)
from jaxplan.tuning.parameters import Parameter, as_dict, number_of, parameters
from jaxplan.tuning.tuned import State, Stop, Tuning

_ALIKE = 1e-4  # fraction of an objective by which plans made anew may differ from those that were followed

# Number of slopes above which an optimised kernel pays: it takes 6 s more to compile, and saves 8 ms each.
_OFTEN = 750

_MANY = 8  # plans from which on one is held twice, a little extra work that lets kernels compile sooner

RENEWED = 40  # steps between renewals of the plans; the first two are after a quarter and a half of that


def tune(
    scenarios: Scenario | Sequence[Scenario],
    objective: str | Mapping[str, float] | Objective,
    *,
    over: Sequence[str] | Mapping[str, tuple[float, float]],
    optimizer: Any = None,
    steps: int = 100,
    progress: bool = True,
    resume: Tuning | None = None,
) -> Tuning:
    """Lower an objective, as a mean over scenarios, along its gradient in some of their numbers.

    Args:
        scenarios: one scenario, or several that share the tuned numbers.
        objective: a name such as "peak_acceleration", weights of several by name, or a function of a
            trajectory and its scenario, made of JAX operations.
        over: dotted names of numbers in the file's keys and units, such as ``trajectory.duration_s``,
            ``keep_out[0].half_angle_deg`` or ``start.angular_velocity_rad_s[2]``, or a mapping from names to
            bounds, which numbers that may be negative need. First values are those of the first scenario.
        optimizer: an optax `GradientTransformation` of the free parameters; None for Adam with a rate of 0.1.
        steps: number of steps of the optimizer.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        resume: result of an earlier such call, from which to go on; its steps count. Ctrl-C ends a call with
            such a result.

    Returns:
        The tuned scenarios with certified plans, and the history. The result is never worse than the
        beginning: if the steps lead to nothing better, it is the beginning, and the message says so. The same
        call gives the same result.

    Raises:
        TypeError: if a scenario, the optimizer or `resume` is of another type; if an objective asks for the
            values of what JAX traces, as ``float`` and ``if`` do, or returns no number.
        ScenarioError: for scenarios that no file could hold, with all faults, or without such a number.
        ValueError: if arguments make no sense, if a scenario has no plan to begin with or none that can be
            differentiated, if the objective is not finite there, or if `resume` is of another call; the
            message says which.
    """
    import optax  # slow to import, so not at the top, which figures read, too

    alone = isinstance(scenarios, Scenario)
    given = (scenarios,) if alone else tuple(several("scenarios", scenarios, "scenarios, or one"))
    if not given:
        raise ValueError("there are no scenarios to tune")
    if not (type(steps) is int and steps >= 1):
        raise ValueError(f"steps = {steps!r}: must be an integer of at least 1")
    if optimizer is not None:
        expect("optimizer", optimizer, optax.GradientTransformation, "such as optax.adam(0.1)")
    if resume is not None:
        expect("resume", resume, Tuning, "as an earlier call returned it")
    given = tuple(as_filed(f"scenarios[{number}]", scenario) for number, scenario in enumerate(given))
    for scenario in given:
        expect_known_time(scenario)
        expect_followable(scenario)
    aim = make_objective(objective)
    for scenario in given if not callable(objective) and MARGIN in as_weights(objective) else ():
        refuse_margin(scenario)
    tuned = parameters(given[0], over)
    for scenario in given[1:]:
        for one in tuned:  # all begin with the first one's numbers, so only that they exist matters
            number_of(scenario, one.place.name)
    usual = optimizer is None
    optimizer = _usual_optimizer() if usual else optax.with_extra_args_support(optimizer)
    # A user's own may look at values, or count its calls, so it is not compiled.
    update = _usual_update() if usual else optimizer.update
    with jax.enable_x64(True), seldom_collected():
        free = jnp.array([one.free() for one in tuned])
        memory = optimizer.init(free)
        asked = {
            "scenarios": [scenario_to_dict(scenario) for scenario in given],
            "over": [(one.place.name, one.low, one.high) for one in tuned],
            "objective": None if callable(objective) else as_weights(objective),
            "optimizer": jax.tree.structure(memory),
        }
        if resume is not None:
            resume.state.expect(asked)
        state = State(asked=asked, free=free, memory=memory) if resume is None else resume.state
        descent = _Descent(given, aim, tuned, update, progress, state, steps)
        descent.go(steps)
        found = descent.result()
    return replace(found, label=objective_label(objective))


@cache
def _usual_optimizer() -> Any:
    """Return the optimizer of `tune` where none is given: Adam with a rate of 0.1."""
    import optax

    return optax.with_extra_args_support(optax.adam(0.1))


@cache
def _usual_update() -> Callable[..., Any]:
    """Return the update of `_usual_optimizer`, compiled once in a process."""
    update: Callable[..., Any] = jax.jit(_usual_optimizer().update)
    return update


class _Planned(NamedTuple):
    """A point of a descent with plans made for it from the beginning, all certified; their mean objective."""

    stop: Stop
    plans: Sequence[Plan]
    objective: float


class _Descent:
    """A descent under way: its state, and the objective and gradient there.

    Making one plans the scenarios for the numbers to begin with, unless the state has plans. It raises
    ValueError if a scenario has no plan, or the objective is not finite.
    """

    def __init__(
        self,
        given: tuple[Scenario, ...],
        aim: Objective,
        tuned: tuple[Parameter, ...],
        update: Callable[..., Any],
        progress: bool,
        state: State,
        steps: int,
    ) -> None:
        self._given, self._aim, self._tuned = given, aim, tuned
        self._update, self._progress = update, progress
        self._messages: list[str] = []
        self._moved = np.zeros(len(tuned), dtype=bool)
        first, self._fits = state.first, list[Fit | None]()
        if not first:
            first, self._fits = self._plans_to_begin_with(state.free)
        self._state = replace(state, first=first, plans=state.plans or first)
        longest = max(len(plan.path.attitudes) for plan in self._state.plans if plan.path is not None)
        self._nodes = padded_count(longest, FEWEST_NODES)  # of all plans, so that kernels compile once
        held = hold_each(self._state.plans, nodes=self._nodes, known=self._fits or None)
        pairs = zip(held, (plan.scenario for plan in self._state.plans), strict=True)
        self._often = steps * len(given) > _OFTEN
        clear_if_full()  # not while kernels are compiled
        rehearsal = self._first_held if len(given) >= _MANY else None
        with ahead([self._first_valued] if rehearsal else []):
            begin = self._state.free
            self._slope = mean_slope(pairs, aim, tuned, begin, often=self._often, rehearsal=rehearsal)
        self._fits.clear()  # they take room, and what is held has all that is needed
        seen = self._look(self._state)
        if seen is None:
            raise ValueError("the objective, or its gradient, is not finite at the numbers to begin with")
        self._row, self._gradient = seen
        if not state.checkpoints:
            self._state = replace(self._state, checkpoints=(self._stop,))

    def _first_held(self) -> tuple[Held, Scenario]:
        """Return what is held of the first plan, computed for it alone, and its scenario."""
        plan = self._state.plans[0]
        return next(hold_each([plan], nodes=self._nodes, known=self._fits[:1] or None)), plan.scenario

    def _first_valued(self) -> None:
        """Compute the objective of the first plan, only to compile its kernel beside that of the slope."""
        with jax.enable_x64(True):  # a thread has its own setting
            self._mean(self._state.plans[:1])

    def go(self, steps: int) -> None:
        """Make `steps` steps, unless the objective ceases to be finite or Ctrl-C interrupts."""
        try:
            with progress_bar("tuning", "steps", total=steps, shown=self._progress) as bar:
                for _ in range(steps):
                    step = len(self._state.history)
                    if step == 0 and not np.any(self._gradient):  # later an optimiser may go on by momentum
                        names = ", ".join(one.place.name for one in self._tuned)
                        self._messages.append(
                            f"no step was made: the objective's gradient in {names} is zero at the beginning"
                        )
                        break
                    if step in (RENEWED // 4, RENEWED // 2) or (step and step % RENEWED == 0):
                        self._renew()
                    bar.note(f"{self._row['objective']:.5g}")
                    if not self._step():
                        self._messages.append(
                            f"stopped after {step} steps: beyond, the objective is not finite"
                        )
                        break
                    bar.update()
        except KeyboardInterrupt:
            self._messages.append("interrupted")

    def result(self) -> Tuning:
        """Plan for the most promising numbers, and return the best with certified plans."""
        state, start = self._state, self._state.checkpoints[0]
        begun = _Planned(start, state.first, self._mean(state.first))
        best, refused = self._best(begun, self._stop)
        messages = list(self._messages)
        if not np.array_equal(best.stop.free, state.free):
            why = "have no certified plans" if refused else "are not the best ones"
            messages.append(f"the last numbers {why}, so these are those of step {best.stop.step}")
            if best.stop is start:
                messages.append(
                    "nothing lower than at the beginning was found: try smaller steps, or other numbers"
                )
        still = [one.place.name for one, has in zip(self._tuned, self._moved, strict=True) if not has]
        if still and state.history:
            messages.append(f"without influence on the objective: {', '.join(still)}")
        return Tuning(
            scenarios=tuple(plan.scenario for plan in best.plans),
            plans=tuple(best.plans),
            numbers=as_dict(self._tuned, np.asarray(best.stop.free)),
            objective=best.objective,
            before=begun.objective,
            history=(*state.history, self._row),
            message="; ".join(messages),
            state=state,
        )

    @property
    def _stop(self) -> Stop:
        """The point that the descent has reached."""
        row = self._row
        return Stop(free=self._state.free, step=int(row["step"]), objective=row["objective"])

    def _at(self, free: jax.Array) -> tuple[Scenario, ...]:
        """Return the scenarios with the numbers of free parameters put in."""
        pairs = zip(self._tuned, np.asarray(free), strict=True)
        numbers = {one.place: float(one.value(z)) for one, z in pairs}
        return tuple(with_numbers(scenario, numbers) for scenario in self._given)

    def _look(self, state: State) -> tuple[dict[str, float], np.ndarray] | None:
        """Return the history's row for a state, and the gradient there; None if either is not finite."""
        value, slope = self._slope(state.free)
        if not (np.isfinite(value) and np.all(np.isfinite(slope))):
            return None
        row = {"step": len(state.history), "objective": value, "slope": float(np.linalg.norm(slope))}
        return row | as_dict(self._tuned, np.asarray(state.free)), slope

    def _step(self) -> bool:
        """Make a step and return True; return False, making none, if the objective after it is not finite."""
        state, row = self._state, self._row
        self._moved |= self._gradient != 0
        value = jnp.asarray(row["objective"])
        try:
            gradient = jnp.asarray(self._gradient)
            change, memory = self._update(gradient, state.memory, state.free, value=value)
        except TypeError as error:
            if "missing" not in str(error):  # it is a fault of the optimizer itself
                raise
            raise ValueError(f"the optimizer asks for more than values and gradients: {error}") from error
        after = replace(
            state,
            free=(state.free + change).astype(state.free.dtype),
            memory=memory,
            history=(*state.history, row),
            lowest=min(filter(None, (state.lowest, self._stop)), key=lambda stop: stop.objective),
        )
        ahead = self._look(after)
        if ahead is not None:
            self._state, (self._row, self._gradient) = after, ahead
        return ahead is not None

    def _renew(self) -> None:
        """Renew the plans for the current numbers; if one fails or cannot be held, keep those there are."""
        state, plans, pairs = self._state, [], []
        for plan, scenario in zip(state.plans, self._at(state.free), strict=True):
            now, held = follow_and_hold(plan, scenario, nodes=self._nodes)
            if held is None:
                return
            plans.append(now)
            pairs.append((held, now.scenario))
        self._slope = mean_slope(pairs, self._aim, self._tuned, state.free, often=self._often)
        self._row, self._gradient = self._look(state) or (self._row, self._gradient)
        self._state = replace(state, plans=tuple(plans), checkpoints=(*state.checkpoints, self._stop))

    def _plans_to_begin_with(self, free: jax.Array) -> tuple[tuple[Plan, ...], list[Fit | None]]:
        """Plan the scenarios for free parameters; return plans and fits. ValueError if one has no plan."""
        plans, fits = plan_with_fits(self._at(free), progress=self._progress)
        for plan in plans:
            if not plan.ok:
                raise ValueError(
                    f"{plan.scenario.name} has no plan to begin with: {plan.status.name}, {plan.message}"
                )
        return tuple(plans), fits

    def _best(self, begun: _Planned, end: Stop) -> tuple[_Planned, bool]:
        """Find the best point with certified plans, and whether planning failed at the end of the descent.

        Points are planned one after the other, by rising objective, the end before others that are hardly
        lower, until no remaining point is lower than the best one found.
        """
        state, start, best, refused = self._state, begun.stop, begun, False
        alike = _ALIKE * abs(best.objective)
        known = (*filter(None, [state.lowest]), *state.checkpoints, end)
        stops = {stop.step: stop for stop in known if stop.step != start.step}
        for stop in sorted(stops.values(), key=lambda stop: stop.objective - alike * (stop is end)):
            if stop.objective >= best.objective + (alike if best.stop is start else -alike):
                break
            plans = plan_batch(self._at(stop.free), progress=self._progress)
            if not all(plan.ok for plan in plans):
                refused |= stop is end
            elif (value := self._mean(plans)) < best.objective:
                best = _Planned(stop, plans, value)
        return best, refused

    def _mean(self, plans: Sequence[Plan]) -> float:
        """Return the mean objective of plans, which must all be OK."""
        values = []
        for plan in plans:
            assert plan.trajectory is not None  # it is OK
            times = padded(plan.trajectory.node_times, self._nodes)  # as `replan` gives them
            inputs = replace(plan.trajectory, node_times=times), bare(plan.scenario)
            values.append(float(_valued(*jax.tree.map(np.asarray, inputs), self._aim)))
        return float(np.mean(values))


@partial(quick_jit, level=1, static_argnums=2)
def _valued(trajectory: Trajectory, scenario: Scenario, aim: Objective) -> jax.Array:
    """Return the objective of a trajectory and its scenario, compiled."""
    return value_of(aim, trajectory, scenario)
