"""The motion with which devices follow their targets for a while, as a trajectory.

The nodes of least energy (`least_energy`) are sought from two first guesses: an attitude that stays as it is,
and one that is carried along by the targets, which is near the answer where these go round. A spline passes
through the nodes. It is corrected at nodes twice as close together, where all targets are met exactly and
joints follow, until every device points within a small part of its tolerance everywhere between; that holds
at the instants sampled, and the certificate proves it for all.

Shapes: K + 1 nodes, J joints. Attitudes are body to inertial.
"""

from dataclasses import dataclass

import numpy as np

from jaxplan import so3
from jaxplan.certificate import LIMIT_ALLOWANCE
from jaxplan.geometry import quaternion
from jaxplan.model.breaches import constraint_breaches
from jaxplan.model.limits import timed_limits
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.wheels import PSEUDO_INVERSE
from jaxplan.runtime.display import shown
from jaxplan.timeline import curves
from jaxplan.timeline.least_energy import LeastMotion, Nodes, Wanted
from jaxplan.timeline.pursuit import Pursuit
from jaxplan.trajectory import Samples, Trajectory

_MIN_INTERVALS, _MAX_INTERVALS = 12, 240  # number of intervals between the nodes of least energy
_MAX_INTERVAL_TIME = 120.0  # s, most time between nodes, unless that takes more than `_MAX_INTERVALS`
_MAX_INTERVAL_TURN = np.deg2rad(4.0)  # rad, most that a target turns between nodes, likewise
_MAX_CURVE_INTERVALS = 4096  # intervals of the curve, beyond which it is not refined
_TOLERANCE_SHARE = 0.05  # fraction of the tolerance by which a device may be off its target between nodes
_SAMPLES_BETWEEN = 4  # instants looked at in each interval
_ASIDE_ANGLE = 0.2  # rad, by which a first guess is turned to give way to a zone that comes head-on
_CARRY_STEPS = 8  # steps from node to node in which attitudes are carried along
_REST_TOLERANCE = 1e-11  # rad/s or rad/s^2; smaller derivatives are set to zero, so that rest stays rest
_SAME_STATE = 1e-9  # rad, by which a state differs at most from one that it is but for rounding
_RANDOM_ATTITUDES = 64  # number of random attitudes among which those with the most room are sought
_ROOM_INSTANTS = 33  # number of instants at which their room is computed
VIOLATION_TOLERANCE = 1e-9
"""rad, by which a node may violate something and still counts as keeping it."""
_LOAD_SAMPLES = 65  # number of instants at which rates, accelerations and loads are sampled
_TURN_SAMPLES = 64  # number of instants at which it is measured how far targets turn


@shown("attitude", "joints deg", "velocity deg/s", "rates deg/s")
@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """A state of the spacecraft with its first two derivatives by time.

    Attributes:
        attitude: (3, 3) body to inertial.
        joints: (J,) rad.
        velocity: (3,) rad/s, angular velocity, body axes.
        rates: (J,) rad/s, of the joints.
        acceleration: (3,) rad/s^2, angular acceleration, body axes.
        bends: (J,) rad/s^2, accelerations of the joints.
    """

    attitude: np.ndarray
    joints: np.ndarray
    velocity: np.ndarray
    rates: np.ndarray
    acceleration: np.ndarray
    bends: np.ndarray

    @classmethod
    def of(cls, trajectory: Trajectory, time: float) -> "State":
        """Return the state of a trajectory at `time`, s; derivatives of rounding size are set to zero."""
        at = trajectory.sample(time)

        def clean(derivative: np.ndarray) -> np.ndarray:
            return np.where(np.abs(derivative) <= _REST_TOLERANCE, 0.0, derivative)

        return cls(
            attitude=at.attitude,
            joints=at.joints,
            velocity=clean(at.angular_velocity),
            rates=clean(at.joint_rates),
            acceleration=clean(at.angular_acceleration),
            bends=clean(at.joint_accelerations),
        )

    @classmethod
    def still(cls, attitude: np.ndarray, joints: np.ndarray) -> "State":
        """Return the state at rest at an attitude (3, 3) and joints (J,) rad."""
        zero = np.zeros(len(joints))
        return cls(
            attitude=attitude,
            joints=joints,
            velocity=np.zeros(3),
            rates=zero,
            acceleration=np.zeros(3),
            bends=zero,
        )

    @property
    def at_rest(self) -> bool:
        """Whether rates and accelerations of platform and joints are all zero."""
        return not any(np.any(one) for one in (self.velocity, self.rates, self.acceleration, self.bends))

    def same_as(self, other: "State") -> bool:
        """Tell whether attitude and joints are those of another state but for rounding."""
        turned = float(so3.distance(self.attitude, other.attitude))
        return bool(turned <= _SAME_STATE and np.all(np.abs(self.joints - other.joints) <= _SAME_STATE))


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """A motion that follows targets.

    Attributes:
        trajectory: the motion; its time zero is its start.
        nodes: the nodes of least energy from which it was made.
        broken: (K + 1,) rad, how far each node violates a range or a constraint; zero if none.
        between: rad, how far the trajectory does so at most at sampled instants between the nodes.
        too_quick: rad, excess of the fastest sampled rate over its limit, times the time between nodes.
        wanted: what the nodes are near, beside their targets.
        free: indices of the joints that were chosen, too.
    """

    trajectory: Trajectory
    nodes: Nodes
    broken: np.ndarray
    between: float
    too_quick: float
    wanted: Wanted
    free: tuple[int, ...] = ()

    @property
    def depth(self) -> tuple[float, float]:
        """How far nodes, and the curve between them, violate something at most, rad; zero if all is kept."""
        return float(np.max(self.broken)), max(self.between, self.too_quick)

    @property
    def worst(self) -> int:
        """Index of the node that violates the most."""
        return int(np.argmax(self.broken))


def track(
    pursuit: Pursuit,
    wanted: Wanted,
    free: tuple[int, ...],
    guess: np.ndarray,
    start: float,
    end: float,
    tolerance: float,
) -> Tracked:
    """Find the motion of least energy that follows targets.

    Args:
        pursuit: what must point where, and what must hold.
        wanted: what the motion shall be near.
        free: indices of joints that are chosen, too.
        guess: (1, 3, 3) attitude at the start, at which all devices can point at their targets; or attitudes
            (K + 1, 3, 3) of the nodes of an earlier answer.
        start: s.
        end: s.
        tolerance: rad, by which a device may be off its target.

    Returns:
        The motion, which may violate something: see `Tracked.depth`.
    """
    times = np.linspace(start, end, _count_intervals(pursuit, start, end) + 1)
    search = LeastMotion(pursuit, wanted, free)
    if len(guess) >= len(times):  # an earlier answer, perhaps with more nodes
        times = np.linspace(start, end, len(guess))
        guesses = [guess]
    else:
        guesses = [make(pursuit, guess[0], times) for make in (_follow_minimally, _carry_along)]
        guesses.sort(key=lambda one: search.price(search.first(times, one, wanted.joints)))
    best: Tracked | None = None
    for one in guesses:
        best = _choose_better(best, _solve_from_guess(search, times, one, tolerance))
        if np.max(best.broken) <= 0:
            break
    assert best is not None
    if np.max(best.broken) <= 0 < best.between:  # nodes give way to both sides of what comes head-on
        for one in _turn_aside(best.nodes):
            best = _choose_better(best, _solve_from_guess(search, times, one, tolerance))
            if best.depth <= (0.0, 0.0):
                break
    return _refine_nodes(search, best, tolerance)


def _refine_nodes(search: LeastMotion, found: Tracked, tolerance: float) -> Tracked:
    """Double the nodes of a motion while the nodes keep everything and the curve between does not."""
    while found.depth[0] <= 0 < found.depth[1] and 2 * (len(found.nodes.times) - 1) <= _MAX_INTERVALS:
        first, last = found.nodes.times[[0, -1]]
        times = np.linspace(first, last, 2 * len(found.nodes.times) - 1)
        guess = found.trajectory.sample(np.clip(times - first, 0, found.trajectory.duration)).attitude
        finer = _solve_from_guess(search, times, guess, tolerance)
        if finer.depth >= found.depth:
            break
        found = finer
    return found


def _choose_better(best: Tracked | None, found: Tracked) -> Tracked:
    """Return the one of two motions that violates less; `best` may be None."""
    return found if best is None or found.depth < best.depth else best


def _solve_from_guess(search: LeastMotion, times: np.ndarray, guess: np.ndarray, tolerance: float) -> Tracked:
    """Find the motion of least energy near a first guess (K + 1, 3, 3) at times (K + 1,), s."""
    nodes = search.solve(times, guess, search.wanted.joints)
    return tracked_through(search, nodes, nodes, tolerance)


def tracked_through(search: LeastMotion, nodes: Nodes, through: Nodes, tolerance: float) -> Tracked:
    """Return the motion of some nodes with a curve `through` the same nodes, or through a finer set."""
    times, curve = nodes.times, _fit_curve(search.pursuit, through, tolerance)
    between = _times_between(times)
    at = curve.sample(np.clip(between - times[0], 0, curve.duration))
    inner = Nodes(times=between, attitudes=at.attitude, joints=at.joints)
    return Tracked(
        trajectory=curve,
        nodes=nodes,
        broken=search.broken(nodes),
        between=float(np.max(search.broken(inner))),
        too_quick=_max_rate_excess(search.pursuit.craft, at) * (times[1] - times[0]),
        wanted=search.wanted,
        free=tuple(search.free.tolist()),
    )


def _max_rate_excess(craft: Spacecraft, at: Samples) -> float:
    """Return by how much rates exceed their limits at most, rad/s; zero if none does."""
    speeds = [
        np.abs(at.angular_velocity) - craft.rate_limit,
        np.abs(at.joint_rates) - craft.joint_rate_limits,
    ]
    if craft.rate_norm_limit is not None:
        speeds.append(np.linalg.norm(at.angular_velocity, axis=1) - craft.rate_norm_limit)
    return float(max(np.max(one, initial=0.0) for one in speeds))


def overrun(
    craft: Spacecraft, motion: Trajectory, begin: float, total: np.ndarray | None, *, moving: bool
) -> str:
    """Return text on the load of a motion that exceeds its limit the most, and when; empty if none does.

    Args:
        craft: the spacecraft with its limits.
        motion: the motion; its time zero is its begin.
        begin: s, in the timeline's times.
        total: (3,) N m s, momentum of platform and wheels in inertial axes; None without wheels.
        moving: whether the motion follows targets.
    """
    times = np.linspace(0.0, motion.duration, _LOAD_SAMPLES)
    loads = motion.sample(times).kinematics(craft, total)
    every = [limit for part in timed_limits(craft) for limit in part]
    shares = np.concatenate([np.asarray(limit.shares(loads)) for limit in every])
    worst, instant = np.unravel_index(np.argmax(shares), shares.shape)
    if shares[worst, instant] <= 1 + LIMIT_ALLOWANCE:
        return ""
    limit, row = [(limit, row) for limit in every for row in range(len(limit.names))][worst]
    name, most, when = limit.names[row], float(limit.bound[row]), f"at {begin + times[instant]:.2f} s"
    share = shares[worst, instant]
    if limit.quantity.of_wheels:
        owner = limit.owners[row]
        whose = f'wheel "{owner}"' if craft.allocation == PSEUDO_INVERSE else f"the {owner}"
        name = f"the {limit.quantity.word} of {whose}"
        resting = np.asarray(loads.resting_momenta)[row, instant]
        if limit.quantity.power == 1 and abs(float(resting)) > most:
            return (
                f"{whose} would hold {share * most:.4g} N m s {when}, of {most:.4g} N m s at most, by what "
                "is stored and the attitude there, so that slowing down does not help: lower "
                "spacecraft.wheel.stored_nms, raise momentum_nms, or ask for another attitude or target"
            )
    return f"{name} would reach {share:.4g} times its limit {when}" + ", as targets move then" * moving


def violation_phrases(scene: Scenario, nodes: Nodes, node: int) -> list[str]:
    """Return a phrase for each range and constraint of a scene that one of some nodes violates.

    Args:
        scene: spacecraft and zones, in the times of the nodes.
        nodes: the nodes.
        node: the index of the one that is looked at.
    """
    craft, joints = scene.usable, nodes.joints[node]
    low, high = craft.joint_ranges.T
    found = []
    for name, angle, least, most in zip(craft.joint_names, joints, low, high, strict=True):
        over = max(least - angle, angle - most)
        if over > VIOLATION_TOLERANCE:
            end = np.rad2deg(least if least - angle > 0 else most)
            found.append(f"{name} would be {np.rad2deg(over):.4g} deg beyond its limit of {end:.4g} deg")
    rows = scene.constraints.at(nodes.times[node])
    zones = [scene.zones[zone] for zone in rows.zone if zone >= 0]
    state = scene.spacecraft, nodes.attitudes[node], joints
    return [*found, *constraint_breaches(rows, *state, zones, scene.sight_names)]


def _times_between(times: np.ndarray) -> np.ndarray:
    """Return some instants, s, inside each interval between times (K + 1,)."""
    shares = (np.arange(_SAMPLES_BETWEEN) + 0.5) / _SAMPLES_BETWEEN
    return np.asarray((times[:-1, None] + np.diff(times)[:, None] * shares).ravel())


def _turn_aside(nodes: Nodes) -> list[np.ndarray]:
    """Return attitudes (K + 1, 3, 3) of nodes, turned by `_ASIDE_ANGLE` about body axes to either side."""
    return [
        nodes.attitudes @ so3.exp(side * _ASIDE_ANGLE * axis) for axis in np.eye(3) for side in (1.0, -1.0)
    ]


def _count_intervals(pursuit: Pursuit, start: float, end: float) -> int:
    """Return the number of intervals between nodes that moving targets, or zones, and duration require."""
    times = np.linspace(start, end, _TURN_SAMPLES)
    # without targets it is zones that ask for a motion
    seen = pursuit.directions(times) if pursuit.devices else np.asarray(pursuit.rows.axes(times))
    turned = np.sum(np.linalg.norm(np.diff(seen, axis=0), axis=-1), axis=0)
    asked = max(float(np.max(turned, initial=0.0)) / _MAX_INTERVAL_TURN, (end - start) / _MAX_INTERVAL_TIME)
    return int(np.clip(np.ceil(asked), _MIN_INTERVALS, _MAX_INTERVALS))


def _follow_minimally(pursuit: Pursuit, attitude: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return attitudes (K + 1, 3, 3) that change only as the targets require, each from the one before."""
    found = np.tile(attitude, (len(times), 1, 1))
    if not pursuit.equations:
        return found
    for node in range(1, len(times)):
        found[node] = pursuit.meeting(found[[node - 1]], times[[node]])[0]
    return found


def led_back(pursuit: Pursuit, attitude: np.ndarray, start: float, end: float) -> np.ndarray:
    """Return the attitude (1, 3, 3) at `start`, s, from which targets lead to a given one at `end`, s."""
    return _follow_minimally(pursuit, attitude, np.linspace(end, start, _MIN_INTERVALS + 1))[-1:]


def roomiest(
    pursuit: Pursuit, joints: np.ndarray, start: float, end: float, *, count: int, seed: int
) -> list[np.ndarray]:
    """Find attitudes at the start from which targets lead along with the most room all the time.

    They are drawn at random, and carried along by the targets from the start on, and from the end back.

    Args:
        pursuit: what must point where, and what must hold.
        joints: (J,) rad, of devices without a target.
        start: s.
        end: s.
        count: how many are wanted.
        seed: seed of the draws.

    Returns:
        Attitudes (1, 3, 3), the most room first; none where targets determine the attitude.
    """
    if pursuit.equations >= 3:
        return []
    search = LeastMotion(pursuit, Wanted(attitude=None, joints=joints, slew_time=1.0))
    numbers = np.random.default_rng(seed).normal(size=(_RANDOM_ATTITUDES, 4))
    drawn = np.asarray(quaternion.to_matrix(numbers / np.linalg.norm(numbers, axis=1, keepdims=True)))
    found: list[tuple[float, int, np.ndarray]] = []
    for ends in ((start, end), (end, start)):
        times = np.linspace(*ends, _ROOM_INSTANTS)
        ways = [drawn]
        for time in times:
            ways.append(pursuit.meeting(ways[-1], np.full(len(drawn), time)))
        order = np.argsort(times)
        for way in np.swapaxes(ways[1:], 0, 1):
            nodes = search.first(times[order], way[order], joints)
            found.append((search.depth(nodes), len(found), nodes.attitudes[:1]))
    return [attitude for _, _, attitude in sorted(found)[:count]]


def _carry_along(pursuit: Pursuit, attitude: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return attitudes (K + 1, 3, 3) that turn along with all targets, as far as these turn alike."""
    fine = np.linspace(times[0], times[-1], _CARRY_STEPS * (len(times) - 1) + 1)
    seen = pursuit.directions(fine)
    if not seen.shape[1]:
        return np.tile(attitude, (len(times), 1, 1))
    moved = np.diff(seen, axis=0).reshape(len(fine) - 1, -1)
    across = -so3.hat(seen[:-1]).reshape(len(moved), -1, 3)  # e' = w x e, of the least w that does best
    turns = so3.exp((np.linalg.pinv(across, rcond=1e-6) @ moved[..., None])[..., 0])
    found = [attitude]
    for turn in turns:
        found.append(turn @ found[-1])
    return np.stack(found[::_CARRY_STEPS])


def _fit_curve(pursuit: Pursuit, nodes: Nodes, tolerance: float) -> Trajectory:
    """Return the trajectory through nodes, with as many more between as the tolerance (rad) requires."""
    own = nodes
    while True:
        curve = curves.through(own)
        count = len(own.times) - 1
        between = _times_between(own.times)
        at = curve.sample(np.clip(between - own.times[0], 0, curve.duration))
        off = pursuit.errors(at.attitude, at.joints, between)
        if np.max(off, initial=0.0) <= _TOLERANCE_SHARE * tolerance or 2 * count > _MAX_CURVE_INTERVALS:
            return curve
        times = np.linspace(own.times[0], own.times[-1], 2 * count + 1)
        at = curve.sample(np.clip(times - times[0], 0, curve.duration))
        attitudes = pursuit.meeting(at.attitude, times)
        joints = pursuit.unwrapped(pursuit.joints(attitudes, times, at.joints))
        own = Nodes(times=times, attitudes=attitudes, joints=joints)
