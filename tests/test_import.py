"""What `import jaxplan` brings along, and what it leaves to those who need it."""

import json
import subprocess
import sys

import pytest

import jaxplan

HEAVY = ["erfa", "matplotlib", "osqp", "scipy.spatial", "sgp4", "tqdm"]


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
