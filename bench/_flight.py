"""The independent check of a manoeuvre: dense sampling in numpy and scipy alone, whoever made it.

A flight says its rates and accelerations as functions of time. The check begins in the scenario's start
state and integrates the rates by the midpoint rule in `STEPS` steps or more: zones, joint limits and the goal
are looked at along the motion that these rates really make. The rule's own error is below 1e-7 rad.
Vectors are ``(k, 3 + 2n)``: the platform's three body axes, then the joints in the scenario's order.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Goal
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import Trajectory

STEPS = 20_000
# Tolerances: deg into a zone, excess over a limit as a share of it, deg from the goal, deg/s there.
ZONE, LIMIT, GOAL, REST = 1e-4, 1e-3, 1e-2, 1e-2


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A manoeuvre to check.

    Attributes:
        breaks: (b + 1,) s from 0 to the duration; between two of them both functions are smooth.
        rates: of times (k,) s in a piece, numbered from 0: rad/s.
        accelerations: likewise, rad/s^2.
    """

    breaks: np.ndarray
    rates: Callable[[np.ndarray, int], np.ndarray]
    accelerations: Callable[[np.ndarray, int], np.ndarray]

    @property
    def duration(self) -> float:
        return float(self.breaks[-1])


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the check found.

    Attributes:
        margin: least over all zones and instants, deg; infinite without zones.
        peak: largest ratio of a rate, acceleration or joint angle to its limit.
        miss: distance from the goal, of the platform or the farthest joint, deg.
        rest: difference of the final rate from the one asked for, of the axis where it is largest, deg/s.
    """

    margin: float
    peak: float
    miss: float
    rest: float

    @property
    def refusal(self) -> str:
        """Text on why the manoeuvre is refused; empty if it is not. Where a value is NaN it is refused."""
        reasons = []
        if not self.margin >= -ZONE:
            reasons.append(f"{-self.margin:.3f} deg into a zone")
        if not self.peak <= 1 + LIMIT:
            reasons.append(f"{self.peak:.4f} of a limit")
        if not (self.miss <= GOAL and self.rest <= REST):
            reasons.append(f"{self.miss:.3f} deg and {self.rest:.3f} deg/s from the goal")
        return ", ".join(reasons)


def inspect(scenario: Scenario, goal: Goal, flight: Flight) -> Verdict:
    """Check a manoeuvre from the scenario's start to a goal, by integrating its rates."""
    craft, start, end = scenario.spacecraft, scenario.start, scenario.goal
    attitude, joints = Rotation.from_rotvec(start.rotation_vector), np.asarray(start.joints, float)[None]
    limits, speed_ups = _limits(craft)
    margin, peak = np.inf, 0.0
    for piece, (begin, stop) in enumerate(zip(flight.breaks[:-1], flight.breaks[1:], strict=True)):
        count = max(2, int(np.ceil(STEPS * (stop - begin) / flight.duration)))
        step = (stop - begin) / count
        rates = flight.rates(begin + step * (np.arange(count) + 0.5), piece)
        instants = np.linspace(begin, stop, count + 1)
        turns = Rotation.concatenate([attitude, attitude * _products(rates[:, :3] * step)])
        joints = joints[-1] + np.concatenate(
            [np.zeros((1, joints.shape[1])), step * np.cumsum(rates[:, 3:], 0)]
        )
        margin = min(margin, _margin(scenario, turns, joints))
        for values, bound in (
            (flight.rates(instants, piece), limits),
            (flight.accelerations(instants, piece), speed_ups),
            (joints, craft_range(craft)),
        ):
            peak = float(np.maximum(peak, np.max(np.abs(values) / bound)))  # keeps a NaN
        attitude = turns[-1]
    turned = (attitude.inv() * Rotation.from_matrix(goal.attitude)).magnitude()
    asked = np.concatenate([end.angular_velocity, end.joint_rates])
    last = flight.rates(flight.breaks[-1:], len(flight.breaks) - 2)[0]
    return Verdict(
        margin=float(np.rad2deg(margin)),
        peak=peak,
        miss=float(np.rad2deg(np.max([turned, *np.abs(joints[-1] - goal.joints)]))),
        rest=float(np.rad2deg(np.max(np.abs(last - asked)))),
    )


def flight_of(trajectory: Trajectory) -> Flight:
    """The flight of a trajectory of jaxplan's, by its samples."""
    breaks = np.union1d(trajectory.breaks, trajectory.joint_breaks)

    def rates(t: np.ndarray, _: int) -> np.ndarray:
        state = trajectory.sample(np.clip(t, 0, trajectory.duration))
        return np.concatenate([state.angular_velocity, state.joint_rates], axis=-1)

    def accelerations(t: np.ndarray, _: int) -> np.ndarray:
        state = trajectory.sample(np.clip(t, 0, trajectory.duration))
        return np.concatenate([state.angular_acceleration, state.joint_accelerations], axis=-1)

    return Flight(breaks=breaks, rates=rates, accelerations=accelerations)


def joint_bound(scenario: Scenario, goal: Goal) -> float:
    """Seconds that the slowest joint needs by itself, which no manoeuvre can undercut."""
    rate, speed_up = (bound[3:] for bound in _limits(scenario.spacecraft))
    return float(np.max(rest_to_rest(np.abs(goal.joints - scenario.start.joints), rate, speed_up)))


def rest_to_rest(change: np.ndarray, rate: np.ndarray | float, speed_up: np.ndarray | float) -> np.ndarray:
    """Shortest time (...) s of changes (...) rad from rest to rest, within limits rad/s and rad/s^2.

    An axis speeds up and slows down at its acceleration limit ``a`` and coasts at its rate limit ``v`` if it
    gets there: ``2 sqrt(d / a)`` or ``d / v + v / a`` for a change ``d``.
    """
    coasts = change > rate**2 / speed_up
    return np.where(coasts, change / rate + rate / speed_up, 2 * np.sqrt(change / speed_up))


def craft_range(craft: Spacecraft) -> np.ndarray:
    """Largest magnitude (2n,) rad of each joint's angle."""
    return np.array([t.yaw_limit for t in craft.terminals] + [t.pitch_limit for t in craft.terminals])


def _limits(craft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Limits (3 + 2n,) of rates, rad/s, and of accelerations, rad/s^2."""
    rates = [craft.rate_limit] * 3 + [t.rate_limit for t in craft.terminals] * 2
    speed_ups = [craft.acceleration_limit] * 3 + [t.acceleration_limit for t in craft.terminals] * 2
    return np.array(rates), np.array(speed_ups)


def _products(vectors: np.ndarray) -> Rotation:
    """Cumulative products of the rotations of vectors (k, 3) rad: the first, the first two, and so on."""
    turns, shift = Rotation.from_rotvec(vectors), 1
    while shift < len(vectors):
        turns = Rotation.concatenate([turns[:shift], turns[:-shift] * turns[shift:]])
        shift *= 2
    return turns


def _margin(scenario: Scenario, turns: Rotation, joints: np.ndarray) -> float:
    """Least margin of all zones along a motion, rad; NaN if a state is.

    Args:
        scenario: whose zones are meant.
        turns: k attitudes, body to inertial.
        joints: (k, 2n) rad.

    Raises:
        ValueError: for instruments and zones in groups.
    """
    craft = scenario.spacecraft
    if craft.instruments or any(zone.any_of for zone in scenario.keep_in):
        raise ValueError("instruments and zones in groups are not checked")
    least = np.inf
    for place, terminal in enumerate(craft.terminals):
        yaw, pitch = joints[:, place] + terminal.mount, joints[:, len(craft.terminals) + place]
        body = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=-1)
        seen = turns.apply(body)
        for zones, side in ((scenario.keep_out, 1), (scenario.keep_in, -1)):
            for zone in zones:
                if zone.devices and terminal.name not in zone.devices:
                    continue
                away = np.arctan2(
                    np.linalg.norm(np.cross(seen, zone.direction), axis=-1), seen @ zone.direction
                )
                least = np.minimum(least, np.min(side * (away - zone.half_angle)))
    return float(least)
