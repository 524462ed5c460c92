"""Folders of results: made where they are missing, locked by the process that works there, of one task each.

A folder has a *head*, a JSON file that describes what the folder is of: a study or a fleet, which messages
call by its *noun*. A folder is *claimed* by locking it and writing the head, or by finding an equal head
there. All that is written is forced to disk. File names are fixed and symbolic links are not followed, so
that nothing is written outside the folder; and everything that is read from a folder is checked.
"""

import errno
import fcntl
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

LOCK = ".lock"
_LARGEST_HEAD = 64 * 2**20  # bytes of a head at most; seeds that are not consecutive take up to 43 each


class StudyFolderError(ValueError):
    """Error for a folder that is in use or does not hold what is wanted; its message says what is wrong."""


@dataclass(frozen=True, kw_only=True)
class Head:
    """The kind of head that folders of studies, or of fleets, have; it reads, writes and claims them.

    Attributes:
        name: file name of the head.
        noun: what the folder is of, such as "study", for messages.
        check: function of a head's content that raises a ValueError if it is not of this kind.
    """

    name: str
    noun: str
    check: Callable[[dict[str, Any]], None]

    @property
    def part(self) -> str:
        """Name under which the file is written, before it is renamed."""
        return f".{self.name}.part"

    def read(self, folder: Path) -> dict[str, Any]:
        """Read the head of a folder.

        Raises:
            StudyFolderError: if the folder has no head of this kind.
        """
        path = folder / self.name
        try:
            with path.open("rb") as file:  # not read as a whole, since it may be a device without end
                text = file.read(_LARGEST_HEAD + 1)
            if len(text) > _LARGEST_HEAD:
                raise ValueError(f"too large, at most {_LARGEST_HEAD} bytes are read")
            content = json.loads(text, parse_constant=refuse_constant)
            if not isinstance(content, dict):
                raise ValueError("it is no table")
            self.check(content)
        except OSError as error:
            raise StudyFolderError(f"{folder}: holds no {self.noun}: {path}: {error.strerror}") from error
        except (ValueError, RecursionError) as error:
            raise StudyFolderError(f"{path}: not the head of a {self.noun} ({error})") from error
        return content

    @contextmanager
    def claimed(
        self,
        folder: Path,
        description: Mapping[str, Any],
        begun: Callable[[dict[str, Any]], Mapping[str, Any]] | None = None,
    ) -> Iterator[None]:
        """Make a folder if it is missing, lock it while a block runs, and check or write its head.

        Args:
            folder: a new or empty folder, or one with an equal head.
            description: the head.
            begun: function of the head that is there, which returns the head that is allowed there; None if
                only `description` is. A study passes it to continue a smaller study that it begins with. The
                head that is there then stays as it is; the block may replace it.

        Raises:
            StudyFolderError: if the folder holds anything else, is not a folder, or is in use.
        """
        self._make_folder(folder)
        with self._open_lock(folder):
            self._write_or_check_head(folder, description, begun)
            yield

    def _make_folder(self, folder: Path) -> None:
        """Make a folder if it is missing; raise a StudyFolderError if it holds files but no head."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError) as error:
            file = next(place for place in (folder, *folder.parents) if place.exists())
            raise StudyFolderError(f"{folder}: cannot be a folder, {file} is a file") from error
        names = {entry.name for entry in os.scandir(folder)}
        if self.name not in names and names - {LOCK, self.part}:
            raise StudyFolderError(
                f"{folder}: holds {min(names - {LOCK, self.part})}, but no {self.noun}: "
                "take a new or an empty folder"
            )

    def _open_lock(self, folder: Path) -> IO[bytes]:
        """Open and lock the folder's lock file; closing the file that is returned releases the lock.

        Raises:
            StudyFolderError: if another process holds the lock.
        """
        lock = open_file(folder / LOCK, self.noun)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            lock.close()
            raise StudyFolderError(f"{folder}: another process is working on this {self.noun}") from error
        return lock

    def write(self, folder: Path, description: Mapping[str, Any]) -> None:
        """Write the head of a folder that is locked, as a whole or not at all; an existing head is replaced.

        Raises:
            StudyFolderError: if the head is too large.
        """
        text = json.dumps(description, indent=1, allow_nan=False).encode() + b"\n"
        if len(text) > _LARGEST_HEAD:
            raise StudyFolderError(
                f"{folder}: seeds that do not follow one another are too many to be kept: take range(n)"
            )
        with open_file(folder / self.part, self.noun) as file:
            file.truncate(0)
            file.write(text)
            force(file)
        os.replace(folder / self.part, folder / self.name)

    def _write_or_check_head(
        self,
        folder: Path,
        description: Mapping[str, Any],
        begun: Callable[[dict[str, Any]], Mapping[str, Any]] | None,
    ) -> None:
        """Write the head of a folder that has none, or check the one that is there; see `claimed`.

        Raises:
            StudyFolderError: if the head that is there is not allowed; the message names what differs.
        """
        if not (folder / self.name).exists():
            self.write(folder, description)
            return
        there = self.read(folder)
        allowed = description if begun is None else begun(there)
        differing = [
            f"{key} {_short_json(there.get(key))} there, {_short_json(description.get(key))} here"
            for key in dict.fromkeys([*description, *there])
            if there.get(key) != allowed.get(key)
        ]
        if differing:
            raise StudyFolderError(
                f"{folder}: holds another {self.noun} ({'; '.join(differing)}): "
                f"take another folder, or the same {self.noun}"
            )


def refuse_constant(word: str) -> float:
    """Raise a ValueError for the word NaN, Infinity or -Infinity; `json.loads` calls it for them."""
    raise ValueError(f"{word} is not allowed")


def _short_json(value: Any) -> str:
    """A value as JSON text, cut to 80 characters."""
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."


def open_file(path: Path, noun: str) -> IO[bytes]:
    """Open a file for appending bytes; it is made if it is missing.

    Raises:
        StudyFolderError: if it is a symbolic link; `noun` names in the message what the folder is of.
    """
    try:
        return open(os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o666), "ab")
    except OSError as error:
        if error.errno == errno.ELOOP:
            plural = "studies" if noun == "study" else f"{noun}s"
            raise StudyFolderError(f"{path}: is a link, which {plural} do not follow") from error
        raise


def force(file: IO[bytes]) -> None:
    """Force everything written to an open file to disk."""
    file.flush()
    os.fsync(file.fileno())
