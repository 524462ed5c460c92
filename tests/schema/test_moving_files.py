"""Zones and targets that move in scenario files: read, written back the same, and every fault named."""

import re
import tomllib
from dataclasses import replace
from functools import reduce
from pathlib import Path

import jax
import numpy as np
import pytest
from builders import LOW_ORBIT, great_circle
from tables import ABSENT, put

import jaxplan as jp
from jaxplan import schema as sc
from jaxplan import sky
from jaxplan.model.directions import DirectionPath
from jaxplan.model.scenario import known_until, moves

TIMES = [0.0, 20.0, 40.0, 60.0, 80.5]
SAMPLES = great_circle(np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.1]), 0.001, np.array(TIMES)).tolist()
TABLES = {
    "schema_version": 1,
    "name": "moving",
    "spacecraft": {
        "rate_limit_deg_s": 3,
        "acceleration_limit_deg_s2": 2,
        "terminal": [
            {
                "name": name,
                "mount_deg": mount,
                "yaw_limit_deg": 90,
                "pitch_limit_deg": 60,
                "rate_limit_deg_s": 4,
                "acceleration_limit_deg_s2": 3,
            }
            for name, mount in (("fore", 0), ("aft", 180))
        ],
    },
    "start": {"attitude": [0, 0, 0], "yaw_deg": [0, 0], "pitch_deg": [0, 0]},
    "goal": {"targets": [{"direction_samples": SAMPLES, "times_s": TIMES}, [0, 0, 1]]},
    "keep_out": [{"name": "out", "direction_samples": SAMPLES, "times_s": TIMES, "half_angle_deg": 5}],
    "keep_in": [
        {
            "name": "in",
            "direction_samples": SAMPLES,
            "times_s": TIMES,
            "half_angle_deg": 90,
            "devices": ["aft"],
        }
    ],
    "trajectory": {"duration_s": 80},
}
LINK = {"altitude_km": 550, "inclination_deg": 53, "ascending_node_deg": 10, "argument_of_latitude_deg": 60}


def bits(scenario):
    return [np.asarray(leaf).tobytes() for leaf in jax.tree_util.tree_leaves(scenario)]


def changed(*changes):
    """The tables with values at places, such as ``("keep_out", 0, "times_s")``, changed or gone."""
    return reduce(lambda tables, change: put(tables, *change), changes, TABLES)


def test_samples_are_read_as_a_path_and_written_back_to_the_bit():
    read = sc.scenario_from_dict(TABLES)
    for path in (read.keep_out[0].direction, read.keep_in[0].direction, read.goal.directions[0]):
        assert isinstance(path, DirectionPath)
        np.testing.assert_array_equal(path.times, TIMES)
        np.testing.assert_allclose(path.samples, SAMPLES, atol=1e-15)
    assert read.goal.moves
    np.testing.assert_array_equal(read.goal.directions[1], [0, 0, 1])
    text = sc.dump_scenario(read)
    again = sc.parse_scenario(text)
    assert bits(again) == bits(read)
    assert again == read
    assert sc.dump_scenario(again) == text
    assert set(tomllib.loads(text)["keep_out"][0]) == {
        "name",
        "direction_samples",
        "times_s",
        "half_angle_deg",
    }


def test_a_scenario_at_an_instant_has_directions_of_then_and_nothing_that_moves():
    read = sc.scenario_from_dict(TABLES)
    assert moves(read)
    assert known_until(read) == (80.5, "the target of fore")
    then = read.constraints.at(33.0)
    assert not then.paths
    expected = great_circle(np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.1]), 0.001, np.array(33.0))
    np.testing.assert_allclose(then.axis[0], expected, atol=1e-9)
    np.testing.assert_allclose(read.goal.at(33.0).directions, [expected, [0, 0, 1]], atol=1e-9)
    rates = read.goal.rates(33.0)
    np.testing.assert_allclose(np.linalg.norm(rates, axis=1), [0.001, 0], atol=1e-9)
    still = sc.scenario_from_dict(
        changed(
            (("goal", "targets"), [[1, 0, 0], [0, 0, 1]]), (("keep_out",), ABSENT), (("keep_in",), ABSENT)
        )
    )
    assert still.constraints.at(33.0) is still.constraints
    assert still.goal.at(33.0) is still.goal
    with pytest.raises(ValueError, match=r"must lie in \[0, 80.5\] s"):
        read.goal.at(81.0)


def test_satellites_and_bodies_of_the_sky_become_paths_as_seen_from_the_observer():
    read = sc.load_scenario(LOW_ORBIT)
    here, ahead, east, west = (
        sky.CircularOrbit(
            altitude=550.0, inclination=np.deg2rad(53), node=np.deg2rad(node), latitude=np.deg2rad(latitude)
        )
        for node, latitude in ((10, 40), (10, 60), (25, 25), (-5, 31))
    )
    asked = {"epoch": "2026-03-20T12:00:00", "observer": here}
    times = np.linspace(0, 120, 50)
    pairs = [
        *zip(read.goal.directions, (ahead, west, east), strict=True),
        (read.keep_out[0].direction, "earth"),
        (read.keep_in[0].direction, ahead),
    ]
    for path, target in pairs:
        true = sky.directions(target, **asked, times=times)
        assert np.linalg.norm(path.at(times) - true, axis=1).max() <= 2e-9
    assert isinstance(read.keep_out[1].direction, np.ndarray)
    limb = sky.angular_radius("earth", **asked)
    assert read.keep_out[0].half_angle == pytest.approx(limb + np.deg2rad(3), abs=1e-10)
    text = sc.dump_scenario(read)
    assert "[sky]" not in text
    assert bits(sc.parse_scenario(text)) == bits(read)


OUT, TARGET = ("keep_out", 0), ("goal", "targets", 0)
NUMBERS = "must be rising numbers"


@pytest.mark.parametrize(
    ("place", "value", "fault"),
    [
        ((*OUT, "times_s"), ABSENT, f".times_s: missing, {NUMBERS}"),
        ((*OUT, "direction_samples"), ABSENT, ".times_s: needs direction_samples"),
        ((*OUT, "times_s"), [0, 20, 20, 60, 81], ".times_s[2] = 20.0: must be later than the one before, 20"),
        ((*OUT, "times_s"), [1, 20, 40, 60, 81], ".times_s[0] = 1.0: must be at most 0"),
        (
            (*OUT, "times_s"),
            [0, 20, 40, 81],
            ".times_s = [0, 20, 40, 81]: must be an array of 5 rising numbers, the first at most 0, not of 4",
        ),
        ((*OUT, "times_s"), [0, 20, 40, 60, 79], ".times_s: must reach trajectory.duration_s = 80"),
        ((*OUT, "times_s"), [0], ".times_s = [0]: must be an array of 5 rising numbers"),
        ((*OUT, "times_s"), 5, ".times_s = 5: must be an array of 5 rising numbers"),
        ((*OUT, "times_s", 1), "soon", '.times_s[1] = "soon": must be a number'),
        (
            (*OUT, "direction_samples", 3),
            [0, 0, 2],
            ".direction_samples[3] = [0, 0, 2]: must be a unit vector",
        ),
        (
            (*OUT, "direction_samples", 3),
            [0, 0, -1],
            ".direction_samples = (an array of 5): the direction turns",
        ),
        ((*OUT, "direction"), [0, 0, 1], ".direction_samples: stands in the place of direction"),
        ((*OUT, "moving"), True, ".moving = true: needs a body"),
        ((*OUT, "satellite"), "n", ".direction_samples: stands in the place of satellite"),
        ((*TARGET, "times_s"), ABSENT, ".times_s: missing"),
        ((*TARGET, "colour"), 1, ".colour: unknown key"),
        ((*TARGET, "times_s"), [0, 20, 40, 60, 70], ".times_s: must reach trajectory.duration_s"),
        (TARGET, "ahead", ' = "ahead": needs [sky]'),
        (TARGET, "hold", ' = "hold": is no direction: name a device that keeps its joints in goal.hold'),
        (TARGET, [0, 0, 3], " = [0, 0, 3]: must be a unit vector"),
    ],
)
def test_a_wrong_word_about_what_moves_is_named(place, value, fault):
    table = "keep_out[0]" if place[0] == "keep_out" else "goal.targets[0]"
    with pytest.raises(sc.ScenarioError) as caught:
        sc.scenario_from_dict(changed((place, value)))
    assert any(found.startswith(f"{table}{fault}") for found in caught.value.faults), caught.value.faults


def test_rates_at_a_goal_that_moves_are_not_given():
    with pytest.raises(sc.ScenarioError, match="follows from the targets, of which some"):
        sc.scenario_from_dict(changed((("goal", "angular_velocity_rad_s"), [0, 0, 0.1])))


def test_what_moves_must_be_known_when_the_manoeuvre_begins():
    early = (((*OUT, "times_s"), [-9, -8, -7, -6, -5]), (("trajectory", "duration_s"), "stretched"))
    with pytest.raises(sc.ScenarioError) as caught:
        sc.scenario_from_dict(changed(*early))
    assert caught.value.faults == ("keep_out[0].times_s: must reach from the start, 0, on, lies in [-9, -5]",)
    scenario = sc.scenario_from_dict(changed())
    path = scenario.keep_out[0].direction
    late = DirectionPath.through(path.times + 5, path.samples)
    zone = replace(scenario.keep_out[0], direction=late)
    with pytest.raises(
        ValueError, match=r"keep_out\[0\]\.direction\.times\[0\] = 5\.0 s: must be at most 0, where"
    ):
        jp.plan(replace(scenario, keep_out=(zone,)))


def test_the_papers_method_wants_a_number_of_seconds_where_something_moves():
    for settings in ({"method": "paper"}, {"method": "paper", "duration_s": "stretched"}):
        with pytest.raises(sc.ScenarioError, match="must be a number of seconds with trajectory"):
            sc.scenario_from_dict(changed((("trajectory",), settings)))
    assert sc.scenario_from_dict(changed((("trajectory", "method"), "paper"))).trajectory.method == "paper"


AHEAD = 'satellite = "ahead"'


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('"west", "east"', '"west", "south"', 'goal.targets[2] = "south": no such satellite'),
        (
            AHEAD,
            'satellite = "aheat"',
            'keep_in[0].satellite = "aheat": no such satellite or ground point, perhaps ahead',
        ),
        (AHEAD, 'satellite = "earth"', 'keep_in[0].satellite = "earth": no such satellite'),
        ('name = "west"', 'name = "moon"', 'sky.satellite[2].name = "moon": must be unique, and no body'),
        ('name = "west"', 'name = "east"', 'sky.satellite[2].name = "east": must be unique, and no body'),
        ("for_duration_s = 120", "for_duration_s = 60", "sky.for_duration_s = 60.0: must be at least"),
        ("for_duration_s = 120\n", "", None),
        ("duration_s = 80.0", 'duration_s = "minimum"', None),
        ("latitude_deg = 60 }", "latitude_deg = 40 }", 'keep_in[0].satellite = "ahead": target and observer'),
        ("moving = true", "moving = 1", "keep_out[0].moving = 1: must be true or false"),
        ("inclination_deg = 53", "inclination_deg = 200", "sky.observer.inclination_deg = 200: must lie in"),
    ],
)
def test_a_wrong_word_about_satellites_is_named(old, new, fault):
    text = LOW_ORBIT.read_text()
    assert old in text
    text = text.replace(old, new, 1)
    if fault is None:
        assert moves(sc.parse_scenario(text))
        return
    with pytest.raises(sc.ScenarioError) as caught:
        sc.parse_scenario(text)
    assert caught.value.faults[0].startswith(fault), caught.value.faults


def test_a_zone_about_a_body_stands_still_unless_it_is_to_move():
    text = LOW_ORBIT.read_text().replace("moving = true\n", "")
    assert isinstance(sc.parse_scenario(text).keep_out[0].direction, np.ndarray)
    text = LOW_ORBIT.read_text().replace("moving = true", "moving = false")
    assert isinstance(sc.parse_scenario(text).keep_out[0].direction, np.ndarray)


def test_two_line_elements_make_targets_too():
    pytest.importorskip("erfa", reason="pyerfa is not installed")
    pytest.importorskip("sgp4", reason="sgp4 is not installed")
    one = "1 25544U 98067A   24079.07757601  .00016717  00000-0  30270-3 0  9992"
    two = "2 25544  51.6400 208.9163 0006317  69.9862  25.2906 15.49560532444998"
    satellite = {"name": "station", "orbit": {"tle": [one, two]}}
    given = {"epoch_utc": "2024-03-20T03:06:00", "observer": LINK, "satellite": [satellite]}
    read = sc.scenario_from_dict(changed((("sky",), given), (("goal", "targets", 1), "station")))
    here = sky.CircularOrbit(
        altitude=550.0, inclination=np.deg2rad(53), node=np.deg2rad(10), latitude=np.deg2rad(60)
    )
    asked = {"epoch": "2024-03-20T03:06:00", "observer": here, "times": np.linspace(0, 80, 30)}
    true = sky.directions(sky.parse_tle(f"{one}\n{two}"), **asked)
    assert np.linalg.norm(read.goal.directions[1].at(asked["times"]) - true, axis=1).max() < 2e-9


def test_the_pages_file_is_read():
    page = (Path(__file__).parents[2] / "docs" / "sky.md").read_text()
    chapter = page[page.index("## Moving targets and zones") : page.index("## Ground targets, lines")]
    (toml,) = re.findall(r"```toml\n(.*?)```", chapter, re.DOTALL)
    text = LOW_ORBIT.read_text()
    read = sc.parse_scenario(f"{text[: text.index('[goal]')]}{toml}\n[trajectory]\nduration_s = 80\n")
    kinds = [isinstance(target, DirectionPath) for target in read.goal.directions]
    assert kinds == [True, True, False]
    assert all(isinstance(zone.direction, DirectionPath) for zone in (*read.keep_out, *read.keep_in))
