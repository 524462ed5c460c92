"""The programs inside the method "global", solved by its own engine and by others, in one run.

Takes the duals that fits of random scenes ask for, some at 80 s and some at the shortest duration, and solves
each by `jaxplan.trajectory.interior_point`, PIQP, OSQP and qpax. Prints how long that takes, and how many
answers cost least.

    pip install -e '.[bench]'
    python bench/engines.py [-n 8]
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import osqp
from _machine import print_machine
from _options import MISSING, positive
from scipy import sparse

import jaxplan as jp
from jaxplan.cases import SKY_KINDS, random_scenario
from jaxplan.trajectory import step_programs
from jaxplan.trajectory.interior_point import BoxQP, solve_box_qps

try:
    import piqp
    import qpax
except ModuleNotFoundError as missing:
    raise SystemExit(MISSING.format(missing.name, "bench")) from None

Problem = tuple[np.ndarray, np.ndarray, np.ndarray]  # matrix, linear, penalty
Engine = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]

SIZES = (64, 128, 256, 512)
GOOD = 1e-6  # share of the cost above the best within which an answer counts as good


def collect(count: int) -> list[Problem]:
    """Plan random scenes, and collect the duals that their fits solve, each scaled to a diagonal of ones.

    Args:
        count: scenes of each kind.
    """
    found: list[Problem] = []

    def spy(programs):
        for matrix, linear, penalty, *_ in programs:
            if len(linear):
                matrix = np.array([matrix.times(unit) for unit in np.eye(len(linear))])
                scale = 1 / np.sqrt(np.diag(matrix))
                found.append((matrix * scale[:, None] * scale, linear * scale, penalty / scale))
        return solve_box_qps(programs)

    own, step_programs.solve_box_qps = step_programs.solve_box_qps, spy
    try:
        for kind in SKY_KINDS:
            for seed in range(count):
                scenario = random_scenario(seed, kind)
                duration = 80.0 if seed % 2 else "minimum"
                settings = replace(scenario.trajectory, method="global", duration=duration)
                jp.plan(replace(scenario, trajectory=settings), throw=False, progress=False)
    finally:
        step_programs.solve_box_qps = own
    return found


def solve_own(matrix: np.ndarray, linear: np.ndarray, penalty: np.ndarray) -> np.ndarray:
    """Multipliers y (k,) in [0, penalty] that minimise y^T matrix y / 2 - linear^T y, by our own engine."""
    return solve_box_qps([BoxQP(matrix, linear, penalty)])[0].multipliers


def solve_piqp(matrix: np.ndarray, linear: np.ndarray, penalty: np.ndarray) -> np.ndarray:
    """The same by PIQP."""
    solver = piqp.DenseSolver()
    solver.setup(matrix, -linear, x_l=np.zeros_like(linear), x_u=penalty)
    solver.solve()
    return solver.result.x


def solve_osqp(matrix: np.ndarray, linear: np.ndarray, penalty: np.ndarray) -> np.ndarray:
    """The same by OSQP."""
    solver, count = osqp.OSQP(), len(linear)
    solver.setup(
        P=sparse.csc_matrix(np.triu(matrix)),
        q=-linear,
        A=sparse.eye(count, format="csc"),
        l=np.zeros(count),
        u=penalty,
        verbose=False,
        eps_abs=1e-9,
        eps_rel=1e-9,
        polishing=True,
    )
    return solver.solve(raise_error=False).x


def solve_qpax(matrix: np.ndarray, linear: np.ndarray, penalty: np.ndarray) -> np.ndarray:
    """The same by qpax, padded to one of few sizes, for which it is compiled; what is added never binds."""
    count = len(linear)
    size = next(size for size in SIZES if size >= count)
    wide = np.eye(size)
    wide[:count, :count] = matrix
    linear = np.pad(linear, (0, size - count), constant_values=-1.0)
    penalty = np.pad(penalty, (0, size - count), constant_values=1.0)
    with jax.enable_x64(True):
        return np.asarray(_qpax(wide, linear, penalty))[:count]


@jax.jit
def _qpax(matrix: jax.Array, linear: jax.Array, penalty: jax.Array) -> jax.Array:
    """The same by qpax at the size given."""
    size = len(linear)
    none, box = jnp.zeros((0, size)), jnp.concatenate([jnp.eye(size), -jnp.eye(size)])
    bounds = jnp.concatenate([penalty, jnp.zeros(size)])
    return qpax.solve_qp(matrix, -linear, none, jnp.zeros(0), box, bounds, solver_tol=1e-9)[0]


def report(problems: list[Problem], engines: dict[str, Engine]) -> None:
    """Solve all problems by all engines, and print a row for each size and engine."""
    print(
        f"{'rows':>10} {'programs':>9}  {'engine':<8} {'median, ms':>10} {'90 %, ms':>9} {'within 1e-6':>12}"
    )
    for low, high in zip((0, *SIZES), SIZES, strict=False):
        group = [problem for problem in problems if low < len(problem[1]) <= high]
        if not group:
            continue
        seconds: dict[str, list[float]] = {name: [] for name in engines}
        costs: dict[str, list[float]] = {name: [] for name in engines}
        for engine in engines.values():  # some compile
            engine(*group[0])
        for matrix, linear, penalty in group:
            for name, engine in engines.items():
                begin = time.perf_counter()
                y = engine(matrix, linear, penalty)
                seconds[name].append(time.perf_counter() - begin)
                y = np.clip(y, 0, penalty)  # whatever leaves the box by rounding or more
                costs[name].append(y @ matrix @ y / 2 - linear @ y)
        best = np.min([np.nan_to_num(costs[name], nan=np.inf) for name in engines], axis=0)
        for name in engines:
            good = np.asarray(costs[name]) - best <= GOOD * np.maximum(np.abs(best), 1e-9)
            label = f"{low + 1:>4} - {high:<3} {len(group):>9}" if name == next(iter(engines)) else " " * 20
            low_time, high_time = 1e3 * np.quantile(seconds[name], [0.5, 0.9])
            print(f"{label}  {name:<8} {low_time:>10.2f} {high_time:>9.2f} {np.sum(good):>12}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=positive, default=8, help="random scenes of each kind")
    options = parser.parse_args()
    print_machine()
    report(
        collect(options.n), {"box_qp": solve_own, "PIQP": solve_piqp, "OSQP": solve_osqp, "qpax": solve_qpax}
    )
