"""A fit in finitely many numbers: splines on one mesh, in one chart, evaluated at finitely many places.

Letters of sizes are those of `motion`; a path has m + 1 nodes.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from jaxplan.model.limits import highest_derivative
from jaxplan.runtime.batching import padded_count
from jaxplan.trajectory.chart import CHART_REACH, Chart, farthest, fitting
from jaxplan.trajectory.node_times import along
from jaxplan.trajectory.problem import FitProblem, Mesh
from jaxplan.trajectory.splines import CurveSpace

_MIN_TUBE_NODES = 8  # least padded number of nodes in tubes; a larger one makes more fits alike
_SMOOTHING_WEIGHT = 1e-9  # weight of the third derivative beside the distance from the path, in first curves

Timing = Literal["given", "stretched", "shortest"]
"""How the duration of a curve is determined: "given" by the settings; "stretched" to the limits, after a fit
that ignores them; "shortest", an unknown of the fit, as short as the limits allow."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DiscreteProblem:
    """A fit in finitely many numbers: splines in a chart, evaluated at finitely many places.

    Attributes:
        problem: what is fitted.
        mesh: breaks of the splines, and the tube about the nodes.
        chart: of the platform's motion.
        nodes: (m + 1, A) rad, chart coordinates ``b`` and joint angles of the nodes.
        share: fraction of the limits on the platform's loads that may be used; the joints' may be used in
            full, since they are kept at every instant and not only at the places.
        timing: see `Timing`.
        space: the curves to choose from, with n spline coefficients on each of A axes.
        places: (S,) in [0, 1], where loads and margins are evaluated.
        rows: (4, S, n) values of the splines, and of their first three derivatives, at the places.
        tube_rows: (M, n) values of the splines at M nodes with a tube, padded with zeros so that more
            problems are alike; M is 0 where there is no tube.
        tube_values: (M, A) rad, these nodes, padded likewise.
        tube_radius: (A,) rad, for each axis; for the platform's three, of a cube within the ball.
        freed: whether the duration asked for is given, and is made free only until the limits are kept.
        to_the_end: whether a search goes on to the optimum, however little is to be gained.
    """

    problem: FitProblem
    mesh: Mesh
    chart: Chart
    nodes: np.ndarray
    share: float
    timing: Timing
    space: CurveSpace
    places: np.ndarray
    rows: np.ndarray
    tube_rows: np.ndarray
    tube_values: np.ndarray
    tube_radius: np.ndarray
    freed: bool = False
    to_the_end: bool = False

    @property
    def limited(self) -> bool:
        """Whether the fit itself has to keep limits of rates and loads."""
        return self.timing != "stretched"

    @property
    def free_time(self) -> bool:
        """Whether the duration is an unknown of the fit."""
        return self.timing == "shortest"

    @property
    def hastens(self) -> bool:
        """Whether a search for a shortest motion from rest to rest may end once little is left to gain."""
        return self.free_time and not self.freed and not self.to_the_end and not self.problem.at_speed

    @property
    def kind(self) -> tuple[Any, ...]:
        """Key of sizes and choices; only problems with equal keys can be put into one stack."""
        problem = self.problem
        return (
            self.rows.shape,
            self.space.free.shape,
            self.tube_rows.shape,
            problem.cones.bound.shape,
            problem.joints.shape[1],
            len(problem.spacecraft.drives),
            problem.names,
            problem.wheel_rows,
            None if problem.body.stages is None else problem.body.stages.turned,
            bool(problem.cones.paths),
            problem.cones.inner,
            len(problem.cones.carried),
            problem.at_speed,
            self.timing,
            self.hastens,
        )

    def nearest(self, duration: float) -> np.ndarray:
        """Coefficients (n, A) of the slightly smoothed curve nearest to the path, for a duration (s)."""
        space, rows = self.space, self.rows[0]
        wanted = along(self.nodes, self.mesh.places, self.places)
        start = space.fixed + duration * space.by_time
        design = rows @ space.free
        bending = space.free.T @ space.energies[3] @ space.free
        weight = _SMOOTHING_WEIGHT * len(bending) / np.trace(bending)
        pull = design.T @ (wanted - rows @ start) - weight * (space.free.T @ (space.energies[3] @ start))
        return start + space.free @ np.linalg.solve(design.T @ design + weight * bending, pull)

    def on_mesh(self, mesh: Mesh) -> "DiscreteProblem":
        """The same problem on another mesh, in the same chart."""
        nodes = self.problem.attitudes, self.problem.turns, mesh.places
        return _discretise_in_chart(
            self.problem, mesh, self.timing, self.share, self.chart, self.chart.coordinates(*nodes)
        )


def discretise(
    problem: FitProblem, mesh: Mesh, timing: Timing, *, share: float = 1.0
) -> DiscreteProblem | None:
    """Make the discrete problem that an attempt works on.

    Args:
        problem: what is fitted.
        mesh: breaks of the spline, places of the nodes, and the tube about them.
        timing: how the duration is determined.
        share: fraction of the limits on the platform's loads that may be used.

    Returns:
        The problem in the chart in which nodes lie nearest to a steady turn; None if one is beyond
        `CHART_REACH`.
    """
    chart, b = fitting(problem.attitudes, problem.turns, mesh.places)
    if not farthest(chart, b, mesh.places) <= CHART_REACH:
        return None
    return _discretise_in_chart(problem, mesh, timing, share, chart, b)


def _discretise_in_chart(
    problem: FitProblem, mesh: Mesh, timing: Timing, share: float, chart: Chart, b: np.ndarray
) -> DiscreteProblem:
    """Make the discrete problem in a chart in which the nodes have coordinates ``b`` (m + 1, 3), rad."""
    nodes, rates = np.column_stack([b, problem.joints]), problem.rates
    if np.any(rates[1, :3]):  # at the goal the chart has turned
        rates = rates.copy()
        rates[1, :3] = chart.end_turn @ rates[1, :3]
    inner, nobody = slice(1, -1), slice(0, 0)
    exact = inner if mesh.radius == 0 else nobody
    in_tube = inner if 0 < mesh.radius < np.inf else nobody
    radius = np.full(nodes.shape[1], mesh.radius)
    radius[:3] /= np.sqrt(3.0)  # an error of b bounds that of the attitude
    count, (size, axes) = len(nodes[in_tube]), (mesh.basis.size, nodes.shape[1])
    tube_rows, tube_values = (
        np.zeros((padded_count(count, _MIN_TUBE_NODES), width)) for width in (size, axes)
    )
    if count:
        tube_rows[:count] = mesh.basis.rows(mesh.places[in_tube], 1)[0]
        tube_values[:count] = nodes[in_tube]
    # At an end at rest without acceleration only loads that depend on the jerk may have their peak.
    to_end = highest_derivative(problem.names) > 2 or not problem.rests
    places, rows = mesh.basis.within(mesh.points, to_end=to_end)
    return DiscreteProblem(
        problem=problem,
        mesh=mesh,
        chart=chart,
        nodes=nodes,
        share=share,
        timing=timing,
        space=CurveSpace.of(
            mesh.basis, nodes[[0, -1]], rates, problem.rests, mesh.places[exact], nodes[exact]
        ),
        places=places,
        rows=rows,
        tube_rows=tube_rows,
        tube_values=tube_values,
        tube_radius=radius,
    )
