"""What `import jaxplan` brings along, and what it leaves to those who need it."""

import ast
import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import jaxplan

ROOT = Path(__file__).parents[1]
BENCH = ROOT / "bench"
HEAVY = ["erfa", "matplotlib", "optax", "osqp", "scipy.spatial", "sgp4", "tqdm"]


def fresh_python(code):
    """What the code prints as JSON in an interpreter of its own."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.parametrize("names", [[], sorted(set(jaxplan.__all__) - {"plot"})], ids=["package", "all names"])
def test_importing_loads_no_package_that_only_some_need(names):
    code = f"""
import json, sys, jaxplan
for name in {names}: getattr(jaxplan, name)
print(json.dumps([name for name in {HEAVY} if name in sys.modules]))
"""
    assert fresh_python(code) == []


def test_importing_leaves_the_callers_precision_alone():
    code = """
import json, jax, jaxplan
for name in set(jaxplan.__all__) - {"plot"}: getattr(jaxplan, name)
print(json.dumps([jax.config.jax_enable_x64, jax.numpy.ones(1).dtype.name]))
"""
    assert fresh_python(code) == [False, "float32"]


def test_every_public_name_is_there():
    for name in jaxplan.__all__:
        assert getattr(jaxplan, name) is not None
    assert set(jaxplan.__all__) <= set(dir(jaxplan))


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'plann'"):
        _ = jaxplan.plann


@pytest.mark.parametrize("script", sorted(BENCH.glob("*.py")), ids=lambda script: script.stem)
def test_every_name_that_a_bench_imports_is_there(script):
    own = {path.stem for path in (ROOT / "tests").glob("*.py")}
    for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in {"jaxplan", *own}:
            module = import_module(node.module)
            for name in (alias.name for alias in node.names):
                assert hasattr(module, name) or import_module(f"{node.module}.{name}")
