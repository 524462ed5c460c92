"""A constellation on the globe, with satellites coloured by manoeuvre times, and a histogram of these times.

A *shell* is a Walker pattern of satellites on circular orbits of one altitude, in several planes. At a
*switch* they change their links to each other, for which each satellite makes a manoeuvre.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from jaxplan.constellation import Constellation
from jaxplan.plotting.projections import GlobeView, grid_lines
from jaxplan.plotting.style import (
    GREY,
    KEEP_OUT,
    SMALL,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Look,
    expect_view,
    legend_below,
    panels,
    plain,
    tidy,
)
from jaxplan.runtime.arguments import expect_any

_TEXT_WIDTH, _TEXT_HEIGHT = 0.4, 0.15  # fractions of the histogram's width and height that a text in it takes
_SIZE = (WIDTH, 4.5)  # inches
_EARTH: Look = {"facecolor": "#EAF1F6", "edgecolor": "0.6", "linewidth": 0.8}
_SUN_COLOUR = "#E69F00"
_MINIMUM_LINE: Look = {"color": "black", "linewidth": 1.4}  # of the histogram of `minimum`
# Marks of satellites with a link that is out, and of those without a plan: on the globe and in the legend.
_OUTAGE_MARK: Look = {"facecolors": "none", "edgecolors": "black", "linewidths": 1.0, "zorder": 4}
_OUTAGE_ENTRY: Look = {"marker": "o", "markersize": 6, "color": "black", "fillstyle": "none"}
_UNPLANNED_MARK: Look = {"color": KEEP_OUT, "marker": "x", "linewidths": 1.2, "zorder": 5}
_UNPLANNED_ENTRY: Look = {"marker": "x", "markersize": 5, "color": KEEP_OUT}
_COLOUR_MAP = "viridis"  # of manoeuvre times, on the globe and in the histogram
_COLOUR_QUANTILE = 0.99  # fraction of the satellites, by rising time, whose times the colours span
_AXIS_CUT_RATIO = 1.5  # multiple of the longest of these times: beyond it the axis is cut, which is written
_MAX_DRAWN_PLANES = 12  # largest number of planes whose orbits are drawn as lines
_BINS = 28  # of the histogram
_LEAST_SPAN = 0.05  # fraction of the longest time that the histogram spans at least
_EYE_OFFSET = np.deg2rad((-65.0, 20.0))  # rad: azimuth from the Sun's and elevation of the eye


def constellation(
    result: Constellation,
    ax: Canvas = None,
    *,
    minimum: Constellation | None = None,
    view: tuple[float, float] | None = None,
    legend: bool = True,
) -> list[Axes]:
    """Draw a shell around the Earth, its satellites coloured by manoeuvre times, and a histogram of these.

    Satellites behind the Earth are not drawn, and those on the far side beyond its limb are paler. The bars
    of the histogram have the colours of the satellites.

    Args:
        result: of `plan_constellation`.
        ax: two axes, a figure to put them in, or None for a new one.
        minimum: the same switch planned in the shortest time, for all satellites or a sample of them: its
            histogram is drawn as a line. None for none.
        view: inertial azimuth and elevation of the eye, deg; None for a view with the Sun to the side.
        legend: whether to explain marks and histograms below the histogram.

    Returns:
        The axes of globe and histogram.

    Raises:
        TypeError: if it is no constellation.
        ValueError: if nothing is planned, another number of axes is given, or the view is not two angles.

    Example:
        >>> jp.plot.constellation(jp.plan_constellation(switch))
    """
    for name, given in (("result", result), *([("minimum", minimum)] if minimum is not None else [])):
        expect_any(name, given, (Constellation,), "a Constellation, as jp.plan_constellation returns")
    if not len(result.planned):
        raise ValueError("there are no satellites to draw yet")
    globe, histogram = panels(ax, 2, _SIZE, columns=2, widths=(1.45, 1.0), shared=False)
    known = _certified_times(result)
    norm = (
        Normalize(np.min(known), np.quantile(known, _COLOUR_QUANTILE)) if len(known) else Normalize(0.0, 1.0)
    )
    marks = _draw_globe(globe, result, norm, _choose_view(result, view))
    curves = _draw_histogram(histogram, result, minimum, norm)
    if legend:
        legend_below(histogram, [*curves, *marks])
    return [globe, histogram]


def _choose_view(result: Constellation, angles: tuple[float, float] | None) -> GlobeView:
    """Return the view from azimuth and elevation of the eye, deg; for None with the Sun to the side."""
    if angles is not None:
        expect_view(angles)
        return GlobeView.from_angles(*np.deg2rad(angles))
    sun = result.switch.sun_direction
    azimuth = 0.0 if sun is None else float(np.arctan2(sun[1], sun[0]))
    return GlobeView.from_angles(azimuth + _EYE_OFFSET[0], _EYE_OFFSET[1])


def _draw_globe(axes: Axes, result: Constellation, norm: Normalize, view: GlobeView) -> Entries:
    """Draw the Earth, of radius 1, with the satellites that can be seen; returns legend entries.

    `norm` maps manoeuvre times in s to colours.
    """
    shell = result.switch.shell
    radius = shell.radius / (shell.radius - shell.altitude)
    places = shell.positions(result.switch.time)[result.planned] / (shell.radius - shell.altitude)
    _draw_earth(axes, view, radius)
    if shell.planes <= _MAX_DRAWN_PLANES:
        _draw_planes(axes, result, view)
    flat, depth = view.project(places), view.depth(places)
    seen = (depth >= 0) | (np.hypot(*flat.T) > 1)
    size = float(np.clip(9000 / shell.total, 8, 60))  # square points
    done = np.isfinite(result.duration) & result.certified
    colours: Look = {"cmap": _COLOUR_MAP, "norm": norm}
    for front, alpha in ((False, 0.35), (True, 1.0)):
        here = seen & done & ((depth >= 0) == front)
        look: Look = {"c": result.duration[here], "alpha": alpha, "linewidths": 0, "zorder": 2 + front}
        axes.scatter(flat[here, 0], flat[here, 1], s=size, **look, **colours)
    entries: Entries = []
    for which, share, looks, mark, text in (
        (result.sun_outage, 2.2, _OUTAGE_MARK, _OUTAGE_ENTRY, "a link leads\nthrough the Sun's cone"),
        (~done, 1.0, _UNPLANNED_MARK, _UNPLANNED_ENTRY, "no certified plan"),
    ):
        here = seen & which
        if np.any(here):
            axes.scatter(flat[here, 0], flat[here, 1], s=share * size, **looks)
            entries.append((Line2D([], [], linestyle="", **mark), text))
    _draw_sun(axes, result.switch.sun_direction, view, radius)
    plain(axes.set_title(shell.name, fontsize=TEXT + 1, loc="left"))
    return entries


def _draw_earth(axes: Axes, view: GlobeView, radius: float) -> None:
    """Draw the Earth with its grid, and fit the axes to a shell of a radius in radii of the Earth."""
    reach = 1.16 * radius
    axes.set_aspect("equal", anchor="N")
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.set_axis_off()
    axes.add_artist(Circle((0, 0), 1, zorder=0.5, **_EARTH))
    for line in grid_lines():
        (near, _), _ = view.parts(line)
        axes.plot(*near.T, color="0.82", linewidth=0.5, zorder=0.7)
    text = f"{view.words};\npale: beyond the limb; colours: times, as in the histogram"
    axes.text(0, -1.12 * radius, text, fontsize=SMALL, color=GREY, ha="center", va="top")


def _draw_planes(axes: Axes, result: Constellation, view: GlobeView) -> None:
    """Draw the orbit of each plane, without its part behind the Earth."""
    shell = result.switch.shell
    period = np.linspace(0, shell.period, 181)
    orbits = np.stack([shell.positions(time)[:: shell.slots] for time in period], axis=1)
    for orbit in orbits / (shell.radius - shell.altitude):
        flat = view.project(orbit)
        hidden = (view.depth(orbit) < 0) & (np.hypot(*flat.T) < 1)
        axes.plot(*np.where(hidden[:, None], np.nan, flat).T, color="0.75", linewidth=0.7, zorder=1)


def _draw_sun(axes: Axes, sun: np.ndarray | None, view: GlobeView, radius: float) -> None:
    """Draw an arrow toward the Sun at the edge of the picture.

    Nothing is drawn without a Sun, or if it is nearly in front of the eye or opposite.

    Args:
        axes: the globe.
        sun: (3,) unit vector, inertial, or None.
        view: of the globe.
        radius: of the shell, in radii of the Earth.
    """
    if sun is None:
        return
    toward = view.project(sun)
    length = float(np.hypot(*toward))
    if length < 0.1:
        return
    start, end, place = (scale * radius * toward / length for scale in (1.03, 1.15, 1.18))
    arrow = {"arrowstyle": "-|>", "color": _SUN_COLOUR, "linewidth": 1.6}
    axes.annotate("", tuple(end), tuple(start), arrowprops=arrow)
    text = "Sun" if view.depth(sun) >= 0 else "Sun (behind)"
    side = "left" if toward[0] > 0 else "right"
    axes.text(float(place[0]), float(place[1]), text, fontsize=SMALL, color=_SUN_COLOUR, va="center", ha=side)


def _draw_histogram(
    axes: Axes, result: Constellation, minimum: Constellation | None, norm: Normalize
) -> Entries:
    """Draw the histogram of certified manoeuvres' times, s, in percent of them; returns legend entries."""
    tidy(axes)
    times = _certified_times(result)
    shortest = np.zeros(0) if minimum is None else _certified_times(minimum)
    entries: Entries = []
    if len(times):
        most = np.quantile(times, _COLOUR_QUANTILE)
        end = np.max(times) if np.max(times) <= _AXIS_CUT_RATIO * most else 1.15 * most
        low = min(np.min(times), np.min(shortest, initial=np.inf))
        beside = max(_LEAST_SPAN * end - (end - low), 0) / 2  # bars of equal times need a width
        edges = np.linspace(low - beside, end + beside, _BINS + 1)
        colours = colormaps[_COLOUR_MAP](norm((edges[1:] + edges[:-1]) / 2))
        look: Look = {"align": "edge", "color": colours, "edgecolor": "white", "linewidth": 0.4}
        axes.bar(edges[:-1], _bin_percentages(times, edges), width=np.diff(edges), **look)
        entries.append((Patch(color=colormaps[_COLOUR_MAP](0.45)), _describe_times(result, times)))
        shares = [_bin_percentages(times, edges)]
        if minimum is not None and len(shortest):
            shares.append(_bin_percentages(shortest, edges))
            axes.stairs(shares[-1], edges, **_MINIMUM_LINE)
            entries.append((Line2D([], [], **_MINIMUM_LINE), _describe_times(minimum, shortest)))
        longer = int(np.sum(times > end))
        if longer:
            _write_longer_times(axes, f"{longer} longer,\nup to {np.max(times):.0f} s", shares)
    axes.set_xlabel("manoeuvre time (s)", fontsize=TEXT)
    axes.set_ylabel("satellites (%)", fontsize=TEXT)
    count, total = int(np.sum(result.certified)), len(result.certified)
    axes.set_title(f"{count} of {total}\nplanned and certified", fontsize=TEXT + 1, loc="left")
    return entries


def _write_longer_times(axes: Axes, text: str, shares: Sequence[np.ndarray]) -> None:
    """Write a text at the right end of a histogram, above the bars there.

    `shares` are the heights (b,) of the bars of each histogram, percent; the axis is raised if needed.
    """
    below = [own[-round(_TEXT_WIDTH * len(own)) :] for own in shares]
    low, high = axes.get_ylim()
    foot = max(float(np.max(own)) for own in below) + 0.03 * high
    axes.set_ylim(low, max(high, foot / (1 - _TEXT_HEIGHT)))
    look: Look = {"ha": "right", "va": "bottom", "fontsize": SMALL, "color": GREY}
    axes.text(0.99, foot, text, transform=axes.get_yaxis_transform(), **look)


def _certified_times(result: Constellation) -> np.ndarray:
    """Return the durations (k,) of the certified manoeuvres, s; those that failed have some as well."""
    return result.duration[np.isfinite(result.duration) & result.certified]


def _bin_percentages(times: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the percentage (b,) of all times (k,) that falls in each bin between edges (b + 1,)."""
    return 100 * np.histogram(times, edges)[0] / len(times)


def _describe_times(result: Constellation, times: np.ndarray) -> str:
    """Return the legend text of a histogram of times (k,), s: setting of the duration, count and median."""
    word = result.study.settings.get("trajectory.duration_s", "stretched")
    asked = word if isinstance(word, str) else f"{word:g} s"
    return f"{asked}: {len(times)} satellite{'s' * (len(times) != 1)},\nmedian {np.median(times):.1f} s"
