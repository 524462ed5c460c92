"""An independent optimiser of rest-to-rest slews of a platform alone: direct shooting, by scipy's SLSQP.

Accelerations (or torques) are constant on intervals of equal length; duration and accelerations are looked
for from many starts. Rates are held at the ends of intervals, where they are largest, as they are linear
between. With torques the rates are integrated, and held at the ends, too, where they are limited as well.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from jaxplan import so3

_SUBSTEPS = 4  # steps of the attitude's integration on an interval
_CLOSED = 1e-6  # rad and rad/s, by which attitude and rate may miss the end


@dataclass(frozen=True, kw_only=True, eq=False)
class Slew:
    """A rest-to-rest slew of a platform alone.

    Attributes:
        turn: (3,) rad, rotation vector from start to goal.
        push: (3,) rad/s^2 or N m, limits of accelerations or torques.
        rate: (3,) rad/s, limits of rates; infinite for none.
        inertia: (3, 3) kg m^2 where ``push`` is a torque, else None.
        intervals: number of those on which the pushes (accelerations or torques) are constant.
    """

    turn: np.ndarray
    push: np.ndarray
    rate: np.ndarray
    inertia: np.ndarray | None = None
    intervals: int = 24

    @cached_property
    def _kernels(self) -> tuple[Callable[..., Any], ...]:
        """Jitted functions of the unknowns, duration s and pushes as shares of their limits.

        They are errors of attitude and rate at the end, their slopes, slacks of the rate limits, and theirs.
        """
        with jax.enable_x64(True):
            goal = jnp.asarray(so3.exp(np.asarray(self.turn, float)))
            inertia = jnp.eye(3) if self.inertia is None else jnp.asarray(self.inertia, float)

        def acceleration(rate: Any, push: Any) -> Any:
            if self.inertia is None:
                return push
            return jnp.linalg.solve(inertia, push - jnp.cross(rate, inertia @ rate))

        def flown(x: Any) -> tuple[Any, Any, Any]:
            """Attitude error and rate at the end, and rates (N, 3) after each interval."""
            duration, pushes = x[0], x[1:].reshape(self.intervals, 3) * self.push
            step = duration / self.intervals / _SUBSTEPS

            def substep(state: Any, push: Any) -> tuple[Any, Any]:
                attitude, rate = state
                first = acceleration(rate, push)
                middle_rate = rate + first * step / 2
                middle = acceleration(middle_rate, push)
                turned = attitude @ so3.exp(middle_rate * step)
                return (turned, rate + middle * step), rate + middle * step

            start = jnp.eye(3), jnp.zeros(3)
            (attitude, rate), rates = jax.lax.scan(substep, start, jnp.repeat(pushes, _SUBSTEPS, axis=0))
            return so3.log(goal.T @ attitude), rate, rates[_SUBSTEPS - 1 :: _SUBSTEPS]

        def ends(x: Any) -> Any:
            missed, rate, _ = flown(x)
            return jnp.concatenate([missed, rate])

        def slack(x: Any) -> Any:
            share = flown(x)[2][:-1] / jnp.where(jnp.isfinite(self.rate), self.rate, 1e9)
            return jnp.concatenate([(1 - share).ravel(), (1 + share).ravel()])

        return tuple(jax.jit(f) for f in (ends, jax.jacfwd(ends), slack, jax.jacfwd(slack)))

    def quickest(self, starts: int, guess: float, seed: int = 0) -> float:
        """Least duration, s, found from a number of random starts about a first guess of it, s."""
        rng, best = np.random.default_rng(seed), np.inf
        with jax.enable_x64(True):
            ends, ends_slope, slack, slack_slope = self._kernels
            constraints = [{"type": "eq", "fun": ends, "jac": ends_slope}]
            if np.any(np.isfinite(self.rate)):
                constraints.append({"type": "ineq", "fun": slack, "jac": slack_slope})
            slope = np.eye(1, 1 + 3 * self.intervals)[0]
            bounds = [(0.2 * guess, 5 * guess)] + 3 * self.intervals * [(-1.0, 1.0)]
            for _ in range(starts):
                x = np.concatenate([[guess * rng.uniform(0.9, 1.3)], self._start(rng)])
                found = minimize(
                    lambda x: x[0],
                    x,
                    jac=lambda _: slope,
                    bounds=bounds,
                    constraints=constraints,
                    method="SLSQP",
                    options={"maxiter": 150, "ftol": 1e-7},
                )
                if np.all(np.abs(np.asarray(ends(found.x))) < _CLOSED):
                    within = not len(constraints) > 1 or np.all(np.asarray(slack(found.x)) > -1e-6)
                    best = min(best, found.x[0]) if within else best
        return float(best)

    def _start(self, rng: np.random.Generator) -> np.ndarray:
        """Draw first pushes, flat, as shares of their limits: of a turn about one axis, and slow waves."""
        share = self.turn / np.max(np.abs(self.turn))
        places = (np.arange(self.intervals) + 0.5) / self.intervals
        pushes = np.where(places < 0.5, 1.0, -1.0)[:, None] * share * rng.uniform(0.2, 1)
        for wave in range(1, 4):
            pushes = pushes + np.cos(wave * np.pi * places)[:, None] * rng.normal(size=3) * 0.5
        return np.clip(pushes, -1, 1).ravel()
