"""The optimum of a spline fit as a differentiable function of its inputs, by the implicit function theorem.

As the inputs change, Newton's method follows the root of the optimality conditions (`optimality`). As long as
the same rows bind, the implicit function theorem gives the derivatives of the root in all inputs. The
following are held fixed, in an `ActiveSet`: the rows that bind, their places on the intervals, and the
branches of logarithms. When each node is passed, and where breaks lie close, follows the pace along the path
(`node_times`), and with it duration and limits. If nodes are passed exactly, each edge's share of the path is
held fixed, too.

Automatic differentiation, forward or reverse, gives ``dz = -K^-1 (dF / d inputs)`` with the matrix ``K``, the
derivative of the conditions ``F`` in the unknowns ``z``, and refuses to differentiate that again.
"""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.linalg import lu_factor, lu_solve
from jax.typing import ArrayLike

from jaxplan import so3
from jaxplan.geometry.vectors import length, min_along
from jaxplan.model.constraints import Constraints, state_margins
from jaxplan.model.limits import lesser_components, timed_limits
from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.differentiation import Equations, implicit_root
from jaxplan.trajectory import node_times
from jaxplan.trajectory.binding import ActiveSet, FitInputs, Traced
from jaxplan.trajectory.curve import Trajectory
from jaxplan.trajectory.kernels import Body
from jaxplan.trajectory.measures import to_limits
from jaxplan.trajectory.node_times import FIRST_GUESS, TrapezoidalProfile
from jaxplan.trajectory.optimality import conditions, curve_of, flat, residual
from jaxplan.trajectory.problem import tube_radius, wanted_margins
from jaxplan.trajectory.splines import SMOOTHNESS

_MAX_NEWTON_STEPS = 5  # of Newton's method, at most, before a last one, from which derivatives are taken
_RESIDUAL_TOLERANCE = 1e-9  # of the optimality conditions, below which the steps end earlier


def gather_inputs(
    held: ActiveSet,
    path: Path,
    craft: Spacecraft,
    settings: TrajectorySettings,
    cones: Constraints,
    rates: ArrayLike,
) -> tuple[ActiveSet, FitInputs]:
    """Collect the inputs of the optimality conditions, and adapt the active set to the present pace.

    Arguments are those of `refit`.

    Returns:
        The active set with its breaks moved to the pace of the path, and the inputs of `optimality`.
    """
    attitudes, joints = jnp.asarray(path.attitudes), jnp.asarray(path.joints)
    duration, places, held = _time_nodes_by_pace(held, attitudes, joints, craft, settings, rates)
    first, last = attitudes[0], attitudes[-1]
    turn = so3.log(first.T @ last)
    turn = turn * (1 - 2 * jnp.pi * held.long_way / _safe_divisor(length(turn)))
    back = so3.exp(-places[:, None] * turn / 2)  # U^T
    eta = so3.log(back @ (first.T @ attitudes) @ back)
    eta = eta * (1 + 2 * jnp.pi * held.windings / _safe_divisor(length(eta)))[:, None]
    nodes = jnp.concatenate([eta + places[:, None] * turn, joints], axis=1)
    ends = jnp.asarray(rates)
    ends = ends.at[1, :3].set(so3.exp(turn / 2) @ ends[1, :3])
    weights = jnp.stack(
        [jnp.asarray(w) for w in (settings.rate_weight, settings.acceleration_weight, settings.jerk_weight)]
    )
    radius = held.widened * tube_radius(settings)
    tube = jnp.concatenate([jnp.full(3, radius / np.sqrt(3.0)), jnp.full(joints.shape[1], radius)])
    platform, of_joints = timed_limits(craft)
    scales = [(limit.bound, limit.quantity.power) for limit in of_joints]
    low, high = jnp.asarray(craft.joint_ranges).T
    timed = sum(len(scale) for scale, _ in scales)
    scales += [((high - low) / 2, 0), (tube, 0)]
    sights, at_ends = cones.sights(craft.gimbals, craft.fixed_boresights), jnp.array([0, -1])
    times: Any = jnp.stack([jnp.zeros_like(duration), duration]) if cones.paths else None
    margins = jnp.swapaxes(state_margins(cones, sights, attitudes[at_ends], joints[at_ends], times), 1, 2)
    left = min_along(jnp.where(held.counted, margins, jnp.inf), 0)
    number = jnp.arange(len(held.zones.on))
    axes = jnp.asarray(cones.axes(held.zones.place * duration))[number, held.zones.zone]
    halves = so3.exp(held.zones.place[:, None] * turn / 2)
    names = tuple(limit.quantity.name for limit in platform)
    slow = [limit for limit in platform if limit.quantity.lesser is not None]
    rows = max((len(limit.owners) for limit in slow), default=0)
    lesser = tuple(
        -1 if part is None else part.start + number
        for limit, part in zip(platform, lesser_components(names, rows), strict=True)
        for number in range(len(limit.owners))
    )
    inputs = FitInputs(
        attitude=first,
        turn=turn,
        nodes=nodes,
        moved=places - held.places,
        ends=ends,
        weights=weights,
        centres=jnp.concatenate([jnp.zeros(timed), (low + high) / 2, jnp.zeros(len(tube))]),
        scales=jnp.concatenate([jnp.asarray(scale) for scale, _ in scales]),
        powers=jnp.concatenate([jnp.full(len(scale), float(power)) for scale, power in scales]),
        limits=held.share * jnp.concatenate([jnp.asarray(limit.bound) for limit in platform]),
        wanted=wanted_margins(cones, left),
        axes=jnp.einsum("ra,ab,rbc->rc", axes, first, halves),
        halves=halves,
        body=Body.of(craft, joints[0], jnp.asarray(rates)[0]),
        duration=duration,
        cones=cones,
        sights=sights,
        load_powers=tuple(limit.quantity.power for limit in platform for _ in limit.owners),
        lesser=lesser,
        names=names,
    )
    return held, inputs


def _time_nodes_by_pace(
    held: ActiveSet,
    attitudes: Array,
    joints: Array,
    craft: Spacecraft,
    settings: TrajectorySettings,
    rates: ArrayLike,
) -> tuple[Array, Array, ActiveSet]:
    """Determine duration and places of the nodes from the pace along a path, and move the breaks accordingly.

    Args:
        held: the active set.
        attitudes: (m + 1, 3, 3) of the nodes, body to inertial.
        joints: (m + 1, J) rad.
        craft: its limits determine the pace.
        settings: give the duration where that is a number.
        rates: (2, 3 + 2n) rad/s at start and end, of body axes and joints.

    Returns:
        The duration in s, the places (m + 1,) of the nodes in [0, 1], and the active set on the moved breaks.
    """
    turns = so3.log(jnp.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:])
    moves = jnp.diff(joints, axis=0)
    on = jnp.diff(held.places) > 0
    times = jnp.where(on, node_times.edge_times(turns, moves, craft), 0)
    shares = jnp.where(jnp.arange(len(held.places)) > 0, node_times.node_fractions(times, on), 0)
    rise = node_times.rise_time(turns, moves, craft)
    along = jnp.maximum(jnp.sum(times), held.least_length)
    profile = TrapezoidalProfile.quickest(along, rise)
    if held.stretched:
        duration = FIRST_GUESS * profile.duration
    else:
        duration = jnp.asarray(held.duration if held.free_time else settings.duration)
        if not held.free_time:
            profile = TrapezoidalProfile.within(duration, along, rise)
    if len(held.given) > 2:  # nodes that are passed exactly
        shares = jax.lax.stop_gradient(shares)
    if held.pace == "given":
        places = jnp.asarray(held.places)
    else:
        if held.pace == "at speed":
            profile = profile.between(node_times.end_paces(turns, moves, times, rates, jnp.sum(on) - 1))
        places = shares if held.pace == "steady" else profile.places(shares)
    return duration, places, _shift_flank(held, profile.flank_share - held.flank)


def _shift_flank(held: ActiveSet, change: Array) -> ActiveSet:
    """The active set for a flank whose share of the duration is larger by `change`, to first order."""
    parts: dict[str, Any] = {"": held, "linear": held.linear, "loads": held.loads, "zones": held.zones}
    moved: dict[str, dict[str, Any]] = {owner: {} for owner in parts}
    for name, slope in held.by_flank.items():
        owner, _, attribute = name.rpartition(".")
        moved[owner][attribute] = getattr(parts[owner], attribute) + change * slope
    inner = {owner: replace(parts[owner], **own) for owner, own in moved.items() if owner and own}
    return replace(held, **moved[""], **inner)


def _safe_divisor(length: Array) -> Traced:
    """Return lengths with 1 in place of those that are not positive, so that they can be divided by."""
    return jnp.where(length > 0, length, 1)


def refit(
    held: ActiveSet,
    path: Path,
    spacecraft: Spacecraft,
    settings: TrajectorySettings,
    cones: Constraints,
    rates: ArrayLike,
) -> Trajectory:
    """Compute the trajectory of a fit whose inputs have changed a little; differentiable in all of them.

    Nothing is checked: where another row comes to bind, or one no longer does, the result is the optimum
    under the rows that are held.

    Args:
        held: the active set of a fit to as many nodes.
        path: its attitudes and joints; the costs of its edges are not used.
        spacecraft: its limits, mountings and inertia.
        settings: weights, duration and tube.
        cones: the zones.
        rates: (2, 3 + 2n) rad/s at start and end, of body axes and joints.

    Returns:
        The trajectory, its arrays traced where the inputs are.
    """
    held, inputs = gather_inputs(held, path, spacecraft, settings, cones, rates)
    coefficients, duration = curve_of(
        held, inputs, implicit_root(_OPTIMALITY_EQUATIONS, (held, inputs), flat(held))
    )
    base = coefficients[:1]  # see `Basis.pieces`
    pieces = jnp.einsum("kpn,na->kpa", held.pieces, coefficients - base).at[:, 0].add(base)
    count = len(held.breaks) - 1
    breaks = held.breaks * duration
    arrays: dict[str, Any] = {
        "breaks": breaks,
        "chart_attitude": jnp.broadcast_to(inputs.attitude, (count, 3, 3)),
        "chart_start": jnp.zeros(count),
        "chart_rate": jnp.broadcast_to(inputs.turn / duration, (count, 3)),
        "coefficients": pieces[:, :, :3],
        "joint_breaks": breaks,
        "joint_coefficients": pieces[:, :, 3:],
        "node_times": (held.places + inputs.moved) * duration,
    }
    curve = Trajectory(**arrays, smoothness=SMOOTHNESS, method="global")
    return to_limits(curve, spacecraft) if held.stretched or held.free_time else curve


def _residual(own: tuple[ActiveSet, FitInputs], z: Traced) -> Traced:
    """Evaluate `residual` at ``z``; `own` is the active set and the inputs."""
    return residual(*own, z)


def _linearised(own: tuple[ActiveSet, FitInputs], z: Traced) -> tuple[Traced, Any]:
    """Evaluate `residual` at ``z``, with the LU factors of its derivative in ``z``."""
    left, matrix = conditions(*own, z)
    return left, lu_factor(matrix)


_OPTIMALITY_EQUATIONS = Equations(
    residual=_residual,
    linearise=_linearised,
    solve=lu_solve,
    steps=_MAX_NEWTON_STEPS,
    tolerance=_RESIDUAL_TOLERANCE,
)
