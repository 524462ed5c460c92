"""Zones about bodies in scenario files, and the manual's page on the sky."""

import re
import tomllib
import warnings
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxplan as jp
from jaxplan import schema as sc
from jaxplan import sky
from jaxplan.cli import main
from jaxplan.schema.orbits import LowOrbitWarning
from jaxplan.sky import frames
from jaxplan.tuning.parameters import find_number

pytest.importorskip("erfa", reason="pyerfa is not installed")

PAGE = (Path(__file__).parents[2] / "docs" / "sky.md").read_text()
ORBIT = (
    "altitude_km = 500.0, inclination_deg = 97.4, ascending_node_deg = 20, argument_of_latitude_deg = 57.0"
)
ONE = "1 25544U 98067A   24079.07757601  .00016717  00000-0  30270-3 0  9992"
TWO = "2 25544  51.6400 208.9163 0006317  69.9862  25.2906 15.49560532444998"
FILE = f"""
schema_version = 1
name = "under the sky"
[spacecraft]
rate_limit_deg_s = 3
acceleration_limit_deg_s2 = 2
instrument = [{{ name = "star-tracker", boresight = [0, 0, 1] }}]
[start]
attitude = [0, 0, 0]
[goal]
attitude = [0, 0, 1]
[sky]
epoch_utc = "2024-03-20T03:06:00"
atmosphere_km = 100
observer = {{ {ORBIT} }}
[[keep_out]]
name = "sunlight"
body = "sun"
exclusion_deg = 30
devices = ["star-tracker"]
[[keep_out]]
name = "galaxy"
direction = [0, 0.6, 0.8]
half_angle_deg = 5
[[keep_out]]
name = "air"
body = "earth"
exclusion_deg = 0
[[keep_out]]
name = "moonlight"
body = "moon"
half_angle_deg = 12.5
[trajectory]
duration_s = 80
"""


def faults_of(*changes):
    """The faults of the file after parts of its text are replaced."""
    text = FILE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(sc.ScenarioError) as caught:
        sc.parse_scenario(text)
    return caught.value.faults


@pytest.mark.parametrize(
    ("observer", "satellite"),
    [
        (f"{{ {ORBIT} }}", {"inclination": 97.4, "node": 20.0, "latitude": 57.0}),
        (f'{{ tle = ["{ONE}", "{TWO}"] }}', None),
    ],
    ids=["circular", "two lines"],
)
def test_a_zone_about_a_body_is_read_as_the_sky_has_it(observer, satellite):
    if satellite is None:
        pytest.importorskip("sgp4", reason="sgp4 is not installed")
        here = sky.parse_tle(f"{ONE}\n{TWO}")
    else:
        here = sky.CircularOrbit(
            altitude=500.0, **{key: np.deg2rad(angle) for key, angle in satellite.items()}
        )
    read = sc.parse_scenario(FILE.replace(f"{{ {ORBIT} }}", observer)).keep_out
    asked = {"epoch": "2024-03-20T03:06:00", "observer": here, "for_duration_s": 80.0, "atmosphere_km": 100.0}
    expected = {
        "sunlight": sky.keep_out("sun", exclusion_deg=30.0, **asked),
        "air": sky.keep_out("earth", exclusion_deg=0.0, **asked),
        "moonlight": sky.keep_out("moon", half_angle_deg=12.5, **asked),
    }
    assert [zone.name for zone in read] == ["sunlight", "galaxy", "air", "moonlight"]
    assert [zone.devices for zone in read] == [("star-tracker",), (), (), ()]
    for zone in read:
        if zone.name in expected:
            np.testing.assert_allclose(zone.direction, expected[zone.name].direction, atol=1e-12)
            assert zone.half_angle == pytest.approx(expected[zone.name].half_angle, abs=1e-11)
    assert read[1].half_angle == np.deg2rad(5)


def test_what_was_resolved_is_written_and_read_back_to_the_bit(tmp_path):
    first = sc.parse_scenario(FILE)
    sc.save_scenario(first, tmp_path / "resolved.toml")
    written = tomllib.loads((tmp_path / "resolved.toml").read_text())
    assert "sky" not in written
    assert all({"direction", "half_angle_deg"} <= row.keys() for row in written["keep_out"])
    again = sc.load_scenario(tmp_path / "resolved.toml")
    leaves = [[np.asarray(leaf).tobytes() for leaf in jax.tree_util.tree_leaves(s)] for s in (first, again)]
    assert leaves[0] == leaves[1]
    assert first == again


def test_an_epoch_may_be_a_date_time_of_toml():
    for text in ("2024-03-20T03:06:00", "2024-03-20T03:06:00Z", "2024-03-20 05:06:00+02:00"):
        assert sc.parse_scenario(FILE.replace('"2024-03-20T03:06:00"', text)) == sc.parse_scenario(FILE)
    of_the_day = (FILE.replace('"2024-03-20T03:06:00"', text) for text in ("2024-03-20", '"2024-03-20"'))
    assert {sc.parse_scenario(text).epoch for text in of_the_day} == {np.datetime64("2024-03-20", "ns")}


def test_the_epoch_of_the_sky_stays_when_it_is_resolved_and_one_may_stand_alone():
    epoch = np.datetime64("2024-03-20T03:06:00.25", "ns")
    seen = sc.parse_scenario(FILE.replace("03:06:00", "03:06:00.25"))
    assert seen.epoch == epoch
    assert sc.scenario_to_dict(seen)["epoch_utc"] == "2024-03-20T03:06:00.25"
    for text in (sc.dump_scenario(seen), f"epoch_utc = 2024-03-20T03:06:00.25\n{sc.dump_scenario(bare())}"):
        assert sc.parse_scenario(text).epoch == epoch
    assert bare().epoch is None
    assert "epoch_utc" not in sc.dump_scenario(bare())


def test_two_epochs_that_differ_are_a_fault():
    same, other = (f'epoch_utc = "2024-03-20T{time}:00"\n{FILE}' for time in ("03:06", "03:07"))
    assert sc.parse_scenario(same) == sc.parse_scenario(FILE)
    with pytest.raises(sc.ScenarioError, match=r'epoch_utc = "2024-03-20T03:07:00": is not that of \[sky\]'):
        sc.parse_scenario(other)


def bare():
    """The scenario of the file without its time."""
    return replace(sc.parse_scenario(FILE), epoch=None)


def test_zones_hold_for_the_trajectorys_duration_or_longer():
    halves = {}
    for text in ("", "for_duration_s = 80\n", "for_duration_s = 160\n"):
        halves[text] = sc.parse_scenario(FILE.replace("atmosphere_km", f"{text}atmosphere_km")).keep_out[2]
    short, same, long = (np.rad2deg(zone.half_angle) for zone in halves.values())
    assert short == same
    assert 2 < long - short < 3  # 5 deg in 80 s, half of it to either side


EPOCH_FAULT = "must be a time in UTC such as 2026-01-01T00:00:00, from 1972 to 2099"


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('"2024-03-20T03:06:00"', '"soon"', f'sky.epoch_utc = "soon": {EPOCH_FAULT}'),
        ('"2024-03-20T03:06:00"', "2024", f"sky.epoch_utc = 2024: {EPOCH_FAULT}"),
        (
            '"2024-03-20T03:06:00"',
            "2124-03-20T00:00:00",
            f"sky.epoch_utc = 2124-03-20 00:00:00: {EPOCH_FAULT}",
        ),
        ("atmosphere_km = 100", "atmosphere_km = -1", "sky.atmosphere_km = -1: must lie in [0, 1000]"),
        ("atmosphere_km", "height_km", "sky.height_km: unknown key, the keys are"),
        (
            "observer =",
            "for_duration_s = 40\nobserver =",
            "sky.for_duration_s = 40.0: must be at least trajectory.d",
        ),
        (
            "duration_s = 80",
            'duration_s = "minimum"',
            "sky.for_duration_s: missing, must be a number of seconds",
        ),
        ("altitude_km = 500.0", "altitude_km = 0", "sky.observer.altitude_km = 0: must lie in (0, 150000]"),
        (
            "altitude_km = 500.0",
            "altitude_km = 600000",
            "sky.observer.altitude_km = 600000: must lie in (0, 150000]: it is in km; higher orbits have "
            "semi_major_axis_km instead",
        ),
        ("altitude_km = 500.0, ", "", "sky.observer.altitude_km: missing, must be a number in (0, 150000]"),
        (f"{{ {ORBIT} }}", '"iss"', 'sky.observer = "iss": must be a table'),
        (ORBIT, 'tle = "25544"', 'sky.observer.tle = "25544": must be an array of the two lines'),
        (ORBIT, f'tle = ["{ONE}", "{TWO[:-1]}3"]', "sky.observer.tle: line 2, column 69 (check sum) = 3"),
        (
            ORBIT,
            f'tle = ["{ONE}", "{TWO}"], altitude_km = 9',
            "sky.observer.altitude_km: the satellite has a tle",
        ),
        ('body = "moon"', 'body = "mars"', 'keep_out[3].body = "mars": must be "sun", "moon" or "earth"'),
        (
            'body = "moon"',
            'direction = [0, 0, 1]\nbody = "moon"',
            "keep_out[3].body: stands in the place of direction",
        ),
        ("half_angle_deg = 12.5", "", "keep_out[3].half_angle_deg: missing (or exclusion_deg)"),
        (
            "half_angle_deg = 12.5",
            "exclusion_deg = 180",
            "keep_out[3].exclusion_deg = 180: must lie in [0, 180)",
        ),
        (
            "half_angle_deg = 5",
            "exclusion_deg = 5",
            "keep_out[1].exclusion_deg = 5.0: needs a body, from whose limb",
        ),
        (
            "exclusion_deg = 0",
            "exclusion_deg = 110",
            'keep_out[2].body = "earth": exclusion_deg = 110.0: with the',
        ),
    ],
)
def test_a_wrong_word_about_the_sky_is_the_one_fault(old, new, fault):
    found = faults_of((old, new))
    assert len(found) == 1
    assert found[0].startswith(fault)


def test_a_body_needs_the_sky_and_all_faults_come_at_once():
    without = FILE[: FILE.index("[sky]")] + FILE[FILE.index("[[keep_out]]") :]
    with pytest.raises(sc.ScenarioError) as caught:
        sc.parse_scenario(without.replace("rate_limit_deg_s = 3", "rate_limit_deg_s = -3"))
    words = "needs [sky], with epoch_utc and observer"
    assert caught.value.faults == (
        "spacecraft.rate_limit_deg_s = -3: must lie in [1e-6, 1e6]",
        f'keep_out[0].body = "sun": {words}',
        f'keep_out[2].body = "earth": {words}',
        f'keep_out[3].body = "moon": {words}',
    )


def test_elements_of_another_year_are_a_fault_of_the_observer():
    pytest.importorskip("sgp4", reason="sgp4 is not installed")
    (fault,) = faults_of((ORBIT, f'tle = ["{ONE}", "{TWO}"]'), ("2024-03-20", "2026-03-20"))
    assert re.match(r"sky\.observer: two-line elements: 25544: 731\.1 days from the elements' epoch", fault)


def test_a_file_that_needs_an_absent_extra_says_so(monkeypatch):
    resolved = sc.dump_scenario(sc.parse_scenario(FILE))

    def absent(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(frames, "import_module", absent)
    assert faults_of() == tuple(
        f"keep_out[{i}].body = \"{body}\": pyerfa is missing: pip install 'jaxplan[orbit]'"
        for i, body in ((0, "sun"), (3, "moon"))
    )
    assert len(sc.parse_scenario(resolved).keep_out) == 4  # which needs no ephemeris


def test_what_was_resolved_is_no_number_to_tune():
    scenario = sc.parse_scenario(FILE)
    assert find_number(scenario, "keep_out[0].half_angle_deg").get(scenario) > 30
    for name, words in {
        "sky.atmosphere_km": "sky is used when a file is read",
        "sky.observer.altitude_km": "sky is used when a file is read",
        "keep_out[0].exclusion_deg": "exclusion_deg is held as half_angle_deg",
    }.items():
        with pytest.raises(KeyError, match=words):
            find_number(scenario, name)


def test_the_pages_examples_run(capsys):
    chapter = PAGE[PAGE.index("## The real sky") : PAGE.index("## Moving targets and zones")]
    (code,) = re.findall(r"```python\n(.*?)```", chapter, re.DOTALL)
    exec(code, {"np": np, "jp": jp})
    printed = capsys.readouterr().out.split()
    said = [float(word) for word in re.search(r"# ([\d.]+) and ([\d.]+)", code).groups()]
    assert [round(float(word), 1) for word in printed[:2]] == said
    (toml,) = re.findall(r"```toml\n(.*?)```", chapter, re.DOTALL)
    start = FILE[: FILE.index("[sky]")]
    zones = sc.parse_scenario(f"{start}{toml}\n[trajectory]\nduration_s = 80\n").keep_out
    assert [zone.name for zone in zones] == ["sun", "earth"]


def test_an_orbit_in_air_is_warned_of_and_one_above_it_is_not(tmp_path, capsys):
    airless = FILE.replace("atmosphere_km = 100\n", "")
    low = airless.replace("altitude_km = 500.0", "altitude_km = 20.0")
    with pytest.warns(LowOrbitWarning, match=r"sky\.observer\.altitude_km: the orbit goes down to 20 km"):
        sc.parse_scenario(low)
    ellipse = ORBIT.replace("altitude_km = 500.0", "semi_major_axis_km = 6900.0, eccentricity = 0.07")
    ellipse = ellipse.replace(
        "argument_of_latitude_deg = 57.0", "argument_of_perigee_deg = 0, true_anomaly_deg = 0"
    )
    with pytest.warns(LowOrbitWarning, match=r"semi_major_axis_km: the orbit goes down to 38\.863 km"):
        sc.parse_scenario(airless.replace(ORBIT, ellipse))
    sc.parse_scenario(FILE)  # of which a warning would be an error
    (tmp_path / "low.toml").write_text(low)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert main(["validate", str(tmp_path / "low.toml")]) in (0, 1)
    told = capsys.readouterr().err
    assert told.startswith(
        "jaxplan: warning: sky.observer.altitude_km: the orbit goes down to 20 km, and below"
    )
    assert "orbits.py" not in told
