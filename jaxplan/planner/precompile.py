"""Tasks that compile the kernels of plans before they are needed.

The first plan of a kind compiles for seconds and computes for milliseconds. While step 1 compiles its own
kernel, the kernels of search and fit that nearly every plan of the kind needs are compiled beside it
(`usual_tasks`). `jaxplan.warm_up` compiles all that any plan of the kind may need (`every_task`).
"""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from jaxplan.model.goals import GivenState
from jaxplan.model.limits import timed_limits
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario, moves
from jaxplan.planner.moving import swept
from jaxplan.planner.steps import find_goals, soonest_task, tracking_task
from jaxplan.runtime.ahead import Task
from jaxplan.search import Scene, make_scene
from jaxplan.search.precompile import band_task, smoothing_tasks
from jaxplan.search.precompile import further_tasks as further_search
from jaxplan.search.precompile import usual_tasks as usual_search
from jaxplan.trajectory import kernel_tasks

_MIN_COUNT_FOR_SMOOTHING = 16  # scenarios of a kind, some of which need more than the elastic band
_begun_kinds: set[Hashable] = set()  # kinds of scenarios whose tasks have been handed out in this process


def usual_tasks(scenarios: Sequence[Scenario]) -> list[Task]:
    """Return tasks that compile the kernels that search and fit of scenarios will need.

    Args:
        scenarios: to be planned together, whose starts are valid.

    Returns:
        The tasks in the order of need. Kinds of scenarios for which this process has handed out tasks before
        get none.
    """
    kinds: dict[Hashable, list[Scenario]] = {}
    for scenario in scenarios:
        kinds.setdefault(_kernel_key(scenario), []).append(scenario)
    tasks: list[Task] = []
    for kind, alike in kinds.items():
        many = len(alike) > 1
        if (kind, many) not in _begun_kinds:
            _begun_kinds.add((kind, many))
            tasks += _tasks_for_one(alike[0], many)
            if len(alike) >= _MIN_COUNT_FOR_SMOOTHING and alike[0].search.method == "mha":
                tasks += smoothing_tasks(_scene_to_start(alike[0]), many=many)
    return tasks


def _tasks_for_one(scenario: Scenario, many: bool) -> list[Task]:
    """Return tasks for one scenario; `many` says whether plans are made many together, as of `every_task`.

    The kernels of step 1 come first: the rates at goals that follow moving targets, and the search for goals
    of least time, which takes the longest to compile. Step 2 needs the straight motion first; its other
    kernels take long, too, and are not needed where that motion is clear. With a single scenario they wait
    for the goal of least rotation, see `further_tasks`.
    """
    soonest = soonest_task(scenario, _typical_end(scenario))
    tracking = tracking_task(scenario, _typical_end(scenario))
    fits = kernel_tasks(scenario.usable, scenario.trajectory)
    search = usual_search_of(scenario, many)
    later = [] if soonest and not many and not moves(scenario) else search[1:]
    return [*filter(None, (tracking, soonest)), *search[:1], *fits, *later]


def further_tasks(scenario: Scenario, nearest: Goal) -> list[Task]:
    """Return tasks that can be prepared once the goal of least rotation, `nearest`, is known.

    If the straight motion to it is blocked, so mostly is that to the goal of least time, which comes later.
    """
    if scenario.search.method != "mha":
        return []
    return [band_task(make_scene(scenario, nearest, swept(scenario, nearest)), scenario.search)]


def every_task(scenario: Scenario, *, many: bool) -> list[Task]:
    """Return tasks that compile all kernels that plans of scenarios of this kind may need, for any duration.

    Args:
        scenario: any scenario of the kind.
        many: whether plans are made many together; else one scenario at a time.
    """
    _begun_kinds.add((_kernel_key(scenario), many))
    tasks: list[Task] = []
    for duration in ("minimum", scenario.trajectory.duration):
        timed = replace(scenario, trajectory=replace(scenario.trajectory, duration=duration))
        tasks.append(partial(find_goals, timed, _typical_end(timed)))  # of least time, or of the least turn
        tasks += kernel_tasks(timed.usable, timed.trajectory)
    tasks += usual_search_of(scenario, many)
    if scenario.search.method in ("mha", "rrt_connect"):
        tasks += further_search(_scene_to_start(scenario), scenario.search, many=many)
    return tasks


def usual_search_of(scenario: Scenario, many: bool) -> list[Task]:
    """Return the usual compile tasks of a scenario's search; none for methods other than "mha"."""
    if scenario.search.method != "mha":
        return []
    return usual_search(_scene_to_start(scenario), scenario.search, many=many)


def _kernel_key(scenario: Scenario) -> Hashable:
    """Return a key that is equal for scenarios that need the same kernels, except where sizes are unusual."""
    craft, rows, fit = scenario.usable, scenario.constraints, scenario.trajectory
    single, (loads, _) = int(np.sum(rows.single)), timed_limits(craft)
    wheels = 0 if craft.wheel_array is None else len(craft.wheel_array.rows)
    stages = None if craft.stages is None else craft.stages.turned
    return (
        len(craft.terminals), len(craft.drives), len(craft.instruments),
        rows.bound.shape, single, rows.inner, rows.nested,
        scenario.search.method, fit.method, fit.duration if isinstance(fit.duration, str) else "given",
        tuple(limit.quantity.name for limit in loads), len(craft.wheels), wheels, stages, moves(scenario),
        not isinstance(scenario.asked, GivenState) and (scenario.asked.moves, scenario.asked.criterion),
    )  # fmt: skip


def _scene_to_start(scenario: Scenario) -> Scene:
    """Return a search problem from a scenario's start to its start, with its own searches' array shapes."""
    start = scenario.start
    goal = Goal(
        attitude=np.asarray(start.attitude, float),
        joints=np.asarray(start.joints, float),
        slew_angle=0.0,
        time=_typical_end(scenario) or 0.0,
    )
    return make_scene(scenario, goal, swept(scenario, goal))


def _typical_end(scenario: Scenario) -> float | None:
    """Return an end time that a manoeuvre might have, s; None where nothing moves."""
    if not moves(scenario):
        return None
    duration = scenario.trajectory.duration
    return 1.0 if isinstance(duration, str) else float(duration)
