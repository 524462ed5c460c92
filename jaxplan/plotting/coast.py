"""Outlines of land for maps of the Earth, in degrees of longitude (east) and latitude.

They are those of Natural Earth (public domain), simplified, in two files beside this one, whose heads give
details: coast.json for maps of the whole Earth, with errors of up to 0.3 deg, and coast_fine.json for maps of
a region, with errors of up to 0.07 deg. Smaller islands are missing.

An outline that crosses longitude 180 deg continues beyond it, and is given twice, 360 deg apart, so that the
part inside the map is seen at both edges. The outline of Antarctica goes once around the Earth and is open.
"""

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np

FILE, FINE = (Path(__file__).with_name(f"{name}.json") for name in ("coast", "coast_fine"))
_UNITS = {FILE: 0.1, FINE: 0.01}  # deg: unit of the whole numbers in each file
_MAP_EDGE, _FULL_TURN = 180.0, 360.0  # deg of longitude: right edge of a map, and a full turn


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
