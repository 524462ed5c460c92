"""The ground track: where on the turning Earth the spacecraft is overhead, and what its boresights look at.

Places are geodetic, on the ellipsoid of WGS 84, whose axes turn with the Earth (`jaxplan.sky.frames`). A
boresight meets the ellipsoid at its first crossing; while it looks past the Earth its track has a gap, and
the legend gives the fraction of time in which it meets. Clouds, night and terrain hide nothing. The map is
plain (longitude against latitude) with a grid and coasts, of the whole Earth or, if everything is close
together, of the region.

A plan holds only directions to its targets. A *site* is a target on the ground: it is recognised by its lines
of sight, which meet in one point of the turning Earth near its surface.

Outlines of land are those of Natural Earth (public domain), simplified, in two files beside this one, whose
heads give details: coast.json for maps of the whole Earth, with errors of up to 0.3 deg, and coast_fine.json
for maps of a region, with errors of up to 0.07 deg. Smaller islands are missing. An outline that crosses
longitude 180 deg continues beyond it, and is given twice, 360 deg apart, so that the part inside the map is
seen at both edges. The outline of Antarctica goes once around the Earth and is open.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from jaxplan import sky
from jaxplan.geometry.vectors import pointing
from jaxplan.model.directions import DirectionPath
from jaxplan.model.goals import GivenState
from jaxplan.planner import Plan
from jaxplan.plotting.frames import Orbital, orbit_of
from jaxplan.plotting.projections import cut, over_poles
from jaxplan.plotting.sky import BETWEEN, FOLLOWED, TRACK, crowded, followed, followed_entry
from jaxplan.plotting.style import (
    HALO,
    SMALL,
    TEXT,
    WIDTH,
    Canvas,
    Entries,
    Labels,
    Look,
    device_style,
    expect_plan,
    legend_beside,
    motion,
    panels,
    plain,
    tidy,
)
from jaxplan.runtime.arguments import show
from jaxplan.sky.frames import gcrs_to_earth
from jaxplan.sky.ground import geodetic, surface_point
from jaxplan.timeline.record import TimelinePlan

# Files of outlines of land, for maps of the whole Earth and for those of a region.
FILE, FINE = (Path(__file__).with_name(f"{name}.json") for name in ("coast", "coast_fine"))
_UNITS = {FILE: 0.1, FINE: 0.01}  # deg: unit of the whole numbers in each file
_MAP_EDGE, _FULL_TURN = 180.0, 360.0  # deg of longitude: right edge of a map, and a full turn
GROUND_SIZE = (WIDTH, 4.4)  # inches
_TRACK_LINE: Look = {"color": "black", "linewidth": 1.0, "zorder": 2.5}
_START_MARK: Look = {"marker": "*", "markersize": 11, "linestyle": "none", "color": "black"}
_END_MARK: Look = {"marker": "s", "markersize": 8, "linestyle": "none", "fillstyle": "none", "color": "black"}
_SITE_MARK: Look = {"marker": "^", "markersize": 7, "linestyle": "none", "color": "#1B7837", "zorder": 4.5}
_LAND: Look = {"facecolor": "#EFE6D3", "edgecolor": "none", "zorder": 0.3}
_COAST: Look = {"color": "0.55", "linewidth": 0.6, "zorder": 0.5}
_NIGHT: Look = {"facecolor": "black", "alpha": 0.13}
_MAX_REGION = np.array([120.0, 80.0])  # deg: largest extents in longitude and latitude of a map of a region
_FINE_COAST_WIDTH = 80.0  # deg: width of the map in longitude, below which the finer coasts are drawn
_MIN_EXTENT, _PADDING = 8.0, 0.12  # of a region: deg, and fraction of its extent added to each side
_SIGHT_LINES = 65  # lines of sight by which a place on the ground is found
_MAX_MISS = 1.0  # km: distance by which these may miss it
_GROUND_HEIGHTS = (-10e3, 100e3)  # m: range of heights above the ellipsoid in which it may lie
_MIN_PARALLAX = 1e-6  # least eigenvalue of the mean projection across them; below, they are nearly parallel
_NIGHT_STEP = 0.5  # deg: step of the grid on which the night is computed
_LETTER_WIDTH, _NAME_GAP = 0.075, 0.09  # inches: of a letter, at most; between a mark's middle and its name


class _Site(NamedTuple):
    """A target on the ground: its name and its place, (2,) longitude (east) and geodetic latitude, deg."""

    name: str
    place: np.ndarray


def ground_track(
    plan: Plan | TimelinePlan,
    observer: sky.Satellite | None = None,
    ax: Canvas = None,
    *,
    legend: bool = True,
) -> Axes:
    """Draw the ground track of an Earth observer, and where its boresights meet the Earth.

    Devices are instruments and terminals; drives, such as solar arrays, are left out. A track has a gap while
    its boresight looks past the Earth, and the legend gives the fraction of time in which it meets the Earth.
    Targets on the ground are marked with their names. It is night where the map is grey, at the middle of the
    plan's time.

    Args:
        plan: a plan with a trajectory, also one of a timeline.
        observer: the spacecraft's orbit, one of `jaxplan.sky`; required, since a plan does not hold it.
        ax: axes, a figure to put them in, or None for a new one.
        legend: whether to name what is drawn beside the map.

    Returns:
        The axes: longitude, positive to the east, and geodetic latitude, deg.

    Raises:
        TypeError: if it is no plan, or the observer no orbit.
        ValueError: if the orbit, the epoch or a trajectory is missing, or more than one axes is given.
        ImportError: if the extra ``orbit`` is not installed.

    Example:
        >>> jp.plot.ground_track(plan, jp.load_observer("scene.toml"))
    """
    day = plan if isinstance(plan, TimelinePlan) else None
    plan = expect_plan(plan)
    orbit = orbit_of(plan, observer, "ground_track")
    moves, craft = motion(plan), plan.scenario.spacecraft
    (axes,) = panels(ax, 1, GROUND_SIZE)
    tidy(axes)
    axes.spines[["top", "right"]].set_visible(True)
    to_earth = gcrs_to_earth(orbit.epoch, moves.times)
    there = _earth_fixed_positions(orbit, moves.times, to_earth)
    below = _to_geodetic(there)
    looks = np.einsum("kij,kdj->kdi", to_earth, moves.boresights)
    meets = _to_geodetic(surface_point(there[:, None], looks))
    entries: Entries = [(Line2D([], [], **_TRACK_LINE), "below the spacecraft")]
    axes.plot(*cut(over_poles(below)).T, **_TRACK_LINE)
    missing, n, spans, left_out = [], len(craft.terminals), followed(plan), crowded(plan)
    for device, name in enumerate(craft.device_names):
        if n <= device < n + len(craft.drives):
            continue
        track, look = meets[:, device], {**(BETWEEN if spans else TRACK), **device_style(device)}
        share = _time_share(moves.times, np.isfinite(track[:, 0]))
        if share == 0:
            missing.append(name)
            continue
        if device not in left_out:
            axes.plot(*cut(over_poles(track)).T, **look)
        for _, start, end in (span for span in spans if span[0] == device):
            bold = track[(moves.times >= start) & (moves.times <= end)]
            axes.plot(*cut(over_poles(bold)).T, color=look["color"], **FOLLOWED)
        told = "" if share == 1 else f",\nmeets the Earth\n{_format_percent(share)} of the time"
        entries.append((Line2D([], [], **look), f"{name}{told}"))
    entries += followed_entry(plan)
    if missing:
        entries.append(
            (Line2D([], [], linestyle="none"), "\n".join(["past the Earth all the time:", *missing]))
        )
    for mark, place, word in ((_START_MARK, below[0], "start"), (_END_MARK, below[-1], "end")):
        axes.plot(*place[:, None], zorder=4, **mark)
        entries.append((Line2D([], [], **mark), word))
    sites = list(_find_sites(day or plan, plan, orbit))
    for site in sites:
        axes.plot(*site.place[:, None], **_SITE_MARK)
    if sites:
        entries.append((Line2D([], [], **_SITE_MARK), "target on the ground"))
    drawn = [below, *np.moveaxis(meets, 1, 0), *(site.place[None] for site in sites)]
    _set_map_limits(axes, np.concatenate([points[np.isfinite(points[:, 0])] for points in drawn]))
    _draw_land(axes)
    _name_sites(axes, sites, np.concatenate(drawn))
    middle = float(moves.times[-1]) / 2
    if _draw_night(axes, orbit, middle):
        entries.append((Patch(**_NIGHT), f"night at {_format_clock(orbit.epoch, middle)}"))
    span = f"{_format_utc(orbit.epoch, 0.0)} to {_format_clock(orbit.epoch, float(moves.times[-1]))} UTC"
    plain(axes.set_title(f"{plan.scenario.name}: ground track\n{span}", fontsize=TEXT + 1, loc="left"))
    axes.set_xlabel("longitude, to the east (deg)", fontsize=TEXT)
    axes.set_ylabel("geodetic latitude (deg)", fontsize=TEXT)
    if legend:
        legend_beside(axes, entries)
    return axes


def has_tracks(plan: Plan | TimelinePlan, observer: sky.Satellite | None) -> bool:
    """Return whether figures along the orbit can be drawn: orbit, epoch, trajectory and pyerfa are there."""
    known = observer is not None and plan.trajectory is not None and plan.scenario.epoch is not None
    return known and find_spec("erfa") is not None


def _earth_fixed_positions(orbit: Orbital, times: np.ndarray, to_earth: np.ndarray) -> np.ndarray:
    """Return the spacecraft's positions (k, 3), km, in axes fixed to the Earth.

    Args:
        orbit: of the spacecraft.
        times: (k,) s after its epoch.
        to_earth: (k, 3, 3) rotations from inertial axes to those of the Earth at these times.
    """
    there = sky.positions(orbit.observer, epoch=orbit.epoch, times=times)
    return np.asarray(np.einsum("kij,kj->ki", to_earth, there))


def _to_geodetic(places: np.ndarray) -> np.ndarray:
    """Return longitude and geodetic latitude (..., 2) deg of places (..., 3) km; NaN where they are NaN."""
    latitude, longitude, _ = geodetic(places)
    return np.rad2deg(np.stack([longitude, latitude], axis=-1))


def _time_share(times: np.ndarray, there: np.ndarray) -> float:
    """Return the fraction of time in which something is there, given whether it is at times (k,) s."""
    if len(times) == 1 or np.all(there) or not np.any(there):
        return float(np.mean(there))
    both = (there[1:].astype(float) + there[:-1]) / 2
    return float(np.sum(both * np.diff(times)) / (times[-1] - times[0]))


def _format_percent(share: float) -> str:
    """Return a fraction between 0 and 1 as text in percent that is never rounded to 0 or 100 %."""
    percent = 100 * share
    return "less than 1 %" if percent < 1 else "over 99 %" if percent > 99 else f"{percent:.0f} %"


def _find_sites(asked: Plan | TimelinePlan, plan: Plan, orbit: Orbital) -> Iterator[_Site]:
    """Yield the targets of a plan or a timeline that are places on the ground, each once.

    Args:
        asked: the user's plan, which has the targets.
        plan: the same as a plan of one manoeuvre, which has the trajectory.
        orbit: of the spacecraft.
    """
    assert plan.trajectory is not None
    seen: set[str] = set()
    for name, path in _find_targets(asked):
        place = _find_ground_place(path, orbit, plan.trajectory.duration) if path.moves else None
        if place is None:
            continue
        key = name or show(np.round(place, 2).tolist())
        if key not in seen:
            seen.add(key)
            yield _Site(name, place)


def _find_targets(asked: Plan | TimelinePlan) -> Iterator[tuple[str, DirectionPath]]:
    """Yield all targets of a plan or a timeline with their names, which may be empty, each path once."""
    if isinstance(asked, TimelinePlan):
        every = [one.targets for one in asked.timeline.activities if one.targets is not None]
    else:
        goal = asked.scenario.goal
        every = [] if isinstance(goal, GivenState) else [goal]
    paths = {id(path): path for targets in every for path in targets.paths}
    yield from ((path.target, path) for path in paths.values())


def _find_ground_place(path: DirectionPath, orbit: Orbital, duration: float) -> np.ndarray | None:
    """Find the place on the ground, (2,) longitude and latitude in deg, at which all lines of sight meet.

    It is the point nearest to all lines by least squares. From a place that hardly moves over the ground, as
    in a geostationary orbit, all lines are nearly one, and the place is where the first of them meets the
    Earth.

    Args:
        path: inertial direction of the target over time.
        orbit: of the spacecraft.
        duration: s, of the plan.

    Returns:
        The place; None if lines miss it by more than `_MAX_MISS`, or its height is not that of the ground.
    """
    first, last = max(0.0, float(path.times[0])), min(duration, float(path.times[-1]))
    times = np.linspace(first, max(first, last), _SIGHT_LINES)
    to_earth = gcrs_to_earth(orbit.epoch, times)
    there = _earth_fixed_positions(orbit, times, to_earth)
    along = np.einsum("kij,kj->ki", to_earth, np.asarray(path.at(times)))
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    total = np.sum(across, axis=0)
    if np.linalg.eigvalsh(total)[0] < _MIN_PARALLAX * len(times):
        place = surface_point(there[0], along[0])
    else:
        place = np.linalg.solve(total, np.einsum("kij,kj->i", across, there))
    if not np.all(np.isfinite(place)):
        return None
    misses = np.linalg.norm(np.einsum("kij,kj->ki", across, place - there), axis=-1)
    height = float(geodetic(place)[2])
    near = np.max(misses) <= _MAX_MISS and _GROUND_HEIGHTS[0] <= height <= _GROUND_HEIGHTS[1]
    return _to_geodetic(place) if near else None


def _set_map_limits(axes: Axes, points: np.ndarray) -> None:
    """Set the limits of the axes to the whole Earth, or to a region that holds all points (k, 2) deg."""
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    if np.any(high - low > _MAX_REGION):
        axes.set(xlim=(-180, 180), ylim=(-90, 90), xticks=range(-180, 181, 60), yticks=range(-90, 91, 30))
        return
    middle, half = (low + high) / 2, np.maximum(high - low, _MIN_EXTENT) * (0.5 + _PADDING)
    narrow = np.cos(np.deg2rad(middle[1]))  # a degree of longitude, in degrees of latitude
    half[0] = max(half[0], half[1] * 1.3 / narrow)
    half[1] = max(half[1], half[0] * narrow / 2.2)
    axes.set(xlim=middle[0] + half[0] * np.array([-1, 1]), ylim=middle[1] + half[1] * np.array([-1, 1]))
    axes.set_aspect(1 / narrow, adjustable="box", anchor="NW")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 3, 5, 10]))


def _draw_land(axes: Axes) -> None:
    """Draw land and coasts within the limits of the axes, with the finer outlines if the region is small."""
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    file = FINE if high[0] - low[0] < _FINE_COAST_WIDTH else FILE
    axes.add_collection(PolyCollection(within(land(file), low, high), **_LAND), autolim=False)
    axes.add_collection(LineCollection(within(coasts(file), low, high), **_COAST), autolim=False)


def _name_sites(axes: Axes, sites: Sequence[_Site], drawn: np.ndarray) -> None:
    """Write the names of sites beside their marks, where they cover as little as possible.

    A name ends or begins right at its mark; a line leads to a name that stands diagonally off its mark.

    Args:
        axes: the map, with its limits set.
        sites: to be named.
        drawn: (k, 2) deg, points of all curves, which names should not cover; rows of NaN are ignored.
    """
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    width, height = GROUND_SIZE[0] * 0.62, GROUND_SIZE[1] * 0.75  # inches of the map, about
    scale = np.array([(right - left) / width, (high - low) / height])
    labels = Labels(drawn[np.isfinite(drawn[:, 0])], [(site.place, 0.12 * scale) for site in sites])
    for site in sites:
        size = np.array([_LETTER_WIDTH * len(site.name), 0.15]) * scale
        away = size / 2 + _NAME_GAP * scale
        around = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)]
        inside = np.array([right - left, high - low]) / 2 - size / 2
        middle = np.array([right + left, high + low]) / 2
        places = [site.place + away * step for step in around]
        spot = labels.place(
            [p for p in places if np.all(np.abs(p - middle) <= inside)] or places, size, must=True
        )
        assert spot is not None
        side = np.sign(np.round((spot - site.place) / scale, 6)).astype(int)
        near = spot - side * (size / 2 * (1, 0))  # end of the box: the text may be shorter than it
        if np.all(side != 0):
            ends = np.stack([site.place, near - side * (0, 1) * size / 4])
            axes.plot(*ends.T, color=_SITE_MARK["color"], linewidth=0.7, zorder=4.4)
        own: Look = {**HALO, "ha": {1: "left", 0: "center", -1: "right"}[int(side[0])]}
        across, up = near.tolist()
        plain(axes.text(across, up, site.name, fontsize=SMALL, color=_SITE_MARK["color"], zorder=4.6, **own))


def _format_utc(epoch: np.datetime64, time: float) -> str:
    """Return the date and time in UTC, to a second, at a time in s after an epoch."""
    instant = epoch.astype("datetime64[ms]") + np.timedelta64(round(1e3 * time), "ms")
    return str(np.datetime_as_string(instant, unit="s")).replace("T", " ")


def _format_clock(epoch: np.datetime64, time: float) -> str:
    """Return the time of day in UTC as `_format_utc` does, with the date if it differs from the epoch's."""
    stamp, first = _format_utc(epoch, time), _format_utc(epoch, 0.0)
    return stamp[11:] if stamp[:10] == first[:10] else stamp


def _draw_night(axes: Axes, orbit: Orbital, time: float) -> bool:
    """Fill where the Sun's centre is below the horizon at a time, s; returns whether that is anywhere."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    east = np.arange(np.floor(left), np.ceil(right) + _NIGHT_STEP, _NIGHT_STEP)
    north = np.clip(np.arange(np.floor(low), np.ceil(high) + _NIGHT_STEP, _NIGHT_STEP), -90, 90)
    up = np.asarray(pointing(*np.deg2rad(np.meshgrid(east, north))))
    sun = sky.directions("sun", epoch=orbit.epoch, observer="earth", times=time)
    height = up @ (gcrs_to_earth(orbit.epoch, np.asarray(time)) @ sun)
    axes.contourf(
        east, north, -height, levels=[0, 2], colors=[_NIGHT["facecolor"]], alpha=_NIGHT["alpha"], zorder=0.4
    )
    axes.set(xlim=(left, right), ylim=(low, high))
    return bool(np.any(height < 0))


@cache
def coasts(file: Path = FILE) -> tuple[np.ndarray, ...]:
    """Return the coast lines of a file, (k, 2) longitude and latitude in deg, for a map from -180 to 180 deg.

    Lines that cross an edge of the map are given at both edges; those parts have longitudes beyond 180 deg.
    """
    rings = json.loads(file.read_text(encoding="utf-8"))["rings"]
    found = list[np.ndarray]()
    for ring in rings:
        line = _UNITS[file] * np.cumsum(np.reshape(ring, (-1, 2)), axis=0)
        copies = (line + np.array([turn, 0.0]) for turn in (-_FULL_TURN, 0.0, _FULL_TURN))
        found += [own for own in copies if np.min(own[:, 0]) < _MAP_EDGE and np.max(own[:, 0]) > -_MAP_EDGE]
    return tuple(found)


@cache
def land(file: Path = FILE) -> tuple[np.ndarray, ...]:
    """Return closed outlines of land as `coasts` does; Antarctica is closed along latitude -90 deg."""
    return tuple(line if _is_closed(line) else _close_over_pole(line) for line in coasts(file))


def within(lines: Iterable[np.ndarray], low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Return those of the lines (k, 2) whose bounding box meets a region between two corners (2,), deg."""
    return [
        line for line in lines if np.all(np.max(line, axis=0) >= low) and np.all(np.min(line, axis=0) <= high)
    ]


def _is_closed(line: np.ndarray) -> bool:
    """Return whether a coast line (k, 2) is closed, as all but that of Antarctica are."""
    return bool(np.allclose(line[0], line[-1]))


def _close_over_pole(line: np.ndarray) -> np.ndarray:
    """Close a line (k, 2) deg that goes once around the Earth by way of the south pole."""
    corners = np.array([[line[-1, 0], -90.0], [line[0, 0], -90.0], line[0]])
    return np.concatenate([line, corners])
