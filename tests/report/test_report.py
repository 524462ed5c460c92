"""The page on a plan: what it says, that it asks for nothing, and how a real browser shows it."""

import base64
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_observer, make_plan
from exports import flown_plan
from html_page import NASTY, Page
from matplotlib import image
from scipy.spatial.transform import Rotation
from wheels import wheels

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.model.directions import DirectionPath
from jaxplan.model.limits import limits
from jaxplan.model.path import Path as Way
from jaxplan.model.status import STEPS, Status
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.report.tables import ends_tables, highest_peak, motion_table, peaks_table, spacecraft_tables
from jaxplan.schema import parse_scenario
from jaxplan.search import SearchResult

DRAW = "jaxplan.report._draw_figures"
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def whole_plan() -> jp.Plan:
    """A plan with all its parts, in whose names stands what a page must not run."""
    plan = flown_plan()
    craft = plan.scenario.spacecraft
    first, second = (replace(terminal, yaw_limit=3.1, pitch_limit=1.5) for terminal in craft.terminals)
    craft = replace(
        craft,
        terminals=(replace(first, name=f"T {NASTY}"), second),
        inertia=np.diag([20.0, 30.0, 40.0]),
        torque_limit=np.array([90.0, 90.0, 99.0]),
    )
    times = plan.trajectory.node_times
    motion = plan.trajectory.sample(times)
    looks = np.asarray(craft.boresights(motion.attitude, motion.joints))
    away = -looks[:, 1].mean(axis=0) / np.linalg.norm(looks[:, 1].mean(axis=0))
    zones = [KeepOut(name=f"Z {NASTY}", direction=away, half_angle=0.2, devices=craft.device_names[1:2])]
    zones.append(replace(zones[0], name="wide", half_angle=0.3))
    held = [
        KeepIn(
            name=name, direction=-away, half_angle=half, devices=craft.device_names[1:2], any_of=f"G {NASTY}"
        )
        for name, half in (("near", 3.0), ("far", 2.9))
    ]
    scenario = replace(
        plan.scenario, name=f"S {NASTY}", spacecraft=craft, keep_out=tuple(zones), keep_in=tuple(held)
    )
    way = Way(attitudes=motion.attitude, joints=motion.joints, edge_costs=np.full(3, 2.5))
    found = SearchResult(status=Status.OK, path=way, expansions=7, queue_expansions=(7,))
    timings = {"decompose": 0.25, "search": 1.5, "compile": 2.0, "total": 3.75}
    plan = replace(plan, scenario=scenario, search=found, path=way, timings=timings)
    report = jp.planner.certify(plan)
    assert report.certified, report.faults
    return replace(plan, certificate=report)


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return whole_plan()


@pytest.fixture(scope="module")
def file(plan: jp.Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return jp.report_html(plan, tmp_path_factory.mktemp("page") / "new" / "slew.html")


@pytest.fixture(scope="module")
def page(file: Path) -> Page:
    return Page(file.read_text(encoding="utf-8"))


def test_the_page_is_well_formed_and_its_tables_are_rectangular(page):
    assert [tag for tag, _ in page.tags if tag in ("html", "head", "body", "h1")] == [
        "html",
        "head",
        "body",
        "h1",
    ]
    names = page.attributes("id")
    assert len(names) == len(set(names))
    assert all(len(set(rows)) == 1 for rows in page.tables)
    assert len(page.tables) >= 9
    assert all(found.get("alt") for tag, found in page.tags if tag == "img")


def test_the_page_asks_for_no_other_file(page):
    text = page.texts["style"][0]
    assert not re.search(r"url\(|@import|https?:", text)
    assert page.attributes("href") == []
    sources = page.attributes("src")
    assert len(sources) == 8
    for source in sources:
        kind, _, data = source.partition(",")
        content = base64.b64decode(data, validate=True)
        if kind == "data:image/png;base64":
            assert content.startswith(b"\x89PNG")
            continue
        assert kind == "data:image/svg+xml;base64"
        picture = content.decode()
        assert "<pattern" not in picture  # hatches print solid
        assert "<script" not in picture
        assert all(place.startswith("#") for place in re.findall(r'href="([^"]*)"', picture))
    policy = next(found["content"] for _, found in page.tags if "http-equiv" in found)
    assert "default-src 'none'" in policy


def test_names_are_text_and_nothing_else(page):
    assert not {"script", "iframe", "link", "object"} & {tag for tag, _ in page.tags}
    assert all(not name.startswith("on") for _, found in page.tags for name in found)
    assert page.texts["h1"] == [f"S {NASTY}"]
    for name in (f"T {NASTY}", f"Z {NASTY}"):
        assert name in page.texts["th"]
    assert f"keep-in, any of G {NASTY}" in page.texts["td"]


def test_the_page_says_what_is_proved(page, plan):
    assert page.texts["strong"] == ["Certified"]
    (margins,) = [table for table in page.texts["table"] if "Margins over all time" in table]
    bound = f"{np.rad2deg(plan.certificate.min_margin):.3f}"
    assert bound in margins
    assert margins.index(bound) < margins.index("wide") or "wide" in margins.split(bound)[0]
    (peaks,) = [table for table in page.texts["table"] if "Peaks over all time" in table]
    for peak in plan.certificate.peaks.values():
        assert f"{100 * peak:.1f}" in peaks
    limit = np.rad2deg(plan.scenario.spacecraft.rate_limit)
    assert f"{plan.certificate.peaks['angular_velocity'] * limit:.3f}{limit:.3f}deg/s" in peaks
    assert any("7 of at most" in table and "7.50 steps" in table for table in page.texts["table"])
    assert any("compiling2.000" in table for table in page.texts["table"])


def test_the_scenario_on_the_page_is_the_one_that_was_planned(page, plan):
    assert parse_scenario(page.texts["pre"][0]) == plan.scenario


def test_the_same_plan_gives_the_same_page(plan, file, tmp_path):
    again = jp.report_html(plan, tmp_path / "again.html")
    assert again.read_bytes() == file.read_bytes()


@pytest.mark.parametrize("status", [status for status in Status if status is not Status.OK])
def test_a_failed_plan_says_where_and_what_to_change(plan, status, tmp_path, monkeypatch):
    monkeypatch.setattr(DRAW, lambda *_: [])
    came = STEPS.index(status.step)
    known = {
        "goal": came >= 2,
        "search": came >= 2,
        "path": came >= 3,
        "trajectory": status is Status.UNCERTIFIED,
        "certificate": status is Status.UNCERTIFIED,
    }
    parts = {name: getattr(plan, name) if there else None for name, there in known.items()}
    failed = replace(plan, status=status, message=f"so & so: {NASTY}", timings={}, **parts)
    page = Page(jp.report_html(failed, tmp_path / "failed.html").read_text(encoding="utf-8"))
    assert page.texts["strong"] == [status.name.replace("_", " ").capitalize()]
    assert f"What happened: so & so: {NASTY}" in page.texts["p"]
    assert f"What to change: {status.advice}" in page.texts["p"]
    looks = [found["class"] for tag, found in page.tags if tag == "li" and "class" in found]
    assert looks == ["done"] * came + ["failed"] + ["left"] * (4 - came)
    assert parse_scenario(page.texts["pre"][0]) == plan.scenario


def test_a_failed_plan_has_the_figures_that_it_came_to(plan, tmp_path):
    failed = replace(plan, status=Status.NODE_LIMIT, path=None, trajectory=None, certificate=None)
    page = Page(jp.report_html(failed, tmp_path / "failed.html").read_text(encoding="utf-8"))
    assert [name for name in page.attributes("id") if "figure" in name] == [
        "figure-globe",
        "figure-sphere",
        "figure-spacecraft",
    ]


def test_a_plan_that_only_calls_itself_certified_is_found_out(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(DRAW, lambda *_: [])
    craft = replace(plan.scenario.spacecraft, rate_limit=1e-4)
    lying = replace(plan, scenario=replace(plan.scenario, spacecraft=craft))
    page = Page(jp.report_html(lying, tmp_path / "lie.html").read_text(encoding="utf-8"))
    assert page.texts["strong"] == ["Uncertified"]
    assert any("made anew, fails: angular velocity" in text for text in page.texts["p"])
    lying.save(tmp_path / "claims.json")
    assert main(["report", str(tmp_path / "claims.json")]) == 3


def test_a_scene_without_devices_or_zones_has_a_page(tmp_path):
    bare = flown_plan(terminals=0)
    craft = replace(bare.scenario.spacecraft, instruments=())
    bare = replace(bare, scenario=replace(bare.scenario, spacecraft=craft))
    page = Page(jp.report_html(bare, tmp_path / "bare.html").read_text(encoding="utf-8"))
    assert any("none: devices may look anywhere" in table for table in page.texts["table"])


def test_the_page_tells_of_mountings_fields_wishes_and_what_is_held(tmp_path, monkeypatch):
    monkeypatch.setattr(DRAW, lambda *_: [])
    craft = make_observer()
    field = {"field_of_view": np.deg2rad([14.3, 10.0]), "up": np.array([1.0, 0.0, 0.0])}
    craft = replace(craft, instruments=(replace(craft.instruments[0], **field), *craft.instruments[1:]))
    plan = make_plan(craft=craft)
    looks = craft.boresights(plan.goal.attitude, plan.goal.joints)
    across = np.cross(looks[1], [0.0, 0.0, 1.0])
    near = Rotation.from_rotvec(np.deg2rad(2.5) * across / np.linalg.norm(across)).apply(looks[1])
    wish, still = jp.Wish(device="array", direction=near), {"angular_velocity": np.zeros(3)}
    goal = jp.Targets.of(
        {"telescope": looks[2]}, prefer=(wish,), hold=("antenna",), joint_rates=np.zeros(3), **still
    )
    plan = replace(plan, scenario=replace(plan.scenario, goal=goal), status=Status.NODE_LIMIT)
    page = Page(jp.report_html(plan, tmp_path / "observer.html").read_text(encoding="utf-8"))
    for title, words in {
        "Terminals, how they are mounted": "antenna",
        "Drives, how they are mounted": "array",
        "Limits of the joints": "120.00200.001.200.40",
        "Rectangular fields of view": "telescope14.3010.00",
        "Targets asked for": "telescope",
        "What devices without a target prefer": "2.5000",
        "Devices that keep their joints": "antenna",
    }.items():
        (table,) = [table for table in page.texts["table"] if title in table]
        assert words in table


def test_the_page_has_every_wheel_with_what_it_may_give_and_hold(tmp_path):
    plan = flown_plan()
    array = wheels(np.eye(3), [90.0, 91.0, 92.0], [55.5, 66.0, 77.0], [0.0, 0.125, -2.0])
    craft = replace(plan.scenario.spacecraft, inertia=np.diag([20.0, 30.0, 40.0]), wheels=array)
    narrow = tuple(replace(t, yaw_limit=3.1, pitch_limit=1.5) for t in craft.terminals)
    stage = np.array([[0.5, 0.1, 0.0], [0.1, 0.625, 0.0], [0.0, 0.0, 0.75]])
    narrow = (replace(narrow[0], pitch_inertia=stage), *narrow[1:])
    craft = replace(craft, terminals=narrow)
    plan = replace(plan, scenario=replace(plan.scenario, spacecraft=craft))
    plan = replace(plan, certificate=jp.planner.certify(plan))
    page = Page(jp.report_html(plan, tmp_path / "wheels.html").read_text(encoding="utf-8"))
    (given,) = [table for table in page.texts["table"] if "Reaction wheels" in table]
    assert "by the pseudo-inverse" in given
    (moving,) = [table for table in page.texts["table"] if "Gimbals that push back" in table]
    assert f"{narrow[0].name} pitch0.50.6250.75" in moving
    for words in ("9055.50", "91660.125", "9277-2"):
        assert words in given
    (peaks,) = [table for table in page.texts["table"] if "Peaks over all time" in table]
    assert "Wheel torques" in peaks
    assert "55.500 to 77.000N m s" in peaks


def test_the_page_has_every_limit_with_its_unit_and_its_peak(tmp_path):
    plan = flown_plan()
    loads = {"torque_limit": np.array([90.0, 91.0, 92.0]), "wheel_momentum_limit": 55.5, "jerk_limit": 0.025}
    loads |= {"rate_limit": np.deg2rad([61, 62, 63]), "rate_norm_limit": np.deg2rad(64)}
    craft = replace(plan.scenario.spacecraft, inertia=np.diag([20.0, 30.0, 40.0]), **loads)
    craft = replace(
        craft, terminals=tuple(replace(t, yaw_limit=3.1, pitch_limit=1.5) for t in craft.terminals)
    )
    plan = replace(plan, scenario=replace(plan.scenario, spacecraft=craft))
    plan = replace(plan, certificate=jp.planner.certify(plan))
    page = Page(jp.report_html(plan, tmp_path / "loads.html").read_text(encoding="utf-8"))
    (given,) = [table for table in page.texts["table"] if "limits of each body axis" in table]
    for text in ("Torque90, 91, 92 N m", "Wheel momentum55.5 N m s", f"Jerk{np.rad2deg(0.025):.6g} deg/s³"):
        assert text in given
    assert "Angular velocity61, 62, 63 deg/s" in given
    assert "Length of angular velocity64 deg/s" in given
    (peaks,) = [table for table in page.texts["table"] if "Peaks over all time" in table]
    jerk = np.rad2deg(0.025)
    assert f"{plan.certificate.peaks['jerk'] * jerk:.3f}{jerk:.3f}deg/s³" in peaks
    assert f"{plan.certificate.peaks['wheel_momentum'] * 55.5:.3f}55.500N m s" in peaks
    assert "90.000 to 92.000N m" in peaks
    assert [limit.quantity.name for limit in limits(craft)] == list(plan.certificate.peaks)
    assert all(limit.quantity.label in peaks for limit in limits(craft))


def test_an_old_file_stays_unless_it_may_go(plan, tmp_path, monkeypatch):
    place = tmp_path / "slew.html"
    place.write_text("mine")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        jp.report_html(plan, place)
    with pytest.raises(ValueError, match="is a folder"):
        jp.report_html(plan, tmp_path, overwrite=True)
    with pytest.raises(ValueError, match="path is empty"):
        jp.report_html(plan, "")

    def fail(*_: object) -> str:
        raise RuntimeError("no picture")

    monkeypatch.setattr(DRAW, fail)
    with pytest.raises(RuntimeError, match="no picture"):
        jp.report_html(plan, place, overwrite=True)
    assert place.read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["slew.html"]


def test_the_command_writes_beside_the_plan_and_replaces_only_with_force(plan, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(DRAW, lambda *_: [])
    plan.save(tmp_path / "plan.json")
    assert main(["report", str(tmp_path / "plan.json")]) == 0
    first = (tmp_path / "plan.html").read_bytes()
    (tmp_path / "plan.html").write_text("mine")
    assert main(["report", str(tmp_path / "plan.json")]) == 2
    assert "--force" in capsys.readouterr().err
    assert (tmp_path / "plan.html").read_text() == "mine"
    assert main(["report", str(tmp_path / "plan.json"), "--force"]) == 0
    assert (tmp_path / "plan.html").read_bytes() == first
    failed = jp.Plan(scenario=plan.scenario, status=Status.INVALID_START, message="no")
    failed.save(tmp_path / "failed.json")
    assert main(["report", str(tmp_path / "failed.json"), "-o", str(tmp_path / "page.html")]) == 1
    assert "failed here" in (tmp_path / "page.html").read_text(encoding="utf-8")


def browse(page: Path, folder: Path, *wishes: str) -> str:
    """Open a page in a browser with a profile of its own; returns what it prints."""
    quiet = ("no-first-run", "disable-background-networking", "disable-component-update", "disable-sync")
    switches = ("headless", "no-sandbox", "disable-gpu", "hide-scrollbars", "window-size=1100,2400", *quiet)
    words = [BROWSER, *(f"--{switch}" for switch in switches), f"--user-data-dir={folder / 'profile'}"]
    done = subprocess.run(
        [*words, *wishes, page.as_uri()], capture_output=True, text=True, check=True, timeout=120
    )
    return done.stdout


@pytest.mark.skipif(BROWSER is None, reason="no browser: apt-get install chromium")
class TestBrowser:
    def test_the_browser_runs_nothing_and_keeps_every_name(self, file, tmp_path):
        seen = Page(browse(file, tmp_path, "--dump-dom"))
        assert seen.texts["title"] == [f"S {NASTY} \N{EN DASH} Certified"]
        assert seen.texts["h1"] == [f"S {NASTY}"]
        assert seen.attributes("onerror") == []

    @pytest.mark.parametrize(("scheme", "ground"), [(1, 0.98), (0, 0.09)], ids=["light", "dark"])
    def test_the_browser_shows_the_figures_on_a_light_or_a_dark_ground(self, file, tmp_path, scheme, ground):
        shot = tmp_path / "shot.png"
        browse(file, tmp_path, f"--screenshot={shot}", f"--blink-settings=preferredColorScheme={scheme}")
        seen = image.imread(shot)[..., :3]
        assert seen.shape[0] == 2400
        assert abs(float(np.median(seen)) - ground) < 0.03
        strips = seen.reshape(24, 100, -1)
        assert np.count_nonzero(np.ptp(strips, axis=(1, 2)) > 0.3) > 18  # the page is full
        blue = np.array([0x00, 0x72, 0xB2]) / 255  # of the first device, in the figures alone
        if scheme == 1:
            assert np.count_nonzero(np.all(np.abs(seen - blue) < 0.02, axis=-1)) > 200


@pytest.mark.slow
def test_a_report_has_figures_along_the_orbit_where_that_is_given(plan, tmp_path):
    pytest.importorskip("erfa", reason="the extra orbit is not installed")
    dated = replace(plan, scenario=replace(plan.scenario, epoch=np.datetime64("2026-06-20T09:30:00", "ns")))
    orbit = jp.sky.CircularOrbit(altitude=600.0, inclination=1.7, node=0.2, latitude=1.0)
    names = ("orbital_sphere", "attitude", "ground_track")
    for file, more, there in (("with", {"observer": orbit}, True), ("without", {}, False)):
        page = jp.report_html(dated, tmp_path / f"{file}.html", **more).read_text(encoding="utf-8")
        assert [f'id="figure-{name}"' in page for name in names] == [there] * 3
    with pytest.raises(TypeError, match="observer must be an orbit"):
        jp.report_html(dated, tmp_path / "wrong.html", observer="ISS")


def test_a_joint_at_an_end_of_its_range_is_not_the_highest_load():
    craft = make_plan().scenario.spacecraft
    ranges = {limit.quantity.name for limit in limits(craft) if not limit.quantity.power}
    loads = [limit.quantity.name for limit in limits(craft) if limit.quantity.power]
    assert ranges
    peaks = dict.fromkeys(ranges, 1.0) | dict.fromkeys(loads, 0.5) | {loads[-1]: 0.75}
    certificate = replace(jp.certify(flown_plan()), peaks=peaks)
    label, percent = highest_peak(certificate, craft)
    (last,) = (own.quantity.label.lower() for own in limits(craft) if own.quantity.name == loads[-1])
    assert label == last
    assert percent.startswith("75")


def test_products_of_inertia_stand_beside_the_moments_and_only_where_there_are_any():
    craft = make_plan().scenario.spacecraft
    skew = np.array([[20.0, 1.5, 0.0], [1.5, 30.0, -2.25], [0.0, -2.25, 40.0]])
    page, plain = (
        str(spacecraft_tables(replace(craft, inertia=inertia))) for inertia in (skew, np.diag(np.diag(skew)))
    )
    for text in ("Products of inertia xy, xz, yz", "1.5000,", "\N{MINUS SIGN}2.2500"):
        assert text in page
        assert text not in plain


def test_peaks_of_angles_are_told_as_the_way_to_an_end_of_the_range_that_the_joint_has():
    plan = flown_plan()
    craft = plan.scenario.spacecraft
    ranged = tuple(replace(one, pitch_range=np.deg2rad([-20.0, 88.0])) for one in craft.terminals)
    certificate = replace(jp.certify(plan), peaks={"pitch": 0.5, "angular_velocity": 0.25})
    text = str(peaks_table(certificate, replace(craft, terminals=ranged)))
    assert "Pitch angles, of the way to an end of their range" in text
    assert "\N{MINUS SIGN}20.000 to 88.000" in text
    assert "27.000" not in text  # half of half the range, which is no angle of the joint
    own = (replace(ranged[0], pitch_range=np.deg2rad([0.0, 10.0])), *ranged[1:])
    assert " to 88.000" not in str(peaks_table(certificate, replace(craft, terminals=own)))


def test_targets_and_what_moves_have_their_names():
    plan = make_plan()
    craft, goal = plan.scenario.spacecraft, plan.goal
    looks = craft.boresights(goal.attitude, goal.joints)
    times = np.linspace(0.0, 100.0, 5)
    path = replace(DirectionPath.through(times, np.repeat(looks[:1], 5, axis=0)), called="kiruna")
    names = craft.device_names
    asked = jp.Targets.of({names[0]: path, names[1]: looks[1]}, angular_velocity=np.zeros(3))
    asked = replace(asked, joint_rates=np.zeros(len(goal.joints)))
    plan = replace(plan, scenario=replace(plan.scenario, goal=asked))
    assert "kiruna" in str(ends_tables(plan))
    assert f"the target of {names[0]}, kiruna" in str(motion_table(plan))
