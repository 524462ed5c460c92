"""Planning all satellites of a switch, by this process or by many."""

import os
from collections.abc import Iterable, Mapping
from typing import Any

from jaxplan.constellation.problems import LinkSwitch
from jaxplan.constellation.result import Constellation
from jaxplan.given import expect
from jaxplan.runtime.workers import Workers
from jaxplan.study import run_study


def plan_constellation(
    switch: LinkSwitch,
    *,
    satellites: Iterable[int] | None = None,
    planner: str = "mha",
    settings: Mapping[str, Any] | None = None,
    workers: Workers | None = None,
    out: str | os.PathLike[str] | None = None,
    chunk: int | None = None,
    progress: bool = True,
    executor: Workers | None = None,
) -> Constellation:
    """Plan the manoeuvres of a shell's satellites from their links before a switch to those after it.

    A Monte-Carlo study of the switch's scenarios: `plan_batch` plans them block by block, nothing raises for
    a satellite, and the table is the same whoever plans. Durations are "stretched" unless settings say
    otherwise. Plans are not kept, since thousands of them take much memory: ``jp.plan(switch.scenario(17))``
    makes one again.

    Args:
        switch: of `link_switch`.
        satellites: numbers of those that are planned; None for all.
        planner: see `run_study`, and the rest likewise.
        settings: that differ from the defaults, such as ``{"trajectory.duration_s": "minimum"}``.
        workers: who plans: None for this process, a number of processes, or an executor.
        out: a folder where each chunk is safe once it is done.
        chunk: blocks of 16 satellites that are handed out together; by default as many as take some two
            seconds.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        executor: an older name of workers.

    Returns:
        What became of each satellite.

    Raises:
        ScenarioError: for satellites that there are not, and for wrong settings.
        TypeError, ValueError, StudyFolderError, RuntimeError: see `run_study`.

    Example:
        >>> result = jp.plan_constellation(jp.link_switch(jp.walker("52:48/8/1", 1414.0)))
        >>> print(result.summary())
    """
    expect("switch", switch, LinkSwitch, "jp.link_switch makes one of a shell")
    chosen = switch.chosen(satellites)
    study = run_study(
        switch.scenarios(chosen),
        planner=planner,
        settings=settings,
        workers=workers,
        out=out,
        chunk=chunk,
        progress=progress,
        executor=executor,
    )
    return Constellation(switch=switch, satellites=chosen, study=study)
