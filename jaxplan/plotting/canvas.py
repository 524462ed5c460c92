"""Where a figure is drawn: on given axes, in a given figure, or in a new one.

A new figure belongs to pyplot where pyplot can show it: in a notebook it appears below its cell, with a
window system after ``plt.show()``. Where nothing can be shown (the backends that only write files) it is a
plain figure, which nobody has to close; save it with ``axes.figure.savefig(...)``.
"""

from collections.abc import Sequence
from typing import TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.registry import BackendFilter, backend_registry
from matplotlib.figure import Figure, SubFigure

from jaxplan.given import expect

Canvas: TypeAlias = Axes | Sequence[Axes] | np.ndarray | Figure | SubFigure | None


def new_figure(size: tuple[float, float]) -> Figure:
    """An empty figure that makes room for legends beside its axes.

    Args:
        size: width and height in inches.
    """
    if mpl.get_backend().lower() in backend_registry.list_builtin(BackendFilter.NON_INTERACTIVE):
        return Figure(figsize=size, layout="constrained")
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained")


def panels(
    where: Canvas,
    count: int,
    size: tuple[float, float],
    *,
    columns: int = 1,
    heights: Sequence[float] | None = None,
    alone: int = 0,
) -> list[Axes]:
    """The axes to draw on, from top to bottom, and of each row from left to right.

    Args:
        where: as many axes as panels, a figure to put them in, or None for a new one.
        count: of panels; new ones share their horizontal axis with those above and below.
        size: of a new figure, inches.
        columns: panels a row; new ones share their vertical axis.
        heights: of the rows, in proportion; equal if None.
        alone: of the columns, so many last ones have a vertical axis of their own.

    Raises:
        TypeError: if something else than axes is given.
        ValueError: if another number of axes is given.
    """
    if where is None:
        where = new_figure(size)
    if isinstance(where, Figure | SubFigure):
        shape = (count // columns, columns)
        spread = {"height_ratios": heights, "wspace": None if columns == 1 else 0.04}
        grid = where.subplots(*shape, sharex="col", squeeze=False, gridspec_kw=spread)
        for row in grid:
            for axes in row[1 : columns - alone]:
                axes.sharey(row[0])
                axes.tick_params(axis="y", labelleft=False)
        return list(grid.ravel())
    given: list[Axes] = list(np.ravel(np.asarray(where, dtype=object)))
    for one in given:
        expect("ax", one, Axes, "give axes, as many as panels, or a figure to put them in")
    if len(given) != count:
        raise ValueError(
            f"the figure has {count} panel{'s' * (count != 1)}, but {len(given)} axes were given"
        )
    return given
