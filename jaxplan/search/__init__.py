"""Step 2: find a sequence of clear states from start to goal. All planners have the same call and result.

Terms of this package:

- *state*: attitude relative to the start, as a unit quaternion with the scalar first, and all joints: a row
  of 4 + 2n numbers, where 2n stands for the number of joints, drives counted too.
- *scene*: one search problem as numbers (`scene`).
- *step*: unit of cost, a number of rad of the platform's rotation or of a joint (`SearchSettings`). A motion
  costs the largest number of steps over platform and joints.
- *straight*: of a motion, with platform and joints turning at constant rates from one state to the other.
- *edge*: a straight motion between neighbouring nodes of a path.
- *clear*: of a motion, along which all constraints hold with the clearance that is wanted there.
- *expansion*: computing the children of one node, the unit of a search's effort.
- *run*: a search under way, which asks for one kernel *call* after the other (`kernel_calls`).

`search_batch` takes many scenes at once, and each search method handles together its scenes that have the
same array shapes. A method has a few stages, such as straight motions, elastic bands, searches and smoothing;
each stage is run for all scenes that have no result yet.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pkgutil import resolve_name

import jax
import numpy as np

from jaxplan.model.scenario import SEARCH_METHODS, SearchSettings
from jaxplan.model.status import Status
from jaxplan.runtime.batching import Seconds, grouped, parts
from jaxplan.runtime.garbage import uncollected
from jaxplan.search.barriers import Barrier, find_barrier, most_obstructive
from jaxplan.search.joint_barriers import JointBarrier, find_joint_barrier, narrowest, short_of
from jaxplan.search.kernel_calls import POOL, Scenes, SearchRun, picked
from jaxplan.search.scene import Scene, SearchResult, derived_seed, in_narrow_zones, make_scene, narrow_zone

Planner = Callable[[Scene, SearchSettings], SearchResult]
Method = Callable[[Scenes, Sequence[SearchSettings]], list[SearchResult]]

_METHODS: dict[str, Method | str] = {
    "mha": "jaxplan.search.mha:search",
    "mha-paper": "jaxplan.paper.search:search_mha",
    "wastar": "jaxplan.paper.search:search_wastar",
    "rrt_star": "jaxplan.paper.rrt_star:search",
    "rrt_connect": "jaxplan.search.rrt_connect:search",
}
"""Search methods by name; those of jaxplan as "module:function", imported when they are first used."""


def _resolve_method(name: str) -> Method:
    """Return the search function of the method of a name, imported if it has not been yet."""
    known = _METHODS[name]
    if not isinstance(known, str):
        return known
    with uncollected():
        found: Method = resolve_name(known)
    return found


def _search_scene(method: str, scene: Scene, settings: SearchSettings) -> SearchResult:
    """Search one scene by the method of the given name, whatever method the settings name."""
    return search_batch([scene], [replace(settings, method=method)])[0]


PLANNERS: dict[str, Planner] = {method: partial(_search_scene, method) for method in _METHODS}
"""Planners by name: functions from a scene and settings, whose `method` is ignored, to a result."""


def add_planner(method: str, search: Callable[[Scene, SearchSettings], SearchResult | SearchRun]) -> None:
    """Add a search method of one's own, which scenarios of this process can then name in ``search.method``.

    Args:
        method: its name.
        search: function from a scene and settings to the result. It may instead return a
            `jaxplan.runtime.batching.Run` that also has ``result()``, and which asks for one
            `jaxplan.search.kernel_calls.Call` after the other, so that the calls of many searches are
            answered together.

    Raises:
        ValueError: if there is a planner of that name.
    """
    if method in PLANNERS:
        raise ValueError(f"method = {method!r}: there is a planner of that name")
    _METHODS[method], PLANNERS[method] = partial(_run_added_planner, search), partial(_search_scene, method)
    SEARCH_METHODS.append(method)


def remove_planner(method: str) -> None:
    """Remove a planner that `add_planner` added."""
    del _METHODS[method], PLANNERS[method]
    SEARCH_METHODS.remove(method)


def _run_added_planner(
    search: Callable[[Scene, SearchSettings], SearchResult | SearchRun],
    scenes: Scenes,
    settings: Sequence[SearchSettings],
) -> list[SearchResult]:
    """Search scenes by an added planner; where its `search` returns a run, drive that to its end."""
    answers = []
    for number, (scene, own) in enumerate(zip(scenes.scenes, settings, strict=True)):
        with scenes.seconds.shared([number]):
            answers.append(search(scene, own))
    runs = [None if isinstance(answer, SearchResult) else answer for answer in answers]
    under_way = [number for number, run in enumerate(runs) if run is not None]
    scenes.part(under_way).run([run for run in runs if run is not None])
    return [answer if isinstance(answer, SearchResult) else answer.result() for answer in answers]


def search_batch(
    scenes: Sequence[Scene], settings: Sequence[SearchSettings], seconds: Seconds | None = None
) -> list[SearchResult]:
    """Search many scenes, each by the method of its settings.

    Args:
        scenes: the problems; those with the same method and equal array shapes share their kernel calls.
        settings: the settings of each search. A time limit is a scene's share of the whole: a search ends
            after that time multiplied by the number of scenes.
        seconds: an object to which the time of each search is added, s; the time of calls answered together
            is shared out equally. None to measure nothing.

    Returns:
        The results in the order of the scenes. They agree with those of searches one by one, as long as no
        time limit ends a search. A scene whose start or goal is not made of finite numbers gets the status
        NODE_LIMIT and no path.

    Raises:
        ValueError: if there are not as many settings as scenes.
    """
    if len(settings) != len(scenes):
        raise ValueError(f"settings: must be one a scene, {len(scenes)}, not {len(settings)}")
    results = [SearchResult(status=Status.NODE_LIMIT, path=None, expansions=0)] * len(scenes)
    finite = [number for number, scene in enumerate(scenes) if np.isfinite(scene.straight_steps)]
    share = [replace(own, time_limit=own.time_limit * len(scenes)) for own in settings]
    groups = grouped(finite, lambda number: (settings[number].method, scenes[number].packed[0]))
    for numbers in (part for group in groups for part in parts(picked(finite, group), POOL)):
        together = Scenes(picked(scenes, numbers))
        search = _resolve_method(settings[numbers[0]].method)
        with jax.enable_x64(True):
            found = search(together, picked(share, numbers))
        for number, result, spent in zip(numbers, found, together.seconds.spent, strict=True):
            results[number] = result
            if seconds is not None:
                seconds.spent[number] += spent
    return results


__all__ = [
    "PLANNERS",
    "Barrier",
    "JointBarrier",
    "Planner",
    "Scene",
    "SearchResult",
    "add_planner",
    "derived_seed",
    "find_barrier",
    "find_joint_barrier",
    "in_narrow_zones",
    "make_scene",
    "most_obstructive",
    "narrow_zone",
    "narrowest",
    "remove_planner",
    "search_batch",
    "short_of",
]
