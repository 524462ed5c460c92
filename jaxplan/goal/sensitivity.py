"""How a goal of step 1 follows its problem: the derivative of the optimum of problem (7).

What is held fixed is every choice: which local minimum the goal is, and which limits and zones it leans on.
The rest is the implicit function theorem. Along ``E exp(d^)``, where ``E = R0^T R`` is the turn to the goal
found, and with the caps of `caps` and the terms of `descent`, the optimum is where

    eta + sum of m_i n_i = 0        n_i the gradient of the excess over cap i, m_i its multiplier
    excess_i = 0                    of all caps that are leant on, at most three

At the goal found ``d`` is zero, and Newton's method changes nothing but rounding. The curvature of objective
and caps is in the equations' matrix. As the goal is followed in time, so are its rates (`goal_in_time`): they
are derivatives already, and have first ones themselves.

Attitudes are body to inertial, angles in radians, joints all yaws and then all pitches.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry import quaternion
from jaxplan.geometry.vectors import length
from jaxplan.goal import descent
from jaxplan.goal.caps import cleared, pairs_at_goal, single_yaws
from jaxplan.goal.descent import MET, Active, active_terms, angle_terms, cap_terms, turned
from jaxplan.model.constraints import Constraints, chosen_entries, state_margins
from jaxplan.model.path import Goal
from jaxplan.model.scenario import Targets
from jaxplan.model.spacecraft import Spacecraft, joints_toward, stacked
from jaxplan.runtime.implicit import Equations, implicit_root


def differentiable_goal(
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: ArrayLike,
    targets: Targets,
    cones: Constraints,
) -> Goal:
    """A goal of step 1 as a function of the problem that it solves.

    Its first derivatives, forward and backward, are those of the optimum: by the start, the targets, the
    limits at the goal, the mounting angles and limits of terminals, the boresights of instruments, axes of
    the body, the axes and half-angles of cones, and the bounds of rows of joints. There are no second ones.
    It composes with ``jit`` and ``vmap``: scenes with as many devices and rows can be stacked, whatever
    their goals lean on. What step 1 leaves open is held by nothing here either.

    Args:
        goal: one that `decompose` found for this problem; a constant. For a problem slightly off the one it
            was found for, the answer is right to first order.
        spacecraft: terminals and instruments.
        start_attitude: (3, 3) ``R0``, body to inertial; only its derivatives along rotations mean something.
        targets: a direction for each terminal, of any length, and limits at the goal. Where such a limit is
            equal to the joint's own, the derivative is by the joint's own.
        cones: all constraints, for the devices of the spacecraft; axes of any length.

    Returns:
        The goal as jax arrays, its joints not clipped. Where the optimum has no derivative, a finite one is
        returned: where a limit is touched but not leant on, it is the one from the side that stays clear of
        it. So where the start is the goal, the goal follows the start and the slew has derivative zero. Where
        nearby attitudes are as good, as at half a turn, it is the one that moves the goal least.

    Example:
        >>> goal = decompose(spacecraft, start, targets, cones).goals[0]
        >>> def slew(half_angle):
        ...     changed = replace(cones, half_angle=half_angle)
        ...     return differentiable_goal(goal, spacecraft, start, targets, changed).slew_angle
        >>> jax.grad(slew)(cones.half_angle)
    """
    return _optimum(_ONCE, goal, spacecraft, start_attitude, targets, cones)


def goal_in_time(
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: ArrayLike,
    targets: Targets,
    cones: Constraints,
    *,
    target_rates: ArrayLike,
    axis_rates: ArrayLike,
) -> Goal:
    """A goal that follows what moves, with its rates, as a function of the problem that it solves.

    Args:
        goal: as of `differentiable_goal`, and so are all others.
        spacecraft: terminals and instruments.
        start_attitude: (3, 3) ``R0``, body to inertial.
        targets: where they are when the manoeuvre ends, with limits.
        cones: all constraints as they are then.
        target_rates: (n, 3) 1/s, derivatives of the targets' directions.
        axis_rates: (Z, 3) 1/s, those of the cones' axes; zero for all that are not inertial.

    Returns:
        The goal as of `differentiable_goal`, with the platform's angular velocity and the joints' rates that
        keep every terminal on its target; these have first derivatives, too.
    """

    def at(directions: Array, axes: Array) -> Goal:
        moved: Targets = replace(targets, directions=directions)
        zones: Constraints = replace(cones, axis=axes)  # type: ignore[arg-type]
        return _optimum(_AGAIN, goal, spacecraft, start_attitude, moved, zones)

    directions, axes = jnp.asarray(targets.directions), jnp.asarray(cones.axis)
    rates = jnp.asarray(target_rates, directions.dtype), jnp.asarray(axis_rates, axes.dtype)
    found, rate = jax.jvp(at, (directions, axes), rates)
    attitude: Any = found.attitude
    spin = so3.vee(attitude.T @ jnp.asarray(rate.attitude))
    return replace(found, angular_velocity=spin, joint_rates=rate.joints)


def _optimum(
    equations: Equations,
    goal: Goal,
    spacecraft: Spacecraft,
    start_attitude: ArrayLike,
    targets: Targets,
    cones: Constraints,
) -> Goal:
    """The goal as `differentiable_goal` describes it, differentiable once or again as the equations are."""
    found = jax.lax.stop_gradient(jnp.asarray(goal.attitude))
    start = jnp.asarray(start_attitude, found.dtype)
    turn = quaternion.from_matrix(jax.lax.stop_gradient(start).T @ found)[:, None]  # as one lane
    cones = _with_clearance(spacecraft, targets, cones)
    caps = _caps(spacecraft, start, targets, cones)
    matter = _matter(found, *jax.lax.stop_gradient((spacecraft, targets, cones)))
    number, multiplier = _leant_on(turn, jax.lax.stop_gradient(caps), matter)
    conditions = _Conditions(turn, _Caps(*(part[jnp.maximum(number, 0)] for part in caps)), number >= 0)
    guess = jnp.concatenate([jnp.zeros(3, found.dtype), multiplier])
    optimum = turned(turn, implicit_root(equations, conditions, guess)[:3, None])

    attitude = start @ quaternion.to_matrix(optimum[:, 0])
    slew_angle = angle_terms(optimum)[0][0]
    directions = jnp.asarray(targets.directions, found.dtype)
    joints = joints_toward(spacecraft.mounts, attitude, directions)
    arrays: dict[str, Any] = {"attitude": attitude, "joints": joints, "slew_angle": slew_angle}
    return Goal(**arrays)  # for once of jax's arrays


class _Caps(NamedTuple):
    """Every cap that a goal may lean on, in the form of `caps.Caps`, and one at the end that never matters.

    First those of the yaws' upper limits (n,) and of the pitches', then likewise of the lower ones, then for
    each row one a sight; where all rows are inertial only for the sights that these are caps for.
    """

    axis: Array  # (m, 3) unit vectors in body axes
    direction: Array  # (m, 3) unit vectors in the body axes of the start
    half_angle: Array  # (m,)


class _Conditions(NamedTuple):
    """What the conditions of optimality depend on.

    Attributes:
        turn: (4, 1) quaternion of the turn from the start to the goal found.
        caps: the three that may be leant on.
        used: (3,) bool, whether they are.
    """

    turn: Array
    caps: _Caps
    used: Array


def _leant_on(turn: Array, caps: _Caps, matter: Array) -> tuple[Array, Array]:
    """Numbers (3,) of the caps that the goal found leans on, -1 for none, and their multipliers (3,).

    They are told by the quadratic program of the least turn with the caps taken as linear. At an optimum its
    answer is no turn at all; where more than three caps are touched, it chooses.
    """
    _, eta, _ = angle_terms(turn)
    _, excess, gradients = cap_terms(turn, *caps)
    excess = jnp.where(matter[:, None], excess, MET)
    identity = jnp.eye(3, dtype=turn.dtype)
    _, active, _ = descent.solve(identity[:, :, None], eta, gradients, excess)
    return active.number[:, 0], active.multiplier[:, 0]


def _gradient(own: _Conditions, z: Array) -> Array:
    """What is zero at the optimum, of the turn (3,) from the goal found and multipliers (3,)."""
    turn = turned(own.turn, z[:3, None])
    _, eta, _ = angle_terms(turn)
    _, depth, slope = cap_terms(turn, *own.caps)
    push = slope[:, :, 0] @ jnp.where(own.used, z[3:], 0)
    return jnp.concatenate([eta[:, 0] + push, jnp.where(own.used, depth[:, 0], z[3:])])


def _inverse_curvature(own: _Conditions, z: Array) -> Array:
    """Inverse (6, 6) of its derivative where there is one; where nothing is decided it gives zero."""
    turn = turned(own.turn, z[:3, None])
    _, _, hessian = angle_terms(turn)
    body, depth, slope = cap_terms(turn, *own.caps)
    active = Active(number=jnp.where(own.used, np.arange(3), -1)[:, None], multiplier=z[3:, None])
    curved, normals, _ = active_terms(active, own.caps.axis, body, depth, slope)
    normal, free = normals[:, :, 0], jnp.diag(jnp.where(own.used, 0, jnp.ones_like(z[3:])))
    derivative = jnp.block([[(hessian + curved)[:, :, 0], normal], [normal.T, free]])
    decided = float(jnp.finfo(derivative.dtype).eps) ** (2 / 3)
    return jnp.linalg.pinv(derivative, rtol=decided, hermitian=True)


_ONCE = Equations(residual=_gradient, factor=_inverse_curvature, solve=jnp.matmul, steps=1, tolerance=0.0)
_AGAIN = replace(_ONCE, again=True)


def _caps(spacecraft: Spacecraft, start: Array, targets: Targets, cones: Constraints) -> _Caps:
    dtype = start.dtype
    mounts = jnp.asarray(spacecraft.mounts, dtype)
    boresights = jnp.asarray(spacecraft.fixed_boresights, dtype)
    yaw, pitch = jnp.split(_limits(spacecraft, targets, dtype), 2)
    edges = jnp.stack([mounts + yaw + jnp.pi / 2, mounts - yaw - jnp.pi / 2])
    of_yaw = jnp.stack([jnp.cos(edges), jnp.sin(edges), jnp.zeros_like(edges)], axis=-1)  # (2, n, 3)
    zero = jnp.zeros_like(mounts)
    up = jnp.stack([zero, zero, zero + 1], axis=-1)
    of_joints = jnp.concatenate([of_yaw[0], up, of_yaw[1], -up])
    joint_half_angle = jnp.pi / 2 - jnp.concatenate([zero, pitch])

    directions = _unit(jnp.asarray(targets.directions, dtype))
    parts: dict[str, Any] = {"axis": _unit(jnp.asarray(cones.axis, dtype))}
    parts["body"] = _unit(jnp.asarray(cones.body, dtype))
    parts |= {name: jnp.asarray(getattr(cones, name), dtype) for name in ("side", "half_angle", "carried")}
    rows = replace(cones, **parts)  # for once of jax's arrays
    pairs = pairs_at_goal(rows, rows.sights(mounts, _unit(boresights)), directions)
    own = _columns(cones, len(mounts))
    end = jnp.zeros((1, 3), dtype)
    return _Caps(
        axis=jnp.concatenate([of_joints, pairs.axis[:, own].reshape(-1, 3), end]),
        direction=jnp.concatenate([jnp.tile(directions, (4, 1)), pairs.direction[:, own].reshape(-1, 3), end])
        @ start,
        half_angle=jnp.concatenate(
            [joint_half_angle, joint_half_angle, pairs.half_angle[:, own].ravel(), end[:, 0]]
        ),
    )


def _with_clearance(spacecraft: Spacecraft, targets: Targets, cones: Constraints) -> Constraints:
    """The rows as step 1 had them, see `caps.cleared`."""
    mounts, boresights, directions = map(
        jnp.asarray, (spacecraft.mounts, spacecraft.fixed_boresights, targets.directions)
    )
    sights = cones.sights(mounts, _unit(boresights))
    axis = _unit(jnp.asarray(cones.axis))
    own = cleared(replace(cones, axis=axis), sights, _unit(directions), targets.clearance)  # type: ignore[arg-type]
    return replace(cones, half_angle=own.half_angle)


def _columns(cones: Constraints, terminals: int) -> slice:
    """The sights that rows may be caps for."""
    return slice(None) if cones.inner else slice(terminals, None)


def _matter(attitude: Array, spacecraft: Spacecraft, targets: Targets, cones: Constraints) -> Array:
    """Which caps (m,) must be kept: of a joint's two limits the nearer, of a constraint its best entry."""
    boresights = jnp.asarray(spacecraft.fixed_boresights, attitude.dtype)
    directions = jnp.asarray(targets.directions, attitude.dtype)
    joints = joints_toward(spacecraft.mounts, attitude, directions)
    above = joints >= 0
    limited = _limits(spacecraft, targets, attitude.dtype) < jnp.pi

    sights = cones.sights(jnp.asarray(spacecraft.mounts, attitude.dtype), boresights)
    margins = state_margins(cones, sights, attitude, joints)
    chosen = chosen_entries(cones, jnp.min(margins, axis=-1, initial=jnp.inf))
    capped = pairs_at_goal(cones, sights, directions).capped & (cones.entry == chosen)[:, None]
    if cones.inner:  # a yaw more than a quarter turn off its bound is on the other side of that's plane
        capped = capped & ~(single_yaws(cones)[:, None] & (margins > jnp.pi / 2))
    of_rows = capped[:, _columns(cones, len(directions))]
    return jnp.concatenate([above & limited, ~above & limited, of_rows.ravel(), jnp.zeros(1, bool)])


def _limits(spacecraft: Spacecraft, targets: Targets, dtype: jnp.dtype) -> Array:
    """Limits (2n,) of the joints at the goal: the tighter of a joint's own and the one given for the goal."""
    own = jnp.asarray(spacecraft.joint_limits, dtype)
    given = [jnp.inf if limit is None else limit for limit in (targets.yaw_limit, targets.pitch_limit)]
    at_goal = jnp.repeat(jnp.asarray(stacked(given), dtype), len(spacecraft.terminals))
    return jnp.where(at_goal < own, at_goal, own)


def _unit(vectors: Array) -> Array:
    return vectors / length(vectors)[..., None]
