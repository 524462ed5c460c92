"""Names and numbers of the user's in exported files, and what they may not be."""

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario
from exports import EPOCH, flown_plan

import jaxplan as jp
from jaxplan.cli import main
from jaxplan.exporting.ck import frames_of
from jaxplan.model.export_names import name_faults

GOOD = {"object_name": "EO-1", "object_id": "2000-075A", "originator": "ESA", "frame_name": "SC_BODY_2"}


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


@pytest.mark.parametrize(
    ("key", "values", "words"),
    [
        (
            "object_name",
            ["", " EO-1", "x" * 81, "caf\u00e9", "a\nb", "a\\b", 3],
            "must be a text of 1 to 80 printable",
        ),
        ("object_id", ["", None, "x" * 81, 5], "must be a text of 1 to 80 printable"),
        ("originator", ["", None, "\t"], "must be a text of 1 to 80 printable"),
        (
            "frame_name",
            ["", "1_BUS", "BUS-1", "A B", "X" * 27, 1],
            "must be 1 to 26 letters, digits and underscores",
        ),
        ("frame_name", ["J2000", "eme2000", "IAU_EARTH", "ITRF93"], "must be none of the frames that SPICE"),
        ("reference_frame", ["J2000", "", None, "TEME"], "must be one of EME2000, ICRF, GCRF"),
        (
            "naif_id",
            [0, 399, -2147483, -5.0, "-5", True, None, 10**30],
            r"must be a whole number in \[-2147482, -1\]",
        ),
    ],
)
def test_names_that_no_file_could_hold_are_refused_by_name(key, values, words):
    for value in values:
        with pytest.raises(ValueError, match=f"{key} = .*: {words}"):
            jp.ExportNames(**{key: value})
        assert list(name_faults({key: value})) == [key]


def test_all_faults_of_names_are_told_at_once():
    with pytest.raises(ValueError, match=r"2 faults:\n.*object_id.*\n.*naif_id"):
        jp.ExportNames(object_id="", naif_id=1)
    assert name_faults({**GOOD, "naif_id": np.int64(-7), "reference_frame": "GCRF"}) == {}
    assert type(jp.ExportNames(naif_id=np.int64(-7)).naif_id) is int


def test_a_plan_without_names_has_those_of_before(plan, tmp_path):
    text = jp.export(plan, tmp_path / "plan.aem", format="aem", epoch=EPOCH).read_text()
    for line in (
        "ORIGINATOR = JAXPLAN",
        "OBJECT_NAME = an odd slew: 3 %, ?",
        "OBJECT_ID = UNKNOWN",
        "REF_FRAME_A = EME2000",
        "REF_FRAME_B = SC_BODY_1",
    ):
        assert f"{line}\n" in text
    assert "COMMENT" not in text
    assert text.count("META_START") == 1


def test_frames_of_devices_are_called_after_the_body_and_fit(plan):
    craft = plan.scenario.spacecraft
    for name, stem in (
        (None, "JAXPLAN"),
        ("EO1_BUS", "EO1"),
        ("EO1", "EO1"),
        ("sat_body", "SAT"),
        ("SC_BODY_1", "SC_BODY_1"),
        ("A_VERY_LONG_NAME_OF_A_BUS", "A_VERY_LONG_NAM"),
    ):
        frames = frames_of(craft, jp.ExportNames(frame_name=name, naif_id=-31))
        assert frames.bus.name == (name or "JAXPLAN_BUS").upper()
        assert [frame.number for frame in frames.turning] == [-31001, -31002]
        assert [frame.number for frame in frames.instruments] == [-31501]
        for frame in (*frames.turning, *frames.instruments):
            assert frame.name.startswith(f"{stem}_")
            assert len(frame.name) <= 26
    twin = replace(craft, instruments=(replace(craft.instruments[0], name="bus"),))
    frames = frames_of(twin, jp.ExportNames(frame_name="EO1_BUS"))
    assert frames.instruments[0].name != "EO1_BUS"
    many = replace(craft, instruments=tuple(replace(craft.instruments[0], name=f"i{k}") for k in range(500)))
    with pytest.raises(
        ValueError, match="2 devices with joints and 500 instruments: format ck has numbers for 499"
    ):
        frames_of(many, jp.ExportNames())


def test_the_command_line_takes_names_and_a_tolerance(tmp_path, capsys):
    scenario = make_scenario(2, 1)
    jp.plan(replace(scenario, goal=scenario.start)).save(tmp_path / "plan.json")
    words = ["--object-name", "EO-1", "--object-id", "2000-075A", "--originator", "ESA"]
    words += [
        "--frame-name",
        "EO1_BUS",
        "--reference-frame",
        "GCRF",
        "--naif-id",
        "-2000",
        "--tolerance",
        "0.01",
    ]
    command = ["export", str(tmp_path / "plan.json"), "--format", "aem", "--epoch", EPOCH]
    assert main([*command, *words]) == 0
    text = (tmp_path / "plan.aem").read_text()
    for key, value in {
        "OBJECT_NAME": "EO-1",
        "OBJECT_ID": "2000-075A",
        "ORIGINATOR": "ESA",
        "REF_FRAME_A": "GCRF",
        "REF_FRAME_B": "EO1_BUS",
        "INTERPOLATION_METHOD": "LINEAR",
    }.items():
        assert re.search(f"^{key} = {value}$", text, re.MULTILINE)
    capsys.readouterr()
    for wrong, said in (
        (["--naif-id", "7"], "naif_id = 7: must be a whole number in"),
        (["--frame-name", "1"], "frame_name = '1': must be 1 to 26 letters"),
        (["--tolerance", "9"], "tolerance_deg = 9.0: must lie in"),
        (["--tolerance", "0.01", "--step", "1"], "one of them is enough"),
    ):
        assert main([*command, "-o", str(tmp_path / "other"), *wrong]) == 2
        assert said in capsys.readouterr().err
