"""A motion of least energy as a function of what it depends on: its ends' states, with derivatives.

The nodes found by `least_motion` are turned by ``R_k exp(x_k^)`` such that, with what targets ask of the
attitudes, ``c_k``, and multipliers ``l_k``,

    d/dx (|r|^2 / 2 + sum of l_k . c_k) = 0,        c_k = 0

with the residuals ``r`` of rates, accelerations and the way there. That is solved by Newton's method, with
second derivatives of all of it, and followed by the implicit function theorem. Number of nodes and whole
turns of yaws are held, and from which ends of ranges nodes keep just the room that they keep, each with a
multiplier of its own. What leans on a constraint, or on a limit of rate, is not followed.

From the nodes follow the states in which the motion begins and ends as its curve has them: with as many
nodes between, and rates by the nodes around each end (`jaxplan.timeline.curves`). Splines are linear in what
they pass, so these are products with constant matrices.

Shapes: K + 1 nodes, J joints, k devices with targets, m equations a node.
"""

from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.geometry.vectors import length
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import DirectionPath
from jaxplan.model.gimbals import TURN, angles_along
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.implicit import Equations, implicit_root
from jaxplan.runtime.jit import quick_jit
from jaxplan.timeline import curves
from jaxplan.timeline.least_motion import Leaning, LeastMotion
from jaxplan.timeline.motions import SLEW_TIME, Motion
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.timeline.tracking import State

_STEPS = 4  # of Newton's method, which starts at the optimum of the plan


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The quantities that a motion of least energy depends on.

    Attributes:
        craft: the spacecraft.
        paths: (k) of the targets.
        attitude: (3, 3) of the state before.
        joints: (J,) rad, to which the first node is drawn; what devices without a target keep.
        begin: s.
        end: s.
        weights: (2,) of the squares of rate and acceleration.
        attitudes: (K + 1, 3, 3) of nodes near the optimum.
        angles: (K + 1, J) rad, their joints.
        devices: numbers of the devices with targets.
        leaning: on which ends of ranges nodes lean: rows 0 to J of low ends, then of high ones.
        edges: numbers of the nodes at which charts of the curve end, for each time it is given nodes between.
    """

    craft: Spacecraft
    paths: tuple[DirectionPath, ...]
    attitude: Any
    joints: Any
    begin: Any
    end: Any
    weights: Any
    attitudes: Any
    angles: Any
    leaning: Leaning
    devices: tuple[int, ...] = field(metadata={"static": True})
    edges: tuple[tuple[int, ...], ...] = field(metadata={"static": True})


def ends_of(track: Track) -> tuple[State, State]:
    """The states in which a motion of least energy begins and ends, as arrays of JAX.

    Their accelerations are not known, and zero. Numbers are NaN where the optimum is not decided.
    """
    first, last = (
        replace(State.still(attitude, joints), velocity=velocity, rates=rates)
        for attitude, joints, velocity, rates in _ends(track)
    )
    return first, last


@quick_jit
def _ends(track: Track) -> list[Any]:
    """Attitude, joints and both their rates at begin and end of a motion of least energy."""
    count, asked = len(track.attitudes), _asked(track, track.attitudes, _times(track, len(track.attitudes)))
    guess = jnp.zeros(3 * count + asked.size + len(track.leaning.node))
    found = implicit_root(_EQUATIONS, track, guess)[: 3 * count].reshape(count, 3)
    attitudes = track.attitudes @ so3.exp(found)
    for edges in track.edges:
        attitudes = _met(track, _finer(attitudes, edges))
    times = _times(track, len(attitudes))
    joints = _joints(track, attitudes, times)
    step, by_joints = times[1] - times[0], _end_slopes(len(times))
    return [
        (
            attitudes[node],
            joints[node],
            _derivatives(attitudes, node)[0] / step,
            by_joints[place] @ (joints - joints[:1]) / step,
        )
        for place, node in enumerate((0, len(times) - 1))
    ]


def _times(track: Track, count: int) -> Array:
    """Times (count,) s of nodes."""
    return track.begin + (track.end - track.begin) * jnp.linspace(0.0, 1.0, count)


def _seen(track: Track, attitudes: Array, times: Array) -> Array:
    """Directions (count, k, 3) of targets in body axes."""
    return jnp.stack([path.at(times) for path in track.paths], axis=1) @ attitudes


def _joints(track: Track, attitudes: Array, times: Array) -> Array:
    """Joints (count, J) rad with which devices point at their targets."""
    gimbals = track.craft.gimbals
    found = jnp.tile(jnp.asarray(track.joints), (len(times), 1))
    places = [place for place, number in enumerate(track.devices) if number < gimbals.count]
    if not places:
        return found
    numbers = np.array([track.devices[place] for place in places])
    seen = _seen(track, attitudes, times)[:, np.array(places)]
    azimuth, elevation = angles_along(jnp.asarray(gimbals.frames)[numbers], seen)
    yaws = gimbals.yaws[numbers]
    azimuth = jnp.unwrap(azimuth, axis=0)
    first = jax.lax.stop_gradient(track.angles[0, yaws] - azimuth[0])
    found = found.at[:, yaws].set(azimuth + TURN * jnp.round(first / TURN))
    lifting = numbers < gimbals.terminals
    return found.at[:, gimbals.pitches[numbers[lifting]]].set(elevation[:, lifting])


def _asked(track: Track, attitudes: Array, times: Array) -> Array:
    """What targets ask of attitudes, (count, m), see `Pursuit.residuals`."""
    gimbals, craft = track.craft.gimbals, track.craft
    seen, found = _seen(track, attitudes, times), [jnp.zeros((len(times), 0))]
    for place, number in enumerate(track.devices):
        if number >= gimbals.count:
            boresight = jnp.asarray(craft.fixed_boresights)[number - gimbals.count]
            first = jnp.cross(boresight, jnp.eye(3)[jnp.argmin(jnp.abs(boresight))])
            across = jnp.stack([first / length(first), jnp.cross(boresight, first / length(first))])
            found.append(seen[:, place] @ across.T)
        elif number >= gimbals.terminals:
            tilt = jnp.sin(jnp.atleast_1d(gimbals.tilts)[number - gimbals.terminals])
            found.append((seen[:, place] @ jnp.asarray(gimbals.frames)[number][:, 2] - tilt)[:, None])
    return jnp.concatenate(found, axis=1)


def _met(track: Track, attitudes: Array) -> Array:
    """Attitudes at which targets are met, by one step from where they nearly are."""
    times = _times(track, len(attitudes))
    for _ in range(2):
        value = _asked(track, attitudes, times)
        if not value.size:
            break

        def one(turn: Array, attitude: Array, time: Array) -> Array:
            return _asked(track, (attitude @ so3.exp(turn))[None], time[None])[0]

        slope = jax.vmap(jax.jacfwd(one))(jnp.zeros((len(times), 3)), attitudes, times)
        across = jnp.swapaxes(slope, 1, 2)
        step = across @ jnp.linalg.solve(slope @ across, value[..., None])
        attitudes = attitudes @ so3.exp(-step[..., 0])
    return attitudes


def _energy(track: Track, turns: Array, multipliers: Array, pushes: Array) -> Array:
    """Half the square of all residuals, the price of little room, and what is kept times its multipliers.

    Args:
        track: what it depends on.
        turns: (K + 1, 3) rad, of the nodes.
        multipliers: (K + 1, m), of what is asked.
        pushes: (a,), of the room that is just kept.
    """
    times = _times(track, len(turns))
    attitudes = track.attitudes @ so3.exp(turns)
    joints = _joints(track, attitudes, times)
    step, (rate, acceleration) = times[1] - times[0], track.weights
    turned = so3.log(jnp.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:])
    change = jnp.concatenate([turned, jnp.diff(joints, axis=0)], axis=1)
    away = so3.log(track.attitude.T @ attitudes[0])
    energy = rate / step * jnp.sum(change**2) + acceleration / step**3 * jnp.sum(
        jnp.diff(change, axis=0) ** 2
    )
    energy += rate / SLEW_TIME * (jnp.sum(away**2) + jnp.sum((joints[0] - track.joints) ** 2))
    low, high = jnp.asarray(track.craft.joint_ranges).T
    left, leaning = jnp.concatenate([joints - low, high - joints], axis=1), track.leaning
    price = jnp.sum(jnp.where(leaning.price > 0, leaning.price * left, 0.0))
    kept = pushes @ (left[leaning.node, leaning.row] - leaning.room)
    return energy / 2 - price + kept + jnp.sum(multipliers * _asked(track, attitudes, times))


def _gradient(track: Track, z: Array) -> Array:
    """The derivative of `_energy` by turns and multipliers, in one vector ``z``."""
    count, leant = len(track.attitudes), len(track.leaning.node)

    def energy(own: Array) -> Array:
        turns, more = own[: 3 * count].reshape(count, 3), own[3 * count : len(z) - leant]
        return _energy(track, turns, more.reshape(count, -1), own[len(z) - leant :])

    return jax.grad(energy)(z)


def _factors(track: Track, z: Array) -> Any:
    """The factors of the derivative of `_gradient`."""
    return jax.scipy.linalg.lu_factor(jax.jacfwd(partial(_gradient, track))(z))


_EQUATIONS = Equations(
    residual=_gradient, factor=_factors, solve=jax.scipy.linalg.lu_solve, steps=_STEPS, tolerance=1e-13
)


def _derivatives(attitudes: Array, node: int) -> tuple[Array, Array]:
    """First and second derivative (3,) of the turn at a node, by the number of the node."""
    own = curves.around(len(attitudes), node)
    turns = so3.log(attitudes[node].T @ attitudes[own])
    first, second = _around_slopes(len(turns), node - own.start)
    return first @ turns, second @ turns


@cache
def _around_slopes(count: int, node: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (count,) from values at nodes to the first two derivatives at one of them, by its number."""
    spline = curves.interpolated(np.arange(float(count)), np.eye(count))
    return np.asarray(spline(node, 1)), np.asarray(spline(node, 2))


def _finer(attitudes: Array, edges: tuple[int, ...]) -> Array:
    """Attitudes (2 K + 1, 3, 3) of the curve through K + 1 nodes, whose charts end at given ones."""
    found = []
    for first, last in pairwise(edges):
        own = so3.log(attitudes[first].T @ attitudes[first : last + 1])
        ends = []
        for place, node in ((0, first), (-1, last)):
            velocity, bend = _derivatives(attitudes, node)
            tangent = so3.right_jacobian(own[place])
            rate = jnp.linalg.solve(tangent, velocity)
            ends += [rate, jnp.linalg.solve(tangent, bend - so3.right_jacobian_rate(own[place], rate) @ rate)]
        between = _halfway(last - first) @ jnp.concatenate([own, jnp.stack(ends)])
        found.append(attitudes[first] @ so3.exp(between[:-1] if last < len(attitudes) - 1 else between))
    return jnp.concatenate(found)


@cache
def _halfway(count: int) -> np.ndarray:
    """Matrix (2 count + 1, count + 5) from values at nodes and derivatives at both ends to values between."""
    columns = np.eye(count + 5)
    times = np.arange(count + 1.0)
    values, ends = columns[: count + 1], columns[count + 1 :]
    spline = curves.interpolated(times, values, ((ends[0], ends[1]), (ends[2], ends[3])))
    return np.asarray(spline(np.linspace(0, count, 2 * count + 1)))


@cache
def _end_slopes(count: int) -> np.ndarray:
    """Matrix (2, count) from values at nodes to the derivatives at both ends, by the number of the node."""
    spline = curves.interpolated(np.arange(float(count)), np.eye(count))
    return np.asarray(spline(np.array([0.0, count - 1.0]), 1))


def track_of(motion: Motion, craft: Spacecraft, rows: Constraints, targets: Targets) -> Track:
    """What the motion of least energy of a plan depends on, as numbers.

    Raises:
        ValueError: if it leans on a constraint or a limit of rate, or is another kind of optimum.
    """
    tracked = motion.tracked
    assert tracked is not None
    nodes, wanted, curve = tracked.nodes, tracked.wanted, tracked.trajectory
    pursuit = Pursuit.of(craft, rows, targets)
    leaning, ranges = LeastMotion(pursuit, wanted).leaning(nodes), 2 * nodes.joints.shape[1]
    if leaning.rates or np.any(leaning.row >= ranges) or np.any(leaning.price[:, ranges:]):
        raise ValueError(
            "while devices follow targets it has just some room from a zone, or from a limit of rate"
        )
    if wanted.attitude is None or wanted.wishes:
        raise ValueError("a device has a wish; give it an attitude")
    edges, intervals = [], len(nodes.times) - 1
    count = len(curve.joint_breaks) - 1 + curves.DEGREE  # intervals and a node more
    while intervals + 1 < count:
        places = np.linspace(0.0, curve.duration, intervals + 1)
        edges.append(tuple(curves.chart_ends(curve.sample(places).attitude)))
        intervals *= 2
    return Track(
        craft=craft,
        paths=targets.paths,
        attitude=wanted.attitude,
        joints=wanted.joints,
        begin=float(nodes.times[0]),
        end=float(nodes.times[-1]),
        weights=np.array(wanted.weights),
        attitudes=nodes.attitudes,
        angles=nodes.joints,
        leaning=leaning._replace(price=leaning.price[:, :ranges], rates=False),
        devices=targets.numbers(craft),
        edges=tuple(edges),
    )
