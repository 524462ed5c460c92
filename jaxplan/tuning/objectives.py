"""Objectives of tuning: functions of a trajectory and its scenario, with values in the units of files.

A descent lowers their mean over several plans, along its gradient in the tuned numbers; how trajectories
change with these is computed by `derivatives.replan`.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.derivatives import Held, held_end, replan_to
from jaxplan.model.nameless import bare
from jaxplan.model.scenario import Scenario
from jaxplan.runtime.jit import quick_jit
from jaxplan.runtime.workers import one_thread
from jaxplan.schema.numbers import with_numbers
from jaxplan.trajectory import Trajectory, measures
from jaxplan.tuning.parameters import Parameter

Objective = Callable[[Trajectory, Scenario], Array]
Slope = Callable[[Array], tuple[float, np.ndarray]]

MARGIN = "smallest_margin"
"""The objective that is to grow, and so counts negative."""
_DEGREE = np.pi / 180


def _margin(trajectory: Trajectory, scenario: Scenario) -> Array:
    """Return the smallest margin to any zone, deg; raises ValueError without zones, and if one moves."""
    refuse_margin(scenario)
    return measures.least_margin(trajectory, scenario.spacecraft, scenario.constraints) / _DEGREE


def _torque(trajectory: Trajectory, scenario: Scenario) -> Array:
    """Return the largest component of the torque, N m; raises ValueError without an inertia."""
    if scenario.spacecraft.inertia is None:
        raise ValueError("objective peak_torque needs spacecraft.inertia_kg_m2, which is not set")
    return measures.peak_torque(trajectory, scenario.spacecraft)


# Each with its unit; the margin is to grow, so it counts negative.
_KNOWN: dict[str, tuple[Objective, str]] = {
    "peak_acceleration": (lambda t, s: measures.peak(t, "angular_acceleration") / _DEGREE, "deg/s²"),
    "smooth_peak_acceleration": (
        lambda t, s: measures.power_mean(t, "angular_acceleration") / _DEGREE,
        "deg/s²",
    ),
    "peak_rate": (lambda t, s: measures.peak(t, "angular_velocity") / _DEGREE, "deg/s"),
    "peak_jerk": (lambda t, s: measures.peak(t, "angular_jerk") / _DEGREE, "deg/s³"),
    "peak_torque": (_torque, "N m"),
    "effort": (lambda t, s: measures.effort(t) / _DEGREE**2, "(deg/s²)² s"),
    "roughness": (lambda t, s: measures.roughness(t) / _DEGREE**2, "(deg/s³)² s"),
    "duration": (lambda t, s: measures.duration(t), "s"),
    MARGIN: (lambda t, s: -_margin(t, s), "deg"),
}
OBJECTIVES: dict[str, Objective] = {name: function for name, (function, _) in _KNOWN.items()}
"""Ready-made objectives by name."""


def refuse_margin(scenario: Scenario) -> None:
    """Raise ValueError if plans of a scenario have no smallest margin with slopes.

    If it is because a zone moves, the message lists the objectives that have slopes.
    """
    if not scenario.zones:
        raise ValueError("objective smallest_margin needs zones, of which there are none")
    moving = [zone.name for zone in scenario.zones if zone.moves]
    if moving:
        raise ValueError(
            f"objective smallest_margin is of zones that stand still, and {' and '.join(moving)} "
            f"{'move' if len(moving) > 1 else 'moves'}: plan.certificate.min_margin tells it without slopes; "
            f"what has slopes here is {', '.join(offered(scenario))}"
        )


def offered(scenario: Scenario) -> list[str]:
    """Return the names of the objectives that can be computed for plans of a scenario."""
    still = bool(scenario.zones) and not any(zone.moves for zone in scenario.zones)
    without = set() if still else {MARGIN}
    without |= {"peak_torque"} if scenario.spacecraft.inertia is None else set()
    return [name for name in OBJECTIVES if name not in without]


def objective_label(given: str | Mapping[str, float] | Objective) -> str:
    """Return the label of an objective for an axis: a single one with its unit, several with their weights.

    Args:
        given: an objective as `make_objective` takes it.
    """
    if callable(given):
        name = getattr(given, "__name__", "objective")
        return "objective" if name == "<lambda>" else name
    weights = as_weights(given)
    if list(weights.values()) == [1.0]:
        (name,) = weights
        return f"{_spelled(name)} ({_KNOWN[name][1]})"
    return " + ".join(f"{weight:g} {_spelled(name)}" for name, weight in weights.items())


def unit_of_objective(name: str) -> str:
    """Return the unit of an objective by its name."""
    return _KNOWN[name][1]


def _spelled(name: str) -> str:
    """Return the name of an objective in words, with a minus sign if its negative is lowered."""
    sign = "\N{MINUS SIGN}" if name == MARGIN else ""
    return sign + name.replace("_", " ")


def make_objective(given: str | Mapping[str, float] | Objective) -> Objective:
    """Return the function of an objective given by name, by weights or as a function.

    Args:
        given: a name in `OBJECTIVES`, weights of several by name, or a function of a trajectory and its
            scenario, which is returned as it is.

    Raises:
        TypeError: if it is none of these.
        ValueError: if a name is unknown, or a weight is not a finite number.
    """
    if callable(given):
        return given
    return _weighted(tuple(as_weights(given).items()))


def as_weights(given: object) -> dict[str, float]:
    """Return an objective, given as a name or as weights, as weights by name.

    Raises:
        TypeError: if it is neither.
        ValueError: if there are no weights, a name is unknown, or a weight is not a finite number.
    """
    if not isinstance(given, str | Mapping):
        raise TypeError(
            f"objective must be a name, weights by name or a function, not {type(given).__name__}"
        )
    weights = {given: 1.0} if isinstance(given, str) else dict(given)
    if not weights:
        raise ValueError("objective has no weights: there is nothing to lower")
    for name, weight in weights.items():
        if name not in OBJECTIVES:
            raise ValueError(f"unknown objective {name!r}: must be one of {', '.join(OBJECTIVES)}")
        number = isinstance(weight, int | float | np.number) and not isinstance(weight, bool)
        if not (number and np.isfinite(weight)):
            raise ValueError(f"objective[{name!r}] = {weight!r}: must be a finite number")
    return {name: float(weight) for name, weight in weights.items()}


@cache
def _weighted(weights: tuple[tuple[str, float], ...]) -> Objective:
    """Return a weighted sum of objectives: the same function for the same weights, so it compiles once."""
    return partial(_sum_of, weights)


def _sum_of(weights: tuple[tuple[str, float], ...], trajectory: Trajectory, scenario: Scenario) -> Array:
    """Return the sum of the named objectives times their weights."""
    parts = [weight * OBJECTIVES[name](trajectory, scenario) for name, weight in weights]
    return jnp.sum(jnp.stack(parts))


def mean_slope(
    pairs: Iterable[tuple[Held, Scenario]],
    aim: Objective,
    tuned: tuple[Parameter, ...],
    begin: ArrayLike,
    *,
    often: bool,
    rehearsal: Callable[[], tuple[Held, Scenario]] | None = None,
) -> Slope:
    """Make the function from free parameters to the mean objective of plans and its gradient.

    Its kernels are compiled now, and slopes at the beginning are computed while other plans are still being
    held.

    Args:
        pairs: what is held of each plan, with its scenario; an iterator that computes them one by one.
        aim: the objective.
        tuned: the numbers that the parameters stand for.
        begin: free parameters with which the function will be called first.
        often: whether the function is called so often that a kernel pays that takes longer to compile and
            less time to run.
        rehearsal: computes a pair like the first one, for which kernels are compiled while `pairs` are
            computed; it has no other use. None to compile for the first pair itself.
    """
    kernel = _slope if often else _slope_soon
    held: list[Any] = []
    first: dict[Any, int] = {}  # of each shape, for which kernels are compiled
    start = np.asarray(begin)

    def at(free: Any, pair: Any) -> tuple[np.ndarray, np.ndarray]:
        with jax.enable_x64(True):  # a thread has its own setting
            found: tuple[np.ndarray, np.ndarray] = jax.device_get(kernel(free, *pair, aim, tuned))
        return found

    def of(number: int, free: Any) -> tuple[np.ndarray, np.ndarray]:
        return at(free, held[number])

    begun: list[Future[tuple[np.ndarray, np.ndarray]]] = []
    with one_thread(), ThreadPoolExecutor(1) as ahead:  # works while the other plans are held
        if rehearsal is not None:
            ahead.submit(lambda: at(start, _plain(*rehearsal())))
        for number, (own, scenario) in enumerate(pairs):
            held.append(_plain(own, scenario))
            shapes = tuple(leaf.shape for leaf in jax.tree.leaves(held[-1]))
            kind = jax.tree.structure(held[-1]), shapes
            first.setdefault(kind, number)
            begun.append(ahead.submit(of, number, start))
        for number, one in enumerate(begun):
            if number not in first.values():
                one.cancel()  # what is left all threads compute together
    done = {n: one.result() for n, one in enumerate(begun) if not (one.cancelled() or one.exception())}
    others = [number for number in range(len(held)) if number not in first.values()]

    def slope(free: Array) -> tuple[float, np.ndarray]:
        # One by one: a stack would be compiled for each number of plans of a shape, and solves its systems of
        # hundreds of equations no faster. The first of each shape come first, so that each kernel is compiled
        # once.
        found = done.copy() if np.array_equal(np.asarray(free), start) else {}
        with one_thread(), ThreadPoolExecutor(os.cpu_count()) as pool:
            for numbers in (list(first.values()), others):
                left = [number for number in numbers if number not in found]
                found |= zip(left, pool.map(partial(of, free=np.asarray(free)), left), strict=True)
        values, slopes = zip(*(found[number] for number in range(len(held))), strict=True)
        return float(np.mean(values)), np.mean(slopes, axis=0)

    return slope


def _plain(held: Held, scenario: Scenario) -> tuple[Held, Scenario]:
    """Return what a kernel takes: arrays of numpy, and a scenario without name and epoch."""
    plain: tuple[Held, Scenario] = jax.tree.map(np.asarray, (held, bare(scenario)))
    return plain


def _value_and_slope(
    free: jax.Array, held: Held, scenario: Scenario, aim: Objective, tuned: tuple[Parameter, ...]
) -> tuple[jax.Array, jax.Array]:
    """Return a plan's objective at free parameters, and its gradient; arguments as of `mean_slope`."""
    # That of weights and durations is known, and half of the kernel is what follows it.
    known = all(one.place.path[0] == "trajectory" for one in tuned)
    end = held_end(held, scenario) if known else None

    def value(free: jax.Array) -> jax.Array:
        numbers = {one.place: one.value(z) for one, z in zip(tuned, free, strict=True)}
        changed = with_numbers(scenario, numbers)
        return value_of(aim, replan_to(end, held, changed), changed)

    return jax.value_and_grad(value)(free)


def value_of(aim: Objective, trajectory: Trajectory, scenario: Scenario) -> jax.Array:
    """Return the value of an objective at a trajectory and its scenario, whose arrays are traced.

    Raises:
        TypeError: if it returns no single number, or asks for the values of what is traced.
    """
    try:
        found: Any = aim(trajectory, scenario)
    except (jax.errors.JAXTypeError, jax.errors.JAXIndexError) as error:
        raise TypeError(
            "objective: must be made of jax.numpy and jp.measures alone, since its arrays are traced for "
            f"slopes, without float(), if or numpy: {str(error).splitlines()[0]}"
        ) from error
    if not isinstance(found, int | float | np.generic | np.ndarray | jax.Array):
        raise TypeError(f"objective: must return a number, not {type(found).__name__}")
    if np.shape(found):
        raise TypeError(f"objective: must return a single number, not an array of shape {np.shape(found)}")
    return jnp.asarray(found, float)


_slope = quick_jit(_value_and_slope, static_argnums=(3, 4))
_slope_soon = quick_jit(_value_and_slope, level=0, static_argnums=(3, 4))
