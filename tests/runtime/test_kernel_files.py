"""Executables of kernels are kept between processes by what they follow from, and nothing else is."""

import shutil
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from processes import fresh_python

from jaxplan.goal.descent import descent_ends
from jaxplan.runtime import kernel_files
from jaxplan.runtime.jit import quick_jit
from jaxplan.search.expansion import _EXPANSION_KERNELS, _expand
from jaxplan.search.kernel_calls import Layout
from jaxplan.search.paths import edge_table

PLAN = """
import json, sys
from pathlib import Path
import jax
compiled = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **more: compiled.append(event) if "backend_compile" in event else None
)
import jaxplan as jp
from jaxplan.runtime.kernel_files import refused
plan = jp.plan(jp.random_scenario(3, "hard_keep_out"), progress=False)
folder = Path(jax.config.jax_compilation_cache_dir)
kept = [str(file) for file in folder.glob("kernels-*/*")]
print(json.dumps([len(compiled), refused(), kept, plan.path.length, plan.trajectory.duration]))
"""


@pytest.fixture(scope="module")
def planned_once(tmp_path_factory):
    """The home of a user who has planned once, and what that printed."""
    home = tmp_path_factory.mktemp("home")
    return home, fresh_python(PLAN, home)[0]


@pytest.fixture
def home(planned_once, tmp_path):
    """A copy of that home, to be changed."""
    return shutil.copytree(planned_once[0], tmp_path / "home")


@pytest.mark.slow
def test_a_later_process_plans_the_same_without_compiling_though_it_lowers_no_call_of_lapack(
    planned_once, home
):
    compiled, refused, kept, *first = planned_once[1]
    assert compiled >= len(kept) >= 5
    assert refused == 0
    (compiled, refused, again, *second), _ = fresh_python(PLAN, home)
    assert (compiled, refused) == (0, 0)
    there = [str(home / Path(file).relative_to(planned_once[0])) for file in kept]
    assert (sorted(again), second) == (sorted(there), first)


@pytest.mark.slow
def test_damaged_executables_are_compiled_again_and_counted(planned_once, home):
    first = planned_once[1][3:]
    kept = sorted(home.rglob("kernels-*/*"))
    assert len(kept) == len(planned_once[1][2])
    noise = np.random.default_rng(0).bytes(1000)
    for number, file in enumerate(kept):
        file.write_bytes([b"", noise, file.read_bytes()[:5000]][number % 3])
    (_, refused, _, *second), errors = fresh_python(PLAN, home)
    assert refused == len(kept)
    assert (second, errors) == (first, "")


def test_only_functions_that_follow_from_the_package_have_a_name():
    assert kernel_files.name_of(descent_ends.__wrapped__) == "jaxplan.goal.descent.descent_ends"
    assert kernel_files.name_of(_expand) == "jaxplan.search.expansion._expand"
    assert kernel_files.name_of(edge_table.__wrapped__).endswith("edge_table")
    both = {kernel_files.name_of(kernel.__wrapped__) for kernel in _EXPANSION_KERNELS.values()}
    assert len(both) == 2
    assert None not in both
    mapped = jax.vmap(descent_ends.__wrapped__)  # has the name of another function
    for foreign in (mapped, lambda x: x, partial(_expand, edges=object()), test_kinds_are_told_apart, np.sin):
        assert kernel_files.name_of(foreign) is None


def test_kinds_are_told_apart():
    trees = [jax.tree.structure(tree) for tree in (([1], 2), ([1, 2],), {"a": 1})]
    layouts = [Layout(tree, shapes, "dd") for tree in trees for shapes in (((1,), (2,)), ((2,), (1,)))]
    kinds = [
        *layouts, *trees, (1, 2), ((1,), 2), "1", 1, 1.0, True, None, float, int, np.float64,
        np.dtype(float), np.dtype(np.float32), ("names", ("a",)), ("names", ("a", "b")),
    ]  # fmt: skip
    texts = [kernel_files.text_of(kind) for kind in kinds]
    assert None not in texts
    assert len(set(texts)) == len(kinds)


def test_what_means_nothing_to_another_process_is_not_kept():
    @dataclass(frozen=True)
    class Foreign:
        part: object

    for kind in (object(), lambda: 0, Foreign(object()), (1, [object()]), np.sin):
        assert kernel_files.text_of(kind) is None


def test_kernels_are_told_apart_by_kinds_weak_types_statics_and_precision():
    shapes = []

    @partial(quick_jit, static_argnames="power")
    def kernel(x, y=1.0, *, power=1):
        shapes.append((x.shape, x.dtype, power))
        return x**power + y

    x = np.ones(3)
    for _ in range(2):
        np.testing.assert_array_equal(kernel(x, power=2), 2)
        np.testing.assert_array_equal(kernel(x, 2.0, power=3), 3)
        np.testing.assert_array_equal(kernel(x[:2]), 2)
        assert kernel(jnp.float32(1)).dtype == np.float32
        assert kernel(1.0).dtype == np.float64
        with jax.enable_x64(False):
            assert kernel(np.float32(1)).dtype == np.float32
            assert kernel(x).dtype == np.float32
    assert len(shapes) == 7


def test_parts_of_older_sources_are_cleared_away(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_files, "trusted_folder", lambda: tmp_path)
    lowered = jax.jit(jnp.sin).lower(1.0)
    for number in range(6):
        monkeypatch.setattr(kernel_files, "_sources_hash", lambda number=number: f"source-{number}")
        kernel_files._save_executable(
            kernel_files._executable_path("jaxplan.sine", "float"), lowered.compile(), calls_library=False
        )
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [f"kernels-source-{number}" for number in range(5 - kernel_files._KEPT_FOLDERS, 6)]


def test_an_executable_with_one_wrong_bit_is_not_run_but_deleted(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_files, "trusted_folder", lambda: tmp_path)
    place = kernel_files._executable_path("jaxplan.sine", "float")
    kernel_files._save_executable(place, jax.jit(jnp.sin).lower(1.0).compile(), calls_library=False)
    whole = place.read_bytes()
    assert kernel_files._read_executable(place) is not None
    for bit in np.random.default_rng(0).integers(8 * len(whole), size=20):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << (bit % 8)
        place.write_bytes(damaged)
        assert kernel_files._read_executable(place) is None
        assert not place.exists()


def test_what_cannot_be_written_whole_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_files, "trusted_folder", lambda: tmp_path)
    place = kernel_files._executable_path("jaxplan.sine", "float")

    def full(*_):
        raise OSError("no space left")

    monkeypatch.setattr(kernel_files.os, "replace", full)
    kernel_files._save_executable(place, jax.jit(jnp.sin).lower(1.0).compile(), calls_library=False)
    assert list(place.parent.iterdir()) == []


KEEP = """
import json
import jax
import jax.numpy as jnp
from jaxplan.runtime import cache, kernel_files
compiled = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, seconds, **more: compiled.append(event) if "backend_compile" in event else None
)
cache.keep_by_default()
kernel_files._sources_hash = lambda: SOURCES
known = kernel_files.load("jaxplan.sine", "float") is not None
compiled.clear()
sine = kernel_files.compile_and_keep(jax.jit(jnp.sin).lower(1.0), "jaxplan.sine", "float")
programs = list((cache.trusted_folder() / "programs").glob("*"))
print(json.dumps([known, len(compiled), float(sine(1.0)), len(programs)]))
"""


def test_what_other_sources_kept_of_the_same_program_is_kept_for_these_and_goes_with_the_last(tmp_path):
    found = [fresh_python(f"SOURCES = '{name}'{KEEP}", tmp_path)[0] for name in ("old", "new", "new")]
    assert [row[:2] for row in found] == [[False, 1], [False, 0], [True, 0]]
    assert all(row[2:] == [pytest.approx(np.sin(1.0)), 1] for row in found)
    parts = list(tmp_path.rglob("kernels-*"))
    assert len(parts) == 2
    for part in parts:
        for file in part.iterdir():
            file.unlink()
    kernel_files._prepare_folder(parts[0].parent / "kernels-newer")
    assert not list(parts[0].parent.glob("programs/*"))


@pytest.mark.slow
def test_processes_with_several_devices_take_no_executable_of_one(planned_once, home):
    first = planned_once[1][3:]
    several = 'import jax; jax.config.update("jax_num_cpu_devices", 3)' + PLAN
    (_, refused, _, *second), _ = fresh_python(several, home)
    assert refused == 0
    np.testing.assert_allclose(second, first, rtol=1e-6)


LIBRARY = """
import json
import jax, jax.numpy as jnp, numpy as np
from jaxplan.runtime import cache, kernel_files
cache.keep_by_default()
functions = {"sine": jnp.sin, "factor": jnp.linalg.cholesky}
found = []
for name, function in functions.items():
    kernel = kernel_files.load(f"jaxplan.{name}", "float")
    known = kernel is not None
    if not known:
        lowered = jax.jit(function).lower(4 * np.eye(2))
        kernel = kernel_files.compile_and_keep(lowered, f"jaxplan.{name}", "float")
    prepared = kernel_files._prepare_lapack.cache_info().currsize
    found.append([known, prepared, float(kernel(4 * np.eye(2, dtype=np.float32))[0, 0])])
print(json.dumps(found))
"""


def test_lapack_is_made_ready_for_executables_that_call_it_alone(tmp_path):
    fresh_python(LIBRARY, tmp_path)
    (sine, factor), _ = fresh_python(LIBRARY, tmp_path)
    assert sine == [True, 0, pytest.approx(np.sin(4.0))]
    assert factor == [True, 1, 2.0]


def test_lapack_is_made_ready_by_jax_where_its_own_way_is_not_known(tmp_path):
    fresh_python(LIBRARY, tmp_path)
    hidden = 'import sys, jax; sys.modules["jaxlib.lapack"] = None'
    (_, factor), _ = fresh_python(hidden + LIBRARY, tmp_path)
    assert factor == [True, 1, 2.0]
