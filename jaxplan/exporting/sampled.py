"""A plan's motion on the instants that a file holds, checked before any file is begun."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from jaxplan import quaternion
from jaxplan.progress import progress_bar

if TYPE_CHECKING:
    from jaxplan.model.spacecraft import Spacecraft
    from jaxplan.planner import Plan
    from jaxplan.trajectory.curve import Samples, Trajectory

MOST_SAMPLES = 10_000_000
# Instants that are nearer to each other would coincide in files that count seconds from the year 2000.
SHORTEST_STEP = 1e-6
# Of one call, so that a long file needs no other kernels than a figure.
_CHUNK = 1024
# How far a matrix may be from a rotation; a trajectory's are within 1e-14.
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """A manoeuvre as a table.

    Attributes:
        name: of the scenario.
        spacecraft: that flies it.
        start: UTC of time zero, None where the file does without.
        times: (k,) s, rising from 0 to the duration.
        values: the trajectory there: radians, body axes.
        quaternions: (k, 4) body to inertial, scalar first, of unit length; neighbours have no change of sign.
    """

    name: str
    spacecraft: "Spacecraft"
    start: np.datetime64 | None
    times: np.ndarray
    values: "Samples"
    quaternions: np.ndarray

    def inertial(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (k, 3) in body axes, in inertial ones."""
        return np.asarray(np.einsum("kij,kj->ki", self.values.attitude, vectors))


def sample(plan: "Plan", start: np.datetime64 | None, times: np.ndarray) -> Sampled:
    """Evaluate a plan's trajectory.

    Args:
        plan: with a trajectory.
        start: UTC of time zero.
        times: (k,) s.

    Raises:
        ValueError: if a value is not a number, or a matrix no rotation.
    """
    assert plan.trajectory is not None
    values = _evaluated(plan.trajectory, times)
    _check(times, values)
    return Sampled(
        name=plan.scenario.name,
        spacecraft=plan.scenario.spacecraft,
        start=start,
        times=times,
        values=values,
        quaternions=quaternion.continuous(values.attitude),
    )


def instants(duration: float, step: float) -> np.ndarray:
    """(k,) s: multiples of the step, and the duration, in place of a multiple that all but coincides.

    Raises:
        ValueError: if the step is out of range.
    """
    if isinstance(step, bool) or not isinstance(step, int | float | np.integer | np.floating):
        raise ValueError(f"step_s = {step!r}: must be a number of seconds")
    if not SHORTEST_STEP <= step < np.inf:
        raise ValueError(f"step_s = {step}: must lie in [{SHORTEST_STEP:g}, inf)")
    if not duration / step < MOST_SAMPLES:
        raise ValueError(
            f"step_s = {step:g}: must be more than {duration / MOST_SAMPLES:.3g} for a manoeuvre of "
            f"{duration:.2f} s, since a file holds at most {MOST_SAMPLES} samples"
        )
    grid = step * np.arange(int(duration / step) + 1)
    apart = max(1e-3 * min(step, duration), SHORTEST_STEP)
    return np.append(grid[grid < duration - apart], duration) if duration > apart else np.zeros(1)


def _evaluated(trajectory: "Trajectory", times: np.ndarray) -> "Samples":
    from jaxplan.trajectory.curve import Samples

    parts = []
    with progress_bar("sampling", "samples", total=len(times)) as bar:
        for first in range(0, len(times), _CHUNK):
            parts.append(trajectory.sample(times[first : first + _CHUNK]))
            bar.update(min(_CHUNK, len(times) - first))
    return Samples(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Samples)})


def _check(times: np.ndarray, values: "Samples") -> None:
    """Refuse what no reader would notice: most formats hold a NaN or a matrix that does not turn."""
    for field in fields(values):
        finite = np.isfinite(getattr(values, field.name)).reshape(len(times), -1).all(axis=1)
        if not np.all(finite):
            raise ValueError(f"{field.name} is not finite at {times[np.argmin(finite)]:.6g} s")
    attitude = values.attitude
    off = np.abs(np.swapaxes(attitude, 1, 2) @ attitude - np.eye(3)).max(axis=(1, 2))
    good = (off <= _ROUNDING) & (np.linalg.det(attitude) > 0)
    if not np.all(good):
        raise ValueError(f"attitude is not a rotation at {times[np.argmin(good)]:.6g} s")
