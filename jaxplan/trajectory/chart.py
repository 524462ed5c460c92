"""A chart of SO(3) for a whole manoeuvre, and which of two charts fits a path better.

The chart turns steadily from the first attitude to the last while the place ``s`` (a fraction of the
duration) goes from 0 to 1: with ``t_a = 0`` and ``Omega = r`` of `jaxplan.trajectory.curve`. The rotation
vector ``eta`` is how far a motion departs from the steady one. It is a logarithm, taken on the branch to
which the edge from the node before leads, so nodes may lie more than half a turn off the steady motion; ``D``
is regular up to a whole turn.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan import so3

CHART_REACH = 4.0  # rad, most that nodes may lie off the steady rotation; at a whole turn charts are singular


_LONG_WAY_ANGLE = 1.0  # rad; if nodes lie no farther off, the chart of the other way round is not tried


_MIN_ANGLE = 1e-300  # rad; a rotation vector that is not longer has no direction


@dataclass(frozen=True, kw_only=True, eq=False)
class Chart:
    """A chart of SO(3) that turns steadily from the first attitude of a manoeuvre to the last.

    Attributes:
        attitude: (3, 3) ``R_a``, first attitude, body to inertial.
        turn: (3,) rad, ``r``, rotation vector from the first attitude to the last, in axes of the first.
    """

    attitude: np.ndarray
    turn: np.ndarray

    @property
    def end_turn(self) -> np.ndarray:
        """(3, 3) rotation ``U`` at the end of the motion, where ``b' = U omega`` (equation 36)."""
        return np.asarray(so3.exp(self.turn / 2))

    def coordinates(self, attitudes: np.ndarray, turns: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Compute the coordinates ``b`` of nodes in the chart.

        The logarithm of each node is taken on the branch to which the edge from the node before leads.

        Args:
            attitudes: (m + 1, 3, 3) in the order of the motion, the first one that of the chart.
            turns: (m, 3) rad, rotation vector of each edge in the axes of its first node.
            places: (m + 1,) of the nodes in [0, 1].

        Returns:
            (m + 1, 3) rad.
        """
        eta, steps = self.departures(attitudes, turns, places)
        angle = np.linalg.norm(eta[1:], axis=1)
        elsewhere = _windings(eta[:-1], steps, eta[1:], angle) != 0
        begin = int(np.argmax(elsewhere)) if np.any(elsewhere) else len(steps)
        for number in range(begin, len(steps)):
            own = eta[number + 1]
            windings = _windings(eta[number], steps[number], own, angle[number])
            own *= 1 + 2 * np.pi / max(angle[number], _MIN_ANGLE) * windings
        return np.asarray(eta + places[:, None] * self.turn)

    def departures(
        self, attitudes: np.ndarray, turns: np.ndarray, places: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute departures ``eta`` of nodes from the steady motion, and their changes along edges.

        Arguments are those of `coordinates`.

        Returns:
            Departures (m + 1, 3) in rad of at most half a turn each, and changes (m, 3) in rad along each
            edge, to first order.
        """
        back = so3.exp(-places[:, None] * self.turn / 2)  # U^T
        eta = so3.log(back @ (self.attitude.T @ attitudes) @ back)
        turned = np.einsum("mji,mj->mi", back[:-1], turns)
        return eta, turned - np.diff(places)[:, None] * self.turn


def fitting(attitudes: np.ndarray, turns: np.ndarray, places: np.ndarray) -> tuple[Chart, np.ndarray]:
    """Choose the chart from the first node to the last in which all nodes lie nearest to the steady motion.

    The candidates turn the short and the long way round the same axis; the latter is tried only if nodes lie
    farther than `_LONG_WAY_ANGLE` off the former.

    Args:
        attitudes: (m + 1, 3, 3) body to inertial.
        turns: (m, 3) rad, rotation vector of each edge in the axes of its first node.
        places: (m + 1,) in [0, 1].

    Returns:
        The chart, and ``b`` (m + 1, 3) at the nodes, rad.
    """

    def about(turn: np.ndarray) -> tuple[float, Chart, np.ndarray]:
        chart = Chart(attitude=attitudes[0], turn=turn)
        b = chart.coordinates(attitudes, turns, places)
        return farthest(chart, b, places), chart, b

    turn = so3.log(attitudes[0].T @ attitudes[-1])
    best, angle = about(turn), np.linalg.norm(turn)
    if best[0] > _LONG_WAY_ANGLE and angle > 0:
        long_way = about(turn * (1 - 2 * np.pi / angle))
        best = min(best, long_way, key=lambda one: one[0])
    return best[1:]


def farthest(chart: Chart, b: np.ndarray, places: np.ndarray) -> float:
    """Largest ``|eta|`` of the nodes in rad; inf where the last node is not at the chart's own end."""
    eta = b - places[:, None] * chart.turn
    distances = np.linalg.norm(eta, axis=1)
    return float(np.max(distances)) if distances[-1] < 1 else np.inf


def _windings(before: np.ndarray, step: np.ndarray, own: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Number of whole turns to add to rotation vectors so that they come out where a step leads.

    Args:
        before: (..., 3) rad, where the step begins.
        step: (..., 3) rad, the step, to first order.
        own: (..., 3) rad, the vectors at its end, each known up to whole turns.
        angle: (...) rad, lengths of `own`.

    Returns:
        (...) whole numbers as floats; zero for vectors without length.
    """
    ahead = np.sum((before + step) * own, axis=-1) / np.maximum(angle, _MIN_ANGLE)
    return np.where(angle > _MIN_ANGLE, np.round((ahead - angle) / (2 * np.pi)), 0.0)
