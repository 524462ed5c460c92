"""A constellation on the globe, coloured by how long its manoeuvres take, and how those times are spread."""

from typing import Any, Protocol

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from jaxplan.plotting.projections import View, circle
from jaxplan.plotting.style import (
    GREY,
    KEEP_OUT,
    SMALL,
    TEXT,
    Canvas,
    Entries,
    Look,
    expect_view,
    legend_beside,
    new_figure,
    panels,
    plain,
    tidy,
)
from jaxplan.runtime.arguments import expect_like

_SIZE = (11.5, 5.0)  # inches
_EARTH: Look = {"facecolor": "#EAF1F6", "edgecolor": "0.6", "linewidth": 0.8}
_SUN = "#E69F00"
_OUT: Look = {"facecolors": "none", "edgecolors": "black", "linewidths": 1.0}
_COLOURS = "viridis"
_MOST = 0.99  # of the satellites, whose times the colours span
_FAR = 1.5  # times what most take: longer ones are named instead of drawn
_FEW_PLANES = 12  # that are drawn as lines
_BINS = 28
_BESIDE = np.deg2rad((-65.0, 20.0))  # azimuth from the Sun's and elevation of the eye


class Planned(Protocol):
    """A constellation whose satellites are planned, such as a `jaxplan.constellation.Constellation`.

    Attributes:
        switch: with its ``time`` (s), ``sun_direction`` (3,) or None, and ``shell``: with ``name``,
            ``altitude`` and ``radius`` (km), ``planes``, ``slots``, and ``positions(time)`` (T, 3) in km.
        planned: (N,) numbers of the satellites.
        duration: (N,) s; NaN without a trajectory.
        certified: (N,) bool.
        sun_outage: (N,) bool, whether a link leads through the Sun's cone.
        study: with its ``settings`` by dotted names.
    """

    @property
    def switch(self) -> Any: ...  # noqa: D102

    @property
    def planned(self) -> np.ndarray: ...  # noqa: D102

    @property
    def duration(self) -> np.ndarray: ...  # noqa: D102

    @property
    def certified(self) -> np.ndarray: ...  # noqa: D102

    @property
    def sun_outage(self) -> np.ndarray: ...  # noqa: D102

    @property
    def study(self) -> Any: ...  # noqa: D102


_PARTS = ("switch", "planned", "duration", "certified", "sun_outage", "study")


def constellation(
    result: Planned,
    ax: Canvas = None,
    *,
    minimum: Planned | None = None,
    view: tuple[float, float] | None = None,
    legend: bool = True,
) -> list[Axes]:
    """The shell around the Earth, each satellite coloured by its manoeuvre's time, and their histogram.

    Satellites behind the Earth are not seen, and those beyond its limb on the far side are paler. The bars of
    the histogram have the colours of the globe.

    Args:
        result: of `plan_constellation`.
        ax: two axes, a figure to put them in, or None for a new one.
        minimum: the same switch planned in the shortest time, for all or a sample of the satellites: its
            histogram is drawn as a line.
        view: inertial azimuth and elevation of the eye, deg; None for one with the Sun to the side.
        legend: whether to name marks and histograms beside the panels.

    Returns:
        The axes of globe and histogram.

    Raises:
        TypeError: if it is no constellation.
        ValueError: if nothing is planned, or another number of axes is given.

    Example:
        >>> jp.plot.constellation(jp.plan_constellation(switch))
    """
    for name, given in (("result", result), *([("minimum", minimum)] if minimum is not None else [])):
        expect_like(name, given, _PARTS, "a Constellation, as jp.plan_constellation returns")
    if not len(result.planned):
        raise ValueError("there are no satellites to draw yet")
    if ax is None:
        ax = new_figure(_SIZE)
    if isinstance(ax, Figure | SubFigure):
        ax = ax.subplots(1, 2, gridspec_kw={"width_ratios": [1.3, 1.0]})
    globe, histogram = panels(ax, 2, _SIZE)
    known = result.duration[np.isfinite(result.duration)]
    norm = Normalize(np.min(known), np.quantile(known, _MOST)) if len(known) else Normalize(0.0, 1.0)
    marks = _draw_globe(globe, result, norm, _view(result, view))
    curves = _draw_histogram(histogram, result, minimum, norm)
    if legend:
        legend_beside(histogram, [*curves, *marks])
    return [globe, histogram]


def _view(result: Planned, angles: tuple[float, float] | None) -> View:
    if angles is not None:
        expect_view(angles)
        return View.from_angles(*np.deg2rad(angles))
    sun = result.switch.sun_direction
    azimuth = 0.0 if sun is None else float(np.arctan2(sun[1], sun[0]))
    return View.from_angles(azimuth + _BESIDE[0], _BESIDE[1])


def _draw_globe(axes: Axes, result: Planned, norm: Normalize, view: View) -> Entries:
    """The Earth in units of its radius, with the satellites that can be seen; entries for a legend."""
    shell = result.switch.shell
    radius = shell.radius / (shell.radius - shell.altitude)
    places = shell.positions(result.switch.time)[result.planned] / (shell.radius - shell.altitude)
    _draw_earth(axes, view, radius)
    if shell.planes <= _FEW_PLANES:
        _draw_planes(axes, result, view)
    flat, depth = view.project(places), view.depth(places)
    seen = (depth >= 0) | (np.hypot(*flat.T) > 1)
    size = float(np.clip(9000 / shell.total, 8, 60))  # square points
    done = np.isfinite(result.duration) & result.certified
    for front, alpha in ((False, 0.35), (True, 1.0)):
        here = seen & done & ((depth >= 0) == front)
        axes.scatter(
            flat[here, 0],
            flat[here, 1],
            s=size,
            c=result.duration[here],
            cmap=_COLOURS,
            norm=norm,
            alpha=alpha,
            linewidths=0,
            zorder=2 + front,
        )
    entries: Entries = []
    out = seen & result.sun_outage
    if np.any(out):
        axes.scatter(flat[out, 0], flat[out, 1], s=2.2 * size, zorder=4, **_OUT)
        ring = Line2D([], [], linestyle="", marker="o", markersize=6, color="black", fillstyle="none")
        entries.append((ring, "a link leads\nthrough the Sun's cone"))
    lost = seen & ~done
    if np.any(lost):
        axes.scatter(
            flat[lost, 0], flat[lost, 1], s=size, color=KEEP_OUT, marker="x", linewidths=1.2, zorder=5
        )
        cross = Line2D([], [], linestyle="", marker="x", markersize=5, color=KEEP_OUT)
        entries.append((cross, "no certified plan"))
    _draw_sun(axes, result.switch.sun_direction, view, radius)
    image = axes.scatter([], [], c=[], cmap=_COLOURS, norm=norm)
    longer = np.any(result.duration > norm.vmax) if norm.vmax is not None else False
    bar = axes.figure.colorbar(
        image,
        ax=axes,
        location="left",
        shrink=0.75,
        aspect=30,
        pad=0.0,
        extend="max" if longer else "neither",
    )
    bar.set_label("manoeuvre time (s)", fontsize=TEXT)
    bar.ax.tick_params(labelsize=TEXT)
    plain(axes.set_title(shell.name, fontsize=TEXT + 1, loc="left"))
    return entries


def _draw_earth(axes: Axes, view: View, radius: float) -> None:
    reach = 1.16 * radius
    axes.set_aspect("equal")
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.set_axis_off()
    axes.add_artist(Circle((0, 0), 1, zorder=0.5, **_EARTH))
    meridians = [
        circle(np.array([np.cos(a), np.sin(a), 0.0]), np.pi / 2) for a in np.deg2rad(range(0, 180, 30))
    ]
    for line in [*meridians, *circle(np.array([0.0, 0.0, 1.0]), np.deg2rad(range(30, 180, 30)))]:
        near, _ = view.sides(line)
        axes.plot(*near.T, color="0.82", linewidth=0.5, zorder=0.7)
    eye = np.rad2deg([np.arctan2(*view.axes[2, 1::-1]), np.arcsin(view.axes[2, 2])])
    text = f"seen from azimuth {eye[0]:.0f}, elevation {eye[1]:.0f} deg (inertial); pale: beyond the limb"
    axes.text(0, -1.12 * radius, text, fontsize=SMALL, color=GREY, ha="center", va="top")


def _draw_planes(axes: Axes, result: Planned, view: View) -> None:
    """The orbits of a few planes, where the Earth is not in front of them."""
    shell = result.switch.shell
    period = np.linspace(0, shell.period, 181)
    ways = np.stack([shell.positions(time)[:: shell.slots] for time in period], axis=1)
    for way in ways / (shell.radius - shell.altitude):
        flat = view.project(way)
        hidden = (view.depth(way) < 0) & (np.hypot(*flat.T) < 1)
        axes.plot(*np.where(hidden[:, None], np.nan, flat).T, color="0.75", linewidth=0.7, zorder=1)


def _draw_sun(axes: Axes, sun: np.ndarray | None, view: View, radius: float) -> None:
    """An arrow towards the Sun at the edge of the picture; nothing where it is right in front or behind."""
    if sun is None:
        return
    toward = view.project(sun)
    length = float(np.hypot(*toward))
    if length < 0.1:
        return
    start, end, place = (scale * radius * toward / length for scale in (1.03, 1.15, 1.18))
    axes.annotate(
        "",
        (end[0], end[1]),
        (start[0], start[1]),
        arrowprops={"arrowstyle": "-|>", "color": _SUN, "linewidth": 1.6},
    )
    behind = "" if view.depth(sun) >= 0 else " (behind)"
    axes.text(
        float(place[0]),
        float(place[1]),
        f"Sun{behind}",
        fontsize=SMALL,
        color=_SUN,
        va="center",
        ha="left" if toward[0] > 0 else "right",
    )


def _draw_histogram(axes: Axes, result: Planned, minimum: Planned | None, norm: Normalize) -> Entries:
    """Shares of the satellites by manoeuvre time; entries for a legend."""
    tidy(axes)
    times = result.duration[np.isfinite(result.duration)]
    shortest = np.zeros(0) if minimum is None else minimum.duration[np.isfinite(minimum.duration)]
    entries: Entries = []
    if len(times):
        most = np.quantile(times, _MOST)
        end = np.max(times) if np.max(times) <= _FAR * most else 1.15 * most
        edges = np.linspace(min(np.min(times), np.min(shortest, initial=np.inf)), end, _BINS + 1)
        centres = (edges[1:] + edges[:-1]) / 2
        shares = 100 * np.histogram(times, edges)[0] / len(times)
        colours = colormaps[_COLOURS](norm(centres))
        axes.bar(centres, shares, width=np.diff(edges), color=colours, edgecolor="white", linewidth=0.4)
        middle = colormaps[_COLOURS](0.45)
        entries.append(
            (
                Patch(color=middle),
                f"{_named(result)}: {len(times)} satellites,\nmedian {np.median(times):.1f} s",
            )
        )
        longer = int(np.sum(times > end))
        if longer:
            text = f"{longer} longer,\nup to {np.max(times):.0f} s"
            axes.text(0.99, 0.12, text, transform=axes.transAxes, ha="right", fontsize=SMALL, color=GREY)
        if minimum is not None and len(shortest):
            counts = 100 * np.histogram(shortest, edges)[0] / len(shortest)
            axes.stairs(counts, edges, color="black", linewidth=1.4)
            text = f"{_named(minimum)}: {len(shortest)} satellites,\nmedian {np.median(shortest):.1f} s"
            entries.append((Line2D([], [], color="black", linewidth=1.4), text))
    axes.set_xlabel("manoeuvre time (s)", fontsize=TEXT)
    axes.set_ylabel("satellites (%)", fontsize=TEXT)
    count, total = int(np.sum(result.certified)), len(result.certified)
    axes.set_title(f"{count} of {total} planned and certified", fontsize=TEXT + 1, loc="left")
    return entries


def _named(result: Planned) -> str:
    """What the durations are: a word of the settings, or stretched."""
    return str(result.study.settings.get("trajectory.duration_s", "stretched"))
