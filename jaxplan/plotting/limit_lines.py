"""Lines at limits in panels over time: their look, their owners, and limits too far away to be drawn.

A limit belongs to one or several curves of a panel, its *owners*. A limit that is much larger than all curves
is not drawn but written above the panel, since the curves would shrink to a line.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withTickedStroke

from jaxplan.plotting.style import GREY, HALO, SMALL, Entries, Look, plain

_MAX_OWNERS = 3  # most names of curves beside a limit; of more curves two names and a count
_STILL_RATIO = 1e-3  # fraction of a limit below which curves count as standing still


def barrier(side: int) -> Look:
    """Return the look of a solid line with ticks on the side out of bounds: above for 1, below for -1.

    Curves have no ticks, so a limit of any colour is not mistaken for a curve.
    """
    ticks = withTickedStroke(angle=side * 60, spacing=7, length=0.6)
    return {"linewidth": 1, "linestyle": "-", "path_effects": [ticks]}


def limit_lines(
    axes: Axes,
    ends: np.ndarray,
    styles: Sequence[Look],
    highest: float,
    *,
    far: float,
    name: str = "limit",
    look: Look | None = None,
    owners: Sequence[str] = (),
) -> Entries:
    """Draw the limits of a panel's curves as lines, and write those far from the curves above the panel.

    Where limits differ between curves, what is written, and a line for several curves, name these.

    Args:
        axes: the panel.
        ends: (c, 2) least and largest allowed value of each of the c curves, in the panel's unit; an infinite
            one is no limit.
        styles: of the curves. A limit of one curve among several has the curve's colour, any other is grey.
        highest: largest magnitude of the curves.
        far: a limit beyond this multiple of `highest` is written instead of drawn. Where nearly nothing moves
            every limit is drawn, or the panel would show rounding errors.
        name: what the limit is called.
        look: of its lines; None for a `barrier`.
        owners: names of the curves; empty if they need not be told apart.

    Returns:
        One legend entry, or none if no limit is drawn.
    """
    several = len(np.unique(np.round(ends, 9), axis=0)) > 1
    drawn, told, named = False, dict[float, list[int]](), set[float]()
    for side, values in zip((1, -1), ends.T[::-1], strict=True):
        for value in np.unique(np.round(values[np.isfinite(values)], 9)):
            own = np.flatnonzero(np.isclose(values, value, rtol=0, atol=1e-8)).tolist()
            if far * highest < abs(value) and highest >= _STILL_RATIO * abs(value):
                told[abs(float(value))] = own
                continue
            colour = styles[own[0]]["color"] if several and len(own) == 1 else GREY
            if several and len(own) > 1 and owners and abs(value) not in named:
                named.add(abs(value))
                _name_limit(axes, float(value), side, f"{name} of {_join_names(owners, own)}")
            axes.axhline(value, color=colour, zorder=1.5, **(barrier(side) if look is None else look))
            drawn = True
    if told:
        whose = {
            value: f" {_join_names(owners, own)}" if several and owners else "" for value, own in told.items()
        }
        words = f"{name}{'s' * (len(told) > 1)} {', '.join(f'±{v:.3g}{whose[v]}' for v in sorted(told))}"
        place: Look = {"xy": (1, 1), "xycoords": "axes fraction", "xytext": (0, 2), "ha": "right"}
        axes.annotate(words, textcoords="offset points", va="bottom", color=GREY, fontsize=SMALL, **place)
    return [(Line2D([], [], color=GREY, **(barrier(1) if look is None else look)), name)] if drawn else []


def _name_limit(axes: Axes, value: float, side: int, words: str) -> None:
    """Write whose a limit is at the right end of its line, on the side of the curves.

    `side` is 1 for an upper limit and -1 for a lower one.
    """
    place: Look = {"xytext": (-2, -side * 2), "textcoords": "offset points", "ha": "right"}
    height: Look = {"va": "top" if side > 0 else "bottom", "color": GREY, "fontsize": SMALL - 1, "zorder": 3}
    where: Look = {"xycoords": ("axes fraction", "data"), "path_effects": HALO["path_effects"]}
    plain(axes.annotate(words.replace("\n", " "), (1, value), **place, **height, **where))


def _join_names(names: Sequence[str], own: Sequence[int]) -> str:
    """Join the names of curves `own`, by number, to a short text; of many it ends in "and 5 more"."""
    few = [names[number] for number in own[: _MAX_OWNERS - (len(own) > _MAX_OWNERS)]]
    more = len(own) - len(few)
    return " and ".join([", ".join(few), f"{more} more"]) if more else " and ".join(few)


def both_sides(limits: np.ndarray) -> np.ndarray:
    """Return least and largest values (c, 2) that limits (c,) on magnitudes allow."""
    return np.stack([-limits, limits], axis=-1)
