"""Jitted kernels of the spline fit: the platform's attitudes, loads, and derivatives of loads along a curve.

A *place* is a share ``s`` of the duration, in [0, 1]. A curve is given there by ``b``, its coordinates in the
chart of SO(3) that `chart.Chart` describes, and the derivatives of ``b`` in ``s``. The *loads* are the C
components of the platform's limited quantities, such as rates and torques, as they would be in a motion of
1 s; the others divide them by powers of the duration. The last E of them are the lesser parts, which fall by
one power less, of what has some (`jaxplan.model.limits`): of wheels, whose total momentum stays as it is.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.geometry.vectors import array_module
from jaxplan.model.kinematics import Kinematics
from jaxplan.model.limits import highest_derivative, timed_limits, values
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import WheelArray
from jaxplan.runtime.ahead import Task
from jaxplan.runtime.jit import quick_jit
from jaxplan.trajectory.curve import chart_motion

_TOGETHER = 256  # places that a kernel takes in one call, always as many; 8 on each of 32 intervals


class Body(NamedTuple):
    """What turns, as the loads depend on it.

    Attributes:
        inertia: (3, 3) kg m^2, body axes.
        total: (3,) N m s, total momentum of platform and wheels in the axes that the body has at the start;
            None without wheels, as the next.
        array: the wheels.
    """

    inertia: Any
    total: Any = None
    array: WheelArray | None = None

    @classmethod
    def of(cls, spacecraft: Spacecraft, velocity: Any) -> "Body":
        """The body of a spacecraft that starts with an angular velocity (3,) rad/s, body axes.

        Its inertia is the identity where none is given, as then none is needed.
        """
        inertia, array = spacecraft.inertia, spacecraft.wheel_array
        xp = array_module(inertia, velocity, *(array or ()))
        own = xp.eye(3) if inertia is None else xp.asarray(inertia, float)
        return cls(own) if array is None else cls(own, own @ velocity + array.stored, array)


Kernel = Callable[[np.ndarray, np.ndarray], Array | tuple[Array, ...]]
"""Takes places (S,) and platform curves (4, S, 3); returns one or more arrays (S, ...)."""


def padded_call(
    kernel: Kernel,
    places: np.ndarray,
    curves: np.ndarray,
) -> list[np.ndarray]:
    """The arrays (S, ...) that a kernel returns, called with `_TOGETHER` places at a time.

    Args:
        kernel: to call.
        places: (S,).
        curves: (4, S, 3 or more) ``b`` with three derivatives; what follows ``b``, as joints do, is ignored.
    """
    count, curves = len(places), curves[:, :, :3]
    extra = -count % _TOGETHER
    if extra:
        places, curves = np.pad(places, (0, extra)), np.pad(curves, ((0, 0), (0, extra), (0, 0)))
    found = []
    with jax.enable_x64(True):
        for first in range(0, len(places), _TOGETHER):
            part = slice(first, first + _TOGETHER)
            answer = kernel(places[part], curves[:, part])
            found.append(answer if isinstance(answer, tuple) else (answer,))
    if len(found) == 1:
        return [np.asarray(array)[:count] for array in found[0]]
    return [np.concatenate(arrays)[:count] for arrays in zip(*found, strict=True)]


def kernel_tasks(spacecraft: Spacecraft, settings: TrajectorySettings) -> list[Task]:
    """Tasks that compile the kernels of a spline fit ahead of need.

    Args:
        spacecraft: its limits say which loads are computed.
        settings: of the fit.

    Returns:
        The tasks in the order of need; none for other methods.
    """
    if settings.method != "global":
        return []
    limits, _ = timed_limits(spacecraft)
    names, matrix = tuple(limit.quantity.name for limit in limits), np.eye(3)
    places, curves = np.zeros(_TOGETHER), np.zeros((4, _TOGETHER, 3))
    body = Body.of(spacecraft, np.zeros(3))
    kernels: list[Callable[..., Any]] = [partial(motion_at, matrix, matrix[0], body=body, names=names)]
    if settings.duration != "stretched":
        kernels.append(partial(load_slopes_at, matrix[0], body=body, names=names))
    return [partial(padded_call, kernel, places, curves) for kernel in kernels]


def loads_at(turn: Array, place: Array, z: Array, body: Body, names: tuple[str, ...]) -> Array:
    """The loads (C + E,) at one place.

    Args:
        turn: (3,) rad, of the chart.
        place: () in [0, 1].
        z: (4, 3) ``b`` and its first three derivatives in the place.
        body: what turns.
        names: of the limited quantities, (Q,).
    """

    def moving(*point: Array) -> tuple[Array, ...]:
        return chart_motion(turn, *point)[1:]

    b, first, second, third = z
    point = (place[None], b, first, second)
    if highest_derivative(names) > 2:
        spin, (_, jerk) = jax.jvp(moving, point, (jnp.ones(1), first, second, third))
        spin = (*spin, jerk)
    else:
        spin = moving(*point)
    motion = Kinematics(spin=spin, inertia=body.inertia)
    if body.array is not None:
        turned = chart_motion(turn, place[None], b, first, second)[0]
        motion = motion._replace(total=body.total @ turned, array=body.array)
    return values(names, motion)


@partial(quick_jit, static_argnames="names")
def motion_at(
    attitude: Array, turn: Array, places: Array, curves: Array, body: Body, *, names: tuple[str, ...]
) -> tuple[Array, Array, Array]:
    """Attitudes (S, 3, 3), tangents (S, 3, 3) and loads (S, C + E) at places, see `motion.Iterates`.

    Args:
        attitude: (3, 3) of the chart, body to inertial.
        turn: (3,) rad, of the chart.
        places: (S,).
        curves: (4, S, 3) ``b`` with three derivatives.
        body: what turns.
        names: of the limited quantities, (Q,).
    """

    def at(place: Array, z: Array) -> tuple[Array, Array, Array]:
        eta = z[0] - place * turn
        half = so3.exp(place * turn / 2)
        gamma = half @ so3.exp(eta) @ half
        return (
            attitude @ gamma,
            half.T @ so3.right_jacobian(eta),
            loads_at(turn, place, z, body, names),
        )

    return jax.vmap(at)(places, jnp.moveaxis(curves, 0, 1))


@partial(quick_jit, static_argnames="names")
def load_slopes_at(turn: Array, places: Array, curves: Array, body: Body, *, names: tuple[str, ...]) -> Array:
    """Derivatives (S, C + E, 4, 3) of the loads in ``b`` and its derivatives; arguments as of `motion_at`."""

    def at(place: Array, z: Array) -> Array:
        return jax.jacfwd(loads_at, argnums=2)(turn, place, z, body, names)

    return jax.vmap(at)(places, jnp.moveaxis(curves, 0, 1))
