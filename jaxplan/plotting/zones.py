"""Zones on the sphere of directions, on any projection: areas, edges, names, and tracks of moving ones.

A zone is a cone about an axis. Keep-out zones are hatched with a solid edge, keep-in zones have a dashed
edge, and zones of an ``any_of`` group, of which any one has to hold, a dotted one. Directions are unit
vectors in the axes of the figure (`jaxplan.plotting.frames`). The *track* or *way* of a zone that moves is
the curve of its axis on the sphere over time.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from jaxplan.geometry.vectors import separation
from jaxplan.model.scenario import Scenario
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner import Plan
from jaxplan.plotting.frames import INERTIAL, Inertial
from jaxplan.plotting.projections import FlatMap, GlobeView, Projection, TwoDiscs, circle
from jaxplan.plotting.style import (
    GREY,
    HALO,
    KEEP_IN,
    KEEP_OUT,
    SMALL,
    Entries,
    Entry,
    Labels,
    Look,
    plain,
)

Cone = KeepOut | KeepIn

_EDGE_LINE: Look = {"linewidth": 1.1, "zorder": 1.6}  # of a zone's edge
_MIN_TRACK_POINTS, _MAX_TRACK_POINTS = 33, 2000  # of the track of a zone's axis
_TRACK_STEP = 0.05  # rad: angle between them, within these numbers
_STILL_TURN = 1e-3  # rad: turn of a zone's axis in a moving frame, below which it counts as standing still
_CROWDED_COUNT = 20  # number of zones beyond which their names are smaller and do not say what they bind
# Where a zone's name may stand, the best first: in units of its half width and half height.
_INNER_SPOTS = np.array(
    [(across, up) for across in (0, 0.6, -0.6, 1.2, -1.2) for up in (0, 0.5, -0.5, 0.8, -0.8)]
)
_EDGE_STEP = 8  # every so many points of a zone's edge count as drawn, which names should not cover either
_NAME_GAP = np.array([1.0, 0.5])  # gap between names that say what their zones bind, in letters and in lines
_NAME_ZORDER = 3.6  # zorder of names: above lines, which their halos cover, and below marks
_TRACK_LINE: Look = {"linewidth": 0.7, "zorder": 1.7}  # of a zone's axis, lighter than those of boresights
_RETRACED_ANGLE = np.deg2rad(3.0)  # rad: a track nearer than that to an earlier part is not drawn again
_INNER_SHARE = 0.9  # fraction of a zone's half angle within which the middle of a name inside it lies
_LARGE_ZONE = np.deg2rad(45.0)  # rad: half angle of a zone from which on its name is not put beside it
_MAX_DETAILED_ZONES = {FlatMap: _CROWDED_COUNT, TwoDiscs: 4, GlobeView: -1}  # whose names say what they bind
_SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0), (0.7, 1), (-0.7, 1), (0.7, -1), (-0.7, -1), (0, 1.8), (0, -1.8))
NOTHING = np.zeros((0, 3))


def draw_line(axes: Axes, projection: Projection, line: np.ndarray, look: Look) -> list[Line2D]:
    """Draw a line (k, 3) on the sphere, cut into parts by the projection; returns the artists."""
    drawn = []
    for flat, alpha in projection.parts(line):
        faded = look if alpha == 1 else {**look, "alpha": alpha * look.get("alpha", 1)}
        drawn += axes.plot(*flat.T, **faded)
    return drawn


def draw_way(axes: Axes, projection: Projection, zone: Cone, track: np.ndarray) -> None:
    """Draw the track (k, 3) of a zone's axis without parts close to earlier ones, which would form a bar."""
    for part in fresh_parts(track):
        draw_line(axes, projection, part, {"color": zone_outline(zone)["color"], **_TRACK_LINE})


def fresh_parts(track: np.ndarray) -> list[np.ndarray]:
    """Return the parts (m, 3) of a track (k, 3) that do not run close to an earlier part.

    "Close" is within `_RETRACED_ANGLE`. A point is always close to those just before it, so an earlier point
    counts only if the track has been away from the place in between.
    """
    near = track @ track.T > np.cos(_RETRACED_ANGLE)
    kept = np.ones(len(track), bool)
    for number in range(1, len(track)):
        away = np.flatnonzero(~near[number, :number])
        kept[number] = not len(away) or not np.any(near[number, : away[-1]] & kept[: away[-1]])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]]).astype(int))).reshape(-1, 2)
    # with the point after, so that a closed track stays closed
    return [track[first : min(after + 1, len(track))] for first, after in edges]


def draw_zone(axes: Axes, projection: Projection, zone: Cone) -> list[Artist]:
    """Draw a zone's area and edge: hatched for keep-out, pale if it binds no device; returns the artists."""
    axis, drawn = zone.axis_at(), list[Artist]()
    fill = _zone_fill(zone)
    for across, upward, directions, strength, limb in projection.sheets(axis, zone.half_angle):
        inside = directions @ axis - np.cos(zone.half_angle)
        if not np.any(inside > 0):
            continue
        *colour, alpha = to_rgba(fill["facecolor"])
        look: Look = {
            "colors": [(*colour, strength * alpha)],
            "hatches": [fill.get("hatch") if strength >= 1 else None],
        }
        area = axes.contourf(across, upward, inside, levels=[0, 3], zorder=1, **look)
        edge = None if limb is None else Circle(*limb, transform=axes.transData)
        area.set(clip_path=edge, edgecolor=fill["edgecolor"], linewidth=0)
        drawn.append(area)
    return drawn + draw_line(axes, projection, circle(axis, zone.half_angle), zone_outline(zone) | _EDGE_LINE)


def zone_outline(zone: Cone) -> Look:
    """Return the colour and line style of a zone's edge: dashed for keep-in, dotted for one of a group."""
    inside = isinstance(zone, KeepIn)
    style = (0, (1, 1.5)) if zone.any_of is not None else (0, (5, 2.5)) if inside else "-"
    return {"color": KEEP_IN if inside else KEEP_OUT, "linestyle": style}


def _zone_fill(zone: Cone) -> Look:
    """Return the colours and the hatch of a zone's area."""
    colour = KEEP_IN if isinstance(zone, KeepIn) else KEEP_OUT
    if not _binds_devices(zone):
        return {"facecolor": to_rgba(colour, 0.03), "edgecolor": "none"}
    if isinstance(zone, KeepIn):
        return {"facecolor": to_rgba(KEEP_IN, 0.10), "edgecolor": "none"}
    return {"facecolor": to_rgba(KEEP_OUT, 0.09), "edgecolor": to_rgba(KEEP_OUT, 0.22), "hatch": "///"}


def _binds_devices(zone: Cone) -> bool:
    """Return True if a zone binds a device, False if it binds only other vectors."""
    return zone.binds_all or bool(zone.devices)


def name_zones(
    axes: Axes,
    projection: Projection,
    zones: Sequence[Cone],
    devices: Sequence[str] = (),
    tracks: np.ndarray = NOTHING,
    ends: np.ndarray = NOTHING,
) -> list[Artist]:
    """Write each zone's name in it, or above or below a keep-in zone; returns the texts.

    Names also say what their zones bind, where that is not all devices, if there are few zones, all have room
    for it, and the projection is not the globe. Zones that bind vectors alone say so wherever few zones are
    named.

    Args:
        axes: to write on.
        projection: of the axes.
        zones: to be named, at their places.
        devices: names of all devices of the spacecraft.
        tracks: (k, 3) directions of drawn curves, which names should not cover.
        ends: (m, 3) directions of starts and goals, which names cover only where there is no other place.
    """
    crowded = len(zones) > _CROWDED_COUNT
    marks = [(spot, np.full(2, projection.mark)) for spot in projection.project(ends)]
    if isinstance(projection, TwoDiscs):
        marks += [(place, projection.letter * [len(text), 1]) for text, place in projection.ring_names()]
    # Zones in front come first, and among these the smallest, which have the least room.
    zones = sorted(zones, key=lambda zone: (-projection.opacity(zone.axis_at()), zone.half_angle))
    texts = list[Artist]()
    edges = [circle(zone.axis_at(), zone.half_angle)[::_EDGE_STEP] for zone in zones[:_CROWDED_COUNT]]
    points = projection.project(np.concatenate([tracks, *edges]))
    bound = [_describe_bound(zone, devices) for zone in zones]
    told = [[zone.name, *words, *_describe_group(zone)] for zone, words in zip(zones, bound, strict=True)]
    few, spots = not crowded and len(zones) <= _MAX_DETAILED_ZONES[type(projection)], None
    if few:
        spots = _place_names(projection, zones, told, Labels(points, list(marks)), must=False)
    if spots is None:  # if one has no room for that, no zone that binds devices says it
        alone = [few and not _binds_devices(zone) for zone in zones]
        told = [[zone.name, *words * only] for zone, words, only in zip(zones, bound, alone, strict=True)]
        spots = _place_names(projection, zones, told, Labels(points, list(marks)), must=True)
    assert spots is not None
    for zone, spot, lines in zip(zones, spots, told, strict=True):
        near = projection.opacity(zone.axis_at()) == 1
        text = axes.text(
            float(spot[0]),
            float(spot[1]),
            "\n".join(lines),
            color=zone_outline(zone)["color"],
            alpha=None if near else 0.5,
            fontsize=SMALL - 1.5 * crowded,
            zorder=_NAME_ZORDER,
            **(HALO if near else {**HALO, "path_effects": []}),
        )
        texts.append(plain(text))
    return texts


def _place_names(
    projection: Projection,
    zones: Sequence[Cone],
    names: Sequence[Sequence[str]],
    labels: Labels,
    *,
    must: bool,
) -> list[np.ndarray] | None:
    """Find places for the names of zones, one after the other.

    Args:
        projection: of the axes.
        zones: to be named.
        names: lines of the name of each zone.
        labels: what may not be covered; the names placed are added to it.
        must: whether every name has to stand somewhere, if need be beside its zone or upon another name.

    Returns:
        The centre (2,) of each name; None if one has no room and `must` is False.
    """
    found = list[np.ndarray]()
    for zone, lines in zip(zones, names, strict=True):
        size = projection.letter * (max(map(len, lines)), len(lines))
        places = _usual_places(projection, zone, size)
        spot = labels.place(places, size + _NAME_GAP * projection.letter * (not must))
        if spot is None and must:
            spot = labels.place([*places, *_outer_places(projection, zone, size)], size, must=True)
        if spot is None:
            return None
        found.append(spot)
    return found


def _usual_places(projection: Projection, zone: Cone, size: np.ndarray) -> list[np.ndarray]:
    """Return points (2,) of the picture where the name of a zone, of size (2,), may stand, the best first.

    They are above and below a keep-in zone, since tracks run inside it, and else inside the zone. If a
    keep-in zone is more than half the sphere, its outside is the smaller part, so its name stays inside. The
    zone's centre is always the last of them.
    """
    axis, angle = zone.axis_at(), zone.half_angle
    centre, extent = projection.project(axis), projection.extent(axis, angle)
    away = extent[1] + size[1] / 2 + projection.gap
    above = [(0.0, away), (0.0, -away)] if isinstance(zone, KeepIn) and angle <= np.pi / 2 else []
    wanted = centre + np.array([*above, *(_INNER_SPOTS * extent)])
    spots = projection.fit(wanted, size)
    apart = separation(projection.directions(spots, axis), axis)
    fits = np.where(np.arange(len(spots)) < len(above), apart >= angle, apart < _INNER_SHARE * angle)
    moved = spots[:, 1] != wanted[:, 1]  # places that had to be moved up or down come last
    order = np.argsort(moved, kind="stable")
    return [*spots[order][fits[order]], *projection.fit(centre[None], size)]


def _outer_places(projection: Projection, zone: Cone, size: np.ndarray) -> list[np.ndarray]:
    """Return points (2,) of the picture where a name of size (2,) stands wholly outside a small zone."""
    if zone.half_angle >= _LARGE_ZONE:
        return []
    axis = zone.axis_at()
    away = np.array(projection.extent(axis, zone.half_angle)) + size / 2 + projection.gap
    wanted = projection.project(axis) + away * np.array(_SIDES)
    spots = projection.fit(wanted, size)
    return [spot for spot, place in zip(spots, wanted, strict=True) if np.allclose(spot, place)]


def _describe_bound(zone: Cone, names: Sequence[str]) -> list[str]:
    """Return lines on which devices and vectors a zone binds; none if it binds just all devices."""
    bound = [name for name in names if zone.binds_all or name in zone.devices]
    others = [name for name in names if name not in bound]
    lines = []
    if len(bound) == 1 and others:
        lines.append(f"for {bound[0]}")
    elif bound and others:
        lines.append(f"not {others[0]}" if len(others) == 1 else f"for {len(bound)} of {len(names)}")
    if zone.vectors:
        carriers = {vector.to or "the body" for vector in zone.vectors}
        whose = f"of {carriers.pop()}" if len(carriers) == 1 else f"of {len(carriers)} parts"
        count = "a vector" if len(zone.vectors) == 1 else f"{len(zone.vectors)} vectors"
        lines += [f"and {count}" if bound else f"for {count}", whose]
    return lines


def _describe_group(zone: Cone) -> list[str]:
    """Return lines that name a zone's group and its entry in the group; none if it is in no group."""
    lines = [] if zone.any_of is None else [f"any of {zone.any_of}"]
    return lines if zone.entry is None else [*lines, f"with all of {zone.entry}"]


def zone_entries(scenario: Scenario, frame: Inertial = INERTIAL) -> Entries:
    """Return legend entries: one for each kind of zone that the scenario has, and one for tracks of axes.

    The latter is there if a zone moves, or `frame` does.
    """

    def kind(zone: Cone) -> tuple[bool, bool, bool]:
        return isinstance(zone, KeepIn), not _binds_devices(zone), zone.any_of is not None

    kinds: dict[str, Entry] = {}
    for zone in sorted(zones_at(scenario, 0.0), key=kind):
        inside = isinstance(zone, KeepIn)
        text = "keep-in zone" if inside else "keep-out zone"
        text += "" if _binds_devices(zone) else ",\nfor no device"
        text += "" if zone.any_of is None else ",\nany of its group"
        edge = to_rgba(zone_outline(zone)["color"], 1.0 if inside else 0.6)
        look = {**_zone_fill(zone), "edgecolor": edge, "linestyle": zone_outline(zone)["linestyle"]}
        kinds.setdefault(text, (Patch(**look, linewidth=1), text))
    moving: Entries = [
        (Line2D([], [], color=GREY, **_TRACK_LINE), "way of a zone's axis,\nto its fainter edge")
    ]
    return [*kinds.values(), *moving * (frame.moves or any(zone.moves for zone in scenario.zones))]


def zones_at(
    scenario: Scenario, time: float, *, moving: bool | None = None, frame: Inertial = INERTIAL
) -> list[Cone]:
    """Return the scenario's zones with inertial axes where they are at a time, s, in the axes of `frame`.

    With `moving` True only those that move in space are returned, with False only those that stand still.
    """
    cones: tuple[Cone, ...] = (*scenario.keep_out, *scenario.keep_in)
    wanted = [zone for zone in cones if zone.is_inertial and moving in (None, zone.moves)]
    return [replace(zone, direction=frame.seen(zone.axis_at(time), time)) for zone in wanted]


def zone_tracks(plan: Plan, frame: Inertial = INERTIAL) -> list[tuple[Cone, np.ndarray]]:
    """Find the tracks of the zones whose inertial axes move in the axes of `frame`.

    Tracks last from time zero to that of the goal or, in a moving frame, of the motion's end. Without a goal
    they last in inertial axes as long as the zone's axis is known.

    Returns:
        Each such zone, at its last place, with the track (k, 3) of its axis.
    """
    tracks: list[tuple[Cone, np.ndarray]] = []
    zones: tuple[Cone, ...] = (*plan.scenario.keep_out, *plan.scenario.keep_in)
    for zone in zones:
        path = zone.path
        if path is None or not (path.moves or frame.moves):
            continue
        last = float(path.times[-1]) if plan.goal is None and not frame.moves else frame.end(plan)
        turned = (path.largest_rate(0.0, last) + frame.rate) * last
        points = int(np.clip(turned / _TRACK_STEP, _MIN_TRACK_POINTS, _MAX_TRACK_POINTS))
        times = np.linspace(0.0, last, points)
        track = frame.seen(np.asarray(path.at(times)), times)
        if frame.moves and np.max(separation(track, track[0])) < _STILL_TURN:
            continue  # such as a zone about the Earth in the local orbital frame
        tracks.append((replace(zone, direction=track[-1]), track))
    return tracks
