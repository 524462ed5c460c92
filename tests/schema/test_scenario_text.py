"""Scenario files that are no files, no text or no TOML, and ones damaged at random."""

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest

import jaxplan.schema as sc
from jaxplan.cases import case_path

EVERY_KEY = Path(__file__).parents[1] / "scenarios" / "every_key.toml"
TEXT = EVERY_KEY.read_text()


def faults_of_text(text):
    with pytest.raises(sc.ScenarioError) as caught:
        sc.parse_scenario(text)
    return caught.value.faults


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("x = 3\n\n  y = = 2", "line 3, column 7: not TOML"),
        ("x = 3\nx = 4", "line 2, column 6: not TOML"),
        ("x = 1\ny = [1, 2", "line 2, column 10: not TOML"),
        ("x = 1\n[a", "line 2, column 3: not TOML"),
        ("x = 1979-13-01", "line 1, column 9: not TOML"),
        ('x = """a""""\ny = ' + "[" * 17, "line 2, column 21: nested more than 16 deep"),
        ('x = ["""[[{"""", ' + "[" * 16, "line 1, column 33: nested more than 16 deep"),
        ("x = " + "[" * 100_000, "line 1, column 21: nested more than 16 deep"),
        ("x = 1 # [[[\n" + "y = {" * 100_000, "line 2, column 85: nested more than 16 deep"),
        ("x = 1\n" + ".".join("a" * 400_000) + " = 1", "line 2, column 34: nested more than 16 deep"),
        ("[" + ".".join(['"a"'] * 200_000) + "]", "line 1, column 69: nested more than 16 deep"),
        ("x = 1\nseed = " + "9" * 5000, "line 2, column 8: longer than 1000 characters"),
        ("#" * (2**20 + 1), "larger than 1 MiB, which no scenario is"),
    ],
    ids=range(13),
)
def test_text_that_is_no_toml_is_answered_with_line_and_column(text, line):
    (found,) = faults_of_text(text)
    assert found.startswith(line)  # what is wrong with the syntax is in the words of the standard library


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x = 1979-13-01", "; there is no month 13$"),
        ("x = 2026-02-29", "2026-02 has no day 29$"),
        ("x = 2026-02-28T24:00:00", "there is no hour 24$"),
        ("x = 2026-02-28T23:61:00", "there is no minute 61$"),
        ("x = 2026-02-28T23:59", "; a date-time is written as 2026-01-01T00:00:00, with its seconds$"),
        ("x = tracker", 'line 1, column 5: not TOML, .*; text needs quotes, "tracker"$'),
        ("x = laser A # of it", '; text needs quotes, "laser A"$'),
        ('x = ["a", b]', '; text needs quotes, "b"$'),
        ("x = True", "; perhaps true is meant$"),
        ("x = no", "; perhaps false is meant$"),
        ("x = 5 deg", "line 1, column 7: not TOML, [^;]*$"),
    ],
)
def test_what_may_be_meant_is_told_behind_the_fault(text, told):
    (found,) = faults_of_text(text)
    assert re.search(told, found), found


@pytest.mark.parametrize("value", ["2026-03-20T12:00", "2026-03-20 12:00 UTC", "2026-3-20"])
def test_a_date_that_toml_does_not_know_is_answered_with_one_that_it_does(value):
    (found,) = faults_of_text(f"x = 1\nepoch_utc = {value}")
    assert found.startswith("line 2, column ")
    assert found.endswith("; a date-time is written as 2026-01-01T00:00:00, with its seconds")


def test_brackets_and_dots_in_strings_and_comments_do_not_count():
    odd = "[[[[{{{{" * 9 + "." * 99
    text = TEXT.replace('"every key"', f"'''\\\n{odd}'''").replace("# Every", f"# {odd}")
    assert faults_of_text(text) == (f'name = "\\\\\\n{odd[:58]}...": must be a line of text',)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda path: None, "cannot be read: No such file or directory"),
        (lambda path: path.mkdir(), "cannot be read: Is a directory"),
        (lambda path: path.write_bytes(b'name = "\xff"'), "not UTF-8 text, byte 8 is none of it"),
        (lambda path: path.write_bytes(b"#" * (2**20 + 1)), "larger than 1 MiB, which no scenario is"),
        (
            lambda path: path.write_text("x = 1\nx = 2"),
            "line 2, column 6: not TOML, cannot overwrite a value",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_named(tmp_path, make, complaint):
    path = tmp_path / "scene.toml"
    make(path)
    with pytest.raises(sc.ScenarioError) as caught:
        sc.load_scenario(path)
    assert str(caught.value) == f"{path}: {complaint}"


def test_a_byte_order_mark_and_other_line_ends_do_no_harm(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + TEXT.replace("\n", "\r\n").encode())
    assert sc.dump_scenario(sc.load_scenario(path)) == sc.dump_scenario(sc.load_scenario(EVERY_KEY))


def test_no_damage_to_a_file_raises_anything_but_its_own_error():
    rng = np.random.default_rng(11)
    pieces = [
        "[",
        "]",
        "{",
        "}",
        '"',
        "'",
        "=",
        ".",
        ",",
        "\n",
        "#",
        "\\",
        "-",
        "e9",
        "nan",
        "true",
        "\x00",
        "é",
    ]
    survived = 0
    for _ in range(1500):
        text = TEXT
        for _ in range(rng.integers(1, 4)):
            start = int(rng.integers(len(text)))
            end = start + int(rng.integers(0, 6))
            text = text[:start] + str(rng.choice(pieces)) * int(rng.integers(0, 3)) + text[end:]
        with contextlib.suppress(sc.ScenarioError):
            sc.parse_scenario(text)
            survived += 1
    assert 0 < survived < 1500


def test_a_folder_is_no_file_to_write(tmp_path):
    with pytest.raises(IsADirectoryError, match="is a folder, name a file in it") as caught:
        sc.save_scenario(sc.load_scenario(case_path("case-1")), tmp_path)
    assert caught.value.filename == str(tmp_path)
    assert not list(tmp_path.iterdir())
