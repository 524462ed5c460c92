"""Proof that no path exists: zones that separate a device's start direction from its goal direction.

However the platform and the joints move, the boresight of a device draws a continuous curve on the unit
sphere of inertial directions. A keep-out zone forbids it an open cap, a keep-in zone the cap around the
opposite direction that is left outside the cone. Where a closed ring of overlapping caps runs between the
directions at start and goal, every curve from one to the other enters the ring, and so no motion exists.

Whether there is such a ring is decided exactly. Seen by stereographic projection from the start direction,
which lies in no cap, all caps are discs of the plane, small or large: convex, so that the segment between the
centres of two discs that overlap lies within these two. A ring is a closed polygon of such segments which
winds around the image of the goal. By the nerve theorem the cycles of the graph of overlaps generate all
loops within a union of convex sets: where none of them winds around the goal no loop of forbidden directions
does, and the two directions are connected. Any ring is therefore a proof, and no ring means that these zones
alone do not separate the two.

To sum integers instead of angles, each segment is given the number of times that it crosses a fixed ray from
the goal, counted with sign; in the plane the ray ends at infinity, which is the start. A polygon winds around
the goal when its crossings do not add up to zero.

Touching caps leave a free point between them, and rounding must never make a proof: caps are first shrunk by
`TOLERANCE`, and count as overlapping when they still do so by as much. Rounding moves them by some 1e-15 rad.
What is proved is thus a little more: no motion exists even if margins may fall to -4e-9 rad, which is beyond
the -1e-9 rad that a certificate allows.

A row of a constraint with several entries need not hold by itself, and one whose axis turns with the body is
no cap of the sphere: no proof may use either, and both are left out.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan.geometry.vectors import separation
from jaxplan.model.constraints import INERTIAL, Constraints, constraint_margins, state_margins
from jaxplan.model.path import motion
from jaxplan.runtime.display import shown
from jaxplan.search.scene import Scene

# By how much each cap is shrunk before anything is decided, rad.
TOLERANCE = 4e-9
# Directions closer than this count as connected, rad: between them passes no ring of caps that overlap by
# more than the tolerance, unless they are smaller than 1e-6 rad.
TOGETHER = 1e-7


@shown("device", "zones")
@dataclass(frozen=True, kw_only=True)
class Barrier:
    """Zones that separate the directions of a device at start and goal.

    Attributes:
        device: number of the device, or of another bound direction beyond the devices (a sight of the scene).
        zones: numbers of rows of `Scene.cones`, ascending; all of them are needed for this proof.
    """

    device: int
    zones: tuple[int, ...]


def find_barrier(scene: Scene) -> Barrier | None:
    """Look for a device that no motion brings from its start direction to its goal direction.

    A terminal's direction at the goal is its target, the same for all goals; that of an instrument, or of any
    device without target, depends on this goal's attitude and joints.

    Args:
        scene: a search problem; groups of zones are left out.

    Returns:
        The first such device, with the fewest zones that suffice to stop it. None where every device by
        itself could pass, or where start or goal break a zone; this proves nothing about the devices
        together.
    """
    for device, (start, goal) in enumerate(zip(*scene.seen, strict=True)):
        rows = separating_zones(scene.cones, device, start, goal)
        if rows is not None:
            return Barrier(device=device, zones=rows)
    return None


def most_obstructive(scene: Scene) -> tuple[Constraints, int] | None:
    """Find the constraint that the straight motion from start to goal breaks most.

    Args:
        scene: a search problem.

    Returns:
        The one of `scene.tables` that it is in, and the index of its first row there; None where the straight
        motion breaks nothing.
    """
    left = scene.goal_joints - scene.start_joints
    attitudes, joints = motion(
        scene.start_attitude, scene.start_joints, scene.goal_coordinates, left, np.linspace(0, 1, 201)
    )
    deepest, found = 0.0, None
    for rows in scene.tables:
        margins = constraint_margins(rows, state_margins(rows, scene.sights, attitudes, joints))
        if margins.size and margins.min() < deepest:
            deepest, found = float(margins.min()), (rows, int(margins.min(axis=0).argmin()))
    return found


def separating_zones(
    cones: Constraints, device: int, start: np.ndarray, goal: np.ndarray
) -> tuple[int, ...] | None:
    """Find the fewest zones that separate two directions of a device, see `separating_caps`.

    Args:
        cones: the zones; those of a group of several are left out.
        device: number of the device (or other sight).
        start: (3,) inertial unit vector.
        goal: (3,) inertial unit vector.

    Returns:
        Row numbers of the cones, ascending; None where the two are connected, or one of them breaks a zone.
    """
    rows = np.flatnonzero(cones.single & (cones.frame == INERTIAL) & cones.bound[:, device])
    side, half_angle = cones.side[rows], cones.half_angle[rows]
    ring = separating_caps(
        side[:, None] * cones.axis[rows],
        np.where(side > 0, half_angle, np.pi - half_angle),
        start,
        goal,
    )
    return None if ring is None else tuple(rows[list(ring)].tolist())


def separating_caps(
    axes: np.ndarray, half_angles: np.ndarray, start: np.ndarray, goal: np.ndarray
) -> tuple[int, ...] | None:
    """Find the fewest open caps of the sphere that separate two directions outside all of them.

    Args:
        axes: (Z, 3) unit vectors, axes of Z caps.
        half_angles: (Z,) rad, in (0, pi).
        start: (3,) unit vector.
        goal: (3,) unit vector.

    Returns:
        Indices of the caps, ascending, at least three; where several sets are equally small, one of them.
        None where the two are connected outside the caps (there is a way between touching caps), or one of
        them lies in a cap.
    """
    if len(axes) < 3 or separation(start, goal) < TOGETHER:  # two discs of the plane enclose nothing
        return None
    to_start = separation(axes, start)
    margins = np.minimum(to_start, separation(axes, goal)) - half_angles
    if not np.all(margins >= -TOLERANCE / 2):
        return None
    radius = half_angles - TOLERANCE
    overlap = separation(axes[:, None], axes) < radius[:, None] + radius - TOLERANCE
    np.fill_diagonal(overlap, False)
    if np.count_nonzero(overlap) < 6:  # each pair counts twice
        return None
    bearings = _bearings(axes, radius, to_start, start, goal)
    cut = np.angle(bearings)  # of the ray, which lies where this angle jumps by a whole turn
    turned = np.angle(bearings.conj()[:, None] * bearings)
    crossings = np.rint((turned - (cut - cut[:, None])) / (2 * np.pi)).astype(int) * overlap
    # a ring crosses the ray somewhere, and forward in one of its two senses
    roots = np.flatnonzero(np.any(crossings > 0, axis=1)).tolist()
    if not roots:
        return None
    neighbours = [np.flatnonzero(row).tolist() for row in overlap]
    return _shortest_ring(neighbours, crossings.tolist(), roots)


def _bearings(
    axes: np.ndarray, radius: np.ndarray, to_start: np.ndarray, start: np.ndarray, goal: np.ndarray
) -> np.ndarray:
    """Return vectors (Z,), as complex numbers, from the image of the goal to the centres of the caps' discs.

    Stereographic projection from the start takes the Z caps of unit `axes` (Z, 3) and half-angles `radius`
    (Z,) rad to discs of the plane; `to_start` (Z,) rad are the angles from the axes to the start, which lies
    in no cap. Each vector is multiplied by a positive factor of its own, as only the phases are used.

    From the start direction ``a``, a cap of axis ``d`` and half-angle ``h`` is projected to the disc of
    centre ``d' / (cos h - a.d)`` and radius ``sin h / (cos h - a.d)``, the goal ``b`` to ``b' / (1 - a.b)``,
    where ``'`` takes the part normal to ``a``. The vector between the two is multiplied by both denominators:
    nothing is divided, and a start at a cap's rim makes the disc a half-plane.
    """
    # two axes normal to the start: those of a reflection that brings it to the z axis
    mirror = start + np.copysign([0.0, 0.0, 1.0], start[2])
    normal = np.eye(3)[:2] - np.outer(2 * mirror[:2] / (mirror @ mirror), mirror)
    to_plane = normal[0] + 1j * normal[1]
    # cos h - a.d, without losing digits where the start is at the rim
    height = 2 * np.sin((to_start + radius) / 2) * np.sin((to_start - radius) / 2)
    apart = goal - start
    return (apart @ apart / 2) * (axes @ to_plane) - height * (goal @ to_plane)


def _shortest_ring(
    neighbours: list[list[int]], crossings: list[list[int]], roots: list[int]
) -> tuple[int, ...] | None:
    """Find a ring of the fewest caps around the goal.

    The search is breadth first from a root. If the root lies on a shortest ring, each cap of the ring is
    reached over no more caps than along the ring, either way round. So the edge of the ring whose crossings
    contradict those of the tree closes a ring that is no longer.

    Args:
        neighbours: for each cap, those that it overlaps.
        crossings: [i][j] signed crossings of the ray from cap i to cap j.
        roots: caps to start from; at least one lies on each ring.

    Returns:
        Indices of its caps, ascending; None where there is no ring.
    """
    best: tuple[int, ...] | None = None
    for root in roots:
        branch: dict[int, tuple[int, ...]] = {root: (root,)}  # of each cap reached, those on the way to it
        count = {root: 0}  # crossings on that way
        queue = [root]
        for cap in queue:
            if best is not None and 2 * len(branch[cap]) - 1 >= len(best):
                break  # from here on, rings are as long
            for other in neighbours[cap]:
                reached = count[cap] + crossings[cap][other]
                if other not in count:
                    branch[other], count[other] = (*branch[cap], other), reached
                    queue.append(other)
                elif count[other] != reached:
                    found = {*branch[cap], *branch[other]}
                    if best is None or len(found) < len(best):
                        best = tuple(sorted(found))
    return best
