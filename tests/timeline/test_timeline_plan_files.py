"""Files of timelines' plans: the same bits come back, the same bytes are written, and nothing is trusted."""

import json
import math
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.model.status import Status
from jaxplan.runtime.files import is_day_plan
from jaxplan.schema import parse_timeline
from jaxplan.timeline import PlannedActivity, Segment, TimelinePlan, curves
from jaxplan.timeline.least_energy import Nodes
from jaxplan.timeline.proving import certify_segments

FILE = """
schema_version = 1
kind = "timeline"
name = "still"
[timeline]
until_s = 20
[spacecraft]
rate_limit_deg_s = 1.0
acceleration_limit_deg_s2 = 0.5
[[spacecraft.terminal]]
name = "antenna"
mount_deg = 0
yaw_limit_deg = 80
pitch_limit_deg = 40
rate_limit_deg_s = 6
acceleration_limit_deg_s2 = 4
[start]
attitude = [0.1, 0.2, 0.3]
yaw_deg = [0]
pitch_deg = [0]
[[keep_out]]
name = "sun"
direction = [0, 0, 1]
half_angle_deg = 20
[[direction]]
name = "slow"
direction_samples = [SAMPLES]
times_s = [TIMES]
[[activity]]
name = "hold"
attitude = [0.1, 0.2, 0.3]
yaw_deg = [0]
pitch_deg = [0]
for_s = 5
[[activity]]
name = "rest"
idle = true
until_s = 20
[[activity]]
name = "far"
track = { antenna = "slow" }
for_s = 1
"""


@pytest.fixture(scope="module")
def plan():
    """A plan that stands still, of which the last activity could not be done."""
    angles = np.linspace(0, 0.3, 40)
    samples = ", ".join(f"[0, {float(np.cos(a))!r}, {float(np.sin(a))!r}]" for a in angles)
    times = ", ".join(f"{float(t)!r}" for t in np.linspace(0, 20, 40))
    timeline = parse_timeline(FILE.replace("SAMPLES", samples).replace("TIMES", times))
    start = timeline.scene.start
    parts = []
    for begin, end in ((0.0, 5.0), (5.0, 20.0)):
        at = np.linspace(begin, end, curves.FEWEST)
        nodes = Nodes(
            times=at,
            attitudes=np.tile(start.attitude, (len(at), 1, 1)),
            joints=np.tile(start.joints, (len(at), 1)),
        )
        parts.append((begin, curves.through(nodes)))
    trajectory = curves.joined(parts)
    segments = (
        Segment(name="hold", kind="attitude", start=0.0, end=5.0),
        Segment(name="rest", kind="idle", start=5.0, end=20.0),
    )
    done = {"hold": (0.0, 5.0), "rest": (5.0, 20.0)}
    certificate = certify_segments(timeline, trajectory, segments, done)
    assert certificate.certified
    return TimelinePlan(
        timeline=timeline,
        status=Status.OUT_OF_WINDOW,
        message="activity far: too late",
        activities=(
            PlannedActivity(name="hold", kind="attitude", status=Status.OK, start=0.0, end=5.0, slew=0.0),
            PlannedActivity(name="rest", kind="idle", status=Status.OK, start=5.0, end=20.0, slew=0.0),
            PlannedActivity(
                name="far",
                kind="track",
                status=Status.OUT_OF_WINDOW,
                message="too late",
                pointing_error=math.inf,
            ),
        ),
        segments=segments,
        trajectory=trajectory,
        certificate=certificate,
        timings={"slews": 1.0},
    )


@pytest.fixture
def file(plan, tmp_path):
    plan.save(tmp_path / "plan.npz")
    return tmp_path / "plan.npz"


def test_everything_comes_back_to_the_last_bit_but_timings(plan, file):
    read = jp.load_timeline_plan(file)
    for name, own in vars(plan.trajectory).items():
        np.testing.assert_array_equal(getattr(read.trajectory, name), own)
    assert read.timeline == plan.timeline
    assert read.segments == plan.segments
    assert [vars(one) for one in read.activities] == [vars(one) for one in plan.activities]
    assert vars(read.certificate) == vars(plan.certificate)
    assert (read.status, read.message, read.timings) == (plan.status, plan.message, {})
    assert str(read) == str(plan)
    assert read.certify().certified


def test_the_same_plan_has_the_same_bytes(plan, file, tmp_path):
    jp.load_timeline_plan(file).save(tmp_path / "again.npz")
    replace(plan, timings={"slews": 7.0}).save(tmp_path / "third.npz")
    assert (tmp_path / "again.npz").read_bytes() == file.read_bytes() == (tmp_path / "third.npz").read_bytes()


def test_numpy_opens_it(plan, file):
    with np.load(file) as arrays:
        np.testing.assert_array_equal(arrays["trajectory.coefficients"], plan.trajectory.coefficients)
    assert is_day_plan(file)


def test_a_plan_without_a_motion_is_kept(plan, tmp_path):
    failed = replace(plan, trajectory=None, certificate=None, segments=(), activities=plan.activities[2:])
    failed = replace(failed, timeline=replace(plan.timeline, activities=plan.timeline.activities[2:]))
    failed.save(tmp_path / "failed.npz")
    read = jp.load_timeline_plan(tmp_path / "failed.npz")
    assert read.trajectory is None
    assert read.status is Status.OUT_OF_WINDOW


def rewritten(file, change=None, **entries):
    """The file with a change of its content, and other bytes for some entries; None takes one away."""
    with zipfile.ZipFile(file) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    if change is not None:
        content = json.loads(held["plan.json"])
        change(content)
        held["plan.json"] = json.dumps(content).encode()
    for name, entry in entries.items():
        held[name.replace("__", ".") + ".npy"] = entry
    with zipfile.ZipFile(file, "w") as archive:
        for name, entry in held.items():
            if entry is not None:
                archive.writestr(name, entry)
    return file


def put(path, value):
    """A change that sets the value at a path of keys."""

    def change(content):
        *inner, last = path
        for key in inner:
            content = content[key]
        content[last] = value

    return change


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["schema_version"], 2, "schema_version = 2: must be 1"),
        (["kind"], "plan", "has no kind = 'plan of a timeline'"),
        (
            ["timeline", "activity", 0, "for_s"],
            -5,
            "timeline: activity[0].for_s = -5: must lie in [0, 86400]",
        ),
        (["timeline"], 3, "timeline = 3: must be a table"),
        (["status"], "FINE", 'status = "FINE": must be "OK"'),
        (["status"], "OK", 'status = "OK": cannot be, since not all activities are planned and certified'),
        (["activities", 0, "name"], "hol", "no such activity, perhaps hold is meant"),
        (["activities", 0, "kind"], "idle", "must be hold, attitude"),
        (["activities", 0, "end"], 7.0, "has no segment over its time"),
        (["activities", 0, "start"], None, "activities[0].start = null: must be a number"),
        (["segments", 1, "start"], 6.0, "segments[1].start = 6.0: must be the end of the one before, 5"),
        (["segments", 1, "end"], 19.0, "segments: must end with the trajectory, at 20 s"),
        (["segments"], [], "segments: must end with the trajectory"),
        (["certificate"], None, "certificate: must be there where a trajectory is"),
        (["certificate", "min_margin"], "x", 'certificate.min_margin = "x": must be a number'),
        (["certificate", "worst_zone"], "moon", "no such zone"),
        (["trajectory", "method"], "x", "trajectory.method"),
        (["trajectory", "breaks"], {"entry": "no"}, "no entry no.npy"),
        (["more"], 1, "more: unknown key"),
    ],
)
def test_what_a_file_says_is_checked(file, path, value, message):
    with pytest.raises(jp.PlanFileError) as caught:
        jp.load_timeline_plan(rewritten(file, put(path, value)))
    assert message in str(caught.value)


def saved(array, **more):
    """The bytes of an .npy file."""
    import io

    held = io.BytesIO()
    np.save(held, array, **more)
    return held.getvalue()


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (None, "no entry trajectory.breaks.npy"),
        (b"nothing", "trajectory.breaks.npy: no array of numbers"),
        (saved(np.array([{}], object), allow_pickle=True), "trajectory.breaks.npy: no array of numbers"),
        (saved(np.arange(3)), "trajectory.breaks.npy: must be one array of float64"),
        (saved(np.zeros(2)) + b"x", "trajectory.breaks.npy: must be one array of float64"),
        (saved(np.array([0.0, np.nan, 20.0])), "trajectory.breaks"),
        (saved(np.array([0.0, 9.0, 5.0, 20.0])), "trajectory.breaks"),
    ],
)
def test_arrays_are_numbers_or_refused(file, entry, message):
    with pytest.raises(jp.PlanFileError) as caught:
        jp.load_timeline_plan(rewritten(file, trajectory__breaks=entry))
    assert message in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{}", b"PK\x03\x04 no archive"])
def test_what_is_no_archive_is_refused(tmp_path, content):
    (tmp_path / "plan.npz").write_bytes(content)
    assert not is_day_plan(tmp_path / "plan.npz")
    with pytest.raises(jp.PlanFileError, match=r"plan\.npz: not a plan of a timeline"):
        jp.load_timeline_plan(tmp_path / "plan.npz")


def test_a_missing_file_and_a_damaged_one_are_told_apart(file, tmp_path):
    with pytest.raises(jp.PlanFileError, match=r"none\.npz: cannot be read"):
        jp.load_timeline_plan(tmp_path / "none.npz")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0xFF
    file.write_bytes(bytes(content))
    with pytest.raises(jp.PlanFileError):
        jp.load_timeline_plan(file)


def test_an_archive_that_unpacks_to_too_much_is_refused(file, monkeypatch):
    monkeypatch.setattr("jaxplan.timeline.files.LARGEST", 2**20)
    rewritten(file, trajectory__breaks=bytes(2**21))
    with pytest.raises(jp.PlanFileError, match="unpacked it is larger than 1 MiB"):
        jp.load_timeline_plan(file)
