"""Writing files completely or not at all, and never over what was not written for being replaced.

A file is written under a temporary name beside the target, then renamed. What it replaces is a regular file,
never a folder, device, pipe or socket; a symbolic link stays, and the file that it leads to is replaced.
Exports, pages and pictures are made of plans, and plans of scenarios and timelines. So none of these, which
are the `Source` of others, is ever replaced by a file of another kind.
"""

import errno
import io
import os
import re
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path

DAY_ENTRY = "plan.json"
"""Name of the entry by which an archive is a timeline's plan."""
_MOST_READ = 64 << 20  # bytes of a file that are looked at to find out what it is


class Source(Enum):
    """A kind of file of which others are made, with its name in messages."""

    SCENE = "a scenario or timeline"
    PLAN = "a plan"
    DAY_PLAN = "the plan of a timeline"


@contextmanager
def replacing_file(
    target: Path, suffix: str = "", *, private: bool = False, kind: Source | None = None
) -> Iterator[Path]:
    """Yield the path of a temporary file to write; it replaces the target if the block ends without error.

    Args:
        target: path of the file; an existing file stays until then. Its folder is created.
        suffix: ending of the temporary name, for writers that depend on it.
        private: whether the file is for this user alone, instead of with the rights of the user's files.
        kind: what is written, if others are made of it.

    Raises:
        IsADirectoryError: if the target is a folder.
        FileExistsError: if it must not be replaced, see `expect_replaceable`.
    """
    expect_replaceable(target, kind)
    target = Path(os.path.realpath(target))
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=target.name, suffix=f".part{suffix}")
    os.close(handle)
    try:
        yield Path(name)
        if not private:
            os.chmod(name, 0o666 & ~_umask())
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise


@contextmanager
def replacing_folder(target: Path) -> Iterator[Path]:
    """Yield the path of an empty folder to fill; it replaces the target if the with block ends without error.

    Args:
        target: path of the folder; an existing folder is then deleted with all that is in it.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=target.name, suffix=".part") as holder:
        fresh, old = Path(holder) / "new", Path(holder) / "old"
        fresh.mkdir()  # unlike its holder, with the rights that the user's folders have
        yield fresh
        if target.exists():
            os.rename(target, old)
        try:
            os.rename(fresh, target)
        except BaseException:
            if old.exists():
                os.rename(old, target)
            raise


def expect_replaceable(target: Path, kind: Source | None = None) -> None:
    """Check that whatever is at a path may be replaced by a file; a path where nothing is passes.

    Args:
        target: path of the file.
        kind: what is to be written, if others are made of it.

    Raises:
        IsADirectoryError: if it is a folder.
        FileExistsError: if it is a device, pipe or socket, or a `Source` of another kind.
    """
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder, name a file in it", str(target))
    if not target.exists():
        return
    if not target.is_file():
        reason = "is a device, pipe or socket, and only files are replaced: name a file"
        raise FileExistsError(errno.EEXIST, reason, str(target))
    there = source_of(target)
    if there not in (None, kind):
        reason = f"holds {there.value}, which no other kind of file replaces: take another name"
        raise FileExistsError(errno.EEXIST, reason, str(target))


def free_place(path: str | os.PathLike[str], parts: tuple[str, ...] = (), *, overwrite: bool) -> Path:
    """Check that a path may be written to, and return it.

    Args:
        path: path of a file, or of a folder.
        parts: suffixes of the files in a folder; empty for a single file.
        overwrite: whether an existing file may be replaced, or a folder that holds only files of these
            suffixes.

    Raises:
        FileExistsError: if something is there and `overwrite` is false, or it must not be replaced, see
            `expect_replaceable`.
        ValueError: if the path is empty, or what is there is not such a file or folder.
    """
    if not os.fspath(path):
        raise ValueError("path is empty, it must name a file or folder to write")
    target = Path(path)
    if not parts and target.is_dir():
        raise ValueError(f"{target}: is a folder, and this format is a file")
    if not os.path.lexists(target):
        return target
    if not parts:
        expect_replaceable(target)
    if not overwrite:
        hint = "is there already; --force replaces it (in Python overwrite=True)"
        raise FileExistsError(errno.EEXIST, hint, os.fspath(path))
    if parts and (target.is_symlink() or not target.is_dir()):
        raise ValueError(f"{target}: is a file, and this format is a folder of files")
    foreign = sorted(
        p.name for p in (target.iterdir() if parts else ()) if p.suffix not in parts or not p.is_file()
    )
    if foreign:
        raise ValueError(
            f"{target}: holds {foreign[0]}, so it is not replaced; only {', '.join(parts)} may be there"
        )
    return target


def source_of(file: Path) -> Source | None:
    """Find out of what kind of `Source` a regular file is, even one with faults; None if of none.

    A scenario or timeline is TOML with the key ``schema_version`` before its tables, a plan is JSON with that
    key and ``scenario``, and the plan of a timeline is an archive with the entry `DAY_ENTRY`.
    """
    if is_day_plan(file):
        return Source.DAY_PLAN
    with file.open("rb") as opened:
        text = opened.read(_MOST_READ).decode("utf-8-sig", "replace").lstrip()
    if text.startswith("{"):
        keys = (re.search(rf'"{key}"\s*:', text) for key in ("schema_version", "scenario"))
        return Source.PLAN if all(keys) else None
    for line in io.StringIO(text):
        key, equals, _ = line.partition("=")
        if equals and key.strip(" \t\"'") == "schema_version":
            return Source.SCENE
        if line.strip() and not line.lstrip().startswith("#") and not equals:
            return None
    return None


def is_day_plan(path: str | os.PathLike[str]) -> bool:
    """Tell whether a file is an archive with the entry of a timeline's plan; its content is not checked."""
    try:
        with zipfile.ZipFile(Path(path)) as archive:
            return DAY_ENTRY in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _umask() -> int:
    """Return the permission bits that new files of this process do not get."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
