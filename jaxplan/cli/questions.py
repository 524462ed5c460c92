"""Questions on a terminal, one a line, whose answers are checked as a file's values are.

A question is a key of the file: what is said of it comes from the layout by which files are read, and an
answer is judged by the same reader, with the same messages, and asked for again until it is good. Questions
and messages go to one stream, answers come from another, so that a file or a pipe may give them.

An answer is a number, several with blanks or commas between, a word, ``yes`` or ``no``, ``x`` to ``-z`` for
an axis, or whatever TOML has for a value. An empty one takes what stands in brackets.
"""

import os
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, TextIO

from jaxplan.schema.faults import Place, Reading, ScenarioError
from jaxplan.schema.layout import SCENARIO
from jaxplan.schema.tables import Table
from jaxplan.schema.text import comment_on, parse, table_at, value_text
from jaxplan.schema.value_kinds import Choice, Epoch, Integer, Interval, Kind, Name, Names, Text, YesNo

_AXES = {
    f"{sign}{letter}": [factor * float(letter == axis) + 0.0 for axis in "xyz"]
    for sign, factor in (("", 1.0), ("+", 1.0), ("-", -1.0))
    for letter in "xyz"
}
_WORDS = (Text, Name, Choice, Epoch)  # kinds whose values are words, which need no quotes here
_WIDTH = 100  # most characters of a line
_YES = {"yes": True, "y": True, "no": False, "n": False}

NOTHING: Any = object()
"""The default of a question whose key may be left out."""
Check = Callable[[Any], Sequence[str]]
"""Function of an answer's value that returns its faults."""


_MOST_EQUAL = 10  # refusals in the same words after which answers that nobody types are given up


class AnswersEnded(ValueError):
    """The answers ended before the questions did, or lead nowhere, so that nothing was made of them."""


class Dialog:
    """Asks for values of a file.

    Args:
        answers: whence a line each comes.
        out: where questions and messages go.
        folder: of the file, to which paths in answers are relative.

    What was answered before stands in brackets when the same is asked again.
    """

    def __init__(self, answers: TextIO, out: TextIO, folder: str | os.PathLike[str] = "") -> None:
        self._answers, self._out, self.folder = answers, out, folder
        self._told: set[str] = set()
        self._before: dict[str, Any] = {}
        self._refused: Counter[str] = Counter()

    def say(self, text: str = "") -> None:
        """Write a paragraph, wrapped."""
        further = "    " if text.startswith(" ") else ""
        for line in textwrap.wrap(text, _WIDTH, subsequent_indent=further) or [""]:
            print(line, file=self._out)

    def ask(
        self,
        path: Sequence[str | int],
        key: str,
        default: Any = None,
        *,
        kind: Kind | None = None,
        words: str = "",
        reading: Callable[[], Reading] = Reading,
        table: Table | None = None,
    ) -> Any:
        """Ask for the value of a key until it is one that a file may have.

        Args:
            path: keys and indices that lead to the table.
            key: of the table, or what else `kind` and `words` are of.
            default: value for an empty answer; None where there must be one, `NOTHING` where the key may be
                left out.
            kind: of the value, where that is not the key's.
            words: what is said of it, where that is not what the layout says.
            reading: makes the reading by which it is judged, which may know names.
            table: that has the key, where the path leads to one of several.

        Returns:
            The value as a file has it, or `NOTHING`.

        Raises:
            AnswersEnded: if there is no further answer, or they are refused again and again.
        """
        if kind is None:
            if table is None:
                table, _ = table_at(".".join(each for each in path if isinstance(each, str)), SCENARIO, [key])
            entry = next(entry for entry in table.fields if entry.key == key)
            kind, words = entry.kind, words or comment_on(table, entry)

        def faults(value: Any) -> Sequence[str]:
            place = Place(reading())
            place.reading.folder = self.folder
            for step in (*path, key):
                place = place[step]
            before = len(place.reading.faults)
            kind.read(value, place)
            return place.reading.faults[before:]

        return self._until_good(".".join(map(str, (*path, key))), key, words, kind, default, faults)

    def choose(self, name: str, words: str, options: Sequence[str], default: str) -> str:
        """Ask for one of some words."""
        kind = Choice(options)
        return str(self._alone(name, f"{words}: {kind.wanted.replace(chr(34), '')}", kind, default))

    def count(self, name: str, words: str, default: int, most: int = 100) -> int:
        """Ask for a number of things."""
        kind = Integer(Interval(f"[0, {most}]"))
        return int(self._alone(name, words, kind, default))

    def line(self, name: str, words: str) -> str:
        """Ask for a line of text."""
        return str(self._alone(name, words, Text(), None))

    def confirm(self, name: str, words: str, default: bool) -> bool:
        """Ask whether something is so."""
        return bool(self._alone(name, words, YesNo(), default))

    def forget(self) -> None:
        """Say again what was said of keys, since they are asked for again."""
        self._told.clear()

    def faulty(self, faults: Sequence[str]) -> None:
        """Tell what is wrong.

        Raises:
            AnswersEnded: if it was told so often that answers which nobody types will not get past it.
        """
        for fault in faults:
            self.say(f"  ! {fault}")
            self._refused[fault] += 1
            if self._refused[fault] >= _MOST_EQUAL and not self._answers.isatty():
                told = f"the answers were refused {_MOST_EQUAL} times, so nothing was written: {fault}"
                raise AnswersEnded(told)

    def _alone(self, name: str, words: str, kind: Kind, default: Any) -> Any:
        """Ask for a value that is no key of the file."""

        def faults(value: Any) -> Sequence[str]:
            place = Place(Reading())[name]
            kind.read(value, place)
            return place.reading.faults

        return self._until_good(name, name, words, kind, default, faults)

    def _until_good(self, about: str, name: str, words: str, kind: Kind, default: Any, faults: Check) -> Any:
        """Ask until an answer has no faults; returns its value, which is the default of the next time.

        Args:
            about: what is asked, with its place, by which an earlier answer is known.
            name: what is asked, as it stands in front of the brackets.
            words: what is said of it, the first time.
            kind: of the value.
            default: see `ask`.
            faults: of a value.
        """
        default = self._before.get(about, default)
        if words not in self._told:
            self._told.add(words)
            self.say(f"  # {words}")
        shown = "" if default is None else f" [{'none' if default is NOTHING else _shown(default)}]"
        while True:
            print(f"  {name}{shown}: ", end="", file=self._out, flush=True)
            line = self._answers.readline()
            if not line:
                print(file=self._out)
                raise AnswersEnded(f"the answers ended at {about}, so nothing was written")
            answer = line.strip()
            if not self._answers.isatty():  # where nobody types, the answer stands behind its question
                print(answer, file=self._out)
            if not answer and default is NOTHING:
                return NOTHING
            value = value_of(answer, kind) if answer else default
            wrong = ["must be answered"] if value is None else faults(value)
            if not wrong:
                self._before[about] = value
                return value
            self.faulty(wrong)


def value_of(answer: str, kind: Kind) -> Any:
    """The value of a file that an answer means, where a value of a kind is asked for.

    Args:
        answer: a line, not blank.
        kind: what is asked for, which decides whether a word needs quotes.
    """
    bare = re.sub(r'^(["\'])(.*)\1$', r"\2", answer)
    if isinstance(kind, _WORDS):
        return bare
    if isinstance(kind, Names):
        return [name.strip() for name in answer.strip("[]").replace('"', "").split(",") if name.strip()]
    if isinstance(kind, YesNo) and answer.lower() in _YES:
        return _YES[answer.lower()]
    if answer.lower() in _AXES:
        return list(_AXES[answer.lower()])
    try:
        parsed = parse(f"value = {answer}\n")
        if parsed.keys() == {"value"}:
            return parsed["value"]
    except ScenarioError:
        pass
    try:
        numbers = [float(word) for word in re.split(r"[,\s]+", answer.strip("[]() ,"))]
    except ValueError:
        return bare
    return numbers[0] if len(numbers) == 1 else numbers


def _shown(value: Any) -> str:
    """A value as an answer might give it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list) and all(isinstance(each, str) for each in value):
        return ", ".join(value)
    if isinstance(value, list) and not any(isinstance(each, list) for each in value):
        return " ".join(f"{each:g}" for each in value)
    return value if isinstance(value, str) else value_text(value)
