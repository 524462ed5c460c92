"""Gradient descent on numbers of scenarios through `sensitivity.replan`.

From time to time the plans are made anew on their paths, so that what is held of them fits the numbers
reached; between, each trajectory is followed from there. At the end the scenarios are planned from the
beginning, and the last numbers whose plans are all certified are the answer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jaxplan.planner import Plan, plan_batch
from jaxplan.scenario import Scenario
from jaxplan.scenario.moments import moves
from jaxplan.scenario.numbers import find_number, with_numbers
from jaxplan.sensitivity import Held, follow_and_hold, hold
from jaxplan.tuning.bundle import Bundle
from jaxplan.tuning.objectives import Objective, make_objective
from jaxplan.tuning.parameters import Parameter, as_dict, parameters

RENEWED = 40  # steps until plans are made anew; at first a quarter and a half of that


@dataclass(frozen=True, kw_only=True, eq=False)
class Tuning:
    """What tuning found.

    Attributes:
        scenarios: tuned, in the order given; planned anew and certified.
        plans: of them.
        numbers: the tuned numbers by name, in the file's units.
        history: a row a step: its number, the objective, the length of its gradient in the free parameters,
            and the numbers by name.
        message: what was given up, empty if all is well.
        state: of the descent, from which ``tune(resume=...)`` goes on.
    """

    scenarios: tuple[Scenario, ...]
    plans: tuple[Plan, ...]
    numbers: Mapping[str, float]
    history: tuple[Mapping[str, float], ...]
    message: str = ""
    state: Any = field(default=None, repr=False)

    @property
    def scenario(self) -> Scenario:
        """The first of them."""
        return self.scenarios[0]

    def __str__(self) -> str:
        first, last = self.history[0], self.history[-1]
        width = max(len(name) for name in (*self.numbers, "objective"))
        lines = [f"Tuning of {len(self.scenarios)} scenarios, {len(self.history) - 1} steps"]
        rows = {"objective": (first["objective"], last["objective"])}
        rows |= {name: (first[name], value) for name, value in self.numbers.items()}
        lines += [f"  {name:<{width}}  {a:>12.6g} -> {b:.6g}" for name, (a, b) in rows.items()]
        return "\n".join([*lines, *([f"  {self.message}"] if self.message else [])])


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
        over: dotted names of numbers in the file's keys and units, such as ``trajectory.acceleration_weight``
            or ``keep_out[0].half_angle_deg``, or their bounds by name. All begin with the first one's.
        optimizer: of optax, on the free parameters; Adam with a rate of 0.1 unless told.
        steps: of the optimiser.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        resume: an earlier result of the same call, which is gone on from; its steps count.

    Returns:
        The tuned scenarios with certified plans, and the history. The same call gives the same result.

    Raises:
        KeyError: if a scenario has no such number.
        ValueError: if arguments make no sense, a scenario has no plan to begin with, or none that can be
            differentiated; the message says which.
    """
    given = (scenarios,) if isinstance(scenarios, Scenario) else tuple(scenarios)
    if not given:
        raise ValueError("there are no scenarios to tune")
    if not (type(steps) is int and steps >= 1):
        raise ValueError(f"steps = {steps!r}: must be an integer of at least 1")
    for scenario in given:
        if moves(scenario):
            raise ValueError(f"{scenario.name} has targets or zones that move: only fixed ones can be tuned")
    aim = make_objective(objective)
    tuned = parameters(given[0], over)
    for scenario in given[1:]:
        for one in tuned:  # all begin with the first one's numbers, so only that they exist matters
            find_number(scenario, one.place.name)
    optimizer = optax.adam(0.1) if optimizer is None else optimizer
    with jax.enable_x64(True):
        if resume is None:
            free = jnp.array([one.free() for one in tuned])
            state = _State(free=free, memory=optimizer.init(free), plans=(), history=())
        else:
            state = resume.state
        return _descend(given, aim, tuned, optimizer, steps, progress, state)


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """Where a descent is.

    Attributes:
        free: parameters.
        memory: of the optimiser.
        plans: that trajectories are followed from; none to begin with.
        history: a row for each step that was made.
    """

    free: jax.Array
    memory: Any
    plans: tuple[Plan, ...]
    history: tuple[Mapping[str, float], ...]


def _descend(
    given: tuple[Scenario, ...],
    aim: Objective,
    tuned: tuple[Parameter, ...],
    optimizer: optax.GradientTransformation,
    steps: int,
    progress: bool,
    state: _State,
) -> Tuning:
    from tqdm.auto import tqdm

    def at(free: Any) -> tuple[Scenario, ...]:
        numbers = {one.place: float(one.value(z)) for one, z in zip(tuned, np.asarray(free), strict=True)}
        return tuple(with_numbers(scenario, numbers) for scenario in given)

    def row(value: float, slope: np.ndarray) -> dict[str, float]:
        found = {"step": len(history), "objective": value, "slope": float(np.linalg.norm(slope))}
        return found | as_dict(tuned, np.asarray(free))

    free, memory, history = state.free, state.memory, list(state.history)
    plans = state.plans or _plans_to_begin_with(at(free), progress)
    bundle = Bundle.of(((hold(plan), plan.scenario) for plan in plans), aim, tuned)
    checkpoints, message = [free], ""
    hidden = not progress or None  # None: where stderr is no terminal
    with tqdm(total=steps, desc="tuning", unit=" steps", delay=1, leave=False, disable=hidden) as bar:
        for step in range(len(history), len(history) + steps):
            if step in (RENEWED // 4, RENEWED // 2) or (step and step % RENEWED == 0):
                renewed = _renewed(plans, at(free), aim, tuned)
                if renewed is not None:
                    plans, bundle = renewed
                    checkpoints.append(free)
            value, slope = bundle.slope(free)
            if not (np.isfinite(value) and np.all(np.isfinite(slope))):
                message = f"stopped after {step} steps, where the objective is not finite"
                break
            history.append(row(value, slope))
            bar.set_postfix_str(f"{value:.5g}", refresh=False)
            bar.update()
            change, memory = optimizer.update(jnp.asarray(slope), memory, free)
            free = optax.apply_updates(free, change)
    reached = _State(free=free, memory=memory, plans=plans, history=tuple(history))
    for answer in (free, *reversed(checkpoints)):
        final = plan_batch(at(answer), progress=progress)
        if all(plan.ok for plan in final):
            break
        message = "the last numbers have no certified plans, so these are earlier ones"
    return Tuning(
        scenarios=tuple(plan.scenario for plan in final),
        plans=tuple(final),
        numbers=as_dict(tuned, np.asarray(answer)),
        history=(*history, row(*bundle.slope(free))),
        message=message,
        state=reached,
    )


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
