"""Standard output and standard error that never stop a command because nobody reads them any more.

A reader such as ``head`` closes its pipe once it has read enough. What a command does besides printing, such
as drawing figures, goes on then, and what it prints is dropped.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import Any, TextIO


class Outlet:
    """A stream for text that drops all that is written once its reader has ended.

    Args:
        stream: a text stream; None where the process was started without one.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = open(os.devnull, "w") if stream is None else stream  # noqa: SIM115

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text; returns the number of its characters."""
        try:
            self._stream.write(text)
        except BrokenPipeError:
            self.drop()
        return len(text)

    def flush(self) -> None:
        """Write what waits in the buffer; an OSError, such as of a full disk, is raised."""
        try:
            self._stream.flush()
        except BrokenPipeError:
            self.drop()

    def drop(self) -> None:
        """Drop what waits in the buffer and all that is written from now on."""
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, self._stream.fileno())
        os.close(null)


@contextmanager
def outlets() -> Iterator[Outlet]:
    """Make outlets of stdout and stderr within a with block; yields that of stdout."""
    out, err = Outlet(sys.stdout), Outlet(sys.stderr)
    told: Any = (out, err)
    with redirect_stdout(told[0]), redirect_stderr(told[1]):
        try:
            yield out
        finally:
            for each in (out, err):
                with suppress(OSError):  # Python tells of it at the end of the process
                    each.flush()
