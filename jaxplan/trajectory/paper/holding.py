"""From a fit by the paper's scheme to what is held of it: its segments and the limits that bind at joins."""

from dataclasses import dataclass

import numpy as np

from jaxplan.display import shown
from jaxplan.trajectory.basis import end_derivatives
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.paper import counting
from jaxplan.trajectory.paper.assembly import node_indices
from jaxplan.trajectory.paper.chain import Nodes
from jaxplan.trajectory.paper.refit import Held, HeldChain
from jaxplan.trajectory.schedule import FEWEST_NODES, padded

_BINDS = 1e-9  # of a limit


@shown()
@dataclass(frozen=True, kw_only=True, eq=False)
class Origin:
    """How a fit came about.

    Attributes:
        nodes: that were passed.
        trajectory: before its time was stretched.
        limits: of the platform (2, 3) and of the joints (2, 2n), rates and accelerations at the joins; None
            where the time was stretched to the limits.
    """

    nodes: Nodes
    trajectory: Trajectory
    limits: tuple[np.ndarray, np.ndarray] | None

    def hold(self) -> Held:
        """What is held of it; where a limit is just met at a join it counts as binding."""
        curve = self.trajectory
        order = curve.coefficients.shape[1] - 1
        ends = counting.split(len(self.nodes.turns), len(curve.coefficients), order)
        platform, joints = (None, None) if self.limits is None else self.limits
        return Held(
            fractions=padded(self.nodes.fractions, FEWEST_NODES),
            joints=_chain(ends[0], order, curve.joint_breaks, curve.joint_coefficients, joints, 1),
            platform=_chain(ends[1], order, curve.breaks, curve.coefficients, platform, 0),
            order=order,
            stretched=self.limits is None,
        )


def _chain(
    ends: np.ndarray,
    order: int,
    breaks: np.ndarray,
    coefficients: np.ndarray,
    limits: np.ndarray | None,
    far: int,
) -> HeldChain:
    """What is held of a chain whose segments are joined to the next one at their end ``far``."""
    nodes = node_indices(ends, order - 2)
    sides = np.zeros((len(ends) - 1, 2, coefficients.shape[2]))
    if limits is not None:
        half = np.diff(breaks)[:, None, None] / 2
        to_x = half ** np.array([[1], [2]])
        reached = end_derivatives(order)[far] @ coefficients / to_x
        sides = np.where(np.abs(reached) >= limits * (1 - _BINDS), np.sign(reached), 0.0)
        sides[-1 if far else 0] = 0.0  # the closing segment
    present = np.arange(order - 2) <= np.diff(ends)[:, None]
    return HeldChain(ends=ends, nodes=nodes, present=present, sides=sides)
