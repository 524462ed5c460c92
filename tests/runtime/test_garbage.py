"""Blocks that look for no garbage leave Python's collector as they found it."""

import gc
import sys
import types

import pytest

from jaxplan.runtime.garbage import uncollected
from jaxplan.runtime.late import late


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

    monkeypatch.setattr("jaxplan.runtime.late.resolve_name", found)
    monkeypatch.setitem(sys.modules, "package_of_late_names", types.ModuleType("package_of_late_names"))
    assert late("package_of_late_names", {"name": "home:name"})("name") == "home:name"
    assert seen == [False]
    assert gc.isenabled()
