"""What a written file replaces, and what it never does."""

import os
import socket
import zipfile
from pathlib import Path

import pytest

from jaxplan.cases import CASE_NAMES, TIMELINE_NAMES, case_path
from jaxplan.runtime.files import Source, free_place, is_day_plan, replacing_file, source_of
from jaxplan.schema.text import template
from jaxplan.schema.timelines import timeline_template

PLAN = '{\n "schema_version": 1,\n "scenario": {},\n "status": "OK"\n}\n'
SCENE = 'schema_version = 1\nname = "a"\n[spacecraft]\n'


def write(file: Path, text: str = "new", kind: Source | None = None) -> None:
    with replacing_file(file, kind=kind) as fresh:
        fresh.write_text(text)


def day_plan(file: Path) -> Path:
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("plan.json", "{}")
    return file


@pytest.fixture
def special(tmp_path) -> list[Path]:
    """A pipe, a socket, links to them and, where one may be made, a device."""
    pipe, place, device = (tmp_path / name for name in ("pipe", "socket", "device"))
    os.mkfifo(pipe)
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(place))
    (tmp_path / "link").symlink_to(pipe)
    if os.geteuid() == 0:
        os.mknod(device, 0o20666, os.makedev(1, 3))
        return [pipe, place, tmp_path / "link", device]
    return [pipe, place, tmp_path / "link"]


def test_only_files_are_replaced(special, tmp_path):
    before = {file.name: file.lstat().st_mode for file in tmp_path.iterdir()}
    for place in special:
        for call in (lambda: write(place), lambda: free_place(place, overwrite=True)):  # noqa: B023
            with pytest.raises(FileExistsError, match="is a device, pipe or socket") as caught:
                call()
            assert caught.value.filename == str(place)
    assert {file.name: file.lstat().st_mode for file in tmp_path.iterdir()} == before


def test_a_link_stays_and_leads_to_what_is_written(tmp_path):
    (tmp_path / "far").mkdir()
    file, link = tmp_path / "far" / "file", tmp_path / "link"
    link.symlink_to(file)
    for text in ("first", "second"):  # at first it leads nowhere
        write(link, text)
        assert link.is_symlink()
        assert file.read_text() == text
    assert list((tmp_path / "far").iterdir()) == [file]


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (Source.PLAN, PLAN),
        (Source.PLAN, '{"scenario": {}, "status": "OK", "schema_version": 1}'),
        (Source.SCENE, SCENE),
        (Source.SCENE, "\ufeff# a comment\n\n'name' = 'x'\r\n \"schema_version\"=1\n[goal"),
        (Source.SCENE, template()),
        (Source.SCENE, timeline_template()),
        *((Source.SCENE, case_path(name).read_text()) for name in (*CASE_NAMES, *TIMELINE_NAMES)),
        (Source.DAY_PLAN, None),
    ],
    ids=lambda value: value.name if isinstance(value, Source) else "",
)
def test_what_others_are_made_of_is_replaced_by_its_own_kind_alone(tmp_path, kind, text):
    file = tmp_path / "file"
    if text is None:
        day_plan(file)
    else:
        file.write_text(text, encoding="utf-8")
    held = file.read_bytes()
    assert source_of(file) is kind
    assert is_day_plan(file) == (kind is Source.DAY_PLAN)
    for other in {None, *Source} - {kind}:
        with pytest.raises(FileExistsError, match=f"holds {kind.value}, which no other kind"):
            write(file, kind=other)
    with pytest.raises(FileExistsError, match=f"holds {kind.value}"):
        free_place(file, overwrite=True)
    assert file.read_bytes() == held
    assert list(tmp_path.iterdir()) == [file]
    write(file, kind=kind)
    assert file.read_text() == "new"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "mine",
        '{"schema": "jaxplan-pieces", "schema_version": 1}',
        "<!doctype html>\n<pre>schema_version = 1\n</pre>",
        "CCSDS_AEM_VERS = 2.0\nCREATION_DATE = 2026-01-01\nMETA_START\nschema_version = 1\n",
        "time_s,schema_version\n0,1\n",
        "[sky]\nschema_version = 1\n",
        "PK\x03\x04 no archive",
    ],
)
def test_other_files_are_replaced(tmp_path, text):
    file = tmp_path / "file"
    file.write_text(text)
    assert source_of(file) is None
    assert free_place(file, overwrite=True) == file
    write(file)
    assert file.read_text() == "new"


def test_a_file_of_numbers_is_no_plan(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("times.npy", b"")
    assert source_of(tmp_path / "a.npz") is None
