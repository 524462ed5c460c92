"""Spans of time during which targets are hidden: behind the Earth, below their horizon, or otherwise.

A target that is hidden when the manoeuvre ends cannot be pointed at. Times are seconds from the start of the
manoeuvre on. `jaxplan.sky` computes the spans.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

from jaxplan.model.keys import key
from jaxplan.runtime.display import shown

UNNAMED = "target"
"""Name of a hidden target to which nobody gave one."""


@shown("target", "by", "start s", "end s")
@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A span of time during which a target is hidden.

    Attributes:
        target: name of what is hidden.
        by: what hides it.
        start: s, from when on.
        end: s, until when; then it is seen, unless something else hides it or nothing is known any more.
    """

    target: str = field(metadata=key("target", "name of what is hidden"))
    by: str = field(metadata=key("by", "what hides it"))
    start: float = field(metadata=key("from_s", "from when on", "[-1e7, 1e7]"))
    end: float = field(metadata=key("to_s", "until when; then it is seen", "[-1e7, 1e7]"))

    def at(self, time: float) -> bool:
        """Whether the target is hidden at a time, s."""
        return self.start <= time < self.end


def after_hidden(spans: Iterable[Hidden], time: float) -> float:
    """The first time, s, at or after `time` that is in none of the spans."""
    every = sorted(spans, key=lambda span: span.start)
    for span in every:
        if span.at(time):
            time = span.end
    return time
