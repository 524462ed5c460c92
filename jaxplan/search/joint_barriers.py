"""Proof that no path exists: constraints that separate the joints of a device at start and goal.

Some constraints depend on one device's own joints alone, wherever the platform and the others are: masks, and
cones about what is fixed to the body. They forbid a part of the rectangle of its yaw and pitch, or of the
range of its angle, and where what is left has start and goal in different pieces no motion exists. Below, a
device has o of these joints: two, or one if it is a drive; a *place* is a point of their ranges.

The ranges are cut into cells. A motion of joints ``(dy, dp)`` turns nothing by more than ``hypot(dy, dp)``,
so a margin changes by no more, and a cell whose centre is deeper inside a zone than half a diagonal has no
free point: it is *closed*, the others are open. (For a row of joint angles with weights ``f`` the depth
needed is the sum of ``|f|`` times half the edges.) A path visits cells that touch, none of which is closed:
where no chain of open cells leads from the cell of the start to that of the goal, that is a proof. What is
thinner than a cell proves nothing. A device without a target may end before what blocks it (`short_of`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jaxplan.model.constraints import (
    BODY,
    INERTIAL,
    JOINTS,
    SIGHT,
    Constraints,
    constraint_margins,
    state_margins,
)
from jaxplan.runtime.display import shown
from jaxplan.search.scene import Scene

CELLS = (1440, (240, 120))
"""Number of cells of a drive's range, and of those of yaw and pitch."""
TOLERANCE = 4e-9
"""rad by which a closed cell is deeper than it must be: more than a certificate lets pass."""
_SPARE_MARGIN = 2e-5  # rad of margin that a device keeps to all constraints where it ends short of its goal
_WIDENINGS = tuple(np.deg2rad(0.25) * 1.25 ** np.arange(14))  # rad, half widths of gaps that are looked for
_LINE_SAMPLES = 1001  # places on the straight line from start to goal


@shown("device", "zones")
@dataclass(frozen=True, kw_only=True)
class JointBarrier:
    """Constraints that separate the joints of a device at start and goal.

    Attributes:
        device: number of the device, one with joints.
        zones: numbers of the scenario's zones, ascending; where one is enough, that alone.
        reach: (o, 2) rad, the least ranges of its o joints that hold all open cells connected to the start.
    """

    device: int
    zones: tuple[int, ...]
    reach: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)), compare=False)


def find_joint_barrier(scene: Scene, devices: Iterable[int] | None = None) -> JointBarrier | None:
    """Look for a device whose joints no motion brings from where they start to where they end.

    Args:
        scene: a search problem.
        devices: numbers of the devices with joints to look at; None for all.

    Returns:
        The first such device. None where every device by itself could pass, as far as the cells can tell.
    """
    return next((found for found, _ in _find_barriers(scene, devices, (0.0,))), None)


def narrowest(scene: Scene) -> tuple[JointBarrier, float] | None:
    """Look for the device that has to pass the narrowest gap between constraints of its own joints.

    Returns:
        The constraints that would separate its joints if each were wider by some angle on each side; and that
        angle, rad, which is at least half the width of the gap. None where no widening tried separates a
        device's joints while it leaves start and goal open.
    """
    return min(_find_barriers(scene, None, _WIDENINGS), key=lambda found: found[1], default=None)


def _find_barriers(
    scene: Scene, devices: Iterable[int] | None, wider: Sequence[float]
) -> Iterator[tuple[JointBarrier, float]]:
    """Find, for each device, what separates its joints once widened by the first sufficient angle of `wider`.

    Args:
        scene: a search problem.
        devices: numbers of the devices with joints to look at; None for all.
        wider: rad, tried in this order.

    Yields:
        The barrier and the angle, for each device that one of them separates.
    """
    if not any(rows.inner for rows in scene.tables):  # nothing is a matter of joints alone
        return
    for device in range(scene.gimbals.count) if devices is None else devices:
        tables = [_own_rows(rows, scene, device) for rows in scene.tables]
        if not any(np.any(rows.bound) for rows in tables):
            continue
        joints = scene.gimbals.joints_of(device)
        ends = scene.start_joints[joints], scene.goal_joints[joints]
        way = np.linspace(*ends, 201)
        if all(np.all(depth <= 0) for _, depth in _breach_depths(tables, scene, joints, way)):
            continue
        grid = _Grid.of(scene.joint_ranges[joints])
        cells = list(_breach_depths(tables, scene, joints, grid.centres, grid.sizes / 2))
        for by in wider:
            closed = [(zones, depth > TOLERANCE - by) for zones, depth in cells]
            shut = np.any([cells for _, cells in closed], axis=0)
            if grid.parts(shut, *ends):
                alone = [zones for zones, cells in closed if grid.parts(cells, *ends)]
                found = alone[0] if alone else {zone for zones, _ in closed for zone in zones}
                reach = grid.around(shut, ends[0])
                yield JointBarrier(device=device, zones=tuple(sorted(found)), reach=reach), by
                break


def short_of(scene: Scene, device: int) -> np.ndarray:
    """Return the last place before what blocks a device on the straight line to its goal.

    Args:
        scene: a search problem.
        device: number of a device with joints that cannot get there.

    Returns:
        Angles of the device's joints, (1,) for a drive or (2,), rad.
    """
    tables, joints = (
        [_own_rows(rows, scene, device) for rows in scene.tables],
        scene.gimbals.joints_of(device),
    )
    way = np.linspace(scene.start_joints[joints], scene.goal_joints[joints], _LINE_SAMPLES)
    broken = np.any(
        [depth > -_SPARE_MARGIN for _, depth in _breach_depths(tables, scene, joints, way)], axis=0
    )
    return np.asarray(way[max(int(np.argmax(broken)) - 1, 0)])


def _own_rows(rows: Constraints, scene: Scene, device: int) -> Constraints:
    """Return the rows, binding only those pairs that depend on the joints of device `device` alone.

    A constraint of several entries keeps its pairs of sight and row only if all of them are such.
    """
    carriers = np.asarray(scene.sights.carriers)
    own, still = carriers == device, carriers < 0
    partner = np.where(rows.frame == SIGHT, rows.partner, 0)
    by_body = own & ((rows.frame == BODY) | (rows.frame == JOINTS) | still[partner])[:, None]
    by_device = still & ((rows.frame == SIGHT) & own[partner])[:, None]
    decided = rows.bound & (by_body | by_device) & (rows.frame != INERTIAL)[:, None]
    open_groups = rows.group[np.any(rows.bound & ~decided, axis=1) & ~rows.single]
    return replace(rows, bound=decided & ~np.isin(rows.group, open_groups)[:, None])


def _breach_depths(
    tables: list[Constraints],
    scene: Scene,
    joints: np.ndarray,
    places: np.ndarray,
    around: np.ndarray | float = 0.0,
) -> Iterator[tuple[set[int], np.ndarray]]:
    """Return for each constraint its zones, and a lower bound of how deep it is broken near some places.

    Args:
        tables: the constraints.
        scene: the problem that they are of.
        joints: numbers of the device's o joints.
        places: (k, o) rad, k places.
        around: (o,) rad, how far to either side of a place the bound holds.

    Yields:
        The numbers of its zones, and (k,) least depth in rad, negative where the constraint may hold.
    """
    states = np.repeat(scene.start_joints[None], len(places), axis=0)
    states[:, joints] = places
    attitudes, sizes = np.broadcast_to(np.eye(3), (len(places), 3, 3)), np.broadcast_to(around, len(joints))
    for rows in tables:
        used = np.any(rows.bound, axis=1)
        if not np.any(used):
            continue
        linear = np.abs(rows.axis[:, : len(sizes)]) @ sizes
        reach = np.where(rows.frame == JOINTS, linear, np.linalg.norm(sizes))
        pairs = state_margins(rows, scene.sights, attitudes, states) + reach[:, None]
        margins = constraint_margins(rows, pairs)
        for group in np.unique(rows.group[used]):
            yield set(rows.zone[used & (rows.group == group)].tolist()), -margins[:, group]


@dataclass(frozen=True)
class _Grid:
    """Cells of the ranges (o, 2), rad, of o joints, one or two, with `counts` cells along each."""

    ranges: np.ndarray
    counts: tuple[int, ...]

    @classmethod
    def of(cls, ranges: np.ndarray) -> "_Grid":
        """Make the grid of the ranges (o, 2), rad, of o joints, with the usual number of cells."""
        return cls(ranges, (CELLS[0],) if len(ranges) == 1 else CELLS[1])

    @property
    def sizes(self) -> np.ndarray:
        """The edges of a cell, one for each joint, rad."""
        return np.asarray(np.ptp(self.ranges, axis=1) / self.counts)

    @property
    def centres(self) -> np.ndarray:
        """The centres of the cells, rad, (cells, joints)."""
        axes = [
            low + size * (np.arange(count) + 0.5)
            for (low, _), size, count in zip(self.ranges, self.sizes, self.counts, strict=True)
        ]
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)

    def parts(self, closed: np.ndarray, start: np.ndarray, goal: np.ndarray) -> bool:
        """Tell whether closed cells, (cells,) bool, separate two places, angles of the joints in rad.

        It is False where one of the places is in a closed cell.
        """
        pieces = self._label_pieces(closed)
        one, other = pieces[self._cell_indices(start)], pieces[self._cell_indices(goal)]
        return bool(one and other and one != other)

    def around(self, closed: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return the ranges, (joints, 2) rad, of the open cells connected to that of the place `start`.

        `closed` (cells,) is bool.
        """
        pieces = self._label_pieces(closed)
        cells = np.argwhere(pieces == pieces[self._cell_indices(start)])
        first, last = np.min(cells, axis=0), np.max(cells, axis=0) + 1
        return self.ranges[:, :1] + np.stack([first, last], axis=1) * self.sizes[:, None]

    def _label_pieces(self, closed: np.ndarray) -> np.ndarray:
        """Number the connected pieces of open cells from 1, and return each cell's number; 0 if closed."""
        from scipy.ndimage import label  # slow to import, and seldom needed

        return np.asarray(label(~closed.reshape(self.counts), structure=np.ones([3] * len(self.counts)))[0])

    def _cell_indices(self, place: np.ndarray) -> tuple[int, ...]:
        """Return the indices of the cell of a place, or of the nearest cell where it is out of range."""
        cell = (place - self.ranges[:, 0]) // self.sizes
        return tuple(np.clip(cell, 0, np.array(self.counts) - 1).astype(int).tolist())
