"""A motion of least energy as a function of what it depends on: its ends' states, with derivatives.

The nodes found by `least_energy` are turned by ``R_k exp(x_k^)`` such that, with the equations ``c_k`` that
targets impose on the attitudes, and multipliers ``l_k``,

    d/dx (|r|^2 / 2 + sum of l_k . c_k) = 0,        c_k = 0

with the residuals ``r`` of rates, accelerations, the way there and wishes; joints that move for a wish or a
zone are among the unknowns. This is solved by Newton's method with second derivatives of everything, and
differentiated by the implicit function theorem. Held fixed are the number of nodes and the whole turns of
yaws, and also where nodes *lean*, which means keep just some room: to which ends of ranges, which rates are
at their bounds, and to which constraints, each by the pair of row and sight that decides on it. Each has a
multiplier.

From the nodes follow the states in which the motion begins and ends as its curve has them: with as many
nodes between, and rates by the nodes around each end (`jaxplan.timeline.curves`). Splines are linear in the
values that they pass through, so these are products with constant matrices.

Shapes: K + 1 nodes, J joints, f free joints, k devices with targets, m equations a node.
"""

from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan import so3
from jaxplan.geometry.vectors import length, separation
from jaxplan.model.constraints import (
    JOINTS,
    Constraints,
    axes_in_body,
    chosen_entries,
    joint_values,
    state_margins,
)
from jaxplan.model.directions import DirectionPath
from jaxplan.model.gimbals import TURN, angles_along
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.runtime.differentiation import Equations, implicit_root
from jaxplan.runtime.jit import quick_jit
from jaxplan.timeline import curves
from jaxplan.timeline.least_energy import Leaning, LeastMotion, Nodes, rate_bounds, wish_weight
from jaxplan.timeline.motions import SLEW_TIME, Motion
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.timeline.tracking import State

_NEWTON_STEPS = 4  # of Newton's method, which starts at the optimum of the plan


@jax.tree_util.register_dataclass
@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The quantities that a motion of least energy depends on; attitudes are body to inertial.

    Attributes:
        craft: the spacecraft.
        paths: (k) directions of the targets over time.
        attitude: (3, 3) of the state before; None where the motion need not begin near it.
        joints: (J,) rad, to which the first node is drawn; devices without a target keep them.
        begin: s.
        end: s.
        weights: (2,) of the squares of rate and acceleration.
        wishes: (w) directions that devices without a target prefer.
        attitudes: (K + 1, 3, 3) of nodes near the optimum.
        angles: (K + 1, J) rad, their joints.
        devices: indices of the devices with targets.
        free: indices of the f joints that move for a wish or a zone.
        wishing: (w) indices of the devices that have the wishes.
        leaning: to which ends of ranges nodes keep just some room: rows 0 to J low ends, then high ones.
        rows: the constraints; None where nodes have all the room to these that they want.
        pairs: (p, 3) node, row, sight of constraints to which nodes keep just some room.
        rooms: (p,) rad, how much.
        narrow: (n, 3) node, row, sight of constraints to which nodes have less room than they want.
        prices: (n,) 1/rad, of the room that is missing there.
        edges: for each time that nodes are doubled, the indices of those at which charts of the curve end.
    """

    craft: Spacecraft
    paths: tuple[DirectionPath, ...]
    attitude: Any
    joints: Any
    begin: Any
    end: Any
    weights: Any
    wishes: tuple[DirectionPath, ...]
    attitudes: Any
    angles: Any
    leaning: Leaning
    rows: Constraints | None
    pairs: np.ndarray
    rooms: np.ndarray
    narrow: np.ndarray
    prices: np.ndarray
    devices: tuple[int, ...] = field(metadata={"static": True})
    free: tuple[int, ...] = field(metadata={"static": True})
    wishing: tuple[int, ...] = field(metadata={"static": True})
    edges: tuple[tuple[int, ...], ...] = field(metadata={"static": True})


def ends_of(track: Track) -> tuple[State, State]:
    """Return the states in which a motion of least energy begins and ends, as arrays of JAX.

    Accelerations are set to zero, not computed. Numbers are NaN where the equations are singular.
    """
    first, last = (
        replace(State.still(attitude, joints), velocity=velocity, rates=rates)
        for attitude, joints, velocity, rates in _end_states(track)
    )
    return first, last


@quick_jit
def _end_states(track: Track) -> list[Any]:
    """Attitude, joints, angular velocity and joint rates at begin and end of a motion of least energy."""
    count, asked = len(track.attitudes), _misfits(track, track.attitudes, _times(track, len(track.attitudes)))
    moved = (3 + len(track.free)) * count
    guess = jnp.zeros(moved + asked.size + _kept_count(track))
    turns, freed = _split_unknowns(track, implicit_root(_OPTIMALITY, track, guess)[:moved])
    attitudes = track.attitudes @ so3.exp(turns)
    for edges in track.edges:
        attitudes = _meet_targets(track, _double_attitudes(attitudes, edges))
        freed = jnp.asarray(_doubling_matrix(len(freed))) @ freed
    times = _times(track, len(attitudes))
    joints = _pointing_joints(track, attitudes, times, freed)
    step, by_joints = times[1] - times[0], _end_derivative_matrix(len(times))
    return [
        (
            attitudes[node],
            joints[node],
            _turn_derivatives(attitudes, node)[0] / step,
            by_joints[place] @ (joints - joints[:1]) / step,
        )
        for place, node in enumerate((0, len(times) - 1))
    ]


def _kept_count(track: Track) -> int:
    """Number of ranges, rates and constraints to which nodes keep just some room."""
    return len(track.leaning.node) + len(track.leaning.rate) + len(track.rooms)


def _split_unknowns(track: Track, moved: Array) -> tuple[Array, Array]:
    """Turns (K + 1, 3) rad of nodes and their free joints (K + 1, f) rad, from a vector of unknowns."""
    count = len(track.attitudes)
    turns, shifts = moved[: 3 * count].reshape(count, 3), moved[3 * count :].reshape(count, len(track.free))
    return turns, track.angles[:, np.array(track.free, int)] + shifts


def _times(track: Track, count: int) -> Array:
    """Times (count,), s, of `count` equidistant nodes."""
    return track.begin + (track.end - track.begin) * jnp.linspace(0.0, 1.0, count)


def _targets_in_body(track: Track, attitudes: Array, times: Array) -> Array:
    """Directions of targets in body axes, (count, k, 3)."""
    if not track.paths:
        return jnp.zeros((len(times), 0, 3))
    return jnp.stack([path.at(times) for path in track.paths], axis=1) @ attitudes


def _pointing_joints(track: Track, attitudes: Array, times: Array, freed: Array) -> Array:
    """Joints (count, J) rad with which devices point at their targets; `freed` (count, f) are free ones."""
    gimbals = track.craft.gimbals
    found = jnp.tile(jnp.asarray(track.joints), (len(times), 1)).at[:, np.array(track.free, int)].set(freed)
    places = [place for place, number in enumerate(track.devices) if number < gimbals.count]
    if not places:
        return found
    numbers = np.array([track.devices[place] for place in places])
    seen = _targets_in_body(track, attitudes, times)[:, np.array(places)]
    azimuth, elevation = angles_along(jnp.asarray(gimbals.frames)[numbers], seen)
    yaws = gimbals.yaws[numbers]
    azimuth = jnp.unwrap(azimuth, axis=0)
    first = jax.lax.stop_gradient(track.angles[0, yaws] - azimuth[0])
    found = found.at[:, yaws].set(azimuth + TURN * jnp.round(first / TURN))
    lifting = numbers < gimbals.terminals
    return found.at[:, gimbals.pitches[numbers[lifting]]].set(elevation[:, lifting])


def _misfits(track: Track, attitudes: Array, times: Array) -> Array:
    """Values (count, m) of the equations that targets impose on attitudes, see `Pursuit.residuals`."""
    gimbals, craft = track.craft.gimbals, track.craft
    seen, found = _targets_in_body(track, attitudes, times), [jnp.zeros((len(times), 0))]
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


def _meet_targets(track: Track, attitudes: Array) -> Array:
    """Attitudes (count, 3, 3) at which targets are met, by two Newton steps from where they nearly are."""
    times = _times(track, len(attitudes))
    for _ in range(2):
        value = _misfits(track, attitudes, times)
        if not value.size:
            break

        def one(turn: Array, attitude: Array, time: Array) -> Array:
            return _misfits(track, (attitude @ so3.exp(turn))[None], time[None])[0]

        slope = jax.vmap(jax.jacfwd(one))(jnp.zeros((len(times), 3)), attitudes, times)
        across = jnp.swapaxes(slope, 1, 2)
        step = across @ jnp.linalg.solve(slope @ across, value[..., None])
        attitudes = attitudes @ so3.exp(-step[..., 0])
    return attitudes


def _lagrangian(track: Track, turns: Array, freed: Array, multipliers: Array, pushes: Array) -> Array:
    """Lagrangian of the problem: energy, price of missing room, and constraints times their multipliers.

    Args:
        track: what it depends on.
        turns: (K + 1, 3) rad, of the nodes.
        freed: (K + 1, f) rad, their free joints.
        multipliers: (K + 1, m), of the targets' equations.
        pushes: (a,), multipliers of the room that is just kept.
    """
    times = _times(track, len(turns))
    attitudes = track.attitudes @ so3.exp(turns)
    joints = _pointing_joints(track, attitudes, times, freed)
    step, (rate, acceleration) = times[1] - times[0], track.weights
    turned = so3.log(jnp.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:])
    change = jnp.concatenate([turned, jnp.diff(joints, axis=0)], axis=1)
    energy = rate / step * jnp.sum(change**2) + acceleration / step**3 * jnp.sum(
        jnp.diff(change, axis=0) ** 2
    )
    if track.attitude is not None:
        away = so3.log(track.attitude.T @ attitudes[0])
        energy += rate / SLEW_TIME * (jnp.sum(away**2) + jnp.sum((joints[0] - track.joints) ** 2))
    energy += wish_weight(rate, step) * _wish_misses(track, attitudes, joints, times)
    low, high = jnp.asarray(track.craft.joint_ranges).T
    left, leaning = jnp.concatenate([joints - low, high - joints], axis=1), track.leaning
    price = jnp.sum(jnp.where(leaning.price > 0, leaning.price * left, 0.0))
    kept = left[leaning.node, leaning.row] - leaning.room
    if len(leaning.rate):
        kept = jnp.concatenate([kept, _rate_room(track, turned, change, step)])
    if track.rows is not None:
        price += track.prices @ _margins(track, track.rows, attitudes, joints, track.narrow)
        near = _margins(track, track.rows, attitudes, joints, track.pairs) - track.rooms
        kept = jnp.concatenate([kept, near])
    return energy / 2 - price + pushes @ kept + jnp.sum(multipliers * _misfits(track, attitudes, times))


def _rate_room(track: Track, turned: Array, change: Array, step: Array) -> Array:
    """Room (r,) rad that is left to the r changes between nodes that are at their bounds.

    Args:
        track: with the rates that are at their bounds, in `leaning`.
        turned: (K, 3) rad, turns from node to node.
        change: (K, 3 + J) rad, the same and the changes of joints.
        step: s, between nodes.
    """
    interval, rate = jnp.asarray(track.leaning.rate).reshape(-1, 2).T
    own = turned[interval]
    square = jnp.sum(own**2, axis=1)
    whole = jnp.sqrt(jnp.where(square > 0, square, 1.0))  # no derivative of the root at zero
    each = jnp.concatenate([change[interval, 3:], own, whole[:, None]], axis=1)
    bounds = step * rate_bounds(track.craft)[rate]
    return bounds - jnp.abs(each[jnp.arange(len(rate)), rate])


def _margins(track: Track, rows: Constraints, attitudes: Array, joints: Array, pairs: np.ndarray) -> Array:
    """Margins (p,) rad of pairs (p, 3) of constraints: indices of node, row and sight."""
    node, row, sight = jnp.asarray(pairs).reshape(-1, 3).T
    each, gimbals = jnp.arange(len(node)), track.craft.gimbals
    sights = rows.sights(gimbals, jnp.asarray(track.craft.fixed_boresights))
    seen = sights.in_body(joints[node])
    inertial = rows.axes(_times(track, len(attitudes))[node]) @ attitudes[node]
    axes = axes_in_body(rows, inertial, seen)[each, row]
    off = separation(seen[each, sight], axes) - jnp.asarray(rows.half_angle)[row]
    margins = jnp.asarray(rows.side)[row] * off
    if rows.inner:
        values = joint_values(rows, gimbals, joints[node])[each, sight, row]
        of_joints = jnp.asarray(rows.frame)[row] == JOINTS
        margins = jnp.where(of_joints, values - jnp.asarray(rows.half_angle)[row], margins)
    return margins


def _wish_misses(track: Track, attitudes: Array, joints: Array, times: Array) -> Any:
    """Sum of the squared chords between where devices with wishes look and what they prefer."""
    gimbals, missed = track.craft.gimbals, jnp.asarray(0.0)
    for device, path in zip(track.wishing, track.wishes, strict=True):
        if device < gimbals.count:
            beams = gimbals.boresights(joints)[:, device]
        else:
            beams = jnp.asarray(track.craft.fixed_boresights)[device - gimbals.count]
        seen = (path.at(times)[:, None] @ attitudes)[:, 0]
        missed += jnp.sum((beams - seen) ** 2)
    return missed


def _gradient(track: Track, z: Array) -> Array:
    """Derivative of `_lagrangian` by the vector ``z`` of turns, free joints and multipliers."""
    count, leant = len(track.attitudes), _kept_count(track)
    moved = (3 + len(track.free)) * count

    def energy(own: Array) -> Array:
        turns, freed = _split_unknowns(track, own[:moved])
        more = own[moved : len(z) - leant].reshape(count, -1)
        return _lagrangian(track, turns, freed, more, own[len(z) - leant :])

    return jax.grad(energy)(z)


def _linearised(track: Track, z: Array) -> tuple[Array, Any]:
    """`_gradient` at ``z``, and the LU factors of its derivative."""

    def gradient(z: Array) -> tuple[Array, Array]:
        found = _gradient(track, z)
        return found, found

    found: Any = jax.jacfwd(gradient, has_aux=True)(z)
    matrix, value = found
    return value, jax.scipy.linalg.lu_factor(matrix)


_OPTIMALITY = Equations(
    residual=_gradient,
    linearise=_linearised,
    solve=jax.scipy.linalg.lu_solve,
    steps=_NEWTON_STEPS,
    tolerance=1e-13,
)


def _turn_derivatives(attitudes: Array, node: int) -> tuple[Array, Array]:
    """First and second derivative (3,) of body-axis turns at a node, per interval between nodes."""
    own = curves.around(len(attitudes), node)
    turns = so3.log(attitudes[node].T @ attitudes[own])
    first, second = _derivative_weights(len(turns), node - own.start)
    return first @ turns, second @ turns


@cache
def _derivative_weights(count: int, node: int) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (count,) from values at nodes to their first two derivatives at one, per interval."""
    spline = curves.interpolated(np.arange(float(count)), np.eye(count))
    return np.asarray(spline(node, 1)), np.asarray(spline(node, 2))


def _double_attitudes(attitudes: Array, edges: tuple[int, ...]) -> Array:
    """Attitudes (2 K + 1, 3, 3) of the curve through K + 1 nodes, whose charts end at nodes `edges`."""
    found = []
    for first, last in pairwise(edges):
        own = so3.log(attitudes[first].T @ attitudes[first : last + 1])
        ends = []
        for place, node in ((0, first), (-1, last)):
            velocity, bend = _turn_derivatives(attitudes, node)
            tangent = so3.right_jacobian(own[place])
            rate = jnp.linalg.solve(tangent, velocity)
            ends += [rate, jnp.linalg.solve(tangent, bend - so3.right_jacobian_rate(own[place], rate) @ rate)]
        between = _chart_doubling_matrix(last - first) @ jnp.concatenate([own, jnp.stack(ends)])
        found.append(attitudes[first] @ so3.exp(between[:-1] if last < len(attitudes) - 1 else between))
    return jnp.concatenate(found)


@cache
def _chart_doubling_matrix(count: int) -> np.ndarray:
    """Matrix (2 count + 1, count + 5) from values at nodes, and derivatives at both ends, to finer values."""
    columns = np.eye(count + 5)
    times = np.arange(count + 1.0)
    values, ends = columns[: count + 1], columns[count + 1 :]
    spline = curves.interpolated(times, values, ((ends[0], ends[1]), (ends[2], ends[3])))
    return np.asarray(spline(np.linspace(0, count, 2 * count + 1)))


@cache
def _doubling_matrix(count: int) -> np.ndarray:
    """Matrix (2 count - 1, count) from values at nodes to values at nodes twice as close."""
    spline = curves.interpolated(np.arange(float(count)), np.eye(count))
    return np.asarray(spline(np.linspace(0.0, count - 1.0, 2 * count - 1)))


@cache
def _end_derivative_matrix(count: int) -> np.ndarray:
    """Matrix (2, count) from values at nodes to the derivatives at both ends, per interval."""
    spline = curves.interpolated(np.arange(float(count)), np.eye(count))
    return np.asarray(spline(np.array([0.0, count - 1.0]), 1))


def track_of(motion: Motion, craft: Spacecraft, rows: Constraints, targets: Targets | None) -> Track:
    """Gather what a motion of least energy depends on; without targets, it is one that gives way to zones.

    Raises:
        ValueError: if a rate exceeds what nodes should use.
    """
    tracked = motion.tracked
    assert tracked is not None
    nodes, wanted, curve = tracked.nodes, tracked.wanted, tracked.trajectory
    pursuit = Pursuit.of(craft, rows, targets)
    leaning, ranges = LeastMotion(pursuit, wanted).leaning(nodes), 2 * nodes.joints.shape[1]
    if leaning.too_fast:
        raise ValueError("while devices follow targets a rate is nearly beyond its limit: raise that limit")
    near, narrow = leaning.row >= ranges, np.argwhere(leaning.price[:, ranges:] > 0)
    pairs = _deciding_pairs(pursuit, nodes, np.stack([leaning.node, leaning.row - ranges], axis=1)[near])
    leant = bool(np.any(near)) or len(narrow) > 0
    edges, intervals = [], len(nodes.times) - 1
    count = len(curve.joint_breaks) - 1 + curves.DEGREE  # intervals and a node more
    while intervals + 1 < count:
        places = np.linspace(0.0, curve.duration, intervals + 1)
        edges.append(tuple(curves.chart_ends(curve.sample(places).attitude)))
        intervals *= 2
    return Track(
        craft=craft,
        paths=pursuit.paths,
        attitude=wanted.attitude,
        joints=wanted.joints,
        begin=float(nodes.times[0]),
        end=float(nodes.times[-1]),
        weights=np.array(wanted.weights),
        wishes=tuple(path for _, path in wanted.wishes),
        attitudes=nodes.attitudes,
        angles=nodes.joints,
        leaning=Leaning(
            node=leaning.node[~near],
            row=leaning.row[~near],
            room=leaning.room[~near],
            price=leaning.price[:, :ranges],
            rate=leaning.rate,
            too_fast=False,
        ),
        rows=rows if leant else None,
        pairs=pairs,
        rooms=leaning.room[near],
        narrow=_deciding_pairs(pursuit, nodes, narrow),
        prices=leaning.price[:, ranges:][tuple(narrow.T)],
        devices=pursuit.devices,
        free=tracked.free,
        wishing=tuple(device for device, _ in wanted.wishes),
        edges=tuple(edges),
    )


def _deciding_pairs(pursuit: Pursuit, nodes: Nodes, places: np.ndarray) -> np.ndarray:
    """Return the (node, row, sight), (p, 3), that decide on margins of `Pursuit.margins`.

    Args:
        pursuit: with the constraints.
        nodes: of the motion.
        places: (p, 2), indices of nodes and of these margins.
    """
    rows = pursuit.rows
    row, sight = np.nonzero(rows.bound & rows.single[:, None])
    groups = np.flatnonzero((rows.group == np.arange(len(rows.group))) & ~rows.single)
    found = []
    for node, place in places.tolist():
        if place < len(row):
            found.append((node, row[place], sight[place]))
            continue
        still = rows.at(nodes.times[node])
        table = state_margins(still, pursuit.sights, nodes.attitudes[node], nodes.joints[node])
        worst = np.min(table, axis=-1)
        group = groups[place - len(row)]
        entry = chosen_entries(rows, worst)[group]
        own = int(np.argmin(np.where((rows.group == group) & (rows.entry == entry), worst, np.inf)))
        found.append((node, own, int(np.argmin(table[own]))))
    return np.array(found, int).reshape(-1, 3)
