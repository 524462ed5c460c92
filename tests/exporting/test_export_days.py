"""A day of several activities in every format, as other programs read it, against the motion by scipy."""

import csv
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from exports import EPOCH, FlownDay, Part, flown_day, flown_plan, truth
from reference import assert_each
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.exporting import FORMATS, sampled
from jaxplan.exporting.flight import Flight
from jaxplan.exporting.instants import chosen_instants

TOLERANCE = np.deg2rad(1e-4)
NAMES = jp.ExportNames(
    object_name="EO-1",
    object_id="2000-075A",
    originator="JAXPLAN TESTS",
    frame_name="EO1_BUS",
    reference_frame="ICRF",
    naif_id=-2000,
)


@pytest.fixture(scope="module")
def day() -> FlownDay:
    return flown_day()


@pytest.fixture(scope="module")
def folder(day, tmp_path_factory) -> Path:
    """The day in every format, each under its name, in blocks of 1000 rows."""
    place = tmp_path_factory.mktemp("days")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampled, "ROWS", 1000)
        for name, kind in FORMATS.items():
            if name != "ck" and not kind.exact:  # ck needs an extra
                jp.export(day, place / name, format=name, names=NAMES)
    return place


def between(times: np.ndarray, quaternions: np.ndarray, asked: np.ndarray) -> list[np.ndarray]:
    """Attitudes (k, 3, 3) at times by turns about one axis, and by linear components; scalar last."""
    after = np.clip(np.searchsorted(times, asked), 1, len(times) - 1)
    first, second = quaternions[after - 1], quaternions[after]
    share = ((asked - times[after - 1]) / (times[after] - times[after - 1]))[:, None]
    start = Rotation.from_quat(first)
    turn = (start.inv() * Rotation.from_quat(second)).as_rotvec()
    linear = first + share * (second - first)
    return [(start * Rotation.from_rotvec(share * turn)).as_matrix(), Rotation.from_quat(linear).as_matrix()]


def apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angles (k,) rad between attitudes (k, 3, 3)."""
    return Rotation.from_matrix(np.swapaxes(first, 1, 2) @ second).magnitude()


def asked_times(day: FlownDay, count: int = 20_000) -> np.ndarray:
    """Times anywhere in the day, half of them in its slews."""
    rng = np.random.default_rng(3)
    slews = [part for part in day.segments if part.kind == "slew"]
    chosen = [rng.uniform(part.start, part.end, count // 8) for part in slews]
    return np.sort(np.concatenate([rng.uniform(0, day.trajectory.duration, count // 2), *chosen]))


def test_a_message_has_a_segment_for_each_activity_and_they_meet(day, folder):
    ccsds_ndm = pytest.importorskip("ccsds_ndm", reason="ccsds-ndm-py is not installed")
    message = ccsds_ndm.Aem.from_file(str(folder / "aem"))
    assert message.header.originator == "JAXPLAN TESTS"
    long = [part for part in day.segments if part.end > part.start]
    start = np.datetime64(EPOCH, "ns")
    assert len(message.segments) == len(long) == 5
    for part, segment in zip(long, message.segments, strict=True):
        meta, states = segment.metadata, segment.data.attitude_states_numpy
        stamps = np.array(segment.data.attitude_states_epochs, "datetime64[ns]")
        assert (meta.object_name, meta.object_id) == ("EO-1", "2000-075A")
        assert (meta.ref_frame_a, meta.ref_frame_b, meta.angvel_frame) == ("ICRF", "EO1_BUS", "EO1_BUS")
        assert (meta.interpolation_method, meta.interpolation_degree) == ("LINEAR", 1)
        assert meta.comment[-1] == f"{part.kind}: {part.shown}"
        assert np.datetime64(meta.start_time, "ns") == stamps[0]
        assert np.datetime64(meta.stop_time, "ns") == stamps[-1]
        times = (stamps - start) / np.timedelta64(1, "s")
        np.testing.assert_allclose(times[[0, -1]], [part.start, part.end], rtol=0, atol=1e-9)
        assert_each(np.diff(times), ">", 0)
        assert_each(np.sum(states[1:, :4] * states[:-1, :4], axis=1), ">", 0.9)
        expected = truth(day, times)
        attitude = Rotation.from_quat(states[:, :4]).as_matrix()
        np.testing.assert_allclose(attitude, expected.attitude, rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.deg2rad(states[:, 4:]), expected.rate, rtol=0, atol=1e-9)
    for one, other in pairwise(message.segments):
        assert one.metadata.stop_time == other.metadata.start_time
        last, first = one.data.attitude_states_numpy[-1], other.data.attitude_states_numpy[0]
        np.testing.assert_array_equal(last, first)
    # the activity that takes no time is told of beside
    assert message.segments[2].metadata.comment[0].startswith("slew: slew 2, ?, at 2026-03-01T06:45:45.25")


def test_stk_has_the_whole_day_and_the_segments_as_intervals(day, folder):
    stk_files = pytest.importorskip("stk_files", reason="stk-files is not installed")
    place = folder / "stk"
    assert {file.name for file in place.iterdir()} == {
        "platform.a",
        "terminal-0.sp",
        "terminal-1.sp",
        "segments.int",
    }
    text = (place / "segments.int").read_text()
    assert "ScenarioEpoch 1 Mar 2026 06:30:15.250000\n" in text
    found = stk_files.read_interval(iter(text.splitlines(keepends=True)))
    intervals = getattr(found, "intervals", found)
    intervals = intervals[-1] if isinstance(intervals, tuple) else intervals
    seen = [(interval.start, interval.end, interval.data) for interval in intervals]
    start = np.datetime64(EPOCH, "ms")
    long = [part for part in day.segments if part.end > part.start]
    for (begin, end, data), part in zip(seen, long, strict=True):
        for stamp, time in ((begin, part.start), (end, part.end)):
            assert stamp == start + np.timedelta64(round(1000 * time), "ms")
        assert data == f"{part.kind}/{part.kind}_{part.name.split()[1].strip(',')}"
    tables = {}
    for name in ("platform.a", "terminal-0.sp", "terminal-1.sp"):
        lines = (place / name).read_text().splitlines()
        body = lines.index("AttitudeTimeQuaternions") + 1
        assert ("CoordinateAxes ICRF" in lines[:body]) == (name == "platform.a")
        tables[name] = np.loadtxt(lines[body:-1])
        assert f"NumberOfAttitudePoints {len(tables[name])}" in lines[:body]
        assert_each(np.sum(tables[name][1:, 1:] * tables[name][:-1, 1:], axis=1), ">", 0.9)
    times = tables["platform.a"][:, 0]
    expected = truth(day, times)
    attitude = Rotation.from_quat(tables["platform.a"][:, 1:]).as_matrix()
    np.testing.assert_allclose(attitude, expected.attitude, rtol=0, atol=1e-9)
    for number in range(2):
        sensor = Rotation.from_quat(tables[f"terminal-{number}.sp"][:, 1:]).as_matrix()
        seen = (attitude @ sensor)[:, :, 2]
        np.testing.assert_allclose(seen, expected.boresights[:, number], rtol=0, atol=1e-9)
    asked = asked_times(day)
    for guess in between(times, tables["platform.a"][:, 1:], asked):
        assert_each(apart(guess, truth(day, asked).attitude), "<", TOLERANCE)


def test_tables_name_the_segment_of_each_row(day, folder):
    with (folder / "csv").open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    table = dict(zip(header, zip(*rows, strict=True), strict=True))
    times = np.array(table["time_s"], float)
    long = [part for part in day.segments if part.end > part.start]
    for name, kind, time in zip(table["segment"], table["segment_kind"], times, strict=True):
        (part,) = [p for p in long if p.start <= time < p.end or time == p.end == day.trajectory.duration]
        assert (name, kind) == (part.name, part.kind)
    with np.load(folder / "npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["time_s"], times)
        assert list(arrays["segment_name"]) == [part.name for part in day.segments]
        assert list(arrays["segment_kind"][arrays["segment"]]) == list(table["segment_kind"])
        spans = np.stack([arrays["segment_start_s"], arrays["segment_end_s"]], axis=1)
        np.testing.assert_allclose(spans, [[part.start, part.end] for part in day.segments])
        quaternions = arrays["quaternion"]
    for axis, column in zip("wxyz", quaternions.T, strict=True):
        np.testing.assert_array_equal(column, np.array(table[f"quaternion_{axis}"], float))
    assert_each(np.sum(quaternions[1:] * quaternions[:-1], axis=1), ">", 0.9)
    asked = asked_times(day)
    expected = truth(day, asked)
    for guess in between(times, np.roll(quaternions, -1, axis=1), asked):
        assert_each(apart(guess, expected.attitude), "<", TOLERANCE)
    for number, joint in enumerate(
        ["terminal-0_yaw", "terminal-1_yaw", "terminal-0_pitch", "terminal-1_pitch"]
    ):
        linear = np.interp(asked, times, np.array(table[f"{joint}_rad"], float))
        assert_each(np.abs(linear - expected.joints[0, :, number]), "<", TOLERANCE)


def test_basilisk_follows_the_day_by_linear_parameters(day, folder):
    table = np.loadtxt(folder / "basilisk", delimiter=",")
    times, quaternions = table[:, 0], table[:, 1:5]
    asked = asked_times(day)
    after = np.clip(np.searchsorted(times, asked), 1, len(times) - 1)
    share = ((asked - times[after - 1]) / (times[after] - times[after - 1]))[:, None]
    first, second = (
        Rotation.from_quat(q, scalar_first=True).as_mrp()
        for q in (quaternions[after - 1], quaternions[after])
    )
    far = np.linalg.norm(second - first, axis=1) > 1
    second[far] /= -np.sum(second[far] ** 2, axis=1, keepdims=True)
    guess = Rotation.from_mrp(first + share * (second - first)).as_matrix()
    assert_each(apart(guess, truth(day, asked).attitude), "<", TOLERANCE)


def test_samples_are_far_apart_where_little_happens(day, folder):
    with np.load(folder / "npz", allow_pickle=False) as arrays:
        times, kinds = arrays["time_s"], arrays["segment_kind"][arrays["segment"]]
    steps = np.diff(times)
    assert_each(steps, "<=", 60.0)
    slews, tracks = (np.mean(steps[kinds[:-1] == kind]) for kind in ("slew", "track"))
    assert tracks > 10 * slews


def test_a_wider_tolerance_takes_fewer_samples_and_keeps_what_it_says(day, tmp_path):
    counts = []
    asked = asked_times(day, 4000)
    expected = truth(day, asked).attitude
    for tolerance in (1e-2, 1e-3):
        place = jp.export(day, tmp_path / f"{tolerance}.npz", format="npz", tolerance_deg=tolerance)
        with np.load(place) as arrays:
            counts.append(len(arrays["time_s"]))
            off = [
                apart(g, expected)
                for g in between(arrays["time_s"], np.roll(arrays["quaternion"], -1, 1), asked)
            ]
        assert np.deg2rad(tolerance) / 10 < np.max(off) < np.deg2rad(tolerance)
    assert counts[0] < counts[1] / 2


@pytest.mark.parametrize("turns", [1, 4, 8, 100])
def test_whole_turns_between_instants_are_seen(turns):
    flown = SimpleNamespace(
        breaks=np.array([0.0, 60.0]),
        joint_breaks=np.array([0.0, 60.0]),
        duration=60.0,
        sample=lambda t: SimpleNamespace(
            attitude=Rotation.from_rotvec(np.outer(2 * np.pi * turns * t / 60, [0.6, 0.0, 0.8])).as_matrix(),
            joints=np.zeros((len(t), 4)),
        ),
    )
    flight = Flight(name="", spacecraft=flown_plan().scenario.spacecraft, trajectory=flown, start=None)
    assert_each(np.diff(chosen_instants(flight, TOLERANCE)), "<", 60 / turns / 50)


def test_a_plan_can_be_sampled_for_a_tolerance_too(day, tmp_path):
    plan = day.plans[0]
    place = jp.export(plan, tmp_path / "plan.csv", format="csv", tolerance_deg=0.01)
    table = np.genfromtxt(place, delimiter=",", names=True, deletechars="")
    assert "segment" not in table.dtype.names
    quaternions = np.stack([table[f"quaternion_{axis}"] for axis in "xyzw"], axis=1)
    asked = np.linspace(0, plan.trajectory.duration, 3000)
    for guess in between(table["time_s"], quaternions, asked):
        assert_each(apart(guess, truth(plan, asked).attitude), "<", np.deg2rad(0.01))


def test_a_step_of_a_day_has_the_ends_of_its_segments_besides(tmp_path):
    day = flown_day((31.03, 200.0, 20.0))
    place = jp.export(day, tmp_path / "day.npz", format="npz", step_s=0.5)
    with np.load(place) as arrays:
        times, kinds = arrays["time_s"], arrays["segment"]
    multiples = 0.5 * np.arange(503)
    ends = [31.03, 231.03, 251.03]
    np.testing.assert_allclose(times, np.union1d(multiples, ends), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(kinds, np.clip(np.searchsorted(ends, times, side="right"), 0, 2))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["aem", "csv"])
def test_memory_does_not_grow_with_the_rows(day, tmp_path, monkeypatch, name):
    monkeypatch.setattr(sampled, "ROWS", 1000)
    peaks = []
    for step in (1.0, 0.2, 0.04):  # the first is to import what is needed
        tracemalloc.start()
        jp.export(day, tmp_path / f"{step}", format=name, step_s=step)
        peaks.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
    assert peaks[2] < peaks[1] + 3  # MB; as arrays the 32,500 rows would be 14 MB


def test_an_uncertified_day_is_not_exported(day, tmp_path):
    broken = SimpleNamespace(certified=False, faults=["the telescope looks at the Sun"])
    off = replace(day, plans=())
    object.__setattr__(off, "certify", lambda: broken)
    for refused, words in (
        (replace(day, ok=False), "the plan of an odd slew.* is not certified"),
        (off, "fails its certificate, made anew: the telescope looks at the Sun"),
    ):
        with pytest.raises(jp.exporting.UncertifiedError, match=words):
            jp.export(refused, tmp_path / "day", format="csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("number", "changes", "words"),
    [
        (1, {"start": 30.5}, r"segments\[1\]\.start = 30\.5 s: must be 30\.0 s, where the one before ends"),
        (0, {"start": 1.0}, r"segments\[0\]\.start = 1\.0 s: must be 0\.0 s"),
        (1, {"end": 20.0}, r"segments\[1\]\.end = 20\.0 s: must lie in \[30\.0, 1300\.0\] s"),
        (5, {"end": 1299.0}, r"segments\[5\]\.end = 1299\.0 s: must be 1300\.0 s, the end of the motion"),
        (5, {"end": 1301.0}, r"segments\[5\]\.end = 1301\.0 s: must lie in"),
        (2, {"end": float("nan")}, r"segments\[2\]\.end = nan s: must lie in"),
        (2, {"start": "soon"}, r"segments\[2\]\.start = 'soon': must be a number of seconds"),
    ],
)
def test_segments_with_gaps_are_refused(day, tmp_path, number, changes, words):
    parts = list(day.segments)
    parts[number] = Part(**(vars(parts[number]) | changes))
    with pytest.raises(ValueError, match=words):
        jp.export(replace(day, segments=tuple(parts)), tmp_path / "day", format="csv")


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"tolerance_deg": 0}, r"tolerance_deg = 0: must lie in \[1e-06, 1\]"),
        ({"tolerance_deg": float("nan")}, "tolerance_deg = nan: must lie in"),
        ({"tolerance_deg": "fine"}, "tolerance_deg = 'fine': must be a number of degrees"),
        ({"tolerance_deg": 1e-3, "step_s": 0.1}, "step_s, tolerance_deg: one of them is enough"),
        ({"step_s": 1e-5}, "a file holds at most 10000000 samples"),
    ],
)
def test_bad_wishes_about_instants_are_refused(day, tmp_path, wishes, words):
    with pytest.raises(ValueError, match=words):
        jp.export(day, tmp_path / "day", format="csv", **wishes)


def test_what_is_no_day_is_told_apart(day, tmp_path):
    for wrong in (None, "day.toml", SimpleNamespace(ok=True, trajectory=day.trajectory), FlownDay):
        with pytest.raises(TypeError, match="plan must be a Plan, not"):
            jp.export(wrong, tmp_path / "day", format="csv")
    with pytest.raises(TypeError, match="names must be an ExportNames, not dict"):
        jp.export(day, tmp_path / "day", format="csv", names={"naif_id": -5})


def test_days_have_names_of_their_own(tmp_path):
    day = flown_day((30.0, 25.0))
    object.__setattr__(day, "names", jp.ExportNames(object_name="OWN"))
    for names, name in ((None, "OWN"), (jp.ExportNames(object_name="OTHER"), "OTHER")):
        place = jp.export(day, tmp_path / name, format="aem", names=names, step_s=1.0)
        text = place.read_text()
        assert text.count(f"OBJECT_NAME = {name}\n") == 2
        assert "INTERPOLATION" not in text


def test_a_leap_second_in_a_day_is_second_sixty_in_all_blocks(tmp_path, monkeypatch):
    pytest.importorskip("erfa", reason="pyerfa is not installed")
    monkeypatch.setattr(sampled, "ROWS", 7)
    day = flown_day((30.0, 25.0), epoch="2016-12-31T23:59:40")
    place = jp.export(day, tmp_path / "day.csv", format="csv", step_s=0.5)
    with place.open(newline="", encoding="utf-8") as file:
        stamps = {float(row["time_s"]): row["utc"] for row in csv.DictReader(file)}
    for time, stamp in {
        0.0: "2016-12-31T23:59:40",
        19.5: "2016-12-31T23:59:59.5",
        20.0: "2016-12-31T23:59:60",
        20.5: "2016-12-31T23:59:60.5",
        21.0: "2017-01-01T00:00:00",
        55.0: "2017-01-01T00:00:34",
    }.items():
        assert stamps[time].startswith(stamp)
    text = jp.export(day, tmp_path / "day.aem", format="aem", step_s=0.5).read_text()
    assert text.count("\n2016-12-31T23:59:60.") == 2
    assert "STOP_TIME = 2017-01-01T00:00:34.000000000" in text
    night = flown_day((30.0, 25.0), epoch="2026-03-01T23:59:40")
    text = jp.export(night, tmp_path / "night.aem", format="aem", step_s=0.5).read_text()
    assert "STOP_TIME = 2026-03-02T00:00:10.000000000" in text  # of the slew that began the day before
    assert "STOP_TIME = 2026-03-02T00:00:35.000000000" in text
