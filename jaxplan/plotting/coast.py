"""The outlines of land, for maps of the Earth: coarse, so that one sees over what the spacecraft flies.

They are those of Natural Earth (1:110m, public domain), simplified, in coast.json beside this file, which
says how. Smaller islands are not there, and a coast may be off by 0.3 deg. Degrees of longitude and latitude.

An outline that passes the meridian at the edges of a map goes on beyond it, and is there twice, a turn apart;
what is beyond the edges of a map is not seen. That of Antarctica goes once around.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np

FILE = Path(__file__).with_name("coast.json")
_UNIT = 0.1  # deg of the file's whole numbers
_EDGE, _TURN = 180.0, 360.0  # deg of longitude


@cache
def coasts() -> tuple[np.ndarray, ...]:
    """Lines (k, 2) deg of all coasts, for maps from -180 to 180 deg of longitude."""
    rings = json.loads(FILE.read_text(encoding="utf-8"))["rings"]
    found = list[np.ndarray]()
    for ring in rings:
        line = _UNIT * np.cumsum(np.reshape(ring, (-1, 2)), axis=0)
        copies = (line + np.array([turn, 0.0]) for turn in (-_TURN, 0.0, _TURN))
        found += [own for own in copies if np.min(own[:, 0]) < _EDGE and np.max(own[:, 0]) > -_EDGE]
    return tuple(found)


@cache
def land() -> tuple[np.ndarray, ...]:
    """Closed outlines (k, 2) deg of land likewise; of Antarctica with the edge of the map."""
    return tuple(line if _closed(line) else _to_the_pole(line) for line in coasts())


def _closed(line: np.ndarray) -> bool:
    """Whether a coast (k, 2) is closed, as all are but that of Antarctica."""
    return bool(np.allclose(line[0], line[-1]))


def _to_the_pole(line: np.ndarray) -> np.ndarray:
    """The outline of what is between a line (k, 2) once around the Earth and the south pole."""
    corners = np.array([[line[-1, 0], -90.0], [line[0, 0], -90.0], line[0]])
    return np.concatenate([line, corners])
