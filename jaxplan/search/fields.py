"""Distances to go around obstacles on the sphere of directions, one field for each device.

A straight-line heuristic does not see the cones: it leads every device into the nearest wall. A field holds
for each direction how far the device's boresight has to travel from there to its direction at the goal,
around the keep-out cones and inside the keep-in cones that bind it. It ignores the other devices and the
limits, and the grid is coarse, so it is a guide and no bound: a further inadmissible heuristic, for which
multi-heuristic A* has a queue of its own. Zones of groups are left out.

The grid is the octahedral map: the sphere unfolded to a square of `SIZE` x `SIZE` directions. Cells in a
forbidden zone can be crossed at `WALL` times the price, so that the field is finite and slopes outward there.
"""

from dataclasses import dataclass
from functools import lru_cache

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.model.constraints import INERTIAL
from jaxplan.model.scores import scores, thresholds
from jaxplan.search.scene import Scene

SIZE = 20
WALL = 6.0
_NEIGHBOUR_COUNT = 12


@lru_cache(maxsize=1)
def _make_grid() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the grid's cells: unit directions (SIZE^2, 3), indices of neighbours, and angles to them, rad.

    Indices and angles are (SIZE^2, _NEIGHBOUR_COUNT); the cells are in the order of the map, row by row.
    """
    centre = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
    u, v = np.meshgrid(centre, centre, indexing="ij")
    z = 1 - np.abs(u) - np.abs(v)
    x = np.where(z >= 0, u, np.sign(u) * (1 - np.abs(v)))
    y = np.where(z >= 0, v, np.sign(v) * (1 - np.abs(u)))
    directions = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosines = directions @ directions.T
    neighbours = np.argsort(-cosines, axis=1, kind="stable")[:, 1 : _NEIGHBOUR_COUNT + 1]
    angles = np.arccos(np.minimum(np.take_along_axis(cosines, neighbours, axis=1), 1))
    return directions, neighbours, angles


@dataclass(frozen=True, slots=True, eq=False)
class Fields:
    """The distance fields of a scene, one for each device or other direction that is bound.

    Attributes:
        table: (devices, SIZE, SIZE) rad to go from each direction of the grid.
        start: (devices,) rad to go from the start; all zero where the fields have not been computed.
    """

    table: np.ndarray
    start: np.ndarray

    @property
    def known(self) -> bool:
        """Whether the fields have been computed, and any device has a distance to go."""
        return bool(np.any(self.start > 0))


def no_fields(scene: Scene) -> Fields:
    """Return fields of zeros, which stand for a scene's fields until they are computed."""
    devices = scene.cones.bound.shape[1]
    return Fields(table=np.zeros((devices, SIZE, SIZE)), start=np.zeros(devices))


@lru_cache(maxsize=16)  # by the scene's identity: the retries of a plan share it
def distance_fields(scene: Scene) -> Fields:
    """Compute the distance fields of a scene: how far boresights have to travel to the goal around zones.

    Args:
        scene: the problem; the fields of the last 16 scenes are kept.
    """
    from scipy.sparse import csr_array  # only scenes that need it pay for the import
    from scipy.sparse.csgraph import dijkstra

    directions, neighbours, angles = _make_grid()
    cells, cones = len(directions), scene.cones
    within = scores(cones, directions @ cones.axis.T, 0.0) > thresholds(cones, 0.0)  # (cells, z)
    within &= cones.frame == INERTIAL  # what turns with the body is no place on the sphere
    blocked = (within[:, :, None] & cones.bound).any(axis=1).T  # (devices, cells)
    price = np.where(blocked, WALL, 1.0)
    devices = len(price)
    weights = angles * (price[:, :, None] + price[:, neighbours]) / 2
    columns = neighbours + cells * np.arange(devices)[:, None, None]
    rows = np.arange(devices * cells + 1) * _NEIGHBOUR_COUNT
    graph = csr_array((weights.ravel(), columns.ravel(), rows), shape=(devices * cells, devices * cells))
    begin, end = np.argmax(scene.seen @ directions.T, axis=-1)
    every = np.arange(devices)
    # the graph is symmetric in price, so distances from the goal are those to it
    distances = dijkstra(graph, indices=end + cells * every, min_only=True).reshape(devices, cells)
    return Fields(table=distances.reshape(devices, SIZE, SIZE), start=distances[every, begin])


def look_up(fields: Array, directions: Array) -> Array:
    """Return distances to go at directions, interpolated bilinearly between the cells of the fields.

    Args:
        fields: (d, SIZE, SIZE) rad, d fields.
        directions: (3, ..., d) inertial unit vectors, those in the last axis each for its own field.

    Returns:
        (..., d) rad.
    """
    x, y, z = directions
    total = jnp.abs(x) + jnp.abs(y) + jnp.abs(z)
    x, y, below = x / total, y / total, z < 0
    u = jnp.where(below, jnp.where(x >= 0, 1, -1) * (1 - jnp.abs(y)), x)
    v = jnp.where(below, jnp.where(y >= 0, 1, -1) * (1 - jnp.abs(x)), y)
    place = [jnp.clip((w + 1) / 2 * SIZE - 0.5, 0, SIZE - 1.001) for w in (u, v)]
    cell = [p.astype(jnp.int32) for p in place]
    part = [p - c for p, c in zip(place, cell, strict=True)]
    device = jnp.arange(fields.shape[0])

    def value(i: int, j: int) -> Array:
        return fields[device, cell[0] + i, cell[1] + j]

    low = value(0, 0) * (1 - part[1]) + value(0, 1) * part[1]
    high = value(1, 0) * (1 - part[1]) + value(1, 1) * part[1]
    return low * (1 - part[0]) + high * part[0]
