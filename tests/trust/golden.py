"""Plans whose verdicts and lengths are kept: the paper's four cases and twenty scenes of each kind.

    python -m trust.golden --write    makes the file anew, to be committed with the reason

Another processor or release of an engine may change last digits, and by them which way round zones a search
goes; a verdict must stay, and lengths within a hundredth, or half of what they are where a search was needed.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import jaxplan as jp
from jaxplan.cases import SKY_KINDS
from jaxplan.schema import with_settings

FILE = Path(__file__).parents[1] / "data" / "golden_plans.json"
SEEDS = 20
SHARE, SEARCHED = 0.01, 0.5  # by which a length may differ, and where nodes were expanded
EQUAL = 1e-9  # by which it does on the same machine

NAMES = (
    *(f"case {number}" for number in (1, 2, 3, 4)),
    *(f"{kind} {seed}" for seed in range(SEEDS) for kind in SKY_KINDS),
)


def scenario_of(name: str) -> jp.Scenario:
    """The scenario of a name, without a limit of time."""
    kind, _, number = name.rpartition(" ")
    scenario = jp.paper_case(int(number)) if kind == "case" else jp.random_scenario(int(number), kind)
    return with_settings(scenario, {"search.time_limit_s": "off"})


def record(plan: jp.Plan) -> dict[str, object]:
    """What is kept of a plan."""
    return {
        "status": plan.status.name,
        "expansions": None if plan.search is None else plan.search.expansions,
        "edges": None if plan.path is None else plan.path.edges,
        "length_steps": None if plan.path is None else plan.path.length,
        "duration_s": None if plan.trajectory is None else plan.trajectory.duration,
        "slew_rad": None if plan.goal is None else plan.goal.slew_angle,
    }


def stored() -> dict[str, dict[str, object]]:
    return json.loads(FILE.read_text())


def differences(
    kept: Mapping[str, object], now: Mapping[str, object], share: float, searched: float | None = None
) -> list[str]:
    """Where a plan differs from what is kept of it: in its status, or in a length by more than a share."""
    found = []
    if searched is not None and (kept["expansions"] or now["expansions"]):
        share = searched
    if kept["status"] != now["status"]:
        found.append(f"status: {kept['status']} is kept, {now['status']} is found")
    for key in ("length_steps", "duration_s", "slew_rad"):
        old, new = kept[key], now[key]
        same = old is new is None or (
            None not in (old, new) and math.isclose(old, new, rel_tol=share, abs_tol=share)
        )
        if not same:
            found.append(f"{key}: {old} is kept, {new} is found")
    return found


def verdict(name: str, plan: jp.Plan) -> str:
    """A word on whether all digits are kept, too; raises where the plan is another."""
    kept, now = stored()[name], record(plan)
    wrong = differences(kept, now, SHARE, SEARCHED)
    assert not wrong, "; ".join(wrong)
    return "to all digits" if not differences(kept, now, EQUAL) else "in other digits"


def file_of(plan: jp.Plan, folder: Path) -> bytes:
    """A plan's file, without that of its times."""
    plan.save(folder / "plan.json")
    return (folder / "plan.json").read_bytes()


def files(names: Iterable[str], folder: Path, executor: int | None = None) -> dict[str, bytes]:
    """The files of plans made together."""
    names = list(names)
    plans = jp.plan_batch([scenario_of(name) for name in names], workers=executor, progress=False)
    return {name: file_of(plan, folder) for name, plan in zip(names, plans, strict=True)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="keep what is found now")
    options = parser.parse_args()
    plans = jp.plan_batch(map(scenario_of, NAMES))
    found = {name: record(plan) for name, plan in zip(NAMES, plans, strict=True)}
    if options.write:
        lines = ",\n".join(f" {json.dumps(name)}: {json.dumps(row)}" for name, row in found.items())
        FILE.write_text(f"{{\n{lines}\n}}\n")
        return 0
    wrong = {name: differences(stored()[name], found[name], SHARE, SEARCHED) for name in NAMES}
    for name, faults in wrong.items():
        print(*(f"{name}: {fault}" for fault in faults), sep="\n", end="\n" if faults else "")
    return int(any(wrong.values()))


if __name__ == "__main__":
    sys.exit(main())
