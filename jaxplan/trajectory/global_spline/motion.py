"""A motion at many places: attitudes, loads and margins, with the slopes that a program needs.

Rates are those in ``s``, the place in [0, 1]; in time they are divided by powers of the duration.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.spacecraft import Spacecraft
from jaxplan.trajectory.global_spline.problem import Problem
from jaxplan.trajectory.pieces import chart_motion
from jaxplan.zones import Cones

_CHUNK = 256  # places that a kernel looks at in one call
_NEAR_AXIS = 1e-6  # least sine of an angle to a zone's axis, where the margin has no slope


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A curve at S places.

    Attributes:
        problem: chart, spacecraft and zones.
        places: (S,) in [0, 1].
        curves: (4, S, 3 + 2n) ``b`` and joints with three derivatives.
        attitude: (S, 3, 3) body to inertial.
        tangent: (S, 3, 3) what turns a change of ``b`` into a rotation of the body, in body axes: ``U^T D``.
        loads: (S, Q, 3) of the platform.
        body: (S, D, 3) boresights in body axes.
        body_slopes: (2, S, n, 3) their derivatives in yaw and in pitch.
        cosines: (S, D, Z) of the angles between boresights and zones' axes.
        margins: (S, D, Z) rad; +inf where a zone does not bind a device, and for all entries of a group
            but the one that holds best.
    """

    problem: Problem
    places: np.ndarray
    curves: np.ndarray
    attitude: np.ndarray
    tangent: np.ndarray
    loads: np.ndarray
    body: np.ndarray
    body_slopes: np.ndarray
    cosines: np.ndarray
    margins: np.ndarray

    @cached_property
    def load_slopes(self) -> np.ndarray:
        """(S, Q, 3, 4, 3) derivatives of the loads in ``b`` and its derivatives (last axes)."""
        problem = self.problem
        return _by_chunks(
            lambda places, curves: (
                _load_slopes(problem.chart.turn, places, curves, problem.inertia, **_choices(problem)),
            ),
            self.places,
            self.curves,
        )[0]

    def is_finite(self) -> bool:
        """Whether all numbers are."""
        return bool(np.all(np.isfinite(self.loads)) and np.all(np.isfinite(self.cosines)))

    def margin_slopes(self, place: np.ndarray, device: np.ndarray, zone: np.ndarray) -> np.ndarray:
        """Derivatives of some margins in ``b`` and the joints.

        Args:
            place: (R,) index of a place.
            device: (R,) index.
            zone: (R,) index.

        Returns:
            (R, 3 + 2n) of ``side * (angle - half angle)``; the angle falls by ``d cos / sin``.
        """
        cones, joints = self.problem.cones, self.problem.spacecraft.mounts.size
        cosine = self.cosines[place, device, zone]
        factor = -cones.side[zone] / np.maximum(np.sqrt(np.maximum(1 - cosine**2, 0)), _NEAR_AXIS)
        axes = self.problem.axes(self.places)[place, zone] if cones.paths else cones.direction[zone]
        axis = np.einsum("ri,rij->rj", axes, self.attitude[place])  # in the body
        slopes = np.zeros((len(place), 3 + 2 * joints))
        # A rotation d of the body takes the boresight v to v + d x v, and axis . (d x v) = d . (v x axis).
        turning = np.cross(self.body[place, device], axis)
        slopes[:, :3] = np.einsum("rk,rka->ra", turning, self.tangent[place])
        row = np.flatnonzero(device < joints)
        for part in range(2):  # yaw, pitch
            own = self.body_slopes[part, place[row], device[row]]
            slopes[row, 3 + part * joints + device[row]] = np.einsum("rj,rj->r", own, axis[row])
        return slopes * factor[:, None]


def evaluate(problem: Problem, places: np.ndarray, curves: np.ndarray) -> Motion:
    """The motion of a curve.

    Args:
        problem: chart, spacecraft and zones.
        places: (S,) in [0, 1].
        curves: (4, S, 3 + 2n) values and derivatives.
    """
    chart = problem.chart
    attitude, tangent, loads = _by_chunks(
        lambda part, own: _values(
            chart.attitude, chart.turn, part, own, problem.inertia, **_choices(problem)
        ),
        places,
        curves,
    )
    body, body_slopes = _body(problem.spacecraft, curves[0, :, 3:])
    own_cosines = _cosines(problem, places, attitude, body)
    return Motion(
        problem=problem,
        places=places,
        curves=curves,
        attitude=attitude,
        tangent=tangent,
        loads=loads,
        body=body,
        body_slopes=body_slopes,
        cosines=own_cosines,
        margins=margins(problem.cones, own_cosines),
    )


def cosines(problem: Problem, places: np.ndarray, attitudes: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Cosines (S, D, Z) of `Motion` at places (S,) for attitudes (S, 3, 3) and joints (S, 2n)."""
    return _cosines(problem, places, attitudes, _body(problem.spacecraft, joints)[0])


def margins(cones: Cones, angle_cosines: np.ndarray) -> np.ndarray:
    """Margins (S, D, Z) as `Motion` has them, from the cosines (S, D, Z)."""
    found = cones.side * (np.arccos(np.clip(angle_cosines, -1, 1)) - cones.half_angle)
    found = np.where(cones.bound.T, found, np.inf)
    for leader in np.flatnonzero(np.bincount(cones.group, minlength=1) > 1):
        members = np.flatnonzero(cones.group == leader)
        best = np.argmax(found[:, :, members].min(axis=1), axis=1)
        others = members[None, :] != members[best][:, None]
        found[:, :, members] = np.where(others[:, None, :], np.inf, found[:, :, members])
    return found


def _cosines(problem: Problem, places: np.ndarray, attitudes: np.ndarray, body: np.ndarray) -> np.ndarray:
    seen = body @ np.swapaxes(attitudes, 1, 2)
    if problem.cones.paths:
        return np.asarray(seen @ np.swapaxes(problem.axes(places), 1, 2))
    return np.asarray(seen @ problem.cones.direction.T)


def _body(craft: Spacecraft, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boresights (S, D, 3) in body axes (equation 13), and of terminals their slopes (2, S, n, 3)."""
    yaw, pitch = np.split(joints, 2, axis=1)
    azimuth = yaw + craft.mounts
    (sin_a, sin_p), (cos_a, cos_p) = np.sin([azimuth, pitch]), np.cos([azimuth, pitch])
    moving = np.stack([cos_p * cos_a, cos_p * sin_a, sin_p], axis=-1)
    by_yaw = np.stack([-cos_p * sin_a, cos_p * cos_a, np.zeros_like(sin_a)], axis=-1)
    by_pitch = np.stack([-sin_p * cos_a, -sin_p * sin_a, cos_p], axis=-1)
    fixed = np.asarray(craft.fixed_boresights, float)
    still = np.broadcast_to(fixed, (len(joints), *fixed.shape))
    return np.concatenate([moving, still], axis=1), np.stack([by_yaw, by_pitch])


def _by_chunks(
    kernel: Callable[[np.ndarray, np.ndarray], tuple[Array, ...]], places: np.ndarray, curves: np.ndarray
) -> list[np.ndarray]:
    """What a kernel of places (S,) and platform curves (4, S, 3) answers, compiled once for every S."""
    extra = -len(places) % _CHUNK
    parts = np.pad(places, (0, extra)).reshape(-1, _CHUNK)
    own = np.pad(curves[:, :, :3], ((0, 0), (0, extra), (0, 0))).reshape(4, -1, _CHUNK, 3)
    with jax.enable_x64(True):
        found = [[np.asarray(array) for array in kernel(part, own[:, k])] for k, part in enumerate(parts)]
    return [np.concatenate(arrays)[: len(places)] for arrays in zip(*found, strict=True)]


def _choices(problem: Problem) -> dict[str, bool]:
    return {"dynamic": problem.dynamic, "jerky": problem.jerky}


def loads_at(turn: Array, place: Array, z: Array, inertia: Array, dynamic: bool, jerky: bool) -> Array:
    """The loads (Q, 3) at one place from ``b`` and its derivatives, z (4, 3)."""

    def moving(*point: Array) -> tuple[Array, ...]:
        return chart_motion(turn, *point)[1:]

    b, first, second, third = z
    point = (place[None], b, first, second)
    if jerky:
        (rate, acceleration), (_, jerk) = jax.jvp(moving, point, (jnp.ones(1), first, second, third))
    else:
        rate, acceleration = moving(*point)
    found = [rate, acceleration]
    if dynamic:
        momentum = inertia @ rate
        found += [inertia @ acceleration + jnp.cross(rate, momentum), momentum]
    if jerky:
        found.append(jerk)
    return jnp.stack(found)


@partial(jax.jit, static_argnames=("dynamic", "jerky"))
def _values(
    attitude: Array, turn: Array, places: Array, curves: Array, inertia: Array, *, dynamic: bool, jerky: bool
) -> tuple[Array, Array, Array]:
    """Attitudes, tangents and loads at all places."""

    def at(place: Array, z: Array) -> tuple[Array, Array, Array]:
        eta = z[0] - place * turn
        half = so3.exp(place * turn / 2)
        gamma = half @ so3.exp(eta) @ half
        return (
            attitude @ gamma,
            half.T @ so3.right_jacobian(eta),
            loads_at(turn, place, z, inertia, dynamic, jerky),
        )

    return jax.vmap(at)(places, jnp.moveaxis(curves, 0, 1))


@partial(jax.jit, static_argnames=("dynamic", "jerky"))
def _load_slopes(
    turn: Array, places: Array, curves: Array, inertia: Array, *, dynamic: bool, jerky: bool
) -> Array:
    """Derivatives of the loads at all places."""

    def at(place: Array, z: Array) -> Array:
        return jax.jacfwd(loads_at, argnums=2)(turn, place, z, inertia, dynamic, jerky)

    return jax.vmap(at)(places, jnp.moveaxis(curves, 0, 1))
