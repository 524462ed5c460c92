"""Studies whose scenes take no planning: for what the machinery around it does, also in processes of its own.

As a script it runs one in a folder: python fake_study.py FOLDER SCENES SECONDS
"""

import os
import signal
import sys
import time

from jaxplan.study.rows import COLUMNS, TIMES, Answer
from jaxplan.study.run import run_task
from jaxplan.study.task import Chunk, Task

DEADLY = 5
SECONDS = "FAKE_STUDY_SECONDS"


def task(scenes: int, planner: str = "mha") -> Task:
    return Task(kind="keep_in", scenes=range(scenes), planner=planner)


def plan_nothing(chunk: Chunk) -> Answer:
    """Rows that follow from the seed alone."""
    seconds = float(os.environ.get(SECONDS, "0"))
    table, timings = [], []
    for place, number in enumerate(chunk.numbers):
        time.sleep(seconds)
        first = chunk.head(place)
        planned = number % 3 > 0
        known = {
            **first,
            "status": "OK" if planned else "NODE_LIMIT",
            "message": "" if planned else "no path",
            "certified": planned,
            "slew_deg": 10.0 + number / 7,
            "expansions": number,
        }
        if planned:
            known |= {
                "length_steps": 5.0 + number / 3,
                "interior_nodes": number,
                "duration_s": 20.0 + number / 9,
                "duration_bound_s": 20.0,
                "min_margin_deg": 0.1 + number / 11,
                "worst_device": "terminal-1",
                "worst_zone": "cone-1",
                "peak": 1.0,
            }
        table.append({name: known.get(name) for name in COLUMNS})
        times = {"scene": number, "name": first["name"], "total_s": 1.0 + number}
        timings.append({name: times.get(name, 0.25) for name in TIMES})
    return Answer(table, timings, seconds * len(table))


def die_at_one(chunk: Chunk) -> Answer:
    """Likewise, but for the scene that kills its worker."""
    if DEADLY in chunk.numbers:
        os.kill(os.getpid(), signal.SIGKILL)
    return plan_nothing(chunk)


def die(_given: object) -> None:
    """What a worker does that ends with its process."""
    os._exit(1)


if __name__ == "__main__":
    os.environ[SECONDS] = sys.argv[3]
    run_task(task(int(sys.argv[2])), None, sys.argv[1], 1, False, plan_nothing)
