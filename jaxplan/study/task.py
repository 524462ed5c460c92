"""What a study plans: which scenes, by which planner, with which settings.

A scene's random streams follow from its own seed and settings, never from where or when it is planned, no
scene has a time limit, and which scenes are planned together is fixed (`blocks`): so a study's table is the
same whoever plans it, and however often it is interrupted.
"""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jaxplan.cases import RANDOM_KINDS, random_scenario
from jaxplan.model.scenario import Scenario
from jaxplan.planner.runs import as_filed
from jaxplan.runtime.arguments import several
from jaxplan.schema import ScenarioError, scenario_to_dict, with_settings
from jaxplan.search import PLANNERS
from jaxplan.version import __version__

_LARGEST_SEED = 2**63 - 1  # that data frames have room for
_MOST_SCENES = 2**31

# What a study gives itself.
_OWN = {
    "search.method": "given by planner",
    "search.time_limit_s": (
        "off in studies, where no result depends on the machine's load; search.max_expansions limits searches"
    ),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """The scenes of a study, and how they are planned.

    Attributes:
        kind: of random scenes; None where scenarios are given.
        scenes: seeds, or scenarios.
        planner: its name in `PLANNERS`.
        settings: that differ from the scenes' own, by dotted names in a file's keys and units.
    """

    kind: str | None
    scenes: Sequence[int] | Sequence[Scenario]
    planner: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def describe(self) -> dict[str, Any]:
        """What tells this study from others, for a file: two with the same have the same table."""
        return {
            "jaxplan": __version__,
            "kind": self.kind,
            "planner": self.planner,
            "settings": dict(self.settings),
            "scenes": len(self.scenes),
            **({"scenarios": _digest(self.scenes)} if self.kind is None else {"seeds": _runs(self.scenes)}),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Chunk:
    """Scenes as they are sent to a worker: some blocks of those that are planned together, or one scene.

    Attributes:
        numbers: their places in the study.
        scenes: seeds or scenarios.
        kind: as in `Task`, and the rest likewise.
        version: of jaxplan, which must be the worker's.
        deaths: of workers that had nothing else to do.
        apart: whether it is a scene of a block that was given up, as it killed its workers.
    """

    numbers: tuple[int, ...]
    scenes: tuple[int | Scenario, ...]
    kind: str | None
    planner: str
    settings: Mapping[str, Any]
    version: str = __version__
    deaths: int = 0
    apart: bool = False

    def name(self, place: int) -> str:
        """Of a scene, as its scenario has it."""
        scene = self.scenes[place]
        return scene.name if isinstance(scene, Scenario) else f"{self.kind} {scene}"

    def seed(self, place: int) -> int | None:
        """Of a random scene."""
        scene = self.scenes[place]
        return None if isinstance(scene, Scenario) else scene

    def scenario(self, place: int) -> Scenario:
        """A scene as it is planned."""
        scene = self.scenes[place]
        if not isinstance(scene, Scenario):
            assert self.kind is not None
            scene = random_scenario(scene, self.kind)
        return prepared(scene, self.planner, self.settings)


def make_task(
    scenarios_or_seeds: Iterable[Scenario] | Iterable[int],
    kind: str | None,
    planner: str,
    settings: Mapping[str, Any] | None,
) -> Task:
    """Check what a study is asked for.

    Raises:
        TypeError: for what is neither a scenario nor a seed.
        ValueError: for an unknown kind or planner, wrong settings, or seeds that are none or come twice.
    """
    if planner not in tuple(PLANNERS):  # a tuple, since what is no name may not be hashed
        raise ValueError(f"planner = {planner!r}: must be one of {', '.join(PLANNERS)}")
    given = several("scenarios_or_seeds", scenarios_or_seeds, "scenarios or seeds, such as range(100)")
    scenes: Sequence[Any] = given if isinstance(given, range) else tuple(given)
    if (
        isinstance(scenes, range)
        and not -_MOST_SCENES < (scenes.stop - scenes.start) // scenes.step < _MOST_SCENES
    ):
        raise ValueError(f"scenarios_or_seeds = {scenes}: a study has less than {_MOST_SCENES} scenes")
    if not len(scenes):
        raise ValueError("scenarios_or_seeds is empty: there is nothing to plan")
    if isinstance(scenes[0], Scenario):
        scenarios = _scenarios(scenes, kind)
        examples, kind = scenarios, None
        scenes = scenarios
    else:
        kind = "keep_out" if kind is None else kind
        if kind not in RANDOM_KINDS:
            raise ValueError(f"kind = {kind!r}: must be one of {', '.join(RANDOM_KINDS)}")
        scenes = _seeds(scenes)
        examples = (random_scenario(scenes[0], kind),)  # all of a kind have the same devices and settings
    plain = _plain(settings or {})
    for scenario in examples:
        prepared(scenario, planner, plain)
    return Task(kind=kind, scenes=scenes, planner=planner, settings=plain)


def prepared(scenario: Scenario, planner: str, settings: Mapping[str, Any]) -> Scenario:
    """A scenario with a study's settings, its planner, and no time limit."""
    changed = with_settings(scenario, settings)
    return replace(changed, search=replace(changed.search, method=planner, time_limit=math.inf))


def _plain(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as JSON has them, in one order, so that equal ones look alike."""
    if not isinstance(settings, Mapping):
        raise TypeError(
            f'settings must be a dict such as {{"search.seed": 1}}, not {type(settings).__name__}'
        )
    names = sorted(map(str, settings))
    faults = [f"{name}: {_OWN[name]}" for name in names if name in _OWN]
    if faults:
        raise ScenarioError(faults, "settings")
    texts = {
        str(name): "inf" if isinstance(value, float) and value == math.inf else value  # as files have it
        for name, value in settings.items()
    }
    try:
        plain: dict[str, Any] = json.loads(json.dumps(texts, sort_keys=True, default=_unwrapped))
    except (TypeError, ValueError) as error:
        raise ScenarioError([str(error)], "settings") from error
    return plain


def _unwrapped(value: object) -> Any:
    """A number or array of numpy as Python's own."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{value!r} is nothing that a scenario file holds")


def _scenarios(scenes: Sequence[Any], kind: str | None) -> tuple[Scenario, ...]:
    if kind is not None:
        raise ValueError(f"kind = {kind!r}: only seeds have one, but scenarios are given")
    return tuple(as_filed(f"scenarios_or_seeds[{number}]", scene) for number, scene in enumerate(scenes))


def _seeds(scenes: Sequence[Any]) -> Sequence[int]:
    faults: list[str] = []
    if isinstance(scenes, range):
        least, most = sorted([scenes[0], scenes[-1]])
        if least < 0:
            faults = [f"scenarios_or_seeds = {scenes}: seeds must be at least 0"]
        if most > _LARGEST_SEED:
            faults = [f"scenarios_or_seeds = {scenes}: seeds must be at most {_LARGEST_SEED}"]
        seeds: Sequence[int] = scenes
    else:
        first: dict[int, int] = {}
        for number, scene in enumerate(scenes):
            place = f"scenarios_or_seeds[{number}] = {scene!r:.40}"
            if isinstance(scene, bool) or not isinstance(scene, int | np.integer):
                raise TypeError(f"{place}: must be a seed, an integer of at least 0")
            if scene < 0:
                faults.append(f"{place}: must be at least 0")
            elif scene > _LARGEST_SEED:
                faults.append(f"{place}: must be at most {_LARGEST_SEED}")
            elif first.setdefault(int(scene), number) != number:
                faults.append(f"{place}: the same as scenarios_or_seeds[{first[int(scene)]}]")
        seeds = tuple(map(int, scenes))
    if faults:
        raise ScenarioError(faults, "the study")
    return seeds


def _runs(seeds: Sequence[Any]) -> list[list[int]]:
    """Seeds as [first, last] of those that follow one another."""
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
    """A fingerprint of scenarios."""
    digest = hashlib.sha256()
    for scenario in scenarios:
        digest.update(json.dumps(scenario_to_dict(scenario), sort_keys=True).encode() + b"\n")
    return digest.hexdigest()
