"""Derivatives of a goal of step 1 by its problem: those of the optimum of problem (7).

Every choice is held fixed: which local minimum the goal is, and which limits and zones are active there. The
rest is the implicit function theorem. Along ``E exp(d^)``, where ``E = R0^T R`` is the turn to the goal
found, and with the caps of `caps` and the terms of `descent`, the optimum is where

    eta + sum of m_i n_i = 0        n_i the gradient of the excess over cap i, m_i its multiplier
    excess_i = 0                    of all active caps, at most three

At the goal found ``d`` is zero, so a step of Newton's method changes nothing but rounding. The curvature of
objective and caps is in the equations' matrix. For a goal that follows moving targets the rates are
derivatives already (`goal_in_time`), and have first derivatives themselves.

Attitudes are body to inertial, angles in radians, joints as in `jaxplan.model.spacecraft`. Shapes: J joints,
Z rows, m caps, k devices with targets.
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
from jaxplan.geometry.vectors import array_module, length
from jaxplan.goal import descent, least_time_derivative
from jaxplan.goal.aims import AZIMUTH, ELEVATION, Aims, Known, aims_of, goal_ranges, known_sights, pointed
from jaxplan.goal.descent import MET, Active, active_terms, angle_terms, cap_terms, turned
from jaxplan.goal.free_devices import MadeWay, places, preferred
from jaxplan.goal.least_time import platform, pointers, time_unit
from jaxplan.goal.pairs import cleared, pairs_at_goal, single_yaws
from jaxplan.model.constraints import Constraints, chosen_entries, state_margins
from jaxplan.model.directions import Sights, as_path
from jaxplan.model.gimbals import TURN
from jaxplan.model.goals import LEAST_TIME, Targets
from jaxplan.model.path import Goal
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.implicit import Equations, implicit_root


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
        moves: how devices without a target make way, from `free_devices.settled`, so that they follow what
            they prefer and what is in their way; None where they stay as they are at the goal.
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
    state = _State.of(spacecraft, targets, cones, rest, found.dtype, met)
    state = state.cleared(targets.clearance)
    caps = _assemble_caps(state, start)
    matter = _caps_to_keep(found, jax.lax.stop_gradient(state))
    if targets.criterion == LEAST_TIME:
        if equations.again:
            raise NotImplementedError("goals of least time are not followed in time: use least_rotation")
        unit = time_unit(spacecraft)
        began = jnp.zeros_like(rest) if start_joints is None else jnp.asarray(start_joints, rest.dtype)
        moving = pointers(spacecraft, state.aims, (), start, began, unit)
        of_caps = caps.axis, caps.direction, caps.half_angle
        none = jnp.zeros(4, int)
        own = least_time_derivative.Conditions(turn, of_caps, moving, platform(spacecraft, unit), none)
        optimum = least_time_derivative.soonest_turn(own, matter, _equation_cap_numbers(state.asked))
    else:
        number, multiplier = _active_caps(turn, jax.lax.stop_gradient(caps), matter, state.asked)
        conditions = _Conditions(turn, _Caps(*(part[jnp.maximum(number, 0)] for part in caps)), number >= 0)
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
    state: "_State",
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
        (names.index(wish.device), _normalise(jnp.asarray(as_path(wish.direction).at(0.0), dtype)))
        for wish in targets.prefer
    ]
    joints = preferred(gimbals, ranges, free, wishes, attitude, joints)
    return places(moves, ranges, state.rows, state.sights, attitude, joints)


def _rest_joints(goal: Goal, start_joints: ArrayLike | None, dtype: jnp.dtype) -> Array:
    """Return joints (J,) rad for devices without a target.

    Each is the start's, with its derivative, where the goal has the same value, and the goal's, as a
    constant, where the device has moved.
    """
    at_goal = jax.lax.stop_gradient(jnp.asarray(goal.joints, dtype))
    if start_joints is None:
        return at_goal
    start = jnp.asarray(start_joints, dtype)
    return jnp.where(jax.lax.stop_gradient(start) == at_goal, start, at_goal)


class _State(NamedTuple):
    """What is asked at the goal, as JAX arrays.

    Attributes:
        aims: of devices with targets, with equations met exactly.
        asked: `aims` and those of wishes that are met.
        rows: all constraints.
        sights: the directions that the rows bind.
        rest: (J,) rad, joints of devices without a target.
    """

    aims: Aims
    asked: Aims
    rows: Constraints
    sights: Sights
    rest: Array

    @classmethod
    def of(
        cls,
        spacecraft: Spacecraft,
        targets: Targets,
        cones: Constraints,
        rest: Array,
        dtype: jnp.dtype,
        met: Sequence[int] = (),
    ) -> "_State":
        """Make the arrays by which a goal is differentiated, with all directions brought to unit length.

        Args:
            spacecraft: with the devices that point.
            targets: their directions.
            cones: the constraints.
            rest: (J,) rad, joints of devices without a target.
            dtype: type of all numbers.
            met: places in `targets.prefer` of the wishes that are met.
        """

        def aims_at(targets: Targets) -> Aims:
            aims = aims_of(spacecraft, targets, goal_ranges(spacecraft, targets))
            directions = _normalise(jnp.asarray(aims.directions, dtype))
            frames, ranges = (jnp.asarray(part, dtype) for part in (aims.frames, aims.ranges))
            return replace(aims, directions=directions, frames=frames, ranges=ranges)  # type: ignore[arg-type]

        aims = asked = aims_at(targets)
        if met:
            asked = aims_at(with_met(targets, spacecraft, met))
        parts: dict[str, Any] = {
            name: _normalise(jnp.asarray(getattr(cones, name), dtype)) for name in ("axis", "body")
        }
        parts |= {
            name: jnp.asarray(getattr(cones, name), dtype) for name in ("side", "half_angle", "carried")
        }
        rows = replace(cones, **parts)  # typed as numpy's, here JAX arrays
        boresights = _normalise(jnp.asarray(spacecraft.fixed_boresights, dtype))
        gimbals = jax.tree.map(lambda part: jnp.asarray(part, dtype), spacecraft.gimbals)
        return cls(aims=aims, asked=asked, rows=rows, sights=rows.sights(gimbals, boresights), rest=rest)

    @property
    def known(self) -> Known:
        """The directions of sights that are known whatever the attitude."""
        return known_sights(self.aims, self.sights, self.rest)

    def cleared(self, clearance: ArrayLike) -> "_State":
        """Return the state with its rows tightened by the goal's clearance, rad, as in step 1."""
        pairs = pairs_at_goal(self.rows, self.sights, self.known, self.rest)
        wanted = jnp.asarray(clearance, self.rest.dtype)
        return self._replace(rows=cleared(self.rows, pairs, wanted))

    @property
    def columns(self) -> slice | np.ndarray:
        """The numbers of the sights that may make caps with rows."""
        count = self.sights.gimbals.count
        if self.rows.inner or self.aims.held:
            return slice(None)
        aimed = np.isin(np.arange(self.sights.count), self.aims.devices)
        return np.flatnonzero((np.arange(self.sights.count) >= count) & ~aimed)


class _Caps(NamedTuple):
    """The m caps that may be active at a goal, in the form of `caps.Caps`, with an empty one at the end.

    First come the caps of the k largest azimuths, then of the k largest elevations, likewise of the least
    ones; then for each row one cap for each sight of `_State.columns`.
    """

    axis: Array  # (m, 3) unit vectors in body axes
    direction: Array  # (m, 3) unit vectors in the body axes of the start
    half_angle: Array  # (m,) rad


class _Conditions(NamedTuple):
    """What the conditions of optimality depend on.

    Attributes:
        turn: (4, 1) unit quaternion, scalar first, of the turn from the start to the goal found.
        caps: three of the caps, among them the active ones.
        used: (3,) bool, whether each of the three is active.
    """

    turn: Array
    caps: _Caps
    used: Array


def _equation_cap_numbers(aims: Aims) -> np.ndarray:
    """Return the numbers in `_Caps` of the upper and lower caps of the e equations, as rows (2, e)."""
    above = np.flatnonzero(np.array(aims.equations, bool).reshape(-1, 2).T)
    return np.stack([above, above + 2 * len(aims.devices)])


def _active_caps(turn: Array, caps: _Caps, matter: Array, aims: Aims) -> tuple[Array, Array]:
    """Find the caps that are active at the goal found, with their multipliers.

    They come from the quadratic program of the least turn with the caps taken as linear. At an optimum its
    solution is zero; where more than three caps are touched, it chooses. Of an equation the active cap is the
    one on the side to which the turn would leave it, if any, else the upper one, with multiplier zero.

    Args:
        turn: (4, 1) quaternion of the turn from the start to the goal found.
        caps: all m caps.
        matter: (m,) bool, which caps must be kept.
        aims: with the equations.

    Returns:
        Their numbers (3,), -1 for a free slot, and multipliers (3,).
    """
    _, eta, _ = angle_terms(turn)
    _, excess, gradients = cap_terms(turn, *caps)
    of_equations, below = _equation_cap_numbers(aims)
    excess = excess.at[np.concatenate([of_equations, below])].set(0.0)
    excess = jnp.where(matter[:, None], excess, MET)
    identity = jnp.eye(3, dtype=turn.dtype)
    _, active, _ = descent.solve(identity[:, :, None], eta, gradients, excess)
    number, multiplier = active.number[:, 0], active.multiplier[:, 0]
    for upper, lower in zip(of_equations.tolist(), below.tolist(), strict=True):
        missing = ~jnp.any((number == upper) | (number == lower))
        slot = jnp.argmin(number)  # a free one, if any
        put = missing & (number[slot] < 0)
        number = jnp.where(put & (np.arange(3) == slot), upper, number)
    return number, multiplier


def _kkt_residual(own: _Conditions, z: Array) -> Array:
    """Return the residual (6,) of the conditions of optimality.

    ``z`` is the turn (3,) rad from the goal found, then the multipliers (3,).
    """
    turn = turned(own.turn, z[:3, None])
    _, eta, _ = angle_terms(turn)
    _, depth, slope = cap_terms(turn, *own.caps)
    push = slope[:, :, 0] @ jnp.where(own.used, z[3:], 0)
    return jnp.concatenate([eta[:, 0] + push, jnp.where(own.used, depth[:, 0], z[3:])])


def _kkt_inverse(own: _Conditions, z: Array) -> Array:
    """Return the pseudoinverse (6, 6) of the derivative of `_kkt_residual` by ``z``.

    It is zero along directions that are not determined, as where nearby attitudes are equally good.
    """
    turn = turned(own.turn, z[:3, None])
    _, _, hessian = angle_terms(turn)
    body, depth, slope = cap_terms(turn, *own.caps)
    active = Active(number=jnp.where(own.used, np.arange(3), -1)[:, None], multiplier=z[3:, None])
    curved, normals, _ = active_terms(active, own.caps.axis, body, depth, slope)
    normal, free = normals[:, :, 0], jnp.diag(jnp.where(own.used, 0, jnp.ones_like(z[3:])))
    derivative = jnp.block([[(hessian + curved)[:, :, 0], normal], [normal.T, free]])
    decided = float(jnp.finfo(derivative.dtype).eps) ** (2 / 3)
    return jnp.linalg.pinv(derivative, rtol=decided, hermitian=True)


_FIRST_ORDER = Equations(
    residual=_kkt_residual, factor=_kkt_inverse, solve=jnp.matmul, steps=1, tolerance=0.0
)
_SECOND_ORDER = replace(_FIRST_ORDER, again=True)


def _assemble_caps(state: _State, start: Array) -> _Caps:
    """Return all caps of a problem, for a start attitude (3, 3), body to inertial."""
    aims, dtype, own = state.asked, start.dtype, state.columns
    frames, (low, high) = jnp.asarray(aims.frames), jnp.moveaxis(jnp.asarray(aims.ranges), -1, 0)
    edges = jnp.stack([high[:, AZIMUTH] + jnp.pi / 2, low[:, AZIMUTH] - jnp.pi / 2])  # (2, k)
    of_azimuth = jnp.cos(edges)[..., None] * frames[..., 0] + jnp.sin(edges)[..., None] * frames[..., 1]
    up, flat = frames[..., 2], jnp.full(len(frames), jnp.pi / 2, dtype)
    of_aims = jnp.concatenate([of_azimuth[0], up, of_azimuth[1], -up])
    half_angles = [flat, flat - high[:, ELEVATION], flat, flat + low[:, ELEVATION]]
    pairs = pairs_at_goal(state.rows, state.sights, state.known, state.rest)
    end = jnp.zeros((1, 3), dtype)
    directions = jnp.asarray(aims.directions)
    return _Caps(
        axis=jnp.concatenate([of_aims, pairs.axis[:, own].reshape(-1, 3), end]),
        direction=jnp.concatenate([jnp.tile(directions, (4, 1)), pairs.direction[:, own].reshape(-1, 3), end])
        @ start,
        half_angle=jnp.concatenate([*half_angles, pairs.half_angle[:, own].ravel(), end[:, 0]]),
    )


def _caps_to_keep(attitude: Array, state: _State) -> Array:
    """Tell which of the m caps must be kept at an attitude (3, 3), body to inertial, as (m,) bool.

    Of a range it is the cap of the nearer end, of a constraint those of its best entry.
    """
    aims, rows = state.asked, state.rows
    ranges, angles = jnp.asarray(aims.ranges), jnp.stack(aims.angles(attitude), axis=-1)  # (k, 2)
    above = angles >= jnp.mean(ranges, axis=-1)
    equations = np.array(aims.equations, bool).reshape(-1, 2)
    limited = jnp.stack(
        [ranges[:, AZIMUTH, 1] - ranges[:, AZIMUTH, 0] < TURN, jnp.ones(len(ranges), bool)], -1
    )
    upper, lower = ((part & limited) | equations for part in (above, ~above))

    joints = pointed(state.sights.gimbals, state.aims, attitude, state.rest)
    margins = state_margins(rows, state.sights, attitude, joints)
    chosen = chosen_entries(rows, jnp.min(margins, axis=-1, initial=jnp.inf))
    capped = pairs_at_goal(rows, state.sights, state.known, state.rest).capped
    capped = capped & (rows.entry == chosen)[:, None]
    if rows.inner:  # a yaw more than a quarter turn off its bound may be on the other side of its plane
        capped = capped & ~(single_yaws(rows)[:, None] & (margins > jnp.pi / 2))
    of_rows = capped[:, state.columns]
    return jnp.concatenate([upper.T.ravel(), lower.T.ravel(), of_rows.ravel(), jnp.zeros(1, bool)])


def with_met(targets: Targets, spacecraft: Spacecraft, met: Sequence[int]) -> Targets:
    """Return targets at an instant with the wishes in places `met` of `targets.prefer` as further targets."""
    wishes = [targets.prefer[place] for place in met]
    directions = [*targets.directions, *(as_path(wish.direction).at(0.0) for wish in wishes)]
    names = (*targets.names(spacecraft), *(wish.device for wish in wishes))
    return replace(targets, devices=names, directions=array_module(*directions).stack(directions))


def _normalise(vectors: Array) -> Array:
    """Return vectors (..., 3) brought to unit length."""
    return vectors / length(vectors)[..., None]
