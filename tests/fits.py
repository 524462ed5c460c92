"""Problems of the spline fit, and stacks of them that are looked at where a test wants."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.model.constraints import Constraints
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory.discretisation import discretise
from jaxplan.trajectory.motion import Stack
from jaxplan.trajectory.node_times import edge_turns
from jaxplan.trajectory.problem import FitProblem


def problem_of(path: Path, spacecraft: Spacecraft, cones: Constraints) -> FitProblem:
    """What is fitted, from rest to rest."""
    return FitProblem(
        attitudes=path.attitudes,
        joints=path.joints,
        turns=edge_turns(path.attitudes),
        fractions=np.linspace(0, 1, len(path.attitudes)),
        rates=np.zeros((2, 3 + path.joints.shape[1])),
        spacecraft=spacecraft,
        cones=cones,
        settings=TrajectorySettings(),
    )


def stack_at(problems: Sequence[FitProblem], places: np.ndarray, rows: np.ndarray | None = None) -> Stack:
    """A stack of problems that are looked at in places (S,).

    Args:
        problems: of one kind.
        places: in [0, 1].
        rows: (4, S, n) of a basis there; without one the coefficients (4 S, A) of a curve are its values and
            its three derivatives at the places, one after the other.
    """
    count = len(places)
    rows = np.eye(4 * count).reshape(4, count, 4 * count) if rows is None else rows
    members = []
    for problem in problems:
        mesh = problem.mesh(problem.quickest, np.inf, 1, graded=False)
        discrete = discretise(problem, mesh, "given")
        assert discrete is not None
        none = np.zeros((0, rows.shape[2]))
        members.append(replace(discrete, places=places, rows=rows, tube_rows=none))
    return Stack.of(members)
