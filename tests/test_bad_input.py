"""Bad input on the command line: refused with place, value and range, without harm. See `trust.bad_input`."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import pytest
from builders import make_scenario
from trust import bad_input
from trust.bad_plans import exports, plans
from trust.bad_scenarios import scenarios
from trust.bad_studies import studies

import jaxplan as jp
from jaxplan.cli import main

SOURCES = sorted(Path(jp.__file__).parent.rglob("*.py"))
COMPILED_KERNELS = Path(jp.__file__).parent / "runtime" / "kernel_files.py"  # the one that reads code


@pytest.mark.parametrize("make", [scenarios, plans, exports, studies])
def test_what_is_no_good_is_refused_and_nothing_is_written(make):
    for name in make():
        try:
            bad_input.attempt(name)
        except AssertionError as error:
            raise AssertionError(f"{name}: {error}") from error


def test_they_are_many_and_all_different():
    names = bad_input.cases()
    assert len(names) >= 120
    assert len({complaint for _, complaint in names.values()}) >= 100


FORBIDDEN = {"pickle", "joblib", "dill", "cloudpickle", "marshal", "shelve", "yaml"}


def test_nothing_that_executes_what_it_reads_is_in_the_package():
    """Nothing reads a pickle, an archive of numpy, or text as code, but for what is code: compiled kernels.

    These are read from a folder in which nobody but the user can write, or not at all.
    """
    assert COMPILED_KERNELS in SOURCES
    for source in SOURCES:
        if source == COMPILED_KERNELS:
            continue
        text = source.read_text()
        if not re.search(
            rf"\b({'|'.join(FORBIDDEN)}|eval|exec|compile|load|fromfile|shell|allow_pickle)\b", text
        ):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                assert not FORBIDDEN & {alias.name.partition(".")[0] for alias in node.names}, source
            elif isinstance(node, ast.ImportFrom):
                assert (node.module or "").partition(".")[0] not in FORBIDDEN, source
            elif isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                assert name not in {"eval", "exec", "compile", "numpy.load", "np.fromfile"}, source
                keywords = {word.arg: ast.unparse(word.value) for word in node.keywords}
                assert name != "np.load" or "allow_pickle" in keywords, source
                assert keywords.get("allow_pickle", "False") == "False", source
                assert keywords.get("shell") != "True", source


def test_names_that_lead_elsewhere_stay_in_their_folder(tmp_path, capsys):
    """Names of a scenario and its devices are text, whatever they look like."""
    scenario = make_scenario(2, 1)
    craft = scenario.spacecraft
    odd = ("../../../elsewhere", "/etc/passwd")
    terminals = tuple(replace(t, name=name) for t, name in zip(craft.terminals, odd, strict=True))
    named = replace(
        scenario, name="../" * 9, goal=scenario.start, spacecraft=replace(craft, terminals=terminals)
    )
    home = tmp_path / "a" / "b" / "c"
    jp.plan(named, progress=False).save(home / "plan.json")
    for name in ("stk", "aem", "csv", "basilisk", "npz"):
        words = ["export", str(home / "plan.json"), "--format", name, "--epoch", "2026-01-01"]
        assert main(words) == 0, capsys.readouterr().err
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert len(files) > 6
    assert all(home in file.parents for file in files)
