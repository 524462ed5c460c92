"""How many of the wrong signs, terms and comparisons that one could write do the tests find?

Cosmic Ray changes one operator at a time in a copy of the repository and runs the tests that should notice.
Prints a row for each part, and every mutant that survives: with the reason where it is known to mean the same
(`data/equivalent_mutants.toml`), else to be explained there or to get a test. Ends with 1 where less than
`LEAST_SHARE` of those that do not mean the same are found.

    python tests/trust_mutants.py [--parts so3 zones] [--most 40] [--seed 0]
"""

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import WorkerOutcome, WorkItem, WorkResult
from tqdm import tqdm

ROOT = Path(__file__).resolve().parent.parent

# Part: what is changed, and the tests that are to find it.
PARTS = {
    "so3": (["so3.py"], ["geometry/test_so3.py"]),
    "zones": (
        ["model/zones.py", "model/constraints.py", "model/directions.py"],
        ["model/test_zones.py", "model/test_path.py", "model/test_constraints.py"],
    ),
    "spacecraft": (["model/spacecraft.py"], ["model/test_spacecraft.py"]),
    "limits": (["model/limits.py"], ["model/test_limits.py"]),
    "kernels": (
        ["search/expansion.py", "search/edges.py"],
        ["search/test_expansion.py", "search/test_smoothing.py"],
    ),
    "rows": (
        ["trajectory/constraints.py"],
        [
            "trajectory/test_global_rows.py",
            "trajectory/test_global_parts.py",
            "trajectory/test_global_spline.py",
        ],
    ),
    "spline": (
        ["trajectory/splines.py"],
        ["trajectory/test_global_parts.py", "trajectory/test_global_spline.py"],
    ),
    "paper": (["paper/segments.py"], ["paper/test_trajectory_paper.py"]),
    "certificate": (
        [f"certificate/{name}.py" for name in ("bounds", "series", "limits", "margins", "motion")],
        [
            f"certificate/test_{name}.py"
            for name in ("certificate_parts", "certificate_limits", "certificate", "moving_certificate")
        ],
    ),
    "goal": (["goal/derivative.py", "goal/active_caps.py"], ["goal/test_goal_derivatives.py"]),
    "refit": (
        ["paper/derivative.py", "trajectory/derivative.py", "trajectory/optimality.py"],
        ["trajectory/test_refit_parts.py", "derivatives/test_sensitivity.py"],
    ),
}
CHANGES = re.compile(
    r"core/(ReplaceBinaryOperator_(Add_Sub|Sub_Add|Mul_Div|Div_Mul)"
    r"|ReplaceUnaryOperator_(Delete_USub|Delete_Not)"
    r"|ReplaceComparisonOperator_(Lt_Gt|Gt_Lt|LtE_GtE|GtE_LtE))"
)
TIMEOUT = 600  # s, after which a mutant that hangs counts as found
LEAST_SHARE = 0.95
EQUIVALENT = tomllib.loads((ROOT / "tests/data/equivalent_mutants.toml").read_text())["mutant"]


def try_part(name: str, most: int, seed: int) -> tuple[int, list[str]]:
    """Change a part, one mutant after the other: how many there were, and diffs of those that survived."""
    sources, tests = PARTS[name]
    with tempfile.TemporaryDirectory() as folder:
        copy, session = Path(folder) / "copy", Path(folder) / "session.sqlite"
        for part in ("jaxplan", "tests"):
            shutil.copytree(ROOT / part, copy / part)
        shutil.copy(ROOT / "pyproject.toml", copy)
        config = Path(folder) / "config.toml"
        paths = json.dumps([f"jaxplan/{source}" for source in sources])
        command = " ".join(
            [sys.executable, "-m pytest -x -q -p no:cacheprovider", *(f"tests/{t}" for t in tests)]
        )
        config.write_text(
            f"[cosmic-ray]\nmodule-path = {paths}\ntimeout = {TIMEOUT}.0\nexcluded-modules = []\n"
            f'test-command = {json.dumps(command)}\n[cosmic-ray.distributor]\nname = "local"\n'
        )
        # What no mutant changes is compiled once.
        compiled = {"JAX_COMPILATION_CACHE_DIR": str(Path(folder) / "compiled")}
        environment = {**os.environ, **compiled, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}

        def run(*arguments: object) -> None:
            subprocess.run(
                [sys.executable, "-m", "cosmic_ray.cli", *map(str, arguments)],
                cwd=copy,
                env=environment,
                check=True,
                stdout=subprocess.DEVNULL,
            )

        run("init", config, session)
        chosen = choose(session, most, seed)
        before = subprocess.run(command.split(), cwd=copy, env=environment, capture_output=True)
        if before.returncode:
            sys.exit(f"{name}: the tests fail before anything is changed:\n{before.stdout.decode()}")
        run("exec", config, session)
        with use_db(session, WorkDB.Mode.open) as database:
            survived = [result.diff for _, result in database.results if result.test_outcome == "survived"]
        return chosen, survived


def choose(session: Path, most: int, seed: int) -> int:
    """Leave in a session those of the mutants that are to be tried, at most so many; returns their number."""
    with use_db(session, WorkDB.Mode.open) as database:
        items = sorted(
            database.work_items, key=lambda item: [(m.module_path, m.start_pos) for m in item.mutations]
        )
        wanted = [i for i in items if CHANGES.fullmatch(i.mutations[0].operator_name) and not of_axis(i)]
        kept = {item.job_id for item in random.Random(seed).sample(wanted, min(most, len(wanted)))}
        skipped = WorkResult(worker_outcome=WorkerOutcome.SKIPPED)
        database.set_multiple_results([item.job_id for item in items if item.job_id not in kept], skipped)
    return len(kept)


def of_axis(item: WorkItem) -> bool:
    """Whether it makes axis=1 of axis=-1, which mostly is the same axis."""
    mutation = item.mutations[0]
    row, column = mutation.start_pos
    return (ROOT / mutation.module_path).read_text().splitlines()[row - 1][:column].endswith("axis=")


def changed_lines(diff: str) -> str:
    """What a diff takes away and puts in, with the file and where."""
    return "\n".join(line for line in diff.splitlines() if re.match("[-+@]", line) and line[:3] != "---")


def reason(diff: str) -> str | None:
    """Why a mutant means the same, None where that is not known."""
    for known in EQUIVALENT:
        if f"+++ b/{known['file']}" in diff and any(
            line[:1] == "+" and line[1:].strip() == known["line"] for line in diff.splitlines()
        ):
            return str(known["why"])
    return None


def show(name: str, tried: int, survived: int, same: int) -> None:
    """Print a row of the table."""
    telling = tried - same
    share = (tried - survived) / max(1, telling)
    print(f"{name:<12} {tried:>7} {tried - survived:>6} {same:>10} {share:>6.1%}", flush=True)


def main() -> int:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--most", type=int, default=10**6, help="mutants of a part, drawn at random")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(f"{'part':<12} {'mutants':>7} {'found':>6} {'equivalent':>10} {'share':>6}", flush=True)
    tried = lost = same = 0
    for name in tqdm(options.parts, disable=None):
        count, survived = try_part(name, options.most, options.seed)
        reasons = [reason(diff) for diff in survived]
        known = sum(why is not None for why in reasons)
        show(name, count, len(survived), known)
        for diff, why in zip(survived, reasons, strict=True):
            print(f"{changed_lines(diff)}\n  {why or 'survived: explain it or write a test'}", flush=True)
        tried, lost, same = tried + count, lost + len(survived), same + known
    show("all", tried, lost, same)
    return int(tried - lost < LEAST_SHARE * (tried - same))


if __name__ == "__main__":
    sys.exit(main())
