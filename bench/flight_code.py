"""The exported C99 beside the trajectory itself at many instants: how far apart, and how long a call takes.

Each motion is exported, compiled without a warning by every compiler that there is, and evaluated at instants
that are drawn. Differences of rates and accelerations are relative to their largest value.

    python bench/flight_code.py [-n 1000000]
"""

import argparse
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import positive

import jaxplan as jp

WAYS = (
    ("gcc", "-O0"),
    ("gcc", "-O3"),
    ("clang", "-O0"),
    ("clang", "-O3"),
    ("gcc", "-O2", "-m32", "-msse2", "-mfpmath=sse"),
    ("gcc", "-O2", "-m32"),
)
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
DRIVER = """#include "{name}.h"
#include <stdio.h>

int main(void)
{{
    double t;
    {name}_state state;

    while (fread(&t, sizeof t, 1, stdin) == 1)
    {{
        (void){name}_evaluate(t, &state);
        fwrite(&state, sizeof state, 1, stdout);
    }}
    return 0;
}}
"""


def motions() -> dict[str, jp.Plan]:
    """Plans by name: one of each method."""
    scene = jp.random_scenario(3, "keep_out")
    return {"global": jp.plan(scene, progress=False), "paper": jp.plan(jp.paper_case(2), progress=False)}


def beside(name: str, plan: jp.Plan, count: int) -> None:
    """Print a row for each compiler."""
    trajectory = plan.trajectory
    assert trajectory is not None
    times = np.sort(np.random.default_rng(0).uniform(0, trajectory.duration, count))
    known = trajectory.sample(times)
    joints = known.joints.shape[1]
    with tempfile.TemporaryDirectory() as work:
        folder = jp.export(plan, Path(work) / "code", format="c")
        (source,) = folder.glob("*.c")
        driver, program = Path(work) / "driver.c", Path(work) / "flown"
        driver.write_text(DRIVER.format(name=source.stem))
        for compiler, *options in WAYS:
            call = [compiler, *STRICT, *options, f"-I{folder}", source, driver, "-lm", "-o", program]
            if shutil.which(compiler) is None or subprocess.run(call, capture_output=True).returncode:
                print(f"{name:<8} {' '.join([compiler, *options]):<34} not to be had here")
                continue
            began = time.perf_counter()
            flown = subprocess.run([program], input=times.tobytes(), capture_output=True, check=True).stdout
            taken = (time.perf_counter() - began) / count
            table = np.frombuffer(flown).reshape(count, 19 + 3 * joints)
            _, attitude, *others = np.split(table, np.cumsum([4, 9, 3, 3, joints, joints]), axis=1)
            off = [np.abs(attitude - known.attitude.reshape(count, 9)).max()]
            for got, expected in zip(
                others,
                (
                    known.angular_velocity,
                    known.angular_acceleration,
                    known.joints,
                    known.joint_rates,
                    known.joint_accelerations,
                ),
                strict=True,
            ):
                off.append(np.abs(got - expected).max() / np.abs(expected).max())
            figures = " ".join(f"{value:8.1e}" for value in off)
            print(f"{name:<8} {' '.join([compiler, *options]):<34} {figures}  {1e6 * taken:6.2f}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=positive, default=1_000_000, help="instants")
    options = parser.parse_args()
    print_machine()
    columns = ("attitude", "rate", "acceler.", "joints", "rates", "acceler.")
    print(f"{'':<43} {' '.join(f'{column:>8}' for column in columns)}  us a call, with pipes")
    for name, plan in motions().items():
        beside(name, plan, options.n)
