"""Counting attempts, each of which follows from a seed: one that raises, or takes too long, is a failure."""

import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from tqdm import tqdm

SHOWN = 6  # seeds of failures in the table; all stand on stderr


@dataclass(frozen=True, kw_only=True)
class Tally:
    """What was counted.

    Attributes:
        what: was tried.
        count: attempts.
        failures: their seeds, or names.
        note: further counts.
        replay: words of the command that repeats one of them, before its seed.
    """

    what: str
    count: int
    failures: Sequence[object] = ()
    note: str = ""
    replay: str = ""


def tally(
    what: str, seeds: Iterable[object], attempt: Callable[..., object], *, limit_s: float = 600.0
) -> Tally:
    """Count attempts; the words that they return are counted into the note.

    Args:
        what: is tried.
        seeds: of the attempts.
        attempt: called with each seed.
        limit_s: after which an attempt counts as hanging, s.
    """
    failures, words, count = [], Counter(), 0
    for seed in tqdm(seeds, desc=what, leave=False, disable=None):
        count += 1
        try:
            with ended_after(limit_s):
                word = attempt(seed)
        except Exception as error:
            failures.append(seed)
            print(f"{what}, seed {seed}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
        else:
            words.update([word] if isinstance(word, str) else word or ())
    note = ", ".join(f"{number} {word}" for word, number in sorted(words.items()))
    return Tally(what=what, count=count, failures=failures, note=note)


@contextmanager
def ended_after(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in the block once it has taken so long, wherever it is; in the main thread only."""

    def end(*_: object) -> None:
        raise TimeoutError(f"took more than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def table(tallies: Sequence[Tally]) -> str:
    """The counts as one table."""
    rows = [("what", "count", "failures", "note", "seeds to replay")]
    for one in tallies:
        seeds = ", ".join(map(str, one.failures[:SHOWN])) + (" ..." if len(one.failures) > SHOWN else "")
        again = f"{one.replay} {seeds}".strip() if one.failures else ""
        rows.append((one.what, f"{one.count:,}", f"{len(one.failures):,}", one.note, again))
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    lines = []
    for what, count, failures, note, again in rows:
        cells = [
            what.ljust(widths[0]),
            count.rjust(widths[1]),
            failures.rjust(widths[2]),
            note.ljust(widths[3]),
        ]
        lines.append("  ".join([*cells, again]).rstrip())
    return "\n".join([lines[0], "-" * max(map(len, lines)), *lines[1:]])
