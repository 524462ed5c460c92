"""Folders of results: made, locked by the one process that works there, and claimed for one problem.

A folder has a head, a JSON file that says what it is of: of a study, or of a fleet, the *noun* in messages.
What is written is forced to disk. Names of files are fixed and links are not followed, so nothing is ever
written elsewhere, and nothing in a folder is taken on trust.
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
_LARGEST_HEAD = 64 * 2**20  # bytes; seeds that do not follow one another take up to 43 each


class StudyFolderError(ValueError):
    """A folder that holds no study, or not the one that is wanted; the message says what is wrong."""


@dataclass(frozen=True, kw_only=True)
class Head:
    """The head of a kind of folders.

    Attributes:
        name: of the file.
        noun: what the folder is of, for messages.
        check: function that raises a ValueError for a head, as a table, that is none of this kind.
    """

    name: str
    noun: str
    check: Callable[[dict[str, Any]], None]

    @property
    def part(self) -> str:
        """Name of the file while it is written."""
        return f".{self.name}.part"

    def read(self, folder: Path) -> dict[str, Any]:
        """The head of a folder; raises a StudyFolderError if it has none of this kind."""
        path = folder / self.name
        try:
            with path.open("rb") as file:  # what a link leads to may have no end
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
        """Hold a folder while a block runs: it is made where it is missing, and locked.

        Args:
            folder: a new or empty one, or one with the same head.
            description: the head.
            begun: function of the head that is there, which returns the one that is allowed there, where
                that of a smaller beginning is, too; what is done with it is for the block.

        Raises:
            StudyFolderError: if it holds anything else, is no folder, or is in use.
        """
        self._make(folder)
        with self._locked(folder):
            self._claim(folder, description, begun)
            yield

    def _make(self, folder: Path) -> None:
        """Make a folder where it is missing; raise a StudyFolderError if it holds something else."""
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

    def _locked(self, folder: Path) -> IO[bytes]:
        """Open and lock the folder's lock file, until it is closed; StudyFolderError if it is taken."""
        lock = open_file(folder / LOCK, self.noun)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            lock.close()
            raise StudyFolderError(f"{folder}: another process is working on this {self.noun}") from error
        return lock

    def write(self, folder: Path, description: Mapping[str, Any]) -> None:
        """Write the head of a folder that is held, whole or not at all."""
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

    def _claim(
        self,
        folder: Path,
        description: Mapping[str, Any],
        begun: Callable[[dict[str, Any]], Mapping[str, Any]] | None,
    ) -> None:
        """Write the head of a folder that has none; raise a StudyFolderError if it has another."""
        if not (folder / self.name).exists():
            self.write(folder, description)
            return
        there = self.read(folder)
        allowed = description if begun is None else begun(there)
        differing = [
            f"{key} {_short(there.get(key))} there, {_short(description.get(key))} here"
            for key in dict.fromkeys([*description, *there])
            if there.get(key) != allowed.get(key)
        ]
        if differing:
            raise StudyFolderError(
                f"{folder}: holds another {self.noun} ({'; '.join(differing)}): "
                f"take another folder, or the same {self.noun}"
            )


def refuse_constant(word: str) -> float:
    """Raise a ValueError for NaN or an infinity in JSON."""
    raise ValueError(f"{word} is not allowed")


def _short(value: Any) -> str:
    """A value as JSON, cut to 80 characters."""
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."


def open_file(path: Path, noun: str) -> IO[bytes]:
    """Open a file to append to, made where it is missing; raise StudyFolderError if it is a link."""
    try:
        return open(os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o666), "ab")
    except OSError as error:
        if error.errno == errno.ELOOP:
            plural = "studies" if noun == "study" else f"{noun}s"
            raise StudyFolderError(f"{path}: is a link, which {plural} do not follow") from error
        raise


def force(file: IO[bytes]) -> None:
    """Force what was written to a file to disk."""
    file.flush()
    os.fsync(file.fileno())
