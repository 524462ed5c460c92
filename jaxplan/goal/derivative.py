"""Derivatives of a goal of step 1 by its problem: the optimum of problem (7) or of least time.

Problem (7) of the paper asks for goals of least rotation. Every choice is held fixed: which local minimum
the goal is, and which limits and zones are active there. The rest is the implicit function theorem.

**Problem (7).** Along ``E exp(d^)``, where ``E = R0^T R`` is the turn to the goal found, and with the caps of
`jaxplan.goal.caps` and the terms of `jaxplan.goal.descent`, the optimum is where

    eta + sum of m_i n_i = 0        n_i the gradient of the excess over cap i, m_i its multiplier
    excess_i = 0                    of all active caps, at most three

At the goal found ``d`` is zero, so a step of Newton's method changes nothing but rounding. The curvature of
objective and caps is in the equations' matrix. For a goal that follows moving targets the rates are
derivatives already (`goal_in_time`), and have first derivatives themselves.

**Least time.** The goal is the optimum of `jaxplan.goal.minimax`. The unknowns are the turn ``d`` in
``E exp(d^)`` and the time ``t``. With the ways and caps that bind, at most four, the optimum is where

    slopes by d and t of  t^2 / 2 + STILLNESS theta^2 / 2 + sum of m_i c_i = 0       and      c_i = 0

with ``theta`` the angle of the turn, ``c`` a way less its reach or the excess over a cap, and ``m`` its
multiplier. A *way* is the distance that a joint or the platform has to go, its *reach* the longest distance
that it can go in time ``t`` (`jaxplan.goal.distances`).

Attitudes are body to inertial, angles in radians, joints as in `jaxplan.model.spacecraft`. Shapes: J joints,
Z rows, m caps, w ways, k devices with targets.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import max_along
from jaxplan.goal import descent
from jaxplan.goal.active_caps import (
    GoalCaps,
    GoalState,
    active_caps,
    assemble_caps,
    caps_to_keep,
    equation_cap_numbers,
    normalise,
)
from jaxplan.goal.aims import aims_of, goal_ranges, pointed
from jaxplan.goal.descent import MET, Active, active_terms, angle_terms, cap_terms, turned
from jaxplan.goal.distances import Platform, Pointers, reach, speed_limits, ways
from jaxplan.goal.free_devices import MadeWay, places, preferred
from jaxplan.goal.least_time import platform, pointers, time_unit
from jaxplan.goal.minimax import STILLNESS
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import as_path
from jaxplan.model.goals import LEAST_TIME, Targets
from jaxplan.model.path import Goal
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.differentiation import Equations, implicit_root


def differentiable_goal(
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: ArrayLike,
    targets: Targets,
    cones: Constraints,
    *,
    start_joints: ArrayLike | None = None,
    moves: Sequence[MadeWay] | None = None,
    met: Sequence[int] = (),
) -> Goal:
    """Return a goal of step 1 as a differentiable function of the problem that it solves.

    First derivatives, forward and backward, are those of the optimum, with respect to: the start, the
    targets, the limits at the goal, the mounting and ranges of devices, the boresights of instruments, axes
    of the body, the axes and half-angles of cones, and the bounds of rows of joints. There are no second
    derivatives. The function composes with ``jit`` and ``vmap``: problems with equally many devices and rows
    can be stacked, whatever is active at their goals. Pairs that step 1 leaves open are ignored here, too.

    Args:
        goal: one that `decompose` found for this problem, taken as a constant. For a problem slightly off the
            one it was found for, the answer is right to first order.
        spacecraft: its devices.
        start_attitude: (3, 3) ``R0``, body to inertial; only derivatives along rotations are meaningful.
        targets: directions for devices, of any length, and limits at the goal. Where such a limit equals the
            joint's own, the derivative goes to the joint's own. Instruments and drives meet their targets
            exactly here.
        cones: all constraints, for the devices of the spacecraft; axes of any length.
        start_joints: (J,) rad, joints of devices without a target, those of the goal by default; also where
            all joints start from for a goal of least time, zero by default.
        moves: how devices without a target make way, from `jaxplan.goal.free_devices.settled`, so that
            they follow what they prefer and what is in their way; None where they stay as they are at the
            goal.
        met: places in `targets.prefer` of the wishes that the goal meets, which then bind the attitude as
            targets do: an instrument's by two equations, a drive's by one and a range, a terminal's by
            ranges.

    Returns:
        The goal as JAX arrays, its joints not clipped. Where the optimum has no derivative, a finite one is
        returned. Where a limit is touched but its multiplier is zero, it is the one-sided derivative that
        stays clear of the limit; so where the start is the goal, the goal follows the start and the slew has
        derivative zero. Where nearby attitudes are as good, as at half a turn, it is the derivative that
        moves the goal least.

    Example:
        >>> goal = decompose(spacecraft, start, targets, cones).goals[0]
        >>> def slew(half_angle):
        ...     changed = replace(cones, half_angle=half_angle)
        ...     return differentiable_goal(goal, spacecraft, start, targets, changed).slew_angle
        >>> jax.grad(slew)(cones.half_angle)
    """
    return _follow_optimum(
        _FIRST_ORDER, goal, spacecraft, start_attitude, targets, cones, start_joints, moves, met
    )


def goal_in_time(
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: ArrayLike,
    targets: Targets,
    cones: Constraints,
    *,
    start_joints: ArrayLike | None = None,
    moves: Sequence[MadeWay] | None = None,
    target_rates: ArrayLike,
    axis_rates: ArrayLike,
) -> Goal:
    """Return a goal at which targets or zones move, with its rates, as a function of its problem.

    Arguments not described here are those of `differentiable_goal`.

    Args:
        goal: as for `differentiable_goal`.
        spacecraft: its devices.
        start_attitude: (3, 3) ``R0``, body to inertial.
        targets: where they are when the manoeuvre ends, with limits.
        cones: all Z rows of constraints at that instant.
        start_joints: (J,) rad, joint angles that devices without a target keep.
        moves: as for `differentiable_goal`.
        target_rates: (k, 3) 1/s, time derivatives of the directions of the k targets, inertial.
        axis_rates: (Z, 3) 1/s, time derivatives of the cones' axes; zero for all axes that are not inertial.

    Returns:
        The goal as from `differentiable_goal`, with the angular velocity of the platform and the joint rates
        that keep every device on its target; free devices are at rest. The rates have first derivatives, too.
    """

    def at(directions: Array, axes: Array) -> Goal:
        moved: Targets = replace(targets, directions=directions)
        zones: Constraints = replace(cones, axis=axes)  # type: ignore[arg-type]
        return _follow_optimum(
            _SECOND_ORDER, goal, spacecraft, start_attitude, moved, zones, start_joints, moves
        )

    directions, axes = jnp.asarray(targets.directions), jnp.asarray(cones.axis)
    rates = jnp.asarray(target_rates, directions.dtype), jnp.asarray(axis_rates, axes.dtype)
    found, rate = jax.jvp(at, (directions, axes), rates)
    attitude: Any = found.attitude
    spin = so3.vee(attitude.T @ jnp.asarray(rate.attitude))
    aims = aims_of(spacecraft, targets, goal_ranges(spacecraft, targets))
    numbers, gimbals = aims.free(spacecraft.gimbals), spacecraft.gimbals
    resting = np.concatenate([gimbals.joints_of(number) for number in numbers] or [np.zeros(0, int)])
    return replace(found, angular_velocity=spin, joint_rates=jnp.asarray(rate.joints).at[resting].set(0))


def _follow_optimum(
    equations: Equations,
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: ArrayLike,
    targets: Targets,
    cones: Constraints,
    start_joints: ArrayLike | None,
    moves: Sequence[MadeWay] | None,
    met: Sequence[int] = (),
) -> Goal:
    """Return the goal as `differentiable_goal` describes it, with its arguments.

    `equations` is `_FIRST_ORDER` for first derivatives, or `_SECOND_ORDER` for a result differentiated twice.

    Raises:
        NotImplementedError: for a goal of least time with `_SECOND_ORDER`.
    """
    found = jax.lax.stop_gradient(jnp.asarray(goal.attitude))
    start = jnp.asarray(start_attitude, found.dtype)
    turn = quaternion.from_matrix(jax.lax.stop_gradient(start).T @ found)[:, None]  # as one lane
    rest = _rest_joints(goal, start_joints, found.dtype)
    state = GoalState.of(spacecraft, targets, cones, rest, found.dtype, met)
    state = state.cleared(targets.clearance)
    caps = assemble_caps(state, start)
    matter = caps_to_keep(found, jax.lax.stop_gradient(state))
    if targets.criterion == LEAST_TIME:
        if equations.again:
            raise NotImplementedError("goals of least time are not followed in time: use least_rotation")
        unit = time_unit(spacecraft)
        began = jnp.zeros_like(rest) if start_joints is None else jnp.asarray(start_joints, rest.dtype)
        moving = pointers(spacecraft, state.aims, (), start, began, unit)
        of_caps = caps.axis, caps.direction, caps.half_angle
        none = jnp.zeros(4, int)
        own = _LeastTimeConditions(turn, of_caps, moving, platform(spacecraft, unit), none)
        optimum = soonest_turn(own, matter, equation_cap_numbers(state.asked))
    else:
        number, multiplier = active_caps(turn, jax.lax.stop_gradient(caps), matter, state.asked)
        conditions = _Conditions(
            turn, GoalCaps(*(part[jnp.maximum(number, 0)] for part in caps)), number >= 0
        )
        guess = jnp.concatenate([jnp.zeros(3, found.dtype), multiplier])
        optimum = turned(turn, implicit_root(equations, conditions, guess)[:3, None])

    attitude = start @ quaternion.to_matrix(optimum[:, 0])
    slew_angle = angle_terms(optimum)[0][0]
    joints = pointed(state.sights.gimbals, state.aims, attitude, rest)
    if moves is not None:
        joints = _place_free_devices(state, spacecraft, targets, moves, attitude, joints, start_joints)
    arrays: dict[str, Any] = {"attitude": attitude, "joints": joints, "slew_angle": slew_angle}
    return Goal(**arrays)  # typed as numpy's, here JAX arrays


def _place_free_devices(
    state: "GoalState",
    spacecraft: Spacecraft,
    targets: Targets,
    moves: Sequence[MadeWay],
    attitude: Array,
    joints: Array,
    start_joints: ArrayLike | None,
) -> Array:
    """Return the joints (J,) rad with free devices where they prefer to be, or out of the way.

    Args:
        state: what is asked at the goal, as JAX arrays.
        spacecraft: its devices.
        targets: with what devices prefer.
        moves: how devices made way.
        attitude: (3, 3) of the goal, body to inertial.
        joints: (J,) rad, with those of devices that have targets set.
        start_joints: (J,) rad, from which free devices move; None for `joints`.
    """
    gimbals, dtype = state.sights.gimbals, joints.dtype
    free, ranges = state.aims.free(gimbals), jnp.asarray(goal_ranges(spacecraft, targets), dtype)
    for number in free if start_joints is not None else []:
        own = gimbals.joints_of(number)
        joints = joints.at[own].set(jnp.asarray(start_joints, dtype)[own])
    names = spacecraft.device_names
    wishes = [
        (names.index(wish.device), normalise(jnp.asarray(as_path(wish.direction).at(0.0), dtype)))
        for wish in targets.prefer
    ]
    joints = preferred(gimbals, ranges, free, wishes, attitude, joints)
    return places(moves, ranges, state.rows, state.sights, attitude, joints)


def _rest_joints(goal: Goal, start_joints: ArrayLike | None, dtype: jnp.dtype) -> Array:
    """Return joints (J,) rad at the goal for devices without a target.

    A joint that is at the goal what it is at the start follows the start's number in derivatives. One that
    has moved is a constant, as are all where no start is given.
    """
    at_goal = jax.lax.stop_gradient(jnp.asarray(goal.joints, dtype))
    if start_joints is None:
        return at_goal
    start = jnp.asarray(start_joints, dtype)
    return jnp.where(jax.lax.stop_gradient(start) == at_goal, start, at_goal)


class _Conditions(NamedTuple):
    """What the conditions of optimality of problem (7) depend on.

    Attributes:
        turn: (4, 1) unit quaternion, scalar first, of the turn from the start to the goal found.
        caps: three of the caps, among them the active ones.
        used: (3,) bool, whether each of the three is active.
    """

    turn: Array
    caps: GoalCaps
    used: Array


def _kkt_residual(own: _Conditions, z: Array) -> Array:
    """Return the residual (6,) of the conditions of optimality of problem (7).

    ``z`` is the turn (3,) rad from the goal found, then the multipliers (3,).
    """
    return _kkt_terms(own, z)[0]


def _kkt_terms(own: _Conditions, z: Array) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Return `_kkt_residual`, the objective's Hessian (3, 3, 1), and the `cap_terms` of the three caps."""
    turn = turned(own.turn, z[:3, None])
    _, eta, hessian = angle_terms(turn)
    body, depth, slope = cap_terms(turn, *own.caps)
    push = slope[:, :, 0] @ jnp.where(own.used, z[3:], 0)
    residual = jnp.concatenate([eta[:, 0] + push, jnp.where(own.used, depth[:, 0], z[3:])])
    return residual, hessian, (body, depth, slope)


def _linearised_kkt(own: _Conditions, z: Array) -> tuple[Array, Array]:
    """Return `_kkt_residual` at ``z``, and the pseudoinverse (6, 6) of its derivative by ``z``.

    The latter is zero along directions that are not determined, as where nearby attitudes are equally good.
    It is right to first order in the turn, as much as second derivatives at the goal found depend on.
    """
    residual, hessian, terms = _kkt_terms(own, z)
    active = Active(number=jnp.where(own.used, np.arange(3), -1)[:, None], multiplier=z[3:, None])
    curved, normals, _ = active_terms(active, own.caps.axis, *terms)
    normal, free = normals[:, :, 0], jnp.diag(jnp.where(own.used, 0, jnp.ones_like(z[3:])))
    derivative = jnp.block([[(hessian + curved)[:, :, 0], normal], [normal.T, free]])
    decided = float(jnp.finfo(derivative.dtype).eps) ** (2 / 3)
    further = jnp.linalg.pinv(derivative, rtol=decided, hermitian=True)
    # Hessian and gradients are along a further turn d, and exp(z^) exp(d^) = exp((z + d + z x d / 2 + ...)^).
    return residual, further.at[:3].add(so3.hat(z[:3] / 2) @ further[:3])


_FIRST_ORDER = Equations(
    residual=_kkt_residual, linearise=_linearised_kkt, solve=jnp.matmul, steps=1, tolerance=0.0
)
_SECOND_ORDER = replace(_FIRST_ORDER, again=True)


class _LeastTimeConditions(NamedTuple):
    """A goal of least time with its active ways and caps, from which the conditions of optimality follow.

    Attributes:
        turn: (4, 1) unit quaternion, scalar first, of the turn from the start to the goal found.
        caps: axes (m, 3), directions (m, 3) and half-angles (m,) rad of all m caps that may be active.
        pointers: devices whose joints follow directions.
        platform: lengths of the platform's turns, with limits of their speeds.
        number: (4,) which caps and ways are active: caps from 0, ways from m on, -1 for a free slot.
    """

    turn: Array
    caps: tuple[Array, Array, Array]
    pointers: Pointers
    platform: Platform
    number: Array


def soonest_turn(conditions: _LeastTimeConditions, matter: Array, equations: np.ndarray) -> Array:
    """Return the quaternion (4, 1) of the turn of least time near the one found, differentiable once.

    Args:
        conditions: the goal found; its `number` is ignored, since what is active is found here.
        matter: (m,) bool, which of the m caps must be kept.
        equations: (2, e) numbers of the upper and lower caps of each of e angles that are met exactly.
    """
    still = jax.lax.stop_gradient(conditions)
    way, *_ = ways(still.turn, still.pointers, still.platform)
    time = max_along(_least_times(way[:, 0], *speed_limits(still.pointers, still.platform)), 0)
    guess = jnp.concatenate([jnp.zeros(3, time.dtype), time[None]])
    at = jnp.zeros(4, time.dtype).at[3].set(time)
    excess, slopes = _constraint_excess(still, at), jax.jacfwd(lambda z: _constraint_excess(still, z))(at)
    met = jnp.concatenate([matter, jnp.ones(len(way), bool)])
    excess = jnp.where(met, excess.at[equations.ravel()].set(0.0), MET)
    gradient = jax.grad(lambda z: _objective(still, z))(at)
    _, active, _ = descent.solve(
        jnp.eye(4)[:, :, None], gradient[:, None], slopes.T[:, :, None], excess[:, None]
    )
    number, multiplier = active.number[:, 0], active.multiplier[:, 0]
    for upper, lower in equations.T.tolist():
        missing = ~jnp.any((number == upper) | (number == lower))
        slot = jnp.argmin(number)  # a free one, if any
        put = missing & (number[slot] < 0)
        number = jnp.where(put & (np.arange(4) == slot), upper, number)
    own = conditions._replace(number=number)
    root = implicit_root(_LEAST_TIME, own, jnp.concatenate([guess, multiplier]))
    return turned(conditions.turn, root[:3, None])


def _least_times(way: Array, top: Array, growth: Array) -> Array:
    """Return least times from rest to rest over w ways (w,), with limits (w,) of rate and acceleration."""
    way = jnp.maximum(way, 0)
    return jnp.where(way * growth < top**2, 2 * jnp.sqrt(way / growth), way / top + top / growth)


def _constraint_excess(own: _LeastTimeConditions, at: Array) -> Array:
    """Return the excess over the m caps and then the w ways less their reach, (m + w,).

    `at` (4,) is the turn from the goal found, rad, and the time.
    """
    turn = turned(own.turn, at[:3, None])
    _, excess, _ = cap_terms(turn, *own.caps)
    way, *_ = ways(turn, own.pointers, own.platform)
    reached, *_ = reach(at[3:], *speed_limits(own.pointers, own.platform))
    return jnp.concatenate([excess, way - reached])[:, 0]


def _objective(own: _LeastTimeConditions, at: Array) -> Array:
    """Return the objective: half the square of the time plus a little of that of the turn.

    The second term makes the optimum unique. `at` is as for `_constraint_excess`.
    """
    _, eta, _ = angle_terms(turned(own.turn, at[:3, None]))
    return at[3] ** 2 / 2 + STILLNESS * jnp.sum(eta**2) / 2


def _least_time_residual(own: _LeastTimeConditions, z: Array) -> Array:
    """Return the residual (8,) of the conditions of optimality of least time.

    ``z`` is the turn (3,) rad from the goal found, the time, and the multipliers (4,).
    """
    used, number = own.number >= 0, jnp.maximum(own.number, 0)

    def lagrangian(at: Array) -> tuple[Array, Array]:
        depth = jnp.where(used, _constraint_excess(own, at)[number], 0)
        return _objective(own, at) + jnp.sum(z[4:] * depth), depth

    slope, depth = jax.grad(lagrangian, has_aux=True)(z[:4])
    return jnp.concatenate([slope, jnp.where(used, depth, z[4:])])


def _linearised_least_time(own: _LeastTimeConditions, z: Array) -> tuple[Array, Array]:
    """Return `_least_time_residual` (8,) at ``z``, and the pseudoinverse (8, 8) of its derivative by ``z``.

    The latter is zero along directions that are not determined.
    """

    def residual(z: Array) -> tuple[Array, Array]:
        found = _least_time_residual(own, z)
        return found, found

    found: Any = jax.jacfwd(residual, has_aux=True)(z)
    derivative, value = found
    return value, jnp.linalg.pinv(derivative, rtol=float(jnp.finfo(z.dtype).eps) ** (2 / 3))


_LEAST_TIME = Equations(
    residual=_least_time_residual, linearise=_linearised_least_time, solve=jnp.matmul, steps=1, tolerance=0.0
)
