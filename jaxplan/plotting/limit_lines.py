"""Lines at limits in panels over time: how they look, whose they are, and those too far away to be drawn."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withTickedStroke

from jaxplan.plotting.style import GREY, HALO, SMALL, Entries, Look, plain

_MOST_OWNERS = 3  # names of curves that a limit has beside it
_STILL = 1e-3  # share of a limit below which curves count as standing still


def barrier(side: int) -> Look:
    """Look of a solid line with ticks on the side that is out of bounds: above for 1, below for -1.

    Curves have no ticks, so whatever its colour a limit is not taken for one of them.
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
    """Draw least and largest values as lines, or write those far from the curves above the panel.

    Where limits differ, what is written, and a line of several curves, say whose they are.

    Args:
        axes: where to.
        ends: (c, 2) the least and the largest value of each curve of the panel, in its unit; an infinite one
            is none.
        styles: of the curves. A limit of one curve among several has its colour, one of more curves is grey.
        highest: largest magnitude of the curves.
        far: a limit beyond this multiple of `highest` is written, since the curves would shrink to a line.
            Where nearly nothing moves every limit is drawn, or the panel would show rounding errors.
        name: what to call the limit.
        look: of its lines in place of a `barrier`.
        owners: names of the curves; none for those that nobody has to tell apart.

    Returns:
        Entry for a legend; none where no limit is drawn.
    """
    several = len(np.unique(np.round(ends, 9), axis=0)) > 1
    drawn, told, named = False, dict[float, list[int]](), set[float]()
    for side, values in zip((1, -1), ends.T[::-1], strict=True):
        for value in np.unique(np.round(values[np.isfinite(values)], 9)):
            own = np.flatnonzero(np.isclose(values, value, rtol=0, atol=1e-8)).tolist()
            if far * highest < abs(value) and highest >= _STILL * abs(value):
                told[abs(float(value))] = own
                continue
            colour = styles[own[0]]["color"] if several and len(own) == 1 else GREY
            if several and len(own) > 1 and owners and abs(value) not in named:
                named.add(abs(value))
                _name_limit(axes, float(value), side, f"{name} of {_listed(owners, own)}")
            axes.axhline(value, color=colour, zorder=1.5, **(barrier(side) if look is None else look))
            drawn = True
    if told:
        whose = {
            value: f" {_listed(owners, own)}" if several and owners else "" for value, own in told.items()
        }
        words = f"{name}{'s' * (len(told) > 1)} {', '.join(f'±{v:.3g}{whose[v]}' for v in sorted(told))}"
        place: Look = {"xy": (1, 1), "xycoords": "axes fraction", "xytext": (0, 2), "ha": "right"}
        axes.annotate(words, textcoords="offset points", va="bottom", color=GREY, fontsize=SMALL, **place)
    return [(Line2D([], [], color=GREY, **(barrier(1) if look is None else look)), name)] if drawn else []


def _name_limit(axes: Axes, value: float, side: int, words: str) -> None:
    """Say whose a limit is, at the right end of its line and on the side of the curves."""
    place: Look = {"xytext": (-2, -side * 2), "textcoords": "offset points", "ha": "right"}
    height: Look = {"va": "top" if side > 0 else "bottom", "color": GREY, "fontsize": SMALL - 1, "zorder": 3}
    where: Look = {"xycoords": ("axes fraction", "data"), "path_effects": HALO["path_effects"]}
    plain(axes.annotate(words.replace("\n", " "), (1, value), **place, **height, **where))


def _listed(names: Sequence[str], own: Sequence[int]) -> str:
    """Names of curves by their numbers in a few words."""
    few = [names[number] for number in own[: _MOST_OWNERS - (len(own) > _MOST_OWNERS)]]
    more = len(own) - len(few)
    return " and ".join([", ".join(few), f"{more} more"]) if more else " and ".join(few)


def both_sides(limits: np.ndarray) -> np.ndarray:
    """Least and largest values (c, 2) that limits (c,) of magnitudes allow."""
    return np.stack([-limits, limits], axis=-1)
