"""Blocks that look for no garbage leave Python's collector as they found it."""

import gc
import subprocess
import sys
import types

import pytest

from jaxplan.runtime.garbage import seldom_collected, uncollected
from jaxplan.runtime.lazy_imports import late


def test_blocks_may_lie_within_each_other_and_end_by_an_error():
    assert gc.isenabled()
    with uncollected():
        with pytest.raises(ArithmeticError), uncollected():
            raise ArithmeticError
        assert not gc.isenabled()
    assert gc.isenabled()


def test_a_collector_that_is_off_stays_off():
    gc.disable()
    try:
        with uncollected():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_late_names_are_imported_without_a_look_for_garbage(monkeypatch):
    seen = []

    def found(name):
        seen.append(gc.isenabled())
        return name

    monkeypatch.setattr("jaxplan.runtime.lazy_imports.resolve_name", found)
    monkeypatch.setitem(sys.modules, "package_of_late_names", types.ModuleType("package_of_late_names"))
    assert late("package_of_late_names", {"name": "home:name"})("name") == "home:name"
    assert seen == [False]
    assert gc.isenabled()


@pytest.mark.parametrize(("threshold", "within"), [(700, 100_000), (200_000, 200_000), (0, 0)])
def test_garbage_is_looked_for_seldom_within_blocks_and_as_before_after_them(threshold, within):
    before = gc.get_threshold()
    gc.set_threshold(threshold, 10, 10)
    try:
        with seldom_collected():
            with pytest.raises(ArithmeticError), seldom_collected():
                raise ArithmeticError
            assert gc.get_threshold() == (within, 10, 10)
        assert gc.get_threshold() == (threshold, 10, 10)
    finally:
        gc.set_threshold(*before)


@pytest.mark.parametrize("quickly", [False, True])
def test_a_process_may_end_without_a_last_search(quickly):
    program = f"""
from jaxplan.runtime.garbage import end_without_collection
class Loop:
    def __init__(self): self.own = self
    def __del__(self, say=print): say("found")
if {quickly}: end_without_collection()
keep = Loop()
"""
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert told.stdout == ("" if quickly else "found\n")
    assert told.stderr == ""
