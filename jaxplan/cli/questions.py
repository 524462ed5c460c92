"""Questions to a user, one to a line, whose answers are checked as the values of a scenario file are.

A question asks for a key of the file. Its explanation comes from the layout by which files are read, and its
answer is checked by the same reader, with the same messages, and asked for again until it is good. Questions
and messages go to one stream, answers come from another, so that a file or a pipe may give them.

An answer is a number, several numbers with blanks or commas between them, a word, ``yes`` or ``no``, ``x``,
``-x`` and so on for an axis, or any TOML value. An empty answer takes the default, which is in brackets.
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

_AXIS_VECTORS = {
    f"{sign}{letter}": [factor * float(letter == axis) + 0.0 for axis in "xyz"]
    for sign, factor in (("", 1.0), ("+", 1.0), ("-", -1.0))
    for letter in "xyz"
}
_WORD_KINDS = (Text, Name, Choice, Epoch)  # kinds whose values are words, which need no quotes here
_LINE_WIDTH = 100  # characters of a line at most
_YES_NO_ANSWERS = {"yes": True, "y": True, "no": False, "n": False}

NOTHING: Any = object()
"""The default of a question whose key may be left out."""
Check = Callable[[Any], Sequence[str]]
"""Function of an answer's value that returns its faults."""


_MAX_REFUSALS = 10  # equal refusals after which answers from a file or pipe are given up


class AnswersEnded(ValueError):
    """Error where answers end before the questions, or are refused again and again; nothing is written."""


class Dialog:
    """Asks for values of a file; when a question is asked again, the earlier answer is its default.

    Args:
        answers: stream of answers, one to a line.
        out: stream for questions and messages.
        folder: folder of the file, to which paths in answers are relative.
    """

    def __init__(self, answers: TextIO, out: TextIO, folder: str | os.PathLike[str] = "") -> None:
        self._answers, self._out, self.folder = answers, out, folder
        self._explained: set[str] = set()
        self._earlier_answers: dict[str, Any] = {}
        self._refusal_counts: Counter[str] = Counter()

    def say(self, text: str = "") -> None:
        """Write a paragraph, wrapped; an empty one is a blank line."""
        further = "    " if text.startswith(" ") else ""
        for line in textwrap.wrap(text, _LINE_WIDTH, subsequent_indent=further) or [""]:
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
        """Ask for the value of a key until the answer is valid in a file.

        Args:
            path: keys and indices that lead to the key's table.
            key: the key; or the name of something else, where `kind` and `words` are given.
            default: value for an empty answer; None where an answer is required, `NOTHING` where the key may
                be left out.
            kind: kind of the value; None for that of the key in the file's layout.
            words: explanation; empty for that of the layout.
            reading: makes the reading that checks the answer, which may know names of devices.
            table: the layout's table that has the key, where the path may lead to several.

        Returns:
            The value as a file has it, or `NOTHING` if the key is left out.

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

        return self._ask_until_valid(".".join(map(str, (*path, key))), key, words, kind, default, faults)

    def choose(self, name: str, words: str, options: Sequence[str], default: str) -> str:
        """Ask for one of several words; `words` is the explanation."""
        kind = Choice(options)
        return str(self._ask_without_key(name, f"{words}: {kind.wanted.replace(chr(34), '')}", kind, default))

    def count(self, name: str, words: str, default: int, most: int = 100) -> int:
        """Ask for a whole number from 0 to `most`; `words` is the explanation."""
        kind = Integer(Interval(f"[0, {most}]"))
        return int(self._ask_without_key(name, words, kind, default))

    def line(self, name: str, words: str) -> str:
        """Ask for a line of text; `words` is the explanation."""
        return str(self._ask_without_key(name, words, Text(), None))

    def confirm(self, name: str, words: str, default: bool) -> bool:
        """Ask a yes-or-no question; `words` is the explanation."""
        return bool(self._ask_without_key(name, words, YesNo(), default))

    def forget(self) -> None:
        """Let the explanations be printed again with the next questions, since these are repeated."""
        self._explained.clear()

    def faulty(self, faults: Sequence[str]) -> None:
        """Print what is wrong with an answer.

        Raises:
            AnswersEnded: if the same fault occurred `_MAX_REFUSALS` times and the answers do not come from a
                terminal.
        """
        for fault in faults:
            self.say(f"  ! {fault}")
            self._refusal_counts[fault] += 1
            if self._refusal_counts[fault] >= _MAX_REFUSALS and not self._answers.isatty():
                told = f"the answers were refused {_MAX_REFUSALS} times, so nothing was written: {fault}"
                raise AnswersEnded(told)

    def _ask_without_key(self, name: str, words: str, kind: Kind, default: Any) -> Any:
        """Ask for a value that is not a key of the file; arguments as in `_ask_until_valid`."""

        def faults(value: Any) -> Sequence[str]:
            place = Place(Reading())[name]
            kind.read(value, place)
            return place.reading.faults

        return self._ask_until_valid(name, name, words, kind, default, faults)

    def _ask_until_valid(
        self, about: str, name: str, words: str, kind: Kind, default: Any, faults: Check
    ) -> Any:
        """Ask until an answer has no faults; returns its value, which becomes the default when asked again.

        Args:
            about: full name of the question, by which an earlier answer is found.
            name: what is printed in front of the default.
            words: explanation, printed unless it was printed before.
            kind: kind of the value.
            default: see `ask`.
            faults: function that returns the faults of a value.

        Raises:
            AnswersEnded: if there is no further answer, or they are refused again and again.
        """
        default = self._earlier_answers.get(about, default)
        if words not in self._explained:
            self._explained.add(words)
            self.say(f"  # {words}")
        shown = "" if default is None else f" [{'none' if default is NOTHING else _format_answer(default)}]"
        while True:
            print(f"  {name}{shown}: ", end="", file=self._out, flush=True)
            line = self._answers.readline()
            if not line:
                print(file=self._out)
                raise AnswersEnded(f"the answers ended at {about}, so nothing was written")
            answer = line.strip()
            if not self._answers.isatty():  # repeat an answer from a file or pipe behind its question
                print(answer, file=self._out)
            if not answer and default is NOTHING:
                return NOTHING
            value = value_of(answer, kind) if answer else default
            wrong = ["must be answered"] if value is None else faults(value)
            if not wrong:
                self._earlier_answers[about] = value
                return value
            self.faulty(wrong)


def value_of(answer: str, kind: Kind) -> Any:
    """Convert an answer to the value that a file would have.

    Args:
        answer: a line, not blank.
        kind: kind of the value asked for, which decides whether a word needs quotes.

    Returns:
        The value, which is not checked; an answer that cannot be parsed is returned as text.
    """
    bare = re.sub(r'^(["\'])(.*)\1$', r"\2", answer)
    if isinstance(kind, _WORD_KINDS):
        return bare
    if isinstance(kind, Names):
        return [name.strip() for name in answer.strip("[]").replace('"', "").split(",") if name.strip()]
    if isinstance(kind, YesNo) and answer.lower() in _YES_NO_ANSWERS:
        return _YES_NO_ANSWERS[answer.lower()]
    if answer.lower() in _AXIS_VECTORS:
        return list(_AXIS_VECTORS[answer.lower()])
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


def _format_answer(value: Any) -> str:
    """A value as text in the form in which a user would answer."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list) and all(isinstance(each, str) for each in value):
        return ", ".join(value)
    if isinstance(value, list) and not any(isinstance(each, list) for each in value):
        return " ".join(f"{each:g}" for each in value)
    return value if isinstance(value, str) else value_text(value)
