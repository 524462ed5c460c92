"""Compile ahead of need the kernels that plans, batches and gradients will use.

The first plan of a kind compiles for seconds and then computes for milliseconds. Where that delay matters, as
in a service or before a demonstration, the compilation is done beforehand; where compiled code is kept
between processes, once is enough for all of them.
"""

from dataclasses import replace
from typing import Any

import jax
import numpy as np

from jaxplan.gradients import differentiable
from jaxplan.model.goals import GivenState, Targets
from jaxplan.model.robust import Robust
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepOut
from jaxplan.planner.entry_points import as_filed, plan
from jaxplan.planner.precompile import every_task
from jaxplan.runtime.ahead import side_by_side
from jaxplan.runtime.arguments import expect_any
from jaxplan.runtime.progress import progress_bar
from jaxplan.runtime.workers import one_thread
from jaxplan.trajectory import measures


def warm_up(
    problem: Scenario | Spacecraft, *, gradients: bool = False, batches: bool = False, progress: bool = True
) -> None:
    """Compile the kernels that plans of a kind need, several side by side.

    All scenarios with the same number of devices use the same kernels, as long as their zones are padded to
    the same number: 8, 16, 32 and so on. Zones in groups and zones about other devices are counted apart from
    the rest. So one scenario stands for all like it, whatever their numbers, duration and goals, and its
    start need not be a possible one. Of the search methods "mha" and "rrt_connect" are compiled completely;
    of the others only what they share with these.

    Args:
        problem: a scenario; or a spacecraft, which stands for its scenarios of up to 8 zones without groups,
            with and without a tube (`Scenario.robust`).
        gradients: also compile the kernels of `jaxplan.differentiable` for the plan of the scenario itself.
            Which these are depends on its nodes and on which limits bind.
        batches: also compile the kernels with which `plan_batch` and `run_study` answer several searches at
            once.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.

    Raises:
        PlanningError: if `gradients` is set for a scenario that has no plan.
        TypeError: if `problem` is neither a scenario nor a spacecraft, or a flag is not a bool.
        ValueError: if `gradients` is set for a spacecraft; `ScenarioError` for values that a scenario file
            may not have.

    Example:
        >>> jp.warm_up(jp.paper_case(2), gradients=True)
    """
    expect_any("problem", problem, (Scenario, Spacecraft), "a Scenario or a Spacecraft")
    for name, flag in (("gradients", gradients), ("batches", batches), ("progress", progress)):
        if not isinstance(flag, bool):
            raise TypeError(f"{name} must be True or False, not {flag!r}")
    if gradients and isinstance(problem, Spacecraft):
        raise ValueError("gradients = True: needs a scenario, since what they compile follows from its plan")
    stated = [problem] if isinstance(problem, Scenario) else _still_scenarios(problem)
    scenarios = [as_filed("problem", scenario) for scenario in stated]
    forms = (False, True) if batches else (False,)
    tasks = [task for many in forms for scenario in scenarios for task in every_task(scenario, many=many)]
    with one_thread(), progress_bar("warming up", "kernels", total=len(tasks), shown=progress) as bar:
        side_by_side(tasks, bar.update)
        if gradients:
            bar.step("gradients")
            _compile_gradients(scenarios[0])


def _compile_gradients(scenario: Scenario) -> None:
    """Plan a scenario and take one gradient of its trajectory, so that all kernels for that are compiled."""
    made = plan(scenario, progress=False)
    trajectory = differentiable(made)
    slope: Any = jax.grad(lambda own: measures.effort(trajectory(own)), allow_int=True)(made.scenario)
    jax.block_until_ready(slope)


def _still_scenarios(spacecraft: Spacecraft) -> list[Scenario]:
    """Return small scenarios in which a spacecraft stays where it is: without zones, and with a single zone.

    The zone lies behind a device. Masks have more rows with a tube about the plan; if that changes the shape
    of the constraint arrays, each scenario is returned a second time with a tube.
    """
    joints = np.mean(spacecraft.joint_ranges, axis=-1)
    rest = GivenState(rotation_vector=np.zeros(3), joints=joints)
    sights = np.asarray(spacecraft.boresights(np.eye(3), joints))
    goal = Targets(directions=sights[: len(spacecraft.terminals)]) if spacecraft.terminals else rest
    free = Scenario(name="warm-up", spacecraft=spacecraft, start=rest, goal=goal)
    zones = [KeepOut(name="behind", direction=-sight, half_angle=0.1) for sight in sights]
    found = [free, *(replace(free, keep_out=(zone,)) for zone in zones[:1])]
    within = [replace(own, robust=Robust()) for own in found]
    shapes = [own.constraints.bound.shape for own in found]
    return [
        *found,
        *(own for own, shape in zip(within, shapes, strict=True) if own.constraints.bound.shape != shape),
    ]
