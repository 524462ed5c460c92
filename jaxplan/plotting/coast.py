"""The outlines of land, for maps of the Earth, so that one sees over what the spacecraft flies.

They are those of Natural Earth (public domain), simplified, in two files beside this one, which say how:
coast.json for maps of all the Earth, off by up to 0.3 deg, and coast_fine.json for those of a region, off by
up to 0.07 deg. Smaller islands are not there. Degrees of longitude and latitude.

An outline that passes the meridian at the edges of a map goes on beyond it, and is there twice, a turn apart;
what is beyond the edges of a map is not seen. That of Antarctica goes once around.
"""

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np

FILE, FINE = (Path(__file__).with_name(f"{name}.json") for name in ("coast", "coast_fine"))
_UNITS = {FILE: 0.1, FINE: 0.01}  # deg of a file's whole numbers
_EDGE, _TURN = 180.0, 360.0  # deg of longitude


@cache
def coasts(file: Path = FILE) -> tuple[np.ndarray, ...]:
    """Lines (k, 2) deg of all coasts in a file, for maps from -180 to 180 deg of longitude."""
    rings = json.loads(file.read_text(encoding="utf-8"))["rings"]
    found = list[np.ndarray]()
    for ring in rings:
        line = _UNITS[file] * np.cumsum(np.reshape(ring, (-1, 2)), axis=0)
        copies = (line + np.array([turn, 0.0]) for turn in (-_TURN, 0.0, _TURN))
        found += [own for own in copies if np.min(own[:, 0]) < _EDGE and np.max(own[:, 0]) > -_EDGE]
    return tuple(found)


@cache
def land(file: Path = FILE) -> tuple[np.ndarray, ...]:
    """Closed outlines (k, 2) deg of land likewise; of Antarctica with the edge of the map."""
    return tuple(line if _closed(line) else _to_the_pole(line) for line in coasts(file))


def within(lines: Iterable[np.ndarray], low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """The lines (k, 2) that may touch a region from one corner (2,) deg to the other."""
    return [
        line for line in lines if np.all(np.max(line, axis=0) >= low) and np.all(np.min(line, axis=0) <= high)
    ]


def _closed(line: np.ndarray) -> bool:
    """Whether a coast (k, 2) is closed, as all are but that of Antarctica."""
    return bool(np.allclose(line[0], line[-1]))


def _to_the_pole(line: np.ndarray) -> np.ndarray:
    """The outline of what is between a line (k, 2) once around the Earth and the south pole."""
    corners = np.array([[line[-1, 0], -90.0], [line[0, 0], -90.0], line[0]])
    return np.concatenate([line, corners])
