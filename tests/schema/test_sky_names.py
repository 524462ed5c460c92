"""What names of ``[sky]`` stand for in files: ground points, directions, orbits, and what hides targets."""

import re
import tomllib
from dataclasses import replace
from functools import reduce
from pathlib import Path

import jax
import numpy as np
import pytest
from builders import LOW_ORBIT
from tables import ABSENT, put

import jaxplan as jp
from jaxplan import schema as sc
from jaxplan import sky
from jaxplan.model.directions import DirectionPath
from jaxplan.model.hidden_spans import Hidden
from jaxplan.schema.reading import take_in

pytest.importorskip("erfa", reason="pyerfa is not installed")

EPOCH = "2026-06-20T09:30:00"
KEPLER = {
    "semi_major_axis_km": 6900,
    "eccentricity": 0.01,
    "inclination_deg": 97.5,
    "ascending_node_deg": 220,
    "argument_of_perigee_deg": 90,
    "true_anomaly_deg": 0,
}
HERE = sky.KeplerOrbit(
    semi_major_axis=6900.0,
    eccentricity=0.01,
    **dict(
        zip(
            ("inclination", "node", "perigee", "anomaly"),
            np.deg2rad([97.5, 220, 90, 0]).tolist(),
            strict=True,
        )
    ),
)
CIRCLE = {
    "altitude_km": 700,
    "inclination_deg": 97.5,
    "ascending_node_deg": 220,
    "argument_of_latitude_deg": 120,
}
AHEAD = sky.CircularOrbit(
    altitude=700.0, inclination=np.deg2rad(97.5), node=np.deg2rad(220), latitude=np.deg2rad(120)
)
LISBON = sky.GroundPoint(
    latitude=np.deg2rad(38.72), longitude=np.deg2rad(-9.14), altitude=100.0, minimum_elevation=np.deg2rad(5)
)
TERMINAL = {
    "mount_deg": 0,
    "yaw_limit_deg": 180,
    "pitch_limit_deg": 80,
    "rate_limit_deg_s": 4,
    "acceleration_limit_deg_s2": 3,
}
TABLES = {
    "schema_version": 1,
    "name": "named",
    "spacecraft": {
        "rate_limit_deg_s": 3,
        "acceleration_limit_deg_s2": 2,
        "terminal": [{"name": name, **TERMINAL} for name in ("antenna", "link")],
    },
    "start": {"attitude": [0, 0, 0], "yaw_deg": [0, 0], "pitch_deg": [0, 0]},
    "goal": {"targets": ["lisbon", "ahead"]},
    "sky": {
        "epoch_utc": EPOCH,
        "for_duration_s": 1500,
        "atmosphere_km": 100,
        "observer": KEPLER,
        "satellite": [{"name": "ahead", "orbit": CIRCLE}],
        "ground": [
            {
                "name": "lisbon",
                "latitude_deg": 38.72,
                "longitude_deg": -9.14,
                "altitude_m": 100,
                "minimum_elevation_deg": 5,
            }
        ],
        "occulter": [{"name": "moon"}, {"name": "ahead", "radius_km": 0.05}],
    },
    "keep_out": [{"name": "down", "direction": "nadir", "half_angle_deg": 30, "devices": ["link"]}],
    "keep_in": [
        {"name": "over", "satellite": "lisbon", "half_angle_deg": 90, "devices": ["antenna"]},
        {"name": "shade", "direction": "sun", "half_angle_deg": 170, "devices": ["antenna"]},
    ],
    "trajectory": {"duration_s": 80},
}


def changed(*changes):
    """The tables with values at places changed or gone."""
    return reduce(lambda tables, change: put(tables, *change), changes, TABLES)


def faults_of(*changes, **more):
    with pytest.raises(sc.ScenarioError) as caught:
        sc.scenario_from_dict(changed(*changes), **more)
    return caught.value.faults


def test_names_become_paths_as_seen_from_the_observer():
    read = sc.scenario_from_dict(TABLES)
    asked = {"epoch": EPOCH, "observer": HERE, "times": np.linspace(0, 1500, 400)}
    paths = [
        *zip(read.goal.directions, (LISBON, AHEAD), strict=True),
        (read.keep_out[0].direction, "nadir"),
        (read.keep_in[0].direction, LISBON),
        (read.keep_in[1].direction, "sun"),
    ]
    for path, thing in paths:
        assert np.linalg.norm(path.at(asked["times"]) - sky.directions(thing, **asked), axis=1).max() < 3e-9


@pytest.mark.parametrize("name", [*sky.LOCAL, *sky.BODIES])
def test_directions_and_bodies_are_targets_that_nothing_hides(name):
    read = sc.scenario_from_dict(changed((("goal", "targets", 0), name)))
    path = read.goal.directions[0]
    assert path.hidden == ()
    expected = sky.directions(name, epoch=EPOCH, observer=HERE, times=[0.0, 700.0])
    np.testing.assert_allclose(path.at([0.0, 700.0]), expected, atol=2e-9)


def test_targets_are_read_with_when_they_are_hidden_and_zones_without():
    read = sc.scenario_from_dict(TABLES)
    asked = {"epoch": EPOCH, "observer": HERE, "duration_s": 1500.0, "atmosphere_km": 100.0}
    station, moon = sky.occulter("ahead", AHEAD, radius_km=0.05), sky.occulter("moon")
    ground, satellite = (path.hidden for path in read.goal.directions)
    assert ground == sky.hidden(LISBON, name="lisbon", occulters=[moon, station], **asked)
    assert [(span.target, span.by) for span in ground] == [("lisbon", "its horizon")] * 2
    assert satellite == sky.hidden(AHEAD, name="ahead", occulters=[moon], **asked)
    assert {span.by for span in satellite} <= {"the Earth"}
    assert read.keep_in[0].direction.hidden == ()


def test_what_was_resolved_is_written_and_read_back_to_the_bit(tmp_path):
    first = sc.scenario_from_dict(TABLES)
    sc.save_scenario(first, tmp_path / "resolved.toml")
    written = tomllib.loads((tmp_path / "resolved.toml").read_text())
    assert "sky" not in written
    spans = [written["goal"]["targets"][0]["hidden"][i] for i in range(2)]
    assert [set(span) for span in spans] == [{"target", "by", "from_s", "to_s"}] * 2
    again = sc.load_scenario(tmp_path / "resolved.toml")
    leaves = [[np.asarray(leaf).tobytes() for leaf in jax.tree_util.tree_leaves(s)] for s in (first, again)]
    assert leaves[0] == leaves[1]
    assert first == again
    assert [path.hidden for path in again.goal.directions] == [path.hidden for path in first.goal.directions]


def test_a_scenario_whose_targets_are_hidden_at_other_times_is_another():
    first, other = sc.scenario_from_dict(TABLES), sc.scenario_from_dict(TABLES)
    assert first == other
    without = sc.scenario_from_dict(changed((("sky", "ground", 0, "minimum_elevation_deg"), 4)))
    assert first != without
    assert jp.Scenario(**vars(first)) == first


def observer_of(told, folder=""):
    """The path to nadir, and so the observer's, of a file whose observer is told so."""
    return sc.scenario_from_dict(changed((("sky", "observer"), told)), folder=folder).keep_out[0].direction


SAMPLED = np.arange(0, 1501, 60.0)


def test_an_observer_may_be_samples_over_times_and_so_may_a_satellite():
    own, moving = (of(HERE, epoch=EPOCH, times=SAMPLED).tolist() for of in (sky.positions, sky.velocities))
    usual = observer_of(KEPLER).at(SAMPLED + 0.0)
    told = {"position_samples_km": own, "times_s": SAMPLED.tolist(), "frame": "EME2000"}
    for more in ({}, {"velocity_samples_km_s": moving}):
        np.testing.assert_allclose(observer_of(told | more).at(SAMPLED), usual, atol=2e-9)
    other = sky.positions(AHEAD, epoch=EPOCH, times=SAMPLED[:20] * 2).tolist()
    orbit = {"position_samples_km": other, "times_s": (2 * SAMPLED[:20]).tolist()}
    read = sc.scenario_from_dict(changed((("sky", "satellite", 0, "orbit"), orbit)))
    expected = sky.directions(AHEAD, epoch=EPOCH, observer=HERE, times=SAMPLED)
    np.testing.assert_allclose(read.goal.directions[1].at(SAMPLED), expected, atol=1e-7)


def test_an_ephemeris_is_looked_for_beside_the_scenario(tmp_path):
    pytest.importorskip("ccsds_ndm", reason="ccsds-ndm-py is not installed")
    rows = zip(
        np.datetime64(EPOCH, "s") + SAMPLED.astype(int),
        *(of(HERE, epoch=EPOCH, times=SAMPLED).tolist() for of in (sky.positions, sky.velocities)),
        strict=True,
    )
    states = "\n".join(f"{date} {' '.join(map(repr, [*place, *speed]))}" for date, place, speed in rows)
    (tmp_path / "orbits").mkdir()
    (tmp_path / "orbits" / "mine.oem").write_text(
        "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-06-20T00:00:00\nORIGINATOR = TEST\nMETA_START\n"
        "OBJECT_NAME = EO-1\nOBJECT_ID = 2026-001A\nCENTER_NAME = EARTH\nREF_FRAME = EME2000\n"
        f"TIME_SYSTEM = UTC\nSTART_TIME = {EPOCH}\nSTOP_TIME = 2026-06-20T09:55:00\nMETA_STOP\n{states}\n"
    )
    told = {"ephemeris": "orbits/mine.oem"}
    tables = changed((("sky", "observer"), told))
    text = "\n".join(f"{key} = {_inline(value)}" for key, value in tables.items())
    (tmp_path / "scene.toml").write_text(text)
    expected = observer_of(KEPLER).at(SAMPLED)
    read = sc.load_scenario(tmp_path / "scene.toml").keep_out[0].direction
    np.testing.assert_allclose(read.at(SAMPLED), expected, atol=2e-9)
    np.testing.assert_array_equal(observer_of(told, tmp_path).samples, read.samples)
    (fault,) = faults_of((("sky", "observer"), told))
    assert fault == 'sky.observer.ephemeris = "orbits/mine.oem": cannot be read: No such file or directory'
    (tmp_path / "short.oem").write_text("CCSDS_OEM_VERS = 2.0\n")
    (fault,) = faults_of(
        (("sky", "observer", "ephemeris"), "short.oem"),
        (("sky", "observer"), {"ephemeris": "short.oem"}),
        folder=tmp_path,
    )
    assert re.search(r'ephemeris = "short.oem": .*short.oem: no Orbit Ephemeris Message', fault)
    (fault,) = faults_of((("sky", "observer"), told), (("sky", "for_duration_s"), 1600), folder=tmp_path)
    assert re.match(r"sky.observer: ephemeris of EO-1: asked for .* is known in \[34200, 35700\] s", fault)


def _inline(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_inline(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


GROUND, ORBIT = ("sky", "ground", 0), ("sky", "observer")
SAMPLES = {"position_samples_km": [[7000, 0, 0], [7000, 400, 0], [7000, 800, 0], [6900, 1200, 0]]}


@pytest.mark.parametrize(
    ("place", "value", "fault"),
    [
        ((*GROUND, "latitude_deg"), 91, "sky.ground[0].latitude_deg = 91: must lie in [-90, 90]"),
        ((*GROUND, "longitude_deg"), ABSENT, "sky.ground[0].longitude_deg: missing, must be a number"),
        ((*GROUND, "altitude_m"), 1e6, "sky.ground[0].altitude_m = 1000000.0: must lie in [-1000, 100000]"),
        ((*GROUND, "minimum_elevation_deg"), 90, "sky.ground[0].minimum_elevation_deg = 90: must lie in"),
        ((*GROUND, "altitude_km"), 1, "sky.ground[0].altitude_km: unknown key, perhaps altitude_m is meant"),
        ((*GROUND, "name"), "ahead", 'sky.ground[0].name = "ahead": must be unique, and no body'),
        ((*GROUND, "name"), "nadir", 'sky.ground[0].name = "nadir": must be unique, and no body'),
        (
            ("goal", "targets", 0),
            "lisbom",
            'goal.targets[0] = "lisbom": no such satellite, ground point, body',
        ),
        (("keep_out", 0, "direction"), "up", 'keep_out[0].direction = "up": no such satellite, ground'),
        (
            ("keep_in", 0, "satellite"),
            "ram",
            'keep_in[0].satellite = "ram": no such satellite or ground point',
        ),
        (("sky", "occulter", 0, "name"), "earth", 'sky.occulter[0].name = "earth": the Earth hides targets'),
        (("sky", "occulter", 0, "name"), "mars", 'sky.occulter[0].name = "mars": no such satellite or body'),
        (("sky", "occulter", 0, "name"), "lisbon", 'sky.occulter[0].name = "lisbon": no such satellite'),
        (("sky", "occulter", 1, "radius_km"), ABSENT, "sky.occulter[1].radius_km: missing, since that of a"),
        (
            ("sky", "occulter", 1, "name"),
            "moon",
            'sky.occulter[1].name = "moon": the same as sky.occulter[0].name',
        ),
        (("sky", "occulter", 1, "radius_km"), 0, "sky.occulter[1].radius_km = 0: must lie in (0, 1e6]"),
        (("sky", "atmosphere_km"), 500, 'goal.targets[1] = "ahead": observer: '),
        ((*ORBIT, "eccentricity"), 1, "sky.observer.eccentricity = 1: must lie in [0, 1)"),
        (
            (*ORBIT, "eccentricity"),
            0.2,
            "sky.observer.semi_major_axis_km = 6900.0: with this eccentricity the",
        ),
        ((*ORBIT, "true_anomaly_deg"), ABSENT, "sky.observer.true_anomaly_deg: missing, must be a number"),
        ((*ORBIT, "altitude_km"), 500, "sky.observer: semi_major_axis_km, eccentricity, argument_of"),
        ((*ORBIT, "ephemeris"), "a.oem", "sky.observer: semi_major_axis_km, eccentricity, inclin"),
        (ORBIT, {"ephemeris": 3}, "sky.observer.ephemeris = 3: must be the path of an Orbit Ephemeris"),
        (ORBIT, SAMPLES, "sky.observer.times_s: missing, must be rising numbers"),
        (ORBIT, SAMPLES | {"times_s": [0, 60, 60, 180]}, "sky.observer.times_s[2] = 60.0: must be later"),
        (
            ORBIT,
            SAMPLES | {"times_s": [0, 60, 120]},
            "sky.observer.times_s = [0, 60, 120]: must be an array of 4",
        ),
        (
            ORBIT,
            SAMPLES | {"times_s": [0, 60, 120, 180]},
            "sky.observer: ephemeris: asked for 1500 s after the",
        ),
        (
            ORBIT,
            SAMPLES | {"times_s": [0, 60, 120, 180], "frame": "ITRF"},
            'sky.observer.frame = "ITRF": must be "GCRS"',
        ),
        (
            ORBIT,
            {"position_samples_km": [[7000, 0, 0], [0, 7000, 0]] * 2, "times_s": [0, 60, 120, 180]},
            "sky.observer.position_samples_km: positions[1]: is 90 deg from the one before",
        ),
        (
            ORBIT,
            {"position_samples_km": [[3.9e6, -3.95e6, 3.7e6]] * 4, "times_s": [0, 60, 120, 180]},
            "sky.observer.position_samples_km[0][0] = 3900000.0: must lie in [-3000000, 3000000]",
        ),
    ],
)
def test_a_wrong_word_about_the_sky_is_named(place, value, fault):
    found = faults_of((place, value))
    assert found[0].startswith(fault), found


def test_all_wrong_words_about_a_sky_that_nothing_uses_are_named():
    unused = [
        (("goal", "targets"), [[1, 0, 0], [0, 1, 0]]),
        (("keep_out",), ABSENT),
        (("keep_in",), ABSENT),
        (("sky", "for_duration_s"), ABSENT),
        (("trajectory", "duration_s"), "minimum"),
    ]
    sc.scenario_from_dict(changed(*unused))
    occulters = [{"name": "mars"}, {"name": "earth"}, {"name": "moon"}, {"name": "moon"}, {"name": "ahead"}]
    found = faults_of(*unused, ((*GROUND, "name"), "sun"), (("sky", "occulter"), occulters))
    assert [fault.split(" = ")[0].split(": ")[0] for fault in found] == [
        "sky.ground[0].name",
        "sky.occulter[0].name",
        "sky.occulter[1].name",
        "sky.occulter[4].radius_km",
        "sky.occulter[3].name",
    ]


@pytest.mark.parametrize(
    ("value", "fault"),
    [
        (
            {"target": "a", "by": "b", "from_s": 5, "to_s": 5},
            "hidden[0].to_s = 5.0: must be later than goal.targets",
        ),
        ({"target": "a", "by": "b", "from_s": 5}, "hidden[0].to_s: missing"),
        ({"by": "b", "from_s": 5, "to_s": 6}, "hidden[0].target: missing"),
    ],
)
def test_a_wrong_word_about_when_a_target_is_hidden_is_named(value, fault):
    path = {"direction_samples": [[1, 0, 0], [0.96, 0.28, 0]], "times_s": [0, 80], "hidden": [value]}
    (found,) = faults_of((("goal", "targets", 0), path))
    assert found.startswith(f"goal.targets[0].{fault}")


def test_python_may_say_when_a_target_is_hidden():
    path = DirectionPath.through([0, 80], [[1, 0, 0], [0.96, 0.28, 0]])
    span = Hidden(target="a", by="b", start=5, end=9)
    scenario = sc.scenario_from_dict(changed((("goal", "targets"), [[1, 0, 0], [0, 1, 0]])))
    goal = replace(scenario.goal, directions=(replace(path, hidden=(span,)), np.array([0.0, 1.0, 0.0])))
    read = take_in(replace(scenario, goal=goal))
    assert read.goal.directions[0].hidden == (span,)


def test_the_pages_examples_run(capsys):
    page = (Path(__file__).parents[2] / "docs" / "sky.md").read_text()
    chapter = page[page.index("## Ground targets, lines") : page.index("## Ephemeris kernels")]
    (toml,), (code,) = (
        re.findall(rf"```{kind}\n(.*?)```", chapter, re.DOTALL) for kind in ("toml", "python")
    )
    text = LOW_ORBIT.read_text()
    read = sc.parse_scenario(f"{text[: text.index('[goal]')]}{toml}\n[trajectory]\nduration_s = 80\n")
    assert [bool(path.hidden) for path in read.goal.directions] == [False, True, False]
    assert read.keep_out[0].moves
    exec(code, {"np": np, "jp": jp})
    until, since = map(int, re.search(r"# until (\d+) s, from (\d+) s on", code).groups())
    printed = capsys.readouterr().out
    assert printed.startswith(f"[(0, {until}, 'its horizon'), ({since}, 1500, 'its horizon')]")
