"""The page on a timeline's plan: what it says, and that it asks for nothing."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from days import ERROR, day, zone
from html_page import NASTY, Page

import jaxplan as jp
from jaxplan.model.activities import Segment
from jaxplan.model.status import Status
from jaxplan.plotting import activity_bars
from jaxplan.report.day import day_page, duration_text
from jaxplan.report.markup import tiles
from jaxplan.timeline import TimelinePlan
from jaxplan.timeline.events import events
from jaxplan.timeline.tables import segments_csv

DRAW = "jaxplan.report.day._draw_figures"


@pytest.fixture(scope="module")
def plan() -> TimelinePlan:
    return day(zone(f"sun {NASTY}", 90, 20, 10), name=f"D {NASTY}", image=f"A {NASTY}")


@pytest.fixture(scope="module")
def file(plan: TimelinePlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return jp.report_html(plan, tmp_path_factory.mktemp("page") / "day.html")


@pytest.fixture(scope="module")
def page(file: Path) -> Page:
    return Page(file.read_text(encoding="utf-8"))


def _table(page, words):
    (found,) = [text for text in page.texts["table"] if words in text]
    return found


def test_the_page_is_well_formed_and_its_tables_are_rectangular(page):
    names = page.attributes("id")
    assert len(names) == len(set(names))
    assert all(len(set(rows)) == 1 for rows in page.tables)
    assert all(found.get("alt") for tag, found in page.tags if tag == "img")
    assert {"figure-timeline", "figure-globe", "figure-sphere", "figure-spacecraft"} <= set(names)


def test_the_page_asks_for_no_other_file_and_runs_nothing(page):
    assert page.attributes("href") == []
    assert all(source.startswith("data:image/") for source in page.attributes("src"))
    assert not {"script", "iframe", "link", "object"} & {tag for tag, _ in page.tags}
    assert all(not name.startswith("on") for _, found in page.tags for name in found)
    assert page.texts["h1"] == [f"D {NASTY}"]


def test_the_page_tells_of_every_activity_with_times_error_status_and_message(page, plan):
    table = _table(page, "in the order in which they are done")
    assert "2026-06-20 23:57:00.000" in table
    assert "2026-06-21 00:07:00.000" in table
    assert f"{np.rad2deg(1.1 * ERROR):.1e}" in table
    assert "Goal unreachable" in table
    assert "losttelescope cannot point there" in _table(page, "What is in the way")
    assert page.texts["strong"] == ["Goal unreachable"]
    assert plan.message in "".join(page.texts["p"])


def test_the_page_tells_of_every_event_and_of_what_is_proved(page, plan):
    table = _table(page, "What happens, in order of time")
    for event in events(plan):
        assert event.text in table
    proof = _table(page, "Smallest margin, at least")
    assert "5.730 deg, telescope to sun at 2026-06-20 23:58:00.000" in proof
    assert "25.0" in _table(page, "Peaks over all time")


@pytest.mark.slow
def test_the_same_plan_gives_the_same_page_and_an_old_file_is_kept(plan, file, tmp_path):
    again = jp.report_html(plan, tmp_path / "again.html")
    assert again.read_bytes() == file.read_bytes()
    with pytest.raises(FileExistsError):
        jp.report_html(plan, file)


def test_a_plan_that_is_all_well_says_so(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(DRAW, lambda *_: [])
    done = replace(plan, status=Status.OK, message="", activities=plan.activities[::2])
    page = Page(jp.report_html(done, tmp_path / "ok.html").read_text(encoding="utf-8"))
    assert page.texts["strong"] == ["Certified"]
    assert "not tried: lost" in _table(page, "in the order in which they are done")


def test_a_plan_without_a_trajectory_has_a_page(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(DRAW, lambda *_: [])
    failed = replace(plan, trajectory=None, certificate=None, segments=(), activities=plan.activities[1:2])
    page = Page(jp.report_html(failed, tmp_path / "failed.html").read_text(encoding="utf-8"))
    assert not any("in order of time" in text for text in page.texts["table"])
    assert "0 of 3" in "".join(page.texts["dd"])


@pytest.mark.parametrize("rests", [0, 2])
def test_slews_are_counted_as_one_everywhere(plan, rests, monkeypatch):
    monkeypatch.setattr(DRAW, lambda *_: [])

    def to(name, *spans):
        return [Segment(name=name, kind=kind, start=start, end=end) for kind, start, end in spans]

    last = ("slew", 20.0, 30.0), ("track", 30.0, 40.0)
    on_the_way = [("slew", 10.0, 12.5), ("idle", 12.5, 20.0)] if rests else []
    segments = [one for name in ("a", "b") for one in to(name, *on_the_way, *last)]
    counted = replace(plan, segments=tuple(segments))
    assert (
        len(counted.slews)
        == 2 + rests
        == len(activity_bars.slews(counted))
        == segments_csv(counted).count(",slew,")
    )
    total = 20.0 + 2.5 * rests
    told = dict(counted.rows())["slews"]
    assert told.startswith(f"{2 + rests}, ")
    assert f", {total:.1f} s in all, 10.0 s the longest" in told
    page = Page(day_page(counted))
    (label,) = [text for text in page.texts["dt"] if "slews" in text]
    assert label.startswith(f"in {2 + rests} slews")
    assert duration_text(total) in page.texts["dd"]
    for text in (told, label):
        assert ("to rests" in text) == (rests > 0)
        assert str(rests) in text or rests == 0


def test_numbers_on_cards_stand_in_rows_of_nearly_the_same_length():
    for count in range(1, 12):
        text = tiles([("label", "value", "")] * count)
        columns = int(re.search(r"--columns: (\d+)", text)[1])
        assert columns <= 5
        assert -count % columns <= (count - 1) // columns, "no card stands alone in the last of several rows"
