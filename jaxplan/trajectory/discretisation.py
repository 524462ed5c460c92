"""From a path to the problem in finitely many numbers that `sqp` works on, and a first curve."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxplan.model.constraints import axes_in_body, counted, pair_margins, room
from jaxplan.model.limits import highest_derivative
from jaxplan.runtime.batching import padded_count
from jaxplan.trajectory import options
from jaxplan.trajectory.chart import farthest, fitting
from jaxplan.trajectory.problem import AttemptRequest, FitProblem, Mesh, System
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


def discretise(request: AttemptRequest) -> tuple[DiscreteProblem, np.ndarray] | None:
    """The problem for `sqp.improve`, and a curve to begin with.

    Args:
        request: what is looked for.

    Returns:
        The problem, and coefficients (n, A) of the spline nearest to the path; None if the nodes leave every
        chart.
    """
    problem, mesh = request.problem, request.mesh
    chart, b = fitting(problem.attitudes, mesh.places)
    if not farthest(chart, b, mesh.places) <= options.CHART.reach:
        return None
    system = System(
        chart=chart,
        spacecraft=problem.spacecraft,
        cones=problem.cones,
        horizon=problem.horizon,
        share=1 - request.tighter,
    )
    nodes = np.column_stack([b, problem.joints])
    space, places, rows = _curves(problem, system, mesh, nodes)
    discrete = DiscreteProblem(
        system=system,
        space=space,
        places=places,
        rows=rows,
        wanted=wanted_margins(system, problem.attitudes, problem.joints),
        tube=_tube(mesh, nodes),
        limited=request.limited,
        weights=problem.weights,
        free_time=request.free_time,
    )
    return discrete, _nearest(space, rows[0], along(nodes, mesh.places, places), request.duration)


def _curves(
    problem: FitProblem, system: System, mesh: Mesh, nodes: np.ndarray
) -> tuple[CurveSpace, np.ndarray, np.ndarray]:
    """The curves that may be chosen, and the places (S,) that are looked at with the rows there."""
    inner = slice(1, -1)
    space = CurveSpace.of(mesh.basis, nodes[[0, -1]], _rates(problem, system), rest=problem.rests)
    if mesh.radius == 0 and len(nodes) > 2:
        space = space.through(mesh.places[inner], nodes[inner])
    # At an end in rest with no acceleration only what is made of the jerk may be the largest there is.
    to_end = highest_derivative(system.names) > 2 or not problem.rests
    return space, *mesh.basis.within(mesh.points, to_end=to_end)


def on_mesh(problem: FitProblem, discrete: DiscreteProblem, mesh: Mesh) -> DiscreteProblem:
    """The same problem on a mesh with as many breaks a little elsewhere."""
    nodes = np.column_stack(
        [discrete.system.chart.coordinates(problem.attitudes, mesh.places), problem.joints]
    )
    space, places, rows = _curves(problem, discrete.system, mesh, nodes)
    return replace(discrete, space=space, places=places, rows=rows, tube=_tube(mesh, nodes))


def _rates(problem: FitProblem, system: System) -> np.ndarray:
    """Rates (2, A) rad/s of the coordinates at both ends: at the goal the chart has turned."""
    rates = problem.rates
    if np.any(rates[1, :3]):
        rates = rates.copy()
        rates[1, :3] = system.chart.end_turn @ rates[1, :3]
    return rates


def _tube(mesh: Mesh, nodes: np.ndarray) -> Tube | None:
    """The tube about the inner nodes, of the platform's axes a cube within the ball; None without one."""
    if len(nodes) == 2 or not 0 < mesh.radius < np.inf:
        return None
    radius = np.full(nodes.shape[1], mesh.radius)
    radius[:3] /= np.sqrt(3.0)  # what b is off bounds what the attitude is
    return Tube(mesh.basis.rows(mesh.places[1:-1], 1)[0], nodes[1:-1], radius)


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
