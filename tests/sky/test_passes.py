"""Passes beside lines of sight that are asked at every second, and places by the Earth's own angles."""

import json
import re

import numpy as np
import pytest

import jaxplan as jp
from jaxplan import sky
from jaxplan.cli import main

erfa = pytest.importorskip("erfa", reason="pyerfa is not installed")

EPOCH = "2026-06-20T09:30:00"
LOW = sky.CircularOrbit(altitude=600.0, inclination=1.7, node=0.2, latitude=1.0)
RELAY = sky.CircularOrbit(altitude=35786.0, inclination=0.0, node=0.0, latitude=2.0)
OSLO = sky.GroundPoint(
    latitude=np.deg2rad(59.91), longitude=np.deg2rad(10.75), minimum_elevation=np.deg2rad(10)
)
DAY = 86400.0
AIR = 100.0  # km


def elevations(times):
    """Of the observer above Oslo's horizon, rad: the Earth's angle of rotation, without its small motions."""
    here = sky.positions(LOW, epoch=EPOCH, times=times)
    turned = erfa.era00(2400000.5, 61211.0 + (9.5 * 3600 + times) / DAY) + OSLO.longitude
    flat, height = np.cos(OSLO.latitude), np.full(len(times), np.sin(OSLO.latitude))
    up = np.stack([flat * np.cos(turned), flat * np.sin(turned), height], axis=-1)
    normal = 6378.137 / np.sqrt(1 - 0.00669437999 * np.sin(OSLO.latitude) ** 2)
    place = up * normal - np.array([0, 0, 0.00669437999 * normal * np.sin(OSLO.latitude)])
    toward = here - place
    return np.arcsin(np.sum(toward * up, axis=-1) / np.linalg.norm(toward, axis=-1))


def inside(found, times):
    """Whether times lie in a pass, and whether they are not within two seconds of an end."""
    starts, ends = (np.array([getattr(one, name) for one in found])[:, None] for name in ("start", "end"))
    within = np.any((starts <= times) & (times <= ends), axis=0)
    return within, np.all(np.abs(np.concatenate([starts, ends]) - times) > 2, axis=0)


def test_a_place_is_seen_while_the_observer_is_high_enough():
    found = sky.passes(OSLO, epoch=EPOCH, observer=LOW, duration_s=2 * DAY, name="oslo")
    times = np.arange(0.0, 2 * DAY, 1.0)
    high = elevations(times)
    within, sure = inside(found, times)
    # The Earth's precession, which is left out above, moves its axis by 0.15 deg since J2000.
    clear = np.abs(high - OSLO.minimum_elevation) > np.deg2rad(0.8)
    np.testing.assert_array_equal(within[sure & clear], high[sure & clear] > OSLO.minimum_elevation)
    assert len(found) >= 8
    for one in found:
        own = (one.start <= times) & (times <= one.end)
        assert one.elevation == pytest.approx(np.max(high[own]), abs=np.deg2rad(0.8))
        assert one.start <= one.best <= one.end
        assert (one.target, one.duration) == ("oslo", one.end - one.start)


def test_the_best_instant_is_the_highest_or_the_nearest():
    asked = {"epoch": EPOCH, "observer": LOW, "duration_s": DAY}
    for thing in (OSLO, RELAY):
        for one in sky.passes(thing, **asked):
            times = np.append(np.linspace(one.start, one.end, 2001), one.best)
            here, there = (sky.positions(each, epoch=EPOCH, times=times) for each in (LOW, thing))
            distance = np.linalg.norm(there - here, axis=-1)
            off = np.arccos(
                np.sum(-here * (there - here), axis=-1) / distance / np.linalg.norm(here, axis=-1)
            )
            assert one.distance == pytest.approx(distance[-1], rel=1e-12)
            assert one.off_nadir == pytest.approx(off[-1], abs=1e-7)
            if thing is RELAY:
                assert one.elevation is None
                assert distance[-1] <= np.min(distance) * (1 + 1e-12)
            else:  # over the ground what is nearest is highest but for the Earth's turn
                assert distance[-1] <= np.min(distance) + 2


def test_passes_are_what_is_left_of_hidden_spans():
    moon = sky.occulter("moon", RELAY, radius_km=1500.0)
    other = sky.CircularOrbit(altitude=42000.0, inclination=0.0, node=0.0, latitude=2.4)  # is overtaken
    asked = {"epoch": EPOCH, "observer": LOW, "duration_s": DAY, "atmosphere_km": AIR, "occulters": [moon]}
    spans = sky.hidden(other, **asked)
    found = sky.passes(other, **asked)
    assert len({span.by for span in spans}) == 2  # they overlap and follow each other
    times = np.arange(0.0, DAY, 1.0)
    within, sure = inside(found, times)
    hidden = np.any([(span.start <= times) & (times <= span.end) for span in spans], axis=0)
    np.testing.assert_array_equal(within[sure], ~hidden[sure])


def test_what_never_sets_is_one_pass_and_what_never_rises_none():
    behind = sky.CircularOrbit(altitude=600.0, inclination=1.7, node=0.2, latitude=0.9)
    (whole,) = sky.passes(behind, epoch=EPOCH, observer=LOW, duration_s=DAY)
    assert (whole.start, whole.end) == (0.0, DAY)
    opposite = sky.CircularOrbit(altitude=600.0, inclination=1.7, node=0.2, latitude=1.0 + np.pi)
    assert sky.passes(opposite, epoch=EPOCH, observer=LOW, duration_s=DAY) == ()


@pytest.mark.parametrize(
    ("changed", "kind", "said"),
    [
        ({"thing": "moon"}, TypeError, "thing must be a satellite or a GroundPoint, not 'moon'"),
        ({"observer": [7000.0, 0, 0]}, TypeError, "observer must be a satellite, not"),
        ({"duration_s": 0.0}, ValueError, "duration_s = 0.0: must lie in (0, 2678400]"),
        ({"duration_s": np.nan}, ValueError, "duration_s = nan: must"),
        ({"atmosphere_km": -1.0}, ValueError, "atmosphere_km = -1.0: must lie in [0, 1000]"),
    ],
)
def test_bad_input_is_named(changed, kind, said):
    asked = {"thing": OSLO, "epoch": EPOCH, "observer": LOW, "duration_s": DAY} | changed
    with pytest.raises(kind, match=re.escape(said)):
        sky.passes(asked.pop("thing"), **asked)


def test_the_command_line_lists_them_in_their_order(capsys):
    assert main(["passes", "case-imaging", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    found = told["passes"]
    assert [one["from_s"] for one in found] == sorted(one["from_s"] for one in found)
    seen = jp.load_sky(jp.cases.case_path("case-imaging"))
    assert told["for_s"] == seen.duration
    (first, *_) = seen.passes("oslo")
    (same, *_) = [one for one in found if one["target"] == "oslo"]
    assert (same["from_s"], same["elevation_deg"]) == (first.start, np.rad2deg(first.elevation))
    stamp = np.datetime64(same["best_utc"]) - seen.epoch
    assert stamp / np.timedelta64(1, "s") == pytest.approx(first.best, abs=1e-3)
    assert main(["passes", "case-imaging", "oslo", "kiruna", "--for", "7000"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split()[0] == "target"
    assert [row.split()[0] for row in rows] == ["kiruna", "oslo"]
    assert len({len(line) for line in (head, *rows)}) == 1  # columns line up
    assert main(["passes", "case-imaging", "oslo", "--for", "60"]) == 0
    assert capsys.readouterr().out == "never seen in 60 s: oslo\n"


def test_a_window_that_is_printed_lies_within_the_pass(capsys):
    assert main(["passes", "case-imaging", "oslo", "--for", "7000"]) == 0
    row = capsys.readouterr().out.splitlines()[1].split()
    seen = jp.load_sky(jp.cases.case_path("case-imaging"))
    (one, *_) = seen.passes("oslo")
    start, end = (
        (np.datetime64(f"{day}T{clock}") - seen.epoch) / np.timedelta64(1, "s")
        for day, clock in (row[1:3], row[3:5])
    )
    assert one.start <= start < one.start + 1
    assert one.end - 1 < end <= one.end


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["case-1"], "sky: missing, must say epoch_utc and observer"),
        (["case-imaging", "bergen"], "bergen: no such target, the names are svalbard, oslo"),
        (["case-imaging", "--for", "1e8"], "--for 1e+08: must lie in (0, 2678400] s, which is 31 days"),
        (["nowhere.toml"], "nowhere.toml: no such file; it must have [sky]"),
    ],
)
def test_the_command_line_names_what_is_wrong(arguments, said, capsys):
    assert main(["passes", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_a_sky_that_is_wrong_is_told_whole(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text('[sky]\nepoch_utc = "soon"\nobserver = { altitude_km = 1e6 }\n')
    with pytest.raises(jp.ScenarioError, match=r"(?s)sky\.epoch_utc.*sky\.observer\.altitude_km"):
        jp.load_sky(file)
    with pytest.raises(KeyError, match="must be one of svalbard"):
        jp.load_sky(jp.cases.case_path("case-imaging")).passes("bergen")
