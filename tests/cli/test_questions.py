"""The scenario file that `jaxplan new --ask` makes of answers."""

import io
import re
import sys
import tomllib

import numpy as np
import pytest

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.cli.questions import value_of
from jaxplan.model.epochs import ephemeris_time
from jaxplan.schema import dump_scenario, parse_scenario
from jaxplan.schema.directions import Axis
from jaxplan.schema.text import commented
from jaxplan.schema.value_kinds import Choice, Epoch, Names, Number, Text, YesNo

EPOCH = "2024-03-19T02:00:00"
TLE = """1 25544U 98067A   24079.07757601  .00016717  00000-0  30270-3 0  9992
2 25544  51.6400 208.9163 0006317  69.9862  25.2906 15.49560532444998"""
SMALL = [  # a camera, no joints, no sky, one zone, a goal by a target
    *["small", "rates", "2 2 1", "0.5"],
    *["1", "camera", "0.6 0 0.8"],
    *["0", "0", "30", "no"],
    *["1", "lamp", "0, 1, 0", "25", "camera"],
    *["attitude", "0 0 0.5"],
    *["targets", "-z"],
]
LARGE = [
    *["large", "wheels", "[[12, 0, 0], [0, 10, 0.5], [0, 0.5, 9]]", "4"],
    *["", "", "0.02", "1.5", "0.1"],
    *["", "", "", "", "0"] * 3,
    *["1.5", ""],
    *["2", "camera", "z", "star tracker", "0 0.8 -0.6"],
    *["1", "laser", "z", "x", "-90 270", "", "5", ""],
    *["1", "array", "y", "-z", "", "", ""],
    *["minimum"],
    *["yes", "2026-03-20T12:00:00", "circular", "", "", "30", "40", "500"],
    *["3", "sun", "", "35", "no", "camera, star tracker"],
    *["moon", "", "", "", "star tracker", "earth", "limb", "5", "yes", "star tracker"],
    *["quaternion", "0.8 0 -0.6 0", "10 20", "-30"],
    *["targets", "0.36 0.48 0.8", "orbit_normal", "", ""],
]


def ask(monkeypatch, capsys, answers: list[str], *words: object) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in answers)))
    code = main(["new", "--ask", *map(str, words)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_answers_become_the_scenario_that_they_say(monkeypatch, capsys, tmp_path):
    file = tmp_path / "small.toml"
    code, out, err = ask(monkeypatch, capsys, SMALL, file)
    assert (code, out) == (0, "")
    assert err.splitlines()[-2:] == [
        f"{file}: ok: 1 instrument, 1 keep-out zone; the start keeps all limits and zones",
        f"wrote {file}; plan it with: jaxplan plan {file} -o out",
    ]
    scene = jp.load_scenario(file)
    assert (scene.name, scene.trajectory.duration) == ("small", 30.0)
    assert np.allclose(scene.spacecraft.rate_limit, np.deg2rad([2, 2, 1]), rtol=1e-15)
    assert scene.spacecraft.acceleration_limit == np.deg2rad(0.5)
    assert np.allclose(scene.spacecraft.instruments[0].boresight, [0.6, 0, 0.8])
    (zone,) = scene.keep_out
    assert (zone.name, zone.devices, zone.half_angle) == ("lamp", ("camera",), np.deg2rad(25))
    assert np.array_equal(zone.direction, [0, 1, 0])
    assert np.array_equal(scene.start.rotation_vector, [0, 0, 0.5])
    assert np.array_equal(scene.goal.directions, [[0, 0, -1]])
    assert scene.goal.devices == ("camera",)
    assert ask(monkeypatch, capsys, SMALL, "-")[:2] == (0, file.read_text())  # as on stdout


def test_wheels_joints_bodies_and_orbits_are_asked_for_too(monkeypatch, capsys, tmp_path):
    file = tmp_path / "large.toml"
    code, _, err = ask(monkeypatch, capsys, LARGE, file)
    assert code == 0, err
    assert "4 reaction wheels, 3 keep-out zones" in err
    scene = jp.load_scenario(file)
    craft = scene.spacecraft
    assert [wheel.torque for wheel in craft.wheels] == [0.02] * 4  # what was said of the first holds on
    assert [wheel.stored for wheel in craft.wheels] == [0.1, 0, 0, 0]
    axes = np.array([wheel.axis for wheel in craft.wheels])
    assert np.allclose(axes.T @ axes, 4 / 3 * np.eye(3), atol=1e-9)  # a pyramid that knows no axis
    most = np.sum(np.abs(axes), axis=0) * 0.02 / np.diag(craft.inertia)
    assert np.allclose(craft.acceleration_limit, 1.5 * most, rtol=0.05)  # so that the wheels are the limit
    terminal, drive = craft.terminals[0], craft.drives[0]
    assert np.allclose(np.rad2deg(terminal.yaw_range), [-90, 270])
    assert np.isclose(terminal.rate_limits[0], np.deg2rad(5))
    assert np.array_equal(drive.boresight, [0, 0, -1])
    assert np.allclose(np.rad2deg(scene.start.joints), [10, 20, -30])
    w, x, y, z = 0.8, 0.0, -0.6, 0.0  # written out from the definition of a unit quaternion
    turned = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    assert np.allclose(scene.start.attitude, turned, atol=1e-12)
    assert scene.goal.devices == ("laser", "array")
    sun, moon, earth = scene.keep_out
    assert (sun.name, moon.name, earth.name) == ("sun", "moon", "limb")
    assert earth.moves
    assert not sun.moves
    assert not moon.moves
    when = {"epoch": "2026-03-20T12:00:00", "for_duration_s": 500.0}
    orbit = jp.sky.CircularOrbit(
        altitude=550.0, inclination=np.deg2rad(97.6), node=np.deg2rad(30), latitude=np.deg2rad(40)
    )
    known = jp.sky.keep_out("sun", exclusion_deg=35.0, observer=orbit, **when)
    assert np.allclose(sun.direction, known.direction)
    assert np.isclose(sun.half_angle, known.half_angle)


def test_orbits_come_from_elements_lines_or_files_beside_the_scenario(monkeypatch, capsys, tmp_path):
    spice = pytest.importorskip("spiceypy", reason="spiceypy is not installed")
    lines = TLE.splitlines()
    times = np.arange(0.0, 1800.0, 60.0)
    when = {"epoch": EPOCH, "times": times}
    tle = jp.sky.parse_tle(TLE)
    states = np.concatenate([of(tle, **when) for of in (jp.sky.positions, jp.sky.velocities)], axis=1)
    moments = ephemeris_time(np.datetime64(EPOCH, "ns"), times)
    folder = tmp_path / "scenes"
    folder.mkdir()
    handle = spice.spkopn(str(folder / "own.bsp"), "test", 0)
    spice.spkw13(handle, -999, 399, "J2000", moments[0], moments[-1], "own", 7, len(times), states, moments)
    spice.spkcls(handle)
    before = SMALL[: SMALL.index("30") + 1]
    rest = ["1", "earth", "", "5", "yes", "camera", "attitude", "0 0 0", "targets", "zenith"]
    found = []
    for orbit in (
        ["tle", lines[0], lines[1]],
        ["spk", "own.bsp", "-999"],
        ["elliptic", "6800", "", "51.6", "0", "0", "0"],
    ):
        answers = [*before, "yes", EPOCH, *orbit, *rest, "no"]
        code, _, err = ask(monkeypatch, capsys, answers, folder / "scene.toml", "--force")
        assert code == 0, err
        found.append(jp.load_scenario(folder / "scene.toml").keep_out[0].direction)
    np.testing.assert_allclose(found[0].at(15.0), found[1].at(15.0), atol=1e-7)
    wrong = [lines[0], lines[1][:-1] + str((int(lines[1][-1]) + 1) % 10)]
    again = ["yes", "", "", *["", lines[1]]]
    answers = [*before, "yes", EPOCH, "tle", *wrong, *again, *rest, "no"]
    code, _, err = ask(monkeypatch, capsys, answers, folder / "scene.toml", "--force")
    assert code == 0, err
    assert "sky.observer.tle: line 2, column 69 (check sum)" in " ".join(err.split())


def test_a_file_of_answers_tells_of_each_key_and_keeps_what_was_said(monkeypatch, capsys):
    code, text, _ = ask(monkeypatch, capsys, LARGE, "-")
    assert code == 0
    keys = re.findall(r"^(\w+) = ", text, re.MULTILINE)
    for key in set(keys):  # where it stands first, beside it or above
        first = text[: text.index(f"\n{key} = ")].splitlines()[-1]
        line = text[text.index(f"\n{key} = ") + 1 :].partition("\n")[0]
        assert "# " in line or first.startswith("# "), key
    assert tomllib.loads(text)["keep_out"][1]["body"] == "moon"
    options = [line for line in text.splitlines() if re.match(r"#\w+ = ", line)]
    assert len(options) > 20  # of the settings, with their defaults
    switched_on = re.sub(r"^#(?=\w+ = )", "", text, flags=re.MULTILINE)
    one, other = parse_scenario(text), parse_scenario(switched_on)  # with every default written out
    assert dump_scenario(one) == dump_scenario(other)


def test_a_wrong_answer_is_told_as_a_file_is_and_asked_for_again(monkeypatch, capsys, tmp_path):
    wrong = {
        3: ["0", "a lot"],  # accelerations
        6: ["0 0 2", "1 0"],  # a boresight
        10: ["perhaps"],
        14: ["180"],  # half an angle
        15: ["lamp"],  # no device
    }
    answers = [line for place, good in enumerate(SMALL) for line in (*wrong.get(place, []), good)]
    file = tmp_path / "scene.toml"
    code, _, err = ask(monkeypatch, capsys, answers, file)
    assert code == 0
    right = tmp_path / "right.toml"
    ask(monkeypatch, capsys, SMALL, right)
    assert file.read_text() == right.read_text()
    for old, new in (
        ("acceleration_limit_deg_s2 = 0.5", "acceleration_limit_deg_s2 = 0"),
        ("acceleration_limit_deg_s2 = 0.5", 'acceleration_limit_deg_s2 = "a lot"'),
        ("boresight = [0.6, 0, 0.8]", "boresight = [0.0, 0.0, 2.0]"),
        ("boresight = [0.6, 0, 0.8]", "boresight = [1.0, 0.0]"),
        ("half_angle_deg = 25", "half_angle_deg = 180"),
        ('devices = ["camera"]', 'devices = ["lamp"]'),
    ):
        text = right.read_text().replace("[0.6, 0.0, 0.8]", "[0.6, 0, 0.8]")
        assert old in text, old
        with pytest.raises(jp.ScenarioError) as caught:
            parse_scenario(text.replace(old, new))
        (fault,) = caught.value.faults
        said = " ".join(err.split())
        assert " ".join(fault.split()) in said, (fault, said)
    assert 'sky = "perhaps": must be true or false' in err


def test_a_part_that_does_not_hold_together_is_asked_again_with_its_answers(monkeypatch, capsys, tmp_path):
    flat = ["a", "wheels", "[[9, 0, 0], [0, 9, 0], [0, 0, 9]]", "3"]
    flat += ["", "x", "", "", "", "", "y", "", "", "", "", "0.6 0.8 0", "", "", "", "", ""]
    again = ["", "", "", *[""] * 10, "", "z", "", "", "", "", ""]
    file = tmp_path / "scene.toml"
    code, _, err = ask(monkeypatch, capsys, [*flat, *again, *SMALL[4:]], file)
    assert code == 0, err
    assert "spacecraft.wheel: their axes must not lie in one plane" in err
    assert "axis [0.6 0.8 0]: z" in err
    axes = [wheel.axis for wheel in jp.load_scenario(file).spacecraft.wheels]
    assert np.array_equal(axes, np.eye(3))


def test_a_start_within_a_zone_is_told_and_asked_for_again(monkeypatch, capsys, tmp_path):
    inside = [*SMALL[:13], "0.6 0 0.8", *SMALL[14:16], "", "", "", "-z"]
    file = tmp_path / "scene.toml"
    code, _, err = ask(monkeypatch, capsys, [*inside, "yes", "", "0 2 0", "", ""], file)
    assert code == 0, err
    assert "lamp" in err.partition("again")[0].splitlines()[-2]
    assert np.array_equal(jp.load_scenario(file).start.rotation_vector, [0, 2, 0])
    kept = tmp_path / "kept.toml"
    code, _, err = ask(monkeypatch, capsys, [*inside, "no"], kept)
    assert code == 0
    assert "camera is 25 deg inside keep-out zone lamp" in err.splitlines()[-2]  # written as it was told


def test_whoever_stops_answering_leaves_no_file(monkeypatch, capsys, tmp_path):
    file = tmp_path / "scene.toml"
    for count in range(len(SMALL)):
        code, out, err = ask(monkeypatch, capsys, SMALL[:count], file)
        assert (code, out) == (2, "")
        assert "so nothing was written" in err.splitlines()[-1]
        assert not [*tmp_path.iterdir()]

    class Interrupted(io.StringIO):
        def readline(self, *_: object) -> str:
            if self.tell() > 20:
                raise KeyboardInterrupt
            return super().readline()

    monkeypatch.setattr(sys, "stdin", Interrupted("\n".join(SMALL)))
    assert main(["new", "--ask", str(file)]) == 130
    assert not [*tmp_path.iterdir()]
    file.write_text("mine")
    assert ask(monkeypatch, capsys, [], file)[0] == 2  # is there already
    assert "is there already" in ask(monkeypatch, capsys, [], file)[2]
    assert ask(monkeypatch, capsys, SMALL[:5], file, "--force")[0] == 2
    assert file.read_text() == "mine"


def test_a_goal_without_a_target_may_be_told_otherwise(monkeypatch, capsys, tmp_path):
    file = tmp_path / "scene.toml"
    answers = [*SMALL[:-2], "targets", "", "attitude", "0 0 1"]
    code, _, err = ask(monkeypatch, capsys, answers, file)
    assert code == 0, err
    assert "goal.targets: must name a device at least, and what it points at; or else goal by attitude" in err
    assert np.array_equal(jp.load_scenario(file).goal.rotation_vector, [0, 0, 1])


@pytest.mark.parametrize(("answers", "fault"), [([], "goal.targets: must name a device"), (["a", "b"], "b")])
def test_answers_without_end_that_are_refused_in_the_same_words_are_given_up(
    monkeypatch, capsys, tmp_path, answers, fault
):
    class Endless(io.StringIO):
        given = 0

        def readline(self, *_: object) -> str:
            self.given += 1
            assert self.given < 200
            return super().readline() or f"{fault if answers else ''}\n"

    monkeypatch.setattr(sys, "stdin", Endless("".join(f"{line}\n" for line in answers)))
    assert main(["new", "--ask", str(tmp_path / "scene.toml")]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert "the answers were refused 10 times, so nothing was written: " in last
    assert fault in last
    assert not [*tmp_path.iterdir()]


def test_only_ask_reads_answers(monkeypatch, capsys, tmp_path):
    class Unread(io.StringIO):
        def readline(self, *_: object) -> str:
            pytest.fail("read")

        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdin", Unread())
    assert main(["new", str(tmp_path / "scene.toml")]) == 0
    for words in (("--timeline",), ("--from", "case-1")):
        assert main(["new", "--ask", *words, str(tmp_path / "other.toml")]) == 2
        assert "--ask: makes a scenario of answers" in capsys.readouterr().err


def test_answers_need_neither_quotes_nor_brackets():
    number = Number()
    for answer, kind, value in (
        ("3", number, 3),
        ("1, 2 3", number, [1.0, 2.0, 3.0]),
        ("[1, 2, 3]", number, [1, 2, 3]),
        ("(1 2)", number, [1.0, 2.0]),
        ("-Y", Axis(), [0.0, -1.0, 0.0]),
        ("nadir", Axis(inline=True), "nadir"),
        ('"nadir"', Axis(inline=True), "nadir"),
        ("minimum", number, "minimum"),
        ("x", Text(), "x"),
        ("3", Text(), "3"),
        ("yes", YesNo(), True),
        ("No", YesNo(), False),
        ("true", YesNo(), True),
        ("a", Choice(("a", "b")), "a"),
        ("2026-01-01", Epoch(), "2026-01-01"),
        ("cam 1, cam 2", Names(), ["cam 1", "cam 2"]),
        ('["a"]', Names(), ["a"]),
        ("1 = 2", number, "1 = 2"),
        ("1e999", number, float("inf")),
    ):
        assert value_of(answer, kind) == value, answer


def test_commented_files_hold_what_they_were_made_of_whatever_the_names():
    odd = 'a # "b" = [c]'
    document = {
        "schema_version": 1,
        "name": odd,
        "spacecraft": {
            "rate_limit_deg_s": [1.0, 2.0, 0.1],
            "acceleration_limit_deg_s2": 0.25,
            "inertia_kg_m2": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            "drive": [
                {
                    "name": odd,
                    "axis": [0.0, 0.0, 1.0],
                    "boresight": [1.0, 0.0, 0.0],
                    "range_deg": [-1.0, 1.0],
                    "rate_limit_deg_s": 1.0,
                    "acceleration_limit_deg_s2": 1.0,
                }
            ],
        },
        "start": {"attitude": [0.0, 0.0, 0.0], "joints_deg": {odd: [0.5]}},
        "goal": {"targets": {odd: [1.0, 0.0, 0.0]}},
    }
    text = commented(document)
    assert tomllib.loads(text) == document
    assert parse_scenario(text).spacecraft.drives[0].name == odd
