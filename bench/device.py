"""An accelerator beside the processor: batches of checks, batches of slopes, and a whole plan, on either.

Each device computes in a process of its own, one after the other, and both tell what they found, so that the
table also says how far their answers are apart. Rows are of case 2: margins of random states to all its
zones, as step 2 checks candidates; slopes of the effort by the rotation vectors of many starts at once; a
plan from the scenario to its certificate, first in the process (kernels of the processor are kept between
processes, those of an accelerator only as far as JAX keeps them) and warm. Where JAX finds no accelerator
the table has the processor alone.

    python bench/device.py [--states 1000 100000 1000000] [--starts 1 64 1024] [--repeats 20]
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from _machine import print_machine
from _options import positive
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.constraints import state_margins

PROCESSOR = "cpu"


_ENOUGH = 5.0  # s, after which a row is not repeated


def milliseconds(call: Callable[[], object], repeats: int) -> tuple[float, np.ndarray]:
    """Median time of a call, ms, after a first one that compiles, and its answer."""
    answer = np.asarray(jax.block_until_ready(call()))
    seconds: list[float] = []
    while len(seconds) < repeats and sum(seconds) < _ENOUGH:
        began = time.perf_counter()
        jax.block_until_ready(call())
        seconds.append(time.perf_counter() - began)
    return 1e3 * float(np.median(seconds)), answer


def margins(count: int, repeats: int) -> tuple[float, list[float]]:
    """Time of checking so many random states against the zones of case 2, and quantiles of the margins."""
    scene = jp.paper_case(2)
    rng = np.random.default_rng(0)
    attitudes = jnp.asarray(Rotation.random(count, rng=rng).as_matrix())
    joints = jnp.asarray(rng.uniform(-1.0, 1.0, (count, scene.spacecraft.joint_count)))
    rows = scene.constraints
    sights = rows.sights(scene.spacecraft.gimbals, scene.spacecraft.fixed_boresights)

    @jax.jit
    def worst(attitudes: jax.Array, joints: jax.Array) -> jax.Array:
        return jnp.min(state_margins(rows, sights, attitudes, joints), axis=(-2, -1))

    spent, answer = milliseconds(lambda: worst(attitudes, joints), repeats)
    return spent, np.quantile(answer, np.linspace(0, 1, 9)).tolist()


def slopes(count: int, repeats: int) -> tuple[float, list[float]]:
    """Time of the effort's slopes by so many starts at once, and the slopes of the first starts."""
    case = jp.paper_case(2)
    scene = replace(case, trajectory=replace(case.trajectory, method="global", duration=80.0))
    held = jp.hold(jp.plan(scene, progress=False))

    def effort(turn: jax.Array) -> jax.Array:
        start = replace(scene.start, rotation_vector=scene.start.rotation_vector + turn)
        return jp.measures.effort(jp.replan(held, replace(scene, start=start)))

    turns = 1e-3 * jnp.asarray(np.random.default_rng(1).normal(size=(count, 3)))
    every = jax.jit(jax.vmap(jax.grad(effort)))
    spent, answer = milliseconds(lambda: every(turns), repeats)
    return spent, answer[:1].ravel().tolist()


def plans(repeats: int) -> dict[str, tuple[float, list[float]]]:
    """Times of the first plan of case 2 in this process and of warm ones, with effort and margin."""
    scene = jp.paper_case(2)
    seconds = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        plan = jp.plan(scene, progress=False)
        seconds.append(time.perf_counter() - began)
    found = [float(jp.measures.effort(plan.trajectory)), plan.certificate.min_margin]
    return {
        "plan, first": (1e3 * seconds[0], found),
        "plan, warm": (1e3 * float(np.median(seconds[1:])), found),
    }


def measured(states: list[int], starts: list[int], repeats: int) -> dict[str, tuple[float, list[float]]]:
    """All rows, by name, as this process has them: ms, and what was computed."""
    rows = plans(repeats)
    with jax.enable_x64(True):
        for count in states:
            rows[f"margins of {count:,} states"] = margins(count, repeats)
        for count in starts:
            rows[f"slopes, {count:,} starts"] = slopes(count, repeats)
    return rows


def on(platform: str, options: list[str]) -> dict[str, tuple[float, list[float]]]:
    """The rows of one platform of JAX, computed in a process that has no other."""
    own = os.environ | {"JAX_PLATFORMS": platform, "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
    told = subprocess.run(
        [sys.executable, str(Path(__file__)), "--alone", *options],
        env=own,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    rows: dict[str, tuple[float, list[float]]] = json.loads(told.stdout.splitlines()[-1])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=positive, nargs="+", default=[1_000, 100_000, 1_000_000])
    parser.add_argument("--starts", type=positive, nargs="+", default=[1, 64, 1_024])
    parser.add_argument("--repeats", type=positive, default=20)
    parser.add_argument("--alone", action="store_true", help="print the rows of this process as JSON")
    options = parser.parse_args()
    if options.alone:
        print(json.dumps(measured(options.states, options.starts, options.repeats)))
        return
    print_machine(pinned=False)
    device, platform = jax.devices()[0].device_kind, jax.default_backend()
    platform = "cuda" if platform == "gpu" else platform
    given = [argument for argument in sys.argv[1:] if argument != "--alone"]
    processor = on(PROCESSOR, given)
    if platform == PROCESSOR:
        print("JAX finds no accelerator; ms of the processor")
        for name, (spent, _) in processor.items():
            print(f"{name:28}{spent:12.2f}")
        return
    accelerator = on(platform, given)
    print(f"ms; the accelerator is {device}")
    print(f"{'':28}{'processor':>12}{'accelerator':>13}{'ratio':>8}{'apart':>10}")
    for name, (spent, found) in processor.items():
        other, also = accelerator[name]
        apart = float(np.abs(np.subtract(found, also)).max())
        print(f"{name:28}{spent:12.2f}{other:13.2f}{spent / other:8.2f}{apart:10.1e}")


if __name__ == "__main__":
    main()
