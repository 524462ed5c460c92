"""What tuning may lower: functions of a trajectory and its scenario, in the units of files."""

from collections.abc import Callable, Mapping
from functools import cache

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.model.scenario import Scenario
from jaxplan.trajectory import Trajectory, measures

Objective = Callable[[Trajectory, Scenario], Array]

_DEGREE = np.pi / 180


def _margin(trajectory: Trajectory, scenario: Scenario) -> Array:
    if not scenario.zones:
        raise ValueError("objective smallest_margin needs zones, of which there are none")
    return measures.least_margin(trajectory, scenario.spacecraft, scenario.constraints) / _DEGREE


def _torque(trajectory: Trajectory, scenario: Scenario) -> Array:
    if scenario.spacecraft.inertia is None:
        raise ValueError("objective peak_torque needs spacecraft.inertia_kg_m2, which is not set")
    return measures.peak_torque(trajectory, scenario.spacecraft)


# Ready-made ones by name; the margin is to grow, so it counts negative.
OBJECTIVES: dict[str, Objective] = {
    "peak_acceleration": lambda t, s: measures.peak(t, "angular_acceleration") / _DEGREE,
    "smooth_peak_acceleration": lambda t, s: measures.power_mean(t, "angular_acceleration") / _DEGREE,
    "peak_rate": lambda t, s: measures.peak(t, "angular_velocity") / _DEGREE,
    "peak_jerk": lambda t, s: measures.peak(t, "angular_jerk") / _DEGREE,
    "peak_torque": _torque,
    "effort": lambda t, s: measures.effort(t) / _DEGREE**2,
    "roughness": lambda t, s: measures.roughness(t) / _DEGREE**2,
    "duration": lambda t, s: measures.duration(t),
    "smallest_margin": lambda t, s: -_margin(t, s),
}

_UNITS = {
    "peak_acceleration": "deg/s²",
    "smooth_peak_acceleration": "deg/s²",
    "peak_rate": "deg/s",
    "peak_jerk": "deg/s³",
    "peak_torque": "N m",
    "effort": "(deg/s²)² s",
    "roughness": "(deg/s³)² s",
    "duration": "s",
    "smallest_margin": "deg",
}


def objective_label(given: str | Mapping[str, float] | Objective) -> str:
    """What an objective is called on an axis: a single one with its unit, several with their weights.

    Args:
        given: see `make_objective`.
    """
    if callable(given):
        name = getattr(given, "__name__", "objective")
        return "objective" if name == "<lambda>" else name
    weights = as_weights(given)
    if list(weights.values()) == [1.0]:
        (name,) = weights
        return f"{_spelled(name)} ({_UNITS[name]})"
    return " + ".join(f"{weight:g} {_spelled(name)}" for name, weight in weights.items())


def _spelled(name: str) -> str:
    sign = "\N{MINUS SIGN}" if name == "smallest_margin" else ""
    return sign + name.replace("_", " ")


def make_objective(given: str | Mapping[str, float] | Objective) -> Objective:
    """The objective that is meant.

    Args:
        given: a name of `OBJECTIVES`, weights of several by name, or a function of a trajectory and its
            scenario.

    Raises:
        TypeError: if it is none of these.
        ValueError: if a name is not known, or a weight no finite number.
    """
    if callable(given):
        return given
    return _weighted(tuple(as_weights(given).items()))


def as_weights(given: object) -> dict[str, float]:
    """An objective that is a name or weights by name, as the latter.

    Raises:
        TypeError: if it is neither.
        ValueError: if a name is not known, or a weight no finite number.
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
    """The same function for the same weights, so that it is compiled once."""

    def objective(trajectory: Trajectory, scenario: Scenario) -> Array:
        parts = [weight * OBJECTIVES[name](trajectory, scenario) for name, weight in weights]
        return jnp.sum(jnp.stack(parts))

    return objective
