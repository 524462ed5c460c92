"""The motion of least energy with which devices follow their targets, as attitudes and joints at nodes.

What targets leave free, that is the platform's attitude or a part of it and the joints of free devices, is
chosen at K + 1 equidistant instants so that the energy of all motion is least: squares of rates and
accelerations of platform and joints, by the weights of the fit, with rates from differences between nodes.
Added are how far the first node is from the state that the spacecraft comes from, over the time of the slew,
how far the last nodes are from where the next slew leads (`looking_ahead`), and how far devices are from what
they prefer. Ranges, rates and constraints are kept at the nodes with some room; accelerations, and what holds
in between, are left to the certificate.

The method is Gauss-Newton: about the nodes so far the residuals are linear in small turns ``R exp(z^)`` and
changes of free joints. In each step targets are met exactly (`Pursuit.meeting`), and steps lie in the null
space of their equations. A step that breaks nothing solves a linear system; else it solves a quadratic
program, in which what cannot be kept may be broken at a price.

Shapes: K + 1 nodes, J joints, f free joints, c ranges (low ends of all joints, then high ends) and
constraints, y unknowns of a node. Attitudes are body to inertial.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from jaxplan import so3
from jaxplan.geometry.vectors import AnyArray, array_module, arrays
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.limits import longest
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.timeline.elastic_qp import priced_step
from jaxplan.timeline.pursuit import Pursuit

_MAX_STEPS = 12  # most steps; some four are usual
_MAX_OPTIMAL_STEPS = 60  # likewise where the optimum is asked for
_GAIN_TOLERANCE = 5e-3  # fraction of the energy; a step that gains no more is the last
_STEP_TOLERANCE = 1e-6  # rad; so is one that changes nothing by more
_MAX_POLISH_STEPS, _POLISH_TOLERANCE = 60, 1e-12  # most further steps, and rad, size of the last
_DIFFERENCE_STEP = 1e-6  # rad, step of finite differences
_TRUST_RADIUS = 0.5  # rad, most by which a step moves any device
_RELEVANT_MARGIN = 1.2  # rad; constraints with larger margins do not matter to a step
_HARD_ROOM = np.deg2rad(0.05)  # rad, room of nodes to constraints and ends of ranges, for what is between
_SOFT_ROOM = np.deg2rad(1.0)  # rad, room that they keep where it costs little, for slews at both ends
_RATE_SHARE = 0.9  # fraction of limits of rate that nodes may use
_HARD_PRICE = 1e3  # 1/rad, price of what a node lacks of the room `_HARD_ROOM`, beside the energy
_SOFT_PRICE = 1.0  # 1/rad, price of what it lacks of the room `_SOFT_ROOM`
_WISH_WEIGHT = 0.1  # 1/s, weight of the square of the angle to what a device prefers, per rate weight
_MIN_RATE_WEIGHT = 1e-3  # least rate weight in that product
_ROOM_TOLERANCE = 3e-9  # rad, within which a node counts as keeping just some room
_DRAWN_NODES = 2  # last nodes that are drawn ahead, so that the motion has slowed down when it is there
_REGULARIZATION = 1e-9  # weight on the size of a step, so that what costs nothing does not change


@dataclass(frozen=True, kw_only=True, eq=False)
class Wanted:
    """What a motion shall be near, beside its targets.

    Attributes:
        attitude: (3, 3) of the state that the spacecraft comes from; None for none.
        joints: (J,) rad, joints at the beginning after the least turn of the platform from there. To these,
            not to those before, the first node is drawn: joints are quick, and the platform is to turn less.
            Devices without a target have them all along.
        slew_time: s, how long the slew from there takes, roughly.
        ahead: (3, 3) attitude to which the last two nodes are drawn; None for none.
        ahead_time: s, the time T of that term; the shorter, the nearer they come to it.
        held: number of the first nodes that stay as in the first guess.
        wishes: (device, direction that it prefers), for devices without a target by index.
        weights: of the squares of rate and of acceleration.
        optimal: whether steps go on until the energy is least to rounding, so that the nodes are a function
            of what they depend on.
    """

    attitude: np.ndarray | None
    joints: np.ndarray
    slew_time: float
    ahead: np.ndarray | None = None
    ahead_time: float = np.inf
    held: int = 0
    wishes: tuple[tuple[int, DirectionPath], ...] = ()
    weights: tuple[float, float] = (1.0, 3.0)
    optimal: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """States of a motion at K + 1 instants.

    Attributes:
        times: (K + 1,) s.
        attitudes: (K + 1, 3, 3) body to inertial.
        joints: (K + 1, J) rad.
    """

    times: np.ndarray
    attitudes: np.ndarray
    joints: np.ndarray


class Leaning(NamedTuple):
    """What nodes of least energy lean on: ranges, constraints and rates of which they keep just some room.

    Attributes:
        node: (a,) indices of nodes that keep just some room from something.
        row: (a,) index of the range or constraint, below c, from which they keep it.
        room: (a,) rad, how much room.
        price: (K + 1, c) 1/rad, price of room that is missing; 0 where there is enough.
        rate: (r, 2) for each rate at its bound the indices of interval and rate, as in `rate_bounds`.
        too_fast: whether a rate exceeds its bound.
    """

    node: np.ndarray
    row: np.ndarray
    room: np.ndarray
    price: np.ndarray
    rate: np.ndarray
    too_fast: bool


class LeastMotion:
    """The search for the nodes of least energy.

    Args:
        pursuit: what must point where, and the constraints.
        wanted: what the motion shall be near.
        free: indices of the f joints that are chosen, too.
    """

    def __init__(self, pursuit: Pursuit, wanted: Wanted, free: Sequence[int] = ()) -> None:
        self.pursuit, self.wanted = pursuit, wanted
        self.free = np.array(free, int)

    def solve(self, times: np.ndarray, attitudes: np.ndarray, rest: np.ndarray) -> Nodes:
        """Find the nodes of a motion of least energy by Gauss-Newton steps from a first guess.

        Args:
            times: (K + 1,) s, equidistant, at least three.
            attitudes: (K + 1, 3, 3) body to inertial, the first guess.
            rest: (J,) or (K + 1, J) rad, joints of devices without a target.

        Returns:
            The nodes after the last step; the certificate tells whether they break something.
        """
        nodes = self.first(times, attitudes, rest)
        price = self.price(nodes)
        optimal = self.wanted.optimal
        for _ in range(_MAX_OPTIMAL_STEPS if optimal else _MAX_STEPS):
            step = self._solve_step(nodes)
            for share in (1.0, 0.5, 0.25, 0.1):
                tried = self._apply_step(nodes, share * step)
                found = self.price(tried)
                if found <= price:
                    break
            else:
                break
            gained, nodes, price = price - found, tried, found
            settled = not optimal and gained <= _GAIN_TOLERANCE * price
            if settled or np.max(np.abs(share * step), initial=0.0) <= _STEP_TOLERANCE:
                break
        return self._polish(nodes) if optimal else nodes

    def _polish(self, nodes: Nodes) -> Nodes:
        """Take whole steps for as long as they get shorter, to more digits than the price can tell."""
        last = np.inf
        for _ in range(_MAX_POLISH_STEPS):
            step = self._solve_step(nodes)
            size = float(np.max(np.abs(step), initial=0.0))
            if not size < last:
                break
            nodes, last = self._apply_step(nodes, step), size
            if size <= _POLISH_TOLERANCE:
                break
        return nodes

    def first(self, times: np.ndarray, attitudes: np.ndarray, rest: np.ndarray) -> Nodes:
        """Return the nodes of a first guess, changed so that targets are met; arguments as of `solve`."""
        return self._meet_targets(times, attitudes, np.broadcast_to(rest, (len(times), np.shape(rest)[-1])))

    def broken(self, nodes: Nodes) -> np.ndarray:
        """How far each node (K + 1,) violates its worst range or constraint, rad; zero if it keeps all."""
        return np.maximum(0, np.max(-self._room(nodes), axis=1, initial=0.0))

    def depth(self, nodes: Nodes) -> float:
        """How far the worst node violates its worst range or constraint, rad; negative if all are kept."""
        return float(np.max(-self._room(nodes), initial=-np.inf))

    def leaning(self, nodes: Nodes) -> Leaning:
        """Find the ranges, constraints and rates of which the given nodes keep just some room."""
        left = self._room(nodes)
        levels = [
            (np.argwhere(np.abs(left - level) <= _ROOM_TOLERANCE), level)
            for level in (_HARD_ROOM, _SOFT_ROOM)
        ]
        rows = np.concatenate([found for found, _ in levels])
        turned = self._turns(nodes)
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        changes = np.concatenate([np.diff(nodes.joints, axis=0), turned, length], axis=1)
        spare = (nodes.times[1] - nodes.times[0]) * rate_bounds(self.pursuit.craft) - np.abs(changes)
        return Leaning(
            node=rows[:, 0],
            row=rows[:, 1],
            room=np.concatenate([np.full(len(found), level) for found, level in levels]),
            price=_SOFT_PRICE * (left < _SOFT_ROOM - _ROOM_TOLERANCE)
            + _HARD_PRICE * (left < _HARD_ROOM - _ROOM_TOLERANCE),
            rate=np.argwhere(np.abs(spare) <= _ROOM_TOLERANCE),
            too_fast=bool(np.any(spare < -_ROOM_TOLERANCE)),
        )

    def _meet_targets(self, times: np.ndarray, attitudes: np.ndarray, rest: np.ndarray) -> Nodes:
        """Return nodes whose attitudes, near given ones, allow to meet targets, with the joints for that."""
        met = self.pursuit.meeting(attitudes, times)
        joints = self.pursuit.unwrapped(self.pursuit.joints(met, times, rest))
        return Nodes(times=times, attitudes=met, joints=joints)

    def _apply_step(self, nodes: Nodes, step: np.ndarray) -> Nodes:
        """Return nodes after a step (K + 1, 3 + f) rad: body-axis turns, and changes of free joints."""
        rest = nodes.joints.copy()
        rest[:, self.free] += step[:, 3:]
        return self._meet_targets(nodes.times, nodes.attitudes @ so3.exp(step[:, :3]), rest)

    def _room(self, nodes: Nodes) -> np.ndarray:
        """Room (K + 1, c), rad, to low ends of ranges, high ends and constraints; negative where violated."""
        low, high = self.pursuit.craft.joint_ranges.T
        margins = self.pursuit.margins(nodes.attitudes, nodes.joints, nodes.times)
        return np.concatenate([nodes.joints - low, high - nodes.joints, margins], axis=1)

    def price(self, nodes: Nodes) -> float:
        """Energy of nodes, plus the price of what they violate and of too little room."""
        residual = self._residuals(nodes)
        left = self._room(nodes)
        broken = np.sum(np.maximum(0, _HARD_ROOM - left)) + np.sum(np.maximum(0, self._rate_excesses(nodes)))
        narrow = np.sum(np.maximum(0, _SOFT_ROOM - left))
        return float(residual @ residual / 2 + _HARD_PRICE * broken + _SOFT_PRICE * narrow)

    def _rate_excesses(self, nodes: Nodes) -> np.ndarray:
        """Angles between nodes less those that rate limits allow, rad: of joints, then of the platform."""
        craft, step = self.pursuit.craft, nodes.times[1] - nodes.times[0]
        joints = np.abs(np.diff(nodes.joints, axis=0)) - step * craft.joint_rate_limits
        turned = np.linalg.norm(self._turns(nodes), axis=1) - step * longest(craft, 1)
        return np.concatenate([joints.ravel(), turned])

    @staticmethod
    def _turns(nodes: Nodes) -> np.ndarray:
        """Rotation vectors (K, 3) rad from each node to the next, in the body axes of the former."""
        relative = np.swapaxes(nodes.attitudes[:-1], 1, 2) @ nodes.attitudes[1:]
        return np.asarray(so3.log(relative))

    def _joint_slopes(self, nodes: Nodes) -> np.ndarray:
        """Derivatives (K + 1, J, 3 + f) of joints by turns and free joints, while targets stay met."""
        slopes = np.zeros((*nodes.joints.shape, 3 + len(self.free)))
        for axis in range(3):
            turn = _DIFFERENCE_STEP * np.eye(3)[axis]
            after = self.pursuit.joints(nodes.attitudes @ so3.exp(turn), nodes.times, nodes.joints)
            before, wide = nodes.joints, _DIFFERENCE_STEP
            if self.wanted.optimal:  # one-sided differences would be off by too much
                before = self.pursuit.joints(nodes.attitudes @ so3.exp(-turn), nodes.times, nodes.joints)
                wide = 2 * _DIFFERENCE_STEP
            change = after - before
            slopes[..., axis] = (change - 2 * np.pi * np.round(change / (2 * np.pi))) / wide
        slopes[:, self.free, 3 + np.arange(len(self.free))] = 1.0
        return slopes

    def _residuals(self, nodes: Nodes) -> np.ndarray:
        """Residuals (r,), half whose square is the energy: rates, accelerations, first node, last, wishes."""
        by_rate, by_acceleration, by_way, by_ahead, by_wish = self._root_weights(nodes)
        change = np.concatenate([self._turns(nodes), np.diff(nodes.joints, axis=0)], axis=1)
        found = [by_rate * change.ravel(), by_acceleration * np.diff(change, axis=0).ravel()]
        if self.wanted.attitude is not None:
            away = so3.log(self.wanted.attitude.T @ nodes.attitudes[0])
            found.append(by_way * np.concatenate([away, nodes.joints[0] - self.wanted.joints]))
        if self.wanted.ahead is not None:
            found.append(by_ahead * so3.log(self.wanted.ahead.T @ nodes.attitudes[-_DRAWN_NODES:]).ravel())
        found += [by_wish * self._wish_misses(nodes, *wish).ravel() for wish in self.wanted.wishes]
        return np.concatenate(found)

    def _residual_slopes(self, nodes: Nodes, slopes: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        """Derivatives (r, K + 1, 3 + f) of the residuals, from `_joint_slopes` and `_change_slopes`."""
        count, size = len(nodes.times), slopes.shape[2]
        by_rate, by_acceleration, by_way, by_ahead, by_wish = self._root_weights(nodes)
        found = [by_rate * ahead, by_acceleration * np.diff(ahead, axis=0)]
        if self.wanted.attitude is not None:
            row = np.zeros((3 + nodes.joints.shape[1], count, size))
            row[:3, 0, :3] = np.eye(3)
            row[3:, 0] = slopes[0]
            found.append(by_way * row)
        if self.wanted.ahead is not None:
            row = np.zeros((_DRAWN_NODES, 3, count, size))
            last = np.arange(_DRAWN_NODES)
            row[last, :, last - _DRAWN_NODES, :3] = np.eye(3)
            found.append(by_ahead * row)
        every = np.arange(count)
        for wish in self.wanted.wishes:
            row = np.zeros((count, 3, count, size))
            row[every, :, every] = self._wish_miss_slopes(nodes, *wish)
            found.append(by_wish * row)
        return np.concatenate([own.reshape(-1, count, size) for own in found])

    def _root_weights(self, nodes: Nodes) -> tuple[float, float, float, float, float]:
        """Square roots of the weights of rates, accelerations, first node, last nodes, and wishes."""
        step, (rate, acceleration) = nodes.times[1] - nodes.times[0], self.wanted.weights
        each = (
            rate / step,
            acceleration / step**3,
            rate / self.wanted.slew_time,
            max(rate, _MIN_RATE_WEIGHT) / self.wanted.ahead_time,
            float(wish_weight(rate, step)),
        )
        return tuple(np.sqrt(each).tolist())

    def _change_slopes(self, nodes: Nodes, slopes: np.ndarray) -> np.ndarray:
        """Derivatives (K, 3 + J, K + 1, 3 + f) of changes between nodes; `slopes` as of `_joint_slopes`."""
        count, size = len(nodes.times), slopes.shape[2]
        found = np.zeros((count - 1, 3 + nodes.joints.shape[1], count, size))
        every = np.arange(count - 1)
        found[every, :3, every + 1, :3] = np.eye(3)
        found[every, :3, every, :3] = -np.swapaxes(so3.exp(self._turns(nodes)), 1, 2)
        if self.wanted.optimal:  # else what a turn that is small does to the derivative is left out
            own = np.linalg.inv(so3.right_jacobian(self._turns(nodes)))
            found[:, :3] = np.einsum("kij,kjnd->kind", own, found[:, :3])
        found[every, 3:, every + 1] = slopes[1:]
        found[every, 3:, every] = -slopes[:-1]
        return found

    def _wish_misses(self, nodes: Nodes, device: int, path: DirectionPath) -> np.ndarray:
        """How far a device's beam is off a direction in body axes, ``u - R^T e``, (K + 1, 3)."""
        return self._beams_in_body(nodes.joints, device) - self._direction_in_body(nodes, path)

    def _wish_miss_slopes(self, nodes: Nodes, device: int, path: DirectionPath) -> np.ndarray:
        """Derivatives (K + 1, 3, 3 + f) of `_wish_misses` by turns and free joints."""
        seen = self._beams_in_body(nodes.joints, device)
        slope = np.zeros((len(seen), 3, 3 + len(self.free)))
        slope[:, :, :3] = -so3.hat(self._direction_in_body(nodes, path))  # R^T e after a turn z: s + s x z
        for place, joint in enumerate(self.free):
            moved = nodes.joints.copy()
            moved[:, joint] += _DIFFERENCE_STEP
            slope[:, :, 3 + place] = (self._beams_in_body(moved, device) - seen) / _DIFFERENCE_STEP
        return slope

    @staticmethod
    def _direction_in_body(nodes: Nodes, path: DirectionPath) -> np.ndarray:
        """Return an inertial direction, which may move, at the K + 1 nodes, as (K + 1, 3) in body axes."""
        return (np.asarray(as_path(path).at(nodes.times))[:, None] @ nodes.attitudes)[:, 0]

    def _beams_in_body(self, joints: np.ndarray, device: int) -> np.ndarray:
        """Return boresights (K + 1, 3) of a device at joints (K + 1, J), as unit vectors in body axes."""
        gimbals = self.pursuit.craft.gimbals
        if device >= gimbals.count:
            fixed = self.pursuit.craft.fixed_boresights[device - gimbals.count]
            return np.broadcast_to(fixed, (len(joints), 3))
        return np.asarray(gimbals.boresights(joints))[:, device]

    def _solve_step(self, nodes: Nodes) -> np.ndarray:
        """The step (K + 1, 3 + f), rad, of least energy to first order that keeps what can be kept."""
        slopes = self._joint_slopes(nodes)
        ahead = self._change_slopes(nodes, slopes)
        residual, rows = self._residuals(nodes), self._residual_slopes(nodes, slopes, ahead)
        basis = self._null_space_basis(nodes, slopes.shape[2])  # (K + 1, 3 + f, y)
        reduced = np.einsum("rkd,kdy->rky", rows, basis)
        reduced = reduced.reshape(len(residual), basis.shape[0] * basis.shape[2])
        hessian = reduced.T @ reduced + _REGULARIZATION * np.eye(reduced.shape[1])
        pull = reduced.T @ residual
        if not len(pull):
            return np.zeros((len(nodes.times), slopes.shape[2]))
        found = priced_step(hessian, pull, *self._step_constraints(nodes, slopes, ahead, basis))
        step = np.einsum("kdy,ky->kd", basis, found.reshape(basis.shape[0], basis.shape[2]))
        moved = np.linalg.norm(step[:, :3], axis=1) + np.max(np.abs(step[:, 3:]), axis=1, initial=0.0)
        return np.asarray(step * min(1.0, _TRUST_RADIUS / max(float(np.max(moved)), 1e-300)))

    def _null_space_basis(self, nodes: Nodes, size: int) -> np.ndarray:
        """Basis (K + 1, 3 + f, y) of steps that keep targets met: orthonormal, zero for held nodes."""
        count = len(nodes.times)
        if not self.pursuit.equations:
            basis = np.tile(np.eye(size), (count, 1, 1))
        else:
            _, slope = self.pursuit.residuals(nodes.attitudes, nodes.times)
            _, sizes, turns = np.linalg.svd(slope)
            rank = int(np.max(np.sum(sizes > 1e-6, axis=1)))
            own = 3 - rank
            basis = np.zeros((count, size, own + size - 3))
            basis[:, :3, :own] = np.swapaxes(turns[:, rank:], 1, 2)
            basis[:, 3:, own:] = np.eye(size - 3)
        basis[: self.wanted.held] = 0.0
        return basis

    def _step_constraints(
        self, nodes: Nodes, slopes: np.ndarray, ahead: np.ndarray, basis: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ``B x + s >= 0`` that a step ``x`` in the basis shall keep, and the price of each row.

        B is (b, (K + 1) y), s (b,) rad, and prices are (b,) 1/rad.
        """
        count, size = len(nodes.times), slopes.shape[2]
        craft, left = self.pursuit.craft, self._room(nodes)
        slope = np.concatenate([slopes, -slopes, self._margin_slopes(nodes, left, slopes)], axis=1)
        node, row = np.nonzero(left < _RELEVANT_MARGIN)
        of_states = np.zeros((len(node), count, size))
        of_states[np.arange(len(node)), node] = slope[node, row]
        rows, slack = [of_states, of_states], [left[node, row] - _HARD_ROOM, left[node, row] - _SOFT_ROOM]
        price = [np.full(len(node), _HARD_PRICE), np.full(len(node), _SOFT_PRICE)]
        step = nodes.times[1] - nodes.times[0]
        turn, change = ahead[:, :3], ahead[:, 3:]
        moved, most = np.diff(nodes.joints, axis=0), _RATE_SHARE * step * craft.joint_rate_limits
        turned, farthest = self._turns(nodes), _RATE_SHARE * step * np.broadcast_to(craft.rate_limit, 3)
        length = np.linalg.norm(turned, axis=1)
        onward = turned / np.maximum(length, 1e-300)[:, None]
        along = np.einsum("ki,kidz->kdz", onward, turn)[:, None]  # of the length of a turn
        whole = np.broadcast_to(_RATE_SHARE * step * np.asarray(longest(craft, 1)), (count - 1, 1))
        bounded = (change, moved, most), (turn, turned, farthest), (along, length[:, None], whole)
        for one, value, bound in bounded:
            for sign in (1.0, -1.0):
                near = sign * value > 0.5 * bound
                rows.append(-sign * one[near])
                slack.append((bound - sign * value)[near])
                price.append(np.full(len(slack[-1]), _HARD_PRICE))
        stacked = np.concatenate(rows)
        reduced = np.einsum("bkd,kdy->bky", stacked, basis)
        return (
            reduced.reshape(len(stacked), count * basis.shape[2]),
            np.concatenate(slack),
            np.concatenate(price),
        )

    def _margin_slopes(self, nodes: Nodes, left: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Derivatives (K + 1, constraints, 3 + f) of the constraints' margins by turns and free joints."""
        own = left.shape[1] - 2 * nodes.joints.shape[1]
        found = np.zeros((len(nodes.times), own, slopes.shape[2]))
        if not own:
            return found
        for place in range(slopes.shape[2]):
            turn = _DIFFERENCE_STEP * np.eye(3)[place] if place < 3 else np.zeros(3)
            moved = replace(
                nodes,
                attitudes=nodes.attitudes @ so3.exp(turn),
                joints=nodes.joints + _DIFFERENCE_STEP * slopes[..., place],
            )
            found[..., place] = (self._room(moved)[:, -own:] - left[:, -own:]) / _DIFFERENCE_STEP
        return found


def rate_bounds(craft: Spacecraft) -> AnyArray:
    """Rates (J + 4,) rad/s that nodes may have: of joints, of three body axes, of the whole turn."""
    xp, joints, axes, whole = arrays(craft.joint_rate_limits, craft.rate_limit, longest(craft, 1))
    return _RATE_SHARE * xp.concatenate([joints, xp.broadcast_to(axes, (3,)), whole[None]])


def wish_weight(rate: Any, step: Any) -> Any:
    """Weight of the squared chord between a device's beam and what it prefers, for each node.

    Args:
        rate: weight of the square of the rate.
        step: s, between nodes.
    """
    return _WISH_WEIGHT * array_module(rate).maximum(rate, _MIN_RATE_WEIGHT) * step
