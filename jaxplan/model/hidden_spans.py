"""Spans of time during which targets are hidden: behind the Earth, below their horizon, or otherwise.

A device cannot point at a target that is hidden when the manoeuvre ends, nor start from one that is hidden
when it begins. Times are seconds from the start of the manoeuvre. `jaxplan.sky` computes the spans.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from jaxplan.model.file_keys import key
from jaxplan.runtime.display import shown

UNNAMED = "target"
"""Name of a hidden target to which nobody gave one."""


@shown("target", "by", "start s", "end s")
@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A span of time during which a target is hidden.

    Attributes:
        target: name of the target.
        by: name of what hides it.
        start: s, from when it is hidden.
        end: s, until when. From then on it is visible, unless another span hides it or its path is known no
            longer.
    """

    target: str = field(metadata=key("target", "name of what is hidden"))
    by: str = field(metadata=key("by", "what hides it"))
    start: float = field(metadata=key("from_s", "from when on", "[-1e7, 1e7]"))
    end: float = field(metadata=key("to_s", "until when; then it is seen", "[-1e7, 1e7]"))

    def at(self, time: float) -> bool:
        """Tell whether this span hides the target at a time, s.

        The start is part of the span, the end is not.
        """
        return self.start <= time < self.end


def after_hidden(spans: Iterable[Hidden], time: float) -> float:
    """Return the first time, s, at or after `time` that lies in none of the spans."""
    every = sorted(spans, key=lambda span: span.start)
    for span in every:
        if span.at(time):
            time = span.end
    return time


def hidden_words(spans: Iterable[Hidden], device: str, time: float, known: float, when: str) -> str | None:
    """Say that the target of a device is hidden at a time, by what, and from when it can be seen again.

    Args:
        spans: the spans in which the target is hidden.
        device: name of the device.
        time: s.
        known: s, until when the spans are known.
        when: words for the time in the phrase.

    Returns:
        The phrase; None where the target is visible.
    """
    spans = tuple(spans)
    there = [span for span in spans if span.at(time)]
    if not there:
        return None
    seen = after_hidden(spans, time)
    again = f"it is seen from {rounded_up(seen)} s on"
    if seen > known:
        again = f"it is not seen again in all the {known:g} s that are known"
    by = " and ".join(dict.fromkeys(span.by for span in there))
    return f"{there[0].target}, the target of {device}, is hidden by {by} {when}; {again}"


def rounded_up(time: float) -> str:
    """Return a time, s, as text, rounded up to hundredths so that it is never too early."""
    return f"{np.ceil(time * 100) / 100:.12g}"
