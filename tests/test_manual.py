"""The built manual: its gallery is certified and shows what its pages say, and no page has a fault."""

import re
from contextlib import redirect_stderr
from functools import cache
from html.parser import HTMLParser
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from urllib.parse import unquote, urldefrag

import numpy as np
import pytest

import jaxplan as jp

pytest.importorskip("erfa")

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
GALLERY = DOCS / "gallery"
NAMES = sorted(file.stem for file in GALLERY.glob("*.toml"))


@pytest.fixture(scope="module")
def exhibits():
    """What makes the gallery, with each plan made once, for the tests and for the manual."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(DOCS)
        import exhibits

        patch.setattr(exhibits, "plan_of", cache(exhibits.plan_of))
        yield exhibits


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


class Links(HTMLParser):
    """The places that a page links to, and those that links may go to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if key in ("href", "src") and value is not None:
                self.targets.append(value)
            if key == "id" and value is not None:
                self.names.add(value)


NARROWER = {"dd": 32, "cell_input": 4}  # px: descriptions are moved in, cells have a border


class Code(HTMLParser):
    """The code of a page: lines of each block, and how much narrower than the column it is, in px."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.blocks: list[tuple[list[str], int]] = []
        self.within: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = (dict(attrs).get("class") or "").split()
        if tag in ("dd", "div", "pre"):
            self.within.append(next((name for name in ("cell_input", "cell_output") if name in names), tag))
        if tag == "pre":
            self.blocks.append(([""], sum(NARROWER.get(name, 0) for name in self.within)))

    def handle_endtag(self, tag: str) -> None:
        if tag == "pre" and "cell_output" in self.within:
            self.blocks.pop()  # it is wrapped
        if tag in ("dd", "div", "pre"):
            self.within.pop()

    def handle_data(self, data: str) -> None:
        if "pre" in self.within:
            first, *more = data.split("\n")
            lines = self.blocks[-1][0]
            lines[-1] += first
            lines += more


@pytest.fixture(scope="module")
def manual(tmp_path_factory, exhibits):
    """The folder of the manual, built in this process, which has the gallery's plans."""
    absent = [module for module in ("sphinx", "furo", "myst_nb") if find_spec(module) is None]
    if absent:
        pytest.skip(f"{', '.join(absent)} not installed: pip install 'jaxplan[docs]'")
    from sphinx.cmd.build import build_main

    folder = tmp_path_factory.mktemp("manual")
    options = ["-q", "-W", "--keep-going", "-d", str(folder / "trees")]
    with redirect_stderr(StringIO()) as told:
        failed = build_main([*options, str(DOCS), str(folder / "pages")])
    assert (failed, told.getvalue()) == (0, "")
    return folder / "pages"


@pytest.mark.slow
def test_no_line_of_code_is_wider_than_its_column(manual):
    style = (manual / "_static" / "manual.css").read_text()
    column, side, padding = (
        float(re.search(found, style)[1])
        for found in (r"--column: (\d+)em", r"\.sidebar-drawer { width: (\d+)em", r"padding: 0 (\d)em")
    )
    assert side + column + 2 * padding <= (1280 - 15) / 16  # a usual window, less its scroll bar
    size, edge = (
        16 * float(re.search(rf"--{name}: ([\d.]+)rem", style)[1])
        for name in ("code-font-size", "code-padding")
    )
    widest_letter = 0.602 * size  # of the usual fonts of fixed width
    wide, seen = [], 0
    for file in manual.rglob("*.html"):
        for lines, narrower in Code(file.read_text(encoding="utf-8")).blocks:
            room = int((16 * column - narrower - 2 * edge) / widest_letter)
            wide += [f"{file.name}: {line}" for line in lines if len(line) > room]
            seen += len(lines)
    assert wide == []
    assert seen > 500


@pytest.mark.slow
def test_the_manual_builds_without_a_warning_and_its_links_lead_somewhere(manual):
    files = sorted(manual.rglob("*.html"))
    parsed = {file: Links(file.read_text(encoding="utf-8")) for file in files}
    names = {file.relative_to(manual).as_posix() for file in files}
    assert {"index.html", "method.html", "api.html", "planner.html", "results.html"} <= names
    assert sum("notebooks" in name for name in names) == len(list((ROOT / "notebooks").glob("*.ipynb")))
    broken, checked = [], 0
    for file, page in parsed.items():
        for target in page.targets:
            place, name = urldefrag(target)
            if "://" in place or place.startswith(("data:", "mailto:")):
                continue
            goal = (file.parent / unquote(place.partition("?")[0])).resolve() if place else file
            checked += 1
            whole = goal.is_file() and (not name or goal not in parsed or unquote(name) in parsed[goal].names)
            if not whole:
                broken.append(f"{file.name}: {target}")
    assert broken == []
    assert checked > 200
    assert "<math" in (manual / "method.html").read_text(encoding="utf-8")
