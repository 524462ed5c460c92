"""A trajectory as data: polynomial pieces on charts of SO(3), and what they evaluate to.

On the piece ``[t_k, t_{k+1}]`` of the platform, in the chart with base attitude ``R_a``, start ``t_a`` and
constant rate ``Omega`` (equation 25, corrected as in the errata's derivation):

    R(t) = R_a gamma(t),   gamma(t) = U exp(eta^) U,   U = exp((t - t_a) Omega / 2),
    eta(t) = b(t) - (t - t_a) Omega.

``b`` and the joints are polynomials in the Legendre basis of ``x = 2 (t - t_k) / (t_{k+1} - t_k) - 1`` in
[-1, 1]. Angular velocity and acceleration are in body axes.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan.trajectory import pieces

# Times and pieces are padded to a few sizes, so that one compiled kernel serves many trajectories.
_CHUNKS = (8, 128, 1024, 16384)
_FEWEST_PIECES = 8


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """A trajectory's values at some times; the leading axis is absent for a single time.

    Attributes:
        attitude: (k, 3, 3) body to inertial.
        angular_velocity: (k, 3) rad/s, body axes.
        angular_acceleration: (k, 3) rad/s^2, its derivative.
        angular_jerk: (k, 3) rad/s^3, the derivative of that; it may jump at breaks.
        joints: (k, 2n) rad, all yaws then all pitches.
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


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A manoeuvre as a function of time; `sample` evaluates it.

    Attributes:
        breaks: (N + 1,) s, ends of the platform's pieces, from 0 to the duration.
        chart_attitude: (N, 3, 3) ``R_a`` of the chart that each piece is in.
        chart_start: (N,) s, ``t_a``.
        chart_rate: (N, 3) rad/s, ``Omega``.
        coefficients: (N, p + 1, 3) Legendre coefficients of ``b``, rad.
        joint_breaks: (M + 1,) s, ends of the joints' pieces.
        joint_coefficients: (M, p + 1, 2n) Legendre coefficients, rad.
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
        """Seconds from start to goal."""
        return float(self.breaks[-1])

    @property
    def platform_pieces(self) -> pieces.Piece:
        """The platform's pieces, stacked."""
        return pieces.Piece(
            start=self.breaks[:-1],
            end=self.breaks[1:],
            chart_attitude=self.chart_attitude,
            chart_start=self.chart_start,
            chart_rate=self.chart_rate,
            coefficients=self.coefficients,
        )

    def sample(self, t: ArrayLike) -> Samples:
        """The trajectory at given times, from its formulas and in float64.

        Example:
            >>> samples = plan.trajectory.sample(np.linspace(0, plan.trajectory.duration, 1000))

        Args:
            t: scalar or (k,) s in [0, duration]. At a break the piece that begins there speaks.

        Returns:
            numpy arrays, with a leading axis k unless ``t`` is a scalar.

        Raises:
            ValueError: if a time lies outside or is not a number.
        """
        times = np.asarray(t, dtype=np.float64)
        if times.ndim > 1:
            raise ValueError(f"t must be a scalar or a vector, not of shape {times.shape}")
        if not np.all((times >= 0) & (times <= self.duration)):
            raise ValueError(f"t must lie in [0, {self.duration!r}] s")
        flat = times.reshape(-1)
        chunk = next((size for size in _CHUNKS if size >= flat.size), _CHUNKS[-1])
        padded = np.zeros(max(1, -(-flat.size // chunk)) * chunk)
        padded[: flat.size] = flat
        whole = self.padded()
        parts = []
        with jax.enable_x64(True):
            for part in padded.reshape(-1, chunk):
                values = _platform_kernel(whole.platform_pieces, part)
                values |= _joint_kernel(whole.joint_breaks, whole.joint_coefficients, part)
                parts.append({name: np.asarray(array) for name, array in values.items()})

        def joined(name: str) -> np.ndarray:
            array = np.concatenate([part[name] for part in parts])[: flat.size]
            return array.reshape(*times.shape, *array.shape[1:])

        return Samples(**{name: joined(name) for name in parts[0]})

    def scaled(self, factor: float) -> Self:
        """The same motion, slower by a factor: rates fall by it, accelerations by its square.

        Args:
            factor: of all times, positive.

        Returns:
            A trajectory that passes the same attitudes and joint angles; the polynomials keep their
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

    def padded(self) -> Self:
        """The same trajectory with its number of pieces brought to a power of two.

        The pieces added stand in front, have no length and rest, so no time falls on them. What only names
        the trajectory is dropped, so that kernels are not compiled anew for it.
        """

        def extra(count: int) -> int:
            size = _FEWEST_PIECES
            while size < count:
                size *= 2
            return size - count

        def front(array: np.ndarray, count: int, value: ArrayLike) -> np.ndarray:
            return np.concatenate([np.broadcast_to(value, (count, *array.shape[1:])), array])

        first, joint = extra(len(self.coefficients)), extra(len(self.joint_coefficients))
        return replace(
            self,
            breaks=front(self.breaks, first, self.breaks[0]),
            chart_attitude=front(self.chart_attitude, first, self.chart_attitude[0]),
            chart_start=front(self.chart_start, first, self.breaks[0]),
            chart_rate=front(self.chart_rate, first, 0),
            coefficients=front(self.coefficients, first, 0),
            joint_breaks=front(self.joint_breaks, joint, self.joint_breaks[0]),
            joint_coefficients=front(self.joint_coefficients, joint, 0),
            node_times=np.zeros(0),
            smoothness=0,
            method="",
        )


def evaluate(trajectory: Trajectory, t: ArrayLike) -> Samples:
    """What `Trajectory.sample` computes, as a pure function that composes with jit, vmap and grad.

    Args:
        trajectory: its arrays may be traced.
        t: (...) s in [0, duration], unchecked; outside, the first or last piece goes on.

    Returns:
        JAX arrays with the leading axes of ``t``, in the dtype of the coefficients.
    """
    platform: dict[str, Any] = _platform_at(trajectory.platform_pieces, t)
    joints: dict[str, Any] = _joints_at(trajectory.joint_breaks, trajectory.joint_coefficients, t)
    return Samples(**platform, **joints)


def _begun(starts: ArrayLike, t: Array) -> Array:
    """Index of the piece that each time falls on: the last one that has begun."""
    return jnp.maximum(jnp.searchsorted(jnp.asarray(starts), t, side="right") - 1, 0)


def _platform_at(stacked: pieces.Piece, t: ArrayLike) -> dict[str, Array]:
    t = jnp.asarray(t, jnp.asarray(stacked.coefficients).dtype)
    index = _begun(stacked.start, t)
    own = jax.tree.map(lambda array: jnp.asarray(array)[index], stacked)
    names = ("attitude", "angular_velocity", "angular_acceleration", "angular_jerk")
    return dict(zip(names, pieces.platform(own, t), strict=True))


def _joints_at(breaks: ArrayLike, coefficients: ArrayLike, t: ArrayLike) -> dict[str, Array]:
    breaks, coefficients = jnp.asarray(breaks), jnp.asarray(coefficients)
    t = jnp.asarray(t, coefficients.dtype)
    index = _begun(breaks[:-1], t)
    names = ("joints", "joint_rates", "joint_accelerations", "joint_jerks")
    curves = pieces.polynomial(coefficients[index], breaks[index], breaks[index + 1], t)
    return dict(zip(names, curves, strict=True))


# Compiled apart, since the platform's kernel, by far the larger, does not depend on the number of joints.
_platform_kernel, _joint_kernel = jax.jit(_platform_at), jax.jit(_joints_at)
