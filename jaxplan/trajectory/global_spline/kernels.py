"""The platform's attitude and loads at many places, and how the loads change with the curve."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.model.limits import Kinematics, highest_derivative, values
from jaxplan.trajectory.pieces import chart_motion

_CHUNK = 256  # places that a kernel looks at in one call


def by_chunks(
    kernel: Callable[[np.ndarray, np.ndarray], tuple[Array, ...]], places: np.ndarray, curves: np.ndarray
) -> list[np.ndarray]:
    """What a kernel of places (S,) and platform curves (4, S, 3) answers, compiled once for every S."""
    extra = -len(places) % _CHUNK
    curves = curves[:, :, :3]
    if extra:
        places, curves = np.pad(places, (0, extra)), np.pad(curves, ((0, 0), (0, extra), (0, 0)))
    parts = [slice(first, first + _CHUNK) for first in range(0, len(places), _CHUNK)]
    with jax.enable_x64(True):
        found = [[np.asarray(array) for array in kernel(places[part], curves[:, part])] for part in parts]
    if len(found) == 1 and not extra:
        return found[0]
    count = len(places) - extra
    return [np.concatenate(arrays)[:count] for arrays in zip(*found, strict=True)]


def loads_at(turn: Array, place: Array, z: Array, inertia: Array, names: tuple[str, ...]) -> Array:
    """The loads (Q, 3) of these names at one place from ``b`` and its derivatives, z (4, 3)."""

    def moving(*point: Array) -> tuple[Array, ...]:
        return chart_motion(turn, *point)[1:]

    b, first, second, third = z
    point = (place[None], b, first, second)
    if highest_derivative(names) > 2:
        spin, (_, jerk) = jax.jvp(moving, point, (jnp.ones(1), first, second, third))
        spin = (*spin, jerk)
    else:
        spin = moving(*point)
    return values(names, Kinematics(spin=spin, inertia=inertia))


@partial(jax.jit, static_argnames="names")
def motion_at(
    attitude: Array, turn: Array, places: Array, curves: Array, inertia: Array, *, names: tuple[str, ...]
) -> tuple[Array, Array, Array]:
    """Attitudes, tangents and loads at all places."""

    def at(place: Array, z: Array) -> tuple[Array, Array, Array]:
        eta = z[0] - place * turn
        half = so3.exp(place * turn / 2)
        gamma = half @ so3.exp(eta) @ half
        return (
            attitude @ gamma,
            half.T @ so3.right_jacobian(eta),
            loads_at(turn, place, z, inertia, names),
        )

    return jax.vmap(at)(places, jnp.moveaxis(curves, 0, 1))


@partial(jax.jit, static_argnames="names")
def load_slopes(
    turn: Array, places: Array, curves: Array, inertia: Array, *, names: tuple[str, ...]
) -> Array:
    """Derivatives of the loads at all places."""

    def at(place: Array, z: Array) -> Array:
        return jax.jacfwd(loads_at, argnums=2)(turn, place, z, inertia, names)

    return jax.vmap(at)(places, jnp.moveaxis(curves, 0, 1))
