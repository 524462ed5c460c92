"""The mean objective of several plans and its gradient, as trajectories follow the numbers that are tuned."""

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

import jax
import numpy as np

from jaxplan.model.scenario import Scenario
from jaxplan.runtime.quick_jit import quick_jit
from jaxplan.runtime.threads import one_thread
from jaxplan.scenario.numbers import with_numbers
from jaxplan.sensitivity import Held, replan
from jaxplan.tuning.objectives import Objective
from jaxplan.tuning.parameters import Parameter


@dataclass(frozen=True, kw_only=True, eq=False)
class Bundle:
    """Held plans with their scenarios, and the objective of their trajectories.

    Attributes:
        held: of each plan.
        rounds: the plans' numbers: the first of each shape, then the others.
        aim: the objective.
        tuned: what it is a function of.
    """

    held: tuple[tuple[Held, Scenario], ...]
    rounds: tuple[tuple[int, ...], ...]
    aim: Objective
    tuned: tuple[Parameter, ...]

    @classmethod
    def of(cls, pairs: Iterable[tuple[Held, Scenario]], aim: Objective, tuned: tuple[Parameter, ...]) -> Self:
        """The bundle of what is held of plans, each with its scenario."""
        held = tuple(jax.tree.map(np.asarray, (own, bare(scenario))) for own, scenario in pairs)
        first: dict[Any, int] = {}
        for number, pair in enumerate(held):
            shapes = tuple(leaf.shape for leaf in jax.tree.leaves(pair))
            first.setdefault((jax.tree.structure(pair), shapes), number)
        others = tuple(number for number in range(len(held)) if number not in first.values())
        return cls(held=held, rounds=(tuple(first.values()), others), aim=aim, tuned=tuned)

    def slope(self, free: jax.Array) -> tuple[float, np.ndarray]:
        """The mean objective and its gradient."""

        def of(number: int) -> tuple[np.ndarray, np.ndarray]:
            with jax.enable_x64(True):  # a thread has its own setting
                found: tuple[np.ndarray, np.ndarray] = jax.device_get(
                    _slope(free, *self.held[number], self.aim, self.tuned)
                )
            return found

        # One by one: a stack would be compiled for each number of plans of a shape, and solves its systems of
        # hundreds of equations no faster. The first round compiles each kernel once.
        found: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        with one_thread(), ThreadPoolExecutor(os.cpu_count()) as pool:
            for numbers in self.rounds:
                found |= zip(numbers, pool.map(of, numbers), strict=True)
        values, slopes = zip(*(found[number] for number in range(len(self.held))), strict=True)
        return float(np.mean(values)), np.mean(slopes, axis=0)


def bare(scenario: Scenario) -> Scenario:
    """Without what is no number, for which kernels would be compiled anew."""
    return replace(scenario, name="", epoch=None)


@partial(quick_jit, static_argnums=(3, 4))
def _slope(
    free: jax.Array, held: Held, scenario: Scenario, aim: Objective, tuned: tuple[Parameter, ...]
) -> tuple[jax.Array, jax.Array]:
    """The objective of a plan, and its gradient."""

    def value(free: jax.Array) -> jax.Array:
        numbers = {one.place: one.value(z) for one, z in zip(tuned, free, strict=True)}
        changed = with_numbers(scenario, numbers)
        return aim(replan(held, changed), changed)

    return jax.value_and_grad(value)(free)
