"""What the figures of studies draw: rows of scenes, whose they are, and how they look."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np

from jaxplan.given import expect_like, several
from jaxplan.plotting.compared import planner_colour
from jaxplan.plotting.style import COLOURS, LINE_STYLES, Look

OK = "OK"
_PARTS = ("kind", "planner", "settings", "table", "timings")


class Studied(Protocol):
    """A study of many scenes, such as a `jaxplan.study.Study`.

    Attributes:
        kind: of random scenes; None where scenarios were given.
        planner: its name.
        settings: that differ from the scenes' own.
        table: a row a scene, with its status and what was found, by column.
        timings: likewise its seconds.
    """

    @property
    def kind(self) -> str | None: ...  # noqa: D102

    @property
    def planner(self) -> str: ...  # noqa: D102

    @property
    def settings(self) -> Mapping[str, Any]: ...  # noqa: D102

    @property
    def table(self) -> Sequence[Mapping[str, Any]]: ...  # noqa: D102

    @property
    def timings(self) -> Sequence[Mapping[str, Any]]: ...  # noqa: D102


Studies: TypeAlias = Studied | Iterable[Studied] | Mapping[str, Studied]


def named(studies: Studies) -> dict[str, Studied]:
    """Studies by their names: given ones, or what tells them apart of planner, kind and settings.

    Raises:
        TypeError: if something else is given.
        ValueError: if there are none, or one has no scenes yet.
    """
    if isinstance(studies, Mapping):
        result = dict(studies)
        for name, one in result.items():
            expect_like(f"studies[{name!r}]", one, _PARTS, "a Study, as jp.run_study returns")
    else:
        wanted = "studies, as jp.run_study returns, or one"
        every: list[Any] = (
            [studies] if hasattr(studies, "table") else list(several("studies", studies, wanted))
        )
        for place, one in enumerate(every):
            expect_like(f"studies[{place}]", one, _PARTS, "a Study, as jp.run_study returns")
        result = dict(zip(_names(every), every, strict=True))
    if not result:
        raise ValueError("there are no studies to draw")
    for name, study in result.items():
        if not study.table:
            raise ValueError(f"study {name} has no scenes to draw yet")
    return result


def _names(studies: Sequence[Studied]) -> list[str]:
    kinds, settings = {study.kind for study in studies}, [dict(study.settings) for study in studies]
    names = []
    for study in studies:
        parts = [study.planner]
        if len(kinds) > 1:
            parts.append(study.kind or "scenarios")
        if any(other != settings[0] for other in settings):
            parts += [f"{name} = {value}" for name, value in study.settings.items()]
        names.append(", ".join(parts))
    often, seen = Counter(names), Counter[str]()
    for place, name in enumerate(names):
        if often[name] > 1:
            seen[name] += 1
            names[place] = f"{name} ({seen[name]})"
    return names


def looks(studies: Sequence[Studied]) -> list[Look]:
    """Colour and line style of each: the planner's colour, unless two are by the same.

    Where curves coincide, unbroken lines are below the broken ones, through whose gaps they are seen.
    """
    planners = [study.planner for study in studies]
    distinct = len(set(planners)) == len(planners)
    return [
        {
            "color": planner_colour(name) if distinct else COLOURS[place % len(COLOURS)],
            "linestyle": LINE_STYLES[place % len(LINE_STYLES)],
            "zorder": 2 + 0.1 * (place % len(LINE_STYLES)),
        }
        for place, name in enumerate(planners)
    ]


def planned_values(study: Studied, column: str) -> np.ndarray:
    """A column of table or times, of the scenes that are planned, in ascending order."""
    planned = [row for row in study.table if row["status"] == OK]
    if planned and column not in planned[0]:
        scenes = {row["scene"] for row in planned}
        planned = [row for row in study.timings if row["scene"] in scenes]
    return np.sort(np.array([row[column] for row in planned if row[column] is not None], dtype=float))
