"""The motion of least energy with which devices follow their targets, as attitudes and joints at nodes.

What targets leave free, the platform's attitude or a part of it and the joints of free devices, is chosen at
K + 1 equidistant instants so that the energy of all motion is least: squares of rates and accelerations of
platform and joints, by the weights of the fit, with rates from differences between nodes. To it are added
how far the first node is from the state that the spacecraft comes from, over the time that the slew takes,
and how far devices are from what they prefer. Ranges, rates and constraints are kept at the nodes with
some room; accelerations, and what holds in between, are for the certificate.

It is found by Gauss' and Newton's method: about the nodes so far the residuals are linear in small turns
``R exp(z^)`` and changes of free joints. In each step targets are met exactly (`Pursuit.meeting`), and steps
lie in the null space of what they ask. A step that breaks nothing is that of a linear system; else it is
one of a quadratic program, in which what cannot be kept may be broken at a price.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxplan import so3
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.limits import longest
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.trajectory.qp import BoxQP, solve_box_qps

_STEPS = 12  # most steps; some four are usual
_SETTLED = 5e-3  # share of the energy; a step that gains no more is the last
_STILL = 1e-6  # rad; so is one that changes nothing by more
_DIFFERENCE = 1e-6  # rad, for slopes by differences
_TRUST = 0.5  # rad, most by which a step moves any device
_NEAR = 1.2  # rad; constraints with larger margins do not matter to a step
_HARD = np.deg2rad(0.05)  # rad, that nodes keep from constraints and ends of ranges, so that curves do
_ROOM = np.deg2rad(1.0)  # rad, that they keep where it costs little, so that slews have room at both ends
_SHARE = 0.9  # of limits of rate that nodes may use
_PRICE = 1e3  # of a radian by which a node breaks something, beside the energy
_CHEAP = 1.0  # of one by which it has less room
_WISH = 0.1  # 1/s, weight of the square of the angle to what a device prefers, per rate weight
_ROUNDS = 12  # in which rows of a quadratic program are added
_KEPT = 1e-9  # rad, by which a row may be broken and count as kept
_FLAT = 1e-9  # size of a row below which no step changes it
_TIE = 1e-9  # weight on the size of a step, so that what costs nothing does not change


@dataclass(frozen=True, kw_only=True, eq=False)
class Wanted:
    """What a motion shall be near, beside its targets.

    Attributes:
        attitude: (3, 3) of the state that the spacecraft comes from; None for none.
        joints: (J,) rad, to which those of the first node are drawn, and which devices without a target have.
        slew_time: s, that the slew from there takes, roughly.
        fixed: whether the motion starts in that state itself.
        wishes: devices without a target by number, each with the direction that it prefers.
        weights: of the squares of rate and acceleration.
    """

    attitude: np.ndarray | None
    joints: np.ndarray
    slew_time: float
    fixed: bool = False
    wishes: tuple[tuple[int, DirectionPath], ...] = ()
    weights: tuple[float, float] = (1.0, 3.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """States of a motion at K + 1 instants.

    Attributes:
        times: (K + 1,) s.
        attitudes: (K + 1, 3, 3).
        joints: (K + 1, J) rad.
    """

    times: np.ndarray
    attitudes: np.ndarray
    joints: np.ndarray


class LeastMotion:
    """The search for the nodes of least energy.

    Args:
        pursuit: what must point where.
        wanted: what the motion shall be near.
        free: numbers of the joints that are among the unknowns.
    """

    def __init__(self, pursuit: Pursuit, wanted: Wanted, free: Sequence[int] = ()) -> None:
        self.pursuit, self.wanted = pursuit, wanted
        self.free = np.array(free, int)

    def solve(self, times: np.ndarray, attitudes: np.ndarray, rest: np.ndarray) -> Nodes:
        """The nodes of least energy near a first guess.

        Args:
            times: (K + 1,) s, equidistant, at least three.
            attitudes: (K + 1, 3, 3), the first guess.
            rest: (J,) rad, joints of devices without a target.
        """
        nodes = self.first(times, attitudes, rest)
        price = self.price(nodes)
        for _ in range(_STEPS):
            step = self._step(nodes)
            for share in (1.0, 0.5, 0.25, 0.1):
                tried = self._moved(nodes, share * step)
                found = self.price(tried)
                if found <= price:
                    break
            else:
                break
            gained, nodes, price = price - found, tried, found
            if gained <= _SETTLED * price or np.max(np.abs(share * step), initial=0.0) <= _STILL:
                break
        return nodes

    def first(self, times: np.ndarray, attitudes: np.ndarray, rest: np.ndarray) -> Nodes:
        """The nodes of a first guess, with targets met; arguments as of `solve`."""
        return self._nodes(times, attitudes, np.tile(rest, (len(times), 1)))

    def broken(self, nodes: Nodes) -> np.ndarray:
        """How far each node (K + 1,) is beyond the worst of ranges and constraints, rad; at least 0."""
        return np.maximum(0, np.max(-self._left(nodes), axis=1, initial=0.0))

    def _nodes(self, times: np.ndarray, attitudes: np.ndarray, rest: np.ndarray) -> Nodes:
        """Nodes at attitudes near given ones at which targets are met, with joints that follow."""
        met = self.pursuit.meeting(attitudes, times)
        joints = self.pursuit.unwrapped(self.pursuit.joints(met, times, rest))
        return Nodes(times=times, attitudes=met, joints=joints)

    def _moved(self, nodes: Nodes, step: np.ndarray) -> Nodes:
        """Nodes after a step (K + 1, 3 + f) of turns and of free joints, rad."""
        rest = nodes.joints.copy()
        rest[:, self.free] += step[:, 3:]
        return self._nodes(nodes.times, nodes.attitudes @ so3.exp(step[:, :3]), rest)

    def _left(self, nodes: Nodes) -> np.ndarray:
        """What is left (K + 1, c) rad of low ends of ranges, then of high ones, and of constraints."""
        low, high = self.pursuit.craft.joint_ranges.T
        margins = self.pursuit.margins(nodes.attitudes, nodes.joints, nodes.times)
        return np.concatenate([nodes.joints - low, high - nodes.joints, margins], axis=1)

    def price(self, nodes: Nodes) -> float:
        """The energy of nodes and the price of what they break."""
        residual, _ = self._residuals(nodes, self._slopes(nodes))
        left = self._left(nodes)
        broken = np.sum(np.maximum(0, _HARD - left)) + np.sum(np.maximum(0, self._overruns(nodes)))
        narrow = np.sum(np.maximum(0, _ROOM - left))
        return float(residual @ residual / 2 + _PRICE * broken + _CHEAP * narrow)

    def _overruns(self, nodes: Nodes) -> np.ndarray:
        """How far rates of joints, and of the platform, are beyond their limits, as angles between nodes."""
        craft, step = self.pursuit.craft, nodes.times[1] - nodes.times[0]
        joints = np.abs(np.diff(nodes.joints, axis=0)) - step * craft.joint_rate_limits
        turned = np.linalg.norm(self._turns(nodes), axis=1) - step * longest(craft, 1)
        return np.concatenate([joints.ravel(), turned])

    @staticmethod
    def _turns(nodes: Nodes) -> np.ndarray:
        """Rotation vectors (K, 3) rad from each node to the next, in the axes of the former."""
        relative = np.swapaxes(nodes.attitudes[:-1], 1, 2) @ nodes.attitudes[1:]
        return np.asarray(so3.log(relative))

    def _slopes(self, nodes: Nodes) -> np.ndarray:
        """Derivatives (K + 1, J, 3 + f) of joints by turns and free joints, targets met."""
        slopes = np.zeros((*nodes.joints.shape, 3 + len(self.free)))
        for axis in range(3):
            turned = nodes.attitudes @ so3.exp(_DIFFERENCE * np.eye(3)[axis])
            after = self.pursuit.joints(turned, nodes.times, nodes.joints)
            change = after - nodes.joints
            slopes[..., axis] = (change - 2 * np.pi * np.round(change / (2 * np.pi))) / _DIFFERENCE
        slopes[:, self.free, 3 + np.arange(len(self.free))] = 1.0
        return slopes

    def _residuals(self, nodes: Nodes, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (r,), half whose square is the energy, and their slopes (r, K + 1, 3 + f)."""
        count, size = len(nodes.times), slopes.shape[2]
        step = nodes.times[1] - nodes.times[0]
        rate, acceleration = self.wanted.weights
        turns = self._turns(nodes)
        eye = np.zeros((3, size))
        eye[:, :3] = np.eye(3)
        ahead = np.zeros((count - 1, 3 + nodes.joints.shape[1], count, size))  # of changes between nodes
        every = np.arange(count - 1)
        back = np.swapaxes(so3.exp(turns), 1, 2)
        ahead[every, :3, every + 1] = eye
        ahead[every, :3, every] = -back @ eye
        ahead[every, 3:, every + 1] = slopes[1:]
        ahead[every, 3:, every] = -slopes[:-1]
        change = np.concatenate([turns, np.diff(nodes.joints, axis=0)], axis=1)
        bend, bent = np.diff(change, axis=0), np.diff(ahead, axis=0)
        values = [np.sqrt(rate / step) * change.ravel(), np.sqrt(acceleration / step**3) * bend.ravel()]
        rows = [
            np.sqrt(rate / step) * ahead.reshape(-1, count, size),
            np.sqrt(acceleration / step**3) * bent.reshape(-1, count, size),
        ]
        for value, row in self._attractions(nodes, slopes):
            values.append(value)
            rows.append(row)
        return np.concatenate(values), np.concatenate(rows)

    def _attractions(self, nodes: Nodes, slopes: np.ndarray) -> Sequence[tuple[np.ndarray, np.ndarray]]:
        """Residuals (r,), with slopes (r, K + 1, 3 + f), of the way to the first node, and of wishes."""
        count, size = len(nodes.times), slopes.shape[2]
        found = []
        if self.wanted.attitude is not None and not self.wanted.fixed:
            weight = np.sqrt(self.wanted.weights[0] / self.wanted.slew_time)
            row = np.zeros((3 + nodes.joints.shape[1], count, size))
            row[:3, 0, :3] = np.eye(3)
            row[3:, 0] = slopes[0]
            away = so3.log(self.wanted.attitude.T @ nodes.attitudes[0])
            value = np.concatenate([away, nodes.joints[0] - self.wanted.joints])
            found.append((weight * value, weight * row))
        step, every = nodes.times[1] - nodes.times[0], np.arange(count)
        for device, path in self.wanted.wishes:
            weight = np.sqrt(_WISH * max(self.wanted.weights[0], 1e-3) * step)
            value, slope = self._misses(nodes, device, path)
            row = np.zeros((count, 3, count, size))
            row[every, :, every] = slope
            found.append((weight * value.ravel(), weight * row.reshape(-1, count, size)))
        return found

    def _misses(self, nodes: Nodes, device: int, path: DirectionPath) -> tuple[np.ndarray, np.ndarray]:
        """How far a device is off a direction, ``u - R^T e`` (K + 1, 3), and slopes (K + 1, 3, 3 + f)."""
        gimbals = self.pursuit.craft.gimbals
        wished = (np.asarray(as_path(path).at(nodes.times))[:, None] @ nodes.attitudes)[:, 0]

        def beam(joints: np.ndarray) -> np.ndarray:
            if device >= gimbals.count:
                fixed = self.pursuit.craft.fixed_boresights[device - gimbals.count]
                return np.broadcast_to(fixed, wished.shape)
            return np.asarray(gimbals.boresights(joints))[:, device]

        seen = beam(nodes.joints)
        slope = np.zeros((len(wished), 3, 3 + len(self.free)))
        slope[:, :, :3] = -so3.hat(wished)  # R^T e after a turn z: s + s x z
        for place, joint in enumerate(self.free):
            moved = nodes.joints.copy()
            moved[:, joint] += _DIFFERENCE
            slope[:, :, 3 + place] = (beam(moved) - seen) / _DIFFERENCE
        return seen - wished, slope

    def _step(self, nodes: Nodes) -> np.ndarray:
        """The step (K + 1, 3 + f), rad, of least energy to first order, that keeps what can be kept."""
        slopes = self._slopes(nodes)
        residual, rows = self._residuals(nodes, slopes)
        basis = self._basis(nodes, slopes.shape[2])  # (K + 1, 3 + f, y)
        reduced = np.einsum("rkd,kdy->rky", rows, basis)
        reduced = reduced.reshape(len(residual), basis.shape[0] * basis.shape[2])
        hessian = reduced.T @ reduced + _TIE * np.eye(reduced.shape[1])
        pull = reduced.T @ residual
        if not len(pull):
            return np.zeros((len(nodes.times), slopes.shape[2]))
        found = _program(hessian, pull, *self._bounds(nodes, slopes, basis))
        step = np.einsum("kdy,ky->kd", basis, found.reshape(basis.shape[0], basis.shape[2]))
        moved = np.linalg.norm(step[:, :3], axis=1) + np.max(np.abs(step[:, 3:]), axis=1, initial=0.0)
        return np.asarray(step * min(1.0, _TRUST / max(float(np.max(moved)), 1e-300)))

    def _basis(self, nodes: Nodes, size: int) -> np.ndarray:
        """Orthonormal directions (K + 1, 3 + f, y) of steps along which targets stay met."""
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
        if self.wanted.fixed:
            basis[0] = 0.0
        return basis

    def _bounds(
        self, nodes: Nodes, slopes: np.ndarray, basis: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows ``B y + s >= 0`` of what a step shall keep, in radians, and the price of breaking each.

        Returns:
            (b, (K + 1) y), (b,) and (b,).
        """
        count, size = len(nodes.times), slopes.shape[2]
        craft, every = self.pursuit.craft, np.arange(count)
        left = self._left(nodes)
        slope = np.concatenate([slopes, -slopes, self._margin_slopes(nodes, left, slopes)], axis=1)
        node, row = np.nonzero(left < _NEAR)
        of_states = np.zeros((len(node), count, size))
        of_states[np.arange(len(node)), node] = slope[node, row]
        rows, slack = [of_states, of_states], [left[node, row] - _HARD, left[node, row] - _ROOM]
        price = [np.full(len(node), _PRICE), np.full(len(node), _CHEAP)]
        step = nodes.times[1] - nodes.times[0]
        change = np.zeros((count - 1, nodes.joints.shape[1], count, size))
        change[every[:-1], :, every[1:]] = slopes[1:]
        change[every[:-1], :, every[:-1]] = -slopes[:-1]
        moved, most = np.diff(nodes.joints, axis=0), _SHARE * step * craft.joint_rate_limits
        turn = np.zeros((count - 1, 3, count, size))
        turn[every[:-1], :, every[1:], :3] = np.eye(3)
        turn[every[:-1], :, every[:-1], :3] = -np.swapaxes(so3.exp(self._turns(nodes)), 1, 2)
        turned, farthest = self._turns(nodes), _SHARE * step * np.broadcast_to(craft.rate_limit, 3)
        length = np.linalg.norm(turned, axis=1)
        ahead = turned / np.maximum(length, 1e-300)[:, None]
        along = np.einsum("ki,kidz->kdz", ahead, turn)[:, None]  # of the length of a turn
        whole = np.broadcast_to(_SHARE * step * np.asarray(longest(craft, 1)), (count - 1, 1))
        bounded = (change, moved, most), (turn, turned, farthest), (along, length[:, None], whole)
        for one, value, bound in bounded:
            for sign in (1.0, -1.0):
                near = sign * value > 0.5 * bound
                rows.append(-sign * one[near])
                slack.append((bound - sign * value)[near])
                price.append(np.full(len(slack[-1]), _PRICE))
        stacked = np.concatenate(rows)
        reduced = np.einsum("bkd,kdy->bky", stacked, basis)
        return (
            reduced.reshape(len(stacked), count * basis.shape[2]),
            np.concatenate(slack),
            np.concatenate(price),
        )

    def _margin_slopes(self, nodes: Nodes, left: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Derivatives (K + 1, c', 3 + f) of the constraints' margins by turns and free joints."""
        own = left.shape[1] - 2 * nodes.joints.shape[1]
        found = np.zeros((len(nodes.times), own, slopes.shape[2]))
        if not own:
            return found
        for place in range(slopes.shape[2]):
            turn = _DIFFERENCE * np.eye(3)[place] if place < 3 else np.zeros(3)
            moved = replace(
                nodes,
                attitudes=nodes.attitudes @ so3.exp(turn),
                joints=nodes.joints + _DIFFERENCE * slopes[..., place],
            )
            found[..., place] = (self._left(moved)[:, -own:] - left[:, -own:]) / _DIFFERENCE
        return found


def _program(
    hessian: np.ndarray, pull: np.ndarray, rows: np.ndarray, slack: np.ndarray, price: np.ndarray
) -> np.ndarray:
    """The step (y,) least in ``y H y / 2 + p y`` with ``B y + s >= 0``, where rows may be broken at a price.

    Rows are added as steps break them, as most of them never bind.

    Args:
        hessian: (y, y).
        pull: (y,).
        rows: (b, y).
        slack: (b,) rad.
        price: (b,) 1/rad, of breaking each.
    """
    inverse = np.linalg.inv(hessian)
    free = -inverse @ pull
    found, taken = free, np.zeros(len(slack), bool)
    can_help = np.linalg.norm(rows, axis=1) > _FLAT
    for _ in range(_ROUNDS):
        broken = can_help & ~taken & (rows @ found + slack < -_KEPT)
        if not np.any(broken):
            break
        taken |= broken
        own = rows[taken]
        turned = own @ inverse
        program = BoxQP(
            matrix=turned @ own.T,
            linear=-(own @ free) - slack[taken],
            penalty=price[taken],
        )
        multipliers = solve_box_qps([program])[0].multipliers
        if not np.all(np.isfinite(multipliers)):
            break
        found = free + turned.T @ multipliers
    return np.asarray(found)
