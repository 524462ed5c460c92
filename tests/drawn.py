"""What is seen of a figure: which points of a picture an area covers."""

import numpy as np
from matplotlib.contour import ContourSet
from matplotlib.path import Path


def filled(area: ContourSet, points: np.ndarray) -> np.ndarray:
    """(k,) which of (k, 2) points of a picture an area covers, counting its rings around each."""
    rings = [Path(ring) for path in area.get_paths() for ring in path.to_polygons()]
    return sum((ring.contains_points(points) for ring in rings), np.zeros(len(points), int)) % 2 == 1
