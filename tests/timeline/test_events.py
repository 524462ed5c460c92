"""Events of a day made by hand, each at the instant that its closed form says."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from days import END, EPOCH, HIDDEN, RATE, day, zone
from wheels import INERTIA, random_wheels

import jaxplan as jp
from jaxplan.model.epochs import utc_stamps
from jaxplan.model.zones import KeepIn
from jaxplan.timeline.events import KINDS, events
from jaxplan.timeline.tables import activity_rows, clock, event_rows, events_table, stamps


def _times(found, kind, what=None):
    return [event.time for event in found if event.kind == kind and what in (None, event.what)]


def _passes(azimuth, elevation, radius):
    """Times at which the telescope is a radius from a place, all in deg."""
    share = np.cos(np.deg2rad(radius)) / np.cos(np.deg2rad(elevation))
    turned = np.deg2rad(azimuth) + np.arccos(share) * np.array([-1, 1])
    return turned / RATE


def test_slews_and_activities_begin_and_end_in_order():
    found = events(day())
    assert [event.time for event in found] == sorted(event.time for event in found)
    assert {event.kind for event in found} <= set(KINDS)
    assert _times(found, "slew_begins") == [0.0, 400.0]
    assert _times(found, "slew_ends") == [100.0, 500.0]
    assert _times(found, "activity_begins") == [120.0, 500.0]
    assert _times(found, "activity_ends") == [400.0, END]
    assert not any(event.what == "lost" for event in found)


def test_targets_set_and_rise_where_spans_of_all_that_hides_them_end():
    found = events(day())
    assert _times(found, "rises", "site") == [90.0, 650.0]
    assert _times(found, "sets", "site") == [450.0]
    assert all("in image" not in event.text for event in found if event.kind in ("rises", "sets"))


def test_devices_come_near_to_a_keep_out_zone_and_leave_it():
    found = events(day(zone("sun", 90, 20, 10)), near=np.deg2rad(15))
    near, left = _passes(90, 20, 25)
    np.testing.assert_allclose(_times(found, "zone_near", "sun"), near, atol=1e-5)
    np.testing.assert_allclose(_times(found, "zone_left", "sun"), left, atol=1e-5)
    assert not _times(events(day(zone("sun", 90, 20, 10))), "zone_near")


def test_each_zone_has_the_instant_of_its_least_margin():
    inside = KeepIn(
        name="link", direction=np.array([0.0, 0.0, 1.0]), half_angle=np.deg2rad(120.0), devices=("telescope",)
    )
    plan = day(zone("sun", 90, 20, 10), zone("moon", 205, -30, 5))
    place = replace(plan.timeline.scene, keep_in=(inside,))
    found = events(replace(plan, timeline=replace(plan.timeline, scene=place)))
    lowest = {event.what: event for event in found if event.kind == "least_margin"}
    assert set(lowest) == {"sun", "moon", "link"}
    np.testing.assert_allclose([lowest["sun"].time, lowest["moon"].time], [180.0, 410.0], atol=1e-3)
    assert "10.000 deg, of telescope" in lowest["sun"].text
    assert "30.000 deg" in lowest["link"].text


def test_a_target_that_is_seen_passes_through_the_cones_that_bind_its_device():
    zones = [
        zone("moon", 150, 5, 8),
        zone("hidden", 20, 0, 5),
        zone("other", 170, 0, 8, devices=("terminal-1",)),
    ]
    found = events(day(*zones))
    enters, leaves = _passes(150, 5, 8)
    np.testing.assert_allclose(_times(found, "outage_begins"), [enters], atol=0.01)  # it is above by 1e-3 deg
    np.testing.assert_allclose(_times(found, "outage_ends"), [leaves], atol=0.01)
    assert all("moon" in event.text for event in found if event.kind.startswith("outage"))
    assert len(_times(events(day(*zones, hidden=())), "outage_begins")) == 2


def test_targets_without_a_name_are_called_after_device_and_activity():
    unnamed = tuple(replace(span, target="target") for span in HIDDEN)
    found = events(day(hidden=unnamed))
    assert {event.what for event in found if event.kind == "sets"} == {"the target of telescope in image"}


def test_each_wheel_holds_its_most_once():
    bare = day().timeline.scene.spacecraft
    craft = replace(bare, inertia=INERTIA, wheels=random_wheels(4, 3))
    plan = day(craft=craft)
    peaks = {event.what: event for event in events(plan) if event.kind == "wheel_peak"}
    times = np.linspace(0, END, 20001)
    held = np.abs(jp.measures.wheel_momenta(plan.trajectory, craft, times))
    for number, wheel in enumerate(craft.wheels):
        time = peaks[wheel.name].time
        own = abs(jp.measures.wheel_momenta(plan.trajectory, craft, time)[number])
        assert own >= held[:, number].max() - 1e-9
        assert f"{own:.4g} of" in peaks[wheel.name].text


def test_a_plan_without_a_trajectory_has_no_events():
    assert events(replace(day(), trajectory=None, segments=(), activities=())) == ()


@pytest.mark.parametrize("near", [0.0, -1.0, np.nan, np.inf, "5"])
def test_a_wrong_distance_is_refused(near):
    with pytest.raises((TypeError, ValueError), match="near"):
        events(day(), near=near)


def test_only_plans_of_timelines_have_events():
    with pytest.raises(TypeError, match="plan_timeline"):
        events(day().timeline)


def test_stamps_are_in_utc_whatever_their_order():
    assert utc_stamps(EPOCH, [301.0, 0.0, 0.0004]) == [
        "2026-06-21T00:00:01.000",
        "2026-06-20T23:55:00.000",
        "2026-06-20T23:55:00.000",
    ]
    assert utc_stamps(EPOCH, []) == []


def test_stamps_have_the_date_unless_the_day_is_on_one():
    over, within = day(), day(epoch=np.datetime64("2026-06-20T09:30:00"))
    assert (clock(over), stamps(over, [0.0, None])) == ("UTC", ["2026-06-20 23:55:00.000", "\N{EN DASH}"])
    assert (clock(within), stamps(within, [61.5])) == ("UTC, 2026-06-20", ["09:31:01.500"])
    bare = day(epoch=None)
    assert (clock(bare), stamps(bare, [61.5])) == ("s", ["61.50"])


def test_rows_of_events_are_a_csv_file_and_the_table_has_a_line_each():
    plan = day(zone("sun", 90, 20, 10))
    found = events(plan)
    file = io.StringIO()
    csv.writer(file).writerows(event_rows(found, EPOCH))
    rows = list(csv.DictReader(io.StringIO(file.getvalue())))
    assert [float(row["time_s"]) for row in rows] == pytest.approx([event.time for event in found], abs=1e-6)
    assert [row["text"] for row in rows] == [event.text for event in found]
    assert rows[0]["utc"] == "2026-06-20T23:55:00.000"
    assert "utc" not in event_rows(found)[0]
    for epoch in (EPOCH, None):
        lines = events_table(found, epoch).splitlines()
        assert len(lines) == len(found) + 1
        assert all(line.endswith(event.text) for line, event in zip(lines[1:], found, strict=True))


def test_rows_of_activities_have_messages_where_there_are_any():
    head, *rows = activity_rows(day())
    assert head[-1] == "message"
    assert [row[0] for row in rows] == ["image", "lost", "rest"]
    assert all(len(row) == len(head) for row in rows)
    assert rows[1][2] == rows[1][3] == "\N{EN DASH}"
    assert activity_rows(day(), messages=False)[0] == head[:-1]
    plan = day()
    done = replace(plan, activities=(plan.activities[0],))
    assert activity_rows(done)[0][-1] == "status"
