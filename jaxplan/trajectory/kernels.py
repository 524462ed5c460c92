"""Jitted kernels of the spline fit: the platform's attitudes, loads, and derivatives of loads along a curve.

A *place* is a fraction ``s`` of the duration, in [0, 1]; arrays have S of them. A curve is given there by
``b``, its coordinates in the chart of SO(3) that `chart.Chart` describes, and the derivatives of ``b`` by
``s``. The *loads* are the C components of the platform's Q limited quantities, such as rates and torques, as
they would be in a motion of 1 s; callers divide them by powers of the duration. They are followed by E
*lesser parts*: those parts of loads of wheels that fall by one power of the duration less than the rest
(`jaxplan.model.limits`), since the total momentum is conserved. A load includes its lesser part. Where stages
of gimbals have an inertia (`jaxplan.model.stages`), loads depend on the joints, too. B is the number of a
curve's axes that the kernels take: then all A = 3 + J of them, else the 3 of ``b``.
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
from jaxplan.runtime.ahead import Task
from jaxplan.runtime.jit import materialise, quick_jit
from jaxplan.trajectory.curve import chart_motion

_PLACES_PER_CALL = 256  # places in one call of a kernel, always as many; 8 on each of 32 intervals


class Body(NamedTuple):
    """The rotating masses, as far as the loads depend on them.

    Attributes:
        inertia: (3, 3) kg m^2, body axes; with stages, of what joints do not turn.
        total: (3,) N m s, total momentum of platform and wheels in the axes that the body has at the start;
            None without wheels.
        array: the wheels; None without.
        stages: of gimbals that have an inertia; None without.
    """

    inertia: Any
    total: Any = None
    array: WheelArray | None = None
    stages: Stages | None = None

    @classmethod
    def of(cls, spacecraft: Spacecraft, joints: Any, rates: Any) -> "Body":
        """Make the body of a spacecraft that starts at joint angles (J,) rad with rates (3 + J,) rad/s.

        Rates are those of the body axes, then of the joints. The inertia is the identity if the spacecraft
        has none, since no load depends on it then.
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
        """Number B of a curve's first axes on which the loads depend: 3, or None for all."""
        return 3 if self.stages is None else None


Kernel = Callable[[np.ndarray, np.ndarray], Array | tuple[Array, ...]]
"""Takes places (S,) and curves (4, S, B); returns one or more arrays (S, ...)."""


def padded_call(
    kernel: Kernel,
    places: np.ndarray,
    curves: np.ndarray,
    axes: int | None = 3,
) -> list[np.ndarray]:
    """Call a kernel with `_PLACES_PER_CALL` places at a time; return its arrays (S, ...) without the padding.

    Args:
        kernel: to call.
        places: (S,) in [0, 1].
        curves: (4, S, A) ``b`` and joints with three derivatives by the place.
        axes: number B of the first axes that the kernel takes, see `Body.axes`; None for all.
    """
    count, curves = len(places), curves[:, :, :axes]
    extra = -count % _PLACES_PER_CALL
    if extra:
        places, curves = np.pad(places, (0, extra)), np.pad(curves, ((0, 0), (0, extra), (0, 0)))
    found = []
    with jax.enable_x64(True):
        for first in range(0, len(places), _PLACES_PER_CALL):
            part = slice(first, first + _PLACES_PER_CALL)
            answer = kernel(places[part], curves[:, part])
            found.append(answer if isinstance(answer, tuple) else (answer,))
    if len(found) == 1:
        return [np.asarray(array)[:count] for array in found[0]]
    return [np.concatenate(arrays)[:count] for arrays in zip(*found, strict=True)]


def kernel_tasks(spacecraft: Spacecraft, settings: TrajectorySettings) -> list[Task]:
    """Make tasks that compile the kernels of a spline fit before they are needed.

    Args:
        spacecraft: its limits determine which loads are computed.
        settings: of the fit.

    Returns:
        The tasks in the order in which the kernels are needed; empty for other methods than "global".
    """
    if settings.method != "global":
        return []
    limits, _ = timed_limits(spacecraft)
    names, matrix = tuple(limit.quantity.name for limit in limits), np.eye(3)
    joints = spacecraft.joint_count
    places, curves = np.zeros(_PLACES_PER_CALL), np.zeros((4, _PLACES_PER_CALL, 3 + joints))
    body = Body.of(spacecraft, np.zeros(joints), np.zeros(3 + joints))
    kernels: list[Callable[..., Any]] = [partial(motion_at, matrix, matrix[0], body=body, names=names)]
    if settings.duration != "stretched":
        kernels.append(partial(load_slopes_at, matrix[0], body=body, names=names))
    return [partial(padded_call, kernel, places, curves, body.axes) for kernel in kernels]


def loads_at(turn: Array, place: Array, z: Array, body: Body, names: tuple[str, ...]) -> Array:
    """The loads (C + E,) at one place, for a motion of 1 s.

    Args:
        turn: (3,) rad, rotation vector of the chart from start to end.
        place: () in [0, 1].
        z: (4, B) ``b``, perhaps joints, and their first three derivatives by the place.
        body: the rotating masses.
        names: (Q,) of the limited quantities.
    """
    motion = _platform_state(turn, place, z, body, names)
    if body.stages is not None:
        motion = motion._replace(stages=body.stages, joints=list(z[:3, 3:])).known
    return values(names, motion)


def _platform_state(turn: Array, place: Array, z: Array, body: Body, names: tuple[str, ...]) -> Kinematics:
    """The kinematic state of the platform at one place, without gimbal stages; arguments as of `loads_at`."""

    def moving(*point: Array) -> tuple[tuple[Array, ...], Array]:
        turned, *spin = chart_motion(turn, *point)
        return tuple(spin), turned

    b, first, second, third = z[:, :3]
    point = (place[None], b, first, second)
    if highest_derivative(names) > 2:
        spin, (_, jerk), turned = jax.jvp(moving, point, (jnp.ones(1), first, second, third), has_aux=True)
        spin = (*spin, jerk)
    else:
        spin, turned = moving(*point)
    motion = Kinematics(spin=spin, inertia=body.inertia)
    if body.array is not None:
        motion = motion._replace(total=body.total @ turned, array=body.array)
    return motion


@partial(quick_jit, static_argnames="names")
def motion_at(
    attitude: Array, turn: Array, places: Array, curves: Array, body: Body, *, names: tuple[str, ...]
) -> tuple[Array, Array, Array]:
    """Attitudes (S, 3, 3), tangents (S, 3, 3) and loads (S, C + E) at places, as `motion.Iterates` has them.

    Args:
        attitude: (3, 3) of the chart, body to inertial.
        turn: (3,) rad, rotation vector of the chart from start to end.
        places: (S,) in [0, 1].
        curves: (4, S, B) ``b``, perhaps joints, with three derivatives by the place.
        body: the rotating masses.
        names: (Q,) of the limited quantities.
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
    """Derivatives of the loads by a curve and its three derivatives; arguments are those of `motion_at`.

    Returns:
        (S, C + E, 4, B) for places, loads with their lesser parts, derivatives and axes.
    """
    each = jnp.moveaxis(curves, 0, 1)  # (S, 4, B)
    if body.stages is not None:
        return _slopes_with_stages(turn, places, each, body, body.stages, names)

    def at(place: Array, z: Array) -> Array:
        return jax.jacfwd(loads_at, argnums=2)(turn, place, z, body, names)

    return jax.vmap(at)(places, each)


def _slopes_with_stages(
    turn: Array, places: Array, each: Array, body: Body, stages: Stages, names: tuple[str, ...]
) -> Array:
    """Do the same as `load_slopes_at` with gimbal stages, by the chain rule through what the stages carry.

    That is cheap: each stage is turned by two joints alone, and its momentum is linear in the spin. `each`
    (S, 4, B) is the curve with its derivatives at S places; other arguments are those of `load_slopes_at`.
    """
    orders = 1 + max(highest_derivative(names), 2)  # no load depends on higher derivatives
    spin = jax.vmap(lambda place, z: jnp.stack(_platform_state(turn, place, z, body, names).spin))(
        places, each
    )
    along = jnp.moveaxis(each[:, :3, 3:], 0, -1)
    found = stages.slopes(list(jnp.moveaxis(spin[:, :2], 0, -1)), list(along))
    carried, by_spin, by_joints = materialise(1 + places[0], tuple(jnp.moveaxis(own, -1, 0) for own in found))

    def loads(motion: Kinematics, carried: Array) -> Array:
        return values(names, motion._replace(stages=stages, carried=tuple(carried)))

    def at(place: Array, z: Array, here: Array, carried: Array, by_spin: Array, by_joints: Array) -> Array:
        def by_platform(own: Array) -> Array:
            motion = _platform_state(turn, place, own, body, names)
            velocity, acceleration = motion.spin[0] - here[0], motion.spin[1] - here[1]
            change = jnp.stack([by_spin[0] @ velocity, by_spin[1] @ velocity + by_spin[0] @ acceleration])
            return loads(motion, carried + change)

        own = z[:, :3]
        of_b = jax.jacfwd(lambda low: by_platform(jnp.concatenate([low, own[orders:]])))(own[:orders])
        motion = _platform_state(turn, place, own, body, names)
        in_carried = jax.jacfwd(lambda given: loads(motion, given))(carried)  # (C + E, 2, 3)
        of_joints = jnp.einsum("itc,tcoj->ioj", in_carried, by_joints)
        none = jnp.zeros((len(of_b), 4, z.shape[1]), z.dtype)
        return none.at[:, :orders, :3].set(of_b).at[:, :3, 3:].set(of_joints)

    return jax.vmap(at)(places, each, spin, carried, by_spin, by_joints)
