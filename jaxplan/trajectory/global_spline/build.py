"""From a path to the task that `sqp` works on, and from its curve to a trajectory."""

from dataclasses import dataclass

import numpy as np

from jaxplan.model.constraints import axes_in_body, counted, pair_margins, room
from jaxplan.model.limits import highest_derivative
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.global_spline.bases import SMOOTHNESS, Basis
from jaxplan.trajectory.global_spline.curve_space import CurveSpace, Ends
from jaxplan.trajectory.global_spline.linear_rows import Tube
from jaxplan.trajectory.global_spline.problem import Problem
from jaxplan.trajectory.global_spline.stack import Point, Task
from jaxplan.trajectory.global_spline.timing import along

CLEARANCE = float(np.deg2rad(0.3))  # wanted beyond zones, so that nothing happens between the places
OF_ENDS = 0.5  # at most this share of the margin that start or goal leave
_SMOOTHING = 1e-9  # of the third derivative, beside the distance from the path


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Where a spline has its breaks, and where it passes the nodes.

    Attributes:
        places: (m + 1,) of the nodes in [0, 1].
        basis: of the splines.
        points: places on each interval at which loads and margins are looked at.
        radius: rad, of the tube about the nodes; 0 to pass them exactly, inf for none.
    """

    places: np.ndarray
    basis: Basis
    points: int
    radius: float


def build(
    problem: Problem,
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
) -> tuple[Task, np.ndarray]:
    """The task for `sqp.improve`, and a curve to begin with.

    Args:
        problem: chart, limits and zones.
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
        The task, and coefficients (n, A) of the spline nearest to the path.
    """
    basis = mesh.basis
    if np.any(rates[1, :3]):
        rates = rates.copy()
        rates[1, :3] = problem.chart.end_turn @ rates[1, :3]
    space = CurveSpace.of(basis, Ends(values=nodes[[0, -1]], rates=rates, rest=rest))
    # At an end in rest with no acceleration only what is made of the jerk may be the largest there is.
    places, rows = basis.within(mesh.points, to_end=highest_derivative(problem.names) > 2 or not rest)
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
    task = Task(
        problem=problem,
        space=space,
        places=places,
        rows=rows,
        wanted=wanted,
        tube=tube,
        limited=limited,
        weights=weights,
        free_time=free_time,
    )
    return task, first


def trajectory(task: Task, point: Point, node_times: np.ndarray) -> Trajectory:
    """The curve of a point in time.

    Args:
        task: its chart and basis.
        point: the curve.
        node_times: (m + 1,) s, when the nodes are passed.
    """
    basis, chart, duration = task.space.basis, task.problem.chart, point.duration
    pieces = basis.pieces(point.coefficients)
    count = len(pieces)
    breaks = basis.breaks * duration
    return Trajectory(
        breaks=breaks,
        chart_attitude=np.repeat(chart.attitude[None], count, axis=0),
        chart_start=np.zeros(count),
        chart_rate=np.repeat(chart.turn[None] / duration, count, axis=0),
        coefficients=np.ascontiguousarray(pieces[:, :, :3]),
        joint_breaks=breaks,
        joint_coefficients=np.ascontiguousarray(pieces[:, :, 3:]),
        node_times=node_times,
        smoothness=SMOOTHNESS,
        method="global",
    )


def _nearest(space: CurveSpace, rows: np.ndarray, wanted: np.ndarray, duration: float) -> np.ndarray:
    """The curve nearest to points (S, A) at the places, a little smoothed."""
    start = space.fixed + duration * space.by_time
    design = rows @ space.free
    bending = space.free.T @ space.energies[3] @ space.free
    weight = _SMOOTHING * len(bending) / np.trace(bending)
    pull = design.T @ (wanted - rows @ start) - weight * (space.free.T @ (space.energies[3] @ start))
    return start + space.free @ np.linalg.solve(design.T @ design + weight * bending, pull)


def wanted_margins(problem: Problem, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Margins to keep (D, Z), rad: no more than half of what the ends and the row itself leave."""
    least = np.maximum(np.min(end_margins(problem, attitudes, joints), axis=0), 0)
    # The room is for rows of an entry beside which another one holds at both ends.
    return np.minimum(np.minimum(CLEARANCE, room(problem.cones)), OF_ENDS * least)


def end_margins(problem: Problem, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Margins (2, D, Z) at start and goal of nodes, rad, as `Motion` has them."""
    cones, ends = problem.cones, [0, -1]
    seen = problem.sights.in_body(joints[ends])
    axes = axes_in_body(cones, problem.axes(np.array([0.0, 1.0])) @ attitudes[ends], seen)
    margins = pair_margins(cones, seen, axes, joints[ends])
    kept = counted(cones, np.min(margins, axis=2, initial=np.inf))
    return np.asarray(np.swapaxes(np.where(kept[..., None], margins, np.inf), 1, 2))
