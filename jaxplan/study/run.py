"""Running a study: scenes in, rows out, with a bar, and nothing that is done gets lost."""

import os
from collections.abc import Generator, Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.model.scenario import Scenario
from jaxplan.runtime.arguments import file_path
from jaxplan.runtime.progress import progress_bar
from jaxplan.runtime.workers import WorkerPool, Workers, WorkersDiedError, who_works
from jaxplan.study.blocks import Answer, Blocks, Work, by_workers, in_this_process, plan_chunk
from jaxplan.study.result import Study
from jaxplan.study.rows import OK
from jaxplan.study.store import Store
from jaxplan.study.task import Task, make_task


def run_study(
    scenarios_or_seeds: Iterable[Scenario] | Iterable[int],
    kind: str | None = None,
    planner: str = "mha",
    settings: Mapping[str, Any] | None = None,
    *,
    workers: Workers | None = None,
    out: str | os.PathLike[str] | None = None,
    chunk: int | None = None,
    progress: bool = True,
    executor: Workers | None = None,
) -> Study:
    """Plan many scenes, and note what became of each.

    On one machine the table is always the same to the last bit, whoever plans and however often the study
    is interrupted: scenes are planned together in blocks of 16 by their number, and searches have no time
    limit here, whatever the scenarios say. A scene whose planning raises an error, or kills its process, is
    a row with status ``crashed``; the others of its block are planned one by one then, and may differ in
    last digits from the same scenes in a study where nothing crashes. Ctrl-C ends the study early and returns
    what is done.

    Args:
        scenarios_or_seeds: the scenes, or seeds of `random_scenario`.
        kind: of the random scenes, "keep_out" unless told; only with seeds.
        planner: "mha", "mha-paper", "wastar", "rrt_star" or "rrt_connect".
        settings: that differ from the scenes' own, by dotted names in the keys and units of a scenario file,
            as in ``{"search.max_expansions": 500, "trajectory.duration_s": "minimum"}``.
        workers: who plans: None for this process; a number of processes of its own, which are begun anew
            when one dies; or any `concurrent.futures.Executor`, such as ``get_executor()`` of a Dask client.
        out: a folder for the results, where each chunk is safe once it is done. If it holds the same study
            already, only what is missing is planned; another study is refused. Without it rows are kept
            in memory.
        chunk: blocks that are handed out together; by default as many as take some two seconds.
        progress: show a bar on stderr (or in the notebook) once it takes longer than a second.
        executor: an older name of workers.

    Returns:
        The study.

    Raises:
        TypeError: for scenes, workers or a folder that are none.
        ValueError: for bad seeds, an unknown kind or planner, or chunks of less than one block.
        ScenarioError: for settings, or a scenario, that a file could not hold; all faults are named.
        StudyFolderError: if the folder holds something else or is in use.
        RuntimeError: if workers die before they plan anything, or have another version of jaxplan.

    Example:
        >>> study = jp.run_study(range(200), "hard_keep_out", workers=2, out="study")
        >>> print(study.summary())
    """
    given: object = chunk
    if (given is not None and not (isinstance(given, int | np.integer) and given >= 1)) or given is True:
        raise ValueError(f"chunk = {chunk!r}: must be a number of blocks of scenes, at least 1")
    chosen = who_works(workers, executor)
    if out is not None:
        file_path("out", out)
    task = make_task(scenarios_or_seeds, kind, planner, settings)
    try:
        return run_task(task, chosen, out, chunk, progress, plan_chunk)
    except WorkersDiedError as error:
        raise RuntimeError(str(error)) from None


def run_task(
    task: Task,
    workers: Workers | None,
    out: str | os.PathLike[str] | None,
    chunk: int | None,
    progress: bool,
    work: Work,
) -> Study:
    """Run a study whose arguments are checked, by some work for each chunk."""
    with Store(out, task) as store:
        left = (number for number, done in enumerate(store.done) if not done)
        with progress_bar(
            f"study: {task.planner}",
            "scenes",
            total=len(task.scenes),
            initial=sum(store.done),
            shown=progress,
        ) as bar:
            planned = 0
            bar.step("workers begin, and may compile" if workers is not None else "")
            try:
                with closing(_answers(Blocks(task, left, chunk), workers, work)) as answers:
                    for answer in () if all(store.done) else answers:
                        table = store.add(answer)
                        planned += sum(row["status"] == OK for row in table)
                        bar.step("")
                        bar.update(len(table))
                        bar.note(f"{planned} planned")
            except KeyboardInterrupt:
                pass  # what is done is returned
        return Study(
            kind=task.kind,
            planner=task.planner,
            settings=task.settings,
            scenes=len(task.scenes),
            folder=None if out is None else Path(out),
            _held=store.rows,
        )


def _answers(chunks: Blocks, workers: Workers | None, work: Work) -> Generator[Answer, None, None]:
    if workers is None:
        yield from in_this_process(chunks, work)
        return
    pool = WorkerPool(workers)
    try:
        yield from by_workers(chunks, work, pool)
    except BaseException:  # Ctrl-C here or at whom the answers go to, among others
        pool.shutdown(at_once=True)
        raise
    pool.shutdown(at_once=False)
