"""Tasks that compile, ahead of need, the kernels that a search of the default planner may call.

Compiled kernels depend on the layout of a scene's numbers (`jaxplan.search.scene.Layout`) and on the shapes
of their arguments. The tasks made here call them with the shapes that searches use, and ignore the answers.
"""

from functools import partial

import numpy as np

from jaxplan.model.scenario import SearchSettings
from jaxplan.runtime.ahead import Task
from jaxplan.search.astar import make_root
from jaxplan.search.expansion import EDGE_INTERVALS, ONWARD_INTERVALS, Moves, expansion_call
from jaxplan.search.fields import no_fields
from jaxplan.search.kernel_calls import Call, Scenes
from jaxplan.search.mha import propose
from jaxplan.search.paths import (
    STRAIGHT_INTERVALS,
    edge_table,
    make_path,
    shortcuts,
    straight_call,
    straight_paths,
)
from jaxplan.search.scene import Scene
from jaxplan.search.smoothing import EDGES, padded, straight_bands
from jaxplan.search.trees import MANY, Space


def usual_tasks(scene: Scene, settings: SearchSettings, *, many: bool) -> list[Task]:
    """Return tasks that call what nearly every search calls first: straight motion and elastic band.

    Args:
        scene: a scene like those to be searched.
        settings: settings of the search.
        many: whether several scenes are searched together, by kernels that answer several calls.
    """
    scenes = _repeat_scene(scene, many)
    tasks: list[Task] = [partial(_run_call, scenes, straight_call(scene, np.zeros(STRAIGHT_INTERVALS)))]
    if any(np.any(rows.bound) for rows in scene.tables):  # else the straight motion is clear
        tasks.append(partial(straight_bands, scenes, [settings] * len(scenes.scenes)))
    return tasks


def band_task(scene: Scene, settings: SearchSettings) -> Task:
    """Return a task that checks a scene's straight motion and, where it is not clear, calls the band."""

    def search() -> None:
        scenes = Scenes([scene])
        if straight_paths(scenes, [settings])[0] is None:
            straight_bands(scenes, [settings])

    return search


def smoothing_tasks(scene: Scene, *, many: bool) -> list[Task]:
    """Return tasks that call what checks and shortens paths found by a search; not all searches need it.

    Args:
        scene: a scene like those to be searched.
        many: as for `usual_tasks`.
    """
    scenes = _repeat_scene(scene, many)
    ends = np.stack([scene.start_attitude] * 2), np.stack([scene.start_joints] * 2)
    cut_short: Task = partial(
        shortcuts, scenes, [make_path(scene, *ends)] * len(scenes.scenes), [0.0] * len(scenes.scenes)
    )
    return [partial(_run_call, scenes, Call(edge_table, (*padded(*ends, EDGES), 0.0))), cut_short]


def further_tasks(scene: Scene, settings: SearchSettings, *, many: bool) -> list[Task]:
    """Return tasks that call what harder searches need besides: expansions, trees, and smoothing.

    Args:
        scene: a scene like those to be searched.
        settings: settings of the search; they give the number of moves.
        many: as for `usual_tasks`.
    """
    scenes, root = _repeat_scene(scene, many), make_root(scene)
    calls: list[Call] = []
    for count in (1, MANY):
        states, steps = np.repeat(scene.ends[:1], count, axis=0), np.zeros((2, count))
        calls.append(Space(scene, settings).reach_call(states, states, steps, steps))
    moves = propose(scene, root, np.random.default_rng(0), settings, 0)
    clearance, fields = np.zeros(EDGE_INTERVALS + ONWARD_INTERVALS), no_fields(scene).table
    for count in (1, len(moves.turns)):  # without and with joints that follow a zone
        own = Moves(moves.turns, np.repeat(moves.options[:1], count, axis=0), moves.choice)
        calls.append(expansion_call(root.packed, own, clearance, fields, edges=True))
    return [*smoothing_tasks(scene, many=many), *(partial(_run_call, scenes, call) for call in calls)]


def _repeat_scene(scene: Scene, many: bool) -> Scenes:
    """Return the scene once, or twice for the kernels that answer several calls at once."""
    return Scenes([scene] * (2 if many else 1))


def _run_call(scenes: Scenes, call: Call) -> None:
    """Make the same call about each of the scenes, and discard the answers."""
    scenes.answers([call] * len(scenes.scenes))
