"""The gallery: each example is planned and certified, and shows what its page says."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import jaxplan as jp

pytest.importorskip("erfa")

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
NAMES = sorted(file.stem for file in GALLERY.glob("*.toml"))


@pytest.fixture(scope="module")
def exhibits():
    sys.path.insert(0, str(GALLERY.parent))
    try:
        import exhibits

        yield exhibits
    finally:
        sys.path.remove(str(GALLERY.parent))


def test_each_file_has_a_page_in_the_index_that_tells_what_is_asked_and_seen(exhibits):
    assert len(NAMES) == 12
    assert sorted(exhibits.names()) == NAMES
    assert {page.stem for page in GALLERY.glob("*.md")} - {"index"} == set(NAMES)
    for name in NAMES:
        page = (GALLERY / f"{name}.md").read_text(encoding="utf-8")
        assert re.findall(r"^#+ .*", page, re.MULTILINE)[1:] == ["## What one sees", "## The file"]
        assert f"../generated/gallery/{name}.md" in page
        assert f"literalinclude}} {name}.toml" in page
        assert f"[![{exhibits.title(name)}]" in exhibits.index()


def test_a_view_is_embedded_where_there_is_one(exhibits, monkeypatch, tmp_path):
    class View:
        def save(self, file):
            file.write_text("turn me", encoding="utf-8")

    plan = jp.Plan(scenario=jp.load_scenario(GALLERY / "wheels.toml"), status=jp.Status.OK)
    monkeypatch.setattr(exhibits, "find_spec", lambda _: None)
    assert exhibits.viewer(plan, tmp_path / "wheels-view.html") == ""
    monkeypatch.setattr(exhibits, "find_spec", lambda _: "there")
    monkeypatch.setattr(exhibits.jp, "view", lambda _: View(), raising=False)
    frame = exhibits.viewer(plan, tmp_path / "wheels-view.html")
    assert 'src="wheels-view.html"' in frame
    assert (tmp_path / "wheels-view.html").read_text(encoding="utf-8") == "turn me"


def rate(plan, t):
    return np.rad2deg(np.linalg.norm(plan.trajectory.sample(t).angular_velocity, axis=-1))


def straight(plan):
    """Margins of the instrument to the Sun's zone on the turn about one axis from start to goal, rad."""
    from scipy.spatial.transform import Rotation, Slerp

    ends = plan.trajectory.sample(np.array([0.0, plan.trajectory.duration])).attitude
    turns = Slerp([0, 1], Rotation.from_matrix(ends))(np.linspace(0, 1, 200)).as_matrix()
    (zone,) = (zone for zone in plan.scenario.keep_out if zone.name == "sun")
    boresight = np.asarray(plan.scenario.spacecraft.instruments[0].boresight)
    away = np.arccos(turns @ boresight @ np.asarray(zone.direction))
    return away - zone.half_angle


def images(plan):
    assert plan.scenario.trajectory.duration == "minimum"
    assert plan.trajectory.duration < 1.06 * 12.20
    for name in ("angular_velocity", "angular_acceleration", "jerk"):
        assert 0.9 < plan.certificate.peaks[name] <= 1
    assert (rate(plan, np.array([0.0, plan.trajectory.duration])) > 0.1).all()


def handover(plan):
    assert plan.goal.slew_angle < 1e-6
    assert np.rad2deg(plan.certificate.min_margin) == pytest.approx(0.5, abs=1e-3)
    assert np.abs(plan.trajectory.sample(plan.trajectory.duration).joint_rates).max() > 1e-5


def mesh(plan):
    assert plan.goal.slew_angle < 1e-6
    joints = np.ptp(plan.trajectory.sample(np.linspace(0, plan.trajectory.duration, 100)).joints, axis=0)
    assert joints[:4].argmax() == 3  # starboard's yaw
    assert plan.certificate.peaks["joint_rates"] == pytest.approx(2 / 3, abs=0.05)
    assert plan.certificate.peaks["joint_accelerations"] == pytest.approx(1 / 2, abs=0.05)
    assert sum(zone.axis_device is not None for zone in plan.scenario.keep_out) == 3


def trackers(plan):
    assert plan.trajectory.duration == 300
    assert np.rad2deg(plan.scenario.robust.attitude_error) == pytest.approx(0.5)
    assert {zone.entry for zone in plan.scenario.keep_out if zone.any_of} == {"tracker 1", "tracker 2"}


def station(plan):
    yaw, pitch = np.rad2deg(plan.trajectory.sample(np.linspace(0, plan.trajectory.duration, 400)).joints).T
    assert np.ptp(yaw) > 90
    over = (yaw > 65) & (yaw < 115)
    assert over.any()
    assert pitch[over].min() > 40
    assert plan.certificate.worst_zone == "downlink"
    assert 0 < np.rad2deg(plan.certificate.min_margin) < 0.3


def telescope(plan):
    (sun,) = (zone for zone in plan.scenario.keep_out if zone.name == "sun")
    ends = plan.trajectory.sample(np.array([0.0, plan.trajectory.duration])).attitude[:, :, 2]
    middle = ends.sum(axis=0) / np.linalg.norm(ends.sum(axis=0))  # of the arc from field to field
    assert np.arccos(middle @ np.asarray(sun.direction)) < sun.half_angle
    assert straight(plan).min() > 0
    assert plan.certificate.worst_zone == "power"
    assert np.rad2deg(plan.certificate.min_margin) == pytest.approx(0.2, abs=0.01)


def safe(plan):
    assert rate(plan, 0.0) > 0.2
    assert rate(plan, plan.trajectory.duration) < 1e-9
    assert 0.95 < plan.certificate.peaks["torque"] <= 1
    assert plan.certificate.peaks["drive"] > 0.95


def wheels(plan):
    assert np.rad2deg(plan.goal.slew_angle) > 90
    assert straight(plan).min() < 0
    assert plan.certificate.peaks["wheel_torques"] > 0.97
    assert plan.certificate.peaks["wheel_momenta"] > 0.97


def gimbals(plan):
    from dataclasses import replace

    peaks = plan.certificate.peaks
    assert min(peaks["joint_rates"], peaks["joint_accelerations"], peaks["torque"]) > 0.95
    craft = plan.scenario.spacecraft
    light = [replace(one, yaw_inertia=None, pitch_inertia=None) for one in craft.terminals]
    alone = jp.measures.peak_torque(plan.trajectory, replace(craft, terminals=tuple(light)))
    assert alone > 1.5 * jp.measures.peak_torque(plan.trajectory, craft)


def inspection(plan):
    client = plan.scenario.goal.directions[0]
    seen = client.at(np.array([0.0, 60.0]))
    assert np.rad2deg(np.arccos(seen[0] @ seen[1])) == pytest.approx(2, abs=0.5)
    assert plan.certificate.peaks["pitch"] > 0.99
    pitch = np.rad2deg(plan.trajectory.sample(plan.trajectory.duration).joints[1])
    assert pitch == pytest.approx(-9.9, abs=1e-3)


def flyby(plan):
    passing, downlink = plan.activities
    assert passing.end - 600 == pytest.approx(315, abs=20)
    assert passing.start < 200
    assert rate(plan, 600.0) == pytest.approx(np.rad2deg(7 / 1200), rel=0.02)
    assert rate(plan, np.array([passing.start, passing.end])).max() < 0.2
    assert max(np.rad2deg(passing.pointing_error), np.rad2deg(downlink.pointing_error)) < 0.002
    assert plan.certificate.peaks["angular_acceleration"] > 0.97


def operations(plan):
    assert [one.name for one in plan.activities][1:5] == ["oslo", "geneva", "rome", "tunis"]
    geneva, rome, tunis = plan.activities[2:5]
    assert rome.end - rome.start == pytest.approx(12)
    assert tunis.end == tunis.start
    assert geneva.start - plan.activities[1].end > 200  # it waits


SEEN = {
    "earth-imaging": images,
    "laser-handover": handover,
    "laser-mesh": mesh,
    "star-trackers": trackers,
    "ground-station": station,
    "space-telescope": telescope,
    "safe-mode": safe,
    "wheels": wheels,
    "gimbals": gimbals,
    "inspection": inspection,
    "asteroid-flyby": flyby,
    "imaging-day": operations,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_each_example_is_certified_anew_and_shows_what_its_page_says(exhibits, name):
    plan = exhibits.plan_of(name)
    assert plan.ok
    again = plan.certify() if isinstance(plan, jp.TimelinePlan) else jp.certify(plan)
    assert again.certified
    assert again.min_margin >= 0
    SEEN[name](plan)
    told = exhibits.numbers(plan)
    assert f"| duration | {plan.trajectory.duration:.2f} s |" in told
    assert "| certified | yes, at every instant |" in told
