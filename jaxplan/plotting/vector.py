"""Figures of a plan as SVG, for pages that hold their pictures in themselves."""

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.figure import Figure

from jaxplan.plotting import globe_map
from jaxplan.plotting.whole_plan import figures

if TYPE_CHECKING:
    from jaxplan.planner import Plan


def vector_figures(plan: "Plan") -> Iterator[tuple[str, str]]:
    """The globe and the figures of a plan but the overview, which repeats the others.

    Args:
        plan: of any status; see `figures` for those that it has.

    Yields:
        The figure's name and its SVG, the same for the same plan. Text is drawn as shapes, so that it looks
        the same wherever it is shown; the ground is transparent.
    """
    ball = Figure(figsize=globe_map.SIZE, layout="constrained")
    globe_map.globe(plan, ax=ball)
    yield "globe", _svg(ball)
    for name, figure in figures(plan):
        if name != "overview":
            yield name, _svg(figure)


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "jaxplan"}):  # else the names inside are random
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    return text.getvalue()
