"""Exported CZML as CesiumJS has it, beside the motion: attitude and position at samples and between them.

Attitudes are turned to axes fixed to the Earth by pyerfa, UTC standing for UT1. Needs node, and a folder in
which `npm i cesium` was run.

    python bench/czml_compare.py FOLDER
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import erfa
import numpy as np
from _machine import print_machine
from scipy.spatial.transform import Rotation, Slerp

import jaxplan as jp
from jaxplan import sky

EPOCH = "2026-03-01T06:30:15"
ORBIT = sky.CircularOrbit(altitude=600.0, inclination=1.7, node=0.3, latitude=0.2)
INSTANTS = 5_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", help="in which `npm i cesium` was run")
    options = parser.parse_args()
    print_machine("czml3", pinned=False)
    print("case  samples  attitude: at samples  between  by one turn between  position   (rad, rad, rad, m)")
    for case in (1, 2, 3):
        plan = jp.plan(jp.paper_case(case), progress=False)
        row = compared(plan, options.folder)
        print(f"{case:4d}  {row[0]:7d}  {row[1]:20.1e}  {row[2]:7.1e}  {row[3]:19.1e}  {row[4]:8.1e}")


def compared(plan: jp.Plan, folder: str) -> tuple[int, float, float, float, float]:
    """How many samples there are, and how far CesiumJS, or one turn between two samples, is off."""
    with tempfile.TemporaryDirectory() as place:
        file = jp.export(plan, Path(place) / "a.czml", format="czml", epoch=EPOCH, observer=ORBIT)
        packets = json.loads(file.read_text())
        (craft,) = (packet for packet in packets if packet["id"] == "spacecraft")
        rows = np.reshape(craft["orientation"]["unitQuaternion"], (-1, 5))
        between = np.random.default_rng(0).uniform(0, rows[-1, 0], INSTANTS)
        times = np.concatenate([rows[:, 0], between])
        instants = Path(place) / "times.json"
        instants.write_text(json.dumps(times.tolist()))
        command = ["node", str(Path(__file__).with_name("czml_read.mjs")), folder, str(file), str(instants)]
        found = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["rows"]
    turning = earth_turning(times)
    truth = Rotation.from_matrix(turning @ plan.trajectory.sample(times).attitude)
    off = (Rotation.from_quat([row["attitude"] for row in found]) * truth.inv()).magnitude()
    turned = Slerp(rows[:, 0], Rotation.from_quat(rows[:, 1:]))(between)
    here = 1e3 * np.einsum("kij,kj->ki", turning, sky.positions(ORBIT, epoch=EPOCH, times=times))
    apart = np.linalg.norm([row["position"] for row in found] - here, axis=1)
    count = len(rows)
    return (
        count,
        float(off[:count].max()),
        float(off[count:].max()),
        float((turned * truth[count:].inv()).magnitude().max()),
        float(apart.max()),
    )


def earth_turning(times: np.ndarray) -> np.ndarray:
    """Rotations (k, 3, 3) from the GCRS to axes fixed to the Earth, at times (k,) s after the epoch."""
    utc1, utc2 = erfa.dtf2d("UTC", 2026, 3, 1, 6, 30, 15.0)
    tt1, tt2 = erfa.taitt(*erfa.utctai(utc1, utc2))
    return np.asarray(erfa.c2t06a(tt1, tt2 + times / 86400, utc1, utc2 + times / 86400, 0.0, 0.0))


if __name__ == "__main__":
    main()
