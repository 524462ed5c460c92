"""Who plans the scenes of a study does not matter, and a worker that dies costs its own scene alone."""

import json
import math
import multiprocessing
import random
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import pytest
from fake_study import DEADLY, SECONDS, die_at_one, plan_nothing, task

import jaxplan as jp
from jaxplan.runtime.workers import WorkerPool
from jaxplan.study.rows import APART, plan_chunk
from jaxplan.study.run import AIM, LARGEST, Blocks, by_workers, run_task
from jaxplan.study.task import BLOCK

SCENES = 90


def run(executor=None, chunk=None, work=plan_nothing, scenes: int = SCENES, out=None) -> list:
    return run_task(task(scenes), executor, out, chunk, False, work).table


class Fragile:
    """Workers that are all gone once one of them gets a deadly scene; what they did before counts."""

    def __init__(self, workers: int, deadly: set[int]) -> None:
        self.workers, self.deadly, self.lives = workers, deadly, 1
        self.lock, self.pending, self.broken = threading.Lock(), set(), False
        self.threads = ThreadPoolExecutor(workers)

    def submit(self, work, chunk):
        with self.lock:
            if self.broken:
                raise BrokenExecutor("workers are gone")
            future = Future()
            self.pending.add(future)
        self.threads.submit(self.do, future, work, chunk)
        return future

    def do(self, future, work, chunk):
        time.sleep(1e-3)
        with self.lock:
            if future.done():
                return
            if self.deadly & set(chunk.numbers):
                self.broken = True
                for other in self.pending:
                    other.set_exception(BrokenExecutor("a worker died"))
                self.pending.clear()
                return
            self.pending.remove(future)
            future.set_result(work(chunk))

    def restart(self):
        self.broken, self.lives = False, self.lives + 1


def answered(pool, chunk: int | None = 2, scenes: int = SCENES) -> list:
    rows = [
        row
        for answer in by_workers(Blocks(task(scenes), range(scenes), chunk), plan_nothing, pool)
        for row in answer.table
    ]
    return sorted(rows, key=lambda row: row["scene"])


@pytest.mark.parametrize("chunk", [1, 2, 5, 100, None])
def test_chunks_do_not_change_the_table(chunk):
    assert json.dumps(run(chunk=chunk)) == json.dumps(run(chunk=3))


def test_the_order_in_which_workers_get_done_does_not_change_the_table(monkeypatch):
    chance = random.Random(1)

    def slowly(chunk):
        time.sleep(chance.uniform(0, 0.01))
        return plan_nothing(chunk)

    with ThreadPoolExecutor(4) as executor:
        assert json.dumps(run(executor, 1, slowly)) == json.dumps(run())


@pytest.mark.parametrize("deadly", [set(), {0}, {17}, {89}, {4, 5, 80}])
@pytest.mark.parametrize("workers", [1, 3])
def test_a_scene_that_kills_its_worker_is_the_only_one_to_crash(deadly, workers):
    pool = Fragile(workers, deadly)
    rows = answered(pool)
    assert [row["scene"] for row in rows] == list(range(SCENES))
    assert {row["scene"] for row in rows if row["status"] == "crashed"} == deadly
    assert all("its worker died, 2 times" in rows[number]["message"] for number in deadly)
    well = [row for row in rows if row["scene"] not in deadly]
    assert json.dumps(well) == json.dumps([row for row in run() if row["scene"] not in deadly])
    assert pool.lives <= 1 + 6 * len(deadly)


def test_a_worker_that_dies_idle_or_by_chance_costs_nothing():
    class Unlucky(Fragile):
        deaths = 0

        def submit(self, work, chunk):
            if self.deaths < 3 and 20 in chunk.numbers:
                self.deaths += 1
                raise BrokenExecutor("it died before")
            return super().submit(work, chunk)

    pool = Unlucky(2, set())
    assert json.dumps(answered(pool)) == json.dumps(run())
    assert pool.lives == 4


def test_a_task_that_dask_gives_up_is_a_death_and_another_error_ends_the_study():
    class KilledWorker(Exception):
        pass

    class Dask(Fragile):
        def submit(self, work, chunk):
            future = Future()
            if DEADLY in chunk.numbers:
                future.set_exception(KilledWorker())
            elif error and 20 in chunk.numbers:
                future.set_exception(ModuleNotFoundError("No module named 'jaxplan'"))
            else:
                future.set_result(work(chunk))
            return future

    error = False
    rows = answered(Dask(2, set()))
    assert [row["scene"] for row in rows if row["status"] == "crashed"] == [DEADLY]
    error = True
    with pytest.raises(ModuleNotFoundError, match="jaxplan"):
        answered(Dask(2, set()))


def test_chunks_grow_and_shrink_to_take_as_long_as_they_should():
    chunks = Blocks(task(100_000), range(100_000), None)
    sizes = []
    for seconds in [0.0125] * 10 + [1e-4] * 10 + [1.0] * 10:
        chunk = chunks.take(0)
        sizes.append(len(chunk.scenes) / BLOCK)
        chunks.learn(len(chunk.scenes), seconds * len(chunk.scenes))
    assert sizes[0] == 1
    assert sizes[9] == AIM / 0.0125 / BLOCK
    assert sizes[19] == LARGEST
    assert sizes[-1] == 1  # a block is planned together, however long it takes
    assert Blocks(task(10), range(10), None).take(0).numbers == tuple(range(10))


def test_the_last_chunks_are_small_where_several_plan():
    chunks = Blocks(task(3200), range(3200), None)
    sizes = []
    while (chunk := chunks.take(0, most=4)) is not None:
        sizes.append(len(chunk.scenes) // BLOCK)
        chunks.learn(len(chunk.scenes), 1e-3 * len(chunk.scenes))
    assert sum(sizes) == 200
    assert max(sizes) <= LARGEST
    assert sizes[-4:] == [1] * 4
    assert len(sizes) < 40


def test_scenes_of_a_block_are_planned_together_however_a_study_is_cut_and_interrupted(tmp_path):
    def in_company(chunk):
        companies.update(tuple(block.numbers) for block in chunk.blocks())
        answer = plan_nothing(chunk)
        for block in chunk.blocks():
            for number in block.numbers:
                answer.table[chunk.numbers.index(number)]["slew_deg"] = float(sum(block.numbers))
        return answer

    def interrupted(chunk):
        if 50 in chunk.numbers:
            raise KeyboardInterrupt
        return in_company(chunk)

    companies = set()
    whole = json.dumps(run(work=in_company))
    assert companies == {tuple(range(first, min(first + BLOCK, SCENES))) for first in range(0, SCENES, BLOCK)}
    for chunk in (2, 5, None):
        assert json.dumps(run(chunk=chunk, work=in_company)) == whole
    with ThreadPoolExecutor(3) as executor:
        assert json.dumps(run(executor, 1, in_company)) == whole
    run(chunk=1, work=interrupted, out=tmp_path)
    table = tmp_path / "table.jsonl"
    table.write_bytes(b"".join(table.read_bytes().splitlines(keepends=True)[:20]))  # a block done in part
    assert json.dumps(run(chunk=4, work=in_company, out=tmp_path)) == whole
    assert len(companies) == math.ceil(SCENES / BLOCK)


def test_rows_of_a_block_that_kills_its_process_say_that_they_were_planned_apart():
    pool = Fragile(2, {DEADLY})
    pool.submit = lambda chunk_work, chunk, submit=pool.submit: submit(plan_chunk, chunk)
    rows = [
        row for answer in by_workers(Blocks(task(20), range(20), 2), plan_chunk, pool) for row in answer.table
    ]
    apart = {row["scene"] for row in rows if APART in row["message"]}
    assert apart == set(range(BLOCK)) - {DEADLY}
    assert len(rows) == 20


def test_idle_workers_are_found_out_and_get_more_to_do():
    under_way = []

    class Wide(ThreadPoolExecutor):
        workers = 1  # as far as anybody knows

        def submit(self, work, chunk):
            under_way.append(self._work_queue.qsize())
            return super().submit(work, chunk)

    def sleepy(chunk):
        running.append(1)
        most.append(len(running))
        time.sleep(0.02)
        running.pop()
        answer = plan_nothing(chunk)
        return type(answer)(answer.table, answer.timings, 0.02)

    running, most = [], []
    with Wide(6) as pool:
        rows = [
            row
            for answer in by_workers(Blocks(task(40 * BLOCK), range(40 * BLOCK), 1), sleepy, pool)
            for row in answer.table
        ]
    assert len(rows) == 40 * BLOCK
    assert max(most) >= 5
    assert max(under_way) <= 12


@pytest.mark.slow
def test_processes_of_our_own_survive_a_death_and_are_gone_at_the_end(tmp_path):
    rows = run(1, 1, die_at_one, 20, tmp_path)
    assert [row["scene"] for row in rows if row["status"] == "crashed"] == [DEADLY]
    assert json.dumps([row for row in rows if row["scene"] != DEADLY]) == json.dumps(
        [row for row in run(scenes=20) if row["scene"] != DEADLY]
    )
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_an_interrupt_ends_our_processes_at_once(monkeypatch, tmp_path):
    monkeypatch.setenv(SECONDS, "0.3")
    monkeypatch.setattr("jaxplan.study.store.Store.add", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    study = run_task(task(200), 2, tmp_path, 1, False, plan_nothing)
    assert study.table == []
    assert not multiprocessing.active_children()


def test_processes_are_ended_at_once_when_they_wait_for_work(monkeypatch):
    monkeypatch.setenv(SECONDS, "0.05")
    pool = WorkerPool(2)
    rows = [
        row
        for answer in by_workers(Blocks(task(80), range(80), 1), plan_nothing, pool)
        for row in answer.table
    ]
    assert len(rows) == 80
    assert len(multiprocessing.active_children()) == 2
    pool.shutdown(at_once=True)  # one of them keeps the lock of the queue
    assert not multiprocessing.active_children()


def test_executors_that_cannot_work_are_refused():
    with pytest.raises(TypeError, match=r"workers must be .* not str; a Dask client has one by get_executor"):
        jp.run_study(range(3), workers="dask")
    with pytest.raises(TypeError, match="not bool"):
        jp.run_study(range(3), workers=True)
    with pytest.raises(ValueError, match="workers = 0: must be at least 1"):
        jp.run_study(range(3), workers=0)
    with (
        ProcessPoolExecutor(1, multiprocessing.get_context("fork")) as executor,
        pytest.raises(ValueError, match=r'workers forks.*get_context\("spawn"\)'),
    ):
        jp.run_study(range(3), workers=executor)


def test_executor_is_another_name_of_workers_and_not_a_second_one():
    with ThreadPoolExecutor(1) as pool:
        (plan,) = jp.plan_batch([jp.paper_case(4)], executor=pool, progress=False)
        assert plan.ok
        with pytest.raises(TypeError, match="two names of the same argument: give workers alone"):
            jp.plan_batch([jp.paper_case(4)], workers=2, executor=pool)
    with pytest.raises(ValueError, match="executor = 0: must be at least 1"):
        jp.run_study(range(3), executor=0)


def spoken(*words, **options) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False, **options)


@pytest.mark.slow
def test_a_script_without_a_guard_is_told_about_it_and_of_nothing_else(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import jaxplan as jp\n"
        "try:\n"
        "    jp.run_study(range(2), workers=2, out='study', progress=False)\n"
        "finally:\n"
        "    open('cleaned up', 'a').write('once ')\n"
    )
    done = spoken(script, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    *_, last = done.stderr.splitlines()
    assert last.startswith(
        'RuntimeError: script.py: put what uses worker processes below `if __name__ == "__m'
    )
    assert "freeze_support" not in done.stderr
    assert "terminated abruptly" not in done.stderr
    assert (tmp_path / "cleaned up").read_text() == "once "  # the worker has left that to the script


UNGUARDED = {
    "plans": "jp.plan_batch([jp.paper_case(4)] * 2, workers=2, progress=False)",
    "plans by a pool": (
        'with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:\n'
        "    jp.plan_batch([jp.paper_case(4)], workers=pool, progress=False)"
    ),
    "a pool": (
        'with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:\n'
        "    jp.run_study(range(2), workers=pool, progress=False)"
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("work", UNGUARDED.values(), ids=UNGUARDED)
def test_the_advice_on_a_guard_is_said_last_and_below_the_scripts_own_line(tmp_path, work):
    script = tmp_path / "script.py"
    script.write_text(
        "import multiprocessing\n"
        "from concurrent.futures import ProcessPoolExecutor\n"
        f"import jaxplan as jp\n{work}\n"
    )
    done = spoken(script, cwd=tmp_path)
    *lines, last = done.stderr.splitlines()
    advice = 'script.py: put what uses worker processes below `if __name__ == "__main__":`'
    assert last.startswith(f"RuntimeError: {advice}")
    begin = lines.index("Traceback (most recent call last):")
    assert all(line.startswith(advice) for line in lines[:begin])
    assert sum(line.startswith("  File") for line in lines[begin:]) == 2
    assert work.splitlines()[-1] in lines[begin + 2]


def test_what_a_worker_dies_of_as_it_begins_is_told(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import multiprocessing\n"
        "import jaxplan as jp\n"
        "if multiprocessing.current_process().name != 'MainProcess':\n"
        "    raise OSError('no such antenna')\n"
        "jp.plan_batch([jp.paper_case(4)], workers=1, progress=False)\n"
    )
    done = spoken(script)
    assert done.returncode == 1
    assert "OSError: no such antenna" in done.stderr
    assert "RuntimeError: a worker process died as it began, and what it printed says why" in done.stderr


@pytest.mark.slow
def test_a_script_that_is_no_file_has_workers_too():
    script = (
        "import sys\n"
        f"sys.path.insert(0, {str(Path(__file__).parents[1])!r})\n"
        "from fake_study import plan_nothing, task\n"
        "from jaxplan.study.run import run_task\n"
        "print(len(run_task(task(4), 2, None, 1, False, plan_nothing).table), __file__)\n"
    )
    done = spoken(input=script)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "4 <stdin>\n")
    done = spoken("-i", "-q", "-c", script.replace("__file__", "'no file'"), input="")
    assert (done.returncode, done.stdout) == (0, "4 no file\n"), done.stderr
