"""Names that are imported late: found in their homes, and never at the cost of the error of an import."""

import re
import subprocess
import sys

import pytest

from jaxplan.runtime.lazy_imports import late

PACKAGE = "some_package"


@pytest.fixture
def load(tmp_path, monkeypatch):
    """The ``__getattr__`` of a package with a value, a module, and a module that lacks what it needs."""
    folder = tmp_path / PACKAGE
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "good.py").write_text("value = 7")
    (folder / "bad.py").write_text("import a_library_that_is_not_there")
    monkeypatch.syspath_prepend(tmp_path)
    homes = {"value": "good:value", "good": "good", "bad": "bad", "of_bad": "bad:value"}
    yield late(PACKAGE, {name: f"{PACKAGE}.{home}" for name, home in homes.items()})
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        del sys.modules[name]


def test_a_name_is_a_value_in_its_home_or_a_module(load):
    __import__(PACKAGE)
    assert load("value") == 7
    assert load("good").value == 7
    with pytest.raises(AttributeError, match=f"module '{PACKAGE}' has no attribute 'other'"):
        load("other")


@pytest.mark.parametrize("name", ["bad", "of_bad"])
def test_an_import_that_fails_beneath_a_name_says_what_is_missing(load, name):
    with pytest.raises(ImportError, match="a_library_that_is_not_there"):
        load(name)


def test_figures_without_matplotlib_say_that_it_is_missing():
    program = "import sys; sys.modules['matplotlib'] = None\nimport jaxplan as jp\njp.plot.sphere"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert re.match("ModuleNotFoundError: .*matplotlib", done.stderr.splitlines()[-1])
