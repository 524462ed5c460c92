"""The viewer's page: what it is given, that it asks for nothing, and in a browser what it shows."""

import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from browser import BROWSER, matrices, opened, pictured, read_back
from builders import make_plan
from exports import flown_plan
from oblique import oblique_craft
from reference import assert_each

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.viewing.content import content

pytest.importorskip("k3d", reason="the extra view is not installed")
SHARES = np.linspace(0, 1, 10)


def plans() -> dict[str, jp.Plan]:
    """Plans with all kinds of devices, without zones, without joints, and without duration."""
    return {
        "four terminals": make_plan(4, 2, zones=6),
        "no zones": make_plan(2, 1, zones=0),
        "no joints": make_plan(0, 2),
        "no duration": make_plan(2, 1, duration=0.0),
        "oblique": make_plan(craft=oblique_craft(2, 2, 1), zones=3),
        "flown": flown_plan(),
    }


NAMES = ("four terminals", "no zones", "no joints", "no duration", "oblique", "flown")


@pytest.fixture(scope="module")
def every() -> dict[str, jp.Plan]:
    return plans()


@pytest.fixture(scope="module")
def report(every, tmp_path_factory) -> str:
    """The page of a report with the viewer."""
    file = tmp_path_factory.mktemp("report") / "space.html"
    return jp.report_html(every["four terminals"], file, viewer=True).read_text(encoding="utf-8")


class Links(HTMLParser):
    """Collects what a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [f"{tag} {name}={value}" for name, value in attrs if name in ("src", "href")]


@pytest.mark.parametrize("name", NAMES)
def test_the_page_is_whole_and_small_and_loads_nothing(every, name, tmp_path):
    file = jp.view(every[name]).save(tmp_path / "view.html")
    page = file.read_text(encoding="utf-8")
    assert len(page.encode()) < 6e6
    links = Links()
    links.feed(page)
    assert links.found == []
    assert "@DATA@" not in page
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    assert data["name"] == every[name].scenario.name
    assert len(data["devices"]) == len(every[name].scenario.spacecraft.device_names)


def test_names_cannot_leave_their_place_in_the_page(every, tmp_path):
    plan = every["flown"]
    naughty = "</script><script>alert(1)</script> @DATA@ <!--"
    page = jp.view(replace(plan, scenario=replace(plan.scenario, name=naughty))).html
    assert "<script>alert(1)" not in page
    assert json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])["name"] == naughty


def test_curves_are_those_of_the_plan(every):
    plan = every["four terminals"]
    data = content(plan)
    times = np.array(data["times_s"])
    values = plan.trajectory.sample(times)
    craft = plan.scenario.spacecraft
    charts = {chart["title"]: chart for chart in data["charts"]}
    joints = np.array([line["values"] for line in charts["joints, deg"]["lines"]]).T
    np.testing.assert_allclose(joints, np.rad2deg(values.joints), atol=1e-5)
    rates = np.array([line["values"] for line in charts["rates, percent of their limits"]["lines"]]).T
    expected = np.abs(
        np.hstack([values.angular_velocity / craft.rate_limit, values.joint_rates / craft.joint_rate_limits])
    )
    np.testing.assert_allclose(rates, 100 * expected, atol=1e-5)
    beams = np.asarray(craft.boresights(values.attitude, values.joints))
    zones = plan.scenario.keep_out
    for number, line in enumerate(charts["smallest margin to zones, deg"]["lines"]):
        angles = [
            np.arccos(np.clip(beams[:, number] @ zone.direction, -1, 1)) - zone.half_angle for zone in zones
        ]
        np.testing.assert_allclose(line["values"], np.rad2deg(np.min(angles, axis=0)), atol=1e-4)
    np.testing.assert_allclose(np.array(data["trails"]).transpose(1, 0, 2), beams, atol=1e-6)


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
@pytest.mark.parametrize("name", NAMES)
def test_in_a_browser_matrices_are_those_of_the_motion_and_nothing_goes_wrong(every, name, tmp_path):
    plan = every[name]
    times = SHARES * plan.trajectory.duration
    told = opened(
        jp.view(plan).html, tmp_path, f"() => {json.dumps(times.tolist())}.map((t) => Viewer.at(t))"
    )
    assert told["wrong"] == told["console"] == []
    for shown, expected in zip(read_back(told["found"]), matrices(plan, times), strict=True):
        assert_each(np.abs(shown - expected), "<", 1e-6)


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
def test_keys_move_time_and_change_looks(every, tmp_path):
    script = """() => {
        const press = (key, more) => window.dispatchEvent(Object.defineProperty(
            new KeyboardEvent("keydown", { key, cancelable: true, ...more }),
            "target", { value: document.body }));
        const slider = document.getElementById("slider");
        const seen = [];
        const note = (what) => seen.push([what, document.getElementById("time").textContent]);
        press("End"); Viewer.at(Number(slider.max)); note("end");
        press("Home"); Viewer.at(0); note("home");
        press("t"); seen.push(document.documentElement.dataset.theme);
        press("t"); seen.push(document.documentElement.dataset.theme);
        press("b"); seen.push(document.getElementById("frame").textContent);
        press("?"); seen.push(document.getElementById("help").hidden);
        press("+"); seen.push(document.getElementById("speed").textContent);
        press(" "); seen.push(document.getElementById("play").textContent);
        return seen;
    }"""
    told = opened(jp.view(every["flown"]).html, tmp_path, script)
    end, home, *rest = told["found"]
    assert end == ["end", "30.00 s of 30.00 s"]
    assert home == ["home", "0.00 s of 30.00 s"]
    assert sorted(rest[:2]) == ["dark", "light"]
    assert rest[2:] == ["Body axes", False, "2\u00d7", "Pause"]
    assert told["console"] == told["wrong"] == []


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
def test_screenshots_have_the_sphere_and_pages_say_when_they_are_ready(every, tmp_path):
    page = jp.view(every["flown"]).html
    assert opened(page, tmp_path, "() => document.documentElement.dataset.ready")["found"] == "true"
    seen = pictured(page, tmp_path)
    middle = seen[200:400, 500:800]  # rows and columns within the sphere
    assert len(np.unique(middle.reshape(-1, middle.shape[-1]), axis=0)) > 20  # of an empty one there is one


def test_a_notebook_shows_the_page_in_a_frame_of_its_own(every):
    shown = jp.view(every["flown"], height=500)._repr_html_()
    assert shown.startswith("<iframe srcdoc=")
    assert "height: 500px" in shown
    assert "<script" not in shown


@pytest.mark.parametrize(
    ("call", "kind", "told"),
    [
        (lambda plan: jp.view("plan.json"), TypeError, "jp.load_plan"),
        (lambda plan: jp.view(plan, height=3), ValueError, r"height = 3: must lie in \[200, 10000\]"),
        (lambda plan: jp.view(replace(plan, trajectory=None)), ValueError, "has no trajectory to show"),
        (lambda plan: jp.view(plan).save(""), ValueError, "path"),
    ],
)
def test_what_cannot_be_shown_is_refused(every, call, kind, told):
    with pytest.raises(kind, match=told):
        call(every["flown"])


def test_without_the_extra_it_is_named(every, monkeypatch):
    monkeypatch.setattr("jaxplan.viewing.page.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install 'jaxplan\[view\]'"):
        jp.view(every["flown"])


def test_files_are_not_replaced_unless_told(every, tmp_path):
    shown = jp.view(every["no joints"])
    file = shown.save(tmp_path / "new" / "view.html")
    with pytest.raises(FileExistsError):
        shown.save(file)
    assert shown.save(file, overwrite=True) == file


def test_the_command_line_writes_the_page_beside_the_plan(tmp_path, capsys):
    plan = jp.plan(jp.paper_case(4))
    plan.save(tmp_path / "plan.json")
    assert main(["view", str(tmp_path / "plan.json")]) == 0
    assert "plan.view.html: open it in a browser" in capsys.readouterr().err
    assert (tmp_path / "plan.view.html").stat().st_size > 2e6
    assert main(["view", str(tmp_path / "plan.json")]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["view", str(tmp_path / "plan.json"), "--force"]) == 0


def test_a_report_has_the_viewer_where_it_is_asked_for_and_else_runs_nothing(every, report, tmp_path):
    plain = jp.report_html(every["four terminals"], tmp_path / "plain.html").read_text(encoding="utf-8")
    assert "<iframe" not in plain
    assert "script-src" not in plain
    assert report.count("<iframe") == 1
    assert "script-src" in report
    assert "<script" not in report.replace("&lt;script", "")
    assert report.index("In space") < report.index("The manoeuvre")


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
def test_the_viewer_runs_within_a_report(report, tmp_path):
    script = "() => { const w = document.querySelector('iframe'); return w.srcdoc.length; }"
    told = opened(report, tmp_path, script)
    assert told["found"] > 2e6
    assert told["wrong"] == told["console"] == []


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 720)])
def test_on_a_phone_and_on_a_projector_nothing_is_cut_and_no_names_touch(every, tmp_path, width, height):
    page = jp.view(every["four terminals"]).html
    size = f"width:{width}px;height:{height}px;border:0"
    frame = f"<iframe id='own' srcdoc=\"{html.escape(page)}\" style='{size}'></iframe>"
    script = """() => {
        const own = document.getElementById("own").contentDocument, wide = own.documentElement.clientWidth;
        const box = (element) => {
            const found = element.getBoundingClientRect();
            return [found.left, found.top, found.right, found.bottom];
        };
        const shown = [...own.querySelectorAll(".label")].filter((one) => Number(one.style.opacity) > 0);
        return {
            wide, over: own.documentElement.scrollWidth - wide,
            bar: [...own.querySelectorAll("#bar > *, header > *")].map(box),
            names: shown.map(box), hidden: own.querySelectorAll(".label").length - shown.length,
        };
    }"""
    told = opened(
        f"<!doctype html><html><head></head><body>{frame}</body></html>",
        tmp_path,
        script,
        later=True,
    )["found"]
    assert width - 20 < told["wide"] <= width  # a bar to scroll by may take the rest
    assert told["over"] <= 0
    for left, top, right, bottom in told["bar"]:
        assert 0 <= left <= right <= told["wide"]
        assert top <= bottom
    assert len(told["names"]) > 6
    for number, one in enumerate(told["names"]):
        for other in told["names"][:number]:
            apart = (one[0] >= other[2] or other[0] >= one[2]), (one[1] >= other[3] or other[1] >= one[3])
            overlap = min(one[3], other[3]) - max(one[1], other[1])
            assert any(apart) or overlap < 0.25 * (one[3] - one[1])


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium")
def test_names_of_zones_about_one_axis_are_all_shown_and_swatches_are_as_their_curves(tmp_path):
    plan = make_plan(2, 1)
    names = ["sun imager", "sun tracker", "moon", "earth"]
    zones = tuple(replace(plan.scenario.keep_out[0], name=name) for name in names)
    plan = replace(plan, scenario=replace(plan.scenario, keep_out=zones))
    script = """() => ({
        zones: [...document.querySelectorAll(".label.zone")].map((one) =>
            [one.textContent, Number(one.style.opacity)]),
        swatches: [...document.querySelectorAll("figcaption button")].map((one) => [
            one.querySelector(".name").textContent,
            one.querySelector("i").style.background.includes("gradient"),
        ]),
    })"""
    told = opened(jp.view(plan).html, tmp_path, script, later=True)["found"]
    assert {name for name, opacity in told["zones"] if opacity > 0} == set(names)
    dashed = {
        line["name"] for chart in content(plan)["charts"] for line in chart["lines"] if line.get("dashes")
    }
    assert dashed
    assert {name for name, gradient in told["swatches"] if gradient} == dashed
