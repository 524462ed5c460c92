"""Gradient descent on numbers of scenarios through `derivatives.replan`.

From time to time the plans are made anew on their paths, so that what is held of them fits the numbers
reached; between, each trajectory is followed from there. At the end the scenarios are planned from the
beginning: at the last numbers and, where plans fail there or others on the way promise less, at those. The
best numbers whose plans are all certified are the answer; those to begin with are among them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jaxplan.derivatives import Held, expect_known_time, follow_and_hold, hold
from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan, plan_batch
from jaxplan.planner.runs import as_filed
from jaxplan.runtime.arguments import expect, several
from jaxplan.runtime.jit import quick_jit
from jaxplan.runtime.progress import progress_bar
from jaxplan.schema import scenario_to_dict
from jaxplan.schema.numbers import find_number, with_numbers
from jaxplan.trajectory import Trajectory
from jaxplan.trajectory.schedule import FEWEST_NODES, padded
from jaxplan.tuning.objectives import Bundle, Objective, as_weights, bare, make_objective, objective_label
from jaxplan.tuning.parameters import Parameter, as_dict, parameters
from jaxplan.tuning.result import Asked, State, Stop, Tuning

_ALIKE = 1e-4  # of an objective: by so much plans made anew may differ from those that were followed

RENEWED = 40  # steps until plans are made anew; at first a quarter and a half of that


def tune(
    scenarios: Scenario | Sequence[Scenario],
    objective: str | Mapping[str, float] | Objective,
    *,
    over: Sequence[str] | Mapping[str, tuple[float, float]],
    optimizer: optax.GradientTransformation | None = None,
    steps: int = 100,
    progress: bool = True,
    resume: Tuning | None = None,
) -> Tuning:
    """Lower an objective, in the mean over scenarios, by the gradient in some of their numbers.

    Args:
        scenarios: one, or several that share the numbers tuned.
        objective: a name such as "peak_acceleration", weights of several by name, or a function of a
            trajectory and its scenario, made of JAX operations.
        over: dotted names of numbers in the file's keys and units, such as ``trajectory.duration_s``,
            ``keep_out[0].half_angle_deg`` or ``start.angular_velocity_rad_s[2]``, or their bounds by name,
            which numbers that may be negative need. All begin with the first one's.
        optimizer: of optax, on the free parameters; Adam with a rate of 0.1 unless told.
        steps: of the optimiser.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        resume: an earlier result of the same call, which is gone on from; its steps count. Ctrl-C ends a
            call with such a result.

    Returns:
        The tuned scenarios with certified plans, and the history. It is never worse than the beginning: where
        the steps lead to nothing better that is the answer, and the message says so. The same call gives the
        same result.

    Raises:
        KeyError: if a scenario has no such number.
        TypeError: for what is no scenario, optimizer or result of tuning.
        ScenarioError: for scenarios that no file could hold; all faults are named.
        ValueError: if arguments make no sense, a scenario has no plan to begin with, or none that can be
            differentiated, the objective is not finite there, or resume is of another call; the message says
            which.
    """
    alone = isinstance(scenarios, Scenario)
    given = (scenarios,) if alone else tuple(several("scenarios", scenarios, "scenarios, or one"))
    if not given:
        raise ValueError("there are no scenarios to tune")
    if not (type(steps) is int and steps >= 1):
        raise ValueError(f"steps = {steps!r}: must be an integer of at least 1")
    if optimizer is not None:
        expect("optimizer", optimizer, optax.GradientTransformation, "such as optax.adam(0.1)")
    if resume is not None and not isinstance(resume, Tuning):
        raise TypeError(f"resume must be a Tuning, not {type(resume).__name__}")
    given = tuple(as_filed(f"scenarios[{number}]", scenario) for number, scenario in enumerate(given))
    for scenario in given:
        expect_known_time(scenario)
    aim = make_objective(objective)
    tuned = parameters(given[0], over)
    for scenario in given[1:]:
        for one in tuned:  # all begin with the first one's numbers, so only that they exist matters
            find_number(scenario, one.place.name)
    optimizer = optax.with_extra_args_support(optax.adam(0.1) if optimizer is None else optimizer)
    with jax.enable_x64(True):
        free = jnp.array([one.free() for one in tuned])
        memory = optimizer.init(free)
        asked = Asked(
            scenarios=[scenario_to_dict(scenario) for scenario in given],
            over=[(one.place.name, one.low, one.high) for one in tuned],
            objective=None if callable(objective) else as_weights(objective),
            optimizer=jax.tree.structure(memory),
        )
        state = State(asked=asked, free=free, memory=memory)
        if resume is not None:
            state = resume.state
            state.asked.expect(asked)
        found = _descend(given, aim, tuned, optimizer, steps, progress, state)
    return replace(found, label=objective_label(objective))


def _descend(
    given: tuple[Scenario, ...],
    aim: Objective,
    tuned: tuple[Parameter, ...],
    optimizer: optax.GradientTransformationExtraArgs,
    steps: int,
    progress: bool,
    state: State,
) -> Tuning:
    def at(free: Any) -> tuple[Scenario, ...]:
        numbers = {one.place: float(one.value(z)) for one, z in zip(tuned, np.asarray(free), strict=True)}
        return tuple(with_numbers(scenario, numbers) for scenario in given)

    free, memory, history = state.free, state.memory, list(state.history)
    first = state.first or _plans_to_begin_with(at(free), progress)
    plans = state.plans or first
    bundle = Bundle.of(((hold(plan), plan.scenario) for plan in plans), aim, tuned)
    messages: list[str] = []
    moved = np.zeros(len(tuned), dtype=bool)

    def look() -> tuple[dict[str, float], np.ndarray] | None:
        """The row of the next step and the gradient; None where they are not finite."""
        value, slope = bundle.slope(free)
        if not (np.isfinite(value) and np.all(np.isfinite(slope))):
            return None
        row = {"step": len(history), "objective": value, "slope": float(np.linalg.norm(slope))}
        return row | as_dict(tuned, np.asarray(free)), slope

    seen = look()
    if seen is None:
        raise ValueError("the objective, or its gradient, is not finite at the numbers to begin with")
    before = free, memory
    checkpoints = list(state.checkpoints or [_stop(free, seen[0])])
    lowest = state.lowest or checkpoints[0]
    try:
        with progress_bar("tuning", "steps", total=steps, shown=progress) as bar:
            for step in range(len(history), len(history) + steps):
                if step in (RENEWED // 4, RENEWED // 2) or (step and step % RENEWED == 0):
                    renewed = _renewed(plans, at(free), aim, tuned)
                    if renewed is not None:
                        plans, bundle = renewed
                        seen = look() or seen
                        checkpoints.append(_stop(free, seen[0]))
                row, slope = seen
                lowest = min(lowest, _stop(free, row), key=lambda stop: stop.objective)
                moved |= slope != 0
                bar.note(f"{row['objective']:.5g}")
                history.append(row)
                before = free, memory
                free, memory = _stepped(optimizer, slope, row["objective"], *before)
                ahead = look()
                if ahead is None:
                    messages.append(f"stopped after {step} steps: beyond, the objective is not finite")
                    break
                seen, before = ahead, (free, memory)
                bar.update()
    except KeyboardInterrupt:
        messages.append("interrupted")
    free, memory = before
    if history and history[-1] is seen[0]:  # of a step that was not made
        history.pop()
    reached = State(
        asked=state.asked,
        free=free,
        memory=memory,
        plans=plans,
        first=first,
        history=tuple(history),
        checkpoints=tuple(checkpoints),
        lowest=lowest,
    )
    end, start = _stop(free, seen[0]), checkpoints[0]
    best, refused = _best(
        end, [lowest, *checkpoints], _Planned(start, first, _mean(first, aim)), at, aim, progress
    )
    if not np.array_equal(best.stop.free, free):
        why = "have no certified plans" if refused else "are not the best ones"
        messages.append(f"the last numbers {why}, so these are those of step {best.stop.step}")
        if best.stop is start:
            messages.append(
                "nothing lower than at the beginning was found: try smaller steps, or other numbers"
            )
    return _result(tuned, best, seen[0], reached, moved, messages)


class _Planned(NamedTuple):
    """Numbers with their plans, which are made from the beginning and certified, and the mean objective."""

    stop: Stop
    plans: Sequence[Plan]
    objective: float


def _best(
    end: Stop,
    others: Sequence[Stop],
    start: _Planned,
    at: Callable[[jax.Array], tuple[Scenario, ...]],
    aim: Objective,
    progress: bool,
) -> tuple[_Planned, bool]:
    """The best numbers with certified plans, and whether those at the end have none.

    They are planned one after the other, the lowest first, until none of the rest promises less than what is
    found.

    Args:
        end: of the descent; it goes before others that are hardly lower.
        others: on the way there.
        start: of the descent.
        at: scenarios by parameters.
        aim: the objective.
        progress: whether to show bars.
    """
    alike, best, refused = _ALIKE * abs(start.objective), start, False
    stops = {stop.step: stop for stop in (*others, end) if stop.step != start.stop.step}
    for stop in sorted(stops.values(), key=lambda stop: stop.objective - alike * (stop is end)):
        if stop.objective >= best.objective + (alike if best is start else -alike):
            break
        plans = plan_batch(at(stop.free), progress=progress)
        if not all(plan.ok for plan in plans):
            refused |= stop is end
        elif (value := _mean(plans, aim)) < best.objective:
            best = _Planned(stop, plans, value)
    return best, refused


def _stop(free: jax.Array, row: Mapping[str, float]) -> Stop:
    """The stop at a row of the history."""
    return Stop(free=free, step=int(row["step"]), objective=row["objective"])


def _stepped(
    optimizer: optax.GradientTransformationExtraArgs,
    slope: np.ndarray,
    value: float,
    free: jax.Array,
    memory: Any,
) -> tuple[jax.Array, Any]:
    """Parameters and memory after a step."""
    try:
        change, memory = optimizer.update(jnp.asarray(slope), memory, free, value=jnp.asarray(value))
    except TypeError as error:
        raise ValueError(f"the optimizer asks for more than values and gradients: {error}") from error
    stepped: jax.Array = optax.apply_updates(free, change)
    return stepped, memory


def _result(
    tuned: tuple[Parameter, ...],
    best: _Planned,
    last: dict[str, float],
    reached: State,
    moved: np.ndarray,
    messages: list[str],
) -> Tuning:
    """The answer, and what there is to say about it."""
    still = [one.place.name for one, has in zip(tuned, moved, strict=True) if not has]
    if still and reached.history:
        messages.append(f"without influence on the objective: {', '.join(still)}")
    return Tuning(
        scenarios=tuple(plan.scenario for plan in best.plans),
        plans=tuple(best.plans),
        numbers=as_dict(tuned, np.asarray(best.stop.free)),
        objective=best.objective,
        history=(*reached.history, last),
        message="; ".join(messages),
        state=reached,
    )


def _mean(plans: Sequence[Plan], aim: Objective) -> float:
    """The mean objective of plans."""
    return float(np.mean([_number(plan, aim) for plan in plans]))


def _number(plan: Plan, aim: Objective) -> float:
    """The objective of a plan."""
    curve = plan.trajectory
    assert curve is not None  # it is OK
    curve = replace(curve, node_times=padded(curve.node_times, FEWEST_NODES))  # as `replan` gives them
    return float(_valued(*jax.tree.map(np.asarray, (curve, bare(plan.scenario))), aim))


@partial(quick_jit, static_argnums=2)
def _valued(trajectory: Trajectory, scenario: Scenario, aim: Objective) -> jax.Array:
    return aim(trajectory, scenario)


def _plans_to_begin_with(scenarios: tuple[Scenario, ...], progress: bool) -> tuple[Plan, ...]:
    plans = tuple(plan_batch(scenarios, progress=progress))
    for plan in plans:
        if not plan.ok:
            raise ValueError(
                f"{plan.scenario.name} has no plan to begin with: {plan.status.name}, {plan.message}"
            )
    return plans


def _renewed(
    plans: tuple[Plan, ...], scenarios: tuple[Scenario, ...], aim: Objective, tuned: tuple[Parameter, ...]
) -> "tuple[tuple[Plan, ...], Bundle] | None":
    """The plans of changed scenarios; None where one fails or cannot be held: the descent goes on without."""
    followed: list[Plan] = []
    pairs: list[tuple[Held, Scenario]] = []
    for plan, scenario in zip(plans, scenarios, strict=True):
        now, held = follow_and_hold(plan, scenario)
        if held is None:
            return None
        followed.append(now)
        pairs.append((held, now.scenario))
    return tuple(followed), Bundle.of(pairs, aim, tuned)
