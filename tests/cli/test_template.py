"""The file that a new scenario begins with: it is planned as it is, and says all that a file may hold."""

import re
import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.planner.validity import start_breaches
from jaxplan.schema import parse_scenario, parse_timeline
from jaxplan.schema.layout import SCENARIO
from jaxplan.schema.tables import Either, Rows, Table
from jaxplan.schema.text import template
from jaxplan.schema.timelines import TIMELINE, timeline_template

OPTION = re.compile(r"#(?=[\w\[])")


@pytest.fixture(scope="module")
def text():
    return template()


@pytest.fixture(scope="module")
def scene(text):
    return parse_scenario(text)


def options(text):
    """The numbers of the lines of each option: a line, or all of a block whose header is one."""
    first = 0
    for block in text.split("\n\n"):
        lines = block.split("\n")
        own = [first + number for number, line in enumerate(lines) if OPTION.match(line)]
        if any(line.startswith("#[") for line in lines):
            yield own
        else:
            yield from ([number] for number in own)
        first += len(lines) + 1


def taken(text, numbers):
    """The text with some of its options taken into use."""
    lines = text.split("\n")
    for number in numbers:
        lines[number] = lines[number].removeprefix("#")
    return "\n".join(lines)


@pytest.fixture(scope="module")
def day():
    return timeline_template()


def tables(table=SCENARIO):
    """The tables of a file."""
    yield table
    for field in table.fields:
        if isinstance(field.kind, Rows):
            yield from tables(field.kind.table)
        elif isinstance(field.kind, Either):
            yield from field.kind.tables.values()
        elif isinstance(field.kind, Table):
            yield from tables(field.kind)


@pytest.mark.slow
def test_a_new_scene_is_planned_although_a_zone_is_in_the_way(scene):
    plan = jp.plan(scene, progress=False)
    assert plan.ok
    (sun,) = scene.keep_out
    (tracker,) = (device for device in scene.spacecraft.instruments if device.name == "star-tracker")
    turn = Rotation.from_matrix(plan.goal.attitude).as_rotvec()  # the start is the identity
    np.testing.assert_array_equal(scene.start.rotation_vector, 0)
    straight = Rotation.from_rotvec(np.linspace(0, 1, 201)[:, None] * turn).apply(tracker.boresight)
    assert np.arccos(straight @ sun.direction).min() < sun.half_angle - np.deg2rad(5)


def test_a_new_scene_says_what_the_shortest_motion_is_and_by_how_much_it_is_shorter(text, scene):
    words = " ".join(text.replace("\n# ", " ").split())
    assert 'duration_s = "minimum" looks for the shortest motion' in words
    assert "1.75 times the strict bound" in words
    assert "here it is a quarter shorter" in words
    shortest = parse_scenario(text.replace('#duration_s = "stretched"', 'duration_s = "minimum"'))
    calm, quick = (jp.plan(one, progress=False) for one in (scene, shortest))
    assert calm.trajectory.duration == pytest.approx(1.75 * calm.duration_bound, rel=0.02)
    assert quick.ok
    assert quick.trajectory.duration == pytest.approx(0.75 * calm.trajectory.duration, rel=0.1)


def test_every_option_of_a_new_scene_holds_by_itself_and_with_all_others(text):
    found = list(options(text))
    assert len(found) > 30
    assert sum(len(numbers) > 1 for numbers in found) == 9
    for numbers in found:
        assert tomllib.loads(taken(text, numbers)) != tomllib.loads(text)
        parse_scenario(taken(text, numbers))
    whole = parse_scenario(taken(text, [number for numbers in found for number in numbers]))
    assert len(whole.keep_out) == 6
    assert start_breaches(whole) == ()


def test_options_show_the_defaults_of_their_settings(text, scene):
    shown = [numbers for numbers in options(text) if len(numbers) == 1]
    same = [text.split("\n")[number] for (number,) in shown if parse_scenario(taken(text, [number])) == scene]
    for table in (settings for settings in tables() if settings.model.__name__.endswith("Settings")):
        for field in table.fields:
            if table.defaults()[field.attribute] not in (None, {}) and not field.always:
                assert any(line.startswith(f"#{field.key} = ") for line in same), field.key


def test_a_new_scene_says_of_every_key_what_it_may_be(text):
    words = " ".join(re.sub(r"\n +#", " ", text).split())
    seen = 0
    for table in tables():
        for field in table.fields:
            assert re.search(rf"\b{field.key}\b", words), field.key
            lines = re.findall(rf"^#?{field.key} = .*(?:\n +# .*)*", text, re.MULTILINE)
            above = re.findall(rf"^((?:# .*\n)+)#?{field.key} = ", text, re.MULTILINE)
            told = [" ".join(re.sub(r"\n *#", " ", line).split()) for line in lines + above]
            if told and field.kind.range is not None:
                assert any(f" in {field.kind.range}" in line for line in told), field.key
                seen += 1
    assert seen > 30


def test_every_option_of_a_new_timeline_holds_by_itself_and_with_all_others(day):
    pytest.importorskip("erfa")
    start = re.sub(
        r"targets = (?:.*\n)(?: +#.*\n)*", "attitude = [0, 0, 0]\n", day, count=1
    )  # found in no time
    assert start != day
    found = list(options(start))
    assert len(found) > 10
    for numbers in found:
        assert tomllib.loads(taken(start, numbers)) != tomllib.loads(start)
        parse_timeline(taken(start, numbers))
    whole = parse_timeline(taken(start, [number for numbers in found for number in numbers]))
    assert whole.names.naif_id == -2042
    assert whole.activities[0].track.tolerance == np.deg2rad(0.01)


def test_a_new_timeline_says_of_every_key_of_its_own_what_it_may_be(day):
    words = " ".join(re.sub(r"\n +#", " ", day).split())
    own = {"timeline", "activity", "direction"}
    for name, table in ((field.key, field.kind) for field in TIMELINE.fields if field.key in own):
        for field in getattr(table, "table", table).fields:
            angles = name == "activity" and field.key.startswith(
                ("yaw_", "pitch_", "drive_")
            )  # as a start has them
            assert angles or field.key == "hidden" or re.search(rf"\b{field.key}\b", words), field.key


@pytest.mark.slow
def test_a_new_timeline_is_planned(day):
    plan = jp.plan_timeline(parse_timeline(day), progress=False)
    assert plan.ok
    assert [one.name for one in plan.activities] == ["strip", "star", "snapshot", "stow", "rest"]
    assert plan.trajectory.duration == pytest.approx(1800.0)
