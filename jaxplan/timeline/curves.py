"""Trajectories through states at nodes, joining and cutting them, and giving their ends accelerations.

**Through nodes.** Joints follow the spline of degree 5 through their angles. The platform follows such a
spline in charts ``R_a exp(b^)``: each is about the attitude ``R_a`` at its start and is left before the
platform has turned by a radian. Where charts meet, angular velocity and acceleration are those of a spline
through the nodes around, so that the motion has two continuous derivatives there, and four elsewhere.

**Bent ends.** Slews are fitted between attitudes, joints and rates. What they lack in acceleration ``a`` at
an end is added on the outermost piece, of length ``h``: ``a h^2 u^3 (1 - u)^2 / 2``, with ``u`` from 0 at the
inner end of the piece to 1 at the outer one. Its value and rate are zero at both ends, its acceleration is
zero at the inner and ``a`` at the outer one. It moves nothing by more than ``0.0173 a h^2``, and changes no
rate by more than ``0.0678 a h``; on a shorter piece both are smaller, with more jerk but no more
acceleration.

Coefficients are those of Legendre polynomials on each piece, mapped to [-1, 1].
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import factorial
from typing import Any

import numpy as np

from jaxplan import so3
from jaxplan.timeline.least_energy import Nodes
from jaxplan.trajectory import Trajectory

DEGREE = 5
_CHART_TURN = 1.0  # rad, rotation after which a new chart begins
_NODES_TO_SIDE = 5  # nodes to either side, from which derivatives at the ends of charts are computed
FEWEST = 8  # nodes of a curve

# From coefficients of powers of (u + 1) / 2 to Legendre coefficients in u, for degree 5.
_POWERS_TO_LEGENDRE = np.zeros((DEGREE + 1, DEGREE + 1))
for _power in range(DEGREE + 1):
    _shifted_power = np.polynomial.polynomial.polypow([0.5, 0.5], _power)
    _POWERS_TO_LEGENDRE[: _power + 1, _power] = np.polynomial.legendre.poly2leg(_shifted_power)


def through(nodes: Nodes) -> Trajectory:
    """Return the trajectory through nodes; its time zero is that of the first node.

    Args:
        nodes: the states to pass, at least `FEWEST` of them.
    """
    times = nodes.times - nodes.times[0]
    joints = _legendre_spline(times, nodes.joints)
    edges = chart_ends(nodes.attitudes)
    derivatives = {node: _body_derivatives(times, nodes.attitudes, node) for node in edges}
    breaks, coefficients, attitudes, starts = [times[:1]], [], [], []
    for first, last in pairwise(edges):
        own = slice(first, last + 1)
        b = so3.log(nodes.attitudes[first].T @ nodes.attitudes[own])
        ends = [_chart_derivatives(eta, *derivatives[node]) for eta, node in ((b[0], first), (b[-1], last))]
        spline = _legendre_spline(times[own], b, ends)
        breaks.append(spline[0][1:])
        coefficients.append(spline[1])
        attitudes += [nodes.attitudes[first]] * len(spline[1])
        starts += [times[first]] * len(spline[1])
    return Trajectory(
        breaks=np.concatenate(breaks),
        chart_attitude=np.array(attitudes),
        chart_start=np.array(starts),
        chart_rate=np.zeros((len(starts), 3)),
        coefficients=np.concatenate(coefficients),
        joint_breaks=joints[0],
        joint_coefficients=joints[1],
        node_times=times[[0, -1]],
        smoothness=2,
        method="tracking",
    )


def _legendre_spline(
    times: np.ndarray, values: np.ndarray, ends: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the spline of degree 5 through values, as breaks (p + 1,) s and coefficients (p, 6, d).

    It has p pieces; coefficients are those of Legendre polynomials.

    Args:
        times: (n,) s, of the values.
        values: (n, d).
        ends: (first, second) derivative (d,) at either end; None to leave them to the values ("not-a-knot").
    """
    base = values[:1]  # what stands still does so to the last bit
    spline = interpolated(times, values - base, ends)
    breaks = np.unique(spline.t)
    size = np.diff(breaks)
    powers = np.stack(
        [
            spline(breaks[:-1], order) * size[:, None] ** order / factorial(order)
            for order in range(DEGREE + 1)
        ]
    )
    coefficients = np.einsum("lk,kpd->pld", _POWERS_TO_LEGENDRE, powers)
    coefficients[:, 0] += base
    return breaks, coefficients


def interpolated(times: np.ndarray, values: np.ndarray, ends: Any = None) -> Any:
    """Return scipy's spline of degree 5 through values; arguments as of `_legendre_spline`."""
    given = None if ends is None else tuple([(1, rate), (2, bend)] for rate, bend in ends)
    return _interpolate(times, values, given)


def rising(times: np.ndarray, values: np.ndarray) -> Any:
    """Return scipy's spline of degree 5 whose first two derivatives are zero at its start.

    Its third and fourth derivatives are zero at its end. Arguments are as of `_legendre_spline`.
    """
    zero = np.zeros(values.shape[1])
    return _interpolate(times, values, ([(1, zero), (2, zero)], [(3, zero), (4, zero)]))


def _interpolate(times: np.ndarray, values: np.ndarray, conditions: Any) -> Any:
    """Return scipy's spline of degree 5 through values; `conditions` is scipy's `bc_type`."""
    from scipy.interpolate import make_interp_spline  # slow to import, so not at the top

    return make_interp_spline(times, values, k=DEGREE, bc_type=conditions)


def chart_ends(attitudes: np.ndarray) -> list[int]:
    """Return indices of nodes at which charts end: first, last, and those before a turn of `_CHART_TURN`."""
    edges = [0]
    for node in range(1, len(attitudes)):
        far = so3.distance(attitudes[edges[-1]], attitudes[node]) > _CHART_TURN
        if far and node - 1 > edges[-1]:
            edges.append(node - 1)
    return [*edges, len(attitudes) - 1]


def _body_derivatives(times: np.ndarray, attitudes: np.ndarray, node: int) -> tuple[np.ndarray, np.ndarray]:
    """Return angular velocity and acceleration at a node, (3,) each in body axes, from the nodes around."""
    own = around(len(times), node)
    spline = interpolated(times[own], so3.log(attitudes[node].T @ attitudes[own]))
    return spline(times[node], 1), spline(times[node], 2)  # where b is zero they are those of the body


def around(count: int, node: int) -> slice:
    """Return the slice of the `count` nodes from which derivatives at `node` are computed."""
    first = max(0, min(node - _NODES_TO_SIDE, count - 2 * _NODES_TO_SIDE - 1))
    return slice(first, first + 2 * _NODES_TO_SIDE + 1)


def _chart_derivatives(
    eta: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivative (3,) of chart coordinates ``b`` at ``eta``.

    `velocity` and `acceleration` are those of the body, in body axes: ``omega = D b'`` and
    ``omega' = D b'' + D' b'`` with the right Jacobian ``D`` of SO(3) at ``eta``.
    """
    tangent = so3.right_jacobian(eta)
    rate = np.linalg.solve(tangent, velocity)
    bend = np.linalg.solve(tangent, acceleration - so3.right_jacobian_rate(eta, rate) @ rate)
    return rate, bend


def bent(
    trajectory: Trajectory, ends: Sequence[tuple[np.ndarray, np.ndarray]], share: float = 1.0
) -> Trajectory:
    """Return a trajectory changed at both ends so that it has given accelerations there.

    Args:
        trajectory: a slew, of polynomials of degree 5; it is not changed in place.
        ends: for start and goal the angular acceleration (3,) rad/s^2, body axes, and the joint accelerations
            (J,) rad/s^2.
        share: fraction of the first and last piece, from the outer end, over which the change is spread.
    """
    if share < 1:
        trajectory = _cut_end_pieces(trajectory, share)
    curve = np.array(trajectory.coefficients)
    joints = np.array(trajectory.joint_coefficients)
    for number, wanted in enumerate(ends):
        own = -number
        time = trajectory.breaks[own]
        now = trajectory.sample(float(time))
        span = trajectory.breaks[own] - trajectory.breaks[own - 1] if number else trajectory.breaks[1]
        # b'' adds U^T D b'' to the acceleration, and D is the identity at either end
        half: np.ndarray = so3.exp((time - trajectory.chart_start[own]) * trajectory.chart_rate[own] / 2)
        lacking = np.einsum("ij,j->i", half, wanted[0] - now.angular_acceleration)
        curve[own] += _acceleration_bump(number, float(span))[:, None] * lacking
        span = (
            trajectory.joint_breaks[own] - trajectory.joint_breaks[own - 1]
            if number
            else trajectory.joint_breaks[1]
        )
        joints[own] += _acceleration_bump(number, float(span))[:, None] * (
            wanted[1] - now.joint_accelerations
        )
    return replace(trajectory, coefficients=curve, joint_coefficients=joints, smoothness=2)


def _cut_end_pieces(trajectory: Trajectory, share: float) -> Trajectory:
    """Return the same motion with its first and last piece cut in two; outer parts are `share` of a piece."""
    breaks, coefficients, kept = _cut_spline_ends(trajectory.breaks, trajectory.coefficients, share)
    joint_breaks, joints, _ = _cut_spline_ends(trajectory.joint_breaks, trajectory.joint_coefficients, share)
    return replace(
        trajectory,
        breaks=breaks,
        coefficients=coefficients,
        chart_attitude=trajectory.chart_attitude[kept],
        chart_start=trajectory.chart_start[kept],
        chart_rate=trajectory.chart_rate[kept],
        joint_breaks=joint_breaks,
        joint_coefficients=joints,
    )


def _cut_spline_ends(
    breaks: np.ndarray, coefficients: np.ndarray, share: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut the first and the last piece of a spline in two; the outer parts are `share` of the pieces.

    Returns:
        Breaks (p + 1,) s, Legendre coefficients (p, 6, k), and for each new piece the index of its old one.
    """
    spans = np.diff(breaks)
    edges = np.unique([*breaks, breaks[0] + share * spans[0], breaks[-1] - share * spans[-1]])
    kept = np.searchsorted(breaks, (edges[1:] + edges[:-1]) / 2) - 1
    places = np.polynomial.legendre.leggauss(DEGREE + 1)[0]
    inside = edges[:-1, None] + np.diff(edges)[:, None] * (places + 1) / 2 - breaks[kept, None]
    own = np.polynomial.legendre.legvander(2 * inside / spans[kept, None] - 1, DEGREE)
    values = np.einsum("pql,pld->pqd", own, coefficients[kept])
    return edges, np.linalg.solve(np.polynomial.legendre.legvander(places, DEGREE), values), kept


def _acceleration_bump(end: int, span: float) -> np.ndarray:
    """Coefficients (6,), s^2, that add a unit acceleration at one end of a piece of `span` s.

    `end` is 0 for the start of the piece and 1 for its end.
    """
    rise = np.polynomial.Polynomial([0, 0, 0, 1.0]) * np.polynomial.Polynomial([1.0, -1.0]) ** 2 / 2
    found = _POWERS_TO_LEGENDRE @ np.asarray(rise.coef, float) * span**2
    return found if end else found * (-1.0) ** np.arange(DEGREE + 1)


def joined(parts: Sequence[tuple[float, Trajectory]]) -> Trajectory:
    """Join trajectories that follow each other; each part is given as (s at which it begins, trajectory)."""
    begins = [begin for begin, _ in parts]
    last, ending = parts[-1]
    end = last + ending.duration
    edges = [*begins, end]

    def breaks(name: str) -> np.ndarray:
        inner = [getattr(part, name)[:-1] + begin for begin, part in parts]
        for one, begin in zip(inner, begins, strict=True):
            one[0] = begin  # to the last bit
        return np.concatenate([*inner, [end]])

    def stacked(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name) for _, part in parts])

    return Trajectory(
        breaks=breaks("breaks"),
        chart_attitude=stacked("chart_attitude"),
        chart_start=np.concatenate([part.chart_start + begin for begin, part in parts]),
        chart_rate=stacked("chart_rate"),
        coefficients=stacked("coefficients"),
        joint_breaks=breaks("joint_breaks"),
        joint_coefficients=stacked("joint_coefficients"),
        node_times=np.array(edges),
        smoothness=2,
        method="timeline",
    )


def part(trajectory: Trajectory, start: float, end: float) -> Trajectory:
    """Cut out the part of a joined trajectory between two times, s; its time zero is `start`.

    The cut is at the breaks nearest to `start` and `end`, which should be breaks.
    """

    def between(breaks: np.ndarray) -> slice:
        first, last = (int(np.argmin(np.abs(breaks - time))) for time in (start, end))
        return slice(first, max(last, first + 1))

    own, joints = between(trajectory.breaks), between(trajectory.joint_breaks)

    def shifted(breaks: np.ndarray, which: slice) -> np.ndarray:
        found = breaks[which.start : which.stop + 1] - start
        found[[0, -1]] = 0.0, end - start  # to the last bit
        return np.asarray(found)

    return Trajectory(
        breaks=shifted(trajectory.breaks, own),
        chart_attitude=trajectory.chart_attitude[own],
        chart_start=trajectory.chart_start[own] - start,
        chart_rate=trajectory.chart_rate[own],
        coefficients=trajectory.coefficients[own],
        joint_breaks=shifted(trajectory.joint_breaks, joints),
        joint_coefficients=trajectory.joint_coefficients[joints],
        node_times=np.array([0.0, end - start]),
        smoothness=trajectory.smoothness,
        method=trajectory.method,
    )
