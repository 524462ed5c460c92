"""Figures of a plan as data, for pages that hold their pictures in themselves."""

import base64
import io
from collections.abc import Iterator
from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.figure import Figure

from jaxplan.plotting import globe_map
from jaxplan.plotting.whole_plan import figures

if TYPE_CHECKING:
    from jaxplan.planner import Plan

_DPI = 200  # of those that are no SVG


def inline_figures(plan: "Plan") -> Iterator[tuple[str, str]]:
    """The globe and the figures of a plan but the overview, which repeats the others.

    Args:
        plan: of any status; see `figures` for those that it has.

    Yields:
        The figure's name and its picture as a ``data:`` address, the same for the same plan: SVG with text as
        shapes, or PNG where there are hatched areas. The ground is transparent.
    """
    ball = Figure(figsize=globe_map.SIZE, layout="constrained")
    globe_map.globe(plan, ax=ball)
    yield "globe", _address(ball)
    for name, figure in figures(plan):
        if name != "overview":
            yield name, _address(figure)


def _address(figure: Figure) -> str:
    kind, content = "svg+xml", _picture(figure, "svg", {"Date": None, "Creator": None})
    if b"<pattern" in content:  # hatches lose their transparency in SVG, so that zones would print solid
        kind, content = "png", _picture(figure, "png", {"Software": None})
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _picture(figure: Figure, kind: str, metadata: dict[str, None]) -> bytes:
    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "jaxplan"}):  # else the names inside are random
        figure.savefig(file, format=kind, metadata=metadata, transparent=True, dpi=_DPI)
    return file.getvalue()
