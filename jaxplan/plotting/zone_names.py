"""Names of the zones on the unfolded sphere, each where it covers no other name and little of the ways."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from jaxplan.geometry.directions import pointing, separation
from jaxplan.model.zones import KeepIn, KeepOut, binds_all
from jaxplan.plotting import unfolded
from jaxplan.plotting.labels import Labels
from jaxplan.plotting.marks import zones_at
from jaxplan.plotting.style import KEEP_IN, KEEP_OUT, SMALL, plain

if TYPE_CHECKING:
    from jaxplan.model.scenario import Scenario

_CROWD = 20  # zones, beyond which their names get smaller and go without the devices they bind
_LETTER, _LINE = 3.0, 5.5  # deg of the map that a letter is wide and a line high
_MARK = 8.0  # deg of the map that a start or a goal takes
_HALO = [withStroke(linewidth=2.5, foreground="white")]


def name_zones(axes: Axes, scenario: "Scenario", ways: np.ndarray, marks: np.ndarray) -> None:
    """Write each zone's name in it, or beside it if a boresight must stay in.

    Args:
        axes: of the map.
        scenario: whose zones are meant.
        ways: (k, 2) deg, points of what is drawn, which names should not cover.
        marks: (m, 2) deg, of starts and goals, which names cover only where there is no other place.
    """
    # Small zones first, as they have the least room; of equals as they come.
    zones = sorted(zones_at(scenario, 0.0), key=lambda zone: zone.half_angle)
    crowded = len(zones) > _CROWD
    labels = Labels(ways, [(mark, np.full(2, _MARK)) for mark in marks])
    for zone in zones:
        lines = [zone.name] if crowded else [zone.name, *_bound(zone, scenario), *_group(zone)]
        size = (_LETTER * max(len(line) for line in lines), _LINE * len(lines))
        spot = labels.place(_places(zone, size), size, must=True)
        assert spot is not None
        label = axes.text(
            float(spot[0]),
            float(spot[1]),
            "\n".join(lines),
            color=KEEP_IN if isinstance(zone, KeepIn) else KEEP_OUT,
            fontsize=SMALL - 1.5 * crowded,
            ha="center",
            va="center",
            zorder=1.8,
            path_effects=_HALO,
        )
        plain(label)


def _places(zone: KeepOut | KeepIn, size: tuple[float, float]) -> list[tuple[float, float]]:
    """Where on the map a zone's name may stand, deg; the best comes first.

    That is over and under a keep-in zone, since its inside is where the ways are, and else in the zone. Of
    one that is more than half the sphere the outside is the smaller part, so its name stays inside, too.
    """
    azimuth, elevation = unfolded.unfold(zone.axis_at())
    angle = float(np.rad2deg(zone.half_angle))
    wide = angle > 90
    inside = [(0.0, offset * min(angle, 90)) for offset in (0, 0.5, -0.5, 0.8, -0.8)]
    near = [0.6 * angle / np.cos(np.deg2rad(min(abs(elevation), 60.0)))] if not wide else []
    turns = [side * turn for turn in (*near, 60.0, 120.0) for side in (1, -1)]
    aside = [(turn, height) for turn in turns for _, height in inside]
    beside = (
        []
        if wide or not isinstance(zone, KeepIn)
        else [(0.0, side * (angle + size[1] / 2 + 2)) for side in (1, -1)]
    )
    room = np.maximum((180 - size[0] / 2, 87 - size[1] / 2), 0)
    places = []
    for turn, height in [*beside, *inside, *aside]:
        across = (azimuth + turn + 180) % 360 - 180
        clear = abs(elevation + height) <= room[1]
        sure = not wide and turn == 0
        if clear and (sure or _separation(zone, across, elevation + height) < angle - 3):
            places.append((float(np.clip(across, -room[0], room[0])), float(elevation + height)))
    if not places:
        across, up = np.clip((azimuth, elevation), -room, room)
        places.append((float(across), float(up)))
    return places


def _separation(zone: KeepOut | KeepIn, azimuth: float, elevation: float) -> float:
    """Angle of a place on the map from a zone's axis, deg."""
    a, e = np.deg2rad((azimuth, elevation))
    return float(np.rad2deg(separation(pointing(a, e), zone.axis_at())))


def _bound(zone: KeepOut | KeepIn, scenario: "Scenario") -> list[str]:
    """In few words which devices and vectors a zone binds; nothing if it binds all devices and no vector."""
    names = scenario.spacecraft.device_names
    bound = [name for name in names if binds_all(zone) or name in zone.devices]
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


def _group(zone: KeepOut | KeepIn) -> list[str]:
    """Lines that name a zone's group and its entry there; none if it is in none."""
    lines = [] if zone.any_of is None else [f"any of {zone.any_of}"]
    return lines if zone.entry is None else [*lines, f"with all of {zone.entry}"]
