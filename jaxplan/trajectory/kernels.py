"""Jitted kernels of the spline fit: the platform's attitudes, loads, and derivatives of loads along a curve.

A *place* is a share ``s`` of the duration, in [0, 1]. A curve is given there by ``b``, its coordinates in the
chart of SO(3) that `chart.Chart` describes, and the derivatives of ``b`` in ``s``. The *loads* are the C
components of the platform's limited quantities, such as rates and torques, as they would be in a motion of
1 s; the others divide them by powers of the duration. The last E of them are the lesser parts, which fall by
one power less, of what has some (`jaxplan.model.limits`): of wheels, whose total momentum stays as it is.
Where stages of gimbals have an inertia (`jaxplan.model.stages`), loads depend on the joints, too: then all
A = 3 + J axes of a curve are looked at, and else B = 3 of them, those of ``b``.
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
from jaxplan.model.stages import Stages
from jaxplan.model.wheels import WheelArray
from jaxplan.runtime.jit import materialise, quick_jit
from jaxplan.runtime.precompile import Task
from jaxplan.trajectory.curve import chart_motion

_TOGETHER = 256  # places that a kernel takes in one call, always as many; 8 on each of 32 intervals


class Body(NamedTuple):
    """What turns, as the loads depend on it.

    Attributes:
        inertia: (3, 3) kg m^2, body axes, of what joints do not turn, as far as stages have one of their own.
        total: (3,) N m s, total momentum of platform and wheels in the axes that the body has at the start;
            None without wheels, as the next.
        array: the wheels.
        stages: of gimbals that have an inertia; None without.
    """

    inertia: Any
    total: Any = None
    array: WheelArray | None = None
    stages: Stages | None = None

    @classmethod
    def of(cls, spacecraft: Spacecraft, joints: Any, rates: Any) -> "Body":
        """The body of a spacecraft that starts at joints (J,) rad with rates (3 + J,) rad/s.

        Its inertia is the identity where none is given, as then none is needed.
        """
        inertia, array, stages = spacecraft.fixed_inertia, spacecraft.wheel_array, spacecraft.stages
        if inertia is None:
            return cls(np.eye(3))
        xp = array_module(inertia, rates, *(array or ()), *jax.tree.leaves(stages))
        own = xp.asarray(inertia, float)
        if array is None:
            return cls(own, stages=stages)
        start = Kinematics(spin=[rates[:3]], joints=[joints, rates[3:]], inertia=own, stages=stages)
        momentum = own @ rates[:3] if stages is None else start.momentum
        return cls(own, momentum + array.stored, array, stages)

    @property
    def axes(self) -> int | None:
        """The number of a curve's first axes, B, on which the loads depend; None for all."""
        return 3 if self.stages is None else None


Kernel = Callable[[np.ndarray, np.ndarray], Array | tuple[Array, ...]]
"""Takes places (S,) and curves (4, S, B); returns one or more arrays (S, ...)."""


def padded_call(
    kernel: Kernel,
    places: np.ndarray,
    curves: np.ndarray,
    axes: int | None = 3,
) -> list[np.ndarray]:
    """The arrays (S, ...) that a kernel returns, called with `_TOGETHER` places at a time.

    Args:
        kernel: to call.
        places: (S,).
        curves: (4, S, A) ``b`` and joints with three derivatives.
        axes: how many of these the kernel takes, see `Body.axes`.
    """
    count, curves = len(places), curves[:, :, :axes]
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
    joints = spacecraft.joint_count
    places, curves = np.zeros(_TOGETHER), np.zeros((4, _TOGETHER, 3 + joints))
    body = Body.of(spacecraft, np.zeros(joints), np.zeros(3 + joints))
    kernels: list[Callable[..., Any]] = [partial(motion_at, matrix, matrix[0], body=body, names=names)]
    if settings.duration != "stretched":
        kernels.append(partial(load_slopes_at, matrix[0], body=body, names=names))
    return [partial(padded_call, kernel, places, curves, body.axes) for kernel in kernels]


def loads_at(turn: Array, place: Array, z: Array, body: Body, names: tuple[str, ...]) -> Array:
    """The loads (C + E,) at one place.

    Args:
        turn: (3,) rad, of the chart.
        place: () in [0, 1].
        z: (4, B) ``b``, perhaps joints, and their first three derivatives in the place.
        body: what turns.
        names: of the limited quantities, (Q,).
    """
    motion = _platform(turn, place, z, body, names)
    if body.stages is not None:
        motion = motion._replace(stages=body.stages, joints=list(z[:3, 3:])).known
    return values(names, motion)


def _platform(turn: Array, place: Array, z: Array, body: Body, names: tuple[str, ...]) -> Kinematics:
    """The motion of the platform at one place, without stages; arguments as of `loads_at`."""

    def moving(*point: Array) -> tuple[Array, ...]:
        return chart_motion(turn, *point)[1:]

    b, first, second, third = z[:, :3]
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
    return motion


@partial(quick_jit, static_argnames="names")
def motion_at(
    attitude: Array, turn: Array, places: Array, curves: Array, body: Body, *, names: tuple[str, ...]
) -> tuple[Array, Array, Array]:
    """Attitudes (S, 3, 3), tangents (S, 3, 3) and loads (S, C + E) at places, see `motion.Iterates`.

    Args:
        attitude: (3, 3) of the chart, body to inertial.
        turn: (3,) rad, of the chart.
        places: (S,).
        curves: (4, S, B) ``b``, perhaps joints, with three derivatives.
        body: what turns.
        names: of the limited quantities, (Q,).
    """

    def at(place: Array, z: Array) -> tuple[Array, Array, Array]:
        eta = z[0, :3] - place * turn
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
    """Derivatives (S, C + E, 4, B) of the loads in curves and derivatives; arguments as of `motion_at`."""
    each = jnp.moveaxis(curves, 0, 1)  # (S, 4, B)
    if body.stages is not None:
        return _slopes_with_stages(turn, places, each, body, body.stages, names)

    def at(place: Array, z: Array) -> Array:
        return jax.jacfwd(loads_at, argnums=2)(turn, place, z, body, names)

    return jax.vmap(at)(places, each)


def _slopes_with_stages(
    turn: Array, places: Array, each: Array, body: Body, stages: Stages, names: tuple[str, ...]
) -> Array:
    """`load_slopes_at` with stages: their few own derivatives, and the chain rule.

    Few, as each stage is turned by two joints alone, and what stages carry is linear in the spin.
    """
    orders = 1 + max(highest_derivative(names), 2)  # no load depends on the others
    spin = jax.vmap(lambda place, z: jnp.stack(_platform(turn, place, z, body, names).spin))(places, each)
    along = jnp.moveaxis(each[:, :3, 3:], 0, -1)
    found = stages.slopes(list(jnp.moveaxis(spin[:, :2], 0, -1)), list(along))
    carried, by_spin, by_joints = materialise(1 + places[0], tuple(jnp.moveaxis(own, -1, 0) for own in found))

    def loads(motion: Kinematics, carried: Array) -> Array:
        return values(names, motion._replace(stages=stages, carried=tuple(carried)))

    def at(place: Array, z: Array, here: Array, carried: Array, by_spin: Array, by_joints: Array) -> Array:
        def by_platform(own: Array) -> Array:
            motion = _platform(turn, place, own, body, names)
            velocity, acceleration = motion.spin[0] - here[0], motion.spin[1] - here[1]
            change = jnp.stack([by_spin[0] @ velocity, by_spin[1] @ velocity + by_spin[0] @ acceleration])
            return loads(motion, carried + change)

        own = z[:, :3]
        of_b = jax.jacfwd(lambda low: by_platform(jnp.concatenate([low, own[orders:]])))(own[:orders])
        motion = _platform(turn, place, own, body, names)
        in_carried = jax.jacfwd(lambda given: loads(motion, given))(carried)  # (C + E, 2, 3)
        of_joints = jnp.einsum("itc,tcoj->ioj", in_carried, by_joints)
        none = jnp.zeros((len(of_b), 4, z.shape[1]), z.dtype)
        return none.at[:, :orders, :3].set(of_b).at[:, :3, 3:].set(of_joints)

    return jax.vmap(at)(places, each, spin, carried, by_spin, by_joints)
