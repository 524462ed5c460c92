"""Studies that are to be refused: what is asked for, and folders that hold none, another or a trap."""

import os
from collections.abc import Callable
from pathlib import Path

from fake_study import plan_nothing, task

from jaxplan.study.run import run_task

Command = tuple[str, ...]
Make = Callable[[Path], Command]


def studies() -> dict[str, tuple[Make, str]]:
    """Studies that are none, and folders that hold none or another."""

    def plain(*words: str) -> Make:
        return lambda folder: ("study", "-n", "3", *(word.format(folder=folder) for word in words))

    def beside(change: Callable[[Path], object], *words: str) -> Make:
        def make(folder: Path) -> Command:
            run_task(task(3), None, folder / "study", 3, False, plan_nothing)
            change(folder / "study")
            if words:
                return ("study", *(word.format(folder=folder) for word in words))
            return ("study", "--kind", "keep_in", "-n", "3", "--out", str(folder / "study"))

        return make

    def header(text: str) -> Callable[[Path], object]:
        return lambda study: (study / "study.json").write_text(text)

    def linked(name: str, target: str) -> Callable[[Path], object]:
        def change(study: Path) -> None:
            (study / name).unlink()
            os.symlink(target, study / name)

        return change

    def foreign(folder: Path) -> Command:
        (folder / "thesis.tex").write_text("mine")
        return ("study", "-n", "3", "--out", str(folder))

    found = {
        "a kind that there is not": (plain("--kind", "easy"), "kind = 'easy': must be one of keep_out"),
        "a planner that there is not": (plain("--planner", "a*"), "planner = 'a*': must be one of mha"),
        "a seed below zero": (plain("--first-seed", "-3"), "seeds must be at least 0"),
        "half a setting": (plain("--set", "search.seed"), "--set search.seed: must be NAME=VALUE"),
        "a wrong setting": (
            plain("--set", "search.clearance_deg=nan"),
            "search.clearance_deg = nan: must be",
        ),
        "an unknown setting": (plain("--set", "search.sede=1"), "sede"),
        "its own setting": (plain("--set", "search.time_limit_s=1"), "search.time_limit_s: off in studies"),
        "nowhere": (plain("--out", ""), "out is empty"),
        "below no folder": (plain("--out", "/proc/nowhere"), "/proc/nowhere"),
        "no study": (plain("--report", "{folder}"), "-n says what to plan, but --report plans nothing"),
        "a folder of something else": (foreign, "holds thesis.tex, but no study"),
        "another number": (
            beside(lambda study: None, "--kind", "keep_in", "-n", "2", "--out", "{folder}/study"),
            "scenes 3 there, 2 here",
        ),
        "another kind": (
            beside(lambda study: None, "-n", "3", "--out", "{folder}/study"),
            'kind "keep_in" there, "keep_out" here',
        ),
        "a torn head": (beside(header('{"jaxplan": "0')), "not the head of a study"),
        "a head of NaN": (beside(header('{"scenes": NaN}')), "NaN is not allowed"),
        "a head without scenes": (beside(header('{"jaxplan": "0.1.0"}')), "is missing or wrong"),
        "a head that is nested": (beside(header("[" * 100_000)), "not the head of a study"),
        "a head without end": (beside(linked("study.json", "/dev/zero")), "not the head of a study"),
        "a table elsewhere": (beside(linked("table.jsonl", "/tmp/elsewhere")), "is a link"),
        "a lock elsewhere": (beside(linked(".lock", "/tmp/elsewhere")), "is a link"),
        "a report of nothing": (
            beside(lambda study: None, "--report", "{folder}/study", "{folder}"),
            "holds no study",
        ),
    }
    return {f"study: {name}": case for name, case in found.items()}
