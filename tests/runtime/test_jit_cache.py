"""What is compiled is forgotten before there is no room for more."""

import gc
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_scenario

import jaxplan as jp
from jaxplan.runtime import jit
from jaxplan.runtime.jit import clear_if_full, quick_jit

linux = pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="other systems have no such limit")


@pytest.fixture
def crowded(monkeypatch, tmp_path):
    """As if the maps of this process were too many already."""
    (tmp_path / "limit").write_text("0")
    monkeypatch.setattr(jit, "_MAPS_LIMIT_FILE", str(tmp_path / "limit"))


def compile_some(count, first):
    """Kernels of as many shapes, which no test has compiled."""
    kernel = jax.jit(lambda x: jnp.cos(x) + first)
    for size in range(count):
        kernel(np.zeros(size + 1))
    return kernel


@linux
def test_kernels_are_forgotten_where_their_maps_are_too_many(crowded):
    kernel = compile_some(jit._KERNELS_PER_CHECK, 1.0)
    assert kernel._cache_size() == jit._KERNELS_PER_CHECK
    assert clear_if_full()
    assert kernel._cache_size() == 0
    assert float(kernel(np.zeros(1))[0]) == 2.0


@linux
def test_who_tells_how_many_maps_are_too_many_is_answered_at_once():
    kernel = compile_some(1, 8.0)
    assert not clear_if_full(most_maps=1.0)
    assert kernel._cache_size() == 1
    assert clear_if_full(most_maps=0.0)
    assert kernel._cache_size() == 0


def test_nothing_is_forgotten_while_there_is_room():
    kernel = compile_some(jit._KERNELS_PER_CHECK, 2.0)
    assert not clear_if_full()
    assert kernel._cache_size() == jit._KERNELS_PER_CHECK


@linux
def test_few_new_kernels_are_not_worth_a_look(crowded):
    clear_if_full()
    kernel = compile_some(1, 3.0)
    assert not clear_if_full()
    assert kernel._cache_size() == 1


@linux
def test_plans_are_the_same_whatever_was_forgotten_between(crowded, tmp_path):
    scenario = make_scenario(1)
    paths = tmp_path / "before.json", tmp_path / "after.json"
    for path in paths:
        jp.plan(scenario).save(path)
        compile_some(jit._KERNELS_PER_CHECK, 4.0)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def live_executables():
    """How many programs XLA has in memory."""
    gc.collect()
    return len(jax.local_devices()[0].client.live_executables())


def test_the_older_half_of_our_kernels_is_forgotten_where_they_are_too_many(monkeypatch):
    def plus(x):
        return jnp.cos(x) + 6.0

    own, other = quick_jit(plus), compile_some(1, 7.0)
    for size in range(10):
        own(np.zeros(size + 1))
    count, live = jit.kernel_count(), live_executables()
    monkeypatch.setattr(jit, "_MOST_KERNELS", count)
    assert not clear_if_full()
    monkeypatch.setattr(jit, "_MOST_KERNELS", count - 1)
    assert clear_if_full()
    assert count / 2 - 1 <= jit.kernel_count() <= count - 5
    assert live_executables() <= live - 5  # JAX does not keep them, either
    assert other._cache_size() == 1  # what other code has jitted stays
    left = jit.kernel_count()
    own(np.zeros(10))
    assert jit.kernel_count() == left
    own(np.zeros(1))
    assert jit.kernel_count() == left + 1


def test_plans_are_the_same_after_our_kernels_were_forgotten(monkeypatch, tmp_path):
    scenario = make_scenario(1)
    jp.plan(scenario).save(tmp_path / "before.json")
    monkeypatch.setattr(jit, "_MOST_KERNELS", 0)
    jp.plan(scenario).save(tmp_path / "after.json")
    assert (tmp_path / "after.json").read_bytes() == (tmp_path / "before.json").read_bytes()


def test_systems_without_the_limit_forget_nothing(crowded, monkeypatch, tmp_path):
    monkeypatch.setattr(jit, "_MAPS_LIMIT_FILE", str(tmp_path / "none"))
    compile_some(jit._KERNELS_PER_CHECK, 5.0)
    assert not clear_if_full()
