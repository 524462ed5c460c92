"""From a path to the problem in finitely many numbers that `sqp` works on, and a first curve."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxplan.model.constraints import axes_in_body, counted, pair_margins, room
from jaxplan.model.limits import highest_derivative
from jaxplan.runtime.batching import padded_count
from jaxplan.trajectory import options
from jaxplan.trajectory.problem import Mesh, System
from jaxplan.trajectory.schedule import along
from jaxplan.trajectory.splines import CurveSpace


@dataclass(frozen=True, eq=False)
class Tube:
    """Nodes that a curve must pass within a tube.

    Attributes:
        rows: (m, n) of the basis at the nodes.
        values: (m, A) rad.
        radius: (A,) rad, for each axis.
    """

    rows: np.ndarray
    values: np.ndarray
    radius: np.ndarray

    @property
    def padded_nodes(self) -> int:
        """What the number of nodes is padded to in a stack, so that more problems are alike."""
        return padded_count(len(self.rows), options.MESH.tube_nodes)


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteProblem:
    """A fit in finitely many numbers: curves of a space, looked at in some places.

    Attributes:
        system: chart, limits and zones.
        space: the curves.
        places: (S,) where loads and margins are looked at.
        rows: (4, S, n) of the basis there.
        wanted: (D, Z) rad, margins to keep.
        tube: about the nodes, or None.
        limited: whether limits of rates and loads are kept, or time will be stretched to them.
        weights: of the energy.
        free_time: whether the duration is looked for as well.
    """

    system: System
    space: CurveSpace
    places: np.ndarray
    rows: np.ndarray
    wanted: np.ndarray
    tube: Tube | None
    limited: bool
    weights: tuple[float, float, float]
    free_time: bool

    @property
    def kind(self) -> tuple[Any, ...]:
        """What the problems of one stack share."""
        system = self.system
        return (
            self.rows.shape,
            self.space.free.shape,
            self.wanted.shape,
            len(system.spacecraft.terminals),
            system.names,
            bool(system.cones.paths),
            system.cones.inner,
            len(system.cones.carried),
            None if self.tube is None else self.tube.padded_nodes,
            bool(np.any(self.space.by_time)),
            self.limited,
            self.free_time,
        )


def build(
    system: System,
    mesh: Mesh,
    nodes: np.ndarray,
    wanted: np.ndarray,
    *,
    rates: np.ndarray,
    rest: bool,
    duration: float,
    weights: tuple[float, float, float],
    limited: bool,
    free_time: bool,
) -> tuple[DiscreteProblem, np.ndarray]:
    """The problem for `sqp.improve`, and a curve to begin with.

    Args:
        system: chart, limits and zones.
        mesh: of the spline.
        nodes: (m + 1, A) ``b`` and joints, rad.
        wanted: (D, Z) rad, margins to keep.
        rates: (2, A) rad/s at start and end, of body axes and joints.
        rest: whether accelerations are zero at both ends.
        duration: s, given or to begin with.
        weights: of rate, acceleration and jerk.
        limited: whether limits are kept, or time will be stretched to them.
        free_time: whether the shortest duration is looked for.

    Returns:
        The problem, and coefficients (n, A) of the spline nearest to the path.
    """
    basis = mesh.basis
    if np.any(rates[1, :3]):
        rates = rates.copy()
        rates[1, :3] = system.chart.end_turn @ rates[1, :3]
    space = CurveSpace.of(basis, nodes[[0, -1]], rates, rest=rest)
    # At an end in rest with no acceleration only what is made of the jerk may be the largest there is.
    places, rows = basis.within(mesh.points, to_end=highest_derivative(system.names) > 2 or not rest)
    inner = slice(1, -1)
    tube = None
    if len(nodes) == 2:
        pass  # the ends are all there is
    elif mesh.radius == 0:
        space = space.through(mesh.places[inner], nodes[inner])
    elif np.isfinite(mesh.radius):
        # Of the platform's axes a cube within the ball: what b is off bounds what the attitude is.
        radius = np.full(nodes.shape[1], mesh.radius)
        radius[:3] /= np.sqrt(3.0)
        tube = Tube(basis.rows(mesh.places[inner], 1)[0], nodes[inner], radius)
    first = _nearest(space, rows[0], along(nodes, mesh.places, places), duration)
    discrete = DiscreteProblem(
        system=system,
        space=space,
        places=places,
        rows=rows,
        wanted=wanted,
        tube=tube,
        limited=limited,
        weights=weights,
        free_time=free_time,
    )
    return discrete, first


def _nearest(space: CurveSpace, rows: np.ndarray, wanted: np.ndarray, duration: float) -> np.ndarray:
    """The curve nearest to points (S, A) at the places, a little smoothed."""
    start = space.fixed + duration * space.by_time
    design = rows @ space.free
    bending = space.free.T @ space.energies[3] @ space.free
    weight = options.MESH.smoothing * len(bending) / np.trace(bending)
    pull = design.T @ (wanted - rows @ start) - weight * (space.free.T @ (space.energies[3] @ start))
    return start + space.free @ np.linalg.solve(design.T @ design + weight * bending, pull)


def wanted_margins(system: System, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Margins to keep (D, Z), rad: no more than half of what the ends and the row itself leave."""
    least = np.maximum(np.min(end_margins(system, attitudes, joints), axis=0), 0)
    # The room is for rows of an entry beside which another one holds at both ends.
    return np.minimum(
        np.minimum(options.ROWS.clearance, room(system.cones)), options.ROWS.share_of_ends * least
    )


def end_margins(system: System, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Margins (2, D, Z) at start and goal of nodes, rad, as `Motion` has them."""
    cones, ends = system.cones, [0, -1]
    seen = system.sights.in_body(joints[ends])
    axes = axes_in_body(cones, system.axes(np.array([0.0, 1.0])) @ attitudes[ends], seen)
    margins = pair_margins(cones, seen, axes, joints[ends])
    kept = counted(cones, np.min(margins, axis=2, initial=np.inf))
    return np.asarray(np.swapaxes(np.where(kept[..., None], margins, np.inf), 1, 2))
