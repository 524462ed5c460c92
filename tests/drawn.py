"""What is seen of a figure: which points of a picture an area covers, and names that overlap."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d.art3d import Text3D
from mpl_toolkits.mplot3d.proj3d import proj_transform


def filled(area: ContourSet, points: np.ndarray) -> np.ndarray:
    """(k,) which of (k, 2) points of a picture an area covers, counting its rings around each."""
    rings = [Path(ring) for path in area.get_paths() for ring in path.to_polygons()]
    return sum((ring.contains_points(points) for ring in rings), np.zeros(len(points), int)) % 2 == 1


def assert_apart(figure: Figure, texts: Sequence[Text], least: int = 2) -> None:
    """Raise an AssertionError that names two texts which overlap in a figure as it is laid out and drawn.

    The halves of a line above and below letters do not count. There are at least so many texts.
    """
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    boxes = [(text.get_text(), _extent(text)) for text in texts if text.get_text().strip()]
    assert len(boxes) >= least
    for (one, first), (other, second) in combinations(boxes, 2):
        across = min(first.x1, second.x1) - max(first.x0, second.x0)
        up = min(first.y1, second.y1) - max(first.y0, second.y0)
        slack = 0.2 * min(first.height, second.height)
        assert across <= 1 or up <= slack, f"{one!r} and {other!r} overlap by {across:.0f} x {up:.0f} pixels"


def _extent(text: Text) -> Bbox:
    """The box in pixels that a text takes, also one in space, which matplotlib tells as if it were flat."""
    box = text.get_window_extent()
    if not isinstance(text, Text3D):
        return box
    axes = text.axes
    across, up, _ = proj_transform(*text.get_position_3d(), axes.get_proj())
    shift = axes.transData.transform((across, up)) - axes.transData.transform(text.get_position())
    return box.translated(*shift)
