"""Compiled code that is kept between processes: read by the next one, private, and never in the way."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import fresh_python

import jaxplan as jp

COUNT = """
import json, sys, jax
counts = {"hits": 0, "misses": 0}
def count(event, **_):
    for name in counts:
        counts[name] += event == f"/jax/compilation_cache/cache_{name}"
jax.monitoring.register_event_listener(count)
"""
ANGLE = """
import numpy as np
from jaxplan import so3
jax.jit(so3.distance)(np.eye(3), np.eye(3)).block_until_ready()
"""
TELL = """
print(json.dumps([counts["hits"], counts["misses"], jax.config.jax_compilation_cache_dir]))
"""


def test_a_second_process_reads_what_a_first_has_compiled(tmp_path):
    (*counts, folder), _ = fresh_python(COUNT + ANGLE + TELL, tmp_path)
    assert counts == [0, 1]
    found, errors = fresh_python(COUNT + ANGLE + TELL, tmp_path)
    assert (found, errors) == ([1, 0, folder], "")
    assert Path(folder).is_relative_to(tmp_path / ".cache" / "jaxplan")
    assert Path(folder).stat().st_mode & 0o777 == 0o700


@pytest.mark.slow
def test_a_plan_reads_what_a_worker_has_compiled(tmp_path):
    study = """
import jaxplan as jp
if __name__ == "__main__":
    jp.run_study(range(1), "keep_out", workers=1)
"""
    fresh_python(COUNT + study + TELL, tmp_path)
    plan = """
import os
if hasattr(os, "sched_setaffinity"):  # on one core nothing is compiled ahead, needed or not
    os.sched_setaffinity(0, set(list(os.sched_getaffinity(0))[:1]))
import jaxplan as jp
jp.plan(jp.random_scenario(0, "keep_out"), throw=False)
"""
    (*counts, _), errors = fresh_python(COUNT + plan + TELL, tmp_path)
    assert counts == [0, 0]  # not even JAX's own cache is asked
    assert errors == ""


KERNEL = """
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
import jax, numpy as np
from jaxplan.goal.descent import descent_ends
from jaxplan.runtime import cache
name = "jax_persistent_cache_min_compile_time_secs"
cache.keep_by_default()
before = getattr(jax.config, name)
given = (np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), np.zeros(1, int), np.zeros(1, int))
with ThreadPoolExecutor(2) as pool:
    for lanes in (2, 3):
        pool.submit(descent_ends, np.eye(4)[:, :lanes], *given)
    told = cache.settings()[name]
after = getattr(jax.config, name)
jax.jit(lambda x: x + 1)(1.0)
files = [file.name for file in Path(jax.config.jax_compilation_cache_dir).rglob("*") if file.is_file()]
by_jax = [file for file in files if file.startswith("jit_")]
print(json.dumps([before, told, after, by_jax, len(files)]))
"""


@pytest.mark.slow
def test_what_is_kept_by_us_is_not_kept_by_jax_once_more(tmp_path):
    (before, told, after, by_jax, files), errors = fresh_python(KERNEL, tmp_path)
    assert errors == ""
    assert (before, told, after) == (0.0, 0.0, 0.0)
    assert by_jax
    assert not any("descent_ends" in file for file in by_jax)
    assert files - len(by_jax) >= 2


@pytest.mark.slow
def test_workers_keep_nothing_where_their_parent_does_not(tmp_path):
    code = """
import json
import jaxplan as jp
from jaxplan.runtime.workers import WorkerPool
LOOK = "__import__('jaxplan.so3') and __import__('jax').config.jax_compilation_cache_dir"
if __name__ == "__main__":
    jp.compilation_cache(None)
    pool = WorkerPool(1)
    print(json.dumps(pool.submit(eval, LOOK).result()))
    pool.shutdown(at_once=True)
"""
    assert fresh_python(code, tmp_path)[0] is None
    kept = code.replace("jp.compilation_cache(None)", "pass")
    assert fresh_python(kept, tmp_path)[0].startswith(str(tmp_path))


def test_it_can_be_moved_and_turned_off_even_after_something_was_compiled(tmp_path):
    here, there = tmp_path / "home", tmp_path / "there"
    moved = f"""
import jaxplan as jp
jp.compilation_cache({str(there)!r})
jax.clear_caches()
"""
    off = """
import jaxplan as jp
jp.compilation_cache(None)
jax.clear_caches()
"""
    (_, misses, folder), _ = fresh_python(COUNT + ANGLE + moved + ANGLE + TELL, here)
    assert (misses, folder) == (2, str(there))
    assert len(list(there.iterdir())) == 1
    assert fresh_python(COUNT + ANGLE + off + ANGLE + TELL, here)[0] == [1, 0, None]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "environment", "wanted"),
    [
        ("", {"JAX_COMPILATION_CACHE_DIR": "mine"}, "mine"),
        ('jax.config.update("jax_compilation_cache_dir", "mine")', {}, "mine"),
        ("import jaxplan as jp; jp.compilation_cache(None)", {}, None),
        ("", {"XDG_CACHE_HOME": "/proc/self/nowhere"}, None),
        ("", {"XDG_CACHE_HOME": "file"}, "home"),  # not absolute, so it is not looked at
        ("", {"HOME": "home"}, None),
    ],
    ids=["JAX's variable", "JAX's setting", "off", "unwritable", "relative", "relative home"],
)
def test_what_the_user_has_chosen_is_left_alone(tmp_path, monkeypatch, before, environment, wanted):
    monkeypatch.chdir(tmp_path)
    (*_, folder), errors = fresh_python(COUNT + before + ANGLE + TELL, tmp_path / "home", **environment)
    assert errors == ""
    assert folder == wanted or (wanted == "home" and folder.startswith(str(tmp_path / "home")))


@pytest.mark.slow
def test_a_folder_that_others_may_write_to_is_not_used(tmp_path):
    (*_, folder), _ = fresh_python(COUNT + ANGLE + TELL, tmp_path)
    for mode in (0o777, 0o720, 0o702):
        Path(folder).chmod(mode)
        assert fresh_python(COUNT + ANGLE + TELL, tmp_path)[0] == [0, 0, None]
        with pytest.raises(ValueError, match=r"folder = .*: others may write there"):
            jp.compilation_cache(folder)


def test_a_folder_below_one_that_others_may_write_to_is_not_used_whether_by_a_link_or_not(tmp_path):
    above = {mode: tmp_path / f"shared {mode:o}" for mode in (0o777, 0o707, 0o702, 0o1777, 0o755)}
    asked = {}
    for mode, shared in above.items():
        cache, link = shared / "mine" / "compiled", tmp_path / f"link {mode:o}"
        cache.mkdir(mode=0o700, parents=True)
        shared.chmod(mode)
        link.symlink_to(cache)
        asked |= {os.fspath(cache): mode, os.fspath(link): mode}
    said, _ = fresh_python(
        f"""
import json, jaxplan as jp
def said(folder):
    try:
        jp.compilation_cache(folder)
    except ValueError as error:
        return str(error)
    return ""
print(json.dumps([said(folder) for folder in {list(asked)!r}]))
""",
        tmp_path,
    )
    for (folder, mode), words in zip(asked.items(), said, strict=True):
        refused = f"folder = {folder!r}: others may write in {above[mode]}, "
        assert words.startswith(refused) if mode in (0o777, 0o707, 0o702) else words == ""


def test_the_users_own_cache_is_not_used_where_others_may_swap_it(tmp_path):
    (*_, folder), _ = fresh_python(COUNT + ANGLE + TELL, tmp_path)
    assert folder is not None
    (tmp_path / ".cache").chmod(0o777)
    assert fresh_python(COUNT + ANGLE + TELL, tmp_path)[0] == [0, 0, None]


@pytest.mark.parametrize(
    ("folder", "error", "said"),
    [(3, TypeError, "folder must be a path.*not int"), ("", ValueError, "folder is empty")],
)
def test_what_is_no_folder_is_refused_by_name(folder, error, said):
    with pytest.raises(error, match=said):
        jp.compilation_cache(folder)


def test_a_folder_that_cannot_be_made_is_refused_where_it_is_asked_for(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ValueError, match=r"folder = '.*file': it is a file: name a folder"):
        jp.compilation_cache(tmp_path / "file")
    with pytest.raises(OSError, match="file"):
        jp.compilation_cache(tmp_path / "file" / "folder")
    assert (tmp_path / "file").read_text() == "mine"


CACHE = """
import json, sys, warnings
from pathlib import Path
import jax, numpy as np
from jax.experimental.compilation_cache import compilation_cache
from jaxplan import so3

def answer():
    jax.clear_caches()
    compilation_cache.reset_cache()
    with jax.enable_x64(True), warnings.catch_warnings(record=True) as caught:
        value = jax.jit(so3.exp)(np.array([0.1, -0.2, 0.3]))
    return np.asarray(value).tobytes().hex(), len(caught)

folder = Path(jax.config.jax_compilation_cache_dir)
fresh, again = answer(), answer()
files = [file for file in folder.rglob("*") if file.is_file()]
found = {"files": len(files), "fresh": fresh, "again": again}
for name, damage in {
    "empty": lambda old: b"",
    "cut off": lambda old: old[: len(old) // 2],
    "zeros": lambda old: bytes(len(old)),
    "noise": lambda old: np.random.default_rng(0).bytes(len(old)),
}.items():
    for file in files:
        file.write_bytes(damage(file.read_bytes() or b"x" * 100))
    found[name] = answer()
jax.config.update("jax_compilation_cache_dir", "/proc/self/nowhere")
found["unwritable"] = answer()
print(json.dumps([oct(folder.stat().st_mode)[-3:], found]))
"""


def test_a_damaged_or_unwritable_cache_of_compiled_code_changes_no_answer(tmp_path):
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    environment |= {"XDG_CACHE_HOME": str(tmp_path), "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-c", CACHE], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    mode, found = json.loads(done.stdout)
    assert mode == "700"
    assert found.pop("files") > 0
    assert len({value for value, _ in found.values()}) == 1
    assert {warnings for _, warnings in found.values()} == {0}
