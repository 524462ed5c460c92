"""Definition of a study: its scenes, and by which planner and with which settings they are planned.

A study's table is the same whatever the workers, and however often it is interrupted. For that, the random
numbers that plan a scene follow from the scene's own seed and settings, no scene has a time limit, and it is
fixed which scenes are planned together. These form a *block*: scenes 0 to 15 of a study, 16 to 31, and so on.
A *chunk* is some blocks that are sent to a worker together.
"""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import numpy as np

from jaxplan.cases import RANDOM_KINDS, random_scenario
from jaxplan.model.scenario import Scenario
from jaxplan.planner import Plan
from jaxplan.planner.entry_points import as_filed
from jaxplan.runtime.arguments import several
from jaxplan.schema import ScenarioError, scenario_to_dict, with_settings
from jaxplan.search import PLANNERS
from jaxplan.version import __version__

BLOCK = 16
"""Scenes that are planned together. More make a study little quicker on a processor, but its end ragged."""
_LARGEST_SEED = 2**63 - 1  # largest seed, which still fits the 64-bit integers of data frames
_MAX_SCENES = 2**31  # a study has fewer scenes, since it numbers them with 32 bits
# Settings that users may not change, since a study sets them itself, with the reason.
_FIXED_SETTINGS = {
    "search.method": "given by planner",
    "search.time_limit_s": (
        "off in studies, where no result depends on the machine's load; search.max_expansions limits searches"
    ),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """The scenes of a study, and how they are planned.

    Attributes:
        kind: kind of the random scenes; None where scenarios are given.
        scenes: the seeds of random scenes, or the scenarios.
        planner: name of the search method in `PLANNERS`.
        settings: scenario settings to change, by dotted names in a scenario file's keys and units.
        version: of jaxplan where the task was made; workers of another version refuse it.
        columns: functions that compute a number from a certified plan, by the names of their columns.
    """

    kind: str | None
    scenes: Sequence[int] | Sequence[Scenario]
    planner: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    version: str = __version__
    columns: Mapping[str, Callable[[Plan], Any]] = field(default_factory=dict)

    @property
    def examples(self) -> int:
        """Number of scenes on which settings are checked beforehand: one if they are drawn, else all."""
        return len(self.scenes) if self.kind is None else 1

    def scenario(self, place: int) -> Scenario:
        """The scene at a place, from 0, with the study's settings and planner and without a time limit."""
        scene = self.scenes[place]
        if not isinstance(scene, Scenario):
            scene = random_scenario(scene, str(self.kind))
        changed = with_settings(scene, self.settings)
        return replace(changed, search=replace(changed.search, method=self.planner, time_limit=math.inf))

    def describe(self) -> dict[str, Any]:
        """Description of the study for its folder, ready for JSON; equal descriptions mean equal tables."""
        return {
            "jaxplan": self.version,
            "kind": self.kind,
            "planner": self.planner,
            "settings": dict(self.settings),
            "scenes": len(self.scenes),
            **({"columns": list(self.columns)} if self.columns else {}),
            **(
                {"scenarios": _digest(self.scenes)}
                if self.kind is None
                else {"seeds": _consecutive_runs(self.scenes)}
            ),
        }

    def first(self, scenes: int) -> "Task":
        """The task with only its first scenes, as many as the argument says."""
        return replace(self, scenes=self.scenes[:scenes])

    def chunk(self, blocks: Iterable[int]) -> "Chunk":
        """Make a chunk of the blocks with the given numbers."""
        every = range(len(self.scenes))
        numbers = tuple(n for block in blocks for n in every[block * BLOCK : (block + 1) * BLOCK])
        scenes: tuple[Any, ...] = tuple(self.scenes[number] for number in numbers)
        return Chunk(**vars(replace(self, scenes=scenes)), numbers=numbers)


@dataclass(frozen=True, kw_only=True, eq=False)
class Chunk(Task):
    """Scenes of a study as they are sent to a worker: whole blocks, or a single scene.

    Attributes:
        numbers: the scenes' places in the study, from 0.
        deaths: number of workers that have died while they planned this chunk and nothing else.
        apart: whether it is a single scene that is planned by itself because its block killed its workers.
    """

    numbers: tuple[int, ...]
    deaths: int = 0
    apart: bool = False

    def head(self, place: int) -> dict[str, Any]:
        """The first columns, scene to planner, of the row of the scene at a place of the chunk."""
        scene = self.scenes[place]
        given = isinstance(scene, Scenario)
        return {
            "scene": self.numbers[place],
            "seed": None if given else scene,
            "name": scene.name if isinstance(scene, Scenario) else f"{self.kind} {scene}",
            "kind": self.kind,
            "planner": self.planner,
        }

    def blocks(self) -> list["Chunk"]:
        """Divide the chunk into its blocks, each a chunk."""
        groups = groupby(range(len(self.numbers)), lambda place: self.numbers[place] // BLOCK)
        return [self._subset(places) for _, places in groups]

    def singles(self) -> list["Chunk"]:
        """Divide the chunk into its scenes, each a chunk that is marked `apart`."""
        parts = (self._subset([place]) for place in range(len(self.numbers)))
        return [replace(part, apart=True) for part in parts]

    def _subset(self, places: Iterable[int]) -> "Chunk":
        """Make a chunk of the scenes at some places of this one."""
        pairs: list[tuple[int, Any]] = [(self.numbers[place], self.scenes[place]) for place in places]
        numbers, scenes = zip(*pairs, strict=True)
        return replace(self, numbers=numbers, scenes=scenes)


def make_task(
    scenarios_or_seeds: Iterable[Scenario] | Iterable[int],
    kind: str | None,
    planner: str,
    settings: Mapping[str, Any] | None,
    columns: Mapping[str, Callable[[Plan], Any]] | None = None,
) -> Task:
    """Check the arguments of `run_study` of the same names, and make the task of them.

    Raises:
        TypeError: for scenes that are neither scenarios nor seeds.
        ValueError: for an unknown kind or planner, wrong settings, or seeds that are wrong or come twice.
    """
    if planner not in tuple(PLANNERS):  # a tuple, since other values may not be hashable
        raise ValueError(f"planner = {planner!r}: must be one of {', '.join(PLANNERS)}")
    given = several("scenarios_or_seeds", scenarios_or_seeds, "scenarios or seeds, such as range(100)")
    scenes: Sequence[Any] = given if isinstance(given, range) else tuple(given)
    if (
        isinstance(scenes, range)
        and not -_MAX_SCENES < (scenes.stop - scenes.start) // scenes.step < _MAX_SCENES
    ):
        raise ValueError(f"scenarios_or_seeds = {scenes}: a study has less than {_MAX_SCENES} scenes")
    if not len(scenes):
        raise ValueError("scenarios_or_seeds is empty: there is nothing to plan")
    if isinstance(scenes[0], Scenario):
        if kind is not None:
            raise ValueError(f"kind = {kind!r}: only seeds have one, but scenarios are given")
        scenes = tuple(
            as_filed(f"scenarios_or_seeds[{number}]", scene) for number, scene in enumerate(scenes)
        )
    else:
        kind = "keep_out" if kind is None else kind
        if kind not in RANDOM_KINDS:
            raise ValueError(f"kind = {kind!r}: must be one of {', '.join(RANDOM_KINDS)}")
        scenes = _check_seeds(scenes)
    task = Task(
        kind=kind,
        scenes=scenes,
        planner=planner,
        settings=_settings_to_json(settings or {}),
        columns=dict(columns or {}),
    )
    for place in range(task.examples):
        task.scenario(place)
    return task


def _settings_to_json(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Check settings and convert them to JSON's types, sorted by name, so that equal ones are equal texts.

    Raises:
        TypeError: if they are not a dict.
        ScenarioError: for a setting that the study sets itself, or a value that JSON cannot hold.
    """
    if not isinstance(settings, Mapping):
        raise TypeError(
            f'settings must be a dict such as {{"search.seed": 1}}, not {type(settings).__name__}'
        )
    faults = [
        f"{name}: {_FIXED_SETTINGS[name]}" for name in sorted(map(str, settings)) if name in _FIXED_SETTINGS
    ]
    if faults:
        raise ScenarioError(faults, "settings")
    texts = {
        # infinity as files write it
        str(name): "inf" if isinstance(value, float) and value == math.inf else value
        for name, value in settings.items()
    }
    try:
        plain: dict[str, Any] = json.loads(json.dumps(texts, sort_keys=True, default=_unwrap_numpy))
    except (TypeError, ValueError) as error:
        raise ScenarioError([str(error)], "settings") from error
    return plain


def _unwrap_numpy(value: object) -> Any:
    """Convert a number or array of numpy to Python's own types; raises a TypeError for anything else."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{value!r} is nothing that a scenario file holds")


def _check_seeds(scenes: Sequence[Any]) -> Sequence[int]:
    """Check that seeds are integers in their range, none of them twice.

    Returns:
        The seeds as a range, if they were one, or else a tuple.

    Raises:
        TypeError: for a seed that is not an integer.
        ScenarioError: for seeds out of range, or given twice.
    """
    faults: list[str] = []
    first: dict[int, int] = {}
    whole = isinstance(scenes, range)  # then it is enough to check its two ends
    for number in (0, len(scenes) - 1) if whole else range(len(scenes)):
        seed = scenes[number]
        place = f"scenarios_or_seeds[{number}] = {seed!r:.40}"
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer):
            raise TypeError(f"{place}: must be a seed, an integer of at least 0")
        if seed < 0:
            faults.append(f"{place}: must be at least 0")
        elif seed > _LARGEST_SEED:
            faults.append(f"{place}: must be at most {_LARGEST_SEED}")
        elif first.setdefault(int(seed), number) != number:
            faults.append(f"{place}: the same as scenarios_or_seeds[{first[int(seed)]}]")
    if faults:
        raise ScenarioError(faults, "the study")
    return scenes if whole else tuple(map(int, scenes))


def _consecutive_runs(seeds: Sequence[Any]) -> list[list[int]]:
    """Divide seeds into runs of consecutive numbers; returns a pair [first, last] for each run."""
    if isinstance(seeds, range) and seeds.step == 1:
        return [[seeds[0], seeds[-1]]]
    runs: list[list[int]] = []
    for seed in seeds:
        if runs and seed == runs[-1][1] + 1:
            runs[-1][1] = seed
        else:
            runs.append([seed, seed])
    return runs


def _digest(scenarios: Sequence[Any]) -> str:
    """SHA-256 hash of scenarios, as files would hold them, in hexadecimal."""
    digest = hashlib.sha256()
    for scenario in scenarios:
        digest.update(json.dumps(scenario_to_dict(scenario), sort_keys=True).encode() + b"\n")
    return digest.hexdigest()
