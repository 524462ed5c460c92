"""What is not exported, what is not overwritten, and what a failure leaves behind."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from builders import make_scenario
from exports import EPOCH, flown_plan
from reference import assert_each
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.exporting import FORMATS, formats
from jaxplan.exporting.flight import Flight
from jaxplan.exporting.instants import steady_instants
from jaxplan.exporting.sampled import Sampling
from jaxplan.geometry import quaternion
from jaxplan.model.epochs import parse_epoch, utc_texts
from jaxplan.model.export_names import labels

STEP = 0.05


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


def instants(duration: float, step: float) -> np.ndarray:
    """Those of a single manoeuvre."""
    return steady_instants(np.unique([0.0, duration]), step)


def test_the_instants_are_multiples_of_the_step_and_the_end():
    np.testing.assert_allclose(instants(1.0, 0.3), [0, 0.3, 0.6, 0.9, 1])
    np.testing.assert_allclose(instants(0.9, 0.3), [0, 0.3, 0.6, 0.9])
    np.testing.assert_allclose(instants(0.90001, 0.3), [0, 0.3, 0.6, 0.90001])
    assert instants(1.0, 5.0).tolist() == [0, 1]
    assert instants(80.0, 1e9).tolist() == [0, 80]
    for duration in np.random.default_rng(1).uniform(0.1, 100, 200):
        times = instants(duration, 0.1)
        assert times[-1] == duration
        assert_each(np.diff(times), ">", 9e-5)


def test_quaternions_turn_twice_around_without_a_jump():
    axis = np.array([0.36, -0.48, 0.8])
    turns = Rotation.from_rotvec(np.linspace(0.1, 4 * np.pi, 300)[:, None] * axis).as_matrix()
    quaternions = quaternion.continuous(turns)
    assert_each(np.sum(quaternions[1:] * quaternions[:-1], axis=1), ">", 0.99)
    assert quaternions[0, 0] > 0
    back = Rotation.from_quat(quaternions, scalar_first=True).as_matrix()
    np.testing.assert_allclose(back, turns, atol=1e-14)


def test_epochs_are_read_as_utc():
    expected = np.datetime64("2026-01-01T10:00:00.5", "ns")
    for text in ("2026-01-01T10:00:00.5", "2026-01-01T10:00:00.500Z", "2026-01-01T12:30:00.5+02:30"):
        assert parse_epoch(text) == expected
    for text in (
        "soon",
        "",
        "2026-02-30",
        "1971-12-31T23:59:59",
        "2100-01-01",
        12,
        "nan",
        "0001-01-01T00:00:00+14:00",
    ):
        with pytest.raises(ValueError, match="epoch = "):
            parse_epoch(text)


def test_a_leap_second_is_second_sixty():
    pytest.importorskip("erfa", reason="pyerfa is not installed")
    texts = utc_texts(parse_epoch("2016-12-31T23:59:59.5"), np.array([0, 0.5, 1.25, 1.5, 61.5]))
    assert texts == [
        "2016-12-31T23:59:59.500000000",
        "2016-12-31T23:59:60.000000000",
        "2016-12-31T23:59:60.750000000",
        "2017-01-01T00:00:00.000000000",
        "2017-01-01T00:01:00.000000000",
    ]
    texts = utc_texts(parse_epoch("2025-12-31T23:59:59.5"), np.array([0, 0.5, 1.5]))
    assert [text[11:21] for text in texts] == ["23:59:59.5", "00:00:00.0", "00:00:01.0"]


def test_labels_of_devices_differ_and_are_plain():
    names = ["a/b", "A_b", "", "x" * 40, "bus", "\u03b1", "device_2", "fine-1"]
    found = labels(names, taken=["bus"], longest=12)
    assert len({label.lower() for label in found} | {"bus"}) == len(names) + 1
    assert (found[0], found[-1]) == ("a_b", "fine-1")
    assert all(label.isascii() and 0 < len(label) <= 12 for label in found)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": "aen"}, "format = 'aen': perhaps aem is meant; the formats are aem, ck"),
        ({"format": "spice"}, "the formats are aem, ck, stk, czml, basilisk, csv, npz, c, json"),
        ({"epoch": "tomorrow"}, "epoch = 'tomorrow': must be a time in UTC such as"),
        ({"epoch": None}, "format aem needs the UTC of the start"),
        ({"step_s": 0}, r"step_s = 0: must lie in \[1e-06, inf\)"),
        ({"step_s": float("nan")}, "step_s = nan: must lie in"),
        ({"step_s": float("inf")}, "step_s = inf: must lie in"),
        ({"step_s": 1e-6}, "a file holds at most 10000000 samples"),
        ({"format": "aen", "epoch": "x", "step_s": -1}, "3 faults:\n.*aen.*\n.*epoch.*\n.*step_s"),
    ],
)
def test_bad_wishes_are_refused_all_at_once(plan, tmp_path, changes, words):
    wishes = {"format": "aem", "epoch": EPOCH} | changes
    with pytest.raises(ValueError, match=words):
        jp.export(plan, tmp_path / "file", **wishes)
    assert not list(tmp_path.iterdir())


def test_an_epoch_is_that_of_the_scene_and_no_other(plan, tmp_path):
    own = replace(plan, scenario=replace(plan.scenario, epoch=parse_epoch(EPOCH)))
    files = [
        jp.export(one, tmp_path / f"{i}", format="aem", epoch=e)
        for i, (one, e) in enumerate(((plan, EPOCH), (own, None), (own, EPOCH)))
    ]
    # They may have been written in different seconds.
    texts = [re.sub("CREATION_DATE = .*", "", file.read_text()) for file in files]
    assert len(set(texts)) == 1
    with pytest.raises(
        ValueError, match=r"epoch = '2026-03-01': the scene begins at 2026-03-01T06:30:15\.25"
    ):
        jp.export(own, tmp_path / "other", format="aem", epoch="2026-03-01")
    assert not (tmp_path / "other").exists()


def test_only_certified_plans_are_exported(plan, tmp_path):
    off = plan.trajectory.joint_coefficients.copy()
    off[0, 3] += 0.02  # so that pieces do not meet
    broken = np.full_like(off, np.nan)
    for refused, words in {
        replace(
            plan, status=jp.Status.UNCERTIFIED, message="too near"
        ): "not certified.*UNCERTIFIED: too near",
        replace(plan, status=jp.Status.NO_PATH, trajectory=None): "no trajectory; it ended as NO_PATH",
        replace(plan, trajectory=replace(plan.trajectory, joint_coefficients=off)): "fails its certificate",
        replace(
            plan, trajectory=replace(plan.trajectory, joint_coefficients=broken)
        ): "fails its certificate",
    }.items():
        with pytest.raises(ValueError, match=words):
            jp.export(refused, tmp_path / "file", format="npz", step_s=STEP)
    assert not list(tmp_path.iterdir())


def test_values_that_are_no_motion_are_refused_before_any_writer(plan):
    times = instants(30.0, STEP)
    good = plan.trajectory.sample(times)

    def spoiled(name: str, change: float) -> object:
        """The table of a trajectory that has one wrong number, at 25 s."""
        array = np.array(getattr(good, name))
        array[500].flat[0] += change
        values = replace(good, **{name: array})
        flown = SimpleNamespace(sample=lambda t: values)
        flight = Flight(name="", spacecraft=plan.scenario.spacecraft, trajectory=flown, start=None)
        return Sampling(flight=flight, start=None, times=times)

    (block,) = spoiled("joints", 0.0).blocks()
    np.testing.assert_array_equal(block.times, times)
    for name in ("attitude", "angular_velocity", "angular_acceleration", "joints", "joint_rates"):
        for wrong in (np.nan, np.inf):
            with pytest.raises(ValueError, match=f"{name} is not finite at 25 s"):
                list(spoiled(name, wrong).blocks())
    with pytest.raises(ValueError, match="attitude is not a rotation at 25 s"):
        list(spoiled("attitude", 1e-6).blocks())


def content(folder: Path) -> dict[Path, bytes]:
    """All that is in a folder, with the empty folders."""
    return {file: file.read_bytes() if file.is_file() else b"" for file in folder.rglob("*")}


@pytest.mark.parametrize("name", ["npz", "stk"])
def test_nothing_is_overwritten_unasked(plan, tmp_path, name):
    place = jp.export(plan, tmp_path / "slew", format=name, epoch=EPOCH, step_s=STEP)
    before = content(tmp_path)
    with pytest.raises(FileExistsError, match=r"--force replaces it \(in Python overwrite=True\)"):
        jp.export(plan, place, format=name, epoch="2030-01-01", step_s=STEP)
    assert content(tmp_path) == before
    jp.export(plan, place, format=name, epoch="2030-01-01", step_s=STEP, overwrite=True)
    after = content(tmp_path)
    assert after.keys() == before.keys()
    assert after != before


def test_what_another_has_made_is_never_replaced(plan, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    for name, place, words in [
        ("stk", "mine", "holds notes.txt"),
        ("npz", "mine", "is a folder"),
        ("stk", "file", "is a file"),
        ("npz", "", "path is empty"),
    ]:
        where = tmp_path / place if place else ""
        with pytest.raises(ValueError, match=words):
            jp.export(plan, where, format=name, epoch=EPOCH, step_s=STEP, overwrite=True)
    assert (tmp_path / "mine" / "notes.txt").read_text() == (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("name", ["csv", "stk"])
def test_a_writer_that_fails_leaves_the_old_and_nothing_else(plan, tmp_path, monkeypatch, name):
    place = jp.export(plan, tmp_path / "slew", format=name, epoch=EPOCH, step_s=STEP)
    before, kind = content(tmp_path), FORMATS[name]

    def fail(sampled: object, path: Path) -> None:
        kind.write(sampled, path)
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(FORMATS, name, replace(kind, write=fail))
    for target in (place, tmp_path / "new"):
        with pytest.raises(OSError, match="No space"):
            jp.export(plan, target, format=name, epoch="2030-01-01", step_s=STEP, overwrite=True)
    assert content(tmp_path) == before


def test_an_extra_that_is_missing_is_named(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(formats, "find_spec", lambda _: None)
    with pytest.raises(ValueError, match=r"needs spiceypy and erfa: pip install 'jaxplan\[spice\]'"):
        jp.export(plan, tmp_path / "slew", format="ck", epoch=EPOCH)


def test_files_are_the_same_byte_for_byte(plan, tmp_path):
    for name in ("stk", "basilisk", "csv", "npz"):
        first, second = (
            jp.export(plan, tmp_path / f"{name}-{k}", format=name, epoch=EPOCH, step_s=STEP) for k in (1, 2)
        )
        files = sorted(first.iterdir()) if first.is_dir() else [first]
        for file in files:
            other = second / file.name if first.is_dir() else second
            assert file.read_bytes() == other.read_bytes()


def test_the_command_line_exports_beside_the_plan(tmp_path, capsys):
    scenario = make_scenario(2, 1)
    jp.plan(replace(scenario, goal=scenario.start)).save(tmp_path / "plan.json")

    def run(*words: object) -> tuple[int, str]:
        code = main(["export", str(tmp_path / "plan.json"), *map(str, words)])
        captured = capsys.readouterr()
        assert not captured.out
        return code, captured.err

    for name, kind in FORMATS.items():
        if name != "ck":  # which needs an extra
            code, told = run("--format", name, "--epoch", EPOCH)
            assert code == 0
            assert told.startswith(f"wrote {tmp_path / 'plan'}{kind.suffix}"), told
            assert (tmp_path / f"plan{kind.suffix}").exists()
    assert run("--format", "csv", "--step", 2, "-o", tmp_path / "sub" / "x.csv")[0] == 0
    assert run("--format", "csv", "--force")[0] == 0
    for words, said in {
        ("--format", "csv"): f"{tmp_path / 'plan.csv'}: is there already; --force",
        ("--format", "amm", "--epoch", EPOCH): "perhaps aem is meant",
        ("--format", "aem"): "needs the UTC of the start",
        ("--format", "csv", "--step", "-1", "-o", "x"): "step_s = -1.0: must lie in",
        ("--format", "csv", "-o", ""): "path is empty",
        ("--format", "csv", "-o", "/proc/nowhere/x"): "/proc/nowhere: nothing can be written there",
    }.items():
        code, err = run(*words)
        assert code == 2
        assert said in err
    saved = json.loads((tmp_path / "plan.json").read_text())
    saved["trajectory"]["joint_coefficients"][0][0][0] += 0.1
    (tmp_path / "plan.json").write_text(json.dumps(saved))
    code, err = run("--format", "csv", "--force")
    assert code == 3
    assert "fails its certificate, made anew" in err
