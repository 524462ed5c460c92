"""A trajectory as data: polynomial pieces on charts of SO(3), and functions that evaluate it.

A chart moves with a constant rotation. On the piece ``[t_k, t_{k+1}]`` of the platform, in the chart with
base attitude ``R_a``, start ``t_a`` and constant rate ``Omega`` (equation 25, corrected as in the errata's
derivation):

    R(t) = R_a gamma(t),   gamma(t) = U exp(eta^) U,   U = exp((t - t_a) Omega^ / 2),
    eta(t) = b(t) - (t - t_a) Omega.

The chart's coordinates ``b`` and the joint angles are polynomials in the Legendre basis of
``x = 2 (t - t_k) / (t_{k+1} - t_k) - 1``, which runs from -1 to 1 on the piece. Attitudes ``R`` take body to
inertial axes. Angular velocity and its derivatives are in body axes.

In the formulas of a piece ``tau = t - t_a``, ``W = U^T``, and ``D`` is the right Jacobian of `so3`. Nothing
divides by ``Omega`` or ``eta``: values and derivatives are right at zero. In shapes, l (or p) is the degree
of the polynomials, N and M are the numbers of pieces of platform and joints, 2n is the number of joint angles
and m + 1 that of nodes.

The spline fit has one chart for a whole manoeuvre (`jaxplan.trajectory.chart`).
"""

from dataclasses import dataclass, field, fields, replace
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import AnyArray, array_module, arrays, components
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.arguments import floats
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import is_traced
from jaxplan.trajectory.splines import derivative_matrix, legendre

_MAX_TIMES_AT_ONCE = 4096  # most times sampled at once; intermediate results for more would take much memory


@shown("start s", "end s", "chart_rate deg/s", "coefficients rad")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """A piece of the platform's motion, or several stacked along leading axes (...).

    Attributes:
        start: (...) s, when the piece begins.
        end: (...) s, when it ends.
        chart_attitude: (..., 3, 3) ``R_a``, body to inertial.
        chart_start: (...) s, ``t_a``.
        chart_rate: (..., 3) rad/s, ``Omega``.
        coefficients: (..., l + 1, 3) Legendre coefficients of ``b``, rad.
    """

    start: ArrayLike
    end: ArrayLike
    chart_attitude: ArrayLike
    chart_start: ArrayLike
    chart_rate: ArrayLike
    coefficients: ArrayLike


def polynomial(coefficients: ArrayLike, start: ArrayLike, end: ArrayLike, t: ArrayLike) -> tuple[Array, ...]:
    """Evaluate a polynomial curve and its first three time derivatives.

    Args:
        coefficients: (..., l + 1, d) of d components, in the Legendre basis of
            ``x = 2 (t - start) / (end - start) - 1``.
        start: (...) s, of the piece.
        end: (...) s, of the piece; on a piece of no length the curve rests at its left end.
        t: (...) s, not checked to lie on the piece.

    Returns:
        Four arrays (..., d): value, first, second and third derivative, in the coefficients' unit over s^0 to
        s^3. Numpy or JAX, as the arguments are.
    """
    xp, c, begin, finish, time = arrays(coefficients, start, end, t)
    order = c.shape[-2] - 1
    length = finish - begin
    scale = xp.where(length > 0, 2 / xp.where(length > 0, length, 1), 0)[..., None]  # dx / dt
    values = legendre((time - begin) * scale[..., 0] - 1, order)
    powers = [np.linalg.matrix_power(derivative_matrix(order), power) for power in range(4)]
    # Each row is multiplied by itself, so that the values at a time do not depend on the number of times.
    rows = values[..., None, :] @ xp.asarray(np.concatenate(powers, axis=1), c.dtype)
    curves = xp.einsum("...rk,...kd->...rd", rows.reshape(*values.shape[:-1], 4, order + 1), c)
    return tuple(curves[..., power, :] * scale**power for power in range(4))


def chart_motion(rate: AnyArray, tau: AnyArray, b: AnyArray, *derivatives: AnyArray) -> tuple[AnyArray, ...]:
    """Rotation, angular velocity and, if asked for, acceleration and jerk in a chart (equations 25 to 29).

    Args:
        rate: (..., 3) rad/s, ``Omega``.
        tau: (..., 1) s since the chart's start.
        b: (..., 3) rad.
        *derivatives: (..., 3) each: the first one to three time derivatives of ``b``, in rad and s.

    Returns:
        ``gamma`` (..., 3, 3), then (..., 3) each as many of angular velocity, acceleration and jerk, in rad
        and s, body axes, as derivatives were given.
    """
    cross = array_module(rate, tau, b).cross
    eta, (eta_1, *others) = b - tau * rate, (derivatives[0] - rate, *derivatives[1:])
    half = so3.exp(tau * rate / 2)  # U
    gamma = half @ so3.exp(eta) @ half
    tangent = so3.right_jacobian(eta)  # D
    turned = _apply_transposed(gamma, rate) / 2  # gamma^T Omega / 2
    own = _apply_transposed(half, _apply(tangent, eta_1))  # W D eta'
    velocity = turned + rate / 2 + own  # (29), first line
    if not others:
        return gamma, velocity
    (eta_2, *eta_3), tangent_1 = others, so3.right_jacobian_rate(eta, eta_1)  # D'
    # (29), second line, where the second factor Omega / 2 must be a matrix: a cross product
    bend = _apply_transposed(half, _apply(tangent_1, eta_1) + _apply(tangent, eta_2))  # W (D eta')'
    turned_1, own_1 = cross(turned, velocity), cross(own, rate) / 2 + bend
    acceleration = turned_1 + own_1
    if not eta_3:
        return gamma, velocity, acceleration
    tangent_2 = so3.right_jacobian_acceleration(eta, eta_1, eta_2)
    bend_1 = _apply(tangent_2, eta_1) + 2 * _apply(tangent_1, eta_2) + _apply(tangent, eta_3[0])
    turned_2 = cross(turned_1, velocity) + cross(turned, acceleration)
    jerk = turned_2 + cross(own_1 + bend, rate) / 2 + _apply_transposed(half, bend_1)
    return gamma, velocity, acceleration, jerk


def platform(piece: Piece, t: ArrayLike, order: int = 3) -> tuple[AnyArray, ...]:
    """Evaluate attitude, angular velocity and, for orders 2 and 3, its first derivatives on a piece.

    Args:
        piece: one or several, with leading axes (...).
        t: (...) s.
        order: 1 for the velocity alone, 2 with the acceleration, 3 with the jerk, too.

    Returns:
        (..., 3, 3) body to inertial, then (..., 3) each in rad/s, rad/s^2 and rad/s^3, body axes.
    """
    _, time, start, rate, attitude = arrays(t, piece.chart_start, piece.chart_rate, piece.chart_attitude)
    along = polynomial(piece.coefficients, piece.start, piece.end, time)
    gamma, *derivatives = chart_motion(rate, (time - start)[..., None], *along[: order + 1])
    return attitude @ gamma, *derivatives


def _apply(matrix: AnyArray, vector: AnyArray) -> AnyArray:
    """Multiply matrices (..., 3, 3) by vectors (..., 3)."""
    return array_module(matrix, vector).einsum("...ij,...j->...i", matrix, vector)


def _apply_transposed(matrix: AnyArray, vector: AnyArray) -> AnyArray:
    """Multiply the transposes of matrices (..., 3, 3) by vectors (..., 3)."""
    return array_module(matrix, vector).einsum("...ij,...i->...j", matrix, vector)


@shown(
    "attitude",
    "angular_velocity deg/s",
    "angular_acceleration deg/s^2",
    "angular_jerk deg/s^3",
    "joints deg",
    "joint_rates deg/s",
    "joint_accelerations deg/s^2",
    "joint_jerks deg/s^3",
)
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Values of a trajectory at k times; for a single time the leading axis is absent.

    Attributes:
        attitude: (k, 3, 3) body to inertial.
        angular_velocity: (k, 3) rad/s, body axes.
        angular_acceleration: (k, 3) rad/s^2, derivative of the angular velocity in body axes.
        angular_jerk: (k, 3) rad/s^3, derivative of the angular acceleration; it may jump at breaks.
        joints: (k, 2n) rad, all yaws, then all pitches, then angles of drives if there are any.
        joint_rates: (k, 2n) rad/s.
        joint_accelerations: (k, 2n) rad/s^2.
        joint_jerks: (k, 2n) rad/s^3; they may jump at breaks.
    """

    attitude: np.ndarray
    angular_velocity: np.ndarray
    angular_acceleration: np.ndarray
    angular_jerk: np.ndarray
    joints: np.ndarray
    joint_rates: np.ndarray
    joint_accelerations: np.ndarray
    joint_jerks: np.ndarray

    @property
    def quaternion(self) -> np.ndarray:
        """(k, 4) unit quaternions, scalar last (``x y z w`` as in scipy), body to inertial.

        The sign is chosen so that it does not jump from one row to the next.
        """
        scalar_first = quaternion.continuous(self.attitude)
        rolled: np.ndarray = scalar_first[..., [1, 2, 3, 0]]
        return rolled

    def kinematics(self, craft: Spacecraft, total: AnyArray | None = None) -> Kinematics:
        """Return the kinematic state from which the limited quantities are computed.

        Args:
            craft: gives the inertia, the wheels, the gimbal stages and the number of drives.
            total: (3,) N m s, total momentum in inertial axes, see `total_momentum`; None if no quantity of
                wheels is asked for.
        """
        spin = (self.angular_velocity, self.angular_acceleration, self.angular_jerk)
        joints = (self.joints, self.joint_rates, self.joint_accelerations)
        return Kinematics(
            spin=[components(vector) for vector in spin],
            joints=[components(vector) for vector in joints],
            drives=len(craft.drives),
            inertia=craft.fixed_inertia,
            total=None if total is None else components(self.attitude.swapaxes(-1, -2) @ total),
            array=None if total is None else craft.wheel_array,
            stages=craft.stages,
        )


@shown("method", "duration s", "smoothness", "breaks s", "joint_breaks s", "node_times s")
@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A manoeuvre as a function of time; `sample` evaluates it.

    Attributes:
        breaks: (N + 1,) s, ends of the platform's pieces, from 0 to the duration.
        chart_attitude: (N, 3, 3) ``R_a`` of the chart of each piece, body to inertial.
        chart_start: (N,) s, ``t_a``.
        chart_rate: (N, 3) rad/s, ``Omega``.
        coefficients: (N, p + 1, 3) Legendre coefficients of ``b``, rad.
        joint_breaks: (M + 1,) s, ends of the joints' pieces.
        joint_coefficients: (M, p + 1, 2n) Legendre coefficients of the joint angles, rad.
        node_times: (m + 1,) s, when each node of the path is passed.
        smoothness: number of continuous derivatives at every break.
        method: name of the method that made it.
    """

    breaks: np.ndarray
    chart_attitude: np.ndarray
    chart_start: np.ndarray
    chart_rate: np.ndarray
    coefficients: np.ndarray
    joint_breaks: np.ndarray
    joint_coefficients: np.ndarray
    node_times: np.ndarray
    smoothness: int = field(metadata={"static": True})
    method: str = field(metadata={"static": True})

    @property
    def duration(self) -> float:
        """Time from start to goal in s, as a Python float.

        Raises:
            TypeError: if the arrays are traced by JAX; use `measures.duration` there.
        """
        if is_traced(self.breaks):
            raise TypeError(
                "trajectory.duration is a number, which has no derivative: "
                "use jp.measures.duration(trajectory) inside jax.grad, jax.jit and jax.vmap"
            )
        return float(self.breaks[-1])

    @property
    def platform_pieces(self) -> Piece:
        """The platform's N pieces, stacked along a leading axis."""
        return Piece(
            start=self.breaks[:-1],
            end=self.breaks[1:],
            chart_attitude=self.chart_attitude,
            chart_start=self.chart_start,
            chart_rate=self.chart_rate,
            coefficients=self.coefficients,
        )

    def sample(self, t: ArrayLike) -> Samples:
        """Evaluate the trajectory at given times, from its formulas and in float64.

        Example:
            >>> samples = plan.trajectory.sample(np.linspace(0, plan.trajectory.duration, 1000))

        Args:
            t: scalar or (k,) s in [0, duration]. At a break the piece that begins there is evaluated.

        Returns:
            numpy arrays, with a leading axis k unless ``t`` is a scalar.

        Raises:
            ValueError: if a time lies outside or is not a number.
        """
        times = floats("t", t, "a number of seconds, or a vector of them")
        if times.ndim > 1:
            raise ValueError(f"t must be a scalar or a vector, not of shape {times.shape}")
        outside = times[~((times >= 0) & (times <= self.duration))]
        if outside.size:
            raise ValueError(f"t = {outside.flat[0]}: must lie in [0, {self.duration!r}] s")
        flat = times.reshape(-1)
        parts = [
            vars(self._sample_unchecked(flat[first : first + _MAX_TIMES_AT_ONCE]))
            for first in range(0, flat.size or 1, _MAX_TIMES_AT_ONCE)
        ]
        found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return Samples(
            **{name: array.reshape(*times.shape, *array.shape[1:]) for name, array in found.items()}
        )

    def _sample_unchecked(self, times: np.ndarray) -> Samples:
        """Evaluate the trajectory at times (k,) in s, which are not checked."""
        on = np.searchsorted(self.breaks[:-1], times, side="right") - 1
        on_joints = np.searchsorted(self.joint_breaks[:-1], times, side="right") - 1
        return _evaluate_on_pieces(self, on, on_joints, times, times)

    def scaled(self, factor: float) -> Self:
        """Return the same motion slowed down by a factor: rates fall by it, accelerations by its square.

        Args:
            factor: by which all times are multiplied, positive; below 1 the motion becomes faster.

        Returns:
            A new trajectory through the same attitudes and joint angles; the polynomials keep their
            coefficients.
        """
        return replace(
            self,
            breaks=self.breaks * factor,
            chart_start=self.chart_start * factor,
            chart_rate=self.chart_rate / factor,
            joint_breaks=self.joint_breaks * factor,
            node_times=self.node_times * factor,
        )


def evaluate(trajectory: Trajectory, t: ArrayLike) -> Samples:
    """Do the same as `Trajectory.sample` as a pure function that composes with jit, vmap and grad.

    Args:
        trajectory: its arrays may be traced.
        t: (...) s in [0, duration], not checked; outside, the first or last piece is extrapolated.

    Returns:
        JAX arrays with the leading axes of ``t``, in the dtype of the coefficients.
    """
    times = jnp.asarray(t, jnp.asarray(trajectory.coefficients).dtype)
    joint_times = jnp.asarray(t, jnp.asarray(trajectory.joint_coefficients).dtype)
    on = _piece_indices(trajectory.breaks[:-1], times)
    on_joints = _piece_indices(trajectory.joint_breaks[:-1], joint_times)
    return _evaluate_on_pieces(jax.tree.map(jnp.asarray, trajectory), on, on_joints, times, joint_times)


def on_common_pieces(trajectory: Trajectory) -> Trajectory:
    """Return the same motion on pieces that platform and joints share, so that N equals M.

    Args:
        trajectory: of numpy arrays; if its breaks and joint breaks are equal already, it is returned as it
            is.
    """
    breaks, joint_breaks = np.asarray(trajectory.breaks), np.asarray(trajectory.joint_breaks)
    if np.array_equal(breaks, joint_breaks):
        return trajectory
    edges = np.union1d(breaks, joint_breaks)
    middle = (edges[:-1] + edges[1:]) / 2
    on = np.clip(np.searchsorted(breaks, middle, side="right") - 1, 0, len(breaks) - 2)
    on_joints = np.clip(np.searchsorted(joint_breaks, middle, side="right") - 1, 0, len(joint_breaks) - 2)
    return replace(
        trajectory,
        breaks=edges,
        chart_attitude=trajectory.chart_attitude[on],
        chart_start=trajectory.chart_start[on],
        chart_rate=trajectory.chart_rate[on],
        coefficients=_restrict_polynomials(trajectory.coefficients[on], breaks[on], breaks[on + 1], edges),
        joint_breaks=edges,
        joint_coefficients=_restrict_polynomials(
            trajectory.joint_coefficients[on_joints],
            joint_breaks[on_joints],
            joint_breaks[on_joints + 1],
            edges,
        ),
    )


def _restrict_polynomials(
    coefficients: np.ndarray, start: np.ndarray, end: np.ndarray, edges: np.ndarray
) -> np.ndarray:
    """Restrict polynomials to parts of their intervals, each rewritten in the Legendre basis of its part.

    Args:
        coefficients: (k, l + 1, d) of the k polynomials on their own intervals.
        start: (k,) s, where the interval of each begins.
        end: (k,) s, where it ends.
        edges: (k + 1,) s; part number i reaches from edge i to edge i + 1.

    Returns:
        (k, l + 1, d) Legendre coefficients on the parts.
    """
    order = coefficients.shape[1] - 1
    nodes, weights = np.polynomial.legendre.leggauss(order + 1)  # exact up to twice the degree
    times = edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2
    values = polynomial(coefficients[:, None], start[:, None], end[:, None], times)[0]
    basis = np.polynomial.legendre.legvander(nodes, order)
    back = (np.arange(order + 1) + 0.5)[:, None] * basis.T * weights
    return np.asarray(np.einsum("lg,kgd->kld", back, values))


def total_momentum(trajectory: Trajectory, craft: Spacecraft) -> AnyArray | None:
    """Total angular momentum ``H`` of platform and wheels on a trajectory, (3,) N m s in inertial axes.

    It is conserved, so that of the start is returned: ``R_0 (L_0 + h_0)`` with the momentum ``L = J omega``
    of the body (and of what joints turn) and ``h_0`` stored in the wheels. It is numpy or JAX as the
    arguments are; None for a spacecraft without wheels.
    """
    array = craft.wheel_array
    if array is None:
        return None
    pieces = trajectory.platform_pieces
    first = Piece(**{each.name: getattr(pieces, each.name)[0] for each in fields(Piece)})
    attitude, velocity = platform(first, first.start, order=1)
    if craft.stages is None:
        _, inertia, velocity, stored = arrays(craft.whole_inertia, velocity, array.stored)
        return attitude @ (inertia @ velocity + stored)
    begin, end = trajectory.joint_breaks[:2]
    joints = polynomial(trajectory.joint_coefficients[0], begin, end, begin)
    at_start = Kinematics(spin=[velocity], joints=joints, inertia=craft.fixed_inertia, stages=craft.stages)
    return attitude @ (at_start.momentum + array.stored)


def _piece_indices(starts: ArrayLike, t: Array) -> Array:
    """Index of the piece that each time falls on: the last one that has begun, at least 0."""
    return jnp.maximum(jnp.searchsorted(jnp.asarray(starts), t, side="right") - 1, 0)


def _evaluate_on_pieces(
    trajectory: Trajectory, on: AnyArray, on_joints: AnyArray, t: AnyArray, joint_t: AnyArray
) -> Samples:
    """Evaluate a trajectory at times on given pieces, with numpy or JAX as the arguments are.

    Args:
        trajectory: to be evaluated.
        on: (...) int, index of the platform's piece for each time.
        on_joints: (...) int, index of the joints' piece for each time.
        t: (...) s, for the platform.
        joint_t: (...) s, the same times in the dtype of the joints.
    """
    pieces = trajectory.platform_pieces
    own = Piece(**{each.name: getattr(pieces, each.name)[on] for each in fields(Piece)})
    breaks, coefficients = trajectory.joint_breaks, trajectory.joint_coefficients
    joints = polynomial(coefficients[on_joints], breaks[on_joints], breaks[on_joints + 1], joint_t)
    names = (each.name for each in fields(Samples))
    return Samples(**dict(zip(names, (*platform(own, t), *joints), strict=True)))
