"""Fleets whose satellites take no planning: for what the machinery around it does, also in other processes.

As a script it plans one in a folder, slowly: python fake_fleet.py FOLDER SECONDS
"""

import io
import json
import os
import signal
import sys
import time
import zipfile
from functools import partial

import numpy as np

import jaxplan as jp
from jaxplan.constellation import fleet
from jaxplan.constellation.orders import Planned, row_of

DEADLY = 5
SHELL = jp.walker("53:60/6/1", 1400.0)


def schedule(**options):
    """A schedule of a small shell over 20 minutes."""
    known = {"epoch": "2026-06-20T09:30:00", "duration_s": 1200.0, "step_s": 300.0}
    return jp.link_schedule(SHELL, **known | options)


def plan_nothing(order, seconds: float = 0.0) -> Planned:
    """A plan that follows from the order alone."""
    time.sleep(seconds)
    row = row_of(order, None, json.dumps([span.links for span in order.spans]))
    row |= {"status": "OK" if order.satellite % 3 else "GOAL_UNREACHABLE", "slews": 2, "slew_s": 7.5}
    return Planned(satellite=order.satellite, row=row, data=packed(order.satellite), seconds=seconds)


def packed(number: int) -> bytes:
    """What has the look of a plan."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr(zipfile.ZipInfo("plan.json"), f"{{}} {number}")
    return target.getvalue()


def die_at_one(order) -> Planned:
    """Likewise, but for the satellite that kills its worker."""
    if order.satellite == DEADLY:
        os.kill(os.getpid(), signal.SIGKILL)
    return plan_nothing(order)


def files(folder):
    """The bytes of all of a fleet's files but the seconds, by name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in ("timings.jsonl", ".lock")
    }


if __name__ == "__main__":
    fleet.plan_order = partial(plan_nothing, seconds=float(sys.argv[2]))
    print(np.sum([jp.plan_fleet(schedule(), sys.argv[1], progress=False).done]))
