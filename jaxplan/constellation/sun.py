"""Links that lead through the Sun's keep-out cone, and where their terminals wait meanwhile.

A link is out while its direction is inside the cone, or outside by less than `CLEARANCE`: an operator would
not use it, and a terminal that looked along it would break the cone. Its terminal waits at `CLEARANCE`
outside the cone, as close to the link as the Earth's cone allows, ready to take it up again.
"""

import math

import numpy as np

from jaxplan.geometry.directions import separation

CLEARANCE = math.radians(1.0)
"""rad, from the Sun's cone, and from the Earth's where a terminal waits."""
_TURNS = 721
"""Places on the rim that are tried, half of them to either side of the nearest."""


def in_the_sun(directions: np.ndarray, sun: np.ndarray, half_angle: float) -> np.ndarray:
    """Which directions (..., 3) are inside the Sun's cone, or closer to it than `CLEARANCE`."""
    return np.asarray(separation(directions, sun) < half_angle + CLEARANCE)


def waiting_directions(
    links: np.ndarray, sun: np.ndarray, half_angle: float, down: np.ndarray, earth_half_angle: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where terminals wait whose links are out.

    Args:
        links: (K, 3) directions of the links, inertial.
        sun: (3,) direction of the Sun.
        half_angle: rad, of its cone.
        down: (K, 3) directions of nadir.
        earth_half_angle: rad, of the Earth's cone about nadir.

    Returns:
        (K, 3) unit vectors, the admissible ones nearest to the links, and (K,) bool: whether there is one.
    """
    toward = links - (links @ sun)[:, None] * sun
    length = np.linalg.norm(toward, axis=-1, keepdims=True)
    anywhere = np.cross(sun, np.eye(3)[np.argmin(np.abs(sun))])  # for a link right to the Sun
    first = np.where(length > 1e-12, toward / np.where(length > 1e-12, length, 1), _unit(anywhere))
    second = np.cross(sun, first)
    turn = np.linspace(-np.pi, np.pi, _TURNS)
    turn = turn[np.argsort(np.abs(turn), kind="stable")]  # the nearest first
    around = np.cos(turn)[:, None] * first[:, None] + np.sin(turn)[:, None] * second[:, None]
    rim = half_angle + CLEARANCE
    places = np.cos(rim) * sun + np.sin(rim) * around  # (K, turns, 3)
    clear = separation(places, down[:, None]) >= earth_half_angle + CLEARANCE
    chosen = np.argmax(clear, axis=-1)
    return _unit(places[np.arange(len(links)), chosen]), np.any(clear, axis=-1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
