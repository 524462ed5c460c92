"""Timelines from files: what they hold, all that is wrong with them at once, and what is written back."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.schema import (
    ScenarioError,
    dump_timeline,
    parse_scenario,
    parse_timeline,
    take_in_timeline,
    timeline_from_dict,
)
from jaxplan.schema.text import LARGEST_TIMELINE

pytest.importorskip("erfa")

FILE = """
schema_version = 1
kind = "timeline"
name = "a morning"
[timeline]
until_utc = 2026-06-20T10:00:00
object_name = "EO-1"
naif_id = -42
[spacecraft]
rate_limit_deg_s = 1.0
acceleration_limit_deg_s2 = 0.5
[[spacecraft.terminal]]
name = "antenna"
mount = { yaw_axis = [0, 0, 1], boresight = [1, 0, 0] }
yaw_range_deg = [-270, 270]
pitch_range_deg = [0, 85]
rate_limit_deg_s = 4
acceleration_limit_deg_s2 = 2
[[spacecraft.instrument]]
name = "telescope"
boresight = [0, 0, -1]
[[spacecraft.drive]]
name = "array"
axis = [0, 1, 0]
boresight = [0, 0, 1]
range_deg = [-180, 180]
rate_limit_deg_s = 0.5
acceleration_limit_deg_s2 = 0.1
[start]
attitude = [0, 0, 0]
joints_deg = {}
[sky]
epoch_utc = 2026-06-20T09:30:00
observer = { altitude_km = 550, inclination_deg = 97, ascending_node_deg = 233, argument_of_latitude_deg = 0 }
[[sky.ground]]
name = "lisbon"
latitude_deg = 38.72
longitude_deg = -9.14
[[keep_out]]
name = "sun"
body = "sun"
moving = true
half_angle_deg = 20
devices = ["telescope"]
[[activity]]
name = "look"
track = { telescope = "nadir" }
for_s = 12
from_utc = 2026-06-20T09:34:00
prefer = [{ device = "array", direction = "sun" }]
hold = ["antenna"]
[[activity]]
name = "snap"
point = { telescope = "nadir", antenna = [0, 0.6, 0.8] }
[[activity]]
name = "stow"
attitude = [0, 0, 0.1]
joints_deg = { antenna = [10, 45] }
for_s = 30
after = "look"
[[activity]]
name = "rest"
idle = true
"""
STILL = """
schema_version = 1
kind = "timeline"
name = "still"
[spacecraft]
rate_limit_deg_s = 1.0
acceleration_limit_deg_s2 = 0.5
[[spacecraft.instrument]]
name = "telescope"
boresight = [0, 0, 1]
[start]
attitude = [0, 0, 0]
[[activity]]
name = "star"
track = { telescope = [0, 0.6, 0.8] }
for_s = 5
"""


@pytest.fixture(scope="module")
def timeline():
    return parse_timeline(FILE)


def faults(*changes, text=FILE, read=parse_timeline):
    """All faults of the file with parts in the place of others."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(ScenarioError) as caught:
        read(text)
    return caught.value.faults


def test_a_file_becomes_activities_in_seconds_and_radians(timeline):
    look, snap, stow, rest = timeline.activities
    assert [one.kind for one in timeline.activities] == ["track", "point", "attitude", "idle"]
    assert (look.earliest, look.duration, look.latest) == (240.0, 12.0, None)
    assert timeline.until == 1800.0
    assert look.track.tolerance == np.deg2rad(0.01)
    assert snap.point.tolerance == np.deg2rad(1e-6)
    assert look.track.hold == ("antenna",)
    assert (stow.after, rest.after) == ("look", "")
    np.testing.assert_array_equal(stow.attitude.joints, np.deg2rad([10, 45, 0]))
    assert timeline.names == jp.ExportNames(object_name="EO-1", naif_id=-42)
    assert timeline.scene.epoch == np.datetime64("2026-06-20T09:30:00")


def test_names_follow_what_the_sky_has(timeline):
    look = timeline.activities[0]
    nadir, sun = look.track.directions[0], look.track.prefer[0].direction
    asked = {"epoch": timeline.scene.epoch, "observer": jp.sky.CircularOrbit(
        altitude=550.0, inclination=np.deg2rad(97), node=np.deg2rad(233), latitude=0.0)}  # fmt: skip
    for path, name in ((nadir, "nadir"), (sun, "sun")):
        for time in (0.0, 777.0, 1800.0):
            true = jp.sky.directions(name, times=time, **asked)
            np.testing.assert_allclose(path.at(time), true, rtol=0, atol=2e-9)


def test_a_name_is_computed_once_however_many_follow_it(timeline):
    look, snap, *_ = timeline.activities
    assert look.track.directions[0] is snap.point.directions[0]


def test_what_is_written_reads_back_the_same_without_the_sky(timeline):
    text = dump_timeline(timeline)
    tables = tomllib.loads(text)
    assert "sky" not in tables
    assert len(tables["direction"]) == 2
    again = parse_timeline(text)
    assert again == timeline
    assert dump_timeline(again) == text
    own, read = (one.activities[0].track.directions[0] for one in (timeline, again))
    np.testing.assert_array_equal(own.slopes, read.slopes)


def test_a_file_is_saved_and_loaded(timeline, tmp_path):
    jp.save_timeline(timeline, tmp_path / "day.toml")
    assert jp.load_timeline(tmp_path / "day.toml") == timeline
    with pytest.raises(ScenarioError, match=r"none\.toml: cannot be read"):
        jp.load_timeline(tmp_path / "none.toml")


def test_seconds_and_utc_are_the_same():
    given = FILE.replace("from_utc = 2026-06-20T09:34:00", "from_s = 240")
    given = given.replace("until_utc = 2026-06-20T10:00:00", "until_s = 1800")
    assert parse_timeline(given) == parse_timeline(FILE)


def test_a_leap_second_counts():
    late = FILE.replace("2026-06-20T09:30:00", "2016-12-31T23:50:00")
    late = late.replace("2026-06-20T09:34:00", "2017-01-01T00:00:00")
    late = late.replace("2026-06-20T10:00:00", "2017-01-01T00:20:00")
    read = parse_timeline(late)
    assert read.activities[0].earliest == 601.0
    assert read.until == 1801.0


def test_where_nothing_moves_no_end_need_be_told():
    still = parse_timeline(STILL)
    assert still.until is None
    assert still.scene.epoch is None
    assert dump_timeline(still) == dump_timeline(parse_timeline(dump_timeline(still)))


def test_a_scenario_reader_says_what_reads_a_timeline():
    told = faults(read=parse_scenario)
    meant = 'which has kind = "timeline", and which load_timeline and jaxplan timeline read'
    assert f"kind: is of a timeline, {meant}" in told


def test_all_faults_are_told_at_once():
    told = faults(
        ('name = "snap"', 'name = "look"'),
        ("for_s = 30", "for_s = 99999"),
        ('after = "look"', 'after = "lok"'),
        ("idle = true", "idle = true\ntolerance_deg = 0.1"),
    )
    assert told == (
        "activity[2].for_s = 99999: must lie in [0, 86400]",
        "activity[3].tolerance_deg: is of track or point, by which devices have targets",
        'activity[1].name = "look": the same as activity[0].name',
        'activity[2].after = "lok": no such activity, perhaps look is meant',
    )


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("[start]", "[goal]\ntargets = []\n[start]", "goal: a timeline has none: what devices point at"),
        ('kind = "timeline"', "", 'kind: missing, must be "timeline"'),
        ('kind = "timeline"', 'kind = "day"', 'kind = "day": must be "timeline"'),
        ("naif_id = -42", "naif_id = 42", "timeline.naif_id = 42: must lie in [-2147482, -1]"),
        (
            "naif_id = -42",
            'frame_name = "J2000"',
            'timeline.frame_name = "J2000": must be none of the frames',
        ),
        ("naif_id = -42", 'slew = "slow"', 'timeline.slew = "slow": must be "shortest" or "calm"'),
        ("naif_id = -42", "look_ahead = 1", "timeline.look_ahead = 1: must be true or false"),
        ("naif_id = -42", 'look_ahead = "yes"', 'timeline.look_ahead = "yes": must be true or false'),
        ("naif_id = -42", "look_ahed = true", "timeline.look_ahed: unknown key, perhaps look_ahead is meant"),
        ("naif_id = -42", "until_s = 3", "timeline.until_utc: stands in the place of until_s"),
        (
            'name = "snap"',
            'name = "rest until the end"',
            "is the name of the rest after all activities",
        ),
        ("idle = true", "", "activity[3].track: missing (or point, attitude, quaternion_wxyz, idle)"),
        ("idle = true", "idle = false", "activity[3].idle = false: must be true"),
        ("idle = true", "idle = true\ntrack = {}", "activity[3].idle: stands in the place of track"),
        ("attitude = [0, 0, 0.1]", "track = {}", "must name a device at least, and what it points at"),
        ("attitude = [0, 0, 0.1]", "idle = true", "activity[2].joints_deg: is of an attitude"),
        (
            "for_s = 30",
            "joint_rates_rad_s = [1]",
            "activity[2].joint_rates_rad_s: an attitude is held at rest",
        ),
        ("for_s = 30", "clearance_deg = 1", "activity[2].clearance_deg: is of goals, an activity has none"),
        ("for_s = 30", "from_s = 50\nuntil_s = 40", "activity[2].until_s: at 40 s, must not be before"),
        ("for_s = 30", "", "activity[2].for_s: missing (or activity[2].until_s), must be a number"),
        ("for_s = 12", "for_s = 12\nuntil_s = 250", "activity[0].for_s = 12.0: must be at most 10, the time"),
        (
            "T09:34:00",
            "T09:14:00",
            "must lie in [0, 86400] s from the epoch 2026-06-20T09:30:00 on, is at -960",
        ),
        ("T09:34:00", "T10:34:00", "activity[0].from_utc: at 3840 s, must not be after timeline.until_utc"),
        (
            "for_s = 30",
            "for_s = 1900",
            "activity[2].for_s = 1900.0: ends after timeline.until_utc, at 1800 s",
        ),
        (
            "antenna = [0, 0.6",
            "antena = [0, 0.6",
            "activity[1].point.antena: no such device, perhaps antenna",
        ),
        ('telescope = "nadir" }', 'telescope = "nadr" }', 'activity[0].track.telescope = "nadr": no such'),
        ('device = "array"', 'device = "telescope"', 'prefer[0].device = "telescope": has a target'),
        ('hold = ["antenna"]', 'hold = ["telescope"]', "activity[0].hold[0]"),
        ('name = "snap"', 'name = "snap"\nfor_s = 1', "activity[1].for_s = 1.0: is of what lasts"),
        (
            'after = "look"',
            'after = "stow"',
            'activity[2].after = "stow": comes after itself: stow after stow',
        ),
        (
            "[sky]",
            "[sky]\nfor_duration_s = 100",
            "sky.for_duration_s = 100.0: must be at least timeline.until_s",
        ),
        ("until_utc = 2026-06-20T10:00:00", "", "timeline.until_s: missing (or until_utc), must be a number"),
        (
            "until_utc = 2026-06-20T10:00:00",
            "until_s = 2026-06-20T10:00:00",
            "timeline.until_s = 2026-06-20 10:00:00: must be a number in [0, 86400]; until_utc takes a time",
        ),
        ("until_utc = 2026-06-20T10:00:00", "until_utc = 1800", "from 1972 to 2099; until_s takes seconds"),
    ],
)
def test_a_fault_names_key_value_and_what_it_must_be(old, new, fault):
    assert any(fault in told for told in faults((old, new)))


def test_circles_are_told_with_all_who_are_in_them():
    told = faults(
        ('name = "look"', 'name = "look"\nafter = "snap"'), ('name = "snap"', 'name = "snap"\nafter = "stow"')
    )
    assert told == ('activity[0].after = "snap": comes after itself: look after snap after stow after look',)


def test_utc_needs_an_epoch():
    told = faults(("for_s = 5", "for_s = 5\nfrom_utc = 2026-06-20T09:34:00"), text=STILL)
    assert told == ("activity[0].from_utc: needs the epoch, by [sky] or epoch_utc, from which seconds count",)


def test_names_need_the_sky():
    told = faults(("[0, 0.6, 0.8]", '"moon"'), text=STILL)
    assert told == ('activity[0].track.telescope = "moon": needs [sky], with epoch_utc and observer',)


def test_paths_by_name_are_followed_and_must_be_known_to_the_end():
    path = (
        '[[direction]]\nname = "comet"\ntimes_s = [0, 30, 60]\n'
        "direction_samples = [[0, 1, 0], [0, 0.96, 0.28], [0, 0.8, 0.6]]\n"
    )
    text = STILL.replace("[[activity]]", f"{path}[[activity]]").replace("[0, 0.6, 0.8]", '"comet"')
    assert faults(text=text) == (
        "timeline.until_s: missing, must be a number of seconds, since "
        "the target of telescope in activity star moves",
    )
    ends = text.replace("[spacecraft]", "[timeline]\nuntil_s = 61\n[spacecraft]")
    assert faults(text=ends) == (
        "timeline.until_s = 61.0: must be at most 60, until when "
        "the target of telescope in activity star is known",
    )
    read = parse_timeline(ends.replace("61", "60"))
    np.testing.assert_allclose(read.activities[0].track.directions[0].at(60.0), [0, 0.8, 0.6])
    assert faults(('"comet"', '"nadir"'), text=ends)[0].startswith('direction[0].name = "nadir": is that of')
    bent = faults(("0.96, 0.28", "-0.96, 0.28"), text=ends)
    assert len(bent) == 1
    assert "turns too far between the samples 0 and 1" in bent[0]


def test_where_something_moves_the_end_must_be_told(timeline):
    ending = tuple(replace(one, duration=one.duration or 1.0, point=None) for one in timeline.activities[::3])
    told = python_faults(timeline, activities=ending, until=None)
    assert told == ("until: missing, must be a number of seconds, since zone sun moves",)


def test_a_file_needs_an_activity_and_has_at_most_5000():
    tables = tomllib.loads(STILL)
    with pytest.raises(ScenarioError, match="activity: must have an activity at least"):
        timeline_from_dict(tables | {"activity": []})
    with pytest.raises(ScenarioError, match="5001 activities, more than the 5000"):
        timeline_from_dict(tables | {"activity": tables["activity"] * 5001})


def test_a_file_that_no_timeline_is_as_large_as_is_refused(tmp_path):
    (tmp_path / "day.toml").write_bytes(b" " * (LARGEST_TIMELINE + 1))
    with pytest.raises(ScenarioError, match="larger than 64 MiB, which no timeline is"):
        jp.load_timeline(tmp_path / "day.toml")


# Made in Python.


def python_faults(timeline, **changes):
    with pytest.raises(ScenarioError) as caught:
        take_in_timeline(replace(timeline, **changes))
    return caught.value.faults


def test_python_gives_lists_and_integers_and_gets_arrays_and_floats():
    still = parse_timeline(STILL)
    given = replace(
        still,
        scene=replace(still.scene, goal=None),
        activities=[jp.Activity(name="a", track=jp.Targets.of({"telescope": [0, 0, 1]}), duration=3)],
        until=10,
    )
    taken = take_in_timeline(given)
    (one,) = taken.activities
    assert isinstance(taken.activities, tuple)
    assert (type(one.duration), one.duration, type(taken.until)) == (float, 3.0, float)
    assert one.track.directions.dtype == float
    assert taken.scene.name == "still"
    assert take_in_timeline(taken) == taken


def test_a_path_that_many_follow_stays_one_object(timeline):
    look = timeline.activities[0]
    many = replace(
        timeline, activities=tuple(replace(look, name=f"{n}", earliest=20.0 * n) for n in range(20))
    )
    taken = take_in_timeline(many)
    assert len({id(one.track.directions[0]) for one in taken.activities}) == 1
    assert len(tomllib.loads(dump_timeline(many))["direction"]) == 2


def test_faults_of_python_name_attributes(timeline):
    look = timeline.activities[0]
    spinning = replace(timeline.scene.start, angular_velocity=[0, 0, 1.0])
    told = python_faults(
        timeline,
        slew="slow",
        activities=(
            replace(look, track=None),
            replace(look, name="two", idle=True, duration=-1.0),
            replace(look, name="far", track=replace(look.track, clearance=0.1)),
            jp.Activity(name="spin", attitude=spinning, duration=1.0),
        ),
    )
    assert told == (
        "activities[0]: must be one of track, point, attitude and idle, is none of them",
        "activities[1].duration = -1.0 s: must lie in [0, 86400]",
        "activities[1]: must be one of track, point, attitude and idle, is track and idle",
        "activities[2].track.clearance = 0.1 rad: is of goals, an activity has none",
        "activities[3].attitude.angular_velocity = [0.0, 0.0, 1.0]: must be zero, since it is held at rest",
        'slew = \'slow\': must be "shortest" or "calm"',
    )


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        (
            {"until": None},
            "activities[3].duration: missing (or activities[3].latest, until), must be a number",
        ),
        ({"until": 4000.0}, "until = 4000.0 s: must be at most 1800, until when zone sun is known"),
        ({"until": np.nan}, "until = nan s: must be finite and lie in [0, 86400]"),
        ({"scene": 4}, "scene = 4: must be a Scenario"),
        ({"look_ahead": 1}, "look_ahead = 1: must be true or false"),
        ({"look_ahead": None}, "look_ahead = None: must be true or false"),
        ({"names": 3}, "names = 3: must be ExportNames"),
        ({"name": ""}, "name = '': must not be empty"),
        ({"activities": ()}, "activities: must have an activity at least"),
        ({"activities": (3,)}, "activities[0] = 3: must be an Activity"),
    ],
)
def test_a_fault_of_python_names_attribute_value_and_range(timeline, changes, fault):
    assert fault in python_faults(timeline, **changes)


def test_an_activity_that_asks_for_nothing_is_not_called_idle():
    assert (jp.Activity(name="x").kind, jp.Activity(name="x", idle=True).kind) == ("none", "idle")


def test_what_is_no_timeline_is_a_type_error():
    with pytest.raises(TypeError, match="timeline must be a Timeline, not int"):
        take_in_timeline(3)


def test_targets_keep_their_names_in_files_that_are_written():
    day = parse_timeline(FILE)
    again = parse_timeline(dump_timeline(day))

    def names(timeline):
        return [[path.target for path in one.targets.paths] for one in timeline.activities if one.targets]

    assert names(day) == [["nadir"], ["nadir", ""]]
    assert names(again) == names(day)
    assert dump_timeline(again) == dump_timeline(day)


def test_a_path_of_ones_own_is_called_by_its_name_and_a_numbered_one_by_none():
    path = "times_s = [0, 30, 60]\ndirection_samples = [[0, 1, 0], [0, 0.96, 0.28], [0, 0.8, 0.6]]\n"
    found = {}
    for name, more in (("comet", ""), ("path-3", ""), ("path-4", 'target = "moonlet"\n')):
        text = STILL.replace("[[activity]]", f'[[direction]]\nname = "{name}"\n{more}{path}[[activity]]')
        text = text.replace("[0, 0.6, 0.8]", f'"{name}"')
        day = parse_timeline(text.replace("[spacecraft]", "[timeline]\nuntil_s = 60\n[spacecraft]"))
        found[name] = day.activities[0].targets.paths[0].target
    assert found == {"comet": "comet", "path-3": "", "path-4": "moonlet"}
