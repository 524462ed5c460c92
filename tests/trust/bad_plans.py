"""Plan files that are to be refused, by every command that takes one, and exports that are."""

import io
import json
import pickle
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from builders import make_scenario
from tables import put

import jaxplan as jp

Command = tuple[str, ...]
Make = Callable[[Path], Command]


@cache
def good_plan() -> str:
    """The text of a plan that can be exported; it takes no time and little to make."""
    scenario = make_scenario(2, 1)
    plan = jp.plan(replace(scenario, goal=scenario.start), progress=False)
    with tempfile.TemporaryDirectory() as folder:
        plan.save(Path(folder) / "plan.json")
        return (Path(folder) / "plan.json").read_text()


class Trap:
    """Whoever unpickles it makes a file in the folder that the environment names."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return exec, ("import os; open(os.environ['JAXPLAN_TRAP'], 'w').close()",)


def plans() -> dict[str, tuple[Make, str]]:
    """Plan files, of which every command that takes one refuses any."""
    good = good_plan()

    def changed(*keys: object, value: object) -> bytes:
        return json.dumps(put(json.loads(good), keys, value)).encode()

    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("time_s.npy", b"\x00" * 50_000_000)
    whole = io.BytesIO()
    np.savez(whole, time_s=np.zeros(100))
    mirror = np.diag([1.0, 1.0, -1.0]).tolist()
    contents = {
        "empty": (b"", "not a plan file"),
        "cut off": (good.encode()[: len(good) // 2], "not a plan file"),
        "more behind it": (good.encode() + b"}", "not a plan file"),
        "a list": (b"[1, 2]", "no table at its top"),
        "NaN": (changed("goal", "slew_angle", value=float("nan")), "NaN is not allowed"),
        "minus infinity": (changed("trajectory", "breaks", value=[0, -np.inf]), "-Infinity is not allowed"),
        "beyond all numbers": (
            changed("goal", "slew_angle", value=12345).replace(b"12345", b"1e999"),
            "goal.slew_angle = inf: must be finite",
        ),
        "nested": (b"[" * 100_000, "not a plan file"),
        "another version": (changed("schema_version", value=99), "schema_version = 99: must be 1"),
        "no status": (changed("status", value="FINE"), 'status = "FINE": must be "OK"'),
        "a mirror for an attitude": (changed("goal", "attitude", value=mirror), "must be a rotation matrix"),
        "no orthonormal attitude": (
            changed("path", "attitudes", 0, value=[[1, 0, 0], [0, 1, 0], [0, 0.1, 1]]),
            "path.attitudes[0] = ",
        ),
        "joints of another craft": (
            changed("goal", "joints", value=[0.0] * 8),
            "must be an array of 4 numbers, not of 8",
        ),
        "a bad scenario": (
            changed("scenario", "spacecraft", "rate_limit_deg_s", value=-1),
            "scenario: spacecraft.rate_limit_deg_s = -1: must lie in [1e-6, 1e6]",
        ),
        "a device that there is not": (
            changed("report", "worst_device", value="nobody"),
            'report.worst_device = "nobody": no such device, the devices are terminal-1, terminal-2, ',
        ),
        "a certificate of a failure": (
            changed("status", value="UNCERTIFIED"),
            "report.certified = true: must",
        ),
        "a key of one's own": (changed("comment", value="mine"), "comment: unknown key"),
        "a pickle": (pickle.dumps(Trap()), "not a plan file"),
        "an archive": (whole.getvalue(), "not a plan file"),
        "an archive that is cut off": (whole.getvalue()[:200], "not a plan file"),
        "an archive of 50 MB of zeros": (bomb.getvalue(), "not a plan file"),
        "columns of Parquet": (b"PAR1" + bytes(range(256)) + b"PAR1", "not a plan file"),
    }
    commands = (("check",), ("plot",), ("report",), ("export", "--format", "csv"))
    found = {}
    for number, (name, (content, complaint)) in enumerate(contents.items()):
        words = commands[number % len(commands)]
        found[f"plan: {name}"] = (_plan_command(words, content), complaint)
    for word, source, complaint in [
        ("check", "/dev/zero", "at most 67108864 bytes are read"),
        ("plan", "/dev/zero", "larger than 1 MiB"),
        ("check", "", "PLAN is empty"),
        ("plan", "", "SCENARIO is empty"),
        ("check", "/", "/: is a folder, name a plan.json in it"),
        ("plan", "/nowhere/at/all.toml", "/nowhere/at/all.toml: no such file"),
        ("export --format npz", "/nowhere/plan.json", "/nowhere/plan.json: no such file"),
    ]:
        command = (*word.split(), source)
        found[f"source: {' '.join(command)}"] = (lambda folder, command=command: command, complaint)
    return found


def _plan_command(words: Command, content: bytes) -> Make:
    def make(folder: Path) -> Command:
        (folder / "plan.json").write_bytes(content)
        return (*words, str(folder / "plan.json"))

    return make


def exports() -> dict[str, tuple[Make, str]]:
    """Good plans, wrong wishes."""

    def wish(*words: str, beside: Callable[[Path], object] = lambda folder: None) -> Make:
        def make(folder: Path) -> Command:
            (folder / "plan.json").write_text(good_plan())
            beside(folder)
            return ("export", str(folder / "plan.json"), *(word.format(folder=folder) for word in words))

        return make

    csv = ("--format", "csv")
    there = ("-o", "{folder}/there")
    forged = json.loads(good_plan())
    forged["trajectory"]["joint_coefficients"][0][0][0] += 0.1

    def forge(folder: Path) -> None:
        (folder / "plan.json").write_text(json.dumps(forged))

    return {
        "export: a format that there is not": (
            wish("--format", "aen"),
            "format = 'aen': perhaps aem is meant",
        ),
        "export: no time": (wish("--format", "aem"), "format aem needs the UTC of the start"),
        "export: a bad time": (wish("--format", "stk", "--epoch", "soon"), "epoch = 'soon': must be a time"),
        "export: no step": (wish(*csv, "--step", "0"), "step_s = 0.0: must lie in [1e-06, inf)"),
        "export: a step that is no number": (wish(*csv, "--step", "nan"), "step_s = nan: must lie in"),
        "export: to nowhere": (wish(*csv, "-o", ""), "path is empty"),
        "export: below no folder": (wish(*csv, "-o", "/proc/nowhere/x.csv"), "/proc/nowhere"),
        "export: onto a file": (
            wish(*csv, *there, beside=lambda folder: (folder / "there").write_text("mine")),
            "is there already",
        ),
        "export: onto a folder": (
            wish(*csv, *there, "--force", beside=lambda folder: (folder / "there").mkdir()),
            "is a folder, and this format is a file",
        ),
        "export: onto a folder of something else": (
            wish(
                "--format",
                "stk",
                "--epoch",
                "2026-01-01",
                "--force",
                "-o",
                "{folder}",
            ),
            "holds plan.json, so it is not replaced",
        ),
        "export: below a file": (wish(*csv, "-o", "{folder}/plan.json/x.csv"), "plan.json"),
        "export: a plan that does not hold": (wish(*csv, beside=forge), "fails its certificate, made anew"),
        "report: onto a file": (
            lambda folder: _report(folder, "mine"),
            "is there already",
        ),
    }


def _report(folder: Path, text: str) -> Command:
    (folder / "plan.json").write_text(good_plan())
    (folder / "plan.html").write_text(text)
    return ("report", str(folder / "plan.json"))
