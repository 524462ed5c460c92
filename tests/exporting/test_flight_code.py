"""Code and pieces to fly beside the trajectory's own samples, by every compiler that there is."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import make_scenario
from exports import flown_day, flown_plan
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.exporting.flight_code import prefix_of

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")
WAYS = {
    "gcc": ("gcc", "-O0"),
    "gcc, optimised": ("gcc", "-O3"),
    "clang": ("clang", "-O0"),
    "clang, optimised": ("clang", "-O3"),
    "gcc, 32 bits": ("gcc", "-O2", "-m32", "-msse2", "-mfpmath=sse"),
    "gcc, 32 bits, x87": ("gcc", "-O2", "-m32"),
    "gcc, sanitizers": ("gcc", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover"),
}
DRIVER = """#include "{name}.h"
#include <stdio.h>

int main(void)
{{
    double t;
    {name}_state state;

    while (fread(&t, sizeof t, 1, stdin) == 1)
    {{
        const double status = (double){name}_evaluate(t, &state);
        fwrite(&status, sizeof status, 1, stdout);
        fwrite(&state, sizeof state, 1, stdout);
    }}
    return ({name}_evaluate(0.0, NULL) == {upper}_NO_STATE) ? 0 : 1;
}}
"""
# Stands for double in C++ and counts what is done with it.
COUNTED = """#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
static long done[5];
struct counted {
    double v;
    counted(double x = 0) : v(x) {}
    counted operator-() const { return counted(-v); }
};
static counted operator*(counted a, counted b) { done[0]++; return a.v * b.v; }
static counted operator+(counted a, counted b) { done[1]++; return a.v + b.v; }
static counted operator-(counted a, counted b) { done[1]++; return a.v - b.v; }
static counted operator/(counted a, counted b) { done[2]++; return a.v / b.v; }
static counted sin(counted a) { done[3]++; return std::sin(a.v); }
static counted cos(counted a) { done[3]++; return std::cos(a.v); }
static counted sqrt(counted a) { done[4]++; return std::sqrt(a.v); }
static bool operator<(counted a, counted b) { return a.v < b.v; }
static bool operator>(counted a, counted b) { return a.v > b.v; }
static bool operator<=(counted a, counted b) { return a.v <= b.v; }
static bool operator>=(counted a, counted b) { return a.v >= b.v; }
#define double counted
"""
COUNTER = """
#undef double
int main()
{{
    long most[5] = {{0, 0, 0, 0, 0}};
    for (int i = 0; i <= 3000; i++) {{
        {name}_state state;
        for (int k = 0; k < 5; k++) done[k] = 0;
        {name}_evaluate(counted({duration} * i / 3000.0), &state);
        for (int k = 0; k < 5; k++) if (done[k] > most[k]) most[k] = done[k];
    }}
    std::printf("%ld %ld %ld %ld %ld", most[0], most[1], most[2], most[3], most[4]);
    return 0;
}}
"""


@pytest.fixture(scope="module")
def motions():
    """A manoeuvre, a day with an instant, one without joints, one on moving charts, and one that stands."""
    bare, resting = flown_plan(seed=5, terminals=1), make_scenario(2, 1)
    craft = replace(
        bare.scenario.spacecraft,
        terminals=(),
        instruments=(jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),),
    )
    ends = {
        key: replace(getattr(bare.scenario, key), joints=np.zeros(0), joint_rates=np.zeros(0))
        for key in ("start", "goal")
    }
    still = replace(
        bare,
        scenario=replace(bare.scenario, spacecraft=craft, **ends),
        goal=replace(bare.goal, joints=np.zeros(0)),
        trajectory=replace(
            bare.trajectory,
            joint_coefficients=np.zeros((1, 1, 0)),
            joint_breaks=bare.trajectory.breaks[[0, -1]],
        ),
    )
    return {
        "a manoeuvre": flown_plan(),
        "a day": flown_day(),
        "without joints": still,
        "on charts that move": jp.plan(jp.paper_case(2), progress=False),
        "at rest": jp.plan(replace(resting, goal=resting.start), progress=False),
    }


@pytest.fixture(scope="module")
def written(motions, tmp_path_factory):
    """Each motion as code and as pieces; a folder and a file."""
    place = tmp_path_factory.mktemp("flight")
    made = {}
    for number, (name, motion) in enumerate(motions.items()):
        code = jp.export(motion, place / f"{number}", format="c")
        made[name] = code, jp.export(motion, place / f"{number}.json", format="json")
    return made


def instants(motion):
    """Times of a motion, s: drawn ones, all breaks and what is just before them."""
    trajectory = motion.trajectory
    breaks = np.union1d(trajectory.breaks, trajectory.joint_breaks)
    drawn = np.random.default_rng(1).uniform(0, trajectory.duration, 4000)
    return np.sort(np.concatenate([drawn, breaks, np.nextafter(breaks[1:], 0)]))


def built(folder, way):
    """A program of a folder's code that reads times and writes states, compiled without a warning."""
    compiler, *options = WAYS[way]
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler}")
    (source,) = folder.glob("*.c")
    work = folder.parent / f"{folder.name} {way}"
    work.mkdir(exist_ok=True)
    driver = work / "driver.c"
    driver.write_text(DRIVER.format(name=source.stem, upper=source.stem.upper()))
    if "-m32" in options:
        probe = work / "probe.c"
        probe.write_text("#include <stdio.h>\nint main(void) { return 0; }\n")
        if subprocess.run([compiler, *options, probe, "-o", work / "probe"], capture_output=True).returncode:
            pytest.skip("no libraries of 32 bits")
    call = [compiler, *STRICT, *options, f"-I{folder}", source, driver, "-lm", "-o", work / "flown"]
    made = subprocess.run(call, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return work / "flown"


def flown(program, times, joints):
    """Status, quaternion, attitude, rates, accelerations, and those of the joints, of a program at times."""
    run = subprocess.run([program], input=np.asarray(times, float).tobytes(), capture_output=True)
    assert run.returncode == 0, run.stderr
    assert not run.stderr
    table = np.frombuffer(run.stdout).reshape(len(times), 20 + 3 * joints)
    parts = np.split(table, np.cumsum([1, 4, 9, 3, 3, joints, joints]), axis=1)
    return [parts[0][:, 0], parts[1], parts[2].reshape(-1, 3, 3), *parts[3:]]


@pytest.mark.parametrize("way", WAYS)
def test_the_code_gives_what_the_trajectory_does(motions, written, way):
    for name, motion in motions.items():
        times, trajectory = instants(motion), motion.trajectory
        joints = trajectory.joint_coefficients.shape[2]
        status, quaternion, attitude, *others = flown(built(written[name][0], way), times, joints)
        known = trajectory.sample(times)
        assert not np.any(status), name
        np.testing.assert_allclose(attitude, known.attitude, rtol=0, atol=1e-13, err_msg=name)
        turned = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        np.testing.assert_allclose(turned, known.attitude, rtol=0, atol=1e-13, err_msg=name)
        assert np.all(np.sum(quaternion[1:] * quaternion[:-1], axis=1) > 0.9), name
        own = (
            known.angular_velocity,
            known.angular_acceleration,
            known.joints,
            known.joint_rates,
            known.joint_accelerations,
        )
        for got, expected in zip(others, own, strict=True):
            scale = np.max(np.abs(expected), initial=1e-12)
            np.testing.assert_allclose(got / scale, expected / scale, rtol=0, atol=1e-13, err_msg=name)


def test_outside_the_motion_the_state_is_held_and_the_status_says_so(motions, written):
    motion = motions["a manoeuvre"]
    last = motion.trajectory.duration
    times = [-1.0, -np.inf, np.nextafter(last, 2 * last), np.inf, np.nan]
    status, _, attitude, *others = flown(built(written["a manoeuvre"][0], "gcc, sanitizers"), times, 4)
    assert status.tolist() == [1, 1, 2, 2, 3]
    held = motion.trajectory.sample([0, 0, last, last, 0])
    np.testing.assert_allclose(attitude, held.attitude, atol=1e-13)
    np.testing.assert_allclose(others[2], held.joints, atol=1e-13)
    for rates in (*others[:2], *others[3:]):
        assert not np.any(rates)


def test_a_call_takes_no_more_operations_than_the_header_says(written, tmp_path):
    if shutil.which("g++") is None:
        pytest.skip("no g++")
    for number, name in enumerate(("a manoeuvre", "without joints", "on charts that move")):
        folder = written[name][0]
        (source,), (header,) = folder.glob("*.c"), folder.glob("*.h")
        told = re.search(r"worst case +(.*)", header.read_text())[1]
        most = [int(word) for word in re.findall(r"\d+", told)][:5]
        duration = re.search(r"_DURATION \((.*)\) /\*", header.read_text())[1]
        text = re.sub(r"#ifdef __cplusplus.*?#endif", "", header.read_text(), flags=re.DOTALL)
        text = text.replace(f"({duration})", f"(counted({duration}))")
        code = re.sub(r"#include.*", "", source.read_text())
        work = tmp_path / f"{number}.cc"
        work.write_text(COUNTED + text + code + COUNTER.format(name=source.stem, duration=duration))
        subprocess.run(["g++", "-w", work, "-o", tmp_path / f"{number}"], check=True)
        found = subprocess.run([tmp_path / f"{number}"], capture_output=True, text=True, check=True).stdout
        counted = [int(word) for word in found.split()]
        assert all(own <= limit for own, limit in zip(counted, most, strict=True)), (name, counted, most)
        assert counted[:2] == most[:2] or counted[3] > 4, name  # beyond a radian sines stand for the series


def test_pieces_are_the_motion_for_the_reader_of_the_manual(motions, written):
    page = (Path(__file__).parents[2] / "docs" / "flight.md").read_text(encoding="utf-8")
    (reader,) = re.findall(r"```python\n([^`]*def attitude.*?)```", page, re.DOTALL)
    names: dict[str, Any] = {}
    exec(reader, names)
    for name, motion in motions.items():
        held = json.loads(written[name][1].read_text())
        times, known = instants(motion)[::7], motion.trajectory.sample(instants(motion)[::7])
        for place, t in enumerate(times):
            own = names["attitude"](held, t)
            np.testing.assert_allclose(own.as_matrix(), known.attitude[place], atol=1e-13, err_msg=name)
        scene = motion.scenario if isinstance(motion, jp.Plan) else motion.scene
        assert held["joints"]["names"] == list(scene.spacecraft.joint_names)
        assert held["duration_s"] == motion.trajectory.duration


def test_polynomials_take_no_step_and_nothing_is_written(motions, tmp_path):
    for name in ("c", "json"):
        with pytest.raises(ValueError, match="holds polynomials and no samples"):
            jp.export(motions["a manoeuvre"], tmp_path / "out", format=name, step_s=0.1)
    assert not list(tmp_path.iterdir())


def test_the_command_line_says_what_the_code_needs(motions, tmp_path, capsys):
    motions["on charts that move"].save(tmp_path / "plan.json")
    assert main(["export", str(tmp_path / "plan.json"), "--format", "c"]) == 0
    told = capsys.readouterr().err
    assert re.search(r"wrote .*plan.c99: \d+ pieces, \d+ bytes of tables; a call takes \d+ mult", told), told
    names = sorted(path.suffix for path in (tmp_path / "plan.c99").iterdir())
    assert names == [".c", ".h"]


def test_names_of_any_kind_become_names_of_c(motions, tmp_path):
    plan = motions["on charts that move"]
    for number, name in enumerate(("3 % \u03c0 */ slew??/", "x" * 60, "-", "int")):
        named = replace(plan, scenario=replace(plan.scenario, name=name))
        folder = jp.export(named, tmp_path / f"{number}", format="c")
        (source,) = folder.glob("*.c")
        assert re.fullmatch(r"[a-z][a-z0-9_]{0,17}", source.stem), source.stem
        assert "*/" not in source.read_text().split("\n", 1)[0]
        if shutil.which("gcc"):
            call = ["gcc", *STRICT, "-c", source, "-o", tmp_path / "object"]
            assert subprocess.run(call, capture_output=True).returncode == 0


@pytest.mark.parametrize(
    ("title", "prefix"),
    [
        ("Deimos-2 over Madrid", "deimos_2_over_madr"),
        ("a  b--c", "a_b_c"),
        ("7 of nine", "m_7_of_nine"),
        ("\u03c0", "motion"),
        ("a name that is - cut", "a_name_that_is_cut"),
    ],
)
def test_code_is_called_after_the_title(title, prefix):
    assert prefix_of(title) == prefix
